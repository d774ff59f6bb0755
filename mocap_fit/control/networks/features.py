"""What a network hears: phonetic features of every inner frame, by table look-up."""

from __future__ import annotations

import bisect
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from mocap_fit.phones import FEATURE_NAMES, PhoneSegment, PhoneSequence, PhoneSet
from mocap_fit.tracks import FloatArray

#: Frames per second inside the networks, whatever comes in or goes out (Beskow section 4.4).
INNER_RATE = 60.0

#: The inputs of a frame. The paper lists 17 features; its connection counts (Table 1) imply 18.
#: The eighteenth here is ``speech``: 1 while a phone is spoken, 0 in silence and where nothing is
#: labelled. Silence is otherwise all zeros, which a consonant can nearly be as well.
INPUT_NAMES = (*FEATURE_NAMES, "speech")

# A boundary that is this close after a time counts as reached: rounding must not decide on which
# side of a frame it falls.
BOUNDARY_TOLERANCE = 1e-8


def phone_inputs(phone_set: PhoneSet, segment: PhoneSegment, stress: bool = True) -> FloatArray:
    """The inputs of one phone.

    Parameters
    ----------
    phone_set
        What the segment is written in.
    segment
        The phone.
    stress
        Whether stress is told; else its feature is 0.

    Returns
    -------
    FloatArray
        `(18,)`, in the order of `INPUT_NAMES`; silence is all zeros.
    """
    inputs = np.zeros(len(INPUT_NAMES))
    if phone_set.is_silence(segment):
        return inputs
    inputs[:-1] = phone_set.get_features(segment)
    inputs[-1] = 1.0
    if not stress:
        inputs[INPUT_NAMES.index("stress")] = 0.0
    return inputs


class PhoneInputs:
    """The inputs at any time of an utterance, whose phones may still be coming.

    Parameters
    ----------
    phone_set
        What the phones are written in.
    stress
        Whether stress is told.
    phones
        Those that are known from the beginning.
    """

    def __init__(
        self, phone_set: PhoneSet, stress: bool = True, phones: Iterable[PhoneSegment] = ()
    ) -> None:
        self._phone_set, self._stress = phone_set, stress
        self._rows: dict[tuple[str, int | None], int] = {}
        self._table = [np.zeros(len(INPUT_NAMES))]
        self._starts: list[float] = []
        self._ends: list[float] = []
        self._of_segment: list[int] = []
        #: Where time is counted from: the start of the first phone, seconds.
        self.start_time = 0.0
        for segment in phones:
            self.add(segment)

    def add(self, segment: PhoneSegment) -> None:
        """Add the next phone."""
        if not self._starts:
            self.start_time = segment.start
        key = (segment.phone, segment.stress)
        if key not in self._rows:
            self._rows[key] = len(self._table)
            self._table.append(phone_inputs(self._phone_set, segment, self._stress))
        self._starts.append(segment.start - self.start_time)
        self._ends.append(segment.end - self.start_time)
        self._of_segment.append(self._rows[key])

    def forget_before(self, time: float) -> None:
        """Drop phones that end before a time, in seconds from the start."""
        first = 0
        while first < len(self._ends) - 1 and self._ends[first] < time:
            first += 1
        del self._starts[:first], self._ends[:first], self._of_segment[:first]

    @property
    def end(self) -> float:
        """The end of the last phone, seconds from the start."""
        return self._ends[-1] if self._ends else 0.0

    @property
    def table(self) -> FloatArray:
        """`(rows, 18)`: the inputs of the different phones; the first row is silence."""
        return np.array(self._table)

    def row(self, time: float) -> int:
        """The row of `table` that is heard at one time, in seconds from the start."""
        reached = time + BOUNDARY_TOLERANCE
        found = bisect.bisect_right(self._starts, reached) - 1
        return self._of_segment[found] if found >= 0 and reached < self._ends[found] else 0

    def rows(self, times: FloatArray) -> NDArray[np.intp]:
        """The rows of `table` that are heard.

        Parameters
        ----------
        times
            `(times,)`, seconds from the start.

        Returns
        -------
        NDArray[np.intp]
            `(times,)`; 0 where nothing is labelled.
        """
        if not self._starts:
            return np.zeros(len(times), dtype=np.intp)
        reached = times + BOUNDARY_TOLERANCE
        found = np.searchsorted(self._starts, reached, side="right") - 1
        inside = (found >= 0) & (reached < np.asarray(self._ends)[np.maximum(found, 0)])
        return np.where(inside, np.asarray(self._of_segment)[found], 0)


def lead(ahead: int) -> int:
    """How many inner frames before the first phone the networks begin.

    The first of them sees silence alone: what comes before it is like it.
    """
    return ahead + 1


def utterance_inputs(
    phones: PhoneSequence,
    phone_set: PhoneSet,
    frames: int,
    behind: int,
    ahead: int,
    stress: bool = True,
) -> FloatArray:
    """The inputs of an utterance's inner frames and of the context round them.

    Parameters
    ----------
    phones
        The utterance.
    phone_set
        What they are written in.
    frames
        Inner frames, from `lead` before the start of the first phone.
    behind, ahead
        Frames of context before the first and after the last.
    stress
        Whether stress is told.

    Returns
    -------
    FloatArray
        `(behind + frames + ahead, 18)`.
    """
    inputs = PhoneInputs(phone_set, stress, phones)
    first = -lead(ahead) - behind
    times = np.arange(first, first + behind + frames + ahead) / INNER_RATE
    return inputs.table[inputs.rows(times)]


def windows(inputs: np.ndarray, context: int) -> np.ndarray:
    """What the input layer sees of each frame: the inputs of its context, the oldest first.

    Parameters
    ----------
    inputs
        `(..., frames + context - 1, inputs)`.
    context
        Frames of a window, the present one and both sides.

    Returns
    -------
    np.ndarray
        `(..., frames, context · inputs)`.
    """
    seen = np.lib.stride_tricks.sliding_window_view(inputs, context, axis=-2)
    seen = np.moveaxis(seen, -1, -2)
    return np.ascontiguousarray(seen).reshape(*seen.shape[:-2], -1)
