"""What the formats of labels have in common: encodings, numbers, one utterance a file."""

from __future__ import annotations

import math
import os
import warnings
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from mocap_fit.errors import DataError, FileFormatError, MocapFitWarning, from_os_error
from mocap_fit.io.text import check_file, read_head
from mocap_fit.labels.readers import Label, Labels

LARGEST_FILE = 256 * 2**20
"""Bytes. The labels of 1000 hours of speech in a .mlf fill less."""


def _encoding(content: bytes) -> str | None:
    """UTF-16 by its mark, or by the zero bytes that Latin letters have; None for bytes."""
    if content.startswith((b"\xff\xfe", b"\xfe\xff")):
        return "utf-16"
    head = content[:64]
    for zeros, encoding in ((head[1::2], "utf-16-le"), (head[0::2], "utf-16-be")):
        if zeros and zeros.count(0) > 0.7 * len(zeros):
            return encoding
    return None


def label_text(path: str | os.PathLike[str]) -> str:
    """All text of a file, its lines ended by line feeds: UTF-8, UTF-16, or else Latin-1.

    Raises
    ------
    FileFormatError
        If the file is missing, empty, unreadable, far too large, or not text.

    Warns
    -----
    MocapFitWarning
        If it is neither UTF-8 nor UTF-16.
    """
    file = check_file(path)
    try:
        if file.stat().st_size > LARGEST_FILE:
            raise FileFormatError(
                "the file is too large for labels",
                path=path,
                found=f"{file.stat().st_size / 2**20:.0f} MB",
                expected=f"at most {LARGEST_FILE // 2**20} MB",
            )
        content = file.read_bytes()
    except OSError as error:
        raise from_os_error(error, path) from None
    encoding = _encoding(content)
    try:
        text = content.decode(encoding or "utf-8-sig")
    except UnicodeDecodeError as error:
        if encoding is not None:
            raise FileFormatError(
                "the file is damaged UTF-16", path=path, found=error.reason
            ) from None
        text = content.decode("latin-1")
        warnings.warn(
            f"{os.fspath(path)} is not UTF-8 and was read as Latin-1. "
            "Save it as UTF-8 if letters look wrong.",
            MocapFitWarning,
            stacklevel=3,
        )
    text = text.removeprefix("\ufeff")
    if "\0" in text:
        raise FileFormatError(
            "the file holds binary data",
            path=path,
            line=text[: text.index("\0")].count("\n") + 1,
            expected="text",
            advice="Check that it is the file you mean.",
        )
    return text.replace("\r\n", "\n").replace("\r", "\n")


def head_lines(path: str | os.PathLike[str], size: int = 4096) -> list[str]:
    """The first lines of a file for a reader that asks whether it is its own; never an error.

    A last line that may be cut short is left out.
    """
    content = read_head(path, size)
    whole = len(content) < size
    encoding = _encoding(content)
    if encoding is not None:
        content = content[: len(content) // 2 * 2]
    text = content.decode(encoding or "utf-8-sig", errors="replace").removeprefix("\ufeff")
    if "\0" in text:
        return []
    lines = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    return lines if whole else lines[:-1]


def number_text(value: float) -> str:
    """The shortest decimal that reads back as the same number."""
    return np.format_float_positional(value + 0.0, trim="-")


def seconds(text: str, path: str | os.PathLike[str], line: int) -> float:
    """A time in seconds as a file has it.

    Raises
    ------
    FileFormatError
        If it is not a finite number.
    """
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise FileFormatError(
            "this is not a time", path=path, line=line, found=f"'{text}'", expected="seconds"
        )
    return value


def only_one(utterances: Sequence[Labels], format_name: str) -> Labels:
    """The one utterance that a file of most formats holds.

    Raises
    ------
    DataError
        If there are more or none.
    """
    if len(utterances) != 1:
        raise DataError(
            f"a {format_name} file holds one utterance",
            found=f"{len(utterances)}",
            advice="Write one file an utterance, or a .mlf.",
        )
    return utterances[0]


def refuse_characters(
    entries: Sequence[Label], forbidden: str, format_name: str, *, outer_blanks: bool = False
) -> None:
    """Refuse texts with characters that a format cannot write; `outer_blanks`: or blanks outside.

    Raises
    ------
    DataError
        With the first such label.
    """
    for entry in entries:
        blanks = outer_blanks and entry.text != entry.text.strip()
        if blanks or any(character in forbidden for character in entry.text):
            raise DataError(
                f"{format_name} cannot write the label at {entry.start} s",
                found=repr(entry.text),
                advice="Write a TextGrid or CSV.",
            )


def utterance_name(path: str | os.PathLike[str]) -> str:
    """The name of a file's utterance: the file's, without its ending."""
    return Path(path).stem


def units(value: float, rate: float) -> int:
    """A time as a whole number of units, such as samples."""
    return round(value * rate)
