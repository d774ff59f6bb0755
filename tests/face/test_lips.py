"""How far the lips are apart."""

import numpy as np
import pytest

from mocap_fit.errors import ConfigurationError, DataError
from mocap_fit.face import Mesh, compute_lip_gap


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
