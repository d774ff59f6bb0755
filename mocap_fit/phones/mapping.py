"""Convert labels to phones of a set, and phones of one set to those of another."""

from __future__ import annotations

import dataclasses
import unicodedata
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mocap_fit.errors import DataError, shorten
from mocap_fit.phones.phone import FEATURE_NAMES, Phone
from mocap_fit.phones.phone_set import PhoneSet
from mocap_fit.phones.set_file import find_phone_sets, load_phone_set
from mocap_fit.phones.types import PhoneSegment, PhoneSequence

# Occurrences of an unknown symbol that are remembered and shown.
_SHOWN = 3
# Unknown symbols that a message lists.
_LISTED = 20
# Ties and the mark of a part that is not syllabic are optional in IPA.
_OPTIONAL = str.maketrans("", "", "\u032f\u035c\u0361")


@dataclass(frozen=True)
class UnknownPhone:
    """A symbol that a phone set does not have, or that cannot be mapped.

    Parameters
    ----------
    symbol
        The symbol as labelled.
    count
        Number of occurrences.
    occurrences
        The first occurrences: the name of the utterance, and the start in seconds.
    """

    symbol: str
    count: int
    occurrences: tuple[tuple[str, float], ...]

    def __str__(self) -> str:
        where = ", ".join(
            f"{utterance + ' at ' if utterance else 'at '}{start:.3f} s"
            for utterance, start in self.occurrences
        )
        more = ", …" if self.count > len(self.occurrences) else ""
        return f"'{shorten(self.symbol, 40)}' {self.count}× ({where}{more})"


def find_unknown_phones(
    sequences: PhoneSequence | Iterable[PhoneSequence], phone_set: PhoneSet | str | Path
) -> tuple[UnknownPhone, ...]:
    """Find the symbols that are not in a phone set.

    Parameters
    ----------
    sequences
        Labels of one utterance, or of several.
    phone_set
        Phone set, or its name or file.

    Returns
    -------
    tuple of UnknownPhone
        In the order of first occurrence; empty if all labels are in the set.
    """
    known_set = _load(phone_set)
    if isinstance(sequences, PhoneSequence):
        sequences = (sequences,)
    known: dict[str, bool] = {}
    unknown: list[tuple[str, PhoneSegment]] = []
    for sequence in sequences:
        for segment in sequence:
            if segment.phone not in known:
                known[segment.phone] = known_set.parse(segment.phone) is not None
            if not known[segment.phone]:
                unknown.append((sequence.name, segment))
    return _count_symbols(unknown)


def normalise_phones(
    sequence: PhoneSequence,
    phone_set: PhoneSet | str | Path,
    table: Mapping[str, str] | None = None,
) -> PhoneSequence:
    """Convert labels to phones of a set.

    Symbols become those of the set, stress is split off, and every spelling of silence becomes
    the silence of the set. Where any stress is marked, vowels without a mark become unstressed
    (0). Adjacent segments with different labels of one phone, such as a closure and its stop in
    TIMIT, are joined.

    Parameters
    ----------
    sequence
        Labels as a file has them.
    phone_set
        Phone set of the labels, or its name or file.
    table
        Replacements for labels that the set lacks, by label: symbols with or without stress.

    Returns
    -------
    PhoneSequence
        The phones, with the name of the set; the same sequence if it is one of phones of this set
        already.

    Raises
    ------
    DataError
        If labels are not in the set; up to 20 are listed, with their occurrences.
    """
    known_set = _load(phone_set)
    table = table or {}
    symbols = {segment.phone for segment in sequence}
    is_normal = all(known_set.parse(symbol) == (symbol, None) for symbol in symbols)
    if is_normal and not table and sequence.phone_set == known_set.name:
        return sequence
    parsed = [known_set.parse(table.get(s.phone, s.phone)) for s in sequence]
    pairs = list(zip(sequence, parsed, strict=True))
    unknown = [(sequence.name, segment) for segment, symbol in pairs if symbol is None]
    if unknown:
        _refuse(
            unknown,
            f"are not in the phone set '{known_set.name}'",
            _describe_fit(symbols)
            + "Give the set that the labels are written in, add the symbols to its file, or give a "
            "table of replacements.",
        )
    phones: list[PhoneSegment] = []
    labels: list[str] = []
    for segment, symbol in pairs:
        assert symbol is not None
        phone, stress = symbol
        stress = segment.stress if stress is None else stress
        new = dataclasses.replace(segment, phone=phone, stress=stress)
        if phones and _is_one_phone(phones[-1], new) and labels[-1] != segment.phone:
            phones[-1] = _join(phones[-1], new)
        else:
            phones.append(new)
        labels.append(segment.phone)
    if any(segment.stress for segment in phones):
        for index, segment in enumerate(phones):
            if segment.stress is None and known_set.get_phone(segment.phone).takes_stress:
                phones[index] = dataclasses.replace(segment, stress=0)
    result = sequence.replace(segments=tuple(phones), phone_set=known_set.name)
    arguments = {"phone_set": known_set.name, "table": dict(table)}
    return result.add_step("normalise_phones", arguments)


def map_phones(
    sequence: PhoneSequence,
    to: PhoneSet | str | Path,
    table: Mapping[str, str] | None = None,
    *,
    source: PhoneSet | str | Path | None = None,
    nearest: bool = False,
) -> PhoneSequence:
    """Map phones of one set to those of another by their sound (IPA).

    Times and stress stay the same. The release of a stop is joined to its stop where the second
    set has no releases.

    Parameters
    ----------
    sequence
        Phones of the first set, in any of its spellings.
    to
        Second set, or its name or file.
    table
        Symbols of the second set by symbols of the first; they precede the comparison by sound.
    source
        First set, or its name or file; the `phone_set` of the sequence where not given.
    nearest
        Whether a sound that the second set lacks becomes the phone of the same kind with the
        nearest features. Otherwise it is an error.

    Returns
    -------
    PhoneSequence
        Phones of the second set.

    Raises
    ------
    DataError
        If phones are not in the first set, or have no counterpart in the second; up to 20 are
        listed, with their occurrences.
    """
    target = _load(to)
    origin = source if source is not None else sequence.phone_set
    if not origin:
        advice = "Name it: map_phones(..., source=NAME)."
        raise DataError(f"the phone set of '{sequence.name}' is not known", advice=advice)
    source_set = _load(origin)
    sound_map = _SoundMap(source_set, target, table or {}, nearest)
    mapped: list[PhoneSegment] = []
    missing: list[tuple[str, PhoneSegment]] = []
    for segment in normalise_phones(sequence, source_set):
        phone = source_set.get_phone(segment.phone)
        counterpart = sound_map.find(phone)
        if counterpart is not None:
            stress = segment.stress if counterpart.takes_stress else None
            mapped.append(dataclasses.replace(segment, phone=counterpart.symbol, stress=stress))
        elif phone.values["release"] and mapped and mapped[-1].end == segment.start:
            mapped[-1] = _join(mapped[-1], segment)
        else:
            missing.append((sequence.name, segment))
    _refuse(
        missing,
        f"of '{source_set.name}' have no sound in the phone set '{target.name}'",
        "Give a table for them, or take the nearest sounds (nearest=True).",
    )
    arguments = {"from": source_set.name, "to": target.name, "table": dict(table or {})}
    result = sequence.replace(segments=tuple(mapped), phone_set=target.name)
    return result.add_step("map_phones", arguments | {"nearest": nearest})


class _SoundMap:
    """Counterparts in one phone set of the phones of another."""

    def __init__(
        self, source: PhoneSet, target: PhoneSet, table: Mapping[str, str], nearest: bool
    ) -> None:
        self.target = target
        self.nearest = nearest
        self.sounds: dict[str, Phone] = {}
        # Main sounds first: they win over the other sounds that a symbol stands for.
        for position in (slice(0, 1), slice(1, None)):
            for phone in target.phones:
                for sound in phone.ipa[position]:
                    self.sounds.setdefault(_simplify_ipa(sound), phone)
        self.cached: dict[str, Phone | None] = {}
        for symbol, wanted in table.items():
            self.cached[source.get_phone(symbol).symbol] = target.get_phone(wanted)

    def find(self, phone: Phone) -> Phone | None:
        """Return the counterpart of a phone; None if there is none."""
        if phone.symbol not in self.cached:
            self.cached[phone.symbol] = self._search(phone)
        return self.cached[phone.symbol]

    def _search(self, phone: Phone) -> Phone | None:
        if phone.kind == "silence":
            return self.target.get_phone(self.target.silence)
        for sound in phone.ipa:
            if _simplify_ipa(sound) in self.sounds:
                return self.sounds[_simplify_ipa(sound)]
        if self.target.compute is not None and phone.ipa:
            parsed = self.target.parse(phone.ipa[0])
            return None if parsed is None else self.target.get_phone(parsed[0])
        if phone.values["release"]:
            same = [p for p in self.target.phones if p.values == phone.values]
            return same[0] if same else None
        alike = [p for p in self.target.phones if p.kind == phone.kind and not p.values["release"]]
        if not self.nearest or not alike:
            return None
        return min(alike, key=lambda other: _compute_distance(phone, other))


# Weights of the squared differences of features, chosen and not measured: what the lips show
# counts most, the place of the tongue less, voice least.
_CORONALS = ("dental", "retroflex", "alveolar")
_WEIGHTS = {"bilabial": 4.0, "labiodental": 4.0, "voiced": 0.25, "front": 0.5}
_WEIGHTS |= dict.fromkeys(_CORONALS, 0.2)
_WEIGHT_ROW = np.array([_WEIGHTS.get(name, 1.0) for name in FEATURE_NAMES])
# Length and being a diphthong are not among the features.
_LENGTH_WEIGHT, _DIPHTHONG_WEIGHT = 0.05, 1.0


def _compute_distance(phone: Phone, other: Phone) -> float:
    both = (phone, other)
    # The tip of the tongue at one place is like the tip at another, and unlike none.
    tip, other_tip = (max(p.values[name] for name in _CORONALS) for p in both)
    distance = np.sum(_WEIGHT_ROW * (phone.get_features() - other.get_features()) ** 2)
    is_long, letters = zip(*map(_count_letters, both), strict=True)
    shapes = _LENGTH_WEIGHT * (is_long[0] != is_long[1])
    shapes += _DIPHTHONG_WEIGHT * (letters[0] != letters[1])
    return float(distance + (tip - other_tip) ** 2 + shapes)


def _count_letters(phone: Phone) -> tuple[bool, int]:
    """Return whether the sound of a phone is long, and how many IPA letters it has."""
    sound = _simplify_ipa(phone.ipa[0]) if phone.ipa else ""
    letters = [c for c in sound if unicodedata.category(c) == "Ll"]
    return "ː" in sound, len(letters)


def _simplify_ipa(sound: str) -> str:
    plain = unicodedata.normalize("NFD", sound).translate(_OPTIONAL)
    return plain.replace("g", "ɡ").replace(":", "ː")


def _describe_fit(symbols: Collection[str]) -> str:
    """Return a sentence about the shipped phone sets that labels fit best."""
    names, count = find_phone_sets(symbols)
    if not names:
        return ""
    has = "has" if len(names) == 1 else "have"
    share = "all" if count == len(symbols) else f"{count} of {len(symbols)}"
    listed = " and ".join(f"'{name}'" for name in names)
    return f"{listed} {has} {share} of the symbols. "


def _is_one_phone(before: PhoneSegment, after: PhoneSegment) -> bool:
    return before.phone == after.phone and before.end == after.start


def _join(before: PhoneSegment, after: PhoneSegment) -> PhoneSegment:
    # The energy was measured at a centre that has moved.
    stress = before.stress if before.stress is not None else after.stress
    return dataclasses.replace(before, end=after.end, stress=stress, energy_db=None)


def _load(phone_set: PhoneSet | str | Path) -> PhoneSet:
    return phone_set if isinstance(phone_set, PhoneSet) else load_phone_set(phone_set)


def _count_symbols(segments: Iterable[tuple[str, PhoneSegment]]) -> tuple[UnknownPhone, ...]:
    occurrences: dict[str, list[tuple[str, float]]] = {}
    for utterance, segment in segments:
        occurrences.setdefault(segment.phone, []).append((utterance, segment.start))
    items = occurrences.items()
    return tuple(UnknownPhone(phone, len(where), tuple(where[:_SHOWN])) for phone, where in items)


def _refuse(segments: Iterable[tuple[str, PhoneSegment]], problem: str, advice: str) -> None:
    unknown = _count_symbols(segments)
    if unknown:
        listed = "; ".join(str(phone) for phone in unknown[:_LISTED])
        if len(unknown) > _LISTED:
            listed += f"; and {len(unknown) - _LISTED} more"
        raise DataError(f"{len(unknown)} symbols {problem}: {listed}", advice=advice)
