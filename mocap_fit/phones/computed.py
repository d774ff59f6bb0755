"""Phones of any language: their features computed from IPA through panphon (Mortensen 2016)."""

from __future__ import annotations

import csv
import functools
import unicodedata
from collections.abc import Mapping, Sequence
from importlib import resources
from typing import Any

from mocap_fit.errors import MissingExtraError
from mocap_fit.phones.phone import FEATURE_NAMES, Phone, PhoneClass

# panphon calls these back vowels.
_CENTRAL = frozenset("ɨʉɘɵəɜɞɐa")
# panphon has it close-mid.
_NEAR_OPEN = {"ɐ": 0.6}
_GLOTTAL_FRICATIVES = frozenset("hɦ")
_LABIODENTAL = frozenset("fvɱʋⱱ")
_TRILLS = frozenset("rʙʀ")
# The tip of the tongue is near the teeth, whatever else it does; panphon has ɮ further back.
_ALVEOLAR = frozenset("szʃʒɕʑɮ")
# Rounded and protruded, as in the sets of Swedish and Czech.
_LIPS = dict.fromkeys("ʃʒ", (0.4, 0.6)) | dict.fromkeys("ʂʐ", (0.3, 0.4))
# Two closures at once, which may be written without a tie.
_DOUBLE = frozenset({"kp", "ɡb", "ŋm"})
_BRIDGE = "\N{COMBINING BRIDGE BELOW}"
_RINGS = frozenset("\N{COMBINING RING BELOW}\N{COMBINING RING ABOVE}")
_TIES = frozenset("\u035c\u0361")
# The lips of Japanese u are pressed together at the sides.
_COMPRESSED = "ᵝ"
_LEFT_OUT = str.maketrans("", "", _COMPRESSED + "".join(sorted(_TIES | _RINGS)))
# Characters of the longest entry of panphon's table.
_LONGEST_SOUND = 8
# What stands for an IPA letter where it is not on the keyboard or in the font.
_LOOK_ALIKES = str.maketrans("g:αγδεϵιλυφϕΦϐꞵϑꭓꭕı", "ɡːɑɣðɛɛɪʎʊɸɸɸββθχχɪ")


def compute_phone(symbol: str) -> Phone | None:
    """Compute the phone of an IPA symbol.

    Places of articulation that the 17 features lack are approximated: palatal and uvular are half
    velar, postalveolar is alveolar with protruded lips, and a glottal has no place. A trill is
    half a stop.

    Parameters
    ----------
    symbol
        One sound: a letter with its diacritics, an affricate (with or without a tie), or a
        diphthong.

    Returns
    -------
    Phone or None
        The phone; None where panphon does not know the symbol, or it is more than one sound.

    Raises
    ------
    MissingExtraError
        If panphon is not installed.
    """
    table = _load_feature_table()
    text = unicodedata.normalize("NFD", symbol).translate(_LOOK_ALIKES)
    symbol = unicodedata.normalize("NFC", text)
    marks = set(text)
    text = text.translate(_LEFT_OUT)
    parts = _split_sounds(text, table)
    # A tone by itself is no sound.
    if not parts or not text[0].isalpha():
        return None
    sounds = [(part, table[part]) for part in parts]
    if sounds[0][1]["syl"] == 1 and sounds[0][1]["cons"] == -1:
        # The second part of a diphthong may be written as not syllabic.
        if any(sound["cons"] == 1 or sound["hi"] == 0 for _, sound in sounds):
            return None
        each = [_compute_vowel(part, sound) for part, sound in sounds]
        values = {name: sum(v[name] for v in each) / len(each) for name in each[0]}
        if _COMPRESSED in marks:
            values["rounded"] = max(values["rounded"], 0.4)
        return _create_phone(symbol, "vowel", values)
    each = [_compute_consonant(part, sound) for part, sound in sounds]
    if len(each) == 2 and not (_is_affricate(each) or _TIES & marks or text[:2] in _DOUBLE):
        return None
    values = {name: max(v[name] for v in each) for name in each[0]}
    if len(each) == 2:
        values["voiced"] = each[1]["voiced"]
    if _RINGS & marks:
        values["voiced"] = 0.0
    return _create_phone(symbol, "consonant", values)


def _is_affricate(parts: Sequence[Mapping[str, float]]) -> bool:
    return parts[0]["stop"] == 1 and parts[1]["fricative"] == 1


def _create_phone(symbol: str, kind: PhoneClass, values: dict[str, float]) -> Phone:
    return Phone(symbol, kind, values, ipa=(symbol,), takes_stress=kind == "vowel")


def _split_sounds(text: str, table: Mapping[str, object]) -> list[str]:
    """Split a text into one or two sounds of the table, the longest first; empty for all else."""
    parts: list[str] = []
    while text:
        longest = min(len(text), _LONGEST_SOUND) if len(parts) < 2 else 0
        length = next((n for n in range(longest, 0, -1) if text[:n] in table), 0)
        if not length:
            return []
        parts.append(text[:length])
        text = text[length:]
    return parts


@functools.lru_cache(maxsize=1)
def _load_feature_table() -> dict[str, dict[str, int]]:
    """Return the features of all sounds of panphon, 1, 0 or -1, by their letters in NFD.

    The file is read here because `panphon.FeatureTable` takes more than a second for it.
    """
    file = resources.files(import_panphon()) / "data" / "ipa_all.csv"
    signs = {"+": 1, "0": 0, "-": -1}
    _, *names = next(rows := csv.reader(file.read_text(encoding="utf-8").splitlines()))
    return {
        unicodedata.normalize("NFD", letters): dict(
            zip(names, map(signs.__getitem__, row), strict=True)
        )
        for letters, *row in rows
    }


def import_panphon() -> Any:
    """Import panphon.

    Returns
    -------
    module
        The module.

    Raises
    ------
    MissingExtraError
        If it is not installed.
    """
    try:
        import panphon
    except ImportError:
        raise MissingExtraError(
            "the features of IPA sounds need panphon, which is not installed",
            advice="Run: pip install 'mocap-fit[speech]'",
        ) from None
    return panphon


def _compute_vowel(letters: str, sound: Any) -> dict[str, float]:
    values = dict.fromkeys(FEATURE_NAMES[1:-1], 0.0)
    tense = sound["tense"] == 1
    if sound["hi"] == 1:
        values["open"] = -1.0 if tense else -0.7
    elif sound["lo"] == 1:
        values["open"] = 1.0
    else:
        values["open"] = _NEAR_OPEN.get(letters[0], -0.4 if tense else 0.2)
    if letters[0] in _CENTRAL:
        values["front"] = 0.0
    else:
        values["front"] = -1.0 if sound["back"] == 1 else 1.0
    if sound["round"] == 1:
        # The more open, the less rounded; front rounded vowels push the lips out.
        values["rounded"] = 0.8 - 0.2 * values["open"]
        values["protruded"] = 0.8 if values["front"] == 1 else 0.4 - 0.2 * values["open"]
    elif values["front"] == 1:
        values["rounded"] = -0.5 + 0.5 * values["open"] if values["open"] < 0 else -0.4
        values["protruded"] = 0.5 * values["rounded"]
    values["voiced"] = float(sound["voi"] == 1)
    return values


def _compute_consonant(letters: str, sound: Any) -> dict[str, float]:
    values = dict.fromkeys(FEATURE_NAMES[1:-1], 0.0)
    # panphon has glottals as sonorants with a raised or retracted tongue.
    if letters[0] in _GLOTTAL_FRICATIVES:
        return values | {"fricative": 1.0, "voiced": float(letters[0] == "ɦ")}
    if letters[0] == "ʔ":
        return values | {"stop": 1.0}
    voiced = {"voiced": float(sound["voi"] == 1)}
    return (
        values
        | _compute_articulation(letters, sound)
        | _compute_manner(letters, sound)
        | _compute_lips(letters, sound)
        | voiced
    )


def _compute_articulation(letters: str, sound: Any) -> dict[str, float]:
    values: dict[str, float] = {}
    high, back = sound["hi"] == 1, sound["back"] == 1
    if letters[0] in _LABIODENTAL:
        values["labiodental"] = 1.0
    elif sound["lab"] == 1 and not (high and back):
        values["bilabial"] = 1.0
    coronal, anterior, laminal = (sound[name] == 1 for name in ("cor", "ant", "distr"))
    if letters[0] in _ALVEOLAR or (coronal and anterior and not laminal):
        values["alveolar"] = 1.0
    if coronal and anterior and (laminal or _BRIDGE in letters):
        # The bridge below the letter is the mark of a dental.
        values["dental"] = 1.0
    elif coronal and not anterior and not laminal and letters[0] not in _ALVEOLAR:
        values["retroflex"] = 1.0
    if high or back:
        values["velar"] = 1.0 if high and back else 0.5
    return values


def _compute_manner(letters: str, sound: Any) -> dict[str, float]:
    obstruent, continuous = sound["son"] == -1, sound["cont"] == 1
    affricate = sound["delrel"] == 1
    stop = obstruent and not continuous and (sound["cont"] == -1 or affricate)
    return {
        "nasal": float(sound["nas"] == 1),
        "stop": 0.5 if letters[0] in _TRILLS else float(stop),
        "fricative": float(obstruent and (continuous or affricate)),
    }


def _compute_lips(letters: str, sound: Any) -> dict[str, float]:
    if sound["round"] == 1:
        return {"rounded": 1.0, "protruded": 0.7}
    return dict(zip(("rounded", "protruded"), _LIPS.get(letters[0], ()), strict=False))
