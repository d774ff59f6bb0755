"""The arrays that the fitting kernel reads: a binding packed for speed.

Every marker has its own copy ("slots") of the vertices that it needs: v1 first, then the ring of
vertices round it, v2 and v3 leading. Markers go in blocks of 32, and the last block is padded
with copies that never weigh; within a block the order is slot, coordinate, marker, so that the
kernel's inner loops run over the markers of a block side by side.

The rig's operations are brought to as few as can be. What is linear in the parameters is added up
to one field a parameter; rotations and scalings ("turns") stand between, in one form:
``x ← c + (I + S A + V B)(x - c)``. For a rotation A is the cross product with its axis, B is A
twice, S the sine and V the versine (one minus the cosine) of the slot's angle; for a scaling A is
diagonal, B nil, and S the amount.

Everything lies in one array of numbers and one of integers: a compiler takes its time over every
array that a function is given.
"""

from __future__ import annotations

import math
import weakref
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mocap_fit.face.rig import CompiledRig, Kind
from mocap_fit.fitting.binding import Binding
from mocap_fit.tracks import FloatArray

# Markers side by side. Compilers unroll shorter loops before they can put them in registers.
LANES = 32
# From the x of a slot to its y, its z, and the next slot.
Y, Z, SLOT = LANES, 2 * LANES, 3 * LANES
LINEAR, ROTATION, SCALING = 0, 1, 2
# What `Slots.plan` begins with: counts of blocks, of a marker's slots but the first, of all slots
# side by side, of their numbers, of parameters and of operations; where the coordinates begin in
# `Slots.numbers`; where the kernel's room has space for what is moved, and what is kept of the
# markers. Then four integers an operation: its kind, its parameter, where its numbers begin, and
# where in the room a turn has its place.
BLOCKS, RING, VERTICES, SIZE, PARAMETERS, OPERATIONS = range(6)
COORDINATES, SCRATCH, MARKERS, OPERATION = range(6, 10)
# What the numbers of a turn begin with: A, B and c, then, on a line of the cache, a weight for
# each slot.
MATRICES, CENTRE, WEIGHTS = 0, 18, 24
# Numbers that the kernel keeps of a block's markers: the normal before it has unit length (3), the
# unit normal (3), u over the normal's length, and what pulls at the virtual marker (3).
NORMAL, UNIT, TILT, PULL, KEPT = 0, 3 * LANES, 6 * LANES, 7 * LANES, 10 * LANES


class Slots(NamedTuple):
    """A packed binding; its size is blocks · slots · 96.

    Parameters
    ----------
    plan
        Counts and places, see above. They have no sign: a compiler that cannot rule out that an
        index is negative, and means the end of an array, does not take markers side by side.
    numbers
        The slots at rest, `(size,)`, millimetres; then the fields, `(size,)`, what a parameter
        of 1 adds, and the turns; then the coordinates s, t and u, `(blocks · 96,)`.
    room
        Size of the array that the kernel works in: the slots, their adjoint, as much again,
        `KEPT` numbers a block, and for every turn the derivative of the slots by its parameter,
        `(size,)`, and S and V of every slot, `(2 · size / 3,)`.
    """

    plan: NDArray[np.uint32]
    numbers: FloatArray
    room: int

    @property
    def blocks(self) -> int:
        """Blocks of 32 markers."""
        return int(self.plan[BLOCKS])

    @property
    def parameters(self) -> int:
        """Parameters of the rig."""
        return int(self.plan[PARAMETERS])


def aligned_zeros(*shape: int) -> FloatArray:
    """Zeros of a shape that begin on a line of the cache, of 64 bytes.

    What is read eight numbers at a time would else be read from two lines each time.
    """
    count = math.prod(shape)
    zeros = np.zeros(count + 8)
    start = -(zeros.ctypes.data // 8) % 8
    return zeros[start : start + count].reshape(shape)


_packed: weakref.WeakKeyDictionary[Binding, Slots] = weakref.WeakKeyDictionary()


def pack(binding: Binding) -> Slots:
    """Pack a binding whose rig is compiled; once for all who ask. Not to be written to."""
    if binding not in _packed:
        _packed[binding] = _pack(binding)
    return _packed[binding]


def _pack(binding: Binding) -> Slots:
    compiled = binding.compiled
    if compiled is None:
        raise ValueError("the rig is not compiled")
    ids = _slot_vertices(binding)
    slots, markers = ids.shape
    blocks = markers // LANES
    size = ids.size * 3

    def in_blocks(values: FloatArray) -> FloatArray:
        """`(slots, markers)`, or with coordinates last → flat, blocks first and lanes last."""
        split = values.reshape(len(values), blocks, LANES, -1)
        return np.ascontiguousarray(split.transpose(1, 0, 3, 2)).ravel()

    parts = [in_blocks(compiled.rest[ids])]
    plan: list[int] = []
    room = 3 * size + blocks * KEPT
    for kind, parameter, item in _operations(compiled):
        plan += [kind, parameter, sum(map(len, parts)), room]
        if kind == LINEAR:
            parts.append(in_blocks(item[ids]))
        else:
            weights, matrices, centre = item
            parts += [
                matrices.ravel(),
                centre,
                np.zeros(WEIGHTS - CENTRE - 3),
                in_blocks(weights[ids]),
            ]
            room += size + 2 * ids.size
    coordinates = np.zeros((1, markers, 3))
    coordinates[0, : len(binding.names)] = binding.coordinates
    counts = [compiled.parameter_count, len(plan) // 4, sum(map(len, parts)), 2 * size, 3 * size]
    parts.append(in_blocks(coordinates))
    plan = [blocks, slots - 1, blocks * slots, size, *counts, *plan]
    numbers = aligned_zeros(sum(map(len, parts)))
    np.concatenate(parts, out=numbers)
    return Slots(np.array(plan, dtype=np.uint32), numbers, room)


def pack_frames(targets: FloatArray, weights: FloatArray) -> FloatArray:
    """Measured markers as the kernel reads them.

    Parameters
    ----------
    targets
        `(frames, markers, 3)`, in the face's coordinates; NaN is hidden.
    weights
        `(markers,)`.

    Returns
    -------
    FloatArray
        `(frames, blocks · 128)`: of each block x, y, z and the weight, which is 0 of what is
        hidden.
    """
    frames, count = targets.shape[:2]
    blocks = -(-count // LANES)
    packed = np.zeros((frames, blocks * LANES, 4))
    seen = np.isfinite(targets[:, :, 0])
    packed[:, :count, :3] = np.where(seen[:, :, None], targets, 0.0)
    packed[:, :count, 3] = np.where(seen, weights, 0.0)
    result = aligned_zeros(frames, blocks * 4 * LANES)
    split = packed.reshape(frames, blocks, LANES, 4).transpose(0, 1, 3, 2)
    result.reshape(split.shape)[...] = split
    return result


def _operations(compiled: CompiledRig) -> list[tuple[int, int, Any]]:
    """The operations, as few as can be: kind, parameter, and what it needs.

    A linear one needs its field, `(vertices, 3)`; a turn its weights, `(vertices,)`, the matrices
    A and B, `(2, 3, 3)`, and its centre. A scaling of coordinates that nothing has moved yet is
    linear too.
    """
    operations: list[tuple[int, int, Any]] = []
    moved = np.zeros(compiled.rest.shape, dtype=bool)
    fields: dict[int, FloatArray] = {}

    def finish() -> None:
        operations.extend((LINEAR, parameter, field) for parameter, field in fields.items())
        fields.clear()

    for i, kind in enumerate(compiled.kinds):
        parameter = int(compiled.parameters[i])
        weights, vector, centre = compiled.weights[i], compiled.vectors[i], compiled.centres[i]
        effect = weights[:, None] * vector
        if kind == Kind.TRANSLATION:
            field = effect
        elif kind == Kind.FIELD:
            field = compiled.fields[i]
        elif kind == Kind.SCALING and not (moved & (effect != 0)).any():
            field = effect * (compiled.rest - centre)
        elif not vector.any():
            continue  # a turn about nothing has no axis
        else:
            finish()
            if kind == Kind.SCALING:
                matrices = np.stack([np.diag(vector), np.zeros((3, 3))])
                operations.append((SCALING, parameter, (weights, matrices, centre)))
                moved |= effect != 0
            else:
                angle = np.sqrt(vector @ vector)
                x, y, z = vector / angle
                across = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
                matrices = np.stack([across, across @ across])
                operations.append((ROTATION, parameter, (weights * angle, matrices, centre)))
                moved |= (weights != 0)[:, None]
            continue
        moved |= field != 0
        fields[parameter] = fields.get(parameter, 0.0) + field
    finish()
    return operations


def _slot_vertices(binding: Binding) -> NDArray[np.int64]:
    """Vertex of every slot, `(slots, markers)`, as positions in the binding's vertices.

    The ring is closed: where the surface ends at v1, or falls into pieces there, v1 itself stands
    between the ends, and adds nothing to the normal. Shorter rings repeat their last vertex, which
    adds nothing either; the padding markers repeat the last marker.
    """
    rings = []
    for m, (first, second, third) in enumerate(binding.corners):
        pairs = binding.rings[binding.ring_starts[m] : binding.ring_starts[m + 1]]
        following = dict(pairs.tolist())
        ring: list[int] = []
        if len(following) < len(pairs):
            # An edge with a third triangle, or a reversed one: each for itself, v2 v3 first.
            own = pairs.tolist().index([second, third])
            for i in [own, *range(own), *range(own + 1, len(pairs))]:
                ring += [*pairs[i].tolist(), int(first)]
            following = {}
        starts = [int(second), *sorted(set(following) - set(following.values())), *following]
        for start in starts:
            vertex = start
            fan = []
            while vertex in following:
                fan.append(vertex)
                vertex = following.pop(vertex)
            if fan:
                alone = vertex == fan[0] and len(fan) == len(pairs)
                ring += fan if alone else [*fan, vertex, int(first)]
        rings.append([int(first), *ring])
    longest = max(map(len, rings))
    padded = [ring + [ring[-1]] * (longest - len(ring)) for ring in rings]
    padded += [padded[-1]] * (-len(padded) % LANES)
    return np.array(padded, dtype=np.int64).T.copy()
