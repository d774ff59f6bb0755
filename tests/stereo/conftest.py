"""Cameras whose numbers are known."""

from collections.abc import Callable

import cv2
import numpy as np
import pytest

from mocap_fit.stereo import Camera, Cameras

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
