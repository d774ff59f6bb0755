"""The packed kernel against plain numpy, on rigs and meshes of every kind."""

import dataclasses
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mocap_fit.face.mesh import Mesh
from mocap_fit.face.rig import CompiledRig, Kind, evaluate, evaluate_jacobian
from mocap_fit.fitting import Binding, Orientation
from mocap_fit.fitting.binding import compute_virtual_markers
from mocap_fit.fitting.objective import OBJECTIVES, cost

kernel = pytest.importorskip("mocap_fit.fitting.kernel", reason="needs numba")
from mocap_fit.fitting.packed_binding import SLOT, WIDTH, PackedBinding, pack, pack_frames  # noqa: E402

THRESHOLD = 4.0


class PlainRig:
    """A compiled rig as a rig."""

    def __init__(self, mesh: Mesh, compiled: CompiledRig) -> None:
        self.mesh, self._compiled = mesh, compiled
        self.parameter_names = tuple(f"p{i}" for i in range(compiled.parameter_count))
        self.bounds = np.tile([-1.0, 1.0], (compiled.parameter_count, 1))

    def deform(self, parameters: np.ndarray) -> np.ndarray:
        return evaluate(self._compiled, parameters)

    def jacobian(self, parameters: np.ndarray) -> np.ndarray:
        return evaluate_jacobian(self._compiled, parameters)[1]

    def compile(self, vertex_ids: np.ndarray) -> CompiledRig:
        return self._compiled.take(vertex_ids)


class Case(NamedTuple):
    """A binding and a frame: weights are 0 where a marker is hidden."""

    binding: Binding
    values: np.ndarray
    targets: np.ndarray
    seen: np.ndarray


def hill(rng: np.random.Generator, rows: int, columns: int) -> tuple[np.ndarray, np.ndarray]:
    """An open sheet whose vertices have rings of three to eight, and open ones at its edge."""
    i, j = np.meshgrid(np.arange(rows), np.arange(columns), indexing="ij")
    height = 3.0 * np.cos(0.7 * i) * np.cos(0.5 * j)
    vertices = np.stack([10.0 * i, 10.0 * j, height], axis=-1).reshape(-1, 3)
    vertices += rng.uniform(-2.0, 2.0, vertices.shape)
    triangles = []
    for a in range(rows - 1):
        for b in range(columns - 1):
            p, q = a * columns + b, (a + 1) * columns + b
            if rng.random() < 0.5:
                triangles += [[p, q, q + 1], [p, q + 1, p + 1]]
            else:
                triangles += [[p, q, p + 1], [q, q + 1, p + 1]]
    return vertices, np.array(triangles)


def make_case(seed: int, kinds: list[Kind], markers: int, parameters: int) -> Case:
    """A random rig with these operations on a random sheet, and markers anywhere on it."""
    rng = np.random.default_rng(seed)
    vertices, triangles = hill(rng, int(rng.integers(2, 6)), int(rng.integers(2, 6)))
    count, operations = len(vertices), len(kinds)
    weights = rng.uniform(0.0, 1.0, (operations, count)) * (rng.random((operations, count)) < 0.7)
    vectors = rng.normal(size=(operations, 3))
    fields = np.zeros((operations if Kind.FIELD in kinds else 0, count, 3))
    for o, kind in enumerate(kinds):
        if kind == Kind.ROTATION:
            # With parameters within one, angles are up to a half turn either way.
            vectors[o] *= rng.uniform(0.1, np.pi) / np.linalg.norm(vectors[o])
        elif kind == Kind.SCALING:
            vectors[o] *= 0.2 * (rng.random(3) < 0.7)
        elif kind == Kind.FIELD:
            fields[o] = rng.normal(size=(count, 3))
    compiled = CompiledRig(
        np.arange(count),
        vertices,
        np.array(kinds, dtype=np.int64),
        rng.integers(0, parameters, operations),
        weights,
        vectors,
        rng.uniform(-20.0, 20.0, (operations, 3)),
        fields,
        parameters,
    )
    # Rings as `bind_markers` makes them: the triangles round v1 in any order.
    corners, starts, rings = [], [0], []
    for triangle in triangles[rng.integers(0, len(triangles), markers)]:
        corner = np.roll(triangle, int(rng.integers(3)))
        touching = triangles[(triangles == corner[0]).any(axis=1)]
        rng.shuffle(touching)
        for one in touching:
            position = int(np.argmax(one == corner[0]))
            rings.append([one[(position + 1) % 3], one[(position + 2) % 3]])
        corners.append(corner)
        starts.append(len(rings))
    binding = Binding(
        rig=PlainRig(Mesh(vertices, triangles), compiled),
        names=tuple(f"m{i}" for i in range(markers)),
        weights=rng.uniform(0.2, 2.0, markers),
        orientation=Orientation(),
        reference_parameters=np.zeros(parameters),
        vertex_ids=np.arange(count),
        corners=np.array(corners),
        coordinates=rng.uniform(-0.5, 1.5, (markers, 3)),
        ring_starts=np.array(starts),
        rings=np.array(rings),
        compiled=compiled,
        head_names=(),
        head_positions=np.zeros((0, 3)),
        head_weights=np.zeros(0),
    )
    values = rng.uniform(-1.0, 1.0, parameters)
    targets = binding.evaluate(values)[0] + rng.normal(0.0, 3.0, (markers, 3))
    seen = rng.random(markers) < 0.8
    seen[rng.integers(markers)] = True
    targets[~seen] = np.nan
    return Case(binding, values, targets, seen)


CASES = st.builds(
    make_case,
    seed=st.integers(0, 2**32 - 1),
    kinds=st.lists(st.sampled_from(Kind), min_size=1, max_size=7),
    markers=st.integers(1, 70),
    parameters=st.integers(1, 5),
)


class Kernel:
    """The kernel with the workspace it works in."""

    def __init__(self, packed: PackedBinding) -> None:
        self._packed, rows = packed, packed.blocks * SLOT
        self._workspace, self._rows = (
            np.full(packed.workspace_size, np.nan),
            np.full((1, rows), np.nan),
        )
        self._shares = np.full((1, packed.parameters, rows), np.nan)

    def cost(
        self, values: np.ndarray, frame: np.ndarray, objective: int, threshold: float
    ) -> tuple[float, np.ndarray]:
        slope = np.full(len(values), np.nan)
        cost = kernel.evaluate(
            self._packed.plan,
            self._packed.numbers,
            self._workspace,
            values[None],
            frame,
            objective,
            threshold,
            self._rows,
            self._shares,
            slope,
        )
        return cost, slope

    def slopes(self, values: np.ndarray) -> np.ndarray:
        self.cost(values, np.zeros(0), kernel.JACOBIANS, 0.0)
        return self._shares.copy()


def in_kernel(case: Case, objective: str, values: np.ndarray) -> tuple[float, np.ndarray]:
    frame = pack_frames(case.targets[None], case.binding.weights)[0]
    code = OBJECTIVES.index(objective)
    return Kernel(pack(case.binding)).cost(values, frame, code, THRESHOLD)


def in_numpy(case: Case, objective: str, values: np.ndarray) -> tuple[float, np.ndarray]:
    b, seen = case.binding, case.seen
    positions, slopes = compute_virtual_markers(
        *evaluate_jacobian(b.compiled, values), b.corners, b.coordinates, b.ring_starts, b.rings
    )
    value, pull = cost(positions[seen] - case.targets[seen], b.weights[seen], objective, THRESHOLD)
    return value, np.tensordot(pull, slopes[seen], 2)


def assert_close(found: np.ndarray, expected: np.ndarray) -> None:
    """Equal to 1e-9 of the largest, as every entry is a sum of terms of that size."""
    scale = max(1.0, float(np.abs(expected).max(initial=0.0)))
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9 * scale)


@settings(max_examples=60, deadline=None)
@given(case=CASES, objective=st.sampled_from(OBJECTIVES))
def test_cost_and_gradient_are_those_of_numpy(case: Case, objective: str) -> None:
    value, slope = in_kernel(case, objective, case.values)
    expected, expected_slope = in_numpy(case, objective, case.values)
    assert value == pytest.approx(expected, rel=1e-9)
    assert_close(slope, expected_slope)


@settings(max_examples=60, deadline=None)
@given(case=CASES)
def test_markers_and_jacobian_are_those_of_numpy(case: Case) -> None:
    packed = pack(case.binding)
    several = np.stack([case.values, -0.5 * case.values, np.zeros_like(case.values)])
    found, slopes = kernel.evaluate_frames(packed, several, len(case.binding.names))
    for i, values in enumerate(several):
        positions, expected = case.binding.evaluate(values)
        assert_close(found[i], positions)
        assert_close(slopes[i], expected)


@settings(max_examples=40, deadline=None)
@given(case=CASES, objective=st.sampled_from(OBJECTIVES))
def test_gradient_is_what_differences_say(case: Case, objective: str) -> None:
    step = 1e-5
    _, slope = in_kernel(case, objective, case.values)
    for p in range(len(case.values)):
        ahead, behind = case.values.copy(), case.values.copy()
        ahead[p] += step
        behind[p] -= step
        difference = in_kernel(case, objective, ahead)[0] - in_kernel(case, objective, behind)[0]
        size = max(1.0, float(np.abs(slope).max()))
        assert slope[p] == pytest.approx(difference / (2 * step), rel=1e-3, abs=1e-3 * size)


@settings(max_examples=30, deadline=None)
@given(case=CASES, objective=st.sampled_from(OBJECTIVES), which=st.integers(0, 4))
def test_nan_gives_nan(case: Case, objective: str, which: int) -> None:
    """A parameter that drives anything and is NaN makes the cost NaN, and nothing worse."""
    values = case.values.copy()
    values[which % len(values)] = np.nan
    with np.errstate(invalid="ignore"):
        expected, _ = in_numpy(case, objective, values)
    value, _ = in_kernel(case, objective, values)
    assert np.isnan(value) == np.isnan(expected)
    assert np.isnan(value) == np.isin(which % len(values), case.binding.compiled.parameters)


@pytest.mark.parametrize("markers", [1, WIDTH - 1, WIDTH, WIDTH + 1, 2 * WIDTH, 70])
def test_blocks_end_where_they_should(markers: int) -> None:
    case = make_case(3, [Kind.TRANSLATION, Kind.ROTATION, Kind.SCALING, Kind.FIELD], markers, 4)
    assert pack(case.binding).blocks == -(-markers // WIDTH)
    value, slope = in_kernel(case, "distances", case.values)
    expected, expected_slope = in_numpy(case, "distances", case.values)
    assert value == pytest.approx(expected, rel=1e-12)
    assert_close(slope, expected_slope)


@pytest.mark.parametrize(
    "fans",
    [
        [[1, 2], [2, 3], [3, 1]],
        [[1, 2], [2, 3], [3, 1], [4, 5], [5, 6], [6, 4]],  # two cones that touch at their tips
        [[1, 2], [2, 3], [3, 1], [4, 5], [5, 6]],
        [[1, 2], [4, 5], [5, 6]],
        [[5, 1], [1, 2], [2, 3], [3, 4]],
        [[1, 2], [2, 3], [2, 4], [4, 5]],  # three triangles on an edge
        [[1, 2], [3, 2], [3, 4], [4, 5]],  # a triangle the wrong way round
        [[1, 3], [1, 2], [2, 4]],  # and the marker's own triangle not the first of its edge
        [[1, 2], [1, 2], [2, 1]],
    ],
)
def test_rings_of_any_mesh(fans: list[list[int]]) -> None:
    """Meshes from elsewhere have all kinds of surroundings; eq. 2 adds up all triangles."""
    case = make_case(29, [Kind.TRANSLATION, Kind.ROTATION, Kind.SCALING], 3, 3)
    rng = np.random.default_rng(1)
    vertices = rng.uniform(-10.0, 10.0, (7, 3))
    compiled = dataclasses.replace(
        case.binding.compiled,
        vertex_ids=np.arange(7),
        rest=vertices,
        weights=rng.uniform(0.0, 1.0, (3, 7)),
    )
    plain = [[1, 2], [2, 3], [3, 4], [4, 1]]
    binding = dataclasses.replace(
        case.binding,
        vertex_ids=np.arange(7),
        compiled=compiled,
        corners=np.array([[0, 1, 2]] * 3),
        ring_starts=np.cumsum([0, 4, len(fans), 4]),
        rings=np.array([*plain, *fans, *plain]),
    )
    packed = pack(binding)
    found, slopes = kernel.evaluate_frames(packed, case.values[None], 3)
    positions, expected = binding.evaluate(case.values)
    assert_close(found[0], positions)
    assert_close(slopes[0], expected)


def test_what_is_hidden_does_not_count() -> None:
    case = make_case(5, [Kind.ROTATION, Kind.TRANSLATION], 40, 3)
    shown = case._replace(targets=np.where(np.isnan(case.targets), 1e3, case.targets))
    hidden, _ = in_kernel(case, "distances", case.values)
    assert in_kernel(shown, "distances", case.values)[0] > hidden + 100
    none = case._replace(targets=np.full_like(case.targets, np.nan))
    value, slope = in_kernel(none, "distances", case.values)
    assert value == 0.0
    assert (slope == 0.0).all()


@pytest.mark.parametrize("kind", [Kind.ROTATION, Kind.SCALING])
@pytest.mark.parametrize("first", [True, False], ids=["before", "after"])
def test_order_of_operations_counts(kind: Kind, first: bool) -> None:
    """A turn or a scaling before a translation is not the same as after it."""
    order = [kind, Kind.TRANSLATION] if first else [Kind.TRANSLATION, kind]
    case = make_case(11, order, 12, 2)
    value, slope = in_kernel(case, "squares", case.values)
    expected, expected_slope = in_numpy(case, "squares", case.values)
    assert value == pytest.approx(expected, rel=1e-11)
    assert_close(slope, expected_slope)


@pytest.mark.parametrize("angle", [-np.pi, -1e-9, 0.0, 1e-9, 0.3, np.pi / 2, np.pi])
def test_angles_up_to_a_half_turn(angle: float) -> None:
    """The kernel's own sine is as good as the library's."""
    case = make_case(17, [Kind.ROTATION], 9, 1)
    turn = np.array([[0.0, 0.0, angle], [0.0, 0.0, 1.0]])[int(angle == 0.0)]
    compiled = case.binding.compiled
    compiled.vectors[0] = turn
    compiled.weights[0] = 1.0
    values = np.array([0.0 if angle == 0.0 else 1.0])
    packed = pack(case.binding)
    found, slopes = kernel.evaluate_frames(packed, values[None], 9)
    positions, expected = case.binding.evaluate(values)
    np.testing.assert_allclose(found[0], positions, atol=1e-12 * np.abs(positions).max())
    assert_close(slopes[0], expected)


def test_a_rotation_about_nothing_moves_nothing() -> None:
    """A rotation vector of no length is allowed, and drives nothing."""
    case = make_case(19, [Kind.TRANSLATION, Kind.ROTATION], 9, 2)
    case.binding.compiled.vectors[1] = 0.0
    value, slope = in_kernel(case, "squares", case.values)
    expected, expected_slope = in_numpy(case, "squares", case.values)
    assert value == pytest.approx(expected, rel=1e-9)
    assert_close(slope, expected_slope)


def test_the_room_is_used_again() -> None:
    """What an earlier frame left in the workspace does not show in a later one."""
    case = make_case(23, list(Kind), 35, 4)
    frame = pack_frames(case.targets[None], case.binding.weights)[0]
    used = Kernel(pack(case.binding))
    before = used.cost(case.values, frame, 0, 1.0)
    slopes = used.slopes(case.values)
    used.cost(np.full(4, np.nan), frame, 0, 1.0)
    used.cost(-case.values, frame, 1, 1.0)
    used.slopes(-case.values)
    after = used.cost(case.values, frame, 0, 1.0)
    assert before[0] == after[0]
    np.testing.assert_array_equal(before[1], after[1])
    np.testing.assert_array_equal(used.slopes(case.values), slopes)
