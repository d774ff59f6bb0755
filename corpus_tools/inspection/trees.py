"""``mocap-fit info MODEL --tree``: looking into a CART model."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

from corpus_tools.cli import console
from corpus_tools.cli.console import Status
from mocap_fit.control import load
from mocap_fit.control.cart import (
    Cart,
    Reason,
    compute_importances,
    explain_targets,
    export_text,
    find_tree,
    write_tree,
)
from mocap_fit.errors import DataError
from mocap_fit.phones import PhoneSequence

# A question that matters less is not worth a row.
_LEAST = 0.005


def run(
    model: Path,
    *,
    tree: str | None = None,
    svg: Path | None = None,
    explain: Path | None = None,
    as_json: bool = False,
) -> Status:
    """Print a tree of a model, what decided the targets of an utterance, or what questions matter.

    Parameters
    ----------
    model
        A trained model of the kind ``cart``.
    tree
        ``PHONE/PARAMETER``. Without it and without ``explain``, the importance of every question
        for every parameter is printed.
    svg
        Draw the tree into this file.
    explain
        Labels, or the phones of an utterance of a corpus; with ``tree`` only its targets.
    as_json
        Print JSON.

    Raises
    ------
    DataError
        If the model has no trees, or not this one.
    FileFormatError
        If a file cannot be read or written.
    """
    loaded = load(model)
    if not isinstance(loaded, Cart):
        raise DataError(
            f"'{model.name}' has no trees to look at", found=loaded.name, expected=Cart.name
        )
    if tree is None and svg is not None:
        raise DataError("there is no tree to draw", advice="Say which with --tree PHONE/PARAMETER.")
    key = None if tree is None else find_tree(loaded, tree)
    if key is not None and svg is not None:
        write_tree(loaded, key, svg)
    if explain is not None:
        parameter = None if key is None else loaded.parameter_names_[key.parameter]
        found = explain_targets(loaded, _phones(loaded, explain), parameter=parameter)
        chosen = [each for each in found if key is None or each.tree == key.of]
        _print([dataclasses.asdict(each) for each in chosen], _told(chosen), as_json)
    elif key is not None:
        text = export_text(loaded, key)
        _print({"tree": tree, "text": text.splitlines()}, text, as_json)
    else:
        _show_importance(loaded, as_json)
    return Status.DONE


def _told(chosen: list[Reason]) -> str:
    return "\n".join(map(str, chosen)) or "none of its targets is from this tree"


def _print(content: Any, text: str, as_json: bool) -> None:
    if as_json:
        console.print_json(content)
    else:
        screen = console.screen()
        for line in text.splitlines():
            screen.print(line, soft_wrap=True)


def _phones(model: Cart, path: Path) -> PhoneSequence:
    if path.suffix.lower() == ".parquet":
        from mocap_fit.phones import read_stored_phones

        return read_stored_phones(path)
    from mocap_fit.labels import read_phones

    return read_phones(path, phone_set=model.phone_set_)


def _show_importance(model: Cart, as_json: bool) -> None:
    found = compute_importances(model)
    if as_json:
        console.print_json({"importance": found})
        return
    questions = [question.name for question in model.questions_]
    names = list(found)
    rows = [
        [question, *(f"{100 * found[name][question]:.0f}" for name in names)]
        for question in questions
        if max(found[name][question] for name in names) >= _LEAST
    ]
    screen = console.screen()
    screen.print("how much each question lowers the error of each parameter, per cent:")
    for number, name in enumerate(names, start=1):
        screen.print(f"  {number}  {name}")
    screen.print(console.table(["question", *(str(n) for n in range(1, len(names) + 1))], rows))
