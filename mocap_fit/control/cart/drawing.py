"""Trees as text and as pictures (SVG)."""

from __future__ import annotations

import math
import os
import textwrap
from xml.sax.saxutils import escape

import numpy as np

from mocap_fit.atomic_file import write_text
from mocap_fit.control.cart.inspecting import describe_branches, get_question_name, name_pool
from mocap_fit.control.cart.model import Cart
from mocap_fit.control.cart.tree import Tree, TreeKey

# Pixels, and letters of a line.
_WIDTH, _LINE, _PAD, _GAP, _LEVEL = 176, 15, 6, 14, 34
_LETTERS = 28
_MARGIN, _TITLE = 16, 46


def _write_title(model: Cart, key: TreeKey) -> str:
    phone = name_pool(key.of) if key.pooled else key.of
    sound = ", with sound" if key.with_sound else ""
    return f"{phone} / {model.parameter_names_[key.parameter]}{sound}"


def export_text(model: Cart, key: TreeKey) -> str:
    """Write a tree as text: a line a node, indented by its depth.

    Each has the answer that leads to it, its number of examples, the mean of their targets, the
    root mean square of its cross-validated error, and its question.

    Parameters
    ----------
    model
        A trained model.
    key
        The tree.

    Returns
    -------
    str
        Several lines.
    """
    tree = model.trees_[key]
    lines = [f"{_write_title(model, key)}: {tree.leaves} leaves, {int(tree.counts[0])} examples"]

    def add_lines(node: int, answer: str, depth: int) -> None:
        error = _write_error(tree, node)
        figures = f"n {int(tree.counts[node])}, mean {tree.means[node]:.3f}, error {error}"
        start = f"{'  ' * depth}{answer}: " if answer else ""
        asks = "" if tree.questions[node] < 0 else f"; {get_question_name(model, key, node)}?"
        lines.append(f"{start}{figures}{asks}")
        if tree.questions[node] >= 0:
            for answer, child in zip(
                describe_branches(model, key, node), tree.children[node].tolist(), strict=True
            ):
                add_lines(child, answer, depth + 1)

    add_lines(0, "", 0)
    return "\n".join(lines)


def _write_error(tree: Tree, node: int) -> str:
    """Write the root mean square cross-validated error of a node; one example has none."""
    squared = float(tree.validated[node]) / int(tree.counts[node])
    return f"{math.sqrt(squared):.3f}" if math.isfinite(squared) else "–"


def export_svg(model: Cart, key: TreeKey) -> str:
    """Draw a tree as SVG, for a browser or a paper.

    A box a node: on top the answer that leads to it, then its number of examples, the mean of
    their targets and the root mean square of its cross-validated error, and below its question.
    Boxes are redder for a higher mean and bluer for a lower one.

    Parameters
    ----------
    model
        A trained model.
    key
        The tree.

    Returns
    -------
    str
        An SVG document.
    """
    tree = model.trees_[key]
    above = [""] * len(tree)
    depths = np.zeros(len(tree), dtype=np.int64)
    for node in np.flatnonzero(tree.questions >= 0).tolist():
        for child, answer in zip(
            tree.children[node].tolist(), describe_branches(model, key, node), strict=True
        ):
            above[child], depths[child] = answer, depths[node] + 1
    lines = [_write_lines(model, key, node, above[node]) for node in range(len(tree))]
    heights = [2 * _PAD + _LINE * len(each) for each in lines]
    rows = [
        max(h for h, d in zip(heights, depths, strict=True) if d == depth)
        for depth in range(int(depths.max()) + 1)
    ]
    tops = _TITLE + np.concatenate([[0], np.cumsum([row + _LEVEL for row in rows])])
    lefts = _place_boxes(tree)
    width = _MARGIN * 2 + int(lefts.max()) + _WIDTH
    height = int(tops[-1]) - _LEVEL + _MARGIN
    title = _write_title(model, key)
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}" '
        f'viewBox="0 0 {width} {height}" font-family="sans-serif" font-size="11.5">',
        f"<title>{escape(title)}</title>",
        f'<rect width="{width}" height="{height}" fill="white"/>',
        f'<text x="{_MARGIN}" y="28" font-size="17" font-weight="bold">{escape(title)}</text>',
    ]
    for node in np.flatnonzero(tree.questions >= 0).tolist():
        x = _MARGIN + lefts[node] + _WIDTH / 2
        y = tops[depths[node]] + heights[node]
        for child in tree.children[node].tolist():
            to_x, to_y = _MARGIN + lefts[child] + _WIDTH / 2, tops[depths[child]]
            middle = to_y - _LEVEL / 2
            parts.append(
                f'<path d="M {x:g} {y:g} V {middle:g} H {to_x:g} V {to_y:g}" fill="none" '
                'stroke="#888" stroke-width="1.2"/>'
            )
    for node, each in enumerate(lines):
        x, y = _MARGIN + lefts[node], tops[depths[node]]
        parts.append(
            f'<rect x="{x:g}" y="{y:g}" width="{_WIDTH}" height="{heights[node]}" rx="5" '
            f'fill="{_mix_colour(tree, node)}" stroke="#555"/>'
        )
        for row, (text, style) in enumerate(each):
            parts.append(
                f'<text x="{x + _WIDTH / 2:g}" y="{y + _PAD + _LINE * row + 11:g}" '
                f'text-anchor="middle"{style}>{escape(text)}</text>'
            )
    return "\n".join([*parts, "</svg>\n"])


def write_tree(model: Cart, key: TreeKey, path: str | os.PathLike[str]) -> None:
    """Write the drawing of a tree to a file.

    Parameters
    ----------
    model
        A trained model.
    key
        The tree.
    path
        The SVG file.

    Raises
    ------
    FileFormatError
        If the file cannot be written.
    """
    write_text(path, export_svg(model, key), "picture")


_BOLD, _ITALIC = ' font-weight="bold"', ' font-style="italic" fill="#333"'


def _write_lines(model: Cart, key: TreeKey, node: int, answer: str) -> list[tuple[str, str]]:
    """Write the lines of a box, with the style of each."""
    tree = model.trees_[key]
    lines = [(line, _ITALIC) for line in textwrap.wrap(answer, _LETTERS)]
    lines.append((f"n {int(tree.counts[node])} · mean {tree.means[node]:.3f}", ""))
    lines.append((f"error {_write_error(tree, node)}", ""))
    if tree.questions[node] >= 0:
        asks = textwrap.wrap(f"{get_question_name(model, key, node)}?", _LETTERS - 4)
        lines += [(line, _BOLD) for line in asks]
    return lines


def _place_boxes(tree: Tree) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """Place the boxes: leaves side by side, the others over the middle of their two."""
    lefts = np.zeros(len(tree))
    leaves = 0
    waiting = [0]
    while waiting:
        node = waiting.pop()
        if tree.questions[node] < 0:
            lefts[node] = leaves * (_WIDTH + _GAP)
            leaves += 1
        else:
            waiting += tree.children[node, ::-1].tolist()
    for node in np.flatnonzero(tree.questions >= 0)[::-1]:
        lefts[node] = lefts[tree.children[node]].mean()
    return lefts


def _mix_colour(tree: Tree, node: int) -> str:
    """Mix the colour of a box: white at the mean of the root, red above, blue below."""
    off = tree.means - tree.means[0]
    share = float(off[node]) / (float(np.abs(off).max()) or 1.0)
    far = (244, 165, 130) if share > 0 else (146, 197, 222)
    mixed = [round(255 + (end - 255) * abs(share)) for end in far]
    return f"#{mixed[0]:02x}{mixed[1]:02x}{mixed[2]:02x}"
