"""The registry of readers, and the functions that find the one for a file.

A reader is a module (or any object) with what `Reader` lists. A laboratory adds its own by an
entry point in the group ``mocap_fit.readers``; its name is the format's name.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import Any, Protocol

from mocap_fit.errors import (
    DataError,
    MocapFitError,
    from_os_error,
)
from mocap_fit.io.text import checked_file
from mocap_fit.registry import Registry
from mocap_fit.tracks import MarkerTracks, PoseTracks, Tracks

READERS = Registry("mocap_fit.readers", "reader")


class Reader(Protocol):
    """What reads one format; a module with these names is one."""

    @property
    def description(self) -> str:
        """The format, in a few words."""

    @property
    def extensions(self) -> tuple[str, ...]:
        """Usual endings of the file's name, in lower case, with their points."""

    def sniff(self, path: str | os.PathLike[str]) -> bool:
        """Whether a file looks like this format: fast, from its first bytes, never an error."""

    def read(
        self,
        path: str | os.PathLike[str],
        *,
        names: Sequence[str] | None = None,
        rate: float | None = None,
    ) -> Tracks:
        """Read a file.

        The names and the rate of the caller replace the file's own. Every problem is a
        `MocapFitError` that names the file.

        A reader may also have ``stretches``, which takes a number of ``frames`` besides and gives
        the tracks so many at a time, without holding more; see `mocap_fit.io.read_stretches`.
        """


def find_reader(path: str | os.PathLike[str]) -> str:
    """Return the name of the reader for a file; see `Registry.find`.

    Parameters
    ----------
    path
        The file.

    Returns
    -------
    str
        The reader's name, such as ``qualisys-tsv``.

    Raises
    ------
    MissingFileError
        If there is no such file.
    FileFormatError
        If the file is empty or cannot be read, or no reader takes it.
    RegistryError
        If a reader of another distribution fails.

    Warns
    -----
    MocapFitWarning
        If a reader cannot be loaded; it is passed over.
    """
    return READERS.find(checked_file(path))


def read(
    path: str | os.PathLike[str],
    *,
    reader: str | None = None,
    names: Sequence[str] | None = None,
    rate: float | None = None,
) -> Tracks:
    """Read a recording of any known format.

    Parameters
    ----------
    path
        The file.
    reader
        Name of the format, such as ``qualisys-tsv``; found from the file where not given.
    names
        Names of the markers or bodies in the order of the file, in place of the file's own.
    rate
        Frames per second, in place of the file's own.

    Returns
    -------
    MarkerTracks, PoseTracks or ParameterTracks
        What the file holds: millimetres, seconds, NaN where something is missing.

    Raises
    ------
    MocapFitError
        If the file cannot be read.
    """
    file = checked_file(path)
    name = find_reader(file) if reader is None else reader
    chosen = _reader(name)
    try:
        with READERS.guard(name, file):
            return chosen.read(file, names=names, rate=rate)
    except MocapFitError:
        raise
    except OSError as error:
        raise from_os_error(error, path) from None


def read_tracks(
    path: str | os.PathLike[str],
    *,
    reader: str | None = None,
    names: Sequence[str] | None = None,
    rate: float | None = None,
) -> MarkerTracks:
    """Read the markers of a recording; parameters as for `read`.

    Raises
    ------
    MocapFitError
        If the file cannot be read.
    DataError
        If it holds something else than markers.
    """
    tracks = read(path, reader=reader, names=names, rate=rate)
    if isinstance(tracks, MarkerTracks):
        return tracks
    raise wrong_kind(path, tracks, "markers")


def read_poses(
    path: str | os.PathLike[str],
    *,
    reader: str | None = None,
    names: Sequence[str] | None = None,
    rate: float | None = None,
) -> PoseTracks:
    """Read the poses of rigid bodies; parameters as for `read`.

    Raises
    ------
    MocapFitError
        If the file cannot be read.
    DataError
        If it holds something else than poses.
    """
    tracks = read(path, reader=reader, names=names, rate=rate)
    if isinstance(tracks, PoseTracks):
        return tracks
    raise wrong_kind(path, tracks, "poses of rigid bodies")


def describe(
    path: str | os.PathLike[str],
    *,
    reader: str | None = None,
    names: Sequence[str] | None = None,
    rate: float | None = None,
) -> dict[str, Any]:
    """What a recording holds, as plain values that JSON can hold; parameters as for `read`.

    Returns
    -------
    dict
        ``file``, ``format``, ``description``, ``content`` (``markers``, ``poses`` or
        ``parameters``), ``name``, ``frames``, ``rate``, ``duration``, ``start_time``, ``units``,
        one list of ``markers``, ``bodies`` or ``parameters`` (each with its ``name`` and its
        ``gap_rate``, the share of frames in which it is missing), ``events`` (``name``,
        ``time``), and ``provenance``.

    Raises
    ------
    MocapFitError
        If the file cannot be read.
    """
    file = checked_file(path)
    name = find_reader(file) if reader is None else reader
    tracks = read(file, reader=name, names=names, rate=rate)
    about = {"file": os.fspath(path), "format": name, "description": _reader(name).description}
    return about | tracks.describe()


def _reader(name: str) -> Reader:
    reader: Reader = READERS.get(name)
    return reader


def wrong_kind(path: str | os.PathLike[str], tracks: Tracks, wanted: str) -> MocapFitError:
    """The error for a file that holds something else than is wanted."""
    if isinstance(tracks, MarkerTracks):
        found, advice = "markers", "Read it with read_tracks."
    elif isinstance(tracks, PoseTracks):
        found = "poses of rigid bodies"
        advice = "Read it with read_poses, or export the 3D markers."
    else:
        found, advice = "face parameters", "Read it with mocap_fit.tracks.read_parquet."
    return DataError(
        f"the file does not hold {wanted}", path=path, found=found, expected=wanted, advice=advice
    )
