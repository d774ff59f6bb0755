"""Docstrings are a reference: every parameter, with its shape or unit, and what is returned."""

import ast
import doctest
import importlib
import inspect
import re
import sys
from pathlib import Path

import pytest
from numpydoc.hooks.validate_docstrings import process_file

import mocap_fit

sys.path.insert(0, str(Path(__file__).parent))
from docstrings import faults, items, modules
from test_words import ROOT, every_module, functions

CHECKS = ["PR01", "PR02", "PR03", "PR07", "PR08", "PR10", "RT01", "RT03", "YD01", "SS05"]
PRIVATE = r"(^|\.)_"


def validate(path: Path, checks: list[str], exclude: str) -> list[str]:
    """What numpydoc's validator says of a module, a line a fault."""
    config = {
        "checks": set(checks),
        "exclude": exclude,
        "overrides": {},
        "exclude_files": set(),
    }
    rows = []
    # It takes properties for functions here.
    tree = ast.parse(path.read_text(encoding="utf-8"))
    properties = {node.name for node, is_property in functions(tree) if is_property}
    for where, name, check, problem in process_file(path, config):
        # It does not know the fields of a dataclass; those are checked by `docstrings`.
        last = name.rpartition(".")[2]
        is_class = last[:1].isupper()
        if last in properties and check in ("RT01", "SS05"):
            continue
        if not (is_class and check in ("PR01", "PR02", "PR03")):
            rows.append(f"line {where.rpartition(':')[2]} {name}: {check} {problem}")
    return rows


@every_module
def test_numpydoc_finds_nothing(path):
    rows = validate(path, CHECKS, PRIVATE)
    assert not rows, "\n".join(rows)


@every_module
def test_parameters_have_shapes_and_units(path):
    rows = [f"{item}: {fault}" for item in items(path, ROOT) for fault in faults(item)]
    assert not rows, "\n".join(rows)


def top_level() -> list[str]:
    return [name for name in mocap_fit.__all__ if not name.startswith("_") and name != "control"]


@pytest.mark.parametrize("name", top_level())
def test_what_users_import_has_examples_that_run(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    function = getattr(mocap_fit, name)
    module = importlib.import_module(function.__module__)
    text = inspect.getdoc(function)
    assert "\nSee Also\n" in text
    examples = [
        test
        for test in doctest.DocTestFinder(recurse=False).find(function, name, module)
        if test.examples
    ]
    assert examples, "there is no example"
    runner = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE)
    for test in examples:
        runner.run(test)
    assert not runner.failures


def test_help_points_to_what_is_there():
    """A name alone is at the top level; others are written with their module."""
    missing = []
    for name in top_level():
        text = inspect.getdoc(getattr(mocap_fit, name))
        section = text.partition("\nSee Also\n")[2].partition("\nExamples\n")[0]
        for other in re.findall(r"^([\w.]+) :", section, re.MULTILINE):
            home, _, last = other.removeprefix("mocap_fit.").rpartition(".")
            module = importlib.import_module(f"mocap_fit.{home}" if home else "mocap_fit")
            if not hasattr(module, last) or (not home and last not in mocap_fit.__all__):
                missing.append(f"{name}: {other}")
    assert not missing


def test_the_counter_sees_what_is_missing(tmp_path):
    package = tmp_path / "mocap_fit"
    package.mkdir()
    (package / "bad.py").write_text(
        'def read(path, rate: float):\n    """Read it.\n\n    Parameters\n    ----------\n'
        '    rate\n        How fast.\n    """\n',
        encoding="utf-8",
    )
    (path,) = modules(tmp_path)
    (item,) = items(path, tmp_path)
    assert list(faults(item)) == ["does not describe path", "gives no unit or range of rate"]
