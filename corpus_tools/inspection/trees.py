"""Look into the trees of a CART model: one tree, the reasons of targets, the questions."""

from __future__ import annotations

from pathlib import Path

from mocap_fit.control import load
from mocap_fit.control.cart import Cart, Reason, explain_targets, export_text, find_tree, write_tree
from mocap_fit.errors import DataError
from mocap_fit.phones import PhoneSequence


def load_cart(path: Path) -> Cart:
    """Load a CART model.

    Parameters
    ----------
    path
        Its file.

    Returns
    -------
    Cart
        The model.

    Raises
    ------
    DataError
        If the model is of another kind.
    FileFormatError
        If the file cannot be read.
    """
    model = load(path)
    if not isinstance(model, Cart):
        raise DataError(
            f"'{path.name}' has no trees to look at", found=model.name, expected=Cart.name
        )
    return model


def describe_tree(model: Cart, tree: str, svg: Path | None = None) -> str:
    """Return a tree as text, and draw it.

    Parameters
    ----------
    model
        The model.
    tree
        ``PHONE/PARAMETER``.
    svg
        The tree is drawn into this file, if there is one.

    Returns
    -------
    str
        A line per node.

    Raises
    ------
    DataError
        If there is no such tree.
    FileFormatError
        If the drawing cannot be written.
    """
    key = find_tree(model, tree)
    if svg is not None:
        write_tree(model, key, svg)
    return export_text(model, key)


def explain_utterance(model: Cart, labels: Path, tree: str | None = None) -> list[Reason]:
    """Return what decided the targets of an utterance.

    Parameters
    ----------
    model
        The model.
    labels
        Labels, or the phones of an utterance of a corpus (Parquet).
    tree
        ``PHONE/PARAMETER``: only the targets of this tree; None for all.

    Returns
    -------
    list[Reason]
        In the order of the phones.

    Raises
    ------
    MocapFitError
        If there is no such tree, or the labels cannot be read.
    """
    key = None if tree is None else find_tree(model, tree)
    parameter = None if key is None else model.parameter_names_[key.parameter]
    everything = explain_targets(model, _read_phones(model, labels), parameter=parameter)
    return [each for each in everything if key is None or each.tree == key.of]


def _read_phones(model: Cart, path: Path) -> PhoneSequence:
    if path.suffix.lower() == ".parquet":
        from mocap_fit.phones import read_stored_phones

        return read_stored_phones(path)
    from mocap_fit.labels import read_phones

    return read_phones(path, phone_set=model.phone_set_)
