"""The hair: a cap of short hair, and single hairs on it and along the hairline."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from scipy.interpolate import PchipInterpolator

from mocap_fit.face.builtin import flesh, skull
from mocap_fit.face.builtin.strands import build_strands, scatter, spread_evenly
from mocap_fit.face.builtin.surfaces import (
    Colour,
    Mask,
    Piece,
    join_pieces,
    smoothstep,
    triangulate_fan,
    triangulate_strip,
)
from mocap_fit.tracks import FloatArray

HAIR: Colour = (0.25, 0.178, 0.125)
# Azimuth × 70 and height of the hairline, from the forehead over the temple, in front of the ear
# and behind it, to the nape.
HAIRLINE = [
    (0.0, 123.0),
    (17.5, 126.0),
    (35.0, 125.5),
    (52.5, 119.0),
    (66.5, 108.0),
    (79.0, 95.0),
    (84.0, 76.0),
    (86.5, 58.0),
    (94.5, 55.0),
    (98.0, 64.0),
    (104.0, 71.0),
    (114.0, 66.0),
    (122.0, 50.0),
    (138.0, 20.0),
    (168.0, 2.0),
    (224.0, -10.0),
]
_COLUMNS, _ROWS = 76, 15
_EDGE_HAIRS, _INNER_HAIRS = 600, 260
# What hair stands away from: about the middle of the head.
_CENTRE = np.array([0.0, 55.0, -8.0])
# By azimuth: thickness of the hair high on the head, mm, and the direction in which it lies,
# degrees: 0 to the back, 90 up, -90 down.
_THICKNESS = PchipInterpolator([0, 0.8, 1.5, 2.4, np.pi], [9.0, 8.0, 5.5, 6.0, 6.5])
_DIRECTION = PchipInterpolator([0, 0.5, 0.9, 1.2, 1.8, np.pi], [80, 60, 15, -62, -75, -88])
_LENGTH = PchipInterpolator([0, 0.6, 1.0, 1.3, 1.9, np.pi], [24, 21, 13, 7, 9, 9])
_AT_CROWN = 8.0
# The cap sets in this far inside the hairline, mm along the skin; single hairs reach beyond it.
_INSET = 2.5


@lru_cache(maxsize=1)
def _find_hairline_levels() -> PchipInterpolator:
    """Return the level of the hairline as a function of the azimuth."""
    path = np.array(HAIRLINE)
    levels = np.linspace(*skull.get_level_range(), 300)
    azimuths = np.minimum(path[:, 0] / 70, np.pi)
    line_levels = []
    for azimuth, height in zip(azimuths, path[:, 1], strict=True):
        heights = flesh.shape_skin(np.full(300, azimuth), levels)[:, 1]
        line_levels.append(np.interp(height, np.maximum.accumulate(heights), levels))
    return PchipInterpolator(azimuths, line_levels)


def measure_hair_depth(azimuth: FloatArray, level: FloatArray) -> FloatArray:
    """Measure how far inside the hairline points of the head are.

    Parameters
    ----------
    azimuth
        Azimuths on the bare head, ``(points,)``, radians, -π to π.
    level
        Levels on the bare head, ``(points,)``, millimetres along its surface.

    Returns
    -------
    ndarray
        ``(points,)``, millimetres, negative outside.
    """
    away = np.clip(np.abs(azimuth), 0, np.pi)
    line = _find_hairline_levels()
    # The line is steep at the temples: the distance from it is shorter than that along a meridian.
    slope = line(away, 1) / skull.compute_girth(np.asarray(level))
    return np.asarray((level - line(away)) / np.hypot(1.0, slope))


def is_under_hair(azimuth: FloatArray, level: FloatArray) -> Mask:
    """Return which points of the head the cap of hair hides.

    Parameters
    ----------
    azimuth
        Azimuths on the bare head, ``(points,)``, radians, -π to π.
    level
        Levels on the bare head, ``(points,)``, millimetres along its surface.

    Returns
    -------
    ndarray
        ``(points,)``.
    """
    return np.asarray(_compute_thickness(azimuth, level) > 1.5)


def build_hair() -> Piece:
    """Build the hair.

    Returns
    -------
    Piece
        The cap, and the single hairs.
    """
    return join_pieces([_build_cap(), _build_hairs()])


def _lift_off(azimuth: FloatArray, level: FloatArray, height: FloatArray) -> FloatArray:
    """Return points at a height over the skin."""
    points = flesh.shape_skin(np.abs(azimuth), level)
    points[:, 0] *= np.where(azimuth < 0, -1.0, 1.0)
    outwards = points - _CENTRE
    outwards /= np.linalg.norm(outwards, axis=1, keepdims=True)
    return np.asarray(points + height[:, None] * outwards)


def _compute_thickness(azimuth: FloatArray, level: FloatArray) -> FloatArray:
    """Return the thickness of the hair, which begins at the hairline."""
    depth = measure_hair_depth(azimuth, level) - _INSET
    onset = 13 + 10 * smoothstep((np.abs(azimuth) - 1.0) / 0.6)
    full = _THICKNESS(np.abs(azimuth)) * (1 - np.exp(-np.maximum(depth, 0) / onset))
    below_crown = skull.get_level_range()[1] - level
    full = full + (_AT_CROWN - full) * smoothstep(1 - below_crown / 70)
    return np.asarray(full - 0.8 * smoothstep(1 - depth / 3))


def _build_cap() -> Piece:
    """Build the cap: rings from the hairline up to the crown, with the furrows of hair."""
    around = 2 * np.pi * np.arange(_COLUMNS) / _COLUMNS - np.pi
    top = skull.get_level_range()[1] - 6.0
    low = _find_hairline_levels()(np.abs(around)) + 2.0
    share = np.linspace(0, 1, _ROWS)[:, None]
    level = (low + share * (top - low)).ravel()
    azimuth = np.tile(around, _ROWS)
    depth = measure_hair_depth(azimuth, level)
    streak = np.repeat(scatter(_COLUMNS, 22)[None], _ROWS, axis=0).ravel()
    furrow = scatter(_COLUMNS * _ROWS, 21) - 0.5
    furrow *= smoothstep((depth - 6) / 12) * smoothstep((top - level) / 30)
    # Nor is the edge a line.
    height = _compute_thickness(azimuth, level) + 1.1 * furrow
    height -= 1.3 * streak * smoothstep(1 - depth / 11)
    crown = skull.CROWN + np.array([0.0, _AT_CROWN, 0.0])
    vertices = np.concatenate([_lift_off(azimuth, level, height), crown[None]])
    index = np.arange(_COLUMNS * _ROWS).reshape(_ROWS, _COLUMNS)[:, ::-1]
    strips = [triangulate_strip(index[row + 1], index[row]) for row in range(_ROWS - 1)]
    fan = triangulate_fan(index[-1, ::-1], len(vertices) - 1)
    triangles = np.concatenate([*strips, fan])
    # Streaks that run with the hair.
    shade = 0.78 + 0.24 * streak + 0.25 * scatter(_COLUMNS * _ROWS, 23)
    return Piece(vertices, triangles, np.outer(np.append(shade, 0.9), HAIR))


def _build_hairs() -> Piece:
    """Build single hairs: most along the hairline, where they are seen one by one."""
    count = _EDGE_HAIRS + _INNER_HAIRS
    across, depth = spread_evenly(count).T
    # Denser in front.
    azimuth = np.pi * (2 * across - 1) * (0.62 + 0.38 * (2 * across - 1) ** 2)
    away = np.abs(azimuth)
    line, slope = _find_hairline_levels()(away), _find_hairline_levels()(away, 1)
    top = skull.get_level_range()[1] - 22.0
    at_edge = np.arange(count) < _EDGE_HAIRS
    inside = -2.5 + np.where(at_edge, 12.0 * depth**1.5, (top - line) * depth**1.5)
    level = line + inside * np.hypot(1.0, slope / skull.compute_girth(line))
    angle = np.radians(_DIRECTION(away)) + 0.55 * (scatter(count, 32) - 0.5)
    length = _LENGTH(away) * (0.55 + 0.6 * scatter(count, 33))
    side = np.where(azimuth < 0, -1.0, 1.0)
    points = []
    for share, lift in ((0.0, 0.0), (0.4, 0.7), (1.0, 0.4)):
        onwards = share * length
        there = np.minimum(level + onwards * np.sin(angle), top + 12.0)
        turned = azimuth + side * onwards * np.cos(angle) / skull.compute_girth(there)
        turned = np.clip(turned, -np.pi, np.pi)
        height = np.maximum(_compute_thickness(turned, there), 0.0) + lift
        points.append(_lift_off(turned, there, height))
    # None hangs over the ear.
    free = (away < 1.30) | (away > 1.85) | (inside > 12.0)
    shade = 0.75 + 0.5 * scatter(count, 34)
    width = 0.65 + 0.75 * np.clip(inside / 12, 0, 1)
    strands = [*points, points[1] - _CENTRE, width, np.outer(shade, HAIR)]
    return build_strands(*(each[free] for each in strands))
