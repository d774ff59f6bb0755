"""The inputs of a network: phonetic features of every inner frame, by table look-up."""

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


def compute_phone_inputs(
    phone_set: PhoneSet, segment: PhoneSegment, stress: bool = True
) -> FloatArray:
    """Return the inputs of one phone.

    Parameters
    ----------
    phone_set
        The phone set of the segment.
    segment
        The phone.
    stress
        Whether stress is an input; else its feature is 0.

    Returns
    -------
    FloatArray
        Inputs, ``(18,)``, in the order of `INPUT_NAMES`; silence is all zeros.
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
        The phone set of the phones.
    stress
        Whether stress is an input.
    phones
        The phones that are known from the beginning.
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
        """Add the next phone.

        Parameters
        ----------
        segment
            The phone.
        """
        if not self._starts:
            self.start_time = segment.start
        key = (segment.phone, segment.stress)
        if key not in self._rows:
            self._rows[key] = len(self._table)
            self._table.append(compute_phone_inputs(self._phone_set, segment, self._stress))
        self._starts.append(segment.start - self.start_time)
        self._ends.append(segment.end - self.start_time)
        self._of_segment.append(self._rows[key])

    def forget_before(self, time: float) -> None:
        """Drop phones that end before a time.

        Parameters
        ----------
        time
            Time from the start, seconds.
        """
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
        """The inputs of the different phones, ``(rows, 18)``; the first row is silence."""
        return np.array(self._table)

    def index(self, time: float) -> int:
        """Return the row of `table` of the phone at one time.

        Parameters
        ----------
        time
            Time from the start, seconds.

        Returns
        -------
        int
            The row; 0 where nothing is labelled.
        """
        reached = time + BOUNDARY_TOLERANCE
        segment = bisect.bisect_right(self._starts, reached) - 1
        is_inside = segment >= 0 and reached < self._ends[segment]
        return self._of_segment[segment] if is_inside else 0

    def indices(self, times: FloatArray) -> NDArray[np.intp]:
        """Return the rows of `table` of the phones at some times.

        Parameters
        ----------
        times
            Seconds from the start, ``(times,)``.

        Returns
        -------
        NDArray[np.intp]
            Rows, ``(times,)``; 0 where nothing is labelled.
        """
        return np.array([self.index(time) for time in times.tolist()], dtype=np.intp)


def count_lead(ahead: int) -> int:
    """Return the number of inner frames by which the networks begin before the first phone.

    The first of them sees silence alone: what comes before it is like it.

    Parameters
    ----------
    ahead
        Frames of context after a frame.

    Returns
    -------
    int
        Number of frames.
    """
    return ahead + 1


def compute_utterance_inputs(
    phones: PhoneSequence,
    phone_set: PhoneSet,
    frames: int,
    behind: int,
    ahead: int,
    stress: bool = True,
) -> FloatArray:
    """Return the inputs of an utterance's inner frames and of their context.

    Parameters
    ----------
    phones
        The phones of the utterance.
    phone_set
        The phone set of the phones.
    frames
        Number of inner frames, from `count_lead` before the start of the first phone.
    behind
        Frames of context before the first.
    ahead
        Frames of context after the last.
    stress
        Whether stress is an input.

    Returns
    -------
    FloatArray
        Inputs, ``(behind + frames + ahead, 18)``.
    """
    inputs = PhoneInputs(phone_set, stress, phones)
    first = -count_lead(ahead) - behind
    times = np.arange(first, first + behind + frames + ahead) / INNER_RATE
    return inputs.table[inputs.indices(times)]


def slice_windows(inputs: np.ndarray, context: int) -> np.ndarray:
    """Return what the input layer sees of each frame: the inputs of its context, oldest first.

    Parameters
    ----------
    inputs
        Inputs of frames and context, ``(..., frames + context - 1, inputs)``.
    context
        Frames of a window, the present one and both sides.

    Returns
    -------
    ndarray
        Inputs, ``(..., frames, context · inputs)``.
    """
    seen = np.lib.stride_tricks.sliding_window_view(inputs, context, axis=-2)
    seen = np.moveaxis(seen, -1, -2)
    return np.ascontiguousarray(seen).reshape(*seen.shape[:-2], -1)
