"""Tracks to and from pandas and Parquet.

A Parquet file has one row a frame, with plain columns that pandas, polars and dask read as they
are: `utterance` (the name of the tracks), `time` in seconds, and then

- parameters: a column a parameter, ``PARAMETER_sd`` each, ``residual_mm``;
- markers: ``MARKER_x``, ``MARKER_y``, ``MARKER_z`` in millimetres, ``MARKER_origin`` (a code of
  `Origin`);
- poses: ``BODY_x``, ``BODY_y``, ``BODY_z``, the rotation matrix ``BODY_r11`` (row 1, column 1) to
  ``BODY_r33``, ``BODY_residual_mm``.

What a table cannot hold (rate, start time, names in order, events, provenance) is JSON in the
schema's metadata under the key ``mocap_fit``. The same tracks give the same bytes.
"""

from __future__ import annotations

import json
import os
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from mocap_fit.errors import DataError
from mocap_fit.tracks.arrays import TrackArray
from mocap_fit.tracks.base import Tracks
from mocap_fit.tracks.interpolation import flatten_tracks
from mocap_fit.tracks.parquet_file import from_damaged_table, read_kind, read_table, write_table
from mocap_fit.tracks.provenance import Event, Step
from mocap_fit.tracks.types import TRACK_KINDS

if TYPE_CHECKING:
    import pandas as pd

Kind = Literal["markers", "poses", "parameters"]
Columns = Mapping[str, np.ndarray[Any, Any]]

_KEY = "mocap_fit"
_ADVICE = "Read a table of another program with pandas and give it to from_frame."


class _Column(NamedTuple):
    """A column of a table, and where its numbers are in the tracks."""

    name: str
    array: TrackArray
    # Into the array with its trailing axes flattened.
    key: tuple[slice | int, ...]


def _list_columns(kind: type[Tracks], names: Sequence[str]) -> list[_Column]:
    """Return the columns after `utterance` and `time`, in order."""

    def list_of(array: TrackArray, track: int) -> Iterator[_Column]:
        if array.has_names or track == 0:
            for k, column in enumerate(array.name_columns(names[track])):
                key = (slice(None), track, k) if array.has_names else (slice(None),)
                yield _Column(column, array, key)

    tracks = range(len(names))
    if kind.columns_by_track:
        pairs = [(array, track) for track in tracks for array in kind.arrays]
    else:
        pairs = [(array, track) for array in kind.arrays for track in tracks]
    return [column for array, track in pairs for column in list_of(array, track)]


def _to_columns(tracks: Tracks) -> dict[str, np.ndarray[Any, Any]]:
    """Return the columns after `utterance`, by name."""
    columns = _list_columns(type(tracks), tracks.names)
    names = [column.name for column in columns]
    reserved = {"utterance", "time"} & set(names)
    twice = sorted(reserved | {name for name, count in Counter(names).items() if count > 1})
    if twice:
        raise DataError(
            "two columns of the table would have one name",
            found=", ".join(twice),
            advice="Rename that track.",
        )
    arrays = {array.attribute: getattr(tracks, array.attribute) for array in tracks.arrays}
    arrays |= {
        a.attribute: flatten_tracks(arrays[a.attribute]) for a in tracks.arrays if a.has_names
    }
    return {"time": tracks.times} | {
        column.name: arrays[column.array.attribute][column.key] for column in columns
    }


def _to_plain(value: object) -> object:
    """Return a numpy value as one that JSON can hold."""
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, Mapping):
        return dict(value)
    if isinstance(value, set | frozenset):
        return sorted(value)
    raise DataError(
        "an argument in the provenance cannot be stored",
        found=f"{type(value).__name__} {value!r}",
        expected="numbers, text, lists and mappings of them",
    )


def _to_metadata(tracks: Tracks) -> dict[str, Any]:
    """Return what a table cannot hold, as values that JSON can."""
    description = {
        "kind": tracks.kind,
        "name": tracks.name,
        "names": list(tracks.names),
        "rate": tracks.rate,
        "start_time": tracks.start_time,
        "events": [{"name": event.name, "time": float(event.time)} for event in tracks.events],
        "provenance": [step.to_dict() for step in tracks.provenance],
    }
    # Through JSON and back, so that a frame's metadata and a file's are the same.
    plain: dict[str, Any] = json.loads(json.dumps(description, default=_to_plain))
    return plain


def _assemble(columns: Columns, metadata: Mapping[str, Any], frames: int) -> Tracks:
    """Return tracks made of their columns and metadata."""
    kind = TRACK_KINDS[metadata["kind"]]
    names = tuple(metadata["names"])
    wanted = _list_columns(kind, names)
    missing = [c.name for c in wanted if c.name not in columns and not c.array.is_optional]
    if missing:
        raise DataError("the table lacks a column", expected=", ".join(missing))
    arrays: dict[str, np.ndarray[Any, Any] | None] = {}
    for array in kind.arrays:
        parts = [column for column in wanted if column.array is array]
        missing = [column.name for column in parts if column.name not in columns]
        if len(missing) == len(parts) or (missing and array.dtype is not np.float64):
            arrays[array.attribute] = None
            continue
        unknown = np.full(frames, np.nan)
        stack = np.stack([columns.get(column.name, unknown) for column in parts], axis=-1)
        axes = (len(names), *array.shape) if array.has_names else ()
        arrays[array.attribute] = stack.reshape(frames, *axes)
    return kind(
        names,
        metadata["rate"],
        **arrays,
        start_time=metadata["start_time"],
        name=metadata["name"],
        events=tuple(Event(e["name"], e["time"]) for e in metadata["events"]),
        provenance=tuple(Step.from_dict(step) for step in metadata["provenance"]),
    )


def to_frame(tracks: Tracks) -> pd.DataFrame:
    """Convert tracks to a pandas data frame, one row a frame of the recording.

    Parameters
    ----------
    tracks
        Markers, poses or parameters.

    Returns
    -------
    pandas.DataFrame
        The columns that this module's text lists. Rate, events and provenance are in its `attrs`,
        so that `from_frame` gives the same tracks back.

    Raises
    ------
    DataError
        If two columns would have one name.
    """
    import pandas as pd

    frame = pd.DataFrame({"utterance": tracks.name, **_to_columns(tracks)})
    frame["utterance"] = frame["utterance"].astype(str)
    frame.attrs[_KEY] = _to_metadata(tracks)
    return frame


def from_frame(
    frame: pd.DataFrame,
    kind: Kind | None = None,
    *,
    rate: float | None = None,
    start_time: float | None = None,
) -> Tracks:
    """Make tracks of a pandas data frame.

    Parameters
    ----------
    frame
        A table with the columns that this module's text lists; `origin`, `_sd` and residual
        columns may be absent, and so may `utterance` and, where the rate is given, `time`.
    kind
        ``markers``, ``poses`` or ``parameters``. Where left out, it is what `to_frame` noted, or
        else what the column names say.
    rate
        Frames per second, hertz; as `to_frame` noted, or else as `time` says, where left out.
    start_time
        Time of the first frame, seconds; likewise.

    Returns
    -------
    MarkerTracks, PoseTracks or ParameterTracks
        The tracks.

    Raises
    ------
    DataError
        If columns are missing, hold text, or times are not evenly spaced.
    """
    noted = frame.attrs.get(_KEY)
    if noted is not None and kind in (None, noted["kind"]):
        metadata = dict(noted)
        # A part of the rows, or other times, are taken for what they are.
        if len(frame) and "time" in frame:
            times = _get_numbers(frame, "time")
            if not np.isclose(times[0], metadata["start_time"], atol=1e-9):
                metadata["start_time"] = float(times[0])
            _check_times(times, metadata["start_time"], rate or metadata["rate"])
    else:
        metadata = _guess_metadata(frame, kind, rate)
    if rate is not None:
        metadata["rate"] = rate
    if start_time is not None:
        metadata["start_time"] = start_time
    wanted = _list_columns(TRACK_KINDS[metadata["kind"]], metadata["names"])
    columns = {c.name: _get_numbers(frame, c.name) for c in wanted if c.name in frame}
    return _assemble(columns, metadata, len(frame))


def _get_numbers(frame: pd.DataFrame, column: str) -> np.ndarray[Any, Any]:
    try:
        return np.asarray(frame[column].to_numpy(dtype=np.float64, na_value=np.nan))
    except (TypeError, ValueError) as error:
        raise DataError(
            f"the column '{column}' does not hold numbers", found=error, expected="numbers"
        ) from None


def _check_times(times: np.ndarray[Any, Any], start: float, rate: float) -> None:
    expected = start + np.arange(len(times)) / rate
    wrong = ~(np.abs(times - expected) < 0.25 / rate)
    if wrong.any():
        frame = int(np.argmax(wrong))
        raise DataError(
            "the times are not evenly spaced",
            frame=frame,
            found=f"{times[frame]:.6g} s",
            expected=f"{expected[frame]:.6g} s",
            advice="Give one utterance at a time, with every frame and missing values as NaN.",
        )


def _guess_metadata(frame: pd.DataFrame, kind: Kind | None, rate: float | None) -> dict[str, Any]:
    """Return what `to_frame` would have noted, from the columns alone."""
    columns = [str(name) for name in frame.columns]
    kind = _guess_kind(columns) if kind is None else kind
    if kind == "parameters":
        known = set(columns)
        names = [
            name
            for name in columns
            if name not in ("utterance", "time", "residual_mm")
            and not (name.endswith("_sd") and name.removesuffix("_sd") in known)
        ]
    else:
        names = [name.removesuffix("_x") for name in columns if name.endswith("_x")]
    utterances = list(frame["utterance"].unique()) if "utterance" in frame else []
    if len(utterances) > 1:
        raise DataError(
            "the table holds more than one utterance",
            found=f"{len(utterances)} of them",
            expected="one",
            advice="Take them apart with groupby('utterance').",
        )
    start, rate = _guess_times(frame, rate)
    return {
        "kind": kind,
        "name": str(utterances[0]) if len(utterances) else "",
        "names": names,
        "rate": rate,
        "start_time": start,
        "events": [],
        "provenance": [],
    }


def _guess_kind(columns: Sequence[str]) -> Kind:
    if any(name.endswith("_r11") for name in columns):
        return "poses"
    return "markers" if any(name.endswith("_x") for name in columns) else "parameters"


def _guess_times(frame: pd.DataFrame, rate: float | None) -> tuple[float, float]:
    """Return start time and rate, checked where the table has times."""
    start = 0.0
    if "time" in frame and len(frame):
        times = _get_numbers(frame, "time")
        start = float(times[0])
        if rate is None and len(times) > 1:
            length = float(times[-1] - times[0])
            # Times are rounded when they are written; a rate has no more than these digits.
            rate = round((len(times) - 1) / length, 9) if length > 0 else 0.0
        if rate is not None and np.isfinite(rate) and rate > 0:
            _check_times(times, start, rate)
    if rate is None:
        raise DataError("the table does not tell its rate", advice="Give rate=, in hertz.")
    return start, rate


def write_parquet(
    tracks: Tracks,
    path: str | os.PathLike[str],
    extra_columns: Mapping[str, ArrayLike] | None = None,
) -> None:
    """Write tracks as one Parquet file, completely or not at all.

    Parameters
    ----------
    tracks
        Markers, poses or parameters.
    path
        The file; an existing one is replaced.
    extra_columns
        More columns for other programs, of any unit, ``(frames,)`` each; `read_parquet` leaves
        them out.

    Raises
    ------
    DataError
        If two columns would have one name, or an extra one has the wrong length.
    FileFormatError
        If the file cannot be written.
    """
    import pyarrow as pa

    columns = _to_columns(tracks)
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
    arrays = {"utterance": pa.array([tracks.name] * tracks.frames, type=pa.string())}
    arrays |= {name: pa.array(np.ascontiguousarray(a)) for name, a in columns.items()}
    write_table(arrays, _to_metadata(tracks), path)


def is_tracks_file(path: str | os.PathLike[str]) -> bool:
    """Tell whether a file is Parquet that `write_parquet` wrote.

    Parameters
    ----------
    path
        The file.

    Returns
    -------
    bool
        False for any other file, and one that cannot be read.
    """
    return read_kind(path) in TRACK_KINDS


def read_parquet(path: str | os.PathLike[str]) -> Tracks:
    """Read the tracks that `write_parquet` wrote.

    Parameters
    ----------
    path
        The file.

    Returns
    -------
    MarkerTracks, PoseTracks or ParameterTracks
        The tracks as they were written, to the last bit.

    Raises
    ------
    MissingFileError
        If there is no such file.
    FileFormatError
        If the file cannot be opened, is not Parquet, is cut short, was not written by
        mocap-fit, or by a later format than this one knows.
    """
    table, metadata = read_table(path, tuple(TRACK_KINDS), "tracks", _ADVICE)
    try:
        wanted = _list_columns(TRACK_KINDS[metadata["kind"]], metadata["names"])
        columns = {
            column.name: table.column(column.name).to_numpy()
            for column in wanted
            if column.name in table.column_names
        }
        return _assemble(columns, metadata, table.num_rows)
    except (DataError, KeyError, TypeError, ValueError, AttributeError) as error:
        raise from_damaged_table(error, path, "tracks") from None
