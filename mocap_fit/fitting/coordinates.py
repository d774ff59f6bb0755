"""Left and right, axes and unit of reference poses and recordings, before anything is fitted.

The handedness rule is that of `align_shapes`: a set of markers is mirrored where the mirror image
of the expected shape fits it clearly better. A reference pose is compared with the layout's face on
the built-in head, a recording with its reference pose.
"""

from __future__ import annotations

import functools
import warnings
from collections.abc import Sequence

import numpy as np

from mocap_fit.errors import ConfigurationError, DataError, MocapFitWarning
from mocap_fit.face.mesh import Mesh
from mocap_fit.fitting.layout import Layout
from mocap_fit.head.alignment import (
    align_shapes,
    compute_angle,
    describe_axes,
    describe_directions,
    describe_reflection,
    find_reflection,
    guess_unit,
    is_flat,
)
from mocap_fit.head.reference import compute_median_pose
from mocap_fit.tracks import FloatArray, MarkerTracks
from mocap_fit.tracks.rigid import (
    compute_spread,
    estimate_rigid_transforms,
    estimate_similarity_transform,
    project_to_rotations,
)
from mocap_fit.tracks.rigid_sets import compute_typical_shape
from mocap_fit.tracks.robust import sample_evenly

_FACE_SIZES = (0.6, 1.6)
"""Times the size of the layout's face: beyond, it is hardly a face in millimetres."""

_POSSIBLE_SIZES = (0.2, 5.0)
"""Beyond, the unit is wrong."""

_SAME_SIZE = 0.1
"""Part that a recording may be larger or smaller than the reference pose of the speaker."""

_CONSIDERED = 1000
"""Frames of a recording among which those are chosen."""

_NEAR = 0.5
"""Part of a limit within which nothing has to be looked at more closely."""

_OTHER_UNIT = 0.5
"""Part beyond which it is no matter of the speaker."""

_TURNED = 60.0
"""Degrees between the reference pose and a recording: beyond, axes are probably exchanged."""

_SAMPLE = 5
"""Frames that tell the shape of a recording, of those that show most markers."""

_MENDING = (
    "If the names of left and right are exchanged, rename them (--rename LEFT=RIGHT "
    "--rename RIGHT=LEFT, and --reference-as-is where the reference pose is right); if an axis is "
    "turned round or two are exchanged, export it with axes of a right hand, or have it mirrored "
    "(--allow-mirrored; allow_mirrored=True in Python)."
)


def check_reference(
    layout: Layout, reference: MarkerTracks, *, allow_mirrored: bool = False
) -> MarkerTracks:
    """Check the reference pose against the face of the layout.

    Parameters
    ----------
    layout
        The marker layout.
    reference
        The reference pose, with the names of the layout.
    allow_mirrored
        Whether a mirror image is turned round, and not refused.

    Returns
    -------
    MarkerTracks
        The reference pose, of a right hand.

    Raises
    ------
    DataError
        If it is a face's mirror image, or its unit is wrong.

    Warns
    -----
    MocapFitWarning
        If left and right cannot be checked, it was turned round, or the size is unusual.
    """
    pose = compute_median_pose(reference)
    names = [marker.name for marker in layout.markers if marker.name in pose]
    points, expected = np.array([pose[n] for n in names]), locate_expected(layout, names)
    both = ~np.isnan(expected).any(axis=1)
    points, expected = points[both], expected[both]
    fit = None if is_flat(expected) else align_shapes(expected, points)
    if fit is not None:
        _check_face_size(fit.scale, layout.size_varies, reference.name)
    if fit is None or is_flat(points):
        _warn(
            f"{reference.name}: whether left and right are exchanged cannot be tested: the markers "
            f"of the layout '{layout.name}' are nearly in one plane in the reference pose, or it "
            "says of fewer than four where they are"
        )
        return reference
    if not fit.mirrored:
        return reference
    # Where its axes should point nobody knows; up is most often y or z.
    return _mirror(
        reference,
        "the reference pose is a face's mirror image",
        describe_directions(fit.matrix),
        np.diag([-1.0, 1.0, 1.0]),
        allow_mirrored,
    )


def check_recording(
    layout: Layout,
    reference: MarkerTracks,
    recording: MarkerTracks,
    *,
    allow_mirrored: bool = False,
) -> MarkerTracks:
    """Check the shape of a recording against the reference pose.

    Parameters
    ----------
    layout
        The marker layout.
    reference
        The reference pose, from `check_reference`.
    recording
        The recording, with the names of the layout.
    allow_mirrored
        Whether a mirror image is turned round, and not refused.

    Returns
    -------
    MarkerTracks
        The recording, of the hand of the reference pose.

    Raises
    ------
    DataError
        If it is the mirror image of the reference pose.

    Warns
    -----
    MocapFitWarning
        If it was turned round, or its size or its axes are others than those of the reference
        pose.
    """
    pose = compute_median_pose(reference)
    names = [m.name for m in layout.markers if m.name in pose and m.name in recording.names]
    points = np.array([pose[name] for name in names]).reshape(-1, 3)
    if is_flat(points) or not recording.frames:
        return recording
    some = sample_evenly(recording.positions, _CONSIDERED)
    positions = some[:, recording.indices(names)]
    counts = (~np.isnan(positions[:, :, 0])).sum(axis=1)
    most = int(counts.max())
    if most >= 4 and _is_alike(points, positions[int(np.argmax(counts))], layout.size_varies):
        return recording
    shape = compute_typical_shape(sample_evenly(positions[counts == most], _SAMPLE))
    fit = align_shapes(points, shape)
    if fit is None:
        return recording
    if fit.mirrored:
        return _mirror(
            recording,
            "the recording is a mirror image of the reference pose",
            describe_reflection(fit, points, shape)[1],
            find_reflection(fit.matrix).T,
            allow_mirrored,
        )
    if not layout.size_varies:
        _check_size(fit.scale)
    if compute_angle(fit.matrix) > _TURNED:
        _check_axes(fit.scale * points, positions)
    return recording


def _is_alike(points: FloatArray, frame: FloatArray, varies: bool) -> bool:
    """Whether one frame shows at once that nothing is mirrored, turned or of another size.

    The mirror image of a set is twice its depth away from it, root mean square: what is nearer to
    the set than its depth is nearer to it than to the mirror image.
    """
    both = ~(np.isnan(points) | np.isnan(frame)).any(axis=1)
    points, frame = points[both], frame[both]
    if is_flat(points) or is_flat(frame):
        return False
    scale, rotation, shift = estimate_similarity_transform(points, frame)
    off = frame - scale * points @ rotation.T - shift
    misfit = float(np.sqrt((off**2).sum(axis=1).mean()))
    return (
        misfit < _NEAR * scale * compute_spread(points)[2]
        and (varies or abs(scale - 1.0) < _NEAR * _SAME_SIZE)
        and compute_angle(rotation) < _TURNED
    )


def _mirror(
    tracks: MarkerTracks, problem: str, axes: str, matrix: FloatArray, allowed: bool
) -> MarkerTracks:
    """Return tracks with other axes, or refuse them."""
    if not allowed:
        expected = "axes of a right hand, and the speaker's own left and right"
        raise DataError(problem, found=axes, expected=expected, advice=_MENDING)
    _warn(f"{problem} ({axes}), and is mirrored back")
    # Axes alone are exchanged and turned round: not a digit is lost.
    rows = np.abs(matrix).argmax(axis=1)
    mirrored = tracks.positions[:, :, rows] * matrix[np.arange(3), rows]
    return tracks.replace(positions=mirrored).add_step("mirror", {"matrix": matrix.tolist()})


def _check_face_size(ratio: float, varies: bool, name: str) -> None:
    if _FACE_SIZES[0] <= ratio <= _FACE_SIZES[1]:
        return
    unit = guess_unit(ratio)
    text = f"{ratio:.3g} times the layout's face" + (f"; {unit}" if unit else "")
    expected = f"{_FACE_SIZES[0]:g} to {_FACE_SIZES[1]:g} times"
    if not _POSSIBLE_SIZES[0] <= ratio <= _POSSIBLE_SIZES[1]:
        raise DataError(
            "the reference pose differs too much in size from a face",
            found=text,
            expected=expected,
            advice="Give the unit of the file (--unit m; unit='m' in Python).",
        )
    if not varies:
        _warn(f"{name}: the reference pose has an unusual size: {text}, usual are {expected}")


def _check_size(ratio: float) -> None:
    # Where the unit is wrong, the head's motion is refused, in words.
    if _SAME_SIZE < abs(ratio - 1.0) < _OTHER_UNIT:
        _warn(
            f"the recording is {ratio:.3g} times as large as the reference pose: are both of the "
            "same speaker, and in the same unit?"
        )


def _check_axes(points: FloatArray, positions: FloatArray) -> None:
    """Warn of axes that are exchanged; a head may turn as far in some frames, but not in most."""
    rotations, _, residuals = estimate_rigid_transforms(points, positions)
    middle = project_to_rotations(rotations[~np.isnan(residuals)].sum(axis=0))
    angle = compute_angle(middle)
    if angle > _TURNED:
        _warn(
            f"the head is turned by {angle:.0f} degrees against the reference pose "
            f"({describe_axes(middle)[1]}): axes may be exchanged. That is removed with the motion "
            "of the head"
        )


def _warn(text: str) -> None:
    warnings.warn(text, MocapFitWarning, stacklevel=4)


def locate_expected(layout: Layout, names: Sequence[str]) -> FloatArray:
    """Locate a layout's markers on the built-in head.

    Parameters
    ----------
    layout
        The marker layout.
    names
        Names of the markers, in order.

    Returns
    -------
    ndarray
        Positions, ``(markers, 3)``, millimetres; NaN where the layout does not say.
    """
    head, normals = _load_head()
    locations = np.full((len(names), 3), np.nan)
    for marker in layout.markers:
        if marker.name not in names:
            continue
        row = list(names).index(marker.name)
        if marker.position is not None:
            locations[row] = marker.position
        elif marker.feature_point is not None:
            try:
                vertex = head.get_feature_point(marker.feature_point)
            except ConfigurationError:
                continue
            locations[row] = head.vertices[vertex] + layout.marker_offset * normals[vertex]
    return locations


@functools.cache
def _load_head() -> tuple[Mesh, FloatArray]:
    """Return the built-in head and its normals; every recording of a folder asks for them."""
    from mocap_fit.face.builtin import load_built_in_head

    head = load_built_in_head()
    return head, head.compute_normals()
