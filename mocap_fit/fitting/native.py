"""nlopt's own C functions, called with a compiled objective: no Python in between.

nlopt's Python wheels hold its C library; where they let its functions be seen, a whole frame is
minimised without a Python call. Where they do not, or numba is not there, `nlopt_solver.py` does
the same through nlopt's Python classes, slower.
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

from mocap_fit.fitting.kernel import Room, compiled, cost
from mocap_fit.fitting.slots import Slots
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
def library() -> Any:
    """Nlopt's C functions, or None where the wheel does not show them."""
    try:
        found = ctypes.CDLL(nlopt._nlopt.__file__)
        for name, (result, arguments) in _SIGNATURES.items():
            function = getattr(found, name)
            function.restype, function.argtypes = result, list(arguments)
    except (AttributeError, OSError):
        return None
    return found


@_intrinsic  # type: ignore[untyped-decorator]
def _pointer(context: Any, address: Any) -> Any:
    """A number as a pointer."""

    def generate(code: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.inttoptr(arguments[0], code.get_value_type(signature.return_type))

    return _types.voidptr(_types.int64), generate


@_intrinsic  # type: ignore[untyped-decorator]
def _is_null(context: Any, pointer: Any) -> Any:
    """Whether a pointer points nowhere: nlopt then asks for no gradient."""

    def generate(code: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        word = builder.ptrtoint(arguments[0], code.get_value_type(_types.int64))
        return builder.icmp_signed("==", word, code.get_constant(_types.int64, 0))

    return _types.boolean(pointer), generate


@compiled
def _vector(table, row):  # type: ignore[no-untyped-def]
    return _numba.carray(_pointer(table[row, 0]), table[row, 1], np.float64)


@compiled
def _matrix(table, row):  # type: ignore[no-untyped-def]
    return _numba.carray(_pointer(table[row, 0]), (table[row, 1], table[row, 2]), np.float64)


@compiled
def _indices(table, row):  # type: ignore[no-untyped-def]
    return _numba.carray(_pointer(table[row, 0]), table[row, 1], np.int64)


@compiled
def _index_pairs(table, row):  # type: ignore[no-untyped-def]
    return _numba.carray(_pointer(table[row, 0]), (table[row, 1], 2), np.int64)


# Rows of the table: ten arrays and three counts of `Slots`, seven arrays of `Room`, then these.
_COUNTS, _ROOM, _FRAME, _SETTINGS, _SCALE, _STATE, _BEST, _VALUES, _SLOPES = (
    10,
    11,
    18,
    19,
    20,
    21,
    22,
    23,
    24,
)
_ROWS = 25
_CALLBACK = _types.float64(
    _types.uint32, _types.CPointer(_types.float64), _types.CPointer(_types.float64), _types.voidptr
)


@_numba.cfunc(_CALLBACK, cache=True, error_model="numpy")
def _objective(count, point, slope, data):  # type: ignore[no-untyped-def]
    """The cost of the frame that the table points to, for nlopt."""
    table = _numba.carray(data, (_ROWS, 3), np.int64)
    slots = Slots(
        _vector(table, 0),
        _indices(table, 1),
        _index_pairs(table, 2),
        _indices(table, 3),
        _matrix(table, 4),
        _indices(table, 5),
        _matrix(table, 6),
        _matrix(table, 7),
        _matrix(table, 8),
        _vector(table, 9),
        table[_COUNTS, 0],
        table[_COUNTS, 1],
        table[_COUNTS, 2],
    )
    room = Room(
        _vector(table, _ROOM),
        _matrix(table, _ROOM + 1),
        _matrix(table, _ROOM + 2),
        _vector(table, _ROOM + 3),
        _vector(table, _ROOM + 4),
        _matrix(table, _ROOM + 5),
        _matrix(table, _ROOM + 6),
    )
    settings, state = _vector(table, _SETTINGS), _vector(table, _STATE)
    scale, best = _vector(table, _SCALE), _vector(table, _BEST)
    values, slopes = _vector(table, _VALUES), _vector(table, _SLOPES)
    x = _numba.carray(point, (count,), np.float64)
    for i in range(count):
        values[i] = x[i] * scale[i]
    value = cost(slots, values, _vector(table, _FRAME), int(settings[0]), settings[1], room, slopes)
    state[1] += 1.0
    finite = math.isfinite(value)
    for i in range(count):
        finite = finite and math.isfinite(slopes[i])
    if not _is_null(slope):
        g = _numba.carray(slope, (count,), np.float64)
        for i in range(count):
            g[i] = slopes[i] * scale[i] if finite else 0.0
    if not finite:
        # A NaN can hang nlopt's algorithms; a huge cost only turns them back.
        return 1e30
    if value < state[0]:
        state[0] = value
        for i in range(count):
            best[i] = values[i]
    return value


class NativeSolver:
    """One of nlopt's algorithms on one binding's frames.

    Parameters
    ----------
    slots, room
        The packed binding, and room of its own.
    objective, threshold
        As in `kernel.residuals`.
    algorithm
        nlopt's number of it, such as ``nlopt.LD_SLSQP``.
    scale
        `(parameters,)`: the solver's variables are the parameters over these.
    bounds
        `(parameters, 2)`.
    tolerances
        Of the parameters, and of the cost as a part of it.
    maximum_evaluations
        Of a frame.
    """

    def __init__(
        self,
        slots: Slots,
        room: Room,
        *,
        objective: int,
        threshold: float,
        algorithm: int,
        scale: FloatArray,
        bounds: FloatArray,
        tolerances: tuple[float, float],
        maximum_evaluations: int,
    ) -> None:
        count = slots.parameters
        self._library = library()
        self._scale, self._bounds = scale, bounds
        self._state = np.zeros(2)
        self.best = np.zeros(count)
        self._x, self._value = np.zeros(count), np.zeros(1)
        self._frame = np.zeros(slots.blocks * 128)
        settings = np.array([float(objective), threshold])
        rows = [
            *slots[:10],
            np.array([], dtype=np.int64),
            *room,
            self._frame,
            settings,
            scale,
            self._state,
            self.best,
            np.zeros(count),
            np.zeros(count),
        ]
        self._table = np.zeros((_ROWS, 3), dtype=np.int64)
        for row, array in enumerate(rows):
            if not array.flags.c_contiguous:
                raise ValueError("the kernel reads contiguous arrays")
            shape = (*array.shape, 0, 0)
            self._table[row] = array.ctypes.data, shape[0], shape[1]
        self._table[_COUNTS] = slots.slots, slots.blocks, slots.parameters
        # The table holds addresses alone: what they point to must live as long.
        self._kept = rows
        c = self._library
        # LN_PRAXIS draws directions: the same ones, whatever was solved before.
        nlopt.srand(1)
        self._optimiser = c.nlopt_create(algorithm, count)
        c.nlopt_set_min_objective(self._optimiser, _objective.address, self._table.ctypes.data)
        self._absolute = np.full(count, tolerances[0]) / scale
        c.nlopt_set_xtol_abs(self._optimiser, self._absolute.ctypes.data)
        c.nlopt_set_ftol_rel(self._optimiser, tolerances[1])
        c.nlopt_set_maxeval(self._optimiser, maximum_evaluations)
        c.nlopt_set_initial_step1(self._optimiser, float(np.median(0.1 / scale)))
        self._lower, self._upper = bounds[:, 0] / scale, bounds[:, 1] / scale
        self._set_bounds(self._lower, self._upper)
        self._held = False

    def _set_bounds(self, lower: FloatArray, upper: FloatArray) -> None:
        self._library.nlopt_set_lower_bounds(self._optimiser, lower.ctypes.data)
        self._library.nlopt_set_upper_bounds(self._optimiser, upper.ctypes.data)

    @property
    def best_cost(self) -> float:
        """The least cost that was met."""
        return float(self._state[0])

    @property
    def evaluations(self) -> int:
        """How often the cost was evaluated."""
        return int(self._state[1])

    def solve(self, frame: FloatArray, start: FloatArray, fixed: FloatArray | None) -> int:
        """Minimise the cost of a frame; the answer is `best`.

        Parameters
        ----------
        frame
            From `pack_frames`.
        start
            `(parameters,)`, within the bounds.
        fixed
            `(parameters,)`: which keep their value; None for none.

        Returns
        -------
        int
            nlopt's result.
        """
        self._frame[:] = frame
        self._state[0], self._state[1] = np.inf, 0.0
        self.best[:] = start
        np.divide(start, self._scale, out=self._x)
        np.clip(self._x, self._lower, self._upper, out=self._x)
        if fixed is not None:
            self._set_bounds(
                np.where(fixed, self._x, self._lower), np.where(fixed, self._x, self._upper)
            )
            self._held = True
        elif self._held:
            self._set_bounds(self._lower, self._upper)
            self._held = False
        return int(
            self._library.nlopt_optimize(
                self._optimiser, self._x.ctypes.data, self._value.ctypes.data
            )
        )

    def __del__(self) -> None:
        optimiser = getattr(self, "_optimiser", None)
        if optimiser:
            self._library.nlopt_destroy(optimiser)
