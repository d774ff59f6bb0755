"""The rules of the house, as DESIGN.md has them."""

import ast
import importlib.metadata
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest

import mocap_fit

ROOT = Path(__file__).parents[1]
PACKAGES = ("mocap_fit", "corpus_tools")

# Data flow down these lists: a module imports only from its own room and from rooms above it.
ROOMS = {
    "mocap_fit": (
        "_version",
        "errors",
        "plain_text",
        "registry",
        "atomic_file",
        "size_limit",
        "parsing",
        "settings_file",
        "processes",
        "drawing",
        "tracks",
        "phones",
        "io",
        "labels",
        "sound",
        "utterance",
        "corpus",
        "edits",
        "head",
        "face",
        "fitting",
        "stereo",
        "control",
        "evaluation",
        "synthesis",
        "render",
        "experiment",
    ),
    # The commands' work, and last the command line, which calls it and prints what it returns.
    "corpus_tools": (
        "html_page",
        "json_file",
        "tasks",
        "batch",
        "cameras",
        "conversion",
        "simulation",
        "validation",
        "training",
        "talking",
        "inspection",
        "demonstration",
        "cli",
    ),
}

LONGEST_FILE = 500
# Files that may be longer, each with its reason.
LONGER_FILES: dict[str, str] = {}

HEAVY = {
    "cv2",
    "matplotlib",
    "nlopt",
    "numba",
    "numpy",
    "pandas",
    "pandera",
    "pyarrow",
    "pydantic",
    "pyvista",
    "scipy",
    "trimesh",
    "vtkmodules",
}

MODULES = sorted(path for package in PACKAGES for path in (ROOT / package).rglob("*.py"))
every_module = pytest.mark.parametrize(
    "path", MODULES, ids=[path.relative_to(ROOT).as_posix() for path in MODULES]
)


def parsed(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"), str(path))


def dotted_name(path: Path) -> list[str]:
    parts = list(path.relative_to(ROOT).with_suffix("").parts)
    return parts[:-1] if parts[-1] == "__init__" else parts


def imported(path: Path) -> Iterator[tuple[str, int]]:
    """Dotted names of all that a module imports, wherever in the module it does, and the line."""
    for node in ast.walk(parsed(path)):
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield alias.name, node.lineno
        elif isinstance(node, ast.ImportFrom):
            package = [node.module] if node.module else []
            if node.level:
                here = dotted_name(path)
                up = node.level - (path.name == "__init__.py")
                package = [*here[: len(here) - up], *package]
            for alias in node.names:
                yield ".".join([*package, alias.name]), node.lineno


def room(dotted: str) -> str | None:
    """The room of an imported name of our packages; None for the package itself."""
    package, _, rest = dotted.partition(".")
    first = rest.partition(".")[0]
    if package == "mocap_fit" and first in mocap_fit._HOMES:
        return mocap_fit._HOMES[first].split(".")[1]
    if not first or first.startswith("__") or first == "*":
        return None
    return first


# The package itself names the public functions of every room, and so imports from all.
@pytest.mark.parametrize(
    "path",
    [path for path in MODULES if len(dotted_name(path)) > 1],
    ids=lambda path: path.relative_to(ROOT).as_posix(),
)
def test_modules_import_only_from_rooms_above(path):
    package, *inside = dotted_name(path)
    order = ROOMS[package]
    assert inside[0] in order, f"{inside[0]} has no place in the list of rooms: give it one"
    wrong = []
    for name, line in imported(path):
        if name.partition(".")[0] != package:
            continue
        other = room(name)
        if other is not None and (
            other not in order or order.index(other) > order.index(inside[0])
        ):
            wrong.append(f"line {line}: {name}")
    assert not wrong, f"{path.name} imports from below its room"


def test_mocap_fit_never_imports_the_command_line():
    library = [path for path in MODULES if path.is_relative_to(ROOT / "mocap_fit")]
    assert library
    for path in library:
        guests = [name for name, _ in imported(path) if name.startswith("corpus_tools")]
        assert not guests, f"{path.name} imports {guests}"


@every_module
def test_nothing_we_open_can_run_code_and_no_second_array_library_comes_in(path):
    roots = {name.partition(".")[0] for name, _ in imported(path)}
    assert not roots & {"pickle", "dill", "joblib", "torch", "jax", "tensorflow"}


@every_module
def test_files_are_short_and_have_a_home(path):
    name = path.relative_to(ROOT).as_posix()
    assert path.stem not in {"utils", "util", "helpers", "helper", "misc", "common"}
    if name not in LONGER_FILES:
        lines = len(path.read_text(encoding="utf-8").splitlines())
        assert lines <= LONGEST_FILE, f"{name} wants to be two files"


def test_test_files_have_names_of_their_own():
    # pytest imports them by their names alone.
    names = [path.name for path in (ROOT / "tests").rglob("test_*.py")]
    assert sorted(set(names)) == sorted(names)


def test_exceptions_to_the_length_are_still_needed():
    for name in LONGER_FILES:
        assert len((ROOT / name).read_text(encoding="utf-8").splitlines()) > LONGEST_FILE


def without_docstring(body: list[ast.stmt], inside: str = "") -> Iterator[str]:
    for node in body:
        if not isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            continue
        decorators = {ast.unparse(decorator) for decorator in node.decorator_list}
        # A setter speaks through its property, an overload through what it is an overload of.
        if node.name.startswith("_") or any(
            re.search(r"overload$|override$|\.setter$", decorator) for decorator in decorators
        ):
            continue
        if ast.get_docstring(node) is None:
            yield f"{inside}{node.name} (line {node.lineno})"
        if isinstance(node, ast.ClassDef):
            yield from without_docstring(node.body, f"{node.name}.")


@every_module
def test_everything_public_has_a_docstring(path):
    tree = parsed(path)
    assert ast.get_docstring(tree), "the module says nothing about itself"
    assert not list(without_docstring(tree.body))


def test_both_packages_are_typed_and_say_so_when_installed():
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    for package in PACKAGES:
        assert (ROOT / package / "py.typed").is_file()
        assert "py.typed" in settings["tool"]["setuptools"]["package-data"][package]


def test_every_data_file_is_installed():
    """An editable install has them all; only what package-data names reaches a user."""
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    for package in PACKAGES:
        folder = ROOT / package
        patterns = settings["tool"]["setuptools"]["package-data"][package]
        installed = {path for pattern in patterns for path in folder.glob(pattern)}
        data = {
            path
            for path in folder.rglob("*")
            if path.is_file()
            and path.suffix != ".py"
            and not path.name.startswith(".")
            and "__pycache__" not in path.parts
        }
        assert not data - installed, "name them under package-data in pyproject.toml"


def test_the_version_has_one_home():
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    assert "version" not in settings["project"]
    attribute = settings["tool"]["setuptools"]["dynamic"]["version"]["attr"]
    assert attribute == "mocap_fit._version.__version__"
    installed = importlib.metadata.version("mocap-fit")
    assert installed == mocap_fit.__version__, "install again: pip install -e ."


def test_the_citation_and_the_entry_points_agree_with_the_code():
    citation = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert f"version: {mocap_fit.__version__}\n" in citation
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    groups = settings["project"]["entry-points"]
    for group, entries in groups.items():
        for name, target in entries.items():
            module = ROOT / target.partition(":")[0].replace(".", "/")
            found = module.with_suffix(".py").is_file() or (module / "__init__.py").is_file()
            assert found, f"{group} {name}: there is no {target}"


@pytest.mark.parametrize("module", ["mocap_fit", "mocap_fit.errors", "corpus_tools.cli.app"])
def test_importing_costs_nothing(module):
    code = f"import sys, {module}; print(*{{name.partition('.')[0] for name in sys.modules}})"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert not HEAVY & set(run.stdout.split())
