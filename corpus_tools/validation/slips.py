"""Head markers that slip: one sits elsewhere for a while, seen from the others."""

from __future__ import annotations

from itertools import combinations
from types import SimpleNamespace

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from mocap_fit.tracks import FloatArray, estimate_rigid_transforms
from mocap_fit.tracks.interpolation import find_runs
from mocap_fit.tracks.rigid import apply_inverse_transforms
from mocap_fit.tracks.rigid_sets import compute_typical_shape

# The fewest frames whose median is calm.
_FRAMES = 8
# How badly the others may still fit, over how far the one is off.
_REST = 0.4
# The part of the recording that tells how quiet a marker can be.
_QUIET = 0.1


def find_slips(
    positions: FloatArray, rate: float, limits: SimpleNamespace
) -> list[tuple[int, slice, float]]:
    """Find markers of a rigid set that sit elsewhere for a while.

    The recording's most usual moment gives the shape. In every frame each marker is seen in the
    pose that the others give; medians over short stretches tell a slip from noise. The culprit is
    the marker without which the others fit best.

    Parameters
    ----------
    positions
        Positions of four markers or more, ``(frames, markers, 3)``, millimetres; NaN is
        missing.
    rate
        Frame rate, hertz.
    limits
        The thresholds ``shape``.

    Returns
    -------
    list
        Marker, frames, and how far it is off, millimetres. Where a recording begins in one way
        and ends in another, the end counts as slipped.
    """
    frames, markers = positions.shape[:2]
    window = max(_FRAMES, round(limits.slip_time * rate))
    if markers < 4 or frames < 2 * window:
        return []
    step = max(1, window // 4)
    starts = np.arange(0, frames - window + 1, step)
    usual = _find_usual_moment(positions, starts, window)
    shape = compute_typical_shape(positions[usual : usual + window])
    if np.isnan(shape).any():
        return []
    off = np.full((markers, len(starts)), np.nan)
    rest = np.full((markers, len(starts)), np.inf)
    for k in range(markers):
        others = np.delete(np.arange(markers), k)
        pose = estimate_rigid_transforms(shape[others], positions[:, others])
        seen = apply_inverse_transforms(positions[:, [k]], pose[0], pose[1])[:, 0] - shape[k]
        off[k] = np.linalg.norm(_compute_medians(seen, starts, window), axis=1)
        fits = _compute_medians(pose[2][:, None], starts, window)[:, 0]
        rest[k] = np.where(np.isnan(fits), np.inf, fits)
    slips = []
    culprits = np.argmin(np.where(np.isnan(off), np.inf, rest), axis=0)
    for k in range(markers):
        # Stretches that do not show it say nothing, and do not end it.
        shown = np.flatnonzero(~np.isnan(off[k]))
        if not len(shown):
            continue
        quiet = float(np.quantile(off[k, shown], _QUIET))
        limit = max(limits.slip_distance, limits.slip_factor * quiet)
        wrong = (culprits == k) & (off[k] > limit) & (rest[k] < _REST * off[k])
        for run in find_runs(np.asarray(wrong[shown])):
            part = shown[run]
            first = 0 if part[0] == shown[0] else int(starts[part[0]]) + window // 2
            last = int(starts[part[-1]]) + window // 2 + step
            last = frames if part[-1] == shown[-1] else last
            if first == 0 and last < frames:
                first, last = last, frames
            if last - first >= limits.slip_time * rate:
                slips.append((k, slice(first, last), float(np.median(off[k, part]))))
    return slips


def _compute_medians(values: FloatArray, starts: NDArray[np.int64], window: int) -> FloatArray:
    """Medians of `(frames, columns)` over stretches; NaN where a third is not there."""
    views = sliding_window_view(values, window, axis=0)[starts]
    counts = (~np.isnan(views)).sum(axis=2)
    # Sorting puts what is missing last.
    halves = np.maximum(counts - 1, 0)[:, :, None] // 2
    middles = np.take_along_axis(np.sort(views, axis=2), halves, axis=2)[:, :, 0]
    return np.where(counts >= max(3, window // 3), middles, np.nan)


def _find_usual_moment(positions: FloatArray, starts: NDArray[np.int64], window: int) -> int:
    """First frame of the stretch whose distances are nearest to those of most others."""
    one, other = np.array(list(combinations(range(positions.shape[1]), 2))).T
    distances = np.linalg.norm(positions[:, one] - positions[:, other], axis=2)
    middles = _compute_medians(distances, starts, window)
    chosen = np.arange(0, len(starts), max(1, len(starts) // 200))
    apart = np.abs(middles[chosen, None] - middles[None, chosen])
    there = ~np.isnan(apart)
    mean = np.where(there, apart, 0.0).sum(axis=2) / np.maximum(there.sum(axis=2), 1)
    # A moment that does not show all of them is no measure for others.
    lacking = np.isnan(middles[chosen]).sum(axis=1)
    return int(starts[chosen[int(np.argmin(np.median(mean, axis=1) + 1e6 * lacking))]])
