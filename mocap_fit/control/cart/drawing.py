"""Trees as text and as pictures (SVG)."""

from __future__ import annotations

import math
import os
import textwrap
from xml.sax.saxutils import escape

import numpy as np

from mocap_fit.atomic_file import write_atomically
from mocap_fit.control.cart.inspecting import branches, pooled_name, question_at
from mocap_fit.control.cart.learning import TreeKey
from mocap_fit.control.cart.model import Cart
from mocap_fit.control.cart.tree import Tree

# Pixels, and letters of a line.
_WIDTH, _LINE, _PAD, _GAP, _LEVEL = 176, 15, 6, 14, 34
_LETTERS = 28
_MARGIN, _TITLE = 16, 46


def tree_title(model: Cart, key: TreeKey) -> str:
    """What a tree is of, in words."""
    phone = pooled_name(key.of) if key.pooled else key.of
    sound = ", with sound" if key.with_sound else ""
    return f"{phone} / {model.parameter_names_[key.parameter]}{sound}"


def tree_text(model: Cart, key: TreeKey) -> str:
    """A tree as text: a line a node, indented by its depth.

    Each has the answer that leads to it, its number of examples, the mean of their targets, the
    root mean square of its cross-validated error, and what it asks.
    """
    tree = model.trees_[key]
    lines = [f"{tree_title(model, key)}: {tree.leaves} leaves, {int(tree.counts[0])} examples"]

    def tell(node: int, answer: str, depth: int) -> None:
        figures = (
            f"n {int(tree.counts[node])}, mean {tree.means[node]:.3f}, error {_error(tree, node)}"
        )
        start = f"{'  ' * depth}{answer}: " if answer else ""
        asks = "" if tree.questions[node] < 0 else f"; {question_at(model, key, node)}?"
        lines.append(f"{start}{figures}{asks}")
        if tree.questions[node] >= 0:
            for answer, child in zip(
                branches(model, key, node), tree.children[node].tolist(), strict=True
            ):
                tell(child, answer, depth + 1)

    tell(0, "", 0)
    return "\n".join(lines)


def _error(tree: Tree, node: int) -> str:
    """Root mean square cross-validated error of a node; of one example there is none."""
    squared = float(tree.validated[node]) / int(tree.counts[node])
    return f"{math.sqrt(squared):.3f}" if math.isfinite(squared) else "–"


def tree_svg(model: Cart, key: TreeKey) -> str:
    """A tree as a picture: SVG, for a browser or a paper.

    A box a node: on top the answer that leads to it, then its number of examples, the mean of
    their targets and the root mean square of its cross-validated error, and below what it asks.
    Boxes are the redder the higher their mean, and the bluer the lower.
    """
    tree = model.trees_[key]
    above = [""] * len(tree)
    depths = np.zeros(len(tree), dtype=np.int64)
    for node in np.flatnonzero(tree.questions >= 0).tolist():
        for child, answer in zip(
            tree.children[node].tolist(), branches(model, key, node), strict=True
        ):
            above[child], depths[child] = answer, depths[node] + 1
    lines = [_lines(model, key, node, above[node]) for node in range(len(tree))]
    heights = [2 * _PAD + _LINE * len(each) for each in lines]
    rows = [
        max(h for h, d in zip(heights, depths, strict=True) if d == depth)
        for depth in range(int(depths.max()) + 1)
    ]
    tops = _TITLE + np.concatenate([[0], np.cumsum([row + _LEVEL for row in rows])])
    places = _places(tree)
    width = _MARGIN * 2 + int(places.max()) + _WIDTH
    height = int(tops[-1]) - _LEVEL + _MARGIN
    title = tree_title(model, key)
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}" '
        f'viewBox="0 0 {width} {height}" font-family="sans-serif" font-size="11.5">',
        f"<title>{escape(title)}</title>",
        f'<rect width="{width}" height="{height}" fill="white"/>',
        f'<text x="{_MARGIN}" y="28" font-size="17" font-weight="bold">{escape(title)}</text>',
    ]
    for node in np.flatnonzero(tree.questions >= 0).tolist():
        x = _MARGIN + places[node] + _WIDTH / 2
        y = tops[depths[node]] + heights[node]
        for child in tree.children[node].tolist():
            to_x, to_y = _MARGIN + places[child] + _WIDTH / 2, tops[depths[child]]
            middle = to_y - _LEVEL / 2
            parts.append(
                f'<path d="M {x:g} {y:g} V {middle:g} H {to_x:g} V {to_y:g}" fill="none" '
                'stroke="#888" stroke-width="1.2"/>'
            )
    for node, each in enumerate(lines):
        x, y = _MARGIN + places[node], tops[depths[node]]
        parts.append(
            f'<rect x="{x:g}" y="{y:g}" width="{_WIDTH}" height="{heights[node]}" rx="5" '
            f'fill="{_colour(tree, node)}" stroke="#555"/>'
        )
        for row, (text, style) in enumerate(each):
            parts.append(
                f'<text x="{x + _WIDTH / 2:g}" y="{y + _PAD + _LINE * row + 11:g}" '
                f'text-anchor="middle"{style}>{escape(text)}</text>'
            )
    return "\n".join([*parts, "</svg>\n"])


def write_tree(model: Cart, key: TreeKey, path: str | os.PathLike[str]) -> None:
    """Write the picture of a tree, whole or not at all.

    Raises
    ------
    FileFormatError
        If the file cannot be written.
    """
    with write_atomically(path, "picture") as partial:
        partial.write_text(tree_svg(model, key), encoding="utf-8", newline="\n")


_BOLD, _ITALIC = ' font-weight="bold"', ' font-style="italic" fill="#333"'


def _lines(model: Cart, key: TreeKey, node: int, answer: str) -> list[tuple[str, str]]:
    """What a box says, and the style of each line."""
    tree = model.trees_[key]
    found = [(line, _ITALIC) for line in textwrap.wrap(answer, _LETTERS)]
    found.append((f"n {int(tree.counts[node])} · mean {tree.means[node]:.3f}", ""))
    found.append((f"error {_error(tree, node)}", ""))
    if tree.questions[node] >= 0:
        asks = textwrap.wrap(f"{question_at(model, key, node)}?", _LETTERS - 4)
        found += [(line, _BOLD) for line in asks]
    return found


def _places(tree: Tree) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """Left edges of the boxes: leaves side by side, the others over the middle of their two."""
    places = np.zeros(len(tree))
    leaves = 0
    waiting = [0]
    while waiting:
        node = waiting.pop()
        if tree.questions[node] < 0:
            places[node] = leaves * (_WIDTH + _GAP)
            leaves += 1
        else:
            waiting += tree.children[node, ::-1].tolist()
    for node in np.flatnonzero(tree.questions >= 0)[::-1]:
        places[node] = places[tree.children[node]].mean()
    return places


def _colour(tree: Tree, node: int) -> str:
    """White at the mean of the root, red for the highest mean, blue for the lowest."""
    off = tree.means - tree.means[0]
    share = float(off[node]) / (float(np.abs(off).max()) or 1.0)
    far = (244, 165, 130) if share > 0 else (146, 197, 222)
    mixed = [round(255 + (end - 255) * abs(share)) for end in far]
    return f"#{mixed[0]:02x}{mixed[1]:02x}{mixed[2]:02x}"
