"""The phones that a model distinguishes, and what stands for those that it has not learned."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mocap_fit.corpus import Corpus
from mocap_fit.errors import DataError
from mocap_fit.phones import PhoneSegment, PhoneSet, load_phone_set
from mocap_fit.tracks import FloatArray

IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Symbols:
    """The phones that a model distinguishes, and which of them it has learned.

    Parameters
    ----------
    phone_set
        The set that they are from.
    names
        The symbols, in the order of the set; with a mark of stress where stress counts.
    stress
        Whether phones of different stress are different symbols.
    seen
        Whether the corpus had each, ``(symbols,)``. Any other phone is replaced by the nearest
        that it had: of the same kind (vowel, consonant, silence) if there is one, by the distance
        of the 17 features of Beskow section 4.4, and the first of the set among equals.
    """

    phone_set: PhoneSet
    names: tuple[str, ...]
    stress: bool
    seen: BoolArray
    _features: FloatArray = field(init=False, repr=False)
    _kinds: tuple[str, ...] = field(init=False, repr=False)
    _cached: dict[str, int] = field(init=False, repr=False, default_factory=dict)

    @classmethod
    def from_corpus(cls, corpus: Corpus, stress: bool) -> Symbols:
        """Return the symbols of a corpus's phone set; of an open set, those that the corpus has.

        Parameters
        ----------
        corpus
            The training part.
        stress
            Whether phones of different stress are different symbols.

        Returns
        -------
        Symbols
            The symbols, of which those of the corpus are seen.
        """
        used = [segment for utterance in corpus for segment in utterance.read_phones()]
        names = list_symbols(corpus.phone_set, stress, (segment.phone for segment in used))
        occurring = {corpus.phone_set.get_symbol(segment, stress) for segment in used}
        seen = np.array([name in occurring for name in names])
        return cls(corpus.phone_set, names, stress, seen)

    def __post_init__(self) -> None:
        rows = np.array([self.phone_set.get_features(name) for name in self.names])
        object.__setattr__(self, "_features", rows)
        kinds = tuple(self.phone_set.get_phone(name).kind for name in self.names)
        object.__setattr__(self, "_kinds", kinds)

    def __len__(self) -> int:
        return len(self.names)

    @property
    def are_vowels(self) -> BoolArray:
        """Which symbols are vowels, ``(symbols,)``."""
        return np.array([kind == "vowel" for kind in self._kinds])

    def index(self, segment: PhoneSegment | str) -> int:
        """Return the position of a phone, or of the nearest one that was learned.

        Parameters
        ----------
        segment
            A segment, or the label of a phone.

        Returns
        -------
        int
            Position among `names`.
        """
        if isinstance(segment, str):
            segment = PhoneSegment(0.0, 1.0, segment)
        symbol = self.phone_set.get_symbol(segment, self.stress)
        if symbol not in self._cached:
            self._cached[symbol] = self._find_nearest(symbol)
        return self._cached[symbol]

    def indices(self, phones: Iterable[PhoneSegment]) -> IntArray:
        """Return the positions of segments, or of the nearest phones that were learned.

        Parameters
        ----------
        phones
            Segments of an utterance.

        Returns
        -------
        IntArray
            Positions among `names`, ``(segments,)``.
        """
        return np.array([self.index(segment) for segment in phones], dtype=np.int64)

    def _find_nearest(self, symbol: str) -> int:
        if symbol in self.names and self.seen[self.names.index(symbol)]:
            return self.names.index(symbol)
        kind = self.phone_set.get_phone(symbol).kind
        same = self.seen & np.array([other == kind for other in self._kinds])
        allowed = same if same.any() else self.seen
        distances = np.sum((self._features - self.phone_set.get_features(symbol)) ** 2, axis=1)
        return int(np.argmin(np.where(allowed, distances, np.inf)))

    def to_json(self) -> dict[str, Any]:
        """Return what `from_json` needs.

        Returns
        -------
        dict[str, Any]
            Values that JSON can hold.
        """
        return {"symbols": list(self.names), "seen": [bool(s) for s in self.seen]}

    @classmethod
    def from_json(cls, phone_set: PhoneSet, stress: bool, values: Mapping[str, Any]) -> Symbols:
        """Return the symbols that `to_json` described.

        Parameters
        ----------
        phone_set
            The set that they are from.
        stress
            Whether phones of different stress are different symbols.
        values
            What `to_json` returned.

        Returns
        -------
        Symbols
            The same symbols.

        Raises
        ------
        DataError
            If names and marks differ in number, or no symbol was seen.
        """
        names, seen = tuple(values["symbols"]), np.array(values["seen"], dtype=bool)
        if seen.shape != (len(names),) or not seen.any():
            raise DataError("the symbols of the model do not fit each other")
        return cls(phone_set, names, stress, seen)


def list_symbols(phone_set: PhoneSet, stress: bool, used: Iterable[str] = ()) -> tuple[str, ...]:
    """Return all symbols of a phone set; of an open set, those of the phones that are used.

    Parameters
    ----------
    phone_set
        The set.
    stress
        Whether phones of different stress are different symbols.
    used
        Labels of phones, for an open set.

    Returns
    -------
    tuple[str, ...]
        In the order of the set.
    """
    if phone_set.compute is None:
        return phone_set.list_symbols(stress)
    return phone_set.select(used).list_symbols(stress)


def plan_symbols(phone_set: str, stress: bool) -> tuple[PhoneSet, tuple[str, ...]]:
    """Return the phone set of a setting and its symbols, for a model that is not trained yet.

    Parameters
    ----------
    phone_set
        Name or path of a phone set.
    stress
        Whether phones of different stress are different symbols.

    Returns
    -------
    phone_set
        The set.
    symbols
        Its symbols.

    Raises
    ------
    DataError
        If no phone set is named.
    """
    if not phone_set:
        raise DataError(
            "the number of parameters of an untrained model depends on its phone set",
            advice="Train it, or call create(NAME, phone_set=SET).",
        )
    chosen = load_phone_set(phone_set)
    return chosen, list_symbols(chosen, stress)


def check_phone_set(corpus: Corpus, name: str) -> None:
    """Check that a corpus is written in the phone set that a model was created for.

    Parameters
    ----------
    corpus
        The training part.
    name
        Name or path of a phone set; empty for any.

    Raises
    ------
    DataError
        If it is written in another phone set.
    """
    if name and corpus.phone_set.name != load_phone_set(name).name:
        raise DataError(
            "the corpus is written in another phone set than the model was created for",
            found=corpus.phone_set.name,
            expected=name,
        )
