"""Training on few utterances, or with a validation part of one, is warned of once."""

import warnings

import pytest
from control_cases import SENTENCES, corpus_of, made

from mocap_fit import control
from mocap_fit.control import ControlModel
from mocap_fit.corpus import Corpus
from mocap_fit.errors import MocapFitWarning, SmallCorpusWarning


def list_warnings(model: ControlModel, corpus: Corpus, validation: Corpus | None = None):
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        model.fit(corpus, validation)
    return [each for each in caught if issubclass(each.category, MocapFitWarning)]


@pytest.fixture(scope="module")
def enough() -> Corpus:
    return corpus_of([SENTENCES[i % 8] for i in range(50)])


@pytest.mark.parametrize("name", sorted(set(control.names()) - {"rule-based"}))
def test_few_utterances_are_warned_of_once(name, small_corpus, small_validation):
    (warning,) = list_warnings(made(name), small_corpus, small_validation)
    assert warning.category is SmallCorpusWarning
    assert str(warning.message).startswith("training on 6 utterances: ")
    assert "validation" not in str(warning.message)
    # It shows the caller's line, not ours.
    assert warning.filename == __file__


def test_enough_of_both_is_not_warned_of(enough, small_corpus):
    assert list_warnings(control.create("phone-mean"), enough, small_corpus) == []
    assert list_warnings(control.create("phone-mean"), enough) == []


def test_a_validation_part_of_one_is_warned_of(enough):
    (warning,) = list_warnings(control.create("phone-mean"), enough, corpus_of(SENTENCES[:1]))
    assert "single utterance" in str(warning.message)
    assert "training on" not in str(warning.message)


def test_both_are_one_warning():
    one = corpus_of(SENTENCES[:1])
    (warning,) = list_warnings(control.create("mean"), one, one)
    assert str(warning.message).startswith("training on 1 utterance: ")
    assert "single utterance" in str(warning.message)


def test_a_model_that_does_not_learn_is_silent(small_corpus):
    assert list_warnings(control.create("rule-based"), small_corpus) == []
