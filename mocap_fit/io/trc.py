"""TRC files of Motion Analysis and OpenSim.

Three lines of header, a line of marker names, a line of axes, perhaps a blank line, and a row a
frame: number, time, three coordinates a marker. The unit is the header's. Gaps are blanks, and in
the files of some converters ``0`` three times: both become NaN, so that a point measured at exactly
(0, 0, 0) is lost. The axes stay as they are in the file; OpenSim's y points up.

`start_time` is the time of the first row.
"""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from typing import Any

import numpy as np

from mocap_fit.errors import FileFormatError
from mocap_fit.io import finalise
from mocap_fit.io.number_table import number, read_numbers
from mocap_fit.io.qualisys_header import is_title_row
from mocap_fit.io.text import TextFile, first_lines
from mocap_fit.io.timing import check_consecutive, check_rate_against_times, checked_rate
from mocap_fit.tracks import MarkerTracks

NAME = "trc"
description = "TRC markers of Motion Analysis or OpenSim"
extensions = (".trc",)

_AGAIN = "Export the recording again."


def sniff(path: str | os.PathLike[str]) -> bool:
    """Whether the file starts with ``PathFileType``."""
    lines = first_lines(path, 1, 4096)
    return bool(lines) and lines[0].startswith("PathFileType")


def read(
    path: str | os.PathLike[str],
    *,
    names: Sequence[str] | None = None,
    rate: float | None = None,
) -> MarkerTracks:
    """Read the markers of a TRC file.

    Parameters
    ----------
    path
        The file.
    names
        Names of the markers in the order of the file, in place of the file's own.
    rate
        Frames per second, in place of the file's own.

    Raises
    ------
    FileFormatError
        With the file and the line, if the file cannot be read as it stands.

    Warns
    -----
    MocapFitWarning
        If the file was cut off.
    """
    with TextFile(path) as text:
        values = _header_values(text)
        found = _marker_names(text)
        announced = _count(text, values, "NumMarkers")
        if announced is not None and announced != len(found):
            raise FileFormatError(
                "NumMarkers and the marker names contradict each other",
                path=text.path,
                line=3,
                found=f"{announced} and {len(found)} names",
                advice=_AGAIN,
            )
        marker_names = finalise.chosen_names(found, names, path=text.path, line=4) or ()
        columns = ["frame", "time", *(f"{name} {axis}" for name in marker_names for axis in "XYZ")]
        frames = _count(text, values, "NumFrames")
        table = read_numbers(
            text.rest(),
            columns,
            separator="\t",
            first_line=text.number + 1,
            path=text.path,
            expected_rows=frames,
        )
    if "units" not in values:
        raise FileFormatError(
            "the header has no Units", path=text.path, line=2, expected="mm or m", advice=_AGAIN
        )
    scale = finalise.millimetres(values["units"], path=text.path, line=3)
    times, decimals = table.values[:, 1], table.decimals(1)
    check_consecutive(table.values[:, 0], path=text.path, lines=table.lines)
    arguments: dict[str, Any] = {"unit": values["units"]}
    if rate is not None:
        arguments["rate"] = rate = checked_rate(rate, path=text.path)
    else:
        said = number(values.get("datarate", ""))
        if said is None:
            raise FileFormatError(
                "DataRate is not a number",
                path=text.path,
                line=3,
                found=f"'{values['datarate']}'",
                advice="Correct it, or give the rate (rate=..., in hertz).",
            )
        rate = checked_rate(said, path=text.path, line=3)
        check_rate_against_times(rate, times, decimals=decimals, path=text.path, lines=table.lines)
    if np.isnan(times[0]):
        raise FileFormatError(
            "the first frame has no time", path=text.path, line=int(table.lines[0])
        )
    if names is not None:
        arguments["names"] = list(marker_names)
    positions = table.values[:, 2:].reshape(len(table.values), -1, 3)
    positions = np.where((positions == 0).all(axis=2, keepdims=True), np.nan, positions) * scale
    return finalise.markers(
        text.path,
        NAME,
        marker_names,
        rate,
        positions,
        start_time=float(times[0]),
        arguments=arguments,
        unit_is_known=True,
    )


def _header_values(text: TextFile) -> dict[str, str]:
    """The words of line 2, in lower case, with the values of line 3."""
    first = text.line() or ""
    if not first.startswith("PathFileType"):
        raise FileFormatError(
            "this is not a TRC file",
            path=text.path,
            line=1,
            found=first[:40],
            expected="PathFileType",
            advice="Check that it is the file you mean.",
        )
    lines = [text.line(), text.line()]
    if None in lines:
        raise _cut_off(text)
    words, values = ((line or "").split("\t") for line in lines)
    if len(words) < 3:
        words, values = ((line or "").split() for line in lines)
    pairs = zip(words, values, strict=False)
    return {word.strip().lower(): value.strip() for word, value in pairs if word.strip()}


def _marker_names(text: TextFile) -> list[str]:
    """The names of line 4, each of which is followed by two blank cells; line 5 is passed."""
    line = text.line()
    if line is None:
        raise _cut_off(text)
    cells = [cell.strip() for cell in line.split("\t")]
    if [cell.lower() for cell in cells[:2]] not in (["frame#", "time"], ["frame", "time"]):
        raise FileFormatError(
            "the line of marker names is not where it belongs",
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
    axes = text.line()
    if axes is not None and not is_title_row(axes.split("\t")):
        text.push_back()
    return names


def _count(text: TextFile, values: dict[str, str], word: str) -> int | None:
    value = values.get(word.lower())
    if value is None:
        return None
    if not re.fullmatch(r"[0-9]{1,12}", value):
        raise FileFormatError(
            f"{word} is not a count",
            path=text.path,
            line=3,
            found=f"'{value}'",
            expected="a whole number",
            advice=_AGAIN,
        )
    return int(value)


def _cut_off(text: TextFile) -> FileFormatError:
    return FileFormatError(
        "the file is cut off in its header", path=text.path, line=text.number, advice=_AGAIN
    )
