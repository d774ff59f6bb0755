"""What every kind of track shares; a kind declares its arrays, and the rest follows from them."""

from __future__ import annotations

import copy
import dataclasses
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mocap_fit.errors import DataError, shorten
from mocap_fit.plain_text import to_unicode
from mocap_fit.tracks.arrays import FloatArray, TrackArray
from mocap_fit.tracks.interpolation import interpolate
from mocap_fit.tracks.provenance import Event, Provenance, Step

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# Seconds: times this much before a frame still belong to it.
_TOLERANCE = 1e-9

# Hertz and seconds, far beyond any recording: products of these are numbers.
_SLOWEST, _FASTEST, _LATEST = 1e-6, 1e9, 1e12


@dataclass(frozen=True, eq=False, repr=False)
class Tracks:
    """Named tracks over time: the base of markers, poses and parameters.

    Parameters
    ----------
    names
        Names of the tracks, unique.
    rate
        Frames per second, hertz.
    start_time
        Time of the first frame, seconds.
    name
        What the recording is called.
    events
        What was marked in time.
    provenance
        The steps that led here.
    """

    #: What the tracks hold: ``markers``, ``poses`` or ``parameters``.
    kind: ClassVar[str]
    #: What one track is called, and several.
    noun: ClassVar[str]
    plural: ClassVar[str]
    #: The unit of the first array.
    unit: ClassVar[str]
    #: The arrays; the first one is what `at` and indexing by a name return.
    arrays: ClassVar[tuple[TrackArray, ...]]
    #: Whether the columns of a table go track by track, or array by array.
    columns_by_track: ClassVar[bool] = True

    names: tuple[str, ...]
    rate: float
    start_time: float = field(default=0.0, kw_only=True)
    name: str = field(default="", kw_only=True)
    events: tuple[Event, ...] = field(default=(), kw_only=True)
    provenance: Provenance = field(default=(), kw_only=True)

    def __post_init__(self) -> None:
        self._check_names_and_times()
        frames: int | None = None
        for declared in self.arrays:
            value = getattr(self, declared.attribute)
            if value is None and declared.is_optional and frames is not None:
                array = self._get_default(declared, declared.get_shape(frames, len(self.names)))
            else:
                array = declared.check(value, frames, len(self.names))
            frames = len(array)
            self._set_array(declared.attribute, array)

    def _set_array(self, attribute: str, array: np.ndarray[Any, Any]) -> None:
        array.setflags(write=False)
        object.__setattr__(self, attribute, array)

    def _check_names_and_times(self) -> None:
        object.__setattr__(self, "names", tuple(to_unicode(str(name)) for name in self.names))
        object.__setattr__(self, "name", to_unicode(self.name))
        object.__setattr__(self, "provenance", tuple(self.provenance))
        object.__setattr__(self, "events", tuple(self.events))
        duplicates = sorted(n for n, count in Counter(self.names).items() if count > 1)
        if duplicates:
            raise DataError(
                f"{self.noun} names must be unique",
                found=f"more than one {', '.join(duplicates)}",
                advice="Rename them in the recording software and export again.",
            )
        if not self.names:
            raise DataError(f"there is no {self.noun}", found=0, expected="one or more")
        if not _SLOWEST <= self.rate <= _FASTEST:
            raise DataError(
                "the frame rate is not possible",
                found=f"{self.rate} Hz",
                expected=f"a number above 0, from {_SLOWEST:g} to {_FASTEST:g}",
                advice="Give the rate of the recording.",
            )
        times = {"the start time": self.start_time}
        times |= {f"the time of the event '{event.name}'": event.time for event in self.events}
        for noun, time in times.items():
            if not abs(time) <= _LATEST:
                raise DataError(
                    f"{noun} is not possible",
                    found=time,
                    expected=f"a number of seconds, at most {_LATEST:g}",
                )
        object.__setattr__(self, "rate", float(self.rate))
        object.__setattr__(self, "start_time", float(self.start_time))

    def _get_default(self, declared: TrackArray, shape: tuple[int, ...]) -> np.ndarray[Any, Any]:
        """Return the values of an optional array that was left out."""
        return np.full(shape, np.nan)

    def replace(self, **changes: Any) -> Self:
        """Return a copy with some fields changed, checked again.

        Parameters
        ----------
        **changes
            New values of fields, by name.

        Returns
        -------
        Tracks
            Tracks of the same kind.

        Raises
        ------
        DataError
            If the changed tracks are impossible.
        """
        return dataclasses.replace(self, **changes)

    def add_step(self, step: str, arguments: Mapping[str, Any] | None = None) -> Self:
        """Return a copy whose provenance has one more step.

        Parameters
        ----------
        step
            What was done.
        arguments
            Its arguments: values that JSON can hold.

        Returns
        -------
        Tracks
            Tracks of the same kind, with the same arrays.
        """
        # Nothing else changes, and arrays cannot be written to: they are not checked again.
        result = copy.copy(self)
        steps = (*self.provenance, Step(step, arguments or {}))
        object.__setattr__(result, "provenance", steps)
        return result

    def index(self, name: str) -> int:
        """Return the position of a name among the names.

        Parameters
        ----------
        name
            The track.

        Returns
        -------
        int
            From 0.

        Raises
        ------
        DataError
            If there is no track of that name.
        """
        return int(self.indices([name])[0])

    def indices(self, names: Iterable[str]) -> NDArray[np.intp]:
        """Return the positions of several names.

        Parameters
        ----------
        names
            The tracks.

        Returns
        -------
        ndarray
            From 0, ``(names,)``.

        Raises
        ------
        DataError
            If there are no tracks of some of the names; all of them are listed.
        """
        wanted = list(names)
        position = {name: k for k, name in enumerate(self.names)}
        missing = [name for name in wanted if name not in position]
        if missing:
            raise DataError(
                f"there is no {self.noun} '{shorten(missing[0])}'"
                if len(missing) == 1
                else f"there are no {self.plural} {shorten(missing)}",
                expected=f"some of {shorten(list(self.names))}",
            )
        return np.array([position[name] for name in wanted], dtype=np.intp)

    @property
    def main_array(self) -> FloatArray:
        """The first declared array: positions, translations or values."""
        array: FloatArray = getattr(self, self.arrays[0].attribute)
        return array

    @property
    def frames(self) -> int:
        """Number of frames."""
        return len(self.main_array)

    @property
    def times(self) -> FloatArray:
        """Time of every frame, ``(frames,)``, in seconds."""
        return self.start_time + np.arange(self.frames) / self.rate

    @property
    def duration(self) -> float:
        """Number of frames over the rate, in seconds."""
        return self.frames / self.rate

    @property
    def visible(self) -> NDArray[np.bool_]:
        """Which samples are there, ``(frames, tracks)``."""
        array = self.main_array
        return np.asarray(~np.isnan(array).any(axis=tuple(range(2, array.ndim))))

    def between(self, start: float | None = None, end: float | None = None) -> Self:
        """Return the frames with times in ``[start, end)``.

        Parameters
        ----------
        start
            Seconds; from the first frame where left out.
        end
            Seconds; to the last frame where left out.

        Returns
        -------
        Tracks
            Tracks of the same kind, which start at the time of their first frame.

        Raises
        ------
        DataError
            If no frame lies in that stretch of time.
        """
        times = self.times
        first = 0 if start is None else int(np.searchsorted(times, start - _TOLERANCE))
        last = self.frames if end is None else int(np.searchsorted(times, end - _TOLERANCE))
        if last <= first:
            raise DataError(
                "no frame lies in that stretch of time",
                found=f"{start} s to {end} s",
                expected=f"within {times[0]:.3f} s to {times[-1]:.3f} s"
                if self.frames
                else "a recording with frames",
            )
        changes = {a.attribute: getattr(self, a.attribute)[first:last] for a in self.arrays}
        return self.replace(start_time=float(times[first]), **changes).add_step(
            "between", {"start": start, "end": end}
        )

    def select(self, names: Sequence[str]) -> Self:
        """Return some of the tracks.

        Parameters
        ----------
        names
            The tracks, in the order of the result.

        Returns
        -------
        Tracks
            Tracks of the same kind.

        Raises
        ------
        DataError
            If there are no tracks of some of the names.
        """
        chosen = self.indices(names)
        changes = {
            a.attribute: getattr(self, a.attribute)[:, chosen] for a in self.arrays if a.has_names
        }
        return self.replace(names=tuple(names), **changes).add_step(
            "select", {"names": list(names)}
        )

    def __getitem__(self, name: str) -> FloatArray:
        return self.main_array[:, self.index(name)]

    def at(self, times: ArrayLike, attribute: str | None = None) -> NDArray[Any]:
        """Return values at any times, between frames too.

        Each array has its interpolation. Parameters lie on monotone cubics (Fritsch and Carlson
        1980), which reach the extremes of a movement and never go beyond them; missing values are
        bridged, and before and after the tracks the values at their ends hold. All else lies on
        straight lines between frames, rotations on the shortest turn; it is NaN beside a missing
        frame, and more than half a frame outside the tracks.

        Parameters
        ----------
        times
            Seconds, ``(times,)``.
        attribute
            The array, such as ``rotations``; positions of markers, translations of poses and
            values of parameters where left out.

        Returns
        -------
        ndarray
            ``(times, ...)``, with the trailing axes and the unit of the array.

        Raises
        ------
        DataError
            If there is no such array, or the tracks have no frame.
        """
        attribute = self.arrays[0].attribute if attribute is None else attribute
        declared = next((a for a in self.arrays if a.attribute == attribute), None)
        if declared is None:
            raise DataError(
                f"the tracks have no array '{attribute}'",
                expected=f"one of {', '.join(a.attribute for a in self.arrays)}",
            )
        if not self.frames:
            raise DataError(f"the tracks '{self.name}' have no frames")
        frames = (np.asarray(times, dtype=np.float64) - self.start_time) * self.rate
        return interpolate(getattr(self, attribute), frames, declared.interpolation)

    def equals(self, other: object) -> bool:
        """Tell whether other tracks hold the same: missing values are equal to each other.

        Parameters
        ----------
        other
            Tracks, or anything else.

        Returns
        -------
        bool
            Whether kind, name, names, rate, start time, events and all numbers are the same; the
            provenance may differ.
        """
        if type(other) is not type(self):
            return False
        fields = ("name", "names", "rate", "start_time", "events")
        return all(getattr(self, f) == getattr(other, f) for f in fields) and all(
            np.array_equal(
                getattr(self, a.attribute),
                getattr(other, a.attribute),
                equal_nan=a.dtype is np.float64,
            )
            for a in self.arrays
        )

    def describe(self) -> dict[str, Any]:
        """Return what the tracks hold, as values that JSON can hold.

        Returns
        -------
        dict
            ``content`` (``markers``, ``poses`` or ``parameters``), ``name``, ``frames``,
            ``rate``, ``duration``, ``start_time``, ``units``, one list of ``markers``, ``bodies``
            or ``parameters`` (each with its ``name`` and its ``gap_rate``, the share of frames in
            which it is missing, 0 to 1), ``events`` (``name``, ``time``) and ``provenance``.
        """
        missing = (~self.visible).mean(axis=0) if self.frames else np.zeros(len(self.names))
        return {
            "content": self.kind,
            "name": self.name,
            "frames": self.frames,
            "rate": self.rate,
            "duration": self.duration,
            "start_time": self.start_time,
            "units": self.unit,
            self.plural: [
                {"name": name, "gap_rate": float(share)}
                for name, share in zip(self.names, missing, strict=True)
            ],
            "events": [dataclasses.asdict(event) for event in self.events],
            "provenance": [step.to_dict() for step in self.provenance],
        }

    def plot(self, names: Sequence[str] | None = None, ax: Axes | None = None) -> Axes:
        """Plot the tracks over time.

        Parameters
        ----------
        names
            The tracks that are drawn; all of them where left out.
        ax
            The axes to draw into; those of a new figure where left out.

        Returns
        -------
        matplotlib.axes.Axes
            A line for each track: the values of parameters; of markers and bodies, the distance
            from their median position in millimetres.

        Raises
        ------
        DataError
            If there are no tracks of some of the names.
        """
        from mocap_fit.tracks.notebook import plot_tracks

        return plot_tracks(self, names, ax)

    def __repr__(self) -> str:
        from mocap_fit.tracks.notebook import summarise

        return summarise(self)

    def _repr_html_(self) -> str:
        from mocap_fit.tracks.notebook import to_html

        return to_html(self)

    def __setstate__(self, state: dict[str, Any]) -> None:
        # Copies and what is unpickled are read-only too; numpy does not keep that by itself.
        self.__dict__.update(state)
        for declared in self.arrays:
            state[declared.attribute].setflags(write=False)
