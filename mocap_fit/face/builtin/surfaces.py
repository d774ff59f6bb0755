"""Pieces of surface, and the small shapes that anatomy is modelled with."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mocap_fit.face.mesh import IndexArray
from mocap_fit.tracks import FloatArray

MIRROR = np.array([-1.0, 1.0, 1.0])
Colour = tuple[float, float, float]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Piece:
    """A piece of coloured surface.

    Parameters
    ----------
    vertices
        `(vertices, 3)`, mm.
    triangles
        `(triangles, 3)`, counter-clockwise seen from outside.
    colours
        `(vertices, 3)`, red, green and blue in [0, 1].
    """

    vertices: FloatArray
    triangles: IndexArray
    colours: FloatArray

    def mirrored(self) -> Piece:
        """The same piece on the other side of the face."""
        return Piece(self.vertices * MIRROR, self.triangles[:, ::-1], self.colours)


def painted(vertices: FloatArray, triangles: IndexArray, colour: Colour) -> Piece:
    """A piece of one colour."""
    return Piece(
        vertices, triangles, np.tile(np.asarray(colour, dtype=np.float64), (len(vertices), 1))
    )


def joined(pieces: Sequence[Piece]) -> Piece:
    """Several pieces as one; nothing is welded."""
    starts = np.cumsum([0, *(len(piece.vertices) for piece in pieces[:-1])])
    return Piece(
        np.concatenate([piece.vertices for piece in pieces]),
        np.concatenate(
            [piece.triangles + start for piece, start in zip(pieces, starts, strict=True)]
        ),
        np.concatenate([piece.colours for piece in pieces]),
    )


def grid_triangles(rows: int, columns: int, *, closed_rows: bool = False) -> IndexArray:
    """Triangles of a grid of vertices stored row by row.

    Seen from the side where the rows run up and the columns run to the left, the triangles are
    counter-clockwise. With `closed_rows` the last row is joined to the first.
    """
    last_row = rows if closed_rows else rows - 1
    row, column = np.meshgrid(np.arange(last_row), np.arange(columns - 1), indexing="ij")
    here = (row * columns + column).ravel()
    above = (((row + 1) % rows) * columns + column).ravel()
    return np.concatenate(
        [np.stack([here, above, above + 1], axis=1), np.stack([here, above + 1, here + 1], axis=1)]
    )


def strip_triangles(outer: IndexArray, inner: IndexArray, *, closed: bool = True) -> IndexArray:
    """Triangles between two rings of equally many vertices, `outer` counter-clockwise."""
    if closed:
        next_outer, next_inner = np.roll(outer, -1), np.roll(inner, -1)
    else:
        outer, next_outer = outer[:-1], outer[1:]
        inner, next_inner = inner[:-1], inner[1:]
    return np.concatenate(
        [
            np.stack([outer, next_outer, next_inner], axis=1),
            np.stack([outer, next_inner, inner], axis=1),
        ]
    )


def fan_triangles(ring: IndexArray, centre: int, *, closed: bool = True) -> IndexArray:
    """Triangles that close a counter-clockwise ring with one vertex."""
    following = np.roll(ring, -1) if closed else ring[1:]
    ring = ring if closed else ring[:-1]
    return np.stack([ring, following, np.full(len(ring), centre)], axis=1)


def edges_of(triangles: IndexArray) -> IndexArray:
    """Every edge once, `(edges, 2)`, the smaller index first."""
    pairs = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    return np.unique(np.sort(pairs, axis=1), axis=0)


def smoothed(
    vertices: FloatArray, triangles: IndexArray, strength: FloatArray, rounds: int
) -> FloatArray:
    """Vertices moved towards the mean of their neighbours, each by its own strength in [0, 1]."""
    from scipy.sparse import coo_matrix

    edges = edges_of(triangles)
    rows, columns = np.concatenate([edges, edges[:, ::-1]]).T
    count = len(vertices)
    adjacency = coo_matrix((np.ones(len(rows)), (rows, columns)), shape=(count, count)).tocsr()
    neighbours = np.maximum(np.asarray(adjacency.sum(axis=1)), 1)
    moved = vertices.copy()
    for _ in range(rounds):
        moved += strength[:, None] * (adjacency @ moved / neighbours - moved)
    return moved


def smoothstep(value: FloatArray) -> FloatArray:
    """0 below 0, 1 above 1, and a cubic with level ends between."""
    clipped = np.clip(value, 0.0, 1.0)
    return np.asarray(clipped * clipped * (3.0 - 2.0 * clipped))


def bump(
    x: FloatArray,
    y: FloatArray,
    centre: tuple[float, float],
    widths: tuple[float, float],
    turn: float = 0.0,
) -> FloatArray:
    """A Gaussian hill of height 1 over the plane, its axes turned by `turn` radians."""
    across, along = x - centre[0], y - centre[1]
    cosine, sine = np.cos(turn), np.sin(turn)
    first = (cosine * across + sine * along) / widths[0]
    second = (cosine * along - sine * across) / widths[1]
    return np.asarray(np.exp(-0.5 * (first**2 + second**2)))


def hill(value: FloatArray, centre: float, width: float) -> FloatArray:
    """A Gaussian hill of height 1 over a line."""
    return np.asarray(np.exp(-0.5 * ((value - centre) / width) ** 2))


def distance_to_path(
    x: FloatArray, y: FloatArray, path: Sequence[tuple[float, float]]
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """How far points are from a path of straight pieces.

    Returns
    -------
    tuple
        Distance; +1 on the lateral side of a path that runs down the left half of the face, -1
        on the medial side; position along the path, 0 to 1.
    """
    start = np.asarray(path[:-1], dtype=np.float64)
    step = np.diff(np.asarray(path, dtype=np.float64), axis=0)
    across, along = x[:, None] - start[:, 0], y[:, None] - start[:, 1]
    position = np.clip((across * step[:, 0] + along * step[:, 1]) / (step**2).sum(axis=1), 0.0, 1.0)
    distance = np.hypot(across - position * step[:, 0], along - position * step[:, 1])
    nearest = distance.argmin(axis=1)
    rows = np.arange(len(x))
    side = np.sign(step[:, 0] * along - step[:, 1] * across)[rows, nearest]
    return (
        distance[rows, nearest],
        side,
        (nearest + position[rows, nearest]) / len(step),
    )
