"""Live use of a control model: phones are pushed as they are known, frames pulled as they come."""

from __future__ import annotations

import abc
import dataclasses
import math
from typing import TYPE_CHECKING

import numpy as np

from mocap_fit.errors import DataError
from mocap_fit.phones import PhoneSegment, PhoneSequence
from mocap_fit.tracks import FloatArray

if TYPE_CHECKING:
    from mocap_fit.control.base import ControlModel

# A start that is earlier than the last end by less than this, in seconds, is at it.
_ROUNDING = 1e-9


class Stream(abc.ABC):
    """An utterance in progress.

    Frame ``i`` is at ``start_time + i / rate``, where the start is that of the first phone.
    Between two phones that do not meet nothing is labelled, as in a `PhoneSequence`.

    Parameters
    ----------
    rate
        Frames per second, hertz.
    parameters
        Number of face parameters.
    """

    def __init__(self, rate: float, parameters: int) -> None:
        if not math.isfinite(rate) or rate <= 0:
            raise DataError("the frame rate must be positive", found=f"{rate} Hz")
        self.rate = rate
        self._parameters = parameters
        self._frames = 0
        self._ended = False
        self._last: PhoneSegment | None = None
        #: Time of the first frame, seconds; None before the first phone.
        self.start_time: float | None = None

    def push(self, segment: PhoneSegment) -> None:
        """Add the next phone.

        Parameters
        ----------
        segment
            The phone; it starts where the last one ends, or later.

        Raises
        ------
        DataError
            If it begins before the last one ends, or the utterance has ended.
        """
        if self._ended:
            raise DataError("the utterance has ended: begin another stream")
        if self._last is not None and segment.start < self._last.end:
            if segment.start < self._last.end - _ROUNDING:
                raise DataError(
                    "the phones of a stream come in the order of time",
                    found=f"'{segment.phone}' from {segment.start} s",
                    expected=f"a start at {self._last.end} s or later",
                )
            segment = dataclasses.replace(segment, start=self._last.end)
        if self.start_time is None:
            self.start_time = segment.start
        self._last = segment
        self._add(segment)

    def pull(self) -> FloatArray:
        """Return the frames that have become known since the last call.

        Returns
        -------
        FloatArray
            Parameters, ``(frames, parameters)``, no unit.
        """
        if self.start_time is None or self._last is None:
            return np.zeros((0, self._parameters))
        until = self._last.end if self._ended else self._find_known_end()
        first = last = self._frames
        if math.isfinite(until):
            last = max(first, math.ceil((until - self.start_time) * self.rate - 1e-6))
        self._frames = last
        if last == first:
            return np.zeros((0, self._parameters))
        return self._compute(self.start_time + np.arange(first, last) / self.rate)

    def finish(self) -> FloatArray:
        """End the utterance and return the rest of its frames.

        Returns
        -------
        FloatArray
            Parameters, ``(frames, parameters)``, no unit.
        """
        self._ended = True
        return self.pull()

    @abc.abstractmethod
    def _add(self, segment: PhoneSegment) -> None:
        """Add a phone that has been checked."""

    @abc.abstractmethod
    def _find_known_end(self) -> float:
        """Return the time up to which phones to come change nothing, seconds."""

    @abc.abstractmethod
    def _compute(self, times: FloatArray) -> FloatArray:
        """Return parameters ``(times, parameters)``; times only ever ascend."""


class WindowStream(Stream):
    """A stream that calls `ControlModel.predict_at` on the phones that matter for its frames.

    Parameters
    ----------
    model
        A trained model.
    rate
        Frames per second, hertz.
    """

    def __init__(self, model: ControlModel, rate: float) -> None:
        super().__init__(rate, len(model.parameter_names_))
        self._model = model
        self._segments: list[PhoneSegment] = []

    def _add(self, segment: PhoneSegment) -> None:
        self._segments.append(segment)

    def _find_known_end(self) -> float:
        return self._segments[-1].end - self._model.look_ahead

    def _count_passed(self, time: float) -> int:
        """Return how many of the first segments do not matter from a time on."""
        needed = time - self._model.look_back
        return sum(segment.end < needed for segment in self._segments)

    def _compute(self, times: FloatArray) -> FloatArray:
        del self._segments[: self._count_passed(float(times[0]))]
        return self._model.predict_at(PhoneSequence(tuple(self._segments)), times)
