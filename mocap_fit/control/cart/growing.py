"""Growing a tree: cut by cut, the best by cross-validated error (Krňoul & Železný eq. 8 to 11).

Attributes are levels: small numbers that stand for phones, or for the bins of a number. One
histogram by level and fold holds all that the cuts of an attribute need. Of a question that is
open, levels are put in order, and each place between two of them is a cut: a number's levels by
size, phones by the mean of their targets, which is the best order for squared error (Breiman et
al., theorem 4.5). In the order ``tree`` phones are sorted once, by their means in the whole tree;
in the order ``node`` anew in each node, by the few examples that it has.

The compiled way and the numpy way give the same trees.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mocap_fit.control.cart.contexts import ByteArray
from mocap_fit.control.cart.gains import HAS_NUMBA, compiled, surplus, surpluses
from mocap_fit.tracks import FloatArray

IntArray = NDArray[np.int64]

#: What a question is: of a class or a list, of a number, open over phones.
FIXED, ORDERED, SUBSET = 0, 1, 2
LEFT, RIGHT, UNSEEN = 0, 1, 2
# Gains that differ by less than this part of a node's error are the same gain.
_SAME = 1e-9


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
    chosen = np.arange(len(folds)) if held_out < 0 else np.flatnonzero(folds != held_out)
    # Rounding is least about the mean, which is put back at the end.
    middle = float(targets[chosen].mean())
    centred = targets - middle
    # What rounding leaves of equal targets is no difference to be cut at.
    centred[np.abs(centred) <= 1e-12 * abs(middle)] = 0.0
    size = int(asked.sizes.max()) if len(asked.sizes) else 1
    room = 2 * len(chosen) + 1
    # What growing does not reach is never looked at.
    tree = Grown(
        np.empty(room, dtype=np.int64),
        np.empty((room, size), dtype=np.uint8),
        np.empty((room, 2), dtype=np.int64),
        np.empty(room, dtype=np.int64),
        *(np.empty(room) for _ in range(4)),
    )
    run = _grow if use_numba and HAS_NUMBA else _grow_plainly
    nodes = run(
        levels,
        centred,
        folds,
        chosen,
        *asked,
        fold_count,
        smallest,
        least_gain,
        phone_order == "node",
        *tree,
    )
    tree.means[:nodes] += middle
    arrays: Any = tree
    return Grown(*(array[:nodes].copy() for array in arrays))


@compiled
def _grow(  # type: ignore[no-untyped-def]  # numba infers the types
    levels,
    targets,
    folds,
    chosen,
    of_attribute,
    kinds,
    members,
    sizes,
    fold_count,
    smallest,
    least_gain,
    by_node,
    questions,
    sides,
    children,
    counts,
    means,
    errors,
    validated,
    gains,
):
    examples = len(chosen)
    attributes = levels.shape[0]
    size = sides.shape[1]
    # The examples of a node lie together, from its start to its end.
    lying = chosen.copy()
    aside = np.empty(examples, np.int64)
    starts = np.empty(2 * examples + 1, np.int64)
    ends = np.empty(2 * examples + 1, np.int64)
    starts[0], ends[0] = 0, examples
    # Of each, by how much its target is off the node's mean, and its fold.
    off = np.empty(examples)
    own_fold = np.empty(examples, np.int64)
    # Histograms of one attribute: by level, and by level and fold.
    n, s = np.zeros(size), np.zeros(size)
    n_fold, s_fold = np.zeros((size, fold_count)), np.zeros((size, fold_count))
    of_n, of_s = np.zeros(fold_count), np.zeros(fold_count)
    left_n, left_s = np.zeros(fold_count), np.zeros(fold_count)
    right_n, right_s = np.zeros(fold_count), np.zeros(fold_count)
    order = np.zeros((attributes, size), np.int64)
    seen = np.zeros(attributes, np.int64)
    present = np.empty(size, np.int64)
    keys = np.zeros(size)
    side = np.zeros(size, np.uint8)
    nodes, node = 1, 0
    while node < nodes:
        start, end = starts[node], ends[node]
        count = float(end - start)
        total = 0.0
        for i in range(start, end):
            total += targets[lying[i]]
        mean = total / count
        of_n[:] = 0.0
        of_s[:] = 0.0
        error = 0.0
        total = 0.0
        for i in range(start, end):
            example = lying[i]
            value, fold = targets[example] - mean, folds[example]
            off[i], own_fold[i] = value, fold
            error += value * value
            total += value
            of_n[fold] += 1.0
            of_s[fold] += value
        over = surplus(of_n, of_s, count, total)
        counts[node], means[node] = end - start, mean
        errors[node], validated[node] = error, error + over
        questions[node], gains[node] = -1, 0.0
        children[node, 0], children[node, 1] = -1, -1
        sides[node, :] = UNSEEN
        same = _SAME * error
        best, best_question = least_gain * (error + over) / count, -1
        last, kept = -1, 0
        is_leaf = end - start <= smallest or not over < np.inf or error <= _SAME * errors[0]
        for question in range(0 if is_leaf else len(of_attribute)):
            attribute = of_attribute[question]
            if attribute != last:
                last = attribute
                row = levels[attribute]
                for level in range(sizes[attribute]):
                    n[level] = 0.0
                for i in range(start, end):
                    level, fold, value = row[lying[i]], own_fold[i], off[i]
                    if n[level] == 0.0:
                        s[level] = 0.0
                        for f in range(fold_count):
                            n_fold[level, f] = 0.0
                            s_fold[level, f] = 0.0
                    n[level] += 1.0
                    s[level] += value
                    n_fold[level, fold] += 1.0
                    s_fold[level, fold] += value
                if node == 0:
                    seen[attribute] = sizes[attribute]
                    for level in range(sizes[attribute]):
                        order[attribute, level] = level
                kept = 0
                for place in range(seen[attribute]):
                    level = order[attribute, place]
                    if n[level] > 0.0:
                        present[kept] = level
                        kept += 1
            if kept < 2:
                continue
            if kinds[question] == FIXED:
                n_left, s_left = 0.0, 0.0
                for place in range(kept):
                    level = present[place]
                    if members[question, level]:
                        n_left += n[level]
                        s_left += s[level]
                if n_left == 0.0 or n_left == count:
                    continue
                plain = _plain_gain(n_left, s_left, count, total)
                if plain + over <= best + same:
                    continue
                left_n[:] = 0.0
                left_s[:] = 0.0
                for place in range(kept):
                    level = present[place]
                    if members[question, level]:
                        for f in range(fold_count):
                            left_n[f] += n_fold[level, f]
                            left_s[f] += s_fold[level, f]
                for f in range(fold_count):
                    right_n[f] = of_n[f] - left_n[f]
                    right_s[f] = of_s[f] - left_s[f]
                gain = plain + over - surplus(left_n, left_s, n_left, s_left)
                gain -= surplus(right_n, right_s, count - n_left, total - s_left)
                if gain > best + same:
                    best, best_question = gain, question
                    for level in range(sizes[attribute]):
                        side[level] = UNSEEN
                    for place in range(kept):
                        level = present[place]
                        side[level] = LEFT if members[question, level] else RIGHT
                continue
            if kinds[question] == SUBSET and (by_node or node == 0):
                for place in range(kept):
                    keys[present[place]] = s[present[place]] / n[present[place]]
                for place in range(1, kept):
                    level = present[place]
                    at = place
                    while at > 0 and _follows(present[at - 1], level, keys):
                        present[at] = present[at - 1]
                        at -= 1
                    present[at] = level
                if node == 0:
                    seen[attribute] = kept
                    for place in range(kept):
                        order[attribute, place] = present[place]
            n_left, s_left = 0.0, 0.0
            left_n[:] = 0.0
            left_s[:] = 0.0
            cut = -1
            for place in range(kept - 1):
                level = present[place]
                n_left += n[level]
                s_left += s[level]
                for f in range(fold_count):
                    left_n[f] += n_fold[level, f]
                    left_s[f] += s_fold[level, f]
                # A cut gains no more than this: nothing is validated below its plain error.
                plain = _plain_gain(n_left, s_left, count, total)
                if plain + over <= best + same:
                    continue
                for f in range(fold_count):
                    right_n[f] = of_n[f] - left_n[f]
                    right_s[f] = of_s[f] - left_s[f]
                gain = plain + over - surplus(left_n, left_s, n_left, s_left)
                gain -= surplus(right_n, right_s, count - n_left, total - s_left)
                if gain > best + same:
                    best, best_question, cut = gain, question, place
            if cut >= 0:
                for level in range(sizes[attribute]):
                    side[level] = UNSEEN
                for place in range(kept):
                    side[present[place]] = LEFT if place <= cut else RIGHT
        if best_question >= 0:
            questions[node], gains[node] = best_question, best
            row = levels[of_attribute[best_question]]
            for level in range(sizes[of_attribute[best_question]]):
                sides[node, level] = side[level]
            middle, moved = start, 0
            for i in range(start, end):
                example = lying[i]
                if side[row[example]] == LEFT:
                    lying[middle] = example
                    middle += 1
                else:
                    aside[moved] = example
                    moved += 1
            for i in range(moved):
                lying[middle + i] = aside[i]
            children[node, 0], children[node, 1] = nodes, nodes + 1
            starts[nodes], ends[nodes] = start, middle
            starts[nodes + 1], ends[nodes + 1] = middle, end
            nodes += 2
        node += 1
    return nodes


@compiled
def _plain_gain(n_left, s_left, count, total):  # type: ignore[no-untyped-def]
    """By how much a cut lowers the plain squared error."""
    s_right, n_right = total - s_left, count - n_left
    return s_left * s_left / n_left + s_right * s_right / n_right - total * total / count


@compiled
def _follows(level, other, keys):  # type: ignore[no-untyped-def]
    """Whether a level comes after another: by key, then by number."""
    return keys[level] > keys[other] or (keys[level] == keys[other] and level > other)


def _grow_plainly(
    levels: ByteArray,
    targets: FloatArray,
    folds: IntArray,
    chosen: IntArray,
    of_attribute: IntArray,
    kinds: IntArray,
    members: ByteArray,
    sizes: IntArray,
    fold_count: int,
    smallest: int,
    least_gain: float,
    by_node: bool,
    *arrays: Any,
) -> int:
    """What `_grow` does, in numpy: a node at a time, all cuts of an attribute at once."""
    tree = Grown(*arrays)
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
        if len(examples) <= smallest or not over < np.inf or error <= _SAME * tree.errors[0]:
            continue
        same = _SAME * error
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
                    keys = s[places].sum(axis=1) / n[places].sum(axis=1)
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
