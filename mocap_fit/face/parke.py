"""Parke's rig: ordered weighted translations, rotations and scalings of a mesh.

Beskow (section 2) after Parke (1982): each face parameter drives geometrical transforms, and each
vertex takes a share of them. Shares and transforms are stated in a rig file (`rig_file.py`) in
terms of MPEG-4 feature points and named regions, so that one file serves any mesh that has them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import cKDTree

from mocap_fit.errors import ConfigurationError
from mocap_fit.face.mesh import IndexArray, Mesh
from mocap_fit.face.rig import CompiledRig, Kind, check_parameters, evaluate, evaluate_jacobian
from mocap_fit.face.rig_tables import add_location
from mocap_fit.face.weights import BendingEnergy, compute_falloff
from mocap_fit.tracks import FloatArray

if TYPE_CHECKING:
    from mocap_fit.face.rig_file import RigFile
    from mocap_fit.face.rig_tables import Locations, Transform, Weight


@dataclass(frozen=True, eq=False, repr=False)
class ParkeRig:
    """A mesh moved by ordered weighted transforms.

    Parameters
    ----------
    mesh
        The face at rest.
    parameter_names
        Names of the parameters, in order.
    bounds
        Lower and upper bound of each, ``(parameters, 2)``, full gestures.
    compiled
        The transforms, for every vertex of the mesh.
    """

    mesh: Mesh
    parameter_names: tuple[str, ...]
    bounds: FloatArray
    compiled: CompiledRig

    def __repr__(self) -> str:
        return (
            f"ParkeRig({len(self.parameter_names)} parameters, {len(self.compiled.kinds)} "
            f"transforms, {len(self.mesh.vertices)} vertices)"
        )

    @classmethod
    def from_file(cls, rig_file: RigFile, mesh: Mesh) -> ParkeRig:
        """Put a rig file's transforms on a mesh.

        Parameters
        ----------
        rig_file
            Parameters, weights and transforms.
        mesh
            The face at rest, with the names that the file refers to.

        Returns
        -------
        ParkeRig
            The rig.

        Raises
        ------
        ConfigurationError
            If the mesh lacks a region, part or feature point that the file names, or a transform
            does nothing.
        """
        names, transforms = tuple(rig_file.parameters), rig_file.transforms
        if not names or not transforms:
            raise ConfigurationError(
                "the rig file has no parameters or no transforms",
                advice='Add them, or take the shipped ones with extends = "parke".',
            )
        rig_file.check_mesh(mesh)
        scales = rig_file.compute_scales(mesh)
        locations = rig_file.locate_points(mesh, scales)
        weights = _compute_weights(rig_file, mesh, scales, locations)
        count = len(transforms)
        kinds = np.zeros(count, dtype=np.int64)
        vectors, centres = np.zeros((count, 3)), np.zeros((count, 3))
        shares = np.zeros((count, len(mesh.vertices)))
        for i, transform in enumerate(transforms):
            kinds[i], vectors[i] = _to_operation(transform, scales)
            if transform.centre is not None:
                centres[i] = transform.centre.locate(mesh, scales, locations)
            shares[i] = weights[transform.weight]
            if not shares[i].any() or not vectors[i].any():
                with add_location(f"transforms.{i}"):
                    raise ConfigurationError(
                        f"it moves nothing, though '{transform.parameter}' drives it",
                        advice=f"Check its amount, and the weight '{transform.weight}'.",
                    )
        compiled = CompiledRig(
            vertex_ids=np.arange(len(mesh.vertices)),
            rest=mesh.vertices,
            kinds=kinds,
            parameters=np.array([names.index(t.parameter) for t in transforms], dtype=np.int64),
            weights=shares,
            vectors=vectors,
            centres=centres,
            fields=np.zeros((0, len(mesh.vertices), 3)),
            parameter_count=len(names),
        )
        bounds = np.array([rig_file.parameters[name] for name in names], dtype=np.float64)
        return cls(mesh, names, bounds, compiled)

    def deform(self, parameters: ArrayLike) -> FloatArray:
        """Move the vertices.

        Parameters
        ----------
        parameters
            Values, ``(parameters,)``: 0 is rest, 1 the full gesture.

        Returns
        -------
        ndarray
            Positions, ``(vertices, 3)``, millimetres.
        """
        return evaluate(self.compiled, check_parameters(parameters, self.parameter_names))

    def jacobian(self, parameters: ArrayLike) -> FloatArray:
        """Compute the derivative of the vertices by the parameters.

        Parameters
        ----------
        parameters
            Values, ``(parameters,)``: 0 is rest, 1 the full gesture.

        Returns
        -------
        ndarray
            ``(vertices, 3, parameters)``, millimetres a full gesture.
        """
        values = check_parameters(parameters, self.parameter_names)
        return evaluate_jacobian(self.compiled, values)[1]

    def compile(self, vertex_ids: IndexArray) -> CompiledRig:
        """Return the rig as plain arrays for some vertices.

        Parameters
        ----------
        vertex_ids
            Vertices of the mesh, ``(vertices,)``.

        Returns
        -------
        CompiledRig
            The transforms, for those vertices.
        """
        return self.compiled.take(np.asarray(vertex_ids))


def _to_operation(transform: Transform, scales: FloatArray) -> tuple[Kind, FloatArray]:
    if transform.kind == "translation":
        return Kind.TRANSLATION, scales * np.asarray(transform.by)
    if transform.kind == "scaling":
        return Kind.SCALING, np.asarray(transform.factors)
    axis = np.asarray(transform.axis, dtype=np.float64)
    turn = np.radians(float(transform.degrees or 0.0))
    return Kind.ROTATION, axis / np.linalg.norm(axis) * turn


def _compute_weights(
    rig_file: RigFile, mesh: Mesh, scales: FloatArray, locations: Locations
) -> dict[str, FloatArray]:
    weights: dict[str, FloatArray] = {}
    bending: dict[str, BendingEnergy] = {}
    for name, weight in rig_file.weights.items():
        with add_location(f"weights.{name}"):
            share = _compute_on_part(weight, mesh, scales, locations, bending)
        for other, inverted in weight.list_factors():
            share = share * (1.0 - weights[other] if inverted else weights[other])
        for part, value in weight.parts.items():
            if mesh.has_region(part):
                share[mesh.get_region(part)] = value
        weights[name] = share
    for follower, leader in rig_file.follow.items():
        if not mesh.has_region(follower):
            continue
        followers, leaders = mesh.get_region(follower), mesh.get_region(leader)
        _, nearest = cKDTree(mesh.vertices[leaders]).query(mesh.vertices[followers])
        for share in weights.values():
            share[followers] = share[leaders[nearest]]
    return weights


def _compute_on_part(
    weight: Weight,
    mesh: Mesh,
    scales: FloatArray,
    locations: Locations,
    bending: dict[str, BendingEnergy],
) -> FloatArray:
    """Compute a weight on its part alone: other parts get theirs later, or follow."""
    part = mesh.get_part(weight.on)
    vertices = slice(part.vertices.start, part.vertices.stop)
    share = np.zeros(len(mesh.vertices))
    if weight.centre is not None:
        share[vertices] = compute_falloff(
            mesh.vertices[vertices],
            weight.centre.locate(mesh, scales, locations),
            scales * np.asarray(weight.radii, dtype=np.float64),
            weight.plateau,
        )
        return share
    totals, counts = np.zeros(len(mesh.vertices)), np.zeros(len(mesh.vertices))
    for constraint in weight.values:
        members = constraint.find_vertices(mesh, scales, locations)
        totals[members] += constraint.value
        counts[members] += 1
    known = np.flatnonzero(counts[vertices])
    if known.size == 0:
        raise ConfigurationError(
            f"no vertex of the part '{weight.on}' has a value",
            advice="Name regions or feature points that the mesh has there.",
        )
    # A vertex in two regions, such as a corner of the mouth in both lips, takes the mean.
    values = totals[vertices][known] / counts[vertices][known]
    if weight.on not in bending:
        triangles = mesh.triangles[part.triangles.start : part.triangles.stop]
        bending[weight.on] = BendingEnergy.from_mesh(
            mesh.vertices[vertices], triangles - vertices.start
        )
    share[vertices] = bending[weight.on].minimise(known, values)
    return share
