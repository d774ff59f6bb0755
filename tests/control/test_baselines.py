"""The baselines: means, phone means, a ridge regression; unseen phones; checkpoints."""

import dataclasses

import numpy as np
import pytest
from control_cases import NAMES, SENTENCES, corpus_of, moved, spoken

from mocap_fit import control
from mocap_fit.control.baselines import Ridge
from mocap_fit.control.checkpoint import Checkpoint
from mocap_fit.control.symbols import Symbols
from mocap_fit.control.training import compute_phone_means, load_utterances
from mocap_fit.corpus import Corpus, Utterance
from mocap_fit.errors import ConfigurationError, DataError, FileFormatError
from mocap_fit.phones import PhoneSegment, PhoneSequence, load_phone_set
from mocap_fit.tracks import ParameterTracks


def error_of(model, corpus) -> float:
    apart = [
        model.predict_at(u.read_phones(), u.read_tracks().times) - u.read_tracks().values
        for u in corpus.utterances
    ]
    return float(np.sqrt(np.mean(np.concatenate(apart) ** 2)))


def test_the_mean_is_that_of_all_frames(small_corpus):
    values = np.concatenate([u.read_tracks().values for u in small_corpus])
    model = control.create("mean").fit(small_corpus)
    np.testing.assert_allclose(
        model.predict(spoken("sil 'A: sil", 1)).values[3], values.mean(axis=0)
    )
    assert model.log_[-1].training_error == pytest.approx(error_of(model, small_corpus))


def test_phone_means_stand_at_centres_with_straight_lines_between():
    phones = PhoneSequence(
        (PhoneSegment(0.0, 0.4, "sil"), PhoneSegment(0.4, 0.8, "S"), PhoneSegment(0.8, 1.0, "sil")),
        phone_set="sv-sta",
        name="u",
    )
    times = np.arange(50) / 50
    values = np.where(phones.phones == "S", 0, 0) + np.where(
        (times >= 0.4) & (times < 0.8), 2.0, 1.0
    )
    corpus = Corpus.from_utterances(
        [Utterance.from_tracks(ParameterTracks(("x",), 50.0, values[:, None], name="u"), phones)],
        "sv-sta",
    )
    model = control.create("phone-mean").fit(corpus)
    found = model.predict_at(phones, np.array([0.0, 0.2, 0.4, 0.6, 0.75, 0.9, 1.5]))
    np.testing.assert_allclose(found[:, 0], [1, 1, 1.5, 2, 1.5, 1, 1])


def test_the_baselines_are_in_the_order_that_they_should_be():
    training, test = corpus_of(SENTENCES * 3), corpus_of(SENTENCES)
    models = (control.create("mean"), control.create("phone-mean"), Ridge(context=4, l2=1.0))
    errors = [error_of(model.fit(training), test) for model in models]
    assert errors == sorted(errors, reverse=True)
    assert errors[2] < 0.5 * errors[1] < 0.5 * errors[0]


def test_ridge_finds_a_linear_truth_and_does_not_let_the_penalty_act_on_the_mean():
    rng = np.random.default_rng(3)
    corpus = corpus_of(SENTENCES * 4)
    model = Ridge(context=2, l2=1.0).fit(corpus)
    model.weights_ = rng.normal(0, 1, model.weights_.shape)
    made = [
        Utterance.from_tracks(
            u.read_tracks().replace(
                values=model.predict_at(u.read_phones(), u.read_tracks().times) + 5.0
            ),
            u.read_phones(),
        )
        for u in corpus
    ]
    truth = Corpus.from_utterances(made, "sv-sta")
    assert error_of(Ridge(context=2, l2=1e-6).fit(truth), truth) < 1e-5
    heavy = Ridge(context=2, l2=1e12).fit(truth)
    mean = np.concatenate([u.read_tracks().values for u in truth]).mean(axis=0)
    np.testing.assert_allclose(heavy.predict(made[0].read_phones()).values[0], mean, atol=1e-3)


def test_the_penalty_is_chosen_on_what_was_held_out():
    training, held = corpus_of(SENTENCES[:6] * 2), corpus_of(SENTENCES[6:])
    errors = {}
    for penalty in (10**0.5, 10.0, 10**1.5, 100.0, 1e4):
        errors[penalty] = error_of(Ridge(context=3, l2=penalty).fit(training), held)
    chosen = Ridge(context=3).fit(training, held)
    assert error_of(chosen, held) <= min(errors.values()) + 1e-12
    assert Ridge(context=3).fit(training).l2_ > 0


@pytest.mark.parametrize("wrong", [{"context": -1}, {"l2": -0.5}, {"l2": float("nan")}])
def test_impossible_settings_of_ridge_are_refused(wrong, small_corpus):
    with pytest.raises(ConfigurationError, match=next(iter(wrong))):
        control.create("ridge", **wrong).fit(small_corpus)


def test_parameters_that_miss_other_frames_do_not_disturb_each_other():
    corpus = corpus_of(SENTENCES[:4])
    whole = Ridge(context=2, l2=3.0).fit(corpus)
    holes = []
    for utterance in corpus:
        values = utterance.read_tracks().values.copy()
        values[::3, 4] = np.nan
        holes.append(
            Utterance.from_tracks(
                utterance.read_tracks().replace(values=values), utterance.read_phones()
            )
        )
    partly = Ridge(context=2, l2=3.0).fit(Corpus.from_utterances(holes, "sv-sta"))
    others = [k for k in range(len(NAMES)) if k != 4]
    np.testing.assert_allclose(partly.weights_[:, others], whole.weights_[:, others], atol=1e-9)
    assert np.abs(partly.weights_[:, 4] - whole.weights_[:, 4]).max() > 1e-6


def test_unseen_phones_are_the_nearest_that_were_seen():
    symbols = Symbols.from_corpus(corpus_of(["sil P 'I: S 'A: T O: sil"]), True)

    def taken_for(phone, stress=None):
        return symbols.names[symbols.index(PhoneSegment(0.0, 0.1, phone, stress))]

    assert taken_for("S") == "S"
    assert taken_for("I:", 1) == "'I:"
    # The same sound with the other stress; the voiced one of a pair; a neighbour.
    assert taken_for("B") == "P"
    assert taken_for("D") == "T"
    assert taken_for("I", 1) == "'I:"
    assert taken_for("U:", 0) == "O:"
    # Only vowels stand for vowels, though h is all but silence by its features.
    assert taken_for("H") != "sil"
    # By the 17 features alone, within the kind.
    phone_set = load_phone_set("sv-sta")
    for phone in phone_set.phones:
        found = phone_set.get_phone(taken_for(phone.symbol, 0 if phone.takes_stress else None))
        assert found.kind == phone.kind
    unseen = phone_set.get_features("NG")
    nearest = min("PST", key=lambda s: np.sum((phone_set.get_features(s) - unseen) ** 2))
    assert taken_for("NG") == nearest


def test_a_corpus_without_silence_can_be_asked_for_silence():
    model = control.create("phone-mean").fit(corpus_of(["P 'A: S"]))
    assert np.isfinite(model.predict(spoken("sil 'A: sil", 1)).values).all()


def test_phone_means_of_phones_without_frames_are_the_mean():
    corpus = corpus_of(["sil 'A: S sil"])
    symbols = Symbols.from_corpus(corpus, True)
    means = compute_phone_means(load_utterances(corpus, symbols), len(symbols))
    values = corpus.utterances[0].read_tracks().values
    unheard = symbols.names.index("P")
    np.testing.assert_allclose(means[unheard], values.mean(axis=0))


def test_frames_far_in_a_pause_can_be_left_out():
    corpus = corpus_of(["sil 'A: S sil", "sil sil"])
    symbols = Symbols.from_corpus(corpus, True)
    whole = load_utterances(corpus, symbols)
    for pause in (0.0, 0.05):
        spoken_one, silent = load_utterances(corpus, symbols, pause)
        np.testing.assert_array_equal(silent.values, whole[1].values)
        first, last = spoken_one.phones[1].start, spoken_one.phones[2].end
        near = (spoken_one.times >= first - pause) & (spoken_one.times <= last + pause)
        assert 0 < np.count_nonzero(near) < len(near)
        np.testing.assert_array_equal(spoken_one.values[near], whole[0].values[near])
        assert np.isnan(spoken_one.values[~near]).all()


def test_an_utterance_without_phones_cannot_be_trained_on():
    phones = PhoneSequence((), phone_set="sv-sta", name="empty")
    tracks = moved(spoken("sil 'A: sil", 1)).replace(name="empty")
    corpus = Corpus.from_utterances([Utterance.from_tracks(tracks, phones)], "sv-sta")
    for name in ("phone-mean", "ridge", "cohen-massaro", "ohman"):
        with pytest.raises(DataError, match="'empty' has no phones"):
            control.create(name).fit(corpus)


@pytest.mark.parametrize("name", ["cohen-massaro", "ohman"])
def test_a_training_that_was_broken_off_goes_on_where_it_was(name, small_corpus, tmp_path):
    corpus = dataclasses.replace(small_corpus, utterances=small_corpus.utterances[:3])
    path = tmp_path / "checkpoint"
    settings = {"max_iter": 2}

    class BrokenOff(Exception):
        pass

    def stop(entry):
        if entry.part == NAMES[3]:
            raise BrokenOff

    with pytest.raises(BrokenOff):
        control.create(name, **settings).fit(corpus, progress=stop, checkpoint=path)
    kept = Checkpoint(path, name, control.create(name, **settings).get_params(), ())
    assert NAMES[2] not in kept, "another corpus must not fit"
    control.create(name, **settings).fit(corpus).save(tmp_path / "whole.npz")
    control.create(name, **settings).fit(corpus, checkpoint=path).save(tmp_path / "resumed.npz")
    assert (tmp_path / "whole.npz").read_bytes() == (tmp_path / "resumed.npz").read_bytes()
    # What was done is not done again: the file's own values come back.
    from mocap_fit.control.model_file import read_model_file, write_model_file

    header, arrays = read_model_file(path)
    write_model_file(header, {**arrays, NAMES[0]: arrays[NAMES[0]] + 1.0}, path)
    changed = control.create(name, **settings).fit(corpus, checkpoint=path)
    whole = control.load(tmp_path / "whole.npz")
    phones = corpus.utterances[0].read_phones()
    apart = changed.predict(phones).values - whole.predict(phones).values
    assert np.abs(apart[:, 0]).max() > 0.1
    np.testing.assert_array_equal(apart[:, 1:], 0)


def test_a_file_that_is_no_checkpoint_is_left_alone(small_corpus, tmp_path):
    path = tmp_path / "model.npz"
    control.create("mean").fit(small_corpus).save(path)
    before = path.read_bytes()
    with pytest.raises(FileFormatError, match="not a checkpoint"):
        control.create("ohman").fit(small_corpus, checkpoint=path)
    path.write_text("something else")
    with pytest.raises(FileFormatError, match=r"model\.npz"):
        control.create("ohman").fit(small_corpus, checkpoint=path)
    assert path.read_text() == "something else"
    assert len(before) > 0
