"""Live use of a control model: phones are pushed as they are known, frames pulled as they come."""

from __future__ import annotations

import abc
import math
from collections.abc import Callable

import numpy as np

from mocap_fit.errors import DataError
from mocap_fit.phones import PhoneSegment, PhoneSequence
from mocap_fit.tracks import FloatArray


class Stream(abc.ABC):
    """An utterance that is under way.

    Frame ``i`` is at ``start_time + i / rate``, where the start is that of the first phone.
    Between two phones that do not meet nothing is labelled, as in a `PhoneSequence`.

    Parameters
    ----------
    rate
        Frames per second.
    """

    def __init__(self, rate: float) -> None:
        if not math.isfinite(rate) or rate <= 0:
            raise DataError("the frame rate is not possible", found=f"{rate} Hz")
        self.rate = rate
        self._ended = False
        self._last: PhoneSegment | None = None
        #: Time of the first frame, seconds; None before the first phone.
        self.start_time: float | None = None

    def push(self, segment: PhoneSegment) -> None:
        """Add the next phone.

        Raises
        ------
        DataError
            If it begins before the last one ends, or the utterance has ended.
        """
        if self._ended:
            raise DataError("the utterance has ended: begin another stream")
        if self._last is not None and segment.start < self._last.end - 1e-9:
            raise DataError(
                "the phones of a stream come in the order of time",
                found=f"'{segment.phone}' from {segment.start} s",
                expected=f"a start at {self._last.end} s or later",
            )
        if self.start_time is None:
            self.start_time = segment.start
        self._last = segment
        self._push(segment)

    def pull(self) -> FloatArray:
        """The frames that have become sure since the last call, `(frames, parameters)`."""
        return self._pull(False)

    def finish(self) -> FloatArray:
        """Say that no phone follows, and take the rest of the frames, `(frames, parameters)`."""
        self._ended = True
        return self._pull(True)

    @abc.abstractmethod
    def _push(self, segment: PhoneSegment) -> None:
        """Take a phone that has been checked."""

    @abc.abstractmethod
    def _pull(self, ended: bool) -> FloatArray:
        """Frames that were not given yet, and are sure or, at the end, are left."""


class WindowStream(Stream):
    """A stream that calls `predict_at` on the phones that matter for the frames it gives.

    Parameters
    ----------
    predict_at
        Of the model.
    rate
        Frames per second.
    look_ahead, look_back
        How far from a frame phones matter, seconds.
    """

    def __init__(
        self,
        predict_at: Callable[[PhoneSequence, FloatArray], FloatArray],
        rate: float,
        look_ahead: float,
        look_back: float,
    ) -> None:
        super().__init__(rate)
        self._predict_at = predict_at
        self._look_ahead, self._look_back = look_ahead, look_back
        self._segments: list[PhoneSegment] = []
        self._given = 0
        self._width: int | None = None

    def _push(self, segment: PhoneSegment) -> None:
        self._segments.append(segment)

    def _pull(self, ended: bool) -> FloatArray:
        if self.start_time is None or self._last is None:
            return np.zeros((0, self._width or 0))
        until = self._last.end - (0.0 if ended else self._look_ahead)
        first, last = self._given, self._given
        if math.isfinite(until):
            last = max(first, math.ceil((until - self.start_time) * self.rate - 1e-6))
        times = self.start_time + np.arange(first, last) / self.rate
        if len(times) and math.isfinite(self._look_back):
            needed = times[0] - self._look_back
            while len(self._segments) > 1 and self._segments[0].end < needed:
                del self._segments[0]
        values = self._predict_at(PhoneSequence(tuple(self._segments)), times)
        self._given, self._width = last, values.shape[1]
        return values
