"""The five parameters of the tongue."""

import dataclasses

import numpy as np
import pytest

from mocap_fit.errors import ConfigurationError
from mocap_fit.face import Rig, load_face, to_parameters
from mocap_fit.face.rig_file import read_rig_file

FIVE = (
    "tongue_tip_raise",
    "tongue_tip_advance",
    "tongue_body_raise",
    "tongue_body_advance",
    "tongue_width",
)


@pytest.fixture(scope="module")
def rig() -> Rig:
    return load_face(tongue=True)


def test_they_come_after_the_ten_which_move_the_face_as_before(rig: Rig) -> None:
    ten = load_face()
    assert rig.parameter_names == (*ten.parameter_names, *FIVE)
    values = np.linspace(-0.2, 0.8, 10)
    np.testing.assert_array_equal(rig.deform([*values, 0, 0, 0, 0, 0]), ten.deform(values))


@pytest.mark.parametrize("name", FIVE)
def test_each_moves_the_tongue_alone_and_not_its_root(rig: Rig, name: str) -> None:
    moved = rig.deform(to_parameters({name: 1.0}, rig.parameter_names)) - rig.mesh.vertices
    tongue = rig.mesh.get_region("tongue")
    amounts = np.linalg.norm(moved, axis=1)
    assert not amounts[np.setdiff1d(np.arange(len(amounts)), tongue)].any()
    assert amounts[tongue].max() > 2.0
    assert amounts[tongue[rig.mesh.vertices[tongue, 2].argmin()]] < 0.3 * amounts.max()
    # It bends: neighbours move nearly alike.
    part = rig.mesh.get_part("tongue")
    triangles = rig.mesh.triangles[part.triangles.start : part.triangles.stop]
    a, b = triangles[:, 0], triangles[:, 1]
    lengths = np.linalg.norm(rig.mesh.vertices[a] - rig.mesh.vertices[b], axis=1)
    assert (np.linalg.norm(moved[a] - moved[b], axis=1) < 1.0 * lengths + 0.2).all()


@pytest.mark.parametrize(
    ("name", "point", "direction"),
    [
        ("tongue_tip_raise", "6.1", [0, 1, 0]),
        ("tongue_tip_advance", "6.1", [0, 0, 1]),
        ("tongue_body_raise", "6.2", [0, 1, 0]),
        ("tongue_body_advance", "6.2", [0, 0, 1]),
        ("tongue_width", "6.3", [1, 0, 0]),
    ],
)
def test_each_goes_where_its_name_says(
    rig: Rig, name: str, point: str, direction: list[int]
) -> None:
    vertex = rig.mesh.get_feature_point(point)
    moved = rig.deform(to_parameters({name: 1.0}, rig.parameter_names)) - rig.mesh.vertices
    assert moved[vertex] @ direction > 0.8
    assert moved[vertex] @ direction > 0.8 * np.linalg.norm(moved[vertex])


def test_a_face_without_a_tongue_says_so_or_does_without() -> None:
    head = load_face().mesh
    skin = head.get_part("skin")
    last, triangles = skin.vertices.stop, skin.triangles.stop
    inside = {name: ids for name, ids in head.regions.items() if ids.max(initial=0) < last}
    points = {name: vertex for name, vertex in head.feature_points.items() if vertex < last}
    bare = dataclasses.replace(
        head,
        vertices=head.vertices[:last],
        triangles=head.triangles[:triangles],
        parts=(skin,),
        regions=inside,
        feature_points=points,
        colours=None,
    )
    assert len(load_face(mesh=bare, tongue=None).parameter_names) == 10
    with pytest.raises(ConfigurationError, match="part tongue"):
        load_face(mesh=bare, tongue=True)
    assert len(load_face(tongue=None).parameter_names) == 15


def test_a_rig_file_states_the_tongue() -> None:
    shipped = read_rig_file("parke")
    with pytest.raises(ConfigurationError, match="how the tongue moves"):
        shipped.model_copy(update={"tongue": None}).add_tongue()
    with pytest.raises(ConfigurationError, match=r"tongue\.parameters\.tongue_tip_raise"):
        shipped.add_tongue().add_tongue()
