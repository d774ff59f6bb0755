"""Standard deviations of the parameters, against Monte Carlo and special cases."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mocap_fit.fitting.precision import (
    _find_determined,
    compute_covariance,
    compute_deviations,
    find_undetermined,
)
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


def explicit_covariance(jacobian, weights, positions, head, head_weights):
    """``A (I + P) Aᵀ`` as it is written, with dense matrices."""
    flat = jacobian.reshape(-1, jacobian.shape[-1])
    rows = np.diag(np.repeat(weights, 3))
    gain = np.linalg.inv(flat.T @ rows @ flat) @ flat.T @ rows
    centre = np.array([3.0, -2.0, 1.0])  # it may be any
    of_head = compute_motion_jacobian(head, centre).reshape(-1, 6)
    head_rows = np.diag(np.repeat(head_weights, 3))
    pose = np.linalg.inv(of_head.T @ head_rows @ of_head) @ of_head.T @ head_rows
    of_face = compute_motion_jacobian(positions, centre).reshape(-1, 6) @ pose
    return gain @ (np.eye(len(flat)) + of_face @ of_face.T) @ gain.T


@pytest.fixture
def frames(rng):
    """Some frames with hidden markers and head markers, all weights unlike."""
    count, markers, parameters = 6, 12, 4
    jacobian = rng.normal(0, 3, (count, markers, 3, parameters))
    weights = np.tile(rng.uniform(0.5, 2.0, markers), (count, 1))
    weights[rng.random(weights.shape) < 0.2] = 0.0
    head_weights = np.tile(rng.uniform(0.5, 2.0, 5), (count, 1))
    head_weights[1, 2] = head_weights[2, :2] = head_weights[3, :3] = 0.0
    positions = rng.normal(0, 40, (count, markers, 3))
    return jacobian, weights, positions, rng.normal(0, 60, (5, 3)), head_weights


def test_the_covariance_is_its_formula(frames):
    jacobian, weights, positions, head, _ = frames
    expected = explicit_covariance(jacobian[0], weights[0] + 0.1, positions[0], head, np.ones(5))
    found = compute_covariance(
        jacobian[0], weights[0] + 0.1, positions=positions[0], head_positions=head
    )
    np.testing.assert_allclose(found, expected, rtol=1e-9)


def test_deviations_of_frames_are_those_of_each(frames):
    """Frame 3 shows two head markers, which tell no pose: it counts as exact."""
    jacobian, weights, positions, head, head_weights = frames
    deviations, bare = compute_deviations(
        jacobian, weights, positions=positions, head_positions=head, head_weights=head_weights
    )
    for frame, seen in enumerate(weights > 0):
        alone = compute_covariance(jacobian[frame, seen], weights[frame, seen])
        np.testing.assert_allclose(bare[frame], np.sqrt(np.diag(alone)), rtol=1e-9)
        there = head_weights[frame] > 0
        posed = alone
        if frame != 3:
            posed = explicit_covariance(
                jacobian[frame, seen],
                weights[frame, seen],
                positions[frame, seen],
                head[there],
                head_weights[frame, there],
            )
        np.testing.assert_allclose(deviations[frame], np.sqrt(np.diag(posed)), rtol=1e-9)
    assert (deviations[:3] > bare[:3] * 1.0001).all()


def test_head_markers_on_a_line_leave_the_rest_of_the_pose(frames):
    jacobian, weights, positions, _, _ = frames
    line = np.array([[-60.0, 0, 0], [10, 0, 0], [50, 0, 0]])
    deviations, bare = compute_deviations(
        jacobian, weights, positions=positions, head_positions=line, head_weights=np.ones((6, 3))
    )
    assert np.isfinite(deviations).all()
    assert (deviations > bare).all()


def test_undetermined_parameters_of_frames_are_infinite(frames):
    jacobian, weights, positions, head, head_weights = frames
    jacobian = np.repeat(jacobian[:1], 6, axis=0)
    # Only marker 0 shows parameter 1, and only the hidden ones of frame 2 show anything.
    jacobian[:, 1:, :, 1] = 0.0
    weights[:, 0] = [1, 0, 0, 1, 0, 1]
    weights[2] = 0.0
    expected = np.zeros((6, 4), dtype=bool)
    expected[[1, 4], 1] = expected[2] = True
    np.testing.assert_array_equal(find_undetermined(jacobian[0], weights), expected)
    deviations, bare = compute_deviations(
        jacobian, weights, positions=positions, head_positions=head, head_weights=head_weights
    )
    np.testing.assert_array_equal(np.isinf(deviations), expected)
    np.testing.assert_array_equal(np.isinf(bare), expected)


def test_what_counts_as_determined():
    """Information of a billionth, eigenvalues of a hundred-millionth, shares of a thousandth."""
    for information, determined in ((1.5e-9, True), (0.7e-9, False)):
        assert _find_determined(np.diag([1.0, information])).tolist() == [True, determined]
    for apart, determined in ((1.5e-8, True), (0.7e-8, False)):
        alike = np.array([[1.0, 1 - apart], [1 - apart, 1.0]])
        assert _find_determined(alike).tolist() == [determined, determined]
        # In any unit of the parameters.
        unlike = alike * np.outer([100.0, 1e-3], [100.0, 1e-3])
        assert _find_determined(unlike).tolist() == [determined, determined]
    for share, determined in ((0.7e-6, True), (1.5e-6, False)):
        # The second does what the first does, and a little of the third.
        s = np.sqrt(2 * share / (1 - share))
        first = np.array([1.0, 0.0, 0.0])
        third = np.array([-s / 2, np.sqrt(1 - s**2 / 4), 0.0])
        jacobian = np.stack([first, first + s * third, third], axis=1)
        found = _find_determined(jacobian.T @ jacobian)
        assert found.tolist() == [False, False, determined]
