"""The registry of readers, and the functions that find the one for a file.

A reader is a module (or any object) with what `Reader` lists. A laboratory adds its own by an
entry point in the group ``mocap_fit.readers``; its name is the format's name.
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np

from mocap_fit.errors import (
    DataError,
    FileFormatError,
    MocapFitError,
    MocapFitWarning,
    RegistryError,
)
from mocap_fit.io.text import checked_file, unreadable
from mocap_fit.registry import Registry
from mocap_fit.tracks import MarkerTracks, ParameterTracks, PoseTracks

READERS = Registry("mocap_fit.readers", "reader")

Tracks = MarkerTracks | PoseTracks | ParameterTracks


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
    """Name of the reader for a file.

    A reader takes a file by what is in it. Where several do, the one with the file's ending
    comes first, then the first by name. Where none does, the file's ending decides, so that a
    damaged file or one without a header still gets to its reader.

    Raises
    ------
    FileFormatError
        If the file is missing, empty or unreadable, or no reader takes it.
    RegistryError
        If a reader fails on the question.

    Warns
    -----
    MocapFitWarning
        If a reader cannot be loaded; it is passed over.
    """
    file = checked_file(path)
    ending = file.suffix.lower()
    loaded: dict[str, Reader] = {}
    for name in READERS.names():
        try:
            loaded[name] = _reader(name)
        except RegistryError as error:
            # One laboratory's broken reader must not stop the others.
            warnings.warn(str(error), MocapFitWarning, stacklevel=2)
    by_ending = [name for name, reader in loaded.items() if ending in reader.extensions]
    others = [name for name in loaded if name not in by_ending]
    for name in by_ending + others:
        try:
            takes = loaded[name].sniff(file)
        except Exception as error:
            raise RegistryError(
                f"the reader '{name}' of {READERS.source(name)} fails to look at {file}",
                found=f"{type(error).__name__}: {error}",
                advice="Choose the reader yourself (reader=...), or tell its authors.",
            ) from error
        if takes:
            return name
    if by_ending:
        return by_ending[0]
    raise FileFormatError(
        "no reader takes this file",
        path=path,
        expected=", ".join(
            f"{name} ({' '.join(reader.extensions)})" for name, reader in loaded.items()
        ),
        advice="Export the recording in one of these formats.",
    )


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
        return chosen.read(file, names=names, rate=rate)
    except MocapFitError:
        raise
    except OSError as error:
        raise unreadable(path, error) from None
    except Exception as error:
        source = READERS.source(name)
        if source == "mocap-fit":
            raise
        raise RegistryError(
            f"the reader '{name}' of {source} fails on {file}",
            found=f"{type(error).__name__}: {error}",
            advice="Choose another reader (reader=...), or tell its authors.",
        ) from error


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
    if isinstance(tracks, MarkerTracks):
        content, noun, missing = "markers", "markers", ~tracks.visible
    elif isinstance(tracks, PoseTracks):
        content, noun = "poses", "bodies"
        missing = np.asarray(np.isnan(tracks.translations).any(axis=2))
    else:
        content, noun, missing = "parameters", "parameters", np.isnan(tracks.values)
    rates = missing.mean(axis=0) if tracks.frames else np.zeros(len(tracks.names))
    return {
        "file": os.fspath(path),
        "format": name,
        "description": _reader(name).description,
        "content": content,
        "name": tracks.name,
        "frames": tracks.frames,
        "rate": tracks.rate,
        "duration": tracks.duration,
        "start_time": tracks.start_time,
        "units": "rest to full gesture: 0 to 1" if content == "parameters" else "mm",
        noun: [
            {"name": label, "gap_rate": float(gap_rate)}
            for label, gap_rate in zip(tracks.names, rates, strict=True)
        ],
        "events": [{"name": event.name, "time": event.time} for event in tracks.events],
        "provenance": [step.to_dict() for step in tracks.provenance],
    }


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
