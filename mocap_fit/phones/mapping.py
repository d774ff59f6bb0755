"""Reading labels as phones of a set, and mapping phones from one set to another."""

from __future__ import annotations

import dataclasses
import unicodedata
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mocap_fit.errors import DataError
from mocap_fit.phones.phone_set import FEATURE_NAMES, Phone, PhoneSet
from mocap_fit.phones.set_file import load_phone_set
from mocap_fit.phones.types import PhoneSegment, PhoneSequence

# How many places of an unknown symbol are kept and shown.
_PLACES = 3
# Ties and the mark of a part that is not syllabic are written or left out as one likes.
_OPTIONAL = str.maketrans("", "", "\u032f\u035c\u0361")


@dataclass(frozen=True)
class UnknownPhone:
    """A symbol that a phone set does not have, or cannot be mapped.

    Parameters
    ----------
    symbol
        As it was found.
    count
        How often.
    places
        The first places: the utterance's name, and the start in seconds.
    """

    symbol: str
    count: int
    places: tuple[tuple[str, float], ...]

    def __str__(self) -> str:
        where = ", ".join(
            f"{utterance + ' at ' if utterance else 'at '}{start:.3f} s"
            for utterance, start in self.places
        )
        more = ", …" if self.count > len(self.places) else ""
        return f"'{self.symbol}' {self.count}× ({where}{more})"


def check_phones(
    sequences: PhoneSequence | Iterable[PhoneSequence], phone_set: PhoneSet | str | Path
) -> tuple[UnknownPhone, ...]:
    """Find the symbols that are not in a phone set.

    Parameters
    ----------
    sequences
        Labels of one utterance or of many.
    phone_set
        The set, or its name or file.

    Returns
    -------
    tuple[UnknownPhone, ...]
        In the order of first appearance; empty if every label is in the set.
    """
    chosen = _loaded(phone_set)
    if isinstance(sequences, PhoneSequence):
        sequences = (sequences,)
    known: dict[str, bool] = {}
    unknown: list[tuple[str, PhoneSegment]] = []
    for sequence in sequences:
        for segment in sequence:
            if segment.phone not in known:
                known[segment.phone] = chosen.parse(segment.phone) is not None
            if not known[segment.phone]:
                unknown.append((sequence.name, segment))
    return _gathered(unknown)


def normalise_phones(
    sequence: PhoneSequence,
    phone_set: PhoneSet | str | Path,
    table: Mapping[str, str] | None = None,
) -> PhoneSequence:
    """Read labels as phones of a set: its own symbols, stress apart, one symbol for silence.

    Parameters
    ----------
    sequence
        Labels as a file has them.
    phone_set
        The set that they are written in, or its name or file.
    table
        For labels that the set lacks, the symbols to read them as, with or without stress.

    Returns
    -------
    PhoneSequence
        Where any stress is marked, vowels without a mark are unstressed (0); where none is, it
        stays None. Segments that touch and have different labels of the same phone, such as a
        closure and its stop in TIMIT, become one.

    Raises
    ------
    DataError
        If labels are not in the set; all of them are listed, with their places.
    """
    chosen = _loaded(phone_set)
    table = table or {}
    parsed = [chosen.parse(table.get(s.phone, s.phone)) for s in sequence]
    unknown = [
        (sequence.name, segment)
        for segment, found in zip(sequence, parsed, strict=True)
        if found is None
    ]
    _refuse(
        unknown,
        f"are not in the phone set '{chosen.name}'",
        "Give the set that the labels are written in, add the symbols to its file, or give a "
        "table that says what to read them as.",
    )
    read: list[PhoneSegment] = []
    labels: list[str] = []
    for segment, found in zip(sequence, parsed, strict=True):
        assert found is not None
        phone, stress = found
        stress = segment.stress if stress is None else stress
        new = dataclasses.replace(segment, phone=phone, stress=stress)
        if read and _is_one(read[-1], new) and labels[-1] != segment.phone:
            read[-1] = _joined(read[-1], new)
        else:
            read.append(new)
        labels.append(segment.phone)
    if any(segment.stress for segment in read):
        read = [
            dataclasses.replace(segment, stress=0)
            if segment.stress is None and chosen.phone(segment.phone).takes_stress
            else segment
            for segment in read
        ]
    return sequence.replace(segments=tuple(read), phone_set=chosen.name).with_step(
        "normalise_phones", {"phone_set": chosen.name, "table": dict(table)}
    )


def map_phones(
    sequence: PhoneSequence,
    to: PhoneSet | str | Path,
    table: Mapping[str, str] | None = None,
    *,
    source: PhoneSet | str | Path | None = None,
    nearest: bool = False,
) -> PhoneSequence:
    """Write phones of one set as those of another, by their sound (IPA).

    Parameters
    ----------
    sequence
        Phones of a set, in any of its spellings.
    to
        The set to write them in, or its name or file.
    table
        What to write for phones of the first set, before any sound is compared.
    source
        The set that the phones are from; the sequence's own `phone_set` when it is left out.
    nearest
        Whether a sound that the second set lacks becomes the nearest of its kind by features; else
        it is an error.

    Returns
    -------
    PhoneSequence
        With the same times and stress. The release of a stop joins the stop before it where the
        second set has no releases.

    Raises
    ------
    DataError
        If phones are not in the first set, or cannot be written in the second; all of them are
        listed, with their places.
    """
    target = _loaded(to)
    origin = source if source is not None else sequence.phone_set
    if not origin:
        raise DataError(
            f"the phone set of '{sequence.name}' is not known",
            advice="Say which it is: map_phones(..., source=NAME).",
        )
    chosen = _loaded(origin)
    read = normalise_phones(sequence, chosen)
    mapping = _SoundMap(chosen, target, dict(table or {}), nearest)
    written: list[PhoneSegment] = []
    missing: list[tuple[str, PhoneSegment]] = []
    for segment in read:
        phone = chosen.phone(segment.phone)
        found = mapping.find(phone)
        if found is not None:
            stress = segment.stress if found.takes_stress else None
            written.append(dataclasses.replace(segment, phone=found.symbol, stress=stress))
        elif phone.values["release"] and written and written[-1].end == segment.start:
            written[-1] = _joined(written[-1], segment)
        else:
            missing.append((sequence.name, segment))
    _refuse(
        missing,
        f"of '{chosen.name}' have no sound in the phone set '{target.name}'",
        "Give a table for them, or take the nearest sounds (nearest=True).",
    )
    arguments = {
        "from": chosen.name,
        "to": target.name,
        "table": dict(table or {}),
        "nearest": nearest,
    }
    return sequence.replace(segments=tuple(written), phone_set=target.name).with_step(
        "map_phones", arguments
    )


class _SoundMap:
    """Finds the phone of one set for that of another."""

    def __init__(
        self, source: PhoneSet, target: PhoneSet, table: Mapping[str, str], nearest: bool
    ) -> None:
        self.target = target
        self.nearest = nearest
        self.sounds: dict[str, Phone] = {}
        # Main sounds first, so that one that another phone may also stand for does not win.
        for position in (slice(0, 1), slice(1, None)):
            for phone in target.phones:
                for sound in phone.ipa[position]:
                    self.sounds.setdefault(_plain(sound), phone)
        self.found: dict[str, Phone | None] = {}
        for symbol, wanted in table.items():
            self.found[source.phone(symbol).symbol] = target.phone(wanted)

    def find(self, phone: Phone) -> Phone | None:
        """The phone of the second set; None if there is none."""
        if phone.symbol not in self.found:
            self.found[phone.symbol] = self._look(phone)
        return self.found[phone.symbol]

    def _look(self, phone: Phone) -> Phone | None:
        if phone.kind == "silence":
            return self.target.phone(self.target.silence)
        for sound in phone.ipa:
            if _plain(sound) in self.sounds:
                return self.sounds[_plain(sound)]
        if self.target.compute is not None and phone.ipa:
            parsed = self.target.parse(phone.ipa[0])
            return None if parsed is None else self.target.phone(parsed[0])
        if phone.values["release"]:
            same = [p for p in self.target.phones if p.values == phone.values]
            return same[0] if same else None
        alike = [p for p in self.target.phones if p.kind == phone.kind and not p.values["release"]]
        if not self.nearest or not alike:
            return None
        return min(alike, key=lambda other: _distance(phone, other))


# What the lips show counts most, the place of the tongue less, voice least. Chosen, not measured.
_CORONALS = ("dental", "retroflex", "alveolar")
_WEIGHTS = dict.fromkeys(_CORONALS, 0.2) | {
    "bilabial": 4.0,
    "labiodental": 4.0,
    "voiced": 0.25,
    "front": 0.5,
}
_WEIGHT_ROW = np.array([_WEIGHTS.get(name, 1.0) for name in FEATURE_NAMES])


def _distance(phone: Phone, other: Phone) -> float:
    both = (phone, other)
    # The tip of the tongue at one place is like the tip at another, and unlike none.
    tip, other_tip = (max(p.values[name] for name in _CORONALS) for p in both)
    apart = np.sum(_WEIGHT_ROW * (phone.features() - other.features()) ** 2)
    # Length and being a diphthong are not among the features.
    length, letters = zip(*map(_shape, both), strict=True)
    shapes = 0.05 * (length[0] != length[1]) + 1.0 * (letters[0] != letters[1])
    return float(apart + (tip - other_tip) ** 2 + shapes)


def _shape(phone: Phone) -> tuple[bool, int]:
    sound = _plain(phone.ipa[0]) if phone.ipa else ""
    letters = [c for c in sound if unicodedata.category(c) == "Ll"]
    return "ː" in sound, len(letters)


def _plain(sound: str) -> str:
    plain = unicodedata.normalize("NFD", sound).translate(_OPTIONAL)
    return plain.replace("g", "ɡ").replace(":", "ː")


def _is_one(before: PhoneSegment, after: PhoneSegment) -> bool:
    return before.phone == after.phone and before.end == after.start


def _joined(before: PhoneSegment, after: PhoneSegment) -> PhoneSegment:
    # The energy was measured at a centre that has moved.
    stress = before.stress if before.stress is not None else after.stress
    return dataclasses.replace(before, end=after.end, stress=stress, energy_db=None)


def _loaded(phone_set: PhoneSet | str | Path) -> PhoneSet:
    return phone_set if isinstance(phone_set, PhoneSet) else load_phone_set(phone_set)


def _gathered(found: Iterable[tuple[str, PhoneSegment]]) -> tuple[UnknownPhone, ...]:
    places: dict[str, list[tuple[str, float]]] = {}
    for utterance, segment in found:
        places.setdefault(segment.phone, []).append((utterance, segment.start))
    return tuple(
        UnknownPhone(symbol, len(where), tuple(where[:_PLACES])) for symbol, where in places.items()
    )


def _refuse(found: Iterable[tuple[str, PhoneSegment]], problem: str, advice: str) -> None:
    unknown = _gathered(found)
    if unknown:
        listed = "; ".join(str(phone) for phone in unknown)
        raise DataError(f"{len(unknown)} symbols {problem}: {listed}", advice=advice)
