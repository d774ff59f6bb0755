import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from mocap_fit.errors import DataError
from mocap_fit.tracks import (
    MarkerTracks,
    Origin,
    ParameterTracks,
    PoseTracks,
    resample,
    smooth,
)


def parameter(values, rate=100.0, **more) -> ParameterTracks:
    return ParameterTracks(("p",), rate, np.asarray(values, float)[:, None], **more)


def sine(frequency, frames=1000, rate=100.0, phase=0.3):
    return np.sin(2 * np.pi * frequency * np.arange(frames) / rate + phase)


@pytest.mark.parametrize("order", [1, 2, 4, 8])
@pytest.mark.parametrize("cutoff", [2.0, 10.0, 40.0])
def test_three_decibels_are_gone_at_the_cutoff_and_nothing_is_delayed(order, cutoff):
    wave = sine(cutoff, frames=4000)
    result = smooth(parameter(wave), cutoff, order).values[:, 0]
    middle = slice(1000, 3000)
    # Least squares on the wave and on the wave a quarter later: gain and delay.
    quarter = sine(cutoff, frames=4000, phase=0.3 + np.pi / 2)
    gain, late = np.linalg.lstsq(
        np.column_stack([wave, quarter])[middle], result[middle], rcond=None
    )[0]
    assert gain == pytest.approx(np.sqrt(0.5), abs=2e-3)
    assert late == pytest.approx(0.0, abs=2e-3)


def test_the_response_to_an_impulse_is_symmetric():
    impulse = np.zeros(401)
    impulse[200] = 1.0
    response = smooth(parameter(impulse), 6.0).values[:, 0]
    np.testing.assert_allclose(response, response[::-1], atol=1e-12)
    assert response.argmax() == 200
    assert response.sum() == pytest.approx(1.0, abs=1e-6)


@settings(max_examples=40, deadline=None)
@given(
    st.integers(1, 60), st.floats(-1e3, 1e3), st.floats(-5, 5), st.floats(1, 45), st.integers(1, 8)
)
def test_constants_and_straight_lines_stay_as_they_are(frames, level, slope, cutoff, order):
    line = level + slope * np.arange(frames)
    result = smooth(parameter(line), cutoff, order).values[:, 0]
    np.testing.assert_allclose(result, line, atol=1e-3)


def test_slow_movements_pass_and_fast_noise_does_not(rng):
    slow = sine(1.0)
    noise = rng.normal(size=1000)
    np.testing.assert_allclose(
        smooth(parameter(slow), 10).values[20:-20, 0], slow[20:-20], atol=1e-3
    )
    assert smooth(parameter(noise), 5).values.std() < 0.4 * noise.std()
    assert np.abs(smooth(parameter(sine(30.0)), 10).values[50:-50]).max() < 0.01


def test_stretches_between_gaps_are_filtered_apart(rng):
    positions = rng.normal(size=(200, 2, 3))
    positions[80:90, 0] = np.nan
    positions[150, 0] = np.nan
    positions[152, 0] = np.nan
    tracks = MarkerTracks(("a", "b"), 100, positions)
    result = smooth(tracks, 8.0)
    np.testing.assert_array_equal(result.visible, tracks.visible)
    np.testing.assert_array_equal(result.origin, tracks.origin)
    for part in (slice(0, 80), slice(90, 150)):
        alone = smooth(MarkerTracks(("a",), 100, positions[part, :1]), 8.0)
        np.testing.assert_allclose(result.positions[part, :1], alone.positions, atol=1e-9)
    # A sample between two gaps has nothing to be smoothed with.
    np.testing.assert_array_equal(result.positions[151, 0], positions[151, 0])
    whole = smooth(tracks.select(["b"]), 8.0)
    np.testing.assert_allclose(result.positions[:, 1:], whole.positions, atol=1e-9)
    assert result.provenance[-1].arguments == {"cutoff_hz": 8.0, "order": 4}


@pytest.mark.parametrize("cutoff", [0.0, -1.0, 50.0, 60.0, np.nan, np.inf])
def test_cutoffs_beyond_the_rate_are_refused(cutoff):
    with pytest.raises(DataError, match="below 50 Hz"):
        smooth(parameter(sine(1)), cutoff)


def test_orders_below_one_are_refused():
    with pytest.raises(DataError, match="order"):
        smooth(parameter(sine(1)), 10, 0)


def poses(frames=300, rate=100.0, noise=0.0, seed=0) -> tuple[PoseTracks, Rotation]:
    rng = np.random.default_rng(seed)
    times = np.arange(frames)[:, None] / rate
    truth = Rotation.from_rotvec(0.4 * np.sin(times * [2.0, 3.0, 5.0]))
    noisy = truth * Rotation.from_rotvec(noise * rng.normal(size=(frames, 3)))
    tracks = PoseTracks(
        ("head",),
        rate,
        noisy.as_matrix()[:, None],
        np.sin(times)[:, None] * np.array([10.0, 20, 30]),
        np.full((frames, 1), 0.1),
    )
    return tracks, truth


def test_smoothed_rotations_are_rotations_and_nearer_to_the_truth():
    tracks, truth = poses(noise=0.02)
    result = smooth(tracks, 6.0)
    matrices = result.rotations[:, 0]
    np.testing.assert_allclose(
        matrices @ matrices.transpose(0, 2, 1), np.eye(3) + 0 * matrices, atol=1e-12
    )

    def error(rotations):
        return (truth.inv() * Rotation.from_matrix(rotations)).magnitude().mean()

    assert error(matrices) < 0.6 * error(tracks.rotations[:, 0])


@pytest.mark.parametrize("rate", [60.0, 25.0, 240.0, 133.3])
def test_resampling_keeps_time_and_movement(rate):
    result = resample(parameter(sine(2.0), start_time=1.5), rate)
    assert result.rate == rate
    assert result.start_time == 1.5
    last = 1.5 + 999 / 100
    assert last - 1 / rate - 1e-6 < result.times[-1] <= last + 1e-6
    truth = np.sin(2 * np.pi * 2.0 * (result.times - 1.5) + 0.3)
    inner = (result.times > 1.7) & (result.times < last - 0.2)
    np.testing.assert_allclose(result.values[inner, 0], truth[inner], atol=2e-3)


def test_twice_the_rate_keeps_every_sample(rng):
    values = rng.normal(size=50)
    result = resample(parameter(values), 200.0)
    assert result.frames == 99
    np.testing.assert_allclose(result.values[::2, 0], values, atol=1e-12)
    same = resample(parameter(values), 100.0)
    np.testing.assert_allclose(same.values[:, 0], values, atol=1e-12)


def test_what_the_lower_rate_cannot_carry_is_gone_and_not_folded():
    # 29 Hz would appear as 1 Hz at 30 Hz.
    result = resample(parameter(sine(29.0, frames=2000, rate=120.0), rate=120.0), 30.0)
    assert np.abs(result.values[30:-30]).max() < 0.01
    naive = sine(29.0, frames=2000, rate=120.0)[::4]
    assert np.abs(naive).max() > 0.9


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32 - 1), st.sampled_from([30.0, 60.0, 75.0, 180.0]))
def test_gaps_stay_gaps_and_do_not_spread(seed, rate):
    rng = np.random.default_rng(seed)
    positions = np.ones((80, 2, 3))
    positions[rng.random((80, 2)) < 0.3] = np.nan
    tracks = MarkerTracks(("a", "b"), 100, positions)
    result = resample(tracks, rate)
    places = np.arange(result.frames) * 100 / rate
    before, after = np.floor(places + 1e-6).astype(int), np.ceil(places - 1e-6).astype(int)
    expected = tracks.visible[before] & tracks.visible[after]
    np.testing.assert_array_equal(result.visible, expected)
    np.testing.assert_allclose(result.positions[expected], 1.0, atol=1e-6)


def test_the_less_direct_origin_counts():
    tracks = MarkerTracks(
        ("a",), 50, np.zeros((4, 1, 3)), np.array([[1], [2], [1], [3]], dtype=np.uint8)
    )
    origin = resample(tracks, 100).origin[:, 0].tolist()
    measured, filled, virtual = Origin.MEASURED, Origin.FILLED, Origin.VIRTUAL
    assert origin == [measured, filled, filled, filled, measured, virtual, virtual]


def test_uncertainty_is_not_smoothed_away():
    deviations = np.array([[0.1], [0.3], [np.inf], [0.1]])
    tracks = ParameterTracks(("p",), 50, np.zeros((4, 1)), deviations, np.array([1, 2, np.nan, 4]))
    result = resample(tracks, 100)
    np.testing.assert_allclose(
        result.standard_deviations[:, 0], [0.1, 0.2, 0.3, np.inf, np.inf, np.inf, 0.1]
    )
    np.testing.assert_allclose(result.residuals, [1, 1.5, 2, np.nan, np.nan, np.nan, 4])


@pytest.mark.parametrize("rate", [60.0, 250.0])
def test_poses_are_resampled_along_the_sphere(rate):
    tracks, _ = poses()
    rotations = tracks.rotations.copy()
    rotations[100:110] = np.nan
    result = resample(tracks.replace(rotations=rotations), rate)
    gone = np.isnan(result.rotations[:, 0, 0, 0])
    inside = (result.times > 0.99 + 1e-9) & (result.times < 1.10 - 1e-9)
    np.testing.assert_array_equal(gone, inside)
    truth = Rotation.from_rotvec(0.4 * np.sin(result.times[:, None] * [2.0, 3.0, 5.0]))
    error = (truth[~gone].inv() * Rotation.from_matrix(result.rotations[~gone, 0])).magnitude()
    assert error.max() < 0.01


@pytest.mark.parametrize("rate", [0.0, -10.0, np.nan, np.inf])
def test_impossible_rates_are_refused(rate):
    with pytest.raises(DataError, match="rate"):
        resample(parameter(sine(1)), rate)


def test_one_frame_and_none_can_be_resampled():
    assert resample(parameter([0.5]), 60).values.tolist() == [[0.5]]
    assert resample(parameter(np.zeros(0)), 60).frames == 0
    assert smooth(parameter([0.5]), 6).values.tolist() == [[0.5]]
    assert smooth(parameter(np.zeros(0)), 6).frames == 0


def test_positions_and_values_follow_a_cubic_spline_through_each_stretch(rng):
    values = rng.normal(size=(40, 1, 3))
    gappy = values.copy()
    gappy[20] = np.nan
    tracks = MarkerTracks(("m",), 50.0, gappy)
    result = resample(tracks, 175.0)
    frames = result.times * 50.0
    for part in (slice(0, 20), slice(21, 40)):
        inside = (frames >= part.start - 1e-9) & (frames <= part.stop - 1 + 1e-9)
        spline = CubicSpline(np.arange(part.start, part.stop), values[part, 0])
        np.testing.assert_allclose(
            result.positions[inside, 0], spline(frames[inside]), rtol=0, atol=1e-9
        )
    one = resample(parameter(values[:, 0, 0], rate=50.0), 175.0)
    np.testing.assert_allclose(
        one.values[:, 0], CubicSpline(np.arange(40), values[:, 0, 0])(one.times * 50.0), atol=1e-9
    )
    pose = PoseTracks(("b",), 50.0, np.tile(np.eye(3), (40, 1, 1, 1)), values)
    np.testing.assert_allclose(
        resample(pose, 175.0).translations[:, 0],
        CubicSpline(np.arange(40), values[:, 0])(frames),
        atol=1e-9,
    )


def test_rotations_turn_evenly_between_frames():
    turns = Rotation.from_rotvec(np.radians([[0, 0, 0], [0, 0, 90], [0, 0, 240]]))
    tracks = PoseTracks(("b",), 1.0, turns.as_matrix()[:, None], np.zeros((3, 1, 3)))
    result = Rotation.from_matrix(resample(tracks, 3.0).rotations[:, 0])
    angles = np.degrees(np.unwrap(result.as_euler("zyx")[:, 0]))
    np.testing.assert_allclose(angles, [0, 30, 60, 90, 140, 190, 240], atol=1e-9)


def test_half_a_rate_is_filtered_at_two_fifths_of_it():
    """The low-pass before a lower rate has taken 3 dB at 0.4 of the new rate."""
    wave = sine(20.0, frames=4000, rate=400.0, phase=0.0)
    result = resample(parameter(wave, rate=400.0), 50.0).values[:, 0]
    truth = np.sin(2 * np.pi * 20.0 * np.arange(len(result)) / 50.0)
    middle = slice(100, 400)
    gain = np.linalg.lstsq(truth[middle, None], result[middle], rcond=None)[0][0]
    assert gain == pytest.approx(np.sqrt(0.5), abs=2e-3)
    # Without a lower rate nothing is filtered.
    same = resample(parameter(wave, rate=400.0), 400.0 * (1 - 1e-10)).values[:, 0]
    np.testing.assert_allclose(same, wave, atol=1e-12)


@pytest.mark.parametrize("order", [0, 13])
def test_orders_that_butterworth_filters_do_not_have_are_refused(order):
    with pytest.raises(DataError, match="1 to 12"):
        smooth(parameter(sine(1)), 10, order)
    smooth(parameter(sine(1)), 10, min(max(order, 1), 12))


@pytest.mark.parametrize(("less", "filtered"), [(1e-9, False), (1.5e-9, True)])
def test_a_rate_is_lower_from_a_billionth_on(less, filtered):
    values = sine(190.0, rate=400.0)
    result = resample(parameter(values, rate=400.0), 400.0 * (1 - less)).values[:, 0]
    # At 0.4 of the rate, 160 Hz, the low-pass has taken 3 dB; 190 Hz are hardly there any more.
    assert (np.abs(result[100:-100]).max() < 0.5) == filtered


def test_the_last_frame_may_be_late_by_a_millionth():
    """Of 101 frames at 100 Hz, 61 fit at 60 Hz, however the last product is rounded."""
    assert resample(parameter(np.zeros(101)), 60.0).frames == 61
    assert resample(parameter(np.zeros(101)), 60.0 * (1 - 1.2e-8)).frames == 61
    assert resample(parameter(np.zeros(101)), 60.0 * (1 - 2.5e-8)).frames == 60
