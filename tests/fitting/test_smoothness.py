"""The algebra of smooth tracks against dense matrices, which take the formulas as they stand."""

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

from mocap_fit.fitting.smoothness import (
    _sum_nearby,
    build_roughness_bands,
    compute_curvature,
    estimate_local_smoothing,
    estimate_smoothing,
)


def differences(frames, rate=1.0):
    """The matrix of second differences, whose squares add up to the roughness."""
    return np.diff(np.eye(frames), n=2, axis=0) * rate**1.5


def test_roughness_is_the_integral_of_the_squared_second_derivative():
    """Of a sine of one hertz over its period: half of the fourth power of 2 pi."""
    for rate in (100.0, 400.0):
        track = np.sin(2 * np.pi * np.arange(int(rate) + 2) / rate)
        roughness = np.sum(compute_curvature(track, rate) ** 2)
        assert roughness == pytest.approx(0.5 * (2 * np.pi) ** 4, rel=2e-3)
    assert compute_curvature(track[:2], rate).size == 0


@pytest.mark.parametrize("frames", [1, 2, 3, 4, 9])
def test_bands_are_those_of_the_dense_form(rng, frames):
    strengths = rng.uniform(1, 2, (max(frames - 2, 0), 2))
    bands = build_roughness_bands(frames, 50.0, strengths)
    for p in range(2):
        operator = differences(frames, 50.0)
        dense = operator.T @ np.diag(strengths[:, p]) @ operator
        for step in range(min(3, frames)):
            np.testing.assert_allclose(bands[step, : frames - step, p], np.diag(dense, -step))


def test_rows_nearby_are_summed(rng):
    values = rng.normal(size=(9, 2))
    for near in (0, 1, 4, 20):
        for row, total in enumerate(_sum_nearby(values, near)):
            np.testing.assert_allclose(
                total, values[max(0, row - near) : row + near + 1].sum(axis=0)
            )


def build_restricted_likelihood(track, deviation):
    """A function of the ratio: minus twice the logarithm, with the line left free, and the factor.

    Error contrasts, which no line changes, have the variance of noise and integrated white noise.
    """
    frames, seen = len(track), np.isfinite(track)
    contrasts = np.linalg.svd(np.vander(np.arange(frames), 2)[seen])[0][:, 2:].T
    steps = np.linalg.pinv(differences(frames))
    prior = contrasts @ (steps @ steps.T)[np.ix_(seen, seen)] @ contrasts.T
    noise = contrasts @ np.diag(deviation[seen] ** 2) @ contrasts.T
    prior /= np.median(1 / deviation[seen] ** 2)
    y, freedom = contrasts @ track[seen], seen.sum() - 2

    def evaluate(log_ratio):
        variance = noise + prior / np.exp(log_ratio)
        squares = y @ np.linalg.solve(variance, y)
        factor = max(squares / freedom, 1.0)
        determinant = np.linalg.slogdet(variance)[1]
        return freedom * np.log(factor) + squares / factor + determinant, factor

    return evaluate


@pytest.mark.parametrize("louder", [0.5, 3.0])
def test_smoothing_has_the_greatest_restricted_likelihood(rng, louder):
    rate, frames = 50.0, 90
    deviation = rng.uniform(0.02, 0.04, frames)
    truth = np.cumsum(np.cumsum(0.01 * rng.normal(size=frames)))
    track = truth + louder * deviation * rng.normal(size=frames)
    track[[20, 21, 60]] = np.nan
    evaluate = build_restricted_likelihood(track, deviation)
    best = minimize_scalar(
        lambda log_ratio: evaluate(log_ratio)[0],
        bounds=(4 * np.log(0.1), 4 * np.log(rate)),
        method="bounded",
    ).x
    smoothing, noise = estimate_smoothing([track], [deviation], rate)
    typical = np.median(1 / deviation[np.isfinite(track)] ** 2)
    assert np.log(smoothing * rate**3 / typical) == pytest.approx(best, abs=0.04)
    assert noise == pytest.approx(evaluate(best)[1], rel=0.01)
    assert (noise > 1.0) == (louder > 1.0)
    # Segments count together, and those of two samples say nothing.
    halves, parts = [track[:45], track[45:], track[:2]], [deviation[:45], deviation[45:], [1, 1]]
    joined = estimate_smoothing(halves, [np.asarray(p) for p in parts], rate)
    assert np.log(joined[0] / smoothing) == pytest.approx(0.0, abs=1.0)
    assert estimate_smoothing(halves[2:], [np.ones(2)], rate) == (0.0, 1.0)


def test_local_smoothing_is_the_fixed_point_of_the_dense_formulas(rng):
    """Twelve rounds, a gesture of 0.04 s on either side, half an observation of equal strengths."""
    rate, near, prior = 100.0, 4, 0.5
    lengths = (30, 17, 2)
    smoothing = np.array([1e-5, 1e-9, 1e-3, 1e-1])
    tracks = [np.cumsum(np.cumsum(1e-3 * rng.normal(size=(n, 4)), axis=0), axis=0) for n in lengths]
    tracks[0][12:16] += 0.4
    deviations = [rng.uniform(0.01, 0.02, t.shape) * [1, 1, 1, 100] for t in tracks]
    tracks[0][5:7, 0], deviations[0][5:7, 0] = np.nan, np.inf
    result = estimate_local_smoothing(tracks, deviations, smoothing, rate)
    assert [r.shape for r in result] == [(28, 4), (15, 4), (0, 4)]
    for p in range(4):
        strength, factors = 1 / smoothing[p], [np.ones(n - 2) for n in lengths[:2]]
        for _ in range(12):
            squares = determined = 0.0
            for i, n in enumerate(lengths[:2]):
                operator = differences(n, rate)
                weight = 1 / deviations[i][:, p] ** 2
                variance = strength * factors[i]
                covariance = np.linalg.inv(
                    np.diag(weight) + operator.T @ np.diag(1 / variance) @ operator
                )
                mean = operator @ covariance @ (weight * np.nan_to_num(tracks[i][:, p]))
                share = 1 - np.diag(operator @ covariance @ operator.T) / variance
                share = np.clip(share, 0, 1)
                squares += np.sum(mean**2 / factors[i])
                determined += share.sum()
                around = np.abs(np.subtract.outer(np.arange(n - 2), np.arange(n - 2))) <= near
                factors[i] = (prior + around @ mean**2 / strength) / (prior + around @ share)
            if determined > 1:
                strength *= squares / (strength * determined)
            strength = np.clip(strength, 0.01 / smoothing[p], 100 / smoothing[p])
        for i in range(2):
            np.testing.assert_allclose(result[i][:, p], 1 / (strength * factors[i]), rtol=1e-3)
