"""The compiled kernel's other half: the derivative of every virtual marker.

Derivatives are carried forward through the stages of a packed rig, as `face.rig` does it in plain
numpy, and then through eq. 2 of Beskow.
"""

from __future__ import annotations

import math

import numpy as np

from mocap_fit.fitting.kernel import (
    PER_BLOCK,
    SLOT,
    SQUARES,
    TILT,
    UNIT,
    Room,
    Y,
    Z,
    compiled,
    move,
    residuals,
    residuals_into,
)
from mocap_fit.fitting.slots import LANES, LINEAR, ROTATION, Slots
from mocap_fit.tracks import FloatArray


@compiled
def jacobian(a, values, room):  # type: ignore[no-untyped-def]
    """Derivative of the virtual markers, into the room, after `move` and `residuals`."""
    _move_slopes(a, values, room)
    x, edges, markers, coordinates = room.x, room.adjoint, room.markers, a.coordinates
    for block in range(a.blocks):
        o = block * a.slots * SLOT
        for j in range(1, a.slots):
            p = o + j * SLOT
            after = o + SLOT if j == a.slots - 1 else p + SLOT
            before = o + (a.slots - 1) * SLOT if j == 1 else p - SLOT
            for m in range(SLOT):
                edges[p + m] = x[after + m] - x[before + m]
    for parameter in range(a.parameters):
        d, out = room.slopes[parameter], room.jacobian[parameter]
        for block in range(a.blocks):
            o, k = block * a.slots * SLOT, block * PER_BLOCK
            row = block * 3 * LANES
            for m in range(SLOT):
                out[row + m] = 0.0
            for p in range(o + SLOT, o + a.slots * SLOT, SLOT):
                for m in range(LANES):
                    d0, d1, d2 = d[p + m], d[p + Y + m], d[p + Z + m]
                    e0, e1, e2 = edges[p + m], edges[p + Y + m], edges[p + Z + m]
                    out[row + m] += d1 * e2 - d2 * e1
                    out[row + Y + m] += d2 * e0 - d0 * e2
                    out[row + Z + m] += d0 * e1 - d1 * e0
            b, c = o + SLOT, o + 2 * SLOT
            for m in range(LANES):
                n0, n1 = markers[k + UNIT + m], markers[k + UNIT + Y + m]
                n2, ul = markers[k + UNIT + Z + m], markers[k + TILT + m]
                t0, t1, t2 = out[row + m], out[row + Y + m], out[row + Z + m]
                along = n0 * t0 + n1 * t1 + n2 * t2
                s, t = coordinates[row + m], coordinates[row + Y + m]
                r = 1.0 - s - t
                t0, t1, t2 = ul * (t0 - along * n0), ul * (t1 - along * n1), ul * (t2 - along * n2)
                out[row + m] = r * d[o + m] + s * d[b + m] + t * d[c + m] + t0
                out[row + Y + m] = r * d[o + Y + m] + s * d[b + Y + m] + t * d[c + Y + m] + t1
                out[row + Z + m] = r * d[o + Z + m] + s * d[b + Z + m] + t * d[c + Z + m] + t2


@compiled
def _move_slopes(a, values, room):  # type: ignore[no-untyped-def]
    """Derivative of the slots by every parameter, carried forward through the stages."""
    slopes = room.slopes
    for p in range(slopes.shape[0]):
        for i in range(slopes.shape[1]):
            slopes[p, i] = 0.0
    for stage in range(a.stage_kinds.shape[0]):
        start = a.stage_starts[stage, 0]
        if a.stage_kinds[stage] == LINEAR:
            for field in range(start, a.stage_starts[stage, 1]):
                d, more = slopes[a.field_parameters[field]], a.fields[field]
                for i in range(d.shape[0]):
                    d[i] += more[i]
        elif a.stage_kinds[stage] == ROTATION:
            for p in range(a.parameters):
                if _moved_before(a, stage, p):
                    _turn_slope(a, slopes[p], room.angles[start], start)
            _add_turn_slope(a, slopes[a.turn_parameters[start]], room.kept[start], start)
        else:
            _scale_slopes(a, values, room, start)


@compiled
def _turn_slope(a, d, angles, turn):  # type: ignore[no-untyped-def]
    v0, v1, v2 = a.turn_vectors[turn, 0], a.turn_vectors[turn, 1], a.turn_vectors[turn, 2]
    length = math.sqrt(v0 * v0 + v1 * v1 + v2 * v2)
    a0, a1, a2 = v0 / length, v1 / length, v2 / length
    for vertex in range(a.blocks * a.slots):
        base, angle = vertex * SLOT, vertex * 2 * LANES
        for m in range(LANES):
            d0, d1, d2 = d[base + m], d[base + Y + m], d[base + Z + m]
            sine, versine = angles[angle + m], angles[angle + LANES + m]
            along = a0 * d0 + a1 * d1 + a2 * d2
            d[base + m] = d0 + sine * (a1 * d2 - a2 * d1) + versine * (along * a0 - d0)
            d[base + Y + m] = d1 + sine * (a2 * d0 - a0 * d2) + versine * (along * a1 - d1)
            d[base + Z + m] = d2 + sine * (a0 * d1 - a1 * d0) + versine * (along * a2 - d2)


@compiled
def _add_turn_slope(a, d, kept, turn):  # type: ignore[no-untyped-def]
    weights = a.turn_weights[turn]
    v0, v1, v2 = a.turn_vectors[turn, 0], a.turn_vectors[turn, 1], a.turn_vectors[turn, 2]
    c0, c1, c2 = a.turn_centres[turn, 0], a.turn_centres[turn, 1], a.turn_centres[turn, 2]
    for vertex in range(a.blocks * a.slots):
        row, base = vertex * LANES, vertex * SLOT
        for m in range(LANES):
            w = weights[row + m]
            d0, d1 = kept[base + m] - c0, kept[base + Y + m] - c1
            d2 = kept[base + Z + m] - c2
            d[base + m] += w * (v1 * d2 - v2 * d1)
            d[base + Y + m] += w * (v2 * d0 - v0 * d2)
            d[base + Z + m] += w * (v0 * d1 - v1 * d0)


@compiled
def _scale_slopes(a, values, room, turn):  # type: ignore[no-untyped-def]
    slopes, kept, weights = room.slopes, room.kept[turn], a.turn_weights[turn]
    own = a.turn_parameters[turn]
    for vertex in range(a.blocks * a.slots):
        for axis in range(3):
            base = vertex * SLOT + axis * LANES
            vector, centre = a.turn_vectors[turn, axis], a.turn_centres[turn, axis]
            for m in range(LANES):
                share = weights[vertex * LANES + m] * vector
                for p in range(a.parameters):
                    slopes[p, base + m] *= 1.0 + values[own] * share
                slopes[own, base + m] += share * (kept[base + m] - centre)


@compiled
def _moved_before(a, stage, parameter):  # type: ignore[no-untyped-def]
    """Whether an earlier stage is driven by the parameter."""
    for earlier in range(stage):
        start = a.stage_starts[earlier, 0]
        if a.stage_kinds[earlier] == LINEAR:
            for field in range(start, a.stage_starts[earlier, 1]):
                if a.field_parameters[field] == parameter:
                    return True
        elif a.turn_parameters[start] == parameter:
            return True
    return False


@compiled
def _evaluate_frames(a, values, nowhere, room, rows, slopes):  # type: ignore[no-untyped-def]
    """Virtual markers and Jacobians of many frames, as the room holds them."""
    for frame in range(values.shape[0]):
        move(a, values[frame], room)
        # Measured from nowhere, a residual is a position.
        residuals(a, nowhere, SQUARES, 1.0, room)
        residuals_into(a, room, rows[frame])
        jacobian(a, values[frame], room)
        for p in range(values.shape[1]):
            for i in range(nowhere.shape[0] * 3 // 4):
                slopes[frame, p, i] = room.jacobian[p, i]


def markers_of_frames(
    slots: Slots, room: Room, values: FloatArray, count: int
) -> tuple[FloatArray, FloatArray]:
    """Virtual markers of many frames, and their derivatives.

    Parameters
    ----------
    slots, room
        The packed binding, and room to work in.
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
    rows = np.empty((frames, blocks * 3 * LANES))
    slopes = np.empty((frames, parameters, blocks * 3 * LANES))
    nowhere = np.zeros(blocks * 4 * LANES)
    _evaluate_frames(slots, np.ascontiguousarray(values), nowhere, room, rows, slopes)
    positions = rows.reshape(frames, blocks, 3, LANES).transpose(0, 1, 3, 2)
    jacobians = slopes.reshape(frames, parameters, blocks, 3, LANES).transpose(0, 2, 4, 3, 1)
    return (
        positions.reshape(frames, -1, 3)[:, :count],
        jacobians.reshape(frames, -1, 3, parameters)[:, :count],
    )
