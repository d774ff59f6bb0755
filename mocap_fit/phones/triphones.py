"""Triphones of many sentences, and the sentences that cover the most of them.

Beskow section 3 takes sentences from a large text so that they cover its triphones. Here: greedy,
always the sentence with the most triphones that are not covered yet, which comes within 1 - 1/e
of the best that can be done. Gains only ever fall, so an old gain is a bound, and only sentences
at the top of a heap are counted again (lazy updates; Minoux 1978).
"""

from __future__ import annotations

import heapq
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from itertools import islice

import numpy as np
from numpy.typing import NDArray

# Sentences that are counted at once: enough for numpy, little for the memory.
_BATCH = 20_000

Codes = NDArray[np.int32]


@dataclass(frozen=True)
class TriphoneTable:
    """Which triphones each sentence has.

    Parameters
    ----------
    starts
        `(sentences + 1,)`: where each sentence's part of `triphones` starts.
    triphones
        The different triphones of one sentence after the other, as numbers from 0.
    occurrences
        `(kinds,)`: how often each triphone occurs in all sentences.
    """

    starts: NDArray[np.int64]
    triphones: NDArray[np.int32]
    occurrences: NDArray[np.int64]

    @property
    def sentences(self) -> int:
        """How many sentences there are."""
        return self.starts.size - 1

    @property
    def kinds(self) -> int:
        """How many different triphones there are."""
        return self.occurrences.size

    def of(self, sentence: int) -> NDArray[np.int32]:
        """The different triphones of a sentence."""
        return self.triphones[self.starts[sentence] : self.starts[sentence + 1]]


@dataclass(frozen=True)
class Selection:
    """Sentences in the order in which they were taken.

    Parameters
    ----------
    sentences
        `(taken,)`: their positions among all.
    covered
        `(taken,)`: how many kinds of triphones are covered with each and those before.
    occurrences
        `(taken,)`: how often those kinds occur in all sentences.
    """

    sentences: NDArray[np.int64]
    covered: NDArray[np.int64]
    occurrences: NDArray[np.int64]


def triphone_table(sentences: Iterable[Codes], phones: int) -> TriphoneTable:
    """Number the triphones of sentences.

    Parameters
    ----------
    sentences
        Each as numbers of its phones, from 0 and below `phones`; those of the silences at its
        ends included, where they are to count.
    phones
        How many different phones there are.
    """
    lengths: list[NDArray[np.int64]] = []
    codes: list[NDArray[np.int64]] = []
    kinds = np.empty(0, dtype=np.int64)
    counts = np.empty(0, dtype=np.int64)
    for batch in _batches(iter(sentences)):
        sizes = np.array([sentence.size for sentence in batch])
        every = np.concatenate(batch).astype(np.int64)
        owner = np.repeat(np.arange(len(batch)), sizes)
        three = (every[:-2] * phones + every[1:-1]) * phones + every[2:]
        inside = owner[:-2] == owner[2:]
        found, number = np.unique(three[inside], return_inverse=True)
        # One number for a sentence and its triphone, so that each pair counts once.
        pairs = np.sort(owner[:-2][inside] * max(found.size, 1) + number)
        pairs = pairs[np.diff(pairs, prepend=-1) > 0]
        lengths.append(np.bincount(pairs // max(found.size, 1), minlength=len(batch)))
        codes.append(found[pairs % max(found.size, 1)])
        merged = np.union1d(kinds, found)
        total = np.zeros(merged.size, dtype=np.int64)
        total[np.searchsorted(merged, kinds)] += counts
        total[np.searchsorted(merged, found)] += np.bincount(number, minlength=found.size)
        kinds, counts = merged, total
    numbered = [np.searchsorted(kinds, part).astype(np.int32) for part in codes]
    starts = np.cumsum(np.concatenate([np.zeros(1, dtype=np.int64), *lengths]))
    triphones = np.concatenate(numbered) if numbered else np.empty(0, dtype=np.int32)
    return TriphoneTable(starts, triphones, counts)


def select(
    table: TriphoneTable, count: int, told: Callable[[], object] = lambda: None
) -> Selection:
    """Take the sentences that cover the most triphones, one by one.

    Parameters
    ----------
    table
        The triphones of all sentences.
    count
        How many to take; fewer are taken where nothing new is left.
    told
        Called after each one.

    Returns
    -------
    Selection
        Of sentences with the same gain, the first is taken.
    """
    covered = np.zeros(table.kinds, dtype=bool)
    heap = [(-gain, i) for i, gain in enumerate(np.diff(table.starts).tolist()) if gain]
    heapq.heapify(heap)
    taken: list[int] = []
    reached: list[int] = []
    while heap and len(taken) < count:
        _, sentence = heap[0]
        mine = table.of(sentence)
        gain = mine.size - int(np.count_nonzero(covered[mine]))
        if not gain:
            heapq.heappop(heap)
            continue
        # Back into the heap with the gain of now; it is the best if it is still on top.
        heapq.heapreplace(heap, (-gain, sentence))
        if heap[0] != (-gain, sentence):
            continue
        heapq.heappop(heap)
        covered[mine] = True
        taken.append(sentence)
        reached.append(gain)
        told()
    occurring = np.zeros(len(taken), dtype=np.int64)
    new = np.ones(table.kinds, dtype=bool)
    for rank, sentence in enumerate(taken):
        mine = table.of(sentence)
        occurring[rank] = table.occurrences[mine[new[mine]]].sum()
        new[mine] = False
    return Selection(
        np.array(taken, dtype=np.int64),
        np.cumsum(np.array(reached, dtype=np.int64)),
        np.cumsum(occurring),
    )


def _batches(sentences: Iterator[Codes]) -> Iterator[list[Codes]]:
    while batch := list(islice(sentences, _BATCH)):
        yield batch
