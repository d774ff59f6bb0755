"""What trained models share: the frames of a corpus, means of phones, errors, checks of arrays."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from mocap_fit.control.symbols import IntArray, Symbols
from mocap_fit.corpus import Corpus
from mocap_fit.errors import DataError
from mocap_fit.phones import ARTICULATORY_PARAMETERS, PhoneSequence, PhoneSet
from mocap_fit.tracks import FloatArray

#: Number of face parameters that an untrained model is planned for.
PLANNED_PARAMETERS = len(ARTICULATORY_PARAMETERS)


@dataclass(frozen=True, eq=False)
class TrainingUtterance:
    """An utterance as a model trains on it.

    Parameters
    ----------
    id
        Its name in the corpus.
    phones
        Its labels.
    positions
        The symbol of each segment, ``(segments,)``.
    times
        Times of the frames, ``(frames,)``, seconds.
    values
        Parameters, ``(frames, parameters)``, no unit; NaN where missing.
    """

    id: str
    phones: PhoneSequence
    positions: IntArray
    times: FloatArray
    values: FloatArray


def load_utterances(
    corpus: Corpus | None, symbols: Symbols, max_pause: float | None = None
) -> tuple[TrainingUtterance, ...]:
    """Load what a model trains on, or is tested on.

    Parameters
    ----------
    corpus
        The utterances; None for none.
    symbols
        The symbols of the model.
    max_pause
        Frames of silence that are farther than this from all speech of their utterance become NaN,
        seconds; None leaves all as they are, and so does an utterance without speech.

    Returns
    -------
    tuple[TrainingUtterance, ...]
        In the order of the corpus.

    Raises
    ------
    DataError
        If an utterance has no phones.
    """
    utterances = []
    for utterance in corpus or ():
        phones, tracks = utterance.read_phones(), utterance.read_tracks()
        if not len(phones):
            raise DataError(f"the utterance '{utterance.id}' has no phones")
        values = tracks.values
        if max_pause is not None:
            distances = _measure_from_speech(phones, tracks.times, symbols.phone_set)
            values = np.where((distances > max_pause)[:, None], np.nan, values)
        positions = symbols.indices(phones)
        utterances.append(TrainingUtterance(utterance.id, phones, positions, tracks.times, values))
    return tuple(utterances)


def _measure_from_speech(
    phones: PhoneSequence, times: FloatArray, phone_set: PhoneSet
) -> FloatArray:
    """Return how far each time is from speech, seconds; 0 everywhere if there is none."""
    speech = [segment for segment in phones if not phone_set.is_silence(segment)]
    if not speech:
        return np.zeros(len(times))
    starts = np.array([segment.start for segment in speech])
    ends = np.array([segment.end for segment in speech])
    after = np.searchsorted(starts, times, side="right")
    since = np.where(after > 0, times - ends[np.maximum(after - 1, 0)], np.inf)
    until = np.where(
        after < len(starts), starts[np.minimum(after, len(starts) - 1)] - times, np.inf
    )
    return np.maximum(np.minimum(since, until), 0.0)


def compute_rmse(pairs: Iterable[tuple[FloatArray, FloatArray]]) -> float:
    """Return the root mean square difference of pairs of arrays, where neither is NaN.

    Parameters
    ----------
    pairs
        Arrays of one shape, such as ``(frames, parameters)``, two at a time.

    Returns
    -------
    float
        The error in the unit of the arrays; 0 without values.
    """
    total, count = 0.0, 0
    for first, second in pairs:
        differences = first - second
        valid = np.isfinite(differences)
        total += float(np.sum(differences[valid] ** 2))
        count += int(np.count_nonzero(valid))
    return float(np.sqrt(total / count)) if count else 0.0


def check_arrays(
    arrays: Mapping[str, np.ndarray[Any, Any]], shapes: Mapping[str, tuple[int, ...]]
) -> None:
    """Check that a model file has the arrays of a model, and that they are finite.

    Parameters
    ----------
    arrays
        Arrays of any shape ``(...)``, by name.
    shapes
        The shape that each must have.

    Raises
    ------
    DataError
        If one is missing, has another shape, or is not finite.
    """
    for name, shape in shapes.items():
        array = arrays.get(name)
        if array is None or array.shape != tuple(shape):
            raise DataError(
                f"the array '{name}' of the model has the wrong shape",
                found="none" if array is None else array.shape,
                expected=tuple(shape),
            )
        if not np.isfinite(array).all():
            raise DataError(f"the array '{name}' of the model is not finite")


def compute_phone_means(data: Iterable[TrainingUtterance], symbols: int) -> FloatArray:
    """Return the mean of every parameter over the frames of every phone.

    Parameters
    ----------
    data
        The utterances.
    symbols
        Number of phones.

    Returns
    -------
    FloatArray
        Means, ``(symbols, parameters)``; where a phone has no frames, the mean over all, or 0.
    """
    utterances = tuple(data)
    values = np.concatenate([each.values for each in utterances])
    sums = np.zeros((symbols, values.shape[1]))
    counts = np.zeros((symbols, values.shape[1]))
    for each in utterances:
        segments = each.phones.at(each.times)
        inside = segments >= 0
        valid = np.isfinite(each.values[inside])
        positions = each.positions[segments[inside]]
        np.add.at(sums, positions, np.where(valid, each.values[inside], 0.0))
        np.add.at(counts, positions, valid)
    return np.where(counts > 0, sums / np.maximum(counts, 1), compute_means(values))


def compute_means(values: FloatArray) -> FloatArray:
    """Return the means of columns over the values that are not NaN.

    Parameters
    ----------
    values
        Parameters, ``(frames, parameters)``; NaN where missing.

    Returns
    -------
    FloatArray
        Means, ``(parameters,)``; 0 for a column without values.
    """
    valid = np.isfinite(values)
    count = valid.sum(axis=0)
    total = np.where(valid, values, 0.0).sum(axis=0)
    return np.asarray(total / np.maximum(count, 1))
