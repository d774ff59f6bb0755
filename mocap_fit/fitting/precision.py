"""How well the visible markers determine the face parameters.

With independent marker noise of standard deviation sigma on every coordinate, and residuals that
are nearly linear in the parameters, the covariance of the least-squares estimate is
``sigma² A (I + P) Aᵀ``, where ``A = (Jᵀ W J)⁻¹ Jᵀ W`` and P is the covariance that the noisy head
pose adds to the markers in head coordinates. With the true pose and equal weights this is the
Cramér-Rao bound of one frame by itself, ``sigma² (Jᵀ J)⁻¹``.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mocap_fit.tracks import FloatArray
from mocap_fit.tracks.rigid import compute_motion_jacobian

# How many times what a face of another shape leaves in the residuals counts. It moves neighbouring
# markers alike, and parameters follow it more than independent noise, so that the residuals show
# less of it. Set on twenty heads of proportions drawn within 12 %, with 0.1 and 0.3 mm of noise, so
# that 95 % intervals contain the truth in 95 % or more on average (88 to 99.6 of a single head);
# `benchmarks/intervals.py` measures it on four others.
MISFIT_FACTOR = 1.6


def compute_covariance(
    jacobian: FloatArray,
    weights: FloatArray,
    *,
    positions: FloatArray | None = None,
    head_positions: FloatArray | None = None,
    head_weights: FloatArray | None = None,
) -> FloatArray:
    """Compute the covariance of the parameters per unit variance of a marker's coordinate.

    Parameters
    ----------
    jacobian
        Jacobian of the visible markers, ``(markers, 3, parameters)``, millimetres per unit.
    weights
        Weights of the visible markers, ``(markers,)``, no unit.
    positions
        Visible markers, ``(markers, 3)``, millimetres; needed with head markers alone.
    head_positions
        Visible head markers that the head's pose was estimated from, ``(head markers, 3)``,
        millimetres; without them the pose counts as exact.
    head_weights
        Weights of the head markers, ``(head markers,)``, no unit; 1 by default.

    Returns
    -------
    ndarray
        Covariance, ``(parameters, parameters)``, per square millimetre; infinite on the diagonal
        for parameters that the markers do not determine.
    """
    count = jacobian.shape[2]
    flat = jacobian.reshape(-1, count)
    row_weights = np.repeat(weights, 3)
    information = flat.T @ (row_weights[:, None] * flat)
    determined = _find_determined(information)
    covariance = np.full((count, count), 0.0)
    covariance[~determined, ~determined] = np.inf
    if not determined.any():
        return covariance
    flat = flat[:, determined]
    gain = np.linalg.solve(information[np.ix_(determined, determined)], flat.T * row_weights)
    variance = gain @ gain.T
    if head_positions is not None and positions is not None and len(head_positions) >= 3:
        head_weights = np.ones(len(head_positions)) if head_weights is None else head_weights
        centre = head_positions.mean(axis=0)
        head = compute_motion_jacobian(head_positions, centre).reshape(-1, 6)
        head_rows = np.repeat(head_weights, 3)
        head_gain = np.linalg.solve(head.T @ (head_rows[:, None] * head), head.T * head_rows)
        through = gain @ compute_motion_jacobian(positions, centre).reshape(-1, 6) @ head_gain
        variance = variance + through @ through.T
    covariance[np.ix_(determined, determined)] = variance
    return covariance


def _find_determined(information: FloatArray) -> NDArray[np.bool_]:
    """Return which parameters a singular information matrix still determines.

    A parameter is undetermined where a direction without information has a component along it.
    """
    scale = np.sqrt(np.maximum(np.diag(information), 1e-12))
    values, vectors = np.linalg.eigh(information / np.outer(scale, scale))
    blind = vectors[:, values < 1e-8]
    seen = (np.sum(blind**2, axis=1) < 1e-6) & (np.diag(information) > 1e-9)
    return np.asarray(seen)


# Where the information of a parameter alone is this many times that beside the others, the
# eigenvalues decide whether it is determined.
_SUSPICIOUS = 1e6


def compute_deviations(
    jacobian: FloatArray,
    weights: FloatArray,
    *,
    positions: FloatArray,
    head_positions: FloatArray,
    head_weights: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Compute the standard deviations of the parameters of many frames, per unit of noise.

    They are the square roots of the diagonal of `compute_covariance` in each frame.

    Parameters
    ----------
    jacobian
        Jacobians, ``(frames, markers, 3, parameters)``, millimetres per unit.
    weights
        Weights of the markers, ``(frames, markers)``, no unit; 0 for a hidden marker.
    positions
        Markers, ``(frames, markers, 3)``, millimetres.
    head_positions
        Head markers, ``(head markers, 3)``, millimetres.
    head_weights
        Weights of the head markers, ``(frames, head markers)``, no unit; 0 for a hidden one. In
        frames with fewer than three the pose counts as exact.

    Returns
    -------
    deviations : ndarray
        Standard deviations, ``(frames, parameters)``, per millimetre; infinite where the markers
        do not determine a parameter.
    bare : ndarray
        The same with an exact head pose.
    """
    frames, markers, _, count = jacobian.shape
    flat = jacobian.reshape(frames, 3 * markers, count)
    weighted = flat * np.repeat(weights, 3, axis=1)[:, :, None]
    across = weighted.transpose(0, 2, 1)
    information = across @ flat
    alone = np.einsum("fpp->fp", information)
    ridge = 1e-13 * np.maximum(alone, 1e-12)
    information[:, np.arange(count), np.arange(count)] += ridge
    inverse = np.linalg.inv(information)
    # Of A only A Aᵀ and the product with a rigid motion are needed.
    variance = np.einsum("fpq,fpq->fp", inverse @ (across @ weighted), inverse)
    bare = variance.copy()
    posed = (head_weights > 0).sum(axis=1) >= 3
    if posed.any():
        centre = head_positions.mean(axis=0)
        effect = compute_motion_jacobian(positions[posed].reshape(-1, 3), centre)
        effect = effect.reshape(-1, 3 * markers, 6)
        through = inverse[posed] @ (across[posed] @ effect)
        pose = _compute_pose_covariance(head_positions, head_weights[posed])
        variance[posed] += np.einsum("fpa,fpa->fp", through @ pose, through)
    doubtful = np.einsum("fpp->fp", inverse) * alone > _SUSPICIOUS
    doubtful |= alone < 1e-9
    for frame in np.flatnonzero(doubtful.any(axis=1)):
        seen, there = weights[frame] > 0, head_weights[frame] > 0
        shown = jacobian[frame, seen], weights[frame, seen]
        covariance = compute_covariance(
            *shown,
            positions=positions[frame, seen],
            head_positions=head_positions[there],
            head_weights=head_weights[frame, there],
        )
        variance[frame], bare[frame] = np.diag(covariance), np.diag(compute_covariance(*shown))
    return np.sqrt(variance), np.sqrt(bare)


def _find_unique_rows(weights: FloatArray) -> tuple[FloatArray, NDArray[np.int64]]:
    """Return the distinct rows and the index of each row among them, as `numpy.unique` does."""
    # Sorting them as bytes is much faster than number by number.
    rows = np.ascontiguousarray(weights).view(f"V{8 * weights.shape[1]}").ravel()
    _, first, which = np.unique(rows, return_index=True, return_inverse=True)
    return weights[first], which.reshape(-1)


def _compute_pose_covariance(head_positions: FloatArray, head_weights: FloatArray) -> FloatArray:
    """Compute the covariance of the head's pose per unit of marker variance, ``(frames, 6, 6)``.

    The pose is about the centroid of all head markers; the choice changes nothing.
    """
    head = compute_motion_jacobian(head_positions, head_positions.mean(axis=0))
    pairs = np.einsum("hia,hib->hab", head, head)
    seen, which = _find_unique_rows(head_weights)
    information = np.einsum("fh,hab->fab", seen, pairs)
    # Head markers on a line do not determine a rotation: it counts as exact, not as unbounded.
    inverse = np.linalg.pinv(information, rcond=1e-12, hermitian=True)
    pose = inverse @ np.einsum("fh,hab->fab", seen**2, pairs) @ inverse
    return np.asarray(pose[which])


def find_undetermined(jacobian: FloatArray, weights: FloatArray) -> NDArray[np.bool_]:
    """Find the parameters that the visible markers do not determine.

    Parameters
    ----------
    jacobian
        Jacobian of all frames, ``(markers, 3, parameters)``, millimetres per unit.
    weights
        Weights of the markers, ``(frames, markers)``, no unit; 0 for a hidden marker.

    Returns
    -------
    ndarray
        True for undetermined parameters, ``(frames, parameters)``.
    """
    sets, which = _find_unique_rows(weights)
    pairs = np.einsum("mip,miq->mpq", jacobian, jacobian)
    information = np.einsum("fm,mpq->fpq", sets, pairs)
    alone = np.einsum("fpp->fp", information)
    count = jacobian.shape[2]
    information[:, np.arange(count), np.arange(count)] += 1e-13 * np.maximum(alone, 1e-12)
    left = np.einsum("fpp->fp", np.linalg.inv(information))
    doubtful = (left * alone > _SUSPICIOUS) | (alone < 1e-9)
    result = np.zeros(alone.shape, dtype=bool)
    for i in np.flatnonzero(doubtful.any(axis=1)):
        result[i] = ~_find_determined(np.einsum("m,mpq->pq", sets[i], pairs))
    return np.asarray(result[which])


def estimate_noise(
    distances: FloatArray, weights: FloatArray, parameters: int | FloatArray
) -> float:
    """Estimate the standard deviation of a marker's coordinate from residuals.

    Parameters
    ----------
    distances
        Distances of the markers from their virtual markers, ``(frames, markers)``, millimetres;
        NaN where hidden.
    weights
        Weights of the markers, ``(markers,)``, no unit.
    parameters
        Degrees of freedom that the parameters took from each frame: a number, or ``(frames,)``.

    Returns
    -------
    float
        Standard deviation, millimetres; NaN where no degree of freedom is left.
    """
    sums, freedom = _sum_squares(distances**2, weights, parameters)
    return float(np.sqrt(sums.sum() / freedom.sum())) if len(sums) else float("nan")


def estimate_misfit(
    products: FloatArray, weights: FloatArray, parameters: int | FloatArray
) -> float:
    """Estimate what the face's difference from the speaker leaves in a marker's coordinate.

    Noise is independent from frame to frame, and what remains from one to the next is no noise.

    Parameters
    ----------
    products
        Scalar products of the residuals of markers in a frame and the next, ``(frames, markers)``,
        square millimetres; NaN where hidden in one of them.
    weights
        Weights of the markers, ``(markers,)``, no unit.
    parameters
        Degrees of freedom that the parameters took from each frame: a number, or ``(frames,)``.

    Returns
    -------
    float
        Standard deviation, millimetres, whose square is less by its standard error.
    """
    sums, freedom = _sum_squares(products, weights, parameters)
    least = float(sums.sum() - sums.std() * np.sqrt(len(sums))) if len(sums) else 0.0
    return float(np.sqrt(least / freedom.sum())) if least > 0 else 0.0


def _sum_squares(
    squares: FloatArray, weights: FloatArray, parameters: int | FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the sum of squares and the degrees of freedom of each frame that has any."""
    seen = np.isfinite(squares)
    freedom = 3 * seen.sum(axis=1) - parameters
    frames = freedom > 0
    weighted = np.where(seen, squares, 0.0) * (weights / weights.mean())
    return weighted[frames].sum(axis=1), freedom[frames]


def compute_pose_noise(
    jacobian: FloatArray,
    weights: FloatArray,
    positions: FloatArray,
    head_positions: FloatArray,
    head_weights: FloatArray,
) -> tuple[float, FloatArray]:
    """Compute what the noise of the head's pose adds to residuals and to their gradient.

    Parameters
    ----------
    jacobian
        Jacobian of the visible markers, ``(markers, 3, parameters)``, millimetres per unit.
    weights
        Weights of the markers, ``(markers,)``, no unit.
    positions
        Markers, ``(markers, 3)``, millimetres.
    head_positions
        Head markers, ``(head markers, 3)``, millimetres.
    head_weights
        Weights of the head markers, ``(head markers,)``, no unit.

    Returns
    -------
    excess : float
        Part of the residuals' variance without it, 0 or more.
    covariance : ndarray
        Covariance of ``Jᵀ W`` times the markers' errors, ``(parameters, parameters)``, square
        millimetres per unit variance of a marker's coordinate.
    """
    count = jacobian.shape[2]
    rows, flat = np.repeat(weights, 3), jacobian.reshape(-1, count)
    freedom = len(rows) - count
    if len(head_positions) < 3:
        return 0.0, np.zeros((count, count))
    effect = compute_motion_jacobian(positions, head_positions.mean(axis=0)).reshape(-1, 6)
    across = flat.T @ (rows[:, None] * effect)
    pose = _compute_pose_covariance(head_positions, head_weights[None])[0]
    covariance = across @ pose @ across.T
    if freedom <= 0:
        return 0.0, covariance
    inverse = np.linalg.pinv(flat.T @ (rows[:, None] * flat), rcond=1e-12, hermitian=True)
    left = effect.T @ (rows[:, None] * effect) - across.T @ inverse @ across
    return float(max(np.trace(left @ pose), 0.0) / (freedom * weights.mean())), covariance
