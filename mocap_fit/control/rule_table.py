"""Tables of articulatory targets for the rule-based model: one a language, and one by features."""

from __future__ import annotations

import contextlib
import math
import tomllib
import unicodedata
from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib import resources
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any, Literal, TypeVar

from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator, model_validator

from mocap_fit.errors import ConfigurationError, from_os_error
from mocap_fit.phones import FEATURE_NAMES, Phone, PhoneSet
from mocap_fit.settings_file import find_first_fault

_Positive = Annotated[float, Field(gt=0)]
_Share = Annotated[float, Field(ge=0, le=1)]
_File = TypeVar("_File", bound="_Strict")

FEATURES_FILE = "features.toml"
_MARKS = str.maketrans("", "", "\u032f\u035c\u0361")


@dataclass(frozen=True)
class TargetPart:
    """What a phone, or a part of it, wants of the face.

    Parameters
    ----------
    targets
        By parameter; what is not named is not specified.
    reach
        The parameters whose target is reached for the whole phone, whatever is beside it.
    """

    targets: Mapping[str, float] = field(default_factory=dict)
    reach: frozenset[str] = frozenset()

    def __post_init__(self) -> None:
        object.__setattr__(self, "targets", MappingProxyType(dict(self.targets)))


@dataclass(frozen=True)
class RuleTable:
    """The rules of a language.

    Parameters
    ----------
    phones
        By sound in IPA, without ties: one part, or the parts of a diphthong in turn.
    window
        How far the smoothing reaches to both sides, seconds.
    hold
        The part of a phone for which its target is held.
    unstressed
        What is left of a target in a vowel that is marked as not stressed.
    """

    phones: Mapping[str, tuple[TargetPart, ...]]
    window: float
    hold: float
    unstressed: float
    _rules: tuple[_Rule, ...] = field(repr=False)

    def parts(self, phone: Phone) -> tuple[TargetPart, ...]:
        """The targets of a phone, from the table or else by its features.

        Parameters
        ----------
        phone
            Of any set.

        Returns
        -------
        tuple[TargetPart, ...]
            One, or those of a diphthong in turn.
        """
        for sound in map(_plain, phone.ipa):
            if sound in self.phones:
                return self.phones[sound]
        return (_by_features(phone, self._rules),)


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class _Rule(_Strict):
    kind: Literal["vowel", "consonant", "silence", ""] = ""
    where: dict[str, float] = {}
    unless: dict[str, float] = {}
    targets: dict[str, float | dict[str, float]] = {}
    reach: tuple[str, ...] = ()

    @field_validator("where", "unless")
    @classmethod
    def _known_features(cls, named: dict[str, float]) -> dict[str, float]:
        _check_features(named)
        return named

    @field_validator("targets")
    @classmethod
    def _known_terms(
        cls, targets: dict[str, float | dict[str, float]]
    ) -> dict[str, float | dict[str, float]]:
        for value in targets.values():
            if isinstance(value, dict):
                _check_features({name: 0.0 for name in value if name != "base"})
        return targets

    def holds(self, phone: Phone) -> bool:
        """Whether the rule is for a phone."""
        return (
            self.kind in ("", phone.kind)
            and all(phone.values[name] >= least for name, least in self.where.items())
            and not any(phone.values[name] >= most for name, most in self.unless.items())
        )


class _FeaturesFile(_Strict):
    window: _Positive
    hold: _Share
    unstressed: _Share
    rules: tuple[_Rule, ...]


_Row = tuple[float | str, ...]


class _LanguageFile(_Strict):
    window: _Positive | None = None
    hold: _Share | None = None
    unstressed: _Share | None = None
    columns: tuple[str, ...] = ()
    phones: dict[str, _Row | tuple[_Row, ...]] = {}

    @model_validator(mode="after")
    def _rows_fit_the_columns(self) -> _LanguageFile:
        for sound in self.phones:
            self.parts(sound)
        return self

    def parts(self, sound: str) -> tuple[TargetPart, ...]:
        """The targets of a line: those of one part, or of the parts of a diphthong."""
        found = self.phones[sound]
        rows: list[tuple[Any, ...]] = [row for row in found if isinstance(row, tuple)] or [found]
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


def _check_features(named: Mapping[str, float]) -> None:
    known = FEATURE_NAMES[1:-1]
    for name in named:
        if name not in known:
            raise ValueError(f"there is no feature '{name}'; use {', '.join(known)}")


def rule_languages() -> tuple[str, ...]:
    """The languages that have a table of rules with the package."""
    files = resources.files("mocap_fit.control").joinpath("rules").iterdir()
    found = (f.name.removesuffix(".toml") for f in files if f.name.endswith(".toml"))
    return tuple(sorted(name for name in found if name != FEATURES_FILE.removesuffix(".toml")))


def load_rules(phone_set: PhoneSet, file: str = "") -> RuleTable:
    """Read the rules for a phone set.

    Parameters
    ----------
    phone_set
        The table of its language is taken, if there is one; other sounds, and other languages, are
        looked up by features.
    file
        A table of one's own (TOML), in place of that of the language.

    Raises
    ------
    ConfigurationError
        If a table cannot be read, or says what it cannot say; the message tells where.
    """
    general = _read(_packaged(FEATURES_FILE), _FeaturesFile, FEATURES_FILE)
    own = _LanguageFile()
    if file:
        try:
            text = Path(file).read_text("utf-8")
        except (OSError, ValueError) as error:
            raise from_os_error(error, file, "table of rules") from None
        own = _read(text, _LanguageFile, file)
    elif phone_set.language in rule_languages():
        name = f"{phone_set.language}.toml"
        own = _read(_packaged(name), _LanguageFile, name)
    rows = {_plain(sound): own.parts(sound) for sound in own.phones}
    return RuleTable(
        MappingProxyType(rows),
        window=general.window if own.window is None else own.window,
        hold=general.hold if own.hold is None else own.hold,
        unstressed=general.unstressed if own.unstressed is None else own.unstressed,
        _rules=general.rules,
    )


def _packaged(name: str) -> str:
    return resources.files("mocap_fit.control").joinpath("rules", name).read_text("utf-8")


def _read(text: str, kind: type[_File], path: str) -> _File:
    content: dict[str, Any] = {}
    try:
        content = tomllib.loads(text)
        return kind.model_validate(content)
    except tomllib.TOMLDecodeError as error:
        raise ConfigurationError("the table of rules is not TOML", path=path, found=error) from None
    except ValidationError as error:
        faults: list[Any] = list(error.errors())
        place, problem = find_first_fault(content, faults)
        raise ConfigurationError(
            f"the table of rules is wrong{' at ' if place else ''}{place}: {problem}", path=path
        ) from None


def _by_features(phone: Phone, rules: tuple[_Rule, ...]) -> TargetPart:
    targets: dict[str, float] = {}
    reach: frozenset[str] = frozenset()
    for rule in rules:
        if not rule.holds(phone):
            continue
        for name, value in rule.targets.items():
            if isinstance(value, dict):
                terms = (c * phone.values[f] for f, c in value.items() if f != "base")
                targets[name] = value.get("base", 0.0) + sum(terms)
            else:
                targets[name] = value
        reach |= set(rule.reach)
    return TargetPart(targets, reach & targets.keys())


def _plain(sound: str) -> str:
    """IPA as it is compared: ties and marks of what is not syllabic are left out."""
    return unicodedata.normalize("NFD", sound).translate(_MARKS).replace("g", "ɡ")
