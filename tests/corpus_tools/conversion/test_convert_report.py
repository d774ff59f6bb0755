"""What is said of many utterances at once."""

import warnings
from pathlib import Path

from corpus_tools.batch import Context, Item, ItemResult
from corpus_tools.batch.item import try_item
from corpus_tools.cli.corpus_printing import CausePrinter
from corpus_tools.conversion.report import format_messages
from mocap_fit.errors import DataError, MocapFitWarning
from mocap_fit.phones import UnknownPhone


def test_many_warnings_are_cut_short():
    outcomes = {f"u{i:02d}": ItemResult("u", warnings=(f"look {i}",)) for i in range(30)}
    lines = format_messages(outcomes)
    assert lines[0] == "warning: u00: look 0"
    assert len(lines) == 11
    assert "20 more" in lines[-1]


def test_one_reason_is_one_line():
    outcomes = {f"u{i}": ItemResult("u", error="no reference") for i in range(8)} | {
        "a": ItemResult("a", error="bad")
    }
    lines = format_messages(outcomes)
    assert lines == [
        "error: a: bad",
        "error: 8 utterances (u0, u1, u2, u3, u4 and 3 more): no reference",
    ]


def fail(name: str, line: int, tmp_path: Path) -> ItemResult:
    """The result of a recording whose rate is wrong, as `run_batch` has it."""
    item = Item(name, tmp_path, (f"rec/{name}.tsv",), (f"{name}.parquet",), "lab/")
    context = Context(item, tmp_path, tmp_path, lambda done, total: None)

    def work() -> dict[str, object]:
        path = tmp_path / item.sources[0]
        warnings.warn(f"{path}: names come twice", MocapFitWarning, stacklevel=1)
        raise DataError("the frame rate is wrong", path=path, line=line, found="59 Hz")

    return try_item(context, work)


def test_one_cause_in_thirty_files_is_one_line(tmp_path, capsys):
    results = {f"u{k:02d}": fail(f"u{k:02d}", k, tmp_path) for k in range(30)}
    assert results["u03"].error == "lab/rec/u03.tsv, line 3: the frame rate is wrong (found 59 Hz)"
    assert format_messages(results) == [
        "warning: 30 utterances (u00, u01, u02, u03, u04 and 25 more): lab/rec/*.tsv: names come "
        "twice",
        "error: 30 utterances (u00, u01, u02, u03, u04 and 25 more): the frame rate is wrong "
        "(found 59 Hz)",
    ]
    assert format_messages({"u03": results["u03"]})[1] == f"error: u03: {results['u03'].error}"
    causes = CausePrinter()
    for result in results.values():
        causes.show_result(result)
    causes.finish()
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 4
    assert lines[0].endswith("warning: u00: lab/rec/u00.tsv: names come twice")
    assert lines[3].endswith(
        "error: the same of 29 more (u01, u02, u03, u04, u05 and 24 more): the frame rate is "
        "wrong (found 59 Hz)"
    )


def test_unknown_phones_of_all_are_one_list():
    outcomes = {
        name: ItemResult(
            name, error="unknown", details=(UnknownPhone("Q", 2, ((name, 0.5), (name, 0.75))),)
        )
        for name in ("a", "b")
    }
    more = UnknownPhone("X", 1, (("b", 1.0),))
    outcomes["b"] = ItemResult("b", error="unknown", details=(*outcomes["b"].details, more))
    (line,) = format_messages(outcomes)
    assert "2 symbols are not in the phone set" in line
    assert "'Q' 4× (a at 0.500 s, a at 0.750 s, b at 0.500 s, b at 0.750 s)" in line
    assert "'X' 1× (b at 1.000 s)" in line


def test_recordings_in_no_row():
    assert (
        "2 recordings are not in the table of sentences: x, y" in format_messages({}, ["x", "y"])[0]
    )
