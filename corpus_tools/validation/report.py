"""What a validation found, as tables for people and as JSON for programs."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from corpus_tools.validation.findings import (
    Finding,
    Severity,
    limit_findings,
    load_codes,
    sort_findings,
)
from corpus_tools.validation.subject import Summary
from corpus_tools.validation.thresholds import Thresholds

# So many findings stand in the short form of a report.
_SHOWN = 5


@dataclass(repr=False)
class Report:
    """What was checked and what was found.

    Parameters
    ----------
    limits
        What counted as wrong.
    checked
        A line for each path.
    findings
        The findings, in the order of gravity after `finish`.
    summaries
        Summaries of all utterances.
    bounds
        Bounds of the parameters by name, full gestures; empty where no face is known.
    """

    limits: Thresholds
    checked: list[str] = field(default_factory=list)
    findings: list[Finding] = field(default_factory=list)
    summaries: list[Summary] = field(default_factory=list)
    bounds: dict[str, tuple[float, float]] = field(default_factory=dict)

    def add(self, findings: Sequence[Finding]) -> None:
        """Add findings with the severity that the user wants, and not too many of one kind.

        Parameters
        ----------
        findings
            The findings.
        """
        graded = [self.limits.grade(finding) for finding in findings]
        wanted = [finding for finding in graded if finding is not None]
        self.findings += limit_findings(wanted, self.limits.report.most_per_item)

    def finish(self) -> None:
        """Sort the findings, and drop evidence for pictures that will not be drawn."""
        ordered = sort_findings(self.findings)
        left = self.limits.report.pictures
        seen: Counter[str] = Counter()
        for location, finding in enumerate(ordered):
            if finding.evidence is None:
                continue
            if left and seen[finding.code] < 3:
                left -= 1
                seen[finding.code] += 1
            else:
                ordered[location] = finding.replace(evidence=None)
        self.findings = ordered

    def __repr__(self) -> str:
        lines = [f"Report: {self.format_verdict()}"]
        for finding in self.findings[:_SHOWN]:
            lines.append(f"  {finding.code} {finding.location}: {finding.title}: {finding.found}")
        if len(self.findings) > _SHOWN:
            lines.append(f"  … and {len(self.findings) - _SHOWN} more")
        return "\n".join(lines)

    @property
    def counts(self) -> dict[str, int]:
        """How many findings of each severity."""
        counted = Counter(finding.severity for finding in self.findings)
        return {severity.value: counted[severity] for severity in Severity}

    @property
    def is_clean(self) -> bool:
        """Whether there is no error."""
        return not self.counts["error"]

    def format_verdict(self) -> str:
        """Format the result as one line.

        Returns
        -------
        str
            Numbers of utterances and findings.
        """
        counts = self.counts
        texts = ", ".join(
            f"{number} {name}{'' if number == 1 else 's'}" for name, number in counts.items()
        )
        many = len(self.summaries)
        return f"{many} {'utterance' if many == 1 else 'utterances'} checked: {texts}"

    def to_record(self) -> dict[str, Any]:
        """Return the report as plain values, for JSON.

        Returns
        -------
        dict
            The values by their names.
        """
        return {
            "checked": self.checked,
            "utterances": len(self.summaries),
            "clean": self.is_clean,
            "counts": self.counts,
            "codes": dict(sorted(Counter(f.code for f in self.findings).items())),
            "findings": [finding.to_record() for finding in self.findings],
            "thresholds": self.limits.to_record(),
        }


def group_by_code(findings: Sequence[Finding]) -> list[tuple[Finding, list[Finding]]]:
    """Group findings of one code and severity.

    Parameters
    ----------
    findings
        The findings.

    Returns
    -------
    list of tuple
        The first finding of each group, and all of them.
    """
    groups: dict[tuple[Severity, str], list[Finding]] = {}
    for finding in findings:
        groups.setdefault((finding.severity, finding.code), []).append(finding)
    return [(members[0], members) for members in groups.values()]


def to_code_records() -> list[dict[str, str]]:
    """Return the table of all codes as plain values, for JSON.

    Returns
    -------
    list of dict
        A record a code.
    """
    return [
        {
            "code": code.code,
            "area": code.area,
            "severity": code.severity.value,
            "problem": code.title,
            "advice": code.advice,
        }
        for code in load_codes().values()
    ]
