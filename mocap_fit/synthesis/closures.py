"""Lips that close on p, b and m, whatever a control model says of them.

A control model averages over what it has learned, and the sound goes on where the lips have not
met: speech that is to be read from the lips needs every closure. `close_lips` changes a movement
as little as it can so that the lips touch along their whole line on every bilabial, and open and
close at a limited speed.

The largest gap along the lip line is limited: to `CLOSED` during a closure, and beside it to what
opens at `SPEED` from there. A movement that is faster by itself opens earlier. Where it does not
keep these limits, it goes to near parameters within the rig's bounds that do: by Newton's method,
each step the smallest change that brings the place that is open most to its target without
pressing another one too far. Such a change may be large where the gap is small, as that of a jaw
which keeps the corners apart: no point of the face comes to it or leaves it faster than `SPEED`.
"""

from __future__ import annotations

import math
import sys
from collections import deque
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from mocap_fit.errors import DataError
from mocap_fit.face.lips import LipLine, find_lip_line
from mocap_fit.face.mesh import IndexArray
from mocap_fit.face.rig import Rig, deform_points, evaluate_jacobian
from mocap_fit.phones import PhoneSegment, PhoneSet
from mocap_fit.tracks import FloatArray

CLOSED = 0.35
"""Millimetres: the gap of a closure that is reached; 0.5 counts as closed."""
SPEED = 340.0
"""Millimetres a second. Real lips open with 257 at most, but synthetic speech has open vowels of
half the length beside its bilabials, and more than a tenth of their opening would be lost."""
PRESSED = 0.5
"""Millimetres by which lips may be pressed into each other on the way to a closure."""

# At the beginning of a bilabial the lips are still moving, and at its end already: so much of its
# duration, and at most so many seconds.
_MOVING, _LONGEST_MOVING = 0.25, 0.015
# Seconds after which a closure no longer limits the gap.
_LONGEST_OPENING = 0.5
_STEPS = 20
# Of a frame: times that are nearer are the same.
_ROUNDING = 1e-6
# How far the face moves is measured at one of so many vertices.
_EVERY = 10
# Millimetres: a limit counts as kept; a place counts as far inside its limits.
_TOLERANCE, _MARGIN = 0.002, 0.05


class Interval(NamedTuple):
    """Frames in which the lips are closed.

    Parameters
    ----------
    start
        Time of the first frame, seconds.
    end
        Time of the last frame, seconds.
    """

    start: float
    end: float


class Before(NamedTuple):
    """The frame before those that are closed.

    Parameters
    ----------
    time
        Its time, seconds.
    gap
        Its largest gap along the lip line, millimetres.
    change
        By how much its parameters were changed, ``(parameters,)``, in the order of the rig.
    """

    time: float
    gap: float
    change: FloatArray


def find_closures(
    phones: Iterable[PhoneSegment],
    phone_set: PhoneSet,
    rate: float,
    start_time: float = 0.0,
    frames: int | None = None,
) -> tuple[Interval, ...]:
    """Find the frames in which the lips must be closed.

    Bilabials that touch are one closure. A bilabial without a frame closes in the nearest one, if
    that is at most half a frame away.

    Parameters
    ----------
    phones
        Phones of an utterance, in the order of time.
    phone_set
        Their phone set.
    rate
        Rate of the frames, hertz.
    start_time
        Time of the first frame, seconds; without a number of frames, of any of them.
    frames
        Number of frames; None where there are frames at all times.

    Returns
    -------
    tuple of Interval
        In the order of time.
    """
    closures: list[Interval] = []
    last = -math.inf
    for segment in phones:
        if "bilabial_stop" not in phone_set.get_phone(segment).get_classes():
            continue
        start, end = ((time - start_time) * rate for time in (segment.start, segment.end))
        closed = _find_frames(start, end, rate, frames)
        if closed is None:
            continue
        closure = Interval(*(start_time + frame / rate for frame in closed))
        if segment.start - last < 1e-6:
            closures[-1] = Interval(closures[-1].start, closure.end)
        else:
            closures.append(closure)
        last = segment.end
    return tuple(closures)


def _find_frames(
    start: float, end: float, rate: float, frames: int | None
) -> tuple[int, int] | None:
    """Return the first and the last frame of a bilabial; all but the rate is in frames."""
    exists = range(-sys.maxsize, sys.maxsize) if frames is None else range(frames)
    moving = min(_MOVING * (end - start), _LONGEST_MOVING * rate)
    first, last = math.ceil(start + moving - _ROUNDING), math.floor(end - moving + _ROUNDING)
    if first <= last:
        first, last = max(first, exists.start), min(last, exists.stop - 1)
        return (first, last) if first <= last else None
    apart = {i: max(start - i, i - end) for i in (last, first) if i in exists}
    nearest = min(apart, key=lambda i: apart[i], default=None)
    return None if nearest is None or apart[nearest] > 0.5 + _ROUNDING else (nearest, nearest)


def close_lips(
    values: FloatArray,
    times: FloatArray,
    closures: Sequence[Interval],
    rig: Rig,
    names: Sequence[str] | None = None,
    before: Before | None = None,
) -> FloatArray:
    """Change a movement as little as possible so that the lips close.

    Parameters
    ----------
    values
        Face parameters, ``(frames, parameters)``, full gestures; frames with NaN stay as they are.
    times
        ``(frames,)``, seconds, ascending.
    closures
        When the lips are closed.
    rig
        The face.
    names
        Names of the parameters; those of the rig where it is None. Parameters that the rig lacks
        stay as they are, and those that the movement lacks are at rest.
    before
        The frame before these, from which the lips go on.

    Returns
    -------
    ndarray
        Face parameters, ``(frames, parameters)``, full gestures. Frames that keep the limits
        already are the same to the bit.

    Raises
    ------
    DataError
        If the movement has no parameter of the rig.
    ConfigurationError
        If the mesh has no lip line.
    """
    line, result = find_lip_line(rig.mesh), values.copy()
    index, chosen = _match_parameters(rig, names)
    known = np.flatnonzero(np.isfinite(values).all(axis=1))
    if not len(known):
        return result
    full = np.zeros((len(known), len(rig.parameter_names)))
    full[:, index] = values[np.ix_(known, chosen)]
    fixed = np.setdiff1d(np.arange(full.shape[1]), index)
    times, gaps = times[known], _measure_largest(rig, line, full)
    limits = _limit_by_closures(times, closures)
    closed = np.flatnonzero(limits <= CLOSED)
    targets = np.minimum(gaps, limits)[closed]
    changes = _match_gaps(rig, line, full[closed], targets, fixed) - full[closed]
    eased = full + _ease(rig, full, times, closed, changes, before)
    # The mouth opens earlier rather than less where the movement is faster than lips are.
    gaps = _measure_largest(rig, line, eased)
    targets = np.minimum(_raise_to_speed(gaps, times), limits)
    if before is not None:
        reach = SPEED * (times - before.time)
        targets = np.clip(targets, before.gap - reach, before.gap + reach)
    result[np.ix_(known, chosen)] = _match_gaps(rig, line, eased, targets, fixed)[:, index]
    return result


def _measure_largest(rig: Rig, line: LipLine, values: FloatArray) -> FloatArray:
    """Return the largest gap of every frame."""
    gaps = line.measure(deform_points(rig, line.vertices, values))
    return np.asarray(gaps.max(axis=1))


def _ease(
    rig: Rig,
    values: FloatArray,
    times: FloatArray,
    closed: IndexArray,
    changes: FloatArray,
    before: Before | None,
) -> FloatArray:
    """Return changes of all frames that lead to those of the closed ones, and away, at `SPEED`."""
    result = np.zeros_like(values)
    if len(closed):
        durations = _measure_ways(rig, values[closed], values[closed] + changes) / SPEED
        following = np.searchsorted(closed, np.arange(len(times)))
        total = np.zeros(len(times))
        for near in (following - 1, following):
            inside = (near >= 0) & (near < len(closed))
            near = np.clip(near, 0, len(closed) - 1)
            apart = np.abs(times - times[closed[near]]) / durations[near]
            shares = np.where(inside, np.maximum(1.0 - apart, 0.0), 0.0)
            result += shares[:, None] * changes[near]
            total += shares
        result /= np.maximum(total, 1.0)[:, None]
        result[closed] = changes
    if before is not None:
        first = _measure_ways(rig, values[:1] + before.change, values[:1] + result[:1]) / SPEED
        share = np.minimum((times - before.time) / first, 1.0)[:, None]
        result = share * result + (1.0 - share) * before.change
    return result


def _measure_ways(rig: Rig, start: FloatArray, end: FloatArray) -> FloatArray:
    """Return how far points of the face move from one pose to another, a little at least."""
    points = np.arange(0, len(rig.mesh.vertices), _EVERY)
    apart = deform_points(rig, points, end) - deform_points(rig, points, start)
    return np.asarray(np.linalg.norm(apart, axis=2).max(axis=1)) + _TOLERANCE


def limit_to_bounds(values: FloatArray, rig: Rig, names: Sequence[str]) -> FloatArray:
    """Limit parameters to the bounds of a face, as drawing does.

    Parameters
    ----------
    values
        Face parameters, ``(frames, parameters)``, full gestures.
    rig
        The face.
    names
        Names of the parameters.

    Returns
    -------
    ndarray
        ``(frames, parameters)``, full gestures. Parameters that the rig lacks stay as they are.
    """
    index, chosen = _match_parameters(rig, names)
    result = values.copy()
    result[:, chosen] = np.clip(values[:, chosen], *rig.bounds[index].T)
    return result


class LipCloser:
    """Closes the lips of frames that come one after another, for the phones known by then.

    Parameters
    ----------
    rig
        The face.
    phone_set
        The phone set of the phones.
    names
        Names of the parameters of the frames.
    """

    def __init__(self, rig: Rig, phone_set: PhoneSet, names: Sequence[str]) -> None:
        self._rig, self._phone_set, self._names = rig, phone_set, tuple(names)
        self._line = find_lip_line(rig.mesh)
        self._phones: deque[PhoneSegment] = deque()
        self._before: Before | None = None

    def push(self, segment: PhoneSegment) -> None:
        """Add the next phone.

        Parameters
        ----------
        segment
            The phone, of the phone set.
        """
        self._phones.append(segment)

    def close(self, values: FloatArray, times: FloatArray, rate: float) -> FloatArray:
        """Close the lips of the frames that follow.

        Parameters
        ----------
        values
            Face parameters, ``(frames, parameters)``, full gestures.
        times
            ``(frames,)``, seconds, at even distances.
        rate
            Rate of the frames, hertz.

        Returns
        -------
        ndarray
            Face parameters, ``(frames, parameters)``, full gestures.
        """
        if not len(values):
            return values
        while self._phones and self._phones[0].end < times[0] - _LONGEST_OPENING:
            self._phones.popleft()
        values = limit_to_bounds(values, self._rig, self._names)
        closures = find_closures(self._phones, self._phone_set, rate, float(times[0]))
        result = close_lips(values, times, closures, self._rig, self._names, self._before)
        index, chosen = _match_parameters(self._rig, self._names)
        last, change = np.zeros((2, 1, len(self._rig.parameter_names)))
        last[0, index] = result[-1, chosen]
        change[0, index] = result[-1, chosen] - values[-1, chosen]
        gap = float(_measure_largest(self._rig, self._line, last)[0])
        self._before = Before(float(times[-1]), gap, change[0])
        return result


def _match_parameters(rig: Rig, names: Sequence[str] | None) -> tuple[IndexArray, IndexArray]:
    """Return the indices of the parameters that rig and movement share, in either."""
    names = rig.parameter_names if names is None else names
    shared = [name for name in names if name in rig.parameter_names]
    if not shared:
        raise DataError(
            "the lips of this face cannot be closed: it has none of the parameters",
            found=", ".join(names),
            expected=", ".join(rig.parameter_names),
        )
    index = np.array([rig.parameter_names.index(name) for name in shared])
    return index, np.array([list(names).index(name) for name in shared])


def _limit_by_closures(times: FloatArray, closures: Sequence[Interval]) -> FloatArray:
    """Return the largest gap that closures allow at each time."""
    limits = np.full(len(times), np.inf)
    for closure in closures:
        apart = np.maximum(np.maximum(closure.start - times, times - closure.end), 0.0)
        # Some places are pressed while others just touch: they too have to open in time.
        np.minimum(limits, np.maximum(CLOSED, SPEED * apart + 0.5 * CLOSED - PRESSED), out=limits)
    return limits


def _raise_to_speed(gaps: FloatArray, times: FloatArray) -> FloatArray:
    """Return the smallest gaps, at least those given, that change no faster than `SPEED`."""
    result = gaps.copy()
    steps = SPEED * np.diff(times)
    for i in range(1, len(times)):
        result[i] = max(result[i], result[i - 1] - steps[i - 1])
    for i in range(len(times) - 1, 0, -1):
        result[i - 1] = max(result[i - 1], result[i] - steps[i - 1])
    return result


def _differentiate_gaps(
    rig: Rig, line: LipLine, values: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return gaps ``(frames, places)`` and their derivatives ``(frames, places, parameters)``."""
    compiled = rig.compile(line.vertices)
    if compiled is not None:
        points, jacobian = evaluate_jacobian(compiled, values)
    else:
        points = np.stack([rig.deform(row)[line.vertices] for row in values])
        jacobian = np.stack([rig.jacobian(row)[line.vertices] for row in values])
    return line.measure(points), np.einsum("kv,fvp->fkp", line.weights, jacobian[:, :, 1])


def _match_gaps(
    rig: Rig, line: LipLine, values: FloatArray, targets: FloatArray, fixed: IndexArray
) -> FloatArray:
    """Return near parameters whose largest gap is the target, as far as the bounds allow."""
    gaps = line.measure(deform_points(rig, line.vertices, values))
    other = np.abs(gaps.max(axis=1) - targets) > _TOLERANCE
    least = np.minimum(gaps, 0.5 * targets[:, None] - PRESSED)
    result = values.copy()
    result[other] = _drive_to_gaps(rig, line, values[other], least[other], targets[other], fixed)
    return result


def _drive_to_gaps(
    rig: Rig,
    line: LipLine,
    values: FloatArray,
    least: FloatArray,
    targets: FloatArray,
    fixed: IndexArray,
) -> FloatArray:
    """Return near parameters whose largest gap is the target, and no gap is below the least."""
    low, high = rig.bounds.T
    values = values.copy()
    rows = np.arange(len(values))
    for _ in range(_STEPS):
        gaps, jacobian = _differentiate_gaps(rig, line, values)
        # The place that is open most, and the one that is pressed too far, or nearest to that.
        places = np.stack([gaps.argmax(axis=1), (least - gaps).argmax(axis=1)], axis=1)
        excess = np.stack([gaps.max(axis=1) - targets, (least - gaps).max(axis=1)], axis=1)
        done = (np.abs(excess[:, 0]) <= _TOLERANCE) & (excess[:, 1] <= _TOLERANCE)
        if done.all():
            break
        slopes = jacobian[rows[:, None], places] * np.array([1.0, -1.0])[:, None]
        slopes[:, :, fixed] = 0.0
        # A step that closes one place would press another: both go to their limits, unless the
        # other is far inside.
        slopes[excess[:, 1] < -_MARGIN, 1] = 0.0
        slopes[done] = 0.0
        # A parameter at its bound cannot help.
        combined = (slopes * excess[:, :, None]).sum(axis=1)
        stuck = ((values <= low) & (combined > 0)) | ((values >= high) & (combined < 0))
        slopes = np.where(stuck[:, None], 0.0, slopes)
        gram = slopes @ slopes.transpose(0, 2, 1) + 1e-6 * np.eye(2)
        amounts = np.linalg.solve(gram, excess[:, :, None])
        values = np.clip(values - (slopes * amounts).sum(axis=1), low, high)
    return values
