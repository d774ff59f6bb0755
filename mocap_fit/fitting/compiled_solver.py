"""The shape fit's fast solver: the compiled kernel, Newton's method, and nlopt's C functions."""

from __future__ import annotations

import nlopt
import numpy as np
from numpy.typing import NDArray

from mocap_fit.fitting import native
from mocap_fit.fitting.binding import Binding
from mocap_fit.fitting.newton import make_workspace, solve_frames
from mocap_fit.fitting.objective import OBJECTIVES, Objective, compute_reference_jacobian
from mocap_fit.fitting.packed_binding import allocate_aligned, pack, pack_frames
from mocap_fit.fitting.precision import find_undetermined
from mocap_fit.fitting.solving import (
    CERTIFYING,
    COST_TOLERANCE,
    NEWTON,
    NEWTON_NLOPT,
    VALUE_TOLERANCE,
    Solution,
    compute_variable_scale,
)
from mocap_fit.tracks import FloatArray

# Newton's method ends a frame when the expected decrease is less than this part of its cost.
_NEWTON_TOLERANCE = 1e-9
# nlopt's first step is a unit of its variables, which is too long near the minimum.
_CERTIFYING_SCALE = 0.5
# nlopt stops where it lowers the cost of Newton's result by less than this part of it.
_CERTIFIED = 1e-8


class CompiledSolver:
    """Newton's method, one of nlopt's algorithms, or the one certified by the other.

    Parameters
    ----------
    binding
        Virtual markers, of a rig that compiles.
    objective
        Cost of a frame.
    threshold
        Huber's threshold, millimetres of the face.
    solver
        ``"newton"``, ``"newton-nlopt"`` or the name of an nlopt algorithm.
    maximum_evaluations
        Largest number of nlopt's evaluations of a frame.
    """

    def __init__(
        self,
        binding: Binding,
        objective: Objective,
        threshold: float,
        *,
        solver: str,
        maximum_evaluations: int,
    ) -> None:
        self._binding = binding
        self._code = OBJECTIVES.index(objective)
        self._threshold = threshold
        self._packed = pack(binding)
        self._workspace = allocate_aligned(self._packed.workspace_size)
        self._work = make_workspace(self._packed)
        self._bounds = np.ascontiguousarray(binding.rig.bounds)
        self._predict = solver in (NEWTON, NEWTON_NLOPT)
        self._jacobian = compute_reference_jacobian(binding)
        self._nlopt: native.NativeSolver | None = None
        self._last = np.clip(binding.reference_parameters, self._bounds[:, 0], self._bounds[:, 1])
        if solver == NEWTON:
            return
        certify = solver == NEWTON_NLOPT
        scale = compute_variable_scale(self._jacobian, binding.weights)
        self._nlopt = native.NativeSolver(
            self._packed,
            objective=self._code,
            threshold=threshold,
            algorithm=getattr(nlopt, CERTIFYING if certify else solver),
            scale=scale * (_CERTIFYING_SCALE if certify else 1.0),
            bounds=self._bounds,
            tolerances=(VALUE_TOLERANCE, _CERTIFIED if certify else COST_TOLERANCE),
            maximum_evaluations=maximum_evaluations,
        )

    def solve(self, targets: FloatArray, head: FloatArray, usable: NDArray[np.bool_]) -> Solution:
        """Minimise the cost of the usable frames, each from the result of the one before.

        Parameters
        ----------
        targets
            Measured face markers, ``(frames, markers, 3)``, millimetres of the face; NaN where
            hidden.
        head
            Head markers, ``(frames, head markers, 3)``, millimetres of the face; not used.
        usable
            Which frames are solution, ``(frames,)``, no unit.

        Returns
        -------
        Solution
            Parameters, costs and status of the frames.
        """
        weights = self._binding.weights
        solution = Solution.allocate(len(targets), self._packed.parameters)
        frames = pack_frames(targets[usable], weights)
        seen = np.isfinite(targets[usable, :, 0])
        fixed = find_undetermined(self._jacobian, np.where(seen, weights, 0.0))
        values = np.empty((len(frames), self._packed.parameters))
        costs, evaluations = np.empty(len(frames)), np.zeros(len(frames), dtype=np.int64)
        status = np.full(len(frames), 3, dtype=np.int64)
        before = self._last.copy()
        if self._predict:
            solve_frames(
                self._packed.plan,
                self._packed.numbers,
                self._workspace,
                self._work,
                frames,
                self._last,
                self._code,
                self._threshold,
                self._bounds,
                fixed,
                _NEWTON_TOLERANCE,
                values,
                costs,
                evaluations,
            )
        if self._nlopt is not None and len(frames):
            starts = values if self._predict else None
            values, costs, more, status = self._nlopt.solve(frames, starts, before, fixed)
            evaluations += more
            self._last = values[-1].copy()
        # Scaled and unscaled, a value at its bound may be a rounding error beyond it.
        solution.values[usable] = np.clip(values, self._bounds[:, 0], self._bounds[:, 1])
        solution.costs[usable] = costs
        solution.evaluations[usable], solution.status[usable] = evaluations, status
        return solution
