"""The skin between the rings: well-shaped triangles of graded size over the unrolled half head.

The half head is unrolled into a plane (azimuth × girth, level). Points spread there like nodes
of a truss whose bars want the local edge length (Persson and Strang, "A simple mesh generator in
MATLAB", SIAM Review 46, 2004), between the fixed points of the midlines and rings.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from scipy.spatial import Delaunay, cKDTree

from mocap_fit.face.builtin.surfaces import Mask
from mocap_fit.face.mesh import IndexArray, list_edges
from mocap_fit.tracks import FloatArray

Spacing = Callable[[FloatArray], FloatArray]
_ROUNDS = 36
_ROUNDS_A_TRIANGULATION = 6


def fill(
    outline: FloatArray, holes: Sequence[FloatArray], spacing: Spacing
) -> tuple[FloatArray, IndexArray]:
    """Fill a region of the plane with triangles.

    Parameters
    ----------
    outline
        A closed ring, ``(points, 2)``, millimetres. All its points, and those of the holes, become
        vertices.
    holes
        Closed rings inside it, ``(points, 2)`` each, millimetres.
    spacing
        Desired edge length, millimetres, at points ``(points, 2)`` of the plane.

    Returns
    -------
    vertices
        ``(vertices, 2)``: the outline's, the holes' in order, the free ones.
    triangles
        Vertex indices, ``(triangles, 3)``, counter-clockwise.
    """
    rings = [outline, *holes]
    fixed = np.concatenate(rings)
    free = _spread_points(rings, fixed, spacing)
    for _ in range(_ROUNDS // _ROUNDS_A_TRIANGULATION):
        points = np.concatenate([fixed, free])
        edges = list_edges(_triangulate(points, rings))
        for _ in range(_ROUNDS_A_TRIANGULATION):
            points[len(fixed) :] += 0.2 * _compute_forces(points, edges, spacing)[len(fixed) :]
        free = _filter_points(points[len(fixed) :], rings, fixed, spacing, 0.55)
    points = np.concatenate([fixed, free])
    return points, _triangulate(points, rings)


def _is_inside(ring: FloatArray, points: FloatArray) -> Mask:
    """Return which points lie inside a closed ring, by counting crossings of a ray to the right."""
    start, end = ring, np.roll(ring, -1, axis=0)
    x, y = points[:, :1], points[:, 1:]
    crosses = (start[:, 1] > y) != (end[:, 1] > y)
    rise = end[:, 1] - start[:, 1]
    rise = np.where(rise == 0, 1.0, rise)
    right = x < start[:, 0] + (y - start[:, 1]) * (end[:, 0] - start[:, 0]) / rise
    return np.asarray((crosses & right).sum(axis=1) % 2 == 1)


def _is_in_region(rings: Sequence[FloatArray], points: FloatArray) -> Mask:
    keep = _is_inside(rings[0], points)
    for hole in rings[1:]:
        box = (points >= hole.min(axis=0)).all(axis=1) & (points <= hole.max(axis=0)).all(axis=1)
        keep[box] &= ~_is_inside(hole, points[box])
    return keep


def _spread_points(rings: Sequence[FloatArray], fixed: FloatArray, spacing: Spacing) -> FloatArray:
    """Return hexagonal lattices, each used where the desired edge length is near its spacing."""
    low, high = fixed.min(axis=0), fixed.max(axis=0)
    lengths = np.exp2(np.arange(0.0, 3.6, 0.25))
    points = []
    for length, upper in zip(lengths, [*lengths[1:], np.inf], strict=True):
        x = np.arange(low[0], high[0], length)
        y = np.arange(low[1], high[1], length * np.sqrt(0.75))
        lattice = np.stack(np.meshgrid(x, y), axis=2)
        lattice[1::2, :, 0] += length / 2
        lattice = lattice.reshape(-1, 2)
        wanted = spacing(lattice)
        chosen = (wanted < upper) & (wanted >= (length if length > lengths[0] else 0))
        points.append(lattice[chosen])
    lattice = _filter_points(np.concatenate(points), rings, fixed, spacing, 0.7)
    # Where two lattices meet, points can be too close: keep the first of each pair.
    pairs = cKDTree(lattice).query_pairs(lengths[-1], output_type="ndarray")
    near = np.linalg.norm(lattice[pairs[:, 0]] - lattice[pairs[:, 1]], axis=1)
    close = near < 0.6 * spacing(lattice[pairs[:, 0]])
    return np.asarray(np.delete(lattice, np.unique(pairs[close].max(axis=1)), axis=0))


def _filter_points(
    points: FloatArray,
    rings: Sequence[FloatArray],
    fixed: FloatArray,
    spacing: Spacing,
    distance: float,
) -> FloatArray:
    """Return the points inside the region that are not too close to its border.

    A point in the circle over an edge of the border would take that edge out of the triangulation.
    """
    near = cKDTree(fixed).query(points)[0]
    points = points[near > distance * spacing(points)]
    start, end = fixed, np.concatenate([np.roll(ring, -1, axis=0) for ring in rings])
    radius = 0.5 * np.linalg.norm(end - start, axis=1)
    centres = cKDTree(0.5 * (start + end))
    away, which = centres.query(points, k=4)
    points = points[(away > 1.02 * radius[which]).all(axis=1)]
    return points[_is_in_region(rings, points)]


def _compute_forces(points: FloatArray, edges: IndexArray, spacing: Spacing) -> FloatArray:
    """Return the push of the bars that are shorter than desired."""
    bars = points[edges[:, 0]] - points[edges[:, 1]]
    length = np.linalg.norm(bars, axis=1)
    wanted = spacing(0.5 * (points[edges[:, 0]] + points[edges[:, 1]]))
    wanted *= 1.2 * np.sqrt((length**2).sum() / (wanted**2).sum())
    push = (np.maximum(wanted - length, 0) / length)[:, None] * bars
    total = np.empty_like(points)
    for axis in range(2):
        total[:, axis] = np.bincount(edges[:, 0], push[:, axis], len(points))
        total[:, axis] -= np.bincount(edges[:, 1], push[:, axis], len(points))
    return total


def _triangulate(points: FloatArray, rings: Sequence[FloatArray]) -> IndexArray:
    triangles = Delaunay(points).simplices.astype(np.int64)
    corners = points[triangles]
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    area = first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]
    triangles = np.where((area > 0)[:, None], triangles, triangles[:, ::-1])
    triangles = triangles[np.abs(area) > 1e-3]
    return np.asarray(triangles[_is_in_region(rings, points[triangles].mean(axis=1))])


def flip_edges(vertices: FloatArray, triangles: IndexArray, rounds: int = 8) -> IndexArray:
    """Flip the edges whose opposite angles sum to more than π in space.

    A triangulation that is good in the plane is not on a steep surface such as the nose.

    Parameters
    ----------
    vertices
        Positions, ``(vertices, 3)``, millimetres.
    triangles
        Vertex indices, ``(triangles, 3)``.
    rounds
        Most rounds of flips.

    Returns
    -------
    ndarray
        Triangles on the same vertices, ``(triangles, 3)``.
    """
    triangles = triangles.copy()
    for _ in range(rounds):
        if not _flip_round(vertices, triangles):
            break
    return triangles


def _flip_round(vertices: FloatArray, triangles: IndexArray) -> bool:
    """Flip, in place, edges that have no triangle in common; return whether there were any."""
    count = len(triangles)
    edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    apex = np.concatenate([triangles[:, 2], triangles[:, 0], triangles[:, 1]])
    owner = np.tile(np.arange(count), 3)
    key = edges.min(axis=1) * len(vertices) + edges.max(axis=1)
    order = np.argsort(key, kind="stable")
    known = key[order]
    pair = np.flatnonzero(known[:-1] == known[1:])
    first, second = order[pair], order[pair + 1]
    start, end = edges[first].T
    above, below = apex[first], apex[second]
    badness = (
        _measure_angle(vertices, above, start, end)
        + _measure_angle(vertices, below, start, end)
        - np.pi
    )
    new_key = np.minimum(above, below) * len(vertices) + np.maximum(above, below)
    wanted = np.flatnonzero((badness > 0.02) & (above != below) & ~np.isin(new_key, known))
    wanted = wanted[np.argsort(-badness[wanted], kind="stable")]
    used: set[int] = set()
    new_edges: set[int] = set()
    for i in wanted:
        one, other = int(owner[first[i]]), int(owner[second[i]])
        if one in used or other in used or int(new_key[i]) in new_edges:
            continue
        used |= {one, other}
        new_edges.add(int(new_key[i]))
        triangles[one] = start[i], below[i], above[i]
        triangles[other] = below[i], end[i], above[i]
    return bool(used)


def _measure_angle(
    vertices: FloatArray, at: IndexArray, one: IndexArray, other: IndexArray
) -> FloatArray:
    first, second = vertices[one] - vertices[at], vertices[other] - vertices[at]
    lengths = np.linalg.norm(first, axis=1) * np.linalg.norm(second, axis=1)
    return np.asarray(np.arccos(np.clip((first * second).sum(axis=1) / (lengths + 1e-12), -1, 1)))
