"""Tracks over time: markers, rigid bodies, and face parameters.

Frame ``i`` is at ``start_time + i / rate``. Positions are millimetres; NaN is missing, never 0.
Every type is a frozen dataclass that checks itself when it is made, and carries its provenance:
the steps that led to it.
"""

from __future__ import annotations

import copy
import dataclasses
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mocap_fit._version import __version__
from mocap_fit.errors import DataError

FloatArray = NDArray[np.float64]


class Origin(IntEnum):
    """Where a sample of a marker comes from."""

    MISSING = 0
    MEASURED = 1
    FILLED = 2
    VIRTUAL = 3


@dataclass(frozen=True)
class Step:
    """One step of a provenance: what was done, with which arguments, by which version.

    Arguments are values that JSON can hold; never a clock time, an absolute path or a number of
    jobs, so that the same input gives the same bytes.
    """

    name: str
    arguments: Mapping[str, Any] = field(default_factory=dict)
    version: str = field(default_factory=lambda: __version__)

    def to_dict(self) -> dict[str, Any]:
        """The step as a dictionary that JSON can hold."""
        return {"step": self.name, "arguments": dict(self.arguments), "version": self.version}

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Step:
        """The step that `to_dict` wrote."""
        return cls(values["step"], values.get("arguments", {}), values.get("version", ""))


Provenance = tuple[Step, ...]


@dataclass(frozen=True)
class Event:
    """Something that the operator or the recorder marked in time (seconds)."""

    name: str
    time: float


@dataclass(frozen=True, eq=False)
class _Tracks:
    """What every kind of track shares: names, rate, start time, provenance."""

    names: tuple[str, ...]
    rate: float
    start_time: float = field(default=0.0, kw_only=True)
    name: str = field(default="", kw_only=True)
    events: tuple[Event, ...] = field(default=(), kw_only=True)
    provenance: Provenance = field(default=(), kw_only=True)

    _noun = "track"

    def _check_common(self) -> None:
        object.__setattr__(self, "names", tuple(str(name) for name in self.names))
        object.__setattr__(self, "provenance", tuple(self.provenance))
        object.__setattr__(self, "events", tuple(self.events))
        duplicates = sorted({n for n in self.names if self.names.count(n) > 1})
        if duplicates:
            raise DataError(
                f"{self._noun} names must be unique",
                found=f"more than one {', '.join(duplicates)}",
                advice="Rename them in the recording software and export again.",
            )
        if not self.names:
            raise DataError(f"there is no {self._noun}", found=0, expected="one or more")
        if not np.isfinite(self.rate) or self.rate <= 0:
            raise DataError(
                "the frame rate is not possible",
                found=f"{self.rate} Hz",
                expected="a number above 0",
                advice="Give the rate of the recording.",
            )
        if not np.isfinite(self.start_time):
            raise DataError("the start time is not a number", found=self.start_time)
        object.__setattr__(self, "rate", float(self.rate))
        object.__setattr__(self, "start_time", float(self.start_time))

    def _checked(self, value: ArrayLike, attribute: str, trailing: tuple[int, ...]) -> FloatArray:
        """The array as float64 `(frames, names, *trailing)`, read-only, or a `DataError`."""
        try:
            array = np.array(value, dtype=np.float64)
        except (TypeError, ValueError) as error:
            raise DataError(f"the {attribute} are not numbers", found=error) from None
        shape = (len(self.names), *trailing)
        if array.ndim != len(shape) + 1 or array.shape[1:] != shape:
            wanted = ", ".join(("frames", *map(str, shape)))
            raise DataError(
                f"the {attribute} have the wrong shape",
                found=array.shape,
                expected=f"({wanted})",
            )
        if np.isinf(array).any():
            frame = int(np.argwhere(np.isinf(array))[0][0])
            raise DataError(
                f"the {attribute} hold an infinite number", frame=frame, expected="finite or NaN"
            )
        array.setflags(write=False)
        object.__setattr__(self, attribute, array)
        return array

    def replace(self, **changes: Any) -> Self:
        """A copy with some fields changed, checked again."""
        return dataclasses.replace(self, **changes)

    def with_step(self, step: str, arguments: Mapping[str, Any] | None = None) -> Self:
        """A copy whose provenance has one more step."""
        # Nothing else changes, and arrays cannot be written to: they are not checked again.
        twin = copy.copy(self)
        object.__setattr__(twin, "provenance", (*self.provenance, Step(step, arguments or {})))
        return twin

    def index(self, name: str) -> int:
        """Position of a name among the names.

        Raises
        ------
        DataError
            If there is none of that name.
        """
        try:
            return self.names.index(name)
        except ValueError:
            raise DataError(
                f"there is no {self._noun} '{name}'", expected=f"one of {', '.join(self.names)}"
            ) from None

    def indices(self, names: Iterable[str]) -> NDArray[np.intp]:
        """Positions of several names; all the unknown ones are named in one error."""
        wanted = list(names)
        missing = [name for name in wanted if name not in self.names]
        if missing:
            raise DataError(
                f"there is no {self._noun} '{missing[0]}'"
                if len(missing) == 1
                else f"there are no {self._noun}s {', '.join(missing)}",
                expected=f"some of {', '.join(self.names)}",
            )
        return np.array([self.names.index(name) for name in wanted], dtype=np.intp)

    def _frames(self) -> int:
        raise NotImplementedError

    @property
    def frames(self) -> int:
        """Number of frames."""
        return self._frames()

    @property
    def times(self) -> FloatArray:
        """Time of every frame, `(frames,)`, in seconds."""
        return self.start_time + np.arange(self.frames) / self.rate

    @property
    def duration(self) -> float:
        """Number of frames over the rate, in seconds."""
        return self.frames / self.rate

    def frame_slice(self, start: float | None, end: float | None) -> slice:
        """Frames whose times are in ``[start, end)``, as a slice."""
        times = self.times
        tolerance = 1e-9
        first = 0 if start is None else int(np.searchsorted(times, start - tolerance))
        last = self.frames if end is None else int(np.searchsorted(times, end - tolerance))
        return slice(first, max(first, last))


@dataclass(frozen=True, eq=False)
class MarkerTracks(_Tracks):
    """Markers of a recording over time.

    Parameters
    ----------
    names
        Marker names, unique.
    rate
        Frames per second, hertz.
    positions
        `(frames, markers, 3)`, millimetres; NaN is missing.
    origin
        `(frames, markers)`, an `Origin` each; measured or missing where not given.
    start_time
        Time of the first frame, seconds.
    name
        What the recording is called; the file name without its ending when it was read.
    events
        What was marked in time.
    provenance
        The steps that led here.

    Raises
    ------
    DataError
        If a shape, the rate, the names or the origin are impossible.
    """

    positions: FloatArray
    origin: NDArray[np.uint8] = None  # type: ignore[assignment]

    _noun = "marker"

    def __post_init__(self) -> None:
        self._check_common()
        positions = self._checked(self.positions, "positions", (3,))
        # A marker with one coordinate missing is missing.
        gone = np.asarray(np.isnan(positions).any(axis=2))
        if (np.isnan(positions).all(axis=2) != gone).any():
            positions = np.where(gone[:, :, None], np.nan, positions)
            positions.setflags(write=False)
            object.__setattr__(self, "positions", positions)
        if self.origin is None:
            origin = np.where(gone, Origin.MISSING, Origin.MEASURED).astype(np.uint8)
        else:
            origin = np.array(self.origin, dtype=np.uint8)
            if origin.shape != gone.shape:
                raise DataError(
                    "the origin has the wrong shape", found=origin.shape, expected=gone.shape
                )
            origin[gone] = Origin.MISSING
            if ((origin == Origin.MISSING) & ~gone).any():
                frame = int(np.argwhere((origin == Origin.MISSING) & ~gone)[0][0])
                raise DataError("a sample is marked missing but has a position", frame=frame)
        origin.setflags(write=False)
        object.__setattr__(self, "origin", origin)

    def _frames(self) -> int:
        return len(self.positions)

    @property
    def visible(self) -> NDArray[np.bool_]:
        """Which samples are there, `(frames, markers)`."""
        return np.asarray(self.origin != Origin.MISSING)

    def between(self, start: float | None = None, end: float | None = None) -> MarkerTracks:
        """The frames with times in ``[start, end)``, in seconds."""
        part = self.frame_slice(start, end)
        if part.stop <= part.start:
            raise DataError(
                "no frame lies in that stretch of time",
                found=f"{start} s to {end} s",
                expected=f"within {self.times[0]:.3f} s to {self.times[-1]:.3f} s"
                if self.frames
                else "a recording with frames",
            )
        return self.replace(
            positions=self.positions[part],
            origin=self.origin[part],
            start_time=float(self.times[part.start]),
        ).with_step("between", {"start": start, "end": end})

    def select(self, names: Sequence[str]) -> MarkerTracks:
        """The named markers, in the order given."""
        chosen = self.indices(names)
        return self.replace(
            names=tuple(names), positions=self.positions[:, chosen], origin=self.origin[:, chosen]
        ).with_step("select", {"names": list(names)})

    def position(self, name: str) -> FloatArray:
        """Positions of one marker, `(frames, 3)`."""
        return self.positions[:, self.index(name)]


@dataclass(frozen=True, eq=False)
class PoseTracks(_Tracks):
    """Poses of rigid bodies over time.

    Parameters
    ----------
    names
        Names of the bodies.
    rate
        Frames per second.
    rotations
        `(frames, bodies, 3, 3)`, right-handed rotation matrices that take a point of the body to
        the recording; NaN is missing.
    translations
        `(frames, bodies, 3)`, millimetres: where the body's origin is in the recording.
    residuals
        `(frames, bodies)`, millimetres: root mean square distance of the body's markers from
        where the pose puts them.
    """

    rotations: FloatArray
    translations: FloatArray
    residuals: FloatArray

    _noun = "body"

    def __post_init__(self) -> None:
        self._check_common()
        rotations = self._checked(self.rotations, "rotations", (3, 3))
        translations = self._checked(self.translations, "translations", (3,))
        residuals = self._checked(self.residuals, "residuals", ())
        if not len(rotations) == len(translations) == len(residuals):
            raise DataError(
                "rotations, translations and residuals differ in their frames",
                found=(len(rotations), len(translations), len(residuals)),
            )

    def _frames(self) -> int:
        return len(self.rotations)


@dataclass(frozen=True, eq=False)
class ParameterTracks(_Tracks):
    """Parameters of a face over time.

    Parameters
    ----------
    names
        Parameter names, in the order of the rig.
    rate
        Frames per second.
    values
        `(frames, parameters)`; 0 is rest, 1 the full gesture; NaN is missing.
    standard_deviations
        `(frames, parameters)`, in the unit of the values; infinite where the visible markers do
        not determine a parameter, NaN where unknown. All NaN when not given.
    residuals
        `(frames,)`, millimetres of the speaker: root mean square distance of the visible markers
        from the fitted face. All NaN when not given.
    """

    values: FloatArray
    standard_deviations: FloatArray = None  # type: ignore[assignment]
    residuals: FloatArray = None  # type: ignore[assignment]

    _noun = "parameter"

    def __post_init__(self) -> None:
        self._check_common()
        values = self._checked(self.values, "values", ())
        deviations = self.standard_deviations
        if deviations is None:
            deviations = np.full(values.shape, np.nan)
        deviations = np.array(deviations, dtype=np.float64)
        residuals = self.residuals
        if residuals is None:
            residuals = np.full(len(values), np.nan)
        residuals = np.array(residuals, dtype=np.float64)
        if deviations.shape != values.shape:
            raise DataError(
                "the standard deviations have the wrong shape",
                found=deviations.shape,
                expected=values.shape,
            )
        if residuals.shape != (len(values),):
            raise DataError(
                "the residuals have the wrong shape",
                found=residuals.shape,
                expected=(len(values),),
            )
        for attribute, array in (("standard_deviations", deviations), ("residuals", residuals)):
            array.setflags(write=False)
            object.__setattr__(self, attribute, array)

    def _frames(self) -> int:
        return len(self.values)

    @property
    def uncertain(self) -> NDArray[np.bool_]:
        """Which values the visible markers do not determine, `(frames, parameters)`."""
        return np.isinf(self.standard_deviations)

    def between(self, start: float | None = None, end: float | None = None) -> ParameterTracks:
        """The frames with times in ``[start, end)``, in seconds."""
        part = self.frame_slice(start, end)
        return self.replace(
            values=self.values[part],
            standard_deviations=self.standard_deviations[part],
            residuals=self.residuals[part],
            start_time=float(self.start_time + part.start / self.rate),
        ).with_step("between", {"start": start, "end": end})

    def value(self, name: str) -> FloatArray:
        """Values of one parameter, `(frames,)`."""
        return self.values[:, self.index(name)]
