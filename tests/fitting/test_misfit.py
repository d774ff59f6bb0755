"""What a face of another shape leaves in the residuals, and what it does to the intervals."""

import dataclasses

import numpy as np
import pytest

from mocap_fit.fitting import Binding, fit_over_time, fit_shape
from mocap_fit.fitting.precision import MISFIT_FACTOR, compute_pose_noise, estimate_misfit
from mocap_fit.tracks.rigid import compute_motion_jacobian

FRAMES, RATE, NOISE = 90, 60.0, 0.1


def products_of(residuals: np.ndarray) -> np.ndarray:
    products = np.full(residuals.shape[:2], np.nan)
    products[:-1] = np.einsum("tmi,tmi->tm", residuals[:-1], residuals[1:])
    return products


def test_what_stays_is_misfit_and_what_changes_is_noise(rng):
    slow = 0.3 * rng.normal(size=(1, 400, 3))
    residuals = slow + rng.normal(0.0, 0.5, (300, 400, 3))
    weights = np.ones(400)
    assert estimate_misfit(products_of(residuals), weights, 0) == pytest.approx(0.3, rel=0.05)
    assert estimate_misfit(products_of(residuals - slow), weights, 0) < 0.03
    hidden = rng.random(residuals.shape[:2]) < 0.2
    residuals[hidden] = np.nan
    assert estimate_misfit(products_of(residuals), weights, 0) == pytest.approx(0.3, rel=0.05)


def test_what_the_parameters_took_is_added(rng):
    products = np.full((10, 8), 3.0 * 0.04)
    assert estimate_misfit(products, np.full(8, 2.0), 0) == pytest.approx(0.2)
    assert estimate_misfit(products, np.ones(8), 12) == pytest.approx(0.2 * np.sqrt(2))


def test_of_nothing_it_is_nothing():
    assert estimate_misfit(np.full((1, 30), np.nan), np.ones(30), 10) == 0.0
    assert estimate_misfit(np.full((5, 30), -1.0), np.ones(30), 10) == 0.0


def test_the_excess_of_the_pose_is_that_of_many_draws(rng):
    positions, head = rng.normal(0, 40, (12, 3)), rng.normal(0, 60, (5, 3))
    jacobian, weights = rng.normal(0, 3, (12, 3, 4)), rng.uniform(0.5, 2, 12)
    flat, rows = jacobian.reshape(-1, 4), np.repeat(weights, 3)
    centre = head.mean(axis=0)
    of_head = compute_motion_jacobian(head, centre).reshape(-1, 6)
    of_face = compute_motion_jacobian(positions, centre).reshape(-1, 6)
    poses = rng.normal(size=(20000, 15)) @ np.linalg.pinv(of_head).T
    moved = poses @ of_face.T
    fitted = np.linalg.solve(flat.T @ (rows[:, None] * flat), flat.T * rows)
    left = moved - moved @ fitted.T @ flat.T
    expected = np.mean(left**2 @ rows) / ((36 - 4) * weights.mean())
    excess, covariance = compute_pose_noise(jacobian, weights, positions, head, np.ones(5))
    assert excess == pytest.approx(expected, rel=0.05)
    scale = np.abs(covariance).max()
    np.testing.assert_allclose(covariance, np.cov(flat.T @ (rows * moved).T), atol=0.05 * scale)
    excess, covariance = compute_pose_noise(jacobian, weights, positions, head[:2], np.ones(2))
    assert excess == 0.0
    assert not covariance.any()


@pytest.fixture(scope="module")
def misfit(binding: Binding, make_tracks):
    """A face in speech whose markers sit 0.4 mm from where the face has them."""
    rng = np.random.default_rng(3)
    times, phases = np.arange(FRAMES)[:, None] / RATE, np.arange(10)
    values = 0.3 + 0.1 * np.sin(2 * np.pi * (1.0 + phases / 10) * times + phases)
    exact = make_tracks(binding, values, RATE).select(binding.names)
    noise = rng.normal(0.0, NOISE, exact.positions.shape)
    apart = 0.4 * rng.normal(size=exact.positions.shape[1:])
    recording = exact.replace(positions=exact.positions + noise + apart)
    return recording, fit_shape(binding, recording, objective="squares")


def test_a_fit_knows_noise_and_misfit(misfit):
    _, alone = misfit
    # The parameters take a part of an offset that stays, another of each draw.
    assert alone.misfit == pytest.approx(0.4, rel=0.15)
    total = np.sqrt(np.nanmean(alone.marker_residuals**2) * 30 / (90 - 10))
    expected = np.sqrt(total**2 + (MISFIT_FACTOR**2 - 1) * alone.misfit**2)
    assert alone.noise == pytest.approx(expected, rel=1e-3)


@pytest.mark.parametrize("weight", [None, 1e-4])
def test_smoothness_does_not_take_the_misfit_away(binding: Binding, misfit, weight):
    recording, alone = misfit
    settings = {"objective": "squares", "weight": weight}
    smooth = fit_over_time(binding, recording, alone, **settings).parameters
    without = dataclasses.replace(alone, misfit=0.0)
    bare = fit_over_time(binding, recording, without, **settings).parameters
    np.testing.assert_array_equal(smooth.values, bare.values)
    added = np.sqrt(smooth.standard_deviations**2 - bare.standard_deviations**2)
    of_misfit = MISFIT_FACTOR * alone.misfit / alone.noise
    np.testing.assert_allclose(added, of_misfit * alone.parameters.standard_deviations, rtol=1e-6)


def test_a_gap_has_the_misfit_of_its_ends(binding: Binding, misfit):
    recording, _ = misfit
    positions = recording.positions.copy()
    positions[40:46] = np.nan
    gappy = recording.replace(positions=positions, origin=None)
    alone = fit_shape(binding, gappy, objective="squares")
    smooth = fit_over_time(binding, gappy, alone, objective="squares").parameters
    least = MISFIT_FACTOR * alone.misfit / alone.noise * alone.parameters.standard_deviations[39]
    assert (smooth.standard_deviations[40:46] > 0.98 * least).all()
    assert np.isfinite(smooth.standard_deviations).all()


def test_a_single_frame_has_no_misfit(binding: Binding, misfit):
    recording, _ = misfit
    alone = fit_shape(binding, recording.between(0.0, 0.01), objective="squares")
    assert alone.misfit == 0.0
    assert alone.noise > 0.2
