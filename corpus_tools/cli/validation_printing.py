"""Print what a validation has found, and the table of all codes."""

from __future__ import annotations

from corpus_tools.cli import console, display
from corpus_tools.validation.findings import Severity, load_codes
from corpus_tools.validation.report import Report, group_by_code, to_code_records
from mocap_fit.errors import shorten

_SHOWN = 5
# Characters of a finding; the page and the JSON have them all.
_LONGEST = 600
_COLOURS = {Severity.ERROR: "bold red", Severity.WARNING: "yellow", Severity.NOTE: "dim"}


def print_report(report: Report) -> None:
    """Print a report for people on stdout.

    Parameters
    ----------
    report
        What was checked and found.
    """
    from rich.text import Text

    screen = display.create_screen()
    for line in report.checked:
        screen.print(Text(console.to_printable(line)), soft_wrap=True)
    for first, members in group_by_code(report.findings):
        head = Text()
        head.append(f"\n{first.severity.value} ", style=_COLOURS[first.severity])
        head.append(f"{first.code} ", style="bold")
        head.append(first.title)
        if len(members) > 1:
            head.append(f" ({len(members)})")
        screen.print(head, soft_wrap=True)
        for finding in members[:_SHOWN]:
            line = f"  {finding.location}: {finding.found}"
            if finding.expected:
                line += f"; expected {finding.expected}"
            line = shorten(line, _LONGEST)
            screen.print(Text("  " + console.to_printable(line)), soft_wrap=True)
        if len(members) > _SHOWN:
            screen.print(Text(f"  and {len(members) - _SHOWN} more (--json and --html have all)"))
        screen.print(Text(f"  {first.advice}", style="italic"), soft_wrap=True)
    screen.print(Text(("\n" if report.findings else "") + report.format_verdict()), soft_wrap=True)


def print_codes(*, as_json: bool) -> None:
    """Print the table of all codes on stdout.

    Parameters
    ----------
    as_json
        Whether JSON is printed.
    """
    if as_json:
        display.print_json(to_code_records())
        return
    from rich import box
    from rich.table import Table

    shown = Table(box=box.SIMPLE_HEAD)
    for title in ("code", "about", "severity", "what is wrong", "what to do"):
        shown.add_column(title, overflow="fold")
    for code in load_codes().values():
        shown.add_row(code.code, code.area, code.severity.value, code.title, code.advice)
    display.create_screen().print(shown)
