"""Weights: exact where known, smooth between, along the surface."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial import Delaunay

from mocap_fit.face import Rig, load_face
from mocap_fit.face.weights import BendingEnergy, _compute_laplacian, compute_falloff


def sheet(columns: int = 21, rows: int = 11, size: float = 2.0) -> tuple[np.ndarray, np.ndarray]:
    """A flat sheet of triangles whose diagonals mirror about the middle column."""
    x, y = np.meshgrid(np.arange(columns), np.arange(rows))
    vertices = np.stack([x, y, np.zeros_like(x)], axis=2).reshape(-1, 3) * size
    vertices[:, 0] -= (columns - 1) * size / 2
    triangles = []
    for row in range(rows - 1):
        for column in range(columns - 1):
            a = row * columns + column
            b, c, d = a + 1, a + columns, a + columns + 1
            if column < (columns - 1) / 2:
                triangles += [[a, b, c], [b, d, c]]
            else:
                triangles += [[a, b, d], [a, d, c]]
    return vertices, np.array(triangles)


def interpolate(
    vertices: np.ndarray, triangles: np.ndarray, known: np.ndarray, values: np.ndarray
) -> np.ndarray:
    return BendingEnergy.from_mesh(vertices, triangles).minimise(known, values)


class TestFalloff:
    def test_one_at_the_centre_half_way_and_nothing_outside(self) -> None:
        points = np.array([[0.0, 0, 0], [5, 0, 0], [10, 0, 0], [0, 10, 0], [0, 19.9, 0]])
        weights = compute_falloff(points, np.zeros(3), np.array([10.0, 20.0, 5.0]))
        np.testing.assert_allclose(weights[:4], [1, 0.5, 0, 0.5], atol=1e-15)
        assert 0 < weights[4] < 1e-3

    def test_a_plateau_is_flat(self) -> None:
        points = np.array([[0.0, 0, 0], [2, 0, 0], [3.99, 0, 0], [4.5, 0, 0]])
        weights = compute_falloff(points, np.zeros(3), np.full(3, 10.0), plateau=0.4)
        assert weights[:3].tolist() == [1, 1, 1]
        # A smoothstep of (1 - 0.45) / (1 - 0.4) = 11/12.
        assert weights[3] == pytest.approx((11 / 12) ** 2 * (3 - 2 * 11 / 12), rel=1e-12)

    @given(
        st.lists(st.floats(-30, 30), min_size=3, max_size=3),
        st.floats(0, 0.9),
        st.floats(0.01, 0.99),
    )
    def test_it_falls_along_every_ray(
        self, direction: list[float], plateau: float, share: float
    ) -> None:
        ray = np.linspace(0, 1, 20)[:, None] * np.array(direction)
        weights = compute_falloff(
            ray, np.zeros(3), np.array([25.0, 15.0, 20.0 * share + 1]), plateau
        )
        assert weights[0] == 1
        assert (np.diff(weights) <= 1e-15).all()
        assert ((weights >= 0) & (weights <= 1)).all()


class TestLaplacian:
    def test_the_weight_of_an_edge_is_half_the_sum_of_its_cotangents(self) -> None:
        """Pinkall and Polthier (1993): two equilateral triangles on an edge, cot 60° each."""
        vertices = np.array(
            [[0.0, 0, 0], [3, 0, 0], [1.5, 1.5 * 3**0.5, 0], [1.5, -1.5 * 3**0.5, 0]]
        )
        laplacian, areas = _compute_laplacian(vertices, np.array([[0, 1, 2], [0, 3, 1]]))
        half = 0.5 / 3**0.5
        expected = -half * np.array(
            [[-4, 2, 1, 1], [2, -4, 1, 1], [1, 1, -2, 0], [1, 1, 0, -2]], dtype=float
        )
        np.testing.assert_allclose(laplacian.toarray(), expected, atol=1e-12)
        # A third of the triangles round each vertex; a triangle has √3/4 · 9 mm².
        third = 9 * 3**0.5 / 12
        np.testing.assert_allclose(areas, [2 * third, 2 * third, third, third])

    def test_flat_angles_count_at_least_0_05_and_sharp_ones_at_most_20(self) -> None:
        vertices = np.array([[0.0, 0, 0], [10, 0, 0], [5, 0.1, 0]])
        laplacian, _ = _compute_laplacian(vertices, np.array([[0, 1, 2]]))
        assert -laplacian[0, 1] == pytest.approx(0.025)
        assert -laplacian[0, 2] == pytest.approx(10)

    def test_vertices_of_no_triangle_have_the_least_area(self) -> None:
        vertices = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [9, 9, 9], [0, 4, 0]])
        _, areas = _compute_laplacian(vertices, np.array([[0, 1, 2], [1, 4, 2]]))
        assert areas[3] == areas.min() == pytest.approx(1 / 6)
        assert areas.sum() - areas[3] == pytest.approx(0.5 + 1.5)


class TestInterpolated:
    def test_a_straight_ramp_is_the_field_of_least_energy(self) -> None:
        """A linear field has no Laplacian, on any triangulation of the plane: nothing is less."""
        # Nearly equilateral triangles: away from the border, no cotangent is clipped.
        row, column = np.divmod(np.arange(9 * 13), 13)
        vertices = np.stack([column + 0.5 * (row % 2), row * 0.75**0.5, 0.0 * row], axis=1)
        vertices[:, :2] += np.random.default_rng(8).uniform(-0.1, 0.1, (len(vertices), 2))
        triangles = Delaunay(vertices[:, :2]).simplices.astype(np.int64)
        inner = (row > 1) & (row < 7) & (column > 1) & (column < 11)
        ramp = 0.5 + vertices[:, 0] / 60 + vertices[:, 1] / 90
        laplacian, _ = _compute_laplacian(vertices, triangles)
        np.testing.assert_allclose((laplacian @ ramp)[inner], 0, atol=1e-12)
        known = np.flatnonzero(~inner)
        field = interpolate(vertices, triangles, known, ramp[known])
        np.testing.assert_allclose(field, ramp, atol=1e-9)

    def test_the_energy_is_the_least_there_is(self) -> None:
        """Against a dense minimisation of Σ (Lu)² / area by least squares."""
        vertices, triangles = sheet(9, 6)
        known, values = np.array([0, 8, 30, 53]), np.array([0.3, 0.6, 0.5, 0.4])
        laplacian, areas = _compute_laplacian(vertices, triangles)
        weighted = laplacian.toarray() / np.sqrt(areas)[:, None]
        energy = BendingEnergy.from_mesh(vertices, triangles).matrix.toarray()
        np.testing.assert_allclose(energy, weighted.T @ weighted, atol=1e-12)
        free = np.setdiff1d(np.arange(len(vertices)), known)
        best, *_ = np.linalg.lstsq(weighted[:, free], -weighted[:, known] @ values, rcond=None)
        field = interpolate(vertices, triangles, known, values)
        assert 0 < best.min() < best.max() < 1
        np.testing.assert_allclose(field[free], best, atol=1e-8)

    def test_what_runs_over_is_clipped(self) -> None:
        vertices, triangles = sheet(9, 6)
        field = interpolate(vertices, triangles, np.array([0, 1, 2]), np.array([0.2, 0.6, 1.0]))
        assert field.max() == 1
        field = interpolate(vertices, triangles, np.array([0, 1, 2]), np.array([0.8, 0.4, 0.0]))
        assert field.min() == 0

    def test_it_takes_the_values_it_is_given(self, rng: np.random.Generator) -> None:
        vertices, triangles = sheet()
        known = rng.choice(len(vertices), 20, replace=False)
        values = rng.uniform(0, 1, 20)
        field = interpolate(vertices, triangles, known, values)
        np.testing.assert_array_equal(field[known], values)
        assert ((field >= 0) & (field <= 1)).all()

    def test_the_same_input_gives_the_same_bytes(self) -> None:
        vertices, triangles = sheet()
        known, values = np.array([0, 115, 230]), np.array([0.0, 1.0, 0.3])
        once, again = (interpolate(vertices, triangles, known, values) for _ in range(2))
        assert once.tobytes() == again.tobytes()

    def test_one_value_everywhere(self) -> None:
        vertices, triangles = sheet()
        known, values = np.array([0, 40, 99]), np.full(3, 0.7)
        np.testing.assert_allclose(interpolate(vertices, triangles, known, values), 0.7)

    def test_it_is_symmetric_on_a_symmetric_mesh(self) -> None:
        vertices, triangles = sheet()
        mirror = np.arange(len(vertices)).reshape(11, 21)[:, ::-1].ravel()
        known = np.array([10, 0, 20, 5 * 21 + 3, 5 * 21 + 17, 10 * 21 + 10])
        values = np.array([1.0, 0, 0, 0.6, 0.6, 0.2])
        field = interpolate(vertices, triangles, known, values)
        np.testing.assert_allclose(field, field[mirror], atol=1e-10)

    def test_it_has_no_jump_and_no_crease(self) -> None:
        vertices, triangles = sheet(41, 11, 1.0)
        columns = vertices[:, 0].round().astype(int)
        known = np.flatnonzero(np.abs(columns) >= 15)
        field = interpolate(vertices, triangles, known, (columns[known] > 0).astype(float))
        edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
        # A straight ramp would climb 1/30 an edge; a smooth one at most half as much again.
        assert np.abs(np.diff(field[edges], axis=1)).max() < 1.7 / 30
        middle = field.reshape(11, 41)[5]
        assert np.abs(np.diff(middle, 2)).max() < 0.01

    def test_values_do_not_jump_across_a_slit(self) -> None:
        """Two sheets that touch everywhere but hang together at one end only."""
        vertices, triangles = sheet(21, 3)
        upper = vertices.copy()
        lower = vertices * [1, -1, 1]
        both = np.concatenate([upper, lower])
        other = triangles[:, ::-1] + len(upper)
        # They share the corner at the left end of the slit.
        other[other == len(upper)] = 0
        field = interpolate(
            both,
            np.concatenate([triangles, other]),
            np.array([20, len(upper) + 20]),
            np.array([0.0, 1.0]),
        )
        touching = np.arange(10, 21)
        assert (field[touching + len(upper)] - field[touching]).min() > 0.2

    def test_a_piece_with_no_known_vertex_is_left_alone(self) -> None:
        vertices, triangles = sheet()
        both = np.concatenate([vertices, vertices + np.array([0, 0, 50])])
        field = interpolate(
            both,
            np.concatenate([triangles, triangles + len(vertices)]),
            np.array([3, 77]),
            np.array([1.0, 0.4]),
        )
        assert (field[len(vertices) :] == 0).all()
        assert field[: len(vertices)].min() >= 0.1

    def test_vertices_without_triangles_and_slivers_do_no_harm(self) -> None:
        vertices, triangles = sheet()
        sliver = [0, 1, len(vertices)]
        both = np.concatenate([vertices, vertices[:1] + np.array([1e-9, 1e-9, 0]), [[500.0, 0, 0]]])
        field = interpolate(
            both, np.concatenate([triangles, [sliver]]), np.array([5, 200]), np.array([1.0, 0])
        )
        assert np.isfinite(field).all()
        assert field[-1] == 0

    def test_all_known_is_all_there_is(self) -> None:
        vertices, triangles = sheet(3, 3)
        values = np.linspace(0, 1, 9)
        np.testing.assert_array_equal(
            interpolate(vertices, triangles, np.arange(9), values), values
        )


@pytest.fixture(scope="module")
def rig() -> Rig:
    return load_face()


class TestOnTheBuiltInHead:
    def test_the_seam_of_the_lips_parts_the_jaw_weight(self, rig: Rig) -> None:
        """Neighbours in space at the seam, but the lower one goes with the jaw."""
        opened = rig.jacobian(np.zeros(10))[:, 1, 0]
        mesh = rig.mesh
        for upper, lower in (("2.2", "2.3"), ("2.6", "2.8"), ("2.7", "2.9")):
            up, down = mesh.get_feature_point(upper), mesh.get_feature_point(lower)
            assert np.linalg.norm(mesh.vertices[up] - mesh.vertices[down]) < 0.5
            assert opened[down] - opened[up] < -15

    def test_the_jaw_weight_has_no_step_on_the_skin(self, rig: Rig) -> None:
        mesh = rig.mesh
        skin = mesh.get_part("skin").triangles
        triangles = mesh.triangles[skin.start : skin.stop]
        edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
        # What the shift of the jaw moves is the jaw's weight itself, times 8 mm.
        share = rig.jacobian(np.zeros(10))[:, 0, 9] / 8.0
        ends = mesh.vertices[edges]
        away = np.linalg.norm(ends.mean(axis=1) - mesh.vertices[mesh.feature_points["8.3"]], axis=1)
        right = np.linalg.norm(
            ends.mean(axis=1) - mesh.vertices[mesh.feature_points["8.4"]], axis=1
        )
        length = np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1)
        slope = np.abs(np.diff(share[edges], axis=1)[:, 0]) / np.maximum(length, 0.5)
        # The corners of the mouth are where 0 and 1 meet; elsewhere the skin stretches gently.
        assert slope[(away > 12) & (right > 12)].max() < 0.12
