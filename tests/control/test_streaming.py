"""Streams: when a frame is known, which phones are passed on, and what is refused."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from mocap_fit.control.streaming import WindowStream
from mocap_fit.errors import DataError
from mocap_fit.phones import PhoneSegment

RATE = 100.0


class Recorder:
    """Predicts the time itself, and remembers which phones it got."""

    def __init__(self):
        self.calls = []

    def __call__(self, phones, times):
        self.calls.append((phones, times))
        return np.stack([times, times], axis=1)


def begin(look_ahead, look_back=math.inf, rate=RATE):
    recorder = Recorder()
    model = SimpleNamespace(
        predict_at=recorder, parameter_names_="ab", look_ahead=look_ahead, look_back=look_back
    )
    return recorder, WindowStream(model, rate)


def phone(start, end):
    return PhoneSegment(start, end, "S")


@pytest.mark.parametrize("look_ahead", [0.0, 0.03, 0.035])
def test_frames_are_known_as_soon_as_their_look_ahead_is(look_ahead):
    _, stream = begin(look_ahead)
    assert stream.start_time is None
    assert stream.pull().shape == (0, 2)
    total = 0
    for i, end in enumerate((0.31, 0.42, 0.427, 0.55)):
        stream.push(phone((0.25, 0.31, 0.42, 0.427)[i], end))
        assert stream.start_time == 0.25
        frames = stream.pull()
        # Frame i is at start + i / rate; one at exactly the known end is not known.
        times = 0.25 + np.arange(total, 200) / RATE
        times = times[times < end - look_ahead - 1e-9]
        np.testing.assert_allclose(frames[:, 0], times)
        total += len(times)
        assert stream.pull().shape == (0, 2)
    rest = stream.finish()
    np.testing.assert_allclose(rest[:, 0], 0.25 + np.arange(total, 30) / RATE)
    assert stream.finish().shape == (0, 2)


def test_a_model_that_needs_all_phones_returns_frames_at_the_end():
    recorder, stream = begin(math.inf)
    for i in range(5):
        stream.push(phone(0.1 * i, 0.1 * (i + 1)))
        assert stream.pull().shape == (0, 2)
    assert not recorder.calls
    assert stream.finish().shape == (50, 2)
    assert len(recorder.calls[0][0]) == 5


def test_only_phones_that_matter_are_passed_on():
    recorder, stream = begin(0.05, look_back=0.1)
    for i in range(20):
        stream.push(phone(0.1 * i, 0.1 * (i + 1)))
        stream.pull()
    for phones, times in recorder.calls:
        needed = times[0] - 0.1
        assert phones[0].end >= needed
        # Nothing that matters is missing.
        assert phones[0].start <= max(needed, 0.0) + 0.1
    assert max(len(phones) for phones, _ in recorder.calls) <= 4
    # After a long pause the last phone stays, whatever the look-back is.
    recorder, stream = begin(0.0, look_back=0.0)
    stream.push(phone(0.0, 0.1))
    stream.pull()
    stream.push(phone(5.0, 5.1))
    stream.pull()
    assert len(recorder.calls[-1][0]) == 2
    stream.push(phone(9.0, 9.1))
    stream.pull()
    stream.push(phone(9.1, 9.2))
    stream.pull()
    # Frames from 9.1 s on: what ended before does not matter.
    assert [segment.start for segment in recorder.calls[-1][0]] == [9.0, 9.1]


def test_a_phone_that_ends_where_the_look_back_begins_is_passed_on():
    recorder, stream = begin(0.0, look_back=0.5)
    stream.push(phone(0.0, 0.25))
    stream.pull()
    stream.push(phone(0.25, 0.75))
    stream.pull()
    stream.push(phone(0.75, 1.0))
    stream.pull()
    # From 0.75 on what ends at 0.25 or later matters.
    assert [len(phones) for phones, _ in recorder.calls] == [1, 2, 3]
    stream.push(phone(1.0, 1.5))
    stream.pull()
    assert recorder.calls[-1][0][0].start == 0.25


def test_phones_that_overlap_are_refused_but_rounding_is_not():
    _, stream = begin(0.0)
    stream.push(phone(0.0, 0.5))
    with pytest.raises(DataError, match=r"order of time.*'S' from 0\.4999 s.*0\.5 s or later"):
        stream.push(phone(0.4999, 0.6))
    stream.push(phone(0.5 - 5e-10, 0.6))
    stream.push(phone(0.7, 0.8))
    assert len(stream.finish()) == 80
    with pytest.raises(DataError, match="has ended"):
        stream.push(phone(0.8, 0.9))


@pytest.mark.parametrize("rate", [0.0, -1.0, math.inf, math.nan])
def test_impossible_rates_are_refused(rate):
    with pytest.raises(DataError, match="rate must be positive"):
        begin(0.0, rate=rate)
    assert begin(0.0, rate=0.5)[1].rate == 0.5


def test_nothing_is_computed_where_no_phone_came():
    recorder, stream = begin(0.0)
    assert stream.finish().shape == (0, 2)
    assert not recorder.calls
