"""Edits of the markers of a recording; times are seconds on its clock, as its file is read."""

from __future__ import annotations

from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, model_validator
from typing_extensions import override

from mocap_fit.errors import DataError
from mocap_fit.io.names import rename_tracks
from mocap_fit.settings_file import StrictModel
from mocap_fit.tracks import MarkerTracks, Origin

Name = Annotated[str, Field(min_length=1)]
"""Name of a marker, a phone or a file."""

# Seconds: times this much before a frame still belong to it, as in `Tracks.between`.
_TOLERANCE = 1e-9


class MarkerEdit(StrictModel):
    """An edit of the markers of a recording."""

    def apply(self, tracks: MarkerTracks) -> MarkerTracks:
        """Return the recording with the edit.

        Parameters
        ----------
        tracks
            A recording.

        Returns
        -------
        MarkerTracks
            The recording, edited, without a step of provenance.

        Raises
        ------
        DataError
            If it has no such marker, or no frame in that stretch of time.
        """
        raise NotImplementedError


class _Span(StrictModel):
    """An edit of a stretch of time."""

    start: float | None = None
    end: float | None = None

    @model_validator(mode="after")
    def _check_times(self) -> Self:
        if self.start is not None and self.end is not None and not self.start < self.end:
            raise ValueError(f"the end, {self.end:g} s, is not after the start, {self.start:g} s")
        return self

    def select_frames(self, tracks: MarkerTracks) -> slice:
        """Return the frames of a recording that are in the stretch of time."""
        times = tracks.times
        first = 0 if self.start is None else np.searchsorted(times, self.start - _TOLERANCE)
        last = tracks.frames if self.end is None else np.searchsorted(times, self.end - _TOLERANCE)
        if last <= first:
            reach = f"{times[0]:.3f} to {times[-1]:.3f} s" if tracks.frames else "no frame at all"
            raise DataError(
                "no frame of the recording lies in that stretch of time",
                found=f"{self.start} to {self.end} s",
                expected=f"within {reach}",
            )
        return slice(int(first), int(last))


class Rename(MarkerEdit):
    """Another name of a marker, such as one of the layout.

    Parameters
    ----------
    old
        Its present name.
    new
        Its new name, which no other marker has.
    """

    edit: Literal["rename"] = "rename"
    old: Name
    new: Name

    @override
    def apply(self, tracks: MarkerTracks) -> MarkerTracks:
        return tracks.replace(names=rename_tracks(tracks, {self.old: self.new}).names)


class Swap(MarkerEdit, _Span):
    """Two markers that have each other's names, for a while or throughout.

    Parameters
    ----------
    markers
        Their names.
    start, end
        The stretch of time, seconds; from the first frame, or to the last, where left out.
    """

    edit: Literal["swap"] = "swap"
    markers: tuple[Name, Name]

    @model_validator(mode="after")
    def _check_markers(self) -> Self:
        if self.markers[0] == self.markers[1]:
            raise ValueError(f"'{self.markers[0]}' cannot be exchanged with itself")
        return self

    @override
    def apply(self, tracks: MarkerTracks) -> MarkerTracks:
        frames, pair = self.select_frames(tracks), tracks.indices(self.markers)
        positions, origin = tracks.positions.copy(), tracks.origin.copy()
        positions[frames, pair] = tracks.positions[frames, pair[::-1]]
        origin[frames, pair] = tracks.origin[frames, pair[::-1]]
        return tracks.replace(positions=positions, origin=origin)


class DropSpan(MarkerEdit, _Span):
    """Samples that are wrong for a while, and are taken as missing.

    Parameters
    ----------
    markers
        Names of the markers; all of them where empty.
    start, end
        The stretch of time, seconds; from the first frame, or to the last, where left out.
    """

    edit: Literal["drop_span"] = "drop_span"
    markers: tuple[Name, ...] = ()

    @override
    def apply(self, tracks: MarkerTracks) -> MarkerTracks:
        frames, chosen = self.select_frames(tracks), tracks.indices(self.markers or tracks.names)
        positions, origin = tracks.positions.copy(), tracks.origin.copy()
        positions[frames, chosen] = np.nan
        origin[frames, chosen] = Origin.MISSING
        return tracks.replace(positions=positions, origin=origin)


class DropMarker(MarkerEdit):
    """A marker that is left out throughout, such as a reflection.

    Parameters
    ----------
    marker
        Its name.
    """

    edit: Literal["drop_marker"] = "drop_marker"
    marker: Name

    @override
    def apply(self, tracks: MarkerTracks) -> MarkerTracks:
        tracks.index(self.marker)
        rest = tracks.select([name for name in tracks.names if name != self.marker])
        return rest.replace(provenance=tracks.provenance)


class Mirror(MarkerEdit):
    """A recording with an axis turned round: it shows the speaker's mirror image.

    Parameters
    ----------
    axis
        The axis whose coordinates change their sign: ``x``, ``y`` or ``z``.
    """

    edit: Literal["mirror"] = "mirror"
    axis: Literal["x", "y", "z"] = "x"

    @override
    def apply(self, tracks: MarkerTracks) -> MarkerTracks:
        signs = np.where(np.arange(3) == "xyz".index(self.axis), -1.0, 1.0)
        return tracks.replace(positions=tracks.positions * signs)


class SetReference(_Span):
    """The stretch of time that is the reference pose, where the recording is taken for one.

    Parameters
    ----------
    recording
        Another recording that has it, in the folder of this one; this one where left out.
    start, end
        The stretch of time, seconds; from the first frame, or to the last, where left out.
    """

    edit: Literal["reference"] = "reference"
    recording: Name | None = None
