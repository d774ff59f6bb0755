"""Energy of sound over time, in decibels."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from mocap_fit.errors import DataError
from mocap_fit.sound.sound import Sound
from mocap_fit.tracks import FloatArray

WINDOW = 0.025
"""Seconds: long enough for two periods of a low voice, shorter than most phones."""

MIN_ENERGY = -100.0
"""Decibels: the energy of digital silence, so that no energy is infinite."""


def energy_db(sound: Sound, times: ArrayLike, *, window: float = WINDOW) -> FloatArray:
    """Compute the energy of sound at times, such as those of frames or the centres of phones.

    Parameters
    ----------
    sound
        One or more channels, whose mean is taken; drop a channel of pulses before
        (`Sound.drop_channel`).
    times
        Times from the first sample, ``(times,)``, seconds.
    window
        Length of the Hann window around each time, seconds.

    Returns
    -------
    ndarray
        Ten times the logarithm of the weighted mean square, ``(times,)``, dB: a sine of full
        scale has -3 dB. Not below `MIN_ENERGY`; NaN where the time is outside the sound. Near the
        ends of the sound the part of the window that is inside counts.

    Raises
    ------
    DataError
        If the window is not longer than two samples.
    """
    rate = sound.rate
    half = round(0.5 * window * rate)
    if not half >= 1:
        raise DataError(
            "the window is too short to measure energy in",
            found=f"{window} s at {rate:g} Hz",
            expected="more than two samples",
        )
    weights = np.hanning(2 * half + 3)[1:-1]
    moments = np.asarray(times, dtype=np.float64)
    inside = (moments >= 0) & (moments <= sound.duration) & (len(sound) > 0)
    centres = np.round(np.where(inside, moments, 0.0) * rate).astype(np.int64)
    centres = np.minimum(centres, len(sound) - 1)
    samples = sound.samples.mean(axis=1)
    energies = np.full(moments.shape, np.nan)
    for index in np.flatnonzero(inside):
        first, end = centres[index] - half, centres[index] + half + 1
        part = samples[max(first, 0) : end]
        weight = weights[max(-first, 0) : max(-first, 0) + len(part)]
        mean_square = float(weight @ part**2 / weight.sum())
        energies[index] = 10 * np.log10(max(mean_square, 10 ** (MIN_ENERGY / 10)))
    return energies
