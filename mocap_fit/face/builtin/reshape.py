"""Heads of other sizes and proportions, by smooth warps of one."""

from __future__ import annotations

import numpy as np

from mocap_fit.errors import ConfigurationError
from mocap_fit.face.mesh import Mesh
from mocap_fit.tracks import FloatArray

_SMALLEST, _LARGEST = 0.5, 2.0
# The stretch of the lower face sets in over this length below the nose (mm).
_ONSET = 15.0
# Reach of the mouth's widening: across, up and down, forwards and back (mm).
_MOUTH_REACH = np.array([48.0, 30.0, 45.0])


def reshape_head(
    mesh: Mesh,
    *,
    width: float = 1.0,
    height: float = 1.0,
    depth: float = 1.0,
    lower_face: float = 1.0,
    mouth_width: float = 1.0,
    size: float = 1.0,
) -> Mesh:
    """Reshape a head to other proportions by smooth warps.

    The warps apply to every part, so teeth stay behind lips and lips stay closed; a
    mirror-symmetric head stays so.

    Parameters
    ----------
    mesh
        A head with the feature points 9.15 (base of the nose), 8.3 and 8.4 (corners of the mouth).
    width, height, depth
        Scale factor for the complete head along x, y or z, about the origin, 0.5 to 2.
    lower_face
        Scale factor for lengths below the nose, 0.5 to 2.
    mouth_width
        Scale factor for x about the mouth, fading out around it, 0.5 to 2.
    size
        Scale factor for everything, 0.5 to 2.

    Returns
    -------
    Mesh
        With the same triangles, parts, regions and feature points.

    Raises
    ------
    ConfigurationError
        If a factor is outside 0.5 to 2, or the mesh lacks one of the feature points.
    """
    factors = {
        "width": width,
        "height": height,
        "depth": depth,
        "lower_face": lower_face,
        "mouth_width": mouth_width,
        "size": size,
    }
    for name, factor in factors.items():
        if not _SMALLEST <= factor <= _LARGEST:
            raise ConfigurationError(
                f"a head cannot be reshaped with {name}={factor}",
                expected=f"{_SMALLEST} to {_LARGEST}",
            )
    vertices = mesh.vertices.copy()
    corners = mesh.vertices[[mesh.get_feature_point("8.3"), mesh.get_feature_point("8.4")]]
    vertices[:, 0] *= 1 + (mouth_width - 1) * _weigh_by_mouth(vertices, corners.mean(axis=0))
    nose_base = mesh.vertices[mesh.get_feature_point("9.15"), 1]
    vertices[:, 1] -= (lower_face - 1) * _measure_below(vertices[:, 1], nose_base)
    return mesh.replace_vertices(vertices * (size * np.array([width, height, depth])))


def _weigh_by_mouth(vertices: FloatArray, centre: FloatArray) -> FloatArray:
    away = (vertices - centre * [0.0, 1.0, 1.0]) / _MOUTH_REACH
    return np.asarray(np.exp(-(away**2).sum(axis=1)))


def _measure_below(y: FloatArray, start: float) -> FloatArray:
    """Return the length below a height, which sets in smoothly."""
    depth = np.maximum(start - y, 0.0)
    return np.asarray(np.where(depth < _ONSET, depth**2 / (2 * _ONSET), depth - _ONSET / 2))
