"""The blends of Öhman's model (Beskow eqs. 16 and 17): how much every phone counts at a time."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from scipy import sparse

from mocap_fit.control.symbols import BoolArray, IntArray
from mocap_fit.phones import PhoneSequence
from mocap_fit.tracks import FloatArray


class Blends(NamedTuple):
    """How much every phone counts at every frame.

    Parameters
    ----------
    track
        The vowels' shares of the vowel track (eq. 17), ``(frames, phones)``, sparse; a row adds up
        to 1.
    consonants
        The blend k of every consonant (eq. 16), added up over its segments,
        ``(frames, phones)``, sparse.
    """

    track: Any
    consonants: Any


def compute_blends(
    positions: IntArray,
    peaks: FloatArray,
    times: FloatArray,
    are_vowels: BoolArray,
    seen: BoolArray,
) -> Blends:
    """Return the blends of an utterance.

    Parameters
    ----------
    positions
        The phone of each segment, ``(segments,)``.
    peaks
        Start and end of each segment's peak, ``(segments, 2)``, seconds, ascending.
    times
        Times of the frames, ``(frames,)``, seconds.
    are_vowels
        Which phones are vowels, ``(phones,)``.
    seen
        Which phones the corpus had, ``(phones,)``.

    Returns
    -------
    Blends
        In an utterance without a vowel the track is the mean of the vowels that were seen.
    """
    phones = len(are_vowels)
    consonants = _build_matrix(*_blend_neighbours(positions, peaks, times), phones)
    consonants = consonants @ sparse.diags_array((~are_vowels).astype(float), format="csr")
    vowels = np.flatnonzero(are_vowels[positions])
    if len(vowels):
        columns, shares = _blend_neighbours(positions[vowels], peaks[vowels], times)
    else:
        known = np.flatnonzero(are_vowels & seen)
        columns = np.tile(known, (len(times), 1))
        shares = np.full(columns.shape, 1.0 / max(len(known), 1))
    return Blends(_build_matrix(columns, shares, phones), consonants)


def find_peaks(phones: PhoneSequence, hold: float | None) -> FloatArray:
    """Return when each segment is at its peak.

    Parameters
    ----------
    phones
        The segments.
    hold
        Largest distance of a peak from both ends of its segment, seconds; None for the centre
        alone.

    Returns
    -------
    FloatArray
        Start and end of each peak, ``(segments, 2)``, seconds.
    """
    starts, ends = phones.starts, phones.ends
    half = 0.5 * (ends - starts)
    inside = half if hold is None else np.minimum(half, hold)
    return np.stack([starts + inside, np.maximum(ends - inside, starts + inside)], axis=1)


def smoothstep(x: FloatArray) -> FloatArray:
    """Return the cubic that rises from 0 at 0 to 1 at 1 and is level at both.

    Parameters
    ----------
    x
        Values of any shape ``(...)``, 0 to 1.

    Returns
    -------
    FloatArray
        Values of the same shape ``(...)``, 0 to 1.
    """
    return np.asarray(x * x * (3.0 - 2.0 * x))


def _blend_neighbours(
    positions: IntArray, peaks: FloatArray, times: FloatArray
) -> tuple[IntArray, FloatArray]:
    """Return the phones of the peaks around each time, and their blends, ``(frames, 2)`` each."""
    starts, ends = peaks.T
    before = np.clip(np.searchsorted(starts, times, side="right") - 1, 0, len(starts) - 1)
    after = np.minimum(before + 1, len(starts) - 1)
    between = after > before
    distances = np.where(between, starts[after] - ends[before], 1.0)
    share = smoothstep(np.clip((times - ends[before]) / distances, 0.0, 1.0)) * between
    columns = np.stack([positions[before], positions[after]], axis=1)
    return columns, np.stack([1.0 - share, share], axis=1)


def _build_matrix(columns: IntArray, shares: FloatArray, phones: int) -> Any:
    """Return a sparse matrix ``(frames, phones)`` with some shares in each row."""
    frames, width = columns.shape
    rows = np.repeat(np.arange(frames), width)
    return sparse.coo_array(
        (shares.ravel(), (rows, columns.ravel())), shape=(frames, phones)
    ).tocsr()
