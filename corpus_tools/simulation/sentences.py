"""Sentences of a small grammar: any number of them, different from each other, well-formed.

A language is a file in ``sentences/``: a grammar, and a lexicon with the phones of every word.
How to write one: see ``sentences/sv.toml``.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from pydantic import Field

from corpus_tools.simulation.durations import PAUSE, SpokenPhone, SpokenWord
from corpus_tools.simulation.traits import load_table
from mocap_fit.errors import ConfigurationError, DataError
from mocap_fit.phones import PhoneSet, load_phone_set
from mocap_fit.settings_file import StrictModel, list_shipped

START = "SENTENCE"
_MARKS = (",", "?")
# Draws of a sentence before the grammar counts as used up.
_TRIES = 2000


@dataclass(frozen=True)
class Sentence:
    """A sentence and its phones.

    Parameters
    ----------
    text
        The sentence as it is written.
    words
        Its words in order, with `PAUSE` where there is a comma.
    """

    text: str
    words: tuple[SpokenWord, ...]


class LanguageFile(StrictModel):
    """The settings of a language, a file of ``sentences/``.

    Parameters
    ----------
    language
        Tag, such as ``sv``.
    phone_set
        Name of the phone set of the words' phones.
    length
        Least and largest number of words.
    stress
        ``first`` where the first vowel of a word has the stress if none is marked.
    releases
        Whether the release of a stop is a separate phone.
    before_vowels
        Forms of words before a vowel with their phones, by their spelling.
    voicing
        Voiced partners of voiceless obstruents that assimilate between words.
    voicing_neither
        Voiced phones that do not voice the obstruent before them.
    rules
        Alternatives of each rule, by its name.
    words
        Words of each class with their phones, a line each, by the name of the class.
    """

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
    settings
        The settings, as the file of the language has them.
    phone_set
        The set of the words' phones.
    rules
        Alternatives of each rule, by its name; an alternative is a row of tokens.
    classes
        Words of each class, by its name.
    lexicon
        Words with their phones, by their spelling; several for an expression of several words.
    before_vowels
        Forms of words before a vowel, by their spelling.
    """

    settings: LanguageFile
    phone_set: PhoneSet
    rules: Mapping[str, tuple[tuple[str, ...], ...]]
    classes: Mapping[str, tuple[str, ...]]
    lexicon: Mapping[str, tuple[SpokenWord, ...]]
    before_vowels: Mapping[str, SpokenWord]

    def draw_sentences(self, count: int, rng: np.random.Generator) -> tuple[Sentence, ...]:
        """Draw different sentences.

        The first sentences do not depend on the count. Words that were used less are drawn more
        often.

        Parameters
        ----------
        count
            Number of sentences.
        rng
            Generator of the choices.

        Returns
        -------
        tuple of Sentence
            As many as asked for, no two alike.

        Raises
        ------
        DataError
            If the grammar does not have so many.
        """
        used: Counter[str] = Counter()
        sentences: dict[str, Sentence] = {}
        while len(sentences) < count:
            for _ in range(_TRIES):
                tokens = self._draw_tokens(START, rng, used)
                parts = [self.lexicon.get(token, (PAUSE,)) for token in tokens if token != "?"]
                entry = [word for part in parts for word in part]
                words = [word for word in entry if word.phones]
                content = [word.text for word in words if any(p.stress for p in word.phones)]
                sentence = self.say(entry, "?" if tokens[-1] == "?" else ".")
                least, most = self.settings.length
                if (
                    least <= len(words) <= most
                    and len(set(content)) == len(content)
                    and sentence.text not in sentences
                ):
                    break
            else:
                raise DataError(
                    f"the sentences of '{self.settings.language}' do not suffice",
                    found=f"{len(sentences)} different ones",
                    expected=count,
                    advice="Ask for fewer utterances.",
                )
            used.update(tokens)
            sentences[sentence.text] = sentence
        return tuple(sentences.values())

    def read(self, text: str) -> Sentence:
        """Return the phones of a text whose words are in the lexicon.

        Parameters
        ----------
        text
            Words and commas.

        Returns
        -------
        Sentence
            The text with its phones.

        Raises
        ------
        DataError
            If words are not in the lexicon; all are listed.
        """
        every = {part.text.lower(): part for entry in self.lexicon.values() for part in entry}
        every |= {w.lower(): entry[0] for w, entry in self.lexicon.items() if len(entry) == 1}
        tokens = re.findall(r",|[^\s,.!?]+", text)
        missing = [t for t in tokens if t != "," and t.lower() not in every]
        if missing:
            raise DataError(
                f"not in the lexicon of '{self.settings.language}': {', '.join(missing)}",
                advice="Use words of the lexicon.",
            )
        return self.say([PAUSE if token == "," else every[token.lower()] for token in tokens])

    def say(self, words: Sequence[SpokenWord], mark: str = ".") -> Sentence:
        """Join words to a sentence, with the changes of phones that happen between words.

        Parameters
        ----------
        words
            The words as they are said alone, with `PAUSE` for each comma.
        mark
            The mark at the end of the text.

        Returns
        -------
        Sentence
            The sentence with its phones.
        """
        words = self._replace_before_vowels(words)
        text = re.sub(r" ,", ",", " ".join(word.text or "," for word in words))
        following = [*words[1:], PAUSE]
        words = [
            SpokenWord(word.text, self._assimilate(word.phones, after.phones))
            for word, after in zip(words, following, strict=True)
        ]
        if self.settings.releases:
            words = self._insert_releases(words)
        return Sentence(f"{text[:1].upper()}{text[1:]}{mark}", tuple(words))

    def _replace_before_vowels(self, words: Sequence[SpokenWord]) -> list[SpokenWord]:
        new = []
        for word, after in zip(words, [*words[1:], PAUSE], strict=True):
            vowel = bool(after.phones) and self.phone_set.is_vowel(after.phones[0].phone)
            new.append(self.before_vowels.get(word.text, word) if vowel else word)
        return new

    def _draw_tokens(self, name: str, rng: np.random.Generator, used: Counter[str]) -> list[str]:
        alternatives = self.rules[name]
        tokens: list[str] = []
        for token in alternatives[int(rng.integers(len(alternatives)))]:
            if token in self.rules:
                tokens += self._draw_tokens(token, rng, used)
            elif token.startswith("{"):
                words = self.classes[token[1:-1]]
                shares = np.array([1.0 / (1 + used[word]) ** 2 for word in words])
                tokens.append(words[int(rng.choice(len(words), p=shares / shares.sum()))])
            else:
                tokens.append(token)
        return tokens

    def _assimilate(
        self, phones: tuple[SpokenPhone, ...], after: tuple[SpokenPhone, ...]
    ) -> tuple[SpokenPhone, ...]:
        """Voice or devoice the last obstruents of a word by the first phone of the next."""
        voicing = self.settings.voicing
        if not voicing or not after:
            return phones
        first = after[0].phone
        voiced = {partner: voiceless for voiceless, partner in voicing.items()}
        values = self.phone_set.get_phone(first).values
        if first in self.settings.voicing_neither or max(values["stop"], values["fricative"]) < 1:
            return phones
        change = voicing if values["voiced"] else voiced
        new = list(phones)
        for i in range(len(new) - 1, -1, -1):
            if new[i].phone not in voicing and new[i].phone not in voiced:
                break
            new[i] = SpokenPhone(change.get(new[i].phone, new[i].phone), new[i].stress)
        return tuple(new)

    def _insert_releases(self, words: Sequence[SpokenWord]) -> list[SpokenWord]:
        """Insert the releases of stops, but not before a stop or their own nasal."""
        released = {
            self._get_articulation(phone.symbol): phone.symbol
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
                closed = after is not None and self._is_before_closure(phone.phone, after.phone)
                if not closed:
                    phones.append(SpokenPhone(released[self._get_articulation(phone.phone)]))
            new.append(SpokenWord(word.text, tuple(phones)))
        return new

    def _is_before_closure(self, phone: str, after: str) -> bool:
        values = self.phone_set.get_phone(after).values
        same = self._get_articulation(phone) == self._get_articulation(after)
        return values["stop"] == 1 or (values["nasal"] == 1 and same)

    def _get_articulation(self, symbol: str) -> tuple[str, ...]:
        values = self.phone_set.get_phone(symbol).values
        articulations = ("bilabial", "dental", "retroflex", "velar")
        return tuple(name for name in articulations if values[name])


def list_languages() -> tuple[str, ...]:
    """List the languages that sentences can be simulated in.

    Returns
    -------
    tuple of str
        Tags of the languages, sorted.
    """
    return list_shipped("corpus_tools.simulation", "sentences")


def load_language(language: str) -> Language:
    """Load the grammar and the lexicon of a language.

    Parameters
    ----------
    language
        Tag of the language, such as ``sv``.

    Returns
    -------
    Language
        The language, ready to draw sentences.

    Raises
    ------
    ConfigurationError
        If there is none, or it contradicts itself.
    """
    if language not in list_languages():
        raise ConfigurationError(
            f"there are no sentences of the language '{language}'",
            expected=", ".join(list_languages()),
        )
    content = load_table(language, LanguageFile, "sentences")
    return read_language(content, f"sentences/{language}.toml")


def read_language(content: LanguageFile, file: str) -> Language:
    """Check the settings of a language and prepare its grammar and lexicon.

    Parameters
    ----------
    content
        The settings.
    file
        Name of the file, for messages.

    Returns
    -------
    Language
        The language, ready to draw sentences.

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
            entry = _parse_entry(word, rest, phone_set, first)
            if entry is None:
                faults.append(f"phones of '{word}'")
                continue
            if lexicon.setdefault(word, entry) != entry:
                faults.append(f"'{word}' in two ways")
            members.append(word)
        if len(set(members)) < len(members):
            faults.append(f"'{name}' has a word twice")
        classes[name] = tuple(members)
    before_vowels = {}
    for word, line in content.before_vowels.items():
        text, _, rest = line.partition(" ")
        entry = _parse_entry(text, rest, phone_set, first_stressed=False)
        if entry is None or word not in lexicon:
            faults.append(f"'{word}' before vowels")
        else:
            before_vowels[word] = entry[0]
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
    return Language(content, phone_set, rules, classes, lexicon, before_vowels)


def _parse_entry(
    word: str, phones: str, phone_set: PhoneSet, first_stressed: bool
) -> tuple[SpokenWord, ...] | None:
    """Parse a line of the lexicon; None where symbols are not in the phone set."""
    texts, parts = word.split("_"), phones.split("|")
    parsed = [_parse_phones(part.split(), phone_set) for part in parts]
    if len(texts) != len(parts) or None in parsed:
        return None
    entry = [phones for phones in parsed if phones is not None]
    if first_stressed and not any(phone.stress for phones in entry for phone in phones):
        entry = [_stress_first(phones) for phones in entry]
    return tuple(map(SpokenWord, texts, entry))


def _parse_phones(symbols: Sequence[str], phone_set: PhoneSet) -> tuple[SpokenPhone, ...] | None:
    parsed = [phone_set.parse(symbol) for symbol in symbols]
    if not parsed or None in parsed:
        return None
    return tuple(
        SpokenPhone(phone, (stress or 0) if phone_set.get_phone(phone).takes_stress else None)
        for phone, stress in (pair for pair in parsed if pair is not None)
    )


def _stress_first(phones: tuple[SpokenPhone, ...]) -> tuple[SpokenPhone, ...]:
    for i, phone in enumerate(phones):
        if phone.stress is not None:
            return (*phones[:i], SpokenPhone(phone.phone, 1), *phones[i + 1 :])
    return phones
