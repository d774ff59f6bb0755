"""Standard deviations of the parameters, against Monte Carlo and special cases."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mocap_fit.fitting.precision import compute_covariance
from mocap_fit.tracks.rigid import compute_motion_jacobian


def test_rigid_motion_effect_is_the_derivative(rng: np.random.Generator) -> None:
    points, centre = rng.normal(0, 50, (6, 3)), np.array([1.0, 2.0, 3.0])
    effect = compute_motion_jacobian(points, centre)
    small = rng.normal(0, 1e-6, 6)
    turned = Rotation.from_rotvec(small[:3]).apply(points - centre) + centre + small[3:]
    np.testing.assert_allclose(effect @ small, turned - points, atol=1e-9)


def test_without_pose_it_is_the_inverse_information(rng: np.random.Generator) -> None:
    jacobian = rng.normal(0, 3, (12, 3, 5))
    flat = jacobian.reshape(-1, 5)
    covariance = compute_covariance(jacobian, np.ones(12))
    np.testing.assert_allclose(covariance, np.linalg.inv(flat.T @ flat), rtol=1e-9)


def test_monte_carlo_with_a_noisy_pose(rng: np.random.Generator) -> None:
    """Least squares on a linear face, with the pose estimated from noisy head markers."""
    positions, head = rng.normal(0, 40, (12, 3)), rng.normal(0, 60, (5, 3))
    jacobian, weights = rng.normal(0, 3, (12, 3, 4)), rng.uniform(0.5, 2, 12)
    predicted = compute_covariance(
        jacobian, weights, positions=positions, head_positions=head, head_weights=np.ones(5)
    )
    flat, rows = jacobian.reshape(-1, 4), np.repeat(weights, 3)
    centre = head.mean(axis=0)
    head_effect = compute_motion_jacobian(head, centre).reshape(-1, 6)
    face_effect = compute_motion_jacobian(positions, centre).reshape(-1, 6)
    errors = []
    for _ in range(4000):
        pose = np.linalg.lstsq(head_effect, rng.normal(0, 1, 15), rcond=None)[0]
        noise = rng.normal(0, 1, 36) - face_effect @ pose
        errors.append(np.linalg.solve(flat.T @ (rows[:, None] * flat), flat.T @ (rows * noise)))
    found = np.cov(np.array(errors).T)
    np.testing.assert_allclose(np.sqrt(np.diag(found)), np.sqrt(np.diag(predicted)), rtol=0.06)


def test_more_markers_know_more(rng: np.random.Generator) -> None:
    jacobian = rng.normal(0, 3, (12, 3, 5))
    fewer = np.diag(compute_covariance(jacobian[:8], np.ones(8)))
    assert (fewer >= np.diag(compute_covariance(jacobian, np.ones(12)))).all()


@pytest.mark.parametrize("count", [0, 1])
def test_what_no_marker_shows_is_infinite(rng: np.random.Generator, count: int) -> None:
    jacobian = rng.normal(0, 3, (8, 3, 4))
    jacobian[:, :, 2] = 0.0
    deviation = np.diag(compute_covariance(jacobian[: 8 * count], np.ones(8 * count)))
    assert np.isinf(deviation[2])
    assert np.isfinite(np.delete(deviation, 2)).all() == bool(count)


def test_two_parameters_that_do_the_same_are_both_undetermined(rng: np.random.Generator) -> None:
    jacobian = rng.normal(0, 3, (8, 3, 4))
    jacobian[:, :, 3] = -2.0 * jacobian[:, :, 1]
    deviation = np.diag(compute_covariance(jacobian, np.ones(8)))
    assert np.isinf(deviation[[1, 3]]).all()
    assert np.isfinite(deviation[[0, 2]]).all()
