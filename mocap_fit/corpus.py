"""A corpus: utterances with their parameters, phones, head motion, markers and sound.

On disk it is a folder that pandas, polars and dask read as it is (DESIGN.md, "On disk"): one file
an utterance and a table of all, each written completely or not at all. Only the table is read when
a corpus is opened, and nothing of an utterance stays in memory, so that a corpus may be larger
than the memory. In memory it is made of tracks and phones (`Corpus.from_utterances`); control
models and scores do not see the difference.
"""

from __future__ import annotations

import dataclasses
import hashlib
import html
import itertools
import os
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Self

from pydantic import ConfigDict, Field

from mocap_fit.atomic_file import write_text
from mocap_fit.errors import ConfigurationError, DataError, FileFormatError, MissingFileError
from mocap_fit.phones import PhoneSet, load_phone_set, write_phones
from mocap_fit.settings_file import StrictModel, read_toml, validate_settings
from mocap_fit.tracks import Provenance, Step, write_parquet
from mocap_fit.utterance import Utterance as Utterance
from mocap_fit.utterance import read_utterances, write_utterances

FORMAT_VERSION = 1
DESCRIPTION_FILE = "corpus.toml"
UNITS = {"length": "mm", "time": "s", "angle": "rad", "parameters": "1 is the full gesture"}


class _Step(StrictModel):
    step: str
    arguments: dict[str, Any] = Field(default_factory=dict)
    version: str = ""


class _Description(StrictModel):
    """The content of corpus.toml; what a later version adds is passed over."""

    model_config = ConfigDict(extra="ignore")
    language: str
    phone_set: str
    face: str
    layout: str
    parameters: tuple[str, ...]
    rate: float | None = Field(default=None, gt=0)
    provenance: tuple[_Step, ...]


@dataclass(frozen=True, eq=False, repr=False)
class Corpus:
    """Utterances of one language, one phone set and one set of face parameters.

    Iterating gives the utterances in the order of their ids, ``corpus["ID"]`` gives one, and
    ``len(corpus)`` is their number. Two corpora are equal if their fields and utterances are,
    wherever they are stored.

    Parameters
    ----------
    utterances
        The utterances; they are put in the order of their ids.
    phone_set
        The phone set of their phones.
    parameter_names
        Names of the parameters of the tracks, in order.
    rate
        Frame rate of the tracks, hertz; None where they differ.
    language
        BCP 47 tag, such as ``sv``; empty where it is not known.
    face
        The face that the recordings were fitted with; empty where it is not known.
    layout
        The marker layout of the recordings; empty where it is not known.
    folder
        Where it is on disk; None in memory.
    provenance
        The steps that led to it.

    Raises
    ------
    DataError
        If two utterances have one id.
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
    def from_utterances(
        cls, utterances: Iterable[Utterance], phone_set: PhoneSet | str, **fields: Any
    ) -> Self:
        """Return a corpus in memory, of utterances in memory.

        Parameters
        ----------
        utterances
            One or more, with the same parameters.
        phone_set
            A phone set, or the name of one that is shipped.
        **fields
            Other fields, such as ``language``, which is that of the phone set by default.

        Returns
        -------
        Corpus
            The utterances in the order of their ids.

        Raises
        ------
        DataError
            If there is no utterance, or their parameters differ.
        """
        members = tuple(utterances)
        if not members:
            raise DataError("a corpus in memory needs utterances", found=0, expected="one or more")
        tracks = [utterance.read_tracks() for utterance in members]
        names, rates = {t.names for t in tracks}, {t.rate for t in tracks}
        if len(names) > 1:
            raise DataError(
                "the utterances have different parameters",
                found=" against ".join(", ".join(each) for each in sorted(names)),
            )
        chosen = load_phone_set(phone_set) if isinstance(phone_set, str) else phone_set
        fields = {
            "language": chosen.language,
            "rate": rates.pop() if len(rates) == 1 else None,
            **fields,
        }
        return cls(members, phone_set=chosen, parameter_names=names.pop(), **fields)

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

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Corpus):
            return NotImplemented
        names = (each.name for each in dataclasses.fields(Corpus) if each.name != "folder")
        return all(getattr(self, name) == getattr(other, name) for name in names)

    def __hash__(self) -> int:
        return hash((self.language, self.utterances))

    def _describe(self) -> list[tuple[str, int, float]]:
        """Return the name, the number of utterances and the seconds of every split."""
        parts = [(name, [u for u in self if u.split == name]) for name in self.splits]
        return [(name, len(part), sum(u.duration for u in part)) for name, part in parts]

    def __repr__(self) -> str:
        splits = ", ".join(f"{name} {count}" for name, count, _ in self._describe())
        rate = "several rates" if self.rate is None else f"{self.rate:g} Hz"
        return (
            f"Corpus of {len(self)} utterances ({splits}), "
            f"{sum(u.duration for u in self):.1f} s\n"
            f"  phone set '{self.phone_set.name}', {len(self.parameter_names)} parameters, {rate}"
        )

    def _repr_html_(self) -> str:
        rows = "".join(
            f"<tr><td>{html.escape(name)}</td><td>{count}</td><td>{seconds:.1f}</td></tr>"
            for name, count, seconds in self._describe()
        )
        return (
            f"<pre>{html.escape(repr(self))}</pre><table><thead><tr><th>split</th>"
            f"<th>utterances</th><th>seconds</th></tr></thead><tbody>{rows}</tbody></table>"
        )

    @property
    def splits(self) -> tuple[str, ...]:
        """Names of its splits, sorted."""
        return tuple(sorted({utterance.split for utterance in self.utterances}))

    def get_split(self, name: str) -> Self:
        """Return the utterances of one split.

        Parameters
        ----------
        name
            Name of the split, such as ``train``.

        Returns
        -------
        Corpus
            Its utterances, with all else as it is.

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
        """Return the named utterances.

        Parameters
        ----------
        names
            Ids of utterances.

        Returns
        -------
        Corpus
            These utterances, with all else as it is.

        Raises
        ------
        DataError
            If there is no utterance of a name.
        """
        return dataclasses.replace(self, utterances=tuple(self[name] for name in names))

    def hold_out(self, fraction: float, seed: int = 0) -> tuple[Self, Self]:
        """Divide the utterances into most of them and a part that is drawn by their ids.

        An utterance's part depends on its id and the seed alone, and stays when others are added.

        Parameters
        ----------
        fraction
            The share of utterances in the second part, 0 to 1; each part has at least one.
        seed
            Another seed draws other utterances.

        Returns
        -------
        Corpus
            The first part, with most of the utterances.
        Corpus
            The second part, with about the fraction of them.

        Raises
        ------
        DataError
            If there are fewer than two utterances.
        """
        if len(self.utterances) < 2:
            raise DataError(
                "a part cannot be held out", found=f"{len(self)} utterances", expected="two or more"
            )
        ranked = sorted(self.utterances, key=lambda u: draw_fraction(u.id, seed))
        count = sum(draw_fraction(u.id, seed) < fraction for u in ranked)
        count = min(max(count, 1), len(ranked) - 1)
        return (
            dataclasses.replace(self, utterances=tuple(ranked[count:])),
            dataclasses.replace(self, utterances=tuple(ranked[:count])),
        )


def draw_fraction(name: str, seed: int) -> float:
    """Draw a number that depends on a name and a seed alone.

    Parameters
    ----------
    name
        Such as the id of an utterance.
    seed
        Another seed draws other numbers.

    Returns
    -------
    float
        In [0, 1).
    """
    digest = hashlib.sha256(f"{seed}\0{name}".encode()).digest()
    return int.from_bytes(digest[:8], "big") / 2**64


def open_corpus(path: str | os.PathLike[str]) -> Corpus:
    """Open a corpus on disk, without reading the files of its utterances.

    Parameters
    ----------
    path
        The folder that ``mocap-fit convert`` wrote.

    Returns
    -------
    Corpus
        Its utterances read their files when `Utterance.read_tracks` and the like are called.

    Raises
    ------
    FileFormatError
        If it is no corpus, its description or its table is damaged, or its format is a later one.

    See Also
    --------
    control.create : Create a control model that is trained on a corpus.
    evaluate : Score control models on the utterances of a corpus.

    Examples
    --------
    A corpus of one utterance, written to a new folder and opened:

    >>> import mocap_fit as mf
    >>> from mocap_fit.control.rule_based import RuleBased
    >>> from mocap_fit.corpus import Corpus, Utterance, save_corpus
    >>> phones = mf.read_phones(mf.load_sample("take_01.TextGrid"), phone_set="sv-sta")
    >>> tracks = mf.synthesise(phones, RuleBased().prepare("sv-sta")).replace(name="take_01")
    >>> save_corpus(Corpus.from_utterances([Utterance.from_tracks(tracks, phones)], "sv-sta"), "sv")
    >>> corpus = mf.open_corpus("sv")
    >>> corpus
    Corpus of 1 utterances (train 1), 3.1 s
      phone set 'sv-sta', 10 parameters, 60 Hz
    >>> corpus["take_01"].read_tracks().frames
    185
    """
    folder = Path(path)
    file = folder / DESCRIPTION_FILE
    try:
        content = read_toml(file, noun="description of the corpus")
        version = content.get("format_version")
        if version != FORMAT_VERSION:
            raise FileFormatError(
                "this corpus is of a format that this version of mocap-fit does not read",
                path=file,
                found=f"format_version {version}",
                expected=FORMAT_VERSION,
                advice="Update mocap-fit, or convert the recordings again.",
            )
        about = validate_settings(_Description, content, file, "description of the corpus")
    except MissingFileError:
        raise MissingFileError(
            "this is not a corpus",
            path=path,
            found=f"no {DESCRIPTION_FILE}",
            advice="Make one of recordings and labels with mocap-fit convert.",
        ) from None
    except ConfigurationError as error:
        raise FileFormatError(error.problem, path=file, found=error.found) from None
    local = folder / about.phone_set
    try:
        phone_set = load_phone_set(local if local.is_file() else about.phone_set)
    except (ConfigurationError, FileFormatError) as error:
        raise FileFormatError(
            f"the phone set of the corpus cannot be used: {error.problem}",
            path=error.path or file,
            found=error.found,
        ) from None
    return Corpus(
        read_utterances(folder),
        phone_set=phone_set,
        parameter_names=about.parameters,
        rate=about.rate,
        language=about.language,
        face=about.face,
        layout=about.layout,
        folder=folder,
        provenance=tuple(Step(s.step, s.arguments, s.version) for s in about.provenance),
    )


def write_corpus(corpus: Corpus, folder: Path, phone_set_file: str | None = None) -> None:
    """Write the description and the table of a corpus, whose utterances are written already.

    Parameters
    ----------
    corpus
        What is described.
    folder
        An existing folder.
    phone_set_file
        Name of a file in the folder that has the phone set, where it is not a shipped one.

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
    write_text(folder / DESCRIPTION_FILE, tomli_w.dumps(content))


def save_corpus(corpus: Corpus, folder: str | os.PathLike[str]) -> None:
    """Write a corpus that is in memory: parameters and phones of every utterance, and its table.

    Parameters
    ----------
    corpus
        The corpus; its phone set must be a shipped one.
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
        tracks = utterance.read_tracks().replace(name=utterance.id)
        write_parquet(tracks, target / "tracks" / f"{utterance.id}.parquet")
        phones = utterance.read_phones().replace(name=utterance.id)
        write_phones(phones, target / "phones" / f"{utterance.id}.parquet")
    write_corpus(corpus, target)
