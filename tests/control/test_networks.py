"""Recurrent networks: what they see, what they compute, and their live form."""

import copy
import itertools
import math

import numpy as np
import pytest
from control_cases import NAMES, RATE, SENTENCES, corpus_of, spoken
from hypothesis import given, settings
from hypothesis import strategies as st

from mocap_fit import control
from mocap_fit.control.networks.examples import load_example, sample_targets
from mocap_fit.control.networks.features import (
    INNER_RATE,
    INPUT_NAMES,
    PhoneInputs,
    compute_phone_inputs,
    compute_utterance_inputs,
    count_lead,
    slice_windows,
)
from mocap_fit.control.networks.recurrent import (
    compute_errors_and_gradient,
    compute_hidden,
    compute_outputs,
    count_connections,
    draw_weights,
    subtract_offsets,
)
from mocap_fit.errors import ConfigurationError, DataError
from mocap_fit.phones import PhoneSegment, PhoneSequence, load_phone_set
from mocap_fit.tracks import ParameterTracks

SMALL = {"hidden_units": 5, "max_iter": 2}


def one(segments):
    return PhoneSequence(tuple(segments), phone_set="sv-sta")


@pytest.fixture(scope="module")
def low_latency():
    return control.create("ann-low-latency", **SMALL).fit(corpus_of(SENTENCES[:4]))


# -- the paper's sizes -------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["ann", "ann-low-latency"])
def test_connections_are_those_of_table_1_before_any_training(name):
    model = control.create(name)
    assert list(model.connection_counts.values()) == [40603, 40603, 21332, 21332]
    assert model.parameter_count == 123870
    assert control.create(name, phone_set="sv-sta").parameter_count == 123870
    assert [network.hidden for network in model.networks] == [50, 50, 30, 30]


def test_contexts_are_the_papers():
    first, second = control.create("ann"), control.create("ann-low-latency")
    assert (first.frames_behind, first.frames_ahead) == (15, 15)
    assert (second.frames_behind, second.frames_ahead) == (28, 2)
    assert first.look_ahead == 0.25
    assert second.look_ahead == 2 / 60


def test_connections_are_counted_as_the_arrays_are():
    weights = draw_weights(12, 4, 3, 5, np.random.default_rng(0))
    assert sum(array.size for array in weights) == count_connections(12, 4, 3, 5)


def test_groups_and_hidden_units_of_ones_own():
    groups = {"lips": NAMES[1:8], "jaw": (NAMES[8], NAMES[0], NAMES[9])}
    model = control.create("ann", groups=groups, hidden_units=(4, 3), max_iter=1)
    model.fit(corpus_of(SENTENCES[:2]))
    assert [network.columns for network in model.networks] == [tuple(range(1, 8)), (8, 0, 9)]
    assert model.parameter_count == sum(array.size for own in model.weights_ for array in own)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"groups": {"lips": NAMES[1:]}}, "every parameter once"),
        ({"groups": {"lips": NAMES, "jaw": NAMES[:1]}}, "every parameter once"),
        ({"groups": {"lips": NAMES, "jaw": ()}}, "no parameter"),
        ({"hidden_units": (3, 3)}, "hidden units"),
        ({"hidden_units": 0}, "hidden_units"),
        ({"frames_ahead": -1}, "frames_ahead"),
        ({"frames_behind": 1.5}, "frames_behind"),
        ({"delays": 0}, "delays"),
        ({"patience": 0}, "patience"),
        ({"batch_size": 0}, "batch_size"),
        ({"averaging": 1.0}, "averaging"),
        ({"detrend": 1.0}, "detrend"),
        ({"learning_rate": math.nan}, "learning_rate"),
        ({"random_state": -1}, "random_state"),
    ],
)
def test_impossible_settings_are_refused(wrong, message):
    with pytest.raises(ConfigurationError, match=message):
        control.create("ann", **{**SMALL, **wrong}).fit(corpus_of(SENTENCES[:1]))


def test_a_corpus_of_another_phone_set_is_refused():
    with pytest.raises(DataError, match="another phone set"):
        control.create("ann", phone_set="cs-ipa", **SMALL).fit(corpus_of(SENTENCES[:1]))


def test_members_of_an_ensemble_are_averaged(new_phones):
    corpus = corpus_of(SENTENCES[:3])
    model = control.create("ann-ensemble", n_estimators=3, **SMALL).fit(corpus)
    assert [network.name for network in model.networks[::4]] == [
        "occlusion",
        "occlusion 2",
        "occlusion 3",
    ]
    assert model.parameter_count == 3 * control.create("ann", **SMALL).parameter_count
    found = []
    for member in range(3):
        alone = control.create("ann", **SMALL).fit(corpus)
        alone._set_weights(model.weights_[4 * member : 4 * member + 4])
        found.append(alone.predict(new_phones).values)
    assert np.abs(found[0] - found[1]).max() > 1e-3
    np.testing.assert_allclose(model.predict(new_phones).values, np.mean(found, axis=0), atol=1e-12)


# -- inputs and targets ------------------------------------------------------------------------


def test_inputs_are_the_phones_features_and_whether_something_is_spoken():
    chosen = load_phone_set("sv-sta")
    vowel = PhoneSegment(0.0, 0.1, "A:", 1)
    found = compute_phone_inputs(chosen, vowel)
    assert len(INPUT_NAMES) == len(found) == 18
    np.testing.assert_array_equal(found[:-1], chosen.get_features(vowel))
    assert found[-1] == 1.0
    assert not compute_phone_inputs(chosen, PhoneSegment(0.0, 0.1, "sil")).any()
    unstressed = compute_phone_inputs(chosen, vowel, stress=False)
    assert np.flatnonzero(found != unstressed).tolist() == [INPUT_NAMES.index("stress")]


@given(
    lengths=st.lists(st.integers(1, 12), min_size=1, max_size=8),
    start=st.integers(-3000, 300000),
)
@settings(max_examples=30, deadline=None)
def test_boundaries_on_a_frame_fall_to_the_phone_that_begins(lengths, start):
    # All boundaries on inner frames, at any time of day: rounding must not move one.
    ends = np.cumsum([0, *lengths])
    segments = [
        PhoneSegment((start + a) / INNER_RATE, (start + b) / INNER_RATE, "MSTL"[i % 4])
        for i, (a, b) in enumerate(itertools.pairwise(ends))
    ]
    inputs = PhoneInputs(load_phone_set("sv-sta"), phones=segments)
    times = np.arange(-3, ends[-1] + 3) / INNER_RATE
    wanted = np.repeat([inputs.index((a + 0.5) / INNER_RATE) for a in ends[:-1]], lengths)
    np.testing.assert_array_equal(inputs.indices(times), np.pad(wanted, 3))
    assert [inputs.index(time) for time in times] == inputs.indices(times).tolist()


def test_a_window_holds_the_context_oldest_first():
    phones = spoken("sil M 'A: S sil", 4)
    chosen = load_phone_set("sv-sta")
    inputs = compute_utterance_inputs(phones, chosen, 40, behind=4, ahead=2)
    seen = slice_windows(inputs, 7)
    assert seen.shape == (40, 7 * 18)
    looked_up = PhoneInputs(chosen, phones=phones)
    frame = 21
    for place in range(7):
        time = (frame - count_lead(2) - 4 + place) / INNER_RATE
        row = looked_up.table[looked_up.index(time)]
        np.testing.assert_array_equal(seen[frame, 18 * place : 18 * (place + 1)], row)


@pytest.mark.parametrize("rate", [25.0, 60.0, 100.0, 240.0])
def test_targets_are_the_tracks_at_the_inner_rate(rate):
    times = 0.02 + np.arange(int(2 * rate)) / rate
    values = np.sin(2 * np.pi * 1.5 * times[:, None] + np.array([0.0, 1.0]))
    tracks = ParameterTracks(("a", "b"), rate, values, start_time=0.02)
    found = sample_targets(tracks, -0.1)
    inner = -0.1 + np.arange(len(found)) / INNER_RATE
    inside = (inner >= 0.02 - 1e-9) & (inner <= times[-1] + 1e-9)
    assert inside[-1]
    assert (np.isnan(found).any(axis=1) == ~inside).all()
    wanted = np.sin(2 * np.pi * 1.5 * inner[:, None] + np.array([0.0, 1.0]))
    # The ends of what is filtered from a higher rate are less sure.
    sure = inside & (inner > 0.2) & (inner < 1.8)
    np.testing.assert_allclose(found[sure], wanted[sure], atol=5e-3)


def test_targets_on_the_inner_frames_are_the_values_themselves():
    values = np.random.default_rng(1).normal(size=(50, 3))
    values[7, 1] = np.nan
    tracks = ParameterTracks(("a", "b", "c"), 60.0, values, start_time=0.5)
    found = sample_targets(tracks, 0.5 - 4 / 60)
    assert np.isnan(found[:4]).all()
    np.testing.assert_allclose(found[4:], values, atol=1e-9)


def test_targets_end_where_the_tracks_do_whatever_the_phones_say():
    corpus = corpus_of(SENTENCES[:1])
    utterance = corpus.utterances[0]
    whole = load_example(utterance, corpus, 3, 2)
    assert len(whole.inputs) == len(whole.targets) + 5
    assert len(sample_targets(utterance.read_tracks(), 100.0)) == 0
    single = ParameterTracks(NAMES, RATE, np.ones((1, 10)))
    np.testing.assert_array_equal(sample_targets(single, 0.0), np.ones((1, 10)))


# -- the networks ------------------------------------------------------------------------------


def plainly(weights, network, seen):
    """One network and one sentence, unit by unit as the paper says it."""
    inputs, delayed, hidden_bias, outputs, output_bias = (array[network] for array in weights)
    size, delays = inputs.shape[1], weights.delays
    past = [np.zeros(size) for _ in range(delays)]
    found = []
    for row in seen:
        net = row @ inputs + hidden_bias[0]
        for delay in range(1, delays + 1):
            block = delayed[(delays - delay) * size : (delays - delay + 1) * size]
            net = net + past[-delay] @ block
        past.append(np.tanh(net))
        found.append(past[-1] @ outputs + output_bias[0])
    return np.array(found)


def problem(seed=3):
    rng = np.random.default_rng(seed)
    weights = draw_weights(14, 4, 3, 5, rng, 2)
    weights = weights._replace(
        hidden_bias=rng.normal(size=(2, 1, 4)), output_bias=rng.normal(size=(2, 1, 3))
    )
    seen = rng.normal(size=(3, 13, 14))
    targets = rng.normal(size=(2, 3, 13, 3))
    counted = (rng.random(targets.shape) < 0.8).astype(float)
    return weights, seen, targets, counted


def test_stacked_networks_are_the_plain_ones():
    weights, seen, _, _ = problem()
    found = compute_outputs(weights, compute_hidden(weights, seen)[:, :, weights.delays :])
    for network in range(2):
        for sentence in range(3):
            wanted = plainly(weights, network, seen[sentence])
            np.testing.assert_allclose(found[network, sentence], wanted, atol=1e-12)


def test_a_run_can_be_gone_on_with():
    weights, seen, _, _ = problem()
    whole = compute_hidden(weights, seen)
    first = compute_hidden(weights, seen[:, :6])
    second = compute_hidden(weights, seen[:, 6:], first[:, :, -weights.delays :])
    np.testing.assert_allclose(second, whole[:, :, 6:], atol=1e-12)


@pytest.mark.parametrize("detrend", [0.0, 0.9])
def test_gradients_agree_with_finite_differences(detrend):
    weights, seen, targets, counted = problem()
    counts = counted.sum(axis=(1, 2, 3))

    def error(changed):
        squares, _ = compute_errors_and_gradient(changed, seen, targets, counted, detrend)
        return float((squares.sum(axis=1) / counts).sum())

    _, gradient = compute_errors_and_gradient(weights, seen, targets, counted, detrend)
    rng = np.random.default_rng(0)
    for kind, slope in enumerate(gradient):
        for _ in range(12):
            index = tuple(rng.integers(size) for size in slope.shape)
            sides = []
            for step in (1e-5, -1e-5):
                changed = weights.map(np.copy)
                changed[kind][index] += step
                sides.append(error(changed))
            assert (sides[0] - sides[1]) / 2e-5 == pytest.approx(slope[index], abs=1e-8)


def test_errors_count_only_what_counts():
    weights, seen, targets, counted = problem()
    squares, gradient = compute_errors_and_gradient(weights, seen, targets, counted)
    other = np.where(counted > 0, targets, 99.0)
    again, same = compute_errors_and_gradient(weights, seen, other, counted)
    np.testing.assert_allclose(again, squares, atol=1e-12)
    for one_slope, other_slope in zip(gradient, same, strict=True):
        np.testing.assert_allclose(other_slope, one_slope, atol=1e-12)
    found = compute_outputs(weights, compute_hidden(weights, seen)[:, :, weights.delays :])
    wanted = (((found - targets) * counted) ** 2).sum(axis=(1, 2))
    np.testing.assert_allclose(squares, wanted, atol=1e-12)


def test_what_is_forgiven_is_a_sentences_mean():
    rng = np.random.default_rng(2)
    counted = (rng.random((1, 3, 20, 2)) < 0.7).astype(float)
    difference = rng.normal(size=counted.shape) * counted
    assert subtract_offsets(difference, counted, 0.0) is difference
    kept = subtract_offsets(difference, counted, 1.0)
    np.testing.assert_allclose(kept.sum(axis=2), 0.0, atol=1e-12)
    wanted = difference - difference.sum(axis=2, keepdims=True) / counted.sum(axis=2, keepdims=True)
    np.testing.assert_allclose(kept, wanted * counted, atol=1e-12)
    assert not subtract_offsets(np.zeros((1, 1, 4, 1)), np.zeros((1, 1, 4, 1)), 0.5).any()


# -- predictions, whole and live ---------------------------------------------------------------


def test_predictions_are_those_of_the_plain_networks(low_latency, new_phones):
    model = low_latency
    frames = 40
    inputs = compute_utterance_inputs(new_phones, model.phone_set_, count_lead(2) + frames, 28, 2)
    seen = slice_windows(inputs, 31)
    found = model.predict(new_phones, 60.0, frames=frames).values
    for network, weights in zip(model.networks, model.weights_, strict=True):
        wanted = plainly(weights, 0, seen)[count_lead(2) :]
        np.testing.assert_allclose(found[:, list(network.columns)], wanted, atol=1e-10)


@pytest.mark.parametrize("rate", [60.0, 50.0, 24.0, 144.0])
@pytest.mark.parametrize("name", ["ann", "ann-low-latency"])
def test_live_frames_are_the_very_numbers_of_predict(name, rate, trained, new_phones):
    model = trained(name)
    stream = model.stream(rate)
    frames = []
    for segment in new_phones:
        stream.push(segment)
        frames.extend(stream.pull())
    frames.extend(stream.finish())
    np.testing.assert_array_equal(frames, model.predict(new_phones, rate).values)


def test_a_long_live_utterance_keeps_its_numbers(low_latency):
    phones = spoken(" ".join(["M 'A: L I: sil S 'O: T"] * 12), 8)
    stream = low_latency.stream(60.0)
    frames = []
    for segment in phones:
        stream.push(segment)
        frames.extend(stream.pull())
    frames.extend(stream.finish())
    np.testing.assert_array_equal(frames, low_latency.predict(phones, 60.0).values)
    # What is long past is not kept.
    assert len(stream._inputs._starts) < 30


def test_a_live_frame_comes_as_soon_as_its_look_ahead_is_known(low_latency):
    stream = low_latency.stream(60.0)
    assert stream.pull().shape == (0, 10)
    stream.push(PhoneSegment(1.0, 1.0 + 10 / 60, "M"))
    # Frame 7 looks at frame 9, the last of the phone; frame 8 looks at what is not known.
    assert len(stream.pull()) == 8
    stream.push(PhoneSegment(1.0 + 10 / 60, 1.0 + 11 / 60, "S"))
    assert len(stream.pull()) == 1
    assert len(stream.pull()) == 0
    assert len(stream.finish()) == 2


@given(at=st.floats(0.3, 0.9), seed=st.integers(0, 3))
@settings(max_examples=25, deadline=None)
def test_the_look_ahead_is_exact_at_every_time(low_latency, at, seed):
    phones = spoken("M 'A: L I: S 'O: T A B 'I: R M 'A: S", seed)
    sight = at + low_latency.look_ahead
    changed = [
        PhoneSegment(s.start, s.end, "P" if s.start > sight + 1e-6 else s.phone, s.stress)
        for s in phones
    ]
    times = np.array([at])
    wanted = low_latency.predict_at(phones, times)
    found = low_latency.predict_at(one(changed), times)
    np.testing.assert_array_equal(found, wanted)


def test_what_is_just_in_sight_matters(low_latency):
    before = one([PhoneSegment(0.0, 0.5, "A:"), PhoneSegment(0.5, 1.0, "A:")])
    after = one([PhoneSegment(0.0, 0.5, "A:"), PhoneSegment(0.5, 1.0, "P")])
    for at in (0.5 - 2 / 60, 0.5 - 1.7 / 60):
        found = [low_latency.predict_at(phones, np.array([at])) for phones in (before, after)]
        assert np.abs(found[0] - found[1]).max() > 1e-9


def test_between_inner_frames_the_movement_is_continuous(low_latency, new_phones):
    inner = low_latency.predict(new_phones, 60.0).values
    fine = low_latency.predict(new_phones, 6000.0).values
    np.testing.assert_allclose(fine[::100], inner, atol=1e-9)
    # A phone that comes into sight between two frames shows at once, and no more than it will.
    largest = np.abs(np.diff(inner, axis=0)).max()
    assert np.abs(np.diff(fine, axis=0)).max() <= largest + 1e-9


def test_silence_lasts(low_latency, new_phones):
    times = np.array([-50.0, -0.5, new_phones[-1].end + 3.0, new_phones[-1].end + 1e6])
    found = low_latency.predict_at(new_phones, times)
    np.testing.assert_array_equal(found[0], found[1])
    np.testing.assert_array_equal(found[2], found[3])
    np.testing.assert_allclose(found[0], found[2], atol=0.1)


def test_without_stress_stress_does_not_matter():
    corpus = corpus_of(SENTENCES[:2])
    phones = one([PhoneSegment(0.0, 0.2, "A:", 0), PhoneSegment(0.2, 0.4, "S")])
    stressed = one([PhoneSegment(0.0, 0.2, "A:", 1), PhoneSegment(0.2, 0.4, "S")])
    for stress in (True, False):
        model = control.create("ann", stress=stress, **SMALL).fit(corpus)
        found = [model.predict(each).values for each in (phones, stressed)]
        assert (np.abs(found[0] - found[1]).max() > 1e-9) == stress


def test_the_first_frame_sees_silence_alone_and_the_next_the_first_phone():
    phones = spoken("M 'A: S", 4, start=3.0)
    chosen = load_phone_set("sv-sta")
    for ahead in (0, 2, 15):
        inputs = compute_utterance_inputs(phones, chosen, 60, behind=4, ahead=ahead)
        seen = slice_windows(inputs, 4 + 1 + ahead)
        assert not seen[0].any()
        np.testing.assert_array_equal(seen[1][-18:], compute_phone_inputs(chosen, phones[0]))
        assert not seen[1][:-18].any()


def test_after_a_second_without_phones_in_sight_nothing_moves(low_latency):
    phones = spoken("sil M 'A:", 4)
    last = phones[-1].end - phones[0].start + (28 + 60) / INNER_RATE
    times = phones[0].start + last + np.array([-1.0 / INNER_RATE, 0.0, 1.0, 50.0])
    # Hidden units that forget as slowly as they can.
    model = copy.deepcopy(low_latency)
    weights = []
    for each in model.weights_:
        delayed = np.zeros_like(each.delayed)
        delayed[:, -delayed.shape[2] :] = np.eye(delayed.shape[2])
        weights.append(each._replace(delayed=delayed))
    model._set_weights(weights)
    values = model.predict_at(phones, times)
    assert np.abs(values[1] - values[0]).max() > 1e-9
    np.testing.assert_array_equal(values[1], values[2])
    np.testing.assert_array_equal(values[1], values[3])


@given(offset=st.floats(-3e-9, 3e-9))
@settings(max_examples=20, deadline=None)
def test_a_boundary_within_rounding_is_reached(offset):
    segments = [PhoneSegment(0.0, 0.5, "M"), PhoneSegment(0.5, 1.0, "S")]
    inputs = PhoneInputs(load_phone_set("sv-sta"), phones=segments)
    assert inputs.index(0.5 + offset) == 2
    assert inputs.indices(np.array([0.5 + offset])).tolist() == [2]
    assert inputs.index(0.5 - 1e-6) == 1
    assert inputs.index(1.0 + offset) == 0
    assert inputs.end == 1.0
    inputs.forget_before(0.5)
    assert inputs.index(0.4) == 1
    inputs.forget_before(0.6)
    assert inputs.index(0.4) == 0
    inputs.forget_before(9.0)
    assert inputs.index(0.7) == 2


def test_two_frames_are_joined_by_a_line():
    tracks = ParameterTracks(("a",), 30.0, np.array([[0.0], [1.0]]))
    np.testing.assert_allclose(sample_targets(tracks, 0.0)[:, 0], [0.0, 0.5, 1.0], atol=1e-9)
    np.testing.assert_allclose(sample_targets(tracks, -1 / 60)[1:, 0], [0.0, 0.5, 1.0], atol=1e-9)
    assert np.isnan(sample_targets(tracks, -1 / 60)[0, 0])


def test_the_mean_error_of_one_value_is_itself():
    counted = np.array([0.0, 1.0, 0.0]).reshape(1, 1, 3, 1)
    difference = counted * 0.6
    np.testing.assert_allclose(subtract_offsets(difference, counted, 1.0), 0.0, atol=1e-15)
    np.testing.assert_allclose(subtract_offsets(difference, counted, 0.25), 0.75 * difference)


@pytest.mark.parametrize(("late", "is_missing"), [(1.5e-6, False), (2.5e-6, True)])
def test_a_neighbour_that_is_missing_has_a_share_from_two_millionths_of_a_sample(late, is_missing):
    """Targets are sampled four times an inner frame; a time within rounding of one is its."""
    tracks = ParameterTracks(("a",), 60.0, np.array([[1.0], [np.nan], [2.0], [3.0]]))
    found = sample_targets(tracks, late / (4 * INNER_RATE))[:, 0]
    assert found[0] == 1.0 or is_missing
    assert np.isnan(found[0]) == is_missing
    assert np.isnan(found[1])
