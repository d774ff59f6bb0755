"""The points of a C3D file: positions, and which of them were measured."""

from __future__ import annotations

import warnings

import numpy as np
from numpy.typing import NDArray

from mocap_fit.errors import MocapFitWarning
from mocap_fit.io.c3d_layout import Layout
from mocap_fit.io.c3d_parameters import decode
from mocap_fit.io.c3d_structure import Structure
from mocap_fit.tracks import FloatArray, Origin

_CHUNK = 2**22
"""Bytes that are read at a time."""

_UNSIGNED = 65535
"""Some programs write -1 without its sign, as a float."""


def read_points(
    structure: Structure, layout: Layout, factor: float, points: list[int]
) -> tuple[FloatArray, NDArray[np.uint8]]:
    """Read the positions of points; the analog data between them are passed over.

    The fourth number of a point is negative for a gap; 0 means neither residual nor cameras, thus a
    point that was not measured, but only where other points have them.

    Parameters
    ----------
    structure
        Header and parameters of the file.
    layout
        Location of the points.
    factor
        Millimetres in the unit of the file.
    points
        Which of the points to read, from 0.

    Returns
    -------
    positions : ndarray
        Positions, ``(frames, points, 3)``, millimetres; NaN for gaps.
    origin : ndarray
        Codes of `Origin`, ``(frames, points)``, no unit.

    Raises
    ------
    FileFormatError
        If the file becomes shorter while it is read.

    Warns
    -----
    MocapFitWarning
        If header and parameters contradict each other on the scale of integers.
    """
    frame, frames = layout.frame, layout.frames
    scale = factor * (1.0 if frame.width == 4 else _get_scale(structure))
    positions = np.empty((frames, len(points), 3))
    origin = np.empty((frames, len(points)), dtype=np.uint8)
    step = max(1, _CHUNK // frame.size)
    columns = slice(None) if len(points) == frame.points else points
    has_residuals = False
    with structure.path.open("rb") as file, np.errstate(all="ignore"):
        file.seek(structure.data_start)
        for begin in range(0, frames, step):
            end = min(begin + step, frames)
            block = file.read((end - begin) * frame.size)
            if len(block) < (end - begin) * frame.size:
                structure.refuse("the file became shorter while it was read", f"frame {begin}")
            stored = decode(block, frame.width, structure.processor).reshape(end - begin, -1)
            stored = stored[:, : 4 * frame.points]
            numbers = stored.reshape(end - begin, frame.points, 4)[:, columns]
            chunk, residuals = positions[begin:end], numbers[:, :, 3]
            np.multiply(numbers[:, :, :3], scale, out=chunk, dtype=np.float64)
            # Also where the fourth number is none.
            gaps = ~(residuals >= 0) | (residuals == _UNSIGNED) | ~np.isfinite(chunk).all(axis=2)
            chunk[gaps] = np.nan
            has_residuals = has_residuals or bool((residuals > 0).any())
            origin[begin:end] = np.where(residuals == 0, Origin.FILLED, Origin.MEASURED)
            origin[begin:end][gaps] = Origin.MISSING
    if not has_residuals:
        origin[origin == Origin.FILLED] = Origin.MEASURED
    return positions, origin


def _get_scale(structure: Structure) -> float:
    """Return the unit of integers, in the unit of the file."""
    noted, header = (
        abs(scale) for scale in (structure.get_value("POINT", "SCALE"), structure.get_float(7))
    )
    if not header > 0:
        return noted
    if not noted > 0:
        return header
    if abs(noted - header) > 1e-3 * noted:
        warnings.warn(
            f"{structure.path}: its header says a scale of {header:g} and POINT:SCALE {noted:g}, "
            "which is taken",
            MocapFitWarning,
            stacklevel=4,
        )
    return noted
