"""Cohen and Massaro's model: its equations, and truth that it made itself."""

import dataclasses
import math
from types import SimpleNamespace

import numpy as np
import pytest
from control_cases import corpus_of, noisy, spoken
from dominance_oracle import jacobian
from hypothesis import given, settings
from hypothesis import strategies as st

from mocap_fit import control
from mocap_fit.control import cohen_massaro, dominance, dominance_kernel
from mocap_fit.control.dominance import Frames
from mocap_fit.control.symbols import Symbols
from mocap_fit.control.training import load_utterances
from mocap_fit.corpus import Corpus, Utterance
from mocap_fit.errors import ConfigurationError, DataError
from mocap_fit.phones import PhoneSegment, PhoneSequence, load_phone_set
from mocap_fit.tracks import ParameterTracks

PHONES = 6


def free_parameters(rng, phones=PHONES):
    """T, and logarithms of alpha, theta, phi, c, for times in tenths of a second."""
    spreads = np.array([1.0, 0.5, 0.4, 0.4, 0.2])
    return rng.normal(0.0, 1.0, (phones, 5)) * spreads + np.array([0.0, 0.0, 0.3, 0.3, 0.1])


def an_utterance(rng, segments=12):
    positions = rng.integers(0, PHONES, segments)
    centres = np.cumsum(rng.uniform(0.4, 1.5, segments))
    return positions, centres


def by_the_paper(free, positions, centres, time):
    """Equations 7 and 8, word for word."""
    above, below = 0.0, 0.0
    for position, centre in zip(positions, centres, strict=True):
        target, alpha, theta, phi, c = free[position, 0], *np.exp(free[position, 1:])
        if time < centre:
            height = alpha * math.exp(-theta * (centre - time) ** c)
        else:
            height = alpha * math.exp(-phi * (time - centre) ** c)
        above += target * height
        below += height
    return above / below


def forms():
    plain = SimpleNamespace(compute_trajectory=dominance.compute_trajectory, jacobian=jacobian)
    return pytest.mark.parametrize("form", [plain, dominance_kernel], ids=["numpy", "compiled"])


@forms()
def test_the_trajectory_is_that_of_the_paper(form, rng):
    free = free_parameters(rng)
    positions, centres = an_utterance(rng)
    times = np.concatenate([np.linspace(-0.5, centres[-1] + 0.5, 80), centres])
    wanted = [by_the_paper(free, positions, centres, time) for time in times]
    found = form.compute_trajectory(free, Frames.from_segments(positions, centres, times))
    np.testing.assert_allclose(found, wanted, atol=1e-7)


@forms()
def test_the_gradient_agrees_with_finite_differences(form, rng):
    for _ in range(4):
        free = free_parameters(rng)
        positions, centres = an_utterance(rng)
        # Between the centres, where every derivative is there; 9 segments meet the cut of nothing.
        times = np.sort(rng.uniform(centres[0], centres[-1], 40))
        frames = Frames.from_segments(positions, centres, times)
        values, derivatives = form.jacobian(free, frames)
        np.testing.assert_allclose(values, form.compute_trajectory(free, frames), atol=1e-14)
        step = 1e-5
        for place, phone in enumerate(frames.phones):
            for which in range(5):
                ahead, behind = free.copy(), free.copy()
                ahead[phone, which] += step
                behind[phone, which] -= step
                apart = form.compute_trajectory(ahead, frames) - form.compute_trajectory(
                    behind, frames
                )
                np.testing.assert_allclose(
                    derivatives[:, 5 * place + which], apart / (2 * step), atol=1e-6
                )


def test_the_sign_of_equation_14(rng):
    """More than one unit from the centre a larger exponent lowers the dominance."""
    free = free_parameters(rng, 2)
    frames = Frames.from_segments(np.array([0, 1]), np.array([0.0, 5.0]), np.array([2.0]))
    before = dominance.compute_log_dominances(free, frames)[0, 0]
    free[0, 4] += 0.1
    assert dominance.compute_log_dominances(free, frames)[0, 0] < before


def test_both_forms_have_the_same_derivatives(rng):
    free = free_parameters(rng)
    frames = Frames.from_segments(*an_utterance(rng, 150), np.linspace(-3.0, 160.0, 500))
    kernel = dominance_kernel.jacobian(free, frames)
    for ours, theirs in zip(jacobian(free, frames), kernel, strict=True):
        np.testing.assert_allclose(ours, theirs, atol=1e-12)


@forms()
def test_at_the_centre_of_a_segment_nothing_is_undefined(form, rng):
    free = free_parameters(rng)
    positions, centres = np.arange(PHONES), 1.0 + np.arange(PHONES)
    values, derivatives = form.jacobian(free, Frames.from_segments(positions, centres, centres))
    assert np.isfinite(values).all()
    assert np.isfinite(derivatives).all()
    # By its own theta, phi and c the derivative is 0 there.
    for phone in range(PHONES):
        np.testing.assert_allclose(derivatives[phone, 5 * phone + 2 : 5 * phone + 5], 0, atol=1e-9)


@forms()
def test_where_all_dominances_vanish_there_is_a_trajectory(form, rng):
    free = free_parameters(rng)
    free[:, 2:4] = 6.0
    free[:, 4] = 1.4
    positions, centres = np.array([0, 1]), np.array([0.0, 1000.0])
    times = np.array([-1e5, 100.0, 499.0, 501.0, 900.0, 1e5])
    frames = Frames.from_segments(positions, centres, times)
    # No dominance itself can be told from 0 here.
    assert not np.exp(dominance.compute_log_dominances(free, frames)).any()
    values, derivatives = form.jacobian(free, frames)
    assert np.isfinite(derivatives).all()
    assert np.isin(np.round(values, 12), np.round(free[:2, 0], 12)).all()


@forms()
def test_long_utterances_are_as_good_as_short_ones(form, rng):
    free = free_parameters(rng)
    positions, centres = an_utterance(rng, 1000)
    times = rng.uniform(centres[0], centres[-1], 30)
    wanted = [by_the_paper(free, positions, centres, time) for time in times]
    frames = Frames.from_segments(positions, centres, times)
    assert frames.logarithms.shape[1] <= 200
    np.testing.assert_allclose(form.compute_trajectory(free, frames), wanted, atol=1e-7)


@given(
    st.lists(
        st.tuples(
            *[
                st.floats(low, high)
                for low, high in [(-3, 3), (-12, 12), (-8, 6), (-8, 6), (-1.6, 1.4)]
            ]
        ),
        min_size=2,
        max_size=2,
    ),
    st.floats(-300, 300),
)
@settings(max_examples=80, deadline=None)
def test_a_trajectory_lies_between_the_targets(rows, time):
    free = np.array(rows)
    frames = Frames.from_segments(np.array([0, 1, 0]), np.array([0.0, 0.7, 1.5]), np.array([time]))
    values, derivatives = jacobian(free, frames)
    assert free[:, 0].min() - 1e-12 <= values[0] <= free[:, 0].max() + 1e-12
    assert np.isfinite(derivatives).all()
    # All targets higher by 1: the trajectory too. All alphas larger: nothing changes.
    np.testing.assert_allclose(
        dominance.compute_trajectory(free + np.eye(5)[0], frames), values + 1
    )
    np.testing.assert_allclose(
        dominance.compute_trajectory(free + 2 * np.eye(5)[1], frames), values, atol=1e-9
    )


def test_the_parameters_are_those_of_the_paper():
    model = control.create("cohen-massaro", phone_set="sv-sta")
    assert model.parameter_count == 3800
    assert control.create("cohen-massaro", phone_set="sv-sta", stress=False).parameter_count == 2600
    with pytest.raises(DataError, match="phone_set=SET"):
        _ = control.create("cohen-massaro").parameter_count


def truth(count: int, seed: int, free, names, rate=60.0) -> Corpus:
    """Random utterances of Swedish phones that the given free parameters make."""
    phone_set = load_phone_set("sv-sta")
    symbols = phone_set.list_symbols()
    rng = np.random.default_rng(seed)
    utterances = []
    for number in range(count):
        chosen = [0, *rng.integers(1, free.shape[1], 18), 0]
        ends = np.cumsum(rng.uniform(0.04, 0.16, len(chosen)))
        segments = []
        for begin, end, symbol in zip([0.0, *ends[:-1]], ends, chosen, strict=True):
            phone, stress = phone_set.parse(symbols[symbol])
            segments.append(PhoneSegment(float(begin), float(end), phone, stress or 0))
        phones = PhoneSequence(tuple(segments), phone_set="sv-sta", name=f"u{number:03d}")
        times = np.arange(int(ends[-1] * rate)) / rate
        frames = Frames.from_segments(
            np.array(chosen), 10 * 0.5 * (phones.starts + phones.ends), 10 * times
        )
        values = np.stack([dominance.compute_trajectory(each, frames) for each in free], axis=1)
        tracks = ParameterTracks(names, rate, values, name=phones.name)
        utterances.append(Utterance.from_tracks(tracks, phones))
    return Corpus.from_utterances(utterances, phone_set)


def test_known_truth_is_found_from_a_neutral_start(rng):
    # Ten phones and sil, so that a short training hears each of them often.
    free = np.stack([free_parameters(rng, 11) for _ in range(2)])
    names = ("jaw_rotation", "lip_rounding")
    model = control.create("cohen-massaro").fit(truth(60, 1, free, names))
    for utterance in truth(15, 2, free, names):
        tracks = utterance.read_tracks()
        apart = model.predict_at(utterance.read_phones(), tracks.times) - tracks.values
        spread = np.ptp(tracks.values, axis=0)
        assert (np.sqrt(np.mean(apart**2, axis=0)) < 0.01 * spread).all()
    found = model.get_free_parameters()
    assert all((found[name] > 0).all() for name in ("alpha", "theta", "phi", "c"))
    # What was learned is for seconds: eq. 7 with it gives what predict gives.
    utterance = truth(1, 3, free, names).utterances[0]
    positions = model.symbols_.indices(utterance.read_phones())
    seconds = np.concatenate(
        [found["target"][0][:, None]]
        + [np.log(found[name][0])[:, None] for name in ("alpha", "theta", "phi", "c")],
        axis=1,
    )
    centres = 0.5 * (utterance.read_phones().starts + utterance.read_phones().ends)
    times = np.array([0.3, 0.77, 1.1])
    np.testing.assert_allclose(
        model.predict_at(utterance.read_phones(), times)[:, 0],
        [by_the_paper(seconds, positions, centres, time) for time in times],
        atol=1e-7,
    )


def test_training_falls_until_it_ends_and_early_stopping_keeps_the_best(small_corpus):
    rng = np.random.default_rng(0)
    noisy = Corpus.from_utterances(
        [
            Utterance.from_tracks(
                u.read_tracks().replace(
                    values=u.read_tracks().values + rng.normal(0, 0.2, u.read_tracks().values.shape)
                ),
                u.read_phones(),
            )
            for u in small_corpus
        ],
        "sv-sta",
    )
    model = control.create("cohen-massaro", l2=0.001, tol=0.0, patience=2)
    first = small_corpus.parameter_names[0]
    log = [e for e in model.fit(noisy, small_corpus).log_ if e.part == first]
    training = [e.training_error for e in log]
    validation = [e.validation_error for e in log]
    assert [e.iteration for e in log] == list(range(len(log)))
    assert training[-1] < training[0]
    # It ended two iterations after the best, and what it kept is the best.
    best = int(np.argmin(validation))
    assert len(log) - 1 <= best + 2
    tracks = [(u.read_phones(), u.read_tracks()) for u in small_corpus]
    apart = np.concatenate([(model.predict_at(p, t.times) - t.values)[:, 0] for p, t in tracks])
    assert np.sqrt(np.mean(apart**2)) == pytest.approx(min(validation), rel=1e-6)


def test_without_stress_marks_the_stress_changes_nothing(small_corpus):
    phones = spoken("sil 'A: P 'I: sil", 1)
    flat = phones.replace(segments=tuple(dataclasses.replace(s, stress=0) for s in phones))
    with_stress = control.create("cohen-massaro", max_iter=2).fit(small_corpus)
    without = control.create("cohen-massaro", max_iter=2, stress=False).fit(small_corpus)
    apart = [
        np.ptp(m.predict(phones).values - m.predict(flat).values) for m in (with_stress, without)
    ]
    assert apart[0] > 1e-3
    assert apart[1] == 0


def test_dominances_are_there_for_a_figure(trained, new_phones):
    model = trained("cohen-massaro")
    times = np.linspace(new_phones[0].start, new_phones[-1].end, 200)
    found = model.compute_dominances(new_phones, times, "jaw_rotation")
    assert found.shape == (200, len(new_phones))
    assert (found >= 0).all()
    assert (found <= 1 + 1e-12).all()
    centres = 0.5 * (new_phones.starts + new_phones.ends)
    np.testing.assert_allclose(times[found.argmax(axis=0)], centres, atol=0.02)
    with pytest.raises(DataError, match="no parameter 'brow'"):
        model.compute_dominances(new_phones, times, "brow")


@pytest.mark.parametrize(
    "wrong",
    [{"max_iter": 0}, {"tol": -1.0}, {"patience": 0}, {"l2": math.nan}, {"l2": "1"}],
)
def test_impossible_settings_are_refused(wrong):
    with pytest.raises(ConfigurationError, match=next(iter(wrong))):
        control.create("cohen-massaro", **wrong).fit(corpus_of(["sil 'A: sil"]))


# -- the start, and the penalty on the distance from it ----------------------------------------

START = np.array([0.0, 0.3, 0.3, 0.2])


def residuals_of(corpus, column=0):
    """The errors of one parameter, its symbols, and what they are made of."""
    symbols = Symbols.from_corpus(corpus, True)
    data = load_utterances(corpus, symbols)
    frames = [cohen_massaro._prepare_frames(each) for each in data]
    track = cohen_massaro.TrackResiduals(data, frames, column, len(symbols))
    return track, symbols, data, np.concatenate([each.values[:, column] for each in data])


def shares_of(free, data, phones):
    """The dominances of every frame as shares of their sum, by the paper: `(frames, phones)`."""
    rows = []
    for each in data:
        centres = 0.5 * (each.phones.starts + each.phones.ends)
        for time in each.times:
            row = np.zeros(phones)
            for position, centre in zip(each.positions, centres, strict=True):
                _, alpha, theta, phi, c = free[position]
                apart = 10 * abs(time - centre)
                slope = theta if time < centre else phi
                row[position] += math.exp(alpha - math.exp(slope) * apart ** math.exp(c))
            rows.append(row / row.sum())
    return np.array(rows)


@pytest.mark.parametrize("l2", [0.0, 0.7, 40.0])
def test_targets_begin_at_the_best_for_the_first_dominances(small_corpus, l2):
    track, symbols, data, values = residuals_of(small_corpus)
    start = np.tile([0.0, *START], (len(symbols), 1))
    shares = shares_of(start, data, len(symbols))
    least = max(l2, 1e-6 * np.max(np.sum(shares**2, axis=0)))
    wanted = np.linalg.solve(
        shares.T @ shares + least * np.eye(len(symbols)), shares.T @ values + least * values.mean()
    )
    np.testing.assert_allclose(track.fit_targets(start, l2), wanted, rtol=1e-6, atol=1e-7)
    unseen = ~symbols.seen
    np.testing.assert_allclose(track.fit_targets(start, l2)[unseen], values.mean())


def test_the_penalty_is_in_frames_of_the_parameter(small_corpus):
    track, symbols, _, values = residuals_of(small_corpus)
    penalty = cohen_massaro._build_penalty(track, 2.5)
    starts = penalty.start.reshape(-1, 5)
    np.testing.assert_array_equal(starts[:, 1:], np.tile(START, (len(symbols), 1)))
    np.testing.assert_allclose(starts[:, 0], track.fit_targets(starts, 2.5))
    # A target that is a unit off, or a logarithm that is 1 off for a deviation.
    weights = np.tile([1.0, *[values.std() ** 2] * 4], (len(symbols), 1))
    np.testing.assert_allclose(penalty.weights.reshape(-1, 5), 2.5 * weights)
    point = penalty.start + 2.0
    assert penalty.cost(point) == pytest.approx(4.0 * 2.5 * weights.sum())
    equations = track.compute_equations(point)
    both = penalty.add_to(equations, point)
    np.testing.assert_allclose(both.hessian - equations.hessian, np.diag(2.5 * weights.ravel()))
    np.testing.assert_allclose(both.gradient - equations.gradient, 2.0 * 2.5 * weights.ravel())
    assert both.cost - equations.cost == pytest.approx(penalty.cost(point))


def test_a_training_ends_where_errors_and_penalty_balance():
    corpus = noisy()
    model = control.create("cohen-massaro", l2=0.3, tol=0.0, max_iter=300).fit(corpus)
    track, symbols, _, values = residuals_of(corpus)
    free = model.free_[0].copy()
    free[:, 2:4] += np.exp(free[:, 4:]) * math.log(0.1)
    start = np.tile([0.0, *START], (len(symbols), 1))
    start[:, 0] = track.fit_targets(start, 0.3)
    weights = 0.3 * np.array([1.0, *[values.std() ** 2] * 4])
    slopes = track.compute_equations(free.ravel()).gradient.reshape(-1, 5)
    inside = (free > [-99, -12, -8, -8, -1.6]) & (free < [99, 12, 6, 6, 1.4])
    assert np.count_nonzero(inside) > 20
    assert np.abs(weights * (free - start))[inside].max() > 0.1
    assert np.abs(slopes + weights * (free - start))[inside].max() < 1e-3
    # A phone that the corpus lacks stays where it began.
    assert not symbols.seen.all()
    np.testing.assert_allclose(free[~symbols.seen], start[~symbols.seen], atol=1e-12)


def test_a_strong_penalty_leaves_the_start(small_corpus):
    model = control.create("cohen-massaro", l2=1e12).fit(small_corpus)
    learned = model.get_free_parameters()
    np.testing.assert_allclose(learned["alpha"], 1.0, rtol=1e-6)
    np.testing.assert_allclose(learned["c"], math.exp(0.2), rtol=1e-6)
    # In seconds: exp(0.3) (10 t)^c.
    for name in ("theta", "phi"):
        np.testing.assert_allclose(learned[name], math.exp(0.3) * 10 ** math.exp(0.2), rtol=1e-5)
    values = np.concatenate([u.read_tracks().values for u in small_corpus])
    wanted = np.tile(values.mean(axis=0)[:, None], (1, learned["target"].shape[1]))
    np.testing.assert_allclose(learned["target"], wanted, atol=1e-6)


def test_missing_values_count_neither_in_the_scale_nor_in_the_equations(small_corpus):
    utterance = small_corpus.utterances[0]
    values = utterance.read_tracks().values.copy()
    values[3:9, 0] = np.nan
    tracks = utterance.read_tracks().replace(values=values)
    holes = Corpus.from_utterances(
        [Utterance.from_tracks(tracks, utterance.read_phones())], "sv-sta"
    )
    track, symbols, data, column = residuals_of(holes)
    there = np.isfinite(column)
    assert track.count == np.count_nonzero(there) == len(column) - 6
    assert track.std == pytest.approx(np.nanstd(column))
    free = np.tile([0.1, *START], (len(symbols), 1))
    errors = (shares_of(free, data, len(symbols)) @ free[:, 0] - column)[there]
    assert track.cost(free.ravel()) == pytest.approx(errors @ errors)
    assert track.compute_equations(free.ravel()).cost == pytest.approx(errors @ errors)


def test_the_scale_of_what_does_not_move_or_is_not_there_is_1(small_corpus):
    utterance = small_corpus.utterances[0]
    for value in (0.25, np.nan):
        tracks = utterance.read_tracks().replace(
            values=np.full_like(utterance.read_tracks().values, value)
        )
        corpus = Corpus.from_utterances(
            [Utterance.from_tracks(tracks, utterance.read_phones())], "sv-sta"
        )
        assert residuals_of(corpus)[0].std == 1.0


def test_dominances_are_shares_of_the_largest_alpha(trained, new_phones):
    model = trained("cohen-massaro")
    centres = 0.5 * (new_phones.starts + new_phones.ends)
    column = model.parameter_names_.index("lip_rounding")
    learned = model.get_free_parameters()
    positions = model.symbols_.indices(new_phones)
    alpha, theta, phi, c = (learned[k][column][positions] for k in ("alpha", "theta", "phi", "c"))
    times = np.array([centres[2] - 0.03, centres[2] + 0.04])
    apart = times[:, None] - centres
    slopes = np.where(apart < 0, theta, phi)
    wanted = alpha * np.exp(-slopes * np.abs(apart) ** c)
    wanted /= learned["alpha"][column][model.symbols_.seen].max()
    result = model.compute_dominances(new_phones, times, "lip_rounding")
    np.testing.assert_allclose(result, wanted, rtol=1e-9)
    long = spoken("sil " + "M 'A: " * 50, 3)
    last = np.array([long[-1].end])
    with pytest.raises(DataError, match=r"too many segments.*101.*100 at most"):
        model.compute_dominances(long, last, "lip_rounding")
    short = long.replace(segments=tuple(long)[:100])
    assert model.compute_dominances(short, last, "lip_rounding").shape == (1, 100)


def test_free_parameters_go_to_their_bounds_and_no_farther():
    model = control.create("cohen-massaro", l2=0.0, tol=0.0, max_iter=200).fit(noisy())
    free = model.free_[0].copy()
    free[:, 2:4] += np.exp(free[:, 4:]) * math.log(0.1)
    for columns, lower, upper in (([1], -12, 12), ([2, 3], -8, 6), ([4], -1.6, 1.4)):
        assert free[:, columns].min() == pytest.approx(lower)
        assert free[:, columns].max() == pytest.approx(upper)


@forms()
def test_a_dominance_below_a_share_of_the_largest_counts_as_none(form):
    # Two segments at the same distance, so that their dominances differ by alpha alone.
    frames = Frames.from_segments(np.array([0, 1]), np.array([0.0, 2.0]), np.array([1.0]))
    for lower, counts in ((-19.9, True), (-20.1, False)):
        free = np.tile([0.0, *START], (2, 1))
        free[:, 0] = [0.0, 1.0]
        free[1, 1] = lower
        value = form.compute_trajectory(free, frames)[0]
        wanted = math.exp(lower) / (1 + math.exp(lower)) if counts else 0.0
        assert value == pytest.approx(wanted, rel=1e-9, abs=0.0)


def test_a_hundred_segments_on_either_side_count():
    centres = np.arange(300.0)
    frames = Frames.from_segments(np.arange(300) % 7, centres, np.array([0.0, 150.5, 299.5]))
    assert frames.logarithms.shape == (3, 200)
    np.testing.assert_array_equal(frames.first, [0, 51, 200])
    np.testing.assert_array_equal(frames.before, [1, 100, 100])
    assert np.isfinite(frames.logarithms).sum(axis=1).tolist() == [101, 200, 100]
    np.testing.assert_allclose(frames.logarithms[1, 99], math.log(0.5))
    np.testing.assert_array_equal(frames.phones[frames.segments[1, :5]], np.arange(51, 56) % 7)


def test_a_long_prediction_is_that_of_its_chunks(trained, new_phones):
    model = trained("cohen-massaro")
    times = np.linspace(new_phones[0].start, new_phones[-1].end, 9001)
    values = model.predict_at(new_phones, times)
    parts = [model.predict_at(new_phones, part) for part in np.array_split(times, 7)]
    np.testing.assert_allclose(values, np.concatenate(parts), atol=1e-12)
