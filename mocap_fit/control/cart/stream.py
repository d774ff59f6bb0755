"""Live use of CART: frames come as soon as the phones that they depend on are known."""

from __future__ import annotations

import math
from collections.abc import Callable

from mocap_fit.control.streaming import WindowStream
from mocap_fit.phones import PhoneSequence
from mocap_fit.tracks import FloatArray


class CentreStream(WindowStream):
    """A stream whose look-ahead is a number of phones, not a time.

    Parameters
    ----------
    predict_at
        The method of the model.
    rate
        Frames per second, hertz.
    parameters
        Number of face parameters.
    phones_ahead
        How many phones after a segment must be known for the curve to be known up to its centre.
    phones_behind
        How many phones before a segment matter for the curve after its centre.
    reach
        How far from a frame smoothing looks, seconds.
    """

    def __init__(
        self,
        predict_at: Callable[[PhoneSequence, FloatArray], FloatArray],
        rate: float,
        parameters: int,
        phones_ahead: int,
        phones_behind: int,
        reach: float,
    ) -> None:
        super().__init__(predict_at, rate, parameters, math.inf, math.inf)
        self._phones_ahead, self._phones_behind = phones_ahead, phones_behind
        self._reach = reach

    def _find_known_end(self) -> float:
        last = len(self._segments) - 1 - self._phones_ahead
        return self._segments[last].centre - self._reach if last >= 0 else -math.inf

    def _count_passed(self, time: float) -> int:
        passed = sum(segment.centre <= time - self._reach for segment in self._segments)
        return max(passed - 1 - self._phones_behind, 0)
