"""The rule-based model (Beskow 1995, as described in Beskow, section 1.2).

Every phone has targets, and may leave some of them unspecified. What is unspecified follows from
the context: a straight line from the last specified target to the next. The trajectory is smoothed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, NamedTuple, Self

import numpy as np

from mocap_fit.control.base import Arrays, ControlModel, Progress
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


class _HeldTarget(NamedTuple):
    """A target that is held for some time, seconds."""

    start: float
    end: float
    centre: float
    value: float
    reach: bool


@dataclass(eq=False, repr=False)
class RuleBased(ControlModel):
    """Targets by rule, unspecified ones from context, smoothed. It learns nothing from a corpus.

    `prepare` makes it work without one; `fit` uses only the phone set, the parameters and the rate
    of a corpus. A parameter that no phone of an utterance specifies stays at rest (0).

    Parameters
    ----------
    stress
        Whether vowels that are marked as unstressed move less.
    rules
        Path of another table of rules (TOML); by default that of the phone set's language, and
        features for other sounds and languages.
    """

    stress: bool = True
    rules: str = ""

    name: ClassVar[str] = "rule-based"
    title: ClassVar[str] = "Rule-based"
    learns: ClassVar[bool] = False

    def prepare(
        self,
        phone_set: PhoneSet | str,
        parameter_names: Sequence[str] = ARTICULATORY_PARAMETERS,
        rate: float = 60.0,
    ) -> Self:
        """Prepare the model to predict without a corpus.

        Parameters
        ----------
        phone_set
            The phone set of the phones to come, or its name.
        parameter_names
            The parameters to predict.
        rate
            Frames per second of `predict` by default, hertz.

        Returns
        -------
        RuleBased
            The model itself.

        Raises
        ------
        ConfigurationError
            If there is no such phone set, or the table of rules is wrong.
        MissingFileError
            If there is no such table of rules.
        """
        chosen = load_phone_set(phone_set) if isinstance(phone_set, str) else phone_set
        self.table_: RuleTable = load_rules(chosen, self.rules)
        self.phone_set_ = chosen
        self.parameter_names_, self.rate_ = tuple(parameter_names), rate
        self.trained_on_ = {"language": chosen.language, "phone_set": chosen.name, "utterances": 0}
        self.log_ = ()
        return self

    def _fit(
        self, corpus: Corpus, validation: Corpus | None, progress: Progress, checkpoint: Path | None
    ) -> None:
        self.table_ = load_rules(corpus.phone_set, self.rules)

    @property
    def parameter_count(self) -> int:
        """Zero: nothing is learned."""
        return 0

    def _state(self) -> tuple[dict[str, Any], dict[str, np.ndarray[Any, Any]]]:
        return {}, {}

    def _restore(self, values: Mapping[str, Any], arrays: Arrays) -> None:
        self.table_ = load_rules(self.phone_set_, self.rules)

    def _predict(self, phones: PhoneSequence, times: FloatArray) -> FloatArray:
        targets: dict[str, list[_HeldTarget]] = {name: [] for name in self.parameter_names_}
        for segment in phones:
            self._add_targets(segment, targets)
        points = times[:, None] + self.table_.window * _OFFSETS
        values = np.zeros((len(times), len(self.parameter_names_)))
        for column, name in enumerate(self.parameter_names_):
            if targets[name]:
                knots, heights = _to_line(targets[name])
                values[:, column] = np.interp(points, knots, heights) @ _SHARES
        return values

    def _add_targets(self, segment: PhoneSegment, targets: dict[str, list[_HeldTarget]]) -> None:
        """Add what a segment specifies."""
        phone = self.phone_set_.get_phone(segment)
        parts = self.table_.get_parts(phone)
        is_unstressed = self.stress and segment.stress == 0 and phone.kind == "vowel"
        factor = self.table_.unstressed if is_unstressed else 1.0
        length = segment.duration / len(parts)
        # Smoothing preserves a target that is held as far as the window reaches.
        window = self.table_.window
        firm = max(0.5 * length + 0.25 * window, window + 0.5 * self.table_.dwell)
        for position, part in enumerate(parts):
            centre = segment.start + (position + 0.5) * length
            for name, value in part.targets.items():
                if name not in targets:
                    continue
                reach = name in part.reach
                half = firm if reach else 0.5 * length * self.table_.hold
                targets[name].append(
                    _HeldTarget(centre - half, centre + half, centre, factor * value, reach)
                )


def _to_line(targets: list[_HeldTarget]) -> tuple[FloatArray, FloatArray]:
    """Return times and values of the line through all targets, in the order of time.

    Where two targets overlap, one that is to be reached comes first, and a target whose centre
    another one covers is left out; two of a kind share the time that both want.
    """
    line: list[_HeldTarget] = []
    for target in targets:
        now = target
        while line and line[-1].end > now.start:
            before = line[-1]
            if before.reach and not now.reach:
                if before.end >= now.centre:
                    break
                now = now._replace(start=before.end)
            elif now.reach and not before.reach:
                if now.start <= before.centre:
                    line.pop()
                    continue
                line[-1] = before._replace(end=now.start)
            else:
                middle = 0.5 * (max(before.end, before.centre) + min(now.start, now.centre))
                middle = min(max(middle, before.centre), now.centre)
                line[-1] = before._replace(end=middle)
                now = now._replace(start=middle)
        else:
            line.append(now)
    knots = np.array([knot for target in line for knot in (target.start, target.end)])
    values = np.array([target.value for target in line for _ in range(2)])
    # Two targets that touch change in an instant, and the smoothing makes a movement of it.
    is_later = np.concatenate([[True], np.diff(knots) > 1e-9])
    knots = np.maximum.accumulate(np.where(is_later, knots, knots + 1e-9))
    return knots, values
