"""Labels in seconds, one a line: start, end and text. So Audacity exports its label tracks.

Times and text are separated by blanks or tabs. Audacity's lines of frequencies, which begin with a
backslash, are not read; labels that all end where they start are moments.
"""

from __future__ import annotations

import math
import os
import re
from collections.abc import Sequence
from pathlib import Path

from mocap_fit.errors import FileFormatError, shorten
from mocap_fit.labels.text import (
    create_line_error,
    format_number,
    get_only,
    parse_seconds,
    read_head_lines,
    read_label_lines,
    refuse_characters,
)
from mocap_fit.labels.tiers import find_phone_tier, warn_left_out
from mocap_fit.labels.types import Label, Labels, Tier

description = "start, end and label in seconds, one a line; Audacity's label tracks"
extensions = (".lab",)

_NUMBER = r"([-+]?(?:[0-9]+(?:[.,][0-9]*)?|[.,][0-9]+)(?:[eE][-+]?[0-9]+)?)"
_LINE = re.compile(rf"{_NUMBER}[ \t]++{_NUMBER}(?:[ \t]++(.*+))?")
_ONE_TIME = re.compile(rf"{_NUMBER}[ \t]++\S.*+")
# A table of numbers has these in place of a label.
_NUMBERS = re.compile(rf"[0-9]*[.,][0-9]+|{_NUMBER}(?:[ \t]++{_NUMBER})++")
# Audacity's frequencies, and comments.
_NO_LABEL = ("\\", "#", ";")
# The first lines, of which all must be labels.
_SNIFFED = 20


def sniff(path: str | os.PathLike[str]) -> bool:
    """Return whether lines begin with a start and an end in seconds.

    At least one time is not a whole number: those of HTK and TIMIT all are. Lines of one time are
    taken too, so that `read` says what is missing.

    Parameters
    ----------
    path
        The file.

    Returns
    -------
    bool
        Whether it looks like labels in seconds.
    """
    lines = [line.strip() for line in read_head_lines(path)]
    lines = [line for line in lines if line and not line.startswith(_NO_LABEL)][:_SNIFFED]
    matches = [_LINE.fullmatch(line) or _ONE_TIME.fullmatch(line) for line in lines]
    times = [_get_times(match) for match in matches if match is not None]
    return (
        bool(lines)
        and len(times) == len(lines)
        and any(not time.is_integer() for pair in times for time in pair)
        and all(map(_is_label, lines, times))
    )


def _is_label(line: str, times: Sequence[float]) -> bool:
    """Whether a line is more than a row of a table of numbers."""
    if not all(math.isfinite(time) for time in times):
        return False
    text = line.split(maxsplit=len(times))[len(times) :]
    has_letters = bool(text) and any(letter.isalpha() for letter in text[0])
    return has_letters or (times[0] <= times[-1] and not _NUMBERS.fullmatch("".join(text)))


def _get_times(match: re.Match[str]) -> list[float]:
    times = match.groups()[:2]
    return [float(time.replace(",", ".")) for time in times if time is not None]


def read(path: str | os.PathLike[str], *, rate: float | None = None) -> tuple[Labels, ...]:
    """Read labels in seconds.

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
        If a line is not a start, an end and a label.
    """
    entries = []
    for number, raw in enumerate(read_label_lines(path), start=1):
        line = raw.strip()
        if not line or line.startswith(_NO_LABEL):
            continue
        match = _LINE.fullmatch(line)
        if match is None:
            if _ONE_TIME.fullmatch(line):
                raise FileFormatError(
                    "the line has one time, which may be a start or an end",
                    path=path,
                    line=number,
                    found=f"'{shorten(line)}'",
                    expected="start and end in seconds, then a label",
                    advice="Add the other time; if it is an end, ESPS's header of '#' may be lost.",
                )
            raise create_line_error(
                path, number, line, "a file in seconds", "start and end in seconds, then a label"
            )
        start, end = (parse_seconds(match[g].replace(",", "."), path, number) for g in (1, 2))
        entries.append(Label(start, end, match[3] or ""))
    moments = bool(entries) and all(entry.start == entry.end for entry in entries)
    tier = Tier("label", tuple(entries), "point" if moments else "interval")
    end = max((entry.end for entry in entries), default=0.0)
    return (Labels((tier,), 0.0, end, name=Path(path).stem),)


def to_text(
    utterances: Sequence[Labels], path: str | os.PathLike[str], *, rate: float | None = None
) -> str:
    """Return the lines of the phones, as Audacity reads them; other tiers are left out.

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
        If a label holds the end of a line or begins or ends with a blank.
    """
    labels = get_only(utterances, "label")
    tier = labels.tiers[0] if len(labels.tiers) == 1 else find_phone_tier(labels)
    warn_left_out(labels, (tier,), "a file of labels in seconds")
    refuse_characters(tier.entries, "\n\r\0", "a file in seconds", outer_blanks=True)
    return "".join(
        f"{format_number(entry.start)}\t{format_number(entry.end)}\t{entry.text}\n"
        for entry in tier.entries
    )
