"""Qualisys Track Manager TSV exports: 3D markers and 6DOF bodies.

Understood, for 3D: with and without the header, the row of column titles, and the Frame and Time
columns. Names may hold blanks and any letter; the file may be UTF-8, UTF-16 or Windows-1252.

Gaps. QTM writes a lost marker as ``0.000`` three times, as blanks, or as ``NaN``; all become NaN.
A marker that was truly measured at exactly (0, 0, 0) cannot be told from a gap in this format and
becomes one; nothing but the tip of a calibration frame is ever there.

Origin. ``TRAJECTORY_TYPES`` says one word for a whole trajectory. ``Measured`` and ``Edited`` (a
measured one that the operator smoothed or cut) become `Origin.MEASURED`; ``Mixed`` too, because
the file does not say which of its samples were filled; ``Gap-filled`` becomes `Origin.FILLED` and
``Virtual`` `Origin.VIRTUAL`.

Time. `start_time` is the first value of the Time column, where there is one, and otherwise 0. QTM
has counted from 0 and from ``1 / rate`` in different versions; the file is believed.
"""

from __future__ import annotations

import os
import re
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mocap_fit.errors import FileFormatError, MissingRateError, MocapFitWarning
from mocap_fit.io import finalise, qualisys_poses
from mocap_fit.io.number_table import NumberTable, number, read_number_blocks, read_numbers
from mocap_fit.io.qualisys_header import KNOWN_KEYWORDS, Header, read_events, read_header
from mocap_fit.io.stretches import InOrder, rows_of
from mocap_fit.io.text import TextFile, first_lines
from mocap_fit.io.timing import (
    check_consecutive,
    check_rate_against_ends,
    check_rate_against_times,
    checked_rate,
    rate_from_times,
)
from mocap_fit.tracks import FloatArray, MarkerTracks, Origin, PoseTracks

NAME = "qualisys-tsv"
description = "Qualisys Track Manager TSV export, 3D or 6DOF"
extensions = (".tsv", ".txt")

ORIGINS = {
    "measured": Origin.MEASURED,
    "mixed": Origin.MEASURED,
    "edited": Origin.MEASURED,
    "gap-filled": Origin.FILLED,
    "virtual": Origin.VIRTUAL,
}
"""What the words of TRAJECTORY_TYPES mean, in lower case."""

_AXIS_TITLE = re.compile(r"(.*?)[ _:]*([XYZ])", re.DOTALL)


def sniff(path: str | os.PathLike[str]) -> bool:
    """Whether the file starts with a keyword of QTM's header, or with its column titles."""
    for line in first_lines(path, 2):
        cells = [cell.strip() for cell in line.split("\t")]
        if not line.strip():
            continue
        return (cells[0] in KNOWN_KEYWORDS and len(cells) > 1) or cells[:2] == ["Frame", "Time"]
    return False


def read(
    path: str | os.PathLike[str],
    *,
    names: Sequence[str] | None = None,
    rate: float | None = None,
) -> MarkerTracks | PoseTracks:
    """Read a 3D export as markers, a 6DOF export as poses.

    Parameters
    ----------
    path
        The file.
    names
        Names of the markers or bodies, in the order of the file. Needed where the header is
        switched off; they replace the file's own.
    rate
        Frames per second. Needed where the file has neither a header nor times; it replaces the
        file's own.

    Returns
    -------
    MarkerTracks or PoseTracks
        Positions in millimetres, as the file has its axes.

    Raises
    ------
    FileFormatError
        With the file and the line, if the file cannot be read as it stands.

    Warns
    -----
    MocapFitWarning
        If the file was cut off, or says something that is not known.
    """
    with TextFile(path) as text:
        header, is_6dof, file_names, layout = _opened(text, names)
        table = read_numbers(
            text.rest(),
            layout.columns,
            separator="\t",
            first_line=header.first_row_line,
            path=text.path,
            expected_rows=header.count("NO_OF_FRAMES"),
        )
    timing = _timing(header, table, layout.lead, rate)
    events = read_events(header, timing.rate)
    arguments = _arguments(file_names, names, rate)
    if is_6dof:
        rotations, translations, residuals = qualisys_poses.poses_of(table, layout, text.path)
        return finalise.poses(
            text.path,
            NAME,
            file_names,
            timing.rate,
            rotations,
            translations,
            residuals,
            start_time=timing.start,
            events=events,
            arguments=arguments,
        )
    positions = table.values[:, len(layout.lead) :].reshape(len(table.values), -1, 3)
    positions, origin = _with_gaps(positions, _origin_codes(header, len(file_names)))
    return finalise.markers(
        text.path,
        NAME,
        file_names,
        timing.rate,
        positions,
        origin=origin,
        start_time=timing.start,
        events=events,
        arguments=arguments,
    )


def stretches(
    path: str | os.PathLike[str],
    *,
    names: Sequence[str] | None = None,
    rate: float | None = None,
    frames: int,
) -> Iterator[MarkerTracks | PoseTracks]:
    """Read a 3D export so many frames at a time; parameters and errors as for `read`.

    A file that does not say its rate is gone through twice. A 6DOF export is read whole.

    Yields
    ------
    MarkerTracks or PoseTracks
        Together what `read` gives.
    """
    with TextFile(path) as text:
        header, is_6dof, file_names, layout = _opened(text, names)
        if is_6dof:
            yield read(path, names=names, rate=rate)
            return
        said = _said_rate(header, layout.lead, rate)
        time = layout.lead.index("time") if "time" in layout.lead else None
        order = InOrder(
            _blocks(text, header, layout),
            layout.lead.index("frame") if "frame" in layout.lead else None,
            time if rate is None else None,
            text.path,
        )
        tables = iter(order)
        first = next(tables)
        if said is None:
            said = _rate_of_all(path, names, layout)
        made = finalise.Stretches(
            text.path,
            NAME,
            file_names,
            said,
            start_time=_start(first, layout.lead, text.path),
            events=read_events(header, said),
            arguments=_arguments(file_names, names, rate),
        )
        codes = _origin_codes(header, len(file_names))
        for positions in rows_of(chain([first], tables), len(layout.lead), frames):
            yield made.part(*_with_gaps(positions, codes))
        made.finish()
        if time is not None and rate is None:
            check_rate_against_ends(
                said,
                float(first.values[0, time]),
                float(order.last[0, time]),
                order.rows,
                decimals=first.decimals(time),
                path=text.path,
                line=int(order.line[0]),
            )


def _arguments(
    file_names: tuple[str, ...], names: Sequence[str] | None, rate: float | None
) -> dict[str, Any]:
    """What the caller said, for the provenance."""
    arguments: dict[str, Any] = {}
    if names is not None:
        arguments["names"] = list(file_names)
    if rate is not None:
        arguments["rate"] = float(rate)
    return arguments


def _with_gaps(
    positions: FloatArray, codes: NDArray[np.uint8]
) -> tuple[FloatArray, NDArray[np.uint8]]:
    """Positions with NaN where the file has a gap, and the origin of every sample."""
    positions = np.where((positions == 0).all(axis=2, keepdims=True), np.nan, positions)
    gone = np.isnan(positions).any(axis=2)
    return positions, np.where(gone, Origin.MISSING, codes).astype(np.uint8)


def _blocks(text: TextFile, header: Header, layout: qualisys_poses.Layout) -> Iterator[NumberTable]:
    return read_number_blocks(
        text.blocks(),
        layout.columns,
        separator="\t",
        first_line=header.first_row_line,
        path=text.path,
        expected_rows=header.count("NO_OF_FRAMES"),
    )


def _rate_of_all(
    path: str | os.PathLike[str], names: Sequence[str] | None, layout: qualisys_poses.Layout
) -> float:
    """The rate that the times of all frames say."""
    column = layout.lead.index("time")
    with TextFile(path) as text, warnings.catch_warnings():
        # What there is to warn of is told when the frames are read.
        warnings.simplefilter("ignore", MocapFitWarning)
        header, _, _, _ = _opened(text, names)
        times: list[FloatArray] = []
        lines: list[NDArray[np.intp]] = []
        decimals = 0
        for table in _blocks(text, header, layout):
            decimals = decimals if times else table.decimals(column)
            times.append(table.values[:, column].copy())
            lines.append(table.lines)
    return rate_from_times(
        np.concatenate(times), decimals=decimals, path=text.path, lines=np.concatenate(lines)
    )


def _opened(
    text: TextFile, names: Sequence[str] | None
) -> tuple[Header, bool, tuple[str, ...], qualisys_poses.Layout]:
    """The header, whether these are bodies, their names, and the columns of the rows."""
    header = read_header(text)
    if not header.first_row:
        raise FileFormatError(
            "the file ends before its first row of numbers",
            path=text.path,
            line=max(text.number, 1),
            advice="Export or copy the recording again.",
        )
    _check_data_included(header)
    is_6dof = _is_6dof(header, names)
    noun = "body" if is_6dof else "marker"
    file_names = finalise.chosen_names(
        _names_of(header, is_6dof),
        names,
        path=text.path,
        noun=noun,
        line=header.lines.get("BODY_NAMES" if is_6dof else "MARKER_NAMES"),
    )
    if file_names is None:
        raise FileFormatError(
            f"the file has no {noun} names: its header was switched off in the export",
            path=text.path,
            line=1,
            advice="Give the names in the order of the columns (names=[...]) and the rate "
            "(rate=..., in hertz), or export again with the header.",
        )
    _check_counts(header, len(file_names), is_6dof)
    if is_6dof:
        layout = qualisys_poses.layout_of(header, file_names)
    else:
        layout = _layout_of(header, file_names)
    return header, is_6dof, file_names, layout


@dataclass(frozen=True)
class _Timing:
    rate: float
    start: float


def _check_data_included(header: Header) -> None:
    included = header.text("DATA_INCLUDED")
    if included is not None and included.upper() not in ("3D", "6D", "6DOF"):
        raise FileFormatError(
            "the export holds no marker positions and no bodies",
            path=header.path,
            line=header.lines["DATA_INCLUDED"],
            found=included,
            expected="3D or 6D",
            advice="Export 3D or 6DOF data.",
        )


def _is_6dof(header: Header, names: Sequence[str] | None) -> bool:
    if "DATA_INCLUDED" in header.values:
        return (header.text("DATA_INCLUDED") or "").upper().startswith("6D")
    if "BODY_NAMES" in header.values or "NO_OF_BODIES" in header.values:
        return True
    if header.values:
        return False
    if header.titles is not None:
        return "Rot[0]" in header.titles
    # Nothing but numbers: sixteen for a body, three for a marker.
    return bool(names) and len(header.first_row) >= qualisys_poses.BODY_COLUMNS * len(names or ())


def _names_of(header: Header, is_6dof: bool) -> tuple[str, ...] | None:
    keyword, count_keyword = (
        ("BODY_NAMES", "NO_OF_BODIES") if is_6dof else ("MARKER_NAMES", "NO_OF_MARKERS")
    )
    if keyword in header.values:
        return header.values[keyword]
    if header.titles is not None and not is_6dof:
        return _names_of_titles(header)
    if count_keyword in header.values:
        raise FileFormatError(
            f"the header has no {keyword}",
            path=header.path,
            line=header.lines[count_keyword],
            advice="Export the recording again with the complete header, or give the names.",
        )
    return None


def _names_of_titles(header: Header) -> tuple[str, ...]:
    titles = (header.titles or ())[len(_lead(header, 0)) :]
    names = []
    for place in range(0, len(titles), 3):
        parts = [_AXIS_TITLE.fullmatch(title) for title in titles[place : place + 3]]
        found = [part.groups() for part in parts if part is not None]
        if len(found) != 3 or [axis for _, axis in found] != ["X", "Y", "Z"]:
            raise FileFormatError(
                "the column titles are not those of markers",
                path=header.path,
                line=header.titles_line,
                found=", ".join(titles[place : place + 3]),
                expected="NAME X, NAME Y, NAME Z",
                advice="Give the marker names (names=[...]) or export with the header.",
            )
        names.append(found[0][0])
    return tuple(names)


def _check_counts(header: Header, count: int, is_6dof: bool) -> None:
    keyword = "NO_OF_BODIES" if is_6dof else "NO_OF_MARKERS"
    announced = header.count(keyword)
    if announced is not None and announced != count:
        raise FileFormatError(
            f"{keyword} and the names contradict each other",
            path=header.path,
            line=header.lines[keyword],
            found=f"{announced} and {count} names",
            advice="The header is damaged; export the recording again.",
        )


def _lead(header: Header, width: int) -> tuple[str, ...]:
    """The columns before the first marker or body: frame and time, one of them, or none."""
    if header.titles is not None:
        words = [title.lower() for title in header.titles[:2]]
        if words[:2] == ["frame", "time"]:
            return ("frame", "time")
        if words[:1] in (["frame"], ["time"]):
            return (words[0],)
        return ()
    # Without titles: a frame number has no decimals, a position always has.
    row = header.first_row
    if len(row) >= width + 2 and re.fullmatch(r" *[0-9]+ *", row[0]) and number(row[1]) is not None:
        return ("frame", "time")
    return ()


def _layout_of(header: Header, names: tuple[str, ...]) -> qualisys_poses.Layout:
    width = 3 * len(names)
    lead = _lead(header, width)
    columns = [*lead, *(f"{name} {axis}" for name in names for axis in "XYZ")]
    titles = header.titles
    if titles is not None and len(titles) != len(columns):
        raise FileFormatError(
            "the number of column titles does not fit the marker names",
            path=header.path,
            line=header.titles_line,
            found=f"{len(titles)} titles",
            expected=f"{len(columns)} for {len(names)} markers",
            advice="The header is damaged; export the recording again.",
        )
    return qualisys_poses.Layout(lead, names, tuple(columns))


def _timing(
    header: Header, table: NumberTable, lead: tuple[str, ...], rate: float | None
) -> _Timing:
    """Rate and start time: of the caller, of the header, of the Time column, in this order."""
    path, lines = header.path, table.lines
    if "frame" in lead:
        check_consecutive(table.values[:, lead.index("frame")], path=path, lines=lines)
    said = _said_rate(header, lead, rate)
    if "time" not in lead:
        return _Timing(float(said or np.nan), 0.0)
    column = lead.index("time")
    times, decimals = table.values[:, column], table.decimals(column)
    if said is None:
        said = rate_from_times(times, decimals=decimals, path=path, lines=lines)
    elif rate is None:
        check_rate_against_times(said, times, decimals=decimals, path=path, lines=lines)
    return _Timing(said, _start(table, lead, path))


def _start(table: NumberTable, lead: tuple[str, ...], path: Path) -> float:
    """The time of the first frame; 0 where there are no times."""
    if "time" not in lead:
        return 0.0
    start = float(table.values[0, lead.index("time")])
    if np.isnan(start):
        raise FileFormatError("the first frame has no time", path=path, line=int(table.lines[0]))
    return start


def _said_rate(header: Header, lead: tuple[str, ...], rate: float | None) -> float | None:
    """The rate of the caller or of the header; None where the times must tell it."""
    said = header.rate() if rate is None else checked_rate(rate, path=header.path)
    if said is None and "time" not in lead:
        raise MissingRateError(
            "the file does not say its frame rate",
            path=header.path,
            line=header.lines.get("FREQUENCY"),
            advice="Give it (rate=..., in hertz), or export again with the header or the "
            "Time column.",
        )
    return said


def _origin_codes(header: Header, markers: int) -> NDArray[np.uint8]:
    """The origin of each marker's samples, `(markers,)`."""
    codes = np.full(markers, Origin.MEASURED, dtype=np.uint8)
    types = header.values.get("TRAJECTORY_TYPES", ())
    line = header.lines.get("TRAJECTORY_TYPES")
    if types and len(types) != markers:
        raise FileFormatError(
            "TRAJECTORY_TYPES does not have one word for each marker",
            path=header.path,
            line=line,
            found=len(types),
            expected=markers,
            advice="The header is damaged; export the recording again.",
        )
    unknown = sorted({word for word in types if word.lower() not in ORIGINS})
    if unknown:
        warnings.warn(
            f"{header.path}, line {line}: the trajectory type {', '.join(unknown)} is not known; "
            "its markers are taken as measured",
            MocapFitWarning,
            stacklevel=3,
        )
    for marker, word in enumerate(types):
        codes[marker] = ORIGINS.get(word.lower(), Origin.MEASURED)
    return codes
