"""Read the names that espeak-ng gives to phones: IPA with marks of its own.

Most voices name their phones in IPA. Some go on in the voice of another language, which is said in
brackets, and in many some phones are left as they are written in the tables of espeak-ng, which
resemble X-SAMPA. Aspiration may be a plain h, palatalisation a phone of its own.
"""

from __future__ import annotations

import re
import unicodedata

from mocap_fit.phones import PhoneSet

STRESS = {"ˈ": 1, "ˌ": 2}
_MARKS = "".join(STRESS)
# "(en)": the voice of another language goes on. Names are cut after eight bytes.
_CHANGE_OF_VOICE = re.compile(r"\([^)]*\)?")
# A phone of its own that is more than a mark.
_ALONE = {"ʲ": "j", "ʷ": "w", "ʰ": "h", "ᵐ": "m", "ⁿ": "n", "ᵑ": "ŋ"}
_SPELLINGS = (
    ("oe", "ø"),
    ("aa", "aː"),
    ("nɡ|ng", "ŋ"),
    ('u"', "ʉ"),
    (r"s\.", "ʂ"),
    (r"z\.", "ʐ"),
    (r"[rɹ]\.", "ɽ"),
    ("_?h(?=$)(?<=[pbtdkɡqcsʂɕʃ]h|_h)", "ʰ"),
    ("#", "\N{COMBINING RING BELOW}"),
    (r"\[", "\N{COMBINING BRIDGE BELOW}"),
    (r"(?<=[bcdfɡklmnprstvz])\^", "ʲ"),
)
_LETTERS = str.maketrans(
    {"ʦ": "ts", "ʧ": "tʃ", "ʨ": "tɕ", "ʣ": "dz", "ʤ": "dʒ", "ʥ": "dʑ", "ᵻ": "ɪ", "?": "ʔ"}
    | {"ᵐ": "m", "ⁿ": "n", "ᵑ": "ŋ"}
    | dict(zip("ABCDEFGHIJKLMNOPQRSTUVWXYZ", "ɑβçðɛɱɣɥɪɲɬʎɯŋɔʋɒʁʃθʊʌʍχʏʒ", strict=True))
)
# What no phone is like.
_NEUTRAL = "ə"


def clean_name(name: str) -> str:
    """Remove from the name of a phone what is no sound.

    Parameters
    ----------
    name
        A name of espeak-ng, with stress before it.

    Returns
    -------
    str
        The name, with stress; empty where nothing of it is a sound.
    """
    name = _CHANGE_OF_VOICE.sub("", name)
    return name if any(map(_is_letter, name)) or name.lstrip(_MARKS) in _ALONE else ""


def split_name(name: str, ipa: PhoneSet) -> tuple[list[str], dict[str, str]]:
    """Split the name of a phone, without stress, into phones of the IPA.

    Parameters
    ----------
    name
        A name of espeak-ng, with blanks where it is certain that another phone begins.
    ipa
        The phone set of the IPA.

    Returns
    -------
    phones
        One, or several where the voice names them as one.
    unknown
        What is not understood, and the phone that is taken instead.
    """
    phones: list[str] = []
    unknown: dict[str, str] = {}
    for text in name.split():
        text = _ALONE.get(text, text)
        for pattern, spelling in _SPELLINGS:
            text = re.sub(pattern, spelling, text)
        text = text.translate(_LETTERS)
        while text:
            known = (n for n in range(len(text), 0, -1) if ipa.parse(text[:n]) is not None)
            length = next(known, 0)
            if length:
                phones.append(text[:length])
            elif _is_letter(text[0]):
                unknown[text[0]] = guess_phone(text[0], ipa)
                phones.append(unknown[text[0]])
            # Tones, borders of syllables, and what only modifies a sound without such a variant.
            text = text[max(length, 1) :].lstrip(_MARKS)
    return phones, unknown


def guess_phone(letter: str, ipa: PhoneSet) -> str:
    """Return the phone of a letter that is not of the IPA: that of the letter it derives from.

    Parameters
    ----------
    letter
        A letter of any script.
    ipa
        The phone set of the IPA.

    Returns
    -------
    str
        A phone; the neutral vowel where nothing is known of the letter.
    """
    name = unicodedata.name(letter, "")
    # Such as LATIN SMALL LETTER K WITH HOOK.
    base = re.search(r" LETTER (?:[A-Z]+ )*?([A-Z])(?: WITH .*)?$", name)
    candidates = [unicodedata.normalize("NFKD", letter).lower()[:1]]
    candidates += [base[1].lower()] if base else []
    return next(
        (c for c in candidates if ipa.parse(c) not in (None, (ipa.silence, None))), _NEUTRAL
    )


def _is_letter(character: str) -> bool:
    """Return whether a character is a letter, and not one that only modifies another."""
    return character == "?" or (character.isalpha() and unicodedata.category(character) != "Lm")
