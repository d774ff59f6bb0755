"""Rigid and similarity transforms between sets of points, by least squares.

The rotation comes from the singular value decomposition of the weighted cross-covariance, with
the sign of the last direction chosen so that the result is never a reflection (Kabsch 1976,
Acta Crystallographica A32; Umeyama 1991, IEEE PAMI 13(4), which adds the scale).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mocap_fit.errors import DataError
from mocap_fit.tracks.types import FloatArray

#: A set whose width is under this part of its length is as good as a line: the turn about the
#: line would be noise, magnified fifty times.
LEAST_WIDTH = 0.02
#: Points that lie closer together than this, in millimetres, are one point.
LEAST_LENGTH = 1e-6


def _missing(points: FloatArray) -> NDArray[np.bool_]:
    """Which points have a coordinate that is NaN, `(..., points)`."""
    return np.asarray(np.isnan(points).any(axis=-1))


def spread(points: ArrayLike, weights: ArrayLike | None = None) -> FloatArray:
    """How far points reach along their principal directions.

    Parameters
    ----------
    points
        `(..., points, 3)`, millimetres; points with NaN are left out.
    weights
        `(..., points)`, not negative; all 1 when not given.

    Returns
    -------
    FloatArray
        `(..., 3)`: root mean square distance from the centroid along each principal direction,
        the longest first, millimetres. The second is 0 for collinear points, all for coincident
        ones; all NaN where no point is left.
    """
    array = np.asarray(points, dtype=np.float64)
    weight = np.ones(array.shape[:-1]) if weights is None else np.asarray(weights, np.float64)
    there = ~_missing(array)
    weight = np.where(there, weight, 0.0)
    array = np.where(there[..., None], array, 0.0)
    total = weight.sum(axis=-1)
    some = total > 0
    weight = weight / np.where(some, total, 1.0)[..., None]
    centred = array - np.einsum("...p,...pi->...i", weight, array)[..., None, :]
    # Singular values of the points themselves: eigenvalues of their covariance would lose half
    # of the digits, and with them the line between thin and collinear.
    padding = max(0, 3 - array.shape[-2])
    matrix = np.sqrt(weight)[..., None] * centred
    if padding:
        matrix = np.concatenate([matrix, np.zeros((*matrix.shape[:-2], padding, 3))], axis=-2)
    lengths = np.linalg.svd(matrix, compute_uv=False)
    return np.where(some[..., None], lengths, np.nan)


def is_collinear(lengths: FloatArray) -> NDArray[np.bool_]:
    """Whether sets of points with this `spread` are coincident or on a line.

    Parameters
    ----------
    lengths
        `(..., 3)`, from `spread`.
    """
    longest, second = lengths[..., 0], lengths[..., 1]
    return np.asarray(~((longest > LEAST_LENGTH) & (second >= LEAST_WIDTH * longest)))


def refusal(points: ArrayLike, weights: ArrayLike | None = None) -> str | None:
    """Why a set of points cannot tell a rotation, or None where it can.

    Parameters
    ----------
    points
        `(points, 3)`, millimetres; points with NaN are left out.
    weights
        `(points,)`; points of weight 0 are left out.
    """
    array = np.asarray(points, dtype=np.float64)
    there = ~_missing(array)
    if weights is not None:
        there &= np.asarray(weights, dtype=np.float64) > 0
    if there.sum() < 3:
        return f"only {there.sum()} of the three points that are needed are there"
    lengths = spread(array[there], None if weights is None else np.asarray(weights)[there])
    if lengths[0] <= LEAST_LENGTH:
        return "all points are in one place"
    if is_collinear(lengths):
        return (
            f"the points lie on a line: {lengths[0]:.4g} mm long, only {lengths[1]:.4g} mm wide "
            "(root mean square)"
        )
    return None


def _point_arrays(source: ArrayLike, target: ArrayLike) -> tuple[FloatArray, FloatArray]:
    points = np.asarray(source, dtype=np.float64)
    goals = np.asarray(target, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] != 3:
        raise DataError(
            "the source points have the wrong shape", found=points.shape, expected="(points, 3)"
        )
    if goals.ndim < 2 or goals.shape[-2:] != points.shape:
        raise DataError(
            "source and target points do not match", found=goals.shape, expected=points.shape
        )
    return points, goals


def _weight_array(weights: ArrayLike | None, shape: tuple[int, ...]) -> FloatArray:
    """Weights, spread over the frames, and checked."""
    if weights is None:
        return np.ones(shape)
    weight = np.asarray(weights, dtype=np.float64)
    if weight.shape not in (shape, shape[-1:]):
        raise DataError("the weights have the wrong shape", found=weight.shape, expected=shape)
    if not np.isfinite(weight).all() or (weight < 0).any():
        raise DataError("a weight is negative or not finite", expected="finite numbers, 0 or more")
    return np.broadcast_to(weight, shape).copy()


def rigid_transforms(
    source: ArrayLike, target: ArrayLike, weights: ArrayLike | None = None
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Find the rotation and translation of every frame: ``target ≈ R source + t``.

    Parameters
    ----------
    source
        `(points, 3)`, the body's shape; points with NaN are left out.
    target
        `(frames, points, 3)`; NaN where a point is not seen, which is left out in that frame.
    weights
        `(points,)` or `(frames, points)`, 0 leaves a point out; all 1 when not given. The best
        weights are the reciprocals of the points' variances.

    Returns
    -------
    rotations
        `(frames, 3, 3)`, right-handed; NaN where fewer than three points are seen, or those that
        are seen lie on a line.
    translations
        `(frames, 3)`, likewise.
    residuals
        `(frames,)`: root (weighted) mean square distance of the points seen from where the
        transform puts them, likewise.

    Raises
    ------
    DataError
        If the shapes do not match or a weight is negative.
    """
    points, goals = _point_arrays(source, target)
    if goals.ndim != 3:
        raise DataError(
            "the target points have the wrong shape",
            found=goals.shape,
            expected="(frames, points, 3)",
        )
    weight = _weight_array(weights, goals.shape[:2])
    seen = ~(_missing(points) | _missing(goals))
    weight = np.where(seen, weight, 0.0)
    usable = (weight > 0).sum(axis=1) >= 3
    total = np.where(usable, weight.sum(axis=1), 1.0)
    weight = np.where(usable[:, None], weight, 0.0) / total[:, None]
    filled = np.where(_missing(points)[:, None], 0.0, points)
    goals = np.where(seen[:, :, None], goals, 0.0)

    centres = weight @ filled
    middles = np.einsum("fp,fpi->fi", weight, goals)
    centred = filled - centres[:, None, :]
    shifted = goals - middles[:, None, :]
    # The shape is the same in all frames with the same weights; the line test runs once for each.
    patterns, pattern_of_frame = np.unique(weight, axis=0, return_inverse=True)
    lengths = spread(np.broadcast_to(filled, (len(patterns), *filled.shape)), patterns)
    usable &= ~is_collinear(lengths)[pattern_of_frame.reshape(-1)]

    covariance = np.einsum("fp,fpi,fpj->fij", weight, shifted, centred)
    left, _, right = np.linalg.svd(covariance)
    left[:, :, 2] *= np.sign(np.linalg.det(left @ right))[:, None]
    rotations = left @ right
    translations = middles - np.einsum("fij,fj->fi", rotations, centres)
    difference = shifted - np.einsum("fij,fpj->fpi", rotations, centred)
    residuals = np.sqrt(np.einsum("fp,fpi,fpi->f", weight, difference, difference))
    rotations[~usable] = np.nan
    translations[~usable] = np.nan
    residuals[~usable] = np.nan
    return rotations, translations, residuals


def _refuse(points: FloatArray, goals: FloatArray, weights: FloatArray) -> None:
    gone = _missing(goals)
    reason = refusal(np.where(gone[:, None], np.nan, points), weights)
    if reason is None:
        reason = refusal(goals, weights)
    if reason is not None:
        raise DataError(
            "the points do not determine a rotation",
            found=reason,
            expected="three or more points that are not on a line",
        )


def rigid_transform(
    source: ArrayLike, target: ArrayLike, weights: ArrayLike | None = None
) -> tuple[FloatArray, FloatArray]:
    """Find the rotation and translation with the least squares: ``target ≈ R source + t``.

    Parameters
    ----------
    source, target
        `(points, 3)`; points with NaN in either are left out.
    weights
        `(points,)`, 0 leaves a point out; all 1 when not given.

    Returns
    -------
    rotation
        `(3, 3)`, right-handed.
    translation
        `(3,)`.

    Raises
    ------
    DataError
        If shapes differ, fewer than three points are usable, or they lie on a line.
    """
    points, goals = _point_arrays(source, target)
    if goals.ndim != 2:
        raise DataError(
            "source and target points do not match", found=goals.shape, expected=points.shape
        )
    weight = _weight_array(weights, goals.shape[:1])
    _refuse(points, goals, weight)
    rotations, translations, _ = rigid_transforms(points, goals[None], weight[None])
    return rotations[0], translations[0]


def similarity_transform(
    source: ArrayLike, target: ArrayLike, weights: ArrayLike | None = None
) -> tuple[float, FloatArray, FloatArray]:
    """Find scale, rotation and translation: ``target ≈ s R source + t`` (Umeyama 1991).

    Parameters
    ----------
    source, target, weights
        As for `rigid_transform`.

    Returns
    -------
    scale
        Above 0; the least-squares answer for errors in the target.
    rotation
        `(3, 3)`, right-handed.
    translation
        `(3,)`.

    Raises
    ------
    DataError
        As for `rigid_transform`.
    """
    points, goals = _point_arrays(source, target)
    rotation, _ = rigid_transform(points, goals, weights)
    weight = _weight_array(weights, goals.shape[:1])
    there = (weight > 0) & ~_missing(points) & ~_missing(goals)
    weight = weight[there] / weight[there].sum()
    centre, middle = weight @ points[there], weight @ goals[there]
    turned = (points[there] - centre) @ rotation.T
    # The trace of D S in Umeyama's eq. 42, written as the projection that it is.
    scale = float(
        np.einsum("p,pi,pi->", weight, goals[there] - middle, turned)
        / np.einsum("p,pi,pi->", weight, turned, turned)
    )
    return scale, rotation, middle - scale * rotation @ centre
