"""Which pulse belongs to the first frame of a recording: heights of pulses, and likelihoods."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mocap_fit.errors import DataError
from mocap_fit.sound.pulse_clock import Clock
from mocap_fit.sound.pulse_search import Grid
from mocap_fit.tracks import FloatArray

# Logarithms of likelihood ratios: one pulse in fifty may be missing.
_MISSING = float(np.log(0.02))
_SURE = 6.0
_CONTRADICTION = 6.0
# Without a pulse something else may have made a height: no slot is surer than this.
_SUREST = 50.0


def cut_windows(
    samples: FloatArray, begins: FloatArray, length: int
) -> tuple[FloatArray, NDArray[np.int64]]:
    """Cut a window of samples at each of many positions.

    Parameters
    ----------
    samples
        The sound, ``(samples,)``.
    begins
        Where the windows begin, ``(windows,)``, samples; rounded.
    length
        Length of each window, samples.

    Returns
    -------
    ndarray
        The windows, ``(windows, length)``; NaN outside the sound.
    ndarray
        Positions of their samples, ``(windows, length)``.
    """
    positions = np.rint(begins).astype(np.int64)[:, None] + np.arange(length)
    outside = (positions < 0) | (positions >= len(samples))
    values = samples[np.clip(positions, 0, len(samples) - 1)]
    return np.where(outside, np.nan, values), positions


def measure_heights(
    samples: FloatArray, clock: Clock, width: int, slots: NDArray[np.int64], reach: int = 0
) -> FloatArray:
    """Measure the mean of each pulse over the level around it.

    Parameters
    ----------
    samples
        Sound with positive pulses, ``(samples,)``.
    clock
        Clock of the pulses.
    width
        Length of a pulse, samples.
    slots
        Numbers of the pulses, ``(slots,)``.
    reach
        How far beside the clock a pulse may begin, samples; the highest of the means is taken.

    Returns
    -------
    ndarray
        Heights, ``(slots,)``, in the unit of the samples; 0 for a pulse outside the sound.
    """
    around = max(2, min(int(clock.period) - width, 128))
    begins = clock.at(slots)
    before, _ = cut_windows(samples, begins - around // 2 - 1, around // 2)
    after, _ = cut_windows(samples, begins + width + 1, around // 2)
    level = np.nanmedian(np.concatenate((before, after), axis=1), axis=1)[:, None]
    heights = []
    for shift in range(-reach, reach + 1):
        pulse, _ = cut_windows(samples, begins + shift, width)
        inside = np.isfinite(pulse)
        sums = np.where(inside, pulse - level, 0.0).sum(axis=1)
        heights.append(sums / np.maximum(inside.sum(axis=1), 1))
    return np.asarray(np.max(heights, axis=0))


def select_quiet(samples: FloatArray, clock: Clock, grid: Grid) -> FloatArray:
    """Select the samples of a grid's chunk that are clear of any pulse.

    Parameters
    ----------
    samples
        The sound, ``(samples,)``.
    clock
        Clock of the pulses.
    grid
        Width of the pulses and the chunk.

    Returns
    -------
    ndarray
        Samples between the pulses, ``(quiet,)``.
    """
    phases = (np.arange(grid.first, grid.end) - clock.start) % clock.period
    margin = min(max(2.0, 0.25 * grid.width), 0.2 * clock.period)
    clear = (phases > grid.width + margin) & (phases < clock.period - margin)
    return samples[grid.first : grid.end][clear]


def compute_likelihoods(heights: FloatArray, noise: float) -> tuple[float, FloatArray]:
    """Compute the height of a pulse, and how much likelier each slot has one than not.

    A slot has a pulse of the median height, with Gaussian noise, or none; where the train has a
    pulse, one in fifty is missing.

    Parameters
    ----------
    heights
        Heights of the slots, ``(slots,)``, in the unit of the samples.
    noise
        Standard deviation of a height, in the unit of the samples.

    Returns
    -------
    float
        Height of a pulse, in the unit of the samples.
    ndarray
        Logarithms of likelihood ratios, ``(slots,)``, no unit.
    """
    tall = heights[heights > 0.5 * np.quantile(heights, 0.9)]
    if not len(tall):
        return 0.0, np.full(len(heights), _MISSING)
    scale = float(np.median(tall))
    # Pulses differ in height even where there is no noise.
    deviation = max(noise, 0.1 * abs(scale))
    present = (scale * heights - 0.5 * scale**2) / deviation**2
    ratios: FloatArray = np.logaddexp(present + np.log1p(-np.exp(_MISSING)), _MISSING)
    return scale, np.minimum(ratios, _SUREST)


def find_run(likelihoods: FloatArray) -> tuple[int, int]:
    """Find the run of slots that most likely has the pulses.

    Parameters
    ----------
    likelihoods
        Logarithms of likelihood ratios, ``(slots,)``, no unit.

    Returns
    -------
    int
        The first slot of the run with the largest sum.
    int
        Its last slot.
    """
    sums = np.concatenate(([0.0], np.cumsum(likelihoods)))
    lowest = np.minimum.accumulate(sums)
    last = int(np.argmax(sums[1:] - lowest[:-1]))
    first = int(np.argmin(sums[: last + 1]))
    return first, last


def match_frames(
    likelihoods: FloatArray,
    frames: int,
    run: tuple[int, int],
    starts: FloatArray,
    start_time: float | None,
) -> int:
    """Find the slot of the first frame.

    Parameters
    ----------
    likelihoods
        Logarithms of likelihood ratios, ``(slots,)``, no unit.
    frames
        Number of frames.
    run
        First and last slot of the run that most likely has the pulses.
    starts
        When the slots begin, ``(slots,)``, seconds.
    start_time
        When the first frame is approximately, seconds; None where it is not known.

    Returns
    -------
    int
        The first of the `frames` slots that most likely have the pulses.

    Raises
    ------
    DataError
        If there are more or fewer pulses than frames, or several slots are as likely.
    """
    first, last = run
    count = last - first + 1
    mismatch = DataError(
        "the pulses do not match the number of frames",
        found=f"{count} pulses, from {starts[first]:.3f} s to {starts[last]:.3f} s",
        expected=f"{frames}, one a frame",
        advice="Check that sound and recording belong together and that neither was cut; pulses "
        "that belong to no frame can be named (spare).",
    )
    if len(likelihoods) < frames:
        raise mismatch
    sums = np.concatenate(([0.0], np.cumsum(likelihoods)))
    totals = sums[frames:] - sums[:-frames]
    best = int(np.argmax(totals))
    if sums[last + 1] - sums[first] - totals[best] > _CONTRADICTION:
        raise mismatch
    likely = np.flatnonzero(totals > totals[best] - _SURE)
    if len(likely) == 1:
        return best
    if start_time is not None:
        distances = np.abs(starts[likely] - start_time)
        period = float(starts[1] - starts[0])
        if distances.min() < 0.45 * period:
            return int(likely[np.argmin(distances)])
    raise DataError(
        "the first or the last pulse is missing, and nothing tells which",
        found=f"{count} pulses; the first frame may be at "
        + " or ".join(f"{starts[slot]:.4f} s" for slot in likely[:4]),
        expected=f"{frames}, one a frame",
        advice="Give the start time of the recording on the sound's clock, to half a frame.",
    )
