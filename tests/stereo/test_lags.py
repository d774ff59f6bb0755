"""Lags between cameras that see a moving board."""

import cv2
import numpy as np
import pytest

from mocap_fit.errors import DataError
from mocap_fit.stereo import BoardView, Cameras, Reason, measure_lags, read_board

BOARD = read_board("charuco:9x7:20mm:DICT_4X4_250")
FAR = BoardView(np.zeros(0, dtype=np.int64), np.zeros((0, 2)), Reason.NO_BOARD)


def film(cameras: Cameras, lags, rng, *, frames=90, rate=60.0, reach=60.0) -> dict:
    """What cameras see of a board that a person waves, each with its lag in frames."""
    middle = BOARD.points.mean(axis=0)
    views = {}
    for camera, lag in zip(cameras, lags, strict=True):
        views[camera.name] = []
        for time in (np.arange(frames) - lag) / rate:
            phases = 2 * np.pi * np.array([0.7, 1.1, 0.5]) * time
            turn = cv2.Rodrigues(0.4 * np.sin(phases + np.arange(3)) * (reach > 0))[0]
            points = (BOARD.points - middle) @ turn.T + reach * np.sin(phases * 1.3)
            pixels = camera.project(points)
            pixels = pixels + rng.normal(0, 0.2, pixels.shape)
            views[camera.name].append(BoardView(np.arange(len(pixels)), pixels))
    return views


@pytest.mark.parametrize("lag", [3.4, -3.4, 0.0])
def test_planted_lags_are_measured(lag, arrange_cameras, rng):
    cameras = arrange_cameras(2, 300, 800)
    views = film(cameras, [0, lag], rng)
    views["cam_1"][20:30] = [FAR] * 10
    lags = measure_lags(cameras, views, BOARD)
    assert lags["cam_0"] == 0
    assert lags["cam_1"] == pytest.approx(lag, abs=0.1)


def test_lags_are_measured_through_a_third_camera(arrange_cameras, rng):
    cameras = arrange_cameras(3, 400, 800)
    views = film(cameras, [0, 1.5, -2.0], rng)
    views["cam_0"][50:] = [FAR] * 40
    views["cam_2"][:50] = [FAR] * 50
    lags = measure_lags(cameras, views, BOARD)
    assert list(lags) == ["cam_0", "cam_1", "cam_2"]
    assert list(lags.values()) == pytest.approx([0, 1.5, -2.0], abs=0.15)


def test_boards_that_are_still_or_not_shared_are_refused(arrange_cameras, rng):
    cameras = arrange_cameras(2, 300, 800)
    views = film(cameras, [0, 0], rng, frames=20, reach=0.0)
    with pytest.raises(DataError, match="the board does not move"):
        measure_lags(cameras, views, BOARD)
    views["cam_1"][5:] = [FAR] * 15
    with pytest.raises(DataError, match=r"cam_0 and cam_1 share too few views.*found 5"):
        measure_lags(cameras, views, BOARD)
