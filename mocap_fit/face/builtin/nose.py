"""The nose: how far it stands out, and its two nostrils."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import PchipInterpolator

from mocap_fit.face.builtin import skull
from mocap_fit.face.builtin.surfaces import bump, hill, smoothstep
from mocap_fit.tracks import FloatArray

TIP_HEIGHT = 30.5
BASE_HEIGHT = 20.0
NOSTRIL_POINTS = 14
# Where a nostril opens, seen from the front (mm).
_NOSTRIL_CENTRE = np.array([6.6, 23.4])
_NOSTRIL_AXES = np.array([2.7, 1.35])
_NOSTRIL_TURN = 0.35

_PROFILE_HEIGHTS = [92, 84, 76, 70, 62, 54, 46, 40, 35, 31, 28, 25.5, 23.5, 21.5, 19]
_PROFILE_DEPTHS = [
    97.5, 98.3, 96.6, 96.6, 99.8, 104.3, 109.3, 113.3, 116.6, 118.4, 118.5, 117.2, 114.2, 109.0,
    104.3,
]  # fmt: skip
_WIDTH_HEIGHTS = [15, 20, 22, 24, 27, 30, 34, 40, 50, 60, 70, 78, 90]
_HALF_WIDTHS = [6, 6.5, 7.5, 9.5, 12.0, 13.4, 14.6, 15.6, 16.0, 14.6, 12.2, 12, 15]


def nose_relief(x: FloatArray, y: FloatArray) -> FloatArray:
    """How far the nose stands out forwards at x, y of the bare head (mm)."""
    profile = PchipInterpolator(_PROFILE_HEIGHTS[::-1], _PROFILE_DEPTHS[::-1])
    half_width = PchipInterpolator(_WIDTH_HEIGHTS, _HALF_WIDTHS)(np.clip(y, 15, 90))
    near = (y > 14) & (y < 94) & (x < 30)
    height = np.where(
        near, profile(np.clip(y, 19, 92)) - skull.midline_depth(np.clip(y, 12, 96)), 0.0
    )
    height *= np.where(y < 19, smoothstep((y - 14) / 5), 1.0)
    height *= np.where(y > 84, smoothstep((94 - y) / 10), 1.0)
    across = np.clip(x / half_width, 0.0, 1.0)
    bridge = 0.62 * np.cos(0.5 * np.pi * across) ** 2 + 0.38 * (1 - across**2) ** 1.5
    ball = (1 - across**2.3) ** 1.6
    share = 0.6 * hill(y, TIP_HEIGHT, 5.5)
    wings = 7.6 * bump(x, y, (11.8, 27.4), (3.5, 4.0))
    wings += 2.2 * bump(x, y, (10.5, 33), (4.5, 5)) - 0.9 * bump(x, y, (17.4, 28.5), (1.8, 5.0))
    return np.asarray(
        height * (bridge * (1 - share) + ball * share) + wings * smoothstep((y - 19.5) / 4.5)
    )


def tuck(x: FloatArray, y: FloatArray) -> FloatArray:
    """How far the underside of the nose is lifted, so that the nostrils face down (mm)."""
    return np.asarray(0.9 * bump(x, y, (0, 21.6), (13, 1.7)) * smoothstep((16 - x) / 6))


def nostril_outline() -> FloatArray:
    """The rim of the left nostril seen from the front, `(points, 2)`, counter-clockwise."""
    angle = 2 * np.pi * np.arange(NOSTRIL_POINTS) / NOSTRIL_POINTS
    along, across = _NOSTRIL_AXES[:, None] * np.stack([np.cos(angle), np.sin(angle)])
    cosine, sine = np.cos(_NOSTRIL_TURN), np.sin(_NOSTRIL_TURN)
    return _NOSTRIL_CENTRE + np.stack(
        [cosine * along - sine * across, sine * along + cosine * across], axis=1
    )


def nostril_tunnel(rim: FloatArray) -> list[FloatArray]:
    """Rings from the rim inwards, up into the nose; the last is to be closed by a point."""
    inwards = np.array([0.0, 0.80, -0.60])
    centre = rim.mean(axis=0)
    return [
        centre + (rim - centre) * width + inwards * depth
        for width, depth in ((1.0, 1.4), (0.95, 4.0), (0.6, 7.5))
    ]
