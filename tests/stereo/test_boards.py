"""Boards from text and files, their corners in pictures, and why pictures are not used."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from mocap_fit.errors import ConfigurationError, DataError, FileFormatError
from mocap_fit.stereo.board_views import Reason, find_corners
from mocap_fit.stereo.boards import Board, read_board

SPECIFICATIONS = (
    "charuco:4x5:54mm:DICT_4X4_1000",
    "charuco:6x4:30mm:20mm:DICT_5X5_100:inverted",
    "aruco:4x5:30mm:DICT_5X5_100",
    "chessboard:8x7:20mm",
    "circles:4x7:15mm:asymmetric",
    "circles:6x5:15mm",
)
CHARUCO, GRID = SPECIFICATIONS[0], SPECIFICATIONS[2]


def look(picture, board) -> tuple[int, Reason | None]:
    view = find_corners(np.ascontiguousarray(picture), board)
    return len(view.ids), view.reason


@pytest.mark.parametrize("text", SPECIFICATIONS)
def test_a_board_is_read_from_its_text(text):
    board = read_board(text)
    assert read_board(str(board)) == board
    columns, rows = board.pattern
    assert len(board.points) == columns * rows * (4 if board.kind == "aruco" else 1)


def test_lengths_have_units_and_markers_a_usual_size():
    board = read_board("charuco:4x5:5.4cm:dict_4x4_50")
    assert (board.spacing, board.marker, board.dictionary) == (54, 40.5, "DICT_4X4_50")
    assert read_board("chessboard:4x5:1in").spacing == 25.4
    assert board.points[1] - board.points[0] == pytest.approx([54, 0, 0])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "no such kind of board"),
        ("star:4x5:54mm", r"no such kind of board.*found star.*charuco, aruco"),
        ("charuco:4x5", "lacks a part.*Write it like charuco:4x5:54mm"),
        ("charuco:54mm", "lacks a part"),
        ("charuco:4x5:54", "part of the board's text is unknown.*found 54"),
        ("charuco:4x5:54mm", "no such dictionary.*found none"),
        ("charuco:4x5:54mm:DICT_9X9_50", "no such dictionary.*found DICT_9X9_50"),
        ("charuco:20x20:10mm:DICT_4X4_50", "DICT_4X4_50 has too few markers.*the 200"),
        ("charuco:4x5:20mm:30mm:DICT_4X4_50", "markers do not fit the board"),
        ("charuco:1x5:20mm:DICT_4X4_50", "charuco board is too small"),
        ("chessboard:4x5:20mm:10mm", "too many lengths"),
        ("chessboard:4x5:0mm", "impossible length"),
    ],
)
def test_wrong_texts_are_refused(text, message):
    with pytest.raises(ConfigurationError, match=message):
        read_board(text)


def test_another_programs_file_is_read(tmp_path):
    path = tmp_path / "charuco.toml"
    lines = [
        "columns = 4",
        "rows = 5",
        "board_height = 11.0",
        "board_width = 8.5",
        'dictionary = "DICT_4X4_1000"',
        'units = "inch"',
        "aruco_scale = 0.75",
        "square_size_override_cm = 5.4",
        "inverted = true",
    ]
    path.write_text("\n".join(lines))
    assert read_board(path) == read_board("charuco:4x5:54mm:DICT_4X4_1000:inverted")
    path.write_text("\n".join(line for line in lines if "override" not in line))
    assert read_board(path).spacing == pytest.approx(8.5 / 4 * 25.4)
    for line, message in (
        ("rows = 1", "too small"),
        ('rows = "five"', "wrong at rows"),
        ('units = "ell"', "unit of the board is unknown"),
        ("", "does not say how large its squares are"),
    ):
        key = line.split(" ")[0]
        rest = [one for one in lines if "override" not in one and one.split(" ")[0] != key]
        rest = [one for one in rest if line or "board_" not in one]
        path.write_text("\n".join([*rest, line]))
        with pytest.raises(ConfigurationError, match=f"charuco.toml: .*{message}"):
            read_board(path)
    with pytest.raises(FileFormatError, match="no such board"):
        read_board(tmp_path / "none.toml")


@pytest.mark.parametrize("text", SPECIFICATIONS)
def test_corners_are_where_they_are_drawn(text, draw_board):
    board = read_board(text)
    picture, corners = draw_board(board)
    height, width = picture.shape
    ends = np.float32([[40, 30], [width - 20, 10], [width - 60, height - 40], [10, height - 15]])
    edges = np.float32([[0, 0], [width, 0], [width, height], [0, height]])
    homography = cv2.getPerspectiveTransform(edges, ends)
    level = 0 if board.inverted else 255
    seen = cv2.warpPerspective(picture, homography, (width, height), borderValue=level)
    truth = cv2.perspectiveTransform(corners[None], homography)[0]
    for dtype in (np.uint8, np.uint16):
        view = find_corners((seen.astype(dtype) * (16 if dtype is np.uint16 else 1)), board)
        assert view.reason is None
        assert len(view.ids) == len(board.points)
        misses = np.linalg.norm(view.pixels - truth[view.ids], axis=1)
        # The centre of a circle's picture is not the picture of its centre.
        # Markers touch no other square that would hold the corner by its opposite side.
        limits = {"circles": 0.5, "aruco": 0.35}
        assert np.median(misses) < limits.get(board.kind, 0.15)
    colour = cv2.cvtColor(seen, cv2.COLOR_GRAY2BGR)
    assert np.array_equal(find_corners(colour, board).ids, np.arange(len(board.points)))


def test_a_chessboard_upside_down_is_numbered_from_its_black_corner(draw_board):
    board = read_board("chessboard:8x7:20mm")
    assert board.is_oriented
    assert not read_board("chessboard:8x6:20mm").is_oriented
    picture, corners = draw_board(board)
    last = np.array(picture.shape[::-1]) - 1.0
    view = find_corners(np.ascontiguousarray(picture[::-1, ::-1]), board)
    assert np.abs(view.pixels - (last - corners)).max() < 0.3


@pytest.mark.parametrize("text", [pytest.param(CHARUCO, marks=pytest.mark.slow), GRID])
def test_it_says_why_a_board_of_markers_is_not_used(text, draw_board):
    board = read_board(text)
    picture, _ = draw_board(board)
    assert look(picture, board)[1] is None
    assert look(picture[:, ::-1], board) == (0, Reason.MIRRORED)
    assert look(255 - picture, board) == (0, Reason.INVERTED)
    assert look(picture, replace(board, inverted=True)) == (0, Reason.INVERTED)
    other = find_corners(picture, replace(board, dictionary="DICT_6X6_250"))
    assert other.reason == Reason.DICTIONARY
    assert f"of {board.dictionary[:8]}" in other.detail
    assert look(draw_board(replace(board, columns=6, rows=9))[0], board)[1] == Reason.SIZE
    assert look(draw_board(replace(board, columns=5, rows=4))[0], board)[1] == Reason.SIZE
    assert look(cv2.GaussianBlur(picture, (0, 0), 12), board) == (0, Reason.BLUR)
    assert look(np.full_like(picture, 90), board) == (0, Reason.NO_BOARD)
    assert look(picture[40:140, 40:170], board)[1] in (Reason.NO_BOARD, Reason.FEW)


def test_a_board_seen_from_the_side_is_too_oblique(draw_board):
    board = read_board(CHARUCO)
    picture = cv2.resize(draw_board(board)[0], None, fx=0.9, fy=0.2, interpolation=cv2.INTER_AREA)
    view = find_corners(picture, board)
    assert view.reason == Reason.OBLIQUE
    assert view.detail == "77 degrees"


def test_corners_in_one_line_are_too_few(draw_board):
    """OpenCV ends with an assertion where it is to calibrate from them."""
    board = read_board("charuco:9x4:54mm:DICT_4X4_1000")
    picture, corners = draw_board(board)
    picture[round(corners[8, 1]) - 4 :] = 255
    view = find_corners(picture, board)
    assert len(view.ids) == 8
    assert (view.reason, view.detail) == (Reason.FEW, "all in one line")


def test_blur_is_seen_at_the_corners(draw_board):
    board = read_board(GRID)
    picture = cv2.resize(draw_board(board)[0], None, fx=3, fy=3)
    assert look(picture, board)[1] is None
    view = find_corners(cv2.GaussianBlur(picture, (0, 0), 7), board)
    assert view.reason == Reason.BLUR


def test_a_grid_needs_its_white_margin(draw_board):
    board = read_board("aruco:3x3:30mm:DICT_5X5_100")
    picture, _ = draw_board(board)
    dark = np.full_like(picture, 20)
    dark[66:-66, 66:-66] = picture[66:-66, 66:-66]
    assert look(picture, board) == (36, None)
    assert look(dark, board) == (4, Reason.MARGIN)


def test_chessboards_of_another_size_and_out_of_focus(draw_board):
    board = read_board("chessboard:8x7:20mm")
    view = find_corners(draw_board(read_board("chessboard:6x9:20mm"))[0], board)
    assert view.reason == Reason.SIZE
    assert view.detail == "6 x 9 squares are seen"
    blurred = cv2.GaussianBlur(draw_board(board)[0], (0, 0), 25)
    assert find_corners(blurred, board).reason == Reason.BLUR


def test_what_is_no_picture_is_refused():
    board = read_board(CHARUCO)
    for picture in (
        np.zeros((4, 5, 2), np.uint8),
        np.zeros(7, np.uint8),
        np.zeros((0, 4), np.uint8),
    ):
        with pytest.raises(DataError, match="picture"):
            find_corners(picture, board)
    with pytest.raises(DataError, match=r"float64.*8 or 16 bits"):
        find_corners(np.zeros((40, 50)), board)


def test_impossible_boards_are_refused():
    with pytest.raises(ConfigurationError, match="impossible length"):
        Board("chessboard", 5, 6, float("nan"))


@pytest.mark.real_data
def test_real_views_are_found_as_another_program_found_them(data_folder):
    folder = data_folder / "cameras" / "charuco_four"
    board = read_board(folder / "charuco.toml")
    rows = np.loadtxt(folder / "xy_CHARUCO.csv", delimiter=",", skiprows=1)
    first = int(rows[:, 0].min())
    video = cv2.VideoCapture(str(folder / "cam_0.mp4"))
    misses = []
    for frame in range(20):
        view = find_corners(video.read()[1], board)
        theirs = rows[(rows[:, 0] == first + frame) & (rows[:, 1] == 0)]
        both, mine, other = np.intersect1d(view.ids, theirs[:, 3], return_indices=True)
        assert view.reason is None
        assert len(both) >= len(theirs) - 1
        misses.append(view.pixels[mine] - theirs[other, 4:6])
    # Theirs are an older OpenCV's.
    assert np.median(np.abs(np.concatenate(misses))) < 0.2
