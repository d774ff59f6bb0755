"""TRC files of Motion Analysis and OpenSim, also those that a spreadsheet saved.

Three lines of header, a line of marker names, a line of axes, optional blank lines, and a row a
frame: number, time, three coordinates a marker. Cells are separated by tabs, which may be doubled,
in files of some programs by blanks, and in those of spreadsheets by commas or semicolons; they may
be in quotation marks.
Trajectories without a name, between or behind the named ones, are left out.

The unit is that of the header. Gaps are blanks, and in the files of some converters ``0`` three
times; both become NaN, so that a point measured at exactly (0, 0, 0) is lost. The axes stay as they
are in the file; OpenSim's y points up.

`start_time` is the time of the first row.
"""

from __future__ import annotations

import os
import re
import warnings
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mocap_fit.errors import FileFormatError, MocapFitWarning, add_path
from mocap_fit.io import finalise
from mocap_fit.io.csv_titles import Separator, find_separator
from mocap_fit.io.names import name_tracks
from mocap_fit.io.number_table import NumberTable, parse_number, read_numbers
from mocap_fit.io.qualisys_header import is_title_row
from mocap_fit.io.text import TextFile, decode_line, read_first_lines, split_cells
from mocap_fit.io.timing import check_rate, determine_timing
from mocap_fit.tracks import MarkerTracks

NAME = "trc"
description = "TRC markers of Motion Analysis or OpenSim"
extensions = (".trc",)

_AGAIN = "Export the recording again."


@dataclass(frozen=True)
class _Markers:
    """The named trajectories: which ones, from 0, and the column of the first one's x."""

    labels: tuple[str, ...]
    trajectories: tuple[int, ...]
    start: int


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
    return bool(lines) and lines[0].lstrip('"').startswith("PathFileType")


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
        If the file is cut off, trajectories have no name, the number of markers in the header is
        wrong, or its rate is not that of the times.
    """
    with TextFile(path) as text:
        try:
            values, separator, filled = _read_header(text)
            axes = _read_axes(text, separator)
        except FileFormatError as error:
            raise add_path(error, text.path) from None
        expected_rows, first_line = _parse_count(text, values, "NumFrames"), text.number + 1
        block = text.read_rest()
    match = re.search(rb"[^\s,;\"][^\n]*", block)
    row = decode_line(match[0] if match else b"")
    if separator == "\t" and "\t" not in row:
        block = b"\n".join(b"\t".join(line.split()) for line in block.split(b"\n"))
        row = "\t".join(row.split())
    elif separator == "\t" and not re.search(r"(?<!\t)\t(?!\t)", row):
        block, row = block.replace(b"\t\t", b"\t"), row.replace("\t\t", "\t")
    markers = _locate_markers(filled, axes, row.split(separator))
    used = name_tracks(markers.labels, names, path=text.path, subject=subject, line=4)
    columns = ["frame", "time", *("the blank column",) * (markers.start - 2)]
    titles = dict(zip(markers.trajectories, used.labels, strict=True))
    for number in range(max(titles) + 1):
        columns += [f"{titles.get(number, f'trajectory {number + 1}')} {axis}" for axis in "XYZ"]
    cells = [markers.start + 3 * number + axis for number in titles for axis in range(3)]
    table = read_numbers(
        *(block, columns, separator, first_line, text.path, expected_rows),
        used=[*range(markers.start), *cells],
        numbered=True,
        unnamed=True,
    )
    _check_markers(text, values, markers, table)
    unit = unit or values.get("units")
    if unit is None:
        raise FileFormatError(
            "the header has no Units",
            path=text.path,
            line=2,
            expected="mm or m",
            advice="Give the unit (unit=...), or export the recording again.",
        )
    scale = finalise.get_millimetres(unit, path=text.path, line=3)
    said = parse_number(values.get("datarate", ""))
    file_rate = _parse_rate(text, values) if rate is None else said
    used_rate, start_time = determine_timing(table, frame=0, time=1, rate=rate, file_rate=file_rate)
    return finalise.create_tracks(
        MarkerTracks,
        text.path,
        NAME,
        used,
        used_rate,
        {"positions": finalise.mark_zeros(table.to_positions(markers.start, scale))},
        start_time=start_time,
        arguments=finalise.list_arguments(used, rate, unit),
    )


def _read_header(text: TextFile) -> tuple[dict[str, str], Separator, list[tuple[int, str]]]:
    """Return the values of line 3 by the words of line 2, the separator, and the names' cells."""
    first = text.read_line() or ""
    if not first.lstrip('"').startswith("PathFileType"):
        raise FileFormatError(
            "this is not a TRC file",
            path=text.path,
            line=1,
            found=first[:40],
            expected="PathFileType",
            advice="Check that it is the file you mean.",
        )
    lines = [line for _ in range(3) if (line := text.read_line()) is not None]
    if len(lines) < 3:
        raise FileFormatError(
            "the file is cut off in its header", path=text.path, line=text.number, advice=_AGAIN
        )
    if not re.search(r"[\t,;]", lines[2]):
        lines[2] = "\t".join(lines[2].split())
    separator = find_separator(lines[2])
    words, values = (line.replace('"', "").split(separator) for line in lines[:2])
    if len(words) < 3:
        words, values = (line.split() for line in lines[:2])
    filled = [[cell for cell in cells if cell.strip()] for cells in (words, values)]
    # Doubled tabs move the cells of one line against those of the other.
    if len(filled[0]) == len(filled[1]):
        words, values = filled
    pairs = zip(words, values, strict=False)
    by_word = {word.strip().lower(): value.strip() for word, value in pairs if value.strip()}
    cells = _list_cells(lines[2], separator)
    starts = [cell.lower().replace(" ", "") for _, cell in cells[:2]]
    if len(starts) < 2 or starts[0] not in ("frame#", "frame") or not starts[1].startswith("time"):
        raise FileFormatError(
            "the line of marker names is missing",
            path=text.path,
            line=text.number,
            found=", ".join(cell for _, cell in cells[:2])[:60],
            expected="Frame# and Time, then the markers",
            advice=_AGAIN,
        )
    if len(cells) == 2:
        raise FileFormatError(
            "the file names no marker", path=text.path, line=text.number, advice=_AGAIN
        )
    return by_word, separator, cells[2:]


def _read_axes(text: TextFile, separator: Separator) -> list[int]:
    """Return the columns of the axes in line 5; none where it is the first row."""
    line = text.read_line()
    cells = [] if line is None else _list_cells(line, separator)
    if line is not None and not is_title_row([cell for _, cell in cells]):
        text.push_back()
        return []
    return [column for column, cell in cells if cell[0] in "XYZxyz"]


def _list_cells(line: str, separator: Separator) -> list[tuple[int, str]]:
    """Return the filled cells of a line with their columns."""
    return [(column, cell) for column, cell in enumerate(split_cells(line, separator)) if cell]


def _locate_markers(filled: list[tuple[int, str]], axes: list[int], row: list[str]) -> _Markers:
    """Determine which trajectories the names stand above, from the first row of numbers."""
    columns, names = zip(*filled, strict=True)
    if names[::3] == names[1::3] == names[2::3] and columns[-1] - columns[0] == len(names) - 1:
        # The name stands above each of the three axes.
        filled = filled[::3]
    start = axes[0] if axes and not "".join(row[2 : axes[0]]).strip() else 2
    start = max(start, 2)
    steps, rest = np.divmod(np.array([column for column, _ in filled]) - start, 3)
    # Blank cells between the names are trajectories without a name if there are as many; else
    # tabs are doubled or left out in that line.
    count = max(len(axes), len("\t".join(row).rstrip().split("\t")) - start) // 3
    if rest.any() or steps[0] < 0 or steps[-1] >= count:
        steps = np.arange(len(filled))
    labels = tuple(name for _, name in filled)
    return _Markers(labels, tuple(int(step) for step in steps), start)


def _check_markers(
    text: TextFile, values: dict[str, str], markers: _Markers, table: NumberTable
) -> None:
    """Refuse numbers under no title; warn of what has no name, and of a wrong count."""
    if not np.isnan(table.values[:, 2 : markers.start]).all():
        raise FileFormatError(
            "the numbers are not under the titles of their columns",
            path=text.path,
            line=int(table.lines[0]),
            expected=f"a blank cell in column {markers.start}",
            advice=_AGAIN,
        )
    announced, named = _parse_count(text, values, "NumMarkers"), len(markers.labels)
    unnamed = max(markers.trajectories) + 1 - named + table.surplus // 3
    if unnamed:
        message = f"{unnamed} {'trajectory' if unnamed == 1 else 'trajectories'} without a name"
        message += f" beside the {named} named markers; not read"
    elif announced not in (None, named):
        message = f"line 3: NumMarkers is {announced}, but {named} markers are named and read"
    else:
        return
    warnings.warn(f"{text.path}, {message}", MocapFitWarning, stacklevel=3)


def _parse_rate(text: TextFile, values: dict[str, str]) -> float | None:
    if "datarate" not in values:
        return None
    rate = parse_number(values["datarate"])
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
    number = parse_number(value)
    if number is None or not 0 <= number < 1e12 or number % 1:
        raise FileFormatError(
            f"{word} is not a count",
            path=text.path,
            line=3,
            found=f"'{value}'",
            expected="an integer",
            advice=_AGAIN,
        )
    return int(number)
