"""``mocap-fit calibrate``: real videos, and what cannot be calibrated."""

import json

import cv2
import numpy as np
import pytest

import corpus_tools
from corpus_tools.cli import app as cli
from mocap_fit.errors import ConfigurationError, DataError
from mocap_fit.stereo import read_cameras

BOARD = "charuco:4x5:54mm:DICT_4X4_1000"


@pytest.fixture
def videos(tmp_path):
    """Two videos of a grey wall."""
    paths = []
    for name in ("left", "right"):
        paths.append(tmp_path / f"{name}.mkv")
        video = cv2.VideoWriter(str(paths[-1]), cv2.VideoWriter.fourcc(*"FFV1"), 30, (64, 48))
        for _ in range(6):
            video.write(np.full((48, 64, 3), 90, dtype=np.uint8))
        video.release()
    return paths


def test_videos_without_a_board_are_refused(videos, tmp_path):
    steps = []
    with pytest.raises(DataError, match=r"camera left .*found 0 of 3: 3 no board"):
        corpus_tools.calibrate(
            videos,
            BOARD,
            out=tmp_path / "cameras.toml",
            pictures=3,
            progress=lambda *step: steps.append(step),
        )
    assert not (tmp_path / "cameras.toml").exists()
    assert steps[0] == ("looking for the board in left", 1, 6)
    assert len(steps) == 6


def test_every_video_is_another_camera(videos, tmp_path):
    other = tmp_path / "other"
    other.mkdir()
    with pytest.raises(ConfigurationError, match=r"two videos have one name.*found left"):
        corpus_tools.calibrate([videos[0], other / "left.mp4"], BOARD)


@pytest.mark.parametrize(
    ("arguments", "status", "message"),
    [
        (["left.mkv", "--board", "charuco:4x5"], 1, "the board's text lacks a part"),
        (["none.mkv", "--board", BOARD], 1, "none.mkv: there is no such video"),
        (["left.mkv", "--board", BOARD, "--terms", "k1,k9"], 2, "choose from k1, k2, p1"),
        (["left.mkv"], 2, "--board"),
    ],
)
def test_wrong_calls_say_what_is_wrong(arguments, status, message, videos, monkeypatch, capsys):
    monkeypatch.chdir(videos[0].parent)
    assert cli.main(["calibrate", *arguments]) == status
    assert message in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.real_data
def test_two_real_cameras(data_folder, tmp_path, capsys):
    folder = data_folder / "cameras" / "charuco_pair"
    out = tmp_path / "cameras.toml"
    command = ["calibrate", *(str(folder / f"cam_{number}.mp4") for number in (0, 1))]
    command += ["--board", str(folder / "charuco.toml"), "--out", str(out)]
    command += ["--intrinsics", str(folder / "camera_array.toml"), "--json"]
    assert cli.main(command) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["reprojection_error"] < 1.66
    assert report["cameras"]["cam_1"]["unused_views"]["under six corners"] > 10
    mine, theirs = read_cameras(out), read_cameras(folder / "camera_array.toml")
    gaps = [
        np.linalg.norm(np.diff([camera.centre for camera in one], axis=0)) for one in (mine, theirs)
    ]
    print(f"{gaps[0]:.1f} mm apart, theirs {gaps[1]:.1f} mm")
    assert gaps[0] == pytest.approx(gaps[1], rel=0.03)
