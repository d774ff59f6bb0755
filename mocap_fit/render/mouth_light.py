"""The light that comes between the lips to what is behind them."""

from __future__ import annotations

import numpy as np

from mocap_fit.face.lips import find_lip_contours, has_lip_line
from mocap_fit.face.mesh import IndexArray, Mesh
from mocap_fit.tracks import FloatArray

_PARTS = ("teeth_upper", "teeth_lower", "gums_upper", "gums_lower", "tongue")
_BAG = ("mouth_bag_upper", "mouth_bag_lower")
_LIPS = "wet_lip"
# Red, green and blue light that walls pass on to where the lips hide the outside when they are open
# so far (mm), and the share of it when they are closed. The rest grows with the part of the outside
# that is seen; walls make it count for more than its size.
_LEAST = np.array([0.28, 0.19, 0.175])
_LEAST_ON_LIPS = np.array([0.62, 0.50, 0.48])
_WIDE_OPEN, _CLOSED = 10.0, 0.3
_GAIN, _POWER = 2.6, 0.62
# Over this distance (mm) what is far from the middle sees the mouth's opening from the middle.
_SIDEWAYS = 28.0


class MouthLight:
    """The light in the mouth of a face.

    Parameters
    ----------
    mesh
        The face at rest. Light is full everywhere if it does not say where its lips meet.
    """

    def __init__(self, mesh: Mesh) -> None:
        self._count = len(mesh.vertices)
        names = [name for name in (*_PARTS, *_BAG, _LIPS) if mesh.has_region(name)]
        inside = [mesh.get_region(name) for name in names] if has_lip_line(mesh) else []
        self._inside: IndexArray = np.unique(np.concatenate([np.zeros(0, dtype=np.int64), *inside]))
        if self._inside.size:
            self._upper, self._lower = find_lip_contours(mesh)
            lips = mesh.regions.get(_LIPS, np.zeros(0, dtype=np.int64))
            self._on_lips = np.isin(self._inside, lips)[:, None]

    def compute(self, vertices: FloatArray) -> FloatArray:
        """Compute the light that reaches each vertex.

        What is behind the lips sees a part of the outside: the angles that the opening takes up and
        down, and from side to side, as shares of a half circle.

        Parameters
        ----------
        vertices
            The mesh in some shape, ``(vertices, 3)``, millimetres in the head frame.

        Returns
        -------
        ndarray
            Red, green and blue, ``(vertices, 3)``, 0 to 1.
        """
        light = np.ones((self._count, 3))
        if not self._inside.size:
            return light
        upper, lower = vertices[self._upper], vertices[self._lower]
        x, y, z = vertices[self._inside].T
        right, left = upper[0, 0], upper[-1, 0]
        top, bottom = _measure_opening(x, upper, lower)
        # The opening leans back when the jaw is down.
        share = np.clip((y - bottom[0]) / np.maximum(top[0] - bottom[0], 0.1), 0.0, 1.0)
        depth = np.maximum(bottom[1] + share * (top[1] - bottom[1]) - z, 0.0)
        middle = 0.5 * (left + right)
        seen_at = middle + (x - middle) / (1 + depth / _SIDEWAYS)
        top, bottom = _measure_opening(seen_at, upper, lower)
        away = np.maximum(depth, 0.1)
        height = np.arctan((np.maximum(top[0], bottom[0]) - y) / away)
        height -= np.arctan((bottom[0] - y) / away)
        width = np.pi
        if left > right:
            width = np.arctan((left - x) / away) - np.arctan((right - x) / away)
        seen = np.clip(_GAIN * height * width / np.pi**2, 0.0, 1.0) ** _POWER
        seen = np.where(depth > 0, seen, 1.0)[:, None]
        opening = np.clip((upper[:, 1].max() - lower[:, 1].min()) / _WIDE_OPEN, 0.0, 1.0)
        walls = _LEAST * (_CLOSED + (1 - _CLOSED) * opening)
        least = np.where(self._on_lips, _LEAST_ON_LIPS, walls)
        light[self._inside] = least + (1 - least) * seen
        return light


def _measure_opening(x: FloatArray, upper: FloatArray, lower: FloatArray) -> list[FloatArray]:
    """Return y and z of the upper and of the lower lip at positions across the mouth."""
    return [
        np.stack([np.interp(x, lip[:, 0], lip[:, axis]) for axis in (1, 2)])
        for lip in (upper, lower)
    ]
