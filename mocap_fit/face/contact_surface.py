"""Surfaces of lips, whose shape changes: how far points are in them, and where out is."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from mocap_fit.face.distance_field import locate_nearest
from mocap_fit.face.mesh import IndexArray
from mocap_fit.tracks import FloatArray

_njit: Any = numba.njit(cache=True, nogil=True, error_model="numpy")
# Millimetres: a surface is not seen from farther, and a smooth one is smoothed over such a width.
_REACH, _WIDTH = 5.0, 1.8
# Triangles round two vertices, at most; millimetres by which one may be farther than another.
_MOST, _NEARLY = 40, 0.1


@dataclass(frozen=True, eq=False)
class Surface:
    """Triangles that change shape, and those round each vertex.

    Parameters
    ----------
    triangles
        ``(triangles, 3)``, indices into its vertices.
    starts, around
        The triangles round vertex ``i`` are ``around[starts[i] : starts[i + 1]]``.
    border
        Whether a vertex is on the border of the surface, ``(vertices,)``.
    """

    triangles: IndexArray
    starts: IndexArray
    around: IndexArray
    border: NDArray[np.bool_]

    @classmethod
    def from_triangles(cls, triangles: IndexArray, vertices: int) -> Surface:
        """Sort triangles by their vertices.

        Parameters
        ----------
        triangles
            ``(triangles, 3)``, indices of vertices.
        vertices
            Number of vertices.

        Returns
        -------
        Surface
            The surface.
        """
        corners = triangles.ravel()
        starts = np.concatenate([[0], np.cumsum(np.bincount(corners, minlength=vertices))])
        around = np.argsort(corners, kind="stable") // 3
        edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
        once, uses = np.unique(np.sort(edges, axis=1), axis=0, return_counts=True)
        border = np.zeros(vertices, dtype=bool)
        border[once[uses == 1]] = True
        return cls(np.ascontiguousarray(triangles), starts, around, border)

    def measure(
        self, points: FloatArray, vertices: FloatArray, normals: FloatArray, *, smooth: bool = False
    ) -> tuple[FloatArray, FloatArray]:
        """Measure how far points are from the surface.

        Parameters
        ----------
        points
            Positions, ``(points, 3)``, millimetres.
        vertices
            The surface's vertices, ``(vertices, 3)``, millimetres.
        normals
            Their normals, ``(vertices, 3)``.
        smooth
            Whether distances are those of a smooth surface along it: inexact, but steady for points
            that are deep in it.

        Returns
        -------
        gaps
            Signed distances, ``(points,)``, millimetres; infinite out of reach.
        ways
            Directions out, ``(points, 3)``.
        """
        if smooth:
            gaps, ways = _measure_smoothly(points, vertices, normals, _WIDTH, _REACH)
        else:
            about = (self.triangles, self.starts, self.around, self.border, _REACH)
            gaps, ways = _measure_gaps(points, vertices, normals, *about)
        return gaps, ways


@_njit
def _measure_gaps(  # type: ignore[no-untyped-def]
    points, surface, normals, triangles, starts, around, border, reach
):
    """Return signed distances of points from a surface, and what brings each onto it.

    Only the triangles round the two nearest vertices are looked at; infinite out of reach, and
    where the nearest point is on the edge of the surface.
    """
    gaps, ways = np.full(len(points), np.inf), np.zeros((len(points), 3))
    off, on_border = np.empty(3), np.empty(_MOST, np.bool_)
    distances, alongs, directions = np.empty(_MOST), np.empty(_MOST), np.empty((_MOST, 3))
    for n in range(len(points)):
        p = points[n]
        near, next_near, first, second = reach * reach, reach * reach, -1, -1
        for m in range(len(surface)):
            dx, dy, dz = p[0] - surface[m, 0], p[1] - surface[m, 1], p[2] - surface[m, 2]
            squared = dx * dx + dy * dy + dz * dz
            if squared < near:
                near, next_near, first, second = squared, near, m, first
            elif squared < next_near:
                next_near, second = squared, m
        count = 0
        for vertex in (first, second):
            if vertex < 0:
                continue
            for t in around[starts[vertex] : min(starts[vertex + 1], starts[vertex] + _MOST // 2)]:
                a, b, c = triangles[t]
                u, v, w = locate_nearest(p, surface[a], surface[b], surface[c])
                # All corners that take part in the nearest point are on the border.
                on_border[count] = (
                    (u < 1e-9 or border[a]) and (v < 1e-9 or border[b]) and (w < 1e-9 or border[c])
                )
                squared, size, along = 0.0, 0.0, 0.0
                for k in range(3):
                    off[k] = p[k] - u * surface[a, k] - v * surface[b, k] - w * surface[c, k]
                    normal = u * normals[a, k] + v * normals[b, k] + w * normals[c, k]
                    directions[count, k] = normal
                    squared += off[k] * off[k]
                    size += normal * normal
                    along += normal * off[k]
                distances[count], alongs[count] = (
                    math.sqrt(squared),
                    along / max(size, 1e-12) ** 0.5,
                )
                count += 1
        if count == 0:
            continue
        # A method of arrays would take longer to compile.
        best = 0
        for i in range(1, count):
            if distances[i] < distances[best]:
                best = i
        # Far from straight, and deep: the fold of a corner, not the other lip.
        straight = 0.6 if distances[best] < 1.0 else 0.8
        if on_border[best] or abs(alongs[best]) < straight * distances[best]:
            continue
        gaps[n] = math.copysign(distances[best], alongs[best])
        # Where several are nearly as near, the way out is between theirs.
        for i in range(count):
            weight = math.exp(-(distances[i] - distances[best]) / _NEARLY)
            for k in range(3):
                ways[n, k] += weight * directions[i, k]
        size = max(math.sqrt(ways[n, 0] ** 2 + ways[n, 1] ** 2 + ways[n, 2] ** 2), 1e-12)
        for k in range(3):
            ways[n, k] /= size
    return gaps, ways


@_njit
def _measure_smoothly(points, surface, normals, width, reach):  # type: ignore[no-untyped-def]
    """Return signed distances of points from a smooth surface, and the ways out of it.

    It lies along the vertices and their normals (implicit moving least squares; Kolluri 2008), so
    that no small movement of a point changes its way out.
    """
    gaps, ways = np.full(len(points), np.inf), np.zeros((len(points), 3))
    for n in range(len(points)):
        total, gap = 0.0, 0.0
        for m in range(len(surface)):
            squared, along = 0.0, 0.0
            for k in range(3):
                off = points[n, k] - surface[m, k]
                squared += off * off
                along += off * normals[m, k]
            if squared >= reach * reach:
                continue
            weight = math.exp(-squared / (width * width)) * (1.0 - squared / (reach * reach))
            total += weight
            gap += weight * along
            for k in range(3):
                ways[n, k] += weight * normals[m, k]
        if total < 1e-6:
            continue
        gaps[n] = gap / total
        for k in range(3):
            ways[n, k] /= total
    return gaps, ways
