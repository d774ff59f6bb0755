"""Where points are in a picture, and machines that cannot draw."""

import ctypes
import sys

import numpy as np
import pytest

from mocap_fit.errors import MissingExtraError
from mocap_fit.face.builtin import load_built_in_head
from mocap_fit.render import FaceScene, require_off_screen

SIZE = (240, 300)


@pytest.mark.parametrize("view", ["front", "three-quarter", "side"])
def test_points_are_projected_to_where_they_are_drawn(view):
    head = load_built_in_head()
    centre = head.vertices[head.get_feature_point("9.3")] * (0, 1, 0)
    with FaceScene(head, view=view, size=SIZE, zoom=0.9, centre=centre) as scene:
        plain = scene.draw()
        tip = head.vertices[head.get_feature_point("9.3")] + np.array([0, 0, 2])
        place = scene.project(tip[None])[0]
        changed = np.argwhere((scene.draw(markers=tip[None]) != plain).any(axis=2))
        # Rows are down and columns across; a pixel's centre is half a pixel from its corner.
        # A hair elsewhere may change with the range of depths, which the ball widens.
        drawn = np.median(changed, axis=0)[::-1] + 0.5
        assert np.abs(drawn - place).max() < 1.0
        middle = scene.project(centre[None])[0]
        np.testing.assert_allclose(middle, np.array(SIZE) / 2, atol=1e-6)
        assert np.isnan(scene.project([[np.nan] * 3])).all()
        # The camera is in front of what it looks at.
        assert (scene.camera_position - centre) @ (tip - centre) > 0


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux draws through EGL")
class TestWithoutEgl:
    @pytest.fixture(autouse=True)
    def no_library(self, monkeypatch):
        def fails(name, *arguments, **options):
            raise OSError(f"{name}: cannot open shared object file")

        monkeypatch.setattr(ctypes, "CDLL", fails)
        monkeypatch.delenv("DISPLAY", raising=False)
        monkeypatch.delenv("VTK_DEFAULT_OPENGL_WINDOW", raising=False)

    def test_it_is_an_error_that_says_what_to_install(self):
        with pytest.raises(MissingExtraError, match="apt-get install libegl1"):
            require_off_screen()
        with pytest.raises(MissingExtraError, match=r"libEGL\.so\.1"):
            FaceScene(load_built_in_head())

    def test_a_display_will_do(self, monkeypatch):
        monkeypatch.setenv("DISPLAY", ":0")
        assert require_off_screen() is None

    def test_so_will_another_way_that_the_user_chose(self, monkeypatch):
        monkeypatch.setenv("VTK_DEFAULT_OPENGL_WINDOW", "vtkOSOpenGLRenderWindow")
        assert require_off_screen() is None
