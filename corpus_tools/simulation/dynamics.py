"""Gestures as critically damped second-order systems, with the lips reaching each other."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mocap_fit.face import Rig, compute_lip_gap
from mocap_fit.tracks import FloatArray

JAW, UPPER, LOWER = "jaw_rotation", "upper_lip_raise", "lower_lip_depression"
# Parameter at which the slopes of the lip distance are taken: half-way into the range of speech.
_STEP = 0.25


@dataclass(frozen=True, eq=False)
class LipDistance:
    """The distance of the lips in the middle as a linear function of the parameters.

    Parameters
    ----------
    rest
        The distance at rest, millimetres.
    slopes
        Its slopes, ``(parameters,)``, millimetres per full gesture.
    """

    rest: float
    slopes: FloatArray

    @classmethod
    def from_face(cls, face: Rig) -> LipDistance:
        """Measure the distance on a face.

        Parameters
        ----------
        face
            A face that has MPEG-4's inner lip points 2.2 and 2.3.

        Returns
        -------
        LipDistance
            The distance at rest and its slopes.
        """
        rest = float(compute_lip_gap(face, np.zeros((1, len(face.parameter_names))))[0])
        positions = compute_lip_gap(face, _STEP * np.eye(len(face.parameter_names)))
        return cls(rest, (positions - rest) / _STEP)


@dataclass(frozen=True, eq=False)
class MotionTargets:
    """The targets of all gestures together, step by step.

    Parameters
    ----------
    step
        Time between steps, seconds.
    parameters
        Targets of the parameters, ``(steps, parameters)``, full gestures.
    stiffness
        Natural frequencies, ``(steps, parameters)``, radians per second, with those of the lips.
    lips_weights
        Weights of the wanted distance of the lips over the targets of the upper and the lower
        lip, ``(steps, 2)``, 0 to 1.
    lips_distances
        The wanted distance of the lips, ``(steps,)``, millimetres.
    lips_shares
        The upper lip's share of the way to it, ``(steps,)``, 0 to 1.
    """

    step: float
    parameters: FloatArray
    stiffness: FloatArray
    lips_weights: FloatArray
    lips_distances: FloatArray
    lips_shares: FloatArray


def simulate_motion(
    targets: MotionTargets, names: tuple[str, ...], lips: LipDistance
) -> FloatArray:
    """Let the articulators follow, from rest.

    Every parameter obeys ``y'' + 2 w y' + w^2 (y - target) = 0``, solved exactly over each step.
    Where the lips are wanted at a distance, their targets are what is missing to it with the jaw
    where it is about to be, so that they meet however far the jaw is open.

    Parameters
    ----------
    targets
        The targets, step by step.
    names
        Names of the parameters.
    lips
        The distance of the lips.

    Returns
    -------
    ndarray
        Parameters, ``(steps, parameters)``, full gestures.
    """
    jaw, upper, lower = (names.index(name) for name in (JAW, UPPER, LOWER))
    step, stiffness = targets.step, targets.stiffness
    decay = np.exp(-stiffness * step)
    slopes = lips.slopes.copy()
    to_upper, to_lower = slopes[upper], slopes[lower]
    slopes[[upper, lower]] = 0.0
    values, speeds = np.zeros(len(names)), np.zeros(len(names))
    result = np.empty_like(targets.parameters)
    for i, target in enumerate(targets.parameters):
        upper_weight, lower_weight = targets.lips_weights[i]
        if lower_weight > 0:
            target = target.copy()
            # A system lags behind a moving target by 2 / w of its way a second.
            ahead = values + speeds * (2.0 / stiffness[i, lower])
            # What counts is the motion of the jaw; the rest moves little.
            now = values.copy()
            now[jaw] = ahead[jaw]
            missing = targets.lips_distances[i] - lips.rest - slopes @ now
            wanted = targets.lips_shares[i] * missing / to_upper
            target[upper] += upper_weight * (wanted - target[upper])
            wanted = (missing - to_upper * ahead[upper]) / to_lower
            target[lower] += lower_weight * (wanted - target[lower])
        off = values - target
        inertia = speeds + stiffness[i] * off
        values = target + (off + inertia * step) * decay[i]
        speeds = (speeds - stiffness[i] * inertia * step) * decay[i]
        result[i] = values
    return result
