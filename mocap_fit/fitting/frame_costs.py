"""Data costs of many frames at once, their quadratic form near some values, and their scale.

For the sum of distances, Newton's method converges slowly where a residual is nearly 0. The
primal-dual form holds a dual for each marker's direction (Chan, Golub and Mulet, SIAM J. Sci.
Comput. 20, 1999), and converges quadratically.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mocap_fit.fitting.objective import Evaluator, Objective
from mocap_fit.tracks import FloatArray

# Least distance that is divided by, millimetres.
_LEAST = 1e-6
# Frames whose Jacobians are in memory at one time.
_AT_ONCE = 256


class LocalCosts(NamedTuple):
    """The data costs of frames, and their quadratic form, at some values.

    Parameters
    ----------
    costs
        Costs, ``(frames,)``, in the unit of the objective.
    gradients
        First derivatives, ``(frames, parameters)``, in the unit of the cost.
    curvatures
        Second derivatives, ``(frames, parameters, parameters)``, in the unit of the cost.
    information
        Weighted sums of JᵀJ, ``(frames, parameters, parameters)``, square millimetres.
    residuals
        Virtual minus measured markers, ``(frames, markers, 3)``, millimetres; 0 where hidden.
    duals
        Dual variables, ``(frames, markers, 3)``, no unit.
    """

    costs: FloatArray
    gradients: FloatArray
    curvatures: FloatArray
    information: FloatArray
    residuals: FloatArray
    duals: FloatArray


@dataclass(frozen=True, eq=False)
class FrameCosts:
    """The data costs of some frames, each a function of the frame's parameters.

    Parameters
    ----------
    evaluator
        Computes the virtual markers.
    targets
        Measured markers, ``(frames, markers, 3)``, millimetres of the face.
    weights
        Weights of the markers, ``(frames, markers)``; 0 where hidden.
    objective
        Cost of a frame.
    threshold
        Huber's threshold, millimetres of the face.
    """

    evaluator: Evaluator
    targets: FloatArray
    weights: FloatArray
    objective: Objective
    threshold: float

    def at(self, values: FloatArray, before: LocalCosts | None = None) -> LocalCosts:
        """Compute the costs and their quadratic form at some values.

        Parameters
        ----------
        values
            Parameters, ``(frames, parameters)``; 0 is rest, 1 the full gesture.
        before
            Costs at the values of the last round, whose duals are updated.

        Returns
        -------
        LocalCosts
            Costs, derivatives, residuals and duals.
        """
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
            value, slope, is_straight = self._evaluate_distances(distance)
            costs[part] = np.einsum("tm,tm->t", weights, value)
            gradient = (weights * slope)[:, :, None] * residual
            gradients[part] = np.einsum("tmi,tmip->tp", gradient, jacobian)
            rows = jacobian.reshape(len(residual), -1, count)
            information[part] = _compute_information(rows, np.repeat(weights, 3, axis=1))
            if self.objective == "squares":
                curvatures[part] = 2.0 * information[part]
            else:
                unit = residual / np.maximum(distance, _LEAST)[:, :, None]
                dual = unit if before is None else _update_duals(before, part, residual)
                along = np.einsum("tmi,tmip->tmp", unit, jacobian)
                across = np.einsum("tmi,tmip->tmp", dual, jacobian)
                straight = (weights * slope * is_straight)[:, :, None] * along
                mixed = np.swapaxes(straight, 1, 2) @ across
                curvatures[part] = _compute_information(rows, np.repeat(weights * slope, 3, axis=1))
                curvatures[part] -= 0.5 * (mixed + np.swapaxes(mixed, 1, 2))
                duals[part] = dual
            residuals[part] = residual
        return LocalCosts(costs, gradients, curvatures, information, residuals, duals)

    def update(
        self, values: FloatArray, before: LocalCosts, moved: NDArray[np.bool_]
    ) -> LocalCosts:
        """Compute the costs after a step that moved some of the frames.

        Parameters
        ----------
        values
            Parameters after the step, ``(frames, parameters)``; 0 is rest, 1 the full gesture.
        before
            Costs before the step.
        moved
            Which frames moved, ``(frames,)``, no unit.

        Returns
        -------
        LocalCosts
            Costs after the step; those of the other frames are as before.
        """
        some = replace(self, targets=self.targets[moved], weights=self.weights[moved])
        new = some.at(values[moved], LocalCosts(*(old[moved] for old in before)))
        merged = LocalCosts(*(old.copy() for old in before))
        for target, source in zip(merged, new, strict=True):
            target[moved] = source
        return merged

    def _evaluate_distances(
        self, distance: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Compute costs of distances, their slopes over the distances, and which are straight."""
        if self.objective == "squares":
            return distance**2, np.full_like(distance, 2.0), np.zeros_like(distance)
        if self.objective == "distances":
            return distance, 1.0 / np.maximum(distance, _LEAST), np.ones_like(distance)
        knee = self.threshold
        near = distance <= knee
        value = np.where(near, distance**2, 2.0 * knee * distance - knee**2)
        return value, 2.0 * knee / np.maximum(distance, knee), np.where(near, 0.0, 1.0)


def _update_duals(before: LocalCosts, part: slice, residuals: FloatArray) -> FloatArray:
    """Update the duals of some frames after a step to new residuals."""
    old, duals = before.residuals[part], before.duals[part]
    distance = np.maximum(np.linalg.norm(old, axis=2, keepdims=True), _LEAST)
    longer = np.sum(old / distance * (residuals - old), axis=2, keepdims=True)
    new = (residuals - longer * duals) / distance
    return np.asarray(new / np.maximum(np.linalg.norm(new, axis=2, keepdims=True), 1.0))


def _compute_information(rows: FloatArray, weights: FloatArray) -> FloatArray:
    """Compute ``Jᵀ W J`` of every frame."""
    return np.asarray(np.swapaxes(rows * weights[:, :, None], 1, 2) @ rows)


class CostScale(NamedTuple):
    """The scale of a cost, for Gaussian noise.

    Parameters
    ----------
    variance
        Variance of the frame-by-frame result times its information (the weighted sum of
        ``JᵀJ``), square millimetres.
    kappa
        Divisor that makes the cost a negative log likelihood, in the unit of the cost.
    """

    variance: float
    kappa: float


def compute_cost_scale(objective: Objective, threshold: float, noise: float) -> CostScale:
    """Compute the scale of an objective, for Gaussian noise in every coordinate.

    Parameters
    ----------
    objective
        Cost of a frame.
    threshold
        Huber's threshold, millimetres.
    noise
        Standard deviation of a coordinate, millimetres.

    Returns
    -------
    CostScale
        Variance and divisor.

    Notes
    -----
    An M-estimator whose cost has the derivative psi has the variance ``V / B²`` per information,
    with ``V = E |psi|² / 3`` and ``B = E div psi / 3`` (Huber, Annals of Mathematical Statistics
    35, 1964); its cost has the curvature B, and divided by ``V / B`` it is a negative log
    likelihood. For Gaussian noise ``E div psi = E psi · r / noise²``.
    """
    if objective == "squares":
        return CostScale(noise**2, 2.0 * noise**2)
    length = np.linspace(0.0, 10.0, 4001)
    density = length**2 * np.exp(-0.5 * length**2)
    density /= density.sum()
    distance = noise * length
    if objective == "distances":
        psi = np.ones_like(distance)
    else:
        psi = 2.0 * np.minimum(distance, threshold)
    size = float(density @ psi**2) / 3.0
    slope = float(density @ (psi * distance)) / (3.0 * noise**2)
    return CostScale(size / slope**2, size / slope)
