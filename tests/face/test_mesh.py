"""Meshes: what is refused, and what they answer."""

import copy
import pickle

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from mocap_fit.errors import ConfigurationError
from mocap_fit.face import Material, Mesh, Part
from mocap_fit.face.builtin import load_built_in_head
from mocap_fit.face.mesh import list_edges

SQUARE = np.array([[0.0, 0, 0], [10, 0, 0], [10, 10, 0], [0, 10, 0]])
TRIANGLES = np.array([[0, 1, 2], [0, 2, 3]])


def test_a_mesh_without_parts_is_all_skin() -> None:
    mesh = Mesh(SQUARE, TRIANGLES)
    assert [part.name for part in mesh.parts] == ["skin"]
    assert mesh.get_region("skin").tolist() == [0, 1, 2, 3]
    # Matt skin colour, for meshes that state no material.
    assert mesh.parts[0].material == Material((0.8, 0.7, 0.6), 0.1, 10.0)


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


def test_normals_of_a_sphere_are_its_radii() -> None:
    around = np.random.default_rng(4).normal(size=(4000, 3))
    around /= np.linalg.norm(around, axis=1, keepdims=True)
    triangles = ConvexHull(around).simplices
    corners = around[triangles]
    inwards = np.einsum(
        "ij,ij->i", np.cross(*np.diff(corners, axis=1).swapaxes(0, 1)), corners[:, 0]
    )
    triangles[inwards < 0] = triangles[inwards < 0][:, ::-1]
    normals = Mesh(70 * around, triangles).compute_normals()
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1, rtol=1e-12)
    assert np.sum(normals * around, axis=1).min() > np.cos(np.radians(6))


def test_normals_are_weighted_by_area() -> None:
    """A floor of 8 mm² and a wall of 1.5 mm² that share an edge: cross products 16 and 3."""
    vertices = np.array([[0.0, 0, 0], [2, 0, 0], [0, 8, 0], [0, 0, 1.5], [9, 9, 9]])
    mesh = Mesh(vertices, np.array([[0, 1, 2], [0, 3, 1]]))
    normals = mesh.compute_normals()
    np.testing.assert_allclose(normals[0], np.array([0, 3, 16]) / np.hypot(3, 16))
    np.testing.assert_allclose(normals[2], [0, 0, 1])
    np.testing.assert_allclose(normals[3], [0, 1, 0])
    assert normals[4].tolist() == [0, 0, 0]


def test_edges_are_listed_once() -> None:
    assert list_edges(TRIANGLES).tolist() == [[0, 1], [0, 2], [0, 3], [1, 2], [2, 3]]


def test_a_mesh_is_printed_in_two_lines() -> None:
    assert repr(Mesh(SQUARE, TRIANGLES, regions={"lip": np.array([1])})) == (
        "Mesh(4 vertices, 2 triangles, 1 regions, 0 feature points;\n     parts skin)"
    )
    lines = repr(load_built_in_head()).splitlines()
    assert len(lines) == 2
    assert max(map(len, lines)) <= 100
    assert lines[1].endswith("…)")


@pytest.mark.parametrize(
    "duplicate", [copy.copy, copy.deepcopy, lambda m: pickle.loads(pickle.dumps(m))]
)
def test_copies_are_equal_and_read_only(duplicate) -> None:
    mesh = Mesh(
        SQUARE,
        TRIANGLES,
        (Part("skin", range(4), range(2), Material((0.1, 0.2, 0.3), 0.4, 5.0)),),
        {"lip": np.array([1, 2])},
        {"8.1": 3},
        np.full((4, 3), 0.5),
    )
    other = duplicate(mesh)
    for name in ("vertices", "triangles", "colours"):
        np.testing.assert_array_equal(getattr(other, name), getattr(mesh, name))
        assert not getattr(other, name).flags.writeable
    assert other.parts == mesh.parts
    assert other.feature_points == {"8.1": 3}
    assert other.get_region("lip").tolist() == [1, 2]


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
        ({"vertices": SQUARE[:2], "triangles": np.array([[0, 1, 1]])}, "no usable vertices"),
        ({"vertices": SQUARE[0], "triangles": np.array([[0, 1, 1]])}, "no usable vertices"),
        ({"vertices": SQUARE[:, :2]}, "no usable vertices"),
        ({"vertices": np.where(SQUARE == 10, np.nan, SQUARE)}, "vertex 1 .* not finite"),
        ({"triangles": np.zeros((0, 3), dtype=int)}, "no usable triangles"),
        ({"triangles": np.array([[0, 1, 2, 3]])}, "no usable triangles"),
        ({"triangles": np.array([0, 1, 2])}, "no usable triangles"),
        ({"triangles": np.array([[0, 1, 4]])}, "triangle 0 .*found 0, 1, 4, expected 0 to 3"),
        ({"triangles": np.array([[0, 1, 2], [0, -1, 2]])}, "triangle 1"),
        ({"parts": (Part("skin", range(1, 4), range(2)),)}, "'skin' .* vertices"),
        ({"parts": (Part("skin", range(4), range(1)),)}, "do not cover the triangles"),
        (
            {"parts": (Part("skin", range(3), range(2)),)},
            "do not cover the vertices .*found 3, exp",
        ),
        ({"regions": {"lip": np.array([4])}}, "region 'lip'"),
        ({"regions": {"lip": np.array([-1, 2])}}, "region 'lip'"),
        ({"feature_points": {"8.1": 4}}, "feature point 8.1"),
        ({"feature_points": {"8.1": -1}}, "feature point 8.1"),
        ({"colours": np.zeros((3, 3))}, "colours"),
    ],
)
def test_contradictions_are_refused(arguments: dict[str, object], message: str) -> None:
    whole = {"vertices": SQUARE, "triangles": TRIANGLES} | arguments
    with pytest.raises(ConfigurationError, match=message):
        Mesh(**whole)  # type: ignore[arg-type]


def test_what_is_at_the_edge_is_taken() -> None:
    """Three vertices, one triangle, the first and the last vertex in a region, a region of none."""
    mesh = Mesh(SQUARE[:3], TRIANGLES[:1], regions={"ends": np.array([0, 2]), "none": np.array([])})
    assert mesh.get_region("ends").tolist() == [0, 2]
    assert mesh.get_region("none").size == 0
    assert Mesh(SQUARE, TRIANGLES, feature_points={"2.1": 0}).get_feature_point("2.1") == 0


def test_what_is_not_there_is_named_with_what_is() -> None:
    mesh = Mesh(SQUARE, TRIANGLES, regions={"lip": np.array([1])}, feature_points={"8.1": 1})
    with pytest.raises(ConfigurationError, match=r"no part 'tongue' .*skin"):
        mesh.get_part("tongue")
    with pytest.raises(ConfigurationError, match=r"no region 'chin' .*lip, skin"):
        mesh.get_region("chin")
    with pytest.raises(ConfigurationError, match=r"no feature point 8\.2 .*8\.1"):
        mesh.get_feature_point("8.2")
