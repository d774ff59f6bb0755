"""Recordings on the clock of their sound: by pulses, and by an estimate that says it is one."""

import json

import numpy as np
import pytest

from mocap_fit.errors import DataError
from mocap_fit.io import read_tracks
from mocap_fit.sound import Sound, estimate_offset, read_sound, synchronise
from mocap_fit.tracks import Event, MarkerTracks

RATE = 60.0


def syllables(seed=0, duration=4.0, start=0.13):
    """Lips that open and close, and a voice that is loud when they are open."""
    rng = np.random.default_rng(seed)
    knots = np.arange(-1, duration + 2, 0.11)
    opening = np.clip(rng.uniform(-5, 15, len(knots)), 0, None)
    frames = np.interp(start + np.arange(int(RATE * duration)) / RATE, knots, opening)
    times = np.arange(int(16000 * (duration + 0.6))) / 16000
    voice = rng.normal(size=len(times)) * np.interp(times, knots, opening) / 60
    return frames, Sound(voice + rng.normal(0, 1e-4, len(times)), 16000)


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
    @pytest.mark.parametrize("start", [-0.2, 0.0, 0.13, 0.35])
    def test_a_known_offset(self, start):
        opening, sound = syllables(start=start)
        found = estimate_offset(opening, RATE, sound)
        assert found.start_time == pytest.approx(start, abs=0.02)
        assert found.correlation > 0.5
        assert 0 < found.half_width < 0.1

    def test_gaps_do_not_matter(self):
        opening, sound = syllables()
        opening[40:60] = np.nan
        assert estimate_offset(opening, RATE, sound).start_time == pytest.approx(0.13, abs=0.02)

    def test_level_and_unit_do_not_matter(self):
        opening, sound = syllables()
        one = estimate_offset(opening, RATE, sound)
        other = estimate_offset(7 * opening + 3, RATE, sound.replace(samples=0.2 * sound.samples))
        assert other.start_time == pytest.approx(one.start_time, abs=0.006)

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

    def test_what_is_refused(self, rng):
        opening, sound = syllables()
        with pytest.raises(DataError, match="cannot be estimated"):
            estimate_offset(np.ones(240), RATE, sound)
        with pytest.raises(DataError, match="cannot be estimated"):
            estimate_offset(opening, RATE, Sound(np.zeros(64000), 16000))
        with pytest.raises(DataError, match="overlap too little"):
            estimate_offset(opening, RATE, sound, start_time=30.0)
        with pytest.raises(DataError, match="overlap too little"):
            estimate_offset(opening[:5], RATE, sound)
        with pytest.raises(DataError, match="overlap too little"):
            estimate_offset(np.full(240, np.nan), RATE, sound)
        with pytest.raises(DataError, match="a correlation of"):
            estimate_offset(opening, RATE, Sound(rng.normal(size=70000), 16000))
        with pytest.raises(DataError, match="cannot be used"):
            estimate_offset(opening[:, None], RATE, sound)
        with pytest.raises(DataError, match="a marker on each lip"):
            synchronise(recording(opening), sound, kind="estimate")


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
