"""Praat's binary TextGrids: fields one after another, numbers with the highest byte first."""

from __future__ import annotations

import os
import struct
import warnings

from mocap_fit.errors import FileFormatError, MocapFitWarning, shorten
from mocap_fit.labels.text import LABEL_SIZE, LARGEST_TIME
from mocap_fit.labels.types import Label, Tier, TierKind
from mocap_fit.size_limit import check_size

SIGNATURE = b"ooBinaryFile"
# Bytes of an entry without text: its times, and the length of the text.
_SHORTEST = {"IntervalTier": 18, "TextTier": 10}
_KINDS: dict[str, TierKind] = {"IntervalTier": "interval", "TextTier": "point"}
_WIDE = 0xFFFF


class _Fields:
    """The fields of a binary file, one after another."""

    def __init__(self, content: bytes, path: str | os.PathLike[str]) -> None:
        self.content, self.path = content, path
        self.position = len(SIGNATURE)

    def create_error(self, problem: str, value: object, expected: str) -> FileFormatError:
        advice = "Open and save it in Praat, or copy it again."
        return FileFormatError(
            f"{problem} (at byte {self.position} of the binary TextGrid)",
            path=self.path,
            found=value,
            expected=expected,
            advice=advice,
        )

    def take(self, size: int) -> bytes:
        field = self.content[self.position : self.position + size]
        if len(field) < size:
            raise self.create_error("the file ends too early", f"{len(field)} bytes", str(size))
        self.position += size
        return field

    def take_number(self, kind: str) -> int:
        (value,) = struct.unpack(f">{kind}", self.take(struct.calcsize(f">{kind}")))
        return int(value)

    def take_time(self, noun: str) -> float:
        (value,) = struct.unpack(">d", self.take(8))
        if not abs(value) <= LARGEST_TIME:
            raise self.create_error("this is not a time", value, f"{noun} in seconds")
        return float(value)

    def take_name(self) -> str:
        return self.take(self.take_number("B")).decode("latin-1")

    def take_text(self) -> str:
        count = self.take_number("H")
        if count != _WIDE:
            return self.take(count).decode("latin-1")
        # UTF-16, counted in characters: those beyond the first 65,536 take two units.
        remaining, text = self.take_number("H"), ""
        while remaining:
            units = self.take(2 * remaining)
            if 0xD8 <= units[-2] < 0xDC:
                units += self.take(2)
            try:
                part = units.decode("utf-16-be")
            except UnicodeDecodeError as error:
                raise self.create_error("a text is damaged", error.reason, "UTF-16") from None
            text += part
            remaining -= len(part)
        return text


def read_binary(
    content: bytes, path: str | os.PathLike[str]
) -> tuple[float, float, tuple[Tier, ...]]:
    """Read a binary TextGrid.

    Parameters
    ----------
    content
        The bytes of the file.
    path
        File for messages.

    Returns
    -------
    start
        Start, seconds.
    end
        End, seconds.
    tiers
        The tiers.

    Raises
    ------
    FileFormatError
        If it is not a TextGrid, or damaged.

    Warns
    -----
    MocapFitWarning
        If more follows than its sizes say.
    """
    fields = _Fields(content, path)
    check_class(fields.take_name(), path)
    start, end = fields.take_time("the start"), fields.take_time("the end")
    count = fields.take_number("i") if fields.take(1) != b"\0" else 0
    tiers = tuple(_read_tier(fields, start, end) for _ in range(count))
    rest = len(content) - fields.position
    if rest:
        warnings.warn(
            f"{os.fspath(path)}: {rest} bytes behind the last tier were not read; its size may be "
            "wrong. Open and save it in Praat.",
            MocapFitWarning,
            stacklevel=2,
        )
    return start, end, tiers


def check_class(name: str, path: str | os.PathLike[str]) -> None:
    """Refuse the other objects of Praat.

    Parameters
    ----------
    name
        Class of the object, with or without its version.
    path
        File for messages.

    Raises
    ------
    FileFormatError
        If it is not a TextGrid.
    """
    if name.split()[:1] != ["TextGrid"]:
        raise FileFormatError(
            "this Praat file is not a TextGrid",
            path=path,
            found=shorten(name, 40),
            expected="TextGrid",
            advice="In Praat, select the TextGrid alone and save it as a text file.",
        )


def _read_tier(fields: _Fields, file_start: float, file_end: float) -> Tier:
    name = fields.take_name()
    if name not in _KINDS:
        raise fields.create_error(
            "unknown class of tier", shorten(name, 40), "IntervalTier or TextTier"
        )
    kind, title = _KINDS[name], fields.take_text()
    start, end = fields.take_time("a tier's start"), fields.take_time("a tier's end")
    count = fields.take_number("i")
    if count < 0:
        raise fields.create_error("this is not a number of entries", count, "0 or more")
    available = len(fields.content) - fields.position
    noun = f"tier '{shorten(title, 40)}'"
    check_size(count * _SHORTEST[name], path=fields.path, available_bytes=available, noun=noun)
    check_size(count * LABEL_SIZE, path=fields.path, noun=noun)
    entries = []
    for number in range(1, count + 1):
        first = last = fields.take_time(f"entry {number} of {noun}")
        if kind == "interval":
            last = fields.take_time(f"the end of entry {number} of {noun}")
        entries.append(Label(first, last, fields.take_text()))
    ends = (None if start == file_start else start, None if end == file_end else end)
    return Tier(title, tuple(entries), kind, *ends)
