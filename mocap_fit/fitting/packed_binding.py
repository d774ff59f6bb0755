"""The arrays that the fitting kernel reads: a binding packed for speed.

Every marker has a copy of each vertex that it needs, a slot: v1 first, then the ring of vertices
round it, v2 and v3 leading. Markers come in blocks of 32, and the last block is padded with copies
of weight 0; within a block the order is slot, coordinate, marker, so that the kernel's inner loops
run over the markers of a block and vectorise.

The rig's operations are merged to as few as possible. Those linear in the parameters are added up
to one field a parameter; rotations and scalings ("turns") stand between, in one form:
``x ← c + (I + S A + V B)(x - c)``. For a rotation A is the cross product with its axis, B is A
twice, S the sine and V the versine (one minus the cosine) of the slot's angle; for a scaling A is
diagonal, B is 0, and S the amount.

Everything lies in one array of numbers and one of integers: compilation takes longer with every
array argument of a function.
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

# Markers of a block. Compilers unroll shorter loops before they vectorise them.
WIDTH = 32
# From the x of a slot to its y, its z, and the next slot.
Y, Z, SLOT = WIDTH, 2 * WIDTH, 3 * WIDTH
LINEAR, ROTATION, SCALING = 0, 1, 2
# `PackedBinding.plan` begins with counts: of blocks, of a marker's slots but the first, of all
# slots of a block's marker, of their numbers, of parameters and of operations; then where the
# coordinates begin in `PackedBinding.numbers`, and where the scratch space and the markers begin
# in the workspace. Four integers an operation follow: its kind, its parameter, where its numbers
# begin, and where a turn's derivative begins in the workspace.
BLOCKS, RING, VERTICES, SIZE, PARAMETERS, OPERATIONS = range(6)
COORDINATES, SCRATCH, MARKERS, OPERATION = range(6, 10)
# The numbers of a turn: A, B and c, then, aligned to a line of the cache, a weight for each slot.
MATRICES, CENTRE, WEIGHTS = 0, 18, 24
# Numbers of a block's markers in the workspace: the normal before it has unit length (3), the unit
# normal (3), u over the normal's length, and the gradient by the virtual marker (3).
NORMAL, UNIT, TILT, GRADIENT, MARKER_SIZE = 0, 3 * WIDTH, 6 * WIDTH, 7 * WIDTH, 10 * WIDTH


class PackedBinding(NamedTuple):
    """A binding as the kernel reads it; its slots have blocks · slots · 96 numbers, its size.

    Parameters
    ----------
    plan
        Counts and indices, ``(10 + 4 · operations,)``. They are unsigned: a compiler that cannot
        rule out negative indices, which count from the end of an array, does not vectorise.
    numbers
        One array, ``(numbers,)``: the slots at rest, size numbers, millimetres; the fields, size
        numbers each, which a parameter of 1 adds, and the turns; the coordinates s, t and u,
        96 a block.
    workspace_size
        Size of the kernel's workspace: the slots, their adjoint, scratch space of the same size,
        `MARKER_SIZE` numbers a block, and for every turn the derivative of the slots by its
        parameter, and S and V of every slot.
    """

    plan: NDArray[np.uint32]
    numbers: FloatArray
    workspace_size: int

    @property
    def blocks(self) -> int:
        """Number of blocks of 32 markers."""
        return int(self.plan[BLOCKS])

    @property
    def parameters(self) -> int:
        """Number of parameters of the rig."""
        return int(self.plan[PARAMETERS])


def allocate_aligned(*shape: int) -> FloatArray:
    """Return zeros that begin on a line of the cache, of 64 bytes.

    Eight numbers that are read at once then come from one line and not from two.

    Parameters
    ----------
    *shape
        Shape of the array.

    Returns
    -------
    ndarray
        Zeros, ``(*shape,)``.
    """
    count = math.prod(shape)
    zeros = np.zeros(count + 8)
    start = -(zeros.ctypes.data // 8) % 8
    return zeros[start : start + count].reshape(shape)


_cached: weakref.WeakKeyDictionary[Binding, PackedBinding] = weakref.WeakKeyDictionary()


def pack(binding: Binding) -> PackedBinding:
    """Pack a binding whose rig is compiled; the result is cached and must not be written to.

    Parameters
    ----------
    binding
        Virtual markers.

    Returns
    -------
    PackedBinding
        The arrays that the kernel reads.

    Raises
    ------
    ValueError
        If the rig is not compiled.
    """
    if binding not in _cached:
        _cached[binding] = _pack(binding)
    return _cached[binding]


def _pack(binding: Binding) -> PackedBinding:
    compiled = binding.compiled
    if compiled is None:
        raise ValueError("the rig is not compiled")
    ids = _list_slot_vertices(binding)
    slots, markers = ids.shape
    blocks = markers // WIDTH
    size = ids.size * 3

    def arrange_in_blocks(values: FloatArray) -> FloatArray:
        """Reorder ``(slots, markers, ...)`` to blocks first and markers last, flat."""
        split = values.reshape(len(values), blocks, WIDTH, -1)
        return np.ascontiguousarray(split.transpose(1, 0, 3, 2)).ravel()

    parts = [arrange_in_blocks(compiled.rest[ids])]
    plan: list[int] = []
    workspace = 3 * size + blocks * MARKER_SIZE
    for kind, parameter, item in _merge_operations(compiled):
        plan += [kind, parameter, sum(map(len, parts)), workspace]
        if kind == LINEAR:
            parts.append(arrange_in_blocks(item[ids]))
        else:
            weights, matrices, centre = item
            parts += [
                matrices.ravel(),
                centre,
                np.zeros(WEIGHTS - CENTRE - 3),
                arrange_in_blocks(weights[ids]),
            ]
            workspace += size + 2 * ids.size
    coordinates = np.zeros((1, markers, 3))
    coordinates[0, : len(binding.names)] = binding.coordinates
    counts = [compiled.parameter_count, len(plan) // 4, sum(map(len, parts)), 2 * size, 3 * size]
    parts.append(arrange_in_blocks(coordinates))
    plan = [blocks, slots - 1, blocks * slots, size, *counts, *plan]
    numbers = allocate_aligned(sum(map(len, parts)))
    np.concatenate(parts, out=numbers)
    return PackedBinding(np.array(plan, dtype=np.uint32), numbers, workspace)


def pack_frames(targets: FloatArray, weights: FloatArray) -> FloatArray:
    """Arrange measured markers as the kernel reads them.

    Parameters
    ----------
    targets
        Measured markers in the face's coordinates, ``(frames, markers, 3)``, millimetres; NaN
        where hidden.
    weights
        Weights of the markers, ``(markers,)``, no unit.

    Returns
    -------
    ndarray
        x, y, z and weight of each block, ``(frames, blocks · 128)``; the weight of a hidden
        marker is 0.
    """
    frames, count = targets.shape[:2]
    blocks = -(-count // WIDTH)
    packed = np.zeros((frames, blocks * WIDTH, 4))
    seen = np.isfinite(targets[:, :, 0])
    packed[:, :count, :3] = np.where(seen[:, :, None], targets, 0.0)
    packed[:, :count, 3] = np.where(seen, weights, 0.0)
    result = allocate_aligned(frames, blocks * 4 * WIDTH)
    split = packed.reshape(frames, blocks, WIDTH, 4).transpose(0, 1, 3, 2)
    result.reshape(split.shape)[...] = split
    return result


def _merge_operations(compiled: CompiledRig) -> list[tuple[int, int, Any]]:
    """Merge the rig's operations to as few as possible: kind, parameter and data of each.

    The data of a linear operation are its field, ``(vertices, 3)``; those of a turn its weights,
    ``(vertices,)``, the matrices A and B, ``(2, 3, 3)``, and its centre. A scaling of coordinates
    that nothing has moved yet is linear too.
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


def _list_slot_vertices(binding: Binding) -> NDArray[np.int64]:
    """List the vertex of every slot, ``(slots, markers)``, as indices of the binding's vertices.

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
            position = pairs.tolist().index([second, third])
            for i in [position, *range(position), *range(position + 1, len(pairs))]:
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
    padded += [padded[-1]] * (-len(padded) % WIDTH)
    return np.array(padded, dtype=np.int64).T.copy()
