"""The manifest of a corpus: a TOML file that says where recordings, labels and sound are.

All paths are under the root that `mocap-fit convert` is given. Every key has a default but those
marked with *; without a manifest (a folder is given in its place), the defaults are the folder
convention: ``recordings/ labels/ sound/ reference.* sentences.tsv``. ::

    format_version = 1
    language = "en"              # BCP 47; empty where not known
    phone_set = "en-arpabet"     #* a shipped name, or a TOML file under the root
    layout = "face30-head5"      # a shipped name, or a TOML file under the root
    face = "built-in"            # or a rig file under the root
    rate = 60.0                  # Hz that every recording must have; not checked where not given
    start_time = 0.0             # s, the first frame on the clock of the sound; else the file's own

    [recordings]
    pattern = "recordings/{id}.*"   # one file must match
    [labels]
    pattern = "labels/{id}.*"    # without {id}: one file has all (HTK's .mlf)
    phones = "phones"            # names of the tiers; found by content where not given
    words = "words"
    table = { "ax" = "AH" }      # labels that the phone set lacks → what to read them as
    [sound]
    pattern = "sound/{id}.wav"   # a corpus without sound has no such file for any utterance
    required = false             # true: an utterance without sound is an error
    [sync]
    kind = "none"                # "pulses": one a frame, on a channel of the sound; "estimate": by
                                 # opening lips and energy; "none": start_time or the file's own
    channel = 2                  # of the pulses, from 1; it is not copied to the corpus
    spare = [0, 0]               # pulses before the first frame's and after the last's
    largest_offset = 0.5         # s from start_time, how far an estimate is looked for
    [sentences]
    file = "sentences.tsv"       # tab-separated: utterance, and if known split text speaker session
    [splits]
    test_fraction = 0.303        # where the table has no split it is drawn: 87 of 287
    seed = 0
    [fit]
    objective = "distances"
    solver = "newton-nlopt"
    refine_pose = false
    smooth = false
    size_varies = true           # the layout's own where not given

    [[speakers]]
    id = "speaker"
    reference = "reference.*"    # one file must match
    [[sessions]]                 # a session with a reference pose or a clock of its own
    id = "2"
    speaker = "speaker"
    reference = "reference_2.tsv"
    start_time = 0.1

With pulses, `start_time` is where the first frame is about: it decides where the first or the last
pulse is missing, and may be left out. Splits that are drawn stay when utterances are added to a
corpus (`entries`).
"""

from __future__ import annotations

import csv
import io
import re
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath
from typing import Annotated, Any, Literal, Self

from pydantic import AfterValidator as After
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from mocap_fit.corpus import draw_fraction
from mocap_fit.errors import ConfigurationError, from_os_error
from mocap_fit.fitting.objective import OBJECTIVES, Objective
from mocap_fit.fitting.solving import SOLVERS
from mocap_fit.settings_file import find_first_fault
from mocap_fit.sound import SyncKind
from mocap_fit.sound.estimate import MAX_OFFSET

_COLUMNS = ("utterance", "split", "text", "speaker", "session")
_NAME = re.compile(r"[^\s./\\*?\[\]][^/\\*?\[\]]*")


def _inside(path: str) -> str:
    """Paths lead nowhere but into the root."""
    if not path or "\\" in path or PurePosixPath(path).is_absolute() or ".." in path.split("/"):
        raise ValueError("give a path under the root, with / between folders")
    return path


def _with_id(pattern: str) -> str:
    if pattern.count("{id}") != 1:
        raise ValueError("the pattern must hold {id} once")
    return pattern


def _with_id_at_most(pattern: str) -> str:
    if pattern.count("{id}") > 1:
        raise ValueError("the pattern may hold {id} once, or not at all for a file of all labels")
    return pattern


def _name(name: str) -> str:
    if not _NAME.fullmatch(name):
        raise ValueError("this cannot be part of a file's name")
    return name


_Under = Annotated[str, After(_inside)]
_Pattern = Annotated[str, After(_inside), After(_with_id)]
_Id = Annotated[str, After(_name)]


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class Recordings(_Strict):
    """Where the recordings are."""

    pattern: _Pattern = "recordings/{id}.*"


class LabelFiles(_Strict):
    """Where the labels are, and how they are read."""

    pattern: Annotated[str, After(_inside), After(_with_id_at_most)] = "labels/{id}.*"
    phones: str | None = None
    words: str | None = None
    table: dict[str, str] = {}


class Sound(_Strict):
    """Where the sound is."""

    pattern: _Pattern = "sound/{id}.wav"
    required: bool = False

    @model_validator(mode="after")
    def _wav(self) -> Self:
        if not self.pattern.endswith(".wav"):
            raise ValueError("the sound must be in .wav files")
        return self


class Sync(_Strict):
    """How recordings are brought to the clock of their sound."""

    kind: SyncKind = "none"
    channel: int = Field(default=2, ge=1)
    spare: tuple[Annotated[int, Field(ge=0)], Annotated[int, Field(ge=0)]] = (0, 0)
    largest_offset: float = Field(default=MAX_OFFSET, gt=0)


class Sentences(_Strict):
    """The table of the utterances."""

    file: _Under = "sentences.tsv"


class Splits(_Strict):
    """How splits are drawn where the table gives none."""

    test_fraction: float = Field(default=0.303, ge=0, le=1)
    seed: int = 0


class Fit(_Strict):
    """How recordings are fitted."""

    objective: Objective = "distances"
    solver: str = "newton-nlopt"
    refine_pose: bool = False
    smooth: bool = False
    size_varies: bool | None = None

    @model_validator(mode="after")
    def _known(self) -> Self:
        if self.objective not in OBJECTIVES or self.solver not in SOLVERS:
            raise ValueError(f"the solver is none of {', '.join(SOLVERS)}")
        return self


class SpeakerEntry(_Strict):
    """A speaker and the reference pose."""

    id: _Id = "speaker"
    reference: _Under = "reference.*"


class Session(_Strict):
    """A session with a reference pose or a clock of its own."""

    id: _Id
    speaker: str
    reference: _Under | None = None
    start_time: float | None = None


class Manifest(_Strict):
    """What a manifest says; this module's text has the keys."""

    format_version: Literal[1] = 1
    language: str = ""
    phone_set: str
    layout: str = "face30-head5"
    face: str = "built-in"
    rate: float | None = Field(default=None, gt=0)
    start_time: float | None = None
    recordings: Recordings = Recordings()
    labels: LabelFiles = LabelFiles()
    sound: Sound = Sound()
    sync: Sync = Sync()
    sentences: Sentences = Sentences()
    splits: Splits = Splits()
    fit: Fit = Fit()
    speakers: tuple[SpeakerEntry, ...] = (SpeakerEntry(),)
    sessions: tuple[Session, ...] = ()

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        known = [speaker.id for speaker in self.speakers]
        if not known or len(set(known)) < len(known):
            raise ValueError("give one or more speakers, each with an id of its own")
        pairs = [(session.speaker, session.id) for session in self.sessions]
        if len(set(pairs)) < len(pairs):
            raise ValueError("a session of a speaker is there twice")
        for speaker, session in pairs:
            if speaker not in known:
                raise ValueError(f"session '{session}' is of '{speaker}', who is no speaker here")
        return self


@dataclass(frozen=True)
class Entry:
    """An utterance of the manifest.

    Parameters
    ----------
    id, speaker, session, split, text
        Of the utterance; session and text may be empty.
    reference
        Path of the reference pose under the root.
    start_time
        Seconds; None for the recording's own.
    """

    id: str
    speaker: str
    session: str
    split: str
    text: str
    reference: str
    start_time: float | None


def load_manifest(path: Path) -> Manifest:
    """Read a manifest.

    Raises
    ------
    ConfigurationError
        If it cannot be read, a key is unknown or missing, or values contradict each other.
    """
    content: dict[str, Any] = {}
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8"))
        return Manifest.model_validate(content)
    except OSError as error:
        raise from_os_error(error, path, "manifest") from None
    except ValidationError as error:
        faults: list[Any] = list(error.errors())
        place, problem = find_first_fault(content, faults)
        raise ConfigurationError(f"{place}: {problem}" if place else problem, path=path) from None
    except ValueError as error:
        raise ConfigurationError("the manifest is not TOML", path=path, found=error) from None


def one_file(root: Path, pattern: str) -> Path | None:
    """The file under the root that a pattern names; None where there is none.

    Raises
    ------
    ConfigurationError
        If several match.
    """
    found = sorted(path for path in root.glob(pattern) if path.is_file())
    if len(found) > 1:
        raise ConfigurationError(
            f"several files match '{pattern}'",
            found=", ".join(path.name for path in found),
            expected="one",
            advice="Give the ending in the manifest.",
        )
    return found[0] if found else None


def recorded(manifest: Manifest, root: Path) -> tuple[str, ...]:
    """Names of the recordings that are there, in order; one that matches twice is there twice."""
    before, after = manifest.recordings.pattern.split("{id}")
    form = re.compile(re.escape(before) + "([^/]+?)" + re.escape(after).replace(r"\*", "[^/]*"))
    files = (p.relative_to(root).as_posix() for p in root.glob(f"{before}*{after}"))
    matches = (form.fullmatch(file) for file in sorted(files))
    return tuple(match[1] for match in matches if match)


def entries(
    manifest: Manifest, root: Path, former: Mapping[str, str] | None = None
) -> tuple[Entry, ...]:
    """The utterances, by id: those of the table or, without one, a recording each.

    Parameters
    ----------
    manifest, root
        What there is, and where.
    former
        Splits that were drawn before, by id. They stay; what is new is drawn so that the test has
        its part of all.

    Raises
    ------
    ConfigurationError
        If the table has unknown or doubled names, or there are no utterances.
    """
    table = root / manifest.sentences.file
    if table.is_file():
        rows = _rows(table)
    else:
        rows = [(0, {"utterance": name}) for name in recorded(manifest, root)]
    if not rows:
        raise ConfigurationError(
            "there are no utterances", path=root, expected=manifest.recordings.pattern
        )
    made: dict[str, Entry] = {}
    for line, row in rows:
        where: dict[str, Any] = {"path": table, "line": line} if line else {"path": root}
        entry = _entry(manifest, row, where)
        if entry.id in made:
            raise ConfigurationError(f"the utterance '{entry.id}' is there twice", **where)
        made[entry.id] = entry
    return _with_splits([made[name] for name in sorted(made)], manifest.splits, former or {})


def _with_splits(
    found: Sequence[Entry], splits: Splits, former: Mapping[str, str]
) -> tuple[Entry, ...]:
    """Give a split to those that have none, by numbers that depend on their names alone."""
    names = [entry.id for entry in found if not entry.split]
    new = sorted(
        (n for n in names if n not in former), key=lambda name: draw_fraction(name, splits.seed)
    )
    there = sum(former.get(name) == "test" for name in names)
    test = set(new[: max(0, round(splits.test_fraction * len(names)) - there)])
    return tuple(
        entry
        if entry.split
        else replace(entry, split=former.get(entry.id) or ("test" if entry.id in test else "train"))
        for entry in found
    )


def _rows(table: Path) -> list[tuple[int, dict[str, str]]]:
    try:
        text = table.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise from_os_error(error, table, "table") from None
    lines = list(csv.reader(io.StringIO(text), delimiter="\t", quoting=csv.QUOTE_NONE))
    header = lines[0] if lines else []
    unknown = [name for name in header if name not in _COLUMNS]
    if "utterance" not in header or unknown or len(set(header)) < len(header):
        raise ConfigurationError(
            "the table's columns are not those of utterances",
            path=table,
            line=1,
            found=", ".join(header),
            expected=f"utterance and any of {', '.join(_COLUMNS[1:])}, tabs between them",
        )
    rows = []
    for number, cells in enumerate(lines[1:], 2):
        if cells and len(cells) != len(header):
            raise ConfigurationError(
                "a row is not as long as the header",
                path=table,
                line=number,
                found=f"{len(cells)} cells",
                expected=str(len(header)),
            )
        if cells:
            rows.append((number, dict(zip(header, cells, strict=True))))
    return rows


def _entry(manifest: Manifest, row: dict[str, str], where: dict[str, Any]) -> Entry:
    name, session = row["utterance"], row.get("session", "")
    if not _NAME.fullmatch(name):
        raise ConfigurationError(
            "an utterance's name cannot be a file's name", found=repr(name), **where
        )
    speakers = {speaker.id: speaker for speaker in manifest.speakers}
    speaker = row.get("speaker") or (next(iter(speakers)) if len(speakers) == 1 else "")
    if speaker not in speakers:
        raise ConfigurationError(
            f"the speaker of '{name}' is not in the manifest",
            found=repr(speaker),
            expected=", ".join(speakers),
            **where,
        )
    own = next((s for s in manifest.sessions if (s.speaker, s.id) == (speaker, session)), None)
    start = own.start_time if own is not None else None
    return Entry(
        name,
        speaker,
        session,
        row.get("split", ""),
        row.get("text", ""),
        (own.reference if own is not None else None) or speakers[speaker].reference,
        manifest.start_time if start is None else start,
    )
