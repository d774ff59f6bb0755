"""Read and check the files of an utterance, and put them on the clock of the sound."""

from __future__ import annotations

import dataclasses
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from corpus_tools.conversion.plan import Settings, UtteranceItem
from mocap_fit import labels as label_files
from mocap_fit.errors import DataError, MocapFitError, MocapFitWarning, add_path
from mocap_fit.labels import Labels, to_phones
from mocap_fit.phones import PhoneSequence, UnknownPhone, find_unknown_phones
from mocap_fit.sound import Sound, energy_db, synchronise
from mocap_fit.tracks import MarkerTracks

# Parts per million that the clocks of two devices may differ by.
_USUAL_DRIFT = 300.0
# Seconds by which a label may reach beyond the recording or the sound.
_BEYOND = 0.02
_SHOWN = 3
# Symbols in one message.
_SYMBOLS = 30


class UnknownPhonesError(DataError):
    """Labels that are not in the phone set; its ``details`` list them with their times."""

    details: tuple[UnknownPhone, ...] = ()


def read_recording(settings: Settings, root: Path, item: UtteranceItem) -> MarkerTracks:
    """Read a recording as the manifest says, with the names and handedness of its reference pose.

    Parameters
    ----------
    settings
        What the utterances share.
    root
        Folder of the files.
    item
        The utterance.

    Returns
    -------
    MarkerTracks
        The recording.

    Raises
    ------
    MocapFitError
        If it cannot be read, lacks markers of the layout, or is mirrored.
    """
    manifest = settings.manifest
    recording = manifest.reading.read_tracks(root / item.recording)
    try:
        if item.edits is not None:
            recording = item.edits.apply(recording)
        return settings.speakers[item.entry.reference].prepare(
            recording, allow_mirrored=manifest.fit.allow_mirrored
        )
    except DataError as error:
        raise add_path(error, root / item.recording) from None


def read_labels(
    settings: Settings, root: Path, item: UtteranceItem, rate: float | None
) -> PhoneSequence:
    """Read the phones of an utterance.

    Parameters
    ----------
    settings
        What the utterances share.
    root
        Folder of the files.
    item
        The utterance.
    rate
        Rate of the sound, hertz, for formats that count samples; None without sound.

    Returns
    -------
    PhoneSequence
        The phones, in the phone set.

    Raises
    ------
    UnknownPhonesError
        If symbols are not in the phone set.
    MocapFitError
        If the labels cannot be read or used.
    """
    labels, phone_set = settings.manifest.labels, settings.phone_set
    path, name = root / item.labels, item.entry.id
    raw = label_files.read_labels(path, name, rate=rate)
    try:
        if item.edits is not None:
            raw = item.edits.apply_to_labels(raw, labels.phones, phone_set, labels.table)
        phones = to_phones(raw, labels.phones, labels.words, phone_set, table=labels.table)
        phones = phones.replace(name=name)
        if item.edits is None:
            return phones
        return phones.add_step("edit", {"edits": item.edits.to_dicts()})
    except DataError as error:
        unknown = _find_unknown_phones(settings, item, raw)
        if not unknown:
            raise add_path(error, path) from None
        refused = UnknownPhonesError(
            f"{len(unknown)} symbols are not in the phone set '{phone_set.name}': "
            + "; ".join(map(str, unknown[:_SYMBOLS])),
            path=path,
        )
        refused.details = unknown
        raise refused from None


def _find_unknown_phones(
    settings: Settings, item: UtteranceItem, raw: Labels
) -> tuple[UnknownPhone, ...]:
    """Return the labels that are in neither the phone set nor the manifest's table."""
    labels = settings.manifest.labels
    try:
        phones = to_phones(raw, labels.phones, labels.words)
    except MocapFitError:
        return ()
    segments = tuple(s for s in phones if s.phone not in labels.table)
    phones = phones.replace(segments=segments, name=item.entry.id)
    return find_unknown_phones(phones, settings.phone_set)


def synchronise_recording(
    settings: Settings, item: UtteranceItem, recording: MarkerTracks, sound: Sound | None
) -> tuple[MarkerTracks, dict[str, Any]]:
    """Put a recording on the clock of its sound, as the manifest says.

    Parameters
    ----------
    settings
        What the utterances share.
    item
        The utterance.
    recording
        Its recording.
    sound
        Its sound; None without one.

    Returns
    -------
    MarkerTracks
        The recording with another start time and rate.
    dict[str, Any]
        How the clocks were compared.

    Raises
    ------
    DataError
        If the pulses or the estimate do not determine it.
    """
    sync = settings.manifest.sync
    try:
        recording, result = synchronise(
            recording,
            sound,
            kind=sync.kind,
            channel=sync.channel,
            spare=sync.spare,
            lips=settings.lips,
            start_time=item.entry.start_time,
            max_offset=sync.largest_offset,
        )
    except DataError as error:
        raise add_path(error, item.sound or item.recording) from None
    return recording, result.to_dict()


def describe_clock(sync: Mapping[str, Any], frames: int) -> list[str]:
    """Return what a user should know about the clocks.

    Parameters
    ----------
    sync
        How they were compared; from `synchronise_recording`.
    frames
        Number of frames of the recording.

    Returns
    -------
    list[str]
        One line each; usually none.
    """
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


def remove_pulses(settings: Settings, sound: Sound | None) -> Sound | None:
    """Return the sound without the channel of the pulses.

    Parameters
    ----------
    settings
        What the utterances share.
    sound
        The sound of an utterance; None without one.

    Returns
    -------
    Sound | None
        None where no other channel is left.
    """
    sync = settings.manifest.sync
    if sound is None or sync.kind != "pulses":
        return sound
    return None if sound.channels == 1 else sound.drop_channel(sync.channel)


def check_times(
    settings: Settings,
    item: UtteranceItem,
    phones: PhoneSequence,
    recording: MarkerTracks,
    speech: Sound | None,
) -> None:
    """Refuse phones that are spoken where nothing was recorded.

    Parameters
    ----------
    settings
        What the utterances share.
    item
        The utterance.
    phones
        Its phones.
    recording
        Its recording, on the clock of the sound.
    speech
        Its sound; None without one.

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
        raise DataError("no phone but silence is labelled", path=item.labels)
    frame = 1.0 / recording.rate
    first, last = float(recording.times[0]), float(recording.times[-1])
    spans = [("the recording", first - frame, last + frame, item.recording)]
    if speech is not None:
        spans.append(("the sound", 0.0, speech.duration, str(item.sound)))
    for noun, start, end, path in spans:
        outside = [s for s in spoken if s.start < start - _BEYOND or s.end > end + _BEYOND]
        if outside:
            shown = ", ".join(f"'{s.phone}' at {s.start:.3f} s" for s in outside[:_SHOWN])
            more = f" and {len(outside) - _SHOWN} more" if len(outside) > _SHOWN else ""
            raise DataError(
                f"{len(outside)} labels are outside {noun} ({path}): {shown}{more}",
                path=item.labels,
                expected=f"{start:.3f} s to {end:.3f} s",
                advice="Check that the files belong together, and the start time.",
            )
    if speech is not None and last > speech.duration + 0.1:
        warnings.warn(
            f"the recording goes on {last - speech.duration:.2f} s after the end of the sound",
            MocapFitWarning,
            stacklevel=1,
        )


def add_energy(phones: PhoneSequence, speech: Sound) -> PhoneSequence:
    """Return phones with the energy of the sound at their centres.

    Parameters
    ----------
    phones
        The phones.
    speech
        Their sound.

    Returns
    -------
    PhoneSequence
        Phones with energies in dB relative to full scale.
    """
    energies = energy_db(speech, [segment.centre for segment in phones])
    return phones.replace(
        segments=tuple(
            dataclasses.replace(segment, energy_db=None if np.isnan(energy) else float(energy))
            for segment, energy in zip(phones, energies, strict=True)
        )
    ).add_step("energy_db", {"reference": "full scale"})
