"""The shape fit over time: all frames of a recording together, with a prior for smooth tracks.

Off by default: Beskow's fit is frame by frame (eq. 3). What is minimised here is

``sum over frames of the cost + sum over parameters of ∫ weight(t) · x''(t)² dt``

within the bounds of the rig. The first part is the cost of the frame-by-frame fit, so that more
frames a second weigh more; the second is the same at any frame rate.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from mocap_fit.errors import ConfigurationError, DataError
from mocap_fit.fitting.binding import Binding, check_recording
from mocap_fit.fitting.frame_costs import CostScale, FrameCosts, LocalCosts, compute_cost_scale
from mocap_fit.fitting.objective import Evaluator, Objective, check_objective
from mocap_fit.fitting.precision import estimate_noise
from mocap_fit.fitting.shape import ShapeFit
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

# The markers' noise counts as this much at least (mm), so that it can be divided by.
_LEAST_NOISE = 1e-6
# The solver stops where all steps are below this, in units of the parameters, or the total cost
# is about to fall by less than this part of itself.
_SMALL_STEP, _SMALL_FALL = 1e-5, 1e-9
# A frame that would move less than this stays, and need not be looked at again.
_STILL = 1e-8
# Median of a squared distance over the variance of a coordinate.
_MEDIAN_CHI_SQUARE = 2.366
# Part of the mean information that is added where there is none, so that all can be solved.
_RIDGE = 1e-10


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
    """Find the smooth parameter tracks that best explain the markers of all frames together.

    Parameters
    ----------
    binding
        The virtual markers; from `bind_markers`.
    recording
        The recording in head coordinates; from `remove_head_motion`.
    fit
        The frame-by-frame fit of the same recording, from `fit_shape`: where this one starts,
        and what its weights are learnt from. Its pose corrections are kept.
    objective, huber_threshold
        As in `fit_shape`.
    weight
        How much smoothness counts. A number: ``weight · (what the parameter moves)² ∫ x''² dt``
        is added to the cost for each parameter, where what it moves is the root mean square
        motion of the face markers per unit in the reference pose, millimetres. A number for each
        parameter: ``weight ∫ x''² dt``. Without it, the data decide; see the notes.
    maximum_gap
        Frames with too few markers are bridged where no more than so many seconds of them
        follow each other; a longer gap stays open, and what is on either side of it is solved on
        its own.
    maximum_rounds
        The solver stops after so many evaluations of all frames.
    progress
        Called with the number of frames done so far.

    Returns
    -------
    ShapeFit
        Bridged frames have the status `BRIDGED`. Standard deviations are those of the smooth
        tracks, larger in gaps; infinite where the markers leave a parameter find_undetermined for
        longer than the largest gap, or up to the end of a stretch.

    Raises
    ------
    DataError
        If the fit is not one of this recording, with this face.
    ConfigurationError
        If a setting is not possible.

    Notes
    -----
    For Gaussian noise, what is minimised is the negative logarithm of the posterior of a prior
    under which each parameter's second derivative is white noise of a strength q, and
    ``weight = kappa k / (2 q)``: kappa is what the cost must be divided by to be a negative log
    likelihood (twice the noise variance for ``squares``), and k says how many times larger the
    parameter's noise is than the markers' noise explains, as where the head's pose has noise of
    its own.

    By default all of these come from the data. The markers' noise is what changes in the
    residuals from frame to frame; k and q of each parameter are those of the greatest restricted
    marginal likelihood of its frame-by-frame track, k no less than the noise of markers and head
    pose explains (Wahba, Annals of Statistics 13, 1985; `estimate_smoothing`).
    Likelihood rather than cross-validation: cross-validation has no use for a noise that is
    known, and undersmooths now and then.

    One strength for a whole recording would flatten what is quick: a lip closure is over in
    80 ms. The strength therefore has its own value at every moment, learnt from the moments
    around it (`estimate_local_smoothing`): such a prior has heavy tails and tolerates a few quick
    gestures. It smooths calm stretches more and quick ones less. A given weight is the same at
    all moments.

    In every round each frame's cost is made quadratic, the banded normal equations of all frames
    are solved within the bounds, and a frame whose cost bends more than its quadratic form said is
    held back. The total cost never rises.

    Time and memory grow with the frames, no faster.
    """
    _check(binding, recording, fit, objective, huber_threshold, maximum_gap, maximum_rounds)
    rate, scale, bounds = recording.rate, binding.orientation.scale, binding.rig.bounds
    threshold = huber_threshold * scale
    targets = _transform_markers(binding, recording, fit)
    shown = np.where(np.isfinite(targets[:, :, 0]), binding.weights, 0.0)
    evaluator = Evaluator(binding, objective, threshold)
    longest = maximum_gap * rate + 1e-6
    slices = _split_at_gaps(fit.fitted, longest)
    stretches = [FrameCosts(evaluator, targets[s], shown[s], objective, threshold) for s in slices]
    starts = [_fill_gaps(fit.parameters.values[s], bounds) for s in slices]
    locals_ = [data.at(start) for data, start in zip(stretches, starts, strict=True)]
    noise = _estimate_noise(locals_, stretches)
    if not np.isfinite(noise):
        noise = fit.noise * scale if np.isfinite(fit.noise) else 1.0
    cost_scale = compute_cost_scale(objective, threshold, max(noise, _LEAST_NOISE))
    bare = [_compute_bare_deviations(local.information) for local in locals_]
    units = [
        _compute_unit_deviations(fit, part, b, scale) for part, b in zip(slices, bare, strict=True)
    ]
    noisiness = _compute_noise_ratio(units, bare)
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

    values = np.full(fit.parameters.values.shape, np.nan)
    deviations = np.full(values.shape, np.nan)
    distances = np.full(shown.shape, np.nan)
    costs, evaluations = np.full(len(values), np.nan), fit.evaluations.copy()
    status, taken = fit.status.copy(), np.zeros(len(values))
    for i, (part, data) in enumerate(zip(slices, stretches, strict=True)):
        solution, here, rounds = _solve(
            data, starts[i], locals_[i], strengths[i], rate, bounds, maximum_rounds
        )
        spread = _compute_covariance(here.information, strengths[i], noisiness, cost_scale, rate)
        values[part], costs[part] = solution, here.costs
        evaluations[part] += rounds
        lost = np.isinf(fit.parameters.standard_deviations[part]) | ~fit.fitted[part, None]
        deviations[part] = np.where(
            _find_long_gaps(lost, longest), np.inf, np.sqrt(np.einsum("tpp->tp", spread))
        )
        taken[part] = np.einsum("tij,tji->t", spread, here.information) / cost_scale.variance
        distance = np.linalg.norm(here.residuals, axis=2) / scale
        distances[part] = np.where(data.weights > 0, distance, np.nan)
        status[part] = np.where(fit.fitted[part], fit.status[part], BRIDGED)
        if progress is not None:
            progress(part.stop)
    visible = np.isfinite(distances)
    count = visible.sum(axis=1)
    residuals = np.sqrt(
        np.divide(
            np.nansum(distances**2, axis=1), count, out=np.full(len(count), np.nan), where=count > 0
        )
    )
    tracks = fit.parameters.replace(
        values=values, standard_deviations=deviations, residuals=residuals
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
    return ShapeFit(
        tracks,
        fit.marker_names,
        distances,
        costs,
        evaluations,
        status,
        fit.pose_corrections,
        estimate_noise(distances, binding.weights, taken),
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
    """Minimise the total cost of a stretch; returns values, costs there, and evaluations."""
    bands = build_roughness_bands(len(values), rate, 2.0 * strengths)
    rounds = 1
    total = _compute_total(local, values, strengths, rate)
    held = np.zeros(len(values))
    ridge = _compute_ridge(local.information)
    while rounds < maximum_rounds:
        diagonal = np.einsum("tpp->tp", local.curvatures)
        blocks = local.curvatures.copy()
        np.einsum("tpp->tp", blocks)[:] += held[:, None] * diagonal + ridge
        nothing = np.zeros_like(blocks)
        slope = local.gradients + multiply(nothing, bands, values)
        step = minimise_in_box(blocks, bands, slope, bounds[:, 0] - values, bounds[:, 1] - values)
        bend = 0.5 * np.einsum("ti,tij,tj->t", step, blocks, step)
        fall = -float(np.sum(slope * step) + 0.5 * np.sum(step * multiply(blocks, bands, step)))
        if np.abs(step).max() < _SMALL_STEP or fall <= _SMALL_FALL * total:
            break
        moved = np.abs(step).max(axis=1) > _STILL
        step[~moved] = 0.0
        stepped = np.clip(values + step, bounds[:, 0], bounds[:, 1])
        trial = data.update(stepped, local, moved)
        rounds += 1
        new_total = _compute_total(trial, stepped, strengths, rate)
        rise = trial.costs - local.costs - np.einsum("tp,tp->t", local.gradients, step)
        stubborn = rise > 1.5 * bend + 1e-12 * local.costs
        if new_total < total:
            values, local, total = stepped, trial, new_total
            held = np.where(stubborn, np.maximum(2 * held, 0.1), held / 4)
            held[held < 0.01] = 0.0
        elif stubborn.any():
            held = np.where(stubborn, np.maximum(4 * held, 1.0), held)
        else:
            held = np.maximum(4 * held, 1.0)
    return values, local, rounds


def _compute_total(
    local: LocalCosts, values: FloatArray, strengths: FloatArray, rate: float
) -> float:
    return float(local.costs.sum() + np.sum(strengths * compute_curvature(values, rate) ** 2))


def _estimate_noise(locals_: Sequence[LocalCosts], stretches: Sequence[FrameCosts]) -> float:
    """Noise of a coordinate by how residuals change from frame to frame, in the face's mm.

    A face that cannot take the speaker's shape leaves residuals that change slowly; they are no
    noise. Second differences of the residual vectors take them away. The median forgives jumps.
    """
    squares, shares = [], []
    for local, data in zip(locals_, stretches, strict=True):
        seen = data.weights > 0
        if len(seen) > 2:
            thrice = seen[:-2] & seen[1:-1] & seen[2:]
            second = np.diff(local.residuals, n=2, axis=0)
            # The parameters take their share of what noise does to the markers.
            left = 1.0 - local.gradients.shape[1] / np.maximum(3.0 * seen.sum(axis=1), 1.0)
            squares.append(np.einsum("tmi,tmi->tm", second, second)[thrice])
            shares.append(np.broadcast_to(left[1:-1, None], thrice.shape)[thrice])
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
    """Deviation of the frame-by-frame parameters per unit of noise; infinite where unknown.

    The head's pose has noise of its own, which the fit's deviations hold and the bare ones, from
    the markers' information, do not.
    """
    deviations = fit.parameters.standard_deviations[part]
    unit = (
        deviations / (fit.noise * scale)
        if fit.noise > 0
        else np.where(np.isinf(deviations), deviations, bare)
    )
    return np.asarray(np.where(fit.fitted[part, None] & np.isfinite(unit), unit, np.inf))


def _compute_noise_ratio(units: Sequence[FloatArray], bare: Sequence[FloatArray]) -> FloatArray:
    """How many times larger the parameters' variance is than the bare one, `(parameters,)`."""
    squares = np.concatenate([(u / b) ** 2 for u, b in zip(units, bare, strict=True)])
    known = np.isfinite(squares)
    return np.array([np.median(squares[k, p]) if k.any() else 1.0 for p, k in enumerate(known.T)])


def _learn_smoothing(
    tracks: Sequence[FloatArray], units: Sequence[FloatArray], cost_scale: CostScale, rate: float
) -> tuple[FloatArray, FloatArray]:
    """Smoothing and noise of every parameter, as `estimate_smoothing` gives them."""
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
    """``sqrt diag (JᵀJ)⁻¹`` of every frame, `(frames, parameters)`."""
    blocks = information.copy()
    np.einsum("tpp->tp", blocks)[:] += _compute_ridge(information)
    return np.asarray(np.sqrt(np.einsum("tpp->tp", np.linalg.inv(blocks))))


def _compute_ridge(information: FloatArray) -> FloatArray:
    """A little information of every parameter."""
    mean = np.einsum("tpp->p", information) / len(information)
    return np.asarray(_RIDGE * np.maximum(mean, 1e-3 * mean.max() + 1e-300))


def _check_weight(
    weight: float | Sequence[float], binding: Binding, evaluator: Evaluator
) -> FloatArray:
    """Weight of every parameter, from what the user gave."""
    count = len(binding.parameter_names)
    strengths = np.asarray(weight, dtype=np.float64)
    if (
        strengths.shape not in ((), (count,))
        or not (np.isfinite(strengths) & (strengths > 0)).all()
    ):
        raise ConfigurationError(
            "the weight of smoothness is not possible",
            found=weight,
            expected=f"a number above 0, or {count} of them",
        )
    if strengths.shape == (count,):
        return strengths
    _, jacobian = evaluator.evaluate(binding.reference_parameters)
    moved = np.einsum("m,mip,mip->p", binding.weights, jacobian, jacobian) / binding.weights.sum()
    return np.asarray(strengths * np.maximum(moved, 1e-6 * moved.max()))


def _compute_covariance(
    information: FloatArray,
    strengths: FloatArray,
    noisiness: FloatArray,
    cost_scale: CostScale,
    rate: float,
) -> FloatArray:
    """Covariance of the parameters of every frame, `(frames, parameters, parameters)`."""
    noise = np.sqrt(cost_scale.variance * noisiness)
    blocks = information / noise[:, None] / noise
    np.einsum("tpp->tp", blocks)[:] += _compute_ridge(blocks)
    precision = 2.0 * strengths / (cost_scale.kappa * noisiness)
    return compute_inverse_blocks(blocks, build_roughness_bands(len(blocks), rate, precision))


def _summarise_strengths(strengths: Sequence[FloatArray]) -> FloatArray:
    """The middle weight of every parameter."""
    every = np.concatenate(strengths)
    return np.median(every, axis=0) if len(every) else np.zeros(every.shape[1])


def _transform_markers(binding: Binding, recording: MarkerTracks, fit: ShapeFit) -> FloatArray:
    """Measured face markers in the face's coordinates, with the fit's pose corrections undone."""
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
    """Where frames are solved together: from one fitted frame to another, without long gaps."""
    frames = np.flatnonzero(fitted)
    cuts = np.flatnonzero(np.diff(frames) > longest + 1)
    firsts = frames[np.concatenate([[0], cuts + 1])]
    lasts = frames[np.concatenate([cuts, [len(frames) - 1]])]
    return [slice(int(a), int(b) + 1) for a, b in zip(firsts, lasts, strict=True)]


def _fill_gaps(values: FloatArray, bounds: FloatArray) -> FloatArray:
    """The values with gaps filled by straight lines, within bounds."""
    there = np.flatnonzero(np.isfinite(values).all(axis=1))
    frames = np.arange(len(values))
    filled = np.stack([np.interp(frames, there, column[there]) for column in values.T], axis=1)
    return np.asarray(np.clip(filled, bounds[:, 0], bounds[:, 1]))


def _find_long_gaps(lost: BoolArray, longest: float) -> BoolArray:
    """Which of the `(frames, parameters)` that are lost are so for too long, or at an end."""
    too_long = np.zeros_like(lost)
    for p, column in enumerate(lost.T):
        edges = np.diff(np.concatenate([[False], column, [False]]).astype(int))
        starts, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
        for start, end in zip(starts, ends, strict=True):
            if end - start > longest or start == 0 or end == len(column):
                too_long[start:end, p] = True
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
    check_objective(objective, huber_threshold)
    if not (np.isfinite(maximum_gap) and maximum_gap >= 0):
        raise ConfigurationError(
            "the longest gap to bridge is not possible",
            found=maximum_gap,
            expected="seconds, 0 or more",
        )
    if maximum_rounds < 1:
        raise ConfigurationError(
            "the number of rounds is not possible", found=maximum_rounds, expected="1 up"
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
