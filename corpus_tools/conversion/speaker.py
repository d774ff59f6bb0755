"""All that the recordings of one speaker share, and how they are fitted."""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mocap_fit._version import __version__
from mocap_fit.errors import ConfigurationError, DataError, with_path
from mocap_fit.face import load_face, to_parameters
from mocap_fit.fitting import (
    Binding,
    Layout,
    ShapeFit,
    bind_markers,
    fit_orientation,
    fit_over_time,
    fit_shape,
    load_layout,
)
from mocap_fit.fitting.objective import Objective
from mocap_fit.fitting.orientation import reference_pose
from mocap_fit.head import HeadMotion, match_size, remove_head_motion
from mocap_fit.io import read_tracks
from mocap_fit.tracks import MarkerTracks
from mocap_fit.tracks.rigid import refusal


@dataclass(frozen=True)
class Options:
    """How recordings are fitted; see `mocap_fit.fitting.fit_shape`.

    With ``smooth``, `mocap_fit.fitting.fit_over_time` follows.
    """

    objective: Objective = "distances"
    solver: str = "newton-nlopt"
    refine_pose: bool = False
    smooth: bool = False


@dataclass(frozen=True, eq=False)
class Speaker:
    """All that the recordings of one speaker share.

    Parameters
    ----------
    layout
        The marker layout.
    reference
        The reference pose; its coordinates are the speaker's head coordinates.
    binding
        The virtual markers on the face.
    face_name
        The face, as the user named it.
    """

    layout: Layout
    reference: MarkerTracks
    binding: Binding
    face_name: str

    @classmethod
    def load(cls, reference: Path, layout: str, face: str) -> Speaker:
        """Read the reference pose and tie the layout's markers to the face."""
        markers = load_layout(layout)
        rig = load_face(face)
        pose = read_tracks(reference)
        absent = [m.name for m in markers.markers if m.name not in pose.names]
        if absent:
            raise DataError(
                f"the reference pose lacks {len(absent)} of the {len(markers.markers)} markers of "
                f"the layout '{markers.name}': {', '.join(absent)}",
                path=str(reference),
                found=", ".join(pose.names),
                advice="Choose the layout that it was recorded with, or correct the names.",
            )
        try:
            to_parameters(markers.reference_parameters, rig.parameter_names)
        except DataError as error:
            raise with_path(error, layout) from None
        try:
            _check_head(markers, pose)
            orientation = fit_orientation(rig, markers, pose)
            binding = bind_markers(rig, markers, pose, orientation)
        except DataError as error:
            raise with_path(error, reference) from None
        except ConfigurationError as error:
            raise with_path(error, layout) from None
        return cls(markers, pose, binding, Path(face).name)

    def fit(
        self,
        recording: MarkerTracks,
        options: Options,
        progress: Callable[[int], object] | None = None,
    ) -> tuple[ShapeFit, HeadMotion]:
        """Remove the head's motion from a recording and fit its frames."""
        still, motion = self.remove_head_motion(recording)
        return self.fit_still(still, options, progress), motion

    def remove_head_motion(self, recording: MarkerTracks) -> tuple[MarkerTracks, HeadMotion]:
        """Give a recording in the coordinates of the reference pose, and what was removed."""
        weights = self.head_weights
        if self.layout.size_varies:
            recording, _ = match_size(recording, self.reference, tuple(weights))
        still, motion = remove_head_motion(
            recording, self.reference, names=tuple(weights) or None, weights=weights or None
        )
        return self.tied(still), motion

    @property
    def head_weights(self) -> dict[str, float]:
        """The layout's head markers and their weights."""
        return {m.name: m.weight for m in self.layout.head_markers}

    def tied(self, still: MarkerTracks) -> MarkerTracks:
        """The tracks, whose provenance says what they are tied to."""
        tied = {
            "layout": self.layout.name,
            "face": self.face_name,
            "reference": self.reference.name,
            "scale": self.binding.orientation.scale,
        }
        return still.with_step("bind_markers", tied)

    def fit_still(
        self,
        still: MarkerTracks,
        options: Options,
        progress: Callable[[int], object] | None = None,
    ) -> ShapeFit:
        """Fit the frames of a recording without head motion.

        ``progress`` is called with the number of frames done so far.
        """
        alone = fit_shape(
            self.binding,
            still,
            objective=options.objective,
            solver=options.solver,
            refine_pose=options.refine_pose,
            progress=progress,
        )
        if not options.smooth:
            return alone
        return fit_over_time(self.binding, still, alone, objective=options.objective)

    def fingerprint(self, options: Options) -> str:
        """A sum over all but the recording that the result depends on.

        Layout, reference pose, face as far as the markers need it, options and this program's
        version; what changes none of these may keep its results.
        """
        binding = self.binding
        content = (
            __version__,
            options,
            self.layout.model_dump(mode="json"),
            (self.reference.name, self.reference.names, self.reference.positions),
            self.face_name,
            {f.name: getattr(binding, f.name) for f in dataclasses.fields(binding)} | {"rig": None},
            (binding.rig.parameter_names, binding.rig.bounds),
            None if binding.compiled is not None else _shapes(binding),
        )
        total = hashlib.sha256()
        for piece in _pieces(content):
            total.update(piece)
        return total.hexdigest()


def _shapes(binding: Binding) -> list[object]:
    """What a rig that is known by its answers alone answers at some places."""
    bounds = np.asarray(binding.rig.bounds)
    draws = np.random.default_rng(0).uniform(size=(3, len(bounds)))
    places = [binding.reference_parameters, *(bounds[:, 0] + draws * np.ptp(bounds, axis=1))]
    return [binding.rig.deform(place)[binding.vertex_ids] for place in places]


def _pieces(value: object) -> Iterator[bytes]:
    """The content of nested values, as bytes that differ where the values do."""
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
            yield from _pieces(part)
    elif isinstance(value, np.generic):
        yield repr(value.item()).encode() + b";"
    elif value is None or isinstance(value, (str, int, float)):
        yield repr(value).encode() + b";"
    else:
        raise TypeError(f"a {type(value).__name__} has no fingerprint")


def _check_head(layout: Layout, reference: MarkerTracks) -> None:
    """Refuse a reference pose that tells no head pose, once and not for every recording."""
    places = reference_pose(reference)
    names = [m.name for m in layout.head_markers]
    reason = None
    if names:
        unseen = np.full(3, np.nan)
        reason = refusal(np.array([places.get(name, unseen) for name in names]))
    if reason is not None:
        raise DataError(
            "the head's pose cannot be told from the head markers in the reference pose",
            found=reason,
            expected=f"three or more of {', '.join(names)}, not on a line",
            advice="Record the reference pose with all head markers in view.",
        )
