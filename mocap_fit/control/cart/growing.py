"""Growing a tree: cut by cut, the best by cross-validated error (Krňoul & Železný eq. 8 to 11).

Attributes are levels: small numbers that stand for phones, or for the bins of a number. One
histogram by level and fold holds all that the cuts of an attribute need. Of a question that is
open, levels are put in order, and each place between two of them is a cut: a number's levels by
size, phones by the mean of their targets, which is the best order for squared error (Breiman et
al., theorem 4.5). In the order ``node`` that is done anew in each node, by the few examples that it
has of each phone. In the order ``tree`` phones are sorted once, by their means in the whole tree,
those of rare phones drawn to the mean of all.

The compiled way and the numpy way give the same trees.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mocap_fit.control.cart.contexts import ByteArray
from mocap_fit.control.cart.gains import surpluses
from mocap_fit.control.cart.kernel import (
    DRAWN,
    FIXED,
    HAS_NUMBA,
    LEFT,
    RIGHT,
    ROUNDING,
    SAME,
    SUBSET,
    UNSEEN,
    grow_and_prune,
)
from mocap_fit.tracks import FloatArray

IntArray = NDArray[np.int64]


class Asked(NamedTuple):
    """The questions of a tree as arrays, in the order in which they are tried.

    Parameters
    ----------
    attributes
        `(questions,)`: which row of the levels; those of one attribute are together.
    kinds
        `(questions,)`: `FIXED`, `ORDERED` or `SUBSET`.
    members
        `(questions, levels)`: 1 for the levels that answer yes to a fixed question.
    sizes
        `(attributes,)`: how many levels each attribute has.
    """

    attributes: IntArray
    kinds: IntArray
    members: ByteArray
    sizes: IntArray


class Grown(NamedTuple):
    """A tree as it was grown; node 0 is the root, and children come after their parents.

    Parameters
    ----------
    questions
        `(nodes,)`: what is asked; -1 in a leaf.
    sides
        `(nodes, levels)`: where a level goes, `LEFT` or `RIGHT`; `UNSEEN` if the node has none.
    children
        `(nodes, 2)`: the nodes to the left and to the right; -1 in a leaf.
    counts
        `(nodes,)`: examples.
    means
        `(nodes,)`: of their targets (eq. 8).
    errors
        `(nodes,)`: squared error, added up.
    validated
        `(nodes,)`: cross-validated squared error, added up (eq. 9); infinite for one example.
    gains
        `(nodes,)`: by how much the cut lowered the cross-validated error (eq. 10).
    """

    questions: IntArray
    sides: ByteArray
    children: IntArray
    counts: IntArray
    means: FloatArray
    errors: FloatArray
    validated: FloatArray
    gains: FloatArray


def grow(
    levels: ByteArray,
    targets: FloatArray,
    folds: IntArray,
    asked: Asked,
    *,
    fold_count: int,
    smallest: int,
    least_gain: float = 0.0,
    phone_order: str = "tree",
    held_out: int = -1,
    use_numba: bool = True,
) -> Grown:
    """Grow a tree.

    Parameters
    ----------
    levels
        `(attributes, examples)`.
    targets
        `(examples,)`.
    folds
        `(examples,)`: the fold of each, from 0.
    asked
        The questions.
    fold_count
        How many folds there are.
    smallest
        A node of so many examples or fewer is a leaf (N_min).
    least_gain
        A cut lowers the cross-validated error by more than so many variances of the node (its
        cross-validated error over its count). 0: by anything, as in the paper.
    phone_order
        ``tree`` or ``node``, as said above.
    held_out
        A fold whose examples are left out; -1 for none.
    use_numba
        Whether the compiled way is taken where numba is there.

    Returns
    -------
    Grown
        One node at least.
    """
    chosen = np.flatnonzero(folds != held_out)
    tree = room_for(len(chosen), int(asked.sizes.max()))
    how = (fold_count, smallest, least_gain, phone_order == "node")
    if use_numba and HAS_NUMBA:
        out, none = np.zeros(0, dtype=np.int64), np.zeros(0)
        nodes = grow_and_prune(
            levels, targets, folds, chosen, out, *asked, *how, -np.inf, none, none, none, *tree
        )
    else:
        nodes = _grow_plainly(levels, targets, folds, chosen, asked, *how, tree)
    return cut_to(tree, nodes)


def room_for(examples: int, levels: int) -> Grown:
    """Arrays for the largest tree of so many examples; what growing does not reach is not set."""
    room = 2 * examples + 1
    return Grown(
        np.empty(room, dtype=np.int64),
        np.empty((room, levels), dtype=np.uint8),
        np.empty((room, 2), dtype=np.int64),
        np.empty(room, dtype=np.int64),
        *(np.empty(room) for _ in range(4)),
    )


def cut_to(tree: Grown, nodes: int) -> Grown:
    """The nodes that there are."""
    arrays: Any = tree
    return Grown(*(array[:nodes].copy() for array in arrays))


def _grow_plainly(
    levels: ByteArray,
    targets: FloatArray,
    folds: IntArray,
    chosen: IntArray,
    asked: Asked,
    fold_count: int,
    smallest: int,
    least_gain: float,
    by_node: bool,
    tree: Grown,
) -> int:
    """Grow in numpy: a node at a time, all cuts of an attribute at once."""
    of_attribute, kinds, members, sizes = asked
    waiting = [chosen]
    order: dict[int, IntArray] = {}
    for node, examples in enumerate(waiting):
        count = float(len(examples))
        mean = float(targets[examples].sum() / count)
        values = targets[examples] - mean
        fold = folds[examples]
        of_n = np.bincount(fold, minlength=fold_count).astype(np.float64)
        of_s = np.bincount(fold, values, fold_count).astype(np.float64)
        error, over = float(values @ values), float(surpluses(of_n, of_s))
        tree.counts[node], tree.means[node] = len(examples), mean
        tree.errors[node], tree.validated[node] = error, error + over
        tree.questions[node], tree.children[node], tree.gains[node] = -1, -1, 0.0
        tree.sides[node] = UNSEEN
        equal = max(SAME * tree.errors[0], ROUNDING * count * mean * mean)
        if len(examples) <= smallest or not over < np.inf or error <= equal:
            continue
        same = SAME * error
        best, best_question = least_gain * (error + over) / count, -1
        side = np.full(0, UNSEEN, dtype=np.uint8)
        for question, attribute in enumerate(of_attribute):
            size = int(sizes[attribute])
            cell = levels[attribute, examples].astype(np.int64) * fold_count + fold
            shape = (size, fold_count)
            n = np.bincount(cell, minlength=size * fold_count).reshape(shape).astype(np.float64)
            s = np.bincount(cell, values, size * fold_count).reshape(shape)
            has = n.sum(axis=1) > 0
            if kinds[question] == FIXED:
                yes = has & (members[question, :size] > 0)
                if not yes.any() or yes.sum() == has.sum():
                    continue
                places = np.flatnonzero(has)
                cuts = np.stack([n[yes].sum(axis=0), s[yes].sum(axis=0)])[:, None]
            else:
                places = np.flatnonzero(has)
                if kinds[question] == SUBSET and (by_node or node == 0):
                    keys = s[places].sum(axis=1) / (
                        n[places].sum(axis=1) + (0.0 if by_node else DRAWN)
                    )
                    places = places[np.argsort(keys, kind="stable")]
                    if node == 0:
                        order[int(attribute)] = places
                elif kinds[question] == SUBSET:
                    places = order[int(attribute)][has[order[int(attribute)]]]
                if len(places) < 2:
                    continue
                cuts = np.stack([n[places].cumsum(axis=0)[:-1], s[places].cumsum(axis=0)[:-1]])
            rest_n, rest_s = of_n - cuts[0], of_s - cuts[1]
            plain = (
                cuts[1].sum(axis=1) ** 2 / cuts[0].sum(axis=1)
                + rest_s.sum(axis=1) ** 2 / rest_n.sum(axis=1)
                - values.sum() ** 2 / count
            )
            gain = plain + over - surpluses(cuts[0], cuts[1]) - surpluses(rest_n, rest_s)
            # The first of those that are the same, as the compiled way finds it.
            cut = int(np.argmax(gain >= gain.max() - same))
            if gain[cut] > best + same:
                best, best_question = float(gain[cut]), question
                side = np.full(size, UNSEEN, dtype=np.uint8)
                if kinds[question] == FIXED:
                    side[places] = np.where(members[question, places] > 0, LEFT, RIGHT)
                else:
                    side[places] = np.where(np.arange(len(places)) <= cut, LEFT, RIGHT)
        if best_question >= 0:
            tree.questions[node], tree.gains[node] = best_question, best
            tree.sides[node, : len(side)] = side
            is_left = side[levels[of_attribute[best_question], examples]] == LEFT
            tree.children[node] = len(waiting), len(waiting) + 1
            waiting += [examples[is_left], examples[~is_left]]
    return len(waiting)
