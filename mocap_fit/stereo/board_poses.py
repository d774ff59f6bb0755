"""Poses of a board before cameras, and how the cameras stand to each other by them.

A motion is a rotation vector and a translation, as OpenCV has them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from mocap_fit.errors import DataError
from mocap_fit.stereo.board_views import BoardView
from mocap_fit.stereo.boards import Board
from mocap_fit.stereo.cameras import Camera
from mocap_fit.tracks.arrays import FloatArray


def locate_board(camera: Camera, views: Sequence[BoardView], board: Board) -> dict[int, FloatArray]:
    """Find the pose of the board in each view of a camera.

    Parameters
    ----------
    camera
        Whose lens is known.
    views
        What it saw, a picture each.
    board
        What was shown.

    Returns
    -------
    dict of int to ndarray
        The motion from the board to the camera, ``(6,)``, radians and millimetres, by the number
        of the view; views that are not used are left out.
    """
    import cv2

    poses = {}
    for number, view in enumerate(views):
        if view.is_used:
            is_solved, turn, shift = cv2.solvePnP(
                board.points[view.ids], view.pixels, camera.matrix, camera.distortion
            )
            if is_solved and shift[2, 0] > 0:
                poses[number] = np.concatenate([turn[:, 0], shift[:, 0]])
    return poses


def connect_cameras(
    names: Sequence[str], seen: Sequence[Mapping[int, FloatArray]]
) -> list[FloatArray]:
    """Return the motion from the first camera to each, over the pairs that share most views.

    Parameters
    ----------
    names
        Of the cameras, for messages.
    seen
        The poses of the board that each camera saw, ``(6,)``, radians and millimetres, by view.

    Returns
    -------
    list of ndarray
        A motion a camera, ``(6,)``, radians and millimetres.

    Raises
    ------
    DataError
        If no view connects a camera to the others.
    """
    motions: dict[int, FloatArray] = {0: np.zeros(6)}
    while len(motions) < len(names):
        shared = {
            (here, there): sorted(seen[here].keys() & seen[there].keys())
            for here in motions
            for there in range(len(names))
            if there not in motions
        }
        (here, there), views = max(shared.items(), key=lambda item: len(item[1]))
        if not views:
            raise DataError(
                "no view of the board connects all cameras",
                found=[name for number, name in enumerate(names) if number not in motions],
                expected=f"views that they share with {', '.join(names[one] for one in motions)}",
                advice="Show the board where two cameras see it at one time; check that the "
                "videos begin together.",
            )
        steps = np.array(
            [combine_motions(seen[there][n], invert_motion(seen[here][n])) for n in views]
        )
        motions[there] = combine_motions(_average(steps), motions[here])
    return [motions[number] for number in range(len(names))]


def _average(motions: FloatArray) -> FloatArray:
    """Return the motion that is nearest to most others."""
    import cv2

    turns = np.array([cv2.Rodrigues(motion[:3])[0] for motion in motions])
    # The chord of the angle between two rotations, about the angle where it is small.
    angles = np.linalg.norm(turns[:, None] - turns[None], axis=(2, 3)) / np.sqrt(2)
    scale = max(float(np.linalg.norm(np.median(motions[:, 3:], axis=0))), 1.0)
    gaps = np.linalg.norm(motions[:, None, 3:] - motions[None, :, 3:], axis=2) / scale
    return np.asarray(motions[np.median(angles + gaps, axis=1).argmin()])


def combine_motions(second: FloatArray, first: FloatArray) -> FloatArray:
    """Return the motion that does one after another.

    Parameters
    ----------
    second
        What is done last, ``(6,)``, radians and millimetres.
    first
        What is done first, likewise ``(6,)``.

    Returns
    -------
    ndarray
        Rotation vector and translation, ``(6,)``.
    """
    import cv2

    turn, shift = cv2.composeRT(first[:3], first[3:], second[:3], second[3:])[:2]
    return np.concatenate([turn[:, 0], shift[:, 0]])


def invert_motion(motion: FloatArray) -> FloatArray:
    """Return the motion that undoes another.

    Parameters
    ----------
    motion
        Rotation vector and translation, ``(6,)``, radians and millimetres.

    Returns
    -------
    ndarray
        Likewise, ``(6,)``.
    """
    return np.concatenate([-motion[:3], -move_point(np.append(-motion[:3], [0, 0, 0]), motion[3:])])


def move_point(motion: FloatArray, point: FloatArray) -> FloatArray:
    """Move a point.

    Parameters
    ----------
    motion
        Rotation vector and translation, ``(6,)``, radians and millimetres.
    point
        ``(3,)``, millimetres.

    Returns
    -------
    ndarray
        ``(3,)``, millimetres.
    """
    import cv2

    return np.asarray(cv2.Rodrigues(motion[:3])[0] @ point + motion[3:])
