"""The skin's relief on the bare head: sockets, brows, cheeks, folds, chin and nose."""

from __future__ import annotations

import numpy as np

from mocap_fit.face.builtin import skull
from mocap_fit.face.builtin.nose import compute_nose_relief, compute_tuck
from mocap_fit.face.builtin.surfaces import (
    compute_bump,
    compute_hill,
    measure_path_distance,
    smoothstep,
)
from mocap_fit.tracks import FloatArray

# Hills and hollows along the radius: height (mm), centre (x, y), widths, turn.
_RADIAL = [
    (-5.6, (31, 65.5), (13, 9), 0.0),  # eye socket
    (-4.2, (15.5, 66), (6.0, 8.5), 0.0),  # its inner corner
    (1.6, (33, 52.9), (9, 3.5), 0.0),  # its lower rim
    (2.0, (28, 80.5), (16, 6.0), 0.06),  # brow ridge
    (1.3, (45, 76), (7, 7), 0.0),  # outer end of the brow
    (1.0, (0, 83), (9, 6), 0.0),  # between the brows
    (1.5, (24, 108), (20, 14), 0.0),  # forehead
    (-2.6, (66, 88), (9, 14), 0.0),  # temple
    (3.2, (46, 42.0), (15, 12), 0.35),  # cheek bone
    (2.2, (30, 36.0), (12, 11), 0.0),  # front of the cheek
    (-1.0, (50, 10), (14, 15), 0.0),  # hollow of the cheek
    (1.6, (60, -4), (10, 12), 0.0),  # angle of the jaw
    (1.2, (30, 8), (9, 13), 0.0),  # beside the mouth
]
# The same, forwards.
_FORWARD = [
    (3.2, (0, 6), (20, 15), 0.0),  # all of the mouth
    (-2.6, (0, -17.5), (15, 4.2), 0.0),  # fold above the chin
    (5.0, (0, -33), (12.5, 8.5), 0.0),  # chin
    (-1.0, (0, 15), (2.0, 5.0), 0.0),  # philtrum
    (0.55, (4.6, 14), (1.7, 5), 0.0),  # its ridges
    (-1.4, (27.5, -1.5), (3.2, 3.6), 0.0),  # dimple at the corner of the mouth
]
_NASOLABIAL_FOLD = [(17.5, 30.1), (22.0, 21.8), (27.5, 10.0), (31.0, -3.0), (31.5, -12.0)]
# Azimuth × 60 and height.
_JAW_EDGE = [(6.0, -48.0), (36.0, -38.0), (62.0, -22.0), (84.0, -6.0), (96.0, 24.0)]
_NECK_MUSCLE = [(125.0, 5.0), (84.0, -50.0), (20.0, -122.0)]


def shape_skin(azimuth: FloatArray, level: FloatArray) -> FloatArray:
    """Shape the skin of the left half of the head.

    Parameters
    ----------
    azimuth
        Azimuths on the bare head, ``(points,)``, radians, 0 (front) to π.
    level
        Levels on the bare head, ``(points,)``, millimetres along its surface.

    Returns
    -------
    ndarray
        Points of the skin, ``(points, 3)``, millimetres.
    """
    points = skull.compute_loft(azimuth, level)
    x, y = points[:, 0], points[:, 1]
    front = smoothstep((np.cos(azimuth) + 0.15) / 0.5)
    outwards = sum(
        h * compute_bump(x, y, c, w, t) for h, c, w, t in _RADIAL
    ) + _shape_nasolabial_fold(x, y)
    forwards = sum(
        h * compute_bump(x, y, c, w, t) for h, c, w, t in _FORWARD
    ) + compute_nose_relief(x, y)
    points[:, 0] += outwards * front * np.sin(0.9 * azimuth)
    points[:, 1] += compute_tuck(x, y) * front
    points[:, 2] += (outwards * np.cos(0.9 * azimuth) + forwards) * front
    # The muscle that runs down from behind the ear turns the neck from a tube into a neck.
    distance, _, position = measure_path_distance(60 * azimuth, y, _NECK_MUSCLE)
    beside = 2.6 * compute_hill(distance, 0, 8.0) * smoothstep(position / 0.25)
    # The edge of the jaw, and the hollow under it.
    distance, above, position = measure_path_distance(60 * azimuth, y, _JAW_EDGE)
    height = distance * above
    fade = np.sin(np.pi * np.clip(position, 0, 1)) ** 0.7
    beside += fade * (1.7 * compute_hill(height, 2.0, 6.5) - 2.2 * compute_hill(height, -11.0, 7.0))
    points[:, 0] += beside * np.sin(azimuth)
    points[:, 2] += beside * np.cos(azimuth)
    return points


def locate_skin(seen: FloatArray, axes: tuple[int, int] = (0, 1)) -> FloatArray:
    """Locate the points of the skin over points of the bare head that are seen from one side.

    Parameters
    ----------
    seen
        Where the points of the bare head are seen, ``(points, 2)``, millimetres.
    axes
        ``(0, 1)``: x and y, seen from the front. ``(2, 1)``: z and y, seen from the speaker's left.

    Returns
    -------
    ndarray
        Points of the skin, ``(points, 3)``, millimetres.
    """
    return shape_skin(*skull.locate(seen, axes))


def _shape_nasolabial_fold(x: FloatArray, y: FloatArray) -> FloatArray:
    distance, side, position = measure_path_distance(x, y, _NASOLABIAL_FOLD)
    fade = np.sin(np.pi * np.clip(position, 0.02, 1.0)) ** 0.6
    cheek = np.where(side > 0, 1.3 * distance / 5 * compute_hill(distance, 0, 6.5), 0.0)
    return np.asarray(fade * (cheek - 1.1 * compute_hill(distance, 0, 2.6)))
