"""What the shape fit's solvers share: their form, their names, their tolerances."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from mocap_fit.tracks import FloatArray

# nlopt's local algorithms that keep to bounds; the first letters say gradient (LD) or none (LN).
ALGORITHMS = (
    "LD_SLSQP",
    "LD_LBFGS",
    "LD_CCSAQ",
    "LD_MMA",
    "LD_VAR2",
    "LD_TNEWTON_PRECOND_RESTART",
    "LN_PRAXIS",
    "LN_BOBYQA",
    "LN_SBPLX",
    "LN_COBYLA",
    "LN_NELDERMEAD",
)
NEWTON = "newton"
NEWTON_NLOPT = "newton-nlopt"
SOLVERS = (NEWTON_NLOPT, NEWTON, *ALGORITHMS)
# The algorithm that certifies Newton's answers: of those that end where they begin when that is
# the least, the one that needs the fewest evaluations to say so.
CERTIFYING = "LD_LBFGS"
# The algorithm that stands in where there is no compiled kernel.
PLAIN = "LD_SLSQP"

# Solvers stop when no parameter changes by the first, or the cost by the second part of it.
VALUE_TOLERANCE, COST_TOLERANCE = 1e-7, 1e-11

NOT_FITTED, BRIDGED = 0, 6
STATUS = {
    NOT_FITTED: "not fitted: too few markers are visible",
    1: "converged",
    2: "converged: cost reached",
    3: "converged: the cost no longer falls",
    4: "converged: the parameters no longer change",
    5: "stopped: maximum number of evaluations",
    -4: "converged as far as rounding lets it",
    -1: "converged: no step lowers the cost",
    BRIDGED: "bridged: too few markers; values from the neighbouring frames",
}


@dataclass(frozen=True, eq=False)
class Solved:
    """What a solver found in some frames; NaN and `NOT_FITTED` in those it was not to solve.

    Parameters
    ----------
    values
        `(frames, parameters)`.
    costs
        `(frames,)`.
    evaluations, status
        `(frames,)`.
    corrections
        `(frames, 6)`: of the pose; see `ShapeFit`.
    """

    values: FloatArray
    costs: FloatArray
    evaluations: NDArray[np.int64]
    status: NDArray[np.int64]
    corrections: FloatArray

    @classmethod
    def empty(cls, frames: int, parameters: int) -> Solved:
        """Nothing solved yet."""
        return cls(
            np.full((frames, parameters), np.nan),
            np.full(frames, np.nan),
            np.zeros(frames, dtype=np.int64),
            np.full(frames, NOT_FITTED, dtype=np.int64),
            np.zeros((frames, 6)),
        )

    @classmethod
    def joined(cls, parts: Sequence[Solved]) -> Solved:
        """One after the other."""
        return cls(
            np.concatenate([part.values for part in parts]),
            np.concatenate([part.costs for part in parts]),
            np.concatenate([part.evaluations for part in parts]),
            np.concatenate([part.status for part in parts]),
            np.concatenate([part.corrections for part in parts]),
        )


class Solver(Protocol):
    """Minimises the cost of frame after frame, each from the answer before."""

    def solve(self, targets: FloatArray, head: FloatArray, usable: NDArray[np.bool_]) -> Solved:
        """Minimise the cost of the usable frames.

        The last answer is kept: the next call goes on from it.

        Parameters
        ----------
        targets
            `(frames, markers, 3)`: the measured face markers in the face's coordinates.
        head
            `(frames, head markers, 3)`: the head markers.
        usable
            `(frames,)`: which frames show enough.
        """
        ...


def variable_scale(jacobian: FloatArray, weights: FloatArray) -> FloatArray:
    """What to divide parameters by, so that a unit of each moves the markers alike.

    Solvers that learn the curvature as they go then need half the evaluations.

    Parameters
    ----------
    jacobian
        `(markers, 3, parameters)` at the reference pose.
    weights
        `(markers,)`.
    """
    moved = np.sqrt(np.einsum("m,mip,mip->p", weights, jacobian, jacobian))
    return np.asarray(1.0 / np.maximum(moved, 1e-3 * moved.max()))
