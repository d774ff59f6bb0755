"""Checks of many utterances: the same in one process as in several."""

import os
import shutil
import warnings
from pathlib import Path

import pytest
from spoiling import DEFECTS

from corpus_tools.cli import app as cli
from corpus_tools.validation import Finding, Location, Report, load_thresholds
from corpus_tools.validation.many import check_each
from mocap_fit.errors import DataError, MocapFitWarning

FIXTURES = Path(__file__).parents[3] / "fixtures"

# Work for processes stands at the top of the module.


def locate(shared, item):
    return Location(f"{shared}/{item}.tsv", item)


def check(shared, item):
    if item == "dying":
        os._exit(0)
    if item == "mistaken":
        raise KeyError("of ours")
    if item == "large":
        raise MemoryError
    if item == "wrong":
        raise DataError("the numbers are wrong", line=3, found=7, expected=8, advice="Mend them.")
    warnings.warn(f"{item} is odd", MocapFitWarning, stacklevel=1)
    return [Finding("MF104", locate(shared, item), "1 spike")], [item]


def run(items, jobs):
    """Findings in their order, summaries and warnings."""
    report, counted = Report(load_thresholds()), []
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        summaries = check_each(
            (check, locate), "takes", items, report, jobs, lambda: counted.append(1)
        )
    assert len(counted) == len(items)
    found = [(f.code, f.location.file, f.found, f.advice) for f in report.findings]
    return found, summaries, [(w.category, str(w.message)) for w in caught]


NAMES = ["a", "mistaken", "b", "large", "wrong", "c"]


def test_each_error_is_a_finding_of_its_file():
    found, summaries, warned = run(NAMES, 1)
    assert summaries == ["a", "b", "c"]
    assert warned == [(MocapFitWarning, f"{name} is odd") for name in "abc"]
    assert [row[:2] for row in found] == [
        ("MF104" if name in "abc" else "MF001", f"takes/{name}.tsv") for name in NAMES
    ]
    assert "bug in mocap-fit (KeyError: 'of ours')" in found[1][2]
    assert "not enough memory" in found[3][2]
    assert found[4][2:] == ("line 3: the numbers are wrong (7)", "Mend them.")


def test_a_mistake_of_ours_is_raised_while_debugging(monkeypatch):
    monkeypatch.setenv("MOCAP_FIT_DEBUG", "1")
    assert len(run(["a", "large", "wrong"], 1)[0]) == 3
    with pytest.raises(KeyError, match="of ours"):
        run(NAMES, 1)


def test_nothing_is_nothing():
    assert run([], 2) == ([], [], [])


@pytest.mark.slow
def test_several_processes_find_the_same_and_one_that_dies_is_named():
    expected, summaries, warned = run(NAMES, 1)
    found, *others = run([*NAMES[:2], "dying", *NAMES[2:]], 2)
    assert others == [summaries, warned]
    (dead,) = [row for row in found if "dying" in row[1]]
    assert dead[0] == "MF001"
    assert "not checked: the process that worked on it was killed" in dead[2]
    found.remove(dead)
    assert found == expected


@pytest.mark.slow
def test_the_command_prints_the_same(corpus, tmp_path, capsys):
    for name, utterance in (("spike", "sim002"), ("swapped", "sim003"), ("stuck", "sim004")):
        DEFECTS[name](corpus, utterance)
    (corpus / "phones" / "sim001.parquet").write_bytes(b"PAR1")
    takes = tmp_path / "takes"
    shutil.copytree(FIXTURES / "defects", takes / "defects")
    for path in (corpus / "audio").iterdir():
        shutil.copy(path, takes)
    shown = []
    for jobs in (1, 2, 0):
        given = ["validate", corpus, takes, "--jobs", jobs, "--html", tmp_path / f"{jobs}.html"]
        assert cli.main([*map(str, given)]) == 1
        shown.append((capsys.readouterr(), (tmp_path / f"{jobs}.html").read_text("utf-8")))
    assert "MF106" in shown[0][0].out
    assert "checking utterances: 4 of 4" in shown[0][0].err
    assert shown[1] == shown[0]
    assert shown[2] == shown[0]
