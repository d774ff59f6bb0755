"""Where the sound begins, without pulses: an estimate by opening lips and louder speech."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from mocap_fit.errors import DataError
from mocap_fit.sound.energy import energy_db
from mocap_fit.sound.wav import Sound
from mocap_fit.tracks import FloatArray

LARGEST_OFFSET = 0.5
"""Seconds: how far the start time is looked for."""

_STEP = 0.005
# Decibels below the loudest: what is quieter is noise of the room, and counts as silence.
_DEPTH = 40.0
# Hertz: the part of the sound that is loud when the mouth is open.
_BAND = (300.0, 3000.0)
# Hertz: slower changes are the sentence's, and pull the estimate about by tenths of a second.
_SLOWEST = 3.0
# Part of the frames, and seconds of them, that must lie in the sound.
_SHARE, _SHORTEST, _FEWEST = 0.6, 0.5, 10
_WEAKEST = 0.25


@dataclass(frozen=True)
class OffsetEstimate:
    """An estimated start time: no measurement, and no better than some hundredths of a second.

    Parameters
    ----------
    start_time
        Seconds: the first frame on the clock of the sound.
    correlation
        Of lip opening and energy at that start time.
    half_width
        Seconds on either side within which the correlation loses a tenth of itself: how sharp
        the peak is.
    """

    start_time: float
    correlation: float
    half_width: float

    @property
    def is_estimate(self) -> bool:
        """True: who reads it knows that no pulses were there."""
        return True


def estimate_offset(
    opening: ArrayLike,
    rate: float,
    sound: Sound,
    *,
    about: float = 0.0,
    largest: float = LARGEST_OFFSET,
) -> OffsetEstimate:
    """Estimate when the first frame was, from lip opening and the energy of the sound.

    Parameters
    ----------
    opening
        `(frames,)`: the distance of the lips, in any unit; NaN is missing.
    rate
        Frames a second.
    sound
        Speech alone, without a channel of pulses.
    about
        Seconds: where the start is looked for.
    largest
        Seconds on either side of that.

    Returns
    -------
    OffsetEstimate
        The start time of the largest correlation.

    Raises
    ------
    DataError
        If lips or sound do not move, too little of them overlaps, the correlation is weak, or
        it is largest at the end of what was searched.

    Notes
    -----
    Of the sentences of grid_s1 (3 s, 25 frames/s), eight in ten are estimated within 50 ms of
    each other; single ones are a syllable off. Lips open some 15 ms before the voice is loud, and
    the estimate is early by that.
    """
    distance = np.asarray(opening, dtype=np.float64)
    if distance.ndim != 1 or not np.isfinite(rate) or rate <= 0 or largest <= 0:
        raise DataError(
            "the opening of the lips cannot be used",
            found=f"{distance.shape} at {rate} Hz",
            expected="(frames,) at a rate above 0",
        )
    lags = about + _STEP * np.arange(-round(largest / _STEP), round(largest / _STEP) + 1)
    times = np.arange(len(distance)) / rate
    seen = np.isfinite(distance)
    too_little = DataError(
        "recording and sound overlap too little to estimate their offset",
        found=f"{len(distance) / rate:.3f} s of movement, {sound.duration:.3f} s of sound",
        expected=f"{_SHORTEST} s, and {_SHARE:.0%} of the frames",
    )
    if min(seen.sum() / rate, sound.duration) < _SHORTEST or seen.sum() < _FEWEST:
        raise too_little
    grid = np.arange(0.0, sound.duration, _STEP)
    energy = energy_db(_speech_band(sound), grid, window=0.04)
    energy = np.maximum(energy, energy.max() - _DEPTH)
    if np.ptp(energy) < 1.0 or not np.ptp(distance[seen]) > 0:
        raise DataError(
            "the offset of the sound cannot be estimated",
            found="lips or sound that do not change",
            expected="speech",
        )
    energy = _quick_part(energy, 1.0 / _STEP)
    whole = np.interp(times, times[seen], distance[seen])
    distance = np.where(seen, _quick_part(whole, rate), np.nan)
    found = np.array([_correlation(distance, times + lag, grid, energy, rate) for lag in lags])
    if np.isnan(found).all():
        raise too_little
    best = int(np.nanargmax(found))
    peak = float(found[best])
    if peak < _WEAKEST or best in (0, len(lags) - 1):
        raise DataError(
            "the offset of the sound cannot be estimated",
            found=f"a correlation of {peak:.2f} of lip opening and energy, at {lags[best]:.3f} s",
            expected=f"one above {_WEAKEST}, within {lags[1]:.3f} s to {lags[-2]:.3f} s",
            advice="Check that sound and recording belong together, or give the start time.",
        )
    before, after = found[best - 1], found[best + 1]
    bend = before - 2 * peak + after
    shift = 0.5 * (before - after) / bend if np.isfinite(bend) and bend < 0 else 0.0
    near = np.nan_to_num(found, nan=-1.0) >= 0.9 * peak
    left = best - int(np.argmin(near[best::-1])) + 1
    right = best + int(np.argmin(near[best:])) - 1
    return OffsetEstimate(
        float(lags[best] + shift * _STEP), peak, 0.5 * float(max(right - left, 1)) * _STEP
    )


def _speech_band(sound: Sound) -> Sound:
    from scipy.signal import butter, sosfiltfilt

    low, high = _BAND
    if 0.45 * sound.rate < 2 * low:
        return sound
    band = butter(2, (low, min(high, 0.45 * sound.rate)), "bandpass", fs=sound.rate, output="sos")
    return sound.replace(samples=sosfiltfilt(band, sound.samples.mean(axis=1)))


def _quick_part(values: FloatArray, rate: float) -> FloatArray:
    """Without what changes slowly."""
    from scipy.signal import butter, sosfiltfilt

    if rate <= 2.5 * _SLOWEST:
        level: FloatArray = values - values.mean()
        return level
    quick: FloatArray = sosfiltfilt(
        butter(1, _SLOWEST, "highpass", fs=rate, output="sos"),
        values,
        padlen=min(9, len(values) - 1),
    )
    return quick


def _correlation(
    distance: FloatArray, times: FloatArray, grid: FloatArray, energy: FloatArray, rate: float
) -> float:
    heard = np.interp(times, grid, energy, left=np.nan, right=np.nan)
    both = np.isfinite(heard) & np.isfinite(distance)
    if both.sum() < max(3, _SHORTEST * rate, _SHARE * len(distance)):
        return float("nan")
    one, other = distance[both], heard[both]
    one, other = one - one.mean(), other - other.mean()
    size = float(np.sqrt((one @ one) * (other @ other)))
    return float(one @ other) / size if size > 0 else float("nan")
