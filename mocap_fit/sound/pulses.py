"""Sync pulses: one a motion frame on a channel of the sound (Beskow section 3).

The recording system's clock is even, and so are its pulses: all of them together determine the
time of each frame, also of one whose own pulse is missing, doubled or hidden in noise.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mocap_fit.errors import DataError
from mocap_fit.sound.pulse_clock import Clock, fit_line, follow_pulses, list_slots
from mocap_fit.sound.pulse_matching import (
    compute_likelihoods,
    cut_windows,
    find_run,
    match_frames,
    measure_heights,
    select_quiet,
)
from mocap_fit.sound.pulse_search import find_grid
from mocap_fit.tracks import FloatArray

MAX_DRIFT = 2e-3
"""Relative difference of the two clocks' rates at most; quartz clocks differ by some 0.0001."""

# A pulse's power over the noise's, from which on the beginning of each pulse is measured.
_CLEAR = 100.0
# The share of the frames that must have a pulse.
_MIN_PRESENT = 0.7


@dataclass(frozen=True, eq=False)
class PulseTrain:
    """The frames of a recording on the clock of the sound.

    Parameters
    ----------
    samples
        The sample at which each frame's pulse begins, ``(frames,)``, from 0. Where a pulse stands
        clear of the noise it is measured, elsewhere it is that of the even clock.
    present
        Whether the frame has its pulse, ``(frames,)``.
    extra
        Number of pulses between those of the frames, such as doubled ones; None where noise hides
        them.
    start_time
        Time of the first frame by the even clock, seconds.
    frame_rate
        Frame rate on the sound's clock, hertz.
    drift_ppm
        Relative difference of that rate from the nominal one, millionths (ppm).
    residual
        Root mean square distance of the pulses from the even clock, seconds; None where noise
        hides their beginnings.
    signal_to_noise_db
        Height of a pulse relative to the noise, dB of power.
    """

    samples: NDArray[np.int64]
    present: NDArray[np.bool_]
    extra: int | None
    start_time: float
    frame_rate: float
    drift_ppm: float
    residual: float | None
    signal_to_noise_db: float

    @property
    def frames(self) -> int:
        """Number of frames."""
        return len(self.samples)

    @property
    def times(self) -> FloatArray:
        """Times of the frames by the even clock, ``(frames,)``, seconds."""
        return self.start_time + np.arange(self.frames) / self.frame_rate

    def select(self, first: int, end: int) -> PulseTrain:
        """Return the frames from `first` up to `end`, which is excluded.

        Parameters
        ----------
        first
            Index of the first frame.
        end
            Index after the last frame.

        Returns
        -------
        PulseTrain
            These frames on the same clock.
        """
        return dataclasses.replace(
            self,
            samples=self.samples[first:end],
            present=self.present[first:end],
            start_time=self.start_time + first / self.frame_rate,
        )


def decode_pulses(
    channel: ArrayLike,
    rate: float,
    frame_rate: float,
    frames: int | None = None,
    *,
    start_time: float | None = None,
    max_drift: float = MAX_DRIFT,
) -> PulseTrain:
    """Find the sample of every motion frame from a channel with a pulse a frame.

    Parameters
    ----------
    channel
        Samples of the channel, ``(samples,)``. Pulses may have any height, over any constant
        level, and be up to half a frame long (negative ones 0.39 of a frame).
    rate
        Sampling rate, hertz.
    frame_rate
        Nominal frame rate of the recording, hertz.
    frames
        Number of frames of the recording; the number of pulses if None.
    start_time
        Approximate time of the first frame, seconds. It decides where the first or the last
        pulse is missing.
    max_drift
        Relative difference of the clocks' rates at most, no unit.

    Returns
    -------
    PulseTrain
        The frames on the sound's clock.

    Raises
    ------
    DataError
        If there are no pulses at that rate, if there are more or fewer than frames, or if the
        first or the last is missing and nothing tells which.

    Notes
    -----
    The rate is searched as the one whose multiples hold the most power; the mean period at that
    rate shows the pulse. Then each pulse is searched near the position that the rate predicts,
    and a line through all gives the clock. Which pulse is the first frame's is a question of
    likelihood: each slot of the train has a pulse, of the median height, or has none, or, one in
    fifty, a pulse that is missing.

    Hum of the mains does no harm, unless it is at the very rate of the frames and higher than a
    fifth of the pulses.
    """
    signal = _check_channel(channel, rate, frame_rate, frames, max_drift)
    grid = find_grid(signal, rate / frame_rate, max_drift)
    if grid is None:
        raise _describe_missing_pulses(signal, rate, frame_rate)
    width = grid.width
    samples = grid.sign * signal
    # A box of samples is only as high as a pulse where the level between pulses is 0.
    quiet = select_quiet(samples, Clock(grid.start, grid.period), grid)
    samples -= np.median(quiet if len(quiet) else samples)
    clock = follow_pulses(samples, grid)
    slots = list_slots(clock, width, len(samples))
    noise = _estimate_deviation(select_quiet(samples, clock, grid))
    heights = measure_heights(samples, clock, width, slots)
    scale, likelihoods = compute_likelihoods(heights, noise / np.sqrt(width))
    is_clear = noise == 0 or (scale / noise) ** 2 >= _CLEAR
    if is_clear:
        # The clock may be a sample or two off, which is all of a narrow pulse.
        heights = measure_heights(samples, clock, width, slots, reach=2)
        scale, likelihoods = compute_likelihoods(heights, noise / np.sqrt(width))
    present = heights > 0.5 * scale
    first, last = find_run(likelihoods)
    if last - first < 2 or present[first : last + 1].mean() < _MIN_PRESENT:
        raise _describe_missing_pulses(signal, rate, frame_rate)
    if frames is not None:
        starts = clock.at(slots) / rate
        first = match_frames(likelihoods, frames, (first, last), starts, start_time)
        last = first + frames - 1
    slots, present = slots[first : last + 1], present[first : last + 1]
    positions: NDArray[np.int64] = np.rint(clock.at(slots)).astype(np.int64)
    residual = None
    if is_clear:
        begins, is_measured = _measure_beginnings(samples, clock, width, slots, present)
        if is_measured.any():
            clock = fit_line(slots[is_measured], begins[is_measured]) or clock
        # A line through few pulses of another rate may pass near to the slots.
        nominal = rate / frame_rate
        if abs(clock.period - nominal) > max_drift * nominal + 2 / len(slots):
            raise _describe_missing_pulses(signal, rate, frame_rate)
        positions = np.where(is_measured, begins, np.rint(clock.at(slots)).astype(np.int64))
        off = (begins - clock.at(slots))[is_measured]
        residual = float(np.sqrt(np.mean(off**2))) / rate if len(off) else None
    extra = None
    if scale * np.sqrt(width) > 6 * noise:
        extra = _count_extra(samples, clock, width, slots, scale)
        if extra > _MIN_PRESENT * len(slots):
            raise _describe_missing_pulses(signal, rate, frame_rate)
    measured_rate = rate / clock.period
    return PulseTrain(
        positions,
        present,
        extra,
        float(clock.at(slots[0])) / rate,
        measured_rate,
        1e6 * (measured_rate / frame_rate - 1.0),
        residual,
        float(20 * np.log10(scale / max(noise, 1e-6 * scale))),
    )


def _check_channel(
    channel: ArrayLike, rate: float, frame_rate: float, frames: int | None, max_drift: float
) -> FloatArray:
    samples = np.asarray(channel, dtype=np.float64)
    if samples.ndim != 1 or not np.isfinite(samples).all():
        raise DataError(
            "the channel of the pulses cannot be used",
            found=samples.shape,
            expected="(samples,), finite numbers",
        )
    if not (np.isfinite(frame_rate) and frame_rate > 0 and rate >= 4 * frame_rate):
        raise DataError(
            "pulses of this rate cannot be found in sound of that rate",
            found=f"{frame_rate} frames/s, {rate} samples/s",
            expected="four samples a frame or more",
        )
    if frames is not None and len(samples) < (frames - 1) * rate / frame_rate * (1 - max_drift):
        raise DataError(
            "the sound is too short for the frames of the recording",
            found=f"{len(samples) / rate:.3f} s of sound",
            expected=f"{frames} frames, {frames / frame_rate:.3f} s",
        )
    return samples


def _estimate_deviation(quiet: FloatArray) -> float:
    """Return the standard deviation of samples, whatever stands out of them (the scaled MAD)."""
    return 1.4826 * float(np.median(np.abs(quiet - np.median(quiet)))) if len(quiet) else 0.0


def _measure_beginnings(
    samples: FloatArray,
    clock: Clock,
    width: int,
    slots: NDArray[np.int64],
    present: NDArray[np.bool_],
) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Return the sample at which each pulse rises over half its height, and whether one does."""
    even = clock.at(slots)
    reach = int(min(0.25 * clock.period, max(4.0, 2.0 * width)))
    values, positions = cut_windows(samples, even - reach - 1, 2 * reach + 2 + width)
    # A pulse may begin with the sound: before it there is the level between pulses.
    values = np.where(positions < 0, 0.0, values)
    low = np.nanmedian(values[:, : reach + 1], axis=1)
    above = values >= (0.5 * (low + np.nanmax(values, axis=1)))[:, None]
    rises = above[:, 1:] & ~above[:, :-1]
    distances = np.where(rises, np.abs(positions[:, 1:] - even[:, None]), np.inf)
    nearest = np.argmin(distances, axis=1)
    rows = np.arange(len(slots))
    return positions[:, 1:][rows, nearest], present & np.isfinite(distances[rows, nearest])


def _count_extra(
    samples: FloatArray, clock: Clock, width: int, slots: NDArray[np.int64], scale: float
) -> int:
    """Return the number of pulses that are between those of the frames."""
    first = max(0, round(float(clock.at(slots[0])) - 0.5 * clock.period))
    end = min(len(samples), round(float(clock.at(slots[-1])) + 0.5 * clock.period))
    sums = np.concatenate(([0.0], np.cumsum(samples[first:end])))
    high = (sums[width:] - sums[:-width]) / width > 0.75 * scale
    edges = np.diff(np.concatenate(([0], high.astype(np.int8), [0])))
    centres = first + 0.5 * (np.flatnonzero(edges > 0) + np.flatnonzero(edges < 0) - 1)
    off = np.abs((centres - clock.start + 0.5 * clock.period) % clock.period - 0.5 * clock.period)
    return int((off > max(2.0, 0.5 * width)).sum())


def _describe_missing_pulses(samples: FloatArray, rate: float, frame_rate: float) -> DataError:
    """Return the error for a channel with no pulses, or pulses of another rate."""
    level = np.abs(samples - np.median(samples)) if len(samples) else samples
    top = float(np.quantile(level, 0.999)) if len(level) else 0.0
    content = "silence"
    if top > 0:
        high = level > 0.5 * top
        gaps = np.diff(np.flatnonzero(high[1:] & ~high[:-1]))
        content = "no even pulses"
        if len(gaps) >= 4 and np.ptp(np.quantile(gaps, [0.2, 0.8])) < 0.02 * np.median(gaps) + 2:
            content = f"{rate / float(np.median(gaps)):.4g} pulses a second"
    return DataError(
        "the channel does not hold a pulse for every frame",
        found=content,
        expected=f"{frame_rate:g} pulses a second",
        advice="Check which channel the pulses are on, and the rate of the recording.",
    )
