"""Calibration boards: ChArUco, ArUco grids, chessboards and circles, from a line of text.

The text is ``KIND:COLUMNSxROWS:SPACING`` and what differs from the usual, in any order after it:
``charuco:4x5:54mm:DICT_4X4_1000:inverted``. The spacing leads from one square, marker or row of
circles to the next; a second length is the side of the markers.
"""

from __future__ import annotations

import os
import re
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Literal

import numpy as np
from pydantic import ConfigDict, Field

from mocap_fit.errors import ConfigurationError
from mocap_fit.settings_file import StrictModel, load_settings
from mocap_fit.tracks.arrays import FloatArray

Kind = Literal["charuco", "aruco", "chessboard", "circles"]

# The side of a marker as a part of the spacing, where it is not stated, and columns and rows.
_MARKER_PARTS = {"charuco": 0.75, "aruco": 0.8}
_FEWEST = {"charuco": 2, "aruco": 1, "chessboard": 4, "circles": 3}
_MILLIMETRES = {"mm": 1.0, "cm": 10.0, "m": 1000.0, "in": 25.4, "inch": 25.4}
_LENGTH = re.compile(r"(\d+(?:\.\d+)?)(mm|cm|m|in|inch)")
_EXAMPLE = "Write it like charuco:4x5:54mm:DICT_4X4_1000, and :inverted where black is white."


@dataclass(frozen=True)
class Board:
    """A calibration board.

    Parameters
    ----------
    kind
        ``charuco``, ``aruco`` (a grid of markers), ``chessboard`` or ``circles``.
    columns, rows
        Squares of a ChArUco board or chessboard, markers, or circles.
    spacing
        From one of them to the next, millimetres; of asymmetric circles from row to row.
    marker
        Side of a marker, millimetres; 0 on boards without.
    dictionary
        OpenCV's name of the markers' dictionary; empty on boards without.
    inverted
        Whether black and white are exchanged.
    legacy
        Whether a ChArUco board of even rows begins with a white square, as before OpenCV 4.6.
    asymmetric
        Whether every second row of circles is shifted by one spacing; they are two apart.

    Raises
    ------
    ConfigurationError
        If a number is impossible, or OpenCV has no such dictionary or too few markers in it.
    """

    kind: Kind
    columns: int
    rows: int
    spacing: float
    marker: float = 0.0
    dictionary: str = ""
    inverted: bool = False
    legacy: bool = False
    asymmetric: bool = False

    def __post_init__(self) -> None:
        if self.kind not in _FEWEST:
            raise ConfigurationError(
                "there is no such kind of board", found=self.kind, expected=list(_FEWEST)
            )
        if min(self.columns, self.rows) < _FEWEST[self.kind]:
            raise ConfigurationError(
                f"the {self.kind} board is too small",
                found=f"{self.columns}x{self.rows}",
                expected=f"{_FEWEST[self.kind]} or more of each",
            )
        has_markers = self.kind in _MARKER_PARTS
        if not (np.isfinite(self.spacing) and self.spacing > 0):
            raise ConfigurationError(
                "the board has an impossible length", found=self.spacing, expected="above 0 mm"
            )
        if has_markers and not 0 < self.marker < self.spacing:
            raise ConfigurationError(
                "the markers do not fit the board",
                found=f"{self.marker:g} mm",
                expected=f"less than the spacing of {self.spacing:g} mm",
            )
        if has_markers:
            self._check_dictionary()

    def _check_dictionary(self) -> None:
        import cv2

        known = list_dictionaries()
        if self.dictionary not in known:
            raise ConfigurationError(
                "there is no such dictionary of markers",
                found=self.dictionary or "none",
                expected=list(known),
            )
        available = len(cv2.aruco.getPredefinedDictionary(known[self.dictionary]).bytesList)
        count = self.columns * self.rows
        count = count if self.kind == "aruco" else count // 2
        if count > available:
            raise ConfigurationError(
                f"{self.dictionary} has too few markers",
                found=available,
                expected=f"the {count} of the board",
            )

    def __str__(self) -> str:
        parts = [self.kind, f"{self.columns}x{self.rows}", f"{self.spacing:g}mm"]
        parts += [f"{self.marker:g}mm", self.dictionary] if self.marker else []
        flags = ("inverted", "legacy", "asymmetric")
        return ":".join(parts + [flag for flag in flags if getattr(self, flag)])

    @property
    def points(self) -> FloatArray:
        """All corners, or centres of circles, on the board: ``(corners, 3)``, millimetres."""
        if self.marker:
            board = create_board(self)
            points = (
                board.getChessboardCorners() if self.kind == "charuco" else board.getObjPoints()
            )
            return np.asarray(points, dtype=np.float64).reshape(-1, 3)
        columns, rows = self.pattern
        y, x = np.divmod(np.arange(columns * rows), columns)
        x = 2 * x + y % 2 if self.asymmetric else x
        return self.spacing * np.stack([x, y, 0 * x], axis=1).astype(np.float64)

    @property
    def pattern(self) -> tuple[int, int]:
        """Columns and rows of corners, or of circles."""
        inner = self.kind in ("charuco", "chessboard")
        return self.columns - inner, self.rows - inner

    @property
    def is_oriented(self) -> bool:
        """Whether a picture of the board shows which way up it is."""
        if self.kind == "chessboard":
            return (self.columns + self.rows) % 2 == 1
        return self.kind != "circles" or (self.asymmetric and self.rows % 2 == 1)


def list_dictionaries() -> dict[str, int]:
    """Return the dictionaries of markers that OpenCV has.

    Returns
    -------
    dict of str to int
        Their numbers by their names.
    """
    import cv2

    names = sorted(name for name in dir(cv2.aruco) if name.startswith("DICT_"))
    return {name: getattr(cv2.aruco, name) for name in names}


@lru_cache(maxsize=8)
def create_board(board: Board) -> Any:
    """Return OpenCV's object of a board with markers.

    Parameters
    ----------
    board
        A ChArUco board or a grid of markers.

    Returns
    -------
    cv2.aruco.CharucoBoard or cv2.aruco.GridBoard
        With lengths in millimetres.
    """
    import cv2

    dictionary = cv2.aruco.getPredefinedDictionary(list_dictionaries()[board.dictionary])
    shape = (board.columns, board.rows)
    if board.kind == "aruco":
        return cv2.aruco.GridBoard(shape, board.marker, board.spacing - board.marker, dictionary)
    result = cv2.aruco.CharucoBoard(shape, board.spacing, board.marker, dictionary)
    result.setLegacyPattern(board.legacy)
    return result


class _BoardFile(StrictModel):
    # caliscope's charuco.toml; what only its printer needs is not read.
    model_config = ConfigDict(extra="ignore")

    columns: int
    rows: int
    dictionary: str
    board_width: float | None = None
    board_height: float | None = None
    units: str = "cm"
    aruco_scale: float = Field(default=0.75, gt=0, lt=1)
    square_size_override_cm: float | None = None
    inverted: bool = False
    legacy_pattern: bool = False


def read_board(source: str | os.PathLike[str]) -> Board:
    """Make a board of a line of text, or of another program's ``charuco.toml``.

    Parameters
    ----------
    source
        Such as ``charuco:4x5:54mm:DICT_4X4_1000:inverted``, ``aruco:5x7:30mm:24mm:DICT_5X5_50``,
        ``chessboard:10x7:25mm`` (squares), ``circles:4x11:20mm:asymmetric``; or the path of a
        file whose name ends in ``.toml``.

    Returns
    -------
    Board
        The board.

    Raises
    ------
    MissingFileError
        If there is no such file.
    ConfigurationError
        If the text or the file does not describe a board.
    """
    text = os.fspath(source)
    if not text.lower().endswith(".toml"):
        return _parse_board(text)
    settings = load_settings(_BoardFile, source, noun="board")
    spacing = 10 * (settings.square_size_override_cm or 0.0)
    if not spacing:
        if settings.board_width is None or settings.board_height is None:
            raise ConfigurationError(
                "the board does not say how large its squares are",
                path=text,
                expected="square_size_override_cm, or board_width, board_height and units",
            )
        if settings.units not in _MILLIMETRES:
            raise ConfigurationError(
                "the unit of the board is unknown",
                path=text,
                found=settings.units,
                expected=list(_MILLIMETRES),
            )
        sides = (settings.board_width / settings.columns, settings.board_height / settings.rows)
        spacing = min(sides) * _MILLIMETRES[settings.units]
    try:
        return Board(
            "charuco",
            settings.columns,
            settings.rows,
            spacing,
            settings.aruco_scale * spacing,
            settings.dictionary,
            settings.inverted,
            settings.legacy_pattern,
        )
    except ConfigurationError as error:
        raise ConfigurationError(
            error.problem, path=text, found=error.found, expected=error.expected
        ) from None


def _parse_board(text: str) -> Board:
    kind, *words = text.strip().split(":")
    lengths: list[float] = []
    settings: dict[str, Any] = {}
    for word in words:
        length = _LENGTH.fullmatch(word)
        if size := re.fullmatch(r"(\d{1,4})x(\d{1,4})", word):
            settings["columns"], settings["rows"] = int(size[1]), int(size[2])
        elif length:
            lengths.append(float(length[1]) * _MILLIMETRES[length[2]])
        elif word.upper().startswith("DICT_"):
            settings["dictionary"] = word if word in list_dictionaries() else word.upper()
        elif word in ("inverted", "legacy", "asymmetric"):
            settings[word] = True
        else:
            raise ConfigurationError(
                "a part of the board's text is unknown", found=word, advice=_EXAMPLE
            )
    if kind in _FEWEST and ("columns" not in settings or not lengths):
        raise ConfigurationError("the board's text lacks a part", found=text, advice=_EXAMPLE)
    part = _MARKER_PARTS.get(kind, 0.0)
    most = 2 if part else 1
    if len(lengths) > most:
        raise ConfigurationError(
            "the board's text has too many lengths", found=text, expected=f"at most {most}"
        )
    if not lengths:
        lengths, settings = [0.0], {"columns": 0, "rows": 0}
    marker = lengths[1] if len(lengths) > 1 else part * lengths[0]
    return Board(kind, spacing=lengths[0], marker=marker, **settings)  # type: ignore[arg-type]
