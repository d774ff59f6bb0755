"""Head markers that slip: their distances to the others change, whatever the head does."""

from __future__ import annotations

from itertools import combinations

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from corpus_tools.validation.thresholds import Section
from mocap_fit.tracks import FloatArray
from mocap_fit.tracks.gaps import runs

# The fewest frames whose median is calm.
_FRAMES = 8
# What remains of the changes without the marker that has slipped.
_REST = 0.35


def find_slips(
    positions: FloatArray, rate: float, limits: Section
) -> list[tuple[int, slice, float]]:
    """Find markers of a rigid set that sit elsewhere for a while.

    The distances between all pairs are compared with those of the recording's most usual moment,
    by medians over short stretches. Where the changes are those of one marker's pairs alone, it
    has slipped.

    Parameters
    ----------
    positions
        `(frames, markers, 3)` of four markers or more; NaN is missing.
    rate
        Hertz.
    limits
        The thresholds ``shape``.

    Returns
    -------
    list
        Marker, frames, and by how much its distances change, millimetres. Where a recording begins
        in one way and ends in another, the end counts as slipped.
    """
    frames, markers = positions.shape[:2]
    window = max(_FRAMES, round(limits.slip_time * rate))
    if markers < 4 or frames < 2 * window:
        return []
    pairs = list(combinations(range(markers), 2))
    one, other = np.array(pairs).T
    distances = np.linalg.norm(positions[:, one] - positions[:, other], axis=2)
    step = max(1, window // 4)
    starts = np.arange(0, frames - window + 1, step)
    views = sliding_window_view(distances, window, axis=0)[starts]
    counts = (~np.isnan(views)).sum(axis=2)
    enough = counts >= window // 3
    # Sorting puts what is missing last.
    halves = np.maximum(counts - 1, 0)[:, :, None] // 2
    middles = np.take_along_axis(np.sort(views, axis=2), halves, axis=2)[:, :, 0]
    middles = np.where(enough, middles, np.nan)
    changes = _from_the_usual(middles)
    size = np.nan_to_num(np.abs(changes))
    scatter = 1.4826 * float(np.median(size[enough])) if enough.any() else 0.0
    limit = max(limits.slip_distance, limits.slip_factor * scatter)
    own = np.array([[k in pair for pair in pairs] for k in range(markers)])
    rest = np.array([np.sqrt((size[:, ~mine] ** 2).mean(axis=1)) for mine in own])
    culprits = np.argmin(rest, axis=0)
    rows = np.arange(len(starts))
    largest = np.array([size[row, own[k]].max() for row, k in zip(rows, culprits, strict=True)])
    slipped = (largest > limit) & (rest[culprits, rows] < _REST * largest)
    found = []
    for k in range(markers):
        mine = np.asarray(slipped & (culprits == k))
        if not mine.any():
            continue
        # Stretches that do not show it say nothing, and do not end it.
        shown = np.flatnonzero(enough[:, own[k]].sum(axis=1) >= 2)
        for run in runs(mine[shown]):
            part = shown[run]
            first = int(starts[part[0]]) + window // 2
            last = int(starts[part[-1]]) + window // 2 + step
            first = 0 if part[0] == shown[0] else first
            last = frames if part[-1] == shown[-1] else last
            if first == 0 and last < frames:
                first, last = last, frames
            if last - first >= limits.slip_time * rate:
                found.append((k, slice(first, last), float(largest[part].max())))
    return found


def _from_the_usual(middles: FloatArray) -> FloatArray:
    """Differences from the moment that is nearest to most others, `(moments, pairs)`."""
    sample = middles[:: max(1, len(middles) // 200)]
    apart = np.abs(sample[:, None] - sample[None])
    there = ~np.isnan(apart)
    mean = np.where(there, apart, 0.0).sum(axis=2) / np.maximum(there.sum(axis=2), 1)
    # A moment that shows few of the pairs is no measure for others.
    mean += np.where(there.sum(axis=2) < 0.5 * middles.shape[1], 1e6, 0.0)
    usual = sample[int(np.argmin(np.median(mean, axis=1)))].copy()
    for pair in np.flatnonzero(np.isnan(usual)):
        seen = middles[~np.isnan(middles[:, pair]), pair]
        usual[pair] = np.median(seen) if len(seen) else np.nan
    changes: FloatArray = middles - usual
    return changes
