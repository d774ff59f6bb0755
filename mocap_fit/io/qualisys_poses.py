"""The poses in a Qualisys 6DOF export.

A body has sixteen columns: X, Y, Z, three angles, the residual, and ``Rot[0]`` to ``Rot[8]``, the
rotation matrix **column by column**. Some versions of QTM write a blank column between two bodies,
and some write titles for the first body only. The names and the order of the angles are a setting
of the software and differ between files; they are ignored, and the matrix is used.

A lost body is zeros with a residual of -1, or blanks; it becomes NaN.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from mocap_fit.errors import FileFormatError
from mocap_fit.io.number_table import NumberTable
from mocap_fit.io.qualisys_columns import BODY_COLUMNS, Columns
from mocap_fit.tracks import FloatArray

_ORTHONORMAL = 1e-3
"""Tolerance of a rotation matrix that was written with five decimals."""


def extract_poses(table: NumberTable, columns: Columns, path: Path) -> dict[str, FloatArray]:
    """Return the arrays of the pose tracks.

    Parameters
    ----------
    table
        Numbers of the export.
    columns
        Columns of the export.
    path
        File for messages.

    Returns
    -------
    dict
        ``rotations``, ``(frames, bodies, 3, 3)``, no unit: the nearest rotations to the matrices
        of the file; ``translations``, ``(frames, bodies, 3)``, millimetres; and ``residuals``,
        ``(frames, bodies)``, millimetres.

    Raises
    ------
    FileFormatError
        If a matrix is not a right-handed rotation.
    """
    starts = len(columns.lead) + columns.stride * np.arange(len(columns.tracks.labels))
    cells = table.values[:, starts[:, None] + np.arange(len(BODY_COLUMNS))]
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
    for values in (translations, rotations, residuals):
        values[lost] = np.nan
    visible = ~lost
    # Larger numbers are no rotation either, and their products may be infinite.
    matrices = np.clip(rotations[visible], -2, 2)
    if len(matrices):
        products = matrices @ matrices.swapaxes(1, 2)
        wrong = (np.abs(products - np.eye(3)) > _ORTHONORMAL).any(axis=(1, 2))
        wrong |= np.linalg.det(matrices) < 0
        if wrong.any():
            row, body = (int(index) for index in np.argwhere(visible)[int(np.argmax(wrong))])
            raise FileFormatError(
                f"the matrix of {columns.tracks.labels[body]} is not a rotation",
                path=path,
                line=int(table.lines[row]),
                expected="orthonormal columns and a determinant of 1",
                advice="Export the recording again.",
            )
        left, _, right = np.linalg.svd(matrices)
        rotations[visible] = left @ right
    return {"rotations": rotations, "translations": translations, "residuals": residuals}
