"""The reference markers of the head's pose: choose them, check them, report on them."""

from __future__ import annotations

import warnings
import weakref
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike

from mocap_fit.errors import DataError, MocapFitWarning
from mocap_fit.tracks import FloatArray, MarkerTracks
from mocap_fit.tracks.rigid import compute_spread, describe_degeneracy
from mocap_fit.tracks.rigid_sets import compute_mean_shape, find_reference_markers
from mocap_fit.tracks.robust import RigidFit, sample_evenly

# Reference and recording must agree in size within this factor, or a unit is wrong.
_LARGEST_RATIO = 2.0
# Powers of ten of a millimetre.
_UNITS = {1: "centimetres", 2: "decimetres", 3: "metres"}
# A residual above this part of the set's length means another shape, not noise.
_LARGEST_RESIDUAL = 0.1
# Largest number of frames whose sizes are compared.
_SAMPLE = 2000


def check_reference_markers(names: Sequence[str], shape: FloatArray, positions: FloatArray) -> None:
    """Refuse a recording whose reference markers cannot have the pose of the reference.

    Parameters
    ----------
    names
        Names of the reference markers.
    shape
        Reference pose, ``(markers, 3)``, millimetres.
    positions
        Reference markers in the recording, ``(frames, markers, 3)``, millimetres; NaN is missing.

    Raises
    ------
    DataError
        If no frame shows three markers, or a unit is wrong.
    """
    most = int((~np.isnan(positions[:, :, 0])).sum(axis=1).max(initial=0))
    if most < 3:
        raise DataError(
            "no frame shows three reference markers",
            found=f"at most {most}",
            expected=f"three or more of {', '.join(names)}",
        )
    check_sizes(names, shape, positions)


def check_fit(
    names: Sequence[str], shape: FloatArray, positions: FloatArray, fit: RigidFit
) -> None:
    """Warn of reference markers that do not keep the shape of the reference pose.

    Parameters
    ----------
    names
        Names of the reference markers.
    shape
        Reference pose, ``(markers, 3)``, millimetres.
    positions
        Reference markers in the recording, ``(frames, markers, 3)``, millimetres; NaN is missing.
    fit
        Their rigid transforms.

    Raises
    ------
    DataError
        If no frame has a pose.

    Warns
    -----
    MocapFitWarning
        If a marker is left out of most frames, or the residuals are large.
    """
    if np.isnan(fit.residuals).all():
        raise DataError(
            "the head's pose cannot be found in any frame",
            found="the reference markers that are seen together lie on a line, or contradict "
            "each other",
            expected="three or more good markers that are not on a line",
        )
    all_rejected = fit.rejected.sum(axis=0)
    all_seen = (~np.isnan(positions[:, :, 0])).sum(axis=0)
    moved = [
        f"{name} ({rejected} of {seen} frames)"
        for name, rejected, seen in zip(names, all_rejected, all_seen, strict=True)
        if 2 * rejected > seen
    ]
    if moved:
        warnings.warn(
            "reference markers are not where the reference pose has them and are left out: "
            + ", ".join(moved),
            MocapFitWarning,
            stacklevel=4,
        )
    residual, length = float(np.nanmedian(fit.residuals)), float(compute_spread(shape)[0])
    if residual > _LARGEST_RESIDUAL * length:
        warnings.warn(
            f"the reference markers {', '.join(names)} do not keep the shape of the "
            f"reference pose (median residual {residual:.3g} mm in a set {length:.3g} mm long, "
            "root mean square); markers may be exchanged, or an axis mirrored",
            MocapFitWarning,
            stacklevel=4,
        )


def check_weights(
    names: Sequence[str], shape: FloatArray, weights: Mapping[str, float] | None, known: set[str]
) -> FloatArray:
    """Check that reference markers determine a pose, and return their weights.

    Parameters
    ----------
    names
        Names of the reference markers.
    shape
        Reference pose, ``(markers, 3)``, millimetres.
    weights
        Marker → weight, above 0; 1 by default.
    known
        Further markers, whose weights are ignored.

    Returns
    -------
    ndarray
        Weights, ``(markers,)``.

    Raises
    ------
    DataError
        If the markers do not determine a rotation, or a weight is out of range.
    """
    reason = describe_degeneracy(shape)
    if reason is not None:
        raise DataError(
            f"the reference markers {', '.join(names)} do not determine the head's rotation",
            found=reason,
            expected="three or more markers that are not on a line",
            advice="Use markers that are further apart.",
        )
    weights = dict(weights or {})
    unknown = [name for name in weights if name not in {*names, *known}]
    if unknown:
        raise DataError("a weight is given for an unknown marker", found=", ".join(unknown))
    base = np.array([weights.get(name, 1.0) for name in names])
    if not (np.isfinite(base) & (base > 0)).all():
        raise DataError(
            "a weight is out of range",
            found=", ".join(f"{n} {w:g}" for n, w in zip(names, base, strict=True)),
            expected="numbers above 0",
        )
    return base


def choose_reference(
    recording: MarkerTracks, reference: MarkerTracks | ArrayLike | None, names: Sequence[str] | None
) -> tuple[tuple[str, ...], FloatArray]:
    """Choose the reference markers.

    Parameters
    ----------
    recording
        Recording whose head motion is estimated.
    reference
        Reference pose: tracks, or positions ``(markers, 3)``, millimetres, or None for the
        recording's own shape.
    names
        Names of the reference markers; None to choose them automatically.

    Returns
    -------
    names : tuple of str
        Markers that both recording and reference have.
    shape : ndarray
        Their positions in head coordinates, ``(markers, 3)``, millimetres.

    Raises
    ------
    DataError
        If fewer than three markers can be used.

    Warns
    -----
    MocapFitWarning
        If markers are left out or were chosen automatically.
    """
    if names is not None and len(set(names)) != len(names):
        raise DataError("a reference marker is named twice", found=", ".join(names))
    if reference is not None and not isinstance(reference, MarkerTracks):
        chosen = recording.names if names is None else tuple(names)
        points = np.asarray(reference, dtype=np.float64)
        if points.shape != (len(chosen), 3):
            raise DataError(
                "the reference pose has the wrong shape",
                found=points.shape,
                expected=f"({len(chosen)}, 3), a row for each of {', '.join(chosen)}",
            )
        pose = dict(zip(chosen, points, strict=True))
    elif reference is not None:
        pose = compute_median_pose(reference)
        if names is None:
            shared = tuple(name for name in recording.names if name in pose)
            if len(shared) < 3:
                raise DataError(
                    "recording and reference pose share too few markers",
                    found=", ".join(shared) or "none",
                    expected=f"three or more of {', '.join(reference.names)}",
                )
            chosen = _choose_markers(recording.select(shared))
        else:
            chosen = tuple(names)
    else:
        chosen = _choose_markers(recording) if names is None else tuple(names)
        known = tuple(name for name in chosen if name in recording.names)
        shape = compute_mean_shape(recording.select(known).positions) if known else np.zeros((0, 3))
        pose = dict(zip(known, shape, strict=True))
    lacking = [
        name
        for name in chosen
        if name not in pose
        or np.isnan(pose[name]).any()
        or name not in recording.names
        or not recording.visible[:, recording.index(name)].any()
    ]
    usable = tuple(name for name in chosen if name not in lacking)
    if len(usable) < 3:
        raise DataError(
            "too few reference markers are in both the recording and the reference pose",
            found=", ".join(usable) or "none",
            expected=f"three or more of {', '.join(chosen)}",
            advice="Check the marker names.",
        )
    if lacking:
        warnings.warn(
            f"reference markers without data are left out: {', '.join(lacking)}",
            MocapFitWarning,
            stacklevel=4,
        )
    return usable, np.array([pose[name] for name in usable])


# All recordings of a speaker have one reference pose.
_medians: weakref.WeakKeyDictionary[MarkerTracks, dict[str, FloatArray]] = (
    weakref.WeakKeyDictionary()
)


def compute_median_pose(reference: MarkerTracks) -> dict[str, FloatArray]:
    """Compute the median position of every marker over the frames of a recording.

    Parameters
    ----------
    reference
        Recording of the reference pose.

    Returns
    -------
    dict
        Marker → ``(3,)``, millimetres, without markers that are never seen.
    """
    if reference not in _medians:
        seen = np.flatnonzero(reference.visible.any(axis=0))
        medians = np.nanmedian(reference.positions[:, seen], axis=0)
        names = [reference.names[i] for i in seen]
        _medians[reference] = dict(zip(names, medians, strict=True))
    return _medians[reference]


def _choose_markers(recording: MarkerTracks) -> tuple[str, ...]:
    """Choose reference markers automatically, with a warning."""
    chosen = find_reference_markers(recording)
    if len(chosen) < len(recording.names):
        warnings.warn(
            "no reference markers are named; those that move least relative to each other are "
            f"used: {', '.join(chosen)}",
            MocapFitWarning,
            stacklevel=5,
        )
    return chosen


def check_sizes(names: Sequence[str], shape: FloatArray, positions: FloatArray) -> None:
    """Refuse a recording whose unit differs from that of the reference pose.

    Parameters
    ----------
    names
        Names of the reference markers.
    shape
        Reference pose, ``(markers, 3)``, millimetres.
    positions
        Reference markers in the recording, ``(frames, markers, 3)``, millimetres.

    Raises
    ------
    DataError
        If the median ratio of their distances is not between 0.5 and 2.
    """
    sample = sample_evenly(positions, _SAMPLE)
    first, second = np.triu_indices(len(names), 1)
    distances = np.linalg.norm(sample[:, first] - sample[:, second], axis=2)
    expected = np.linalg.norm(shape[first] - shape[second], axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratios = distances / expected
    ratios = ratios[np.isfinite(ratios)]
    if not ratios.size:
        return
    ratio = float(np.median(ratios))
    if 1 / _LARGEST_RATIO <= ratio <= _LARGEST_RATIO:
        return
    if ratio == 0:
        raise DataError(
            "the reference markers are all in one place in the recording",
            found="distances of 0 mm between them",
            expected=f"about {np.median(expected):.3g} mm, as in the reference pose",
            advice="Check the export of the recording, and the marker names.",
        )
    advice = "Check that both are of the same speaker and in millimetres."
    power = round(np.log10(ratio))
    if abs(power) in _UNITS:
        what, unit = "reference pose" if power > 0 else "recording", _UNITS[abs(power)]
        advice = (
            f"It seems that the {what} is in {unit}: give its unit (unit=... of read_tracks; "
            "--unit, and --reference-as-is where the reference pose is in millimetres)."
        )
    raise DataError(
        "recording and reference pose differ in size",
        found=f"distances in the recording are {ratio:.4g} times those of the reference pose",
        expected=f"{1 / _LARGEST_RATIO:g} to {_LARGEST_RATIO:g} times",
        advice=advice,
    )
