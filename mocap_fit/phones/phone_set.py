"""Phone sets: the symbols of a language, what each sounds and looks like, and its stress.

A set is a TOML file that a phonetician can read and extend; `load_phone_set` reads it.
"""

from __future__ import annotations

import dataclasses
import unicodedata
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Literal

import numpy as np

from mocap_fit.errors import ConfigurationError, DataError
from mocap_fit.phones.types import PhoneSegment
from mocap_fit.tracks import FloatArray

PhoneClass = Literal["vowel", "consonant", "silence"]

PLACES = ("bilabial", "labiodental", "dental", "retroflex", "alveolar", "velar")
MANNERS = ("nasal", "fricative", "stop", "release", "voiced")
VOWEL_FEATURES = ("open", "front", "rounded", "protruded")

#: The 17 phonetic features of Beskow section 4.4, in the order of the feature vector. ``class`` is
#: 1 for a vowel and 0 for what is not. Place and manner are 0 or 1, or between where a sound is
#: partly so. The four of vowels are graded from -1 (close, back, spread, drawn back) over 0
#: (middle; nothing to say of a consonant) to 1; rounded to whole numbers they are the paper's
#: three values. Stress is 0 or 1, and 0.5 for the secondary stress of a set that has one.
FEATURE_NAMES = ("class", *PLACES, *MANNERS, *VOWEL_FEATURES, "stress")

#: What a phone can resist coarticulation in: the ten articulatory parameters.
ARTICULATORY_PARAMETERS = (
    "jaw_rotation",
    "lip_rounding",
    "upper_lip_retraction",
    "upper_lip_raise",
    "lower_lip_retraction",
    "lower_lip_depression",
    "left_corner_stretch",
    "right_corner_stretch",
    "jaw_thrust",
    "jaw_shift",
)

#: The question classes of Krňoul section 5.1.
QUESTION_CLASSES = ("vowel", "no_speech", "bilabial_stop", "labiodental", "fricative")

_STRESS_VALUE = {0: 0.0, 1: 1.0, 2: 0.5}


@dataclass(frozen=True)
class Phone:
    """A phone of a set.

    Parameters
    ----------
    symbol
        As the set writes it, without stress.
    kind
        ``vowel``, ``consonant`` or ``silence``.
    values
        The features by name, without class and stress; what is not named is 0.
    ipa
        The sound in IPA, then other sounds that the symbol stands for as well; empty for what IPA
        has no symbol for, such as silence or the release of a stop.
    also
        Other ways to write it, understood when labels are read.
    takes_stress
        Whether it has a symbol for every level of stress.
    resists
        The articulatory parameters in which it keeps its own target, whatever is beside it; found
        from the features (`resisted`) when it is None.
    example
        A word that has it.
    """

    symbol: str
    kind: PhoneClass
    values: Mapping[str, float] = field(default_factory=dict)
    ipa: tuple[str, ...] = ()
    also: tuple[str, ...] = ()
    takes_stress: bool = False
    resists: frozenset[str] | None = None
    example: str = ""

    def __post_init__(self) -> None:
        values = {name: float(self.values.get(name, 0.0)) for name in FEATURE_NAMES[1:-1]}
        object.__setattr__(self, "values", MappingProxyType(values))
        found = resisted(values) if self.resists is None else frozenset(self.resists)
        object.__setattr__(self, "resists", found)

    def features(self, stress: float = 0.0) -> FloatArray:
        """The 17 features, `(17,)`, in the order of `FEATURE_NAMES`."""
        return np.array([float(self.kind == "vowel"), *self.values.values(), stress])

    def classes(self) -> frozenset[str]:
        """Which of `QUESTION_CLASSES` it belongs to (Krňoul section 5.1).

        A bilabial nasal closes the lips as a stop does and counts as a bilabial stop; a stop's
        release opens them and does not.
        """
        value = self.values
        closure = value["stop"] == 1 or value["nasal"] == 1
        belongs = {
            "vowel": self.kind == "vowel",
            "no_speech": self.kind == "silence",
            "bilabial_stop": value["bilabial"] == 1 and closure,
            "labiodental": value["labiodental"] == 1,
            "fricative": value["fricative"] == 1,
        }
        return frozenset(name for name in QUESTION_CLASSES if belongs[name])


def resisted(values: Mapping[str, float]) -> frozenset[str]:
    """The articulatory parameters that a sound resists coarticulation in, by its features.

    The papers give the idea (Beskow section 1.2; Krňoul section 5.1, with /u/ and protrusion as
    its example) but no table. Here: who closes the lips keeps both of them; a labiodental keeps
    the lower lip; rounding and protrusion are kept by what is clearly rounded or protruded,
    and the corners of the mouth by what is clearly spread; a sibilant keeps the teeth together;
    an open vowel keeps the jaw down.
    """
    found: set[str] = set()
    closure = values["stop"] == 1 or values["nasal"] == 1
    sibilant = values["fricative"] == 1 and max(values["alveolar"], values["retroflex"]) == 1
    if values["bilabial"] == 1 and closure:
        found |= {"upper_lip_raise", "lower_lip_depression"}
    if values["labiodental"] == 1:
        found |= {"lower_lip_retraction", "lower_lip_depression"}
    if values["rounded"] >= 0.6:
        found |= {"lip_rounding"}
    if values["protruded"] >= 0.6:
        found |= {"upper_lip_retraction", "lower_lip_retraction"}
    if values["rounded"] <= -0.6:
        found |= {"left_corner_stretch", "right_corner_stretch"}
    if sibilant:
        found |= {"jaw_rotation", "jaw_thrust"}
    if values["open"] >= 0.7:
        found |= {"jaw_rotation"}
    return frozenset(found)


@dataclass(frozen=True)
class StressMarks:
    """How a set writes stress.

    Parameters
    ----------
    levels
        The levels that have symbols of their own; a secondary stress (2) that is not among them
        counts as 1.
    marks
        Of each level, the mark that is written, then others that are understood. The mark of
        level 0 may be empty: then a symbol without a mark says nothing of stress.
    position
        Whether the mark is written before or after the phone.
    """

    levels: tuple[int, ...] = (0,)
    marks: Mapping[int, tuple[str, ...]] = field(default_factory=lambda: {0: ("",)})
    position: Literal["before", "after"] = "after"

    def level(self, stress: int | None) -> int:
        """The level that a stress counts as; unmarked (None) counts as unstressed."""
        if not stress:
            return 0
        return stress if stress in self.levels else max(self.levels)

    def write(self, phone: str, level: int) -> str:
        """The symbol of a phone at a level."""
        mark = self.marks[level][0]
        return mark + phone if self.position == "before" else phone + mark

    def split(self, symbol: str) -> tuple[str, int] | None:
        """The phone and the level of a symbol that carries a mark; None if it carries none."""
        for level, marks in self.marks.items():
            for mark in filter(None, marks):
                if self.position == "before" and symbol.startswith(mark):
                    return symbol[len(mark) :], level
                if self.position == "after" and symbol.endswith(mark):
                    return symbol[: -len(mark)], level
        return None


@dataclass(frozen=True)
class PhoneSet:
    """The phones of a language or an alphabet.

    Parameters
    ----------
    name, language, description
        Of the set; the language as a BCP 47 tag such as ``sv``, empty for all.
    phones
        All phones, silence first.
    stress
        How stress is written.
    ignore_case
        Whether ``aa`` is read as ``AA``.
    compute
        What makes a phone of a symbol that is not among `phones`, or returns None; a set that has
        it holds every sound, and its symbols cannot be counted (see `only`).
    """

    name: str
    phones: tuple[Phone, ...]
    language: str = ""
    description: str = ""
    stress: StressMarks = field(default_factory=StressMarks)
    ignore_case: bool = False
    compute: Callable[[str], Phone | None] | None = field(default=None, repr=False)
    _spellings: dict[str, Phone] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        spellings: dict[str, Phone] = {}
        silences = [phone.symbol for phone in self.phones if phone.kind == "silence"]
        if len(silences) != 1:
            raise ConfigurationError(
                f"the phone set '{self.name}' has {len(silences)} symbols for silence",
                expected="one",
            )
        for phone in self.phones:
            for spelling in (phone.symbol, *phone.also):
                key = self._key(spelling)
                if key in spellings:
                    raise ConfigurationError(
                        f"'{spelling}' of the phone set '{self.name}' stands for two phones",
                        found=f"'{spellings[key].symbol}' and '{phone.symbol}'",
                        expected="each symbol once",
                    )
                spellings[key] = phone
        object.__setattr__(self, "_spellings", spellings)
        for phone in self.phones:
            for level in self.stress.levels if phone.takes_stress else ():
                written = self.stress.write(phone.symbol, level)
                if self._found(written) not in (None, phone):
                    raise ConfigurationError(
                        f"'{written}' of the phone set '{self.name}' stands for two phones",
                        found=f"'{phone.symbol}' with stress and '{written}'",
                        expected="each symbol once",
                    )

    def _key(self, symbol: str) -> str:
        # One letter can be coded in two ways (Å; A and a ring), as files of macOS have it.
        key = unicodedata.normalize("NFC", symbol.strip())
        return key.upper() if self.ignore_case else key

    def _found(self, symbol: str) -> Phone | None:
        return self._spellings.get(self._key(symbol))

    @property
    def silence(self) -> str:
        """The symbol of silence."""
        return next(phone.symbol for phone in self.phones if phone.kind == "silence")

    def parse(self, label: str) -> tuple[str, int | None] | None:
        """Read a label: its phone, and its stress where that is marked.

        Parameters
        ----------
        label
            As a label file has it: with or without stress, and in any spelling that the set
            knows. An empty label is silence.

        Returns
        -------
        tuple[str, int | None] | None
            The set's own symbol, and 0, 1, 2 or None; None if the set has no such symbol.
        """
        phone = self._found(label)
        if phone is not None:
            return phone.symbol, None
        marked = self.stress.split(self._key(label))
        if marked is not None:
            phone = self._phone(marked[0])
            return (phone.symbol, marked[1]) if phone and phone.takes_stress else None
        phone = self._phone(label)
        return None if phone is None else (phone.symbol, None)

    def _phone(self, symbol: str) -> Phone | None:
        phone = self._found(symbol)
        if phone is None and self.compute is not None and self._key(symbol):
            phone = self.compute(self._key(symbol))
        return phone

    def phone(self, phone: str | PhoneSegment) -> Phone:
        """All that is known of a phone.

        Parameters
        ----------
        phone
            A symbol, with or without stress, or a labelled segment.

        Raises
        ------
        DataError
            If the set has no such phone.
        """
        label = phone.phone if isinstance(phone, PhoneSegment) else phone
        parsed = self.parse(label)
        found = self._phone(parsed[0]) if parsed is not None else None
        if found is None:
            raise DataError(
                f"the phone set '{self.name}' has no phone '{label}'",
                advice="Add it to the set's file, or map the labels to this set.",
            )
        return found

    def symbols(self, stress: bool = True) -> tuple[str, ...]:
        """All symbols, silence included.

        Parameters
        ----------
        stress
            Whether a phone that takes stress has a symbol for each level.

        Raises
        ------
        DataError
            If the set holds every sound and so has no end.
        """
        if self.compute is not None:
            raise DataError(
                f"the symbols of '{self.name}' cannot be counted: it holds every sound",
                advice="Take those that a corpus has: phone_set.only(phones).",
            )
        found: list[str] = []
        for phone in self.phones:
            if stress and phone.takes_stress:
                found += [self.stress.write(phone.symbol, level) for level in self.stress.levels]
            else:
                found.append(phone.symbol)
        return tuple(found)

    def symbol(self, segment: PhoneSegment, stress: bool = True) -> str:
        """The symbol of a labelled segment, one of `symbols`.

        A stress that is not marked counts as none.
        """
        phone = self.phone(segment)
        if not (stress and phone.takes_stress):
            return phone.symbol
        return self.stress.write(phone.symbol, self.stress.level(self._stress_of(segment)))

    def _stress_of(self, phone: str | PhoneSegment) -> int | None:
        if isinstance(phone, PhoneSegment) and phone.stress is not None:
            return phone.stress
        parsed = self.parse(phone.phone if isinstance(phone, PhoneSegment) else phone)
        return None if parsed is None else parsed[1]

    def features(self, phone: str | PhoneSegment) -> FloatArray:
        """The 17 features of Beskow section 4.4.

        Parameters
        ----------
        phone
            A symbol, with or without stress, or a labelled segment.

        Returns
        -------
        FloatArray
            `(17,)`, in the order of `FEATURE_NAMES`. Silence is all zeros.

        Raises
        ------
        DataError
            If the set has no such phone.
        """
        found = self.phone(phone)
        if not found.takes_stress:
            return found.features()
        return found.features(_STRESS_VALUE[self.stress.level(self._stress_of(phone))])

    def is_vowel(self, phone: str | PhoneSegment) -> bool:
        """Whether it is a vowel."""
        return self.phone(phone).kind == "vowel"

    def is_consonant(self, phone: str | PhoneSegment) -> bool:
        """Whether it is a consonant."""
        return self.phone(phone).kind == "consonant"

    def is_silence(self, phone: str | PhoneSegment) -> bool:
        """Whether it is no speech."""
        return self.phone(phone).kind == "silence"

    def classes(self, phone: str | PhoneSegment) -> frozenset[str]:
        """Which of `QUESTION_CLASSES` it belongs to (Krňoul section 5.1)."""
        return self.phone(phone).classes()

    def resists(self, phone: str | PhoneSegment, parameter: str) -> bool:
        """Whether it keeps its own target of an articulatory parameter, whatever is beside it.

        Raises
        ------
        DataError
            If there is no such phone or no such parameter.
        """
        if parameter not in ARTICULATORY_PARAMETERS:
            raise DataError(
                f"there is no articulatory parameter '{parameter}'",
                expected=f"one of {', '.join(ARTICULATORY_PARAMETERS)}",
            )
        return parameter in (self.phone(phone).resists or ())

    def only(self, phones: Iterable[str]) -> PhoneSet:
        """A set of just these phones and silence, in the order of this set, then sorted.

        Raises
        ------
        DataError
            If one of them is not in this set.
        """
        wanted = {found.symbol: found for found in map(self.phone, phones)}
        listed = tuple(p for p in self.phones if p.symbol in wanted or p.kind == "silence")
        known = {phone.symbol for phone in listed}
        others = tuple(wanted[symbol] for symbol in sorted(wanted.keys() - known))
        return dataclasses.replace(self, phones=listed + others, compute=None)
