"""Labels as a table: start, end, phone, and optional stress, word and more, one row a phone.

Every column after start and end is a tier, and all tiers have the same times. Tables with a row an
entry and a column for its tier are read too: those of the Montreal aligner (Begin, End, Label,
Type, Speaker) and of Praat (tmin, tier, text, tmax).
"""

from __future__ import annotations

import csv
import io
import os
import re
from collections.abc import Sequence
from pathlib import Path

from mocap_fit.errors import DataError, FileFormatError, shorten
from mocap_fit.labels.text import (
    LABEL_SIZE,
    format_number,
    get_only,
    parse_seconds,
    read_head_lines,
    read_label_text,
    refuse_characters,
)
from mocap_fit.labels.tiers import (
    PHONE_TIER_NAMES,
    WORD_TIER_NAMES,
    find_phone_tier,
    get_texts,
    warn_left_out,
)
from mocap_fit.labels.types import Label, Labels, Tier
from mocap_fit.size_limit import check_size

description = "table of start, end, phone, stress, word; table of an aligner or of Praat"
extensions = (".csv",)

_STARTS = ("start", "begin", "onset", "start_time", "tmin", "xmin")
_ENDS = ("end", "offset", "stop", "end_time", "tmax", "xmax")
# "start (s)", "end_s"; with any other unit it is no column of times.
_UNIT = re.compile(r"(?:[ _]?[(\[](?:s|sec|seconds)[)\]]|[ _](?:s|sec|seconds))$")
_TEXTS = ("label", "text")
# A column "type" may say anything of a phone; it names tiers where one of them is known.
_TIERS = ("tier", "type")
_DELIMITERS = (",", ";", "\t")


def _find_time_columns(names: Sequence[str]) -> tuple[int, int] | None:
    plain = [_UNIT.sub("", name.strip().casefold()).replace(" ", "_") for name in names]
    starts = [column for column, name in enumerate(plain) if name in _STARTS]
    ends = [column for column, name in enumerate(plain) if name in _ENDS]
    return (starts[0], ends[0]) if starts and ends else None


def _detect_delimiter(first_line: str) -> str | None:
    for delimiter in _DELIMITERS:
        names = next(csv.reader([first_line], delimiter=delimiter), [])
        if len(names) > 2 and _find_time_columns(names) is not None:
            return delimiter
    return None


def sniff(path: str | os.PathLike[str]) -> bool:
    """Return whether the first line names a start, an end and another column.

    Parameters
    ----------
    path
        The file.

    Returns
    -------
    bool
        Whether it looks like a table of labels.
    """
    lines = read_head_lines(path)
    try:
        return bool(lines) and _detect_delimiter(lines[0]) is not None
    except csv.Error:
        return False


def read(path: str | os.PathLike[str], *, rate: float | None = None) -> tuple[Labels, ...]:
    """Read a table of labels.

    Columns are separated by commas, semicolons or tabs; with the latter two, decimal commas are
    accepted.

    Parameters
    ----------
    path
        File to read.
    rate
        Sampling rate, hertz; not used.

    Returns
    -------
    tuple of Labels
        The only utterance of the file; the tiers of several speakers have their names.

    Raises
    ------
    FileFormatError
        If the columns are not named, or a row has too few or no times.
    """
    content = read_label_text(path)
    try:
        delimiter = _detect_delimiter(content.split("\n", 1)[0])
        if delimiter is None:
            raise FileFormatError(
                "the columns of the table are not named",
                path=path,
                line=1,
                found=f"'{shorten(content.split(chr(10), 1)[0])}'",
                expected="start,end,phone and optionally stress,word",
                advice="Add the line of names; times are seconds.",
            )
        # A cell becomes a label.
        cells = content.count(delimiter) + content.count("\n")
        check_size(cells * LABEL_SIZE // 2, path=path)
        rows = csv.reader(io.StringIO(content, newline=""), delimiter=delimiter)
        return (_parse_table(rows, delimiter, path),)
    except csv.Error as error:
        raise FileFormatError("this is not a table", path=path, found=error) from None


def _parse_table(
    rows: csv._reader,  # type: ignore[name-defined]
    delimiter: str,
    path: str | os.PathLike[str],
) -> Labels:
    names = next(rows)
    columns = _find_time_columns(names)
    assert columns is not None
    times: list[tuple[float, float]] = []
    cells: list[list[str]] = []
    for row in rows:
        line, count = rows.line_num, len(row)
        if not any(cell.strip() for cell in row):
            continue
        if count != len(names):
            problem = "the row has another number of columns than the first"
            raise FileFormatError(problem, path=path, line=line, found=count, expected=len(names))
        texts = [row[column] for column in columns]
        if delimiter != ",":
            texts = [text.replace(",", ".") for text in texts]
        start, end = (parse_seconds(text, path, line) for text in texts)
        times.append((start, end))
        cells.append(row)
    name = Path(path).stem
    parts = _find_parts(names, cells)
    if parts is None:
        tiers = [
            Tier(title.strip(), tuple(Label(*t, r[c]) for t, r in zip(times, cells, strict=True)))
            for c, title in enumerate(names)
            if c not in columns
        ]
        return _create_labels(tiers, name)
    text, tier, speaker = parts
    by_tier: dict[tuple[str, str], list[Label]] = {}
    for pair, row in zip(times, cells, strict=True):
        key = ("" if speaker is None else row[speaker].strip(), row[tier].strip())
        by_tier.setdefault(key, []).append(Label(*pair, row[text]))
    # Named as in the TextGrids of the same aligner.
    several = len({one for one, _ in by_tier}) > 1
    tiers = [
        Tier(f"{one} - {title}" if several else title, tuple(entries))
        for (one, title), entries in by_tier.items()
    ]
    return _create_labels(tiers, name)


def _find_parts(
    names: Sequence[str], cells: Sequence[Sequence[str]]
) -> tuple[int, int, int | None] | None:
    """Return the columns of text, tier and speaker in a table with a row an entry."""
    plain = [name.strip().casefold() for name in names]
    texts = [plain.index(name) for name in _TEXTS if name in plain]
    tiers = [plain.index(name) for name in _TIERS if name in plain]
    if not texts or not tiers:
        return None
    speaker = plain.index("speaker") if "speaker" in plain else None
    types = {row[tiers[0]].strip().casefold() for row in cells}
    is_known = speaker is not None or types & (PHONE_TIER_NAMES | WORD_TIER_NAMES)
    return (texts[0], tiers[0], speaker) if is_known or plain[tiers[0]] == "tier" else None


def _create_labels(tiers: Sequence[Tier], name: str) -> Labels:
    end = max((entry.end for tier in tiers for entry in tier.entries), default=0.0)
    return Labels(tuple(tiers), 0.0, end, name=name)


def to_text(
    utterances: Sequence[Labels], path: str | os.PathLike[str], *, rate: float | None = None
) -> str:
    """Return the table, one row a phone.

    A tier with other times than the phones has in each row its text at the centre of the phone.

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
        If two tiers have one name, or one has that of a time.
    """
    labels = get_only(utterances, "CSV")
    phones = find_phone_tier(labels)
    tiers = [tier for tier in labels.tiers if tier.kind == "interval"]
    warn_left_out(labels, tiers, "a table of phones")
    names = ["start", "end", *(tier.name for tier in tiers)]
    plain = [name.strip().casefold() for name in names]
    twice = [n for n in plain[2:] if plain.count(n) > 1 or n in _STARTS + _ENDS]
    if twice:
        raise DataError(
            "two columns of the table would have one name",
            found=", ".join(sorted(set(twice))),
            advice="Rename that tier.",
        )
    times = [(entry.start, entry.end) for entry in phones.entries]
    columns = []
    for tier in tiers:
        refuse_characters((*tier.entries, Label(0, 0, tier.name)), "\r\0", "CSV")
        if [(entry.start, entry.end) for entry in tier.entries] == times:
            columns.append([entry.text for entry in tier.entries])
        else:
            columns.append(get_texts(tier, [0.5 * (start + end) for start, end in times]))
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(names)
    for (start, end), *cells in zip(times, *columns, strict=True):
        writer.writerow([format_number(start), format_number(end), *cells])
    return stream.getvalue()
