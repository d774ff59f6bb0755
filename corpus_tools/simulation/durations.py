"""How long phones last: a model after Klatt (1979), with its numbers in ``durations.toml``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from pydantic import Field

from corpus_tools.simulation.traits import Rule, Strict, load_table, traits
from mocap_fit.phones import PhoneSegment, PhoneSequence, PhoneSet

# Times are written to a tenth of a millisecond.
_DECIMALS = 4


@dataclass(frozen=True)
class SpokenPhone:
    """A phone to be said.

    Parameters
    ----------
    phone
        Symbol of the phone set, without stress.
    stress
        0, 1, 2, or None of what takes none.
    """

    phone: str
    stress: int | None = None


@dataclass(frozen=True)
class SpokenWord:
    """A word to be said; one without phones is a pause.

    Parameters
    ----------
    text
        As it is written, without punctuation.
    phones
        In order.
    """

    text: str
    phones: tuple[SpokenPhone, ...] = ()


PAUSE = SpokenWord("")
"""A short pause between words."""


class _Inherent(Rule):
    inherent: float
    least: float


class _Rules(Strict):
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


class _Noise(Strict):
    rate: float
    phone: float


class _Pauses(Strict):
    before: tuple[float, float]
    after: tuple[float, float]
    comma: tuple[float, float]


class Durations(Strict):
    """The table ``durations.toml``."""

    phones: tuple[_Inherent, ...]
    rules: _Rules
    noise: _Noise
    pauses: _Pauses
    languages: dict[str, dict[str, float]] = Field(default={})

    def rules_of(self, language: str) -> _Rules:
        """The rules, with what a language does otherwise."""
        return self.rules.model_copy(update=self.languages.get(language, {}))


@cache
def load_durations() -> Durations:
    """Read the shipped table."""
    return load_table("durations.toml", Durations)


def spoken(
    words: Sequence[SpokenWord],
    phone_set: PhoneSet,
    rng: np.random.Generator,
    *,
    name: str = "",
    start: float = 0.0,
    end: float = 0.0,
    table: Durations | None = None,
) -> PhoneSequence:
    """Give the words of a sentence times.

    Parameters
    ----------
    words
        With `PAUSE` wherever the speaker pauses; silence before and after is added.
    phone_set
        The set of their phones.
    rng
        Of the speaker's rate and noise.
    name
        Of the utterance.
    start, end
        Seconds of silence that come in addition, before and after.
    table
        The shipped one where not given.

    Returns
    -------
    PhoneSequence
        From 0, without gaps. The noise is clipped at 2.5 standard deviations, so that no phone is
        ever of no length.
    """
    table = load_durations() if table is None else table
    rules = table.rules_of(phone_set.language)
    rate = np.exp(_clipped(rng, table.noise.rate))
    symbols = {phone.phone for word in words for phone in word.phones}
    known = {symbol: traits(phone_set.get_phone(symbol)) for symbol in symbols}
    segments: list[PhoneSegment] = []
    clock = 0.0

    def put(seconds: float, symbol: str, stress: int | None = None, word: str = "") -> None:
        nonlocal clock
        stop = round(clock + seconds, _DECIMALS)
        segments.append(PhoneSegment(clock, stop, symbol, stress, word))
        clock = stop

    silence = phone_set.silence
    put(start + rng.uniform(*table.pauses.before), silence)
    for i, word in enumerate(words):
        if not word.phones:
            put(rng.uniform(*table.pauses.comma), silence)
            continue
        last = i + 1 == len(words) or not words[i + 1].phones
        every = [known[phone.phone] for phone in word.phones]
        shares = _shares(word, last, every, rules)
        for phone, found, share in zip(word.phones, every, shares, strict=True):
            kind = next(rule for rule in table.phones if rule.holds(found))
            milliseconds = kind.least + (kind.inherent - kind.least) * share
            seconds = milliseconds / 1000 * rate * np.exp(_clipped(rng, table.noise.phone))
            put(float(seconds), phone.phone, phone.stress, word.text)
    # The whole is a number of milliseconds, and so of samples.
    put(np.ceil((clock + rng.uniform(*table.pauses.after) + end) * 1000) / 1000 - clock, silence)
    return PhoneSequence(tuple(segments), phone_set=phone_set.name, name=name)


def _clipped(rng: np.random.Generator, deviation: float) -> float:
    return float(deviation * np.clip(rng.standard_normal(), -2.5, 2.5))


def _shares(
    word: SpokenWord, last: bool, found: list[dict[str, float]], rules: _Rules
) -> list[float]:
    """Klatt's p of every phone of a word, whose traits are given."""
    vowels = [i for i, f in enumerate(found) if f["vowel"]]
    speech = [i for i, f in enumerate(found) if not f["release"]]
    long_word = max(rules.long_word ** max(0, len(vowels) - 2), rules.long_word_least)
    shares = []
    for i, (phone, own) in enumerate(zip(word.phones, found, strict=True)):
        share = 1.0
        if vowels and i >= vowels[-1]:
            share *= rules.before_pause if last else rules.word_final
        elif last and not vowels:
            share *= rules.before_pause
        place = speech.index(i) if i in speech else -1
        before = found[speech[place - 1]] if place > 0 else None
        after = found[speech[place + 1]] if 0 <= place < len(speech) - 1 else None
        if own["vowel"]:
            share *= long_word
            share *= {
                0: rules.unstressed_vowel,
                1: rules.stressed_vowel,
                2: rules.secondary_vowel,
            }.get(phone.stress or 0, 1.0)
            obstruent = after is not None and max(after["stop"], after["fricative"]) == 1
            if after is not None and obstruent and not after["voiced"]:
                share *= rules.before_voiceless
        elif own["consonant"] and not own["release"]:
            share *= _of_consonant(i, word, found, before, after, rules)
        shares.append(share)
    return shares


def _of_consonant(
    i: int,
    word: SpokenWord,
    found: list[dict[str, float]],
    before: dict[str, float] | None,
    after: dict[str, float] | None,
    rules: _Rules,
) -> float:
    share = 1.0
    if (before and before["consonant"]) or (after and after["consonant"]):
        share *= rules.cluster
    if i == 0:
        share *= rules.word_first
    following = [p.stress for p, f in zip(word.phones[i:], found[i:], strict=True) if f["vowel"]]
    preceding = [p.stress for p, f in zip(word.phones[:i], found[:i], strict=True) if f["vowel"]]
    if not (following or preceding or [0])[0]:
        share *= rules.unstressed_consonant
    if before and before["vowel"] and not before["long"] and preceding and preceding[-1] == 1:
        share *= rules.after_short_vowel
    return share
