"""The teeth: two arches of fourteen crowns.

Widths, heights and depths are means of adults (Wheeler's Dental Anatomy); the arches are 55 and
51 mm wide over the outer surfaces of the first molars.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.interpolate import CubicSpline

from mocap_fit.face.builtin.mouth import compute_front_depth, compute_shade
from mocap_fit.face.builtin.surfaces import (
    Piece,
    compute_hill,
    join_pieces,
    smoothstep,
    triangulate_fan,
    triangulate_strip,
)
from mocap_fit.face.mesh import IndexArray
from mocap_fit.tracks import FloatArray

# From the middle outwards: two incisors, the canine, two premolars, two molars. Outermost points of
# the crowns: from the middle, and behind the front of the upper incisors (mm).
_UPPER_OUTLINE = [(4.3, 0.2), (11.3, 2.0), (17.6, 6.6), (21.9, 13.2), (24.9, 20.4)]
_UPPER_OUTLINE += [(27.5, 29.5), (29.2, 39.6)]
_LOWER_OUTLINE = [(2.7, 4.0), (8.2, 5.0), (13.9, 8.5), (18.8, 13.7), (22.4, 20.5)]
_LOWER_OUTLINE += [(25.4, 29.8), (27.4, 40.4)]
# Widths along the arch, depths from cheek to tongue, heights of the crowns, height of the edges at
# rest (mm).
_UPPER_WIDTHS = [8.5, 6.6, 7.6, 7.0, 6.8, 10.0, 9.4]
_UPPER_DEPTHS = [6.6, 6.0, 7.6, 9.0, 9.0, 11.0, 10.8]
_UPPER_HEIGHTS = [10.2, 9.0, 10.0, 8.4, 8.0, 7.4, 7.0]
_UPPER_EDGES = [-2.5, -1.9, -2.6, -1.7, -1.3, -1.0, -0.8]
_LOWER_WIDTHS = [5.3, 5.8, 6.9, 7.1, 7.2, 11.0, 10.4]
_LOWER_DEPTHS = [6.0, 6.3, 7.4, 7.7, 8.2, 10.4, 10.0]
_LOWER_HEIGHTS = [8.8, 9.2, 10.4, 8.6, 8.0, 7.4, 7.0]
_LOWER_EDGES = [-2.9, -2.9, -2.3, -2.3, -1.9, -1.5, -1.5]
_INCISOR, _CANINE, _PREMOLAR, _MOLAR = "incisor", "canine", "premolar", "molar"
_KINDS = [_INCISOR, _INCISOR, _CANINE, _PREMOLAR, _PREMOLAR, _MOLAR, _MOLAR]

_AROUND = 12
_ENAMEL = np.array([0.90, 0.87, 0.79])
_NECK = np.array([0.84, 0.76, 0.62])


@dataclass(frozen=True, eq=False)
class Arch:
    """One row of teeth, its left half.

    Parameters
    ----------
    upper
        Whether it is the upper row.
    borders
        Where along the arch the teeth meet, from the middle on, ``(teeth + 1,)``, millimetres.
    depths
        Depths of the crowns from cheek to tongue, ``(teeth,)``, millimetres.
    heights
        Heights of the crowns, ``(teeth,)``, millimetres.
    edges
        Heights of their edges at rest, ``(teeth,)``, millimetres in the head frame.
    outline
        From a distance along the arch (mm) to x and z in the head frame.
    """

    upper: bool
    borders: FloatArray
    depths: FloatArray
    heights: FloatArray
    edges: FloatArray
    outline: CubicSpline

    @property
    def up(self) -> float:
        """Direction from the teeth to their gum: 1 is up, -1 down."""
        return 1.0 if self.upper else -1.0

    @property
    def centres(self) -> FloatArray:
        """Middles of the teeth along the arch, ``(teeth,)``, millimetres."""
        return np.asarray(0.5 * (self.borders[:-1] + self.borders[1:]))

    def locate(self, along: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return points of the outline and the directions out of the mouth there.

        Parameters
        ----------
        along
            Distances along the arch, ``(points,)``, millimetres, negative on the right.

        Returns
        -------
        points, outwards
            x and z, ``(points, 2)`` each, millimetres; unit vectors.
        """
        points, tangent = self.outline(along), self.outline(along, 1)
        outwards = np.stack([-tangent[:, 1], tangent[:, 0]], axis=1)
        return points, outwards / np.linalg.norm(outwards, axis=1, keepdims=True)


@lru_cache(maxsize=2)
def measure_arch(*, upper: bool) -> Arch:
    """Measure one row of teeth.

    Parameters
    ----------
    upper
        Whether it is the upper row.

    Returns
    -------
    Arch
        The row.
    """
    half = np.array(_UPPER_OUTLINE if upper else _LOWER_OUTLINE)
    half = np.stack([half[:, 0], compute_front_depth() - half[:, 1]], axis=1)
    beyond = half[-1] + 0.8 * (half[-1] - half[-2])
    half = np.concatenate([half, [beyond]])
    both = np.concatenate([half[::-1] * [-1, 1], half])
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(both, axis=0), axis=1))])
    length -= length[-1] / 2
    fine = np.linspace(length[0], length[-1], 400)
    curve = CubicSpline(length, both)(fine)
    true = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(curve, axis=0), axis=1))])
    true -= true[-1] / 2
    widths = np.array(_UPPER_WIDTHS if upper else _LOWER_WIDTHS)
    borders = np.concatenate([[0.0], np.cumsum(widths)])
    # The outside of an arch is longer than the line on which the teeth touch.
    borders *= np.interp(length[-3], fine, true) / (0.5 * (borders[5] + borders[6]))
    return Arch(
        upper,
        borders,
        np.array(_UPPER_DEPTHS if upper else _LOWER_DEPTHS),
        np.array(_UPPER_HEIGHTS if upper else _LOWER_HEIGHTS),
        np.array(_UPPER_EDGES if upper else _LOWER_EDGES),
        CubicSpline(true, curve),
    )


def build_teeth(*, upper: bool) -> Piece:
    """Build one row of fourteen teeth, each a closed crown; the middle two come first.

    Parameters
    ----------
    upper
        Whether it is the upper row.

    Returns
    -------
    Piece
        The teeth.
    """
    arch = measure_arch(upper=upper)
    points, outwards = arch.locate(arch.centres)
    widths = np.diff(arch.borders)
    left = []
    for tooth, kind in enumerate(_KINDS):
        build = _build_front_crown if kind in (_INCISOR, _CANINE) else _build_back_crown
        across, out, down = build(kind, widths[tooth], arch.depths[tooth], arch.heights[tooth])
        direction = outwards[tooth]
        tangent = np.array([direction[1], -direction[0]])
        flat = points[tooth] + np.outer(across, tangent) + np.outer(out, direction)
        y = arch.edges[tooth] + arch.up * down
        vertices = np.stack([flat[:, 0], y, flat[:, 1]], axis=1)
        triangles = _triangulate_crown(len(vertices))
        left.append(
            Piece(
                vertices,
                triangles[:, ::-1] if upper else triangles,
                _colour_crown(across / widths[tooth], down / arch.heights[tooth]),
            )
        )
    row = join_pieces([piece for tooth in left for piece in (tooth, tooth.mirror())])
    return Piece(row.vertices, row.triangles, row.colours * compute_shade(row.vertices[:, 2]))


def _trace_section(
    half_width: FloatArray, outer: FloatArray, inner: FloatArray, square: float
) -> tuple[FloatArray, FloatArray]:
    """Return the rings of a crown, each ``(rings, around)``: across the tooth, and outwards."""
    angle = 2 * np.pi * (np.arange(_AROUND) + 0.5) / _AROUND

    def round_off(value: FloatArray) -> FloatArray:
        return np.asarray(np.sign(value) * np.abs(value) ** square)

    across = half_width[:, None] * round_off(np.cos(angle) / np.cos(angle[0]))
    out = 0.5 * (outer + inner)[:, None] + 0.5 * (outer - inner)[:, None] * round_off(np.sin(angle))
    return across, out


def _build_front_crown(
    kind: str, width: float, depth: float, height: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Build an incisor, flat before and hollow behind, or a canine with its point.

    Returns positions across the tooth, outwards, and towards the gum from the edge, with the
    middle of the edge last but one and the middle of the neck last.
    """
    down = np.array([0.0, 0.04, 0.16, 0.42, 0.72, 1.06])
    half_width = 0.5 * width * np.interp(down, [0, 0.05, 0.25, 1.1], [0.90, 0.95, 0.99, 0.72])
    outer = np.interp(down, [0, 0.04, 0.2, 0.6, 1.1], [-1.15, -0.75, -0.3, 0.0, -0.9])
    thick = np.interp(
        down, [0, 0.04, 0.16, 0.45, 0.75, 1.1], [0.6, 1.4, 2.0, 3.4, depth, depth - 0.6]
    )
    across, out = _trace_section(half_width, outer, outer - thick, 0.72)
    side = 2 * across / width
    if kind == _CANINE:
        lower = 2.0 * np.abs(side) ** 1.2
        out += 0.3 * (1 - side**2)
    else:
        lower = 0.15 * side**2 + 0.55 * np.maximum(side, 0) ** 5 + 0.25 * np.maximum(-side, 0) ** 5
    down = down[:, None] * height + lower * (1 - np.clip(down / 0.8, 0, 1))[:, None]
    # The crown of an incisor stands obliquely: its neck is farther back.
    out += 0.45 - 0.10 * down
    return _close_crown(across, out, down, 0.0)


def _build_back_crown(
    kind: str, width: float, depth: float, height: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Build a premolar with two cusps or a molar with four."""
    size = np.array([0.26, 0.62, 0.86, 1.0, 0.98, 0.84])
    down = np.array([1.7, 0.5, 0.7, 0.36 * height, 0.62 * height, 1.08 * height])
    # The cusps are above the middle of the root: the sides lean in.
    outer = np.array([0.0, 0.0, 0.0, 0.0, -0.05, -0.7]) - 0.5 * depth * (
        1 - np.array([0.26, 0.60, 0.84, 1, 1, 1])
    )
    inner = -depth + 0.5 * depth * (1 - np.array([0.26, 0.60, 0.84, 1, 0.98, 0.90]))
    across, out = _trace_section(0.5 * width * size, outer, inner, 0.66)
    angle = 2 * np.pi * (np.arange(_AROUND) + 0.5) / _AROUND
    if kind == _MOLAR:
        groove = 0.5 + 0.5 * np.cos(4 * angle)
    else:
        groove = np.cos(angle) ** 2 + 0.35 * (np.sin(angle) < 0)
    rows = np.array([0.1, 1.3, 1.1, 0.15, 0, 0])
    return _close_crown(across, out, down[:, None] + np.outer(rows, groove))


def _close_crown(
    across: FloatArray, out: FloatArray, down: FloatArray, tip: float = np.inf
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return all points of a crown: its rings, the middle of its top, the middle of its neck."""
    top, neck = (np.stack([across, out, down])[:, ring].mean(axis=1) for ring in (0, -1))
    points = np.stack([across.ravel(), out.ravel(), down.ravel()])
    top[2] = min(top[2], tip)
    return tuple(np.concatenate([points, top[:, None], neck[:, None]], axis=1))


def _triangulate_crown(vertices: int) -> IndexArray:
    rings = (vertices - 2) // _AROUND
    index = np.arange(rings * _AROUND).reshape(rings, _AROUND)
    triangles = [triangulate_strip(index[i], index[i + 1]) for i in range(rings - 1)]
    triangles.append(triangulate_fan(index[0], vertices - 2)[:, ::-1])
    triangles.append(triangulate_fan(index[-1], vertices - 1))
    return np.concatenate(triangles)


def _colour_crown(across: FloatArray, down: FloatArray) -> FloatArray:
    """Return enamel, yellower at the neck and darker where the next tooth is near."""
    neck = smoothstep((down - 0.35) / 0.7)[:, None]
    between = 1 - 0.30 * smoothstep((np.abs(across) - 0.34) / 0.16)
    edge = 1 - 0.10 * compute_hill(down, 0.0, 0.08)
    return np.asarray((_ENAMEL * (1 - neck) + _NECK * neck) * (between * edge)[:, None])
