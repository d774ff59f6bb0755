"""Sound in memory."""

import numpy as np
import pytest

from mocap_fit.errors import DataError
from mocap_fit.sound import Sound


@pytest.fixture
def stereo():
    times = np.arange(8000) / 16000
    return Sound(np.stack([np.sin(2 * np.pi * 440 * times), 0.1 * (times > 0.25)], axis=1), 16000)


class TestSound:
    def test_samples_cannot_be_changed_and_are_a_copy(self):
        samples = np.zeros(3)
        sound = Sound(samples, 8000)
        samples[0] = 1.0
        assert sound.samples[0, 0] == 0
        with pytest.raises(ValueError, match="read-only"):
            sound.samples[0] = 1.0
        assert repr(sound) == "Sound('', 1 channel, 0.00 s at 8000 Hz)"

    def test_channels_are_counted_from_one(self, stereo):
        assert (stereo.channels, len(stereo), stereo.duration) == (2, 8000, 0.5)
        np.testing.assert_array_equal(stereo.get_channel(2), stereo.samples[:, 1])
        np.testing.assert_array_equal(stereo.drop_channel(2).samples[:, 0], stereo.get_channel(1))
        assert stereo.to_mono().channels == 1
        for number in (0, 3):
            with pytest.raises(DataError, match="from 1 to 2"):
                stereo.get_channel(number)
        with pytest.raises(DataError, match="no channel but"):
            stereo.to_mono().drop_channel(1)

    @pytest.mark.parametrize(
        ("samples", "rate", "problem"),
        [
            (np.zeros((2, 2, 2)), 16000, "wrong shape"),
            (np.zeros((5, 0)), 16000, "wrong shape"),
            (["a"], 16000, "not numbers"),
            ([0.0, np.inf], 16000, "sample 1"),
            ([0.0], 0, "sampling rate"),
            ([0.0], np.nan, "sampling rate"),
        ],
    )
    def test_impossible_ones_are_refused(self, samples, rate, problem):
        with pytest.raises(DataError, match=problem):
            Sound(samples, rate)


def test_name_and_encoding_are_given_by_name():
    for positional in (("take",), ("take", "FLOAT")):
        with pytest.raises(TypeError, match="positional"):
            Sound(np.zeros(3), 8000, *positional)
    sound = Sound(np.zeros(3), 8000)
    assert (sound.name, sound.encoding) == ("", "PCM_16")
