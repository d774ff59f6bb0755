"""The shape fit's fast solver: the compiled kernel, Newton's method, and nlopt's C functions."""

from __future__ import annotations

import nlopt
import numpy as np
from numpy.typing import NDArray

from mocap_fit.fitting import native
from mocap_fit.fitting.binding import Binding
from mocap_fit.fitting.newton import newton_room, solve_frames
from mocap_fit.fitting.objective import OBJECTIVES, Objective, reference_jacobian
from mocap_fit.fitting.precision import undetermined
from mocap_fit.fitting.slots import aligned_zeros, pack, pack_frames
from mocap_fit.fitting.solving import (
    CERTIFYING,
    COST_TOLERANCE,
    NEWTON,
    NEWTON_NLOPT,
    VALUE_TOLERANCE,
    Solved,
    variable_scale,
)
from mocap_fit.tracks import FloatArray

# Newton's method ends a frame when what is left to gain is less than this part of its cost.
_NEWTON_TOLERANCE = 1e-9
# nlopt's first step goes as far as a unit of its variables; near the answer that is too far.
_CERTIFYING_SCALE = 0.5
# What nlopt must still gain on Newton's answer to go on.
_CERTIFIED = 1e-8


class CompiledSolver:
    """Newton's method, one of nlopt's algorithms, or the one certified by the other.

    Parameters
    ----------
    binding
        The virtual markers, of a rig that compiles.
    objective, threshold
        See `objective.cost`.
    solver
        ``newton``, ``newton-nlopt`` or an nlopt algorithm.
    maximum_evaluations
        Of a frame, by nlopt.
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
        self._slots = pack(binding)
        self._room = aligned_zeros(self._slots.room)
        self._work = newton_room(self._slots)
        self._bounds = np.ascontiguousarray(binding.rig.bounds)
        self._predict = solver in (NEWTON, NEWTON_NLOPT)
        self._tolerance = _NEWTON_TOLERANCE
        self._jacobian = reference_jacobian(binding)
        self._nlopt: native.NativeSolver | None = None
        self._last = np.clip(binding.reference_parameters, self._bounds[:, 0], self._bounds[:, 1])
        if solver == NEWTON:
            return
        certify = solver == NEWTON_NLOPT
        scale = variable_scale(self._jacobian, binding.weights)
        self._nlopt = native.NativeSolver(
            self._slots,
            objective=self._code,
            threshold=threshold,
            algorithm=getattr(nlopt, CERTIFYING if certify else solver),
            scale=scale * (_CERTIFYING_SCALE if certify else 1.0),
            bounds=self._bounds,
            tolerances=(VALUE_TOLERANCE, _CERTIFIED if certify else COST_TOLERANCE),
            maximum_evaluations=maximum_evaluations,
        )

    def solve(self, targets: FloatArray, head: FloatArray, usable: NDArray[np.bool_]) -> Solved:
        """Minimise the cost of the usable frames, each from the answer before; see `Solver`."""
        weights = self._binding.weights
        solved = Solved.empty(len(targets), self._slots.parameters)
        frames = pack_frames(targets[usable], weights)
        seen = np.isfinite(targets[usable, :, 0])
        fixed = undetermined(self._jacobian, np.where(seen, weights, 0.0))
        values = np.empty((len(frames), self._slots.parameters))
        costs, evaluations = np.empty(len(frames)), np.zeros(len(frames), dtype=np.int64)
        status = np.full(len(frames), 3, dtype=np.int64)
        before = self._last.copy()
        if self._predict:
            solve_frames(
                self._slots.plan,
                self._slots.numbers,
                self._room,
                self._work,
                frames,
                self._last,
                self._code,
                self._threshold,
                self._bounds,
                fixed,
                self._tolerance,
                values,
                costs,
                evaluations,
            )
        if self._nlopt is not None and len(frames):
            starts = values if self._predict else None
            values, costs, more, status = self._nlopt.solve(frames, starts, before, fixed)
            evaluations += more
            self._last = values[-1].copy()
        # Scaled to and fro, a value at its bound may come out a rounding beyond it.
        solved.values[usable] = np.clip(values, self._bounds[:, 0], self._bounds[:, 1])
        solved.costs[usable] = costs
        solved.evaluations[usable], solved.status[usable] = evaluations, status
        return solved
