"""What there is to convert: the manifest's utterances with their files, and what they share."""

from __future__ import annotations

import bisect
import dataclasses
import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from corpus_tools.conversion.manifest import Entry, Manifest, one_file
from corpus_tools.conversion.one_recording import FitSettings
from mocap_fit.errors import ConfigurationError, MocapFitError, describe_error
from mocap_fit.face import load_face
from mocap_fit.fitting import Layout, load_layout
from mocap_fit.fitting.speaker import Speaker, fit_speaker
from mocap_fit.phones import PhoneSet, load_phone_set

# Feature points of MPEG-4 on the upper and lower lip: inner border, outer border.
_LIPS = (("2.2", "2.3"), ("8.1", "8.2"))


@dataclass(frozen=True)
class Job:
    """An utterance and its files, under the root.

    Parameters
    ----------
    entry
        What the manifest says of it.
    recording, labels
        Paths under the root.
    sound
        None where it has none.
    """

    entry: Entry
    recording: str
    labels: str
    sound: str | None

    @property
    def files(self) -> tuple[str, ...]:
        """All that there are."""
        return tuple(f for f in (self.recording, self.labels, self.sound) if f is not None)


@dataclass(frozen=True, eq=False)
class Settings:
    """What all utterances share.

    Parameters
    ----------
    manifest, options
        As the manifest says.
    phone_table
        The phone set, as what can be sent to another process.
    speakers
        By the path of the reference pose.
    lips
        Markers of the upper and the lower lip; None where no estimate is wanted.
    fingerprints
        By the path of the reference pose: a sum over all but the utterance's own files that a
        result depends on.
    fresh
        Convert also what is converted already.
    """

    manifest: Manifest
    options: FitSettings
    phone_table: Mapping[str, Any]
    speakers: Mapping[str, Speaker]
    lips: tuple[str, str] | None
    fingerprints: Mapping[str, str]
    fresh: bool = False

    @cached_property
    def phone_set(self) -> PhoneSet:
        """What the labels are written in."""
        return PhoneSet.from_dict(self.phone_table)

    def __getstate__(self) -> dict[str, Any]:
        return {key: value for key, value in self.__dict__.items() if key != "phone_set"}

    def inputs(self, job: Job, contents: Mapping[str, str]) -> str:
        """A sum over all that the files of an utterance depend on.

        Parameters
        ----------
        job
            The utterance.
        contents
            By path, the sum over each of its files.
        """
        named = [[path, contents[path]] for path in job.files]
        entry = job.entry
        about = [self.fingerprints[entry.reference], entry.id, entry.start_time, named]
        return hashlib.sha256(json.dumps(about).encode()).hexdigest()


@dataclass(frozen=True, eq=False)
class Plan:
    """What is to be done.

    Parameters
    ----------
    entries
        All utterances, by id.
    jobs
        Those that can be tried.
    refused
        By id, why an utterance cannot be.
    settings
        What the jobs share.
    phone_set_file
        Content of the phone set's file, where it is the user's own.
    """

    entries: tuple[Entry, ...]
    jobs: tuple[Job, ...]
    refused: Mapping[str, str]
    settings: Settings
    phone_set_file: tuple[str, bytes] | None = field(default=None)


def named_file(root: Path, name: str) -> str:
    """A file under the root if there is one of that name, else the name of something shipped."""
    return str(root / name) if (root / name).is_file() else name


def make_plan(
    manifest: Manifest, entries: tuple[Entry, ...], root: Path, *, fresh: bool = False
) -> Plan:
    """Find the files of all utterances, and load what they share.

    An utterance whose files are not there, or whose reference pose cannot be used, is refused
    alone; a layout, face or phone set that cannot be used stops everything.

    Raises
    ------
    MocapFitError
        If layout, face or phone set cannot be used, or an estimate is wanted of a layout without
        lips.
    """
    layout_name, face_name = named_file(root, manifest.layout), named_file(root, manifest.face)
    set_name = named_file(root, manifest.phone_set)
    phone_set = load_phone_set(set_name)
    own = Path(set_name).read_bytes() if set_name != manifest.phone_set else None
    layout = _sized(load_layout(layout_name), manifest.fit.size_varies, layout_name)
    lips = _lips(layout, layout_name) if manifest.sync.kind == "estimate" else None
    fit = manifest.fit
    options: FitSettings = {
        "objective": fit.objective,
        "solver": fit.solver,
        "refine_pose": fit.refine_pose,
        "smooth": fit.smooth,
    }
    speakers: dict[str, Speaker] = {}
    fingerprints: dict[str, str] = {}
    unusable: dict[str, str] = {}
    shared = _shared_sum(manifest, own)
    for pattern in sorted({entry.reference for entry in entries}):
        try:
            path = one_file(root, pattern)
            if path is None:
                raise ConfigurationError(
                    "the reference pose is missing",
                    path=root / pattern,
                    advice="Record the face at rest with lips closed, or name its file.",
                )
            speaker = fit_speaker(face_name, layout_name, path)
            speaker = dataclasses.replace(speaker, layout=layout)
        except (MocapFitError, OSError) as error:
            unusable[pattern] = describe_error(error)
            continue
        speakers[pattern] = speaker
        both = f"{speaker.compute_fingerprint(**options)}\0{shared}"
        fingerprints[pattern] = hashlib.sha256(both.encode()).hexdigest()
    if not speakers:
        # One that cannot be used is no fault of the reference poses.
        load_face(face_name)
    finder = _Finder(root)
    jobs: list[Job] = []
    refused: dict[str, str] = {}
    for entry in entries:
        if entry.reference in unusable:
            refused[entry.id] = unusable[entry.reference]
            continue
        try:
            jobs.append(_job(manifest, entry, finder))
        except MocapFitError as error:
            refused[entry.id] = str(error)
    table = phone_set.to_dict()
    settings = Settings(manifest, options, table, speakers, lips, fingerprints, fresh)
    kept = None if own is None else (Path(set_name).name, own)
    return Plan(entries, tuple(jobs), refused, settings, kept)


def _shared_sum(manifest: Manifest, phone_set_file: bytes | None) -> str:
    """What results depend on besides speaker and fit: how files are read and brought together."""
    said = manifest.model_dump(
        mode="json", include={"phone_set", "rate", "labels", "sound", "sync"}, exclude_none=True
    )
    for part in ("labels", "sound"):
        said[part].pop("pattern")
    total = hashlib.sha256(json.dumps(said, sort_keys=True).encode())
    total.update(phone_set_file or b"")
    return total.hexdigest()


def _sized(layout: Layout, size_varies: bool | None, name: str) -> Layout:
    """The layout with what the manifest says of sizes."""
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


def _lips(layout: Layout, name: str) -> tuple[str, str]:
    by_point = {m.feature_point: m.name for m in layout.face_markers}
    for upper, lower in _LIPS:
        if upper in by_point and lower in by_point:
            return by_point[upper], by_point[lower]
    raise ConfigurationError(
        "the layout has no markers in the middle of both lips, which an estimated offset needs",
        path=name,
        expected="feature points 2.2 and 2.3, or 8.1 and 8.2",
        advice="Choose another kind of [sync] in the manifest.",
    )


def _job(manifest: Manifest, entry: Entry, finder: _Finder) -> Job:
    found: dict[str, str | None] = {}
    for part, noun in (("recordings", "recording"), ("labels", "labels"), ("sound", "sound")):
        pattern: str = getattr(manifest, part).pattern.replace("{id}", entry.id)
        found[part] = finder.find(pattern)
        needed = part != "sound" or manifest.sound.required or manifest.sync.kind != "none"
        if found[part] is None and needed:
            raise ConfigurationError(
                f"the {noun} of '{entry.id}' is missing"
                if part != "labels"
                else f"the labels of '{entry.id}' are missing",
                path=finder.root / pattern,
                advice="Add the file, or take the utterance out of the table of sentences."
                if part != "labels"
                else "Make them with mocap-fit align, or take the utterance out of the table.",
            )
    recording, labels = found["recordings"], found["labels"]
    assert recording is not None
    assert labels is not None
    return Job(entry, recording, labels, found["sound"])


class _Finder:
    """Files by pattern; a folder is listed once, however many utterances it has."""

    def __init__(self, root: Path) -> None:
        self.root = root
        self._listed: dict[Path, list[str]] = {}

    def find(self, pattern: str) -> str | None:
        """The path under the root of the one file; None where there is none."""
        stem, star, after = pattern.partition("*")
        folder, _, beginning = stem.rpartition("/")
        if not star:
            return pattern if (self.root / pattern).is_file() else None
        if after or not beginning:
            path = one_file(self.root, pattern)
            return None if path is None else path.relative_to(self.root).as_posix()
        names = self._names(self.root / folder)
        first = bisect.bisect_left(names, beginning)
        matches = []
        for name in names[first:]:
            if not name.startswith(beginning):
                break
            matches.append(name)
        if len(matches) > 1:
            one_file(self.root, pattern)
        if not matches:
            return None
        return f"{folder}/{matches[0]}" if folder else matches[0]

    def _names(self, folder: Path) -> list[str]:
        if folder not in self._listed:
            try:
                self._listed[folder] = sorted(p.name for p in folder.iterdir() if p.is_file())
            except OSError:
                self._listed[folder] = []
        return self._listed[folder]


def described(manifest: Manifest) -> dict[str, Any]:
    """The manifest as the corpus's provenance has it."""
    said: dict[str, Any] = manifest.model_dump(mode="json", exclude_none=True)
    return said
