"""Gestures as critically damped second-order systems, with the lips reaching each other."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mocap_fit.face import Rig
from mocap_fit.face.rig import CompiledRig, evaluate
from mocap_fit.tracks import FloatArray

JAW, UPPER, LOWER = "jaw_rotation", "upper_lip_raise", "lower_lip_depression"
# Where slopes of the distance of the lips are taken: half-way into the range of speech.
_STEP = 0.25


@dataclass(frozen=True, eq=False)
class LipDistance:
    """How far the lips are apart in the middle, by the face's parameters, to first order.

    Parameters
    ----------
    rest
        Millimetres at rest.
    slopes
        `(parameters,)`, millimetres per full gesture.
    """

    rest: float
    slopes: FloatArray

    @classmethod
    def of(cls, face: Rig) -> LipDistance:
        """Measure it on a face that has MPEG-4's inner lip points 2.2 and 2.3."""
        rest = float(lip_distances(face, np.zeros((1, len(face.parameter_names))))[0])
        moved = lip_distances(face, _STEP * np.eye(len(face.parameter_names)))
        return cls(rest, (moved - rest) / _STEP)


def lip_distances(face: Rig, values: FloatArray) -> FloatArray:
    """Height of the lips' opening in the middle, `(frames,)` in millimetres.

    Parameters
    ----------
    face
        With MPEG-4's inner lip points 2.2 and 2.3.
    values
        `(frames, parameters)`.
    """
    points = np.array([face.mesh.get_feature_point("2.2"), face.mesh.get_feature_point("2.3")])
    compiled: CompiledRig | None = face.compile(points)
    found = np.empty(len(values))
    for frame, parameters in enumerate(values):
        upper, lower = (
            face.deform(parameters)[points] if compiled is None else evaluate(compiled, parameters)
        )
        found[frame] = upper[1] - lower[1]
    return found


@dataclass(frozen=True, eq=False)
class Pull:
    """What all gestures together want, step by step.

    Parameters
    ----------
    step
        Seconds between steps.
    targets
        `(steps, parameters)`.
    stiffness
        `(steps, parameters)`, radians per second; that of the lips' task is in it.
    lips_held
        `(steps, 2)`: how far the upper and the lower lip go by a distance of the lips, 0 to 1, and
        no longer by the targets.
    lips_distances, lips_shares
        `(steps,)`: that distance, millimetres, and the upper lip's part of the way.
    """

    step: float
    targets: FloatArray
    stiffness: FloatArray
    lips_held: FloatArray
    lips_distances: FloatArray
    lips_shares: FloatArray


def move(pull: Pull, names: tuple[str, ...], lips: LipDistance) -> FloatArray:
    """Let the articulators follow, from rest.

    Every parameter obeys ``y'' + 2 w y' + w^2 (y - target) = 0``, solved exactly over each step.
    Where the lips are wanted at a distance, their targets are what is missing to it with the jaw
    where it is about to be, so that they meet however far the jaw is open.

    Returns
    -------
    FloatArray
        `(steps, parameters)`.
    """
    jaw, upper, lower = (names.index(name) for name in (JAW, UPPER, LOWER))
    step, stiffness = pull.step, pull.stiffness
    decay = np.exp(-stiffness * step)
    slopes = lips.slopes.copy()
    to_upper, to_lower = slopes[upper], slopes[lower]
    slopes[[upper, lower]] = 0.0
    values, speeds = np.zeros(len(names)), np.zeros(len(names))
    found = np.empty_like(pull.targets)
    for i, target in enumerate(pull.targets):
        held_upper, held_lower = pull.lips_held[i]
        if held_lower > 0:
            target = target.copy()
            # A system lags behind a moving target by 2 / w of its way a second.
            ahead = values + speeds * (2.0 / stiffness[i, lower])
            # The jaw's own motion is what counts; the rest moves little.
            now = values.copy()
            now[jaw] = ahead[jaw]
            missing = pull.lips_distances[i] - lips.rest - slopes @ now
            wanted = pull.lips_shares[i] * missing / to_upper
            target[upper] += held_upper * (wanted - target[upper])
            wanted = (missing - to_upper * ahead[upper]) / to_lower
            target[lower] += held_lower * (wanted - target[lower])
        off = values - target
        inertia = speeds + stiffness[i] * off
        values = target + (off + inertia * step) * decay[i]
        speeds = (speeds - stiffness[i] * inertia * step) * decay[i]
        found[i] = values
    return found
