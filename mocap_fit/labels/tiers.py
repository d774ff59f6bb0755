"""Find the tiers of phones and words, and the faults in the times of labels."""

from __future__ import annotations

import dataclasses
import warnings
from collections.abc import Collection
from dataclasses import dataclass
from typing import Literal

import numpy as np

from mocap_fit.errors import DataError, MocapFitWarning, shorten
from mocap_fit.labels.types import Label, Labels, Tier
from mocap_fit.phones import PhoneSet

_PHONE_NAMES = (
    "phone phones phoneme phonemes phonetic phn phonalign segment segments seg mau sound sounds "
    "ipa sampa x-sampa"
)
_WORD_NAMES = (
    "word words wrd orthography orthographic ortography ort ort-mau text transcript token tokens "
    "tokensalign"
)
PHONE_TIER_NAMES = frozenset(_PHONE_NAMES.split(" "))
WORD_TIER_NAMES = frozenset(_WORD_NAMES.split(" "))

SHORTEST_GAP = 1e-6
"""Seconds; less is the rounding of numbers."""

HOW_TO_CHOOSE = (
    "Name the tier: tier=... in Python, --tier of mocap-fit speak, phones = ... under [labels] in "
    "a manifest."
)
"""What a message says where the tier of phones is not clear."""

_LONGEST_SYMBOL = 4
_MOST = 0.8
"""Share of labels that must look like phones in a tier of phones."""

FaultKind = Literal["gap", "overlap", "no duration", "negative duration", "order", "outside"]


@dataclass(frozen=True)
class LabelFault:
    """A fault in the times of a label.

    Parameters
    ----------
    kind
        ``gap``: the time is not labelled; ``overlap``: it is labelled twice; ``no duration``;
        ``negative duration``: the end is before the start; ``order``: the label starts before the
        one in front of it; ``outside``: it exceeds the start or the end of the file.
    tier
        Name of the tier.
    entry
        Index of the label in the tier; of a gap or an overlap, that of the later label.
    start
        Start of the fault, seconds.
    end
        End of the fault, seconds.
    text
        Text of the label.
    """

    kind: FaultKind
    tier: str
    entry: int
    start: float
    end: float
    text: str

    def __str__(self) -> str:
        """Return a description of the fault."""
        return (
            f"{self.kind} at {self.start:.4f} to {self.end:.4f} s "
            f"('{shorten(self.text, 40)}', entry {self.entry + 1} of tier "
            f"'{shorten(self.tier, 40)}')"
        )


def find_label_faults(labels: Labels, tier: str | None = None) -> tuple[LabelFault, ...]:
    """Find the faults in the times of labels.

    Parameters
    ----------
    labels
        Labels as read.
    tier
        Name of the only tier to check; all tiers where not given.

    Returns
    -------
    tuple of LabelFault
        The faults by tier and entry.

    Raises
    ------
    DataError
        If there is no tier of that name.
    """
    chosen = labels.tiers if tier is None else (labels.get_tier(tier),)
    return tuple(fault for one in chosen for fault in _find_tier_faults(one, labels))


def _find_tier_faults(tier: Tier, labels: Labels) -> list[LabelFault]:
    faults: list[LabelFault] = []

    def add(kind: FaultKind, index: int, start: float, end: float) -> None:
        faults.append(LabelFault(kind, tier.name, index, start, end, tier.entries[index].text))

    reached = labels.start if tier.start is None else tier.start
    for index, entry in enumerate(tier.entries):
        first, last = min(entry.start, entry.end), max(entry.start, entry.end)
        if tier.kind == "interval":
            if entry.end < entry.start:
                add("negative duration", index, entry.start, entry.end)
            elif entry.end == entry.start:
                add("no duration", index, entry.start, entry.end)
        if index and entry.start < tier.entries[index - 1].start:
            add("order", index, entry.start, entry.end)
        elif tier.kind == "interval" and entry.start > reached + SHORTEST_GAP:
            add("gap", index, reached, entry.start)
        elif tier.kind == "interval" and index and entry.start < reached:
            add("overlap", index, entry.start, min(reached, last))
        outside = max(labels.start - first, last - labels.end)
        if outside > SHORTEST_GAP:
            add("outside", index, entry.start, entry.end)
        reached = max(reached, last)
    end = labels.end if tier.end is None else tier.end
    if tier.kind == "interval" and tier.entries and end > reached + SHORTEST_GAP:
        add("gap", len(tier.entries) - 1, reached, end)
    return faults


def _split_name(name: str) -> tuple[str, str]:
    """Return the speaker and the kind in the name of a tier."""
    # The Montreal aligner writes "speaker - phones", laboratories that use ELAN "phones@speaker".
    speaker, separator, kind = name.rpartition(" - ")
    if not separator:
        kind, _, speaker = name.partition("@")
    return speaker.strip(), kind.strip().casefold()


def _select_named(labels: Labels, names: Collection[str]) -> list[Tier]:
    tiers = [tier for tier in labels.tiers if tier.kind == "interval"]
    return [tier for tier in tiers if _split_name(tier.name)[1] in names]


def find_phone_tier(labels: Labels, phone_set: PhoneSet | None = None) -> Tier:
    """Find the tier of phones by its name, or else by its content.

    By content, it is the tier of which most labels are in the phone set, or without a set, have at
    most four letters; of several such tiers, the one with the most entries. The only tier of
    intervals is chosen whatever its name and content are.

    Parameters
    ----------
    labels
        Labels as read.
    phone_set
        Phone set of the labels, if known.

    Returns
    -------
    Tier
        The tier of phones.

    Raises
    ------
    DataError
        If there is none, or several speakers have one; the tiers are listed.
    """
    intervals = [tier for tier in labels.tiers if tier.kind == "interval"]
    if len(intervals) == 1:
        return intervals[0]
    named = _select_named(labels, PHONE_TIER_NAMES)
    spoken = [tier for tier in named if any(entry.text.strip() for entry in tier.entries)] or named
    kinds = [_split_name(tier.name)[1] for tier in spoken]
    if len(set(kinds)) < len(kinds):
        raise DataError(
            f"several tiers of '{labels.name}' hold phones",
            found=_list_tiers(spoken),
            expected="one, or the name of the one that is wanted",
            advice=HOW_TO_CHOOSE,
        )
    candidates = spoken or [
        tier
        for tier in intervals
        if _split_name(tier.name)[1] not in WORD_TIER_NAMES | {"stress"}
        and _compute_phone_share(tier, phone_set) >= _MOST
    ]
    if not candidates:
        raise DataError(
            f"no tier of '{labels.name}' holds phones",
            found=_list_tiers(labels.tiers) or "no tier",
            expected="a tier named 'phones', or with phones in it",
            advice=HOW_TO_CHOOSE,
        )
    return max(candidates, key=lambda tier: len(tier.entries))


def _list_tiers(tiers: Collection[Tier]) -> str:
    return ", ".join(f"'{shorten(tier.name, 40)}' ({tier.kind}s)" for tier in tiers)


def _compute_phone_share(tier: Tier, phone_set: PhoneSet | None) -> float:
    texts = [entry.text.strip() for entry in tier.entries if entry.text.strip()]
    if not texts:
        return 0.0
    if phone_set is None:
        matches = [len(text) <= _LONGEST_SYMBOL and " " not in text for text in texts]
    else:
        matches = [phone_set.parse(text) is not None for text in texts]
    return sum(matches) / len(matches)


def find_word_tier(labels: Labels, phones: Tier | None = None) -> Tier | None:
    """Find the tier of words by its name.

    Parameters
    ----------
    labels
        Labels as read.
    phones
        Tier of the phones; of several tiers of words, that of the same speaker is chosen.

    Returns
    -------
    Tier or None
        The first such tier of intervals; None without one.
    """
    named = _select_named(labels, WORD_TIER_NAMES)
    if phones is not None:
        speaker = _split_name(phones.name)[0]
        named.sort(key=lambda tier: _split_name(tier.name)[0] != speaker)
    return next(iter(named), None)


def get_texts(tier: Tier, times: Collection[float]) -> list[str]:
    """Return the text of a tier of intervals at each time.

    Parameters
    ----------
    tier
        The tier; of overlapping labels, the later one counts.
    times
        Times, seconds.

    Returns
    -------
    list of str
        The texts; empty where nothing is labelled.
    """
    entries = sorted(tier.entries, key=lambda entry: entry.start)
    starts = np.array([entry.start for entry in entries])
    indices = np.searchsorted(starts, np.array(list(times)), side="right") - 1
    return [
        entries[index].text if index >= 0 and time < entries[index].end else ""
        for index, time in zip(indices.tolist(), times, strict=True)
    ]


def fill_label_gaps(labels: Labels) -> Labels:
    """Fill the gaps of interval tiers with empty labels, as some formats require.

    Parameters
    ----------
    labels
        Labels with or without gaps.

    Returns
    -------
    Labels
        Labels whose interval tiers cover the time from the start to the end.
    """
    tiers = []
    for tier in labels.tiers:
        entries: list[Label] = []
        reached = labels.start
        for entry in tier.entries:
            if tier.kind == "interval" and entry.start > reached:
                entries.append(Label(reached, entry.start, ""))
            entries.append(entry)
            reached = max(reached, entry.end)
        if tier.kind == "interval" and labels.end > reached:
            entries.append(Label(reached, labels.end, ""))
        tiers.append(dataclasses.replace(tier, entries=tuple(entries)))
    return dataclasses.replace(labels, tiers=tuple(tiers))


def warn_left_out(labels: Labels, written: Collection[Tier], format_name: str) -> None:
    """Warn of the tiers that a format cannot hold.

    Parameters
    ----------
    labels
        Labels to write.
    written
        Tiers that are written.
    format_name
        Name of the format for the message.

    Warns
    -----
    MocapFitWarning
        If tiers are left out; they are named.
    """
    left_out = [tier.name for tier in labels.tiers if not any(tier is one for one in written)]
    if left_out:
        warnings.warn(
            f"{format_name} cannot hold: {shorten(', '.join(left_out))}. Write a TextGrid for all.",
            MocapFitWarning,
            stacklevel=4,
        )
