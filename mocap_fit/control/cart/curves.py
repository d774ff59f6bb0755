"""From targets at the centres of segments to a curve over time (Krňoul & Železný section 5.1)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from mocap_fit.control.cart.closures import Closure
from mocap_fit.tracks import FloatArray

INTERPOLATIONS = ("cubic", "linear", "cosine")
# The bell that smooths: its places in standard deviations, and its weights.
_PLACES = np.linspace(-2.4, 2.4, 17)
_WEIGHTS = np.exp(-0.5 * _PLACES**2) / np.exp(-0.5 * _PLACES**2).sum()


def curve(
    centres: FloatArray,
    targets: FloatArray,
    times: FloatArray,
    *,
    interpolation: str = "cubic",
    smoothing: float = 0.0,
    closures: Mapping[int, Closure] | None = None,
    held: FloatArray | None = None,
) -> FloatArray:
    """Parameters over time.

    Parameters
    ----------
    centres
        `(segments,)`, seconds, ascending: where the targets are.
    targets
        `(segments, parameters)`.
    times
        `(times,)`, seconds, in any order.
    interpolation
        ``cubic``: piecewise cubic, monotone between two targets (Fritsch and Butland 1984, as
        scipy has it); ``linear``; ``cosine``: half a period of a cosine from target to target.
        Before the first target and after the last the curve stays at it.
    smoothing
        Standard deviation of a bell that the curve is smoothed with, seconds; 0 for none.
    closures
        By parameter, from 0: what is guaranteed.
    held
        `(segments, 2)`: from when to when each segment is kept closed, seconds; NaN for those
        that are not. Smoothing is narrower near them, and nothing in them.

    Returns
    -------
    FloatArray
        `(times, parameters)`. In the times that are held a parameter with a closure is not more
        open than it.
    """
    values = np.empty((len(times), targets.shape[1]))
    closed = {} if closures is None else dict(closures)
    is_held = np.zeros(len(centres), bool) if held is None else np.isfinite(held).all(axis=1)
    if not is_held.any():
        closed = {}
    free = [p for p in range(targets.shape[1]) if p not in closed]
    values[:, free] = _smoothed(
        centres, targets[:, free], times, interpolation, np.full(len(times), smoothing)
    )
    for p, closure in closed.items():
        assert held is not None
        own = targets[:, p].copy()
        own[is_held] = closure.kept(own[is_held])
        # A held segment has the same target twice: the curve between the two is flat.
        repeats = np.where(is_held, 2, 1)
        knots = np.repeat(centres, repeats)
        starts = np.cumsum(repeats) - repeats
        knots[starts[is_held]], knots[starts[is_held] + 1] = held[is_held].T
        after = np.maximum(held[is_held, 0] - times[:, None], times[:, None] - held[is_held, 1])
        distance = np.maximum(after.min(axis=1), 0.0)
        widths = np.minimum(smoothing, distance / _PLACES[-1])
        heights = np.repeat(own, repeats)[:, None]
        values[:, p] = _smoothed(knots, heights, times, interpolation, widths)[:, 0]
    return values


def _smoothed(
    knots: FloatArray,
    heights: FloatArray,
    times: FloatArray,
    interpolation: str,
    widths: FloatArray,
) -> FloatArray:
    through = _interpolant(knots, heights, interpolation)
    if not (widths > 0).any():
        return through(times)
    total = np.zeros((len(times), heights.shape[1]))
    for place, weight in zip(_PLACES, _WEIGHTS, strict=True):
        total += weight * through(times + place * widths)
    return total


def _interpolant(
    knots: FloatArray, heights: FloatArray, interpolation: str
) -> Callable[[FloatArray], FloatArray]:
    """The curve through the knots, `(times,)` → `(times, parameters)`."""
    if len(knots) == 1:
        return lambda times: np.repeat(heights, len(times), axis=0)
    if interpolation == "cubic":
        from scipy.interpolate import PchipInterpolator

        cubic: Any = PchipInterpolator(knots, heights, axis=0)
        return lambda times: np.asarray(cubic(np.clip(times, knots[0], knots[-1])))

    def between(times: FloatArray) -> FloatArray:
        inside = np.clip(times, knots[0], knots[-1])
        before = np.clip(np.searchsorted(knots, inside, side="right") - 1, 0, len(knots) - 2)
        share = (inside - knots[before]) / (knots[before + 1] - knots[before])
        if interpolation == "cosine":
            share = 0.5 - 0.5 * np.cos(np.pi * share)
        steps = heights[before + 1] - heights[before]
        found: FloatArray = heights[before] + share[:, None] * steps
        return found

    return between


def smoothing_reach(smoothing: float) -> float:
    """How far from a moment smoothing looks, seconds."""
    return float(_PLACES[-1]) * smoothing
