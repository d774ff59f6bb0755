"""The ear: rings from the skin around it, over its rim, into its bowl."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicSpline

from mocap_fit.face.builtin.flesh import locate_skin
from mocap_fit.face.builtin.surfaces import compute_bump, compute_hill, smoothstep
from mocap_fit.tracks import FloatArray

EAR_POINTS = 32
_CENTRE = np.array([70.5, 49.0, -4.0])
# The ear stands off the head, more at its top than at its lobe, and leans back.
_FLARE, _FLARE_PER_MM = np.radians(27), np.radians(0.20)
_UPWARDS = np.array([0.13, np.cos(np.radians(9)), -np.sin(np.radians(9))])
_FACE_RINGS = (1.0, 0.96, 0.91, 0.85, 0.77, 0.68, 0.6, 0.52, 0.42, 0.3, 0.16)
# Outline of the rim: angle (degrees; 0 is back, 90 up, 180 front) and distance from the centre.
_OUTLINE_ANGLES = [0, 30, 60, 90, 120, 150, 180, 210, 240, 262, 283, 307, 335, 360]
_OUTLINE = [18.5, 22, 28, 30.5, 25, 16.5, 13, 14.5, 20, 27.5, 27.5, 20.5, 17.5, 18.5]


def trace_ear_outline() -> FloatArray:
    """Return where the left ear joins the head, seen from the left.

    Returns
    -------
    ndarray
        z and y, ``(points, 2)``, millimetres, counter-clockwise seen from outside: back, top,
        front, bottom.
    """
    angle = _list_angles()
    back, up = np.cos(angle), np.sin(angle)
    # Narrow where the ear stands off the head, just outside the rim where it lies on the cheek.
    narrow = 1 / np.hypot(back / 4.5, up / 24.0)
    share = smoothstep((0.20 - back) / 0.95)
    reach = narrow + share * (_compute_reach(angle) + 2.0 - narrow)
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
    face = [_build_face_ring(radius, base) for radius in _FACE_RINGS]
    rim = face[0]
    back = np.cos(_list_angles())
    behind = smoothstep((back + 0.35) / 0.9)[:, None]
    joint = []
    for share in (0.82, 0.55, 0.20):
        points = base * share + rim * (1 - share)
        # Behind the ear the skin first runs parallel to the rim, then dives to the head.
        joint.append(points - behind * np.array([4.4, 0.0, 2.2]) * (share * (1 - share)))
    return [base, *joint, *face]


def _list_angles() -> FloatArray:
    """Return the angles of the points of a ring."""
    return 2 * np.pi * np.arange(EAR_POINTS) / EAR_POINTS


def _compute_reach(angle: FloatArray) -> FloatArray:
    """Return the distance of the rim from the ear's centre."""
    rim = CubicSpline(np.radians(_OUTLINE_ANGLES), _OUTLINE, bc_type="periodic")
    return np.asarray(rim(angle))


def _build_face_ring(radius: float, base: FloatArray) -> FloatArray:
    """Build the ring of the outer face at a share of the way from the ear's middle to its rim."""
    angle = _list_angles()
    back, up = np.cos(angle), np.sin(angle)
    reach = _compute_reach(angle)
    front = smoothstep((-back - 0.15) / 0.7)
    lobe = smoothstep((-up - 0.55) / 0.35)
    across, along = reach * radius * back, reach * radius * up
    height = 4.0 - 7.0 * compute_bump(across, along, (-2.0, -4.0), (6.0, 8.0))  # the bowl
    fold = (1 - front) * (1 - lobe)
    at = np.full_like(up, radius)
    height += 2.6 * compute_hill(at, 0.58, 0.085) * fold * smoothstep((up + 1) / 0.6)
    height -= 1.8 * compute_hill(at, 0.78, 0.07) * fold
    height += 2.8 * compute_hill(at, 0.96, 0.07) * (1 - 0.6 * lobe) * (1 - front)
    height += 1.8 * compute_bump(across, along, (-4.5, -15), (2.8, 2.5))  # antitragus
    if radius < 0.95:  # root of the helix
        height += 2.2 * compute_hill(along, 7, 1.8) * smoothstep((-across - 1) / 6)
    flare = _FLARE + _FLARE_PER_MM * along
    sine, cosine, zero = np.sin(flare), np.cos(flare), np.zeros_like(flare)
    points = _CENTRE + np.outer(along, _UPWARDS)
    points += across[:, None] * np.stack([sine, zero, -cosine], axis=1)
    points += height[:, None] * np.stack([cosine, zero, sine], axis=1)
    # In front the ear has no rim: it runs out on the cheek.
    on_cheek = base + (1 - 0.90 * radius) * (base.mean(axis=0) - base)
    share = (front * smoothstep((at - 0.45) / 0.5))[:, None]
    points += share * (on_cheek - points)
    tragus = compute_bump(across, along, (-9.5, -3.5), (2.4, 4.0))
    return np.asarray(points + np.outer(tragus, [2.4, 0.0, -1.6]))
