"""Praat TextGrids, long and short, read and written without a change.

What Praat itself does is done here: of the whole text only free-standing numbers, quoted strings
and flags such as <exists> count; the names and signs around them are for the eye. So the long and
the short form are one. praatio is not used to read, because it strips spaces from labels and looks
for its keywords within them too; the tests compare with it.
"""

from __future__ import annotations

import math
import os
import re
from collections.abc import Sequence

from mocap_fit.errors import FileFormatError
from mocap_fit.labels.readers import Label, Labels, Tier, TierKind
from mocap_fit.labels.text import (
    head_lines,
    label_text,
    number_text,
    only_one,
    refuse_characters,
    utterance_name,
)

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
    """Whether the first lines name a TextGrid."""
    head = "\n".join(head_lines(path, 1024)[:4])
    return "ooTextFile" in head and '"TextGrid"' in head


class _Tokens:
    """The numbers, strings and flags of the text, one after another."""

    def __init__(self, text: str, path: str | os.PathLike[str]) -> None:
        self.text, self.path = text, path
        self.position = 0

    def _error(self, problem: str, found: object, expected: str) -> FileFormatError:
        line = self.text.count("\n", 0, self.position) + 1
        return FileFormatError(
            problem,
            path=self.path,
            line=line,
            found=found,
            expected=expected,
            advice="Open and save it in Praat, or mend the line.",
        )

    def _next(self, expected: str) -> tuple[str, str]:
        while match := _TOKEN.match(self.text, self._skip()):
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
            raise self._error("a quotation mark has no end", "the end of the file", '"')
        raise self._error("the file ends too early", "the end of the file", expected)

    def _skip(self) -> int:
        while self.position < len(self.text) and self.text[self.position].isspace():
            self.position += 1
        return self.position

    def take(self, kind: str, expected: str) -> str:
        found, value = self._next(expected)
        if found != kind:
            raise self._error("this is not a whole TextGrid", f"{found} '{value}'", expected)
        return value

    def time(self, expected: str) -> float:
        value = float(self.take("number", expected))
        if not math.isfinite(value):
            raise self._error("this is not a time", value, "seconds")
        return value

    def count(self, expected: str) -> int:
        value = self.take("number", expected)
        if not value.isdigit():
            raise self._error("this is not a number of entries", value, expected)
        return int(value)


def read(path: str | os.PathLike[str], *, rate: float | None = None) -> tuple[Labels, ...]:
    """Read a TextGrid; `rate` is not used.

    Raises
    ------
    FileFormatError
        If the file is not a whole TextGrid.
    """
    tokens = _Tokens(label_text(path), path)
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
    start, end = tokens.time("the start in seconds"), tokens.time("the end in seconds")
    tiers = []
    if tokens.take("flag", "<exists> or <absent>") == "<exists>":
        tiers = [_tier(tokens, start, end) for _ in range(tokens.count("the number of tiers"))]
    return (Labels(tuple(tiers), start, end, name=utterance_name(path)),)


def _tier(tokens: _Tokens, file_start: float, file_end: float) -> Tier:
    kind_name = tokens.take("text", '"IntervalTier" or "TextTier"')
    if kind_name not in _KINDS:
        raise tokens._error("unknown class of tier", kind_name, "IntervalTier or TextTier")
    name = tokens.take("text", "the tier's name")
    start, end = tokens.time("the tier's start"), tokens.time("the tier's end")
    entries = []
    for _ in range(tokens.count("the number of entries")):
        if _KINDS[kind_name] == "interval":
            first, last = tokens.time("a start in seconds"), tokens.time("an end in seconds")
        else:
            first = last = tokens.time("a time in seconds")
        entries.append(Label(first, last, tokens.take("text", "a quoted label")))
    return Tier(
        name,
        tuple(entries),
        _KINDS[kind_name],
        None if start == file_start else start,
        None if end == file_end else end,
    )


def text(
    utterances: Sequence[Labels], path: str | os.PathLike[str], *, rate: float | None = None
) -> str:
    """The long form of a TextGrid; `path` and `rate` are not used.

    Raises
    ------
    DataError
        If there is not one utterance, or a label holds a carriage return or a zero byte.
    """
    labels = only_one(utterances, "TextGrid")
    lines = [
        'File type = "ooTextFile"',
        'Object class = "TextGrid"',
        "",
        f"xmin = {number_text(labels.start)} ",
        f"xmax = {number_text(labels.end)} ",
        "tiers? <exists> " if labels.tiers else "tiers? <absent> ",
    ]
    if labels.tiers:
        lines += [f"size = {len(labels.tiers)} ", "item []: "]
    for number, tier in enumerate(labels.tiers, start=1):
        refuse_characters((*tier.entries, Label(0, 0, tier.name)), "\r\0", "a TextGrid")
        interval = tier.kind == "interval"
        what = "intervals" if interval else "points"
        start = labels.start if tier.start is None else tier.start
        end = labels.end if tier.end is None else tier.end
        lines += [
            f"    item [{number}]:",
            f'        class = "{_CLASSES[tier.kind]}" ',
            f"        name = {_quoted(tier.name)} ",
            f"        xmin = {number_text(start)} ",
            f"        xmax = {number_text(end)} ",
            f"        {what}: size = {len(tier.entries)} ",
        ]
        for place, entry in enumerate(tier.entries, start=1):
            lines.append(f"        {what} [{place}]:")
            if interval:
                lines += [
                    f"            xmin = {number_text(entry.start)} ",
                    f"            xmax = {number_text(entry.end)} ",
                    f"            text = {_quoted(entry.text)} ",
                ]
            else:
                lines += [
                    f"            number = {number_text(entry.start)} ",
                    f"            mark = {_quoted(entry.text)} ",
                ]
    return "\n".join(lines) + "\n"


def _quoted(value: str) -> str:
    return '"' + value.replace('"', '""') + '"'
