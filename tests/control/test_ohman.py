"""Öhman's model: its equations, utterances of every make, and truth that it made itself."""

import numpy as np
import pytest
from control_cases import corpus_of, noisy, spoken

from mocap_fit import control
from mocap_fit.control.blending import compute_blends, find_peaks, smoothstep
from mocap_fit.control.levenberg_marquardt import NormalEquations, minimise
from mocap_fit.control.ohman import BlendResiduals
from mocap_fit.control.symbols import Symbols
from mocap_fit.control.training import compute_phone_means, load_utterances
from mocap_fit.corpus import Corpus, Utterance
from mocap_fit.errors import ConfigurationError
from mocap_fit.phones import PhoneSegment, PhoneSequence, load_phone_set
from mocap_fit.tracks import ParameterTracks

# Positions: two vowels, two consonants.
VOWEL = np.array([True, True, False, False])
SEEN = np.ones(4, dtype=bool)


def blended(positions, centres, times, seen=SEEN):
    at = np.array(centres, dtype=float)
    both = np.stack([at, at], axis=1)
    track, consonants = compute_blends(
        np.array(positions), both, np.array(times, dtype=float), VOWEL, seen
    )
    return track.toarray(), consonants.toarray()


def test_the_blend_is_level_at_its_three_knots():
    step = 1e-6
    for knot, value in ((0.0, 0.0), (1.0, 1.0)):
        assert smoothstep(np.array([knot]))[0] == value
        slope = (smoothstep(np.array([knot + step])) - smoothstep(np.array([knot - step]))) / step
        assert abs(slope[0]) < 1e-5
    assert smoothstep(np.array([0.5]))[0] == 0.5


def test_a_consonant_counts_from_the_centre_before_to_the_centre_after():
    # V1 C1 C2 V2 (Figure 3), centres 1 apart.
    times = np.linspace(0.0, 3.0, 31)
    track, consonants = blended([0, 2, 3, 1], [0, 1, 2, 3], times)
    np.testing.assert_allclose(consonants[[0, 10, 20, 30], 2], [0, 1, 0, 0], atol=1e-12)
    np.testing.assert_allclose(consonants[[0, 10, 20, 30], 3], [0, 0, 1, 0], atol=1e-12)
    assert not consonants[:, :2].any()
    # In a cluster one hands over to the next.
    np.testing.assert_allclose(consonants[10:21].sum(axis=1), 1.0)
    # The vowel track goes from the one vowel to the other past both.
    np.testing.assert_allclose(track.sum(axis=1), 1.0)
    np.testing.assert_allclose(track[15], [0.5, 0.5, 0, 0], atol=1e-12)
    np.testing.assert_allclose(track[:, 1], smoothstep(times / 3))


def test_long_segments_stay_at_their_peak():
    phones = PhoneSequence(
        (PhoneSegment(0.0, 1.0, "sil"), PhoneSegment(1.0, 1.1, "A"), PhoneSegment(1.1, 1.5, "S"))
    )
    held = find_peaks(phones, 0.07)
    np.testing.assert_allclose(held, [[0.07, 0.93], [1.05, 1.05], [1.17, 1.43]])
    np.testing.assert_allclose(find_peaks(phones, None), [[0.5, 0.5], [1.05, 1.05], [1.3, 1.3]])
    assert (find_peaks(phones, 0.0)[:, 1] == phones.ends).all()
    _, consonants = compute_blends(
        np.array([2, 0, 3]), held, np.array([0.2, 0.9, 0.99, 1.3]), VOWEL, SEEN
    )
    np.testing.assert_allclose(consonants.toarray()[:, 2], [1, 1, 0.5, 0])
    np.testing.assert_allclose(consonants.toarray()[3, 3], 1)


def test_utterances_that_begin_and_end_with_consonants():
    track, consonants = blended([2, 0, 3], [1, 2, 3], [0.0, 1.0, 2.0, 3.0, 4.0])
    # The track stands at the only vowel; the outer consonants stand at their full influence.
    np.testing.assert_allclose(track[:, 0], 1.0)
    np.testing.assert_allclose(consonants[:, 2], [1, 1, 0, 0, 0])
    np.testing.assert_allclose(consonants[:, 3], [0, 0, 0, 1, 1])


def test_vowels_side_by_side_and_one_phone_alone():
    track, consonants = blended([0, 1], [1, 2], [0.0, 1.5, 3.0])
    np.testing.assert_allclose(track[:, :2], [[1, 0], [0.5, 0.5], [0, 1]])
    assert not consonants.any()
    for positions, wanted in (([0], [1, 0, 0, 0]), ([2], [0.5, 0.5, 0, 0])):
        track, consonants = blended(positions, [1], [0.0, 1.0, 2.0])
        np.testing.assert_allclose(track, [wanted] * 3)
        np.testing.assert_allclose(consonants[:, 2], float(positions == [2]))


def test_without_a_vowel_the_track_is_the_mean_of_those_the_corpus_had():
    seen = np.array([False, True, True, True])
    track, _ = blended([2, 3], [1, 2], [1.0, 1.5], seen)
    np.testing.assert_allclose(track, [[0, 1, 0, 0]] * 2)
    none = np.array([False, False, True, True])
    assert not blended([2, 3], [1, 2], [1.0], none)[0].any()


def test_the_derivatives_agree_with_finite_differences(small_corpus, rng):
    symbols = Symbols.from_corpus(small_corpus, True)
    data = load_utterances(small_corpus, symbols)[:3]
    model = control.create("ohman")
    model.symbols_ = symbols
    track = BlendResiduals.from_utterances(data, model._stack_blends(data), 0)
    phones = len(symbols)
    point = np.concatenate(
        [rng.normal(0, 1, phones), np.where(symbols.are_vowels, 0, rng.uniform(0, 1, phones))]
    )
    found = track.compute_equations(point)
    step = 1e-6
    for place in range(len(point)):
        if place >= phones and symbols.are_vowels[place - phones]:
            continue
        ahead, behind = point.copy(), point.copy()
        ahead[place] += step
        behind[place] -= step
        slope = (track.cost(ahead) - track.cost(behind)) / (4 * step)
        assert found.gradient[place] == pytest.approx(slope, abs=1e-6)
    assert found.cost == pytest.approx(track.cost(point))
    np.testing.assert_allclose(found.hessian, found.hessian.T)


def test_the_parameters_are_those_of_the_paper():
    assert control.create("ohman", phone_set="sv-sta").parameter_count == 1040
    assert control.create("ohman", phone_set="sv-sta", stress=False).parameter_count == 800


def truth(count: int, seed: int, targets, factors, names) -> Corpus:
    """Random utterances, some without a vowel, that targets and factors make."""
    phone_set = load_phone_set("sv-sta")
    symbols = phone_set.list_symbols()
    is_vowel = np.array([phone_set.is_vowel(symbol) for symbol in symbols])
    rng = np.random.default_rng(seed)
    used = np.concatenate([np.flatnonzero(is_vowel)[:8], np.flatnonzero(~is_vowel)[:9]])
    seen = np.isin(np.arange(len(symbols)), used)
    utterances = []
    for number in range(count):
        chosen = rng.choice(used[8:] if number % 15 == 14 else used, 18)
        ends = np.cumsum(rng.uniform(0.04, 0.16, len(chosen)))
        segments = []
        for begin, end, symbol in zip([0.0, *ends[:-1]], ends, chosen, strict=True):
            phone, stress = phone_set.parse(symbols[symbol])
            segments.append(PhoneSegment(float(begin), float(end), phone, stress or 0))
        phones = PhoneSequence(tuple(segments), phone_set="sv-sta", name=f"u{number:03d}")
        times = np.arange(int(ends[-1] * 60)) / 60
        track, consonants = compute_blends(
            chosen, find_peaks(phones, control.create("ohman").hold), times, is_vowel, seen
        )
        v = track @ targets
        # Equation 16.
        values = v + consonants @ (factors * targets) - (consonants @ factors) * v
        tracks = ParameterTracks(names, 60.0, values, name=phones.name)
        utterances.append(Utterance.from_tracks(tracks, phones))
    return Corpus.from_utterances(utterances, phone_set)


def test_known_truth_is_found_from_a_neutral_start(rng):
    names = ("jaw_rotation", "lip_rounding", "jaw_thrust")
    targets = rng.normal(0.2, 0.3, (76, 3))
    factors = rng.uniform(0.05, 1.0, (76, 3))
    model = control.create("ohman").fit(truth(60, 1, targets, factors, names))
    for utterance in truth(15, 2, targets, factors, names):
        tracks = utterance.read_tracks()
        apart = model.predict_at(utterance.read_phones(), tracks.times) - tracks.values
        spread = np.ptp(tracks.values, axis=0)
        assert (np.sqrt(np.mean(apart**2, axis=0)) < 0.01 * spread).all()
    found = model.get_free_parameters()
    heard = model.symbols_.seen
    consonant = heard & ~model.symbols_.are_vowels
    np.testing.assert_allclose(found["target"].T[heard], targets[heard], atol=0.05)
    np.testing.assert_allclose(found["w"].T[consonant], factors[consonant], atol=0.05)
    assert np.isnan(found["w"][:, model.symbols_.are_vowels]).all()


def test_factors_stay_between_0_and_1_and_targets_within_reach(rng):
    corpus = corpus_of(["sil 'A: S 'A: T 'I: sil", "sil T 'I: S 'A: T 'A: sil"])
    noisy = Corpus.from_utterances(
        [
            Utterance.from_tracks(
                u.read_tracks().replace(
                    values=u.read_tracks().values + rng.normal(0, 3, u.read_tracks().values.shape)
                ),
                u.read_phones(),
            )
            for u in corpus
        ],
        "sv-sta",
    )
    for prior in (0.0, 1.0):
        model = control.create("ohman", l2=prior).fit(noisy)
        assert (model.factors_ >= 0).all()
        assert (model.factors_ <= 1).all()
        values = np.concatenate([u.read_tracks().values for u in noisy])
        assert (np.abs(model.targets_ - values.mean(axis=0)[:, None]) <= 3 * np.ptp(values)).all()


def test_impossible_settings_are_refused():
    for wrong in ({"patience": 0}, {"hold": -0.1}, {"pause": -1.0}):
        with pytest.raises(ConfigurationError, match=next(iter(wrong))):
            control.create("ohman", **wrong).fit(corpus_of(["sil 'A: sil"]))
    assert control.create("ohman", hold=None, pause=None).fit(corpus_of(["sil 'A: sil"])).is_fitted


def test_an_utterance_of_consonants_alone_is_learned(rng):
    corpus = corpus_of(["S T S F S"])
    model = control.create("ohman", l2=0.0).fit(corpus)
    tracks = corpus.utterances[0].read_tracks()
    apart = model.predict_at(corpus.utterances[0].read_phones(), tracks.times) - tracks.values
    assert np.sqrt(np.mean(apart**2)) < 0.5 * tracks.values.std()
    assert np.isfinite(model.predict(spoken("'A: S", 1)).values).all()


def test_minimise_stays_between_its_bounds_and_finds_the_least_there():
    # (x - 3)^2 + (10 (y - x^2))^2 with x at most 2.
    def residuals(p):
        return np.array([p[0] - 3.0, 10.0 * (p[1] - p[0] ** 2)])

    def equations(p):
        jacobian = np.array([[1.0, 0.0], [-20.0 * p[0], 10.0]])
        r = residuals(p)
        return NormalEquations(jacobian.T @ jacobian, jacobian.T @ r, float(r @ r))

    path = []
    found = minimise(
        equations,
        lambda p: float(residuals(p) @ residuals(p)),
        np.array([-1.0, 1.0]),
        (np.array([-5.0, -50.0]), np.array([2.0, 50.0])),
        max_iter=100,
        tol=1e-14,
        callback=lambda iteration, point, error: path.append((iteration, error)),
    )
    np.testing.assert_allclose(found, [2.0, 4.0], atol=1e-5)
    errors = [error for _, error in path]
    assert [iteration for iteration, _ in path] == list(range(len(path)))
    assert errors == sorted(errors, reverse=True)


def test_targets_go_to_their_bounds_and_no_farther():
    # The consonant adds the same to either vowel: w (T - 1) = w (T + 1), so w goes to 0.
    utterances = []
    for number, (sentence, level) in enumerate((("'A: S 'A:", 1.0), ("'I: S 'I:", -1.0))):
        phones = spoken(sentence, number)
        times = np.arange(int(phones[-1].end * 200)) / 200
        before, at, after = phones.starts + 0.5 * (phones.ends - phones.starts)
        bump = np.interp(times, [before, at, after], [0.0, 0.5, 0.0])
        tracks = ParameterTracks(("x",), 200.0, (level + bump)[:, None], name=phones.name)
        utterances.append(Utterance.from_tracks(tracks, phones))
    corpus = Corpus.from_utterances(utterances, "sv-sta")
    model = control.create("ohman", l2=0.0, tol=0.0, max_iter=200).fit(corpus)
    values = np.concatenate([u.read_tracks().values for u in corpus])
    farthest = np.abs(values - values.mean()).max()
    consonant = model.symbols_.index("S")
    assert model.targets_[0, consonant] == pytest.approx(values.mean() + 2.0 * farthest)
    assert 0.1 < model.factors_[0, consonant] < 0.3
    np.testing.assert_allclose(model.middle_, values.mean())


def test_a_strong_penalty_leaves_the_start(small_corpus):
    model = control.create("ohman", l2=1e12, pause=None).fit(small_corpus)
    learned = model.get_free_parameters()
    vowels = model.symbols_.are_vowels
    np.testing.assert_allclose(learned["w"][:, ~vowels], 0.5, atol=1e-6)
    data = load_utterances(small_corpus, model.symbols_)
    means = compute_phone_means(data, len(model.symbols_))
    np.testing.assert_allclose(learned["target"], means.T, atol=1e-6)


def test_a_training_ends_where_errors_and_penalty_balance():
    corpus = noisy()
    model = control.create("ohman", l2=0.4, tol=0.0, max_iter=300, pause=None).fit(corpus)
    symbols = model.symbols_
    data = load_utterances(corpus, symbols)
    track = BlendResiduals.from_utterances(data, model._stack_blends(data), 0)
    values = track.values
    start = compute_phone_means(data, len(symbols))[:, 0]
    point = np.concatenate([model.targets_[0] - values.mean(), model.factors_[0]])
    apart = np.concatenate(
        [model.targets_[0] - start, model.factors_[0] - np.where(symbols.are_vowels, 0.0, 0.5)]
    )
    weights = 0.4 * np.repeat([1.0, values.std() ** 2], len(symbols))
    equations = track.subtract(values.mean()).compute_equations(point)
    factors = point[len(symbols) :]
    inside = np.concatenate([np.ones(len(symbols), bool), (factors > 0) & (factors < 1)])
    assert np.abs(weights * apart)[inside].max() > 1e-2
    assert np.abs(equations.gradient + weights * apart)[inside].max() < 1e-5


def test_a_constant_parameter_has_a_penalty_on_its_factors():
    corpus = noisy()
    utterances = [
        Utterance.from_tracks(
            u.read_tracks().replace(values=np.full_like(u.read_tracks().values, 0.5)),
            u.read_phones(),
        )
        for u in corpus
    ]
    model = control.create("ohman").fit(Corpus.from_utterances(utterances, corpus.phone_set))
    np.testing.assert_allclose(model.targets_, 0.5)
    np.testing.assert_allclose(model.factors_[:, ~model.symbols_.are_vowels], 0.5)
