"""Cameras whose numbers are known."""

from collections.abc import Callable

import cv2
import numpy as np
import pytest

from mocap_fit.stereo import Camera, Cameras
from mocap_fit.stereo.boards import Board, create_board
from mocap_fit.stereo.bundle import CornerTable

LENS = (-0.15, 0.08, 0.0, 0.0, 0.0)


def look_at_origin(name: str, centre, focal_length: float, distortion=LENS) -> Camera:
    """A camera at a point, whose axis goes through the origin."""
    ahead = -np.asarray(centre) / np.linalg.norm(centre)
    right = np.cross([0.0, -1.0, 0.0], ahead)
    right /= np.linalg.norm(right)
    rotation = np.stack([right, np.cross(ahead, right), ahead])
    matrix = np.array([[focal_length, 0, 320.5], [0, 1.002 * focal_length, 238.7], [0, 0, 1]])
    return Camera(
        name,
        (640, 480),
        matrix,
        np.array(distortion),
        cv2.Rodrigues(rotation)[0][:, 0],
        -rotation @ centre,
    )


@pytest.fixture(scope="session")
def arrange_cameras() -> Callable[..., Cameras]:
    """Cameras on an arc, one metre from the origin, as shared/prototypes/stereo/geom.py has it."""

    def arrange(count=2, baseline=600.0, focal_length=1700.0, distortion=LENS) -> Cameras:
        angle = 2 * np.arcsin(baseline / 2000)
        angles = np.linspace(-angle / 2, angle / 2, count)
        return Cameras(
            tuple(
                look_at_origin(
                    f"cam_{number}",
                    1000 * np.array([np.sin(one), 0.0, -np.cos(one)]),
                    focal_length,
                    distortion,
                )
                for number, one in enumerate(angles)
            )
        )

    return arrange


@pytest.fixture(scope="session")
def show_board() -> Callable[..., tuple[CornerTable, np.ndarray]]:
    """Views of a board of 8 x 6 corners, 20 mm apart: what cameras see, and its poses."""

    def show(cameras: Cameras, rng: np.random.Generator, views: int, noise: float = 0.2):
        board = np.array([[20.0 * x - 70, 20.0 * y - 50, 0] for y in range(6) for x in range(8)])
        rows, poses = [], []
        while len(poses) < views:
            place = rng.uniform([-180, -120, -150], [180, 120, 150])
            pose = np.concatenate([rng.uniform(-0.6, 0.6, 3), place])
            pixels = cameras.project(board @ cv2.Rodrigues(pose[:3])[0].T + place)
            inside = ((pixels > 5) & (pixels < np.array([635, 475]))).all(axis=(1, 2))
            if inside.all():
                for number, seen in enumerate(pixels):
                    seen = seen + rng.normal(0, noise, seen.shape)
                    rows.append((np.full(48, number), np.full(48, len(poses)), board, seen))
                poses.append(pose)
        columns = zip(*rows, strict=True)
        return CornerTable(*map(np.concatenate, columns)), np.array(poses)

    return show


SCALE, MARGIN = 60, 60


def print_board(board: Board, margin: int = MARGIN) -> tuple[np.ndarray, np.ndarray]:
    """The print of a board, 60 pixels a spacing, and where its corners are in it, in pixels."""
    columns, rows = board.columns, board.rows
    if board.marker:
        gap = board.marker / board.spacing - 1 if board.kind == "aruco" else 0
        size = [round((count + gap) * SCALE) + 2 * margin for count in (columns, rows)]
        picture = create_board(board).generateImage(size, marginSize=margin)
        shift = 0.0
    elif board.kind == "chessboard":
        y, x = np.mgrid[: rows * SCALE, : columns * SCALE] // SCALE
        picture = np.pad(((x + y) % 2 * 255).astype(np.uint8), margin, constant_values=255)
        shift = SCALE
    else:
        shift, size = 0.0, (board.points[:, :2].max(axis=0) / board.spacing * SCALE).astype(int)
        picture = np.full((size[1] + 2 * margin, size[0] + 2 * margin), 255, dtype=np.uint8)
        for point in board.points[:, :2] / board.spacing * SCALE + margin:
            cv2.circle(picture, tuple(np.round(16 * point).astype(int)), 16 * 18, 0, -1, 16, 4)
    corners = board.points[:, :2] / board.spacing * SCALE + margin + shift
    # Squares meet between two pixels; circles are drawn round the middle of one.
    corners = corners - 0.5 * (board.kind != "circles")
    return 255 - picture if board.inverted else picture, corners


@pytest.fixture(scope="session")
def draw_board() -> Callable[..., tuple[np.ndarray, np.ndarray]]:
    return print_board
