"""Rig files: a rig as a person writes it (TOML).

A rig file names the mesh it is for, says where the feature points and regions of that mesh are
(those of the built-in head are known), and lists weights and transforms. ``extends = "parke"``
takes the parameters, weights and transforms of the shipped rig, so that the file of a user's mesh
needs only the points and regions that they refer to. This is a complete file for a user's mesh::

    extends = "parke"
    mesh = "my_face.obj"
    scale = 1000            # the mesh is in metres

    [feature_points]        # vertex numbers from 0, or positions in mm (nearest vertex)
    8.1 = 1041              # upper lip, middle of its outer border
    8.2 = 1187              # lower lip, middle of its outer border
    8.3 = [25, 0, 90]       # left corner of the mouth (the speaker's left, +x)
    8.4 = [-25, 0, 90]      # right corner of the mouth
    2.1 = 2203              # bottom of the chin
    2.2 = 1050              # upper lip, middle of its inner border, where the lips touch
    2.3 = 1190              # lower lip, middle of its inner border

    [points]
    jaw_joint = [0, 30, 5]  # between the ears; not needed with 10.7, 10.8, 10.9, 10.10

    [regions]
    upper_lip = { near = "8.1", within = 12 }
    lower_lip = { vertices = [1187, 1188, [1190, 1215]] }

The two regions are the red of the lips, their corners included or not. The lips must be two sheets
that meet at the corners only: where they share vertices all along, a mouth cannot open. If the
file of the mesh holds several objects, say which is which: ``[parts]`` with ``skin = "Head"``, and
``teeth_lower``, ``gums_lower``, ``tongue``, which go with the jaw. More feature points (8.5 to
8.8, 2.4 to 2.9, 2.13, 2.14) and regions (``chin``, ``nose``, ``forehead``, ``scalp``,
``upper_lip_skin``, ``lower_lip_skin``, ``mouth_bag_upper``, ``mouth_bag_lower``) make the shares
of the skin more exact, and with 9.15, the base of the nose, movements up and down are measured by
the height of the lower face; all are read where the mesh has them. What a file itself has under
``[parameters]``, ``[weights.NAME]``, ``[points]`` or ``[follow]`` replaces the shipped
entry of that name; ``[[transforms]]`` replaces all shipped ones, and then
``[parameters]`` does too. ``[tongue]`` holds the parameters, weights and transforms that
``load_face(tongue=True)`` adds.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import BeforeValidator, Field, Strict, model_validator

from mocap_fit.errors import ConfigurationError
from mocap_fit.face.mesh import Mesh, Part
from mocap_fit.face.rig_tables import (
    LARGEST,
    AnyPoint,
    Number,
    Region,
    Tongue,
    Transform,
    Vector,
    Weight,
    add_location,
    check_vertex,
)
from mocap_fit.settings_file import StrictModel, list_shipped, read_toml, validate_settings
from mocap_fit.tracks import FloatArray

_PACKAGE, _NOUN = "mocap_fit.face", "rig file"
# A feature point that is stated as a position is at most this part of the mesh's extent off it.
_NEAR_THE_MESH = 0.1
# No lower face is lower than this, for its mouth's width, in proportion to the rig file's.
_FLATTEST = 0.25


def _check_number_or_position(value: Any) -> Any:
    if type(value) is int and value >= 0:
        return value
    numbers = isinstance(value, list) and [type(item) in (int, float) for item in value]
    if numbers == [True] * 3 and all(abs(item) <= LARGEST for item in value):
        return value
    raise ValueError("give a vertex number, or a position [x, y, z] of finite numbers")


VertexOrPosition = Annotated[int | Vector, BeforeValidator(_check_number_or_position)]
Length = Annotated[float, Strict(), Field(ge=1, le=1000)]


class RigFile(StrictModel):
    """The content of a rig file.

    Parameters
    ----------
    kind
        Which registered rig reads it.
    extends
        A shipped rig whose parameters, weights, points and transforms are taken over where the
        file gives none.
    mesh
        The mesh, a path beside the file; the built-in head when left out.
    scale
        Factor that brings the mesh to millimetres, above 0.
    axes
        Which axes of the mesh are the head's x, y and z, such as ``"x z -y"``.
    mouth_width
        The lengths of weights and transforms are for a face whose mouth corners (8.3, 8.4) are
        this far apart, 1 to 1000 millimetres, and are scaled to the mesh.
    lower_face_height
        The same for lengths along y: how far the bottom of the chin (2.1) is below the base of the
        nose (9.15) on that face, 1 to 1000 millimetres; None where the width serves all axes.
    parts
        Part → what the mesh calls it, such as ``skin = "Head"``. An only part is the skin.
    feature_points
        Where the mesh has them: a vertex number, or a position whose nearest vertex is taken.
    points
        Named points that weights and transforms can be at, on the mesh or off it.
    regions
        Named sets of vertices.
    parameters
        Name → lower and upper bound, in order.
    weights
        Name → the share of a transform that each vertex takes.
    transforms
        Weighted translations, rotations and scalings, which apply in order.
    follow
        Region → region: vertices that take all the weights of the nearest vertex there; passed
        over where the mesh does not have the first.
    tongue
        What `add_tongue` adds.
    settings
        What a rig of another kind reads.
    """

    kind: str = "parke"
    extends: str | None = None
    mesh: str | None = None
    scale: Annotated[float, Strict(), Field(gt=0)] = 1.0
    axes: str | None = None
    mouth_width: Length = 50.0
    lower_face_height: Length | None = None
    parts: dict[str, str] = Field(default_factory=dict)
    feature_points: dict[str, VertexOrPosition] = Field(default_factory=dict)
    points: dict[str, AnyPoint] = Field(default_factory=dict)
    regions: dict[str, Region] = Field(default_factory=dict)
    parameters: dict[str, tuple[Number, Number]] = Field(default_factory=dict)
    weights: dict[str, Weight] = Field(default_factory=dict)
    transforms: tuple[Transform, ...] = ()
    follow: dict[str, str] = Field(default_factory=dict)
    tongue: Tongue | None = None
    settings: dict[str, Any] = Field(default_factory=dict)

    def __repr__(self) -> str:
        return (
            f"RigFile(kind={self.kind!r}, mesh={self.mesh!r}, {len(self.parameters)} parameters, "
            f"{len(self.weights)} weights, {len(self.transforms)} transforms)"
        )

    @model_validator(mode="after")
    def _check_references(self) -> RigFile:
        for name, (lower, upper) in self.parameters.items():
            if not lower <= 0 < upper:
                raise ValueError(f"parameters.{name}: bounds must hold 0, the upper one above it")
        # With `extends`, what it names may be in the other file; the two are checked together.
        if self.extends is None:
            for rig_file in (self, *(() if self.tongue is None else (self.add_tongue(),))):
                rig_file._check_weights()
                rig_file._check_transforms()
        return self

    def _check_weights(self) -> None:
        # A dictionary for its order.
        above: dict[str, None] = {}
        for name, weight in self.weights.items():
            for other, _ in weight.list_factors():
                if other not in above:
                    raise ValueError(
                        f"weights.{name}.multiply: there is no weight '{other}' above this one; "
                        f"those above are {', '.join(above) or 'none'}"
                    )
            above[name] = None

    def _check_transforms(self) -> None:
        for i, transform in enumerate(self.transforms):
            for what, names in (("parameter", self.parameters), ("weight", self.weights)):
                if getattr(transform, what) not in names:
                    raise ValueError(
                        f"transforms.{i}.{what}: there is no {what} '{getattr(transform, what)}'; "
                        f"there are {', '.join(names) or 'none'}"
                    )
        moved = {transform.parameter for transform in self.transforms}
        unmoved = [name for name in self.parameters if name not in moved]
        if self.transforms and unmoved:
            raise ValueError(f"parameters.{unmoved[0]}: no transform is driven by it")

    def add_tongue(self) -> RigFile:
        """Return the rig file with the parameters that move the tongue.

        Returns
        -------
        RigFile
            With the tongue's parameters after the others.

        Raises
        ------
        ConfigurationError
            If the file has no tongue, or parameters of the same names.
        """
        tongue = self.tongue
        if tongue is None:
            raise ConfigurationError(
                "the rig file does not say how the tongue moves",
                advice='Add a [tongue] table, or take the shipped one with extends = "parke".',
            )
        twice = [name for name in tongue.parameters if name in self.parameters]
        if twice:
            raise ConfigurationError(
                f"the rig file is wrong at tongue.parameters.{twice[0]}: there is such a parameter",
            )
        added = {
            "parameters": {**self.parameters, **tongue.parameters},
            "weights": {**self.weights, **tongue.weights},
            "transforms": (*tongue.transforms, *self.transforms),
        }
        return self.model_copy(update=added)

    def compute_scales(self, mesh: Mesh) -> FloatArray:
        """Compute the lengths on a mesh of one millimetre of the file along x, y and z.

        As with the units of MPEG-4's facial animation parameters (ISO/IEC 14496-2), a movement is
        measured by the face it is on: across by the width of the mouth, up and down by the height
        of the lower face, forwards and back by the mean of the two. A gesture is then the same one
        on a wide face and on a long one. Where the file does not state a height, or the mesh lacks
        the base of the nose (9.15), the width serves all three.

        Parameters
        ----------
        mesh
            The mesh, with the corners of the mouth (8.3, 8.4).

        Returns
        -------
        ndarray
            Millimetres of the mesh in one of the file, along x, y and z, ``(3,)``.

        Raises
        ------
        ConfigurationError
            If the corners of the mouth are not a mouth's width apart, or not left and right, or
            the chin is not below the nose.
        """
        across = self._measure_mouth_width(mesh) / self.mouth_width
        known = "9.15" in mesh.feature_points and "2.1" in mesh.feature_points
        if self.lower_face_height is None or not known:
            return np.full(3, across)
        nose, chin = (
            float(mesh.vertices[mesh.get_feature_point(name), 1]) for name in ("9.15", "2.1")
        )
        up = (nose - chin) / self.lower_face_height
        if not up > _FLATTEST * across:
            raise ConfigurationError(
                "the bottom of the chin, 2.1, is not well below the base of the nose, 9.15",
                found=f"it is {nose - chin:.3g} mm below",
                expected=f"about {across * self.lower_face_height:.3g} mm",
                advice="Check the two feature points, or leave 9.15 out.",
            )
        return np.array([across, up, (across + up) / 2])

    def _measure_mouth_width(self, mesh: Mesh) -> float:
        left, right = (mesh.vertices[mesh.get_feature_point(name)] for name in ("8.3", "8.4"))
        width = float(np.linalg.norm(left - right))
        if not 1.0 < width < 1000.0:
            raise ConfigurationError(
                "the mouth corners 8.3 and 8.4 of the mesh are not a mouth's width apart",
                found=f"{width:.3g} mm",
                expected=f"about {self.mouth_width:g} mm",
                advice="Check the feature points, and the scale that brings the mesh to mm.",
            )
        if left[0] - right[0] < 0.7 * width:
            raise ConfigurationError(
                "the mouth corner 8.3 is not to the left of 8.4, the speaker's left, which is +x",
                found=f"8.3 at {np.round(left, 1).tolist()}, 8.4 at {np.round(right, 1).tolist()}",
                advice="Check the feature points, and the axes that turn the mesh.",
            )
        return width

    def locate_points(self, mesh: Mesh, scales: FloatArray) -> dict[str, FloatArray]:
        """Locate the named points on a mesh, those that it has the feature points for.

        Parameters
        ----------
        mesh
            The mesh.
        scales
            Millimetres of the mesh in one of the file, along x, y and z, ``(3,)``.

        Returns
        -------
        dict
            Name → position, ``(3,)``, millimetres.
        """
        return {
            name: point.locate(mesh, scales, {})
            for name, point in self.points.items()
            if all(other in mesh.feature_points for other in point.at)
        }

    def check_mesh(self, mesh: Mesh) -> None:
        """Refuse a mesh that lacks what the rig needs, or whose lips cannot open.

        Parameters
        ----------
        mesh
            The mesh, with the names of this file.

        Raises
        ------
        ConfigurationError
            Naming everything that is missing, each with the first setting that needs it.
        """
        missing: dict[str, list[str]] = {}
        for (kind, name), location in self._list_needs(mesh).items():
            known = mesh.feature_points if kind == "feature point" else mesh.regions
            part_there = any(part.name == name for part in mesh.parts)
            if name not in known and not (kind in ("region", "part") and part_there):
                missing.setdefault(kind, []).append(f"{name} (for {location})")
        if missing:
            lists = [
                f"{kind}{'s' if len(names) > 1 else ''} {', '.join(names)}"
                for kind, names in missing.items()
            ]
            raise ConfigurationError(
                f"the mesh lacks what the rig needs: {'; '.join(lists)}",
                found=f"a mesh of {', '.join(part.name for part in mesh.parts)}",
                advice="Say where they are, in [feature_points], [points], [regions] or [parts].",
            )
        upper, lower = (mesh.feature_points.get(name) for name in ("2.2", "2.3"))
        if upper is not None and upper == lower:
            raise ConfigurationError(
                "the feature points 2.2 and 2.3 are one vertex, but upper and lower lip are two "
                "sheets",
                found=f"vertex {upper}",
                advice="Cut the mesh open between the lips, from corner to corner.",
            )

    def _list_needs(self, mesh: Mesh) -> dict[tuple[str, str], str]:
        """Kind and name of what must be on the mesh → the first setting that needs it."""
        uses: list[tuple[str, Sequence[str], str]] = [
            ("feature point", ("8.3", "8.4"), "mouth_width")
        ]
        for name, weight in self.weights.items():
            centre = () if weight.centre is None else weight.centre.at
            uses.append(("part", (weight.on,), f"weights.{name}.on"))
            uses.append(("feature point", centre, f"weights.{name}.centre"))
            for i, constraint in enumerate(weight.values):
                limits = (constraint.below, constraint.above, constraint.behind)
                points = [name for point in limits if point is not None for name in point.at]
                location = f"weights.{name}.values.{i}"
                uses.append(("region", constraint.regions, location))
                uses.append(("feature point", (*constraint.feature_points, *points), location))
        for i, transform in enumerate(self.transforms):
            centre = () if transform.centre is None else transform.centre.at
            uses.append(("feature point", centre, f"transforms.{i}.centre"))
        for follower, leader in self.follow.items():
            if mesh.has_region(follower):
                uses.append(("region", (leader,), f"follow.{follower}"))
        needs: dict[tuple[str, str], str] = {}
        for kind, names, location in uses:
            for name in names:
                point = self.points.get(name) if kind == "feature point" else None
                for other in (name,) if point is None else point.at:
                    needs.setdefault((kind, other), location if point is None else f"points.{name}")
        return needs

    def label_mesh(self, mesh: Mesh) -> Mesh:
        """Return a mesh with the parts, feature points and regions of this file.

        Parameters
        ----------
        mesh
            The mesh.

        Returns
        -------
        Mesh
            The same one, named.

        Raises
        ------
        ConfigurationError
            If one of them is not on the mesh, with its location in the file.
        """
        parts = self._rename_parts(mesh)
        points = dict(mesh.feature_points)
        extent = float(np.ptp(mesh.vertices, axis=0).max())
        for name, where in self.feature_points.items():
            with add_location(f"feature_points.{name}"):
                if isinstance(where, int):
                    check_vertex(where, mesh)
                    points[name] = where
                    continue
                distance = np.linalg.norm(mesh.vertices - np.asarray(where), axis=1)
                points[name] = int(np.argmin(distance))
                if distance[points[name]] > _NEAR_THE_MESH * extent:
                    raise ConfigurationError(
                        "the position is not on the mesh",
                        found=f"{distance[points[name]]:.3g} mm from the nearest vertex",
                        advice="Give it in mm, after scale and axes are applied.",
                    )
        regions = dict(mesh.regions)
        bare = Mesh(mesh.vertices, mesh.triangles, parts, regions, points, mesh.colours)
        for name, region in self.regions.items():
            with add_location(f"regions.{name}"):
                regions[name] = region.find_vertices(bare)
                if regions[name].size == 0:
                    raise ConfigurationError("the region holds no vertex")
        return Mesh(mesh.vertices, mesh.triangles, parts, regions, points, mesh.colours)

    def _rename_parts(self, mesh: Mesh) -> tuple[Part, ...]:
        for name, theirs in self.parts.items():
            with add_location(f"parts.{name}"):
                mesh.get_part(theirs)
        new_names = {theirs: name for name, theirs in self.parts.items()}
        if len(mesh.parts) == 1 and not self.parts:
            new_names = {mesh.parts[0].name: "skin"}
        return tuple(
            Part(new_names.get(p.name, p.name), p.vertices, p.triangles, p.material)
            for p in mesh.parts
        )


def read_rig_file(path: str | Path) -> RigFile:
    """Read a rig file, or a shipped rig by its name.

    Parameters
    ----------
    path
        The file, or the name of a shipped rig, such as ``parke``.

    Returns
    -------
    RigFile
        With the tables of the rig that it extends.

    Raises
    ------
    FileFormatError
        If it cannot be read; a `MissingFileError` where there is none.
    ConfigurationError
        If it is not TOML, or contradicts itself; the message says where.
    """
    name = str(path)
    content = _read_content(name)
    rig_file = validate_settings(RigFile, content, name, _NOUN)
    if rig_file.extends is None:
        return rig_file
    if rig_file.extends not in list_shipped_rigs():
        raise ConfigurationError(
            "the rig file is wrong at extends: there is no shipped rig of that name",
            path=name,
            found=rig_file.extends,
            expected=f"one of {', '.join(list_shipped_rigs())}",
        )
    base = _read_content(rig_file.extends)
    tables = {"weights", "points", "follow"}
    # The transforms of the file are driven by its parameters.
    tables |= set() if "transforms" in content else {"parameters"}
    merged = {**base, **content}
    merged |= {key: {**base.get(key, {}), **content.get(key, {})} for key in tables}
    del merged["extends"]
    return validate_settings(RigFile, merged, name, _NOUN)


def _read_content(name: str) -> dict[str, Any]:
    content = read_toml(name, package=_PACKAGE, noun=_NOUN)
    points = content.get("feature_points")
    if isinstance(points, dict):
        # TOML reads 8.3 = 17 as a table 8 that holds 3 = 17.
        content["feature_points"] = {
            f"{group}.{key}" if isinstance(value, dict) else group: item
            for group, value in points.items()
            for key, item in (value.items() if isinstance(value, dict) else [("", value)])
        }
    return content


def list_shipped_rigs() -> tuple[str, ...]:
    """Return the names of the rigs that come with the package.

    Returns
    -------
    tuple of str
        Such as ``("parke",)``.
    """
    return list_shipped(_PACKAGE)
