"""Teeth and gums."""

from __future__ import annotations

import numpy as np

from mocap_fit.face.builtin.mouth import compute_contact_depth
from mocap_fit.face.builtin.surfaces import (
    Colour,
    Piece,
    join_pieces,
    paint_piece,
    smoothstep,
    triangulate_fan,
    triangulate_grid,
    triangulate_strip,
)
from mocap_fit.face.mesh import IndexArray
from mocap_fit.tracks import FloatArray

_TOOTH: Colour = (0.93, 0.91, 0.85)
_GUM: Colour = (0.72, 0.38, 0.38)

# From the middle outwards, mm: widths and heights of the teeth's crowns.
_UPPER_WIDTHS = [8.3, 6.6, 7.6, 7.0, 6.9, 9.5]
_UPPER_HEIGHTS = [9.8, 8.8, 9.8, 8.4, 7.6, 6.8]
_UPPER_EDGES = [-2.5, -1.9, -2.4, -1.9, -1.3, -0.7]
_LOWER_WIDTHS = [5.4, 5.9, 6.9, 7.0, 7.1, 10.0]
_LOWER_HEIGHTS = [8.6, 8.8, 9.8, 8.4, 7.8, 7.0]
_LOWER_EDGES = [-2.0, -2.0, -2.1, -2.1, -2.1, -2.1]
_BEHIND_THE_LIPS = 7.0
_OVERJET = 2.6
# The share of red, green and blue light that reaches the back teeth, and how deep those are, mm.
_LIGHT_AT_THE_BACK = np.array([0.84, 0.80, 0.76])
_LIT_DEPTH = 26.0


def compute_front_depth() -> float:
    """Return the depth of the upper front teeth.

    Returns
    -------
    float
        z, millimetres.
    """
    return float(compute_contact_depth(np.zeros(1))[0]) - _BEHIND_THE_LIPS


def build_teeth(*, upper: bool) -> Piece:
    """Build one row of twelve teeth, each a closed rounded box; the middle two come first.

    Parameters
    ----------
    upper
        Whether it is the upper row.

    Returns
    -------
    Piece
        The teeth.
    """
    widths = np.array(_UPPER_WIDTHS if upper else _LOWER_WIDTHS)
    heights = np.array(_UPPER_HEIGHTS if upper else _LOWER_HEIGHTS)
    edges = np.array(_UPPER_EDGES if upper else _LOWER_EDGES)
    x = np.linspace(0, 32, 400)
    z = _compute_arch(x, upper=upper)
    along = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(x), np.diff(z)))])
    middle = np.interp(np.cumsum(widths) - widths / 2, along, x)
    slope = np.gradient(z, x)
    left = []
    for tooth, centre_x in enumerate(middle):
        tangent = np.array([1.0, 0.0, np.interp(centre_x, x, slope)])
        tangent /= np.linalg.norm(tangent)
        axes = np.stack([tangent, [0.0, 1.0, 0.0], [-tangent[2], 0.0, tangent[0]]])
        thickness = 3.0 if tooth < 3 else 4.2
        height = heights[tooth]
        centre = np.array(
            [
                centre_x,
                edges[tooth] + (height if upper else -height) / 2,
                np.interp(centre_x, x, z) - 0.8 * thickness,
            ]
        )
        half = np.array([widths[tooth] / 2 - 0.06, height / 2, thickness])
        vertices, triangles = _make_rounded_box()
        left.append(paint_piece(centre + (vertices * half) @ axes, triangles, _TOOTH))
    row = join_pieces([piece for tooth in left for piece in (tooth, tooth.mirror())])
    # Little light comes to the back of a mouth, or behind the teeth.
    shade = smoothstep((compute_front_depth() - row.vertices[:, 2:]) / _LIT_DEPTH)
    return Piece(row.vertices, row.triangles, row.colours * (1 - shade * (1 - _LIGHT_AT_THE_BACK)))


def build_gums(*, upper: bool) -> Piece:
    """Build the gum behind and above (or below) one row of teeth.

    Parameters
    ----------
    upper
        Whether it is the upper one.

    Returns
    -------
    Piece
        A strip.
    """
    x = np.linspace(-29, 29, 25)
    up = np.array([5.8, 7.3, 9.5, 12.5, 15.0] if upper else [-8.2, -9.6, -11.5, -14.0, -16.5])
    forward = np.array([-1.1, 0.3, 0.2, -1.2, -4.2] if upper else [-1.0, 0.2, -0.6, -3.5, -7.0])
    depth = _compute_arch(x, upper=upper)
    vertices = np.stack(
        np.broadcast_arrays(x[:, None], up, depth[:, None] + forward), axis=2
    ).reshape(-1, 3)
    triangles = triangulate_grid(25, 5)
    return paint_piece(vertices, triangles if upper else triangles[:, ::-1], _GUM)


def _compute_arch(x: FloatArray, *, upper: bool) -> FloatArray:
    """Return the depth of the front of a row of teeth."""
    front = compute_front_depth() - (0.0 if upper else _OVERJET)
    return np.asarray(front - (0.028 if upper else 0.031) * x**2 - 0.00012 * np.abs(x) ** 3)


def _make_rounded_box(around: int = 12, up: int = 7) -> tuple[FloatArray, IndexArray]:
    """Make a closed box between -1 and 1 with rounded edges (a superquadric)."""
    azimuth = 2 * np.pi * np.arange(around) / around
    height = np.linspace(-np.pi / 2, np.pi / 2, up + 2)[1:-1][:, None]

    def round_off(value: FloatArray) -> FloatArray:
        return np.asarray(np.sign(value) * np.abs(value) ** 0.5)

    ring = np.stack(
        np.broadcast_arrays(
            round_off(np.cos(azimuth)) * round_off(np.cos(height)),
            round_off(np.sin(height)),
            round_off(np.sin(azimuth)) * round_off(np.cos(height)),
        ),
        axis=2,
    )
    vertices = np.concatenate([ring.reshape(-1, 3), [[0, -1, 0], [0, 1, 0]]])
    index = np.arange(around * up).reshape(up, around)
    triangles = [triangulate_strip(index[i], index[i + 1])[:, ::-1] for i in range(up - 1)]
    triangles.append(triangulate_fan(index[0], around * up))
    triangles.append(triangulate_fan(index[-1], around * up + 1)[:, ::-1])
    return vertices, np.concatenate(triangles)
