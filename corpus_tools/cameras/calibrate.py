"""Calibrate cameras from their videos of a board."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from pathlib import Path

from corpus_tools.tasks import TaskProgress
from mocap_fit.errors import ConfigurationError
from mocap_fit.stereo.board_views import BoardView, find_corners
from mocap_fit.stereo.boards import Board, read_board
from mocap_fit.stereo.calibration import Calibration, calibrate_cameras
from mocap_fit.stereo.camera_files import read_cameras, write_cameras
from mocap_fit.stereo.video import count_pictures, read_pictures


def calibrate(
    videos: Sequence[str | os.PathLike[str]],
    board: Board | str | os.PathLike[str],
    *,
    out: str | os.PathLike[str] | None = None,
    distortion_terms: Sequence[str] = ("k1", "k2"),
    intrinsics: str | os.PathLike[str] | None = None,
    pictures: int = 100,
    progress: TaskProgress | None = None,
) -> Calibration:
    """Calibrate one camera or many from videos of a board that is moved before them.

    Parameters
    ----------
    videos
        One a camera, which is called as its file is, without the ending. The pictures of one
        number in all of them were taken at one time.
    board
        The board, its text such as ``charuco:4x5:54mm:DICT_4X4_1000``, or a ``charuco.toml``.
    out
        Where the cameras are written; nowhere if left out.
    distortion_terms
        Which of k1, k2, p1, p2 and k3 are estimated; others are 0.
    intrinsics
        A file of cameras of the same names whose lenses are taken over.
    pictures
        How many of each video are looked at, at most, evenly over its length.
    progress
        Called with the task, the number of pictures done, and of all.

    Returns
    -------
    Calibration
        The cameras, millimetres, and how well they are known.

    Raises
    ------
    FileFormatError
        If a file cannot be read or written.
    ConfigurationError
        If the board or the file of cameras is wrong, or two videos have one name.
    DataError
        If the videos do not determine the cameras.
    """
    board = board if isinstance(board, Board) else read_board(board)
    known = None if intrinsics is None else read_cameras(intrinsics)
    names = [Path(video).stem for video in videos]
    repeated = sorted({name for name in names if names.count(name) > 1})
    if repeated:
        raise ConfigurationError(
            "two videos have one name, and cameras are called by them",
            found=repeated,
            advice="Rename the videos.",
        )
    # The same pictures of all videos; of one that does not say its length, each is looked at.
    counts = [count_pictures(video) for video in videos]
    step = max(math.ceil(max(counts, default=0) / pictures), 1)
    views: dict[str, list[BoardView]] = {}
    sizes: dict[str, tuple[int, int]] = {}
    for name, video, count in zip(names, videos, counts, strict=True):
        views[name] = []
        for number, picture in enumerate(read_pictures(video)):
            sizes[name] = (picture.shape[1], picture.shape[0])
            if number % step == 0:
                views[name].append(find_corners(picture, board))
                if progress is not None:
                    progress(f"looking for the board in {name}", number + 1, count or None)
    result = calibrate_cameras(
        views, sizes, board, distortion_terms=distortion_terms, intrinsics=known
    )
    if out is not None:
        write_cameras(out, result.cameras)
    return result
