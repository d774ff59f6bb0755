"""A finished tree: which question each node asks, where every answer leads, what its leaves say."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mocap_fit.control.cart.arrays import ByteArray, IntArray, Nodes
from mocap_fit.control.cart.contexts import GROUPS, KIND_OF_GROUP
from mocap_fit.control.cart.kernel import LEFT, RIGHT, UNSEEN, compiled
from mocap_fit.control.cart.questions import Question
from mocap_fit.tracks import FloatArray


@dataclass(frozen=True, eq=False, repr=False)
class Tree:
    """A regression tree of a phone and a parameter; node 0 is the root.

    Parameters
    ----------
    questions
        Index of the model's question that is asked, ``(nodes,)``; -1 in a leaf.
    bounds
        A number up to this goes to the left, ``(nodes,)``, in the unit of the attribute (seconds,
        dB, or no unit); 0 where phones are asked about.
    sides
        Where each phone of the alphabet goes, `LEFT` or `RIGHT`, ``(nodes, levels)``.
    unknown
        Where a number goes that is not known, ``(nodes,)``.
    children
        Nodes to the left and to the right, ``(nodes, 2)``; -1 in a leaf.
    seen
        Which phones the examples of a node had, ``(nodes, levels)``; the others were backed off.
    counts
        Number of examples, ``(nodes,)``.
    means
        Mean target (eq. 8), ``(nodes,)``, in the unit of the parameter; in a leaf the answer.
    errors
        Sum of squared errors, ``(nodes,)``, in the unit of the parameter squared.
    validated
        Cross-validated sum of squared errors (eq. 9), ``(nodes,)``; infinite for one example.
    gains
        Decrease of the cross-validated error by the cut (eq. 10), ``(nodes,)``; 0 in a leaf.
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

    def __repr__(self) -> str:
        return f"Tree({self.leaves} leaves, depth {self.depth}, {int(self.counts[0])} examples)"

    @property
    def leaves(self) -> int:
        """Number of leaves."""
        return int((self.questions < 0).sum())

    @property
    def depth(self) -> int:
        """Number of questions from the root to the farthest leaf."""
        depths = np.zeros(len(self), dtype=np.int64)
        for node in np.flatnonzero(self.questions >= 0):
            depths[self.children[node]] = depths[node] + 1
        return int(depths.max())

    def _get_side(self, node: int, is_phone: bool, value: float) -> int:
        """Return where a level or a number leads; NaN is unknown."""
        if is_phone:
            return int(self.sides[node, int(value)])
        if np.isnan(value):
            return int(self.unknown[node])
        return LEFT if value <= self.bounds[node] else RIGHT

    def find_path(
        self, attributes: Sequence[int], are_phones: Sequence[bool], values: Sequence[float]
    ) -> list[int]:
        """Find the nodes that a segment passes, from the root to a leaf.

        Parameters
        ----------
        attributes
            Index of the attribute that each question is about.
        are_phones
            Whether each attribute is a phone.
        values
            Of each attribute: a level, or a number in its unit (seconds, dB, or no unit).

        Returns
        -------
        list[int]
            The root first.
        """
        node, passed = 0, [0]
        while self.questions[node] >= 0:
            attribute = attributes[self.questions[node]]
            side = self._get_side(node, are_phones[attribute], values[attribute])
            node = int(self.children[node, side])
            passed.append(node)
        return passed


class TreeKey(NamedTuple):
    """The name of a tree.

    Parameters
    ----------
    of
        A phone as its set writes it; of a tree of many phones a group of `GROUPS`, ``vowels``,
        ``consonants``, or ``all``.
    parameter
        Index of the parameter.
    pooled
        Whether it is of many phones.
    with_sound
        Whether it was grown with questions that only sound can answer.
    """

    of: str
    parameter: int
    pooled: bool = False
    with_sound: bool = False


@dataclass(frozen=True)
class Selection:
    """How a target was selected.

    Parameters
    ----------
    segment
        Index of the segment.
    parameter
        Index of the parameter.
    key
        The tree; None where no tree can predict it.
    path
        The nodes from its root to a leaf.
    values
        The attributes of the segment: levels of the alphabet, and numbers in their units (seconds,
        dB, or no unit).
    """

    segment: int
    parameter: int
    key: TreeKey | None
    path: tuple[int, ...]
    values: list[float]


class GrownTree(NamedTuple):
    """A grown tree, and what its nodes' numbers mean.

    Parameters
    ----------
    nodes
        The tree, pruned.
    numbers
        Index of the model's question for each of the tree's, ``(questions,)``.
    edges
        Of each attribute that is a number, the bounds between its bins, ``(bins - 1,)``.
    """

    nodes: Nodes
    numbers: IntArray
    edges: Mapping[int, FloatArray]


def finish_trees(
    grown: Sequence[GrownTree],
    questions: Sequence[Question],
    attributes: Sequence[int],
    members: ByteArray,
    groups: IntArray,
) -> list[Tree]:
    """Convert grown trees: bins become bounds, and every phone gets a side.

    A phone that no example of a node had goes with its group: to the side where most phones of the
    group went, then most of its kind (vowels, consonants), then most examples.

    Parameters
    ----------
    grown
        The trees.
    questions
        All questions of the model.
    attributes
        Index of the attribute that each is about.
    members
        Who answers yes to the questions that are not open, ``(questions, levels)``.
    groups
        The group of each level of the alphabet, from 1 in the order of `GROUPS`, ``(levels,)``; 0
        for no phone.

    Returns
    -------
    list[Tree]
        In the same order.
    """
    if not grown:
        return []
    # All nodes of all trees at once: trees are small, and many.
    lengths = [len(each.nodes.questions) for each in grown]
    starts = np.concatenate([[0], np.cumsum(lengths)])
    trees = [each.nodes for each in grown]
    numbers = np.concatenate(
        [
            np.where(t.questions >= 0, e.numbers[t.questions], -1)
            for t, e in zip(trees, grown, strict=True)
        ]
    )
    children = np.concatenate([tree.children for tree in trees])
    counts = np.concatenate([tree.counts for tree in trees])
    first = np.repeat(starts[:-1], lengths)
    after = counts[np.maximum(children, 0) + first[:, None]]
    is_inner = numbers >= 0
    larger = np.where(is_inner & (after[:, 1] > after[:, 0]), RIGHT, LEFT).astype(np.uint8)
    is_open = np.array([question.is_open for question in questions])
    is_phone = np.array([question.attribute.is_phone for question in questions])

    levels = len(groups)
    sides = np.zeros((len(numbers), levels), dtype=np.uint8)
    seen = np.zeros((len(numbers), levels), dtype=np.bool_)
    about_phones = np.flatnonzero(is_inner & is_phone[numbers])
    grown_sides = np.concatenate([tree.sides[:, :levels] for tree in trees])[about_phones]
    seen[about_phones] = grown_sides != UNSEEN
    sides[about_phones] = np.where(
        is_open[numbers[about_phones], None],
        _fill_unseen(grown_sides, groups, larger[about_phones]),
        members[numbers[about_phones], :levels] == 0,
    )
    bounds, unknown = np.zeros(len(numbers)), np.zeros(len(numbers), dtype=np.uint8)
    owner = np.repeat(np.arange(len(grown)), lengths)
    for node in np.flatnonzero(is_inner & ~is_phone[numbers]).tolist():
        tree = grown[owner[node]]
        edges = tree.edges[attributes[numbers[node]]]
        row = tree.nodes.sides[node - first[node]]
        bounds[node], unknown[node] = _find_bound(row, edges, int(larger[node]))
    converted = (numbers, bounds, sides, unknown, children, seen, counts)
    copied = [np.concatenate([getattr(tree, name) for tree in trees]) for name in _FIGURES[1:]]
    return [
        Tree(*(array[start:end] for array in (*converted, *copied)))
        for start, end in itertools.pairwise(starts.tolist())
    ]


def _find_bound(sides: ByteArray, edges: FloatArray, larger: int) -> tuple[float, int]:
    """Find the bound between two bins, and the side of the unknown (the bin after the last)."""
    last = len(edges) + 1
    unknown = int(sides[last]) if sides[last] != UNSEEN else larger
    left = int(np.flatnonzero(sides[: last + 1] == LEFT)[-1])
    right = int(np.flatnonzero(sides[: last + 1] == RIGHT)[0])
    if right == last:
        return np.inf, unknown
    return float(0.5 * (edges[left] + edges[right - 1])), unknown


def _fill_unseen(sides: ByteArray, groups: IntArray, larger: ByteArray) -> ByteArray:
    """Find a side for every level of some nodes, where it has none that of its group or kind."""
    is_seen = sides != UNSEEN
    votes = np.where(is_seen, 2.0 * sides - 1.0, 0.0)
    by_group = votes @ (groups[:, None] == np.arange(len(GROUPS) + 1))
    by_kind = by_group @ (_KINDS[:, None] == np.arange(len(GROUPS) + 1))
    decided = np.where(by_group != 0, by_group, by_kind[:, _KINDS])
    decided[:, 0] = 0.0
    by_vote = np.where(decided == 0, larger[:, None], np.where(decided > 0, RIGHT, LEFT))
    return np.where(is_seen, sides, by_vote[:, groups]).astype(np.uint8)


# The number of each group's kind; 0 is no phone, which has none.
_KINDS = np.array(
    [0, *(1 + sorted(set(KIND_OF_GROUP.values())).index(KIND_OF_GROUP[g]) for g in GROUPS)]
)


_ANSWERS = ("questions", "bounds", "sides", "unknown", "children", "seen")
_FIGURES = ("counts", "means", "errors", "validated", "gains")


def pack_trees(trees: Sequence[Tree], levels: int) -> dict[str, np.ndarray[Any, Any]]:
    """Pack trees into a few arrays: all nodes one after the other, and where each tree begins.

    Parameters
    ----------
    trees
        The trees.
    levels
        Number of levels of the alphabet.

    Returns
    -------
    dict[str, ndarray]
        ``tree_starts`` is ``(trees + 1,)``, the others have a row a node.
    """
    lengths = [len(tree) for tree in trees]
    arrays: dict[str, np.ndarray[Any, Any]] = {
        "tree_starts": np.concatenate([[0], np.cumsum(lengths)]).astype(np.int64)
    }
    for name in (*_ANSWERS, *_FIGURES):
        shape = {"sides": (0, levels), "seen": (0, levels), "children": (0, 2)}.get(name, (0,))
        parts = [getattr(tree, name) for tree in trees]
        arrays[f"node_{name}"] = np.concatenate(parts) if parts else np.zeros(shape)
    # A bit for each phone.
    for name in ("sides", "seen"):
        arrays[f"node_{name}"] = np.packbits(arrays[f"node_{name}"].astype(np.bool_), axis=-1)
    return arrays


def unpack_trees(arrays: Mapping[str, np.ndarray[Any, Any]], levels: int) -> list[Tree]:
    """Restore the trees that `pack_trees` packed.

    Parameters
    ----------
    arrays
        By name: ``tree_starts`` is ``(trees + 1,)``, the others have a row a node.
    levels
        Number of levels of the alphabet.

    Returns
    -------
    list[Tree]
        In the same order.

    Raises
    ------
    ValueError
        If the arrays do not belong together.
    """
    starts = arrays["tree_starts"]
    rows = {name: arrays[f"node_{name}"] for name in (*_ANSWERS, *_FIGURES)}
    nodes = int(starts[-1]) if starts.ndim == 1 and len(starts) else -1
    shapes = {"sides": (nodes, -(-levels // 8)), "children": (nodes, 2)}
    shapes["seen"] = shapes["sides"]
    for name, array in rows.items():
        if array.shape != shapes.get(name, (nodes,)) or np.isnan(array).any():
            raise ValueError("the nodes of the trees are incomplete")
    for name in ("sides", "seen"):
        bits = np.unpackbits(rows[name], axis=-1, count=levels)
        rows[name] = bits if name == "sides" else bits.astype(np.bool_)
    trees = []
    for first, last in itertools.pairwise(starts.tolist()):
        tree = Tree(**{name: array[first:last] for name, array in rows.items()})
        inner = tree.questions >= 0
        parents = np.arange(len(tree))[:, None]
        if ((tree.children <= parents) | (tree.children >= len(tree)))[inner].any():
            raise ValueError("a tree's nodes do not follow each other")
        trees.append(tree)
    return trees


class Forest:
    """All trees of a model, to predict many targets at once.

    Parameters
    ----------
    trees
        In order.
    attributes
        Index of the attribute that each question is about.
    are_phones
        Whether each attribute is a phone.
    levels
        Number of levels of the alphabet.
    """

    def __init__(
        self,
        trees: Sequence[Tree],
        attributes: Sequence[int],
        are_phones: Sequence[bool],
        levels: int,
    ) -> None:
        packed = pack_trees(trees, levels)
        questions = packed["node_questions"].astype(np.int64)
        of_nodes = np.array([*attributes, -1], dtype=np.int64)[questions]
        self._arrays = (
            packed["tree_starts"],
            of_nodes,
            np.array([*are_phones, False])[of_nodes],
            packed["node_bounds"],
            np.unpackbits(packed["node_sides"].astype(np.uint8), axis=-1, count=levels),
            packed["node_unknown"].astype(np.uint8),
            packed["node_children"].astype(np.int64),
            packed["node_means"],
        )

    def predict(self, trees: IntArray, values: FloatArray) -> FloatArray:
        """Predict the targets of segments.

        Parameters
        ----------
        trees
            Index of the tree, ``(segments, parameters)``; -1 for none.
        values
            Levels of the alphabet, or numbers in the unit of the attribute (seconds, dB, or no
            unit), ``(segments, attributes, parameters)``.

        Returns
        -------
        ndarray
            ``(segments, parameters)``, in the unit of each parameter; 0 where there is no tree.
        """
        targets = np.zeros(trees.shape)
        _predict(trees, values, *self._arrays, targets)
        return targets


@compiled
def _predict(  # type: ignore[no-untyped-def]  # numba infers the types
    trees, values, starts, attributes, are_phones, bounds, sides, unknown, children, means, targets
):
    """Write the mean of the leaf of every segment and parameter."""
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
            targets[segment, parameter] = means[node]
