"""Sentences of `mocap-fit simulate`: well-formed, of all phones, the same every time."""

import re
from collections import Counter

import numpy as np
import pytest

from corpus_tools.simulation.durations import (
    PAUSE,
    SpokenPhone,
    SpokenWord,
    load_durations,
    time_words,
)
from corpus_tools.simulation.sentences import (
    LanguageFile,
    list_languages,
    load_language,
    read_language,
)
from mocap_fit.errors import ConfigurationError, DataError
from mocap_fit.phones import find_unknown_phones

every_language = pytest.mark.parametrize("language", list_languages())
COUNT = 287


@pytest.fixture(scope="module")
def drawn():
    return {
        language: load_language(language).draw_sentences(COUNT, np.random.default_rng(0))
        for language in list_languages()
    }


def symbols(sentence):
    return " ".join(phone.phone for word in sentence.words for phone in word.phones)


def test_the_three_languages():
    assert list_languages() == ("cs", "en", "sv")


@every_language
def test_every_phone_occurs(drawn, language):
    """Without exception: also the releases of Swedish stops, made by rule, are there."""
    phone_set = load_language(language).phone_set
    words = [word for sentence in drawn[language] for word in sentence.words]
    said = {phone.phone for word in words for phone in word.phones}
    assert said == {phone.symbol for phone in phone_set.phones} - {phone_set.silence}


@every_language
def test_vowels_occur_with_and_without_stress(drawn, language):
    phone_set = load_language(language).phone_set
    found = Counter(
        (phone.phone, phone.stress)
        for sentence in drawn[language]
        for word in sentence.words
        for phone in word.phones
    )
    for phone in phone_set.phones:
        stresses = {stress for symbol, stress in found if symbol == phone.symbol}
        if phone.takes_stress:
            # The neutral vowels of Swedish and English never carry it alone; the rest do.
            assert stresses <= {0, 1, 2}
            assert 1 in stresses or phone.symbol == "E0"
        elif phone.kind != "silence":
            assert stresses == {None}


@every_language
def test_sentences_are_different_and_of_the_length_asked_for(drawn, language):
    sentences = drawn[language]
    assert len({sentence.text for sentence in sentences}) == COUNT
    least, most = load_language(language).settings.length
    for sentence in sentences:
        assert re.fullmatch(r"[A-ZÅÄÖÁČŘŠŽ][^.?_{}]+[.?]", sentence.text)
        words = [word.text for word in sentence.words if word.phones]
        assert least <= len(words) <= most
        assert [w.lower() for w in words] == re.findall(r"[^\s,.?]+", sentence.text.lower())
        assert sentence.words[0] != PAUSE != sentence.words[-1]
    vocabulary = {word.text for sentence in sentences for word in sentence.words}
    assert len(vocabulary) > 250


@every_language
def test_the_first_sentences_do_not_depend_on_the_count(drawn, language):
    few = load_language(language).draw_sentences(10, np.random.default_rng(0))
    assert few == drawn[language][:10]
    other = load_language(language).draw_sentences(10, np.random.default_rng(1))
    assert not {s.text for s in few} & {s.text for s in other}


def test_the_sentence_of_the_paper():
    sentence = load_language("sv").read("svenska kyrkan ska vara till hjälp")
    assert sentence.text == "Svenska kyrkan ska vara till hjälp."
    assert symbols(sentence) == (
        "S V E N S K k A TJ Y R K k A N S K k A V A: R A T t I L J Ä L P p"
    )


@pytest.mark.parametrize(
    ("language", "text", "phones"),
    [
        # A stop before another one, or before its own nasal, is not released.
        ("sv", "Han köpte två hus", "H A N TJ Ö P T t E0 T t V Å: H U: S"),
        # Voiced before voiced over the border of words; not before v and ř, nor before a pause.
        ("cs", "rád bych dnes hledal pes", r"r a: d b i G d n e z h\ l e d a l p e s"),
        ("cs", "dnes viděl", r"d n e s v i J\ e l"),
        ("cs", "soused , dnes", r"s o_u s e t d n e s"),
        ("cs", "dostal dnes auto", r"d o s t a l d n e s ? a_u t o"),
        ("cs", "kluk běžel", r"k l u g b j e Z e l"),
        ("en", "the empty house", "DH IY EH M P T IY HH AW S"),
        ("en", "a ugly house", "AE N AH G L IY HH AW S"),
        ("en", "a good house", "AH G UH D HH AW S"),
    ],
)
def test_what_happens_between_words(language, text, phones):
    assert symbols(load_language(language).read(text)) == phones


def test_an_article_before_a_vowel_is_written_so_too():
    assert load_language("en").read("a apples").text == "An apples."


@pytest.mark.parametrize(
    ("language", "word", "stresses"),
    [
        ("sv", "flickan", [1, 0]),
        ("sv", "trädgården", [1, 2, 0]),
        ("sv", "är", [0]),
        ("en", "yesterday", [1, 0, 2]),
        ("cs", "koupila", [1, 0, 0]),
        ("cs", "ale", [0, 0]),
    ],
)
def test_stress(language, word, stresses):
    phones = load_language(language).read(word).words[0].phones
    assert [phone.stress for phone in phones if phone.stress is not None] == stresses


def test_the_preposition_has_the_stress_of_its_noun_in_czech():
    on, table = load_language("cs").lexicon["na_stole"]
    assert [phone.stress for phone in (*on.phones, *table.phones)] == [
        None, 1, None, None, 0, None, 0,
    ]  # fmt: skip


def test_words_that_are_not_there_are_listed():
    with pytest.raises(DataError, match="xylofon, zebra"):
        load_language("sv").read("en xylofon och en zebra")


def test_an_unknown_language():
    with pytest.raises(ConfigurationError, match="cs, en, sv"):
        load_language("fi")


def language_file(**changes):
    content = {
        "language": "sv",
        "phone_set": "sv-sta",
        "length": (2, 4),
        "rules": {"SENTENCE": ("{name} {does}",)},
        "words": {"name": "Bo B 'O:\nEva 'E: V A", "does": "ser S 'E: R"},
    }
    return LanguageFile.model_validate(content | changes)


def test_a_language_of_ones_own():
    language = read_language(language_file(), "mine.toml")
    assert {s.text for s in language.draw_sentences(2, np.random.default_rng(0))} == {
        "Bo ser.",
        "Eva ser.",
    }
    with pytest.raises(DataError, match="2 different ones"):
        language.draw_sentences(3, np.random.default_rng(0))


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"words": {"name": "Bo B 'XX"}}, "phones of 'Bo'"),
        ({"words": {"name": "Bo"}}, "phones of 'Bo'"),
        ({"words": {"name": "Bo B 'O:\nBo B 'O:"}}, "'name' has a word twice"),
        ({"words": {"name": "Bo B 'O:", "other": "Bo B O:"}}, "'Bo' in two ways"),
        ({"words": {"name": "i_dag I"}}, "phones of 'i_dag'"),
        ({"rules": {"SENTENCE": ("{nobody} går",)}}, "'går' in SENTENCE; '{nobody}' in SENTENCE"),
        ({"rules": {"OTHER": ("{name}",)}}, "no rule SENTENCE"),
        ({"before_vowels": {"a": "an A N"}}, "'a' before vowels"),
    ],
)
def test_faults_of_a_language_are_named(changes, named):
    with pytest.raises(ConfigurationError) as caught:
        read_language(language_file(**changes), "mine.toml")
    assert named in str(caught.value)
    assert "mine.toml" in str(caught.value)


# ---- durations ----------------------------------------------------------------------------------


@every_language
def test_durations_are_plausible(drawn, language):
    chosen = load_language(language)
    whole, sounding, phones = [], 0.0, 0
    for i, sentence in enumerate(drawn[language][:40]):
        sequence = time_words(sentence.words, chosen.phone_set, np.random.default_rng(i))
        assert sequence[0].start == 0
        np.testing.assert_allclose(sequence.starts[1:], sequence.ends[:-1], atol=1e-6)
        assert not find_unknown_phones(sequence, chosen.phone_set)
        whole.append(sequence.duration)
        for segment in sequence:
            if segment.phone == chosen.phone_set.silence:
                assert 0.1 < segment.duration < 1.0
                assert not segment.word
            else:
                assert 0.01 < segment.duration < 0.4
                assert segment.word
                sounding += segment.duration
                phones += 1
    assert 2.0 < np.median(whole) < 5.0
    assert 9 < phones / sounding < 16


def mean_duration(words, place, phone_set, count=100):
    rng = np.random.default_rng(0)
    found = [time_words(words, phone_set, rng)[place].duration for _ in range(count)]
    return np.mean(found)


def swedish(text):
    language = load_language("sv")
    return language.read(text).words, language.phone_set


def test_klatts_rules():
    phone_set = load_language("sv").phone_set

    def vowel(phone, stress, *after):
        word = SpokenWord("x", (SpokenPhone("B"), SpokenPhone(phone, stress), *after))
        return [word, SpokenWord("y", (SpokenPhone("L"), SpokenPhone("A", 0)))]

    length = {
        name: mean_duration(words, 2, phone_set)
        for name, words in {
            "long": vowel("A:", 1),
            "short": vowel("A", 1),
            "weak": vowel("A", 0),
            "voiced": vowel("A", 1, SpokenPhone("D")),
            "voiceless": vowel("A", 1, SpokenPhone("T")),
            "last": vowel("A", 1)[:1],
            "paused": [*vowel("A", 1)[:1], PAUSE, *vowel("A", 1)[1:]],
            "long word": [SpokenWord("z", vowel("A", 1)[0].phones * 4)],
        }.items()
    }
    assert length["long"] > 1.2 * length["short"]
    assert length["short"] > 1.2 * length["weak"]
    assert length["voiced"] > 1.05 * length["voiceless"]
    assert length["last"] > 1.15 * length["short"]
    assert length["paused"] == pytest.approx(length["last"], rel=0.05)
    assert length["long word"] < length["short"]


def test_no_phone_is_shorter_than_its_least():
    table = load_durations()
    least = min(kind.least for kind in table.phones) / 1000
    words, phone_set = swedish("jag har sett trädgården och kyrkan")
    rng = np.random.default_rng(1)
    bound = least * np.exp(-2.5 * (table.noise.rate + table.noise.phone))
    for _ in range(20):
        for segment in time_words(words, phone_set, rng):
            assert segment.duration > bound - 1e-4


def test_silence_is_added_where_asked_for():
    words, phone_set = swedish("Bo ser en båt")
    plain = time_words(words, phone_set, np.random.default_rng(2))
    padded = time_words(words, phone_set, np.random.default_rng(2), start=0.5, end=0.25)
    assert padded[1].start == pytest.approx(plain[1].start + 0.5)
    assert padded.duration == pytest.approx(plain.duration + 0.75, abs=2e-3)
    # The whole is a number of milliseconds.
    assert 1000 * padded.duration == pytest.approx(round(1000 * padded.duration), abs=1e-6)
