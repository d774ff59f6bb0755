"""The header of a Qualisys TSV export: one keyword a line, then an optional row of titles."""

from __future__ import annotations

import math
import re
import warnings
from dataclasses import dataclass, field
from pathlib import Path

from mocap_fit.errors import FileFormatError, MocapFitWarning, add_path
from mocap_fit.io.number_table import is_missing, parse_number
from mocap_fit.io.text import TextFile, split_cells
from mocap_fit.io.timing import check_rate
from mocap_fit.tracks import Event

KNOWN_KEYWORDS = frozenset(
    (
        *("FILE_VERSION", "DESCRIPTION", "TIME_STAMP", "DATA_INCLUDED", "EVENT"),
        *("NO_OF_FRAMES", "NO_OF_CAMERAS", "NO_OF_MARKERS", "NO_OF_BODIES", "NO_OF_ANALOG"),
        *("FREQUENCY", "ANALOG_FREQUENCY", "MARKER_NAMES", "BODY_NAMES", "TRAJECTORY_TYPES"),
        *("NO_OF_DATA_TYPES", "DATA_TYPES"),
    )
)

_COUNTS = {
    "MARKER_NAMES": "NO_OF_MARKERS",
    "BODY_NAMES": "NO_OF_BODIES",
    "TRAJECTORY_TYPES": "NO_OF_MARKERS",
}
"""Keywords with a cell for each marker or body, and those that count these."""

_UNUSED = frozenset(
    ("TIME_STAMP", "DESCRIPTION", "NO_OF_CAMERAS", "NO_OF_ANALOG", "ANALOG_FREQUENCY")
)
"""Keywords that some exports have twice, and that nothing depends on."""

_KEYWORD = re.compile(r"[A-Z][A-Z0-9]*(_[A-Z0-9]+)*")


@dataclass
class Header:
    """The header of an export, and its first row of numbers.

    Parameters
    ----------
    path
        File for messages.
    values
        Cells after each keyword, without blank ones at the end.
    lines
        Line of each keyword.
    events
        Line and cells of each event, in the order of the file.
    titles
        Titles of the columns, without blank ones at the end; None where there is no such row.
    titles_line
        Line of the titles.
    first_row_line
        Line of the first row of numbers.
    first_row
        Cells of that row; empty where the file ends before it.
    """

    path: Path
    values: dict[str, tuple[str, ...]] = field(default_factory=dict)
    lines: dict[str, int] = field(default_factory=dict)
    events: list[tuple[int, tuple[str, ...]]] = field(default_factory=list)
    titles: tuple[str, ...] | None = None
    titles_line: int | None = None
    first_row_line: int = 1
    first_row: tuple[str, ...] = ()

    def get_text(self, keyword: str) -> str | None:
        """Return the first cell after a keyword.

        Parameters
        ----------
        keyword
            Keyword of the header.

        Returns
        -------
        str or None
            The cell; None where there is none.
        """
        cells = self.values.get(keyword, ())
        return cells[0] if cells else None

    def get_count(self, keyword: str) -> int | None:
        """Return the integer after a keyword.

        Parameters
        ----------
        keyword
            Keyword of the header.

        Returns
        -------
        int or None
            0 or more; None where the keyword is absent.

        Raises
        ------
        FileFormatError
            If the cell is not an integer of 0 or more.
        """
        if keyword not in self.values:
            return None
        text = self.get_text(keyword) or ""
        if not re.fullmatch(r"[0-9]{1,12}", text):
            raise FileFormatError(
                f"{keyword} is not a count",
                path=self.path,
                line=self.lines[keyword],
                found=f"'{text}'",
                expected="an integer",
                advice="Correct it, or export the recording again.",
            )
        return int(text)

    def get_rate(self) -> float | None:
        """Return the frame rate.

        Returns
        -------
        float or None
            Rate, hertz; None where it is absent, or ``EXT`` for an external timebase.

        Raises
        ------
        FileFormatError
            If it is not a number above 0.
        """
        text = self.get_text("FREQUENCY")
        if text is None or text.upper() == "EXT":
            return None
        value = parse_number(text)
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
        return check_rate(value, path=self.path, line=line)


def _is_keyword(cell: str) -> bool:
    """Return whether a line that starts with this cell belongs to the header."""
    word = cell.strip()
    return len(word) > 2 and bool(_KEYWORD.fullmatch(word)) and not is_missing(word)


def split_line(line: str) -> list[str]:
    """Split a line of the header; a blank may stand for the tab after a known keyword.

    Parameters
    ----------
    line
        The line.

    Returns
    -------
    list of str
        The cells, without blanks around them.

    Raises
    ------
    FileFormatError
        Without a path, if the line cannot be split.
    """
    cells = [cell.strip() for cell in line.split("\t")]
    if '"' in line:
        cells = split_cells(line, "\t") or [""]
    words = cells[0].split(None, 1)
    known = words[:1] and (words[0] in KNOWN_KEYWORDS or words == ["Frame", "Time"])
    return words + cells[1:] if known else cells


def is_title_row(cells: list[str]) -> bool:
    """Return whether most cells of a row that are not blank are not numbers.

    Parameters
    ----------
    cells
        Cells of the row.

    Returns
    -------
    bool
        Whether it is a row of titles.
    """
    filled = [cell for cell in cells if not is_missing(cell)]
    words = sum(parse_number(cell) is None for cell in filled)
    return bool(filled) and 2 * words > len(filled)


def read_header(text: TextFile) -> Header:
    """Read the header; the file is then at its first row of numbers.

    Parameters
    ----------
    text
        File at its beginning.

    Returns
    -------
    Header
        The header and the first row.

    Raises
    ------
    FileFormatError
        If a line is too long or a keyword comes twice with different values.

    Warns
    -----
    MocapFitWarning
        If the version of the format is not known.
    """
    header = Header(text.path)
    while (line := text.read_line()) is not None:
        if not line.strip(" "):
            continue
        try:
            cells = split_line(line)
        except FileFormatError as error:
            raise add_path(error, text.path) from None
        if (
            not any(cells)
            and "NO_OF_FRAMES" in header.values
            and not _COUNTS.keys() & header.values
        ):
            # A blank line in the header, as a spreadsheet saves it.
            continue
        if header.titles is None and _is_keyword(cells[0]):
            keyword = cells[0]
            values = tuple(cells[1:]) if keyword in _COUNTS else _trim(cells[1:])
            if keyword == "EVENT":
                # All in one cell where blanks stand for the tabs.
                values = tuple(values[0].rsplit(None, 2)) if len(values) == 1 else values
                header.events.append((text.number, values))
                continue
            if keyword in _UNUSED or values == header.values.get(keyword):
                header.values.setdefault(keyword, values)
                header.lines.setdefault(keyword, text.number)
                continue
            if keyword in header.values:
                raise FileFormatError(
                    f"{keyword} comes twice",
                    path=text.path,
                    line=text.number,
                    found=f"also in line {header.lines[keyword]}",
                    advice="Export the recording again.",
                )
            header.values[keyword], header.lines[keyword] = values, text.number
        elif header.titles is None and is_title_row(cells):
            header.titles, header.titles_line = _trim(cells), text.number
        else:
            header.first_row = tuple(cells)
            text.push_back()
            break
    header.first_row_line = text.number + 1
    for keyword in _COUNTS:
        _trim_cells(header, keyword)
    _check_version(header)
    return header


def read_events(header: Header, rate: float) -> tuple[Event, ...]:
    """Return the events of a recording.

    Parameters
    ----------
    header
        Header of the file: name, frame and time of each event. The time may be missing; frame 1
        is then at time 0.
    rate
        Frame rate, hertz.

    Returns
    -------
    tuple of Event
        The events in the order of the file.

    Raises
    ------
    FileFormatError
        If an event has no name, or neither a frame nor a time.
    """
    events = []
    for line, cells in header.events:
        name = cells[0] if cells else ""
        numbers = [parse_number(cell) for cell in cells[1:3]]
        time = numbers[1] if len(numbers) > 1 else None
        if time is None and len(cells) < 3 and numbers and numbers[0] is not None:
            time = (numbers[0] - 1) / rate
        if not name or time is None or not math.isfinite(time):
            raise FileFormatError(
                "the event is incomplete",
                path=header.path,
                line=line,
                found="\t".join(cells) or "nothing",
                expected="a name, a frame and a time in seconds",
                advice="Correct the line or take it out.",
            )
        events.append(Event(name, time))
    return tuple(events)


def _trim_cells(header: Header, keyword: str) -> None:
    """Cut off blank cells behind the announced number; split at blanks what has no tabs."""
    cells = list(header.values.get(keyword, ()))
    text = header.get_text(_COUNTS[keyword]) or ""
    count = int(text) if re.fullmatch(r"[0-9]{1,9}", text) else 0
    words = cells[0].split() if cells else []
    if len(words) == count > 1 and not any(cells[1:]):
        cells = words
    while len(cells) > count and not cells[-1]:
        cells.pop()
    if keyword in header.values:
        header.values[keyword] = tuple(cells)


def _trim(cells: list[str]) -> tuple[str, ...]:
    while cells and not cells[-1]:
        cells.pop()
    return tuple(cells)


def _check_version(header: Header) -> None:
    version = header.get_text("FILE_VERSION")
    if version is not None and not re.match(r"[12](\.|$)", version):
        warnings.warn(
            f"{header.path}, line {header.lines['FILE_VERSION']}: version {version} of the export "
            "format is not known; the file is read like version 2",
            MocapFitWarning,
            stacklevel=3,
        )
