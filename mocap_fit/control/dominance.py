"""The equations of Cohen and Massaro's model (Beskow eqs. 7-14), for one articulatory parameter.

A segment's dominance falls off from its centre; the trajectory is the mean of all targets, weighted
with their dominances. Both are computed from the logarithms of the dominances less the largest of
the frame, so that a frame far from every segment has a trajectory as well. A dominance below
exp(-20) of the frame's largest counts as 0, and so does a segment more than 100 segments away.

Free parameters are in an array ``(phones, 5)``: the target T, and the logarithms of alpha, theta,
phi and c, so that those four are positive.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mocap_fit.control.symbols import IntArray
from mocap_fit.tracks import FloatArray

#: Names of the five free parameters, in order; all but the target are logarithms.
FREE_PARAMETERS = ("target", "alpha", "theta", "phi", "c")

#: Logarithm of the share of a frame's largest dominance below which a dominance counts as 0.
CUT = -20.0
# How many segments before and after a frame count.
_REACH = 100


@dataclass(frozen=True, eq=False)
class Frames:
    """Frames of an utterance, and their distances from the segments.

    Parameters
    ----------
    phones
        The phones of the utterance, each once, ``(distinct,)``.
    which
        Which of them each segment is, ``(segments,)``.
    first
        The first segment that counts, ``(frames,)``.
    logarithms
        Logarithms of the distance in time from each of the segments that count,
        ``(frames, width)``; after the last of them, infinity, which leaves no dominance.
    before
        How many of those have their centre at the frame's time or before it, ``(frames,)``.
    """

    phones: IntArray
    which: IntArray
    first: IntArray
    logarithms: FloatArray
    before: IntArray

    @classmethod
    def from_segments(cls, positions: IntArray, centres: FloatArray, times: FloatArray) -> Frames:
        """Return the frames at some times of an utterance.

        Parameters
        ----------
        positions
            The phone of each segment, ``(segments,)``.
        centres
            The time of each segment's centre, ``(segments,)``, ascending, in any unit.
        times
            The times of the frames, ``(frames,)``, in the same unit.

        Returns
        -------
        Frames
            The frames.
        """
        phones, which = np.unique(positions, return_inverse=True)
        passed = np.searchsorted(centres, times, side="right")
        first = np.maximum(passed - _REACH, 0)
        count = np.minimum(passed + _REACH, len(centres)) - first
        width = int(count.max(initial=0))
        columns = np.arange(width)
        inside = columns < count[:, None]
        segment = np.minimum(first[:, None] + columns, len(centres) - 1)
        distances = np.abs(times[:, None] - centres[segment])
        # At the centre itself: so small that its power is 0, and 0 times its logarithm too.
        logarithms = np.where(inside, np.log(np.maximum(distances, 1e-300)), np.inf)
        return cls(phones, which.ravel(), first, logarithms, passed - first)

    @property
    def segments(self) -> IntArray:
        """The phone, among the distinct ones, of each segment that counts, ``(frames, width)``."""
        columns = self.first[:, None] + np.arange(self.logarithms.shape[1])
        return np.asarray(self.which[np.minimum(columns, len(self.which) - 1)])

    def __len__(self) -> int:
        return len(self.first)


def compute_log_dominances(free: FloatArray, frames: Frames) -> FloatArray:
    """Return the logarithms of the dominances (eq. 7).

    Parameters
    ----------
    free
        Free parameters of all phones of the model, ``(phones, 5)``, no unit.
    frames
        The frames.

    Returns
    -------
    FloatArray
        Of the segments that count for each frame, ``(frames, width)``; minus infinity for none.
    """
    return _compute_exponents(free, frames)[0]


def compute_shares(free: FloatArray, frames: Frames) -> FloatArray:
    """Return the dominances as shares of their sum (eq. 9).

    Parameters
    ----------
    free
        Free parameters of all phones of the model, ``(phones, 5)``, no unit.
    frames
        The frames.

    Returns
    -------
    FloatArray
        Shares, ``(frames, width)``, 0 to 1.
    """
    return _normalise(compute_log_dominances(free, frames))


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
    targets = free[frames.phones, 0][frames.segments]
    result: FloatArray = np.sum(compute_shares(free, frames) * targets, axis=1)
    return result


def _compute_exponents(free: FloatArray, frames: Frames) -> tuple[FloatArray, FloatArray]:
    """Return the logarithms of the dominances, and the powers in them, ``(frames, width)``."""
    phones = free[frames.phones]
    segments = frames.segments
    before = np.arange(segments.shape[1]) < frames.before[:, None]
    # Before its centre a segment rises with theta, from it on it falls with phi.
    slopes = np.where(before, phones[:, 3][segments], phones[:, 2][segments])
    with np.errstate(over="ignore"):
        powers = np.exp(slopes + np.exp(phones[:, 4])[segments] * frames.logarithms)
    return phones[:, 1][segments] - powers, powers


def _normalise(exponents: FloatArray) -> FloatArray:
    exponents = exponents - exponents.max(axis=1, keepdims=True, initial=-np.inf)
    shares = np.where(exponents > CUT, np.exp(np.maximum(exponents, CUT)), 0.0)
    result: FloatArray = shares / shares.sum(axis=1, keepdims=True)
    return result
