"""Training: small batches, the best weights by the validation error, resumed to the byte."""

from __future__ import annotations

import dataclasses
import hashlib
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mocap_fit.control.base import LogEntry, Progress
from mocap_fit.control.model_file import read_model_file, write_model_file
from mocap_fit.control.networks.examples import Example, Scale, batch, in_batches
from mocap_fit.control.networks.features import windows
from mocap_fit.control.networks.recurrent import (
    Weights,
    errors_and_gradient,
    hidden_units,
    network_outputs,
    without_offsets,
)
from mocap_fit.control.networks.stack import Network, Stack
from mocap_fit.errors import FileFormatError
from mocap_fit.tracks import FloatArray

# Sentences side by side where nothing is learned.
_TOGETHER = 8


@dataclass(frozen=True)
class Plan:
    """How long and how to train.

    Parameters
    ----------
    epochs
        At most; passes through all sentences.
    patience
        Epochs without a better validation error after which a network stops.
    batch_size
        Sentences whose gradients are added up for one step.
    learning_rate
        Of the first step; it falls along a half cosine to a hundredth at the last epoch.
    averaging
        Share of the old in the running average of the weights, which is what is validated and
        kept.
    forgiven
        Share of every sentence's mean error that does not count.
    seed
        Of the first weights, and of the order of sentences.
    """

    epochs: int
    patience: int
    batch_size: int
    learning_rate: float
    averaging: float
    forgiven: float
    seed: int


class Training:
    """Networks on their way: those of one size are stacked and learn side by side.

    Parameters
    ----------
    networks
        What to train.
    plan
        How.
    delays
        Longest delay of the hidden layers, frames.
    data, held_out
        What is learned, and what tells when to stop; none of the second leaves that to the
        first.
    scale
        Of the targets.
    """

    def __init__(
        self,
        networks: Sequence[Network],
        plan: Plan,
        delays: int,
        data: Sequence[Example],
        held_out: Sequence[Example],
        scale: Scale,
    ) -> None:
        self.networks, self.plan, self.scale = tuple(networks), plan, scale
        self._data, self._held_out = tuple(data), tuple(held_out)
        self._context = len(data[0].inputs) - len(data[0].targets) + 1
        inputs = self._context * data[0].inputs.shape[1]
        sizes = sorted({network.hidden for network in networks}, reverse=True)
        self.stacks = [
            Stack.started(
                [network for network in networks if network.hidden == hidden],
                inputs,
                delays,
                len(scale.mean),
                plan.seed,
            )
            for hidden in sizes
        ]
        self.epoch = 0
        self.log: list[LogEntry] = []
        #: How many lines of the log were taken over from a checkpoint.
        self.resumed = 0

    @property
    def finished(self) -> bool:
        """Whether nothing is left to learn."""
        learning = any(stack.active for stack in self.stacks)
        return not learning or self.epoch >= self.plan.epochs

    def run(self, progress: Progress, checkpoint: Path | None = None) -> None:
        """Train to the end, or go on from a checkpoint that fits.

        Parameters
        ----------
        progress
            Called for every network and epoch.
        checkpoint
            Where the state is kept after every epoch.

        Raises
        ------
        FileFormatError
            If the checkpoint is there and is none.
        """
        kept = None if checkpoint is None else NetworkCheckpoint(checkpoint, self._fingerprint())
        if kept is not None:
            kept.resume(self)
            self.resumed = len(self.log)
        if not self.epoch:
            learned = [self._errors(stack, self._data) for stack in self.stacks]
            self._judge(learned, progress)
        while not self.finished:
            self.epoch += 1
            self._judge(self._learn(), progress)
            if kept is not None:
                kept.keep(self)

    def _learn(self) -> list[FloatArray]:
        """One epoch; of every stack the errors that were met on the way."""
        generator = np.random.default_rng([self.plan.seed, self.epoch])
        # The first step is whole, the last a hundredth of it.
        turn = math.pi * (self.epoch - 1) / self.plan.epochs
        rate = self.plan.learning_rate * (0.01 + 0.99 * 0.5 * (1 + math.cos(turn)))
        learned = [np.zeros((2, *stack.columns.shape)) for stack in self.stacks]
        for members in in_batches(self._data, self.plan.batch_size, generator):
            data = batch([self._data[i] for i in members], self.scale)
            seen = windows(data.inputs, self._context)
            for stack, errors in zip(self.stacks, learned, strict=True):
                if stack.active:
                    targets, counted = stack.wanted(data)
                    squares, gradient = errors_and_gradient(
                        stack.weights, seen, targets, counted, self.plan.forgiven
                    )
                    stack.step(gradient, rate, self.plan.averaging)
                    errors[0, stack.active] += squares
                    errors[1, stack.active] += counted.sum(axis=(1, 2))
        return learned

    def _errors(self, stack: Stack, those: Sequence[Example]) -> FloatArray:
        """Squared errors and counts, `(2, networks, outputs)`, of the averaged weights."""
        errors = np.zeros((2, *stack.columns.shape))
        for members in in_batches(those, _TOGETHER):
            data = batch([those[i] for i in members], self.scale)
            targets, counted = stack.wanted(data)
            units = hidden_units(stack.average, windows(data.inputs, self._context))
            found = network_outputs(stack.average, units[:, :, stack.average.delays :])
            difference = ((found - targets) * counted).astype(np.float64)
            kept = without_offsets(difference, counted, self.plan.forgiven)
            errors[0, stack.active] += (difference * kept).sum(axis=(1, 2))
            errors[1, stack.active] += counted.sum(axis=(1, 2))
        return errors

    def _judge(self, learned: Sequence[FloatArray], progress: Progress) -> None:
        """Write the log, keep what is best, and let networks stop that get no better."""
        entries = {}
        for stack, errors in zip(self.stacks, learned, strict=True):
            if not stack.active:
                continue
            deviation = np.append(self.scale.deviation, 0.0)[stack.columns]
            held_out = self._errors(stack, self._held_out) if self._held_out else None
            judged = errors if held_out is None else held_out
            for i in stack.active:
                training, validation = (
                    None if each is None else _root(each[0, i] * deviation[i] ** 2, each[1, i])
                    for each in (errors, held_out)
                )
                assert training is not None
                name = stack.networks[i].name
                entries[name] = LogEntry(self.epoch, training, validation, name)
            stack.judge([_root(judged[0, i], judged[1, i]) for i in stack.active])
            stack.stop(self.plan.patience)
        for network in self.networks:
            if network.name in entries:
                self.log.append(entries[network.name])
                progress(entries[network.name])

    def found(self) -> list[Weights]:
        """The best weights of every network, in the unit of the corpus and in double precision."""
        trained: dict[str, Weights] = {}
        for stack in self.stacks:
            for i, network in enumerate(stack.networks):
                own = Weights(*(array[i : i + 1].astype(np.float64) for array in stack.best))
                columns = list(network.columns)
                deviation, mean = self.scale.deviation[columns], self.scale.mean[columns]
                trained[network.name] = own._replace(
                    outputs=own.outputs[:, :, : len(columns)] * deviation,
                    output_bias=own.output_bias[:, :, : len(columns)] * deviation + mean,
                )
        return [trained[network.name] for network in self.networks]

    def _fingerprint(self) -> str:
        """What a checkpoint must have been made with to be gone on from."""
        about = [self.plan, self.networks, self._context, self.stacks[0].weights.delays]
        digest = hashlib.sha256(repr(about).encode())
        for part in (self._data, self._held_out):
            digest.update(f"{len(part)}".encode())
            for each in part:
                digest.update(each.inputs.tobytes())
                digest.update(each.targets.tobytes())
        return digest.hexdigest()


def _root(squares: FloatArray, counts: FloatArray) -> float:
    """Root mean square; 0 where nothing counts."""
    return math.sqrt(float(np.sum(squares)) / max(float(np.sum(counts)), 1.0))


class NetworkCheckpoint:
    """The state of a training in a file, from which it goes on as if nothing had been.

    Parameters
    ----------
    path
        The file.
    fingerprint
        Of data and plan; a checkpoint with another one is written anew.
    """

    def __init__(self, path: Path, fingerprint: str) -> None:
        self._path, self._fingerprint = path, fingerprint

    def keep(self, training: Training) -> None:
        """Write the state, whole or not at all."""
        header = {
            "checkpoint": "networks",
            "fingerprint": self._fingerprint,
            "epoch": training.epoch,
            "log": [dataclasses.astuple(entry) for entry in training.log],
            "stacks": [
                {name: getattr(stack, name) for name in Stack.COUNTERS} for stack in training.stacks
            ],
        }
        arrays = {
            f"{i}.{kind}.{name}": array
            for i, stack in enumerate(training.stacks)
            for kind in Stack.ARRAYS
            for name, array in getattr(stack, kind)._asdict().items()
        }
        write_model_file(header, arrays, self._path)

    def resume(self, training: Training) -> None:
        """Take over the state of a checkpoint that is there and fits.

        Raises
        ------
        FileFormatError
            If the file is no checkpoint of networks, or damaged.
        """
        if not self._path.is_file():
            return
        header, arrays = read_model_file(self._path)
        if header.get("checkpoint") != "networks":
            raise FileFormatError(
                "this file is no checkpoint of networks and stays as it is", path=self._path
            )
        if header.get("fingerprint") != self._fingerprint:
            return
        try:
            for i, (stack, counters) in enumerate(
                zip(training.stacks, header["stacks"], strict=True)
            ):
                for name in Stack.COUNTERS:
                    setattr(stack, name, counters[name])
                for kind in Stack.ARRAYS:
                    found = (arrays[f"{i}.{kind}.{name}"] for name in Weights._fields)
                    setattr(stack, kind, Weights(*found))
            training.epoch = header["epoch"]
            training.log = [LogEntry(*entry) for entry in header["log"]]
        except (KeyError, TypeError, ValueError) as error:
            raise FileFormatError(
                "this checkpoint is damaged",
                path=self._path,
                found=f"{type(error).__name__}: {error}",
                advice="Delete it, and train from the beginning.",
            ) from None
