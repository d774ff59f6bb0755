"""Text to speech: what is said is labelled, in the phone set asked for, from end to end."""

import importlib.util

import numpy as np
import pytest

from mocap_fit.errors import ConfigurationError, DataError, MissingExtraError
from mocap_fit.phones import find_unknown_phones, load_phone_set
from mocap_fit.sound import energy_db
from mocap_fit.synthesis import TextSpeaker, speak_text

pytest.importorskip("espeakng_loader")

TEXTS = {
    "sv": "Svenska kyrkan ska vara till hjälp.",
    "cs": "Příliš žluťoučký kůň, pěl ďábelské ódy.",
    "en": "The little church, I hide joys.",
}


@pytest.fixture(scope="module")
def said():
    return {language: speak_text(text, language) for language, text in TEXTS.items()}


def without_silence(spoken):
    silence = load_phone_set(spoken.phones.phone_set).silence
    return tuple(phone for phone in spoken.phones.phones if phone != silence)


@pytest.mark.parametrize(
    ("language", "phones"),
    [
        ("sv", "S V Ä N S K A TJ Y R K A N S K A: V A: R A T I L J Ä L P"),
        (
            "cs",
            r"p Q\ i: l i Z Z l u c o_u t_S k i: k u: J p j e l J\ a: b e l s k e: o: d i",
        ),
        ("en", "DH AH L IH D AH L CH ER CH AY HH AY D JH OY Z"),
    ],
)
def test_the_phones_of_three_languages(said, language, phones):
    spoken = said[language]
    found = list(without_silence(spoken))
    # espeak-ng's rules may change in a vowel here and there, not in what the sentence is.
    expected = phones.split()
    assert len(found) == len(expected)
    assert sum(a == b for a, b in zip(found, expected, strict=True)) >= len(expected) - 2
    assert not find_unknown_phones(spoken.phones, spoken.phones.phone_set)


@pytest.mark.parametrize("language", TEXTS)
def test_labels_cover_the_sound_without_gaps(said, language):
    spoken = said[language]
    phones = spoken.phones
    assert phones[0].start == 0
    assert phones[len(phones) - 1].end == pytest.approx(spoken.sound.duration)
    assert phones.find_gaps() == ()
    assert (phones.ends - phones.starts > 0.002).all()
    silence = load_phone_set(phones.phone_set).silence
    assert phones[0].phone == phones[len(phones) - 1].phone == silence


@pytest.mark.parametrize("language", TEXTS)
def test_words_and_stress(said, language):
    phones = said[language].phones
    words = list(dict.fromkeys(segment.word for segment in phones if segment.word))
    assert words == [word.strip(",.") for word in TEXTS[language].split()]
    chosen = load_phone_set(phones.phone_set)
    for segment in phones:
        assert (segment.stress is not None) == chosen.is_vowel(segment)
        assert bool(segment.word) != chosen.is_silence(segment)
    assert {segment.stress for segment in phones} >= {0, 1}


@pytest.mark.parametrize("language", TEXTS)
def test_the_sound_is_where_the_labels_say(said, language):
    spoken = said[language]
    chosen = load_phone_set(spoken.phones.phone_set)
    levels = energy_db(spoken.sound, 0.5 * (spoken.phones.starts + spoken.phones.ends))
    vowels = np.array([chosen.is_vowel(segment) for segment in spoken.phones])
    quiet = np.array([chosen.is_silence(segment) for segment in spoken.phones])
    assert np.median(levels[vowels]) > np.median(levels[~vowels & ~quiet]) + 3
    assert levels[quiet].max() < levels[vowels].min()


def test_any_voice_gives_ipa():
    pytest.importorskip("panphon")
    spoken = speak_text("Guten Morgen.", "de")
    assert spoken.phones.phone_set == "ipa"
    assert without_silence(spoken)[:3] == ("ɡ", "uː", "t")


def test_another_phone_set():
    spoken = speak_text("Kočka.", "cs", phone_set="cs-ipa")
    assert spoken.phones.phone_set == "cs-ipa"
    assert without_silence(spoken) == ("k", "o", "t͡ʃ", "k", "a")


def test_the_same_text_is_said_in_the_same_way():
    speaker = TextSpeaker("sv")
    first, other, again = map(speaker.speak, ("En båt.", "Två bilar.", "En båt."))
    alone = speak_text("En båt.", "sv")
    for spoken in (again, alone):
        np.testing.assert_array_equal(spoken.sound.samples, first.sound.samples)
        assert spoken.phones == first.phones
    assert len(other.sound) != len(first.sound)


def test_speed_and_silence():
    slow = speak_text("En röd båt.", "sv", words_per_minute=100, silence=0.5)
    fast = speak_text("En röd båt.", "sv", words_per_minute=250, silence=0.0)
    assert slow.phones[0].duration >= 0.5
    assert slow.sound.duration - 1.0 > 1.5 * fast.sound.duration


def test_quotes_line_breaks_and_long_texts():
    spoken = speak_text('He said: "no".\n\nThen {"he"} left. ' + "It rained. " * 30, "en")
    assert len(spoken.phones) > 200
    assert spoken.phones.find_gaps() == ()


@pytest.mark.parametrize(
    ("language", "text", "words"),
    [
        # espeak-ng says small words together with their neighbours.
        ("en", "The cup is in the house.", ["The", "cup", "is", "in the", "house"]),
        ("cs", "Na stole je pes.", ["Na stole", "je", "pes"]),
        ("en", 'He paid "12" (old) dollars.', ["He", "paid", "12", "old", "dollars"]),
    ],
)
def test_what_is_written_of_words_said_together(language, text, words):
    phones = speak_text(text, language).phones
    assert list(dict.fromkeys(segment.word for segment in phones if segment.word)) == words


def test_sounds_that_a_language_joins():
    said = without_silence(speak_text("Bord och barn.", "sv"))
    assert said == ("B", "O:", "2D", "Å", "K", "B", "A:", "2N")
    assert without_silence(speak_text("Här.", "sv")) == ("H", "Ä3", "R")
    assert without_silence(speak_text("Euros.", "en")).count("R") == 1


@pytest.mark.parametrize("text", ["", "   ", "...", "\n"])
def test_a_text_without_speech(text):
    with pytest.raises(DataError, match="nothing to say"):
        speak_text(text, "sv")


def test_an_unknown_voice():
    with pytest.raises(ConfigurationError, match="no voice 'klingon-x'") as caught:
        speak_text("Hello.", "klingon-x")
    assert "sv, cs, en" in str(caught.value)


@pytest.mark.parametrize("wrong", [{"words_per_minute": 10}, {"silence": -1}])
def test_impossible_speech(wrong):
    with pytest.raises(ConfigurationError):
        speak_text("En båt.", "sv", **wrong)


def test_without_the_extra(monkeypatch):
    find = importlib.util.find_spec
    monkeypatch.setattr(
        "mocap_fit.synthesis.text_to_phones.find_spec",
        lambda name: None if name == "espeakng_loader" else find(name),
    )
    with pytest.raises(MissingExtraError, match="speech"):
        speak_text("En båt.", "sv")
