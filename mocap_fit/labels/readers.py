"""Labels of recordings: tiers of labelled times, and the formats they are read from.

A format is a module (or any object) with what `LabelReader` lists, named by an entry point in the
group ``mocap_fit.label_readers``. Labels keep what a file says, faults included, so that they can
be looked at, mended and written back; `mocap_fit.labels.read_phones` makes phones of them.
"""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal, Protocol

from mocap_fit.atomic_file import write_atomically
from mocap_fit.errors import (
    DataError,
    FileFormatError,
    MocapFitError,
    from_os_error,
)
from mocap_fit.io.text import check_file
from mocap_fit.registry import Registry

LABEL_READERS = Registry("mocap_fit.label_readers", "label reader")

TierKind = Literal["interval", "point"]


@dataclass(frozen=True)
class Label:
    """An entry of a tier.

    Parameters
    ----------
    start, end
        Seconds; of a point, both are its time. A file's faults are kept: the end may be before
        the start.
    text
        As in the file; may be empty.
    extra
        What the file says besides: ``score=...`` of HTK, ``colour=...`` of ESPS.
    """

    start: float
    end: float
    text: str
    extra: str = ""

    def __post_init__(self) -> None:
        if not (math.isfinite(self.start) and math.isfinite(self.end)):
            raise DataError(
                f"the label '{self.text}' has an impossible time",
                found=f"{self.start} to {self.end} s",
                expected="finite seconds",
            )


@dataclass(frozen=True)
class Tier:
    """Labels of one kind, such as phones or words.

    Parameters
    ----------
    name
        As in the file.
    entries
        In the order of the file.
    kind
        ``interval``: stretches of time; ``point``: moments.
    start, end
        Seconds, where the tier covers something else than the file; None elsewhere.
    """

    name: str
    entries: tuple[Label, ...]
    kind: TierKind = "interval"
    start: float | None = None
    end: float | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "entries", tuple(self.entries))


@dataclass(frozen=True)
class Labels:
    """All labels of an utterance.

    Parameters
    ----------
    tiers
        In the order of the file.
    start, end
        What the file covers, seconds.
    name
        Of the utterance: what a .mlf says, the file's name elsewhere.
    header
        Lines of a header that say nothing of times, kept to be written back (ESPS).
    """

    tiers: tuple[Tier, ...]
    start: float
    end: float
    name: str = field(default="", kw_only=True)
    header: tuple[str, ...] = field(default=(), kw_only=True)

    def __post_init__(self) -> None:
        object.__setattr__(self, "tiers", tuple(self.tiers))
        object.__setattr__(self, "header", tuple(self.header))

    def tier(self, name: str) -> Tier:
        """The first tier of a name.

        Raises
        ------
        DataError
            If there is none; the tiers that there are are listed.
        """
        for tier in self.tiers:
            if tier.name == name:
                return tier
        raise DataError(
            f"'{self.name}' has no tier '{name}'",
            found=", ".join(tier.name for tier in self.tiers) or "no tier",
            advice="Name one of the file's tiers.",
        )


class LabelReader(Protocol):
    """What reads and writes one format of labels; a module with these names is one."""

    @property
    def description(self) -> str:
        """The format, in a few words."""

    @property
    def extensions(self) -> tuple[str, ...]:
        """Usual endings of the file's name, in lower case, with their points."""

    def sniff(self, path: str | os.PathLike[str]) -> bool:
        """Whether a file looks like this format: fast, from its first bytes, never an error."""

    def read(
        self, path: str | os.PathLike[str], *, rate: float | None = None
    ) -> tuple[Labels, ...]:
        """All utterances of a file; `rate` is that of the samples, where times are samples."""

    def text(
        self,
        utterances: Sequence[Labels],
        path: str | os.PathLike[str],
        *,
        rate: float | None = None,
    ) -> str:
        """What a file of these utterances holds; `DataError` where the format cannot say it.

        The file is not written; its name may tell what is wanted in it.
        """


def find_label_reader(path: str | os.PathLike[str]) -> str:
    """Name of the reader for a file of labels, by what is in it, then by its ending.

    Raises
    ------
    FileFormatError
        If the file is missing, empty or unreadable, or no reader takes it.
    RegistryError
        If a reader of another distribution fails.

    Warns
    -----
    MocapFitWarning
        If a reader cannot be loaded; it is passed over.
    """
    return LABEL_READERS.find(check_file(path), ambiguous_extensions=False)


def read_all_labels(
    path: str | os.PathLike[str], *, reader: str | None = None, rate: float | None = None
) -> tuple[Labels, ...]:
    """Read every utterance of a file of labels; only a .mlf has more than one.

    Parameters
    ----------
    path
        The file.
    reader
        Name of the format, such as ``textgrid``; found from the file where not given.
    rate
        Samples per second of formats that count samples (TIMIT); 16000 where not given.

    Raises
    ------
    MocapFitError
        If the file cannot be read.

    Warns
    -----
    MocapFitWarning
        If the file is neither UTF-8 nor UTF-16, and is read as Latin-1.
    """
    file = check_file(path)
    name = find_label_reader(file) if reader is None else reader
    chosen = _reader(name)
    try:
        with LABEL_READERS.guard(name, file):
            return chosen.read(file, rate=rate)
    except MocapFitError:
        raise
    except OSError as error:
        raise from_os_error(error, path) from None


def read_labels(
    path: str | os.PathLike[str],
    name: str | None = None,
    *,
    reader: str | None = None,
    rate: float | None = None,
) -> Labels:
    """Read the labels of one utterance.

    Parameters
    ----------
    path
        The file.
    name
        Of the utterance, where the file holds several (.mlf).
    reader, rate
        As for `read_all_labels`.

    Raises
    ------
    MocapFitError
        If the file cannot be read.
    DataError
        If it holds several utterances and none is named, or has none of that name.
    """
    utterances = read_all_labels(path, reader=reader, rate=rate)
    if name is None and len(utterances) == 1:
        return utterances[0]
    if name is not None:
        for labels in utterances:
            if labels.name == name:
                return labels
        # A file of one utterance needs no name, and its own may be anything.
        if len(utterances) == 1 and Path(path).suffix.lower() != ".mlf":
            return utterances[0]
    problem = f"the file has no utterance '{name}'" if name else "the file holds several utterances"
    shown = ", ".join(labels.name for labels in utterances[:10])
    raise DataError(
        problem,
        path=path,
        found=f"{len(utterances)}: {shown}{', …' if len(utterances) > 10 else ''}",
        advice="Give the name of one of them.",
    )


def write_labels(
    labels: Labels | Sequence[Labels],
    path: str | os.PathLike[str],
    *,
    reader: str | None = None,
    rate: float | None = None,
) -> None:
    """Write labels, whole or not at all, in UTF-8.

    Parameters
    ----------
    labels
        One utterance, or several for a .mlf.
    path
        The file; one that exists is replaced.
    reader
        Name of the format; by the file's ending where not given. A ``.lab`` is HTK's, unless
        ``esps-lab`` is named.
    rate
        As for `read_all_labels`.

    Raises
    ------
    DataError
        If the format cannot say what the labels hold.
    FileFormatError
        If the ending says no format, or the file cannot be written.

    Warns
    -----
    MocapFitWarning
        If the format has no place for some of the tiers, which are left out.
    """
    utterances = (labels,) if isinstance(labels, Labels) else tuple(labels)
    target = Path(path)
    if reader is None:
        takes = [n for n in LABEL_READERS.names() if target.suffix.lower() in _reader(n).extensions]
        if not takes:
            raise FileFormatError(
                "the ending of the name says no format of labels",
                path=path,
                expected=", ".join(" ".join(_reader(n).extensions) for n in LABEL_READERS.names()),
                advice="Choose another ending, or name the format (reader=...).",
            )
        reader = "htk-lab" if "htk-lab" in takes else takes[0]
    chosen = _reader(reader)
    with LABEL_READERS.guard(reader, path):
        content = chosen.text(utterances, target, rate=rate)
    try:
        encoded = content.encode("utf-8")
    except UnicodeEncodeError as error:
        raise DataError("a label holds half a character", path=path, found=error) from None
    with write_atomically(path) as partial:
        partial.write_bytes(encoded)


def _reader(name: str) -> LabelReader:
    reader: LabelReader = LABEL_READERS.get(name)
    return reader
