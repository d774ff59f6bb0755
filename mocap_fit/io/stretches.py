"""Long recordings a stretch at a time, so that memory does not grow with their length."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np

from mocap_fit.io.number_table import NumberTable
from mocap_fit.io.readers import READERS, find_reader, read, wrong_kind
from mocap_fit.io.text import checked_file
from mocap_fit.io.timing import check_consecutive, check_growing
from mocap_fit.tracks import FloatArray, MarkerTracks

FRAMES = 4096
"""Frames of a stretch, where nothing else is asked."""


def reads_in_stretches(path: str | os.PathLike[str]) -> bool:
    """Whether the reader of a file's format holds no more of it than a stretch.

    Raises
    ------
    FileFormatError
        If no reader takes the file.
    """
    return hasattr(READERS.get(find_reader(checked_file(path))), "stretches")


def read_stretches(
    path: str | os.PathLike[str],
    *,
    reader: str | None = None,
    names: Sequence[str] | None = None,
    rate: float | None = None,
    frames: int = FRAMES,
) -> Iterator[MarkerTracks]:
    """Read the markers of a recording stretch by stretch.

    Parameters
    ----------
    path, reader, names, rate
        As for `mocap_fit.io.read_tracks`.
    frames
        Frames of a stretch; the last may have fewer.

    Yields
    ------
    MarkerTracks
        Put together they are what `read_tracks` gives. Formats that have no way to do so are
        read whole first; `reads_in_stretches` tells.

    Raises
    ------
    MocapFitError
        If the file cannot be read. What is wrong farther on in the file shows when it is reached.
    """
    file = checked_file(path)
    name = find_reader(file) if reader is None else reader
    chosen = READERS.get(name)
    if hasattr(chosen, "stretches"):
        parts: Iterable[object] = chosen.stretches(file, names=names, rate=rate, frames=frames)
    else:
        parts = _cut(read(file, reader=name, names=names, rate=rate), frames)
    for part in parts:
        if not isinstance(part, MarkerTracks):
            raise wrong_kind(path, part, "markers")  # type: ignore[arg-type]
        yield part


def _cut(tracks: object, frames: int) -> Iterator[object]:
    if not isinstance(tracks, MarkerTracks):
        yield tracks
        return
    for start in range(0, tracks.frames, frames):
        part = slice(start, start + frames)
        yield tracks.replace(
            positions=tracks.positions[part],
            origin=tracks.origin[part],
            start_time=tracks.start_time + start / tracks.rate,
        )


class InOrder:
    """The tables of one file, whose frame numbers and times must go on from one to the next.

    Parameters
    ----------
    tables
        The rows of the file.
    frame, time
        Columns of the frame number and the time, where there are any to look at.
    path
        The file, for messages.
    """

    def __init__(
        self, tables: Iterable[NumberTable], frame: int | None, time: int | None, path: Path
    ) -> None:
        self._tables, self._frame, self._time, self._path = tables, frame, time, path
        self.rows = 0
        """Rows so far."""
        self.last = np.zeros((0, 0))
        """The last of them, `(1, columns)`."""
        self.line = np.zeros(0, dtype=np.intp)
        """And its line, `(1,)`."""

    def __iter__(self) -> Iterator[NumberTable]:
        for table in self._tables:
            lines = np.concatenate([self.line, table.lines])
            if self._frame is not None:
                check_consecutive(self._with_last(table, self._frame), path=self._path, lines=lines)
            if self._time is not None:
                values = self._with_last(table, self._time)
                check_growing(values, "time", path=self._path, lines=lines)
            self.rows += len(table.values)
            self.last, self.line = table.values[-1:].copy(), table.lines[-1:]
            yield table

    def _with_last(self, table: NumberTable, column: int) -> FloatArray:
        before = self.last[:, column] if self.rows else np.zeros(0)
        return np.concatenate([before, table.values[:, column]])


def rows_of(tables: Iterable[NumberTable], first: int, frames: int) -> Iterator[FloatArray]:
    """The numbers of all tables from a column on, as `(frames, markers, 3)`, so many at a time."""
    waiting: list[FloatArray] = []
    count = 0
    for table in tables:
        waiting.append(table.values[:, first:].reshape(len(table.values), -1, 3))
        count += len(table.values)
        if count >= frames:
            block = np.concatenate(waiting)
            whole = count - count % frames
            for start in range(0, whole, frames):
                yield block[start : start + frames]
            waiting, count = [block[whole:].copy()], count - whole
    if count:
        yield np.concatenate(waiting)
