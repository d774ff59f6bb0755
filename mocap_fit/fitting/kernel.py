"""The compiled kernel: virtual markers, cost, gradient and Jacobian of a frame.

One pass over a frame's markers, on the arrays of `slots.py`, without Python objects and without
allocation. `Binding.evaluate` and `objective.cost` say the same in plain numpy, and the tests
hold the two together.

Inner loops run over the markers of a block, whose coordinates are a constant distance apart: the
compiler then sees that they do not overlap, and takes several markers side by side.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numba
import numpy as np

from mocap_fit.fitting.slots import LANES, LINEAR, ROTATION, Slots
from mocap_fit.tracks import FloatArray

# No "fast math": what it reorders depends on where a function is compiled into, so that a run that
# compiles and one that finds its kernels in the cache would differ in the last bits.
compiled: Any = numba.njit(cache=True, error_model="numpy", nogil=True)

DISTANCES, SQUARES, HUBER = 0, 1, 2


class Room(NamedTuple):
    """Where the kernel works; one for every thread.

    Parameters
    ----------
    x
        `(size,)`: the slots.
    kept
        `(turns, size)`: the slots after each rotation, and before each scaling.
    angles
        `(turns, blocks · slots · 64)`: sine and versine (one minus the cosine) of each rotation.
    markers
        `(blocks · 448,)`: of each block the normal before it has unit length (3), the unit
        normal (3), u over the normal's length, the virtual less the measured marker (3), its
        length, and the derivative of the cost by it (3).
    adjoint
        `(size,)`: derivative of the cost by the slots.
    slopes
        `(parameters, size)`: derivative of the slots.
    jacobian
        `(parameters, blocks · 96)`: derivative of the virtual markers.
    """

    x: FloatArray
    kept: FloatArray
    angles: FloatArray
    markers: FloatArray
    adjoint: FloatArray
    slopes: FloatArray
    jacobian: FloatArray


def make_room(slots: Slots) -> Room:
    """Room for a packed binding."""
    size, turns = len(slots.rest), len(slots.turn_parameters)
    return Room(
        np.empty(size),
        np.empty((turns, size)),
        np.empty((turns, slots.blocks * slots.slots * 2 * LANES)),
        np.empty(slots.blocks * PER_BLOCK),
        np.empty(size),
        np.zeros((slots.parameters, size)),
        np.empty((slots.parameters, slots.blocks * 3 * LANES)),
    )


# Where the rows of a block are in `Room.markers`.
_NORMAL, UNIT, TILT, RESIDUAL, DISTANCE, _PULL = (
    0,
    3 * LANES,
    6 * LANES,
    7 * LANES,
    10 * LANES,
    11 * LANES,
)
PER_BLOCK = 14 * LANES
# From the x of a slot to its y, its z, and the next slot.
Y, Z, SLOT = LANES, 2 * LANES, 3 * LANES


@compiled
def _turn(a, room, turn, value):  # type: ignore[no-untyped-def]  # numba infers the types
    """Rotate all slots, and keep what the derivatives need."""
    x, angles, weights = room.x, room.angles[turn], a.turn_weights[turn]
    v0, v1, v2 = a.turn_vectors[turn, 0], a.turn_vectors[turn, 1], a.turn_vectors[turn, 2]
    c0, c1, c2 = a.turn_centres[turn, 0], a.turn_centres[turn, 1], a.turn_centres[turn, 2]
    length = math.sqrt(v0 * v0 + v1 * v1 + v2 * v2)
    a0, a1, a2 = v0 / length, v1 / length, v2 / length
    quarter = 0.25 * value * length
    for vertex in range(a.blocks * a.slots):
        row, base, angle = vertex * LANES, vertex * SLOT, vertex * 2 * LANES
        for m in range(LANES):
            # Series of the quarter angle, doubled twice: loops over a library's sine do not run
            # side by side. Below pi the error is under 1e-14.
            q = quarter * weights[row + m]
            s = q * q
            sine = q * (
                1
                + s
                * (
                    -1 / 6
                    + s
                    * (
                        1 / 120
                        + s
                        * (
                            -1 / 5040
                            + s
                            * (
                                1 / 362880
                                + s * (-1 / 39916800 + s * (1 / 6227020800 - s / 1307674368000))
                            )
                        )
                    )
                )
            )
            versine = s * (
                0.5
                + s
                * (
                    -1 / 24
                    + s
                    * (
                        1 / 720
                        + s
                        * (
                            -1 / 40320
                            + s
                            * (
                                1 / 3628800
                                + s * (-1 / 479001600 + s * (1 / 87178291200 - s / 20922789888000))
                            )
                        )
                    )
                )
            )
            # Of twice the angle: versine 2 sin², sine 2 sin cos.
            double = 2 * sine * sine
            sine = 2 * sine * (1 - versine)
            versine = 2 * sine * sine
            sine = 2 * sine * (1 - double)
            angles[angle + m] = sine
            angles[angle + LANES + m] = versine
        for m in range(LANES):
            sine, versine = angles[angle + m], angles[angle + LANES + m]
            d0, d1, d2 = x[base + m] - c0, x[base + Y + m] - c1, x[base + Z + m] - c2
            along = a0 * d0 + a1 * d1 + a2 * d2
            x[base + m] += sine * (a1 * d2 - a2 * d1) + versine * (along * a0 - d0)
            x[base + Y + m] += sine * (a2 * d0 - a0 * d2) + versine * (along * a1 - d1)
            x[base + Z + m] += sine * (a0 * d1 - a1 * d0) + versine * (along * a2 - d2)
    kept = room.kept[turn]
    for i in range(x.shape[0]):
        kept[i] = x[i]


@compiled
def move(a, values, room):  # type: ignore[no-untyped-def]
    """Put the slots where the parameters move them."""
    x = room.x
    for i in range(x.shape[0]):
        x[i] = a.rest[i]
    for stage in range(a.stage_kinds.shape[0]):
        start = a.stage_starts[stage, 0]
        if a.stage_kinds[stage] == LINEAR:
            for field in range(start, a.stage_starts[stage, 1]):
                value, d = values[a.field_parameters[field]], a.fields[field]
                for i in range(x.shape[0]):
                    x[i] += value * d[i]
        elif a.stage_kinds[stage] == ROTATION:
            _turn(a, room, start, values[a.turn_parameters[start]])
        else:
            value, weights = values[a.turn_parameters[start]], a.turn_weights[start]
            kept = room.kept[start]
            for i in range(x.shape[0]):
                kept[i] = x[i]
            for vertex in range(a.blocks * a.slots):
                for axis in range(3):
                    amount = value * a.turn_vectors[start, axis]
                    centre = a.turn_centres[start, axis]
                    base = vertex * SLOT + axis * LANES
                    for m in range(LANES):
                        x[base + m] += amount * weights[vertex * LANES + m] * (x[base + m] - centre)


@compiled
def residuals(a, frame, objective, threshold, room):  # type: ignore[no-untyped-def]
    """Cost of the slots as they are; `objective.cost` says what is what.

    Parameters
    ----------
    frame
        `(blocks · 128,)`: of each block the measured markers (3) and their weights; of hidden
        markers any finite number, and weight 0.
    """
    x, markers, coordinates = room.x, room.markers, a.coordinates
    total = 0.0
    for block in range(a.blocks):
        o, k = block * a.slots * SLOT, block * PER_BLOCK
        f, uvw = block * 4 * LANES, block * 3 * LANES
        for m in range(3 * LANES):
            markers[k + m] = 0.0
        for j in range(1, a.slots):
            p = o + j * SLOT
            q = o + SLOT if j == a.slots - 1 else p + SLOT
            for m in range(LANES):
                x0, x1, x2 = x[o + m], x[o + Y + m], x[o + Z + m]
                p0, p1, p2 = x[p + m] - x0, x[p + Y + m] - x1, x[p + Z + m] - x2
                q0, q1, q2 = x[q + m] - x0, x[q + Y + m] - x1, x[q + Z + m] - x2
                markers[k + m] += p1 * q2 - p2 * q1
                markers[k + Y + m] += p2 * q0 - p0 * q2
                markers[k + Z + m] += p0 * q1 - p1 * q0
        b, c = o + SLOT, o + 2 * SLOT
        for m in range(LANES):
            n0, n1, n2 = markers[k + m], markers[k + Y + m], markers[k + Z + m]
            inverse = 1.0 / math.sqrt(n0 * n0 + n1 * n1 + n2 * n2)
            n0, n1, n2 = n0 * inverse, n1 * inverse, n2 * inverse
            s, t = coordinates[uvw + m], coordinates[uvw + Y + m]
            u = coordinates[uvw + Z + m]
            r = 1.0 - s - t
            r0 = r * x[o + m] + s * x[b + m] + t * x[c + m] + u * n0 - frame[f + m]
            r1 = r * x[o + Y + m] + s * x[b + Y + m] + t * x[c + Y + m] + u * n1
            r2 = r * x[o + Z + m] + s * x[b + Z + m] + t * x[c + Z + m] + u * n2
            r1 -= frame[f + Y + m]
            r2 -= frame[f + Z + m]
            markers[k + UNIT + m] = n0
            markers[k + UNIT + Y + m] = n1
            markers[k + UNIT + Z + m] = n2
            markers[k + TILT + m] = u * inverse
            markers[k + RESIDUAL + m] = r0
            markers[k + RESIDUAL + Y + m] = r1
            markers[k + RESIDUAL + Z + m] = r2
            markers[k + DISTANCE + m] = math.sqrt(r0 * r0 + r1 * r1 + r2 * r2)
        total += _pulls(markers, k, frame, f + 3 * LANES, objective, threshold)
    return total


@compiled
def _pulls(markers, k, frame, w, objective, threshold):  # type: ignore[no-untyped-def]
    """Cost of a block, and its derivative by the residuals."""
    total = 0.0
    if objective == SQUARES:
        for m in range(LANES):
            distance = markers[k + DISTANCE + m]
            total += frame[w + m] * distance * distance
            for axis in range(0, 3 * LANES, LANES):
                markers[k + _PULL + axis + m] = (
                    2.0 * frame[w + m] * markers[k + RESIDUAL + axis + m]
                )
    else:
        # Distances are Huber's with the straight part alone.
        straight = 1.0 if objective == DISTANCES else 2.0 * threshold
        offset = 0.0 if objective == DISTANCES else threshold * threshold
        knee = -1.0 if objective == DISTANCES else threshold
        for m in range(LANES):
            distance, weight = markers[k + DISTANCE + m], frame[w + m]
            near = distance <= knee
            total += weight * (distance * distance if near else straight * distance - offset)
            slope = weight * (2.0 if near else straight / max(distance, 1e-12))
            markers[k + _PULL + m] = slope * markers[k + RESIDUAL + m]
            markers[k + _PULL + Y + m] = slope * markers[k + RESIDUAL + Y + m]
            markers[k + _PULL + Z + m] = slope * markers[k + RESIDUAL + Z + m]
    return total


@compiled
def gradient(a, values, room, out):  # type: ignore[no-untyped-def]
    """Derivative of the cost by the parameters, after `move` and `residuals`."""
    x, g, markers, coordinates = room.x, room.adjoint, room.markers, a.coordinates
    for block in range(a.blocks):
        o, k, uvw = block * a.slots * SLOT, block * PER_BLOCK, block * 3 * LANES
        # What pulls at the normal, brought through its unit length, takes the normal's place.
        for m in range(LANES):
            n0, n1 = markers[k + UNIT + m], markers[k + UNIT + Y + m]
            n2, ul = markers[k + UNIT + Z + m], markers[k + TILT + m]
            p0, p1 = markers[k + _PULL + m], markers[k + _PULL + Y + m]
            p2 = markers[k + _PULL + Z + m]
            along = n0 * p0 + n1 * p1 + n2 * p2
            markers[k + m] = ul * (p0 - along * n0)
            markers[k + Y + m] = ul * (p1 - along * n1)
            markers[k + Z + m] = ul * (p2 - along * n2)
        for j in range(1, a.slots):
            p = o + j * SLOT
            after = o + SLOT if j == a.slots - 1 else p + SLOT
            before = o + (a.slots - 1) * SLOT if j == 1 else p - SLOT
            for m in range(LANES):
                e0, e1 = x[after + m] - x[before + m], x[after + Y + m] - x[before + Y + m]
                e2 = x[after + Z + m] - x[before + Z + m]
                h0, h1, h2 = markers[k + m], markers[k + Y + m], markers[k + Z + m]
                g[p + m] = e1 * h2 - e2 * h1
                g[p + Y + m] = e2 * h0 - e0 * h2
                g[p + Z + m] = e0 * h1 - e1 * h0
        for axis in range(0, 3 * LANES, LANES):
            for m in range(LANES):
                pull = markers[k + _PULL + axis + m]
                s, t = coordinates[uvw + m], coordinates[uvw + Y + m]
                g[o + axis + m] = (1.0 - s - t) * pull
                g[o + SLOT + axis + m] += s * pull
                g[o + 2 * SLOT + axis + m] += t * pull
    for p in range(out.shape[0]):
        out[p] = 0.0
    for stage in range(a.stage_kinds.shape[0] - 1, -1, -1):
        start = a.stage_starts[stage, 0]
        if a.stage_kinds[stage] == LINEAR:
            for field in range(start, a.stage_starts[stage, 1]):
                total, d = 0.0, a.fields[field]
                for i in range(g.shape[0]):
                    total += g[i] * d[i]
                out[a.field_parameters[field]] += total
        elif a.stage_kinds[stage] == ROTATION:
            out[a.turn_parameters[start]] += _turn_back(a, room, start)
        else:
            out[a.turn_parameters[start]] += _scale_back(a, values, room, start)


@compiled
def _turn_back(a, room, turn):  # type: ignore[no-untyped-def]
    """Bring the adjoint back through a rotation; the derivative by its parameter."""
    g, kept, angles, weights = (
        room.adjoint,
        room.kept[turn],
        room.angles[turn],
        a.turn_weights[turn],
    )
    v0, v1, v2 = a.turn_vectors[turn, 0], a.turn_vectors[turn, 1], a.turn_vectors[turn, 2]
    c0, c1, c2 = a.turn_centres[turn, 0], a.turn_centres[turn, 1], a.turn_centres[turn, 2]
    length = math.sqrt(v0 * v0 + v1 * v1 + v2 * v2)
    a0, a1, a2 = v0 / length, v1 / length, v2 / length
    total = 0.0
    for vertex in range(a.blocks * a.slots):
        row, base, angle = vertex * LANES, vertex * SLOT, vertex * 2 * LANES
        for m in range(LANES):
            g0, g1, g2 = g[base + m], g[base + Y + m], g[base + Z + m]
            d0, d1 = kept[base + m] - c0, kept[base + Y + m] - c1
            d2 = kept[base + Z + m] - c2
            total += weights[row + m] * (
                g0 * (v1 * d2 - v2 * d1) + g1 * (v2 * d0 - v0 * d2) + g2 * (v0 * d1 - v1 * d0)
            )
        for m in range(LANES):
            g0, g1, g2 = g[base + m], g[base + Y + m], g[base + Z + m]
            sine, versine = angles[angle + m], angles[angle + LANES + m]
            along = a0 * g0 + a1 * g1 + a2 * g2
            g[base + m] = g0 - sine * (a1 * g2 - a2 * g1) + versine * (along * a0 - g0)
            g[base + Y + m] = g1 - sine * (a2 * g0 - a0 * g2) + versine * (along * a1 - g1)
            g[base + Z + m] = g2 - sine * (a0 * g1 - a1 * g0) + versine * (along * a2 - g2)
    return total


@compiled
def _scale_back(a, values, room, turn):  # type: ignore[no-untyped-def]
    """Bring the adjoint back through a scaling; the derivative by its parameter."""
    g, kept, weights = room.adjoint, room.kept[turn], a.turn_weights[turn]
    value = values[a.turn_parameters[turn]]
    total = 0.0
    for vertex in range(a.blocks * a.slots):
        for axis in range(3):
            vector, centre = a.turn_vectors[turn, axis], a.turn_centres[turn, axis]
            base = vertex * SLOT + axis * LANES
            for m in range(LANES):
                share = weights[vertex * LANES + m] * vector
                total += g[base + m] * share * (kept[base + m] - centre)
                g[base + m] *= 1.0 + value * share
    return total


@compiled
def cost(a, values, frame, objective, threshold, room, out):  # type: ignore[no-untyped-def]
    """Cost of a frame, and its derivative by the parameters into `out`."""
    move(a, values, room)
    value = residuals(a, frame, objective, threshold, room)
    gradient(a, values, room, out)
    return value


@compiled
def residuals_into(a, room, out):  # type: ignore[no-untyped-def]
    """Copy the residuals, `(blocks · 96,)`, out of the room."""
    for block in range(a.blocks):
        k, row = block * PER_BLOCK + RESIDUAL, block * 3 * LANES
        for m in range(3 * LANES):
            out[row + m] = room.markers[k + m]
