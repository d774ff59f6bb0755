"""Values between frames, against scipy and by hand."""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from mocap_fit.tracks.interpolation import find_runs, flatten_tracks, interpolate

LINE = np.array([3.0, 5.0, 9.0, 1.0])


def test_runs_are_the_stretches_of_true_values():
    assert find_runs(np.array([True, False, True, True, False, False, True])) == [
        slice(0, 1),
        slice(2, 4),
        slice(6, 7),
    ]
    assert find_runs(np.zeros(3, dtype=bool)) == find_runs(np.zeros(0, dtype=bool)) == []
    assert find_runs(np.ones(3, dtype=bool)) == [slice(0, 3)]


def test_coordinates_are_on_one_axis_after_those_of_frames_and_tracks():
    values = np.arange(36.0).reshape(2, 2, 3, 3)
    np.testing.assert_array_equal(flatten_tracks(values), values.reshape(2, 2, 9))
    assert flatten_tracks(values[..., 0, 0]).shape == (2, 2, 1)


@pytest.mark.parametrize("axes", [(), (1,), (2,), (2, 3)])
def test_straight_lines_reach_half_a_frame_beyond_the_ends(axes):
    frames = np.array([-0.51, -0.5, 0.0, 0.25, 2.5, 3.0, 3.5, 3.51])
    values = LINE.reshape(-1, *(1 for _ in axes)) * np.ones(axes)
    result = interpolate(values, frames, "linear")
    expected = np.array([np.nan, 3, 3, 3.5, 5, 1, 1, np.nan])
    np.testing.assert_allclose(result, expected.reshape(-1, *(1 for _ in axes)) * np.ones(axes))
    # One frame between others, and one frame in all.
    np.testing.assert_allclose(interpolate(values, np.array([1.5]), "linear")[0], 7.0)
    np.testing.assert_allclose(interpolate(values[:1], np.array([0.4]), "linear")[0], 3.0)


def test_a_neighbour_without_a_share_does_not_count():
    values = np.array([1.0, np.inf, np.nan, 4.0])
    result = interpolate(values, np.array([0.0, 0.5, 1.0, 1.5, 2.0, 3.0]), "linear")
    np.testing.assert_array_equal(result, [1, np.inf, np.inf, np.nan, np.nan, 4])


@pytest.mark.parametrize("method", ["linear", "spline"])
def test_a_millionth_of_a_frame_is_no_way_into_a_gap(method):
    values = LINE[:, None].copy()
    values[2] = np.nan
    near = np.array([1 - 0.9e-6, 1 + 0.9e-6, 1 + 1.2e-6, 3 - 0.9e-6, 3 - 1.2e-6])
    result = interpolate(values, near, method)[:, 0]
    np.testing.assert_array_equal(result, [5, 5, np.nan, 1, np.nan])


def test_the_higher_of_two_neighbours_and_zero_outside():
    codes = np.array([[1], [3], [2]], dtype=np.uint8)
    result = interpolate(codes, np.array([-0.6, -0.4, 0.5, 1.0, 1.5, 2.0, 2.6]), "highest")
    assert result.dtype == np.uint8
    assert result[:, 0].tolist() == [0, 1, 3, 3, 3, 2, 0]


@pytest.mark.parametrize("length", [1, 2, 3, 4, 5])
def test_short_stretches_have_splines_of_the_degree_that_they_allow(length):
    """Polynomials through up to four samples are exact; one sample is itself, and no more."""
    powers = np.arange(min(length, 4))
    values = np.full((9, 2, 1), np.nan)
    frames = np.arange(2, 2 + length)
    values[frames, 0, 0] = (0.5 * frames[:, None] ** powers).sum(axis=1)
    values[:, 1, 0] = np.sin(np.arange(9))
    places = np.sort(np.append(np.linspace(0, 8, 33), frames))
    result = interpolate(values, places, "spline")
    inside = (places >= 2) & (places <= 1 + length)
    np.testing.assert_array_equal(~np.isnan(result[:, 0, 0]), inside)
    expected = (0.5 * places[inside, None] ** powers).sum(axis=1)
    np.testing.assert_allclose(result[inside, 0, 0], expected, rtol=1e-9)
    # The other track has no gap and a spline of its own.
    spline = CubicSpline(np.arange(9), values[:, 1, 0])
    np.testing.assert_allclose(result[:, 1, 0], spline(places), atol=1e-9)


@pytest.mark.parametrize("length", [1, 2, 3])
def test_rotations_of_short_stretches(length):
    """A pose between two gaps holds at its frame alone; two and more turn evenly."""
    turns = Rotation.from_rotvec(10.0 * np.outer(np.arange(7), [0, 0, 1]), degrees=True)
    rotations = np.stack([turns.as_matrix(), turns.inv().as_matrix()], axis=1)
    rotations[:2, 0], rotations[2 + length :, 0] = np.nan, np.nan
    places = np.linspace(0, 6, 13)
    result = interpolate(rotations, places, "slerp")
    inside = (places >= 2) & (places <= 1 + length)
    np.testing.assert_array_equal(~np.isnan(result[:, 0, 0, 0]), inside)
    angles = Rotation.from_matrix(result[inside, 0]).as_rotvec(degrees=True)[:, 2]
    np.testing.assert_allclose(angles, 10.0 * places[inside], atol=1e-9)
    angles = Rotation.from_matrix(result[:, 1]).as_rotvec(degrees=True)[:, 2]
    np.testing.assert_allclose(angles, -10.0 * places, atol=1e-9)


def test_a_single_value_of_a_parameter_holds_everywhere():
    values = np.full((5, 3), np.nan)
    values[3, 0] = 0.7
    values[[1, 3], 1] = 0.2, 0.4
    result = interpolate(values, np.array([-9.0, 0.0, 2.0, 9.0]), "pchip")
    np.testing.assert_allclose(result[:, 0], 0.7)
    np.testing.assert_allclose(result[:, 1], [0.2, 0.2, 0.3, 0.4])
    assert np.isnan(result[:, 2]).all()
