"""Curves over time through targets at the centres of segments (Krňoul & Železný section 5.1)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from mocap_fit.control.cart.closures import Closure
from mocap_fit.tracks import FloatArray

# The Gaussian that smooths: its nodes in standard deviations, and its weights.
_NODES = np.linspace(-2.4, 2.4, 17)
_WEIGHTS = np.exp(-0.5 * _NODES**2) / np.exp(-0.5 * _NODES**2).sum()


def interpolate(
    centres: FloatArray,
    targets: FloatArray,
    times: FloatArray,
    *,
    interpolation: str = "cubic",
    smoothing: float = 0.0,
    closures: Mapping[int, Closure] | None = None,
    held: FloatArray | None = None,
) -> FloatArray:
    """Interpolate between targets.

    Parameters
    ----------
    centres
        Times of the targets, ``(segments,)``, seconds, ascending.
    targets
        ``(segments, parameters)``, in the unit of each parameter.
    times
        ``(times,)``, seconds, in any order.
    interpolation
        ``cubic``: piecewise cubic, monotone between two targets (Fritsch and Butland 1984, as in
        `scipy.interpolate.PchipInterpolator`); ``linear``; ``cosine``: half a period of a cosine
        from target to target. Before the first target and after the last the curve is constant.
    smoothing
        Standard deviation of the Gaussian that the curve is smoothed with, seconds; 0 for none.
    closures
        Guaranteed closures, by index of the parameter.
    held
        Start and end of the time for which each segment is held closed, ``(segments, 2)``,
        seconds; NaN for the others. Smoothing is narrower near these times and absent in them.

    Returns
    -------
    ndarray
        ``(times, parameters)``, in the unit of each parameter. In the times that are held, a
        parameter with a closure is not more open than it.
    """
    values = np.empty((len(times), targets.shape[1]))
    closed = {} if closures is None else dict(closures)
    is_held = np.zeros(len(centres), bool) if held is None else np.isfinite(held).all(axis=1)
    if not is_held.any():
        closed = {}
    free = [p for p in range(targets.shape[1]) if p not in closed]
    values[:, free] = _smooth(
        centres, targets[:, free], times, interpolation, np.full(len(times), smoothing)
    )
    for p, closure in closed.items():
        assert held is not None
        closed_targets = targets[:, p].copy()
        closed_targets[is_held] = closure.clip(closed_targets[is_held])
        # A held segment has the same target twice: the curve between the two is flat.
        repeats = np.where(is_held, 2, 1)
        knots = np.repeat(centres, repeats)
        starts = np.cumsum(repeats) - repeats
        knots[starts[is_held]], knots[starts[is_held] + 1] = held[is_held].T
        after = np.maximum(held[is_held, 0] - times[:, None], times[:, None] - held[is_held, 1])
        distance = np.maximum(after.min(axis=1), 0.0)
        widths = np.minimum(smoothing, distance / _NODES[-1])
        heights = np.repeat(closed_targets, repeats)[:, None]
        values[:, p] = _smooth(knots, heights, times, interpolation, widths)[:, 0]
    return values


def _smooth(
    knots: FloatArray,
    heights: FloatArray,
    times: FloatArray,
    interpolation: str,
    widths: FloatArray,
) -> FloatArray:
    """Interpolate and smooth, with a width for each time."""
    through = _make_interpolant(knots, heights, interpolation)
    if not (widths > 0).any():
        return through(times)
    total = np.zeros((len(times), heights.shape[1]))
    for node, weight in zip(_NODES, _WEIGHTS, strict=True):
        total += weight * through(times + node * widths)
    return total


def _make_interpolant(
    knots: FloatArray, heights: FloatArray, interpolation: str
) -> Callable[[FloatArray], FloatArray]:
    """Make the curve through the knots, a function of times."""
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
        result: FloatArray = heights[before] + share[:, None] * steps
        return result

    return between


def get_smoothing_reach(smoothing: float) -> float:
    """Return how far from a moment smoothing looks.

    Parameters
    ----------
    smoothing
        Standard deviation of the Gaussian, seconds.

    Returns
    -------
    float
        Seconds.
    """
    return float(_NODES[-1]) * smoothing
