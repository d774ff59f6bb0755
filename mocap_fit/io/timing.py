"""The frame rate and the start time of a recording, from its file and the times of its frames."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mocap_fit.errors import FileFormatError, FrameTimesError, MissingRateError, RateMismatchError
from mocap_fit.io.number_table import NumberTable
from mocap_fit.tracks import FloatArray

_GIVE_RATE = "Give the rate of the recording (rate=..., in hertz)."
_KNOWN_RATES = (24000 / 1001, 30000 / 1001, 60000 / 1001, 120000 / 1001)


def check_rate(rate: float, *, path: Path, line: int | None = None) -> float:
    """Return a frame rate that is a finite number above 0.

    Parameters
    ----------
    rate
        Frame rate, hertz.
    path
        File for the message.
    line
        Line for the message.

    Returns
    -------
    float
        The rate, hertz.

    Raises
    ------
    FileFormatError
        If it is not finite or not above 0.
    """
    if not np.isfinite(rate) or rate <= 0:
        raise FileFormatError(
            "the frame rate is out of range",
            path=path,
            line=line,
            found=f"{rate:g} Hz",
            expected="a number above 0",
            advice=_GIVE_RATE,
        )
    return float(rate)


def determine_timing(
    table: NumberTable,
    *,
    path: Path,
    frame: int | None,
    time: int | None,
    time_unit: float = 1.0,
    rate: float | None = None,
    file_rate: float | None = None,
    line: int | None = None,
) -> tuple[float, float]:
    """Determine the rate and the start time of a table with a row a frame.

    The rate is that of the caller, else that of the header, else that of the times.

    Parameters
    ----------
    table
        Numbers of the file.
    path
        File for messages.
    frame
        Index of the column of frame numbers, which must be consecutive; None without one.
    time
        Index of the column of times; None without one.
    time_unit
        Unit of the times, seconds.
    rate
        Rate of the caller, hertz; it replaces that of the file.
    file_rate
        Rate in the header of the file, hertz; it must agree with the times within 1 per cent.
    line
        Line for the message of a missing rate.

    Returns
    -------
    rate
        Frame rate, hertz.
    start_time
        Time of the first frame, seconds; 0 without times.

    Raises
    ------
    MissingRateError
        If neither the caller nor the file says the rate.
    FileFormatError
        If the rate is out of range, frames are left out, or the times are missing, uneven, or
        contradict the header.
    """
    if frame is not None:
        check_consecutive(table.values[:, frame], path=path, lines=table.lines)
    rate = None if rate is None else check_rate(rate, path=path)
    known = file_rate if rate is None else rate
    if time is None:
        if known is None:
            raise MissingRateError(
                "the file does not say its frame rate",
                path=path,
                line=line,
                advice="Add times, or give the rate (rate=..., in hertz).",
            )
        return known, 0.0
    times = table.values[:, time] * time_unit
    decimals = table.count_decimals(time) - round(np.log10(time_unit))
    if known is None:
        known = estimate_rate(times, decimals=decimals, path=path, lines=table.lines)
    elif rate is None:
        _check_rate_against_times(known, times, decimals=decimals, path=path, lines=table.lines)
    start = float(times[0])
    if np.isnan(start):
        raise FrameTimesError("the first frame has no time", path=path, line=int(table.lines[0]))
    return known, start


def estimate_rate(
    times: FloatArray, *, decimals: int, path: Path, lines: NDArray[np.intp]
) -> float:
    """Estimate the rate of evenly spaced times that were rounded when they were written.

    An integer rate, one with a single decimal, or one of the television rates is chosen where it
    explains all times; otherwise the mean rate.

    Parameters
    ----------
    times
        Times of the frames, ``(frames,)``, seconds.
    decimals
        Digits after the point that the times were written with.
    path
        File for messages.
    lines
        Lines of the frames for messages, ``(frames,)``.

    Returns
    -------
    float
        Frame rate, hertz.

    Raises
    ------
    FileFormatError
        If there is one frame only, a time is missing or does not increase, or the times are
        uneven.
    """
    _check_increasing(times, "time", path=path, lines=lines)
    if len(times) < 2:
        raise FileFormatError(
            "one frame does not tell the rate", path=path, line=int(lines[0]), advice=_GIVE_RATE
        )
    mean = (len(times) - 1) / (times[-1] - times[0])
    resolution = 10.0**-decimals
    for candidate in (round(mean), round(mean, 1), *_KNOWN_RATES):
        if candidate > 0 and _compute_jitter(times, candidate) <= resolution * 1.01 + 1e-9:
            return float(candidate)
    allowed = max(0.25 / mean, resolution * 1.01)
    even = times[0] + np.arange(len(times)) / mean
    if (np.abs(times - even) > allowed).any():
        steps = np.diff(times)
        usual = float(np.median(steps))
        # Rounded, so that the first of two equal ones is reported.
        row = int(np.argmax(np.round(np.abs(steps - usual), 9)))
        raise FrameTimesError(
            "the times are not evenly spaced",
            path=path,
            line=int(lines[row + 1]),
            found=f"{steps[row]:.6g} s after the frame before",
            expected=f"{usual:.6g} s",
            advice="Resample the recording, or give its rate (rate=..., in hertz).",
        )
    return float(mean)


def check_consecutive(frame_numbers: FloatArray, *, path: Path, lines: NDArray[np.intp]) -> None:
    """Refuse frame numbers with a gap, because the times of the frames would be wrong.

    Parameters
    ----------
    frame_numbers
        Numbers of the frames, ``(frames,)``, no unit.
    path
        File for messages.
    lines
        Lines of the frames for messages, ``(frames,)``.

    Raises
    ------
    FileFormatError
        If a number is missing or is not one more than the number before.
    """
    _check_increasing(frame_numbers, "frame number", path=path, lines=lines)
    wrong = np.diff(frame_numbers) != 1
    if wrong.any():
        row = int(np.argmax(wrong)) + 1
        raise FrameTimesError(
            "frames are left out",
            path=path,
            line=int(lines[row]),
            found=f"frame {frame_numbers[row]:g} after frame {frame_numbers[row - 1]:g}",
            expected="consecutive frames",
            advice="Export the recording again, with frames that hold only gaps.",
        )


def _check_rate_against_times(
    rate: float, times: FloatArray, *, decimals: int, path: Path, lines: NDArray[np.intp]
) -> None:
    """Refuse times that contradict the rate of the header by more than 1 per cent."""
    _check_increasing(times, "time", path=path, lines=lines)
    if len(times) < 2:
        return
    duration = float(times[-1] - times[0])
    expected = (len(times) - 1) / rate
    if abs(duration - expected) > 0.01 * expected + 2.0 * 10.0**-decimals:
        raise RateMismatchError(
            "the header's rate and the times of the frames contradict each other",
            path=path,
            line=int(lines[-1]),
            found=f"{rate:g} Hz and {(len(times) - 1) / duration:.6g} Hz",
            advice="Find out which is right, and give it (rate=..., in hertz).",
        )


def _check_increasing(
    values: FloatArray, noun: str, *, path: Path, lines: NDArray[np.intp]
) -> None:
    """Refuse a column of times or frame numbers that has a gap or does not increase."""
    if np.isnan(values).any():
        row = int(np.argmax(np.isnan(values)))
        raise FrameTimesError(
            f"the frame has no {noun}", path=path, line=int(lines[row]), expected="a number"
        )
    wrong = np.diff(values) <= 0
    if wrong.any():
        row = int(np.argmax(wrong)) + 1
        raise FrameTimesError(
            f"the {noun} does not grow",
            path=path,
            line=int(lines[row]),
            found=f"{values[row]:g} after {values[row - 1]:g}",
            advice="Rows are missing, doubled or out of order; export the recording again.",
        )


def _compute_jitter(times: FloatArray, rate: float) -> float:
    """Return the width of the band of differences between times and an exact rate, seconds."""
    differences = times - np.arange(len(times)) / rate
    return float(np.ptp(differences))
