"""A face's movement as shapes that are blended, for programs that know no rigs.

A rig turns and scales; blending only adds. So every parameter gives the shape of its full gesture,
and where that is not enough, correcting shapes are added, as animators do it: one for the middle
of a gesture's way, one for two gestures at once.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mocap_fit.face.rig import Rig
from mocap_fit.render.talking import parameters_at
from mocap_fit.tracks import FloatArray, ParameterTracks

# A correction that moves no vertex by so much (mm) over the whole movement is left out.
_NOTICED = 0.02


@dataclass(frozen=True, eq=False)
class BlendedShapes:
    """Shapes, and how much of each is blended in over time.

    Parameters
    ----------
    names
        Of the shapes: a parameter's own, ``NAME_corrected``, or ``NAME_with_NAME``.
    shapes
        `(shapes, vertices, 3)`, mm: what each adds to the face at rest.
    times
        `(frames,)`, seconds.
    weights
        `(frames, shapes)`.
    largest_error
        mm: how far the blended face is from the rig's, at the worst vertex of the worst frame
        that was looked at.
    """

    names: tuple[str, ...]
    shapes: FloatArray
    times: FloatArray
    weights: FloatArray
    largest_error: float


def blended_shapes(tracks: ParameterTracks, rig: Rig, rate: float | None = None) -> BlendedShapes:
    """Write a movement as shapes and weights.

    Parameters
    ----------
    tracks
        Face parameters over time.
    rig
        The face that they move.
    rate
        Frames per second; the tracks' own where not given.

    Raises
    ------
    DataError
        If the tracks do not belong to the face, or have no frames.
    """
    rate = tracks.rate if rate is None else rate
    frames = max(1, int(np.floor((tracks.frames - 1) * rate / tracks.rate + 1e-6)) + 1)
    times: FloatArray = tracks.start_time + np.arange(frames, dtype=np.float64) / rate
    values = parameters_at(tracks, times, rig)
    rest = rig.deform(np.zeros(len(rig.parameter_names)))
    axes = np.eye(len(rig.parameter_names))
    moving = [i for i in range(len(axes)) if np.abs(values[:, i]).max() > 1e-9]
    full = {i: rig.deform(axes[i]) - rest for i in range(len(axes))}
    names = list(rig.parameter_names)
    shapes = [full[i] for i in range(len(axes))]
    weights = [values[:, i] for i in range(len(axes))]

    def correct(name: str, shape: FloatArray, weight: FloatArray) -> None:
        if np.abs(shape).max() * np.abs(weight).max() >= _NOTICED:
            names.append(name)
            shapes.append(shape)
            weights.append(weight)

    for i in moving:
        # The weight is 0 at rest and at the full gesture, 1 half-way.
        half = rig.deform(0.5 * axes[i]) - rest - 0.5 * full[i]
        own = rig.parameter_names[i]
        correct(f"{own}_corrected", half, 4.0 * values[:, i] * (1.0 - values[:, i]))
    for place, i in enumerate(moving):
        for j in moving[place + 1 :]:
            both = rig.deform(axes[i] + axes[j]) - rest - full[i] - full[j]
            name = f"{rig.parameter_names[i]}_with_{rig.parameter_names[j]}"
            correct(name, both, values[:, i] * values[:, j])
    blended, blend = np.array(shapes), np.stack(weights, axis=1)
    looked_at = np.unique(np.linspace(0, frames - 1, min(frames, 60)).round().astype(int))
    error = max(
        float(np.abs(rest + np.tensordot(blend[f], blended, 1) - rig.deform(values[f])).max())
        for f in looked_at
    )
    return BlendedShapes(tuple(names), blended, times, blend, error)
