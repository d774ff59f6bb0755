"""ASCII exports of Vicon Nexus: CSV, or the same with tabs.

An export has sections (``Devices``, ``Joints``, ``Model Outputs``, ``Trajectories``), each with its
title, its rate, a row of names, a row of axes, a row of units, and a row a frame; blank lines stand
between them. Read are the positions in ``Trajectories``, and the events in ``Events`` before them;
velocities and accelerations are left out.

Gaps are blanks; zeros are positions. There are no times: frame 1 is at 0, so that `start_time` is
that of the first frame in the file.
"""

from __future__ import annotations

import math
import os
import re
from collections.abc import Sequence

from mocap_fit.errors import FileFormatError, add_path
from mocap_fit.io import finalise
from mocap_fit.io.csv_titles import Separator, find_separator
from mocap_fit.io.names import name_tracks
from mocap_fit.io.number_table import parse_number, read_numbers
from mocap_fit.io.text import TextFile, read_first_lines, split_cells
from mocap_fit.io.timing import check_rate, determine_timing
from mocap_fit.tracks import Event, MarkerTracks

NAME = "nexus-csv"
description = "CSV or ASCII export of Vicon Nexus"
extensions = (".csv",)

_SECTIONS = frozenset(("trajectories", "devices", "joints", "model outputs", "segments", "events"))
_AGAIN = "Export the recording again."


def sniff(path: str | os.PathLike[str]) -> bool:
    """Return whether the first line is the title of a section, and a rate or titles follow.

    Parameters
    ----------
    path
        The file.

    Returns
    -------
    bool
        Whether it looks like an export of Nexus.
    """
    words = [word for line in read_first_lines(path, 10) if (word := _to_word(line))][:2]
    if len(words) < 2 or words[0] not in _SECTIONS:
        return False
    return words[0] == "trajectories" or words[1][0].isdigit() or words[1].startswith("subject")


def read(
    path: str | os.PathLike[str],
    *,
    names: Sequence[str] | None = None,
    rate: float | None = None,
    unit: str | None = None,
    subject: str | None = None,
) -> MarkerTracks:
    """Read the trajectories of a Nexus export.

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
        With the file and the line, if the file does not follow its format, or has no section
        ``Trajectories``.

    Warns
    -----
    MocapFitWarning
        If the file is cut off, or the unit is probably not the millimetre.
    """
    with TextFile(path) as text:
        try:
            events = _skip_to_trajectories(text)
            rate_cell, separator, rows = _read_titles(text)
            labels, starts, file_unit = _find_markers(rows)
        except FileFormatError as error:
            raise add_path(error, text.path) from None
        first_line, block = text.number + 1, text.read_rest()
    line = first_line - len(rows)
    used = name_tracks(labels, names, path=text.path, subject=subject, line=line)
    columns = ["the frame", *rows[1][1:]]
    for label, start in zip(used.labels, starts, strict=True):
        columns[start : start + 3] = [f"{label} {axis}" for axis in "XYZ"]
    # No row begins with a letter; the next section does.
    end = re.search(rb"\n[ \t,;\"]*[A-Za-z]", b"\n" + block)
    table = read_numbers(
        *(block if end is None else block[: end.start()], columns, separator),
        *(first_line, text.path),
        used=[0, *(start + axis for start in starts for axis in range(3))],
        numbered=True,
    )
    unit = unit or file_unit
    scale = finalise.get_millimetres(unit or "mm", path=text.path, line=first_line - 1)
    file_rate = parse_number(rate_cell)
    if rate is None and (file_rate is None or math.isnan(file_rate)):
        raise FileFormatError(
            "the rate of the trajectories is not a number",
            path=text.path,
            line=line - 1,
            found=f"'{rate_cell}'",
            advice="Correct it, or give the rate (rate=..., in hertz).",
        )
    if rate is None and file_rate is not None:
        file_rate = check_rate(file_rate, path=text.path, line=line - 1)
    used_rate, _ = determine_timing(table, frame=0, time=None, rate=rate, file_rate=file_rate)
    return finalise.create_tracks(
        MarkerTracks,
        text.path,
        NAME,
        used,
        used_rate,
        {"positions": table.to_positions(1, scale)},
        start_time=(float(table.values[0, 0]) - 1) / used_rate,
        events=events,
        arguments=finalise.list_arguments(used, rate, unit),
        unit_is_known=unit is not None,
    )


def _to_word(line: str) -> str:
    return line.strip(' \t,;"').lower()


def _skip_to_trajectories(text: TextFile) -> tuple[Event, ...]:
    """Return the events, with the file behind the title of the trajectories."""
    events: list[Event] = []
    sections: list[str] = []
    while (line := text.read_line()) is not None:
        word = _to_word(line)
        if word == "trajectories":
            return tuple(events)
        if word in _SECTIONS:
            sections.append(word)
        elif sections[-1:] == ["events"]:
            cells = split_cells(line, find_separator(line))
            time = parse_number(cells[3]) if len(cells) > 3 else None
            if time is not None and math.isfinite(time):
                words = [cell for cell in cells[1:3] if cell and cell.lower() != "general"]
                events.append(Event(" ".join(words), time))
        elif word and not sections:
            break
    raise FileFormatError(
        "the file has no section Trajectories",
        line=None if sections else max(text.number, 1),
        found=", ".join(sections) or (line or "")[:40],
        expected="Trajectories",
        advice="Export the recording from Nexus again, with its trajectories."
        if sections
        else "Check that it is the file you mean.",
    )


def _read_titles(text: TextFile) -> tuple[str, Separator, list[list[str]]]:
    """Return the rate, the separator, and the rows of names, axes and, if there is one, units."""
    lines = [line for _ in range(3) if (line := text.read_line()) is not None]
    if len(lines) < 3:
        raise FileFormatError("the file is cut off in its header", line=text.number, advice=_AGAIN)
    separator = find_separator(lines[2])
    cells = [split_cells(line, separator) for line in lines]
    if "x" not in map(str.lower, cells[2]):
        raise FileFormatError(
            "the titles of the trajectories are missing",
            line=text.number,
            found=", ".join(cells[2])[:60],
            expected="Frame, Sub Frame, X, Y, Z, ...",
            advice=_AGAIN,
        )
    rows = cells[1:]
    line = text.read_line()
    if line is not None:
        units = split_cells(line, separator)
        if units and units[0]:
            text.push_back()
        else:
            rows.append(units)
    return cells[0][0] if cells[0] else "", separator, rows


def _find_markers(rows: list[list[str]]) -> tuple[list[str], list[int], str | None]:
    """Return the label of each trajectory, the column of its x, and the unit."""
    width = max(len(row) for row in rows)
    labels, axes, *rest = (row + [""] * (width - len(row)) for row in rows)
    axes = [axis.lower() for axis in axes]
    starts = [start for start in range(1, width) if axes[start : start + 3] == ["x", "y", "z"]]
    named = [label for label in labels if label]
    if any(label and not axis.startswith("x") for label, axis in zip(labels, axes, strict=True)):
        # The names are not above their columns, but may be as many.
        if len(named) != len(starts):
            raise FileFormatError(
                "the names are not above the columns of their trajectories",
                found=f"{len(named)} names and {len(starts)} trajectories",
                advice=_AGAIN,
            )
        chosen = named
    else:
        chosen = [labels[start] for start in starts]
    if not starts:
        raise FileFormatError("the export holds no positions", expected="X, Y, Z", advice=_AGAIN)
    units = dict.fromkeys(
        unit for row in rest for start in starts for unit in row[start : start + 3] if unit
    )
    if len(units) > 1:
        raise FileFormatError(
            "the trajectories have several units", found=", ".join(units), expected="one unit"
        )
    return chosen, starts, next(iter(units), None)
