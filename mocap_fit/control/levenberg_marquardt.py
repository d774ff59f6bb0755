"""Levenberg-Marquardt with bounds, on normal equations that the caller adds up."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from mocap_fit.tracks import FloatArray

# The damping at the start, and its factors after a step that fails and one that succeeds.
_FIRST_DAMPING, _INCREASE, _DECREASE = 1e-2, 5.0, 0.2
_LARGEST_DAMPING = 1e12


class NormalEquations(NamedTuple):
    """A sum of squares r'r around a point, with the Jacobian J of the residuals r.

    Parameters
    ----------
    hessian
        J'J, ``(n, n)``: half the second derivatives, as Gauss and Newton approximate them.
    gradient
        J'r, ``(n,)``: half the gradient.
    cost
        The sum of squares r'r, in the squared unit of the residuals.
    """

    hessian: FloatArray
    gradient: FloatArray
    cost: float


def minimise(
    equations: Callable[[FloatArray], NormalEquations],
    cost: Callable[[FloatArray], float],
    start: FloatArray,
    bounds: tuple[FloatArray, FloatArray],
    *,
    max_iter: int,
    tol: float,
    callback: Callable[[int, FloatArray, float], bool] | None = None,
) -> FloatArray:
    """Minimise a sum of squares between bounds.

    Parameters
    ----------
    equations
        A function that returns the normal equations at a point.
    cost
        A function that returns the sum of squares alone.
    start
        The first point, ``(n,)``.
    bounds
        The least and the largest values, ``(n,)`` each.
    max_iter
        The largest number of steps.
    tol
        The search ends when a step reduces the cost by less than this share of it.
    callback
        Called with the number of steps, the point and its cost, from the start on; the search ends
        when it returns true.

    Returns
    -------
    FloatArray
        The last point, ``(n,)``.
    """
    lower, upper = bounds
    point = np.clip(start, lower, upper)
    damping = _FIRST_DAMPING
    now = equations(point)
    if callback is not None and callback(0, point, now.cost):
        return point
    for iteration in range(1, max_iter + 1):
        # A value at a bound whose descent leads beyond it stays there.
        free = ~(((point <= lower) & (now.gradient > 0)) | ((point >= upper) & (now.gradient < 0)))
        while damping < _LARGEST_DAMPING:
            candidate = np.clip(point + _compute_step(now, free, damping), lower, upper)
            reached = cost(candidate)
            if reached < now.cost:
                break
            damping *= _INCREASE
        else:
            break
        damping *= _DECREASE
        point = candidate
        stop = callback is not None and callback(iteration, point, reached)
        if stop or now.cost - reached < tol * now.cost:
            break
        if iteration < max_iter:
            now = equations(point)
    return point


def _compute_step(now: NormalEquations, free: NDArray[np.bool_], damping: float) -> FloatArray:
    """Return a damped step of the parameters that are free, ``(n,)``; 0 for the others."""
    step = np.zeros(len(now.gradient))
    hessian = now.hessian[np.ix_(free, free)]
    scale = np.diag(hessian)
    # A parameter that nothing depends on does not move.
    least = 1e-12 * max(float(scale.max(initial=0.0)), 1e-300)
    hessian = hessian + np.diag(damping * scale + least)
    try:
        factor = scipy.linalg.cho_factor(hessian, overwrite_a=True, check_finite=False)
    except scipy.linalg.LinAlgError:
        return step
    step[free] = -scipy.linalg.cho_solve(factor, now.gradient[free], check_finite=False)
    return step
