"""How long phones last: a model after Klatt (1979), with its numbers in ``durations.toml``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from pydantic import Field

from corpus_tools.simulation.traits import Rule, get_traits, load_table
from mocap_fit.phones import PhoneSegment, PhoneSequence, PhoneSet
from mocap_fit.settings_file import StrictModel

# Times are written to a tenth of a millisecond.
_DECIMALS = 4


@dataclass(frozen=True)
class SpokenPhone:
    """A phone of a word that is to be said.

    Parameters
    ----------
    phone
        Symbol of the phone set, without stress.
    stress
        0, 1 or 2; None for phones that take no stress.
    """

    phone: str
    stress: int | None = None


@dataclass(frozen=True)
class SpokenWord:
    """A word that is to be said; one without phones is a pause.

    Parameters
    ----------
    text
        The word as it is written, without punctuation.
    phones
        Its phones, in order.
    """

    text: str
    phones: tuple[SpokenPhone, ...] = ()


PAUSE = SpokenWord("")
"""A short pause between words."""


class _Inherent(Rule):
    inherent: float
    least: float


class _Rules(StrictModel):
    before_pause: float
    word_final: float
    unstressed_vowel: float
    secondary_vowel: float
    unstressed_consonant: float
    stressed_vowel: float
    long_word: float
    long_word_least: float
    cluster: float
    word_first: float
    before_voiceless: float
    after_short_vowel: float


class _Noise(StrictModel):
    rate: float
    phone: float


class _Pauses(StrictModel):
    before: tuple[float, float]
    after: tuple[float, float]
    comma: tuple[float, float]


class Durations(StrictModel):
    """The settings of the duration model, ``durations.toml``."""

    phones: tuple[_Inherent, ...]
    rules: _Rules
    noise: _Noise
    pauses: _Pauses
    languages: dict[str, dict[str, float]] = Field(default={})

    def get_rules(self, language: str) -> _Rules:
        """Return the rules of a language.

        Parameters
        ----------
        language
            Tag of the language, such as ``sv``.

        Returns
        -------
        _Rules
            The general rules, with the exceptions of the language.
        """
        return self.rules.model_copy(update=self.languages.get(language, {}))


@cache
def load_durations() -> Durations:
    """Load the table that comes with the simulation.

    Returns
    -------
    Durations
        Durations of all phones, and the rules that change them.
    """
    return load_table("durations", Durations)


def time_words(
    words: Sequence[SpokenWord],
    phone_set: PhoneSet,
    rng: np.random.Generator,
    *,
    name: str = "",
    start: float = 0.0,
    end: float = 0.0,
    table: Durations | None = None,
) -> PhoneSequence:
    """Compute the times of the phones of a sentence, after Klatt (1979).

    Parameters
    ----------
    words
        The words, with `PAUSE` wherever the speaker pauses; silence before and after is added.
    phone_set
        The set of their phones.
    rng
        Generator of the speaker's rate and of the noise.
    name
        Name of the utterance.
    start, end
        Silence that is added before and after, seconds.
    table
        The duration model; the one that comes with the simulation where it is None.

    Returns
    -------
    PhoneSequence
        The phones from 0 on, without gaps. The noise is clipped at 2.5 standard deviations, so
        that no phone has a duration of 0.
    """
    table = load_durations() if table is None else table
    rules = table.get_rules(phone_set.language)
    rate = np.exp(_draw_clipped(rng, table.noise.rate))
    symbols = {phone.phone for word in words for phone in word.phones}
    known = {symbol: get_traits(phone_set.get_phone(symbol)) for symbol in symbols}
    segments: list[PhoneSegment] = []
    clock = 0.0

    def append(seconds: float, symbol: str, stress: int | None = None, word: str = "") -> None:
        nonlocal clock
        stop = round(clock + seconds, _DECIMALS)
        segments.append(PhoneSegment(clock, stop, symbol, stress, word))
        clock = stop

    silence = phone_set.silence
    append(start + rng.uniform(*table.pauses.before), silence)
    for i, word in enumerate(words):
        if not word.phones:
            append(rng.uniform(*table.pauses.comma), silence)
            continue
        last = i + 1 == len(words) or not words[i + 1].phones
        every = [known[phone.phone] for phone in word.phones]
        shares = _compute_shares(word, last, every, rules)
        for phone, traits, share in zip(word.phones, every, shares, strict=True):
            kind = next(rule for rule in table.phones if rule.is_met_by(traits))
            milliseconds = kind.least + (kind.inherent - kind.least) * share
            seconds = milliseconds / 1000 * rate * np.exp(_draw_clipped(rng, table.noise.phone))
            append(float(seconds), phone.phone, phone.stress, word.text)
    # The utterance ends at a full millisecond, and so at a sample.
    append(np.ceil((clock + rng.uniform(*table.pauses.after) + end) * 1000) / 1000 - clock, silence)
    return PhoneSequence(tuple(segments), phone_set=phone_set.name, name=name)


def _draw_clipped(rng: np.random.Generator, deviation: float) -> float:
    return float(deviation * np.clip(rng.standard_normal(), -2.5, 2.5))


def _compute_shares(
    word: SpokenWord, last: bool, traits: list[dict[str, float]], rules: _Rules
) -> list[float]:
    """Return Klatt's p of every phone of a word."""
    vowels = [i for i, f in enumerate(traits) if f["vowel"]]
    speech = [i for i, f in enumerate(traits) if not f["release"]]
    long_word = max(rules.long_word ** max(0, len(vowels) - 2), rules.long_word_least)
    shares = []
    for i, (phone, current) in enumerate(zip(word.phones, traits, strict=True)):
        share = 1.0
        if vowels and i >= vowels[-1]:
            share *= rules.before_pause if last else rules.word_final
        elif last and not vowels:
            share *= rules.before_pause
        index = speech.index(i) if i in speech else -1
        before = traits[speech[index - 1]] if index > 0 else None
        after = traits[speech[index + 1]] if 0 <= index < len(speech) - 1 else None
        if current["vowel"]:
            share *= long_word
            levels = (rules.unstressed_vowel, rules.stressed_vowel, rules.secondary_vowel)
            share *= levels[phone.stress or 0]
            obstruent = after is not None and max(after["stop"], after["fricative"]) == 1
            if after is not None and obstruent and not after["voiced"]:
                share *= rules.before_voiceless
        elif current["consonant"] and not current["release"]:
            share *= _scale_consonant(i, word, traits, before, after, rules)
        shares.append(share)
    return shares


def _scale_consonant(
    i: int,
    word: SpokenWord,
    traits: list[dict[str, float]],
    before: dict[str, float] | None,
    after: dict[str, float] | None,
    rules: _Rules,
) -> float:
    share = 1.0
    if (before and before["consonant"]) or (after and after["consonant"]):
        share *= rules.cluster
    if i == 0:
        share *= rules.word_first
    following = [p.stress for p, f in zip(word.phones[i:], traits[i:], strict=True) if f["vowel"]]
    preceding = [p.stress for p, f in zip(word.phones[:i], traits[:i], strict=True) if f["vowel"]]
    if not (following or preceding or [0])[0]:
        share *= rules.unstressed_consonant
    if before and before["vowel"] and not before["long"] and preceding and preceding[-1] == 1:
        share *= rules.after_short_vowel
    return share
