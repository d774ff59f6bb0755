"""Compare a fit with the truth of a simulation: errors, their bounds, and intervals."""

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
    """A simulated recording, its fit and its truth.

    Parameters
    ----------
    recording
        The markers as they were recorded.
    fit
        The fitted face parameters.
    motion
        The estimated motion of the head.
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
        """The markers without the estimated head motion, ``(frames, markers, 3)``, millimetres."""
        positions, motion = self.recording.positions, self.motion
        return apply_inverse_transforms(positions, motion.rotations, motion.translations)

    @property
    def hidden(self) -> NDArray[np.bool_]:
        """Which samples of the face markers are missing, ``(frames, face markers)``."""
        visible = self.recording.visible[:, self.recording.indices(self.fit.marker_names)]
        return np.asarray(~visible)


@dataclass(frozen=True, eq=False)
class Accuracy:
    """Errors of a fit over all frames of some recordings.

    The unit of the parameters: 0 is rest, 1 the full gesture.

    Parameters
    ----------
    names
        Parameter names.
    errors
        Root mean square errors, ``(parameters,)``, full gestures.
    bounds
        Cramér-Rao bounds of single frames, ``(parameters,)``, full gestures; NaN where not
        computed.
    correlations
        Correlations of fit and truth, ``(parameters,)``, -1 to 1.
    head_shift, head_turn
        Root mean square error of the head's pose: millimetres at the centroid of the reference
        markers, and radians.
    head_shift_bound, head_turn_bound
        Cramér-Rao bounds of these in single frames, from the noise of the reference markers,
        millimetres and radians.
    frames, fitted
        Number of frames, and of those that were fitted.
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
        """Return all numbers, with their units in their names.

        Returns
        -------
        dict[str, Any]
            As JSON can hold it.
        """
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


def measure_accuracy(
    recordings: Sequence[FittedRecording],
    binding: Binding,
    noise: float,
    *,
    bounded: bool = True,
    pose_known: bool = False,
) -> Accuracy:
    """Measure the errors over all frames of recordings of one speaker.

    Parameters
    ----------
    recordings
        The fits and their truth.
    binding
        The virtual markers that were fitted.
    noise
        Standard deviation of a coordinate of a marker, the speaker's millimetres.
    bounded
        Whether the Cramér-Rao bound is computed too. It holds where the face that is fitted is the
        face that made the data.
    pose_known
        Whether the fit used the true pose of the head, and did not estimate it from its markers.

    Returns
    -------
    Accuracy
        The errors.
    """
    names = binding.parameter_names
    errors = np.concatenate([r.fit.parameters.values - r.truth.values for r in recordings])
    fitted = np.concatenate([r.fit.parameters.values for r in recordings])
    true = np.concatenate([r.truth.values for r in recordings])
    bounds = np.full((len(errors), len(names)), np.nan)
    if bounded:
        bounds = np.concatenate(
            [compute_bounds(r, binding, noise, pose_known=pose_known) for r in recordings]
        )
    # A parameter that no visible marker determines has no bound, and its error says nothing.
    uncertain = np.concatenate([r.fit.parameters.uncertain for r in recordings])
    used = np.isfinite(errors) & ~uncertain
    pose_errors = [compute_pose_errors(r.motion, r.true_pose) for r in recordings]
    shifts, turns = map(np.concatenate, zip(*pose_errors, strict=True))
    spread = noise**2 * np.concatenate(
        [np.diagonal(r.motion.covariance, axis1=1, axis2=2) for r in recordings]
    )
    columns = [(used[:, i], i) for i in range(len(names))]
    return Accuracy(
        names,
        np.array([_rms(errors[column]) for column in columns]),
        np.array([_rms(bounds[column]) for column in columns]),
        np.array([_correlate(fitted[column], true[column]) for column in columns]),
        _rms(shifts),
        _rms(turns),
        float(np.sqrt(np.nanmean(spread[:, 3:].sum(axis=1)))),
        float(np.sqrt(np.nanmean(spread[:, :3].sum(axis=1)))),
        len(errors),
        int(np.concatenate([r.fit.fitted for r in recordings]).sum()),
    )


def measure_coverage(recordings: Sequence[FittedRecording], binding: Binding) -> FloatArray:
    """Measure how often the 95 % intervals of the parameters contain the truth.

    Parameters
    ----------
    recordings
        The fits and their truth.
    binding
        The virtual markers that were fitted.

    Returns
    -------
    ndarray
        Part of the true values that lie inside the parameter's bounds, ``(parameters,)``, 0 to 1.
    """
    fitted = [r.fit.parameters for r in recordings]
    true = np.concatenate([r.truth.values for r in recordings])
    errors = np.concatenate([tracks.values for tracks in fitted]) - true
    deviations = np.concatenate([tracks.standard_deviations for tracks in fitted])
    lower, upper = binding.rig.bounds.T
    used = np.isfinite(errors) & np.isfinite(deviations) & (true > lower) & (true < upper)
    covered = used & (np.abs(errors) <= 1.96 * deviations)
    return np.asarray(covered.sum(axis=0) / used.sum(axis=0))


def compute_bounds(
    recording: FittedRecording, binding: Binding, noise: float, *, pose_known: bool = False
) -> FloatArray:
    """Compute the Cramér-Rao bound on the parameters of each frame alone, a standard deviation.

    It binds what knows nothing but the frame: smoothness, or a pose from all markers, goes below.
    From the Jacobian of the visible markers at the true parameters, propagated through the
    head's pose as the visible reference markers determine it (`mocap_fit.fitting.precision`),
    unless the pose was known.

    Parameters
    ----------
    recording
        The fit and its truth.
    binding
        The virtual markers that were fitted.
    noise
        Standard deviation of a coordinate of a marker, the speaker's millimetres.
    pose_known
        Whether the fit used the true pose of the head.

    Returns
    -------
    ndarray
        Bounds, ``(frames, parameters)``, full gestures; NaN where the pose is not known, infinite
        where the visible markers do not determine a parameter.
    """
    bounds = np.full(recording.truth.values.shape, np.nan)
    seen = ~recording.hidden
    names = recording.recording.names
    present = [name in names for name in binding.head_names]
    head_seen = np.zeros((recording.recording.frames, len(present)), dtype=bool)
    head_seen[:, present] = recording.recording.visible[
        :, recording.recording.indices([n for n in binding.head_names if n in names])
    ]
    if pose_known:
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


def compute_pose_errors(motion: HeadMotion, truth: PoseTracks) -> tuple[FloatArray, FloatArray]:
    """Compute the error of the head's pose in every frame; NaN where it is not known.

    Parameters
    ----------
    motion
        The estimated motion.
    truth
        The true one.

    Returns
    -------
    shifts
        Distances between the centroids of the reference markers, ``(frames,)``, millimetres.
    turns
        Angles between the estimated rotation and the true one, ``(frames,)``, radians.
    """
    true_rotations, true_translations = truth.rotations[:, 0], truth.translations[:, 0]
    estimated = motion.rotations @ motion.centre + motion.translations
    true = true_rotations @ motion.centre + true_translations
    shifts = np.linalg.norm(estimated - true, axis=1)
    turns = np.full(len(shifts), np.nan)
    known = motion.known
    between = np.einsum("fji,fjk->fik", true_rotations[known], motion.rotations[known])
    turns[known] = Rotation.from_matrix(between).magnitude()
    return shifts, turns


def _rms(values: FloatArray) -> float:
    present = values[~np.isnan(values)]
    return float(np.sqrt(np.mean(present**2))) if len(present) else float("nan")


def _correlate(one: FloatArray, other: FloatArray) -> float:
    if len(one) < 2 or not (one.std() > 0 and other.std() > 0):
        return float("nan")
    return float(np.corrcoef(one, other)[0, 1])
