"""Light at the vertices: it follows the shape, the view and the opening of the mouth."""

import numpy as np
import pytest

from mocap_fit.face import load_face
from mocap_fit.face.mesh import Material, Mesh, Part
from mocap_fit.face.rig import to_parameters
from mocap_fit.render.lighting import Lighting
from mocap_fit.render.scene import _is_closed, _reduce_by_half, list_outside_triangles

CAMERA = np.array([0.0, 0.0, 900.0])


@pytest.fixture(scope="module")
def rig():
    return load_face()


@pytest.fixture(scope="module")
def lighting(rig):
    return Lighting(rig.mesh)


def ball(specular: float = 0.0) -> Mesh:
    import pyvista

    sphere = pyvista.Sphere(radius=50, theta_resolution=32, phi_resolution=24)
    look = Material((0.6, 0.6, 0.6), specular=specular, specular_power=60)
    part = Part("ball", range(sphere.n_points), range(sphere.n_cells), look)
    return Mesh(sphere.points, sphere.regular_faces, (part,))


def test_a_ball_is_bright_above_and_towards_the_key_light():
    mesh = ball()
    brightness = Lighting(mesh).compute_colours(mesh.vertices, CAMERA).astype(float).mean(axis=1)

    def towards(*direction: float) -> float:
        return float(brightness[(mesh.vertices @ np.array(direction)).argmax()])

    assert towards(0.45, 0.6, 0.8) > towards(-0.45, 0.6, 0.8) > towards(-0.45, -0.9, 0.2)
    assert towards(0, 1, 0) > towards(0, -1, 0)
    assert brightness.min() > 20


def test_the_same_shape_has_the_same_light_wherever_it_is(rig, lighting):
    here = lighting.compute_colours(rig.mesh.vertices, CAMERA)
    away = np.array([30.0, -20.0, 10.0])
    moved = lighting.compute_colours(rig.mesh.vertices + away, CAMERA + away)
    assert np.abs(here.astype(int) - moved).max() <= 1


def test_highlights_move_with_the_camera_and_the_rest_does_not():
    mesh, shiny = ball(), Lighting(ball(specular=0.8))
    aside = np.array([700.0, 0.0, 500.0])
    front, side = (shiny.compute_colours(mesh.vertices, c).astype(int) for c in (CAMERA, aside))
    assert np.abs(front - side).max() > 40
    dull = Lighting(mesh)
    plain = dull.compute_colours(mesh.vertices, CAMERA).astype(int)
    assert (front >= plain).all()
    np.testing.assert_array_equal(plain, dull.compute_colours(mesh.vertices, aside))


def test_light_comes_into_the_mouth_as_it_opens(rig, lighting):
    names = rig.parameter_names
    seen = {}
    for opening in (0.0, 0.2, 0.9):
        vertices = rig.deform(to_parameters({"jaw_rotation": opening}, names))
        colours = lighting.compute_colours(vertices, CAMERA).astype(float).mean(axis=1)
        seen[opening] = [
            colours[rig.mesh.get_region(part)].mean()
            for part in ("tongue", "mouth_roof", "teeth_upper")
        ]
    assert seen[0.0] < seen[0.2] < seen[0.9]
    # Behind closed lips it is dark; a little opening is enough to read the teeth.
    assert max(seen[0.0]) < 70
    teeth = rig.mesh.get_region("teeth_upper")
    vertices = rig.deform(to_parameters({"jaw_rotation": 0.2}, names))
    brightness = lighting.compute_colours(vertices, CAMERA)[teeth].mean(axis=1)
    assert 120 < np.quantile(brightness, 0.98) < 220


def test_what_the_lips_hide_is_dark_and_what_is_before_them_is_not(rig, lighting):
    """Light on teeth falls off behind the upper lip, towards the cheeks, and with depth."""
    light = lighting._mouth.compute(
        rig.deform(to_parameters({"jaw_rotation": 0.5}, rig.parameter_names))
    )
    assert ((light > 0) & (light <= 1)).all()
    outside = np.setdiff1d(rig.mesh.get_region("skin"), lighting._mouth._inside)
    assert (light[outside] == 1).all()
    teeth = rig.mesh.get_region("teeth_upper")
    x, y, z = rig.mesh.vertices[teeth].T
    brightness = light[teeth].mean(axis=1)
    incisors = (np.abs(x) < 8) & (z > z.max() - 2)
    assert brightness[incisors & (y < 0)].min() > brightness[incisors & (y > 5)].max()
    assert brightness[incisors & (y < 0)].mean() > 2 * brightness[z < z.max() - 30].mean()


def test_a_mesh_without_names_is_lit_all_the_same():
    corners = np.array([[-50.0, -50, 0], [50, -50, 0], [0, 60, 0]])
    colours = Lighting(Mesh(corners, np.array([[0, 1, 2]]))).compute_colours(corners, CAMERA)
    assert colours.min() > 60


def test_only_what_is_closed_with_its_outside_out_loses_its_back(rig):
    mesh = ball()
    assert _is_closed(mesh.vertices, mesh.triangles)
    assert not _is_closed(mesh.vertices, mesh.triangles[:, ::-1])
    half = mesh.triangles[: len(mesh.triangles) // 2]
    assert not _is_closed(mesh.vertices, half[:, ::-1])
    assert list_outside_triangles(mesh)[1] == len(list_outside_triangles(mesh)[0])
    skin = rig.mesh.get_part("skin").triangles
    assert _is_closed(rig.mesh.vertices, rig.mesh.triangles[skin.start : skin.stop])
    lashes = rig.mesh.get_part("lashes_left").triangles
    assert not _is_closed(rig.mesh.vertices, rig.mesh.triangles[lashes.start : lashes.stop])


def test_reduce_by_half_is_the_mean_of_four(rng):
    pixels = rng.integers(0, 256, (20, 30, 4), dtype=np.uint8)
    packed = np.ascontiguousarray(pixels).view(np.uint32).reshape(20, 30)
    smaller = np.ascontiguousarray(_reduce_by_half(packed)).view(np.uint8).reshape(10, 15, 4)
    mean = pixels.reshape(10, 2, 15, 2, 4).mean(axis=(1, 3))
    assert np.abs(smaller - mean).max() <= 1.0
    assert abs((smaller - mean).mean()) < 0.1
    np.testing.assert_array_equal(
        _reduce_by_half(np.full((4, 4), 0xFF804020, np.uint32)), 0xFF804020
    )
