"""The scale of a cost: efficiencies that the literature knows, and the noise from residuals."""

import numpy as np
import pytest
from scipy.stats import chi2

from mocap_fit.fitting import over_time
from mocap_fit.fitting.frame_costs import LocalCosts, compute_cost_scale
from mocap_fit.fitting.precision import estimate_noise


@pytest.mark.parametrize("noise", [0.2, 3.0])
def test_the_spatial_median_has_its_known_efficiency(noise):
    """In three dimensions it is 8 / (3 pi) = 0.849 (Brown, J. R. Statist. Soc. B 45, 1983)."""
    scale = compute_cost_scale("distances", 1.0, noise)
    assert scale.variance == pytest.approx(noise**2 * 3 * np.pi / 8, rel=1e-3)
    # E |psi|² / E div psi, with E 1/r = sqrt(2 / pi) / noise.
    assert scale.kappa == pytest.approx(noise * np.sqrt(np.pi / 2) / 2, rel=1e-3)


def test_squares_are_the_gaussian_likelihood():
    assert compute_cost_scale("squares", 1.0, 0.3) == (pytest.approx(0.09), pytest.approx(0.18))


def test_huber_is_between_the_two():
    squares, distances = (compute_cost_scale(o, 1.0, 0.5) for o in ("squares", "distances"))
    wide, narrow = (compute_cost_scale("huber", t, 0.5) for t in (50.0, 1e-4))
    assert wide == pytest.approx(squares, rel=1e-3)
    # Beyond the threshold h, Huber's cost is 2 h times the distance.
    assert narrow.variance == pytest.approx(distances.variance, rel=1e-3)
    assert narrow.kappa == pytest.approx(2e-4 * distances.kappa, rel=1e-3)
    middle = compute_cost_scale("huber", 0.6, 0.5)
    assert squares.variance < middle.variance < distances.variance


def test_hubers_variance_is_that_of_many_estimates(rng):
    """The mean of 3-D points by Huber's cost, by iteratively reweighted least squares."""
    points, threshold = rng.normal(0.0, 1.0, (2000, 40, 3)), 0.8
    centre = points.mean(axis=1)
    for _ in range(60):
        length = np.linalg.norm(points - centre[:, None], axis=2)
        weight = np.minimum(1.0, threshold / length)
        centre = np.einsum("nm,nmi->ni", weight, points) / weight.sum(axis=1)[:, None]
    expected = compute_cost_scale("huber", threshold, 1.0).variance / 40
    assert np.mean(centre**2) == pytest.approx(expected, rel=0.05)


def residuals_of_noise(rng, noise, frames=400, markers=30, parameters=10):
    """Noise less what the parameters of a linear face absorb of it."""
    basis = np.linalg.qr(rng.normal(size=(3 * markers, parameters)))[0]
    flat = rng.normal(0.0, noise, (frames, 3 * markers))
    return (flat - flat @ basis @ basis.T).reshape(frames, markers, 3)


class TestNoiseOverTime:
    class Data:
        """The weights of the markers, which are all that is read."""

        def __init__(self, weights):
            self.weights = weights

    def estimate(self, residuals, weights):
        frames = len(residuals)
        gradients = np.zeros((frames, 10))
        square = np.zeros((frames, 10, 10))
        local = LocalCosts(np.zeros(frames), gradients, square, square, residuals, residuals)
        return over_time._estimate_noise([local], [self.Data(weights)])

    def test_it_is_the_true_noise(self, rng):
        residuals = residuals_of_noise(rng, 0.2)
        weights = np.ones(residuals.shape[:2])
        assert self.estimate(residuals, weights) == pytest.approx(0.2, rel=0.01)

    def test_what_changes_slowly_is_no_noise(self, rng):
        residuals = residuals_of_noise(rng, 0.2)
        times = np.arange(len(residuals))[:, None, None]
        slow = 3.0 * np.sin(times / 60.0) + 2.0
        assert self.estimate(residuals + slow, np.ones(residuals.shape[:2])) == pytest.approx(
            0.2, rel=0.02
        )

    def test_hidden_markers_do_not_count(self, rng):
        residuals = residuals_of_noise(rng, 0.2)
        weights = np.ones(residuals.shape[:2])
        hidden = rng.random(weights.shape) < 0.03
        weights[hidden], residuals[hidden] = 0.0, 0.0
        assert self.estimate(residuals, weights) == pytest.approx(0.2, rel=0.015)

    def test_two_frames_do_not_tell(self):
        assert np.isnan(self.estimate(np.zeros((2, 30, 3)), np.ones((2, 30))))

    def test_the_median_is_that_of_chi_squared(self):
        assert pytest.approx(chi2.median(3), rel=1e-4) == over_time._MEDIAN_CHI_SQUARE


class TestNoiseOfFrames:
    def test_it_is_the_true_noise(self, rng):
        distances = np.linalg.norm(residuals_of_noise(rng, 0.2, frames=4000), axis=2)
        assert estimate_noise(distances, np.ones(30), 10) == pytest.approx(0.2, rel=0.005)

    def test_frames_without_freedom_do_not_count(self, rng):
        distances = np.linalg.norm(residuals_of_noise(rng, 0.2, frames=50), axis=2)
        expected = estimate_noise(distances, np.ones(30), 10)
        distances = np.concatenate([distances, np.full((7, 30), np.nan)])
        distances[50:, :3] = 5.0
        assert estimate_noise(distances, np.ones(30), 10) == pytest.approx(expected, rel=1e-12)
        assert np.isnan(estimate_noise(distances[50:], np.ones(30), 10))

    def test_weights_count_relative_to_their_mean(self):
        distances = np.array([[1.0, 2.0, 2.0, 1.0]])
        # The mean of the weights is 1.5.
        squares = (1.0 * 1 + 3.0 * 4 + 1.0 * 4 + 1.0 * 1) / 1.5
        expected = np.sqrt(squares / (12 - 2))
        assert estimate_noise(distances, np.array([1.0, 3, 1, 1]), 2) == pytest.approx(expected)

    def test_each_frame_may_lose_another_freedom(self):
        distances = np.ones((2, 4))
        expected = np.sqrt(8 / (12 - 1.5 + 12 - 2.5))
        found = estimate_noise(distances, np.ones(4), np.array([1.5, 2.5]))
        assert found == pytest.approx(expected)


def test_long_gaps_and_those_at_an_end_stay_open():
    undetermined = np.zeros((12, 4), dtype=bool)
    undetermined[4:7, 0] = True  # as long as a gap may be
    undetermined[4:8, 1] = True  # one frame longer
    undetermined[10:, 2] = True  # up to the end
    undetermined[:1, 3] = True  # from the beginning
    expected = np.zeros_like(undetermined)
    expected[4:8, 1] = expected[10:, 2] = expected[:1, 3] = True
    np.testing.assert_array_equal(over_time._find_long_gaps(undetermined, 3 + 1e-6), expected)


def test_segments_end_at_long_gaps():
    fitted = np.array([0, 1, 1, 0, 0, 1, 0, 0, 0, 1, 1, 0], dtype=bool)
    assert over_time._split_at_gaps(fitted, 2 + 1e-6) == [slice(1, 6), slice(9, 11)]
    assert over_time._split_at_gaps(fitted, 3 + 1e-6) == [slice(1, 11)]
