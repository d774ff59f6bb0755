"""Labels of HTK: one utterance in a .lab or .rec, many in a master label file (.mlf).

A line is ``start end name [score] {name [score]}``, its times in units of 100 ns. The further
names are those of higher levels, such as words, each at the first phone of its own.
"""

from __future__ import annotations

import bisect
import os
import re
from collections.abc import Sequence
from pathlib import PurePosixPath

from mocap_fit.errors import DataError, FileFormatError
from mocap_fit.labels.readers import Label, Labels, Tier
from mocap_fit.labels.text import (
    head_lines,
    label_text,
    only_one,
    refuse_characters,
    units,
    utterance_name,
)
from mocap_fit.labels.tiers import find_phone_tier, warn_left_out

description = "HTK .lab, times in 100 ns"
extensions = (".lab", ".rec")

RATE = 1e7
"""Units of time per second."""
NO_NAME = "!NULL"
"""What ends a word without beginning another."""

_NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
_TIMES = re.compile(r"-?\d{1,18}[ \t]+-?\d{1,18}[ \t]+\S.*")
_TOKEN = re.compile(r"[ \t]*(?:\"((?:[^\"\\]|\\.)*)\"|'((?:[^'\\]|\\.)*)'|((?:[^ \t\\]|\\.)+))")
_ESCAPE = re.compile(r"\\([0-7]{3}|.)")

# Start and end in units, then name and score of every level.
Row = tuple[int, int, list[tuple[str, str]]]


def sniff(path: str | os.PathLike[str]) -> bool:
    """Whether lines begin with two whole numbers and a name."""
    lines = [line.strip() for line in head_lines(path) if line.strip()]
    return bool(lines) and all(_TIMES.fullmatch(line) for line in lines[:20])


def read(path: str | os.PathLike[str], *, rate: float | None = None) -> tuple[Labels, ...]:
    """Read a .lab of one utterance; `rate` is not used.

    Raises
    ------
    FileFormatError
        If a line is not two times and a name.
    """
    lines = enumerate(label_text(path).split("\n"), start=1)
    rows = [parsed_row(line, number, path) for number, line in lines if line.strip()]
    return (utterance(rows, utterance_name(path)),)


def text(
    utterances: Sequence[Labels], path: str | os.PathLike[str], *, rate: float | None = None
) -> str:
    """The file's text, phones with the words above them; `path` and `rate` are not used.

    Raises
    ------
    DataError
        If there is not one utterance, or a label holds the end of a line.
    """
    return rows_text(only_one(utterances, "HTK .lab"))


def _unescaped(name: str) -> str:
    # HTK writes a byte above 127 as a backslash and three octal digits.
    content = b""
    position = 0
    for match in _ESCAPE.finditer(name):
        content += name[position : match.start()].encode("utf-8", "surrogatepass")
        code = match[1]
        content += bytes([int(code, 8) & 255]) if len(code) == 3 else code.encode("utf-8")
        position = match.end()
    content += name[position:].encode("utf-8", "surrogatepass")
    try:
        return content.decode("utf-8")
    except UnicodeDecodeError:
        return content.decode("latin-1")


def parsed_row(line: str, number: int, path: str | os.PathLike[str]) -> Row:
    """A line of labels: start and end in units, and name and score of every level.

    Raises
    ------
    FileFormatError
        If it is none.
    """
    found: list[tuple[str, bool]] = []
    position, line = 0, line.strip(" \t")
    while position < len(line):
        match = _TOKEN.match(line, position)
        if match is None:
            raise _bad_row(line, number, path)
        quoted = match[1] if match[1] is not None else match[2]
        found.append((_unescaped(match[3] if quoted is None else quoted), quoted is None))
        position = match.end()
    times = [token for token, plain in found[:2] if plain and re.fullmatch(r"-?\d{1,18}", token)]
    if len(times) < 2 or len(found) < 3:
        raise _bad_row(line, number, path)
    levels: list[tuple[str, str]] = []
    for token, plain in found[2:]:
        if plain and _NUMBER.fullmatch(token) and levels and not levels[-1][1]:
            levels[-1] = (levels[-1][0], token)
        else:
            levels.append((token, ""))
    return int(times[0]), int(times[1]), levels


def _bad_row(line: str, number: int, path: str | os.PathLike[str]) -> FileFormatError:
    return FileFormatError(
        "this is no label of HTK with times",
        path=path,
        line=number,
        found=f"'{line}'",
        expected="start and end in whole units of 100 ns, then a name",
        advice="Labels without times are a transcript: align them with mocap-fit align.",
    )


def utterance(rows: Sequence[Row], name: str) -> Labels:
    """The labels of an utterance from its lines."""
    levels = max((len(row[2]) for row in rows), default=1)
    tiers = []
    for level in range(levels):
        entries: list[Label] = []
        named = False
        for first, last, names in rows:
            if level < len(names):
                symbol, score = names[level]
                named = level == 0 or symbol != NO_NAME
                if named:
                    extra = f"score={score}" if score else ""
                    entries.append(Label(first / RATE, last / RATE, symbol, extra))
            elif named:
                before = entries[-1]
                entries[-1] = Label(before.start, last / RATE, before.text, before.extra)
        tiers.append(
            Tier(("phone", "word")[level] if level < 2 else f"level {level + 1}", tuple(entries))
        )
    end = max((last for _, last, _ in rows), default=0) / RATE
    return Labels(tuple(tiers), 0.0, end, name=name)


def _written(entry: Label) -> str:
    name = entry.text.replace("\\", "\\\\")
    plain = name and not any(c.isspace() for c in name) and name[0] not in "\"'"
    if not plain or _NUMBER.fullmatch(name):
        name = '"' + name.replace('"', '\\"') + '"'
    score = entry.extra.removeprefix("score=") if entry.extra.startswith("score=") else ""
    return f"{name} {score}" if score else name


def _rows_with(tiers: Sequence[Tier]) -> list[tuple[int, int, list[str]]]:
    """Lines of some tiers, the lowest first: what begins at each phone, level by level."""
    held: list[int | None] = [None] * len(tiers)
    begins = [
        sorted((units(entry.start, RATE), place) for place, entry in enumerate(tier.entries))
        for tier in tiers
    ]
    rows = []
    for entry in tiers[0].entries:
        first, last = units(entry.start, RATE), units(entry.end, RATE)
        names = [_written(entry)]
        waiting: list[str] = []
        for level, tier in enumerate(tiers[1:], start=1):
            nearest = bisect.bisect_right(begins[level], (first, len(tier.entries))) - 1
            place = begins[level][nearest][1] if nearest >= 0 else None
            if place is not None and units(tier.entries[place].end, RATE) < last:
                place = None
            waiting.append(NO_NAME if place is None else _written(tier.entries[place]))
            if place != held[level]:
                names += waiting
                waiting = []
            held[level] = place
        rows.append((first, last, names))
    return rows


def rows_text(labels: Labels) -> str:
    """The lines of an utterance: phones, and above them every tier whose labels begin with them.

    Raises
    ------
    DataError
        If a label holds the end of a line.

    Warns
    -----
    MocapFitWarning
        If tiers cannot be written above the phones; they are left out.
    """
    phones = find_phone_tier(labels)
    chosen = [phones]
    for tier in labels.tiers:
        if tier is phones or tier.kind == "point":
            continue
        # Only what reads back as it was is written.
        trial = _joined(_rows_with([*chosen, tier]))
        read_back = utterance([parsed_row(line, 0, "") for line in trial], "").tiers
        same = len(read_back) == len(chosen) + 1 and all(
            _in_units(one) == _in_units(other)
            for one, other in zip(read_back, [*chosen, tier], strict=True)
        )
        if same:
            chosen.append(tier)
    warn_left_out(labels, chosen, "an HTK label file")
    for tier in chosen:
        refuse_characters(tier.entries, "\n\r\0", "HTK")
    return "".join(line + "\n" for line in _joined(_rows_with(chosen)))


def _joined(rows: Sequence[tuple[int, int, list[str]]]) -> list[str]:
    return [f"{first} {last} {' '.join(names)}" for first, last, names in rows]


def _in_units(tier: Tier) -> list[tuple[int, int, str]]:
    return [(units(e.start, RATE), units(e.end, RATE), e.text) for e in tier.entries]


def utterance_of_pattern(pattern: str) -> str:
    """The utterance that a name in a .mlf stands for: ``*/take_01.lab`` is ``take_01``."""
    return PurePosixPath(pattern.replace("\\", "/")).stem


def name_error(path: str | os.PathLike[str], name: str) -> DataError:
    """The error for an utterance whose name a .mlf cannot say."""
    return DataError(
        "a .mlf needs a name for every utterance, each once",
        path=path,
        found=repr(name),
        advice="Name it without slashes, quotes and ends of lines.",
    )
