"""A small corpus in memory, and every control model that is installed, trained on it."""

import sys
from pathlib import Path

import pytest
from control_cases import SENTENCES, corpus_of, made, moved, spoken

from mocap_fit import control
from mocap_fit.corpus import Corpus, Utterance
from mocap_fit.phones import PhoneSequence

# The distribution of a lab that has a control model of its own, installed as pip would.
sys.path.insert(0, str(Path(__file__).parent / "plug_in"))


@pytest.fixture(scope="session")
def small_corpus() -> Corpus:
    return corpus_of(SENTENCES[:6])


@pytest.fixture(scope="session")
def small_validation() -> Corpus:
    utterances = [
        Utterance.from_tracks(moved(phones), phones)
        for phones in (spoken(s, 90 + k) for k, s in enumerate(SENTENCES[6:]))
    ]
    return Corpus.from_utterances(utterances, "sv-sta")


@pytest.fixture(scope="session")
def new_phones() -> PhoneSequence:
    """A sentence that is not in the corpus, of phones that all are."""
    return spoken("sil B 'A: L I: S 'A N T A R 'O: M A sil", 200)


@pytest.fixture(scope="session")
def trained(small_corpus):
    """A function that gives a trained model by name; it is trained once."""
    models: dict[str, control.ControlModel] = {}

    def get(name: str) -> control.ControlModel:
        if name not in models:
            models[name] = made(name).fit(small_corpus)
        return models[name]

    return get
