"""A shape on another one: mirror images, flat sets, units and axes in words."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from corpus_tools.validation import load_thresholds
from mocap_fit.head.alignment import (
    MIRROR_GAIN,
    align_shapes,
    compute_angle,
    describe_axes,
    describe_directions,
    find_reflection,
    guess_unit,
    is_flat,
)


def test_validate_has_the_same_rule():
    assert load_thresholds().shape.mirror_gain == MIRROR_GAIN


@settings(deadline=None, max_examples=40)
@given(
    turn=st.tuples(*[st.floats(-3, 3)] * 3),
    scale=st.floats(0.01, 100.0),
    mirrored=st.booleans(),
    seed=st.integers(0, 1000),
)
def test_a_shape_is_laid_on_its_copy(turn, scale, mirrored, seed):
    rng = np.random.default_rng(seed)
    source = rng.normal(0.0, 40.0, (12, 3))
    matrix = Rotation.from_rotvec(turn).as_matrix()
    matrix = matrix @ np.diag([-1.0, 1.0, 1.0]) if mirrored else matrix
    target = scale * source @ matrix.T + 500.0
    target[3] += 30.0 * scale
    fit = align_shapes(source, target, 0.6)
    assert fit.mirrored == mirrored
    assert fit.scale == pytest.approx(scale, rel=0.02)
    assert np.allclose(fit.matrix, matrix, atol=0.06)
    assert int(np.argmax(fit.distances)) == 3


def test_points_on_a_line_tell_nothing():
    line = np.arange(12.0)[:, None] * [1.0, 2.0, 3.0]
    assert align_shapes(line, line, 0.6) is None


@pytest.mark.parametrize(
    ("matrix", "kind", "words"),
    [
        (np.eye(3), "same", "the axes are the same"),
        (np.diag([-1.0, 1.0, 1.0]), "reversed", "x is reversed"),
        (np.diag([-1.0, 1.0, -1.0]), "reversed", "x and z are reversed"),
        (np.eye(3)[[0, 2, 1]], "exchanged", "y and z are exchanged"),
        (np.eye(3)[[1, 2, 0]], "turned", "x is y, y is z, z is x of the others"),
    ],
)
def test_axes_in_words(matrix, kind, words):
    leaning = Rotation.from_euler("xyz", [10, -12, 8], degrees=True).as_matrix()
    assert describe_axes(leaning @ matrix) == (kind, words)


@settings(deadline=None, max_examples=30)
@given(turn=st.tuples(*[st.floats(-0.5, 0.5)] * 3), index=st.integers(0, 23))
def test_the_nearest_mirrored_axes(turn, index):
    order = [(0, 1, 2), (1, 2, 0), (2, 0, 1), (1, 0, 2), (0, 2, 1), (2, 1, 0)][index // 4]
    signs = [[-1, 1, 1], [1, -1, 1], [1, 1, -1], [-1, -1, -1]][index % 4]
    axes = np.diag(signs)[list(order)]
    axes = axes if np.linalg.det(axes) < 0 else -axes
    np.testing.assert_array_equal(
        find_reflection(Rotation.from_rotvec(turn).as_matrix() @ axes), axes
    )


@pytest.mark.parametrize(("depth", "flat"), [(0.0, True), (0.09, True), (0.11, False)])
def test_flat_sets(rng, depth, flat):
    plane = np.array([[-2, -1, 1], [2, -1, -1], [-2, 1, -1], [2, 1, 1], [np.nan] * 3])
    turned = (plane * [1, 1, depth]) @ Rotation.random(random_state=1).as_matrix()
    assert is_flat(turned) == flat
    assert is_flat(turned[1:])


def test_units_angles_and_directions_in_words():
    assert "in metres" in guess_unit(0.00095)
    assert "in inches" in guess_unit(1 / 25.0)
    assert guess_unit(1100.0) == "it seems to be in millimetres, read as metres"
    assert guess_unit(1.4) == ""
    assert compute_angle(Rotation.from_rotvec([0, 1, 0]).as_matrix()) == pytest.approx(
        np.degrees(1)
    )
    assert describe_directions(np.eye(3)[[0, 2, 1]] * [1, 1, -1]) == (
        "left is +x, up is +z, forward is -y"
    )
