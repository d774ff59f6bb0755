"""A face's movement as shapes that are blended, for programs that know no rigs.

A rig rotates and scales; blending only adds. So every parameter gives the shape of its full
gesture, and where that is not enough, corrective shapes are added, as animators do it: one for the
middle of a gesture, one for two gestures at once. Contact (`mocap_fit.face.contact`) is no sum
either: what it changes over the movement is added as the few shapes that hold most of it
(``contact_1`` and so on, by singular values).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mocap_fit.face.contact import list_touching, resolve_contact
from mocap_fit.face.mesh import IndexArray
from mocap_fit.face.rig import Rig
from mocap_fit.phones import PhoneSequence
from mocap_fit.render.sampling import sample_frames
from mocap_fit.tracks import FloatArray, ParameterTracks

# Millimetres: a correction that moves no vertex by so much over the movement is left out.
_NOTICEABLE = 0.02
# Frames at which the error is measured, at most.
_CHECKED = 60
# Shapes of contact: at most so many, from so many frames, until no vertex is so far off, mm.
_CONTACT_SHAPES, _CONTACT_FRAMES, _CONTACT_ERROR = 20, 300, 0.15


@dataclass(frozen=True, eq=False)
class BlendShapes:
    """Shapes, and the weight of each over time.

    Parameters
    ----------
    names
        Names of the shapes: that of a parameter, ``NAME_corrected``, ``NAME_with_NAME``, or
        ``contact_NUMBER``.
    shapes
        Displacements that each adds to the face at rest, ``(shapes, vertices, 3)``, millimetres.
    times
        Times of the frames, ``(frames,)``, seconds.
    weights
        Weights, ``(frames, shapes)``, no unit.
    largest_error
        Distance of the blended face from the one that is drawn, at the worst vertex of the worst
        frame of those that were checked, millimetres.
    """

    names: tuple[str, ...]
    shapes: FloatArray
    times: FloatArray
    weights: FloatArray
    largest_error: float


def compute_blend_shapes(
    tracks: ParameterTracks,
    rig: Rig,
    rate: float | None = None,
    phones: PhoneSequence | None = None,
) -> BlendShapes:
    """Compute shapes and weights that come near to a movement.

    Parameters
    ----------
    tracks
        Face parameters over time.
    rig
        The face that they move.
    rate
        Frame rate, hertz; that of the tracks if None.
    phones
        The phones of the utterance, by which a tongue moves that is not in the tracks.

    Returns
    -------
    BlendShapes
        A shape for every parameter, and corrective shapes.

    Raises
    ------
    DataError
        If the tracks have a parameter that the face lacks, or no frame.
    """
    times, values = sample_frames(tracks, rig, rate, phones)
    rest = rig.deform(np.zeros(len(rig.parameter_names)))
    axes = np.eye(len(rig.parameter_names))
    moving = [i for i in range(len(axes)) if np.abs(values[:, i]).max() > 1e-9]
    full = {i: rig.deform(axes[i]) - rest for i in range(len(axes))}
    names = list(rig.parameter_names)
    shapes = [full[i] for i in range(len(axes))]
    weights = [values[:, i] for i in range(len(axes))]

    def add_correction(name: str, shape: FloatArray, weight: FloatArray) -> None:
        if np.abs(shape).max() * np.abs(weight).max() >= _NOTICEABLE:
            names.append(name)
            shapes.append(shape)
            weights.append(weight)

    for i in moving:
        # The weight is 0 at rest and at the full gesture, 1 half-way.
        half = rig.deform(0.5 * axes[i]) - rest - 0.5 * full[i]
        name = f"{rig.parameter_names[i]}_corrected"
        add_correction(name, half, 4.0 * values[:, i] * (1.0 - values[:, i]))
    for index, i in enumerate(moving):
        for j in moving[index + 1 :]:
            both = rig.deform(axes[i] + axes[j]) - rest - full[i] - full[j]
            name = f"{rig.parameter_names[i]}_with_{rig.parameter_names[j]}"
            add_correction(name, both, values[:, i] * values[:, j])
    for number, (shape, weight) in enumerate(_find_contact_shapes(rig, values, shapes, weights)):
        names.append(f"contact_{number + 1}")
        shapes.append(shape)
        weights.append(weight)
    blended, blend = np.array(shapes), np.stack(weights, axis=1)
    checked = _spread_frames(len(times), _CHECKED)
    error = max(float(np.abs(_find_rest(rig, values[f], blend[f], blended)).max()) for f in checked)
    return BlendShapes(tuple(names), blended, times, blend, error)


def _spread_frames(frames: int, most: int) -> IndexArray:
    return np.unique(np.linspace(0, frames - 1, min(frames, most)).round().astype(np.int64))


def _find_rest(rig: Rig, values: FloatArray, weights: FloatArray, shapes: FloatArray) -> FloatArray:
    """Return what a frame as it is drawn has beyond its shapes, ``(vertices, 3)``."""
    drawn = resolve_contact(rig.deform(values), rig.mesh)
    return np.asarray(drawn - rig.mesh.vertices - np.tensordot(weights, shapes, 1))


def _find_contact_shapes(
    rig: Rig, values: FloatArray, shapes: list[FloatArray], weights: list[FloatArray]
) -> list[tuple[FloatArray, FloatArray]]:
    """Return the shapes of most of what contact changes, and their weights over time."""
    touching = list_touching(rig.mesh)
    if not touching.size:
        return []
    blended, blend = np.array(shapes), np.stack(weights, axis=1)

    def find_change(frame: int) -> FloatArray:
        return _find_rest(rig, values[frame], blend[frame], blended)[touching].ravel()

    left = np.array([find_change(f) for f in _spread_frames(len(values), _CONTACT_FRAMES)])
    _, _, directions = np.linalg.svd(left, full_matrices=False)
    number = 0
    while number < min(_CONTACT_SHAPES, len(directions)) and np.abs(left).max() > _CONTACT_ERROR:
        left -= np.outer(left @ directions[number], directions[number])
        number += 1
    amounts = np.array([directions[:number] @ find_change(f) for f in range(len(values))])
    result: list[tuple[FloatArray, FloatArray]] = []
    for direction, amount in zip(directions[:number], amounts.T, strict=True):
        shape = np.zeros_like(rig.mesh.vertices)
        largest = float(np.abs(amount).max())
        shape[touching] = largest * direction.reshape(-1, 3)
        result.append((shape, amount / largest))
    return result
