"""Print what the commands that make corpora have done."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from corpus_tools.batch import ItemResult
from corpus_tools.cli import console, display
from corpus_tools.conversion.align import AlignReport
from corpus_tools.conversion.fit import FitReport
from corpus_tools.conversion.report import ConversionReport, list_names
from corpus_tools.conversion.select_sentences import SelectionReport
from mocap_fit.errors import MocapFitError, describe_error, is_debugging, shorten

_COLUMNS = {
    "frames": "frames",
    "fitted": "fitted",
    "residual_mm": "residual mm",
    "head_residual_mm": "head mm",
    "uncertain_frames": "uncertain",
    "evaluations_per_frame": "evaluations",
}
# More recordings than this are summed up, and only the worst are listed.
_LISTED = 20
# Characters of a cause that has been printed already.
_CAUSE = 120
# How many of the missing words are shown; the file has them all.
_WORDS = 10


class CausePrinter:
    """Prints errors and warnings as they come: of one cause the first, and at the end a count."""

    def __init__(self) -> None:
        self._repeated: dict[str, list[str]] = {}

    def show(self, name: str, line: str, cause: str) -> None:
        """Print a line, unless one of the same cause was printed.

        Parameters
        ----------
        name
            What the line is about, such as a recording.
        line
            The line.
        cause
            The same without what is of this recording alone.
        """
        if cause in self._repeated:
            self._repeated[cause].append(name)
        else:
            self._repeated[cause] = []
            console.say(line)

    def show_error(self, path: str, error: Exception) -> None:
        """Print an error.

        Parameters
        ----------
        path
            The file that it is about.
        error
            The error.
        """
        if is_debugging() or not isinstance(error, MocapFitError):
            console.print_error(error, path)
        else:
            self.show(path, f"error: {describe_error(error, path)}", f"error: {error.cause}")

    def show_result(self, result: ItemResult) -> None:
        """Print the warnings and the error of a recording.

        Parameters
        ----------
        result
            What came of the recording.
        """
        for line in () if console.is_quiet() else result.warnings:
            cause = f"warning: {result.causes.get(line, line)}"
            self.show(result.name, f"warning: {result.name}: {line}", cause)
        if result.error is not None:
            cause = f"error: {result.causes.get(result.error, result.error)}"
            self.show(result.name, f"error: {result.error}", cause)

    def finish(self) -> None:
        """Print how often each cause came again, and where."""
        for cause, names in self._repeated.items():
            if names:
                kind, _, text = cause.partition(": ")
                text = shorten(text, _CAUSE)
                console.say(f"{kind}: the same of {len(names)} more ({list_names(names)}): {text}")


def print_fit(report: FitReport) -> None:
    """Print the figures of a fit: a table, or the worst recordings of many.

    Parameters
    ----------
    report
        What was fitted.
    """
    rows = [row for row in report.recordings if "error" not in row]
    if not rows:
        return
    listed, title = rows, None
    if len(rows) > _LISTED:
        listed = sorted(rows, key=lambda row: -float(row["residual_mm"]))[:5]
        title = f"the {len(listed)} recordings with the largest residuals"
    cells = [
        [row["recording"], *(f"{c:.2f}" if isinstance(c, float) else str(c) for c in figures)]
        for row in listed
        if (figures := [row[key] for key in _COLUMNS])
    ]
    table = display.create_table(["recording", *_COLUMNS.values()], cells)
    table.title, table.title_justify = title, "left"
    display.create_screen().print(table)
    frames, fitted = (sum(row[key] for row in rows) for key in ("frames", "fitted"))
    residual = float(np.median([row["residual_mm"] for row in rows]))
    cached = sum(row["kept"] for row in rows)
    before = f" ({cached} of them before)" if cached else ""
    display.print_lines(
        f"{len(rows)} of {len(report.recordings)} recordings fitted{before}: {fitted} of {frames} "
        f"frames, median residual {residual:.2f} mm. Parameters are in {report.out} "
        f"(layout {report.layout})."
    )


def print_conversion(report: ConversionReport) -> None:
    """Print a summary of a conversion.

    Parameters
    ----------
    report
        What was converted.
    """
    content = report.to_dict()
    rows = [row for row in content["utterances"] if "error" not in row]
    bad = [row["id"] for row in content["utterances"] if "error" in row]
    lines = _summarise(rows) if rows else []
    if report.removed:
        removed = list_names(report.removed)
        lines.append(f"removed, as they are bad or not in the manifest: {removed}")
    if bad:
        lines.append(f"left out, {len(bad)}: {list_names(bad)}")
    cached = f", {content['kept']} of them from before" if content["kept"] else ""
    total = len(report.entries)
    layout = f" (layout {report.layout})" if report.layout else ""
    lines.append(
        f"{len(rows)} of {total} utterances are in the corpus{cached}{layout}: {report.out}"
    )
    display.print_lines(*map(console.to_printable, lines))


def _summarise(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    splits = Counter(row["split"] for row in rows)
    parts = ", ".join(f"{count} {name}" for name, count in sorted(splits.items()))
    speakers = len({row["speaker"] for row in rows})
    sessions = len({(row["speaker"], row["session"]) for row in rows})
    minutes = sum(row["duration"] for row in rows) / 60
    frames, fitted = (sum(row[key] for row in rows) for key in ("frames", "fitted"))
    residual, head = (
        float(np.median([row[key] for row in rows])) for key in ("residual_mm", "head_residual_mm")
    )
    lines = [
        f"{parts}; {minutes:.1f} minutes, {sum(row['phones'] for row in rows)} phones, "
        f"{_count(speakers, 'speaker')}, {_count(sessions, 'session')}",
        f"{fitted} of {frames} frames fitted, median residual {residual:.2f} mm "
        f"(head {head:.2f} mm)",
        _summarise_clocks([row["sync"] for row in rows]),
    ]
    noted = sum(bool(row["checks"]) for row in rows)
    if noted:
        lines.append(f"{noted} with something to look at: the column checks of the table says what")
    return lines


def _summarise_clocks(clocks: Sequence[Mapping[str, Any]]) -> str:
    kinds = Counter(each["kind"] for each in clocks)
    parts = []
    drifts = [each["drift_ppm"] for each in clocks if each["kind"] == "pulses"]
    if drifts:
        missing = sum(each["missing"] for each in clocks if each["kind"] == "pulses")
        parts.append(
            f"{len(drifts)} by pulses ({missing} pulses missing), drift {np.median(drifts):+.1f} "
            f"ppm ({min(drifts):+.1f} to {max(drifts):+.1f})"
        )
    estimates = [each["correlation"] for each in clocks if each["is_estimate"]]
    if estimates:
        parts.append(
            f"{len(estimates)} ESTIMATED by lips and energy, correlation {np.median(estimates):.2f}"
        )
    if kinds["none"]:
        text = f"{kinds['none']} by their start time"
        if not any(each["start_time"] for each in clocks if each["kind"] == "none"):
            text += ", 0 s (if that is not so: start_time or [sync] in a manifest)"
        parts.append(text)
    return "on the clock of the sound: " + "; ".join(parts)


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


def print_alignment(report: AlignReport) -> None:
    """Print how many sounds were aligned.

    Parameters
    ----------
    report
        What was aligned.
    """
    seconds = sum(row["duration"] for row in report.aligned)
    phones = sum(row["phones"] for row in report.aligned)
    display.print_lines(
        f"{len(report.aligned)} of {len(report.aligned) + len(report.errors)} sounds aligned: "
        f"{phones} phones in {seconds:.1f} s. Labels are in {report.out}."
    )


def print_selection(report: SelectionReport, *, as_json: bool) -> None:
    """Print how much the selected sentences cover.

    Parameters
    ----------
    report
        What was selected.
    as_json
        Whether JSON is printed.
    """
    missing = report.missing_words
    if missing:
        listed = ", ".join(f"{row['word']} ({row['count']})" for row in missing[:_WORDS])
        more = ", …" if len(missing) > _WORDS else ""
        console.say(f"{len(missing)} words are not in the dictionary: {listed}{more}")
    content = report.to_dict()
    if as_json:
        display.print_json(content)
        return
    candidates = report.sentences - report.left_out
    display.create_screen().print(
        f"{content['chosen']} of {candidates:,} sentences ({report.left_out:,} left out) have "
        f"{content['covered']:,} of {report.triphones:,} triphones "
        f"({100 * content['share_of_kinds']:.1f} %), which are "
        f"{100 * content['share_of_occurrences']:.1f} % of all occurrences: {report.out}"
    )
