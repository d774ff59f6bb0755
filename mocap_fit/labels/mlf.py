"""HTK master label files: the labels of many utterances, each under its name."""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from pathlib import PurePosixPath

from mocap_fit.errors import DataError, FileFormatError, shorten
from mocap_fit.labels.htk import Row, build_utterance, format_rows, parse_row, warn_of_units
from mocap_fit.labels.text import read_head_lines, read_label_lines
from mocap_fit.labels.types import Labels

description = "HTK master label file, times in 100 ns"
extensions = (".mlf",)

_FIRST = "#!MLF!#"
_NAME = re.compile(r'"(.*)"')


def sniff(path: str | os.PathLike[str]) -> bool:
    """Return whether the first line is that of a master label file.

    Parameters
    ----------
    path
        The file.

    Returns
    -------
    bool
        Whether it looks like a master label file.
    """
    return read_head_lines(path)[:1] in ([_FIRST], [_FIRST + " "])


def read(path: str | os.PathLike[str], *, rate: float | None = None) -> tuple[Labels, ...]:
    """Read all utterances of a master label file.

    Of several transcriptions of one utterance (separated by ``///``) the first is read.

    Parameters
    ----------
    path
        File to read.
    rate
        Sampling rate, hertz; not used.

    Returns
    -------
    tuple of Labels
        The utterances, in the order of the file.

    Raises
    ------
    FileFormatError
        If a line is out of order, or an utterance comes twice.

    Warns
    -----
    MocapFitWarning
        If all labels last less than a hundredth of a second in units of 100 ns.
    """
    lines = [line.strip(" \t") for line in read_label_lines(path)]
    if lines[0] != _FIRST:
        raise FileFormatError(
            "this is not a master label file",
            path=path,
            line=1,
            found=shorten(lines[0]),
            expected=_FIRST,
        )
    entries: dict[str, Labels] = {}
    name: str | None = None
    rows: list[Row] = []
    others = False
    for number, line in enumerate(lines[1:], start=2):
        if not line:
            continue
        if name is None:
            match = _NAME.fullmatch(line)
            if match is None:
                raise FileFormatError(
                    "a name in quotation marks is missing",
                    path=path,
                    line=number,
                    found=f"'{shorten(line)}'",
                    expected='such as "*/take_01.lab"',
                )
            name, rows, others = _parse_name(match[1]), [], False
            if name in entries:
                raise FileFormatError(
                    f"the utterance '{shorten(name, 40)}' comes twice", path=path, line=number
                )
        elif line == ".":
            entries[name] = build_utterance(rows, name)
            name = None
        elif line == "///":
            others = True
        elif not others:
            rows.append(parse_row(line, number, path))
    if name is not None:
        # HTK allows the last full stop to be left out; a file cut short looks the same.
        entries[name] = build_utterance(rows, name)
    warn_of_units(tuple(entries.values()), path)
    return tuple(entries.values())


def to_text(
    utterances: Sequence[Labels], path: str | os.PathLike[str], *, rate: float | None = None
) -> str:
    """Return the content of a master label file.

    Parameters
    ----------
    utterances
        Labels to write, each with a name of its own.
    path
        File for messages.
    rate
        Sampling rate, hertz; not used.

    Returns
    -------
    str
        Content of the file.

    Raises
    ------
    DataError
        If utterances have no names or one name, or a label holds the end of a line.
    """
    parts = [_FIRST + "\n"]
    names: set[str] = set()
    for labels in utterances:
        name = labels.name
        is_plain = name == _parse_name(f"*/{name}.lab") and not set(name) & set('"\n\r\0')
        if not name or name in names or not is_plain:
            raise DataError(
                "a .mlf needs a name for every utterance, each once",
                path=path,
                found=repr(name),
                advice="Name it without slashes, quotes and ends of lines.",
            )
        names.add(name)
        parts.append(f'"*/{name}.lab"\n{format_rows(labels)}.\n')
    return "".join(parts)


def _parse_name(pattern: str) -> str:
    """Return the utterance of a name in the file: ``*/take_01.lab`` is ``take_01``."""
    return PurePosixPath(pattern.replace("\\", "/")).stem
