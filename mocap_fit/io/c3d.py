"""C3D files, through ezc3d: points with their residuals, units, and events.

Names follow the rules of `mocap_fit.io.names`. Points that `POINT` lists as angles, forces,
moments, powers or scalars are not positions and are left out.

Gaps and origin. A negative residual is a gap. By the C3D convention a residual of 0 and no camera
mean a point that was not measured; it becomes `Origin.FILLED`. But Qualisys writes 0 for all
points, so this applies only to a file that has some residual above 0.

Time. `start_time` is the number of the first frame (from 0) over the rate, so that the times of the
events, which count from the start of the measurement, fit a recording that was trimmed.
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from mocap_fit.errors import FileFormatError, MocapFitWarning, from_os_error
from mocap_fit.io import finalise
from mocap_fit.io.c3d_points import extract_points, read_first_frame, read_floats, read_with_ezc3d
from mocap_fit.io.c3d_structure import check_structure, is_c3d
from mocap_fit.io.names import name_tracks
from mocap_fit.io.text import check_file, decode_line, read_head
from mocap_fit.io.timing import check_rate
from mocap_fit.tracks import Event, MarkerTracks

NAME = "c3d"
description = "C3D file"
extensions = (".c3d",)

_NOT_POSITIONS = ("ANGLES", "FORCES", "MOMENTS", "POWERS", "SCALARS", "REACTIONS")
_Parameters = Mapping[str, Mapping[str, Mapping[str, Any]]]


def sniff(path: str | os.PathLike[str]) -> bool:
    """Return whether a file starts as a C3D file does.

    Parameters
    ----------
    path
        The file.

    Returns
    -------
    bool
        Whether it looks like a C3D file.
    """
    return is_c3d(read_head(path, 512))


def read(
    path: str | os.PathLike[str],
    *,
    names: Sequence[str] | None = None,
    rate: float | None = None,
    unit: str | None = None,
    subject: str | None = None,
) -> MarkerTracks:
    """Read the points of a C3D file as markers.

    Parameters
    ----------
    path
        File to read.
    names
        Names of the markers, in the order of the file; they replace those of the file.
    rate
        Frame rate, hertz; it replaces that of the file.
    unit
        Unit of length of the file, such as ``m``; it replaces that of the file.
    subject
        Subject whose tracks alone are read, where the names have subjects.

    Returns
    -------
    MarkerTracks
        Positions in millimetres, in the axes of the file.

    Raises
    ------
    FileFormatError
        If the file is damaged, is not a C3D file, or has no points.

    Warns
    -----
    MocapFitWarning
        If the file does not say its unit, or some points are not positions.
    """
    file = check_file(path)
    try:
        extent = check_structure(file)
    except OSError as error:
        raise from_os_error(error, file) from None
    if extent.plain_floats:
        content, points = read_first_frame(file, extent), read_floats(file, extent)
    else:
        content = read_with_ezc3d(file)
        points = extract_points(content)
    parameters: _Parameters = content["parameters"]
    stored = content["data"]["points"]
    if stored.ndim != 3 or stored.shape[1] == 0 or stored.shape[2] == 0:
        raise FileFormatError(
            "the file holds no points", path=file, advice="Export a recording with markers."
        )
    labels = _read_labels(parameters, stored.shape[1])
    selected = _select_positions(parameters, labels, file)
    used = name_tracks([labels[index] for index in selected], names, path=file, subject=subject)
    first = float(content["header"]["points"]["first_frame"])
    file_rate = float(_read_values(parameters, "POINT", "RATE", [np.nan])[0])
    used_rate = check_rate(file_rate if rate is None else rate, path=file)
    unit = unit or _read_unit(parameters, file)
    scale = finalise.get_millimetres(unit, path=file)
    points = points.select(selected)
    return finalise.create_tracks(
        MarkerTracks,
        file,
        NAME,
        used,
        used_rate,
        {"positions": points.to_positions(scale), "origin": points.to_origin()},
        start_time=first / used_rate,
        events=_read_events(content, file),
        arguments=finalise.list_arguments(used, rate, unit),
    )


def _read_values(parameters: _Parameters, group: str, name: str, default: list[Any]) -> list[Any]:
    """Return the values of a parameter, or the default where it is absent or empty."""
    if group not in parameters or name not in parameters[group]:
        return default
    values = list(np.asarray(parameters[group][name]["value"]).ravel())
    return values or default


def _read_texts(parameters: _Parameters, group: str, name: str) -> list[str]:
    """Return the texts of a parameter and of its continuations, such as LABELS and LABELS2.

    A parameter holds at most 255 texts; more are in parameters with a number behind the name.
    """
    texts: list[str] = []
    part, continued = 1, name
    while continued in parameters.get(group, {}):
        texts += map(_to_text, _read_values(parameters, group, continued, []))
        part, continued = part + 1, f"{name}{part + 1}"
    return texts


def _to_text(value: object) -> str:
    # Bytes that are not UTF-8 come as lone surrogates.
    return decode_line(str(value).encode("utf-8", errors="surrogateescape")).strip("\0 ")


def _read_labels(parameters: _Parameters, count: int) -> list[str]:
    labels = _read_texts(parameters, "POINT", "LABELS")[:count]
    return labels + [""] * (count - len(labels))


def _select_positions(parameters: _Parameters, labels: list[str], path: Path) -> list[int]:
    """Return the indices of the points that are positions."""
    others = {label for name in _NOT_POSITIONS for label in _read_texts(parameters, "POINT", name)}
    positions = [index for index, label in enumerate(labels) if label not in others]
    left_out = [label for label in labels if label in others]
    if not positions:
        value = f"{len(labels)} angles, forces, moments, powers or scalars"
        advice = "Export a recording with markers."
        raise FileFormatError("the file holds no points", path=path, found=value, advice=advice)
    if left_out:
        warnings.warn(
            f"{path}: left out, because the file lists them as angles, forces, moments, powers or "
            f"scalars: {', '.join(left_out[:5])}{', …' if len(left_out) > 5 else ''}",
            MocapFitWarning,
            stacklevel=3,
        )
    return positions


def _read_unit(parameters: _Parameters, path: Path) -> str:
    units = [unit for unit in _read_texts(parameters, "POINT", "UNITS") if unit]
    if units:
        return units[0]
    warnings.warn(
        f"{path}: the file does not say its unit of length; millimetres are taken",
        MocapFitWarning,
        stacklevel=3,
    )
    return "mm"


def _read_events(content: Mapping[str, Any], path: Path) -> list[Event]:
    """Return the events of the group EVENT, or else of the header."""
    parameters: _Parameters = content["parameters"]
    if "EVENT" not in parameters or not _read_values(parameters, "EVENT", "TIMES", []):
        header = content["header"]["events"]
        pairs = zip(header["events_label"], header["events_time"], strict=False)
        return [Event(_to_text(label), float(time)) for label, time in pairs if _to_text(label)]
    # Minutes and seconds.
    times = np.atleast_2d(np.asarray(parameters["EVENT"]["TIMES"]["value"], dtype=np.float64))
    labels = _read_texts(parameters, "EVENT", "LABELS")
    contexts = _read_texts(parameters, "EVENT", "CONTEXTS")
    used = int(_read_values(parameters, "EVENT", "USED", [times.shape[1]])[0])
    if times.shape[0] != 2 or not np.isfinite(times[:, :used]).all():
        raise FileFormatError(
            "the times of the events are not minutes and seconds",
            path=path,
            found=f"shape {times.shape}",
            advice="Export the recording again, or without its events.",
        )
    events = []
    for index in range(min(used, times.shape[1])):
        words = [word for word in contexts[index : index + 1] if word.lower() != "general"]
        words += labels[index : index + 1]
        name = " ".join(filter(None, words)) or f"event {index + 1}"
        events.append(Event(name, float(60 * times[0, index] + times[1, index])))
    return events
