"""Two cameras calibrated from synthetic views of a board, beside OpenCV's stereo calibration.

    python benchmarks/calibration.py [--seeds 40] [--views 40] [--noise 0.2] [--json]

Two cameras of 640 x 480 pixels, f = 800 pixels, k1 = -0.15 and k2 = 0.08, 300 mm apart and 1 m
away see 8 x 6 corners 20 mm apart in random poses; every coordinate has noise. Printed are: the
part of all numbers (cameras' and poses') within 1.96 of their standard deviations; the mean squared
error of the cameras' numbers in units of their covariance, which is 1 where it is right; the
reprojection error by OpenCV's; the baseline's error; the error of a face's points, after the best
rigid motion, and the one that was expected.
"""

import argparse
import json

import cv2
import numpy as np

from mocap_fit.stereo import BoardView, Camera, Cameras, calibrate_cameras, read_board, triangulate
from mocap_fit.stereo.bundle import list_numbers
from mocap_fit.tracks.rigid import estimate_rigid_transforms

BOARD = read_board("charuco:9x7:20mm:DICT_4X4_250")
FACE = np.stack(np.meshgrid(*[[-1.0, 0, 1]] * 3), axis=-1).reshape(-1, 3) * [80, 110, 60]
SIZE = (640, 480)


def create_cameras() -> Cameras:
    """Return the cameras, in the frame of the first one."""
    matrix = np.array([[800, 0, 320.5], [0, 801.6, 238.7], [0, 0, 1]])
    lens = np.array([-0.15, 0.08])
    angle = 2 * np.arcsin(0.15)
    centre = 1000 * np.array([np.sin(angle), 0, 1 - np.cos(angle)])
    turn = np.array([0, angle, 0])
    shift = -cv2.Rodrigues(turn)[0] @ centre
    first = Camera("first", SIZE, matrix, lens)
    return Cameras((first, Camera("second", SIZE, matrix, lens, turn, shift)))


def show_board(cameras: Cameras, rng: np.random.Generator, views: int, noise: float):
    """Return what the cameras see of the board, and its poses."""
    middle = BOARD.points.mean(axis=0)
    seen, poses = {camera.name: [] for camera in cameras}, []
    while len(poses) < views:
        turn = rng.uniform(-0.6, 0.6, 3)
        rotation = cv2.Rodrigues(turn)[0]
        place = rng.uniform([-180, -120, 850], [180, 120, 1150]) - rotation @ middle
        pixels = cameras.project(BOARD.points @ rotation.T + place)
        if ((pixels > 5) & (pixels < np.array(SIZE) - 5.0)).all():
            poses.append(np.concatenate([turn, place]))
            for camera, one in zip(cameras, pixels, strict=True):
                noisy = one + rng.normal(0, noise, one.shape)
                seen[camera.name].append(BoardView(np.arange(len(one)), noisy))
    return seen, np.array(poses)


def calibrate_by_opencv(seen) -> tuple[float, float]:
    """Return OpenCV's reprojection error in pixels, and its baseline in millimetres."""
    points = [BOARD.points.astype(np.float32)] * len(seen["first"])
    pixels = [[view.pixels.astype(np.float32) for view in views] for views in seen.values()]
    flags = cv2.CALIB_FIX_K3 | cv2.CALIB_ZERO_TANGENT_DIST
    lenses = []
    for one in pixels:
        _, matrix, distortion, _, _ = cv2.calibrateCamera(
            points, one, SIZE, None, None, flags=flags
        )
        lenses += [matrix, distortion]
    result = cv2.stereoCalibrate(
        points, *pixels, *lenses, SIZE, flags=flags | cv2.CALIB_USE_INTRINSIC_GUESS
    )
    return float(result[0]), float(np.linalg.norm(result[6]))


def measure(seed: int, views: int, noise: float) -> dict[str, float]:
    """Return what one calibration is measured by."""
    truth = create_cameras()
    seen, poses = show_board(truth, np.random.default_rng(seed), views, noise)
    result = calibrate_cameras(seen, {camera.name: SIZE for camera in truth}, BOARD)
    bundle = result.bundle
    errors = np.array(
        [
            list_numbers(result.cameras[camera])[number] - list_numbers(truth[camera])[number]
            for camera, number in (name.split() for name in bundle.names)
        ]
    )
    deviations = np.sqrt(np.diagonal(bundle.covariance))
    within = np.abs(
        np.concatenate(
            [errors / deviations, ((bundle.poses - poses) / bundle.pose_deviations).ravel()]
        )
    )
    theirs, baseline = calibrate_by_opencv(seen)
    face = FACE + np.array([0, 0, 1000])
    points = triangulate(result.cameras, truth.project(face)).points
    rotations, shifts = estimate_rigid_transforms(face, points[None])[:2]
    bent = points - face @ rotations[0].T - shifts[0]
    mine = np.linalg.norm(result.cameras[1].centre)
    return {
        "within": float((within < 1.96).mean()),
        "squares": float(errors @ np.linalg.solve(bundle.covariance, errors) / len(errors)),
        "by OpenCV's": bundle.error / theirs,
        "baseline %": 100 * abs(mine / 300 - 1),
        "OpenCV's %": 100 * abs(baseline / 300 - 1),
        "face mm": float(np.sqrt((bent**2).sum(axis=1).mean())),
        "expected mm": result.estimate_error([0.0, 0.0, 1000.0], noise)[1],
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--seeds", type=int, default=40)
    parser.add_argument("--views", type=int, default=40)
    parser.add_argument("--noise", type=float, default=0.2, help="pixels")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    arguments = parser.parse_args()
    rows = [measure(seed, arguments.views, arguments.noise) for seed in range(arguments.seeds)]
    means = {name: float(np.mean([row[name] for row in rows])) for name in rows[0]}
    if arguments.json:
        print(json.dumps(vars(arguments) | {"mean": means, "seeds": rows}))
        return
    print(*(f"{name:>12s}" for name in rows[0]))
    for row in [*rows, means]:
        print(*(f"{value:12.4f}" for value in row.values()))


if __name__ == "__main__":
    main()
