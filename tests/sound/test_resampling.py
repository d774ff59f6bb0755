"""Sound at another rate: the same tone at the same time."""

import numpy as np
import pytest
from scipy.signal import resample_poly

from mocap_fit.sound import resample

SLOW = pytest.param(9999991, marks=pytest.mark.slow)


@pytest.mark.parametrize(
    "rate",
    [8000, 11025, 22050, 44100, 44099, 48000, 192000, 999983, SLOW],
)
def test_a_tone_stays_a_tone(rate):
    length = 0.2
    times = np.arange(round(length * rate)) / rate
    samples = np.stack([np.sin(2000 * times), np.cos(2000 * times)], axis=1)
    found = resample(samples, rate, 16000)
    there = np.arange(len(found)) / 16000
    inside = slice(200, -200)
    assert len(found) == pytest.approx(length * 16000, abs=1)
    expected = np.stack([np.sin(2000 * there), np.cos(2000 * there)], axis=1)
    np.testing.assert_allclose(found[inside], expected[inside], atol=5e-3)


def test_rates_of_every_day_have_their_exact_ratio(rng):
    samples = rng.normal(size=1000)
    for rate, up, down in [(44100, 160, 441), (22050, 320, 441), (48000, 1, 3), (8000, 2, 1)]:
        np.testing.assert_array_equal(
            resample(samples, rate, 16000), resample_poly(samples, up, down)
        )
    np.testing.assert_array_equal(resample(samples, 16000, 16000), samples)


def test_what_the_lower_rate_cannot_hold_is_gone():
    tone = np.sin(2 * np.pi * 12000 * np.arange(48000) / 48000)
    assert np.abs(resample(tone, 48000, 16000)[200:-200]).max() < 0.01
