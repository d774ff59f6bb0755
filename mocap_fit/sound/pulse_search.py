"""Where in a channel of sound pulses come at a known rate: their period, place, width and sign.

Pulses that repeat have power at multiples of their rate; the sum over these finds the rate even
where noise hides every single pulse. The mean period at that rate shows what a pulse looks like.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mocap_fit.tracks import FloatArray

# Periods: a stretch long enough to find pulses under noise, short enough to be quick.
_STRETCH = 1000
_HARMONICS = 60
# How far the mean pulse must stand out of the noise of the mean period. The best of thousands of
# places and widths in noise alone is below 5.
_CLEAR = 8.0
# A negative pulse must be so much clearer: what a capacitor makes of a pulse is a positive peak
# at its beginning and a negative one, as high, at its end.
_FALLING = 1.25


@dataclass(frozen=True)
class Grid:
    """A first idea of a pulse train.

    Parameters
    ----------
    start
        Sample at which one of the pulses begins.
    period
        Samples from one pulse to the next.
    width
        Samples.
    sign
        1 or -1.
    first, last
        Samples: the stretch of the sound that it was found in.
    """

    start: float
    period: float
    width: int
    sign: int
    first: int
    last: int


def find_grid(channel: FloatArray, period: float, tolerance: float) -> Grid | None:
    """Find pulses of about a known period; None where there are none.

    Parameters
    ----------
    channel
        `(samples,)`.
    period
        Samples from one pulse to the next, as far as it is known.
    tolerance
        By which part of itself the period may differ.
    """
    length = round(_STRETCH * period)
    best: tuple[float, Grid | None] = (_CLEAR, None)
    for first in range(0, len(channel), length):
        part = channel[first : first + length]
        # The last stretch may be too short to show anything.
        if len(part) < 4 * period and first:
            break
        # The first clear stretch may hold a few pulses only, at its end: the next decides.
        is_last = best[0] > 10 * _CLEAR
        clearness, grid = _in_stretch(part, first, period, tolerance)
        if grid is not None and clearness > best[0]:
            best = (clearness, grid)
        if is_last:
            break
    return best[1]


def _in_stretch(
    part: FloatArray, first: int, period: float, tolerance: float
) -> tuple[float, Grid | None]:
    part = part - np.median(part)
    if len(part) < 2 * period or not part.any():
        return 0.0, None
    # A channel without noise is not infinitely clear.
    floor = 1e-3 * float(part.std()) / np.sqrt(len(part) / period)
    guess, step = _by_harmonics(part, period, tolerance)
    best = (0.0, 0.0, 0, 0, 0)
    widths = np.arange(1, max(2, round(period)) // 2 + 1)
    quick = np.unique(np.geomspace(1, len(widths), 40).astype(np.int64))
    found = guess
    # What one step changes over the whole stretch is a part of a period; pulses are narrower.
    for range_, count in ((1.5, 7), (0.5, 9)):
        middle = found
        for frequency in middle + step * np.linspace(-range_, range_, count):
            seen = _pulse_in(_mean_period(part, frequency), floor, quick)
            if seen[0] > best[0]:
                best, found = seen, float(frequency)
    best = _pulse_in(_mean_period(part, found), floor, widths)
    _, clearness, place, width, sign = best
    if not sign:
        return 0.0, None
    exact = 1.0 / found
    in_samples = exact / max(2, round(exact))
    grid = Grid(
        first + place * in_samples,
        exact,
        max(1, round(width * in_samples)),
        sign,
        first,
        first + len(part),
    )
    return clearness, grid


def _by_harmonics(part: FloatArray, period: float, tolerance: float) -> tuple[float, float]:
    """The rate of repetition, in periods a sample, and the step of the search."""
    from scipy.fft import next_fast_len, rfft

    size = next_fast_len(2 * len(part), real=True)
    spectrum = np.abs(rfft(part, size))
    harmonics = np.arange(1, max(2, min(_HARMONICS, int(0.45 * period)) + 1))
    step = 1.0 / (size * len(harmonics))
    count = int(np.ceil(tolerance / period / step))
    frequencies = (1.0 + np.linspace(-tolerance, tolerance, 2 * count + 1)) / period
    bins = np.rint(np.outer(harmonics, frequencies) * size).astype(np.int64)
    heights = spectrum[np.minimum(bins, len(spectrum) - 1)]
    # By its own middle, and in logarithms: mains hum near one multiple must not drown the others.
    middle = np.median(heights, axis=1, keepdims=True)
    scores = np.log1p(heights / np.maximum(middle, 1e-9 * spectrum.max())).sum(axis=0)
    return float(frequencies[int(np.argmax(scores))]), step


def _mean_period(part: FloatArray, frequency: float) -> FloatArray:
    """The mean over all periods, `(bins,)`, a sample a bin."""
    bins = max(2, round(1.0 / frequency))
    phases = (np.arange(len(part)) * frequency) % 1.0
    places = np.minimum((phases * bins).astype(np.int64), bins - 1)
    sums = np.bincount(places, part, bins)
    counts = np.bincount(places, minlength=bins)
    profile: FloatArray = sums / np.maximum(counts, 1)
    return profile


def _pulse_in(
    profile: FloatArray, floor: float, widths: NDArray[np.int64]
) -> tuple[float, float, int, int, int]:
    """The box that explains most of a mean period: height, clearness, place, width, sign."""
    bins = len(profile)
    level = profile - profile.mean()
    sums = np.concatenate(([0.0], np.cumsum(np.concatenate((level, level)))))
    places = np.arange(bins)
    inside = sums[places[None, :] + widths[:, None]] - sums[places][None, :]
    # Least squares of a box over an unknown level.
    scores = inside / np.sqrt(widths * (1.0 - widths / bins))[:, None]
    rising = divmod(int(np.argmax(scores)), bins)
    falling = divmod(int(np.argmin(scores)), bins)
    sign = -1 if -scores[falling] > _FALLING * scores[rising] else 1
    row, place = rising if sign > 0 else falling
    width = int(widths[row])
    outside = np.delete(level, (place + np.arange(width)) % bins)
    noise = 1.4826 * float(np.median(np.abs(outside - np.median(outside)))) if len(outside) else 0.0
    height = abs(float(scores[row, place]))
    if height <= 0:
        return 0.0, 0.0, place, width, sign
    return height, height / max(noise, floor), place, width, sign
