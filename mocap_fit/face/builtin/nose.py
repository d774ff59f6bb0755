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

# The profile, from between the brows to the base: height and depth.
_PROFILE = np.array(
    [
        [88, 97.5],
        [80, 98.3],
        [72, 97.0],
        [66, 97.2],
        [58.4, 99.8],
        [51, 103.4],
        [44, 107.4],
        [38.3, 110.8],
        [33.7, 113.8],
        [30.5, 115.6],
        [27.8, 116.0],
        [25.4, 114.8],
        [23.4, 112.0],
        [21.4, 107.6],
        [19, 104.0],
    ]
)
# Half the width at each height.
_WIDTHS = np.array(
    [
        [15, 6],
        [20, 6.5],
        [21.8, 7.5],
        [23.7, 9.5],
        [26.4, 12.0],
        [29.1, 13.6],
        [32.8, 14.6],
        [38.3, 15.0],
        [47.4, 15.0],
        [56.6, 13.8],
        [66, 12.0],
        [74, 12.5],
        [86, 16],
    ]
)


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
    profile = PchipInterpolator(*_PROFILE[::-1].T)
    half_width = PchipInterpolator(*_WIDTHS.T)(np.clip(y, 15, 86))
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
