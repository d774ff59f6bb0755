"""What a validation found, as tables for people and as JSON for programs."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from corpus_tools.validation.findings import Finding, Severity, capped, codes, in_order
from corpus_tools.validation.subject import Summary
from corpus_tools.validation.thresholds import Thresholds


@dataclass
class Report:
    """What was checked and what was found.

    Parameters
    ----------
    limits
        What counted as wrong.
    checked
        A line for each path that was given.
    findings
        In the order of gravity, after `finish`.
    summaries
        Of all utterances.
    bounds
        Of the parameters, by name; empty where no face is known.
    """

    limits: Thresholds
    checked: list[str] = field(default_factory=list)
    findings: list[Finding] = field(default_factory=list)
    summaries: list[Summary] = field(default_factory=list)
    bounds: dict[str, tuple[float, float]] = field(default_factory=dict)

    def add(self, findings: Sequence[Finding]) -> None:
        """Take findings, as grave as the user wants them, and not too many of one kind."""
        graded = [self.limits.graded(finding) for finding in findings]
        kept = [finding for finding in graded if finding is not None]
        self.findings += capped(kept, self.limits.report.most_per_item)

    def finish(self) -> None:
        """Put the findings in order, and let go of pictures that nobody will see."""
        ordered = in_order(self.findings)
        left = self.limits.report.pictures
        seen: Counter[str] = Counter()
        for place, finding in enumerate(ordered):
            if finding.evidence is None:
                continue
            if left and seen[finding.code] < 3:
                left -= 1
                seen[finding.code] += 1
            else:
                ordered[place] = finding.replace(evidence=None)
        self.findings = ordered

    @property
    def counts(self) -> dict[str, int]:
        """How many findings of each severity."""
        counted = Counter(finding.severity for finding in self.findings)
        return {severity.value: counted[severity] for severity in Severity}

    @property
    def clean(self) -> bool:
        """Whether there is no error."""
        return not self.counts["error"]

    def verdict(self) -> str:
        """The result in one line."""
        counts = self.counts
        said = ", ".join(
            f"{number} {name}{'' if number == 1 else 's'}" for name, number in counts.items()
        )
        many = len(self.summaries)
        return f"{many} {'utterance' if many == 1 else 'utterances'} checked: {said}"

    def as_record(self) -> dict[str, Any]:
        """All of it, for JSON."""
        return {
            "checked": self.checked,
            "utterances": len(self.summaries),
            "clean": self.clean,
            "counts": self.counts,
            "codes": dict(sorted(Counter(f.code for f in self.findings).items())),
            "findings": [finding.as_record() for finding in self.findings],
            "thresholds": self.limits.as_record(),
        }


def by_code(findings: Sequence[Finding]) -> list[tuple[Finding, list[Finding]]]:
    """Findings of one code and severity together, with the first of them."""
    groups: dict[tuple[Severity, str], list[Finding]] = {}
    for finding in findings:
        groups.setdefault((finding.severity, finding.code), []).append(finding)
    return [(members[0], members) for members in groups.values()]


def code_records() -> list[dict[str, str]]:
    """The table of all codes, for JSON."""
    return [
        {
            "code": code.code,
            "area": code.area,
            "severity": code.severity.value,
            "problem": code.title,
            "advice": code.advice,
        }
        for code in codes().values()
    ]
