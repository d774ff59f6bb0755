"""Phones from labels, and labels from phones."""

from __future__ import annotations

import dataclasses
import itertools
import os
import warnings
from collections.abc import Mapping
from pathlib import Path

from mocap_fit.errors import DataError, MocapFitWarning
from mocap_fit.labels.readers import Label, Labels, Tier, read_labels
from mocap_fit.labels.tiers import (
    LabelFault,
    fill_gaps,
    find_phone_tier,
    find_word_tier,
    label_faults,
    text_at,
)
from mocap_fit.phones import (
    PhoneSegment,
    PhoneSequence,
    PhoneSet,
    load_phone_set,
    normalise_phones,
)

SMALLEST_OVERLAP = 5e-4
"""Seconds. Less is the rounding of the program that wrote the file, and is mended."""

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

    Parameters
    ----------
    path
        TextGrid, HTK .lab or .mlf, ESPS .lab, TIMIT .phn or CSV.
    tier, words
        Names of the tiers of phones and of words; found by name and content where not given.
    phone_set
        What the labels are written in: a set, its name or its file. With it, stress is split off,
        every spelling of silence, also an empty label, becomes the set's own, and symbols that
        are not in it are an error. Without it, symbols stay as they are and empty labels are
        unlabelled time.
    table
        For labels that the set lacks, the symbols to read them as.
    name
        Of the utterance, where the file holds several (.mlf).
    reader, rate
        As for `read_labels`.

    Returns
    -------
    PhoneSequence
        Each phone has the word at its centre.

    Raises
    ------
    MocapFitError
        If the file cannot be read.
    DataError
        If no tier holds phones, labels overlap, have no duration or are out of order, or symbols
        are not in the phone set.

    Warns
    -----
    MocapFitWarning
        If labels overlap by less than half a millisecond; the earlier one is shortened.
    """
    labels = read_labels(path, name, reader=reader, rate=rate)
    try:
        return to_phones(labels, tier, words, phone_set, table=table)
    except DataError as error:
        if error.path is not None:
            raise
        raise DataError(
            error.problem,
            path=path,
            found=error.found,
            expected=error.expected,
            advice=error.advice,
        ) from None


def to_phones(
    labels: Labels,
    tier: str | None = None,
    words: str | None = None,
    phone_set: PhoneSet | str | Path | None = None,
    *,
    table: Mapping[str, str] | None = None,
) -> PhoneSequence:
    """The phones of labels; parameters, errors and warnings as for `read_phones`."""
    chosen = load_phone_set(phone_set) if isinstance(phone_set, str | Path) else phone_set
    phones = find_phone_tier(labels, chosen) if tier is None else labels.tier(tier)
    if phones.kind == "point":
        raise DataError(
            f"the tier '{phones.name}' of '{labels.name}' holds moments, not phones",
            expected="a tier of intervals",
            advice="Name another tier (tier=...).",
        )
    entries = _without_overlaps(labels, phones)
    above = find_word_tier(labels) if words is None else labels.tier(words)
    stresses = next((t for t in labels.tiers if t.name.strip().casefold() == "stress"), None)
    centres = [0.5 * (entry.start + entry.end) for entry in entries]
    spoken = text_at(above, centres) if above not in (None, phones) else [""] * len(centres)
    stressed = text_at(stresses, centres) if stresses is not None else [""] * len(centres)
    silence = "" if chosen is None else chosen.silence
    segments = [
        PhoneSegment(
            entry.start,
            entry.end,
            entry.text.strip() or silence,
            _stress(mark, entry),
            word.strip(),
        )
        for entry, word, mark in zip(entries, spoken, stressed, strict=True)
        if entry.text.strip() or silence
    ]
    sequence = PhoneSequence(tuple(segments), name=labels.name)
    if chosen is None:
        return sequence
    sequence = normalise_phones(sequence, chosen, table)
    # A tier of words can have a label for silence as well.
    return sequence.replace(
        segments=tuple(
            dataclasses.replace(segment, word="")
            if chosen.is_silence(segment) and chosen.parse(segment.word) is not None
            else segment
            for segment in sequence
        )
    )


def _stress(mark: str, entry: Label) -> int | None:
    if not mark.strip():
        return None
    if mark.strip() not in ("0", "1", "2"):
        raise DataError(
            f"the stress of '{entry.text}' at {entry.start} s is unknown",
            found=mark,
            expected="0, 1, 2 or nothing",
        )
    return int(mark)


def _without_overlaps(labels: Labels, tier: Tier) -> list[Label]:
    alone = dataclasses.replace(labels, tiers=(tier,))
    faults = [fault for fault in label_faults(alone) if fault.kind in _GRAVE]
    grave = [f for f in faults if f.kind != "overlap" or f.end - f.start >= SMALLEST_OVERLAP]
    if grave:
        raise _fault_error(grave, labels)
    entries = list(tier.entries)
    for fault in faults:
        before, after = entries[fault.entry - 1], entries[fault.entry]
        # A label shorter than its overlap would vanish.
        if not before.start < after.start:
            raise _fault_error([fault], labels)
        entries[fault.entry - 1] = dataclasses.replace(before, end=after.start)
    if faults:
        warnings.warn(
            f"{len(faults)} labels of '{labels.name}' overlap by less than "
            f"{1000 * SMALLEST_OVERLAP:g} ms and were mended: {_listed(faults)}",
            MocapFitWarning,
            stacklevel=4,
        )
    return entries


def _listed(faults: list[LabelFault]) -> str:
    more = f"; and {len(faults) - _SHOWN} more" if len(faults) > _SHOWN else ""
    return "; ".join(map(str, faults[:_SHOWN])) + more


def _fault_error(faults: list[LabelFault], labels: Labels) -> DataError:
    return DataError(
        f"{len(faults)} labels of '{labels.name}' have impossible times: {_listed(faults)}",
        expected="labels that follow each other",
        advice="Mend them in the program that wrote them.",
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
        Set whose symbols, with their marks of stress, are written. Without it a stress is a digit
        behind the phone (``AA1``).

    Returns
    -------
    Labels
        The labels, with the name of the utterance.
    """
    segments, words = [], []
    for segment in phones:
        if phone_set is not None:
            symbol = phone_set.get_symbol(segment)
        else:
            symbol = segment.phone + ("" if segment.stress is None else str(segment.stress))
        segments.append(Label(segment.start, segment.end, symbol))
    for word, group in itertools.groupby(phones, key=lambda segment: segment.word):
        inside = list(group)
        if word:
            words.append(Label(inside[0].start, inside[-1].end, word))
    last = max((segment.end for segment in phones), default=0.0)
    start = min(0.0, *(segment.start for segment in phones)) if len(phones) else 0.0
    tiers = (Tier("words", tuple(words)), Tier("phones", tuple(segments)))
    return fill_gaps(
        Labels(tiers, start, last if end is None else max(end, last), name=phones.name)
    )
