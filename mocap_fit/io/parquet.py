"""The Parquet files that mocap-fit writes: markers, poses or parameters, one recording a file."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import Any

import numpy as np

from mocap_fit.errors import FileFormatError, MocapFitError, add_path
from mocap_fit.io import finalise
from mocap_fit.io.text import checked_file, read_head
from mocap_fit.io.timing import checked_rate
from mocap_fit.tracks import MarkerTracks, PoseTracks, Tracks, storage

NAME = "parquet"
description = "Parquet file of mocap-fit"
extensions = (".parquet",)

_MAGIC = b"PAR1"


def sniff(path: str | os.PathLike[str]) -> bool:
    """Whether the file is Parquet that mocap-fit wrote."""
    try:
        return read_head(path, 4) == _MAGIC and storage.is_tracks_file(path)
    except UnicodeDecodeError:
        # A damaged description: `read` says so.
        return False


def read(
    path: str | os.PathLike[str],
    *,
    names: Sequence[str] | None = None,
    rate: float | None = None,
) -> Tracks:
    """Read what `mocap_fit.tracks.write_parquet` wrote.

    The provenance is the file's own; a step is added only where names or a rate are given.

    Parameters
    ----------
    path
        The file.
    names, rate
        In place of the file's own.

    Raises
    ------
    FileFormatError
        If it is another file, or a damaged one.
    """
    file = checked_file(path)
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
            # The words of the library underneath tell a user nothing.
            raise _damaged(path) from None
        raise add_path(error, file) from None
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        raise _damaged(path) from None
    if tracks.frames == 0:
        raise FileFormatError("the recording has no frames", path=path, expected="one or more")
    if isinstance(tracks, MarkerTracks) and not tracks.visible.any():
        raise FileFormatError("no marker is seen in any frame", path=path)
    if isinstance(tracks, PoseTracks) and np.isnan(tracks.translations).all():
        raise FileFormatError("no body is seen in any frame", path=path)
    changes: dict[str, Any] = {}
    if names is not None:
        changes["names"] = finalise.chosen_names(tracks.names, names, path=file, noun="track")
    if rate is not None:
        changes["rate"] = checked_rate(rate, path=file)
    if not changes:
        return tracks
    arguments = {key: list(v) if key == "names" else v for key, v in changes.items()}
    step = {"reader": NAME, "file": file.name, **arguments}
    return tracks.replace(**changes).add_step("read", step)


def _damaged(path: str | os.PathLike[str]) -> FileFormatError:
    return FileFormatError(
        "this Parquet file is damaged or cut short",
        path=path,
        expected="a file as mocap-fit wrote it",
        advice="Copy it again, or write it again.",
    )
