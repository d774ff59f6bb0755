"""What the tables of the simulation ask of a phone, and how the tables are read.

A table's rules name traits: ``where = { closure = 1, voiced = 1 }`` holds for a phone that has
each of them at least that much, ``unless = { nasal = 1 }`` for one that has none of them so much.
Traits are the features of `mocap_fit.phones` and what follows from them.
"""

from __future__ import annotations

import unicodedata
from typing import TypeVar

from pydantic import Field, field_validator

from mocap_fit.phones import Phone
from mocap_fit.settings_file import StrictModel, load_settings

# Long vowels of ARPAbet, whose IPA here has no mark of length.
_LONG = frozenset(["IY", "UW", "AA", "AO", "ER"])
_MARKS = str.maketrans("", "", "ːˑ\u032f\u0361\u035c")


def get_plain_sound(phone: Phone) -> str:
    """Return a phone's sound in IPA, without marks of length and ties.

    Parameters
    ----------
    phone
        A phone of a phone set.

    Returns
    -------
    str
        Letters of the IPA; empty where the phone set gives none.
    """
    return unicodedata.normalize("NFD", phone.ipa[0]).translate(_MARKS) if phone.ipa else ""


def get_traits(phone: Phone) -> dict[str, float]:
    """Return the strength of each of `TRAITS` in a phone.

    Parameters
    ----------
    phone
        A phone of a phone set.

    Returns
    -------
    dict of str to float
        By the name of the trait, 0 to 1; 0 where the phone does not have it.
    """
    values = dict(phone.values)
    sound = get_plain_sound(phone)
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


TRAITS = tuple(get_traits(Phone("", "silence")))


class Rule(StrictModel):
    """A rule for the phones that have some traits.

    Parameters
    ----------
    where
        The least strength of each trait, 0 to 1.
    unless
        The strength that no trait may reach, 0 to 1.
    """

    where: dict[str, float]
    unless: dict[str, float] = Field(default={})

    @field_validator("where", "unless")
    @classmethod
    def _check_traits(cls, strengths: dict[str, float]) -> dict[str, float]:
        unknown = [name for name in strengths if name not in TRAITS]
        if unknown:
            raise ValueError(f"there is no trait '{unknown[0]}'; use {', '.join(TRAITS)}")
        return strengths

    def is_met_by(self, traits: dict[str, float]) -> bool:
        """Return whether the rule holds for a phone of these traits.

        Parameters
        ----------
        traits
            By the name of the trait, 0 to 1.

        Returns
        -------
        bool
            True where all of ``where`` are reached and none of ``unless`` is.
        """
        return all(traits[name] >= least for name, least in self.where.items()) and not any(
            traits[name] >= most for name, most in self.unless.items()
        )


Table = TypeVar("Table", bound=StrictModel)


def load_table(name: str, model: type[Table], folder: str = "") -> Table:
    """Load a table that comes with the simulation.

    Parameters
    ----------
    name
        The name of the file, without ``.toml``.
    model
        The class of its settings.
    folder
        The folder of the package that holds it.

    Returns
    -------
    StrictModel
        An instance of ``model``.

    Raises
    ------
    MocapFitError
        If there is no such file, or it contradicts itself.
    """
    package = "corpus_tools.simulation"
    return load_settings(model, name, package=package, folder=folder, noun="table")
