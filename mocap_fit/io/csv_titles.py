"""The titles of a CSV file of markers."""

from __future__ import annotations

import re
from dataclasses import dataclass
from itertools import zip_longest
from typing import Literal

from mocap_fit.errors import FileFormatError
from mocap_fit.io.number_table import is_missing, parse_number
from mocap_fit.io.text import split_cells

Separator = Literal["\t", ";", ","]
EXAMPLE = "time, NAME_x, NAME_y, NAME_z, ..."
"""Titles of a valid file, for messages."""

_SEPARATORS: tuple[Separator, ...] = ("\t", ";", ",")
_FRAME_TITLES = frozenset(("frame", "frames", "frame#", "frame number", "frame_number"))
_TIME_TITLES = {
    **dict.fromkeys(("time", "times", "t", "time_s", "seconds", "sec", "timestamp"), 1.0),
    **dict.fromkeys(("time_ms", "milliseconds", "ms", "timestamp_ms"), 0.001),
}
# Name of the marker, axis, and unit of a column.
Column = tuple[str, str, str | None]


@dataclass(frozen=True)
class Titles:
    """The titles of a CSV file.

    Parameters
    ----------
    separator
        Separator of the cells.
    frame
        Whether the first column is the number of the frame.
    time_unit
        Unit of the time column, seconds; None without one.
    names
        Names of the markers.
    unit
        Unit of length; None where the titles have none.
    rows
        Number of rows of titles, 1 or 2.
    """

    separator: Separator
    frame: bool
    time_unit: float | None
    names: tuple[str, ...]
    unit: str | None
    rows: int

    @property
    def lead(self) -> int:
        """Number of columns before the first marker."""
        return self.frame + (self.time_unit is not None)


def find_separator(line: str) -> Separator:
    """Return the separator that splits a line into the most cells.

    Parameters
    ----------
    line
        A row of titles.

    Returns
    -------
    str
        A tab, a semicolon or a comma.

    Raises
    ------
    FileFormatError
        Without a path, if the line cannot be split.
    """
    return max(_SEPARATORS, key=lambda mark: len(split_cells(line, mark)))


def parse_titles(lines: list[str]) -> Titles:
    """Parse the titles in the first one or two rows.

    Parameters
    ----------
    lines
        The first two lines that are neither blank nor comments.

    Returns
    -------
    Titles
        The titles.

    Raises
    ------
    FileFormatError
        Without a path, if they are not those of markers.
    """
    separator = find_separator(lines[0])
    first = split_cells(lines[0], separator)
    second = split_cells(lines[1], separator) if len(lines) > 1 else []
    axes = [_split_unit(cell)[0].lower() for cell in second]
    if sum(axis in ("x", "y", "z") for axis in axes) >= 3:
        return _parse_two_rows(separator, first, second)
    if len(first) < 3:
        raise FileFormatError(
            "the first row holds no column titles", found=lines[0][:60], expected=EXAMPLE
        )
    if all(is_missing(cell) or parse_number(cell) is not None for cell in first):
        raise FileFormatError(
            "the first row holds numbers, not column titles", found=first[0], expected=EXAMPLE
        )
    return _parse_one_row(separator, first)


def _parse_one_row(separator: Separator, cells: list[str]) -> Titles:
    frame, time_unit, lead = _parse_lead(cells)
    columns: list[Column] = []
    for title in cells[lead:]:
        plain, unit = _split_unit(title)
        name, axis = _split_axis(plain)
        if not name or axis not in ("x", "y", "z"):
            raise FileFormatError(
                "a column is not the coordinate of a marker", found=f"'{title}'", expected=EXAMPLE
            )
        columns.append((name, axis, unit))
    return Titles(separator, frame, time_unit, *_join_columns(columns), 1)


def _parse_two_rows(separator: Separator, first: list[str], second: list[str]) -> Titles:
    rows = list(zip_longest(first, second, fillvalue=""))
    frame, time_unit, lead = _parse_lead([below or above for above, below in rows])
    if lead == 0:
        frame, time_unit, lead = _parse_lead([above or below for above, below in rows])
    columns: list[Column] = []
    for above, below in rows[lead:]:
        plain, unit = _split_unit(below)
        if plain.lower() not in ("x", "y", "z"):
            problem = "a column is not the coordinate of a marker"
            raise FileFormatError(problem, found=f"'{below}'", expected="x, y or z")
        if not above and not columns:
            raise FileFormatError(
                "the first marker has no name", found="a blank cell", expected="a name"
            )
        columns.append((above or columns[-1][0], plain.lower(), unit))
    return Titles(separator, frame, time_unit, *_join_columns(columns), 2)


def _join_columns(columns: list[Column]) -> tuple[tuple[str, ...], str | None]:
    """Return the names of the markers and the unit of their columns."""
    if not columns:
        raise FileFormatError(
            "the table has no marker", found="no column of coordinates", expected=EXAMPLE
        )
    for start in range(0, len(columns), 3):
        owners, axes, _ = zip(*columns[start : start + 3], strict=True)
        if axes != ("x", "y", "z") or len(set(owners)) != 1:
            listed = ", ".join(f"{name} {axis}" for name, axis in zip(owners, axes, strict=True))
            expected = ", ".join(f"{owners[0]} {axis}" for axis in "xyz")
            problem = "the columns do not come in threes"
            raise FileFormatError(problem, found=listed, expected=expected)
    units = {unit for *_, unit in columns if unit}
    if len(units) > 1:
        raise FileFormatError(
            "the columns have several units", found=", ".join(sorted(units)), expected="one unit"
        )
    return tuple(name for name, *_ in columns[::3]), next(iter(units), None)


def _parse_lead(cells: list[str]) -> tuple[bool, float | None, int]:
    """Return whether there is a frame column, the unit of the time column, and their number."""
    width, frame, time_unit = 0, False, None
    if cells and cells[0].lower() in _FRAME_TITLES:
        width, frame = 1, True
    if len(cells) > width:
        plain, unit = _split_unit(cells[width])
        title = plain.lower() if unit in (None, "s") else f"{plain.lower()}_{unit}"
        if title in _TIME_TITLES:
            width, time_unit = width + 1, _TIME_TITLES[title]
    return frame, time_unit, width


def _split_unit(title: str) -> tuple[str, str | None]:
    """Return the title without the unit in brackets at its end, and that unit."""
    opening = max(title.rfind("["), title.rfind("("))
    unit = title[opening + 1 : -1].strip()
    if opening < 0 or title[-1] not in "])" or not re.fullmatch(r"\w+", unit):
        return title, None
    return title[:opening].rstrip(), unit


def _split_axis(title: str) -> tuple[str, str]:
    """Return the marker and the axis of a title; no marker where it is not a coordinate."""
    stem, axis = title[:-1], title[-1:]
    name = stem.rstrip(" _.:-")
    joined = axis.isupper() and (stem[-1:].islower() or stem[-1:].isdigit())
    return (name.strip() if joined or name != stem else "", axis.lower())
