"""Training of one articulatory parameter on its own: least squares, early stopping, log, resume."""

from __future__ import annotations

import math
from typing import Protocol

import numpy as np

from mocap_fit.control.base import LogEntry, Progress
from mocap_fit.control.levenberg_marquardt import Equations, minimise
from mocap_fit.control.training import Checkpoint
from mocap_fit.tracks import FloatArray


class Errors(Protocol):
    """The errors of a model's trajectory of one parameter (Beskow eq. 5)."""

    @property
    def count(self) -> int:
        """How many frames have a value."""

    def error(self, point: FloatArray) -> float:
        """Sum of squares at a point of the free parameters."""

    def equations(self, point: FloatArray) -> Equations:
        """The normal equations there."""


class Limits(Protocol):
    """The settings of a model that say how long it is trained."""

    iterations: int
    tolerance: float
    patience: int


def train_parameter(
    name: str,
    training: Errors,
    held: Errors,
    start: FloatArray,
    pull: FloatArray,
    bounds: tuple[FloatArray, FloatArray],
    limits: Limits,
    kept: Checkpoint,
    progress: Progress,
) -> FloatArray:
    """Find the free parameters of one articulatory parameter.

    Parameters
    ----------
    name
        Of the articulatory parameter: the part of the log, and of the checkpoint.
    training, held
        The errors on what is trained on, and on what tells when to stop; that may have no frames.
    start
        `(n,)`, the free parameters to begin with.
    pull
        `(n,)`: ``pull * (point - start) ** 2`` is added to the sum of squares.
    bounds
        The least and the largest values, `(n,)` each.
    limits
        When it ends.
    kept
        What was trained before.
    progress
        Called once an iteration; for a part that was trained before, with what was logged then.

    Returns
    -------
    FloatArray
        `(n,)`: the last point, or, with frames that were held out, that of their least error.
    """
    log = f"log {name}"
    if name in kept:
        for row in kept[log]:
            progress(_entry(name, row))
        return kept[name]

    def held_back(point: FloatArray) -> float:
        return float(pull @ (point - start) ** 2)

    def equations(point: FloatArray) -> Equations:
        found = training.equations(point)
        return Equations(
            found.squares + np.diag(pull),
            found.slope + pull * (point - start),
            found.error + held_back(point),
        )

    rows: list[tuple[float, float, float]] = []
    best = (math.inf, 0, start)

    def after(iteration: int, point: FloatArray, error: float) -> bool:
        nonlocal best
        of_training = max(error - held_back(point), 0.0)
        of_held = held.error(point) if held.count else math.nan
        rows.append(
            (
                float(iteration),
                math.sqrt(of_training / max(training.count, 1)),
                math.sqrt(of_held / held.count) if held.count else math.nan,
            )
        )
        progress(_entry(name, rows[-1]))
        if not held.count or of_held < best[0]:
            best = (of_held, iteration, point.copy())
        return iteration - best[1] >= limits.patience

    minimise(
        equations,
        lambda point: training.error(point) + held_back(point),
        start,
        bounds,
        iterations=limits.iterations,
        tolerance=limits.tolerance,
        after=after,
    )
    kept.keep(log, np.array(rows))
    kept.keep(name, best[2])
    return best[2]


def _entry(part: str, row: tuple[float, float, float] | FloatArray) -> LogEntry:
    held = float(row[2])
    return LogEntry(int(row[0]), float(row[1]), None if math.isnan(held) else held, part)
