"""A Newton solver for the shape fit, compiled, frame after frame.

In each frame the virtual markers are linearised at the best parameters so far; Newton's method
minimises the cost of the linear model within the bounds; a step along the result that lowers the
true cost is taken, and the loop repeats until the linear model predicts the cost. Two rounds are
enough, as a frame starts from the markers and the Jacobian at the end of the one before.

The sum of distances has no second derivative where a residual is 0, and Newton's method converges
slowly on it; the primal-dual form of Chan, Golub and Mulet (SIAM J. Sci. Comput. 20, 1999),
developed for total variation, which is the same kind of sum, holds a dual variable for each
marker's direction and converges quadratically.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from mocap_fit.fitting.kernel import (
    DISTANCES,
    SQUARES,
    adjoint,
    compiled,
    cost,
    forward,
    inner,
    subtract,
    sum_block,
)
from mocap_fit.fitting.packed_binding import SLOT, WIDTH, PackedBinding, Y, Z, allocate_aligned
from mocap_fit.tracks import FloatArray

# Least distance that is divided by, millimetres.
_LEAST = 1e-6
_ROUNDS, _STEPS, _HALVINGS = 30, 60, 12
_LOOSE = 3e-3
# Rows of `NewtonWorkspace.rows`: virtual markers at the best point; residuals there, at the model's
# best point, and at the trial point; the dual variables.
_VIRTUAL, _START, _HERE, _TRIAL, _DUAL = range(5)
# Rows of `NewtonWorkspace.vectors`.
_STEP, _TRIED, _GRADIENT, _FREE, _NEWTON, _NEXT = range(6)


class NewtonWorkspace(NamedTuple):
    """Scratch memory of the solver.

    Parameters
    ----------
    rows
        Virtual markers, residuals and duals, ``(5, blocks · 96)``, millimetres.
    hessians
        Of each marker's cost by its residual, ``(7, blocks · 32)``: slope over distance, and the
        six numbers of the symmetric 3 x 3 matrix; per millimetre.
    jacobian
        Derivative of the virtual markers, ``(parameters, blocks · 96)``, millimetres per unit.
    products
        The Hessians times the Jacobian, ``(parameters, blocks · 96)``, no unit.
    vectors
        Steps, gradients and points, ``(6, parameters)``, in units of the parameters.
    hessian
        Second derivatives of the model by the parameters, ``(parameters, parameters)``, in the
        unit of the cost.
    factor
        Cholesky factor of the Hessian, ``(parameters, parameters)``, no unit.
    sums
        Partial sums, ``(32,)``, no unit.
    """

    rows: FloatArray
    hessians: FloatArray
    jacobian: FloatArray
    products: FloatArray
    vectors: FloatArray
    hessian: FloatArray
    factor: FloatArray
    sums: FloatArray


def make_workspace(packed: PackedBinding) -> NewtonWorkspace:
    """Allocate the solver's scratch memory.

    Parameters
    ----------
    packed
        Packed binding.

    Returns
    -------
    NewtonWorkspace
        Zeros.
    """
    rows, count = packed.blocks * SLOT, packed.parameters
    return NewtonWorkspace(
        allocate_aligned(5, rows),
        allocate_aligned(7, rows // 3),
        allocate_aligned(count, rows),
        allocate_aligned(count, rows),
        allocate_aligned(6, count),
        allocate_aligned(count, count),
        allocate_aligned(count, count),
        allocate_aligned(WIDTH),
    )


@inner
def _compute_hessians(rows, hessians, frame, objective, threshold):  # type: ignore[no-untyped-def]
    """Compute the Hessian of every marker's cost by its residual, with its dual."""
    straight = 1.0 if objective == DISTANCES else 2.0 * threshold
    knee = -1.0 if objective == DISTANCES else threshold
    if objective == SQUARES:
        knee = np.inf
    for block in range(rows.shape[1] // SLOT):
        r, w, k = block * SLOT, block * 4 * WIDTH + SLOT, block * WIDTH
        for m in range(WIDTH):
            r0, r1, r2 = rows[_HERE, r + m], rows[_HERE, r + Y + m], rows[_HERE, r + Z + m]
            z0, z1, z2 = rows[_DUAL, r + m], rows[_DUAL, r + Y + m], rows[_DUAL, r + Z + m]
            inverse = 1.0 / math.sqrt(r0 * r0 + r1 * r1 + r2 * r2 + _LEAST * _LEAST)
            far = inverse * knee < 1.0
            c = frame[w + m] * (straight * inverse if far else 2.0)
            # c (I - (u zᵀ + z uᵀ) / 2), where u is the residual's direction and z its dual.
            h = -0.5 * c * inverse if far else 0.0
            hessians[0, k + m] = c
            hessians[1, k + m] = c + 2.0 * h * r0 * z0
            hessians[2, k + m] = c + 2.0 * h * r1 * z1
            hessians[3, k + m] = c + 2.0 * h * r2 * z2
            hessians[4, k + m] = h * (r0 * z1 + r1 * z0)
            hessians[5, k + m] = h * (r0 * z2 + r2 * z0)
            hessians[6, k + m] = h * (r1 * z2 + r2 * z1)


@inner
def _build_normal_equations(rows, hessians, jacobian, products, sums, gradient, hessian):  # type: ignore[no-untyped-def]
    """Compute the gradient and the lower half of the Hessian of the linear model."""
    blocks = rows.shape[1] // SLOT
    for p in range(jacobian.shape[0]):
        for m in range(WIDTH):
            sums[m] = 0.0
        for block in range(blocks):
            r, k = block * SLOT, block * WIDTH
            for m in range(WIDTH):
                d0, d1, d2 = jacobian[p, r + m], jacobian[p, r + Y + m], jacobian[p, r + Z + m]
                along = d0 * rows[_HERE, r + m] + d1 * rows[_HERE, r + Y + m]
                sums[m] += hessians[0, k + m] * (along + d2 * rows[_HERE, r + Z + m])
                b01, b02, b12 = hessians[4, k + m], hessians[5, k + m], hessians[6, k + m]
                products[p, r + m] = hessians[1, k + m] * d0 + b01 * d1 + b02 * d2
                products[p, r + Y + m] = b01 * d0 + hessians[2, k + m] * d1 + b12 * d2
                products[p, r + Z + m] = b02 * d0 + b12 * d1 + hessians[3, k + m] * d2
        gradient[p] = sum_block(sums, 0)
        for q in range(p + 1):
            for m in range(WIDTH):
                sums[m] = 0.0
            for block in range(blocks):
                r = block * SLOT
                for m in range(WIDTH):
                    first = products[p, r + m] * jacobian[q, r + m]
                    first += products[p, r + Y + m] * jacobian[q, r + Y + m]
                    sums[m] += first + products[p, r + Z + m] * jacobian[q, r + Z + m]
            hessian[p, q] = sum_block(sums, 0)


@inner
def _solve(hessian, factor, gradient, free, out):  # type: ignore[no-untyped-def]
    """Solve for Newton's step of the free parameters, by a Cholesky factorisation."""
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
    """Update the dual variables after a step, and project them into their unit balls."""
    for block in range(rows.shape[1] // SLOT):
        for m in range(block * SLOT, block * SLOT + WIDTH):
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
def _minimise_model(  # type: ignore[no-untyped-def]
    values, frame, objective, threshold, bounds, fixed, tolerance, work, best
):
    """Minimise the linear model within the bounds, from the residuals of the start.

    The step is stored in the vectors, the residuals after it in the rows; the cost after it is
    returned. The last step is the one whose expected decrease is less than ``tolerance`` of the
    cost.
    """
    rows, jacobian, vectors = work.rows, work.jacobian, work.vectors
    gradient, newton = vectors[_GRADIENT], vectors[_NEWTON]
    start, trial = rows[_START], rows[_TRIAL]
    count, length = values.shape[0], rows.shape[1]
    for p in range(count):
        vectors[_STEP, p] = 0.0
    for i in range(length):
        rows[_HERE, i] = start[i]
    for step in range(_STEPS):
        kind = SQUARES if step == 0 and tolerance == _LOOSE else objective
        _compute_hessians(rows, work.hessians, frame, kind, threshold)
        _build_normal_equations(
            rows, work.hessians, jacobian, work.products, work.sums, gradient, work.hessian
        )
        for p in range(count):
            vectors[_TRIED, p] = values[p] + vectors[_STEP, p]
        gain = _compute_newton_step(vectors[_TRIED], bounds, fixed, work)
        portion, improved, now = 1.0, False, best
        for _ in range(_HALVINGS):
            for i in range(length):
                trial[i] = start[i]
            for p in range(count):
                value = values[p] + vectors[_STEP, p] + portion * newton[p]
                amount = min(max(value, bounds[p, 0]), bounds[p, 1]) - values[p]
                vectors[_TRIED, p] = amount
                d = jacobian[p]
                for i in range(length):
                    trial[i] += amount * d[i]
            now = cost(trial, frame, objective, threshold, work.sums)
            if now <= best:
                improved = True
                break
            portion *= 0.4
        if not improved:
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
def _compute_newton_step(values, bounds, fixed, work):  # type: ignore[no-untyped-def]
    """Compute Newton's step at ``values`` within the bounds; return the expected decrease."""
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
    """Store the trial point as the best point."""
    for p in range(start.shape[0]):
        start[p] = following[p]
    for block in range(rows.shape[1] // SLOT):
        for m in range(block * SLOT, block * SLOT + SLOT):
            rows[_START, m] = rows[_TRIAL, m]
            rows[_VIRTUAL, m] = rows[_TRIAL, m] + frame[block * WIDTH + m]


@compiled
def solve_frames(  # type: ignore[no-untyped-def]
    plan,
    numbers,
    workspace,
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
    """Minimise the cost of frame after frame, each from the result of the one before.

    Parameters
    ----------
    plan
        Integers of the packed binding.
    numbers
        Numbers of the packed binding.
    workspace
        Scratch memory of the kernel, ``(PackedBinding.workspace_size,)``.
    work
        Scratch memory of the solver, from `make_workspace`.
    frames
        Measured markers, ``(frames, blocks · 128)``, millimetres, from `pack_frames`.
    start
        Where the first frame starts, ``(parameters,)``, within the bounds; the last result
        afterwards.
    objective
        `kernel.DISTANCES`, `kernel.SQUARES` or `kernel.HUBER`.
    threshold
        Huber's threshold, millimetres.
    bounds
        Bounds of the parameters, ``(parameters, 2)``.
    fixed
        Which parameters keep their value from the frame before, ``(frames, parameters)``.
    tolerance
        A frame ends when the expected decrease is less than this part of its cost.
    values
        Filled with the results, ``(frames, parameters)``.
    costs
        Filled with the costs at them, ``(frames,)``.
    evaluations
        Filled with the numbers of evaluations of the virtual markers, ``(frames,)``.
    """
    rows, vectors = work.rows, work.vectors
    virtual, residuals, trial = rows[_VIRTUAL], rows[_START], rows[_TRIAL]
    following = vectors[_NEXT]
    length, count = rows.shape[1], start.shape[0]
    # Error of the linear model that is small enough: the remaining decrease is of the order of its
    # square.
    close = 0.03 * math.sqrt(tolerance)
    forward(plan, numbers, workspace, start, virtual)
    adjoint(plan, numbers, workspace, np.int64(3), work.jacobian)
    for f in range(frames.shape[0]):
        frame = frames[f]
        for block in range(length // SLOT):
            for m in range(block * SLOT, block * SLOT + SLOT):
                residuals[m] = virtual[m] - frame[block * WIDTH + m]
        for i in range(length):
            rows[_DUAL, i] = 0.0
        best = cost(residuals, frame, objective, threshold, work.sums)
        evaluations[f] = 0
        # The Jacobian is that of an earlier frame: near, but not here.
        exact = f == 0
        for _ in range(_ROUNDS):
            # A model that is not exact needs no exact minimum.
            enough = tolerance if exact else max(tolerance, _LOOSE)
            expected = _minimise_model(
                start, frame, objective, threshold, bounds, fixed[f], enough, work, best
            )
            portion, improved, now = 1.0, False, best
            for _ in range(_HALVINGS):
                for p in range(count):
                    following[p] = start[p] + portion * vectors[_STEP, p]
                forward(plan, numbers, workspace, following, trial)
                subtract(trial, frame)
                now = cost(trial, frame, objective, threshold, work.sums)
                evaluations[f] += 1
                if now <= best:
                    improved = True
                    break
                portion *= 0.5
            fall = best - now
            if improved:
                best = now
                _accept(rows, frame, start, following)
                as_expected = portion == 1.0 and abs(now - expected) <= close * best
                if exact and (as_expected or fall <= tolerance * best):
                    break
            elif exact:
                break
            if not improved:
                forward(plan, numbers, workspace, start, trial)
            adjoint(plan, numbers, workspace, np.int64(3), work.jacobian)
            exact = True
        costs[f] = best
        for p in range(count):
            values[f, p] = start[p]
