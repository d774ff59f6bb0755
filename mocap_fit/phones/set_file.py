"""Read phone sets from TOML files."""

from __future__ import annotations

import unicodedata
from collections.abc import Collection
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, field_validator, model_validator

from mocap_fit.errors import ConfigurationError, MissingExtraError, add_path
from mocap_fit.phones.phone import ARTICULATORY_PARAMETERS, MANNERS, PLACES, VOWEL_FEATURES, Phone
from mocap_fit.phones.phone_set import ALPHABETS, PhoneSet
from mocap_fit.phones.stress import StressMarks
from mocap_fit.settings_file import StrictModel, list_shipped, load_settings

_KINDS = (*PLACES, *MANNERS)
# A tier with more different labels does not hold phones.
_MAX_SYMBOLS = 400
# Letters of most symbols of phones.
_LONGEST = 4
_Share = Annotated[float, Field(ge=0, le=1)]
_Graded = Annotated[float, Field(ge=-1, le=1)]
_Text = Annotated[str, Field(min_length=1)]


class _Row(StrictModel):
    """A phone in a file."""

    kind: str = ""
    ipa: _Text | tuple[_Text, ...] = ()
    also: tuple[str, ...] = ()
    example: str = ""
    stress: bool = False
    resists: tuple[str, ...] | None = None
    bilabial: _Share = 0
    labiodental: _Share = 0
    dental: _Share = 0
    retroflex: _Share = 0
    alveolar: _Share = 0
    velar: _Share = 0
    nasal: _Share = 0
    fricative: _Share = 0
    stop: _Share = 0
    release: _Share = 0
    voiced: _Share = 0
    open: _Graded = 0
    front: _Graded = 0
    rounded: _Graded = 0
    protruded: _Graded = 0

    @field_validator("kind")
    @classmethod
    def _check_features(cls, kind: str) -> str:
        for word in kind.split():
            if word not in _KINDS:
                raise ValueError(f"there is no feature '{word}'; use {', '.join(_KINDS)}")
        return kind

    @field_validator("resists")
    @classmethod
    def _check_parameters(cls, resists: tuple[str, ...] | None) -> tuple[str, ...] | None:
        for name in resists or ():
            if name not in ARTICULATORY_PARAMETERS:
                known = ", ".join(ARTICULATORY_PARAMETERS)
                raise ValueError(f"there is no parameter '{name}'; use {known}")
        return resists

    def to_phone(self, symbol: str, kind: Literal["vowel", "consonant"], stress: bool) -> Phone:
        """Convert the row to a phone."""
        values = {name: getattr(self, name) for name in (*_KINDS, *VOWEL_FEATURES)}
        values |= dict.fromkeys(self.kind.split(), 1.0)
        return Phone(
            _compose(symbol),
            kind,
            values,
            ipa=(self.ipa,) if isinstance(self.ipa, str) else self.ipa,
            also=tuple(_compose(spelling) for spelling in self.also),
            takes_stress=stress,
            resists=None if self.resists is None else frozenset(self.resists),
            example=self.example,
        )


class _VowelRow(_Row):
    # Required, so that nobody forgets them: a vowel without them would look like schwa.
    open: _Graded = Field()
    front: _Graded = Field()
    rounded: _Graded = Field()
    protruded: _Graded = Field()
    voiced: _Share = 1
    stress: bool = True


class _Silence(StrictModel):
    symbol: _Text
    also: tuple[str, ...] = ()


class _Stress(StrictModel):
    position: Literal["before", "after"]
    levels: tuple[Literal[0, 1, 2], ...]
    unstressed: tuple[str, ...] = ("",)
    primary: tuple[str, ...]
    secondary: tuple[str, ...] = ()

    @model_validator(mode="after")
    def _check_marks(self) -> _Stress:
        marks = {0: self.unstressed, 1: self.primary, 2: self.secondary}
        if sorted(set(self.levels)) != list(self.levels) or self.levels[:2] != (0, 1):
            raise ValueError("levels are [0, 1] or [0, 1, 2]")
        for level in self.levels:
            if not marks[level]:
                raise ValueError(f"level {level} has no mark")
        every = [mark for level in marks.values() for mark in level]
        if len(set(every)) < len(every):
            raise ValueError("one mark stands for two levels of stress")
        if "" in (*self.primary, *self.secondary):
            raise ValueError("only the mark of 'unstressed' may be empty")
        return self

    def to_marks(self) -> StressMarks:
        """Convert the table to the marks of a phone set."""
        every = {0: self.unstressed, 1: self.primary, 2: self.secondary}
        return StressMarks(self.levels, {k: v for k, v in every.items() if v}, self.position)


class _SetFile(StrictModel):
    name: str = ""
    language: str = ""
    description: str = ""
    ignore_case: bool = False
    features_from: Literal["panphon", "panphon, x-sampa"] | None = None
    silence: _Silence
    stress: _Stress | None = None
    vowels: dict[_Text, _VowelRow] = Field(default_factory=dict)
    consonants: dict[_Text, _Row] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _check_sounds(self) -> _SetFile:
        if not (self.vowels or self.consonants or self.features_from):
            raise ValueError("there are no phones: it needs [vowels] and [consonants]")
        symbols: dict[str, str] = {}
        for symbol, row in {**self.vowels, **self.consonants}.items():
            for sound in (row.ipa,) if isinstance(row.ipa, str) else row.ipa:
                other = symbols.setdefault(_compose(sound), symbol)
                if other != symbol:
                    raise ValueError(f"'{other}' and '{symbol}' have the same ipa '{sound}'")
        return self

    def to_phones(self) -> tuple[Phone, ...]:
        """Return silence, the vowels and the consonants, in the order of the file."""
        silence = Phone(self.silence.symbol, "silence", also=self.silence.also)
        # Without marks of stress a phone has one symbol.
        marked = self.stress is not None
        vowels = (r.to_phone(s, "vowel", r.stress and marked) for s, r in self.vowels.items())
        others = (
            r.to_phone(s, "consonant", r.stress and marked) for s, r in self.consonants.items()
        )
        return (silence, *vowels, *others)


def _compose(text: str) -> str:
    return unicodedata.normalize("NFC", text)


def list_phone_sets() -> tuple[str, ...]:
    """Return the names of the phone sets that come with the package.

    Returns
    -------
    tuple of str
        The names, sorted.
    """
    return list_shipped(__package__, "sets")


def load_phone_set(name: str | Path) -> PhoneSet:
    """Load a phone set.

    Parameters
    ----------
    name
        The name of a set that comes with the package (``mocap-fit info`` lists them), or a TOML
        file; ``mocap_fit/phones/sets`` has examples.

    Returns
    -------
    PhoneSet
        The set.

    Raises
    ------
    MissingFileError
        If there is no such set.
    ConfigurationError
        If its file contradicts itself; the message says where.

    See Also
    --------
    read_phones : Read the phones of an utterance.

    Examples
    --------
    >>> import mocap_fit as mf
    >>> phone_set = mf.load_phone_set("en-arpabet")
    >>> phone_set.language
    'en'
    """
    table = load_settings(_SetFile, name, package=__package__, folder="sets", noun="phone set")
    try:
        return PhoneSet(
            table.name or Path(name).stem,
            table.to_phones(),
            language=table.language,
            description=table.description,
            stress=table.stress.to_marks() if table.stress else StressMarks(),
            ignore_case=table.ignore_case,
            compute=ALPHABETS[table.features_from] if table.features_from else None,
        )
    except ConfigurationError as error:
        raise add_path(error, name) from None


def find_phone_sets(symbols: Collection[str]) -> tuple[tuple[str, ...], int]:
    """Find the shipped phone sets that labels fit best.

    Parameters
    ----------
    symbols
        Different labels, with or without stress.

    Returns
    -------
    names
        The sets that have the most of them. Of those with the same number, sets of a language
        precede sets of all sounds, which are not named with them.
    count
        Number of labels that these have; without names where there are too many for phones.
    """
    fits: dict[str, tuple[int, bool]] = {}
    sets = map(load_phone_set, list_phone_sets() if 0 < len(symbols) <= _MAX_SYMBOLS else ())
    are_short = sum(len(symbol) <= _LONGEST for symbol in symbols) >= 0.5 * len(symbols)
    for phone_set in sorted(sets, key=lambda each: each.compute is not None):
        # Features take a second to load, which words are not worth.
        if phone_set.compute is not None and (
            (len(symbols), True) in fits.values() or not are_short
        ):
            continue
        try:
            count = sum(phone_set.parse(symbol) is not None for symbol in symbols)
        except MissingExtraError:
            continue
        if count:
            fits[phone_set.name] = count, phone_set.compute is None
    best = max(fits.values(), default=(0, False))
    return tuple(name for name, fit in fits.items() if fit == best), best[0]
