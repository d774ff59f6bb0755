"""The compiled kernel: virtual markers, cost, gradient and Jacobian of a frame.

One pass over a frame's markers, on the arrays of `packed_binding.py`, without Python objects and
without allocation. `Binding.evaluate` and `objective.cost` compute the same in plain numpy, and
the tests hold the two together.

Derivatives come from reverse-mode differentiation: `forward` computes the virtual markers, and
`adjoint` multiplies by the transposed Jacobian, through eq. 2 and the rig's operations in reverse
order. The derivative of the cost by the virtual markers gives the gradient; a unit vector along
x, y or z, the same for all markers at once, gives a row of each marker's Jacobian.

Vectorisation (SIMD): inner loops run over the markers of a block, whose coordinates lie a constant
distance apart, so that the compiler sees that they do not overlap and computes several markers
with one instruction. Sums over markers are added up by halves, which vectorises as well.

Arguments have the same names throughout: ``plan`` and ``numbers`` are those of `PackedBinding`;
``workspace`` is scratch memory, ``(PackedBinding.workspace_size,)``, one for every thread;
``rows`` are ``(blocks · 96,)``, the x, y and z of each block; ``frame`` is from `pack_frames`.
"""

from __future__ import annotations

import math
from typing import Any

import numba
import numpy as np

from mocap_fit.fitting.packed_binding import (
    BLOCKS,
    CENTRE,
    COORDINATES,
    GRADIENT,
    LINEAR,
    MARKER_SIZE,
    MARKERS,
    MATRICES,
    NORMAL,
    OPERATION,
    OPERATIONS,
    RING,
    ROTATION,
    SCALING,
    SCRATCH,
    SIZE,
    SLOT,
    TILT,
    UNIT,
    VERTICES,
    WEIGHTS,
    WIDTH,
    PackedBinding,
    Y,
    Z,
)
from mocap_fit.tracks import FloatArray

# No "fast math": what it reorders depends on where a function is compiled into, so that a run that
# compiles and one that finds its kernels in the cache would differ in the last bits.
_njit: Any = numba.njit
compiled: Any = _njit(cache=True, error_model="numpy", nogil=True)
# What only compiled functions call. Each of those holds a copy: it needs no place in the cache and
# no way in from Python, whose making takes a quarter of a first run.
inner: Any = _njit(error_model="numpy", nogil=True, no_cpython_wrapper=True, no_cfunc_wrapper=True)

DISTANCES, SQUARES, HUBER, JACOBIANS = 0, 1, 2, -1
# Numba compiles a function again for every number that is written out in a call.
_ONE, _THREE = np.int64(1), np.int64(3)
# Indices are unsigned, see `PackedBinding.plan`: a sum with a literal number would get a sign.
_unsigned: Any = np.uint32
# The sine's and the versine's series, in powers of the angle's square.
_SINE = tuple((-1.0) ** k / math.factorial(2 * k + 1) for k in range(8))
_VERSINE = tuple((-1.0) ** k / math.factorial(2 * k + 2) for k in range(8))


@inner
def sum_block(sums, k):  # type: ignore[no-untyped-def]  # numba infers the types
    """Return the sum of 32 numbers, which are overwritten.

    Parameters
    ----------
    sums
        Numbers, ``(numbers,)``.
    k
        Index of the first.

    Returns
    -------
    float
        Sum.
    """
    for m in range(WIDTH // 2):
        sums[k + m] += sums[k + WIDTH // 2 + m]
    for m in range(WIDTH // 4):
        sums[k + m] += sums[k + WIDTH // 4 + m]
    return ((sums[k] + sums[k + 1]) + (sums[k + 2] + sums[k + 3])) + (
        (sums[k + 4] + sums[k + 5]) + (sums[k + 6] + sums[k + 7])
    )


@inner
def _evaluate_series(x, c):  # type: ignore[no-untyped-def]
    """Evaluate a power series of eight coefficients."""
    high = ((c[7] * x + c[6]) * x + c[5]) * x + c[4]
    return (((high * x + c[3]) * x + c[2]) * x + c[1]) * x + c[0]


@inner
def _compute_amounts(plan, numbers, workspace, at, value):  # type: ignore[no-untyped-def]
    """Compute the amounts S and V of a turn for every slot."""
    weights, amounts = plan[at + 2] + WEIGHTS, plan[at + 3] + plan[SIZE]
    for vertex in range(plan[VERTICES]):
        w, s = _unsigned(weights + vertex * WIDTH), _unsigned(amounts + vertex * 2 * WIDTH)
        if plan[at] == ROTATION:
            for m in range(WIDTH):
                # Series of the quarter angle, doubled twice: calls of a library's sine do not
                # vectorise. Below pi the error is under 1e-14.
                quarter = 0.25 * value * numbers[w + m]
                square = quarter * quarter
                sine = quarter * _evaluate_series(square, _SINE)
                versine = square * _evaluate_series(square, _VERSINE)
                # Of twice the angle: versine 2 sin², sine 2 sin cos.
                double = 2.0 * sine * sine
                sine = 2.0 * sine * (1.0 - versine)
                workspace[s + m] = 2.0 * sine * (1.0 - double)
                workspace[s + WIDTH + m] = 2.0 * sine * sine
        else:
            for m in range(WIDTH):
                workspace[s + m] = value * numbers[w + m]
                workspace[s + WIDTH + m] = 0.0


@inner
def _turn(plan, numbers, workspace, at, x, along, across, c0, c1, c2):  # type: ignore[no-untyped-def]
    """Rotate or scale the slots at ``x`` about a centre.

    The matrices are read by rows, or by columns for the adjoint: ``along`` and ``across`` are the
    distances between a row's numbers and between rows.
    """
    amounts, scratch = plan[at + 3] + plan[SIZE], plan[SCRATCH]
    for axis in range(3):
        a = plan[at + 2] + MATRICES + axis * across
        a0, a1, a2 = numbers[a], numbers[a + along], numbers[a + 2 * along]
        b0, b1, b2 = numbers[a + 9], numbers[a + 9 + along], numbers[a + 9 + 2 * along]
        for vertex in range(plan[VERTICES]):
            d, s = _unsigned(x + vertex * SLOT), _unsigned(amounts + vertex * 2 * WIDTH)
            moved = _unsigned(scratch + vertex * SLOT + axis * WIDTH)
            for m in range(WIDTH):
                d0 = workspace[d + m] - c0
                d1 = workspace[d + Y + m] - c1
                d2 = workspace[d + Z + m] - c2
                spin, flat = a0 * d0 + a1 * d1 + a2 * d2, b0 * d0 + b1 * d1 + b2 * d2
                workspace[moved + m] = workspace[s + m] * spin + workspace[s + WIDTH + m] * flat
    for i in range(plan[SIZE]):
        workspace[x + i] += workspace[scratch + i]


@inner
def _differentiate_turn(plan, numbers, workspace, at, c0, c1, c2):  # type: ignore[no-untyped-def]
    """Differentiate the slots by the parameter: after a rotation, or before a scaling."""
    slopes, weights = plan[at + 3], plan[at + 2] + WEIGHTS
    for axis in range(3):
        a = plan[at + 2] + MATRICES + 3 * axis
        a0, a1, a2 = numbers[a], numbers[a + 1], numbers[a + 2]
        for vertex in range(plan[VERTICES]):
            d, w = _unsigned(vertex * SLOT), _unsigned(weights + vertex * WIDTH)
            slope = _unsigned(slopes + vertex * SLOT + axis * WIDTH)
            for m in range(WIDTH):
                d0 = workspace[d + m] - c0
                d1 = workspace[d + Y + m] - c1
                d2 = workspace[d + Z + m] - c2
                workspace[slope + m] = numbers[w + m] * (a0 * d0 + a1 * d1 + a2 * d2)


@inner
def forward(plan, numbers, workspace, values, rows):  # type: ignore[no-untyped-def]
    """Compute the virtual markers: move the slots, then apply eq. 2 of Beskow.

    Parameters
    ----------
    plan
        Integers of the packed binding.
    numbers
        Numbers of the packed binding.
    workspace
        Scratch memory; holds the moved slots and their derivatives afterwards.
    values
        Parameters, ``(parameters,)``.
    rows
        Filled with the virtual markers, ``(blocks · 96,)``, millimetres.
    """
    size, ring = plan[SIZE], plan[RING]
    for i in range(size):
        workspace[i] = numbers[i]
    for operation in range(plan[OPERATIONS]):
        at = OPERATION + 4 * operation
        value, start = values[plan[at + 1]], plan[at + 2]
        if plan[at] == LINEAR:
            for i in range(size):
                workspace[i] += value * numbers[start + i]
        else:
            _compute_amounts(plan, numbers, workspace, at, value)
            c = start + CENTRE
            c0, c1, c2 = numbers[c], numbers[c + 1], numbers[c + 2]
            if plan[at] == SCALING:
                _differentiate_turn(plan, numbers, workspace, at, c0, c1, c2)
            _turn(plan, numbers, workspace, at, np.uint32(0), _ONE, _THREE, c0, c1, c2)
            if plan[at] == ROTATION:
                _differentiate_turn(plan, numbers, workspace, at, c0, c1, c2)
    for block in range(plan[BLOCKS]):
        o, k = _unsigned(block * (ring + 1) * SLOT), _unsigned(plan[MARKERS] + block * MARKER_SIZE)
        uvw, row = _unsigned(plan[COORDINATES] + block * SLOT), _unsigned(block * SLOT)
        for m in range(SLOT):
            workspace[k + NORMAL + m] = 0.0
        for j in range(ring):
            p = _unsigned(o + (j + 1) * SLOT)
            q = _unsigned(o + SLOT if j == ring - 1 else p + SLOT)
            for m in range(WIDTH):
                # The ring is closed: seen from anywhere, its triangles add up to the same.
                p0, p1, p2 = workspace[p + m], workspace[p + Y + m], workspace[p + Z + m]
                q0, q1, q2 = workspace[q + m], workspace[q + Y + m], workspace[q + Z + m]
                workspace[k + NORMAL + m] += p1 * q2 - p2 * q1
                workspace[k + NORMAL + Y + m] += p2 * q0 - p0 * q2
                workspace[k + NORMAL + Z + m] += p0 * q1 - p1 * q0
        for m in range(WIDTH):
            n0, n1, n2 = workspace[k + m], workspace[k + Y + m], workspace[k + Z + m]
            inverse = 1.0 / math.sqrt(n0 * n0 + n1 * n1 + n2 * n2)
            workspace[k + TILT + m] = numbers[uvw + Z + m] * inverse
            workspace[k + UNIT + m] = n0 * inverse
            workspace[k + UNIT + Y + m] = n1 * inverse
            workspace[k + UNIT + Z + m] = n2 * inverse
        for axis in range(3):
            a, n = _unsigned(o + axis * WIDTH), _unsigned(k + UNIT + axis * WIDTH)
            along = _unsigned(row + axis * WIDTH)
            for m in range(WIDTH):
                s, t, u = numbers[uvw + m], numbers[uvw + Y + m], numbers[uvw + Z + m]
                corners = s * workspace[a + SLOT + m] + t * workspace[a + 2 * SLOT + m]
                rows[along + m] = (1.0 - s - t) * workspace[a + m] + corners + u * workspace[n + m]


@inner
def subtract(rows, frame):  # type: ignore[no-untyped-def]
    """Subtract the measured markers from the virtual ones: residuals.

    Parameters
    ----------
    rows
        Virtual markers, ``(blocks · 96,)``, millimetres; residuals afterwards.
    frame
        Measured markers, ``(blocks · 128,)``, from `pack_frames`.
    """
    for block in range(rows.shape[0] // SLOT):
        for m in range(SLOT):
            rows[block * SLOT + m] -= frame[block * 4 * WIDTH + m]


@inner
def cost(rows, frame, objective, threshold, sums):  # type: ignore[no-untyped-def]
    """Return the cost of residuals, as `objective.cost` defines it.

    Parameters
    ----------
    rows
        Residuals, ``(blocks · 96,)``, millimetres.
    frame
        Measured markers and weights, ``(blocks · 128,)``, from `pack_frames`.
    objective
        `DISTANCES`, `SQUARES` or `HUBER`.
    threshold
        Huber's threshold, millimetres.
    sums
        Scratch memory, ``(32,)``.

    Returns
    -------
    float
        Cost.
    """
    # Distances are Huber's with the straight part alone, squares with the other.
    straight = 1.0 if objective == DISTANCES else 2.0 * threshold
    offset = threshold * threshold if objective == HUBER else 0.0
    knee = -1.0 if objective == DISTANCES else threshold
    if objective == SQUARES:
        knee = np.inf
    for m in range(WIDTH):
        sums[m] = 0.0
    for block in range(rows.shape[0] // SLOT):
        r, w = block * SLOT, block * 4 * WIDTH + SLOT
        for m in range(WIDTH):
            r0, r1, r2 = rows[r + m], rows[r + Y + m], rows[r + Z + m]
            square = r0 * r0 + r1 * r1 + r2 * r2
            distance = math.sqrt(square)
            far = straight * distance - offset
            sums[m] += frame[w + m] * (far if distance > knee else square)
    return sum_block(sums, 0)


@inner
def _gradient(plan, workspace, rows, frame, objective, threshold):  # type: ignore[no-untyped-def]
    """Store the gradient of the cost with respect to the virtual markers."""
    straight = 1.0 if objective == DISTANCES else 2.0 * threshold
    knee = -1.0 if objective == DISTANCES else threshold
    if objective == SQUARES:
        knee = np.inf
    for block in range(plan[BLOCKS]):
        r, w = block * SLOT, block * 4 * WIDTH + SLOT
        k = plan[MARKERS] + block * MARKER_SIZE + GRADIENT
        for m in range(WIDTH):
            r0, r1, r2 = rows[r + m], rows[r + Y + m], rows[r + Z + m]
            distance = math.sqrt(r0 * r0 + r1 * r1 + r2 * r2)
            far = straight / max(distance, 1e-12)
            slope = frame[w + m] * (far if distance > knee else 2.0)
            workspace[k + m] = slope * r0
            workspace[k + Y + m] = slope * r1
            workspace[k + Z + m] = slope * r2


@inner
def adjoint(plan, numbers, workspace, axes, out):  # type: ignore[no-untyped-def]
    """Multiply by the transposed Jacobian of the virtual markers, after `forward`.

    Parameters
    ----------
    plan
        Integers of the packed binding.
    numbers
        Numbers of the packed binding.
    workspace
        Scratch memory, as `forward` left it.
    axes
        3: unit vectors along x, y and z are multiplied, which gives the Jacobian; 1: the gradient
        that `_gradient` stored is.
    out
        Filled with the product of each marker, ``(parameters, blocks · 96)``; with one axis, in
        the first 32 of a block's 96 numbers.
    """
    blocks, size, ring = plan[BLOCKS], plan[SIZE], plan[RING]
    for p in range(out.shape[0]):
        for i in range(out.shape[1]):
            out[p, i] = 0.0
    for axis in range(axes):
        for block in range(blocks):
            o = _unsigned(block * (ring + 1) * SLOT)
            k = _unsigned(plan[MARKERS] + block * MARKER_SIZE)
            uvw = _unsigned(plan[COORDINATES] + block * SLOT)
            if axes == 3:
                for m in range(SLOT):
                    workspace[k + GRADIENT + m] = 0.0
                for m in range(WIDTH):
                    workspace[k + GRADIENT + axis * WIDTH + m] = 1.0
            # The derivative by the normal, through its division by its length, replaces it.
            for m in range(WIDTH):
                n0, n1 = workspace[k + UNIT + m], workspace[k + UNIT + Y + m]
                n2, tilt = workspace[k + UNIT + Z + m], workspace[k + TILT + m]
                g0 = workspace[k + GRADIENT + m]
                g1 = workspace[k + GRADIENT + Y + m]
                g2 = workspace[k + GRADIENT + Z + m]
                along = n0 * g0 + n1 * g1 + n2 * g2
                workspace[k + m] = tilt * (g0 - along * n0)
                workspace[k + Y + m] = tilt * (g1 - along * n1)
                workspace[k + Z + m] = tilt * (g2 - along * n2)
            for j in range(ring):
                p, g = _unsigned(o + (j + 1) * SLOT), _unsigned(size + o + (j + 1) * SLOT)
                after = _unsigned(o + SLOT if j == ring - 1 else p + SLOT)
                before = _unsigned(o + (ring if j == 0 else j) * SLOT)
                for m in range(WIDTH):
                    e0 = workspace[after + m] - workspace[before + m]
                    e1 = workspace[after + Y + m] - workspace[before + Y + m]
                    e2 = workspace[after + Z + m] - workspace[before + Z + m]
                    h0, h1, h2 = workspace[k + m], workspace[k + Y + m], workspace[k + Z + m]
                    workspace[g + m] = e1 * h2 - e2 * h1
                    workspace[g + Y + m] = e2 * h0 - e0 * h2
                    workspace[g + Z + m] = e0 * h1 - e1 * h0
            for along in range(3):
                g = _unsigned(size + o + along * WIDTH)
                source = _unsigned(k + GRADIENT + along * WIDTH)
                for m in range(WIDTH):
                    gradient = workspace[source + m]
                    s, t = numbers[uvw + m], numbers[uvw + Y + m]
                    workspace[g + m] = (1.0 - s - t) * gradient
                    workspace[g + SLOT + m] += s * gradient
                    workspace[g + 2 * SLOT + m] += t * gradient
        for operation in range(plan[OPERATIONS] - 1, -1, -1):
            at = OPERATION + 4 * operation
            if plan[at] == LINEAR:
                _accumulate(plan, workspace, numbers, plan[at + 2], out[plan[at + 1]], axis * WIDTH)
            else:
                _accumulate(
                    plan, workspace, workspace, plan[at + 3], out[plan[at + 1]], axis * WIDTH
                )
                _turn(plan, numbers, workspace, at, plan[SIZE], _THREE, _ONE, 0.0, 0.0, 0.0)


@inner
def _accumulate(plan, workspace, field, start, out, offset):  # type: ignore[no-untyped-def]
    """Add the product of the slots' adjoint and a field, marker by marker."""
    slots = plan[RING] + 1
    for block in range(plan[BLOCKS]):
        k = _unsigned(block * SLOT + offset)
        for slot in range(slots):
            i = (block * slots + slot) * SLOT
            g, f = _unsigned(plan[SIZE] + i), _unsigned(start + i)
            for m in range(WIDTH):
                product = workspace[g + m] * field[f + m] + workspace[g + Y + m] * field[f + Y + m]
                out[k + m] += product + workspace[g + Z + m] * field[f + Z + m]


@compiled
def evaluate(plan, numbers, workspace, values, frame, objective, threshold, rows, products, out):  # type: ignore[no-untyped-def]
    """Compute virtual markers and Jacobians at points, or the cost at one with its gradient.

    Parameters
    ----------
    plan
        Integers of the packed binding.
    numbers
        Numbers of the packed binding.
    workspace
        Scratch memory.
    values
        Parameters, ``(points, parameters)``.
    frame
        Measured markers, ``(blocks · 128,)``, from `pack_frames`; not read for `JACOBIANS`.
    objective
        `DISTANCES`, `SQUARES` or `HUBER`; `JACOBIANS` for virtual markers alone.
    threshold
        Huber's threshold, millimetres.
    rows
        Filled with virtual markers, or residuals, ``(points, blocks · 96)``, millimetres.
    products
        Filled with the Jacobians, ``(points, parameters, blocks · 96)``, or scratch memory.
    out
        Filled with the gradient of the cost, ``(parameters,)``.

    Returns
    -------
    float
        Cost at the last point.
    """
    value = 0.0
    for point in range(values.shape[0]):
        row, product = rows[point], products[point]
        forward(plan, numbers, workspace, values[point], row)
        if objective != JACOBIANS:
            subtract(row, frame)
            value = cost(row, frame, objective, threshold, product[0])
            _gradient(plan, workspace, row, frame, objective, threshold)
        adjoint(plan, numbers, workspace, 3 if objective == JACOBIANS else 1, product)
        if objective != JACOBIANS:
            for p in range(out.shape[0]):
                for block in range(1, plan[BLOCKS]):
                    for m in range(WIDTH):
                        product[p, m] += product[p, block * SLOT + m]
                out[p] = sum_block(product[p], 0)
    return value


def evaluate_frames(
    packed: PackedBinding, values: FloatArray, count: int
) -> tuple[FloatArray, FloatArray]:
    """Compute the virtual markers of many frames, and their Jacobians.

    Parameters
    ----------
    packed
        Packed binding.
    values
        Parameters, ``(frames, parameters)``; 0 is rest, 1 the full gesture.
    count
        Number of markers.

    Returns
    -------
    positions : ndarray
        Virtual markers, ``(frames, markers, 3)``, millimetres.
    jacobian : ndarray
        Their derivatives, ``(frames, markers, 3, parameters)``, millimetres per unit.
    """
    frames, blocks, parameters = len(values), packed.blocks, packed.parameters
    rows = np.empty((frames, blocks * SLOT))
    products = np.empty((frames, parameters, blocks * SLOT))
    workspace = np.zeros(packed.workspace_size)
    values = np.ascontiguousarray(values)
    plan, numbers, nothing = packed.plan, packed.numbers, np.zeros(0)
    evaluate(plan, numbers, workspace, values, nothing, JACOBIANS, 0.0, rows, products, nothing)
    positions = rows.reshape(frames, blocks, 3, WIDTH).transpose(0, 1, 3, 2)
    jacobians = products.reshape(frames, parameters, blocks, 3, WIDTH).transpose(0, 2, 4, 3, 1)
    return (
        positions.reshape(frames, -1, 3)[:, :count],
        jacobians.reshape(frames, -1, 3, parameters)[:, :count],
    )
