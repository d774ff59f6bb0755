"""The eyebrows: hairs that lie on the skin."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicSpline, PchipInterpolator

from mocap_fit.face.builtin.flesh import locate_skin
from mocap_fit.face.builtin.strands import build_strands, scatter, spread_evenly
from mocap_fit.face.builtin.surfaces import Colour, Piece
from mocap_fit.tracks import FloatArray

BROW: Colour = (0.27, 0.19, 0.135)
_HAIRS = 190
_PATH = CubicSpline([0, 0.3, 0.68, 1], [[12.5, 79.4], [23.5, 82.3], [37, 83.3], [49, 78.6]])
_HALF_WIDTH = PchipInterpolator([0, 0.04, 0.14, 0.35, 0.7, 1], [1.6, 2.2, 2.8, 2.6, 1.7, 0.4])
# Along the brow: the hairs' angle from its line, degrees, and their length, millimetres.
_ANGLE = PchipInterpolator([0, 0.12, 0.35, 0.7, 1], [78, 52, 26, 10, 4])
_LENGTH = PchipInterpolator([0, 0.15, 0.5, 1], [4.6, 6.6, 7.4, 5.0])


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
        Hairs that lie on the skin.
    """
    share, across = spread_evenly(_HAIRS).T
    share = np.clip(share**1.1 + 0.03 * (scatter(_HAIRS, 10) - 0.5), 0, 1) * 0.97
    # The hairs are denser in the middle than at the edges.
    across = 2 * across - 1
    across -= 0.3 * np.sin(np.pi * across)
    along = _PATH(share, 1)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    upwards = np.stack([-along[:, 1], along[:, 0]], axis=1)
    # Those at the lower edge rise, those at the upper edge fall: they meet in the middle.
    angle = np.radians(_ANGLE(share) * (1 - 0.45 * across) - 9 * across)
    angle += 0.3 * (scatter(_HAIRS, 11) - 0.5)
    length = _LENGTH(share) * (0.6 + 0.6 * scatter(_HAIRS, 12))
    growing = np.cos(angle)[:, None] * along + np.sin(angle)[:, None] * upwards
    start = _PATH(share) + (_HALF_WIDTH(share) * across)[:, None] * upwards
    # A hair bends towards the line of the brow.
    middle = start + 0.5 * length[:, None] * growing
    end = middle + 0.5 * length[:, None] * (0.8 * growing + 0.2 * along)
    root, middle, tip = (locate_skin(np.maximum(seen, [1.0, 0.0])) for seen in (start, middle, end))
    normal = np.stack([root[:, 0] / 80, np.full(_HAIRS, 0.1), np.ones(_HAIRS)], axis=1)
    for points, lift in ((root, 0.15), (middle, 0.7), (tip, 0.6)):
        points += lift * normal
    shade = 0.75 + 0.6 * scatter(_HAIRS, 13)
    thin = 0.6 + 0.4 * np.sin(np.pi * np.clip(share, 0.1, 0.9))
    return build_strands(root, middle, tip, normal, 0.5 * thin, np.outer(shade, BROW))
