"""The eyelids, as rings of skin round the eye, and the eyeballs."""

from __future__ import annotations

import numpy as np

from mocap_fit.face.builtin.flesh import skin_at
from mocap_fit.face.builtin.surfaces import Colour, Piece, joined, painted, strip_triangles
from mocap_fit.tracks import FloatArray

LID_POINTS = 28
CENTRE = np.array([31.0, 66.5, 73.0])
RADIUS = 12.3
# The white of the eye is a little wider than it is deep, so that the corners of the lids reach it.
_AXES = np.array([17.2, 14.2, RADIUS])
_MARGIN_RING = 2

_WHITE: Colour = (0.93, 0.92, 0.90)
_IRIS_OUTER: Colour = (0.22, 0.33, 0.38)
_IRIS_INNER: Colour = (0.42, 0.55, 0.58)
_LIMBUS: Colour = (0.12, 0.18, 0.22)
_PUPIL: Colour = (0.02, 0.02, 0.03)


def lid_margin(angle: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The lids' edge about the eye's centre; angle 0 at the outer corner, π/2 above."""
    cosine, sine = np.cos(angle), np.sin(angle)
    x = np.where(cosine > 0, 14.2, 15.2) * cosine
    upper = 4.7 * (1 - np.clip(np.abs((x + 1.5) / np.where(x > -1.5, 15.9, 13.9)), 0, 1) ** 2.1)
    lower = 4.1 * (1 - np.clip(np.abs((x - 2.0) / np.where(x > 2.0, 12.4, 17.4)), 0, 1) ** 2.0)
    y = np.where(sine > 0, upper, -lower) * (np.abs(sine) > 1e-9) + x / 15
    return x, y


def lid_rings() -> list[FloatArray]:
    """Rings of the left eye's lids, each `(LID_POINTS, 3)`, from behind the lid to the socket."""
    angle = 2 * np.pi * np.arange(LID_POINTS) / LID_POINTS
    cosine, sine = np.cos(angle), np.sin(angle)
    x, y = lid_margin(angle)
    upper = sine > 1e-9

    def on_ball(across: FloatArray, up: FloatArray, above: float) -> FloatArray:
        inside = 1 - (across / 17.6) ** 2 - (up / 14.5) ** 2
        return (RADIUS + above) * np.sqrt(np.clip(inside, 0.02, 1))

    def ring(across: FloatArray, up: FloatArray, forward: FloatArray) -> FloatArray:
        return CENTRE + np.stack([across, up, forward], axis=1)

    rings = [
        ring(x * 0.97, y * 0.94, on_ball(x, y, 1.3) - 3.0),
        ring(x, y, on_ball(x, y, 0.5)),
        ring(x * 1.01, y + 0.25 * sine, on_ball(x, y, 1.6)),
    ]
    for distance, share in ((1.2, 0.06), (2.8, 0.22), (5.2, 0.55), (8.6, 1.0)):
        reach = np.where(cosine < 0, 0.72, 1.0 if distance < 6 else 0.9)
        across = x + distance * cosine * reach
        up = y + distance * sine * np.where(upper, 1.15, 1.0)
        lid = ring(across, up, np.maximum(on_ball(across, up, 1.7), 2.0))
        points = lid * (1 - share) + skin_at(CENTRE[:2] + np.stack([across, up], axis=1)) * share
        if distance == 2.8:  # the crease of the upper lid
            points[:, 2] -= np.where(upper, 1.5 * sine, 0.2)
        if distance == 5.2:
            points[:, 2] += np.where(upper, 1.6 * sine, -0.3)
        rings.append(points)
    return rings


def eyeball() -> Piece:
    """The left eye: white, iris with a dark rim, pupil."""
    return joined([_white(), *_iris()])


def _white() -> Piece:
    angle = 2 * np.pi * np.arange(LID_POINTS) / LID_POINTS
    x, y = lid_margin(angle)
    share = np.linspace(0.02, 1.06, 8)[:, None]
    across, up = x * share, y * share * (1 + 0.12 * share)
    inside = 1 - (across / _AXES[0]) ** 2 - (up / _AXES[1]) ** 2
    forward = _AXES[2] * np.sqrt(np.clip(inside, 0, 1)) - 0.05
    return _rings_piece(CENTRE + np.stack([across, up, forward], axis=2), [_WHITE] * 8)


def _iris() -> list[Piece]:
    layers = [
        (0.11, [0.50, 0.455], [_LIMBUS, _LIMBUS]),
        (0.12, [0.46, 0.37, 0.28, 0.19], [_IRIS_OUTER, _IRIS_OUTER, _IRIS_INNER, _IRIS_OUTER]),
        (0.14, [0.20, 0.10, 0.001], [_PUPIL] * 3),
    ]
    around = 2 * np.pi * np.arange(32) / 32
    pieces = []
    for above, angles, colours in layers:
        polar = np.asarray(angles)[:, None]
        direction = np.stack(
            np.broadcast_arrays(
                np.sin(polar) * np.cos(around), np.sin(polar) * np.sin(around), np.cos(polar)
            ),
            axis=2,
        )
        surface = direction / np.linalg.norm(direction / _AXES, axis=2, keepdims=True)
        normal = surface / _AXES**2
        normal /= np.linalg.norm(normal, axis=2, keepdims=True)
        pieces.append(_rings_piece(CENTRE + surface + above * normal, colours))
    return pieces


def _rings_piece(rings: FloatArray, colours: list[Colour]) -> Piece:
    """Rings, each counter-clockwise, `(rings, points, 3)`, as a piece."""
    count, points = rings.shape[:2]
    order = range(count - 1) if _extent(rings[0]) > _extent(rings[-1]) else range(count - 1, 0, -1)
    step = 1 if order.step > 0 else -1
    index = np.arange(count * points).reshape(count, points)
    triangles = np.concatenate([strip_triangles(index[i], index[i + step]) for i in order])
    piece = painted(rings.reshape(-1, 3), triangles, colours[0])
    piece.colours[:] = np.repeat(np.asarray(colours), points, axis=0)
    return piece


def _extent(ring: FloatArray) -> float:
    return float(np.ptp(ring[:, 0]))
