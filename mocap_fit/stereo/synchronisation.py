"""By how much one camera's pictures come later than another's, from the motion of a board.

Two cameras that stand still see the same motion but for one rigid motion between them. At the
right lag the paths of the board's corners before one camera lie on those before the other.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from mocap_fit.errors import DataError
from mocap_fit.stereo.board_poses import locate_board
from mocap_fit.stereo.board_views import BoardView
from mocap_fit.stereo.boards import Board
from mocap_fit.stereo.cameras import Camera, Cameras
from mocap_fit.tracks.arrays import FloatArray
from mocap_fit.tracks.rigid import estimate_rigid_transforms

# Frames: steps of the first search.
_STEP = 0.25
# Frames that two cameras must share, and millimetres that the board must move in them.
_FEWEST, _SHORTEST = 10, 10.0
_ROUNDS = 6


def measure_lags(
    cameras: Cameras,
    views: Mapping[str, Sequence[BoardView]],
    board: Board,
    longest: float = 5.0,
) -> dict[str, float]:
    """Measure how much later each camera shows what the first camera shows.

    Parameters
    ----------
    cameras
        Calibrated, each alone or all together: only their lenses count.
    views
        What each camera saw of a board that moves, picture by picture at one rate.
    board
        What was shown.
    longest
        The longest lag that is looked for, frames.

    Returns
    -------
    dict of str to float
        The lag of each camera, frames: +2 where its third picture shows what the first one of the
        first camera shows.

    Raises
    ------
    DataError
        If two cameras share too few views, or the board does not move in them.
    """
    first, *others = list(views)
    paths = {name: _trace_corners(cameras[name], views[name], board) for name in views}
    lags = {first: 0.0}
    while others:
        # From a camera that is known, to the one that shares most views with any such.
        known, name = max(
            ((one, other) for one in lags for other in others),
            key=lambda pair: int(_find_shared(paths[pair[0]], paths[pair[1]]).sum()),
        )
        lags[name] = lags[known] + _find_lag(paths[known], paths[name], longest, (known, name))
        others.remove(name)
    return {name: lags[name] for name in views}


def _trace_corners(camera: Camera, views: Sequence[BoardView], board: Board) -> FloatArray:
    """Return four corners of the board before a camera, ``(pictures, 4, 3)``, NaN if not seen."""
    import cv2

    points = board.points
    ends = points[[0, board.pattern[0] - 1, -board.pattern[0], -1]]
    paths = np.full((len(views), 4, 3), np.nan)
    for number, pose in locate_board(camera, views, board).items():
        paths[number] = ends @ cv2.Rodrigues(pose[:3])[0].T + pose[3:]
    return paths


def _find_shared(one: FloatArray, other: FloatArray) -> NDArray[np.bool_]:
    count = min(len(one), len(other))
    return np.asarray(np.isfinite(one[:count, 0, 0]) & np.isfinite(other[:count, 0, 0]))


def _find_lag(one: FloatArray, other: FloatArray, longest: float, names: tuple[str, str]) -> float:
    from scipy.interpolate import CubicSpline
    from scipy.optimize import minimize_scalar

    seen = np.flatnonzero(np.isfinite(other[:, 0, 0]))
    shared = one[: len(other)][_find_shared(one, other)]
    if len(shared) < _FEWEST:
        raise DataError(
            f"{names[0]} and {names[1]} share too few views of the board",
            found=len(shared),
            expected=f"{_FEWEST} or more",
        )
    if np.ptp(shared, axis=0).max() < _SHORTEST:
        raise DataError(
            "the board does not move, and its views say nothing about the time",
            advice="Move it to and fro, and turn it.",
        )
    spline = CubicSpline(seen, other[seen])
    is_seen = np.isfinite(other[:, 0, 0])
    frames = np.flatnonzero(np.isfinite(one[:, 0, 0]))

    def measure_misses(lag: float) -> FloatArray:
        times = frames + lag
        before, after = np.floor(times).astype(int), np.ceil(times).astype(int)
        rows = (before >= 0) & (after < len(other))
        # Nothing is interpolated over gaps.
        rows[rows] &= is_seen[before[rows]] & is_seen[after[rows]]
        if rows.sum() < _FEWEST:
            return np.full(1, np.inf)
        source, target = one[frames[rows]].reshape(-1, 3), spline(times[rows]).reshape(-1, 3)
        weights = np.ones(len(source))
        for _ in range(_ROUNDS):
            rotations, shifts, _ = estimate_rigid_transforms(source, target[None], weights)
            misses = np.linalg.norm(source @ rotations[0].T + shifts[0] - target, axis=1)
            weights = 1 / (1 + (misses / max(float(np.median(misses)), 1e-9)) ** 2)
        return np.asarray(misses)

    lags = np.arange(-longest, longest + _STEP / 2, _STEP)
    medians = [float(np.median(measure_misses(lag))) for lag in lags]
    best = int(np.argmin(medians))
    scale = max(medians[best], 1e-9)
    result = minimize_scalar(
        lambda lag: float(np.sqrt(1 + (measure_misses(lag) / scale) ** 2).mean()),
        bounds=(lags[best] - _STEP, lags[best] + _STEP),
        method="bounded",
    )
    return float(result.x)
