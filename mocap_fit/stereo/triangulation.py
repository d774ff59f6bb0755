"""Points in three dimensions from what two or more cameras see, with their uncertainty.

The start is the point nearest to all rays, which is linear. Levenberg and Marquardt's steps then
lead to the least reprojection error, the most likely point under noise of the pixels. The inverse
of the information matrix is the covariance, which equals the Cramér-Rao bound to first order.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mocap_fit.errors import DataError
from mocap_fit.stereo.cameras import Cameras
from mocap_fit.tracks.arrays import FloatArray

_MOST_STEPS = 30
# Millimetres: a step under this ends the search.
_SMALLEST_STEP = 1e-7
# Rays nearer to parallel than this (the least eigenvalue of the sum of their projections) do not
# determine a point: a tenth of a degree between two.
_LEAST_ANGLE = 1.5e-6


@dataclass(frozen=True, eq=False, repr=False)
class Triangulation:
    """Triangulated points.

    Parameters
    ----------
    points
        ``(..., 3)``, millimetres; NaN where fewer than two cameras see a point, or their rays do
        not meet in front of them.
    covariance
        Of each point, from the noise of the pixels, ``(..., 3, 3)``, square millimetres; NaN
        likewise.
    residuals
        What was measured minus where the point is projected, ``(cameras, ..., 2)``, pixels; NaN
        where a camera does not see it.
    """

    points: FloatArray
    covariance: FloatArray
    residuals: FloatArray

    @property
    def standard_deviations(self) -> FloatArray:
        """Of each coordinate, ``(..., 3)``, millimetres."""
        return np.sqrt(np.diagonal(self.covariance, axis1=-2, axis2=-1))

    @property
    def view_counts(self) -> NDArray[np.int64]:
        """How many cameras each point is from, ``(...)``."""
        return np.asarray(np.isfinite(self.residuals).all(axis=-1).sum(axis=0))

    @property
    def errors(self) -> FloatArray:
        """Root mean square distance of the residuals of each point, ``(...)``, pixels."""
        squares = np.nansum(self.residuals**2, axis=(0, -1))
        counts = self.view_counts
        return np.where(counts > 0, np.sqrt(squares / np.maximum(counts, 1)), np.nan)

    def __repr__(self) -> str:
        known = np.isfinite(self.points).all(axis=-1)
        text = f"Triangulation: {known.sum()} of {known.size} points"
        if not known.any():
            return text
        deviation = np.sqrt((self.standard_deviations[known] ** 2).sum(axis=-1).mean())
        error = np.sqrt((self.errors[known] ** 2).mean())
        return f"{text}, reprojection error {error:.3f} px, expected error {deviation:.3f} mm"


def triangulate(cameras: Cameras, pixels: ArrayLike, noise: ArrayLike = 0.2) -> Triangulation:
    """Find the points that cameras see.

    Parameters
    ----------
    cameras
        At least two.
    pixels
        Where each camera sees each point, ``(cameras, ..., 2)``, such as
        ``(cameras, frames, markers, 2)``, pixels; NaN where it does not.
    noise
        Standard deviation of each coordinate of the pixels: one number, or one a camera and point,
        ``(cameras, ...)``, pixels.

    Returns
    -------
    Triangulation
        The points of least reprojection error, weighted by the noise.

    Raises
    ------
    DataError
        If there are fewer than two cameras, the shapes do not agree, or noise is not above 0.
    """
    image = np.asarray(pixels, dtype=np.float64)
    if len(cameras) < 2:
        raise DataError("one camera sees no depth", expected="two or more cameras")
    if image.ndim < 2 or image.shape[0] != len(cameras) or image.shape[-1] != 2:
        raise DataError(
            "the pixels have the wrong shape",
            found=image.shape,
            expected=f"({len(cameras)}, ..., 2): cameras first, x and y last",
        )
    shape = image.shape[1:-1]
    try:
        deviations = np.broadcast_to(np.asarray(noise, dtype=np.float64), image.shape[:-1])
    except ValueError:
        raise DataError(
            "the noise has the wrong shape",
            found=np.shape(noise),
            expected=f"one number, or {image.shape[:-1]}",
        ) from None
    flat = image.reshape(len(cameras), -1, 2)
    deviations = deviations.reshape(flat.shape[:-1])
    seen = np.asarray(np.isfinite(flat).all(axis=-1))
    if not (deviations[seen] > 0).all():
        raise DataError("the noise of a pixel is not above 0", expected="pixels above 0")
    weights = np.where(seen, 1.0 / np.where(seen, deviations, 1.0), 0.0)
    points = _intersect_rays(cameras, flat)
    points, covariance = _minimise(cameras, flat, weights, points)
    projected = cameras.project(points)
    # In front of every camera that sees it.
    bad = np.isnan(projected).any(axis=-1) & seen
    points[bad.any(axis=0)] = np.nan
    lost = np.asarray(np.isnan(points).any(axis=-1))
    covariance[lost] = np.nan
    residuals = np.where(lost[:, None], np.nan, flat - projected)
    return Triangulation(
        points.reshape(*shape, 3), covariance.reshape(*shape, 3, 3), residuals.reshape(image.shape)
    )


def _intersect_rays(cameras: Cameras, pixels: FloatArray) -> FloatArray:
    """Return the points nearest to the rays of the pixels; NaN where they are no two."""
    total = np.zeros((pixels.shape[1], 3, 3))
    moment = np.zeros((pixels.shape[1], 3))
    for camera, image in zip(cameras, pixels, strict=True):
        rays = np.pad(camera.undistort(image), ((0, 0), (0, 1)), constant_values=1.0)
        rays /= np.linalg.norm(rays, axis=1, keepdims=True)
        rays = rays @ camera.rotation_matrix
        across = np.eye(3) - rays[:, :, None] * rays[:, None, :]
        across[np.isnan(rays).any(axis=1)] = 0.0
        total += across
        moment += across @ camera.centre
    determined = np.linalg.eigvalsh(total)[:, 0] > _LEAST_ANGLE
    points = np.full(moment.shape, np.nan)
    points[determined] = np.linalg.solve(total[determined], moment[determined, :, None])[..., 0]
    return points


def _minimise(
    cameras: Cameras, pixels: FloatArray, weights: FloatArray, points: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Lead points to the least weighted reprojection error; also return their covariances."""
    points = points.copy()
    covariance = np.full((len(points), 3, 3), np.nan)
    active = np.flatnonzero(np.isfinite(points).all(axis=1))
    damping = np.full(len(points), 1e-3)
    system = _linearise(cameras, pixels[:, active], weights[:, active], points[active])
    for _ in range(_MOST_STEPS):
        cost, gradient, information = system
        covariance[active] = np.linalg.inv(information)
        damped = information * (1.0 + damping[active, None, None] * np.eye(3))
        steps = np.linalg.solve(damped, gradient[..., None])[..., 0]
        trial = points[active] + steps
        new = _linearise(cameras, pixels[:, active], weights[:, active], trial)
        better = new[0] <= cost
        points[active[better]] = trial[better]
        damping[active] *= np.where(better, 0.1, 10.0)
        moving = np.linalg.norm(steps, axis=1) > _SMALLEST_STEP
        system = tuple(
            np.where(better.reshape(-1, *[1] * (one.ndim - 1)), one, old)[moving]
            for one, old in zip(new, system, strict=True)
        )
        active = active[moving]
        if not len(active):
            break
    return points, covariance


def _linearise(
    cameras: Cameras, pixels: FloatArray, weights: FloatArray, points: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return cost, gradient and information matrix of each point."""
    cost = np.zeros(len(points))
    gradient = np.zeros((len(points), 3))
    information = np.zeros((len(points), 3, 3))
    for camera, image, weight in zip(cameras, pixels, weights, strict=True):
        projected, jacobian, _ = camera.differentiate(points)
        seen = weight > 0
        residual = np.where(seen[:, None], image - projected, 0.0) * weight[:, None]
        slope = jacobian * weight[:, None, None]
        cost += (residual**2).sum(axis=1)
        gradient += np.einsum("nij,ni->nj", slope, residual)
        information += np.einsum("nij,nik->njk", slope, slope)
    return cost, gradient, information
