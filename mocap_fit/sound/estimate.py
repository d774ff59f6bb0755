"""Estimate where the sound begins, without pulses, from opening lips and louder speech."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from mocap_fit.errors import DataError
from mocap_fit.sound.energy import energy_db
from mocap_fit.sound.sound import Sound
from mocap_fit.tracks import FloatArray

MAX_OFFSET = 0.5
"""Seconds: how far the start time is searched."""

# Seconds: the step of the search, and of the energies that are compared.
_STEP = 0.005
_WINDOW = 0.04
# Decibels below the loudest: what is quieter is background noise, and counts as silence.
_DEPTH = 40.0
# Decibels: what varies less is no speech.
_MIN_VARIATION = 1.0
# Hertz: the part of the sound that is loud when the mouth is open.
_BAND = (300.0, 3000.0)
# Hertz: slower changes are the sentence's, and shift the estimate by tenths of a second.
_SLOWEST = 3.0
# Share of the frames, seconds of them, and their number, that must lie in the sound.
_SHARE, _SHORTEST, _FEWEST = 0.6, 0.5, 10
_MIN_CORRELATION = 0.25


@dataclass(frozen=True)
class OffsetEstimate:
    """An estimated start time, accurate to some hundredths of a second at best.

    Parameters
    ----------
    start_time
        Time of the first frame on the clock of the sound, seconds.
    correlation
        Correlation of lip opening and energy at that start time, -1 to 1.
    half_width
        Distance on either side within which the correlation loses a tenth of itself, seconds: how
        sharp its peak is.
    """

    start_time: float
    correlation: float
    half_width: float


def estimate_offset(
    opening: ArrayLike,
    rate: float,
    sound: Sound,
    *,
    start_time: float = 0.0,
    max_offset: float = MAX_OFFSET,
) -> OffsetEstimate:
    """Estimate the time of the first frame from lip opening and the energy of the sound.

    Parameters
    ----------
    opening
        Distance of the lips, ``(frames,)``, in any unit; NaN is missing.
    rate
        Frame rate, hertz.
    sound
        Speech, without a channel of pulses.
    start_time
        Middle of the search, seconds.
    max_offset
        Distance from the middle to the ends of the search, seconds.

    Returns
    -------
    OffsetEstimate
        The start time with the largest correlation.

    Raises
    ------
    DataError
        If lips or sound do not change, too little of them overlaps, the correlation is weak, or
        it is largest at an end of the search.

    Notes
    -----
    Of the sentences of grid_s1 (3 s, 25 frames/s), eight in ten are estimated within 50 ms of
    each other; single ones are a syllable off. Lips open some 15 ms before the voice is loud, and
    the estimate is early by that.
    """
    distance = np.asarray(opening, dtype=np.float64)
    if distance.ndim != 1 or not np.isfinite(rate) or rate <= 0 or max_offset <= 0:
        raise DataError(
            "the opening of the lips cannot be used",
            found=f"{distance.shape} at {rate} Hz",
            expected="(frames,) at a rate above 0",
        )
    steps = round(max_offset / _STEP)
    lags = start_time + _STEP * np.arange(-steps, steps + 1)
    times = np.arange(len(distance)) / rate
    visible = np.isfinite(distance)
    too_little = DataError(
        "recording and sound overlap too little to estimate their offset",
        found=f"{len(distance) / rate:.3f} s of movement, {sound.duration:.3f} s of sound",
        expected=f"{_SHORTEST} s, and {_SHARE:.0%} of the frames",
    )
    if sound.duration < _SHORTEST or visible.sum() < _FEWEST:
        raise too_little
    grid = np.arange(0.0, sound.duration, _STEP)
    energy = energy_db(_filter_speech_band(sound), grid, window=_WINDOW)
    energy = np.maximum(energy, energy.max() - _DEPTH)
    if np.ptp(energy) < _MIN_VARIATION or not np.ptp(distance[visible]) > 0:
        raise DataError(
            "the offset of the sound cannot be estimated",
            found="lips or sound that do not change",
            expected="speech",
        )
    energy = _remove_slow_part(energy, 1.0 / _STEP)
    complete = np.interp(times, times[visible], distance[visible])
    distance = np.where(visible, _remove_slow_part(complete, rate), np.nan)
    correlations = np.array([_correlate(distance, times + lag, grid, energy, rate) for lag in lags])
    if np.isnan(correlations).all():
        raise too_little
    best = int(np.nanargmax(correlations))
    peak = float(correlations[best])
    if peak < _MIN_CORRELATION or best in (0, len(lags) - 1):
        raise DataError(
            "the offset of the sound cannot be estimated",
            found=f"a correlation of {peak:.2f} of lip opening and energy, at {lags[best]:.3f} s",
            expected=f"one above {_MIN_CORRELATION}, within {lags[1]:.3f} s to {lags[-2]:.3f} s",
            advice="Check that sound and recording belong together, or give the start time.",
        )
    return OffsetEstimate(
        float(lags[best] + _STEP * _interpolate_peak(*correlations[best - 1 : best + 2])),
        peak,
        0.5 * _STEP * _count_near_peak(correlations, best),
    )


def _count_near_peak(correlations: FloatArray, best: int) -> int:
    """Return the steps around a peak in which it loses a tenth at most, one at least."""
    near = correlations >= 0.9 * correlations[best]
    after, before = near[best:], near[best::-1]
    return max(sum(int(np.logical_and.accumulate(side).sum()) - 1 for side in (before, after)), 1)


def _interpolate_peak(before: float, peak: float, after: float) -> float:
    """Return where the parabola through three values is highest, in steps from the middle one."""
    curvature = before - 2 * peak + after
    return 0.5 * (before - after) / curvature if curvature < 0 else 0.0


def _filter_speech_band(sound: Sound) -> Sound:
    from scipy.signal import butter, sosfiltfilt

    low, high = _BAND
    if 0.45 * sound.rate < 2 * low:
        return sound
    band = butter(2, (low, min(high, 0.45 * sound.rate)), "bandpass", fs=sound.rate, output="sos")
    return sound.replace(samples=sosfiltfilt(band, sound.samples.mean(axis=1)))


def _remove_slow_part(values: FloatArray, rate: float) -> FloatArray:
    from scipy.signal import butter, sosfiltfilt

    if rate <= 2.5 * _SLOWEST:
        centred: FloatArray = values - values.mean()
        return centred
    quick: FloatArray = sosfiltfilt(
        butter(1, _SLOWEST, "highpass", fs=rate, output="sos"),
        values,
        padlen=min(9, len(values) - 1),
    )
    return quick


def _correlate(
    distance: FloatArray, times: FloatArray, grid: FloatArray, energy: FloatArray, rate: float
) -> float:
    """Return the correlation of lip opening and energy where both are known; NaN for too few."""
    energies = np.interp(times, grid, energy, left=np.nan, right=np.nan)
    both = np.isfinite(energies) & np.isfinite(distance)
    if both.sum() < max(_SHORTEST * rate, _SHARE * len(distance)):
        return float("nan")
    one, other = distance[both], energies[both]
    one, other = one - one.mean(), other - other.mean()
    size = float(np.sqrt((one @ one) * (other @ other)))
    return float(one @ other) / size if size > 0 else float("nan")
