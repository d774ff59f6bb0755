"""The contract that every rig keeps, and what the built-in rig's gestures do."""

import copy
import pickle
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from mocap_fit.errors import DataError
from mocap_fit.face import CompiledRig, Mesh, Rig, load_face, to_parameters
from mocap_fit.face.builtin import load_built_in_head, reshape_head
from mocap_fit.face.mesh import IndexArray
from mocap_fit.face.rig import Kind, check_parameters, evaluate, evaluate_jacobian

MASK = Path(__file__).parents[2] / "fixtures" / "faces" / "mask.toml"
NAMES = (
    "jaw_rotation",
    "lip_rounding",
    "upper_lip_retraction",
    "upper_lip_raise",
    "lower_lip_retraction",
    "lower_lip_depression",
    "left_corner_stretch",
    "right_corner_stretch",
    "jaw_thrust",
    "jaw_shift",
)


class WavingRig:
    """A rig that cannot be compiled: the mesh waves with the sine of its parameters."""

    parameter_names = ("wave", "ripple")
    bounds = np.array([[-1.0, 1.0], [0.0, 2.0]])

    def __init__(self, mesh: Mesh) -> None:
        self.mesh = mesh
        y = mesh.vertices[:, 1]
        self._shapes = 4 * np.stack([np.sin(y / 30), np.cos(y / 9)], axis=1)

    def deform(self, parameters: np.ndarray) -> np.ndarray:
        values = check_parameters(parameters, self.parameter_names)
        moved = self.mesh.vertices.copy()
        moved[:, 2] += self._shapes @ np.sin(values)
        return moved

    def jacobian(self, parameters: np.ndarray) -> np.ndarray:
        values = check_parameters(parameters, self.parameter_names)
        slopes = np.zeros((len(self.mesh.vertices), 3, 2))
        slopes[:, 2] = self._shapes * np.cos(values)
        return slopes

    def compile(self, vertex_ids: IndexArray) -> None:
        return None


class BlendshapeRig:
    """Displacements of every vertex, added up."""

    parameter_names = ("smile", "frown", "puff")
    bounds = np.array([[0.0, 1.0], [0.0, 1.0], [-0.5, 1.5]])

    def __init__(self, mesh: Mesh) -> None:
        self.mesh = mesh
        count = len(mesh.vertices)
        self._compiled = CompiledRig(
            vertex_ids=np.arange(count),
            rest=mesh.vertices,
            kinds=np.full(3, Kind.FIELD, dtype=np.int64),
            parameters=np.array([2, 0, 1], dtype=np.int64),
            weights=np.zeros((3, count)),
            vectors=np.zeros((3, 3)),
            centres=np.zeros((3, 3)),
            fields=np.random.default_rng(7).normal(0, 3, (3, count, 3)),
            parameter_count=3,
        )

    def deform(self, parameters: np.ndarray) -> np.ndarray:
        return evaluate(self._compiled, check_parameters(parameters, self.parameter_names))

    def jacobian(self, parameters: np.ndarray) -> np.ndarray:
        values = check_parameters(parameters, self.parameter_names)
        return evaluate_jacobian(self._compiled, values)[1]

    def compile(self, vertex_ids: IndexArray) -> CompiledRig:
        return self._compiled.take(vertex_ids)


def reshaped() -> Mesh:
    return reshape_head(
        load_built_in_head(), width=1.1, lower_face=1.15, mouth_width=0.9, size=0.95
    )


MAKERS: dict[str, Callable[[], Rig]] = {
    "built-in": load_face,
    "with a tongue": lambda: load_face(tongue=True),
    "reshaped": lambda: load_face(mesh=reshaped()),
    "foreign": lambda: load_face(MASK),
    "callback": lambda: WavingRig(load_face(MASK).mesh),
    "blendshapes": lambda: BlendshapeRig(load_face(MASK).mesh),
}


@pytest.fixture(scope="module", params=MAKERS)
def any_rig(request: pytest.FixtureRequest) -> Rig:
    return MAKERS[request.param]()


@pytest.fixture(scope="module")
def rig() -> Rig:
    return load_face()


def within_bounds(rig: Rig, shares: list[float]) -> np.ndarray:
    low, high = rig.bounds.T
    return low + (high - low) * np.array(shares[: len(low)])


shares = st.lists(st.floats(0, 1), min_size=15, max_size=15)
few = settings(
    max_examples=5, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)


class TestContract:
    def test_shape_names_and_bounds(self, any_rig: Rig) -> None:
        count = len(any_rig.parameter_names)
        assert len(set(any_rig.parameter_names)) == count
        assert any_rig.bounds.shape == (count, 2)
        assert (any_rig.bounds[:, 0] <= 0).all()
        assert (any_rig.bounds[:, 1] >= 1).all()
        vertices, slopes = any_rig.deform(np.zeros(count)), any_rig.jacobian(np.zeros(count))
        assert vertices.shape == any_rig.mesh.vertices.shape
        assert slopes.shape == (*vertices.shape, count)
        assert vertices.dtype == slopes.dtype == np.float64

    def test_zero_is_the_rest_to_the_bit(self, any_rig: Rig) -> None:
        rest = any_rig.deform(np.zeros(len(any_rig.parameter_names)))
        np.testing.assert_array_equal(rest, any_rig.mesh.vertices)

    def test_every_parameter_moves_something(self, any_rig: Rig) -> None:
        slopes = any_rig.jacobian(np.zeros(len(any_rig.parameter_names)))
        assert (np.linalg.norm(slopes, axis=1).max(axis=0) > 1.0).all()

    @few
    @given(shares=shares)
    def test_the_jacobian_is_the_slope(self, any_rig: Rig, shares: list[float]) -> None:
        values, step = within_bounds(any_rig, shares), 1e-3
        slopes = any_rig.jacobian(values)
        for i in range(len(values)):
            change = np.eye(len(values))[i] * step
            # Four points: the error of the difference is of the fourth order.
            near = any_rig.deform(values + change) - any_rig.deform(values - change)
            far = any_rig.deform(values + 2 * change) - any_rig.deform(values - 2 * change)
            slope = (8 * near - far) / (12 * step)
            scale = np.abs(slope).max()
            np.testing.assert_allclose(slopes[:, :, i], slope, rtol=0, atol=1e-6 * scale)

    @few
    @given(shares=shares)
    def test_compiled_is_the_same(self, any_rig: Rig, shares: list[float]) -> None:
        values = within_bounds(any_rig, shares)
        ids = np.random.default_rng(3).permutation(len(any_rig.mesh.vertices))[:60]
        compiled = any_rig.compile(ids)
        if compiled is None:
            assert isinstance(any_rig, WavingRig)
            return
        np.testing.assert_array_equal(compiled.vertex_ids, ids)
        assert compiled.parameter_count == len(values)
        vertices, slopes = evaluate_jacobian(compiled, values)
        whole = any_rig.deform(values)[ids]
        np.testing.assert_allclose(evaluate(compiled, values), whole, rtol=0, atol=1e-12)
        np.testing.assert_allclose(vertices, whole, rtol=0, atol=1e-12)
        np.testing.assert_allclose(slopes, any_rig.jacobian(values)[ids], rtol=0, atol=1e-12)
        again = compiled.take(np.array([5, 2]))
        np.testing.assert_allclose(evaluate(again, values), whole[[5, 2]], rtol=0, atol=1e-12)

    def test_compiled_arrays_are_what_kernels_read(self, any_rig: Rig) -> None:
        compiled = any_rig.compile(np.array([4, 1, 9]))
        if compiled is None:
            return
        operations = len(compiled.kinds)
        for array, shape in (
            (compiled.rest, (3, 3)),
            (compiled.weights, (operations, 3)),
            (compiled.vectors, (operations, 3)),
            (compiled.centres, (operations, 3)),
        ):
            assert array.shape == shape
            assert array.dtype == np.float64
            assert array.flags.c_contiguous
        assert compiled.fields.shape in ((0, 3, 3), (operations, 3, 3))
        assert compiled.fields.flags.c_contiguous
        assert compiled.kinds.dtype == compiled.parameters.dtype == np.int64

    def test_nothing_given_is_written_to(self, any_rig: Rig) -> None:
        values = np.full(len(any_rig.parameter_names), 0.4)
        first = any_rig.deform(values)
        kept = first.copy()
        any_rig.jacobian(values)
        any_rig.deform(values * 2)
        np.testing.assert_array_equal(first, kept)
        np.testing.assert_array_equal(values, 0.4)
        np.testing.assert_array_equal(any_rig.deform(values), kept)

    @pytest.mark.parametrize("number", [0, 1, 11])
    def test_a_wrong_number_is_refused(self, any_rig: Rig, number: int) -> None:
        for method in (any_rig.deform, any_rig.jacobian):
            with pytest.raises(DataError, match="number of face parameters"):
                method(np.zeros(number))

    @pytest.mark.parametrize("bad", [np.nan, np.inf])
    def test_what_is_not_finite_is_refused(self, any_rig: Rig, bad: float) -> None:
        values = np.zeros(len(any_rig.parameter_names))
        values[1] = bad
        for method in (any_rig.deform, any_rig.jacobian):
            with pytest.raises(DataError, match=any_rig.parameter_names[1]):
                method(values)


class TestCompiledRig:
    def compiled(self, *operations: tuple[Kind, int, list[float], list[float]]) -> CompiledRig:
        """One vertex at (10, 0, 0) with full weight."""
        count = len(operations)
        return CompiledRig(
            np.array([0]),
            np.array([[10.0, 0, 0]]),
            np.array([kind for kind, _, _, _ in operations], dtype=np.int64),
            np.array([parameter for _, parameter, _, _ in operations], dtype=np.int64),
            np.ones((count, 1)),
            np.array([vector for _, _, vector, _ in operations]),
            np.array([centre for _, _, _, centre in operations]),
            np.zeros((count, 1, 3)),
            2,
        )

    turn = (Kind.ROTATION, 0, [0.0, 0, np.pi / 2], [0.0, 0, 0])
    move = (Kind.TRANSLATION, 1, [0.0, 0, 5], [0.0, 0, 0])
    push = (Kind.TRANSLATION, 1, [10.0, 0, 0], [0.0, 0, 0])
    grow = (Kind.SCALING, 1, [1.0, 0.5, 0], [5.0, -2, 0])

    def test_each_kind_does_what_it_says(self) -> None:
        half = np.array([0.5, 0.5])
        expected = 10 * np.array([[np.cos(np.pi / 4), np.sin(np.pi / 4), 0]])
        np.testing.assert_allclose(evaluate(self.compiled(self.turn), half), expected)
        np.testing.assert_allclose(evaluate(self.compiled(self.move), half), [[10, 0, 2.5]])
        np.testing.assert_allclose(evaluate(self.compiled(self.grow), half), [[12.5, 0.5, 0]])

    def test_operations_apply_in_order(self) -> None:
        ones = np.ones(2)
        one_way = evaluate(self.compiled(self.turn, self.push), ones)
        other_way = evaluate(self.compiled(self.push, self.turn), ones)
        np.testing.assert_allclose(one_way, [[10, 10, 0]], atol=1e-14)
        np.testing.assert_allclose(other_way, [[0, 20, 0]], atol=1e-14)

    def test_a_vertex_of_no_weight_stays_to_the_bit(self) -> None:
        compiled = self.compiled(self.turn, self.grow, self.move)
        compiled.weights[:] = 0
        compiled.rest[:] = [[0.1, 0.2, 0.7]]
        np.testing.assert_array_equal(evaluate(compiled, np.array([0.9, 1.3])), compiled.rest)

    def test_a_rotation_by_nothing_is_no_nan(self) -> None:
        still = self.compiled((Kind.ROTATION, 0, [0.0, 0, 0], [1.0, 2, 3]))
        vertices, slopes = evaluate_jacobian(still, np.ones(2))
        np.testing.assert_array_equal(vertices, still.rest)
        np.testing.assert_array_equal(slopes, 0)

    def test_turning_is_scipys_rotation_about_the_centre(self) -> None:
        generator = np.random.default_rng(5)
        count, parameters = 40, np.array([0.7, -0.4])
        rest, weights = generator.normal(0, 50, (count, 3)), generator.uniform(0, 1, (2, count))
        vectors, centres = generator.normal(0, 1, (2, 3)), generator.normal(0, 20, (2, 3))
        compiled = CompiledRig(
            np.arange(count),
            rest,
            np.full(2, Kind.ROTATION, dtype=np.int64),
            np.array([0, 1]),
            weights,
            vectors,
            centres,
            np.zeros((0, count, 3)),
            2,
        )
        expected = rest
        for vector, centre, weight, value in zip(
            vectors, centres, weights, parameters, strict=True
        ):
            turn = Rotation.from_rotvec(value * weight[:, None] * vector)
            expected = turn.apply(expected - centre) + centre
        np.testing.assert_allclose(evaluate(compiled, parameters), expected, rtol=0, atol=1e-12)

    def test_one_parameter_may_drive_several_operations(self) -> None:
        """Its slope is the sum of theirs, each carried on by what follows."""
        compiled = self.compiled(
            self.push, self.grow, (Kind.ROTATION, 1, [0.0, 0, 0.5], [1.0, 2, 3])
        )
        values = np.array([0.0, 0.6])
        vertices, slopes = evaluate_jacobian(compiled, values)
        step = np.array([0.0, 1e-6])
        change = (evaluate(compiled, values + step) - evaluate(compiled, values - step)) / 2e-6
        np.testing.assert_allclose(vertices, evaluate(compiled, values), atol=1e-12)
        np.testing.assert_allclose(slopes[:, :, 1], change, atol=1e-7)
        assert (slopes[:, :, 0] == 0).all()

    def test_it_prints_in_a_line_and_can_be_copied(self) -> None:
        compiled = self.compiled(self.turn, self.grow)
        assert repr(compiled) == "CompiledRig(2 parameters, 2 operations, 1 vertices)"
        for other in (copy.deepcopy(compiled), pickle.loads(pickle.dumps(compiled))):
            np.testing.assert_array_equal(
                evaluate(other, np.full(2, 0.3)), evaluate(compiled, np.full(2, 0.3))
            )


def test_a_face_prints_in_a_line_and_can_be_copied(rig: Rig) -> None:
    count = len(rig.mesh.vertices)
    assert repr(rig) == f"ParkeRig(10 parameters, 11 transforms, {count} vertices)"
    values = np.linspace(-0.3, 0.8, 10)
    for other in (copy.deepcopy(rig), pickle.loads(pickle.dumps(rig))):
        assert repr(other.mesh) == repr(rig.mesh)
        np.testing.assert_array_equal(other.deform(values), rig.deform(values))
        np.testing.assert_array_equal(other.bounds, rig.bounds)


class TestToParameters:
    def test_names_in_any_order_and_zero_for_the_rest(self) -> None:
        values = to_parameters({"jaw_shift": 1, "lip_rounding": 0.5}, NAMES)
        assert values.tolist() == [0, 0.5, 0, 0, 0, 0, 0, 0, 0, 1]

    def test_an_unknown_name_is_refused(self) -> None:
        with pytest.raises(DataError, match=r"no face parameter jaw_open .*jaw_rotation"):
            to_parameters({"jaw_open": 1}, NAMES)


# ---- what the built-in rig's gestures do --------------------------------------------------------


def moved(rig: Rig, **values: float) -> np.ndarray:
    """How far each vertex moves, (vertices, 3)."""
    return rig.deform(to_parameters(values, rig.parameter_names)) - rig.mesh.vertices


def at(rig: Rig, displacement: np.ndarray, point: str) -> np.ndarray:
    return np.asarray(displacement[rig.mesh.get_feature_point(point)])


def mirror_map(mesh: Mesh) -> np.ndarray:
    """Index of the mirror image of every vertex of the parts that move."""
    pairs = np.arange(len(mesh.vertices))
    for name in ("skin", "teeth_upper", "teeth_lower", "gums_lower", "tongue"):
        members = mesh.get_region(name)
        distance, index = cKDTree(mesh.vertices[members]).query(mesh.vertices[members] * [-1, 1, 1])
        assert distance.max() < 1e-4
        pairs[members] = members[index]
    # Where the lips touch, the nearest vertex may be of the other lip.
    for name in ("upper_lip", "lower_lip", "mouth_bag_upper", "mouth_bag_lower"):
        members = mesh.get_region(name)
        tree = cKDTree(mesh.vertices[members])
        pairs[members] = members[tree.query(mesh.vertices[members] * [-1, 1, 1])[1]]
    return pairs


def turned_away(rig: Rig, vertices: np.ndarray) -> np.ndarray:
    """Cosine between each outer skin triangle's direction and the one at rest."""
    mesh = rig.mesh
    skin = mesh.get_part("skin").triangles
    triangles = mesh.triangles[skin.start : skin.stop]
    inside = np.zeros(len(mesh.vertices), dtype=bool)
    for name in ("mouth_bag_upper", "mouth_bag_lower"):
        inside[mesh.get_region(name)] = True
    triangles = triangles[~inside[triangles].any(axis=1)]
    directions = []
    for shape in (mesh.vertices, vertices):
        a, b, c = (shape[triangles[:, i]] for i in range(3))
        across = np.cross(b - a, c - a)
        directions.append(across / np.linalg.norm(across, axis=1, keepdims=True))
    return np.asarray(np.sum(directions[0] * directions[1], axis=1))


class TestGestures:
    def test_names_and_order_are_the_projects(self, rig: Rig) -> None:
        assert rig.parameter_names == NAMES

    def test_the_jaw_opens(self, rig: Rig) -> None:
        change = moved(rig, jaw_rotation=1)
        assert at(rig, change, "2.3")[1] < -15
        assert at(rig, change, "2.1")[1] < -10
        assert at(rig, change, "2.1")[2] < -10
        assert np.linalg.norm(at(rig, change, "2.2")) < 0.2
        for still in ("teeth_upper", "gums_upper", "nose", "forehead", "scalp", "eye_left"):
            assert np.abs(change[rig.mesh.get_region(still)]).max() < 1e-9
        assert change[rig.mesh.get_region("teeth_lower"), 1].max() < -8
        # The corners go a part of the way.
        assert -14 < at(rig, change, "8.3")[1] < -5

    @pytest.mark.parametrize("name", NAMES)
    def test_what_is_no_part_of_speech_stays(self, rig: Rig, name: str) -> None:
        change = np.linalg.norm(moved(rig, **{name: 1}), axis=1)
        for still in ("forehead", "scalp", "eye_left", "eye_right", "brow_left", "teeth_upper"):
            assert change[rig.mesh.get_region(still)].max() < 1e-9
        assert change[rig.mesh.get_feature_point("9.3")] < 0.5
        low = rig.mesh.vertices[:, 1] < rig.mesh.vertices[:, 1].min() + 15
        assert change[low].max() < 1e-9

    def test_the_chin_goes_on_an_arc_about_the_ears(self, rig: Rig) -> None:
        ears = np.mean(
            [rig.mesh.vertices[rig.mesh.get_feature_point(p)] for p in ("10.7", "10.8")], axis=0
        )
        chin = rig.mesh.get_feature_point("2.1")
        arms = [
            np.linalg.norm(rig.deform(to_parameters({"jaw_rotation": value}, NAMES))[chin] - ears)
            for value in np.linspace(0, 1, 5)
        ]
        assert np.ptp(arms) < 0.1 * arms[0]

    @pytest.mark.parametrize("gesture", ["jaw_rotation", "jaw_thrust", "jaw_shift"])
    def test_lower_teeth_and_gums_are_rigid_with_the_jaw(self, rig: Rig, gesture: str) -> None:
        shape = rig.deform(to_parameters({gesture: 0.8}, NAMES))
        chin = rig.mesh.get_feature_point("2.1")
        for part in ("teeth_lower", "gums_lower"):
            members = rig.mesh.get_region(part)
            before = np.linalg.norm(rig.mesh.vertices[members] - rig.mesh.vertices[chin], axis=1)
            after = np.linalg.norm(shape[members] - shape[chin], axis=1)
            np.testing.assert_allclose(after, before, atol=1e-9)

    def test_the_tongue_stays_on_the_jaw(self, rig: Rig) -> None:
        tongue, teeth = rig.mesh.get_region("tongue"), rig.mesh.get_region("teeth_lower")
        shapes = [rig.deform(to_parameters({"jaw_rotation": value}, NAMES)) for value in (0.0, 1.0)]
        gaps = [shape[teeth, 2].max() - shape[tongue, 2].max() for shape in shapes]
        assert min(gaps) > 0
        heights = [shape[tongue, 1].mean() - shape[teeth, 1].mean() for shape in shapes]
        assert abs(heights[1] - heights[0]) < 8

    def test_the_lips_can_close_over_an_open_jaw(self, rig: Rig) -> None:
        lips_only = rig.compile(np.array([rig.mesh.get_feature_point(p) for p in ("2.2", "2.3")]))
        assert lips_only is not None

        def gap(lips: np.ndarray) -> float:
            values = to_parameters(
                {
                    "jaw_rotation": 0.25,
                    "lower_lip_depression": lips[0],
                    "upper_lip_raise": lips[1],
                    "lower_lip_retraction": lips[2],
                },
                NAMES,
            )
            upper, lower = evaluate(lips_only, values)
            return float(np.linalg.norm(upper - lower))

        order = [
            NAMES.index(n)
            for n in ("lower_lip_depression", "upper_lip_raise", "lower_lip_retraction")
        ]
        bounds = rig.bounds[order]
        assert gap(np.zeros(3)) > 4
        best = minimize(gap, np.array([-0.5, -0.2, 0.0]), bounds=bounds, method="Powell")
        assert best.fun < 0.5
        assert best.x[0] < 0

    def test_rounding_narrows_and_protrudes(self, rig: Rig) -> None:
        change = moved(rig, lip_rounding=1)
        left, right = at(rig, change, "8.3"), at(rig, change, "8.4")
        assert right[0] - left[0] > 10
        for point in ("8.1", "8.2", "2.2", "2.3"):
            assert 4 < at(rig, change, point)[2] < 10
            assert abs(at(rig, change, point)[0]) < 1e-9

    @pytest.mark.parametrize(
        ("name", "own", "other", "sign"),
        [
            ("left_corner_stretch", "8.3", "8.4", 1),
            ("right_corner_stretch", "8.4", "8.3", -1),
        ],
    )
    def test_a_corner_stretches_on_its_own(
        self, rig: Rig, name: str, own: str, other: str, sign: int
    ) -> None:
        change = moved(rig, **{name: 1})
        assert sign * at(rig, change, own)[0] > 5
        assert sign * rig.mesh.vertices[rig.mesh.get_feature_point(own), 0] > 0
        assert np.linalg.norm(at(rig, change, other)) < 1e-9
        assert np.linalg.norm(at(rig, change, "2.2")) < 0.5

    def test_the_jaw_shifts_to_the_speakers_left_and_thrusts_forwards(self, rig: Rig) -> None:
        assert at(rig, moved(rig, jaw_shift=1), "2.1")[0] > 5
        assert at(rig, moved(rig, jaw_thrust=1), "2.1")[2] > 4
        assert np.linalg.norm(at(rig, moved(rig, jaw_thrust=1), "2.2")) < 0.2

    @pytest.mark.parametrize(
        ("name", "axis", "sign", "moving", "still"),
        [
            ("upper_lip_raise", 1, 1, "upper_lip", "lower_lip"),
            ("upper_lip_retraction", 2, -1, "upper_lip", "lower_lip"),
            ("lower_lip_depression", 1, -1, "lower_lip", "upper_lip"),
            ("lower_lip_retraction", 2, -1, "lower_lip", "upper_lip"),
        ],
    )
    def test_a_lip_moves_without_the_other(
        self, rig: Rig, name: str, axis: int, sign: int, moving: str, still: str
    ) -> None:
        change = moved(rig, **{name: 1})
        mesh = rig.mesh
        shared = np.intersect1d(mesh.get_region(moving), mesh.get_region(still))
        quiet = np.setdiff1d(mesh.get_region(still), shared)
        assert np.abs(change[quiet]).max() < 1e-9
        whole = np.setdiff1d(mesh.get_region(moving), shared)
        # The whole lip goes, not its middle alone: out to half-way to the corners.
        inner = whole[np.abs(mesh.vertices[whole, 0]) < 12.5]
        along = sign * change[inner, axis]
        assert along.min() > 0.7 * along.max()
        assert along.max() > 4

    @pytest.mark.parametrize("name", NAMES)
    def test_left_and_right_mirror_each_other(self, rig: Rig, name: str) -> None:
        mirror = mirror_map(rig.mesh)
        twin = {"left_corner_stretch": "right_corner_stretch"}
        twin |= {b: a for a, b in twin.items()}
        one = moved(rig, **{name: 0.8})
        # The shift is the one gesture that is not symmetric: to the other side it is negative.
        other = moved(rig, **{twin.get(name, name): -0.8 if name == "jaw_shift" else 0.8})
        np.testing.assert_allclose(one[mirror] * [-1, 1, 1], other, atol=1e-5)

    def test_brows_go_with_the_skin(self, rig: Rig) -> None:
        slopes = rig.jacobian(np.zeros(10))
        skin = rig.mesh.get_region("skin")
        for brow in ("brow_left", "brow_right"):
            members = rig.mesh.get_region(brow)
            apart = np.linalg.norm(
                rig.mesh.vertices[members[:, None]] - rig.mesh.vertices[skin], axis=2
            )
            np.testing.assert_allclose(
                slopes[members], slopes[skin[apart.argmin(axis=1)]], atol=0.2
            )

    @pytest.mark.parametrize("name", NAMES)
    def test_no_skin_turns_inside_out_in_a_gesture(self, rig: Rig, name: str) -> None:
        for value in (1.0, max(-0.5, rig.bounds[NAMES.index(name), 0])):
            shape = rig.deform(to_parameters({name: value}, NAMES))
            assert turned_away(rig, shape).min() > 0

    def test_the_floor_of_the_mouth_goes_with_the_jaw_and_its_roof_stays(self, rig: Rig) -> None:
        # Else the skin of the mouth's floor comes up through the tongue when the mouth opens.
        shift = moved(rig, jaw_shift=1)
        bone = shift[rig.mesh.get_region("teeth_lower")].mean(axis=0)
        floor, roof = (shift[rig.mesh.get_region(name)] for name in ("mouth_floor", "mouth_roof"))
        np.testing.assert_allclose(floor, np.tile(bone, (len(floor), 1)), atol=0.01)
        np.testing.assert_allclose(roof, 0.0, atol=0.01)

    def test_no_skin_turns_inside_out_in_mixtures(self, rig: Rig) -> None:
        generator = np.random.default_rng(11)
        for _ in range(40):
            values = generator.uniform(-0.3, 0.7, 10)
            values[0] = abs(values[0])
            assert turned_away(rig, rig.deform(values)).min() > 0

    @pytest.mark.parametrize(
        "warp",
        [{"size": 0.9}, {"width": 1.12, "lower_face": 0.9}, {"mouth_width": 1.2, "depth": 0.9}],
    )
    def test_gestures_grow_with_the_head(self, rig: Rig, warp: dict[str, float]) -> None:
        other = load_face(mesh=reshape_head(load_built_in_head(), **warp))
        corners = [rig.mesh.get_feature_point(p) for p in ("8.3", "8.4")]
        face = [rig.mesh.get_feature_point(p) for p in ("9.15", "2.1")]
        across = np.divide(*(np.ptp(r.mesh.vertices[corners, 0]) for r in (other, rig)))
        up = np.divide(*(np.ptp(r.mesh.vertices[face, 1]) for r in (other, rig)))
        growth = [across, up, (across + up) / 2]
        for name, point in (
            ("upper_lip_raise", "2.2"),
            ("jaw_thrust", "2.1"),
            ("jaw_shift", "2.1"),
        ):
            here, there = (at(r, moved(r, **{name: 1}), point) for r in (rig, other))
            np.testing.assert_allclose(there, growth * here, atol=0.1)
            assert turned_away(other, other.deform(to_parameters({name: 1}, NAMES))).min() > 0
