"""Weights over a mesh: how much of a transform each vertex takes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import splu

from mocap_fit.errors import ConfigurationError
from mocap_fit.face.mesh import IndexArray
from mocap_fit.tracks import FloatArray


def falloff(
    vertices: FloatArray, centre: FloatArray, radii: FloatArray, plateau: float = 0.0
) -> FloatArray:
    """Weights that fall smoothly from 1 round a centre to 0 on an ellipsoid round it.

    Parameters
    ----------
    vertices
        `(vertices, 3)`, millimetres.
    centre, radii
        `(3,)`, millimetres; radii along x, y and z.
    plateau
        Part of the radius, from 0 to below 1, within which the weight is 1.

    Returns
    -------
    FloatArray
        `(vertices,)`, a cubic smoothstep of the normalised distance.
    """
    distance = np.linalg.norm((vertices - centre) / radii, axis=1)
    rest = np.clip((1.0 - distance) / (1.0 - plateau), 0.0, 1.0)
    return np.asarray(rest * rest * (3.0 - 2.0 * rest))


@dataclass(frozen=True, eq=False)
class BendingEnergy:
    """What it costs a field on a mesh to be bent; fields of least cost make good weights.

    Parameters
    ----------
    matrix
        `(vertices, vertices)`, symmetric: the squared cotangent Laplacian.
    pieces
        `(vertices,)`: which connected piece of the mesh each vertex is on.
    """

    matrix: sparse.csr_matrix
    pieces: NDArray[np.int32]

    @classmethod
    def of(cls, vertices: FloatArray, triangles: IndexArray) -> BendingEnergy:
        """Of the mesh of `(vertices, 3)` and `(triangles, 3)`."""
        laplacian, areas = _laplacian(vertices, triangles)
        matrix = laplacian.T @ sparse.diags(1.0 / areas) @ laplacian
        return cls(matrix.tocsr(), connected_components(laplacian, directed=False)[1])

    def least(self, known: IndexArray, values: FloatArray) -> FloatArray:
        """The field that takes given values at some vertices and costs least between.

        Parameters are `known` and `values` of `interpolated`, and so is the result.
        """
        reached = np.isin(self.pieces, self.pieces[known])
        free = reached.copy()
        free[known] = False
        field = np.zeros(len(free))
        field[known] = values
        free_ids = np.flatnonzero(free)
        if free_ids.size:
            rows = self.matrix[free_ids]
            # The matrix is symmetric and positive definite: no pivoting, and an order of
            # elimination that keeps its symmetry, take a third of the time.
            solver = splu(
                rows[:, free_ids].tocsc(),
                permc_spec="MMD_AT_PLUS_A",
                diag_pivot_thresh=0.0,
                options={"SymmetricMode": True},
            )
            field[free_ids] = solver.solve(-(rows[:, known] @ values))
        return np.clip(field, 0.0, 1.0)


def interpolated(
    vertices: FloatArray, triangles: IndexArray, known: IndexArray, values: FloatArray
) -> FloatArray:
    """Weights that take given values at some vertices and are as smooth as can be between.

    The bending energy of the field (its squared Laplacian) is least, so that there is no crease
    at the known vertices; the answer follows the surface, so the two lips, which touch at rest
    but are far apart along the skin, do not bleed into each other.

    Parameters
    ----------
    vertices, triangles
        The mesh: `(vertices, 3)` and `(triangles, 3)`.
    known
        `(known,)`, vertex indices, each once.
    values
        `(known,)`, their values, within [0, 1].

    Returns
    -------
    FloatArray
        `(vertices,)`, clipped to [0, 1]; 0 on the pieces of the mesh with no known vertex.

    Raises
    ------
    ConfigurationError
        If no vertex is known.
    """
    if len(known) == 0:
        raise ConfigurationError("a weight field has no vertex of known value")
    return BendingEnergy.of(vertices, triangles).least(known, values)


def _laplacian(vertices: FloatArray, triangles: IndexArray) -> tuple[sparse.csr_matrix, FloatArray]:
    """The cotangent Laplacian of the mesh, and a third of the area round every vertex."""
    count = len(vertices)
    areas = np.zeros(count)
    rows, columns, entries = [], [], []
    for corner in range(3):
        here = triangles[:, corner]
        one, other = triangles[:, (corner + 1) % 3], triangles[:, (corner + 2) % 3]
        edge, side = vertices[one] - vertices[here], vertices[other] - vertices[here]
        double_area = np.linalg.norm(np.cross(edge, side), axis=1)
        # Slivers have huge cotangents, obtuse corners negative ones: both spoil the field.
        cotangent = np.clip(
            np.sum(edge * side, axis=1) / np.maximum(double_area, 1e-12), 0.05, 20.0
        )
        rows += [one, other]
        columns += [other, one]
        entries += [cotangent / 2, cotangent / 2]
        np.add.at(areas, here, double_area / 6)
    adjacency = sparse.csr_matrix(
        (np.concatenate(entries), (np.concatenate(rows), np.concatenate(columns))),
        shape=(count, count),
    )
    degree = np.asarray(adjacency.sum(axis=1)).ravel()
    return sparse.diags(degree) - adjacency, np.maximum(areas, areas[areas > 0].min())
