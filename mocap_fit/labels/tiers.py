"""Which tier holds the phones and which the words, and what is wrong with a tier's times."""

from __future__ import annotations

import dataclasses
import warnings
from collections.abc import Collection
from dataclasses import dataclass
from typing import Literal

import numpy as np

from mocap_fit.errors import DataError, MocapFitWarning
from mocap_fit.labels.readers import Label, Labels, Tier
from mocap_fit.phones import PhoneSet

_PHONE_NAMES = "phone phones phoneme phonemes phn segment segments seg mau ipa sampa x-sampa"
_WORD_NAMES = "word words wrd orthography orthographic ortography ort ort-mau text transcript"
PHONE_TIER_NAMES = frozenset(_PHONE_NAMES.split(" "))
WORD_TIER_NAMES = frozenset(_WORD_NAMES.split(" "))

SHORTEST_GAP = 1e-6
"""Seconds; less is the rounding of numbers."""

_LONGEST_SYMBOL = 4
_MOST = 0.8

FaultKind = Literal["gap", "overlap", "no duration", "negative duration", "order", "outside"]


@dataclass(frozen=True)
class LabelFault:
    """Something wrong, or worth to know, with the times of a label.

    Parameters
    ----------
    kind
        ``gap``: nothing labels the stretch; ``overlap``: two labels do; ``no duration``;
        ``negative duration``: the end is before the start; ``order``: it starts before the label
        in front of it; ``outside``: it reaches beyond what the file says that it covers.
    tier
        The tier's name.
    entry
        The label's place in the tier, from 0; of a gap or an overlap, that of the later label.
    start, end
        Seconds: the stretch that is concerned.
    text
        The label's.
    """

    kind: FaultKind
    tier: str
    entry: int
    start: float
    end: float
    text: str

    def __str__(self) -> str:
        """The fault in words."""
        return (
            f"{self.kind} at {self.start:.4f} to {self.end:.4f} s "
            f"('{self.text}', entry {self.entry + 1} of tier '{self.tier}')"
        )


def label_faults(labels: Labels, tier: str | None = None) -> tuple[LabelFault, ...]:
    """All that is wrong with the times of labels, by tier and entry.

    Parameters
    ----------
    labels
        As read.
    tier
        The name of the only tier to look at; all where not given.
    """
    chosen = labels.tiers if tier is None else (labels.tier(tier),)
    return tuple(fault for one in chosen for fault in _tier_faults(one, labels))


def _tier_faults(tier: Tier, labels: Labels) -> list[LabelFault]:
    found: list[LabelFault] = []

    def add(kind: FaultKind, place: int, start: float, end: float) -> None:
        found.append(LabelFault(kind, tier.name, place, start, end, tier.entries[place].text))

    reached = labels.start if tier.start is None else tier.start
    for place, entry in enumerate(tier.entries):
        first, last = min(entry.start, entry.end), max(entry.start, entry.end)
        if tier.kind == "interval":
            if entry.end < entry.start:
                add("negative duration", place, entry.start, entry.end)
            elif entry.end == entry.start:
                add("no duration", place, entry.start, entry.end)
        if place and entry.start < tier.entries[place - 1].start:
            add("order", place, entry.start, entry.end)
        elif tier.kind == "interval" and entry.start > reached + SHORTEST_GAP:
            add("gap", place, reached, entry.start)
        elif tier.kind == "interval" and place and entry.start < reached:
            add("overlap", place, entry.start, min(reached, last))
        outside = max(labels.start - first, last - labels.end)
        if outside > SHORTEST_GAP:
            add("outside", place, entry.start, entry.end)
        reached = max(reached, last)
    end = labels.end if tier.end is None else tier.end
    if tier.kind == "interval" and tier.entries and end > reached + SHORTEST_GAP:
        add("gap", len(tier.entries) - 1, reached, end)
    return found


def _plain_name(name: str) -> str:
    # The Montreal aligner writes "speaker - phones".
    return name.rpartition(" - ")[2].strip().casefold()


def _named(labels: Labels, names: Collection[str]) -> list[Tier]:
    return [t for t in labels.tiers if t.kind == "interval" and _plain_name(t.name) in names]


def find_phone_tier(labels: Labels, phone_set: PhoneSet | None = None) -> Tier:
    """The tier that holds the phones: by its name, or else by what is in it.

    By content, it is the tier most of whose labels are in the phone set, or without a set, most of
    whose labels have at most four letters; of two such tiers, that with more entries. A file's
    only tier of intervals is taken whatever it holds.

    Raises
    ------
    DataError
        If there is none; the tiers that there are are listed.
    """
    named = _named(labels, PHONE_TIER_NAMES)
    intervals = [tier for tier in labels.tiers if tier.kind == "interval"]
    if len(intervals) == 1:
        return intervals[0]
    candidates = named or [
        tier
        for tier in intervals
        if _plain_name(tier.name) not in WORD_TIER_NAMES | {"stress"}
        and _share_of_phones(tier, phone_set) >= _MOST
    ]
    if not candidates:
        raise DataError(
            f"no tier of '{labels.name}' holds phones",
            found=", ".join(f"'{tier.name}' ({tier.kind}s)" for tier in labels.tiers) or "no tier",
            expected="a tier named 'phones', or with phones in it",
            advice="Name the tier (tier=...).",
        )
    return max(candidates, key=lambda tier: len(tier.entries))


def _share_of_phones(tier: Tier, phone_set: PhoneSet | None) -> float:
    texts = [entry.text.strip() for entry in tier.entries if entry.text.strip()]
    if not texts:
        return 0.0
    if phone_set is None:
        are = [len(text) <= _LONGEST_SYMBOL and " " not in text for text in texts]
    else:
        are = [phone_set.parse(text) is not None for text in texts]
    return sum(are) / len(are)


def find_word_tier(labels: Labels) -> Tier | None:
    """The first tier of intervals that is named as one of words; None without one."""
    return next(iter(_named(labels, WORD_TIER_NAMES)), None)


def text_at(tier: Tier, times: Collection[float]) -> list[str]:
    """What a tier of intervals says at each time; empty where it says nothing.

    Of labels that overlap, the later one is heard.
    """
    entries = sorted(tier.entries, key=lambda entry: entry.start)
    starts = np.array([entry.start for entry in entries])
    places = np.searchsorted(starts, np.array(list(times)), side="right") - 1
    return [
        entries[place].text if place >= 0 and time < entries[place].end else ""
        for place, time in zip(places.tolist(), times, strict=True)
    ]


def fill_gaps(labels: Labels) -> Labels:
    """Labels whose tiers of intervals cover everything, with empty entries where they did not.

    Some formats can only say where one label ends and the next begins.
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
    """Warn of the tiers that a format has no place for.

    Warns
    -----
    MocapFitWarning
        If there are any; they are named.
    """
    left_out = [tier.name for tier in labels.tiers if not any(tier is one for one in written)]
    if left_out:
        warnings.warn(
            f"{format_name} has no place for: {', '.join(left_out)}. Write a TextGrid for all.",
            MocapFitWarning,
            stacklevel=4,
        )
