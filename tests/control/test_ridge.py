"""The ridge regression against dense normal equations written down plainly."""

import numpy as np
import pytest
from control_cases import NAMES, SENTENCES, corpus_of, spoken

from mocap_fit.control.baselines import Ridge
from mocap_fit.corpus import Corpus, Utterance, draw_fraction
from mocap_fit.phones import PhoneSegment, PhoneSequence
from mocap_fit.tracks import ParameterTracks

RATE = 50.0


def design_of(model, phones, times):
    """The features, 0 or 1, by a loop over frames and positions of the context."""
    width = len(model.symbols_)
    rows = np.zeros((len(times), 1 + (2 * model.context + 1) * width))
    rows[:, 0] = 1.0
    for row, time in zip(rows, times, strict=True):
        for position, offset in enumerate(range(-model.context, model.context + 1)):
            at = time + offset / RATE
            inside = [s for s in phones if s.start <= at < s.end]
            phone = inside[0] if inside else "sil"
            row[1 + position * width + model.symbols_.index(phone)] = 1.0
    return rows


def designs_of(model, corpus):
    return np.concatenate(
        [design_of(model, u.read_phones(), u.read_tracks().times) for u in corpus]
    )


def values_of(corpus):
    return np.concatenate([u.read_tracks().values for u in corpus])


def solve(design, values, l2):
    """Weights with a penalty on all but the constant."""
    penalty = np.diag(np.r_[1e-9 * len(design), np.full(design.shape[1] - 1, l2)])
    return np.linalg.solve(design.T @ design + penalty, design.T @ values)


@pytest.mark.parametrize("l2", [0.5, 30.0])
def test_weights_are_those_of_the_normal_equations(l2):
    corpus = corpus_of(SENTENCES[:3])
    model = Ridge(context=2, l2=l2).fit(corpus)
    assert model.l2_ == l2
    design = designs_of(model, corpus)
    np.testing.assert_allclose(model.weights_, solve(design, values_of(corpus), l2), atol=1e-7)
    # Prediction is the product of both, on frames and anywhere else.
    phones = spoken("sil M 'A: S sil", 4)
    times = phones[0].start + np.arange(-4, 60) * 0.013
    wanted = design_of(model, phones, times) @ model.weights_
    np.testing.assert_allclose(model.predict_at(phones, times), wanted, atol=1e-12)
    assert model.log_[0].iteration == 1
    differences = design @ model.weights_ - values_of(corpus)
    assert model.log_[0].training_error == pytest.approx(np.sqrt(np.mean(differences**2)))
    assert model.parameter_count == model.weights_.size


def test_a_phone_that_occurs_as_often_as_the_penalty_has_half_its_weight():
    # One phone in one frame of a hundred of silence: its frame is 1 off the constant.
    phones = PhoneSequence(
        (PhoneSegment(0.0, 1.98, "sil"), PhoneSegment(1.98, 2.0, "S")), phone_set="sv-sta", name="u"
    )
    values = np.zeros((100, 1))
    values[-1] = 1.0
    tracks = ParameterTracks(("x",), RATE, values, name="u")
    corpus = Corpus.from_utterances([Utterance.from_tracks(tracks, phones)], "sv-sta")
    model = Ridge(context=0, l2=1.0).fit(corpus)
    silence, s = (model.symbols_.index(symbol) for symbol in ("sil", "S"))
    constant, weights = model.weights_[0, 0], model.weights_[1:, 0]
    assert weights[s] == pytest.approx(0.5 * (1.0 - constant))
    assert weights[silence] == pytest.approx(-constant * 99 / 100)


GRID = [10 ** (k / 2) for k in range(1, 9)]


def test_the_penalty_is_the_best_of_the_grid_on_the_validation_part():
    training, validation = corpus_of(SENTENCES[:5]), corpus_of(SENTENCES[5:])
    model = Ridge(context=2).fit(training, validation)
    design, test = designs_of(model, training), designs_of(model, validation)
    errors = [
        np.mean((test @ solve(design, values_of(training), l2) - values_of(validation)) ** 2)
        for l2 in GRID
    ]
    assert model.l2_ == pytest.approx(GRID[int(np.argmin(errors))])
    assert len(set(np.round(errors, 9))) == len(GRID)


def test_without_a_validation_part_the_penalty_is_cross_validated_on_thirds():
    corpus = corpus_of(SENTENCES * 2)
    model = Ridge(context=2).fit(corpus)
    folds = np.array([int(3 * draw_fraction(u.id, 0)) for u in corpus])
    assert set(folds) == {0, 1, 2}
    errors = np.zeros(len(GRID))
    utterances = list(corpus)
    for fold in range(3):
        training = [u for u, f in zip(utterances, folds, strict=True) if f != fold]
        test = [u for u, f in zip(utterances, folds, strict=True) if f == fold]
        design, beside = designs_of(model, training), designs_of(model, test)
        for i, l2 in enumerate(GRID):
            predicted = beside @ solve(design, values_of(training), l2)
            errors[i] += np.mean((predicted - values_of(test)) ** 2)
    assert model.l2_ == pytest.approx(GRID[int(np.argmin(errors))])
    # It is trained on all in the end.
    design = designs_of(model, corpus)
    wanted = solve(design, values_of(corpus), model.l2_)
    np.testing.assert_allclose(model.weights_, wanted, atol=1e-7)
    assert model.weights_.shape[1] == len(NAMES)


def test_the_context_is_the_look_ahead_and_the_look_back():
    model = Ridge(context=5, l2=1.0).fit(corpus_of(SENTENCES[:1]))
    assert model.look_ahead == model.look_back == pytest.approx(0.1)
    assert Ridge(context=3, phone_set="sv-sta").parameter_count == 10 * (1 + 7 * 76)
