"""The skin as one surface: rings, the fill between them, and the mirror image."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import RegularGridInterpolator

from mocap_fit.face.builtin import ears, eyes, flesh, mouth, nose, skull
from mocap_fit.face.builtin.skin_fill import Spacing, fill, flip_edges
from mocap_fit.face.builtin.surfaces import (
    MIRROR,
    compute_bump,
    smooth_vertices,
    smoothstep,
    triangulate_fan,
    triangulate_strip,
)
from mocap_fit.face.mesh import IndexArray
from mocap_fit.tracks import FloatArray

# The fill stops this far (mm) below the crown, where the unrolled plane would tear.
_BELOW_CROWN = 5.0


@dataclass(frozen=True, eq=False)
class Skin:
    """The complete skin, the left half's vertices first.

    Parameters
    ----------
    vertices
        Positions, ``(vertices, 3)``, millimetres.
    triangles
        Vertex indices, ``(triangles, 3)``.
    kinds
        ``fill`` or what the vertex's ring belongs to, such as ``vermilion``, ``(vertices,)``.
    levels
        Levels on the bare head, ``(vertices,)``, millimetres along its surface, NaN off the fill.
    azimuths
        Azimuths on the bare head, ``(vertices,)``, radians, negative on the right, NaN off the
        fill.
    mirror
        Index of each vertex's mirror image, ``(vertices,)``.
    mouth, eye, nostril, ear
        Vertex indices of the left half's rings, from the inside outwards for mouth and eye (the
        mouth's last entry is the one vertex that closes the bag), from the skin inwards for nostril
        and ear.
    """

    vertices: FloatArray
    triangles: IndexArray
    kinds: NDArray[np.str_]
    levels: FloatArray
    azimuths: FloatArray
    mirror: IndexArray
    mouth: tuple[IndexArray, ...]
    eye: tuple[IndexArray, ...]
    nostril: tuple[IndexArray, ...]
    ear: tuple[IndexArray, ...]


class _Half:
    """The left half while it is being built."""

    def __init__(self) -> None:
        self.points: list[FloatArray] = []
        self.kinds: list[str] = []
        self.triangles: list[IndexArray] = []

    def add(self, points: FloatArray, kind: str) -> IndexArray:
        """Add vertices and return their indices."""
        start = len(self.kinds)
        self.points.append(np.atleast_2d(points))
        self.kinds += [kind] * len(self.points[-1])
        return np.arange(start, len(self.kinds))

    def add_strips(
        self,
        start: IndexArray,
        rings: list[tuple[str, FloatArray]],
        *,
        closed: bool,
    ) -> list[IndexArray]:
        """Add rings one inside the other, beginning at vertices that exist already."""
        indices = [start]
        for kind, points in rings:
            indices.append(self.add(points, kind))
            self.triangles.append(triangulate_strip(indices[-2], indices[-1], closed=closed))
        return indices


def build_skin() -> Skin:
    """Build the skin of the built-in head.

    Returns
    -------
    Skin
        One surface, open at the eyes and the neck.
    """
    half = _Half()
    mouth_rings, lid_rings = mouth.build_mouth_rings(), eyes.build_lid_rings()
    nostril_rim, ear_base = nose.trace_nostril(), ears.trace_ear_outline()
    plane = _Plane()
    mouth_outline = plane.unroll(*skull.locate(mouth_rings[-1].points[:, :2]))
    mouth_outline[[0, -1], 0] = 0.0
    holes = [
        plane.unroll(*skull.locate(lid_rings[-1][:, :2])),
        plane.unroll(*skull.locate(nostril_rim)),
        plane.unroll(*skull.locate(ear_base, (2, 1))),
    ]
    outline, mouth_start = plane.trace_outline(mouth_outline)
    flat, triangles = fill(outline, holes, plane.spacing)
    azimuth, level = plane.to_surface(flat)
    midline = np.zeros(len(flat), dtype=bool)
    midline[: len(outline)] = (outline[:, 0] == 0) | (azimuth[: len(outline)] > np.pi - 1e-6)
    points = flesh.shape_skin(azimuth, level)
    points[midline, 0] = 0.0
    starts = np.cumsum([len(outline), *(len(hole) for hole in holes)])
    on_mouth = np.arange(mouth_start, mouth_start + mouth.HALF_RING)
    on_eye, on_nostril, on_ear = (np.arange(first, last) for first, last in pairwise(starts))
    points[on_mouth] = mouth_rings[-1].points
    points[on_eye] = lid_rings[-1]
    triangles = triangles[~midline[triangles].all(axis=1)]
    half.add(points, "fill")
    half.triangles.append(flip_edges(points, triangles))
    _label(half, on_mouth, "skin")
    _label(half, on_eye, "eyelid")
    _label(half, on_nostril, "nostril")

    mouth_index = half.add_strips(
        on_mouth, [(ring.kind, ring.points) for ring in mouth_rings[-2::-1]], closed=False
    )
    deepest = mouth_rings[0].points[:, [1, 2]].mean(axis=0)
    bag_end = half.add(np.array([0.0, deepest[0], deepest[1] - 5.0]), "bag")
    half.triangles.append(triangulate_fan(mouth_index[-1], int(bag_end[0]), closed=False))
    eye_index = half.add_strips(
        on_eye, [("eyelid", ring) for ring in lid_rings[-2::-1]], closed=True
    )
    tunnel = nose.build_nostril_tunnel(points[on_nostril])
    nostril_index = half.add_strips(on_nostril, [("nostril", ring) for ring in tunnel], closed=True)
    nostril_end = half.add(tunnel[-1].mean(axis=0) + np.array([0.0, 1.2, -0.8]), "nostril")
    half.triangles.append(triangulate_fan(nostril_index[-1], int(nostril_end[0])))
    ear_rings = ears.build_ear_rings()
    ear_index = half.add_strips(on_ear, [("ear", ring) for ring in ear_rings[1:]], closed=True)
    ear_end = half.add(ear_rings[-1].mean(axis=0), "ear")
    half.triangles.append(triangulate_fan(ear_index[-1], int(ear_end[0])))
    crown_row = plane.find_crown_row(outline)
    crown = half.add(skull.CROWN, "fill")
    half.triangles.append(triangulate_fan(crown_row, int(crown[0]), closed=False))
    return _complete_skin(
        half,
        azimuth,
        level,
        mouth=(*mouth_index[::-1], bag_end),
        eye=tuple(eye_index[::-1]),
        nostril=tuple(nostril_index),
        ear=tuple(ear_index),
    )


def _label(half: _Half, indices: IndexArray, kind: str) -> None:
    for index in indices:
        half.kinds[index] = kind


class _Plane:
    """The unrolled left half of the head: x is azimuth × girth, y is level."""

    def __init__(self) -> None:
        self.low, crown = skull.get_level_range()
        self.high = crown - _BELOW_CROWN
        self.spacing = self._prepare_spacing()

    def unroll(self, azimuth: FloatArray, level: FloatArray) -> FloatArray:
        """Return points of the plane for azimuths and levels."""
        return np.stack([azimuth * skull.compute_girth(level), level], axis=1)

    def to_surface(self, flat: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return azimuths and levels for points of the plane."""
        return np.clip(flat[:, 0] / skull.compute_girth(flat[:, 1]), 0.0, np.pi), flat[:, 1]

    def _prepare_spacing(self) -> Spacing:
        """Return the desired edge length as a function of the plane, read from a grid."""
        width = float(np.pi * skull.compute_girth(np.linspace(self.low, self.high, 200)).max())
        x, y = np.linspace(0, width, 220), np.linspace(self.low, self.high, 260)
        flat = np.stack(np.meshgrid(x, y, indexing="ij"), axis=2).reshape(-1, 2)
        grid = RegularGridInterpolator(
            (x, y), _compute_edge_length(*self.to_surface(flat)).reshape(220, 260)
        )

        def interpolate_spacing(points: FloatArray) -> FloatArray:
            inside = np.clip(points, [x[0], y[0]], [x[-1], y[-1]])
            return np.asarray(grid(inside))

        return interpolate_spacing

    def trace_outline(self, mouth_outline: FloatArray) -> tuple[FloatArray, int]:
        """Return the region's outline, clockwise, and where in it the mouth begins.

        From the neck's front: up to the mouth, round it, up to the top, to the back, down, and
        along the neck to the front.
        """
        below = self._trace_column(self.low, float(mouth_outline[0, 1]), 0.0)
        above = self._trace_column(float(mouth_outline[-1, 1]), self.high, 0.0)
        top = self._trace_row(self.high, 8)
        back = self._trace_column(self.low, self.high, np.pi)[::-1]
        neck = self._trace_row(self.low, 15)[::-1]
        pieces = [below[:-1], mouth_outline, above[1:-1], top[:-1], back[:-1], neck[:-1]]
        return np.concatenate(pieces), len(pieces[0])

    def find_crown_row(self, outline: FloatArray) -> IndexArray:
        """Return the outline's uppermost row, from the front to the back."""
        row = np.flatnonzero(np.abs(outline[:, 1] - self.high) < 1e-9)
        return row[np.argsort(outline[row, 0])]

    def _trace_row(self, level: float, count: int) -> FloatArray:
        return self.unroll(np.linspace(0, np.pi, count), np.full(count, level))

    def _trace_column(self, low: float, high: float, azimuth: float) -> FloatArray:
        levels = [low]
        while levels[-1] < high:
            here = self.unroll(np.array([azimuth]), np.array([min(levels[-1], self.high)]))
            levels.append(levels[-1] + float(self.spacing(here)[0]))
        level = low + (np.array(levels) - low) * (high - low) / (levels[-1] - low)
        level[-1] = high
        return self.unroll(np.full(len(level), azimuth), level)


def _compute_edge_length(azimuth: FloatArray, level: FloatArray) -> FloatArray:
    """Return the desired edge length (mm): fine at mouth, eyes and nose, coarse behind."""
    x, y, _ = skull.compute_loft(azimuth, level).T
    face = smoothstep((np.cos(azimuth) - 0.15) / 0.55)
    face *= smoothstep((y + 62) / 14) * smoothstep((150 - y) / 35)
    length = 7.0 * (1 - face) + 5.2 * face
    front = np.where(azimuth < np.pi / 2, 0.0, 100.0)
    for distance, finest, growth in (
        (np.hypot(np.maximum(x - 25, 0), y) - 6, 3.3, 0.10),  # mouth
        (np.hypot((x - 31) * 0.7, y - eyes.CENTRE[1]) - 8, 3.0, 0.11),  # eye
        (np.hypot(0.9 * x, np.maximum(np.maximum(21 - y, y - 40), 0)) - 12, 1.8, 0.12),  # nose
        (np.hypot(x - 7, y - 23.5) - 4, 1.15, 0.16),  # nostril
        (np.hypot(x, np.maximum(np.maximum(40 - y, y - 71), 0)) - 8, 2.9, 0.14),  # bridge
    ):
        length = np.minimum(length, finest + growth * np.maximum(distance + front, 0))
    z_offset = skull.compute_loft(azimuth, level)[:, 2] + 4.0
    ear = np.hypot(z_offset, np.maximum(np.abs(y - 48) - 25, 0)) - 14
    beside = np.abs(azimuth - np.pi / 2) < np.pi / 3
    return np.asarray(np.where(beside, np.minimum(length, 3.6 + 0.15 * np.maximum(ear, 0)), length))


def _complete_skin(
    half: _Half, azimuth: FloatArray, level: FloatArray, **rings: tuple[IndexArray, ...]
) -> Skin:
    """Add the mirror image, smooth where pieces meet, and drop unused vertices."""
    points = np.concatenate(half.points)
    triangles = np.concatenate(half.triangles)
    used = np.zeros(len(points), dtype=bool)
    used[triangles] = True
    number = np.cumsum(used) - 1
    points, triangles = points[used], number[triangles]
    count = len(points)
    middle = points[:, 0] == 0.0
    other = np.arange(count)
    other[~middle] = count + np.arange(int((~middle).sum()))
    vertices = np.concatenate([points, points[~middle] * MIRROR])
    both = np.concatenate([triangles, other[triangles][:, ::-1]])
    kinds = np.array(half.kinds)[used]
    kinds = np.concatenate([kinds, kinds[~middle]])
    corners, light = _choose_smoothing(vertices, kinds)
    smooth = smooth_vertices(smooth_vertices(vertices, both, corners, 14), both, light, 3)
    points = smooth[:count].copy()
    points[middle, 0] = 0.0
    surface = np.full((count, 2), np.nan)
    filled = np.flatnonzero(used)[:count]
    on_fill = filled < len(azimuth)
    surface[on_fill, 0] = azimuth[filled[on_fill]]
    surface[on_fill, 1] = level[filled[on_fill]]
    mirror = np.concatenate([other, np.flatnonzero(~middle)])
    return Skin(
        vertices=np.concatenate([points, points[~middle] * MIRROR]),
        triangles=both,
        kinds=kinds,
        levels=np.concatenate([surface[:, 1], surface[~middle, 1]]),
        azimuths=np.concatenate([surface[:, 0], -surface[~middle, 0]]),
        mirror=mirror,
        **{name: tuple(number[ring] for ring in group) for name, group in rings.items()},
    )


def _choose_smoothing(
    vertices: FloatArray, kinds: NDArray[np.str_]
) -> tuple[FloatArray, FloatArray]:
    """Return how much to smooth the corners of the mouth; and nose, ears and crown, lightly."""
    x, y, z = np.abs(vertices[:, 0]), vertices[:, 1], vertices[:, 2]
    corners = 0.6 * compute_bump(x, y, (26.5, 0.5), (3.2, 3.2)) * (z > 60)
    corners *= np.isin(kinds, ["fill", "skin", "border"])
    light = 0.35 * compute_bump(x, y, (9, 27), (8, 7)) * (z > 85) * (kinds == "fill")
    light += 0.25 * (kinds == "ear") + 0.15 * (y > 165)
    return corners, light
