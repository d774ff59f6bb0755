import dataclasses
import json
import pickle
from copy import deepcopy
from xml.etree import ElementTree

import numpy as np
import pytest
from matplotlib.figure import Figure
from remembered_model import RATE, Remembered, spoken

from mocap_fit.corpus import Corpus, Utterance
from mocap_fit.errors import DataError
from mocap_fit.evaluation import GROUPS, evaluate
from mocap_fit.evaluation.closure import Share
from mocap_fit.evaluation.measures import draw_resamples, mark_groups
from mocap_fit.phones import load_phone_set


def trained(corpus, **settings):
    return Remembered(**settings).fit(corpus)


def speech(corpus):
    """All target values of frames that are speech, by hand."""
    return np.concatenate([u.read_tracks().values[10:50] for u in corpus])


def test_frames_belong_to_the_kind_of_their_phone():
    utterance = spoken("u", 0, ("x",))
    groups = mark_groups(
        utterance.read_phones(),
        load_phone_set("en-arpabet"),
        np.array([-1.0, 0.1, 0.2, 0.5, 0.9, 1.1, 2]),
    )
    assert groups.tolist() == [
        [False, False, True, True, True, False, False],
        [False, False, False, True, False, False, False],
        [False, False, True, False, True, False, False],
    ]


def test_a_perfect_model_has_no_error(small_corpus):
    result = evaluate(small_corpus, {"perfect": trained(small_corpus)}, face=None, resamples=100)
    assert np.all(result.rmse == 0)
    assert np.allclose(result.correlation, 1, atol=1e-12)
    assert result.frames == (8 * 40, 8 * 20, 8 * 20)
    assert result.lips == {}


def test_a_known_shift_is_the_error_and_leaves_the_correlation(small_corpus):
    models = {"shifted": trained(small_corpus, shift=0.01)}
    result = evaluate(small_corpus, models, face=None, resamples=100)
    ranges = np.ptp(speech(small_corpus), axis=0)
    assert np.allclose(result.ranges, ranges)
    for group in range(len(GROUPS)):
        assert np.allclose(result.rmse[0, group], 100 * 0.01 / ranges)
        assert np.allclose(result.correlation[0, group], 1)
    # Every sample of the bootstrap has the same shift.
    _, low, high = result.compute_averages("rmse")
    assert np.allclose(low, high)


def test_scores_agree_with_numpy_on_all_frames(small_corpus, rng):
    noisy = trained(small_corpus)
    for name, tracks in noisy.tracks_.items():
        noisy.tracks_[name] = tracks.replace(
            values=tracks.values + rng.normal(0, 0.01, tracks.values.shape)
        )
    result = evaluate(small_corpus, {"noisy": noisy}, face=None, resamples=400)
    target = speech(small_corpus)
    predicted = np.concatenate([noisy.tracks_[u.id].values[10:50] for u in small_corpus])
    rmse = 100 * np.sqrt(np.mean((target - predicted) ** 2, axis=0)) / np.ptp(target, axis=0)
    r = [np.corrcoef(target[:, p], predicted[:, p])[0, 1] for p in range(2)]
    assert np.allclose(result.rmse[0, 0], rmse)
    assert np.allclose(result.correlation[0, 0], r)
    value, low, high = result.compute_averages("rmse")
    assert low[0, 0] < value[0, 0] < high[0, 0]


def test_missing_targets_do_not_count(small_corpus):
    holed = []
    for utterance in small_corpus:
        values = utterance.read_tracks().values.copy()
        values[15:25, 0] = np.nan
        tracks = utterance.read_tracks().replace(values=values)
        holed.append(Utterance.from_tracks(tracks, utterance.read_phones()))
    corpus = Corpus.from_utterances(holed, "en-arpabet")
    models = {"shifted": trained(small_corpus, shift=0.01)}
    result = evaluate(corpus, models, face=None, resamples=100)
    assert np.isfinite(result.rmse).all()
    assert np.allclose(result.rmse[0, 0], 1 / result.ranges)


def test_a_parameter_that_never_changes_does_not_count(small_corpus):
    still = [
        Utterance.from_tracks(
            u.read_tracks().replace(values=u.read_tracks().values * np.array([1.0, 0.0])),
            u.read_phones(),
        )
        for u in small_corpus
    ]
    corpus = Corpus.from_utterances(still, "en-arpabet")
    models = {"shifted": trained(corpus, shift=0.01)}
    result = evaluate(corpus, models, face=None, resamples=100)
    assert np.isnan(result.rmse[0, 0, 1])
    assert np.isnan(result.correlation[0, 0, 1])
    value, low, high = result.compute_averages("rmse")
    assert value[0, 0] == pytest.approx(result.rmse[0, 0, 0])
    assert np.isfinite([low, high]).all()


def test_a_constant_prediction_has_no_correlation(small_corpus):
    models = {"constant": trained(small_corpus, scale=0.0, shift=0.0123)}
    result = evaluate(small_corpus, models, face=None, resamples=100)
    assert np.isnan(result.correlation).all()
    assert np.isfinite(result.rmse).all()


def test_the_better_model_is_told_from_the_worse(small_corpus, rng):
    def noisy(size):
        model = trained(small_corpus)
        for name, tracks in model.tracks_.items():
            noise = rng.normal(0, size, tracks.values.shape)
            model.tracks_[name] = tracks.replace(values=tracks.values + noise)
        return model

    models = {"worse": noisy(0.02), "better": noisy(0.01), "as good": noisy(0.01)}
    result = evaluate(small_corpus, models, face=None)
    assert result.rank_models()[-1] == "worse"
    apart = result.compare("worse", "better")
    assert 0 < apart.low < apart.value < apart.high
    assert apart.p < 0.01
    alike = result.compare("better", "as good")
    assert alike.low < 0 < alike.high
    assert alike.p > 0.01
    back = result.compare("better", "worse")
    assert (back.value, back.low, back.high) == pytest.approx(
        (-apart.value, -apart.high, -apart.low)
    )


def test_the_same_seed_gives_the_same_intervals(small_corpus):
    models = {"half": trained(small_corpus, scale=0.5)}
    one, two, other = (
        evaluate(small_corpus, models, face=None, seed=s, resamples=200) for s in (1, 1, 2)
    )
    assert np.array_equal(one.rmse_samples, two.rmse_samples)
    assert not np.array_equal(one.rmse_samples, other.rmse_samples)


def test_lips_that_close_are_told_from_lips_that_do_not(face_corpus):
    models = {
        "perfect": trained(face_corpus),
        "half open": trained(face_corpus, shift=0.15),
    }
    result = evaluate(face_corpus, models, resamples=100)
    assert result.lips["target"].closed == result.lips["perfect"].closed == Share(8, 8)
    assert result.lips["half open"].closed == Share(0, 8)


def test_a_table_and_json_hold_every_score(small_corpus):
    models = {"half": trained(small_corpus, scale=0.5), "perfect": trained(small_corpus)}
    result = evaluate(small_corpus, models, face=None, resamples=100)
    table = result.to_frame()
    assert len(table) == 2 * len(GROUPS) * (2 + 1) * 2
    assert list(table.index) == list(range(len(table)))
    row = table[(table.model == "half") & (table.parameter == "average")].iloc[0]
    assert row.value == pytest.approx(result.compute_averages("rmse")[0][0, 0])
    json.dumps(result.to_dict(), allow_nan=True)
    assert {d["group"] for d in result.to_dict()["differences"]} == set(GROUPS)


def test_what_cannot_be_scored_is_refused(small_corpus, face_corpus):
    with pytest.raises(DataError, match="nothing to score"):
        evaluate(small_corpus, {})
    with pytest.raises(DataError, match="does not predict the parameters"):
        evaluate(small_corpus, {"other": trained(face_corpus)})
    with pytest.raises(DataError, match=r"does not predict the parameters.*not trained"):
        evaluate(small_corpus, {"new": Remembered()})
    silent = small_corpus.utterances[0]
    phones = silent.read_phones().replace(segments=silent.read_phones().segments[:1])
    quiet = Corpus.from_utterances(
        [Utterance.from_tracks(silent.read_tracks(), phones)], "en-arpabet"
    )
    with pytest.raises(DataError, match=r"no frame.*speech"):
        evaluate(quiet, {"m": trained(quiet)}, face=None)
    result = evaluate(small_corpus, {"m": trained(small_corpus)}, face=None, resamples=100)
    with pytest.raises(DataError, match="'x' was not scored"):
        result.compare("m", "x")


def test_times_of_the_tracks_are_those_of_the_phones(small_corpus):
    """A clock that starts later shifts the frames, not the phones."""
    late = [
        Utterance.from_tracks(u.read_tracks().replace(start_time=0.2), u.read_phones())
        for u in small_corpus
    ]
    corpus = Corpus.from_utterances(late, "en-arpabet")
    result = evaluate(corpus, {"m": trained(corpus)}, face=None, resamples=100)
    assert result.frames == (8 * 40, 8 * 20, 8 * 20)
    assert corpus.rate == RATE


def test_every_file_is_read_once(small_corpus, monkeypatch):
    models = {"half": trained(small_corpus, scale=0.5)}
    calls = []
    for name in ("read_tracks", "read_phones"):
        real = getattr(Utterance, name)

        def count(self, name=name, real=real):
            calls.append((name, self.id))
            return real(self)

        monkeypatch.setattr(Utterance, name, count)
    evaluate(small_corpus, models, face=None, resamples=10)
    assert len(calls) == len(set(calls)) == 16


def test_the_range_is_that_of_speech_alone(small_corpus):
    loud = []
    for utterance in small_corpus:
        values = utterance.read_tracks().values.copy()
        values[:5] = 9.0
        tracks = utterance.read_tracks().replace(values=values)
        loud.append(Utterance.from_tracks(tracks, utterance.read_phones()))
    corpus = Corpus.from_utterances(loud, "en-arpabet")
    result = evaluate(corpus, {"m": trained(corpus)}, face=None, resamples=10)
    assert np.array_equal(result.ranges, np.ptp(speech(small_corpus), axis=0))


def test_samples_of_the_bootstrap_are_scores_of_the_utterances_drawn(small_corpus):
    model = trained(small_corpus, scale=0.5, shift=0.003)
    result = evaluate(small_corpus, {"half": model}, face=None, resamples=20, seed=3)
    counts = draw_resamples(8, 20, 3).astype(int)
    for sample in range(20):
        chosen = np.repeat(np.arange(8), counts[sample])
        target = np.concatenate(
            [small_corpus.utterances[i].read_tracks().values[10:50] for i in chosen]
        )
        error = np.sqrt(np.mean((0.003 - 0.5 * target) ** 2, axis=0))
        assert np.allclose(result.rmse_samples[sample, 0, 0], 100 * error / result.ranges)
        assert np.allclose(result.correlation_samples[sample, 0, 0], 1)


def test_scores_print_as_a_table_the_best_model_first(face_corpus):
    models = {"half open": trained(face_corpus, shift=0.15), "perfect": trained(face_corpus)}
    result = evaluate(face_corpus, models, resamples=50)
    lines = str(result).splitlines()
    names = "model free parameters RMSE % r lips closed lip at teeth vowels open fastest, mm/s"
    assert lines[0].split() == names.split()
    assert lines[1].startswith("perfect")
    assert "100.0 % [67.6, 100.0]" in lines[1]
    assert "0.00 [0.00, 0.00]" in lines[1]
    assert "1.000 [1.000, 1.000]" in lines[1]
    assert " 0.0 % [0.0, 32.4]" in lines[2]
    assert len({len(line) for line in lines}) == 1
    assert len(repr(result).splitlines()) == 1
    assert "'perfect'" in repr(result)
    page = ElementTree.fromstring(result._repr_html_())
    assert len(page.findall(".//th")) == 2 + 2 * len(GROUPS) + 4
    assert [row[0].text for row in page.findall(".//tbody/tr")] == ["perfect", "half open"]
    blind = evaluate(face_corpus, models, face=None, resamples=50)
    assert "closed" not in str(blind)


def test_evaluations_are_compared_copied_and_pickled(face_corpus):
    models = {"half": trained(face_corpus, scale=0.5)}
    result, other = (evaluate(face_corpus, models, resamples=20, seed=s) for s in (0, 1))
    for copy in (pickle.loads(pickle.dumps(result)), deepcopy(result)):
        assert copy.equals(result)
    assert not result.equals(other)
    assert not result.equals("scores")
    assert not result.equals(dataclasses.replace(result, lips={}))
    assert not result.equals(dataclasses.replace(result, ranges=2 * result.ranges))
    missing = dataclasses.replace(result, ranges=np.full_like(result.ranges, np.nan))
    assert missing.equals(dataclasses.replace(missing))


def test_scores_are_plotted(small_corpus):
    models = {"half": trained(small_corpus, scale=0.5), "perfect": trained(small_corpus)}
    result = evaluate(small_corpus, models, face=None, resamples=50)
    axes = result.plot()
    assert [label.get_text() for label in axes.get_yticklabels()] == ["half", "perfect"]
    drawn = axes.containers[0][0].get_xdata()
    assert drawn.tolist() == result.compute_averages("rmse")[0][::1, 0].tolist()
    other = Figure().subplots()
    assert result.plot("correlation", other) is other
    assert other.get_title() == "correlation"


def test_a_model_that_stopped_by_the_test_set_is_marked(small_corpus):
    models = {"half": trained(small_corpus, scale=0.5), "perfect": trained(small_corpus)}
    plain = evaluate(small_corpus, models, face=None, resamples=50)
    assert plain.notes == ()
    assert "*" not in str(plain) + plain._repr_html_()
    models["half"].trained_on_["protocol"] = "paper"
    models["perfect"].trained_on_["protocol"] = "clean"
    result = evaluate(small_corpus, models, face=None, resamples=50)
    (note,) = result.notes
    assert "protocol paper" in note
    assert [row[0] for row in result.to_rows()[1]] == ["perfect", "half *"]
    assert result.to_difference_rows()[1][0][:2] == ["perfect", "half *"]
    assert str(result).splitlines()[-1] == note
    assert ElementTree.fromstring(result._repr_html_()).findtext("p") == note
    content = result.to_dict()
    assert content["notes"] == [note]
    assert content["models"]["half"]["stopped_by_test_set"] is True
    assert content["models"]["perfect"]["stopped_by_test_set"] is False
    # Names of models remain what the caller gave.
    assert result.rank_models() == ("perfect", "half")
    assert set(result.to_frame()["model"]) == {"perfect", "half"}


def test_differences_are_the_cells_of_a_table(small_corpus):
    models = {"half": trained(small_corpus, scale=0.5), "perfect": trained(small_corpus)}
    models["shifted"] = trained(small_corpus, shift=0.003)
    result = evaluate(small_corpus, models, face=None, resamples=100)
    header, rows = result.to_difference_rows()
    order = result.rank_models()
    assert len(header) == len(rows[0]) == 5
    assert [row[:2] for row in rows] == [
        [order[0], order[1]],
        [order[0], order[2]],
        [order[1], order[2]],
    ]
    apart = result.compare(order[1], order[2])
    assert rows[2][2] == f"{apart.value:+.3f}"
    assert apart.value < 0
    assert rows[2][4] == f"{apart.p:.3f}"
