"""The voices of espeak-ng by language, and what is known of three of them."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True)
class EspeakVoice:
    """A voice of espeak-ng, and the phone set for it.

    Parameters
    ----------
    name
        Name of the voice in espeak-ng, or a tag of its language.
    phone_set
        The phone set of its language.
    replacements
        Names of sounds in the voice and the same sounds in the IPA of the phone set, with blanks
        between several.
    pairs
        Pairs of sounds in a word and the one, or the two (with a blank), that they are in this
        language.
    syllabic
        Where the voice needs the mark of a syllabic sound; None if it never does.
    """

    name: str
    phone_set: str = "ipa"
    replacements: Mapping[str, str] = field(default_factory=dict)
    pairs: Mapping[tuple[str, str], str] = field(default_factory=dict)
    syllabic: re.Pattern[str] | None = None

    def mark_syllabic(self, text: str) -> str:
        """Mark the syllabic sounds that the voice does not recognise by itself.

        Parameters
        ----------
        text
            A text.

        Returns
        -------
        str
            The text with a mark below each of them.
        """
        if self.syllabic is None:
            return text
        return self.syllabic.sub(lambda word: _AFTER_CONSONANT.sub(SYLLABIC, word[0]), text)


SYLLABIC = "\N{COMBINING VERTICAL LINE BELOW}"
_AFTER_CONSONANT = re.compile("(?<=.l)")
# A Czech word with l for its vowel, such as vlk: espeak-ng spells it letter by letter. In capitals
# it is an abbreviation.
_ONE = "[bcdfghjklmnpqstvwxzčďňřšťž]"
_CZECH_L = re.compile(rf"\b(?:{_ONE}|[A-ZČĎŇŘŠŤŽ]){_ONE}{{0,8}}l{_ONE}{{1,8}}\b")

LANGUAGES: dict[str, EspeakVoice] = {
    "sv": EspeakVoice(
        "sv",
        "sv-sta",
        {"sx": "ɧ", "ʃ": "ɧ", "y": "ʏ", "œ": "ø"},
        # The voice has few of the retroflexes of Central Swedish, and no open vowels before r.
        {
            ("ɛ", "r"): "æ r",
            ("ɛː", "r"): "æː r",
            ("ø", "r"): "œ r",
            ("øː", "r"): "œː r",
            ("r", "t"): "ʈ",
            ("r", "d"): "ɖ",
            ("r", "n"): "ɳ",
            ("r", "s"): "ʂ",
            ("r", "l"): "ɭ",
        },
    ),
    "cs": EspeakVoice("cs", "cs-sampa", {"dʑ": "d͡z"}, syllabic=_CZECH_L),
    "en": EspeakVoice(
        "en-us",
        "en-arpabet",
        {"ɾ": "d", "ᵻ": "ɪ", "ɐ": "ə", "ʔ": "t", "ɜː": "ɝ", "iə": "i ə", "aɪə": "aɪ ə"},
        {("ɹ", "ɹ"): "ɹ"},
    ),
}
"""Languages with a phone set. Any other name is a voice of espeak-ng, with IPA."""

# Tags that espeak-ng does not know, and what is nearest to them there.
_OTHERS = {"nn": "nb", "iw": "he", "in": "id", "mo": "ro", "sh": "hr", "tl": "id"}


def find_language(tag: str) -> str:
    """Find the language of a tag among those with a phone set.

    Parameters
    ----------
    tag
        A tag of a language, such as ``sv-SE`` or ``en_US``.

    Returns
    -------
    str
        One of `LANGUAGES`, or the tag.
    """
    language, _, region = tag.strip().replace("_", "-").casefold().partition("-")
    # Other regions have English voices of their own.
    if language in LANGUAGES and (language != "en" or region in ("", "us")):
        return language
    return tag


def find_voice(language: str) -> EspeakVoice:
    """Find the voice of a language.

    Parameters
    ----------
    language
        A tag of the language, such as ``sv``, ``sv-SE``, ``no`` or ``pt_BR``, or the name of a
        voice.

    Returns
    -------
    EspeakVoice
        The voice; espeak-ng decides whether there is one.
    """
    language = find_language(language)
    if language in LANGUAGES:
        return LANGUAGES[language]
    first = re.split("[-_]", language.strip().casefold())[0]
    return EspeakVoice(_OTHERS.get(first, language))
