"""The equations of Cohen and Massaro's model (Beskow eqs. 7-14), for one articulatory parameter.

A segment's dominance falls off from its centre; the trajectory is the mean of all targets, weighted
with their dominances. Both are computed from the logarithms of the dominances less the largest of
the frame, so that a frame far from every segment has a trajectory as well. A dominance below
exp(-20) of the frame's largest counts as 0, and so does a segment more than 100 segments away.

Free parameters are in an array `(phones, 5)`: the target T, and the logarithms of alpha, theta, phi
and c, which keeps those four positive.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from mocap_fit.control.training import IntArray
from mocap_fit.tracks import FloatArray

#: Names of the five free parameters, in order; all but the target are kept as logarithms.
FREE_PARAMETERS = ("target", "alpha", "theta", "phi", "c")

#: Logarithm of the part of a frame's largest dominance below which one counts as 0.
CUT = -20.0
_REACH = 100


@dataclass(frozen=True, eq=False)
class Frames:
    """Frames of an utterance, and how far they are from the segments.

    Parameters
    ----------
    phones
        `(distinct,)`: the phones of the utterance, each once.
    which
        `(segments,)`: which of them each segment is.
    first
        `(frames,)`: the first segment that counts.
    logarithms
        `(frames, width)`: logarithm of the distance in time from each of the segments that count;
        after the last, infinity, which leaves no dominance.
    left
        `(frames,)`: how many of those have their centre at the frame's time or before it.
    """

    phones: IntArray
    which: IntArray
    first: IntArray
    logarithms: FloatArray
    left: IntArray

    @classmethod
    def of(cls, positions: IntArray, centres: FloatArray, times: FloatArray) -> Frames:
        """Frames at some times.

        Parameters
        ----------
        positions, centres
            `(segments,)`: the phone of each segment, and the time of its centre, ascending.
        times
            `(frames,)`, in the same unit.
        """
        phones, which = np.unique(positions, return_inverse=True)
        passed = np.searchsorted(centres, times, side="right")
        first = np.maximum(passed - _REACH, 0)
        count = np.minimum(passed + _REACH, len(centres)) - first
        width = int(count.max(initial=0))
        columns = np.arange(width)
        inside = columns < count[:, None]
        segment = np.minimum(first[:, None] + columns, len(centres) - 1)
        apart = np.abs(times[:, None] - centres[segment])
        # At the centre itself: so small that its power is 0, and 0 times its logarithm too.
        logarithms = np.where(inside, np.log(np.maximum(apart, 1e-300)), np.inf)
        return cls(phones, which.ravel(), first, logarithms, passed - first)

    def segments(self) -> IntArray:
        """`(frames, width)`: the phone, among the distinct ones, of each segment that counts."""
        columns = self.first[:, None] + np.arange(self.logarithms.shape[1])
        return np.asarray(self.which[np.minimum(columns, len(self.which) - 1)])

    def __len__(self) -> int:
        return len(self.first)


def log_dominances(free: FloatArray, frames: Frames) -> FloatArray:
    """Logarithms of the dominances (eq. 7).

    Parameters
    ----------
    free
        `(phones, 5)`, of all phones of the model.
    frames
        The frames.

    Returns
    -------
    FloatArray
        `(frames, width)`, of the segments that count for each frame; minus infinity for none.
    """
    return _exponents(free, frames)[0]


def weights(free: FloatArray, frames: Frames) -> FloatArray:
    """The dominances as parts of their sum, `(frames, width)` (eq. 9)."""
    return _shares(log_dominances(free, frames))


def trajectory(free: FloatArray, frames: Frames) -> FloatArray:
    """The trajectory, `(frames,)` (eq. 8)."""
    targets = free[frames.phones, 0][frames.segments()]
    result: FloatArray = np.sum(weights(free, frames) * targets, axis=1)
    return result


def jacobian(free: FloatArray, frames: Frames) -> tuple[FloatArray, FloatArray]:
    """The trajectory and its derivatives by the free parameters of the utterance's phones.

    Equations 9-14, with the sign of eq. 14 put right (dD/dc is negative where the distance is more
    than one unit of time), and by the logarithms of alpha, theta, phi and c. At a segment's own
    centre the derivatives by theta, phi and c are 0.

    Parameters
    ----------
    free
        `(phones, 5)`.
    frames
        The frames.

    Returns
    -------
    trajectory
        `(frames,)`.
    derivatives
        `(frames, 5 * distinct)`: the five of the first distinct phone, then those of the next.
    """
    exponents, powers = _exponents(free, frames)
    shares = _shares(exponents)
    segments = frames.segments()
    targets = free[frames.phones, 0][segments]
    values = np.sum(shares * targets, axis=1)
    by_alpha = shares * (targets - values[:, None])
    by_power = -by_alpha * np.where(shares > 0, powers, 0.0)
    before = np.arange(powers.shape[1]) < frames.left[:, None]
    c = np.exp(free[frames.phones, 4])[segments]
    logarithms = np.where(shares > 0, frames.logarithms, 0.0)
    five = (
        shares,
        by_alpha,
        np.where(before, 0.0, by_power),
        np.where(before, by_power, 0.0),
        by_power * c * logarithms,
    )
    derivatives = np.zeros((len(frames), len(frames.phones), 5))
    rows = np.arange(len(frames))[:, None]
    for position, each in enumerate(five):
        np.add.at(derivatives[:, :, position], (rows, segments), each)
    return values, derivatives.reshape(len(frames), -1)


def _exponents(free: FloatArray, frames: Frames) -> tuple[FloatArray, FloatArray]:
    """Logarithms of the dominances, and the powers that were taken from them, `(frames, width)`."""
    own = free[frames.phones]
    segments = frames.segments()
    before = np.arange(segments.shape[1]) < frames.left[:, None]
    # Before its centre a segment rises with theta, from it on it falls with phi.
    slopes = np.where(before, own[:, 3][segments], own[:, 2][segments])
    with np.errstate(over="ignore"):
        powers = np.exp(slopes + np.exp(own[:, 4])[segments] * frames.logarithms)
    return own[:, 1][segments] - powers, powers


def _shares(exponents: FloatArray) -> FloatArray:
    exponents = exponents - exponents.max(axis=1, keepdims=True, initial=-np.inf)
    shares = np.where(exponents > CUT, np.exp(np.maximum(exponents, CUT)), 0.0)
    result: FloatArray = shares / shares.sum(axis=1, keepdims=True)
    return result


def compiled_kernel() -> Any:
    """The module of compiled functions, or None without numba, and then all is the same, slower."""
    try:
        from mocap_fit.control import dominance_kernel
    except ImportError:
        return None
    return dominance_kernel
