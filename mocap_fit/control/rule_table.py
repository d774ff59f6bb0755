"""Tables of articulatory targets for the rule-based model: of languages, features, the tongue."""

from __future__ import annotations

import contextlib
import math
import unicodedata
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any, Literal

from pydantic import Field, PositiveFloat, field_validator, model_validator

from mocap_fit.phones import FEATURE_NAMES, Phone, PhoneSet
from mocap_fit.settings_file import StrictModel, list_shipped, load_settings

_Share = Annotated[float, Field(ge=0, le=1)]

_FEATURES, _TONGUE = "features", "tongue"
_SHIPPED = {"package": "mocap_fit.control", "folder": "rules"}
_MARKS = str.maketrans("", "", "\u032f\u035c\u0361")


@dataclass(frozen=True)
class TargetPart:
    """The targets of a phone, or of a part of it.

    Parameters
    ----------
    targets
        Targets by parameter, full gestures; a parameter without one is not specified.
    reach
        The parameters whose target is reached for the complete phone, whatever is beside it.
    """

    targets: Mapping[str, float] = field(default_factory=dict)
    reach: frozenset[str] = frozenset()


@dataclass(frozen=True)
class RuleTable:
    """The rules of a language.

    Parameters
    ----------
    phones
        By sound in IPA, without ties: one part, or the parts of a diphthong in order.
    window
        How far the smoothing reaches to both sides, seconds.
    hold
        The share of a phone for which its target is held, 0 to 1.
    unstressed
        The share of a target that is left in a vowel that is marked as not stressed, 0 to 1.
    dwell
        For how long at least a target that is to be reached is there, seconds.
    """

    phones: Mapping[str, tuple[TargetPart, ...]] = field(repr=False)
    window: float
    hold: float
    unstressed: float
    dwell: float
    _rules: tuple[_Rule, ...] = field(repr=False)

    def get_parts(self, phone: Phone) -> tuple[TargetPart, ...]:
        """Return the targets of a phone, from the table or else by its features.

        Parameters
        ----------
        phone
            A phone of any set.

        Returns
        -------
        tuple[TargetPart, ...]
            One part, or those of a diphthong in order.
        """
        for sound in map(_simplify, phone.ipa):
            if sound in self.phones:
                return self.phones[sound]
        return (_apply_rules(phone, self._rules),)


class _Rule(StrictModel):
    kind: Literal["vowel", "consonant", "silence", ""] = ""
    where: dict[str, float] = Field(default_factory=dict)
    unless: dict[str, float] = Field(default_factory=dict)
    targets: dict[str, float | dict[str, float]] = Field(default_factory=dict)
    reach: tuple[str, ...] = ()

    @field_validator("where", "unless")
    @classmethod
    def _check_features(cls, values: dict[str, float]) -> dict[str, float]:
        return _check_features(values)

    @field_validator("targets")
    @classmethod
    def _check_terms(
        cls, targets: dict[str, float | dict[str, float]]
    ) -> dict[str, float | dict[str, float]]:
        for value in targets.values():
            if isinstance(value, dict):
                _check_features({name: 0.0 for name in value if name != "base"})
        return targets

    def is_for(self, phone: Phone) -> bool:
        """Return whether the rule holds for a phone."""
        return (
            self.kind in ("", phone.kind)
            and all(phone.values[name] >= least for name, least in self.where.items())
            and not any(phone.values[name] >= most for name, most in self.unless.items())
        )


class _FeaturesFile(StrictModel):
    window: PositiveFloat
    hold: _Share
    unstressed: _Share
    rules: tuple[_Rule, ...]


_Row = tuple[float | str, ...]


class _LanguageFile(StrictModel):
    window: PositiveFloat | None = None
    hold: _Share | None = None
    unstressed: _Share | None = None
    dwell: Annotated[float, Field(ge=0, le=1)] = 0.0
    rules: tuple[_Rule, ...] | None = None
    columns: tuple[str, ...] = ()
    phones: dict[str, _Row | tuple[_Row, ...]] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _check_rows(self) -> _LanguageFile:
        for sound in self.phones:
            self.parse_parts(sound)
        return self

    def parse_parts(self, sound: str) -> tuple[TargetPart, ...]:
        """Return the targets of a line: those of one part, or of the parts of a diphthong."""
        line = self.phones[sound]
        rows: list[tuple[Any, ...]] = [row for row in line if isinstance(row, tuple)] or [line]
        parts = []
        for row in rows:
            if len(row) != len(self.columns):
                raise ValueError(
                    f"'{sound}' has {len(row)} targets for {len(self.columns)} columns"
                )
            cells = {n: str(c) for n, c in zip(self.columns, row, strict=True) if c != "-"}
            targets: dict[str, float] = {}
            with contextlib.suppress(ValueError):
                targets = {name: float(cell.removeprefix("!")) for name, cell in cells.items()}
            if len(targets) < len(cells) or not all(map(math.isfinite, targets.values())):
                raise ValueError(
                    f"'{sound}' has a target that is no number, no number after '!' and not '-'"
                )
            reach = frozenset(name for name, cell in cells.items() if cell.startswith("!"))
            parts.append(TargetPart(targets, reach))
        return tuple(parts)


def _check_features(values: dict[str, float]) -> dict[str, float]:
    known = FEATURE_NAMES[1:-1]
    for name in values:
        if name not in known:
            raise ValueError(f"there is no feature '{name}'; use {', '.join(known)}")
    return values


def list_rule_languages() -> tuple[str, ...]:
    """Return the languages that have a table of rules with the package.

    Returns
    -------
    tuple[str, ...]
        Codes of languages such as ``sv``, sorted.
    """
    return tuple(name for name in list_shipped(**_SHIPPED) if name not in (_FEATURES, _TONGUE))


def load_rules(phone_set: PhoneSet, file: str = "") -> RuleTable:
    """Load the rules for a phone set.

    Parameters
    ----------
    phone_set
        The phone set. The table of its language is used, if there is one; other sounds, and other
        languages, are looked up by features.
    file
        Path of another table (TOML) for that of the language.

    Returns
    -------
    RuleTable
        The rules.

    Raises
    ------
    MissingFileError
        If there is no such table.
    FileFormatError
        If the table cannot be read.
    ConfigurationError
        If the table is not TOML, or has an unknown key or an impossible value.
    """
    noun = "table of rules"
    general = load_settings(_FeaturesFile, _FEATURES, noun=noun, **_SHIPPED)
    table = _LanguageFile()
    if file:
        table = load_settings(_LanguageFile, file, noun=noun)
    elif phone_set.language in list_rule_languages():
        table = load_settings(_LanguageFile, phone_set.language, noun=noun, **_SHIPPED)
    return RuleTable(
        {_simplify(sound): table.parse_parts(sound) for sound in table.phones},
        window=general.window if table.window is None else table.window,
        hold=general.hold if table.hold is None else table.hold,
        unstressed=general.unstressed if table.unstressed is None else table.unstressed,
        dwell=table.dwell,
        _rules=general.rules if table.rules is None else table.rules,
    )


def _apply_rules(phone: Phone, rules: tuple[_Rule, ...]) -> TargetPart:
    """Return the targets of a phone by its features; a later rule replaces an earlier one."""
    targets: dict[str, float] = {}
    reach: frozenset[str] = frozenset()
    for rule in rules:
        if not rule.is_for(phone):
            continue
        for name, value in rule.targets.items():
            if isinstance(value, dict):
                terms = (c * phone.values[f] for f, c in value.items() if f != "base")
                targets[name] = value.get("base", 0.0) + sum(terms)
            else:
                targets[name] = value
        reach |= set(rule.reach)
    return TargetPart(targets, reach & targets.keys())


def _simplify(sound: str) -> str:
    """Return IPA in the form that is compared: without ties and marks of what is not syllabic."""
    return unicodedata.normalize("NFD", sound).translate(_MARKS).replace("g", "ɡ")
