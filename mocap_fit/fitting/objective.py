"""The cost of a frame: sum of distances, of squares, or Huber's."""

from __future__ import annotations

import weakref
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from mocap_fit.errors import ConfigurationError
from mocap_fit.fitting.binding import Binding
from mocap_fit.fitting.packed_binding import SLOT, allocate_aligned, pack, pack_frames
from mocap_fit.tracks import FloatArray

Objective = Literal["distances", "squares", "huber"]
OBJECTIVES: tuple[Objective, ...] = ("distances", "squares", "huber")


_jacobians: weakref.WeakKeyDictionary[Binding, FloatArray] = weakref.WeakKeyDictionary()


def compute_reference_jacobian(binding: Binding) -> FloatArray:
    """Compute the Jacobian of the virtual markers in the reference pose, once for a binding.

    Parameters
    ----------
    binding
        Virtual markers.

    Returns
    -------
    ndarray
        Jacobian, ``(markers, 3, parameters)``, millimetres per unit.
    """
    if binding not in _jacobians:
        _, _jacobians[binding] = binding.evaluate(binding.reference_parameters)
    return _jacobians[binding]


class Evaluator:
    """Virtual markers and costs of a binding: compiled where it can be, else in plain numpy.

    Parameters
    ----------
    binding
        Virtual markers.
    objective
        Cost of a frame.
    threshold
        Huber's threshold, millimetres of the face.
    """

    def __init__(self, binding: Binding, objective: Objective, threshold: float) -> None:
        self.binding = binding
        self._objective = objective
        self._threshold = threshold
        self._kernel = None if binding.compiled is None else _import_kernel()
        if self._kernel is not None:
            self._packed = pack(binding)
            rows = self._packed.blocks * SLOT
            self._workspace = allocate_aligned(self._packed.workspace_size)
            self._rows = allocate_aligned(1, rows)
            self._products = allocate_aligned(1, self._packed.parameters, rows)
            self._code = OBJECTIVES.index(objective)
        self.set_frame(np.zeros((len(binding.names), 3)), np.ones(len(binding.names), dtype=bool))

    def set_frame(self, target: FloatArray, seen: NDArray[np.bool_]) -> None:
        """Set the measured markers of the frame whose cost is computed.

        Parameters
        ----------
        target
            Measured markers, ``(markers, 3)``, millimetres of the face; read where they are seen.
        seen
            Which markers are seen, ``(markers,)``, no unit.
        """
        self._target, self._seen = target[seen], seen
        if self._kernel is not None:
            hidden = np.where(seen[:, None], target, np.nan)
            self._frame = pack_frames(hidden[None], self.binding.weights)[0]

    def evaluate(self, values: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Compute the virtual markers and their Jacobian.

        Parameters
        ----------
        values
            Parameters, ``(parameters,)``; 0 is rest, 1 the full gesture.

        Returns
        -------
        positions : ndarray
            Virtual markers, ``(markers, 3)``, millimetres.
        jacobian : ndarray
            Their derivatives, ``(markers, 3, parameters)``, millimetres per unit.
        """
        if self._kernel is None:
            return self.binding.evaluate(values)
        positions, jacobian = self.evaluate_frames(values[None])
        return positions[0], jacobian[0]

    def evaluate_frames(self, values: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Compute the virtual markers of many frames, and their Jacobians.

        Parameters
        ----------
        values
            Parameters, ``(frames, parameters)``; 0 is rest, 1 the full gesture.

        Returns
        -------
        positions : ndarray
            Virtual markers, ``(frames, markers, 3)``, millimetres.
        jacobian : ndarray
            Their derivatives, ``(frames, markers, 3, parameters)``, millimetres per unit.
        """
        if self._kernel is None:
            pairs = [self.binding.evaluate(frame) for frame in values]
            return np.array([p for p, _ in pairs]), np.array([j for _, j in pairs])
        positions, jacobian = self._kernel.evaluate_frames(
            self._packed, values, len(self.binding.names)
        )
        return positions, jacobian

    def cost(self, values: FloatArray, gradient: FloatArray) -> float:
        """Return the cost of the frame, and fill its gradient.

        Parameters
        ----------
        values
            Parameters, ``(parameters,)``; 0 is rest, 1 the full gesture.
        gradient
            Filled with the gradient, ``(parameters,)``, in the unit of the cost.

        Returns
        -------
        float
            Cost.
        """
        if self._kernel is None:
            positions, jacobian = self.binding.evaluate(values)
            weights, seen = self.binding.weights, self._seen
            difference = positions[seen] - self._target
            value, slopes = cost(difference, weights[seen], self._objective, self._threshold)
            gradient[:] = np.tensordot(slopes, jacobian[seen], 2)
            return value
        return float(
            self._kernel.evaluate(
                self._packed.plan,
                self._packed.numbers,
                self._workspace,
                values[None],
                self._frame,
                self._code,
                self._threshold,
                self._rows,
                self._products,
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


def _import_kernel() -> Any:
    """Import the compiled kernel, or return None without numba."""
    try:
        from mocap_fit.fitting import kernel
    except ImportError:
        return None
    return kernel


def cost(
    residuals: FloatArray, weights: FloatArray, objective: Objective, threshold: float
) -> tuple[float, FloatArray]:
    """Compute the cost of a frame's residual vectors, and its derivative by them.

    Parameters
    ----------
    residuals
        Virtual minus measured markers, ``(markers, 3)``, millimetres.
    weights
        Weights of the markers, ``(markers,)``, no unit.
    objective
        ``"distances"``: the weighted sum of distances, eq. 3 of Beskow. ``"squares"``: of squared
        distances. ``"huber"``: of d² up to the threshold h, and of 2hd - h² beyond it (Huber,
        Annals of Mathematical Statistics 35, 1964, times 2).
    threshold
        Huber's threshold, millimetres.

    Returns
    -------
    value : float
        Cost.
    gradient : ndarray
        Derivative of the cost by the residual vectors, ``(markers, 3)``; 0 at a distance of 0,
        where the sum of distances has none.
    """
    if objective == "squares":
        value = float(np.einsum("m,mi,mi->", weights, residuals, residuals))
        return value, 2.0 * weights[:, None] * residuals
    distances = np.sqrt(np.einsum("mi,mi->m", residuals, residuals))
    if objective == "distances":
        slope = weights / np.maximum(distances, 1e-12)
        return float(weights @ distances), slope[:, None] * residuals
    near = distances <= threshold
    values = np.where(near, distances**2, 2.0 * threshold * distances - threshold**2)
    slope = np.where(near, 2.0, 2.0 * threshold / np.maximum(distances, 1e-12))
    return float(weights @ values), (weights * slope)[:, None] * residuals
