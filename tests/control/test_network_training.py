"""Recurrent networks: what they learn, when they stop, and how they go on after a stop."""

import math
from itertools import pairwise

import numpy as np
import pytest
from control_cases import NAMES, SENTENCES, corpus_of, spoken

from mocap_fit import control
from mocap_fit.control.model_file import write_model_file
from mocap_fit.control.networks import sweep_look_ahead
from mocap_fit.control.networks.examples import (
    Example,
    Scale,
    build_batch,
    load_examples,
    sample_targets,
    split_into_batches,
)
from mocap_fit.control.networks.features import INNER_RATE, PhoneInputs, count_lead
from mocap_fit.control.networks.frames import FrameNetworks, RunningNetworks
from mocap_fit.control.networks.recurrent import draw_weights
from mocap_fit.control.networks.stack import Network, Stack
from mocap_fit.control.networks.training import Plan, Training
from mocap_fit.corpus import Corpus, Utterance
from mocap_fit.errors import ConfigurationError, DataError, FileFormatError
from mocap_fit.phones import load_phone_set
from mocap_fit.tracks import ParameterTracks

PHONES = "M B P F V S T D N L R K A: I: O: U: E0 A I Å Ö4".split()  # noqa: SIM905


def saved(model, path) -> bytes:
    model.save(path)
    return path.read_bytes()


def sentences(count, length=16, seed=0):
    """Random sentences of a few phones, some of them stressed."""
    rng = np.random.default_rng(seed)
    chosen = load_phone_set("sv-sta")
    return [
        " ".join(
            [
                "sil",
                *(
                    "'" * bool(chosen.get_phone(p).takes_stress and rng.random() < 0.4) + p
                    for p in rng.choice(PHONES, length)
                ),
                "sil",
            ]
        )
        for _ in range(count)
    ]


def told_by_networks(texts, groups, hidden, behind=15, ahead=15, seed=5):
    """A corpus whose tracks random networks have made."""
    chosen = load_phone_set("sv-sta")
    names = tuple(name for group in groups for name in group)
    networks, weights, first = [], [], 0
    rng = np.random.default_rng(seed)
    for group, size in zip(groups, hidden, strict=True):
        columns = tuple(range(first, first + len(group)))
        networks.append(Network(group[0], columns, size))
        inputs = (behind + 1 + ahead) * 18
        weights.append(draw_weights(inputs, size, len(group), 5, rng))
        first += len(group)
    truth = FrameNetworks(networks, weights, len(names), behind, ahead)
    utterances = []
    for number, text in enumerate(texts):
        phones = spoken(text, 300 + number)
        running = RunningNetworks(truth, PhoneInputs(chosen, phones=phones))
        times = np.arange(math.ceil(phones.duration * 60)) / 60
        values = np.array([running.at(time) for time in times])
        utterances.append(
            Utterance.from_tracks(ParameterTracks(names, 60.0, values, name=phones.name), phones)
        )
    return Corpus.from_utterances(utterances, chosen)


def error_of_range(model, corpus):
    """RMSE in percent of the range, the mean over the parameters."""
    found = np.concatenate(
        [model.predict_at(u.read_phones(), u.read_tracks().times) for u in corpus]
    )
    wanted = np.concatenate([u.read_tracks().values for u in corpus])
    ranges = wanted.max(axis=0) - wanted.min(axis=0)
    return float(np.mean(100 * np.sqrt(np.mean((found - wanted) ** 2, axis=0)) / ranges))


# -- what is learned ---------------------------------------------------------------------------


@pytest.mark.slow
def test_networks_of_the_same_form_are_learned():
    groups = {"lips": ("open", "round"), "jaw": ("down",)}
    corpus = told_by_networks(sentences(32), groups.values(), (4, 4), behind=5, ahead=5)
    training, test = corpus.hold_out(0.2)
    training, validation = training.hold_out(0.15)
    model = control.create(
        "ann", groups=groups, hidden_units=8, frames_behind=5, frames_ahead=5, max_iter=60,
        learning_rate=0.01,
    )  # fmt: skip
    model.fit(training, validation)
    assert error_of_range(model, test) < 3.0


@pytest.mark.slow
@pytest.mark.parametrize("name", ["ann", "ann-low-latency"])
def test_the_papers_networks_are_learned(name):
    new = control.create(name)
    groups = [tuple(NAMES[c] for c in network.columns) for network in new.networks]
    corpus = told_by_networks(
        sentences(150, 30), groups, (50, 50, 30, 30), new.frames_behind, new.frames_ahead
    )
    training, test = corpus.hold_out(0.2)
    training, validation = training.hold_out(0.15)
    model = new.fit(training, validation)
    assert error_of_range(model, test) < 3.0


@pytest.mark.slow
@pytest.mark.parametrize("name", ["ann", "ann-low-latency", "ann-ensemble"])
def test_networks_beat_phone_means_on_new_sentences(name):
    training, test = corpus_of(sentences(60)).hold_out(0.2)
    kept, validation = training.hold_out(0.15)
    ours = control.create(name).fit(kept, validation)
    means = control.create("phone-mean").fit(training)
    assert error_of_range(ours, test) < 0.8 * error_of_range(means, test)


def test_training_lessens_the_error_of_every_network(small_corpus, small_validation):
    model = control.create("ann", hidden_units=8, max_iter=12, random_state=3)
    model.fit(small_corpus, small_validation)
    for network in model.networks:
        own = [entry for entry in model.log_ if entry.part == network.name]
        assert [entry.iteration for entry in own] == list(range(len(own)))
        assert own[-1].training_error < 0.7 * own[0].training_error
        assert min(e.validation_error for e in own) < own[0].validation_error


def test_the_weights_of_the_least_validation_error_are_kept(small_corpus, small_validation):
    model = control.create("ann", hidden_units=8, max_iter=25, patience=2, learning_rate=0.03)
    model.fit(small_corpus, small_validation)
    stopped = 0
    for network in model.networks:
        own = [e.validation_error for e in model.log_ if e.part == network.name]
        stopped += len(own) <= 25
        columns = list(network.columns)
        squares = [
            (model.predict_at(u.read_phones(), u.read_tracks().times) - u.read_tracks().values)[
                :, columns
            ]
            ** 2
            for u in small_validation
        ]
        # The log counts inner frames, here are the corpus's own.
        kept = math.sqrt(float(np.mean(np.concatenate(squares))))
        assert kept == pytest.approx(min(own), rel=0.1)
        assert own.index(min(own)) >= len(own) - 1 - 2
    assert stopped, "no network stopped before the last epoch"


def test_networks_rest_one_by_one(small_corpus, small_validation):
    # What a network learns does not depend on how long the others do.
    together = control.create("ann", hidden_units=6, max_iter=14, patience=2, learning_rate=0.02)
    together.fit(small_corpus, small_validation)
    lengths = [sum(e.part == n.name for e in together.log_) for n in together.networks]
    assert len(set(lengths)) > 1, "all stopped at once: this shows nothing"
    by_name = {}
    for entry in together.log_:
        by_name.setdefault(entry.part, []).append(entry.iteration)
    assert all(each == list(range(len(each))) for each in by_name.values())


def test_seeds_make_the_model(small_corpus, tmp_path):
    same, again, other = (
        control.create("ann", hidden_units=4, max_iter=2, random_state=seed).fit(small_corpus)
        for seed in (1, 1, 2)
    )
    assert saved(same, tmp_path / "a") == saved(again, tmp_path / "b")
    assert not np.array_equal(same.weights_[0].inputs, other.weights_[0].inputs)


def test_no_epoch_is_no_training(small_corpus, new_phones):
    model = control.create("ann", hidden_units=4, max_iter=0).fit(small_corpus)
    assert {entry.iteration for entry in model.log_} == {0}
    assert np.isfinite(model.predict(new_phones).values).all()


def test_utterances_without_values_do_not_count(small_corpus, tmp_path):
    nothing = small_corpus.utterances[0].read_tracks()
    nothing = nothing.replace(values=np.full_like(nothing.values, np.nan), name="zz")
    empty = Utterance.from_tracks(nothing, small_corpus.utterances[0].read_phones())
    more = Corpus.from_utterances([*small_corpus, empty], "sv-sta")
    models = [
        control.create("ann", hidden_units=4, max_iter=2).fit(corpus)
        for corpus in (small_corpus, more)
    ]
    for one, other in zip(*(model.weights_[0] for model in models), strict=True):
        np.testing.assert_array_equal(one, other)
    with pytest.raises(DataError, match="no utterance has a parameter value"):
        control.create("ann").fit(Corpus.from_utterances([empty], "sv-sta"))


def test_drift_between_utterances_can_be_left_alone():
    corpus = told_by_networks(sentences(20), [("open", "round")], (4,), behind=5, ahead=5)
    training, test = corpus.hold_out(0.2)
    rng = np.random.default_rng(4)

    def drifted(utterance):
        tracks = utterance.read_tracks()
        values = tracks.values + rng.normal(0.0, 3 * np.std(tracks.values), 2)
        return Utterance.from_tracks(tracks.replace(values=values), utterance.read_phones())

    training = Corpus.from_utterances([drifted(utterance) for utterance in training], "sv-sta")
    errors = []
    for detrend in (0.0, 0.99):
        model = control.create(
            "ann", hidden_units=8, frames_behind=5, frames_ahead=5, max_iter=25,
            learning_rate=0.01, detrend=detrend,
        ).fit(training)  # fmt: skip
        apart = [
            model.predict_at(u.read_phones(), u.read_tracks().times) - u.read_tracks().values
            for u in test
        ]
        errors.append(np.sqrt(np.mean([np.var(each, axis=0) for each in apart])))
    assert errors[1] < 0.7 * errors[0]


# -- going on ----------------------------------------------------------------------------------


class Stopped(Exception):
    pass


@pytest.mark.parametrize("epochs", [1, 4, 9])
def test_a_stopped_training_goes_on_to_the_same_bytes(
    epochs, small_corpus, small_validation, tmp_path
):
    settings = {"hidden_units": (6, 6, 4, 4), "max_iter": 12, "patience": 2, "learning_rate": 0.02}
    whole = control.create("ann", **settings).fit(small_corpus, small_validation)
    wanted = saved(whole, tmp_path / "whole")
    path = tmp_path / "checkpoint"

    def stop(entry):
        if entry.iteration > epochs:
            raise Stopped

    broken = control.create("ann", **settings)
    with pytest.raises(Stopped):
        broken.fit(small_corpus, small_validation, progress=stop, checkpoint=path)
    with pytest.raises(DataError, match="not trained"):
        broken.predict(small_corpus.utterances[0].read_phones())
    told = []
    model = control.create("ann", **settings).fit(
        small_corpus, small_validation, progress=told.append, checkpoint=path
    )
    assert min(entry.iteration for entry in told) == epochs + 1
    assert model.log_ == whole.log_
    assert saved(model, tmp_path / "resumed") == wanted


def test_other_settings_begin_anew(small_corpus, tmp_path):
    path = tmp_path / "checkpoint"
    control.create("ann", hidden_units=4, max_iter=2).fit(small_corpus, checkpoint=path)
    told = []
    control.create("ann", hidden_units=4, max_iter=3).fit(
        small_corpus, checkpoint=path, progress=told.append
    )
    assert told[0].iteration == 0


def test_a_file_that_is_no_checkpoint_stays(small_corpus, tmp_path):
    model = control.create("ann", hidden_units=4, max_iter=1)
    for name in ("model", "other", "text"):
        path = tmp_path / name
        if name == "model":
            model.fit(small_corpus).save(path)
        elif name == "other":
            write_model_file({"checkpoint": "cohen-massaro"}, {}, path)
        else:
            path.write_text("notes on the recordings")
        before = path.read_bytes()
        with pytest.raises(FileFormatError, match=name):
            model.fit(small_corpus, checkpoint=path)
        assert path.read_bytes() == before


# -- batches -----------------------------------------------------------------------------------


def example_of(frames, seed=0):
    rng = np.random.default_rng(seed)
    targets = rng.normal(size=(frames, 2))
    targets[0, 1] = np.nan
    return Example(rng.normal(size=(frames + 4, 18)).astype(np.float32), targets)


def test_a_batch_pads_and_counts():
    those = [example_of(5), example_of(9, 1)]
    made = build_batch(those, Scale(np.array([1.0, 2.0]), np.array([2.0, 4.0])))
    assert made.inputs.shape == (2, 13, 18)
    assert made.counted.sum() == 2 * (5 + 9) - 2
    assert not made.counted[0, 5:].any()
    np.testing.assert_allclose(
        made.targets[1, 3], (those[1].targets[3] - [1.0, 2.0]) / [2.0, 4.0], rtol=1e-6
    )


def test_every_example_is_in_one_batch_an_epoch():
    those = [example_of(n) for n in (5, 50, 7, 40, 6, 45, 8)]
    plain = split_into_batches(those, 2)
    assert plain[0] == (0, 4)
    for seed in (0, 1):
        mixed = split_into_batches(those, 2, np.random.default_rng(seed))
        assert sorted(i for group in mixed for i in group) == list(range(7))
        assert {len(group) for group in mixed} == {1, 2}
    assert split_into_batches(those, 2, np.random.default_rng(0)) != mixed


def test_the_scale_of_what_does_not_move_or_is_not_there():
    flat = np.column_stack([np.full(6, 0.3), np.full(6, np.nan), np.arange(6.0)])
    scale = Scale.from_examples([Example(np.zeros((10, 18), np.float32), flat)])
    np.testing.assert_allclose(scale.mean, [0.3, 0.0, 2.5])
    np.testing.assert_allclose(scale.deviation, [1.0, 1.0, np.std(np.arange(6.0))])


def test_a_network_starts_from_the_same_weights_whatever_is_beside_it():
    own = Network("jaw", (0, 1), 4)
    alone = Stack.from_networks([own], 36, 5, 5, seed=2)
    beside = Stack.from_networks([Network("lips", (2, 3, 4), 4), own], 36, 5, 5, seed=2)
    np.testing.assert_array_equal(alone.weights.inputs[0], beside.weights.inputs[1])
    np.testing.assert_array_equal(alone.weights.delayed[0], beside.weights.delayed[1])
    assert not beside.weights.outputs[1, :, 2].any()


# -- the sweep of figure 4 ---------------------------------------------------------------------


def test_the_sweep_tells_what_separate_networks_would(small_corpus, small_validation):
    # One sentence has one order.
    small_corpus = small_corpus.select(["s3"])
    settings = control.create("ann-low-latency", hidden_units=4, max_iter=8)
    told = []
    points = sweep_look_ahead(
        small_corpus, small_validation, frames=(0, 3, 15), settings=settings, progress=told.append
    )
    assert [point.frames for point in points] == [0, 3, 15]
    assert [point.look_ahead for point in points] == [0.0, 0.05, 0.25]
    assert {entry.part for entry in told} == {"0 ahead", "3 ahead", "15 ahead"}
    names = ("jaw_rotation", "upper_lip_raise", "lower_lip_depression")

    def occlusion(corpus):
        return Corpus.from_utterances(
            [
                Utterance.from_tracks(
                    u.read_tracks().replace(
                        names=names,
                        values=u.read_tracks().values[:, u.read_tracks().indices(names)],
                        standard_deviations=None,
                    ),
                    u.read_phones(),
                )
                for u in corpus
            ],
            corpus.phone_set,
        )

    for point in points:
        alone = control.create(
            "ann-low-latency", groups={f"{point.frames} ahead": names}, hidden_units=4, max_iter=8,
            frames_ahead=point.frames, frames_behind=30 - point.frames,
        )  # fmt: skip
        alone.fit(occlusion(small_corpus), occlusion(small_validation))
        least = min(entry.validation_error for entry in alone.log_)
        assert point.error == pytest.approx(least, rel=2e-3)


@pytest.mark.slow
def test_seeing_ahead_helps_where_the_tracks_move_early():
    corpus = told_by_networks(sentences(24, 12), [("open",)], (6,), behind=2, ahead=4)
    training, held_out = corpus.hold_out(0.2)
    settings = control.create("ann-low-latency", hidden_units=8, max_iter=12, learning_rate=0.01)
    points = sweep_look_ahead(training, held_out, frames=(0, 2, 6), settings=settings)
    errors = [point.error for point in points]
    assert errors[0] > 1.2 * errors[1] > 1.2 * errors[2]
    assert all(0 < point.epoch <= 12 for point in points)


@pytest.mark.parametrize("frames", [(), (1, 1), (-1,), (31,)])
def test_impossible_look_aheads_are_refused(frames, small_corpus):
    with pytest.raises(ConfigurationError, match="look-aheads"):
        sweep_look_ahead(small_corpus, small_corpus, frames=frames)


def test_a_sweep_of_what_is_not_there_is_refused(small_corpus):
    with pytest.raises(DataError, match="brow"):
        sweep_look_ahead(small_corpus, small_corpus, parameters=("brow",))
    uneven = control.create("ann-low-latency", hidden_units=(4, 4, 3, 3))
    with pytest.raises(ConfigurationError, match="one size"):
        sweep_look_ahead(small_corpus, small_corpus, settings=uneven)


def test_examples_are_those_with_values(small_corpus):
    assert len(load_examples(small_corpus, 3, 2)) == len(small_corpus)
    assert corpus_of(SENTENCES[:1]).parameter_names == NAMES


# -- the optimiser -----------------------------------------------------------------------------


def plan_of(**changes):
    settings = {
        "max_iter": 4, "patience": 9, "batch_size": 2, "learning_rate": 0.01,
        "averaging": 0.9, "detrend": 0.0, "random_state": 1,
    }  # fmt: skip
    return Plan(**{**settings, **changes})


def test_the_learning_rate_falls_along_a_half_cosine_to_a_hundredth():
    plan = plan_of(max_iter=10, learning_rate=0.2)
    assert plan.compute_rate(1) == pytest.approx(0.2)
    assert plan.compute_rate(6) == pytest.approx(0.2 * (0.01 + 0.99 / 2))
    assert plan.compute_rate(11) == pytest.approx(0.002)
    rates = [plan.compute_rate(epoch) for epoch in range(1, 11)]
    assert rates == sorted(rates, reverse=True)
    angles = np.pi * np.arange(10) / 10
    np.testing.assert_allclose(rates, 0.2 * (0.01 + 0.99 * np.cos(angles / 2) ** 2))


def stack_of(rng, networks=2):
    names = [Network(f"n{i}", (i,), 3) for i in range(networks)]
    return Stack.from_networks(names, 4, 2, networks, seed=1)


def test_steps_are_those_of_adam_with_clipping_and_a_running_average(rng):
    # Kingma and Ba 2015, algorithm 1, in double precision.
    stack = stack_of(rng)
    weights = [np.array(a, dtype=np.float64) for a in stack.weights]
    first, second = ([np.zeros_like(w) for w in weights] for _ in range(2))
    average = [w.copy() for w in weights]
    for step in range(1, 31):
        scale = 3.0 if step % 3 else 0.01
        gradient = stack.weights.map(
            lambda a, scale=scale: (scale * rng.normal(size=a.shape)).astype(np.float32)
        )
        norms = np.sqrt(sum(np.sum(np.square(g), axis=(1, 2)) for g in gradient))
        clip = np.minimum(1.0, 1.0 / norms).reshape(-1, 1, 1)
        stack.step(gradient, rate=0.02, averaging=0.9)
        share = max(0.1, 1.0 / step)
        for i, slope in enumerate(gradient):
            slope = slope * clip
            first[i] = 0.9 * first[i] + 0.1 * slope
            second[i] = 0.999 * second[i] + 0.001 * slope**2
            unbiased = first[i] / (1 - 0.9**step), second[i] / (1 - 0.999**step)
            weights[i] = weights[i] - 0.02 * unbiased[0] / (np.sqrt(unbiased[1]) + 1e-8)
            average[i] += share * (weights[i] - average[i])
    assert stack.steps == 30
    for found, wanted in ((stack.weights, weights), (stack.average, average)):
        for one, other in zip(found, wanted, strict=True):
            np.testing.assert_allclose(one, other, atol=2e-4)


def test_gradients_of_almost_nothing_do_almost_nothing(rng):
    # Epsilon is 1e-8: a gradient of that size makes half a step.
    stack = stack_of(rng)
    before = stack.weights.map(np.copy)
    unbiased = np.sqrt(1 - 0.999) / (1 - 0.9)
    stack.step(stack.weights.map(lambda a: np.full_like(a, 1e-8)), rate=1.0, averaging=0.0)
    moments = 0.1 * 1e-8, np.sqrt(0.001) * 1e-8
    wanted = unbiased * moments[0] / (moments[1] + 1e-8)
    for one, other in zip(before, stack.weights, strict=True):
        np.testing.assert_allclose(one - other, wanted, rtol=1e-3)


def test_the_best_average_is_stored_and_patience_counts_epochs(rng):
    stack = stack_of(rng)
    stack.average = stack.average.map(lambda a: np.full_like(a, 1.0))
    stack.judge([0.5, 0.7])
    stack.average = stack.average.map(lambda a: np.full_like(a, 2.0))
    stack.judge([0.6, 0.4])
    assert stack.least == [0.5, 0.4]
    assert stack.since == [1, 0]
    for array in stack.best:
        assert (array[0] == 1.0).all()
        assert (array[1] == 2.0).all()
    # An error that is equal, or none, is not better.
    stack.judge([0.5, float("nan")])
    assert stack.since == [2, 1]
    stack.stop(3)
    assert stack.active == [0, 1]
    stack.stop(2)
    assert stack.active == [1]
    assert all(len(array) == 1 for array in stack.weights)
    stack.average = stack.average.map(lambda a: np.full_like(a, 3.0))
    stack.judge([0.3])
    assert stack.least == [0.5, 0.3]
    assert all((array[1] == 3.0).all() and (array[0] == 1.0).all() for array in stack.best)


def test_weights_are_drawn_as_large_as_their_number_asks():
    weights = draw_weights(400, 50, 60, 4, np.random.default_rng(0), networks=3)
    assert weights.inputs.shape == (3, 400, 50)
    assert weights.delayed.shape == (3, 200, 50)
    assert weights.outputs.shape == (3, 50, 60)
    for array, deviation in (
        (weights.inputs, 400**-0.5),
        (weights.delayed, 0.7 * 200**-0.5),
        (weights.outputs, 50**-0.5),
    ):
        assert array.std() == pytest.approx(deviation, rel=0.05)
        assert abs(array.mean()) < 0.05 * deviation
    assert not weights.hidden_bias.any()
    assert not weights.output_bias.any()


def training_of(corpus, validation, plan, networks):
    data, held_out = (
        () if part is None else load_examples(part, 1, 1) for part in (corpus, validation)
    )
    return Training(networks, plan, 2, data, held_out, Scale.from_examples(data))


NETWORKS = [Network("a", (0, 2), 3), Network("b", (1,), 3), Network("c", tuple(range(3, 10)), 2)]


def test_the_rate_of_an_epoch_is_that_of_the_plan(small_corpus):
    # One step an epoch; the moments of Adam make it as long as the rate where gradients stay alike.
    plan = plan_of(max_iter=4, batch_size=99, learning_rate=1e-3, averaging=0.0)
    training = training_of(small_corpus, None, plan, NETWORKS)
    points = [training.stacks[0].weights.map(np.copy)]

    def log(entry):
        if entry.part == "a" and entry.iteration:
            points.append(training.stacks[0].weights.map(np.copy))

    training.run(log)
    moved = [
        np.median(np.abs(after.output_bias - before.output_bias)[0])
        for before, after in pairwise(points)
    ]
    assert len(moved) == 4
    assert moved[0] == pytest.approx(plan.compute_rate(1), rel=1e-3)
    for epoch in (2, 3, 4):
        assert moved[epoch - 1] / moved[0] == pytest.approx(
            plan.compute_rate(epoch) / plan.compute_rate(1), abs=0.2
        )
    assert moved[3] < 0.3 * moved[0]


def test_errors_of_the_log_are_in_the_unit_of_the_corpus(small_corpus, small_validation):
    plan = plan_of(max_iter=0)
    training = training_of(small_corpus, small_validation, plan, NETWORKS)
    entries = []
    training.run(entries.append)
    assert [(entry.iteration, entry.part) for entry in entries] == [(0, "a"), (0, "b"), (0, "c")]
    weights = training.get_weights()
    running = FrameNetworks(NETWORKS, weights, 10, 1, 1)
    for part, name in ((small_corpus, "training_error"), (small_validation, "validation_error")):
        squares = []
        for utterance in part:
            inputs = PhoneInputs(part.phone_set, True, utterance.read_phones())
            networks = RunningNetworks(running, inputs)
            targets = sample_targets(
                utterance.read_tracks(), inputs.start_time - count_lead(1) / INNER_RATE
            )
            values = [networks.at((i - count_lead(1)) / INNER_RATE) for i in range(len(targets))]
            squares.append((np.array(values) - targets) ** 2)
        squares = np.concatenate(squares)
        for entry, network in zip(entries, NETWORKS, strict=True):
            wanted = np.sqrt(np.nanmean(squares[:, list(network.columns)]))
            assert getattr(entry, name) == pytest.approx(wanted, rel=1e-4)


def test_without_a_validation_part_the_training_error_decides(small_corpus):
    plan = plan_of(max_iter=6, learning_rate=0.5, patience=2, averaging=0.0)
    training = training_of(small_corpus, None, plan, NETWORKS)
    entries = []
    training.run(entries.append)
    assert all(entry.validation_error is None for entry in entries)
    # Of one parameter, so that it does not matter that others are weighted by their deviation.
    errors = [entry.training_error for entry in entries if entry.part == "b"]
    assert len(errors) - 1 == min(int(np.argmin(errors)) + 2, 6)


def test_weights_are_those_of_one_network_each(small_corpus):
    training = training_of(small_corpus, None, plan_of(max_iter=0), NETWORKS)
    weights = training.get_weights()
    assert [len(each.inputs) for each in weights] == [1, 1, 1]
    for each, network in zip(weights, NETWORKS, strict=True):
        shapes = [array.shape for array in each]
        size, outputs = network.hidden, len(network.columns)
        assert shapes == [
            (1, 3 * 18, size), (1, 2 * size, size), (1, 1, size), (1, size, outputs),
            (1, 1, outputs),
        ]  # fmt: skip
