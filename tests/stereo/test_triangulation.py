"""Triangulated points against the truth, and their errors against the Cramér-Rao bound."""

import numpy as np
import pytest

from mocap_fit.errors import DataError
from mocap_fit.stereo import Cameras, triangulate


def bound(cameras, points, noise):
    """The root mean square error that no unbiased estimate is below, as geom.py computes it."""
    information = 0
    for camera in cameras:
        seen = points @ camera.rotation_matrix.T + camera.translation
        x, y, z = seen.T
        slope = np.zeros((len(points), 2, 3))
        slope[:, 0, 0] = camera.matrix[0, 0] / z
        slope[:, 0, 2] = -camera.matrix[0, 0] * x / z**2
        slope[:, 1, 1] = camera.matrix[1, 1] / z
        slope[:, 1, 2] = -camera.matrix[1, 1] * y / z**2
        slope = slope @ camera.rotation_matrix
        information = information + np.einsum("nij,nik->njk", slope, slope) / noise**2
    return np.sqrt(np.trace(np.linalg.inv(information), axis1=1, axis2=2).mean())


@pytest.fixture
def points(rng):
    return rng.uniform([-80, -110, -60], [80, 110, 60], (100, 40, 3))


@pytest.mark.parametrize(
    ("count", "baseline", "expected"), [(2, 600, 0.30), (2, 300, 0.57), (4, 1400, 0.14)]
)
def test_errors_are_at_the_bound(count, baseline, expected, arrange_cameras, points, rng):
    cameras = arrange_cameras(count, baseline, distortion=np.zeros(5))
    pixels = cameras.project(points)
    result = triangulate(cameras, pixels + rng.normal(0, 0.2, pixels.shape), noise=0.2)
    errors = result.points - points
    rms = np.sqrt((errors**2).sum(axis=-1).mean())
    least = bound(cameras, points.reshape(-1, 3), 0.2)
    assert least == pytest.approx(expected, abs=0.01)
    assert 0.97 < rms / least < 1.03
    # The covariance says so, point by point and in every direction.
    inverse = np.linalg.inv(result.covariance)
    squares = np.einsum("fmi,fmij,fmj->fm", errors, inverse, errors)
    assert squares.mean() / 3 == pytest.approx(1, abs=0.05)
    assert f"expected error {least:.2f}" in repr(result)
    # Two coordinates a camera, less the three that were estimated.
    assert (result.errors**2).mean() * count == pytest.approx(0.04 * (2 * count - 3), rel=0.05)


def test_with_lenses_true_pixels_give_true_points(arrange_cameras, points):
    cameras = arrange_cameras(3)
    result = triangulate(cameras, cameras.project(points))
    assert np.abs(result.points - points).max() < 1e-6
    assert (result.view_counts == 3).all()


def test_the_start_is_close_and_the_end_is_the_minimum(arrange_cameras, points, rng):
    cameras = arrange_cameras(3, 900)
    pixels = cameras.project(points) + rng.normal(0, 1.0, (3, *points.shape[:-1], 2))
    result = triangulate(cameras, pixels)
    least = np.nansum(result.residuals**2, axis=(0, -1))
    for _ in range(5):
        moved = cameras.project(result.points + rng.normal(0, 0.05, points.shape))
        assert (((pixels - moved) ** 2).sum(axis=(0, -1)) > least).all()


def test_each_point_is_from_the_cameras_that_see_it(arrange_cameras, points, rng):
    cameras = arrange_cameras(4, 1400)
    points = points[:5]
    pixels = cameras.project(points) + rng.normal(0, 0.2, (4, *points.shape[:-1], 2))
    hidden = rng.random(pixels.shape[:-1]) < 0.5
    pixels[hidden] = np.nan
    result = triangulate(cameras, pixels)
    enough = (~hidden).sum(axis=0) >= 2
    assert np.array_equal(np.isfinite(result.points).all(axis=-1), enough)
    assert np.array_equal(np.isfinite(result.covariance).all(axis=(-2, -1)), enough)
    assert np.array_equal(result.view_counts, np.where(enough, (~hidden).sum(axis=0), 0))
    first, other = 1, 3
    pair = (~hidden[[first, other]]).all(axis=0) & ((~hidden).sum(axis=0) == 2)
    two = Cameras((cameras[first], cameras[other]))
    alone = triangulate(two, pixels[[first, other]][:, pair])
    assert pair.any()
    assert np.allclose(alone.points, result.points[pair], rtol=0, atol=1e-6)


def test_precise_cameras_count_more(arrange_cameras, points, rng):
    cameras = arrange_cameras(4, 1400)
    deviations = np.array([0.05, 0.05, 1.0, 1.0]).reshape(4, 1, 1)
    pixels = cameras.project(points)
    pixels = pixels + rng.normal(0, 1, pixels.shape) * deviations[..., None]
    fair = triangulate(cameras, pixels, np.broadcast_to(deviations, pixels.shape[:-1]))
    equal = triangulate(cameras, pixels, 0.2)
    errors = [np.linalg.norm(one.points - points, axis=-1).mean() for one in (fair, equal)]
    assert errors[0] < 0.5 * errors[1]


def test_rays_that_do_not_meet_give_nothing(arrange_cameras):
    cameras = arrange_cameras(distortion=np.zeros(5))
    behind = 5000 * np.array([0.0, 0, -1])
    seen = behind @ np.stack([camera.rotation_matrix for camera in cameras]).transpose(0, 2, 1)
    seen = seen + np.stack([camera.translation for camera in cameras])
    pixels = np.stack(
        [(camera.matrix @ one / one[2])[:2] for camera, one in zip(cameras, seen, strict=True)]
    )
    assert np.isnan(triangulate(cameras, pixels[:, None]).points).all()
    # One direction in both: a point at infinity.
    turned = [camera.rotation_matrix @ [0.0, 0, 1] for camera in cameras]
    pixels = np.stack(
        [(camera.matrix @ one / one[2])[:2] for camera, one in zip(cameras, turned, strict=True)]
    )
    assert np.isnan(triangulate(cameras, pixels).points).all()
    nothing = triangulate(cameras, np.full((2, 3, 2), np.nan))
    assert repr(nothing) == "Triangulation: 0 of 3 points"
    assert triangulate(cameras, np.zeros((2, 0, 5, 2))).points.shape == (0, 5, 3)


def test_wrong_input_is_refused(arrange_cameras):
    cameras = arrange_cameras()
    with pytest.raises(DataError, match="one camera sees no depth"):
        triangulate(Cameras((cameras[0],)), np.zeros((1, 2)))
    with pytest.raises(DataError, match=r"pixels have the wrong shape.*found \(3, 5, 2\)"):
        triangulate(cameras, np.zeros((3, 5, 2)))
    with pytest.raises(DataError, match=r"noise has the wrong shape"):
        triangulate(cameras, np.zeros((2, 5, 2)), np.ones(3))
    with pytest.raises(DataError, match="noise of a pixel is not above 0"):
        triangulate(cameras, np.zeros((2, 5, 2)), 0.0)
