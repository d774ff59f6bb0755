"""Virtual markers: eq. 2, the lip seam, and the kernel against plain numpy."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from mocap_fit.errors import ConfigurationError, DataError
from mocap_fit.face import Rig
from mocap_fit.fitting import Binding, Layout, LayoutMarker, Orientation, bind_markers
from mocap_fit.fitting.objective import OBJECTIVES, Evaluator, cost
from mocap_fit.tracks import MarkerTracks

VALUES = st.lists(st.floats(-0.5, 1.4), min_size=10, max_size=10).map(np.array)


def test_markers_are_where_they_were_tied(binding: Binding, session) -> None:
    measured = session.still.select(binding.names).positions[0]
    positions, _ = binding.evaluate(binding.reference_parameters)
    # Eq. 3 is nil in the reference pose.
    assert np.linalg.norm(positions - measured, axis=1).sum() < 1e-9


def test_other_reference_parameters_are_honoured(layout: Layout, face: Rig, session) -> None:
    opened = layout.model_copy(update={"reference_parameters": {"jaw_rotation": 0.3}})
    binding = bind_markers(face, opened, session.still, Orientation())
    measured = session.still.select(binding.names).positions[0]
    values = np.zeros(10)
    values[0] = 0.3
    assert np.abs(binding.evaluate(values)[0] - measured).max() < 1e-9
    assert np.abs(binding.evaluate(np.zeros(10))[0] - measured).max() > 1.0


def test_the_noise_of_the_reference_pose_is_that_of_its_median(layout, face, session, rng) -> None:
    still = session.still
    assert bind_markers(face, layout, still, Orientation()).reference_noise == 0.0
    positions = np.repeat(still.positions[:1], 100, axis=0)
    noisy = MarkerTracks(still.names, 60.0, positions + rng.normal(0, 0.3, positions.shape))
    binding = bind_markers(face, layout, noisy, Orientation(scale=1.1))
    medians = np.median(rng.normal(0, 0.3, (2000, 100)), axis=1)
    assert binding.reference_noise == pytest.approx(1.1 * np.std(medians), rel=0.05)


@settings(max_examples=30, deadline=None)
@given(values=VALUES)
def test_jacobian_is_the_derivative(binding: Binding, values: np.ndarray) -> None:
    step = 1e-6
    _, jacobian = binding.evaluate(values)
    for p in range(len(values)):
        shift = np.eye(len(values))[p] * step
        difference = (binding.evaluate(values + shift)[0] - binding.evaluate(values - shift)[0]) / (
            2 * step
        )
        np.testing.assert_allclose(jacobian[:, :, p], difference, rtol=1e-6, atol=2e-6)


@settings(max_examples=30, deadline=None)
@given(values=VALUES)
def test_kernel_equals_numpy(binding: Binding, values: np.ndarray) -> None:
    positions, jacobian = Evaluator(binding, "squares", 1.0).evaluate(values)
    expected_positions, expected_jacobian = binding.evaluate(values)
    np.testing.assert_allclose(positions, expected_positions, atol=1e-10)
    np.testing.assert_allclose(jacobian, expected_jacobian, atol=1e-10)


@pytest.mark.parametrize("objective", OBJECTIVES)
def test_kernel_cost_equals_numpy(
    binding: Binding, some_values: np.ndarray, rng: np.random.Generator, objective
) -> None:
    weighted = dataclasses.replace(binding, weights=rng.uniform(0.5, 2.0, len(binding.names)))
    target = binding.evaluate(some_values)[0] + rng.normal(0, 1.0, (len(binding.names), 3))
    seen = rng.random(len(binding.names)) > 0.2
    values = some_values + 0.1
    gradient = np.zeros(10)
    evaluator = Evaluator(weighted, objective, 1.2)
    evaluator.set_frame(target, seen)
    value = evaluator.cost(values, gradient)
    positions, jacobian = binding.evaluate(values)
    expected, pull = cost(positions[seen] - target[seen], weighted.weights[seen], objective, 1.2)
    assert value == pytest.approx(expected, rel=1e-12)
    np.testing.assert_allclose(gradient, np.tensordot(pull, jacobian[seen], 2), rtol=1e-10)


@pytest.mark.parametrize("objective", OBJECTIVES)
def test_gradient_of_the_cost(
    binding: Binding, some_values: np.ndarray, rng: np.random.Generator, objective
) -> None:
    target = binding.evaluate(some_values)[0] + rng.normal(0, 0.8, (len(binding.names), 3))
    seen = np.ones(len(binding.names), dtype=bool)
    evaluator = Evaluator(binding, objective, 1.0)
    gradient, ignored = np.zeros(10), np.zeros(10)
    values = some_values + 0.05
    evaluator.set_frame(target, seen)
    evaluator.cost(values, gradient)
    step = 1e-6
    for p in range(10):
        shift = np.eye(10)[p] * step
        upper = evaluator.cost(values + shift, ignored)
        lower = evaluator.cost(values - shift, ignored)
        assert gradient[p] == pytest.approx((upper - lower) / (2 * step), rel=1e-6, abs=1e-6)


def test_a_rig_without_arrays_gives_the_same(binding: Binding, some_values: np.ndarray) -> None:
    called_back = dataclasses.replace(binding, compiled=None)
    for got, expected in zip(
        called_back.evaluate(some_values), binding.evaluate(some_values), strict=True
    ):
        np.testing.assert_allclose(got, expected, atol=1e-9)


def test_lips_never_exchange_markers(face: Rig) -> None:
    """At rest the lips touch: the nearest triangle of the whole face would be a coin flip."""
    strategic = [
        LayoutMarker(name=n, feature_point=n, orientation=True) for n in ("8.3", "8.4", "9.3")
    ]
    upper = LayoutMarker(name="upper", feature_point="2.2", region=("upper_lip",))
    lower = LayoutMarker(name="lower", feature_point="2.3", region=("lower_lip",))
    layout = Layout(markers=(*strategic, upper, lower))
    mesh = face.mesh
    seam = mesh.vertices[[mesh.get_feature_point("2.2"), mesh.get_feature_point("2.3")]].mean(
        axis=0
    )
    rng = np.random.default_rng(0)
    opened = np.zeros(10)
    opened[0] = 1.0
    fixed = mesh.vertices[[mesh.get_feature_point(n) for n in ("8.3", "8.4", "9.3")]]
    for _ in range(20):
        # Both markers in one place, now on this side of the seam, now on that.
        both = np.tile(seam + rng.normal(0, 0.3, 3), (2, 1))
        names = tuple(m.name for m in layout.markers)
        pose = MarkerTracks(names, 60.0, np.concatenate([fixed, both])[None])
        binding = bind_markers(face, layout, pose, Orientation())
        moved = binding.evaluate(opened)[0] - binding.evaluate(np.zeros(10))[0]
        assert moved[3, 1] > -1.0
        assert moved[4, 1] < -15.0


def test_an_orientation_is_applied(layout: Layout, face: Rig, session) -> None:
    orientation = Orientation(0.9, Rotation.from_rotvec([0.1, -0.2, 0.05]).as_matrix(), np.ones(3))
    still = session.still.replace(positions=orientation.undo(session.still.positions))
    binding = bind_markers(face, layout, still, orientation)
    np.testing.assert_allclose(
        binding.evaluate(np.zeros(10))[0],
        session.binding.evaluate(np.zeros(10))[0],
        atol=1e-9,
    )


def test_a_marker_missing_from_the_reference_is_named(layout: Layout, face: Rig, session) -> None:
    without = session.still.select([n for n in session.still.names if n != "chin_mid"])
    with pytest.raises(DataError, match=r"lacks a face marker of the layout .*chin_mid"):
        bind_markers(face, layout, without, Orientation())
    without = without.select([n for n in without.names if n != "lip_upper_mid"])
    with pytest.raises(DataError, match="lacks 2 face markers of the layout"):
        bind_markers(face, layout, without, Orientation())


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"region": ("moustache",)}, "moustache"),
        ({"feature_point": "8.99"}, r"8\.99"),
        ({"feature_point": "8.1", "region": ("scalp",)}, "no triangle"),
    ],
)
def test_places_that_the_face_lacks(layout: Layout, face: Rig, session, changes, says) -> None:
    markers = list(layout.markers)
    index = [m.name for m in markers].index("philtrum_left")
    markers[index] = markers[index].model_copy(update=changes)
    with pytest.raises(ConfigurationError, match=says):
        bind_markers(
            face,
            layout.model_copy(update={"markers": tuple(markers)}),
            session.still,
            Orientation(),
        )
