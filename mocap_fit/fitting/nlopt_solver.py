"""The shape fit's solver through nlopt's Python classes.

It serves every rig and setting: rigs that cannot be compiled, a refined pose, and machines without
numba or nlopt's C functions. `compiled_solver.py` is faster.
"""

from __future__ import annotations

import nlopt
import numpy as np
from numpy.typing import NDArray

from mocap_fit.fitting.binding import Binding
from mocap_fit.fitting.objective import Evaluator, Objective, cost
from mocap_fit.fitting.orientation import move_by_pose
from mocap_fit.fitting.precision import find_undetermined
from mocap_fit.fitting.solving import (
    COST_TOLERANCE,
    VALUE_TOLERANCE,
    Solution,
    compute_variable_scale,
)
from mocap_fit.tracks import FloatArray

# nlopt's wheels have raised its own errors and Python's, depending on their version.
_NLOPT_ERRORS: tuple[type[Exception], ...] = (
    RuntimeError,
    getattr(nlopt, "runtime_error", RuntimeError),
)
# Typical distance of a face marker from the head's centre, millimetres.
_ARM = 100.0
# Largest correction of a refined pose, radians and millimetres.
_LARGEST_TURN, _LARGEST_SHIFT = 0.5, 50.0


class NloptSolver:
    """One of nlopt's algorithms, frame after frame, in Python.

    Parameters
    ----------
    binding
        Virtual markers.
    objective
        Cost of a frame.
    threshold
        Huber's threshold, millimetres of the face.
    algorithm
        Name of nlopt's algorithm.
    refine_pose
        Whether the variables include a correction of the head's pose.
    maximum_evaluations
        Largest number of evaluations of a frame.
    """

    def __init__(
        self,
        binding: Binding,
        objective: Objective,
        threshold: float,
        *,
        algorithm: str,
        refine_pose: bool,
        maximum_evaluations: int,
    ) -> None:
        self._binding = binding
        self._objective = objective
        self._threshold = threshold
        self._evaluator = Evaluator(binding, objective, threshold)
        self._refine = refine_pose
        self._count = len(binding.parameter_names)
        _, self._jacobian = self._evaluator.evaluate(binding.reference_parameters)
        self._scale = compute_variable_scale(self._jacobian, binding.weights)
        bounds = binding.rig.bounds
        if refine_pose:
            pose = np.array([_ARM] * 3 + [1.0] * 3)
            self._centre = binding.head_positions.mean(axis=0)
            weight = np.sqrt(binding.weights.sum() + binding.head_weights.sum())
            self._scale = np.concatenate([self._scale, 1.0 / (weight * pose)])
            limits = np.array([_LARGEST_TURN] * 3 + [_LARGEST_SHIFT] * 3)
            bounds = np.concatenate([bounds, np.stack([-limits, limits], axis=1)])
        self._bounds = bounds
        self._x = np.zeros(len(self._scale))
        self._x[: self._count] = binding.reference_parameters
        # LN_PRAXIS draws directions: the same ones, whatever was solution before.
        nlopt.srand(1)
        self._optimiser = nlopt.opt(getattr(nlopt, algorithm), len(self._x))
        self._optimiser.set_min_objective(self._cost)
        self._optimiser.set_xtol_abs(VALUE_TOLERANCE / self._scale)
        self._optimiser.set_ftol_rel(COST_TOLERANCE)
        self._optimiser.set_initial_step(0.1 / self._scale)
        self._optimiser.set_maxeval(maximum_evaluations)
        self._gradient = np.zeros(len(self._x))
        self._evaluations = 0
        self._best_cost = np.inf
        self._best = self._x.copy()

    def solve(self, targets: FloatArray, head: FloatArray, usable: NDArray[np.bool_]) -> Solution:
        """Minimise the cost of the usable frames, each from the result of the one before.

        Parameters
        ----------
        targets
            Measured face markers, ``(frames, markers, 3)``, millimetres of the face; NaN where
            hidden.
        head
            Head markers, ``(frames, head markers, 3)``, millimetres of the face; NaN where hidden.
        usable
            Which frames are solution, ``(frames,)``, no unit.

        Returns
        -------
        Solution
            Parameters, costs and status of the frames.
        """
        frames = len(targets)
        solution = Solution.allocate(frames, self._count)
        seen = np.isfinite(targets[:, :, 0])
        fixed = find_undetermined(self._jacobian, np.where(seen, self._binding.weights, 0.0))
        for frame in np.flatnonzero(usable):
            self._head, self._head_seen = head[frame], np.isfinite(head[frame, :, 0])
            self._target, self._seen = targets[frame], seen[frame]
            self._evaluator.set_frame(self._target, self._seen)
            solution.status[frame] = self._solve(fixed[frame])
            solution.values[frame] = self._x[: self._count]
            solution.costs[frame] = self._best_cost
            solution.evaluations[frame] = self._evaluations
            if self._refine:
                solution.corrections[frame] = self._x[self._count :]
        return solution

    def _solve(self, fixed: NDArray[np.bool_]) -> int:
        """Minimise the current frame from the last result; return nlopt's result code."""
        self._evaluations, self._best_cost = 0, np.inf
        lower, upper = self._bounds[:, 0].copy(), self._bounds[:, 1].copy()
        held = np.flatnonzero(fixed)
        lower[held], upper[held] = self._x[held], self._x[held]
        self._optimiser.set_lower_bounds(lower / self._scale)
        self._optimiser.set_upper_bounds(upper / self._scale)
        self._best = self._x
        try:
            self._optimiser.optimize(self._x / self._scale)
            result = int(self._optimiser.last_optimize_result())
        except nlopt.RoundoffLimited:
            result = -4
        except _NLOPT_ERRORS:
            # LBFGS and SLSQP also end so at the minimum; the best point is used.
            result = -1
        self._x = np.clip(self._best, self._bounds[:, 0], self._bounds[:, 1])
        return result

    def _cost(self, scaled: FloatArray, gradient: FloatArray) -> float:
        """Return the cost of the current frame as nlopt calls it, and fill its gradient."""
        self._evaluations += 1
        x = scaled * self._scale
        if self._refine:
            value = self._compute_cost_with_pose(x)
        else:
            value = self._evaluator.cost(x, self._gradient)
        if not (np.isfinite(value) and np.isfinite(self._gradient).all()):
            # A NaN can hang nlopt's algorithms; a huge cost only rejects the point.
            gradient[:] = 0.0
            return 1e30
        if gradient.size:
            gradient[:] = self._gradient * self._scale
        if value < self._best_cost:
            self._best_cost, self._best = value, x
        return value

    def _compute_cost_with_pose(self, x: FloatArray) -> float:
        """Return the cost over face and head markers, and store its gradient."""
        seen, head_seen = self._seen, self._head_seen
        positions, jacobian = move_by_pose(
            *self._evaluator.evaluate(x[: self._count]), self._centre, x[self._count :]
        )
        value, gradient = cost(
            positions[seen] - self._target[seen],
            self._binding.weights[seen],
            self._objective,
            self._threshold,
        )
        self._gradient[:] = np.tensordot(gradient, jacobian[seen], 2)
        still = self._binding.head_positions[head_seen]
        rigid = np.zeros((*still.shape, self._count))
        head, head_jacobian = move_by_pose(still, rigid, self._centre, x[self._count :])
        head_value, head_gradient = cost(
            head - self._head[head_seen],
            self._binding.head_weights[head_seen],
            self._objective,
            self._threshold,
        )
        self._gradient += np.tensordot(head_gradient, head_jacobian, 2)
        return value + head_value
