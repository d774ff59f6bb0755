"""Off-screen pictures: they show what they are given, again and again."""

import os
import subprocess
import sys

import numpy as np
import pytest

from mocap_fit.errors import DataError
from mocap_fit.face.builtin import load_built_in_head
from mocap_fit.face.mesh import Mesh
from mocap_fit.render import FaceScene, render_face
from mocap_fit.render.framing import VIEW_ANGLE, frame_face

SIZE = (160, 200)


@pytest.fixture(scope="module")
def head(tmp_path_factory) -> Mesh:
    return load_built_in_head()


@pytest.fixture(scope="module")
def scene(head):
    with FaceScene(head, size=SIZE) as scene:
        yield scene


def opened(head: Mesh, by: float = 12.0) -> np.ndarray:
    """The head with its lower lip pulled down."""
    vertices = head.vertices.copy()
    vertices[head.get_region("lower_lip"), 1] -= by
    return vertices


def test_a_picture_shows_a_head_on_a_plain_ground(scene):
    image = scene.draw()
    assert image.shape == (200, 160, 3)
    assert image.dtype == np.uint8
    assert image[:150, :3].std(axis=1).max() < 3  # beside the head, above the shoulders
    middle = image[60:120, 60:100].astype(float)
    assert (middle[..., 0] - middle[..., 2]).mean() > 20  # skin is redder than blue
    assert image.std() > 10


def test_the_same_shape_gives_the_same_picture(scene, head):
    first = scene.draw()
    scene.draw(opened(head))
    np.testing.assert_array_equal(scene.draw(), first)
    np.testing.assert_array_equal(scene.draw(head.vertices.copy()), first)


def test_each_shape_gives_its_own_picture_at_once(scene, head):
    pictures = [scene.draw(opened(head, by)) for by in (0.0, 6.0, 12.0)]
    for one, other in ((0, 1), (1, 2), (0, 2)):
        assert (pictures[one] != pictures[other]).any()
    with FaceScene(head, size=SIZE) as fresh:
        np.testing.assert_array_equal(fresh.draw(opened(head, 12.0)), pictures[2])


def test_shading_follows_the_shape(head):
    """A cheek that is pushed in is lit otherwise, though its outline stays."""
    vertices = head.vertices.copy()
    for name in ("5.1", "5.2"):
        away = vertices - head.vertices[head.get_feature_point(name)]
        vertices[:, 2] -= 6 * np.exp(-((away / 10) ** 2).sum(axis=1))
    difference = np.abs(
        render_face(head, vertices, size=SIZE).astype(int) - render_face(head, size=SIZE)
    )
    assert difference.max() > 20


def test_views_differ_and_front_is_nearly_symmetric(head):
    views = {
        view: render_face(head, view=view, size=SIZE) for view in ("front", "three-quarter", "side")
    }
    ground = views["front"][:, :1].astype(int)

    def outline(image):
        return np.abs(image.astype(int) - ground).max(axis=2) > 12

    front = outline(views["front"])
    assert (front != front[:, ::-1]).mean() < 0.01
    for view in ("three-quarter", "side"):
        side = outline(views[view])
        assert (side != side[:, ::-1]).mean() > 0.05


def test_side_view_shows_the_speakers_left(head):
    """From the speaker's left, the nose points to the left of the picture."""
    image = render_face(head, view="side", size=SIZE).astype(int)
    shown = np.abs(image - image[:, :1]).max(axis=2) > 12
    columns = np.flatnonzero(shown.any(axis=0))
    rows = np.flatnonzero(shown.any(axis=1))
    nose_rows = shown[rows[0] + (rows[-1] - rows[0]) // 2 - 10 :][:20]
    assert np.flatnonzero(nose_rows.any(axis=0))[0] <= columns[0] + 1


def test_markers_are_drawn_where_they_are_and_missing_ones_are_not(scene, head):
    plain = scene.draw()
    tip = head.vertices[head.get_feature_point("9.3")]
    marked = scene.draw(markers=(tip + np.array([0, 0, 2]))[None])
    changed = np.argwhere((marked != plain).any(axis=2))
    assert len(changed) > 3
    blue = marked[tuple(changed.mean(axis=0).round().astype(int))].astype(int)
    assert blue[2] > blue[0] + 40
    np.testing.assert_array_equal(scene.draw(markers=[[np.nan] * 3]), plain)
    np.testing.assert_array_equal(scene.draw(), plain)


def test_zoom_and_centre_come_closer(head):
    lips = head.vertices[head.get_feature_point("8.1")]
    near = render_face(head, size=SIZE, zoom=5.0, centre=lips).astype(int)
    # Nothing but skin and lips is left in the picture.
    assert ((near[..., 0] - near[..., 2]) > 5).mean() > 0.95


def test_what_ends_below_fades_into_the_ground(head):
    image = render_face(head, size=SIZE, zoom=0.3).astype(int)
    ground = image[0, 0]
    rows = np.abs(image - ground).max(axis=(1, 2))
    lowest = np.flatnonzero(rows > 4)[-1]
    assert lowest < SIZE[1] - 5
    assert rows[lowest - 1] < 60
    assert rows[lowest - 30] > 100


@pytest.mark.parametrize("view", ["front", "three-quarter", "side"])
def test_the_crown_is_in_the_picture_and_zoom_brings_the_mouth_to_its_middle(head, view):
    def frame(zoom):
        camera = frame_face(head, view, zoom)
        forwards = camera.target - camera.position
        across = np.cross(forwards, [0.0, 1.0, 0.0])
        axes = [side / np.linalg.norm(side) for side in (across, np.cross(across, forwards))]

        def project(points):
            """From the middle of the picture to its edges: -1 to 1."""
            seen = points - camera.position
            depth = seen @ forwards / np.linalg.norm(forwards)
            half = depth * np.tan(np.radians(VIEW_ANGLE / 2))
            return np.stack([seen @ axis / half for axis in axes], axis=-1)

        return project

    skull = head.vertices[head.vertices[:, 1] > head.vertices[head.get_feature_point("2.1"), 1]]
    assert np.abs(frame(1.0)(skull)).max() < 0.97
    assert frame(1.0)(skull)[:, 1].max() > 0.85
    mouth = head.vertices[head.get_feature_point("2.2")]
    away = [np.linalg.norm(frame(zoom)(mouth)) for zoom in (1.0, 1.5, 2.0, 4.0, 8.0)]
    assert away == sorted(away, reverse=True)
    assert away[2] < 0.2
    assert away[3] < 0.05


def test_a_centre_is_in_the_middle_at_every_zoom(head):
    for zoom in (0.7, 3.0):
        np.testing.assert_array_equal(frame_face(head, "side", zoom, [1, 2, 3]).target, [1, 2, 3])


def test_a_mesh_without_colours_takes_those_of_its_material():
    corners = np.array([[-50.0, -50, 0], [50, -50, 0], [0, 60, 0]])
    image = render_face(Mesh(corners, np.array([[0, 1, 2]])), size=SIZE).astype(int)
    middle = image[110, 80]
    assert middle[0] > middle[1] > middle[2]


def test_jagged_edges_are_a_choice(head):
    with FaceScene(head, size=SIZE, smooth_edges=False) as quick:
        jagged = quick.draw()
    smooth = render_face(head, size=SIZE)
    assert (jagged != smooth).any()
    assert np.abs(jagged.astype(int) - smooth).mean() < 6


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"view": "back"}, "no view 'back'"),
        ({"size": (0, 100)}, "size"),
        ({"size": (100, 100_000)}, "size"),
        ({"zoom": 0.0}, "zoom"),
        ({"zoom": float("nan")}, "zoom"),
    ],
)
def test_impossible_scenes_are_refused(head, arguments, message):
    with pytest.raises(DataError, match=message):
        FaceScene(head, **arguments)


@pytest.mark.parametrize(
    ("vertices", "markers", "message"),
    [
        (np.zeros((3, 3)), None, "not the vertices"),
        (None, np.zeros((2, 2)), "markers"),
        ("nan", None, "not a finite"),
    ],
)
def test_impossible_shapes_are_refused(scene, head, vertices, markers, message):
    if isinstance(vertices, str):
        vertices = head.vertices.copy()
        vertices[7, 1] = np.nan
    with pytest.raises(DataError, match=message):
        scene.draw(vertices, markers=markers)


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="only Linux needs it")
def test_a_display_or_a_choice_of_the_user_is_left_alone():
    code = (
        "import os; from mocap_fit.render.scene import prepare_off_screen; prepare_off_screen();"
        "print(os.environ.get('VTK_DEFAULT_OPENGL_WINDOW'))"
    )

    def chosen(**changes: str) -> str:
        environment = {
            name: value
            for name, value in os.environ.items()
            if name not in ("DISPLAY", "VTK_DEFAULT_OPENGL_WINDOW")
        }
        done = subprocess.run(
            [sys.executable, "-c", code],
            env=environment | changes,
            capture_output=True,
            text=True,
            check=True,
        )
        return done.stdout.strip()

    assert chosen() == "vtkEGLRenderWindow"
    assert chosen(DISPLAY=":0") == "None"
    assert chosen(VTK_DEFAULT_OPENGL_WINDOW="vtkOSOpenGLRenderWindow") == "vtkOSOpenGLRenderWindow"
