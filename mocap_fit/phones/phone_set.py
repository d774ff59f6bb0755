"""Phone sets: the symbols of a language, what each sounds and looks like, and its stress.

A set is a TOML file that a phonetician can read and extend; `load_phone_set` reads it.
"""

from __future__ import annotations

import dataclasses
import unicodedata
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, Self

from mocap_fit.errors import ConfigurationError, DataError, FileFormatError
from mocap_fit.phones.computed import compute_phone
from mocap_fit.phones.phone import ARTICULATORY_PARAMETERS, Phone
from mocap_fit.phones.stress import StressMarks
from mocap_fit.phones.types import PhoneSegment
from mocap_fit.phones.x_sampa import compute_x_sampa_phone
from mocap_fit.tracks import FloatArray

ALPHABETS: dict[str, Callable[[str], Phone | None]] = {
    "panphon": compute_phone,
    "panphon, x-sampa": compute_x_sampa_phone,
}
"""Functions that compute the phone of a symbol, by what a file of a set names them."""

_STRESS_VALUE = {0: 0.0, 1: 1.0, 2: 0.5}


@dataclass(frozen=True, repr=False)
class PhoneSet:
    """The phones of a language or an alphabet.

    Parameters
    ----------
    name
        Name of the set.
    phones
        All phones, silence first.
    language
        BCP 47 tag such as ``sv``; empty for a set of all languages.
    description
        One line for people.
    stress
        Spelling of stress.
    ignore_case
        Whether ``aa`` is read as ``AA``.
    compute
        Function that returns the phone of a symbol that is not among `phones`, or None. A set
        with such a function has any number of symbols, which cannot be listed (see `select`).

    Raises
    ------
    ConfigurationError
        If there is not exactly one silence, or a symbol stands for two phones.
    """

    name: str
    phones: tuple[Phone, ...]
    language: str = ""
    description: str = ""
    stress: StressMarks = field(default_factory=StressMarks)
    ignore_case: bool = False
    compute: Callable[[str], Phone | None] | None = None
    _spellings: dict[str, Phone] = field(init=False, compare=False)
    # Labels that were parsed before; a computed phone takes a thousand times as long.
    _cached: dict[str, tuple[str, int | None] | None] = field(
        init=False, compare=False, default_factory=dict
    )

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
                key = self._to_key(spelling)
                if key in spellings:
                    raise self._create_ambiguity_error(
                        spelling, f"'{spellings[key].symbol}' and '{phone.symbol}'"
                    )
                spellings[key] = phone
        object.__setattr__(self, "_spellings", spellings)
        for phone in self.phones:
            for level in self.stress.levels if phone.takes_stress else ():
                written = self.stress.write(phone.symbol, level)
                if self._look_up(written) not in (None, phone):
                    raise self._create_ambiguity_error(
                        written, f"'{phone.symbol}' with stress and '{written}'"
                    )

    def _create_ambiguity_error(self, symbol: str, phones: str) -> ConfigurationError:
        return ConfigurationError(
            f"'{symbol}' of the phone set '{self.name}' stands for two phones",
            found=phones,
            expected="each symbol once",
        )

    def __repr__(self) -> str:
        language = f" ({self.language})" if self.language else ""
        others = ", and any sound in IPA" if self.compute is not None else ""
        return f"<PhoneSet {self.name}{language}: {len(self.phones)} phones{others}>"

    def _to_key(self, symbol: str) -> str:
        # One letter has two encodings (Å; A and a ring), and files of macOS have the second.
        key = unicodedata.normalize("NFC", symbol.strip())
        return key.upper() if self.ignore_case else key

    def _look_up(self, symbol: str) -> Phone | None:
        return self._spellings.get(self._to_key(symbol))

    @property
    def silence(self) -> str:
        """The symbol of silence."""
        return next(phone.symbol for phone in self.phones if phone.kind == "silence")

    def parse(self, label: str) -> tuple[str, int | None] | None:
        """Split a label into the symbol of the set and the stress.

        Parameters
        ----------
        label
            Label with or without stress, in any spelling that the set accepts. An empty label is
            silence where the set says so.

        Returns
        -------
        tuple or None
            The symbol of the set, and the stress: 0, 1, 2, or None where it is not marked. None
            if the set has no such symbol.
        """
        if label not in self._cached:
            self._cached[label] = self._parse(label)
        return self._cached[label]

    def _parse(self, label: str) -> tuple[str, int | None] | None:
        phone = self._look_up(label)
        if phone is not None:
            return phone.symbol, None
        marked = self.stress.split(self._to_key(label))
        if marked is not None:
            phone = self._look_up_or_compute(marked[0])
            return (phone.symbol, marked[1]) if phone and phone.takes_stress else None
        phone = self._look_up_or_compute(label)
        return None if phone is None else (phone.symbol, None)

    def _look_up_or_compute(self, symbol: str) -> Phone | None:
        phone = self._look_up(symbol)
        if phone is None and self.compute is not None and self._to_key(symbol):
            phone = self.compute(self._to_key(symbol))
        return phone

    def get_phone(self, phone: str | PhoneSegment) -> Phone:
        """Return the phone of a symbol.

        Parameters
        ----------
        phone
            A symbol, with or without stress, or a labelled segment.

        Returns
        -------
        Phone
            The phone with its features.

        Raises
        ------
        DataError
            If the set has no such phone.
        """
        label = phone.phone if isinstance(phone, PhoneSegment) else phone
        parsed = self.parse(label)
        result = self._look_up_or_compute(parsed[0]) if parsed is not None else None
        if result is None:
            advice = "Add it to the file of the set, or map the labels to this set."
            raise DataError(f"the phone set '{self.name}' has no phone '{label}'", advice=advice)
        return result

    def list_symbols(self, stress: bool = True) -> tuple[str, ...]:
        """Return all symbols, silence included.

        Parameters
        ----------
        stress
            Whether a phone that takes stress has a symbol for each level.

        Returns
        -------
        tuple of str
            The symbols, in the order of `phones`.

        Raises
        ------
        DataError
            If the set computes phones, so that its symbols have no end.
        """
        if self.compute is not None:
            raise DataError(
                f"the symbols of '{self.name}' cannot be listed: the set holds every sound",
                advice="Select those that a corpus has: phone_set.select(phones).",
            )
        symbols: list[str] = []
        for phone in self.phones:
            if stress and phone.takes_stress:
                symbols += [self.stress.write(phone.symbol, level) for level in self.stress.levels]
            else:
                symbols.append(phone.symbol)
        return tuple(symbols)

    def get_symbol(self, segment: PhoneSegment, stress: bool = True) -> str:
        """Return the symbol of a labelled segment.

        Parameters
        ----------
        segment
            The segment. A stress that is not marked counts as unstressed.
        stress
            Whether the symbol has the mark of stress.

        Returns
        -------
        str
            One of `list_symbols`.

        Raises
        ------
        DataError
            If the set has no such phone.
        """
        phone = self.get_phone(segment)
        if not (stress and phone.takes_stress):
            return phone.symbol
        return self.stress.write(phone.symbol, self.stress.get_level(self._get_stress(segment)))

    def _get_stress(self, phone: str | PhoneSegment) -> int | None:
        if isinstance(phone, PhoneSegment) and phone.stress is not None:
            return phone.stress
        parsed = self.parse(phone.phone if isinstance(phone, PhoneSegment) else phone)
        return None if parsed is None else parsed[1]

    def get_features(self, phone: str | PhoneSegment) -> FloatArray:
        """Return the 17 features of a phone (Beskow section 4.4).

        Parameters
        ----------
        phone
            A symbol, with or without stress, or a labelled segment.

        Returns
        -------
        ndarray
            Features in the order of `FEATURE_NAMES`, ``(17,)``, -1 to 1; zeros for silence.

        Raises
        ------
        DataError
            If the set has no such phone.
        """
        known = self.get_phone(phone)
        if not known.takes_stress:
            return known.get_features()
        return known.get_features(_STRESS_VALUE[self.stress.get_level(self._get_stress(phone))])

    def is_vowel(self, phone: str | PhoneSegment) -> bool:
        """Return whether a phone is a vowel.

        Parameters
        ----------
        phone
            A symbol, with or without stress, or a labelled segment.

        Returns
        -------
        bool
            Whether it is a vowel.
        """
        return self.get_phone(phone).kind == "vowel"

    def is_consonant(self, phone: str | PhoneSegment) -> bool:
        """Return whether a phone is a consonant.

        Parameters
        ----------
        phone
            A symbol, with or without stress, or a labelled segment.

        Returns
        -------
        bool
            Whether it is a consonant.
        """
        return self.get_phone(phone).kind == "consonant"

    def is_silence(self, phone: str | PhoneSegment) -> bool:
        """Return whether a phone is silence.

        Parameters
        ----------
        phone
            A symbol or a labelled segment.

        Returns
        -------
        bool
            Whether it is silence.
        """
        return self.get_phone(phone).kind == "silence"

    def get_classes(self, phone: str | PhoneSegment) -> frozenset[str]:
        """Return the question classes of a phone (Krňoul section 5.1).

        Parameters
        ----------
        phone
            A symbol, with or without stress, or a labelled segment.

        Returns
        -------
        frozenset of str
            A subset of `QUESTION_CLASSES`.
        """
        return self.get_phone(phone).get_classes()

    def is_resistant(self, phone: str | PhoneSegment, parameter: str) -> bool:
        """Return whether a phone resists coarticulation in an articulatory parameter.

        Parameters
        ----------
        phone
            A symbol, with or without stress, or a labelled segment.
        parameter
            One of `ARTICULATORY_PARAMETERS`.

        Returns
        -------
        bool
            Whether the phone reaches its target whatever the neighbouring phones are.

        Raises
        ------
        DataError
            If there is no such phone or no such parameter.
        """
        if parameter not in ARTICULATORY_PARAMETERS:
            expected = f"one of {', '.join(ARTICULATORY_PARAMETERS)}"
            raise DataError(f"there is no articulatory parameter '{parameter}'", expected=expected)
        return parameter in (self.get_phone(phone).resists or ())

    def select(self, phones: Iterable[str]) -> PhoneSet:
        """Return a set of some of the phones, and silence.

        Parameters
        ----------
        phones
            Symbols, with or without stress.

        Returns
        -------
        PhoneSet
            The phones in the order of this set; computed ones last, sorted by symbol. It computes
            no others.

        Raises
        ------
        DataError
            If one of the phones is not in this set.
        """
        wanted = {phone.symbol: phone for phone in map(self.get_phone, phones)}
        listed = tuple(p for p in self.phones if p.symbol in wanted or p.kind == "silence")
        known = {phone.symbol for phone in listed}
        others = tuple(wanted[symbol] for symbol in sorted(wanted.keys() - known))
        return dataclasses.replace(self, phones=listed + others, compute=None)

    def to_dict(self) -> dict[str, Any]:
        """Convert the set to values that JSON can hold.

        Returns
        -------
        dict
            All that the set says. A trained model stores the set that it was trained on so.
        """
        return {
            "name": self.name,
            "language": self.language,
            "description": self.description,
            "ignore_case": self.ignore_case,
            "computed": next((k for k, v in ALPHABETS.items() if v is self.compute), False),
            "stress": {
                "levels": list(self.stress.levels),
                "marks": {str(level): list(marks) for level, marks in self.stress.marks.items()},
                "position": self.stress.position,
            },
            "phones": [phone.to_dict() for phone in self.phones],
        }

    @classmethod
    def from_dict(cls, table: Mapping[str, Any]) -> Self:
        """Create a phone set from the result of `to_dict`.

        Parameters
        ----------
        table
            The fields by name.

        Returns
        -------
        PhoneSet
            The set.

        Raises
        ------
        FileFormatError
            If a field is missing or has a wrong type.
        """
        try:
            stress = table["stress"]
            marks = {int(level): tuple(marks) for level, marks in stress["marks"].items()}
            return cls(
                table["name"],
                tuple(Phone.from_dict(row) for row in table["phones"]),
                language=table["language"],
                description=table["description"],
                stress=StressMarks(tuple(stress["levels"]), marks, stress["position"]),
                ignore_case=table["ignore_case"],
                compute=ALPHABETS[source] if (source := table["computed"]) else None,
            )
        except (KeyError, TypeError, ValueError, AttributeError) as error:
            raise FileFormatError(
                "the phone set in this file is damaged", found=f"{type(error).__name__}: {error}"
            ) from None
