"""Recordings that the world made; the tests are skipped where they are not."""

import warnings
from pathlib import Path

import numpy as np
import pytest

from mocap_fit.io import describe, read_poses, read_tracks, write_qualisys_tsv
from mocap_fit.tracks import FloatArray

pytestmark = pytest.mark.real_data

MARKERS_OF_BODY = {
    "Upper Leg IMU": [f"Upper Leg IMU - {index}" for index in (1, 2, 3)],
    "Foot IMU": [f"Foot IMU - {index}" for index in (1, 2, 3)],
    "Lower Leg IMU": [f"Lower Leg IMU - {index}" for index in (1, 2, 3)],
}


def rotation_between(first: FloatArray, later: FloatArray) -> FloatArray:
    """The rotation that best takes centred points to centred points (Kabsch)."""
    left, _, right = np.linalg.svd((later - later.mean(axis=0)).T @ (first - first.mean(axis=0)))
    flip = np.diag([1, 1, np.linalg.det(left @ right)])
    return np.asarray(left @ flip @ right)


@pytest.fixture
def qualisys(data_folder: Path) -> Path:
    return data_folder / "qualisys"


def test_the_first_export_without_titles(qualisys: Path) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        tracks = read_tracks(qualisys / "qtm2010_3d_no_title_row.tsv")
    assert (tracks.frames, tracks.rate, tracks.start_time) == (513, 256.0, 0.0)
    assert len(tracks.names) == 14
    assert tracks.names[2] == "Knee Hinge"
    assert tracks.names[5] == "Upper Leg IMU - 1"
    assert tracks.positions[0, 0].tolist() == [-804.935, 123.585, -978.146]
    assert tracks["Lower Leg IMU - 3"][-1].tolist() == [-764.480, 257.803, -189.281]


def test_the_export_with_frame_and_time(qualisys: Path) -> None:
    tracks = read_tracks(qualisys / "qtm2014_3d_frame_time.tsv")
    assert (tracks.frames, tracks.rate, tracks.start_time) == (720, 120.0, 0.00833)
    assert tracks.names == ("RIGHT_KNEE", "right_ankle")
    assert tracks.positions[0].tolist() == [
        [1440.857, 2052.804, 474.694],
        [1501.102, 2073.985, 102.815],
    ]
    assert tracks.positions[-1, 1].tolist() == [-446.335, 71.693, 106.006]
    assert tracks.times[-1] == pytest.approx(6.0, abs=1e-5)


def test_the_bodies(qualisys: Path) -> None:
    poses = read_poses(qualisys / "qtm2010_6d_bodies.tsv")
    assert (poses.frames, poses.rate) == (513, 256.0)
    assert poses.names == ("Upper Leg IMU", "Foot IMU", "Lower Leg IMU")
    assert poses.translations[0, 0].tolist() == [-805.16156, 143.27263, -614.23413]
    assert poses.residuals[0].tolist() == [0.20925, 1.39753, 0.32889]


@pytest.mark.parametrize("body", MARKERS_OF_BODY)
def test_the_bodies_turn_as_their_markers_do(body: str, qualisys: Path) -> None:
    """Which only matrices read column by column do: the other way is tens of degrees off."""
    poses = read_poses(qualisys / "qtm2010_6d_bodies.tsv")
    markers = read_tracks(qualisys / "qtm2010_3d_no_title_row.tsv")
    points = markers.positions[:, markers.indices(MARKERS_OF_BODY[body])]
    rotations = poses.rotations[:, poses.index(body)]
    for frame in range(0, 513, 32):
        wanted = rotation_between(points[0], points[frame])
        got = rotations[frame] @ rotations[0].T
        cosine = (np.trace(wanted.T @ got) - 1) / 2
        assert np.degrees(np.arccos(np.clip(cosine, -1, 1))) < 0.5, frame


def test_written_again_they_are_the_same(qualisys: Path, tmp_path: Path) -> None:
    for name in ("qtm2010_3d_no_title_row.tsv", "qtm2014_3d_frame_time.tsv"):
        tracks = read_tracks(qualisys / name)
        write_qualisys_tsv(tracks, tmp_path / name)
        back = read_tracks(tmp_path / name)
        np.testing.assert_array_equal(back.positions, tracks.positions)
        assert (back.names, back.rate, back.start_time) == (
            tracks.names,
            tracks.rate,
            tracks.start_time,
        )


def test_the_c3d(data_folder: Path) -> None:
    path = data_folder / "c3d" / "qtm2017_body_with_head_markers.c3d"
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        tracks = read_tracks(path)
    assert (tracks.frames, tracks.rate, len(tracks.names)) == (340, 200.0, 55)
    assert tracks.start_time == pytest.approx(3.52)
    assert {"L_HDF", "L_HDB", "R_HDF", "R_HDB"} <= set(tracks.names)
    assert tracks["L_HDF"][0] == pytest.approx([-165.0246, 230.6246, 1441.5514], abs=1e-4)
    assert [event.name for event in tracks.events] == [
        *("LHS", "RTO", "RHS", "LTO"),
        *("LHS", "RTO", "RHS"),
    ]
    # Events count from the start of the measurement, as the times of the frames do.
    times = [event.time for event in tracks.events]
    assert tracks.times[0] <= min(times)
    assert max(times) <= tracks.times[-1]


def test_the_heads_four_markers_are_rigid(data_folder: Path) -> None:
    tracks = read_tracks(data_folder / "c3d" / "qtm2017_body_with_head_markers.c3d")
    head = tracks.positions[:, tracks.indices(["L_HDF", "L_HDB", "R_HDF", "R_HDB"])]
    distances = np.linalg.norm(head[:, :, None] - head[:, None], axis=3)
    assert distances.std(axis=0).max() < 1.0
    assert 50 < distances[:, *np.triu_indices(4, 1)].mean() < 250


def test_all_sentences_of_the_speaker(data_folder: Path) -> None:
    files = sorted((data_folder / "grid_s1" / "tsv").glob("*.tsv"))
    assert len(files) == 287
    frames = 0
    for path in files:
        tracks = read_tracks(path)
        assert (tracks.rate, tracks.start_time, len(tracks.names)) == (25.0, 0.0, 38)
        frames += tracks.frames
    assert frames == 21523
    assert read_tracks(data_folder / "grid_s1" / "reference.tsv").frames == 1


def test_describe(data_folder: Path) -> None:
    told = describe(data_folder / "c3d" / "qtm2017_body_with_head_markers.c3d")
    assert told["format"] == "c3d"
    assert told["duration"] == pytest.approx(1.7)
    assert len(told["events"]) == 7
    assert {marker["gap_rate"] for marker in told["markers"]} == {0.0}
