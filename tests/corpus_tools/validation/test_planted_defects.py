"""Every defect is found and named, at its place, and nothing else is said of it."""

import pytest
from spoiling import DEFECTS, Expected

from corpus_tools.validate import validate
from corpus_tools.validation import codes

# The utterance that is spoilt; the others must stay without a finding.
SPOILT = "sim002"
# What may be said of the others, or of all, when one is spoilt.
SMALL = {"MF512"}


def matches(finding, expected: Expected, name: str) -> bool:
    place = finding.place
    if finding.code != expected.code or expected.item not in place.item:
        return False
    if not expected.whole and place.utterance != (expected.utterance or name):
        return False
    if expected.frames is not None:
        if place.frames is None:
            return False
        off = [abs(a - b) for a, b in zip(place.frames, expected.frames, strict=True)]
        # An open end is as long as the recording.
        open_end = expected.frames[1] == 10_000
        if off[0] > (1 if open_end else expected.slack) or off[1] > expected.slack:
            return False
    if expected.seconds is not None:
        if place.seconds is None:
            return False
        off = [abs(a - b) for a, b in zip(place.seconds, expected.seconds, strict=True)]
        if max(off) > 0.02 * max(1, expected.slack):
            return False
    return True


def test_the_clean_corpus_has_no_finding(clean):
    report = validate([clean])
    assert [str(f.place) + f.found for f in report.findings] == []
    assert report.clean
    assert len(report.summaries) == 4


@pytest.mark.parametrize("plant", DEFECTS.values(), ids=DEFECTS)
def test_a_planted_defect_is_found_and_named(corpus, plant):
    expected = plant(corpus, SPOILT)
    findings = validate([corpus]).findings
    told = [f"{f.code} {f.place}: {f.found}" for f in findings]
    assert any(matches(finding, expected, SPOILT) for finding in findings), told
    allowed = {expected.code, *expected.also}
    false_alarms = [
        line
        for line, finding in zip(told, findings, strict=True)
        if finding.code not in allowed
        or (not expected.whole and finding.place.utterance != (expected.utterance or SPOILT))
    ]
    assert not false_alarms
    named = next(finding for finding in findings if finding.code == expected.code)
    assert named.severity == codes()[expected.code].severity
    assert named.advice
    assert named.found


def test_defects_of_every_area_are_planted():
    planted = len(DEFECTS)
    assert planted >= 60
