"""Tracks into Parquet, at once or a stretch at a time: the same bytes."""

from __future__ import annotations

import os
from collections.abc import Mapping
from types import TracebackType
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from mocap_fit.errors import DataError
from mocap_fit.tracks.parquet_file import TableWriter
from mocap_fit.tracks.storage import Tracks, columns_of, metadata_of


class TracksWriter:
    """Writes tracks stretch by stretch; the file is there when all is written, or not at all.

    Use it in a ``with`` statement; what was written so far goes where an error ends it.

    Parameters
    ----------
    path
        The file; one that exists is replaced.

    Raises
    ------
    FileFormatError
        If the file cannot be written.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self._writer = TableWriter(path)
        self._first: Tracks | None = None
        self._frames = 0

    def __enter__(self) -> Self:
        self._writer.__enter__()
        return self

    def write(self, tracks: Tracks, extra_columns: Mapping[str, ArrayLike] | None = None) -> None:
        """Add a stretch: `parquet_file.ROW_GROUP` frames, or any number in the last.

        Rate, start time, events and provenance are those of the first.

        Raises
        ------
        DataError
            If two columns would have one name, or an extra one has the wrong length.
        FileFormatError
            If the file cannot be written.
        """
        import pyarrow as pa

        columns = columns_of(tracks)
        for name, values in (extra_columns or {}).items():
            array = np.asarray(values)
            if name in columns or name == "utterance":
                raise DataError("two columns of the table would have one name", found=name)
            if array.shape != (tracks.frames,):
                raise DataError(
                    f"the column '{name}' has the wrong length",
                    found=array.shape,
                    expected=(tracks.frames,),
                )
            columns[name] = array
        first = self._first or tracks
        numbers = np.arange(self._frames, self._frames + tracks.frames)
        columns["time"] = first.start_time + numbers / first.rate
        arrays = {"utterance": pa.array([tracks.name] * tracks.frames, type=pa.string())}
        arrays.update({name: pa.array(np.ascontiguousarray(a)) for name, a in columns.items()})
        self._writer.write(arrays, metadata_of(first))
        self._first = first
        self._frames += tracks.frames

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._writer.__exit__(kind, error, traceback)


def write_parquet(
    tracks: Tracks,
    path: str | os.PathLike[str],
    extra_columns: Mapping[str, ArrayLike] | None = None,
) -> None:
    """Write tracks as one Parquet file, whole or not at all.

    Parameters
    ----------
    tracks
        Markers, poses or parameters.
    path
        The file; one that exists is replaced.
    extra_columns
        More columns of `(frames,)` each, for other programs; `read_parquet` leaves them out.

    Raises
    ------
    DataError
        If two columns would have one name, or an extra one has the wrong length.
    FileFormatError
        If the file cannot be written.
    """
    with TracksWriter(path) as writer:
        writer.write(tracks, extra_columns)
