"""The orientation fit: the speaker's head coordinates onto the face's (Beskow eq. 1)."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

import nlopt
import numpy as np
from scipy.spatial.transform import Rotation

from mocap_fit.errors import DataError
from mocap_fit.face import Rig, to_parameters
from mocap_fit.fitting.layout import Layout
from mocap_fit.head.reference import compute_median_pose
from mocap_fit.tracks import FloatArray, MarkerTracks
from mocap_fit.tracks.rigid import compute_motion_jacobian, estimate_similarity_transform

# A face is between a fifth and five times the size of another one; beyond, the unit is wrong.
_PLAUSIBLE_SCALE = (0.2, 5.0)


@dataclass(frozen=True, eq=False, repr=False)
class Orientation:
    """A similarity transform ``x → scale · rotation · x + translation``.

    Parameters
    ----------
    scale
        Millimetres of the face per millimetre of the speaker.
    rotation
        Rotation matrix, ``(3, 3)``, no unit.
    translation
        Translation, ``(3,)``, millimetres of the face.
    residuals
        Marker → distance of each strategic point from its feature point after the transform,
        millimetres of the face.
    """

    scale: float = 1.0
    rotation: FloatArray = field(default_factory=lambda: np.eye(3))
    translation: FloatArray = field(default_factory=lambda: np.zeros(3))
    residuals: Mapping[str, float] | None = None

    def apply(self, points: FloatArray) -> FloatArray:
        """Transform points of the speaker to the face's coordinates.

        Parameters
        ----------
        points
            Points, ``(..., 3)``, millimetres of the speaker.

        Returns
        -------
        ndarray
            Points, ``(..., 3)``, millimetres of the face.
        """
        return np.asarray(self.scale * points @ self.rotation.T + self.translation)

    def undo(self, points: FloatArray) -> FloatArray:
        """Transform points of the face to the speaker's head coordinates.

        Parameters
        ----------
        points
            Points, ``(..., 3)``, millimetres of the face.

        Returns
        -------
        ndarray
            Points, ``(..., 3)``, millimetres of the speaker.
        """
        return np.asarray((points - self.translation) @ self.rotation / self.scale)

    def __repr__(self) -> str:
        text = f"Orientation: scale {self.scale:.4g}"
        if self.residuals:
            distances = list(self.residuals.values())
            text += (
                f", residuals of {len(distances)} points {np.median(distances):.3g} mm (median), "
                f"{max(distances):.3g} mm (largest)"
            )
        return text


def fit_orientation(
    rig: Rig,
    layout: Layout,
    reference: MarkerTracks,
    *,
    objective: Literal["distances", "squares"] = "distances",
) -> Orientation:
    """Fit the similarity transform that lays the speaker's strategic points on the face's.

    Parameters
    ----------
    rig
        Face.
    layout
        Marker layout, whose markers with ``orientation = true`` are the strategic points.
    reference
        Reference pose in head coordinates, one frame or more: their median is used.
    objective
        ``"distances"``: the sum of distances (Beskow eq. 1). ``"squares"``: the sum of squared
        distances, whose minimum is also that of Procrustes in closed form.

    Returns
    -------
    Orientation
        Transform, and the distances of the strategic points.

    Raises
    ------
    DataError
        If fewer than three strategic points are in the reference, they lie on a line, or the
        sizes are so different that the unit must be wrong.

    See Also
    --------
    bind_markers : Ties the markers to the face after it.
    fit_speaker : Does all steps for the recordings of a speaker.

    Notes
    -----
    The paper lays markers on vertices. A marker's centre is above the skin by the layout's
    ``marker_offset``, and the target is moved outwards by as much: otherwise the face would be
    fitted too large.

    Examples
    --------
    >>> import mocap_fit as mf
    >>> reference = mf.read_tracks(mf.load_sample("rest"))
    >>> orientation = mf.fit_orientation(
    ...     mf.load_face(), mf.load_layout("face30-head5"), reference
    ... )
    >>> len(orientation.residuals)
    6
    """
    pose = compute_median_pose(reference)
    strategic = [m for m in layout.markers if m.orientation and m.name in pose]
    if len(strategic) < 3:
        raise DataError(
            "too few strategic points of the layout are in the reference pose",
            found=", ".join(m.name for m in strategic) or "none",
            expected="three or more of "
            + ", ".join(m.name for m in layout.markers if m.orientation),
        )
    vertices = rig.deform(to_parameters(layout.reference_parameters, rig.parameter_names))
    source = np.array([pose[m.name] for m in strategic])
    points = [rig.mesh.get_feature_point(m.feature_point or "") for m in strategic]
    target = vertices[points] + layout.marker_offset * rig.mesh.compute_normals(vertices)[points]
    orientation = align_points(source, target, objective=objective)
    lower, upper = _PLAUSIBLE_SCALE
    if not lower <= orientation.scale <= upper:
        raise DataError(
            "the recorded face and the model differ too much in size",
            found=f"the model is {orientation.scale:.4g} times the recording",
            expected=f"{lower:g} to {upper:g} times",
            advice="Check the recording's unit: positions must be millimetres.",
        )
    distances = np.linalg.norm(orientation.apply(source) - target, axis=1)
    residuals = {m.name: float(d) for m, d in zip(strategic, distances, strict=True)}
    return replace(orientation, residuals=residuals)


def align_points(
    source: FloatArray,
    target: FloatArray,
    *,
    objective: Literal["distances", "squares"] = "distances",
) -> Orientation:
    """Fit the similarity transform that lays one set of points on another.

    Seven free parameters: translation, rotation and scale (its logarithm, so that it stays
    positive); started from the closed form of least squares, which lies close, and minimised by
    nlopt.

    Parameters
    ----------
    source
        Points, ``(points, 3)``, millimetres: three or more that do not lie on a line.
    target
        Points that they are laid on, ``(points, 3)``, millimetres.
    objective
        ``"distances"``: the sum of distances. ``"squares"``: the sum of squared distances.

    Returns
    -------
    Orientation
        Transform, without residuals.
    """
    scale, rotation, translation = estimate_similarity_transform(source, target)
    # About the centroid and in units of the size, the seven parameters have similar effects.
    centre, middle = source.mean(axis=0), target.mean(axis=0)
    size = float(np.sqrt(np.mean(np.sum((target - middle) ** 2, axis=1))))
    points, goals = scale * (source - centre) @ rotation.T / size, (target - middle) / size
    shift = (scale * rotation @ centre + translation - middle) / size
    best: tuple[float, FloatArray] = (np.inf, np.zeros(7))

    def _cost(x: FloatArray, gradient: FloatArray) -> float:
        """Return the cost, and fill its gradient, for nlopt."""
        nonlocal best
        turned = np.exp(x[6]) * Rotation.from_rotvec(x[3:6].copy()).apply(points)
        difference = turned + x[:3] - goals
        if objective == "squares":
            value = float(np.sum(difference**2))
            slope = 2.0 * difference
        else:
            distance = np.linalg.norm(difference, axis=1, keepdims=True)
            value = float(distance.sum())
            slope = difference / np.maximum(distance, 1e-12)
        if gradient.size:
            gradient[:3] = slope.sum(axis=0)
            # d(R p)/d(rotation vector) = -[R p]x Jl: torque through the left Jacobian.
            torque = np.cross(turned, slope).sum(axis=0)
            gradient[3:6] = _compute_left_jacobian(x[3:6]).T @ torque
            gradient[6] = np.sum(slope * turned)
        if value < best[0]:
            best = (value, x.copy())
        return value

    optimiser = nlopt.opt(nlopt.LD_SLSQP, 7)
    optimiser.set_min_objective(_cost)
    # Without bounds nlopt's SLSQP has been seen to step to numbers that it never set.
    limits = np.array([3.0] * 3 + [np.pi] * 3 + [1.0])
    optimiser.set_lower_bounds(-limits)
    optimiser.set_upper_bounds(limits)
    optimiser.set_xtol_abs(1e-12)
    optimiser.set_ftol_rel(1e-14)
    optimiser.set_maxeval(500)
    start = np.concatenate([shift, np.zeros(4)])
    # Rounding may stop the solver at the end; the best point is used.
    with contextlib.suppress(nlopt.RoundoffLimited, RuntimeError):
        optimiser.optimize(start)
    x = best[1]
    turn = Rotation.from_rotvec(x[3:6]).as_matrix()
    scale, rotation = float(scale * np.exp(x[6])), turn @ rotation
    return Orientation(scale, rotation, middle + size * x[:3] - scale * rotation @ centre)


def move_by_pose(
    positions: FloatArray, jacobian: FloatArray, centre: FloatArray, pose: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Move points by a pose, and differentiate them by the parameters and the pose.

    Parameters
    ----------
    positions
        Points, ``(points, 3)``, millimetres.
    jacobian
        Their derivatives by the parameters, ``(points, 3, parameters)``, millimetres per unit.
    centre
        Centre of the rotation, ``(3,)``, millimetres.
    pose
        Rotation vector and translation, ``(6,)``, radians and millimetres.

    Returns
    -------
    positions : ndarray
        Moved points, ``(points, 3)``, millimetres.
    jacobian : ndarray
        Derivatives by the parameters and the pose, ``(points, 3, parameters + 6)``.
    """
    rotation = Rotation.from_rotvec(pose[:3]).as_matrix()
    arms = (positions - centre) @ rotation.T
    by_shape = np.einsum("ij,mjp->mip", rotation, jacobian)
    effect = compute_motion_jacobian(arms + centre, centre)
    # The derivative by the rotation vector itself goes through the group's left Jacobian.
    effect[:, :, :3] = effect[:, :, :3] @ _compute_left_jacobian(pose[:3])
    return arms + centre + pose[3:], np.concatenate([by_shape, effect], axis=2)


def _compute_left_jacobian(vector: FloatArray) -> FloatArray:
    """Compute the left Jacobian of the rotation group at a rotation vector, ``(3, 3)``."""
    angle = float(np.linalg.norm(vector))
    x, y, z = vector
    skew = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    if angle < 1e-6:
        return np.eye(3) + skew / 2
    return np.asarray(
        np.eye(3)
        + (1 - np.cos(angle)) / angle**2 * skew
        + (angle - np.sin(angle)) / angle**3 * skew @ skew
    )
