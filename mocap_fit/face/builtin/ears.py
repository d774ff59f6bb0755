"""The ear: rings from the skin around it, over its rim, into its bowl."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.interpolate import CubicSpline

from mocap_fit.face.builtin.flesh import locate_skin
from mocap_fit.face.builtin.surfaces import (
    compute_bump,
    compute_hill,
    measure_path_distance,
    smoothstep,
)
from mocap_fit.tracks import FloatArray

EAR_POINTS = 32
_CENTRE = np.array([70.5, 49.0, -4.0])
# The ear stands off the head, more at its top than at its lobe, and leans back.
_FLARE, _FLARE_PER_MM = np.radians(24), np.radians(0.28)
_UPWARDS = np.array([0.13, np.cos(np.radians(9)), -np.sin(np.radians(9))])
_FACE_RINGS = (1.0, 0.975, 0.93, 0.87, 0.80, 0.72, 0.63, 0.53, 0.42, 0.30, 0.16)
# Outline of the rim: angle (degrees; 0 is back, 90 up, 180 front) and distance from the centre.
_OUTLINE_ANGLES = [0, 30, 60, 90, 120, 150, 180, 210, 237, 258, 278, 298, 318, 340, 360]
_OUTLINE = [18.5, 22.5, 28, 30.5, 25, 16.5, 13, 14.5, 20.5, 26.5, 28, 24.5, 20, 18, 18.5]
# The same of where it joins the cheek, without the rounding of the lobe.
_JOINT = (
    [0, 30, 60, 90, 120, 150, 180, 210, 240, 262, 283, 307, 335, 360],
    [18.5, 22, 28, 30.5, 25, 16.5, 13, 14.5, 20, 27.5, 27.5, 20.5, 17.5, 18.5],
)
# Ridges and grooves of the outer face: height (mm), width (mm) and path (to the back, up).
_FOLDS: tuple[tuple[float, float, list[tuple[float, float]]], ...] = (
    # Antihelix, with its upper and its lower leg.
    (4.2, 2.3, [(0.5, -14.0), (6.0, -11.5), (9.5, -4.0), (9.8, 3.0), (7.5, 9.5), (3.5, 15.5)]),
    (2.0, 2.2, [(3.5, 15.5), (0.0, 21.5)]),
    (3.0, 1.9, [(7.5, 9.0), (1.0, 10.5), (-5.0, 9.0)]),
    # Root of the helix, in the bowl.
    (3.0, 1.9, [(2.5, -0.5), (-3.5, 2.0), (-9.0, 6.5)]),
    # The groove between helix and antihelix.
    (-2.6, 1.8, [(9.5, -14.0), (14.0, -5.0), (14.4, 4.0), (12.0, 13.0), (6.5, 20.5), (-1.0, 25.0)]),
)
# The same for hills and hollows: height, middle and widths.
_HILLS: tuple[tuple[float, tuple[float, float], tuple[float, float]], ...] = (
    (-10.5, (0.5, -6.0), (5.4, 5.2)),  # the bowl, below the root of the helix
    (-6.0, (1.0, 5.0), (5.0, 2.6)),  # and above it
    (-2.6, (-1.5, 16.0), (3.0, 3.2)),  # between the legs of the antihelix
    (3.4, (0.0, -14.5), (2.8, 2.2)),  # antitragus
    (1.4, (1.0, -21.5), (6.0, 4.5)),  # lobe
)


def trace_ear_outline() -> FloatArray:
    """Return where the left ear joins the head, seen from the left.

    Returns
    -------
    ndarray
        z and y, ``(points, 2)``, millimetres, counter-clockwise seen from outside: back, top,
        front, bottom.
    """
    angle = _list_angles(EAR_POINTS)
    back, up = np.cos(angle), np.sin(angle)
    # Narrow where the ear stands off the head, just outside the rim where it lies on the cheek.
    narrow = 1 / np.hypot(back / 4.5, up / 24.0)
    share = smoothstep((0.20 - back) / 0.95)
    reach = narrow + share * (_compute_reach(angle, *_JOINT) + 2.0 - narrow)
    along = reach * up
    z = _CENTRE[2] - 0.9 * reach * back + _UPWARDS[2] * along
    return np.stack([z, _CENTRE[1] + _UPWARDS[1] * along], axis=1)


def build_ear_rings() -> list[FloatArray]:
    """Build the rings of the left ear, from the skin over its rim into its bowl.

    Returns
    -------
    list of ndarray
        Rings ``(EAR_POINTS, 3)``, millimetres; the last is to be closed by a point.
    """
    base = locate_skin(trace_ear_outline(), (2, 1))
    # From here inwards there are twice as many points.
    finer = np.empty((2 * EAR_POINTS, 3))
    finer[::2], finer[1::2] = base, 0.5 * (base + np.roll(base, -1, axis=0))
    face = [_build_face_ring(radius, finer) for radius in _FACE_RINGS]
    rim = face[0]
    joint = []
    for share, points in ((0.82, 2), (0.55, 1), (0.20, 1)):
        # Behind the ear the skin first runs parallel to the rim, then dives to the head.
        behind = smoothstep((np.cos(_list_angles(2 * EAR_POINTS)) + 0.35) / 0.9)[:, None]
        ring = finer * share + rim * (1 - share)
        ring -= behind * np.array([4.4, 0.0, 2.2]) * (share * (1 - share))
        joint.append(ring[::points])
    return [base, *joint, *face]


def _list_angles(count: int) -> FloatArray:
    """Return the angles of the points of a ring."""
    return 2 * np.pi * np.arange(count) / count


def _compute_reach(
    angle: FloatArray, angles: Sequence[float] = _OUTLINE_ANGLES, reach: Sequence[float] = _OUTLINE
) -> FloatArray:
    """Return the distance of the rim from the ear's centre."""
    rim = CubicSpline(np.radians(angles), reach, bc_type="periodic")
    return np.asarray(rim(angle))


def _shape_face(across: FloatArray, along: FloatArray, radius: float) -> FloatArray:
    """Return the relief of the outer face: folds, hills and the rolled rim."""
    height = np.full_like(across, 4.0)
    for fold, width, path in _FOLDS:
        height += fold * compute_hill(measure_path_distance(across, along, path)[0], 0.0, width)
    for hill, centre, widths in _HILLS:
        height += hill * compute_bump(across, along, centre, widths)
    # The helix is rolled from its root in front over the top to above the lobe.
    angle = np.arctan2(along, across)
    rolled = smoothstep((angle + 1.15) / 0.5) * smoothstep((2.75 - angle) / 0.5)
    return np.asarray(
        height + rolled * 2.6 * compute_hill(np.full_like(across, radius), 0.935, 0.05)
    )


def _build_face_ring(radius: float, base: FloatArray) -> FloatArray:
    """Build the ring of the outer face at a share of the way from the ear's middle to its rim."""
    angle = _list_angles(len(base))
    back, up = np.cos(angle), np.sin(angle)
    reach = _compute_reach(angle)
    front = smoothstep((-back - 0.15) / 0.7) * (1 - smoothstep((up - 0.35) / 0.4))
    across, along = reach * radius * back, reach * radius * up
    height = _shape_face(across, along, radius)
    flare = _FLARE + _FLARE_PER_MM * along
    sine, cosine, zero = np.sin(flare), np.cos(flare), np.zeros_like(flare)
    points = _CENTRE + np.outer(along, _UPWARDS)
    points += across[:, None] * np.stack([sine, zero, -cosine], axis=1)
    points += height[:, None] * np.stack([cosine, zero, sine], axis=1)
    # In front the ear has no rim: it runs out on the cheek.
    on_cheek = base + (1 - 0.90 * radius) * (base.mean(axis=0) - base)
    share = (front * smoothstep((np.full_like(up, radius) - 0.45) / 0.5))[:, None]
    points += share * (on_cheek - points)
    tragus = compute_bump(across, along, (-9.0, -4.5), (2.2, 3.4))
    return np.asarray(points + np.outer(tragus, [3.4, 0.0, -2.4]))
