"""Meshes of other programs: read from common 3-D formats, checked, and brought to the head frame.

OBJ and PLY are read by mocap-fit itself, so that vertex numbers in a rig file are those of the mesh
file and damage is seen, and so is OFF; STL, glTF and GLB through trimesh. The formats of VTK are
not read: its readers end the process where a count in the file is wrong.
"""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from mocap_fit.errors import (
    ConfigurationError,
    DataError,
    FileFormatError,
    MocapFitError,
)
from mocap_fit.face.mesh import IndexArray, Mesh
from mocap_fit.face.mesh_claims import check_gltf, check_stl
from mocap_fit.face.mesh_pieces import Piece, check_pieces, join_pieces
from mocap_fit.face.obj_file import read_obj
from mocap_fit.face.off_file import read_off
from mocap_fit.face.ply_file import read_ply
from mocap_fit.io.text import check_file
from mocap_fit.size_limit import check_size
from mocap_fit.tracks import FloatArray

MESH_FORMATS = (".obj", ".ply", ".off", ".stl", ".glb", ".gltf")
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
        OBJ, PLY, STL, OFF, glTF or GLB file.
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
    # A number that is too large is infinite, and refused as a size.
    with np.errstate(over="ignore", invalid="ignore"):
        vertices = scale * (np.concatenate([piece.vertices for piece in pieces]) @ matrix.T)
        _check_extent(vertices, scale, path)
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
            advice="Save it in one of these from the program that made it.",
        )
    check_file(path)
    if kind == ".obj":
        return read_obj(path)
    if kind in (".ply", ".off"):
        return [(read_ply if kind == ".ply" else read_off)(path)]
    return _read_with_trimesh(path)


def _read_with_trimesh(path: Path) -> list[Piece]:
    import trimesh

    try:
        is_stl = path.suffix.lower() == ".stl"
        (check_stl if is_stl else check_gltf)(path)
        scene = trimesh.load_scene(path, process=False)
        order = {name: i for i, name in enumerate(scene.geometry)}
        placements = [(node, *scene.graph[node]) for node in scene.graph.nodes_geometry]
        # A file may use one mesh any number of times.
        copies = [scene.geometry[name] for _, _, name in placements]
        size = sum(getattr(each, "faces", np.zeros(0)).nbytes for each in copies)
        check_size(size, path=path, noun="scene")
        pieces = []
        for node, placed, name in sorted(placements, key=lambda item: order[item[2]]):
            geometry = scene.geometry[name]
            if not hasattr(geometry, "faces"):
                continue
            points = np.asarray(geometry.vertices, dtype=np.float64)
            # What is too large becomes infinite, and is refused later.
            with np.errstate(over="ignore", invalid="ignore"):
                points = points @ placed[:3, :3].T + placed[:3, 3]
            triangles = np.asarray(geometry.faces, dtype=np.int64)
            if is_stl:
                points, triangles = _merge_equal(points, triangles)
            label = path.stem if node == path.name else str(node)
            pieces.append(Piece(label, points, triangles))
    except MocapFitError:
        raise
    # Whatever a damaged file makes trimesh raise.
    except Exception as error:
        raise _make_error(path, error) from None
    return pieces


def _merge_equal(points: FloatArray, triangles: IndexArray) -> tuple[FloatArray, IndexArray]:
    """Return points without their repetitions, in the order of the file, and their triangles."""
    _, first, group = np.unique(points, axis=0, return_index=True, return_inverse=True)
    order = np.argsort(first)
    number = np.empty_like(order)
    number[order] = np.arange(len(order))
    return points[first[order]], number[group.reshape(-1)][triangles]


def _make_error(path: Path, error: Exception | str) -> FileFormatError:
    return FileFormatError(
        f"the file cannot be read as {path.suffix.lower().lstrip('.').upper()}",
        path=path,
        found=error if isinstance(error, str) else f"{type(error).__name__}: {error}",
        advice="Open it in a 3-D program and export it again.",
    )


def _check_extent(vertices: FloatArray, scale: float, path: Path) -> None:
    extent = float(np.ptp(vertices, axis=0).max())
    if _SMALLEST <= extent <= _LARGEST:
        return
    if extent == 0:
        raise DataError("all vertices of the mesh have one position", path=path)
    advice = "Open it in a 3-D program and look at its vertices."
    if 1e-9 < extent < 1e9:
        factor = scale * 10.0 ** np.round(np.log10(_USUAL / extent))
        advice = f"Give the factor that brings it to millimetres, such as scale={factor:g}."
    raise DataError(
        "the mesh does not have the size of a head",
        path=path,
        found=f"{extent:.4g} mm across",
        expected=f"{_SMALLEST:.0f} to {_LARGEST:.0f} mm",
        advice=advice,
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
