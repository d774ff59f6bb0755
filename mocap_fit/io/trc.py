"""TRC files of Motion Analysis and OpenSim.

Three lines of header, a line of marker names, a line of axes, an optional blank line, and a row a
frame: number, time, three coordinates a marker. The unit is that of the header. Gaps are blanks,
and in the files of some converters ``0`` three times; both become NaN, so that a point measured at
exactly (0, 0, 0) is lost. The axes stay as they are in the file; OpenSim's y points up.

`start_time` is the time of the first row.
"""

from __future__ import annotations

import os
import re
from collections.abc import Sequence

from mocap_fit.errors import FileFormatError
from mocap_fit.io import finalise
from mocap_fit.io.names import name_tracks
from mocap_fit.io.number_table import parse_number, read_numbers
from mocap_fit.io.qualisys_header import is_title_row
from mocap_fit.io.text import TextFile, read_first_lines
from mocap_fit.io.timing import check_rate, determine_timing
from mocap_fit.tracks import MarkerTracks

NAME = "trc"
description = "TRC markers of Motion Analysis or OpenSim"
extensions = (".trc",)

_AGAIN = "Export the recording again."


def sniff(path: str | os.PathLike[str]) -> bool:
    """Return whether a file starts with ``PathFileType``.

    Parameters
    ----------
    path
        The file.

    Returns
    -------
    bool
        Whether it looks like a TRC file.
    """
    lines = read_first_lines(path, 1, 4096)
    return bool(lines) and lines[0].startswith("PathFileType")


def read(
    path: str | os.PathLike[str],
    *,
    names: Sequence[str] | None = None,
    rate: float | None = None,
    unit: str | None = None,
    subject: str | None = None,
) -> MarkerTracks:
    """Read the markers of a TRC file.

    Parameters
    ----------
    path
        File to read.
    names
        Names of the markers, in the order of the file; they replace those of the file.
    rate
        Frame rate, hertz; it replaces that of the file.
    unit
        Unit of length of the file, such as ``m``; it replaces that of the file.
    subject
        Subject whose tracks alone are read, where the names have subjects.

    Returns
    -------
    MarkerTracks
        Positions in millimetres, in the axes of the file.

    Raises
    ------
    FileFormatError
        With the file and the line, if the file does not follow its format.

    Warns
    -----
    MocapFitWarning
        If the file is cut off.
    """
    with TextFile(path) as text:
        values = _read_header(text)
        file_names = _read_names(text)
        announced = _parse_count(text, values, "NumMarkers")
        if announced is not None and announced != len(file_names):
            raise FileFormatError(
                "NumMarkers and the marker names contradict each other",
                path=text.path,
                line=3,
                found=f"{announced} and {len(file_names)} names",
                advice=_AGAIN,
            )
        used = name_tracks(file_names, names, path=text.path, subject=subject, line=4)
        columns = ["frame", "time", *(f"{name} {axis}" for name in used.labels for axis in "XYZ")]
        expected_rows, first_line = _parse_count(text, values, "NumFrames"), text.number + 1
        table = read_numbers(text.read_rest(), columns, "\t", first_line, text.path, expected_rows)
    unit = unit or values.get("units")
    if unit is None:
        raise FileFormatError(
            "the header has no Units", path=text.path, line=2, expected="mm or m", advice=_AGAIN
        )
    scale = finalise.get_millimetres(unit, path=text.path, line=3)
    file_rate = _parse_rate(text, values) if rate is None else None
    used_rate, start_time = determine_timing(table, frame=0, time=1, rate=rate, file_rate=file_rate)
    return finalise.create_tracks(
        MarkerTracks,
        text.path,
        NAME,
        used,
        used_rate,
        {"positions": finalise.mark_zeros(table.to_positions(2)) * scale},
        start_time=start_time,
        arguments=finalise.list_arguments(used, rate, unit),
    )


def _read_header(text: TextFile) -> dict[str, str]:
    """Return the values of line 3 by the words of line 2, in lower case."""
    first = text.read_line() or ""
    if not first.startswith("PathFileType"):
        raise FileFormatError(
            "this is not a TRC file",
            path=text.path,
            line=1,
            found=first[:40],
            expected="PathFileType",
            advice="Check that it is the file you mean.",
        )
    lines = [text.read_line(), text.read_line()]
    if None in lines:
        raise _create_cut_off_error(text)
    words, values = ((line or "").split("\t") for line in lines)
    if len(words) < 3:
        words, values = ((line or "").split() for line in lines)
    pairs = zip(words, values, strict=False)
    return {word.strip().lower(): value.strip() for word, value in pairs if word.strip()}


def _read_names(text: TextFile) -> list[str]:
    """Return the names of line 4, with two blank cells after each, and pass line 5."""
    line = text.read_line()
    if line is None:
        raise _create_cut_off_error(text)
    cells = [cell.strip() for cell in line.split("\t")]
    if [cell.lower() for cell in cells[:2]] not in (["frame#", "time"], ["frame", "time"]):
        raise FileFormatError(
            "the line of marker names is missing",
            path=text.path,
            line=text.number,
            found="\t".join(cells[:2])[:60],
            expected="Frame# and Time, then the markers",
            advice=_AGAIN,
        )
    names = [cell for cell in cells[2:] if cell]
    if not names:
        raise FileFormatError(
            "the file names no marker", path=text.path, line=text.number, advice=_AGAIN
        )
    axes = text.read_line()
    if axes is not None and not is_title_row(axes.split("\t")):
        text.push_back()
    return names


def _parse_rate(text: TextFile, values: dict[str, str]) -> float:
    rate = parse_number(values.get("datarate", ""))
    if rate is None:
        raise FileFormatError(
            "DataRate is not a number",
            path=text.path,
            line=3,
            found=f"'{values['datarate']}'",
            advice="Correct it, or give the rate (rate=..., in hertz).",
        )
    return check_rate(rate, path=text.path, line=3)


def _parse_count(text: TextFile, values: dict[str, str], word: str) -> int | None:
    value = values.get(word.lower())
    if value is None:
        return None
    if not re.fullmatch(r"[0-9]{1,12}", value):
        raise FileFormatError(
            f"{word} is not a count",
            path=text.path,
            line=3,
            found=f"'{value}'",
            expected="an integer",
            advice=_AGAIN,
        )
    return int(value)


def _create_cut_off_error(text: TextFile) -> FileFormatError:
    return FileFormatError(
        "the file is cut off in its header", path=text.path, line=text.number, advice=_AGAIN
    )
