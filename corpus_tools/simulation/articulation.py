"""From phones to the face: overlapping gestures, with the numbers of ``articulation.toml``.

None of the control models that are trained on it is made like this: there are no dominance
functions and no weighting of vowels by consonants, but gestures that begin and end, and
articulators with inertia that follow them (Saltzman and Munhall 1989). Coarticulation and
undershoot come of it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from corpus_tools.simulation.articulation_table import (
    LEFT_CORNER,
    RIGHT_CORNER,
    Articulation,
    Gesture,
    SpeakerTargets,
    load_articulation,
)
from corpus_tools.simulation.dynamics import (
    JAW,
    LOWER,
    UPPER,
    LipDistance,
    MotionTargets,
    simulate_motion,
)
from corpus_tools.simulation.session import draw_gestures
from corpus_tools.simulation.traits import get_plain_sound, get_traits
from mocap_fit.face import Rig
from mocap_fit.phones import PhoneSegment, PhoneSequence, PhoneSet
from mocap_fit.tracks import FloatArray

# Steps a second of the simulation, and how long a gesture takes to be all there or all gone.
_RATE = 300.0
_RAMP, _LIPS_RAMP = 0.03, 0.06
# Seconds.
_AT_ENDS = 1.0
# The second target of a diphthong is on its way this long before its time.
_GLIDE_LEAD = 0.03
# Hertz: the wandering is slower than this, and made at that rate.
_SLOW, _SLOW_RATE = 0.6, 15.0
_SHIFT = "jaw_shift"


@dataclass(frozen=True, eq=False)
class _Active:
    """A gesture of a phone, in time."""

    gesture: Gesture
    traits: dict[str, float]
    phone: int
    part: int
    start: float
    end: float
    extent: float
    strong: frozenset[str]


class Articulator:
    """The articulation of a simulated speaker.

    Parameters
    ----------
    face
        The speaker's face.
    phone_set
        The phone set of what is said.
    rng
        Generator of the speaker's habits.
    table
        The gestures; those that come with the simulation where it is None.
    """

    def __init__(
        self,
        face: Rig,
        phone_set: PhoneSet,
        rng: np.random.Generator,
        table: Articulation | None = None,
    ) -> None:
        self.table = load_articulation() if table is None else table
        self.names = face.parameter_names
        self._bounds = face.bounds
        self._set = phone_set
        self._traits: dict[str, dict[str, float]] = {}
        self._lips = LipDistance.from_face(face)
        noise = self.table.speaker
        self._left_right = noise.left_right * float(np.clip(rng.standard_normal(), -2, 2))
        side = 1.0 if rng.random() < 0.5 else -1.0
        self._habit = noise.jaw_shift_habit * side * float(rng.uniform(0.6, 1.4))
        self._neutral = np.array([self.table.neutral.targets.get(n, 0.0) for n in self.names])
        self._setting = noise.setting * rng.standard_normal(len(self.names))
        self._targets = SpeakerTargets(self.table, phone_set, self.names, rng)

    def say(self, phones: PhoneSequence, times: FloatArray, rng: np.random.Generator) -> FloatArray:
        """Return the parameters of the face that says an utterance.

        Parameters
        ----------
        phones
            The utterance, with silence before and after.
        times
            Times of the frames, ``(frames,)``, seconds on the clock of the phones.
        rng
            Generator of what varies from utterance to utterance and from gesture to gesture.

        Returns
        -------
        ndarray
            Parameters, ``(frames, parameters)``, full gestures, within the face's bounds.
        """
        first = min(float(times[0]), phones[0].start) - 0.1
        last = max(float(times[-1]), phones[len(phones) - 1].end) + 0.1
        clock = first + np.arange(int(np.ceil((last - first) * _RATE)) + 1) / _RATE
        values = simulate_motion(self._collect_targets(phones, clock, rng), self.names, self._lips)
        corners = [self.names.index(name) for name in (LEFT_CORNER, RIGHT_CORNER)]
        values[:, corners] *= 1.0 + self._left_right * np.array([1.0, -1.0])
        shift = self.names.index(_SHIFT)
        values[:, shift] += self._habit * values[:, self.names.index(JAW)]
        seen = np.stack([np.interp(times, clock, column) for column in values.T], axis=1)
        return np.asarray(np.clip(seen, *self._bounds.T))

    def _collect_targets(
        self, phones: PhoneSequence, clock: FloatArray, rng: np.random.Generator
    ) -> MotionTargets:
        table, names = self.table, self.names
        steps, count = len(clock), len(names)
        varies = table.utterance
        effort = float(np.exp(varies.effort * np.clip(rng.standard_normal(), -2, 2)))
        haste = float(np.exp(varies.haste * np.clip(rng.standard_normal(), -2, 2)))
        weights = np.full((steps, count), table.neutral.strength)
        sums = weights * (self._neutral + self._setting)
        stiff = weights * table.neutral.stiffness
        free = np.ones((steps, 2))
        lips = np.zeros((steps, 4))
        emphasis = self._draw_emphasis(phones, rng)
        for active in self._list_gestures(phones):
            gesture, noise = active.gesture, _Noise(rng, table)
            moves = noise.onset, noise.offset
            stiffness = gesture.stiffness * haste * noise.stiffness
            symbol, part_of_phone, traits = phones[active.phone].phone, active.part, active.traits
            for name in gesture.targets:
                index = names.index(name)
                early = self._find_onset(phones, active, name)
                part, activation = _compute_activation(clock, active, early, moves)
                factor = table.resistance.factor if name in active.strong else 1.0
                goal = self._targets.get_target(symbol, part_of_phone, gesture, name, traits)
                if not active.traits["silence"]:
                    neutral = self._neutral[index]
                    extent = active.extent * effort * emphasis[active.phone] * noise.extent
                    goal = neutral + (goal - neutral) * extent
                    goal += noise.get_offset(name)
                pull = gesture.strength * factor * activation
                weights[part, index] += pull
                sums[part, index] += pull * goal
                stiff[part, index] += pull * stiffness
            if gesture.lips is not None:
                start = active.start
                part, activation = _compute_activation(clock, active, start, moves, _LIPS_RAMP)
                pull = gesture.strength * activation
                share = gesture.lips.share
                # Lips that are to close do, whatever the noise.
                distance = gesture.lips.distance + noise.lips
                if gesture.lips.distance < 0:
                    distance = min(distance, 0.5 * gesture.lips.distance)
                free[part] *= 1.0 - activation[:, None] * [float(share > 0), 1.0]
                lips[part] += pull[:, None] * [1.0, distance, share, stiffness]
        coarse = np.arange(clock[0], clock[-1] + 1.0 / _SLOW_RATE, 1.0 / _SLOW_RATE)
        extents = [varies.jaw_shift if name == _SHIFT else varies.slow for name in names]
        ranges = [(-extent, extent) for extent in extents]
        slow = draw_gestures(rng, len(coarse), _SLOW_RATE, _SLOW, ranges)
        slow = np.stack([np.interp(clock, coarse, column) for column in slow.T], axis=1)
        stiff /= weights
        distance, share, stiffer = (lips[:, 1:] / np.maximum(lips[:, :1], 1e-12)).T
        for i, name in enumerate((UPPER, LOWER)):
            row = stiff[:, names.index(name)]
            row += (1.0 - free[:, i]) * (stiffer - row)
        return MotionTargets(1.0 / _RATE, sums / weights + slow, stiff, 1.0 - free, distance, share)

    def _draw_emphasis(self, phones: PhoneSequence, rng: np.random.Generator) -> list[float]:
        """Draw the factor of the extent of each phone's gestures by the emphasis of its word."""
        noise = self.table.word
        factor, factors = 1.0, []
        for i, segment in enumerate(phones):
            if i == 0 or segment.word != phones[i - 1].word:
                factor = float(np.exp(noise.emphasis * np.clip(rng.standard_normal(), -2, 2)))
            position = (segment.centre - phones[0].start) / phones.duration
            factors.append(factor * (1.0 - noise.declination * (position - 0.5)))
        return factors

    def _list_gestures(self, phones: PhoneSequence) -> Iterator[_Active]:
        """Yield all gestures of an utterance, phone by phone."""
        reduction = self.table.reduction.get(self._set.language, 1.0)
        for i, segment in enumerate(phones):
            phone = self._set.get_phone(segment)
            strong = phone.resists or frozenset()
            for part, (start, end, traits) in enumerate(self._split_phone(segment)):
                for gesture in self.table.gestures:
                    if not gesture.is_met_by(traits):
                        continue
                    lead = gesture.lead if start == segment.start else _GLIDE_LEAD
                    tail = gesture.tail if end == segment.end else 0.0
                    begin, stop = start - lead, end + tail
                    # Before the first phone and after the last all stays as it is.
                    if i == 0:
                        begin -= _AT_ENDS
                    if i == len(phones) - 1:
                        stop = end + _AT_ENDS
                    if stop - begin < _RAMP:
                        continue
                    less = (1.0 - gesture.reduced) * reduction
                    extent = 1.0 - less * {None: 1.0, 0: 1.0, 2: 0.5}.get(segment.stress, 0.0)
                    yield _Active(gesture, traits, i, part, begin, stop, extent, strong)

    def _split_phone(
        self, segment: PhoneSegment
    ) -> Iterator[tuple[float, float, dict[str, float]]]:
        """Yield the parts of a phone that have a target each: two of a diphthong."""
        traits = self._get_traits(segment)
        ends = self.table.diphthongs.ends.get(get_plain_sound(self._set.get_phone(segment)))
        if ends is None:
            yield segment.start, segment.end, traits
            return
        turn = segment.start + self.table.diphthongs.turn * segment.duration
        yield segment.start, turn, traits | ends["from"]
        yield turn, segment.end, traits | ends["to"]

    def _get_traits(self, segment: PhoneSegment) -> dict[str, float]:
        if segment.phone not in self._traits:
            self._traits[segment.phone] = get_traits(self._set.get_phone(segment))
        return self._traits[segment.phone]

    def _find_onset(self, phones: PhoneSequence, active: _Active, parameter: str) -> float:
        """Return when a gesture may begin to show in a parameter.

        It begins no earlier than the end of the last phone with a target for that parameter.
        """
        if not active.gesture.anticipation or active.start > phones[active.phone].start:
            return active.start
        earliest = active.start - active.gesture.anticipation
        for segment in reversed(phones.segments[: active.phone]):
            if segment.end <= earliest:
                break
            traits = self._get_traits(segment)
            rivals = (g for g in self.table.gestures if parameter in g.targets)
            if any(gesture.is_met_by(traits) for gesture in rivals):
                earliest = segment.end
                break
        return min(active.start, earliest)


class _Noise:
    """Random deviations of one gesture."""

    def __init__(self, rng: np.random.Generator, table: Articulation) -> None:
        noise = table.gesture
        draws = np.clip(rng.standard_normal(7), -2.0, 2.0)
        self.onset, self.offset = noise.timing * draws[:2]
        self.stiffness = float(np.exp(noise.stiffness * draws[2]))
        self.extent = float(np.exp(noise.extent * draws[3]))
        self.lips = float(noise.lips * draws[4])
        self._added = float(noise.target * draws[5])
        self._left_right = float(noise.left_right * draws[6])

    def get_offset(self, name: str) -> float:
        """Return what is added to the target of a parameter."""
        return self._added + {LEFT_CORNER: self._left_right, RIGHT_CORNER: -self._left_right}.get(
            name, 0.0
        )


def _compute_activation(
    clock: FloatArray,
    active: _Active,
    early: float,
    moves: tuple[float, float],
    ramp: float = _RAMP,
) -> tuple[slice, FloatArray]:
    """Return the steps at which a gesture is active, and its activation there, 0 to 1."""
    start, end = active.start + moves[0], active.end + moves[1]
    # Half-way in and half-way out at its start and its end; anticipation only ever adds.
    full, begin = start + 0.5 * ramp, start - max(active.start - early, 0.0) - 0.5 * ramp
    gone = end + 0.5 * ramp
    part = slice(
        int(np.searchsorted(clock, begin)), int(np.searchsorted(clock, gone, side="right"))
    )
    times = clock[part]
    rise = np.clip((times - begin) / (full - begin), 0.0, 1.0)
    fall = np.clip((gone - times) / ramp, 0.0, 1.0)
    return part, np.minimum(_smooth(rise), _smooth(fall))


def _smooth(share: FloatArray) -> FloatArray:
    return np.asarray(share * share * (3.0 - 2.0 * share))
