"""Standard deviations of the fit over time, against the posterior with dense matrices."""

import numpy as np
import pytest

from mocap_fit.fitting import Binding, fit_over_time, fit_shape
from mocap_fit.tracks import MarkerTracks

FRAMES, RATE, NOISE = 60, 60.0, 0.1
WEIGHTS = np.geomspace(1e-5, 1e-3, 10)


@pytest.fixture(scope="module")
def recording(binding: Binding, make_tracks) -> MarkerTracks:
    """A face in mid-speech, away from all bounds, without head markers: the pose is exact."""
    times = np.arange(FRAMES)[:, None] / RATE
    phases = np.arange(10)
    values = 0.3 + 0.1 * np.sin(2 * np.pi * (1.0 + phases / 10) * times + phases)
    exact = make_tracks(binding, values, RATE).select(binding.names)
    noise = np.random.default_rng(1).normal(0.0, NOISE, exact.positions.shape)
    return exact.replace(positions=exact.positions + noise)


@pytest.fixture(scope="module")
def alone(binding: Binding, recording):
    return fit_shape(binding, recording, objective="squares")


def dense_deviations(binding: Binding, values: np.ndarray, strengths: np.ndarray) -> np.ndarray:
    """For noise of unit variance: the inverse of ``JᵀJ + strength · roughness``."""
    frames, count = values.shape
    total = np.zeros((frames, count, frames, count))
    for frame, point in enumerate(values):
        _, jacobian = binding.evaluate(point)
        flat = np.sqrt(np.repeat(binding.weights, 3))[:, None] * jacobian.reshape(-1, count)
        total[frame, :, frame] = flat.T @ flat
    second = np.diff(np.eye(frames), n=2, axis=0) * RATE**1.5
    for parameter, strength in enumerate(strengths):
        total[:, parameter, :, parameter] += strength * second.T @ second
    inverse = np.linalg.inv(total.reshape(frames * count, -1))
    return np.sqrt(np.diag(inverse)).reshape(frames, count)


def test_they_are_those_of_the_posterior(binding: Binding, recording, alone) -> None:
    """With squares, ``|r|² + w x''²`` is the posterior's logarithm times twice the variance."""
    smooth = fit_over_time(binding, recording, alone, objective="squares", weight=WEIGHTS)
    expected = dense_deviations(binding, smooth.parameters.values, WEIGHTS)
    ratio = smooth.parameters.standard_deviations / expected
    np.testing.assert_allclose(ratio, np.median(ratio), rtol=1e-3)
    assert np.median(ratio) == pytest.approx(NOISE, rel=0.04)
    # They are smaller than frame by frame, and most at the ends.
    assert (smooth.parameters.standard_deviations < alone.parameters.standard_deviations).all()
    assert (smooth.parameters.standard_deviations[[0, -1]] > np.median(ratio * expected, 0)).all()


def test_of_distances_they_are_larger_by_the_efficiency(binding: Binding, recording) -> None:
    """Without smoothness: the spatial median's variance is 3 pi / 8 of that of squares."""
    weight = np.full(10, 1e-14)
    deviations = {}
    for objective in ("squares", "distances"):
        fit = fit_shape(binding, recording, objective=objective)
        smooth = fit_over_time(binding, recording, fit, objective=objective, weight=weight)
        deviations[objective] = np.median(smooth.parameters.standard_deviations, axis=0)
    ratio = deviations["distances"] / deviations["squares"]
    assert np.median(ratio) == pytest.approx(np.sqrt(3 * np.pi / 8), rel=0.04)


def test_the_degrees_of_freedom_that_smooth_parameters_take_are_fewer(
    binding: Binding, recording, alone
) -> None:
    """The noise from the residuals is the true one for weak and strong smoothing."""
    for weight in (np.full(10, 1e-12), WEIGHTS):
        smooth = fit_over_time(binding, recording, alone, objective="squares", weight=weight)
        assert smooth.noise == pytest.approx(NOISE, rel=0.02)
