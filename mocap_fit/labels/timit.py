"""Labels of TIMIT: .phn and .wrd, one line an entry, its times in samples.

A .wrd of the same name beside a .phn is read with it. TIMIT's ``q``, the glottal stop, has no
counterpart in ARPAbet and none on the face: it is read as ``pau``, a silence, and written as ``q``.
"""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from pathlib import Path

from mocap_fit.labels.text import (
    create_line_error,
    get_only,
    parse_seconds,
    read_head_lines,
    read_label_lines,
    refuse_characters,
    to_units,
)
from mocap_fit.labels.tiers import find_phone_tier, find_word_tier, warn_left_out
from mocap_fit.labels.types import Label, Labels, Tier

description = "TIMIT .phn and .wrd, times in samples"
extensions = (".phn", ".wrd")
SAMPLE_RATE = 16000.0

_LINE = re.compile(r"(-?[0-9]{1,18})[ \t]++(-?[0-9]{1,18})(?:[ \t]++(.*+))?")
_GLOTTAL_STOP = "q"
_SILENCE = "pau"
_MARK = "symbol="
_SOUNDS = (".wav", ".WAV", ".flac", ".sph")


def sniff(path: str | os.PathLike[str]) -> bool:
    """Return whether the extension is TIMIT's and the lines hold two integers and a label.

    The content looks as that of an HTK .lab; only the extension distinguishes samples from units
    of 100 ns.

    Parameters
    ----------
    path
        The file.

    Returns
    -------
    bool
        Whether it looks like a TIMIT label file.
    """
    lines = [line for line in read_head_lines(path) if line.strip()]
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
        File to read.
    rate
        Sampling rate, hertz. Where not given, it is that of a sound of the same name beside the
        file, or 16,000.

    Returns
    -------
    tuple of Labels
        The only utterance of the file.

    Raises
    ------
    FileFormatError
        If a line is not two numbers of samples and a label.
    """
    file = Path(path)
    words = file.suffix.lower() == ".wrd"
    rate = rate or _find_rate(file)
    tiers = [_read_tier(file, "word" if words else "phone", rate)]
    beside = file.with_suffix(".WRD" if file.suffix.isupper() else ".wrd")
    if not words and beside.is_file() and beside.stat().st_size:
        tiers.append(_read_tier(beside, "word", rate))
    end = max((entry.end for tier in tiers for entry in tier.entries), default=0.0)
    return (Labels(tuple(tiers), 0.0, end, name=Path(path).stem),)


def _find_rate(file: Path) -> float:
    import soundfile

    for beside in map(file.with_suffix, _SOUNDS):
        if beside.is_file():
            try:
                return float(soundfile.info(beside).samplerate)
            except (RuntimeError, OSError):
                # What is wrong with the sound is said where it is read.
                break
    return SAMPLE_RATE


def _read_tier(path: Path, name: str, rate: float) -> Tier:
    entries = []
    for number, line in enumerate(read_label_lines(path), start=1):
        if not line.strip():
            continue
        match = _LINE.fullmatch(line.strip())
        if match is None:
            raise create_line_error(
                path, number, line.strip(), "TIMIT", "first sample, last sample, label"
            )
        start, end = (parse_seconds(match[index], path, number, rate) for index in (1, 2))
        text = match[3] or ""
        if name == "phone" and text.lower() == _GLOTTAL_STOP:
            entries.append(Label(start, end, _SILENCE, _MARK + text))
        else:
            entries.append(Label(start, end, text))
    return Tier(name, tuple(entries))


def to_text(
    utterances: Sequence[Labels], path: str | os.PathLike[str], *, rate: float | None = None
) -> str:
    """Return the lines of the phones, or of the words for a .wrd; other tiers are left out.

    Parameters
    ----------
    utterances
        Exactly one utterance.
    path
        File that will be written; ``.wrd`` selects the words.
    rate
        Sampling rate, hertz; 16,000 where not given.

    Returns
    -------
    str
        Content of the file.

    Raises
    ------
    DataError
        If a label holds the end of a line or begins or ends with a blank.
    """
    labels = get_only(utterances, "TIMIT")
    words = Path(path).suffix.lower() == ".wrd"
    tier = find_word_tier(labels) if words else None
    if tier is None:
        tier = find_phone_tier(labels)
    warn_left_out(labels, (tier,), "a TIMIT file")
    refuse_characters(tier.entries, "\n\r\0", "TIMIT", outer_blanks=True)
    rate = rate or SAMPLE_RATE
    return "".join(
        f"{to_units(entry.start, rate)} {to_units(entry.end, rate)} {_get_symbol(entry)}\n"
        for entry in tier.entries
    )


def _get_symbol(entry: Label) -> str:
    symbol = entry.extra.removeprefix(_MARK)
    is_mapped = entry.text == _SILENCE and entry.extra.startswith(_MARK)
    return symbol if is_mapped else entry.text
