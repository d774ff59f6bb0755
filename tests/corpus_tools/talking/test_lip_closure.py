"""The lips close on p, b and m, in every language, whoever speaks."""

import pytest

from corpus_tools.talking import speak_models
from corpus_tools.talking.prepare_voices import prepare_voices

LEARNED = ["cart", "cohen-massaro", "ohman"]


@pytest.mark.slow
@pytest.mark.parametrize("language", ["cs", "en", "sv"])
def test_lips_close_over_the_test_sentences_of_each_language(language):
    """A gap under 10 % of the open vowels'; `mocap-fit speak --prepare --check` does it for all."""
    rows = prepare_voices([language], LEARNED, check=True, utterances=140).to_dict()["models"]
    closed = {row["model"]: row["bilabials_closed"] for row in rows}
    assert closed.keys() == {*LEARNED, "rule-based"}
    assert closed["rule-based"] == 1.0
    assert closed["cart"] == 1.0
    assert min(closed.values()) >= 0.9


def test_there_are_sentences_of_three_languages():
    assert set(speak_models.list_languages()) >= {"cs", "en", "sv"}
