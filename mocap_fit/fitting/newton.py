"""A Newton solver for the shape fit, compiled, frame after frame.

In each frame the virtual markers are made linear in the parameters at the best point so far; the
cost of the linear model is minimised exactly, within bounds, by Newton's method; a step along
the answer that lowers the true cost is taken, and it begins again. Three or four such rounds do.

The sum of distances has no second derivative where a residual is nil, and Newton's method on it
crawls; the primal-dual form of Chan, Golub and Mulet (SIAM J. Sci. Comput. 20, 1999), made for
total variation, which is the same kind of sum, keeps a dual variable for each marker's direction
and converges as if there were one.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from mocap_fit.fitting.kernel import (
    DISTANCES,
    SQUARES,
    compiled,
    move,
    residuals,
    residuals_into,
)
from mocap_fit.fitting.slopes import jacobian
from mocap_fit.fitting.slots import LANES, Slots
from mocap_fit.tracks import FloatArray

# A distance counts as this much at least (mm), so that it can be divided by.
_LEAST = 1e-6
_ROUNDS, _STEPS, _HALVINGS = 30, 60, 12


class NewtonRoom(NamedTuple):
    """Where the solver works; ``rows`` is blocks · 96, ``markers`` blocks · 32."""

    start: FloatArray  # (rows,) residuals at the point of linearisation
    here: FloatArray  # (rows,) and at the model's best point
    trial: FloatArray  # (rows,)
    dual: FloatArray  # (rows,)
    curvature: FloatArray  # (2, markers): of each marker's cost, and the part of it that bends
    scaled: FloatArray  # (rows,) a parameter's slopes times the curvature
    along: FloatArray  # (parameters, markers) slopes along the residual
    across: FloatArray  # (parameters, markers) slopes along the dual
    hessian: FloatArray  # (parameters, parameters)
    factor: FloatArray  # (parameters, parameters)
    vectors: FloatArray  # (6, parameters)


def newton_room(slots: Slots) -> NewtonRoom:
    """Room for the solver."""
    rows, markers, count = slots.blocks * 3 * LANES, slots.blocks * LANES, slots.parameters
    return NewtonRoom(
        np.empty(rows),
        np.empty(rows),
        np.empty(rows),
        np.zeros(rows),
        np.empty((2, markers)),
        np.empty(rows),
        np.empty((count, markers)),
        np.empty((count, markers)),
        np.empty((count, count)),
        np.zeros((count, count)),
        np.empty((6, count)),
    )


@compiled
def _cost(rows, frame, objective, threshold):  # type: ignore[no-untyped-def]
    """Cost of residuals, as `kernel.residuals` has it."""
    total = 0.0
    for block in range(rows.shape[0] // (3 * LANES)):
        r, w = block * 3 * LANES, block * 4 * LANES + 3 * LANES
        if objective == SQUARES:
            for m in range(LANES):
                r0, r1, r2 = rows[r + m], rows[r + LANES + m], rows[r + 2 * LANES + m]
                total += frame[w + m] * (r0 * r0 + r1 * r1 + r2 * r2)
        elif objective == DISTANCES:
            for m in range(LANES):
                r0, r1, r2 = rows[r + m], rows[r + LANES + m], rows[r + 2 * LANES + m]
                total += frame[w + m] * math.sqrt(r0 * r0 + r1 * r1 + r2 * r2)
        else:
            for m in range(LANES):
                r0, r1, r2 = rows[r + m], rows[r + LANES + m], rows[r + 2 * LANES + m]
                distance = math.sqrt(r0 * r0 + r1 * r1 + r2 * r2)
                straight = threshold * (2.0 * distance - threshold)
                total += frame[w + m] * (distance * distance if distance <= threshold else straight)
    return total


@compiled
def _linear(start, slopes, step, out):  # type: ignore[no-untyped-def]
    """Residuals of the linear model after a step."""
    for i in range(out.shape[0]):
        out[i] = start[i]
    for p in range(step.shape[0]):
        d, amount = slopes[p], step[p]
        for i in range(out.shape[0]):
            out[i] += amount * d[i]


@compiled
def _curve(room, frame, objective, threshold):  # type: ignore[no-untyped-def]
    """Curvature of every marker's cost in its distance, over the distance."""
    rows, curvature = room.here, room.curvature
    for block in range(rows.shape[0] // (3 * LANES)):
        r, w, k = block * 3 * LANES, block * 4 * LANES + 3 * LANES, block * LANES
        for m in range(LANES):
            r0, r1, r2 = rows[r + m], rows[r + LANES + m], rows[r + 2 * LANES + m]
            distance = math.sqrt(r0 * r0 + r1 * r1 + r2 * r2 + _LEAST * _LEAST)
            straight = 1.0 if objective == DISTANCES else 2.0 * threshold
            near = objective == SQUARES or (objective != DISTANCES and distance <= threshold)
            curvature[0, k + m] = frame[w + m] * (2.0 if near else straight / distance)
            curvature[1, k + m] = 0.0 if near else 1.0 / distance


@compiled
def _normal_equations(room, slopes, gradient):  # type: ignore[no-untyped-def]
    """Gradient and Hessian of the linear model; the lower half of the Hessian."""
    rows, dual, curvature, scaled = room.here, room.dual, room.curvature, room.scaled
    for p in range(gradient.shape[0]):
        d, along, across = slopes[p], room.along[p], room.across[p]
        total = 0.0
        for block in range(rows.shape[0] // (3 * LANES)):
            r, k = block * 3 * LANES, block * LANES
            for m in range(LANES):
                d0, d1, d2 = d[r + m], d[r + LANES + m], d[r + 2 * LANES + m]
                along[k + m] = (
                    d0 * rows[r + m] + d1 * rows[r + LANES + m] + d2 * rows[r + 2 * LANES + m]
                )
            for m in range(LANES):
                total += curvature[0, k + m] * along[k + m]
                along[k + m] *= curvature[0, k + m] * curvature[1, k + m]
            for m in range(LANES):
                d0, d1, d2 = d[r + m], d[r + LANES + m], d[r + 2 * LANES + m]
                across[k + m] = 0.5 * (
                    d0 * dual[r + m] + d1 * dual[r + LANES + m] + d2 * dual[r + 2 * LANES + m]
                )
        gradient[p] = total
    for p in range(gradient.shape[0]):
        d = slopes[p]
        for block in range(rows.shape[0] // (3 * LANES)):
            r, k = block * 3 * LANES, block * LANES
            for m in range(LANES):
                weight = curvature[0, k + m]
                scaled[r + m] = weight * d[r + m]
                scaled[r + LANES + m] = weight * d[r + LANES + m]
                scaled[r + 2 * LANES + m] = weight * d[r + 2 * LANES + m]
        for q in range(p + 1):
            other, total = slopes[q], 0.0
            for i in range(scaled.shape[0]):
                total += scaled[i] * other[i]
            along, across = room.along[p], room.across[p]
            along_other, across_other = room.along[q], room.across[q]
            for m in range(along.shape[0]):
                total -= along[m] * across_other[m] + across[m] * along_other[m]
            room.hessian[p, q] = total


@compiled
def _solve(room, gradient, free, out):  # type: ignore[no-untyped-def]
    """Newton's step on the free parameters, by Cholesky's factors."""
    hessian, factor = room.hessian, room.factor
    count = gradient.shape[0]
    for i in range(count):
        if free[i] == 0.0:
            for j in range(i):
                factor[i, j] = 0.0
            factor[i, i], out[i] = 1.0, 0.0
            continue
        right = -gradient[i]
        for j in range(i):
            if free[j] == 0.0:
                factor[i, j] = 0.0
                continue
            h = hessian[i, j]
            for k in range(j):
                h -= factor[i, k] * factor[j, k]
            factor[i, j] = h / factor[j, j]
            right -= factor[i, j] * out[j]
        h = hessian[i, i] * (1.0 + 1e-9) + 1e-9
        for k in range(i):
            h -= factor[i, k] * factor[i, k]
        factor[i, i] = math.sqrt(max(h, 1e-12))
        out[i] = right / factor[i, i]
    for i in range(count - 1, -1, -1):
        right = out[i]
        for k in range(i + 1, count):
            right -= factor[k, i] * out[k]
        out[i] = right / factor[i, i]


@compiled
def _update_dual(room, portion):  # type: ignore[no-untyped-def]
    """Bring the dual variables along a step, and back into their balls."""
    rows, trial, dual = room.here, room.trial, room.dual
    for block in range(rows.shape[0] // (3 * LANES)):
        r = block * 3 * LANES
        for m in range(LANES):
            r0, r1, r2 = rows[r + m], rows[r + LANES + m], rows[r + 2 * LANES + m]
            inverse = 1.0 / math.sqrt(r0 * r0 + r1 * r1 + r2 * r2 + _LEAST * _LEAST)
            full = inverse / portion
            v0 = (trial[r + m] - r0) * full
            v1 = (trial[r + LANES + m] - r1) * full
            v2 = (trial[r + 2 * LANES + m] - r2) * full
            u0, u1, u2 = r0 * inverse, r1 * inverse, r2 * inverse
            along = u0 * v0 + u1 * v1 + u2 * v2
            z0 = u0 + v0 - along * dual[r + m]
            z1 = u1 + v1 - along * dual[r + LANES + m]
            z2 = u2 + v2 - along * dual[r + 2 * LANES + m]
            shrink = 1.0 / max(1.0, math.sqrt(z0 * z0 + z1 * z1 + z2 * z2))
            dual[r + m], dual[r + LANES + m] = z0 * shrink, z1 * shrink
            dual[r + 2 * LANES + m] = z2 * shrink


@compiled
def _model_step(  # type: ignore[no-untyped-def]
    values, frame, objective, threshold, bounds, fixed, tolerance, slopes, work
):
    """Minimise the linear model within the bounds; the step is ``vectors[0]``."""
    step, trial, gradient = work.vectors[0], work.vectors[1], work.vectors[2]
    free, newton = work.vectors[3], work.vectors[4]
    count = values.shape[0]
    for p in range(count):
        step[p] = 0.0
    for i in range(work.here.shape[0]):
        work.here[i] = work.start[i]
    best = _cost(work.here, frame, objective, threshold)
    for _ in range(_STEPS):
        _curve(work, frame, objective, threshold)
        _normal_equations(work, slopes, gradient)
        for p in range(count):
            value = values[p] + step[p]
            held = (value <= bounds[p, 0] and gradient[p] > 0.0) or (
                value >= bounds[p, 1] and gradient[p] < 0.0
            )
            free[p] = 0.0 if held or fixed[p] else 1.0
        _solve(work, gradient, free, newton)
        portion, found, now = 1.0, False, best
        for _ in range(_HALVINGS):
            for p in range(count):
                value = values[p] + step[p] + portion * newton[p]
                trial[p] = min(max(value, bounds[p, 0]), bounds[p, 1]) - values[p]
            _linear(work.start, slopes, trial, work.trial)
            now = _cost(work.trial, frame, objective, threshold)
            if now <= best:
                found = True
                break
            portion *= 0.4
        if not found:
            break
        if objective != SQUARES:
            _update_dual(work, portion)
        fall, best = best - now, now
        for p in range(count):
            step[p] = trial[p]
        for i in range(work.here.shape[0]):
            work.here[i] = work.trial[i]
        if fall <= tolerance * best:
            break


@compiled
def solve_frames(  # type: ignore[no-untyped-def]
    a,
    frames,
    start,
    objective,
    threshold,
    bounds,
    fixed,
    tolerance,
    room,
    work,
    values,
    costs,
    evaluations,
):
    """Minimise the cost of frame after frame, each from the answer before.

    Parameters
    ----------
    a, room
        `Slots` and `kernel.Room`.
    frames
        `(frames, blocks · 128)`: the measured markers, from `pack_frames`.
    start
        `(parameters,)`, within the bounds: where the first frame begins; at the end, the last
        answer.
    objective, threshold
        As in `kernel.residuals`.
    bounds
        `(parameters, 2)`.
    fixed
        `(frames, parameters)`: which parameters keep their value from the frame before.
    tolerance
        A frame ends when a round lowers its cost by less than this part of it.
    work
        `NewtonRoom`.
    values, costs
        `(frames, parameters)` and `(frames,)`, filled: the answers, and the cost at them.
    evaluations
        `(frames,)`, filled: how often the true cost was evaluated.
    """
    trial = work.vectors[5]
    for frame in range(frames.shape[0]):
        move(a, start, room)
        best = residuals(a, frames[frame], objective, threshold, room)
        residuals_into(a, room, work.start)
        evaluations[frame] = 1
        for i in range(work.dual.shape[0]):
            work.dual[i] = 0.0
        for _ in range(_ROUNDS):
            jacobian(a, start, room)
            _model_step(
                start,
                frames[frame],
                objective,
                threshold,
                bounds,
                fixed[frame],
                tolerance,
                room.jacobian,
                work,
            )
            portion, found, now = 1.0, False, best
            for _ in range(_HALVINGS):
                for p in range(start.shape[0]):
                    trial[p] = start[p] + portion * work.vectors[0, p]
                move(a, trial, room)
                now = residuals(a, frames[frame], objective, threshold, room)
                evaluations[frame] += 1
                if now <= best:
                    found = True
                    break
                portion *= 0.5
            if not found:
                break
            residuals_into(a, room, work.start)
            fall, best = best - now, now
            for p in range(start.shape[0]):
                start[p] = trial[p]
            if fall <= tolerance * best:
                break
        costs[frame] = best
        for p in range(start.shape[0]):
            values[frame, p] = start[p]
