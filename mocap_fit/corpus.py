"""A corpus: utterances with their parameters, phones, head motion, markers and sound.

On disk it is a folder that pandas, polars and dask read as it is (DESIGN.md, "On disk"): one file
an utterance and a table of all, written whole or not at all. Files are read when they are asked
for, so that a corpus may be larger than the memory. In memory it is made of tracks and phones, as
`Corpus.of` says; whoever trains or scores a control model does not see the difference.
"""

from __future__ import annotations

import dataclasses
import hashlib
import itertools
import os
import tomllib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Self, TypeVar

from mocap_fit.atomic_file import write_atomically
from mocap_fit.errors import ConfigurationError, DataError, FileFormatError, MissingFileError
from mocap_fit.phones import (
    PhoneSequence,
    PhoneSet,
    load_phone_set,
    read_stored_phones,
    write_phones,
)
from mocap_fit.tracks import (
    MarkerTracks,
    ParameterTracks,
    PoseTracks,
    Provenance,
    Step,
    read_parquet,
    write_parquet,
)
from mocap_fit.tracks.parquet_file import damaged, read_table, write_table

FORMAT_VERSION = 1
DESCRIPTION_FILE, UTTERANCES_FILE = "corpus.toml", "utterances.parquet"
UNITS = {"length": "mm", "time": "s", "angle": "rad", "parameters": "1 is the full gesture"}

_Kind = TypeVar("_Kind", ParameterTracks, PoseTracks, MarkerTracks)
_COLUMNS = ("id", "speaker", "session", "split", "duration", "text", "sources", "checks")


@dataclass(frozen=True, eq=False)
class Utterance:
    """An utterance of a corpus.

    What it holds is read from its files each time it is asked for, or was given by `Utterance.of`.

    Parameters
    ----------
    id
        Unique in the corpus; its files are called so.
    speaker, session
        Who, and when.
    split
        ``train``, ``validation``, ``test``, or a name of one's own.
    duration
        Seconds, of the parameters.
    text
        What is said; empty where it is not known.
    sources
        The files that it was made of, relative to the root of the conversion.
    checks
        What was found in the conversion that a user should know, a line each.
    folder
        The corpus's folder; None for an utterance in memory.
    """

    id: str
    speaker: str = ""
    session: str = ""
    split: str = "train"
    duration: float = 0.0
    text: str = ""
    sources: tuple[str, ...] = ()
    checks: tuple[str, ...] = ()
    folder: Path | None = None
    _given: Mapping[str, Any] = field(default_factory=dict, repr=False)

    @classmethod
    def of(cls, tracks: ParameterTracks, phones: PhoneSequence, **about: Any) -> Self:
        """An utterance in memory.

        Parameters
        ----------
        tracks, phones
            Its parameters and its phones, on one clock.
        about
            Other fields, such as ``split``; the id is the tracks' name where it is not given.
        """
        about = {"id": tracks.name, "duration": tracks.duration, **about}
        return cls(**about, _given={"tracks": tracks, "phones": phones})

    def _path(self, part: str, ending: str = "parquet") -> Path:
        if self.folder is None:
            raise DataError(f"the utterance '{self.id}' is in memory and has no {part}")
        return self.folder / part / f"{self.id}.{ending}"

    @property
    def tracks(self) -> ParameterTracks:
        """The face parameters."""
        if "tracks" in self._given:
            given: ParameterTracks = self._given["tracks"]
            return given
        return _read_as(self._path("tracks"), ParameterTracks)

    @property
    def phones(self) -> PhoneSequence:
        """The labelled phones."""
        if "phones" in self._given:
            given: PhoneSequence = self._given["phones"]
            return given
        return read_stored_phones(self._path("phones"))

    @property
    def head(self) -> PoseTracks:
        """The head's motion that was removed."""
        return _read_as(self._path("head"), PoseTracks)

    @property
    def markers(self) -> MarkerTracks:
        """The markers, as they were recorded."""
        return _read_as(self._path("markers"), MarkerTracks)

    @property
    def sound(self) -> Path | None:
        """The file of its sound; None where it has none."""
        if self.folder is None:
            return None
        path = self._path("audio", "wav")
        return path if path.is_file() else None


@dataclass(frozen=True, eq=False)
class Corpus:
    """Utterances of one language, one phone set and one set of face parameters.

    Parameters
    ----------
    utterances
        By id, in order.
    phone_set
        What their phones are written in.
    parameter_names
        Of the tracks, in order.
    rate
        Frames per second of the tracks; None where they differ.
    language
        BCP 47, such as ``sv``; empty where it is not known.
    face, layout
        What the recordings were fitted with; empty where that is not known.
    folder
        Where it is on disk; None in memory.
    provenance
        The steps that led here.
    """

    utterances: tuple[Utterance, ...]
    phone_set: PhoneSet = field(kw_only=True)
    parameter_names: tuple[str, ...] = field(kw_only=True)
    rate: float | None = field(default=None, kw_only=True)
    language: str = field(default="", kw_only=True)
    face: str = field(default="", kw_only=True)
    layout: str = field(default="", kw_only=True)
    folder: Path | None = field(default=None, kw_only=True)
    provenance: Provenance = field(default=(), kw_only=True)

    def __post_init__(self) -> None:
        ordered = tuple(sorted(self.utterances, key=lambda utterance: utterance.id))
        object.__setattr__(self, "utterances", ordered)
        object.__setattr__(self, "parameter_names", tuple(self.parameter_names))
        pairs = itertools.pairwise(ordered)
        twice = [before.id for before, after in pairs if before.id == after.id]
        if twice:
            raise DataError("two utterances of a corpus have one id", found=", ".join(twice))

    @classmethod
    def of(cls, utterances: Iterable[Utterance], phone_set: PhoneSet | str, **about: Any) -> Self:
        """A corpus in memory, of utterances in memory.

        Parameters
        ----------
        utterances
            One or more, of the same parameters.
        phone_set
            A set, or the name of one that is shipped.
        about
            Other fields, such as ``language``.

        Raises
        ------
        DataError
            If there are none, or their parameters differ.
        """
        given = tuple(utterances)
        if not given:
            raise DataError("a corpus in memory needs utterances", found=0, expected="one or more")
        tracks = [utterance.tracks for utterance in given]
        names, rates = {t.names for t in tracks}, {t.rate for t in tracks}
        if len(names) > 1:
            raise DataError(
                "the utterances have different parameters",
                found=" against ".join(", ".join(each) for each in sorted(names)),
            )
        chosen = load_phone_set(phone_set) if isinstance(phone_set, str) else phone_set
        about = {
            "language": chosen.language,
            "rate": rates.pop() if len(rates) == 1 else None,
            **about,
        }
        return cls(given, phone_set=chosen, parameter_names=names.pop(), **about)

    def __len__(self) -> int:
        return len(self.utterances)

    def __iter__(self) -> Iterator[Utterance]:
        return iter(self.utterances)

    def __getitem__(self, name: str) -> Utterance:
        for utterance in self.utterances:
            if utterance.id == name:
                return utterance
        raise DataError(
            f"the corpus has no utterance '{name}'",
            expected=f"one of {', '.join(u.id for u in self.utterances)}",
        )

    @property
    def splits(self) -> tuple[str, ...]:
        """Names of its splits, sorted."""
        return tuple(sorted({utterance.split for utterance in self.utterances}))

    def split(self, name: str) -> Self:
        """The utterances of one split.

        Raises
        ------
        DataError
            If there are none.
        """
        part = tuple(u for u in self.utterances if u.split == name)
        if not part:
            raise DataError(
                f"the corpus has no utterance in the split '{name}'",
                expected=f"one of {', '.join(self.splits) or 'none: it is empty'}",
            )
        return dataclasses.replace(self, utterances=part)

    def select(self, names: Sequence[str]) -> Self:
        """The named utterances."""
        return dataclasses.replace(self, utterances=tuple(self[name] for name in names))

    def held_out(self, fraction: float, seed: int = 0) -> tuple[Self, Self]:
        """Two parts: most utterances, and about a fraction that is drawn by their names.

        An utterance's part depends on its id and the seed alone, and stays when others are added.
        The second part has one utterance at least, and so has the first.

        Raises
        ------
        DataError
            If there are fewer than two utterances.
        """
        if len(self.utterances) < 2:
            raise DataError(
                "a part cannot be held out", found=f"{len(self)} utterances", expected="two or more"
            )
        ranked = sorted(self.utterances, key=lambda u: drawn(u.id, seed))
        count = sum(drawn(u.id, seed) < fraction for u in ranked)
        count = min(max(count, 1), len(ranked) - 1)
        return (
            dataclasses.replace(self, utterances=tuple(ranked[count:])),
            dataclasses.replace(self, utterances=tuple(ranked[:count])),
        )


def drawn(name: str, seed: int) -> float:
    """A number in [0, 1) that depends on a name and a seed alone."""
    digest = hashlib.sha256(f"{seed}\0{name}".encode()).digest()
    return int.from_bytes(digest[:8], "big") / 2**64


def open_corpus(path: str | os.PathLike[str]) -> Corpus:
    """Open a corpus on disk; its utterances are read when they are asked for.

    Parameters
    ----------
    path
        The folder that ``mocap-fit convert`` wrote.

    Raises
    ------
    FileFormatError
        If it is no corpus, its description or its table is damaged, or of a later format.
    """
    folder = Path(path)
    description = folder / DESCRIPTION_FILE
    try:
        content = tomllib.loads(description.read_text(encoding="utf-8"))
    except OSError as error:
        kind = MissingFileError if isinstance(error, FileNotFoundError) else FileFormatError
        raise kind(
            "this is not a corpus",
            path=path,
            found=f"{DESCRIPTION_FILE}: {error.strerror}",
            advice="Make one of recordings and labels with mocap-fit convert.",
        ) from None
    except ValueError as error:
        raise FileFormatError(
            "the description of the corpus is not TOML", path=description, found=error
        ) from None
    version = content.get("format_version")
    if version != FORMAT_VERSION:
        raise FileFormatError(
            "this corpus is of a format that this version of mocap-fit does not read",
            path=description,
            found=f"format_version {version}",
            expected=FORMAT_VERSION,
            advice="Update mocap-fit, or convert the recordings again.",
        )
    try:
        name = content["phone_set"]
        try:
            phone_set = load_phone_set(folder / name if (folder / name).is_file() else name)
        except (ConfigurationError, FileFormatError) as error:
            raise FileFormatError(
                f"the phone set of the corpus cannot be used: {error.problem}",
                path=error.path or description,
                found=error.found,
            ) from None
        return Corpus(
            read_utterances(folder),
            phone_set=phone_set,
            parameter_names=tuple(content["parameters"]),
            rate=content.get("rate"),
            language=content["language"],
            face=content["face"],
            layout=content["layout"],
            folder=folder,
            provenance=tuple(Step.from_dict(step) for step in content["provenance"]),
        )
    except (KeyError, TypeError, AttributeError) as error:
        raise FileFormatError(
            "the description of the corpus lacks something",
            path=description,
            found=f"{type(error).__name__}: {error}",
        ) from None


def write_corpus(corpus: Corpus, folder: Path, phone_set_file: str | None = None) -> None:
    """Write the description and the table of a corpus, whose utterances are written already.

    Parameters
    ----------
    corpus
        What is described.
    folder
        Where; it exists.
    phone_set_file
        For a phone set of one's own, the name of its file in the folder.

    Raises
    ------
    FileFormatError
        If a file cannot be written.
    """
    import tomli_w

    write_utterances(corpus.utterances, folder)
    content: dict[str, Any] = {
        "format_version": FORMAT_VERSION,
        "language": corpus.language,
        "phone_set": phone_set_file or corpus.phone_set.name,
        "face": corpus.face,
        "layout": corpus.layout,
        "parameters": list(corpus.parameter_names),
        "units": UNITS,
        "provenance": [step.to_dict() for step in corpus.provenance],
    }
    if corpus.rate is not None:
        content["rate"] = corpus.rate
    with write_atomically(folder / DESCRIPTION_FILE) as partial:
        partial.write_text(tomli_w.dumps(content), encoding="utf-8", newline="\n")


def save_corpus(corpus: Corpus, folder: str | os.PathLike[str]) -> None:
    """Write a corpus that is in memory: parameters and phones of every utterance, and its table.

    Parameters
    ----------
    corpus
        Its phone set is one that is shipped.
    folder
        A new folder; its parent exists.

    Raises
    ------
    FileFormatError
        If the folder exists, or a file cannot be written.
    """
    target = Path(folder)
    try:
        target.mkdir()
        (target / "tracks").mkdir()
        (target / "phones").mkdir()
    except OSError as error:
        raise FileFormatError(
            "the folder for the corpus cannot be made", path=folder, found=error.strerror
        ) from None
    for utterance in corpus:
        tracks = utterance.tracks.replace(name=utterance.id)
        write_parquet(tracks, target / "tracks" / f"{utterance.id}.parquet")
        phones = utterance.phones.replace(name=utterance.id)
        write_phones(phones, target / "phones" / f"{utterance.id}.parquet")
    write_corpus(corpus, target)


def write_utterances(utterances: Iterable[Utterance], folder: Path) -> None:
    """Write the table of a corpus's utterances."""
    import pyarrow as pa

    rows = list(utterances)
    strings = pa.list_(pa.string())
    types = (*[pa.string()] * 4, pa.float64(), pa.string(), strings, strings)
    columns = {
        name: pa.array([getattr(row, name) for row in rows], type=kind)
        for name, kind in zip(_COLUMNS, types, strict=True)
    }
    write_table(columns, {"kind": "utterances"}, folder / UTTERANCES_FILE)


def read_utterances(folder: Path) -> tuple[Utterance, ...]:
    """The utterances that the table of a corpus lists.

    Raises
    ------
    FileFormatError
        If the table cannot be read, or is none of a corpus.
    """
    path = folder / UTTERANCES_FILE
    table, _ = read_table(path, ("utterances",), "utterances", "Convert the recordings again.")
    try:
        rows = table.select(list(_COLUMNS)).to_pylist()
        lists = ("sources", "checks")
        return tuple(
            Utterance(**row | {name: tuple(row[name]) for name in lists}, folder=folder)
            for row in rows
        )
    except (KeyError, TypeError, ValueError) as error:
        raise damaged(path, error) from None


def _read_as(path: Path, kind: type[_Kind]) -> _Kind:
    tracks = read_parquet(path)
    if not isinstance(tracks, kind):
        raise FileFormatError(
            "this file holds something else than its folder says",
            path=path,
            found=type(tracks).__name__,
            expected=kind.__name__,
        )
    return tracks
