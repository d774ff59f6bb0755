"""Interpolation along time, frame numbers in place of seconds."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
Interpolation = Literal["linear", "pchip", "spline", "slerp", "highest"]

# Parts of a frame: positions this close to a frame are that frame.
_CLOSE = 1e-6


def find_runs(mask: NDArray[np.bool_]) -> list[slice]:
    """Return the stretches of consecutive true values.

    Parameters
    ----------
    mask
        Truth values, no unit, ``(frames,)``.

    Returns
    -------
    list of slice
        The stretches, in order.
    """
    edges = np.diff(np.concatenate([[0], mask.astype(np.int8), [0]]))
    pairs = zip(np.flatnonzero(edges == 1), np.flatnonzero(edges == -1), strict=True)
    return [slice(int(first), int(last)) for first, last in pairs]


def flatten_tracks(values: NDArray[Any]) -> NDArray[Any]:
    """Return an array with one axis of coordinates after those of frames and tracks.

    Parameters
    ----------
    values
        In any unit, ``(frames, tracks, ...)``.

    Returns
    -------
    ndarray
        A view, ``(frames, tracks, coordinates)``; one coordinate where there was no such axis.
    """
    return values.reshape(*values.shape[:2], int(np.prod(values.shape[2:])))


def interpolate(values: NDArray[Any], frames: FloatArray, method: Interpolation) -> NDArray[Any]:
    """Return the values between frames.

    Parameters
    ----------
    values
        In any unit, ``(frames, ...)``, with one frame or more; NaN where missing.
    frames
        Where to interpolate: numbers of frames from 0, ``(times,)``.
    method
        ``linear``: straight lines. ``spline``: a cubic spline through each stretch without gaps,
        of ``(frames, tracks, ...)``. ``slerp``: the shortest turns between rotation matrices,
        ``(frames, bodies, 3, 3)``. ``highest``: the larger one of the two neighbours. With these,
        values are missing beside a gap and more than half a frame outside. ``pchip``: a cubic that
        does not overshoot (Fritsch and Carlson 1980) through the values that are there, of
        ``(frames, tracks)``; the first and last ones hold outside.

    Returns
    -------
    ndarray
        ``(times, ...)``.
    """
    if method == "pchip":
        return _interpolate_monotone(values, frames)
    last = len(values) - 1
    near = np.round(frames)
    positions = np.where(np.abs(frames - near) < _CLOSE, near, frames)
    outside = ~((positions >= -0.5) & (positions <= last + 0.5))
    positions = np.clip(np.where(outside, 0.0, positions), 0.0, last)
    methods: dict[Interpolation, Callable[[NDArray[Any], FloatArray], NDArray[Any]]] = {
        "linear": _interpolate_linearly,
        "spline": _interpolate_by_spline,
        "slerp": _interpolate_rotations,
        "highest": _choose_higher_neighbour,
    }
    result = methods[method](values, positions)
    if outside.any():
        result[outside] = np.nan if result.dtype.kind == "f" else 0
    return result


def _interpolate_monotone(values: FloatArray, frames: FloatArray) -> FloatArray:
    from scipy.interpolate import PchipInterpolator

    result = np.full((len(frames), *values.shape[1:]), np.nan)
    for track in range(values.shape[1]):
        usable = np.flatnonzero(np.isfinite(values[:, track]))
        if len(usable) == 1:
            result[:, track] = values[usable[0], track]
        elif len(usable):
            inside = np.clip(frames, usable[0], usable[-1])
            result[:, track] = PchipInterpolator(usable, values[usable, track])(inside)
    return result


def _interpolate_linearly(values: FloatArray, positions: FloatArray) -> FloatArray:
    before, after = np.floor(positions).astype(np.intp), np.ceil(positions).astype(np.intp)
    share = (positions - before).reshape(-1, *(1 for _ in values.shape[1:]))
    with np.errstate(invalid="ignore"):
        mixed = (1 - share) * values[before] + share * values[after]
    # Nothing of an infinite or missing neighbour where it has no share.
    return np.where(share == 0, values[before], mixed)


def _choose_higher_neighbour(values: NDArray[Any], positions: FloatArray) -> NDArray[Any]:
    before, after = np.floor(positions).astype(np.intp), np.ceil(positions).astype(np.intp)
    return np.asarray(np.maximum(values[before], values[after]))


def _find_inside(run: slice, positions: FloatArray) -> NDArray[np.intp]:
    """Return the positions between the first and last frame of a stretch."""
    return np.flatnonzero((positions >= run.start) & (positions <= run.stop - 1))


def _interpolate_by_spline(values: FloatArray, positions: FloatArray) -> FloatArray:
    from scipy.interpolate import make_interp_spline

    old = flatten_tracks(values)
    result = np.full((len(positions), *old.shape[1:]), np.nan)
    seen = np.asarray(~np.isnan(old).any(axis=2))
    complete = seen.all(axis=0)
    # Tracks without gaps go together, the others one by one.
    groups = [(np.flatnonzero(complete), slice(0, len(old)))] if complete.any() else []
    for track in np.flatnonzero(~complete):
        groups += [(np.array([track]), run) for run in find_runs(seen[:, track])]
    for members, run in groups:
        chosen = _find_inside(run, positions)
        degree = min(3, run.stop - run.start - 1)
        if degree == 0:
            result[np.ix_(chosen, members)] = old[run.start, members]
        elif len(chosen):
            numbers = np.arange(run.start, run.stop)
            spline = make_interp_spline(numbers, old[run, members], k=degree)
            result[np.ix_(chosen, members)] = spline(positions[chosen])
    return result.reshape(len(positions), *values.shape[1:])


def _interpolate_rotations(rotations: FloatArray, positions: FloatArray) -> FloatArray:
    from scipy.spatial.transform import Rotation, Slerp

    result = np.full((len(positions), *rotations.shape[1:]), np.nan)
    for body in range(rotations.shape[1]):
        for run in find_runs(~np.isnan(rotations[:, body, 0, 0])):
            chosen = _find_inside(run, positions)
            matrices = rotations[run, body]
            if len(matrices) == 1:
                result[chosen, body] = matrices
            elif len(chosen):
                turn = Slerp(np.arange(run.start, run.stop), Rotation.from_matrix(matrices))
                result[chosen, body] = turn(positions[chosen]).as_matrix()
    return result
