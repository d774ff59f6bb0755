"""Training: small batches, the best weights by the validation error, resumed to the byte."""

from __future__ import annotations

import dataclasses
import hashlib
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mocap_fit.control.base import LogEntry, Progress
from mocap_fit.control.checkpoint import read_checkpoint
from mocap_fit.control.model_file import write_model_file
from mocap_fit.control.networks.examples import (
    Batch,
    Example,
    Scale,
    build_batch,
    split_into_batches,
)
from mocap_fit.control.networks.features import slice_windows
from mocap_fit.control.networks.recurrent import (
    Weights,
    compute_errors_and_gradient,
    compute_hidden,
    compute_outputs,
    subtract_offsets,
)
from mocap_fit.control.networks.stack import Network, Stack
from mocap_fit.errors import FileFormatError
from mocap_fit.tracks import FloatArray

# Sentences side by side where nothing is learned.
_EVALUATION_BATCH = 8
_CHECKPOINT = "networks"


@dataclass(frozen=True)
class Plan:
    """How long and how to train.

    Parameters
    ----------
    max_iter
        Largest number of epochs, passes through all sentences.
    patience
        Epochs without a smaller validation error after which a network stops.
    batch_size
        Number of sentences whose gradients are added up for one step.
    learning_rate
        Learning rate of the first step, no unit; it falls along a half cosine to a hundredth at
        the last epoch.
    averaging
        Share of the old weights in their running average, 0 to below 1. The average is what is
        validated and used.
    detrend
        Share of every sentence's mean error that does not count, no unit,
        0 to below 1.
    random_state
        Seed of the first weights, and of the order of sentences.
    """

    max_iter: int
    patience: int
    batch_size: int
    learning_rate: float
    averaging: float
    detrend: float
    random_state: int

    def compute_rate(self, epoch: int) -> float:
        """Return the learning rate of an epoch.

        Parameters
        ----------
        epoch
            Number of the epoch, from 1 to ``max_iter``.

        Returns
        -------
        float
            `learning_rate` in the first epoch, and along a half cosine towards a hundredth of it.
        """
        angle = math.pi * (epoch - 1) / self.max_iter
        return self.learning_rate * (0.01 + 0.99 * 0.5 * (1 + math.cos(angle)))


class Training:
    """Networks in training: those of one size are stacked and learn side by side.

    Parameters
    ----------
    networks
        What to train.
    plan
        How.
    delays
        Longest delay of the hidden layers, frames.
    data
        What is learned.
    held_out
        What decides when to stop; without any, the training error does.
    scale
        The units of the targets.
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
        sizes = sorted({network.hidden for network in networks})
        self.stacks = [
            Stack.from_networks(
                [network for network in networks if network.hidden == hidden],
                inputs,
                delays,
                len(scale.mean),
                plan.random_state,
            )
            for hidden in sizes
        ]
        self.epoch = 0
        self.log: list[LogEntry] = []
        #: Number of lines of the log that are from a checkpoint.
        self.resumed = 0

    @property
    def is_finished(self) -> bool:
        """Whether nothing is left to learn."""
        is_learning = any(stack.active for stack in self.stacks)
        return not is_learning or self.epoch >= self.plan.max_iter

    def run(self, progress: Progress, checkpoint: Path | None = None) -> None:
        """Train to the end, or resume from a checkpoint that fits.

        Parameters
        ----------
        progress
            Called for every network and epoch.
        checkpoint
            Where the state is stored after every epoch.

        Raises
        ------
        FileFormatError
            If the file of the checkpoint is something else, or damaged.
        """
        fingerprint = "" if checkpoint is None else self._compute_fingerprint()
        if checkpoint is not None:
            _restore_training(self, checkpoint, fingerprint)
            self.resumed = len(self.log)
        if not self.epoch:
            errors = [self._compute_errors(stack, self._data) for stack in self.stacks]
            self._judge(errors, progress)
        while not self.is_finished:
            self.epoch += 1
            self._judge(self._learn(), progress)
            if checkpoint is not None:
                _store_training(self, checkpoint, fingerprint)

    def _iterate_batches(
        self, examples: Sequence[Example], size: int, generator: np.random.Generator | None = None
    ) -> Iterator[tuple[Batch, NDArray[np.float32]]]:
        """Yield batches, and what the input layer sees of them."""
        for positions in split_into_batches(examples, size, generator):
            data = build_batch([examples[i] for i in positions], self.scale)
            yield data, slice_windows(data.inputs, self._context)

    def _learn(self) -> list[FloatArray]:
        """Train for one epoch; return the errors of every stack that were met on the way."""
        generator = np.random.default_rng([self.plan.random_state, self.epoch])
        rate = self.plan.compute_rate(self.epoch)
        all_errors = [np.zeros((2, *stack.columns.shape)) for stack in self.stacks]
        for data, seen in self._iterate_batches(self._data, self.plan.batch_size, generator):
            for stack, errors in zip(self.stacks, all_errors, strict=True):
                if stack.active:
                    targets, counted = stack.select_targets(data)
                    squares, gradient = compute_errors_and_gradient(
                        stack.weights, seen, targets, counted, self.plan.detrend
                    )
                    stack.step(gradient, rate, self.plan.averaging)
                    errors[0, stack.active] += squares
                    errors[1, stack.active] += counted.sum(axis=(1, 2))
        return all_errors

    def _compute_errors(self, stack: Stack, examples: Sequence[Example]) -> FloatArray:
        """Return squared errors and counts of the averaged weights, ``(2, networks, outputs)``."""
        errors = np.zeros((2, *stack.columns.shape))
        for data, seen in self._iterate_batches(examples, _EVALUATION_BATCH):
            targets, counted = stack.select_targets(data)
            units = compute_hidden(stack.average, seen)
            outputs = compute_outputs(stack.average, units[:, :, stack.average.delays :])
            difference = ((outputs - targets) * counted).astype(np.float64)
            detrended = subtract_offsets(difference, counted, self.plan.detrend)
            errors[0, stack.active] += (difference * detrended).sum(axis=(1, 2))
            errors[1, stack.active] += counted.sum(axis=(1, 2))
        return errors

    def _judge(self, training_errors: Sequence[FloatArray], progress: Progress) -> None:
        """Write the log, store the best weights, and stop networks that get no better."""
        entries = {}
        for stack, errors in zip(self.stacks, training_errors, strict=True):
            if not stack.active:
                continue
            deviation = np.append(self.scale.deviation, 0.0)[stack.columns]
            held_out = self._compute_errors(stack, self._held_out) if self._held_out else None
            for i in stack.active:
                scale = deviation[i] ** 2
                training, validation = _compute_rms(errors[0, i] * scale, errors[1, i]), None
                if held_out is not None:
                    validation = _compute_rms(held_out[0, i] * scale, held_out[1, i])
                name = stack.networks[i].name
                entries[name] = LogEntry(self.epoch, training, validation, name)
            judged = errors if held_out is None else held_out
            stack.judge([_compute_rms(judged[0, i], judged[1, i]) for i in stack.active])
            stack.stop(self.plan.patience)
        for network in self.networks:
            if network.name in entries:
                self.log.append(entries[network.name])
                progress(entries[network.name])

    def get_weights(self) -> list[Weights]:
        """Return the best weights of every network, in the unit of the corpus.

        Returns
        -------
        list[Weights]
            Stacks of one in double precision, in the order of the networks.
        """
        trained: dict[str, Weights] = {}
        for stack in self.stacks:
            for i, network in enumerate(stack.networks):
                best = Weights(*(array[i : i + 1].astype(np.float64) for array in stack.best))
                columns = list(network.columns)
                deviation, mean = self.scale.deviation[columns], self.scale.mean[columns]
                trained[network.name] = best._replace(
                    outputs=best.outputs[:, :, : len(columns)] * deviation,
                    output_bias=best.output_bias[:, :, : len(columns)] * deviation + mean,
                )
        return [trained[network.name] for network in self.networks]

    def _compute_fingerprint(self) -> str:
        """Return the digest of networks, plan and data that a checkpoint must have to fit."""
        about = [self.plan, self.networks, self._context, self.stacks[0].weights.delays]
        digest = hashlib.sha256(repr(about).encode())
        for part in (self._data, self._held_out):
            digest.update(f"{len(part)}".encode())
            for each in part:
                digest.update(each.inputs.tobytes())
                digest.update(each.targets.tobytes())
        return digest.hexdigest()


def _compute_rms(squares: FloatArray, counts: FloatArray) -> float:
    """Return the root mean square; 0 where nothing counts."""
    return math.sqrt(float(np.sum(squares)) / max(float(np.sum(counts)), 1.0))


def _store_training(training: Training, path: Path, fingerprint: str) -> None:
    """Write the state of a training, completely or not at all."""
    header = {
        "checkpoint": _CHECKPOINT,
        "fingerprint": fingerprint,
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
    write_model_file(header, arrays, path)


def _restore_training(training: Training, path: Path, fingerprint: str) -> None:
    """Set the state of a training to that of a checkpoint, if there is one that fits."""
    stored = read_checkpoint(path, _CHECKPOINT, fingerprint)
    if stored is None:
        return
    header, arrays = stored
    try:
        for i, (stack, counters) in enumerate(zip(training.stacks, header["stacks"], strict=True)):
            for name in Stack.COUNTERS:
                setattr(stack, name, counters[name])
            for kind in Stack.ARRAYS:
                weights = (arrays[f"{i}.{kind}.{name}"] for name in Weights._fields)
                setattr(stack, kind, Weights(*weights))
        training.epoch = header["epoch"]
        training.log = [LogEntry(*entry) for entry in header["log"]]
    except (KeyError, TypeError, ValueError) as error:
        raise FileFormatError(
            "this checkpoint is damaged",
            path=path,
            found=f"{type(error).__name__}: {error}",
            advice="Delete it, and train from the beginning.",
        ) from None
