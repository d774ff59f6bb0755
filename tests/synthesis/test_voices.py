"""Any voice of espeak-ng: its marks, the tags of its languages, and what it cannot say."""

import dataclasses
import runpy
import warnings
from pathlib import Path

import pytest

from mocap_fit.errors import ConfigurationError, DataError, MocapFitWarning
from mocap_fit.phones import find_unknown_phones, load_phone_set
from mocap_fit.synthesis import TextSpeaker, speak_text
from mocap_fit.synthesis.espeak_ipa import clean_name, split_name
from mocap_fit.synthesis.espeak_voices import LANGUAGES, find_voice
from mocap_fit.synthesis.text_to_phones import list_voices

pytest.importorskip("espeakng_loader")
pytest.importorskip("panphon")

BENCHMARK = Path(__file__).parents[2] / "benchmarks" / "voices.py"
SENTENCES = runpy.run_path(str(BENCHMARK))["SENTENCES"]
# They have no dictionary in this espeak-ng, or none with numbers.
SILENT = {"chr-US-Qaaa-x-west", "cv", "fo", "kaa", "sjn", "xex"}
CRASHES = {"kl"}


@pytest.fixture(scope="module")
def ipa():
    return load_phone_set("ipa")


def say(text, language):
    spoken = speak_text(text, language)
    assert not find_unknown_phones(spoken.phones, spoken.phones.phone_set)
    silence = load_phone_set(spoken.phones.phone_set).silence
    return [phone for phone in spoken.phones.phones if phone != silence]


@pytest.mark.parametrize(
    ("name", "phones"),
    [
        ("tS", "tʃ"),
        ("dZ", "dʒ"),
        ("N", "ŋ"),
        ("t`", "t"),
        ("k-", "k"),
        ("t[", "t̪"),
        ("s.", "ʂ"),
        ("ts.h", "tʂʰ"),
        ("tɕh", "tɕʰ"),
        ("p_h", "pʰ"),
        ("h", "h"),
        ("r#", "r̥"),
        ("n^", "nʲ"),
        ('u"', "ʉ"),
        ("i.", "i"),
        ("oenɡ", "ø ŋ"),
        ("aai", "aːi"),
        ("ʦ", "ts"),
        ("ɯᵝ", "ɯᵝ"),
        ("ʲ", "j"),
        ("ᵐb", "m b"),
        ("ε", "ε"),
        ("Φ", "Φ"),
        ("ä", "ä"),
        ("õː", "õː"),
        ("r̩ː", "r̩"),
        ("aɪə", "aɪ ə"),
        ("uei", "ue i"),
        ("ɑːɹ", "ɑː ɹ"),
        ("p ʲ", "p j"),
        ("a˥", "a"),
    ],
)
def test_marks_of_espeak(ipa, name, phones):
    found, unknown = split_name(name.replace("ɹ", " ɹ "), ipa)
    assert (found, unknown) == (phones.split(), {})
    assert all(ipa.parse(phone) is not None for phone in found)


@pytest.mark.parametrize(
    ("name", "left"),
    [
        ("(en)", ""),
        ("(en-us)ˈ", "ˈ"),
        ("(chr-US-", ""),
        ("(en)ˈw", "ˈw"),
        ("ˈʲ", "ˈʲ"),
        ("ː", ""),
        ("-", ""),
        ("̃", ""),
        ("5", ""),
    ],
)
def test_what_is_no_sound(name, left):
    assert clean_name(name) == ("" if left == "ˈ" else left)


@pytest.mark.parametrize(
    ("letter", "phone"), [("Ø", "ø"), ("ď", "d"), ("ₖ", None), ("ȿ", "s"), ("ж", "ə"), ("字", "ə")]
)
def test_an_unknown_letter_is_the_nearest_phone(ipa, letter, phone):
    found, unknown = split_name(f"a{letter}", ipa)
    assert found[0] == "a"
    assert [ipa.parse(p) for p in found].count(None) == 0
    if phone is not None:
        assert found[1:] in ([phone], [phone + "̌"], ["ø"])
    assert set(unknown) <= {letter}


def test_unknown_sounds_of_a_text_are_one_warning():
    speaker = TextSpeaker("de")
    speaker.voice = dataclasses.replace(speaker.voice, replacements={"a": "ж", "m": "字"})
    with pytest.warns(
        MocapFitWarning, match="voice 'de'.*nearest phones: '字' as 'ə', 'ж'"
    ) as seen:
        spoken = speaker.speak("Mama mag Ananas.")
    assert len(seen) == 1
    assert spoken.phones.phones.count("ə") == 4


@pytest.mark.parametrize(
    ("tag", "name"),
    [
        ("sv", "sv"),
        ("sv-SE", "sv"),
        ("cs_CZ", "cs"),
        ("en", "en-us"),
        ("en_US", "en-us"),
        ("en-gb", "en-gb"),
        ("nn-NO", "nb"),
        ("de-AT", "de-AT"),
    ],
)
def test_tags_of_languages(tag, name):
    assert find_voice(tag).name == name
    assert find_voice(tag).phone_set == (
        LANGUAGES[tag[:2]].phone_set if name in ("sv", "cs", "en-us") else "ipa"
    )


@pytest.mark.parametrize(
    ("one", "other", "text"),
    [
        ("no", "nb", "hei"),
        ("nb-NO", "nb", "hei"),
        ("fr", "fr-fr", "bonjour"),
        ("EN_gb", "en-gb", "hello"),
        ("de-AT", "de", "morgen"),
        ("pt-PT", "pt", "bom"),
        ("zh", "cmn", "你好"),
    ],
)
def test_two_tags_of_one_voice(one, other, text):
    assert say(text, one) == say(text, other)


def test_a_tag_without_a_voice_lists_the_tags():
    with pytest.raises(ConfigurationError, match="no voice 'xx-YY'") as caught:
        speak_text("Hello.", "xx-YY")
    assert "sv, cs, en" in str(caught.value)
    assert {"no", "nb", "en-gb", "fr-fr", "fr", "kl"} <= set(list_voices())


@pytest.mark.parametrize(
    ("text", "phones"),
    [
        ("vlk", "v l k"),
        ("Vlk.", "v l k"),
        ("hltl", "h l t l"),
        ("prst", "p r s t"),
        ("plž", "p l S"),
        ("vlka", "v l k a"),
        ("bylo", "b i l o"),
    ],
)
def test_czech_words_with_l_for_a_vowel(text, phones):
    assert [phone.strip("\\'") for phone in say(text, "cs")] == phones.split()


def test_words_are_as_they_are_written():
    phones = speak_text("Vlk a plch, ale DVLK.", "cs").phones
    words = list(dict.fromkeys(segment.word for segment in phones if segment.word))
    assert words == ["Vlk", "a", "plch", "ale", "DVLK"]
    assert sum(segment.word == "DVLK" for segment in phones) > 6, "an abbreviation is spelled"


@pytest.mark.parametrize("voice", ["fo", "xex"])
def test_a_silent_voice_is_named(voice):
    with pytest.raises(DataError, match=f"nothing to say.*voice '{voice}'"):
        speak_text("Hello 1 2 3.", voice)


def test_a_voice_with_which_espeak_ends_is_named():
    with pytest.raises(DataError, match="ended without an answer with the voice 'kl'"):
        speak_text("1 2 3 4 5 6 7 8 9 10 11 12 100 1999", "kl")


@pytest.mark.parametrize("voice", ["ja", "ky", "is"])
def test_voices_with_marks_of_their_own(voice):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert len(say("1 2 3 4 8 1999", voice)) > 20


@pytest.mark.slow
def test_every_voice_says_digits():
    for voice in sorted({*list_voices(), *LANGUAGES} - SILENT - CRASHES):
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            assert len(say("1 2 3 4 5 6 7 8 9 10 1999", voice)) > 20, voice


@pytest.mark.slow
@pytest.mark.parametrize("language", SENTENCES)
def test_languages_say_a_sentence(language):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert len(say(SENTENCES[language], language)) > 15
