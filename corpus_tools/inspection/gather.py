"""Gather what belongs to a path: a recording, a fit, a corpus, an utterance, a model, a layout."""

from __future__ import annotations

import contextlib
import warnings
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from corpus_tools.inspection.material import Material, Path_
from corpus_tools.validation.findings import Finding
from corpus_tools.validation.reading import Files, group_files
from corpus_tools.validation.subject import Context, Subject, check_subject
from corpus_tools.validation.thresholds import load_thresholds
from mocap_fit.corpus import DESCRIPTION_FILE, Corpus, open_corpus
from mocap_fit.edits import EditList, load_edits, start_edits
from mocap_fit.errors import ConfigurationError, DataError, MocapFitError, MocapFitWarning
from mocap_fit.face import Rig, load_face
from mocap_fit.fitting import Layout, find_layout, load_layout
from mocap_fit.fitting.layout import list_layouts
from mocap_fit.fitting.speaker import Speaker, fit_speaker
from mocap_fit.head import remove_head_motion
from mocap_fit.io import ReadOptions
from mocap_fit.labels import Labels, read_labels
from mocap_fit.labels.phone_labels import to_labels, to_phones
from mocap_fit.phones import PhoneSequence
from mocap_fit.sound import Sound, read_sound
from mocap_fit.tracks import MarkerTracks, ParameterTracks

# Names of files that hold the reference pose of the recordings beside them.
_REFERENCES = ("reference", "rest")
# Frames: longer recordings are shown with a fit only where it is there already.
_MOST_FITTED = 12_000
# Frames nearest to rest that take the part of a reference pose that a corpus does not hold.
_REST_FRAMES = 9


@dataclass(frozen=True)
class Sources:
    """What belongs to a path and is not found, or found wrongly, by itself.

    Parameters
    ----------
    reference
        The recording of the reference pose.
    layout
        Name or file of the marker layout.
    face
        ``built-in``, or a rig file.
    recording
        The recording that a fit is of.
    labels
        The labels.
    sound
        The sound.
    phone_set
        Name or file of the phone set of the labels.
    edits
        The edit list, or the folder of the lists.
    utterance
        Id of the utterance of a corpus that is shown; the first by default.
    options
        How recordings are read.
    """

    reference: Path_ | None = None
    layout: str | None = None
    face: str | None = None
    recording: Path_ | None = None
    labels: Path_ | None = None
    sound: Path_ | None = None
    phone_set: str | None = None
    edits: Path_ | None = None
    utterance: str | None = None
    options: ReadOptions = field(default_factory=ReadOptions)


def gather(path: Path_, sources: Sources | None = None) -> Material:
    """Gather all that is shown of a path.

    Parameters
    ----------
    path
        A recording, a fit, a corpus, the parameters of one of its utterances, a trained model, or
        a marker layout: a file or the name of a shipped one.
    sources
        What belongs to it and is not found beside it.

    Returns
    -------
    Material
        What there is to show.

    Raises
    ------
    MocapFitError
        If it, or what belongs to it, cannot be read.
    """
    sources = sources or Sources()
    file = Path(path)
    folder = file.parent if file.name == DESCRIPTION_FILE else file
    if (folder / DESCRIPTION_FILE).is_file():
        return gather_utterance(open_corpus(folder), sources.utterance)
    if file.parent.name == "tracks" and (file.parents[1] / DESCRIPTION_FILE).is_file():
        return gather_utterance(open_corpus(file.parents[1]), file.stem)
    if file.suffix.lower() == ".toml" or (str(path) in list_layouts() and not file.exists()):
        return _gather_layout(path, sources)
    if zipfile.is_zipfile(file):
        return _gather_model(file, sources)
    tracks = sources.options.read(file)
    if isinstance(tracks, ParameterTracks):
        return _gather_fit(file, tracks, sources)
    if not isinstance(tracks, MarkerTracks):
        raise DataError(
            "poses of rigid bodies alone cannot be looked at",
            path=file,
            expected="a recording of markers, a fit, a corpus, a model or a layout",
        )
    edits = load_edits(file, sources.edits) or start_edits(file)
    return gather_recording(file, tracks, edits, sources)


def gather_recording(
    path: Path,
    tracks: MarkerTracks,
    edits: EditList,
    sources: Sources,
    former: Material | None = None,
) -> Material:
    """Gather what belongs to a recording; a better edit list makes it new from what was read.

    Parameters
    ----------
    path
        The file.
    tracks
        What it holds, without edits.
    edits
        What was mended.
    sources
        What belongs to it and is not found beside it.
    former
        What there was to show with other edits: what they do not change is taken from it.

    Returns
    -------
    Material
        What there is to show.

    Raises
    ------
    MocapFitError
        If an edit cannot be applied, or the reference pose, labels or sound cannot be read.
    """
    recording = edits.apply(tracks)
    layout = _find_layout(recording, path, sources)
    files = _find_beside(path)
    labels = _read_labels(path, files, sources, edits)
    sound = _read_sound(files, sources)
    if former is None or former.layout != layout:
        speaker, reasons = _find_speaker(path, layout, sources)
    else:
        speaker, reasons = former.speaker, () if former.speaker else former.notes
    if former is not None and recording.equals(former.recording):
        heads, measured, notes = former.heads, former.measured, former.notes
    else:
        heads, measured, notes = _fit(recording, speaker, reasons)
    rig = None if speaker is None else speaker.binding.rig
    findings = _check(path, recording, labels, sound, layout, sources)
    return Material(
        title=path.name,
        path=path,
        notes=notes,
        rig=rig,
        heads=heads,
        recording=recording,
        measured=measured,
        speaker=speaker,
        layout=layout,
        labels=labels,
        phones=_to_phones(labels, sources),
        sound=sound,
        findings=findings,
        edits=edits,
    )


def _fit(
    recording: MarkerTracks, speaker: Speaker | None, reasons: tuple[str, ...]
) -> tuple[Mapping[str, ParameterTracks], MarkerTracks | None, tuple[str, ...]]:
    """Return the fit of a recording, its markers on the face, or why there are none."""
    if speaker is None:
        return {}, None, reasons
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", MocapFitWarning)
            still, _ = speaker.remove_head_motion(speaker.prepare(recording))
            measured = bring_to_face(still, speaker)
            if recording.frames > _MOST_FITTED:
                return {}, measured, (*reasons, "not fitted, because it is long: fit it first")
            return {"fit": speaker.fit_shape(still).parameters}, measured, ()
    except MocapFitError as error:
        return {}, None, (*reasons, f"not fitted: {error.problem}")


def gather_utterance(corpus: Corpus, name: str | None = None) -> Material:
    """Gather what a corpus has of an utterance.

    Parameters
    ----------
    corpus
        The corpus, on disk.
    name
        Id of the utterance; the first by default.

    Returns
    -------
    Material
        What there is to show.

    Raises
    ------
    MocapFitError
        If there is no such utterance, or it cannot be read.
    """
    utterance = corpus[name] if name is not None else corpus.utterances[0]
    assert utterance.folder is not None
    rig = load_face(corpus.face)
    layout = load_layout(corpus.layout)
    tracks, phones = utterance.read_tracks(), utterance.read_phones()
    sound = None if utterance.sound_file is None else read_sound(utterance.sound_file)
    recording = speaker = measured = None
    if (utterance.folder / "markers" / f"{utterance.id}.parquet").is_file():
        recording = utterance.read_markers()
        speaker, measured = _bring_utterance_to_face(recording, tracks, rig, layout)
    subject = Subject(
        utterance.id, markers=recording, parameters=tracks, sound=sound, on_one_clock=True
    )
    context = Context(load_thresholds(), layout, rig, corpus.phone_set)
    return Material(
        title=f"{utterance.folder.name}: {utterance.id}",
        path=utterance.folder,
        notes=tuple(filter(None, (utterance.text, *utterance.checks))),
        rig=rig,
        heads={"fit": tracks},
        recording=recording,
        measured=measured,
        speaker=speaker,
        layout=layout,
        labels=to_labels(phones, phone_set=corpus.phone_set),
        phones=phones,
        sound=sound,
        findings=tuple(check_subject(subject, context)[0]),
        utterances=corpus.utterances,
    )


def bring_to_face(still: MarkerTracks, speaker: Speaker) -> MarkerTracks:
    """Bring markers to the coordinates of the face.

    Parameters
    ----------
    still
        Markers in the speaker's head coordinates.
    speaker
        The speaker.

    Returns
    -------
    MarkerTracks
        The markers, millimetres of the face.
    """
    return still.replace(positions=speaker.binding.orientation.apply(still.positions))


def _bring_utterance_to_face(
    recording: MarkerTracks,
    tracks: ParameterTracks,
    rig: Rig,
    layout: Layout,
) -> tuple[Speaker | None, MarkerTracks | None]:
    """Return who the markers of an utterance are tied to, and the markers on the face.

    A corpus does not hold the reference pose: the frames nearest to rest take its part, with the
    parameters that they have.
    """
    distance = np.linalg.norm(tracks.values, axis=1) + 10.0 * (~recording.visible).sum(axis=1)
    chosen = np.argsort(np.where(np.isnan(distance), np.inf, distance))[:_REST_FRAMES]
    values = np.nanmean(tracks.values[chosen], axis=0).clip(0.0, 1.0)
    settled = layout.model_copy(
        update={"reference_parameters": dict(zip(tracks.names, map(float, values), strict=True))}
    )
    try:
        still, _ = remove_head_motion(recording, names=[m.name for m in layout.head_markers])
        pose = still.replace(positions=still.positions[chosen], origin=still.origin[chosen])
        speaker = fit_speaker(rig, settled, pose)
        return speaker, bring_to_face(speaker.remove_head_motion(recording)[0], speaker)
    except MocapFitError:
        return None, None


def _gather_fit(path: Path, tracks: ParameterTracks, sources: Sources) -> Material:
    arguments: dict[str, object] = {}
    for step in tracks.provenance:
        arguments |= step.arguments
    face = sources.face or str(arguments.get("face", "built-in"))
    source = _find_source(path, str(arguments.get("file", "")), sources)
    measured = recording = speaker = edits = None
    notes: tuple[str, ...] = ()
    files = _find_beside(source or path)
    if source is not None:
        recording = sources.options.read_tracks(source)
        edits = load_edits(source, sources.edits) or start_edits(source)
        recording = edits.apply(recording)
    layout = _load_layout(sources.layout or arguments.get("layout"))
    if recording is not None and source is not None:
        speaker, notes = _find_speaker(source, layout, sources)
        if speaker is not None:
            still, _ = speaker.remove_head_motion(speaker.prepare(recording))
            measured = bring_to_face(still, speaker)
    labels = _read_labels(source or path, files, sources, edits)
    sound = _read_sound(files, sources)
    rig = load_face(face) if speaker is None else speaker.binding.rig
    return Material(
        title=path.name,
        path=path,
        notes=notes,
        rig=rig,
        heads={"fit": tracks},
        recording=recording,
        measured=measured,
        speaker=speaker,
        layout=layout,
        labels=labels,
        phones=_to_phones(labels, sources),
        sound=sound,
        findings=_check(path, recording, labels, sound, layout, sources, tracks, rig),
    )


def _gather_layout(path: Path_, sources: Sources) -> Material:
    layout = load_layout(str(path))
    rig = load_face(sources.face or "built-in")
    return Material(
        title=f"layout {layout.name}",
        path=Path(path),
        notes=tuple(filter(None, (layout.description,))),
        rig=rig,
        layout=layout,
    )


def _gather_model(path: Path, sources: Sources) -> Material:
    """Gather a model with what it says of labels, or of the sample that comes with the package."""
    from mocap_fit.control import load
    from mocap_fit.io.samples import load_sample
    from mocap_fit.labels import read_phones

    model = load(path)
    file = sources.labels
    sound = sources.sound
    if file is None:
        file = load_sample("take_01.TextGrid")
        sound = sound or load_sample("take_01.wav")
    try:
        phones = read_phones(file, phone_set=model.phone_set_)
    except DataError as error:
        raise ConfigurationError(
            f"the model '{model.name}' needs labels in its phone set to be looked at",
            path=path,
            found=error.problem,
            expected=f"phones of {model.phone_set_.name}",
            advice="Give them with --labels, and their sound with --sound.",
        ) from None
    return Material(
        title=path.name,
        path=path,
        notes=(f"{model.name}, on {Path(file).name}",),
        rig=load_face(sources.face or "built-in"),
        heads={model.name: model.predict(phones)},
        labels=to_labels(phones, phone_set=model.phone_set_),
        phones=phones,
        sound=None if sound is None else read_sound(sound),
    )


def _load_layout(name: object) -> Layout | None:
    return load_layout(str(name)) if name else None


def _find_layout(recording: MarkerTracks, path: Path, sources: Sources) -> Layout | None:
    """Return the layout that is named, or fits, or None."""
    if sources.layout is not None:
        return load_layout(sources.layout)
    with contextlib.suppress(ConfigurationError):
        return find_layout(recording, [path.parent]).layout
    return None


def _find_beside(path: Path) -> Files:
    """Return the files of one name beside a recording."""
    known = [each for each in path.parent.glob(f"{path.stem}.*") if each.is_file()]
    groups, _ = group_files(known)
    return next((files for files in groups if files.name == path.stem), Files(path.stem))


def _find_source(path: Path, name: str, sources: Sources) -> Path | None:
    """Return the recording that a fit was made of, where it is beside the fit or its folder."""
    if sources.recording is not None:
        return Path(sources.recording)
    beside = [folder / name for folder in (path.parent, path.parent.parent) if name]
    return next((each for each in beside if each.is_file()), None)


def _find_speaker(
    path: Path, layout: Layout | None, sources: Sources
) -> tuple[Speaker | None, tuple[str, ...]]:
    """Return the speaker of a recording, or why there is none."""
    if layout is None:
        return None, ("no layout: the names of the markers belong to none that is known",)
    reference = sources.reference
    if reference is None:
        beside = [
            each
            for name in _REFERENCES
            for each in sorted(path.parent.glob(f"{name}.*"))
            if each.suffix == path.suffix
        ]
        if not beside:
            return None, ("no reference pose: give one with --reference",)
        reference = beside[0]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", MocapFitWarning)
        speaker = fit_speaker(
            sources.face or "built-in",
            layout,
            Path(reference),
            read=sources.options.read_tracks,
        )
    return speaker, ()


def _read_labels(
    path: Path, files: Files, sources: Sources, edits: EditList | None
) -> Labels | None:
    file = sources.labels or next(iter(files.labels), None)
    if file is None:
        return None
    labels = read_labels(file)
    return labels if edits is None else edits.apply_to_labels(labels)


def _read_sound(files: Files, sources: Sources) -> Sound | None:
    file = sources.sound or next(iter(files.sounds), None)
    return None if file is None else read_sound(file)


def _to_phones(labels: Labels | None, sources: Sources) -> PhoneSequence | None:
    if labels is None:
        return None
    try:
        return to_phones(labels, phone_set=sources.phone_set)
    except DataError:
        return None


def _check(
    path: Path,
    recording: MarkerTracks | None,
    labels: Labels | None,
    sound: Sound | None,
    layout: Layout | None,
    sources: Sources,
    parameters: ParameterTracks | None = None,
    rig: Rig | None = None,
) -> tuple[Finding, ...]:
    from mocap_fit.labels import find_phone_tier
    from mocap_fit.phones import load_phone_set

    phone_set = None if sources.phone_set is None else load_phone_set(sources.phone_set)
    tier = None
    if labels is not None:
        try:
            tier = find_phone_tier(labels, phone_set)
        except DataError:
            tier = None
    files: Mapping[str, str] = {"markers": str(path)}
    subject = Subject(
        path.stem,
        markers=recording,
        parameters=parameters,
        tier=tier,
        sound=sound,
        files=dict(files),
    )
    context = Context(load_thresholds(), layout, rig, phone_set, options=sources.options)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", MocapFitWarning)
        return tuple(check_subject(subject, context)[0])
