"""The columns of a Qualisys TSV export: frame and time, markers or bodies."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from mocap_fit.errors import FileFormatError
from mocap_fit.io.names import TrackNames, name_tracks
from mocap_fit.io.number_table import parse_number
from mocap_fit.io.qualisys_header import Header

BODY_COLUMNS = (
    *("X", "Y", "Z", "angle 1", "angle 2", "angle 3", "residual"),
    *(f"Rot[{index}]" for index in range(9)),
)
"""Columns of a body, without the blank one that may follow it."""

_DAMAGED = "The header is damaged; export the recording again."


@dataclass(frozen=True)
class Columns:
    """The columns of an export.

    Parameters
    ----------
    lead
        Columns before the first marker or body: ``frame``, ``time``, both or none.
    tracks
        Names of the markers or bodies.
    titles
        Names of all columns in messages.
    is_6dof
        Whether the export holds bodies.
    stride
        Number of columns from one marker or body to the next.
    """

    lead: tuple[str, ...]
    tracks: TrackNames
    titles: tuple[str, ...]
    is_6dof: bool
    stride: int

    def find(self, column: str) -> int | None:
        """Return the index of a leading column.

        Parameters
        ----------
        column
            ``frame`` or ``time``.

        Returns
        -------
        int or None
            The index; None where there is no such column.
        """
        return self.lead.index(column) if column in self.lead else None


def find_columns(
    header: Header, names: Sequence[str] | None, subject: str | None = None
) -> Columns:
    """Determine the columns of an export from its header.

    Parameters
    ----------
    header
        Header of the file, with its first row.
    names
        Names of the caller, in place of those of the file.
    subject
        Subject of the caller, whose markers alone are read.

    Returns
    -------
    Columns
        The columns.

    Raises
    ------
    FileFormatError
        If the names are missing, or names, counts, titles and cells contradict each other.
    """
    _check_data_included(header)
    is_6dof = _is_6dof(header, names)
    noun, keyword = ("body", "BODY_NAMES") if is_6dof else ("marker", "MARKER_NAMES")
    file_names, line = _find_names(header, is_6dof), header.lines.get(keyword)
    labels = names if file_names is None else file_names
    if labels is None:
        raise FileFormatError(
            f"the file has no {noun} names: its header was switched off in the export",
            path=header.path,
            line=1,
            advice="Give the names in the order of the columns (names=[...]) and the rate "
            "(rate=..., in hertz), or export again with the header.",
        )
    tracks = name_tracks(labels, names, path=header.path, subject=subject, noun=noun, line=line)
    _check_count(header, len(tracks.labels), is_6dof)
    return _locate_bodies(header, tracks) if is_6dof else _locate_markers(header, tracks)


def _check_data_included(header: Header) -> None:
    included = header.get_text("DATA_INCLUDED")
    if included is not None and included.upper() not in ("3D", "6D", "6DOF"):
        raise FileFormatError(
            "the export holds no marker positions and no bodies",
            path=header.path,
            line=header.lines["DATA_INCLUDED"],
            found=included,
            expected="3D or 6D",
            advice="Export 3D or 6DOF data.",
        )
    types = header.values.get("DATA_TYPES", ())
    if any(word.lower() not in ("position", "positions", "3d", "6d", "6dof") for word in types):
        raise FileFormatError(
            "the export holds other data than positions",
            path=header.path,
            line=header.lines["DATA_TYPES"],
            found=", ".join(types),
            expected="Position alone",
            advice="Export 3D or 6DOF data.",
        )


def _is_6dof(header: Header, names: Sequence[str] | None) -> bool:
    if "DATA_INCLUDED" in header.values:
        return (header.get_text("DATA_INCLUDED") or "").upper().startswith("6D")
    if "BODY_NAMES" in header.values or "NO_OF_BODIES" in header.values:
        return True
    if header.values:
        return False
    if header.titles is not None:
        return "Rot[0]" in header.titles
    # Only numbers: sixteen for a body, three for a marker.
    return bool(names) and len(header.first_row) >= len(BODY_COLUMNS) * len(names or ())


def _find_names(header: Header, is_6dof: bool) -> tuple[str, ...] | None:
    keyword, count_keyword = (
        ("BODY_NAMES", "NO_OF_BODIES") if is_6dof else ("MARKER_NAMES", "NO_OF_MARKERS")
    )
    if keyword in header.values:
        return header.values[keyword]
    if header.titles is not None and not is_6dof:
        return _extract_names(header, header.titles)
    if count_keyword in header.values:
        raise FileFormatError(
            f"the header has no {keyword}",
            path=header.path,
            line=header.lines[count_keyword],
            advice="Export the recording again with the complete header, or give the names.",
        )
    return None


def _extract_names(header: Header, titles: tuple[str, ...]) -> tuple[str, ...]:
    """Return the names of the markers in a row of titles."""
    titles = titles[len(_find_lead(header)) :]
    names = []
    for start in range(0, len(titles), 3):
        if [title[-1:] for title in titles[start : start + 3]] != ["X", "Y", "Z"]:
            raise FileFormatError(
                "the column titles are not those of markers",
                path=header.path,
                line=header.titles_line,
                found=", ".join(titles[start : start + 3]),
                expected="NAME X, NAME Y, NAME Z",
                advice="Give the marker names (names=[...]) or export with the header.",
            )
        names.append(titles[start][:-1].rstrip(" _:"))
    return tuple(names)


def _check_count(header: Header, count: int, is_6dof: bool) -> None:
    keyword = "NO_OF_BODIES" if is_6dof else "NO_OF_MARKERS"
    announced = header.get_count(keyword)
    if announced is not None and announced != count:
        raise FileFormatError(
            f"{keyword} and the names contradict each other",
            path=header.path,
            line=header.lines[keyword],
            found=f"{announced} and {count} names",
            advice=_DAMAGED,
        )


def _find_lead(header: Header, width: int = 0) -> tuple[str, ...]:
    """Return the columns before the first marker or body, whose columns have a total width."""
    words = [title.lower() for title in (header.titles or ())[:2]]
    if words == ["frame", "time"]:
        return ("frame", "time")
    if words[:1] in (["frame"], ["time"]):
        return (words[0],)
    # Without titles: a frame number has no decimals, a position always has.
    row = header.first_row
    is_numbered = len(row) >= width + 2 and re.fullmatch(r" *[0-9]+ *", row[0])
    if header.titles is None and is_numbered and parse_number(row[1]) is not None:
        return ("frame", "time")
    return ()


def _locate_markers(header: Header, tracks: TrackNames) -> Columns:
    names = tracks.labels
    lead = _find_lead(header, 3 * len(names))
    columns = (*lead, *(f"{name} {axis}" for name in names for axis in "XYZ"))
    if header.titles is not None and len(header.titles) != len(columns):
        raise FileFormatError(
            "the number of column titles does not fit the marker names",
            path=header.path,
            line=header.titles_line,
            found=f"{len(header.titles)} titles",
            expected=f"{len(columns)} for {len(names)} markers",
            advice=_DAMAGED,
        )
    return Columns(lead, tracks, columns, False, 3)


def _locate_bodies(header: Header, tracks: TrackNames) -> Columns:
    names = tracks.labels
    size, count, cells = len(BODY_COLUMNS), len(names), len(header.first_row)
    lead = _find_lead(header)
    # Blank columns stand between the bodies, and perhaps after the last.
    separators = [len(lead) + (size + 1) * body - 1 for body in range(1, count)]
    separated = cells >= len(lead) + (size + 1) * count - 1 and not any(
        header.first_row[column].strip() for column in separators
    )
    stride = size + 1 if count > 1 and separated else size
    width = len(lead) + stride * (count - 1) + size
    surplus = "".join(header.first_row[width:]).strip()
    if header.first_row and (cells < width or surplus):
        raise FileFormatError(
            "the row does not have sixteen numbers for each body",
            path=header.path,
            line=header.first_row_line,
            found=f"{cells} cells",
            expected=f"{width} for {count} bodies",
            advice="Export position, angles, residual and rotation matrix of every body.",
        )
    columns = list(lead)
    for body, name in enumerate(names):
        columns += [f"{name} {column}" for column in BODY_COLUMNS]
        if stride > size and body < count - 1:
            columns.append(f"the blank column after {name}")
    return Columns(lead, tracks, tuple(columns), True, stride)
