"""Plain CSV: a row a frame, three columns a marker.

Columns are separated by commas, semicolons or tabs; with the last two the decimal point may be a
comma. The header is one row (``time,nose_x,nose_y,nose_z``; a blank, point, colon or hyphen may
stand before the axis) or two (names above axes). A ``frame`` and a ``time`` column may come first,
time in seconds or, where its title says so, milliseconds. Lines that start with ``#`` are comments.

Positions are millimetres unless the titles have another unit (``nose_x [m]``). Gaps are blanks or
``NaN``; zeros are positions. The rate comes from the times, or from the caller. `start_time` is the
first time, and 0 where there is none.
"""

from __future__ import annotations

import os
from collections.abc import Sequence

from mocap_fit.errors import FileFormatError
from mocap_fit.io import finalise
from mocap_fit.io.csv_titles import EXAMPLE, Titles, parse_titles
from mocap_fit.io.names import name_tracks
from mocap_fit.io.number_table import read_numbers
from mocap_fit.io.text import TextFile, read_first_lines
from mocap_fit.io.timing import determine_timing
from mocap_fit.tracks import MarkerTracks

NAME = "csv"
description = "plain CSV with a column a coordinate"
extensions = (".csv",)


def sniff(path: str | os.PathLike[str]) -> bool:
    """Return whether the first rows are titles of markers' coordinates.

    Parameters
    ----------
    path
        The file.

    Returns
    -------
    bool
        Whether it looks like a CSV file of markers.
    """
    lines = [line for line in read_first_lines(path, 200) if _is_content(line)][:2]
    if not lines or lines[0].startswith("Frame\tTime\t"):
        return False
    try:
        parse_titles(lines)
    except FileFormatError:
        return False
    return True


def read(
    path: str | os.PathLike[str],
    *,
    names: Sequence[str] | None = None,
    rate: float | None = None,
    unit: str | None = None,
    subject: str | None = None,
) -> MarkerTracks:
    """Read the markers of a CSV file.

    Parameters
    ----------
    path
        File to read.
    names
        Names of the markers, in the order of the file; they replace those of the file.
    rate
        Frame rate, hertz; it replaces that of the times. Required where there are no times, or
        only one frame.
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
    MissingRateError
        If there are no times and no rate is given.
    FileFormatError
        With the file and the line, if the file does not follow its format.

    Warns
    -----
    MocapFitWarning
        If the file is cut off, or the unit is probably not the millimetre.
    """
    with TextFile(path) as text:
        titles, line = _read_titles(text)
        used = name_tracks(titles.names, names, path=text.path, subject=subject, line=line)
        unit = unit or titles.unit
        scale = finalise.get_millimetres(unit or "mm", path=text.path, line=line)
        lead = ["frame"] * titles.frame + ["time"] * (titles.time_unit is not None)
        columns = [*lead, *(f"{name} {axis}" for name in used.labels for axis in "xyz")]
        first_line = text.number + 1
        numbered, block = bool(lead), text.read_rest()
        table = read_numbers(
            block, columns, titles.separator, first_line, text.path, numbered=numbered
        )
    used_rate, start_time = determine_timing(
        table,
        frame=0 if titles.frame else None,
        time=None if titles.time_unit is None else titles.lead - 1,
        time_unit=titles.time_unit or 1.0,
        rate=rate,
        line=line,
    )
    return finalise.create_tracks(
        MarkerTracks,
        text.path,
        NAME,
        used,
        used_rate,
        {"positions": table.to_positions(titles.lead, scale)},
        start_time=start_time,
        arguments=finalise.list_arguments(used, rate, unit),
        unit_is_known=unit is not None,
    )


def _is_content(line: str) -> bool:
    return bool(line.strip()) and not line.lstrip().startswith("#")


def _read_titles(text: TextFile) -> tuple[Titles, int]:
    """Return the titles and the line they start in; the file is then at its first row."""
    lines: list[str] = []
    start = 1
    while len(lines) < 2 and (line := text.read_line()) is not None:
        if _is_content(line):
            if not lines:
                start = text.number
            lines.append(line)
    if not lines:
        raise FileFormatError(
            "the file holds no table", path=text.path, expected=f"columns {EXAMPLE}"
        )
    try:
        titles = parse_titles(lines)
    except FileFormatError as error:
        raise FileFormatError(
            error.problem,
            path=text.path,
            line=start,
            found=error.found,
            expected=error.expected,
            advice="Correct the titles in the first row, and take out columns of other data.",
        ) from None
    if titles.rows == 1 and len(lines) == 2:
        text.push_back()
    return titles, start
