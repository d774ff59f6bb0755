"""`compute_trajectory` and `jacobian` of dominance.py, compiled: the same values, faster."""

from __future__ import annotations

import math
from typing import Any

import numba
import numpy as np

from mocap_fit.control.dominance import CUT, Frames
from mocap_fit.tracks import FloatArray

_compiled: Any = numba.njit(cache=True, error_model="numpy", nogil=True)


def compute_trajectory(free: FloatArray, frames: Frames) -> FloatArray:
    """Return the trajectory (eq. 8).

    Parameters
    ----------
    free
        Free parameters of all phones of the model, ``(phones, 5)``, no unit.
    frames
        The frames.

    Returns
    -------
    FloatArray
        The articulatory parameter, ``(frames,)``.
    """
    values = np.empty(len(frames))
    _run(*_pack(free, frames), values, np.empty((0, 0)))
    return values


def jacobian(free: FloatArray, frames: Frames) -> tuple[FloatArray, FloatArray]:
    """Return the trajectory and its derivatives (eqs. 9-14, with the sign of eq. 14 corrected).

    Parameters
    ----------
    free
        Free parameters of all phones of the model, ``(phones, 5)``, no unit.
    frames
        The frames.

    Returns
    -------
    trajectory
        The articulatory parameter, ``(frames,)``.
    derivatives
        Five columns for the first distinct phone, then those of the next,
        ``(frames, 5 * distinct)``.
    """
    values = np.empty(len(frames))
    derivatives = np.zeros((len(frames), 5 * len(frames.phones)))
    _run(*_pack(free, frames), values, derivatives)
    return values, derivatives


def _pack(free: FloatArray, frames: Frames) -> tuple[Any, ...]:
    phones = np.ascontiguousarray(free[frames.phones].T)
    phones[4] = np.exp(phones[4])
    return phones, frames.which, frames.first, frames.logarithms, frames.before


@_compiled
def _run(phones, which, first, logarithms, before_of_frame, values, derivatives):  # type: ignore[no-untyped-def]
    frames, width = logarithms.shape
    exponents, powers = np.empty(width), np.empty(width)
    targets = phones[0]
    for frame in range(frames):
        begin, before, count = first[frame], before_of_frame[frame], 0
        largest = -np.inf
        for i in range(width):
            logarithm = logarithms[frame, i]
            if logarithm == np.inf:
                break
            count += 1
            phone = which[begin + i]
            slope = phones[3, phone] if i < before else phones[2, phone]
            power = math.exp(slope + phones[4, phone] * logarithm)
            powers[i] = power
            exponents[i] = phones[1, phone] - power
            largest = max(largest, exponents[i])
        total, product = 0.0, 0.0
        for i in range(count):
            exponent = exponents[i] - largest
            share = math.exp(exponent) if exponent > CUT else 0.0
            exponents[i] = share
            total += share
            product += share * targets[which[begin + i]]
        value = product / total
        values[frame] = value
        if derivatives.size == 0:
            continue
        row = derivatives[frame]
        for i in range(count):
            share = exponents[i] / total
            if share == 0.0:
                continue
            phone = which[begin + i]
            at = 5 * phone
            by_alpha = share * (targets[phone] - value)
            by_power = -by_alpha * powers[i]
            row[at] += share
            row[at + 1] += by_alpha
            row[at + (3 if i < before else 2)] += by_power
            row[at + 4] += by_power * phones[4, phone] * logarithms[frame, i]
