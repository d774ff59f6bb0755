"""Small corpora with and without a face."""

import pytest
from remembered_model import spoken

from mocap_fit.corpus import Corpus
from mocap_fit.face import load_face


@pytest.fixture(scope="session")
def face_corpus() -> Corpus:
    names = load_face().parameter_names
    return Corpus.from_utterances([spoken(f"u{i}", i, names) for i in range(8)], "en-arpabet")


@pytest.fixture(scope="session")
def small_corpus() -> Corpus:
    return Corpus.from_utterances([spoken(f"u{i}", i, ("x", "y")) for i in range(8)], "en-arpabet")
