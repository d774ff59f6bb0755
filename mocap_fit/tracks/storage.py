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
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from mocap_fit.errors import DataError, FileFormatError
from mocap_fit.tracks.parquet_file import damaged, kind_of, look_through, read_table
from mocap_fit.tracks.types import (
    Event,
    MarkerTracks,
    Origin,
    ParameterTracks,
    PoseTracks,
    Provenance,
    Step,
)

if TYPE_CHECKING:
    import pandas as pd

Tracks = MarkerTracks | PoseTracks | ParameterTracks
Kind = Literal["markers", "poses", "parameters"]
_KINDS = ("markers", "poses", "parameters")
Columns = dict[str, np.ndarray[Any, Any]]

_KEY = "mocap_fit"
_AXES = ("x", "y", "z")
_MATRIX = tuple(f"r{row}{column}" for row in (1, 2, 3) for column in (1, 2, 3))
_ADVICE = "Read a table of another program with pandas and give it to from_frame."


def _kind(tracks: Tracks) -> Kind:
    if isinstance(tracks, MarkerTracks):
        return "markers"
    return "poses" if isinstance(tracks, PoseTracks) else "parameters"


def _column_names(kind: Kind, names: tuple[str, ...]) -> list[str]:
    """Names of the columns after `utterance` and `time`, in order."""
    if kind == "parameters":
        return [*names, *(f"{name}_sd" for name in names), "residual_mm"]
    if kind == "markers":
        return [f"{name}_{part}" for name in names for part in (*_AXES, "origin")]
    return [f"{name}_{part}" for name in names for part in (*_AXES, *_MATRIX, "residual_mm")]


def columns_of(tracks: Tracks) -> Columns:
    """The columns after `utterance`, by name."""
    kind = _kind(tracks)
    names = _column_names(kind, tracks.names)
    reserved = {"utterance", "time"} & set(names)
    twice = sorted(reserved | {name for name in names if names.count(name) > 1})
    if twice:
        raise DataError(
            "two columns of the table would have one name",
            found=", ".join(twice),
            advice="Rename that track.",
        )
    values: list[np.ndarray[Any, Any]] = []
    if isinstance(tracks, ParameterTracks):
        values = [*tracks.values.T, *tracks.standard_deviations.T, tracks.residuals]
    elif isinstance(tracks, MarkerTracks):
        for marker in range(len(tracks.names)):
            values += [*tracks.positions[:, marker].T, tracks.origin[:, marker]]
    else:
        for body in range(len(tracks.names)):
            matrix = tracks.rotations[:, body].reshape(-1, 9)
            values += [*tracks.translations[:, body].T, *matrix.T, tracks.residuals[:, body]]
    return {"time": tracks.times, **dict(zip(names, values, strict=True))}


def _plain(value: object) -> object:
    """A numpy value as one that JSON can hold."""
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


def metadata_of(tracks: Tracks) -> dict[str, Any]:
    """What a table cannot hold, as values that JSON can."""
    described = {
        "kind": _kind(tracks),
        "name": tracks.name,
        "names": list(tracks.names),
        "rate": tracks.rate,
        "start_time": tracks.start_time,
        "events": [{"name": event.name, "time": float(event.time)} for event in tracks.events],
        "provenance": [step.to_dict() for step in tracks.provenance],
    }
    # Through JSON and back, so that a frame's metadata and a file's are the same.
    plain: dict[str, Any] = json.loads(json.dumps(described, default=_plain))
    return plain


def _assemble(columns: Columns, metadata: Mapping[str, Any], frames: int) -> Tracks:
    """Tracks from their columns and metadata."""
    kind: Kind = metadata["kind"]
    names = tuple(metadata["names"])
    missing = [name for name in _column_names(kind, names) if name not in columns]
    if kind == "markers":
        missing = [name for name in missing if not name.endswith("_origin")]
    elif kind == "parameters":
        missing = [name for name in missing if name in names]
    else:
        missing = [name for name in missing if not name.endswith("_residual_mm")]
    if missing:
        raise DataError("the table lacks a column", expected=", ".join(missing))
    common: dict[str, Any] = {
        "start_time": metadata["start_time"],
        "name": metadata["name"],
        "events": tuple(Event(e["name"], e["time"]) for e in metadata["events"]),
        "provenance": tuple(Step.from_dict(step) for step in metadata["provenance"]),
    }
    rate = metadata["rate"]
    unknown = np.full(frames, np.nan)

    def stacked(parts: list[str]) -> np.ndarray[Any, Any]:
        return np.stack([columns.get(part, unknown) for part in parts], axis=-1)

    if kind == "parameters":
        return ParameterTracks(
            names,
            rate,
            stacked(list(names)),
            stacked([f"{name}_sd" for name in names]),
            columns.get("residual_mm", unknown),
            **common,
        )
    if kind == "markers":
        positions = np.stack([stacked([f"{n}_{axis}" for axis in _AXES]) for n in names], axis=1)
        if all(f"{name}_origin" in columns for name in names):
            codes = stacked([f"{name}_origin" for name in names])
            if not np.isin(codes, list(Origin)).all():
                raise DataError(
                    "an origin is none of the known codes",
                    found=codes[~np.isin(codes, list(Origin))][0],
                    expected=", ".join(f"{int(o)} {o.name.lower()}" for o in Origin),
                )
            common["origin"] = codes.astype(np.uint8)
        return MarkerTracks(names, rate, positions, **common)
    return PoseTracks(
        names,
        rate,
        np.stack([stacked([f"{n}_{part}" for part in _MATRIX]) for n in names], axis=1).reshape(
            frames, len(names), 3, 3
        ),
        np.stack([stacked([f"{n}_{axis}" for axis in _AXES]) for n in names], axis=1),
        stacked([f"{name}_residual_mm" for name in names]),
        **common,
    )


def to_frame(tracks: Tracks) -> pd.DataFrame:
    """Tracks as a pandas data frame, one row a frame of the recording.

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

    frame = pd.DataFrame({"utterance": tracks.name, **columns_of(tracks)})
    frame["utterance"] = frame["utterance"].astype(str)
    frame.attrs[_KEY] = metadata_of(tracks)
    return frame


def from_frame(
    frame: pd.DataFrame,
    kind: Kind | None = None,
    *,
    rate: float | None = None,
    start_time: float | None = None,
) -> Tracks:
    """Tracks from a pandas data frame.

    Parameters
    ----------
    frame
        A table with the columns that this module's text lists; `origin`, `_sd` and residual
        columns may be absent, and so may `utterance` and, where the rate is given, `time`.
    kind
        ``markers``, ``poses`` or ``parameters``. When it is not given, it is what `to_frame`
        noted, or else what the column names say.
    rate, start_time
        Hertz and seconds. When not given, they come from `to_frame` or else from `time`.

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
            times = _numbers(frame, "time")
            if start_time is None and not np.isclose(times[0], metadata["start_time"], atol=1e-9):
                metadata["start_time"] = float(times[0])
            _check_times(times, metadata["start_time"], rate or metadata["rate"])
    else:
        metadata = _guessed(frame, kind, rate)
    if rate is not None:
        metadata["rate"] = rate
    if start_time is not None:
        metadata["start_time"] = start_time
    wanted = _column_names(metadata["kind"], tuple(metadata["names"]))
    columns = {name: _numbers(frame, name) for name in wanted if name in frame}
    return _assemble(columns, metadata, len(frame))


def _numbers(frame: pd.DataFrame, column: str) -> np.ndarray[Any, Any]:
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


def _guessed(frame: pd.DataFrame, kind: Kind | None, rate: float | None) -> dict[str, Any]:
    """What `to_frame` would have noted, from the columns alone."""
    columns = [str(name) for name in frame.columns]
    if kind is None:
        if any(name.endswith("_r11") for name in columns):
            kind = "poses"
        else:
            kind = "markers" if any(name.endswith("_x") for name in columns) else "parameters"
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
    start = 0.0
    if "time" in frame and len(frame):
        times = _numbers(frame, "time")
        start = float(times[0])
        if rate is None and len(times) > 1:
            length = float(times[-1] - times[0])
            # Times are rounded when they are made; a rate has no more than these digits.
            rate = round((len(times) - 1) / length, 9) if length > 0 else 0.0
        if rate is not None and np.isfinite(rate) and rate > 0:
            _check_times(times, start, rate)
    if rate is None:
        raise DataError("the table does not tell its rate", advice="Give rate=, in hertz.")
    return {
        "kind": kind,
        "name": str(utterances[0]) if len(utterances) else "",
        "names": names,
        "rate": rate,
        "start_time": start,
        "events": [],
        "provenance": [],
    }


def is_tracks_file(path: str | os.PathLike[str]) -> bool:
    """Whether a file is Parquet that `write_parquet` wrote."""
    return kind_of(path) in _KINDS


def read_parquet(path: str | os.PathLike[str]) -> Tracks:
    """Read the tracks that `write_parquet` wrote.

    Parameters
    ----------
    path
        The file.

    Returns
    -------
    MarkerTracks, PoseTracks or ParameterTracks
        As they were written, to the last bit.

    Raises
    ------
    FileFormatError
        If the file cannot be opened, is not Parquet, is cut short, was not written by
        mocap-fit, or by a later format than this one knows.
    """
    table, metadata = read_table(path, _KINDS, "tracks", _ADVICE)
    try:
        wanted = _column_names(metadata["kind"], tuple(metadata["names"]))
        columns = {
            name: table.column(name).to_numpy() for name in wanted if name in table.column_names
        }
        return _assemble(columns, metadata, table.num_rows)
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise damaged(path, error) from None
    except DataError as error:
        raise FileFormatError(
            f"the tracks in this file cannot be used: {error.problem}",
            path=path,
            frame=error.frame,
            found=error.found,
            expected=error.expected,
        ) from None


def read_provenance(path: str | os.PathLike[str]) -> Provenance:
    """The steps that led to the tracks that a file holds, without holding them.

    The whole file is looked through nevertheless, a group of rows at a time, for damage.

    Parameters
    ----------
    path
        The file.

    Raises
    ------
    FileFormatError
        As `read_parquet`.
    """
    description = look_through(path, _KINDS, "tracks", _ADVICE)
    try:
        return tuple(Step.from_dict(step) for step in description["provenance"])
    except (KeyError, TypeError, AttributeError) as error:
        raise damaged(path, error) from None
