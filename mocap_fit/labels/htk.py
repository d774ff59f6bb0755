"""Labels of HTK: one utterance in a .lab or .rec, many in a master label file (.mlf).

A line is ``start end name [score] {name [score]}``, its times in units of 100 ns. The further
names are those of higher levels, such as words, each at its first phone. Of names with their
contexts, as HTK and HTS write them, the phone in the middle is read; see `htk_names`.
"""

from __future__ import annotations

import bisect
import os
import re
import warnings
from collections.abc import Sequence
from pathlib import Path

from mocap_fit.errors import FileFormatError, MocapFitWarning, shorten
from mocap_fit.labels.htk_names import extract_centres, has_states, merge_states
from mocap_fit.labels.text import (
    get_only,
    parse_seconds,
    read_head_lines,
    read_label_lines,
    refuse_characters,
    to_units,
)
from mocap_fit.labels.tiers import find_phone_tier, warn_left_out
from mocap_fit.labels.types import Label, Labels, Tier

description = "HTK or HTS .lab, times in 100 ns; of names in context the centre phone"
extensions = (".lab", ".rec")

RATE = 1e7
"""Units of time per second."""
NO_NAME = "!NULL"
"""Name that ends a word without beginning another."""

# Levels of names that HTK writes: states, models, words, and some more. More is a transcript.
_MOST_LEVELS = 8
_SHORTEST_UTTERANCE = 0.01

_NUMBER = re.compile(r"[-+]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][-+]?\d+)?")
_TIME = re.compile(r"-?[0-9]{1,18}")
_TIMES = re.compile(r"-?[0-9]{1,18}[ \t]++-?[0-9]{1,18}[ \t]++\S.*+")
_TOKEN = re.compile(r"[ \t]*+(?:\"((?:[^\"\\]|\\.)*+)\"|'((?:[^'\\]|\\.)*+)'|((?:[^ \t\\]|\\.)++))")
_ESCAPE = re.compile(rb"\\([0-7]{3}|.)")

# Start and end in units, then name and score of every level.
Row = tuple[int, int, list[tuple[str, str]]]


def sniff(path: str | os.PathLike[str]) -> bool:
    """Return whether lines begin with two integers and a name.

    Parameters
    ----------
    path
        The file.

    Returns
    -------
    bool
        Whether it looks like an HTK label file.
    """
    lines = [line.strip() for line in read_head_lines(path) if line.strip()]
    return bool(lines) and all(_TIMES.fullmatch(line) for line in lines[:20])


def read(path: str | os.PathLike[str], *, rate: float | None = None) -> tuple[Labels, ...]:
    """Read a .lab of one utterance.

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
        If a line is not two times and a name.

    Warns
    -----
    MocapFitWarning
        If the labels last less than a hundredth of a second in units of 100 ns.
    """
    lines = enumerate(read_label_lines(path), start=1)
    rows = [parse_row(line, number, path) for number, line in lines if line.strip()]
    utterances = (build_utterance(rows, Path(path).stem),)
    warn_of_units(utterances, path)
    return utterances


def to_text(
    utterances: Sequence[Labels], path: str | os.PathLike[str], *, rate: float | None = None
) -> str:
    """Return the content of a .lab: phones with the words of their first phones.

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
        If there is not one utterance, or a label holds the end of a line.
    """
    return format_rows(get_only(utterances, "HTK .lab"))


def _unescape(name: str) -> str:
    # HTK writes a byte above 127 as a backslash and three octal digits.
    content = _ESCAPE.sub(
        lambda match: bytes([int(match[1], 8) & 255]) if len(match[1]) == 3 else match[1],
        name.encode("utf-8", "surrogatepass"),
    )
    try:
        return content.decode("utf-8")
    except UnicodeDecodeError:
        return content.decode("latin-1")


def parse_row(line: str, number: int, path: str | os.PathLike[str]) -> Row:
    """Parse a line of labels.

    Parameters
    ----------
    line
        Text of the line.
    number
        Number of the line for the message.
    path
        File for the message.

    Returns
    -------
    tuple
        Start and end in units of 100 ns, and name and score of every level.

    Raises
    ------
    FileFormatError
        If the line is not two times and a name.
    """
    tokens: list[tuple[str, bool]] = []
    position, line = 0, line.strip(" \t")
    while position < len(line):
        match = _TOKEN.match(line, position)
        if match is None:
            raise _create_row_error(line, number, path)
        quoted = match[1] if match[1] is not None else match[2]
        tokens.append((_unescape(match[3] if quoted is None else quoted), quoted is None))
        position = match.end()
    times = [token for token, plain in tokens[:2] if plain and _TIME.fullmatch(token)]
    if len(times) < 2 or len(tokens) < 3:
        raise _create_row_error(line, number, path)
    for token in times:
        parse_seconds(token, path, number, RATE)
    levels: list[tuple[str, str]] = []
    for token, plain in tokens[2:]:
        if plain and _NUMBER.fullmatch(token) and levels and not levels[-1][1]:
            levels[-1] = (levels[-1][0], token)
        else:
            levels.append((token, ""))
    if len(levels) > _MOST_LEVELS:
        raise FileFormatError(
            "the line holds too many names",
            path=path,
            line=number,
            found=f"{len(levels)}: {line}",
            expected=f"at most {_MOST_LEVELS}: a phone and the words above it",
            advice="A sentence with its times is a transcript: align it with mocap-fit align.",
        )
    return int(times[0]), int(times[1]), levels


def _create_row_error(line: str, number: int, path: str | os.PathLike[str]) -> FileFormatError:
    return FileFormatError(
        "this is not a label of HTK with times",
        path=path,
        line=number,
        found=f"'{shorten(line)}'",
        expected="start and end in units of 100 ns, then a name",
        advice="Labels without times are a transcript: align them with mocap-fit align.",
    )


def build_utterance(rows: Sequence[Row], name: str) -> Labels:
    """Build the labels of an utterance from its lines.

    Parameters
    ----------
    rows
        Lines of the utterance.
    name
        Name of the utterance.

    Returns
    -------
    Labels
        A tier for each level.
    """
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
        tiers.append(entries)
    end = max((last for _, last, _ in rows), default=0) / RATE
    states = levels > 1 and has_states(tiers[0])
    titles = (["state"] if states else []) + ["phone", "word"]
    titles += [f"level {level + 1}" for level in range(len(titles), levels)]
    phones = int(states)
    tiers[phones] = merge_states(tiers[phones])
    tiers[phones] = extract_centres(tiers[phones])
    pairs = zip(titles, tiers, strict=False)
    return Labels(tuple(Tier(title, tuple(tier)) for title, tier in pairs), 0.0, end, name=name)


def warn_of_units(utterances: Sequence[Labels], path: str | os.PathLike[str]) -> None:
    """Warn where the times are hardly in units of 100 ns, but samples or seconds.

    Parameters
    ----------
    utterances
        All utterances of a file.
    path
        The file.

    Warns
    -----
    MocapFitWarning
        If none lasts a hundredth of a second.
    """
    longest = max((labels.end for labels in utterances), default=0.0)
    if 0 < longest < _SHORTEST_UTTERANCE:
        warnings.warn(
            f"{os.fspath(path)} lasts {1000 * longest:g} ms in HTK's units of 100 ns. If its times "
            "are samples or seconds, name the format (reader='timit' with a rate, or "
            "reader='seconds-lab').",
            MocapFitWarning,
            stacklevel=4,
        )


def _format_entry(entry: Label) -> str:
    name = entry.text.replace("\\", "\\\\")
    plain = name and not any(c.isspace() for c in name) and name[0] not in "\"'"
    if not plain or _NUMBER.fullmatch(name):
        name = '"' + name.replace('"', '\\"') + '"'
    score = entry.extra.removeprefix("score=") if entry.extra.startswith("score=") else ""
    return f"{name} {score}" if score else name


def _build_rows(tiers: Sequence[Tier]) -> list[tuple[int, int, list[str]]]:
    """Return lines of some tiers, phones first: the names that begin at each phone."""
    current: list[int | None] = [None] * len(tiers)
    begins = [
        sorted((to_units(entry.start, RATE), index) for index, entry in enumerate(tier.entries))
        for tier in tiers
    ]
    rows = []
    for entry in tiers[0].entries:
        first, last = to_units(entry.start, RATE), to_units(entry.end, RATE)
        names = [_format_entry(entry)]
        waiting: list[str] = []
        for level, tier in enumerate(tiers[1:], start=1):
            nearest = bisect.bisect_right(begins[level], (first, len(tier.entries))) - 1
            index = begins[level][nearest][1] if nearest >= 0 else None
            if index is not None and to_units(tier.entries[index].end, RATE) < last:
                index = None
            waiting.append(NO_NAME if index is None else _format_entry(tier.entries[index]))
            if index != current[level]:
                names += waiting
                waiting = []
            current[level] = index
        rows.append((first, last, names))
    return rows


def format_rows(labels: Labels) -> str:
    """Return the lines of an utterance: phones, and all tiers whose labels begin with them.

    Parameters
    ----------
    labels
        Labels to write.

    Returns
    -------
    str
        The lines.

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
        # Only tiers that read back unchanged are written.
        trial = _format_lines(_build_rows([*chosen, tier]))
        read_back = build_utterance([parse_row(line, 0, "") for line in trial], "").tiers
        if [*map(_to_unit_entries, read_back)] == [*map(_to_unit_entries, [*chosen, tier])]:
            chosen.append(tier)
    warn_left_out(labels, chosen, "an HTK label file")
    for tier in chosen:
        refuse_characters(tier.entries, "\n\r\0", "HTK")
    return "".join(line + "\n" for line in _format_lines(_build_rows(chosen)))


def _format_lines(rows: Sequence[tuple[int, int, list[str]]]) -> list[str]:
    return [f"{first} {last} {' '.join(names)}" for first, last, names in rows]


def _to_unit_entries(tier: Tier) -> list[tuple[int, int, str]]:
    return [(to_units(e.start, RATE), to_units(e.end, RATE), e.text) for e in tier.entries]
