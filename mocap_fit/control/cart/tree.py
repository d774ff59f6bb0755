"""A finished tree: which question each node asks, where every answer leads, what its leaves say."""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mocap_fit.control.cart.contexts import KIND_OF_GROUP, ByteArray
from mocap_fit.control.cart.growing import LEFT, RIGHT, UNSEEN, Grown, IntArray
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


def finished(
    grown: Grown,
    questions: Sequence[Question],
    numbers: Sequence[int],
    members: ByteArray,
    attributes: Sequence[int],
    edges: Mapping[int, FloatArray],
    groups: Sequence[str],
) -> Tree:
    """A grown tree as it is kept: bounds as numbers, and a side for every phone.

    A phone that no example of a node had goes with its group: to the side where most phones of the
    group went, then most of its kind (vowels, consonants), then most examples.

    Parameters
    ----------
    grown
        The tree, pruned.
    questions
        All questions of the model.
    numbers
        Which of them the tree was grown with, in the order that `grown` counts them.
    members
        `(questions, levels)` of those it was grown with, as in `Asked`.
    attributes
        Of each of those, which attribute it is about.
    edges
        Of each attribute that is a number, the bounds between its bins.
    groups
        `(levels,)`: the group of each level of the alphabet.
    """
    nodes, levels = len(grown.questions), len(groups)
    bounds = np.zeros(nodes)
    sides = np.zeros((nodes, levels), dtype=np.uint8)
    unknown = np.zeros(nodes, dtype=np.uint8)
    seen = np.zeros((nodes, levels), dtype=np.bool_)
    asked = np.full(nodes, -1, dtype=np.int64)
    for node in np.flatnonzero(grown.questions >= 0).tolist():
        local = int(grown.questions[node])
        question = questions[numbers[local]]
        asked[node] = numbers[local]
        counts = grown.counts[grown.children[node]]
        larger = LEFT if counts[LEFT] >= counts[RIGHT] else RIGHT
        found = grown.sides[node]
        if not question.attribute.is_phone:
            own = edges[attributes[local]]
            bounds[node], unknown[node] = _bound(found, own, larger)
            continue
        found = found[:levels]
        seen[node] = found != UNSEEN
        if question.is_open:
            sides[node] = _backed_off(found, groups, larger)
        else:
            sides[node] = np.where(members[local, :levels] > 0, LEFT, RIGHT)
    return Tree(
        asked,
        bounds,
        sides,
        unknown,
        grown.children,
        seen,
        grown.counts,
        grown.means,
        grown.errors,
        grown.validated,
        grown.gains,
    )


def _bound(found: ByteArray, edges: FloatArray, larger: int) -> tuple[float, int]:
    """The bound between two bins, and the side of what is unknown (the bin after the last)."""
    last = len(edges) + 1
    unknown = int(found[last]) if found[last] != UNSEEN else larger
    left = int(np.flatnonzero(found[: last + 1] == LEFT)[-1])
    right = int(np.flatnonzero(found[: last + 1] == RIGHT)[0])
    if right == last:
        return np.inf, unknown
    return float(0.5 * (edges[left] + edges[right - 1])), unknown


def _backed_off(found: ByteArray, groups: Sequence[str], larger: int) -> ByteArray:
    sides = found.copy()
    votes: Counter[str] = Counter()
    for level in np.flatnonzero(found != UNSEEN).tolist():
        vote = 1 if found[level] == RIGHT else -1
        if groups[level]:
            votes[groups[level]] += vote
            votes["kind " + KIND_OF_GROUP[groups[level]]] += vote
    for level in np.flatnonzero(found == UNSEEN).tolist():
        group = groups[level]
        decided = (votes[group] or votes["kind " + KIND_OF_GROUP[group]]) if group else 0
        sides[level] = larger if decided == 0 else (RIGHT if decided > 0 else LEFT)
    return sides


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
