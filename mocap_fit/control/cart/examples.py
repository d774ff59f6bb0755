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
    look_up_resistance,
    read_energies,
    sample_targets,
)
from mocap_fit.corpus import Corpus
from mocap_fit.phones import PhoneSequence, PhoneSet
from mocap_fit.tracks import FloatArray

# TrainingSegments that a phone needs for an estimate of its variance.
_MIN_EXAMPLES = 10


@dataclass(frozen=True, eq=False)
class TrainingSegments:
    """The segments of a corpus.

    Parameters
    ----------
    symbols
        The phone that names each segment's trees, ``(segments,)``.
    columns
        What `ContextReader.read_columns` returns: of each attribute ``(segments,)``, or
        ``(segments, parameters)``; levels, seconds, dB, or no unit.
    energies
        ``(segments,)``, dB; NaN where unknown.
    targets
        ``(segments, parameters)``, in the unit of each parameter; NaN where missing.
    """

    symbols: NDArray[np.str_]
    columns: list[NDArray[Any]]
    energies: FloatArray
    targets: FloatArray


def read_corpus(corpus: Corpus) -> tuple[list[PhoneSequence], list[FloatArray]]:
    """Read the phones of all utterances and sample their targets.

    Parameters
    ----------
    corpus
        Utterances without phones are left out.

    Returns
    -------
    phones
        One sequence an utterance.
    targets
        ``(segments, parameters)`` each, in the unit of each parameter; NaN where missing.
    """
    phones, targets = [], []
    for utterance in corpus:
        sequence = utterance.read_phones()
        if len(sequence):
            phones.append(sequence)
            targets.append(sample_targets(utterance.read_tracks(), sequence))
    return phones, targets


def make_alphabet(phones: Sequence[PhoneSequence], phone_set: PhoneSet) -> Alphabet:
    """Make the alphabet of the phones that utterances have, counted without stress.

    Parameters
    ----------
    phones
        One sequence an utterance.
    phone_set
        The set that they are from.

    Returns
    -------
    Alphabet
        The phones as levels.
    """
    labels = Counter(label for sequence in phones for label in sequence.phones)
    counts: Counter[str] = Counter()
    for label, times in labels.items():
        counts[phone_set.get_phone(label).symbol] += times
    return Alphabet.from_counts(counts, phone_set)


def find_resistant(
    alphabet: Alphabet,
    parameter_names: Sequence[str],
    by_phone_set: NDArray[np.bool_],
    phones: Sequence[PhoneSequence],
    targets: Sequence[FloatArray],
) -> NDArray[np.bool_]:
    """Find which phones resist coarticulation in which parameter.

    Where the phone set does not say it, the corpus does: a phone resists whose targets vary
    little, with less than half of the variance that targets have about the means of their phones.

    Parameters
    ----------
    alphabet
        The phones as levels.
    parameter_names
        Names of the parameters.
    by_phone_set
        In which parameters the phone set says it, ``(parameters,)``.
    phones
        One sequence an utterance.
    targets
        ``(segments, parameters)`` each, in the unit of each parameter; NaN where missing.

    Returns
    -------
    ndarray
        ``(levels, parameters)``, true where the phone resists.
    """
    phone_set = alphabet.phone_set
    resists = np.zeros((alphabet.levels, len(parameter_names)), dtype=np.bool_)
    for row, symbol in enumerate(alphabet.symbols, start=1):
        resists[row] = look_up_resistance(phone_set, symbol, parameter_names) & by_phone_set
    learned = np.flatnonzero(~by_phone_set)
    if not len(learned):
        return resists
    labels = [label for sequence in phones for label in sequence.phones]
    symbol_of = {label: phone_set.get_phone(label).symbol for label in set(labels)}
    level_of = {label: alphabet.get_level(symbol) for label, symbol in symbol_of.items()}
    levels = np.array([level_of[label] for label in labels])
    silent = alphabet.get_level(phone_set.silence)
    for p in learned:
        values = np.concatenate(targets)[:, p]
        known = np.isfinite(values) & (levels != silent)
        level, value = levels[known], values[known]
        count = np.bincount(level, minlength=alphabet.levels)
        mean = np.bincount(level, value, alphabet.levels) / np.maximum(count, 1)
        squares = np.bincount(level, (value - mean[level]) ** 2, alphabet.levels)
        # A single example has no variance.
        degrees = np.maximum(count - 1, 0)
        pooled = squares.sum() / max(int(degrees.sum()), 1)
        variance = squares / np.maximum(degrees, 1)
        resists[:, p] = (count >= _MIN_EXAMPLES) & (variance < 0.5 * pooled)
    resists[1 + len(alphabet.symbols) :] = False
    return resists


def collect(
    phones: Sequence[PhoneSequence],
    targets: Sequence[FloatArray],
    reader: ContextReader,
    by_stress: bool,
) -> TrainingSegments:
    """Collect all segments with their attributes and targets.

    Parameters
    ----------
    phones
        One sequence an utterance.
    targets
        ``(segments, parameters)`` each, in the unit of each parameter; NaN where missing.
    reader
        Reads the attributes.
    by_stress
        Whether a phone with stress is another phone.

    Returns
    -------
    TrainingSegments
        In the order of the utterances.
    """
    phone_set = reader.alphabet.phone_set
    kinds = {(s.phone, s.stress): s for sequence in phones for s in sequence}
    symbol_of = {key: phone_set.get_symbol(segment, by_stress) for key, segment in kinds.items()}
    symbols = [symbol_of[s.phone, s.stress] for sequence in phones for s in sequence]
    return TrainingSegments(
        np.array(symbols, dtype=np.str_),
        reader.read_columns(*phones),
        read_energies(segment for sequence in phones for segment in sequence),
        np.concatenate(targets),
    )
