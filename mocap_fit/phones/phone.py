"""A phone: its symbol, its phonetic features, and what follows from them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, Literal, Self

import numpy as np

from mocap_fit.tracks import FloatArray

PhoneClass = Literal["vowel", "consonant", "silence"]

PLACES = ("bilabial", "labiodental", "dental", "retroflex", "alveolar", "velar")
MANNERS = ("nasal", "fricative", "stop", "release", "voiced")
VOWEL_FEATURES = ("open", "front", "rounded", "protruded")

#: The 17 phonetic features of Beskow section 4.4, in the order of the feature vector. ``class`` is
#: 1 for a vowel and 0 otherwise. Place and manner are 0 or 1, or between for a partial feature.
#: The four vowel features go from -1 (close, back, spread, retracted) over 0 (neutral, and for
#: consonants without the feature) to 1; rounded to integers they are the paper's three values.
#: Stress is 0 or 1, and 0.5 for a secondary stress.
FEATURE_NAMES = ("class", *PLACES, *MANNERS, *VOWEL_FEATURES, "stress")

#: The ten articulatory parameters, in which a phone can resist coarticulation.
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

# From these values on a sound is clearly rounded, protruded, spread (negative) or open.
_CLEARLY_ROUNDED = 0.6
_CLEARLY_OPEN = 0.7


@dataclass(frozen=True)
class Phone:
    """A phone of a phone set.

    Parameters
    ----------
    symbol
        Symbol of the set, without stress.
    kind
        ``vowel``, ``consonant`` or ``silence``.
    values
        Features by name, -1 to 1, without class and stress; 0 where not named.
    ipa
        The sound in IPA, then other sounds that the symbol stands for. Empty for phones without
        an IPA symbol, such as silence or the release of a stop.
    also
        Other spellings that are accepted in labels.
    takes_stress
        Whether the phone has a symbol for every level of stress.
    resists
        Articulatory parameters that resist coarticulation: the phone reaches its target whatever
        the neighbouring phones are. Derived from the features where not given.
    example
        A word with the phone.
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
        resists = _derive_resistance(values) if self.resists is None else frozenset(self.resists)
        object.__setattr__(self, "resists", resists)

    def __reduce__(self) -> tuple[Any, ...]:
        # A read-only view of a dictionary can be neither pickled nor copied.
        return type(self).from_dict, (self.to_dict(),)

    def get_features(self, stress: float = 0.0) -> FloatArray:
        """Return the 17 features of Beskow section 4.4.

        Parameters
        ----------
        stress
            Value of the stress feature, 0 to 1.

        Returns
        -------
        ndarray
            Features in the order of `FEATURE_NAMES`, ``(17,)``, -1 to 1.
        """
        return np.array([float(self.kind == "vowel"), *self.values.values(), stress])

    def get_classes(self) -> frozenset[str]:
        """Return the question classes of the phone (Krňoul section 5.1).

        A bilabial nasal closes the lips and counts as a bilabial stop; the release of a stop
        opens them and does not.

        Returns
        -------
        frozenset of str
            A subset of `QUESTION_CLASSES`.
        """
        value = self.values
        belongs = {
            "vowel": self.kind == "vowel",
            "no_speech": self.kind == "silence",
            "bilabial_stop": _is_lip_closure(value),
            "labiodental": value["labiodental"] == 1,
            "fricative": value["fricative"] == 1,
        }
        return frozenset(name for name in QUESTION_CLASSES if belongs[name])

    def to_dict(self) -> dict[str, Any]:
        """Convert the phone to values that JSON can hold.

        Returns
        -------
        dict
            All fields; features that are 0 are left out.
        """
        return {
            "symbol": self.symbol,
            "kind": self.kind,
            "values": {name: value for name, value in self.values.items() if value},
            "ipa": list(self.ipa),
            "also": list(self.also),
            "takes_stress": self.takes_stress,
            "resists": sorted(self.resists or ()),
            "example": self.example,
        }

    @classmethod
    def from_dict(cls, row: Mapping[str, Any]) -> Self:
        """Create a phone from the result of `to_dict`.

        Parameters
        ----------
        row
            The fields by name.

        Returns
        -------
        Phone
            The phone.
        """
        return cls(
            row["symbol"],
            row["kind"],
            row["values"],
            ipa=tuple(row["ipa"]),
            also=tuple(row["also"]),
            takes_stress=row["takes_stress"],
            resists=frozenset(row["resists"]),
            example=row["example"],
        )


def _is_lip_closure(values: Mapping[str, float]) -> bool:
    return values["bilabial"] == 1 and (values["stop"] == 1 or values["nasal"] == 1)


def _derive_resistance(values: Mapping[str, float]) -> frozenset[str]:
    """Derive the parameters that resist coarticulation from the features of a phone.

    The papers give the idea (Beskow section 1.2; Krňoul section 5.1, with /u/ and protrusion as
    its example) but no table. Here, a closure of the lips fixes both lips; a labiodental fixes
    the lower lip; clearly rounded or protruded sounds fix rounding and protrusion, clearly spread
    ones the corners of the mouth; a sibilant keeps the teeth together; an open vowel keeps the
    jaw open.
    """
    sibilant = values["fricative"] == 1 and max(values["alveolar"], values["retroflex"]) == 1
    rules = [
        (_is_lip_closure(values), ("upper_lip_raise", "lower_lip_depression")),
        (values["labiodental"] == 1, ("lower_lip_retraction", "lower_lip_depression")),
        (values["rounded"] >= _CLEARLY_ROUNDED, ("lip_rounding",)),
        (values["protruded"] >= _CLEARLY_ROUNDED, ("upper_lip_retraction", "lower_lip_retraction")),
        (values["rounded"] <= -_CLEARLY_ROUNDED, ("left_corner_stretch", "right_corner_stretch")),
        (sibilant, ("jaw_rotation", "jaw_thrust")),
        (values["open"] >= _CLEARLY_OPEN, ("jaw_rotation",)),
    ]
    return frozenset(name for holds, names in rules if holds for name in names)
