"""Levenberg-Marquardt with bounds, on normal equations that the caller adds up."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import scipy.linalg

from mocap_fit.tracks import FloatArray

# The damping: where it begins, what a step that fails and one that succeeds make of it.
_FIRST, _MORE, _LESS = 1e-2, 5.0, 0.2
_LARGEST = 1e12


class Equations(NamedTuple):
    """What a sum of squares is like around a point.

    Parameters
    ----------
    squares
        `(n, n)`: J'J of the residuals' Jacobian J.
    slope
        `(n,)`: J'r, half the gradient.
    error
        The sum of squares r'r.
    """

    squares: FloatArray
    slope: FloatArray
    error: float


def minimise(
    equations: Callable[[FloatArray], Equations],
    error: Callable[[FloatArray], float],
    start: FloatArray,
    bounds: tuple[FloatArray, FloatArray],
    *,
    iterations: int,
    tolerance: float,
    after: Callable[[int, FloatArray, float], bool] | None = None,
) -> FloatArray:
    """Minimise a sum of squares between bounds.

    Parameters
    ----------
    equations
        The normal equations at a point.
    error
        The sum of squares alone.
    start
        `(n,)`.
    bounds
        The least and the largest values, `(n,)` each.
    iterations
        At most so many steps.
    tolerance
        Ends when a step makes the error less by a smaller part of it than this.
    after
        Called with the number of steps that were taken, the point and its error; what is true ends
        the search. Called for the start too.

    Returns
    -------
    FloatArray
        The last point, `(n,)`.
    """
    lower, upper = bounds
    point = np.clip(start, lower, upper)
    damping = _FIRST
    now = equations(point)
    if after is not None and after(0, point, now.error):
        return point
    for iteration in range(1, iterations + 1):
        # What stands at a bound and wants beyond it stays there.
        free = ~(((point <= lower) & (now.slope > 0)) | ((point >= upper) & (now.slope < 0)))
        found = None
        while found is None and damping < _LARGEST:
            step = _step(now, free, damping)
            wanted = np.clip(point + step, lower, upper)
            reached = error(wanted)
            if reached < now.error:
                found = wanted
                damping *= _LESS
            else:
                damping *= _MORE
        if found is None:
            break
        less = (now.error - reached) / now.error
        point = found
        stop = after is not None and after(iteration, point, reached)
        if stop or less < tolerance or reached == 0.0:
            break
        if iteration < iterations:
            now = equations(point)
    return point


def _step(
    now: Equations, free: np.ndarray[tuple[int], np.dtype[np.bool_]], damping: float
) -> FloatArray:
    """A damped step of the parameters that are free, `(n,)`; 0 for the others."""
    step = np.zeros(len(now.slope))
    squares = now.squares[np.ix_(free, free)]
    scale = np.diag(squares)
    # A parameter that nothing depends on keeps its place.
    least = 1e-12 * max(float(scale.max(initial=0.0)), 1e-300)
    squares = squares + np.diag(damping * scale + least)
    try:
        factor = scipy.linalg.cho_factor(squares, overwrite_a=True, check_finite=False)
    except scipy.linalg.LinAlgError:
        return step
    step[free] = -scipy.linalg.cho_solve(factor, now.slope[free], check_finite=False)
    return step
