"""A fit beside the truth of a simulation: errors, and how small they could have been."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from mocap_fit.errors import DataError
from mocap_fit.fitting import Binding, ShapeFit
from mocap_fit.fitting.precision import compute_covariance
from mocap_fit.head import HeadMotion
from mocap_fit.tracks import FloatArray, MarkerTracks, ParameterTracks, PoseTracks
from mocap_fit.tracks.rigid import apply_inverse_transforms


@dataclass(frozen=True, eq=False)
class FittedRecording:
    """One simulated recording: what was seen, what was fitted, what is true.

    Parameters
    ----------
    recording
        The markers as they were recorded.
    fit
        The face parameters that were found, and how.
    motion
        The head's motion that was found.
    truth
        The face parameters that made the recording.
    true_pose
        The head's pose that made it, from reference pose to recording.
    """

    recording: MarkerTracks
    fit: ShapeFit
    motion: HeadMotion
    truth: ParameterTracks
    true_pose: PoseTracks

    def __post_init__(self) -> None:
        frames = (self.recording.frames, self.truth.frames, self.true_pose.frames)
        if len(set(frames)) > 1:
            raise DataError(
                f"the recording '{self.recording.name}' and its truth differ in their frames",
                found=frames,
            )

    @property
    def in_head_coordinates(self) -> FloatArray:
        """The recorded markers without the head's motion that was found, `(frames, markers, 3)`."""
        motion = self.motion
        return apply_inverse_transforms(
            self.recording.positions, motion.rotations, motion.translations
        )

    @property
    def hidden(self) -> NDArray[np.bool_]:
        """Which samples of the face markers are missing, `(frames, face markers)`."""
        visible = self.recording.visible[:, self.recording.indices(self.fit.marker_names)]
        return np.asarray(~visible)


@dataclass(frozen=True, eq=False)
class Accuracy:
    """Errors of a fit over all frames of some recordings.

    Parameters are told in their own unit: 0 is rest, 1 the full gesture.

    Parameters
    ----------
    names
        Parameter names.
    errors
        `(parameters,)`: root mean square error.
    bounds
        `(parameters,)`: what it could not be below; NaN where it was not asked for.
    correlations
        `(parameters,)`: of fit and truth.
    head_shift, head_turn
        Root mean square error of the head's pose: millimetres at the centroid of the reference
        markers, and radians.
    head_shift_bound, head_turn_bound
        What the noise of the reference markers lets these be, at best.
    frames, fitted
        How many frames there were, and how many could be fitted.
    """

    names: tuple[str, ...]
    errors: FloatArray
    bounds: FloatArray
    correlations: FloatArray
    head_shift: float
    head_turn: float
    head_shift_bound: float
    head_turn_bound: float
    frames: int
    fitted: int

    def to_dict(self) -> dict[str, Any]:
        """All the numbers, with their units in their names."""
        return {
            "frames": self.frames,
            "fitted_frames": self.fitted,
            "parameters": {
                name: {
                    "rmse_percent": 100 * float(self.errors[i]),
                    "bound_percent": 100 * float(self.bounds[i]),
                    "ratio": float(self.errors[i] / self.bounds[i]),
                    "correlation": float(self.correlations[i]),
                }
                for i, name in enumerate(self.names)
            },
            "head": {
                "shift_rmse_mm": self.head_shift,
                "shift_bound_mm": self.head_shift_bound,
                "turn_rmse_degrees": float(np.degrees(self.head_turn)),
                "turn_bound_degrees": float(np.degrees(self.head_turn_bound)),
            },
        }


def accuracy(
    recordings: Sequence[FittedRecording],
    binding: Binding,
    noise: float,
    *,
    bounded: bool = True,
    pose_given: bool = False,
) -> Accuracy:
    """Errors over all frames of recordings of one speaker.

    Parameters
    ----------
    recordings
        The fits and their truth.
    binding
        The virtual markers that were fitted.
    noise
        The true standard deviation of a coordinate of a marker, millimetres of the speaker.
    bounded
        Give the Cramér-Rao bound too. It holds where the face that is fitted is the face that
        made the data.
    pose_given
        The true pose of the head was given to the fit, and not found from its markers.
    """
    names = binding.parameter_names
    errors = np.concatenate([r.fit.parameters.values - r.truth.values for r in recordings])
    found = np.concatenate([r.fit.parameters.values for r in recordings])
    true = np.concatenate([r.truth.values for r in recordings])
    bounds = np.full((len(errors), len(names)), np.nan)
    if bounded:
        bounds = np.concatenate(
            [parameter_bounds(r, binding, noise, pose_given=pose_given) for r in recordings]
        )
    # A parameter that no visible marker determines has no bound, and its error says nothing.
    uncertain = np.concatenate([r.fit.parameters.uncertain for r in recordings])
    used = np.isfinite(errors) & ~uncertain
    shifts, turns = (
        np.concatenate(parts)
        for parts in zip(*(pose_errors(r.motion, r.true_pose) for r in recordings), strict=True)
    )
    spread = noise**2 * np.concatenate(
        [np.diagonal(r.motion.covariance, axis1=1, axis2=2) for r in recordings]
    )
    return Accuracy(
        names,
        np.array([_rms(errors[used[:, i], i]) for i in range(len(names))]),
        np.array([_rms(bounds[used[:, i], i]) for i in range(len(names))]),
        np.array(
            [_correlation(found[used[:, i], i], true[used[:, i], i]) for i in range(len(names))]
        ),
        _rms(shifts),
        _rms(turns),
        float(np.sqrt(np.nanmean(spread[:, 3:].sum(axis=1)))),
        float(np.sqrt(np.nanmean(spread[:, :3].sum(axis=1)))),
        len(errors),
        int(np.concatenate([r.fit.fitted for r in recordings]).sum()),
    )


def parameter_bounds(
    recording: FittedRecording, binding: Binding, noise: float, *, pose_given: bool = False
) -> FloatArray:
    """Cramér-Rao bound on the parameters of every frame, as a standard deviation.

    From the Jacobian of the visible markers at the true parameters, propagated through the
    head's pose as the visible reference markers determine it (`mocap_fit.fitting.precision`),
    unless the pose was given.

    Returns
    -------
    FloatArray
        `(frames, parameters)`; NaN where the pose is not known, infinite where the visible
        markers do not determine a parameter.
    """
    bounds = np.full(recording.truth.values.shape, np.nan)
    seen = ~recording.hidden
    names = recording.recording.names
    there = [name in names for name in binding.head_names]
    head_seen = np.zeros((recording.recording.frames, len(there)), dtype=bool)
    head_seen[:, there] = recording.recording.visible[
        :, recording.recording.indices([n for n in binding.head_names if n in names])
    ]
    if pose_given:
        head_seen[:] = False
    sigma = noise * binding.orientation.scale
    for frame in np.flatnonzero(recording.motion.known):
        positions, jacobian = binding.evaluate(recording.truth.values[frame])
        covariance = compute_covariance(
            jacobian[seen[frame]],
            np.ones(int(seen[frame].sum())),
            positions=positions[seen[frame]],
            head_positions=binding.head_positions[head_seen[frame]],
        )
        bounds[frame] = sigma * np.sqrt(np.diag(covariance))
    return bounds


def pose_errors(motion: HeadMotion, truth: PoseTracks) -> tuple[FloatArray, FloatArray]:
    """Error of the head's pose in every frame; NaN where it is not known.

    Returns
    -------
    shifts
        `(frames,)`: how far the centroid of the reference markers is off, millimetres.
    turns
        `(frames,)`: angle between the found rotation and the true one, radians.
    """
    true_rotations, true_translations = truth.rotations[:, 0], truth.translations[:, 0]
    found = motion.rotations @ motion.centre + motion.translations
    true = true_rotations @ motion.centre + true_translations
    shifts = np.linalg.norm(found - true, axis=1)
    turns = np.full(len(shifts), np.nan)
    known = motion.known
    between = np.einsum("fji,fjk->fik", true_rotations[known], motion.rotations[known])
    turns[known] = Rotation.from_matrix(between).magnitude()
    return shifts, turns


def _rms(values: FloatArray) -> float:
    present = values[~np.isnan(values)]
    return float(np.sqrt(np.mean(present**2))) if len(present) else float("nan")


def _correlation(one: FloatArray, other: FloatArray) -> float:
    if len(one) < 2 or not (one.std() > 0 and other.std() > 0):
        return float("nan")
    return float(np.corrcoef(one, other)[0, 1])
