"""nlopt's own C functions, called with a compiled objective: no Python in between.

nlopt's Python wheels contain its C library; where they export its functions, a frame is minimised
without a Python call. Where they do not, or numba is missing, `nlopt_solver.py` does the same
through nlopt's Python classes, slower.
"""

from __future__ import annotations

import ctypes
import math
from functools import cache
from typing import Any

import nlopt
import numba
import numpy as np
from numba import extending
from numpy.typing import NDArray

from mocap_fit.fitting.kernel import evaluate, inner
from mocap_fit.fitting.packed_binding import SLOT, WIDTH, PackedBinding, allocate_aligned
from mocap_fit.tracks import FloatArray

# Numba has no types for a checker to read.
_numba: Any = numba
_types: Any = numba.types
_intrinsic: Any = extending.intrinsic

_DOUBLE, _POINTER, _INT = ctypes.c_double, ctypes.c_void_p, ctypes.c_int
_SIGNATURES: dict[str, tuple[Any, tuple[Any, ...]]] = {
    "nlopt_create": (_POINTER, (_INT, ctypes.c_uint)),
    "nlopt_destroy": (None, (_POINTER,)),
    "nlopt_set_min_objective": (_INT, (_POINTER, _POINTER, _POINTER)),
    "nlopt_set_lower_bounds": (_INT, (_POINTER, _POINTER)),
    "nlopt_set_upper_bounds": (_INT, (_POINTER, _POINTER)),
    "nlopt_set_ftol_rel": (_INT, (_POINTER, _DOUBLE)),
    "nlopt_set_xtol_abs": (_INT, (_POINTER, _POINTER)),
    "nlopt_set_maxeval": (_INT, (_POINTER, _INT)),
    "nlopt_set_initial_step1": (_INT, (_POINTER, _DOUBLE)),
    "nlopt_optimize": (_INT, (_POINTER, _POINTER, _POINTER)),
}


@cache
def load_library() -> Any:
    """Load nlopt's C functions.

    Returns
    -------
    ctypes.CDLL or None
        The library; None where the wheel does not export them.
    """
    try:
        functions = ctypes.CDLL(nlopt._nlopt.__file__)
        for name, (result, arguments) in _SIGNATURES.items():
            function = getattr(functions, name)
            function.restype, function.argtypes = result, list(arguments)
    except (AttributeError, OSError):
        return None
    return functions


@_intrinsic  # type: ignore[untyped-decorator]
def _to_pointer(context: Any, address: Any) -> Any:
    """Convert an integer to a pointer."""

    def generate(code: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.inttoptr(arguments[0], code.get_value_type(signature.return_type))

    return _types.voidptr(_types.int64), generate


@_intrinsic  # type: ignore[untyped-decorator]
def _is_null(context: Any, pointer: Any) -> Any:
    """Return whether a pointer is null: nlopt then wants no gradient."""

    def generate(code: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        word = builder.ptrtoint(arguments[0], code.get_value_type(_types.int64))
        return builder.icmp_signed("==", word, code.get_constant(_types.int64, 0))

    return _types.boolean(pointer), generate


# Rows of the table of addresses and lengths: the arguments of `evaluate`, in order, then these.
_PLAN, _NUMBERS, _WORKSPACE, _FRAME, _ROWS, _PRODUCTS = range(6)
_SETTINGS, _SCALE, _STATE, _BEST, _VALUES, _GRADIENT, _COUNT = range(6, 13)


@inner
def _get_vector(table, row):  # type: ignore[no-untyped-def]
    """Return the array that a row of the table points to."""
    return _numba.carray(_to_pointer(table[row, 0]), table[row, 1], np.float64)


_CALLBACK = _types.float64(
    _types.uint32, _types.CPointer(_types.float64), _types.CPointer(_types.float64), _types.voidptr
)


def _cost(count, point, slope, data):  # type: ignore[no-untyped-def]
    """Return the cost of the frame that the table points to, as nlopt calls it."""
    table = _numba.carray(data, (_COUNT, 2), np.int64)
    plan = _numba.carray(_to_pointer(table[_PLAN, 0]), table[_PLAN, 1], np.uint32)
    numbers = _get_vector(table, np.int64(_NUMBERS))
    workspace = _get_vector(table, np.int64(_WORKSPACE))
    frame, rows = _get_vector(table, np.int64(_FRAME)), _get_vector(table, np.int64(_ROWS))
    products = _get_vector(table, np.int64(_PRODUCTS)).reshape((1, np.int64(count), rows.shape[0]))
    settings, state = _get_vector(table, np.int64(_SETTINGS)), _get_vector(table, np.int64(_STATE))
    scale, best = _get_vector(table, np.int64(_SCALE)), _get_vector(table, np.int64(_BEST))
    values = _get_vector(table, np.int64(_VALUES))
    gradient = _get_vector(table, np.int64(_GRADIENT))
    x = _numba.carray(point, (count,), np.float64)
    for i in range(count):
        values[i] = x[i] * scale[i]
    value = evaluate(
        plan,
        numbers,
        workspace,
        values.reshape((1, values.shape[0])),
        frame,
        int(settings[0]),
        settings[1],
        rows.reshape((1, rows.shape[0])),
        products,
        gradient,
    )
    state[1] += 1.0
    finite = math.isfinite(value)
    for i in range(count):
        finite = finite and math.isfinite(gradient[i])
    if not _is_null(slope):
        g = _numba.carray(slope, (count,), np.float64)
        for i in range(count):
            g[i] = gradient[i] * scale[i] if finite else 0.0
    if not finite:
        # A NaN can hang nlopt's algorithms; a huge cost only rejects the point.
        return 1e30
    if value < state[0]:
        state[0] = value
        for i in range(count):
            best[i] = values[i]
    return value


@cache
def compile_callback() -> Any:
    """Compile the cost to a C callback, once.

    Returns
    -------
    numba cfunc
        The callback, whose ``address`` nlopt takes.
    """
    return _numba.cfunc(_CALLBACK, cache=True, error_model="numpy")(_cost)


class NativeSolver:
    """One of nlopt's algorithms, for the frames of one binding.

    Parameters
    ----------
    packed
        Packed binding.
    objective
        Number of the objective in the kernel.
    threshold
        Huber's threshold, millimetres.
    algorithm
        Number of nlopt's algorithm, such as ``nlopt.LD_SLSQP``.
    scale
        Divisors of the parameters, ``(parameters,)``, no unit: the quotients are nlopt's variables.
    bounds
        Bounds of the parameters, ``(parameters, 2)``; 0 is rest, 1 the full gesture.
    tolerances
        Absolute tolerance of the parameters, and relative tolerance of the cost, no unit.
    maximum_evaluations
        Largest number of evaluations of a frame.

    Raises
    ------
    MemoryError
        If nlopt cannot allocate the solver.
    """

    def __init__(
        self,
        packed: PackedBinding,
        *,
        objective: int,
        threshold: float,
        algorithm: int,
        scale: FloatArray,
        bounds: FloatArray,
        tolerances: tuple[float, float],
        maximum_evaluations: int,
    ) -> None:
        count = packed.parameters
        self._library = load_library()
        self._scale = scale
        self._value = np.zeros(1)
        rows: list[NDArray[Any]] = [
            packed.plan,
            packed.numbers,
            allocate_aligned(packed.workspace_size),
            allocate_aligned(packed.blocks * 4 * WIDTH),
            allocate_aligned(packed.blocks * SLOT),
            allocate_aligned(count * packed.blocks * SLOT),
            np.array([float(objective), threshold]),
            scale,
            np.zeros(2),
            *np.zeros((3, count)),
        ]
        self._table = np.zeros((_COUNT, 2), dtype=np.int64)
        for row, array in enumerate(rows):
            if not array.flags.c_contiguous:
                raise ValueError("the kernel reads contiguous arrays")
            self._table[row] = array.ctypes.data, len(array)
        # The table holds addresses alone: the arrays must live as long.
        self._arrays = rows
        c = self._library
        # LN_PRAXIS draws directions: the same ones, whatever was solved before.
        nlopt.srand(1)
        self._optimiser = c.nlopt_create(algorithm, count)
        if not self._optimiser:
            raise MemoryError("nlopt cannot allocate another solver")
        c.nlopt_set_min_objective(
            self._optimiser, compile_callback().address, self._table.ctypes.data
        )
        self._absolute = np.full(count, tolerances[0]) / scale
        c.nlopt_set_xtol_abs(self._optimiser, self._absolute.ctypes.data)
        c.nlopt_set_ftol_rel(self._optimiser, tolerances[1])
        c.nlopt_set_maxeval(self._optimiser, maximum_evaluations)
        c.nlopt_set_initial_step1(self._optimiser, float(np.median(0.1 / scale)))
        self._lower, self._upper = bounds[:, 0] / scale, bounds[:, 1] / scale
        self._set_bounds(self._lower, self._upper)

    def _set_bounds(self, lower: FloatArray, upper: FloatArray) -> None:
        self._library.nlopt_set_lower_bounds(self._optimiser, lower.ctypes.data)
        self._library.nlopt_set_upper_bounds(self._optimiser, upper.ctypes.data)

    def solve(
        self,
        frames: FloatArray,
        starts: FloatArray | None,
        last: FloatArray,
        fixed: NDArray[np.bool_],
    ) -> tuple[FloatArray, FloatArray, NDArray[np.int64], NDArray[np.int64]]:
        """Minimise the cost of frame after frame.

        Parameters
        ----------
        frames
            Measured markers, ``(frames, blocks · 128)``, millimetres, from `pack_frames`.
        starts
            Where each frame starts, ``(frames, parameters)``, within the bounds; None to start
            from the result of the frame before. 0 is rest, 1 the full gesture.
        last
            Result before the first frame, ``(parameters,)``; 0 is rest, 1 the full gesture.
        fixed
            Which parameters keep their value from the frame before, ``(frames, parameters)``, no
            unit.

        Returns
        -------
        values : ndarray
            The best points of the search, ``(frames, parameters)``.
        costs : ndarray
            Costs at them, ``(frames,)``.
        evaluations : ndarray
            Numbers of evaluations, ``(frames,)``.
        results : ndarray
            nlopt's results, ``(frames,)``.
        """
        count = len(frames)
        frames = np.ascontiguousarray(frames)
        values = np.tile(last, (count, 1)) if starts is None else starts.copy()
        states = np.tile([np.inf, 0.0], (count, 1))
        points = np.clip(values / self._scale, self._lower, self._upper)
        results = np.zeros(count, dtype=np.int64)
        held: NDArray[np.bool_] = np.asarray(fixed.any(axis=1))
        # The solver reads and writes in these arrays, frame by frame: nothing is copied.
        table, optimise, optimiser = self._table, self._library.nlopt_optimize, self._optimiser
        value, point, step = self._value.ctypes.data, points.ctypes.data, points.strides[0]
        frame_rows = [(_FRAME, frames), (_STATE, states), (_BEST, values)]
        for row, array in frame_rows:
            table[row, 0] = array.ctypes.data
        for i in range(count):
            before = last if i == 0 else values[i - 1]
            if starts is None:
                values[i] = before
                points[i] = np.clip(before / self._scale, self._lower, self._upper)
            elif held[i]:
                values[i, fixed[i]] = before[fixed[i]]
                points[i] = np.clip(values[i] / self._scale, self._lower, self._upper)
            if held[i]:
                self._set_bounds(
                    np.where(fixed[i], points[i], self._lower),
                    np.where(fixed[i], points[i], self._upper),
                )
            results[i] = optimise(optimiser, point + i * step, value)
            if held[i]:
                self._set_bounds(self._lower, self._upper)
            for row, array in frame_rows:
                table[row, 0] += array.strides[0]
        return values, states[:, 0], states[:, 1].astype(np.int64), results

    def __del__(self) -> None:
        optimiser = getattr(self, "_optimiser", None)
        if optimiser:
            self._library.nlopt_destroy(optimiser)
