"""Rig files: a rig as a person writes it (TOML).

A rig file names the mesh it is for, tells where the feature points and regions of that mesh are
(the built-in head has its own), and lists weights and transforms. ``extends = "parke"`` takes the
parameters, weights and transforms of the shipped rig, so that a mesh of one's own needs only its
feature points and regions.
"""

from __future__ import annotations

import tomllib
from importlib import resources
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError, model_validator
from scipy import sparse
from scipy.sparse.csgraph import dijkstra

from mocap_fit.errors import ConfigurationError
from mocap_fit.face.mesh import IndexArray, Mesh
from mocap_fit.tracks import FloatArray

Vector = tuple[float, float, float]


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class Point(_Strict):
    """A place on a mesh: the mean of feature points, and an offset in millimetres from it."""

    at: tuple[str, ...] = ()
    offset: Vector = (0.0, 0.0, 0.0)

    def position(self, mesh: Mesh, scale: float) -> FloatArray:
        """Where it is on the mesh, `(3,)`; the offset is scaled to the mesh."""
        where = scale * np.asarray(self.offset, dtype=np.float64)
        if self.at:
            where += mesh.vertices[[mesh.feature_point(name) for name in self.at]].mean(axis=0)
        return where


def _point(value: Any) -> Any:
    if isinstance(value, str):
        return {"at": [value]}
    if isinstance(value, list) and value and all(isinstance(item, str) for item in value):
        return {"at": value}
    if isinstance(value, dict) and isinstance(value.get("at"), str):
        return {**value, "at": [value["at"]]}
    return value


AnyPoint = Annotated[Point, BeforeValidator(_point)]


class Constraint(_Strict):
    """Vertices at which a weight field has a known value.

    Optional regions are passed over where the mesh does not have them.
    """

    value: float = Field(ge=0, le=1)
    regions: tuple[str, ...] = ()
    optional_regions: tuple[str, ...] = ()
    feature_points: tuple[str, ...] = ()

    def members(self, mesh: Mesh) -> IndexArray:
        """Indices of the vertices, unique."""
        points = np.array([mesh.feature_point(n) for n in self.feature_points], dtype=np.int64)
        there = [name for name in self.optional_regions if mesh.has_region(name)]
        regions = [mesh.region(name) for name in (*self.regions, *there)]
        return np.unique(np.concatenate([points, *regions]))


class Weight(_Strict):
    """The share of a transform that each vertex takes.

    Either a falloff round a centre (1 within the plateau's part of the radii), or a smooth field
    through known values; then multiplied by other weights (or one minus them), and set on whole
    parts, those that the mesh has.
    """

    on: str = "skin"
    centre: AnyPoint | None = None
    radii: Vector | None = None
    plateau: float = Field(default=0.0, ge=0, lt=1)
    values: tuple[Constraint, ...] = ()
    multiply: tuple[str, ...] = ()
    parts: dict[str, float] = {}

    @model_validator(mode="after")
    def _one_kind(self) -> Weight:
        if bool(self.values) == (self.centre is not None and self.radii is not None):
            raise ValueError("give either centre and radii, or values")
        if self.radii is not None and min(self.radii) <= 0:
            raise ValueError("radii must be above 0")
        return self


_NEEDED = {
    "translation": ("by",),
    "rotation": ("axis", "degrees", "centre"),
    "scaling": ("factors", "centre"),
}


class Transform(_Strict):
    """One weighted transform, driven by one parameter."""

    parameter: str
    kind: Literal["translation", "rotation", "scaling"]
    weight: str
    by: Vector | None = None
    axis: Vector | None = None
    degrees: float = 0.0
    factors: Vector | None = None
    centre: AnyPoint | None = None

    @model_validator(mode="after")
    def _complete(self) -> Transform:
        needed: dict[str, object] = {
            "by": self.by,
            "axis": self.axis,
            "degrees": self.degrees,
            "factors": self.factors,
            "centre": self.centre,
        }
        missing = [name for name in _NEEDED[self.kind] if not needed[name]]
        if missing:
            raise ValueError(f"a {self.kind} needs {', '.join(missing)}")
        if self.axis is not None and not any(self.axis):
            raise ValueError("the axis has no direction")
        return self


class Region(_Strict):
    """A set of vertices of a mesh of one's own.

    Its members are listed (``vertices``: numbers, or pairs for ranges that include their ends),
    or a whole part, or what lies within a distance of a feature point along the surface.
    """

    vertices: tuple[int | tuple[int, int], ...] = ()
    part: str | None = None
    near: str | None = None
    within: float = 0.0

    def members(self, mesh: Mesh) -> IndexArray:
        """Indices of the vertices."""
        found = [np.zeros(0, dtype=np.int64)]
        for item in self.vertices:
            first, last = (item, item) if isinstance(item, int) else item
            found.append(np.arange(first, last + 1))
        if self.part is not None:
            extent = mesh.part(self.part).vertices
            found.append(np.arange(extent.start, extent.stop))
        if self.near is not None:
            distance = surface_distance(mesh, mesh.feature_point(self.near))
            found.append(np.flatnonzero(distance <= self.within))
        return np.unique(np.concatenate(found))


class RigFile(_Strict):
    """A whole rig file.

    Parameters
    ----------
    kind
        Which registered rig reads it.
    extends
        A shipped rig whose parameters, weights and transforms are taken over where the file
        gives none.
    mesh
        The mesh, a path beside the file; the built-in head when left out.
    scale, axes
        How to bring the mesh to millimetres and to the head frame; see `read_mesh`.
    mouth_width
        The lengths in the file are for a face whose mouth corners (8.3, 8.4) are this far apart,
        in millimetres, and are scaled to the mesh.
    feature_points
        Where the mesh has them: a vertex number, or a position whose nearest vertex is taken.
    regions
        Named sets of vertices.
    parameters
        Name → lower and upper bound, in order.
    weights, transforms
        See `Weight` and `Transform`; transforms apply in order.
    follow
        Region → region: vertices that take all the weights of the nearest vertex there; passed
        over where the mesh does not have the first.
    """

    kind: str = "parke"
    extends: str | None = None
    mesh: str | None = None
    scale: float = Field(default=1.0, gt=0)
    axes: str | None = None
    mouth_width: float = Field(default=50.0, gt=0)
    feature_points: dict[str, int | Vector] = {}
    regions: dict[str, Region] = {}
    parameters: dict[str, tuple[float, float]] = {}
    weights: dict[str, Weight] = {}
    transforms: tuple[Transform, ...] = ()
    follow: dict[str, str] = {}

    @model_validator(mode="after")
    def _consistent(self) -> RigFile:
        for name, (lower, upper) in self.parameters.items():
            if not lower <= 0 < upper:
                raise ValueError(f"the bounds of '{name}' must hold 0 and leave room above it")
        for i, transform in enumerate(self.transforms):
            if self.parameters and transform.parameter not in self.parameters:
                raise ValueError(f"transform {i + 1} names no parameter: '{transform.parameter}'")
        unmoved = set(self.parameters) - {t.parameter for t in self.transforms}
        if self.transforms and unmoved:
            raise ValueError(f"no transform is driven by {', '.join(sorted(unmoved))}")
        return self

    def scale_on(self, mesh: Mesh) -> float:
        """Length on the mesh of one millimetre of the file."""
        corners = mesh.vertices[[mesh.feature_point("8.3"), mesh.feature_point("8.4")]]
        width = float(np.linalg.norm(corners[0] - corners[1]))
        if not 1.0 < width < 1000.0:
            raise ConfigurationError(
                "the mouth corners 8.3 and 8.4 of the mesh are not a mouth's width apart",
                found=f"{width:.3g} mm",
                expected=f"about {self.mouth_width:g} mm",
                advice="Check the feature points, and the scale that brings the mesh to mm.",
            )
        return width / self.mouth_width

    def named(self, mesh: Mesh) -> Mesh:
        """The mesh with the feature points and regions of this file added."""
        points = dict(mesh.feature_points)
        for name, where in self.feature_points.items():
            if isinstance(where, int):
                points[name] = where
            else:
                distance = np.linalg.norm(mesh.vertices - np.asarray(where), axis=1)
                points[name] = int(np.argmin(distance))
        mesh = Mesh(mesh.vertices, mesh.triangles, mesh.parts, mesh.regions, points, mesh.colours)
        regions = {name: region.members(mesh) for name, region in self.regions.items()}
        empty = [name for name, members in regions.items() if members.size == 0]
        if empty:
            raise ConfigurationError(f"the region '{empty[0]}' of the rig file holds no vertex")
        return Mesh(
            mesh.vertices,
            mesh.triangles,
            mesh.parts,
            {**mesh.regions, **regions},
            points,
            mesh.colours,
        )


def read_rig_file(path: str | Path) -> RigFile:
    """Read a rig file, or a shipped rig by its name.

    Raises
    ------
    ConfigurationError
        If it cannot be read, is not TOML, or contradicts itself; the message says where.
    """
    name = str(path)
    try:
        if name in shipped_rigs():
            text = resources.files("mocap_fit.face").joinpath(f"{name}.toml").read_text("utf-8")
        else:
            text = Path(path).read_text("utf-8")
        content = tomllib.loads(text)
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigurationError(
            "the rig file cannot be read",
            path=name,
            found=error,
            advice=f"Give a TOML file, or one of the shipped rigs: {', '.join(shipped_rigs())}.",
        ) from None
    except tomllib.TOMLDecodeError as error:
        raise ConfigurationError("the rig file is not TOML", path=name, found=error) from None
    try:
        rig_file = RigFile.model_validate(content)
    except ValidationError as error:
        first = error.errors()[0]
        raise ConfigurationError(
            f"the rig file is wrong at {'.'.join(map(str, first['loc'])) or 'its top'}",
            path=name,
            found=first["msg"],
        ) from None
    if rig_file.extends is not None:
        if rig_file.extends not in shipped_rigs():
            raise ConfigurationError(
                "the rig file extends a rig that is not shipped",
                path=name,
                found=rig_file.extends,
                expected=f"one of {', '.join(shipped_rigs())}",
            )
        base = read_rig_file(rig_file.extends)
        own = {key: getattr(rig_file, key) for key in rig_file.model_fields_set}
        rig_file = base.model_copy(update={**own, "weights": {**base.weights, **rig_file.weights}})
    if not rig_file.transforms or not rig_file.parameters:
        raise ConfigurationError(
            "the rig file has no parameters or no transforms",
            path=name,
            advice='Add them, or take the shipped ones with extends = "parke".',
        )
    return rig_file


def shipped_rigs() -> tuple[str, ...]:
    """Names of the rigs that come with the package."""
    files = resources.files("mocap_fit.face").iterdir()
    return tuple(sorted(f.name.removesuffix(".toml") for f in files if f.name.endswith(".toml")))


def surface_distance(mesh: Mesh, vertex: int) -> FloatArray:
    """Distance of every vertex from one of them along the edges, `(vertices,)`, millimetres."""
    edges = np.concatenate([mesh.triangles[:, [i, (i + 1) % 3]] for i in range(3)])
    edges = np.unique(np.sort(edges, axis=1), axis=0)
    lengths = np.linalg.norm(mesh.vertices[edges[:, 0]] - mesh.vertices[edges[:, 1]], axis=1)
    count = len(mesh.vertices)
    graph = sparse.csr_matrix((lengths, (edges[:, 0], edges[:, 1])), shape=(count, count))
    return np.asarray(dijkstra(graph, directed=False, indices=vertex))
