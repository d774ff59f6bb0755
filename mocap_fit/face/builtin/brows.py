"""The eyebrows: strips that lie on the skin."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicSpline, PchipInterpolator

from mocap_fit.face.builtin.flesh import locate_skin
from mocap_fit.face.builtin.surfaces import Colour, Piece, paint_piece, triangulate_grid
from mocap_fit.tracks import FloatArray

_BROW: Colour = (0.25, 0.17, 0.12)
_ROWS, _COLUMNS = 22, 5
_PATH = CubicSpline([0, 0.3, 0.68, 1], [[12.5, 79.4], [23.5, 82.3], [37, 83.3], [49, 78.6]])
_HALF_WIDTH = PchipInterpolator([0, 0.04, 0.14, 0.35, 0.7, 1], [0.5, 1.3, 2.1, 2.4, 1.6, 0.2])


def trace_brow(share: FloatArray) -> FloatArray:
    """Return the middle line of the left brow, seen from the front.

    Parameters
    ----------
    share
        Positions along the brow, ``(points,)``, 0 at its inner end to 1 at its outer.

    Returns
    -------
    ndarray
        x and y, ``(points, 2)``, millimetres.
    """
    return np.asarray(_PATH(share))


def build_brow() -> Piece:
    """Build the left brow.

    Returns
    -------
    Piece
        A strip that lies on the skin.
    """
    share = np.linspace(0, 1, _ROWS)
    direction = _PATH(share, 1)
    upwards = np.stack([-direction[:, 1], direction[:, 0]], axis=1)
    upwards /= np.linalg.norm(upwards, axis=1, keepdims=True)
    across = np.linspace(-1, 1, _COLUMNS)
    offset = _HALF_WIDTH(share)[:, None, None] * upwards[:, None] * across[:, None]
    vertices = locate_skin((_PATH(share)[:, None] + offset).reshape(-1, 2))
    thickness = np.clip(_HALF_WIDTH(share) / 2.5, 0, 1)[:, None] * (1 - across**2)
    vertices[:, 2] += 0.35 + 0.9 * thickness.ravel()
    return paint_piece(vertices, triangulate_grid(_ROWS, _COLUMNS), _BROW)
