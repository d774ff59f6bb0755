"""A face's movement as shapes that are blended, for programs that know no rigs.

A rig rotates and scales; blending only adds. So every parameter gives the shape of its full
gesture, and where that is not enough, corrective shapes are added, as animators do it: one for the
middle of a gesture, one for two gestures at once.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mocap_fit.face.rig import Rig
from mocap_fit.phones import PhoneSequence
from mocap_fit.render.sampling import sample_frames
from mocap_fit.tracks import FloatArray, ParameterTracks

# Millimetres: a correction that moves no vertex by so much over the movement is left out.
_NOTICEABLE = 0.02
# Frames at which the error is measured, at most.
_CHECKED = 60


@dataclass(frozen=True, eq=False)
class BlendShapes:
    """Shapes, and the weight of each over time.

    Parameters
    ----------
    names
        Names of the shapes: that of a parameter, ``NAME_corrected``, or ``NAME_with_NAME``.
    shapes
        Displacements that each adds to the face at rest, ``(shapes, vertices, 3)``, millimetres.
    times
        Times of the frames, ``(frames,)``, seconds.
    weights
        Weights, ``(frames, shapes)``, no unit.
    largest_error
        Distance of the blended face from the rig's, at the worst vertex of the worst frame of
        those that were checked, millimetres.
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
    blended, blend = np.array(shapes), np.stack(weights, axis=1)
    checked = np.linspace(0, len(times) - 1, min(len(times), _CHECKED)).round().astype(int)
    error = max(
        float(np.abs(rest + np.tensordot(blend[f], blended, 1) - rig.deform(values[f])).max())
        for f in np.unique(checked)
    )
    return BlendShapes(tuple(names), blended, times, blend, error)
