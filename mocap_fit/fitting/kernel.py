"""The compiled kernel: virtual markers, cost, gradient and Jacobian of a frame.

One pass over a frame's markers, on the arrays of `slots.py`, without Python objects and without
allocation. `Binding.evaluate` and `objective.cost` say the same in plain numpy, and the tests
hold the two together.

Derivatives are found backwards: what pulls at a virtual marker is brought to its slots, and back
through the rig's operations. With the cost's own pull that is the gradient; with a unit pull along
x, y or z, the same for all markers at once, it is a row of each marker's Jacobian.

Inner loops run over the markers of a block, whose coordinates are a constant distance apart: the
compiler then sees that they do not overlap, and takes several markers side by side. Sums over
markers are added up by halves, which it can do side by side as well.

Arguments are the same throughout: ``plan`` and ``numbers`` are those of `Slots`, ``room`` is
where the kernel works, `(Slots.room,)`, one for every thread; ``rows`` are `(blocks · 96,)`, of
each block x, y and z; ``frame`` is from `pack_frames`.
"""

from __future__ import annotations

import math
from typing import Any

import numba
import numpy as np

from mocap_fit.fitting.slots import (
    BLOCKS,
    CENTRE,
    COORDINATES,
    KEPT,
    LANES,
    LINEAR,
    MARKERS,
    MATRICES,
    NORMAL,
    OPERATION,
    OPERATIONS,
    PULL,
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
    Slots,
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

DISTANCES, SQUARES, HUBER, SLOPES = 0, 1, 2, -1
# Numba compiles a function again for every number that is written out in a call.
_ONE, _THREE = np.int64(1), np.int64(3)
# Places are kept without a sign, see `Slots.plan`: sums with numbers that are written out get one.
_place: Any = np.uint32
# The sine's and the versine's series, in powers of the angle's square.
_SINE = tuple((-1.0) ** k / math.factorial(2 * k + 1) for k in range(8))
_VERSINE = tuple((-1.0) ** k / math.factorial(2 * k + 2) for k in range(8))


@inner
def sum_of_lanes(lanes, k):  # type: ignore[no-untyped-def]  # numba infers the types
    """Sum of 32 numbers from the k-th on, which it overwrites."""
    for m in range(LANES // 2):
        lanes[k + m] += lanes[k + LANES // 2 + m]
    for m in range(LANES // 4):
        lanes[k + m] += lanes[k + LANES // 4 + m]
    return ((lanes[k] + lanes[k + 1]) + (lanes[k + 2] + lanes[k + 3])) + (
        (lanes[k + 4] + lanes[k + 5]) + (lanes[k + 6] + lanes[k + 7])
    )


@inner
def _series(x, c):  # type: ignore[no-untyped-def]
    high = ((c[7] * x + c[6]) * x + c[5]) * x + c[4]
    return (((high * x + c[3]) * x + c[2]) * x + c[1]) * x + c[0]


@inner
def _amounts(plan, numbers, room, at, value):  # type: ignore[no-untyped-def]
    """S and V of every slot."""
    weights, amounts = plan[at + 2] + WEIGHTS, plan[at + 3] + plan[SIZE]
    for vertex in range(plan[VERTICES]):
        w, s = _place(weights + vertex * LANES), _place(amounts + vertex * 2 * LANES)
        if plan[at] == ROTATION:
            for m in range(LANES):
                # Series of the quarter angle, doubled twice: loops over a library's sine do not
                # run side by side. Below pi the error is under 1e-14.
                quarter = 0.25 * value * numbers[w + m]
                square = quarter * quarter
                sine = quarter * _series(square, _SINE)
                versine = square * _series(square, _VERSINE)
                # Of twice the angle: versine 2 sin², sine 2 sin cos.
                double = 2.0 * sine * sine
                sine = 2.0 * sine * (1.0 - versine)
                room[s + m] = 2.0 * sine * (1.0 - double)
                room[s + LANES + m] = 2.0 * sine * sine
        else:
            for m in range(LANES):
                room[s + m] = value * numbers[w + m]
                room[s + LANES + m] = 0.0


@inner
def _turn(plan, numbers, room, at, x, along, across, c0, c1, c2):  # type: ignore[no-untyped-def]
    """Turn or scale what begins at ``x`` about a centre.

    The matrices are read by rows, or by columns for the adjoint: ``along`` and ``across`` are how
    far apart a row's numbers and the rows are.
    """
    amounts, scratch = plan[at + 3] + plan[SIZE], plan[SCRATCH]
    for axis in range(3):
        a = plan[at + 2] + MATRICES + axis * across
        a0, a1, a2 = numbers[a], numbers[a + along], numbers[a + 2 * along]
        b0, b1, b2 = numbers[a + 9], numbers[a + 9 + along], numbers[a + 9 + 2 * along]
        for vertex in range(plan[VERTICES]):
            d, s = _place(x + vertex * SLOT), _place(amounts + vertex * 2 * LANES)
            moved = _place(scratch + vertex * SLOT + axis * LANES)
            for m in range(LANES):
                d0, d1, d2 = room[d + m] - c0, room[d + Y + m] - c1, room[d + Z + m] - c2
                spin, flat = a0 * d0 + a1 * d1 + a2 * d2, b0 * d0 + b1 * d1 + b2 * d2
                room[moved + m] = room[s + m] * spin + room[s + LANES + m] * flat
    for i in range(plan[SIZE]):
        room[x + i] += room[scratch + i]


@inner
def _slope(plan, numbers, room, at, c0, c1, c2):  # type: ignore[no-untyped-def]
    """Derivative of the slots by the turn's parameter: after a rotation, or before a scaling."""
    slopes, weights = plan[at + 3], plan[at + 2] + WEIGHTS
    for axis in range(3):
        a = plan[at + 2] + MATRICES + 3 * axis
        a0, a1, a2 = numbers[a], numbers[a + 1], numbers[a + 2]
        for vertex in range(plan[VERTICES]):
            d, w = _place(vertex * SLOT), _place(weights + vertex * LANES)
            slope = _place(slopes + vertex * SLOT + axis * LANES)
            for m in range(LANES):
                d0, d1, d2 = room[d + m] - c0, room[d + Y + m] - c1, room[d + Z + m] - c2
                room[slope + m] = numbers[w + m] * (a0 * d0 + a1 * d1 + a2 * d2)


@inner
def place(plan, numbers, room, values, rows):  # type: ignore[no-untyped-def]
    """Move the slots, and put the virtual markers into ``rows`` (eq. 2 of Beskow)."""
    size, ring = plan[SIZE], plan[RING]
    for i in range(size):
        room[i] = numbers[i]
    for operation in range(plan[OPERATIONS]):
        at = OPERATION + 4 * operation
        value, given = values[plan[at + 1]], plan[at + 2]
        if plan[at] == LINEAR:
            for i in range(size):
                room[i] += value * numbers[given + i]
        else:
            _amounts(plan, numbers, room, at, value)
            c = given + CENTRE
            c0, c1, c2 = numbers[c], numbers[c + 1], numbers[c + 2]
            if plan[at] == SCALING:
                _slope(plan, numbers, room, at, c0, c1, c2)
            _turn(plan, numbers, room, at, np.uint32(0), _ONE, _THREE, c0, c1, c2)
            if plan[at] == ROTATION:
                _slope(plan, numbers, room, at, c0, c1, c2)
    for block in range(plan[BLOCKS]):
        o, k = _place(block * (ring + 1) * SLOT), _place(plan[MARKERS] + block * KEPT)
        uvw, row = _place(plan[COORDINATES] + block * SLOT), _place(block * SLOT)
        for m in range(SLOT):
            room[k + NORMAL + m] = 0.0
        for j in range(ring):
            p = _place(o + (j + 1) * SLOT)
            q = _place(o + SLOT if j == ring - 1 else p + SLOT)
            for m in range(LANES):
                # The ring is closed: seen from anywhere, its triangles add up to the same.
                p0, p1, p2 = room[p + m], room[p + Y + m], room[p + Z + m]
                q0, q1, q2 = room[q + m], room[q + Y + m], room[q + Z + m]
                room[k + NORMAL + m] += p1 * q2 - p2 * q1
                room[k + NORMAL + Y + m] += p2 * q0 - p0 * q2
                room[k + NORMAL + Z + m] += p0 * q1 - p1 * q0
        for m in range(LANES):
            n0, n1, n2 = room[k + m], room[k + Y + m], room[k + Z + m]
            inverse = 1.0 / math.sqrt(n0 * n0 + n1 * n1 + n2 * n2)
            room[k + TILT + m] = numbers[uvw + Z + m] * inverse
            room[k + UNIT + m] = n0 * inverse
            room[k + UNIT + Y + m] = n1 * inverse
            room[k + UNIT + Z + m] = n2 * inverse
        for axis in range(3):
            a, n = _place(o + axis * LANES), _place(k + UNIT + axis * LANES)
            along = _place(row + axis * LANES)
            for m in range(LANES):
                s, t, u = numbers[uvw + m], numbers[uvw + Y + m], numbers[uvw + Z + m]
                corners = s * room[a + SLOT + m] + t * room[a + 2 * SLOT + m]
                rows[along + m] = (1.0 - s - t) * room[a + m] + corners + u * room[n + m]


@inner
def subtract(rows, frame):  # type: ignore[no-untyped-def]
    """Virtual markers → residuals."""
    for block in range(rows.shape[0] // SLOT):
        for m in range(SLOT):
            rows[block * SLOT + m] -= frame[block * 4 * LANES + m]


@inner
def misfit(rows, frame, objective, threshold, lanes):  # type: ignore[no-untyped-def]
    """Cost of residuals, `(blocks · 96,)`; `objective.cost` says what is what.

    ``lanes``, `(32,)`, is to work in.
    """
    # Distances are Huber's with the straight part alone, squares with the other.
    straight = 1.0 if objective == DISTANCES else 2.0 * threshold
    offset = threshold * threshold if objective == HUBER else 0.0
    knee = -1.0 if objective == DISTANCES else threshold
    if objective == SQUARES:
        knee = np.inf
    for m in range(LANES):
        lanes[m] = 0.0
    for block in range(rows.shape[0] // SLOT):
        r, w = block * SLOT, block * 4 * LANES + SLOT
        for m in range(LANES):
            r0, r1, r2 = rows[r + m], rows[r + Y + m], rows[r + Z + m]
            square = r0 * r0 + r1 * r1 + r2 * r2
            distance = math.sqrt(square)
            far = straight * distance - offset
            lanes[m] += frame[w + m] * (far if distance > knee else square)
    return sum_of_lanes(lanes, 0)


@inner
def _pull(plan, room, rows, frame, objective, threshold):  # type: ignore[no-untyped-def]
    """Derivative of the cost by the virtual markers."""
    straight = 1.0 if objective == DISTANCES else 2.0 * threshold
    knee = -1.0 if objective == DISTANCES else threshold
    if objective == SQUARES:
        knee = np.inf
    for block in range(plan[BLOCKS]):
        r, w = block * SLOT, block * 4 * LANES + SLOT
        k = plan[MARKERS] + block * KEPT + PULL
        for m in range(LANES):
            r0, r1, r2 = rows[r + m], rows[r + Y + m], rows[r + Z + m]
            distance = math.sqrt(r0 * r0 + r1 * r1 + r2 * r2)
            far = straight / max(distance, 1e-12)
            slope = frame[w + m] * (far if distance > knee else 2.0)
            room[k + m] = slope * r0
            room[k + Y + m] = slope * r1
            room[k + Z + m] = slope * r2


@inner
def back(plan, numbers, room, axes, out):  # type: ignore[no-untyped-def]
    """Bring what pulls at the virtual markers back to the parameters, after `place`.

    ``out``, `(parameters, blocks · 96)`, is filled with each marker's share: with three ``axes``
    the slopes of the virtual markers, by a unit pull along x, y and z in turn; with one what the
    pulls of `_pull` make, on the first 32 of a block's 96.
    """
    blocks, size, ring = plan[BLOCKS], plan[SIZE], plan[RING]
    for p in range(out.shape[0]):
        for i in range(out.shape[1]):
            out[p, i] = 0.0
    for axis in range(axes):
        for block in range(blocks):
            o, k = _place(block * (ring + 1) * SLOT), _place(plan[MARKERS] + block * KEPT)
            uvw = _place(plan[COORDINATES] + block * SLOT)
            if axes == 3:
                for m in range(SLOT):
                    room[k + PULL + m] = 0.0
                for m in range(LANES):
                    room[k + PULL + axis * LANES + m] = 1.0
            # What pulls at the normal, brought through its unit length, takes the normal's place.
            for m in range(LANES):
                n0, n1 = room[k + UNIT + m], room[k + UNIT + Y + m]
                n2, tilt = room[k + UNIT + Z + m], room[k + TILT + m]
                p0, p1, p2 = room[k + PULL + m], room[k + PULL + Y + m], room[k + PULL + Z + m]
                along = n0 * p0 + n1 * p1 + n2 * p2
                room[k + m] = tilt * (p0 - along * n0)
                room[k + Y + m] = tilt * (p1 - along * n1)
                room[k + Z + m] = tilt * (p2 - along * n2)
            for j in range(ring):
                p, g = _place(o + (j + 1) * SLOT), _place(size + o + (j + 1) * SLOT)
                after = _place(o + SLOT if j == ring - 1 else p + SLOT)
                before = _place(o + (ring if j == 0 else j) * SLOT)
                for m in range(LANES):
                    e0, e1 = room[after + m] - room[before + m], room[after + Y + m]
                    e1, e2 = e1 - room[before + Y + m], room[after + Z + m] - room[before + Z + m]
                    h0, h1, h2 = room[k + m], room[k + Y + m], room[k + Z + m]
                    room[g + m] = e1 * h2 - e2 * h1
                    room[g + Y + m] = e2 * h0 - e0 * h2
                    room[g + Z + m] = e0 * h1 - e1 * h0
            for along in range(3):
                g, pulls = _place(size + o + along * LANES), _place(k + PULL + along * LANES)
                for m in range(LANES):
                    pull = room[pulls + m]
                    s, t = numbers[uvw + m], numbers[uvw + Y + m]
                    room[g + m] = (1.0 - s - t) * pull
                    room[g + SLOT + m] += s * pull
                    room[g + 2 * SLOT + m] += t * pull
        for operation in range(plan[OPERATIONS] - 1, -1, -1):
            at = OPERATION + 4 * operation
            if plan[at] == LINEAR:
                _share(plan, room, numbers, plan[at + 2], out[plan[at + 1]], axis * LANES)
            else:
                _share(plan, room, room, plan[at + 3], out[plan[at + 1]], axis * LANES)
                _turn(plan, numbers, room, at, plan[SIZE], _THREE, _ONE, 0.0, 0.0, 0.0)


@inner
def _share(plan, room, field, start, out, lane):  # type: ignore[no-untyped-def]
    """Add what the adjoint has of a field, marker by marker."""
    slots = plan[RING] + 1
    for block in range(plan[BLOCKS]):
        k = _place(block * SLOT + lane)
        for slot in range(slots):
            i = (block * slots + slot) * SLOT
            g, f = _place(plan[SIZE] + i), _place(start + i)
            for m in range(LANES):
                share = room[g + m] * field[f + m] + room[g + Y + m] * field[f + Y + m]
                out[k + m] += share + room[g + Z + m] * field[f + Z + m]


@compiled
def evaluate(plan, numbers, room, values, frame, objective, threshold, rows, shares, out):  # type: ignore[no-untyped-def]
    """Virtual markers at some points with their slopes, or the cost at one with its gradient.

    Parameters
    ----------
    plan, numbers, room
        See above.
    values
        `(points, parameters)`.
    frame, objective, threshold
        The measured markers, from `pack_frames`, and what of them is minimised; or with an
        objective of `SLOPES` none.
    rows
        `(points, blocks · 96)`, filled: virtual markers, or residuals.
    shares
        `(points, parameters, blocks · 96)`, filled: slopes of the virtual markers, or to work in.
    out
        `(parameters,)`, filled: the gradient.

    Returns
    -------
    float
        The cost.
    """
    value = 0.0
    for point in range(values.shape[0]):
        row, share = rows[point], shares[point]
        place(plan, numbers, room, values[point], row)
        if objective != SLOPES:
            subtract(row, frame)
            value = misfit(row, frame, objective, threshold, share[0])
            _pull(plan, room, row, frame, objective, threshold)
        back(plan, numbers, room, 3 if objective == SLOPES else 1, share)
        if objective != SLOPES:
            for p in range(out.shape[0]):
                for block in range(1, plan[BLOCKS]):
                    for m in range(LANES):
                        share[p, m] += share[p, block * SLOT + m]
                out[p] = sum_of_lanes(share[p], 0)
    return value


def markers_of_frames(
    slots: Slots, values: FloatArray, count: int
) -> tuple[FloatArray, FloatArray]:
    """Virtual markers of many frames, and their derivatives.

    Parameters
    ----------
    slots
        The packed binding.
    values
        `(frames, parameters)`.
    count
        Number of markers.

    Returns
    -------
    positions
        `(frames, markers, 3)`.
    jacobian
        `(frames, markers, 3, parameters)`.
    """
    frames, blocks, parameters = len(values), slots.blocks, slots.parameters
    rows = np.empty((frames, blocks * SLOT))
    slopes = np.empty((frames, parameters, blocks * SLOT))
    room = np.zeros(slots.room)
    values = np.ascontiguousarray(values)
    evaluate(
        slots.plan,
        slots.numbers,
        room,
        values,
        np.zeros(0),
        SLOPES,
        0.0,
        rows,
        slopes,
        np.zeros(0),
    )
    positions = rows.reshape(frames, blocks, 3, LANES).transpose(0, 1, 3, 2)
    jacobians = slopes.reshape(frames, parameters, blocks, 3, LANES).transpose(0, 2, 4, 3, 1)
    return (
        positions.reshape(frames, -1, 3)[:, :count],
        jacobians.reshape(frames, -1, 3, parameters)[:, :count],
    )
