"""A first estimate of a pulse train, against trains whose every number is known."""

import numpy as np
import pytest

from mocap_fit.sound.pulse_search import (
    _average_periods,
    _Box,
    _estimate_frequency,
    _fit_box,
    _search_chunk,
    find_grid,
)


def comb(period, count, width=4, first=10, height=1.0, tail=0):
    """A channel with a pulse of a width every period."""
    begins = np.rint(first + period * np.arange(count)).astype(int)
    channel = np.zeros(begins[-1] + width + tail)
    for begin in begins:
        channel[begin : begin + width] = height
    return channel


class TestGrid:
    @pytest.mark.parametrize("sign", [1, -1])
    @pytest.mark.parametrize(("width", "first"), [(1, 10), (4, 0), (30, 77)])
    def test_all_its_numbers(self, width, first, sign):
        channel = comb(100.0, 50, width, first, tail=100 - width)
        grid = find_grid(3 + sign * channel, 100.0, 2e-3)
        # The period to a thousandth of a sample, the start to one sample of one of the pulses.
        assert grid.period == pytest.approx(100.0, abs=0.02)
        assert abs((grid.start - first + 50) % 100 - 50) <= 1
        assert (grid.width, grid.sign) == (width, sign)
        assert (grid.first, grid.end) == (0, len(channel))

    @pytest.mark.parametrize("true", [99.81, 99.95, 100.07, 100.19])
    def test_a_period_that_is_nearly_known(self, true):
        grid = find_grid(comb(true, 400), 100.0, 2e-3)
        assert grid.period == pytest.approx(true, abs=4 / 400)

    def test_what_is_out_of_tolerance_is_not_looked_for(self):
        grid = find_grid(comb(101.0, 400), 100.0, 2e-3)
        assert grid is None or abs(grid.period - 100) <= 0.21
        assert find_grid(comb(101.0, 400), 100.0, 2e-2).period == pytest.approx(101.0, abs=0.01)

    @pytest.mark.parametrize("period", [20.0, 21.0, 100.0])
    def test_a_pulse_is_half_a_period_long_at_most(self, period):
        """What is high for two thirds of a period is low for a third of it."""
        grid = find_grid(comb(period, 200, round(2 * period / 3)), period, 2e-3)
        assert (grid.sign, grid.width) == (-1, round(period) - round(2 * period / 3))
        half = find_grid(comb(period, 200, round(0.55 * period)), period, 2e-3)
        assert (half.sign, half.width) == (1, round(period) // 2)

    def test_nothing_is_found_where_nothing_is(self, rng):
        assert find_grid(np.zeros(5000), 100.0, 2e-3) is None
        assert find_grid(np.full(5000, 0.3), 100.0, 2e-3) is None
        assert find_grid(np.zeros(0), 100.0, 2e-3) is None
        assert find_grid(comb(100.0, 1), 100.0, 2e-3) is None
        for _ in range(5):
            assert find_grid(rng.normal(size=20000), 100.0, 2e-3) is None

    def test_chunks_of_a_thousand_periods(self):
        """The clearest chunk is taken; the search ends one chunk after the first clear one."""
        silence, pulses = np.zeros(100_000), comb(100.0, 1000, tail=86)
        assert len(pulses) == 100_000
        grid = find_grid(np.concatenate([silence, pulses, pulses, silence]), 100.0, 2e-3)
        assert (grid.first, grid.end) == (100_000, 200_000)
        # A few pulses at the end of a chunk: the next has more.
        few = np.concatenate([silence[:99_500], pulses[:99_900]])
        grid = find_grid(few, 100.0, 2e-3)
        assert (grid.first, grid.end) == (100_000, 199_400)
        assert abs((grid.start - 99_510 + 50) % 100 - 50) <= 1

    def test_a_noisy_chunk_gives_way_to_a_clear_one(self, rng):
        pulses = comb(100.0, 1000, 20, tail=70)
        noisy = pulses + rng.normal(0, 2.0, len(pulses))
        first, later = find_grid(noisy, 100.0, 2e-3), np.concatenate([noisy, noisy, pulses])
        assert first.first == 0
        assert find_grid(later, 100.0, 2e-3).first == 200_000

    def test_the_rest_of_a_sound_may_be_too_short_for_a_chunk(self):
        channel = np.concatenate([np.zeros(100_000), comb(100.0, 4)])
        assert len(channel) - 100_000 < 400
        assert find_grid(channel, 100.0, 2e-3) is None
        longer = np.concatenate([np.zeros(100_000), comb(100.0, 4, tail=86)])
        assert find_grid(longer, 100.0, 2e-3).first == 100_000
        # Alone, two periods are enough.
        assert find_grid(comb(100.0, 2, tail=86), 100.0, 2e-3) is not None


class TestFrequency:
    @pytest.mark.parametrize("true", [99.85, 100.0, 100.12])
    def test_it_is_exact_to_a_step(self, true):
        channel = comb(true, 300)
        frequency, step = _estimate_frequency(channel - channel.mean(), 100.0, 2e-3)
        assert frequency == pytest.approx(1 / true, abs=2 * step)
        # A sixtieth, or as many harmonics as there are below 0.45 of the rate, of a spectrum's bin.
        assert 1 / step == pytest.approx(45 * 2 * len(channel), rel=0.01)

    def test_sixty_harmonics_at_most(self):
        channel = comb(1000.0, 20)
        _, step = _estimate_frequency(channel - channel.mean(), 1000.0, 2e-3)
        assert 1 / step == pytest.approx(60 * 2 * len(channel), rel=0.01)

    @pytest.mark.parametrize("level", [1e-12, 1.0, 1e12])
    def test_hum_near_one_multiple_does_not_hide_the_others(self, level):
        channel = comb(100.0, 300, 2)
        times = np.arange(len(channel))
        hum = 3 * np.sin(2 * np.pi * times * 5 * 1.0008 / 100)
        noisy = level * (channel - channel.mean() + hum)
        frequency, step = _estimate_frequency(noisy, 100.0, 2e-3)
        assert frequency == pytest.approx(0.01, abs=2 * step)


class TestPeriods:
    def test_the_mean_period_is_that_of_the_train(self):
        channel = np.tile(np.arange(8.0), 7)
        np.testing.assert_allclose(_average_periods(channel, 0.125), np.arange(8.0))
        higher = channel + np.repeat([0.0, 2.0] * 3 + [0.0], 8)
        np.testing.assert_allclose(_average_periods(higher, 0.125), np.arange(8.0) + 6 / 7)

    def test_a_period_between_two_samples(self):
        """Ten samples and a half: the phases of all samples, by hand."""
        channel = np.random.default_rng(0).normal(size=105)
        expected = np.zeros(10)
        for index in range(10):
            inside = [v for i, v in enumerate(channel) if int((i / 10.5 % 1) * 10) == index]
            expected[index] = np.mean(inside)
        np.testing.assert_allclose(_average_periods(channel, 1 / 10.5), expected)

    def test_bins_without_a_sample_are_zero(self):
        np.testing.assert_array_equal(_average_periods(np.ones(1), 1e-1), [1.0] + 9 * [0.0])


class TestBox:
    @pytest.mark.parametrize(("position", "width"), [(3, 1), (3, 4), (0, 2), (18, 4)])
    @pytest.mark.parametrize("sign", [1, -1])
    def test_a_box_is_found(self, position, width, sign):
        """Least squares: the height times the root of w (1 - w / p)."""
        profile = np.full(20, 7.0)
        profile[(position + np.arange(width)) % 20] += 0.5 * sign
        box = _fit_box(profile, 0.01, np.arange(1, 11))
        explained = 0.5 * np.sqrt(width * (1 - width / 20))
        assert (box.position, box.width, box.sign) == (position, width, sign)
        assert box.height == pytest.approx(explained)
        assert box.clearness == pytest.approx(explained / 0.01)

    def test_clearness_is_the_height_over_the_noise_outside(self):
        profile = np.random.default_rng(0).normal(0, 0.01, 400)
        profile[100:110] += 1
        box = _fit_box(profile, 1e-9, np.arange(1, 201))
        outside = np.delete(profile, np.arange(100, 110))
        deviation = np.median(np.abs(outside - np.median(outside))) / 0.6744897501960817
        assert (box.position, box.width) == (100, 10)
        assert box.clearness == pytest.approx(box.height / deviation, rel=1e-4)

    def test_only_some_widths(self):
        profile = np.zeros(20)
        profile[3:7] = 1
        assert _fit_box(profile, 0.01, np.array([2, 8])).width in (2, 8)

    @pytest.mark.parametrize(("negative", "sign"), [(1.2, 1), (1.3, -1)])
    def test_a_negative_pulse_must_be_a_quarter_clearer(self, negative, sign):
        profile = np.zeros(1000)
        profile[100], profile[600] = 1.0, -negative
        assert _fit_box(profile, 1e-9, np.array([1])).sign == sign

    def test_a_flat_profile_has_no_height(self):
        box = _fit_box(np.ones(20), 0.01, np.arange(1, 11))
        assert (box.height, box.clearness) == (0, 0)
        assert _Box().sign == 0


def test_a_channel_without_noise_is_as_clear_as_a_thousandth_of_it_allows():
    """A thousandth of its deviation, over the root of the number of periods, is the least noise."""
    for count in (25, 100):
        channel = comb(100.0, count, 4, tail=86)
        clearness, grid = _search_chunk(channel, 0, 100.0, 2e-3)
        height = np.sqrt(4 * (1 - 4 / 100))
        floor = 1e-3 * channel.std() / np.sqrt(count)
        assert grid.sign == 1
        assert clearness == pytest.approx(height / floor, rel=0.2)
