"""The arrays that the fitting kernel reads: a binding packed for speed.

Every marker has its own copy ("slots") of the vertices that it needs: v1 first, then the ring of
vertices round it, v2 and v3 leading. Markers go in blocks of 32, and the last block is padded
with copies that never weigh; within a block the order is slot, coordinate, marker, so that the
kernel's inner loops run over the markers of a block side by side.

The rig's operations are brought to as few stages as can be: what is linear in the parameters is
added up to one field a parameter, and rotations and scalings stand between.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mocap_fit.face.rig import CompiledRig, Kind
from mocap_fit.fitting.binding import Binding
from mocap_fit.tracks import FloatArray

# Markers side by side. Compilers unroll shorter loops before they can put them in registers.
LANES = 32
LINEAR, ROTATION, SCALING = 0, 1, 2


class Slots(NamedTuple):
    """A packed binding; ``size`` is blocks · slots · 3 · 32.

    Parameters
    ----------
    rest
        `(size,)`: the slots at rest, millimetres.
    stage_kinds
        `(stages,)`: `LINEAR`, `ROTATION` or `SCALING`.
    stage_starts
        `(stages, 2)`: the first of a stage's fields, rotations or scalings, and the one after.
    field_parameters, fields
        `(fields,)` and `(fields, size)`: what each adds at parameter 1.
    turn_parameters, turn_weights, turn_vectors, turn_centres
        `(turns,)`, `(turns, blocks · slots · 32)`, and `(turns, 3)` twice: rotations and
        scalings, as in `mocap_fit.face.rig.Kind`.
    coordinates
        `(blocks · 96,)`: s, t and u.
    slots, blocks, parameters
        Counts.
    """

    rest: FloatArray
    stage_kinds: NDArray[np.int64]
    stage_starts: NDArray[np.int64]
    field_parameters: NDArray[np.int64]
    fields: FloatArray
    turn_parameters: NDArray[np.int64]
    turn_weights: FloatArray
    turn_vectors: FloatArray
    turn_centres: FloatArray
    coordinates: FloatArray
    slots: int
    blocks: int
    parameters: int


def pack(binding: Binding) -> Slots:
    """Pack a binding whose rig is compiled."""
    compiled = binding.compiled
    if compiled is None:
        raise ValueError("the rig is not compiled")
    ids = _slot_vertices(binding)
    slots, markers = ids.shape
    blocks = markers // LANES

    def in_blocks(values: FloatArray) -> FloatArray:
        """`(slots, markers)`, or with coordinates last → flat, blocks first and lanes last."""
        split = values.reshape(len(values), blocks, LANES, -1)
        return np.ascontiguousarray(split.transpose(1, 0, 3, 2)).ravel()

    def spread(vertices: FloatArray) -> FloatArray:
        return in_blocks(vertices[ids])

    kinds: list[int] = []
    extents: list[tuple[int, int]] = []
    fields: list[tuple[int, FloatArray]] = []
    turns: list[tuple[int, FloatArray, FloatArray, FloatArray]] = []
    for kind, item in _stages(compiled):
        kinds.append(kind)
        if kind == LINEAR:
            extents.append((len(fields), len(fields) + len(item)))
            fields += [(p, spread(field)) for p, field in item.items()]
        else:
            extents.append((len(turns), len(turns) + 1))
            parameter, weights, vector, centre = item
            turns.append((parameter, in_blocks(weights[ids]), vector, centre))
    size = ids.size * 3
    coordinates = np.zeros((1, markers, 3))
    coordinates[0, : len(binding.names)] = binding.coordinates
    return Slots(
        rest=spread(compiled.rest),
        stage_kinds=np.array(kinds, dtype=np.int64),
        stage_starts=np.array(extents, dtype=np.int64),
        field_parameters=np.array([p for p, _ in fields], dtype=np.int64),
        fields=np.array([f for _, f in fields]).reshape(len(fields), size),
        turn_parameters=np.array([t[0] for t in turns], dtype=np.int64),
        turn_weights=np.array([t[1] for t in turns]).reshape(len(turns), ids.size),
        turn_vectors=np.array([t[2] for t in turns]).reshape(len(turns), 3),
        turn_centres=np.array([t[3] for t in turns]).reshape(len(turns), 3),
        coordinates=in_blocks(coordinates),
        slots=slots,
        blocks=blocks,
        parameters=compiled.parameter_count,
    )


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
    split = packed.reshape(frames, blocks, LANES, 4).transpose(0, 1, 3, 2)
    return np.ascontiguousarray(split).reshape(frames, blocks * 4 * LANES)


def _stages(compiled: CompiledRig) -> list[tuple[int, Any]]:
    """The operations in as few stages as can be.

    A linear stage is ``{parameter: (vertices, 3)}``; a rotation or scaling ``(parameter, weights,
    vector, centre)``. A scaling of coordinates that nothing has moved yet is linear too.
    """
    stages: list[tuple[int, Any]] = []
    moved = np.zeros(compiled.rest.shape, dtype=bool)
    fields: dict[int, FloatArray] = {}

    def finish() -> None:
        if fields:
            stages.append((LINEAR, dict(fields)))
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
            turn = SCALING if kind == Kind.SCALING else ROTATION
            stages.append((turn, (parameter, weights, vector, centre)))
            moved |= effect != 0 if kind == Kind.SCALING else (weights != 0)[:, None]
            continue
        moved |= field != 0
        fields[parameter] = fields.get(parameter, 0.0) + field
    finish()
    return stages


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
