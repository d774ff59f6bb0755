"""Virtual markers: points tied to the face that move with it (Beskow eq. 2)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mocap_fit.errors import ConfigurationError, DataError
from mocap_fit.face import CompiledRig, Rig, to_parameters
from mocap_fit.face.mesh import IndexArray, Mesh
from mocap_fit.face.rig import evaluate_jacobian
from mocap_fit.fitting.layout import Layout
from mocap_fit.fitting.orientation import Orientation
from mocap_fit.head.reference import compute_median_pose
from mocap_fit.tracks import FloatArray, MarkerTracks

# A marker with a feature point is tied to a triangle within this many mouth widths of it.
_REACH = 0.6


@dataclass(frozen=True, eq=False, repr=False)
class Binding:
    """Virtual markers on a face.

    ``q = v1 + s (v2 - v1) + t (v3 - v1) + u e1`` with ``e1`` the unit vertex normal at ``v1``
    (the sum of the cross products of the triangles round it). The third coordinate, printed as a
    second s in the paper's text, is u.

    Parameters
    ----------
    rig
        Face.
    names
        Names of the face markers.
    weights
        Weight of each marker in the fit, ``(markers,)``, no unit.
    orientation
        Transform from the speaker's head coordinates to the face's.
    reference_parameters
        Face parameters of the reference pose, ``(parameters,)``; 0 is rest, 1 the full gesture.
    vertex_ids
        Vertices of the mesh that the markers need, ``(vertices,)``, no unit.
    corners
        Vertices v1, v2 and v3 of each marker, ``(markers, 3)``, no unit: indices of `vertex_ids`.
    coordinates
        Coordinates s, t (no unit) and u (millimetres) of each marker, ``(markers, 3)``.
    ring_starts
        Start of each marker's triangles in `rings`, and their end, ``(markers + 1,)``, no unit.
    rings
        The other two corners, in order, of the triangles round v1, ``(triangles, 2)``, no unit:
        those of marker m are ``rings[ring_starts[m]:ring_starts[m + 1]]``.
    compiled
        Rig for those vertices; None where it cannot be compiled.
    head_names
        Names of the head markers that the reference pose has.
    head_positions
        Head markers, ``(head markers, 3)``, millimetres of the face.
    head_weights
        Weights of the head markers, ``(head markers,)``, no unit.
    reference_noise
        What noise is left in a coordinate of the reference pose, millimetres of the face; 0 where
        that is not known.
    """

    rig: Rig
    names: tuple[str, ...]
    weights: FloatArray
    orientation: Orientation
    reference_parameters: FloatArray
    vertex_ids: IndexArray
    corners: NDArray[np.int64]
    coordinates: FloatArray
    ring_starts: NDArray[np.int64]
    rings: NDArray[np.int64]
    compiled: CompiledRig | None
    head_names: tuple[str, ...]
    head_positions: FloatArray
    head_weights: FloatArray
    reference_noise: float = 0.0

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of the face parameters."""
        return self.rig.parameter_names

    def __repr__(self) -> str:
        return (
            f"Binding of {len(self.names)} face markers and {len(self.head_names)} head markers "
            f"to {len(self.vertex_ids)} vertices, {len(self.parameter_names)} parameters"
        )

    def evaluate(self, parameters: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Compute the virtual markers and their Jacobian, in plain numpy.

        The compiled kernel is tested against this, which also serves rigs that do not compile.

        Parameters
        ----------
        parameters
            Parameters, ``(parameters,)``; 0 is rest, 1 the full gesture.

        Returns
        -------
        positions : ndarray
            Virtual markers, ``(markers, 3)``, millimetres of the face.
        jacobian : ndarray
            Their derivatives, ``(markers, 3, parameters)``, millimetres per unit.
        """
        if self.compiled is not None:
            vertices, slopes = evaluate_jacobian(self.compiled, parameters)
        else:
            vertices = self.rig.deform(parameters)[self.vertex_ids]
            slopes = self.rig.jacobian(parameters)[self.vertex_ids]
        return compute_virtual_markers(
            vertices, slopes, self.corners, self.coordinates, self.ring_starts, self.rings
        )


def compute_virtual_markers(
    vertices: FloatArray,
    slopes: FloatArray,
    corners: NDArray[np.int64],
    coordinates: FloatArray,
    ring_starts: NDArray[np.int64],
    rings: NDArray[np.int64],
) -> tuple[FloatArray, FloatArray]:
    """Compute virtual markers and their Jacobian by Beskow eq. 2.

    Parameters
    ----------
    vertices
        Vertices, ``(vertices, 3)``, millimetres.
    slopes
        Derivatives of the vertices, ``(vertices, 3, parameters)``, millimetres per unit.
    corners
        Vertices v1, v2 and v3 of each marker, ``(markers, 3)``, no unit.
    coordinates
        Coordinates s, t (no unit) and u (millimetres) of each marker, ``(markers, 3)``.
    ring_starts
        Start of each marker's triangles in `rings`, and their end, ``(markers + 1,)``, no unit.
    rings
        The other two corners of the triangles round v1, ``(triangles, 2)``, no unit.

    Returns
    -------
    positions : ndarray
        Virtual markers, ``(markers, 3)``, millimetres.
    jacobian : ndarray
        Their derivatives, ``(markers, 3, parameters)``, millimetres per unit.
    """
    first, second, third = corners.T
    s, t, u = (column[:, None] for column in coordinates.T)
    centre = np.repeat(first, np.diff(ring_starts))
    one, other = vertices[rings[:, 0]] - vertices[centre], vertices[rings[:, 1]] - vertices[centre]
    d_one = slopes[rings[:, 0]] - slopes[centre]
    d_other = slopes[rings[:, 1]] - slopes[centre]
    normal = np.add.reduceat(np.cross(one, other), ring_starts[:-1])
    d_normal = np.add.reduceat(
        np.cross(d_one, other[:, :, None], axis=1) + np.cross(one[:, :, None], d_other, axis=1),
        ring_starts[:-1],
    )
    length = np.linalg.norm(normal, axis=1)[:, None]
    unit = normal / length
    # The derivative of a unit vector is that of the vector, less its part along the vector.
    along = np.einsum("mi,mip->mp", unit, d_normal)[:, None, :] * unit[:, :, None]
    d_unit = (d_normal - along) / length[:, :, None]
    positions = (1 - s - t) * vertices[first] + s * vertices[second] + t * vertices[third]
    jacobian = (
        (1 - s - t)[:, :, None] * slopes[first]
        + s[:, :, None] * slopes[second]
        + t[:, :, None] * slopes[third]
    )
    return positions + u * unit, jacobian + u[:, :, None] * d_unit


def bind_markers(
    rig: Rig, layout: Layout, reference: MarkerTracks, orientation: Orientation
) -> Binding:
    """Tie the face markers of a layout to a face, in the reference pose.

    Parameters
    ----------
    rig
        Face.
    layout
        Marker layout.
    reference
        Reference pose in head coordinates, one frame or more: their median is used.
    orientation
        Transform from head coordinates to the face's, from `fit_orientation`.

    Returns
    -------
    Binding
        Virtual markers, which coincide with the markers in the reference pose.

    Raises
    ------
    DataError
        If a face marker of the layout is not in the reference pose.
    ConfigurationError
        If the layout names regions, feature points or parameters that the face does not have.

    See Also
    --------
    fit_orientation : Lays the reference pose on the face before it.
    fit_shape : Fits a recording with the virtual markers.
    fit_speaker : Does all steps for the recordings of a speaker.

    Notes
    -----
    A marker is tied to the nearest triangle of its region, and of the neighbourhood of its
    feature point where it has one: at the seam of the lips the nearest triangle of all could be
    on either lip.

    Examples
    --------
    >>> import mocap_fit as mf
    >>> face, layout = mf.load_face(), mf.load_layout("face30-head5")
    >>> reference = mf.read_tracks(mf.load_sample("rest"))
    >>> orientation = mf.fit_orientation(face, layout, reference)
    >>> mf.bind_markers(face, layout, reference, orientation)
    Binding of 30 face markers and 5 head markers to ... vertices, 10 parameters
    """
    pose = compute_median_pose(reference)
    missing = [marker.name for marker in layout.face_markers if marker.name not in pose]
    if missing:
        what = "a face marker" if len(missing) == 1 else f"{len(missing)} face markers"
        raise DataError(
            f"the reference pose lacks {what} of the layout '{layout.name}': {', '.join(missing)}",
            found=", ".join(reference.names),
            advice="Choose the layout that the recording was made with, or correct its names.",
        )
    parameters = to_parameters(layout.reference_parameters, rig.parameter_names)
    vertices = rig.deform(parameters)
    mesh = rig.mesh
    corners, positions = [], []
    for marker in layout.face_markers:
        position = orientation.apply(pose[marker.name])
        candidates = _list_candidates(mesh, vertices, marker.region, marker.feature_point)
        if candidates.size == 0:
            raise ConfigurationError(
                f"no triangle of the face is in the region of the marker '{marker.name}'",
                found=f"region {list(marker.region)}, feature point {marker.feature_point}",
                advice="Name a region that holds the feature point.",
            )
        chosen = candidates[_find_nearest_triangle(position, vertices[mesh.triangles[candidates]])]
        corners.append(_rotate_corners(mesh.triangles[chosen], vertices, position))
        positions.append(position)
    head = {
        marker.name: (orientation.apply(pose[marker.name]), marker.weight)
        for marker in layout.head_markers
        if marker.name in pose
    }
    vertex_ids, local_corners, coordinates, ring_starts, rings = _bind(
        rig, vertices, np.array(corners), np.array(positions)
    )
    return Binding(
        rig=rig,
        names=tuple(marker.name for marker in layout.face_markers),
        weights=np.array([marker.weight for marker in layout.face_markers]),
        orientation=orientation,
        reference_parameters=parameters,
        vertex_ids=vertex_ids,
        corners=local_corners,
        coordinates=coordinates,
        ring_starts=ring_starts,
        rings=rings,
        compiled=rig.compile(vertex_ids),
        head_names=tuple(head),
        head_positions=np.array([position for position, _ in head.values()]).reshape(-1, 3),
        head_weights=np.array([weight for _, weight in head.values()]),
        reference_noise=orientation.scale * _estimate_noise(reference),
    )


def _estimate_noise(reference: MarkerTracks) -> float:
    """Estimate the noise of a coordinate's median from the changes from frame to frame."""
    changes = np.diff(reference.positions, axis=0)
    changes = changes[np.isfinite(changes)]
    deviation = np.sqrt(0.5 * np.mean(changes**2)) if changes.size else 0.0
    return float(deviation * np.sqrt(np.pi / 2 / reference.frames))


def check_recording(binding: Binding, recording: MarkerTracks) -> None:
    """Refuse a recording that lacks markers of the binding.

    Parameters
    ----------
    binding
        Virtual markers.
    recording
        Recording.

    Raises
    ------
    DataError
        If markers are missing; the message names them.
    """
    missing = [name for name in binding.names if name not in recording.names]
    if missing:
        raise DataError(
            f"the recording '{recording.name}' lacks markers of the layout: {', '.join(missing)}",
            found=", ".join(recording.names),
            advice="Choose the layout that the recording was made with, or correct its names.",
        )


def _bind(
    rig: Rig, vertices: FloatArray, corners: IndexArray, positions: FloatArray
) -> tuple[IndexArray, IndexArray, FloatArray, IndexArray, IndexArray]:
    """Solve eq. 2 for s, t and u of each position, and list the triangles it needs."""
    triangles = rig.mesh.triangles
    starts, rings = [0], []
    for corner in corners:
        touching = triangles[(triangles == corner[0]).any(axis=1)]
        position = np.argmax(touching == corner[0], axis=1)
        rows = np.arange(len(touching))
        rings.append(
            np.stack([touching[rows, (position + 1) % 3], touching[rows, (position + 2) % 3]], 1)
        )
        starts.append(starts[-1] + len(touching))
    ring_array = np.concatenate(rings)
    vertex_ids = np.unique(np.concatenate([corners.ravel(), ring_array.ravel()]))
    local_corners = np.searchsorted(vertex_ids, corners)
    local_rings = np.searchsorted(vertex_ids, ring_array)
    ring_starts = np.array(starts, dtype=np.int64)
    local = vertices[vertex_ids]
    # The normal at v1 comes out of eq. 2 itself, with s = t = 0 and u = 1.
    only_normal = np.tile([0.0, 0.0, 1.0], (len(corners), 1))
    no_slopes = np.zeros((*local.shape, 0))
    tips, _ = compute_virtual_markers(
        local, no_slopes, local_corners, only_normal, ring_starts, local_rings
    )
    first, second, third = (local[local_corners[:, i]] for i in range(3))
    axes = np.stack([second - first, third - first, tips - first], axis=2)
    coordinates = np.linalg.solve(axes, (positions - first)[:, :, None])[:, :, 0]
    return vertex_ids, local_corners, coordinates, ring_starts, local_rings


def _list_candidates(
    mesh: Mesh, vertices: FloatArray, region: tuple[str, ...], feature_point: str | None
) -> IndexArray:
    """List the triangles that a marker may be tied to, as indices."""
    skin = mesh.get_part("skin")
    allowed = np.zeros(len(vertices), dtype=bool)
    if region:
        for name in region:
            allowed[mesh.get_region(name)] = True
    else:
        allowed[skin.vertices.start : skin.vertices.stop] = True
    if feature_point is not None:
        point = vertices[mesh.get_feature_point(feature_point)]
        mouth = vertices[[mesh.get_feature_point("8.3"), mesh.get_feature_point("8.4")]]
        reach = _REACH * np.linalg.norm(mouth[0] - mouth[1])
        allowed &= np.linalg.norm(vertices - point, axis=1) <= reach
    return np.flatnonzero(allowed[mesh.triangles].all(axis=1))


def _find_nearest_triangle(point: FloatArray, triangles: FloatArray) -> int:
    """Find the nearest of triangles, ``(triangles, 3, 3)``, by its nearest point."""
    a, b, c = triangles[:, 0], triangles[:, 1], triangles[:, 2]
    normal = np.cross(b - a, c - a)
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
    foot = point - np.sum((point - a) * normal, axis=1, keepdims=True) * normal
    inside = np.ones(len(triangles), dtype=bool)
    squared = np.full(len(triangles), np.inf)
    for start, end in ((a, b), (b, c), (c, a)):
        edge = end - start
        inside &= np.sum(np.cross(edge, foot - start) * normal, axis=1) >= 0
        along = np.sum((point - start) * edge, axis=1)
        along = np.clip(along / np.maximum(np.sum(edge * edge, axis=1), 1e-12), 0.0, 1.0)
        nearest = start + along[:, None] * edge
        squared = np.minimum(squared, np.sum((point - nearest) ** 2, axis=1))
    squared = np.where(inside, np.sum((point - foot) ** 2, axis=1), squared)
    return int(np.argmin(squared))


def _rotate_corners(triangle: IndexArray, vertices: FloatArray, point: FloatArray) -> IndexArray:
    """Rotate the triangle's corners so that the one nearest to the point is first."""
    nearest = int(np.argmin(np.linalg.norm(vertices[triangle] - point, axis=1)))
    return np.roll(triangle, -nearest)
