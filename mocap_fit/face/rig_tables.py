"""The tables of a rig file: points, weights, transforms and regions."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import ArrayLike
from pydantic import BeforeValidator, Field, Strict, model_validator
from scipy import sparse
from scipy.sparse.csgraph import dijkstra

from mocap_fit.errors import ConfigurationError
from mocap_fit.face.mesh import IndexArray, Mesh, list_edges
from mocap_fit.settings_file import StrictModel
from mocap_fit.tracks import FloatArray

# No length, angle or factor of a face is larger; beyond, arithmetic overflows.
LARGEST = 1e6
Number = Annotated[float, Strict(), Field(ge=-LARGEST, le=LARGEST)]
Share = Annotated[float, Strict(), Field(ge=0, le=1)]
Vector = tuple[Number, Number, Number]
Locations = Mapping[str, FloatArray]


def _to_list(value: Any) -> Any:
    return [value] if isinstance(value, str) else value


Names = Annotated[tuple[str, ...], BeforeValidator(_to_list)]


class Point(StrictModel):
    """A point on or near a mesh.

    The mean of feature points, or of points of the rig file, and an offset from it in the rig
    file's millimetres; or a position in the mesh's. Written as ``{ at = ["8.3", "8.4"], offset =
    [0, 0, 8] }``, or short: ``"8.3"``, ``["8.3", "8.4"]``, ``[0, 30, 5]``.

    Parameters
    ----------
    at
        Names of feature points, or of points of the rig file.
    offset
        Offset from their mean along x, y and z, millimetres of the rig file.
    position
        Position in place of `at`, x, y and z, millimetres of the mesh.
    """

    at: Names = ()
    offset: Vector = (0.0, 0.0, 0.0)
    position: Vector | None = None

    @model_validator(mode="after")
    def _check_kind(self) -> Point:
        if bool(self.at) == (self.position is not None):
            raise ValueError("give the feature points it is at, or a position [x, y, z]")
        return self

    def locate(self, mesh: Mesh, scales: ArrayLike, locations: Locations) -> FloatArray:
        """Locate the point on a mesh.

        Parameters
        ----------
        mesh
            The mesh.
        scales
            Millimetres of the mesh in one of the rig file, along x, y and z, ``(3,)`` or scalar.
        locations
            Positions of the rig file's named points on the mesh, ``(3,)`` each, millimetres.

        Returns
        -------
        ndarray
            Its position, ``(3,)``, millimetres.
        """
        if self.position is not None:
            return np.asarray(self.position, dtype=np.float64)
        ends = [
            locations[name] if name in locations else mesh.vertices[mesh.get_feature_point(name)]
            for name in self.at
        ]
        return np.asarray(np.mean(ends, axis=0) + np.multiply(scales, self.offset))


def _to_point(value: Any) -> Any:
    if isinstance(value, str):
        return {"at": value}
    if isinstance(value, list):
        return {"at" if any(isinstance(item, str) for item in value) else "position": value}
    return value


AnyPoint = Annotated[Point, BeforeValidator(_to_point)]


class Constraint(StrictModel):
    """Vertices at which a weight field has a known value.

    They are those of regions, feature points, and what lies below, above or behind a point.
    Optional ones are passed over where the mesh does not have them.

    Parameters
    ----------
    value
        The value there, 0 to 1.
    regions, optional_regions
        Names of regions of the mesh.
    feature_points, optional_feature_points
        Names of feature points of the mesh.
    below, above
        Points: all vertices whose y is lower, or higher.
    behind
        A point: all vertices whose z is lower.
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
    def _check_members(self) -> Constraint:
        if not self.model_fields_set - {"value"}:
            raise ValueError("name regions or feature_points that have this value")
        return self

    def find_vertices(self, mesh: Mesh, scales: ArrayLike, locations: Locations) -> IndexArray:
        """Find the vertices that have the value.

        Parameters
        ----------
        mesh
            The mesh.
        scales
            Millimetres of the mesh in one of the rig file, along x, y and z, ``(3,)`` or scalar.
        locations
            Positions of the rig file's named points on the mesh, ``(3,)`` each, millimetres.

        Returns
        -------
        ndarray
            Vertex indices, ``(members,)``, each once.
        """
        optional = [name for name in self.optional_feature_points if name in mesh.feature_points]
        points = [mesh.get_feature_point(name) for name in (*self.feature_points, *optional)]
        present = [name for name in self.optional_regions if mesh.has_region(name)]
        members = [np.array(points, dtype=np.int64)]
        members += [mesh.get_region(name) for name in (*self.regions, *present)]
        for point, axis, is_beyond in (
            (self.below, 1, np.less),
            (self.above, 1, np.greater),
            (self.behind, 2, np.less),
        ):
            if point is not None:
                limit = point.locate(mesh, scales, locations)[axis]
                members.append(np.flatnonzero(is_beyond(mesh.vertices[:, axis], limit)))
        return np.unique(np.concatenate(members))


class Weight(StrictModel):
    """The share of a transform that each vertex takes.

    Either a falloff round a centre, or a smooth field through known values; then multiplied by
    other weights, and set on complete parts and regions, those that the mesh has.

    Parameters
    ----------
    on
        The part on which it is computed.
    centre
        Centre of the falloff, a point.
    radii
        Radii of the falloff along x, y and z, above 0, millimetres of the rig file.
    plateau
        Part of the radii within which the weight is 1, 0 to below 1.
    values
        Constraints of the smooth field, in place of centre and radii.
    multiply
        Names of weights that it is multiplied by; ``"1 - NAME"`` for one minus a weight.
    parts
        Part or region → the value of all its vertices, 0 to 1.
    """

    on: str = "skin"
    centre: AnyPoint | None = None
    radii: Vector | None = None
    plateau: Annotated[float, Strict(), Field(ge=0, lt=1)] = 0.0
    values: tuple[Constraint, ...] = ()
    multiply: Names = ()
    parts: dict[str, Share] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _check_kind(self) -> Weight:
        present = {name for name in ("centre", "radii", "values") if getattr(self, name)}
        if present not in ({"centre", "radii"}, {"values"}):
            raise ValueError("give either centre and radii, or values")
        if self.radii is not None and min(self.radii) <= 0:
            raise ValueError("radii must be above 0")
        return self

    def list_factors(self) -> list[tuple[str, bool]]:
        """List the weights that multiply it.

        Returns
        -------
        list of tuple
            Name of each, and whether one minus it is meant.
        """
        return [(f.removeprefix("1 - "), f.startswith("1 - ")) for f in self.multiply]


_NEEDED = {
    "translation": {"by"},
    "rotation": {"axis", "degrees", "centre"},
    "scaling": {"factors", "centre"},
}


class Transform(StrictModel):
    """One weighted transform, driven by one parameter.

    Parameters
    ----------
    parameter
        The parameter that drives it.
    kind
        ``translation``, ``rotation`` or ``scaling``.
    weight
        Name of the weight.
    by
        Of a translation: displacement at parameter 1, millimetres of the rig file.
    axis
        Of a rotation: its axis, of any length.
    degrees
        Of a rotation: its angle at parameter 1, degrees.
    factors
        Of a scaling: what is added to the scale along x, y and z at parameter 1, no unit.
    centre
        Of a rotation or a scaling: the point that stays.
    """

    parameter: str
    kind: Literal["translation", "rotation", "scaling"]
    weight: str
    by: Vector | None = None
    axis: Vector | None = None
    degrees: Number | None = None
    factors: Vector | None = None
    centre: AnyPoint | None = None

    @model_validator(mode="after")
    def _check_amounts(self) -> Transform:
        present = self.model_fields_set & {"by", "axis", "degrees", "factors", "centre"}
        needed = _NEEDED[self.kind]
        if needed - present:
            raise ValueError(f"a {self.kind} needs {', '.join(sorted(needed - present))}")
        if present - needed:
            raise ValueError(f"a {self.kind} has no {', '.join(sorted(present - needed))}")
        if self.axis is not None and not any(self.axis):
            raise ValueError("the axis has no direction")
        return self


class Tongue(StrictModel):
    """What a rig file adds for the movements of the tongue.

    Parameters
    ----------
    parameters
        Name → lower and upper bound; they come after the others.
    weights
        Name → the share of a transform that each vertex takes.
    transforms
        Weighted transforms, which apply before the others: the jaw carries the tongue.
    """

    parameters: dict[str, tuple[Number, Number]]
    weights: dict[str, Weight]
    transforms: tuple[Transform, ...]


def _check_number_or_pair(value: Any) -> Any:
    pair = value if isinstance(value, list) and len(value) == 2 else [value]
    if not all(type(item) is int and item >= 0 for item in pair) or pair[0] > pair[-1]:
        raise ValueError("give a vertex number, or a pair [first, last]")
    return value


class Region(StrictModel):
    """A set of vertices of the user's mesh; what several settings name is taken together.

    Parameters
    ----------
    vertices
        Vertex numbers from 0, or pairs for ranges that include their ends.
    part
        A part, all of it.
    near
        Feature points; with `within`, the vertices near them.
    within
        Distance from the nearest of them along the surface, above 0, millimetres of the mesh.
    """

    vertices: tuple[
        Annotated[int | tuple[int, int], BeforeValidator(_check_number_or_pair)], ...
    ] = ()
    part: str | None = None
    near: Names = ()
    within: Annotated[float, Strict(), Field(gt=0)] | None = None

    @model_validator(mode="after")
    def _check_members(self) -> Region:
        if bool(self.near) != (self.within is not None):
            raise ValueError("near and within go together")
        if not self.model_fields_set:
            raise ValueError("give vertices, a part, or near and within")
        return self

    def find_vertices(self, mesh: Mesh) -> IndexArray:
        """Find the vertices of the region.

        Parameters
        ----------
        mesh
            The mesh, with the feature points that the region names.

        Returns
        -------
        ndarray
            Vertex indices, ``(members,)``, each once.
        """
        members = [np.zeros(0, dtype=np.int64)]
        for item in self.vertices:
            first, last = (item, item) if isinstance(item, int) else item
            check_vertex(last, mesh)
            members.append(np.arange(first, last + 1))
        if self.part is not None:
            extent = mesh.get_part(self.part).vertices
            members.append(np.arange(extent.start, extent.stop))
        if self.within is not None:
            distance = compute_surface_distance(
                mesh, [mesh.get_feature_point(name) for name in self.near]
            )
            members.append(np.flatnonzero(distance <= self.within))
        return np.unique(np.concatenate(members))


@contextmanager
def add_location(location: str) -> Iterator[None]:
    """Add to errors where in the rig file the fault is.

    Parameters
    ----------
    location
        The keys that lead to it, such as ``weights.jaw``.

    Yields
    ------
    None
        Control, to what reads that setting.

    Raises
    ------
    ConfigurationError
        The one that was raised inside, with the location.
    """
    try:
        yield
    except ConfigurationError as error:
        raise ConfigurationError(
            f"the rig file is wrong at {location}: {error.problem}",
            path=error.path,
            found=error.found,
            expected=error.expected,
            advice=error.advice,
        ) from None


def check_vertex(index: int, mesh: Mesh) -> None:
    """Refuse the number of a vertex that the mesh does not have.

    Parameters
    ----------
    index
        The number, from 0.
    mesh
        The mesh.

    Raises
    ------
    ConfigurationError
        If the mesh has fewer vertices.
    """
    if index >= len(mesh.vertices):
        raise ConfigurationError(
            "the mesh has no such vertex", found=index, expected=f"0 to {len(mesh.vertices) - 1}"
        )


def compute_surface_distance(mesh: Mesh, vertices: int | list[int]) -> FloatArray:
    """Compute the distance of every vertex from the nearest of some, along the edges.

    Parameters
    ----------
    mesh
        The mesh.
    vertices
        Index of a vertex, or several.

    Returns
    -------
    ndarray
        ``(vertices,)``, millimetres; infinite on pieces of the mesh that hold none of them. By
        Dijkstra's algorithm.
    """
    edges = list_edges(mesh.triangles)
    lengths = np.linalg.norm(mesh.vertices[edges[:, 0]] - mesh.vertices[edges[:, 1]], axis=1)
    count = len(mesh.vertices)
    graph = sparse.csr_matrix((lengths, (edges[:, 0], edges[:, 1])), shape=(count, count))
    return np.asarray(dijkstra(graph, directed=False, indices=vertices, min_only=True))
