"""The titles of a CSV file of markers."""

from __future__ import annotations

import csv
import re
from dataclasses import dataclass
from typing import Literal

from mocap_fit.errors import FileFormatError
from mocap_fit.io.number_table import is_missing, parse_number

Separator = Literal["\t", ";", ","]
EXAMPLE = "time, NAME_x, NAME_y, NAME_z, ..."
"""Titles of a valid file, for messages."""

_SEPARATORS: tuple[Separator, ...] = ("\t", ";", ",")
_FRAME_TITLES = frozenset(("frame", "frames", "frame#", "frame number", "frame_number"))
_TIME_TITLES = {
    **dict.fromkeys(("time", "times", "t", "time_s", "seconds", "sec", "timestamp"), 1.0),
    **dict.fromkeys(("time_ms", "milliseconds", "ms", "timestamp_ms"), 0.001),
}
_UNIT = re.compile(r"(.*?)\s*[\[(]\s*(\w+)\s*[\])]", re.DOTALL)
_AXIS = re.compile(r"(.*?)(?:[ _.:\-]+([xyzXYZ])|(?<=[a-z0-9])([XYZ]))", re.DOTALL)


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
    separator = max(_SEPARATORS, key=lambda mark: len(_split_cells(lines[0], mark)))
    first = _split_cells(lines[0], separator)
    second = _split_cells(lines[1], separator) if len(lines) > 1 else []
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


def _split_cells(line: str, separator: Separator) -> list[str]:
    try:
        parts = next(csv.reader([line], delimiter=separator), [])
    except csv.Error as error:
        # A cell of over 100,000 characters, or a line end inside one.
        raise FileFormatError(
            "the row of titles cannot be split", found=str(error), expected=EXAMPLE
        ) from None
    cells = [cell.strip() for cell in parts]
    while cells and not cells[-1]:
        cells.pop()
    return cells


def _parse_one_row(separator: Separator, cells: list[str]) -> Titles:
    frame, time_unit, lead = _parse_lead(cells)
    names: list[str] = []
    axes: list[str] = []
    units: set[str] = set()
    for title in cells[lead:]:
        plain, unit = _split_unit(title)
        match = _AXIS.fullmatch(plain)
        if match is None or not match[1]:
            raise FileFormatError(
                "a column is not the coordinate of a marker", found=f"'{title}'", expected=EXAMPLE
            )
        names.append(match[1].strip())
        axes.append((match[2] or match[3]).lower())
        units |= {unit} if unit else set()
    return _assemble(separator, frame, time_unit, names, axes, units, 1)


def _parse_two_rows(separator: Separator, first: list[str], second: list[str]) -> Titles:
    width = max(len(first), len(second))
    first = first + [""] * (width - len(first))
    second = second + [""] * (width - len(second))
    lead_cells = [below or above for above, below in zip(first, second, strict=True)]
    frame, time_unit, lead = _parse_lead(lead_cells)
    if lead == 0:
        lead_cells = [above or below for above, below in zip(first, second, strict=True)]
        frame, time_unit, lead = _parse_lead(lead_cells)
    names: list[str] = []
    axes: list[str] = []
    units: set[str] = set()
    for above, below in zip(first[lead:], second[lead:], strict=True):
        plain, unit = _split_unit(below)
        units |= {unit} if unit else set()
        if plain.lower() not in ("x", "y", "z"):
            raise FileFormatError(
                "a column is not the coordinate of a marker",
                found=f"'{below}'",
                expected="x, y or z",
            )
        if not above and not names:
            raise FileFormatError(
                "the first marker has no name", found="a blank cell", expected="a name"
            )
        names.append(above or names[-1])
        axes.append(plain.lower())
    return _assemble(separator, frame, time_unit, names, axes, units, 2)


def _assemble(
    separator: Separator,
    frame: bool,
    time_unit: float | None,
    names: list[str],
    axes: list[str],
    units: set[str],
    rows: int,
) -> Titles:
    if not names:
        raise FileFormatError(
            "the table has no marker", found="no column of coordinates", expected=EXAMPLE
        )
    for start in range(0, len(names), 3):
        triple, owners = axes[start : start + 3], names[start : start + 3]
        if triple != ["x", "y", "z"] or len(set(owners)) != 1:
            listed = ", ".join(f"{name} {axis}" for name, axis in zip(owners, triple, strict=True))
            first = owners[0]
            raise FileFormatError(
                "the columns do not come in threes",
                found=listed,
                expected=f"{first} x, {first} y, {first} z",
            )
    if len(units) > 1:
        raise FileFormatError(
            "the columns have several units", found=", ".join(sorted(units)), expected="one unit"
        )
    return Titles(separator, frame, time_unit, tuple(names[::3]), next(iter(units), None), rows)


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
    match = _UNIT.fullmatch(title)
    return (match[1], match[2]) if match else (title, None)
