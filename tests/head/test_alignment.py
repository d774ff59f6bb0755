"""Shapes on each other at the limits of the rules, and robust fits by scipy's rotations."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mocap_fit.head.alignment import (
    align_shapes,
    compute_angle,
    describe_axes,
    describe_directions,
    guess_unit,
    is_flat,
)

MIRROR = np.diag([-1.0, 1.0, 1.0])


def fit_with_cauchy_weights(source, target):
    """Eight rounds of least squares with weights 1 / (1 + (d / 1.5 median)²)."""
    weights = np.ones(len(source))
    for _ in range(8):
        one = source - np.average(source, axis=0, weights=weights)
        other = target - np.average(target, axis=0, weights=weights)
        turn = Rotation.align_vectors(other, one, weights=weights)[0]
        turned = turn.apply(one)
        scale = np.sum(weights @ (other * turned)) / np.sum(weights @ turned**2)
        distances = np.linalg.norm(other - scale * turned, axis=1)
        weights = 1 / (1 + (distances / (1.5 * np.median(distances))) ** 2)
    return turn.as_matrix(), scale, np.sqrt(np.average(distances**2, weights=weights)), distances


@pytest.mark.parametrize("seed", range(4))
def test_a_few_points_that_are_elsewhere_are_not_followed(seed):
    rng = np.random.default_rng(seed)
    source = rng.normal(size=(9, 3)) * [60, 40, 20]
    turn = Rotation.random(rng=rng)
    target = 1.3 * turn.apply(source) + rng.normal(size=(9, 3)) + 200
    target[[2, 5]] += 30 * rng.normal(size=(2, 3))
    source[7] = np.nan
    fit = align_shapes(source, target)
    both = np.arange(9) != 7
    matrix, scale, _, distances = fit_with_cauchy_weights(source[both], target[both])
    assert not fit.mirrored
    np.testing.assert_allclose(fit.matrix, matrix, atol=1e-7)
    assert fit.scale == pytest.approx(scale, rel=1e-7)
    np.testing.assert_allclose(fit.distances[both], distances, atol=1e-5)
    assert np.isnan(fit.distances[7])
    # What is laid on the mirror image is a rotation of the mirror image.
    mirrored = align_shapes(source @ MIRROR, target)
    assert mirrored.mirrored
    np.testing.assert_allclose(mirrored.matrix, matrix @ MIRROR, atol=1e-7)


def test_the_mirror_image_must_fit_better_by_the_gain(rng):
    source = rng.normal(size=(8, 3)) * [60, 40, 10]
    target = source @ MIRROR + 6 * rng.normal(size=(8, 3))
    plain = fit_with_cauchy_weights(source, target)[2]
    other = fit_with_cauchy_weights(source @ MIRROR, target)[2]
    assert other < plain
    for gain in (other / plain - 1e-6, other / plain + 1e-6):
        assert align_shapes(source, target, gain).mirrored == (gain > other / plain)
    # Six tenths where nothing else is said.
    noisy = [
        (other / plain, align_shapes(source, moved).mirrored)
        for scale in np.linspace(0, 2.5, 26)
        for moved in [source @ MIRROR + scale * (target - source @ MIRROR)]
        for plain in [fit_with_cauchy_weights(source, moved)[2]]
        for other in [fit_with_cauchy_weights(source @ MIRROR, moved)[2]]
    ]
    assert [ratio < 0.6 for ratio, _ in noisy] == [mirrored for _, mirrored in noisy]
    assert {mirrored for _, mirrored in noisy} == {True, False}


def test_four_points_that_are_not_on_a_line_are_needed(rng):
    points = rng.normal(size=(4, 3)) * 50
    assert align_shapes(points, points).scale == pytest.approx(1.0)
    assert align_shapes(points[:3], points[:3]) is None
    three = points.copy()
    three[2, 1] = np.nan
    assert align_shapes(three, points) is None
    assert align_shapes(points, three) is None
    strip = np.array([[-100.0, -1, 0], [-100, 1, 0], [100, -1, 0], [100, 1, 0]])
    for width, fits in ((2.04, True), (1.96, False)):
        narrow = strip * [1, width, 1]
        assert (align_shapes(narrow, points) is not None) == fits
        assert (align_shapes(points, narrow) is not None) == fits
    assert align_shapes(np.ones((4, 3)), points) is None


def test_fewer_than_four_points_are_flat():
    solid = np.array([[0.0, 0, 0], [9, 0, 0], [0, 9, 0], [0, 0, 9]])
    assert not is_flat(solid)
    assert is_flat(solid[:3])
    assert is_flat(np.full((5, 3), np.nan))
    assert is_flat(np.ones((5, 3)))


@pytest.mark.parametrize(
    ("matrix", "kind", "words"),
    [
        ([[1, 0, 0], [0, -1, 0], [0, 0, 1]], "reversed", "y is reversed"),
        ([[-1, 0, 0], [0, -1, 0], [0, 0, -1]], "reversed", "x and y and z are reversed"),
        ([[0, 1, 0], [1, 0, 0], [0, 0, 1]], "exchanged", "x and y are exchanged"),
        ([[0, -1, 0], [1, 0, 0], [0, 0, 1]], "turned", "x is -y, y is x of the others"),
        ([[0, -1, 0], [-1, 0, 0], [0, 0, 1]], "turned", "x is -y, y is -x of the others"),
        ([[0, 1, 0], [1, 0, 0], [0, 0, -1]], "turned", "x is y, y is x, z is -z of the others"),
    ],
)
def test_axes_that_are_reversed_exchanged_or_turned(matrix, kind, words):
    assert describe_axes(np.array(matrix, dtype=float)) == (kind, words)


def test_directions_are_those_of_the_longest_components():
    turn = Rotation.from_euler("xyz", [20, -25, 30], degrees=True).as_matrix()
    assert describe_directions(turn) == "left is +x, up is +y, forward is +z"
    assert describe_directions(turn @ np.diag([-1, 1, -1])) == (
        "left is -x, up is +y, forward is -z"
    )


@pytest.mark.parametrize(
    ("ratio", "words"),
    [
        (0.76e-3, "it seems to be in metres, read as millimetres"),
        (1.34e-3, "it seems to be in metres, read as millimetres"),
        (1.36e-3, ""),
        (0.74e-3, ""),
        (0.76e-2, "it seems to be in decimetres, read as millimetres"),
        (1.34e-2, "it seems to be in decimetres, read as millimetres"),
        (0.076, "it seems to be in centimetres, read as millimetres"),
        (0.134, "it seems to be in centimetres, read as millimetres"),
        (0.76 / 25.4, "it seems to be in inches, read as millimetres"),
        (1.34 / 25.4, "it seems to be in inches, read as millimetres"),
        (0.74 / 25.4, ""),
        (7.6, "it seems to be in millimetres, read as centimetres"),
        (30.0, "it seems to be in millimetres, read as inches"),
        (76.0, "it seems to be in millimetres, read as decimetres"),
        (134.0, "it seems to be in millimetres, read as decimetres"),
        (136.0, ""),
        (1340.0, "it seems to be in millimetres, read as metres"),
        (1.0, ""),
    ],
)
def test_units_that_explain_a_size(ratio, words):
    assert guess_unit(ratio) == words


def test_angles_are_between_0_and_180_degrees():
    for degrees in (0.0, 1.0, 90.0, 135.0, 180.0):
        matrix = Rotation.from_rotvec([0, 0, degrees], degrees=True).as_matrix()
        assert compute_angle(matrix) == pytest.approx(degrees, abs=1e-5)
    # Rounding takes the cosine beyond 1 and -1.
    assert compute_angle(np.eye(3) * (1 + 1e-15)) == 0.0
    assert compute_angle(np.diag([1.0, -1.0, -1.0]) * (1 + 1e-15)) == 180.0
