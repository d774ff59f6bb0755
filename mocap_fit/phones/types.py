"""Labelled phones of an utterance.

A segment is ``[start, end)`` in seconds. A sequence is in the order of time and does not overlap;
what lies between two segments is unlabelled, which is not the same as silent.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from mocap_fit.errors import DataError
from mocap_fit.tracks import FloatArray, Provenance, Step


@dataclass(frozen=True)
class PhoneSegment:
    """A labelled phone.

    Parameters
    ----------
    start, end
        Seconds; the end is after the start.
    phone
        The symbol, without its mark of stress.
    stress
        0 unstressed, 1 primary, 2 secondary; None where it is not marked.
    word
        The word that the phone belongs to; empty where it is not known.
    energy_db
        Energy of the sound at the segment's centre, decibels; None where it is not known.
    """

    start: float
    end: float
    phone: str
    stress: int | None = None
    word: str = ""
    energy_db: float | None = None

    def __post_init__(self) -> None:
        if not (math.isfinite(self.start) and math.isfinite(self.end) and self.start < self.end):
            raise DataError(
                f"the phone '{self.phone}' has an impossible time",
                found=f"{self.start} to {self.end} s",
                expected="a start before its end",
            )
        if not self.phone:
            raise DataError(f"the phone at {self.start} s has no symbol")
        if self.stress not in (None, 0, 1, 2):
            raise DataError(
                f"the phone '{self.phone}' at {self.start} s has an unknown stress",
                found=self.stress,
                expected="0, 1, 2 or none",
            )

    @property
    def duration(self) -> float:
        """Seconds from start to end."""
        return self.end - self.start

    @property
    def centre(self) -> float:
        """The middle of the segment, seconds."""
        return 0.5 * (self.start + self.end)


@dataclass(frozen=True)
class PhoneSequence:
    """The phones of an utterance.

    Parameters
    ----------
    segments
        In the order of time, without overlap.
    phone_set
        Name of the phone set that the symbols are from; empty where it is not known.
    name
        Of the utterance.
    provenance
        The steps that led here.
    """

    segments: tuple[PhoneSegment, ...]
    phone_set: str = field(default="", kw_only=True)
    name: str = field(default="", kw_only=True)
    provenance: Provenance = field(default=(), kw_only=True)

    def __post_init__(self) -> None:
        object.__setattr__(self, "segments", tuple(self.segments))
        object.__setattr__(self, "provenance", tuple(self.provenance))
        for before, after in zip(self.segments, self.segments[1:], strict=False):
            if after.start < before.end:
                raise DataError(
                    f"two phones of '{self.name}' overlap",
                    found=f"'{before.phone}' to {before.end} s and '{after.phone}' from "
                    f"{after.start} s",
                    expected="each to begin where the one before has ended, or later",
                )

    def __len__(self) -> int:
        return len(self.segments)

    def __iter__(self) -> Iterator[PhoneSegment]:
        return iter(self.segments)

    def __getitem__(self, index: int) -> PhoneSegment:
        return self.segments[index]

    @property
    def phones(self) -> tuple[str, ...]:
        """The symbols."""
        return tuple(segment.phone for segment in self.segments)

    @property
    def starts(self) -> FloatArray:
        """`(segments,)`, seconds."""
        return np.array([segment.start for segment in self.segments], dtype=np.float64)

    @property
    def ends(self) -> FloatArray:
        """`(segments,)`, seconds."""
        return np.array([segment.end for segment in self.segments], dtype=np.float64)

    @property
    def duration(self) -> float:
        """Seconds from the first start to the last end; 0 without segments."""
        return self.segments[-1].end - self.segments[0].start if self.segments else 0.0

    def at(self, times: FloatArray) -> NDArray[np.int64]:
        """Which segment is heard at each time.

        Parameters
        ----------
        times
            `(times,)`, seconds.

        Returns
        -------
        NDArray[np.int64]
            `(times,)`: positions among the segments; -1 where nothing is labelled.
        """
        times = np.asarray(times, dtype=np.float64)
        if not self.segments:
            return np.full(times.shape, -1, dtype=np.int64)
        found = np.searchsorted(self.starts, times, side="right") - 1
        inside = (found >= 0) & (times < self.ends[np.maximum(found, 0)])
        return np.where(inside, found, -1).astype(np.int64)

    def gaps(self, shortest: float = 1e-6) -> tuple[tuple[float, float], ...]:
        """Stretches between segments that nothing labels, as `(start, end)` in seconds."""
        pairs = zip(self.segments, self.segments[1:], strict=False)
        return tuple((a.end, b.start) for a, b in pairs if b.start - a.end > shortest)

    def replace(self, **changes: Any) -> Self:
        """A copy with some fields changed, checked again."""
        return dataclasses.replace(self, **changes)

    def with_step(self, step: str, arguments: Mapping[str, Any] | None = None) -> Self:
        """A copy whose provenance has one more step."""
        return self.replace(provenance=(*self.provenance, Step(step, arguments or {})))
