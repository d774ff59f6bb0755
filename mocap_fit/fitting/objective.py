"""What the shape fit minimises in a frame: distances, squares, or Huber's compromise."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from mocap_fit.fitting.binding import Binding
from mocap_fit.tracks import FloatArray

Objective = Literal["distances", "squares", "huber"]
OBJECTIVES: tuple[Objective, ...] = ("distances", "squares", "huber")


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
            count, parameters = len(binding.names), len(binding.parameter_names)
            self._arrays = self._kernel.kernel_arrays(binding)
            self._positions = np.empty((count, 3))
            self._jacobian = np.empty((count, 3, parameters))
            self._code = OBJECTIVES.index(objective)

    def markers(self, values: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Virtual markers `(markers, 3)` and their derivative `(markers, 3, parameters)`.

        The next call may overwrite them.
        """
        if self._kernel is None:
            return self.binding.evaluate(values)
        self._kernel.evaluate(self._arrays, values, self._positions, self._jacobian)
        return self._positions, self._jacobian

    def cost(
        self,
        values: FloatArray,
        target: FloatArray,
        seen: NDArray[np.bool_],
        gradient: FloatArray,
    ) -> float:
        """Cost of a frame, whose gradient is put into the array given.

        Parameters
        ----------
        values
            `(parameters,)`.
        target
            `(markers, 3)`: the measured markers; read where they are seen.
        seen
            `(markers,)`.
        gradient
            `(parameters,)`, filled.
        """
        weights = self.binding.weights
        if self._kernel is None:
            positions, jacobian = self.binding.evaluate(values)
            difference = positions[seen] - target[seen]
            value, pull = cost(difference, weights[seen], self._objective, self._threshold)
            gradient[:] = np.tensordot(pull, jacobian[seen], 2)
            return value
        return float(
            self._kernel.frame_cost(
                self._arrays,
                values,
                target,
                seen,
                weights,
                self._code,
                self._threshold,
                gradient,
                self._positions,
                self._jacobian,
            )
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
