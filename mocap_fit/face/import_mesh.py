"""Meshes of other programs: read from common 3-D formats, checked, and brought to the head frame.

OBJ and PLY are read by mocap-fit itself, so that vertex numbers in a rig file are those of the mesh
file and damage is seen; STL, VTP and VTK through pyvista; glTF, GLB and OFF through trimesh.
"""

from __future__ import annotations

import contextlib
import logging
import os
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from mocap_fit.errors import ConfigurationError, DataError, FileFormatError, MissingFileError
from mocap_fit.face.mesh import Mesh
from mocap_fit.face.mesh_pieces import Piece, check_pieces, join_pieces
from mocap_fit.face.obj_file import read_obj
from mocap_fit.face.ply_file import read_ply
from mocap_fit.tracks import FloatArray

_WITH_PYVISTA = (".stl", ".vtp", ".vtk", ".vtu", ".vtm", ".wrl")
_WITH_TRIMESH = (".glb", ".gltf", ".off")
MESH_FORMATS = (".obj", ".ply", *_WITH_PYVISTA, *_WITH_TRIMESH)
# A head, or a mask of its front, is this tall or wide (mm).
_SMALLEST, _LARGEST, _USUAL = 80.0, 600.0, 250.0


def read_mesh(path: str | os.PathLike[str], *, scale: float = 1.0, axes: str | None = None) -> Mesh:
    """Read a face or head from a 3-D file.

    Objects of the file become parts, its groups become regions. Polygons are cut into
    triangles; vertices are neither merged nor renumbered within an object, except in STL, which
    has no shared vertices and gets them merged. Triangles of no more than 1e-10 mm² are dropped,
    and ones that face inwards turned round, with a warning.

    Parameters
    ----------
    path
        OBJ, PLY, STL, VTP, VTK, glTF, GLB or OFF file.
    scale
        Factor to millimetres, above 0: 1000 for a mesh in metres.
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
        If `scale` or `axes` is out of range.
    """
    path = Path(path)
    matrix = _parse_axes(axes)
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
    check_pieces(pieces, path)
    vertices = scale * np.concatenate([piece.vertices for piece in pieces]) @ matrix.T
    _check_size(vertices, scale, path)
    mirrored = np.linalg.det(matrix) < 0
    return join_pieces(pieces, vertices, mirrored=mirrored, path=path)


def _read_pieces(path: Path) -> list[Piece]:
    kind = path.suffix.lower()
    if kind not in MESH_FORMATS:
        raise FileFormatError(
            "this is not a mesh format that can be read",
            path=path,
            found=kind or "no file name ending",
            expected=", ".join(MESH_FORMATS),
        )
    if not path.is_file():
        raise MissingFileError(path=path)
    try:
        with path.open("rb") as file:
            empty = not file.read(1)
    except OSError as error:
        raise FileFormatError(
            "the file cannot be opened", path=path, found=error.strerror
        ) from None
    if empty:
        raise FileFormatError("the file is empty", path=path)
    if kind == ".obj":
        return read_obj(path)
    if kind == ".ply":
        return [read_ply(path)]
    return _read_with_trimesh(path) if kind in _WITH_TRIMESH else _read_with_pyvista(path)


def _read_with_pyvista(path: Path) -> list[Piece]:
    import pyvista

    try:
        with _catch_vtk_warnings():
            pieces = []
            for name, block in _list_blocks(pyvista.read(path), path.stem):
                surface = block if isinstance(block, pyvista.PolyData) else block.extract_surface()
                surface = surface.triangulate()
                points = np.asarray(surface.points, dtype=np.float64)
                triangles = np.asarray(surface.regular_faces if surface.n_cells else [])
                pieces.append(Piece(name, points, triangles.reshape(-1, 3).astype(np.int64)))
    except UserWarning:
        raise _make_error(path, "VTK could not read it") from None
    except Exception as error:
        raise _make_error(path, error) from None
    return pieces


@contextlib.contextmanager
def _catch_vtk_warnings() -> Iterator[None]:
    """Turn VTK's warnings into exceptions; else it writes them to the terminal and goes on."""
    import pyvista

    logged = logging.root.manager.disable
    logging.disable(logging.CRITICAL)
    try:
        with pyvista.vtk_verbosity("off"), warnings.catch_warnings():
            warnings.simplefilter("error", UserWarning)
            yield
    finally:
        logging.disable(logged)


def _list_blocks(data: Any, name: str) -> list[tuple[str, Any]]:
    """List a data set, or the data sets of a composite one, with names."""
    import pyvista

    if not isinstance(data, pyvista.MultiBlock):
        return [(name, data)]
    blocks = []
    for i, block in enumerate(data):
        if block is not None:
            blocks += _list_blocks(block, data.get_block_name(i) or f"{name}_{i}")
    return blocks


def _read_with_trimesh(path: Path) -> list[Piece]:
    import trimesh

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
        raise _make_error(path, error) from None
    return pieces


def _make_error(path: Path, error: Exception | str) -> FileFormatError:
    return FileFormatError(
        f"the file cannot be read as {path.suffix.lower().lstrip('.').upper()}",
        path=path,
        found=error if isinstance(error, str) else f"{type(error).__name__}: {error}",
        advice="Open it in a 3-D program and export it again.",
    )


def _check_size(vertices: FloatArray, scale: float, path: Path) -> None:
    extent = float(np.ptp(vertices, axis=0).max())
    if _SMALLEST <= extent <= _LARGEST:
        return
    if extent == 0:
        raise DataError("all vertices of the mesh have one position", path=path)
    power = 10.0 ** np.round(np.log10(_USUAL / extent))
    raise DataError(
        "the mesh does not have the size of a head",
        path=path,
        found=f"{extent:.4g} mm across",
        expected=f"{_SMALLEST:.0f} to {_LARGEST:.0f} mm",
        advice=f"Give the factor that brings it to millimetres, such as scale={scale * power:g}.",
    )


def _parse_axes(axes: str | None) -> FloatArray:
    """Return the rows that pick the head's x, y and z from a file's axes."""
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
