"""The mouth: closed rings from the bag behind the lips to the skin around them.

Every ring has its vertices at the same angles round the mouth, so the strips between them are
regular. Only the left half of a ring is built: from its middle below, by way of the left corner,
to its middle above.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.interpolate import CubicSpline

from mocap_fit.face.builtin.flesh import locate_skin
from mocap_fit.face.builtin.surfaces import compute_hill, smoothstep
from mocap_fit.tracks import FloatArray

HALF_RING = 21
CORNER = 10
HALF_WIDTH = 24.5
# The lips almost touch at rest: each contact line stands this far from the line between them.
CONTACT_HALF_GAP = 0.04

# From the line where the lips meet back to their inner surface, and to the upper front teeth, which
# stand 2 mm behind it (mm).
_LIP_THICKNESS, _FRONT_TEETH = 3.7, 6.0
_ACROSS = np.array([-25.0, -20, -13, -5.2, 0, 5.2, 13, 20, 25])
_UPPER_BORDER = np.array([0.0, 3.1, 6.3, 8.6, 7.3, 8.6, 6.3, 3.1, 0])
_LOWER_BORDER = np.array([0.0, -3.9, -7.7, -9.8, -10.4, -9.8, -7.7, -3.9, 0])
_CONTACT_ACROSS = np.array([-25.0, -16, -7, 0, 7, 16, 25])
_CONTACT_LINE = np.array([-0.6, 0.35, 0.55, -0.35, 0.55, 0.35, -0.6])


# Rings of the bag from the throat to the fold behind the lips: x and depth of the cheek, height and
# depth of the middle above and below. Depths are behind the front teeth (mm).
_WALLS = [
    ((16.0, 68.0), (10.0, 66.0), (-16.0, 66.0)),
    ((25.0, 60.0), (19.0, 54.0), (-23.0, 56.0)),
    ((31.5, 47.0), (22.0, 36.0), (-24.0, 40.0)),
    ((30.6, 32.0), (21.0, 18.0), (-22.0, 22.0)),
    ((27.0, 19.0), (17.0, 4.0), (-19.0, 7.0)),
    ((24.5, 14.0), (13.0, -0.8), (-14.5, 1.0)),
]
# Share of red, green and blue light that reaches the back of the mouth, and how deep it is (mm).
_LIGHT_AT_THE_BACK = np.array([0.60, 0.53, 0.49])
_LIT_DEPTH = 34.0


@dataclass(frozen=True, eq=False)
class Ring:
    """The left half of one ring round the mouth.

    Parameters
    ----------
    kind
        ``bag``, ``inner_lip``, ``contact``, ``vermilion``, ``border`` or ``skin``.
    points
        From the middle below to the middle above, ``(HALF_RING, 3)``, millimetres.
    """

    kind: str
    points: FloatArray


@lru_cache(maxsize=1)
def _measure_contact_depths() -> tuple[FloatArray, FloatArray]:
    across = np.array([0.0, 5, 10, 15, 20, HALF_WIDTH])
    behind = np.array([0.9, 0.9, 0.9, 0.9, 1.2, 2.2])
    return across, locate_skin(np.stack([across, np.zeros(6)], axis=1))[:, 2] - behind


def compute_contact_depth(x: FloatArray) -> FloatArray:
    """Return the depth of the line where the lips meet.

    Parameters
    ----------
    x
        Positions across the face, ``(points,)``, millimetres.

    Returns
    -------
    ndarray
        z, ``(points,)``, millimetres.
    """
    return np.asarray(np.interp(np.abs(x), *_measure_contact_depths()))


def compute_front_depth() -> float:
    """Return the depth of the upper front teeth, which stand 2 mm behind the lips.

    Returns
    -------
    float
        z, millimetres.
    """
    return float(compute_contact_depth(np.zeros(1))[0]) - _FRONT_TEETH


def compute_shade(z: FloatArray) -> FloatArray:
    """Return the share of light that comes to a depth of the mouth.

    Parameters
    ----------
    z
        Depths, ``(points,)``, millimetres.

    Returns
    -------
    ndarray
        Red, green and blue, ``(points, 3)``, 0 to 1.
    """
    shade = smoothstep((compute_front_depth() - z[:, None]) / _LIT_DEPTH)
    return np.asarray(1 - shade * (1 - _LIGHT_AT_THE_BACK))


def build_mouth_rings() -> list[Ring]:
    """Build the left halves of all rings round the mouth.

    Returns
    -------
    list of Ring
        From the deepest to the outermost.
    """
    angle = np.pi * (np.arange(HALF_RING) - CORNER) / (2 * CORNER)
    side = np.sign(np.round(np.sin(angle), 12))
    # A little denser towards the corners.
    cosine = np.round(np.cos(angle), 12)
    shape_x = 25 * (0.82 * cosine + 0.18 * cosine**3)
    rise = 0.9 * (shape_x / 25) ** 3
    x = shape_x * HALF_WIDTH / 25
    border_y = rise + np.where(
        side > 0,
        CubicSpline(_ACROSS, _UPPER_BORDER)(shape_x),
        CubicSpline(_ACROSS, _LOWER_BORDER)(shape_x),
    )
    contact_y = rise + CubicSpline(_CONTACT_ACROSS, _CONTACT_LINE)(shape_x)
    border_y[CORNER] = contact_y[CORNER]
    corner_share = np.clip(shape_x / 25, 0.0, 1.0)
    fullness = np.sqrt(1 - corner_share**2)
    border = locate_skin(np.stack([x, border_y], axis=1))
    contact = np.stack([x, contact_y + side * CONTACT_HALF_GAP, compute_contact_depth(x)], axis=1)
    return [
        *_build_inner_rings(contact, side, fullness, corner_share),
        Ring("contact", contact),
        *_build_lip_rings(border, contact, side, fullness),
        Ring("border", border + np.outer(0.55 * fullness, [0.0, 0.0, 1.0])),
        *_build_outer_rings(border),
    ]


def _build_inner_rings(
    contact: FloatArray, side: FloatArray, fullness: FloatArray, corner_share: FloatArray
) -> list[Ring]:
    x, y, z = contact.T
    rings = [Ring("bag", _trace_wall(side, fullness, corner_share, *row)) for row in _WALLS]
    near = smoothstep(corner_share / 0.6)
    fall = np.where(side > 0, 0.4 * corner_share**4 - 1.22, -1.3 - 0.4 * near) * fullness
    thickness = _LIP_THICKNESS + (2.4 - 1.96 * corner_share) * near
    for wider, up, behind in (
        (1.01, side * 6.5 * fullness, thickness),
        # Both fall from where the lips meet, and one lies on the other there: no look comes in
        # between them from before or above, and the upper lip hides the teeth when the jaw slides
        # aside. (They do not overlap: a marker at a corner is tied to the nearer one.)
        (1.0, fall, np.full_like(x, 2.7)),
    ):
        points = np.stack([x * wider, y + up, z - behind], axis=1)
        rings.append(Ring("inner_lip", points))
    return rings


def _trace_wall(
    side: FloatArray,
    fullness: FloatArray,
    corner_share: FloatArray,
    cheek: tuple[float, float],
    above: tuple[float, float],
    below: tuple[float, float],
) -> FloatArray:
    """Return a ring of the bag through the cheek (x, z), and the middle above and below (y, z)."""
    upper = side > 0
    y = np.where(upper, above[0], below[0]) * fullness**0.9
    depth = compute_front_depth() - np.where(upper, above[1], below[1])
    z = compute_front_depth() - cheek[1]
    return np.stack([cheek[0] * corner_share**0.6, y, z + (depth - z) * fullness**2], axis=1)


def _build_lip_rings(
    border: FloatArray, contact: FloatArray, side: FloatArray, fullness: FloatArray
) -> list[Ring]:
    """Build the red of the lips, bulging forwards between the contact line and the border."""
    x = border[:, 0]
    upper = side > 0
    rings = []
    for share in (0.90, 0.70, 0.45, 0.22):
        points = border * (1 - share) + contact * share
        forwards = np.sin(np.pi * share**0.85) ** 0.9
        pads = np.where(upper, 0.7 * compute_hill(x, 0, 3.5), 0.45 * compute_hill(x, 6, 4))
        points[:, 1] += side * 0.9 * fullness * np.sin(np.pi * share) * np.where(upper, 0.5, 1.0)
        points[:, 2] += (np.where(upper, 2.5, 3.6) * fullness**1.2 + pads) * forwards
        rings.append(Ring("vermilion", points))
    return rings


def _build_outer_rings(border: FloatArray) -> list[Ring]:
    """Build the rings of skin at growing distances from the border of the lips."""
    outline = border[:, :2]
    mirrored = outline * [-1, 1]
    closed = np.concatenate([mirrored[1:2], outline, mirrored[-2:-1]])
    tangent = closed[2:] - closed[:-2]
    normal = _normalise(np.stack([tangent[:, 1], -tangent[:, 0]], axis=1))
    beyond = np.concatenate([normal[1:2] * [-1, 1], normal, normal[-2:-1] * [-1, 1]])
    normal = _normalise(0.5 * normal + 0.25 * (beyond[:-2] + beyond[2:]))
    normal[[0, -1], 0] = 0.0
    return [Ring("skin", locate_skin(outline + normal * distance)) for distance in (2.2, 5.2, 9.0)]


def _normalise(vectors: FloatArray) -> FloatArray:
    return np.asarray(vectors / np.linalg.norm(vectors, axis=1, keepdims=True))
