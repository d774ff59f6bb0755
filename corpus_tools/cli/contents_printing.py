"""Print what files hold, and what the trees of a model look like."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from corpus_tools.cli import console, display

# Units of what a file's description holds; a share is shown in per cent.
_UNITS = {
    "rate": "Hz",
    "duration": "s",
    "start_time": "s",
    "start": "s",
    "end": "s",
    "time": "s",
    "look_ahead": "s",
    "loudest_db": "dB",
    "quietest_db": "dB",
    "memory_to_fit": "GB",
    "stillest_residual": "mm",
    "marker_offset": "mm",
}
_SHARES = {"gap_rate"}
# A question that matters less, as a share, has no row.
_LEAST = 0.005


def print_contents(content: Mapping[str, Any]) -> None:
    """Print one file's content: plain values first, then a table for each list of records.

    Parameters
    ----------
    content
        What the file holds.
    """
    from rich import box
    from rich.table import Table
    from rich.text import Text

    screen = display.create_screen()
    summary = Table(show_header=False, box=box.SIMPLE)
    summary.add_column(style="bold", no_wrap=True)
    summary.add_column(overflow="fold")
    tables = [summary]
    for key, value in content.items():
        if key == "file":
            continue
        if _is_records(value):
            tables.append(_create_record_table(key, value))
        else:
            summary.add_row(Text(_format_label(key)), Text(_format_quantity(key, value)))
    # A path is never broken over lines, or nobody could copy it.
    path = console.to_printable(str(content["file"]))
    screen.print(Text(path, style="bold"), soft_wrap=True)
    for table in tables:
        screen.print(table)


def _create_record_table(key: str, records: Sequence[Mapping[str, Any]]) -> Any:
    from rich import box
    from rich.table import Table
    from rich.text import Text

    table = Table(title=Text(_format_label(key)), title_justify="left", box=box.SIMPLE_HEAD)
    columns = list(dict.fromkeys(column for record in records for column in record))
    for column in columns:
        is_number = all(isinstance(record.get(column), (int, float)) for record in records)
        label = Text(_format_label(column))
        # A name that is broken over lines cannot be copied.
        table.add_column(
            label,
            justify="right" if is_number else "left",
            overflow="fold",
            no_wrap=column in ("name", "class"),
        )
    for record in records:
        table.add_row(*(Text(_format_quantity(column, record.get(column))) for column in columns))
    return table


def _is_records(value: Any) -> bool:
    is_list = isinstance(value, (list, tuple)) and len(value) > 0
    return is_list and all(isinstance(item, Mapping) for item in value)


def _format_label(key: object) -> str:
    return console.to_printable(str(key).replace("_", " "))


def _format_quantity(key: str, value: Any) -> str:
    if not isinstance(value, (int, float)):
        return _format_value(value)
    if key in _SHARES:
        return f"{100 * value:.1f} %"
    return f"{_format_value(value)} {_UNITS.get(key, '')}".rstrip()


def _format_value(value: Any) -> str:
    """Return a value as people write it."""
    if value is None:
        return "–"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, Mapping):
        items = (f"{_format_label(key)} {_format_value(item)}" for key, item in value.items())
        return ", ".join(items) or "–"
    if isinstance(value, (list, tuple)):
        return ", ".join(_format_value(item) for item in value) or "–"
    return console.to_printable(str(value))


def print_model(
    path: Path,
    *,
    tree: str | None = None,
    svg: Path | None = None,
    explain: Path | None = None,
    as_json: bool = False,
) -> None:
    """Print a tree of a CART model, what decided targets, or what questions matter.

    Parameters
    ----------
    path
        File of the model.
    tree
        ``PHONE/PARAMETER``. Without it and without ``explain``, the importance of every question
        for every parameter is printed.
    svg
        The tree is drawn into this file.
    explain
        Labels, or the phones of an utterance of a corpus; with ``tree`` only its targets.
    as_json
        Whether JSON is printed.

    Raises
    ------
    MocapFitError
        If the model has no trees, or not this one, or a file cannot be read or written.
    """
    from corpus_tools.inspection import trees
    from mocap_fit.control.cart import compute_importances
    from mocap_fit.errors import DataError

    model = trees.load_cart(path)
    if tree is None and svg is not None:
        raise DataError("there is no tree to draw", advice="Say which with --tree PHONE/PARAMETER.")
    lines = [] if tree is None else trees.describe_tree(model, tree, svg).splitlines()
    content: Any = {"tree": tree, "text": lines}
    if explain is not None:
        reasons = trees.explain_utterance(model, explain, tree)
        content = [dataclasses.asdict(reason) for reason in reasons]
        text = "\n".join(map(str, reasons)) or "none of its targets is from this tree"
        lines = text.splitlines()
    elif tree is None:
        content = {"importance": compute_importances(model)}
    if as_json:
        display.print_json(content)
    elif lines:
        display.print_lines(*lines)
    else:
        _print_importance([question.name for question in model.questions_], content["importance"])


def _print_importance(questions: Sequence[str], shares: Mapping[str, Mapping[str, float]]) -> None:
    names = list(shares)
    rows = [
        [question, *(f"{100 * shares[name][question]:.0f}" for name in names)]
        for question in questions
        if max(shares[name][question] for name in names) >= _LEAST
    ]
    screen = display.create_screen()
    screen.print("how much each question lowers the error of each parameter, per cent:")
    for number, name in enumerate(names, start=1):
        screen.print(f"  {number}  {name}")
    header = ["question", *(str(number) for number in range(1, len(names) + 1))]
    screen.print(display.create_table(header, rows))
