"""What the shape fit minimises in a frame: distances, squares, or Huber's compromise."""

from __future__ import annotations

import weakref
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from mocap_fit.errors import ConfigurationError
from mocap_fit.fitting.binding import Binding
from mocap_fit.fitting.slots import SLOT, aligned_zeros, pack, pack_frames
from mocap_fit.tracks import FloatArray

Objective = Literal["distances", "squares", "huber"]
OBJECTIVES: tuple[Objective, ...] = ("distances", "squares", "huber")


_jacobians: weakref.WeakKeyDictionary[Binding, FloatArray] = weakref.WeakKeyDictionary()


def reference_jacobian(binding: Binding) -> FloatArray:
    """Derivative of the virtual markers in the reference pose, `(markers, 3, parameters)`."""
    if binding not in _jacobians:
        _, _jacobians[binding] = binding.evaluate(binding.reference_parameters)
    return _jacobians[binding]


class Evaluator:
    """Virtual markers and costs of a binding: compiled where it can be, else in plain numpy.

    Parameters
    ----------
    binding
        The virtual markers.
    objective, threshold
        See `cost`.
    """

    def __init__(self, binding: Binding, objective: Objective, threshold: float) -> None:
        self.binding = binding
        self._objective = objective
        self._threshold = threshold
        self._kernel = None if binding.compiled is None else _kernel()
        if self._kernel is not None:
            self._slots = pack(binding)
            rows = self._slots.blocks * SLOT
            self._room, self._rows = aligned_zeros(self._slots.room), aligned_zeros(1, rows)
            self._shares = aligned_zeros(1, self._slots.parameters, rows)
            self._code = OBJECTIVES.index(objective)
        self.set_frame(np.zeros((len(binding.names), 3)), np.ones(len(binding.names), dtype=bool))

    def set_frame(self, target: FloatArray, seen: NDArray[np.bool_]) -> None:
        """Take the markers of a frame.

        Parameters
        ----------
        target
            `(markers, 3)`: the measured markers; read where they are seen.
        seen
            `(markers,)`.
        """
        self._target, self._seen = target[seen], seen
        if self._kernel is not None:
            hidden = np.where(seen[:, None], target, np.nan)
            self._frame = pack_frames(hidden[None], self.binding.weights)[0]

    def markers(self, values: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Virtual markers `(markers, 3)` and their derivative `(markers, 3, parameters)`."""
        if self._kernel is None:
            return self.binding.evaluate(values)
        positions, jacobian = self.markers_of_frames(values[None])
        return positions[0], jacobian[0]

    def markers_of_frames(self, values: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Virtual markers of many frames, and their derivatives.

        Parameters
        ----------
        values
            `(frames, parameters)`.

        Returns
        -------
        positions
            `(frames, markers, 3)`.
        jacobian
            `(frames, markers, 3, parameters)`.
        """
        if self._kernel is None:
            pairs = [self.binding.evaluate(frame) for frame in values]
            return np.array([p for p, _ in pairs]), np.array([j for _, j in pairs])
        positions, jacobian = self._kernel.markers_of_frames(
            self._slots, values, len(self.binding.names)
        )
        return positions, jacobian

    def cost(self, values: FloatArray, gradient: FloatArray) -> float:
        """Cost of the frame at `(parameters,)` values, whose gradient is put into an array."""
        if self._kernel is None:
            positions, jacobian = self.binding.evaluate(values)
            weights, seen = self.binding.weights, self._seen
            difference = positions[seen] - self._target
            value, pull = cost(difference, weights[seen], self._objective, self._threshold)
            gradient[:] = np.tensordot(pull, jacobian[seen], 2)
            return value
        return float(
            self._kernel.evaluate(
                self._slots.plan,
                self._slots.numbers,
                self._room,
                values[None],
                self._frame,
                self._code,
                self._threshold,
                self._rows,
                self._shares,
                gradient,
            )
        )


def check_objective(objective: str, huber_threshold: float) -> None:
    """Refuse an objective that is unknown, or a threshold that is out of range.

    Parameters
    ----------
    objective
        Name of the objective.
    huber_threshold
        Distance at which Huber's objective turns from squares to distances, millimetres.

    Raises
    ------
    ConfigurationError
        If one of them cannot be used.
    """
    if objective not in OBJECTIVES:
        raise ConfigurationError(
            "the objective is unknown", found=objective, expected=f"one of {', '.join(OBJECTIVES)}"
        )
    if not (np.isfinite(huber_threshold) and huber_threshold > 0):
        raise ConfigurationError(
            "Huber's threshold is out of range", found=huber_threshold, expected="above 0"
        )


def _kernel() -> Any:
    """The compiled kernel, or None without numba."""
    try:
        from mocap_fit.fitting import kernel
    except ImportError:
        return None
    return kernel


def cost(
    residuals: FloatArray, weights: FloatArray, objective: Objective, threshold: float
) -> tuple[float, FloatArray]:
    """Cost of a frame's residual vectors, and its derivative by them.

    Parameters
    ----------
    residuals
        `(markers, 3)`, millimetres: virtual minus measured marker.
    weights
        `(markers,)`.
    objective
        ``distances``: the weighted sum of distances, eq. 3 of Beskow. ``squares``: of squared
        distances. ``huber``: squared up to a threshold and straight beyond it.
    threshold
        Huber's, millimetres.

    Returns
    -------
    value
        The cost.
    pull
        `(markers, 3)`: derivative of the cost by the residual vectors. Where a distance is 0 it
        has none; 0 is given.
    """
    if objective == "squares":
        return float(np.einsum("m,mi,mi->", weights, residuals, residuals)), (
            2.0 * weights[:, None] * residuals
        )
    distances = np.sqrt(np.einsum("mi,mi->m", residuals, residuals))
    if objective == "distances":
        slope = weights / np.maximum(distances, 1e-12)
        return float(weights @ distances), slope[:, None] * residuals
    near = distances <= threshold
    values = np.where(near, distances**2, 2.0 * threshold * distances - threshold**2)
    slope = np.where(near, 2.0, 2.0 * threshold / np.maximum(distances, 1e-12))
    return float(weights @ values), (weights * slope)[:, None] * residuals
