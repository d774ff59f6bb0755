"""Triphones of many sentences, and the sentences that cover the most of them.

Beskow section 3 selects sentences of a large text that cover its triphones. The selection here is
greedy: always the sentence with the most triphones that are not covered yet, which is within
1 - 1/e of the optimum. Gains only decrease, so an earlier gain is an upper bound, and only
sentences at the top of a heap are counted again (lazy evaluation; Minoux 1978).
"""

from __future__ import annotations

import heapq
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from itertools import islice

import numpy as np
from numpy.typing import NDArray

# Sentences that are counted at once: enough for numpy, little for the memory.
_BATCH = 20_000

Codes = NDArray[np.int32]


@dataclass(frozen=True)
class TriphoneTable:
    """The different triphones of each sentence.

    Parameters
    ----------
    starts
        Start of the part of each sentence in `triphones`, ``(sentences + 1,)``.
    triphones
        Different triphones of one sentence after the other, ``(entries,)``: numbers from 0.
    occurrences
        Occurrences of each triphone in all sentences, ``(kinds,)``.
    """

    starts: NDArray[np.int64]
    triphones: NDArray[np.int32]
    occurrences: NDArray[np.int64]

    @property
    def sentences(self) -> int:
        """Number of sentences."""
        return self.starts.size - 1

    @property
    def kinds(self) -> int:
        """Number of different triphones."""
        return self.occurrences.size

    def get_triphones(self, sentence: int) -> NDArray[np.int32]:
        """Return the different triphones of a sentence.

        Parameters
        ----------
        sentence
            Index of the sentence.

        Returns
        -------
        ndarray
            Numbers of triphones, ``(triphones,)``, in increasing order.
        """
        return self.triphones[self.starts[sentence] : self.starts[sentence + 1]]


@dataclass(frozen=True)
class Selection:
    """Sentences in the order in which they were selected.

    Parameters
    ----------
    sentences
        Indices of the sentences, ``(selected,)``.
    covered
        Different triphones that are covered by each sentence and those before, ``(selected,)``.
    occurrences
        Occurrences of the covered triphones in all sentences, ``(selected,)``.
    """

    sentences: NDArray[np.int64]
    covered: NDArray[np.int64]
    occurrences: NDArray[np.int64]


def count_triphones(sentences: Iterable[Codes], phones: int) -> TriphoneTable:
    """Count the triphones of sentences.

    Parameters
    ----------
    sentences
        Phones of each sentence as numbers from 0, below `phones`, ``(segments,)`` each; with the
        silence at both ends where triphones with silence count.
    phones
        Number of different phones.

    Returns
    -------
    TriphoneTable
        The different triphones of each sentence, and how often each occurs.
    """
    lengths: list[NDArray[np.int64]] = []
    codes: list[NDArray[np.int64]] = []
    kinds = np.empty(0, dtype=np.int64)
    counts = np.empty(0, dtype=np.int64)
    remaining = iter(sentences)
    while batch := list(islice(remaining, _BATCH)):
        sizes = np.array([sentence.size for sentence in batch])
        every = np.concatenate(batch).astype(np.int64)
        owner = np.repeat(np.arange(len(batch)), sizes)
        three = (every[:-2] * phones + every[1:-1]) * phones + every[2:]
        inside = owner[:-2] == owner[2:]
        unique, number = np.unique(three[inside], return_inverse=True)
        # One number for a sentence and its triphone, so that each pair counts once.
        pairs = np.sort(owner[:-2][inside] * max(unique.size, 1) + number)
        pairs = pairs[np.diff(pairs, prepend=-1) > 0]
        lengths.append(np.bincount(pairs // max(unique.size, 1), minlength=len(batch)))
        codes.append(unique[pairs % max(unique.size, 1)])
        merged = np.union1d(kinds, unique)
        total = np.zeros(merged.size, dtype=np.int64)
        total[np.searchsorted(merged, kinds)] += counts
        total[np.searchsorted(merged, unique)] += np.bincount(number, minlength=unique.size)
        kinds, counts = merged, total
    numbered = [np.searchsorted(kinds, part).astype(np.int32) for part in codes]
    starts = np.cumsum(np.concatenate([np.zeros(1, dtype=np.int64), *lengths]))
    triphones = np.concatenate(numbered) if numbered else np.empty(0, dtype=np.int32)
    return TriphoneTable(starts, triphones, counts)


def cover_triphones(
    table: TriphoneTable, count: int, progress: Callable[[], object] = lambda: None
) -> Selection:
    """Select the sentences that cover the most triphones, one by one.

    Parameters
    ----------
    table
        Triphones of all sentences.
    count
        Number of sentences to select; fewer are selected where no triphone is left.
    progress
        Called after each sentence.

    Returns
    -------
    Selection
        The sentences; of several with the same gain, the first is selected.
    """
    covered = np.zeros(table.kinds, dtype=bool)
    heap = [(-gain, i) for i, gain in enumerate(np.diff(table.starts).tolist()) if gain]
    heapq.heapify(heap)
    selected: list[int] = []
    gains: list[int] = []
    while heap and len(selected) < count:
        _, sentence = heap[0]
        triphones = table.get_triphones(sentence)
        gain = triphones.size - int(np.count_nonzero(covered[triphones]))
        if not gain:
            heapq.heappop(heap)
            continue
        # Back into the heap with the present gain; it is the best if it is still on top.
        heapq.heapreplace(heap, (-gain, sentence))
        if heap[0] != (-gain, sentence):
            continue
        heapq.heappop(heap)
        covered[triphones] = True
        selected.append(sentence)
        gains.append(gain)
        progress()
    occurrences = np.zeros(len(selected), dtype=np.int64)
    new = np.ones(table.kinds, dtype=bool)
    for rank, sentence in enumerate(selected):
        triphones = table.get_triphones(sentence)
        occurrences[rank] = table.occurrences[triphones[new[triphones]]].sum()
        new[triphones] = False
    sentences, covered_kinds = np.array([selected, gains], dtype=np.int64)
    return Selection(sentences, np.cumsum(covered_kinds), np.cumsum(occurrences))
