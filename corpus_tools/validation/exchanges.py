"""Markers that have exchanged their names: found where they jump onto each other's track."""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from mocap_fit.tracks import FloatArray


@dataclass(frozen=True)
class Exchange:
    """Markers that carry each other's names for a while.

    Parameters
    ----------
    markers
        Two, or a ring of more.
    first, last
        Frames.
    """

    markers: tuple[int, ...]
    first: int
    last: int


def find_previous(positions: FloatArray, reach: int) -> tuple[FloatArray, NDArray[np.int64]]:
    """Find the last sample of each marker before each frame, and how many frames ago that is.

    Parameters
    ----------
    positions
        Positions, ``(frames, markers, 3)``, millimetres; NaN is missing.
    reach
        Frames after which a sample is too old and counts as missing.

    Returns
    -------
    before
        The last samples, ``(frames, markers, 3)``, millimetres.
    ago
        Their age in frames, ``(frames, markers)``, 1 or more; 1 where there is none.
    """
    frames, markers = positions.shape[:2]
    seen = ~np.isnan(positions[:, :, 0])
    numbers = np.where(seen, np.arange(frames)[:, None], -1)
    last = np.maximum.accumulate(numbers, axis=0)
    last = np.concatenate([np.full((1, markers), -1), last[:-1]])
    ago = np.arange(frames)[:, None] - last
    there = (last >= 0) & (ago <= reach)
    before = positions[np.maximum(last, 0), np.arange(markers)[None, :]]
    before = np.where(there[:, :, None], before, np.nan)
    return before, np.where(there, ago, 1).astype(np.int64)


def find_exchanges(
    positions: FloatArray, rate: float, limits: SimpleNamespace
) -> tuple[list[Exchange], FloatArray]:
    """Find exchanged names, and give the positions with the names exchanged back.

    At the frame where two markers exchange their names both jump, each onto the other's track.
    Jumps that a permutation of names explains are found by the best assignment of the frame's
    samples to the samples before.

    Parameters
    ----------
    positions
        Positions without head motion, ``(frames, markers, 3)``, millimetres.
    rate
        Frame rate, hertz.
    limits
        The thresholds ``markers``.

    Returns
    -------
    exchanges
        The exchanges, by their first frames. Of one that does not end, the shorter side is
        taken for wrong.
    corrected
        The positions with the names exchanged back, ``(frames, markers, 3)``, millimetres.
    """
    frames, markers = positions.shape[:2]
    if frames < 2:
        return [], positions
    before, ago = find_previous(positions, max(1, round(limits.gap_bridged * rate)))
    steps = np.linalg.norm(positions - before, axis=2)
    usual = np.zeros(markers)
    some = ~np.isnan(steps).all(axis=0)
    usual[some] = np.nanmedian(steps[:, some], axis=0)
    with np.errstate(invalid="ignore"):
        far = steps > np.maximum(limits.swap_distance, limits.swap_factor * usual * np.sqrt(ago))
    # owner[m]: whose track carries the name m now.
    owner = np.arange(markers)
    owners = np.empty((frames, markers), dtype=np.intp)
    turns = set(np.flatnonzero(far.sum(axis=1) >= 2).tolist())
    for frame in range(frames):
        if frame in turns:
            jumping = np.flatnonzero(far[frame])
            for ring in _find_rings(
                positions[frame, jumping], before[frame, jumping], limits.swap_gain
            ):
                members = jumping[list(ring)]
                # The name members[k] has jumped onto the track that members[k + 1] had.
                owner = owner.copy()
                owner[members] = owner[np.roll(members, -1)]
        owners[frame] = owner
    owners = _choose_longer_side(owners)
    exchanges = _collect_exchanges(owners)
    mended = positions
    if exchanges:
        mended = np.empty_like(positions)
        rows = np.arange(frames)[:, None]
        mended[rows, owners] = positions
    return exchanges, mended


def _find_rings(here: FloatArray, before: FloatArray, gain: float) -> list[tuple[int, ...]]:
    """Rings of a permutation that explains the jumps: each member goes where the next one was."""
    apart = np.linalg.norm(here[:, None] - before[None], axis=2)
    _, follows = linear_sum_assignment(apart**2)
    rings = []
    for ring in _find_cycles(follows):
        stay = sum(apart[k, k] for k in ring)
        exchanged = sum(apart[k, follows[k]] for k in ring)
        if exchanged < gain * stay:
            rings.append(ring)
    return rings


def _choose_longer_side(owners: NDArray[np.intp]) -> NDArray[np.intp]:
    """Where names are not given back until the end, the longer side is right."""
    values, counts = np.unique(owners, axis=0, return_counts=True)
    commonest = values[int(np.argmax(counts))]
    if np.array_equal(commonest, np.arange(len(commonest))) or 2 * counts.max() <= len(owners):
        return owners
    # Tracks are called by the names that they carry most of the time.
    return np.asarray(np.argsort(commonest)[owners])


def _collect_exchanges(owners: NDArray[np.intp]) -> list[Exchange]:
    frames = len(owners)
    exchanges = []
    changes = np.flatnonzero((np.diff(owners, axis=0) != 0).any(axis=1)) + 1
    open_rings: dict[tuple[int, ...], int] = {}
    for start in [0, *changes.tolist(), frames]:
        rings = [] if start == frames else _find_cycles(owners[start])
        for ring in [ring for ring in open_rings if ring not in rings]:
            exchanges.append(Exchange(ring, open_rings.pop(ring), start - 1))
        for ring in rings:
            open_rings.setdefault(ring, start)
    return sorted(exchanges, key=lambda exchange: (exchange.first, exchange.markers))


def _find_cycles(follows: NDArray[np.intp]) -> list[tuple[int, ...]]:
    """Return the cycles of a permutation, without its fixed points."""
    cycles = []
    left = set(np.flatnonzero(follows != np.arange(len(follows))).tolist())
    while left:
        cycle = [min(left)]
        while int(follows[cycle[-1]]) != cycle[0]:
            cycle.append(int(follows[cycle[-1]]))
        left -= set(cycle)
        cycles.append(tuple(cycle))
    return cycles
