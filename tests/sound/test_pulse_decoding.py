"""Parts of the decoder of pulses: beginnings, extra pulses and other rates, by hand."""

import numpy as np
import pytest
from scipy.stats import norm

from mocap_fit.sound.pulse_clock import Clock
from mocap_fit.sound.pulses import (
    _count_extra,
    _describe_missing_pulses,
    _estimate_deviation,
    _measure_beginnings,
)


class TestBeginnings:
    def measure(self, channel, clock, width, slots, present=None):
        present = np.ones(len(slots), dtype=bool) if present is None else present
        return _measure_beginnings(channel, clock, width, slots, present)

    def test_the_sample_that_rises_over_half(self):
        channel = np.zeros(300)
        channel[100:105] = [0.4, 0.6, 1.0, 1.0, 0.2]
        channel[200:205] = [0.5, 0.6, 1.0, 1.0, 0.2]
        begins, found = self.measure(channel, Clock(100.0, 100.0), 5, np.arange(2))
        np.testing.assert_array_equal(begins, [101, 200])
        assert found.all()

    def test_the_nearest_rise(self):
        channel = np.zeros(300)
        channel[95:98] = channel[103:106] = 1.0
        begins, _ = self.measure(channel, Clock(100.0, 100.0), 3, np.arange(1))
        assert begins[0] == 103
        begins, _ = self.measure(channel, Clock(98.9, 100.0), 3, np.arange(1))
        assert begins[0] == 95

    def test_how_far_it_is_looked_for(self):
        """Twice the width, four samples at least, a quarter of the period at most."""
        for width, period, reach in ((1, 100, 4), (10, 100, 20), (40, 100, 25)):
            for shift, is_there in ((reach, True), (-reach, True), (-reach - 2, False)):
                channel = np.zeros(1000)
                channel[500 + shift : 500 + shift + width] = 1.0
                begins, found = self.measure(channel, Clock(500.0, period), width, np.arange(1))
                if is_there:
                    assert (found[0], begins[0]) == (True, 500 + shift)
                else:
                    assert begins[0] != 500 + shift

    def test_a_pulse_that_begins_with_the_sound(self):
        channel = np.zeros(200)
        channel[:5] = channel[100:105] = 1.0
        begins, found = self.measure(channel, Clock(0.0, 100.0), 5, np.arange(2))
        np.testing.assert_array_equal(begins, [0, 100])
        assert found.all()

    def test_without_a_pulse_there_is_none(self):
        channel = np.zeros(300)
        channel[100:105] = 1.0
        present = np.array([True, False])
        _, found = self.measure(channel, Clock(100.0, 100.0), 5, np.arange(2), present)
        np.testing.assert_array_equal(found, [True, False])


class TestExtra:
    CLOCK = Clock(100.0, 100.0)

    def count(self, begins, width=4, height=1.0, length=1000, slots=8):
        channel = np.zeros(length)
        for begin in begins:
            channel[begin : begin + width] = height
        return _count_extra(channel, self.CLOCK, width, np.arange(slots), 1.0)

    def test_pulses_between_frames_are_counted(self):
        frames = list(range(100, 900, 100))
        assert self.count(frames) == 0
        assert self.count([*frames, 150, 420, 490]) == 3
        # Within two samples of a frame it is the frame's.
        assert self.count([102, *frames[1:]]) == 0
        assert self.count([98, *frames[1:]]) == 0
        assert self.count([103, *frames[1:]]) == 1
        assert self.count([97, *frames[1:]]) == 1
        # Or half of its width.
        assert self.count([105, *frames[1:]], width=10) == 0
        assert self.count([106, *frames[1:]], width=10) == 1

    def test_half_a_period_around_the_frames_is_looked_at(self):
        assert self.count([*range(100, 900, 100), 52, 846]) == 2
        assert self.count([*range(100, 900, 100), 44, 852]) == 0
        assert self.count([*range(100, 900, 100), 46], width=8) == 0

    def test_three_quarters_of_the_height_are_the_least(self):
        channel = np.zeros(1000)
        channel[150:154] = 0.76
        channel[250:254] = 0.74
        assert _count_extra(channel, self.CLOCK, 4, np.arange(8), 1.0) == 1

    def test_a_sound_that_ends_with_its_frames(self):
        assert self.count([*range(100, 900, 100), 150], length=804) == 1
        assert self.count([4], length=104, slots=1) == 0


class TestOtherPulses:
    def describe(self, channel, rate=1000.0, frame_rate=60.0):
        return str(_describe_missing_pulses(np.asarray(channel, dtype=float), rate, frame_rate))

    def test_silence(self):
        for channel in (np.zeros(100), np.full(100, 0.5), np.zeros(0)):
            assert "found silence, expected 60 pulses a second" in self.describe(channel)

    @pytest.mark.parametrize("sign", [1, -1])
    def test_pulses_of_another_rate_are_counted(self, sign):
        channel = np.full(2000, 5.0)
        for begin in range(10, 2000, 40):
            channel[begin : begin + 3] += sign
        assert "found 25 pulses a second" in self.describe(channel)

    def test_they_must_be_even(self, rng):
        channel = np.zeros(4000)
        channel[np.sort(rng.choice(np.arange(5, 4000, 5), 60, replace=False))] = 1
        assert "no even pulses" in self.describe(channel)
        channel = np.zeros(4000)
        # Half of them two samples late, four of them: within 2 samples and a fiftieth.
        for late, is_even in ((2, True), (6, False)):
            channel = np.zeros(4100)
            channel[np.arange(100, 4100, 100) + np.where(np.arange(40) % 2, late, 0)] = 1
            assert ("no even" not in self.describe(channel)) == is_even

    def test_four_gaps_are_the_least(self):
        for count, is_told in ((4, False), (5, True)):
            channel = np.zeros(600)
            channel[100 : 100 + 100 * count : 100] = 1
            assert ("10 pulses a second" in self.describe(channel)) == is_told

    def test_half_of_the_highest_is_a_pulse(self):
        channel = np.zeros(2000)
        channel[10:2000:50], channel[30:2000:50] = 1.0, 0.45
        assert "20 pulses a second" in self.describe(channel)
        channel[30:2000:50] = 0.55
        assert "20 pulses a second" not in self.describe(channel)


def test_deviation_is_that_of_a_normal_distribution():
    values = norm.ppf((np.arange(20000) + 0.5) / 20000, 3.0, 0.5)
    assert _estimate_deviation(values) == pytest.approx(0.5, rel=1e-4)
    assert _estimate_deviation(np.zeros(0)) == 0
