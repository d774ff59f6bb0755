"""Meshes of one's own: read from common 3-D formats, checked, and brought to the head frame.

OBJ and PLY are read by mocap-fit itself, so that vertex numbers in a rig file are those of the mesh
file; STL, VTP and VTK through pyvista; glTF, GLB and OFF through trimesh (the extra ``mesh``).
"""

from __future__ import annotations

import contextlib
import logging
import os
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from mocap_fit.errors import (
    ConfigurationError,
    DataError,
    FileFormatError,
    MissingExtraError,
    MocapFitWarning,
)
from mocap_fit.face.mesh import IndexArray, Mesh, Part
from mocap_fit.face.obj_file import read_obj
from mocap_fit.face.ply_file import read_ply
from mocap_fit.tracks import FloatArray

OWN = (".obj", ".ply")
WITH_PYVISTA = (".stl", ".vtp", ".vtk", ".vtu", ".vtm", ".wrl")
WITH_TRIMESH = (".glb", ".gltf", ".off")
# A head, or a mask of its front, is this tall or wide (mm).
_SMALLEST, _LARGEST, _USUAL = 80.0, 600.0, 250.0
# A triangle smaller than this has no direction (mm²).
_NO_AREA = 1e-10


@dataclass(frozen=True, eq=False)
class Piece:
    """One object of a file: its vertices, its triangles on them, and named vertex sets."""

    name: str
    vertices: FloatArray
    triangles: IndexArray
    groups: dict[str, IndexArray] = field(default_factory=dict)


def read_mesh(path: str | os.PathLike[str], *, scale: float = 1.0, axes: str | None = None) -> Mesh:
    """Read a face or head from a 3-D file.

    Objects of the file become parts, its groups become regions. Polygons are cut into
    triangles; vertices are neither merged nor renumbered within an object, except in STL, which
    has no shared vertices and gets them merged. Triangles without area are dropped, and ones that
    face inwards turned round, with a warning.

    Parameters
    ----------
    path
        OBJ, PLY, STL, VTP, VTK, glTF, GLB or OFF file.
    scale
        Factor to millimetres: 1000 for a mesh in metres.
    axes
        Which axes of the file are the head's x (speaker's left), y (up) and z (forward), such as
        ``"x z -y"`` for a mesh with z up that looks along -y. None is ``"x y z"``.

    Returns
    -------
    Mesh
        In mm, in the head frame's directions; without feature points, which a rig file names.

    Raises
    ------
    FileFormatError
        If the file cannot be read as what its name says.
    DataError
        If it holds no triangles, numbers that are not finite, or something of another size than a
        head; the message suggests a `scale`.
    ConfigurationError
        If `scale` or `axes` is not possible.
    MissingExtraError
        If the format needs trimesh and it is not installed.
    """
    path = Path(path)
    matrix = _axis_matrix(axes)
    if not np.isfinite(scale) or scale <= 0:
        raise ConfigurationError(
            "the scale of a mesh must be above 0", path=path, found=scale, expected="such as 1000"
        )
    pieces = _read_pieces(path)
    pieces = [piece for piece in pieces if len(piece.triangles)]
    if not pieces:
        raise DataError(
            "the file holds no triangles or polygons",
            path=path,
            advice="Export the surface, not points, curves or an empty scene.",
        )
    _check_pieces(pieces, path)
    vertices = scale * np.concatenate([piece.vertices for piece in pieces]) @ matrix.T
    _check_size(vertices, scale, path)
    mirrored = np.linalg.det(matrix) < 0
    return _joined(pieces, vertices, mirrored=mirrored, path=path)


def _read_pieces(path: Path) -> list[Piece]:
    kind = path.suffix.lower()
    if kind not in (*OWN, *WITH_PYVISTA, *WITH_TRIMESH):
        raise FileFormatError(
            "this is not a mesh format that can be read",
            path=path,
            found=kind or "no file name ending",
            expected=", ".join((*OWN, *WITH_PYVISTA, *WITH_TRIMESH)),
        )
    if not path.is_file():
        raise FileFormatError("there is no such file", path=path)
    try:
        empty = path.stat().st_size == 0
        with path.open("rb"):
            pass
    except OSError as error:
        raise FileFormatError(
            "the file cannot be opened", path=path, found=error.strerror
        ) from None
    if empty:
        raise FileFormatError("the file is empty", path=path)
    if kind == ".obj":
        return [Piece(*parts) for parts in read_obj(path)]
    if kind == ".ply":
        return [Piece(path.stem, *read_ply(path))]
    return _with_trimesh(path) if kind in WITH_TRIMESH else _with_pyvista(path)


def _with_pyvista(path: Path) -> list[Piece]:
    import pyvista

    try:
        with _quiet_vtk():
            found = pyvista.read(path)
            blocks = _blocks(found, path.stem)
            pieces = []
            for name, block in blocks:
                surface = block if isinstance(block, pyvista.PolyData) else block.extract_surface()
                surface = surface.triangulate()
                points = np.asarray(surface.points, dtype=np.float64)
                triangles = np.asarray(surface.regular_faces if surface.n_cells else [])
                pieces.append(Piece(name, points, triangles.reshape(-1, 3).astype(np.int64)))
    except UserWarning:
        raise _unreadable(path, "VTK could not read it") from None
    except Exception as error:
        raise _unreadable(path, error) from None
    return pieces


@contextlib.contextmanager
def _quiet_vtk() -> Iterator[None]:
    """Make VTK's troubles an exception; else it writes them to the terminal and goes on."""
    import pyvista

    logged = logging.root.manager.disable
    logging.disable(logging.CRITICAL)
    try:
        with pyvista.vtk_verbosity("off"), warnings.catch_warnings():
            warnings.simplefilter("error", UserWarning)
            yield
    finally:
        logging.disable(logged)


def _blocks(found: Any, name: str) -> list[tuple[str, Any]]:
    """A data set, or the data sets of a composite one, with names."""
    import pyvista

    if not isinstance(found, pyvista.MultiBlock):
        return [(name, found)]
    blocks = []
    for i, block in enumerate(found):
        if block is not None:
            blocks += _blocks(block, found.get_block_name(i) or f"{name}_{i}")
    return blocks


def _with_trimesh(path: Path) -> list[Piece]:
    try:
        import trimesh
    except ImportError:
        raise MissingExtraError(
            f"{path.suffix} files need trimesh, which is not installed",
            path=path,
            advice="Run: pip install 'mocap-fit[mesh]'",
        ) from None
    try:
        scene = trimesh.load_scene(path, process=False)
        order = list(scene.geometry)
        placements = [(node, *scene.graph[node]) for node in scene.graph.nodes_geometry]
        pieces = []
        for node, placed, name in sorted(placements, key=lambda item: order.index(item[2])):
            geometry = scene.geometry[name]
            if not hasattr(geometry, "faces"):
                continue
            points = np.asarray(geometry.vertices, dtype=np.float64)
            points = points @ placed[:3, :3].T + placed[:3, 3]
            label = path.stem if node == path.name else str(node)
            pieces.append(Piece(label, points, np.asarray(geometry.faces, dtype=np.int64)))
    except Exception as error:
        raise _unreadable(path, error) from None
    return pieces


def _unreadable(path: Path, error: Exception | str) -> FileFormatError:
    return FileFormatError(
        f"the file cannot be read as {path.suffix.lower().lstrip('.').upper()}",
        path=path,
        found=error if isinstance(error, str) else f"{type(error).__name__}: {error}",
        advice="Open it in a 3-D program and export it again.",
    )


def _check_pieces(pieces: Sequence[Piece], path: Path) -> None:
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


def _check_size(vertices: FloatArray, scale: float, path: Path) -> None:
    extent = float(np.ptp(vertices, axis=0).max())
    if _SMALLEST <= extent <= _LARGEST:
        return
    if extent == 0:
        raise DataError("all vertices of the mesh are at one place", path=path)
    power = 10.0 ** np.round(np.log10(_USUAL / extent))
    raise DataError(
        "the mesh does not have the size of a head",
        path=path,
        found=f"{extent:.4g} mm across",
        expected=f"{_SMALLEST:.0f} to {_LARGEST:.0f} mm",
        advice=f"Give the factor that brings it to millimetres, such as scale={scale * power:g}.",
    )


def _axis_matrix(axes: str | None) -> FloatArray:
    """Rows that pick the head's x, y and z from a file's axes."""
    words = (axes or "x y z").lower().replace(",", " ").split()
    names = [word.lstrip("+-") for word in words]
    if sorted(names) != ["x", "y", "z"] or any(len(word) > 2 for word in words):
        raise ConfigurationError(
            "the axes of a mesh must name x, y and z once each, with a sign where they are turned",
            found=axes,
            expected='such as "x z -y"',
        )
    matrix = np.zeros((3, 3))
    for row, (word, name) in enumerate(zip(words, names, strict=True)):
        matrix[row, "xyz".index(name)] = -1.0 if word.startswith("-") else 1.0
    return matrix


def _joined(pieces: Sequence[Piece], vertices: FloatArray, *, mirrored: bool, path: Path) -> Mesh:
    """One mesh of all pieces, cleaned, with warnings of what was done."""
    kept, parts, regions = [], [], {}
    vertex = triangle = dropped = inwards = 0
    names = _unique_names([piece.name for piece in pieces])
    for piece, name in zip(pieces, names, strict=True):
        own = vertices[vertex : vertex + len(piece.vertices)]
        triangles = piece.triangles[:, ::-1] if mirrored else piece.triangles
        good = _areas(own, triangles) > _NO_AREA
        dropped += int((~good).sum())
        triangles = triangles[good]
        if len(triangles) and _volume(own, triangles) < 0:
            inwards += 1
            triangles = triangles[:, ::-1]
        kept.append(triangles + vertex)
        for group, members in piece.groups.items():
            regions[group] = members + vertex
        parts.append(
            Part(
                name,
                range(vertex, vertex + len(own)),
                range(triangle, triangle + len(triangles)),
            )
        )
        vertex += len(own)
        triangle += len(triangles)
    if triangle == 0:
        raise DataError(
            "no triangle of the mesh has an area",
            path=path,
            found=f"{dropped} without",
            advice="Repair the mesh in a 3-D program.",
        )
    if dropped:
        _warn(path, f"{dropped} triangles without area were left out")
    if inwards:
        _warn(path, f"triangles of {inwards} objects faced inwards and were turned round")
    triangles = np.concatenate(kept)
    crowded = _crowded_edges(triangles)
    if crowded:
        _warn(
            path,
            f"{crowded} edges belong to more than two triangles; the surface is not clean there",
        )
    return Mesh(vertices, triangles, tuple(parts), regions)


def _warn(path: Path, what: str) -> None:
    warnings.warn(f"{path}: {what}", MocapFitWarning, stacklevel=4)


def _unique_names(names: Sequence[str]) -> list[str]:
    unique: list[str] = []
    for name in names:
        candidate, number = name, 2
        while candidate in unique:
            candidate, number = f"{name}_{number}", number + 1
        unique.append(candidate)
    return unique


def _areas(vertices: FloatArray, triangles: IndexArray) -> FloatArray:
    corners = vertices[triangles]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return np.asarray(0.5 * np.linalg.norm(across, axis=1))


def _volume(vertices: FloatArray, triangles: IndexArray) -> float:
    """Volume between a surface and its middle; negative where it is seen from inside."""
    corners = vertices[triangles] - vertices[np.unique(triangles)].mean(axis=0)
    return float(np.einsum("ij,ij->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6)


def _crowded_edges(triangles: IndexArray) -> int:
    edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    _, uses = np.unique(np.sort(edges, axis=1), axis=0, return_counts=True)
    return int((uses > 2).sum())
