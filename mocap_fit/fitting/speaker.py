"""The speaker: what all recordings of one person share, prepared once."""

from __future__ import annotations

import dataclasses
import hashlib
import html
import warnings
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from mocap_fit._version import __version__
from mocap_fit.errors import ConfigurationError, DataError, MocapFitWarning, add_path
from mocap_fit.face import Rig, load_face, to_parameters
from mocap_fit.fitting.binding import Binding, bind_markers
from mocap_fit.fitting.coordinates import check_recording, check_reference
from mocap_fit.fitting.layout import Layout, load_layout
from mocap_fit.fitting.layout_search import find_layout
from mocap_fit.fitting.marker_names import match_names
from mocap_fit.fitting.objective import Objective
from mocap_fit.fitting.orientation import fit_orientation
from mocap_fit.fitting.over_time import fit_over_time
from mocap_fit.fitting.reference_pose import (
    align_reference,
    find_reference_faults,
    parse_reference,
    read_reference,
)
from mocap_fit.fitting.shape import ShapeFit, fit_shape
from mocap_fit.fitting.solving import NEWTON_NLOPT
from mocap_fit.head import HeadMotion, match_size, remove_head_motion
from mocap_fit.head.reference import compute_median_pose
from mocap_fit.io import read_tracks
from mocap_fit.tracks import FloatArray, MarkerTracks, ParameterTracks
from mocap_fit.tracks.rigid import describe_degeneracy

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, eq=False, repr=False)
class SpeakerFit:
    """A recording of a speaker, fitted.

    Parameters
    ----------
    shape
        Parameters, residuals, and the solver's status in every frame.
    head_motion
        Motion of the head that was removed before.
    """

    shape: ShapeFit
    head_motion: HeadMotion

    @property
    def parameters(self) -> ParameterTracks:
        """Face parameters over time, with their standard deviations."""
        return self.shape.parameters

    @property
    def residuals(self) -> FloatArray:
        """Root mean square distance of the markers from the face, ``(frames,)``, millimetres."""
        return self.shape.parameters.residuals

    def __repr__(self) -> str:
        return f"{self.shape!r}\n{self.head_motion!r}"

    def _repr_html_(self) -> str:
        return f"{self.shape._repr_html_()}<pre>{html.escape(repr(self.head_motion))}</pre>"

    def plot(self) -> Figure:
        """Plot the parameters and the residuals over time.

        Returns
        -------
        matplotlib.figure.Figure
            Parameters above, and below the root mean square residual in millimetres.
        """
        return self.shape.plot()


@dataclass(frozen=True, eq=False, repr=False)
class Speaker:
    """What all recordings of one speaker share; made by `fit_speaker`.

    Parameters
    ----------
    layout
        Marker layout.
    reference
        Reference pose; its coordinates are the speaker's head coordinates.
    binding
        Virtual markers on the face.
    face_name
        Name of the face, for the provenance.
    """

    layout: Layout
    reference: MarkerTracks
    binding: Binding
    face_name: str

    def __repr__(self) -> str:
        return (
            f"Speaker of the reference pose '{self.reference.name}' on the face '{self.face_name}'"
            f"\n  {self.layout!r}\n  {self.binding.orientation!r}"
        )

    def fit(
        self,
        tracks: MarkerTracks,
        *,
        objective: Objective = "distances",
        solver: str = NEWTON_NLOPT,
        refine_pose: bool = False,
        smooth: bool = False,
        allow_mirrored: bool = False,
        progress: Callable[[int], object] | None = None,
    ) -> SpeakerFit:
        """Remove the head's motion from a recording and fit the face to its frames.

        Parameters
        ----------
        tracks
            Recording with the markers of the layout.
        objective
            Cost over the visible markers: ``"distances"`` (Beskow eq. 3), ``"squares"`` or
            ``"huber"``.
        solver
            ``"newton-nlopt"``, ``"newton"``, or the name of an nlopt algorithm.
        refine_pose
            Whether a correction of the head's pose is fitted together with the shape.
        smooth
            Whether `fit_over_time` fits all frames together afterwards.
        allow_mirrored
            Whether a mirror image of the reference pose is turned round, and not refused.
        progress
            Called with the number of frames done so far.

        Returns
        -------
        SpeakerFit
            Parameters, residuals and head motion.

        Raises
        ------
        DataError
            If markers are missing, the recording is mirrored, or no frame can be fitted.
        ConfigurationError
            If a setting is unknown or out of range.
        """
        still, motion = self.remove_head_motion(self.prepare(tracks, allow_mirrored=allow_mirrored))
        shape = self.fit_shape(
            still,
            objective=objective,
            solver=solver,
            refine_pose=refine_pose,
            smooth=smooth,
            progress=progress,
        )
        return SpeakerFit(shape, motion)

    def prepare(self, tracks: MarkerTracks, *, allow_mirrored: bool = False) -> MarkerTracks:
        """Bring a recording to the names and the handedness of the reference pose, or refuse it.

        Parameters
        ----------
        tracks
            Recording with the markers of the layout.
        allow_mirrored
            Whether a mirror image of the reference pose is turned round, and not refused.

        Returns
        -------
        MarkerTracks
            Recording with the names of the layout.

        Raises
        ------
        DataError
            If markers are missing, or the recording is mirrored.

        Warns
        -----
        MocapFitWarning
            If it was turned round, or has another size or other axes than the reference pose.
        """
        tracks = match_names(self.layout, tracks)
        return check_recording(self.layout, self.reference, tracks, allow_mirrored=allow_mirrored)

    def remove_head_motion(self, tracks: MarkerTracks) -> tuple[MarkerTracks, HeadMotion]:
        """Bring a recording to the coordinates of the reference pose.

        Parameters
        ----------
        tracks
            Recording with the head markers of the layout.

        Returns
        -------
        MarkerTracks
            Recording in head coordinates, brought to the size of the reference pose where the
            layout says that sizes vary.
        HeadMotion
            Motion that was removed.

        Raises
        ------
        DataError
            If the head markers do not determine a pose.
        """
        weights = {m.name: m.weight for m in self.layout.head_markers}
        if self.layout.size_varies:
            tracks, _ = match_size(tracks, self.reference, tuple(weights))
        still, motion = remove_head_motion(
            tracks, self.reference, names=tuple(weights) or None, weights=weights or None
        )
        arguments = {
            "layout": self.layout.name,
            "face": self.face_name,
            "reference": self.reference.name,
            "scale": self.binding.orientation.scale,
        }
        return still.add_step("bind_markers", arguments), motion

    def fit_shape(
        self,
        still: MarkerTracks,
        *,
        objective: Objective = "distances",
        solver: str = NEWTON_NLOPT,
        refine_pose: bool = False,
        smooth: bool = False,
        progress: Callable[[int], object] | None = None,
    ) -> ShapeFit:
        """Fit the face to a recording whose head motion is removed.

        Parameters
        ----------
        still
            Recording in head coordinates, from `remove_head_motion`.
        objective
            Cost over the visible markers: ``"distances"``, ``"squares"`` or ``"huber"``.
        solver
            ``"newton-nlopt"``, ``"newton"``, or the name of an nlopt algorithm.
        refine_pose
            Whether a correction of the head's pose is fitted together with the shape.
        smooth
            Whether `fit_over_time` fits all frames together afterwards.
        progress
            Called with the number of frames done so far.

        Returns
        -------
        ShapeFit
            Parameters, residuals, and the solver's status in every frame.

        Raises
        ------
        DataError
            If markers are missing, or no frame can be fitted.
        ConfigurationError
            If a setting is unknown or out of range.
        """
        alone = fit_shape(
            self.binding,
            still,
            objective=objective,
            solver=solver,
            refine_pose=refine_pose,
            progress=progress,
        )
        if not smooth:
            return alone
        return fit_over_time(self.binding, still, alone, objective=objective)

    def compute_fingerprint(
        self,
        *,
        objective: Objective = "distances",
        solver: str = NEWTON_NLOPT,
        refine_pose: bool = False,
        smooth: bool = False,
    ) -> str:
        """Return a checksum of everything but the recording that a fit depends on.

        That is the layout, the reference pose, the face as far as the markers need it, the
        settings, and the version of this program: results may be used again while it is the same.

        Parameters
        ----------
        objective
            Cost over the visible markers.
        solver
            Name of the solver.
        refine_pose
            Whether the head's pose is corrected.
        smooth
            Whether all frames are fitted together.

        Returns
        -------
        str
            SHA-256, in hexadecimal.
        """
        binding = self.binding
        content = (
            __version__,
            {
                "objective": objective,
                "solver": solver,
                "refine_pose": refine_pose,
                "smooth": smooth,
            },
            self.layout.model_dump(mode="json"),
            (self.reference.name, self.reference.names, self.reference.positions),
            self.face_name,
            {f.name: getattr(binding, f.name) for f in dataclasses.fields(binding)} | {"rig": None},
            (binding.rig.parameter_names, binding.rig.bounds),
            None if binding.compiled is not None else _sample_shapes(binding),
        )
        total = hashlib.sha256()
        for piece in _flatten(content):
            total.update(piece)
        return total.hexdigest()


def fit_speaker(
    face: Rig | str | Path,
    layout: Layout | str | Path | None,
    reference: MarkerTracks | str | Path,
    *,
    allow_mirrored: bool = False,
    read: Callable[[str | Path], MarkerTracks] = read_tracks,
) -> Speaker:
    """Prepare a speaker: fit the orientation of the reference pose and bind the markers.

    Parameters
    ----------
    face
        A face, or what `load_face` takes: ``"built-in"`` or a rig file.
    layout
        A marker layout, or what `load_layout` takes: the name of one, or its file. None for the
        one that fits the names and the shape of the reference pose, of the shipped ones and those
        in its folder.
    reference
        The reference pose, or a file of it, or a span of a file: ``take.tsv@0.2-0.5`` (seconds).
        The median over its frames is used, laid on each other by the head markers.
    allow_mirrored
        Whether a face's mirror image is turned round, and not refused.
    read
        How the file of the reference pose is read, such as `ReadOptions.read_tracks`.

    Returns
    -------
    Speaker
        Fits this speaker's recordings.

    Raises
    ------
    DataError
        If the reference pose lacks markers of the layout, is a face's mirror image, or cannot be
        laid on the face.
    ConfigurationError
        If the layout or the face is wrong, they do not fit each other, or no layout fits.
    FileFormatError
        If the reference pose cannot be read.

    Warns
    -----
    MocapFitWarning
        If the reference pose speaks or moves, or another span of its recording is twice as still.

    See Also
    --------
    fit_orientation : Lays the reference pose on the face.
    bind_markers : Ties the markers to the face.
    fit_shape : Fits one recording in head coordinates.

    Examples
    --------
    >>> import mocap_fit as mf
    >>> speaker = mf.fit_speaker("built-in", "face30-head5", mf.load_sample("rest"))
    >>> fit = speaker.fit(mf.read_tracks(mf.load_sample("take_01")))
    >>> fit.parameters.names[:2]
    ('jaw_rotation', 'lip_rounding')
    >>> bool(np.nanmedian(fit.residuals) < 0.5)
    True
    """
    rig = load_face(face) if isinstance(face, (str, Path)) else face
    face_name = Path(face).name if isinstance(face, (str, Path)) else type(face).__name__
    if isinstance(reference, MarkerTracks):
        pose = take = reference
        reference_path = pose.name or "reference"
        recording = Path(reference_path)
    else:
        pose, take = read_reference(reference, read)
        reference_path = str(reference)
        recording = parse_reference(reference).path
    if layout is None:
        try:
            layout = find_layout(pose, [] if pose is reference else [recording.parent]).layout
        except ConfigurationError as error:
            raise add_path(error, reference_path) from None
    markers = layout if isinstance(layout, Layout) else load_layout(layout)
    # Errors name the file that the user can mend.
    layout_path = (markers.name or "layout") if isinstance(layout, Layout) else layout
    try:
        to_parameters(markers.reference_parameters, rig.parameter_names)
    except DataError as error:
        raise add_path(error, layout_path) from None
    try:
        pose = match_names(markers, pose, complete=True)
        _check_head_markers(markers, pose)
        take = pose if take is reference else match_names(markers, take, complete=True)
        faults = list(find_reference_faults(markers, pose, take, recording))
        if faults:
            text = "; ".join(f"{fault.problem} (expected {fault.expected})" for fault in faults)
            text = f"{reference_path}: {text}. {faults[0].advice}"
            warnings.warn(text, MocapFitWarning, stacklevel=2)
        pose = align_reference(markers, pose)
        pose = check_reference(markers, pose, allow_mirrored=allow_mirrored)
        orientation = fit_orientation(rig, markers, pose)
        binding = bind_markers(rig, markers, pose, orientation)
    except DataError as error:
        raise add_path(error, reference_path) from None
    except ConfigurationError as error:
        raise add_path(error, layout_path) from None
    return Speaker(markers, pose, binding, face_name)


def _sample_shapes(binding: Binding) -> list[object]:
    """Return the markers' vertices at some parameters, for a rig that does not compile."""
    bounds = np.asarray(binding.rig.bounds)
    draws = np.random.default_rng(0).uniform(size=(3, len(bounds)))
    points = [binding.reference_parameters, *(bounds[:, 0] + draws * np.ptp(bounds, axis=1))]
    return [binding.rig.deform(point)[binding.vertex_ids] for point in points]


def _flatten(value: object) -> Iterator[bytes]:
    """Yield the content of nested values, as bytes that differ where the values do."""
    if isinstance(value, np.ndarray):
        yield f"{value.dtype.str}{value.shape}".encode()
        yield value.tobytes()
        return
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        value = {f.name: getattr(value, f.name) for f in dataclasses.fields(value)}
    if isinstance(value, Mapping):
        value = [part for item in value.items() for part in item]
    if isinstance(value, (list, tuple)):
        yield f"[{len(value)}".encode()
        for part in value:
            yield from _flatten(part)
    elif isinstance(value, np.generic):
        yield repr(value.item()).encode() + b";"
    elif value is None or isinstance(value, (str, int, float)):
        yield repr(value).encode() + b";"
    else:
        raise TypeError(f"a {type(value).__name__} has no fingerprint")


def _check_head_markers(layout: Layout, reference: MarkerTracks) -> None:
    """Refuse a reference pose whose head markers do not determine a pose."""
    pose = compute_median_pose(reference)
    names = [m.name for m in layout.head_markers]
    reason = None
    if names:
        unseen = np.full(3, np.nan)
        reason = describe_degeneracy(np.array([pose.get(name, unseen) for name in names]))
    if reason is not None:
        raise DataError(
            "the head markers in the reference pose do not determine the head's pose",
            found=reason,
            expected=f"three or more of {', '.join(names)}, not on a line",
            advice="Record the reference pose with all head markers in view.",
        )
