"""One shape laid on another one of any size: whether it is a mirror image, its unit and axes."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import permutations, product

import numpy as np

from mocap_fit.tracks import FloatArray
from mocap_fit.tracks.rigid import compute_spread
from mocap_fit.tracks.rigid_sets import compute_median

MIRROR_GAIN = 0.6
"""A shape is a mirror image where that fits with this part of the shape's own misfit, or less."""

_FLAT = 0.1
"""A set whose depth is under this part of its width is nearly its own mirror image."""

_AXES = "xyz"
_UNITS = {1000.0: "metres", 100.0: "decimetres", 10.0: "centimetres", 25.4: "inches"}


@dataclass(frozen=True, eq=False)
class Alignment:
    """The alignment of one shape with another: ``target ≈ scale matrix source + shift``.

    Parameters
    ----------
    matrix
        `(3, 3)`, a rotation, or a rotation of the mirror image.
    scale
        Size of the target over that of the source, no unit.
    distances
        `(points,)`; NaN where a point is in one shape alone.
    mirrored
        Whether the mirror image fits clearly better.
    """

    matrix: FloatArray
    scale: float
    distances: FloatArray
    mirrored: bool


def align_shapes(
    source: FloatArray, target: FloatArray, gain: float = MIRROR_GAIN
) -> Alignment | None:
    """Lay a shape on another one of any size, not following a few points that are elsewhere.

    Parameters
    ----------
    source, target
        `(points, 3)`; NaN is missing.
    gain
        The mirror image is taken where its misfit is this part of the shape's own, or less.

    Returns
    -------
    Alignment or None
        None where fewer than four points are in both, or they are on a line.
    """
    both = ~(np.isnan(source).any(axis=1) | np.isnan(target).any(axis=1))
    if both.sum() < 4 or not _is_wide(source[both]) or not _is_wide(target[both]):
        return None
    mirror = np.diag([-1.0, 1.0, 1.0])
    plain = _fit_robustly(source[both], target[both])
    other = _fit_robustly(source[both] @ mirror, target[both])
    # A set that is nearly flat is its own mirror image, turned round.
    mirrored = other[2] < gain * plain[2]
    matrix, scale, _, distances = other if mirrored else plain
    every = np.full(len(source), np.nan)
    every[both] = distances
    return Alignment(matrix @ mirror if mirrored else matrix, scale, every, mirrored)


def _is_wide(points: FloatArray) -> bool:
    lengths = compute_spread(points)
    return bool(lengths[1] > 0.02 * lengths[0] > 0)


def _fit_robustly(
    source: FloatArray, target: FloatArray
) -> tuple[FloatArray, float, float, FloatArray]:
    weights = np.ones(len(source))
    scale = 1.0
    rotation = np.eye(3)
    distances = np.zeros(len(source))
    for _ in range(8):
        total = weights.sum()
        middle, goal = weights @ source / total, weights @ target / total
        one, other = source - middle, target - goal
        left, values, right = np.linalg.svd((other * weights[:, None]).T @ one)
        sign = np.sign(np.linalg.det(left @ right))
        left[:, 2] *= sign
        rotation = left @ right
        size = values[0] + values[1] + sign * values[2]
        scale = float(size / (weights @ (one**2).sum(axis=1)))
        distances = np.linalg.norm(other - scale * one @ rotation.T, axis=1)
        usual = max(1.5 * float(np.median(distances)), 1e-9)
        weights = 1 / (1.0 + (distances / usual) ** 2)
    misfit = float(np.sqrt(weights @ distances**2 / weights.sum()))
    return rotation, scale, misfit, distances


def find_reflection(matrix: FloatArray) -> FloatArray:
    """Find the mirrored axes that are nearest to a matrix.

    Parameters
    ----------
    matrix
        A rotation of the mirror image, ``(3, 3)``, no unit.

    Returns
    -------
    ndarray
        ``(3, 3)``: one 1 or -1 in every row and column, with a determinant of -1.
    """
    candidates = (
        np.diag(signs)[list(order)]
        for order in permutations(range(3))
        for signs in product((1.0, -1.0), repeat=3)
    )
    mirrored = [each for each in candidates if np.linalg.det(each) < 0]
    return max(mirrored, key=lambda each: float(np.sum(each * matrix)))


def describe_axes(matrix: FloatArray) -> tuple[str, str]:
    """Describe what a matrix does to the axes, by the nearest permutation with signs.

    Parameters
    ----------
    matrix
        A rotation, perhaps mirrored, ``(3, 3)``.

    Returns
    -------
    kind
        ``same``, ``reversed`` (axes point the other way), ``exchanged`` or ``turned``.
    words
        In words.
    """
    nearest = np.zeros((3, 3))
    left = np.abs(matrix).copy()
    for _ in range(3):
        row, column = divmod(int(np.argmax(left)), 3)
        nearest[row, column] = np.sign(matrix[row, column]) or 1.0
        left[row, :], left[:, column] = -1.0, -1.0
    if np.array_equal(nearest, np.eye(3)):
        return "same", "the axes are the same"
    diagonal = np.diag(nearest)
    if (diagonal != 0).all():
        names = [_AXES[k] for k in range(3) if diagonal[k] < 0]
        return "reversed", f"{' and '.join(names)} {'is' if len(names) == 1 else 'are'} reversed"
    parts = []
    for row in range(3):
        column = int(np.argmax(np.abs(nearest[row])))
        if column != row or nearest[row, column] < 0:
            sign = "-" if nearest[row, column] < 0 else ""
            parts.append(f"{_AXES[row]} is {sign}{_AXES[column]}")
    if (nearest >= 0).all() and len(parts) == 2:
        names = [_AXES[k] for k in range(3) if diagonal[k] == 0]
        return "exchanged", f"{names[0]} and {names[1]} are exchanged"
    return "turned", f"{', '.join(parts)} of the others"


def describe_reflection(fit: Alignment, source: FloatArray, target: FloatArray) -> tuple[str, str]:
    """Describe why a shape is a mirror image: an axis, or exchanged names.

    Parameters
    ----------
    fit
        The mirrored alignment of the two shapes.
    source, target
        ``(points, 3)``, millimetres; NaN is missing.

    Returns
    -------
    kind
        ``same``, ``reversed``, ``exchanged`` or ``turned``: what was done to the axes.
    words
        In words.
    """
    kind, words = describe_axes(fit.matrix)
    before, after = compute_median(source), compute_median(target)
    # Exchanged names leave the head where it was; a reversed axis does not.
    there = np.linalg.norm(after - before)
    moved = np.linalg.norm(after - fit.scale * fit.matrix @ before)
    size = float(np.sqrt((compute_spread(source) ** 2).sum()))
    if kind == "reversed" and there < moved and there < 2 * size:
        words = "the names of left and right are exchanged"
    return kind, words


def describe_directions(matrix: FloatArray) -> str:
    """Describe where the speaker's left, up and forward point in a recording.

    Parameters
    ----------
    matrix
        Rotation from the head to the recording, ``(3, 3)``.

    Returns
    -------
    str
        Such as ``left is +x, up is +z, forward is -y``.
    """
    texts = []
    for column, name in enumerate(("left", "up", "forward")):
        axis = int(np.argmax(np.abs(matrix[:, column])))
        sign = "-" if matrix[axis, column] < 0 else "+"
        texts.append(f"{name} is {sign}{_AXES[axis]}")
    return ", ".join(texts)


def is_flat(points: FloatArray) -> bool:
    """Whether points are so nearly in a plane that left and right cannot be distinguished.

    Parameters
    ----------
    points
        ``(points, 3)``, millimetres; NaN is missing.

    Returns
    -------
    bool
        Whether their depth is under a tenth of their width, or fewer than four are there.
    """
    lengths = compute_spread(points)
    return bool((~np.isnan(points[:, 0])).sum() < 4 or not lengths[2] > _FLAT * lengths[1])


def compute_angle(matrix: FloatArray) -> float:
    """Compute the angle of a rotation.

    Parameters
    ----------
    matrix
        Rotation, ``(3, 3)``, no unit.

    Returns
    -------
    float
        Degrees, 0 to 180.
    """
    return float(np.degrees(np.arccos(np.clip((np.trace(matrix) - 1) / 2, -1.0, 1.0))))


def guess_unit(ratio: float) -> str:
    """Guess the unit that explains why a shape is too small or too large.

    Parameters
    ----------
    ratio
        Size of the shape over that which is expected, no unit.

    Returns
    -------
    str
        In words; empty where no unit explains it.
    """
    for factor, unit in _UNITS.items():
        for value, words in (
            (ratio * factor, f"it seems to be in {unit}, read as millimetres"),
            (ratio / factor, f"it seems to be in millimetres, read as {unit}"),
        ):
            if 0.75 < value < 1.35:
                return words
    return ""
