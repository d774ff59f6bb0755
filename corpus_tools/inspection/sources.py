"""What belongs to a recording: layout, reference pose, labels and sound, named or beside it."""

from __future__ import annotations

import contextlib
import glob
import warnings
from dataclasses import dataclass, field
from pathlib import Path

from corpus_tools.inspection.checking import REFERENCES
from corpus_tools.inspection.material import Path_
from corpus_tools.validation.reading import Files, group_files
from mocap_fit.edits import EditList
from mocap_fit.errors import ConfigurationError, DataError, MocapFitError, MocapFitWarning
from mocap_fit.fitting import Layout, find_layout, load_layout, suggest_reference
from mocap_fit.fitting.marker_names import match_names
from mocap_fit.fitting.reference_pose import read_reference
from mocap_fit.fitting.speaker import Speaker, fit_speaker
from mocap_fit.io import ReadOptions
from mocap_fit.labels import Labels, read_labels
from mocap_fit.labels.phone_labels import to_phones
from mocap_fit.phones import PhoneSequence
from mocap_fit.sound import Sound, read_sound
from mocap_fit.tracks import MarkerTracks


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


def load_named_layout(name: object) -> Layout | None:
    """Load a layout, if one is named.

    Parameters
    ----------
    name
        Its name or file; None or empty for none.

    Returns
    -------
    Layout or None
        The layout.
    """
    return load_layout(str(name)) if name else None


def find_layout_of(recording: MarkerTracks, path: Path, sources: Sources) -> Layout | None:
    """Find the layout of a recording: the one that is named, or that fits.

    Parameters
    ----------
    recording
        The recording.
    path
        Its file, beside which layouts are searched.
    sources
        What was named.

    Returns
    -------
    Layout or None
        The layout; None where none fits.
    """
    if sources.layout is not None:
        return load_layout(sources.layout)
    with contextlib.suppress(ConfigurationError):
        return find_layout(recording, [path.parent]).layout
    return None


def find_beside(path: Path) -> Files:
    """Find the files of the same name beside a recording, or in folders beside its own.

    Parameters
    ----------
    path
        The recording.

    Returns
    -------
    Files
        Recordings, labels and sounds.
    """
    name = glob.escape(path.stem)
    patterns = (path.parent, f"{name}.*"), (path.parent.parent, f"*/{name}.*")
    result = Files(path.stem)
    for folder, pattern in patterns:
        present = [each for each in folder.glob(pattern) if each.is_file()]
        groups, _ = group_files(present)
        for files in groups:
            if files.name == path.stem:
                result.labels = result.labels or files.labels
                result.sounds = result.sounds or files.sounds
    return result


def find_source(path: Path, name: str, sources: Sources) -> Path | None:
    """Find the recording of a fit: the one that is named, or beside the fit or its folder.

    Parameters
    ----------
    path
        The fit.
    name
        Name of the recording's file; empty where it is not known.
    sources
        What was named.

    Returns
    -------
    Path or None
        The recording; None where it is not there.
    """
    if sources.recording is not None:
        return Path(sources.recording)
    beside = [folder / name for folder in (path.parent, path.parent.parent) if name]
    return next((each for each in beside if each.is_file()), None)


def find_speaker(
    path: Path,
    recording: MarkerTracks,
    layout: Layout | None,
    sources: Sources,
    edits: EditList | None = None,
) -> tuple[Speaker | None, tuple[str, ...]]:
    """Find the speaker of a recording, by the reference pose.

    That is the one that is named, or set by an edit, or beside the recording, or else the stillest
    span of the recording with closed lips.

    Parameters
    ----------
    path
        The recording's file.
    recording
        What it holds, with all edits.
    layout
        The layout of its markers; None where it is not known.
    sources
        What was named.
    edits
        What was mended.

    Returns
    -------
    speaker : Speaker or None
        The speaker; None where none can be found.
    notes : tuple of str
        Why there is none, or which reference pose was chosen.

    Raises
    ------
    MocapFitError
        If the reference pose that was named cannot be used.
    """
    if layout is None:
        return None, ("no layout: the names of the markers belong to none that is known",)
    face = sources.face or "built-in"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", MocapFitWarning)
        if sources.reference is not None:
            read = sources.options.read_tracks
            return fit_speaker(face, layout, str(sources.reference), read=read), ()
        try:
            pose, note = _choose_reference(path, recording, layout, sources, edits)
            return fit_speaker(face, layout, pose), (note,) if note else ()
        except MocapFitError as error:
            return None, (f"no reference pose: {error.problem}; --reference names one",)


def _choose_reference(
    path: Path,
    recording: MarkerTracks,
    layout: Layout,
    sources: Sources,
    edits: EditList | None,
) -> tuple[MarkerTracks, str]:
    """Return a reference pose, and where it is from."""
    chosen = None if edits is None else edits.reference
    if chosen is not None:
        tracks, name = recording, path.name
        if chosen.recording is not None:
            name = chosen.recording
            tracks = sources.options.read_tracks(path.with_name(name))
        pose = tracks.between(chosen.start, chosen.end)
        end = pose.start_time + pose.duration
        return pose, f"reference pose: {name} from {pose.start_time:.2f} to {end:.2f} s, by an edit"
    for folder in (path.parent, path.parent.parent):
        for name in REFERENCES:
            beside = folder / f"{name}{path.suffix}"
            if beside.is_file():
                return read_reference(beside, sources.options.read_tracks)[0], ""
    named = match_names(layout, recording)
    span = suggest_reference(named, layout)
    note = (
        f"reference pose: this recording, {span.start:.2f} to {span.end:.2f} s, its stillest part"
    )
    return named.between(span.start, span.end), note


def read_labels_of(files: Files, sources: Sources, edits: EditList | None) -> Labels | None:
    """Read the labels of a recording: those that are named, or beside it.

    Parameters
    ----------
    files
        Files of its name.
    sources
        What was named.
    edits
        What was mended.

    Returns
    -------
    Labels or None
        The labels, with all edits; None without.
    """
    file = sources.labels or next(iter(files.labels), None)
    if file is None:
        return None
    labels = read_labels(file)
    return labels if edits is None else edits.apply_to_labels(labels)


def read_sound_of(files: Files, sources: Sources) -> Sound | None:
    """Read the sound of a recording: the one that is named, or beside it.

    Parameters
    ----------
    files
        Files of its name.
    sources
        What was named.

    Returns
    -------
    Sound or None
        The sound; None without.
    """
    file = sources.sound or next(iter(files.sounds), None)
    return None if file is None else read_sound(file)


def to_phones_of(labels: Labels | None, sources: Sources) -> PhoneSequence | None:
    """Convert labels to phones, where they hold any.

    Parameters
    ----------
    labels
        The labels; None without.
    sources
        What was named.

    Returns
    -------
    PhoneSequence or None
        The phones.
    """
    if labels is None:
        return None
    try:
        return to_phones(labels, phone_set=sources.phone_set)
    except DataError:
        return None
