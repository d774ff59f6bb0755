"""The shape fit: face parameters frame by frame (Beskow eq. 3)."""

from __future__ import annotations

import html
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

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
    MISFIT_FACTOR,
    compute_covariance,
    compute_deviations,
    compute_pose_noise,
    estimate_misfit,
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

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Frames that are solved together, whose Jacobians are in memory at one time.
_CHUNK = 512
# Where hidden markers make a parameter this many times less certain, it counts as undetermined.
_UNCERTAIN = 10.0


@dataclass(frozen=True, eq=False, repr=False)
class ShapeFit:
    """The result of a shape fit.

    Parameters
    ----------
    parameters
        Parameter tracks, with standard deviations, and residuals in millimetres of the speaker.
    marker_names
        Names of the face markers.
    marker_residuals
        Distance of each visible marker from its virtual marker, ``(frames, markers)``,
        millimetres of the speaker; NaN where hidden.
    costs
        Cost at the result, ``(frames,)``, in the face's millimetres (squared for ``squares`` and
        ``huber``).
    evaluations
        Number of evaluations of the cost, ``(frames,)``, no unit.
    status
        Reason for which the solver stopped, ``(frames,)``, no unit: a key of
        `mocap_fit.fitting.solving.STATUS`.
    pose_corrections
        Corrections of the head's pose by ``refine_pose``, ``(frames, 6)``: rotation vector
        (radians) about the centroid of the head markers, and translation (millimetres of the
        face); otherwise zeros.
    noise
        Standard deviation of a marker's coordinate, of noise and misfit, estimated from the
        residuals, millimetres of the speaker.
    misfit
        Standard deviation of what remains in the residuals of a coordinate from frame to frame,
        because the face is not the speaker's, millimetres of the speaker.
    """

    parameters: ParameterTracks
    marker_names: tuple[str, ...]
    marker_residuals: FloatArray
    costs: FloatArray
    evaluations: NDArray[np.int64]
    status: NDArray[np.int64]
    pose_corrections: FloatArray
    noise: float
    misfit: float = 0.0

    @property
    def fitted(self) -> NDArray[np.bool_]:
        """Fitted frames, ``(frames,)``."""
        return np.asarray(self.status != NOT_FITTED)

    def __repr__(self) -> str:
        fitted = self.fitted
        residuals = self.parameters.residuals[fitted]
        middle = float(np.nanmedian(residuals)) if fitted.any() else float("nan")
        return (
            f"ShapeFit of '{self.parameters.name}': {int(fitted.sum())} of {len(fitted)} frames "
            f"fitted, median residual {middle:.3f} mm,\n"
            f"  {float(self.evaluations[fitted].mean()) if fitted.any() else 0:.0f} evaluations a "
            f"frame, {int(self.parameters.uncertain.any(axis=1).sum())} frames with an uncertain "
            "parameter"
        )

    def _repr_html_(self) -> str:
        parameters = self.parameters
        with warnings.catch_warnings():
            # A parameter that no frame determines has no median.
            warnings.simplefilter("ignore", RuntimeWarning)
            deviations = np.where(parameters.uncertain, np.nan, parameters.standard_deviations)
            columns = [
                np.nanmin(parameters.values, axis=0),
                np.nanmedian(parameters.values, axis=0),
                np.nanmax(parameters.values, axis=0),
                np.nanmedian(deviations, axis=0),
            ]
        rows = "".join(
            f"<tr><td>{html.escape(name)}</td>{''.join(f'<td>{v:.3f}</td>' for v in values)}</tr>"
            for name, *values in zip(parameters.names, *columns, strict=True)
        )
        return (
            f"<pre>{html.escape(repr(self))}</pre><table><thead><tr><th>parameter</th>"
            "<th>least</th><th>median</th><th>largest</th><th>standard deviation</th></tr></thead>"
            f"<tbody>{rows}</tbody></table>"
        )

    def plot(self) -> Figure:
        """Plot the parameters and the residuals over time.

        Returns
        -------
        matplotlib.figure.Figure
            Parameters above, with bands of 95 per cent, and below the root mean square residual
            of the markers in millimetres.
        """
        from mocap_fit.drawing import CYCLE, GREY, create_figure

        figure, panels = create_figure((9.0, 6.0), 2, 1, sharex=True, height_ratios=(3, 1))
        upper, lower = panels[:, 0]
        tracks = self.parameters
        for i, name in enumerate(tracks.names):
            colour = CYCLE[i % len(CYCLE)]
            values, deviations = tracks.values[:, i], tracks.standard_deviations[:, i]
            band = np.where(np.isfinite(deviations), 1.96 * deviations, np.nan)
            upper.plot(tracks.times, values, color=colour, label=name.replace("_", " "))
            upper.fill_between(
                tracks.times, values - band, values + band, color=colour, alpha=0.2, lw=0
            )
        upper.set_ylabel("parameter (1 is the full gesture)")
        upper.legend(ncols=2, fontsize=7)
        lower.plot(tracks.times, tracks.residuals, color=GREY)
        lower.set_ylabel("residual (mm)")
        lower.set_xlabel("time (s)")
        return figure


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
    """Fit the parameters of the face to the markers, frame by frame.

    Parameters
    ----------
    binding
        Virtual markers, from `bind_markers`.
    recording
        Recording in head coordinates, from `remove_head_motion`.
    objective
        Cost over the visible markers: the weighted sum of ``"distances"`` (Beskow eq. 3), of
        ``"squares"``, or ``"huber"``.
    solver
        ``"newton-nlopt"``: Newton's method predicts, and nlopt certifies from there.
        ``"newton"``: Newton's method alone. Or one of nlopt's algorithms alone, such as
        ``"LN_PRAXIS"``, Powell's method, as in the paper.
    huber_threshold
        Distance at which Huber's objective turns from squares to distances, millimetres of the
        speaker.
    refine_pose
        Whether a small correction of the head's pose is fitted together with the shape, from all
        markers: few reference markers make a noisy pose.
    maximum_evaluations
        Largest number of nlopt's evaluations of a frame.
    progress
        Called with the number of frames done so far.

    Returns
    -------
    ShapeFit
        Parameters, residuals, and the solver's status in every frame.

    Raises
    ------
    DataError
        If the recording lacks a marker of the layout, or no frame can be fitted.
    ConfigurationError
        If the objective or the solver is unknown, or a setting is out of range.

    See Also
    --------
    bind_markers : Ties the markers to the face.
    remove_head_motion : Brings a recording to head coordinates.
    fit_speaker : Does all steps for the recordings of a speaker.

    Notes
    -----
    Each frame starts from the result of the frame before. Hidden markers are left out. A parameter
    that the visible markers do not determine keeps its value from the frame before, and its
    standard deviation is infinite, as it is where hidden markers make it ten times less certain.

    Examples
    --------
    >>> import mocap_fit as mf
    >>> face, layout = mf.load_face(), mf.load_layout("face30-head5")
    >>> reference = mf.read_tracks(mf.load_sample("rest"))
    >>> orientation = mf.fit_orientation(face, layout, reference)
    >>> binding = mf.bind_markers(face, layout, reference, orientation)
    >>> take = mf.read_tracks(mf.load_sample("take_01"))
    >>> head = [marker.name for marker in layout.head_markers]
    >>> still, motion = mf.remove_head_motion(take, reference, head)
    >>> fit = mf.fit_shape(binding, still)
    >>> fit.parameters.values.shape[1]
    10
    """
    check_objective(objective, huber_threshold)
    _check_solver(binding, solver, refine_pose, maximum_evaluations)
    check_recording(binding, recording)
    scale = binding.orientation.scale
    frame_solver = _choose_solver(
        binding, objective, huber_threshold * scale, solver, refine_pose, maximum_evaluations
    )
    freedom = len(binding.parameter_names) + 6 * refine_pose
    parts, distances = [], np.full((recording.frames, len(binding.names)), np.nan)
    products = np.full(distances.shape, np.nan)
    deviations = np.full((recording.frames, len(binding.parameter_names)), np.nan)
    for start in range(0, recording.frames, _CHUNK):
        chunk = slice(start, start + _CHUNK)
        solution, distances[chunk], products[chunk], deviations[chunk] = _fit_chunk(
            binding, recording, chunk, frame_solver
        )
        parts.append(solution)
        if progress is not None:
            progress(min(start + _CHUNK, recording.frames))
    solution = Solution.concatenate(parts)
    fitted = solution.status != NOT_FITTED
    if not fitted.any():
        raise DataError(
            f"no frame of the recording '{recording.name}' can be fitted",
            found="no frame with its head pose and two visible face markers",
            advice="Check the head markers and the gaps with `mocap-fit info`.",
        )
    distances /= scale
    noise = estimate_noise(distances, binding.weights, freedom)
    misfit = min(estimate_misfit(products / scale**2, binding.weights, freedom), noise)
    excess = 0.0 if refine_pose else measure_pose_noise(binding, recording)[0]
    quick = (noise**2 - misfit**2) / (1.0 + excess)
    noise = float(np.sqrt(quick + (MISFIT_FACTOR * misfit) ** 2))
    tracks = ParameterTracks(
        binding.parameter_names,
        recording.rate,
        solution.values,
        # An undetermined parameter stays infinite even when the noise is 0.
        np.where(np.isinf(deviations), np.inf, deviations * noise * scale),
        compute_root_mean_square(distances),
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
    return ShapeFit(tracks, binding.names, distances, *solution[1:], noise, misfit)


def measure_pose_noise(binding: Binding, recording: MarkerTracks) -> tuple[float, FloatArray]:
    """Measure what the noise of the head's pose adds to a recording's residuals, at rest.

    Parameters
    ----------
    binding
        Virtual markers, from `bind_markers`.
    recording
        Recording in head coordinates.

    Returns
    -------
    excess : float
        Part of the residuals' variance without it, 0 or more.
    covariance : ndarray
        What it adds to the gradient (`compute_pose_noise`), ``(parameters, parameters)``, square
        millimetres per unit variance of a marker's coordinate.
    """
    names = [name for name in binding.head_names if name in recording.names]
    posed = (recording.visible[:, recording.indices(names)].sum(axis=1) >= 3).mean()
    positions, jacobian = binding.evaluate(binding.reference_parameters)
    head = binding.head_positions, binding.head_weights
    excess, covariance = compute_pose_noise(jacobian, binding.weights, positions, *head)
    return float(posed) * excess, posed * covariance


def compute_root_mean_square(distances: FloatArray) -> FloatArray:
    """Compute the root mean square of the distances of each frame.

    Parameters
    ----------
    distances
        Distances, ``(frames, markers)``, millimetres; NaN for a hidden marker.

    Returns
    -------
    ndarray
        ``(frames,)``, millimetres; NaN where all are hidden.
    """
    with np.errstate(invalid="ignore"):
        squares = np.nansum(distances**2, axis=1)
        return np.asarray(np.sqrt(squares / np.isfinite(distances).sum(axis=1)))


def _check_solver(
    binding: Binding, solver: str, refine_pose: bool, maximum_evaluations: int
) -> None:
    """Check the solver's settings."""
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

    problem = (binding, objective, threshold)
    if binding.compiled is not None and not refine_pose:
        try:
            from mocap_fit.fitting.compiled_solver import CompiledSolver
            from mocap_fit.fitting.native import load_library
        except ImportError:
            pass  # Without numba, the plain form gives the same results.
        else:
            if load_library() is not None or solver == "newton":
                return CompiledSolver(
                    *problem, solver=solver, maximum_evaluations=maximum_evaluations
                )
    algorithm = solver if solver in ALGORITHMS else PLAIN
    if solver not in (NEWTON_NLOPT, algorithm):
        warnings.warn(
            f"the solver '{solver}' is not available for this rig or machine, or with a refined "
            f"pose; nlopt's {algorithm} is used",
            MocapFitWarning,
            stacklevel=3,
        )
    return NloptSolver(
        *problem,
        algorithm=algorithm,
        refine_pose=refine_pose,
        maximum_evaluations=maximum_evaluations,
    )


def _fit_chunk(
    binding: Binding, recording: MarkerTracks, frames: slice, solver: Solver
) -> tuple[Solution, FloatArray, FloatArray, FloatArray]:
    """Fit some frames; return the solution, marker distances, products, and parameter deviations.

    Distances are in the face's millimetres, products of residuals of a frame and the next in
    square millimetres, deviations per millimetre of noise.
    """
    positions = recording.positions[frames]
    targets = binding.orientation.apply(positions[:, recording.indices(binding.names)])
    head = np.full((len(positions), len(binding.head_names), 3), np.nan)
    for i, name in enumerate(binding.head_names):
        if name in recording.names:
            head[:, i] = binding.orientation.apply(positions[:, recording.index(name)])
    seen = np.isfinite(targets[:, :, 0])
    usable = seen.sum(axis=1) >= 2
    solution = solver.solve(targets, head, usable)
    residuals = np.full(targets.shape, np.nan)
    deviations = np.full(solution.values.shape, np.nan)
    if usable.any():
        residuals[usable], deviations[usable] = _measure_quality(
            binding, solution, targets, head, usable
        )
    products = np.full(seen.shape, np.nan)
    products[:-1] = np.einsum("tmi,tmi->tm", residuals[:-1], residuals[1:])
    return solution, np.linalg.norm(residuals, axis=2), products, deviations


def _measure_quality(
    binding: Binding,
    solution: Solution,
    targets: FloatArray,
    head: FloatArray,
    usable: NDArray[np.bool_],
) -> tuple[FloatArray, FloatArray]:
    """Compute marker residuals and parameter deviations of the usable frames."""
    evaluator = Evaluator(binding, "squares", 1.0)
    positions, jacobian = evaluator.evaluate_frames(solution.values[usable])
    corrections = solution.corrections[usable]
    for i in np.flatnonzero(corrections.any(axis=1)):
        centre = binding.head_positions.mean(axis=0)
        positions[i], _ = move_by_pose(positions[i], jacobian[i], centre, corrections[i])
    seen = np.isfinite(targets[usable, :, 0])
    weights = np.where(seen, binding.weights, 0.0)
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
    return positions - targets[usable], deviations
