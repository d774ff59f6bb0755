"""Recordings on the clock of their sound: by pulses, and by an estimate that says it is one."""

import json

import numpy as np
import pytest
from test_estimate import syllables

from mocap_fit.errors import DataError
from mocap_fit.io import read_tracks
from mocap_fit.sound import Sound, estimate_offset, read_sound, synchronise
from mocap_fit.tracks import Event, MarkerTracks

RATE = 60.0


def recording(opening, **about):
    positions = np.zeros((len(opening), 2, 3))
    positions[:, 0, 1] = opening
    return MarkerTracks(("upper", "lower"), RATE, positions, name="a", **about)


class TestPulses:
    def test_start_rate_and_events_move_and_values_stay(self, make_train):
        train = make_train(drift_ppm=200, start=0.25)
        sound = Sound(np.stack([np.zeros(len(train.channel)), train.channel], axis=1), 48000)
        before = recording(np.arange(240.0), start_time=1.0, events=(Event("clap", 2.0),))
        after, how = synchronise(before, sound, kind="pulses", channel=2)
        np.testing.assert_array_equal(after.positions, before.positions)
        np.testing.assert_allclose(after.times, train.times, atol=1e-5)
        assert after.rate == pytest.approx(60.012, abs=1e-4)
        assert after.events[0].time == pytest.approx(0.25 + 60 / 60.012, abs=1e-4)
        assert (how.kind, how.is_estimate, how.missing, how.extra) == ("pulses", False, 0, 0)
        step = after.provenance[-1]
        assert step.name == "synchronise"
        assert step.arguments["is_estimate"] is False
        assert step.arguments["drift_ppm"] == pytest.approx(200, abs=1)
        json.dumps(step.to_dict(), allow_nan=False)

    def test_pulses_that_belong_to_no_frame(self, make_train):
        train = make_train(drift_ppm=200)
        sound = Sound(train.channel, 48000)
        part = recording(np.arange(237.0))
        with pytest.raises(DataError, match="do not match"):
            synchronise(part, sound, channel=1)
        after, how = synchronise(part, sound, channel=1, spare=(2, 1))
        np.testing.assert_allclose(after.times, train.times[2:-1], atol=1e-5)
        assert (how.missing, how.extra) == (0, 0)

    def test_a_channel_that_is_not_there(self):
        with pytest.raises(DataError, match="no channel 2"):
            synchronise(recording(np.zeros(240)), Sound(np.zeros(300000), 48000))


class TestEstimate:
    def test_it_says_that_it_is_one(self):
        opening, sound = syllables()
        after, how = synchronise(
            recording(opening), sound, kind="estimate", lips=("upper", "lower")
        )
        assert how.is_estimate
        assert how.kind == "estimate"
        assert after.rate == RATE
        assert after.start_time == pytest.approx(0.13, abs=0.02)
        assert after.provenance[-1].arguments["is_estimate"] is True
        assert after.provenance[-1].arguments["kind"] == "estimate"

    def test_it_needs_lips(self):
        opening, sound = syllables()
        with pytest.raises(DataError, match="a marker on each lip"):
            synchronise(recording(opening), sound, kind="estimate")

    def test_it_is_searched_around_the_start_of_the_recording(self):
        opening, sound = syllables(start=0.6)
        lips = ("upper", "lower")
        near, _ = synchronise(
            recording(opening, start_time=0.5), sound, kind="estimate", lips=lips, max_offset=0.2
        )
        assert near.start_time == pytest.approx(0.6, abs=0.02)
        told, _ = synchronise(
            recording(opening), sound, kind="estimate", lips=lips, start_time=0.5, max_offset=0.2
        )
        assert told.start_time == near.start_time
        with pytest.raises(DataError, match=r"within -0\.045 s to 0\.045 s"):
            synchronise(recording(opening), sound, kind="estimate", lips=lips, max_offset=0.05)

    def test_lips_are_apart_in_any_direction(self):
        opening, sound = syllables()
        upright, _ = synchronise(
            recording(opening), sound, kind="estimate", lips=("upper", "lower")
        )
        turned = recording(opening)
        away = np.cumsum(np.random.default_rng(0).normal(size=(len(opening), 1, 3)), axis=0)
        turned = turned.replace(positions=turned.positions[:, :, [1, 2, 0]] + away)
        again, _ = synchronise(turned, sound, kind="estimate", lips=("lower", "upper"))
        assert again.start_time == pytest.approx(upright.start_time)


@pytest.mark.parametrize("kind", ["pulses", "estimate"])
def test_without_sound_nothing_can_be_measured(kind):
    with pytest.raises(DataError, match="no sound"):
        synchronise(recording(np.zeros(60)), None, kind=kind)
    after, how = synchronise(recording(np.zeros(60), start_time=0.5), None, kind="none")
    assert (after.start_time, how.kind) == (0.5, "none")


def test_a_start_time_decides_which_pulse_is_missing(make_train):
    """Two spare pulses before the first frame's: the start time is that of the frame."""
    train = make_train()
    channel = train.channel.copy()
    channel[train.samples[0] :][:24] = 0
    sound = Sound(channel, 48000)
    part = recording(np.arange(238.0))
    after, how = synchronise(part, sound, channel=1, spare=(2, 0), start_time=train.times[2])
    np.testing.assert_allclose(after.times, train.times[2:], atol=1e-5)
    assert how.missing == 0
    later, how = synchronise(
        part, sound, channel=1, spare=(2, 0), start_time=train.times[2] + 1 / 60
    )
    assert later.start_time == pytest.approx(train.times[3], abs=1e-4)
    assert how.missing == 1


def test_what_is_known_goes_to_json(make_train):
    train = make_train(missing=0.1, seed=3)
    sound = Sound(train.channel, 48000)
    _, how = synchronise(recording(np.arange(240.0)), sound, channel=1, start_time=0.25)
    known = how.to_dict()
    assert known["missing"] == train.missing.sum() > 10
    assert "correlation" not in known
    assert set(known) == {
        "kind", "start_time", "rate", "drift_ppm", "missing", "extra", "residual", "is_estimate"
    }  # fmt: skip


def test_none_only_says_so():
    before = recording(np.zeros(60), start_time=0.5)
    after, how = synchronise(before, Sound(np.zeros(16000), 16000), kind="none")
    assert (after.start_time, after.rate) == (0.5, RATE)
    assert (how.kind, how.is_estimate) == ("none", False)
    assert after.provenance[-1].arguments["kind"] == "none"
    moved, _ = synchronise(before, Sound(np.zeros(16000), 16000), kind="none", start_time=0.02)
    assert moved.start_time == 0.02


@pytest.mark.real_data
def test_the_estimate_on_real_speech(data_folder):
    """The first frame is 20 ms into the sound; three seconds of video tell it roughly."""
    folder = data_folder / "grid_s1"
    starts = []
    for path in sorted((folder / "tsv").iterdir())[:40]:
        tracks = read_tracks(path)
        upper, lower = (tracks[f"lip_inner_mid_{side}"] for side in ("upper", "lower"))
        sound = read_sound(folder / "wav" / f"{path.stem}.wav")
        opening = np.linalg.norm(upper - lower, axis=1)
        starts.append(estimate_offset(opening, 25.0, sound).start_time)
    starts = np.array(starts)
    print(
        f"\nestimated start: median {np.median(starts):.3f} s, 0.02 s is true; "
        f"{np.mean(np.abs(starts - 0.02) < 0.06):.0%} within 60 ms"
    )
    assert abs(np.median(starts) - 0.02) < 0.03
    assert np.mean(np.abs(starts - 0.02) < 0.06) > 0.7
