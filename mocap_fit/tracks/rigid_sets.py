"""Sets of markers that keep their distances: their shape, and finding one."""

from __future__ import annotations

from itertools import combinations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mocap_fit.errors import DataError
from mocap_fit.tracks.arrays import FloatArray
from mocap_fit.tracks.rigid import (
    apply_inverse_transforms,
    compute_spread,
    estimate_rigid_transforms,
    is_collinear,
)
from mocap_fit.tracks.types import MarkerTracks

# Frames that are used, at most: for the shape of a rigid set, and for one with missing markers.
_SAMPLE, _PARTIAL_SAMPLE = 1000, 400
# How often the frames are laid on the shape so far.
_ROUNDS, _PARTIAL_ROUNDS = 5, 4
# Markers whose triples are all tried.
_MOST_MARKERS = 40
# Triples that are grown to sets.
_TRIPLES = 50
# Of the root mean square change of distances within a set: others below it are as rigid.
_AS_RIGID = 1.5


def compute_median(points: FloatArray) -> FloatArray:
    """Return the median over the first axis, without missing values.

    Parameters
    ----------
    points
        ``(frames, ...)``, millimetres; NaN is missing.

    Returns
    -------
    ndarray
        ``(...)``, millimetres; NaN where no frame has a value.
    """
    flat: FloatArray = points.reshape(len(points), -1)
    result = np.full(flat.shape[1], np.nan)
    seen = ~np.isnan(flat).all(axis=0)
    result[seen] = np.nanmedian(flat[:, seen], axis=0)
    return np.asarray(result.reshape(points.shape[1:]))


def _refine_shape(shape: FloatArray, frames: FloatArray, rounds: int) -> FloatArray:
    """Return the median of the frames, each laid on the shape so far."""
    for _ in range(rounds):
        rotations, translations, residuals = estimate_rigid_transforms(shape, frames)
        if np.isnan(residuals).all():
            break
        shape = compute_median(apply_inverse_transforms(frames, rotations, translations))
    return shape


def compute_mean_shape(positions: ArrayLike) -> FloatArray:
    """Return the shape of a rigid set: the median of the frames that show all of it.

    Parameters
    ----------
    positions
        ``(frames, points, 3)``, millimetres.

    Returns
    -------
    ndarray
        Where the first complete frame has it, ``(points, 3)``, millimetres; the median keeps
        single outliers out.

    Raises
    ------
    DataError
        If no frame shows all points.
    """
    array = np.asarray(positions, dtype=np.float64)
    complete = array[~np.isnan(array).any(axis=(1, 2))]
    if not len(complete):
        raise DataError(
            "no frame shows all markers of the rigid set",
            advice="Leave out the markers that are seldom seen.",
        )
    complete = complete[:: max(1, len(complete) // _SAMPLE)]
    shape = _refine_shape(complete[0], complete, _ROUNDS)
    rotations, translations, residuals = estimate_rigid_transforms(shape, complete[:1])
    if np.isnan(residuals[0]):
        return shape
    return np.asarray(shape @ rotations[0].T + translations[0])


def compute_typical_shape(positions: FloatArray) -> FloatArray:
    """Return the median shape of markers of which some may be missing in every frame.

    Parameters
    ----------
    positions
        ``(frames, markers, 3)``, millimetres; one frame or more.

    Returns
    -------
    ndarray
        ``(markers, 3)``, millimetres, at about the pose of the frame that shows most markers; NaN
        for markers that are never seen.
    """
    sample = positions[:: max(1, len(positions) // _PARTIAL_SAMPLE)]
    counts = (~np.isnan(sample[:, :, 0])).sum(axis=1)
    return _refine_shape(sample[int(np.argmax(counts))], sample, _PARTIAL_ROUNDS)


def find_reference_markers(recording: MarkerTracks, count: int | None = None) -> tuple[str, ...]:
    """Find the markers that move least relative to each other.

    Of every pair of markers, the robust spread of their distance over time is taken. The set
    with the smallest root mean square of these is sought, wide sets before narrow ones, because
    two neighbours on a cheek keep their distance too. The best triples are grown marker by marker.

    Parameters
    ----------
    recording
        Head and face move in it. Markers that are missing in more than half of the frames are
        not considered.
    count
        How many markers, three or more. Where left out: four, and all the others that are as
        rigid as they.

    Returns
    -------
    tuple of str
        Their names, in the order of the recording.

    Raises
    ------
    DataError
        If there are too few frames or markers, or all the markers lie on a line.
    """
    size = 4 if count is None else count
    if size < 3:
        raise DataError("too few reference markers are asked for", found=size, expected=3)
    if recording.frames < 10:
        raise DataError(
            "reference markers cannot be found in so short a recording",
            found=f"{recording.frames} frames",
            expected="10 or more",
            advice="Name the reference markers.",
        )
    often = np.flatnonzero(recording.visible.mean(axis=0) >= 0.5)
    if len(often) < max(3, 0 if count is None else count):
        raise DataError(
            "too few markers are seen often enough to be reference markers",
            found=", ".join(recording.names[k] for k in often) or "none",
            expected=f"{max(size, 3)} that are seen in half of the frames",
        )
    positions = recording.positions[:: max(1, recording.frames // _SAMPLE), often]
    candidates = _Candidates(positions)
    chosen = candidates.find_set(min(size, len(often)))
    if count is None:
        chosen = candidates.add_as_rigid(chosen)
    return tuple(recording.names[k] for k in sorted(often[chosen]))


class _Candidates:
    """Markers that may be reference markers, and how much their distances change."""

    def __init__(self, positions: FloatArray) -> None:
        self.changes = _measure_distance_changes(positions)
        self.shape = _average_shape(positions)
        self.reach = float(compute_spread(self.shape)[1])

    def cost(self, sets: NDArray[np.intp]) -> FloatArray:
        """Return the cost of sets of equal size, ``(sets, size)``."""
        first, second = np.triu_indices(sets.shape[1], 1)
        change = np.sqrt(np.mean(self.changes[sets[:, first], sets[:, second]] ** 2, axis=1))
        lengths = compute_spread(self.shape[sets])
        narrow = np.maximum(1.0, 0.5 * self.reach / np.maximum(lengths[:, 1], 1e-9))
        return np.where(is_collinear(lengths), np.inf, change * narrow)

    def find_set(self, size: int) -> NDArray[np.intp]:
        """Return the best set: that of the best triples which is best when grown to its size."""
        count = len(self.changes)
        members = np.arange(count)
        if count > _MOST_MARKERS:
            # The triples of a hundred markers are too many; the restless ones are out first.
            calm = np.argsort(np.sort(self.changes, axis=1)[:, : count // 4].mean(axis=1))
            members = np.sort(calm[:_MOST_MARKERS])
        triples = members[np.array(list(combinations(range(len(members)), 3)), dtype=np.intp)]
        costs = self.cost(triples)
        best = np.argsort(costs, kind="stable")[:_TRIPLES]
        if not np.isfinite(costs[best[0]]):
            raise DataError(
                "no three markers can be reference markers",
                found="those that are seen together lie on a line",
                expected="markers that span a plane",
            )
        grown = [self._grow_set(triple, size) for triple in triples[best]]
        return min(grown, key=lambda chosen: float(self.cost(chosen[None])[0]))

    def _grow_set(self, chosen: NDArray[np.intp], size: int) -> NDArray[np.intp]:
        while len(chosen) < size:
            rest = np.setdiff1d(np.arange(len(self.changes)), chosen)
            sets = np.column_stack([np.tile(chosen, (len(rest), 1)), rest])
            chosen = sets[np.argmin(self.cost(sets))]
        return chosen

    def add_as_rigid(self, chosen: NDArray[np.intp]) -> NDArray[np.intp]:
        """Return a set with all other markers that are about as rigid as its own."""
        inside = self.changes[np.ix_(chosen, chosen)][np.triu_indices(len(chosen), 1)]
        limit = _AS_RIGID * float(np.sqrt(np.mean(inside**2)))
        to_set = np.sqrt(np.mean(self.changes[:, chosen] ** 2, axis=1))
        return np.union1d(chosen, np.flatnonzero(to_set <= limit))


def _measure_distance_changes(positions: FloatArray) -> FloatArray:
    """Return the robust spread of all distances over time, ``(markers, markers)``."""
    markers = positions.shape[1]
    changes = np.zeros((markers, markers))
    for k in range(markers - 1):
        distances = np.linalg.norm(positions[:, k + 1 :] - positions[:, k : k + 1], axis=2)
        usable = (~np.isnan(distances)).sum(axis=0) >= 5
        row = np.full(markers - k - 1, np.inf)
        if usable.any():
            # From the 5th to the 95th percentile, in standard deviations of Gaussian noise.
            low, high = np.nanquantile(distances[:, usable], (0.05, 0.95), axis=0)
            row[usable] = (high - low) / 3.29
        changes[k, k + 1 :] = changes[k + 1 :, k] = row
    return changes


def _average_shape(positions: FloatArray) -> FloatArray:
    """Return the frame that shows most, with the other markers at their mean offset from it."""
    frame = int(np.argmax((~np.isnan(positions[:, :, 0])).sum(axis=1)))
    shape: FloatArray = positions[frame].copy()
    missing = np.isnan(shape).any(axis=1)
    if missing.any():
        centre = np.nanmean(positions - np.nanmean(positions, axis=1, keepdims=True), axis=0)
        shape[missing] = centre[missing] + np.nanmean(shape, axis=0)
    return shape
