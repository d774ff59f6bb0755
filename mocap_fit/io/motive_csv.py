"""CSV exports of OptiTrack's Motive, format versions 1.1 to 1.25.

A line of settings, then rows that say the type, the name, the quantity and the axis of each column,
then a row a frame. Read are the positions of measured markers (type ``Marker``). What Motive
computes is left out: rigid bodies, bones, and the places where these expect their markers. An
export that holds only such expected markers is read with a warning, their origin is
`Origin.VIRTUAL`.

Positions are in the unit of the line of settings, in the axes of the file (Motive's y points up).
Gaps are blanks; zeros are positions. The rate is that of the export, or else that of the capture.
`start_time` is the time of the first row.
"""

from __future__ import annotations

import itertools
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
from mocap_fit.io.number_table import parse_number, read_numbers
from mocap_fit.io.text import TextFile, read_first_lines, split_cells
from mocap_fit.io.timing import check_rate, determine_timing
from mocap_fit.tracks import MarkerTracks, Origin

NAME = "motive-csv"
description = "CSV export of OptiTrack Motive"
extensions = (".csv",)

_MOST_ROWS = 20
"""Rows of titles; there are four to six."""


@dataclass(frozen=True)
class _Column:
    """What the titles say of a column, in lower case but for the name."""

    kind: str
    name: str
    quantity: str
    axis: str

    @property
    def title(self) -> str:
        """The column in messages."""
        return " ".join(filter(None, (self.name, self.quantity, self.axis)))


def sniff(path: str | os.PathLike[str]) -> bool:
    """Return whether a file starts with ``Format Version``.

    Parameters
    ----------
    path
        The file.

    Returns
    -------
    bool
        Whether it looks like an export of Motive.
    """
    lines = [line for line in read_first_lines(path, 5) if line.strip()]
    return bool(lines) and lines[0].lstrip(' "').startswith("Format Version")


def read(
    path: str | os.PathLike[str],
    *,
    names: Sequence[str] | None = None,
    rate: float | None = None,
    unit: str | None = None,
    subject: str | None = None,
) -> MarkerTracks:
    """Read the markers of a Motive export.

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
        Asset whose markers alone are read, where the names have assets (``Face:chin``).

    Returns
    -------
    MarkerTracks
        Positions in millimetres, in the axes of the file.

    Raises
    ------
    FileFormatError
        With the file and the line, if the file does not follow its format, or holds no markers.

    Warns
    -----
    MocapFitWarning
        If the file is cut off, or holds expected markers only.
    """
    with TextFile(path) as text:
        try:
            settings, separator = _read_settings(text)
            columns = _read_titles(text, separator)
        except FileFormatError as error:
            raise add_path(error, text.path) from None
        titles_line, first_line = text.number, text.number + 1
        starts, is_measured = _find_markers(text, columns)
        labels = [columns[start].name for start in starts]
        used = name_tracks(labels, names, path=text.path, subject=subject, line=titles_line)
        block = text.read_rest()
    axes = [column.axis for column in columns[: starts[0]]]
    time = next((i for i, axis in enumerate(axes) if re.match(r"time\b(?! ?code)", axis)), None)
    lead = [0] if time is None else [0, time]
    rows = parse_number(settings.get("total exported frames", ""))
    table = read_numbers(
        *(block, [column.title for column in columns], separator, first_line, text.path),
        None if rows is None or not rows > 0 else int(rows),
        used=[*lead, *(start + axis for start in starts for axis in range(3))],
        numbered=True,
    )
    unit = unit or settings.get("length units")
    if unit is None:
        raise FileFormatError(
            "the export does not say its unit of length",
            path=text.path,
            line=1,
            expected="Length Units",
            advice="Give the unit (unit=...); Motive's own is the metre.",
        )
    scale = finalise.get_millimetres(unit, path=text.path, line=1)
    rates = [
        check_rate(value, path=text.path, line=1)
        for word in ("export frame rate", "capture frame rate")
        if (value := parse_number(settings.get(word, ""))) is not None and not np.isnan(value)
    ]
    used_rate, start_time = determine_timing(
        table,
        # Every second frame has every second number where the export is slower.
        frame=0 if len(set(rates)) < 2 or time is None else None,
        time=None if time is None else 1,
        rate=rate,
        file_rate=rates[0] if rates and rate is None else None,
        line=1,
    )
    positions = table.to_positions(len(lead), scale)
    origin = Origin.MEASURED if is_measured else Origin.VIRTUAL
    origins = np.where(np.isnan(positions).any(axis=2), Origin.MISSING, origin)
    return finalise.create_tracks(
        MarkerTracks,
        text.path,
        NAME,
        used,
        used_rate,
        {"positions": positions, "origin": origins.astype(np.uint8)},
        start_time=start_time,
        arguments=finalise.list_arguments(used, rate, unit),
    )


def _read_settings(text: TextFile) -> tuple[dict[str, str], Separator]:
    """Return the settings by their words in lower case, and the separator of the file."""
    line = text.read_line()
    while line is not None and not line.strip(" \t,;"):
        line = text.read_line()
    separator = find_separator(line or "")
    cells = split_cells(line or "", separator)
    if not cells or cells[0] != "Format Version":
        raise FileFormatError(
            "this is not an export of Motive",
            line=max(text.number, 1),
            found=(line or "")[:40],
            expected="Format Version",
            advice="Check that it is the file you mean.",
        )
    if len(cells) > 1 and not re.match(r"1([.,]|$)", cells[1]):
        warnings.warn(
            f"{text.path}, line {text.number}: version {cells[1]:.20} of Motive's export is not "
            "known; the file is read like version 1.25",
            MocapFitWarning,
            stacklevel=3,
        )
    # Notes may hold commas, which move what follows by a cell.
    pairs = itertools.pairwise(cells)
    return {word.lower(): value for word, value in reversed(list(pairs)) if value}, separator


def _read_titles(text: TextFile, separator: Separator) -> list[_Column]:
    """Return the columns from the rows of titles, the last of which begins with ``Frame``."""
    rows: list[list[str]] = []
    while (line := text.read_line()) is not None and len(rows) < _MOST_ROWS:
        cells = split_cells(line, separator)
        if cells:
            rows.append(cells)
        if cells and cells[0].lower() == "frame":
            break
    if len(rows) < 4 or rows[-1][0].lower() != "frame":
        raise FileFormatError(
            "the titles of the columns are missing",
            line=max(text.number, 1),
            expected="rows of types, names and quantities, and one that begins with Frame",
            advice="Export the recording again, with the header.",
        )
    words = [next((cell.lower() for cell in row[:2] if cell), "") for row in rows[:-1]]
    # Some programs that write like Motive leave the words Type and Name out.
    types = rows[words.index("type") if "type" in words else 0]
    labels = rows[words.index("name") if "name" in words else 1]
    width = max(len(row) for row in rows)
    wide = [row + [""] * (width - len(row)) for row in (types, labels, rows[-2], rows[-1])]
    return [
        _Column(kind.lower(), name, quantity.lower(), axis.lower())
        for kind, name, quantity, axis in zip(*wide, strict=True)
    ]


def _find_markers(text: TextFile, columns: list[_Column]) -> tuple[list[int], bool]:
    """Return the columns of the markers' x, and whether they are measured."""
    starts: dict[bool, list[int]] = {True: [], False: []}
    for start in range(len(columns) - 2):
        three = columns[start : start + 3]
        axes = [column.axis for column in three]
        of_one = len({(column.kind, column.name, column.quantity) for column in three}) == 1
        if axes == ["x", "y", "z"] and of_one and three[0].quantity == "position":
            if three[0].kind == "marker":
                starts[True].append(start)
            elif three[0].kind.endswith(" marker"):
                starts[False].append(start)
    if not starts[True] and not starts[False]:
        kinds = dict.fromkeys(column.kind for column in columns if column.kind not in ("", "type"))
        raise FileFormatError(
            "the export holds no markers",
            path=text.path,
            line=text.number,
            found=", ".join(kinds) or "no type of any column",
            expected="Marker",
            advice="Export the recording again, with markers.",
        )
    if not starts[True]:
        warnings.warn(
            f"{text.path}: the markers are those that Motive expects from its rigid bodies and "
            "bones, not measured ones; export with markers",
            MocapFitWarning,
            stacklevel=3,
        )
    return starts[bool(starts[True])], bool(starts[True])
