"""What every reader does last: tracks with the file's name, checked, with their first step."""

from __future__ import annotations

import dataclasses
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from mocap_fit.errors import (
    DataError,
    FileFormatError,
    MocapFitWarning,
    add_path,
)
from mocap_fit.tracks import Event, FloatArray, MarkerTracks, PoseTracks

MILLIMETRES = {
    "mm": 1.0,
    "millimeter": 1.0,
    "millimeters": 1.0,
    "millimetre": 1.0,
    "millimetres": 1.0,
    "cm": 10.0,
    "centimeter": 10.0,
    "centimeters": 10.0,
    "centimetre": 10.0,
    "centimetres": 10.0,
    "dm": 100.0,
    "m": 1000.0,
    "meter": 1000.0,
    "meters": 1000.0,
    "metre": 1000.0,
    "metres": 1000.0,
    "in": 25.4,
    "inch": 25.4,
    "inches": 25.4,
    "ft": 304.8,
    "um": 0.001,
}
"""Millimetres in a unit of length, by the unit's name in lower case."""

_FARTHEST = 1e7
"""Millimetres: no marker is ten kilometres away."""

_SMALLEST = 2.0
"""Millimetres: three or more markers that never spread so far are probably given in metres."""

_AnyTracks = TypeVar("_AnyTracks", MarkerTracks, PoseTracks)


def millimetres(unit: str, *, path: Path, line: int | None = None) -> float:
    """Millimetres in one of a unit of length.

    Raises
    ------
    FileFormatError
        If the unit is not known.
    """
    try:
        return MILLIMETRES[unit.strip().lower()]
    except KeyError:
        raise FileFormatError(
            "the unit of length is not known",
            path=path,
            line=line,
            found=f"'{unit}'",
            expected="mm, cm, dm, m, in or ft",
            advice="Correct the unit, or export the recording in millimetres.",
        ) from None


def chosen_names(
    found: Sequence[str] | None,
    given: Sequence[str] | None,
    *,
    path: Path,
    noun: str = "marker",
    line: int | None = None,
) -> tuple[str, ...] | None:
    """The names that the caller gave, or else the file's.

    Raises
    ------
    FileFormatError
        If the caller gave another number of names than the file has, or a name is blank or
        occurs twice.
    """
    names = found if given is None else given
    if names is None:
        return None
    names = tuple(str(name).strip() for name in names)
    if given is not None and found is not None and len(given) != len(found):
        raise FileFormatError(
            f"the file has another number of {noun} names than were given",
            path=path,
            line=line,
            found=f"{len(found)} in the file",
            expected=f"{len(given)}, as given",
            advice="Give a name for each, in the order of the file.",
        )
    seen: dict[str, int] = {}
    for place, name in enumerate(names, start=1):
        if not name:
            raise FileFormatError(
                f"{noun} {place} has no name",
                path=path,
                line=line,
                advice="Name it in the recording software and export again, or give the names.",
            )
        if name in seen:
            raise FileFormatError(
                f"two {noun} names are the same",
                path=path,
                line=line,
                found=f"'{name}' as {noun} {seen[name]} and {place}",
                expected="unique names",
                advice="Rename one in the recording software and export again, or give the names.",
            )
        seen[name] = place
    return names


def markers(
    path: Path,
    reader: str,
    names: Sequence[str],
    rate: float,
    positions: FloatArray,
    *,
    origin: NDArray[np.uint8] | None = None,
    start_time: float = 0.0,
    events: Sequence[Event] = (),
    arguments: Mapping[str, Any] | None = None,
    unit_is_known: bool = False,
) -> MarkerTracks:
    """Marker tracks of a file.

    Raises
    ------
    MocapFitError
        With the file's name, if the tracks are impossible or no marker is ever seen.

    Warns
    -----
    MocapFitWarning
        If the file does not say its unit and the markers are so near to each other that it is
        probably not the millimetre.
    """
    _check_size(path, positions)
    if not unit_is_known and len(names) >= 3:
        # NaN compares false, so that gaps do not matter.
        low = np.min(positions, axis=1, initial=np.inf, where=~np.isnan(positions))
        high = np.max(positions, axis=1, initial=-np.inf, where=~np.isnan(positions))
        _warn_of_unit(path, float(np.max(high - low)))
    try:
        tracks = MarkerTracks(
            tuple(names),
            rate,
            positions,
            np.asarray(origin) if origin is not None else None,  # type: ignore[arg-type]
            start_time=start_time,
            name=path.stem,
            events=tuple(events),
        )
    except DataError as error:
        raise add_path(error, path) from None
    if not tracks.visible.any():
        raise _unseen(path, tracks.frames)
    return _with_read_step(tracks, path, reader, arguments)


def _warn_of_unit(path: Path, spread: float) -> None:
    """Warn where markers never spread farther than this many millimetres, if that is odd."""
    if 0 < spread < _SMALLEST:
        warnings.warn(
            f"{path}: the markers are never farther apart than {spread:.3g} mm: are these "
            "metres? The reader takes millimetres; scale the recording if they are not",
            MocapFitWarning,
            stacklevel=5,
        )


def _unseen(path: Path, frames: int) -> FileFormatError:
    return FileFormatError(
        "no marker is seen in any frame",
        path=path,
        found=f"{frames} frames with gaps only",
        advice="Export a recording whose markers are identified.",
    )


class Stretches:
    """Marker tracks of a file stretch by stretch; together they are what `markers` gives.

    Parameters
    ----------
    path, reader, names, rate, start_time, events, arguments, unit_is_known
        As for `markers`.
    """

    def __init__(
        self,
        path: Path,
        reader: str,
        names: Sequence[str],
        rate: float,
        *,
        start_time: float = 0.0,
        events: Sequence[Event] = (),
        arguments: Mapping[str, Any] | None = None,
        unit_is_known: bool = False,
    ) -> None:
        self._path, self._reader, self._arguments = path, reader, arguments
        self._names, self._rate, self._start = tuple(names), rate, start_time
        self._events, self._unit_is_known = tuple(events), unit_is_known
        self._frames, self._seen, self._spread = 0, False, 0.0

    def part(self, positions: FloatArray, origin: NDArray[np.uint8] | None = None) -> MarkerTracks:
        """The next stretch: `(frames, markers, 3)` and `(frames, markers)`.

        Raises
        ------
        MocapFitError
            With the file's name, if it is impossible.
        """
        _check_size(self._path, positions, self._frames)
        if not self._unit_is_known and len(self._names) >= 3:
            low = np.min(positions, axis=1, initial=np.inf, where=~np.isnan(positions))
            high = np.max(positions, axis=1, initial=-np.inf, where=~np.isnan(positions))
            self._spread = max(self._spread, float(np.max(high - low)))
        try:
            tracks = MarkerTracks(
                self._names,
                self._rate,
                positions,
                origin,  # type: ignore[arg-type]
                start_time=self._start + self._frames / self._rate,
                name=self._path.stem,
                events=self._events,
            )
        except DataError as error:
            raise add_path(error, self._path) from None
        self._seen = self._seen or bool(tracks.visible.any())
        self._frames += tracks.frames
        return _with_read_step(tracks, self._path, self._reader, self._arguments)

    def finish(self) -> None:
        """Say what only the whole recording shows.

        Raises
        ------
        FileFormatError
            If there was no frame, or no marker in any.

        Warns
        -----
        MocapFitWarning
            If the unit is probably not the millimetre.
        """
        if not self._frames:
            raise FileFormatError(
                "the recording has no frames", path=self._path, expected="one or more"
            )
        _warn_of_unit(self._path, self._spread)
        if not self._seen:
            raise _unseen(self._path, self._frames)


def poses(
    path: Path,
    reader: str,
    names: Sequence[str],
    rate: float,
    rotations: FloatArray,
    translations: FloatArray,
    residuals: FloatArray,
    *,
    start_time: float = 0.0,
    events: Sequence[Event] = (),
    arguments: Mapping[str, Any] | None = None,
) -> PoseTracks:
    """Pose tracks of a file.

    Raises
    ------
    MocapFitError
        With the file's name, if the tracks are impossible or no body is ever seen.
    """
    _check_size(path, translations)
    try:
        tracks = PoseTracks(
            tuple(names),
            rate,
            rotations,
            translations,
            residuals,
            start_time=start_time,
            name=path.stem,
            events=tuple(events),
        )
    except DataError as error:
        raise add_path(error, path) from None
    if np.isnan(tracks.translations).all():
        raise FileFormatError(
            "no body is seen in any frame",
            path=path,
            found=f"{tracks.frames} frames with gaps only",
            advice="Export a recording whose bodies are tracked.",
        )
    return _with_read_step(tracks, path, reader, arguments)


def _check_size(path: Path, positions: FloatArray, before: int = 0) -> None:
    if len(positions) == 0:
        raise FileFormatError("the recording has no frames", path=path, expected="one or more")
    far = np.abs(positions) > _FARTHEST
    if far.any():
        frame = before + int(np.argwhere(far)[0][0])
        raise FileFormatError(
            "a position is not possible",
            path=path,
            frame=frame,
            found=f"{positions[far][0]:g} mm",
            expected=f"within {_FARTHEST:g} mm",
            advice="Check the file and its unit of length.",
        )


def _with_read_step(
    tracks: _AnyTracks, path: Path, reader: str, arguments: Mapping[str, Any] | None
) -> _AnyTracks:
    # The file's name without its folder: the same input gives the same bytes anywhere.
    step = {"reader": reader, "file": path.name, **(arguments or {})}
    return dataclasses.replace(tracks).add_step("read", step)
