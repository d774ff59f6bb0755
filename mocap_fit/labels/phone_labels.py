"""Convert labels to phones, and phones to labels."""

from __future__ import annotations

import dataclasses
import itertools
import os
import warnings
from collections.abc import Mapping
from pathlib import Path

from mocap_fit.errors import DataError, MocapFitWarning, add_path, shorten
from mocap_fit.labels.readers import read_labels
from mocap_fit.labels.tiers import (
    HOW_TO_CHOOSE,
    SHORTEST_GAP,
    FaultKind,
    LabelFault,
    fill_label_gaps,
    find_label_faults,
    find_phone_tier,
    find_word_tier,
    get_texts,
)
from mocap_fit.labels.types import Label, Labels, Tier
from mocap_fit.phones import (
    PhoneSegment,
    PhoneSequence,
    PhoneSet,
    list_phone_sets,
    load_phone_set,
    normalise_phones,
)

SMALLEST_OVERLAP = 5e-4
"""Seconds. Less, overlap or gap, is the rounding of a program and is corrected."""

# Where no phone set says what is silence.
_SILENCES = ("", "sp", "sil", "#")
_SHOWN = 5
_GRAVE = ("overlap", "no duration", "negative duration", "order")


def read_phones(
    path: str | os.PathLike[str],
    tier: str | None = None,
    words: str | None = None,
    phone_set: PhoneSet | str | Path | None = None,
    *,
    table: Mapping[str, str] | None = None,
    name: str | None = None,
    reader: str | None = None,
    rate: float | None = None,
) -> PhoneSequence:
    """Read the phones of an utterance from a file of labels.

    Praat TextGrid, HTK .lab and .mlf, ESPS .lab, .lab in seconds, TIMIT .phn, CSV and ELAN .eaf
    files are read, and the formats of installed plug-ins. The content of the file decides which
    reader is used.

    Parameters
    ----------
    path
        File to read.
    tier
        Name of the tier of phones; found by name and content where not given.
    words
        Name of the tier of words; found by name where not given.
    phone_set
        Phone set of the labels, or its name or file. With it, stress is split off, every spelling
        of silence, also an empty label, becomes that of the set, and symbols that are not in the
        set are an error. Without it, symbols stay as they are and empty labels are unlabelled
        time.
    table
        Replacements for labels that the set lacks, by label.
    name
        Name of the utterance, where the file holds several (.mlf).
    reader
        Name of the format, such as ``textgrid``; determined from the file where not given.
    rate
        Sampling rate of formats that count samples (TIMIT), hertz; 16,000 where not given.

    Returns
    -------
    PhoneSequence
        The phones with their times in seconds; each has the word at its centre.

    Raises
    ------
    MissingFileError
        If there is no such file (also a `FileNotFoundError`).
    FileFormatError
        If the file does not follow its format.
    DataError
        If no tier holds phones, labels overlap, have no duration or are out of order, or symbols
        are not in the phone set.
    RegistryError
        If a reader of another distribution fails.

    Warns
    -----
    MocapFitWarning
        If labels overlap, or leave a gap, of less than half a millisecond; the earlier one is
        shortened or prolonged.

    See Also
    --------
    load_phone_set : Load a phone set.
    load_sample : Return the path of a sample recording.
    synthesise : Compute the face parameters of phones.

    Examples
    --------
    >>> import mocap_fit as mf
    >>> phones = mf.read_phones(mf.load_sample("take_01.TextGrid"), phone_set="sv-sta")
    >>> phones
    <PhoneSequence take_01: 34 phones of sv-sta, 3.080 s: sil S V E N S K k A TJ Y R …>
    >>> phones[1].word, round(phones[1].duration, 3)
    ('svenska', 0.083)
    """
    labels = read_labels(path, name, reader=reader, rate=rate)
    try:
        return to_phones(labels, tier, words, phone_set, table=table)
    except DataError as error:
        raise add_path(error, path) from None


def to_phones(
    labels: Labels,
    tier: str | None = None,
    words: str | None = None,
    phone_set: PhoneSet | str | Path | None = None,
    *,
    table: Mapping[str, str] | None = None,
) -> PhoneSequence:
    """Convert labels to phones.

    Parameters
    ----------
    labels
        Labels as read.
    tier
        Name of the tier of phones; found by name and content where not given.
    words
        Name of the tier of words; found by name where not given.
    phone_set
        Phone set of the labels, or its name or file; without it symbols stay as they are, and
        empty labels are unlabelled time.
    table
        Replacements for labels that the set lacks, by label.

    Returns
    -------
    PhoneSequence
        The phones with their times in seconds; each has the word at its centre.

    Raises
    ------
    DataError
        If no tier holds phones, labels overlap, have no duration or are out of order, or symbols
        are not in the phone set. Silences without duration are left out.

    Warns
    -----
    MocapFitWarning
        If labels overlap, or leave a gap, of less than half a millisecond; the earlier one is
        shortened or prolonged.
    """
    chosen = load_phone_set(phone_set) if isinstance(phone_set, str | Path) else phone_set
    phones = find_phone_tier(labels, chosen) if tier is None else labels.get_tier(tier)
    if phones.kind == "point":
        raise DataError(
            f"the tier '{phones.name}' of '{labels.name}' holds moments, not phones",
            expected="a tier of intervals",
            advice=HOW_TO_CHOOSE,
        )
    entries = _resolve_overlaps(labels, _drop_empty_silences(phones, chosen))
    above = find_word_tier(labels, phones) if words is None else labels.get_tier(words)
    stresses = next((t for t in labels.tiers if t.name.strip().casefold() == "stress"), None)
    centres = [0.5 * (entry.start + entry.end) for entry in entries]
    spoken = get_texts(above, centres) if above not in (None, phones) else [""] * len(centres)
    stressed = get_texts(stresses, centres) if stresses is not None else [""] * len(centres)
    silence = "" if chosen is None else chosen.silence
    segments = []
    for entry, word, mark in zip(entries, spoken, stressed, strict=True):
        symbol = entry.text.strip() or silence
        if symbol:
            times, stress = (entry.start, entry.end), _parse_stress(mark, entry)
            segments.append(PhoneSegment(*times, symbol, stress, word.strip()))
    sequence = PhoneSequence(tuple(segments), name=labels.name)
    if chosen is None:
        return sequence
    sequence = normalise_phones(sequence, chosen, table)
    # A tier of words can have a label for silence as well.
    segments = list(sequence)
    for index, segment in enumerate(segments):
        if chosen.is_silence(segment) and chosen.parse(segment.word) is not None:
            segments[index] = dataclasses.replace(segment, word="")
    return sequence.replace(segments=tuple(segments))


def _parse_stress(mark: str, entry: Label) -> int | None:
    if not mark.strip():
        return None
    if mark.strip() not in ("0", "1", "2"):
        raise DataError(
            f"the stress of '{shorten(entry.text, 40)}' at {entry.start} s is unknown",
            found=mark,
            expected="0, 1, 2 or nothing",
        )
    return int(mark)


def _drop_empty_silences(tier: Tier, phone_set: PhoneSet | None) -> Tier:
    """Leave out silences without duration, which HTK writes between words that are not parted."""

    def is_silence(text: str) -> bool:
        if phone_set is None:
            return text.strip().casefold() in _SILENCES
        return phone_set.parse(text) == (phone_set.silence, None)

    entries = (e for e in tier.entries if e.end != e.start or not is_silence(e.text))
    return dataclasses.replace(tier, entries=tuple(entries))


def _resolve_overlaps(labels: Labels, tier: Tier) -> list[Label]:
    alone = dataclasses.replace(labels, tiers=(tier,))
    faults = [fault for fault in find_label_faults(alone) if fault.kind in _GRAVE]
    grave = [f for f in faults if f.kind != "overlap" or f.end - f.start >= SMALLEST_OVERLAP]
    if grave:
        raise _create_fault_error(grave, labels)
    entries = list(tier.entries)
    corrected = []
    for index, (before, after) in enumerate(itertools.pairwise(tier.entries), start=1):
        gap = after.start - before.end
        if gap == 0 or abs(gap) >= SMALLEST_OVERLAP:
            continue
        first, last = sorted((before.end, after.start))
        kind: FaultKind = "gap" if gap > 0 else "overlap"
        fault = LabelFault(kind, tier.name, index, first, last, after.text)
        # A label shorter than its overlap would vanish.
        if not before.start < after.start:
            raise _create_fault_error([fault], labels)
        entries[index - 1] = dataclasses.replace(before, end=after.start)
        if abs(gap) > SHORTEST_GAP:
            corrected.append(fault)
    if corrected:
        warnings.warn(
            f"{len(corrected)} labels of '{labels.name}' overlap by less than "
            f"{1000 * SMALLEST_OVERLAP:g} ms, or leave less than that between them, and were "
            f"corrected: {_list_faults(corrected)}",
            MocapFitWarning,
            stacklevel=4,
        )
    return entries


def _list_faults(faults: list[LabelFault]) -> str:
    more = f"; and {len(faults) - _SHOWN} more" if len(faults) > _SHOWN else ""
    return "; ".join(map(str, faults[:_SHOWN])) + more


def _create_fault_error(faults: list[LabelFault], labels: Labels) -> DataError:
    return DataError(
        f"{len(faults)} labels of '{labels.name}' have impossible times: {_list_faults(faults)}",
        expected="labels that follow each other",
        advice="Correct them in the program that wrote them.",
    )


def to_labels(
    phones: PhoneSequence, end: float | None = None, phone_set: PhoneSet | None = None
) -> Labels:
    """Convert phones to labels with a tier of words and a tier of phones, ready to be written.

    Both tiers are interval tiers without gaps: unlabelled time becomes empty labels.

    Parameters
    ----------
    phones
        Phones of an utterance.
    end
        End of the labels, seconds; that of the last phone where not given or earlier.
    phone_set
        Phone set of the phones, whose marks of stress are written. Where not given, it is the
        shipped set that the phones name; without either, a stress is a digit behind the phone
        (``AA1``).

    Returns
    -------
    Labels
        The labels, with the name of the utterance.
    """
    if phone_set is None and phones.phone_set in list_phone_sets():
        phone_set = load_phone_set(phones.phone_set)
    segments, words = [], []
    for segment in phones:
        symbol = segment.phone
        if segment.stress is not None:
            digit = f"{symbol}{segment.stress}"
            symbol = digit if phone_set is None else phone_set.get_symbol(segment)
        segments.append(Label(segment.start, segment.end, symbol))
    for word, group in itertools.groupby(phones, key=lambda segment: segment.word):
        inside = list(group)
        if word:
            words.append(Label(inside[0].start, inside[-1].end, word))
    last = max((segment.end for segment in phones), default=0.0)
    start = min(0.0, *(segment.start for segment in phones)) if len(phones) else 0.0
    tiers = (Tier("words", tuple(words)), Tier("phones", tuple(segments)))
    return fill_label_gaps(
        Labels(tiers, start, last if end is None else max(end, last), name=phones.name)
    )
