"""What a report of a validation says in a few lines."""

from corpus_tools.validation import Report, load_thresholds
from corpus_tools.validation.findings import Finding, Location


def test_a_report_prints_its_counts_and_its_first_findings():
    report = Report(load_thresholds())
    assert repr(report) == "Report: 0 utterances checked: 0 errors, 0 warnings, 0 notes"
    places = [Location("a.tsv").at(f"chin_{k}", (3, 4), (0.05, 0.07)) for k in range(7)]
    report.add([Finding("MF104", place, "9 mm out and back") for place in places])
    report.finish()
    lines = repr(report).splitlines()
    assert lines[1].startswith("  MF104 a.tsv, chin_0, frames 3 to 4")
    assert "9 mm out and back" in lines[1]
    assert len(lines) == 7
    assert lines[-1] == "  … and 2 more"
