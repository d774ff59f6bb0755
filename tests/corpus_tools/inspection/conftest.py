"""The sample recording with what belongs to it, gathered once."""

import shutil

import pytest

import mocap_fit as mf
from corpus_tools.inspection.gather import gather


@pytest.fixture(scope="session")
def recording(tmp_path_factory):
    folder = tmp_path_factory.mktemp("takes")
    for name in ("rest", "take_01", "take_01.TextGrid", "take_01.wav"):
        shutil.copy(mf.load_sample(name), folder)
    return folder / "take_01.tsv"


@pytest.fixture(scope="session")
def material(recording):
    return gather(recording)
