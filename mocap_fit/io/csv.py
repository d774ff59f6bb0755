"""Plain CSV: a row a frame, three columns a marker.

Columns are separated by commas, semicolons or tabs; with the last two the decimal point may be a
comma. The header is one row (``time,nose_x,nose_y,nose_z``; a blank, point, colon or hyphen may
stand before the axis) or two (names above axes). A ``frame`` and a ``time`` column may come first,
time in seconds or, where its title says so, milliseconds. Lines that start with ``#`` are comments.

Positions are millimetres unless the titles say another unit (``nose_x [m]``). Gaps are blanks or
``NaN``; zeros are positions. The rate comes from the times, or from the caller. `start_time` is the
first time, and 0 where there is none.
"""

from __future__ import annotations

import csv
import os
import re
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from mocap_fit.errors import FileFormatError, MissingRateError, MocapFitWarning
from mocap_fit.io import finalise
from mocap_fit.io.number_table import (
    NumberTable,
    is_missing,
    number,
    read_number_blocks,
    read_numbers,
)
from mocap_fit.io.stretches import InOrder, rows_of
from mocap_fit.io.text import TextFile, first_lines
from mocap_fit.io.timing import check_consecutive, checked_rate, rate_from_times
from mocap_fit.tracks import FloatArray, MarkerTracks

NAME = "csv"
description = "plain CSV with a column a coordinate"
extensions = (".csv",)

Separator = Literal["\t", ";", ","]
_SEPARATORS: tuple[Separator, ...] = ("\t", ";", ",")
_FRAME_TITLES = frozenset(("frame", "frames", "frame#", "frame number", "frame_number"))
_TIME_TITLES = {
    **dict.fromkeys(("time", "times", "t", "time_s", "seconds", "sec", "timestamp"), 1.0),
    **dict.fromkeys(("time_ms", "milliseconds", "ms", "timestamp_ms"), 0.001),
}
_UNIT = re.compile(r"(.*?)\s*[\[(]\s*(\w+)\s*[\])]", re.DOTALL)
_AXIS = re.compile(r"(.*?)(?:[ _.:\-]+([xyzXYZ])|(?<=[a-z0-9])([XYZ]))", re.DOTALL)
_EXAMPLE = "time, NAME_x, NAME_y, NAME_z, ..."


@dataclass(frozen=True)
class _Titles:
    """What the header says: the separator, leading columns, markers, the unit."""

    separator: Separator
    frame: bool
    time_scale: float | None
    names: tuple[str, ...]
    unit: str | None
    rows: int


class _TitleError(Exception):
    """Why the titles are not those of markers; becomes a `FileFormatError` with the place."""

    def __init__(self, problem: str, found: str, expected: str) -> None:
        super().__init__(problem)
        self.problem, self.found, self.expected = problem, found, expected


def sniff(path: str | os.PathLike[str]) -> bool:
    """Whether the first rows are titles of markers' coordinates."""
    lines = [line for line in first_lines(path, 200) if _counts(line)][:2]
    if not lines or lines[0].startswith("Frame\tTime\t"):
        return False
    try:
        _titles(lines)
    except _TitleError:
        return False
    return True


def read(
    path: str | os.PathLike[str],
    *,
    names: Sequence[str] | None = None,
    rate: float | None = None,
) -> MarkerTracks:
    """Read the markers of a CSV file.

    Parameters
    ----------
    path
        The file.
    names
        Names of the markers in the order of the file, in place of the file's own.
    rate
        Frames per second, in place of what the times say. Needed where there are no times, or
        only one frame.

    Raises
    ------
    FileFormatError
        With the file and the line, if the file cannot be read as it stands.

    Warns
    -----
    MocapFitWarning
        If the file was cut off, or the positions are probably not millimetres.
    """
    with TextFile(path) as text:
        plan = _plan(text, names)
        table = read_numbers(
            text.rest().replace(b'"', b""),
            plan.columns,
            separator=plan.titles.separator,
            first_line=text.number + 1,
            path=text.path,
        )
    if plan.frame is not None:
        check_consecutive(table.values[:, plan.frame], path=text.path, lines=table.lines)
    start = _start(table, plan, text.path)
    used = _said_rate(plan, rate, text.path)
    if used is None:
        times = table.values[:, plan.time_column] * plan.time_scale
        used = rate_from_times(
            times, decimals=_decimals(table, plan), path=text.path, lines=table.lines
        )
    positions = table.values[:, plan.lead :].reshape(len(table.values), -1, 3) * plan.scale
    return finalise.markers(
        text.path,
        NAME,
        plan.names,
        used,
        positions,
        start_time=start,
        arguments=_arguments(plan, names, rate),
        unit_is_known=plan.titles.unit is not None,
    )


def stretches(
    path: str | os.PathLike[str],
    *,
    names: Sequence[str] | None = None,
    rate: float | None = None,
    frames: int,
) -> Iterator[MarkerTracks]:
    """Read a CSV file so many frames at a time; parameters and errors as for `read`.

    Where the times must tell the rate, the file is gone through twice.

    Yields
    ------
    MarkerTracks
        Together what `read` gives.
    """
    with TextFile(path) as text:
        plan = _plan(text, names)
        said = _said_rate(plan, rate, text.path)
        if said is None:
            said = _rate_of_all(path, names)
        tables = iter(InOrder(_blocks(text, plan), plan.frame, None, text.path))
        first = next(tables)
        made = finalise.Stretches(
            text.path,
            NAME,
            plan.names,
            said,
            start_time=_start(first, plan, text.path),
            arguments=_arguments(plan, names, rate),
            unit_is_known=plan.titles.unit is not None,
        )
        for positions in rows_of(chain([first], tables), plan.lead, frames):
            yield made.part(positions * plan.scale)
        made.finish()


@dataclass(frozen=True)
class _Plan:
    """What the titles say, and what the caller said of the names."""

    titles: _Titles
    line: int
    names: tuple[str, ...]
    scale: float

    @property
    def lead(self) -> int:
        """Columns before the first marker."""
        return self.titles.frame + (self.titles.time_scale is not None)

    @property
    def frame(self) -> int | None:
        return 0 if self.titles.frame else None

    @property
    def time_column(self) -> int:
        return self.lead - 1

    @property
    def time_scale(self) -> float:
        return self.titles.time_scale or 1.0

    @property
    def columns(self) -> list[str]:
        lead = ["frame"] * self.titles.frame + ["time"] * (self.titles.time_scale is not None)
        return [*lead, *(f"{name} {axis}" for name in self.names for axis in "xyz")]


def _plan(text: TextFile, names: Sequence[str] | None) -> _Plan:
    titles, line = _read_titles(text)
    chosen = finalise.chosen_names(titles.names, names, path=text.path, line=line) or ()
    scale = 1.0
    if titles.unit is not None:
        scale = finalise.millimetres(titles.unit, path=text.path, line=line)
    return _Plan(titles, line, chosen, scale)


def _blocks(text: TextFile, plan: _Plan) -> Iterator[NumberTable]:
    return read_number_blocks(
        (block.replace(b'"', b"") for block in text.blocks()),
        plan.columns,
        separator=plan.titles.separator,
        first_line=text.number + 1,
        path=text.path,
    )


def _start(table: NumberTable, plan: _Plan, path: Path) -> float:
    if plan.titles.time_scale is None:
        return 0.0
    start = float(table.values[0, plan.time_column] * plan.time_scale)
    if np.isnan(start):
        raise FileFormatError("the first frame has no time", path=path, line=int(table.lines[0]))
    return start


def _said_rate(plan: _Plan, rate: float | None, path: Path) -> float | None:
    """The rate of the caller; None where the times must tell it."""
    if rate is not None:
        return checked_rate(rate, path=path)
    if plan.titles.time_scale is None:
        raise MissingRateError(
            "the file does not say its frame rate",
            path=path,
            line=plan.line,
            advice="Add a time column in seconds, or give the rate (rate=..., in hertz).",
        )
    return None


def _decimals(table: NumberTable, plan: _Plan) -> int:
    return table.decimals(plan.time_column) + (3 if plan.time_scale != 1.0 else 0)


def _rate_of_all(path: str | os.PathLike[str], names: Sequence[str] | None) -> float:
    """The rate that the times of all frames say."""
    with TextFile(path) as text, warnings.catch_warnings():
        # What there is to warn of is told when the frames are read.
        warnings.simplefilter("ignore", MocapFitWarning)
        plan = _plan(text, names)
        times: list[FloatArray] = []
        lines: list[NDArray[np.intp]] = []
        decimals = 0
        for table in InOrder(_blocks(text, plan), plan.frame, None, text.path):
            decimals = decimals if times else _decimals(table, plan)
            times.append(table.values[:, plan.time_column] * plan.time_scale)
            lines.append(table.lines)
    return rate_from_times(
        np.concatenate(times), decimals=decimals, path=text.path, lines=np.concatenate(lines)
    )


def _arguments(plan: _Plan, names: Sequence[str] | None, rate: float | None) -> dict[str, Any]:
    """What the caller said and the unit, for the provenance."""
    arguments: dict[str, Any] = {}
    if rate is not None:
        arguments["rate"] = float(rate)
    if names is not None:
        arguments["names"] = list(plan.names)
    if plan.titles.unit is not None:
        arguments["unit"] = plan.titles.unit
    return arguments


def _counts(line: str) -> bool:
    return bool(line.strip()) and not line.lstrip().startswith("#")


def _read_titles(text: TextFile) -> tuple[_Titles, int]:
    """The titles and the line they start in; the file is then at its first row."""
    lines: list[str] = []
    start = 1
    while len(lines) < 2 and (line := text.line()) is not None:
        if _counts(line):
            if not lines:
                start = text.number
            lines.append(line)
    if not lines:
        raise FileFormatError(
            "the file holds no table", path=text.path, expected=f"columns {_EXAMPLE}"
        )
    try:
        titles = _titles(lines)
    except _TitleError as error:
        raise _title_fault(error, text.path, start) from None
    if titles.rows == 1 and len(lines) == 2:
        text.push_back()
    return titles, start


def _title_fault(error: _TitleError, path: Path, line: int) -> FileFormatError:
    return FileFormatError(
        error.problem,
        path=path,
        line=line,
        found=error.found,
        expected=error.expected,
        advice="Name the columns so in the first row, and take out columns that are no marker's.",
    )


def _titles(lines: list[str]) -> _Titles:
    """The titles in the first one or two rows.

    Raises
    ------
    _TitleError
        If they are not those of markers.
    """
    separator = max(_SEPARATORS, key=lambda mark: len(_cells(lines[0], mark)))
    first = _cells(lines[0], separator)
    second = _cells(lines[1], separator) if len(lines) > 1 else []
    axes = [_without_unit(cell)[0].lower() for cell in second]
    if sum(axis in ("x", "y", "z") for axis in axes) >= 3:
        return _two_rows(separator, first, second)
    if len(first) < 3:
        raise _TitleError("the first row is not one of column titles", lines[0][:60], _EXAMPLE)
    if all(is_missing(cell) or number(cell) is not None for cell in first):
        raise _TitleError("the first row holds numbers, not column titles", first[0], _EXAMPLE)
    return _one_row(separator, first)


def _cells(line: str, separator: Separator) -> list[str]:
    try:
        parts = next(csv.reader([line], delimiter=separator), [])
    except csv.Error as error:
        # A cell of over 100,000 characters, or a line end inside one.
        raise _TitleError("the row of titles cannot be split", str(error), _EXAMPLE) from None
    cells = [cell.strip() for cell in parts]
    while cells and not cells[-1]:
        cells.pop()
    return cells


def _one_row(separator: Separator, cells: list[str]) -> _Titles:
    frame, time_scale, lead = _lead(cells)
    names: list[str] = []
    axes: list[str] = []
    units: set[str] = set()
    for title in cells[lead:]:
        plain, unit = _without_unit(title)
        match = _AXIS.fullmatch(plain)
        if match is None or not match[1]:
            raise _TitleError("a column is no marker's coordinate", f"'{title}'", _EXAMPLE)
        names.append(match[1].strip())
        axes.append((match[2] or match[3]).lower())
        units |= {unit} if unit else set()
    return _assembled(separator, frame, time_scale, names, axes, units, 1)


def _two_rows(separator: Separator, first: list[str], second: list[str]) -> _Titles:
    width = max(len(first), len(second))
    first = first + [""] * (width - len(first))
    second = second + [""] * (width - len(second))
    lead_cells = [below or above for above, below in zip(first, second, strict=True)]
    frame, time_scale, lead = _lead(lead_cells)
    if lead == 0:
        lead_cells = [above or below for above, below in zip(first, second, strict=True)]
        frame, time_scale, lead = _lead(lead_cells)
    names: list[str] = []
    axes: list[str] = []
    units: set[str] = set()
    for above, below in zip(first[lead:], second[lead:], strict=True):
        plain, unit = _without_unit(below)
        units |= {unit} if unit else set()
        if plain.lower() not in ("x", "y", "z"):
            raise _TitleError("a column is no marker's coordinate", f"'{below}'", "x, y or z")
        if not above and not names:
            raise _TitleError("the first marker has no name", "a blank cell", "a name")
        names.append(above or names[-1])
        axes.append(plain.lower())
    return _assembled(separator, frame, time_scale, names, axes, units, 2)


def _assembled(
    separator: Separator,
    frame: bool,
    time_scale: float | None,
    names: list[str],
    axes: list[str],
    units: set[str],
    rows: int,
) -> _Titles:
    if not names:
        raise _TitleError("the table has no marker", "no column of coordinates", _EXAMPLE)
    for place in range(0, len(names), 3):
        triple, of = axes[place : place + 3], names[place : place + 3]
        if triple != ["x", "y", "z"] or len(set(of)) != 1:
            found = ", ".join(f"{name} {axis}" for name, axis in zip(of, triple, strict=True))
            raise _TitleError(
                "the columns do not come in threes", found, f"{of[0]} x, {of[0]} y, {of[0]} z"
            )
    if len(units) > 1:
        raise _TitleError("the columns have several units", ", ".join(sorted(units)), "one unit")
    return _Titles(separator, frame, time_scale, tuple(names[::3]), next(iter(units), None), rows)


def _lead(cells: list[str]) -> tuple[bool, float | None, int]:
    """Whether the first columns are the frame's number and time, the time's unit, their count."""
    place, frame, time_scale = 0, False, None
    if cells and cells[0].lower() in _FRAME_TITLES:
        place, frame = 1, True
    if len(cells) > place:
        plain, unit = _without_unit(cells[place])
        title = plain.lower() if unit in (None, "s") else f"{plain.lower()}_{unit}"
        if title in _TIME_TITLES:
            place, time_scale = place + 1, _TIME_TITLES[title]
    return frame, time_scale, place


def _without_unit(title: str) -> tuple[str, str | None]:
    match = _UNIT.fullmatch(title)
    return (match[1], match[2]) if match else (title, None)
