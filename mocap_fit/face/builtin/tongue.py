"""The tongue: a closed body with a tip, a blade, a grooved back and a root."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import PchipInterpolator

from mocap_fit.face.builtin.mouth import compute_front_depth
from mocap_fit.face.builtin.surfaces import (
    Colour,
    Piece,
    compute_hill,
    paint_piece,
    smoothstep,
    triangulate_fan,
    triangulate_strip,
)
from mocap_fit.tracks import FloatArray

TONGUE_ROWS = 28
TONGUE_COLUMNS = 20

_TONGUE: Colour = (0.90, 0.50, 0.49)
_DARK_BELOW = 0.92
# How far the tip is behind the upper front teeth, and the root behind the tip, mm.
_TIP_BEHIND = 12.0
_LENGTH = 58.0
# Position along the tongue, 0 tip to 1 root; there the heights of its back, its borders and its
# underside, and its half width, mm.
_ALONG = [0.0, 0.05, 0.15, 0.3, 0.5, 0.7, 0.85, 1.0]
_BACK = [-7.4, -6.8, -5.0, -0.6, 3.2, 2.6, -2.5, -11.0]
_BORDERS = [-8.0, -7.9, -7.2, -5.2, -4.0, -5.0, -8.5, -15.0]
_UNDERSIDE = [-8.8, -9.2, -9.8, -11.4, -13.2, -15.0, -18.0, -22.0]
_HALF_WIDTHS = [7.4, 8.4, 10.2, 12.8, 14.9, 15.6, 14.0, 11.0]
# The tip is rounded over this length, mm.
_ROUND = 4.5
_GROOVE_DEPTH, _GROOVE_WIDTH = 1.5, 3.2


def build_tongue() -> Piece:
    """Build the tongue, a closed body whose tip rests behind the lower teeth.

    Returns
    -------
    Piece
        Ring after ring of `TONGUE_COLUMNS` vertices from the tip backwards (each starts at the
        speaker's left border and runs over the back), then the points that close tip and root.
    """
    # Denser towards the tip.
    share = np.linspace(0, 1, TONGUE_ROWS)[:, None] ** 1.5
    angle = 2 * np.pi * np.arange(TONGUE_COLUMNS) / TONGUE_COLUMNS
    back, borders, underside, half_width = (
        _interpolate(share, values) for values in (_BACK, _BORDERS, _UNDERSIDE, _HALF_WIDTHS)
    )
    to_tip = 1 - np.minimum((_LENGTH * share + 0.4) / _ROUND, 1)
    fullness = np.sqrt(1 - to_tip**2)
    cosine, sine = np.round(np.cos(angle), 12), np.round(np.sin(angle), 12)
    x = fullness * half_width * np.sign(cosine) * np.abs(cosine) ** 0.85
    upwards = (back - borders) * np.maximum(sine, 0.0) ** 0.9
    downwards = (borders - underside) * sine
    y = borders + fullness * np.where(sine > 0, upwards, downwards)
    y = y - _GROOVE_DEPTH * compute_hill(x, 0, _GROOVE_WIDTH) * (sine > 0) * np.sin(np.pi * share)
    z = compute_front_depth() - _TIP_BEHIND - _LENGTH * share
    rings = np.stack(np.broadcast_arrays(x, y, z), axis=2)
    beyond = np.array([0.0, 0.0, 0.4])
    tip, root = rings[0].mean(axis=0) + beyond, rings[-1].mean(axis=0) - beyond
    vertices = np.concatenate([rings.reshape(-1, 3), [tip, root]])
    index = np.arange(TONGUE_ROWS * TONGUE_COLUMNS).reshape(TONGUE_ROWS, TONGUE_COLUMNS)
    triangles = [triangulate_strip(index[i + 1], index[i]) for i in range(TONGUE_ROWS - 1)]
    triangles.append(triangulate_fan(index[0], index.size))
    triangles.append(triangulate_fan(index[-1], index.size + 1)[:, ::-1])
    piece = paint_piece(vertices, np.concatenate(triangles), _TONGUE)
    # Little light comes to the root, or below the tongue.
    lit = 0.55 + 0.45 * smoothstep((vertices[:, 2] - vertices[:, 2].min()) / 45)
    lit[: index.size] *= np.tile(_DARK_BELOW + (1 - _DARK_BELOW) * (sine > -0.1), TONGUE_ROWS)
    return Piece(piece.vertices, piece.triangles, piece.colours * lit[:, None])


def _interpolate(share: FloatArray, values: list[float]) -> FloatArray:
    return np.asarray(PchipInterpolator(_ALONG, values)(share))
