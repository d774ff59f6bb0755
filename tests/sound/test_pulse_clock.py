"""The clock of a pulse train: slots by hand, lines by numpy, trains that are known."""

import numpy as np
import pytest

from mocap_fit.sound.pulse_clock import Clock, _refine_clock, fit_line, follow_pulses, list_slots
from mocap_fit.sound.pulse_search import Grid


def channel_with(begins, width, length, height=1.0):
    channel = np.zeros(length)
    for begin in begins:
        channel[begin : begin + width] = height
    return channel


def test_a_clock_is_a_line():
    np.testing.assert_allclose(Clock(3.0, 10.5).at([-1, 0, 2]), [-7.5, 3.0, 24.0])


class TestSlots:
    @pytest.mark.parametrize(
        ("start", "width", "length", "first", "last"),
        [
            (0.0, 1, 100, 0, 10),
            (-1.5, 1, 100, 0, 10),
            (-1.6, 1, 100, 1, 10),
            (8.4, 1, 100, 0, 9),
            (8.5, 1, 100, -1, 9),
            (0.4, 1, 100, 0, 10),
            (0.6, 1, 100, 0, 9),
            # A pulse of five samples may lie a sample farther out.
            (-2.5, 5, 100, 0, 10),
            (-2.6, 5, 100, 1, 10),
            (7.4, 5, 100, 0, 9),
            (7.6, 5, 100, -1, 8),
        ],
    )
    def test_those_in_the_sound(self, start, width, length, first, last):
        slots = list_slots(Clock(start, 10.0), width, length)
        margin = 1.5 + (width - 1) / 4
        inside = [k for k in range(-5, 20) if -margin <= start + 10 * k <= length - width + margin]
        assert inside == list(range(inside[0], inside[-1] + 1))
        np.testing.assert_array_equal(slots, inside)
        assert (slots[0], slots[-1]) == (first, last)


class TestLine:
    def test_it_is_that_of_least_squares(self, rng):
        numbers = np.arange(3, 40)
        positions = 5 + 12.25 * numbers + rng.uniform(-0.5, 0.5, len(numbers))
        line = fit_line(numbers, positions)
        slope, start = np.polyfit(numbers, positions, 1)
        assert line.period == pytest.approx(slope)
        assert line.start == pytest.approx(start)

    @pytest.mark.parametrize(("off", "is_left_out"), [(0.9, False), (1.5, True), (40.0, True)])
    def test_what_is_far_is_left_out(self, off, is_left_out):
        numbers = np.arange(101)
        positions = 12.0 * numbers
        positions[50] += off
        line = fit_line(numbers, positions)
        assert line.period == pytest.approx(12.0)
        if is_left_out:
            assert line.start == pytest.approx(0.0, abs=1e-9)
        else:
            assert line.start == pytest.approx(off / 101)

    def test_far_is_three_times_the_median(self):
        numbers = np.arange(1000)
        spread = np.where(numbers % 2, 2.0, -2.0)
        for off, expected in ((5.5, 1000), (7.0, 999)):
            positions = 12.0 * numbers + spread
            positions[500] = 12.0 * 500 + off
            used = numbers if expected == 1000 else np.delete(numbers, 500)
            slope, start = np.polyfit(used, positions[used], 1)
            line = fit_line(numbers, positions)
            assert line.period == pytest.approx(slope, abs=1e-12)
            assert line.start == pytest.approx(start, abs=1e-9)

    def test_a_far_one_that_hides_another(self):
        """Three rounds: what is far is far from a line without what is farther."""
        numbers = np.arange(201)
        positions = 12.0 * numbers
        positions[0], positions[200] = 300.0, 12.0 * 200 + 3.0
        line = fit_line(numbers, positions)
        assert line.period == pytest.approx(12.0, abs=1e-9)
        assert line.start == pytest.approx(0.0, abs=1e-6)

    def test_one_number_has_no_line(self):
        assert fit_line(np.array([4, 4, 4]), [1.0, 2.0, 3.0]) is None


class TestFollowing:
    def test_from_a_chunk_to_both_ends(self):
        begins = np.rint(37 + 100.1 * np.arange(90)).astype(int)
        channel = channel_with(begins, 6, 9200)
        slope, start = np.polyfit(np.arange(90), begins, 1)
        # The grid is off by a few samples and knows the middle only.
        grid = Grid(4042.0, 100.15, 6, 1, 3900, 5000)
        clock = follow_pulses(channel, grid)
        assert clock.period == pytest.approx(slope, abs=1e-9)
        assert (clock.start - start) / slope == pytest.approx(40, abs=1e-6)

    @pytest.mark.parametrize("chunk", [(1000, 2000), (7200, 8200)])
    def test_one_end_is_reached_before_the_other(self, chunk):
        begins = np.rint(37 + 100.1 * np.arange(90)).astype(int)
        slope, _ = np.polyfit(np.arange(90), begins, 1)
        start = begins[np.searchsorted(begins, chunk[0])]
        grid = Grid(float(start), 100.1, 6, 1, *chunk)
        clock = follow_pulses(channel_with(begins, 6, 9200), grid)
        assert clock.period == pytest.approx(slope, abs=1e-9)

    @pytest.mark.parametrize("width", [1, 3])
    def test_pulses_at_both_ends_of_the_sound_count(self, width):
        begins = np.array([0, 51, 100, 149, 200])
        length = 200 + width
        grid = Grid(0.0, 50.0, width, 1, 0, length)
        clock = follow_pulses(channel_with(begins, width, length), grid)
        slope, start = np.polyfit(np.arange(5), begins, 1)
        assert (clock.period, clock.start) == (pytest.approx(slope), pytest.approx(start))

    @pytest.mark.parametrize(
        ("width", "shift", "reach"), [(1, 2, 2), (1, 3, 2), (12, 6, 6), (12, 16, 18)]
    )
    def test_how_far_a_pulse_may_be_from_the_first_estimate(self, width, shift, reach):
        """Two samples, or half of a pulse's width, in each of three rounds."""
        begins = np.arange(50, 4000, 50)
        channel = channel_with(begins + shift, width, 4000)
        clock = follow_pulses(channel, Grid(50.0, 50.0, width, 1, 0, 4000))
        assert clock.start % 50 == pytest.approx(shift if shift <= reach else 0, abs=1e-6)

    def test_noise_alone_takes_the_clock_nowhere(self, rng):
        clock = follow_pulses(rng.normal(size=4000), Grid(10.0, 50.0, 8, 1, 0, 4000))
        assert abs(clock.at(0) - 10) <= 12
        assert abs(clock.at(79) - 3960) <= 12


def refine(channel, clock, width, slots, reach):
    return _refine_clock(np.concatenate(([0.0], np.cumsum(channel))), clock, width, slots, reach)


class TestRefining:
    def test_pulses_within_reach(self):
        begins = np.array([10, 22, 28, 41])
        channel = channel_with(begins, 2, 60)
        clock = refine(channel, Clock(10.0, 10.0), 2, np.arange(4), 2)
        slope, start = np.polyfit(np.arange(4), begins, 1)
        assert (clock.period, clock.start) == (pytest.approx(slope), pytest.approx(start))

    def test_a_pulse_beyond_reach_is_left_out(self):
        channel = channel_with([13, 21, 31, 41], 2, 60)
        clock = refine(channel, Clock(10.0, 10.0), 2, np.arange(4), 2)
        assert (clock.period, clock.start) == (pytest.approx(10), pytest.approx(11))

    def test_slots_without_a_pulse_are_left_out(self):
        """Half of a pulse of the higher half is the least."""
        begins = np.array([10, 20, 30, 50, 60])
        channel = channel_with(begins, 2, 80)
        channel[41:43] = 0.45
        np.testing.assert_allclose(
            refine(channel, Clock(10.0, 10.0), 2, np.arange(6), 2).at(np.arange(6)),
            [10, 20, 30, 40, 50, 60],
            atol=1e-9,
        )
        channel[41:43] = 0.55
        line = refine(channel, Clock(10.0, 10.0), 2, np.arange(6), 2)
        slope, start = np.polyfit(np.arange(6), [10, 20, 30, 41, 50, 60], 1)
        assert (line.period, line.start) == (pytest.approx(slope), pytest.approx(start))

    def test_too_few_change_nothing(self):
        clock = Clock(10.0, 10.0)
        assert refine(channel_with([11, 21], 2, 60), clock, 2, np.arange(2), 2) is clock
        assert refine(np.zeros(60), Clock(100.0, 10.0), 2, np.arange(3), 2) == Clock(100.0, 10.0)
        moved = refine(channel_with([11, 21, 31], 2, 60), clock, 2, np.arange(3), 2)
        assert moved.start == pytest.approx(11)

    def test_it_does_not_move_beyond_its_reach(self):
        clock = Clock(10.0, 10.0)
        channel = channel_with([12, 22, 32], 2, 150)
        assert refine(channel, clock, 2, np.arange(3), 2).start == pytest.approx(12)
        # A line through three that would be far away at the tenth.
        far = channel_with([10, 21, 32, 42], 2, 150)
        channel = far + channel_with([100, 110, 120], 2, 150, 0.1)
        assert refine(channel, clock, 2, np.array([0, 1, 2, 11]), 2) is clock
