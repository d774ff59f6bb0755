"""Labels of TIMIT: .phn and .wrd, one line an entry, its times in samples.

A .wrd of the same name beside a .phn is read with it.
"""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from pathlib import Path

from mocap_fit.errors import FileFormatError
from mocap_fit.labels.readers import Label, Labels, Tier
from mocap_fit.labels.text import (
    head_lines,
    label_text,
    only_one,
    refuse_characters,
    units,
    utterance_name,
)
from mocap_fit.labels.tiers import find_phone_tier, find_word_tier, warn_left_out

description = "TIMIT .phn and .wrd, times in samples"
extensions = (".phn", ".wrd")
SAMPLE_RATE = 16000.0

_LINE = re.compile(r"(-?\d{1,18})[ \t]+(-?\d{1,18})(?:[ \t]+(.*?))?[ \t]*")


def sniff(path: str | os.PathLike[str]) -> bool:
    """Whether the ending is TIMIT's and the lines hold two whole numbers and a label.

    Within, it looks as HTK's .lab does; only the name tells samples from units of 100 ns.
    """
    lines = [line for line in head_lines(path) if line.strip()]
    return (
        Path(path).suffix.lower() in extensions
        and bool(lines)
        and all(_LINE.fullmatch(line.strip()) for line in lines)
    )


def read(path: str | os.PathLike[str], *, rate: float | None = None) -> tuple[Labels, ...]:
    """Read a .phn, with the .wrd beside it, or a .wrd.

    Parameters
    ----------
    path
        The file.
    rate
        Samples per second; 16000 where not given.

    Raises
    ------
    FileFormatError
        If a line is not two numbers of samples and a label.
    """
    file = Path(path)
    words = file.suffix.lower() == ".wrd"
    tiers = [_tier(file, "word" if words else "phone", rate or SAMPLE_RATE)]
    beside = file.with_suffix(".WRD" if file.suffix.isupper() else ".wrd")
    if not words and beside.is_file() and beside.stat().st_size:
        tiers.append(_tier(beside, "word", rate or SAMPLE_RATE))
    end = max((entry.end for tier in tiers for entry in tier.entries), default=0.0)
    return (Labels(tuple(tiers), 0.0, end, name=utterance_name(path)),)


def _tier(path: Path, name: str, rate: float) -> Tier:
    entries = []
    for number, line in enumerate(label_text(path).split("\n"), start=1):
        if not line.strip():
            continue
        match = _LINE.fullmatch(line.strip())
        if match is None:
            raise FileFormatError(
                "this is no label of TIMIT",
                path=path,
                line=number,
                found=f"'{line.strip()}'",
                expected="first sample, last sample, label",
            )
        entries.append(Label(int(match[1]) / rate, int(match[2]) / rate, match[3] or ""))
    return Tier(name, tuple(entries))


def text(
    utterances: Sequence[Labels], path: str | os.PathLike[str], *, rate: float | None = None
) -> str:
    """Lines of the phones, or of the words for a .wrd; other tiers are left out.

    Raises
    ------
    DataError
        If a label holds the end of a line or begins or ends with a blank.
    """
    labels = only_one(utterances, "TIMIT")
    words = Path(path).suffix.lower() == ".wrd"
    tier = find_word_tier(labels) if words else None
    if tier is None:
        tier = find_phone_tier(labels)
    warn_left_out(labels, (tier,), "a TIMIT file")
    refuse_characters(tier.entries, "\n\r\0", "TIMIT", outer_blanks=True)
    rate = rate or SAMPLE_RATE
    return "".join(
        f"{units(entry.start, rate)} {units(entry.end, rate)} {entry.text}\n"
        for entry in tier.entries
    )
