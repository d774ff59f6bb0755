"""ESPS .lab (xwaves, Festival): end time, colour and label, after a header that ends with '#'.

A label begins where the one before it ends, the first at 0.
"""

from __future__ import annotations

import os
import re
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
from mocap_fit.labels.tiers import find_phone_tier, warn_left_out

description = "ESPS .lab (xwaves, Festival), end times in seconds"
extensions = (".lab", ".esps")

_LINE = re.compile(r"([-+.\deE]+)[ \t]+(-?\d+)(?:[ \t]+(.*))?")
_USUAL_HEADER = ("separator ;", "nfields 1")
_USUAL_COLOUR = "26"


def sniff(path: str | os.PathLike[str]) -> bool:
    """Whether a line of '#' ends a header, and an end time and a colour follow."""
    lines = [line.strip() for line in head_lines(path)]
    if "#" not in lines:
        return False
    place = lines.index("#")
    after = next((line for line in lines[place + 1 :] if line), None)
    return after is None or _LINE.fullmatch(after) is not None


def read(path: str | os.PathLike[str], *, rate: float | None = None) -> tuple[Labels, ...]:
    """Read an ESPS label file; `rate` is not used.

    Raises
    ------
    FileFormatError
        If the header has no end, or a line is not a time, a colour and a label.
    """
    lines = [line.strip() for line in label_text(path).split("\n")]
    if "#" not in lines:
        raise FileFormatError(
            "the header has no end",
            path=path,
            expected="a line with only '#', then lines of end time, colour and label",
            advice="Export it again; if the times are those of HTK, give reader='htk-lab'.",
        )
    place = lines.index("#")
    header = tuple(line for line in lines[:place] if line)
    entries = []
    reached = 0.0
    for number, line in enumerate(lines[place + 1 :], start=place + 2):
        if not line:
            continue
        match = _LINE.fullmatch(line)
        if match is None:
            raise FileFormatError(
                "this is no label of ESPS",
                path=path,
                line=number,
                found=f"'{line}'",
                expected="end time in seconds, colour, label",
            )
        end = seconds(match[1], path, number)
        colour = "" if match[2] == _USUAL_COLOUR else f"colour={match[2]}"
        entries.append(Label(reached, end, match[3] or "", colour))
        reached = end
    tier = Tier("phone", tuple(entries))
    end = max((entry.end for entry in entries), default=0.0)
    kept = () if header == _USUAL_HEADER else header
    return (Labels((tier,), 0.0, end, name=utterance_name(path), header=kept),)


def text(
    utterances: Sequence[Labels], path: str | os.PathLike[str], *, rate: float | None = None
) -> str:
    """The file's text; `path` and `rate` are not used.

    Raises
    ------
    DataError
        If labels do not follow each other from 0 on without a gap.
    """
    labels = only_one(utterances, "ESPS")
    tier = find_phone_tier(labels)
    warn_left_out(labels, (tier,), "an ESPS file")
    refuse_characters(tier.entries, "\n\r\0", "ESPS", outer_blanks=True)
    lines = [*(labels.header or _USUAL_HEADER), "#"]
    reached = 0.0
    for entry in tier.entries:
        if entry.start != reached:
            raise DataError(
                f"an ESPS file says only ends, and '{entry.text}' does not begin at the last one",
                found=f"{entry.start} s",
                expected=f"{reached} s",
                advice="Fill the gaps (mocap_fit.io.fill_gaps), mend overlaps, or write CSV.",
            )
        reached = entry.end
        extra = entry.extra
        colour = extra.removeprefix("colour=") if extra.startswith("colour=") else _USUAL_COLOUR
        lines.append(f"    {number_text(entry.end)} {colour} {entry.text}".rstrip(" "))
    return "\n".join(lines) + "\n"
