"""Data costs of many frames at once, their form near some values, and what they mean.

For the sum of distances, Newton's method crawls where a residual is nearly nil. The primal-dual
form keeps a dual for each marker's direction (Chan, Golub and Mulet, SIAM J. Sci. Comput. 20,
1999), and converges as if there were a second derivative.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mocap_fit.fitting.objective import Evaluator, Objective
from mocap_fit.tracks import FloatArray

# A distance counts as this much at least (mm), so that it can be divided by.
_LEAST = 1e-6
# Frames whose Jacobians are held at one time.
_AT_ONCE = 256


class LocalCosts(NamedTuple):
    """The data costs of frames about some values; the frames come first."""

    costs: FloatArray  # (frames,)
    gradients: FloatArray  # (frames, parameters)
    curvatures: FloatArray  # (frames, parameters, parameters)
    information: FloatArray  # (frames, parameters, parameters): weighted sum of JᵀJ
    residuals: FloatArray  # (frames, markers, 3), 0 where hidden
    duals: FloatArray  # (frames, markers, 3)


@dataclass(frozen=True, eq=False)
class FrameCosts:
    """The data costs of some frames, each a function of its own parameters.

    Parameters
    ----------
    evaluator
        Of the virtual markers.
    targets
        `(frames, markers, 3)`: measured markers, in the face's millimetres.
    weights
        `(frames, markers)`: 0 where hidden.
    objective, threshold
        As in `mocap_fit.fitting.objective.cost`.
    """

    evaluator: Evaluator
    targets: FloatArray
    weights: FloatArray
    objective: Objective
    threshold: float

    def at(self, values: FloatArray, before: LocalCosts | None = None) -> LocalCosts:
        """Costs and their local form at `(frames, parameters)` values, a step from others."""
        frames, count = values.shape
        costs, gradients = np.empty(frames), np.empty((frames, count))
        curvatures, information = np.empty((2, frames, count, count))
        residuals, duals = np.empty((2, *self.targets.shape))
        for start in range(0, frames, _AT_ONCE):
            part = slice(start, min(start + _AT_ONCE, frames))
            positions, jacobian = self.evaluator.evaluate_frames(values[part])
            weights = self.weights[part]
            residual = np.where(
                weights[:, :, None] > 0, positions - np.nan_to_num(self.targets[part]), 0.0
            )
            distance = np.sqrt(np.einsum("tmi,tmi->tm", residual, residual))
            value, slope, bend = self._shape(distance)
            costs[part] = np.einsum("tm,tm->t", weights, value)
            pull = (weights * slope)[:, :, None] * residual
            gradients[part] = np.einsum("tmi,tmip->tp", pull, jacobian)
            rows = jacobian.reshape(len(residual), -1, count)
            information[part] = _compute_information(rows, np.repeat(weights, 3, axis=1))
            if self.objective == "squares":
                curvatures[part] = 2.0 * information[part]
            else:
                unit = residual / np.maximum(distance, _LEAST)[:, :, None]
                dual = unit if before is None else _update_duals(before, part, residual)
                along = np.einsum("tmi,tmip->tmp", unit, jacobian)
                across = np.einsum("tmi,tmip->tmp", dual, jacobian)
                straight = (weights * slope * bend)[:, :, None] * along
                mixed = np.swapaxes(straight, 1, 2) @ across
                curvatures[part] = _compute_information(rows, np.repeat(weights * slope, 3, axis=1))
                curvatures[part] -= 0.5 * (mixed + np.swapaxes(mixed, 1, 2))
                duals[part] = dual
            residuals[part] = residual
        return LocalCosts(costs, gradients, curvatures, information, residuals, duals)

    def update(
        self, values: FloatArray, before: LocalCosts, moved: NDArray[np.bool_]
    ) -> LocalCosts:
        """The local form after a step that moved some of the frames."""
        some = FrameCosts(
            self.evaluator, self.targets[moved], self.weights[moved], self.objective, self.threshold
        )
        new = some.at(values[moved], LocalCosts(*(old[moved] for old in before)))
        merged = LocalCosts(*(old.copy() for old in before))
        for values_of_all, part in zip(merged, new, strict=True):
            values_of_all[moved] = part
        return merged

    def _shape(self, distance: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Cost of a distance, its slope over the distance, and whether it is on the straight."""
        if self.objective == "squares":
            return distance**2, np.full_like(distance, 2.0), np.zeros_like(distance)
        if self.objective == "distances":
            return distance, 1.0 / np.maximum(distance, _LEAST), np.ones_like(distance)
        knee = self.threshold
        near = distance <= knee
        value = np.where(near, distance**2, 2.0 * knee * distance - knee**2)
        return value, 2.0 * knee / np.maximum(distance, knee), np.where(near, 0.0, 1.0)


def _update_duals(before: LocalCosts, part: slice, residuals: FloatArray) -> FloatArray:
    """Duals of some frames after a step to new residuals."""
    old, duals = before.residuals[part], before.duals[part]
    distance = np.maximum(np.linalg.norm(old, axis=2, keepdims=True), _LEAST)
    longer = np.sum(old / distance * (residuals - old), axis=2, keepdims=True)
    new = (residuals - longer * duals) / distance
    return np.asarray(new / np.maximum(np.linalg.norm(new, axis=2, keepdims=True), 1.0))


def _compute_information(rows: FloatArray, weights: FloatArray) -> FloatArray:
    """``Jᵀ W J`` of every frame."""
    return np.asarray(np.swapaxes(rows * weights[:, :, None], 1, 2) @ rows)


class CostScale(NamedTuple):
    """What costs mean, for Gaussian noise.

    Parameters
    ----------
    variance
        Of the frame-by-frame answer, times its information (the weighted sum of ``JᵀJ``).
    kappa
        The cost over this is a negative logarithm of a likelihood.
    """

    variance: float
    kappa: float


def compute_cost_scale(objective: Objective, threshold: float, noise: float) -> CostScale:
    """Size up an objective, for noise of some standard deviation in every coordinate.

    An M-estimator with the pull psi has the variance ``V / B²`` per information, with
    ``V = E |psi|² / 3`` and ``B = E div psi / 3`` (Huber, Annals of Mathematical Statistics 35,
    1964); its cost has the curvature B, and is a log likelihood once it is divided by ``V / B``.
    For Gaussian noise ``E div psi = E psi · r / noise²``.
    """
    if objective == "squares":
        return CostScale(noise**2, 2.0 * noise**2)
    length = np.linspace(0.0, 10.0, 4001)
    chance = length**2 * np.exp(-0.5 * length**2)
    chance /= chance.sum()
    distance = noise * length
    pull = (
        np.ones_like(distance)
        if objective == "distances"
        else 2.0 * np.minimum(distance, threshold)
    )
    size = float(chance @ pull**2) / 3.0
    curve = float(chance @ (pull * distance)) / (3.0 * noise**2)
    return CostScale(size / curve**2, size / curve)
