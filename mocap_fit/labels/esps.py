"""ESPS .lab (xwaves, Festival): end time, colour and label, after a header that ends with '#'.

A label begins where the one before it ends, the first at 0. The header may be missing, where every
line has the same colour.
"""

from __future__ import annotations

import operator
import os
import re
from collections.abc import Sequence
from pathlib import Path

from mocap_fit.errors import DataError, FileFormatError
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

description = "ESPS .lab (xwaves, Festival), end times in seconds"
extensions = (".lab", ".esps")

_LINE = re.compile(r"([-+.0-9eE]++)[ \t]++(-?[0-9]++)(?:[ \t]++(.*+))?")
_USUAL_HEADER = ("separator ;", "nfields 1")
_USUAL_COLOUR = "26"


def sniff(path: str | os.PathLike[str]) -> bool:
    """Return whether end times and colours follow a header that ends with '#'.

    Without a header, all lines must have one colour, and times that increase.

    Parameters
    ----------
    path
        The file.

    Returns
    -------
    bool
        Whether it looks like an ESPS label file.
    """
    lines = [line.strip() for line in read_head_lines(path)]
    if "#" not in lines:
        return _has_one_colour([line for line in lines if line])
    position = lines.index("#")
    after = next((line for line in lines[position + 1 :] if line), None)
    return after is None or _LINE.fullmatch(after) is not None


def _has_one_colour(lines: Sequence[str]) -> bool:
    matches = [_LINE.fullmatch(line) for line in lines]
    ends, colours = [0.0], set()
    for match in matches:
        if match is None:
            return False
        try:
            ends.append(float(match[1]))
        except ValueError:
            return False
        colours.add(match[2])
    return len(lines) > 1 and len(colours) == 1 and all(map(operator.lt, ends, ends[1:]))


def read(path: str | os.PathLike[str], *, rate: float | None = None) -> tuple[Labels, ...]:
    """Read an ESPS label file.

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
        If the header has no end, or a line is not a time, a colour and a label.
    """
    lines = [line.strip() for line in read_label_lines(path)]
    has_header = "#" in lines
    if not has_header and not _has_one_colour([line for line in lines if line]):
        expected = "a line with only '#', then lines of end time, colour and label"
        advice = "Export it again; if the times are those of HTK, give reader='htk-lab'."
        raise FileFormatError("the header has no end", path=path, expected=expected, advice=advice)
    position = lines.index("#") if has_header else -1
    header = tuple(line for line in lines[: max(position, 0)] if line)
    entries = []
    reached = 0.0
    for number, line in enumerate(lines[position + 1 :], start=position + 2):
        if not line:
            continue
        match = _LINE.fullmatch(line)
        if match is None:
            raise create_line_error(
                path, number, line, "ESPS", "end time in seconds, colour, label"
            )
        end = parse_seconds(match[1], path, number)
        colour = "" if match[2] == _USUAL_COLOUR else f"colour={match[2]}"
        entries.append(Label(reached, end, match[3] or "", colour))
        reached = end
    tier = Tier("phone", tuple(entries))
    end = max((entry.end for entry in entries), default=0.0)
    unusual = () if header == _USUAL_HEADER else header
    return (Labels((tier,), 0.0, end, name=Path(path).stem, header=unusual),)


def to_text(
    utterances: Sequence[Labels], path: str | os.PathLike[str], *, rate: float | None = None
) -> str:
    """Return the content of an ESPS label file.

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
        If labels do not follow each other from 0 on without a gap.
    """
    labels = get_only(utterances, "ESPS")
    tier = find_phone_tier(labels)
    warn_left_out(labels, (tier,), "an ESPS file")
    refuse_characters(tier.entries, "\n\r\0", "ESPS", outer_blanks=True)
    lines = [*(labels.header or _USUAL_HEADER), "#"]
    reached = 0.0
    for entry in tier.entries:
        if entry.start != reached:
            raise DataError(
                f"an ESPS file has only ends, and '{entry.text}' does not begin at the last one",
                found=f"{entry.start} s",
                expected=f"{reached} s",
                advice="Fill the gaps (fill_label_gaps), correct overlaps, or write CSV.",
            )
        reached = entry.end
        extra = entry.extra
        colour = extra.removeprefix("colour=") if extra.startswith("colour=") else _USUAL_COLOUR
        lines.append(f"    {format_number(entry.end)} {colour} {entry.text}".rstrip(" "))
    return "\n".join(lines) + "\n"
