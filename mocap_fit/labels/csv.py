"""Labels as a table: start, end, phone, and optional stress, word and more, one row a phone.

Every column after start and end is a tier, and all tiers have the same times.
"""

from __future__ import annotations

import csv
import io
import os
from collections.abc import Sequence
from pathlib import Path

from mocap_fit.errors import DataError, FileFormatError
from mocap_fit.labels.text import (
    format_number,
    get_only,
    parse_seconds,
    read_head_lines,
    read_label_text,
    refuse_characters,
)
from mocap_fit.labels.tiers import find_phone_tier, get_texts, warn_left_out
from mocap_fit.labels.types import Label, Labels, Tier

description = "table of start, end, phone, stress, word"
extensions = (".csv",)

_STARTS = ("start", "begin", "onset", "start_time", "tmin", "xmin")
_ENDS = ("end", "offset", "stop", "end_time", "tmax", "xmax")
_DELIMITERS = (",", ";", "\t")


def _find_time_columns(names: Sequence[str]) -> tuple[int, int] | None:
    plain = [name.strip().casefold() for name in names]
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
        The only utterance of the file.

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
                found=f"'{content.split(chr(10), 1)[0]}'",
                expected="start,end,phone and optionally stress,word",
                advice="Add the line of names; times are seconds.",
            )
        return (
            _parse_table(csv.reader(io.StringIO(content), delimiter=delimiter), delimiter, path),
        )
    except csv.Error as error:
        raise FileFormatError("this is not a table", path=path, found=error) from None


def _parse_table(rows: csv._reader, delimiter: str, path: str | os.PathLike[str]) -> Labels:  # type: ignore[name-defined]
    names = next(rows)
    columns = _find_time_columns(names)
    assert columns is not None
    others = [column for column in range(len(names)) if column not in columns]
    entries: list[list[Label]] = [[] for _ in others]
    for row in rows:
        line, count = rows.line_num, len(row)
        if not any(cell.strip() for cell in row):
            continue
        if count != len(names):
            problem = "the row has another number of columns than the first"
            raise FileFormatError(problem, path=path, line=line, found=count, expected=len(names))
        times = [row[column] for column in columns]
        if delimiter != ",":
            times = [time.replace(",", ".") for time in times]
        start, end = (parse_seconds(time, path, line) for time in times)
        for tier, column in zip(entries, others, strict=True):
            tier.append(Label(start, end, row[column]))
    pairs = zip(others, entries, strict=True)
    tiers = [Tier(names[column].strip(), tuple(tier)) for column, tier in pairs]
    end = max((entry.end for tier in tiers for entry in tier.entries), default=0.0)
    return Labels(tuple(tiers), 0.0, end, name=Path(path).stem)


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
