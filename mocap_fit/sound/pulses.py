"""Sync pulses: one a motion frame on a channel of the sound (Beskow section 3).

The recording system's clock is even, and so are its pulses: all of them together place each
frame, also one whose own pulse is missing, doubled or lost in noise.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mocap_fit.errors import DataError
from mocap_fit.sound.pulse_search import Grid, find_grid
from mocap_fit.tracks import FloatArray

LARGEST_DRIFT = 2e-3
"""By which part the two clocks' rates may differ; quartz clocks differ by some 0.0001."""

# A pulse's power over the noise's, from which on its own beginning is believed to the sample.
_BELIEVED = 100.0
# Logarithms of likelihood ratios: a pulse that is missing counts no more than the first.
_MISSING = float(np.log(0.02))
_SURE = 6.0
_CONTRADICTION = 6.0
# The part of the frames that must have a pulse.
_HEARD = 0.7


@dataclass(frozen=True, eq=False)
class PulseTrain:
    """The frames of a recording on the clock of the sound.

    Parameters
    ----------
    samples
        `(frames,)`, the sample at which each frame's pulse begins, from 0. Where a pulse stands
        clear of the noise it is the pulse's own, elsewhere that of the even clock.
    heard
        `(frames,)`, whether the frame's pulse is there.
    extra
        Pulses besides, such as doubled ones; None where noise hides them.
    start_time
        Seconds: the first frame, by the even clock.
    frame_rate
        Frames a second of the sound's clock.
    drift_ppm
        Millionths by which that is more than the recording system says of itself.
    residual
        Seconds: root mean square distance of the pulses from the even clock; None where noise
        hides their beginnings.
    signal_to_noise_db
        A pulse's height over the noise, decibels of power.
    """

    samples: NDArray[np.int64]
    heard: NDArray[np.bool_]
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
        """Times of the frames by the even clock, `(frames,)`, seconds."""
        return self.start_time + np.arange(self.frames) / self.frame_rate

    def part(self, first: int, end: int) -> PulseTrain:
        """The frames from `first` up to `end`, without it."""
        return dataclasses.replace(
            self,
            samples=self.samples[first:end],
            heard=self.heard[first:end],
            start_time=self.start_time + first / self.frame_rate,
        )


@dataclass(frozen=True)
class _Clock:
    """Pulse k begins at sample `start + k period`."""

    start: float
    period: float

    def at(self, pulses: ArrayLike) -> FloatArray:
        places: FloatArray = self.start + np.asarray(pulses) * self.period
        return places


def decode_pulses(
    channel: ArrayLike,
    rate: float,
    frame_rate: float,
    frames: int | None = None,
    *,
    start_time: float | None = None,
    largest_drift: float = LARGEST_DRIFT,
) -> PulseTrain:
    """Find the sample of every motion frame from a channel with a pulse a frame.

    Parameters
    ----------
    channel
        `(samples,)`; pulses of any height, sign and width up to half a frame.
    rate
        Samples a second.
    frame_rate
        Frames a second, as the recording says.
    frames
        How many frames the recording has; as many as there are pulses where not given.
    start_time
        Seconds: about where the first frame is, where that is known. It decides where the first
        or the last pulse is missing.
    largest_drift
        By which part the rates of the clocks may differ.

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
    rate shows the pulse. Then each pulse is found by itself near where it must be, and a line
    through all gives the clock. Which pulse is the first frame's is a question of likelihood:
    each place of the train has a pulse, of the middle height, or has none, or, one in fifty, a
    pulse that is missing.

    Hum of the mains does no harm, unless it is at the very rate of the frames and higher than a
    fifth of the pulses.
    """
    samples = _checked(channel, rate, frame_rate, frames, largest_drift)
    grid = find_grid(samples, rate / frame_rate, largest_drift)
    if grid is None:
        raise _no_pulses(samples, rate, frame_rate)
    samples = grid.sign * samples
    # A box of samples is only as high as a pulse where the level between pulses is 0.
    samples -= np.median(_between_pulses(samples, _Clock(grid.start, grid.period), grid))
    clock = _followed(samples, grid)
    slots = _slots(clock, grid.width, len(samples))
    heights = _heights(samples, clock, grid.width, slots)
    noise = _noise(samples, clock, grid)
    scale, likelihoods = _likelihoods(heights, noise / np.sqrt(grid.width))
    believed = noise == 0 or (scale / noise) ** 2 >= _BELIEVED
    if believed:
        # The clock may be a sample off, which is all of a narrow pulse.
        shifted = [_heights(samples, clock, grid.width, slots, shift) for shift in range(-2, 3)]
        heights = np.max(shifted, axis=0)
        scale, likelihoods = _likelihoods(heights, noise / np.sqrt(grid.width))
    first, last = _span(likelihoods)
    inside = heights[first : last + 1]
    heard_part = float((inside > 0.5 * scale).mean())
    if last - first < 2 or heard_part < _HEARD:
        raise _no_pulses(samples, rate, frame_rate)
    if frames is not None:
        starts = clock.at(slots) / rate
        first = _placed(likelihoods, frames, (first, last), starts, start_time)
        last = first + frames - 1
    chosen = slots[first : last + 1]
    heard = heights[first : last + 1] > 0.5 * scale
    places: NDArray[np.int64] = np.rint(clock.at(chosen)).astype(np.int64)
    residual = None
    if believed:
        own, found = _beginnings(samples, clock, grid.width, chosen, heard)
        if found.sum() >= 3:
            clock = _line(chosen[found], own[found]) or clock
            nominal = rate / frame_rate
            if abs(clock.period - nominal) > largest_drift * nominal + 2 / (last - first):
                raise _no_pulses(samples, rate, frame_rate)
        places = np.where(found, own, np.rint(clock.at(chosen)).astype(np.int64))
        off = (own - clock.at(chosen))[found]
        residual = float(np.sqrt(np.mean(off**2))) / rate if len(off) else None
    extra = None
    if scale * np.sqrt(grid.width) > 6 * noise:
        extra = _extra(samples, clock, grid.width, chosen, scale)
        if extra > _HEARD * len(chosen):
            raise _no_pulses(samples, rate, frame_rate)
    found_rate = rate / clock.period
    return PulseTrain(
        places,
        heard,
        extra,
        float(clock.at(chosen[0])) / rate,
        found_rate,
        1e6 * (found_rate / frame_rate - 1.0),
        residual,
        float(20 * np.log10(scale / max(noise, 1e-6 * scale))),
    )


def _checked(
    channel: ArrayLike, rate: float, frame_rate: float, frames: int | None, largest_drift: float
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
    if frames is not None and len(samples) < (frames - 1) * rate / frame_rate * (1 - largest_drift):
        raise DataError(
            "the sound is too short for the frames of the recording",
            found=f"{len(samples) / rate:.3f} s of sound",
            expected=f"{frames} frames, {frames / frame_rate:.3f} s",
        )
    return samples


def _slots(clock: _Clock, width: int, length: int) -> NDArray[np.int64]:
    """Numbers of the pulses whose places are in the sound."""
    # A pulse that begins with the sound may have been found a little before it.
    lowest_start = -1.5 - 0.25 * (width - 1)
    lowest = int(np.ceil((lowest_start - clock.start) / clock.period))
    highest = int(np.floor((length - width - lowest_start - clock.start) / clock.period))
    return np.arange(lowest, highest + 1)


def _followed(samples: FloatArray, grid: Grid) -> _Clock:
    """The clock, from the stretch it was found in out to the ends of the sound."""
    clock = _Clock(grid.start, grid.period)
    first, last = grid.first, grid.last
    reach = max(2, grid.width // 2)
    sums = np.concatenate(([0.0], np.cumsum(samples)))
    while True:
        for _ in range(3):
            slots = _slots(clock, grid.width, len(samples))
            places = clock.at(slots)
            slots = slots[(places >= first) & (places < last)]
            clock = _fitted(sums, clock, grid.width, slots, reach)
        if first <= 0 and last >= len(samples):
            return clock
        length = last - first
        first, last = max(0, first - length), min(len(samples), last + length)


def _fitted(
    sums: FloatArray, clock: _Clock, width: int, slots: NDArray[np.int64], reach: int
) -> _Clock:
    """The line through the pulses, each where the box of a pulse's width holds the most.

    `sums` `(samples + 1,)` are those of the samples before each.
    """
    shifts = np.arange(-reach, reach + 1)
    begins = np.rint(clock.at(slots)).astype(np.int64)[:, None] + shifts
    fits = (begins >= 0) & (begins + width <= len(sums) - 1)
    low, high = np.clip(begins, 0, len(sums) - 1), np.clip(begins + width, 0, len(sums) - 1)
    inside = np.where(fits, sums[high] - sums[low], -np.inf)
    best = np.argmax(inside, axis=1)
    heights = inside[np.arange(len(slots)), best]
    usable = np.isfinite(heights)
    if not usable.any():
        return clock
    # The higher half has no places without a pulse, if half of the stretch has pulses.
    usable &= heights > 0.5 * np.quantile(heights[usable], 0.75)
    if usable.sum() < 3:
        return clock
    found = begins[np.arange(len(slots)), best].astype(np.float64)
    line = _line(slots[usable], found[usable])
    # Noise does not take the clock farther than where pulses were looked for.
    if line is None or np.abs(line.at(slots) - clock.at(slots)).max() > reach:
        return clock
    return line


def _line(numbers: NDArray[np.int64], places: ArrayLike) -> _Clock | None:
    """The line through pulses, `(pulses,)` each, without those far from it."""
    there = np.asarray(places, dtype=np.float64)
    line = None
    for _ in range(3):
        middle = numbers.mean()
        spread = float(((numbers - middle) ** 2).sum())
        if spread == 0:
            return line
        slope = float((numbers - middle) @ (there - there.mean())) / spread
        line = _Clock(float(there.mean() - slope * middle), slope)
        off = np.abs(there - line.at(numbers))
        near = off <= max(1.0, 3 * float(np.median(off)))
        if near.all() or near.sum() < 3:
            break
        numbers, there = numbers[near], there[near]
    return line


def _windows(
    samples: FloatArray, begins: FloatArray, length: int
) -> tuple[FloatArray, NDArray[np.int64]]:
    """`(pulses, length)` samples from each beginning; NaN outside the sound."""
    places = np.rint(begins).astype(np.int64)[:, None] + np.arange(length)
    outside = (places < 0) | (places >= len(samples))
    values = samples[np.clip(places, 0, len(samples) - 1)]
    return np.where(outside, np.nan, values), places


def _heights(
    samples: FloatArray, clock: _Clock, width: int, slots: NDArray[np.int64], shift: int = 0
) -> FloatArray:
    """Mean of each pulse over the level about it, `(slots,)`."""
    around = max(2, min(int(clock.period) - width, 128))
    pulse, _ = _windows(samples, clock.at(slots) + shift, width)
    before, _ = _windows(samples, clock.at(slots) - around // 2 - 1, around // 2)
    after, _ = _windows(samples, clock.at(slots) + width + 1, around // 2)
    level = np.nanmedian(np.concatenate((before, after), axis=1), axis=1)
    inside = np.isfinite(pulse)
    heights = np.where(inside, pulse - level[:, None], 0.0).sum(axis=1)
    return np.asarray(heights / np.maximum(inside.sum(axis=1), 1))


def _between_pulses(samples: FloatArray, clock: _Clock, grid: Grid) -> FloatArray:
    """Return the samples of the grid's stretch that are clear of any pulse."""
    phases = (np.arange(grid.first, grid.last) - clock.start) % clock.period
    margin = min(max(2.0, 0.25 * grid.width), 0.2 * clock.period)
    clear = (phases > grid.width + margin) & (phases < clock.period - margin)
    return samples[grid.first : grid.last][clear]


def _noise(samples: FloatArray, clock: _Clock, grid: Grid) -> float:
    """Return the standard deviation between the pulses, whatever stands out of it."""
    quiet = _between_pulses(samples, clock, grid)
    return 1.4826 * float(np.median(np.abs(quiet - np.median(quiet)))) if len(quiet) else 0.0


def _likelihoods(heights: FloatArray, noise: float) -> tuple[float, FloatArray]:
    """The height of a pulse, and how much likelier each place has one than not, `(slots,)`."""
    scale = float(np.median(heights[heights > 0.5 * np.quantile(heights, 0.9)]))
    # Pulses differ in height even where there is no noise.
    deviation = max(noise, 0.1 * abs(scale))
    present = (scale * heights - 0.5 * scale**2) / deviation**2
    ratios: FloatArray = np.logaddexp(present + np.log1p(-np.exp(_MISSING)), _MISSING)
    # Without a pulse something else may have made the height: nothing is surer than this.
    return scale, np.minimum(ratios, 50.0)


def _span(likelihoods: FloatArray) -> tuple[int, int]:
    """First and last place of the run that most likely has the pulses."""
    sums = np.concatenate(([0.0], np.cumsum(likelihoods)))
    lowest = np.minimum.accumulate(sums)
    last = int(np.argmax(sums[1:] - lowest[:-1]))
    first = int(np.argmin(sums[: last + 1]))
    return first, last


def _placed(
    likelihoods: FloatArray,
    frames: int,
    span: tuple[int, int],
    starts: FloatArray,
    start_time: float | None,
) -> int:
    """Which place is the first frame's."""
    first, last = span
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
        + " or ".join(f"{starts[place]:.4f} s" for place in likely[:4]),
        expected=f"{frames}, one a frame",
        advice="Give the start time of the recording on the sound's clock, to half a frame.",
    )


def _beginnings(
    samples: FloatArray,
    clock: _Clock,
    width: int,
    slots: NDArray[np.int64],
    heard: NDArray[np.bool_],
) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """The sample at which each pulse rises over half its height, and for which there is one."""
    even = clock.at(slots)
    reach = int(min(0.25 * clock.period, max(4.0, 2.0 * width)))
    values, at = _windows(samples, even - reach - 1, 2 * reach + 2 + width)
    # A pulse may begin with the sound: what was before it was the level between pulses.
    values = np.where(at < 0, float(np.median(samples)), values)
    low = np.nanmedian(values[:, : reach + 1], axis=1)
    above = values >= (0.5 * (low + np.nanmax(values, axis=1)))[:, None]
    rises = above[:, 1:] & ~above[:, :-1]
    distances = np.where(rises, np.abs(at[:, 1:] - even[:, None]), np.inf)
    nearest = np.argmin(distances, axis=1)
    rows = np.arange(len(slots))
    return at[:, 1:][rows, nearest], heard & np.isfinite(distances[rows, nearest])


def _extra(
    samples: FloatArray, clock: _Clock, width: int, slots: NDArray[np.int64], scale: float
) -> int:
    """How many pulses are between those of the frames."""
    first = max(0, round(float(clock.at(slots[0])) - 0.5 * clock.period))
    last = min(len(samples), round(float(clock.at(slots[-1])) + 0.5 * clock.period))
    part = samples[first:last] - np.median(samples[first:last])
    if len(part) < width:
        return 0
    sums = np.concatenate(([0.0], np.cumsum(part)))
    high = (sums[width:] - sums[:-width]) / width > 0.75 * scale
    edges = np.diff(np.concatenate(([0], high.astype(np.int8), [0])))
    centres = first + 0.5 * (np.flatnonzero(edges > 0) + np.flatnonzero(edges < 0) - 1)
    off = np.abs((centres - clock.start + 0.5 * clock.period) % clock.period - 0.5 * clock.period)
    return int((off > max(2.0, 0.5 * width)).sum())


def _no_pulses(samples: FloatArray, rate: float, frame_rate: float) -> DataError:
    """There are no pulses, or of another rate."""
    level = np.abs(samples - np.median(samples))
    top = float(np.quantile(level, 0.999)) if len(level) else 0.0
    found = "silence"
    if top > 0:
        high = level > 0.5 * top
        begins = np.flatnonzero(high[1:] & ~high[:-1])
        gaps = np.diff(begins)
        found = "no even pulses"
        if len(gaps) >= 4 and np.ptp(np.quantile(gaps, [0.2, 0.8])) < 0.02 * np.median(gaps) + 2:
            found = f"{rate / float(np.median(gaps)):.4g} pulses a second"
    return DataError(
        "the channel does not hold a pulse for every frame",
        found=found,
        expected=f"{frame_rate:g} pulses a second",
        advice="Check which channel the pulses are on, and the rate of the recording.",
    )
