"""The columns of a Qualisys 6DOF export, and the poses in them.

A body has sixteen columns: X, Y, Z, three angles, the residual, and ``Rot[0]`` to ``Rot[8]``, the
rotation matrix **column by column**. Some versions of QTM put a blank column between two bodies,
and some write titles for the first body only. The angles' names and their order are a setting of
the software and differ between files; they are ignored, the matrix decides.

A body that QTM lost is zeros with a residual of -1, or blanks; it becomes NaN.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mocap_fit.errors import FileFormatError
from mocap_fit.io.number_table import NumberTable
from mocap_fit.io.qualisys_header import Header
from mocap_fit.tracks import FloatArray

_COLUMNS = (
    *("X", "Y", "Z", "angle 1", "angle 2", "angle 3", "residual"),
    *(f"Rot[{index}]" for index in range(9)),
)

BODY_COLUMNS = len(_COLUMNS)
"""Columns of a body, without the blank one that may follow it."""

_ORTHONORMAL = 1e-3
"""How far a matrix of five decimals may be from a rotation."""


@dataclass(frozen=True)
class Layout:
    """The columns of an export.

    Parameters
    ----------
    lead
        The columns before the first marker or body: frame, time, both or none.
    names
        Markers or bodies.
    columns
        What each column is called in messages.
    stride
        Columns from one body to the next, where there are bodies.
    """

    lead: tuple[str, ...]
    names: tuple[str, ...]
    columns: tuple[str, ...]
    stride: int = 0


def layout_of(header: Header, names: tuple[str, ...]) -> Layout:
    """The columns of a 6DOF export.

    Raises
    ------
    FileFormatError
        If the first row does not have sixteen cells a body.
    """
    size, count = BODY_COLUMNS, len(names)
    cells = len(header.first_row)
    lead = _lead(header)
    # Blank columns stand between the bodies, and perhaps after the last.
    separated = len(lead) + (size + 1) * count - 1
    if count > 1 and cells >= separated and _blank_between(header, len(lead), count):
        stride = size + 1
    else:
        stride = size
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
        columns += [f"{name} {column}" for column in _COLUMNS]
        if stride > size and body < count - 1:
            columns.append(f"the blank column after {name}")
    return Layout(lead, names, tuple(columns), stride)


def poses_of(
    table: NumberTable, layout: Layout, path: Path
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Rotations, translations and residuals of the bodies.

    Returns
    -------
    rotations
        `(frames, bodies, 3, 3)`: the nearest rotations to the matrices of the file.
    translations
        `(frames, bodies, 3)`, millimetres.
    residuals
        `(frames, bodies)`, millimetres.

    Raises
    ------
    FileFormatError
        If a matrix is no right-handed rotation.
    """
    size = BODY_COLUMNS
    starts = len(layout.lead) + layout.stride * np.arange(len(layout.names))
    cells = table.values[:, starts[:, None] + np.arange(size)]
    translations = cells[:, :, 0:3].copy()
    residuals = cells[:, :, 6].copy()
    # Rot[0], Rot[1], Rot[2] are the first column.
    rotations = cells[:, :, 7:16].reshape(*cells.shape[:2], 3, 3).swapaxes(2, 3).copy()
    lost = (
        (rotations == 0).all(axis=(2, 3))
        | np.isnan(rotations).any(axis=(2, 3))
        | np.isnan(translations).any(axis=2)
        | (residuals < 0)
    )
    translations[lost] = np.nan
    rotations[lost] = np.nan
    residuals[lost] = np.nan
    there = ~lost
    matrices = rotations[there]
    if len(matrices):
        products = matrices @ matrices.swapaxes(1, 2)
        wrong = (np.abs(products - np.eye(3)) > _ORTHONORMAL).any(axis=(1, 2))
        wrong |= np.linalg.det(matrices) < 0
        if wrong.any():
            row, body = (int(index) for index in np.argwhere(there)[int(np.argmax(wrong))])
            raise FileFormatError(
                f"the matrix of {layout.names[body]} is not a rotation",
                path=path,
                line=int(table.lines[row]),
                expected="orthonormal columns and a determinant of 1",
                advice="Export the recording again.",
            )
        left, _, right = np.linalg.svd(matrices)
        rotations[there] = left @ right
    return rotations, translations, residuals


def _lead(header: Header) -> tuple[str, ...]:
    titles = [title.lower() for title in (header.titles or ())[:2]]
    if titles == ["frame", "time"]:
        return ("frame", "time")
    if titles[:1] in (["frame"], ["time"]):
        return (titles[0],)
    row = header.first_row
    if header.titles is None and row and re.fullmatch(r" *[0-9]+ *", row[0]):
        return ("frame", "time")
    return ()


def _blank_between(header: Header, lead: int, count: int) -> bool:
    size = BODY_COLUMNS
    places = [lead + (size + 1) * body - 1 for body in range(1, count)]
    return all(not header.first_row[place].strip() for place in places)
