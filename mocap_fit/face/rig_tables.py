"""The tables of a rig file: points, weights, transforms and regions."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import ArrayLike
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, Strict, model_validator
from scipy import sparse
from scipy.sparse.csgraph import dijkstra

from mocap_fit.errors import ConfigurationError
from mocap_fit.face.mesh import IndexArray, Mesh, list_edges
from mocap_fit.tracks import FloatArray

# No length, angle or factor of a face is larger; beyond, arithmetic overflows.
LARGEST = 1e6
Number = Annotated[float, Strict(), Field(ge=-LARGEST, le=LARGEST)]
Share = Annotated[float, Strict(), Field(ge=0, le=1)]
Vector = tuple[Number, Number, Number]
Places = Mapping[str, FloatArray]


class Strictly(BaseModel):
    """A table that holds what it may hold and nothing else."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


def _names(value: Any) -> Any:
    return [value] if isinstance(value, str) else value


Names = Annotated[tuple[str, ...], BeforeValidator(_names)]


class Point(Strictly):
    """A place on a mesh.

    The mean of feature points, or of points of the rig file, and an offset from it in the rig
    file's millimetres; or a position in the mesh's. Written as ``{ at = ["8.3", "8.4"], offset =
    [0, 0, 8] }``, or short: ``"8.3"``, ``["8.3", "8.4"]``, ``[0, 30, 5]``.
    """

    at: Names = ()
    offset: Vector = (0.0, 0.0, 0.0)
    position: Vector | None = None

    @model_validator(mode="after")
    def _one_kind(self) -> Point:
        if bool(self.at) == (self.position is not None):
            raise ValueError("give the feature points it is at, or a position [x, y, z]")
        return self

    def on(self, mesh: Mesh, scales: ArrayLike, places: Places) -> FloatArray:
        """Where it is on the mesh, `(3,)`, millimetres; the offset is scaled to the mesh."""
        if self.position is not None:
            return np.asarray(self.position, dtype=np.float64)
        found = [
            places[name] if name in places else mesh.vertices[mesh.get_feature_point(name)]
            for name in self.at
        ]
        return np.asarray(np.mean(found, axis=0) + np.multiply(scales, self.offset))


def _point(value: Any) -> Any:
    if isinstance(value, str):
        return {"at": value}
    if isinstance(value, list):
        return {"at" if any(isinstance(item, str) for item in value) else "position": value}
    return value


AnyPoint = Annotated[Point, BeforeValidator(_point)]


class Constraint(Strictly):
    """Vertices at which a weight field has a known value.

    They are those of regions, feature points, and what lies below, above or behind a place.
    Optional ones are passed over where the mesh does not have them.
    """

    value: Share
    regions: Names = ()
    optional_regions: Names = ()
    feature_points: Names = ()
    optional_feature_points: Names = ()
    below: AnyPoint | None = None
    above: AnyPoint | None = None
    behind: AnyPoint | None = None

    @model_validator(mode="after")
    def _somewhere(self) -> Constraint:
        if not self.model_fields_set - {"value"}:
            raise ValueError("name regions or feature_points that have this value")
        return self

    def members(self, mesh: Mesh, scales: ArrayLike, places: Places) -> IndexArray:
        """Indices of the vertices, unique."""
        optional = [name for name in self.optional_feature_points if name in mesh.feature_points]
        points = [mesh.get_feature_point(name) for name in (*self.feature_points, *optional)]
        there = [name for name in self.optional_regions if mesh.has_region(name)]
        found = [np.array(points, dtype=np.int64)]
        found += [mesh.get_region(name) for name in (*self.regions, *there)]
        for point, axis, sign in ((self.below, 1, -1), (self.above, 1, 1), (self.behind, 2, -1)):
            if point is not None:
                limit = point.on(mesh, scales, places)[axis]
                found.append(np.flatnonzero(sign * (mesh.vertices[:, axis] - limit) > 0))
        return np.unique(np.concatenate(found))


class Weight(Strictly):
    """The share of a transform that each vertex takes.

    Either a falloff round a centre (1 within the plateau's part of the radii), or a smooth field
    through known values; then multiplied by other weights (or one minus them), and set on whole
    parts, those that the mesh has.
    """

    on: str = "skin"
    centre: AnyPoint | None = None
    radii: Vector | None = None
    plateau: Annotated[float, Strict(), Field(ge=0, lt=1)] = 0.0
    values: tuple[Constraint, ...] = ()
    multiply: Names = ()
    parts: dict[str, Share] = {}

    @model_validator(mode="after")
    def _one_kind(self) -> Weight:
        given = {name for name in ("centre", "radii", "values") if getattr(self, name)}
        if given not in ({"centre", "radii"}, {"values"}):
            raise ValueError("give either centre and radii, or values")
        if self.radii is not None and min(self.radii) <= 0:
            raise ValueError("radii must be above 0")
        return self

    def factors(self) -> list[tuple[str, bool]]:
        """Names of the weights that multiply it, and whether one minus them is meant."""
        return [(f.removeprefix("1 - "), f.startswith("1 - ")) for f in self.multiply]


_NEEDED = {
    "translation": {"by"},
    "rotation": {"axis", "degrees", "centre"},
    "scaling": {"factors", "centre"},
}


class Transform(Strictly):
    """One weighted transform, driven by one parameter."""

    parameter: str
    kind: Literal["translation", "rotation", "scaling"]
    weight: str
    by: Vector | None = None
    axis: Vector | None = None
    degrees: Number | None = None
    factors: Vector | None = None
    centre: AnyPoint | None = None

    @model_validator(mode="after")
    def _complete(self) -> Transform:
        given = {
            name
            for name in ("by", "axis", "degrees", "factors", "centre")
            if getattr(self, name) is not None
        }
        needed = _NEEDED[self.kind]
        if needed - given:
            raise ValueError(f"a {self.kind} needs {', '.join(sorted(needed - given))}")
        if given - needed:
            raise ValueError(f"a {self.kind} has no {', '.join(sorted(given - needed))}")
        if self.axis is not None and not any(self.axis):
            raise ValueError("the axis has no direction")
        return self


def _number_or_pair(value: Any) -> Any:
    pair = value if isinstance(value, list) and len(value) == 2 else [value]
    if not all(type(item) is int and item >= 0 for item in pair) or pair[0] > pair[-1]:
        raise ValueError("give a vertex number, or a pair [first, last]")
    return value


class Region(Strictly):
    """A set of vertices of a mesh of one's own.

    Its members are listed (``vertices``: numbers, or pairs for ranges that include their ends),
    or a whole part, or what lies within a distance of feature points along the surface, in
    millimetres of the mesh.
    """

    vertices: tuple[Annotated[int | tuple[int, int], BeforeValidator(_number_or_pair)], ...] = ()
    part: str | None = None
    near: Names = ()
    within: Annotated[float, Strict(), Field(gt=0)] | None = None

    @model_validator(mode="after")
    def _somewhere(self) -> Region:
        if bool(self.near) != (self.within is not None):
            raise ValueError("near and within go together")
        if not self.model_fields_set:
            raise ValueError("give vertices, a part, or near and within")
        return self

    def members(self, mesh: Mesh) -> IndexArray:
        """Indices of the vertices."""
        found = [np.zeros(0, dtype=np.int64)]
        for item in self.vertices:
            first, last = (item, item) if isinstance(item, int) else item
            check_vertex(last, mesh)
            found.append(np.arange(first, last + 1))
        if self.part is not None:
            extent = mesh.get_part(self.part).vertices
            found.append(np.arange(extent.start, extent.stop))
        if self.within is not None:
            distance = compute_surface_distance(
                mesh, [mesh.get_feature_point(name) for name in self.near]
            )
            found.append(np.flatnonzero(distance <= self.within))
        return np.unique(np.concatenate(found))


def check_vertex(index: int, mesh: Mesh) -> None:
    """Refuse the number of a vertex that the mesh does not have."""
    if index >= len(mesh.vertices):
        raise ConfigurationError(
            "the mesh has no such vertex",
            found=index,
            expected=f"0 to {len(mesh.vertices) - 1}",
        )


def compute_surface_distance(mesh: Mesh, vertices: int | list[int]) -> FloatArray:
    """Distance of every vertex from the nearest of some, along the edges, in millimetres.

    Parameters
    ----------
    vertices
        Index of a vertex, or several.

    Returns
    -------
    FloatArray
        `(vertices,)`; infinite on pieces of the mesh that hold none of them.
    """
    edges = list_edges(mesh.triangles)
    lengths = np.linalg.norm(mesh.vertices[edges[:, 0]] - mesh.vertices[edges[:, 1]], axis=1)
    count = len(mesh.vertices)
    graph = sparse.csr_matrix((lengths, (edges[:, 0], edges[:, 1])), shape=(count, count))
    return np.asarray(dijkstra(graph, directed=False, indices=vertices, min_only=True))
