"""Calibration of one camera or many from views of a board.

OpenCV calibrates each camera and finds the pose of the board in each view. The poses that two
cameras share say how these stand to each other, along the pairs that share most views; one bundle
adjustment then finds all numbers at once.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from mocap_fit.errors import DataError
from mocap_fit.stereo.board_poses import (
    combine_motions,
    connect_cameras,
    invert_motion,
    locate_board,
    move_point,
)
from mocap_fit.stereo.board_views import BoardView, Reason
from mocap_fit.stereo.boards import Board
from mocap_fit.stereo.bundle import NUMBERS, Bundle, CornerTable, adjust_bundle
from mocap_fit.stereo.cameras import Camera, Cameras
from mocap_fit.stereo.triangulation import triangulate
from mocap_fit.tracks.arrays import FloatArray

FEWEST_VIEWS = 3
"""Views of each camera that a calibration takes at least."""

# Columns and rows of the fields in which corners are counted.
_FIELDS = (8, 6)
# Half the width, height and depth of a face, millimetres.
_FACE = np.array([80.0, 110.0, 60.0])

_ADVICE = {
    Reason.MIRRORED: "Turn mirroring off in the camera's program, or print the board anew.",
    Reason.INVERTED: "Add :inverted to the board's text, or take it away.",
    Reason.DICTIONARY: "Name the dictionary that the board was printed with.",
    Reason.SIZE: "Check the columns and rows of the board.",
    Reason.MARGIN: "Leave a white margin round the markers.",
    Reason.BLUR: "Set the focus, and move the board slowly or expose more shortly.",
    Reason.OBLIQUE: "Turn the board towards the camera.",
    Reason.FEW: "Show the board as a whole, and near enough.",
}


@dataclass(frozen=True, eq=False, repr=False)
class Calibration:
    """Calibrated cameras, and how well they are known.

    Parameters
    ----------
    bundle
        The adjustment: cameras, poses, residuals and standard deviations.
    board
        What was shown.
    views
        What each camera saw, by its name, a picture each.
    """

    bundle: Bundle
    board: Board
    views: Mapping[str, Sequence[BoardView]]

    @property
    def cameras(self) -> Cameras:
        """The calibrated cameras."""
        return self.bundle.cameras

    @property
    def errors(self) -> dict[str, float]:
        """Root mean square distance of the corners of each camera, pixels."""
        bundle = self.bundle
        squares = (bundle.residuals**2).sum(axis=1)
        return {
            camera.name: float(
                np.sqrt(squares[bundle.used & (bundle.corners.camera == number)].mean())
            )
            for number, camera in enumerate(self.cameras)
        }

    @property
    def coverage(self) -> dict[str, float]:
        """The part of each camera's picture in which corners were seen, 0 to 1."""
        corners, used = self.bundle.corners, self.bundle.used
        parts = {}
        for number, camera in enumerate(self.cameras):
            pixels = corners.pixels[used & (corners.camera == number)]
            fields = np.floor(pixels / camera.size * _FIELDS).astype(int)
            parts[camera.name] = len({*map(tuple, fields.tolist())}) / (_FIELDS[0] * _FIELDS[1])
        return parts

    @property
    def unused_views(self) -> dict[str, dict[str, int]]:
        """How many pictures of each camera are not used, by the reason."""
        return {
            name: dict(Counter(str(view.reason) for view in views if view.reason is not None))
            for name, views in self.views.items()
        }

    def estimate_error(
        self, centre: Sequence[float] | None = None, noise: float | None = None
    ) -> tuple[float, float]:
        """Estimate the error of a marker before anything is recorded.

        Parameters
        ----------
        centre
            Where the middle of the face will be, in the frame of the cameras, millimetres,
            ``(3,)``; the middle of the board's positions where left out.
        noise
            Standard deviation of a marker's coordinates, pixels; that of the board's corners where
            left out.

        Returns
        -------
        noise_error : float
            Root mean square distance that the pixels' noise gives, millimetres.
        calibration_error : float
            The same of what the cameras' errors bend, after the best rigid motion, millimetres.

        Raises
        ------
        DataError
            If there is one camera only, or no point of the face is before all cameras.
        """
        bundle = self.bundle
        if centre is None:
            middle = self.board.points.mean(axis=0)
            places = [move_point(pose, middle) for pose in bundle.poses if np.isfinite(pose[0])]
            centre = np.median(places, axis=0).tolist()
        grid = np.stack(np.meshgrid(*[[-1.0, 0.0, 1.0]] * 3), axis=-1).reshape(-1, 3)
        face = np.asarray(centre) + grid * _FACE
        result = triangulate(
            self.cameras, self.cameras.project(face), bundle.noise if noise is None else noise
        )
        if np.isnan(result.points).any():
            raise DataError("the face is not before all cameras", found=list(centre))
        deviation = np.sqrt(np.trace(result.covariance, axis1=1, axis2=2).mean())
        # How the points move with each number of the cameras: their rays must still meet.
        moves = np.zeros((len(face), 3, len(bundle.names)))
        information = np.zeros((len(face), 3, 3))
        order = {name: number for number, name in enumerate(NUMBERS)}
        for camera in self.cameras:
            _, by_points, by_numbers = camera.differentiate(face)
            information += np.einsum("nij,nik->njk", by_points, by_points)
            for number, name in enumerate(bundle.names):
                owner, _, term = name.rpartition(" ")
                if owner == camera.name:
                    moves[..., number] -= np.einsum(
                        "nij,ni->nj", by_points, by_numbers[..., order[term]]
                    )
        bends = np.linalg.solve(information, moves).reshape(-1, len(bundle.names))
        # A motion of all points together is no error: what is left after it is.
        offset = grid * _FACE
        turns = [np.cross(axis, offset).ravel() for axis in np.eye(3)]
        shifts = [np.tile(axis, len(face)) for axis in np.eye(3)]
        rigid = np.linalg.qr(np.stack([*turns, *shifts], axis=1))[0]
        bends -= rigid @ (rigid.T @ bends)
        bent = np.einsum("ij,jk,ik->", bends, bundle.covariance, bends) / len(face)
        return float(deviation), float(np.sqrt(bent))

    def to_dict(self) -> dict[str, Any]:
        """Return the numbers as JSON can hold them.

        Returns
        -------
        dict
            The cameras in pixels, radians and millimetres, their standard deviations, errors,
            coverage and unused views, and the error to expect at the face.
        """
        bundle, errors, coverage = self.bundle, self.errors, self.coverage
        result: dict[str, Any] = {
            "board": str(self.board),
            "reprojection_error": bundle.error,
            "noise": bundle.noise,
            "corners": len(bundle.used),
            "outliers": int((~bundle.used).sum()),
            "standard_deviations": bundle.standard_deviations,
            "cameras": {
                camera.name: {
                    "size": camera.size,
                    "matrix": camera.matrix,
                    "distortion": camera.distortion,
                    "rotation": camera.rotation,
                    "translation": camera.translation,
                    "reprojection_error": errors[camera.name],
                    "coverage": coverage[camera.name],
                    "views": len(self.views[camera.name]),
                    "unused_views": self.unused_views[camera.name],
                }
                for camera in self.cameras
            },
        }
        if len(self.cameras) > 1:
            noise, bent = self.estimate_error()
            result["expected_error_mm"] = {"noise": noise, "calibration": bent}
        return result

    def __repr__(self) -> str:
        bundle, errors, coverage = self.bundle, self.errors, self.coverage
        lines = [f"Calibration with {self.board}", *repr(bundle).split("\n")]
        for name, reasons in self.unused_views.items():
            count = len(self.views[name])
            text = ", ".join(f"{number} {reason}" for reason, number in reasons.items())
            lines.append(
                f"{name}: {count - sum(reasons.values())} of {count} views used"
                + (f" ({text})" if text else "")
                + f", corners in {100 * coverage[name]:.0f} % of the picture"
                + f", reprojection error {errors[name]:.3f} px"
            )
        if len(self.cameras) > 1:
            noise, bent = self.estimate_error()
            lines.append(
                f"Expected error of a marker at the face: {noise:.2f} mm from noise of "
                f"{bundle.noise:.2f} px, {bent:.2f} mm from the calibration"
            )
        return "\n".join(lines)


def calibrate_cameras(
    views: Mapping[str, Sequence[BoardView]],
    sizes: Mapping[str, tuple[int, int]],
    board: Board,
    *,
    distortion_terms: Sequence[str] = ("k1", "k2"),
    intrinsics: Cameras | None = None,
) -> Calibration:
    """Calibrate cameras from what they see of a board.

    Parameters
    ----------
    views
        What each camera saw, by its name: pictures of one number were taken at one time.
    sizes
        Width and height of each camera's pictures, pixels.
    board
        What was shown.
    distortion_terms
        Which of k1, k2, p1, p2 and k3 are estimated; others are 0.
    intrinsics
        Cameras of the same names whose focal lengths, principal points and distortion are taken
        over; all are estimated where left out.

    Returns
    -------
    Calibration
        The cameras in the frame of the first one, millimetres, and how well they are known.

    Raises
    ------
    DataError
        If a camera has too few views, the board does not connect all cameras, it does not show
        which way up it is and there are several cameras, or the views do not determine the
        cameras.
    """
    names = list(views)
    if not names:
        raise DataError("there is no camera", expected="at least one")
    if len(names) > 1 and not board.is_oriented:
        raise DataError(
            "two cameras may take this board the other way up",
            found=str(board),
            advice="Use a ChArUco board, or a chessboard of odd columns and even rows.",
        )
    for name in names:
        _check_views(name, views[name])
    if intrinsics is None:
        alone = [
            _calibrate_alone(name, views[name], sizes[name], board, distortion_terms)
            for name in names
        ]
    else:
        alone = [
            replace(intrinsics[name], rotation=np.zeros(3), translation=np.zeros(3))
            for name in names
        ]
    seen = [locate_board(camera, views[camera.name], board) for camera in alone]
    motions = connect_cameras(names, seen)
    cameras = Cameras(
        tuple(
            replace(camera, rotation=motion[:3], translation=motion[3:])
            for camera, motion in zip(alone, motions, strict=True)
        )
    )
    count = max(len(one) for one in views.values())
    poses = np.full((count, 6), np.nan)
    for motion, mine in zip(motions[::-1], seen[::-1], strict=True):
        for number, pose in mine.items():
            poses[number] = combine_motions(invert_motion(motion), pose)
    bundle = adjust_bundle(
        cameras,
        _gather_corners(views, seen, board),
        poses,
        distortion_terms=distortion_terms,
        fix_intrinsics=intrinsics is not None,
    )
    return Calibration(bundle, board, views)


def _check_views(name: str, views: Sequence[BoardView]) -> None:
    used = sum(view.is_used for view in views)
    if used >= FEWEST_VIEWS:
        return
    unused = [view for view in views if view.reason is not None]
    reasons = Counter(view.reason for view in unused if view.reason is not None).most_common()
    text = ", ".join(f"{number} {reason}" for reason, number in reasons)
    advice = "Show it more often."
    if reasons:
        most = reasons[0][0]
        advice = _ADVICE.get(most, advice)
        detail = next(view.detail for view in unused if view.reason == most)
        advice += f" Seen: {detail}." if detail else ""
    raise DataError(
        f"camera {name} sees the board in too few pictures",
        found=f"{used} of {len(views)}" + (f": {text}" if text else ""),
        expected=f"{FEWEST_VIEWS} or more",
        advice=advice,
    )


def _calibrate_alone(
    name: str,
    views: Sequence[BoardView],
    size: tuple[int, int],
    board: Board,
    distortion_terms: Sequence[str],
) -> Camera:
    """Calibrate one camera by OpenCV, in its own frame."""
    import cv2

    used = [view for view in views if view.is_used]
    points = [board.points[view.ids].astype(np.float32) for view in used]
    pixels = [view.pixels.astype(np.float32) for view in used]
    # The start knows k1 and k2 only where they are wanted: more terms wait for the bundle.
    flags = cv2.CALIB_FIX_K3 | cv2.CALIB_ZERO_TANGENT_DIST
    flags |= cv2.CALIB_FIX_K1 * ("k1" not in distortion_terms)
    flags |= cv2.CALIB_FIX_K2 * ("k2" not in distortion_terms)
    try:
        _, matrix, distortion, _, _ = cv2.calibrateCamera(
            points, pixels, size, None, None, flags=flags
        )
        return Camera(name, size, matrix, np.ravel(distortion))
    except (cv2.error, DataError):
        raise DataError(
            f"the views of the board do not determine camera {name}",
            advice="Show the board tilted, in different directions, at different distances.",
        ) from None


def _gather_corners(
    views: Mapping[str, Sequence[BoardView]],
    seen: Sequence[Mapping[int, FloatArray]],
    board: Board,
) -> CornerTable:
    rows = [
        (np.full(len(view.ids), camera), np.full(len(view.ids), number), view.ids, view.pixels)
        for camera, (poses, mine) in enumerate(zip(seen, views.values(), strict=True))
        for number, view in enumerate(mine)
        if number in poses
    ]
    camera, number, ids, pixels = (np.concatenate(column) for column in zip(*rows, strict=True))
    return CornerTable(camera, number, board.points[ids], pixels)
