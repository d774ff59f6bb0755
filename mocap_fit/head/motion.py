"""Rigid head motion: estimate it, remove it, put it back.

The pose of the head in every frame comes from reference markers that move with the skull and not
with the face (spectacles, forehead, behind the ears), by weighted least squares that leave a bad
marker out (`mocap_fit.tracks.robust`). Head coordinates are those of the reference pose.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mocap_fit.errors import DataError, MocapFitWarning
from mocap_fit.head.reference import (
    check_fit,
    check_reference_markers,
    check_sizes,
    check_weights,
    choose_reference,
)
from mocap_fit.tracks import FloatArray, MarkerTracks, Origin, PoseTracks
from mocap_fit.tracks.rigid import apply_inverse_transforms, apply_transforms
from mocap_fit.tracks.robust import compute_pose_information, estimate_robust_transforms


@dataclass(frozen=True, eq=False)
class HeadMotion:
    """The pose of the head in every frame, and how well it is known.

    Parameters
    ----------
    pose
        One body, ``head``; rotation and translation take head coordinates (those of the
        reference pose) to the recording. NaN where it is not known.
    reference_names
        The reference markers.
    reference
        `(markers, 3)`: where they are in head coordinates, millimetres.
    weights
        `(frames, markers)`: the weight of each marker in each frame; 0 where it was missing or
        left out.
    marker_residuals
        `(frames, markers)`: distance of each marker from where the pose puts it, millimetres;
        also of those that were left out; NaN where missing.
    rejected
        `(frames, markers)`: seen, but judged bad and left out.
    noise
        Standard deviation of a coordinate of a reference marker of weight 1, learnt from the
        residuals, millimetres; NaN where three markers at most are seen.
    """

    pose: PoseTracks
    reference_names: tuple[str, ...]
    reference: FloatArray
    weights: FloatArray
    marker_residuals: FloatArray
    rejected: NDArray[np.bool_]
    noise: float

    @property
    def rotations(self) -> FloatArray:
        """`(frames, 3, 3)`, head coordinates to the recording."""
        return self.pose.rotations[:, 0]

    @property
    def translations(self) -> FloatArray:
        """`(frames, 3)`, millimetres."""
        return self.pose.translations[:, 0]

    @property
    def residuals(self) -> FloatArray:
        """`(frames,)`: root mean square distance of the markers used from the pose, mm."""
        return self.pose.residuals[:, 0]

    @property
    def known(self) -> NDArray[np.bool_]:
        """Frames whose pose is known, `(frames,)`."""
        return np.asarray(~np.isnan(self.residuals))

    @property
    def centre(self) -> FloatArray:
        """Centroid of the reference markers in head coordinates, `(3,)`, millimetres."""
        return np.asarray(self.reference.mean(axis=0))

    @property
    def covariance(self) -> FloatArray:
        """Covariance of the pose per unit variance of a marker coordinate, `(frames, 6, 6)`.

        In head coordinates: a small turn ``ω`` (rotation vector, radians) about `centre`, then a
        shift ``τ`` (millimetres), which move a point ``x`` of the head by
        ``ω × (x - centre) + τ``. Times the variance of a coordinate of a marker of weight 1 (such
        as `noise` squared) it is the covariance of the pose's error. It is the inverse of
        ``Σ w [-(p - centre)×, I]ᵀ [-(p - centre)×, I]`` over the markers used in the frame; NaN
        where the pose is not known.
        """
        information = np.einsum(
            "fp,pab->fab", self.weights, compute_pose_information(self.reference, self.centre)
        )
        covariance = np.full(information.shape, np.nan)
        covariance[self.known] = np.linalg.inv(information[self.known])
        return covariance

    def __str__(self) -> str:
        """Markers, frames, residuals, and what was left out when."""
        lines = [f"head pose known in {self.known.sum()} of {len(self.known)} frames"]
        if self.known.any():
            middle, worst = np.nanmedian(self.residuals), np.nanmax(self.residuals)
            lines[0] += f", residual {middle:.3g} mm (median), {worst:.3g} mm (largest)"
        for index, name in enumerate(self.reference_names):
            residuals = self.marker_residuals[:, index]
            line = f"  {name}: never seen"
            if not np.isnan(residuals).all():
                line = f"  {name}: {np.nanmedian(residuals):.3g} mm (median)"
            when = np.flatnonzero(self.rejected[:, index])
            if len(when):
                line += f"; left out in {len(when)} frames, first {when[0]}, last {when[-1]}"
            lines.append(line)
        return "\n".join(lines)


def estimate_head_motion(
    recording: MarkerTracks,
    reference: MarkerTracks | ArrayLike | None = None,
    names: Sequence[str] | None = None,
    weights: Mapping[str, float] | None = None,
) -> HeadMotion:
    """Estimate the pose of the head in every frame.

    Parameters
    ----------
    recording
        Markers in the coordinates of the room.
    reference
        The reference pose, whose coordinates are head coordinates: tracks (the median over their
        frames is used) or `(markers, 3)` with a row for each of `names`. When not given, head
        coordinates are those of the recording's first frame that shows all reference markers.
    names
        The reference markers; three suffice. Those without data are left out with a warning. When
        not given: all of the recording, where `reference` is an array; otherwise those that
        `find_reference_markers` finds among the markers that recording and reference share, and
        a warning names them.
    weights
        Marker → weight, above 0, in inverse proportion to the variance of its noise; 1 where not
        given.

    Returns
    -------
    HeadMotion
        Frames with fewer than three good markers, or with good markers on a line, have NaN.

    Raises
    ------
    DataError
        If the reference markers are too few, on a line or in one place, differ in size from the
        recording (a unit is wrong), or are together in no frame.

    Warns
    -----
    MocapFitWarning
        If markers are left out throughout, or were found and not named, or if they do not have
        the shape of the reference pose.
    """
    chosen, shape = choose_reference(recording, reference, names)
    base = check_weights(chosen, shape, weights, {*recording.names, *(names or ())})
    positions = recording.positions[:, recording.indices(chosen)]
    check_reference_markers(chosen, shape, positions)
    fit = estimate_robust_transforms(shape, positions, base)
    check_fit(chosen, shape, positions, fit)
    expected = np.einsum("fij,pj->fpi", fit.rotations, shape) + fit.translations[:, None, :]
    arguments: dict[str, object] = {"reference_markers": list(chosen)}
    if weights:
        arguments["weights"] = dict(zip(chosen, base.tolist(), strict=True))
    pose = PoseTracks(
        ("head",),
        recording.rate,
        fit.rotations[:, None],
        fit.translations[:, None],
        fit.residuals[:, None],
        start_time=recording.start_time,
        name=recording.name,
        events=recording.events,
        provenance=recording.provenance,
    ).add_step("estimate_head_motion", arguments)
    return HeadMotion(
        pose,
        chosen,
        shape,
        fit.weights,
        np.linalg.norm(positions - expected, axis=2),
        fit.rejected,
        fit.noise,
    )


def remove_head_motion(
    recording: MarkerTracks,
    reference: MarkerTracks | ArrayLike | None = None,
    names: Sequence[str] | None = None,
    weights: Mapping[str, float] | None = None,
) -> tuple[MarkerTracks, HeadMotion]:
    """Give the recording in head coordinates, and the motion, so that it can be put back.

    Parameters
    ----------
    recording, reference, names, weights
        As for `estimate_head_motion`.

    Returns
    -------
    MarkerTracks
        All markers in head coordinates; missing in the frames whose pose is not known.
    HeadMotion
        What was removed.

    Raises
    ------
    DataError
        As for `estimate_head_motion`.

    Warns
    -----
    MocapFitWarning
        Also if the pose of some frames is not known.
    """
    motion = estimate_head_motion(recording, reference, names, weights)
    positions = apply_inverse_transforms(recording.positions, motion.rotations, motion.translations)
    tracks = _replace_positions(recording, positions, motion)
    step = motion.pose.provenance[-1]
    return tracks.add_step("remove_head_motion", step.arguments), motion


def match_size(
    recording: MarkerTracks, reference: MarkerTracks, names: Sequence[str]
) -> tuple[MarkerTracks, float]:
    """Bring a recording to the size of the reference pose.

    For landmarks of a video, whose scale is not known and differs from one recording to the
    next; markers that a camera system measures have a size already.

    Parameters
    ----------
    recording
        Markers in any coordinates.
    reference
        The reference pose (the median over its frames is used).
    names
        Markers that are rigid with the head, two or more.

    Returns
    -------
    MarkerTracks
        The recording, all positions divided by the factor.
    float
        How many times larger it was: the median over the frames of the ratio of the distances
        between the reference markers.

    Raises
    ------
    DataError
        If no frame shows two of the markers, or the sizes differ so much that a unit is wrong.
    """
    chosen, shape = choose_reference(recording, reference, names)
    positions = recording.positions[:, recording.indices(chosen)]
    one, other = np.triu_indices(len(chosen), 1)
    check_sizes(chosen, shape, positions)
    apart = np.linalg.norm(positions[:, one] - positions[:, other], axis=2)
    expected = np.linalg.norm(shape[one] - shape[other], axis=1)
    seen = ~np.isnan(apart)
    frames = seen.any(axis=1)
    if not frames.any():
        raise DataError(
            "no frame shows two reference markers", expected=f"two or more of {', '.join(chosen)}"
        )
    total = np.where(seen, apart, 0.0).sum(axis=1)[frames]
    factor = float(np.median(total / np.where(seen, expected, 0.0).sum(axis=1)[frames]))
    matched = recording.replace(positions=recording.positions / factor)
    return matched.add_step("match_size", {"factor": factor}), factor


def restore_head_motion(tracks: MarkerTracks, motion: HeadMotion) -> MarkerTracks:
    """Put the head's motion back: from head coordinates to the room.

    Parameters
    ----------
    tracks
        Markers in head coordinates, any markers, in the frames of the motion.
    motion
        What `remove_head_motion` removed.

    Raises
    ------
    DataError
        If tracks and motion differ in frames, rate or start time.
    """
    pose = motion.pose
    ours = (tracks.frames, tracks.rate, tracks.start_time)
    theirs = (pose.frames, pose.rate, pose.start_time)
    if ours[0] != theirs[0] or not np.allclose(ours[1:], theirs[1:], rtol=1e-9, atol=1e-9):
        raise DataError(
            "tracks and head motion are not of the same frames",
            found="{} frames, {:g} Hz, from {:g} s".format(*ours),
            expected="{} frames, {:g} Hz, from {:g} s".format(*theirs),
        )
    positions = apply_transforms(tracks.positions, motion.rotations, motion.translations)
    return _replace_positions(tracks, positions, motion).add_step(
        "restore_head_motion", {"reference_markers": list(motion.reference_names)}
    )


def _replace_positions(
    tracks: MarkerTracks, positions: FloatArray, motion: HeadMotion
) -> MarkerTracks:
    """Tracks with other positions; a warning counts the frames that are lost with their pose."""
    lost = ~motion.known & tracks.visible.any(axis=1)
    if lost.any():
        warnings.warn(
            f"the head's pose is not known in {lost.sum()} of {tracks.frames} frames "
            f"(first {np.argmax(lost)}): their markers count as missing",
            MocapFitWarning,
            stacklevel=3,
        )
    origin = np.where(motion.known[:, None], tracks.origin, Origin.MISSING).astype(np.uint8)
    return tracks.replace(positions=positions, origin=origin)
