"""Signed distances from a rigid body, on a grid: how deep a point is in it, and where out is."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from mocap_fit.face.mesh import IndexArray
from mocap_fit.tracks import FloatArray

_njit: Any = numba.njit(cache=True, nogil=True, error_model="numpy")
# Distances beyond this many spacings from the surface are counted in steps of the grid.
_EXACT = 1.8


@dataclass(frozen=True, eq=False)
class DistanceField:
    """Signed distances from a body at the nodes of a grid.

    Parameters
    ----------
    origin
        The first node, ``(3,)``, millimetres.
    spacing
        From node to node, millimetres.
    values
        Distances, ``(x, y, z)``, millimetres; negative inside.
    """

    origin: FloatArray
    spacing: float
    values: FloatArray

    def sample(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Interpolate distances and the directions in which they grow.

        Parameters
        ----------
        points
            Positions, ``(points, 3)``, millimetres.

        Returns
        -------
        distances
            ``(points,)``, millimetres; infinite off the grid.
        directions
            Unit vectors, ``(points, 3)``.
        """
        distances, directions = _sample(
            np.ascontiguousarray(points), self.origin, self.spacing, self.values
        )
        return distances, directions

    def add_pushes(
        self,
        points: FloatArray,
        pairs: IndexArray,
        parts: FloatArray,
        least: FloatArray,
        pose: tuple[FloatArray, FloatArray],
        sums: FloatArray,
        totals: FloatArray,
    ) -> None:
        """Add up what brings points out of the body, in place.

        Parameters
        ----------
        points
            Positions, ``(points, 3)``, millimetres.
        pairs
            Pairs of points, ``(pairs, 2)``, between which a point is tested.
        parts
            Share of the second point of each, ``(pairs,)``.
        least
            How near each of them may come, ``(pairs,)``, millimetres.
        pose
            Rotation ``(3, 3)`` and shift ``(3,)`` of the body.
        sums
            Pushes times their sizes, ``(points, 3)``, square millimetres.
        totals
            Sizes of the pushes, ``(points,)``, millimetres.
        """
        rotation, shift = pose
        pushes = np.zeros_like(points)
        grid = (self.origin, self.spacing, self.values)
        _push((points - shift) @ rotation, pairs, parts, least, *grid, pushes, totals)
        sums += pushes @ rotation.T


def compute_fields(
    vertices: FloatArray,
    triangles: IndexArray,
    box: tuple[FloatArray, FloatArray],
    spacing: float,
    fills: Sequence[tuple[int, int]],
    extend: float = 0.0,
) -> list[DistanceField]:
    """Compute the distances from a body whose hollows are filled, in several ways.

    Parameters
    ----------
    vertices
        Positions, ``(vertices, 3)``, millimetres.
    triangles
        Closed surfaces, which may overlap, ``(triangles, 3)``; normals point out.
    box
        Lower and upper corner of the grid, ``(3,)`` each, millimetres.
    spacing
        From node to node, millimetres.
    fills
        For each field an axis, and the direction along it (1 or -1) in which all behind the body
        counts as inside: what is pushed out of it never goes there.
    extend
        Height along z below which the body goes on as it is there, millimetres.

    Returns
    -------
    list of DistanceField
        The fields.
    """
    shape = np.ceil((box[1] - box[0]) / spacing - 1e-6).astype(np.int64) + 1
    distances, crossings = np.full(shape, np.inf), np.zeros(shape, dtype=np.int32)
    _measure_grid(vertices, triangles, box[0], spacing, distances, crossings)
    body = np.cumsum(crossings, axis=1) != 0
    last = max(round((extend - box[0][2]) / spacing), 0)
    body[:, :, :last] = body[:, :, last : last + 1]
    fields = []
    for axis, direction in fills:
        turned = np.flip(body, axis) if direction < 0 else body
        turned = np.maximum.accumulate(turned, axis=axis)
        inside = np.flip(turned, axis) if direction < 0 else turned
        values = _measure_from_border(inside, distances, spacing)
        # Clefts between teeth are closed: lips and tongue do not go into them.
        values = np.minimum(values, ndimage.gaussian_filter(values, 1.0))
        # A head whose halves mirror each other moves so: nothing of how the grid is filled shows.
        values = 0.5 * (values + values[::-1])
        fields.append(DistanceField(np.asarray(box[0]), float(spacing), values))
    return fields


def _measure_from_border(
    inside: NDArray[np.bool_], distances: FloatArray, spacing: float
) -> FloatArray:
    """Return signed distances from what is inside, exact next to the surface."""
    border = np.zeros_like(inside)
    for axis in range(3):
        changes = np.diff(inside, axis=axis)
        first = [slice(None)] * 3
        second = [slice(None)] * 3
        first[axis], second[axis] = slice(None, -1), slice(1, None)
        border[tuple(first)] |= changes
        border[tuple(second)] |= changes
    if not border.any():
        return np.full(inside.shape, -np.inf if inside.all() else np.inf)
    steps, nearest = ndimage.distance_transform_edt(~border, sampling=spacing, return_indices=True)
    # A node next to the surface is at most one step from it; two neighbours share the step where
    # the surface is one that filling made.
    near = np.where(distances < spacing, distances, 0.5 * spacing)[tuple(nearest)]
    across = inside != inside[tuple(nearest)]
    result = np.where(across, np.maximum(steps - near, 0.5 * near), steps + near)
    # An edge may be thinner than the grid.
    return np.asarray(np.where(inside, -result, np.minimum(result, distances)))


@_njit
def locate_nearest(p, a, b, c):  # type: ignore[no-untyped-def]
    """Locate the point of a triangle that is nearest to another point.

    Parameters
    ----------
    p
        The point, ``(3,)``, millimetres.
    a, b, c
        The triangle's corners, ``(3,)`` each, millimetres.

    Returns
    -------
    tuple of float
        Its shares of the three corners, no unit, which add up to 1.
    """
    bb = bc = cc = d1 = d2 = 0.0
    for k in range(3):
        ab, ac, ap = b[k] - a[k], c[k] - a[k], p[k] - a[k]
        bb += ab * ab
        bc += ab * ac
        cc += ac * ac
        d1 += ab * ap
        d2 += ac * ap
    area = bb * cc - bc * bc
    if area > 1e-18:
        v, w = (cc * d1 - bc * d2) / area, (bb * d2 - bc * d1) / area
        if v >= 0.0 and w >= 0.0 and v + w <= 1.0:
            return 1.0 - v - w, v, w
    # Else it is on an edge; distances are compared without what they have in common.
    s = min(max(d1 / bb, 0.0), 1.0) if bb > 0.0 else 0.0
    best, result = s * s * bb - 2.0 * s * d1, (1.0 - s, s, 0.0)
    s = min(max(d2 / cc, 0.0), 1.0) if cc > 0.0 else 0.0
    off = s * s * cc - 2.0 * s * d2
    if off < best:
        best, result = off, (1.0 - s, 0.0, s)
    ee, along = bb - 2.0 * bc + cc, d2 - d1 - bc + bb
    s = min(max(along / ee, 0.0), 1.0) if ee > 0.0 else 0.0
    if bb - 2.0 * d1 + s * s * ee - 2.0 * s * along < best:
        result = (0.0, 1.0 - s, s)
    return result


@_njit
def _measure_grid(vertices, triangles, origin, spacing, distances, crossings):  # type: ignore[no-untyped-def]
    """Measure distances from the triangles near them, and count surfaces on the way up."""
    reach = _EXACT * spacing
    a, b, c, p = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    low, high = np.empty(3, np.int64), np.empty(3, np.int64)
    counts = distances.shape
    for t in range(len(triangles)):
        for k in range(3):
            a[k] = vertices[triangles[t, 0], k]
            b[k] = vertices[triangles[t, 1], k]
            c[k] = vertices[triangles[t, 2], k]
            least, most = min(a[k], b[k], c[k]), max(a[k], b[k], c[k])
            low[k] = max(0, math.ceil((least - reach - origin[k]) / spacing))
            high[k] = min(counts[k] - 1, math.floor((most + reach - origin[k]) / spacing))
        for i in range(low[0], high[0] + 1):
            p[0] = origin[0] + i * spacing
            for j in range(low[1], high[1] + 1):
                p[1] = origin[1] + j * spacing
                for k in range(low[2], high[2] + 1):
                    p[2] = origin[2] + k * spacing
                    u, v, w = locate_nearest(p, a, b, c)
                    squared = 0.0
                    for axis in range(3):
                        squared += (p[axis] - u * a[axis] - v * b[axis] - w * c[axis]) ** 2
                    distances[i, j, k] = min(distances[i, j, k], math.sqrt(squared))
        _count_crossings(a, b, c, origin, spacing, low, high, crossings)


@_njit
def _count_crossings(a, b, c, origin, spacing, low, high, crossings):  # type: ignore[no-untyped-def]
    """Count where lines upwards enter (+1) and leave (-1) the body through a triangle."""
    area = (b[0] - a[0]) * (c[2] - a[2]) - (b[2] - a[2]) * (c[0] - a[0])
    if area == 0.0:
        return
    for i in range(low[0], high[0] + 1):
        # Off the nodes by a little, so that no line meets an edge.
        x = origin[0] + i * spacing + 1.37e-5
        for k in range(low[2], high[2] + 1):
            z = origin[2] + k * spacing + 2.11e-5
            u = ((x - a[0]) * (c[2] - a[2]) - (z - a[2]) * (c[0] - a[0])) / area
            v = ((b[0] - a[0]) * (z - a[2]) - (b[2] - a[2]) * (x - a[0])) / area
            if u < 0.0 or v < 0.0 or u + v > 1.0:
                continue
            y = a[1] + u * (b[1] - a[1]) + v * (c[1] - a[1])
            j = max(0, math.ceil((y - origin[1]) / spacing))
            if j < crossings.shape[1]:
                # The normal of a triangle whose area seen from above is positive points down.
                crossings[i, j, k] += 1 if area > 0.0 else -1


@_njit
def _interpolate(x, y, z, origin, spacing, values, direction):  # type: ignore[no-untyped-def]
    """Interpolate linearly between the eight nodes round a point; infinite off the grid.

    `direction` becomes the unit vector in which the distance grows.
    """
    px, py, pz = (x - origin[0]) / spacing, (y - origin[1]) / spacing, (z - origin[2]) / spacing
    a, b, c = math.floor(px), math.floor(py), math.floor(pz)
    nx, ny, nz = values.shape
    if a < 0 or b < 0 or c < 0 or a + 1 >= nx or b + 1 >= ny or c + 1 >= nz:
        return np.inf
    px, py, pz = px - a, py - b, pz - c
    total, gx, gy, gz = 0.0, 0.0, 0.0, 0.0
    for i in range(2):
        wx, sx = (px, 1.0) if i else (1.0 - px, -1.0)
        for j in range(2):
            wy, sy = (py, 1.0) if j else (1.0 - py, -1.0)
            for k in range(2):
                wz, sz = (pz, 1.0) if k else (1.0 - pz, -1.0)
                value = values[a + i, b + j, c + k]
                total += wx * wy * wz * value
                gx += sx * wy * wz * value
                gy += wx * sy * wz * value
                gz += wx * wy * sz * value
    length = max(math.sqrt(gx * gx + gy * gy + gz * gz), 1e-12)
    direction[0], direction[1], direction[2] = gx / length, gy / length, gz / length
    return total


@_njit
def _is_far(x, y, z, least, origin, spacing, values):  # type: ignore[no-untyped-def]
    """Return whether one node next to a point says that it is far: most points are."""
    i = math.floor((x - origin[0]) / spacing)
    j = math.floor((y - origin[1]) / spacing)
    k = math.floor((z - origin[2]) / spacing)
    nx, ny, nz = values.shape
    if i < 0 or j < 0 or k < 0 or i >= nx or j >= ny or k >= nz:
        return False
    # The other seven are at most a diagonal from it.
    return values[i, j, k] - 2.0 * spacing > least


@_njit
def _sample(points, origin, spacing, values):  # type: ignore[no-untyped-def]
    distances, directions = np.empty(len(points)), np.zeros((len(points), 3))
    for n in range(len(points)):
        x, y, z = points[n, 0], points[n, 1], points[n, 2]
        distances[n] = _interpolate(x, y, z, origin, spacing, values, directions[n])
    return distances, directions


@_njit
def _push(points, pairs, parts, least, origin, spacing, values, sums, totals):  # type: ignore[no-untyped-def]
    """Add what brings points between pairs of points out of a body, weighted by its size."""
    direction = np.empty(3)
    for n in range(len(pairs)):
        first, second, part = pairs[n, 0], pairs[n, 1], parts[n]
        x = (1.0 - part) * points[first, 0] + part * points[second, 0]
        y = (1.0 - part) * points[first, 1] + part * points[second, 1]
        z = (1.0 - part) * points[first, 2] + part * points[second, 2]
        if _is_far(x, y, z, least[n], origin, spacing, values):
            continue
        amount = least[n] - _interpolate(x, y, z, origin, spacing, values, direction)
        if amount <= 0.0:
            continue
        for vertex, share in ((first, 1.0 - part), (second, part)):
            totals[vertex] += share * amount
            for k in range(3):
                sums[vertex, k] += share * amount * amount * direction[k]
