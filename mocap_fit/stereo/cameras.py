"""Cameras: where a point of the world appears in a picture, and the ray of a point of a picture.

A camera is OpenCV's: ``x_camera = R x_world + t`` in millimetres, then perspective, distortion
(k1, k2, p1, p2, k3, ...) and the intrinsic matrix. The centre of the first pixel is (0, 0).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from mocap_fit.errors import DataError
from mocap_fit.tracks.arrays import FloatArray

DISTORTION_TERMS = ("k1", "k2", "p1", "p2", "k3")
"""The names of the distortion coefficients that every camera has, in OpenCV's order."""

# How many coefficients OpenCV's models of distortion have; four and fewer are filled with zeros.
_LENGTHS = (5, 8, 12, 14)
# Pixels: an undistorted point that is projected this far from where it was is none.
_LARGEST_MISS = 0.01


def _copy_read_only(value: ArrayLike) -> FloatArray:
    array = np.array(value, dtype=np.float64)
    array.setflags(write=False)
    return array


@dataclass(frozen=True, eq=False, repr=False)
class Camera:
    """A calibrated camera.

    Parameters
    ----------
    name
        What the camera is called.
    size
        Width and height of its pictures, pixels.
    matrix
        The intrinsic matrix: focal lengths and principal point in pixels, ``(3, 3)``.
    distortion
        Coefficients of the lens in OpenCV's order (k1, k2, p1, p2, k3, ...), no unit,
        ``(terms,)``; four or fewer are filled up with zeros.
    rotation
        The vector of the rotation from the world to the camera, radians, ``(3,)``.
    translation
        The world's origin as the camera sees it, millimetres, ``(3,)``.

    Raises
    ------
    DataError
        If a number is missing, not finite, or impossible for a camera.
    """

    name: str
    size: tuple[int, int]
    matrix: FloatArray
    distortion: FloatArray = field(default_factory=lambda: np.zeros(5))
    rotation: FloatArray = field(default_factory=lambda: np.zeros(3))
    translation: FloatArray = field(default_factory=lambda: np.zeros(3))

    def __post_init__(self) -> None:
        for attribute, shape in (
            ("matrix", (3, 3)),
            ("distortion", (-1,)),
            ("rotation", (3,)),
            ("translation", (3,)),
        ):
            self._set_array(attribute, shape)
        width, height = self.size
        if min(width, height) < 1 or width != int(width) or height != int(height):
            raise DataError(
                f"the size of camera {self.name} is impossible",
                found=self.size,
                expected="width and height in pixels",
            )
        object.__setattr__(self, "size", (int(width), int(height)))
        zeros = (self.matrix[0, 1], self.matrix[1, 0], self.matrix[2, 0], self.matrix[2, 1])
        if min(self.matrix[0, 0], self.matrix[1, 1]) <= 0 or any(zeros) or self.matrix[2, 2] != 1:
            raise DataError(
                f"the matrix of camera {self.name} is not that of a camera",
                found=self.matrix.tolist(),
                expected="[[fx, 0, cx], [0, fy, cy], [0, 0, 1]] with fx and fy above 0",
            )
        terms = len(self.distortion)
        if terms > 5 and terms not in _LENGTHS:
            raise DataError(
                f"the distortion of camera {self.name} has {terms} coefficients",
                expected="at most 5, or 8, 12 or 14",
            )
        padded = np.pad(self.distortion, (0, max(5 - terms, 0)))
        object.__setattr__(self, "distortion", _copy_read_only(padded))

    def _set_array(self, attribute: str, shape: tuple[int, ...]) -> None:
        try:
            array = _copy_read_only(getattr(self, attribute))
        except (TypeError, ValueError) as error:
            raise DataError(
                f"the {attribute} of camera {self.name} is not made of numbers", found=error
            ) from None
        if array.ndim != len(shape) or (shape != (-1,) and array.shape != shape):
            raise DataError(
                f"the {attribute} of camera {self.name} has the wrong shape",
                found=array.shape,
                expected="(terms,)" if shape == (-1,) else shape,
            )
        if not np.isfinite(array).all():
            raise DataError(
                f"the {attribute} of camera {self.name} has a number that is not finite",
                found=array.tolist(),
            )
        object.__setattr__(self, attribute, array)

    def __setstate__(self, state: dict[str, Any]) -> None:
        # Copies are read-only too; numpy does not see to that by itself.
        for value in state.values():
            if isinstance(value, np.ndarray):
                value.setflags(write=False)
        self.__dict__.update(state)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Camera):
            return NotImplemented
        pairs = ((getattr(self, one), getattr(other, one)) for one in self.__dataclass_fields__)
        return all(np.array_equal(mine, theirs) for mine, theirs in pairs)

    def __hash__(self) -> int:
        return hash((self.name, self.size))

    def __repr__(self) -> str:
        (fx, _, cx), (_, fy, cy), _ = self.matrix
        x, y, z = self.centre
        return (
            f"Camera {self.name}: {self.size[0]} x {self.size[1]} pixels, "
            f"f {fx:.1f}, {fy:.1f}, centre {cx:.1f}, {cy:.1f}, "
            f"k1 {self.distortion[0]:.3f}, k2 {self.distortion[1]:.3f}, "
            f"at {x:.1f}, {y:.1f}, {z:.1f} mm"
        )

    @property
    def rotation_matrix(self) -> FloatArray:
        """The rotation from the world to the camera, ``(3, 3)``, no unit."""
        import cv2

        return np.asarray(cv2.Rodrigues(self.rotation)[0])

    @property
    def centre(self) -> FloatArray:
        """Where the camera is in the world, ``(3,)``, millimetres."""
        return np.asarray(-self.rotation_matrix.T @ self.translation)

    def project(self, points: ArrayLike) -> FloatArray:
        """Return where points appear in the picture, with the lens's distortion.

        Parameters
        ----------
        points
            Points of the world, ``(..., 3)``, millimetres; NaN where missing.

        Returns
        -------
        ndarray
            Pixels, ``(..., 2)``; NaN where a point is missing or not in front of the camera. They
            may lie outside the picture.
        """
        world = np.asarray(points, dtype=np.float64)
        pixels = self.differentiate(world)[0]
        depth = world @ self.rotation_matrix[2] + self.translation[2]
        return np.asarray(np.where((depth > 0)[..., None], pixels, np.nan))

    def differentiate(self, points: ArrayLike) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Project points, and differentiate the pixels by all numbers (`cv2.projectPoints`).

        Parameters
        ----------
        points
            Points of the world, ``(..., 3)``, millimetres.

        Returns
        -------
        pixels : ndarray
            ``(..., 2)``.
        by_points : ndarray
            Derivatives by the points, ``(..., 2, 3)``, pixels a millimetre.
        by_numbers : ndarray
            Derivatives by rotation, translation, focal lengths, principal point and distortion,
            ``(..., 2, 10 + terms)``, pixels a unit of each.
        """
        import cv2

        world = np.asarray(points, dtype=np.float64)
        shape = world.shape[:-1]
        by_numbers = np.zeros((*shape, 2, 10 + len(self.distortion)))
        pixels = np.zeros((*shape, 2))
        if world.size:
            projected, derivatives = cv2.projectPoints(
                world.reshape(-1, 1, 3),
                self.rotation,
                self.translation,
                self.matrix,
                self.distortion,
            )
            pixels = np.asarray(projected).reshape(*shape, 2)
            by_numbers = np.asarray(derivatives).reshape(*shape, 2, -1)
        return pixels, by_numbers[..., 3:6] @ self.rotation_matrix, by_numbers

    def undistort(self, pixels: ArrayLike) -> FloatArray:
        """Return the points of an ideal camera with focal length 1: the lens's distortion undone.

        Parameters
        ----------
        pixels
            Points of the picture, ``(..., 2)``, pixels; NaN where missing.

        Returns
        -------
        ndarray
            ``(..., 2)``, the tangents of the angles to the axis, no unit; NaN where missing, and
            where nothing that the lens sees appears.
        """
        import cv2

        image = np.asarray(pixels, dtype=np.float64)
        if not image.size:
            return np.zeros(image.shape)
        criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, 1e-10)
        flat = np.ascontiguousarray(image.reshape(-1, 1, 2))
        ideal = cv2.undistortPoints(flat, self.matrix, self.distortion, criteria=criteria)[:, 0]
        # Outside the part of the plane that the polynomial covers the iteration ends anywhere.
        ahead = np.hstack([ideal, np.ones((len(ideal), 1))])
        back = cv2.projectPoints(ahead, np.zeros(3), np.zeros(3), self.matrix, self.distortion)[0]
        miss = np.abs(back - flat).max(axis=(1, 2))
        ideal = np.where((miss < _LARGEST_MISS)[:, None], ideal, np.nan)
        return np.asarray(ideal.reshape(image.shape))


@dataclass(frozen=True, repr=False)
class Cameras:
    """Cameras that look at one scene, in one frame of the world.

    Parameters
    ----------
    cameras
        At least one, with different names.

    Raises
    ------
    DataError
        If there is none, or two have one name.
    """

    cameras: tuple[Camera, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "cameras", tuple(self.cameras))
        if not self.cameras:
            raise DataError("there is no camera", expected="at least one")
        repeated = {name for name in self.names if self.names.count(name) > 1}
        if repeated:
            raise DataError("two cameras have one name", found=sorted(repeated))

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the cameras, in their order."""
        return tuple(camera.name for camera in self.cameras)

    def __len__(self) -> int:
        return len(self.cameras)

    def __iter__(self) -> Iterator[Camera]:
        return iter(self.cameras)

    def __getitem__(self, name: str | int) -> Camera:
        if isinstance(name, int):
            return self.cameras[name]
        if name not in self.names:
            raise DataError("there is no such camera", found=name, expected=list(self.names))
        return self.cameras[self.names.index(name)]

    def __repr__(self) -> str:
        return "\n".join(map(repr, self.cameras))

    def project(self, points: ArrayLike) -> FloatArray:
        """Return where points appear in the picture of every camera.

        Parameters
        ----------
        points
            Points of the world, ``(..., 3)``, millimetres; NaN where missing.

        Returns
        -------
        ndarray
            Pixels, ``(cameras, ..., 2)``; NaN where a camera does not have the point in front.
        """
        return np.stack([camera.project(points) for camera in self.cameras])
