"""Read and write labels in any format; the readers are found through a registry.

A reader is a module (or any object) with the attributes of `LabelReader`. A laboratory adds its
own by an entry point in the group ``mocap_fit.label_readers``. Labels preserve the errors of a
file, so that they can be inspected, corrected and written back; `mocap_fit.labels.read_phones`
converts them to phones.
"""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Protocol

from mocap_fit.atomic_file import write_atomically
from mocap_fit.errors import DataError, FileFormatError, MocapFitError, from_os_error, shorten
from mocap_fit.io.text import check_file, read_first_lines
from mocap_fit.labels.text import read_head_lines
from mocap_fit.labels.types import Labels
from mocap_fit.registry import Registry

LABEL_READERS = Registry("mocap_fit.label_readers", "label reader")

# Extensions under which labels and transcripts are found.
_NUMBER = re.compile(r"[-+]?[0-9]*[.,]?[0-9]+(?:[eE][-+]?[0-9]+)?")
_SEPARATORS = re.compile(r"[\s,;]+")
_TEXTS = (".lab", ".rec", ".txt", ".trn")


class LabelReader(Protocol):
    """Reader and writer of one format of labels; a module with these attributes is one."""

    @property
    def description(self) -> str:
        """The format in a few words."""

    @property
    def extensions(self) -> tuple[str, ...]:
        """Usual extensions of the files, in lower case, with their points."""

    def sniff(self, path: str | os.PathLike[str]) -> bool:
        """Return whether a file looks like this format, quickly and without an error.

        Parameters
        ----------
        path
            The file, of any format.

        Returns
        -------
        bool
            Whether its first bytes are those of the format.
        """

    def read(
        self, path: str | os.PathLike[str], *, rate: float | None = None
    ) -> tuple[Labels, ...]:
        """Read all utterances of a file.

        Parameters
        ----------
        path
            File to read.
        rate
            Sampling rate of times that are counted in samples, hertz; that of the format where
            not given.

        Returns
        -------
        tuple of Labels
            The utterances, in the order of the file.

        Raises
        ------
        MocapFitError
            With the file, if its content cannot be used.
        """

    def to_text(
        self,
        utterances: Sequence[Labels],
        path: str | os.PathLike[str],
        *,
        rate: float | None = None,
    ) -> str:
        """Return the content of a file of these utterances.

        Parameters
        ----------
        utterances
            Labels to write.
        path
            File that will be written; its extension may select the content.
        rate
            Sampling rate of times that are counted in samples, hertz; that of the format where
            not given.

        Returns
        -------
        str
            Content of the file.

        Raises
        ------
        DataError
            If the format cannot hold the labels.
        """


def find_label_reader(path: str | os.PathLike[str]) -> str:
    """Return the name of the reader for a file of labels.

    The content of the file decides; where no reader recognises it, its extension does if only one
    reader has it.

    Parameters
    ----------
    path
        The file.

    Returns
    -------
    str
        Name of the reader, such as ``textgrid``.

    Raises
    ------
    MissingFileError
        If there is no such file.
    FileFormatError
        If the file is empty or cannot be read, or no reader takes it.
    RegistryError
        If a reader of another distribution fails.

    Warns
    -----
    MocapFitWarning
        If a reader cannot be loaded; it is passed over.
    """
    file = check_file(path)
    try:
        return LABEL_READERS.find(file, ambiguous_extensions=False)
    except FileFormatError as error:
        lines = [line.strip() for line in read_head_lines(file) or read_first_lines(file, 1)]
        lines = [line for line in lines if line]
        if file.suffix.lower() not in _TEXTS or not lines:
            raise
        if _is_transcript(lines):
            raise FileFormatError(
                "this is a transcript: text without times",
                path=path,
                found=f"'{shorten(lines[0], 80)}'",
                expected="labels with times",
                advice="Align it with its sound: mocap-fit align SOUND --text FILE.",
            ) from None
        raise FileFormatError(
            error.problem,
            path=path,
            found=f"'{shorten(lines[0], 80)}'",
            expected=error.expected,
            advice=error.advice,
        ) from None


def _is_transcript(lines: Sequence[str]) -> bool:
    """Whether lines have letters and no times: one in front of each, or two somewhere."""
    words = [_SEPARATORS.split(line) for line in lines]
    numbers = [[_NUMBER.fullmatch(word) is not None for word in line] for line in words]
    is_timed = any(line[0] for line in numbers) or all(sum(line) >= 2 for line in numbers)
    return not is_timed and any(letter.isalpha() for line in lines for letter in line)


def read_all_labels(
    path: str | os.PathLike[str], *, reader: str | None = None, rate: float | None = None
) -> tuple[Labels, ...]:
    """Read every utterance of a file of labels; only a .mlf has several.

    Parameters
    ----------
    path
        File to read.
    reader
        Name of the format, such as ``textgrid``; determined from the file where not given.
    rate
        Sampling rate of formats that count samples (TIMIT), hertz; 16,000 where not given.

    Returns
    -------
    tuple of Labels
        The utterances, in the order of the file.

    Raises
    ------
    MissingFileError
        If there is no such file.
    MocapFitError
        If the file cannot be read.

    Warns
    -----
    MocapFitWarning
        If the file is neither UTF-8 nor UTF-16, and is read as Latin-1.
    """
    file = check_file(path)
    name = find_label_reader(file) if reader is None else reader
    source: LabelReader = LABEL_READERS.get(name)
    try:
        with LABEL_READERS.guard(name, file):
            return source.read(file, rate=rate)
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
        File to read.
    name
        Name of the utterance, where the file holds several (.mlf).
    reader
        Name of the format, such as ``textgrid``; determined from the file where not given.
    rate
        Sampling rate of formats that count samples (TIMIT), hertz; 16,000 where not given.

    Returns
    -------
    Labels
        The labels as they are in the file.

    Raises
    ------
    MissingFileError
        If there is no such file.
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
    value = f"{len(utterances)}: {shown}{', …' if len(utterances) > 10 else ''}"
    raise DataError(problem, path=path, found=value, advice="Give the name of one of them.")


def write_labels(
    labels: Labels | Sequence[Labels],
    path: str | os.PathLike[str],
    *,
    reader: str | None = None,
    rate: float | None = None,
) -> None:
    """Write labels in UTF-8, atomically.

    Parameters
    ----------
    labels
        One utterance, or several for a .mlf.
    path
        File to write; an existing one is replaced.
    reader
        Name of the format; determined from the extension where not given. A ``.lab`` is HTK's,
        unless ``esps-lab`` or ``seconds-lab`` is named.
    rate
        Sampling rate of formats that count samples (TIMIT), hertz; 16,000 where not given.

    Raises
    ------
    DataError
        If the format cannot hold the labels.
    FileFormatError
        If the extension is not that of a format, or the file cannot be written.

    Warns
    -----
    MocapFitWarning
        If the format has no room for some of the tiers, which are left out.
    """
    utterances = (labels,) if isinstance(labels, Labels) else tuple(labels)
    target = Path(path)
    if reader is None:
        extensions = {n: r.extensions for n, r in LABEL_READERS.load_all().items()}
        matches = [n for n in extensions if target.suffix.lower() in extensions[n]]
        if not matches:
            raise FileFormatError(
                "the extension of the name is not that of a format of labels",
                path=path,
                expected=", ".join(" ".join(every) for every in extensions.values()),
                advice="Choose another extension, or name the format (reader=...).",
            )
        reader = "htk-lab" if "htk-lab" in matches else matches[0]
    writer: LabelReader = LABEL_READERS.get(reader)
    with LABEL_READERS.guard(reader, path):
        content = writer.to_text(utterances, target, rate=rate)
    try:
        encoded = content.encode("utf-8")
    except UnicodeEncodeError as error:
        raise DataError("a label holds half a character", path=path, found=error) from None
    with write_atomically(path) as partial:
        partial.write_bytes(encoded)
