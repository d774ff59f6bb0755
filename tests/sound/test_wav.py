"""Sound in memory, and wav files."""

import time

import numpy as np
import pytest

from mocap_fit.errors import DataError, FileFormatError
from mocap_fit.sound import Sound, read_sound, write_sound


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


class TestFiles:
    @pytest.mark.parametrize(
        ("encoding", "error"), [("PCM_16", 3.1e-5), ("PCM_24", 1.2e-7), ("DOUBLE", 0)]
    )
    def test_a_round_trip(self, encoding, error, stereo, tmp_path):
        write_sound(stereo, tmp_path / "a.wav", encoding=encoding)
        found = read_sound(tmp_path / "a.wav")
        assert (found.name, found.rate, found.samples.shape) == ("a", 16000, (8000, 2))
        assert np.abs(found.samples - stereo.samples).max() <= error
        assert found.encoding == encoding
        assert [path.name for path in tmp_path.iterdir()] == ["a.wav"]

    def test_what_is_too_loud_is_clipped_and_does_not_turn_over(self, tmp_path):
        write_sound(Sound([2.0, -2.0, 1.0], 8000), tmp_path / "a.wav")
        np.testing.assert_allclose(
            read_sound(tmp_path / "a.wav").get_channel(1), [1, -1, 1], atol=1e-4
        )

    @pytest.mark.parametrize("encoding", ["PCM_16", "FLOAT", "DOUBLE"])
    def test_the_same_sound_gives_the_same_bytes(self, encoding, stereo, tmp_path, monkeypatch):
        """libsndfile notes the time in files of floats."""
        write_sound(stereo, tmp_path / "a.wav", encoding=encoding)
        if encoding != "PCM_16":
            time.sleep(1.1)
        write_sound(stereo, tmp_path / "b.wav", encoding=encoding)
        assert (tmp_path / "a.wav").read_bytes() == (tmp_path / "b.wav").read_bytes()

    def test_bad_files(self, tmp_path, stereo):
        write_sound(stereo, tmp_path / "good.wav")
        whole = (tmp_path / "good.wav").read_bytes()
        bad = {"empty": b"", "text": b"not sound at all " * 20, "head": whole[:20]}
        for name, content in bad.items():
            path = tmp_path / f"{name}.wav"
            path.write_bytes(content)
            with pytest.raises(FileFormatError, match="sound file") as caught:
                read_sound(path)
            assert str(path) in str(caught.value)
        with pytest.raises(FileNotFoundError, match="no such file"):
            read_sound(tmp_path / "none.wav")
        with pytest.raises(FileFormatError, match="cannot be read"):
            read_sound(tmp_path)
        write_sound(Sound(np.array([[0.0, np.pi]]), 8000), tmp_path / "f.wav", encoding="DOUBLE")
        content = (tmp_path / "f.wav").read_bytes()
        assert content.count(np.float64(np.pi).tobytes()) == 1
        nan = content.replace(np.float64(np.pi).tobytes(), np.float64(np.nan).tobytes())
        (tmp_path / "f.wav").write_bytes(nan)
        with pytest.raises(DataError, match="not numbers") as caught:
            read_sound(tmp_path / "f.wav")
        assert "f.wav" in str(caught.value)

    def test_a_sound_without_samples(self, tmp_path):
        write_sound(Sound(np.zeros((0, 1)), 8000), tmp_path / "a.wav")
        with pytest.raises(FileFormatError, match="no sample"):
            read_sound(tmp_path / "a.wav")

    def test_what_cannot_be_written(self, stereo, tmp_path):
        for rate in (16000.5, 16000 * (1 + 1.5e-9), 16000 * (1 - 1.5e-9)):
            with pytest.raises(DataError, match="integer"):
                write_sound(stereo.replace(rate=rate), tmp_path / "a.wav")
        with pytest.raises(FileFormatError, match="cannot be written"):
            write_sound(stereo, tmp_path / "none" / "a.wav")
        assert not list(tmp_path.iterdir())
