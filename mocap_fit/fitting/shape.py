"""The shape fit: face parameters frame by frame (Beskow eq. 3)."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mocap_fit.errors import ConfigurationError, DataError, MocapFitWarning
from mocap_fit.fitting.binding import Binding, check_recording
from mocap_fit.fitting.objective import (
    Evaluator,
    Objective,
    check_objective,
    compute_reference_jacobian,
)
from mocap_fit.fitting.orientation import move_by_pose
from mocap_fit.fitting.precision import (
    compute_covariance,
    compute_deviations,
    estimate_noise,
)
from mocap_fit.fitting.solving import (
    ALGORITHMS,
    NEWTON_NLOPT,
    NOT_FITTED,
    PLAIN,
    SOLVERS,
    Solution,
    Solver,
)
from mocap_fit.tracks import FloatArray, MarkerTracks, ParameterTracks

# Frames that are solved together: memory for their Jacobians is needed at one time.
_CHUNK = 512
# Where hidden markers make a parameter this many times less certain, it is not worth reading.
_UNCERTAIN = 10.0


@dataclass(frozen=True, eq=False)
class ShapeFit:
    """What a shape fit found, and how.

    Parameters
    ----------
    parameters
        The parameter tracks, with standard deviations and residuals in millimetres of the
        speaker.
    marker_names
        Names of the face markers.
    marker_residuals
        `(frames, markers)`: distance of each visible marker from its virtual marker,
        millimetres of the speaker; NaN where hidden.
    costs
        `(frames,)`: the objective at the answer, in the face's millimetres.
    evaluations
        `(frames,)`: how often the objective was evaluated.
    status
        `(frames,)`: why the solver stopped; `mocap_fit.fitting.solving.STATUS` says each in words.
    pose_corrections
        `(frames, 6)`: rotation vector (radians) about the middle of the head markers, and
        translation (millimetres of the face), found with ``refine_pose``; else zeros.
    noise
        Standard deviation of a coordinate of a marker as the residuals show it, millimetres of
        the speaker.
    """

    parameters: ParameterTracks
    marker_names: tuple[str, ...]
    marker_residuals: FloatArray
    costs: FloatArray
    evaluations: NDArray[np.int64]
    status: NDArray[np.int64]
    pose_corrections: FloatArray
    noise: float

    @property
    def fitted(self) -> NDArray[np.bool_]:
        """Which frames were fitted."""
        return np.asarray(self.status != NOT_FITTED)

    def __str__(self) -> str:
        fitted = self.fitted
        residuals = self.parameters.residuals[fitted]
        middle = float(np.nanmedian(residuals)) if fitted.any() else float("nan")
        return (
            f"{int(fitted.sum())} of {len(fitted)} frames fitted, median residual {middle:.3f} mm, "
            f"{float(self.evaluations[fitted].mean()) if fitted.any() else 0:.0f} evaluations a "
            f"frame, {int(self.parameters.uncertain.any(axis=1).sum())} frames with an uncertain "
            "parameter"
        )


def fit_shape(
    binding: Binding,
    recording: MarkerTracks,
    *,
    objective: Objective = "distances",
    solver: str = NEWTON_NLOPT,
    huber_threshold: float = 1.0,
    refine_pose: bool = False,
    maximum_evaluations: int = 2000,
    progress: Callable[[int], object] | None = None,
) -> ShapeFit:
    """Find the face parameters that best explain the markers, frame by frame.

    Parameters
    ----------
    binding
        The virtual markers; from `bind_markers`.
    recording
        The recording in head coordinates; from `remove_head_motion`.
    objective
        What is minimised over the visible markers: the weighted sum of ``distances`` (eq. 3),
        of ``squares``, or ``huber``.
    solver
        ``newton-nlopt``: Newton's method predicts, and nlopt, started there, certifies.
        ``newton``: Newton's method alone. Or one of nlopt's algorithms alone, such as
        ``LN_PRAXIS``, Powell's, as in the paper.
    huber_threshold
        Where Huber's objective turns from squares to distances, millimetres of the speaker.
    refine_pose
        Find a small correction of the head's pose together with the shape, from all markers:
        few reference markers make a noisy pose.
    maximum_evaluations
        nlopt stops a frame after so many.
    progress
        Called with the number of frames done so far.

    Returns
    -------
    ShapeFit
        Parameters, residuals, and what the solver did in every frame.

    Raises
    ------
    DataError
        If the recording lacks a marker of the layout, or no frame can be fitted.
    ConfigurationError
        If the objective or the solver is unknown, or a setting is not possible.

    Notes
    -----
    Each frame starts from the answer of the frame before. Hidden markers are left out. A
    parameter that the visible markers leave find_undetermined keeps its value from the frame before,
    and its standard deviation is infinite.
    """
    check_objective(objective, huber_threshold)
    _check_solver(binding, solver, refine_pose, maximum_evaluations)
    check_recording(binding, recording)
    scale = binding.orientation.scale
    frame_solver = _choose_solver(
        binding, objective, huber_threshold * scale, solver, refine_pose, maximum_evaluations
    )
    parts, distances = [], np.full((recording.frames, len(binding.names)), np.nan)
    deviations = np.full((recording.frames, len(binding.parameter_names)), np.nan)
    for start in range(0, recording.frames, _CHUNK):
        chunk = slice(start, start + _CHUNK)
        solved, distances[chunk], deviations[chunk] = _fit_chunk(
            binding, recording, chunk, frame_solver
        )
        parts.append(solved)
        if progress is not None:
            progress(min(start + _CHUNK, recording.frames))
    solved = Solution.concatenate(parts)
    fitted = solved.status != NOT_FITTED
    if not fitted.any():
        raise DataError(
            f"no frame of the recording '{recording.name}' can be fitted",
            found="no frame with its head pose and two visible face markers",
            advice="Check the head markers and the gaps with `mocap-fit info`.",
        )
    distances /= scale
    noise = estimate_noise(
        distances, binding.weights, len(binding.parameter_names) + 6 * refine_pose
    )
    with np.errstate(invalid="ignore"):
        residuals = np.sqrt(np.nansum(distances**2, axis=1) / np.isfinite(distances).sum(axis=1))
    tracks = ParameterTracks(
        binding.parameter_names,
        recording.rate,
        solved.values,
        # An find_undetermined parameter stays infinite even when the noise is nil.
        np.where(np.isinf(deviations), np.inf, deviations * noise * scale),
        np.where(fitted, residuals, np.nan),
        start_time=recording.start_time,
        name=recording.name,
        events=recording.events,
        provenance=recording.provenance,
    ).add_step(
        "fit_shape",
        {
            "objective": objective,
            "solver": solver,
            "refine_pose": refine_pose,
            "maximum_evaluations": maximum_evaluations,
            **({"huber_threshold": huber_threshold} if objective == "huber" else {}),
        },
    )
    return ShapeFit(
        tracks,
        binding.names,
        distances,
        solved.costs,
        solved.evaluations,
        solved.status,
        solved.corrections,
        noise,
    )


def _check_solver(
    binding: Binding, solver: str, refine_pose: bool, maximum_evaluations: int
) -> None:
    """Refuse a solver that is unknown, or cannot do what it is asked for."""
    if solver not in SOLVERS:
        raise ConfigurationError(
            "the solver is unknown", found=solver, expected=f"one of {', '.join(SOLVERS)}"
        )
    if maximum_evaluations < 1:
        raise ConfigurationError(
            "the number of evaluations is out of range",
            found=maximum_evaluations,
            expected="1 or more",
        )
    if refine_pose and len(binding.head_names) < 3:
        raise ConfigurationError(
            "refining the pose needs head markers in the layout and the reference pose",
            found=len(binding.head_names),
            expected="three or more",
        )


def _choose_solver(
    binding: Binding,
    objective: Objective,
    threshold: float,
    solver: str,
    refine_pose: bool,
    maximum_evaluations: int,
) -> Solver:
    """Return the fastest solver for these settings."""
    from mocap_fit.fitting.nlopt_solver import NloptSolver

    if binding.compiled is not None and not refine_pose:
        try:
            from mocap_fit.fitting.compiled_solver import CompiledSolver
            from mocap_fit.fitting.native import load_library
        except ImportError:
            pass  # without numba, the plain form gives the same answers
        else:
            if load_library() is not None or solver == "newton":
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
) -> tuple[Solution, FloatArray, FloatArray]:
    """Fit some frames; return the solution, marker distances, and parameter deviations.

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
        distances[usable], deviations[usable] = _measure_quality(
            binding, solved, targets, head, usable
        )
    return solved, distances, deviations


def _measure_quality(
    binding: Binding,
    solved: Solution,
    targets: FloatArray,
    head: FloatArray,
    usable: NDArray[np.bool_],
) -> tuple[FloatArray, FloatArray]:
    """Marker distances and parameter deviations of the usable frames."""
    evaluator = Evaluator(binding, "squares", 1.0)
    positions, jacobian = evaluator.evaluate_frames(solved.values[usable])
    corrections = solved.corrections[usable]
    for i in np.flatnonzero(corrections.any(axis=1)):
        centre = binding.head_positions.mean(axis=0)
        positions[i], _ = move_by_pose(positions[i], jacobian[i], centre, corrections[i])
    seen = np.isfinite(targets[usable, :, 0])
    weights = np.where(seen, binding.weights, 0.0)
    distances = np.linalg.norm(positions - targets[usable], axis=2)
    deviations, bare = compute_deviations(
        jacobian,
        weights,
        positions=positions,
        head_positions=binding.head_positions,
        head_weights=np.where(np.isfinite(head[usable, :, 0]), binding.head_weights, 0.0),
    )
    partly = np.flatnonzero(~seen.all(axis=1))
    if partly.size:
        everything = compute_reference_jacobian(binding)
        least = np.sqrt(np.diag(compute_covariance(everything, binding.weights)))
        uncertain = bare[partly] > _UNCERTAIN * least
        deviations[partly] = np.where(uncertain, np.inf, deviations[partly])
    return distances, deviations
