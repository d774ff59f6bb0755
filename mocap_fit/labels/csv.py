"""Labels as a table: start, end, phone, and perhaps stress, word and more, one row a phone.

Every column after start and end is a tier, and all tiers have the same times.
"""

from __future__ import annotations

import csv
import io
import os
from collections.abc import Sequence

from mocap_fit.errors import DataError, FileFormatError
from mocap_fit.labels.readers import Label, Labels, Tier
from mocap_fit.labels.text import (
    head_lines,
    label_text,
    number_text,
    only_one,
    refuse_characters,
    seconds,
    utterance_name,
)
from mocap_fit.labels.tiers import find_phone_tier, text_at, warn_left_out

description = "table of start, end, phone, stress, word"
extensions = (".csv",)

_STARTS = ("start", "begin", "onset", "start_time", "tmin", "xmin")
_ENDS = ("end", "offset", "stop", "end_time", "tmax", "xmax")
_DELIMITERS = (",", ";", "\t")


def _time_columns(names: Sequence[str]) -> tuple[int, int] | None:
    plain = [name.strip().casefold() for name in names]
    starts = [place for place, name in enumerate(plain) if name in _STARTS]
    ends = [place for place, name in enumerate(plain) if name in _ENDS]
    return (starts[0], ends[0]) if starts and ends else None


def _delimiter(first_line: str) -> str | None:
    for delimiter in _DELIMITERS:
        names = next(csv.reader([first_line], delimiter=delimiter), [])
        if len(names) > 2 and _time_columns(names) is not None:
            return delimiter
    return None


def sniff(path: str | os.PathLike[str]) -> bool:
    """Whether the first line names a start, an end and something more."""
    lines = head_lines(path)
    try:
        return bool(lines) and _delimiter(lines[0]) is not None
    except csv.Error:
        return False


def read(path: str | os.PathLike[str], *, rate: float | None = None) -> tuple[Labels, ...]:
    """Read a table of labels; `rate` is not used.

    Columns are parted by commas, semicolons or tabs; with the latter two, a decimal comma is
    understood.

    Raises
    ------
    FileFormatError
        If the columns are not named, or a row has too few or no times.
    """
    content = label_text(path)
    try:
        delimiter = _delimiter(content.split("\n", 1)[0])
        if delimiter is None:
            raise FileFormatError(
                "the columns of the table are not named",
                path=path,
                line=1,
                found=f"'{content.split(chr(10), 1)[0]}'",
                expected="start,end,phone and perhaps stress,word",
                advice="Add the line of names; times are seconds.",
            )
        return (_table(csv.reader(io.StringIO(content), delimiter=delimiter), delimiter, path),)
    except csv.Error as error:
        raise FileFormatError("this is not a table", path=path, found=error) from None


def _table(rows: csv._reader, delimiter: str, path: str | os.PathLike[str]) -> Labels:  # type: ignore[name-defined]
    names = next(rows)
    columns = _time_columns(names)
    assert columns is not None
    others = [place for place in range(len(names)) if place not in columns]
    entries: list[list[Label]] = [[] for _ in others]
    for row in rows:
        if not any(cell.strip() for cell in row):
            continue
        if len(row) != len(names):
            raise FileFormatError(
                "the row has another number of columns than the first",
                path=path,
                line=rows.line_num,
                found=len(row),
                expected=len(names),
            )
        times = [row[place] for place in columns]
        if delimiter != ",":
            times = [time.replace(",", ".") for time in times]
        start, end = (seconds(time, path, rows.line_num) for time in times)
        for tier, place in zip(entries, others, strict=True):
            tier.append(Label(start, end, row[place]))
    tiers = [
        Tier(names[place].strip(), tuple(tier)) for place, tier in zip(others, entries, strict=True)
    ]
    end = max((entry.end for tier in tiers for entry in tier.entries), default=0.0)
    return Labels(tuple(tiers), 0.0, end, name=utterance_name(path))


def text(
    utterances: Sequence[Labels], path: str | os.PathLike[str], *, rate: float | None = None
) -> str:
    """The table's text, one row a phone; `path` and `rate` are not used.

    A tier with other times than the phones says in each row what it holds at the phone's centre.

    Raises
    ------
    DataError
        If two tiers have one name, or one has that of a time.
    """
    labels = only_one(utterances, "CSV")
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
            columns.append(text_at(tier, [0.5 * (start + end) for start, end in times]))
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(names)
    for (start, end), *cells in zip(times, *columns, strict=True):
        writer.writerow([number_text(start), number_text(end), *cells])
    return stream.getvalue()
