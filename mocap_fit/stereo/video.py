"""Pictures of a video file, one after another."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mocap_fit.errors import FileFormatError, MissingFileError


def count_pictures(path: str | os.PathLike[str]) -> int:
    """Return how many pictures a video says that it has.

    Parameters
    ----------
    path
        The file.

    Returns
    -------
    int
        The number; 0 where the file does not say it. Those of a file that is cut off are fewer.

    Raises
    ------
    MissingFileError
        If there is no such file.
    FileFormatError
        If it is no video that can be decoded.
    """
    import cv2

    return max(int(_open(path).get(cv2.CAP_PROP_FRAME_COUNT)), 0)


def read_pictures(path: str | os.PathLike[str]) -> Iterator[NDArray[np.uint8]]:
    """Read the pictures of a video, turned upright where the file says how.

    Parameters
    ----------
    path
        A file of any kind that OpenCV's ffmpeg decodes.

    Yields
    ------
    ndarray
        Each picture in BGR, ``(height, width, 3)``.

    Raises
    ------
    MissingFileError
        If there is no such file.
    FileFormatError
        If it is no video that can be decoded, or has no picture.
    """
    video = _open(path)
    is_empty = True
    while True:
        is_read, picture = video.read()
        if not is_read:
            break
        is_empty = False
        yield np.asarray(picture)
    if is_empty:
        raise FileFormatError(
            "the video has no picture that can be decoded",
            path=path,
            advice="It may be cut off: copy it from the camera again.",
        )


def _open(path: str | os.PathLike[str]) -> Any:
    import cv2

    if not Path(path).is_file():
        raise MissingFileError("there is no such video", path=path, advice="Check the name.")
    video = cv2.VideoCapture(os.fspath(path))
    if not video.isOpened():
        raise FileFormatError(
            "this is no video that can be decoded",
            path=path,
            advice="It may be cut off, or its codec is unknown: convert it to H.264 by ffmpeg.",
        )
    return video
