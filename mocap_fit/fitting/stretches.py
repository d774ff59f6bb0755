"""The shape fit of a recording that comes whole or in stretches.

What the fit gives of a frame depends on the frames before, through the start; its standard
deviations depend on the noise of the whole recording, and come last.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mocap_fit.errors import ConfigurationError, DataError, MocapFitWarning
from mocap_fit.fitting.binding import Binding, check_recording
from mocap_fit.fitting.objective import OBJECTIVES, Evaluator, Objective, reference_jacobian
from mocap_fit.fitting.orientation import moved_by_pose
from mocap_fit.fitting.precision import parameter_covariance, parameter_deviations
from mocap_fit.fitting.solving import (
    ALGORITHMS,
    NEWTON_NLOPT,
    NOT_FITTED,
    PLAIN,
    SOLVERS,
    Solved,
    Solver,
)
from mocap_fit.tracks import FloatArray, MarkerTracks

CHUNK = 512
"""Frames that are solved together; stretches of a multiple of it are fitted as the whole is."""

# Where hidden markers make a parameter this many times less certain, it is not worth reading.
_UNCERTAIN = 10.0


@dataclass(frozen=True, eq=False)
class StretchFit:
    """What was found in a stretch.

    Parameters
    ----------
    values
        `(frames, parameters)`; NaN where not fitted.
    deviations
        `(frames, parameters)`: standard deviations per unit of noise in the face's millimetres;
        `StretchFitter.standard_deviations` makes them what they are when the noise is known.
    residuals
        `(frames,)`, millimetres of the speaker.
    distances, costs, evaluations, status, corrections
        As `ShapeFit` has them.
    """

    values: FloatArray
    deviations: FloatArray
    residuals: FloatArray
    distances: FloatArray
    costs: FloatArray
    evaluations: NDArray[np.int64]
    status: NDArray[np.int64]
    corrections: FloatArray


class StretchFitter:
    """Fits the stretches of one recording, one after the other.

    Each starts from the answer to the one before. Memory does not grow with their number.

    Parameters
    ----------
    binding, objective, solver, huber_threshold, refine_pose, maximum_evaluations
        As for `fit_shape`.

    Raises
    ------
    ConfigurationError
        If the objective or the solver is unknown, or a setting is not possible.
    """

    def __init__(
        self,
        binding: Binding,
        *,
        objective: Objective = "distances",
        solver: str = NEWTON_NLOPT,
        huber_threshold: float = 1.0,
        refine_pose: bool = False,
        maximum_evaluations: int = 2000,
    ) -> None:
        if objective not in OBJECTIVES:
            raise ConfigurationError(
                "the objective is unknown",
                found=objective,
                expected=f"one of {', '.join(OBJECTIVES)}",
            )
        if solver not in SOLVERS:
            raise ConfigurationError(
                "the solver is unknown", found=solver, expected=f"one of {', '.join(SOLVERS)}"
            )
        if not (np.isfinite(huber_threshold) and huber_threshold > 0):
            raise ConfigurationError(
                "Huber's threshold is not possible", found=huber_threshold, expected="above 0"
            )
        if maximum_evaluations < 1:
            raise ConfigurationError(
                "the number of evaluations is not possible",
                found=maximum_evaluations,
                expected="1 up",
            )
        if refine_pose and len(binding.head_names) < 3:
            raise ConfigurationError(
                "refining the pose needs head markers in the layout and the reference pose",
                found=len(binding.head_names),
                expected="three or more",
            )
        self._binding, self._refine_pose = binding, refine_pose
        self._scale = binding.orientation.scale
        self.parameter_names = binding.parameter_names
        self._solver = _solver(
            binding,
            objective,
            huber_threshold * self._scale,
            solver,
            refine_pose,
            maximum_evaluations,
        )
        self._squares, self._freedom, self._fitted = 0.0, 0.0, 0
        self.arguments: dict[str, Any] = {
            "objective": objective,
            "solver": solver,
            "refine_pose": refine_pose,
            "maximum_evaluations": maximum_evaluations,
            **({"huber_threshold": huber_threshold} if objective == "huber" else {}),
        }
        """What the fit's step in the provenance says."""

    def fit(
        self, recording: MarkerTracks, progress: Callable[[int], object] | None = None
    ) -> StretchFit:
        """Fit the next stretch, in head coordinates.

        Parameters
        ----------
        recording
            A multiple of `CHUNK` frames, or any number in the last.
        progress
            Called with the number of its frames done so far.

        Raises
        ------
        DataError
            If the recording lacks a marker of the layout.
        """
        check_recording(self._binding, recording)
        chunks = []
        for start in range(0, recording.frames, CHUNK):
            solved, distances, deviations = _fit_chunk(
                self._binding, recording, slice(start, start + CHUNK), self._solver
            )
            distances /= self._scale
            squares, freedom = noise_sums(
                distances,
                self._binding.weights,
                len(self._binding.parameter_names) + 6 * self._refine_pose,
            )
            self._squares += squares
            self._freedom += freedom
            chunks.append((solved, distances, deviations))
            if progress is not None:
                progress(min(start + CHUNK, recording.frames))
        solved = Solved.joined([chunk[0] for chunk in chunks])
        distances, deviations = (np.concatenate([c[i] for c in chunks]) for i in (1, 2))
        fitted = solved.status != NOT_FITTED
        self._fitted += int(fitted.sum())
        with np.errstate(invalid="ignore"):
            squares_of = np.nansum(distances**2, axis=1)
            residuals = np.sqrt(squares_of / np.isfinite(distances).sum(axis=1))
        return StretchFit(
            solved.values,
            deviations,
            np.where(fitted, residuals, np.nan),
            distances,
            solved.costs,
            solved.evaluations,
            solved.status,
            solved.corrections,
        )

    def finish(self, name: str) -> None:
        """Refuse a recording, by its name, of which nothing could be fitted.

        Raises
        ------
        DataError
            If no frame was.
        """
        if not self._fitted:
            raise DataError(
                f"no frame of the recording '{name}' can be fitted",
                found="no frame with its head pose and two visible face markers",
                advice="Check the head markers and the gaps with `mocap-fit info`.",
            )

    @property
    def noise(self) -> float:
        """Standard deviation of a marker's coordinate, as all residuals so far show it, mm."""
        return noise_of(self._squares, self._freedom)

    def standard_deviations(self, deviations: FloatArray) -> FloatArray:
        """Those of `StretchFit.deviations`, `(frames, parameters)`, by the noise so far."""
        # An undetermined parameter stays infinite even when the noise is nil.
        return np.where(np.isinf(deviations), np.inf, deviations * self.noise * self._scale)


def noise_sums(
    distances: FloatArray, weights: FloatArray, parameters: int | FloatArray
) -> tuple[float, float]:
    """Weighted squares of residuals, and what is left of their freedom; over the frames.

    Parameters
    ----------
    distances
        `(frames, markers)`, NaN where hidden.
    weights
        `(markers,)`.
    parameters
        How many parameters each frame took; a number, or `(frames,)`.
    """
    seen = np.isfinite(distances)
    freedom = 3 * seen.sum(axis=1) - parameters
    frames = freedom > 0
    squares = np.where(seen, distances, 0.0) ** 2 * (weights / weights.mean())
    return float(squares[frames].sum()), float(freedom[frames].sum())


def noise_of(squares: float, freedom: float) -> float:
    """Standard deviation of a coordinate; NaN where no freedom is left."""
    return float(np.sqrt(squares / freedom)) if freedom > 0 else float("nan")


def _solver(
    binding: Binding,
    objective: Objective,
    threshold: float,
    solver: str,
    refine_pose: bool,
    maximum_evaluations: int,
) -> Solver:
    """Choose the fastest solver that can do what is asked."""
    from mocap_fit.fitting.nlopt_solver import NloptSolver

    if binding.compiled is not None and not refine_pose:
        try:
            from mocap_fit.fitting.compiled_solver import CompiledSolver
            from mocap_fit.fitting.native import library
        except ImportError:
            pass  # without numba, the plain form gives the same answers
        else:
            if library() is not None or solver == "newton":
                return CompiledSolver(
                    binding,
                    objective,
                    threshold,
                    solver=solver,
                    maximum_evaluations=maximum_evaluations,
                )
    algorithm = solver if solver in ALGORITHMS else PLAIN
    if solver not in (NEWTON_NLOPT, algorithm):
        warnings.warn(
            f"the solver '{solver}' is not to be had for this rig or this machine, or with a "
            f"refined pose; nlopt's {algorithm} is used",
            MocapFitWarning,
            stacklevel=4,
        )
    return NloptSolver(
        binding,
        objective,
        threshold,
        algorithm=algorithm,
        refine_pose=refine_pose,
        maximum_evaluations=maximum_evaluations,
    )


def _fit_chunk(
    binding: Binding,
    recording: MarkerTracks,
    frames: slice,
    solver: Solver,
) -> tuple[Solved, FloatArray, FloatArray]:
    """Fit some frames: what was solved, marker distances, and parameter deviations.

    Distances are in the face's millimetres, deviations per millimetre of noise.
    """
    positions = recording.positions[frames]
    targets = binding.orientation.apply(positions[:, recording.indices(binding.names)])
    head = np.full((len(positions), len(binding.head_names), 3), np.nan)
    for i, name in enumerate(binding.head_names):
        if name in recording.names:
            head[:, i] = binding.orientation.apply(positions[:, recording.index(name)])
    seen = np.isfinite(targets[:, :, 0])
    usable = seen.sum(axis=1) >= 2
    solved = solver.solve(targets, head, usable)
    distances = np.full(seen.shape, np.nan)
    deviations = np.full(solved.values.shape, np.nan)
    if usable.any():
        distances[usable], deviations[usable] = _quality(binding, solved, targets, head, usable)
    return solved, distances, deviations


def _quality(
    binding: Binding,
    solved: Solved,
    targets: FloatArray,
    head: FloatArray,
    usable: NDArray[np.bool_],
) -> tuple[FloatArray, FloatArray]:
    """Marker distances and parameter deviations of the usable frames."""
    evaluator = Evaluator(binding, "squares", 1.0)
    positions, jacobian = evaluator.markers_of_frames(solved.values[usable])
    corrections = solved.corrections[usable]
    for i in np.flatnonzero(corrections.any(axis=1)):
        centre = binding.head_positions.mean(axis=0)
        positions[i], _ = moved_by_pose(positions[i], jacobian[i], centre, corrections[i])
    seen = np.isfinite(targets[usable, :, 0])
    weights = np.where(seen, binding.weights, 0.0)
    distances = np.linalg.norm(positions - targets[usable], axis=2)
    deviations, bare = parameter_deviations(
        jacobian,
        weights,
        positions=positions,
        head_positions=binding.head_positions,
        head_weights=np.where(np.isfinite(head[usable, :, 0]), binding.head_weights, 0.0),
    )
    partly = np.flatnonzero(~seen.all(axis=1))
    if partly.size:
        everything = reference_jacobian(binding)
        least = np.sqrt(np.diag(parameter_covariance(everything, binding.weights)))
        uncertain = bare[partly] > _UNCERTAIN * least
        deviations[partly] = np.where(uncertain, np.inf, deviations[partly])
    return distances, deviations
