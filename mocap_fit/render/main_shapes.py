"""The fewest shapes that, blended, come as near as wanted to all frames of a movement.

They have no meaning as those of `mocap_fit.render.shapes` have: they are the principal components
of the vertices over the frames, so that ten of them do for a face that speaks.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mocap_fit.tracks import FloatArray

Single = NDArray[np.float32]

# Frames that the first shapes are computed from, and frames that are worked on at once.
_SAMPLED, _AT_ONCE = 160, 32
_FULL_SCALE = 32767


@dataclass(frozen=True, eq=False)
class Quantised:
    """Numbers in 16 bits.

    Parameters
    ----------
    steps
        Integers, ``(..., 3)``.
    scale
        What one step is worth, in the unit of the numbers.
    """

    steps: NDArray[np.int16]
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
        The mean shape, ``(vertices, 3)``, millimetres.
    shapes
        What is added to it, ``(shapes, vertices, 3)``, no unit.
    weights
        Weights of the shapes, ``(frames, shapes)``, millimetres.
    largest_error
        What the distance from the movement is at most, at any vertex of any frame, millimetres.
    """

    middle: Quantised
    shapes: Quantised
    weights: Single
    largest_error: float


def compute_main_shapes(
    get_vertices: Callable[[int], FloatArray],
    frames: int,
    *,
    tolerance: float = 0.05,
    progress: Callable[[], object] = lambda: None,
) -> MainShapes:
    """Compute shapes and weights of a movement.

    Parameters
    ----------
    get_vertices
        Returns the vertices of a frame, ``(vertices, 3)``, millimetres, by its number.
    frames
        Number of frames, one or more.
    tolerance
        How far a vertex may be from where it should be, millimetres, before rounding.
    progress
        Called after each frame.

    Returns
    -------
    MainShapes
        As few shapes as the tolerance allows.
    """
    sampled = np.unique(np.linspace(0, frames - 1, min(frames, _SAMPLED)).round().astype(int))
    sample = _stack(get_vertices, sampled)
    middle = quantise(sample.mean(axis=0))
    mean: Single = middle.values.ravel()
    basis = _find_directions(sample.reshape(len(sample), -1) - mean, tolerance)
    parts: list[Single] = []
    error = 0.0
    for first in range(0, frames, _AT_ONCE):
        some = _stack(get_vertices, range(first, min(first + _AT_ONCE, frames)))
        flat: Single = some.reshape(len(some), -1) - mean
        left = np.asarray(flat - flat @ basis.T @ basis, dtype=np.float32)
        basis = np.concatenate([basis, _find_directions(left, tolerance)])
        parts.append(np.asarray(flat @ basis.T))
        error = max(error, float(_measure(flat - parts[-1] @ basis).max()))
        for _ in some:
            progress()
    # Frames before a shape was needed do without it.
    weights = np.zeros((frames, len(basis)), dtype=np.float32)
    for number, part in enumerate(parts):
        weights[number * _AT_ONCE :][: len(part), : part.shape[1]] = part
    shapes = quantise(basis.reshape(len(basis), *middle.steps.shape))
    rounding = np.sqrt(3.0) * 0.5 * shapes.scale * float(np.abs(weights).sum(axis=1).max())
    return MainShapes(middle, shapes, weights, error + rounding)


def quantise(values: FloatArray | Single) -> Quantised:
    """Round numbers to 16 bits.

    Parameters
    ----------
    values
        Finite numbers, ``(..., 3)``, in any unit.

    Returns
    -------
    Quantised
        The nearest steps.
    """
    scale = float(np.abs(values).max(initial=0.0)) / _FULL_SCALE or 1.0
    return Quantised(np.rint(values / scale).astype(np.int16), scale)


def _stack(get_vertices: Callable[[int], FloatArray], numbers: range | NDArray[np.int64]) -> Single:
    return np.stack([get_vertices(int(number)).astype(np.float32) for number in numbers])


def _find_directions(rest: Single, tolerance: float) -> Single:
    """Return unit vectors, ``(vectors, coordinates)``, that leave no vertex farther than that."""
    left = rest.copy()
    directions: list[Single] = []
    # The eigenvectors of the small matrix of frames give those of the large one of coordinates.
    _, sides = np.linalg.eigh((rest @ rest.T).astype(np.float64))
    for side in sides.T[::-1]:
        if _measure(left).max() <= tolerance:
            break
        direction = side.astype(np.float32) @ rest
        direction /= np.linalg.norm(direction)
        left -= np.outer(left @ direction, direction)
        directions.append(direction)
    return np.stack(directions) if directions else np.zeros((0, rest.shape[1]), np.float32)


def _measure(rest: Single) -> Single:
    """Return how far vertices are moved, ``(frames, vertices)``."""
    return np.asarray(np.linalg.norm(rest.reshape(len(rest), -1, 3), axis=2))
