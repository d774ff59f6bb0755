"""The last step of every reader: checked tracks with the name of the file and their provenance."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from mocap_fit.errors import DataError, FileFormatError, MocapFitWarning, add_path
from mocap_fit.io.names import TrackNames
from mocap_fit.tracks import Event, FloatArray, Tracks

_MILLIMETRES = {
    **dict.fromkeys(("mm", "millimeters", "millimetres"), 1.0),
    **dict.fromkeys(("cm", "centimeters", "centimetres"), 10.0),
    **dict.fromkeys(("dm", "decimeters", "decimetres"), 100.0),
    **dict.fromkeys(("m", "meters", "metres"), 1000.0),
    **dict.fromkeys(("in", "inches"), 25.4),
    **dict.fromkeys(("ft", "foot", "feet"), 304.8),
    **dict.fromkeys(("um", "micrometers", "micrometres"), 0.001),
}
_SHORTEST = 3
"""Letters to which a name may be cut, as some programs do."""

FARTHEST = 1e7
"""Millimetres: no marker is ten kilometres away."""

_SMALLEST = 2.0
"""Millimetres: three or more markers that never spread so far are probably in metres."""

_AnyTracks = TypeVar("_AnyTracks", bound=Tracks)


def get_millimetres(unit: str, *, path: Path, line: int | None = None) -> float:
    """Return the number of millimetres in a unit of length.

    Parameters
    ----------
    unit
        Name of the unit, in any case.
    path
        File for the message.
    line
        Line for the message.

    Returns
    -------
    float
        Millimetres.

    Raises
    ------
    FileFormatError
        If the unit is not known.
    """
    name = unit.strip().lower()
    for known, factor in _MILLIMETRES.items():
        if name == known or (len(name) >= _SHORTEST and known.startswith(name)):
            return factor
    raise FileFormatError(
        "the unit of length is not known",
        path=path,
        line=line,
        found=f"'{unit}'",
        expected="mm, cm, dm, m, in or ft",
        advice="Give the unit (--unit, or unit= in Python), or export in millimetres.",
    )


def list_arguments(
    used: TrackNames, rate: float | None = None, unit: str | None = None
) -> dict[str, Any]:
    """Return the arguments of a reader for the provenance.

    Parameters
    ----------
    used
        Names of the tracks: those of the caller are noted, and subject and doubled labels.
    rate
        Frame rate of the caller, hertz; None for that of the file.
    unit
        Unit of length; None where nobody said it.

    Returns
    -------
    dict
        What the caller set, and what the file said.
    """
    return {
        **({} if unit is None else {"unit": unit}),
        **({} if used.subject is None else {"subject": used.subject}),
        **({"renamed": dict(used.renamed)} if used.renamed else {}),
        **({"names": list(used.names)} if used.from_caller else {}),
        **({} if rate is None else {"rate": float(rate)}),
    }


def mark_zeros(positions: FloatArray) -> FloatArray:
    """Return positions with NaN where all three coordinates are 0, as some formats write gaps.

    Parameters
    ----------
    positions
        Positions, ``(frames, markers, 3)``, in any unit of length.

    Returns
    -------
    ndarray
        Positions, ``(frames, markers, 3)``, in the same unit.
    """
    return np.where((positions == 0).all(axis=2, keepdims=True), np.nan, positions)


def create_tracks(
    kind: type[_AnyTracks],
    path: Path,
    reader: str,
    used: TrackNames,
    rate: float,
    arrays: Mapping[str, NDArray[Any]],
    *,
    start_time: float = 0.0,
    events: Sequence[Event] = (),
    arguments: Mapping[str, Any] | None = None,
    unit_is_known: bool = True,
) -> _AnyTracks:
    """Create the tracks of a file.

    Parameters
    ----------
    kind
        Type of the tracks.
    path
        File that was read.
    reader
        Name of the reader.
    used
        Names of the tracks that are read.
    rate
        Frame rate, hertz.
    arrays
        Arrays of all tracks of the file by name, such as positions, ``(frames, markers, 3)``,
        millimetres; NaN where missing.
    start_time
        Time of the first frame, seconds.
    events
        Events of the recording.
    arguments
        Arguments of the reader for the provenance.
    unit_is_known
        Whether the file states its unit; otherwise the size of the positions is checked.

    Returns
    -------
    Tracks
        Tracks of the given type, with the name of the file and a first step of provenance.

    Raises
    ------
    MocapFitError
        With the name of the file, if the tracks are invalid or nothing is ever visible.

    Warns
    -----
    MocapFitWarning
        If the markers are so close to each other that the unit is probably not the millimetre.
    """
    if used.columns != tuple(range(len(used.labels))):
        arrays = {name: array[:, list(used.columns)] for name, array in arrays.items()}
    locations = arrays[kind.arrays[0].attribute]
    _check_locations(path, locations)
    if not unit_is_known and len(used.names) >= 3:
        _warn_of_unit(path, locations)
    try:
        tracks = kind(
            used.names,
            rate,
            start_time=start_time,
            name=path.stem,
            events=tuple(events),
            **dict[str, Any](arrays),
        )
    except DataError as error:
        raise add_path(error, path) from None
    check_visible(tracks, path)
    # The name of the file without its folder: the same input gives the same bytes anywhere.
    step = {"reader": reader, "file": path.name, **(arguments or {})}
    return tracks.add_step("read", step)


def check_visible(tracks: Tracks, path: Path) -> None:
    """Refuse tracks that are missing in all frames.

    Parameters
    ----------
    tracks
        Markers, poses or parameters.
    path
        File for messages.

    Raises
    ------
    FileFormatError
        If there are only gaps.
    """
    if not tracks.visible.any():
        raise FileFormatError(
            f"no {tracks.noun} is seen in any frame",
            path=path,
            found=f"{tracks.frames} frames with gaps only",
            advice=f"Export a recording with tracked {tracks.plural}.",
        )


def _warn_of_unit(path: Path, positions: FloatArray) -> None:
    # NaN compares false, so that gaps do not matter.
    visible = ~np.isnan(positions)
    low = np.min(positions, axis=1, initial=np.inf, where=visible)
    high = np.max(positions, axis=1, initial=-np.inf, where=visible)
    spread = float(np.max(high - low))
    if 0 < spread < _SMALLEST:
        warnings.warn(
            f"{path}: the markers are never farther apart than {spread:.3g} mm: are these "
            "metres? Millimetres are taken; if they are, give the unit (--unit m, or unit='m' in "
            "Python)",
            MocapFitWarning,
            stacklevel=5,
        )


def _check_locations(path: Path, positions: FloatArray) -> None:
    if len(positions) == 0:
        raise FileFormatError("the recording has no frames", path=path, expected="one or more")
    # Gaps do not count.
    low = np.fmin.reduce(positions, axis=None, initial=0.0)
    high = np.fmax.reduce(positions, axis=None, initial=0.0)
    if max(-low, high) > FARTHEST:
        far = np.abs(positions) > FARTHEST
        raise FileFormatError(
            "a position is out of range",
            path=path,
            frame=int(np.argwhere(far)[0][0]),
            found=f"{positions[far][0]:g} mm",
            expected=f"within {FARTHEST:g} mm",
            advice="Check the file and its unit of length.",
        )
