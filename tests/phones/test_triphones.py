"""Triphones against a count one by one, and the selection against a search of all sentences."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from mocap_fit.phones.triphones import count_triphones, cover_triphones

sentences_of_phones = st.lists(
    st.lists(st.integers(0, 4), max_size=12).map(lambda s: np.array(s, dtype=np.int32)),
    min_size=1,
    max_size=12,
)


def triphones_of(sentence) -> list[tuple[int, ...]]:
    phones = sentence.tolist()
    return list(zip(phones, phones[1:], phones[2:], strict=False))


@given(sentences_of_phones)
def test_the_table_has_each_sentences_triphones(sentences):
    table = count_triphones(sentences, 5)
    every = [t for s in sentences for t in triphones_of(s)]
    kinds = sorted(set(every))
    assert table.sentences == len(sentences)
    assert table.kinds == len(kinds)
    assert table.occurrences.tolist() == [every.count(kind) for kind in kinds]
    for i, sentence in enumerate(sentences):
        assert [kinds[k] for k in table.get_triphones(i)] == sorted(set(triphones_of(sentence)))


@given(sentences_of_phones, st.integers(1, 12))
def test_lazy_updates_take_what_counting_everything_again_takes(sentences, count):
    covered: set[tuple[int, ...]] = set()
    taken, reached = [], []
    for _ in range(count):
        gains = [len(set(triphones_of(s)) - covered) for s in sentences]
        if not max(gains):
            break
        taken.append(int(np.argmax(gains)))
        covered |= set(triphones_of(sentences[taken[-1]]))
        reached.append(len(covered))
    selection = cover_triphones(count_triphones(sentences, 5), count)
    assert selection.sentences.tolist() == taken
    assert selection.covered.tolist() == reached
    every = [t for s in sentences for t in triphones_of(s)]
    if taken:
        assert selection.occurrences[-1] == sum(t in covered for t in every)


def test_batches_make_no_difference(monkeypatch, rng):
    sentences = [rng.integers(0, 6, rng.integers(0, 9)).astype(np.int32) for _ in range(50)]
    whole = count_triphones(sentences, 6)
    monkeypatch.setattr("mocap_fit.phones.triphones._BATCH", 7)
    parts = count_triphones(iter(sentences), 6)
    for name in ("starts", "triphones", "occurrences"):
        np.testing.assert_array_equal(getattr(whole, name), getattr(parts, name))


def test_it_stops_where_no_triphone_is_left_and_says_each_step():
    sentences = [np.array([0, 1, 2, 3], np.int32), np.array([0, 1, 2], np.int32)]
    steps = []
    selection = cover_triphones(count_triphones(sentences, 4), 5, lambda: steps.append(1))
    assert selection.sentences.tolist() == [0]
    assert len(steps) == 1
    # (0, 1, 2) occurs in both sentences, (1, 2, 3) in one.
    assert selection.occurrences.tolist() == [3]
