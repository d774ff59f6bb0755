"""The attributes of the segments of an utterance that questions are about, and their targets."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mocap_fit.control.cart.arrays import ByteArray
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

#: The groups of similar phones: combinations of the question classes, and the other consonants.
GROUPS = (
    "no_speech",
    "vowel",
    "bilabial_stop",
    "labiodental fricative",
    "labiodental",
    "fricative",
    "consonant",
)
#: The larger group that each of them belongs to.
KIND_OF_GROUP = dict.fromkeys(GROUPS, "consonant") | {"no_speech": "no_speech", "vowel": "vowel"}
# Levels are bytes: none, the phones, and a level for each group.
_MAX_PHONES = 255 - len(GROUPS)


def get_group(phone_set: PhoneSet, symbol: str) -> str:
    """Return the group of `GROUPS` that a phone belongs to.

    Parameters
    ----------
    phone_set
        The set of the phone.
    symbol
        The phone.

    Returns
    -------
    str
        One of `GROUPS`.
    """
    classes = phone_set.get_classes(symbol)
    name = " ".join(each for each in QUESTION_CLASSES if each in classes)
    return name if name in GROUPS else "consonant"


@dataclass(frozen=True, eq=False)
class Alphabet:
    """The phones of a corpus as levels: small integers that trees ask about.

    Level 0 is no phone; then come the phones, then a level for each of `GROUPS`, for the phones of
    that group that the corpus does not have.

    Parameters
    ----------
    symbols
        The phones, without stress.
    phone_set
        The set that they are from.
    """

    symbols: tuple[str, ...]
    phone_set: PhoneSet
    _levels: dict[str, int] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        levels = {symbol: level for level, symbol in enumerate(self.symbols, start=1)}
        object.__setattr__(self, "_levels", levels)

    @classmethod
    def from_counts(cls, counts: Mapping[str, int], phone_set: PhoneSet) -> Alphabet:
        """Make the alphabet of the phones of a corpus; of very many the commonest.

        Parameters
        ----------
        counts
            How often each phone occurs.
        phone_set
            The set that they are from.

        Returns
        -------
        Alphabet
            In alphabetical order.
        """
        commonest = sorted(counts, key=lambda symbol: (-counts[symbol], symbol))[:_MAX_PHONES]
        return cls(tuple(sorted(commonest)), phone_set)

    @property
    def levels(self) -> int:
        """Number of levels."""
        return 1 + len(self.symbols) + len(GROUPS)

    def get_level(self, symbol: str) -> int:
        """Return the level of a phone, or of its group where the corpus does not have it.

        Parameters
        ----------
        symbol
            The phone, without stress.

        Returns
        -------
        int
            At least 1.
        """
        known = self._levels.get(symbol)
        if known is not None:
            return known
        return 1 + len(self.symbols) + GROUPS.index(get_group(self.phone_set, symbol))

    def list_names(self) -> tuple[str, ...]:
        """List the names of the levels, for people.

        Returns
        -------
        tuple[str, ...]
            One a level.
        """
        others = (f"other {group.replace('_', ' ')}" for group in GROUPS)
        return ("none", *self.symbols, *others)

    def list_groups(self) -> tuple[str, ...]:
        """List the group of each level.

        Returns
        -------
        tuple[str, ...]
            One a level; empty for no phone.
        """
        return ("", *(get_group(self.phone_set, symbol) for symbol in self.symbols), *GROUPS)

    def mark_members(self, phone_class: str, phones: Sequence[str]) -> ByteArray:
        """Mark the levels of a class, or of some phones.

        Parameters
        ----------
        phone_class
            One of `mocap_fit.phones.QUESTION_CLASSES`.
        phones
            Some phones; where there are any, the class does not count.

        Returns
        -------
        ndarray
            ``(levels,)``, 1 for those that belong, 0 for the others, no unit.
        """
        if phones:
            return np.array([name in phones for name in self.list_names()], dtype=np.uint8)
        groups = self.list_groups()
        return np.array([phone_class in group.split() for group in groups], dtype=np.uint8)


@dataclass(frozen=True)
class _Label:
    """What is looked up once for each label: level, resistance, features."""

    level: int
    resists: NDArray[np.bool_]
    features: FloatArray


class ContextReader:
    """Reads the attributes of the segments of utterances.

    Parameters
    ----------
    attributes
        The attributes.
    alphabet
        The phones as levels.
    resistant
        Which phones resist coarticulation in which parameter, ``(levels, parameters)``. Levels of
        groups say nothing: a phone that the corpus lacks is looked up in the phone set where
        ``by_phone_set`` says so, and otherwise does not resist.
    parameter_names
        The face parameters.
    by_phone_set
        In which parameters the phone set says which phones resist, ``(parameters,)``.
    reach
        How many phones away the nearest resistant phone may be; beyond, there is none.
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
        self.resistant = resistant
        self.by_phone_set = by_phone_set
        self.reach = reach
        self._names = tuple(parameter_names)
        self._numbers: dict[tuple[str, int | None], int] = {}
        self._labels: list[_Label] = []
        # The first is the silence around an utterance.
        self._look_up(PhoneSegment(0.0, 1.0, alphabet.phone_set.silence))

    def _look_up(self, segment: PhoneSegment) -> int:
        """Return the number of a label among those that are cached."""
        key = (segment.phone, segment.stress)
        number = self._numbers.get(key)
        if number is None:
            phone_set = self.alphabet.phone_set
            symbol = phone_set.get_phone(segment).symbol
            level = self.alphabet.get_level(symbol)
            resists = self.resistant[level]
            if level > len(self.alphabet.symbols):
                resists = look_up_resistance(phone_set, symbol, self._names) & self.by_phone_set
            number = self._numbers[key] = len(self._labels)
            self._labels.append(_Label(level, resists, phone_set.get_features(segment)))
        return number

    def read_columns(self, *utterances: PhoneSequence) -> list[NDArray[Any]]:
        """Read the attributes of every segment, utterance by utterance, in order.

        Parameters
        ----------
        *utterances
            Their phones.

        Returns
        -------
        list[ndarray]
            Of each attribute ``(segments,)``: levels of phones, otherwise numbers (seconds, dB, or
            no unit), NaN where unknown. Of resistant phones ``(segments, parameters)``. Around an
            utterance is silence, whose duration and energy are unknown.
        """
        # All in one row, with so much silence between that no question sees beyond it.
        apart = max([self.reach, *(abs(attribute.at) for attribute in self.attributes)])
        lengths = [len(phones) for phones in utterances]
        first = np.cumsum([0, *lengths[:-1]]) + apart * np.arange(1, len(lengths) + 1)
        count = sum(lengths) + apart * (len(lengths) + 1)
        inside = np.concatenate([np.arange(n) + at for n, at in zip(lengths, first, strict=True)])
        segments = [segment for phones in utterances for segment in phones]
        labels = np.zeros(count, dtype=np.int64)
        labels[inside] = [self._look_up(segment) for segment in segments]
        levels = np.array([each.level for each in self._labels], dtype=np.uint8)[labels]
        features = np.array([each.features for each in self._labels])
        durations, loudness = np.full(count, np.nan), np.full(count, np.nan)
        durations[inside] = [segment.end - segment.start for segment in segments]
        loudness[inside] = read_energies(segments)
        resists = np.zeros((count, len(self._names)), dtype=np.bool_)
        resists[inside] = np.array([each.resists for each in self._labels])[labels[inside]]
        columns: list[NDArray[Any]] = []
        for attribute in self.attributes:
            at = attribute.at
            if attribute.kind == "resistant":
                columns.append(_find_nearest(levels, resists, at, self.reach)[inside])
            elif attribute.kind == "phone":
                columns.append(levels[inside + at])
            elif attribute.kind == "duration":
                columns.append(durations[inside + at])
            elif attribute.kind == "energy":
                columns.append(loudness[inside + at])
            else:
                name = "stress" if attribute.kind == "stress" else attribute.feature
                columns.append(features[labels[inside + at], FEATURE_NAMES.index(name)])
        return columns


def read_energies(phones: Iterable[PhoneSegment]) -> FloatArray:
    """Read the energy at the centre of each segment.

    Parameters
    ----------
    phones
        The segments.

    Returns
    -------
    ndarray
        ``(segments,)``, dB; NaN where it is not known.
    """
    energies = [np.nan if s.energy_db is None else s.energy_db for s in phones]
    return np.array(energies, dtype=np.float64)


def look_up_resistance(
    phone_set: PhoneSet, symbol: str, parameter_names: Sequence[str]
) -> NDArray[np.bool_]:
    """Look up in which parameters a phone resists coarticulation, as its set says.

    Parameters
    ----------
    phone_set
        The set of the phone.
    symbol
        The phone.
    parameter_names
        The face parameters; the set knows `mocap_fit.phones.ARTICULATORY_PARAMETERS`.

    Returns
    -------
    ndarray
        ``(parameters,)``, true where it resists.
    """
    return np.array(
        [
            name in ARTICULATORY_PARAMETERS and phone_set.is_resistant(symbol, name)
            for name in parameter_names
        ],
        dtype=np.bool_,
    )


def _find_nearest(levels: ByteArray, resists: NDArray[np.bool_], at: int, reach: int) -> ByteArray:
    """Find the levels of the nearest resistant phones in a direction, (segments, parameters)."""
    if at > 0:
        return _find_nearest(levels[::-1], resists[::-1], -at, reach)[::-1]
    count, parameters = resists.shape
    # A row of nothing stands before the first segment.
    last = np.where(resists, np.arange(1, count + 1)[:, None], 0)
    last = np.concatenate([np.zeros((1, parameters), np.int64), np.maximum.accumulate(last)])
    nearest, columns = last[:-1], np.arange(parameters)
    for _ in range(-at - 1):
        nearest = last[np.maximum(nearest - 1, 0), columns]
    is_near = (nearest > 0) & (np.arange(1, count + 1)[:, None] - nearest <= reach)
    return np.where(is_near, levels[np.maximum(nearest - 1, 0)], 0).astype(np.uint8)


def sample_targets(tracks: ParameterTracks, phones: PhoneSequence) -> FloatArray:
    """Sample the articulatory targets: the parameters at the segments' centres (section 5.1).

    Parameters
    ----------
    tracks
        Parameters of the utterance.
    phones
        Its phones, on the same clock.

    Returns
    -------
    ndarray
        ``(segments, parameters)``, in the unit of each parameter, linear between the two frames
        about the centre; NaN where one of them is missing, and more than half a frame beyond the
        tracks.
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
    line = (1 - share) * values[before] + share * values[after]
    targets = np.where(on_frame, values[before], line)
    targets[outside] = np.nan
    return targets
