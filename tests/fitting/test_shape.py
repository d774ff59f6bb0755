"""The shape fit: known truth recovered, hidden markers, choices, results, bad input."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from corpus_tools.simulation import Conditions, Session
from mocap_fit.errors import ConfigurationError, DataError, MocapFitWarning
from mocap_fit.face import load_face
from mocap_fit.fitting import Binding, fit_shape
from mocap_fit.fitting.objective import OBJECTIVES
from mocap_fit.fitting.shape import compute_root_mean_square
from mocap_fit.fitting.solving import SOLVERS, STATUS

WITHIN = st.lists(st.floats(-0.3, 1.2), min_size=10, max_size=10).map(np.array)


@settings(max_examples=15, deadline=None)
@given(values=WITHIN)
def test_truth_is_recovered_without_noise(binding: Binding, make_tracks, values) -> None:
    fit = fit_shape(binding, make_tracks(binding, values), objective="squares")
    np.testing.assert_allclose(fit.parameters.values[0], values, atol=2e-5)
    assert fit.costs[0] < 1e-6


@pytest.mark.parametrize("objective", OBJECTIVES)
def test_every_objective_recovers_a_track(binding: Binding, make_tracks, objective, rng) -> None:
    values = rng.uniform(-0.1, 0.8, (4, 10))
    fit = fit_shape(binding, make_tracks(binding, values), objective=objective)
    np.testing.assert_allclose(fit.parameters.values, values, atol=2e-3)
    assert (fit.parameters.residuals < 0.01).all()


@pytest.mark.parametrize("solver", SOLVERS)
def test_every_solver_finds_the_same(binding: Binding, make_tracks, solver, some_values) -> None:
    rng = np.random.default_rng(5)
    exact = make_tracks(binding, some_values)
    noisy = exact.replace(positions=exact.positions + rng.normal(0, 0.3, exact.positions.shape))
    best = fit_shape(binding, noisy, objective="squares").costs[0]
    fit = fit_shape(binding, noisy, objective="squares", solver=solver, maximum_evaluations=20_000)
    assert fit.costs[0] <= best * (1 + 1e-3)
    np.testing.assert_allclose(fit.parameters.values[0], some_values, atol=0.25)


def test_the_answer_is_the_least(binding: Binding, make_tracks, some_values, rng) -> None:
    """No other start and no small step gives a smaller sum of distances."""
    exact = make_tracks(binding, some_values)
    target = exact.positions[0, :30] + rng.normal(0, 0.5, (30, 3))
    noisy = exact.select(binding.names).replace(positions=target[None])
    fit = fit_shape(binding, noisy)
    found = fit.parameters.values[0]

    def total(values: np.ndarray) -> float:
        return float(np.linalg.norm(binding.evaluate(values)[0] - target, axis=1).sum())

    assert total(found) == pytest.approx(fit.costs[0], rel=1e-9)
    for _ in range(200):
        assert total(found + rng.normal(0, 1e-4, 10)) >= fit.costs[0] * (1 - 1e-7)


def test_distances_forgive_one_bad_marker(binding: Binding, make_tracks, some_values) -> None:
    exact = make_tracks(binding, some_values)
    positions = exact.positions.copy()
    positions[0, exact.index("chin_left")] += [0, 6, 6]
    swapped = exact.replace(positions=positions)
    robust = fit_shape(binding, swapped).parameters.values[0]
    squares = fit_shape(binding, swapped, objective="squares").parameters.values[0]
    assert np.abs(robust - some_values).max() < 0.01
    assert np.abs(squares - some_values).max() > 0.03


def test_bounds_hold(binding: Binding, make_tracks, face) -> None:
    beyond = np.full(10, 2.5)
    fit = fit_shape(binding, make_tracks(binding, beyond))
    lower, upper = face.bounds.T
    assert (fit.parameters.values >= lower).all()
    assert (fit.parameters.values <= upper).all()


def test_hidden_markers_are_left_out(binding: Binding, make_tracks, some_values) -> None:
    exact = make_tracks(binding, some_values)
    positions = exact.positions.copy()
    hidden = [exact.index(n) for n in ("nose_tip", "cheek_left", "lip_upper_left")]
    positions[0, hidden] = np.nan
    fit = fit_shape(binding, exact.replace(positions=positions), objective="squares")
    np.testing.assert_allclose(fit.parameters.values[0], some_values, atol=1e-4)
    assert np.isnan(fit.marker_residuals[0]).sum() == 3
    assert not fit.parameters.uncertain.any()


def test_a_parameter_that_only_hidden_markers_show_is_uncertain(
    binding: Binding, make_tracks, some_values
) -> None:
    two = np.stack([some_values, some_values + 0.1])
    exact = make_tracks(binding, two)
    _, jacobian = binding.evaluate(some_values)
    moved = np.abs(jacobian[:, :, 2]).max(axis=1) > 1e-9  # upper lip retraction
    positions = exact.positions.copy()
    positions[1, : len(binding.names)][moved] = np.nan
    fit = fit_shape(binding, exact.replace(positions=positions), objective="squares")
    assert not fit.parameters.uncertain[0].any()
    assert fit.parameters.uncertain[1, 2]
    # It keeps its value from the frame before, and does not wander.
    assert fit.parameters.values[1, 2] == pytest.approx(fit.parameters.values[0, 2])
    sure = ~fit.parameters.uncertain[1]
    assert sure.sum() >= 3
    np.testing.assert_allclose(fit.parameters.values[1, sure], two[1, sure], atol=1e-3)


@pytest.mark.parametrize("solver", ["newton-nlopt", "newton"])
def test_a_tongue_that_no_marker_sees_rests(layout, binding, make_tracks, solver, rng) -> None:
    exact = make_tracks(binding, rng.uniform(-0.1, 0.8, (4, 10)))
    noisy = exact.replace(positions=exact.positions + rng.normal(0, 0.3, exact.positions.shape))
    with_tongue = Session(layout, load_face(tongue=True), Conditions(noise=0, drop_outs=0)).binding
    ten, fifteen = (fit_shape(b, noisy, solver=solver).parameters for b in (binding, with_tongue))
    np.testing.assert_array_equal(fifteen.values[:, :10], ten.values)
    assert not fifteen.values[:, 10:].any()
    assert fifteen.uncertain[:, 10:].all()


def test_a_frame_without_markers_is_not_fitted(binding: Binding, make_tracks, some_values) -> None:
    exact = make_tracks(binding, np.tile(some_values, (3, 1)))
    positions = exact.positions.copy()
    positions[1] = np.nan
    fit = fit_shape(binding, exact.replace(positions=positions), objective="squares")
    assert fit.fitted.tolist() == [True, False, True]
    assert np.isnan(fit.parameters.values[1]).all()
    assert np.isnan(fit.parameters.residuals[1])
    np.testing.assert_allclose(fit.parameters.values[2], some_values, atol=1e-4)


def test_a_moved_head_is_found_together_with_the_shape(
    binding: Binding, make_tracks, some_values
) -> None:
    exact = make_tracks(binding, some_values)
    turn, shift = Rotation.from_rotvec([0.01, -0.02, 0.015]), np.array([0.5, -0.8, 0.3])
    centre = binding.head_positions.mean(axis=0)
    moved = turn.apply(exact.positions[0] - centre) + centre + shift
    recording = exact.replace(positions=moved[None])
    plain = fit_shape(binding, recording, objective="squares")
    refined = fit_shape(binding, recording, objective="squares", refine_pose=True)
    assert np.abs(plain.parameters.values[0] - some_values).max() > 0.05
    np.testing.assert_allclose(refined.parameters.values[0], some_values, atol=1e-4)
    np.testing.assert_allclose(refined.pose_corrections[0, :3], turn.as_rotvec(), atol=1e-5)
    np.testing.assert_allclose(refined.pose_corrections[0, 3:], shift, atol=1e-3)


def test_a_refined_pose_helps_when_the_pose_is_noisy(session, rng, face, layout) -> None:
    """The head's pose from five noisy markers is improved by thirty more."""
    from corpus_tools.simulation import Conditions, Session
    from mocap_fit.head import remove_head_motion

    noisy = Session(layout, face, Conditions(noise=0.3, drop_outs=0.0, duration=1.5))
    simulation = noisy.record(rng, "noisy")
    names = [m.name for m in layout.head_markers]
    # Laid on the reference in the laboratory, then back to the head's own coordinates.
    reference = Session(
        layout, face, Conditions(noise=0.0, reference_duration=0.1)
    ).record_reference(rng)
    from mocap_fit.fitting import bind_markers, fit_orientation

    orientation = fit_orientation(face, layout, reference)
    binding = bind_markers(face, layout, reference, orientation)
    still, _ = remove_head_motion(simulation.recording, reference, names=names)
    errors = {}
    for refine in (False, True):
        fit = fit_shape(binding, still, objective="squares", refine_pose=refine)
        error = fit.parameters.values - simulation.parameters.values
        errors[refine] = np.sqrt(np.mean(error**2, axis=0))
    thrust = face.parameter_names.index("jaw_thrust")
    assert errors[True][thrust] < 0.8 * errors[False][thrust]
    assert errors[True].mean() < errors[False].mean()


def test_standard_deviations_are_those_of_the_errors(binding: Binding, make_tracks, rng) -> None:
    values = np.tile(np.full(10, 0.3), (150, 1))
    exact = make_tracks(binding, values).select(binding.names)
    noisy = exact.replace(positions=exact.positions + rng.normal(0, 0.2, exact.positions.shape))
    fit = fit_shape(binding, noisy, objective="squares")
    assert fit.noise == pytest.approx(0.2, rel=0.03)
    found = fit.parameters.values.std(axis=0)
    stated = fit.parameters.standard_deviations.mean(axis=0)
    np.testing.assert_allclose(found, stated, rtol=0.25)


def test_the_result_tells_all(binding: Binding, make_tracks, some_values) -> None:
    recording = make_tracks(binding, np.tile(some_values, (3, 1)))
    done: list[int] = []
    fit = fit_shape(binding, recording, progress=done.append)
    assert done == [3]
    assert set(fit.status.tolist()) <= set(STATUS)
    assert (fit.evaluations > 0).all()
    assert fit.marker_names == binding.names
    assert fit.parameters.names == binding.parameter_names
    assert fit.parameters.rate == recording.rate
    step = fit.parameters.provenance[-1]
    assert step.name == "fit_shape"
    assert step.arguments["solver"] == "newton-nlopt"
    assert "3 of 3 frames fitted" in str(fit)


def test_evaluations_are_limited(binding: Binding, make_tracks, some_values) -> None:
    fit = fit_shape(
        binding, make_tracks(binding, some_values), solver="LN_PRAXIS", maximum_evaluations=7
    )
    assert fit.evaluations[0] <= 8
    assert fit.status[0] == 5


def test_a_larger_speaker_has_residuals_in_their_own_millimetres(
    binding: Binding, make_tracks, some_values
) -> None:
    double = dataclasses.replace(
        binding, orientation=dataclasses.replace(binding.orientation, scale=0.5)
    )
    recording = make_tracks(double, some_values)
    positions = recording.positions + np.array([0.0, 0.0, 1.0])
    fit = fit_shape(double, recording.replace(positions=positions).select(binding.names))
    lone = fit_shape(binding, make_tracks(binding, some_values))
    assert lone.parameters.residuals[0] < 1e-3
    assert 0.1 < fit.parameters.residuals[0] <= 1.0


def test_a_nan_of_the_rig_does_not_hang(binding: Binding, make_tracks, some_values) -> None:
    class Brittle:
        """A rig that gives NaN where a parameter is above a limit."""

        mesh = binding.rig.mesh
        parameter_names = binding.rig.parameter_names
        bounds = binding.rig.bounds

        def deform(self, values):
            vertices = binding.rig.deform(values)
            return vertices * np.nan if values[0] > 0.45 else vertices

        def jacobian(self, values):
            return binding.rig.jacobian(values)

        def compile(self, vertex_ids):
            return None

    brittle = dataclasses.replace(binding, rig=Brittle(), compiled=None)
    recording = make_tracks(binding, some_values)
    fit = fit_shape(brittle, recording, objective="squares", maximum_evaluations=200)
    np.testing.assert_allclose(fit.parameters.values[0], some_values, atol=0.05)


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"objective": "cubes"}, "cubes"),
        ({"solver": "LD_MAGIC"}, "LD_MAGIC"),
        ({"solver": "GN_DIRECT"}, "GN_DIRECT"),
        ({"huber_threshold": 0.0, "objective": "huber"}, "threshold"),
        ({"maximum_evaluations": 0}, "evaluations"),
    ],
)
def test_choices_that_are_not_there(binding: Binding, make_tracks, some_values, changes, says):
    with pytest.raises(ConfigurationError, match=says):
        fit_shape(binding, make_tracks(binding, some_values), **changes)


def test_a_recording_of_another_layout(binding: Binding, make_tracks, some_values) -> None:
    recording = make_tracks(binding, some_values)
    other = recording.select([n for n in recording.names if n not in ("nose_tip", "chin_mid")])
    with pytest.raises(DataError, match="chin_mid, nose_tip"):
        fit_shape(binding, other)


def test_nothing_to_fit(binding: Binding, make_tracks, some_values) -> None:
    recording = make_tracks(binding, some_values)
    empty = recording.replace(positions=recording.positions * np.nan, origin=None)
    with pytest.raises(DataError, match="no frame"):
        fit_shape(binding, empty)


def test_pose_refinement_needs_head_markers(binding: Binding, make_tracks, some_values) -> None:
    bare = dataclasses.replace(
        binding, head_names=(), head_positions=np.zeros((0, 3)), head_weights=np.zeros(0)
    )
    with pytest.raises(ConfigurationError, match="head markers"):
        fit_shape(bare, make_tracks(binding, some_values), refine_pose=True)


def test_the_residual_of_a_frame_is_the_root_mean_square_of_what_is_seen():
    distances = np.array([[3.0, 4.0, np.nan], [0.5, 0.5, 0.5], [np.nan] * 3])
    found = compute_root_mean_square(distances)
    np.testing.assert_allclose(found, [np.sqrt(12.5), 0.5, np.nan])


def test_progress_is_told_every_512_frames(binding: Binding, make_tracks, some_values):
    recording = make_tracks(binding, np.tile(some_values, (2, 1)))
    long = recording.replace(positions=np.tile(recording.positions[:1], (1030, 1, 1)), origin=None)
    steps = []
    fit = fit_shape(binding, long, objective="squares", progress=steps.append)
    assert steps == [512, 1024, 1030]
    np.testing.assert_allclose(fit.parameters.values, np.tile(some_values, (1030, 1)), atol=1e-4)


def test_a_solver_that_is_not_to_be_had_is_warned_of_where_it_was_asked_for(
    binding: Binding, make_tracks, some_values
):
    with pytest.warns(MocapFitWarning, match="'newton' is not available") as caught:
        fit_shape(
            binding,
            make_tracks(binding, some_values),
            solver="newton",
            refine_pose=True,
            maximum_evaluations=3,
        )
    assert [warning.filename for warning in caught] == [__file__]
