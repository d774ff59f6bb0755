"""A face as a triangle mesh with named parts, regions, materials and feature points."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from mocap_fit.errors import ConfigurationError
from mocap_fit.tracks import FloatArray

IndexArray = NDArray[np.int64]


@dataclass(frozen=True)
class Material:
    """How a part looks.

    Parameters
    ----------
    colour
        Red, green and blue in [0, 1]; used where the mesh has no colours of its own.
    specular
        Strength of the highlight, 0 to 1.
    specular_power
        Sharpness of the highlight.
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


@dataclass(frozen=True, eq=False)
class Mesh:
    """A triangle mesh of a face at rest, in the head frame.

    Parameters
    ----------
    vertices
        `(vertices, 3)`, millimetres; +x to the speaker's left, +y up, +z forward.
    triangles
        `(triangles, 3)`, vertex indices, counter-clockwise seen from outside.
    parts
        Pieces that tile the vertices and triangles, in order.
    regions
        Named sets of vertex indices, such as ``upper_lip``; they may overlap.
    feature_points
        MPEG-4 feature point → vertex index, such as ``{"8.1": 1234}``.
    colours
        `(vertices, 3)`, red, green and blue in [0, 1], or None for the parts' materials.

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
        vertices = np.array(self.vertices, dtype=np.float64)
        triangles = np.array(self.triangles, dtype=np.int64)
        if vertices.ndim != 2 or vertices.shape[1] != 3 or len(vertices) < 3:
            raise ConfigurationError(
                "the mesh has no usable vertices", found=vertices.shape, expected="(3 or more, 3)"
            )
        if not np.isfinite(vertices).all():
            index = int(np.argwhere(~np.isfinite(vertices))[0][0])
            raise ConfigurationError(f"vertex {index} of the mesh is not finite")
        if triangles.ndim != 2 or triangles.shape[1] != 3 or len(triangles) == 0:
            raise ConfigurationError(
                "the mesh has no usable triangles", found=triangles.shape, expected="(1 or more, 3)"
            )
        wrong = (triangles < 0) | (triangles >= len(vertices))
        if wrong.any():
            index = int(np.argwhere(wrong)[0][0])
            raise ConfigurationError(
                f"triangle {index} of the mesh names a vertex that is not there",
                found=triangles[index].tolist(),
                expected=f"0 to {len(vertices) - 1}",
            )
        vertices.setflags(write=False)
        triangles.setflags(write=False)
        object.__setattr__(self, "vertices", vertices)
        object.__setattr__(self, "triangles", triangles)
        if not self.parts:
            whole = Part("skin", range(len(vertices)), range(len(triangles)))
            object.__setattr__(self, "parts", (whole,))
        for kind, end in (("vertices", len(vertices)), ("triangles", len(triangles))):
            position = 0
            for part in self.parts:
                extent: range = getattr(part, kind)
                if extent.start != position:
                    raise ConfigurationError(
                        f"the part '{part.name}' does not follow the part before it in {kind}",
                        found=extent.start,
                        expected=position,
                    )
                position = extent.stop
            if position != end:
                raise ConfigurationError(
                    f"the parts do not cover the {kind}", found=position, expected=end
                )
        regions = {}
        for name, members in self.regions.items():
            array = np.unique(np.asarray(members, dtype=np.int64))
            if array.size and (array[0] < 0 or array[-1] >= len(vertices)):
                raise ConfigurationError(f"the region '{name}' names a vertex that is not there")
            regions[name] = array
        object.__setattr__(self, "regions", regions)
        for name, vertex in self.feature_points.items():
            if not 0 <= vertex < len(vertices):
                raise ConfigurationError(
                    f"the feature point {name} names a vertex that is not there", found=vertex
                )
        if self.colours is not None:
            colours = np.array(self.colours, dtype=np.float64)
            if colours.shape != vertices.shape:
                raise ConfigurationError(
                    "the colours have the wrong shape",
                    found=colours.shape,
                    expected=vertices.shape,
                )
            colours.setflags(write=False)
            object.__setattr__(self, "colours", colours)

    def get_part(self, name: str) -> Part:
        """The part of that name."""
        for part in self.parts:
            if part.name == name:
                return part
        raise ConfigurationError(
            f"the mesh has no part '{name}'",
            expected=f"one of {', '.join(part.name for part in self.parts)}",
        )

    def get_region(self, name: str) -> IndexArray:
        """Vertex indices of the region, or of the part, of that name."""
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
        """Whether there is a region or a part of that name."""
        return name in self.regions or any(part.name == name for part in self.parts)

    def get_feature_point(self, name: str) -> int:
        """Vertex index of an MPEG-4 feature point."""
        try:
            return self.feature_points[name]
        except KeyError:
            raise ConfigurationError(
                f"the mesh has no feature point {name}",
                expected=f"one of {', '.join(self.feature_points) or 'none'}",
            ) from None

    def compute_normals(self, vertices: FloatArray | None = None) -> FloatArray:
        """Unit normals at the vertices, `(vertices, 3)`, weighted by the triangles' areas.

        Parameters
        ----------
        vertices
            `(vertices, 3)`: the mesh in another shape; at rest where not given.
        """
        vertices = self.vertices if vertices is None else vertices
        a, b, c = (vertices[self.triangles[:, corner]] for corner in range(3))
        across = np.cross(b - a, c - a)
        normals = np.stack(
            [
                np.bincount(
                    self.triangles.ravel(), np.repeat(across[:, i], 3), minlength=len(vertices)
                )
                for i in range(3)
            ],
            axis=1,
        )
        lengths = np.linalg.norm(normals, axis=1, keepdims=True)
        return np.asarray(normals / np.maximum(lengths, 1e-12))

    def replace_vertices(self, vertices: FloatArray) -> Mesh:
        """The same mesh in another shape."""
        return replace(self, vertices=vertices)
