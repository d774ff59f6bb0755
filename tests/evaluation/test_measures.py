"""Measures against scipy, numpy, a published example and closed forms."""

import numpy as np
import pytest
import scipy.stats
from hypothesis import given, settings
from hypothesis import strategies as st

from mocap_fit.evaluation.closure import Share
from mocap_fit.evaluation.measures import (
    average,
    compute_interval,
    compute_p_value,
    compute_scores,
    draw_resamples,
    sum_utterance,
)
from mocap_fit.evaluation.tables import format_html, format_share, format_text, format_value

# Efron & Tibshirani (1993), table 2.1: survival of treated mice, days.
MICE = np.array([94, 197, 16, 38, 99, 141, 23], dtype=float)


@pytest.mark.parametrize(("level", "z"), [(0.95, 1.959964), (0.9, 1.644854), (0.5, 0.674490)])
def test_an_interval_lies_between_the_quantiles_of_a_normal_distribution(level, z):
    samples = scipy.stats.norm.ppf((np.arange(100_000) + 0.5) / 100_000)[:, None]
    low, high = compute_interval(np.hstack([samples, 3 + 2 * samples]), level)
    np.testing.assert_allclose(low, [-z, 3 - 2 * z], atol=1e-3)
    np.testing.assert_allclose(high, [z, 3 + 2 * z], atol=1e-3)


def test_an_interval_is_of_95_per_cent_where_nothing_else_is_said():
    low, high = compute_interval(np.arange(1001.0))
    assert (low, high) == pytest.approx((25.0, 975.0))


def test_an_interval_with_a_sample_missing_is_missing():
    samples = np.array([[0.0, np.nan], [1.0, 0.0], [2.0, 1.0]])
    low, high = compute_interval(samples)
    assert np.isnan(low).tolist() == np.isnan(high).tolist() == [False, True]


def test_intervals_of_a_mean_are_those_of_scipys_bootstrap():
    """The percentile interval of the mean of the treated mice: 48 to 134 and a half days."""
    counts = draw_resamples(7, 20_000, seed=1)
    low, high = compute_interval(counts @ MICE / 7)
    theirs = scipy.stats.bootstrap(
        (MICE,), np.mean, n_resamples=20_000, method="percentile", rng=np.random.default_rng(2)
    ).confidence_interval
    assert (low, high) == pytest.approx((theirs.low, theirs.high), abs=1.5)


def test_the_bootstrap_has_the_standard_error_of_the_mean():
    """25.24 is root of sum of squares / n², Efron & Tibshirani's equation 5.12 (plug-in)."""
    counts = draw_resamples(7, 50_000, seed=0)
    assert (counts.sum(axis=1) == 7).all()
    means = counts @ MICE / 7
    plug_in = MICE.std() / np.sqrt(7)
    assert means.mean() == pytest.approx(MICE.mean(), abs=4 * plug_in / np.sqrt(50_000))
    assert means.std() == pytest.approx(plug_in, rel=0.015)
    # Chance that an utterance is missing from a sample: (6 / 7)^7 = 0.340.
    assert (counts == 0).mean() == pytest.approx((6 / 7) ** 7, abs=0.005)


@pytest.mark.parametrize(
    ("below", "above", "expected"),
    [(25, 975, 0.05), (975, 25, 0.05), (5, 995, 0.01), (500, 500, 1.0), (0, 1000, 0.001)],
)
def test_a_p_value_is_twice_the_smaller_tail(below, above, expected):
    samples = np.concatenate([np.full(below, -1.0), np.full(above, 2.0)])
    assert compute_p_value(samples) == pytest.approx(expected)


def test_a_difference_that_is_nil_has_the_p_value_one():
    assert compute_p_value(np.zeros(100)) == 1.0
    # Nil counts on both sides: 60 of 100 are at or below it.
    samples = np.concatenate([np.zeros(20), np.full(40, -1.0), np.full(40, 1.0)])
    assert compute_p_value(samples) == 1.0
    # 20 of 100 at nil and 10 below: twice 0.3.
    samples = np.concatenate([np.zeros(20), np.full(10, -1.0), np.full(70, 1.0)])
    assert compute_p_value(samples) == pytest.approx(0.6)


def test_a_p_value_of_nothing_is_missing_and_missing_samples_do_not_count():
    assert np.isnan(compute_p_value(np.array([np.nan, np.nan])))
    assert compute_p_value(np.array([np.nan, -1.0, 1.0, 1.0, 1.0])) == pytest.approx(0.5)


@pytest.mark.parametrize("shift", [0.0, 0.15, 0.3])
def test_p_values_are_those_of_a_normal_test_of_a_mean(shift):
    differences = np.random.default_rng(4).normal(0, 1, 60)
    differences += shift - differences.mean()
    samples = draw_resamples(60, 20_000, seed=3) @ differences / 60
    z = differences.mean() / (differences.std() / np.sqrt(60))
    assert compute_p_value(samples) == pytest.approx(2 * scipy.stats.norm.sf(abs(z)), abs=0.015)


def test_the_interval_excludes_nil_where_the_p_value_is_below_five_per_cent():
    rng = np.random.default_rng(5)
    for shift in np.linspace(0, 4, 41):
        samples = shift + rng.normal(0, 1, 4000)
        low, high = compute_interval(samples)
        p = compute_p_value(samples)
        if abs(p - 0.05) > 0.002:
            assert (low > 0 or high < 0) == (p < 0.05)


@settings(deadline=None, max_examples=50)
@given(seed=st.integers(0, 10**6), far=st.sampled_from([0.0, 1e3]))
def test_scores_are_those_of_numpy_and_scipy(seed, far):
    rng = np.random.default_rng(seed)
    target = far + rng.normal(0, 1, (60, 3))
    predicted = 0.5 * target + far + rng.normal(0, 1, (60, 3))
    groups = np.array([rng.random(60) < 0.8, rng.random(60) < 0.4])
    target[rng.random((60, 3)) < 0.1] = np.nan
    centre = np.full(3, far)
    halves = [slice(0, 25), slice(25, 60)]
    sums = sum(sum_utterance(target[h], predicted[h], groups[:, h], centre) for h in halves)
    ranges = np.array([2.0, 3.0, 4.0])
    rmse, correlation = compute_scores(sums, ranges)
    for g in range(2):
        for p in range(3):
            used = groups[g] & np.isfinite(target[:, p])
            y, z = target[used, p], predicted[used, p]
            error = 100 * np.sqrt(np.mean((y - z) ** 2)) / ranges[p]
            assert rmse[g, p] == pytest.approx(error)
            assert correlation[g, p] == pytest.approx(scipy.stats.pearsonr(y, z)[0], abs=1e-9)


def test_scores_of_nothing_are_missing():
    target = np.array([[0.0, 1.0], [1.0, 1.0]])
    predicted = np.array([[0.5, 0.0], [0.5, 1.0]])
    both = np.ones((1, 2), dtype=bool)
    sums = sum_utterance(target, predicted, np.vstack([both, ~both]), np.zeros(2))
    rmse, correlation = compute_scores(sums, np.array([1.0, 0.0]))
    assert np.isnan(rmse).tolist() == [[False, True], [True, True]]
    assert np.isnan(correlation).all()


def test_an_average_leaves_out_what_is_missing():
    assert average(np.array([[1.0, np.nan, 3.0], [np.nan] * 3])).tolist()[0] == 2.0
    assert np.isnan(average(np.full((2, 3), np.nan))).all()


def test_one_frame_has_an_error_and_no_correlation():
    one = np.ones((1, 1), dtype=bool)
    sums = sum_utterance(np.array([[0.25]]), np.array([[0.5]]), one, np.zeros(1))
    rmse, correlation = compute_scores(sums, np.array([0.5]))
    assert rmse.tolist() == [[50.0]]
    assert np.isnan(correlation).all()


def test_cells_of_tables_are_rounded_and_escaped():
    assert format_value([6.678, 6.549, 6.801], 2) == "6.68 [6.55, 6.80]"
    assert format_share(Share(8, 10)) == "80.0 % [49.0, 94.3]"
    assert format_share(Share(0, 0)) == "–"
    text = format_text(["model", "r"], [["a", "0.5"], ["longer", "1"]])
    assert text.splitlines() == ["model     r", "a       0.5", "longer    1"]
    assert "<td>&lt;b&gt;</td>" in format_html(["x"], [["<b>"]])
    with pytest.raises(ValueError, match="zip"):
        format_text(["model", "r"], [["a"]])
