"""Find where in a channel of sound pulses repeat at a known rate: their period, width and sign.

Pulses that repeat have power at multiples of their rate; the sum over these finds the rate even
where noise hides every single pulse. The mean period at that rate shows what a pulse looks like.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mocap_fit.tracks import FloatArray

# Periods in a chunk: enough to find pulses under noise, few enough to be quick.
_CHUNK = 1000
_HARMONICS = 60
# How far the mean pulse must stand out of the noise of the mean period. The best of thousands of
# positions and widths in noise alone is below 5.
_CLEAR = 8.0
# A negative pulse must be clearer by this factor: what a capacitor makes of a long positive pulse
# is a positive peak at its beginning and a negative one, as high, at its end.
_FALLING = 1.25


@dataclass(frozen=True)
class Grid:
    """A first estimate of a pulse train.

    Parameters
    ----------
    start
        Position at which one of the pulses begins, samples.
    period
        Distance from one pulse to the next, samples.
    width
        Length of a pulse, samples.
    sign
        1 for positive pulses, -1 for negative ones.
    first
        First sample of the chunk of the sound in which the pulses are found.
    end
        End of that chunk: one after its last sample.
    """

    start: float
    period: float
    width: int
    sign: int
    first: int
    end: int


@dataclass(frozen=True)
class _Box:
    """The pulse in a mean period: what it explains, and where it is, in bins."""

    height: float = 0.0
    clearness: float = 0.0
    position: int = 0
    width: int = 0
    sign: int = 0


def find_grid(channel: FloatArray, period: float, max_drift: float) -> Grid | None:
    """Find pulses of a period that is known approximately.

    Parameters
    ----------
    channel
        Samples of the channel, ``(samples,)``.
    period
        Approximate distance from one pulse to the next, samples; 4 or more.
    max_drift
        Largest relative error of the period, no unit, such as 0.002.

    Returns
    -------
    Grid or None
        The clearest pulses; None where there are none.
    """
    length = round(_CHUNK * period)
    best: tuple[float, Grid | None] = (_CLEAR, None)
    for first in range(0, len(channel), length):
        chunk = channel[first : first + length]
        # The last chunk may be too short to show anything.
        if len(chunk) < 4 * period and first:
            break
        # The first clear chunk may hold a few pulses only, at its end: look at one more.
        is_last = best[0] > 10 * _CLEAR
        clearness, grid = _search_chunk(chunk, first, period, max_drift)
        if grid is not None and clearness > best[0]:
            best = (clearness, grid)
        if is_last:
            break
    return best[1]


def _search_chunk(
    chunk: FloatArray, first: int, period: float, max_drift: float
) -> tuple[float, Grid | None]:
    """Return how clear the pulses of a chunk are, and their grid."""
    chunk = chunk - np.median(chunk)
    if len(chunk) < 2 * period or not chunk.any():
        return 0.0, None
    # A channel without noise is not infinitely clear.
    floor = 1e-3 * float(chunk.std()) / np.sqrt(len(chunk) / period)
    frequency, step = _estimate_frequency(chunk, period, max_drift)
    best = _Box()
    widths = np.arange(1, round(period) // 2 + 1)
    some_widths = np.unique(np.geomspace(1, len(widths), 40).astype(np.int64))
    # What one step changes over the full chunk is a part of a period; pulses are narrower.
    for reach, count in ((1.5, 7), (0.5, 9)):
        middle = frequency
        for candidate in middle + step * np.linspace(-reach, reach, count):
            box = _fit_box(_average_periods(chunk, candidate), floor, some_widths)
            if box.height > best.height:
                best, frequency = box, float(candidate)
    best = _fit_box(_average_periods(chunk, frequency), floor, widths)
    if not best.sign:
        return 0.0, None
    exact = 1.0 / frequency
    samples_per_bin = exact / round(exact)
    grid = Grid(
        first + best.position * samples_per_bin,
        exact,
        max(1, round(best.width * samples_per_bin)),
        best.sign,
        first,
        first + len(chunk),
    )
    return best.clearness, grid


def _estimate_frequency(chunk: FloatArray, period: float, max_drift: float) -> tuple[float, float]:
    """Return the rate of repetition, in periods a sample, and the step of the search."""
    from scipy.fft import next_fast_len, rfft

    size = next_fast_len(2 * len(chunk), real=True)
    spectrum = np.abs(rfft(chunk, size))
    harmonics = np.arange(1, min(_HARMONICS, int(0.45 * period)) + 1)
    step = 1.0 / (size * len(harmonics))
    count = int(np.ceil(max_drift / period / step))
    frequencies = (1.0 + np.linspace(-max_drift, max_drift, 2 * count + 1)) / period
    bins = np.rint(np.outer(harmonics, frequencies) * size).astype(np.int64)
    heights = spectrum[np.minimum(bins, len(spectrum) - 1)]
    # Relative to its median, and in logarithms: mains hum near one multiple must not hide the
    # others.
    median = np.median(heights, axis=1, keepdims=True)
    scores = np.log1p(heights / np.maximum(median, 1e-9 * spectrum.max())).sum(axis=0)
    return float(frequencies[int(np.argmax(scores))]), step


def _average_periods(chunk: FloatArray, frequency: float) -> FloatArray:
    """Return the mean over all periods, ``(bins,)``, about a sample a bin."""
    bins = round(1.0 / frequency)
    phases = (np.arange(len(chunk)) * frequency) % 1.0
    positions = np.minimum((phases * bins).astype(np.int64), bins - 1)
    sums = np.bincount(positions, chunk, bins)
    counts = np.bincount(positions, minlength=bins)
    profile: FloatArray = sums / np.maximum(counts, 1)
    return profile


def _fit_box(profile: FloatArray, floor: float, widths: NDArray[np.int64]) -> _Box:
    """Return the box that explains most of a mean period."""
    bins = len(profile)
    level = profile - profile.mean()
    sums = np.concatenate(([0.0], np.cumsum(np.concatenate((level, level)))))
    starts = np.arange(bins)
    inside = sums[starts[None, :] + widths[:, None]] - sums[starts][None, :]
    # Least squares of a box over an unknown level.
    scores = inside / np.sqrt(widths * (1.0 - widths / bins))[:, None]
    rising = divmod(int(np.argmax(scores)), bins)
    falling = divmod(int(np.argmin(scores)), bins)
    sign = -1 if -scores[falling] > _FALLING * scores[rising] else 1
    row, position = rising if sign > 0 else falling
    width = int(widths[row])
    outside = np.delete(level, (position + np.arange(width)) % bins)
    noise = 1.4826 * float(np.median(np.abs(outside - np.median(outside)))) if len(outside) else 0.0
    height = abs(float(scores[row, position]))
    if height <= 0:
        return _Box(position=position, width=width, sign=sign)
    return _Box(height, height / max(noise, floor), position, width, sign)
