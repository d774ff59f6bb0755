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


@dataclass(frozen=True, eq=False, repr=False)
class HeadMotion:
    """The pose of the head in every frame, and its precision.

    Parameters
    ----------
    pose
        One body, ``head``, whose pose transforms head coordinates (those of the reference pose) to
        the recording; NaN where unknown.
    reference_names
        Names of the reference markers.
    reference
        Reference markers in head coordinates, ``(markers, 3)``, millimetres.
    weights
        Weight of each marker in each frame, ``(frames, markers)``, no unit; 0 where it was missing
        or left out.
    marker_residuals
        Distance of each marker from its position by the pose, ``(frames, markers)``, millimetres;
        also of rejected ones; NaN where missing.
    rejected
        Markers that were seen and left out as bad, ``(frames, markers)``, no unit.
    noise
        Standard deviation of a coordinate of a reference marker of weight 1, estimated from the
        residuals, millimetres; NaN where no frame shows more than three markers.
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
        """Rotations from head coordinates to the recording, ``(frames, 3, 3)``."""
        return self.pose.rotations[:, 0]

    @property
    def translations(self) -> FloatArray:
        """Translations from head coordinates to the recording, ``(frames, 3)``, millimetres."""
        return self.pose.translations[:, 0]

    @property
    def residuals(self) -> FloatArray:
        """Root mean square distance of the markers used from the pose, ``(frames,)``, mm."""
        return self.pose.residuals[:, 0]

    @property
    def known(self) -> NDArray[np.bool_]:
        """Frames whose pose is known, ``(frames,)``."""
        return np.asarray(~np.isnan(self.residuals))

    @property
    def centre(self) -> FloatArray:
        """Centroid of the reference markers in head coordinates, ``(3,)``, millimetres."""
        return np.asarray(self.reference.mean(axis=0))

    @property
    def covariance(self) -> FloatArray:
        """Covariance of the pose per unit variance of a marker coordinate, ``(frames, 6, 6)``.

        The six are, in head coordinates, a small rotation ``ω`` (rotation vector, radians) about
        `centre` and a translation ``τ`` (millimetres), which move a point ``x`` of the head by
        ``ω × (x - centre) + τ``. Multiplied by the variance of a coordinate of a marker of weight
        1 (such as `noise` squared) it is the covariance of the pose's error. It is the inverse of
        ``Σ w [-(p - centre)×, I]ᵀ [-(p - centre)×, I]`` over the markers used in the frame; NaN
        where the pose is unknown.
        """
        information = np.einsum(
            "fp,pab->fab", self.weights, compute_pose_information(self.reference, self.centre)
        )
        covariance = np.full(information.shape, np.nan)
        covariance[self.known] = np.linalg.inv(information[self.known])
        return covariance

    def __repr__(self) -> str:
        lines = [f"HeadMotion: pose known in {self.known.sum()} of {len(self.known)} frames"]
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
        Markers in laboratory coordinates.
    reference
        Reference pose, whose coordinates are head coordinates, millimetres: tracks, whose median
        over the frames is used, or an array ``(markers, 3)`` with a row for each of `names`. By
        default, head coordinates are those of the recording's first frame that shows all
        reference markers.
    names
        Names of three or more reference markers. Those without data are left out with a warning.
        By default all markers of the recording where `reference` is an array; otherwise those
        that `find_reference_markers` chooses among the shared markers, and a warning names them.
    weights
        Marker → weight, above 0, in inverse proportion to the variance of its noise; 1 by default.

    Returns
    -------
    HeadMotion
        Pose of every frame; NaN in frames with fewer than three good markers, or with good markers
        on a line.

    Raises
    ------
    DataError
        If the reference markers are too few, on a line or in one place, differ in size from the
        recording (a unit is wrong), or no frame shows three of them.

    Warns
    -----
    MocapFitWarning
        If markers are left out of all frames, were chosen automatically, or do not have the shape
        of the reference pose.
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
    """Remove the head's motion from a recording.

    Parameters
    ----------
    recording
        Markers in laboratory coordinates.
    reference
        Reference pose, whose coordinates are head coordinates, millimetres: tracks, whose median
        over the frames is used, or an array ``(markers, 3)`` with a row for each of `names`. By
        default, head coordinates are those of the recording's first frame that shows all
        reference markers.
    names
        Names of three or more reference markers, such as those on spectacles; by default they are
        chosen automatically, with a warning.
    weights
        Marker → weight, above 0, in inverse proportion to the variance of its noise; 1 by default.

    Returns
    -------
    MarkerTracks
        All markers in head coordinates; missing in the frames whose pose is unknown.
    HeadMotion
        Motion that was removed; `mocap_fit.head.restore_head_motion` adds it again.

    Raises
    ------
    DataError
        If the reference markers are too few, on a line or in one place, differ in size from the
        recording (a unit is wrong), or no frame shows three of them.

    Warns
    -----
    MocapFitWarning
        If markers are left out of all frames, were chosen automatically, or do not have the shape
        of the reference pose; and if the pose of some frames is unknown.

    See Also
    --------
    fit_shape : Fits the face to a recording in head coordinates.
    fit_speaker : Does all steps for the recordings of a speaker.

    Examples
    --------
    >>> import mocap_fit as mf
    >>> take = mf.read_tracks(mf.load_sample("take_01"))
    >>> rest = mf.read_tracks(mf.load_sample("rest"))
    >>> head = [m.name for m in mf.load_layout("face30-head5").head_markers]
    >>> still, motion = mf.remove_head_motion(take, rest, head)
    >>> still.names == take.names
    True
    >>> motion.translations.shape == (take.frames, 3)
    True
    """
    motion = estimate_head_motion(recording, reference, names, weights)
    positions = apply_inverse_transforms(recording.positions, motion.rotations, motion.translations)
    tracks = _replace_positions(recording, positions, motion)
    step = motion.pose.provenance[-1]
    return tracks.add_step("remove_head_motion", step.arguments), motion


def match_size(
    recording: MarkerTracks, reference: MarkerTracks, names: Sequence[str]
) -> tuple[MarkerTracks, float]:
    """Scale a recording to the size of the reference pose.

    For landmarks of a video, whose scale is unknown and differs from one recording to the next;
    markers that a camera system measures have the right size.

    Parameters
    ----------
    recording
        Markers in any coordinates.
    reference
        Reference pose, whose median over the frames is used.
    names
        Names of two or more markers that are rigid with the head.

    Returns
    -------
    MarkerTracks
        Recording, with all positions divided by the factor.
    float
        Size of the recording over that of the reference: the median over the frames of the ratio
        of the distances between the reference markers.

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
    """Restore the head's motion: transform head coordinates to laboratory coordinates.

    Parameters
    ----------
    tracks
        Any markers in head coordinates, in the frames of the motion.
    motion
        Motion of the head, from `remove_head_motion`.

    Returns
    -------
    MarkerTracks
        Markers in laboratory coordinates; missing in frames whose pose is unknown.

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
    """Replace positions; warn of frames whose markers are lost because the pose is unknown."""
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
