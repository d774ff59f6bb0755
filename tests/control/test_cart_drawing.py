"""Trees as text and pictures: where every box, line and word is."""

import re
from xml.etree import ElementTree

import numpy as np
import pytest
from cart_cases import NAMES, corpus, neighbour

from mocap_fit.control.cart import Cart, export_svg, export_text
from mocap_fit.control.cart.curves import get_smoothing_reach, interpolate
from mocap_fit.control.cart.drawing import _mix_colour, _write_error
from mocap_fit.control.cart.inspecting import name_pool
from mocap_fit.control.cart.tree import Tree

WIDTH, APART, MARGIN, TOP = 176, 190, 16, 46


@pytest.fixture(scope="module")
def grown():
    """The model, and the key of its largest tree."""

    def rule(phones, i):
        return neighbour(phones, i, -1) < neighbour(phones, i, 1), phones[i].duration * 5, 0.0

    model = Cart(min_impurity_decrease=0.0, pruning="none").fit(
        corpus(rule, count=3, length=12, noise=0.1)
    )
    return model, max(model.trees_, key=lambda key: model.trees_[key].leaves)


@pytest.fixture(scope="module")
def drawn(grown):
    """The elements of its picture, without their name space."""
    root = ElementTree.fromstring(export_svg(*grown))
    for element in root.iter():
        element.tag = element.tag.split("}")[-1]
    return root


def boxes_of(drawn):
    names = ("x", "y", "width", "height")
    boxes = [e for e in drawn.iter("rect") if e.get("rx")]
    return np.array([[float(e.get(name)) for name in names] for e in boxes]), boxes


def test_leaves_are_side_by_side_and_others_over_the_middle_of_their_two(grown, drawn):
    tree = grown[0].trees_[grown[1]]
    boxes, _ = boxes_of(drawn)
    assert len(boxes) == len(tree)
    leaves = np.sort(boxes[tree.questions < 0, 0])
    np.testing.assert_allclose(leaves, MARGIN + APART * np.arange(tree.leaves))
    assert set(boxes[:, 2]) == {WIDTH}
    for node in np.flatnonzero(tree.questions >= 0):
        no, yes = tree.children[node]
        assert boxes[node, 0] == pytest.approx((boxes[no, 0] + boxes[yes, 0]) / 2, abs=0.01)
        assert boxes[no, 0] < boxes[node, 0] < boxes[yes, 0]
        assert boxes[no, 1] == boxes[yes, 1]


def test_rows_are_below_the_highest_box_of_the_row_above(grown, drawn):
    tree = grown[0].trees_[grown[1]]
    boxes, _ = boxes_of(drawn)
    depths = np.zeros(len(tree), dtype=int)
    for node in np.flatnonzero(tree.questions >= 0):
        depths[tree.children[node]] = depths[node] + 1
    top = TOP
    for depth in range(depths.max() + 1):
        row = boxes[depths == depth]
        assert set(row[:, 1]) == {top}
        top += row[:, 3].max() + 34
    width, height = float(drawn.get("width")), float(drawn.get("height"))
    assert height == top - 34 + MARGIN
    assert width == int(boxes[:, 0].max()) + WIDTH + MARGIN
    assert drawn.get("viewBox") == f"0 0 {width:g} {height:g}"
    paper = next(e for e in drawn.iter("rect") if not e.get("rx"))
    assert (paper.get("width"), paper.get("height")) == (drawn.get("width"), drawn.get("height"))


def test_lines_go_from_the_middle_of_a_box_to_those_below(grown, drawn):
    tree = grown[0].trees_[grown[1]]
    boxes, _ = boxes_of(drawn)
    expected = []
    for node in np.flatnonzero(tree.questions >= 0):
        x, y = boxes[node, 0] + WIDTH / 2, boxes[node, 1] + boxes[node, 3]
        for child in tree.children[node]:
            to_x, to_y = boxes[child, 0] + WIDTH / 2, boxes[child, 1]
            expected.append([x, y, to_y - 17, to_x, to_y])
    paths = [path.get("d") for path in drawn.iter("path")]
    assert all(re.fullmatch(r"M \S+ \S+ V \S+ H \S+ V \S+", path) for path in paths)
    found = [[float(number) for number in re.findall(r"[\d.]+", path)] for path in paths]
    np.testing.assert_allclose(found, expected, atol=0.02)


def test_boxes_hold_answer_figures_and_question(grown, drawn):
    model, key = grown
    tree = model.trees_[key]
    boxes, _ = boxes_of(drawn)
    texts = list(drawn.iter("text"))
    title = f"{name_pool(key.of) if key.pooled else key.of} / {NAMES[key.parameter]}"
    assert (texts[0].text, texts[0].get("x"), texts[0].get("y")) == (title, "16", "28")
    assert drawn.find("title").text == title
    at = 1
    for node, (x, y, width, height) in enumerate(boxes):
        rows = round((height - 12) / 15)
        assert height == 12 + 15 * rows
        lines = texts[at : at + rows]
        at += rows
        for row, line in enumerate(lines):
            assert float(line.get("x")) == pytest.approx(x + width / 2, abs=0.02)
            assert float(line.get("y")) == y + 6 + 15 * row + 11
            assert line.get("text-anchor") == "middle"
        figures = [i for i, line in enumerate(lines) if line.text.startswith("n ")]
        (first,) = figures
        count, mean = int(tree.counts[node]), tree.means[node]
        assert lines[first].text == f"n {count} · mean {mean:.3f}"
        assert lines[first + 1].text == f"error {_write_error(tree, node)}"
        assert (first == 0) == (node == 0)
        assert all(line.get("font-style") == "italic" for line in lines[:first])
        assert all(len(line.text) <= 28 for line in lines[:first])
        question = lines[first + 2 :]
        assert bool(question) == (tree.questions[node] >= 0)
        assert all(line.get("font-weight") == "bold" for line in question)
        assert all(len(line.text) <= 24 for line in question)
        if question:
            assert question[-1].text.endswith("?")
    assert at == len(texts)


def test_the_text_has_a_line_a_node_under_its_question(grown, drawn):
    model, key = grown
    tree = model.trees_[key]
    lines = export_text(model, key).splitlines()
    count = int(tree.counts[0])
    assert lines[0].endswith(f": {tree.leaves} leaves, {count} examples")
    assert len(lines) == 1 + len(tree)
    depths = [(len(line) - len(line.lstrip())) // 2 for line in lines[1:]]
    expected, order, waiting = [], [], [(0, 0)]
    while waiting:
        node, depth = waiting.pop()
        expected.append(depth)
        order.append(node)
        if tree.questions[node] >= 0:
            waiting += [(child, depth + 1) for child in tree.children[node][::-1].tolist()]
    assert depths == expected
    for line, node in zip(lines[1:], order, strict=True):
        assert f"n {int(tree.counts[node])}, mean {tree.means[node]:.3f}, error " in line
        assert line.endswith("?") == (tree.questions[node] >= 0)


def small_tree(means, counts, validated):
    nodes = len(means)
    fields = dict.fromkeys(Tree.__dataclass_fields__, None)
    tree = object.__new__(Tree)
    for name in fields:
        object.__setattr__(tree, name, np.zeros(nodes))
    for name, values in (("means", means), ("counts", counts), ("validated", validated)):
        object.__setattr__(tree, name, np.array(values))
    return tree


def test_boxes_are_white_at_the_mean_of_the_root_red_above_and_blue_below():
    tree = small_tree([0.5, 0.9, 0.3, 0.7], [4, 1, 1, 2], [0.36, np.inf, 0.04, 0.0])
    colours = [_mix_colour(tree, node) for node in range(4)]
    assert colours == ["#ffffff", "#f4a582", "#c8e2ee", "#fad2c0"]
    assert _mix_colour(small_tree([0.5, 0.5], [1, 1], [0, 0]), 1) == "#ffffff"
    assert [_write_error(tree, node) for node in range(4)] == ["0.300", "–", "0.200", "0.000"]
    # Half way to a colour is half way in each of its parts.
    parts = [int(part, 16) for part in re.findall("..", colours[3][1:])]
    assert parts == [round(255 + (end - 255) / 2) for end in (244, 165, 130)]


def test_smoothing_is_by_a_gaussian_to_two_deviations_and_four_tenths(rng):
    """Of a line it is the line, of a step its integral; beyond its reach it does nothing."""
    centres, targets = np.array([0.0, 1.0, 1.0 + 1e-9, 2.0]), np.array([[0.0], [0.0], [1.0], [1.0]])
    assert get_smoothing_reach(0.05) == pytest.approx(0.12)
    times = np.array([0.87, 0.89, 1.11, 1.13])
    smooth = interpolate(centres, targets, times, interpolation="linear", smoothing=0.05)[:, 0]
    assert smooth[0] == 0
    assert smooth[3] == pytest.approx(1)
    assert 0 < smooth[1] < 0.03
    assert smooth[2] == pytest.approx(1 - smooth[1])
    # The variance of the weights is that of a Gaussian cut off there.
    nodes = np.linspace(-2.4, 2.4, 17)
    weights = np.exp(-0.5 * nodes**2) / np.exp(-0.5 * nodes**2).sum()
    parabola = np.linspace(0, 2, 2001)
    found = interpolate(
        parabola, (parabola[:, None] - 1) ** 2, np.array([1.0]), interpolation="linear",
        smoothing=0.1,
    )  # fmt: skip
    assert found[0, 0] == pytest.approx(0.01 * weights @ nodes**2, rel=1e-3)
