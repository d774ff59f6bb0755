"""Bring a recording to the clock of its sound.

Frames are not resampled: the start time and the rate of the tracks become those of the sound's
clock, so that every measured value stays as it was measured and only its time changes. Where the
clocks drift apart by 200 millionths, a recording of 60 frames/s has 60.012 afterwards.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any, Literal, TypeVar

import numpy as np

from mocap_fit.errors import DataError
from mocap_fit.sound.estimate import MAX_OFFSET, estimate_offset
from mocap_fit.sound.pulses import decode_pulses
from mocap_fit.sound.sound import Sound
from mocap_fit.tracks import Event, MarkerTracks, ParameterTracks, PoseTracks

SyncKind = Literal["pulses", "estimate", "none"]
_AnyTracks = TypeVar("_AnyTracks", MarkerTracks, PoseTracks, ParameterTracks)


@dataclass(frozen=True)
class Synchronisation:
    """The relation of a recording's clock to that of its sound.

    Parameters
    ----------
    kind
        ``pulses``: measured; ``estimate``: from opening lips and energy; ``none``: what the
        recording or its manifest says.
    start_time
        Time of the first frame on the sound's clock, seconds.
    rate
        Frame rate on the sound's clock, hertz.
    drift_ppm
        Relative difference of that rate from the recording's, millionths (ppm); None without
        pulses.
    missing
        Number of frames whose pulse is missing; None without pulses.
    extra
        Number of pulses between those of the frames; None where that is not known.
    residual
        Root mean square distance of the pulses from an even clock, seconds; None where not known.
    correlation
        Correlation of lip opening and energy, -1 to 1; None where nothing was estimated.
    """

    kind: SyncKind
    start_time: float
    rate: float
    drift_ppm: float | None = None
    missing: int | None = None
    extra: int | None = None
    residual: float | None = None
    correlation: float | None = None

    @property
    def is_estimate(self) -> bool:
        """Whether the start time is estimated and not measured."""
        return self.kind == "estimate"

    def to_dict(self) -> dict[str, Any]:
        """Convert the fields that are known to values that JSON can hold.

        Returns
        -------
        dict
            By name, with ``is_estimate``.
        """
        known = {k: v for k, v in dataclasses.asdict(self).items() if v is not None}
        return {**known, "is_estimate": self.is_estimate}

    def apply(self, tracks: _AnyTracks) -> _AnyTracks:
        """Bring tracks to the sound's clock.

        Parameters
        ----------
        tracks
            Tracks of the recording, on its clock.

        Returns
        -------
        MarkerTracks, PoseTracks or ParameterTracks
            The same frames with another start time and rate, and the times of events moved with
            them; the step ``synchronise`` of the provenance has the fields.
        """
        events = tuple(
            Event(e.name, self.start_time + (e.time - tracks.start_time) * tracks.rate / self.rate)
            for e in tracks.events
        )
        moved = tracks.replace(start_time=self.start_time, rate=self.rate, events=events)
        return moved.add_step("synchronise", self.to_dict())


def synchronise(
    recording: MarkerTracks,
    sound: Sound | None,
    *,
    kind: SyncKind = "pulses",
    channel: int = 2,
    spare: tuple[int, int] = (0, 0),
    lips: tuple[str, str] | None = None,
    start_time: float | None = None,
    max_offset: float = MAX_OFFSET,
) -> tuple[MarkerTracks, Synchronisation]:
    """Bring a recording to the clock of its sound.

    Parameters
    ----------
    recording
        The markers, with or without the head's motion.
    sound
        All its channels; None only where `kind` is ``none``.
    kind
        ``pulses``: from a pulse a frame on a channel; ``estimate``: from opening lips and louder
        speech, on the mean of the channels; ``none``: only the provenance changes.
    channel
        The channel of the pulses; the first is 1.
    spare
        Numbers of pulses before the first frame's and after the last's: some systems give one
        when they are armed, or at the end of the last exposure.
    lips
        Names of a marker on the upper lip and one on the lower lip, for the estimate.
    start_time
        Approximate time of the first frame, seconds. With pulses it decides between frames where
        the first or last pulse is missing, if it is known; for the estimate it is the middle of
        the search, and that of the recording if None.
    max_offset
        Distance from there to the ends of the search of the estimate, seconds.

    Returns
    -------
    MarkerTracks
        The same frames on the sound's clock.
    Synchronisation
        Start time, rate and how they are known.

    Raises
    ------
    DataError
        If the channel or a marker is missing, the pulses cannot be decoded, or the offset cannot
        be estimated.
    """
    if sound is None and kind != "none":
        raise DataError("there is no sound to synchronise with", found=recording.name)
    if kind == "pulses" and sound is not None:
        before, after = spare
        train = decode_pulses(
            sound.get_channel(channel),
            sound.rate,
            recording.rate,
            before + recording.frames + after,
            start_time=None if start_time is None else start_time - before / recording.rate,
        ).select(before, before + recording.frames)
        result = Synchronisation(
            "pulses",
            train.start_time,
            train.frame_rate,
            train.drift_ppm,
            int((~train.present).sum()),
            train.extra,
            train.residual,
        )
    elif kind == "estimate" and sound is not None:
        if lips is None:
            raise DataError(
                "an estimate needs a marker on each lip", advice="Name them (lips=...)."
            )
        upper, lower = (recording[name] for name in lips)
        estimate = estimate_offset(
            np.linalg.norm(upper - lower, axis=1),
            recording.rate,
            sound,
            start_time=recording.start_time if start_time is None else start_time,
            max_offset=max_offset,
        )
        result = Synchronisation(
            "estimate", estimate.start_time, recording.rate, correlation=estimate.correlation
        )
    else:
        start = recording.start_time if start_time is None else start_time
        result = Synchronisation("none", start, recording.rate)
    return result.apply(recording), result
