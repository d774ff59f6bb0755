"""Wavefront OBJ: vertices, polygons, objects and groups, without renumbering.

Read here and not by trimesh (5.2), which takes vertex 0 for the first one, leaves out polygons of
two corners, counts relative indices (-1) from the end of the file, and splits or renumbers
vertices at texture seams: damage would go unseen, and a rig file counts on the file's order.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from mocap_fit.errors import FileFormatError
from mocap_fit.face.mesh import IndexArray
from mocap_fit.face.mesh_pieces import Piece


def read_obj(path: Path) -> list[Piece]:
    """Read an OBJ file.

    Parameters
    ----------
    path
        The file.

    Returns
    -------
    list of Piece
        One for each object, with its groups; objects that share vertices are one piece. Vertices
        are in the file's order, polygons are cut into triangles round their first corner.

    Raises
    ------
    FileFormatError
        If a line is not what OBJ asks for; the message says which.
    """
    vertices, triangles, labels, names = _parse_lines(path)
    if not triangles:
        return []
    points, faces = np.array(vertices, dtype=np.float64), np.array(triangles, dtype=np.int64)
    clusters = _join_by_shared_vertices(faces, labels, len(names), len(points))
    faces_by_name = _group_equal(np.array(labels))
    pieces = []
    for group in _group_equal(clusters):
        chosen = faces[np.sort(np.concatenate([faces_by_name[i] for i in group]))]
        # With one object, even vertices that nothing uses keep their numbers.
        used = np.unique(chosen) if clusters.any() else np.arange(len(points))
        groups = {
            names[i]: np.searchsorted(used, np.unique(faces[faces_by_name[i]]))
            for i in group
            if names[i]
        }
        name = names[group[0]] or path.stem
        pieces.append(Piece(name, points[used], np.searchsorted(used, chosen), groups))
    return pieces


def _group_equal(values: IndexArray) -> list[IndexArray]:
    """Return the positions of each value, for values 0, 1, ... that all occur."""
    order = np.argsort(values, kind="stable")
    return np.split(order, np.searchsorted(values[order], np.arange(1, values.max() + 1)))


def _parse_lines(path: Path) -> tuple[list[list[float]], list[list[int]], list[int], list[str]]:
    """Vertices, triangles, and for each triangle the position of its name among the names."""
    vertices: list[list[float]] = []
    triangles: list[list[int]] = []
    labels: list[int] = []
    names: dict[str, int] = {}
    current = ""
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except UnicodeDecodeError:
        lines = path.read_text(encoding="latin-1").splitlines()
    for number, line in enumerate(lines, start=1):
        word, _, rest = line.strip().partition(" ")
        try:
            if word == "v":
                vertices.append(_parse_coordinates(rest))
            elif word == "f":
                fan = _parse_polygon(rest, len(vertices))
                triangles += fan
                labels += [names.setdefault(current, len(names))] * len(fan)
            elif word in ("o", "g"):
                current = rest.strip()
        except ValueError as error:
            raise FileFormatError(
                "this line is not OBJ",
                path=path,
                line=number,
                found=f"{line.strip()[:60]!r}: {error}",
                expected="'v x y z' or 'f 1 2 3'",
                advice="Export the mesh again.",
            ) from None
    return vertices, triangles, labels, list(names)


def _parse_coordinates(text: str) -> list[float]:
    values = [float(value) for value in text.split()[:3]]
    if len(values) != 3:
        raise ValueError("fewer than three coordinates")
    return values


def _parse_polygon(text: str, vertex_count: int) -> list[list[int]]:
    """Cut a polygon into triangles round its first corner."""
    corners = [_parse_corner(corner, vertex_count) for corner in text.split()]
    if len(corners) < 3:
        raise ValueError("a polygon of fewer than three corners")
    return [[corners[0], *corners[i : i + 2]] for i in range(1, len(corners) - 1)]


def _parse_corner(corner: str, vertex_count: int) -> int:
    """Return a corner such as ``7``, ``7/2/3`` or ``-1`` as an index from 0."""
    number = int(corner.split("/")[0])
    index = number - 1 if number > 0 else vertex_count + number
    if number == 0 or not 0 <= index < vertex_count:
        raise ValueError(f"there is no vertex {number} before this line")
    return index


def _join_by_shared_vertices(
    faces: IndexArray, labels: list[int], name_count: int, vertex_count: int
) -> IndexArray:
    """Return the cluster of each name; names whose triangles share a vertex are in one."""
    size = name_count + vertex_count
    uses = (np.repeat(labels, 3), name_count + faces.ravel())
    graph = sparse.csr_matrix((np.ones(faces.size), uses), shape=(size, size))
    # Names come first, and every one has triangles: their clusters have the first numbers.
    return np.asarray(connected_components(graph, directed=False)[1][:name_count], dtype=np.int64)
