"""What the questions find: the attributes of the segments of an utterance, and their targets."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mocap_fit.control.cart.questions import Attribute
from mocap_fit.phones import (
    ARTICULATORY_PARAMETERS,
    FEATURE_NAMES,
    QUESTION_CLASSES,
    PhoneSegment,
    PhoneSequence,
    PhoneSet,
)
from mocap_fit.tracks import FloatArray, ParameterTracks

ByteArray = NDArray[np.uint8]

#: The groups of phones that answer alike: combinations of the question classes, and what is left.
GROUPS = (
    "no_speech",
    "vowel",
    "bilabial_stop",
    "labiodental fricative",
    "labiodental",
    "fricative",
    "consonant",
)
#: Which group to go to where a group is not known.
KIND_OF_GROUP = dict.fromkeys(GROUPS, "consonant") | {
    "no_speech": "no_speech",
    "vowel": "vowel",
}
# Levels are bytes: none, the phones, a level for each group.
_MOST_PHONES = 255 - len(GROUPS)


def group_of(phone_set: PhoneSet, symbol: str) -> str:
    """The group of `GROUPS` that a phone belongs to."""
    classes = phone_set.get_classes(symbol)
    name = " ".join(each for each in QUESTION_CLASSES if each in classes)
    return name if name in GROUPS else "consonant"


@dataclass(frozen=True, eq=False)
class Alphabet:
    """The phones that a corpus has, as levels: small numbers that trees ask about.

    Level 0 is no phone; then come the phones, then a level for each of `GROUPS`, which stands for
    the phones of that group that the corpus does not have.

    Parameters
    ----------
    symbols
        The phones, without stress.
    phone_set
        What they are written in.
    """

    symbols: tuple[str, ...]
    phone_set: PhoneSet
    _levels: dict[str, int] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        levels = {symbol: level for level, symbol in enumerate(self.symbols, start=1)}
        object.__setattr__(self, "_levels", levels)

    @classmethod
    def of(cls, phones: dict[str, int], phone_set: PhoneSet) -> Alphabet:
        """The alphabet of phones that were counted; of very many the commonest.

        Parameters
        ----------
        phones
            How often each is in the corpus.
        phone_set
            Their set.
        """
        commonest = sorted(phones, key=lambda symbol: (-phones[symbol], symbol))[:_MOST_PHONES]
        return cls(tuple(sorted(commonest)), phone_set)

    @property
    def levels(self) -> int:
        """How many levels there are."""
        return 1 + len(self.symbols) + len(GROUPS)

    def level(self, symbol: str) -> int:
        """The level of a phone: its own, or that of its group."""
        known = self._levels.get(symbol)
        if known is not None:
            return known
        return 1 + len(self.symbols) + GROUPS.index(group_of(self.phone_set, symbol))

    def names(self) -> tuple[str, ...]:
        """What people call each level."""
        others = (f"other {group.replace('_', ' ')}" for group in GROUPS)
        return ("none", *self.symbols, *others)

    def groups(self) -> tuple[str, ...]:
        """The group of each level; empty for none."""
        own = (group_of(self.phone_set, symbol) for symbol in self.symbols)
        return ("", *own, *GROUPS)

    def members(self, phone_class: str, phones: Sequence[str]) -> ByteArray:
        """1 for the levels of a class, or of some phones, `(levels,)`."""
        if phones:
            return np.array([name in phones for name in self.names()], dtype=np.uint8)
        return np.array([phone_class in group.split() for group in self.groups()], dtype=np.uint8)


@dataclass(frozen=True)
class _Known:
    """What is looked up once for each label: level, resistance, features."""

    level: int
    resists: NDArray[np.bool_]
    features: FloatArray


class ContextReader:
    """Finds the attributes of the segments of utterances.

    Parameters
    ----------
    attributes
        Which.
    alphabet
        The phones as levels.
    resistant
        `(levels, parameters)`: which phones resist coarticulation in which parameter. Levels of
        groups say nothing: what is not in the corpus is looked up in the phone set where
        ``by_phone_set`` says so, and else does not resist.
    parameter_names
        The face parameters.
    by_phone_set
        `(parameters,)`: of which parameters the phone set says who resists.
    reach
        How many phones away the nearest resistant phone may be; farther, there is none.
    """

    def __init__(
        self,
        attributes: Sequence[Attribute],
        alphabet: Alphabet,
        resistant: NDArray[np.bool_],
        parameter_names: Sequence[str],
        by_phone_set: NDArray[np.bool_],
        reach: int,
    ) -> None:
        self.attributes = tuple(attributes)
        self.alphabet = alphabet
        self.reach = reach
        self._resistant = resistant
        self._names = tuple(parameter_names)
        self._by_phone_set = by_phone_set
        self._numbers: dict[tuple[str, int | None], int] = {}
        self._kept: list[_Known] = []
        # The first is the edge.
        self._look_up(PhoneSegment(0.0, 1.0, alphabet.phone_set.silence))

    def _look_up(self, segment: PhoneSegment) -> int:
        """The number of a label among those that are kept."""
        key = (segment.phone, segment.stress)
        found = self._numbers.get(key)
        if found is None:
            phone_set = self.alphabet.phone_set
            symbol = phone_set.get_phone(segment).symbol
            level = self.alphabet.level(symbol)
            resists = self._resistant[level]
            if level > len(self.alphabet.symbols):
                resists = resistance_of(phone_set, symbol, self._names) & self._by_phone_set
            found = self._numbers[key] = len(self._kept)
            self._kept.append(_Known(level, resists, phone_set.get_features(segment)))
        return found

    def columns(self, *utterances: PhoneSequence) -> list[NDArray[Any]]:
        """The attributes of every segment, utterance by utterance, in order.

        Returns
        -------
        list[NDArray[Any]]
            Of each attribute `(segments,)`: levels for phones, else numbers, NaN where unknown.
            Of resistant phones `(segments, parameters)`. Beyond the ends of an utterance is
            silence, whose duration and energy are unknown.
        """
        # All in one row, with so much of an edge between that nobody sees beyond it.
        apart = max([self.reach, *(abs(attribute.at) for attribute in self.attributes)])
        lengths = [len(phones) for phones in utterances]
        first = np.cumsum([0, *lengths[:-1]]) + apart * np.arange(1, len(lengths) + 1)
        count = sum(lengths) + apart * (len(lengths) + 1)
        own = np.concatenate([np.arange(n) + at for n, at in zip(lengths, first, strict=True)])
        segments = [segment for phones in utterances for segment in phones]
        known = np.zeros(count, dtype=np.int64)
        known[own] = [self._look_up(segment) for segment in segments]
        levels = np.array([each.level for each in self._kept], dtype=np.uint8)[known]
        features = np.array([each.features for each in self._kept])
        lasting, loud = np.full(count, np.nan), np.full(count, np.nan)
        lasting[own] = [segment.end - segment.start for segment in segments]
        loud[own] = energies(segments)
        resists = np.zeros((count, len(self._names)), dtype=np.bool_)
        resists[own] = np.array([each.resists for each in self._kept])[known[own]]
        found: list[NDArray[Any]] = []
        for attribute in self.attributes:
            at = attribute.at
            if attribute.kind == "resistant":
                found.append(_nearest(levels, resists, at, self.reach)[own])
            elif attribute.kind == "phone":
                found.append(levels[own + at])
            elif attribute.kind == "duration":
                found.append(lasting[own + at])
            elif attribute.kind == "energy":
                found.append(loud[own + at])
            else:
                name = "stress" if attribute.kind == "stress" else attribute.feature
                found.append(features[known[own + at], FEATURE_NAMES.index(name)])
        return found


def energies(phones: Iterable[PhoneSegment]) -> FloatArray:
    """Energy at the centre of each segment, dB; NaN where it is not known."""
    found = [np.nan if s.energy_db is None else s.energy_db for s in phones]
    return np.array(found, dtype=np.float64)


def resistance_of(
    phone_set: PhoneSet, symbol: str, parameter_names: Sequence[str]
) -> NDArray[np.bool_]:
    """In which parameters a phone resists, as its set says, `(parameters,)`."""
    return np.array(
        [
            name in ARTICULATORY_PARAMETERS and phone_set.is_resistant(symbol, name)
            for name in parameter_names
        ],
        dtype=np.bool_,
    )


def _nearest(levels: ByteArray, resists: NDArray[np.bool_], at: int, reach: int) -> ByteArray:
    """Levels of the nearest resistant phones in a direction, `(segments, parameters)`."""
    if at > 0:
        return _nearest(levels[::-1], resists[::-1], -at, reach)[::-1]
    count, parameters = resists.shape
    # A row of nothing stands before the first segment.
    last = np.where(resists, np.arange(1, count + 1)[:, None], 0)
    last = np.concatenate([np.zeros((1, parameters), np.int64), np.maximum.accumulate(last)])
    places, columns = last[:-1], np.arange(parameters)
    for _ in range(-at - 1):
        places = last[np.maximum(places - 1, 0), columns]
    is_near = (places > 0) & (np.arange(1, count + 1)[:, None] - places <= reach)
    return np.where(is_near, levels[np.maximum(places - 1, 0)], 0).astype(np.uint8)


def targets(tracks: ParameterTracks, phones: PhoneSequence) -> FloatArray:
    """The articulatory targets: the parameters at the centre of each segment (section 5.1).

    Returns
    -------
    FloatArray
        `(segments, parameters)`, on the line between the two frames about the centre; NaN where
        one of them is missing, and more than half a frame beyond the tracks.
    """
    values = tracks.values
    count = len(values)
    centres = 0.5 * (phones.starts + phones.ends)
    frames = (centres - tracks.start_time) * tracks.rate
    outside = (frames < -0.5) | (frames > count - 0.5)
    if not count:
        return np.full((len(phones), len(tracks.names)), np.nan)
    frames = np.clip(frames, 0.0, count - 1.0)
    before = np.floor(frames).astype(np.int64)
    share = (frames - before)[:, None]
    # A centre on a frame needs no other: the next may be missing, or beyond the end.
    on_frame = share < 1e-9
    after = np.minimum(before + 1, count - 1)
    found = np.where(on_frame, values[before], (1 - share) * values[before] + share * values[after])
    found[outside] = np.nan
    return found
