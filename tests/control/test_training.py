"""What trained models share: symbols, frames near speech, means, errors, checks of arrays."""

import numpy as np
import pytest
from control_cases import corpus_of, spoken

from mocap_fit.control.symbols import Symbols, check_phone_set, plan_symbols
from mocap_fit.control.training import (
    check_arrays,
    compute_means,
    compute_phone_means,
    compute_rmse,
    load_utterances,
)
from mocap_fit.corpus import Corpus, Utterance
from mocap_fit.errors import DataError
from mocap_fit.phones import PhoneSegment, PhoneSequence, load_phone_set
from mocap_fit.tracks import ParameterTracks

NAN = np.nan


def utterance_of(segments, values, rate=10.0):
    phones = PhoneSequence(
        tuple(PhoneSegment(*each) for each in segments), phone_set="sv-sta", name="u"
    )
    tracks = ParameterTracks(("x",), rate, np.array(values, dtype=float)[:, None], name="u")
    return Utterance.from_tracks(tracks, phones)


def test_errors_are_the_root_of_the_mean_square_where_both_are_known():
    pairs = [
        (np.array([1.0, 2.0, NAN]), np.array([4.0, NAN, 5.0])),
        (np.array([0.0]), np.array([1.0])),
    ]
    assert compute_rmse(pairs) == pytest.approx(np.sqrt((9 + 1) / 2))
    assert compute_rmse([]) == 0.0
    assert compute_rmse([(np.array([NAN]), np.array([1.0]))]) == 0.0


def test_means_are_over_what_is_known():
    values = np.array([[1.0, NAN, NAN], [3.0, 5.0, NAN]])
    np.testing.assert_array_equal(compute_means(values), [2.0, 5.0, 0.0])


def test_phone_means_are_over_the_frames_of_the_phone():
    # Frames at 0, 0.1, ... 0.9 s; what is not labelled counts for no phone.
    segments = [(0.0, 0.3, "S"), (0.3, 0.5, "A:", 1), (0.6, 0.8, "S")]
    values = [1, 2, 3, 10, NAN, 70, 4, 5, 80, 90]
    corpus = Corpus.from_utterances([utterance_of(segments, values)], "sv-sta")
    symbols = Symbols.from_corpus(corpus, True)
    means = compute_phone_means(load_utterances(corpus, symbols), len(symbols))[:, 0]
    assert means[symbols.index("S")] == pytest.approx((1 + 2 + 3 + 4 + 5) / 5)
    assert means[symbols.names.index("'A:")] == pytest.approx(10.0)
    assert means[symbols.names.index("P")] == pytest.approx(np.nanmean(values))


def test_silence_counts_as_far_from_speech_as_a_pause_may_be():
    segments = [(0.0, 1.0, "sil"), (1.0, 1.2, "S"), (1.2, 2.0, "sil"), (2.0, 2.1, "S")]
    corpus = Corpus.from_utterances([utterance_of(segments, np.arange(25.0))], "sv-sta")
    symbols = Symbols.from_corpus(corpus, True)
    (utterance,) = load_utterances(corpus, symbols, 0.25)
    there = np.flatnonzero(np.isfinite(utterance.values[:, 0]))
    # From 0.75 to 1.45 s, and from 1.75 to 2.35 s.
    np.testing.assert_array_equal(there, [8, 9, 10, 11, 12, 13, 14, 18, 19, 20, 21, 22, 23])
    assert utterance.id == "u"
    assert load_utterances(None, symbols) == ()


def test_symbols_of_a_file_must_fit_each_other():
    corpus = corpus_of(["sil S 'A: sil"])
    symbols = Symbols.from_corpus(corpus, True)
    again = Symbols.from_json(corpus.phone_set, True, symbols.to_json())
    assert again.names == symbols.names
    np.testing.assert_array_equal(again.seen, symbols.seen)
    assert again.index("S") == symbols.index("S")
    for wrong in ({"seen": symbols.to_json()["seen"][:-1]}, {"seen": [False] * len(symbols)}):
        with pytest.raises(DataError, match="do not fit"):
            Symbols.from_json(corpus.phone_set, True, symbols.to_json() | wrong)
    phone_set = corpus.phone_set
    np.testing.assert_array_equal(
        symbols.are_vowels, [phone_set.is_vowel(name) for name in symbols.names]
    )


def test_a_phone_of_a_kind_that_was_not_seen_has_the_nearest_of_any():
    symbols = Symbols.from_corpus(corpus_of(["S T"]), True)
    assert symbols.names[symbols.index("A:")] in ("S", "T")
    phones = spoken("S T A:", 1)
    assert list(symbols.indices(phones)) == [symbols.index(s) for s in phones]
    assert symbols.indices(phones).dtype == np.int64


def test_the_symbols_of_an_untrained_model_are_those_of_its_phone_set():
    phone_set, names = plan_symbols("sv-sta", True)
    assert phone_set.name == "sv-sta"
    assert names == load_phone_set("sv-sta").list_symbols(True)
    assert len(plan_symbols("sv-sta", False)[1]) < len(names) == 76
    with pytest.raises(DataError, match="depends on its phone set"):
        plan_symbols("", True)
    corpus = corpus_of(["S"])
    check_phone_set(corpus, "")
    check_phone_set(corpus, "sv-sta")
    with pytest.raises(DataError, match=r"found sv-sta, expected cs-ipa"):
        check_phone_set(corpus, "cs-ipa")


def test_arrays_of_a_file_have_a_shape_and_are_finite():
    check_arrays({"a": np.zeros((2, 3)), "b": np.zeros(0)}, {"a": (2, 3)})
    for arrays, message in (
        ({}, r"'a'.*found none, expected \(2, 3\)"),
        ({"a": np.zeros((3, 2))}, r"'a'.*\(3, 2\)"),
        ({"a": np.full((2, 3), np.inf)}, "not finite"),
        ({"a": np.full((2, 3), NAN)}, "not finite"),
    ):
        with pytest.raises(DataError, match=message):
            check_arrays(arrays, {"a": (2, 3)})
