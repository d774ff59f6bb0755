"""Praat TextGrids, read and written without a change.

Long, short, chronological and binary ones are read, long ones are written. As in Praat itself,
only free-standing numbers, quoted strings and flags such as <exists> count; the names and signs
around them are for people. So the long and the short form are read alike.
praatio is not used to read, because it strips spaces from labels and looks for its keywords within
them too; the tests compare with it.
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Sequence
from pathlib import Path

from mocap_fit.errors import FileFormatError, MocapFitWarning, shorten
from mocap_fit.io.text import read_head
from mocap_fit.labels.praat_tokens import Tokens
from mocap_fit.labels.text import (
    LABEL_SIZE,
    format_number,
    get_only,
    read_head_lines,
    read_label_bytes,
    read_label_text,
    refuse_characters,
)
from mocap_fit.labels.textgrid_binary import SIGNATURE, check_class, read_binary
from mocap_fit.labels.types import Label, Labels, Tier, TierKind
from mocap_fit.size_limit import check_size

description = "Praat TextGrid: long, short, chronological or binary"
extensions = (".textgrid",)

_CLASSES: dict[str, TierKind] = {"IntervalTier": "interval", "TextTier": "point"}
_NAMES = {kind: name for name, kind in _CLASSES.items()}
# Tiers of wrong size that a warning shows.
_SHOWN = 5
# Kind, name, start and end of a tier.
_Head = tuple[TierKind, str, float, float]
_CHRONOLOGICAL = "Praat chronological TextGrid text file"


def sniff(path: str | os.PathLike[str]) -> bool:
    """Return whether the first lines are those of an object of Praat.

    Its other objects are refused by `read`, which says what they are.

    Parameters
    ----------
    path
        The file.

    Returns
    -------
    bool
        Whether it looks like a TextGrid.
    """
    if read_head(path, len(SIGNATURE)) == SIGNATURE:
        return True
    head = "\n".join(read_head_lines(path, 1024)[:4])
    return '"ooTextFile' in head or head.startswith(f'"{_CHRONOLOGICAL}"')


def read(path: str | os.PathLike[str], *, rate: float | None = None) -> tuple[Labels, ...]:
    """Read a TextGrid.

    All that follows is read, whatever number of tiers and entries the file announces.

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

    Warns
    -----
    MocapFitWarning
        If another number of tiers or entries follows than is announced.
    """
    if read_head(path, len(SIGNATURE)) == SIGNATURE:
        start, end, tiers = read_binary(read_label_bytes(path), path)
    else:
        text = read_label_text(path)
        check_size(text.count('"') // 2 * LABEL_SIZE, path=path)
        tokens = Tokens(text, path)
        tag = tokens.take("text", 'File type = "ooTextFile"')
        if tag == _CHRONOLOGICAL:
            start, end, tiers = _read_chronological(tokens)
        elif tag.startswith("ooTextFile"):
            check_class(tokens.take("text", 'Object class = "TextGrid"'), path)
            start, end, tiers = _read_tiers(tokens)
        else:
            raise FileFormatError(
                "this is not a TextGrid",
                path=path,
                line=1,
                found=f"'{shorten(tag, 40)}'",
                expected='File type = "ooTextFile"',
            )
    return (Labels(tiers, start, end, name=Path(path).stem),)


def _read_tiers(tokens: Tokens) -> tuple[float, float, tuple[Tier, ...]]:
    start, end = tokens.take_time("the start in seconds"), tokens.take_time("the end in seconds")
    announced = 0
    if tokens.take("flag", "<exists> or <absent>") == "<exists>":
        announced = tokens.take_count("the number of tiers")
    tiers: list[Tier] = []
    wrong: list[str] = []
    while tokens.kind == "text" or len(tiers) < announced:
        tiers.append(_read_tier(tokens, start, end, wrong))
    if len(tiers) > announced:
        wrong.append(f"{announced} tiers are announced, {len(tiers)} follow")
    if wrong:
        warnings.warn(
            f"{os.fspath(tokens.path)} announces other sizes than it has, and all that follows was "
            f"read: {'; '.join(wrong[:_SHOWN])}{'; …' if len(wrong) > _SHOWN else ''}",
            MocapFitWarning,
            stacklevel=2,
        )
    return start, end, tuple(tiers)


def _take_tier_head(tokens: Tokens) -> _Head:
    if tokens.kind == "text" and tokens.value not in _CLASSES:
        value = f"'{shorten(tokens.value, 40)}'"
        raise tokens.create_error("unknown class of tier", value, " or ".join(_CLASSES))
    kind = _CLASSES[tokens.take("text", '"IntervalTier" or "TextTier"')]
    name = tokens.take("text", "the tier's name")
    return kind, name, tokens.take_time("the tier's start"), tokens.take_time("the tier's end")


def _take_entry(tokens: Tokens, kind: TierKind, where: str) -> Label:
    first = last = tokens.take_time(f"a time in seconds ({where})")
    if kind == "interval":
        last = tokens.take_time(f"an end in seconds ({where})")
    return Label(first, last, tokens.take("text", f"a quoted label ({where})"))


def _create_tier(head: _Head, entries: list[Label], file: tuple[float, float]) -> Tier:
    kind, name, *ends = head
    start, end = (None if time == other else time for time, other in zip(ends, file, strict=True))
    return Tier(name, tuple(entries), kind, start, end)


def _read_tier(tokens: Tokens, file_start: float, file_end: float, wrong: list[str]) -> Tier:
    kind, name, start, end = _take_tier_head(tokens)
    announced = tokens.take_count("the number of entries")
    entries: list[Label] = []
    shown = shorten(name, 40)
    while tokens.kind == "number":
        entries.append(_take_entry(tokens, kind, f"entry {len(entries) + 1} of tier '{shown}'"))
    if len(entries) != announced:
        text = f"tier '{shown}' announces {announced} {kind}s, {len(entries)} follow"
        last = max((entry.end for entry in entries), default=start)
        if tokens.kind == "end" and kind == "interval" and len(entries) < announced and last < end:
            value = f"{text}, up to {last:g} s"
            raise tokens.create_error("the file ends too early", value, f"labels up to {end:g} s")
        wrong.append(text)
    return _create_tier((kind, name, start, end), entries, (file_start, file_end))


def _read_chronological(tokens: Tokens) -> tuple[float, float, tuple[Tier, ...]]:
    file = tokens.take_time("the start in seconds"), tokens.take_time("the end in seconds")
    count = tokens.take_count("the number of tiers")
    heads: list[_Head] = []
    while len(heads) < count:
        heads.append(_take_tier_head(tokens))
    entries: list[list[Label]] = [[] for _ in heads]
    indices = {str(index + 1): index for index in range(len(heads))}
    while tokens.kind != "end":
        number = tokens.value
        index = indices.get(number, -1)
        if tokens.kind != "number" or index < 0:
            value = f"'{shorten(number, 40)}'"
            raise tokens.create_error("there is no such tier", value, f"a number up to {count}")
        tokens.advance()
        where = f"entry {len(entries[index]) + 1} of tier {number}"
        entries[index].append(_take_entry(tokens, heads[index][0], where))
    pairs = zip(heads, entries, strict=True)
    tiers = (_create_tier(head, labels, file) for head, labels in pairs)
    return *file, tuple(tiers)


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
            f'        class = "{_NAMES[tier.kind]}" ',
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
