"""The fewest shapes that, blended, come as near as wanted to all frames of a movement.

They are built from frames as they come, so that a long movement is never in memory at once, and
have no meaning as those of `mocap_fit.render.shapes` have: they are principal components of the
vertices over the frames. A dozen of them do for a face that speaks.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mocap_fit.tracks import FloatArray

Single = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class Quantised:
    """Numbers in 16 or 8 bits.

    Parameters
    ----------
    steps
        Integers, ``(..., 3)``.
    scale
        What one step is worth, in the unit of the numbers.
    """

    steps: NDArray[np.signedinteger[Any]]
    scale: float

    @property
    def values(self) -> Single:
        """The numbers."""
        return (self.steps * np.float32(self.scale)).astype(np.float32)


@dataclass(frozen=True, eq=False)
class MainShapes:
    """A movement as a sum of shapes, with a weight for each in every frame.

    Parameters
    ----------
    middle
        The mean shape, ``(vertices, 3)``, in the unit of the frames.
    shapes
        What is added to it, ``(shapes, vertices, 3)``, no unit.
    weights
        Weights of the shapes, ``(frames, shapes)``, in the unit of the frames.
    largest_error
        What the distance from the movement is at most, at any vertex of any frame.
    """

    middle: Quantised
    shapes: Quantised
    weights: Single
    largest_error: float


class MainShapesBuilder:
    """Finds the fewest shapes for frames that come in pieces, of a movement or of its light.

    Parameters
    ----------
    sample
        Frames from all over the movement, which the first shapes are computed from,
        ``(frames, vertices, 3)``.
    tolerance
        How far a vertex may be from where it should be, in the unit of the frames, before the
        shapes are rounded.
    bits
        16, or 8 for shapes that may be rough.
    """

    def __init__(self, sample: FloatArray | Single, tolerance: float, bits: int = 16) -> None:
        self._bits = bits
        self._tolerance = tolerance
        # What never moves is the same in all frames, and 0 in all shapes.
        self._mean = np.asarray(sample.mean(axis=0), dtype=np.float64)
        self._basis = _find_directions(self._flatten(sample), tolerance)
        self._weights: list[Single] = []
        self._error = 0.0

    def add(self, frames: FloatArray | Single) -> None:
        """Add the next frames, and the shapes that they need.

        Parameters
        ----------
        frames
            Some frames, ``(frames, vertices, 3)``.
        """
        flat = self._flatten(frames)
        left = flat - flat @ self._basis.T @ self._basis
        self._basis = np.concatenate([self._basis, _find_directions(left, self._tolerance)])
        weights = flat @ self._basis.T
        self._weights.append(weights.astype(np.float32))
        self._error = max(self._error, _measure(flat - weights @ self._basis))

    def build(self) -> MainShapes:
        """Return the shapes, and the weights of all frames.

        Returns
        -------
        MainShapes
            As few shapes as the tolerance allows.
        """
        frames = sum(map(len, self._weights))
        # Frames before a shape was needed do without it.
        weights = np.zeros((frames, len(self._basis)), dtype=np.float32)
        first = 0
        for part in self._weights:
            weights[first : first + len(part), : part.shape[1]] = part
            first += len(part)
        middle = quantise(self._mean)
        shapes = quantise(self._basis.reshape(-1, *self._mean.shape), self._bits)
        steps = middle.scale + shapes.scale * float(np.abs(weights).sum(axis=1).max())
        return MainShapes(middle, shapes, weights, self._error + 0.5 * float(np.sqrt(3.0)) * steps)

    def _flatten(self, frames: FloatArray | Single) -> FloatArray:
        # In double precision: a small shape must be orthogonal to large ones.
        return np.asarray(frames.reshape(len(frames), -1) - self._mean.ravel())


def quantise(values: FloatArray | Single, bits: int = 16) -> Quantised:
    """Round numbers to 16 or 8 bits.

    Parameters
    ----------
    values
        Finite numbers, ``(..., 3)``, in any unit.
    bits
        16 or 8.

    Returns
    -------
    Quantised
        The nearest steps.
    """
    kind: Any = np.int16 if bits == 16 else np.int8
    scale = float(np.abs(values).max(initial=0.0)) / np.iinfo(kind).max or 1.0
    return Quantised(np.rint(values / scale).astype(kind), scale)


def _find_directions(rest: FloatArray, tolerance: float) -> FloatArray:
    """Return unit vectors, ``(vectors, coordinates)``, that leave no vertex farther than that."""
    # Most vertices of a head never move. Those that do a little count: what is left out here
    # would make the vectors oblique to those that there are already.
    moving = np.abs(rest).max(axis=0) > 1e-9
    moving = np.repeat(moving.reshape(-1, 3).any(axis=1), 3)
    moved = rest[:, moving]
    left = moved.copy()
    directions: list[FloatArray] = []
    # The eigenvectors of the small matrix of frames give those of the large one of coordinates.
    _, sides = np.linalg.eigh(moved @ moved.T)
    for side in sides.T[::-1]:
        if _measure(left) <= tolerance:
            break
        direction = side @ moved
        direction /= np.linalg.norm(direction)
        left -= np.outer(left @ direction, direction)
        directions.append(direction)
    vectors = np.zeros((len(directions), rest.shape[1]))
    vectors[:, moving] = np.reshape(directions, (len(directions), left.shape[1]))
    return vectors


def _measure(left: FloatArray) -> float:
    """Return how far the farthest vertex of all frames is, of ``(frames, coordinates)``."""
    vectors = left.reshape(len(left), -1, 3)
    return float(np.sqrt(np.einsum("fvi,fvi->fv", vectors, vectors).max(initial=0.0)))
