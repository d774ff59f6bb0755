"""The rule-based model (Beskow 1995, as described in Beskow, section 1.2).

Every phone has targets, and may leave some of them unspecified. What is unspecified is found from
the context: a straight line from the last specified target to the next. The trajectory is smoothed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, NamedTuple, Self

import numpy as np

from mocap_fit.control.base import ControlModel, Progress
from mocap_fit.control.rule_table import RuleTable, load_rules
from mocap_fit.corpus import Corpus
from mocap_fit.phones import (
    ARTICULATORY_PARAMETERS,
    PhoneSegment,
    PhoneSequence,
    PhoneSet,
    load_phone_set,
)
from mocap_fit.tracks import FloatArray

# Points and shares of the smoothing window, a raised cosine over [-1, 1]; the shares add up to 1.
_OFFSETS = np.linspace(-1.0, 1.0, 17)[1:-1]
_SHARES = (1.0 + np.cos(np.pi * _OFFSETS)) / np.sum(1.0 + np.cos(np.pi * _OFFSETS))


class _Held(NamedTuple):
    """A target that is held over a stretch of time."""

    start: float
    end: float
    centre: float
    value: float
    reach: bool


@dataclass(eq=False)
class RuleBased(ControlModel):
    """Targets by rule, unspecified ones from context, smoothed. It learns nothing from a corpus.

    `prepare` makes it work without one; `fit` takes the phone set, the parameters and the rate of a
    corpus and no more. A parameter that no phone of an utterance specifies stays at rest (0).

    Parameters
    ----------
    stress
        Whether vowels that are marked as unstressed move less.
    rules
        A table of rules of one's own (TOML); else that of the phone set's language, and features
        for other sounds and languages.
    """

    stress: bool = True
    rules: str = ""

    name: ClassVar[str] = "rule-based"
    title: ClassVar[str] = "Rule-based"

    def prepare(
        self,
        phone_set: PhoneSet | str,
        parameter_names: Sequence[str] = ARTICULATORY_PARAMETERS,
        rate: float = 60.0,
    ) -> Self:
        """Get ready to predict without a corpus.

        Parameters
        ----------
        phone_set
            What the phones will be written in, or its name.
        parameter_names
            The parameters to give.
        rate
            Frames per second where `predict` is not told.

        Returns
        -------
        RuleBased
            Itself.

        Raises
        ------
        ConfigurationError
            If there is no such phone set, or the table of rules is wrong.
        """
        chosen = load_phone_set(phone_set) if isinstance(phone_set, str) else phone_set
        table = load_rules(chosen, self.rules)
        self.table_: RuleTable = table
        self.phone_set_ = chosen
        self.parameter_names_, self.rate_ = tuple(parameter_names), rate
        self.trained_on_ = {"language": chosen.language, "phone_set": chosen.name, "utterances": 0}
        self.log_ = ()
        return self

    def _fit(
        self,
        corpus: Corpus,
        validation: Corpus | None,
        progress: Progress,
        checkpoint: Path | None,
    ) -> None:
        self.table_ = load_rules(corpus.phone_set, self.rules)

    @property
    def parameter_count(self) -> int:
        """None is learned."""
        return 0

    def _state(self) -> tuple[dict[str, Any], dict[str, np.ndarray[Any, Any]]]:
        return {}, {}

    def _restore(
        self, values: Mapping[str, Any], arrays: Mapping[str, np.ndarray[Any, Any]]
    ) -> None:
        self.table_ = load_rules(self.phone_set_, self.rules)

    def _predict(self, phones: PhoneSequence, times: FloatArray) -> FloatArray:
        held: dict[str, list[_Held]] = {name: [] for name in self.parameter_names_}
        for segment in phones:
            self._add(segment, held)
        points = times[:, None] + self.table_.window * _OFFSETS
        values = np.zeros((len(times), len(self.parameter_names_)))
        for column, name in enumerate(self.parameter_names_):
            if held[name]:
                knots, targets = _line(held[name])
                values[:, column] = np.interp(points, knots, targets) @ _SHARES
        return values

    def _add(self, segment: PhoneSegment, held: dict[str, list[_Held]]) -> None:
        """Add what a segment specifies."""
        phone = self.phone_set_.get_phone(segment)
        parts = self.table_.parts(phone)
        unstressed = self.stress and segment.stress == 0 and phone.kind == "vowel"
        factor = self.table_.unstressed if unstressed else 1.0
        length = segment.duration / len(parts)
        for position, part in enumerate(parts):
            centre = segment.start + (position + 0.5) * length
            for name, value in part.targets.items():
                if name not in held:
                    continue
                reach = name in part.reach
                # The smoothing gives a target back where it is held as far as the window reaches.
                window = self.table_.window
                firm = max(0.5 * length + 0.25 * window, window)
                half = firm if reach else 0.5 * length * self.table_.hold
                held[name].append(
                    _Held(centre - half, centre + half, centre, factor * value, reach)
                )


def _line(held: list[_Held]) -> tuple[FloatArray, FloatArray]:
    """Knots and values of the line through all targets, in the order of time.

    Where two stretches meet, one that is to be reached goes first, and a target whose centre
    another one covers is left out; two of a kind share what both want.
    """
    kept: list[_Held] = []
    for target in held:
        now = target
        while kept and kept[-1].end > now.start:
            before = kept[-1]
            if before.reach and not now.reach:
                if before.end >= now.centre:
                    break
                now = now._replace(start=before.end)
            elif now.reach and not before.reach:
                if now.start <= before.centre:
                    kept.pop()
                    continue
                kept[-1] = before._replace(end=now.start)
            else:
                middle = 0.5 * (max(before.end, before.centre) + min(now.start, now.centre))
                middle = min(max(middle, before.centre), now.centre)
                kept[-1] = before._replace(end=middle)
                now = now._replace(start=middle)
        else:
            kept.append(now)
    knots = np.array([knot for target in kept for knot in (target.start, target.end)])
    values = np.array([target.value for target in kept for _ in range(2)])
    # Two targets that touch change in a moment, and the smoothing makes a movement of it.
    apart = np.concatenate([[True], np.diff(knots) > 1e-9])
    knots = np.maximum.accumulate(np.where(apart, knots, knots + 1e-9))
    return knots, values
