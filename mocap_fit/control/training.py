"""What the trained models share: their symbols, the frames of a corpus, unseen phones, errors."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mocap_fit.control.model_file import read_model_file, write_model_file
from mocap_fit.corpus import Corpus
from mocap_fit.errors import ConfigurationError, DataError, FileFormatError
from mocap_fit.phones import (
    ARTICULATORY_PARAMETERS,
    PhoneSegment,
    PhoneSequence,
    PhoneSet,
    load_phone_set,
)
from mocap_fit.tracks import FloatArray

IntArray = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Symbols:
    """The phones that a model tells apart, and which of them it has learned.

    Parameters
    ----------
    phone_set
        The set that they are from.
    names
        The symbols, in the order of the set; with a mark of stress where stress counts.
    stress
        Whether it does.
    seen
        `(symbols,)`: whether the corpus had it. A phone that it had not is taken for the nearest
        that it had: of the same kind (vowel, consonant, silence) if there is one, by the distance
        of the 17 features of Beskow section 4.4, and the first of the set among equals.
    """

    phone_set: PhoneSet
    names: tuple[str, ...]
    stress: bool
    seen: NDArray[np.bool_]
    _features: FloatArray = field(init=False, repr=False)
    _kinds: tuple[str, ...] = field(init=False, repr=False)
    _found: dict[str, int] = field(init=False, repr=False, default_factory=dict)

    @classmethod
    def of(cls, corpus: Corpus, stress: bool) -> Symbols:
        """The symbols of a corpus's phone set; of a set without end, those that the corpus has."""
        used = [segment for utterance in corpus for segment in utterance.read_phones()]
        names = symbol_names(corpus.phone_set, stress, (segment.phone for segment in used))
        found = {corpus.phone_set.get_symbol(segment, stress) for segment in used}
        seen = np.array([name in found for name in names])
        return cls(corpus.phone_set, names, stress, seen)

    def __post_init__(self) -> None:
        rows = np.array([self.phone_set.get_features(name) for name in self.names])
        object.__setattr__(self, "_features", rows)
        kinds = tuple(self.phone_set.get_phone(name).kind for name in self.names)
        object.__setattr__(self, "_kinds", kinds)

    def __len__(self) -> int:
        return len(self.names)

    def position(self, segment: PhoneSegment | str) -> int:
        """Position of a phone among the symbols: its own, or that of the nearest learned one."""
        if isinstance(segment, str):
            segment = PhoneSegment(0.0, 1.0, segment)
        symbol = self.phone_set.get_symbol(segment, self.stress)
        if symbol not in self._found:
            self._found[symbol] = self._nearest(symbol)
        return self._found[symbol]

    def positions(self, phones: Iterable[PhoneSegment]) -> IntArray:
        """Position of every segment, `(segments,)`."""
        return np.array([self.position(segment) for segment in phones], dtype=np.int64)

    def _nearest(self, symbol: str) -> int:
        if symbol in self.names and self.seen[self.names.index(symbol)]:
            return self.names.index(symbol)
        kind = self.phone_set.get_phone(symbol).kind
        same = self.seen & np.array([other == kind for other in self._kinds])
        allowed = same if same.any() else self.seen
        apart = np.sum((self._features - self.phone_set.get_features(symbol)) ** 2, axis=1)
        return int(np.argmin(np.where(allowed, apart, np.inf)))

    def state(self) -> dict[str, Any]:
        """What `restored` needs, as JSON holds it."""
        return {"symbols": list(self.names), "seen": [bool(s) for s in self.seen]}

    @classmethod
    def restored(cls, phone_set: PhoneSet, stress: bool, state: Mapping[str, Any]) -> Symbols:
        """The symbols that `state` described."""
        names, seen = tuple(state["symbols"]), np.array(state["seen"], dtype=bool)
        if seen.shape != (len(names),) or not seen.any():
            raise DataError("the symbols of the model do not fit each other")
        return cls(phone_set, names, stress, seen)


@dataclass(frozen=True, eq=False)
class Recording:
    """An utterance as a model trains on it.

    Parameters
    ----------
    phones
        Its labels.
    positions
        `(segments,)`: the symbol of each.
    times
        `(frames,)`, seconds.
    values
        `(frames, parameters)`; NaN is missing.
    """

    phones: PhoneSequence
    positions: IntArray
    times: FloatArray
    values: FloatArray


def recordings(
    corpus: Corpus, symbols: Symbols, pause: float | None = None
) -> tuple[Recording, ...]:
    """What a corpus has to train on, or to be tested on.

    Parameters
    ----------
    corpus, symbols
        Of the model.
    pause
        Frames of silence that are farther than this from all speech of their utterance become NaN,
        seconds; None keeps all, and so does an utterance without speech.

    Raises
    ------
    DataError
        If an utterance has no phones.
    """
    found = []
    for utterance in corpus:
        phones, tracks = utterance.read_phones(), utterance.read_tracks()
        if not len(phones):
            raise DataError(f"the utterance '{utterance.id}' has no phones")
        values = tracks.values
        if pause is not None:
            apart = _from_speech(phones, tracks.times, corpus.phone_set)
            values = np.where((apart > pause)[:, None], np.nan, values)
        found.append(Recording(phones, symbols.positions(phones), tracks.times, values))
    return tuple(found)


def _from_speech(phones: PhoneSequence, times: FloatArray, phone_set: PhoneSet) -> FloatArray:
    """How far each time is from speech, `(times,)`, seconds; 0 everywhere if there is none."""
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


def symbol_names(phone_set: PhoneSet, stress: bool, used: Iterable[str] = ()) -> tuple[str, ...]:
    """All symbols of a set; of a set without end, those of the phones that are used."""
    if phone_set.compute is None:
        return phone_set.list_symbols(stress)
    return phone_set.select(used).list_symbols(stress)


def check_phone_set(corpus: Corpus, name: str) -> None:
    """See that a corpus is written in the phone set that a model was made for.

    Raises
    ------
    DataError
        If it is not; an empty name goes with any.
    """
    if name and corpus.phone_set.name != load_phone_set(name).name:
        raise DataError(
            "the corpus is written in another phone set than the model was made for",
            found=corpus.phone_set.name,
            expected=name,
        )


def check_settings(model: Any, **least: float) -> None:
    """See that numbers among a model's settings are possible.

    Parameters
    ----------
    model
        The model.
    least
        By setting, the least that it may be.

    Raises
    ------
    ConfigurationError
        If one is less, or no finite number.
    """
    for name, smallest in least.items():
        value = getattr(model, name)
        if (
            isinstance(value, bool)
            or not isinstance(value, int | float)
            or not (smallest <= value < math.inf)
        ):
            raise ConfigurationError(
                f"the setting '{name}' of the model '{model.name}' is not possible",
                found=value,
                expected=f"a number, {smallest} at least",
            )


def planned_symbols(phone_set: str, stress: bool) -> tuple[PhoneSet, tuple[str, ...]]:
    """The phone set of a setting and its symbols, for a model that is not trained yet.

    Raises
    ------
    DataError
        If the setting is empty.
    """
    if not phone_set:
        raise DataError(
            "how many parameters an untrained model has depends on its phone set",
            advice="Train it, or say create(NAME, phone_set=SET).",
        )
    chosen = load_phone_set(phone_set)
    return chosen, symbol_names(chosen, stress)


#: How many face parameters an untrained model counts with.
PLANNED_PARAMETERS = len(ARTICULATORY_PARAMETERS)


def root_mean_square(pairs: Iterable[tuple[FloatArray, FloatArray]]) -> float:
    """Root mean square difference of pairs of arrays, where neither is NaN; 0 without values."""
    total, count = 0.0, 0
    for first, second in pairs:
        apart = first - second
        there = np.isfinite(apart)
        total += float(np.sum(apart[there] ** 2))
        count += int(np.count_nonzero(there))
    return float(np.sqrt(total / count)) if count else 0.0


def check_finite(arrays: Mapping[str, np.ndarray[Any, Any]], shapes: Mapping[str, Any]) -> None:
    """See that a model file has the arrays of a model, and that they are numbers.

    Raises
    ------
    DataError
        If one is missing, has another shape, or is not finite.
    """
    for name, shape in shapes.items():
        found = arrays.get(name)
        if found is None or found.shape != tuple(shape):
            raise DataError(
                f"the array '{name}' of the model is not as it must be",
                found="none" if found is None else found.shape,
                expected=tuple(shape),
            )
        if not np.isfinite(found).all():
            raise DataError(f"the array '{name}' of the model is not finite")


def phone_means(data: Iterable[Recording], symbols: int) -> FloatArray:
    """The mean of every parameter over the frames of every phone.

    Parameters
    ----------
    data
        Recordings.
    symbols
        How many phones there are.

    Returns
    -------
    FloatArray
        `(symbols, parameters)`; where a phone has no frames, the mean over all, or 0.
    """
    parts = tuple(data)
    values = np.concatenate([each.values for each in parts])
    sums = np.zeros((symbols, values.shape[1]))
    counts = np.zeros((symbols, values.shape[1]))
    for each in parts:
        found = each.phones.at(each.times)
        inside = found >= 0
        there = np.isfinite(each.values[inside])
        positions = each.positions[found[inside]]
        np.add.at(sums, positions, np.where(there, each.values[inside], 0.0))
        np.add.at(counts, positions, there)
    mean = mean_values(values)
    return np.where(counts > 0, sums / np.maximum(counts, 1), mean)


def mean_values(values: FloatArray) -> FloatArray:
    """Means of the columns, `(parameters,)`, of what is not NaN; 0 where there is nothing."""
    there = np.isfinite(values)
    count = there.sum(axis=0)
    total = np.where(there, values, 0.0).sum(axis=0)
    return np.asarray(total / np.maximum(count, 1))


class Checkpoint:
    """How far a training is, in a file; parts that are done are not done again.

    Parameters
    ----------
    path
        The file; None keeps nothing.
    model, settings
        Name and settings of the model.
    data
        What it trains on. A file of another model, other settings or other data does not fit and
        is written anew.
    """

    def __init__(
        self,
        path: Path | None,
        model: str,
        settings: Mapping[str, Any],
        data: Sequence[Sequence[Recording]],
    ) -> None:
        self._path = path
        self._parts: dict[str, np.ndarray[Any, Any]] = {}
        if path is None:
            return
        digest = hashlib.sha256(json.dumps([model, dict(settings)]).encode())
        for array in _all_arrays(data):
            digest.update(np.ascontiguousarray(array).tobytes())
        self._header = {"checkpoint": model, "fingerprint": digest.hexdigest()}
        if path.is_file():
            header, arrays = read_model_file(path)
            if "checkpoint" not in header:
                raise FileFormatError(
                    "this file is no checkpoint of a training and stays as it is", path=path
                )
            if header.get("fingerprint") == self._header["fingerprint"]:
                self._parts = arrays

    def __contains__(self, part: str) -> bool:
        return part in self._parts

    def __getitem__(self, part: str) -> np.ndarray[Any, Any]:
        return self._parts[part]

    def keep(self, part: str, values: np.ndarray[Any, Any]) -> None:
        """Keep a part that is done."""
        self._parts[part] = values
        if self._path is not None:
            write_model_file(self._header, self._parts, self._path)


def _all_arrays(data: Sequence[Sequence[Recording]]) -> Iterator[np.ndarray[Any, Any]]:
    for part in data:
        yield np.array([len(part)])
        for each in part:
            yield from (
                each.phones.starts,
                each.phones.ends,
                each.positions,
                each.times,
                each.values,
            )
