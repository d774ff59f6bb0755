"""How deep lips, teeth, tongue and palate are in each other.

Measured on the triangles themselves: a point is in a body if the body's surface winds round it, and
as deep as its nearest triangle is far. `mocap_fit.face.contact` resolves contact in other ways.
"""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
from scipy.spatial import cKDTree

from mocap_fit.face.mesh import IndexArray, Mesh
from mocap_fit.tracks import FloatArray

_njit: Any = numba.njit(cache=True, nogil=True)
# Points of the first in the bodies of the second. A tooth is in its gum, and a gum in the flesh,
# by nature.
_PAIRS = {
    "lips": ("other_lip", "teeth_upper", "teeth_lower", "tongue"),
    "teeth_upper": ("lips", "teeth_lower", "tongue"),
    "teeth_lower": ("lips", "teeth_upper", "tongue", "gums_upper"),
    "tongue": ("lips", "teeth_upper", "teeth_lower", "gums_upper"),
    "gums_upper": ("tongue", "teeth_lower"),
}
_NEAR = 4.0
# Millimetres before a lip: shallower depths of lips in each other are not seen.
_BEFORE = 0.2
# Behind the mouth: the skin round it is closed to a body by triangles to this point, millimetres.
_APEX = np.array([0.0, 0.0, -10.0])


class Depths:
    """Measures how deep the parts of a face are in each other.

    Parameters
    ----------
    mesh
        The face at rest.
    """

    def __init__(self, mesh: Mesh) -> None:
        self.mesh = mesh
        upper, lower = mesh.get_region("upper_lip"), mesh.get_region("lower_lip")
        corners = np.intersect1d(upper, lower)
        self._upper, self._lower = np.setdiff1d(upper, corners), np.setdiff1d(lower, corners)
        self._points = {name: mesh.get_region(name) for name in _PAIRS if name != "lips"}
        skin = mesh.get_part("skin").triangles
        triangles = mesh.triangles[skin.start : skin.stop]
        middle = mesh.vertices[upper].mean(axis=0)
        centres = mesh.vertices[triangles].mean(axis=1)
        near = np.abs(centres - middle) < [42.0, 40.0, 90.0]
        self._flesh = triangles[near.all(axis=1) & (centres[:, 2] > 20.0)]
        edges = np.concatenate(
            [self._flesh[:, [0, 1]], self._flesh[:, [1, 2]], self._flesh[:, [2, 0]]]
        )
        known = {tuple(edge) for edge in edges.tolist()}
        self._border = np.array([e for e in edges.tolist() if (e[1], e[0]) not in known])
        of_upper = np.isin(self._flesh, upper).all(axis=1)
        of_lower = np.isin(self._flesh, lower).all(axis=1)
        self._lips = {"upper": self._flesh[of_upper], "lower": self._flesh[of_lower]}
        self._rest = self._measure_points(mesh.vertices)

    def measure(self, vertices: FloatArray) -> dict[str, float]:
        """Measure the largest depths.

        Parameters
        ----------
        vertices
            Vertices of the mesh, ``(vertices, 3)``, millimetres.

        Returns
        -------
        dict
            ``"part in part"`` → depth beyond that of the face at rest, millimetres; 0 where none.
        """
        return {
            pair: float(np.maximum(depths - self._rest[pair], 0.0).max(initial=0.0))
            for pair, depths in self._measure_points(vertices).items()
        }

    def _measure_points(self, vertices: FloatArray) -> dict[str, FloatArray]:
        result: dict[str, FloatArray] = {}
        for first, others in _PAIRS.items():
            for second in others:
                if second == "other_lip":
                    parts = [
                        self._measure_lip(vertices, self._upper, "lower"),
                        self._measure_lip(vertices, self._lower, "upper"),
                    ]
                    result["lip in lip"] = np.concatenate(parts)
                    continue
                both = np.concatenate([self._upper, self._lower])
                points = vertices[both if first == "lips" else self._points[first]]
                body, border = self._flesh, self._border
                if second == "lips":
                    near = np.concatenate(list(self._lips.values()))
                else:
                    part = self.mesh.get_part(second).triangles
                    near = body = self.mesh.triangles[part.start : part.stop]
                    border = _NO_BORDER
                depths = _measure(points, vertices, body, border, body, near)
                result[f"{first} in {second}"] = depths
        return result

    def _measure_lip(self, vertices: FloatArray, ids: IndexArray, other: str) -> FloatArray:
        # A lip is on its own surface: before it is where another body shows, as far off as no
        # crease of its own skin goes.
        points = vertices[ids]
        before = points + _BEFORE * self.mesh.compute_normals(vertices)[ids]
        surface = self._lips[other]
        flesh, border = self._flesh, self._border
        return _measure(points, vertices, flesh, border, surface, surface, before)


_NO_BORDER = np.zeros((0, 2), dtype=np.int64)


def _measure(
    points: FloatArray,
    vertices: FloatArray,
    body: IndexArray,
    border: IndexArray,
    surface: IndexArray,
    near: IndexArray,
    tested: FloatArray | None = None,
) -> FloatArray:
    """Return how deep each point is in a body, measured to a surface of it; 0 outside.

    And 0 far from some triangles: the skin is a body too where it is no lip. Other points may be
    tested for being inside.
    """
    tested = points if tested is None else tested
    result = np.zeros(len(points))
    tree = cKDTree(vertices[np.unique(near)])
    distance, _ = tree.query(points, distance_upper_bound=_NEAR)
    chosen = np.flatnonzero(np.isfinite(distance))
    if chosen.size:
        result[chosen] = _measure_depths(
            points[chosen], tested[chosen], vertices, body, border, surface, _APEX
        )
    return result


@_njit
def _compute_solid_angle(p, a, b, c):  # type: ignore[no-untyped-def]
    ax, ay, az = a[0] - p[0], a[1] - p[1], a[2] - p[2]
    bx, by, bz = b[0] - p[0], b[1] - p[1], b[2] - p[2]
    cx, cy, cz = c[0] - p[0], c[1] - p[1], c[2] - p[2]
    la = np.sqrt(ax * ax + ay * ay + az * az)
    lb = np.sqrt(bx * bx + by * by + bz * bz)
    lc = np.sqrt(cx * cx + cy * cy + cz * cz)
    volume = ax * (by * cz - bz * cy) + ay * (bz * cx - bx * cz) + az * (bx * cy - by * cx)
    ab, bc, ca = (
        ax * bx + ay * by + az * bz,
        bx * cx + by * cy + bz * cz,
        ax * cx + ay * cy + az * cz,
    )
    return 2.0 * np.arctan2(volume, la * lb * lc + ab * lc + bc * la + ca * lb)


@_njit
def _measure_depths(points, tested, vertices, body, border, surface, apex):  # type: ignore[no-untyped-def]
    depths = np.zeros(len(points))
    for n in range(len(points)):
        p = tested[n]
        angle = 0.0
        for t in range(len(body)):
            angle += _compute_solid_angle(
                p, vertices[body[t, 0]], vertices[body[t, 1]], vertices[body[t, 2]]
            )
        for e in range(len(border)):
            angle += _compute_solid_angle(p, vertices[border[e, 1]], vertices[border[e, 0]], apex)
        if angle < 2.0 * np.pi:
            continue
        best = np.inf
        for t in range(len(surface)):
            a, b, c = vertices[surface[t, 0]], vertices[surface[t, 1]], vertices[surface[t, 2]]
            best = min(best, _measure_distance(points[n], a, b, c))
        depths[n] = best
    return depths


@_njit
def _measure_distance(p, a, b, c):  # type: ignore[no-untyped-def]
    """Return the distance from a triangle: of its plane where the foot is within, or of an edge."""
    ab, ac, ap = b - a, c - a, p - a
    normal = np.cross(ab, ac)
    area = np.dot(normal, normal)
    if area > 0.0:
        v = np.dot(np.cross(ap, ac), normal) / area
        w = np.dot(np.cross(ab, ap), normal) / area
        if v >= 0.0 and w >= 0.0 and v + w <= 1.0:
            return abs(np.dot(ap, normal)) / np.sqrt(area)
    best = np.inf
    for start, end in ((a, b), (b, c), (c, a)):
        along = end - start
        share = np.dot(p - start, along) / max(np.dot(along, along), 1e-18)
        off = p - start - min(max(share, 0.0), 1.0) * along
        best = min(best, np.sqrt(np.dot(off, off)))
    return best
