import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import polar
from scipy.spatial.transform import Rotation

from mocap_fit.errors import DataError
from mocap_fit.tracks import (
    compute_spread,
    estimate_rigid_transform,
    estimate_rigid_transforms,
    estimate_similarity_transform,
)
from mocap_fit.tracks.rigid import (
    apply_inverse_transforms,
    apply_transforms,
    compute_motion_jacobian,
    describe_degeneracy,
    project_to_rotations,
)

SEEDS = st.integers(0, 2**32 - 1)


@settings(max_examples=60, deadline=None)
@given(SEEDS, st.integers(3, 8), st.booleans())
def test_exact_transforms_are_recovered_also_of_flat_sets(seed, count, flat):
    rng = np.random.default_rng(seed)
    source = rng.normal(size=(count, 3)) * [60, 40, 0 if flat or count == 3 else 20]
    if compute_spread(source)[1] < 5:
        return
    turn, shift = Rotation.random(rng=rng).as_matrix(), rng.normal(size=3) * 300
    rotation, translation = estimate_rigid_transform(source, source @ turn.T + shift)
    np.testing.assert_allclose(rotation, turn, atol=1e-10)
    np.testing.assert_allclose(translation, shift, atol=1e-8)
    scale, rotation, translation = estimate_similarity_transform(
        source, 0.7 * source @ turn.T + shift
    )
    assert scale == pytest.approx(0.7, rel=1e-10)
    np.testing.assert_allclose(rotation, turn, atol=1e-10)
    np.testing.assert_allclose(translation, shift, atol=1e-8)


def test_a_mirrored_set_gives_the_best_rotation_and_no_reflection(rng):
    source = rng.normal(size=(6, 3))
    rotation, _ = estimate_rigid_transform(source, source * [-1, 1, 1])
    assert np.linalg.det(rotation) == pytest.approx(1.0)

    def cost(turn):
        centred = source - source.mean(axis=0)
        return np.sum((centred @ turn.T - centred * [-1, 1, 1]) ** 2)

    others = Rotation.random(2000, rng=rng).as_matrix()
    assert cost(rotation) <= min(cost(turn) for turn in others) + 1e-9


@settings(max_examples=40, deadline=None)
@given(SEEDS)
def test_the_answer_is_least_squares(seed):
    """No small motion from the answer fits better; whole-number weights are repeated points."""
    rng = np.random.default_rng(seed)
    source, target = rng.normal(size=(5, 3)), rng.normal(size=(5, 3))
    weights = rng.integers(1, 4, size=5)
    rotation, translation = estimate_rigid_transform(source, target, weights)

    def cost(turn, shift):
        return np.sum(weights[:, None] * (source @ turn.T + shift - target) ** 2)

    least = cost(rotation, translation)
    for step in np.concatenate([np.eye(6), -np.eye(6)]) * 1e-3:
        turned = Rotation.from_rotvec(step[:3]).as_matrix() @ rotation
        assert cost(turned, translation + step[3:]) >= least
    repeated = np.repeat(np.arange(5), weights)
    again = estimate_rigid_transform(source[repeated], target[repeated])
    np.testing.assert_allclose(again[0], rotation, atol=1e-9)
    np.testing.assert_allclose(again[1], translation, atol=1e-9)


def test_missing_points_are_left_out_frame_by_frame(rng):
    source = rng.normal(size=(5, 3)) * 50
    turns = Rotation.random(6, rng=rng).as_matrix()
    shifts = rng.normal(size=(6, 3))
    target = np.einsum("fij,pj->fpi", turns, source) + shifts[:, None]
    target[1, 0] = np.nan
    target[2, :2] = np.nan
    target[3, :3] = np.nan
    target[4] = np.nan
    rotations, translations, residuals = estimate_rigid_transforms(source, target)
    known = [0, 1, 2, 5]
    np.testing.assert_allclose(rotations[known], turns[known], atol=1e-10)
    np.testing.assert_allclose(translations[known], shifts[known], atol=1e-9)
    assert np.isnan(residuals[[3, 4]]).all()
    assert np.isnan(rotations[[3, 4]]).all()
    assert np.isnan(translations[[3, 4]]).all()
    # A missing point of the source is missing in every frame.
    source[4] = np.nan
    residuals = estimate_rigid_transforms(source, target)[2]
    assert np.isnan(residuals).tolist() == [False, False, True, True, True, False]


def test_frames_whose_visible_points_lie_on_a_line_have_no_pose():
    source = np.array([[0.0, 0, 0], [10, 0, 0], [20, 0, 0], [0, 30, 0]])
    target = np.stack([source, source])
    target[1, 3] = np.nan
    residuals = estimate_rigid_transforms(source, target)[2]
    assert np.isnan(residuals).tolist() == [False, True]


def test_the_residual_is_the_root_mean_square_distance(rng):
    source = rng.normal(size=(6, 3)) * 50
    target = source + rng.normal(size=(6, 3))
    rotations, translations, residuals = estimate_rigid_transforms(source, target[None])
    distances = np.linalg.norm(source @ rotations[0].T + translations[0] - target, axis=1)
    assert residuals[0] == pytest.approx(np.sqrt(np.mean(distances**2)))


@pytest.mark.parametrize(
    ("points", "words"),
    [
        (np.outer(np.arange(5.0), [1, 2, 3]), "on a line"),
        (np.ones((4, 3)), "in one place"),
        (np.eye(3)[:2], "only 2"),
        (np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [np.nan, 0, 0]])[[0, 1, 3]], "only 2"),
    ],
)
def test_sets_that_tell_no_rotation_are_refused_with_the_reason(points, words):
    with pytest.raises(DataError, match=words):
        estimate_rigid_transform(points, points)
    with pytest.raises(DataError, match=words):
        estimate_similarity_transform(points, points)


def test_wrong_shapes_and_weights_are_refused():
    points = np.eye(3)
    with pytest.raises(DataError, match="match"):
        estimate_rigid_transform(points, np.zeros((4, 3)))
    with pytest.raises(DataError, match="shape"):
        estimate_rigid_transform(np.zeros((3, 2)), np.zeros((3, 2)))
    with pytest.raises(DataError, match="negative"):
        estimate_rigid_transform(points, points, [1, 1, -1])
    with pytest.raises(DataError, match="weights"):
        estimate_rigid_transform(points, points, [1, 1])
    with pytest.raises(DataError, match="only 2"):
        estimate_rigid_transform(points, points, [1, 1, 0])


def test_spread_is_the_standard_deviation_along_the_principal_directions(rng):
    points = rng.normal(size=(200_000, 3)) * [30, 10, 2]
    turned = points @ Rotation.random(rng=rng).as_matrix().T + 500
    np.testing.assert_allclose(compute_spread(turned), [30, 10, 2], rtol=0.02)
    np.testing.assert_allclose(compute_spread(np.ones((4, 3))), 0, atol=1e-12)
    assert np.isnan(compute_spread(np.full((2, 3), np.nan))).all()
    # Points with weight 0 do not count.
    np.testing.assert_allclose(
        compute_spread([[0, 0, 0], [2, 0, 0], [9, 9, 9]], [1, 1, 0]), [1, 0, 0]
    )


def test_a_line_is_as_wide_as_a_fiftieth_of_its_length():
    """The limit between a set that determines its turn about itself, and one that does not."""
    points = np.array([[-100.0, -1, 0], [-100, 1, 0], [100, -1, 0], [100, 1, 0]])
    for width, reason in ((2.04, None), (1.96, "lie on a line")):
        reply = describe_degeneracy(points * [1, width, 1])
        assert reply is None if reason is None else reason in reply
    # Points within a millionth of a millimetre are one.
    for length, reason in ((1.5e-6, None), (0.7e-6, "in one place")):
        reply = describe_degeneracy(
            length * np.array([[-1, -1, 0], [-1, 1, 0], [np.sqrt(2), 0, 0]])
        )
        assert reply is None if reason is None else reason in reply
    assert "only 2 of the three" in describe_degeneracy(points[:3], [1, 1, 0])


def test_points_are_moved_there_and_back(rng):
    turns, shifts = Rotation.random(4, rng=rng), rng.normal(size=(4, 3))
    points = rng.normal(size=(4, 5, 3))
    moved = apply_transforms(points, turns.as_matrix(), shifts)
    for k in range(4):
        np.testing.assert_allclose(moved[k], turns[k].apply(points[k]) + shifts[k], atol=1e-12)
    back = apply_inverse_transforms(moved, turns.as_matrix(), shifts)
    np.testing.assert_allclose(back, points, atol=1e-12)


def test_the_motion_jacobian_is_the_derivative(rng):
    points, centre = rng.normal(size=(4, 3)) * 50, rng.normal(size=3)
    jacobian = compute_motion_jacobian(points, centre)
    for k, step in enumerate(1e-6 * np.eye(6)):
        moved = Rotation.from_rotvec(step[:3]).apply(points - centre) + centre + step[3:]
        np.testing.assert_allclose(jacobian[:, :, k], (moved - points) / 1e-6, atol=1e-3)


def test_the_nearest_rotation_is_that_of_the_polar_decomposition(rng):
    matrices = Rotation.random(5, rng=rng).as_matrix() + 0.1 * rng.normal(size=(5, 3, 3))
    matrices[3] = np.nan
    result = project_to_rotations(matrices)
    assert np.isnan(result[3]).all()
    for k in (0, 1, 2, 4):
        np.testing.assert_allclose(result[k], polar(matrices[k])[0], atol=1e-12)
    mirror = project_to_rotations(np.diag([1.0, 0.9, -0.5]))
    np.testing.assert_allclose(mirror, np.eye(3), atol=1e-12)


def test_the_scale_of_weights_does_not_matter(rng):
    source = rng.normal(size=(6, 3)) * 50
    target = source + rng.normal(size=(2, 6, 3))
    weights = rng.uniform(0.2, 1, size=6)
    expected = estimate_rigid_transforms(source, target, weights)
    for scale in (1e-3, 0.1, 30.0):
        for one, other in zip(
            estimate_rigid_transforms(source, target, scale * weights), expected, strict=True
        ):
            np.testing.assert_allclose(one, other, atol=1e-9)
        np.testing.assert_allclose(
            compute_spread(source, scale * weights), compute_spread(source, weights)
        )


def test_a_target_on_a_line_is_refused_with_its_extent():
    """Four points at 0 to 30 mm have a root mean square of 11.18 mm from their middle."""
    line = np.outer(np.arange(4.0), [10.0, 0, 0])
    square = np.array([[0.0, 0, 0], [10, 0, 0], [10, 10, 0], [0, 10, 0]])
    with pytest.raises(DataError, match=r"on a line: 11\.18 mm long, only 0 mm wide"):
        estimate_rigid_transform(square, line)
    with pytest.raises(DataError, match=r"on a line: 11\.18 mm long, only 0\.08944 mm wide"):
        estimate_rigid_transform(line + [[0, 0.1, 0], [0, -0.1, 0]] * 2, square)


def test_weights_are_one_a_point_or_one_a_frame_and_point(rng):
    source = rng.normal(size=(5, 3)) * 50
    target = source + rng.normal(size=(4, 5, 3))
    weights = rng.uniform(0.5, 1, size=5)
    for one, other in zip(
        estimate_rigid_transforms(source, target, weights),
        estimate_rigid_transforms(source, target, np.tile(weights, (4, 1))),
        strict=True,
    ):
        np.testing.assert_array_equal(one, other)
    for wrong in (1.0, weights[:4], np.ones((5, 4)), np.ones((1, 5))):
        with pytest.raises(DataError, match="weights have the wrong shape"):
            estimate_rigid_transforms(source, target, wrong)
    with pytest.raises(DataError, match="weights have the wrong shape"):
        estimate_rigid_transform(source, source, 1.0)
    for infinite in (np.nan, np.inf):
        with pytest.raises(DataError, match="negative or not finite"):
            estimate_rigid_transform(source, source, [1, 1, 1, 1, infinite])
