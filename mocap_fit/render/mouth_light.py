"""The light that comes between the lips to what is behind them."""

from __future__ import annotations

import numpy as np

from mocap_fit.face.lips import find_lip_contours, has_lip_line
from mocap_fit.face.mesh import IndexArray, Mesh
from mocap_fit.tracks import FloatArray

_PARTS = ("teeth_upper", "teeth_lower", "gums_upper", "gums_lower", "tongue")
_REGIONS = ("mouth_bag_upper", "mouth_bag_lower", "mouth_floor", "mouth_roof")
# Share of the light that there is even where the lips hide the outside; light that walls pass on
# makes what is seen of the outside count for more than its size.
_LEAST, _POWER = 0.06, 0.55
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
        names = [name for name in (*_PARTS, *_REGIONS) if mesh.has_region(name)]
        inside = [mesh.get_region(name) for name in names] if has_lip_line(mesh) else []
        self._inside: IndexArray = np.unique(np.concatenate([np.zeros(0, dtype=np.int64), *inside]))
        if self._inside.size:
            self._upper, self._lower = find_lip_contours(mesh)

    def compute(self, vertices: FloatArray) -> FloatArray:
        """Compute the share of light that reaches each vertex.

        What is behind the lips sees a part of the outside: the angles that the opening takes up and
        down, and from side to side, as shares of a half circle.

        Parameters
        ----------
        vertices
            The mesh in some shape, ``(vertices, 3)``, millimetres in the head frame.

        Returns
        -------
        ndarray
            ``(vertices,)``, 0 to 1.
        """
        light = np.ones(self._count)
        if not self._inside.size:
            return light
        upper, lower = vertices[self._upper], vertices[self._lower]
        x, y, z = vertices[self._inside].T
        right, left = upper[0, 0], upper[-1, 0]
        middle = 0.5 * (left + right)
        front = np.interp(x, upper[:, 0], np.maximum(upper[:, 2], lower[:, 2]))
        depth = np.maximum(front - z, 0.1)
        seen_at = middle + (x - middle) / (1 + depth / _SIDEWAYS)
        top, bottom = (np.interp(seen_at, lip[:, 0], lip[:, 1]) for lip in (upper, lower))
        height = np.arctan((np.maximum(top, bottom) - y) / depth) - np.arctan((bottom - y) / depth)
        width = np.pi
        if left > right:
            width = np.arctan((left - x) / depth) - np.arctan((right - x) / depth)
        visible = np.clip(height * width / np.pi**2, 0.0, 1.0) ** _POWER
        light[self._inside] = np.where(front > z, _LEAST + (1 - _LEAST) * visible, 1.0)
        return light
