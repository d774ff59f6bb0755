"""Every defect is found and named, at its place, and nothing else is said of it.

Each is planted in one utterance of a small corpus. For quickness only that utterance is checked
again, and compared with what is known of the others; the slow test plants all of them in one
corpus and runs the command.
"""

import dataclasses

import pytest
from spoiling import DEFECTS, Expected

from corpus_tools.validation import Context, Report, corpora, load_codes, load_thresholds

# The utterance that is spoilt; the others must stay without a finding.
SPOILT = "sim002"
# The others are run with the slow tests.
QUICK = (
    "swapped",
    "face_of_fifteen_metres",
    "label_missing",
    "mirrored_axis",
    "spike",
    "stuck",
    "long_gap",
    "rate_wrong",
    "lips_open_on_a_bilabial",
    "provenance_lost",
    "head_marker_slipped",
    "uneven_time_stamps",
)


@pytest.fixture(scope="module")
def known(clean):
    """The context of the clean corpus, and what is kept of its utterances."""
    opened, found = corpora.open_for_checks(clean, Context(load_thresholds()))
    summaries = {}
    for utterance in opened.corpus:
        more, (summaries[utterance.id],) = corpora.check_utterance(opened, utterance)
        found += more
    found += corpora.check_between(list(summaries.values()), opened.context.limits, splits=True)
    assert [f"{f.code} {f.location}: {f.found}" for f in found] == []
    return opened.context, summaries


def checked_again(corpus, known):
    """All findings of a corpus that differs from the clean one in what is about `SPOILT`."""
    context, summaries = known
    opened, found = corpora.open_for_checks(corpus, dataclasses.replace(context, rate=None))
    kept = []
    for utterance in opened.corpus:
        if SPOILT in utterance.id:
            more, (summary,) = corpora.check_utterance(opened, utterance)
            found += more
        else:
            summary = dataclasses.replace(summaries[utterance.id], split=utterance.split)
        kept.append(summary)
    found += corpora.check_between(kept, context.limits, splits=True)
    report = Report(context.limits)
    report.add(found)
    report.finish()
    return report.findings


def off_by(found, expected):
    if expected is None:
        return 0.0
    if found is None:
        return float("inf")
    pairs = list(zip(found, expected, strict=True))
    # Frames until 10 000 are those to the end.
    return max(abs(a - b) for a, b in pairs[: 1 if expected[1] == 10_000 else 2])


def matches(finding, expected: Expected, name: str) -> bool:
    place = finding.location
    return (
        finding.code == expected.code
        and expected.item in place.item
        and (expected.whole or place.utterance == (expected.utterance or name))
        and off_by(place.frames, expected.frames) <= expected.slack
        and off_by(place.seconds, expected.seconds) <= 0.02 * max(1, expected.slack)
    )


def judge(findings, expected: Expected, name: str) -> None:
    """The defect is found at its place, and nothing else is."""
    told = [f"{f.code} {f.location}: {f.found}" for f in findings]
    assert any(matches(finding, expected, name) for finding in findings), told
    allowed = {expected.code, *expected.also}
    assert not [
        line
        for line, finding in zip(told, findings, strict=True)
        if finding.code not in allowed
        or (not expected.whole and finding.location.utterance != (expected.utterance or name))
    ]


@pytest.mark.parametrize(
    "name",
    [n if n in QUICK else pytest.param(n, marks=pytest.mark.slow) for n in DEFECTS],
)
def test_a_planted_defect_is_found_and_named(name, corpus, known):
    expected = DEFECTS[name](corpus, SPOILT)
    findings = checked_again(corpus, known)
    judge(findings, expected, SPOILT)
    named = next(finding for finding in findings if finding.code == expected.code)
    assert named.severity == load_codes()[expected.code].severity
    assert named.advice
    assert named.found


def test_what_is_planted_is_known():
    assert set(QUICK) <= set(DEFECTS)
    assert len(DEFECTS) > 80
