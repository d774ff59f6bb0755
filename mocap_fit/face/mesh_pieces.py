"""The objects of a mesh file, checked, cleaned, and joined into one face."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from mocap_fit.errors import DataError, MocapFitWarning
from mocap_fit.face.mesh import IndexArray, Mesh, Part
from mocap_fit.tracks import FloatArray

# Rounding alone gives three collinear vertices of a head, 200 mm apart, an area of about
# 200² × 2⁻⁵² = 1e-11 mm²: a triangle that is not larger than this has no direction.
_NO_AREA = 1e-10


@dataclass(frozen=True, eq=False)
class Piece:
    """One object of a mesh file.

    Parameters
    ----------
    name
        Its name in the file.
    vertices
        Positions, ``(vertices, 3)``, in the file's unit and axes.
    triangles
        Vertex indices, ``(triangles, 3)``.
    groups
        Named sets of vertex indices, ``(members,)`` each.
    """

    name: str
    vertices: FloatArray
    triangles: IndexArray
    groups: dict[str, IndexArray] = field(default_factory=dict)


def check_pieces(pieces: Sequence[Piece], path: Path) -> None:
    """Refuse pieces with vertices that are not finite or triangles that name no vertex.

    Parameters
    ----------
    pieces
        The objects of the file, each with triangles.
    path
        The file that they come from.

    Raises
    ------
    DataError
        With the object and the first vertex that is wrong.
    """
    for piece in pieces:
        bad = ~np.isfinite(piece.vertices).all(axis=1)
        if bad.any():
            raise DataError(
                f"{int(bad.sum())} vertices of the object '{piece.name}' are not finite numbers",
                path=path,
                found=f"vertex {int(bad.argmax())}: {piece.vertices[bad.argmax()].tolist()}",
                advice="Repair the mesh in a 3-D program.",
            )
        low, high = int(piece.triangles.min()), int(piece.triangles.max())
        if low < 0 or high >= len(piece.vertices):
            raise DataError(
                f"a triangle of the object '{piece.name}' names a vertex that is not there",
                path=path,
                found=high if high >= len(piece.vertices) else low,
                expected=f"0 to {len(piece.vertices) - 1}",
            )


def join_pieces(
    pieces: Sequence[Piece], vertices: FloatArray, *, mirrored: bool, path: Path
) -> Mesh:
    """Join the pieces of a file into one mesh, cleaned, with warnings of what was changed.

    Parameters
    ----------
    pieces
        The objects of the file.
    vertices
        The vertices of all of them, ``(vertices, 3)``, millimetres in the head frame.
    mirrored
        Whether the way from the file's axes to the head frame's turns triangles inside out.
    path
        The file that they come from.

    Returns
    -------
    Mesh
        A part for each piece and a region for each group.

    Raises
    ------
    DataError
        If no triangle has an area.
    """
    all_triangles, parts, regions = [], [], {}
    vertex = triangle = dropped = inwards = 0
    names = _make_unique([piece.name for piece in pieces])
    for piece, name in zip(pieces, names, strict=True):
        points = vertices[vertex : vertex + len(piece.vertices)]
        triangles = piece.triangles[:, ::-1] if mirrored else piece.triangles
        good = _compute_areas(points, triangles) > _NO_AREA
        dropped += int((~good).sum())
        triangles = triangles[good]
        if len(triangles) and _is_inside_out(points, triangles):
            inwards += 1
            triangles = triangles[:, ::-1]
        all_triangles.append(triangles + vertex)
        for group, members in piece.groups.items():
            regions[group] = members + vertex
        next_vertex, next_triangle = vertex + len(points), triangle + len(triangles)
        parts.append(Part(name, range(vertex, next_vertex), range(triangle, next_triangle)))
        vertex, triangle = next_vertex, next_triangle
    if triangle == 0:
        raise DataError(
            "no triangle of the mesh has an area",
            path=path,
            found=f"{dropped} without",
            advice="Repair the mesh in a 3-D program.",
        )
    triangles = np.concatenate(all_triangles)
    crowded = _count_crowded_edges(triangles)
    for count, problem in (
        (dropped, f"{dropped} triangles without area were left out"),
        (inwards, f"triangles of {inwards} objects faced inwards and were turned round"),
        (
            crowded,
            f"{crowded} edges belong to more than two triangles; the surface is not clean there",
        ),
    ):
        if count:
            warnings.warn(f"{path}: {problem}", MocapFitWarning, stacklevel=3)
    return Mesh(vertices, triangles, tuple(parts), regions)


def _make_unique(names: Sequence[str]) -> list[str]:
    """Add a number to names that came before."""
    unique: dict[str, None] = {}
    numbers: dict[str, int] = {}
    for name in names:
        candidate = name
        while candidate in unique:
            numbers[name] = numbers.get(name, 1) + 1
            candidate = f"{name}_{numbers[name]}"
        unique[candidate] = None
    return list(unique)


def _compute_areas(vertices: FloatArray, triangles: IndexArray) -> FloatArray:
    corners = vertices[triangles]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return np.asarray(0.5 * np.linalg.norm(across, axis=1))


def _is_inside_out(vertices: FloatArray, triangles: IndexArray) -> bool:
    """Return whether the volume between a surface and its middle is negative."""
    corners = vertices[triangles] - vertices[np.unique(triangles)].mean(axis=0)
    sixfold = np.einsum("ij,ij->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2]))
    return bool(sixfold < 0)


def _count_crowded_edges(triangles: IndexArray) -> int:
    """Count the edges that more than two triangles share."""
    edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    low, high = np.sort(edges, axis=1).T
    _, uses = np.unique(low * (triangles.max() + 1) + high, return_counts=True)
    return int((uses > 2).sum())
