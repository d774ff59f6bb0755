"""The compiled kernel: virtual markers and the objective of a frame, for a compiled rig.

It touches only the vertices that the markers need and allocates nothing. `Binding.evaluate` is
the same in plain numpy; the tests hold the two together. Without numba the functions here do not
exist, and the fit uses the numpy form.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from mocap_fit.face.rig import Kind
from mocap_fit.fitting.binding import Binding
from mocap_fit.tracks import FloatArray

_TRANSLATION, _ROTATION, _SCALING = int(Kind.TRANSLATION), int(Kind.ROTATION), int(Kind.SCALING)
_compiled: Any = numba.njit(cache=True, error_model="numpy", nogil=True)


class KernelArrays(NamedTuple):
    """All that the kernel reads, and the room that it works in; see `Binding` for the shapes."""

    rest: FloatArray
    kinds: NDArray[np.int64]
    parameters: NDArray[np.int64]
    weights: FloatArray
    vectors: FloatArray
    centres: FloatArray
    fields: FloatArray
    corners: NDArray[np.int64]
    coordinates: FloatArray
    ring_starts: NDArray[np.int64]
    rings: NDArray[np.int64]
    vertices: FloatArray
    slopes: FloatArray
    d_normal: FloatArray


def kernel_arrays(binding: Binding) -> KernelArrays:
    """Arrays for the kernel, with room of its own; one for every thread that fits."""
    compiled = binding.compiled
    if compiled is None:
        raise ValueError("the rig is not compiled")
    count = len(compiled.rest)
    return KernelArrays(
        compiled.rest,
        compiled.kinds,
        compiled.parameters,
        compiled.weights,
        compiled.vectors,
        compiled.centres,
        compiled.fields,
        np.ascontiguousarray(binding.corners),
        np.ascontiguousarray(binding.coordinates),
        binding.ring_starts,
        np.ascontiguousarray(binding.rings),
        np.empty((count, 3)),
        np.empty((count, 3, compiled.parameter_count)),
        np.empty((3, compiled.parameter_count)),
    )


@_compiled
def _deform(arrays, values):  # type: ignore[no-untyped-def]  # numba infers the types
    """Vertices and their slopes, into the arrays' own room."""
    count = arrays.rest.shape[0]
    x, slopes = arrays.vertices, arrays.slopes
    parameters = slopes.shape[2]
    x[:] = arrays.rest
    slopes[:] = 0.0
    for operation in range(arrays.kinds.shape[0]):
        kind, p = arrays.kinds[operation], arrays.parameters[operation]
        value = values[p]
        v0, v1, v2 = arrays.vectors[operation]
        c0, c1, c2 = arrays.centres[operation]
        if kind == _TRANSLATION:
            for i in range(count):
                w = arrays.weights[operation, i]
                x[i, 0] += value * w * v0
                x[i, 1] += value * w * v1
                x[i, 2] += value * w * v2
                slopes[i, 0, p] += w * v0
                slopes[i, 1, p] += w * v1
                slopes[i, 2, p] += w * v2
        elif kind == _SCALING:
            for i in range(count):
                w = arrays.weights[operation, i]
                if w == 0.0:
                    continue
                for axis in range(3):
                    v = arrays.vectors[operation, axis]
                    if v == 0.0:
                        continue
                    away = x[i, axis] - arrays.centres[operation, axis]
                    factor = 1.0 + value * w * v
                    x[i, axis] = arrays.centres[operation, axis] + factor * away
                    for q in range(parameters):
                        slopes[i, axis, q] *= factor
                    slopes[i, axis, p] += w * v * away
        elif kind == _ROTATION:
            turn = math.sqrt(v0 * v0 + v1 * v1 + v2 * v2)
            a0, a1, a2 = v0 / turn, v1 / turn, v2 / turn
            for i in range(count):
                w = arrays.weights[operation, i]
                if w == 0.0:
                    continue
                angle = value * w * turn
                cosine, sine = math.cos(angle), math.sin(angle)
                rest = 1.0 - cosine
                r00, r11, r22 = (
                    cosine + rest * a0 * a0,
                    cosine + rest * a1 * a1,
                    cosine + rest * a2 * a2,
                )
                r01, r10 = rest * a0 * a1 - sine * a2, rest * a0 * a1 + sine * a2
                r02, r20 = rest * a0 * a2 + sine * a1, rest * a0 * a2 - sine * a1
                r12, r21 = rest * a1 * a2 - sine * a0, rest * a1 * a2 + sine * a0
                d0, d1, d2 = x[i, 0] - c0, x[i, 1] - c1, x[i, 2] - c2
                y0 = r00 * d0 + r01 * d1 + r02 * d2
                y1 = r10 * d0 + r11 * d1 + r12 * d2
                y2 = r20 * d0 + r21 * d1 + r22 * d2
                x[i, 0], x[i, 1], x[i, 2] = c0 + y0, c1 + y1, c2 + y2
                for q in range(parameters):
                    s0, s1, s2 = slopes[i, 0, q], slopes[i, 1, q], slopes[i, 2, q]
                    slopes[i, 0, q] = r00 * s0 + r01 * s1 + r02 * s2
                    slopes[i, 1, q] = r10 * s0 + r11 * s1 + r12 * s2
                    slopes[i, 2, q] = r20 * s0 + r21 * s1 + r22 * s2
                slopes[i, 0, p] += w * (v1 * y2 - v2 * y1)
                slopes[i, 1, p] += w * (v2 * y0 - v0 * y2)
                slopes[i, 2, p] += w * (v0 * y1 - v1 * y0)
        else:
            for i in range(count):
                for axis in range(3):
                    x[i, axis] += value * arrays.fields[operation, i, axis]
                    slopes[i, axis, p] += arrays.fields[operation, i, axis]


@_compiled
def evaluate(arrays, values, positions, jacobian):  # type: ignore[no-untyped-def]
    """Virtual markers (Beskow eq. 2) and their derivative, into arrays given.

    Parameters
    ----------
    arrays
        `KernelArrays`.
    values
        `(parameters,)`.
    positions
        `(markers, 3)`, filled.
    jacobian
        `(markers, 3, parameters)`, filled.
    """
    _deform(arrays, values)
    x, slopes, d_normal = arrays.vertices, arrays.slopes, arrays.d_normal
    parameters = slopes.shape[2]
    for m in range(arrays.corners.shape[0]):
        first, second, third = arrays.corners[m]
        s, t, u = arrays.coordinates[m]
        n0 = n1 = n2 = 0.0
        d_normal[:] = 0.0
        for triangle in range(arrays.ring_starts[m], arrays.ring_starts[m + 1]):
            a, b = arrays.rings[triangle]
            a0, a1, a2 = x[a, 0] - x[first, 0], x[a, 1] - x[first, 1], x[a, 2] - x[first, 2]
            b0, b1, b2 = x[b, 0] - x[first, 0], x[b, 1] - x[first, 1], x[b, 2] - x[first, 2]
            n0 += a1 * b2 - a2 * b1
            n1 += a2 * b0 - a0 * b2
            n2 += a0 * b1 - a1 * b0
            for q in range(parameters):
                f0, f1, f2 = slopes[first, 0, q], slopes[first, 1, q], slopes[first, 2, q]
                e0, e1, e2 = slopes[a, 0, q] - f0, slopes[a, 1, q] - f1, slopes[a, 2, q] - f2
                g0, g1, g2 = slopes[b, 0, q] - f0, slopes[b, 1, q] - f1, slopes[b, 2, q] - f2
                d_normal[0, q] += e1 * b2 - e2 * b1 + a1 * g2 - a2 * g1
                d_normal[1, q] += e2 * b0 - e0 * b2 + a2 * g0 - a0 * g2
                d_normal[2, q] += e0 * b1 - e1 * b0 + a0 * g1 - a1 * g0
        inverse = 1.0 / math.sqrt(n0 * n0 + n1 * n1 + n2 * n2)
        n0, n1, n2 = n0 * inverse, n1 * inverse, n2 * inverse
        r = 1.0 - s - t
        positions[m, 0] = r * x[first, 0] + s * x[second, 0] + t * x[third, 0] + u * n0
        positions[m, 1] = r * x[first, 1] + s * x[second, 1] + t * x[third, 1] + u * n1
        positions[m, 2] = r * x[first, 2] + s * x[second, 2] + t * x[third, 2] + u * n2
        tilt = u * inverse
        for q in range(parameters):
            along = n0 * d_normal[0, q] + n1 * d_normal[1, q] + n2 * d_normal[2, q]
            jacobian[m, 0, q] = (
                r * slopes[first, 0, q]
                + s * slopes[second, 0, q]
                + t * slopes[third, 0, q]
                + tilt * (d_normal[0, q] - along * n0)
            )
            jacobian[m, 1, q] = (
                r * slopes[first, 1, q]
                + s * slopes[second, 1, q]
                + t * slopes[third, 1, q]
                + tilt * (d_normal[1, q] - along * n1)
            )
            jacobian[m, 2, q] = (
                r * slopes[first, 2, q]
                + s * slopes[second, 2, q]
                + t * slopes[third, 2, q]
                + tilt * (d_normal[2, q] - along * n2)
            )


@_compiled
def frame_cost(  # type: ignore[no-untyped-def]
    arrays, values, target, seen, weights, objective, threshold, gradient, positions, jacobian
):
    """Cost of a frame and its gradient; `objective.cost` says what is what.

    Parameters
    ----------
    arrays, values, positions, jacobian
        As for `evaluate`.
    target
        `(markers, 3)`: measured markers; read where they are seen.
    seen
        `(markers,)`: which ones.
    weights
        `(markers,)`.
    objective
        0 distances, 1 squares, 2 Huber with the threshold.
    gradient
        `(parameters,)`, filled.
    """
    evaluate(arrays, values, positions, jacobian)
    gradient[:] = 0.0
    total = 0.0
    for m in range(target.shape[0]):
        if not seen[m]:
            continue
        r0 = positions[m, 0] - target[m, 0]
        r1 = positions[m, 1] - target[m, 1]
        r2 = positions[m, 2] - target[m, 2]
        squared = r0 * r0 + r1 * r1 + r2 * r2
        distance = math.sqrt(squared)
        if objective == 0:
            value, slope = distance, 1.0 / max(distance, 1e-12)
        elif objective == 1 or distance <= threshold:
            value, slope = squared, 2.0
        else:
            value = 2.0 * threshold * distance - threshold * threshold
            slope = 2.0 * threshold / distance
        total += weights[m] * value
        slope *= weights[m]
        for q in range(gradient.shape[0]):
            gradient[q] += slope * (
                r0 * jacobian[m, 0, q] + r1 * jacobian[m, 1, q] + r2 * jacobian[m, 2, q]
            )
    return total
