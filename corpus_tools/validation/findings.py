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

from mocap_fit.tracks import FloatArray, Tracks


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
def load_codes() -> Mapping[str, Code]:
    """Load the table of codes, ``codes.toml`` beside this module.

    Returns
    -------
    dict of str to Code
        All codes, in order.
    """
    text = resources.files(__package__).joinpath("codes.toml").read_text("utf-8")
    return {
        code: Code(code, row["title"], Severity(row["severity"]), row["advice"])
        for code, row in tomllib.loads(text).items()
    }


@dataclass(frozen=True)
class Location:
    """The location of a finding.

    Parameters
    ----------
    file
        The file as the user named it, or in a corpus relative to its folder; empty for the
        whole corpus.
    utterance
        Id of the utterance; empty where none is concerned.
    item
        The marker, markers, parameter, phone, column or step.
    frames
        First and last frame, from 0.
    seconds
        Start and end, seconds.
    """

    file: str = ""
    utterance: str = ""
    item: str = ""
    frames: tuple[int, int] | None = None
    seconds: tuple[float, float] | None = None

    def at(
        self,
        item: str,
        frames: tuple[int, int] | None = None,
        seconds: tuple[float, float] | None = None,
    ) -> Location:
        """Return the location of an item in the same file and utterance.

        Parameters
        ----------
        item
            The marker, markers, parameter, phone, column or step.
        frames
            First and last frame, from 0.
        seconds
            Start and end, seconds.

        Returns
        -------
        Location
            The location.
        """
        return Location(self.file, self.utterance, item, frames, seconds)

    def __str__(self) -> str:
        """Return the location in words."""
        parts = [self.file or self.utterance]
        if self.item:
            parts.append(self.item)
        if self.frames is not None:
            first, last = self.frames
            parts.append(f"frame {first}" if first == last else f"frames {first} to {last}")
        if self.seconds is not None:
            parts.append(f"{self.seconds[0]:.3f} to {self.seconds[1]:.3f} s")
        return ", ".join(part for part in parts if part)


def locate(location: Location, tracks: Tracks, item: str, run: slice) -> Location:
    """Return the location of a marker or parameter in a run of frames.

    Parameters
    ----------
    location
        The file and the utterance.
    tracks
        The recording or the parameters of the utterance.
    item
        The marker or parameter.
    run
        The frames.

    Returns
    -------
    Location
        The location.
    """
    first, last = run.start, run.stop - 1
    start, rate = tracks.start_time, tracks.rate
    return location.at(item, (first, last), (start + first / rate, start + last / rate))


@dataclass(frozen=True, eq=False)
class Evidence:
    """Curves about a location, for a picture.

    Parameters
    ----------
    times
        Times, ``(points,)``, seconds.
    curves
        Curves by their names, ``(points,)`` each.
    unit
        Unit of the curves.
    """

    times: FloatArray
    curves: Mapping[str, FloatArray]
    unit: str


@dataclass(frozen=True, eq=False)
class Finding:
    """Something that is wrong, or worth a note.

    Parameters
    ----------
    code
        One of `load_codes`.
    location
        Where it is.
    found
        What there is.
    expected
        What there should be.
    severity
        How grave it is; that of the code where not given.
    advice
        What to do; that of the code where not given.
    evidence
        Curves for a picture.
    """

    code: str
    location: Location
    found: str
    expected: str = ""
    severity: Severity = None  # type: ignore[assignment]
    advice: str = ""
    evidence: Evidence | None = None

    def __post_init__(self) -> None:
        kind = load_codes()[self.code]
        object.__setattr__(self, "severity", self.severity or kind.severity)
        object.__setattr__(self, "advice", self.advice or kind.advice)

    @property
    def title(self) -> str:
        """What is wrong, without a full stop."""
        return load_codes()[self.code].title

    def replace(self, **changes: Any) -> Finding:
        """Return a copy with some fields changed.

        Parameters
        ----------
        **changes
            New values of the fields.

        Returns
        -------
        Finding
            The copy.
        """
        return dataclasses.replace(self, **changes)

    def to_record(self) -> dict[str, Any]:
        """Return the finding as plain values, for JSON.

        Returns
        -------
        dict
            The values by their names.
        """
        location = self.location
        return {
            "code": self.code,
            "severity": self.severity.value,
            "problem": self.title,
            "file": location.file,
            "utterance": location.utterance,
            "item": location.item,
            "frames": location.frames,
            "seconds": location.seconds,
            "found": self.found,
            "expected": self.expected,
            "advice": self.advice,
        }


def sort_findings(findings: Iterable[Finding]) -> list[Finding]:
    """Sort findings: the gravest first, then by code and location.

    Parameters
    ----------
    findings
        The findings.

    Returns
    -------
    list of Finding
        The findings in order.
    """

    def get_key(finding: Finding) -> tuple[Any, ...]:
        location = finding.location
        first = -1 if location.frames is None else location.frames[0]
        begin = -1.0 if location.seconds is None else location.seconds[0]
        where = (location.file, location.utterance, location.item, first, begin)
        return (finding.severity.rank, finding.code, *where)

    return sorted(findings, key=get_key)


def limit_findings(findings: Iterable[Finding], most: int) -> Iterator[Finding]:
    """Limit the number of findings of one code about one item of a file.

    The last finding of a group says how many more there are.

    Parameters
    ----------
    findings
        The findings.
    most
        The largest number in a group.

    Yields
    ------
    Finding
        The findings that remain.
    """
    groups: dict[tuple[str, str, str, str], list[Finding]] = {}
    for finding in findings:
        location = finding.location
        key = (finding.code, location.file, location.utterance, location.item)
        groups.setdefault(key, []).append(finding)
    for group in groups.values():
        yield from group[: most - 1]
        more = len(group) - most
        for finding in group[most - 1 : most]:
            yield finding.replace(found=f"{finding.found}; and {more} more") if more else finding
