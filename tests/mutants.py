"""Mutation testing by sample: small changes of a room, each against the tests of that room.

``make mutants ROOM=tracks`` draws 80 changes of ``mocap_fit/tracks`` by a seed, makes each in a
copy of the repository with a numba cache of its own, and names those that no test notices. What
changes nothing has a line ``FILE: LINE: CHANGE # REASON`` in ``tests/equivalent_mutants.txt``.
"""

import argparse
import ast
import os
import random
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from queue import Queue

from scipy.stats import binomtest

ROOT = Path(__file__).parents[1]
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
            if node.value not in (0, 1):
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
        for index, child in enumerate(value) if isinstance(value, list) else [(None, value)]:
            strict = getattr(child, "arg", None) == "strict"
            if isinstance(child, ast.AST) and not strict and field not in SKIPPED:
                yield node, field, index, child
                yield from walk(child)


def mutants(room: Path) -> Iterator[Mutant]:
    """List all changes of a room."""
    for path in sorted(room.rglob("*.py")) if room.is_dir() else [room]:
        tree = ast.parse(path.read_text(encoding="utf-8"))
        for parent, field, at, child in list(walk(tree)):
            values, key = (vars(parent), field) if at is None else (getattr(parent, field), at)
            for changed in changes(child):
                values[key] = ast.copy_location(changed, child)
                words = f"{ast.unparse(child)[:60]} -> {ast.unparse(changed)[:60]}"
                yield path, child.lineno, words, ast.unparse(tree)
                values[key] = child


def split_tests(folder: Path, file: Path) -> tuple[list[Path], list[Path]]:
    """Return the files of tests of a module's name, or those that import it, and all others."""
    tests, module = sorted(folder.rglob("test_*.py")), ".".join(file.with_suffix("").parts)
    first = [test for test in tests if test.stem == f"test_{file.stem}"]
    first = first or [test for test in tests if module in test.read_text("utf-8")]
    return first, [test for test in tests if test not in first]


def fails(folder: Path, tests: list[Path], limit: float = 3600, cache: str = "") -> bool:
    """Run the quick tests of a copy; those that hang fail; where there are none nothing does."""
    settings = {"PYTHONPATH": str(folder), "NUMBA_CACHE_DIR": f"{folder}/numba{cache}"}
    how = {"cwd": folder, "env": os.environ | settings, "capture_output": True, "check": False}
    # Seconds of the processor: on a busy machine no mutant is killed because it had to wait.
    command = ["prlimit", f"--cpu={limit:.0f}", sys.executable, "-m", "pytest", "-qx", "-m"]
    command += ["not slow and not real_data", *map(str, tests)]
    try:
        return subprocess.run(command, timeout=20 * limit, **how).returncode not in (0, 5)
    except subprocess.TimeoutExpired:
        return True


def try_mutant(mutant: Mutant, folders: Queue[Path], tests: str, limit: float) -> str:
    path, line, words, source = mutant
    file, before = path.relative_to(ROOT), path.read_text("utf-8")
    words = f"{before.splitlines()[line - 1].strip()}: {words}"
    if f"{file}: {words} # " in (ROOT / "tests/equivalent_mutants.txt").read_text("utf-8"):
        return "equivalent"
    folder = folders.get()
    (folder / file).write_text(source, encoding="utf-8")
    # Numba notices a change in the file of a function only, not in those that it calls.
    cache = f"/{time.monotonic_ns()}" if "numba" in before else ""
    failed = any(fails(folder, t, limit, cache) for t in split_tests(folder / tests, file) if t)
    shutil.copy2(path, folder / file)
    folders.put(folder)
    result = "killed" if failed else "survived"
    print(f"{result:9} {file}:{line}: {words}", flush=True)
    return result


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("room", help="a folder or file of mocap_fit, such as tracks")
    for option, default in (("--count", 80), ("--seed", 0), ("--jobs", os.cpu_count())):
        parser.add_argument(option, type=int, default=default)
    options = parser.parse_args()
    every = list(mutants(ROOT / "mocap_fit" / options.room))
    drawn = random.Random(options.seed).sample(every, min(options.count, len(every)))
    tests, folders = f"tests/{options.room.split('/')[0]}", Queue[Path]()
    with tempfile.TemporaryDirectory() as name, ThreadPoolExecutor(options.jobs) as workers:
        for job in range(options.jobs):
            folder = Path(name) / str(job)
            shutil.copytree(ROOT, folder, ignore=shutil.ignore_patterns(".*", "__pycache__"))
            folders.put(folder)
        if fails(folder, [folder / tests]):
            sys.exit("the tests fail before anything is changed")
        limit = max(60.0, 5 * resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime)
        results = list(workers.map(lambda mutant: try_mutant(mutant, folders, tests, limit), drawn))
    killed, of = results.count("killed"), len(results) - results.count("equivalent")
    low, high = binomtest(killed, max(1, of)).proportion_ci(method="wilson")
    print(f"{options.room}: {killed} of {of} killed, Wilson {low:.3f} to {high:.3f}")


if __name__ == "__main__":
    main()
