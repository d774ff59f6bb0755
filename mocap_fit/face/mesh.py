"""A face as a triangle mesh with named parts, regions, materials and feature points."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mocap_fit.errors import ConfigurationError
from mocap_fit.tracks import FloatArray

IndexArray = NDArray[np.int64]


@dataclass(frozen=True)
class Material:
    """The look of a part.

    Parameters
    ----------
    colour
        Red, green and blue, 0 to 1; used where the mesh has no colours.
    specular
        Strength of the highlight, 0 to 1.
    specular_power
        Sharpness of the highlight, an exponent without unit.
    """

    colour: tuple[float, float, float] = (0.8, 0.7, 0.6)
    specular: float = 0.1
    specular_power: float = 10.0


@dataclass(frozen=True)
class Part:
    """A named piece of a mesh: consecutive vertices and the consecutive triangles on them.

    Parameters
    ----------
    name
        Such as ``skin``, ``teeth_upper``, ``tongue``.
    vertices, triangles
        Half-open ranges of indices into the mesh's arrays.
    material
        How it looks.
    """

    name: str
    vertices: range
    triangles: range
    material: Material = field(default_factory=Material)


@dataclass(frozen=True, eq=False, repr=False)
class Mesh:
    """A triangle mesh of a face at rest, in the head frame.

    Parameters
    ----------
    vertices
        Positions, ``(vertices, 3)``, millimetres; +x to the speaker's left, +y up, +z forward.
    triangles
        Vertex indices, ``(triangles, 3)``, counter-clockwise seen from outside.
    parts
        Pieces that tile the vertices and triangles, in order.
    regions
        Named sets of vertex indices, ``(members,)`` each, such as ``upper_lip``; they may overlap.
    feature_points
        MPEG-4 feature point → vertex index, such as ``{"8.1": 1234}``.
    colours
        Red, green and blue of every vertex, ``(vertices, 3)``, 0 to 1; None for the parts'
        materials.

    Raises
    ------
    ConfigurationError
        If the arrays contradict each other, with the first offending triangle or name.
    """

    vertices: FloatArray
    triangles: IndexArray
    parts: tuple[Part, ...] = ()
    regions: Mapping[str, IndexArray] = field(default_factory=dict)
    feature_points: Mapping[str, int] = field(default_factory=dict)
    colours: FloatArray | None = None

    def __post_init__(self) -> None:
        vertices = _check_vertices(np.array(self.vertices, dtype=np.float64))
        count = len(vertices)
        triangles = _check_triangles(np.array(self.triangles, dtype=np.int64), count)
        parts = self.parts or (Part("skin", range(count), range(len(triangles))),)
        _check_tiling(parts, "vertices", count)
        _check_tiling(parts, "triangles", len(triangles))
        regions = {
            name: _check_region(name, np.unique(np.asarray(members, dtype=np.int64)), count)
            for name, members in self.regions.items()
        }
        for name, vertex in self.feature_points.items():
            if not 0 <= vertex < count:
                raise ConfigurationError(
                    f"the feature point {name} names a vertex that is not there", found=vertex
                )
        checked = {"vertices": vertices, "triangles": triangles, "parts": parts, "regions": regions}
        if self.colours is not None:
            checked["colours"] = colours = np.array(self.colours, dtype=np.float64)
            if colours.shape != vertices.shape:
                raise ConfigurationError(
                    "the colours have the wrong shape", found=colours.shape, expected=vertices.shape
                )
        for name, value in checked.items():
            if isinstance(value, np.ndarray):
                value.setflags(write=False)
            object.__setattr__(self, name, value)

    def __reduce__(self) -> tuple[Any, ...]:
        # Made anew, so that copies are checked and read-only like the original.
        fields = (self.vertices, self.triangles, self.parts, self.regions, self.feature_points)
        return type(self), (*fields, self.colours)

    def __repr__(self) -> str:
        names = ", ".join(part.name for part in self.parts)
        return (
            f"Mesh({len(self.vertices)} vertices, {len(self.triangles)} triangles, "
            f"{len(self.regions)} regions, {len(self.feature_points)} feature points;\n"
            f"     parts {names if len(names) <= 80 else names[:79] + '…'})"
        )

    def get_part(self, name: str) -> Part:
        """Return the part of that name.

        Parameters
        ----------
        name
            Name of a part, such as ``skin``.

        Returns
        -------
        Part
            The part.

        Raises
        ------
        ConfigurationError
            If there is none of that name.
        """
        for part in self.parts:
            if part.name == name:
                return part
        raise ConfigurationError(
            f"the mesh has no part '{name}'",
            expected=f"one of {', '.join(part.name for part in self.parts)}",
        )

    def get_region(self, name: str) -> IndexArray:
        """Return the vertices of a region, or of a part.

        Parameters
        ----------
        name
            Name of a region, such as ``upper_lip``, or of a part.

        Returns
        -------
        ndarray
            Vertex indices, ``(members,)``, increasing.

        Raises
        ------
        ConfigurationError
            If there is neither a region nor a part of that name.
        """
        if name in self.regions:
            return self.regions[name]
        for part in self.parts:
            if part.name == name:
                return np.arange(part.vertices.start, part.vertices.stop)
        known = sorted({*self.regions, *(part.name for part in self.parts)})
        raise ConfigurationError(
            f"the mesh has no region '{name}'", expected=f"one of {', '.join(known)}"
        )

    def has_region(self, name: str) -> bool:
        """Return whether there is a region or a part of that name.

        Parameters
        ----------
        name
            Name of a region or of a part.

        Returns
        -------
        bool
            Whether `get_region` would find it.
        """
        return name in self.regions or any(part.name == name for part in self.parts)

    def get_feature_point(self, name: str) -> int:
        """Return the vertex of an MPEG-4 feature point.

        Parameters
        ----------
        name
            Number of the feature point, such as ``8.1``.

        Returns
        -------
        int
            Vertex index.

        Raises
        ------
        ConfigurationError
            If the mesh does not have it.
        """
        try:
            return self.feature_points[name]
        except KeyError:
            raise ConfigurationError(
                f"the mesh has no feature point {name}",
                expected=f"one of {', '.join(self.feature_points) or 'none'}",
            ) from None

    def compute_normals(self, vertices: FloatArray | None = None) -> FloatArray:
        """Compute unit normals at the vertices, weighted by the triangles' areas.

        Parameters
        ----------
        vertices
            The mesh in another shape, ``(vertices, 3)``, millimetres; None for the mesh at rest.

        Returns
        -------
        ndarray
            Normals that point outwards, ``(vertices, 3)``, without unit; 0 at a vertex that no
            triangle of any area uses.
        """
        return compute_normals(self.vertices if vertices is None else vertices, self.triangles)

    def replace_vertices(self, vertices: FloatArray) -> Mesh:
        """Return the same mesh in another shape.

        Parameters
        ----------
        vertices
            Positions, ``(vertices, 3)``, millimetres.

        Returns
        -------
        Mesh
            With the same triangles, parts, regions, feature points and colours.
        """
        return replace(self, vertices=vertices)


def compute_normals(points: FloatArray, triangles: IndexArray) -> FloatArray:
    """Compute unit normals at the corners of triangles, weighted by the triangles' areas.

    Parameters
    ----------
    points
        Positions, ``(points, 3)``, millimetres.
    triangles
        ``(triangles, 3)``, indices of points.

    Returns
    -------
    ndarray
        ``(points, 3)``, no unit; 0 at a point that no triangle of any area uses.
    """
    first, second, third = points.T[:, triangles.T].transpose(1, 0, 2)
    (ax, ay, az), (bx, by, bz) = second - first, third - first
    areas = np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx])
    corners, count = triangles.ravel(), len(points)
    normals = np.stack([np.bincount(corners, np.repeat(area, 3), count) for area in areas], axis=1)
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    return np.asarray(normals / np.maximum(lengths, 1e-12))


def list_edges(triangles: IndexArray) -> IndexArray:
    """List every edge once.

    Parameters
    ----------
    triangles
        Vertex indices, ``(triangles, 3)``.

    Returns
    -------
    ndarray
        ``(edges, 2)``, sorted, the smaller index first.
    """
    pairs = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    return np.unique(np.sort(pairs, axis=1), axis=0)


def _check_vertices(vertices: FloatArray) -> FloatArray:
    if vertices.ndim != 2 or vertices.shape[1] != 3 or len(vertices) < 3:
        raise ConfigurationError(
            "the mesh has no usable vertices", found=vertices.shape, expected="(3 or more, 3)"
        )
    finite = np.isfinite(vertices).all(axis=1)
    if not finite.all():
        raise ConfigurationError(f"vertex {int(finite.argmin())} of the mesh is not finite")
    return vertices


def _check_triangles(triangles: IndexArray, vertex_count: int) -> IndexArray:
    if triangles.ndim != 2 or triangles.shape[1] != 3 or len(triangles) == 0:
        raise ConfigurationError(
            "the mesh has no usable triangles", found=triangles.shape, expected="(1 or more, 3)"
        )
    wrong = ((triangles < 0) | (triangles >= vertex_count)).any(axis=1)
    if wrong.any():
        index = int(wrong.argmax())
        raise ConfigurationError(
            f"triangle {index} of the mesh names a vertex that is not there",
            found=triangles[index].tolist(),
            expected=f"0 to {vertex_count - 1}",
        )
    return triangles


def _check_tiling(parts: tuple[Part, ...], kind: str, count: int) -> None:
    """Refuse parts that do not follow each other without gaps from the first to the last."""
    position = 0
    for part in parts:
        extent: range = getattr(part, kind)
        if extent.start != position:
            raise ConfigurationError(
                f"the part '{part.name}' does not follow the part before it in {kind}",
                found=extent.start,
                expected=position,
            )
        position = extent.stop
    if position != count:
        raise ConfigurationError(
            f"the parts do not cover the {kind}", found=position, expected=count
        )


def _check_region(name: str, members: IndexArray, vertex_count: int) -> IndexArray:
    if members.size and (members[0] < 0 or members[-1] >= vertex_count):
        raise ConfigurationError(f"the region '{name}' names a vertex that is not there")
    return members
