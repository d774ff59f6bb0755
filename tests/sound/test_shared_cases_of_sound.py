"""The small inputs of /work/shared/cases that are sound, each with what its README says."""

import time
from pathlib import Path

import numpy as np
import pytest

from corpus_tools.cli import app as cli
from mocap_fit.errors import FileFormatError
from mocap_fit.sound import read_sound

pytestmark = pytest.mark.real_data


@pytest.fixture
def cases(data_folder) -> Path:
    folder = data_folder.parent / "cases"
    if not folder.is_dir():
        pytest.skip(f"no cases in {folder}")
    return folder


def test_a_riff_size_of_0(cases, tmp_path, capsys):
    sound = read_sound(cases / "riff_size_0.wav")
    assert (len(sound), sound.rate, sound.encoding) == (1600, 16000, "PCM_16")
    assert not sound.samples.any()
    assert cli.main(["align", str(cases / "riff_size_0.wav"), "--out", str(tmp_path)]) == 1
    assert "the sound is silent" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_8_bits(cases, capsys):
    sound = read_sound(cases / "tone_8_bit.wav")
    assert (len(sound), sound.rate, sound.encoding) == (1600, 16000, "PCM_U8")
    raw = np.frombuffer((cases / "tone_8_bit.wav").read_bytes()[44:], np.uint8)
    np.testing.assert_array_equal(sound.samples[:, 0], (raw - 128.0) / 128)
    assert cli.main(["info", str(cases / "tone_8_bit.wav")]) == 0
    assert "PCM_U8" in capsys.readouterr().out


def test_a_claim_of_3e9_samples(cases):
    begun = time.process_time()
    with pytest.raises(FileFormatError, match="claims to be larger"):
        read_sound(cases / "hard" / "claims.flac")
    assert time.process_time() - begun < 2
