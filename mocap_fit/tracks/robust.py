"""Rigid transforms that leave outlying points out.

A marker that slipped, or that carries another one's name for a while, distorts a least-squares
pose. With four or more points the others show it: if the frame fits far better without one point
than noise allows, that point is left out there. On clean data nothing is left out, so that the
result is plain least squares, which is optimal for Gaussian noise.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mocap_fit.errors import DataError
from mocap_fit.tracks.arrays import FloatArray
from mocap_fit.tracks.rigid import (
    apply_inverse_transforms,
    compute_motion_jacobian,
    estimate_rigid_transforms,
)

# Probability that a clean frame loses a point by mistake.
_FALSE_ALARM = 1e-4
# Noise is never estimated lower than this, in millimetres: files hold three decimals.
_LEAST_NOISE = 1e-3
# A real set is never quite the shape of its reference pose: a point is suspicious whose gain (in
# squares) exceeds what chance explains by the first factor, and bad without regard to other frames
# by the second one.
_SUSPICIOUS, _OBVIOUS = 2.0, 8.0
# The better of two explanations must be a hundred times more likely than the other.
_CLEAR_DIFFERENCE = 2.0 * np.log(100.0)
# Frames that the noise is estimated from, at most, and simulated frames.
_MOST, _SAMPLE = 2000, 1000
# Known frames on each side that a frame is compared with.
_NEARBY = 12
# Frames on each side in which they are searched.
_REACH = 256


@dataclass(frozen=True, eq=False)
class RigidFit:
    """Rigid transforms of all frames, and the points that they are based on.

    Parameters
    ----------
    rotations
        Right-handed, ``(frames, 3, 3)``, no unit; NaN where not determined.
    translations
        ``(frames, 3)``, millimetres; NaN likewise.
    residuals
        Root weighted mean square distance of the points that were used, ``(frames,)``,
        millimetres; NaN likewise.
    weights
        The weight that each point had, ``(frames, points)``, no unit; 0 where it was missing or
        left out.
    rejected
        Points that were seen and left out as bad, ``(frames, points)``, no unit.
    noise
        Standard deviation of a coordinate of a point of weight 1, millimetres, estimated from the
        points that were used; NaN where no frame allows it.
    """

    rotations: FloatArray
    translations: FloatArray
    residuals: FloatArray
    weights: FloatArray
    rejected: NDArray[np.bool_]
    noise: float


def compute_pose_information(source: FloatArray, centre: FloatArray) -> FloatArray:
    """Return the information that each point gives on a small rigid motion.

    With the Jacobian ``J`` of `compute_motion_jacobian`, the matrices are ``Jᵀ J``; their sum over
    the points is the inverse of the covariance of rotation vector and translation per unit
    variance of the coordinates.

    Parameters
    ----------
    source
        ``(points, 3)``, millimetres.
    centre
        What the motion turns about, ``(3,)``, millimetres.

    Returns
    -------
    ndarray
        ``(points, 6, 6)``: square millimetres for the rotation, no unit for the translation.
    """
    jacobian = compute_motion_jacobian(source, centre)
    return np.asarray(np.einsum("pia,pib->pab", jacobian, jacobian))


class _Pattern:
    """Linear theory of the residuals of one set of seen points with their weights."""

    def __init__(self, source: FloatArray, weights: FloatArray) -> None:
        self.root = np.sqrt(weights)
        centre = weights @ source / weights.sum()
        jacobian = compute_motion_jacobian(source, centre)
        design = (self.root[:, None, None] * jacobian).reshape(-1, 6)
        # Residuals of least squares are this projection of the noise.
        base = np.linalg.svd(design, full_matrices=False)[0]
        self.projection = np.eye(len(design)) - base @ base.T
        count = len(source)
        blocks = self.projection.reshape(count, 3, count, 3)
        diagonal = np.stack([blocks[k, :, k, :] for k in range(count)])
        self.inverse = np.linalg.pinv(diagonal, rcond=1e-6, hermitian=True)

    def compute_gains(self, residuals: FloatArray) -> FloatArray:
        """Return by how much the sum of squares falls without each point, ``(frames, points)``.

        The deletion formula of linear regression (Cook and Weisberg 1982, section 2.2):
        ``r_kᵀ (M_kk)⁻¹ r_k``, with the residuals ``(frames, points, 3)`` in the coordinates of
        the source. Under unit noise it is chi-squared with three degrees of freedom.
        """
        white = self.root[:, None] * residuals
        return np.asarray(np.einsum("fki,kij,fkj->fk", white, self.inverse, white))


@lru_cache(maxsize=256)
def _get_pattern(source: bytes, weights: bytes) -> _Pattern:
    return _Pattern(np.frombuffer(source).reshape(-1, 3), np.frombuffer(weights))


def _compute_limit(freedom: int, noise_freedom: float, tests: int) -> float:
    """Return the largest sum of squares, per variance of the noise, that chance explains."""
    from scipy.special import fdtri

    return float(freedom * fdtri(freedom, noise_freedom, 1.0 - _FALSE_ALARM / tests))


def _sum_squares(
    source: FloatArray, target: FloatArray, weights: FloatArray, chosen: NDArray[np.intp]
) -> FloatArray:
    """Return the weighted sum of squares of fits to some of the points; infinite without a fit."""
    weight = weights[chosen]
    _, _, residuals = estimate_rigid_transforms(source[chosen], target[:, chosen], weight)
    squares = residuals**2 * weight.sum()
    return np.where(np.isnan(squares), np.inf, squares)


def _leave_out(count: int, excluded: tuple[int, ...]) -> NDArray[np.intp]:
    return np.array([k for k in range(count) if k not in excluded], dtype=np.intp)


def _estimate_pattern_noise(
    source: FloatArray, target: FloatArray, weights: FloatArray
) -> tuple[float, float]:
    """Return the variance of the noise and its degrees of freedom; one point may be bad.

    Every frame is fitted without the point that fits it worst. That underestimates the noise; by
    how much is found by doing the same to simulated unit noise. The median serves quiet data, the
    ninth decile data whose errors come in stretches; it counts up to twice the noise of the
    median, because two markers that exchange their names may be in it too.
    """
    rotations, translations, residuals = estimate_rigid_transforms(source, target, weights)
    usable = np.flatnonzero(~np.isnan(residuals))
    if not usable.size:
        return np.nan, 0.0
    count, target = source.shape[0], target[usable]
    gains = _get_pattern(source.tobytes(), weights.tobytes()).compute_gains(
        apply_inverse_transforms(target, rotations[usable], translations[usable]) - source
    )
    worst = gains.argmax(axis=1)
    squares = np.full(len(usable), np.inf)
    for point in range(count):
        frames = worst == point
        if frames.any():
            rest = _leave_out(count, (point,))
            squares[frames] = _sum_squares(source, target[frames], weights, rest)
    squares = squares[np.isfinite(squares)]
    if not squares.size:
        return np.nan, 0.0
    unit = _simulate_squares(source.tobytes(), weights.tobytes())
    median, decile = (
        max(float(np.quantile(squares, q) / of_unit_noise), _LEAST_NOISE**2)
        for q, of_unit_noise in zip((0.5, 0.9), unit, strict=True)
    )
    return max(median, min(decile, 4 * median)), float(len(squares) * (3 * count - 9))


@lru_cache(maxsize=64)
def _simulate_squares(source: bytes, weights: bytes) -> tuple[float, float]:
    """Return median and ninth decile of the squares of unit noise without the worst point."""
    pattern = _get_pattern(source, weights)
    count = len(pattern.projection) // 3
    draws = np.random.default_rng(0).standard_normal((_SAMPLE, 3 * count))
    white = draws @ pattern.projection
    unit = np.sum(white**2, axis=1) - pattern.compute_gains(
        white.reshape(_SAMPLE, count, 3) / pattern.root[:, None]
    ).max(axis=1)
    median, decile = np.quantile(unit, (0.5, 0.9))
    return float(median), float(decile)


def _judge(
    source: FloatArray,
    target: FloatArray,
    weights: FloatArray,
    poses: tuple[FloatArray, FloatArray, FloatArray],
    variance: float,
    noise_freedom: float,
) -> tuple[NDArray[np.bool_], NDArray[np.bool_], NDArray[np.bool_]]:
    """Return which points are bad, and in which frames that is known, and obvious.

    All frames show all the points; ``poses`` are their rotations, translations and residuals. The
    fewest points whose absence explains the frame are bad, at most two; where two explanations
    are about as good, nothing is decided. The results are ``(frames, points)``, ``(frames,)``
    and ``(frames,)``.
    """
    frames, count = target.shape[:2]
    bad = np.zeros((frames, count), dtype=bool)
    known = np.ones(frames, dtype=bool)
    rotations, translations, residuals = poses
    gains = _get_pattern(source.tobytes(), weights.tobytes()).compute_gains(
        apply_inverse_transforms(target, rotations, translations) - source
    )
    limit = variance * _compute_limit(3, noise_freedom, count)
    obvious = gains.max(axis=1) > _OBVIOUS * limit
    suspicious = np.flatnonzero(gains.max(axis=1) > _SUSPICIOUS * limit)
    complete = residuals[suspicious] ** 2 * weights.sum() / (3 * count - 6)
    open_frames = np.ones(len(suspicious), dtype=bool)
    for size in range(1, min(2, count - 3) + 1):
        if not open_frames.any():
            break
        choices = list(combinations(range(count), size))
        part = np.flatnonzero(open_frames)
        squares = np.array(
            [
                _sum_squares(source, target[suspicious[part]], weights, _leave_out(count, c))
                for c in choices
            ]
        )
        order = np.argsort(squares, axis=0, kind="stable")
        best = np.take_along_axis(squares, order[:1], axis=0)[0]
        second = np.take_along_axis(squares, order[1:2], axis=0)[0]
        freedom = 3 * (count - size) - 6
        explains = best <= variance * _compute_limit(freedom, noise_freedom, len(choices))
        if size == 1:
            # A frame that is noisy all over is not explained by any one point; but where one
            # point makes three quarters of it and more, the frame is better without.
            explains |= best / freedom < 0.25 * complete[part]
        clear = second - best > variance * _CLEAR_DIFFERENCE
        for position in np.flatnonzero(explains & clear):
            bad[suspicious[part[position]], list(choices[order[0, position]])] = True
        known[suspicious[part[explains & ~clear]]] = False
        open_frames[part[explains]] = False
    known[suspicious[open_frames]] = False
    return bad, known, obvious


def _compare_with_neighbours(
    bad: NDArray[np.bool_],
    known: NDArray[np.bool_],
    obvious: NDArray[np.bool_],
    seen: NDArray[np.bool_],
) -> NDArray[np.bool_]:
    """Return points that are bad in most of the known frames nearby, or obviously.

    A marker that slipped stays bad for a while, also in the frames that cannot show it. One that
    is near the limit must not make the pose jump to and fro.
    """
    where = np.flatnonzero(known)
    if not len(where) or not bad.any():
        return bad
    sums = np.concatenate([np.zeros((1, bad.shape[1])), np.cumsum(bad[where], axis=0)])
    frames = np.arange(len(bad))
    position = np.searchsorted(where, frames)
    nearest = np.searchsorted(where, frames - _REACH)
    farthest = np.searchsorted(where, frames + _REACH, side="right")
    first = np.clip(position - _NEARBY, nearest, None)
    last = np.clip(position + _NEARBY + known, None, farthest)
    most = 2 * (sums[last] - sums[first]) > (last - first)[:, None]
    return np.asarray((bad & obvious[:, None]) | (most & seen))


def _measure_noise(residuals: FloatArray, weights: FloatArray) -> float:
    """Return the standard deviation of a coordinate, from the points that were used."""
    freedom = 3 * (weights > 0).sum(axis=1) - 6
    usable = ~np.isnan(residuals) & (freedom >= 3)
    if not usable.any():
        return np.nan
    squares = residuals[usable] ** 2 * weights[usable].sum(axis=1)
    # Median of chi-squared (Wilson and Hilferty 1931).
    middle = freedom[usable] * (1 - 2 / (9 * freedom[usable])) ** 3
    return float(np.sqrt(np.median(squares / middle)))


def estimate_robust_transforms(
    source: ArrayLike, target: ArrayLike, weights: ArrayLike | None = None
) -> RigidFit:
    """Find the rigid transform of every frame, leaving bad points out.

    Parameters
    ----------
    source
        The body's shape, ``(points, 3)``, millimetres; points with NaN are left out.
    target
        ``(frames, points, 3)``, millimetres; NaN where a point is not seen.
    weights
        Reciprocals of the points' relative variances, ``(points,)``, no unit; all 1 where left
        out.

    Returns
    -------
    RigidFit
        The transforms; frames with fewer than three good points, or good points on a line, have
        NaN.

    Raises
    ------
    DataError
        If the shapes do not match or a weight is negative.

    Notes
    -----
    A point is suspected in a frame when (1) without it the squares fall by twice of what the
    noise of the recording does in one clean frame of 10 000; (2) the other points then agree;
    (3) no other point explains the frame about as well. It is left out where it is suspected in
    most of the frames nearby that can show it (with three points in view, nothing can be found out
    otherwise), and in single frames where the case is obvious.
    """
    points = np.asarray(source, dtype=np.float64)
    goals = np.asarray(target, dtype=np.float64)
    base = np.ones(len(points)) if weights is None else np.asarray(weights, dtype=np.float64)
    if base.shape != points.shape[:1]:
        raise DataError(
            "the weights have the wrong shape", found=base.shape, expected=points.shape[:1]
        )
    # This call also checks shapes and weights.
    rotations, translations, residuals = estimate_rigid_transforms(points, goals, base)
    seen = ~(np.isnan(points).any(axis=1) | np.isnan(goals).any(axis=2)) & (base > 0)
    bad = np.zeros(seen.shape, dtype=bool)
    known = seen.sum(axis=1) >= 4
    known &= ~np.isnan(residuals)
    obvious = np.zeros(len(goals), dtype=bool)
    if known.any():
        patterns, number = np.unique(seen[known], axis=0, return_inverse=True)
        number = number.reshape(-1)
        frames = np.flatnonzero(known)
        variance, freedom = _estimate_noise(points, goals, base)
        if np.isfinite(variance):
            for index, pattern in enumerate(patterns):
                chosen, part = np.flatnonzero(pattern), frames[number == index]
                judged, sure, clear = _judge(
                    points[chosen],
                    goals[np.ix_(part, chosen)],
                    base[chosen],
                    (rotations[part], translations[part], residuals[part]),
                    variance,
                    freedom,
                )
                bad[np.ix_(part, chosen)] = judged
                known[part], obvious[part] = sure, clear
            bad = _compare_with_neighbours(bad, known, obvious, seen)
    weight = np.where(seen & ~bad, base, 0.0)
    again = np.flatnonzero(bad.any(axis=1))
    if len(again):
        rotations[again], translations[again], residuals[again] = estimate_rigid_transforms(
            points, goals[again], weight[again]
        )
    noise = _measure_noise(residuals, weight)
    return RigidFit(rotations, translations, residuals, weight, bad, noise)


def sample_evenly(rows: FloatArray, limit: int) -> FloatArray:
    """Return every 2ᵏ-th row, with the smallest k that leaves no more rows than a limit.

    Parameters
    ----------
    rows
        An array in any unit, ``(rows, ...)``.
    limit
        Largest number of rows to return.

    Returns
    -------
    ndarray
        A view, ``(rows, ...)``.
    """
    stride = 1
    while -(-len(rows) // stride) > limit:
        stride *= 2
    return rows[::stride]


def _estimate_noise(
    source: FloatArray, target: FloatArray, weights: FloatArray
) -> tuple[float, float]:
    """Return the variance of a coordinate of a point of weight 1, and its degrees of freedom.

    It is that of the frames which show the most common set of four or more points; NaN and 0
    where there is none.
    """
    seen = ~(np.isnan(source).any(axis=1) | np.isnan(target).any(axis=2)) & (weights > 0)
    enough = np.flatnonzero(seen.sum(axis=1) >= 4)
    if not enough.size:
        return np.nan, 0.0
    patterns, which, counts = np.unique(
        seen[enough], axis=0, return_inverse=True, return_counts=True
    )
    commonest = int(counts.argmax())
    points = np.flatnonzero(patterns[commonest])
    frames = sample_evenly(enough[which.reshape(-1) == commonest], _MOST)
    return _estimate_pattern_noise(source[points], target[np.ix_(frames, points)], weights[points])
