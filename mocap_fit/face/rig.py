"""Rigs: from face parameters to the vertices of a mesh.

A rig is anything that follows the `Rig` protocol. One that can be written as ordered weighted
translations, rotations and scalings and linear fields says so by `compile`, and the fitting
kernel then evaluates only the vertices it needs; one that cannot is called back, slower, with
the same answers.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mocap_fit.errors import DataError
from mocap_fit.face.mesh import IndexArray, Mesh
from mocap_fit.registry import Registry
from mocap_fit.tracks import FloatArray

RIGS = Registry("mocap_fit.rigs", "rig")


class Kind(IntEnum):
    """What one operation of a compiled rig does to a vertex ``x`` at the parameter ``y``.

    ``w`` is the vertex's weight, ``v`` the operation's vector and ``c`` its centre.
    """

    TRANSLATION = 0  # x + y w v
    ROTATION = 1  # c + R(y w v) (x - c), v a rotation vector in radians
    SCALING = 2  # c + (1 + y w v) (x - c), coordinate by coordinate
    FIELD = 3  # x + y f, f the displacement of the vertex


@dataclass(frozen=True, eq=False, repr=False)
class CompiledRig:
    """A rig as plain arrays, for some vertices: the one form that the kernels read.

    Operations apply in order. All arrays are C-contiguous.

    Parameters
    ----------
    vertex_ids
        Which vertices of the mesh these are, ``(vertices,)``.
    rest
        Positions at rest, ``(vertices, 3)``, millimetres.
    kinds
        A `Kind` for each operation, ``(operations,)``.
    parameters
        Index of the parameter that drives each operation, ``(operations,)``.
    weights
        Share of each vertex in each operation, ``(operations, vertices)``, no unit; not read by
        fields.
    vectors
        Of each operation, ``(operations, 3)``: a displacement in millimetres, a rotation vector in
        radians, or what is added to the scale.
    centres
        The point of each rotation and scaling that stays, ``(operations, 3)``, millimetres.
    fields
        Displacements at parameter 1, ``(operations, vertices, 3)``, millimetres; read by fields
        alone, and of length 0 along the first axis when there are none.
    parameter_count
        Number of parameters of the rig.
    """

    vertex_ids: IndexArray
    rest: FloatArray
    kinds: NDArray[np.int64]
    parameters: NDArray[np.int64]
    weights: FloatArray
    vectors: FloatArray
    centres: FloatArray
    fields: FloatArray
    parameter_count: int

    def __repr__(self) -> str:
        return (
            f"CompiledRig({self.parameter_count} parameters, {len(self.kinds)} operations, "
            f"{len(self.rest)} vertices)"
        )

    def take(self, vertex_ids: IndexArray) -> CompiledRig:
        """Return the same rig for some of its vertices.

        Parameters
        ----------
        vertex_ids
            Their positions in this rig's `vertex_ids`, ``(vertices,)``.

        Returns
        -------
        CompiledRig
            The rig for those vertices, in that order.
        """
        return CompiledRig(
            np.ascontiguousarray(self.vertex_ids[vertex_ids]),
            np.ascontiguousarray(self.rest[vertex_ids]),
            self.kinds,
            self.parameters,
            np.ascontiguousarray(self.weights[:, vertex_ids]),
            self.vectors,
            self.centres,
            np.ascontiguousarray(self.fields[:, vertex_ids]),
            self.parameter_count,
        )


class Rig(Protocol):
    """The protocol of rigs: from parameters to the vertices of a mesh."""

    @property
    def mesh(self) -> Mesh:
        """The mesh at rest."""

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """The names of the parameters, in order."""

    @property
    def bounds(self) -> FloatArray:
        """Lower and upper bounds, ``(parameters, 2)``; 0 is rest, 1 the full gesture."""

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

    def compile(self, vertex_ids: IndexArray) -> CompiledRig | None:
        """Return the rig as plain arrays for some vertices.

        Parameters
        ----------
        vertex_ids
            Vertices of the mesh, ``(vertices,)``.

        Returns
        -------
        CompiledRig or None
            None where the rig cannot be written as ordered operations.
        """


def check_parameters(values: ArrayLike, names: tuple[str, ...]) -> FloatArray:
    """Check values of the parameters.

    Parameters
    ----------
    values
        The values, ``(parameters,)``, full gestures.
    names
        Names of the parameters, in order.

    Returns
    -------
    ndarray
        The values as float64, ``(parameters,)``.

    Raises
    ------
    DataError
        If their number is wrong or one is not finite.
    """
    array = np.asarray(values, dtype=np.float64)
    if array.shape != (len(names),):
        raise DataError(
            "the number of face parameters is wrong",
            found=array.shape,
            expected=f"({len(names)},): {', '.join(names)}",
        )
    if not np.isfinite(array).all():
        wrong = int(np.argmin(np.isfinite(array)))
        raise DataError(
            f"the face parameter {names[wrong]} is not a finite number", found=array[wrong]
        )
    return array


def to_parameters(values: Mapping[str, float], names: tuple[str, ...]) -> FloatArray:
    """Arrange values by name in the order of the parameters.

    Parameters
    ----------
    values
        Parameter → value, full gestures; those that are not named are 0.
    names
        Names of the parameters, in order.

    Returns
    -------
    ndarray
        The values, ``(parameters,)``.

    Raises
    ------
    DataError
        If a name is not a parameter's.
    """
    unknown = [name for name in values if name not in names]
    if unknown:
        raise DataError(
            f"there is no face parameter {', '.join(unknown)}",
            expected=f"some of {', '.join(names)}",
        )
    return check_parameters([float(values.get(name, 0.0)) for name in names], names)


def deform_points(rig: Rig, vertices: IndexArray, values: FloatArray) -> FloatArray:
    """Return some vertices of a deformed mesh, frame by frame.

    Parameters
    ----------
    rig
        The rig.
    vertices
        Indices of the vertices, ``(vertices,)``.
    values
        Values of the parameters, ``(frames, parameters)``: 0 is rest, 1 the full gesture.

    Returns
    -------
    ndarray
        Positions, ``(frames, vertices, 3)``, millimetres; NaN where a parameter is.
    """
    compiled = rig.compile(vertices)
    points = np.full((len(values), len(vertices), 3), np.nan)
    finite = np.isfinite(values).all(axis=1)
    if compiled is not None:
        points[finite] = evaluate(compiled, values[finite])
    else:
        for i in np.flatnonzero(finite):
            points[i] = rig.deform(values[i])[vertices]
    return points


def evaluate(compiled: CompiledRig, parameters: FloatArray) -> FloatArray:
    """Compute the vertices of a compiled rig, in plain numpy.

    Parameters
    ----------
    compiled
        The rig, for some vertices.
    parameters
        Values, ``(..., parameters)``, of one frame or of several: 0 is rest, 1 the full gesture.

    Returns
    -------
    ndarray
        Positions, ``(..., vertices, 3)``, millimetres.
    """
    vertices = np.tile(compiled.rest, (*parameters.shape[:-1], 1, 1))
    for operation, kind in enumerate(compiled.kinds):
        value = parameters[..., compiled.parameters[operation], None, None]
        if not value.any():
            continue
        if kind == Kind.FIELD:
            vertices += value * compiled.fields[operation]
            continue
        # Most operations move a small part of a face.
        moved = np.flatnonzero(compiled.weights[operation])
        amount = value * compiled.weights[operation, moved, None]
        vector, centre = compiled.vectors[operation], compiled.centres[operation]
        if kind == Kind.TRANSLATION:
            vertices[..., moved, :] += amount * vector
        elif kind == Kind.SCALING:
            vertices[..., moved, :] += amount * vector * (vertices[..., moved, :] - centre)
        else:
            vertices[..., moved, :] += _turn(vertices[..., moved, :] - centre, vector, amount)
    return vertices


def evaluate_jacobian(
    compiled: CompiledRig, parameters: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Compute the vertices of a compiled rig and their derivative, in plain numpy.

    Parameters
    ----------
    compiled
        The rig, for some vertices.
    parameters
        Values, ``(..., parameters)``, of one frame or of several: 0 is rest, 1 the full gesture.

    Returns
    -------
    vertices
        Positions, ``(..., vertices, 3)``, millimetres.
    jacobian
        Derivative by the parameters, ``(..., vertices, 3, parameters)``, millimetres a full
        gesture.

    Notes
    -----
    Derivatives are carried forward through the operations: each moves those that came before as
    it moves the vertex, and adds its derivative.
    """
    vertices = np.tile(compiled.rest, (*parameters.shape[:-1], 1, 1))
    jacobian = np.zeros((compiled.parameter_count, *vertices.shape))
    for operation, kind in enumerate(compiled.kinds):
        index = compiled.parameters[operation]
        value = parameters[..., index, None, None]
        vector = compiled.vectors[operation]
        centre = compiled.centres[operation]
        weight = compiled.weights[operation, :, None]
        if kind == Kind.TRANSLATION:
            vertices += value * weight * vector
            jacobian[index] += weight * vector
        elif kind == Kind.FIELD:
            vertices += value * compiled.fields[operation]
            jacobian[index] += compiled.fields[operation]
        elif kind == Kind.SCALING:
            slope = weight * vector * (vertices - centre)
            vertices += value * slope
            jacobian *= 1.0 + value * weight * vector
            jacobian[index] += slope
        else:
            vertices += _turn(vertices - centre, vector, value * weight)
            jacobian += _turn(jacobian, vector, value * weight)
            jacobian[index] += weight * np.cross(vector, vertices - centre)
    return vertices, np.moveaxis(jacobian, 0, -1)


def _turn(points: FloatArray, vector: FloatArray, amounts: FloatArray) -> FloatArray:
    """Return how far `amounts` times a rotation vector moves points (Rodrigues' formula).

    The displacement, not the position, so that a vertex of no weight stays where it is to the bit.
    """
    angle = float(np.linalg.norm(vector))
    if angle == 0.0:
        return np.zeros_like(points)
    axis = vector / angle
    across = points - np.sum(points * axis, axis=-1, keepdims=True) * axis
    sine, half = np.sin(amounts * angle), np.sin(amounts * angle / 2)
    return np.asarray(sine * np.cross(axis, points) - 2.0 * half * half * across)
