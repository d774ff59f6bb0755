"""C3D files, through ezc3d: points with their residuals, units, and events.

Names. Where all labels have the form ``Subject:label`` with one subject, the subject is left out of
the names and noted in the provenance; otherwise labels stay whole. A blank label becomes
``unlabelled N``. Points that `POINT` lists as angles, forces, moments, powers or scalars are no
positions and are left out.

Gaps and origin. A negative residual is a gap. By the C3D convention a residual of 0 and no camera
mean a point that was not measured; it becomes `Origin.FILLED`. But Qualisys writes 0 for all
points, so this is believed only of a file that has some residual above 0.

Time. `start_time` is the number of the first frame (from 0) over the rate, so that the times of the
events, which count from the start of the measurement, fit a recording that was trimmed.
"""

from __future__ import annotations

import os
import struct
import tempfile
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mocap_fit.errors import FileFormatError, MocapFitWarning, from_os_error
from mocap_fit.io import finalise
from mocap_fit.io.c3d_structure import LONG, Extent, check_structure, looks_like_c3d
from mocap_fit.io.text import checked_file, decoded, read_head
from mocap_fit.io.timing import checked_rate
from mocap_fit.tracks import Event, FloatArray, MarkerTracks, Origin

NAME = "c3d"
description = "C3D file"
extensions = (".c3d",)

_NOT_POSITIONS = ("ANGLES", "FORCES", "MOMENTS", "POWERS", "SCALARS", "REACTIONS")
_Parameters = Mapping[str, Mapping[str, Mapping[str, Any]]]


def sniff(path: str | os.PathLike[str]) -> bool:
    """Whether the file starts as a C3D file does."""
    return looks_like_c3d(read_head(path, 512))


def read(
    path: str | os.PathLike[str],
    *,
    names: Sequence[str] | None = None,
    rate: float | None = None,
) -> MarkerTracks:
    """Read the points of a C3D file as markers.

    Parameters
    ----------
    path
        The file.
    names
        Names of the markers in the order of the file, in place of the file's own.
    rate
        Frames per second, in place of the file's own.

    Raises
    ------
    FileFormatError
        If the file is damaged, or no C3D file, or has no points.

    Warns
    -----
    MocapFitWarning
        If the file does not say its unit, or some points are no positions.
    """
    file = checked_file(path)
    extent = _checked(file)
    # ezc3d takes its time over the frames, and knows no more than 65,535 of them.
    content = _part(file, extent, 0, 1) if extent.plain_floats else _opened(file)
    about = _about(content, file, names, rate)
    points = _floats(file, extent, 0, extent.frames) if extent.plain_floats else _points(content)
    points = points[:, about.kept]
    return finalise.markers(
        file,
        NAME,
        about.names,
        about.rate,
        points.positions(about),
        origin=points.origin(about, points.any_residual),
        start_time=about.start,
        events=about.events,
        arguments=about.arguments,
        unit_is_known=True,
    )


def stretches(
    path: str | os.PathLike[str],
    *,
    names: Sequence[str] | None = None,
    rate: float | None = None,
    frames: int,
) -> Iterator[MarkerTracks]:
    """Read the points of a C3D file so many frames at a time; parameters and errors as for `read`.

    Yields
    ------
    MarkerTracks
        Together what `read` gives.
    """
    file = checked_file(path)
    extent = _checked(file)
    about = _about(_part(file, extent, 0, 1), file, names, rate)

    def parts() -> Iterator[_Points]:
        for start in range(0, extent.frames, frames):
            count = min(frames, extent.frames - start)
            if extent.plain_floats:
                yield _floats(file, extent, start, count)[:, about.kept]
            else:
                yield _points(_part(file, extent, start, count))[:, about.kept]

    # Whether residuals of 0 mean anything shows in the whole file; mostly its first frames do.
    telling = any(part.any_residual for part in parts())
    made = finalise.Stretches(
        file,
        NAME,
        about.names,
        about.rate,
        start_time=about.start,
        events=about.events,
        arguments=about.arguments,
        unit_is_known=True,
    )
    for part in parts():
        yield made.part(part.positions(about), part.origin(about, telling))
    made.finish()


@dataclass(frozen=True)
class _About:
    """What a file says beside its points."""

    kept: list[int]
    names: tuple[str, ...]
    rate: float
    start: float
    scale: float
    events: list[Event]
    arguments: dict[str, Any]


@dataclass(frozen=True, eq=False)
class _Points:
    """Points as the file has them: `(frames, points, 3)`, residuals, whether a camera saw each."""

    places: FloatArray
    residuals: NDArray[Any]
    cameras: NDArray[np.bool_]

    def __getitem__(self, chosen: tuple[slice, list[int]]) -> _Points:
        return _Points(self.places[chosen], self.residuals[chosen], self.cameras[chosen])

    @property
    def _gone(self) -> NDArray[np.bool_]:
        return np.asarray((self.residuals < 0) | ~np.isfinite(self.places).all(axis=2))

    @property
    def any_residual(self) -> bool:
        """Whether a point that is seen has a residual above 0."""
        return bool((self.residuals[~self._gone] > 0).any())

    def positions(self, about: _About) -> FloatArray:
        """Millimetres; NaN for gaps."""
        return np.asarray(np.where(self._gone[:, :, None], np.nan, self.places * about.scale))

    def origin(self, about: _About, telling: bool) -> NDArray[np.uint8]:
        """The origin of every sample; ``telling`` is `any_residual` of the whole file."""
        gone = self._gone
        origin = np.where(gone, Origin.MISSING, Origin.MEASURED).astype(np.uint8)
        if telling:
            origin[~gone & (self.residuals == 0) & ~self.cameras] = Origin.FILLED
        return origin


def _checked(file: Path) -> Extent:
    try:
        return check_structure(file)
    except OSError as error:
        raise from_os_error(error, file) from None


def _about(
    content: Mapping[str, Any], file: Path, names: Sequence[str] | None, rate: float | None
) -> _About:
    parameters: _Parameters = content["parameters"]
    points = content["data"]["points"]
    if points.ndim != 3 or points.shape[1] == 0 or points.shape[2] == 0:
        raise FileFormatError(
            "the file holds no points", path=file, advice="Export a recording with markers."
        )
    labels = _labels(parameters, points.shape[1])
    kept = _kept(parameters, labels, file)
    file_names, subject = _without_subject([labels[index] for index in kept])
    marker_names = finalise.chosen_names(file_names, names, path=file) or ()
    first = float(content["header"]["points"]["first_frame"])
    file_rate = float(_values(parameters, "POINT", "RATE", [np.nan])[0])
    used_rate = checked_rate(file_rate if rate is None else rate, path=file)
    unit = _unit(parameters, file)
    arguments: dict[str, Any] = {"unit": unit}
    if subject is not None:
        arguments["subject"] = subject
    if names is not None:
        arguments["names"] = list(marker_names)
    if rate is not None:
        arguments["rate"] = used_rate
    return _About(
        kept,
        marker_names,
        used_rate,
        first / used_rate,
        finalise.millimetres(unit, path=file),
        _events(content, file),
        arguments,
    )


def _points(content: Mapping[str, Any]) -> _Points:
    """What ezc3d read."""
    data = content["data"]
    return _Points(
        np.asarray(data["points"], dtype=np.float64)[:3].transpose(2, 1, 0),
        np.asarray(data["meta_points"]["residuals"])[0].T,
        np.any(data["meta_points"]["camera_masks"], axis=0).T,
    )


def _part(file: Path, extent: Extent, start: int, count: int) -> Mapping[str, Any]:
    """Some frames, read by ezc3d from a copy that holds no others."""
    try:
        with file.open("rb") as stream, tempfile.TemporaryDirectory() as folder:
            head = bytearray(stream.read(extent.start))
            first = struct.unpack_from(f"{extent.order}H", head, 6)[0]
            if extent.frames < LONG and first + count <= LONG:
                # The number of the last frame; of more frames than 16 bits hold, ezc3d takes
                # as many as there are.
                struct.pack_into(f"{extent.order}H", head, 8, first + count - 1)
            stream.seek(extent.start + start * extent.frame_size)
            copy = Path(folder) / file.name
            copy.write_bytes(bytes(head) + stream.read(count * extent.frame_size))
            return _opened(copy, file)
    except OSError as error:
        raise from_os_error(error, file) from None


def _floats(file: Path, extent: Extent, start: int, count: int) -> _Points:
    """Some frames of plain floats, read without ezc3d, which takes many times as long."""
    try:
        with file.open("rb") as stream:
            stream.seek(extent.start + start * extent.frame_size)
            block = stream.read(count * extent.frame_size)
    except OSError as error:
        raise from_os_error(error, file) from None
    numbers = np.frombuffer(block, dtype="<f4").reshape(count, -1)[:, : 4 * extent.points]
    numbers = numbers.reshape(count, extent.points, 4)
    # The fourth number: -1 for a gap, else the residual in the high byte, cameras in the low one.
    word = np.nan_to_num(numbers[:, :, 3], nan=-1.0, posinf=-1.0, neginf=-1.0)
    word = np.clip(word, -(2.0**31), 2.0**31 - 256).astype(np.int64)
    residuals = np.where(word < 0, -1, word >> 8)
    return _Points(numbers[:, :, :3].astype(np.float64), residuals, (word & 0x7F) != 0)


def _opened(path: Path, of: Path | None = None) -> Mapping[str, Any]:
    """What ezc3d reads in a file, which may be a part ``of`` another."""
    import ezc3d

    try:
        content: Mapping[str, Any] = ezc3d.c3d(str(path))
    except Exception as error:
        # ezc3d raises whatever its C++ part does, from OSError to RuntimeError.
        lines = str(error).splitlines()
        raise FileFormatError(
            "ezc3d cannot read the file",
            path=of or path,
            found=lines[0] if lines else type(error).__name__,
            advice="The file is damaged; export or copy it again.",
        ) from None
    return content


def _values(parameters: _Parameters, group: str, name: str, default: list[Any]) -> list[Any]:
    """The values of a parameter, or the default where it is absent or empty."""
    if group not in parameters or name not in parameters[group]:
        return default
    values = list(np.asarray(parameters[group][name]["value"]).ravel())
    return values or default


def _texts(parameters: _Parameters, group: str, name: str) -> list[str]:
    """The texts of a parameter and of its continuations, such as LABELS and LABELS2.

    A parameter holds at most 255 texts; more are in parameters with a number behind the name.
    """
    texts: list[str] = []
    part = 1
    while name + (str(part) if part > 1 else "") in parameters.get(group, {}):
        found = _values(parameters, group, name + (str(part) if part > 1 else ""), [])
        texts += [_text(value) for value in found]
        part += 1
    return texts


def _text(value: object) -> str:
    # Bytes that are not UTF-8 come as lone surrogates.
    return decoded(str(value).encode("utf-8", errors="surrogateescape")).strip("\0 ")


def _labels(parameters: _Parameters, count: int) -> list[str]:
    labels = _texts(parameters, "POINT", "LABELS")[:count]
    labels += [""] * (count - len(labels))
    return [label or f"unlabelled {place}" for place, label in enumerate(labels, start=1)]


def _kept(parameters: _Parameters, labels: list[str], path: Path) -> list[int]:
    """The points that are positions."""
    others = {
        label for name in _NOT_POSITIONS for label in _texts(parameters, "POINT", name) if label
    }
    kept = [index for index, label in enumerate(labels) if label not in others]
    left_out = [label for label in labels if label in others]
    if not kept:
        raise FileFormatError(
            "the file holds no points",
            path=path,
            found=f"{len(labels)} angles, forces, moments, powers or scalars",
            advice="Export a recording with markers.",
        )
    if left_out:
        warnings.warn(
            f"{path}: left out, because the file lists them as angles, forces, moments, powers or "
            f"scalars: {', '.join(left_out[:5])}{', …' if len(left_out) > 5 else ''}",
            MocapFitWarning,
            stacklevel=4,
        )
    return kept


def _without_subject(labels: list[str]) -> tuple[list[str], str | None]:
    """Labels without the subject that they all share, and that subject."""
    parts = [label.partition(":") for label in labels]
    subjects = {subject for subject, colon, rest in parts if colon and rest}
    if len(subjects) != 1 or not all(colon and rest for _, colon, rest in parts):
        return labels, None
    return [rest for _, _, rest in parts], subjects.pop()


def _unit(parameters: _Parameters, path: Path) -> str:
    units = [unit for unit in _texts(parameters, "POINT", "UNITS") if unit]
    if units:
        return units[0]
    warnings.warn(
        f"{path}: the file does not say its unit of length; millimetres are taken",
        MocapFitWarning,
        stacklevel=4,
    )
    return "mm"


def _events(content: Mapping[str, Any], path: Path) -> list[Event]:
    """The events of the group EVENT, or else of the header."""
    parameters: _Parameters = content["parameters"]
    if "EVENT" not in parameters or not _values(parameters, "EVENT", "TIMES", []):
        header = content["header"]["events"]
        found = zip(header["events_label"], header["events_time"], strict=False)
        return [Event(_text(label), float(time)) for label, time in found if _text(label)]
    # Minutes and seconds.
    times = np.atleast_2d(np.asarray(parameters["EVENT"]["TIMES"]["value"], dtype=np.float64))
    labels = _texts(parameters, "EVENT", "LABELS")
    contexts = _texts(parameters, "EVENT", "CONTEXTS")
    used = int(_values(parameters, "EVENT", "USED", [times.shape[1]])[0])
    if times.shape[0] != 2 or not np.isfinite(times[:, :used]).all():
        raise FileFormatError(
            "the times of the events are not minutes and seconds",
            path=path,
            found=f"shape {times.shape}",
            advice="Export the recording again, or without its events.",
        )
    events = []
    for index in range(min(used, times.shape[1])):
        words = [
            context
            for context in contexts[index : index + 1]
            if context and context.lower() != "general"
        ] + labels[index : index + 1]
        name = " ".join(word for word in words if word) or f"event {index + 1}"
        events.append(Event(name, float(60 * times[0, index] + times[1, index])))
    return events
