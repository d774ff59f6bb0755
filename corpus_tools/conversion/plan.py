"""Plan a conversion: the manifest's utterances with their files, and what they share."""

from __future__ import annotations

import bisect
import contextlib
import dataclasses
import hashlib
import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import takewhile
from pathlib import Path
from typing import cast

from pydantic import ValidationError

from corpus_tools.batch import Item
from corpus_tools.conversion.entries import Entry, find_one_file
from corpus_tools.conversion.fit import FitSettings
from corpus_tools.conversion.manifest import Manifest
from mocap_fit.edits import EDITS_ENDING, EditList, load_edits
from mocap_fit.errors import ConfigurationError, MocapFitError, add_path, describe_error
from mocap_fit.face import load_face
from mocap_fit.fitting import Layout, find_layout, load_layout, parse_reference, read_reference
from mocap_fit.fitting.reference_pose import find_lips
from mocap_fit.fitting.speaker import Speaker, fit_speaker
from mocap_fit.io import ReadOptions
from mocap_fit.phones import PhoneSet, load_phone_set
from mocap_fit.tracks import MarkerTracks

PARTS = ("markers", "head", "phones", "tracks")
"""Folders of Parquet files; the tracks are written last, when everything else is there."""

AUDIO = "audio"
"""Folder of the sound."""


@dataclass(frozen=True, kw_only=True)
class UtteranceItem(Item):
    """An utterance and its files.

    Parameters
    ----------
    entry
        What the manifest says of it.
    edits
        What a person mended in recording and labels; None where that is nothing.
    """

    entry: Entry
    edits: EditList | None

    @property
    def recording(self) -> str:
        """Path of the recording under the root."""
        return self.sources[0]

    @property
    def labels(self) -> str:
        """Path of the labels under the root."""
        return self.sources[1]

    @property
    def sound(self) -> str | None:
        """Path of the sound under the root; None where there is none."""
        return self.sources[2] if len(self.sources) > 2 else None


@dataclass(frozen=True, eq=False)
class Settings:
    """What all utterances of a conversion share.

    Parameters
    ----------
    manifest
        The manifest.
    options
        How recordings are fitted.
    phone_set
        The phone set of the labels.
    speakers
        Speakers by the path of their reference pose.
    lips
        Names of a marker on the upper lip and of one on the lower lip; None where no start time
        is estimated.
    fingerprints
        By the path of the reference pose: a sum over everything but the utterance's own files
        that a result depends on.
    """

    manifest: Manifest
    options: FitSettings
    phone_set: PhoneSet
    speakers: Mapping[str, Speaker]
    lips: tuple[str, str] | None
    fingerprints: Mapping[str, str]


@dataclass(frozen=True, eq=False)
class Plan:
    """What a conversion will do.

    Parameters
    ----------
    entries
        All utterances, by id.
    items
        Those that can be tried.
    refused
        By id, why an utterance cannot be converted.
    settings
        What the utterances share.
    phone_set_file
        Name and content of the phone set's file, where it is not a shipped one.
    """

    entries: tuple[Entry, ...]
    items: tuple[UtteranceItem, ...]
    refused: Mapping[str, str]
    settings: Settings
    phone_set_file: tuple[str, bytes] | None


def make_plan(manifest: Manifest, entries: tuple[Entry, ...], root: Path) -> Plan:
    """Find the files of all utterances, and load what they share.

    An utterance whose files are missing, or whose reference pose cannot be used, is refused
    alone; a layout, face or phone set that cannot be used stops everything.

    Parameters
    ----------
    manifest
        The manifest.
    entries
        Its utterances.
    root
        Folder that its paths are under.

    Returns
    -------
    Plan
        What can be converted.

    Raises
    ------
    MocapFitError
        If layout, face or phone set cannot be used, or start times should be estimated and the
        layout has no lips.
    """
    face_name = _locate(root, manifest.face)
    read = (ReadOptions() if manifest.reference_as_is else manifest.reading).read_tracks
    patterns = sorted({entry.reference for entry in entries})
    layout_name = (
        _find_layout(root, patterns, read)
        if manifest.layout is None
        else _locate(root, manifest.layout)
    )
    set_name = _locate(root, manifest.phone_set)
    phone_set = load_phone_set(set_name)
    is_shipped = set_name == manifest.phone_set
    set_file = None if is_shipped else (Path(set_name).name, Path(set_name).read_bytes())
    layout = lips = None
    if layout_name is not None:
        layout = _set_size_varies(load_layout(layout_name), manifest.fit.size_varies, layout_name)
        lips = _find_lips(layout, layout_name) if manifest.sync.kind == "estimate" else None
    options = cast(FitSettings, manifest.fit.model_dump(exclude={"size_varies", "allow_mirrored"}))
    speakers: dict[str, Speaker] = {}
    fingerprints: dict[str, str] = {}
    unusable: dict[str, str] = {}
    shared = _sum_shared(manifest, b"" if set_file is None else set_file[1])
    for pattern in patterns:
        try:
            speaker = fit_speaker(
                face_name,
                layout_name,
                _find_reference(root, pattern),
                allow_mirrored=manifest.fit.allow_mirrored,
                read=read,
            )
            speaker = dataclasses.replace(speaker, layout=layout or speaker.layout)
        except (MocapFitError, OSError) as error:
            unusable[pattern] = describe_error(error)
            continue
        speakers[pattern] = speaker
        both = f"{speaker.compute_fingerprint(**options)}\0{shared}"
        fingerprints[pattern] = hashlib.sha256(both.encode()).hexdigest()
    if not speakers:
        # A face that cannot be used is no fault of the reference poses.
        load_face(face_name)
    usable = [entry for entry in entries if entry.reference not in unusable]
    items, refused = find_files(manifest, usable, root)
    refused |= {e.id: unusable[e.reference] for e in entries if e.reference in unusable}
    settings = Settings(manifest, options, phone_set, speakers, lips, fingerprints)
    return Plan(entries, items, refused, settings, set_file)


def find_files(
    manifest: Manifest, entries: Iterable[Entry], root: Path
) -> tuple[tuple[UtteranceItem, ...], dict[str, str]]:
    """Find the files of utterances.

    Parameters
    ----------
    manifest
        The manifest.
    entries
        Its utterances.
    root
        Folder that its paths are under.

    Returns
    -------
    items
        The utterances that have all their files.
    refused
        Why others cannot be converted, by id.
    """
    finder = _Finder(root)
    items: list[UtteranceItem] = []
    refused: dict[str, str] = {}
    for entry in entries:
        try:
            items.append(_find_files(manifest, entry, finder))
        except MocapFitError as error:
            refused[entry.id] = str(error)
    return tuple(items), refused


def _locate(root: Path, name: str) -> str:
    """Return the path of a file under the root if there is one, else the name of a shipped one."""
    return str(root / name) if (root / name).is_file() else name


def _find_layout(
    root: Path, patterns: Sequence[str], read: Callable[[str | Path], MarkerTracks]
) -> str | None:
    """Return the layout that fits the first reference pose; None where none can be read."""
    for pattern in patterns:
        try:
            source = _find_reference(root, pattern)
            pose, _ = read_reference(source, read)
        except (MocapFitError, OSError):
            # It is refused with the utterances that need it.
            continue
        try:
            return find_layout(pose, [root, parse_reference(source).path.parent]).source
        except ConfigurationError as error:
            raise add_path(error, source) from None
    return None


def _find_reference(root: Path, pattern: str) -> str:
    """Return the file of a reference pose, with its span where the pattern has one."""
    where = parse_reference(pattern)
    path = find_one_file(root, str(where.path))
    if path is None:
        raise ConfigurationError(
            "the reference pose is missing",
            path=root / pattern,
            advice="Record the face at rest with lips closed, or name its file.",
        )
    return str(dataclasses.replace(where, path=path))


def _sum_shared(manifest: Manifest, phone_set_file: bytes) -> str:
    """Return a sum over how files are read and synchronised."""
    content = manifest.model_dump(
        mode="json", include={"phone_set", "labels", "sound", "sync"}, exclude_none=True
    )
    content["reading"] = [manifest.reading.to_dict(), manifest.fit.allow_mirrored]
    for part in ("labels", "sound"):
        content[part].pop("pattern")
    total = hashlib.sha256(json.dumps(content, sort_keys=True).encode())
    total.update(phone_set_file)
    return total.hexdigest()


def _set_size_varies(layout: Layout, size_varies: bool | None, name: str) -> Layout:
    """Return the layout with the manifest's ``size_varies``."""
    if size_varies is None:
        return layout
    try:
        return Layout.model_validate({**layout.model_dump(), "size_varies": size_varies})
    except ValidationError as error:
        raise ConfigurationError(
            "size_varies cannot be set for this layout",
            path=name,
            found=str(error.errors()[0]["msg"]).removeprefix("Value error, "),
        ) from None


def _find_lips(layout: Layout, name: str) -> tuple[str, str]:
    lips = find_lips(layout)
    if lips is None:
        raise ConfigurationError(
            "the layout has no markers in the middle of both lips, which an estimated offset needs",
            path=name,
            expected="feature points 2.2 and 2.3, or 8.1 and 8.2",
            advice="Choose another kind of [sync] in the manifest.",
        )
    return lips


_MISSING = {
    "recordings": ("the recording of '{id}' is missing", "Add the file"),
    "labels": ("the labels of '{id}' are missing", "Make them with mocap-fit align"),
    "sound": ("the sound of '{id}' is missing", "Add the file"),
}


def _find_files(manifest: Manifest, entry: Entry, finder: _Finder) -> UtteranceItem:
    sources: list[str] = []
    for part, (problem, advice) in _MISSING.items():
        pattern: str = getattr(manifest, part).pattern.replace("{id}", entry.stem)
        path = finder.find(pattern)
        if path is not None:
            sources.append(path)
        elif part != "sound" or manifest.sound.required or manifest.sync.kind != "none":
            raise ConfigurationError(
                problem.format(id=entry.id),
                path=finder.root / pattern,
                advice=f"{advice}, or take the utterance out of the table of sentences.",
            )
    edits = load_edits(finder.root / sources[0], _locate_edits(manifest, entry, finder.root))
    targets = [f"{part}/{entry.id}.parquet" for part in PARTS]
    if len(sources) == len(_MISSING):
        targets.insert(0, f"{AUDIO}/{entry.id}.wav")
    folder = finder.root.absolute()
    return UtteranceItem(entry.id, folder, tuple(sources), tuple(targets), entry=entry, edits=edits)


def _locate_edits(manifest: Manifest, entry: Entry, root: Path) -> Path | None:
    """Return the edit list that the manifest names; None for the one beside the recording."""
    if manifest.edits is None:
        return None
    path = root / manifest.edits.replace("{id}", entry.stem)
    return path if path.is_file() else None


class _Finder:
    """Files by pattern; a folder is listed once, however many utterances it has."""

    def __init__(self, root: Path) -> None:
        self.root = root
        self._listed: dict[Path, list[str]] = {}

    def find(self, pattern: str) -> str | None:
        """Return the path under the root of the one file; None where there is none."""
        stem, star, after = pattern.partition("*")
        folder, _, beginning = stem.rpartition("/")
        if not star:
            return pattern if (self.root / pattern).is_file() else None
        if after or not beginning:
            path = find_one_file(self.root, pattern)
            return None if path is None else path.relative_to(self.root).as_posix()
        names = self._list_names(self.root / folder)
        first = bisect.bisect_left(names, beginning)
        matches = list(takewhile(lambda name: name.startswith(beginning), names[first:]))
        if len(matches) > 1:
            find_one_file(self.root, pattern)
        return f"{folder}/{matches[0]}".removeprefix("/") if matches else None

    def _list_names(self, folder: Path) -> list[str]:
        if folder not in self._listed:
            self._listed[folder] = []
            with contextlib.suppress(OSError):
                self._listed[folder] = sorted(
                    path.name
                    for path in folder.iterdir()
                    if path.is_file() and not path.name.endswith(EDITS_ENDING)
                )
        return self._listed[folder]
