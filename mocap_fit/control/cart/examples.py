"""The segments of a corpus as examples: their phones, attributes and targets."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mocap_fit.control.cart.contexts import (
    Alphabet,
    ContextReader,
    energies,
    resistance_of,
    targets,
)
from mocap_fit.corpus import Corpus
from mocap_fit.phones import PhoneSequence, PhoneSet
from mocap_fit.tracks import FloatArray

# Examples a phone has before its variance is believed.
_BELIEVED = 10


@dataclass(frozen=True, eq=False)
class Examples:
    """The segments of a corpus.

    Parameters
    ----------
    symbols
        `(segments,)`: the phones, as trees are named by them.
    columns
        Of each attribute what `ContextReader.columns` gives.
    energies
        `(segments,)`, dB, NaN where unknown.
    targets
        `(segments, parameters)`, NaN where missing.
    """

    symbols: NDArray[np.str_]
    columns: list[NDArray[Any]]
    energies: FloatArray
    targets: FloatArray


def read_corpus(corpus: Corpus) -> tuple[list[PhoneSequence], list[FloatArray]]:
    """The phones of all utterances, and their targets, `(segments, parameters)` each."""
    phones, found = [], []
    for utterance in corpus:
        sequence = utterance.read_phones()
        if len(sequence):
            phones.append(sequence)
            found.append(targets(utterance.read_tracks(), sequence))
    return phones, found


def alphabet_of(phones: Sequence[PhoneSequence], phone_set: PhoneSet) -> Alphabet:
    """The phones that utterances have, counted without stress."""
    labels = Counter(label for sequence in phones for label in sequence.phones)
    counted: Counter[str] = Counter()
    for label, times in labels.items():
        counted[phone_set.get_phone(label).symbol] += times
    return Alphabet.of(counted, phone_set)


def resistance(
    alphabet: Alphabet,
    parameter_names: Sequence[str],
    by_phone_set: NDArray[np.bool_],
    phones: Sequence[PhoneSequence],
    found: Sequence[FloatArray],
) -> NDArray[np.bool_]:
    """Which phones resist coarticulation in which parameter.

    Where the phone set does not say it, the corpus does: a phone resists whose targets vary
    little, with less than half of the variance that targets have about the means of their phones.

    Returns
    -------
    NDArray[np.bool_]
        `(levels, parameters)`.
    """
    phone_set = alphabet.phone_set
    resists = np.zeros((alphabet.levels, len(parameter_names)), dtype=np.bool_)
    for level, symbol in enumerate(alphabet.symbols, start=1):
        resists[level] = resistance_of(phone_set, symbol, parameter_names) & by_phone_set
    learned = np.flatnonzero(~by_phone_set)
    if not len(learned):
        return resists
    labels = [label for sequence in phones for label in sequence.phones]
    level_of = {label: alphabet.level(phone_set.get_phone(label).symbol) for label in set(labels)}
    levels = np.array([level_of[label] for label in labels])
    silent = alphabet.level(phone_set.silence)
    for p in learned:
        values = np.concatenate(found)[:, p]
        known = np.isfinite(values) & (levels != silent)
        own, value = levels[known], values[known]
        count = np.bincount(own, minlength=alphabet.levels)
        mean = np.bincount(own, value, alphabet.levels) / np.maximum(count, 1)
        squares = np.bincount(own, (value - mean[own]) ** 2, alphabet.levels)
        # Of one example nothing is known about how it varies.
        degrees = np.maximum(count - 1, 0)
        pooled = squares.sum() / max(int(degrees.sum()), 1)
        variance = squares / np.maximum(degrees, 1)
        resists[:, p] = (count >= _BELIEVED) & (variance < 0.5 * pooled)
    resists[1 + len(alphabet.symbols) :] = False
    return resists


def collect(
    phones: Sequence[PhoneSequence],
    found: Sequence[FloatArray],
    reader: ContextReader,
    by_stress: bool,
) -> Examples:
    """All segments with their attributes and targets."""
    phone_set = reader.alphabet.phone_set
    kinds = {(s.phone, s.stress): s for sequence in phones for s in sequence}
    symbol_of = {key: phone_set.get_symbol(segment, by_stress) for key, segment in kinds.items()}
    symbols = [symbol_of[s.phone, s.stress] for sequence in phones for s in sequence]
    return Examples(
        np.array(symbols, dtype=np.str_),
        reader.columns(*phones),
        energies(segment for sequence in phones for segment in sequence),
        np.concatenate(found),
    )
