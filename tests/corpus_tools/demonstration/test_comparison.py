"""A fit beside the truth: the bound and the errors are what they are said to be."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from corpus_tools.demonstration.comparison import (
    FittedRecording,
    compute_bounds,
    compute_pose_errors,
    measure_accuracy,
)
from corpus_tools.demonstration.figures import choose_frames
from mocap_fit.drawing import save_figure
from mocap_fit.errors import DataError
from mocap_fit.fitting import fit_speaker
from mocap_fit.io import read_tracks
from mocap_fit.tracks import read_parquet


@pytest.fixture(scope="module")
def speaker(session):
    return fit_speaker("built-in", session.layout, session.reference)


@pytest.fixture(scope="module")
def fitted(session, speaker):
    recording = read_tracks(session.recordings[0])
    fit = speaker.fit(recording, objective="squares")
    return FittedRecording(
        recording,
        fit.shape,
        fit.head_motion,
        read_parquet(session.truth[0]),
        read_parquet(session.poses[0]),
    )


def replaced(fitted, **changes):
    parts = {name: getattr(fitted, name) for name in ("recording", "fit", "motion", "truth")}
    return FittedRecording(**{**parts, "true_pose": fitted.true_pose, **changes})


def test_a_recording_and_its_truth_have_the_same_frames(fitted):
    with pytest.raises(DataError, match="differ in their frames"):
        replaced(fitted, truth=fitted.truth.between(0, 0.2))


def test_the_bound_with_the_true_pose_is_that_of_the_jacobian(fitted, speaker):
    """σ² (JᵀJ)⁻¹, with J by differences and not by the code that the fit uses."""
    binding = speaker.binding
    bounds = compute_bounds(fitted, binding, 0.3, pose_known=True)
    frame = int(np.flatnonzero(fitted.motion.known)[3])
    step = 1e-5
    here = fitted.truth.values[frame]
    jacobian = np.stack(
        [
            (binding.evaluate(here + d)[0] - binding.evaluate(here - d)[0]) / (2 * step)
            for d in step * np.eye(len(here))
        ],
        axis=2,
    )[~fitted.hidden[frame]].reshape(-1, len(here))
    expected = (
        0.3 * binding.orientation.scale * np.sqrt(np.diag(np.linalg.inv(jacobian.T @ jacobian)))
    )
    np.testing.assert_allclose(bounds[frame], expected, rtol=1e-5)


def test_the_bound_grows_with_noise_and_with_what_is_not_known(fitted, speaker):
    known = fitted.motion.known
    bounds = compute_bounds(fitted, speaker.binding, 0.3)[known]
    assert np.isfinite(bounds).all()
    twice = compute_bounds(fitted, speaker.binding, 0.6)[known]
    np.testing.assert_allclose(twice, 2 * bounds)
    given = compute_bounds(fitted, speaker.binding, 0.3, pose_known=True)[known]
    assert (bounds > given).all()
    positions = fitted.recording.positions.copy()
    positions[:, fitted.recording.names.index("lip_corner_left")] = np.nan
    hidden = replaced(fitted, recording=fitted.recording.replace(positions=positions, origin=None))
    worse = compute_bounds(hidden, speaker.binding, 0.3, pose_known=True)[known]
    assert (worse > given - 1e-12).all()
    column = fitted.truth.names.index("left_corner_stretch")
    assert np.median(worse[:, column] / given[:, column]) > 1.2


def test_a_perfect_fit_has_no_error(fitted, speaker):
    tracks = fitted.fit.parameters.replace(values=fitted.truth.values)
    perfect = type(fitted.fit)(**{**vars(fitted.fit), "parameters": tracks})
    result = measure_accuracy([replaced(fitted, fit=perfect)], speaker.binding, 0.3)
    np.testing.assert_allclose(result.errors, 0, atol=1e-15)
    np.testing.assert_allclose(result.correlations, 1)


def test_errors_of_the_head_are_millimetres_and_radians(fitted):
    motion = fitted.motion
    right = fitted.true_pose.replace(
        rotations=motion.rotations[:, None], translations=motion.translations[:, None]
    )
    shifts, turns = compute_pose_errors(motion, right)
    known = motion.known
    np.testing.assert_allclose(shifts[known], 0, atol=1e-9)
    np.testing.assert_allclose(turns[known], 0, atol=1e-7)
    assert np.isnan(shifts[~known]).all()
    assert np.isnan(turns[~known]).all()
    # Turned about the centre of the reference markers by a degree, then shifted by 3, 4, 0.
    turn = Rotation.from_rotvec([0, np.radians(1), 0]).as_matrix()
    middle = motion.rotations @ motion.centre + motion.translations
    rotations = turn @ motion.rotations
    translations = middle + np.array([3, 4, 0]) - rotations @ motion.centre
    wrong = fitted.true_pose.replace(
        rotations=rotations[:, None], translations=translations[:, None]
    )
    shifts, turns = compute_pose_errors(motion, wrong)
    np.testing.assert_allclose(shifts[known], 5)
    np.testing.assert_allclose(np.degrees(turns[known]), 1)


def test_markers_in_head_coordinates_are_where_the_face_is(fitted, speaker):
    places = speaker.binding.orientation.apply(fitted.in_head_coordinates)
    columns = fitted.recording.indices(speaker.binding.names)
    for frame in np.flatnonzero(fitted.motion.known)[::5]:
        virtual, _ = speaker.binding.evaluate(fitted.fit.parameters.values[frame])
        apart = np.linalg.norm(places[frame, columns] - virtual, axis=1)
        residuals = fitted.fit.marker_residuals[frame] * speaker.binding.orientation.scale
        np.testing.assert_allclose(apart, residuals, atol=1e-9)


def test_choose_frames_are_apart_and_in_order(fitted):
    chosen = choose_frames(fitted, 3, least_distance=0.1)
    assert len(chosen) == 3
    assert (np.diff(fitted.truth.times[chosen]) > 0.1).all()
    assert fitted.fit.fitted[chosen].all()
    # No more than fit into half a second.
    assert 1 <= len(choose_frames(fitted, 100, least_distance=0.2)) <= 3


def test_a_figure_that_fails_leaves_nothing(tmp_path):
    def fails():
        raise DataError("nothing to draw")

    with pytest.raises(DataError):
        save_figure(tmp_path / "a.png", fails)
    assert not list(tmp_path.iterdir())
