"""A clean corpus, simulated and converted once; each test spoils a copy of it."""

import shutil
from pathlib import Path

import pytest

from corpus_tools.cli import app as cli
from mocap_fit.utterance import read_utterances, write_utterances


@pytest.fixture(scope="session")
def recorded(tmp_path_factory) -> Path:
    """What a lab has: recordings, labels, sound; not to be changed."""
    folder = tmp_path_factory.mktemp("recorded") / "session"
    assert cli.main(["simulate", str(folder), "--utterances", "4", "--seed", "1"]) == 0
    return folder


@pytest.fixture(scope="session")
def clean(recorded, tmp_path_factory) -> Path:
    """The corpus of it; not to be changed."""
    corpus = tmp_path_factory.mktemp("converted") / "corpus"
    assert cli.main(["convert", str(recorded / "manifest.toml"), "--out", str(corpus)]) == 0
    return corpus


@pytest.fixture
def corpus(clean, tmp_path) -> Path:
    """A copy of the corpus, to be spoilt."""
    return Path(shutil.copytree(clean, tmp_path / "corpus"))


@pytest.fixture
def small(corpus) -> Path:
    """Two utterances of the corpus, to be spoilt where the others do not matter."""
    rows = [row for row in read_utterances(corpus) if row.id in ("sim002", "sim004")]
    write_utterances(rows, corpus)
    for path in corpus.rglob("sim00[13].*"):
        path.unlink()
    return corpus
