"""The nose: how far it stands out, and its two nostrils."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import PchipInterpolator

from mocap_fit.face.builtin import skull
from mocap_fit.face.builtin.surfaces import compute_bump, compute_hill, smoothstep
from mocap_fit.tracks import FloatArray

NOSTRIL_POINTS = 14
# Where a nostril opens, seen from the front (mm).
_NOSTRIL_CENTRE = np.array([6.6, 23.0])
_NOSTRIL_AXES = np.array([2.7, 1.35])
_NOSTRIL_TURN = 0.35

# The profile, from the base to between the brows: heights, and the depth at each.
_PROFILE_HEIGHTS = [19, 21.4, 23.4, 25.4, 27.8, 30.5, 33.7, 38.3, 44, 51, 58.4, 66, 72, 80, 88]
_PROFILE = [104.0, 107.6, 112.0, 114.8, 116.0, 115.6, 113.8, 110.8, 107.4, 103.4, 99.8]
_PROFILE += [97.2, 97.0, 98.3, 97.5]
# Heights, and half the width at each.
_WIDTH_HEIGHTS = [15, 20, 21.8, 23.7, 26.4, 29.1, 32.8, 38.3, 47.4, 56.6, 66, 74, 86]
_WIDTHS = [6, 6.5, 7.5, 9.5, 12.0, 13.6, 14.6, 15.0, 15.0, 13.8, 12.0, 12.5, 16]


def compute_nose_relief(x: FloatArray, y: FloatArray) -> FloatArray:
    """Return how far the nose stands out forwards from the bare head.

    Parameters
    ----------
    x, y
        Points of the bare head seen from the front, ``(points,)`` each, millimetres; x not
        negative.

    Returns
    -------
    ndarray
        Along z, ``(points,)``, millimetres.
    """
    profile = PchipInterpolator(_PROFILE_HEIGHTS, _PROFILE)
    half_width = PchipInterpolator(_WIDTH_HEIGHTS, _WIDTHS)(np.clip(y, 15, 86))
    near = (y > 14) & (y < 90) & (x < 30)
    height = np.where(
        near, profile(np.clip(y, 19, 88)) - skull.compute_midline_depth(np.clip(y, 12, 92)), 0.0
    )
    height *= np.where(y < 19, smoothstep((y - 14) / 5), 1.0)
    height *= np.where(y > 78, smoothstep((90 - y) / 12), 1.0)
    across = np.clip(x / half_width, 0.0, 1.0)
    bridge = 0.75 * np.cos(0.5 * np.pi * across) ** 2 + 0.25 * (1 - across**2) ** 1.5
    ball = (1 - across**2.3) ** 1.6
    share = 0.6 * compute_hill(y, 29.0, 5.5)
    wings = 7.4 * compute_bump(x, y, (11.6, 26.4), (3.6, 3.9))
    wings += 2.0 * compute_bump(x, y, (10.5, 32), (4.5, 5)) - 0.9 * compute_bump(
        x, y, (17.4, 27.5), (1.8, 5.0)
    )
    return np.asarray(
        height * (bridge * (1 - share) + ball * share) + wings * smoothstep((y - 19.2) / 4.5)
    )


def compute_tuck(x: FloatArray, y: FloatArray) -> FloatArray:
    """Return how far the underside of the nose is lifted, so that the nostrils face down.

    Parameters
    ----------
    x, y
        Points of the bare head seen from the front, ``(points,)`` each, millimetres.

    Returns
    -------
    ndarray
        Along y, ``(points,)``, millimetres.
    """
    return np.asarray(0.9 * compute_bump(x, y, (0, 21.6), (13, 1.7)) * smoothstep((16 - x) / 6))


def trace_nostril() -> FloatArray:
    """Return the rim of the left nostril, seen from the front.

    Returns
    -------
    ndarray
        x and y, ``(NOSTRIL_POINTS, 2)``, millimetres, counter-clockwise.
    """
    angle = 2 * np.pi * np.arange(NOSTRIL_POINTS) / NOSTRIL_POINTS
    along, across = _NOSTRIL_AXES[:, None] * np.stack([np.cos(angle), np.sin(angle)])
    cosine, sine = np.cos(_NOSTRIL_TURN), np.sin(_NOSTRIL_TURN)
    turned = [cosine * along - sine * across, sine * along + cosine * across]
    return np.asarray(_NOSTRIL_CENTRE + np.stack(turned, axis=1))


def build_nostril_tunnel(rim: FloatArray) -> list[FloatArray]:
    """Build the rings from a nostril's rim inwards, up into the nose.

    Parameters
    ----------
    rim
        The rim, ``(points, 3)``, millimetres.

    Returns
    -------
    list of ndarray
        Rings ``(points, 3)``, millimetres; the last is to be closed by a point.
    """
    inwards = np.array([0.0, 0.80, -0.60])
    centre = rim.mean(axis=0)
    return [
        centre + (rim - centre) * width + inwards * depth
        for width, depth in ((1.0, 1.4), (0.95, 4.0), (0.6, 7.5))
    ]
