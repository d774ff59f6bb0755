"""The header of a Qualisys TSV export: one keyword a line, then perhaps a row of column titles."""

from __future__ import annotations

import math
import re
import warnings
from dataclasses import dataclass, field
from pathlib import Path

from mocap_fit.errors import FileFormatError, MocapFitWarning
from mocap_fit.io.number_table import is_missing, number
from mocap_fit.io.text import TextFile
from mocap_fit.io.timing import checked_rate
from mocap_fit.tracks import Event

KNOWN_KEYWORDS = frozenset(
    (
        "FILE_VERSION",
        "NO_OF_FRAMES",
        "NO_OF_CAMERAS",
        "NO_OF_MARKERS",
        "NO_OF_BODIES",
        "FREQUENCY",
        "NO_OF_ANALOG",
        "ANALOG_FREQUENCY",
        "DESCRIPTION",
        "TIME_STAMP",
        "DATA_INCLUDED",
        "EVENT",
        "MARKER_NAMES",
        "BODY_NAMES",
        "TRAJECTORY_TYPES",
        "NO_OF_DATA_TYPES",
        "DATA_TYPES",
    )
)

_KEYWORD = re.compile(r"[A-Z][A-Z0-9]*(_[A-Z0-9]+)*")


@dataclass(frozen=True)
class Header:
    """What stands above the numbers.

    Parameters
    ----------
    path
        The file.
    values
        The cells after each keyword, without blank ones at the end.
    lines
        The line of each keyword.
    events
        The events, in the order of the file.
    titles
        The column titles, without blank ones at the end; None where there is no such row.
    titles_line
        The line of the titles.
    first_row_line
        The line of the first row of numbers.
    first_row
        The cells of that row; none where the file ends before it.
    """

    path: Path
    values: dict[str, tuple[str, ...]] = field(default_factory=dict)
    lines: dict[str, int] = field(default_factory=dict)
    events: tuple[tuple[int, tuple[str, ...]], ...] = ()
    titles: tuple[str, ...] | None = None
    titles_line: int | None = None
    first_row_line: int = 1
    first_row: tuple[str, ...] = ()

    def text(self, keyword: str) -> str | None:
        """The first cell after a keyword; None where there is none."""
        cells = self.values.get(keyword, ())
        return cells[0] if cells else None

    def count(self, keyword: str) -> int | None:
        """A whole number of 0 or more; None where the keyword is absent.

        Raises
        ------
        FileFormatError
            If it is something else.
        """
        if keyword not in self.values:
            return None
        text = self.text(keyword) or ""
        if not re.fullmatch(r"[0-9]{1,12}", text):
            raise FileFormatError(
                f"{keyword} is not a count",
                path=self.path,
                line=self.lines[keyword],
                found=f"'{text}'",
                expected="a whole number",
                advice="Correct it, or export the recording again.",
            )
        return int(text)

    def rate(self) -> float | None:
        """The frame rate; None where it is absent, or `EXT` for an external timebase.

        Raises
        ------
        FileFormatError
            If it is no number above 0.
        """
        text = self.text("FREQUENCY")
        if text is None or text.upper() == "EXT":
            return None
        value = number(text)
        line = self.lines["FREQUENCY"]
        if value is None or math.isnan(value):
            raise FileFormatError(
                "FREQUENCY is not a number",
                path=self.path,
                line=line,
                found=f"'{text}'",
                expected="a rate in hertz, or EXT",
                advice="Correct it, or give the rate (rate=..., in hertz).",
            )
        return checked_rate(value, path=self.path, line=line)


def is_keyword(cell: str) -> bool:
    """Whether a line that starts with this cell belongs to the header."""
    word = cell.strip()
    return len(word) > 2 and bool(_KEYWORD.fullmatch(word)) and not is_missing(word)


def is_title_row(cells: list[str]) -> bool:
    """Whether most of the cells that hold something are not numbers."""
    filled = [cell for cell in cells if not is_missing(cell)]
    words = sum(number(cell) is None for cell in filled)
    return bool(filled) and 2 * words > len(filled)


def read_header(text: TextFile) -> Header:
    """Read all that stands above the numbers; the file is then at its first row.

    Raises
    ------
    FileFormatError
        If a line is too long, a keyword comes twice, or an event is not whole.
    """
    values: dict[str, tuple[str, ...]] = {}
    lines: dict[str, int] = {}
    events: list[tuple[int, tuple[str, ...]]] = []
    titles: tuple[str, ...] | None = None
    titles_line: int | None = None
    first_row: tuple[str, ...] = ()
    while (line := text.line()) is not None:
        cells = line.split("\t")
        if not line.strip(" "):
            continue
        if titles is None and is_keyword(cells[0]):
            keyword = cells[0].strip()
            if keyword == "EVENT":
                events.append((text.number, _trimmed(cells[1:])))
                continue
            if keyword in values:
                raise FileFormatError(
                    f"{keyword} comes twice",
                    path=text.path,
                    line=text.number,
                    found=f"also in line {lines[keyword]}",
                    advice="Export the recording again.",
                )
            values[keyword], lines[keyword] = _trimmed(cells[1:]), text.number
        elif titles is None and is_title_row(cells):
            titles, titles_line = _trimmed(cells), text.number
        else:
            first_row = tuple(cells)
            text.push_back()
            break
    header = Header(
        text.path,
        values,
        lines,
        tuple(events),
        titles,
        titles_line,
        text.number + 1,
        first_row,
    )
    _check_version(header)
    return header


def read_events(header: Header, rate: float) -> tuple[Event, ...]:
    """The events: name, frame, time in seconds.

    The time may be left out; frame 1 is then at time 0.

    Raises
    ------
    FileFormatError
        If an event has no name, or neither a frame nor a time.
    """
    events = []
    for line, cells in header.events:
        name = cells[0] if cells else ""
        numbers = [number(cell) for cell in cells[1:3]]
        time = numbers[1] if len(numbers) > 1 else None
        if time is None and len(cells) < 3 and numbers and numbers[0] is not None:
            time = (numbers[0] - 1) / rate
        if not name or time is None or not math.isfinite(time):
            raise FileFormatError(
                "the event is not whole",
                path=header.path,
                line=line,
                found="\t".join(cells) or "nothing",
                expected="a name, a frame and a time in seconds",
                advice="Correct the line or take it out.",
            )
        events.append(Event(name, time))
    return tuple(events)


def _trimmed(cells: list[str]) -> tuple[str, ...]:
    stripped = [cell.strip() for cell in cells]
    while stripped and not stripped[-1]:
        stripped.pop()
    return tuple(stripped)


def _check_version(header: Header) -> None:
    version = header.text("FILE_VERSION")
    if version is not None and not re.match(r"[12](\.|$)", version):
        warnings.warn(
            f"{header.path}, line {header.lines['FILE_VERSION']}: version {version} of the export "
            "format is not known; the file is read like version 2",
            MocapFitWarning,
            stacklevel=3,
        )
