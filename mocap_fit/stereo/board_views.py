"""The corners of a calibration board in a picture, and why a picture is not used."""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import StrEnum
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mocap_fit.errors import DataError
from mocap_fit.stereo.boards import Board, create_board, list_dictionaries
from mocap_fit.tracks.arrays import FloatArray

FEWEST_CORNERS = 6
"""Corners of a view that is used: OpenCV's start of a calibration takes no fewer."""

# The board's shorter side as it appears, as a part of its length from the front: 75 degrees.
_LEAST_ASPECT = 0.26
# Pixels over which an edge rises from black to white.
_LARGEST_RISE = 8.0
# Levels of grey: a picture of less contrast shows nothing, sharp or not.
_LEAST_CONTRAST = 50
# Markers of another dictionary that are no accident; spacings by which markers miss their board.
_FEWEST_MARKERS, _LARGEST_MISFIT = 3, 0.3
# One of each family, large enough for boards: those with fewer markers are their beginnings.
_FAMILIES = (
    "DICT_4X4_250",
    "DICT_5X5_250",
    "DICT_6X6_250",
    "DICT_7X7_250",
    "DICT_ARUCO_ORIGINAL",
    "DICT_ARUCO_MIP_36h12",
    "DICT_APRILTAG_16h5",
    "DICT_APRILTAG_25h9",
    "DICT_APRILTAG_36h11",
)

Picture = NDArray[Any]
IntArray = NDArray[np.int64]


class Reason(StrEnum):
    """Why a view of a board is not used."""

    NO_BOARD = "no board"
    MIRRORED = "mirrored print"
    INVERTED = "inverted print"
    DICTIONARY = "wrong dictionary"
    SIZE = "wrong size"
    MARGIN = "no white margin"
    BLUR = "blur"
    OBLIQUE = "too oblique"
    FEW = "under six corners"


@dataclass(frozen=True, eq=False)
class BoardView:
    """What one picture shows of a board.

    Parameters
    ----------
    ids
        Which corners of `Board.points` were seen, ``(corners,)``.
    pixels
        Where, ``(corners, 2)``, pixels.
    reason
        Why the view is not used; None where it is.
    detail
        What was seen instead; empty where nothing more is known.
    """

    ids: IntArray
    pixels: FloatArray
    reason: Reason | None = None
    detail: str = ""

    @property
    def is_used(self) -> bool:
        """Whether a calibration takes it."""
        return self.reason is None and len(self.ids) >= FEWEST_CORNERS


def find_corners(picture: Picture, board: Board) -> BoardView:
    """Find the corners of a board in a picture.

    Parameters
    ----------
    picture
        Grey or BGR, of 8 or 16 bits, ``(height, width)`` or ``(height, width, 3)``.
    board
        What is looked for.

    Returns
    -------
    BoardView
        The corners; where they cannot be used, the reason.

    Raises
    ------
    DataError
        If it is no picture.
    """
    grey = _convert_to_grey(picture)
    # OpenCV's detectInvertedMarker finds half of the views that an inverted picture gives.
    grey = 255 - grey if board.inverted else grey
    ids, pixels = _detect(grey, board)
    if len(ids) < FEWEST_CORNERS:
        reason, detail = _diagnose(grey, board, len(ids))
        return BoardView(ids, pixels, reason, detail)
    view = BoardView(ids, pixels)
    spread = board.points[ids] - board.points[ids].mean(axis=0)
    if np.linalg.matrix_rank(spread) < 2:
        return replace(view, reason=Reason.FEW, detail="all in one line")
    homography, misfit = _fit_homography(board.points[ids], pixels)
    if homography is None or misfit > _LARGEST_MISFIT * board.spacing:
        return replace(view, reason=Reason.SIZE, detail="its markers are arranged differently")
    aspect = _measure_aspect(homography, board.points[ids].mean(axis=0))
    if aspect < _LEAST_ASPECT:
        angle = np.degrees(np.arccos(aspect))
        return replace(view, reason=Reason.OBLIQUE, detail=f"{angle:.0f} degrees")
    rise = _measure_rise(grey, pixels)
    if rise > _LARGEST_RISE:
        return replace(view, reason=Reason.BLUR, detail=f"edges are {rise:.0f} px wide")
    return view


def _convert_to_grey(picture: Picture) -> NDArray[np.uint8]:
    import cv2

    if picture.ndim not in (2, 3) or picture.shape[2:] not in ((), (1,), (3,), (4,)):
        raise DataError(
            "this is no picture", found=picture.shape, expected="(height, width) or (.., .., 3)"
        )
    if picture.dtype == np.uint16:
        # 10 and 12 bits too, whose brightest value is far below 65,535.
        picture = (picture / max(int(picture.max(initial=0)), 255) * 255).astype(np.uint8)
    if picture.dtype != np.uint8 or not picture.size:
        raise DataError(
            "the picture cannot be used",
            found=f"{picture.shape} of {picture.dtype}",
            expected="8 or 16 bits a pixel",
        )
    if picture.ndim == 3 and picture.shape[2] > 1:
        picture = cv2.cvtColor(np.ascontiguousarray(picture[..., :3]), cv2.COLOR_BGR2GRAY)
    return np.ascontiguousarray(picture.reshape(picture.shape[:2]), dtype=np.uint8)


def _detect(grey: NDArray[np.uint8], board: Board) -> tuple[IntArray, FloatArray]:
    """Return the numbers and pixels of the corners that OpenCV finds."""
    import cv2

    if board.kind == "charuco":
        corners, ids, _, _ = _create_detector(board).detectBoard(grey)
        if ids is None:
            corners, ids = [], []
    elif board.kind == "aruco":
        numbers, markers = _detect_markers(grey, board)
        rows = numbers < board.columns * board.rows
        ids, corners = 4 * numbers[rows, None] + np.arange(4), markers[rows]
    elif board.kind == "chessboard":
        flags = cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_ACCURACY
        is_seen, corners = cv2.findChessboardCornersSB(grey, board.pattern, flags=flags)
        corners = _orient(grey, board, np.reshape(corners, (-1, 2))) if is_seen else []
        ids = np.arange(len(corners))
    else:
        grid = cv2.CALIB_CB_ASYMMETRIC_GRID if board.asymmetric else cv2.CALIB_CB_SYMMETRIC_GRID
        is_seen, corners = cv2.findCirclesGrid(grey, board.pattern, flags=grid)
        corners = corners if is_seen else []
        ids = np.arange(len(corners))
    pixels = np.asarray(corners, dtype=np.float64).reshape(-1, 2)
    numbers = np.asarray(ids, dtype=np.int64).ravel()
    order = np.argsort(numbers)
    return numbers[order], pixels[order]


@lru_cache(maxsize=32)
def _create_detector(board: Board) -> Any:
    import cv2

    parameters = cv2.aruco.DetectorParameters()
    if board.kind == "charuco":
        return cv2.aruco.CharucoDetector(create_board(board), detectorParams=parameters)
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    dictionary = cv2.aruco.getPredefinedDictionary(list_dictionaries()[board.dictionary])
    return cv2.aruco.ArucoDetector(dictionary, parameters)


def _detect_markers(grey: NDArray[np.uint8], board: Board) -> tuple[IntArray, FloatArray]:
    """Return the numbers of all markers of a board's dictionary, and their four corners."""
    detector = _create_detector(replace(board, kind="aruco", columns=1, rows=1))
    corners, ids, _ = detector.detectMarkers(grey)
    if ids is None:
        return np.zeros(0, dtype=np.int64), np.zeros((0, 4, 2))
    return np.asarray(ids, dtype=np.int64).ravel(), np.reshape(corners, (-1, 4, 2)).astype(float)


def _orient(grey: NDArray[np.uint8], board: Board, corners: FloatArray) -> FloatArray:
    """Turn a chessboard so that the square before its first corner is black."""
    if not board.is_oriented:
        return corners
    homography, _ = _fit_homography(board.points, corners)
    if homography is None:
        return corners
    half = board.spacing / 2
    first, last = board.points[0] - half, board.points[-1] + half
    near = _project(homography, np.array([first, last]))
    column, row = np.clip(np.round(near).astype(int), 0, np.array(grey.shape[::-1]) - 1).T
    levels = grey[row, column].astype(float)
    return corners if levels[0] <= levels[1] else corners[::-1]


def _fit_homography(points: FloatArray, pixels: FloatArray) -> tuple[FloatArray | None, float]:
    """Return the plane's projection, and the median miss in millimetres on the board."""
    import cv2

    homography, _ = cv2.findHomography(points[:, :2], pixels)
    if homography is None:
        return None, np.inf
    back, _ = cv2.findHomography(pixels, points[:, :2])
    if back is None:
        return None, np.inf
    miss = np.linalg.norm(_project(back, pixels) - points[:, :2], axis=1)
    return np.asarray(homography), float(np.median(miss))


def _project(homography: FloatArray, points: FloatArray) -> FloatArray:
    flat = np.column_stack([points[:, :2], np.ones(len(points))]) @ homography.T
    return np.asarray(flat[:, :2] / flat[:, 2:])


def _measure_aspect(homography: FloatArray, centre: FloatArray) -> float:
    """Return the cosine of the board's tilt: how much shorter it appears in one direction."""
    steps = np.array([[0, 0], [1, 0], [0, 1]]) + centre[:2]
    here, right, down = _project(homography, steps)
    values = np.linalg.svd(np.stack([right - here, down - here]), compute_uv=False)
    return float(values[1] / values[0])


def _measure_rise(grey: NDArray[np.uint8], pixels: FloatArray) -> float:
    """Return the median width of the edges at corners: contrast by the steepest slope, pixels."""
    widths = []
    for x, y in np.round(pixels).astype(int):
        patch = grey[max(y - 10, 0) : y + 11, max(x - 10, 0) : x + 11].astype(float)
        if min(patch.shape) > 2:
            slope = np.hypot(*np.gradient(patch)).max()
            widths.append(np.ptp(patch) / max(slope, 1.0))
    return float(np.median(widths)) if widths else 0.0


def _diagnose(grey: NDArray[np.uint8], board: Board, count: int) -> tuple[Reason, str]:
    """Return why a board is not seen, by looking for it in other ways."""
    import cv2

    for reason, other in ((Reason.MIRRORED, grey[:, ::-1]), (Reason.INVERTED, 255 - grey)):
        # A chessboard's mirror image is one too, and so is its negative.
        is_different = board.marker or (board.kind == "circles" and reason == Reason.INVERTED)
        if is_different and _is_seen(other, board):
            return reason, ""
    if board.marker:
        answer = _diagnose_markers(grey, board)
        if answer is not None:
            return answer
    elif board.kind == "chessboard":
        flags = cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_LARGER
        is_seen, _, meta = cv2.findChessboardCornersSBWithMeta(grey, (3, 3), flags)
        if is_seen:
            rows, columns = meta.shape[0] + 1, meta.shape[1] + 1
            return Reason.SIZE, f"{columns} x {rows} squares are seen"
    for scale in (0.5, 0.25):
        small = cv2.resize(grey, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
        if _is_seen(small, board):
            return Reason.BLUR, ""
    if count:
        return Reason.FEW, str(count)
    contrast, slope = float(np.ptp(grey)), np.hypot(*np.gradient(grey.astype(float))).max()
    if contrast > _LEAST_CONTRAST and contrast / slope > _LARGEST_RISE:
        return Reason.BLUR, "nothing in the picture is sharp"
    return Reason.NO_BOARD, ""


def _is_seen(grey: NDArray[np.uint8], board: Board) -> bool:
    return len(_detect(np.ascontiguousarray(grey), board)[0]) >= FEWEST_CORNERS


def _diagnose_markers(grey: NDArray[np.uint8], board: Board) -> tuple[Reason, str] | None:
    numbers, markers = _detect_markers(grey, board)
    objects = create_board(board)
    known = list(objects.getIds().ravel())
    good = np.isin(numbers, known)
    if (~good).sum() >= _FEWEST_MARKERS:
        return Reason.SIZE, f"it has markers up to number {numbers.max()}"
    if good.sum() < _FEWEST_MARKERS:
        answer = _find_dictionary(grey, board)
        if answer is not None or not good.any():
            return answer
    corners = np.asarray(objects.getObjPoints())[[known.index(one) for one in numbers[good]]]
    homography, misfit = _fit_homography(corners.reshape(-1, 3), markers[good].reshape(-1, 2))
    if homography is None or misfit > _LARGEST_MISFIT * board.spacing:
        return Reason.SIZE, "its markers are arranged differently"
    aspect = _measure_aspect(homography, board.points.mean(axis=0))
    if aspect < _LEAST_ASPECT:
        return Reason.OBLIQUE, f"{np.degrees(np.arccos(aspect)):.0f} degrees"
    if board.kind == "aruco" and _has_dark_margin(grey, board, homography):
        return Reason.MARGIN, ""
    return None


def _find_dictionary(grey: NDArray[np.uint8], board: Board) -> tuple[Reason, str] | None:
    """Return which other dictionary the markers are of, if they are many."""
    counts = {
        family: len(_detect_markers(grey, replace(board, dictionary=family))[0])
        for family in _FAMILIES
    }
    best = max(counts, key=lambda family: counts[family])
    if counts[best] < _FEWEST_MARKERS:
        return None
    return Reason.DICTIONARY, f"{counts[best]} markers of {best.rpartition('_')[0]}"


def _has_dark_margin(grey: NDArray[np.uint8], board: Board, homography: FloatArray) -> bool:
    """Whether the picture is dark around the grid, where the paper should be white."""
    gap = board.spacing - board.marker
    width, height = (n * board.spacing - gap for n in (board.columns, board.rows))
    x, y = np.linspace(0, width, 20), np.linspace(0, height, 20)
    around = [(x, 0 * x - gap / 2), (x, 0 * x + height + gap / 2)]
    around += [(0 * y - gap / 2, y), (0 * y + width + gap / 2, y)]
    inside = [(x[1:-1], 0 * x[1:-1] + board.spacing * n - gap / 2) for n in range(1, board.rows)]
    levels = []
    for lines in (around, inside):
        near = _project(homography, np.concatenate([np.stack(line, axis=1) for line in lines]))
        column, row = np.round(near).astype(int).T
        seen = (column >= 0) & (row >= 0) & (column < grey.shape[1]) & (row < grey.shape[0])
        levels.append(grey[row[seen], column[seen]])
    dark, bright = np.median(levels[0]), np.median(levels[1])
    return bool(dark < bright / 2)
