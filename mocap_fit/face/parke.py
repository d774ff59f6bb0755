"""Parke's rig: ordered weighted translations, rotations and scalings of a mesh.

Beskow (section 2) after Parke (1982): each face parameter drives geometrical transforms, and each
vertex takes a share of them. Shares and transforms are stated in a rig file (`rig_file.py`) in
terms of MPEG-4 feature points and named regions, so that one file serves any mesh that has them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import cKDTree

from mocap_fit.errors import ConfigurationError
from mocap_fit.face.mesh import IndexArray, Mesh
from mocap_fit.face.rig import (
    CompiledRig,
    Kind,
    checked_parameters,
    evaluate,
    evaluate_jacobian,
)
from mocap_fit.face.weights import falloff, interpolated
from mocap_fit.tracks import FloatArray

if TYPE_CHECKING:
    from mocap_fit.face.rig_file import RigFile, Transform, Weight


class ParkeRig:
    """A mesh moved by ordered weighted transforms.

    Parameters
    ----------
    mesh
        The face at rest.
    parameter_names
        Names of the parameters, in order.
    bounds
        `(parameters, 2)`.
    compiled
        The transforms, for every vertex of the mesh.
    """

    def __init__(
        self,
        mesh: Mesh,
        parameter_names: tuple[str, ...],
        bounds: FloatArray,
        compiled: CompiledRig,
    ) -> None:
        self.mesh = mesh
        self.parameter_names = parameter_names
        self.bounds = bounds
        self._compiled = compiled

    @classmethod
    def from_file(cls, rig_file: RigFile, mesh: Mesh) -> ParkeRig:
        """Put a rig file's transforms on a mesh.

        Raises
        ------
        ConfigurationError
            If the file names a region, part, feature point, weight or parameter that is not
            there, or a transform that does nothing.
        """
        names = tuple(rig_file.parameters)
        scale = rig_file.scale_on(mesh)
        weights = _weights(rig_file, mesh, scale)
        transforms = rig_file.transforms
        count = len(transforms)
        kinds = np.zeros(count, dtype=np.int64)
        vectors, centres = np.zeros((count, 3)), np.zeros((count, 3))
        shares = np.zeros((count, len(mesh.vertices)))
        for i, transform in enumerate(transforms):
            if transform.weight not in weights:
                raise ConfigurationError(
                    f"the transform {i + 1} of the rig, for '{transform.parameter}', names a "
                    f"weight '{transform.weight}' that is not there",
                    expected=f"one of {', '.join(weights)}",
                )
            kinds[i], vectors[i] = _kind_and_vector(transform, scale)
            if transform.centre is not None:
                centres[i] = transform.centre.position(mesh, scale)
            shares[i] = weights[transform.weight]
            if not shares[i].any() or not vectors[i].any():
                raise ConfigurationError(
                    f"the transform {i + 1} of the rig, for '{transform.parameter}', moves nothing",
                    advice="Check its weight's centre and radii, and its amount.",
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
        """Vertices, `(vertices, 3)` in millimetres, for `(parameters,)` values."""
        return evaluate(self._compiled, checked_parameters(parameters, self.parameter_names))

    def jacobian(self, parameters: ArrayLike) -> FloatArray:
        """Derivative of `deform`, `(vertices, 3, parameters)`, millimetres per unit."""
        values = checked_parameters(parameters, self.parameter_names)
        return evaluate_jacobian(self._compiled, values)[1]

    def compile(self, vertex_ids: IndexArray) -> CompiledRig:
        """Give the transforms as arrays, for those vertices."""
        return self._compiled.take(np.asarray(vertex_ids))


def _kind_and_vector(transform: Transform, scale: float) -> tuple[Kind, FloatArray]:
    if transform.kind == "translation":
        return Kind.TRANSLATION, scale * np.asarray(transform.by)
    if transform.kind == "scaling":
        return Kind.SCALING, np.asarray(transform.factors)
    axis = np.asarray(transform.axis, dtype=np.float64)
    return Kind.ROTATION, axis / np.linalg.norm(axis) * np.radians(transform.degrees)


def _weights(rig_file: RigFile, mesh: Mesh, scale: float) -> dict[str, FloatArray]:
    weights: dict[str, FloatArray] = {}
    for name, weight in rig_file.weights.items():
        share = _own_weight(name, weight, mesh, scale)
        for factor in weight.multiply:
            other = factor.removeprefix("1 - ")
            if other not in weights:
                raise ConfigurationError(
                    f"the weight '{name}' is multiplied by '{other}', which is not above it",
                    expected=f"one of {', '.join(weights) or 'none so far'}",
                )
            share = share * (weights[other] if factor == other else 1.0 - weights[other])
        for part, value in weight.parts.items():
            if mesh.has_region(part):
                share[mesh.region(part)] = value
        weights[name] = share
    for follower, leader in rig_file.follow.items():
        if not mesh.has_region(follower):
            continue
        followers, leaders = mesh.region(follower), mesh.region(leader)
        _, nearest = cKDTree(mesh.vertices[leaders]).query(mesh.vertices[followers])
        for share in weights.values():
            share[followers] = share[leaders[nearest]]
    return weights


def _own_weight(name: str, weight: Weight, mesh: Mesh, scale: float) -> FloatArray:
    """The weight of the skin alone: other parts are given theirs, or follow."""
    skin = mesh.part(weight.on)
    vertices = slice(skin.vertices.start, skin.vertices.stop)
    share = np.zeros(len(mesh.vertices))
    if weight.centre is not None and weight.radii is not None:
        centre = weight.centre.position(mesh, scale)
        share[vertices] = falloff(
            mesh.vertices[vertices],
            centre,
            scale * np.asarray(weight.radii, dtype=np.float64),
            weight.plateau,
        )
        return share
    totals, counts = np.zeros(len(mesh.vertices)), np.zeros(len(mesh.vertices))
    for constraint in weight.values:
        members = constraint.members(mesh)
        totals[members] += constraint.value
        counts[members] += 1
    known = np.flatnonzero(counts[vertices])
    if known.size == 0:
        raise ConfigurationError(f"the weight '{name}' of the rig has no value on any vertex")
    # A vertex in two regions, such as a corner of the mouth in both lips, takes the mean.
    values = totals[vertices][known] / counts[vertices][known]
    triangles = mesh.triangles[skin.triangles.start : skin.triangles.stop] - skin.vertices.start
    share[vertices] = interpolated(mesh.vertices[vertices], triangles, known, values)
    return share
