"""A finished tree: which question each node asks, where every answer leads, what its leaves say."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mocap_fit.control.cart.contexts import GROUPS, KIND_OF_GROUP, ByteArray
from mocap_fit.control.cart.growing import Grown, IntArray
from mocap_fit.control.cart.kernel import LEFT, RIGHT, UNSEEN, compiled
from mocap_fit.control.cart.questions import Question
from mocap_fit.tracks import FloatArray


@dataclass(frozen=True, eq=False)
class Tree:
    """A regression tree of a phone and a parameter; node 0 is the root.

    Parameters
    ----------
    questions
        `(nodes,)`: which of the model's questions is asked; -1 in a leaf.
    bounds
        `(nodes,)`: a number up to this goes to the left; 0 where phones are asked about.
    sides
        `(nodes, levels)`: where each phone of the alphabet goes, `LEFT` or `RIGHT`.
    unknown
        `(nodes,)`: where a number goes that is not known.
    children
        `(nodes, 2)`: the nodes to the left and to the right; -1 in a leaf.
    seen
        `(nodes, levels)`: which phones the examples of a node had; the others were backed off.
    counts
        `(nodes,)`: examples.
    means
        `(nodes,)`: of their targets (eq. 8); in a leaf the answer.
    errors
        `(nodes,)`: squared error of the examples, added up.
    validated
        `(nodes,)`: the cross-validated one (eq. 9); infinite where there is but one example.
    gains
        `(nodes,)`: by how much the cut lowered it (eq. 10); 0 in a leaf.
    """

    questions: IntArray
    bounds: FloatArray
    sides: ByteArray
    unknown: ByteArray
    children: IntArray
    seen: NDArray[np.bool_]
    counts: IntArray
    means: FloatArray
    errors: FloatArray
    validated: FloatArray
    gains: FloatArray

    def __len__(self) -> int:
        return len(self.questions)

    @property
    def leaves(self) -> int:
        """How many leaves there are."""
        return int((self.questions < 0).sum())

    @property
    def depth(self) -> int:
        """How many questions are asked at most."""
        depths = np.zeros(len(self), dtype=np.int64)
        for node in np.flatnonzero(self.questions >= 0):
            depths[self.children[node]] = depths[node] + 1
        return int(depths.max())

    def side(self, node: int, is_phone: bool, value: float) -> int:
        """Where an answer leads.

        Parameters
        ----------
        node
            Which asks.
        is_phone
            Whether it asks about phones.
        value
            A level of the alphabet, or a number; NaN is unknown.
        """
        if is_phone:
            return int(self.sides[node, int(value)])
        if np.isnan(value):
            return int(self.unknown[node])
        return LEFT if value <= self.bounds[node] else RIGHT

    def path(
        self, of_attribute: Sequence[int], are_phones: Sequence[bool], values: Sequence[float]
    ) -> list[int]:
        """The nodes that a segment comes through, from the root to a leaf.

        Parameters
        ----------
        of_attribute
            Of each question, which attribute it is about.
        are_phones
            Of each attribute, whether it is a phone.
        values
            Of each attribute: a level, or a number.
        """
        node, passed = 0, [0]
        while self.questions[node] >= 0:
            attribute = of_attribute[self.questions[node]]
            side = self.side(node, are_phones[attribute], values[attribute])
            node = int(self.children[node, side])
            passed.append(node)
        return passed


class Made(NamedTuple):
    """A grown tree, and what its nodes' numbers mean.

    Parameters
    ----------
    grown
        The tree, pruned.
    numbers
        `(questions,)`: which of the model's questions each of the tree's is.
    edges
        Of each attribute that is a number, the bounds between its bins.
    """

    grown: Grown
    numbers: IntArray
    edges: Mapping[int, FloatArray]


def finished(
    made: Sequence[Made],
    questions: Sequence[Question],
    attributes: Sequence[int],
    members: ByteArray,
    groups: IntArray,
) -> list[Tree]:
    """Grown trees as they are kept: bounds as numbers, and a side for every phone.

    A phone that no example of a node had goes with its group: to the side where most phones of the
    group went, then most of its kind (vowels, consonants), then most examples.

    Parameters
    ----------
    made
        The trees.
    questions
        All questions of the model.
    attributes
        Of each, which attribute it is about.
    members
        `(questions, levels)`: who answers yes to those that are not open.
    groups
        `(levels,)`: the group of each level of the alphabet, from 1 in the order of `GROUPS`; 0
        for no phone.
    """
    if not made:
        return []
    # All nodes of all trees at once: trees are small, and many.
    lengths = [len(each.grown.questions) for each in made]
    starts = np.concatenate([[0], np.cumsum(lengths)])
    trees = [each.grown for each in made]
    asked = np.concatenate(
        [
            np.where(t.questions >= 0, e.numbers[t.questions], -1)
            for t, e in zip(trees, made, strict=True)
        ]
    )
    children = np.concatenate([tree.children for tree in trees])
    counts = np.concatenate([tree.counts for tree in trees])
    first = np.repeat(starts[:-1], lengths)
    after = counts[np.maximum(children, 0) + first[:, None]]
    is_inner = asked >= 0
    larger = np.where(is_inner & (after[:, 1] > after[:, 0]), RIGHT, LEFT).astype(np.uint8)
    is_open = np.array([question.is_open for question in questions])
    is_phone = np.array([question.attribute.is_phone for question in questions])

    levels = len(groups)
    sides = np.zeros((len(asked), levels), dtype=np.uint8)
    seen = np.zeros((len(asked), levels), dtype=np.bool_)
    about_phones = np.flatnonzero(is_inner & is_phone[asked])
    found = np.concatenate([tree.sides[:, :levels] for tree in trees])[about_phones]
    seen[about_phones] = found != UNSEEN
    sides[about_phones] = np.where(
        is_open[asked[about_phones], None],
        _backed_off(found, groups, larger[about_phones]),
        members[asked[about_phones], :levels] == 0,
    )
    bounds, unknown = np.zeros(len(asked)), np.zeros(len(asked), dtype=np.uint8)
    owner = np.repeat(np.arange(len(made)), lengths)
    for node in np.flatnonzero(is_inner & ~is_phone[asked]).tolist():
        tree = made[owner[node]]
        own = tree.edges[attributes[asked[node]]]
        row = tree.grown.sides[node - first[node]]
        bounds[node], unknown[node] = _bound(row, own, int(larger[node]))
    placed = (asked, bounds, sides, unknown, children, seen, counts)
    told = [np.concatenate([getattr(tree, name) for tree in trees]) for name in _TOLD[1:]]
    return [
        Tree(*(array[start:end] for array in (*placed, *told)))
        for start, end in itertools.pairwise(starts.tolist())
    ]


def _bound(found: ByteArray, edges: FloatArray, larger: int) -> tuple[float, int]:
    """The bound between two bins, and the side of what is unknown (the bin after the last)."""
    last = len(edges) + 1
    unknown = int(found[last]) if found[last] != UNSEEN else larger
    left = int(np.flatnonzero(found[: last + 1] == LEFT)[-1])
    right = int(np.flatnonzero(found[: last + 1] == RIGHT)[0])
    if right == last:
        return np.inf, unknown
    return float(0.5 * (edges[left] + edges[right - 1])), unknown


def _backed_off(found: ByteArray, groups: IntArray, larger: ByteArray) -> ByteArray:
    """A side for every level of some nodes: its own, or its group's, its kind's, the larger."""
    has = found != UNSEEN
    votes = np.where(has, 2.0 * found - 1.0, 0.0)
    by_group = votes @ (groups[:, None] == np.arange(len(GROUPS) + 1))
    by_kind = by_group @ (_KINDS[:, None] == np.arange(len(GROUPS) + 1))
    decided = np.where(by_group != 0, by_group, by_kind[:, _KINDS])
    decided[:, 0] = 0.0
    asked = np.where(decided == 0, larger[:, None], np.where(decided > 0, RIGHT, LEFT))
    return np.where(has, found, asked[:, groups]).astype(np.uint8)


# The number of each group's kind; 0 is no phone, which has none.
_KINDS = np.array(
    [0, *(1 + sorted(set(KIND_OF_GROUP.values())).index(KIND_OF_GROUP[g]) for g in GROUPS)]
)


_PLACED = ("questions", "bounds", "sides", "unknown", "children", "seen")
_TOLD = ("counts", "means", "errors", "validated", "gains")


def packed(trees: Sequence[Tree], levels: int) -> dict[str, np.ndarray[Any, Any]]:
    """Trees as a few arrays: all nodes one after the other, and where each tree begins.

    Parameters
    ----------
    trees
        In order.
    levels
        Of the alphabet.
    """
    lengths = [len(tree) for tree in trees]
    arrays: dict[str, np.ndarray[Any, Any]] = {
        "tree_starts": np.concatenate([[0], np.cumsum(lengths)]).astype(np.int64)
    }
    for name in (*_PLACED, *_TOLD):
        shape = {"sides": (0, levels), "seen": (0, levels), "children": (0, 2)}.get(name, (0,))
        parts = [getattr(tree, name) for tree in trees]
        arrays[f"node_{name}"] = np.concatenate(parts) if parts else np.zeros(shape)
    # A bit for each phone.
    for name in ("sides", "seen"):
        arrays[f"node_{name}"] = np.packbits(arrays[f"node_{name}"].astype(np.bool_), axis=-1)
    return arrays


def unpacked(arrays: Mapping[str, np.ndarray[Any, Any]], levels: int) -> list[Tree]:
    """The trees that `packed` put together.

    Parameters
    ----------
    arrays
        By name.
    levels
        Of the alphabet.

    Raises
    ------
    ValueError
        If the arrays do not belong together.
    """
    starts = arrays["tree_starts"]
    whole = {name: arrays[f"node_{name}"] for name in (*_PLACED, *_TOLD)}
    nodes = int(starts[-1]) if starts.ndim == 1 and len(starts) else -1
    shapes = {"sides": (nodes, -(-levels // 8)), "children": (nodes, 2)}
    shapes["seen"] = shapes["sides"]
    for name, array in whole.items():
        if array.shape != shapes.get(name, (nodes,)) or np.isnan(array).any():
            raise ValueError("the nodes of the trees are not all there")
    for name in ("sides", "seen"):
        bits = np.unpackbits(whole[name], axis=-1, count=levels)
        whole[name] = bits if name == "sides" else bits.astype(np.bool_)
    found = []
    for first, last in itertools.pairwise(starts.tolist()):
        tree = Tree(**{name: array[first:last] for name, array in whole.items()})
        inner = tree.questions >= 0
        parents = np.arange(len(tree))[:, None]
        if ((tree.children <= parents) | (tree.children >= len(tree)))[inner].any():
            raise ValueError("a tree's nodes do not follow each other")
        found.append(tree)
    return found


class Forest:
    """All trees of a model, for answering many questions at once.

    Parameters
    ----------
    trees
        In order.
    of_attribute
        Of each question, which attribute it is about.
    are_phones
        Of each attribute, whether it is a phone.
    levels
        Of the alphabet.
    """

    def __init__(
        self,
        trees: Sequence[Tree],
        of_attribute: Sequence[int],
        are_phones: Sequence[bool],
        levels: int,
    ) -> None:
        whole = packed(trees, levels)
        asked = whole["node_questions"].astype(np.int64)
        attributes = np.array([*of_attribute, -1], dtype=np.int64)[asked]
        self._arrays = (
            whole["tree_starts"],
            attributes,
            np.array([*are_phones, False])[attributes],
            whole["node_bounds"],
            np.unpackbits(whole["node_sides"].astype(np.uint8), axis=-1, count=levels),
            whole["node_unknown"].astype(np.uint8),
            whole["node_children"].astype(np.int64),
            whole["node_means"],
        )

    def answers(self, trees: IntArray, values: FloatArray) -> FloatArray:
        """What trees say of segments.

        Parameters
        ----------
        trees
            `(segments, parameters)`: which tree, from 0; -1 for none.
        values
            `(segments, attributes, parameters)`: levels of the alphabet, or numbers.

        Returns
        -------
        FloatArray
            `(segments, parameters)`; 0 where there is no tree.
        """
        found = np.zeros(trees.shape)
        _answer(trees, values, *self._arrays, found)
        return found


@compiled
def _answer(  # type: ignore[no-untyped-def]  # numba infers the types
    trees, values, starts, attributes, are_phones, bounds, sides, unknown, children, means, found
):
    for segment in range(trees.shape[0]):
        for parameter in range(trees.shape[1]):
            if trees[segment, parameter] < 0:
                continue
            start = starts[trees[segment, parameter]]
            node = start
            while attributes[node] >= 0:
                value = values[segment, attributes[node], parameter]
                if are_phones[node]:
                    side = sides[node, int(value)]
                elif np.isnan(value):
                    side = unknown[node]
                else:
                    side = 0 if value <= bounds[node] else 1
                node = start + children[node, side]
            found[segment, parameter] = means[node]
