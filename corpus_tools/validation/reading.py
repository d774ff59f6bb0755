"""Utterances read for their checks: from a corpus, or from files as a lab has them.

What cannot be read is a finding, and the rest of the utterance is checked all the same.
"""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

from corpus_tools.validation.findings import Finding, Location
from corpus_tools.validation.subject import Context, Subject, Summary, check_subject
from corpus_tools.validation.tables import (
    check_table,
    check_times,
    check_utterance_name,
    read_frame,
)
from corpus_tools.validation.thresholds import Thresholds
from mocap_fit.corpus import Utterance
from mocap_fit.edits import EDITS_ENDING, EditList, load_edits
from mocap_fit.errors import (
    DataError,
    FrameTimesError,
    MocapFitError,
    RateMismatchError,
    describe_error,
    is_debugging,
)
from mocap_fit.io import READERS
from mocap_fit.labels import LABEL_READERS, Label, Labels, Tier, find_phone_tier, read_all_labels
from mocap_fit.phones import PhoneSet
from mocap_fit.sound import SOUND_ENDINGS, read_sound
from mocap_fit.tracks import MarkerTracks, ParameterTracks, Tracks, read_parquet

# Folder of a corpus → what its files hold, their ending, and the name of the data in a `Subject`.
FOLDERS = {
    "tracks": ("parameters", "parquet", "parameters"),
    "phones": ("phones", "parquet", "labels"),
    "head": ("poses", "parquet", "head"),
    "markers": ("markers", "parquet", "markers"),
    "audio": ("sound", "wav", "sound"),
}
_Content = TypeVar("_Content")
Checked = tuple[list[Finding], list[Summary]]
"""What is wrong with an utterance, and what the checks of all need of it."""


def _describe_error(error: MocapFitError) -> str:
    """Return the text of an error without its file and its advice."""
    location = "" if error.line is None else f"line {error.line}: "
    if error.frame is not None:
        location += f"frame {error.frame}: "
    value = "" if error.found is None else f" ({str(error.found)[:200]})"
    return f"{location}{error.problem}{value}"


def describe_failure(error: Exception, file: str, utterance: str = "") -> Finding:
    """Return the finding of a file that cannot be read or checked.

    Parameters
    ----------
    error
        The error of the reader; one that is neither ours nor the system's is raised while
        debugging.
    file
        The file, as the user named it.
    utterance
        Id of the utterance; empty where none is known.

    Returns
    -------
    Finding
        The finding.
    """
    code, where = "MF001", Location(file, utterance)
    if not isinstance(error, MocapFitError):
        if is_debugging() and not isinstance(error, OSError | MemoryError):
            raise error
        return Finding(code, where, describe_error(error))
    if isinstance(error, FrameTimesError):
        code = "MF142"
    elif isinstance(error, RateMismatchError):
        code = "MF141"
    expected = "" if error.expected is None else str(error.expected)[:200]
    return Finding(code, where, _describe_error(error), expected, advice=error.advice or "")


def read_utterance(
    utterance: Utterance, shown: str, wanted: Sequence[str], limits: Thresholds
) -> tuple[Subject, list[Finding]]:
    """Read an utterance of a corpus on disk, and check its tables.

    Parameters
    ----------
    utterance
        Of the corpus's table.
    shown
        The corpus's folder, as the user named it.
    wanted
        Folders that must have a file of it.
    limits
        What counts as wrong.

    Returns
    -------
    subject
        What could be read.
    findings
        Files that are missing or cannot be read, tables that are wrong.
    """
    assert utterance.folder is not None
    subject = Subject(
        utterance.id,
        utterance.speaker,
        utterance.session,
        utterance.split,
        utterance.text,
        on_one_clock=True,
    )
    findings: list[Finding] = []
    for folder, (kind, ending, part) in FOLDERS.items():
        path = utterance.folder / folder / f"{utterance.id}.{ending}"
        name = os.path.join(shown, folder, path.name)
        if not path.is_file():
            if folder in wanted:
                code = "MF404" if folder == "audio" else "MF501"
                findings.append(
                    Finding(code, Location(name, utterance.id), "it is not there", "a file")
                )
            continue
        subject.files[part] = name
        try:
            if folder == "audio":
                subject.sound = read_sound(path)
            elif folder == "phones":
                findings += _read_phones(subject, path, name)
            else:
                findings += _read_tracks(subject, utterance, path, kind, name, limits)
        except Exception as error:
            findings.append(describe_failure(error, name, utterance.id))
    return subject, findings


def _read_phones(subject: Subject, path: Path, name: str) -> Iterator[Finding]:
    frame, description = read_frame(path, ("phones",))
    location = Location(name, subject.name)
    yield from check_table(frame, "phones", (), location)
    yield from check_utterance_name(frame, subject.name, location)
    yield from _check_name(description, subject.name, location)
    if not {"start", "end", "phone"} <= set(frame.columns):
        return
    rows = zip(frame["start"], frame["end"], frame["phone"], strict=True)
    try:
        entries = tuple(Label(float(s), float(e), str(phone)) for s, e, phone in rows)
    except (DataError, TypeError, ValueError):
        # The table's own checks have said so.
        return
    subject.tier = Tier("phones", entries)


def _read_tracks(
    subject: Subject, utterance: Utterance, path: Path, kind: str, name: str, limits: Thresholds
) -> Iterator[Finding]:
    frame, description = read_frame(path, (kind,))
    location = Location(name, subject.name)
    names = tuple(str(one) for one in description.get("names", ()))
    yield from check_table(frame, kind, names, location)
    yield from check_utterance_name(frame, subject.name, location)
    yield from _check_name(description, subject.name, location)
    yield from check_times(frame, description, location, limits)
    tracks = read_parquet(path)
    if isinstance(tracks, ParameterTracks):
        subject.parameters = tracks
        yield from _check_duration(tracks, utterance, location, limits)
    else:
        if isinstance(tracks, MarkerTracks):
            subject.markers = tracks
        yield from _check_frames(tracks, subject, location)


def _check_name(
    description: dict[str, Any], utterance: str, location: Location
) -> Iterator[Finding]:
    name = description.get("name")
    if name != utterance:
        where = Location(location.file, utterance, "name")
        yield Finding("MF504", where, f"the file says '{name}'", utterance)


def _check_duration(
    tracks: ParameterTracks, utterance: Utterance, location: Location, limits: Thresholds
) -> Iterator[Finding]:
    if not abs(tracks.duration - utterance.duration) <= limits.corpus.duration:
        text = f"{tracks.frames} frames at {tracks.rate:g} Hz, {tracks.duration:.4f} s"
        expected = f"{utterance.duration:.4f} s, as the table of utterances says"
        yield Finding("MF504", location.at("duration"), text, expected)


def _check_frames(tracks: Tracks, subject: Subject, location: Location) -> Iterator[Finding]:
    """Head and markers have the frames of the parameters."""
    parameters = subject.parameters
    if parameters is not None and tracks.frames != parameters.frames:
        text = f"{tracks.frames} frames"
        yield Finding("MF504", location, text, f"{parameters.frames}, as the parameters have")


@dataclass
class Files:
    """Files of one utterance, as a lab has them.

    Parameters
    ----------
    name
        What their names have in common.
    recordings, labels, sounds
        Paths.
    """

    name: str
    recordings: list[Path] = field(default_factory=list)
    labels: list[Path] = field(default_factory=list)
    sounds: list[Path] = field(default_factory=list)


def group_files(paths: Sequence[Path]) -> tuple[list[Files], list[Path]]:
    """Group files by utterance: those of one name belong together.

    Parameters
    ----------
    paths
        The files.

    Returns
    -------
    files
        By name, in order.
    others
        Those whose ending says nothing.
    """
    recordings = READERS.list_extensions()
    labels = LABEL_READERS.list_extensions()
    groups: dict[str, Files] = {}
    others = []
    for path in sorted(paths):
        ending = path.suffix.lower()
        if path.name.endswith(EDITS_ENDING):
            continue
        files = groups.get(path.stem) or Files(path.stem)
        if ending in SOUND_ENDINGS:
            files.sounds.append(path)
        elif ending == ".csv":
            (files.labels if _is_labels(path) else files.recordings).append(path)
        elif ending in recordings:
            files.recordings.append(path)
        elif ending in labels:
            files.labels.append(path)
        else:
            others.append(path)
            continue
        groups[path.stem] = files
    return [groups[name] for name in sorted(groups)], others


def list_files(folder: Path) -> tuple[list[Path], list[Path]]:
    """List the files in a folder and its subfolders that can be checked, and those that cannot.

    A table that no reader knows by its content is no recording, whatever its ending.

    Parameters
    ----------
    folder
        The folder.

    Returns
    -------
    chosen
        Files that can be checked.
    others
        Tables that no reader knows.
    """
    chosen, others = [], []
    known = READERS.list_extensions() | LABEL_READERS.list_extensions() | set(SOUND_ENDINGS)
    for path in sorted(folder.rglob("*")):
        hidden = any(part.startswith(".") for part in path.relative_to(folder).parts)
        if hidden or not path.is_file() or path.suffix.lower() not in known:
            continue
        if path.suffix.lower() in (".tsv", ".csv") and not _is_known(path):
            if not _is_of_sentences(path):
                others.append(path)
        else:
            chosen.append(path)
    return chosen, others


def _is_known(path: Path) -> bool:
    readers = [*READERS.load_all().values(), LABEL_READERS.get("csv")]
    fitting = [reader for reader in readers if path.suffix.lower() in reader.extensions]
    try:
        return any(reader.sniff(path) for reader in fitting)
    except Exception:
        # Reading it says what is wrong.
        return True


def _is_of_sentences(path: Path) -> bool:
    """Whether a table is that of a manifest's sentences, which `convert` reads."""
    try:
        with path.open(encoding="utf-8-sig") as stream:
            return "utterance" in stream.readline().rstrip("\n").split("\t")
    except (OSError, UnicodeDecodeError):
        return False


def describe_unknown(path: Path) -> Finding:
    """Return the finding of a file that no reader takes.

    Parameters
    ----------
    path
        The file.

    Returns
    -------
    Finding
        The finding.
    """
    if not path.exists():
        return Finding("MF001", Location(str(path)), "there is no such file or folder")
    text = f"no reader takes files in {path.suffix or 'no ending'}"
    return Finding("MF001", Location(str(path)), text, "a recording, labels, sound, or a corpus")


def _is_labels(path: Path) -> bool:
    return bool(LABEL_READERS.get("csv").sniff(path))


def locate_files(context: Context, files: Files) -> Location:
    """Return the location of an utterance's files as such.

    Parameters
    ----------
    context
        What their data are compared with.
    files
        The files.

    Returns
    -------
    Location
        All of them.
    """
    names = ", ".join(map(str, (*files.recordings, *files.labels, *files.sounds)))
    return Location(names, files.name)


def check_files(context: Context, files: Files) -> Checked:
    """Read the files of one utterance and check it; only summaries of its data stay in memory.

    Parameters
    ----------
    context
        What their data are compared with.
    files
        The files.

    Returns
    -------
    findings
        What is wrong.
    summaries
        What the checks of all utterances need of it.
    """
    subjects, findings = read_files(files, context)
    checked = [check_subject(subject, context) for subject in subjects]
    return findings + [f for more, _ in checked for f in more], [one for _, one in checked]


def read_files(files: Files, context: Context) -> tuple[list[Subject], list[Finding]]:
    """Read the files of one utterance.

    Parameters
    ----------
    files
        Of several recordings (or sounds, or labels) of one name each is an utterance of its own.
    context
        How they are read, and the phone set, to find the tier of phones.

    Returns
    -------
    subjects
        What could be read.
    findings
        What could not.
    """
    findings: list[Finding] = []
    subject = Subject(files.name)
    subjects = [subject]

    def take_subject(part: str) -> Subject:
        # A subject that has no such part yet.
        nonlocal subject
        if part in subject.files:
            subject = Subject(files.name)
            subjects.append(subject)
        return subject

    lists: list[EditList] = []

    def read_recording(path: Path) -> Tracks:
        tracks = context.options.read(path)
        try:
            edits = load_edits(path, context.edits)
            if edits is not None and isinstance(tracks, MarkerTracks):
                tracks = edits.apply(tracks)
                lists.append(edits)
        except MocapFitError as error:
            findings.append(describe_failure(error, str(path), files.name).replace(code="MF004"))
        return tracks

    def read_labels(path: Path) -> tuple[Labels, ...]:
        utterances = read_all_labels(path)
        try:
            for edits in lists:
                utterances = tuple(
                    edits.apply_to_labels(labels, phone_set=context.phone_set)
                    if len(utterances) == 1 or labels.name == files.name
                    else labels
                    for labels in utterances
                )
        except MocapFitError as error:
            findings.append(describe_failure(error, str(path), files.name).replace(code="MF004"))
        return utterances

    for file, tracks in _read_each(files.recordings, read_recording, files.name, findings):
        if isinstance(tracks, MarkerTracks):
            one = take_subject("markers")
            one.files["markers"], one.markers = file, tracks
        elif isinstance(tracks, ParameterTracks):
            one = take_subject("parameters")
            one.files["parameters"], one.parameters = file, tracks
    subject = subjects[0]
    for file, sound in _read_each(files.sounds, read_sound, files.name, findings):
        one = take_subject("sound")
        one.files["sound"], one.sound = file, sound
    subject = subjects[0]
    for file, utterances in _read_each(files.labels, read_labels, files.name, findings):
        for labels in utterances:
            one = take_subject("labels")
            if len(utterances) > 1:
                one.name = labels.name
            one.files["labels"] = file
            findings += _read_phone_tier(one, labels, context.phone_set)
    return [one for one in subjects if one.files], findings


def _read_each(
    paths: Sequence[Path], reader: Callable[[Path], _Content], name: str, findings: list[Finding]
) -> Iterator[tuple[str, _Content]]:
    """Yield the files that can be read with their contents; the others become findings."""
    for path in paths:
        try:
            content = reader(path)
        except Exception as error:
            findings.append(describe_failure(error, str(path), name))
        else:
            yield str(path), content


def _read_phone_tier(
    subject: Subject, labels: Labels, phone_set: PhoneSet | None
) -> Iterator[Finding]:
    try:
        tier = find_phone_tier(labels, phone_set)
        end = labels.end if tier.end is None else tier.end
        subject.tier = dataclasses.replace(tier, end=end)
    except DataError as error:
        yield describe_failure(error, subject.files["labels"], subject.name).replace(code="MF210")
