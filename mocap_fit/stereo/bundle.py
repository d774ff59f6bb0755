"""Bundle adjustment: the cameras and the poses of a board that explain all its corners best.

The first camera carries the frame of the world. What is left is minimised over all views at once;
a corner far from where it should be, by the noise of the others, is left out. The covariance is
that of least squares at the end, scaled by the noise that the residuals show.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from mocap_fit.errors import DataError
from mocap_fit.stereo.cameras import DISTORTION_TERMS, Camera, Cameras
from mocap_fit.tracks.arrays import FloatArray

if TYPE_CHECKING:
    from scipy.sparse import csr_array

INTRINSICS = ("fx", "fy", "cx", "cy")
EXTRINSICS = ("rx", "ry", "rz", "tx", "ty", "tz")

NUMBERS = (*EXTRINSICS, *INTRINSICS, *DISTORTION_TERMS)
"""The numbers of a camera, in the order of the derivatives of `Camera.differentiate`."""

# Standard deviations of the noise; of a million good corners three are farther away.
_OUTLIER = 5.0
# Corners of a board that determine its pose.
_FEWEST = 4
_MOST_ROUNDS, _MOST_STEPS = 10, 20
# Standard deviations: a step under this ends the search.
_SMALLEST_STEP = 1e-4
# Of the correlation of the numbers: below, they are not determined.
_LEAST_EIGENVALUE = 1e-13


@dataclass(frozen=True, eq=False)
class CornerTable:
    """Corners of a board that were seen, a row each.

    Parameters
    ----------
    camera
        The number of the camera, ``(corners,)``.
    view
        The number of the pose of the board, which all cameras saw at one time, ``(corners,)``.
    points
        Where the corner is on the board, ``(corners, 3)``, millimetres.
    pixels
        Where it is in the picture, ``(corners, 2)``, pixels.
    """

    camera: NDArray[np.int64]
    view: NDArray[np.int64]
    points: FloatArray
    pixels: FloatArray

    def __len__(self) -> int:
        return len(self.camera)

    def take(self, rows: NDArray[np.bool_]) -> CornerTable:
        """Return some of the corners.

        Parameters
        ----------
        rows
            Which, ``(corners,)``.

        Returns
        -------
        CornerTable
            The same views keep their numbers.
        """
        return CornerTable(self.camera[rows], self.view[rows], self.points[rows], self.pixels[rows])


@dataclass(frozen=True, eq=False, repr=False)
class Bundle:
    """Cameras and poses of a board from all its views at once.

    Parameters
    ----------
    cameras
        With the numbers of least reprojection error.
    poses
        Rotation vector and translation from the board to the world of each view, radians and
        millimetres, ``(views, 6)``; NaN where a view was not used.
    corners
        What was given.
    residuals
        What was seen minus what is projected, ``(corners, 2)``, pixels; NaN in unused views.
    used
        Which corners count, ``(corners,)``; the others are outliers.
    noise
        Standard deviation of a coordinate of a corner, pixels.
    names
        Of the cameras' numbers that were estimated, such as ``cam_0 fx``.
    covariance
        Of these numbers, ``(names, names)``, in pixels, radians and millimetres.
    pose_deviations
        Standard deviations of the poses, ``(views, 6)``; NaN where a view was not used.
    """

    cameras: Cameras
    poses: FloatArray
    corners: CornerTable
    residuals: FloatArray
    used: NDArray[np.bool_]
    noise: float
    names: tuple[str, ...]
    covariance: FloatArray
    pose_deviations: FloatArray

    @property
    def error(self) -> float:
        """Root mean square distance of the corners that count, pixels, as OpenCV reports it."""
        return float(np.sqrt((self.residuals[self.used] ** 2).sum(axis=1).mean()))

    @property
    def standard_deviations(self) -> dict[str, float]:
        """Of each number that was estimated, in pixels, radians and millimetres, by its name."""
        deviations = np.sqrt(np.diagonal(self.covariance))
        return dict(zip(self.names, deviations.tolist(), strict=True))

    def __repr__(self) -> str:
        deviations = self.standard_deviations
        lines = [
            f"Bundle: {int(np.isfinite(self.poses[:, 0]).sum())} views, "
            f"{int(self.used.sum())} of {len(self.used)} corners, "
            f"reprojection error {self.error:.3f} px, noise {self.noise:.3f} px"
        ]
        for camera in self.cameras:
            lines.append(repr(camera))
            values = list_numbers(camera)
            pairs = [
                f"{name} {values[name]:.5g} ± {deviations[f'{camera.name} {name}']:.2g}"
                for name in NUMBERS
                if f"{camera.name} {name}" in deviations
            ]
            lines += ["  " + ", ".join(pairs)] if pairs else []
        return "\n".join(lines)


def list_numbers(camera: Camera) -> dict[str, float]:
    """Return the numbers of a camera by their names.

    Parameters
    ----------
    camera
        Of any number of distortion terms; those after k3 are left out.

    Returns
    -------
    dict of str to float
        As `NUMBERS` names them, in radians, millimetres and pixels.
    """
    numbers = (*camera.rotation, *camera.translation, *camera.matrix[[0, 1, 0, 1], [0, 1, 2, 2]])
    return dict(zip(NUMBERS, map(float, (*numbers, *camera.distortion[:5])), strict=True))


def _replace_numbers(camera: Camera, changes: dict[str, float]) -> Camera:
    numbers = list_numbers(camera) | changes
    fx, fy, cx, cy = (numbers[name] for name in INTRINSICS)
    return replace(
        camera,
        matrix=np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]]),
        distortion=np.array(
            [*(numbers[name] for name in DISTORTION_TERMS), *camera.distortion[5:]]
        ),
        rotation=np.array([numbers[name] for name in EXTRINSICS[:3]]),
        translation=np.array([numbers[name] for name in EXTRINSICS[3:]]),
    )


class _Problem:
    """The vector of all free numbers, and what it predicts.

    Parameters
    ----------
    cameras
        Their numbers that are not free stay as they are.
    corners
        Those to be explained; their views are 0 to the number of views less 1.
    free
        The names of the free numbers of every camera, as `NUMBERS` has them.
    """

    def __init__(
        self, cameras: Cameras, corners: CornerTable, free: Sequence[Sequence[str]]
    ) -> None:
        self.cameras = cameras
        self.corners = corners
        self.free = free
        self.starts = np.cumsum([0, *map(len, free)])
        self.rows = [np.flatnonzero(corners.camera == one) for one in range(len(cameras))]

    def gather(self, poses: FloatArray) -> FloatArray:
        """Return the vector of the cameras' and the poses' numbers as they are."""
        numbers = [
            list_numbers(camera)[name]
            for camera, names in zip(self.cameras, self.free, strict=True)
            for name in names
        ]
        return np.concatenate([numbers, poses.ravel()])

    def bound(self, size: int) -> FloatArray:
        """Return the least value of each number: focal lengths are above 0."""
        lowest = np.full(size, -np.inf)
        names = [name for one in self.free for name in one]
        lowest[[number for number, name in enumerate(names) if name in ("fx", "fy")]] = 1.0
        return lowest

    def split(self, vector: FloatArray) -> tuple[Cameras, FloatArray]:
        """Return the cameras and poses that a vector describes."""
        cameras = tuple(
            _replace_numbers(camera, dict(zip(names, vector[start:].tolist(), strict=False)))
            for camera, names, start in zip(self.cameras, self.free, self.starts[:-1], strict=True)
        )
        return Cameras(cameras), vector[self.starts[-1] :].reshape(-1, 6)

    def residuals(self, vector: FloatArray) -> FloatArray:
        """Return what is projected minus what was seen, x and y of each corner in turn."""
        return self._linearise(vector, with_jacobian=False)[0]

    def jacobian(self, vector: FloatArray) -> csr_array:
        """Return the derivatives of the residuals: 6 of the pose and those of the camera a row."""
        return self._linearise(vector, with_jacobian=True)[1]

    def _linearise(self, vector: FloatArray, with_jacobian: bool) -> tuple[FloatArray, Any]:
        import cv2
        from scipy.sparse import csr_array

        cameras, poses = self.split(vector)
        view = self.corners.view
        turns, slopes = np.zeros((len(poses), 3, 3)), np.zeros((len(poses), 3, 3, 3))
        for number, pose in enumerate(poses):
            turn, slope = cv2.Rodrigues(pose[:3])
            turns[number], slopes[number] = turn, slope.reshape(3, 3, 3)
        world = np.einsum("nij,nj->ni", turns[view], self.corners.points) + poses[view, 3:]
        residuals = np.zeros((len(view), 2))
        values, columns, lines = [], [], []
        for number, (camera, rows) in enumerate(zip(cameras, self.rows, strict=True)):
            pixels, by_points, by_numbers = camera.differentiate(world[rows])
            residuals[rows] = pixels - self.corners.pixels[rows]
            if not with_jacobian:
                continue
            turned = np.einsum("nkij,nj->nik", slopes[view[rows]], self.corners.points[rows])
            chosen = [NUMBERS.index(name) for name in self.free[number]]
            block = np.concatenate([by_numbers[..., chosen], by_points @ turned, by_points], axis=2)
            where = np.concatenate(
                [
                    np.tile(self.starts[number] + np.arange(len(chosen)), (len(rows), 1)),
                    self.starts[-1] + 6 * view[rows, None] + np.arange(6),
                ],
                axis=1,
            )
            values.append(block.ravel())
            columns.append(np.repeat(where[:, None], 2, axis=1).ravel())
            lines.append(np.repeat(2 * rows[:, None] + np.arange(2), where.shape[1]))
        if not with_jacobian:
            return residuals.ravel(), None
        entries = (np.concatenate(lines), np.concatenate(columns))
        shape = (residuals.size, len(vector))
        return residuals.ravel(), csr_array((np.concatenate(values), entries), shape=shape)


def adjust_bundle(
    cameras: Cameras,
    corners: CornerTable,
    poses: FloatArray,
    *,
    distortion_terms: Sequence[str] = ("k1", "k2"),
    fix_intrinsics: bool = False,
    reject_outliers: bool = True,
) -> Bundle:
    """Find the cameras and poses of least reprojection error from a start near them.

    Parameters
    ----------
    cameras
        The start; the pose of the first stays as it is.
    corners
        What was seen.
    poses
        The start: rotation vector and translation from the board to the world of each view,
        radians and millimetres, ``(views, 6)``; NaN for views that are not used.
    distortion_terms
        Which of `DISTORTION_TERMS` are estimated; others stay as they are.
    fix_intrinsics
        Whether focal lengths, principal points and distortion all stay as they are.
    reject_outliers
        Whether corners more than five standard deviations away are left out.

    Returns
    -------
    Bundle
        The cameras and poses, with standard deviations of all numbers.

    Raises
    ------
    DataError
        If a distortion term is unknown, a camera sees no corner, or the views do not determine
        all numbers.
    """
    unknown = set(distortion_terms) - set(DISTORTION_TERMS)
    if unknown:
        raise DataError(
            "there is no such distortion term",
            found=sorted(unknown),
            expected=list(DISTORTION_TERMS),
        )
    intrinsics = () if fix_intrinsics else (*INTRINSICS, *distortion_terms)
    free = [EXTRINSICS * (number > 0) + intrinsics for number in range(len(cameras))]
    used = _drop_thin_views(corners, np.isfinite(poses[:, 0])[corners.view])
    poses = np.array(poses)
    # The first answer is not drawn by outliers; from then on it is plain least squares.
    for number in range(_MOST_ROUNDS):
        problem, views, vector = _fit(
            cameras, corners.take(used), poses, free, number == 0, reject_outliers
        )
        cameras, poses[views] = problem.split(vector)
        if not reject_outliers:
            break
        distances = _measure_distances(cameras, corners, poses)
        scale = np.median(distances[used]) / np.sqrt(2 * np.log(2))
        near = _drop_thin_views(corners, distances < _OUTLIER * scale)
        if np.array_equal(near, used):
            break
        used = near
    return _describe(problem, corners, used, views, vector, len(poses))


def _drop_thin_views(corners: CornerTable, used: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Leave out views of which too few corners are left."""
    counts = np.bincount(corners.view[used], minlength=int(corners.view.max(initial=0)) + 1)
    return used & (counts >= _FEWEST)[corners.view]


def _fit(
    cameras: Cameras,
    corners: CornerTable,
    poses: FloatArray,
    free: Sequence[Sequence[str]],
    is_start: bool,
    is_robust: bool,
) -> tuple[_Problem, NDArray[np.int64], FloatArray]:
    from scipy.optimize import least_squares

    for number, camera in enumerate(cameras):
        if not (corners.camera == number).any():
            raise DataError(f"camera {camera.name} sees no corner of the board that can be used")
    views, order = np.unique(corners.view, return_inverse=True)
    problem = _Problem(cameras, replace(corners, view=order), free)
    start = problem.gather(poses[views])
    if 2 * len(corners) <= len(start):
        raise DataError(
            "there are too few corners",
            found=f"{len(corners)} corners for {len(start)} numbers",
            advice="Show the board more often.",
        )
    if is_start:
        scale = float(np.median(np.abs(problem.residuals(start)))) if is_robust else 1.0
        start = least_squares(
            problem.residuals,
            start,
            problem.jacobian,
            bounds=(problem.bound(len(start)), np.inf),
            x_scale="jac",
            loss="soft_l1" if is_robust else "linear",
            f_scale=max(scale, 1e-6),
            tr_solver="lsmr",
            ftol=1e-5,
            xtol=1e-5,
        ).x
    # With sparse derivatives scipy stops a third of a standard deviation short of the minimum.
    vector = np.asarray(start)
    for _ in range(_MOST_STEPS):
        residuals, inverse = problem.residuals(vector), _invert_information(problem, vector)
        step = inverse @ (problem.jacobian(vector).T @ residuals)
        vector = np.maximum(vector - step, problem.bound(len(vector)))
        noise = np.sqrt((residuals @ residuals) / (len(residuals) - len(vector)))
        if np.abs(step / np.sqrt(np.diagonal(inverse))).max() <= _SMALLEST_STEP * noise + 1e-9:
            break
    return problem, views, vector


def _invert_information(problem: _Problem, vector: FloatArray) -> FloatArray:
    """Return the covariance of all numbers for noise of one pixel."""
    jacobian = problem.jacobian(vector)
    # Columns of one size: pixels and radians differ by orders of magnitude.
    scale = np.sqrt(np.asarray(jacobian.multiply(jacobian).sum(axis=0)))
    scale[scale == 0] = 1.0
    correlation = (jacobian.T @ jacobian).toarray() / np.outer(scale, scale)
    if np.linalg.eigvalsh(correlation)[0] < _LEAST_EIGENVALUE:
        raise DataError(
            "the views of the board do not determine all numbers of the cameras",
            advice="Show the board tilted, in different directions, at different distances.",
        )
    return np.asarray(np.linalg.inv(correlation) / np.outer(scale, scale))


def _measure_distances(cameras: Cameras, corners: CornerTable, poses: FloatArray) -> FloatArray:
    problem = _Problem(cameras, corners, [()] * len(cameras))
    residuals = problem.residuals(poses.ravel()).reshape(-1, 2)
    return np.asarray(np.linalg.norm(residuals, axis=1))


def _describe(
    problem: _Problem,
    corners: CornerTable,
    used: NDArray[np.bool_],
    views: NDArray[np.int64],
    vector: FloatArray,
    view_count: int,
) -> Bundle:
    cameras, fitted = problem.split(vector)
    poses = np.full((view_count, 6), np.nan)
    poses[views] = fitted
    residuals = problem.residuals(vector)
    variance = float(residuals @ residuals) / (len(residuals) - len(vector))
    covariance = variance * _invert_information(problem, vector)
    first = problem.starts[-1]
    deviations = np.full((view_count, 6), np.nan)
    deviations[views] = np.sqrt(np.diagonal(covariance)[first:]).reshape(-1, 6)
    everything = _Problem(cameras, corners, [()] * len(cameras))
    names = [
        f"{camera.name} {name}"
        for camera, one in zip(cameras, problem.free, strict=True)
        for name in one
    ]
    return Bundle(
        cameras,
        poses,
        corners,
        -everything.residuals(poses.ravel()).reshape(-1, 2),
        used,
        float(np.sqrt(variance)),
        tuple(names),
        covariance[:first, :first],
        deviations,
    )
