"""Sentences of a small grammar: any number of them, different from each other, well-formed.

A language is a file in ``sentences/``: a grammar, and a lexicon with the phones of every word.
How to write one: see ``sentences/sv.toml``.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib import resources

import numpy as np
from pydantic import Field

from corpus_tools.simulation.durations import PAUSE, SpokenPhone, SpokenWord
from corpus_tools.simulation.traits import Strict, load_table
from mocap_fit.errors import ConfigurationError, DataError
from mocap_fit.phones import PhoneSet, load_phone_set

START = "SENTENCE"
_MARKS = (",", "?")
# Draws of a sentence before the grammar counts as used up.
_TRIES = 2000


@dataclass(frozen=True)
class Sentence:
    """A sentence and how it is said.

    Parameters
    ----------
    text
        As it is written.
    words
        In order, with `PAUSE` where there is a comma.
    """

    text: str
    words: tuple[SpokenWord, ...]


class LanguageFile(Strict):
    """A file of ``sentences/``, as it is written."""

    language: str
    phone_set: str
    length: tuple[int, int]
    stress: str = ""
    releases: bool = False
    before_vowels: dict[str, str] = Field(default={})
    voicing: dict[str, str] = Field(default={})
    voicing_neither: tuple[str, ...] = ()
    rules: dict[str, tuple[str, ...]]
    words: dict[str, str]


@dataclass(frozen=True, eq=False)
class Language:
    """A grammar and a lexicon.

    Parameters
    ----------
    language
        Tag, such as ``sv``.
    phone_set
        What the words' phones are from.
    rules
        Name of a rule → its alternatives, each a row of tokens.
    classes
        Name of a class → its words.
    lexicon
        Word → how it is said; several words where it is an expression of several.
    length
        Least and largest number of words.
    releases
        Whether the release of a stop is a phone of its own.
    before_vowels
        Word → what it is before a vowel.
    voicing
        Voiceless obstruent → its voiced partner, where they assimilate between words.
    voicing_neither
        Voiced phones that do not voice what is before them.
    """

    language: str
    phone_set: PhoneSet
    rules: Mapping[str, tuple[tuple[str, ...], ...]]
    classes: Mapping[str, tuple[str, ...]]
    lexicon: Mapping[str, tuple[SpokenWord, ...]]
    length: tuple[int, int]
    releases: bool = False
    before_vowels: Mapping[str, SpokenWord] = field(default_factory=dict)
    voicing: Mapping[str, str] = field(default_factory=dict)
    voicing_neither: frozenset[str] = frozenset()

    def sentences(self, count: int, rng: np.random.Generator) -> tuple[Sentence, ...]:
        """Draw sentences, no two alike.

        The first of them are the same whatever the count. Words that were used less are drawn
        more often.

        Raises
        ------
        DataError
            If the grammar does not have so many.
        """
        used: Counter[str] = Counter()
        found: dict[str, Sentence] = {}
        while len(found) < count:
            for _ in range(_TRIES):
                tokens = self._drawn(START, rng, used)
                said = [
                    part
                    for token in tokens
                    if token != "?"
                    for part in self.lexicon.get(token, (PAUSE,))
                ]
                words = [word.text for word in said if word.phones]
                content = [word.text for word in said if any(phone.stress for phone in word.phones)]
                sentence = self.spoken(said, "?" if tokens[-1] == "?" else ".")
                least, most = self.length
                if (
                    least <= len(words) <= most
                    and len(set(content)) == len(content)
                    and sentence.text not in found
                ):
                    break
            else:
                raise DataError(
                    f"the sentences of '{self.language}' do not suffice",
                    found=f"{len(found)} different ones",
                    expected=count,
                    advice="Ask for fewer utterances.",
                )
            used.update(tokens)
            found[sentence.text] = sentence
        return tuple(found.values())

    def read(self, text: str) -> Sentence:
        """Say a text of words that are in the lexicon.

        Raises
        ------
        DataError
            If words are not in the lexicon; all are listed.
        """
        every = {part.text.lower(): part for said in self.lexicon.values() for part in said}
        every |= {w.lower(): said[0] for w, said in self.lexicon.items() if len(said) == 1}
        tokens = re.findall(r",|[^\s,.!?]+", text)
        missing = [t for t in tokens if t != "," and t.lower() not in every]
        if missing:
            raise DataError(
                f"not in the lexicon of '{self.language}': {', '.join(missing)}",
                advice="Use words of the lexicon.",
            )
        return self.spoken([PAUSE if token == "," else every[token.lower()] for token in tokens])

    def spoken(self, words: Sequence[SpokenWord], mark: str = ".") -> Sentence:
        """Say words in a row, with `PAUSE` for each comma: what happens between words happens.

        Parameters
        ----------
        words
            As they are said alone.
        mark
            What the text ends with.
        """
        words = self._before_vowels(words)
        text = re.sub(r" ,", ",", " ".join(word.text or "," for word in words))
        following = [*words[1:], PAUSE]
        words = [
            SpokenWord(word.text, self._assimilated(word.phones, after.phones))
            for word, after in zip(words, following, strict=True)
        ]
        if self.releases:
            words = self._with_releases(words)
        return Sentence(f"{text[:1].upper()}{text[1:]}{mark}", tuple(words))

    def _before_vowels(self, words: Sequence[SpokenWord]) -> list[SpokenWord]:
        new = []
        for word, after in zip(words, [*words[1:], PAUSE], strict=True):
            vowel = bool(after.phones) and self.phone_set.is_vowel(after.phones[0].phone)
            new.append(self.before_vowels.get(word.text, word) if vowel else word)
        return new

    def _drawn(self, name: str, rng: np.random.Generator, used: Counter[str]) -> list[str]:
        alternatives = self.rules[name]
        tokens: list[str] = []
        for token in alternatives[int(rng.integers(len(alternatives)))]:
            if token in self.rules:
                tokens += self._drawn(token, rng, used)
            elif token.startswith("{"):
                words = self.classes[token[1:-1]]
                shares = np.array([1.0 / (1 + used[word]) ** 2 for word in words])
                tokens.append(words[int(rng.choice(len(words), p=shares / shares.sum()))])
            else:
                tokens.append(token)
        return tokens

    def _assimilated(
        self, phones: tuple[SpokenPhone, ...], after: tuple[SpokenPhone, ...]
    ) -> tuple[SpokenPhone, ...]:
        """The word with its last obstruents voiced or not, as the next word begins."""
        if not self.voicing or not after:
            return phones
        first = after[0].phone
        voiced = {partner: voiceless for voiceless, partner in self.voicing.items()}
        values = self.phone_set.get_phone(first).values
        if first in self.voicing_neither or max(values["stop"], values["fricative"]) < 1:
            return phones
        change = dict(self.voicing) if values["voiced"] else voiced
        new = list(phones)
        for i in range(len(new) - 1, -1, -1):
            if new[i].phone not in self.voicing and new[i].phone not in voiced:
                break
            new[i] = SpokenPhone(change.get(new[i].phone, new[i].phone), new[i].stress)
        return tuple(new)

    def _with_releases(self, words: Sequence[SpokenWord]) -> list[SpokenWord]:
        """Stops that are released: those before anything but another stop, or their own nasal."""
        released = {
            self._place(phone.symbol): phone.symbol
            for phone in self.phone_set.phones
            if phone.values["release"]
        }
        new = []
        for i, word in enumerate(words):
            following = words[i + 1].phones[:1] if i + 1 < len(words) else ()
            phones: list[SpokenPhone] = []
            afters = (*word.phones[1:], *(following or (None,)))[: len(word.phones)]
            for phone, after in zip(word.phones, afters, strict=True):
                phones.append(phone)
                if self.phone_set.get_phone(phone.phone).values["stop"] != 1:
                    continue
                closed = after is not None and self._closes(phone.phone, after.phone)
                if not closed:
                    phones.append(SpokenPhone(released[self._place(phone.phone)]))
            new.append(SpokenWord(word.text, tuple(phones)))
        return new

    def _closes(self, phone: str, after: str) -> bool:
        values = self.phone_set.get_phone(after).values
        same = self._place(phone) == self._place(after)
        return values["stop"] == 1 or (values["nasal"] == 1 and same)

    def _place(self, symbol: str) -> tuple[str, ...]:
        values = self.phone_set.get_phone(symbol).values
        places = ("bilabial", "dental", "retroflex", "velar")
        return tuple(place for place in places if values[place])


def languages() -> tuple[str, ...]:
    """The languages that there are sentences of."""
    folder = resources.files("corpus_tools.simulation").joinpath("sentences")
    return tuple(sorted(f.name[:-5] for f in folder.iterdir() if f.name.endswith(".toml")))


def load_language(language: str) -> Language:
    """Read the grammar and the lexicon of a language.

    Raises
    ------
    ConfigurationError
        If there is none, or it contradicts itself.
    """
    if language not in languages():
        raise ConfigurationError(
            f"there are no sentences of the language '{language}'",
            expected=", ".join(languages()),
        )
    file = f"sentences/{language}.toml"
    return read_language(load_table(file, LanguageFile), file)


def read_language(content: LanguageFile, file: str) -> Language:
    """Check a language's file and make it ready.

    Raises
    ------
    ConfigurationError
        If words, classes, rules or phones are missing or doubled; all of them are listed.
    """
    phone_set = load_phone_set(content.phone_set)
    faults: list[str] = []
    classes: dict[str, tuple[str, ...]] = {}
    lexicon: dict[str, tuple[SpokenWord, ...]] = {}
    for name, lines in content.words.items():
        members = []
        for line in filter(None, map(str.strip, lines.splitlines())):
            word, _, rest = line.partition(" ")
            first = content.stress == "first" and not name.startswith("weak")
            said = _said(word, rest, phone_set, first)
            if said is None:
                faults.append(f"phones of '{word}'")
                continue
            if lexicon.setdefault(word, said) != said:
                faults.append(f"'{word}' in two ways")
            members.append(word)
        if len(set(members)) < len(members):
            faults.append(f"'{name}' has a word twice")
        classes[name] = tuple(members)
    before_vowels = {}
    for word, line in content.before_vowels.items():
        text, _, rest = line.partition(" ")
        said = _said(text, rest, phone_set, first_stressed=False)
        if said is None or word not in lexicon:
            faults.append(f"'{word}' before vowels")
        else:
            before_vowels[word] = said[0]
    rules = {name: tuple(tuple(a.split()) for a in alts) for name, alts in content.rules.items()}
    for name, alternatives in rules.items():
        for token in {token for alternative in alternatives for token in alternative}:
            known = token in rules or token in _MARKS or token in lexicon or token[1:-1] in classes
            if not known:
                faults.append(f"'{token}' in {name}")
    if START not in rules:
        faults.append(f"no rule {START}")
    if faults:
        raise ConfigurationError(
            "the sentences have faults", path=file, found="; ".join(sorted(faults))
        )
    return Language(
        content.language,
        phone_set,
        rules,
        classes,
        lexicon,
        content.length,
        content.releases,
        before_vowels,
        content.voicing,
        frozenset(content.voicing_neither),
    )


def _said(
    word: str, phones: str, phone_set: PhoneSet, first_stressed: bool
) -> tuple[SpokenWord, ...] | None:
    """The words of a line of the lexicon; None where the phones are no phones."""
    texts, parts = word.split("_"), phones.split("|")
    parsed = [_phones(part.split(), phone_set) for part in parts]
    if len(texts) != len(parts) or None in parsed:
        return None
    said = [found for found in parsed if found is not None]
    if first_stressed and not any(phone.stress for found in said for phone in found):
        said = [_first_stressed(found) for found in said]
    return tuple(map(SpokenWord, texts, said))


def _phones(symbols: Sequence[str], phone_set: PhoneSet) -> tuple[SpokenPhone, ...] | None:
    parsed = [phone_set.parse(symbol) for symbol in symbols]
    if not parsed or None in parsed:
        return None
    return tuple(
        SpokenPhone(phone, (stress or 0) if phone_set.get_phone(phone).takes_stress else None)
        for phone, stress in (found for found in parsed if found is not None)
    )


def _first_stressed(phones: tuple[SpokenPhone, ...]) -> tuple[SpokenPhone, ...]:
    for i, phone in enumerate(phones):
        if phone.stress is not None:
            return (*phones[:i], SpokenPhone(phone.phone, 1), *phones[i + 1 :])
    return phones
