"""The head without its features: a smooth loft from the neck to the crown.

A point of the loft has an azimuth (0 in front, π/2 at the speaker's left, π behind) and a level
(mm along the surface, upwards). Everything else is modelled on it. Only the left half is built;
the right half is its mirror image.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from scipy.interpolate import CubicSpline, PchipInterpolator
from scipy.spatial import cKDTree

from mocap_fit.tracks import FloatArray

# One closed section a row, from the neck up. Height of its front, side and back; depth of the
# front; half width, and the depth where it is widest; depth of the back; and how square the front
# half is (2 is an ellipse).
_SECTIONS = np.array(
    [
        [-128, -116, -92, 38, 72, -16, -72, 2],
        [-100, -86, -62, 40, 53, -16, -65, 2],
        [-77, -58, -38, 43, 45.5, -14, -62, 2],
        [-62, -37, -18, 53, 47.5, -10, -63, 1.98],
        [-56, -25, -3, 73, 51, -4, -68, 1.9],
        [-47, -15, 9, 88, 55, 0, -73, 1.86],
        [-34, 0, 22.7, 93.5, 59.5, 3, -79, 1.86],
        [-18, 15, 35.5, 95, 63.5, 3, -84, 1.9],
        [0, 30.1, 47.4, 97, 66.5, 1, -88, 1.96],
        [21.8, 43.8, 58.4, 98, 68.5, -1, -91, 2.02],
        [42.8, 56.6, 71, 96, 70, -4, -93, 2.08],
        [64, 73, 84, 95, 71.5, -7, -94, 2.15],
        [83, 88, 96, 96.5, 73.5, -11, -93, 2.2],
        [102, 105, 109, 95.5, 74, -14, -91, 2.15],
        [122, 122, 124, 89, 72, -15, -86.5, 2.1],
        [142, 141, 141, 75, 65, -15, -76.5, 2.1],
        [158, 157, 158, 53, 50.5, -13, -61, 2],
        [169, 168, 169, 30, 32.5, -11, -43, 2],
        [174, 174, 174, 6, 12.5, -9, -22, 2],
    ],
    dtype=np.float64,
)
_EASE = 0.3
CROWN = np.array([0.0, 175.3, -8.0])


@lru_cache(maxsize=1)
def _interpolate_sections() -> CubicSpline:
    front, side = _SECTIONS[:, [0, 3]], _SECTIONS[:, [1, 4]]
    lengths = [np.linalg.norm(np.diff(curve, axis=0), axis=1) for curve in (front, side)]
    levels = np.concatenate([[0.0], np.cumsum(0.5 * (lengths[0] + lengths[1]))])
    return CubicSpline(levels, _SECTIONS, axis=0)


def get_level_range() -> tuple[float, float]:
    """Return the level of the neck's lower rim, and of the crown.

    Returns
    -------
    low, high
        Millimetres along the surface.
    """
    knots = _interpolate_sections().x
    return float(knots[0]), float(knots[-1])


def get_section_level(index: int) -> float:
    """Return the level of one of the modelled sections.

    Parameters
    ----------
    index
        Number of the section, counted from the neck up.

    Returns
    -------
    float
        Millimetres along the surface.
    """
    return float(_interpolate_sections().x[index])


def compute_loft(azimuth: FloatArray, level: FloatArray) -> FloatArray:
    """Compute points of the bare head.

    Parameters
    ----------
    azimuth
        ``(points,)``, radians, 0 (front) to π.
    level
        ``(points,)``, millimetres along the surface.

    Returns
    -------
    ndarray
        ``(points, 3)``, millimetres.
    """
    front_y, side_y, back_y, front_z, half_width, side_z, back_z, squareness = (
        _interpolate_sections()(level).T
    )
    cosine, sine = np.cos(azimuth), np.sin(azimuth)
    # Only the front half is squarer or more pointed than an ellipse.
    share = np.clip((cosine + 0.25) / 0.5, 0.0, 1.0)
    share = share * share * (3.0 - 2.0 * share)
    exponent = 2.0 / squareness * share + (1.0 - share)
    # A power of the sine alone would leave a crease in the middle of the face.
    ease = ((sine**2 + _EASE**2) / (1 + _EASE**2)) ** ((exponent - 1) / 2)
    x = half_width * np.maximum(sine, 0.0) * ease
    forward = np.abs(cosine)
    z = np.where(
        cosine >= 0.0,
        side_z + (front_z - side_z) * forward**exponent,
        side_z - (side_z - back_z) * forward,
    )
    y = side_y - 0.5 * (back_y - front_y) * cosine
    y += (0.5 * (front_y + back_y) - side_y) * cosine**2
    return np.stack([x, y, z], axis=-1)


def compute_girth(level: FloatArray) -> FloatArray:
    """Return the mean radius of the section at a level: azimuth × girth is a length.

    Parameters
    ----------
    level
        ``(points,)``, millimetres along the surface.

    Returns
    -------
    ndarray
        ``(points,)``, millimetres.
    """
    section = _interpolate_sections()(level)
    return np.asarray(0.5 * (section[..., 4] + 0.5 * (section[..., 3] - section[..., 6])))


@lru_cache(maxsize=1)
def _interpolate_front() -> PchipInterpolator:
    levels = np.linspace(*get_level_range(), 400)
    middle = compute_loft(np.zeros(400), levels)
    rising = middle[:, 1] > np.concatenate([[-np.inf], np.maximum.accumulate(middle[:-1, 1])])
    return PchipInterpolator(middle[rising, 1], middle[rising, 2])


def compute_midline_depth(y: FloatArray) -> FloatArray:
    """Return the depth of the bare head in the middle of the face.

    Parameters
    ----------
    y
        Heights, ``(points,)``, millimetres.

    Returns
    -------
    ndarray
        z, ``(points,)``, millimetres.
    """
    return np.asarray(_interpolate_front()(y))


@lru_cache(maxsize=2)
def _index_view(axes: tuple[int, int]) -> tuple[cKDTree, FloatArray]:
    """Return a search tree of the loft as seen from the front (x, y) or from the side (z, y)."""
    span = (0.0, 85.0) if axes == (0, 1) else (25.0, 155.0)
    azimuth, level = np.meshgrid(
        np.radians(np.linspace(*span, 131)), np.linspace(*get_level_range(), 400)
    )
    parameters = np.stack([azimuth.ravel(), level.ravel()], axis=1)
    return cKDTree(compute_loft(*parameters.T)[:, axes]), parameters


def locate(seen: FloatArray, axes: tuple[int, int] = (0, 1)) -> tuple[FloatArray, FloatArray]:
    """Find azimuth and level of points of the bare head that are seen from one side.

    Parameters
    ----------
    seen
        Where they are seen, ``(points, 2)``, millimetres; x not negative.
    axes
        ``(0, 1)``: x and y, seen from the front. ``(2, 1)``: z and y, seen from the speaker's left.

    Returns
    -------
    azimuth, level
        ``(points,)`` each, radians and millimetres, by Newton's method.
    """
    tree, parameters = _index_view(axes)
    located = parameters[tree.query(seen)[1]].copy()
    small = np.array([1e-5, 1e-3])
    for _ in range(8):
        here = compute_loft(*located.T)[:, axes]
        azimuth, level = located.T
        by_azimuth = (compute_loft(azimuth + small[0], level)[:, axes] - here) / small[0]
        by_level = (compute_loft(azimuth, level + small[1])[:, axes] - here) / small[1]
        # Newton's step, by Cramer's rule.
        (a, c), (b, d), (e, f) = by_azimuth.T, by_level.T, (seen - here).T
        determinant = a * d - b * c
        located[:, 0] += np.clip((e * d - b * f) / determinant, -0.1, 0.1)
        located[:, 1] += np.clip((a * f - e * c) / determinant, -5.0, 5.0)
        located[:, 0] = np.clip(located[:, 0], 0.0, np.pi)
    if axes == (0, 1):
        located[np.abs(seen[:, 0]) < 1e-9, 0] = 0.0
    return located[:, 0], located[:, 1]
