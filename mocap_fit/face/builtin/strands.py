"""Hairs, one by one: narrow pieces of surface that end in a point."""

from __future__ import annotations

import numpy as np

from mocap_fit.face.builtin.surfaces import Piece
from mocap_fit.tracks import FloatArray

# The side length of the next smaller cube in a plane that grows by the plastic number; multiples of
# these numbers fill a square evenly (Roberts, "The unreasonable effectiveness of quasirandom
# sequences", 2018).
_PLASTIC = 1.32471795724474602596
# One triangle to the middle of a hair, one to its tip.
_TRIANGLES = np.array([[0, 2, 1], [1, 2, 3]])


def spread_evenly(count: int) -> FloatArray:
    """Spread points evenly over a square, without a pattern.

    Parameters
    ----------
    count
        Number of points.

    Returns
    -------
    ndarray
        ``(count, 2)``, 0 to 1, the same every time.
    """
    steps = np.arange(1, count + 1)[:, None]
    return np.asarray((0.5 + steps / _PLASTIC ** np.array([1.0, 2.0])) % 1.0)


def scatter(count: int, stream: int) -> FloatArray:
    """Scatter numbers between 0 and 1, the same every time and on every machine.

    Parameters
    ----------
    count
        How many.
    stream
        Another one gives other numbers.

    Returns
    -------
    ndarray
        ``(count,)``, 0 to 1.
    """
    return np.random.default_rng(stream).random(count)


def build_strands(
    root: FloatArray,
    middle: FloatArray,
    tip: FloatArray,
    normal: FloatArray,
    width: FloatArray | float,
    colours: FloatArray,
) -> Piece:
    """Build hairs, each pointed at its root and its tip, and widest in the middle.

    Parameters
    ----------
    root, middle, tip
        Points of each hair, ``(hairs, 3)``, millimetres.
    normal
        Direction in which each hair shows its flat side, ``(hairs, 3)``, any length.
    width
        Width in the middle, ``(hairs,)`` or one for all, millimetres.
    colours
        Red, green and blue of each hair, ``(hairs, 3)``, 0 to 1.

    Returns
    -------
    Piece
        Four vertices a hair, counter-clockwise seen from where the normal points.
    """
    aside = np.cross(tip - root, normal)
    aside *= np.reshape(0.5 * np.asarray(width), (-1, 1)) / np.linalg.norm(aside, axis=1)[:, None]
    points = [root, middle - aside, middle + aside, tip]
    starts = len(points) * np.arange(len(root))[:, None, None]
    return Piece(
        np.stack(points, axis=1).reshape(-1, 3),
        (_TRIANGLES + starts).reshape(-1, 3),
        np.repeat(colours, len(points), axis=0),
    )
