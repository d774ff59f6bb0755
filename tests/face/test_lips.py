"""How far the lips are apart."""

import numpy as np
import pytest

from mocap_fit.errors import ConfigurationError, DataError
from mocap_fit.face import Mesh, compute_lip_gap, load_face
from mocap_fit.face.lips import (
    compute_lip_openings,
    compute_teeth_distance,
    find_lip_line,
    has_lip_line,
)


class Lips:
    """Two lips: the upper one goes up by the first parameter, the lower one down by the second."""

    parameter_names = ("up", "down")
    bounds = np.array([[-1.0, 1.0], [-1.0, 1.0]])

    def __init__(self, **points: int) -> None:
        rest = np.array([[0.0, 1.5, 90], [0.0, 1.25, 88], [20.0, 0, 80]])
        points = points or {"2.2": 0, "2.3": 1}
        self.mesh = Mesh(rest, np.array([[0, 1, 2]]), feature_points=points)

    def deform(self, parameters: np.ndarray) -> np.ndarray:
        up, down = parameters
        return np.add(self.mesh.vertices, [[9.0, 3 * up, 5], [0, -2 * down, 7], [0, 50, 0]])

    def jacobian(self, parameters: np.ndarray) -> np.ndarray:
        raise NotImplementedError

    def compile(self, vertex_ids: np.ndarray) -> None:
        return None


def test_the_gap_is_along_y_and_negative_where_the_lips_press() -> None:
    values = [[0, 0], [1, 0], [0, 1], [-0.5, 0.25], [np.nan, 0], [0, np.inf]]
    gaps = compute_lip_gap(Lips(), values)
    np.testing.assert_allclose(gaps, [0.25, 3.25, 2.25, -0.75, np.nan, np.nan])


def test_wrong_shapes_and_meshes_are_refused() -> None:
    for values in (np.zeros(2), np.zeros((4, 3)), np.zeros((1, 4, 2))):
        with pytest.raises(DataError, match=r"\(frames, 2\): up, down"):
            compute_lip_gap(Lips(), values)
    with pytest.raises(ConfigurationError, match=r"2\.3"):
        compute_lip_gap(Lips(**{"2.2": 0}), np.zeros((1, 2)))


@pytest.fixture(scope="module")
def head():
    return load_face()


class TestAlongTheLine:
    def test_it_goes_from_corner_to_corner_and_passes_the_middle(self, head) -> None:
        line = find_lip_line(head.mesh)
        np.testing.assert_allclose(line.weights.sum(axis=1), 0, atol=1e-12)
        x = np.abs(line.weights) @ head.mesh.vertices[line.vertices, 0] / 2
        corners = [head.mesh.vertices[head.mesh.get_feature_point(p), 0] for p in ("2.5", "2.4")]
        np.testing.assert_allclose(x[[0, -1]], corners, atol=0.5)
        assert (np.diff(x) > 0).all()

    def test_its_middle_is_the_gap_and_its_ends_meet(self, head) -> None:
        rng = np.random.default_rng(1)
        values = rng.uniform(-0.2, 0.5, (20, len(head.parameter_names)))
        openings = compute_lip_openings(head, values)
        np.testing.assert_allclose(openings[:, 20], compute_lip_gap(head, values), atol=1e-9)
        np.testing.assert_allclose(openings[:, [0, -1]], 0.0, atol=0.3)

    def test_lips_that_meet_in_the_middle_may_be_open_beside_it(self, head) -> None:
        values = np.zeros((1, len(head.parameter_names)))
        for name, value in (("jaw_rotation", 0.12), ("lower_lip_depression", -0.6)):
            values[0, head.parameter_names.index(name)] = value
        (gap,) = compute_lip_gap(head, values)
        openings = compute_lip_openings(head, values)[0]
        assert gap < 0 < openings.max()
        assert abs(np.argmax(openings) - 20) > 10

    def test_it_follows_feature_points_where_there_are_no_regions(self) -> None:
        lips = Lips()
        (openings,) = compute_lip_openings(lips, [[1.0, 0.5]])
        np.testing.assert_allclose(openings, [0.25 + 3.0 + 1.0])
        rest = [[-20, 0, 9], [0, 2, 9], [0, -1, 9], [10, 1, 9], [10, -1, 9], [20, 0, 9]]
        points = {"2.5": 0, "2.2": 1, "2.3": 2, "2.6": 3, "2.8": 4, "2.4": 5}
        lips.mesh = Mesh(np.array(rest, float), np.array([[0, 1, 2]]), feature_points=points)
        lips.deform = lambda parameters: lips.mesh.vertices
        (openings,) = compute_lip_openings(lips, [[0.0, 0.0]])
        x = np.linspace(-20, 20, 41)
        upper = np.interp(x, [-20, 0, 10, 20], [0, 2, 1, 0])
        lower = np.interp(x, [-20, 0, 10, 20], [0, -1, -1, 0])
        np.testing.assert_allclose(openings, upper - lower)

    def test_a_face_that_does_not_say_where_its_lips_are_has_none(self, head) -> None:
        assert has_lip_line(head.mesh)
        assert has_lip_line(Lips().mesh)
        without = Lips(**{"2.2": 0}).mesh
        assert not has_lip_line(without)
        with pytest.raises(ConfigurationError, match=r"2\.3"):
            find_lip_line(without)

    def test_missing_values_are_missing(self, head) -> None:
        values = np.zeros((3, len(head.parameter_names)))
        values[1, 0] = np.nan
        assert np.isnan(compute_lip_openings(head, values)).all(axis=1).tolist() == [
            False,
            True,
            False,
        ]


def test_the_lower_lip_comes_to_the_teeth(head) -> None:
    names = head.parameter_names
    values = np.zeros((3, len(names)))
    values[1:, names.index("jaw_rotation")] = 0.11
    values[2, names.index("lower_lip_retraction")] = 0.6
    values[2, names.index("lower_lip_depression")] = -0.2
    rest, opened, labiodental = compute_teeth_distance(head, values)
    assert labiodental < 2.0 < min(rest, opened)
    assert np.isnan(compute_teeth_distance(Lips(), [[0.0, 0.0]])).all()
