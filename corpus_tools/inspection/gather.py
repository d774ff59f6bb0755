"""Gather what belongs to a path: a recording, a fit, a corpus, an utterance, a model, a layout."""

from __future__ import annotations

import warnings
import zipfile
from pathlib import Path

import numpy as np

from corpus_tools.inspection.checking import check_material
from corpus_tools.inspection.material import Material, Path_
from corpus_tools.inspection.sources import (
    Sources,
    find_beside,
    find_layout_of,
    find_source,
    find_speaker,
    load_named_layout,
    read_labels_of,
    read_sound_of,
    to_phones_of,
)
from corpus_tools.validation.findings import Finding, Location
from corpus_tools.validation.reading import describe_failure
from corpus_tools.validation.sounds import check_pulses
from corpus_tools.validation.thresholds import load_thresholds
from mocap_fit.corpus import DESCRIPTION_FILE, Corpus, open_corpus
from mocap_fit.edits import EditList, load_edits, start_edits
from mocap_fit.errors import ConfigurationError, DataError, MocapFitError, MocapFitWarning
from mocap_fit.face import Rig, load_face
from mocap_fit.fitting import Layout, load_layout
from mocap_fit.fitting.layout import list_layouts
from mocap_fit.fitting.speaker import Speaker, fit_speaker
from mocap_fit.head import remove_head_motion
from mocap_fit.labels.phone_labels import to_labels
from mocap_fit.phones import load_phone_set
from mocap_fit.sound import Sound, read_sound, synchronise
from mocap_fit.tracks import MarkerTracks, ParameterTracks
from mocap_fit.tracks.rigid_sets import compute_median

# Frames: longer recordings are shown with a fit only where it is there already.
_MOST_FITTED = 12_000
# Frames nearest to rest that take the part of a reference pose that a corpus does not hold.
_REST_FRAMES = 9


def gather(path: Path_, sources: Sources | None = None) -> Material:
    """Gather all that is shown of a path.

    Parameters
    ----------
    path
        A recording, a fit, a corpus, one of its utterances (``CORPUS#ID``, or its parameters), a
        trained model, or a marker layout: a file or the name of a shipped one.
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
    named, _, utterance = str(path).rpartition("#")
    if named and (Path(named) / DESCRIPTION_FILE).is_file():
        return gather_utterance(open_corpus(named), utterance)
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
    layout = find_layout_of(recording, path, sources)
    files = find_beside(path)
    labels = read_labels_of(files, sources, edits)
    recording, sound, about_clock = _put_on_one_clock(
        path, recording, read_sound_of(files, sources)
    )
    if (
        former is not None
        and former.edits is not None
        and former.edits.reference == edits.reference
        and recording.equals(former.recording)
    ):
        material = former
    else:
        speaker, notes = find_speaker(path, recording, layout, sources, edits)
        material = _fit(Material(path.name, path, notes, recording=recording, speaker=speaker))
    material = material.replace(
        layout=layout,
        labels=labels,
        phones=to_phones_of(labels, sources),
        sound=sound,
        edits=edits,
        unedited=tracks,
    )
    return _finish(material, sources, about_clock)


def _fit(material: Material) -> Material:
    """Return a recording with its fit and its markers on the face, or with why there are none."""
    speaker, recording, notes = material.speaker, material.recording, material.notes
    if speaker is None or recording is None:
        return material
    material = material.replace(rig=speaker.binding.rig)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", MocapFitWarning)
            still, _ = speaker.remove_head_motion(speaker.prepare(recording))
            material = material.replace(measured=bring_to_face(still, speaker))
            if recording.frames > _MOST_FITTED:
                return material.replace(notes=(*notes, "not fitted, because it is long: fit it"))
            fit = speaker.fit_shape(still)
            return material.replace(
                heads={"fit": fit.parameters}, marker_residuals=fit.marker_residuals
            )
    except MocapFitError as error:
        return material.replace(notes=(*notes, f"not fitted: {error.problem}"))


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
    if not corpus.utterances:
        raise DataError("the corpus has no utterance to look at")
    utterance = corpus[name] if name is not None else corpus.utterances[0]
    assert utterance.folder is not None
    notes = [utterance.text, *utterance.checks]
    rig, layout = None, None
    try:
        rig, layout = load_face(corpus.face), load_layout(corpus.layout)
    except MocapFitError as error:
        notes.append(f"without {'markers' if rig else 'a face'}: {error.problem}")
    tracks, phones = utterance.read_tracks(), utterance.read_phones()
    sound = None if utterance.sound_file is None else read_sound(utterance.sound_file)
    recording = speaker = measured = None
    if (utterance.folder / "markers" / f"{utterance.id}.parquet").is_file():
        recording = utterance.read_markers()
    if recording is not None and rig is not None and layout is not None:
        speaker, measured = _bring_utterance_to_face(recording, tracks, rig, layout)
    material = Material(
        title=f"{utterance.folder.name}: {utterance.id}",
        path=utterance.folder,
        notes=tuple(filter(None, notes)),
        rig=rig,
        heads={"fit": tracks},
        recording=recording,
        measured=measured,
        speaker=speaker,
        layout=layout,
        labels=to_labels(phones, phone_set=corpus.phone_set),
        phones=phones,
        sound=sound,
        utterances=corpus.utterances,
    )
    findings = check_material(material, phone_set=corpus.phone_set, on_one_clock=True)
    return material.replace(findings=findings)


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
    values = np.nan_to_num(compute_median(tracks.values[chosen])).clip(0.0, 1.0)
    settled = layout.model_copy(
        update={"reference_parameters": dict(zip(tracks.names, map(float, values), strict=True))}
    )
    try:
        with warnings.catch_warnings():
            # That the lips move in it is no surprise.
            warnings.simplefilter("ignore", MocapFitWarning)
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
    source = find_source(path, str(arguments.get("file", "")), sources)
    measured = recording = speaker = edits = None
    notes: tuple[str, ...] = ()
    files = find_beside(source or path)
    sound, about_clock = read_sound_of(files, sources), None
    if source is not None:
        recording = sources.options.read_tracks(source)
        edits = load_edits(source, sources.edits) or start_edits(source)
        recording = edits.apply(recording)
        recording, sound, about_clock = _put_on_one_clock(source, recording, sound)
    layout = load_named_layout(sources.layout or arguments.get("layout"))
    if recording is not None and source is not None:
        speaker, notes = find_speaker(source, recording, layout, sources, edits)
        if speaker is not None:
            still, _ = speaker.remove_head_motion(speaker.prepare(recording))
            measured = bring_to_face(still, speaker)
    labels = read_labels_of(files, sources, edits)
    rig = load_face(face) if speaker is None else speaker.binding.rig
    material = Material(
        title=path.name,
        path=path,
        notes=notes,
        rig=rig,
        heads={"fit": _move_in_time(tracks, recording)},
        recording=recording,
        measured=measured,
        speaker=speaker,
        layout=layout,
        labels=labels,
        phones=to_phones_of(labels, sources),
        sound=sound,
    )
    return _finish(material, sources, about_clock)


def _move_in_time(tracks: ParameterTracks, recording: MarkerTracks | None) -> ParameterTracks:
    """Return the parameters on the clock of the recording that they are of, frame by frame."""
    if recording is None or recording.frames != tracks.frames:
        return tracks
    return tracks.replace(start_time=recording.start_time, rate=recording.rate)


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


def _put_on_one_clock(
    path: Path, recording: MarkerTracks, sound: Sound | None
) -> tuple[MarkerTracks, Sound | None, list[Finding] | None]:
    """Return the recording on the clock of its sound, the sound without pulses, and findings.

    Findings are None where the sound has no pulses: the clocks are then taken as one.
    """
    if sound is None or sound.channels < 2:
        return recording, sound, None
    location = Location(str(path))
    channel, findings = check_pulses(
        sound, recording.rate, recording.frames, location, load_thresholds()
    )
    if channel is None:
        return recording, sound, None
    try:
        recording, _ = synchronise(recording, sound, channel=channel)
    except DataError as error:
        findings.append(describe_failure(error, str(path)))
    return recording, sound.drop_channel(channel), findings


def _finish(material: Material, sources: Sources, about_clock: list[Finding] | None) -> Material:
    """Return the material with what is wrong with it, unless that takes long."""
    recording = material.recording
    material = material.replace(
        findings=tuple(about_clock or ()),
        is_checked=False,
        is_on_one_clock=about_clock is not None,
    )
    if recording is not None and recording.frames > _MOST_FITTED:
        return material
    return check(material, sources)


def check(material: Material, sources: Sources) -> Material:
    """Check what is shown, if that was not done.

    Parameters
    ----------
    material
        What is shown.
    sources
        What belongs to it.

    Returns
    -------
    Material
        With all findings.
    """
    if material.is_checked:
        return material
    findings = check_material(
        material,
        phone_set=None if sources.phone_set is None else load_phone_set(sources.phone_set),
        on_one_clock=material.is_on_one_clock,
        options=sources.options,
    )
    return material.replace(findings=(*material.findings, *findings), is_checked=True)
