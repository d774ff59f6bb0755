"""Labelled phones of an utterance.

A segment is ``[start, end)`` in seconds. A sequence is ordered in time and does not overlap; the
time between two segments is unlabelled, which is not the same as silent.
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
from mocap_fit.plain_text import to_unicode
from mocap_fit.tracks import FloatArray, Provenance, Step

# Phones that the representation of a sequence lists.
_SHOWN = 12


@dataclass(frozen=True)
class PhoneSegment:
    """A labelled phone.

    Parameters
    ----------
    start
        Start, seconds.
    end
        End, seconds; later than the start.
    phone
        Symbol, without its mark of stress.
    stress
        0 unstressed, 1 primary, 2 secondary; None where not marked.
    word
        Word that the phone belongs to; empty where not known.
    energy_db
        Energy of the sound at the centre of the segment, decibels; None where not known.

    Raises
    ------
    DataError
        If the times are not finite and increasing, the symbol is empty, or the stress unknown.
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
        """Duration, seconds."""
        return self.end - self.start

    @property
    def centre(self) -> float:
        """Middle of the segment, seconds."""
        return 0.5 * (self.start + self.end)


@dataclass(frozen=True, repr=False)
class PhoneSequence:
    """The phones of an utterance.

    Parameters
    ----------
    segments
        Segments in the order of time, without overlap.
    phone_set
        Name of the phone set of the symbols; empty where not known.
    name
        Name of the utterance.
    provenance
        Processing steps that led to the phones.

    Raises
    ------
    DataError
        If two segments overlap or are out of order.
    """

    segments: tuple[PhoneSegment, ...]
    phone_set: str = field(default="", kw_only=True)
    name: str = field(default="", kw_only=True)
    provenance: Provenance = field(default=(), kw_only=True)

    def __post_init__(self) -> None:
        object.__setattr__(self, "segments", tuple(self.segments))
        object.__setattr__(self, "name", to_unicode(self.name))
        object.__setattr__(self, "provenance", tuple(self.provenance))
        for before, after in zip(self.segments, self.segments[1:], strict=False):
            if after.start < before.end:
                raise DataError(
                    f"two phones of '{self.name}' overlap",
                    found=f"'{before.phone}' to {before.end} s and '{after.phone}' from "
                    f"{after.start} s",
                    expected="each to begin where the one before has ended, or later",
                )

    def __repr__(self) -> str:
        name = f" {self.name}" if self.name else ""
        phone_set = f" of {self.phone_set}" if self.phone_set else ""
        first = " ".join(self.phones[:_SHOWN]) + (" …" if len(self) > _SHOWN else "")
        return (
            f"<PhoneSequence{name}: {len(self)} phones{phone_set}, {self.duration:.3f} s: {first}>"
        )

    def __len__(self) -> int:
        return len(self.segments)

    def __iter__(self) -> Iterator[PhoneSegment]:
        return iter(self.segments)

    def __getitem__(self, index: int) -> PhoneSegment:
        return self.segments[index]

    @property
    def phones(self) -> tuple[str, ...]:
        """Symbols of the segments."""
        return tuple(segment.phone for segment in self.segments)

    @property
    def starts(self) -> FloatArray:
        """Starts of the segments, ``(segments,)``, seconds."""
        return np.array([segment.start for segment in self.segments], dtype=np.float64)

    @property
    def ends(self) -> FloatArray:
        """Ends of the segments, ``(segments,)``, seconds."""
        return np.array([segment.end for segment in self.segments], dtype=np.float64)

    @property
    def duration(self) -> float:
        """Time from the first start to the last end, seconds; 0 without segments."""
        return self.segments[-1].end - self.segments[0].start if self.segments else 0.0

    def at(self, times: FloatArray) -> NDArray[np.int64]:
        """Return the index of the segment at each time.

        Parameters
        ----------
        times
            Times, ``(times,)``, seconds.

        Returns
        -------
        ndarray
            Indices of segments, ``(times,)``; -1 where nothing is labelled.
        """
        times = np.asarray(times, dtype=np.float64)
        if not self.segments:
            return np.full(times.shape, -1, dtype=np.int64)
        indices = np.searchsorted(self.starts, times, side="right") - 1
        inside = (indices >= 0) & (times < self.ends[np.maximum(indices, 0)])
        return np.where(inside, indices, -1).astype(np.int64)

    def replace(self, **changes: Any) -> Self:
        """Return a copy with some fields changed, checked again.

        Parameters
        ----------
        **changes
            New values by name of the field.

        Returns
        -------
        PhoneSequence
            The copy.
        """
        return dataclasses.replace(self, **changes)

    def add_step(self, step: str, arguments: Mapping[str, Any] | None = None) -> Self:
        """Return a copy whose provenance has one more step.

        Parameters
        ----------
        step
            Name of the step.
        arguments
            Arguments of the step, as JSON can hold them.

        Returns
        -------
        PhoneSequence
            The copy.
        """
        return self.replace(provenance=(*self.provenance, Step(step, arguments or {})))
