"""Meshes: what is refused, and what they answer."""

import numpy as np
import pytest

from mocap_fit.errors import ConfigurationError
from mocap_fit.face import Mesh, Part

SQUARE = np.array([[0.0, 0, 0], [10, 0, 0], [10, 10, 0], [0, 10, 0]])
TRIANGLES = np.array([[0, 1, 2], [0, 2, 3]])


def test_a_mesh_without_parts_is_all_skin() -> None:
    mesh = Mesh(SQUARE, TRIANGLES)
    assert [part.name for part in mesh.parts] == ["skin"]
    assert mesh.get_region("skin").tolist() == [0, 1, 2, 3]


def test_regions_are_sorted_and_parts_count_as_regions() -> None:
    parts = (Part("skin", range(3), range(1)), Part("tongue", range(3, 6), range(1, 2)))
    mesh = Mesh(
        np.concatenate([SQUARE[:3], SQUARE[:3] + np.array([0, 0, 5])]),
        np.array([[0, 1, 2], [3, 4, 5]]),
        parts,
        {"edge": np.array([2, 0, 2])},
    )
    assert mesh.get_region("edge").tolist() == [0, 2]
    assert mesh.get_region("tongue").tolist() == [3, 4, 5]
    assert mesh.has_region("tongue")
    assert not mesh.has_region("teeth")
    assert mesh.get_part("tongue").triangles == range(1, 2)


def test_normals_point_outwards_and_follow_the_shape() -> None:
    mesh = Mesh(SQUARE, TRIANGLES)
    np.testing.assert_allclose(mesh.compute_normals(), np.tile([0.0, 0, 1], (4, 1)))
    turned = SQUARE[:, [2, 0, 1]]
    np.testing.assert_allclose(mesh.compute_normals(turned), np.tile([1.0, 0, 0], (4, 1)))
    np.testing.assert_array_equal(mesh.replace_vertices(turned).vertices, turned)


def test_the_arrays_cannot_be_written_to_and_are_copies() -> None:
    vertices = SQUARE.copy()
    mesh = Mesh(vertices, TRIANGLES)
    vertices[0] = 99
    assert mesh.vertices[0, 0] == 0
    with pytest.raises(ValueError, match="read-only"):
        mesh.vertices[0] = 1


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"vertices": SQUARE[:2]}, "no usable vertices"),
        ({"vertices": SQUARE[:, :2]}, "no usable vertices"),
        ({"vertices": np.where(SQUARE == 10, np.nan, SQUARE)}, "vertex 1 .* not finite"),
        ({"triangles": np.zeros((0, 3), dtype=int)}, "no usable triangles"),
        ({"triangles": np.array([[0, 1, 4]])}, "triangle 0 .*found \\[0, 1, 4\\]"),
        ({"triangles": np.array([[0, 1, 2], [0, -1, 2]])}, "triangle 1"),
        ({"parts": (Part("skin", range(1, 4), range(2)),)}, "'skin' .* vertices"),
        ({"parts": (Part("skin", range(4), range(1)),)}, "do not cover the triangles"),
        ({"regions": {"lip": np.array([7])}}, "region 'lip'"),
        ({"feature_points": {"8.1": 4}}, "feature point 8.1"),
        ({"feature_points": {"8.1": -1}}, "feature point 8.1"),
        ({"colours": np.zeros((3, 3))}, "colours"),
    ],
)
def test_contradictions_are_refused(arguments: dict[str, object], message: str) -> None:
    whole = {"vertices": SQUARE, "triangles": TRIANGLES} | arguments
    with pytest.raises(ConfigurationError, match=message):
        Mesh(**whole)  # type: ignore[arg-type]


def test_what_is_not_there_is_named_with_what_is() -> None:
    mesh = Mesh(SQUARE, TRIANGLES, regions={"lip": np.array([1])}, feature_points={"8.1": 1})
    with pytest.raises(ConfigurationError, match=r"no part 'tongue' .*skin"):
        mesh.get_part("tongue")
    with pytest.raises(ConfigurationError, match=r"no region 'chin' .*lip, skin"):
        mesh.get_region("chin")
    with pytest.raises(ConfigurationError, match=r"no feature point 8\.2 .*8\.1"):
        mesh.get_feature_point("8.2")
