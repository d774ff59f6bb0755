"""A Newton solver for the shape fit, compiled, frame after frame.

In each frame the virtual markers are made linear in the parameters at the best point so far; the
cost of the linear model is minimised, within bounds, by Newton's method; a step along the answer
that lowers the true cost is taken, and it begins again, until the linear model was as good as
exact. Two rounds do, as a frame begins with the markers and slopes that the one before ended with.

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
    back,
    compiled,
    inner,
    misfit,
    place,
    subtract,
    sum_of_lanes,
)
from mocap_fit.fitting.slots import LANES, SLOT, Slots, Y, Z, aligned_zeros
from mocap_fit.tracks import FloatArray

# A distance counts as this much at least (mm), so that it can be divided by.
_LEAST = 1e-6
_ROUNDS, _STEPS, _HALVINGS = 30, 60, 12
_LOOSE = 3e-3
# Rows of `NewtonRoom.rows`: virtual markers at the best point; residuals there, at the model's
# best point, and at the point that is tried; the dual variables.
_VIRTUAL, _START, _HERE, _TRIAL, _DUAL = range(5)
# Rows of `NewtonRoom.vectors`.
_STEP, _TRIED, _GRADIENT, _FREE, _NEWTON, _NEXT = range(6)


class NewtonRoom(NamedTuple):
    """Where the solver works.

    Parameters
    ----------
    rows
        `(5, blocks · 96)`: what the markers have, see above.
    bends
        `(7, blocks · 32)`: of each marker the curvature of its cost in its distance, over the
        distance, and the six numbers of its symmetric 3 × 3 second derivative.
    slopes
        `(parameters, blocks · 96)`: derivative of the virtual markers.
    bent
        `(parameters, blocks · 96)`: the second derivatives times the slopes.
    vectors
        `(6, parameters)`.
    hessian, factor
        `(parameters, parameters)`.
    lanes
        `(32,)`.
    """

    rows: FloatArray
    bends: FloatArray
    slopes: FloatArray
    bent: FloatArray
    vectors: FloatArray
    hessian: FloatArray
    factor: FloatArray
    lanes: FloatArray


def newton_room(slots: Slots) -> NewtonRoom:
    """Room for the solver."""
    rows, count = slots.blocks * SLOT, slots.parameters
    return NewtonRoom(
        aligned_zeros(5, rows),
        aligned_zeros(7, rows // 3),
        aligned_zeros(count, rows),
        aligned_zeros(count, rows),
        aligned_zeros(6, count),
        aligned_zeros(count, count),
        aligned_zeros(count, count),
        aligned_zeros(LANES),
    )


@inner
def _bend(rows, bends, frame, objective, threshold):  # type: ignore[no-untyped-def]
    """Second derivative of every marker's cost by its residual, with the dual's direction."""
    straight = 1.0 if objective == DISTANCES else 2.0 * threshold
    knee = -1.0 if objective == DISTANCES else threshold
    if objective == SQUARES:
        knee = np.inf
    for block in range(rows.shape[1] // SLOT):
        r, w, k = block * SLOT, block * 4 * LANES + SLOT, block * LANES
        for m in range(LANES):
            r0, r1, r2 = rows[_HERE, r + m], rows[_HERE, r + Y + m], rows[_HERE, r + Z + m]
            z0, z1, z2 = rows[_DUAL, r + m], rows[_DUAL, r + Y + m], rows[_DUAL, r + Z + m]
            inverse = 1.0 / math.sqrt(r0 * r0 + r1 * r1 + r2 * r2 + _LEAST * _LEAST)
            far = inverse * knee < 1.0
            c = frame[w + m] * (straight * inverse if far else 2.0)
            # c (I - (u zᵀ + z uᵀ) / 2), where u is the residual's direction and z its dual.
            h = -0.5 * c * inverse if far else 0.0
            bends[0, k + m] = c
            bends[1, k + m] = c + 2.0 * h * r0 * z0
            bends[2, k + m] = c + 2.0 * h * r1 * z1
            bends[3, k + m] = c + 2.0 * h * r2 * z2
            bends[4, k + m] = h * (r0 * z1 + r1 * z0)
            bends[5, k + m] = h * (r0 * z2 + r2 * z0)
            bends[6, k + m] = h * (r1 * z2 + r2 * z1)


@inner
def _normal_equations(rows, bends, slopes, bent, lanes, gradient, hessian):  # type: ignore[no-untyped-def]
    """Gradient and Hessian of the linear model; the lower half of the Hessian."""
    blocks = rows.shape[1] // SLOT
    for p in range(slopes.shape[0]):
        for m in range(LANES):
            lanes[m] = 0.0
        for block in range(blocks):
            r, k = block * SLOT, block * LANES
            for m in range(LANES):
                d0, d1, d2 = slopes[p, r + m], slopes[p, r + Y + m], slopes[p, r + Z + m]
                along = d0 * rows[_HERE, r + m] + d1 * rows[_HERE, r + Y + m]
                lanes[m] += bends[0, k + m] * (along + d2 * rows[_HERE, r + Z + m])
                b01, b02, b12 = bends[4, k + m], bends[5, k + m], bends[6, k + m]
                bent[p, r + m] = bends[1, k + m] * d0 + b01 * d1 + b02 * d2
                bent[p, r + Y + m] = b01 * d0 + bends[2, k + m] * d1 + b12 * d2
                bent[p, r + Z + m] = b02 * d0 + b12 * d1 + bends[3, k + m] * d2
        gradient[p] = sum_of_lanes(lanes, 0)
        for q in range(p + 1):
            for m in range(LANES):
                lanes[m] = 0.0
            for block in range(blocks):
                r = block * SLOT
                for m in range(LANES):
                    first = bent[p, r + m] * slopes[q, r + m]
                    first += bent[p, r + Y + m] * slopes[q, r + Y + m]
                    lanes[m] += first + bent[p, r + Z + m] * slopes[q, r + Z + m]
            hessian[p, q] = sum_of_lanes(lanes, 0)


@inner
def _solve(hessian, factor, gradient, free, out):  # type: ignore[no-untyped-def]
    """Newton's step on the free parameters, by Cholesky's factors."""
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


@inner
def _update_dual(rows, portion):  # type: ignore[no-untyped-def]
    """Bring the dual variables along a step, and back into their balls."""
    for block in range(rows.shape[1] // SLOT):
        for m in range(block * SLOT, block * SLOT + LANES):
            r0, r1, r2 = rows[_HERE, m], rows[_HERE, m + Y], rows[_HERE, m + Z]
            z0, z1, z2 = rows[_DUAL, m], rows[_DUAL, m + Y], rows[_DUAL, m + Z]
            inverse = 1.0 / math.sqrt(r0 * r0 + r1 * r1 + r2 * r2 + _LEAST * _LEAST)
            full = inverse / portion
            v0 = (rows[_TRIAL, m] - r0) * full
            v1 = (rows[_TRIAL, m + Y] - r1) * full
            v2 = (rows[_TRIAL, m + Z] - r2) * full
            u0, u1, u2 = r0 * inverse, r1 * inverse, r2 * inverse
            along = u0 * v0 + u1 * v1 + u2 * v2
            z0 = u0 + v0 - along * z0
            z1 = u1 + v1 - along * z1
            z2 = u2 + v2 - along * z2
            shrink = 1.0 / max(1.0, math.sqrt(z0 * z0 + z1 * z1 + z2 * z2))
            rows[_DUAL, m] = z0 * shrink
            rows[_DUAL, m + Y] = z1 * shrink
            rows[_DUAL, m + Z] = z2 * shrink


@inner
def _model_step(  # type: ignore[no-untyped-def]
    values, frame, objective, threshold, bounds, fixed, tolerance, work, best
):
    """Minimise the linear model within the bounds, from the residuals of the start.

    The step is left in the vectors, the residuals after it in the rows; the cost after it is
    returned. It ends with the step that was to gain less than ``tolerance`` of the cost.
    """
    rows, slopes, vectors = work.rows, work.slopes, work.vectors
    gradient, newton = vectors[_GRADIENT], vectors[_NEWTON]
    start, trial = rows[_START], rows[_TRIAL]
    count, length = values.shape[0], rows.shape[1]
    for p in range(count):
        vectors[_STEP, p] = 0.0
    for i in range(length):
        rows[_HERE, i] = start[i]
    for step in range(_STEPS):
        kind = SQUARES if step == 0 and tolerance == _LOOSE else objective
        _bend(rows, work.bends, frame, kind, threshold)
        _normal_equations(rows, work.bends, slopes, work.bent, work.lanes, gradient, work.hessian)
        for p in range(count):
            vectors[_TRIED, p] = values[p] + vectors[_STEP, p]
        gain = _newton(vectors[_TRIED], bounds, fixed, work)
        portion, found, now = 1.0, False, best
        for _ in range(_HALVINGS):
            for i in range(length):
                trial[i] = start[i]
            for p in range(count):
                value = values[p] + vectors[_STEP, p] + portion * newton[p]
                amount = min(max(value, bounds[p, 0]), bounds[p, 1]) - values[p]
                vectors[_TRIED, p] = amount
                d = slopes[p]
                for i in range(length):
                    trial[i] += amount * d[i]
            now = misfit(trial, frame, objective, threshold, work.lanes)
            if now <= best:
                found = True
                break
            portion *= 0.4
        if not found:
            break
        if objective != SQUARES:
            _update_dual(rows, portion)
        best = now
        for p in range(count):
            vectors[_STEP, p] = vectors[_TRIED, p]
        for i in range(length):
            rows[_HERE, i] = trial[i]
        if portion == 1.0 and gain <= tolerance * best:
            break
    return best


@inner
def _newton(values, bounds, fixed, work):  # type: ignore[no-untyped-def]
    """Newton's step at ``values`` by the gradient and the Hessian there; what it is to gain."""
    vectors = work.vectors
    gradient, free, newton = vectors[_GRADIENT], vectors[_FREE], vectors[_NEWTON]
    for p in range(values.shape[0]):
        held = (values[p] <= bounds[p, 0] and gradient[p] > 0.0) or (
            values[p] >= bounds[p, 1] and gradient[p] < 0.0
        )
        free[p] = 0.0 if held or fixed[p] else 1.0
    _solve(work.hessian, work.factor, gradient, free, newton)
    gain = 0.0
    for p in range(values.shape[0]):
        gain -= 0.5 * gradient[p] * newton[p]
    return gain


@inner
def _accept(rows, frame, start, following):  # type: ignore[no-untyped-def]
    """Take the point that was tried for the best."""
    for p in range(start.shape[0]):
        start[p] = following[p]
    for block in range(rows.shape[1] // SLOT):
        for m in range(block * SLOT, block * SLOT + SLOT):
            rows[_START, m] = rows[_TRIAL, m]
            rows[_VIRTUAL, m] = rows[_TRIAL, m] + frame[block * LANES + m]


@compiled
def solve_frames(  # type: ignore[no-untyped-def]
    plan,
    numbers,
    room,
    work,
    frames,
    start,
    objective,
    threshold,
    bounds,
    fixed,
    tolerance,
    values,
    costs,
    evaluations,
):
    """Minimise the cost of frame after frame, each from the answer before.

    Parameters
    ----------
    plan, numbers, room
        `Slots`, and `(Slots.room,)`.
    work
        `NewtonRoom`.
    frames
        `(frames, blocks · 128)`: the measured markers, from `pack_frames`.
    start
        `(parameters,)`, within the bounds: where the first frame begins; at the end, the last
        answer.
    objective, threshold
        As in `kernel.misfit`.
    bounds
        `(parameters, 2)`.
    fixed
        `(frames, parameters)`: which parameters keep their value from the frame before.
    tolerance
        A frame ends when what is left to gain is less than this part of its cost.
    values, costs
        `(frames, parameters)` and `(frames,)`, filled: the answers, and the cost at them.
    evaluations
        `(frames,)`, filled: how often the virtual markers were placed.
    """
    rows, vectors = work.rows, work.vectors
    virtual, residuals, trial, following = (
        rows[_VIRTUAL],
        rows[_START],
        rows[_TRIAL],
        vectors[_NEXT],
    )
    length, count = rows.shape[1], start.shape[0]
    # What the linear model may be off by: what is left to gain is of the order of its square.
    close = 0.03 * math.sqrt(tolerance)
    place(plan, numbers, room, start, virtual)
    back(plan, numbers, room, np.int64(3), work.slopes)
    for f in range(frames.shape[0]):
        frame = frames[f]
        for block in range(length // SLOT):
            for m in range(block * SLOT, block * SLOT + SLOT):
                residuals[m] = virtual[m] - frame[block * LANES + m]
        for i in range(length):
            rows[_DUAL, i] = 0.0
        best = misfit(residuals, frame, objective, threshold, work.lanes)
        evaluations[f] = 0
        # The slopes are those of an earlier frame: near, but not here.
        exact = f == 0
        for _ in range(_ROUNDS):
            # A model that is not exact is not worth an exact answer.
            enough = tolerance if exact else max(tolerance, _LOOSE)
            expected = _model_step(
                start, frame, objective, threshold, bounds, fixed[f], enough, work, best
            )
            portion, found, now = 1.0, False, best
            for _ in range(_HALVINGS):
                for p in range(count):
                    following[p] = start[p] + portion * vectors[_STEP, p]
                place(plan, numbers, room, following, trial)
                subtract(trial, frame)
                now = misfit(trial, frame, objective, threshold, work.lanes)
                evaluations[f] += 1
                if now <= best:
                    found = True
                    break
                portion *= 0.5
            fall = best - now
            if found:
                best = now
                _accept(rows, frame, start, following)
                as_expected = portion == 1.0 and abs(now - expected) <= close * best
                if exact and (as_expected or fall <= tolerance * best):
                    break
            elif exact:
                break
            if not found:
                place(plan, numbers, room, start, trial)
            back(plan, numbers, room, np.int64(3), work.slopes)
            exact = True
        costs[f] = best
        for p in range(count):
            values[f, p] = start[p]
