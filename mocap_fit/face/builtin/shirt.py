"""The shoulders, in a shirt: what the neck stands on."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import PchipInterpolator

from mocap_fit.face.builtin.surfaces import (
    Colour,
    Piece,
    smoothstep,
    triangulate_strip,
)

SHIRT: Colour = (0.20, 0.255, 0.325)
_POINTS, _RINGS = 36, 16
# Rings from the inside of the collar down: half width and height at the side, depth and height in
# front and behind.
_SECTIONS = np.array(
    [
        [52.0, -86.0, 44.0, -107.0, -60.0, -72.0],
        [57.0, -79.0, 50.5, -101.0, -69.0, -66.0],
        [61.0, -80.0, 53.5, -102.0, -72.0, -69.0],
        [64.5, -84.5, 54.0, -107.0, -74.0, -75.0],
        [92.0, -96.0, 60.0, -121.0, -84.0, -92.0],
        [132.0, -112.0, 68.0, -140.0, -95.0, -118.0],
        [166.0, -132.0, 76.0, -163.0, -103.0, -148.0],
        [186.0, -166.0, 84.0, -196.0, -108.0, -185.0],
        [194.0, -215.0, 90.0, -236.0, -109.0, -228.0],
        [196.0, -270.0, 93.0, -280.0, -108.0, -275.0],
    ]
)
_MIDDLE_DEPTH = -16.0


def build_shirt() -> Piece:
    """Build the shoulders and the collar.

    Returns
    -------
    Piece
        Rings from the inside of the collar down to the chest.
    """
    rows = np.linspace(0, 1, _RINGS) ** 1.25
    sections = PchipInterpolator(np.linspace(0, 1, len(_SECTIONS)), _SECTIONS)(rows)
    width, side_y, front_z, front_y, back_z, back_y = (column[:, None] for column in sections.T)
    around = 2 * np.pi * np.arange(_POINTS) / _POINTS
    cosine, sine = np.cos(around), np.sin(around)
    in_front = cosine > 0
    # Shoulders are flat: the farther out, the squarer.
    square = 1 - 0.35 * smoothstep((width - 70) / 90)
    x = width * np.sign(sine) * np.abs(sine) ** square
    reach = np.where(in_front, front_z - _MIDDLE_DEPTH, _MIDDLE_DEPTH - back_z)
    z = _MIDDLE_DEPTH + reach * np.sign(cosine) * np.abs(cosine) ** square
    y = side_y + (np.where(in_front, front_y, back_y) - side_y) * cosine**2
    vertices = np.stack([x, y, z], axis=2).reshape(-1, 3)
    index = np.arange(_POINTS * _RINGS).reshape(_RINGS, _POINTS)
    triangles = np.concatenate(
        [triangulate_strip(index[row + 1], index[row]) for row in range(_RINGS - 1)]
    )
    # The collar is ribbed, and what is inside it is dark.
    shade = np.repeat(
        np.interp(rows, [0, 0.1, 0.16, 0.34, 0.38], [0.5, 0.8, 0.9, 0.86, 1.0]), _POINTS
    )
    return Piece(vertices, triangles, np.outer(shade, SHIRT))
