"""The manifest of a corpus: a TOML file that says where recordings, labels and sound are.

``manifest_example.toml``, which ``mocap-fit convert --example`` prints, has every key with its
default. Without a manifest the defaults are the folder convention:
``recordings/ labels/ sound/ reference.* sentences.tsv``.
"""

from __future__ import annotations

import re
from importlib import resources
from pathlib import Path, PurePosixPath
from typing import Annotated, Any, Literal, Self

from pydantic import AfterValidator as After
from pydantic import Field, model_validator

from mocap_fit.fitting.objective import Objective
from mocap_fit.fitting.solving import SOLVERS
from mocap_fit.io import ReadOptions
from mocap_fit.settings_file import StrictModel, load_settings
from mocap_fit.sound import SOUND_ENDINGS, SyncKind
from mocap_fit.sound.estimate import MAX_OFFSET

Unit = Literal["mm", "cm", "m"]
"""Units of length that a recording may be in, whatever it says."""

NAME = re.compile(r"[^\s./\\*?\[\]][^/\\*?\[\]]*")
"""What may be part of a file's name."""


def _check_inside(path: str) -> str:
    """Paths lead nowhere but into the root."""
    if not path or "\\" in path or PurePosixPath(path).is_absolute() or ".." in path.split("/"):
        raise ValueError("give a path under the root, with / between folders")
    return path


def _check_id(pattern: str) -> str:
    if pattern.count("{id}") != 1:
        raise ValueError("the pattern must hold {id} once")
    return pattern


def _check_id_at_most(pattern: str) -> str:
    if pattern.count("{id}") > 1:
        raise ValueError("the pattern may hold {id} once, or not at all for a file of all labels")
    return pattern


def _check_name(name: str) -> str:
    if not NAME.fullmatch(name):
        raise ValueError("this cannot be part of a file's name")
    return name


_Under = Annotated[str, After(_check_inside)]
_Pattern = Annotated[str, After(_check_inside), After(_check_id)]
_Id = Annotated[str, After(_check_name)]


class Recordings(StrictModel):
    """Where the recordings are.

    Parameters
    ----------
    pattern
        Path with ``{id}`` for the utterance; one file must match.
    """

    pattern: _Pattern = "recordings/{id}.*"


class LabelFiles(StrictModel):
    """Where the labels are, and how they are read.

    Parameters
    ----------
    pattern
        Path with ``{id}`` for the utterance; without it, one file has all labels.
    phones, words
        Names of the tiers; None for the tiers whose content looks like phones and words.
    table
        What to read labels as that the phone set lacks.
    """

    pattern: Annotated[str, After(_check_inside), After(_check_id_at_most)] = "labels/{id}.*"
    phones: str | None = None
    words: str | None = None
    table: dict[str, str] = Field(default_factory=dict)


class Sound(StrictModel):
    """Where the sound is.

    Parameters
    ----------
    pattern
        Path of a sound file, with ``{id}`` for the utterance.
    required
        Whether an utterance without sound is an error.
    """

    pattern: _Pattern = "sound/{id}.wav"
    required: bool = False

    @model_validator(mode="after")
    def _check_ending(self) -> Self:
        if not self.pattern.lower().endswith(SOUND_ENDINGS):
            raise ValueError(f"the sound must be in files with one of {' '.join(SOUND_ENDINGS)}")
        return self


class Sync(StrictModel):
    """How recordings are put on the clock of their sound.

    Parameters
    ----------
    kind
        ``pulses``, ``estimate`` or ``none``.
    channel
        Channel of the pulses, from 1.
    spare
        Number of pulses before that of the first frame, and after that of the last.
    largest_offset
        How far from the start time an estimate is sought, seconds.
    """

    kind: SyncKind = "none"
    channel: int = Field(default=2, ge=1)
    spare: tuple[Annotated[int, Field(ge=0)], Annotated[int, Field(ge=0)]] = (0, 0)
    largest_offset: float = Field(default=MAX_OFFSET, gt=0)


class Sentences(StrictModel):
    """The table of the utterances.

    Parameters
    ----------
    file
        Path of a tab-separated table: utterance, split, text, speaker, session.
    """

    file: _Under = "sentences.tsv"


class Splits(StrictModel):
    """How splits are drawn where the table has none.

    Parameters
    ----------
    test_fraction
        Share of the test, 0 to 1.
    seed
        Seed of the draw.
    """

    test_fraction: float = Field(default=0.303, ge=0, le=1)
    seed: int = 0


class Fit(StrictModel):
    """How recordings are fitted.

    Parameters
    ----------
    objective
        What is minimised: ``distances``, ``squares`` or ``huber``.
    solver
        ``newton-nlopt``, ``newton``, or the name of an nlopt algorithm.
    refine_pose
        Whether the pose of the head is fitted together with the shape.
    smooth
        Whether all frames are fitted together.
    size_varies
        Whether recordings differ in size; None for what the layout says.
    allow_mirrored
        Whether mirrored recordings and reference poses are mended, and not refused.
    """

    objective: Objective = "distances"
    solver: str = "newton-nlopt"
    refine_pose: bool = False
    smooth: bool = False
    size_varies: bool | None = None
    allow_mirrored: bool = False

    @model_validator(mode="after")
    def _check_solver(self) -> Self:
        if self.solver not in SOLVERS:
            raise ValueError(f"the solver is none of {', '.join(SOLVERS)}")
        return self


class SpeakerEntry(StrictModel):
    """A speaker.

    Parameters
    ----------
    id
        Name of the speaker.
    reference
        Path or pattern of the recording of the reference pose; ``take.tsv@0.2-0.5`` is a span of
        it, in seconds.
    """

    id: _Id = "speaker"
    reference: _Under = "reference.*"


class Session(StrictModel):
    """A session with a reference pose or a clock that differs.

    Parameters
    ----------
    id
        Name of the session.
    speaker
        Name of its speaker.
    reference
        Path or pattern of its reference pose; None for the speaker's.
    start_time
        The first frame on the clock of the sound, seconds; None for the manifest's.
    """

    id: _Id
    speaker: str
    reference: _Under | None = None
    start_time: float | None = None


class Manifest(StrictModel):
    """The settings of a conversion; ``manifest_example.toml`` explains them in its place.

    Parameters
    ----------
    format_version
        Version of the keys.
    language
        BCP 47; empty for that of the phone set.
    phone_set
        A shipped name, or a TOML file under the root.
    layout
        The marker layout: a shipped name, or a TOML file under the root; None for the one that
        fits the reference pose.
    face
        ``built-in``, or a rig file under the root.
    rate
        Frames per second of every recording, hertz; None for what their files say.
    unit
        Unit of length of the recordings; None for what their files say.
    subject
        Subject whose markers are read, where files name several.
    rename
        New names of markers by those in the files.
    reference_as_is
        Whether reference poses are read without these four.
    start_time
        The first frame on the clock of the sound, seconds; None for the file's.
    edits
        Path of an edit list, with ``{id}`` for the utterance; None for those beside recordings.
    recordings, labels, sound
        Where the files of an utterance are.
    sync
        How recordings are put on the clock of their sound.
    sentences
        The table of the utterances.
    splits
        How splits are drawn.
    fit
        How recordings are fitted.
    speakers, sessions
        Who was recorded, and when.
    """

    format_version: Literal[1] = 1
    language: str = ""
    phone_set: str
    layout: str | None = None
    face: str = "built-in"
    rate: float | None = Field(default=None, gt=0)
    unit: Unit | None = None
    subject: str | None = None
    rename: dict[str, str] = Field(default_factory=dict)
    reference_as_is: bool = False
    start_time: float | None = None
    edits: _Pattern | None = None
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
    def _check_consistent(self) -> Self:
        known = [speaker.id for speaker in self.speakers]
        if not known or len(set(known)) < len(known):
            raise ValueError("give one or more speakers, each with a different id")
        pairs = [(session.speaker, session.id) for session in self.sessions]
        if len(set(pairs)) < len(pairs):
            raise ValueError("a session of a speaker is there twice")
        for speaker, session in pairs:
            if speaker not in known:
                raise ValueError(f"session '{session}' is of '{speaker}', who is no speaker here")
        return self

    @property
    def reading(self) -> ReadOptions:
        """How the recordings are read."""
        return ReadOptions(self.rate, self.unit, self.subject, self.rename)

    def to_dict(self) -> dict[str, Any]:
        """Return the settings as the corpus's provenance has them.

        Returns
        -------
        dict[str, Any]
            Every key that has a value.
        """
        return self.model_dump(mode="json", exclude_none=True)


def load_manifest(path: Path) -> Manifest:
    """Read a manifest.

    Parameters
    ----------
    path
        The TOML file.

    Returns
    -------
    Manifest
        Its settings.

    Raises
    ------
    ConfigurationError
        If a key is unknown or missing, or values contradict each other.
    FileFormatError
        If the file cannot be read.
    """
    return load_settings(Manifest, path, noun="manifest")


def read_example() -> str:
    """Return the text of a manifest with every key.

    Returns
    -------
    str
        TOML with comments.
    """
    return resources.files(__package__).joinpath("manifest_example.toml").read_text("utf-8")
