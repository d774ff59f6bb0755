"""Shapes of sets of markers: a recording's typical one, the expected one, one laid on another."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mocap_fit.errors import ConfigurationError
from mocap_fit.fitting import Layout, load_layout
from mocap_fit.fitting.layout import list_layouts
from mocap_fit.tracks import FloatArray, MarkerTracks, compute_spread, estimate_rigid_transforms
from mocap_fit.tracks.rigid import apply_inverse_transforms, project_to_rotations
from mocap_fit.tracks.rigid_sets import compute_median, compute_typical_shape
from mocap_fit.tracks.robust import estimate_robust_transforms

# A shipped layout is taken where a recording has as many of its markers.
_KNOWN_SHARE = 0.8
_AXES = "xyz"


@dataclass(frozen=True, eq=False)
class Stilled:
    """A recording without the head's motion.

    Parameters
    ----------
    positions
        `(frames, markers, 3)`, millimetres, in the coordinates of the typical shape; NaN where a
        marker or the pose is missing.
    shape
        `(markers, 3)`: the median over the frames; NaN for markers that are never seen.
    residuals
        `(frames,)`, millimetres: of the markers that the pose rests on.
    mean_rotation, mean_translation
        `(3, 3)` and `(3,)`: the middle pose, from these coordinates to the recording's.
    """

    positions: FloatArray
    shape: FloatArray
    residuals: FloatArray
    mean_rotation: FloatArray
    mean_translation: FloatArray

    @property
    def placed(self) -> FloatArray:
        """The shape at the middle pose in the recording's coordinates, `(markers, 3)`."""
        return np.asarray(self.shape @ self.mean_rotation.T + self.mean_translation)


def remove_motion(recording: MarkerTracks, head: Sequence[int]) -> Stilled | None:
    """Take the head's motion out of a recording, by its head markers or, without, by all.

    Parameters
    ----------
    recording
        Markers in any coordinates.
    head
        Which of them are rigid with the head; four or more of them are believed.

    Returns
    -------
    Stilled or None
        None where no frame shows three markers that are not on a line.
    """
    positions = recording.positions
    if not len(positions):
        return None
    chosen = np.array(head if len(head) >= 4 else range(positions.shape[1]), dtype=np.intp)
    shape = compute_typical_shape(positions[:, chosen])
    if (~np.isnan(shape[:, 0])).sum() < 3:
        return None
    if len(head) >= 4:
        fit = estimate_robust_transforms(shape, positions[:, chosen])
        rotations, translations, residuals = fit.rotations, fit.translations, fit.residuals
    else:
        rotations, translations, residuals = estimate_rigid_transforms(shape, positions[:, chosen])
    known = ~np.isnan(residuals)
    if not known.any():
        return None
    still = apply_inverse_transforms(positions, rotations, translations)
    return Stilled(
        still,
        compute_median(still),
        residuals,
        project_to_rotations(rotations[known].sum(axis=0)),
        np.median(translations[known], axis=0),
    )


@dataclass(frozen=True, eq=False)
class Fitted:
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


def align_shapes(source: FloatArray, target: FloatArray, gain: float) -> Fitted | None:
    """Lay a shape on another one of any size, not following a few points that are elsewhere.

    Parameters
    ----------
    source, target
        `(points, 3)`; NaN is missing.
    gain
        The mirror image is taken where its misfit is this part of the shape's own, or less.

    Returns
    -------
    Fitted or None
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
    return Fitted(matrix @ mirror if mirrored else matrix, scale, every, mirrored)


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
        weights = 1.0 / (1.0 + (distances / usual) ** 2)
    misfit = float(np.sqrt(weights @ distances**2 / weights.sum()))
    return rotation, scale, misfit, distances


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


def guess_layout(names: Sequence[str]) -> Layout | None:
    """Guess the shipped layout from the markers' names.

    Parameters
    ----------
    names
        Names of the markers.

    Returns
    -------
    Layout or None
        The layout that most of the names belong to; None where none does.
    """
    best, best_layout = _KNOWN_SHARE, None
    for name in list_layouts():
        layout = load_layout(name)
        wanted = [marker.name for marker in layout.markers]
        share = sum(marker in names for marker in wanted) / len(wanted)
        if share > best:
            best, best_layout = share, layout
    return best_layout


def locate_expected(layout: Layout, names: Sequence[str]) -> FloatArray:
    """Locate a layout's markers on the built-in head.

    Parameters
    ----------
    layout
        The marker layout.
    names
        Names of the markers, in order.

    Returns
    -------
    ndarray
        Positions, ``(markers, 3)``, millimetres; NaN where the layout does not say.
    """
    from mocap_fit.face.builtin import load_built_in_head

    head = load_built_in_head()
    normals = head.compute_normals()
    locations = np.full((len(names), 3), np.nan)
    for marker in layout.markers:
        if marker.name not in names:
            continue
        row = list(names).index(marker.name)
        if marker.position is not None:
            locations[row] = marker.position
        elif marker.feature_point is not None:
            try:
                vertex = head.get_feature_point(marker.feature_point)
            except ConfigurationError:
                continue
            locations[row] = head.vertices[vertex] + layout.marker_offset * normals[vertex]
    return locations
