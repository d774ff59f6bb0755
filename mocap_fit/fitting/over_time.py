"""The shape fit over time: all frames of a recording together, with a prior for smooth tracks.

Off by default: Beskow's fit is frame by frame (eq. 3). The total cost is

``sum over frames of the cost + sum over parameters of ∫ weight(t) · x''(t)² dt``

within the bounds of the rig. The first sum is the cost of the frame-by-frame fit, which grows with
the frame rate; the second does not depend on it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from mocap_fit.errors import ConfigurationError, DataError
from mocap_fit.fitting.binding import Binding, check_recording
from mocap_fit.fitting.frame_costs import CostScale, FrameCosts, LocalCosts, compute_cost_scale
from mocap_fit.fitting.objective import Evaluator, Objective, check_objective
from mocap_fit.fitting.precision import MISFIT_FACTOR, estimate_noise
from mocap_fit.fitting.shape import ShapeFit, compute_root_mean_square, measure_pose_noise
from mocap_fit.fitting.smoothness import (
    BoolArray,
    build_roughness_bands,
    compute_curvature,
    compute_inverse_blocks,
    estimate_local_smoothing,
    estimate_smoothing,
    minimise_in_box,
    multiply,
)
from mocap_fit.fitting.solving import BRIDGED
from mocap_fit.tracks import FloatArray, MarkerTracks
from mocap_fit.tracks.interpolation import find_runs

# Least noise of the markers, millimetres: it is divided by.
_LEAST_NOISE = 1e-6
# The solver stops where all steps of the parameters are below the first, or the expected decrease
# of the total cost is less than the second part of it.
_SMALL_STEP, _SMALL_DECREASE = 1e-5, 1e-9
# A frame whose parameters would change by less than this is not evaluated again.
_STILL = 1e-8
# Median of chi-squared with three degrees of freedom.
_MEDIAN_CHI_SQUARE = 2.366
# Part of the mean information that is added to the diagonal, so that the matrix is regular.
_RIDGE = 1e-10
# Step of a numerical derivative, no unit.
_STEP = 1e-5


def fit_over_time(
    binding: Binding,
    recording: MarkerTracks,
    fit: ShapeFit,
    *,
    objective: Objective = "distances",
    huber_threshold: float = 1.0,
    weight: float | Sequence[float] | None = None,
    maximum_gap: float = 0.2,
    maximum_rounds: int = 50,
    progress: Callable[[int], object] | None = None,
) -> ShapeFit:
    """Fit the face to all frames of a recording together, with smooth parameters.

    Parameters
    ----------
    binding
        Virtual markers, from `bind_markers`.
    recording
        Recording in head coordinates, from `remove_head_motion`.
    fit
        Frame-by-frame fit of the same recording, from `fit_shape`: the start, and what the
        weights are estimated from. Its pose corrections are used again.
    objective
        Cost over the visible markers: ``"distances"``, ``"squares"`` or ``"huber"``.
    huber_threshold
        Distance at which Huber's objective turns from squares to distances, millimetres of the
        speaker.
    weight
        Weight of smoothness, above 0. A number: ``weight · m² ∫ x''² dt`` is added to the cost
        for each parameter x, where m is the root mean square motion of the face markers per unit
        of the parameter in the reference pose, millimetres. A number for each parameter:
        ``weight ∫ x''² dt``. By default it is estimated from the data; see the notes.
    maximum_gap
        Longest run of frames with too few markers that is bridged, seconds; a longer gap stays
        open, and the frames on either side of it are fitted separately.
    maximum_rounds
        Largest number of evaluations of all frames.
    progress
        Called with the number of frames done so far.

    Returns
    -------
    ShapeFit
        Bridged frames have the status `BRIDGED`. Standard deviations are those of the smooth
        tracks with the misfit of the face (`ShapeFit.misfit`) and the noise of the reference pose,
        larger in gaps; infinite where the markers do not determine a parameter for longer than the
        largest gap, or up to the beginning or the end of a segment.

    Raises
    ------
    DataError
        If the fit is not one of this recording, with this face.
    ConfigurationError
        If a setting is out of range.

    Notes
    -----
    For Gaussian noise, the total cost is the negative logarithm of the posterior of a prior under
    which each parameter's second derivative is white noise of strength q, and
    ``weight = kappa k / (2 q)``: the cost divided by kappa is a negative log likelihood (kappa is
    twice the noise variance for ``squares``), and k is the ratio of the parameter's noise variance
    to the variance that the markers' noise explains, above 1 where the head's pose is noisy.

    By default all of these come from the data. The markers' noise is estimated from the changes of
    the residuals from frame to frame; k and q of each parameter maximise the restricted marginal
    likelihood of its frame-by-frame track, with k no less than the noise of markers and head pose
    explains (Wahba, Annals of Statistics 13, 1985; `estimate_smoothing`). Likelihood rather than
    cross-validation: cross-validation cannot use a known noise, and sometimes undersmooths.

    One strength for all frames would flatten quick movements: a lip closure is over in 80 ms. The
    strength therefore varies over time, estimated from the frames around each moment
    (`estimate_local_smoothing`): such a prior has heavy tails and tolerates a few quick gestures.
    It smooths slow passages more and quick ones less. A weight of the caller is constant.

    In every round the cost of each frame is made quadratic, the banded normal equations of all
    frames are solved within the bounds, and a frame whose cost has more curvature than its
    quadratic form is damped. The total cost never rises.

    Time and memory are proportional to the number of frames.
    """
    _check(binding, recording, fit, objective, huber_threshold, maximum_gap, maximum_rounds)
    rate, scale, bounds = recording.rate, binding.orientation.scale, binding.rig.bounds
    threshold = huber_threshold * scale
    targets = _transform_markers(binding, recording, fit)
    shown = np.where(np.isfinite(targets[:, :, 0]), binding.weights, 0.0)
    evaluator = Evaluator(binding, objective, threshold)
    longest = maximum_gap * rate + 1e-6
    slices = _split_at_gaps(fit.fitted, longest)
    segments = [FrameCosts(evaluator, targets[s], shown[s], objective, threshold) for s in slices]
    starts = [np.clip(_fill_gaps(fit.parameters.values[s]), *bounds.T) for s in slices]
    local_costs = [data.at(start) for data, start in zip(segments, starts, strict=True)]
    excess, pose = measure_pose_noise(binding, recording)
    # The pose's noise is in the residuals too, unless they have refined it.
    noise = _estimate_noise(local_costs, segments)
    noise /= 1.0 if fit.pose_corrections.any() else np.sqrt(1.0 + excess)
    if not np.isfinite(noise):
        noise = fit.noise * scale if np.isfinite(fit.noise) else 1.0
    cost_scale = compute_cost_scale(objective, threshold, max(noise, _LEAST_NOISE))
    bare = [_compute_bare_deviations(local.information) for local in local_costs]
    units = [
        _compute_unit_deviations(fit, part, b, scale) for part, b in zip(slices, bare, strict=True)
    ]
    noisiness, more = _compute_noise_ratio(units, bare), np.ones(len(bounds))
    if weight is None:
        alone = [fit.parameters.values[part] for part in slices]
        smoothing, more = _learn_smoothing(alone, units, cost_scale, rate)
        noisiness = noisiness * more
        noises = [u * np.sqrt(cost_scale.variance * more) for u in units]
        local = estimate_local_smoothing(alone, noises, smoothing / more, rate)
        strengths = [0.5 * cost_scale.kappa * noisiness * s for s in local]
    else:
        strengths_of_all = _check_weight(weight, binding, evaluator)
        strengths = [np.tile(strengths_of_all, (max(len(start) - 2, 0), 1)) for start in starts]
    weights = _summarise_strengths(strengths)
    # Smoothness takes noise away, but neither what a face of another shape does to slow gestures
    # nor the noise of the reference pose.
    lasting = np.hypot(MISFIT_FACTOR * fit.misfit * scale, binding.reference_noise)

    values = np.full(fit.parameters.values.shape, np.nan)
    deviations = np.full(values.shape, np.nan)
    distances = np.full(shown.shape, np.nan)
    costs, evaluations = np.full(len(values), np.nan), fit.evaluations.copy()
    status, taken = fit.status.copy(), np.zeros(len(values))
    for i, (part, data) in enumerate(zip(slices, segments, strict=True)):
        solution, here, rounds = _solve(
            data, starts[i], local_costs[i], strengths[i], rate, bounds, maximum_rounds
        )
        share = data.weights.sum(axis=1) / binding.weights.sum()
        variance, taken[part] = _compute_variances(
            here.information,
            pose * share[:, None, None] ** 2,
            strengths[i],
            (noisiness, more),
            cost_scale,
            rate,
        )
        values[part], costs[part] = solution, here.costs
        evaluations[part] += rounds
        undetermined = np.isinf(fit.parameters.standard_deviations[part]) | ~fit.fitted[part, None]
        variance += (lasting * _fill_gaps(units[i])) ** 2
        deviations[part] = np.where(
            _find_long_gaps(undetermined, longest), np.inf, np.sqrt(variance)
        )
        distance = np.linalg.norm(here.residuals, axis=2) / scale
        distances[part] = np.where(data.weights > 0, distance, np.nan)
        status[part] = np.where(fit.fitted[part], fit.status[part], BRIDGED)
        if progress is not None:
            progress(part.stop)
    tracks = fit.parameters.replace(
        values=values,
        standard_deviations=deviations,
        residuals=compute_root_mean_square(distances),
    ).add_step(
        "fit_over_time",
        {
            "objective": objective,
            "median_weights": dict(zip(binding.parameter_names, weights.tolist(), strict=True)),
            "weights_from": "the data" if weight is None else "the user",
            "maximum_gap": maximum_gap,
            "maximum_rounds": maximum_rounds,
            **({"huber_threshold": huber_threshold} if objective == "huber" else {}),
        },
    )
    return replace(
        fit,
        parameters=tracks,
        marker_residuals=distances,
        costs=costs,
        evaluations=evaluations,
        status=status,
        noise=estimate_noise(distances, binding.weights, taken),
    )


def _solve(
    data: FrameCosts,
    values: FloatArray,
    local: LocalCosts,
    strengths: FloatArray,
    rate: float,
    bounds: FloatArray,
    maximum_rounds: int,
) -> tuple[FloatArray, LocalCosts, int]:
    """Minimise the total cost of a segment; return values, costs there, and evaluations."""
    bands = build_roughness_bands(len(values), rate, 2.0 * strengths)
    rounds = 1
    total = _compute_total(local, values, strengths, rate)
    damping = np.zeros(len(values))
    ridge = _compute_ridge(local.information)
    while rounds < maximum_rounds:
        diagonal = np.einsum("tpp->tp", local.curvatures)
        blocks = local.curvatures.copy()
        np.einsum("tpp->tp", blocks)[:] += damping[:, None] * diagonal + ridge
        zeros = np.zeros_like(blocks)
        gradient = local.gradients + multiply(zeros, bands, values)
        step = minimise_in_box(
            blocks, bands, gradient, bounds[:, 0] - values, bounds[:, 1] - values
        )
        quadratic = 0.5 * np.einsum("ti,tij,tj->t", step, blocks, step)
        decrease = -float(
            np.sum(gradient * step) + 0.5 * np.sum(step * multiply(blocks, bands, step))
        )
        if np.abs(step).max() < _SMALL_STEP or decrease <= _SMALL_DECREASE * total:
            break
        moved = np.abs(step).max(axis=1) > _STILL
        step[~moved] = 0.0
        stepped = np.clip(values + step, bounds[:, 0], bounds[:, 1])
        trial = data.update(stepped, local, moved)
        rounds += 1
        new_total = _compute_total(trial, stepped, strengths, rate)
        rise = trial.costs - local.costs - np.einsum("tp,tp->t", local.gradients, step)
        curved = rise > 1.5 * quadratic + 1e-12 * local.costs
        if new_total < total:
            values, local, total = stepped, trial, new_total
            damping = np.where(curved, np.maximum(2 * damping, 0.1), damping / 4)
            damping[damping < 0.01] = 0.0
        else:
            raised = np.maximum(4 * damping, 1.0)
            damping = np.where(curved, raised, damping) if curved.any() else raised
    return values, local, rounds


def _compute_total(
    local: LocalCosts, values: FloatArray, strengths: FloatArray, rate: float
) -> float:
    """Return the cost of all frames and their roughness."""
    return float(local.costs.sum() + np.sum(strengths * compute_curvature(values, rate) ** 2))


def _estimate_noise(local_costs: Sequence[LocalCosts], segments: Sequence[FrameCosts]) -> float:
    """Estimate the noise of a coordinate from the residuals' changes, millimetres of the face.

    Residuals that change slowly, because the face differs from the speaker's, are no noise: second
    differences remove them. The median is robust to jumps.
    """
    squares, shares = [], []
    for local, data in zip(local_costs, segments, strict=True):
        seen = data.weights > 0
        if len(seen) > 2:
            thrice = seen[:-2] & seen[1:-1] & seen[2:]
            second = np.diff(local.residuals, n=2, axis=0)
            # The parameters absorb a part of the noise.
            rest = 1.0 - local.gradients.shape[1] / np.maximum(3.0 * seen.sum(axis=1), 1.0)
            squares.append(np.einsum("tmi,tmi->tm", second, second)[thrice])
            shares.append(np.broadcast_to(rest[1:-1, None], thrice.shape)[thrice])
    if not squares or not sum(map(len, squares)):
        return float("nan")
    share = np.concatenate(shares)
    usable = share > 0.1
    if not usable.any():
        return float("nan")
    middle = np.median(np.concatenate(squares)[usable] / share[usable])
    return float(np.sqrt(middle / (6.0 * _MEDIAN_CHI_SQUARE)))


def _compute_unit_deviations(
    fit: ShapeFit, part: slice, bare: FloatArray, scale: float
) -> FloatArray:
    """Compute the frame-by-frame deviations per unit of noise; infinite where unknown.

    They include the noise of the head's pose; the bare deviations do not.
    """
    deviations = fit.parameters.standard_deviations[part]
    unit = (
        deviations / (fit.noise * scale)
        if fit.noise > 0
        else np.where(np.isinf(deviations), deviations, bare)
    )
    return np.asarray(np.where(fit.fitted[part, None] & np.isfinite(unit), unit, np.inf))


def _compute_noise_ratio(units: Sequence[FloatArray], bare: Sequence[FloatArray]) -> FloatArray:
    """Compute the median ratio of the parameters' variance to the bare one, ``(parameters,)``."""
    squares = np.concatenate([(u / b) ** 2 for u, b in zip(units, bare, strict=True)])
    known = np.isfinite(squares)
    return np.array([np.median(squares[k, p]) if k.any() else 1.0 for p, k in enumerate(known.T)])


def _learn_smoothing(
    tracks: Sequence[FloatArray], units: Sequence[FloatArray], cost_scale: CostScale, rate: float
) -> tuple[FloatArray, FloatArray]:
    """Estimate smoothing and noise of every parameter with `estimate_smoothing`."""
    pairs = []
    for p in range(tracks[0].shape[1]):
        known = [np.isfinite(u[:, p]) for u in units]
        track = [np.where(k, t[:, p], np.nan) for t, k in zip(tracks, known, strict=True)]
        deviation = [
            np.where(k, u[:, p], 1.0) * np.sqrt(cost_scale.variance)
            for u, k in zip(units, known, strict=True)
        ]
        pairs.append(estimate_smoothing(track, deviation, rate))
    smoothing, noisiness = np.array(pairs).T
    return smoothing, noisiness


def _compute_bare_deviations(information: FloatArray) -> FloatArray:
    """Compute ``sqrt diag (JᵀJ)⁻¹`` of every frame, ``(frames, parameters)``."""
    blocks = information.copy()
    np.einsum("tpp->tp", blocks)[:] += _compute_ridge(information)
    return np.asarray(np.sqrt(np.einsum("tpp->tp", np.linalg.inv(blocks))))


def _compute_ridge(information: FloatArray) -> FloatArray:
    """Compute what is added to the diagonal of the information, ``(parameters,)``."""
    mean = np.einsum("tpp->p", information) / len(information)
    return np.asarray(_RIDGE * np.maximum(mean, 1e-3 * mean.max() + 1e-300))


def _check_weight(
    weight: float | Sequence[float], binding: Binding, evaluator: Evaluator
) -> FloatArray:
    """Convert the caller's weight to the weight of every parameter."""
    count = len(binding.parameter_names)
    strengths = np.asarray(weight, dtype=np.float64)
    if (
        strengths.shape not in ((), (count,))
        or not (np.isfinite(strengths) & (strengths > 0)).all()
    ):
        raise ConfigurationError(
            "the weight of smoothness is out of range",
            found=weight,
            expected=f"a number above 0, or {count} of them",
        )
    if strengths.shape == (count,):
        return strengths
    _, jacobian = evaluator.evaluate(binding.reference_parameters)
    moved = np.einsum("m,mip,mip->p", binding.weights, jacobian, jacobian) / binding.weights.sum()
    return np.asarray(strengths * np.maximum(moved, 1e-6 * moved.max()))


def _compute_variances(
    information: FloatArray,
    pose: FloatArray,
    strengths: FloatArray,
    noisiness: tuple[FloatArray, FloatArray],
    cost_scale: CostScale,
    rate: float,
) -> tuple[FloatArray, FloatArray]:
    """Compute the variances of every frame, and the degrees of freedom that it took.

    The cost has the matrix ``H = G + Q``: the information that markers of independent noise have,
    and the roughness. But the head's pose moves all of them alike, which adds P to the variance G
    of the gradient; and with ``noisiness`` k the precision of the prior is ``Q / k``. So the
    covariance is ``H⁻¹ (G + P + k Q) H⁻¹``; the second of ``noisiness`` is a factor of the noise.
    """
    ratio, more = noisiness
    blocks = information / cost_scale.variance
    np.einsum("tpp->tp", blocks)[:] += _compute_ridge(blocks)
    bands = build_roughness_bands(len(blocks), rate, 2.0 * strengths / cost_scale.kappa)
    gradients = np.sqrt(np.outer(more, more)) * (blocks + pose / cost_scale.variance)
    inverse = compute_inverse_blocks(blocks, bands)
    # H⁻¹ N H⁻¹ is the derivative of an inverse: of (H - t N)⁻¹ at 0.
    near = compute_inverse_blocks(blocks + _STEP * gradients, bands * (1.0 + _STEP * ratio))
    variances = np.einsum("tpp->tp", inverse - near) / _STEP
    return variances, np.einsum("tij,tji->t", inverse, blocks)


def _summarise_strengths(strengths: Sequence[FloatArray]) -> FloatArray:
    """Return the median weight of every parameter, ``(parameters,)``."""
    every = np.concatenate(strengths)
    return np.median(every, axis=0) if len(every) else np.zeros(every.shape[1])


def _transform_markers(binding: Binding, recording: MarkerTracks, fit: ShapeFit) -> FloatArray:
    """Transform the face markers to the face, and undo the fit's pose corrections."""
    face = recording.positions[:, recording.indices(binding.names)]
    targets = binding.orientation.apply(face)
    turned = np.flatnonzero(fit.pose_corrections.any(axis=1))
    if len(turned):
        centre = binding.head_positions.mean(axis=0)
        turns = Rotation.from_rotvec(fit.pose_corrections[turned, :3]).as_matrix()
        shifted = targets[turned] - fit.pose_corrections[turned, None, 3:] - centre
        targets[turned] = np.einsum("tji,tmj->tmi", turns, shifted) + centre
    return targets


def _split_at_gaps(fitted: BoolArray, longest: float) -> list[slice]:
    """List the segments that are fitted together: fitted frames without long gaps between."""
    frames = np.flatnonzero(fitted)
    cuts = np.flatnonzero(np.diff(frames) > longest + 1)
    firsts = frames[np.concatenate([[0], cuts + 1])]
    lasts = frames[np.concatenate([cuts, [len(frames) - 1]])]
    return [slice(int(a), int(b) + 1) for a, b in zip(firsts, lasts, strict=True)]


def _fill_gaps(values: FloatArray) -> FloatArray:
    """Fill what is not finite by straight lines; by zeros where a column has nothing."""
    filled, frames = np.zeros(values.shape), np.arange(len(values))
    for p, column in enumerate(values.T):
        there = np.flatnonzero(np.isfinite(column))
        if len(there):
            filled[:, p] = np.interp(frames, there, column[there])
    return filled


def _find_long_gaps(undetermined: BoolArray, longest: float) -> BoolArray:
    """Return which undetermined values are so for too long, or up to an end of the segment."""
    too_long = np.zeros_like(undetermined)
    for p, column in enumerate(undetermined.T):
        for run in find_runs(column):
            if run.stop - run.start > longest or run.start == 0 or run.stop == len(column):
                too_long[run, p] = True
    return too_long


def _check(
    binding: Binding,
    recording: MarkerTracks,
    fit: ShapeFit,
    objective: Objective,
    huber_threshold: float,
    maximum_gap: float,
    maximum_rounds: int,
) -> None:
    """Check the settings, and that the fit is one of the recording."""
    check_objective(objective, huber_threshold)
    if not (np.isfinite(maximum_gap) and maximum_gap >= 0):
        raise ConfigurationError(
            "the longest gap to bridge is out of range",
            found=maximum_gap,
            expected="seconds, 0 or more",
        )
    if maximum_rounds < 1:
        raise ConfigurationError(
            "the number of rounds is out of range", found=maximum_rounds, expected="1 or more"
        )
    if fit.parameters.names != binding.parameter_names or fit.marker_names != binding.names:
        raise DataError(
            "the frame-by-frame fit is of another face or layout",
            found=f"{len(fit.parameters.names)} parameters, {len(fit.marker_names)} markers",
            expected=f"those of the binding, {len(binding.parameter_names)} and "
            f"{len(binding.names)}",
        )
    check_recording(binding, recording)
    if (fit.parameters.frames, fit.parameters.rate) != (recording.frames, recording.rate):
        raise DataError(
            f"the frame-by-frame fit is not of the recording '{recording.name}'",
            found=f"{fit.parameters.frames} frames at {fit.parameters.rate:g} Hz",
            expected=f"{recording.frames} frames at {recording.rate:g} Hz",
        )
    if not fit.fitted.any():
        raise DataError(f"no frame of the recording '{recording.name}' was fitted")
