"""What the docstrings of the public functions and classes say, read from the source.

``python tests/docstrings.py [FOLDER]`` prints how many public functions with arguments describe
them, room by room; a folder of another checkout compares.
"""

from __future__ import annotations

import ast
import re
import sys
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from numpydoc.docscrape import NumpyDocString

PACKAGES = ("mocap_fit", "corpus_tools")
Function = ast.FunctionDef | ast.AsyncFunctionDef

# An annotation that holds numbers of a kind that want a shape, or a unit.
ARRAY = re.compile(r"\b(NDArray|FloatArray|BoolArray|IntArray|ArrayLike|ndarray)\b")
FLOAT = re.compile(r"\bfloat\b")
SHAPE = re.compile(r"`\([^`]*\)`|\bscalar\b")
UNIT = re.compile(
    r"""\b(millimetres?|mm|metres?|seconds?|milliseconds?|hertz|Hz|radians?|degrees?|pixels?
    |samples?|frames?|dB|decibels?|per\ cent|percent|inches|points?|bytes|words\ a\ minute
    |no\ unit|dimensionless|unit|units|share|part|fraction|probability|level|scale|factor|ratio
    |weights?|strength|full\ gestures?|parameters?|standard\ deviations?|gestures?
    |0\ to\ 1|between\ 0|above\ 0|0\ or\ more|-?1\ to\ 1|millionths|epochs?|phones?)\b|°|%|µ""",
    re.VERBOSE,
)
AS_FOR = re.compile(r"\b[Aa]s (for|in|of) `|\b[Ss]ee `[^`]+`\.?$")


@dataclass(frozen=True)
class Item:
    """A public function or class.

    Parameters
    ----------
    name
        Dotted, from the module on.
    path
        The file, under the root.
    line
        Of its definition.
    parameters
        Name and annotation of each argument, or of each field of a dataclass.
    returns
        Whether it returns something.
    docstring
        What it says; empty where it says nothing.
    is_class
        Whether it is a class.
    """

    name: str
    path: str
    line: int
    parameters: tuple[tuple[str, str], ...]
    returns: str
    docstring: str
    is_class: bool

    @property
    def doc(self) -> NumpyDocString:
        return NumpyDocString(self.docstring)

    @property
    def described(self) -> dict[str, str]:
        """The text of each parameter that the docstring names."""
        texts = {}
        for parameter in self.doc["Parameters"]:
            for name in parameter.name.split(","):
                texts[name.strip().lstrip("*")] = " ".join(parameter.desc)
        return texts

    def __str__(self) -> str:
        return f"{self.path}:{self.line} {self.name}"


def decorators(node: Function | ast.ClassDef) -> set[str]:
    return {ast.unparse(one).split("(")[0].split(".")[-1] for one in node.decorator_list}


def annotation(node: ast.expr | None) -> str:
    return "" if node is None else ast.unparse(node).strip("'\"")


def arguments(node: Function) -> tuple[tuple[str, str], ...]:
    every = [*node.args.posonlyargs, *node.args.args]
    if every and every[0].arg in ("self", "cls"):
        every = every[1:]
    every += [arg for arg in (node.args.vararg, *node.args.kwonlyargs, node.args.kwarg) if arg]
    return tuple((arg.arg, annotation(arg.annotation)) for arg in every)


def fields(node: ast.ClassDef) -> tuple[tuple[str, str], ...]:
    """The fields that a dataclass's constructor takes."""
    pairs = []
    for one in node.body:
        if isinstance(one, ast.AnnAssign) and isinstance(one.target, ast.Name):
            text = annotation(one.annotation)
            hidden = one.value is not None and "init=False" in ast.unparse(one.value)
            if not one.target.id.startswith("_") and "ClassVar" not in text and not hidden:
                pairs.append((one.target.id, text))
    return tuple(pairs)


def items(path: Path, root: Path) -> Iterator[Item]:
    """The public functions and classes of a module."""
    short = path.relative_to(root).as_posix()

    def walk(body: list[ast.stmt], prefix: str) -> Iterator[Item]:
        for node in body:
            if not isinstance(node, Function | ast.ClassDef) or node.name.startswith("_"):
                continue
            marks = decorators(node)
            docstring = ast.get_docstring(node) or ""
            name = prefix + node.name
            if isinstance(node, ast.ClassDef):
                pairs = fields(node) if "dataclass" in marks else ()
                yield Item(name, short, node.lineno, pairs, "", docstring, True)
                yield from walk(node.body, f"{name}.")
            elif not marks & {"overload", "override", "setter"}:
                is_property = marks & {"property", "cached_property"}
                returns = "" if is_property else annotation(node.returns)
                if returns in ("None", "NoReturn", "Never"):
                    returns = ""
                yield Item(name, short, node.lineno, arguments(node), returns, docstring, False)

    yield from walk(ast.parse(path.read_text(encoding="utf-8")).body, "")


def modules(root: Path) -> list[Path]:
    return sorted(path for package in PACKAGES for path in (root / package).rglob("*.py"))


def faults(item: Item) -> Iterator[str]:
    """What a reader misses in a docstring."""
    described = item.described
    missing = [name for name, _ in item.parameters if name not in described]
    if missing:
        yield f"does not describe {', '.join(missing)}"
    for name, kind in item.parameters:
        text = described.get(name, "")
        if not text or "Callable" in kind or "Literal" in kind:
            continue
        if ARRAY.search(kind) and not SHAPE.search(text):
            yield f"gives no shape of {name}"
        elif FLOAT.search(kind) and not UNIT.search(text) and not SHAPE.search(text):
            yield f"gives no unit or range of {name}"
    if item.returns:
        doc = item.doc
        section = doc["Yields"] or doc["Returns"]
        if not section:
            yield "does not say what it returns"
        text = " ".join(" ".join([one.name, one.type, *one.desc]) for one in section)
        if ARRAY.search(item.returns) and not SHAPE.search(text):
            yield "gives no shape of what it returns"
    if AS_FOR.search(item.docstring):
        yield "points elsewhere instead of describing"


def room(path: str) -> str:
    parts = path.split("/")
    return "/".join(parts[:2]).removesuffix(".py")


def main(root: Path) -> None:
    rows: dict[str, Counter[str]] = {}
    for path in modules(root):
        for item in items(path, root):
            if item.is_class:
                continue
            counts = rows.setdefault(room(item.path), Counter())
            described = item.described
            if item.parameters:
                counts["with arguments"] += 1
                counts["Parameters"] += all(name in described for name, _ in item.parameters)
            if item.returns:
                counts["returning"] += 1
                counts["Returns"] += bool(item.doc["Returns"] or item.doc["Yields"])
            counts["examples"] += item.docstring.count(">>>")
    total = sum(rows.values(), Counter())
    titles = ("with arguments", "Parameters", "returning", "Returns", "examples")
    print(f"{'room':28}" + "".join(f"{title:>16}" for title in titles))
    for name, counts in [*sorted(rows.items()), ("all", total)]:
        print(f"{name:28}" + "".join(f"{counts[title]:16}" for title in titles))
    for part, of in (("Parameters", "with arguments"), ("Returns", "returning")):
        print(f"{part}: {100 * total[part] / total[of]:.0f} %")


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else Path(__file__).parents[1]))
