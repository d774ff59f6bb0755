"""The recordings that are shipped for examples: as their script writes them, small, and usable."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest

import mocap_fit as mf
from mocap_fit.errors import ConfigurationError

NAMES = ("rest", "take_01", "take_01.TextGrid", "take_01.wav")
SCRIPT = Path(__file__).parents[2] / "fixtures" / "make_samples.py"


def test_the_script_writes_the_same_bytes(tmp_path: Path) -> None:
    specification = importlib.util.spec_from_file_location("make_samples", SCRIPT)
    assert specification is not None
    assert specification.loader is not None
    script = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(script)
    script.make(tmp_path)
    shipped = {path.name: path.read_bytes() for path in script.FOLDER.iterdir()}
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == shipped
    assert sum(map(len, shipped.values())) < 300_000
    assert {mf.load_sample(name).name for name in NAMES} == shipped.keys()


def test_they_are_one_take_of_one_speaker_on_one_clock() -> None:
    from mocap_fit.sound import read_sound

    rest, take = (mf.read_tracks(mf.load_sample(name)) for name in NAMES[:2])
    phones = mf.read_phones(mf.load_sample("take_01.TextGrid"), phone_set="sv-sta")
    sound = read_sound(mf.load_sample("take_01.wav"))
    layout = mf.load_layout("face30-head5")
    assert rest.names == take.names == tuple(marker.name for marker in layout.markers)
    assert rest.rate == take.rate == 60.0
    assert phones[-1].end == pytest.approx(sound.duration)
    assert take.duration == pytest.approx(sound.duration, abs=0.02)
    # The closure of the last word's p is silent beside the vowel before it.
    levels = {}
    for segment in phones:
        inside = slice(int(segment.start * sound.rate), int(segment.end * sound.rate))
        levels[segment.phone] = float(np.sqrt(np.mean(sound.samples[inside] ** 2)))
    assert levels["P"] < 0.25 * levels["Ä"]


def test_another_name_lists_them() -> None:
    with pytest.raises(ConfigurationError, match=r"rest, take_01, take_01\.TextGrid, take_01\.wav"):
        mf.load_sample("take_02")
