"""The rate of a recording, from what its file says and from the times of its frames."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mocap_fit.errors import FileFormatError
from mocap_fit.tracks import FloatArray

_GIVE_RATE = "Give the rate of the recording (rate=..., in hertz)."
_KNOWN_RATES = (24000 / 1001, 30000 / 1001, 60000 / 1001, 120000 / 1001)


def checked_rate(rate: float, *, path: Path, line: int | None = None) -> float:
    """A rate that is a finite number above 0.

    Raises
    ------
    FileFormatError
        If it is not.
    """
    if not np.isfinite(rate) or rate <= 0:
        raise FileFormatError(
            "the frame rate is not possible",
            path=path,
            line=line,
            found=f"{rate:g} Hz",
            expected="a number above 0",
            advice=_GIVE_RATE,
        )
    return float(rate)


def rate_from_times(
    times: FloatArray, *, decimals: int, path: Path, lines: NDArray[np.intp]
) -> float:
    """The rate of evenly spaced times that were rounded when they were written.

    A whole rate, a tenth, or one of the television rates is taken where it explains all times;
    the mean rate otherwise.

    Parameters
    ----------
    times
        `(frames,)`, seconds.
    decimals
        Digits after the point that the times were written with.
    path, lines
        For messages: the file, and the line of each frame.

    Raises
    ------
    FileFormatError
        If there is one frame only, a time is missing or does not grow, or the times are uneven.
    """
    check_growing(times, "time", path=path, lines=lines)
    if len(times) < 2:
        raise FileFormatError(
            "one frame does not tell the rate", path=path, line=int(lines[0]), advice=_GIVE_RATE
        )
    mean = (len(times) - 1) / (times[-1] - times[0])
    resolution = 10.0**-decimals
    for candidate in (round(mean), round(mean, 1), *_KNOWN_RATES):
        if candidate > 0 and _misfit(times, candidate) <= resolution * 1.01 + 1e-9:
            return float(candidate)
    allowed = max(0.25 / mean, resolution * 1.01)
    even = times[0] + np.arange(len(times)) / mean
    if (np.abs(times - even) > allowed).any():
        steps = np.diff(times)
        usual = float(np.median(steps))
        # Rounded, so that of two equal ones the first is told.
        row = int(np.argmax(np.round(np.abs(steps - usual), 9)))
        raise FileFormatError(
            "the times are not evenly spaced",
            path=path,
            line=int(lines[row + 1]),
            found=f"{steps[row]:.6g} s after the frame before",
            expected=f"{usual:.6g} s",
            advice="Resample the recording, or give its rate (rate=..., in hertz).",
        )
    return float(mean)


def check_rate_against_times(
    rate: float, times: FloatArray, *, decimals: int, path: Path, lines: NDArray[np.intp]
) -> None:
    """Refuse times that say another rate than the header, by more than one in a hundred.

    Raises
    ------
    FileFormatError
        If they contradict each other, or a time is missing or does not grow.
    """
    check_growing(times, "time", path=path, lines=lines)
    check_rate_against_ends(
        rate,
        float(times[0]),
        float(times[-1]),
        len(times),
        decimals=decimals,
        path=path,
        line=int(lines[-1]),
    )


def check_rate_against_ends(
    rate: float, first: float, last: float, frames: int, *, decimals: int, path: Path, line: int
) -> None:
    """As `check_rate_against_times`, where the first and the last time are all that is at hand.

    Raises
    ------
    FileFormatError
        If they contradict each other.
    """
    if frames < 2:
        return
    duration = last - first
    expected = (frames - 1) / rate
    if abs(duration - expected) > 0.01 * expected + 2.0 * 10.0**-decimals:
        raise FileFormatError(
            "the header's rate and the times of the frames contradict each other",
            path=path,
            line=line,
            found=f"{rate:g} Hz and {(frames - 1) / duration:.6g} Hz",
            advice="Find out which is right, and give it (rate=..., in hertz).",
        )


def check_growing(values: FloatArray, what: str, *, path: Path, lines: NDArray[np.intp]) -> None:
    """Refuse a column of times or frame numbers with a gap, or one that does not grow.

    Raises
    ------
    FileFormatError
        With the first line that is wrong.
    """
    if np.isnan(values).any():
        row = int(np.argmax(np.isnan(values)))
        raise FileFormatError(
            f"the frame has no {what}", path=path, line=int(lines[row]), expected="a number"
        )
    wrong = np.diff(values) <= 0
    if wrong.any():
        row = int(np.argmax(wrong)) + 1
        raise FileFormatError(
            f"the {what} does not grow",
            path=path,
            line=int(lines[row]),
            found=f"{values[row]:g} after {values[row - 1]:g}",
            advice="Rows are missing, doubled or out of order; export the recording again.",
        )


def check_consecutive(frame_numbers: FloatArray, *, path: Path, lines: NDArray[np.intp]) -> None:
    """Refuse frame numbers that leave one out, for the frames' times would be wrong.

    Raises
    ------
    FileFormatError
        With the first line that is wrong.
    """
    check_growing(frame_numbers, "frame number", path=path, lines=lines)
    wrong = np.diff(frame_numbers) != 1
    if wrong.any():
        row = int(np.argmax(wrong)) + 1
        raise FileFormatError(
            "frames are left out",
            path=path,
            line=int(lines[row]),
            found=f"frame {frame_numbers[row]:g} after frame {frame_numbers[row - 1]:g}",
            expected="consecutive frames",
            advice="Export the recording again, with frames that hold only gaps.",
        )


def _misfit(times: FloatArray, rate: float) -> float:
    """Width of the band that holds the differences between the times and an exact rate."""
    differences = times - np.arange(len(times)) / rate
    return float(np.ptp(differences))
