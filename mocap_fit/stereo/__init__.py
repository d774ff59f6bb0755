"""Cameras: calibrate them, and find in three dimensions what their pictures show."""

from mocap_fit.stereo.camera_files import read_cameras, write_cameras
from mocap_fit.stereo.cameras import Camera, Cameras
from mocap_fit.stereo.triangulation import Triangulation, triangulate

__all__ = [
    "Camera",
    "Cameras",
    "Triangulation",
    "read_cameras",
    "triangulate",
    "write_cameras",
]
