"""The protocol of the shape fit's solvers, their names and tolerances."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from mocap_fit.tracks import FloatArray

# nlopt's local algorithms with bounds; LD uses the gradient, LN does not.
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
# The algorithm that certifies Newton's results: of those that stay at a start which is the
# minimum, the one that needs the fewest evaluations to do so.
CERTIFYING = "LD_LBFGS"
# The algorithm that is used where there is no compiled kernel.
PLAIN = "LD_SLSQP"

# Absolute tolerance of the parameters, and relative tolerance of the cost.
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


class Solution(NamedTuple):
    """A solver's results for a chunk of frames; NaN and `NOT_FITTED` in unusable frames.

    Parameters
    ----------
    values
        Parameters, ``(frames, parameters)``; 0 is rest, 1 the full gesture.
    costs
        Costs, ``(frames,)``, in the unit of the objective.
    evaluations
        Numbers of evaluations, ``(frames,)``, no unit.
    status
        Keys of `STATUS`, ``(frames,)``, no unit.
    corrections
        Corrections of the pose, ``(frames, 6)``: rotation vector, radians, and translation,
        millimetres of the face.
    """

    values: FloatArray
    costs: FloatArray
    evaluations: NDArray[np.int64]
    status: NDArray[np.int64]
    corrections: FloatArray

    @classmethod
    def allocate(cls, frames: int, parameters: int) -> Solution:
        """Allocate results of frames that are not fitted.

        Parameters
        ----------
        frames
            Number of frames.
        parameters
            Number of parameters.

        Returns
        -------
        Solution
            Its arrays are to be filled.
        """
        return cls(
            np.full((frames, parameters), np.nan),
            np.full(frames, np.nan),
            np.zeros(frames, dtype=np.int64),
            np.full(frames, NOT_FITTED, dtype=np.int64),
            np.zeros((frames, 6)),
        )

    @classmethod
    def concatenate(cls, parts: Sequence[Solution]) -> Solution:
        """Concatenate the results of chunks.

        Parameters
        ----------
        parts
            Results, in the order of the frames.

        Returns
        -------
        Solution
            Results of all frames.
        """
        return cls(*map(np.concatenate, zip(*parts, strict=True)))


class Solver(Protocol):
    """A solver of the shape fit."""

    def solve(self, targets: FloatArray, head: FloatArray, usable: NDArray[np.bool_]) -> Solution:
        """Minimise the cost of the usable frames, each from the result of the one before.

        The next call starts from the last result.

        Parameters
        ----------
        targets
            Measured face markers, ``(frames, markers, 3)``, millimetres of the face; NaN where
            hidden.
        head
            Head markers, ``(frames, head markers, 3)``, millimetres of the face; NaN where hidden.
        usable
            Which frames are solved, ``(frames,)``, no unit.

        Returns
        -------
        Solution
            Parameters, costs and status of the frames.
        """
        ...


def compute_variable_scale(jacobian: FloatArray, weights: FloatArray) -> FloatArray:
    """Compute divisors of the parameters, after which a unit of each moves the markers alike.

    Solvers that estimate the curvature then need half the evaluations.

    Parameters
    ----------
    jacobian
        Jacobian at the reference pose, ``(markers, 3, parameters)``, millimetres per unit.
    weights
        Weights of the markers, ``(markers,)``, no unit.

    Returns
    -------
    ndarray
        Divisors, ``(parameters,)``.
    """
    moved = np.sqrt(np.einsum("m,mip,mip->p", weights, jacobian, jacobian))
    return np.asarray(1.0 / np.maximum(moved, 1e-3 * moved.max()))
