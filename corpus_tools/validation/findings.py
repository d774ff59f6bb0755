"""Findings: what was found, how grave it is, where, and what to do; and the table of codes."""

from __future__ import annotations

import dataclasses
import tomllib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from enum import StrEnum
from functools import cache
from importlib import resources
from typing import Any

from mocap_fit.tracks import FloatArray


class Severity(StrEnum):
    """How grave a finding is."""

    ERROR = "error"
    WARNING = "warning"
    NOTE = "note"

    @property
    def rank(self) -> int:
        """0 for the gravest."""
        return list(Severity).index(self)


AREAS = {
    "MF0": "files",
    "MF1": "recordings",
    "MF2": "labels",
    "MF3": "face parameters",
    "MF4": "sound",
    "MF5": "corpora",
}


@dataclass(frozen=True)
class Code:
    """A kind of finding.

    Parameters
    ----------
    code
        ``MF`` and three digits.
    title
        What is wrong, without a full stop.
    severity
        Where the thresholds do not say otherwise.
    advice
        What to do.
    """

    code: str
    title: str
    severity: Severity
    advice: str

    @property
    def area(self) -> str:
        """What it is about."""
        return AREAS[self.code[:3]]


@cache
def codes() -> Mapping[str, Code]:
    """All codes, in order; the table is ``codes.toml`` beside this module."""
    text = resources.files(__package__).joinpath("codes.toml").read_text("utf-8")
    return {
        code: Code(code, row["title"], Severity(row["severity"]), row["advice"])
        for code, row in tomllib.loads(text).items()
    }


@dataclass(frozen=True)
class Place:
    """Where something was found.

    Parameters
    ----------
    file
        As the user named it, or in a corpus relative to its folder; empty where it is the whole.
    utterance
        Its id; empty where none is concerned.
    item
        The marker, markers, parameter, phone, column or step.
    frames
        First and last frame, from 0.
    seconds
        Start and end.
    """

    file: str = ""
    utterance: str = ""
    item: str = ""
    frames: tuple[int, int] | None = None
    seconds: tuple[float, float] | None = None

    def __str__(self) -> str:
        """The place in words."""
        parts = [self.file or self.utterance]
        if self.item:
            parts.append(self.item)
        if self.frames is not None:
            first, last = self.frames
            parts.append(f"frame {first}" if first == last else f"frames {first} to {last}")
        if self.seconds is not None:
            parts.append(f"{self.seconds[0]:.3f} to {self.seconds[1]:.3f} s")
        return ", ".join(part for part in parts if part)


@dataclass(frozen=True, eq=False)
class Evidence:
    """Curves about a place, for a picture.

    Parameters
    ----------
    times
        `(points,)`, seconds.
    curves
        `(points,)` each, by what they are.
    unit
        Of the curves.
    """

    times: FloatArray
    curves: Mapping[str, FloatArray]
    unit: str


@dataclass(frozen=True, eq=False)
class Finding:
    """Something that was found.

    Parameters
    ----------
    code
        One of `codes`.
    place
        Where.
    found, expected
        What there is, and what there should be.
    severity, advice
        Those of the code where not given.
    evidence
        For a picture.
    """

    code: str
    place: Place
    found: str
    expected: str = ""
    severity: Severity = None  # type: ignore[assignment]
    advice: str = ""
    evidence: Evidence | None = None

    def __post_init__(self) -> None:
        kind = codes()[self.code]
        object.__setattr__(self, "severity", self.severity or kind.severity)
        object.__setattr__(self, "advice", self.advice or kind.advice)

    @property
    def title(self) -> str:
        """What is wrong, without a full stop."""
        return codes()[self.code].title

    def replace(self, **changes: Any) -> Finding:
        """A copy with some fields changed."""
        return dataclasses.replace(self, **changes)

    def as_record(self) -> dict[str, Any]:
        """The finding as plain values, for JSON."""
        place = self.place
        return {
            "code": self.code,
            "severity": self.severity.value,
            "problem": self.title,
            "file": place.file,
            "utterance": place.utterance,
            "item": place.item,
            "frames": place.frames,
            "seconds": place.seconds,
            "found": self.found,
            "expected": self.expected,
            "advice": self.advice,
        }


def in_order(findings: Iterable[Finding]) -> list[Finding]:
    """The gravest first, then by code and place."""

    def key(finding: Finding) -> tuple[Any, ...]:
        place = finding.place
        first = -1 if place.frames is None else place.frames[0]
        begin = -1.0 if place.seconds is None else place.seconds[0]
        where = (place.file, place.utterance, place.item, first, begin)
        return (finding.severity.rank, finding.code, *where)

    return sorted(findings, key=key)


def capped(findings: Iterable[Finding], most: int) -> Iterator[Finding]:
    """No more than so many of one code about one item of a file; the last says how many more."""
    groups: dict[tuple[str, str, str, str], list[Finding]] = {}
    for finding in findings:
        place = finding.place
        key = (finding.code, place.file, place.utterance, place.item)
        groups.setdefault(key, []).append(finding)
    for group in groups.values():
        yield from group[: most - 1]
        more = len(group) - most
        for finding in group[most - 1 : most]:
            yield finding.replace(found=f"{finding.found}; and {more} more") if more else finding
