"""Check many utterances, in this process or in several: the same findings in the same order."""

from __future__ import annotations

import contextlib
import warnings
from collections import defaultdict
from collections.abc import Callable, Sequence
from typing import Any

from corpus_tools.batch import catch_warnings
from corpus_tools.validation.findings import Finding, Location
from corpus_tools.validation.reading import Checked, describe_failure
from corpus_tools.validation.report import Report
from corpus_tools.validation.subject import Summary
from mocap_fit.errors import MocapFitWarning
from mocap_fit.processes import DeadProcess, run_locally

_Work = tuple[Callable[[Any, Any], Checked], Callable[[Any, Any], Location]]


def check_each(
    work: _Work,
    shared: Any,
    items: Sequence[Any],
    report: Report,
    jobs: int,
    advance: Callable[[], object],
) -> list[Summary]:
    """Check items, and add what is wrong to a report.

    Parameters
    ----------
    work
        Two functions of ``shared`` and an item, at the top of a module: one checks the item, and
        one says where it is.
    shared
        What the checks of all items need.
    items
        The items.
    report
        Has the findings afterwards, in the order of the items.
    jobs
        Number of processes; 0 for one per core.
    advance
        Called after every item.

    Returns
    -------
    list of Summary
        What the checks of all need, in the order of the items.
    """
    summaries: list[Summary] = []
    results: dict[int, Any] = {}
    stream = run_locally(_check_item, (work, shared), items, jobs, lambda index, done, of: None)
    with contextlib.closing(stream):
        for index, result in stream:
            results[index] = result
            advance()
    warned: defaultdict[str, list[str]] = defaultdict(list)
    for index, item in enumerate(items):
        result, location = results[index], work[1](shared, item)
        if isinstance(result, DeadProcess):
            text = f"it was not checked: {result.reason}"
            report.add([Finding("MF001", location, text)])
            continue
        findings, more, lines = result
        report.add(findings)
        summaries += more
        for line in lines:
            # What is said of many files is said once.
            cause = line.replace(location.file, "*") if location.file else line
            warned[cause].append(line)
    for first, *others in warned.values():
        more = f" (and the same of {len(others)} more)" if others else ""
        warnings.warn(f"{first}{more}", MocapFitWarning, stacklevel=2)
    return summaries


def _check_item(
    about: tuple[_Work, Any], item: Any, progress: Callable[[int, int], object]
) -> tuple[list[Finding], list[Summary], list[str]]:
    (check, locate), shared = about
    with catch_warnings() as lines:
        try:
            findings, summaries = check(shared, item)
        except Exception as error:
            location = locate(shared, item)
            findings, summaries = [describe_failure(error, location.file, location.utterance)], []
    return findings, summaries, lines
