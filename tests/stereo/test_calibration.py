"""Calibration from views of a board: known truth, expected errors, what cannot be calibrated."""

import cv2
import numpy as np
import pytest

from mocap_fit.errors import DataError
from mocap_fit.stereo import (
    BoardView,
    Cameras,
    Reason,
    calibrate_cameras,
    find_corners,
    measure_lags,
    read_board,
    read_cameras,
    triangulate,
)
from mocap_fit.stereo.video import read_pictures
from mocap_fit.tracks.rigid import estimate_rigid_transforms

BOARD = read_board("charuco:9x7:20mm:DICT_4X4_250")
FAR = BoardView(np.zeros(0, dtype=np.int64), np.zeros((0, 2)), Reason.NO_BOARD)


def to_views(corners, cameras: Cameras) -> dict[str, list[BoardView]]:
    """The rows of a table as pictures of `BOARD`, whose corners it has."""
    views = {camera.name: [] for camera in cameras}
    for number, camera in enumerate(cameras):
        for view in range(corners.view.max() + 1):
            pixels = corners.pixels[(corners.camera == number) & (corners.view == view)]
            views[camera.name].append(BoardView(np.arange(48), pixels))
    return views


def get_sizes(cameras: Cameras) -> dict[str, tuple[int, int]]:
    return {camera.name: camera.size for camera in cameras}


def measure_face_error(cameras: Cameras, truth: Cameras) -> float:
    """The root mean square error of points of a face that is seen without noise, millimetres."""
    grid = np.stack(np.meshgrid(*[[-1.0, 0, 1]] * 3), axis=-1).reshape(-1, 3) * [80, 110, 60]
    points = triangulate(cameras, truth.project(grid)).points
    rotations, shifts = estimate_rigid_transforms(grid, points[None])[:2]
    turned = np.einsum("ij,pj->pi", rotations[0], grid) + shifts[0]
    return float(np.sqrt(((turned - points) ** 2).sum(axis=1).mean()))


def test_two_cameras_are_calibrated(arrange_cameras, show_board, rng):
    truth = arrange_cameras(2, 300, 800)
    corners, _ = show_board(truth, rng, 14)
    views = to_views(corners, truth)
    views["cam_1"][3] = FAR
    result = calibrate_cameras(views, get_sizes(truth), BOARD)
    assert result.cameras.names == truth.names
    assert result.cameras[0].translation.tolist() == [0, 0, 0]
    bundle = result.bundle
    assert bundle.noise == pytest.approx(0.2, rel=0.06)
    deviations = bundle.standard_deviations
    for camera, true in zip(result.cameras, truth, strict=True):
        for name, mine, wanted in (
            ("fx", camera.matrix[0, 0], true.matrix[0, 0]),
            ("cy", camera.matrix[1, 2], true.matrix[1, 2]),
            ("k1", camera.distortion[0], true.distortion[0]),
        ):
            assert abs(mine - wanted) < 3.5 * deviations[f"{camera.name} {name}"]
    baseline = np.linalg.norm(result.cameras[1].centre)
    assert baseline == pytest.approx(300, rel=0.01)
    assert result.unused_views == {"cam_0": {}, "cam_1": {"no board": 1}}
    assert 0.3 < result.coverage["cam_0"] < 1
    text = repr(result)
    assert "cam_1: 13 of 14 views used (1 no board), corners in" in text
    assert "Expected error of a marker at the face: 1." in text


@pytest.mark.slow
def test_the_expected_error_is_what_is_met(arrange_cameras, show_board):
    truth = arrange_cameras(2, 600, 800)
    met, expected = [], []
    for seed in range(8):
        corners, _ = show_board(truth, np.random.default_rng(seed), 25)
        result = calibrate_cameras(to_views(corners, truth), get_sizes(truth), BOARD)
        centre = result.cameras[0].rotation_matrix.T @ truth[0].translation
        noise, bent = result.estimate_error(centre, noise=0.2)
        # Twice the focal length halves it: 0.30 mm at 1700 px.
        assert noise == pytest.approx(0.30 * 1700 / 800, rel=0.05)
        expected.append(bent)
        met.append(measure_face_error(result.cameras, truth))
    ratio = np.sqrt(np.mean(np.square(met)) / np.mean(np.square(expected)))
    print(f"met {np.mean(met):.3f} mm, expected {np.mean(expected):.3f} mm, ratio {ratio:.2f}")
    assert 0.6 < ratio < 1.4


def test_cameras_are_connected_through_others(arrange_cameras, show_board, rng):
    truth = arrange_cameras(3, 400, 700)
    corners, _ = show_board(truth, rng, 6)
    views = to_views(corners, truth)
    # The outer two never see the board together.
    views["cam_0"][3:] = [FAR] * 3
    views["cam_2"][:3] = [FAR] * 3
    result = calibrate_cameras(views, get_sizes(truth), BOARD, intrinsics=truth)
    gap = np.linalg.norm(result.cameras[2].centre - result.cameras[0].centre)
    assert gap == pytest.approx(400, rel=0.01)
    views["cam_1"][3:] = [FAR] * 3
    with pytest.raises(DataError, match=r"no view of the board connects.*found cam_2"):
        calibrate_cameras(views, get_sizes(truth), BOARD, intrinsics=truth)


def test_known_intrinsics_are_taken_over(arrange_cameras, show_board, rng):
    truth = arrange_cameras(2, 300, 800)
    corners, _ = show_board(truth, rng, 6)
    views = to_views(corners, truth)
    result = calibrate_cameras(views, get_sizes(truth), BOARD, intrinsics=truth)
    for camera, true in zip(result.cameras, truth, strict=True):
        assert np.array_equal(camera.matrix, true.matrix)
        assert np.array_equal(camera.distortion, true.distortion)
    assert np.linalg.norm(result.cameras[1].centre) == pytest.approx(300, rel=0.01)


def test_what_cannot_be_calibrated_is_refused(arrange_cameras, show_board, rng):
    truth = arrange_cameras(2, 300, 800)
    corners, _ = show_board(truth, rng, 4)
    views = to_views(corners, truth)
    sizes = get_sizes(truth)
    with pytest.raises(DataError, match="there is no camera"):
        calibrate_cameras({}, sizes, BOARD)
    few = views | {"cam_1": [*views["cam_1"][:2], FAR, FAR]}
    message = r"camera cam_1 sees the board in too few pictures \(found 2 of 4: 2 no board"
    with pytest.raises(DataError, match=message):
        calibrate_cameras(few, sizes, BOARD)
    dark = BoardView(FAR.ids, FAR.pixels, Reason.DICTIONARY, "10 markers of DICT_6X6")
    with pytest.raises(
        DataError, match=r"4 wrong dictionary.*Name the.*Seen: 10 markers of DICT_6"
    ):
        calibrate_cameras(views | {"cam_1": [dark] * 4}, sizes, BOARD)
    with pytest.raises(DataError, match="may take this board the other way up"):
        calibrate_cameras(views, sizes, read_board("chessboard:9x7:20mm"))
    with pytest.raises(DataError, match=r"no such distortion term.*found k7"):
        calibrate_cameras(views, sizes, BOARD, distortion_terms=("k7",))
    result = calibrate_cameras({"cam_0": views["cam_0"]}, sizes, BOARD)
    assert "Expected error" not in repr(result)
    with pytest.raises(DataError, match="one camera sees no depth"):
        result.estimate_error([0, 0, 900])
    with pytest.raises(DataError, match="not before all cameras"):
        calibrate_cameras(views, sizes, BOARD).estimate_error([0, 0, -900])


def take_picture(camera, board, pose, printed, scale, margin) -> np.ndarray:
    """What a camera sees of a printed board on a grey wall, with the lens's distortion."""
    width, height = camera.size
    pixels = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1).astype(float)
    rays = np.pad(camera.undistort(pixels), ((0, 0), (0, 0), (0, 1)), constant_values=1.0)
    turn = cv2.Rodrigues(pose[:3])[0]
    # The ray meets the plane z = 0 of the board.
    origin = -turn.T @ pose[3:]
    rays = rays @ turn
    on_board = origin[:2] - rays[..., :2] * (origin[2] / rays[..., 2])[..., None]
    x, y = np.moveaxis(on_board / board.spacing * scale + margin - 0.5, -1, 0).astype(np.float32)
    seen = cv2.remap(printed, x, y, cv2.INTER_AREA, borderValue=128)
    return cv2.GaussianBlur(seen, (0, 0), 0.7)


@pytest.mark.slow
def test_pictures_of_a_printed_board_calibrate_a_camera(arrange_cameras, draw_board, rng):
    camera = arrange_cameras(2, 300, 800)[0]
    board = read_board("charuco:7x5:40mm:DICT_4X4_250")
    printed, _ = draw_board(board)
    middle = board.points.mean(axis=0)
    views = []
    for _ in range(12):
        turn = rng.uniform(-0.5, 0.5, 3)
        place = rng.uniform([-90, -50, 450], [90, 50, 650]) - cv2.Rodrigues(turn)[0] @ middle
        pose = np.concatenate([turn, place])
        views.append(find_corners(take_picture(camera, board, pose, printed, 60, 60), board))
    result = calibrate_cameras({"one": views}, {"one": camera.size}, board)
    assert result.bundle.error < 0.2
    deviations = result.bundle.standard_deviations
    (fitted,) = result.cameras
    assert abs(fitted.matrix[0, 0] - 800) < max(4 * deviations["one fx"], 1.0)
    assert abs(fitted.matrix[0, 2] - 320.5) < max(4 * deviations["one cx"], 1.0)
    assert abs(fitted.distortion[0] + 0.15) < max(4 * deviations["one k1"], 0.01)


@pytest.fixture(scope="module")
def real(data_folder):
    """Four real cameras: what they see of the board, and another program's cameras."""
    folder = data_folder / "cameras" / "charuco_four"
    board = read_board(folder / "charuco.toml")
    cameras = read_cameras(folder / "camera_array.toml")
    views = {}
    for camera in cameras:
        pictures = read_pictures(folder / f"{camera.name}.mp4")
        views[camera.name] = [find_corners(picture, board) for picture in pictures]
    return board, cameras, views


@pytest.mark.slow
@pytest.mark.real_data
def test_four_real_cameras(real):
    board, theirs, views = real
    result = calibrate_cameras(views, get_sizes(theirs), board, intrinsics=theirs)
    print(result)
    # One camera's first two pictures are missing: it shows everything two pictures earlier.
    lags = measure_lags(theirs, views, board)
    late = measure_lags(theirs, views | {"cam_2": views["cam_2"][2:]}, board)
    print(f"lags in frames: {lags}")
    assert late["cam_2"] - lags["cam_2"] == pytest.approx(-2, abs=0.1)
    # That program's own is 1.66 px over all corners.
    bundle = result.bundle
    everything = np.sqrt((bundle.residuals**2).sum(axis=1).mean())
    print(f"over all corners, outliers too: {everything:.2f} px")
    assert bundle.error < 1.66
    for one, first in zip(result.cameras, theirs, strict=True):
        for two, second in zip(result.cameras, theirs, strict=True):
            if first.name < second.name:
                gap = np.linalg.norm(first.centre - second.centre)
                assert np.linalg.norm(one.centre - two.centre) == pytest.approx(gap, rel=0.02)
                mine = two.rotation_matrix @ one.rotation_matrix.T
                other = second.rotation_matrix @ first.rotation_matrix.T
                angle = np.linalg.norm(cv2.Rodrigues(mine @ other.T)[0])
                print(f"{first.name} {second.name}: {np.degrees(angle):.2f} degrees")
                assert np.degrees(angle) < (0.7 if one is result.cameras[0] else 0.8)
    # The board's corners, found again from the pictures alone, are 54 mm apart.
    pixels = np.full((4, len(views["cam_0"]), len(board.points), 2), np.nan)
    corners = bundle.corners
    ids = np.array([np.flatnonzero((board.points == p).all(axis=1))[0] for p in corners.points])
    pixels[corners.camera, corners.view, ids] = np.where(
        bundle.used[:, None], corners.pixels, np.nan
    )
    points = triangulate(result.cameras, pixels).points.reshape(-1, 4, 3, 3)
    steps = [np.linalg.norm(np.diff(points, axis=axis), axis=-1).ravel() for axis in (1, 2)]
    gaps = np.concatenate(steps) - 54
    gaps = gaps[np.isfinite(gaps)]
    print(f"{len(gaps)} distances of neighbours: RMS {np.sqrt((gaps**2).mean()):.2f} mm off 54")
    assert np.sqrt((gaps**2).mean()) < 0.65


@pytest.mark.slow
@pytest.mark.real_data
def test_each_real_camera_alone(real):
    board, theirs, views = real
    for camera in theirs:
        name = camera.name
        result = calibrate_cameras({name: views[name]}, {name: camera.size}, board)
        print(result)
        assert result.bundle.error < 0.3
        # The videos fix little: the board is always in one part of the picture.
        assert result.bundle.standard_deviations[f"{name} fx"] > 1.0
