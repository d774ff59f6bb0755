"""Pieces of surface, and the small shapes that anatomy is modelled with."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mocap_fit.face.mesh import IndexArray, list_edges
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
        Positions, ``(vertices, 3)``, millimetres.
    triangles
        Vertex indices, ``(triangles, 3)``, counter-clockwise seen from outside.
    colours
        Red, green and blue, ``(vertices, 3)``, 0 to 1.
    """

    vertices: FloatArray
    triangles: IndexArray
    colours: FloatArray

    def mirror(self) -> Piece:
        """Return the same piece on the other side of the face.

        Returns
        -------
        Piece
            With x reversed.
        """
        return Piece(self.vertices * MIRROR, self.triangles[:, ::-1], self.colours)


def paint_piece(vertices: FloatArray, triangles: IndexArray, colour: Colour) -> Piece:
    """Make a piece of one colour.

    Parameters
    ----------
    vertices
        Positions, ``(vertices, 3)``, millimetres.
    triangles
        Vertex indices, ``(triangles, 3)``.
    colour
        Red, green and blue, 0 to 1.

    Returns
    -------
    Piece
        The piece.
    """
    return Piece(
        vertices, triangles, np.tile(np.asarray(colour, dtype=np.float64), (len(vertices), 1))
    )


def join_pieces(pieces: Sequence[Piece]) -> Piece:
    """Join several pieces to one; nothing is welded.

    Parameters
    ----------
    pieces
        The pieces.

    Returns
    -------
    Piece
        With the vertices in the order of the pieces.
    """
    starts = np.cumsum([0, *(len(piece.vertices) for piece in pieces[:-1])])
    return Piece(
        np.concatenate([piece.vertices for piece in pieces]),
        np.concatenate(
            [piece.triangles + start for piece, start in zip(pieces, starts, strict=True)]
        ),
        np.concatenate([piece.colours for piece in pieces]),
    )


def triangulate_strip(outer: IndexArray, inner: IndexArray, *, closed: bool = True) -> IndexArray:
    """Triangulate the strip between two rings of equally many vertices, or twice as many inside.

    Parameters
    ----------
    outer, inner
        Vertex indices of the rings, ``(points,)`` each; `outer` counter-clockwise. A closed inner
        one may have ``(2 × points,)``.
    closed
        Whether the last vertices are joined to the first.

    Returns
    -------
    ndarray
        Vertex indices, ``(triangles, 3)``.
    """
    if len(inner) == 2 * len(outer):
        following, middle = np.roll(outer, -1), inner[1::2]
        corners = [(outer, middle, inner[::2]), (outer, following, middle)]
        corners.append((following, np.roll(inner, -2)[::2], middle))
        return np.concatenate([np.stack(three, axis=1) for three in corners])
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


def triangulate_fan(ring: IndexArray, centre: int, *, closed: bool = True) -> IndexArray:
    """Triangulate a ring that one vertex closes.

    Parameters
    ----------
    ring
        Vertex indices, ``(points,)``, counter-clockwise.
    centre
        Index of the vertex that closes it.
    closed
        Whether the last vertex is joined to the first.

    Returns
    -------
    ndarray
        Vertex indices, ``(triangles, 3)``.
    """
    following = np.roll(ring, -1) if closed else ring[1:]
    ring = ring if closed else ring[:-1]
    return np.stack([ring, following, np.full(len(ring), centre)], axis=1)


def smooth_vertices(
    vertices: FloatArray, triangles: IndexArray, strength: FloatArray, rounds: int
) -> FloatArray:
    """Move vertices towards the mean of their neighbours.

    Parameters
    ----------
    vertices
        Positions, ``(vertices, 3)``, millimetres.
    triangles
        Vertex indices, ``(triangles, 3)``.
    strength
        Part of the way that each vertex moves, ``(vertices,)``, 0 to 1.
    rounds
        How many times.

    Returns
    -------
    ndarray
        ``(vertices, 3)``, millimetres.
    """
    from scipy.sparse import coo_matrix

    edges = list_edges(triangles)
    rows, columns = np.concatenate([edges, edges[:, ::-1]]).T
    count = len(vertices)
    adjacency = coo_matrix((np.ones(len(rows)), (rows, columns)), shape=(count, count)).tocsr()
    neighbours = np.maximum(np.asarray(adjacency.sum(axis=1)), 1)
    moved = vertices.copy()
    for _ in range(rounds):
        moved += strength[:, None] * (adjacency @ moved / neighbours - moved)
    return moved


def smoothstep(value: FloatArray) -> FloatArray:
    """Return 0 below 0, 1 above 1, and a cubic with level ends between.

    Parameters
    ----------
    value
        ``(points,)`` or any other shape, no unit.

    Returns
    -------
    ndarray
        Of the same shape, ``(points,)``, 0 to 1.
    """
    clipped = np.clip(value, 0.0, 1.0)
    return np.asarray(clipped * clipped * (3.0 - 2.0 * clipped))


def compute_bump(
    x: FloatArray,
    y: FloatArray,
    centre: tuple[float, float],
    widths: tuple[float, float],
    turn: float = 0.0,
) -> FloatArray:
    """Compute a Gaussian hill of height 1 over the plane.

    Parameters
    ----------
    x, y
        Points of the plane, ``(points,)`` each, millimetres.
    centre
        Its top, x and y, millimetres.
    widths
        Standard deviations along its axes, millimetres.
    turn
        Angle from the plane's axes to the hill's, radians.

    Returns
    -------
    ndarray
        Heights, ``(points,)``, 0 to 1.
    """
    across, along = x - centre[0], y - centre[1]
    cosine, sine = np.cos(turn), np.sin(turn)
    first = (cosine * across + sine * along) / widths[0]
    second = (cosine * along - sine * across) / widths[1]
    return np.asarray(np.exp(-0.5 * (first**2 + second**2)))


def compute_hill(value: FloatArray, centre: float, width: float) -> FloatArray:
    """Compute a Gaussian hill of height 1 over a line.

    Parameters
    ----------
    value
        Points of the line, ``(points,)``, millimetres.
    centre
        Where its top is, millimetres.
    width
        Standard deviation, millimetres.

    Returns
    -------
    ndarray
        Heights, ``(points,)``, 0 to 1.
    """
    return np.asarray(np.exp(-0.5 * ((value - centre) / width) ** 2))


def measure_path_distance(
    x: FloatArray, y: FloatArray, path: Sequence[tuple[float, float]]
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Measure how far points are from a path of straight pieces.

    Parameters
    ----------
    x, y
        Points of the plane, ``(points,)`` each, millimetres.
    path
        Corners of the path, x and y, millimetres.

    Returns
    -------
    distance
        ``(points,)``, millimetres.
    side
        ``(points,)``: +1 on the lateral side of a path that runs down the left half of the face, -1
        on the medial side.
    position
        Position along the path, ``(points,)``, 0 to 1.
    """
    start = np.asarray(path[:-1], dtype=np.float64)
    step = np.diff(np.asarray(path, dtype=np.float64), axis=0)
    across, along = x[:, None] - start[:, 0], y[:, None] - start[:, 1]
    position = np.clip((across * step[:, 0] + along * step[:, 1]) / (step**2).sum(axis=1), 0.0, 1.0)
    distance = np.hypot(across - position * step[:, 0], along - position * step[:, 1])
    nearest = distance.argmin(axis=1)
    rows = np.arange(len(x))
    side = np.sign(step[:, 0] * along - step[:, 1] * across)[rows, nearest]
    return (distance[rows, nearest], side, (nearest + position[rows, nearest]) / len(step))
