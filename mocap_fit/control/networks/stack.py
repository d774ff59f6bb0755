"""Networks of one size that learn side by side: Adam, a running average, and the best so far."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from mocap_fit.control.networks.examples import Batch
from mocap_fit.control.networks.recurrent import Weights, draw_weights

# Constants of Adam (Kingma and Ba 2015): beta_1, beta_2, epsilon.
_BETA_1, _BETA_2, _EPSILON = 0.9, 0.999, 1e-8
# Gradients are clipped to this norm: one odd sentence must not undo a training.
_MAX_NORM = 1.0


@dataclass(frozen=True)
class Network:
    """One network: what it predicts, and its size.

    Parameters
    ----------
    name
        Name, such as ``occlusion``.
    columns
        Positions of its parameters among those of the corpus.
    hidden
        Number of hidden units.
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
        All networks.
    columns
        Their parameters, ``(networks, outputs)``; one past the last for an output that a network
        does not have.
    active
        Positions of those that still learn.
    weights
        Weights of the active ones.
    first
        First moments of Adam of the active ones.
    second
        Second moments of Adam of the active ones.
    average
        Running averages of the weights of the active ones, which are what is validated and used.
    best
        Averages with the least error so far, of all.
    steps
        Number of steps of Adam.
    least
        The least error so far, of all, in the unit of the scale; None before the first.
    since
        Number of epochs since then, of all.
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

    #: The attributes that a checkpoint stores: numbers, and arrays.
    COUNTERS = ("active", "steps", "least", "since")
    ARRAYS = ("weights", "first", "second", "average", "best")

    @classmethod
    def from_networks(
        cls, networks: Sequence[Network], inputs: int, delays: int, parameters: int, seed: int
    ) -> Self:
        """Return networks before training.

        Parameters
        ----------
        networks
            Networks of one size.
        inputs
            Number of inputs of the complete context.
        delays
            The longest delay, frames.
        parameters
            Number of parameters of the corpus.
        seed
            Seed of the weights. Every network draws for itself, so that its start does not depend
            on the others.

        Returns
        -------
        Stack
            All networks active.
        """
        outputs = max(len(network.columns) for network in networks)
        columns = np.full((len(networks), outputs), parameters, dtype=np.intp)
        drawn = []
        for i, network in enumerate(networks):
            columns[i, : len(network.columns)] = network.columns
            generator = np.random.default_rng([seed, *network.name.encode()])
            start = draw_weights(inputs, network.hidden, outputs, delays, generator)
            start.outputs[:, :, len(network.columns) :] = 0.0
            drawn.append(start)
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

    def select_targets(self, data: Batch) -> tuple[NDArray[Any], NDArray[Any]]:
        """Return the targets of the active networks.

        Parameters
        ----------
        data
            The sentences.

        Returns
        -------
        targets
            ``(active networks, sentences, frames, outputs)``.
        counted
            Whether each counts, ``(active networks, sentences, frames, outputs)``: 1 or 0.
        """
        columns = self.columns[self.active]
        wider = [np.pad(a, ((0, 0), (0, 0), (0, 1))) for a in (data.targets, data.counted)]
        targets, counted = (
            np.ascontiguousarray(np.moveaxis(a[:, :, columns], 2, 0)) for a in wider
        )
        return targets, counted

    def step(self, gradient: Weights, rate: float, averaging: float) -> None:
        """Take one step of Adam, and of the running average.

        Parameters
        ----------
        gradient
            Gradient of the active networks.
        rate
            Learning rate, no unit.
        averaging
            Share of the old weights in the running average, 0 to below 1.
        """
        self.steps += 1
        squares = sum(np.einsum("nij,nij->n", slope, slope) for slope in gradient)
        factor = np.minimum(1.0, _MAX_NORM / np.sqrt(np.maximum(squares, 1e-30)))
        factor = factor.astype(np.float32).reshape(-1, 1, 1)
        unbiased = math.sqrt(1 - _BETA_2**self.steps) / (1 - _BETA_1**self.steps)
        size = np.float32(rate * unbiased)
        # In the beginning it is the plain mean of all steps so far.
        new = np.float32(max(1 - averaging, 1 / self.steps))
        for weight, slope, first, second, average in zip(
            self.weights, gradient, self.first, self.second, self.average, strict=True
        ):
            slope = slope * factor
            first += np.float32(1 - _BETA_1) * (slope - first)
            second += np.float32(1 - _BETA_2) * (slope * slope - second)
            weight -= size * first / (np.sqrt(second) + np.float32(_EPSILON))
            average += new * (weight - average)

    def judge(self, errors: Sequence[float]) -> None:
        """Store the averages that have the least error so far.

        Parameters
        ----------
        errors
            An error for each active network, in the unit of the scale.
        """
        for position, (network, error) in enumerate(zip(self.active, errors, strict=True)):
            least = self.least[network]
            if math.isfinite(error) and (least is None or error < least):
                self.least[network], self.since[network] = error, 0
                for best, average in zip(self.best, self.average, strict=True):
                    best[network] = average[position]
            else:
                self.since[network] += 1

    def stop(self, patience: int) -> None:
        """Stop networks that were not at their best for some epochs.

        Parameters
        ----------
        patience
            Number of epochs.
        """
        going = [i for i, network in enumerate(self.active) if self.since[network] < patience]
        if len(going) == len(self.active):
            return
        self.active = [self.active[i] for i in going]
        for kind in ("weights", "first", "second", "average"):
            setattr(self, kind, getattr(self, kind).map(lambda array: array[going]))
