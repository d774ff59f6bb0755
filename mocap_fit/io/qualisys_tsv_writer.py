"""Write marker tracks as a Qualisys TSV export, as QTM itself writes it."""

from __future__ import annotations

import math
import os
import re
from typing import Literal

import numpy as np

from mocap_fit.atomic_file import write_atomically
from mocap_fit.errors import DataError
from mocap_fit.io.finalise import FARTHEST
from mocap_fit.tracks import FloatArray, MarkerTracks, Origin

Gaps = Literal["zero", "blank", "nan"]

_GAPS: dict[Gaps, str | None] = {"zero": None, "blank": "", "nan": "NaN"}
_TIME_DECIMALS = 5


def write_qualisys_tsv(
    tracks: MarkerTracks,
    path: str | os.PathLike[str],
    *,
    decimals: int = 3,
    frame_and_time: bool = True,
    titles: bool = True,
    trajectory_types: bool = True,
    gaps: Gaps = "zero",
) -> None:
    """Write markers as a Qualisys TSV export, atomically.

    The file is UTF-8 with tabs and CRLF, positions in millimetres. It cannot hold the provenance,
    the origin of single samples (the format has one word for a trajectory, ``Mixed`` where there
    are several), and times beyond five decimals. A visible sample that would be written as zeros,
    which mean a gap, is written with one digit more and at least one unit of it in x, an error
    below half a unit of the other digits.

    Parameters
    ----------
    tracks
        Markers to write.
    path
        File to write; an existing one is replaced.
    decimals
        Number of digits after the point of a position, 1 to 9. QTM writes 3.
    frame_and_time
        Whether the first two columns are the number and the time of the frame. Without them the
        start time is lost.
    titles
        Whether a row of column titles follows the header.
    trajectory_types
        Whether to write the origin of each marker; the header is then that of version 2.0.0.
    gaps
        Content of a gap: ``zero`` (``0.000``, as QTM writes it), ``blank`` or ``nan``.

    Raises
    ------
    DataError
        If a name cannot be written, or a setting is out of range.
    FileFormatError
        If the file cannot be written.
    """
    if not 1 <= decimals <= 9:
        raise DataError(
            "the number of decimals is out of range", found=decimals, expected="from 1 to 9"
        )
    if gaps not in _GAPS:
        raise DataError(
            "there is no such way to write a gap", found=gaps, expected=", ".join(_GAPS)
        )
    for text in (*tracks.names, *(event.name for event in tracks.events)):
        _check_name(text)
    lines = _list_header(tracks, trajectory_types)
    time_decimals = max(_TIME_DECIMALS, math.ceil(math.log10(tracks.rate)) + 2)
    if titles:
        row = [f"{name} {axis}" for name in tracks.names for axis in "XYZ"]
        lines.append("\t".join([*(["Frame", "Time"] if frame_and_time else []), *row]))
    lead = f"%d\t%.{time_decimals}f\t" if frame_and_time else ""
    pattern = lead + "\t".join([f"%.{decimals}f"] * (3 * len(tracks.names)))
    gap = _GAPS[gaps]
    flat = np.where(np.isnan(tracks.positions), 0.0, tracks.positions).reshape(tracks.frames, -1)
    if (np.abs(flat) > FARTHEST).any():
        raise DataError(
            "a position is out of range",
            frame=int(np.argwhere(np.abs(flat) > FARTHEST)[0][0]),
            found=f"{np.abs(flat).max():g} mm",
            expected=f"within {FARTHEST:g} mm, as it is read",
        )
    # Rounding can leave a minus before zeros; adding 0.0 takes it away.
    flat = np.asarray(np.round(flat, decimals) + 0.0, dtype=np.float64)
    special = _find_special_cells(tracks, flat, decimals, gap)
    for frame, (values, time) in enumerate(zip(flat.tolist(), tracks.times.tolist(), strict=True)):
        row_text = pattern % ((frame + 1, time, *values) if frame_and_time else tuple(values))
        if frame in special:
            cells = row_text.split("\t")
            for column, text in special[frame]:
                cells[column + (2 if frame_and_time else 0)] = text
            row_text = "\t".join(cells)
        lines.append(row_text)
    with write_atomically(path) as partial:
        partial.write_bytes(("\r\n".join(lines) + "\r\n").encode("utf-8"))


def _check_name(name: str) -> None:
    if not name or name != name.strip() or re.search(r"[\x00-\x1f\x7f-\x9f\u2028\u2029]", name):
        raise DataError(
            "a name cannot stand in a TSV file",
            found=repr(name),
            expected="a name without tabs, line ends, or blanks before or after it",
            advice="Rename it.",
        )


def _list_header(tracks: MarkerTracks, trajectory_types: bool) -> list[str]:
    lines = ["FILE_VERSION\t2.0.0"] if trajectory_types else []
    lines += [
        f"NO_OF_FRAMES\t{tracks.frames}",
        "NO_OF_CAMERAS\t0",
        f"NO_OF_MARKERS\t{len(tracks.names)}",
        f"FREQUENCY\t{int(tracks.rate) if tracks.rate.is_integer() else repr(tracks.rate)}",
        "NO_OF_ANALOG\t0",
        "ANALOG_FREQUENCY\t0",
        "DESCRIPTION\t--",
        "DATA_INCLUDED\t3D",
    ]
    for event in tracks.events:
        frame = round((event.time - tracks.start_time) * tracks.rate) + 1
        lines.append(f"EVENT\t{event.name}\t{frame}\t{event.time:.{_TIME_DECIMALS}f}")
    lines.append("\t".join(("MARKER_NAMES", *tracks.names)))
    if trajectory_types:
        lines.append("\t".join(("TRAJECTORY_TYPES", *_list_trajectory_types(tracks))))
    return lines


def _list_trajectory_types(tracks: MarkerTracks) -> list[str]:
    words = {Origin.MEASURED: "Measured", Origin.FILLED: "Gap-filled", Origin.VIRTUAL: "Virtual"}
    types = []
    for marker in range(len(tracks.names)):
        kinds = {Origin(code) for code in np.unique(tracks.origin[:, marker])} - {Origin.MISSING}
        types.append(
            "Mixed" if len(kinds) > 1 else words[kinds.pop() if kinds else Origin.MEASURED]
        )
    return types


def _find_special_cells(
    tracks: MarkerTracks, written: FloatArray, decimals: int, gap: str | None
) -> dict[int, list[tuple[int, str]]]:
    """Return the cells that differ from the plain pattern: (column, text) by frame."""
    special: dict[int, list[tuple[int, str]]] = {}
    visible = tracks.visible
    if gap is not None:
        for frame, marker in np.argwhere(~visible).tolist():
            cells = [(3 * marker + axis, gap) for axis in range(3)]
            special.setdefault(frame, []).extend(cells)
    zeros = (written.reshape(tracks.positions.shape) == 0).all(axis=2) & visible
    smallest = 10.0 ** -(decimals + 1)
    for frame, marker in np.argwhere(zeros).tolist():
        x = float(tracks.positions[frame, marker, 0])
        size = max(abs(x), smallest)
        text = f"{math.copysign(size, x):.{decimals + 1}f}"
        special.setdefault(frame, []).append((3 * marker, text))
    return special
