"""The tongue."""

from __future__ import annotations

import numpy as np

from mocap_fit.face.builtin.surfaces import (
    Colour,
    Piece,
    compute_hill,
    paint_piece,
    smoothstep,
    triangulate_fan,
    triangulate_strip,
)
from mocap_fit.face.builtin.teeth import compute_front_depth

_TONGUE: Colour = (0.74, 0.38, 0.38)
_LENGTH = 50.0
TONGUE_ROWS = 16
TONGUE_COLUMNS = 16


def build_tongue() -> Piece:
    """Build the tongue, a closed body whose tip rests behind the lower teeth.

    Returns
    -------
    Piece
        Ring after ring of `TONGUE_COLUMNS` vertices from the tip backwards (each starts at the
        speaker's left border and runs over the top), then the points that close tip and root.
    """
    share = np.linspace(0, 1, TONGUE_ROWS)[:, None]
    angle = 2 * np.pi * np.arange(TONGUE_COLUMNS) / TONGUE_COLUMNS
    z = compute_front_depth() - 10.0 - _LENGTH * share
    half_width = 19.0 * (1 - (1 - np.minimum(share / 0.42, 1)) ** 2.2) ** 0.5 * (1 - 0.12 * share)
    cosine, sine = np.cos(angle), np.sin(angle)
    x = (half_width + 1.2) * cosine
    middle = -8.5 + 4.5 * np.sin(np.pi * np.minimum(0.85 * share, 1))
    taper = 0.35 + 0.65 * smoothstep(share / 0.35)
    y = middle + taper * np.where(sine > 0, 5.5 * sine, 4.5 * sine)
    y = y - 1.3 * compute_hill(x, 0, 2.5) * (sine > 0) * np.sin(np.pi * share)
    rings = np.stack(np.broadcast_arrays(x, y, z), axis=2)
    beyond = np.array([0.0, 0.0, 1.5])
    tip, root = rings[0].mean(axis=0) + beyond, rings[-1].mean(axis=0) - beyond
    vertices = np.concatenate([rings.reshape(-1, 3), [tip, root]])
    index = np.arange(TONGUE_ROWS * TONGUE_COLUMNS).reshape(TONGUE_ROWS, TONGUE_COLUMNS)
    triangles = [triangulate_strip(index[i + 1], index[i]) for i in range(TONGUE_ROWS - 1)]
    triangles.append(triangulate_fan(index[0], index.size))
    triangles.append(triangulate_fan(index[-1], index.size + 1)[:, ::-1])
    piece = paint_piece(vertices, np.concatenate(triangles), _TONGUE)
    darker = 0.55 + 0.45 * smoothstep((vertices[:, 2] - vertices[:, 2].min()) / 45)
    return Piece(piece.vertices, piece.triangles, piece.colours * darker[:, None])
