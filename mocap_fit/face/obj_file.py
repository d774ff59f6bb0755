"""Wavefront OBJ: vertices, polygons, objects and groups, without renumbering.

Other readers merge or split vertices at texture seams; a rig file counts on the file's order.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from mocap_fit.errors import FileFormatError
from mocap_fit.face.mesh import IndexArray
from mocap_fit.tracks import FloatArray

ObjPiece = tuple[str, FloatArray, IndexArray, dict[str, IndexArray]]


def read_obj(path: Path) -> list[ObjPiece]:
    """Read an OBJ file.

    Returns
    -------
    list
        For each object: its name, `(vertices, 3)` in the file's order, `(triangles, 3)` on
        them, and the vertices of each group. Objects that share vertices are one object.

    Raises
    ------
    FileFormatError
        If a line is not what OBJ asks for; the message says which.
    """
    vertices, triangles, labels, names = _parse(path)
    if not triangles:
        return []
    points = np.array(vertices, dtype=np.float64)
    faces = np.array(triangles, dtype=np.int64)
    members = [np.unique(faces[np.array(labels) == i]) for i in range(len(names))]
    clusters = _sharing(members)
    pieces = []
    for group in clusters:
        chosen = np.isin(labels, group)
        # With one object, even vertices that nothing uses keep their numbers.
        used = np.arange(len(points)) if len(clusters) == 1 else np.unique(faces[chosen])
        number = np.full(len(points), -1)
        number[used] = np.arange(len(used))
        groups = {names[i]: number[members[i]] for i in group if names[i]}
        pieces.append((names[group[0]] or path.stem, points[used], number[faces[chosen]], groups))
    return pieces


def _parse(
    path: Path,
) -> tuple[list[list[float]], list[list[int]], list[int], list[str]]:
    """Vertices, triangles, and for each triangle the position of its name among the names."""
    vertices: list[list[float]] = []
    triangles: list[list[int]] = []
    labels: list[int] = []
    names: list[str] = []
    current = ""
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except UnicodeDecodeError:
        lines = path.read_text(encoding="latin-1").splitlines()
    for number, line in enumerate(lines, start=1):
        word, _, rest = line.strip().partition(" ")
        try:
            if word == "v":
                vertices.append(_coordinates(rest))
            elif word == "f":
                if current not in names:
                    names.append(current)
                fan = _fan(rest, len(vertices))
                triangles += fan
                labels += [names.index(current)] * len(fan)
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
    return vertices, triangles, labels, names


def _coordinates(text: str) -> list[float]:
    values = [float(value) for value in text.split()[:3]]
    if len(values) != 3:
        raise ValueError("fewer than three coordinates")
    return values


def _fan(text: str, count: int) -> list[list[int]]:
    """A polygon as triangles round its first corner."""
    corners = [_vertex(corner, count) for corner in text.split()]
    if len(corners) < 3:
        raise ValueError("a polygon of fewer than three corners")
    return [[corners[0], *corners[i : i + 2]] for i in range(1, len(corners) - 1)]


def _vertex(corner: str, count: int) -> int:
    """A corner such as ``7``, ``7/2/3`` or ``-1`` as an index from 0."""
    number = int(corner.split("/")[0])
    index = number - 1 if number > 0 else count + number
    if number == 0 or not 0 <= index < count:
        raise ValueError(f"there is no vertex {number} before this line")
    return index


def _sharing(members: list[IndexArray]) -> list[list[int]]:
    """Positions of vertex sets, those that share vertices together."""
    clusters: list[tuple[list[int], IndexArray]] = []
    for i, own in enumerate(members):
        apart, together, union = [], [i], own
        for group, vertices in clusters:
            if np.isin(vertices, own).any():
                together, union = group + together, np.union1d(vertices, union)
            else:
                apart.append((group, vertices))
        clusters = [*apart, (sorted(together), union)]
    return sorted(group for group, _ in clusters)
