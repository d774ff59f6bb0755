"""The limits that orientation, binding and settings have, on both sides of each."""

import dataclasses
import inspect

import numpy as np
import pytest
from scipy.optimize import approx_fprime
from scipy.spatial.transform import Rotation

from mocap_fit.errors import ConfigurationError, DataError
from mocap_fit.fitting import fit_orientation, fit_over_time, fit_shape
from mocap_fit.fitting.binding import _list_candidates, check_recording
from mocap_fit.fitting.layout import Layout
from mocap_fit.fitting.objective import cost
from mocap_fit.fitting.orientation import Orientation, move_by_pose
from mocap_fit.fitting.speaker import Speaker


@pytest.mark.parametrize(("size", "fits"), [(4.9, True), (5.1, False), (0.21, True), (0.19, False)])
def test_a_face_of_a_fifth_to_five_times_the_size(layout, face, session, size, fits):
    reference = session.record_reference(np.random.default_rng(0))
    smaller = reference.replace(positions=reference.positions / size)
    if fits:
        assert fit_orientation(face, layout, smaller).scale == pytest.approx(size, rel=0.02)
    else:
        with pytest.raises(DataError, match="differ too much in size") as caught:
            fit_orientation(face, layout, smaller)
        assert caught.value.expected == "0.2 to 5 times"


def test_markers_are_laid_above_the_skin_by_their_offset(layout, face, session):
    """The face is larger by about the offset's share of the distances between the points."""
    reference = session.record_reference(np.random.default_rng(0))
    plain, higher = (
        fit_orientation(face, layout.model_copy(update={"marker_offset": offset}), reference)
        for offset in (0.0, 5.0)
    )
    assert 1.01 < higher.scale / plain.scale < 1.2


def test_an_orientation_is_identity_unless_said():
    points = np.arange(12.0).reshape(4, 3)
    np.testing.assert_array_equal(Orientation().apply(points), points)
    np.testing.assert_array_equal(Orientation().undo(points), points)
    assert repr(Orientation(scale=1.25)) == "Orientation: scale 1.25"
    shown = repr(Orientation(residuals={"a": 1.0, "b": 2.0, "c": 6.0}))
    assert shown == "Orientation: scale 1, residuals of 3 points 2 mm (median), 6 mm (largest)"


@pytest.mark.parametrize("size", [0.0, 1e-8, 0.3, 2.0])
def test_a_pose_moves_points_and_differentiates(rng, size):
    positions, jacobian = rng.normal(0, 50, (4, 3)), rng.normal(0, 3, (4, 3, 2))
    centre, pose = (
        np.array([1.0, 2, 3]),
        np.concatenate([size * np.array([0.6, -0.64, 0.48]), [4, 5, 6]]),
    )
    moved, derivative = move_by_pose(positions, jacobian, centre, pose)
    expected = Rotation.from_rotvec(pose[:3]).apply(positions - centre) + centre + pose[3:]
    np.testing.assert_allclose(moved, expected, rtol=1e-12)

    def flat(x):
        shifted = positions + jacobian @ x[:2]
        return move_by_pose(shifted, jacobian, centre, x[2:])[0].ravel()

    numeric = approx_fprime(np.concatenate([[0.0, 0.0], pose]), flat, 1e-6)
    np.testing.assert_allclose(derivative.reshape(12, 8), numeric, atol=2e-4)


def test_triangles_of_a_marker_are_near_its_feature_point_and_in_its_region(face):
    mesh, vertices = face.mesh, face.deform(np.zeros(10))
    mouth = np.linalg.norm(
        vertices[mesh.get_feature_point("8.3")] - vertices[mesh.get_feature_point("8.4")]
    )
    point = vertices[mesh.get_feature_point("8.1")]
    near = np.linalg.norm(vertices - point, axis=1) <= 0.6 * mouth
    skin = mesh.get_part("skin").vertices
    on_skin = (np.arange(len(vertices)) >= skin.start) & (np.arange(len(vertices)) < skin.stop)
    upper = np.zeros(len(vertices), dtype=bool)
    region = next(name for name in sorted(mesh.regions) if "upper" in name)
    upper[mesh.get_region(region)] = True
    for regions, allowed in (((), near & on_skin), ((region,), near & upper)):
        expected = np.flatnonzero(allowed[mesh.triangles].all(axis=1))
        np.testing.assert_array_equal(_list_candidates(mesh, vertices, regions, "8.1"), expected)
        assert len(expected)
    everywhere = _list_candidates(mesh, vertices, (region,), None)
    np.testing.assert_array_equal(everywhere, np.flatnonzero(upper[mesh.triangles].all(axis=1)))


class TestCost:
    """By hand, at distances of 0, 1 and 5 with weights 1, 2 and 3."""

    residuals = np.array([[0.0, 0, 0], [0, 1, 0], [3, 0, 4]])
    weights = np.array([1.0, 2, 3])

    @pytest.mark.parametrize(
        ("objective", "value", "slopes"),
        [
            ("distances", 2 + 15.0, [0, 2.0, 3 * np.array([0.6, 0, 0.8])]),
            ("squares", 2 + 75.0, [0, 4.0, 3 * np.array([6.0, 0, 8.0])]),
            # With the threshold 2: 1, and 2 · 2 · 5 - 4 = 16.
            ("huber", 2 + 48.0, [0, 4.0, 3 * 4 * np.array([0.6, 0, 0.8])]),
        ],
    )
    def test_values_and_slopes(self, objective, value, slopes):
        found, gradient = cost(self.residuals, self.weights, objective, 2.0)
        assert found == pytest.approx(value)
        np.testing.assert_allclose(gradient[0], 0.0)
        np.testing.assert_allclose(gradient[1], [0, slopes[1], 0])
        np.testing.assert_allclose(gradient[2], slopes[2])


MARKER = {"name": "a", "feature_point": "2.1", "orientation": True}


def layout_of(*more, **settings):
    names = [dict(MARKER, name=name) for name in "abc"]
    return Layout.model_validate({"markers": [*names, *more], **settings})


class TestLayout:
    def test_offsets_from_0_to_20_millimetres(self):
        assert layout_of(marker_offset=0.0).marker_offset == 0.0
        assert layout_of(marker_offset=20.0).marker_offset == 20.0
        for offset in (-0.1, 20.1):
            with pytest.raises(ValueError, match="marker_offset"):
                layout_of(marker_offset=offset)

    def test_weights_above_0(self):
        assert layout_of(dict(MARKER, name="d", weight=1e-3)).markers[-1].weight == 1e-3
        with pytest.raises(ValueError, match="weight"):
            layout_of(dict(MARKER, name="d", weight=0.0))

    def test_three_strategic_points(self):
        with pytest.raises(ValueError, match="2 markers have orientation"):
            Layout.model_validate(
                {
                    "markers": [
                        MARKER,
                        dict(MARKER, name="b"),
                        dict(MARKER, name="c", orientation=False),
                    ]
                }
            )

    def test_three_head_markers_where_sizes_vary(self):
        head = [{"name": name, "role": "head"} for name in "xyz"]
        assert layout_of(*head, size_varies=True).size_varies
        with pytest.raises(ValueError, match="three or more markers with the role 'head'"):
            layout_of(*head[:2], size_varies=True)
        assert not layout_of(*head[:2]).size_varies

    def test_a_marker_has_a_place_on_the_face(self):
        assert layout_of({"name": "d", "region": ["skin"]}).markers[-1].feature_point is None
        with pytest.raises(ValueError, match="'d' needs a feature_point or a region"):
            layout_of({"name": "d"})
        assert layout_of({"name": "d", "role": "head"}).head_markers[0].name == "d"
        with pytest.raises(ValueError, match="no feature_point"):
            layout_of({"name": "d", "region": ["skin"], "orientation": True})

    def test_defaults(self):
        marker = layout_of({"name": "d", "region": ["skin"]}).markers[-1]
        assert (marker.role, marker.weight, marker.orientation) == ("face", 1.0, False)
        plain = layout_of()
        assert (plain.marker_offset, plain.size_varies) == (0.0, False)


class TestSettings:
    @pytest.fixture
    def recording(self, binding, make_tracks, some_values):
        return make_tracks(binding, np.tile(some_values, (5, 1)))

    @pytest.mark.parametrize(
        ("setting", "value"),
        [("huber_threshold", 1e-9), ("maximum_evaluations", 1), ("maximum_evaluations", 3)],
    )
    def test_the_least_is_taken(self, binding, recording, setting, value):
        fit = fit_shape(
            binding, recording, objective="huber", solver="LN_SBPLX", **{setting: value}
        )
        if setting == "maximum_evaluations":
            assert (fit.evaluations <= value).all()
            assert (fit.status == 5).all()

    @pytest.mark.parametrize(
        "changes",
        [{"huber_threshold": 0.0}, {"huber_threshold": np.inf}, {"maximum_evaluations": 0}],
    )
    def test_below_it_nothing_is(self, binding, recording, changes):
        with pytest.raises(ConfigurationError, match="out of range"):
            fit_shape(binding, recording, **changes)

    def test_of_the_fit_over_time(self, binding, recording):
        fit = fit_shape(binding, recording, objective="squares")
        one = fit_over_time(
            binding, recording, fit, objective="squares", maximum_rounds=1, maximum_gap=0.0
        )
        np.testing.assert_array_equal(one.parameters.values, fit.parameters.values)
        np.testing.assert_array_equal(one.evaluations, fit.evaluations + 1)
        for changes in ({"maximum_rounds": 0}, {"maximum_gap": -1e-9}, {"weight": 0.0}):
            with pytest.raises(ConfigurationError, match="out of range"):
                fit_over_time(binding, recording, fit, **changes)

    def test_two_visible_markers_are_a_frame(self, binding, recording):
        positions = recording.positions.copy()
        positions[1, 2 : len(binding.names)] = np.nan
        positions[3, 1 : len(binding.names)] = np.nan
        fit = fit_shape(binding, recording.replace(positions=positions, origin=None))
        assert fit.fitted.tolist() == [True, True, True, False, True]

    def test_weights_count(self, binding, recording):
        """A marker that is off counts by its weight."""
        positions = recording.positions.copy()
        positions[:, 3] += 2.0
        moved = recording.replace(positions=positions)
        costs = []
        for weight in (0.5, 1.0, 4.0):
            weights = binding.weights.copy()
            weights[3] = weight
            other = dataclasses.replace(binding, weights=weights)
            costs.append(fit_shape(other, moved, objective="squares").costs[0])
        assert costs[0] < costs[1] < costs[2] < 8 * costs[0]

    def test_recordings_must_have_all_markers(self, binding, recording):
        check_recording(binding, recording)
        with pytest.raises(DataError, match="lacks markers of the layout") as caught:
            check_recording(binding, recording.select(recording.names[2:]))
        assert all(name in caught.value.problem for name in recording.names[:2])


def test_settings_that_are_left_out_are_those_of_the_reference():
    """Huber's knee at a millimetre, a gap of a fifth of a second, 50 rounds, 2000 evaluations."""
    shape, over_time, fit = (
        {n: p.default for n, p in inspect.signature(f).parameters.items()}
        for f in (fit_shape, fit_over_time, Speaker.fit)
    )
    assert (shape["objective"], shape["solver"]) == ("distances", "newton-nlopt")
    assert (shape["huber_threshold"], shape["maximum_evaluations"]) == (1.0, 2000)
    assert (over_time["objective"], over_time["weight"]) == ("distances", None)
    assert over_time["huber_threshold"] == 1.0
    assert (over_time["maximum_gap"], over_time["maximum_rounds"]) == (0.2, 50)
    assert shape["refine_pose"] is fit["refine_pose"] is fit["smooth"] is False
