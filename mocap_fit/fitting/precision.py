"""How well the visible markers determine the face parameters.

With independent marker noise of standard deviation sigma on every coordinate, and residuals that
are nearly linear in the parameters, the covariance of the least squares answer is
``sigma² A (I + P) Aᵀ``, where ``A = (Jᵀ W J)⁻¹ Jᵀ W`` and P is what the noisy head pose adds to
the markers in head coordinates. With the true pose and equal weights this is the Cramér-Rao
bound, ``sigma² (Jᵀ J)⁻¹``.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mocap_fit.tracks import FloatArray


def rigid_motion_effect(points: FloatArray, centre: FloatArray) -> FloatArray:
    """What a small rigid motion does to points: `(points, 3, 6)`.

    The six are a rotation vector about the centre and a translation.
    """
    effect = np.zeros((len(points), 3, 6))
    x, y, z = (points - centre).T
    # rotation vector × (point - centre)
    effect[:, 0, 1], effect[:, 0, 2] = z, -y
    effect[:, 1, 0], effect[:, 1, 2] = -z, x
    effect[:, 2, 0], effect[:, 2, 1] = y, -x
    effect[:, :, 3:] = np.eye(3)
    return effect


def parameter_covariance(
    jacobian: FloatArray,
    weights: FloatArray,
    *,
    positions: FloatArray | None = None,
    head_positions: FloatArray | None = None,
    head_weights: FloatArray | None = None,
) -> FloatArray:
    """Covariance of the parameters per unit of marker variance.

    Parameters
    ----------
    jacobian
        `(markers, 3, parameters)` of the visible markers, millimetres per unit.
    weights
        `(markers,)` of the visible markers.
    positions
        `(markers, 3)`: where they are; needed with head markers alone.
    head_positions, head_weights
        `(head markers, 3)` and `(head markers,)`: the visible reference markers that the head's
        pose was estimated from; without them the pose is taken as true.

    Returns
    -------
    FloatArray
        `(parameters, parameters)`; infinite on the diagonal of parameters that the markers do
        not determine.
    """
    count = jacobian.shape[2]
    flat = jacobian.reshape(-1, count)
    row_weights = np.repeat(weights, 3)
    information = flat.T @ (row_weights[:, None] * flat)
    determined = _determined(information)
    covariance = np.full((count, count), 0.0)
    covariance[~determined, ~determined] = np.inf
    if not determined.any():
        return covariance
    flat = flat[:, determined]
    gain = np.linalg.solve(information[np.ix_(determined, determined)], flat.T * row_weights)
    own = gain @ gain.T
    if head_positions is not None and positions is not None and len(head_positions) >= 3:
        head_weights = np.ones(len(head_positions)) if head_weights is None else head_weights
        centre = head_positions.mean(axis=0)
        head = rigid_motion_effect(head_positions, centre).reshape(-1, 6)
        head_rows = np.repeat(head_weights, 3)
        head_gain = np.linalg.solve(head.T @ (head_rows[:, None] * head), head.T * head_rows)
        through = gain @ rigid_motion_effect(positions, centre).reshape(-1, 6) @ head_gain
        own = own + through @ through.T
    covariance[np.ix_(determined, determined)] = own
    return covariance


def _determined(information: FloatArray) -> NDArray[np.bool_]:
    """Which parameters a singular information matrix still determines.

    A parameter is undetermined where a direction without information has a share in it.
    """
    scale = np.sqrt(np.maximum(np.diag(information), 1e-12))
    values, vectors = np.linalg.eigh(information / np.outer(scale, scale))
    blind = vectors[:, values < 1e-8]
    seen = (np.sum(blind**2, axis=1) < 1e-6) & (np.diag(information) > 1e-9)
    return np.asarray(seen)
