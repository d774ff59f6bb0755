"""The Parquet files of mocap-fit: markers, poses or parameters, one recording a file."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from mocap_fit.errors import FileFormatError, MocapFitError, add_path
from mocap_fit.io import finalise
from mocap_fit.io.names import TrackNames, name_tracks
from mocap_fit.io.text import check_file, read_head
from mocap_fit.io.timing import check_rate
from mocap_fit.tracks import FloatArray, MarkerTracks, ParameterTracks, PoseTracks, Tracks, storage

NAME = "parquet"
description = "Parquet file of mocap-fit"
extensions = (".parquet",)

_MAGIC = b"PAR1"


def sniff(path: str | os.PathLike[str]) -> bool:
    """Return whether a file is Parquet that mocap-fit wrote.

    Parameters
    ----------
    path
        The file.

    Returns
    -------
    bool
        Whether it is.
    """
    try:
        return read_head(path, 4) == _MAGIC and storage.is_tracks_file(path)
    except UnicodeDecodeError:
        # A damaged description: `read` reports it.
        return False


def read(
    path: str | os.PathLike[str],
    *,
    names: Sequence[str] | None = None,
    rate: float | None = None,
    unit: str | None = None,
    subject: str | None = None,
) -> Tracks:
    """Read a file that `mocap_fit.tracks.write_parquet` wrote.

    The provenance is that of the file; a step is added only where an option is given.

    Parameters
    ----------
    path
        File to read.
    names
        Names of the tracks, in the order of the file; they replace those of the file.
    rate
        Frame rate, hertz; it replaces that of the file.
    unit
        Unit of length of the file, such as ``m``; it replaces that of the file.
    subject
        Subject whose tracks alone are read, where the names have subjects.

    Returns
    -------
    Tracks
        Markers, poses or parameters, as they were written.

    Raises
    ------
    FileFormatError
        If it is another file, or a damaged one.
    """
    file = check_file(path)
    if read_head(file, 4) != _MAGIC:
        raise FileFormatError(
            "this is not a Parquet file",
            path=path,
            expected="a file that starts with PAR1",
            advice="Check that it is the file you mean.",
        )
    try:
        tracks = storage.read_parquet(file)
    except MocapFitError as error:
        if isinstance(error.found, Exception):
            # The message of the library underneath does not help a user.
            raise _create_damage_error(path) from None
        raise add_path(error, file) from None
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        raise _create_damage_error(path) from None
    if tracks.frames == 0:
        raise FileFormatError("the recording has no frames", path=path, expected="one or more")
    if not isinstance(tracks, ParameterTracks):
        finalise.check_visible(tracks, file)
    if names is None and rate is None and unit is None and subject is None:
        return tracks
    changes: dict[str, Any] = {}
    used = TrackNames(tracks.names, tracks.names, tuple(range(len(tracks.names))))
    if names is not None or subject is not None:
        used = name_tracks(tracks.names, names, path=file, subject=subject, noun=tracks.noun)
        changes["names"] = used.names
        if len(used.names) < len(tracks.names):
            tracks = tracks.select([tracks.names[column] for column in used.columns])
    if rate is not None:
        changes["rate"] = check_rate(rate, path=file)
    if unit is not None:
        changes |= _scale_lengths(tracks, finalise.get_millimetres(unit, path=file), file)
    tracks = tracks.replace(**changes)
    arguments = finalise.list_arguments(used, rate, unit)
    return tracks.add_step("read", {"reader": NAME, "file": file.name, **arguments})


def _scale_lengths(tracks: Tracks, scale: float, path: Path) -> dict[str, FloatArray]:
    """Return the arrays of lengths, scaled."""
    if isinstance(tracks, MarkerTracks):
        return {"positions": tracks.positions * scale}
    if isinstance(tracks, PoseTracks):
        return {"translations": tracks.translations * scale, "residuals": tracks.residuals * scale}
    raise FileFormatError(
        f"{tracks.kind} have no unit of length", path=path, advice="Leave the unit out."
    )


def _create_damage_error(path: str | os.PathLike[str]) -> FileFormatError:
    return FileFormatError(
        "this Parquet file is damaged or cut short",
        path=path,
        expected="a file as mocap-fit wrote it",
        advice="Copy it again, or write it again.",
    )
