"""Weights over a mesh: how much of a transform each vertex takes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import splu

from mocap_fit.face.mesh import IndexArray
from mocap_fit.tracks import FloatArray


def compute_falloff(
    vertices: FloatArray, centre: FloatArray, radii: FloatArray, plateau: float = 0.0
) -> FloatArray:
    """Compute weights that fall smoothly from 1 round a centre to 0 on an ellipsoid round it.

    Parameters
    ----------
    vertices
        Positions, ``(vertices, 3)``, millimetres.
    centre
        ``(3,)``, millimetres.
    radii
        Radii of the ellipsoid along x, y and z, ``(3,)``, millimetres.
    plateau
        Part of the radius within which the weight is 1, 0 to below 1.

    Returns
    -------
    ndarray
        ``(vertices,)``, 0 to 1: a cubic smoothstep of the normalised distance.
    """
    distance = np.linalg.norm((vertices - centre) / radii, axis=1)
    rest = np.clip((1.0 - distance) / (1.0 - plateau), 0.0, 1.0)
    return np.asarray(rest * rest * (3.0 - 2.0 * rest))


@dataclass(frozen=True, eq=False)
class BendingEnergy:
    """The energy of bending a field on a mesh; fields of least energy make good weights.

    The energy is the field's squared Laplacian, so that there is no crease at vertices of known
    value; a field of least energy follows the surface, so the two lips, which touch at rest but are
    far apart along the skin, do not bleed into each other.

    Parameters
    ----------
    matrix
        The squared cotangent Laplacian, ``(vertices, vertices)``, symmetric.
    pieces
        Which connected piece of the mesh each vertex is on, ``(vertices,)``.
    """

    matrix: sparse.csr_matrix
    pieces: NDArray[np.int32]

    @classmethod
    def from_mesh(cls, vertices: FloatArray, triangles: IndexArray) -> BendingEnergy:
        """Compute the energy of a mesh.

        Parameters
        ----------
        vertices
            Positions, ``(vertices, 3)``, millimetres.
        triangles
            Vertex indices, ``(triangles, 3)``.

        Returns
        -------
        BendingEnergy
            The energy.
        """
        laplacian, areas = _compute_laplacian(vertices, triangles)
        matrix = laplacian.T @ sparse.diags(1.0 / areas) @ laplacian
        return cls(matrix.tocsr(), connected_components(laplacian)[1])

    def minimise(self, known: IndexArray, values: FloatArray) -> FloatArray:
        """Compute the field of least energy with known values at some vertices.

        Parameters
        ----------
        known
            Vertex indices, ``(known,)``, each once.
        values
            Their values, ``(known,)``, 0 to 1.

        Returns
        -------
        ndarray
            ``(vertices,)``, clipped to 0 to 1; 0 on the pieces of the mesh with no known vertex.
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


def _compute_laplacian(
    vertices: FloatArray, triangles: IndexArray
) -> tuple[sparse.csr_matrix, FloatArray]:
    """Return the cotangent Laplacian, and a third of the area round every vertex."""
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
