"""The base class of models that learn each articulatory parameter on its own by least squares."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from pydantic import NonNegativeFloat, PositiveInt

from mocap_fit.control.base import LogEntry, Progress
from mocap_fit.control.checkpoint import Checkpoint
from mocap_fit.control.levenberg_marquardt import NormalEquations, minimise
from mocap_fit.control.symbol_model import SymbolModel
from mocap_fit.tracks import FloatArray


class Residuals(Protocol):
    """The errors of a model's trajectory of one parameter (Beskow eq. 5)."""

    @property
    def count(self) -> int:
        """Number of frames that have a value."""

    def cost(self, point: FloatArray) -> float:
        """Return the sum of squared errors.

        Parameters
        ----------
        point
            Free parameters, ``(n,)``.

        Returns
        -------
        float
            The sum in squared units of the parameter.
        """

    def compute_equations(self, point: FloatArray) -> NormalEquations:
        """Return the normal equations.

        Parameters
        ----------
        point
            Free parameters, ``(n,)``.

        Returns
        -------
        NormalEquations
            Of the squared errors around the point.
        """


@dataclass(frozen=True)
class Penalty:
    """A penalty on the distance from a point: ``weights @ (point - start) ** 2``.

    Parameters
    ----------
    start
        The point, ``(n,)``.
    weights
        Weights of the squares, ``(n,)``, 0 or more.
    """

    start: FloatArray
    weights: FloatArray

    def cost(self, point: FloatArray) -> float:
        """Return the penalty.

        Parameters
        ----------
        point
            Free parameters, ``(n,)``.

        Returns
        -------
        float
            The penalty, 0 or more.
        """
        return float(self.weights @ (point - self.start) ** 2)

    def add_to(self, equations: NormalEquations, point: FloatArray) -> NormalEquations:
        """Return normal equations with the penalty.

        Parameters
        ----------
        equations
            Those without it.
        point
            Where they are, ``(n,)``.

        Returns
        -------
        NormalEquations
            Those of the sum of both costs.
        """
        return NormalEquations(
            equations.hessian + np.diag(self.weights),
            equations.gradient + self.weights * (point - self.start),
            equations.cost + self.cost(point),
        )


@dataclass(eq=False, repr=False)
class ParameterwiseModel(SymbolModel):
    """A model of coarticulation, trained parameter by parameter with Levenberg-Marquardt.

    Parameters
    ----------
    max_iter
        Largest number of iterations for each articulatory parameter.
    tol
        Training ends when an iteration reduces the error by less than this share of it.
    patience
        Training ends when the error on the validation part was not the least for so many
        iterations; the point of the least error is what was learned.
    l2
        Strength of the L2 penalty on the distance of the free parameters from their start, in
        frames: 1 weighs as much as the squared error of one frame. It decides about phones that
        are seldom spoken. 0 is the paper's error.
    """

    max_iter: PositiveInt = 30
    tol: NonNegativeFloat = 1e-3
    patience: PositiveInt = 3
    l2: NonNegativeFloat = 1.0

    def _minimise(
        self,
        name: str,
        training: Residuals,
        held_out: Residuals,
        penalty: Penalty,
        bounds: tuple[FloatArray, FloatArray],
        progress: Progress,
        stored: Checkpoint,
    ) -> FloatArray:
        """Return the free parameters of one articulatory parameter, ``(n,)``.

        The last point, or, with frames that are held out, that of their least error. A parameter
        that is stored is not trained again; its iterations are logged as they were then.
        """
        log = f"log {name}"
        if name in stored:
            for row in stored[log]:
                progress(_to_entry(name, row))
            return stored[name]
        rows: list[tuple[float, float, float]] = []
        best = (math.inf, 0, penalty.start)

        def log_iteration(iteration: int, point: FloatArray, cost: float) -> bool:
            nonlocal best
            error = max(cost - penalty.cost(point), 0.0)
            held_out_error = held_out.cost(point) if held_out.count else math.nan
            rows.append(
                (
                    float(iteration),
                    math.sqrt(error / max(training.count, 1)),
                    math.sqrt(held_out_error / held_out.count) if held_out.count else math.nan,
                )
            )
            progress(_to_entry(name, rows[-1]))
            if not held_out.count or held_out_error < best[0]:
                best = (held_out_error, iteration, point.copy())
            return iteration - best[1] >= self.patience

        minimise(
            lambda point: penalty.add_to(training.compute_equations(point), point),
            lambda point: training.cost(point) + penalty.cost(point),
            penalty.start,
            bounds,
            max_iter=self.max_iter,
            tol=self.tol,
            callback=log_iteration,
        )
        stored.store({log: np.array(rows), name: best[2]})
        return best[2]


def _to_entry(part: str, row: tuple[float, float, float] | FloatArray) -> LogEntry:
    error = float(row[2])
    return LogEntry(int(row[0]), float(row[1]), None if math.isnan(error) else error, part)
