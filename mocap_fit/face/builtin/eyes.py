"""The eyelids, as rings of skin round the eye, and the eyeballs."""

from __future__ import annotations

import numpy as np

from mocap_fit.face.builtin.flesh import locate_skin
from mocap_fit.face.builtin.surfaces import (
    Colour,
    Piece,
    join_pieces,
    paint_piece,
    smoothstep,
    triangulate_grid,
    triangulate_strip,
)
from mocap_fit.tracks import FloatArray

LID_POINTS = 28
CENTRE = np.array([31.0, 62.5, 73.8])
RADIUS = 12.3
# The white of the eye is a little wider than it is deep, so that the corners of the lids reach it.
_AXES = np.array([17.2, 14.2, RADIUS])
_MARGIN_RING = 2

_IRIS_RADIUS = 5.9
_IRIS_POINTS = 40
# A relaxed gaze: the upper lid covers more of the iris than the lower.
_GAZE_RISE = 0.5

_WHITE: Colour = (0.93, 0.92, 0.90)
_IRIS_OUTER: Colour = (0.22, 0.33, 0.38)
_IRIS_INNER: Colour = (0.42, 0.55, 0.58)
_LIMBUS: Colour = (0.12, 0.18, 0.22)
_PUPIL: Colour = (0.02, 0.02, 0.03)
_LIGHT: Colour = (1.0, 1.0, 1.0)
_LASH: Colour = (0.10, 0.07, 0.06)


def trace_lid_margin(angle: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the edge of the left lids about the eye's centre.

    Parameters
    ----------
    angle
        Angles round the eye, ``(points,)``, radians: 0 at the outer corner, π/2 above.

    Returns
    -------
    x, y
        From the eye's centre, ``(points,)`` each, millimetres.
    """
    cosine, sine = np.cos(angle), np.sin(angle)
    x = np.where(cosine > 0, 14.2, 15.2) * cosine
    upper = 4.7 * (1 - np.clip(np.abs((x + 1.5) / np.where(x > -1.5, 15.9, 13.9)), 0, 1) ** 2.1)
    lower = 4.4 * (1 - np.clip(np.abs((x - 2.0) / np.where(x > 2.0, 12.4, 17.4)), 0, 1) ** 2.0)
    y = np.where(sine > 0, upper, -lower) * (np.abs(sine) > 1e-9) + x / 15
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
    x, y = trace_lid_margin(angle)
    upper = sine > 1e-9

    def project_on_ball(across: FloatArray, up: FloatArray, above: float) -> FloatArray:
        inside = 1 - (across / 17.6) ** 2 - (up / 14.5) ** 2
        return (RADIUS + above) * np.sqrt(np.clip(inside, 0.02, 1))

    def place_ring(across: FloatArray, up: FloatArray, forward: FloatArray) -> FloatArray:
        return CENTRE + np.stack([across, up, forward], axis=1)

    rings = [
        place_ring(x * 0.97, y * 0.94, project_on_ball(x, y, 1.3) - 3.0),
        place_ring(x, y, project_on_ball(x, y, 0.5)),
        place_ring(x * 1.01, y + 0.25 * sine, project_on_ball(x, y, 1.6)),
    ]
    for distance, share in ((1.2, 0.06), (2.8, 0.22), (5.2, 0.55), (8.6, 1.0)):
        reach = np.where(cosine < 0, 0.72, 1.0 if distance < 6 else 0.9)
        across = x + distance * cosine * reach
        up = y + distance * sine * np.where(upper, 1.15, 1.0)
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
    """Build the left eye: white, iris with a dark rim, pupil, and the light of a window.

    The light is straight above the pupil, so that the two eyes mirror each other.

    Returns
    -------
    Piece
        The white and the discs before it.
    """
    layers = [
        _build_disc(_IRIS_RADIUS, _IRIS_RADIUS - 0.55, 2, 0.06, [_LIMBUS, _LIMBUS]),
        _build_disc(
            _IRIS_RADIUS - 0.5, 2.3, 4, 0.10, [_IRIS_OUTER, _IRIS_OUTER, _IRIS_INNER, _IRIS_OUTER]
        ),
        _build_disc(2.45, 0.05, 3, 0.16, [_PUPIL] * 3),
        _build_disc(0.95, 0.05, 2, 0.34, [_LIGHT] * 2, (0.0, 2.7)),
    ]
    return join_pieces([_build_white(), *layers])


def build_lashes() -> Piece:
    """Build the left upper lashes: a thin dark fringe on the edge of the lid.

    Returns
    -------
    Piece
        Three rows of vertices, from the lid to the tips.
    """
    margin = build_lid_rings()[_MARGIN_RING][1 : LID_POINTS // 2][::-1]
    share = np.linspace(0, 1, len(margin))
    length = 2.6 * np.sin(np.pi * (0.12 + 0.80 * share)) * (0.45 + 0.55 * share)
    fan = np.stack([0.9 * (share - 0.42), 0.25 + 0 * share, 0.8 + 0 * share], axis=1)
    tip = margin + length[:, None] * fan
    middle = 0.5 * (margin + tip) - np.array([0.0, 0.35, 0.0])
    rows = np.concatenate([margin + np.array([0.0, -0.25, 0.05]), middle, tip])
    return paint_piece(rows, triangulate_grid(3, len(margin))[:, ::-1], _LASH)


def _build_white() -> Piece:
    angle = 2 * np.pi * np.arange(LID_POINTS) / LID_POINTS
    x, y = trace_lid_margin(angle)
    share = np.linspace(1.06, 0.02, 8)[:, None]
    across, up = x * share, y * share * (1 + 0.12 * share)
    rings = np.stack([across, up, _compute_depth(across, up) - 0.05], axis=2)
    piece = _join_rings(rings, [_WHITE] * 8)
    # The lid shades the ball, and the corners are a little red.
    shade = 1 - 0.30 * smoothstep((rings[..., 1] - 0.5) / 5).ravel()
    red = smoothstep((np.abs(rings[..., 0]) - 8) / 7).ravel()[:, None]
    return Piece(
        piece.vertices,
        piece.triangles,
        piece.colours * shade[:, None] * (1 - red * np.array([0.05, 0.22, 0.22])),
    )


def _compute_depth(across: FloatArray, up: FloatArray) -> FloatArray:
    inside = 1 - (across / _AXES[0]) ** 2 - (up / _AXES[1]) ** 2
    return np.asarray(_AXES[2] * np.sqrt(np.clip(inside, 0, 1)))


def _build_disc(
    outer: float,
    inner: float,
    rings: int,
    above: float,
    colours: list[Colour],
    centre: tuple[float, float] = (0.0, 0.0),
) -> Piece:
    """Build rings of the iris or pupil on the bulge of the cornea."""
    around = 2 * np.pi * np.arange(_IRIS_POINTS) / _IRIS_POINTS
    radius = np.linspace(outer, inner, rings)[:, None]
    across = centre[0] + radius * np.cos(around)
    up = centre[1] + radius * np.sin(around)
    bulge = 0.5 * np.clip(1 - (across**2 + up**2) / _IRIS_RADIUS**2, 0, 1)
    rise = up + _GAZE_RISE
    points = np.stack([across, rise, _compute_depth(across, rise) + bulge + above], axis=2)
    piece = _join_rings(points, colours)
    # Fibres of the iris.
    fibres = 1 + 0.10 * np.tile(np.cos(13 * around) + np.cos(5 * around + 1), rings)
    with_fibres = np.clip(piece.colours * fibres[:, None], 0, 1)
    return Piece(piece.vertices, piece.triangles, with_fibres)


def _join_rings(rings: FloatArray, colours: list[Colour]) -> Piece:
    """Join rings about the eye's centre, counter-clockwise, from the outermost, to a piece."""
    count, points = rings.shape[:2]
    index = np.arange(count * points).reshape(count, points)
    triangles = [triangulate_strip(index[i], index[i + 1]) for i in range(count - 1)]
    return Piece(
        CENTRE + rings.reshape(-1, 3),
        np.concatenate(triangles),
        np.repeat(np.asarray(colours, dtype=np.float64), points, axis=0),
    )
