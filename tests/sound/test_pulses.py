"""Sync pulses: the truth of a made train is recovered, whatever is wrong with it."""

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.signal import butter, sosfilt

from mocap_fit.errors import DataError
from mocap_fit.sound import decode_pulses


def root_mean_square(train, found):
    """Milliseconds between the true times of the frames and those decoded."""
    return 1000 * np.sqrt(np.mean((found.samples / train.rate - train.times) ** 2))


@pytest.mark.parametrize("rate", [16000, 44100, 48000])
@pytest.mark.parametrize("part", [0, 0.002, 0.03, 0.125, 0.5])
def test_clean_pulses_are_decoded_to_the_sample(rate, part, make_train):
    width = max(1, int(part * rate / 60))
    train = make_train(rate, width=width, drift_ppm=200)
    found = decode_pulses(train.channel, rate, 60.0, 240)
    assert (found.samples == train.samples).all()
    assert found.present.all()
    assert (found.frames, found.extra) == (240, 0)
    assert found.drift_ppm == pytest.approx(200, abs=1)
    assert found.residual < 1 / rate
    np.testing.assert_allclose(found.times, train.times, atol=0.5 / rate)


def clean_train(*values):
    names = ("frame_rate", "frames", "drift", "start", "height", "sign", "level", "width", "tail")
    return example(**dict(zip(names, values, strict=True)))


@settings(max_examples=12, deadline=None)
@given(
    frame_rate=st.sampled_from([25.0, 60.0, 100.0, 119.88, 240.0]),
    frames=st.integers(30, 200),
    drift=st.floats(-1000, 1000),
    start=st.floats(0.0, 1.0),
    height=st.floats(0.01, 1.0),
    sign=st.sampled_from([-1, 1]),
    level=st.floats(-0.5, 0.5),
    width=st.integers(1, 20),
    tail=st.sampled_from([0.0, 0.3, 3.0]),
)
# A level that is not 0 was refused, or was a sample off.
@clean_train(25.0, 30, 151.0, 1.0, 0.5, 1, 0.5, 8, 0.3)
@clean_train(25.0, 30, 0.0, 1.0, 0.25, 1, 0.5, 8, 0.3)
@clean_train(60.0, 60, 100.0, 1.0, 0.01, -1, 100.0, 8, 0.3)
# Narrow pulses, on a clock that is a sample off.
@clean_train(240.0, 135, 990.19, 7.577288, 0.5, 1, 0.0, 2, 0.3)
@clean_train(25.0, 158, 25.5, 8.4131727, 1.0, -1, 100.0, 1, 3.0)
@clean_train(100.0, 151, 292.09, 0.0737164, 1.0, -1, 0.492, 1, 3.0)
# Pulses at the ends of the sound.
@clean_train(25.0, 158, -269.8, 6.2910815, 0.446, -1, 100.0, 8, 0.0)
@clean_train(240.0, 197, 0.0, 0.0, 0.25, -1, 0.5, 1, 0.3)
# A few pulses at the end of the first chunk of the search.
@clean_train(240.0, 145, 0.0, 4.142042776773351, 0.01, -1, 0.5, 8, 3.0)
def test_any_clean_train(
    frame_rate, frames, drift, start, height, sign, level, width, tail, make_train
):
    train = make_train(
        16000,
        frame_rate,
        frames,
        drift_ppm=drift,
        start=start,
        height=height,
        width=width,
        tail=tail,
    )
    decoded = decode_pulses(sign * train.channel + level, 16000, frame_rate, frames)
    assert (decoded.samples == train.samples).all()
    assert decoded.present.all()
    assert decoded.extra == 0
    # A clock that is known to half a sample at its ends, the first frame and the last, tells no
    # less than this; a thousandth more for what is rounded.
    assert abs(decoded.drift_ppm - drift) < 1.001e6 / ((frames - 1) / frame_rate * 16000)


@pytest.mark.parametrize("seed", range(6))
def test_noise_missing_pulses_and_drift(seed, make_train):
    """10 dB of peak power over noise, 2 % of the pulses missing, clocks 200 ppm apart."""
    train = make_train(noise_db=10, missing=0.02, drift_ppm=200, seed=seed)
    found = decode_pulses(train.channel, 48000, 60.0, 240, start_time=0.25)
    assert root_mean_square(train, found) <= 1.0
    # It is far better than asked: less than one sample.
    assert root_mean_square(train, found) < 1000 / 48000
    assert found.drift_ppm == pytest.approx(200, abs=10)
    assert found.signal_to_noise_db == pytest.approx(10, abs=1)
    assert (found.present == ~train.missing).all()


@pytest.mark.parametrize("seed", range(3))
def test_the_same_for_pulses_of_a_single_sample(seed, make_train):
    """Noise hides every one of them; all together still tell."""
    train = make_train(noise_db=10, missing=0.02, drift_ppm=200, seed=seed, width=1)
    found = decode_pulses(train.channel, 48000, 60.0, 240, start_time=0.25)
    assert root_mean_square(train, found) <= 1.0


def test_missing_pulses_are_named(make_train):
    train = make_train(missing=0.2, drift_ppm=-150, seed=3)
    found = decode_pulses(train.channel, 48000, 60.0, 240, start_time=0.25)
    assert train.missing.sum() > 20
    assert (found.present == ~train.missing).all()
    assert np.abs(found.samples - train.samples).max() <= 1
    assert (found.samples == train.samples)[~train.missing].all()


def test_doubled_pulses_are_counted_and_do_no_harm(make_train):
    train = make_train(doubled=12, drift_ppm=200)
    found = decode_pulses(train.channel, 48000, 60.0, 240)
    assert (found.samples == train.samples).all()
    assert found.extra == 12


@pytest.mark.parametrize("top", [0.1, 0.5])
def test_clipping(top, make_train):
    train = make_train(noise_db=10, drift_ppm=200)
    found = decode_pulses(np.clip(train.channel, -top, top), 48000, 60.0, 240)
    assert root_mean_square(train, found) < 0.05


def test_pulses_through_a_capacitor(make_train):
    """An input of a recorder passes no direct current: a long pulse becomes two peaks."""
    train = make_train(width=400)
    through = sosfilt(butter(1, 200, "highpass", fs=48000, output="sos"), train.channel)
    assert (decode_pulses(through, 48000, 60.0, 240).samples == train.samples).all()


def test_mains_hum_and_crosstalk(make_train):
    train = make_train(drift_ppm=200)
    times = np.arange(len(train.channel)) / 48000
    hum = 0.1 * np.sin(2 * np.pi * 50 * times)
    voice = 0.1 * np.sin(2 * np.pi * 130 * times) * np.sin(2 * np.pi * 3 * times)
    found = decode_pulses(train.channel + hum + voice, 48000, 60.0, 240)
    assert root_mean_square(train, found) < 0.05


@pytest.mark.parametrize("width", [24, 200])
def test_hum_at_the_rate_of_the_frames(make_train, width):
    train = make_train(drift_ppm=200, width=width)
    hum = 0.1 * np.sin(2 * np.pi * 60 * np.arange(len(train.channel)) / 48000 + 1)
    found = decode_pulses(train.channel + hum, 48000, 60.0, 240)
    assert root_mean_square(train, found) < 0.05


def test_pulses_that_are_not_even_are_followed_where_they_are_clear(make_train):
    rng = np.random.default_rng(1)
    train = make_train()
    shifts = rng.integers(-5, 6, 240)
    channel = np.zeros_like(train.channel)
    for sample in train.samples + shifts:
        channel[sample : sample + 24] = 0.5
    found = decode_pulses(channel, 48000, 60.0, 240)
    assert (found.samples == train.samples + shifts).all()
    assert found.residual == pytest.approx(np.std(shifts) / 48000, rel=0.1)


def test_a_pulse_may_begin_with_the_sound_and_another_end_it(make_train):
    train = make_train(start=0.0, tail=0.0)
    found = decode_pulses(train.channel, 48000, 60.0, 240)
    assert (found.samples == train.samples).all()
    assert found.start_time == pytest.approx(0.0, abs=1e-5)


def test_a_short_recording_in_a_long_sound(make_train):
    train = make_train(16000, start=20.0, tail=20.0, drift_ppm=100)
    assert (decode_pulses(train.channel, 16000, 60.0, 240).samples == train.samples).all()


def test_a_long_recording(make_train):
    train = make_train(16000, frames=6000, noise_db=10, drift_ppm=-200)
    found = decode_pulses(train.channel, 16000, 60.0, 6000)
    assert root_mean_square(train, found) < 0.1
    assert found.drift_ppm == pytest.approx(-200, abs=0.5)


def test_without_a_number_of_frames_every_pulse_is_one(make_train):
    train = make_train()
    assert (decode_pulses(train.channel, 48000, 60.0).samples == train.samples).all()


def test_the_same_input_gives_the_same(make_train):
    train = make_train(noise_db=10)
    one, other = (decode_pulses(train.channel, 48000, 60.0, 240) for _ in range(2))
    assert (one.samples == other.samples).all()
    assert (one.start_time, one.frame_rate) == (other.start_time, other.frame_rate)


class TestWhatIsRefused:
    @pytest.mark.parametrize("frames", [230, 239, 244, 260])
    def test_another_number_of_pulses_than_frames(self, frames, make_train):
        with pytest.raises(DataError, match="do not match the number of frames") as caught:
            decode_pulses(make_train(tail=1).channel, 48000, 60.0, frames)
        assert "240 pulses" in str(caught.value)
        assert str(frames) in str(caught.value)

    def test_an_end_that_is_missing_where_nothing_tells_which(self, make_train):
        train = make_train()
        channel = train.channel.copy()
        channel[train.samples[0] :][:24] = 0
        with pytest.raises(DataError, match="the first or the last pulse is missing") as caught:
            decode_pulses(channel, 48000, 60.0, 240)
        assert "0.2500 s" in str(caught.value)
        found = decode_pulses(channel, 48000, 60.0, 240, start_time=0.2533)
        assert found.present.sum() == 239
        assert np.abs(found.samples - train.samples).max() <= 1

    @pytest.mark.parametrize("told", [50.0, 59.0, 100.0, 120.0])
    def test_pulses_of_another_rate(self, told, make_train):
        with pytest.raises(DataError, match="does not hold a pulse for every frame") as caught:
            decode_pulses(make_train().channel, 48000, told)
        assert "60 pulses a second" in str(caught.value)

    def test_every_second_pulse_alone(self, make_train):
        with pytest.raises(DataError, match="30 pulses a second"):
            decode_pulses(make_train(frame_rate=30.0, frames=120).channel, 48000, 60.0)

    def test_silence_noise_and_speech(self, rng):
        times = np.arange(96000) / 48000
        voice = np.sin(2 * np.pi * 121 * times) * (1 + np.sin(2 * np.pi * 4 * times))
        for channel in (np.zeros(96000), rng.normal(size=96000), voice):
            with pytest.raises(DataError, match="does not hold a pulse"):
                decode_pulses(channel, 48000, 60.0)

    def test_a_sound_that_is_shorter_than_the_recording(self, make_train):
        with pytest.raises(DataError, match="too short for the frames"):
            decode_pulses(make_train().channel[:100000], 48000, 60.0, 240)

    def test_what_is_no_channel(self):
        for channel in (np.zeros((10, 2)), np.full(1000, np.nan)):
            with pytest.raises(DataError, match="cannot be used"):
                decode_pulses(channel, 48000, 60.0)
        with pytest.raises(DataError, match="four samples a frame"):
            decode_pulses(np.zeros(1000), 100.0, 60.0)


class TestNumbers:
    """What a train says of itself, by formulas."""

    def test_signal_to_noise_is_height_over_deviation(self, make_train):
        for decibels in (10, 30):
            train = make_train(noise_db=decibels, frames=600, rate=16000)
            decoded = decode_pulses(train.channel, 16000, 60.0, 600)
            assert decoded.signal_to_noise_db == pytest.approx(decibels, abs=0.4)
        assert decode_pulses(make_train().channel, 48000, 60.0).signal_to_noise_db == pytest.approx(
            120
        )

    def test_rate_drift_and_start_are_one_line(self, make_train):
        train = make_train(drift_ppm=300)
        decoded = decode_pulses(train.channel, 48000, 60.0, 240)
        slope, start = np.polyfit(np.arange(240), train.samples, 1)
        assert decoded.start_time == pytest.approx(start / 48000, abs=1e-9)
        assert decoded.frame_rate == pytest.approx(48000 / slope, rel=1e-9)
        assert decoded.drift_ppm == pytest.approx(1e6 * (48000 / slope / 60 - 1), abs=1e-4)
        off = train.samples - np.polyval([slope, start], np.arange(240))
        assert decoded.residual == pytest.approx(np.sqrt(np.mean(off**2)) / 48000, rel=1e-6)
        assert decoded.extra == 0

    def test_part_of_a_train(self, make_train):
        train = decode_pulses(
            make_train(missing=0.1, seed=3).channel, 48000, 60.0, 240, start_time=0.25
        )
        part = train.select(3, 10)
        np.testing.assert_array_equal(part.samples, train.samples[3:10])
        np.testing.assert_array_equal(part.present, train.present[3:10])
        np.testing.assert_allclose(part.times, train.times[3:10])
        assert part.frames == 7

    @pytest.mark.parametrize(("decibels", "is_measured"), [(18, False), (22, True)])
    def test_beginnings_are_measured_where_pulses_stand_clear(
        self, decibels, is_measured, make_train
    ):
        """From 20 dB on. Below, every frame is where the even clock has it."""
        train = make_train(noise_db=decibels, frames=600, rate=16000, seed=1)
        decoded = decode_pulses(train.channel, 16000, 60.0, 600)
        assert (decoded.residual is not None) == is_measured
        if not is_measured:
            np.testing.assert_array_equal(decoded.samples, np.rint(decoded.times * 16000))

    @pytest.mark.parametrize(("share", "is_refused"), [(0.35, True), (0.25, False)])
    def test_seven_in_ten_must_have_a_pulse(self, share, is_refused, make_train):
        train = make_train(16000, frames=400)
        channel = train.channel.copy()
        gone = np.arange(1, 399)[np.random.default_rng(0).permutation(398)[: int(share * 400)]]
        for sample in train.samples[gone]:
            channel[sample : sample + 24] = 0
        if is_refused:
            with pytest.raises(DataError, match="does not hold"):
                decode_pulses(channel, 16000, 60.0, 400)
        else:
            decoded = decode_pulses(channel, 16000, 60.0, 400)
            assert (~decoded.present).sum() == len(gone)

    def test_five_pulses_of_seven_are_enough(self, make_train):
        train = make_train(16000, frames=7)
        channel = train.channel.copy()
        for sample in train.samples[[2, 4]]:
            channel[sample : sample + 24] = 0
        decoded = decode_pulses(channel, 16000, 60.0)
        np.testing.assert_array_equal(np.flatnonzero(~decoded.present), [2, 4])
        assert decoded.frames == 7

    def test_seven_pulses_of_ten_are_enough(self, make_train):
        train = make_train(16000, frames=10)
        channel = train.channel.copy()
        for sample in train.samples[[2, 4, 6]]:
            channel[sample : sample + 24] = 0
        decoded = decode_pulses(channel, 16000, 60.0)
        np.testing.assert_array_equal(np.flatnonzero(~decoded.present), [2, 4, 6])

    def test_three_pulses_are_the_least(self, make_train):
        with pytest.raises(DataError, match="does not hold"):
            decode_pulses(make_train(frames=2).channel, 48000, 60.0)
        assert decode_pulses(make_train(frames=3).channel, 48000, 60.0).frames == 3

    def test_as_many_extra_pulses_as_frames_are_another_rate(self, make_train):
        train = make_train(16000, doubled=168, frames=240, width=8)
        assert decode_pulses(train.channel, 16000, 60.0, 240).extra == 168
        train = make_train(16000, doubled=180, frames=240, width=8)
        with pytest.raises(DataError, match="does not hold"):
            decode_pulses(train.channel, 16000, 60.0, 240)

    def test_noise_hides_extra_pulses(self, make_train):
        """Below 6 deviations of a pulse's sum nothing is counted."""
        train = make_train(noise_db=10, width=1, rate=16000, frames=600)
        assert decode_pulses(train.channel, 16000, 60.0, 600, start_time=0.25).extra is None
        # 10 dB are 3.2 deviations: times the root of 3 it is below 6, of 5 above.
        for width, is_counted in ((3, False), (5, True)):
            train = make_train(noise_db=10, width=width, rate=16000, frames=600)
            decoded = decode_pulses(train.channel, 16000, 60.0, 600, start_time=0.25)
            assert (decoded.extra is not None) == is_counted

    @pytest.mark.parametrize(("drift", "is_refused"), [(1900, False), (2600, True)])
    def test_clocks_differ_by_two_thousandths_at_most(self, drift, is_refused, make_train):
        train = make_train(16000, frames=600, drift_ppm=drift)
        if is_refused:
            with pytest.raises(DataError):
                decode_pulses(train.channel, 16000, 60.0, 600)
            wider = decode_pulses(train.channel, 16000, 60.0, 600, max_drift=4e-3)
            assert (wider.samples == train.samples).all()
        else:
            assert (decode_pulses(train.channel, 16000, 60.0, 600).samples == train.samples).all()

    @pytest.mark.parametrize(("frames", "is_refused"), [(60, False), (61, False), (62, True)])
    def test_the_sound_must_be_as_long_as_the_recording(self, frames, is_refused):
        """A second of sound holds the first of 61 frames at 60 Hz and the beginning of the last."""
        problem = "too short" if is_refused else "does not hold"
        with pytest.raises(DataError, match=problem) as caught:
            decode_pulses(np.zeros(6000), 6000, 60.0, frames)
        if is_refused:
            assert "found 1.000 s of sound, expected 62 frames, 1.033 s" in str(caught.value)

    @pytest.mark.parametrize(
        ("rate", "frame_rate"), [(239.0, 60.0), (48000, 0.0), (48000, np.inf), (48000, -60.0)]
    )
    def test_rates_that_are_out_of_range(self, rate, frame_rate):
        with pytest.raises(DataError, match="four samples a frame"):
            decode_pulses(np.zeros(1000), rate, frame_rate)

    def test_four_samples_a_frame_are_enough(self):
        channel = np.zeros(800)
        channel[100:700:4] = 1.0
        decoded = decode_pulses(channel, 240.0, 60.0)
        np.testing.assert_array_equal(decoded.samples, np.arange(100, 700, 4))


@pytest.mark.parametrize(("count", "rate", "frame_rate"), [(20000, 16000, 25), (1000, 44100, 250)])
def test_a_single_pulse_is_no_train(count, rate, frame_rate):
    channel = np.zeros(count)
    channel[count // 2] = 1.0
    with pytest.raises(DataError, match="pulses"):
        decode_pulses(channel, rate, frame_rate)
