"""Time in the window: zoom, selection, steps, and how it plays."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from corpus_tools.inspection.time_line import TimeLine


@pytest.fixture
def line():
    return TimeLine(1.0, 11.0, 50.0)


def test_zoom_keeps_the_time_under_the_cursor_where_it_is(line):
    line.move_cursor(3.0)
    line.zoom_in()
    assert (line.start, line.end) == (2.0, 7.0)
    line.zoom_out()
    assert (line.start, line.end) == (1.0, 11.0)


@given(st.lists(st.tuples(st.sampled_from("zsmp"), st.floats(-20, 20)), max_size=20))
def test_what_is_shown_stays_within_what_there_is(moves):
    line = TimeLine(0.0, 8.0, 60.0)
    for kind, value in moves:
        if kind == "z":
            line.zoom(2.0**value)
        elif kind == "s":
            line.scroll(value)
        elif kind == "m":
            line.move_cursor(value)
        else:
            line.select(value, value + 1)
        assert line.first <= line.start < line.end <= line.last
        assert line.first <= line.cursor <= line.last


def test_steps_are_frames(line):
    line.move_cursor(1.011)
    line.step(1)
    assert line.cursor == pytest.approx(1.04)
    line.step(-3)
    assert line.cursor == 1.0
    later = TimeLine(0.0, 10.0, 50.0, 0.011)
    later.step(1)
    assert later.cursor == pytest.approx(0.011)


def test_the_cursor_turns_the_page(line):
    line.show(1.0, 2.0)
    line.move_cursor(2.5)
    assert line.start < 2.5 < line.end
    assert line.span == pytest.approx(1.0)


def test_a_selection_can_be_drawn_backwards_and_zoomed_to(line):
    line.select(4.0, 2.0)
    line.zoom_to_selection()
    assert (line.start, line.end) == (2.0, 4.0)
    line.select(3.0, 3.0)
    assert line.selection is None


def test_it_plays_by_the_clock_to_the_end_and_stops(line):
    line.play(100.0)
    line.advance(102.5)
    assert line.cursor == pytest.approx(3.5)
    line.advance(200.0)
    assert line.cursor == 11.0
    assert not line.is_playing
    # From the end it begins again.
    assert line.play(300.0) == (1.0, 11.0)


@pytest.mark.parametrize(("speed", "cursor"), [(0.5, 2.5), (2.0, 4.0)])
def test_it_plays_slowly_and_fast(line, speed, cursor):
    line.speed = speed
    line.move_cursor(2.0)
    line.play(0.0)
    line.advance(1.0)
    assert line.cursor == pytest.approx(cursor)


def test_it_follows_the_sound_where_there_is_one(line):
    line.play(0.0)
    line.advance(5.0, position=1.2)
    assert line.cursor == 1.2


def test_a_selection_loops(line):
    line.select(2.0, 3.0)
    line.loops = True
    line.play(0.0, only_selection=True)
    assert not line.advance(0.9)
    assert line.advance(1.01)
    assert line.cursor == 2.0
    assert line.is_playing
