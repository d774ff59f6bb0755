"""Curves, waveforms and spectrograms at the resolution of a picture, in plain numpy."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from mocap_fit.tracks import FloatArray

# Samples that are reduced beforehand, where a column of pixels has many times as many.
_BLOCK = 256
# Praat's spectrogram: Gaussian windows of 5 ms, to 5000 Hz, 70 dB below the loudest is white.
_WINDOW = 0.005
_TOP = 5000.0
_RANGE = 70.0
_FFT_SIZE = 512


@dataclass(frozen=True, eq=False)
class Curve:
    """Values at a constant rate.

    Parameters
    ----------
    start
        Time of the first value, seconds.
    rate
        Values a second, hertz.
    values
        The values, ``(values,)``, any unit; NaN leaves a gap.
    """

    start: float
    rate: float
    values: FloatArray

    @cached_property
    def _blocks(self) -> tuple[FloatArray, FloatArray]:
        count = len(self.values) // _BLOCK
        blocks = self.values[: count * _BLOCK].reshape(count, _BLOCK)
        low = np.where(np.isnan(blocks), np.inf, blocks).min(axis=1)
        return low, np.where(np.isnan(blocks), -np.inf, blocks).max(axis=1)

    def reduce(self, edges: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Reduce the curve to its minimum and maximum in each column of a picture.

        The curve is straight between values, and what it has at the edges of a column counts.

        Parameters
        ----------
        edges
            Times of the edges of the columns, ``(columns + 1,)``, seconds, ascending.

        Returns
        -------
        low : ndarray
            Minima, ``(columns,)``; NaN where there is no curve.
        high : ndarray
            Maxima, ``(columns,)``.
        """
        positions = (np.asarray(edges, dtype=np.float64) - self.start) * self.rate
        at_edges = _interpolate(self.values, positions)
        low = np.fmin(at_edges[:-1], at_edges[1:])
        high = np.fmax(at_edges[:-1], at_edges[1:])
        first, last = np.ceil(positions[:-1]), np.ceil(positions[1:])
        lows, highs = self.values, self.values
        if len(first) and (last - first).max() > 4 * _BLOCK:
            # Columns then begin and end with a block.
            lows, highs = self._blocks
            first, last = np.floor(first / _BLOCK), np.ceil(last / _BLOCK)
        starts, stops = (np.clip(each, 0, len(lows)).astype(np.intp) for each in (first, last))
        inside = np.flatnonzero(starts < stops)
        if inside.size:
            parts = starts[inside], stops[inside]
            low[inside] = np.fmin(low[inside], _reduce_parts(np.fmin, lows, *parts))
            high[inside] = np.fmax(high[inside], _reduce_parts(np.fmax, highs, *parts))
        empty = ~np.isfinite(low) | ~np.isfinite(high)
        low[empty], high[empty] = np.nan, np.nan
        return low, high


def _reduce_parts(
    extreme: np.ufunc, values: FloatArray, starts: NDArray[np.intp], stops: NDArray[np.intp]
) -> FloatArray:
    """Return the extreme of every stretch; they are not empty, and in order."""
    # With one value more every stop is an index.
    part = np.append(values[starts[0] : stops[-1]], np.nan)
    pairs = np.stack([starts, stops], axis=1).ravel() - starts[0]
    return np.asarray(extreme.reduceat(part, pairs)[::2])


def _interpolate(values: FloatArray, positions: FloatArray) -> FloatArray:
    """Return values between samples; NaN beside a gap and outside."""
    if not len(values):
        return np.full(len(positions), np.nan)
    index = np.clip(np.floor(positions).astype(np.intp), 0, max(len(values) - 2, 0))
    part = positions - index
    after = np.minimum(index + 1, len(values) - 1)
    # A sample alone is itself: a neighbour that is missing does not take it away.
    mixed = np.where(part == 0, values[index], (1 - part) * values[index] + part * values[after])
    mixed = np.where(part == 1, values[after], mixed)
    inside = (positions >= 0) & (positions <= len(values) - 1)
    return np.asarray(np.where(inside, mixed, np.nan), dtype=np.float64)


def compute_spectrogram(
    samples: FloatArray, rate: float, edges: FloatArray, height: int
) -> NDArray[np.uint8]:
    """Compute the picture of a spectrogram as Praat draws it: dark is loud.

    Parameters
    ----------
    samples
        Sound of one channel, ``(samples,)``, which begins at 0 s.
    rate
        Sampling rate, hertz.
    edges
        Times of the edges of the columns, ``(columns + 1,)``, seconds.
    height
        Number of rows; the top one is at 5000 Hz, or at half the sampling rate.

    Returns
    -------
    ndarray
        Grey, ``(height, columns)``, 0 (loud) to 255.
    """
    edges = np.asarray(edges, dtype=np.float64)
    centres = np.rint(0.5 * (edges[:-1] + edges[1:]) * rate).astype(np.intp)
    # The window is as wide as twice its effective length.
    half = max(int(_WINDOW * rate), 2)
    offsets = np.arange(-half, half)
    window = np.exp(-12.0 * ((offsets + 0.5) / (2 * half)) ** 2)
    inside = (centres >= 0) & (centres < len(samples))
    picture = np.full((height, len(centres)), 255, dtype=np.uint8)
    if not inside.any():
        return picture
    wanted = np.clip(centres[inside, None] + offsets, 0, len(samples) - 1)
    size = max(_FFT_SIZE, 1 << (2 * half - 1).bit_length())
    spectra = np.abs(np.fft.rfft(samples[wanted] * window, size)) ** 2
    top = min(_TOP, rate / 2)
    rows = np.rint(np.linspace(top, 0.0, height) / rate * size).astype(np.intp)
    levels = 10 * np.log10(spectra[:, rows].T + 1e-12)
    # Speech falls by 6 dB an octave: high frequencies are raised as much.
    levels += 20 * np.log10(np.maximum(rows, 1) / max(rows.max(), 1))[:, None]
    loudest = float(levels.max())
    grey = np.clip((loudest - levels) / _RANGE, 0.0, 1.0)
    picture[:, inside] = np.rint(255 * grey).astype(np.uint8)
    return picture
