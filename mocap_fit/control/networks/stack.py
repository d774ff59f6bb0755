"""Networks of one size that learn side by side: Adam, a running average, and the best so far."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from mocap_fit.control.networks.examples import Batch
from mocap_fit.control.networks.recurrent import Weights, drawn_weights

# Adam (Kingma and Ba 2015), with its own constants.
_FIRST, _SECOND, _LEAST = 0.9, 0.999, 1e-8
# A gradient longer than this is shortened to it: one odd sentence must not undo a training.
_LONGEST_GRADIENT = 1.0


@dataclass(frozen=True)
class Network:
    """One network: what it predicts, and its size.

    Parameters
    ----------
    name
        Such as ``occlusion``.
    columns
        Positions of its parameters among those of the corpus.
    hidden
        Hidden units.
    """

    name: str
    columns: tuple[int, ...]
    hidden: int


@dataclass
class Stack:
    """The networks of one size: those that still learn, and the best weights of all.

    Parameters
    ----------
    networks
        All of them.
    columns
        `(networks, outputs)`: their parameters; one past the last for an output that a network
        does not have.
    active
        Positions of those that still learn.
    weights, first, second, average
        Of the active ones: weights, Adam's two moments, and the running average of the weights,
        which is what is validated and kept.
    best
        Of all: the averages with the least error so far.
    steps
        Steps of Adam.
    least, since
        Of all: the least error so far, None before the first; epochs since then.
    """

    networks: tuple[Network, ...]
    columns: NDArray[np.intp]
    active: list[int]
    weights: Weights
    first: Weights
    second: Weights
    average: Weights
    best: Weights
    steps: int
    least: list[float | None]
    since: list[int]

    #: What of it a checkpoint keeps: numbers, and arrays.
    COUNTERS = ("active", "steps", "least", "since")
    ARRAYS = ("weights", "first", "second", "average", "best")

    @classmethod
    def started(
        cls, networks: Sequence[Network], inputs: int, delays: int, parameters: int, seed: int
    ) -> Self:
        """Networks before training.

        Parameters
        ----------
        networks
            All of one size.
        inputs
            Of the whole context.
        delays
            The longest delay, frames.
        parameters
            Of the corpus.
        seed
            Every network draws for itself, so that what it starts from does not depend on the
            others.
        """
        outputs = max(len(network.columns) for network in networks)
        columns = np.full((len(networks), outputs), parameters, dtype=np.intp)
        drawn = []
        for i, network in enumerate(networks):
            columns[i, : len(network.columns)] = network.columns
            generator = np.random.default_rng([seed, *network.name.encode()])
            own = drawn_weights(1, inputs, network.hidden, outputs, delays, generator)
            own.outputs[:, :, len(network.columns) :] = 0.0
            drawn.append(own)
        # Single precision learns as well, at twice the speed.
        weights = Weights(
            *(np.concatenate(arrays).astype(np.float32) for arrays in zip(*drawn, strict=True))
        )
        return cls(
            tuple(networks),
            columns,
            list(range(len(networks))),
            weights,
            first=weights.map(np.zeros_like),
            second=weights.map(np.zeros_like),
            average=weights.map(np.copy),
            best=weights.map(np.copy),
            steps=0,
            least=[None] * len(networks),
            since=[0] * len(networks),
        )

    def wanted(self, data: Batch) -> tuple[NDArray[Any], NDArray[Any]]:
        """Targets and which of them count, `(active networks, sentences, frames, outputs)`."""
        columns = self.columns[self.active]
        wider = [np.pad(a, ((0, 0), (0, 0), (0, 1))) for a in (data.targets, data.counted)]
        targets, counted = (
            np.ascontiguousarray(np.moveaxis(a[:, :, columns], 2, 0)) for a in wider
        )
        return targets, counted

    def step(self, gradient: Weights, rate: float, averaging: float) -> None:
        """One step of Adam, and of the running average.

        Parameters
        ----------
        gradient
            Of the active networks.
        rate
            Learning rate.
        averaging
            Share of the old in the running average.
        """
        self.steps += 1
        squares = sum(np.einsum("nij,nij->n", slope, slope) for slope in gradient)
        shorter = np.minimum(1.0, _LONGEST_GRADIENT / np.sqrt(np.maximum(squares, 1e-30)))
        shorter = shorter.astype(np.float32).reshape(-1, 1, 1)
        unbiased = math.sqrt(1 - _SECOND**self.steps) / (1 - _FIRST**self.steps)
        size = np.float32(rate * unbiased)
        # In the beginning it is the plain mean of all steps so far.
        new = np.float32(max(1 - averaging, 1 / self.steps))
        for weight, slope, first, second, average in zip(
            self.weights, gradient, self.first, self.second, self.average, strict=True
        ):
            slope = slope * shorter
            first += np.float32(1 - _FIRST) * (slope - first)
            second += np.float32(1 - _SECOND) * (slope * slope - second)
            weight -= size * first / (np.sqrt(second) + np.float32(_LEAST))
            average += new * (weight - average)

    def judge(self, errors: Sequence[float]) -> None:
        """Keep the averages that have the least error so far; one error an active network."""
        for place, (network, error) in enumerate(zip(self.active, errors, strict=True)):
            least = self.least[network]
            if math.isfinite(error) and (least is None or error < least):
                self.least[network], self.since[network] = error, 0
                for best, average in zip(self.best, self.average, strict=True):
                    best[network] = average[place]
            else:
                self.since[network] += 1

    def stop(self, patience: int) -> None:
        """Let networks rest that were not at their best for so many epochs."""
        going = [
            place for place, network in enumerate(self.active) if self.since[network] < patience
        ]
        if len(going) == len(self.active):
            return
        self.active = [self.active[place] for place in going]
        for kind in ("weights", "first", "second", "average"):
            setattr(self, kind, getattr(self, kind).map(lambda array: array[going]))
