"""Common parts of the formats of labels: encodings, numbers, one utterance a file."""

from __future__ import annotations

import math
import os
import warnings
from collections.abc import Sequence

import numpy as np

from mocap_fit.errors import (
    DataError,
    FileFormatError,
    MocapFitWarning,
    from_os_error,
    shorten,
)
from mocap_fit.io.text import check_file, read_head
from mocap_fit.labels.types import Label, Labels
from mocap_fit.size_limit import check_size

LARGEST_FILE = 256 * 2**20
"""Bytes. The labels of 100 hours of speech in a .mlf fill less."""
LABEL_SIZE = 500
"""Bytes that a label takes in memory while it is read, about."""
LARGEST_TIME = 1e6
"""Seconds, about 12 days. What is longer has another unit, or is damaged."""


def _detect_encoding(content: bytes) -> str | None:
    """Return UTF-16 by its mark or by the zero bytes of Latin letters; None for others."""
    if content.startswith((b"\xff\xfe", b"\xfe\xff")):
        return "utf-16"
    head = content[:64]
    for zeros, encoding in ((head[1::2], "utf-16-le"), (head[0::2], "utf-16-be")):
        if zeros and zeros.count(0) > 0.7 * len(zeros):
            return encoding
    return None


def read_label_bytes(path: str | os.PathLike[str]) -> bytes:
    """Read the bytes of a file.

    Parameters
    ----------
    path
        File to read.

    Returns
    -------
    bytes
        The content.

    Raises
    ------
    MissingFileError
        If there is no such file.
    FileFormatError
        If the file is empty, cannot be read, or is far too large.
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
        return file.read_bytes()
    except OSError as error:
        raise from_os_error(error, path) from None


def read_label_text(path: str | os.PathLike[str]) -> str:
    """Read the text of a file in UTF-8, UTF-16, or else Latin-1.

    Parameters
    ----------
    path
        File to read.

    Returns
    -------
    str
        The text, with line feeds as line endings.

    Raises
    ------
    MissingFileError
        If there is no such file.
    FileFormatError
        If the file is empty, cannot be read, is far too large, or is not text.

    Warns
    -----
    MocapFitWarning
        If it is neither UTF-8 nor UTF-16.
    """
    content = read_label_bytes(path)
    encoding = _detect_encoding(content)
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


def read_label_lines(path: str | os.PathLike[str]) -> list[str]:
    """Read the lines of a file that has a label in each.

    Parameters
    ----------
    path
        File to read.

    Returns
    -------
    list of str
        The lines without their ends.

    Raises
    ------
    FileFormatError
        If the file cannot be read, or holds more labels than `mocap_fit.size_limit` allows.
    """
    text = read_label_text(path)
    check_size((text.count("\n") + 1) * LABEL_SIZE, path=path)
    return text.split("\n")


def read_head_lines(path: str | os.PathLike[str], size: int = 4096) -> list[str]:
    """Return the first lines of a file, for readers that sniff it.

    Parameters
    ----------
    path
        The file.
    size
        Number of bytes to read; a last line that may be cut short is left out.

    Returns
    -------
    list of str
        The lines; none for a file that is not text or cannot be read.
    """
    content = read_head(path, size)
    is_complete = len(content) < size
    encoding = _detect_encoding(content)
    if encoding is not None:
        content = content[: len(content) // 2 * 2]
    text = content.decode(encoding or "utf-8-sig", errors="replace").removeprefix("\ufeff")
    if "\0" in text:
        return []
    lines = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    return lines if is_complete else lines[:-1]


def format_number(value: float) -> str:
    """Return the shortest decimal that reads back as the same number.

    Parameters
    ----------
    value
        Any finite number, such as seconds.

    Returns
    -------
    str
        The decimal, without an exponent.
    """
    return np.format_float_positional(value + 0.0, trim="-")


def parse_seconds(text: str, path: str | os.PathLike[str], line: int, rate: float = 1.0) -> float:
    """Parse a time.

    Parameters
    ----------
    text
        Text of the time.
    path
        File for the message.
    line
        Line for the message.
    rate
        Units of the text per second, hertz, such as samples.

    Returns
    -------
    float
        Time, seconds.

    Raises
    ------
    FileFormatError
        If it is not a number, or is beyond `LARGEST_TIME`.
    """
    try:
        value = float(text) / rate
    except ValueError:
        value = math.nan
    if not abs(value) <= LARGEST_TIME:
        raise FileFormatError(
            "this is not a time",
            path=path,
            line=line,
            found=f"'{shorten(text, 40)}'",
            expected=f"{'seconds' if rate == 1 else f'units of 1/{rate:g} s'}, not above "
            f"{LARGEST_TIME:.0e} s",
        )
    return value


def get_only(utterances: Sequence[Labels], format_name: str) -> Labels:
    """Return the only utterance, for formats that hold one.

    Parameters
    ----------
    utterances
        Labels to write.
    format_name
        Name of the format for the message.

    Returns
    -------
    Labels
        The utterance.

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
    """Refuse labels with characters that a format cannot write.

    Parameters
    ----------
    entries
        Labels to write.
    forbidden
        Characters that are refused.
    format_name
        Name of the format for the message.
    outer_blanks
        Whether blanks before and after the text are refused too.

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


def to_units(value: float, rate: float) -> int:
    """Convert a time to an integer number of units, such as samples.

    Parameters
    ----------
    value
        Time, seconds.
    rate
        Units a second, hertz.

    Returns
    -------
    int
        Number of units.
    """
    return round(value * rate)


def create_line_error(
    path: str | os.PathLike[str], line: int, text: str, format_name: str, expected: str
) -> FileFormatError:
    """Return the error of a line that is not a label of a format.

    Parameters
    ----------
    path
        The file.
    line
        Number of the line.
    text
        Text of the line.
    format_name
        Name of the format.
    expected
        Content of a valid line.

    Returns
    -------
    FileFormatError
        The error to raise.
    """
    return FileFormatError(
        f"this is not a label of {format_name}",
        path=path,
        line=line,
        found=f"'{shorten(text)}'",
        expected=expected,
    )
