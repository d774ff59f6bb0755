"""Cameras: projection and its inverse, comparison, printing, and files of three programs."""

import copy
import dataclasses
import pickle
import re

import numpy as np
import pytest
import tomli_w
from hypothesis import given
from hypothesis import strategies as st

from mocap_fit.errors import ConfigurationError, DataError, FileFormatError
from mocap_fit.stereo import Camera, Cameras, read_cameras, write_cameras

MATRIX = np.array([[800.0, 0, 320], [0, 801, 240], [0, 0, 1]])


def simple_camera(**changes) -> Camera:
    return Camera(**{"name": "left", "size": (640, 480), "matrix": MATRIX} | changes)


def test_a_point_on_the_axis_is_at_the_principal_point():
    camera = simple_camera(translation=[0, 0, 1000.0], distortion=[-0.3, 0.1])
    assert camera.project([0, 0, 0]) == pytest.approx([320, 240])
    # Half a metre to the side at one metre: k1 and k2 by hand.
    radius = 0.5
    expected = 320 + 800 * radius * (1 - 0.3 * radius**2 + 0.1 * radius**4)
    assert camera.project([500, 0, 0])[0] == pytest.approx(expected)


def test_what_is_missing_or_behind_is_nan(arrange_cameras):
    pixels = arrange_cameras().project([[0, 0, 0], [0, np.nan, 0], [0, 0, -5000]])
    assert pixels.shape == (2, 3, 2)
    assert np.isfinite(pixels[:, 0]).all()
    assert np.isnan(pixels[:, 1:]).all()
    assert simple_camera().project(np.zeros((0, 4, 3))).shape == (0, 4, 2)
    assert simple_camera().undistort(np.zeros((0, 2))).shape == (0, 2)


@given(st.floats(-0.3, 0.3), st.floats(-0.05, 0.1), st.floats(-0.3, 0.3), st.floats(-0.25, 0.25))
def test_undistorting_undoes_the_lens(k1, k2, x, y):
    camera = simple_camera(distortion=[k1, k2, 1e-3, -1e-3, 0])
    pixels = camera.project([x, y, 1.0])
    assert camera.undistort(pixels) == pytest.approx([x, y], abs=1e-7)


def test_nothing_is_seen_where_the_lens_sees_nothing():
    # Its largest radius is 0.577 * (1 - 1/3) = 0.385, or 308 pixels from the centre.
    camera = simple_camera(distortion=[-1.0])
    ideal = camera.undistort([[320 + 290, 240], [320 + 400, 240], [np.nan, 3]])
    assert np.isfinite(ideal[0]).all()
    assert np.isnan(ideal[1:]).all()


def test_derivatives_are_those_of_differences(arrange_cameras, rng):
    camera = arrange_cameras()[0]
    points = rng.uniform(-80, 80, (5, 3))
    _, by_points, by_numbers = camera.differentiate(points)
    for axis, step in enumerate(1e-3 * np.eye(3)):
        change = camera.project(points + step) - camera.project(points - step)
        assert by_points[..., axis] == pytest.approx(change / 2e-3, abs=1e-6)
    more, less = (
        dataclasses.replace(camera, distortion=camera.distortion + np.eye(5)[0] * step)
        for step in (1e-4, -1e-4)
    )
    change = more.project(points) - less.project(points)
    assert by_numbers[..., 10] == pytest.approx(change / 2e-4, rel=1e-6, abs=1e-9)


def test_cameras_are_compared_printed_and_copied(arrange_cameras):
    cameras = arrange_cameras()
    for other in (copy.deepcopy(cameras), pickle.loads(pickle.dumps(cameras)), arrange_cameras()):
        assert other == cameras
        assert hash(other) == hash(cameras)
        with pytest.raises(ValueError, match="read-only"):
            other[0].matrix[0, 0] = 1
    assert cameras[0] != cameras[1]
    assert cameras != arrange_cameras(baseline=601.0)
    assert cameras["cam_1"] is cameras[1]
    assert repr(cameras).count("\n") == 1
    assert "640 x 480 pixels, f 1700.0, 1703.4" in repr(cameras)
    assert "at -300.0, 0.0, -953.9 mm" in repr(cameras)
    with pytest.raises(DataError, match=r"no such camera.*found right.*cam_0, cam_1"):
        cameras["right"]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"size": (0, 480)}, "size of camera left is impossible"),
        ({"size": (640.5, 480)}, "size of camera left is impossible"),
        ({"matrix": np.eye(2)}, "matrix of camera left has the wrong shape"),
        ({"matrix": -MATRIX}, "matrix of camera left is not that of a camera"),
        ({"matrix": MATRIX + np.eye(3)[[1, 0, 2]]}, "is not that of a camera"),
        ({"rotation": np.eye(3)}, "rotation of camera left has the wrong shape"),
        ({"translation": [0, np.nan, 0]}, "translation of camera left has a number that is not"),
        ({"translation": "near"}, "translation of camera left is not made of numbers"),
        ({"distortion": np.zeros(6)}, "distortion of camera left has 6 coefficients"),
    ],
)
def test_impossible_cameras_are_refused(change, message):
    with pytest.raises(DataError, match=message):
        simple_camera(**change)


def test_there_is_a_camera_and_each_has_its_name():
    with pytest.raises(DataError, match="there is no camera"):
        Cameras(())
    with pytest.raises(DataError, match=r"two cameras have one name.*found left"):
        Cameras((simple_camera(), simple_camera()))


@pytest.mark.parametrize("layout", ["anipose", "caliscope", "pose2sim"])
def test_files_keep_all_numbers(layout, arrange_cameras, tmp_path):
    cameras = arrange_cameras(3)
    path = tmp_path / "cameras.toml"
    write_cameras(path, cameras, layout)
    back = read_cameras(path, unit="m" if layout == "pose2sim" else None)
    assert back.names == cameras.names
    for one, other in zip(back, cameras, strict=True):
        assert np.allclose(one.rotation, other.rotation, rtol=0, atol=1e-14)
        assert np.allclose(one.translation, other.translation, rtol=1e-14, atol=0)
    if layout == "anipose":
        assert back == cameras
    if layout == "pose2sim":
        with pytest.raises(ConfigurationError, match=r'0.6\d* mm apart.*unit="m"'):
            read_cameras(path)


def test_aniposelibs_file_is_read(tmp_path):
    path = tmp_path / "calibration.toml"
    path.write_text(
        '[cam_0]\nname = "A"\nsize = [ 640, 480,]\n'
        "matrix = [ [ 800.0, 0.0, 320.0,], [ 0.0, 800.0, 240.0,], [ 0.0, 0.0, 1.0,],]\n"
        "distortions = [ -0.1, 0.0, 0.0, 0.0, 0.0,]\nrotation = [ 0.0, 0.1, 0.0,]\n"
        "translation = [ 10.0, 0.0, 1000.0,]\n\n[metadata]\nadjusted = true\nerror = 0.2\n"
    )
    (camera,) = read_cameras(path)
    assert (camera.name, camera.size) == ("A", (640, 480))
    assert camera.translation.tolist() == [10, 0, 1000]


def write_changed(path, **changes) -> None:
    table = {
        "size": [640, 480],
        "matrix": MATRIX.tolist(),
        "distortions": [0.0] * 5,
        "rotation": [0.0] * 3,
        "translation": [0.0] * 3,
    } | changes
    content = {"cam_0": {key: value for key, value in table.items() if value is not None}}
    path.write_text(tomli_w.dumps(content))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"matrix": None}, r"camera cam_0 is wrong at matrix: this is missing"),
        ({"size": [640]}, r"camera cam_0 is wrong at size"),
        ({"rotation": [0.0, 1.0]}, r"camera cam_0 is wrong at rotation"),
        ({"rotation": [[1.0, 0, 0], [0, 1, 0], [0, 0, -1]]}, r"rotation of camera cam_0 is none"),
        ({"translation": [0.0, 0.0, float("inf")]}, r"camera cam_0 is wrong at translation"),
        ({"fisheye": True}, r"camera cam_0 has a fisheye lens"),
        ({"matrix": np.zeros((3, 3)).tolist()}, r"matrix of camera cam_0 is not that of a camera"),
    ],
)
def test_wrong_files_are_refused(changes, message, tmp_path):
    path = tmp_path / "cameras.toml"
    write_changed(path, **changes)
    with pytest.raises(ConfigurationError, match=re.escape(str(path)) + ".*" + message):
        read_cameras(path)


def test_files_without_cameras_are_refused(tmp_path):
    path = tmp_path / "cameras.toml"
    for text in ("", "[metadata]\nerror = 1\n", "cameras = 3\n", "answer = 42\n"):
        path.write_text(text)
        with pytest.raises(ConfigurationError, match="has no camera"):
            read_cameras(path)
    path.write_text("[cam_0\n")
    with pytest.raises(ConfigurationError, match="is not TOML"):
        read_cameras(path)
    path.write_text('[cam_0]\n[metadata]\nunit = "inch"\n')
    with pytest.raises(ConfigurationError, match=r"unit.*found inch"):
        read_cameras(path)
    with pytest.raises(FileFormatError, match="no such file"):
        read_cameras(tmp_path / "none.toml")


@pytest.mark.real_data
def test_caliscopes_file_is_read(data_folder):
    cameras = read_cameras(data_folder / "cameras" / "charuco_four" / "camera_array.toml")
    assert cameras.names == ("cam_0", "cam_1", "cam_2", "cam_3")
    assert cameras[0].translation == pytest.approx([171.26, -32.35, 1208.39], abs=0.01)
    assert cameras[0].rotation_matrix[0] == pytest.approx([-0.70707, 0.56399, -0.42658], abs=1e-4)
