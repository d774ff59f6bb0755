"""Live use of CART: frames come as soon as the phones that they depend on are known."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from mocap_fit.control.streaming import Stream
from mocap_fit.phones import PhoneSegment, PhoneSequence
from mocap_fit.tracks import FloatArray


class CentreStream(Stream):
    """A stream whose look-ahead is a number of phones, not a time.

    Parameters
    ----------
    predict_at
        Of the model.
    rate
        Frames per second.
    ahead
        How many phones after a segment must be known for the curve to be sure up to its centre.
    behind
        How many phones before a segment matter for the curve after its centre.
    reach
        How far from a frame smoothing looks, seconds.
    """

    def __init__(
        self,
        predict_at: Callable[[PhoneSequence, FloatArray], FloatArray],
        rate: float,
        ahead: int,
        behind: int,
        reach: float,
    ) -> None:
        super().__init__(rate)
        self._predict_at = predict_at
        self._ahead, self._behind, self._reach = ahead, behind, reach
        self._segments: list[PhoneSegment] = []
        self._given = 0
        self._width = 0

    def _push(self, segment: PhoneSegment) -> None:
        self._segments.append(segment)

    def _pull(self, ended: bool) -> FloatArray:
        if self.start_time is None:
            return np.zeros((0, self._width))
        sure = len(self._segments) - 1 - self._ahead
        until = self.start_time
        if ended:
            until = self._segments[-1].end
        elif sure >= 0:
            until = self._segments[sure].centre - self._reach
        last = max(self._given, math.ceil((until - self.start_time) * self.rate - 1e-6))
        times = self.start_time + np.arange(self._given, last) / self.rate
        if len(times):
            earliest = float(times[0]) - self._reach
            passed = sum(segment.centre <= earliest for segment in self._segments)
            del self._segments[: max(passed - 1 - self._behind, 0)]
        values = self._predict_at(PhoneSequence(tuple(self._segments)), times)
        self._given, self._width = last, values.shape[1]
        return values
