"""The algebra of smooth tracks: banded normal equations and roughness.

A track's roughness is the integral of its squared second derivative,
``∫ x''² dt ≈ rate³ · sum (x[t+1] - 2 x[t] + x[t-1])²``, the same at any frame rate. In the order
of the frames, the normal equations of all tracks together couple a parameter only with itself up
to two frames away: their matrix is banded, twice the number of parameters wide on either side, and
time and memory are proportional to the number of frames.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_solve_banded, cholesky_banded
from scipy.optimize import minimize_scalar

from mocap_fit.tracks import FloatArray

BoolArray = NDArray[np.bool_]

# Largest number of rounds of the active set, each a banded solve; three or four are usual. Number
# of rounds without progress before constraints change one at a time.
_ACTIVE_SET_ROUNDS = 100
_PATIENCE = 5
# Range of smoothing times in which the likelihood is maximised: up to so many seconds, from so many
# frames.
_LONGEST_SMOOTHING = 1.0
_SHORTEST_SMOOTHING = 0.1
# Frames that are no farther apart than this, in seconds, belong to one gesture; observations that
# the prior of equal strengths is worth; and rounds, after which little changes.
_SAME_GESTURE = 0.04
_PRIOR_COUNT = 0.5
_FIXED_POINT_ROUNDS = 12


def compute_curvature(tracks: FloatArray, rate: float) -> FloatArray:
    """Compute second differences whose sum of squares is the roughness.

    Parameters
    ----------
    tracks
        Tracks, ``(frames, ...)``, in any unit.
    rate
        Frame rate, hertz.

    Returns
    -------
    ndarray
        Second differences, ``(frames - 2, ...)``; empty for fewer than three frames.
    """
    return np.asarray(np.diff(tracks, n=2, axis=0) * rate**1.5)


def build_roughness_bands(frames: int, rate: float, strengths: FloatArray) -> FloatArray:
    """Build the matrix of the quadratic form ``sum of strength · curvature²`` for each track.

    Parameters
    ----------
    frames
        Number of frames.
    rate
        Frame rate, hertz.
    strengths
        Weights of the second differences, ``(frames - 2, parameters)`` or a shape that broadcasts
        to it; in the unit of the cost over that of ``curvature²``.

    Returns
    -------
    ndarray
        Diagonal, and the entries one and two frames below it, each at its column, ``(3, frames,
        parameters)``, as `scipy.linalg.cholesky_banded` takes them with ``lower=True``.
    """
    scaled = np.asarray(strengths) * rate**3
    bands = np.zeros((3, frames, scaled.shape[-1]))
    if frames > 2:
        bands[0, :-2] += scaled
        bands[0, 1:-1] += 4.0 * scaled
        bands[0, 2:] += scaled
        bands[1, :-2] -= 2.0 * scaled
        bands[1, 1:-1] -= 2.0 * scaled
        bands[2, :-2] += scaled
    return bands


def build_banded(blocks: FloatArray, bands: FloatArray) -> FloatArray:
    """Build the lower banded form of ``block diagonal + prior``.

    Parameters
    ----------
    blocks
        Symmetric blocks of the frames, ``(frames, parameters, parameters)``, in any unit.
    bands
        Bands of each parameter, ``(3, frames, parameters)``, in the same unit.

    Returns
    -------
    ndarray
        Banded matrix, ``(2 parameters + 1, frames · parameters)``, in the order of the frames.
    """
    frames, count = blocks.shape[:2]
    matrix = np.zeros((2 * count + 1, frames, count))
    for row in range(count):
        for column in range(row + 1):
            matrix[row - column, :, column] = blocks[:, row, column]
    for step in range(3):
        matrix[step * count] += bands[step]
    return matrix.reshape(2 * count + 1, -1)


def multiply(blocks: FloatArray, bands: FloatArray, tracks: FloatArray) -> FloatArray:
    """Multiply ``block diagonal + prior`` by tracks.

    Parameters
    ----------
    blocks
        Symmetric blocks of the frames, ``(frames, parameters, parameters)``, in any unit.
    bands
        Bands of each parameter, ``(3, frames, parameters)``, in the same unit.
    tracks
        Tracks, ``(frames, parameters)``, in any unit.

    Returns
    -------
    ndarray
        Product, ``(frames, parameters)``.
    """
    product = np.einsum("tij,tj->ti", blocks, tracks) + bands[0] * tracks
    for step in (1, 2):
        below = bands[step, :-step]
        product[step:] += below * tracks[:-step]
        product[:-step] += below * tracks[step:]
    return np.asarray(product)


def minimise_in_box(
    blocks: FloatArray,
    bands: FloatArray,
    gradient: FloatArray,
    lower: FloatArray,
    upper: FloatArray,
) -> FloatArray:
    """Minimise ``½ dᵀ A d + gradient · d`` with ``lower <= d <= upper``.

    The primal-dual active set method (Hintermüller, Ito and Kunisch, SIAM J. Optim. 13, 2002):
    variables on a bound are fixed, the rest is solved, and variables whose multiplier has the
    wrong sign, or which leave the box, change sides; one at a time, should the sets not settle
    (Júdice and Pires, Computers and Operations Research 21, 1994). The result is clipped to the
    box, in case they never do.

    Parameters
    ----------
    blocks
        Blocks of the positive definite matrix A, ``(frames, parameters, parameters)``, any unit.
    bands
        Bands of A, ``(3, frames, parameters)``, in the same unit.
    gradient
        Gradient, ``(frames, parameters)``, in any unit.
    lower
        Lower bounds, ``(frames, parameters)``, in the unit of the result.
    upper
        Upper bounds, ``(frames, parameters)``, in the unit of the result.

    Returns
    -------
    ndarray
        Minimum, ``(frames, parameters)``.

    Raises
    ------
    numpy.linalg.LinAlgError
        If the matrix is not positive definite.
    """
    matrix = build_banded(blocks, bands)
    stiffness = matrix[0].reshape(gradient.shape)
    at_lower = at_upper = np.zeros(gradient.shape, dtype=bool)
    step = np.zeros_like(gradient)
    fewest, patience = step.size + 1, _PATIENCE
    for _ in range(_ACTIVE_SET_ROUNDS):
        fixed = at_lower | at_upper
        step = np.where(at_lower, lower, np.where(at_upper, upper, 0.0))
        if fixed.any():
            right = -gradient - multiply(blocks, bands, step)
            part = _fix_variables(matrix, fixed.ravel())
            step = np.where(fixed, step, _solve(part, np.where(fixed, 0.0, right)))
        else:
            step = _solve(matrix, -gradient)
        multiplier = -gradient - multiply(blocks, bands, step)
        multiplier[~fixed] = 0.0
        new_lower = multiplier + stiffness * (step - lower) < 0
        new_upper = multiplier + stiffness * (step - upper) > 0
        changed = np.flatnonzero((new_lower != at_lower) | (new_upper != at_upper))
        if not len(changed):
            break
        if len(changed) < fewest:
            fewest, patience = len(changed), _PATIENCE
        elif patience:
            patience -= 1
        else:
            # Changing one variable at a time always ends (Murty's rule).
            keep = np.arange(step.size).reshape(step.shape) != changed[-1]
            new_lower = np.where(keep, at_lower, new_lower)
            new_upper = np.where(keep, at_upper, new_upper)
        at_lower, at_upper = new_lower, new_upper
    return np.clip(step, lower, upper)


def _solve(matrix: FloatArray, right: FloatArray) -> FloatArray:
    """Solve a positive definite banded system."""
    factor = cholesky_banded(matrix, lower=True, check_finite=False)
    solution = cho_solve_banded((factor, True), right.ravel(), check_finite=False)
    return np.asarray(solution.reshape(right.shape))


def _fix_variables(matrix: FloatArray, fixed: BoolArray) -> FloatArray:
    """Replace rows and columns of fixed variables by those of the identity."""
    part = matrix.copy()
    for offset in range(min(len(part), part.shape[1])):
        end = part.shape[1] - offset
        part[offset, :end][fixed[:end] | fixed[offset:]] = 0.0
    part[0, fixed] = 1.0
    return part


def compute_inverse_blocks(blocks: FloatArray, bands: FloatArray) -> FloatArray:
    """Compute the block diagonal of the inverse, exactly.

    In pairs of frames the matrix is block tridiagonal, ``A = L Lᵀ``, and with ``l`` the factor's
    block of a pair and ``m`` the one below it, the inverse follows from the last pair to the
    first, ``S[k] = l⁻ᵀ l⁻¹ + g S[k+1] gᵀ`` with ``g = l⁻ᵀ mᵀ`` (Takahashi, Fagan and Chen, 1973;
    for state space models it is the smoother of Rauch, Tung and Striebel).

    Parameters
    ----------
    blocks
        Blocks of the positive definite matrix, ``(frames, parameters, parameters)``, any unit.
    bands
        Bands of the matrix, ``(3, frames, parameters)``, in the same unit.

    Returns
    -------
    ndarray
        Blocks of the inverse, ``(frames, parameters, parameters)``.
    """
    frames, count = blocks.shape[:2]
    factor = cholesky_banded(build_banded(blocks, bands), lower=True, check_finite=False)
    size = 2 * count
    pairs = -(-frames // 2)
    # One frame more completes the last pair; it is coupled to nothing.
    padded = np.zeros((size + 1, pairs * size))
    padded[0] = 1.0
    padded[:, : factor.shape[1]] = factor
    columns = padded.reshape(size + 1, pairs, size)
    blocks_of_pairs, next_below = np.zeros((pairs, size, size)), np.zeros((pairs, size, size))
    for column in range(size):
        blocks_of_pairs[:, column:, column] = columns[: size - column, :, column].T
        next_below[:, : column + 1, column] = columns[size - column :, :, column].T
    inverse = np.linalg.inv(blocks_of_pairs)
    gain = np.swapaxes(next_below @ inverse, 1, 2)
    spread = np.swapaxes(inverse, 1, 2) @ inverse
    for pair in range(pairs - 2, -1, -1):
        spread[pair] += gain[pair] @ spread[pair + 1] @ gain[pair].T
    halves = np.empty((pairs, 2, count, count))
    halves[:, 0] = spread[:, :count, :count]
    halves[:, 1] = spread[:, count:, count:]
    return halves.reshape(2 * pairs, count, count)[:frames]


def estimate_smoothing(
    tracks: Sequence[FloatArray], deviations: Sequence[FloatArray], rate: float
) -> tuple[float, float]:
    """Estimate the smoothing of a noisy track, and its noise, by maximum likelihood.

    The model is a track whose second derivative is white noise of unknown strength, plus
    independent noise of known standard deviations times a factor of 1 or more. Strength and factor
    maximise the marginal likelihood with the straight line left free (restricted likelihood;
    "generalised maximum likelihood" of Wahba, Annals of Statistics 13, 1985).

    Parameters
    ----------
    tracks
        Segments of the track, ``(frames,)`` each, in any unit; NaN is missing.
    deviations
        Standard deviations of the noise of every frame, ``(frames,)`` each, in the unit of the
        track: the least that they can be.
    rate
        Frame rate, hertz.

    Returns
    -------
    smoothing : float
        Lambda of ``sum ((y - x) / deviation)² + lambda ∫ x''² dt``.
    noise : float
        Factor of the noise's variance: 1 or more.

    Notes
    -----
    The spectrum of speech gestures falls faster than that of this prior. Without a least noise,
    the likelihood would take the noise at high frequencies for gestures, and smooth a clean track
    hardly at all.
    """
    parts = []
    for track, deviation in zip(tracks, deviations, strict=True):
        seen = np.isfinite(track)
        if seen.sum() > 2:
            information = np.where(seen, 1.0 / deviation**2, 0.0)
            parts.append((np.where(seen, track, 0.0), information))
    if not parts:
        return 0.0, 1.0
    typical = float(np.median(np.concatenate([w[w > 0] for _, w in parts])))
    freedom = sum(int((w > 0).sum()) - 2 for _, w in parts)
    differences = sum(len(w) - 2 for _, w in parts)
    forms = [build_roughness_bands(len(w), 1.0, np.ones(1))[:, :, 0] for _, w in parts]

    def _evaluate_likelihood(log_ratio: float) -> tuple[float, float]:
        """Return the noise factor and minus twice the log likelihood."""
        ratio = float(np.exp(log_ratio))
        squares = log_determinant = 0.0
        for (y, information), form in zip(parts, forms, strict=True):
            weight = information / typical
            matrix = ratio * form
            matrix[0] += weight
            factor = cholesky_banded(matrix, lower=True, check_finite=False)
            smooth = cho_solve_banded((factor, True), weight * y, check_finite=False)
            squares += float(weight @ (y - smooth) ** 2)
            squares += ratio * float(np.sum(np.diff(smooth, n=2) ** 2))
            log_determinant += 2.0 * float(np.log(factor[0]).sum())
        squares *= typical
        noise = max(squares / freedom, 1.0)
        rest = log_determinant - differences * log_ratio
        return noise, freedom * float(np.log(noise)) + squares / noise + rest

    # The smoothing time is the fourth root of the ratio, in frames.
    ends = 4 * np.log(_SHORTEST_SMOOTHING), 4 * np.log(max(_LONGEST_SMOOTHING * rate, 2.0))
    grid = np.linspace(*ends, 14)
    best = int(np.argmin([_evaluate_likelihood(g)[1] for g in grid]))
    around = grid[max(best - 1, 0)], grid[min(best + 1, len(grid) - 1)]
    log_ratio = minimize_scalar(
        lambda g: _evaluate_likelihood(g)[1],
        bounds=around,
        method="bounded",
        options={"xatol": 0.02},
    ).x
    return float(np.exp(log_ratio)) * typical / rate**3, _evaluate_likelihood(log_ratio)[0]


def estimate_local_smoothing(
    tracks: Sequence[FloatArray],
    deviations: Sequence[FloatArray],
    smoothing: FloatArray,
    rate: float,
) -> list[FloatArray]:
    """Estimate the smoothing of tracks at every moment: less where a gesture is quick.

    The strength q of the second derivative at each moment is that of the track times a factor,
    common to the moments around it, whose prior is worth `_PRIOR_COUNT` observations of 1: in
    effect a prior with heavy tails, under which quick gestures are not improbable. The factors are
    the fixed point of the marginal likelihood: a variance is the sum of squares of the posterior
    means over the number of them that the data determine, ``1 - posterior variance / prior
    variance`` each (MacKay, Neural Computation 4, 1992; Tipping, Journal of Machine Learning
    Research 1, 2001).

    Parameters
    ----------
    tracks
        Segments of the tracks, ``(frames, parameters)`` each, in any unit.
    deviations
        Standard deviations of their noise, ``(frames, parameters)`` each, in the unit of the
        tracks; infinite where a value is missing.
    smoothing
        Lambda of each track, ``(parameters,)``, from `estimate_smoothing`, in the unit of the
        squared noise over the roughness.
    rate
        Frame rate, hertz.

    Returns
    -------
    list of ndarray
        Lambda of every second difference of each segment, ``(frames - 2, parameters)``.
    """
    count = len(smoothing)
    smoothing = np.maximum(smoothing, 1e-30)
    information = [1.0 / d**2 for d in deviations]
    known = [np.where(w > 0, t, 0.0) for w, t in zip(information, tracks, strict=True)]
    strengths = 1.0 / smoothing
    factors = [np.ones((max(len(t) - 2, 0), count)) for t in tracks]
    for _ in range(_FIXED_POINT_ROUNDS):
        squares, determined = np.zeros(count), np.zeros(count)
        for i, (y, weight) in enumerate(zip(known, information, strict=True)):
            if len(y) < 3:
                continue
            bands = build_roughness_bands(len(y), rate, 1.0 / (strengths * factors[i]))
            bands[0] += weight
            mean, spread = _compute_curvature_posterior(bands, weight * y, rate)
            share = np.clip(1.0 - spread / (strengths * factors[i]), 0.0, 1.0)
            squares += np.sum(mean**2 / factors[i], axis=0)
            determined += share.sum(axis=0)
            near = round(_SAME_GESTURE * rate)
            factors[i] = (_PRIOR_COUNT + _sum_nearby(mean**2, near) / strengths) / (
                _PRIOR_COUNT + _sum_nearby(share, near)
            )
        # A strength changes by a factor of 100 at most: the smoothing time by about three.
        change = np.divide(
            squares, strengths * determined, out=np.ones(count), where=determined > 1
        )
        strengths = np.clip(strengths * change, 0.01 / smoothing, 100.0 / smoothing)
    return [1.0 / (strengths * f) for f in factors]


def _sum_nearby(values: FloatArray, near: int) -> FloatArray:
    """Sum the rows that are near each row."""
    sums = np.concatenate([np.zeros((1, values.shape[1])), np.cumsum(values, axis=0)])
    rows = np.arange(len(values))
    return np.asarray(
        sums[np.minimum(rows + near + 1, len(values))] - sums[np.maximum(rows - near, 0)]
    )


def _compute_curvature_posterior(
    bands: FloatArray, right: FloatArray, rate: float
) -> tuple[FloatArray, FloatArray]:
    """Compute posterior mean and variance of the curvature of separate tracks.

    The covariance of neighbours comes from the Cholesky factor, last frame first, as in
    `compute_inverse_blocks`.

    Parameters
    ----------
    bands
        Posterior precision of each track, ``(3, frames, parameters)``.
    right
        Precision times mean, ``(frames, parameters)``.
    rate
        Frame rate, hertz.
    """
    frames, count = right.shape
    factors, mean = np.empty_like(bands), np.empty_like(right)
    for p in range(count):
        factors[:, :, p] = cholesky_banded(bands[:, :, p], lower=True, check_finite=False)
        mean[:, p] = cho_solve_banded((factors[:, :, p], True), right[:, p], check_finite=False)
    same_frame, one, two = 1.0 / factors[0] ** 2, factors[1] / factors[0], factors[2] / factors[0]
    one[-1:] = 0.0
    two[-2:] = 0.0
    same, next_one, next_two = np.zeros((3, frames + 2, count))
    for t in range(frames - 1, -1, -1):
        a, b = one[t], two[t]
        next_one[t] = -(a * same[t + 1] + b * next_one[t + 1])
        next_two[t] = -(a * next_one[t + 1] + b * same[t + 2])
        same[t] = same_frame[t] - a * next_one[t] - b * next_two[t]
    same, next_one, next_two = same[:frames], next_one[:frames], next_two[:frames]
    variance = same[:-2] + 4.0 * same[1:-1] + same[2:]
    variance += 2.0 * next_two[:-2] - 4.0 * (next_one[:-2] + next_one[1:-1])
    return compute_curvature(mean, rate), np.maximum(variance, 0.0) * rate**3
