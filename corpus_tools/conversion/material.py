"""What the files of an utterance hold: read, checked, and on the clock of the sound."""

from __future__ import annotations

import dataclasses
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from corpus_tools.conversion.plan import Job, Settings
from mocap_fit.errors import DataError, MocapFitError, MocapFitWarning, add_path
from mocap_fit.io import read_tracks
from mocap_fit.labels import read_phones
from mocap_fit.phones import PhoneSequence, UnknownPhone, find_unknown_phones
from mocap_fit.sound import Sound, energy_db, synchronise
from mocap_fit.tracks import MarkerTracks

# By which part the rates of a recording and of the manifest may differ: more is no rounding.
_SAME_RATE = 5e-4
# Millionths: what two clocks of quartz may differ by.
_USUAL_DRIFT = 300.0
# Seconds by which a label may reach beyond the recording or the sound.
_BEYOND = 0.02
_SHOWN = 3
# What readers say of a table of numbers that does not tell its rate; the manifest may.
_NO_RATE = "the file does not say its frame rate"


class UnknownPhonesError(DataError):
    """Labels that are not in the phone set, with all their places."""

    unknown: tuple[UnknownPhone, ...] = ()


def read_recording(settings: Settings, root: Path, job: Job) -> MarkerTracks:
    """Read a recording, whose rate must be that of the manifest.

    Raises
    ------
    MocapFitError
        If it cannot be read, or its rate contradicts the manifest.
    """
    path, rate = root / job.recording, settings.manifest.rate
    try:
        recording = read_tracks(path)
    except MocapFitError as error:
        if rate is None or error.problem != _NO_RATE:
            raise
        recording = read_tracks(path, rate=rate)
    if rate is not None and abs(recording.rate / rate - 1.0) > _SAME_RATE:
        raise DataError(
            "the frame rate is not that of the manifest",
            path=path,
            found=f"{recording.rate:g} Hz",
            expected=f"{rate:g} Hz",
            advice="Correct the manifest, or export the recording at its own rate.",
        )
    return recording


def read_labels(settings: Settings, root: Path, job: Job, rate: float | None) -> PhoneSequence:
    """Read the phones; `rate` is that of the sound, whose samples some formats count.

    Raises
    ------
    UnknownPhonesError
        If symbols are not in the phone set.
    MocapFitError
        If the labels cannot be read or used.
    """
    labels, phone_set = settings.manifest.labels, settings.phone_set
    path, name = root / job.labels, job.entry.id
    try:
        return read_phones(
            path, labels.phones, labels.words, phone_set, table=labels.table, name=name, rate=rate
        ).replace(name=name)
    except DataError as error:
        unknown = _unknown_phones(settings, root, job)
        if not unknown:
            raise add_path(error, path) from None
        refused = UnknownPhonesError(
            f"{len(unknown)} symbols are not in the phone set '{phone_set.name}': "
            + "; ".join(map(str, unknown)),
            path=path,
        )
        refused.unknown = unknown
        raise refused from None


def _unknown_phones(settings: Settings, root: Path, job: Job) -> tuple[UnknownPhone, ...]:
    """The labels that are in neither the phone set nor the manifest's table."""
    labels = settings.manifest.labels
    try:
        raw = read_phones(root / job.labels, labels.phones, labels.words, name=job.entry.id)
    except MocapFitError:
        return ()
    segments = tuple(s for s in raw if s.phone not in labels.table)
    raw = raw.replace(segments=segments, name=job.entry.id)
    return find_unknown_phones(raw, settings.phone_set)


def on_one_clock(
    settings: Settings, job: Job, recording: MarkerTracks, sound: Sound | None
) -> tuple[MarkerTracks, dict[str, Any]]:
    """Bring a recording to the clock of its sound, as the manifest says; and how that was done.

    Raises
    ------
    DataError
        If pulses or an estimate do not tell it.
    """
    said = settings.manifest.sync
    try:
        recording, found = synchronise(
            recording,
            sound,
            kind=said.kind,
            channel=said.channel,
            spare=said.spare,
            lips=settings.lips,
            start_time=job.entry.start_time,
            max_offset=said.largest_offset,
        )
    except DataError as error:
        raise add_path(error, job.sound or job.recording) from None
    return recording, found.to_dict()


def notes_on_clock(sync: Mapping[str, Any], frames: int) -> list[str]:
    """What a user should know of the clocks."""
    notes = []
    if sync["is_estimate"]:
        notes.append(
            f"the start time {sync['start_time']:.3f} s is an estimate (correlation "
            f"{sync['correlation']:.2f}), not a measurement"
        )
    drift = sync.get("drift_ppm") or 0.0
    if abs(drift) > _USUAL_DRIFT:
        notes.append(
            f"the clocks of recording and sound are {drift:+.0f} millionths apart: is the "
            "recording's frame rate right?"
        )
    if sync.get("missing"):
        notes.append(f"{sync['missing']} of {frames} sync pulses are missing")
    if sync.get("extra"):
        notes.append(f"{sync['extra']} pulses besides the sync pulses")
    return notes


def speech_of(settings: Settings, sound: Sound | None) -> Sound | None:
    """The sound without the channel of the pulses; None where there is no other."""
    said = settings.manifest.sync
    if sound is None or said.kind != "pulses":
        return sound
    return None if sound.channels == 1 else sound.drop_channel(said.channel)


def check_times(
    settings: Settings,
    job: Job,
    phones: PhoneSequence,
    recording: MarkerTracks,
    speech: Sound | None,
) -> None:
    """Refuse phones that are spoken where nothing was recorded.

    Raises
    ------
    DataError
        If some are outside the recording or the sound, or none is spoken at all.

    Warns
    -----
    MocapFitWarning
        If the recording goes on after the sound.
    """
    spoken = [s for s in phones if not settings.phone_set.is_silence(s)]
    if not spoken:
        raise DataError("no phone but silence is labelled", path=job.labels)
    frame = 1.0 / recording.rate
    first, last = float(recording.times[0]), float(recording.times[-1])
    spans = [("the recording", first - frame, last + frame, job.recording)]
    if speech is not None:
        spans.append(("the sound", 0.0, speech.duration, str(job.sound)))
    for noun, start, end, path in spans:
        outside = [s for s in spoken if s.start < start - _BEYOND or s.end > end + _BEYOND]
        if outside:
            shown = ", ".join(f"'{s.phone}' at {s.start:.3f} s" for s in outside[:_SHOWN])
            more = f" and {len(outside) - _SHOWN} more" if len(outside) > _SHOWN else ""
            raise DataError(
                f"{len(outside)} labels are outside {noun} ({path}): {shown}{more}",
                path=job.labels,
                expected=f"{start:.3f} s to {end:.3f} s",
                advice="Check that the files belong together, and the start time.",
            )
    if speech is not None and last > speech.duration + 0.1:
        warnings.warn(
            f"the recording goes on {last - speech.duration:.2f} s after the end of the sound",
            MocapFitWarning,
            stacklevel=1,
        )


def with_energy(phones: PhoneSequence, speech: Sound) -> PhoneSequence:
    """Phones with the energy of the sound at their centres."""
    energies = energy_db(speech, [segment.centre for segment in phones])
    return phones.replace(
        segments=tuple(
            dataclasses.replace(segment, energy_db=None if np.isnan(energy) else float(energy))
            for segment, energy in zip(phones, energies, strict=True)
        )
    ).add_step("energy_db", {"reference": "full scale"})
