"""A recording brought to the clock of its sound.

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
from mocap_fit.sound.estimate import LARGEST_OFFSET, OffsetEstimate, estimate_offset
from mocap_fit.sound.pulses import PulseTrain, decode_pulses
from mocap_fit.sound.wav import Sound
from mocap_fit.tracks import Event, MarkerTracks, ParameterTracks, PoseTracks

SyncKind = Literal["pulses", "estimate", "none"]
_AnyTracks = TypeVar("_AnyTracks", MarkerTracks, PoseTracks, ParameterTracks)


@dataclass(frozen=True)
class Synchronisation:
    """How a recording lies on the clock of its sound.

    Parameters
    ----------
    kind
        ``pulses``: measured; ``estimate``: from opening lips and energy; ``none``: what the
        recording or its manifest says.
    start_time
        Seconds: the first frame on the sound's clock.
    rate
        Frames a second of the sound's clock.
    drift_ppm
        Millionths by which that is more than the recording says; None without pulses.
    missing, extra
        Frames whose pulse is missing, and pulses besides; None where that is not known.
    residual
        Seconds: root mean square distance of the pulses from an even clock; None where not known.
    correlation
        Of lip opening and energy; None where nothing was estimated.
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

    @classmethod
    def of_pulses(cls, train: PulseTrain) -> Synchronisation:
        """What the pulses say."""
        return cls(
            "pulses",
            train.start_time,
            train.frame_rate,
            train.drift_ppm,
            int((~train.heard).sum()),
            train.extra,
            train.residual,
        )

    @classmethod
    def of_estimate(cls, estimate: OffsetEstimate, rate: float) -> Synchronisation:
        """What the estimate says; the rate is the recording's own."""
        return cls("estimate", estimate.start_time, rate, correlation=estimate.correlation)

    def to_dict(self) -> dict[str, Any]:
        """What is known, as JSON can hold it, with ``is_estimate``."""
        known = {k: v for k, v in dataclasses.asdict(self).items() if v is not None}
        return {**known, "is_estimate": self.is_estimate}

    def apply(self, tracks: _AnyTracks) -> _AnyTracks:
        """Tracks on the sound's clock: other start time, rate and times of events, same frames.

        The provenance says how, in the step ``synchronise``.
        """
        events = tuple(
            Event(e.name, self.start_time + (e.time - tracks.start_time) * tracks.rate / self.rate)
            for e in tracks.events
        )
        moved = tracks.replace(start_time=self.start_time, rate=self.rate, events=events)
        return moved.with_step("synchronise", self.to_dict())


def synchronise(
    recording: MarkerTracks,
    sound: Sound | None,
    *,
    kind: SyncKind = "pulses",
    channel: int = 2,
    spare: tuple[int, int] = (0, 0),
    lips: tuple[str, str] | None = None,
    about: float | None = None,
    largest: float = LARGEST_OFFSET,
) -> tuple[MarkerTracks, Synchronisation]:
    """Bring a recording to the clock of its sound.

    Parameters
    ----------
    recording
        The markers, without the head's motion or with it.
    sound
        All its channels; None only where `kind` is ``none``.
    kind
        ``pulses``: from a pulse a frame on a channel; ``estimate``: from opening lips and louder
        speech, on the mean of the channels; ``none``: nothing is changed but the provenance.
    channel
        The channel of the pulses, from 1.
    spare
        How many pulses come before the first frame's and after the last's: some systems give one
        when they are armed, or at the end of the last exposure.
    lips
        Names of a marker on the upper and one on the lower lip, for the estimate.
    about
        Seconds: where the first frame is, about. With pulses it decides between frames where the
        first or last pulse is missing; for the estimate it is the middle of the search.
    largest
        Seconds: how far from there the estimate may be.

    Returns
    -------
    MarkerTracks
        The same frames on the sound's clock.
    Synchronisation
        How they lie on it.

    Raises
    ------
    DataError
        As `decode_pulses` and `estimate_offset` do, or if the channel or the markers are not
        there.
    """
    if sound is None and kind != "none":
        raise DataError("there is no sound to synchronise with", found=recording.name)
    if kind == "pulses" and sound is not None:
        before, after = spare
        train = decode_pulses(
            sound.channel(channel),
            sound.rate,
            recording.rate,
            before + recording.frames + after,
            start_time=None if about is None else about - before / recording.rate,
        ).part(before, before + recording.frames)
        found = Synchronisation.of_pulses(train)
    elif kind == "estimate" and sound is not None:
        if lips is None:
            raise DataError(
                "an estimate needs a marker on each lip", advice="Name them (lips=...)."
            )
        upper, lower = (recording.position(name) for name in lips)
        opening = np.linalg.norm(upper - lower, axis=1)
        middle = recording.start_time if about is None else about
        estimate = estimate_offset(opening, recording.rate, sound, about=middle, largest=largest)
        found = Synchronisation.of_estimate(estimate, recording.rate)
    else:
        start = recording.start_time if about is None else about
        found = Synchronisation("none", start, recording.rate)
    return found.apply(recording), found
