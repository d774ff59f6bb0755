"""Checks of recordings, labels, sound and corpora.

What can be found has a code: ``codes.toml`` lists them all, as does ``mocap-fit validate --codes``.
What counts as wrong is in ``thresholds.toml``, and a user's file changes it. The way of an
utterance: `reading` makes a `Subject` of its files, `check_subject` gives findings and a small
`Summary`, and what lies between utterances (`check_between`) is found in the summaries alone, so
that a corpus may be larger than the memory.
"""

from corpus_tools.validation.findings import Code, Evidence, Finding, Location, Severity, load_codes
from corpus_tools.validation.report import Report
from corpus_tools.validation.subject import Context, Subject, Summary, check_subject
from corpus_tools.validation.thresholds import Thresholds, load_thresholds

__all__ = [
    "Code",
    "Context",
    "Evidence",
    "Finding",
    "Location",
    "Report",
    "Severity",
    "Subject",
    "Summary",
    "Thresholds",
    "check_subject",
    "load_codes",
    "load_thresholds",
]
