"""Praat TextGrids, long and short, read and written without a change.

As in Praat itself, only free-standing numbers, quoted strings and flags such as <exists> count;
the names and signs around them are for people. So the long and the short form are read alike.
praatio is not used to read, because it strips spaces from labels and looks for its keywords within
them too; the tests compare with it.
"""

from __future__ import annotations

import math
import os
import re
from collections.abc import Sequence
from pathlib import Path

from mocap_fit.errors import FileFormatError
from mocap_fit.labels.text import (
    format_number,
    get_only,
    read_head_lines,
    read_label_text,
    refuse_characters,
)
from mocap_fit.labels.types import Label, Labels, Tier, TierKind

description = "Praat TextGrid, long or short"
extensions = (".textgrid",)

# A number or a flag stands free: between blanks. What is in square brackets ("intervals [3]:")
# and what follows an exclamation mark is not read.
_TOKEN = re.compile(
    r'"(?P<text>[^"]*(?:""[^"]*)*)"|(?P<comment>![^\n]*)|(?P<word>[^\s"]+)', re.DOTALL
)
_NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
_KINDS: dict[str, TierKind] = {"IntervalTier": "interval", "TextTier": "point"}
_CLASSES = {kind: name for name, kind in _KINDS.items()}


def sniff(path: str | os.PathLike[str]) -> bool:
    """Return whether the first lines name a TextGrid.

    Parameters
    ----------
    path
        The file.

    Returns
    -------
    bool
        Whether it looks like a TextGrid.
    """
    head = "\n".join(read_head_lines(path, 1024)[:4])
    return "ooTextFile" in head and '"TextGrid"' in head


class _Tokens:
    """The numbers, strings and flags of a text, one after another."""

    def __init__(self, text: str, path: str | os.PathLike[str]) -> None:
        self.text, self.path = text, path
        self.position = 0

    def create_error(self, problem: str, value: object, expected: str) -> FileFormatError:
        line = self.text.count("\n", 0, self.position) + 1
        advice = "Open and save it in Praat, or mend the line."
        return FileFormatError(
            problem, path=self.path, line=line, found=value, expected=expected, advice=advice
        )

    def _read_token(self, expected: str) -> tuple[str, str]:
        while match := _TOKEN.match(self.text, self._skip_blanks()):
            self.position = match.end()
            if (text := match["text"]) is not None:
                return "text", text.replace('""', '"')
            word = match["word"]
            if word is None:
                continue
            if _NUMBER.fullmatch(word):
                return "number", word
            if word.startswith("<"):
                return "flag", word
        if self.position < len(self.text) and '"' in self.text[self.position :]:
            raise self.create_error("a quotation mark has no end", "the end of the file", '"')
        raise self.create_error("the file ends too early", "the end of the file", expected)

    def _skip_blanks(self) -> int:
        while self.position < len(self.text) and self.text[self.position].isspace():
            self.position += 1
        return self.position

    def take(self, kind: str, expected: str) -> str:
        actual, value = self._read_token(expected)
        if actual != kind:
            raise self.create_error("this TextGrid is damaged", f"{actual} '{value}'", expected)
        return value

    def take_time(self, expected: str) -> float:
        value = float(self.take("number", expected))
        if not math.isfinite(value):
            raise self.create_error("this is not a time", value, "seconds")
        return value

    def take_count(self, expected: str) -> int:
        value = self.take("number", expected)
        if not value.isdigit():
            raise self.create_error("this is not a number of entries", value, expected)
        return int(value)


def read(path: str | os.PathLike[str], *, rate: float | None = None) -> tuple[Labels, ...]:
    """Read a TextGrid.

    Parameters
    ----------
    path
        File to read.
    rate
        Sampling rate, hertz; not used.

    Returns
    -------
    tuple of Labels
        The only utterance of the file.

    Raises
    ------
    FileFormatError
        If the file is not a complete TextGrid.
    """
    tokens = _Tokens(read_label_text(path), path)
    tokens.take("text", 'File type = "ooTextFile"')
    kind = tokens.take("text", 'Object class = "TextGrid"')
    if kind.split()[:1] != ["TextGrid"]:
        raise FileFormatError(
            "this Praat file is not a TextGrid",
            path=path,
            found=kind,
            expected="TextGrid",
            advice="Save the TextGrid alone, not a collection.",
        )
    start, end = tokens.take_time("the start in seconds"), tokens.take_time("the end in seconds")
    exists = tokens.take("flag", "<exists> or <absent>") == "<exists>"
    count = tokens.take_count("the number of tiers") if exists else 0
    tiers = [_read_tier(tokens, start, end) for _ in range(count)]
    return (Labels(tuple(tiers), start, end, name=Path(path).stem),)


def _read_tier(tokens: _Tokens, file_start: float, file_end: float) -> Tier:
    kind_name = tokens.take("text", '"IntervalTier" or "TextTier"')
    if kind_name not in _KINDS:
        raise tokens.create_error("unknown class of tier", kind_name, "IntervalTier or TextTier")
    name = tokens.take("text", "the tier's name")
    start, end = tokens.take_time("the tier's start"), tokens.take_time("the tier's end")
    entries = []
    for _ in range(tokens.take_count("the number of entries")):
        if _KINDS[kind_name] == "interval":
            first = tokens.take_time("a start in seconds")
            last = tokens.take_time("an end in seconds")
        else:
            first = last = tokens.take_time("a time in seconds")
        entries.append(Label(first, last, tokens.take("text", "a quoted label")))
    tier_start = None if start == file_start else start
    tier_end = None if end == file_end else end
    return Tier(name, tuple(entries), _KINDS[kind_name], tier_start, tier_end)


def to_text(
    utterances: Sequence[Labels], path: str | os.PathLike[str], *, rate: float | None = None
) -> str:
    """Return the long form of a TextGrid.

    Parameters
    ----------
    utterances
        Exactly one utterance.
    path
        Not used.
    rate
        Sampling rate, hertz; not used.

    Returns
    -------
    str
        Content of the file.

    Raises
    ------
    DataError
        If there is not one utterance, or a label holds a carriage return or a zero byte.
    """
    labels = get_only(utterances, "TextGrid")
    lines = [
        'File type = "ooTextFile"',
        'Object class = "TextGrid"',
        "",
        f"xmin = {format_number(labels.start)} ",
        f"xmax = {format_number(labels.end)} ",
        "tiers? <exists> " if labels.tiers else "tiers? <absent> ",
    ]
    if labels.tiers:
        lines += [f"size = {len(labels.tiers)} ", "item []: "]
    for number, tier in enumerate(labels.tiers, start=1):
        refuse_characters((*tier.entries, Label(0, 0, tier.name)), "\r\0", "a TextGrid")
        interval = tier.kind == "interval"
        noun = "intervals" if interval else "points"
        start = labels.start if tier.start is None else tier.start
        end = labels.end if tier.end is None else tier.end
        lines += [
            f"    item [{number}]:",
            f'        class = "{_CLASSES[tier.kind]}" ',
            f"        name = {_quote(tier.name)} ",
            f"        xmin = {format_number(start)} ",
            f"        xmax = {format_number(end)} ",
            f"        {noun}: size = {len(tier.entries)} ",
        ]
        for position, entry in enumerate(tier.entries, start=1):
            lines.append(f"        {noun} [{position}]:")
            if interval:
                lines += [
                    f"            xmin = {format_number(entry.start)} ",
                    f"            xmax = {format_number(entry.end)} ",
                    f"            text = {_quote(entry.text)} ",
                ]
            else:
                lines += [
                    f"            number = {format_number(entry.start)} ",
                    f"            mark = {_quote(entry.text)} ",
                ]
    return "\n".join(lines) + "\n"


def _quote(value: str) -> str:
    return '"' + value.replace('"', '""') + '"'
