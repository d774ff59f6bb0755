"""Simulated sentences of every language: the trained models beat the baselines on held-out ones."""

import numpy as np
import pytest

from corpus_tools.talking.voice_training import simulate_corpus
from mocap_fit import control
from mocap_fit.control import ControlModel
from mocap_fit.corpus import Corpus
from mocap_fit.face import load_face
from mocap_fit.face.lips import compute_lip_gap


def correlation(model: ControlModel, corpus: Corpus) -> float:
    """Of prediction and truth over all but silence, the mean of what speech moves."""
    found, wanted = [], []
    for utterance in corpus:
        phones, tracks = utterance.read_phones(), utterance.read_tracks()
        silent = np.array([corpus.phone_set.is_silence(segment) for segment in phones])
        at = phones.at(tracks.times)
        spoken = (at >= 0) & ~silent[at]
        found.append(model.predict_at(phones, tracks.times)[spoken])
        wanted.append(tracks.values[spoken])
    rows = np.concatenate(found), np.concatenate(wanted)
    # Nothing that is said moves the jaw to a side.
    names = [k for k, name in enumerate(corpus.parameter_names) if name != "jaw_shift"]
    return float(np.mean([np.corrcoef(rows[0][:, k], rows[1][:, k])[0, 1] for k in names]))


@pytest.mark.slow
@pytest.mark.parametrize("language", ["sv", "cs", "en"])
def test_the_trained_models_beat_phone_means_on_sentences_they_never_met(language):
    corpus = simulate_corpus(language, 90)
    training, test = corpus.get_split("train"), corpus.get_split("test")
    training, held = training.hold_out(0.15)
    models = {
        name: control.create(name).fit(training, held)
        for name in ("phone-mean", "ridge", "ohman", "cohen-massaro")
    }
    scores = {name: correlation(model, test) for name, model in models.items()}
    least = scores.pop("phone-mean")
    assert least > 0.5
    assert all(score > least + 0.02 for score in scores.values()), scores
    assert scores["cohen-massaro"] > 0.85
    assert scores["cohen-massaro"] > scores["ohman"]

    # The lips close on most of the bilabials, and on all of them by rule.
    face = load_face()
    by_rule = control.create("rule-based").fit(training)
    for model, part in ((models["cohen-massaro"], 0.85), (by_rule, 1.0)):
        closed, widest = [], []
        for utterance in test:
            phones = utterance.read_phones()
            gaps = compute_lip_gap(face, model.predict_at(phones, utterance.read_tracks().times))
            at = phones.at(utterance.read_tracks().times)
            for position, segment in enumerate(phones):
                inside = gaps[at == position]
                if not len(inside):
                    continue
                if "bilabial_stop" in corpus.phone_set.get_classes(segment):
                    closed.append(inside.min())
                elif corpus.phone_set.get_phone(segment).values["open"] >= 0.8:
                    widest.append(inside.max())
        assert len(closed) > 20
        assert np.mean(np.array(closed) < 0.1 * np.mean(widest)) >= part
