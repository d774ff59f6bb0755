"""The clock of a pulse train, fitted to the pulses from where they are clearest to the ends."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mocap_fit.sound.pulse_search import Grid
from mocap_fit.tracks import FloatArray


@dataclass(frozen=True)
class Clock:
    """An even clock: pulse k begins at sample ``start + k period``.

    Parameters
    ----------
    start
        Position of pulse 0, samples.
    period
        Distance from one pulse to the next, samples.
    """

    start: float
    period: float

    def at(self, pulses: ArrayLike) -> FloatArray:
        """Return the positions at which pulses begin.

        Parameters
        ----------
        pulses
            Numbers of the pulses, ``(pulses,)``.

        Returns
        -------
        ndarray
            Positions, ``(pulses,)``, samples.
        """
        positions: FloatArray = self.start + np.asarray(pulses) * self.period
        return positions


def list_slots(clock: Clock, width: int, length: int) -> NDArray[np.int64]:
    """List the numbers of the pulses that lie in the sound.

    Parameters
    ----------
    clock
        Clock of the pulses.
    width
        Length of a pulse, samples.
    length
        Length of the sound, samples.

    Returns
    -------
    ndarray
        Numbers in order, ``(slots,)``. A pulse at an end of the sound may lie a little outside.
    """
    margin = 1.5 + 0.25 * (width - 1)
    first = int(np.ceil((-margin - clock.start) / clock.period))
    last = int(np.floor((length - width + margin - clock.start) / clock.period))
    return np.arange(first, last + 1)


def follow_pulses(samples: FloatArray, grid: Grid) -> Clock:
    """Fit the clock of a grid to its pulses, then to those around them out to the ends.

    Parameters
    ----------
    samples
        Sound with positive pulses over a level of 0, ``(samples,)``.
    grid
        The first estimate.

    Returns
    -------
    Clock
        A line through all pulses.
    """
    clock = Clock(grid.start, grid.period)
    first, end = grid.first, grid.end
    reach = max(2, grid.width // 2)
    sums = np.concatenate(([0.0], np.cumsum(samples)))
    while True:
        for _ in range(3):
            slots = list_slots(clock, grid.width, len(samples))
            positions = clock.at(slots)
            slots = slots[(positions >= first) & (positions < end)]
            clock = _refine_clock(sums, clock, grid.width, slots, reach)
        if first <= 0 and end >= len(samples):
            return clock
        length = end - first
        first, end = max(0, first - length), min(len(samples), end + length)


def _refine_clock(
    sums: FloatArray, clock: Clock, width: int, slots: NDArray[np.int64], reach: int
) -> Clock:
    """Return the line through the pulses, each where a box of its width holds the most.

    `sums` ``(samples + 1,)`` are those of the samples before each.
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
    # The higher half has no slot without a pulse, if half of the slots have pulses.
    usable &= heights > 0.5 * np.quantile(heights[usable], 0.75)
    if usable.sum() < 3:
        return clock
    positions = begins[np.arange(len(slots)), best].astype(np.float64)
    line = fit_line(slots[usable], positions[usable])
    # Noise does not take the clock farther than where pulses were looked for.
    if line is None or np.abs(line.at(slots) - clock.at(slots)).max() > reach:
        return clock
    return line


def fit_line(numbers: NDArray[np.int64], positions: ArrayLike) -> Clock | None:
    """Fit a line through pulses by least squares, without those far from it.

    Parameters
    ----------
    numbers
        Numbers of the pulses, ``(pulses,)``.
    positions
        Where they begin, ``(pulses,)``, samples.

    Returns
    -------
    Clock or None
        The line; None where all pulses have one number.
    """
    begins = np.asarray(positions, dtype=np.float64)
    line = None
    for _ in range(3):
        centre = numbers.mean()
        variation = float(((numbers - centre) ** 2).sum())
        if variation == 0:
            return line
        slope = float((numbers - centre) @ (begins - begins.mean())) / variation
        line = Clock(float(begins.mean() - slope * centre), slope)
        off = np.abs(begins - line.at(numbers))
        near = off <= max(1.0, 3 * float(np.median(off)))
        if near.all():
            break
        numbers, begins = numbers[near], begins[near]
    return line
