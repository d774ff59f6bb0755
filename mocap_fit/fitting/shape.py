"""The shape fit: face parameters frame by frame (Beskow eq. 3)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import nlopt
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from mocap_fit.errors import ConfigurationError, DataError
from mocap_fit.fitting.binding import Binding
from mocap_fit.fitting.objective import OBJECTIVES, Evaluator, Objective, cost
from mocap_fit.fitting.orientation import left_jacobian
from mocap_fit.fitting.precision import parameter_covariance, rigid_motion_effect
from mocap_fit.tracks import FloatArray, MarkerTracks, ParameterTracks

DEFAULT_SOLVER = "LD_SLSQP"
# nlopt's local algorithms that keep to bounds; the first letters say gradient (LD) or none (LN).
SOLVERS = (
    "LD_SLSQP",
    "LD_LBFGS",
    "LD_CCSAQ",
    "LD_MMA",
    "LD_VAR2",
    "LD_TNEWTON_PRECOND_RESTART",
    "LN_PRAXIS",
    "LN_BOBYQA",
    "LN_SBPLX",
    "LN_COBYLA",
    "LN_NELDERMEAD",
)
NOT_FITTED = 0
STATUS = {
    NOT_FITTED: "not fitted: too few markers are visible",
    1: "converged",
    2: "converged: cost reached",
    3: "converged: the cost no longer falls",
    4: "converged: the parameters no longer change",
    5: "stopped: maximum number of evaluations",
    -4: "converged as far as rounding lets it",
    -1: "failed: the best point so far is kept",
}

# nlopt's wheels have raised its own errors and Python's, depending on their version.
_NLOPT_ERRORS: tuple[type[Exception], ...] = (
    RuntimeError,
    getattr(nlopt, "runtime_error", RuntimeError),
)

# Where hidden markers make a parameter this many times less certain, it is not worth reading.
_UNCERTAIN = 10.0
# How far from the head's centre a face marker is, about, in millimetres.
_ARM = 100.0
# A refined pose stays within these of the one given, in radians and millimetres.
_LARGEST_TURN, _LARGEST_SHIFT = 0.5, 50.0


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
        `(frames,)`: why the solver stopped; `STATUS` says each in words.
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
        middle = float(np.median(residuals)) if fitted.any() else float("nan")
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
    solver: str = DEFAULT_SOLVER,
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
        An nlopt algorithm: gradient-based by default; ``LN_PRAXIS`` is Powell's, as in the paper.
    huber_threshold
        Where Huber's objective turns from squares to distances, millimetres of the speaker.
    refine_pose
        Find a small correction of the head's pose together with the shape, from all markers:
        few reference markers make a noisy pose.
    maximum_evaluations
        A frame's solver stops after so many.
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
    parameter that the visible markers leave undetermined keeps its value from the frame before,
    and its standard deviation is infinite.
    """
    if objective not in OBJECTIVES:
        raise ConfigurationError(
            "the objective is unknown", found=objective, expected=f"one of {', '.join(OBJECTIVES)}"
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
            "the number of evaluations is not possible", found=maximum_evaluations, expected="1 up"
        )
    missing = [name for name in binding.names if name not in recording.names]
    if missing:
        raise DataError(
            f"the recording '{recording.name}' lacks {len(missing)} markers of the layout: "
            f"{', '.join(missing)}",
            found=", ".join(recording.names),
            advice="Choose the layout that the recording was made with, or correct its names.",
        )
    if refine_pose and len(binding.head_names) < 3:
        raise ConfigurationError(
            "refining the pose needs head markers in the layout and the reference pose",
            found=len(binding.head_names),
            expected="three or more",
        )
    problem = _Problem(
        binding, objective, solver, huber_threshold * binding.orientation.scale, refine_pose
    )
    problem.optimiser.set_maxeval(maximum_evaluations)
    face = recording.positions[:, recording.indices(binding.names)]
    targets = binding.orientation.apply(face)
    head = np.full((recording.frames, len(binding.head_names), 3), np.nan)
    for i, name in enumerate(binding.head_names):
        if name in recording.names:
            head[:, i] = binding.orientation.apply(recording.position(name))
    count, frames = len(binding.parameter_names), recording.frames
    values = np.full((frames, count), np.nan)
    deviations = np.full((frames, count), np.nan)
    distances = np.full(targets.shape[:2], np.nan)
    costs, status = np.full(frames, np.nan), np.zeros(frames, dtype=np.int64)
    evaluations = np.zeros(frames, dtype=np.int64)
    corrections = np.zeros((frames, 6))
    for frame in range(frames):
        if problem.set_frame(targets[frame], head[frame]):
            status[frame] = problem.solve()
            evaluations[frame] = problem.evaluations
            values[frame] = problem.parameters
            costs[frame] = problem.best_cost
            corrections[frame] = problem.correction
            distances[frame], deviations[frame] = problem.quality()
        if progress is not None:
            progress(frame + 1)
    fitted = status != NOT_FITTED
    if not fitted.any():
        raise DataError(
            f"no frame of the recording '{recording.name}' can be fitted",
            found="no frame with its head pose and two visible face markers",
            advice="Check the head markers and the gaps with `mocap-fit info`.",
        )
    scale = binding.orientation.scale
    distances /= scale
    noise = _noise(distances, binding.weights, count + 6 * refine_pose)
    with np.errstate(invalid="ignore"):
        residuals = np.sqrt(np.nansum(distances**2, axis=1) / np.isfinite(distances).sum(axis=1))
    tracks = ParameterTracks(
        binding.parameter_names,
        recording.rate,
        values,
        # An undetermined parameter stays infinite even when the noise is nil.
        np.where(np.isinf(deviations), np.inf, deviations * noise * scale),
        np.where(fitted, residuals, np.nan),
        start_time=recording.start_time,
        name=recording.name,
        events=recording.events,
        provenance=recording.provenance,
    ).with_step(
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
        tracks, binding.names, distances, costs, evaluations, status, corrections, noise
    )


def _noise(distances: FloatArray, weights: FloatArray, parameters: int) -> float:
    """Noise of a coordinate from the residuals of all frames, each with its parameters taken."""
    seen = np.isfinite(distances)
    freedom = 3 * seen.sum(axis=1) - parameters
    frames = freedom > 0
    if not frames.any():
        return float("nan")
    squares = np.where(seen, distances, 0.0) ** 2 * (weights / weights.mean())
    return float(np.sqrt(squares[frames].sum() / freedom[frames].sum()))


class _Problem:
    """The minimisation of one frame after another; holds nlopt's optimiser and the warm start.

    The solver's variables are the face parameters, and with a refined pose its six as well, each
    divided by a scale that makes a unit step move the markers alike: solvers that learn the
    curvature as they go then need half the evaluations.
    """

    def __init__(
        self,
        binding: Binding,
        objective: Objective,
        solver: str,
        threshold: float,
        refine_pose: bool,
    ) -> None:
        self._binding = binding
        self._objective = objective
        self._threshold = threshold
        self._evaluator = Evaluator(binding, objective, threshold)
        self._refine = refine_pose
        self._count = len(binding.parameter_names)
        _, jacobian = self._evaluator.markers(binding.reference_parameters)
        everything = parameter_covariance(jacobian, binding.weights)
        self._deviations = np.sqrt(np.diag(everything))
        moved = np.sqrt(np.einsum("m,mip,mip->p", binding.weights, jacobian, jacobian))
        self._scale = 1.0 / np.maximum(moved, 1e-3 * moved.max())
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
        self.optimiser = nlopt.opt(getattr(nlopt, solver), len(self._x))
        self.optimiser.set_min_objective(self._cost)
        self.optimiser.set_xtol_abs(1e-7 / self._scale)
        self.optimiser.set_ftol_rel(1e-11)
        self.optimiser.set_initial_step(0.1 / self._scale)
        self._slope = np.zeros(len(self._x))
        self.evaluations = 0
        self.best_cost = np.inf
        self._best = self._x.copy()

    @property
    def parameters(self) -> FloatArray:
        """Face parameters at the best point."""
        return self._best[: self._count]

    @property
    def correction(self) -> FloatArray:
        """Rotation vector and translation of the pose at the best point; zeros without."""
        return self._best[self._count :] if self._refine else np.zeros(6)

    def set_frame(self, target: FloatArray, head: FloatArray) -> bool:
        """Take a frame's markers; False where there is too little to fit."""
        self._target, self._seen = target, np.isfinite(target[:, 0])
        self._head, self._head_seen = head, np.isfinite(head[:, 0])
        return int(self._seen.sum()) >= 2

    def solve(self) -> int:
        """Minimise from the last answer; returns nlopt's result."""
        self.evaluations, self.best_cost = 0, np.inf
        free = self._free()
        self.optimiser.set_lower_bounds(np.where(free, self._bounds[:, 0], self._x) / self._scale)
        self.optimiser.set_upper_bounds(np.where(free, self._bounds[:, 1], self._x) / self._scale)
        self._best = self._x
        try:
            self.optimiser.optimize(self._x / self._scale)
            result = int(self.optimiser.last_optimize_result())
        except nlopt.RoundoffLimited:
            result = -4
        except _NLOPT_ERRORS:
            # LBFGS and SLSQP also end so when they can go no lower; the best point is kept.
            result = -1
        self._best = self._x = np.clip(self._best, self._bounds[:, 0], self._bounds[:, 1])
        return result

    def quality(self) -> tuple[FloatArray, FloatArray]:
        """Distance of every marker and deviation of every parameter, at the best point.

        Both in the face's millimetres, the deviations per millimetre of noise.
        """
        seen = self._seen
        positions, jacobian = self._moved(self._best)
        shape = jacobian[:, :, : self._count]
        distances = np.full(len(seen), np.nan)
        distances[seen] = np.linalg.norm(positions[seen] - self._target[seen], axis=1)
        covariance = parameter_covariance(
            shape[seen],
            self._binding.weights[seen],
            positions=positions[seen],
            head_positions=self._binding.head_positions[self._head_seen],
            head_weights=self._binding.head_weights[self._head_seen],
        )
        deviations = np.sqrt(np.diag(covariance))
        if not seen.all():
            bare = np.diag(parameter_covariance(shape[seen], self._binding.weights[seen]))
            deviations[np.sqrt(bare) > _UNCERTAIN * self._deviations] = np.inf
        return distances, deviations

    def _free(self) -> NDArray[np.bool_]:
        """Which variables the visible markers determine; the others keep their value."""
        free = np.ones(len(self._x), dtype=bool)
        if not self._seen.all():
            _, jacobian = self._evaluator.markers(self._x[: self._count])
            covariance = parameter_covariance(
                jacobian[self._seen], self._binding.weights[self._seen]
            )
            free[: self._count] = np.isfinite(np.diag(covariance))
        return free

    def _moved(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Virtual markers and their derivative by all variables, the pose's included."""
        positions, jacobian = self._evaluator.markers(x[: self._count])
        if not self._refine:
            return positions, jacobian
        return _turned(positions, jacobian, self._centre, x[self._count :])

    def _cost(self, scaled: FloatArray, gradient: FloatArray) -> float:
        self.evaluations += 1
        x = scaled * self._scale
        if self._refine:
            value = self._cost_with_pose(x)
        else:
            value = self._evaluator.cost(x, self._target, self._seen, self._slope)
        if not (np.isfinite(value) and np.isfinite(self._slope).all()):
            # A NaN can hang nlopt's algorithms; a huge cost only turns them back.
            gradient[:] = 0.0
            return 1e30
        if gradient.size:
            gradient[:] = self._slope * self._scale
        if value < self.best_cost:
            self.best_cost, self._best = value, x
        return value

    def _cost_with_pose(self, x: FloatArray) -> float:
        """Cost over face and head markers; its gradient goes to the slope."""
        seen, head_seen = self._seen, self._head_seen
        positions, jacobian = self._moved(x)
        value, pull = cost(
            positions[seen] - self._target[seen],
            self._binding.weights[seen],
            self._objective,
            self._threshold,
        )
        self._slope[:] = np.tensordot(pull, jacobian[seen], 2)
        still = self._binding.head_positions[head_seen]
        rigid = np.zeros((*still.shape, self._count))
        head, head_jacobian = _turned(still, rigid, self._centre, x[self._count :])
        head_value, head_pull = cost(
            head - self._head[head_seen],
            self._binding.head_weights[head_seen],
            self._objective,
            self._threshold,
        )
        self._slope += np.tensordot(head_pull, head_jacobian, 2)
        return value + head_value


def _turned(
    positions: FloatArray, jacobian: FloatArray, centre: FloatArray, pose: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Points moved by a pose, and their derivative by the parameters and the pose.

    The pose is a rotation vector about the centre (radians) and a translation (millimetres).
    """
    rotation = Rotation.from_rotvec(pose[:3]).as_matrix()
    arms = (positions - centre) @ rotation.T
    by_shape = np.einsum("ij,mjp->mip", rotation, jacobian)
    effect = rigid_motion_effect(arms + centre, centre)
    # The derivative by the rotation vector itself goes through the group's left Jacobian.
    effect[:, :, :3] = effect[:, :, :3] @ left_jacobian(pose[:3])
    return arms + centre + pose[3:], np.concatenate([by_shape, effect], axis=2)
