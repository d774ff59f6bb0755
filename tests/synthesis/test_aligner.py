"""Forced alignment: the words of a text, what is refused, and real speech."""

import numpy as np
import pytest
from scipy.io import wavfile

from mocap_fit.errors import ConfigurationError, DataError, FileFormatError
from mocap_fit.labels import read_labels

pytest.importorskip("pocketsphinx")

from mocap_fit.synthesis import Aligner, align

SENTENCES = {"mary": "Mary rolled the barrel.", "bobby": "“Bobby” ripped the ledger!"}


@pytest.fixture(scope="module")
def aligner():
    return Aligner()


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("Hello, World!", ["hello", "world"]),
        ("it’s  «what's»\tsaid…", ["it's", "what's", "said"]),
        ("mother-in-law – bus-stop", ["mother-in-law", "bus", "stop"]),
        ("with(2) y - eight", ["with(2)", "y", "eight"]),
    ],
)
def test_words_are_looked_up_without_their_punctuation(aligner, text, words):
    assert aligner.find_words(text) == words


def test_all_missing_words_are_listed_at_once(aligner):
    with pytest.raises(DataError, match=r"3 words are not.*: Xyzzy, frobnicate, 42\."):
        aligner.find_words("Xyzzy said: frobnicate the bus 42 Xyzzy")
    many = [f"zq{number}x" for number in range(100)]
    with pytest.raises(DataError, match="zq99x"):
        aligner.find_words(" ".join(many))
    with pytest.raises(DataError, match="no word"):
        aligner.find_words(" … ")


def test_a_user_adds_words():
    added = Aligner({"mocapfit": "M OW K AE P F IH T"})
    assert added.find_words("mocapfit") == ["mocapfit"]
    with pytest.raises(ConfigurationError, match="'zork' cannot be added"):
        Aligner({"zork": "QQ"})


def test_models_that_are_none_are_refused(tmp_path):
    with pytest.raises(ConfigurationError, match="no acoustic model"):
        Aligner(acoustic_model=tmp_path)
    with pytest.raises(FileFormatError, match="no such file"):
        Aligner(tmp_path / "none.dict")


def test_a_users_own_dictionary_replaces_the_english_one(tmp_path):
    path = tmp_path / "own.dict"
    path.write_text("ahoj AA HH OW Y\n")
    own = Aligner(path)
    assert own.find_words("Ahoj") == ["ahoj"]
    with pytest.raises(DataError, match="hello"):
        own.find_words("hello")


@pytest.mark.parametrize(
    ("samples", "rate", "message"),
    [
        (np.zeros(16000), 16000, "silent"),
        (np.ones(100), 16000, "too short"),
        (np.full(16000, np.nan), 16000, "not numbers"),
        (np.ones((2, 3, 4)), 16000, "shape or the rate"),
        (np.ones(16000), -1, "shape or the rate"),
        (np.ones(16000), 100, "at 4000 Hz or more"),
        (np.ones(16000), np.inf, "shape or the rate"),
        (np.ones(16000), np.nan, "shape or the rate"),
        (np.ones(16000), None, "need their rate"),
    ],
)
def test_sounds_that_cannot_be_used_are_refused(aligner, samples, rate, message):
    with pytest.raises(DataError, match=message):
        aligner.align(samples, "hello", rate)


def test_a_text_too_long_for_its_sound_is_refused(aligner, rng, tmp_path):
    noise = rng.normal(size=4800)
    path = tmp_path / "take.wav"
    wavfile.write(path, 16000, (1000 * noise).astype(np.int16))
    with pytest.raises(DataError, match=r"take\.wav.*cannot be aligned"):
        aligner.align(path, "a long sentence that nobody says in a third of a second")
    path.write_bytes(b"RIFF no wave at all")
    with pytest.raises(FileFormatError, match=r"take\.wav.*not a sound file"):
        aligner.align(path, "hello")


def errors(aligner, folder, name):
    """Distances of boundaries from the hand-made labels, seconds.

    Boundaries are compared in order, from the first phone's start to the last one's end. Where
    the labels have one symbol for two of ours (the l of barrel is AH L, PT is P T), the
    boundary within it is left out.
    """
    labels = "bobby_phones" if name == "bobby" else name
    truth = [
        e.start for e in read_labels(folder / f"{labels}.TextGrid").get_tier("phone").entries[1:]
    ]
    phones = [s for s in aligner.align(folder / f"{name}.wav", SENTENCES[name]) if s.word]
    found = [s.start for s in phones] + [phones[-1].end]
    del found[{"mary": -2, "bobby": 7}[name]]
    return np.abs(np.subtract(found, truth))


@pytest.mark.real_data
def test_real_speech_is_aligned_within_20_ms(aligner, data_folder):
    found = {name: errors(aligner, data_folder / "labels", name) for name in SENTENCES}
    assert np.median(found["mary"]) <= 0.020
    assert np.median(found["bobby"]) <= 0.020
    assert np.median(np.concatenate(list(found.values()))) <= 0.015


@pytest.mark.real_data
def test_an_alignment_covers_the_sound_and_stands_alone(aligner, data_folder):
    wav = data_folder / "labels" / "mary.wav"
    first = aligner.align(wav, SENTENCES["mary"])
    aligner.align(data_folder / "labels" / "bobby.wav", SENTENCES["bobby"])
    assert aligner.align(wav, SENTENCES["mary"]) == first
    rate, samples = wavfile.read(wav)
    assert align(samples / 7.0, SENTENCES["mary"], rate, name="mary") == first
    stereo = np.stack([samples, samples], axis=1)
    assert aligner.align(stereo, SENTENCES["mary"], rate).phones == first.phones
    assert first[0].start == 0
    assert first[-1].end == len(samples) / rate
    np.testing.assert_allclose(first.starts[1:], first.ends[:-1], atol=1e-6)
    assert first.phone_set == "en-arpabet"
    assert first[0].phone == first[-1].phone == "sil"
    assert list(dict.fromkeys(s.word for s in first if s.word)) == [
        "mary",
        "rolled",
        "the",
        "barrel",
    ]
