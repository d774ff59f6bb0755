"""A report as one HTML page that holds its pictures."""

from __future__ import annotations

import html
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

from corpus_tools.html_page import (
    format_heading,
    format_page,
    format_paragraph,
    format_picture,
    format_table,
)
from corpus_tools.validation.findings import Finding, Severity
from corpus_tools.validation.pictures import draw_evidence, list_overviews
from corpus_tools.validation.report import Report, group_by_code
from mocap_fit.atomic_file import remove_partials, write_text
from mocap_fit.drawing import save_figure

_COLOURS = {Severity.ERROR: "#B00020", Severity.WARNING: "#9A6700", Severity.NOTE: "#555555"}
# Rows of a table of findings that the page shows at once.
_MOST_ROWS = 500


def write_page(report: Report, path: Path) -> None:
    """Write a report as one page of HTML, whole or not at all; the same report, the same bytes.

    Parameters
    ----------
    report
        After its `finish`.
    path
        The file; one that exists is replaced.

    Raises
    ------
    FileFormatError
        If it cannot be written.
    """
    with tempfile.TemporaryDirectory() as folder:
        text = format_page("What mocap-fit validate found", _format_parts(report, Path(folder)))
    remove_partials(path)
    write_text(path, text, "page")


def _format_parts(report: Report, folder: Path) -> Iterator[str]:
    for line in report.checked:
        yield format_paragraph(line)
    colour = _COLOURS[Severity.NOTE] if report.is_clean else _COLOURS[Severity.ERROR]
    verdict = html.escape(report.format_verdict())
    yield f'<p style="font-size:1.1rem;color:{colour}"><b>{verdict}</b></p>'
    groups = group_by_code(report.findings)
    if groups:
        yield format_heading("In short")
        yield format_table(
            ("severity", "code", "what is wrong", "how many", "what to do"),
            [(f.severity.value, f.code, f.title, len(members), f.advice) for f, members in groups],
        )
        yield format_heading("All findings")
    for first, members in groups:
        yield _format_group(first, members)
        for number, finding in enumerate(f for f in members if f.evidence is not None):
            target = folder / f"{finding.severity.value}_{finding.code}_{number}.svg"
            save_figure(target, draw_evidence, finding)
            yield format_picture(target, f"{finding.code}, {finding.location}: {finding.found}")
    figures = list(list_overviews(report))
    if figures:
        yield format_heading("What is usual")
    for number, (caption, draw) in enumerate(figures):
        target = folder / f"overview_{number}.svg"
        save_figure(target, draw)
        yield format_picture(target, caption)
    yield format_heading("Thresholds")
    yield format_paragraph(
        "A file with some of these lines, given with `--thresholds`, changes what counts as wrong."
    )
    yield _format_thresholds(report)


def _format_group(first: Finding, members: list[Finding]) -> str:
    colour = _COLOURS[first.severity]
    head = (
        f'<summary style="margin:0.5rem 0"><b style="color:{colour}">{first.severity.value} '
        f"{first.code}</b> {html.escape(first.title)} ({len(members)})</summary>"
    )
    rows = []
    for finding in members[:_MOST_ROWS]:
        where = finding.location
        frames = "" if where.frames is None else _format_span(where.frames)
        seconds = "" if where.seconds is None else "{:.3f}–{:.3f}".format(*where.seconds)
        texts = (finding.found, finding.expected, where.file)
        rows.append((where.utterance, where.item, frames, seconds, *texts))
    header = ("utterance", "what", "frames", "seconds", "found", "expected", "file")
    table = _format_table(header, rows)
    more = ""
    if len(members) > _MOST_ROWS:
        more = format_paragraph(f"and {len(members) - _MOST_ROWS} more; `--json` has all.")
    opened = " open" if first.severity is not Severity.NOTE or len(members) <= 10 else ""
    return f"<details{opened}>{head}{format_paragraph(first.advice)}{table}{more}</details>"


def _format_table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Format a table of texts, without the columns that are empty."""
    columns = [k for k in range(len(header)) if any(row[k] for row in rows)]

    def format_row(tag: str, cells: Sequence[str]) -> str:
        return "".join(f"<{tag} class=text>{html.escape(cells[k])}</{tag}>" for k in columns)

    body = "\n".join(f"<tr>{format_row('td', row)}</tr>" for row in rows)
    head = f"<thead><tr>{format_row('th', header)}</tr></thead>"
    return f"<table>\n{head}\n<tbody>\n{body}\n</tbody></table>"


def _format_span(frames: tuple[int, int]) -> str:
    return str(frames[0]) if frames[0] == frames[1] else f"{frames[0]}–{frames[1]}"


def _format_thresholds(report: Report) -> str:
    rows = [
        (section, name, value)
        for section, values in report.limits.to_record().items()
        for name, value in values.items()
    ]
    table = format_table(("section", "name", "value"), rows)
    return f"<details><summary>All</summary>{table}</details>"
