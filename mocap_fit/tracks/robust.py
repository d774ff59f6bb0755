"""Rigid transforms that do not follow a bad point.

A marker that slipped, or that carries another one's name for a while, pulls a least-squares pose
with it. With four or more points the others tell: if the frame fits far better without one point
than noise allows, that point is left out there. On clean data nothing is left out, so that the
answer is plain least squares, which is the best there is for Gaussian noise.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mocap_fit.errors import DataError
from mocap_fit.tracks.rigid import rigid_transforms
from mocap_fit.tracks.types import FloatArray

#: How often a clean frame may lose a point by mistake.
FALSE_ALARM = 1e-4
#: Noise is never taken to be smaller than this, in millimetres: files hold three decimals.
LEAST_NOISE = 1e-3
# A real set is never quite the shape of its reference pose; a point is bad that is worse than
# chance by this factor (in squares), and bad without regard to other frames by the second one.
_SUSPICIOUS, _OBVIOUS = 2.0, 8.0
# The better of two explanations must be a hundred times more likely than the other.
_CLEAR_DIFFERENCE = 2.0 * np.log(100.0)
# Frames that are looked at to learn the noise, at most, and that are simulated.
_MOST, _SAMPLE = 2000, 1000
# Known frames on each side that a frame is compared with.
_NEARBY = 12
#: They are looked for no farther than this many frames away.
REACH = 256


@dataclass(frozen=True, eq=False)
class RigidFit:
    """Rigid transforms of all frames, and the points that they rest on.

    Parameters
    ----------
    rotations, translations, residuals
        As `rigid_transforms` returns them: `(frames, 3, 3)`, `(frames, 3)`, `(frames,)`.
    weights
        `(frames, points)`: the weight that each point had; 0 where it was missing or left out.
    rejected
        `(frames, points)`: points that were seen and left out as bad.
    noise
        Standard deviation of a coordinate of a point of weight 1, millimetres, learnt from the
        points that were kept; NaN where no frame can tell.
    """

    rotations: FloatArray
    translations: FloatArray
    residuals: FloatArray
    weights: FloatArray
    rejected: NDArray[np.bool_]
    noise: float


def pose_information(source: FloatArray, centre: FloatArray) -> FloatArray:
    """What each point tells of a small rigid motion, `(points, 6, 6)`.

    A turn ``ω`` about the centre and a shift ``τ`` move a point ``p`` by
    ``ω × (p - centre) + τ``. With the Jacobian ``J = [-(p - centre)×, I]`` of that, the matrices
    are ``Jᵀ J``; their sum over the points is the inverse of the covariance of ``(ω, τ)`` per
    unit variance of the coordinates.

    Parameters
    ----------
    source
        `(points, 3)`.
    centre
        `(3,)`.
    """
    jacobian = _jacobian(source - centre)
    return np.asarray(np.einsum("pia,pib->pab", jacobian, jacobian))


def _jacobian(arms: FloatArray) -> FloatArray:
    x, y, z = arms.T
    zero = np.zeros_like(x)
    turn = np.array([[zero, z, -y], [-z, zero, x], [y, -x, zero]])
    shift = np.broadcast_to(np.eye(3)[:, :, None], (3, 3, len(x)))
    return np.concatenate([turn, shift], axis=1).transpose(2, 0, 1)


class _Pattern:
    """What the linear theory says of one set of seen points with their weights."""

    def __init__(self, source: FloatArray, weights: FloatArray) -> None:
        self.root = np.sqrt(weights)
        centre = weights @ source / weights.sum()
        design = (self.root[:, None, None] * _jacobian(source - centre)).reshape(-1, 6)
        # Residuals of least squares are this projection of the noise.
        base = np.linalg.svd(design, full_matrices=False)[0]
        self.projection = np.eye(len(design)) - base @ base.T
        count = len(source)
        blocks = self.projection.reshape(count, 3, count, 3)
        own = np.stack([blocks[k, :, k, :] for k in range(count)])
        self.inverse = np.linalg.pinv(own, rcond=1e-6, hermitian=True)

    def gains(self, residuals: FloatArray) -> FloatArray:
        """By how much the sum of squares falls without each point, `(frames, points)`.

        The deletion formula of linear regression: ``r_kᵀ (M_kk)⁻¹ r_k``, with the residuals
        `(frames, points, 3)` in the coordinates of the source. Under unit noise it is
        chi-squared with three degrees of freedom.
        """
        white = self.root[:, None] * residuals
        return np.asarray(np.einsum("fki,kij,fkj->fk", white, self.inverse, white))


@lru_cache(maxsize=256)
def _pattern(source: bytes, weights: bytes) -> _Pattern:
    return _Pattern(np.frombuffer(source).reshape(-1, 3), np.frombuffer(weights))


def _limit(freedom: int, noise_freedom: float, tests: int) -> float:
    """Largest sum of squares, in units of the noise's variance, that chance explains."""
    from scipy.special import fdtri

    noise_freedom = max(1.0, min(noise_freedom, 1e6))
    return float(freedom * fdtri(freedom, noise_freedom, 1.0 - FALSE_ALARM / tests))


def _point_residuals(
    source: FloatArray, target: FloatArray, rotations: FloatArray, translations: FloatArray
) -> FloatArray:
    """Residuals in the coordinates of the source, `(frames, points, 3)`."""
    turned_back = np.einsum("fji,fpj->fpi", rotations, target - translations[:, None, :])
    return np.asarray(turned_back - source)


def _sums_of_squares(
    source: FloatArray, target: FloatArray, weights: FloatArray, chosen: NDArray[np.intp]
) -> FloatArray:
    """Weighted sum of squares of a fit to some of the points; infinite where there is none."""
    weight = weights[chosen]
    _, _, residuals = rigid_transforms(source[chosen], target[:, chosen], weight)
    squares = residuals**2 * weight.sum()
    return np.where(np.isnan(squares), np.inf, squares)


def _without(count: int, left_out: tuple[int, ...]) -> NDArray[np.intp]:
    return np.array([k for k in range(count) if k not in left_out], dtype=np.intp)


def _noise(source: FloatArray, target: FloatArray, weights: FloatArray) -> tuple[float, float]:
    """Variance of the noise and its degrees of freedom, though one point may be bad throughout.

    Every frame is fitted without the point that fits it worst. That flatters the noise; by how
    much is found by doing the same to simulated unit noise. The median serves quiet data, the
    ninth decile those whose errors come in stretches; it counts for up to twice the noise of the
    median, because two markers that exchange their names may be in it too.
    """
    rotations, translations, residuals = rigid_transforms(source, target, weights)
    usable = np.flatnonzero(~np.isnan(residuals))
    if not usable.size:
        return np.nan, 0.0
    count, target = source.shape[0], target[usable]
    gains = _pattern(source.tobytes(), weights.tobytes()).gains(
        _point_residuals(source, target, rotations[usable], translations[usable])
    )
    worst = gains.argmax(axis=1)
    squares = np.full(len(usable), np.inf)
    for point in range(count):
        frames = worst == point
        if frames.any():
            left = _without(count, (point,))
            squares[frames] = _sums_of_squares(source, target[frames], weights, left)
    squares = squares[np.isfinite(squares)]
    if not squares.size:
        return np.nan, 0.0
    unit = _simulated(source.tobytes(), weights.tobytes())
    median, decile = (
        max(float(np.quantile(squares, q) / of_noise), LEAST_NOISE**2)
        for q, of_noise in zip((0.5, 0.9), unit, strict=True)
    )
    return max(median, min(decile, 4 * median)), float(len(squares) * (3 * count - 9))


@lru_cache(maxsize=64)
def _simulated(source: bytes, weights: bytes) -> tuple[float, float]:
    """Median and ninth decile of the sum of squares without the worst point, of unit noise."""
    pattern = _pattern(source, weights)
    count = len(pattern.projection) // 3
    draws = np.random.default_rng(0).standard_normal((_SAMPLE, 3 * count))
    white = draws @ pattern.projection
    unit = np.sum(white**2, axis=1) - pattern.gains(
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
    """Which points are bad, `(frames, points)`, where that is known, and obvious, `(frames,)`.

    All frames show all the points given; ``poses`` are their rotations, translations and
    residuals. The fewest points whose absence explains the frame are left out, at most two; where
    two explanations are about as good, nothing is decided.
    """
    frames, count = target.shape[:2]
    bad = np.zeros((frames, count), dtype=bool)
    known = np.ones(frames, dtype=bool)
    rotations, translations, residuals = poses
    gains = _pattern(source.tobytes(), weights.tobytes()).gains(
        _point_residuals(source, target, rotations, translations)
    )
    limit = variance * _limit(3, noise_freedom, count)
    obvious = gains.max(axis=1) > _OBVIOUS * limit
    suspicious = np.flatnonzero(gains.max(axis=1) > _SUSPICIOUS * limit)
    whole = residuals[suspicious] ** 2 * weights.sum() / (3 * count - 6)
    open_frames = np.ones(len(suspicious), dtype=bool)
    for size in range(1, min(2, count - 3) + 1):
        if not open_frames.any():
            break
        choices = list(combinations(range(count), size))
        part = np.flatnonzero(open_frames)
        squares = np.array(
            [
                _sums_of_squares(source, target[suspicious[part]], weights, _without(count, c))
                for c in choices
            ]
        )
        order = np.argsort(squares, axis=0, kind="stable")
        best = np.take_along_axis(squares, order[:1], axis=0)[0]
        second = np.take_along_axis(squares, order[1:2], axis=0)[0]
        freedom = 3 * (count - size) - 6
        explains = best <= variance * _limit(freedom, noise_freedom, len(choices))
        if size == 1:
            # A frame that is noisy all over is not explained by any one point; but where one
            # point makes three quarters of it and more, the frame is better without.
            explains |= best / freedom < 0.25 * whole[part]
        clear = second - best > variance * _CLEAR_DIFFERENCE
        for position in np.flatnonzero(explains & clear):
            bad[suspicious[part[position]], list(choices[order[0, position]])] = True
        known[suspicious[part[explains & ~clear]]] = False
        open_frames[part[explains]] = False
    known[suspicious[open_frames]] = False
    return bad, known, obvious


def _with_neighbours(
    bad: NDArray[np.bool_],
    known: NDArray[np.bool_],
    obvious: NDArray[np.bool_],
    seen: NDArray[np.bool_],
) -> NDArray[np.bool_]:
    """Points that are bad in most of the known frames nearby, or obviously, `(frames, points)`.

    A marker that slipped stays bad for a while, also in the frames that cannot tell. One that is
    now just above the limit and now just below must not make the pose jump to and fro.
    """
    where = np.flatnonzero(known)
    if not len(where) or not bad.any():
        return bad
    sums = np.concatenate([np.zeros((1, bad.shape[1])), np.cumsum(bad[where], axis=0)])
    frames = np.arange(len(bad))
    place = np.searchsorted(where, frames)
    nearest, farthest = (
        np.searchsorted(where, frames - REACH),
        np.searchsorted(where, frames + REACH, side="right"),
    )
    first = np.clip(place - _NEARBY, nearest, None)
    last = np.clip(place + _NEARBY + known, None, farthest)
    most = 2 * (sums[last] - sums[first]) > (last - first)[:, None]
    return np.asarray((bad & obvious[:, None]) | (most & seen))


def _remaining_noise(residuals: FloatArray, weights: FloatArray) -> float:
    """Standard deviation of a coordinate, from the points that were kept."""
    freedom = 3 * (weights > 0).sum(axis=1) - 6
    usable = ~np.isnan(residuals) & (freedom >= 3)
    if not usable.any():
        return np.nan
    squares = residuals[usable] ** 2 * weights[usable].sum(axis=1)
    # Median of chi-squared, after Wilson and Hilferty.
    middle = freedom[usable] * (1 - 2 / (9 * freedom[usable])) ** 3
    return float(np.sqrt(np.median(squares / middle)))


def robust_rigid_transforms(
    source: ArrayLike,
    target: ArrayLike,
    weights: ArrayLike | None = None,
) -> RigidFit:
    """Find the rigid transform of every frame, leaving bad points out.

    Parameters
    ----------
    source
        `(points, 3)`, the body's shape; points with NaN are left out.
    target
        `(frames, points, 3)`; NaN where a point is not seen.
    weights
        `(points,)`: reciprocals of the points' relative variances; all 1 when not given.

    Returns
    -------
    RigidFit
        Frames with fewer than three good points, or good points on a line, have NaN.

    Raises
    ------
    DataError
        If the shapes do not match or a weight is negative.

    Notes
    -----
    A point is suspected in a frame when (1) without it the squares fall by twice of what noise of
    the recording's own size does in one clean frame of 10 000; (2) the other points then agree;
    (3) no other point explains the frame about as well. It is left out where it is suspected in
    most of the frames nearby that can tell (with three points in view, nothing could be found out
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
    rotations, translations, residuals = rigid_transforms(points, goals, base)
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
                found, sure, clear = _judge(
                    points[chosen],
                    goals[np.ix_(part, chosen)],
                    base[chosen],
                    (rotations[part], translations[part], residuals[part]),
                    variance,
                    freedom,
                )
                bad[np.ix_(part, chosen)] = found
                known[part], obvious[part] = sure, clear
            bad = _with_neighbours(bad, known, obvious, seen)
    weight = np.where(seen & ~bad, base, 0.0)
    again = np.flatnonzero(bad.any(axis=1))
    if len(again):
        rotations[again], translations[again], residuals[again] = rigid_transforms(
            points, goals[again], weight[again]
        )
    left = _remaining_noise(residuals, weight)
    return RigidFit(rotations, translations, residuals, weight, bad, left)


def sample_evenly(rows: FloatArray, limit: int) -> FloatArray:
    """Return every 2ᵏ-th row, with the smallest k that leaves no more rows than a limit.

    Parameters
    ----------
    rows
        Any array of no unit, ``(rows, ...)``.
    limit
        Largest number of rows to return.

    Returns
    -------
    ndarray
        The rows, a view.
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
    return _noise(source[points], target[np.ix_(frames, points)], weights[points])
