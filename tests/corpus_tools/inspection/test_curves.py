"""Curves at the resolution of a picture: nothing of them is lost, and nothing is invented."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from corpus_tools.inspection.curves import _BLOCK, Curve, compute_spectrogram


def create_curve(seed: int, count: int, gaps: float) -> Curve:
    rng = np.random.default_rng(seed)
    values = rng.normal(size=count)
    values[rng.random(count) < gaps] = np.nan
    return Curve(0.3, 60.0, values)


@given(
    seed=st.integers(0, 99),
    count=st.integers(1, 400),
    columns=st.integers(1, 60),
    gaps=st.sampled_from([0.0, 0.2, 1.0]),
)
def test_every_value_is_within_its_column(seed, count, columns, gaps):
    curve = create_curve(seed, count, gaps)
    edges = np.linspace(-0.5, 0.8 + count / 60, columns + 1)
    low, high = curve.reduce(edges)
    times = curve.start + np.arange(count) / curve.rate
    column = np.searchsorted(edges, times, side="right") - 1
    known = ~np.isnan(curve.values)
    assert (low[column[known]] <= curve.values[known] + 1e-12).all()
    assert (high[column[known]] >= curve.values[known] - 1e-12).all()
    if known.any():
        assert np.nanmin(low) == curve.values[known].min()
        assert np.nanmax(high) == curve.values[known].max()
    else:
        assert np.isnan(low).all()


def test_between_values_the_curve_is_straight_and_goes_on():
    curve = Curve(0.0, 10.0, np.array([0.0, 1.0, np.nan, 0.0, 4.0]))
    low, high = curve.reduce(np.array([0.02, 0.04, 0.12, 0.18, 0.32, 0.36, 0.45]))
    np.testing.assert_allclose(low, [0.2, 0.4, np.nan, 0.0, 0.8, 2.4])
    np.testing.assert_allclose(high, [0.4, 1.0, np.nan, 0.8, 2.4, 4.0])


def test_a_long_curve_is_reduced_by_blocks_and_no_extreme_is_lost():
    values = np.zeros(1000 * _BLOCK)
    values[[12_345, 200_001]] = 3.0, -2.0
    curve = Curve(0.0, 1000.0, values)
    low, high = curve.reduce(np.linspace(0.0, len(values) / 1000, 101))
    width = len(values) / 100
    assert high[int(12_345 / width)] == 3.0
    assert low[int(200_001 / width)] == -2.0
    assert (high == 3.0).sum() <= 2
    assert (low == -2.0).sum() <= 2


def test_a_tone_is_dark_at_its_frequency_only():
    rate, tone = 16_000.0, 2000.0
    times = np.arange(8000) / rate
    picture = compute_spectrogram(np.sin(2 * np.pi * tone * times), rate, np.linspace(0, 1, 41), 51)
    assert (picture[:, 25:] == 255).all()  # after its end
    darkest = picture[:, 5:15].argmin(axis=0)
    np.testing.assert_allclose(5000 - 100 * darkest, tone, atol=150)
    assert picture[5, 10] > 200


@pytest.mark.parametrize("edges", [np.linspace(5, 6, 4), np.linspace(-2, -1, 4)])
def test_outside_the_sound_there_is_paper(edges):
    assert (compute_spectrogram(np.ones(100), 8000.0, edges, 10) == 255).all()
