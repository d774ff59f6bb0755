"""Cameras: calibrate them, and find in three dimensions what their pictures show."""

from mocap_fit.stereo.board_views import BoardView, Reason, find_corners
from mocap_fit.stereo.boards import Board, read_board
from mocap_fit.stereo.calibration import Calibration, calibrate_cameras
from mocap_fit.stereo.camera_files import read_cameras, write_cameras
from mocap_fit.stereo.cameras import Camera, Cameras
from mocap_fit.stereo.synchronisation import measure_lags
from mocap_fit.stereo.triangulation import Triangulation, triangulate

__all__ = [
    "Board",
    "BoardView",
    "Calibration",
    "Camera",
    "Cameras",
    "Reason",
    "Triangulation",
    "calibrate_cameras",
    "find_corners",
    "measure_lags",
    "read_board",
    "read_cameras",
    "triangulate",
    "write_cameras",
]
