"""HTK master label files: the labels of many utterances, each under its name."""

from __future__ import annotations

import os
import re
from collections.abc import Sequence

from mocap_fit.errors import FileFormatError
from mocap_fit.labels.htk import (
    Row,
    name_error,
    parsed_row,
    rows_text,
    utterance,
    utterance_of_pattern,
)
from mocap_fit.labels.readers import Labels
from mocap_fit.labels.text import head_lines, label_text

description = "HTK master label file, times in 100 ns"
extensions = (".mlf",)

_FIRST = "#!MLF!#"
_NAME = re.compile(r'"(.*)"')


def sniff(path: str | os.PathLike[str]) -> bool:
    """Whether the first line is that of a master label file."""
    return head_lines(path)[:1] == [_FIRST] or head_lines(path)[:1] == [_FIRST + " "]


def read(path: str | os.PathLike[str], *, rate: float | None = None) -> tuple[Labels, ...]:
    """Read all utterances; `rate` is not used.

    Of several transcriptions of one utterance (parted by ``///``) the first is read.

    Raises
    ------
    FileFormatError
        If a line is not what belongs there, or an utterance comes twice.
    """
    lines = [line.strip(" \t") for line in label_text(path).split("\n")]
    if lines[0] != _FIRST:
        raise FileFormatError(
            "this is no master label file", path=path, line=1, found=lines[0], expected=_FIRST
        )
    found: dict[str, Labels] = {}
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
                    "a name in quotation marks belongs here",
                    path=path,
                    line=number,
                    found=f"'{line}'",
                    expected='such as "*/take_01.lab"',
                )
            name, rows, others = utterance_of_pattern(match[1]), [], False
            if name in found:
                raise FileFormatError(f"the utterance '{name}' comes twice", path=path, line=number)
        elif line == ".":
            found[name] = utterance(rows, name)
            name = None
        elif line == "///":
            others = True
        elif not others:
            rows.append(parsed_row(line, number, path))
    if name is not None:
        # HTK allows the last full stop to be left out; a file cut short looks the same.
        found[name] = utterance(rows, name)
    return tuple(found.values())


def text(
    utterances: Sequence[Labels], path: str | os.PathLike[str], *, rate: float | None = None
) -> str:
    """The file's text; `path` is only for messages, `rate` is not used.

    Raises
    ------
    DataError
        If utterances have no names or one name, or a label holds the end of a line.
    """
    parts = [_FIRST + "\n"]
    names: set[str] = set()
    for labels in utterances:
        name = labels.name
        if not name or name in names or utterance_of_pattern(f"*/{name}.lab") != name:
            raise name_error(path, name)
        if any(character in '"\n\r\0' for character in name):
            raise name_error(path, name)
        names.add(name)
        parts.append(f'"*/{name}.lab"\n{rows_text(labels)}.\n')
    return "".join(parts)
