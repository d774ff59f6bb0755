"""The ear: rings from the skin behind it, over its rim, into its bowl."""

from __future__ import annotations

import numpy as np

from mocap_fit.face.builtin.flesh import skin_at
from mocap_fit.face.builtin.surfaces import bump, hill, smoothstep
from mocap_fit.tracks import FloatArray

EAR_POINTS = 32
_CENTRE = np.array([70.0, 48.0, -4.0])
_FLARE = np.radians(28)
_TILT = np.radians(9)
# Across the ear backwards, along it upwards, and away from the head.
_BACKWARDS = np.array([np.sin(_FLARE), 0.0, -np.cos(_FLARE)])
_UPWARDS = np.array([0.05, np.cos(_TILT), -np.sin(_TILT)])
_OUTWARDS = np.array([np.cos(_FLARE), 0.0, np.sin(_FLARE)])
_FACE_RINGS = (1.0, 0.95, 0.9, 0.84, 0.76, 0.68, 0.6, 0.52, 0.42, 0.3, 0.16)


def ear_outline() -> FloatArray:
    """Where the left ear joins the head, seen from the left: `(points, 2)` of z and y.

    The order is counter-clockwise seen from outside: back, top, front, bottom.
    """
    angle = _angles()
    back, up = np.cos(angle), np.sin(angle)
    z = _CENTRE[2] - np.where(back > 0, 5.0, 14.5) * back - 3.0 * up
    y = _CENTRE[1] + np.where(up > 0, 24.0, 25.0) * up
    return np.stack([z, y], axis=1)


def ear_rings() -> list[FloatArray]:
    """Rings `(EAR_POINTS, 3)` from the skin to the bowl; the last is to be closed by a point."""
    base = skin_at(ear_outline(), (2, 1))
    face = [_face_ring(radius) for radius in _FACE_RINGS]
    rim = face[0]
    back = np.cos(_angles())
    behind = smoothstep((back + 0.45) / 0.9)[:, None]
    joint = []
    for share in (0.20, 0.55, 0.82):
        points = base * share + rim * (1 - share)
        # Behind the ear the skin first runs parallel to the rim, then dives to the head.
        points = points - behind * _OUTWARDS * (5.0 * share * (1 - share))
        joint.append(points)
    return [base, *joint[::-1], *face]


def _angles() -> FloatArray:
    return 2 * np.pi * np.arange(EAR_POINTS) / EAR_POINTS


def _face_ring(radius: float) -> FloatArray:
    """The outer face of the ear at a share of the way from its middle to its rim."""
    angle = _angles()
    back, up = np.cos(angle), np.sin(angle)
    reach = 1 / np.hypot(back / np.where(back > 0, 19.0, 13.5), up / 31.0)
    front = smoothstep((-back - 0.2) / 0.7)
    lobe = smoothstep((-up - 0.55) / 0.35)
    across = reach * radius * back * (1 + 0.10 * up * radius - 0.20 * lobe * radius)
    along = reach * radius * up
    height = 4.5 - 7.5 * bump(across, along, (-2.0, -4.0), (6.0, 7.4))  # the bowl
    fold = (1 - front) * (1 - lobe)
    height += 2.6 * hill(np.full_like(up, radius), 0.60, 0.078) * fold * smoothstep((up + 1) / 0.6)
    height -= 1.6 * hill(np.full_like(up, radius), 0.79, 0.064) * fold
    height += (
        3.0 * hill(np.full_like(up, radius), 0.96, 0.064) * (1 - 0.75 * lobe) * (1 - 0.8 * front)
    )
    height += 3.8 * bump(across, along, (-10.5, -3.5), (2.1, 3.5))  # tragus
    height += 2.0 * bump(across, along, (-4.5, -15), (2.5, 2.3))  # antitragus
    if radius < 0.95:  # root of the helix
        height += 2.4 * hill(along, 6, 1.6) * smoothstep((-across - 1) / 6)
    height += 1.5 * lobe * radius - 2.5 * front * radius
    return np.asarray(
        _CENTRE
        + across[:, None] * _BACKWARDS
        + along[:, None] * _UPWARDS
        + height[:, None] * _OUTWARDS
    )
