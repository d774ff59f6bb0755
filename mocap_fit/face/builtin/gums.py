"""The gums: two closed bodies that hold the teeth; one ends in the palate, one in the floor.

Each is a sheet of rows along the arch, from the fold behind the lip over the ridge that holds the
teeth to the middle of the palate or floor, and a lid over its hidden side.
"""

from __future__ import annotations

import numpy as np

from mocap_fit.face.builtin.mouth import compute_front_depth, compute_shade
from mocap_fit.face.builtin.surfaces import Piece, smoothstep, triangulate_fan
from mocap_fit.face.builtin.teeth import Arch, measure_arch
from mocap_fit.face.mesh import IndexArray
from mocap_fit.tracks import FloatArray

# Columns a tooth, and how far the gum comes down between two teeth (mm), from the middle out.
_COLUMNS = 4
_PAPILLAE = np.array([4.0, 4.0, 3.8, 3.2, 2.8, 2.4, 2.0, 1.0])
# How much of a crown's height the gum leaves free.
_FREE = 0.94
# From the teeth to the middle: the rows of palate and floor.
_INWARDS = np.array([0.12, 0.3, 0.52, 0.76, 1.0])
# Heights of the fold behind the lips, and of palate and floor in the middle, over their distance
# behind the front teeth (mm).
_FOLD = {True: 13.0, False: -16.0}
_MIDDLE = {
    True: ([9, 14, 22, 32, 42, 50, 58, 64], [5.6, 8.5, 14.5, 17.0, 17.2, 15.0, 8.0, 0.0]),
    False: ([9, 14, 22, 40, 64], [-14.0, -17.5, -19.5, -20.5, -21.0]),
}
# Behind the last teeth: where the sheet's outer edge goes on, x and distance behind the front.
_BEHIND = [(28.5, 47.0), (26.0, 54.0), (20.0, 61.0)]
_LID = {True: 25.0, False: -26.0}
_GUM = np.array([0.74, 0.40, 0.39])
_EDGE = np.array([0.80, 0.50, 0.47])
_INNER = {True: np.array([0.70, 0.38, 0.36]), False: np.array([0.58, 0.24, 0.24])}


def build_gums(*, upper: bool) -> Piece:
    """Build the gum of one row of teeth, with the palate or the floor of the mouth.

    Parameters
    ----------
    upper
        Whether it is the upper one.

    Returns
    -------
    Piece
        A closed body.
    """
    arch = measure_arch(upper=upper)
    sheet = _trace_sheet(arch)
    rows, columns = sheet.shape[:2]
    # The left half and its mirror image share the column and the row in the middle.
    left = np.arange(rows * columns).reshape(rows, columns)
    doubled = np.ones((rows, columns), dtype=bool)
    doubled[:, 0] = doubled[-1] = False
    right = left.copy()
    right[doubled] = rows * columns + np.arange(int(doubled.sum()))
    points = sheet.reshape(-1, 3)
    points[left[:, 0], 0] = points[left[-1], 0] = 0.0
    colours = _colour_sheet(arch, sheet).reshape(-1, 3)
    front = points[:, 2].max()
    lid = np.array([[0.0, _LID[upper], front - 55.0]])
    vertices = np.concatenate([points, points[doubled.ravel()] * [-1, 1, 1], lid])
    colours = np.concatenate([colours, colours[doubled.ravel()], colours[:1]])
    grid = _triangulate_sheet(left)
    other = _triangulate_sheet(right)[:, ::-1]
    border = np.concatenate([left[0, ::-1], right[0, 1:], right[1:, -1], left[-2:0:-1, -1]])
    closing = triangulate_fan(border[::-1], len(vertices) - 1)
    triangles = np.concatenate([grid, other, closing])
    return Piece(vertices, triangles if upper else triangles[:, ::-1], colours)


def _trace_sheet(arch: Arch) -> FloatArray:
    """Return the left half, ``(rows, columns, 3)``: from the fold to the middle."""
    along, share = _list_columns(arch)
    points, outwards = arch.locate(along)
    teeth = np.arange(len(arch.centres))
    tooth = np.interp(along, arch.centres, teeth)

    def blend(values: FloatArray) -> FloatArray:
        return np.asarray(np.interp(tooth, teeth, values))

    papilla = np.interp(along, arch.borders, _PAPILLAE) * share
    neck = blend(arch.edges + arch.up * _FREE * arch.heights)
    margin = neck - arch.up * papilla
    depth = blend(arch.depths)
    front_tooth = smoothstep(np.clip(3.2 - tooth, 0, 1))
    # The crowns of front teeth lean back towards their necks, and are hollow behind.
    lean = -0.10 * np.abs(margin - blend(arch.edges)) * front_tooth
    behind = -depth + 0.45 * papilla * front_tooth
    fold = np.full(len(along), _FOLD[arch.upper])
    bulge = 0.9 * (1 - share)
    profile = [
        (0.2 + 0 * share, fold),
        (-0.2 + bulge, 0.5 * fold + 0.5 * neck),
        (0.1 + lean + 0.5 * bulge, neck + 0.22 * (fold - neck)),
        (0.25 + lean - 1.5 * share, margin + 0.15 * arch.up),
        (-1.6 + lean - 1.2 * share, margin + 0.5 * arch.up),
        (behind + 1.6 + 0.8 * share, margin + 0.5 * arch.up),
        (behind - 0.25, margin + 0.15 * arch.up),
        (behind - 1.2, neck + 1.8 * arch.up),
    ]
    ridge = np.stack(
        [
            np.stack(
                [points[:, 0] + out * outwards[:, 0], y, points[:, 1] + out * outwards[:, 1]],
                axis=1,
            )
            for out, y in profile
        ]
    )
    ridge = np.concatenate([ridge, _continue_ridge(arch, ridge[:, -1])], axis=1)
    return np.concatenate([ridge, _trace_inside(arch, ridge)])


def _list_columns(arch: Arch) -> tuple[FloatArray, FloatArray]:
    """Return distances along the arch, and 0 at the middle of a tooth to 1 between two."""
    within = np.arange(_COLUMNS) / _COLUMNS
    widths = np.diff(arch.borders)
    along = (arch.borders[:-1, None] + widths[:, None] * within).ravel()
    share = np.tile((1 - np.sin(np.pi * within)) ** 1.3, len(widths))
    return np.append(along, arch.borders[-1]), np.append(share, 1.0)


def _continue_ridge(arch: Arch, last: FloatArray) -> FloatArray:
    """Return the columns behind the last tooth, ``(rows, columns, 3)``: the ridge flattens."""
    front = compute_front_depth()
    columns = []
    width = last[:, 0] - last[:, 0].max()
    for step, (x, behind) in enumerate(_BEHIND):
        flat = (step + 1) / len(_BEHIND)
        middle = np.interp(behind, *_MIDDLE[arch.upper])
        y = last[:, 1] * (1 - flat) + flat * (0.75 * middle + 0.25 * last[0, 1])
        columns.append(np.stack([x + width, y, np.full(len(last), front - behind)], axis=1))
    return np.stack(columns, axis=1)


def _trace_inside(arch: Arch, ridge: FloatArray) -> FloatArray:
    """Return the rows of palate or floor, ``(rows, columns, 3)``."""
    inner = ridge[-1]
    front = compute_front_depth()
    columns = np.linspace(0, 1, len(inner))
    behind = 10.0 + 51.0 * columns**1.25
    height = np.interp(behind, *_MIDDLE[arch.upper])
    inwards = _INWARDS[:, None]
    x = inner[:, 0] * (1 - inwards)
    z = inner[:, 2] * (1 - inwards) + (front - behind) * inwards
    y = inner[:, 1] + (height - inner[:, 1]) * (1 - (1 - inwards) ** 2)
    return np.stack([x, y, z], axis=2)


def _triangulate_sheet(index: IndexArray) -> IndexArray:
    here, there = index[:-1, :-1].ravel(), index[:-1, 1:].ravel()
    inner, across = index[1:, :-1].ravel(), index[1:, 1:].ravel()
    return np.concatenate(
        [np.stack([here, inner, there], axis=1), np.stack([inner, across, there], axis=1)]
    )


def _colour_sheet(arch: Arch, sheet: FloatArray) -> FloatArray:
    rows = np.arange(len(sheet))
    edge = np.exp(-0.5 * ((rows - 3) / 0.8) ** 2)[:, None]
    inside = smoothstep((rows - 6) / 4)[:, None]
    colour = _GUM * (1 - edge) + _EDGE * edge
    colour = colour * (1 - inside) + _INNER[arch.upper] * inside
    shade = compute_shade(sheet[..., 2].ravel()).reshape(sheet.shape)
    return np.asarray(colour[:, None] * shade)
