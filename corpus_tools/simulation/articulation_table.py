"""The table ``articulation.toml``, and the targets that one speaker makes of it."""

from __future__ import annotations

from functools import cache

import numpy as np
from pydantic import Field

from corpus_tools.simulation.traits import Rule, get_traits, load_table
from mocap_fit.phones import PhoneSet
from mocap_fit.settings_file import StrictModel

LEFT_CORNER, RIGHT_CORNER = "left_corner_stretch", "right_corner_stretch"

Sum = float | dict[str, float]


class _Lips(StrictModel):
    distance: float
    share: float


class Gesture(Rule):
    """What a face does for the phones that have some traits, as the table's head explains."""

    name: str
    contact: bool = False
    lead: float
    tail: float
    anticipation: float = 0.0
    stiffness: float
    strength: float
    reduced: float = 1.0
    targets: dict[str, Sum] = Field(default={})
    lips: _Lips | None = None


class _Neutral(StrictModel):
    stiffness: float
    strength: float
    targets: dict[str, float]


class _SpeakerNoise(StrictModel):
    targets: float
    left_right: float
    jaw_shift_habit: float
    setting: float


class _UtteranceNoise(StrictModel):
    effort: float
    haste: float
    slow: float
    jaw_shift: float


class _WordNoise(StrictModel):
    emphasis: float
    declination: float


class _GestureNoise(StrictModel):
    extent: float
    target: float
    timing: float
    stiffness: float
    lips: float
    left_right: float


class _Resistance(StrictModel):
    factor: float


class _Diphthongs(StrictModel):
    turn: float
    ends: dict[str, dict[str, dict[str, float]]]


class Articulation(StrictModel):
    """The table ``articulation.toml``."""

    neutral: _Neutral
    gestures: tuple[Gesture, ...]
    speaker: _SpeakerNoise
    utterance: _UtteranceNoise
    word: _WordNoise
    gesture: _GestureNoise
    resistance: _Resistance
    reduction: dict[str, float]
    diphthongs: _Diphthongs


@cache
def load_articulation() -> Articulation:
    """Load the table that comes with the simulation.

    Returns
    -------
    Articulation
        The gestures of all phones, and how much they vary.
    """
    return load_table("articulation", Articulation)


class SpeakerTargets:
    """The targets of one speaker: those of the table, each moved by an amount that is drawn once.

    A target moves by ``speaker.targets`` times the standard deviation of its parameter's targets
    over the vowels of the phone set, and never beyond the outermost target of all its sounds. The
    corners of the mouth move alike. Contacts are the same for all speakers.

    Parameters
    ----------
    table
        The gestures.
    phone_set
        The phone set of what is said.
    names
        Names of the parameters.
    rng
        Generator of the speaker's habits.
    """

    def __init__(
        self,
        table: Articulation,
        phone_set: PhoneSet,
        names: tuple[str, ...],
        rng: np.random.Generator,
    ) -> None:
        sounds = [phone for phone in phone_set.phones if phone.kind != "silence"]
        self._rows = {phone.symbol: row for row, phone in enumerate(sounds)}
        self._columns = {name: column for column, name in enumerate(names)}
        targets: dict[str, list[float]] = {}
        of_vowels: dict[str, list[float]] = {}
        for traits in map(get_traits, sounds):
            for gesture in table.gestures:
                if not gesture.is_met_by(traits) or gesture.contact:
                    continue
                for name, sums in gesture.targets.items():
                    target = evaluate_target(sums, traits)
                    targets.setdefault(name, []).append(target)
                    if traits["vowel"]:
                        of_vowels.setdefault(name, []).append(target)
        self._limits = {name: (min(values), max(values)) for name, values in targets.items()}
        spreads = [float(np.std(of_vowels.get(name, [0.0]))) for name in names]
        # Two parts each, for diphthongs.
        draws = np.clip(rng.standard_normal((len(sounds), 2, len(names))), -2.0, 2.0)
        draws[..., self._columns[RIGHT_CORNER]] = draws[..., self._columns[LEFT_CORNER]]
        self._moves = table.speaker.targets * draws * spreads

    def get_target(
        self, phone: str, part: int, gesture: Gesture, name: str, traits: dict[str, float]
    ) -> float:
        """Return the speaker's target of a gesture for a phone.

        Parameters
        ----------
        phone
            Symbol of the phone.
        part
            0, or 1 for the second part of a diphthong.
        gesture
            The gesture.
        name
            Name of the parameter.
        traits
            Traits of the phone, or of the part.

        Returns
        -------
        float
            The target, full gestures.
        """
        target = evaluate_target(gesture.targets[name], traits)
        if gesture.contact or phone not in self._rows:
            return target
        move = float(self._moves[self._rows[phone], part, self._columns[name]])
        lowest, highest = self._limits[name]
        return min(max(target + move, min(lowest, target)), max(highest, target))


def evaluate_target(target: Sum, traits: dict[str, float]) -> float:
    """Return a target of the table for a phone.

    Parameters
    ----------
    target
        A number, or what each trait adds.
    traits
        Traits of the phone.

    Returns
    -------
    float
        The target, full gestures.
    """
    if not isinstance(target, dict):
        return target
    return sum(
        factor * (1.0 if trait == "base" else traits[trait]) for trait, factor in target.items()
    )
