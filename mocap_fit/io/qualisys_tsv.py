"""Qualisys Track Manager TSV exports: 3D markers and 6DOF bodies.

For 3D, the header, the row of column titles, and the Frame and Time columns are optional. Names
may hold blanks and any letter; the file may be UTF-8, UTF-16 or Windows-1252.

Gaps. QTM writes a lost marker as ``0.000`` three times, as blanks, or as ``NaN``; all become NaN.
A marker that was truly measured at exactly (0, 0, 0) cannot be distinguished from a gap in this
format and becomes one; only the tip of a calibration frame is ever there.

Origin. ``TRAJECTORY_TYPES`` has one word for a complete trajectory. ``Measured`` and ``Edited``
(measured, then smoothed or cut by the operator) become `Origin.MEASURED`; ``Mixed`` too, because
the file does not say which of its samples were filled; ``Gap-filled`` becomes `Origin.FILLED` and
``Virtual`` `Origin.VIRTUAL`.

Time. `start_time` is the first value of the Time column, where there is one, and otherwise 0. QTM
has counted from 0 and from ``1 / rate`` in different versions; the file is believed.
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mocap_fit.errors import FileFormatError, MocapFitWarning
from mocap_fit.io import finalise
from mocap_fit.io.number_table import parse_number, read_numbers
from mocap_fit.io.qualisys_columns import find_columns
from mocap_fit.io.qualisys_header import (
    KNOWN_KEYWORDS,
    Header,
    read_events,
    read_header,
    split_line,
)
from mocap_fit.io.qualisys_poses import extract_poses
from mocap_fit.io.text import TextFile, read_first_lines
from mocap_fit.io.timing import determine_timing
from mocap_fit.tracks import MarkerTracks, Origin, PoseTracks

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
"""Origins by the words of TRAJECTORY_TYPES, in lower case."""


def sniff(path: str | os.PathLike[str]) -> bool:
    """Return whether a file starts with a keyword of QTM's header, or with its column titles.

    Parameters
    ----------
    path
        The file.

    Returns
    -------
    bool
        Whether it looks like a QTM export.
    """
    for line in read_first_lines(path, 2):
        if not line.strip():
            continue
        try:
            cells = split_line(line)
        except FileFormatError:
            return False
        return (cells[0] in KNOWN_KEYWORDS and len(cells) > 1) or cells[:2] == ["Frame", "Time"]
    return False


def read(
    path: str | os.PathLike[str],
    *,
    names: Sequence[str] | None = None,
    rate: float | None = None,
    unit: str | None = None,
    subject: str | None = None,
) -> MarkerTracks | PoseTracks:
    """Read a 3D export as markers, or a 6DOF export as poses.

    Parameters
    ----------
    path
        File to read.
    names
        Names of the markers or bodies, in the order of the file; they replace those of the file.
        Required where the header was switched off.
    rate
        Frame rate, hertz; it replaces that of the file. Required where the file has neither a
        header nor times.
    unit
        Unit of length of the file, such as ``m``; it replaces that of the file.
    subject
        Subject whose tracks alone are read, where the names have subjects.

    Returns
    -------
    MarkerTracks or PoseTracks
        Positions in millimetres, in the axes of the file.

    Raises
    ------
    MissingRateError
        If the file does not say its rate.
    FileFormatError
        With the file and the line, if the file does not follow its format.

    Warns
    -----
    MocapFitWarning
        If the file is cut off, or has a version or a trajectory type that is not known.
    """
    with TextFile(path) as text:
        header = read_header(text)
        if not header.first_row:
            raise FileFormatError(
                "the file ends before its first row of numbers",
                path=text.path,
                line=max(text.number, 1),
                advice="Export or copy the recording again.",
            )
        columns = find_columns(header, names, subject)
        block, rows = text.read_rest(), header.get_count("NO_OF_FRAMES")
        first_line = header.first_row_line
        table = read_numbers(
            block, columns.titles, "\t", first_line, text.path, rows, numbered=bool(columns.lead)
        )
    said = parse_number(header.get_text("FREQUENCY") or "")
    used_rate, start_time = determine_timing(
        table,
        frame=columns.find("frame"),
        time=columns.find("time"),
        rate=rate,
        file_rate=header.get_rate() if rate is None else said,
        line=header.lines.get("FREQUENCY"),
    )
    kind: type[MarkerTracks | PoseTracks] = MarkerTracks
    arrays: dict[str, NDArray[Any]]
    scale = finalise.get_millimetres(unit or "mm", path=text.path)
    if columns.is_6dof:
        kind, arrays = PoseTracks, extract_poses(table, columns, text.path)
        with np.errstate(over="ignore"):
            for name in ("translations", "residuals"):
                arrays[name] *= scale
    else:
        positions = finalise.mark_zeros(table.to_positions(len(columns.lead), scale))
        gaps = np.isnan(positions).any(axis=2)
        origin = np.where(gaps, Origin.MISSING, _read_origins(header, len(columns.tracks.labels)))
        arrays = {"positions": positions, "origin": origin.astype(np.uint8)}
    return finalise.create_tracks(
        kind,
        text.path,
        NAME,
        columns.tracks,
        used_rate,
        arrays,
        start_time=start_time,
        events=read_events(header, used_rate),
        arguments=finalise.list_arguments(columns.tracks, rate, unit),
        unit_is_known=columns.is_6dof or unit is not None,
    )


def _read_origins(header: Header, markers: int) -> NDArray[np.uint8]:
    """Return the origin of each marker's samples, ``(markers,)``."""
    types = header.values.get("TRAJECTORY_TYPES", ())
    line = header.lines.get("TRAJECTORY_TYPES")
    if not types:
        return np.full(markers, Origin.MEASURED, dtype=np.uint8)
    if len(types) != markers:
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
    return np.array([ORIGINS.get(word.lower(), Origin.MEASURED) for word in types], np.uint8)
