"""Sets of markers that keep their distances: finding one, and its mean shape."""

from __future__ import annotations

from itertools import combinations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mocap_fit.errors import DataError
from mocap_fit.tracks.rigid import is_collinear, rigid_transforms, spread
from mocap_fit.tracks.types import FloatArray, MarkerTracks

# Frames that are looked at.
_SAMPLE = 1000


def mean_shape(positions: ArrayLike, *, rounds: int = 5) -> FloatArray:
    """Shape of a rigid set: the median of the frames that show all of it, laid on each other.

    Parameters
    ----------
    positions
        `(frames, points, 3)`, millimetres.
    rounds
        How often the frames are laid on the shape found so far.

    Returns
    -------
    FloatArray
        `(points, 3)`, where the first whole frame has it; the median keeps single wild frames
        out.

    Raises
    ------
    DataError
        If no frame shows all points.
    """
    array = np.asarray(positions, dtype=np.float64)
    whole = array[~np.isnan(array).any(axis=(1, 2))]
    if not len(whole):
        raise DataError(
            "no frame shows all markers of the rigid set",
            advice="Leave out the markers that are seldom seen.",
        )
    whole = whole[:: max(1, len(whole) // _SAMPLE)]
    first = whole[0]
    shape = first
    for _ in range(rounds):
        rotations, translations, residuals = rigid_transforms(shape, whole)
        if np.isnan(residuals).all():
            break
        back = np.einsum("fji,fpj->fpi", rotations, whole - translations[:, None, :])
        shape = np.nanmedian(back, axis=0)
    rotations, translations, residuals = rigid_transforms(shape, first[None])
    if np.isnan(residuals[0]):
        return np.asarray(shape)
    return np.asarray(shape @ rotations[0].T + translations[0])


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
        How many markers, three or more. When not given: four, and all the others that are as
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
    wanted = 4 if count is None else count
    if wanted < 3:
        raise DataError("too few reference markers are asked for", found=wanted, expected=3)
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
            expected=f"{max(wanted, 3)} that are seen in half of the frames",
        )
    positions = recording.positions[:: max(1, recording.frames // _SAMPLE), often]
    changes, middle = _distance_changes(positions)
    reach = float(spread(middle)[1])

    def cost(sets: NDArray[np.intp]) -> FloatArray:
        """Of sets of equal size, `(sets, size)`."""
        first, second = np.triu_indices(sets.shape[1], 1)
        change = np.sqrt(np.mean(changes[sets[:, first], sets[:, second]] ** 2, axis=1))
        lengths = spread(middle[sets])
        narrow = np.maximum(1.0, 0.5 * reach / np.maximum(lengths[:, 1], 1e-9))
        return np.where(is_collinear(lengths), np.inf, change * narrow)

    members = np.arange(len(often))
    if len(members) > 40:
        # The triples of a hundred markers are too many; the restless ones are out first.
        calm = np.argsort(np.sort(changes, axis=1)[:, : len(members) // 4].mean(axis=1))
        members = np.sort(calm[:40])
    triples = members[np.array(list(combinations(range(len(members)), 3)), dtype=np.intp)]
    costs = cost(triples)
    best = np.argsort(costs, kind="stable")[:50]
    if not np.isfinite(costs[best[0]]):
        raise DataError(
            "no three markers can be reference markers",
            found="all markers lie on a line",
            expected="markers that span a plane",
        )
    grown: list[tuple[float, NDArray[np.intp]]] = []
    for chosen in triples[best]:
        while len(chosen) < min(wanted, len(often)):
            rest = np.setdiff1d(np.arange(len(often)), chosen)
            sets = np.column_stack([np.tile(chosen, (len(rest), 1)), rest])
            chosen = sets[np.argmin(cost(sets))]
        grown.append((float(cost(chosen[None])[0]), chosen))
    chosen = min(grown, key=lambda item: item[0])[1]
    if count is None:
        inside = changes[np.ix_(chosen, chosen)][np.triu_indices(len(chosen), 1)]
        limit = 1.5 * float(np.sqrt(np.mean(inside**2)))
        to_set = np.sqrt(np.mean(changes[:, chosen] ** 2, axis=1))
        chosen = np.union1d(chosen, np.flatnonzero(to_set <= limit))
    return tuple(recording.names[k] for k in sorted(often[chosen]))


def _distance_changes(positions: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Robust spread of all distances, `(markers, markers)`, and a typical shape `(markers, 3)`."""
    markers = positions.shape[1]
    changes = np.zeros((markers, markers))
    for k in range(markers - 1):
        distances = np.linalg.norm(positions[:, k + 1 :] - positions[:, k : k + 1], axis=2)
        there = ~np.isnan(distances)
        usable = there.sum(axis=0) >= 5
        row = np.full(markers - k - 1, np.inf)
        # From the 5th to the 95th part of a hundred, in standard deviations of Gaussian noise.
        low, high = np.nanquantile(distances[:, usable], (0.05, 0.95), axis=0)
        row[usable] = (high - low) / 3.29
        changes[k, k + 1 :] = changes[k + 1 :, k] = row
    # The frame that shows most, with the others' markers laid on it by their mean offset.
    frame = int(np.argmax((~np.isnan(positions[:, :, 0])).sum(axis=1)))
    middle = positions[frame].copy()
    gone = np.isnan(middle).any(axis=1)
    if gone.any():
        centre = np.nanmean(positions - np.nanmean(positions, axis=1, keepdims=True), axis=0)
        middle[gone] = centre[gone] + np.nanmean(middle, axis=0)
    return changes, middle
