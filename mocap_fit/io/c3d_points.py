"""The points of a C3D file: positions, residuals and cameras."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mocap_fit.errors import FileFormatError, from_os_error
from mocap_fit.io.c3d_structure import LONG, Extent
from mocap_fit.tracks import FloatArray, Origin


@dataclass(frozen=True, eq=False)
class Points:
    """Points as they are stored.

    Parameters
    ----------
    coordinates
        Positions, ``(frames, points, 3)``, in the unit of the file.
    residuals
        Residuals, ``(frames, points)``, in the unit of the file; negative for a gap.
    cameras
        Whether a camera saw the point, ``(frames, points)``.
    """

    coordinates: FloatArray
    residuals: NDArray[Any]
    cameras: NDArray[np.bool_]

    def select(self, points: list[int]) -> Points:
        """Return some of the points.

        Parameters
        ----------
        points
            Indices of the points.

        Returns
        -------
        Points
            The points in that order.
        """
        return Points(
            self.coordinates[:, points], self.residuals[:, points], self.cameras[:, points]
        )

    @property
    def gaps(self) -> NDArray[np.bool_]:
        """Whether a point is missing, ``(frames, points)``."""
        return np.asarray((self.residuals < 0) | ~np.isfinite(self.coordinates).all(axis=2))

    def to_positions(self, scale: float) -> FloatArray:
        """Return the positions in millimetres.

        Parameters
        ----------
        scale
            Millimetres in the unit of the file.

        Returns
        -------
        ndarray
            Positions, ``(frames, points, 3)``, millimetres; NaN for gaps.
        """
        return np.asarray(np.where(self.gaps[:, :, None], np.nan, self.coordinates * scale))

    def to_origin(self) -> NDArray[np.uint8]:
        """Return the origins of the samples.

        A residual of 0 without a camera means a filled sample where the file has some residual
        above 0; other files have 0 for all points.

        Returns
        -------
        ndarray
            Codes of `Origin`, ``(frames, points)``, no unit.
        """
        gaps = self.gaps
        origin = np.where(gaps, Origin.MISSING, Origin.MEASURED).astype(np.uint8)
        if (self.residuals[~gaps] > 0).any():
            origin[~gaps & (self.residuals == 0) & ~self.cameras] = Origin.FILLED
        return origin


def extract_points(content: Mapping[str, Any]) -> Points:
    """Return the points of a file that ezc3d has read.

    Parameters
    ----------
    content
        Result of ezc3d.

    Returns
    -------
    Points
        All points.
    """
    data = content["data"]
    return Points(
        np.asarray(data["points"], dtype=np.float64)[:3].transpose(2, 1, 0),
        np.asarray(data["meta_points"]["residuals"])[0].T,
        np.any(data["meta_points"]["camera_masks"], axis=0).T,
    )


def read_first_frame(file: Path, extent: Extent) -> Mapping[str, Any]:
    """Read the parameters and the first frame by ezc3d, from a copy without the other frames.

    ezc3d takes long for many frames, and reads at most 65,535 of them.

    Parameters
    ----------
    file
        File to read.
    extent
        Location of its data.

    Returns
    -------
    Mapping
        Result of ezc3d.

    Raises
    ------
    FileFormatError
        If the file cannot be read.
    """
    try:
        with file.open("rb") as stream, tempfile.TemporaryDirectory() as folder:
            head = bytearray(stream.read(extent.start))
            if extent.frames < LONG:
                # The number of the last frame is that of the first.
                head[8:10] = head[6:8]
            copy = Path(folder) / file.name
            copy.write_bytes(bytes(head) + stream.read(extent.frame_size))
            return read_with_ezc3d(copy, file)
    except OSError as error:
        raise from_os_error(error, file) from None


def read_floats(file: Path, extent: Extent) -> Points:
    """Read all frames of a file of plain floats, many times faster than ezc3d.

    Parameters
    ----------
    file
        File to read.
    extent
        Location of its data, which are little-endian floats.

    Returns
    -------
    Points
        All points.

    Raises
    ------
    FileFormatError
        If the file cannot be read.
    """
    count = extent.frames
    try:
        with file.open("rb") as stream:
            stream.seek(extent.start)
            block = stream.read(count * extent.frame_size)
    except OSError as error:
        raise from_os_error(error, file) from None
    numbers = np.frombuffer(block, dtype="<f4").reshape(count, -1)[:, : 4 * extent.points]
    numbers = numbers.reshape(count, extent.points, 4)
    # The fourth number: -1 for a gap, else the residual in the high byte, cameras in the low one.
    word = np.nan_to_num(numbers[:, :, 3], nan=-1.0, posinf=-1.0, neginf=-1.0)
    word = np.clip(word, -(2.0**31), 2.0**31 - 256).astype(np.int64)
    residuals = np.where(word < 0, -1, word >> 8)
    return Points(numbers[:, :, :3].astype(np.float64), residuals, (word & 0x7F) != 0)


def read_with_ezc3d(path: Path, original: Path | None = None) -> Mapping[str, Any]:
    """Read a file by ezc3d.

    Parameters
    ----------
    path
        File to read.
    original
        File for messages, of which `path` is a part.

    Returns
    -------
    Mapping
        Result of ezc3d.

    Raises
    ------
    FileFormatError
        If ezc3d cannot read the file.
    """
    import ezc3d

    try:
        content: Mapping[str, Any] = ezc3d.c3d(str(path))
    except Exception as error:
        # ezc3d raises whatever its C++ part does, from OSError to RuntimeError.
        lines = str(error).splitlines()
        raise FileFormatError(
            "ezc3d cannot read the file",
            path=original or path,
            found=lines[0] if lines else type(error).__name__,
            advice="The file is damaged; export or copy it again.",
        ) from None
    return content
