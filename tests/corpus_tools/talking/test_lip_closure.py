"""The lips close on p, b and m, in every language, whoever speaks."""

import pytest

from corpus_tools.talking.prepare_voices import prepare_voices
from corpus_tools.talking.voice_training import list_languages, simulate_corpus
from mocap_fit.evaluation import measure_gaps
from mocap_fit.evaluation.closure import CLOSED
from mocap_fit.face import load_face
from mocap_fit.synthesis import synthesise

LEARNED = ["cart", "cohen-massaro", "ohman"]
SENTENCES = 140


@pytest.mark.slow
@pytest.mark.parametrize("language", ["cs", "en", "sv"])
def test_lips_close_over_the_test_sentences_of_each_language(language):
    """Models by themselves, from corner to corner; `speak --prepare --check` does it for all."""
    report = prepare_voices([language], LEARNED, check=True, utterances=SENTENCES)
    closed = {row["model"]: row["bilabials_closed"] for row in report.to_dict()["models"]}
    assert closed.keys() == {*LEARNED, "rule-based"}
    assert closed["rule-based"] == 1.0
    assert min(closed.values()) >= 0.7
    # What is spoken closes always, in pictures at a low rate as well.
    face = load_face()
    corpus = simulate_corpus(language, SENTENCES)
    models = [voice.model for voice in report.voices if voice.model is not None]
    count = 0
    for utterance in corpus.get_split("test").utterances[:15]:
        phones = utterance.read_phones()
        for model, rate in zip(models, (25.0, 30.0, 60.0), strict=True):
            tracks = synthesise(phones, model, rate, face=face, start_time=0.5 / rate)
            lips = measure_gaps(face, tracks.values, tracks.times, phones, corpus.phone_set)
            assert all(event.gap <= CLOSED for event in lips.bilabials)
            assert not lips.speed > 350
            count += len(lips.bilabials)
    assert count > 50


def test_there_are_sentences_of_three_languages():
    assert set(list_languages()) >= {"cs", "en", "sv"}
