"""Rigid and similarity transforms between sets of points, by least squares.

The rotation comes from the singular value decomposition of the weighted cross-covariance, with
the sign of the last direction chosen so that the result is never a reflection (Kabsch 1976,
Acta Crystallographica A32; Umeyama 1991, IEEE PAMI 13(4), which adds the scale).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mocap_fit.errors import DataError
from mocap_fit.tracks.arrays import FloatArray

# A set whose width is under this part of its length counts as a line: the turn about the line
# would be noise, magnified fifty times.
_LEAST_WIDTH = 0.02
# Points that are closer together than this, in millimetres, are one point.
_LEAST_LENGTH = 1e-6


def apply_transforms(
    points: FloatArray, rotations: FloatArray, translations: FloatArray
) -> FloatArray:
    """Rotate and shift points in every frame: ``R p + t``.

    Parameters
    ----------
    points
        ``(frames, points, 3)``, millimetres.
    rotations
        Rotation matrices, no unit, ``(frames, 3, 3)``.
    translations
        ``(frames, 3)``, millimetres.

    Returns
    -------
    ndarray
        ``(frames, points, 3)``, millimetres.
    """
    return np.asarray(np.einsum("fij,fpj->fpi", rotations, points) + translations[:, None, :])


def apply_inverse_transforms(
    points: FloatArray, rotations: FloatArray, translations: FloatArray
) -> FloatArray:
    """Bring the points of every frame back to where they were before: ``Rᵀ (p - t)``.

    Parameters
    ----------
    points
        ``(frames, points, 3)``, millimetres.
    rotations
        Rotation matrices, no unit, ``(frames, 3, 3)``.
    translations
        ``(frames, 3)``, millimetres.

    Returns
    -------
    ndarray
        ``(frames, points, 3)``, millimetres.
    """
    return np.asarray(np.einsum("fji,fpj->fpi", rotations, points - translations[:, None, :]))


def compute_motion_jacobian(points: FloatArray, centre: FloatArray) -> FloatArray:
    """Return the derivative of points by a small rigid motion.

    A turn ``ω`` about the centre and a shift ``τ`` move a point ``p`` by
    ``ω × (p - centre) + τ``; the Jacobian by ``(ω, τ)`` is ``[-(p - centre)×, I]``.

    Parameters
    ----------
    points
        ``(points, 3)``, millimetres.
    centre
        ``(3,)``, millimetres.

    Returns
    -------
    ndarray
        ``(points, 3, 6)``: millimetres per radian for the rotation vector, no unit for the
        translation.
    """
    jacobian = np.zeros((len(points), 3, 6))
    x, y, z = (points - centre).T
    jacobian[:, 0, 1], jacobian[:, 0, 2] = z, -y
    jacobian[:, 1, 0], jacobian[:, 1, 2] = -z, x
    jacobian[:, 2, 0], jacobian[:, 2, 1] = y, -x
    jacobian[:, :, 3:] = np.eye(3)
    return jacobian


def project_to_rotations(matrices: FloatArray) -> FloatArray:
    """Return the nearest rotation of every matrix, in the Frobenius norm (Kabsch 1976).

    Parameters
    ----------
    matrices
        ``(..., 3, 3)``, no unit; NaN is missing.

    Returns
    -------
    ndarray
        Right-handed rotation matrices, ``(..., 3, 3)``; NaN where missing.
    """
    known = ~np.isnan(matrices[..., 0, 0])
    left, _, right = np.linalg.svd(matrices[known])
    left[..., 2] *= np.sign(np.linalg.det(left @ right))[..., None]
    result = np.full_like(matrices, np.nan)
    result[known] = left @ right
    return result


def _is_missing(points: FloatArray) -> NDArray[np.bool_]:
    """Return which points have a coordinate that is NaN, ``(..., points)``."""
    return np.asarray(np.isnan(points).any(axis=-1))


def compute_spread(points: ArrayLike, weights: ArrayLike | None = None) -> FloatArray:
    """Return how far points reach along their principal directions.

    Parameters
    ----------
    points
        ``(..., points, 3)``, millimetres; points with NaN are left out.
    weights
        Weights of the points, ``(..., points)``, no unit, not negative; all 1 where left out.

    Returns
    -------
    ndarray
        Root mean square distance from the centroid along each principal direction, the longest
        first, ``(..., 3)``, millimetres. The second is 0 for collinear points, all are for
        coincident ones; all are NaN where no point is left.
    """
    array = np.asarray(points, dtype=np.float64)
    weight = np.ones(array.shape[:-1]) if weights is None else np.asarray(weights, np.float64)
    usable = ~_is_missing(array)
    weight = np.where(usable, weight, 0.0)
    array = np.where(usable[..., None], array, 0.0)
    total = weight.sum(axis=-1)
    weighted = total > 0
    weight = weight / np.where(weighted, total, 1.0)[..., None]
    centred = array - np.einsum("...p,...pi->...i", weight, array)[..., None, :]
    # Singular values of the points themselves: eigenvalues of their covariance would lose half
    # of the digits, and with them the line between thin and collinear.
    padding = max(0, 3 - array.shape[-2])
    matrix = np.sqrt(weight)[..., None] * centred
    if padding:
        matrix = np.concatenate([matrix, np.zeros((*matrix.shape[:-2], padding, 3))], axis=-2)
    lengths = np.linalg.svd(matrix, compute_uv=False)
    return np.where(weighted[..., None], lengths, np.nan)


def is_collinear(lengths: FloatArray) -> NDArray[np.bool_]:
    """Tell which sets of points are coincident or on a line.

    Parameters
    ----------
    lengths
        Extents of the sets, from `compute_spread`, ``(..., 3)``, millimetres.

    Returns
    -------
    ndarray
        Truth values, ``(...)``, no unit.
    """
    longest, second = lengths[..., 0], lengths[..., 1]
    return np.asarray(~((longest > _LEAST_LENGTH) & (second >= _LEAST_WIDTH * longest)))


def describe_degeneracy(points: ArrayLike, weights: ArrayLike | None = None) -> str | None:
    """Return why a set of points does not determine a rotation, or None where it does.

    Parameters
    ----------
    points
        ``(points, 3)``, millimetres; points with NaN are left out.
    weights
        ``(points,)``, no unit; points of weight 0 are left out.

    Returns
    -------
    str or None
        The reason, for a message.
    """
    array = np.asarray(points, dtype=np.float64)
    usable = ~_is_missing(array)
    if weights is not None:
        usable &= np.asarray(weights, dtype=np.float64) > 0
    if usable.sum() < 3:
        return f"only {usable.sum()} of the three points that are needed are there"
    lengths = compute_spread(
        array[usable], None if weights is None else np.asarray(weights)[usable]
    )
    if lengths[0] <= _LEAST_LENGTH:
        return "all points are in one place"
    if is_collinear(lengths):
        return (
            f"the points lie on a line: {lengths[0]:.4g} mm long, only {lengths[1]:.4g} mm wide "
            "(root mean square)"
        )
    return None


def _check_points(source: ArrayLike, target: ArrayLike) -> tuple[FloatArray, FloatArray]:
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


def _check_weights(weights: ArrayLike | None, shape: tuple[int, ...]) -> FloatArray:
    """Return checked weights, one for each frame and point."""
    if weights is None:
        return np.ones(shape)
    weight = np.asarray(weights, dtype=np.float64)
    if weight.shape not in (shape, shape[-1:]):
        raise DataError("the weights have the wrong shape", found=weight.shape, expected=shape)
    if not np.isfinite(weight).all() or (weight < 0).any():
        raise DataError("a weight is negative or not finite", expected="finite numbers, 0 or more")
    return np.broadcast_to(weight, shape).copy()


def estimate_rigid_transforms(
    source: ArrayLike, target: ArrayLike, weights: ArrayLike | None = None
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Find the rotation and translation of every frame: ``target ≈ R source + t``.

    Parameters
    ----------
    source
        The body's shape, ``(points, 3)``, millimetres; points with NaN are left out.
    target
        ``(frames, points, 3)``, millimetres; NaN where a point is not seen, which is left out in
        that frame.
    weights
        ``(points,)`` or ``(frames, points)``, no unit; 0 leaves a point out; all 1 where left
        out. The best weights are the reciprocals of the points' variances.

    Returns
    -------
    rotations : ndarray
        Right-handed, ``(frames, 3, 3)``, no unit; NaN where fewer than three points are seen, or
        those that are seen lie on a line.
    translations : ndarray
        ``(frames, 3)``, millimetres; NaN likewise.
    residuals : ndarray
        Root (weighted) mean square distance of the points seen from where the transform puts
        them, ``(frames,)``, millimetres; NaN likewise.

    Raises
    ------
    DataError
        If the shapes do not match or a weight is negative.
    """
    points, goals = _check_points(source, target)
    if goals.ndim != 3:
        raise DataError(
            "the target points have the wrong shape",
            found=goals.shape,
            expected="(frames, points, 3)",
        )
    weight = _check_weights(weights, goals.shape[:2])
    seen = ~(_is_missing(points) | _is_missing(goals))
    weight = np.where(seen, weight, 0.0)
    usable = (weight > 0).sum(axis=1) >= 3
    total = weight.sum(axis=1)
    weight = weight / np.where(total > 0, total, 1.0)[:, None]
    filled = np.where(_is_missing(points)[:, None], 0.0, points)
    goals = np.where(seen[:, :, None], goals, 0.0)

    centres = weight @ filled
    middles = np.einsum("fp,fpi->fi", weight, goals)
    centred = filled - centres[:, None, :]
    shifted = goals - middles[:, None, :]
    # The shape is the same in all frames with the same weights; the line test runs once for each.
    patterns, pattern_of_frame = np.unique(weight, axis=0, return_inverse=True)
    lengths = compute_spread(np.broadcast_to(filled, (len(patterns), *filled.shape)), patterns)
    usable &= ~is_collinear(lengths)[pattern_of_frame.reshape(-1)]

    covariance = np.einsum("fp,fpi,fpj->fij", weight, shifted, centred)
    rotations = project_to_rotations(covariance)
    translations = middles - np.einsum("fij,fj->fi", rotations, centres)
    difference = shifted - np.einsum("fij,fpj->fpi", rotations, centred)
    residuals = np.sqrt(np.einsum("fp,fpi,fpi->f", weight, difference, difference))
    rotations[~usable] = np.nan
    translations[~usable] = np.nan
    residuals[~usable] = np.nan
    return rotations, translations, residuals


def _check_determined(points: FloatArray, goals: FloatArray, weights: FloatArray) -> None:
    missing = _is_missing(goals)
    reason = describe_degeneracy(np.where(missing[:, None], np.nan, points), weights)
    if reason is None:
        reason = describe_degeneracy(goals, weights)
    if reason is not None:
        raise DataError(
            "the points do not determine a rotation",
            found=reason,
            expected="three or more points that are not on a line",
        )


def estimate_rigid_transform(
    source: ArrayLike, target: ArrayLike, weights: ArrayLike | None = None
) -> tuple[FloatArray, FloatArray]:
    """Find the rotation and translation with the least squares: ``target ≈ R source + t``.

    Parameters
    ----------
    source
        ``(points, 3)``, millimetres; points with NaN are left out.
    target
        ``(points, 3)``, millimetres; points with NaN are left out.
    weights
        ``(points,)``, no unit; 0 leaves a point out; all 1 where left out.

    Returns
    -------
    rotation : ndarray
        Right-handed, ``(3, 3)``, no unit.
    translation : ndarray
        ``(3,)``, millimetres.

    Raises
    ------
    DataError
        If shapes differ, fewer than three points are usable, or they lie on a line.
    """
    points, goals = _check_points(source, target)
    if goals.ndim != 2:
        raise DataError(
            "source and target points do not match", found=goals.shape, expected=points.shape
        )
    weight = _check_weights(weights, goals.shape[:1])
    _check_determined(points, goals, weight)
    rotations, translations, _ = estimate_rigid_transforms(points, goals[None], weight[None])
    return rotations[0], translations[0]


def estimate_similarity_transform(
    source: ArrayLike, target: ArrayLike, weights: ArrayLike | None = None
) -> tuple[float, FloatArray, FloatArray]:
    """Find scale, rotation and translation: ``target ≈ s R source + t`` (Umeyama 1991).

    Parameters
    ----------
    source
        ``(points, 3)``, millimetres; points with NaN are left out.
    target
        ``(points, 3)``, millimetres; points with NaN are left out.
    weights
        ``(points,)``, no unit; 0 leaves a point out; all 1 where left out.

    Returns
    -------
    scale : float
        Above 0, no unit; the least-squares answer for errors in the target.
    rotation : ndarray
        Right-handed, ``(3, 3)``, no unit.
    translation : ndarray
        ``(3,)``, millimetres.

    Raises
    ------
    DataError
        If shapes differ, fewer than three points are usable, or they lie on a line.
    """
    points, goals = _check_points(source, target)
    rotation, _ = estimate_rigid_transform(points, goals, weights)
    weight = _check_weights(weights, goals.shape[:1])
    usable = (weight > 0) & ~_is_missing(points) & ~_is_missing(goals)
    weight = weight[usable] / weight[usable].sum()
    centre, middle = weight @ points[usable], weight @ goals[usable]
    turned = (points[usable] - centre) @ rotation.T
    # The trace of D S in Umeyama's eq. 42, written as the projection that it is.
    scale = float(
        np.einsum("p,pi,pi->", weight, goals[usable] - middle, turned)
        / np.einsum("p,pi,pi->", weight, turned, turned)
    )
    return scale, rotation, middle - scale * rotation @ centre
