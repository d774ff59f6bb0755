"""The frame rate and the start time of a recording, from its file and the times of its frames."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import numpy as np

from mocap_fit.errors import (
    FileFormatError,
    FrameTimesError,
    MissingRateError,
    MocapFitWarning,
    RateMismatchError,
)
from mocap_fit.io.number_table import NumberTable
from mocap_fit.tracks import FloatArray

# Relative difference between two rates that rounding may explain.
_SAME_RATE = 5e-4
_GIVE_RATE = "Give the rate of the recording (rate=..., in hertz)."
_KNOWN_RATES = (24000 / 1001, 30000 / 1001, 60000 / 1001, 120000 / 1001)

_LATEST = 1e12
"""Seconds: no recording begins so late; products of times are numbers."""

_SLOWEST = 2.0
"""Hertz: nothing is recorded so slowly; the times are probably milliseconds."""


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
    frame: int | None,
    time: int | None,
    time_unit: float = 1.0,
    rate: float | None = None,
    file_rate: float | None = None,
    line: int | None = None,
) -> tuple[float, float]:
    """Determine the rate and the start time of a table with a row a frame.

    The rate is that of the caller, else that of the header, else that of the times. Where the times
    of the frames drift from the header's rate by more than half a frame, theirs is used.

    Parameters
    ----------
    table
        Numbers of the file.
    frame
        Index of the column of frame numbers, which must be consecutive; None without one.
    time
        Index of the column of times; None without one.
    time_unit
        Unit of the times, seconds.
    rate
        Rate of the caller, hertz; it replaces that of the file.
    file_rate
        Rate in the header of the file, hertz.
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
        contradict the header without being even.

    Warns
    -----
    MocapFitWarning
        If the times are used in place of the header's rate, or are probably milliseconds; if the
        rate of the caller is another than that of the file.
    """
    if frame is not None:
        _check_consecutive(table, table.values[:, frame])
    rate = None if rate is None else check_rate(rate, path=table.path)
    known = file_rate if rate is None else rate
    if time is None:
        if known is None:
            advice = "Add times, or give the rate (rate=..., in hertz)."
            raise MissingRateError(
                "the file does not say its frame rate", path=table.path, line=line, advice=advice
            )
        warn_of_rate(table.path, rate, file_rate)
        return known, 0.0
    times = table.values[:, time] * time_unit
    far = np.abs(times) > _LATEST
    if far.any():
        row = int(np.argmax(far))
        raise _create_error(
            table,
            row,
            "a time is out of range",
            found=f"{times[row]:g} s",
            expected=f"within {_LATEST:g} s",
        )
    resolution = 10.0 ** (round(np.log10(time_unit)) - table.count_decimals(time))
    if known is None:
        known = _estimate_rate(table, times, resolution)
        if known < _SLOWEST:
            _warn(table, f"the times say {known:g} frames a second: are they milliseconds?")
    else:
        if _is_in_milliseconds(times, known):
            _warn(table, f"the times are taken as milliseconds, which fits {known:g} Hz")
            times, resolution = 0.001 * times, 0.001 * resolution
        if rate is None:
            known = _compare_clocks(table, known, times, resolution)
    start = float(times[0])
    if np.isnan(start):
        raise _create_error(table, 0, "the first frame has no time")
    if not (file_rate and file_rate > 0) and times[-1] > start:
        file_rate = (len(times) - 1) / float(times[-1] - start)
    warn_of_rate(table.path, rate, file_rate)
    return known, start


def warn_of_rate(path: Path, rate: float | None, file_rate: float | None) -> None:
    """Warn that the caller's frame rate is another than the file's.

    Parameters
    ----------
    path
        The file.
    rate
        Rate of the caller, hertz; None without one.
    file_rate
        Rate of the file, hertz; None where it does not say one.

    Warns
    -----
    MocapFitWarning
        If both are there and differ by more than rounding explains.
    """
    if rate and file_rate and file_rate > 0 and abs(file_rate / rate - 1.0) > _SAME_RATE:
        warnings.warn(
            f"{path}: the file says {file_rate:.6g} Hz; {rate:g} Hz is used, as given",
            MocapFitWarning,
            stacklevel=4,
        )


def _create_error(table: NumberTable, row: int, problem: str, **details: Any) -> FrameTimesError:
    return FrameTimesError(problem, path=table.path, line=int(table.lines[row]), **details)


def _warn(table: NumberTable, message: str) -> None:
    warnings.warn(f"{table.path}: {message}", MocapFitWarning, stacklevel=4)


def _is_in_milliseconds(times: FloatArray, rate: float) -> bool:
    """Return whether the times last a thousand times as long as the frames do at a known rate."""
    frames = rate * (times[-1] - times[0])
    return len(times) > 1 and bool(abs(frames / (len(times) - 1) - 1000) < 10)


def _estimate_rate(table: NumberTable, times: FloatArray, resolution: float) -> float:
    """Estimate the rate of evenly spaced times that were rounded when they were written.

    An integer rate, one with a single decimal, or one of the television rates is chosen where it
    explains all times; otherwise the mean rate.
    """
    _check_increasing(table, times, "time")
    if len(times) < 2:
        line = int(table.lines[0])
        raise FileFormatError(
            "one frame does not tell the rate", path=table.path, line=line, advice=_GIVE_RATE
        )
    mean = (len(times) - 1) / (times[-1] - times[0])
    frames = np.arange(len(times))
    for candidate in (round(mean), round(mean, 1), *_KNOWN_RATES):
        # The differences of rounded times from those of the exact rate lie in a narrow band.
        if candidate > 0 and np.ptp(times - frames / candidate) <= resolution * 1.01 + 1e-9:
            return float(candidate)
    allowed = max(0.25 / mean, resolution * 1.01)
    even = times[0] + frames / mean
    if (np.abs(times - even) > allowed).any():
        steps = np.diff(times)
        usual = float(np.median(steps))
        # The first of those that are equal but for rounding.
        apart = np.abs(steps - usual)
        row = int(np.argmax(apart >= (1 - 1e-9) * apart.max()))
        raise _create_error(
            table,
            row + 1,
            "the times are not evenly spaced",
            found=f"{steps[row]:.6g} s after the frame before",
            expected=f"{usual:.6g} s",
            advice="Resample the recording, or give its rate (rate=..., in hertz).",
        )
    return float(mean)


def _check_consecutive(table: NumberTable, numbers: FloatArray) -> None:
    """Refuse frame numbers with a gap, because the times of the frames would be wrong."""
    _check_increasing(table, numbers, "frame number")
    wrong = np.diff(numbers) != 1
    if wrong.any():
        row = int(np.argmax(wrong)) + 1
        raise _create_error(
            table,
            row,
            "frames are left out",
            found=f"frame {numbers[row]:g} after frame {numbers[row - 1]:g}",
            expected="consecutive frames",
            advice="Export the recording again, with frames that hold only gaps.",
        )


def _compare_clocks(
    table: NumberTable, file_rate: float, times: FloatArray, resolution: float
) -> float:
    """Return the header's rate, or that of the times where these drift from it evenly."""
    _check_increasing(table, times, "time")
    if len(times) < 2 or _find_drift(times, file_rate, resolution) is None:
        return file_rate
    rate = float((len(times) - 1) / (times[-1] - times[0]))
    row = _find_drift(times, rate, resolution)
    if row is not None:
        raise RateMismatchError(
            "the header's rate and the times of the frames contradict each other",
            path=table.path,
            line=int(table.lines[row]),
            frame=row,
            found=f"{file_rate:g} Hz and {rate:.6g} Hz, the frame at {times[row]:.6g} s",
            expected=f"{times[0] + row / rate:.6g} s, or less than half a frame from it",
            advice="Find out which rate is right, and give it (rate=..., in hertz).",
        )
    _warn(
        table,
        f"the header says {file_rate:g} Hz, but the times of the frames {rate:.6g} Hz, which is "
        "used; give the rate if the header is right",
    )
    return rate


def _find_drift(times: FloatArray, rate: float, resolution: float) -> int | None:
    """Return the first frame that is over half a frame from its time at a rate; None without."""
    drift = np.abs(times - times[0] - np.arange(len(times)) / rate)
    # The difference of two rounded times is off by one unit of their last digit.
    far = drift > max(0.5 / rate, resolution) * 1.001 + 1e-9
    return int(np.argmax(far)) if far.any() else None


def _check_increasing(table: NumberTable, values: FloatArray, noun: str) -> None:
    """Refuse a column of times or frame numbers that has a gap or does not increase."""
    if np.isnan(values).any():
        row = int(np.argmax(np.isnan(values)))
        raise _create_error(table, row, f"the frame has no {noun}", expected="a number")
    wrong = np.diff(values) <= 0
    if wrong.any():
        row = int(np.argmax(wrong)) + 1
        after = f"{values[row]:g} after {values[row - 1]:g}"
        advice = "Rows are missing, doubled or out of order; export the recording again."
        raise _create_error(table, row, f"the {noun} does not grow", found=after, advice=advice)
