"""How far the lips are apart: in the middle, and along the whole line from corner to corner."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from mocap_fit.errors import DataError
from mocap_fit.face.mesh import IndexArray, Mesh
from mocap_fit.face.rig import Rig, deform_points
from mocap_fit.tracks import FloatArray

# The middle of the inner upper lip and of the inner lower lip (MPEG-4).
UPPER_LIP, LOWER_LIP = "2.2", "2.3"
UPPER_TEETH = "9.10"
# Millimetres on either side: the part of the lower lip that is before the incisors.
_MIDDLE = 8.0
# The inner contour from the right corner to the left one (MPEG-4), where a mesh has no region.
_UPPER_POINTS = ("2.5", "2.7", "2.2", "2.6", "2.4")
_LOWER_POINTS = ("2.5", "2.9", "2.3", "2.8", "2.4")
_REGIONS = {"inner_lip_contour", "upper_lip", "lower_lip"}
# Places along the line at which the opening is measured: about 1.2 mm apart on the built-in head.
_SAMPLES = 41


@dataclass(frozen=True, eq=False)
class LipLine:
    """Where the inner lips meet, from corner to corner: pairs of points that face each other.

    Parameters
    ----------
    vertices
        Vertices of both contours, ``(vertices,)``.
    weights
        What the opening at each place is of the heights of the vertices, ``(places, vertices)``,
        no unit: rows add up to 0.
    """

    vertices: IndexArray
    weights: FloatArray

    def measure(self, points: FloatArray) -> FloatArray:
        """Measure the openings along the line.

        Parameters
        ----------
        points
            Positions of the vertices, ``(frames, vertices, 3)``, millimetres in the head frame.

        Returns
        -------
        ndarray
            ``(frames, places)``, millimetres along the head's y axis; negative where the lips are
            pressed into each other.
        """
        return np.asarray(points[:, :, 1] @ self.weights.T)


def has_lip_line(mesh: Mesh) -> bool:
    """Return whether a face says where its inner lips meet.

    Parameters
    ----------
    mesh
        Any mesh.

    Returns
    -------
    bool
        Whether `find_lip_line` finds a line.
    """
    return mesh.regions.keys() >= _REGIONS or mesh.feature_points.keys() >= {UPPER_LIP, LOWER_LIP}


def find_lip_contours(mesh: Mesh) -> tuple[IndexArray, IndexArray]:
    """Find the vertices along which the inner lips meet.

    Parameters
    ----------
    mesh
        A face with the regions ``inner_lip_contour``, ``upper_lip`` and ``lower_lip``, or at least
        with the feature points 2.2 and 2.3.

    Returns
    -------
    upper, lower
        Vertices of each lip, ``(points,)``, from the right to the left.

    Raises
    ------
    ConfigurationError
        If the mesh has neither.
    """
    regions = mesh.regions
    if regions.keys() >= _REGIONS:
        ring = regions["inner_lip_contour"]
        upper, lower = (np.intersect1d(ring, regions[f"{side}_lip"]) for side in ("upper", "lower"))
    else:
        for name in (UPPER_LIP, LOWER_LIP):
            mesh.get_feature_point(name)
        upper, lower = (
            np.array([mesh.feature_points[name] for name in names if name in mesh.feature_points])
            for names in (_UPPER_POINTS, _LOWER_POINTS)
        )
    return upper[np.argsort(mesh.vertices[upper, 0])], lower[np.argsort(mesh.vertices[lower, 0])]


def find_lip_line(mesh: Mesh) -> LipLine:
    """Find the line along which the inner lips meet.

    The contours are those of the regions ``inner_lip_contour``, ``upper_lip`` and ``lower_lip``,
    or else pass through the feature points of the inner lips. Places lie at even distances across
    the mouth at rest, between the outermost points that both contours have; they move with the
    vertices.

    Parameters
    ----------
    mesh
        A face with these regions, or at least with the feature points 2.2 and 2.3.

    Returns
    -------
    LipLine
        From the right corner to the left one.

    Raises
    ------
    ConfigurationError
        If the mesh has neither.
    """
    upper, lower = find_lip_contours(mesh)
    across = [mesh.vertices[side, 0] for side in (upper, lower)]
    start, end = max(x[0] for x in across), min(x[-1] for x in across)
    places = np.linspace(start, max(start, end), _SAMPLES if end > start else 1)
    weights = [_interpolate(places, x) for x in across]
    return LipLine(np.concatenate([upper, lower]), np.hstack([weights[0], -weights[1]]))


def _interpolate(places: FloatArray, x: FloatArray) -> FloatArray:
    """Return the weights of points at x by which linear interpolation finds what is at places."""
    return np.stack([np.interp(places, x, row) for row in np.eye(len(x))], axis=1)


def compute_lip_openings(rig: Rig, values: ArrayLike) -> FloatArray:
    """Compute how far the inner lips are apart along their line, frame by frame.

    Parameters
    ----------
    rig
        A face with a lip line (`find_lip_line`).
    values
        Values of the parameters, ``(frames, parameters)``, in the order of the rig, full gestures.

    Returns
    -------
    ndarray
        ``(frames, places)``, millimetres along the head's y axis, from the right corner to the
        left one; negative where the lips are pressed into each other, NaN where a parameter is.

    Raises
    ------
    DataError
        If the shape is wrong.
    ConfigurationError
        If the mesh has no lip line.
    """
    line = find_lip_line(rig.mesh)
    return line.measure(deform_points(rig, line.vertices, _check_frames(rig, values)))


def compute_lip_gap(rig: Rig, values: ArrayLike) -> FloatArray:
    """Compute how far the inner lips are apart in the middle, frame by frame.

    Parameters
    ----------
    rig
        A face whose mesh has the feature points 2.2 and 2.3.
    values
        Values of the parameters, ``(frames, parameters)``, in the order of the rig, full gestures.

    Returns
    -------
    ndarray
        ``(frames,)``, millimetres along the head's y axis; negative where the lips are pressed into
        each other, NaN where a parameter is.

    Raises
    ------
    DataError
        If the shape is wrong, or the mesh lacks the points.
    """
    lips: IndexArray = np.array([rig.mesh.get_feature_point(p) for p in (UPPER_LIP, LOWER_LIP)])
    heights = deform_points(rig, lips, _check_frames(rig, values))[:, :, 1]
    return np.asarray(heights[:, 0] - heights[:, 1])


def compute_teeth_distance(rig: Rig, values: ArrayLike) -> FloatArray:
    """Compute how far the lower lip is from the edge of the upper teeth, frame by frame.

    Parameters
    ----------
    rig
        A face with the feature point 9.10, and the region ``lower_lip`` or the feature point 2.3.
    values
        Values of the parameters, ``(frames, parameters)``, in the order of the rig, full gestures.

    Returns
    -------
    ndarray
        ``(frames,)``, millimetres from the bottom of the upper teeth to the nearest vertex of the
        lower lip's middle; NaN where a parameter is, and everywhere on a face without teeth.

    Raises
    ------
    DataError
        If the shape is wrong.
    """
    frames, mesh = _check_frames(rig, values), rig.mesh
    edge, middle = mesh.feature_points.get(UPPER_TEETH), mesh.feature_points.get(LOWER_LIP)
    lip = mesh.regions.get("lower_lip", np.array([] if middle is None else [middle], dtype=int))
    lip = lip[np.abs(mesh.vertices[lip, 0]) <= _MIDDLE]
    if edge is None or not len(lip):
        return np.full(len(frames), np.nan)
    points = deform_points(rig, np.array([edge, *lip]), frames)
    return np.asarray(np.linalg.norm(points[:, 1:] - points[:, :1], axis=2).min(axis=1))


def _check_frames(rig: Rig, values: ArrayLike) -> FloatArray:
    frames = np.asarray(values, dtype=np.float64)
    names = rig.parameter_names
    if frames.ndim != 2 or frames.shape[1] != len(names):
        raise DataError(
            "the parameters have the wrong shape",
            found=frames.shape,
            expected=f"(frames, {len(names)}): {', '.join(names)}",
        )
    return frames
