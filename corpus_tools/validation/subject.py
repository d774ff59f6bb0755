"""The checks of one utterance: of whatever there is of it."""

from __future__ import annotations

import contextlib
import hashlib
import os
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from corpus_tools.validation import geometry
from corpus_tools.validation.findings import Finding, Location
from corpus_tools.validation.geometry import Shape
from corpus_tools.validation.labels import Surroundings, check_phone_tier
from corpus_tools.validation.markers import check_markers, mend_head
from corpus_tools.validation.parameters import Closure, check_parameters, measure_closures
from corpus_tools.validation.sounds import (
    check_clock,
    check_lengths,
    check_pulses,
    check_sound,
    measure_loudness,
)
from corpus_tools.validation.thresholds import Thresholds
from mocap_fit.errors import ConfigurationError, DataError
from mocap_fit.face import Rig
from mocap_fit.face.lips import compute_lip_gap
from mocap_fit.fitting import Layout, find_layout
from mocap_fit.fitting.marker_names import match_subject
from mocap_fit.head.aligned_frames import align_frames
from mocap_fit.io import ReadOptions
from mocap_fit.labels import Tier
from mocap_fit.phones import PhoneSet
from mocap_fit.sound import Sound, estimate_offset
from mocap_fit.tracks import MarkerTracks, ParameterTracks, Provenance


@dataclass(frozen=True, eq=False)
class Context:
    """What the data of all utterances are compared with.

    Parameters
    ----------
    limits
        What counts as wrong.
    layout
        The marker layout; found from the markers' names where it is None.
    rig
        The face; None where it is not known.
    phone_set
        The phone set; None where it is not known.
    rate
        Frame rate that the recordings should have, hertz; None where it is not known.
    options
        How files of recordings are read.
    edits
        The edit list, or the folder of edit lists; None for those beside the recordings.
    """

    limits: Thresholds
    layout: Layout | None = None
    rig: Rig | None = None
    phone_set: PhoneSet | None = None
    rate: float | None = None
    options: ReadOptions = field(default_factory=ReadOptions)
    edits: str | os.PathLike[str] | None = None


@dataclass
class Subject:
    """The data of an utterance; None where they are missing or cannot be read.

    Parameters
    ----------
    name
        Of the utterance.
    speaker
        Of the utterance.
    session
        Of the utterance.
    split
        Of the utterance.
    text
        Of the utterance.
    markers
        Its data; the tier is that of the phones.
    parameters
        Its data; the tier is that of the phones.
    tier
        Its data; the tier is that of the phones.
    sound
        Its data; the tier is that of the phones.
    files
        Where each is, as the user named it, by the names of the data.
    on_one_clock
        Whether the times of recording and labels are those of the sound.
    """

    name: str
    speaker: str = ""
    session: str = ""
    split: str = ""
    text: str = ""
    markers: MarkerTracks | None = None
    parameters: ParameterTracks | None = None
    tier: Tier | None = None
    sound: Sound | None = None
    files: dict[str, str] = field(default_factory=dict)
    on_one_clock: bool = False

    def get_location(self, part: str) -> Location:
        """Return the file of a part, with the utterance.

        Parameters
        ----------
        part
            Name of the data, such as ``markers``.

        Returns
        -------
        Location
            The location.
        """
        return Location(self.files.get(part, ""), self.name)


@dataclass(frozen=True, eq=False)
class Summary:
    """Results of an utterance that remain when its data are dropped.

    Parameters
    ----------
    name
        Of the utterance.
    speaker
        Of the utterance.
    session
        Of the utterance.
    split
        Of the utterance.
    text
        Of the utterance.
    location
        Its most telling file.
    sound_location
        The file of its sound.
    prints
        Sums over recording, parameters and sound, by what they are of.
    figures
        Numbers for the report by name, in the unit that the name says.
    shape
        Of the markers.
    closures
        The lips in every bilabial.
    lips
        Their gap when closed and when wide open, millimetres.
    offset
        How late the frames are by lips and sound, seconds, and the correlation.
    gaps
        Part of the frames in which each marker is missing.
    reach
        Of each parameter, what one frame in a hundred is below, and what is above.
    """

    name: str
    speaker: str
    session: str
    split: str
    text: str
    location: Location
    sound_location: Location
    prints: dict[str, str]
    figures: dict[str, float]
    shape: Shape | None
    closures: list[Closure]
    lips: tuple[float, float] | None
    offset: tuple[float, float] | None
    gaps: dict[str, float]
    reach: dict[str, tuple[float, float]]


def check_subject(subject: Subject, context: Context) -> tuple[list[Finding], Summary]:
    """Check all there is of an utterance.

    Parameters
    ----------
    subject
        Its data.
    context
        What it is compared with.

    Returns
    -------
    findings
        What is wrong.
    summary
        What the checks of a whole corpus need of it.
    """
    limits = context.limits
    findings: list[Finding] = []
    shape = None
    figures: dict[str, float] = {}
    gaps: dict[str, float] = {}
    if subject.markers is not None:
        more, shape = check_recording(subject.markers, context, subject.get_location("markers"))
        findings += more
        missing = (~subject.markers.visible).mean(axis=0) if subject.markers.frames else []
        gaps = dict(zip(subject.markers.names, map(float, missing), strict=False))
    sound, pulses = subject.sound, None
    if sound is not None:
        figures |= {"sound_s": sound.duration, "sound_rate": sound.rate}
        sound, pulses, more = _drop_pulses(subject, limits)
        findings += more
        findings += check_sound(sound, subject.get_location("sound"), limits)
    tracks = subject.markers if subject.parameters is None else subject.parameters
    if tracks is not None:
        figures |= {"frames": tracks.frames, "rate": tracks.rate, "recording_s": tracks.duration}
        part = "parameters" if tracks is subject.parameters else "markers"
        findings += _check_rate(tracks, context, subject.get_location(part))
        findings += _check_noted_clock(tracks.provenance, subject.get_location(part), limits)
        if sound is not None and pulses is None:
            findings += _check_lengths(subject, tracks, sound, part, limits)
    findings += _check_labels(subject, sound, tracks, context)
    closed: list[Closure] = []
    lips = offset = None
    reach: dict[str, tuple[float, float]] = {}
    if subject.parameters is not None:
        params = subject.parameters
        varies = context.layout is not None and context.layout.size_varies
        location = subject.get_location("parameters")
        findings += check_parameters(params, context.rig, varies, location, limits)
        there = np.isfinite(params.values).all(axis=1)
        if there.any():
            low, high = np.quantile(params.values[there], (0.01, 0.99), axis=0)
            pairs = zip(low.tolist(), high.tolist(), strict=True)
            reach = dict(zip(params.names, pairs, strict=True))
        residuals = params.residuals[np.isfinite(params.residuals)]
        if len(residuals):
            figures["residual_mm"] = float(np.median(residuals))
        rig = context.rig
        if rig is not None and tuple(rig.parameter_names) == params.names and there.any():
            closed, lips, offset = _measure_lips(subject, params, rig, sound, context)
    identity = (subject.name, subject.speaker, subject.session, subject.split, subject.text)
    first, sounds = (subject.get_location(p) for p in (next(iter(subject.files), ""), "sound"))
    data = (first, sounds, _compute_prints(subject), figures, shape)
    return findings, Summary(*identity, *data, closed, lips, offset, gaps, reach)


def check_recording(
    recording: MarkerTracks, context: Context, location: Location
) -> tuple[list[Finding], Shape | None]:
    """Check the markers of a recording.

    Parameters
    ----------
    recording
        The recording.
    context
        What it is compared with.
    location
        The file and the utterance.

    Returns
    -------
    findings
        What is wrong with it by itself.
    shape
        To be compared with others; None where nothing can be told.
    """
    layout = context.layout or _guess_layout(recording, location)
    if layout is not None:
        recording = match_subject(layout, recording)
    findings: list[Finding] = []
    head: list[int] = []
    if layout is not None:
        findings += geometry.check_layout(recording, layout, location)
        names = {marker.name for marker in layout.head_markers}
        head = [k for k, name in enumerate(recording.names) if name in names]
    recording, exchanged = mend_head(recording, head, location, context.limits)
    findings += exchanged
    still = align_frames(recording, head)
    findings += check_markers(
        recording, None if still is None else still.positions, location, context.limits
    )
    if still is None:
        if recording.frames and recording.visible.any():
            findings.append(
                Finding("MF126", location, "in no frame", "three markers that are not on a line")
            )
        return findings, None
    varies = layout is not None and layout.size_varies
    findings += geometry.check_head(recording, still, head, location, context.limits, varies)
    return findings, geometry.summarise(recording, still, layout, location, context.limits)


def _guess_layout(recording: MarkerTracks, location: Location) -> Layout | None:
    """Return the layout that fits, of the shipped ones and those beside the file; None if none."""
    try:
        return find_layout(recording, [Path(location.file).parent]).layout
    except ConfigurationError:
        return None


def _drop_pulses(subject: Subject, limits: Thresholds) -> tuple[Sound, int | None, list[Finding]]:
    """Return the sound without a channel of pulses, its number, and what the pulses say."""
    sound = subject.sound
    assert sound is not None
    tracks = subject.markers
    if sound.channels < 2 or tracks is None or subject.on_one_clock:
        return sound, None, []
    channel, findings = check_pulses(
        sound, tracks.rate, tracks.frames, subject.get_location("sound"), limits
    )
    return sound if channel is None else sound.drop_channel(channel), channel, findings


def _check_rate(
    tracks: MarkerTracks | ParameterTracks, context: Context, location: Location
) -> Iterator[Finding]:
    wanted = context.rate
    if wanted is not None and abs(tracks.rate / wanted - 1) > context.limits.time.rate:
        yield Finding("MF141", location, f"{tracks.rate:g} Hz", f"{wanted:g} Hz, as the others")


def _check_noted_clock(
    provenance: Provenance, location: Location, limits: Thresholds
) -> Iterator[Finding]:
    """Yield findings about the clocks, as the conversion noted them."""
    steps = [step for step in provenance if step.name == "synchronise"]
    if not steps:
        return
    noted = steps[-1].arguments
    if noted.get("is_estimate"):
        correlation = noted.get("correlation")
        with_it = "" if correlation is None else f", correlation {correlation:.2f}"
        text = f"start time {noted['start_time']:.3f} s, from lips and energy{with_it}"
        yield Finding("MF144", location, text, "pulses")
    if noted.get("drift_ppm") is not None:
        yield from check_clock(
            float(noted["drift_ppm"]), float(noted.get("residual") or 0.0), location, limits
        )


def _check_lengths(
    subject: Subject,
    tracks: MarkerTracks | ParameterTracks,
    sound: Sound,
    part: str,
    limits: Thresholds,
) -> Iterator[Finding]:
    ends = [entry.end for entry in subject.tier.entries] if subject.tier is not None else []
    if subject.on_one_clock:
        location, last = subject.get_location(part), max(ends, default=None)
        yield from check_lengths(tracks, sound.duration, last, location, limits)
    elif tracks.duration > sound.duration + limits.time.length or (
        sound.duration - tracks.duration > limits.time.length_apart
    ):
        text = f"the recording lasts {tracks.duration:.3f} s, the sound {sound.duration:.3f} s"
        expected = f"a sound that is up to {limits.time.length_apart} s longer"
        yield Finding("MF143", subject.get_location(part), text, expected)


def _check_labels(
    subject: Subject,
    sound: Sound | None,
    tracks: MarkerTracks | ParameterTracks | None,
    context: Context,
) -> Iterator[Finding]:
    if subject.tier is None:
        return
    recorded = None
    if tracks is not None and tracks.frames and (subject.on_one_clock or sound is None):
        times = tracks.times
        recorded = (float(times[0]), float(times[-1]) + 1 / tracks.rate)
    around = Surroundings(
        context.phone_set,
        recorded,
        None if sound is None else sound.duration,
        None if sound is None else measure_loudness(sound),
    )
    yield from check_phone_tier(
        subject.tier, around, subject.get_location("labels"), context.limits
    )


def _measure_lips(
    subject: Subject, tracks: ParameterTracks, rig: Rig, sound: Sound | None, context: Context
) -> tuple[list[Closure], tuple[float, float] | None, tuple[float, float] | None]:
    """Closures, how far the lips open, and where the sound says that the first frame is."""
    try:
        gaps = compute_lip_gap(rig, tracks.values)
    except (ConfigurationError, DataError):
        # A mesh of one's own may not say where its lips are.
        return [], None, None
    entries = [] if subject.tier is None else list(subject.tier.entries)
    closed: list[Closure] = []
    if context.phone_set is not None:
        closed = measure_closures(
            tracks, gaps, entries, context.phone_set, subject.get_location("labels"), context.limits
        )
    low, high = np.quantile(gaps[np.isfinite(gaps)], (0.05, 0.95))
    offset = None
    if sound is not None and subject.on_one_clock:
        with contextlib.suppress(DataError):
            estimate = estimate_offset(gaps, tracks.rate, sound, start_time=tracks.start_time)
            offset = (tracks.start_time - estimate.start_time, estimate.correlation)
    return closed, (float(low), float(high)), offset


def _compute_prints(subject: Subject) -> dict[str, str]:
    """Compute hashes of the data, whatever the files are called."""
    prints = {}
    if subject.markers is not None:
        prints["recording"] = _hash(np.round(subject.markers.positions, 4))
    if subject.parameters is not None:
        prints["parameters"] = _hash(np.round(subject.parameters.values, 9))
    if subject.sound is not None:
        prints["sound"] = _hash(np.round(subject.sound.samples, 6))
    return prints


def _hash(values: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> str:
    return hashlib.sha256(np.nan_to_num(values + 0.0, nan=1e9).tobytes()).hexdigest()
