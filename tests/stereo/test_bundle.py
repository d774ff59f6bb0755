"""Bundle adjustment: derivatives, known truth, honest standard deviations, outliers."""

import dataclasses
import pickle

import numpy as np
import pytest

from mocap_fit.errors import DataError
from mocap_fit.stereo import Camera, Cameras
from mocap_fit.stereo.bundle import NUMBERS, _Problem, adjust_bundle, list_numbers


@pytest.fixture(scope="module")
def cameras(arrange_cameras) -> Cameras:
    return arrange_cameras(2, 300, 800)


def perturb(cameras: Cameras) -> Cameras:
    """Cameras as a first guess has them: focal length 1 % off, moved, without distortion."""
    return Cameras(
        tuple(
            dataclasses.replace(
                camera,
                matrix=camera.matrix * [[1.01, 1, 1.02], [1, 1.01, 1], [1, 1, 1]],
                translation=camera.translation + 3.0 * (number > 0),
                distortion=np.zeros(5),
            )
            for number, camera in enumerate(cameras)
        )
    )


def standardise(result, cameras, poses):
    """Errors of all numbers in their standard deviations."""
    errors = [
        list_numbers(result.cameras[camera])[number] - list_numbers(cameras[camera])[number]
        for camera, number in (name.split() for name in result.names)
    ]
    deviations = list(result.standard_deviations.values())
    return np.concatenate(
        [
            np.divide(errors, deviations),
            ((result.poses - poses) / result.pose_deviations).ravel(),
        ]
    )


def test_derivatives_are_those_of_differences(cameras, show_board, rng):
    corners, poses = show_board(cameras, rng, 3)
    problem = _Problem(cameras, corners, [NUMBERS, NUMBERS])
    vector = problem.gather(poses)
    assert len(vector) == 2 * 15 + 3 * 6
    jacobian = problem.jacobian(vector).toarray()
    for number in range(len(vector)):
        step = np.zeros(len(vector))
        step[number] = 1e-5 * max(1.0, abs(vector[number]))
        change = problem.residuals(vector + step) - problem.residuals(vector - step)
        numeric = change / (2 * step[number])
        assert jacobian[:, number] == pytest.approx(numeric, rel=1e-4, abs=1e-4)


def test_without_noise_the_truth_is_returned(cameras, show_board, rng):
    corners, poses = show_board(cameras, rng, 6, noise=0.0)
    start = poses + 0.01
    result = adjust_bundle(perturb(cameras), corners, start, reject_outliers=False)
    assert result.error < 1e-8
    for one, other in zip(result.cameras, cameras, strict=True):
        assert one.matrix == pytest.approx(other.matrix, abs=1e-4)
        assert one.distortion == pytest.approx(other.distortion, abs=1e-6)
        assert one.centre == pytest.approx(other.centre, abs=1e-4)
    assert np.array_equal(start, poses + 0.01), "the start is the caller's"


@pytest.mark.slow
def test_standard_deviations_are_honest(cameras, show_board):
    """Errors of the cameras' numbers, together as their covariance has them, and one by one."""
    errors, squares = [], []
    for seed in range(6):
        corners, poses = show_board(cameras, np.random.default_rng(seed), 40)
        result = adjust_bundle(perturb(cameras), corners, poses + 0.01)
        assert result.noise == pytest.approx(0.2, rel=0.03)
        errors.append(standardise(result, cameras, poses))
        count = len(result.names)
        scaled = errors[-1][:count] * list(result.standard_deviations.values())
        squares.append(scaled @ np.linalg.solve(result.covariance, scaled) / count)
    print(f"within: {(np.abs(errors) < 1.96).mean():.3f}, mean square {np.mean(squares):.3f}")
    assert 0.91 < (np.abs(errors) < 1.96).mean() < 0.99
    # Its own standard deviation is 0.14.
    assert 0.6 < np.mean(squares) < 1.4


def test_outliers_are_left_out_and_nothing_else(cameras, show_board, rng):
    corners, poses = show_board(cameras, rng, 12)
    clean = adjust_bundle(perturb(cameras), corners, poses + 0.01)
    assert clean.used.mean() > 0.998
    bad = rng.random(len(corners)) < 0.03
    # One view is another one's: all its corners are elsewhere, in one camera.
    bad[(corners.view == 7) & (corners.camera == 1)] = True
    pixels = corners.pixels + bad[:, None] * rng.choice([-1, 1], (len(corners), 2)) * [4.0, 6.0]
    result = adjust_bundle(
        perturb(cameras), dataclasses.replace(corners, pixels=pixels), poses + 0.01
    )
    assert np.array_equal(result.used, ~bad & clean.used)
    assert result.noise == pytest.approx(clean.noise, rel=0.02)
    errors = standardise(result, cameras, poses)
    assert (np.abs(errors) < 1.96).mean() > 0.85
    assert f"{result.used.sum()} of {len(bad)} corners" in repr(result)
    assert "k1 -0.1" in repr(result)
    assert repr(pickle.loads(pickle.dumps(result))) == repr(result)


def test_what_is_fixed_stays(cameras, show_board, rng):
    corners, poses = show_board(cameras, rng, 6)
    start = Cameras((cameras[0], dataclasses.replace(cameras[1], translation=[0, 0, 950.0])))
    result = adjust_bundle(start, corners, poses, fix_intrinsics=True)
    assert result.cameras[0] == cameras[0]
    assert np.array_equal(result.cameras[1].matrix, cameras[1].matrix)
    assert len(result.names) == 6
    free = adjust_bundle(start, corners, poses, distortion_terms=())
    assert np.array_equal(free.cameras[1].distortion, cameras[1].distortion)
    # What fewer numbers have to explain is known better.
    assert result.standard_deviations["cam_1 tz"] < free.standard_deviations["cam_1 tz"]


def test_views_of_too_few_corners_are_not_used(cameras, show_board, rng):
    corners, poses = show_board(cameras, rng, 6)
    rows = (corners.view != 2) | (np.arange(len(corners)) % 48 < 1)
    poses[4] = np.nan
    result = adjust_bundle(cameras, corners.take(rows), poses)
    assert np.isnan(result.poses[[2, 4]]).all()
    assert np.isnan(result.pose_deviations[[2, 4]]).all()
    assert np.isfinite(result.poses[[0, 1, 3, 5]]).all()
    assert not result.used[np.isin(result.corners.view, [2, 4])].any()


def test_wrong_input_is_refused(cameras, show_board, rng):
    corners, poses = show_board(cameras, rng, 2)
    with pytest.raises(DataError, match=r"no such distortion term.*found k9"):
        adjust_bundle(cameras, corners, poses, distortion_terms=("k9",))
    with pytest.raises(DataError, match="camera cam_1 sees no corner"):
        adjust_bundle(cameras, corners.take(corners.camera == 0), poses)
    with pytest.raises(DataError, match=r"too few corners.*10 corners for 30 numbers"):
        adjust_bundle(cameras, corners.take(np.arange(len(corners)) % 20 < 1), poses)


def test_boards_that_are_all_parallel_to_the_picture_do_not_determine_it(show_board, rng):
    camera = Camera("front", (640, 480), [[800, 0, 320], [0, 800, 240], [0, 0, 1]])
    corners, poses = show_board(
        Cameras((dataclasses.replace(camera, translation=[0, 0, 960]),)), rng, 3
    )
    poses[:] = [[0, 0, 0, x, 0, 960 + 40 * x] for x in (0.0, 1.0, 2.0)]
    pixels = camera.project(corners.points + poses[corners.view, 3:])
    corners = dataclasses.replace(corners, pixels=pixels)
    with pytest.raises(DataError, match=r"do not determine all numbers.*tilted"):
        adjust_bundle(Cameras((camera,)), corners, poses)
