"""Energy of sound against sines, sums by hand and scipy's window."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal.windows import hann

from mocap_fit.errors import DataError
from mocap_fit.sound import Sound, energy_db


def summed_energy(samples, rate, time, window):
    """The definition, sample by sample: a Hann window whose ends, which are 0, are left out."""
    half = round(window * rate / 2)
    weights = hann(2 * half + 3)[1:-1]
    total = weight_sum = 0.0
    for offset, weight in zip(range(-half, half + 1), weights, strict=True):
        index = round(time * rate) + offset
        if 0 <= index < len(samples):
            total += weight * samples[index] ** 2
            weight_sum += weight
    return 10 * np.log10(total / weight_sum)


def test_a_sine_of_full_scale():
    sound = Sound(np.sin(2 * np.pi * 1000 * np.arange(16000) / 16000), 16000)
    levels = energy_db(sound, [0.0, 0.25, 0.5, 1.0])
    np.testing.assert_allclose(levels, 10 * np.log10(0.5), atol=0.1)


@pytest.mark.parametrize(("rate", "window"), [(8000, 0.025), (16000, 0.04), (100, 0.02)])
def test_it_is_the_weighted_mean_square(rate, window, rng):
    samples = rng.normal(size=rate)
    times = [0.0, 1.5 / rate, 0.3, 0.5, 1 - 3 / rate, 1 - 1 / rate]
    expected = [summed_energy(samples, rate, time, window) for time in times]
    levels = energy_db(Sound(samples, rate), times, window=window)
    np.testing.assert_allclose(levels, expected, rtol=1e-12)
    # The end of the sound is the time of the sample after the last.
    assert energy_db(Sound(samples, rate), [1.0], window=window)[0] == pytest.approx(expected[-1])


def test_the_window_is_25_ms_long(rng):
    sound = Sound(rng.normal(size=8000), 8000)
    np.testing.assert_array_equal(energy_db(sound, [0.4]), energy_db(sound, [0.4], window=0.025))
    expected = summed_energy(sound.get_channel(1), 8000, 0.4, 0.025)
    assert energy_db(sound, [0.4])[0] == pytest.approx(expected)


@given(factor=st.floats(0.01, 1.0))
def test_half_the_height_is_six_decibels_less(factor):
    rng = np.random.default_rng(1)
    sound = Sound(rng.uniform(-1, 1, 4000), 16000)
    quieter = sound.replace(samples=factor * sound.samples)
    difference = energy_db(quieter, [0.1]) - energy_db(sound, [0.1])
    assert difference[0] == pytest.approx(20 * np.log10(factor), abs=1e-6)


def test_it_is_that_of_the_moment():
    samples = np.zeros(16000)
    samples[8000:] = 0.1
    quiet, loud = energy_db(Sound(samples, 16000), [0.45, 0.55])
    assert quiet == -100
    assert loud == pytest.approx(-20, abs=1e-6)


def test_digital_silence_has_100_decibels_less_than_full_scale():
    levels = [
        energy_db(Sound(np.full(800, 10 ** (db / 20)), 8000), [0.05])[0] for db in (-99, -101)
    ]
    np.testing.assert_allclose(levels, [-99, -100], atol=1e-9)


def test_channels_are_averaged():
    both = Sound(np.stack([np.full(800, 0.3), np.full(800, -0.1)], axis=1), 8000)
    assert energy_db(both, [0.05])[0] == pytest.approx(-20)


def test_outside_the_sound_nothing_is_known():
    levels = energy_db(Sound(np.ones(1600), 16000), [-0.01, 0.0, 0.05, 0.1, 0.11])
    assert np.isnan(levels).tolist() == [True, False, False, False, True]


@pytest.mark.parametrize(("window", "is_enough"), [(0.0, False), (0.01, False), (0.011, True)])
def test_a_window_is_longer_than_two_samples(window, is_enough):
    sound = Sound(np.full(100, 0.1), 100)
    if is_enough:
        assert energy_db(sound, [0.5], window=window)[0] == pytest.approx(-20)
    else:
        with pytest.raises(DataError, match=r"too short.*100 Hz"):
            energy_db(sound, [0.5], window=window)


def test_a_sound_without_samples_has_no_energy():
    assert np.isnan(energy_db(Sound(np.zeros((0, 1)), 8000), [0.0, 1.0])).all()
