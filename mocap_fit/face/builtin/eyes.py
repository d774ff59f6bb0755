"""The eyelids, as rings of skin round the eye, and the eyeballs."""

from __future__ import annotations

import numpy as np

from mocap_fit.face.builtin.flesh import locate_skin
from mocap_fit.face.builtin.strands import build_strands, scatter
from mocap_fit.face.builtin.surfaces import (
    Colour,
    Piece,
    smoothstep,
    triangulate_fan,
    triangulate_strip,
)
from mocap_fit.tracks import FloatArray

LID_POINTS = 28
CENTRE = np.array([31.0, 62.5, 73.8])
RADIUS = 12.3
# The white of the eye is a little wider than it is deep, so that the corners of the lids reach it.
_AXES = np.array([17.2, 14.2, RADIUS])
_MARGIN_RING = 2

# Where the gaze meets the ball: a little above its middle.
_GAZE_RISE = 0.35
IRIS_RADIUS = 5.8
_PUPIL_RADIUS = 1.9
_EYE_POINTS = 40
# How far the cornea stands out from the ball, and how far round it reaches.
_CORNEA_HEIGHT, _CORNEA_RADIUS = 1.15, 6.6
# The lids are open by this much more than what lies around them is long.
_OPENING = 1.08
# Radii of the rings of the ball, from the middle of the pupil, and the colour of each.
_PUPIL: Colour = (0.015, 0.013, 0.013)
_COLLARETTE: Colour = (0.40, 0.33, 0.22)
_IRIS: Colour = (0.27, 0.37, 0.40)
_IRIS_RIM: Colour = (0.19, 0.27, 0.31)
_LIMBUS: Colour = (0.075, 0.095, 0.11)
_WHITE: Colour = (0.84, 0.815, 0.79)
_RINGS: tuple[tuple[float, Colour], ...] = (
    (0.7, _PUPIL),
    (1.3, _PUPIL),
    (_PUPIL_RADIUS, _PUPIL),
    (_PUPIL_RADIUS + 0.22, _COLLARETTE),
    (2.7, _COLLARETTE),
    (3.2, _IRIS),
    (3.8, _IRIS),
    (4.4, _IRIS),
    (4.95, _IRIS_RIM),
    (5.35, _LIMBUS),
    (IRIS_RADIUS, (0.44, 0.43, 0.42)),
)
# How far the white goes on behind the lids.
_BEHIND_LIDS = 0.8
_LASH: Colour = (0.10, 0.07, 0.055)
_LASHES = 42


def trace_lid_margin(angle: FloatArray, opening: float = 1.0) -> tuple[FloatArray, FloatArray]:
    """Return the edge of the left lids about the eye's centre.

    Parameters
    ----------
    angle
        Angles round the eye, ``(points,)``, radians: 0 at the outer corner, π/2 above.
    opening
        Height of the opening between the lids, no unit: 1 is that of lids at ease.

    Returns
    -------
    x, y
        From the eye's centre, ``(points,)`` each, millimetres.
    """
    cosine, sine = np.cos(angle), np.sin(angle)
    x = np.where(cosine > 0, 14.2, 15.2) * cosine
    upper = 4.7 * (1 - np.clip(np.abs((x + 1.5) / np.where(x > -1.5, 15.9, 13.9)), 0, 1) ** 2.1)
    lower = 4.4 * (1 - np.clip(np.abs((x - 2.0) / np.where(x > 2.0, 12.4, 17.4)), 0, 1) ** 2.0)
    y = opening * np.where(sine > 0, upper, -lower) * (np.abs(sine) > 1e-9) + x / 15
    return x, y


def build_lid_rings() -> list[FloatArray]:
    """Build the rings of the left lids, from behind the lid to the eye socket.

    Returns
    -------
    list of ndarray
        Rings ``(LID_POINTS, 3)``, millimetres.
    """
    angle = 2 * np.pi * np.arange(LID_POINTS) / LID_POINTS
    cosine, sine = np.cos(angle), np.sin(angle)
    x, y = trace_lid_margin(angle, _OPENING)
    upper = sine > 1e-9

    def project_on_ball(across: FloatArray, up: FloatArray, above: float) -> FloatArray:
        inside = 1 - (across / 17.6) ** 2 - (up / 14.5) ** 2
        return (RADIUS + above) * np.sqrt(np.clip(inside, 0.02, 1))

    def place_ring(across: FloatArray, up: FloatArray, forward: FloatArray) -> FloatArray:
        return CENTRE + np.stack([across, up, forward], axis=1)

    rings = [
        place_ring(x * 0.97, y * 0.94, project_on_ball(x, y, 1.3) - 5.0),
        place_ring(x, y, project_on_ball(x, y, 0.6)),
        place_ring(x * 1.01, y + 0.25 * sine, project_on_ball(x, y, 1.7)),
    ]
    for distance, share in ((1.2, 0.06), (2.8, 0.22), (5.2, 0.55), (8.6, 1.0)):
        reach = np.where(cosine < 0, 0.72, 1.0 if distance < 6 else 0.9)
        across = x + distance * cosine * reach
        # The socket does not open with the lids.
        up = trace_lid_margin(angle, 1 + (_OPENING - 1) * (1 - share))[1]
        up = up + distance * sine * np.where(upper, 1.15, 1.0)
        lid = place_ring(across, up, np.maximum(project_on_ball(across, up, 1.7), 2.0))
        points = (
            lid * (1 - share) + locate_skin(CENTRE[:2] + np.stack([across, up], axis=1)) * share
        )
        if distance == 2.8:  # the crease of the upper lid
            points[:, 2] -= np.where(upper, 1.5 * sine, 0.2)
        if distance == 5.2:
            points[:, 2] += np.where(upper, 1.6 * sine, -0.3)
        rings.append(points)
    return rings


def build_eyeball() -> Piece:
    """Build the left eye: pupil, iris and cornea, all of them round, and the white round them.

    Returns
    -------
    Piece
        Rings from the middle of the pupil to behind the lids.
    """
    around = 2 * np.pi * np.arange(_EYE_POINTS) / _EYE_POINTS
    circle = np.stack([np.cos(around), np.sin(around)], axis=1)
    gaze = np.array([0.0, _GAZE_RISE])
    x, y = trace_lid_margin(around, _OPENING)
    border = np.stack([1.05 * x, y + _BEHIND_LIDS * circle[:, 1]], axis=1) - gaze
    # Where lids cover the iris, the white is hidden, and no more than an edge of it.
    distance = np.hypot(*border.T)[:, None]
    border = gaze + border * np.maximum(IRIS_RADIUS + 0.45, distance) / distance
    rings = [gaze + radius * circle for radius, _ in _RINGS]
    rings += [rings[-1] * (1 - share) + border * share for share in (0.15, 0.4, 0.7, 1.0)]
    flat = np.concatenate([gaze[None], *rings])
    from_gaze = np.hypot(*(flat - gaze).T)
    bulge = _CORNEA_HEIGHT * np.clip(1 - (from_gaze / _CORNEA_RADIUS) ** 2, 0, 1) ** 1.5
    depth = _AXES[2] * np.sqrt(np.clip(1 - ((flat / _AXES[:2]) ** 2).sum(axis=1), 0, 1)) + bulge
    colours = np.repeat(
        [_PUPIL, *(colour for _, colour in _RINGS), *[_WHITE] * 4],
        [1, *[_EYE_POINTS] * len(rings)],
        axis=0,
    )
    index = 1 + np.arange(len(flat) - 1).reshape(len(rings), _EYE_POINTS)
    strips = [triangulate_strip(index[i + 1], index[i]) for i in range(len(rings) - 1)]
    triangles = np.concatenate([triangulate_fan(index[0], 0), *strips])
    vertices = CENTRE + np.column_stack([flat, depth])
    return Piece(vertices, triangles, _shade_ball(flat, from_gaze, colours))


def _shade_ball(flat: FloatArray, from_gaze: FloatArray, colours: FloatArray) -> FloatArray:
    """Return the ball's colours with the fibres of the iris, red corners and the lids' shadow."""
    across, up = flat.T
    angle = np.arctan2(up - _GAZE_RISE, across)
    on_iris = (from_gaze > _PUPIL_RADIUS + 0.1) & (from_gaze < IRIS_RADIUS - 0.2)
    fibres = 0.10 * np.cos(13 * angle + from_gaze) + 0.09 * np.cos(20 * angle - 1.5 * from_gaze)
    colours = colours * (1 + np.where(on_iris, fibres, 0.0))[:, None]
    red = smoothstep((np.abs(across) - 7.5) / 7)[:, None]
    colours = colours * (1 - red * np.array([0.06, 0.20, 0.20]))
    corner = smoothstep((-across - 11.5) / 2.0)[:, None]  # the caruncle
    colours += corner * (np.array([0.70, 0.44, 0.41]) - colours)
    shade = 1 - 0.50 * smoothstep((up - 0.8) / 4.4) - 0.12 * smoothstep((-1.5 - up) / 4)
    return np.clip(colours * shade[:, None], 0, 1)


def build_lashes() -> Piece:
    """Build the left upper lashes: single hairs on the edge of the lid.

    Returns
    -------
    Piece
        Hairs from the inner corner of the eye to the outer one.
    """
    ring = build_lid_rings()[_MARGIN_RING]
    position = np.linspace(LID_POINTS / 2 - 1.6, 0.8, _LASHES)
    root = np.stack([np.interp(position, np.arange(len(ring)), axis) for axis in ring.T], axis=1)
    share = (root[:, 0] - root[0, 0]) / (root[-1, 0] - root[0, 0])
    length = 5.4 * np.sin(np.pi * (0.14 + 0.74 * share)) * (0.5 + 0.5 * share)
    length *= 0.8 + 0.4 * scatter(_LASHES, 3)
    fan = 0.9 * (share - 0.42) + 0.25 * (scatter(_LASHES, 5) - 0.5)

    def grow(start: FloatArray, aside: float, up: float, forwards: float) -> FloatArray:
        towards = np.stack([aside * fan, np.full(_LASHES, up), np.full(_LASHES, forwards)], axis=1)
        return np.asarray(start + 0.5 * length[:, None] * towards)

    root += [0.0, -0.15, -0.1]
    middle = grow(root, 1.0, 0.0, 0.95)
    tip = grow(middle, 0.7, 0.5, 0.8)
    normal = np.tile([0.0, 0.8, 0.6], (_LASHES, 1))
    return build_strands(root, middle, tip, normal, 0.26, np.tile(_LASH, (_LASHES, 1)))
