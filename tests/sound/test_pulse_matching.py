"""Which pulse is the first frame's: heights by hand, likelihoods by scipy, runs by brute force."""

import itertools

import numpy as np
import pytest
from scipy.stats import norm

from mocap_fit.errors import DataError
from mocap_fit.sound.pulse_clock import Clock
from mocap_fit.sound.pulse_matching import (
    compute_likelihoods,
    cut_windows,
    find_run,
    match_frames,
    measure_heights,
    select_quiet,
)
from mocap_fit.sound.pulse_search import Grid

MISSING = np.log(0.02)


def test_windows_are_nan_outside_the_sound():
    values, positions = cut_windows(np.arange(10.0), np.array([-2.4, 0.0, 3.6, 8.0]), 3)
    nan = np.nan
    np.testing.assert_array_equal(values, [[nan, nan, 0], [0, 1, 2], [4, 5, 6], [8, 9, nan]])
    np.testing.assert_array_equal(positions, [[-2, -1, 0], [0, 1, 2], [4, 5, 6], [8, 9, 10]])


class TestHeights:
    def test_the_mean_over_the_level_around(self):
        """Pulses of 4 samples on a level that rises; one is lower, one not there."""
        channel = 0.01 * np.arange(500.0)
        for begin, height in ((100, 1.0), (200, 0.6), (400, 1.0)):
            channel[begin : begin + 4] += height
        heights = measure_heights(channel, Clock(0.0, 100.0), 4, np.arange(5))
        # The level before and after a pulse is that of its middle; at 0 there is none before.
        np.testing.assert_allclose(heights[1:], [1.0, 0.6, 0.0, 1.0], atol=0.011)
        assert heights[0] < 0

    def test_the_level_is_the_median_of_both_sides(self):
        channel = np.zeros(60)
        channel[20:24] = 1.0
        channel[:19] = 0.2
        channel[25:] = 0.4
        height = measure_heights(channel, Clock(20.0, 20.0), 4, np.array([0]))
        # 8 samples on each side, those next to the pulse excluded: the median is between.
        assert height[0] == pytest.approx(1.0 - 0.3)

    def test_the_level_is_that_of_up_to_64_samples_on_each_side(self):
        channel = np.full(2000, 9.0)
        channel[1000 - 65 : 1000 + 4 + 1 + 64] = 0.0
        channel[1000:1004] = 1.0
        assert measure_heights(channel, Clock(1000.0, 400.0), 4, np.array([0]))[0] == 1.0
        channel[1000 - 40 : 1000 - 1] = 9.0
        channel[1005 : 1005 + 40] = 9.0
        assert measure_heights(channel, Clock(1000.0, 400.0), 4, np.array([0]))[0] == -8.0

    def test_part_of_a_pulse_and_none(self):
        channel = np.zeros(40)
        channel[:2] = channel[38:] = 1.0
        heights = measure_heights(channel, Clock(-2.0, 20.0), 4, np.array([0, 2]))
        np.testing.assert_allclose(heights, [1.0, 1.0])
        assert measure_heights(channel, Clock(-2.0, 20.0), 1, np.array([0]))[0] == 0.0

    @pytest.mark.parametrize(
        ("shift", "reach", "height"), [(2, 2, 1), (3, 2, 0), (-2, 2, 1), (1, 0, 0)]
    )
    def test_a_pulse_may_be_beside_the_clock(self, shift, reach, height):
        channel = np.zeros(100)
        channel[50 + shift] = 1.0
        measured = measure_heights(channel, Clock(50.0, 40.0), 1, np.array([0]), reach)
        assert measured[0] == height


@pytest.mark.parametrize("width", [1, 4, 20])
def test_quiet_samples_are_clear_of_pulses(width):
    """By a quarter of a pulse's width, or two samples at least, a fifth of a period at most."""
    grid = Grid(13.0, 50.0, width, 1, 100, 300)
    samples = np.arange(400.0)
    margin = max(2.0, 0.25 * width)
    expected = [i for i in range(100, 300) if width + margin < (i - 13) % 50 < 50 - margin]
    np.testing.assert_array_equal(select_quiet(samples, Clock(13.0, 50.0), grid), expected)


def test_quiet_samples_of_a_short_period():
    grid = Grid(0.0, 8.0, 2, 1, 0, 80)
    expected = [i for i in range(80) if 3.6 < i % 8 < 6.4]
    np.testing.assert_array_equal(select_quiet(np.arange(80.0), Clock(0.0, 8.0), grid), expected)


class TestLikelihoods:
    @pytest.mark.parametrize("noise", [0.05, 0.3])
    def test_a_pulse_of_the_median_height_or_none(self, noise, rng):
        heights = np.concatenate([rng.normal(1, 0.1, 50), rng.normal(0, 0.1, 20)])
        scale, ratios = compute_likelihoods(heights, noise)
        high = heights[heights > 0.5 * np.quantile(heights, 0.9)]
        assert scale == np.median(high)
        # Where there is no noise, pulses differ by a tenth of their height.
        deviation = max(noise, 0.1 * scale)
        odds = norm.logpdf(heights, scale, deviation) - norm.logpdf(heights, 0, deviation)
        expected = np.log(0.98 * np.exp(odds) + 0.02)
        np.testing.assert_allclose(ratios, np.minimum(expected, 50), rtol=1e-9, atol=1e-12)

    def test_none_is_surer_than_50_nor_less_sure_than_one_in_fifty(self):
        _, ratios = compute_likelihoods(np.array([1.0] * 18 + [9.0, -50.0]), 0.1)
        assert ratios.max() == 50
        assert ratios.min() == pytest.approx(MISSING)


class TestRuns:
    @pytest.mark.parametrize("seed", range(20))
    def test_the_run_with_the_largest_sum(self, seed):
        values = np.random.default_rng(seed).normal(size=12)
        first, last = find_run(values)
        sums = {
            (i, j): values[i : j + 1].sum()
            for i, j in itertools.combinations_with_replacement(range(12), 2)
        }
        assert values[first : last + 1].sum() == pytest.approx(max(sums.values()))

    def test_pulses_between_silence(self):
        assert find_run(
            np.array([MISSING] * 3 + [50.0] * 4 + [MISSING] + [50.0] * 2 + [MISSING])
        ) == (
            3,
            9,
        )


class TestFrames:
    STARTS = 0.5 + np.arange(20) / 10

    def match(self, ratios, frames, start_time=None):
        ratios = np.array(ratios, dtype=float)
        return match_frames(
            ratios, frames, find_run(ratios), self.STARTS[: len(ratios)], start_time
        )

    def test_as_many_pulses_as_frames(self):
        assert self.match([MISSING] * 3 + [50.0] * 6 + [MISSING] * 2, 6) == 3
        assert self.match([50.0] * 6, 6) == 0

    def test_more_and_fewer(self):
        ratios = [MISSING] * 3 + [50.0] * 6 + [MISSING] * 4
        for frames in (5, 14):
            with pytest.raises(DataError, match="do not match") as caught:
                self.match(ratios, frames)
            assert "6 pulses, from 0.800 s to 1.300 s" in str(caught.value)
            assert f"expected {frames}, one a frame" in str(caught.value)

    def test_two_slots_without_a_pulse_contradict_a_pulse(self):
        """One in fifty is missing: two have 7.8 in logarithms, one 3.9; 6 is too much."""
        ratios = [50.0, 50.0, 50.0]
        with pytest.raises(DataError, match="nothing tells which"):
            self.match([MISSING, *ratios, MISSING], 4)
        with pytest.raises(DataError, match="do not match"):
            self.match([MISSING, MISSING, *ratios, MISSING, MISSING], 5)
        assert self.match([MISSING, *ratios], 4) == 0

    @pytest.mark.parametrize(("gap", "is_told"), [(5.9, True), (6.1, False)])
    def test_what_contradicts(self, gap, is_told):
        ratios = np.array([20.0, 20.0, 20.0, gap])
        if is_told:
            assert match_frames(ratios, 3, (0, 3), self.STARTS, None) == 0
        else:
            with pytest.raises(DataError, match="do not match"):
                match_frames(ratios, 3, (0, 3), self.STARTS, None)

    @pytest.mark.parametrize(("difference", "is_sure"), [(5.9, False), (6.1, True)])
    def test_what_is_sure(self, difference, is_sure):
        """The first three or the last three: sums differ by so much."""
        ratios = np.array([difference, 20.0, 20.0, 0.0])
        if is_sure:
            assert match_frames(ratios, 3, (0, 2), self.STARTS, None) == 0
        else:
            with pytest.raises(DataError, match=r"at 0\.5000 s or 0\.6000 s"):
                match_frames(ratios, 3, (0, 2), self.STARTS, None)

    @pytest.mark.parametrize(
        ("start_time", "slot"), [(0.5, 0), (0.544, 0), (0.56, 1), (0.6, 1), (0.644, 1)]
    )
    def test_a_start_time_decides(self, start_time, slot):
        ratios = np.array([MISSING, 50.0, 50.0, 50.0, MISSING])
        assert match_frames(ratios, 4, (1, 3), self.STARTS, start_time) == slot

    @pytest.mark.parametrize("start_time", [None, 0.45, 0.65, 0.2])
    def test_a_start_time_that_is_far_decides_nothing(self, start_time):
        ratios = np.array([MISSING, 50.0, 50.0, 50.0, MISSING])
        with pytest.raises(DataError, match="3 pulses; the first frame may be"):
            match_frames(ratios, 4, (1, 3), self.STARTS, start_time)

    def test_at_most_four_are_named(self):
        with pytest.raises(DataError) as caught:
            match_frames(np.zeros(10), 3, (0, 9), self.STARTS, None)
        assert str(caught.value).count(" s or ") == 3
