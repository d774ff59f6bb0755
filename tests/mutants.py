"""Mutation testing by sample: small changes of a room, each against the tests of that room.

``make mutants ROOM=tracks`` draws 80 changes of ``mocap_fit/tracks`` by a seed, makes each in a
copy of the repository with a numba cache of its own, and names those that no test notices. What
changes nothing has a line ``FILE: CHANGE # REASON`` in ``tests/equivalent_mutants.txt``.
"""

import argparse
import ast
import os
import random
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from queue import Queue

from scipy.stats import binomtest

ROOT = Path(__file__).parents[1]
EQUIVALENT = ROOT / "tests" / "equivalent_mutants.txt"
# File, line, the change in words, the changed source.
Mutant = tuple[Path, int, str, str]
SWAPS: dict[type, type] = {
    ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt, ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq, ast.Is: ast.IsNot, ast.IsNot: ast.Is, ast.In: ast.NotIn, ast.NotIn: ast.In,
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult, ast.And: ast.Or,
    ast.Or: ast.And, ast.FloorDiv: ast.Mult, ast.Pow: ast.Mult,
}  # fmt: skip


def is_text(node: ast.AST) -> bool:
    return isinstance(node, ast.JoinedStr) or isinstance(getattr(node, "value", None), str)


def changes(node: ast.AST) -> Iterator[ast.AST]:
    """Yield what may stand in place of a piece of code."""
    if isinstance(node, ast.Constant):
        if isinstance(node.value, bool):
            yield ast.Constant(not node.value)
        elif isinstance(node.value, int | float):
            yield ast.Constant(node.value + 1)
            if node.value:
                yield ast.Constant(node.value * 2)
    elif isinstance(node, ast.Compare):
        yield ast.Compare(node.left, [SWAPS[type(node.ops[0])](), *node.ops[1:]], node.comparators)
    elif isinstance(node, ast.BinOp) and type(node.op) in SWAPS:
        if not any(is_text(side) for side in (node.left, node.right)):
            yield ast.BinOp(node.left, SWAPS[type(node.op)](), node.right)
    elif isinstance(node, ast.BoolOp):
        yield ast.BoolOp(SWAPS[type(node.op)](), node.values)
    elif isinstance(node, ast.UnaryOp):
        yield node.operand
    elif isinstance(node, ast.AugAssign | ast.Expr) and not is_text(node.value):
        yield ast.Pass()


# Types and messages are no behaviour that a test should pin down.
SKIPPED = {"annotation", "returns", "decorator_list", "exc", "cause", "type_params", "bases"}


def walk(node: ast.AST) -> Iterator[tuple[ast.AST, str, int | None, ast.AST]]:
    """Each piece of code that may change, with where it hangs: parent, field, index."""
    for field, value in ast.iter_fields(node):
        if field in SKIPPED:
            continue
        for index, child in enumerate(value) if isinstance(value, list) else [(None, value)]:
            if isinstance(child, ast.AST):
                yield node, field, index, child
                yield from walk(child)


def mutants(room: Path) -> list[Mutant]:
    """List all changes of a room."""
    result = []
    for path in sorted(room.rglob("*.py")) if room.is_dir() else [room]:
        tree = ast.parse(path.read_text(encoding="utf-8"))
        for parent, field, index, child in list(walk(tree)):
            for changed in changes(child):
                inside = index is not None
                values, key = (getattr(parent, field), index) if inside else (vars(parent), field)
                values[key] = ast.copy_location(changed, child)
                words = f"{ast.unparse(child)[:60]} -> {ast.unparse(changed)[:60]}"
                result.append((path, child.lineno, words, ast.unparse(tree)))
                values[key] = child
    return result


def run_tests(folder: Path, tests: list[str]) -> int:
    """Run the quick tests of a copy and return pytest's status; one that hangs has failed."""
    settings = {"PYTHONPATH": str(folder), "NUMBA_CACHE_DIR": str(folder / "numba")}
    options = {"cwd": folder, "env": os.environ | settings, "capture_output": True}
    command = [sys.executable, "-m", "pytest", "-qx", "-m", "not slow and not real_data", *tests]
    try:
        return subprocess.run(command, timeout=300, check=False, **options).returncode
    except subprocess.TimeoutExpired:
        return 1


def try_mutant(mutant: Mutant, folders: Queue[Path], tests: list[str]) -> str:
    path, line, words, source = mutant
    name = f"{path.relative_to(ROOT)}: {words}"
    if EQUIVALENT.is_file() and f"{name} # " in EQUIVALENT.read_text("utf-8"):
        return "equivalent"
    folder = folders.get()
    target = folder / path.relative_to(ROOT)
    original = target.read_bytes()
    shutil.rmtree(folder / "numba", ignore_errors=True)
    shutil.copytree(folder / "numba_before", folder / "numba")
    target.write_text(source, encoding="utf-8")
    result = "killed" if run_tests(folder, tests) else "survived"
    target.write_bytes(original)
    folders.put(folder)
    print(f"{result:9} {path.relative_to(ROOT)}:{line}: {words}", flush=True)
    return result


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("room", help="a folder or file of mocap_fit, such as tracks")
    for option, default in (("--count", 80), ("--seed", 0), ("--jobs", os.cpu_count())):
        parser.add_argument(option, type=int, default=default)
    parser.add_argument("--tests", nargs="*", help="in place of tests/ROOM")
    options = parser.parse_args()
    every = mutants(ROOT / "mocap_fit" / options.room)
    drawn = random.Random(options.seed).sample(every, min(options.count, len(every)))
    tests = options.tests or [f"tests/{options.room}"]
    folders: Queue[Path] = Queue()
    with tempfile.TemporaryDirectory() as name, ThreadPoolExecutor(options.jobs) as workers:
        for job in range(options.jobs):
            folder = Path(name) / str(job)
            shutil.copytree(ROOT, folder, ignore=shutil.ignore_patterns(".*", "__pycache__"))
            if job == 0 and run_tests(folder, tests):
                sys.exit("the tests fail before anything is changed")
            (Path(name) / "0" / "numba").mkdir(exist_ok=True)
            shutil.copytree(Path(name) / "0" / "numba", folder / "numba_before")
            folders.put(folder)
        results = list(workers.map(lambda mutant: try_mutant(mutant, folders, tests), drawn))
    killed, of = results.count("killed"), len(results) - results.count("equivalent")
    interval = binomtest(killed, max(1, of)).proportion_ci(method="wilson")
    print(
        f"{options.room}: {killed} of {of} killed, Wilson {interval.low:.3f} to {interval.high:.3f}"
    )


if __name__ == "__main__":
    main()
