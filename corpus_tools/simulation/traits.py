"""What the tables of the simulation ask of a phone, and how the tables are read.

A table's rules name traits: ``where = { closure = 1, voiced = 1 }`` holds for a phone that has
each of them at least that much, ``unless = { nasal = 1 }`` for one that has none of them so much.
Traits are the features of `mocap_fit.phones` and what follows from them.
"""

from __future__ import annotations

import tomllib
import unicodedata
from functools import cache
from importlib import resources
from typing import Any, TypeVar

from pydantic import BaseModel, ConfigDict, ValidationError, field_validator

from mocap_fit.errors import ConfigurationError
from mocap_fit.phones import FEATURE_NAMES, Phone
from mocap_fit.settings_file import find_first_fault

# Long vowels of ARPAbet, whose IPA here has no mark of length.
_LONG = frozenset(["IY", "UW", "AA", "AO", "ER"])
_MARKS = str.maketrans("", "", "ːˑ\u032f\u0361\u035c")
_OTHER_TRAITS = (
    "vowel",
    "consonant",
    "silence",
    "closure",
    "sibilant",
    "coronal",
    "palatal",
    "long",
    "diphthong",
    "neutral_vowel",
    "liquid",
    "trill",
    "affricate",
    "glottal",
)
TRAITS = (*FEATURE_NAMES[1:-1], *_OTHER_TRAITS)


def plain_sound(phone: Phone) -> str:
    """The phone's sound in IPA, without length and ties; empty where it has none."""
    return unicodedata.normalize("NFD", phone.ipa[0]).translate(_MARKS) if phone.ipa else ""


def traits(phone: Phone) -> dict[str, float]:
    """All of `TRAITS` of a phone, 0 where it has nothing of one."""
    values = dict(phone.values)
    sound = plain_sound(phone)
    letters = [c for c in sound if unicodedata.category(c).startswith("L")]
    vowel = phone.kind == "vowel"
    consonant = phone.kind == "consonant"
    coronal = max(values["dental"], values["alveolar"], values["retroflex"])
    obstruent = max(values["stop"], values["fricative"], values["nasal"], values["release"]) >= 1
    hissing = sound in ("s", "z", "ʃ", "ʒ", "ɕ", "ʑ", "ʂ", "ʐ")
    affricate = values["stop"] == 1 and values["fricative"] == 1
    return values | {
        "vowel": float(vowel),
        "consonant": float(consonant),
        "silence": float(phone.kind == "silence"),
        "closure": float(consonant and max(values["stop"], values["nasal"]) == 1),
        "sibilant": float(hissing or (values["fricative"] == 1 and values["stop"] > 0)),
        "coronal": coronal,
        "palatal": float(values["velar"] == 0.5),
        "long": float(vowel and ("ː" in "".join(phone.ipa[:1]) or phone.symbol in _LONG)),
        "diphthong": float(vowel and len(letters) > 1),
        "neutral_vowel": float(sound in ("ə", "ɨ", "ɐ")),
        "liquid": float(consonant and not obstruent and values["voiced"] == 1),
        "trill": float(values["stop"] == 0.5),
        "affricate": float(affricate),
        "glottal": float(sound in ("h", "ɦ", "ʔ")),
    }


class Strict(BaseModel):
    """A table, or a part of one, that knows all its keys."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class Rule(Strict):
    """What holds for some phones.

    Parameters
    ----------
    where
        Traits that the phone has at least this much.
    unless
        Traits of which it may not have so much.
    """

    where: dict[str, float]
    unless: dict[str, float] = {}

    @field_validator("where", "unless")
    @classmethod
    def _known(cls, named: dict[str, float]) -> dict[str, float]:
        unknown = [name for name in named if name not in TRAITS]
        if unknown:
            raise ValueError(f"there is no trait '{unknown[0]}'; use {', '.join(TRAITS)}")
        return named

    def holds(self, found: dict[str, float]) -> bool:
        """Whether it holds for a phone of these traits."""
        return all(found[name] >= least for name, least in self.where.items()) and not any(
            found[name] >= most for name, most in self.unless.items()
        )


Table = TypeVar("Table", bound=Strict)


def load_table(file: str, kind: type[Table]) -> Table:
    """Read a table of this package.

    Raises
    ------
    ConfigurationError
        If it is not there or contradicts itself.
    """
    content: dict[str, Any] = {}
    try:
        content = tomllib.loads(_text(file))
        return kind.model_validate(content)
    except FileNotFoundError:
        raise ConfigurationError("the simulation has no such table", path=file) from None
    except ValidationError as error:
        faults: list[Any] = list(error.errors())
        place, problem = find_first_fault(content, faults)
        raise ConfigurationError(f"{place}: {problem}" if place else problem, path=file) from None


@cache
def _text(file: str) -> str:
    return resources.files("corpus_tools.simulation").joinpath(file).read_text(encoding="utf-8")
