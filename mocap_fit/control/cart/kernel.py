"""The compiled kernel of CART: a tree is grown, validated and pruned in one call.

Cross-validated errors have a closed form (Krňoul & Železný eq. 9 and 10). The examples of a node
are in folds, drawn once a tree. Let fold v have n_v of its n examples, and let their deviations
from the node's mean add up to E_v: the mean of the others lies E_v / (n - n_v) below the node's.
The squared errors of the folds, each predicted from the others, add up to ::

    R_CV = R + sum over v of E_v² (2 n - n_v) / (n - n_v)²

where R is the plain squared error. Counts and sums by fold are therefore enough, and no predictor
is trained ten times. Eq. 9 divides by the root's number of examples in every node, so that errors
of nodes add up (eq. 10); here they are sums of squares and are not divided at all.

Attributes are levels: small integers for phones, or for the bins of a number. One histogram by
level and fold holds all that the cuts of an attribute need. For an open question the levels are
ordered and each gap between two of them is a candidate: numbers by size, phones by the mean of
their targets, which is the best order for squared error (Breiman et al. 1984, theorem 4.5).

Compiled functions that call each other share this file, because numba's cache notices changes of
one file only. Without numba the same functions run as plain Python, slowly.
"""

# mypy: disable-error-code="no-untyped-def"
from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

compiled: Any
try:
    import numba

    _njit: Any = numba.njit
    # No "fast math": the same bytes whether a function was compiled or came from the cache.
    compiled = _njit(cache=True, error_model="numpy", nogil=True)
    # Called by compiled functions alone, which contain it: no entry in the cache, none from Python.
    _inner = _njit(error_model="numpy", nogil=True, no_cpython_wrapper=True, no_cfunc_wrapper=True)
    # The innermost loops are a tenth faster where they are written into the caller.
    _inlined = _njit(error_model="numpy", nogil=True, inline="always")
except ImportError:
    compiled = _inner = _inlined = lambda function: function

#: Kinds of questions: a class or list of phones, a bound of a number, an open group of phones.
FIXED, ORDERED, SUBSET = 0, 1, 2
LEFT, RIGHT, UNSEEN = 0, 1, 2
#: Gains that differ by less than this part of a node's error count as equal.
SAME = 1e-9
#: A squared error below this part of the sum of squares is rounding.
ROUNDING = 1e-24
#: Examples of the overall mean that are added to each phone's mean in the order ``tree``.
SHRINKAGE = 3.0


class _Totals(NamedTuple):
    """A node's count, sum of deviations, error, surplus, and the difference that counts as none."""

    n: float
    s: float
    error: float
    surplus: float
    same: float


@compiled
def compute_surplus(folds, count, total):
    """Compute by how much the cross-validated error of a node exceeds its squared error.

    Parameters
    ----------
    folds
        Number of examples of each fold, then the sum of their targets, ``(2 * folds,)``.
    count, total
        The same over all folds.

    Returns
    -------
    float
        Infinite where all examples are in one fold, and none is left to train on.
    """
    mean, cv = total / count, len(folds) // 2
    added = 0.0
    for fold in range(cv):
        rest = count - folds[fold]
        if rest < 0.5:
            return np.inf
        off = folds[cv + fold] - folds[fold] * mean
        added += off * off * (count + rest) / (rest * rest)
    return added


@_inlined
def _sum_folds(targets, all_folds, start, end, examples, deviations, folds, node):
    """Write a node's deviations and folds, and add them up; returns mean, error and sum."""
    total = 0.0
    for i in range(start, end):
        total += targets[examples[i]]
    mean = total / float(end - start)
    node[:] = 0.0
    error, total, cv = 0.0, 0.0, len(node) // 2
    for i in range(start, end):
        example = examples[i]
        value, fold = targets[example] - mean, all_folds[example]
        deviations[i], folds[i] = value, fold
        error += value * value
        total += value
        node[fold] += 1.0
        node[cv + fold] += value
    return mean, error, total


@_inlined
def _count_levels(row, size, start, end, examples, deviations, folds, by_level, by_fold):
    """Add up the examples of a node by level, and by level and fold."""
    cv = by_fold.shape[1] // 2
    for level in range(size):
        by_level[level, 0] = 0.0
    for i in range(start, end):
        level, fold, value = row[examples[i]], folds[i], deviations[i]
        if by_level[level, 0] == 0.0:
            by_level[level, 1] = 0.0
            for f in range(2 * cv):
                by_fold[level, f] = 0.0
        by_level[level, 0] += 1.0
        by_level[level, 1] += value
        by_fold[level, fold] += 1.0
        by_fold[level, cv + fold] += value


@_inner
def _list_levels(by_level, attribute, order, sizes, present):
    """List the levels that a node has examples of, in the root's order; returns their number."""
    count = 0
    for i in range(sizes[attribute]):
        level = order[attribute, i]
        if by_level[level, 0] > 0.0:
            present[count] = level
            count += 1
    return count


@_inner
def _sort_phones(count, shrinkage, by_level, present, keys):
    """Sort the levels of a node by their mean deviation, equal ones by number."""
    for i in range(count):
        level = present[i]
        keys[level] = by_level[level, 1] / (by_level[level, 0] + shrinkage)
    for i in range(1, count):
        level = present[i]
        at = i
        while at > 0 and (
            keys[present[at - 1]] > keys[level]
            or (keys[present[at - 1]] == keys[level] and present[at - 1] > level)
        ):
            present[at] = present[at - 1]
            at -= 1
        present[at] = level


@_inlined
def _compute_plain_gain(n_left, s_left, count, total):
    """Compute by how much a cut lowers the plain squared error."""
    s_right, n_right = total - s_left, count - n_left
    return s_left * s_left / n_left + s_right * s_right / n_right - total * total / count


@_inlined
def _compute_gain(limit, n_left, s_left, totals, node, left, right):
    """Compute the gain of a cut whose left side is added up by fold (eq. 10)."""
    for f in range(len(node)):
        right[f] = node[f] - left[f]
    gain = limit - compute_surplus(left, n_left, s_left)
    return gain - compute_surplus(right, totals.n - n_left, totals.s - s_left)


@_inlined
def _try_class(members, count, present, least, best, totals, by_level, by_fold, node, left, right):
    """Compute the gain of a fixed question; minus infinity where it cannot exceed the best."""
    n_left, s_left = 0.0, 0.0
    for i in range(count):
        level = present[i]
        if members[level]:
            n_left += by_level[level, 0]
            s_left += by_level[level, 1]
    if n_left < least or totals.n - n_left < least:
        return -np.inf
    # No cut gains more than this: nothing is validated below its plain error.
    limit = _compute_plain_gain(n_left, s_left, totals.n, totals.s) + totals.surplus
    if limit <= best + totals.same:
        return -np.inf
    left[:] = 0.0
    for i in range(count):
        level = present[i]
        if members[level]:
            for f in range(len(left)):
                left[f] += by_fold[level, f]
    return _compute_gain(limit, n_left, s_left, totals, node, left, right)


@_inlined
def _try_cuts(count, present, least, best, totals, by_level, by_fold, node, left, right):
    """Find the best cut between two levels; returns its gain, and the last level to the left."""
    n_left, s_left = 0.0, 0.0
    left[:] = 0.0
    cut = -1
    for i in range(count - 1):
        level = present[i]
        n_left += by_level[level, 0]
        s_left += by_level[level, 1]
        for f in range(len(left)):
            left[f] += by_fold[level, f]
        if n_left < least or totals.n - n_left < least:
            continue
        limit = _compute_plain_gain(n_left, s_left, totals.n, totals.s) + totals.surplus
        if limit <= best + totals.same:
            continue
        gain = _compute_gain(limit, n_left, s_left, totals, node, left, right)
        if gain > best + totals.same:
            best, cut = gain, i
    return best, cut


@_inner
def _mark_sides(count, cut, members, present, side):
    """Write where the levels of a node go: by the place of a cut, or by the members of a class."""
    side[:] = UNSEEN
    for i in range(count):
        is_left = i <= cut if cut >= 0 else members[present[i]] > 0
        side[present[i]] = LEFT if is_left else RIGHT


@_inner
def _find_cut(levels, table, rules, start, end, is_root, totals, rows, work):
    """Find the best cut of a node: its gain and question, -1 for none, and the sides of levels."""
    # Counts and sums of deviations by level, (levels, 2), and by level and fold, counts before
    # sums, (levels, 2 * cv); by fold of the node and of both sides of a cut; the levels of each
    # attribute in the root's order and how many there are; the node's own, their keys and sides.
    by_level, by_fold, node, left, right, order, sizes, present, keys, side = work
    attributes, kinds, all_members, all_sizes = table
    examples, deviations, folds = rows
    best = rules.min_impurity_decrease * (totals.error + totals.surplus) / totals.n
    best_question, last, count = -1, -1, 0
    shrinkage = 0.0 if rules.by_node else SHRINKAGE
    least = float(rules.min_samples_leaf)
    for question in range(len(attributes)):
        attribute = attributes[question]
        if attribute != last:
            last, size = attribute, all_sizes[attribute]
            row = levels[attribute]
            _count_levels(row, size, start, end, examples, deviations, folds, by_level, by_fold)
            if is_root:
                sizes[attribute] = size
                for level in range(size):
                    order[attribute, level] = level
            count = _list_levels(by_level, attribute, order, sizes, present)
        if count < 2:
            continue
        members, cut = all_members[question], -1
        if kinds[question] == FIXED:
            gain = _try_class(
                members, count, present, least, best, totals, by_level, by_fold, node, left, right
            )
        else:
            if kinds[question] == SUBSET and (rules.by_node or is_root):
                _sort_phones(count, shrinkage, by_level, present, keys)
                if is_root:
                    sizes[attribute] = count
                    for i in range(count):
                        order[attribute, i] = present[i]
            gain, cut = _try_cuts(
                count, present, least, best, totals, by_level, by_fold, node, left, right
            )
        if gain > best + totals.same:
            best, best_question = gain, question
            _mark_sides(count, cut, members, present, side)
    return best, best_question


@_inner
def _divide(row, side, start, end, examples, spare):
    """Move a node's examples that go to the left before the others; returns where these begin."""
    middle, moved = start, 0
    for i in range(start, end):
        example = examples[i]
        if side[row[example]] == LEFT:
            examples[middle] = example
            middle += 1
        else:
            spare[moved] = example
            moved += 1
    for i in range(moved):
        examples[middle + i] = spare[i]
    return middle


@_inner
def _grow(sample, examples, table, rules, nodes):
    """Grow a tree of some examples, which it sorts; returns the number of its nodes."""
    most, attributes, sizes = len(examples), len(sample.levels), nodes.sides.shape[1]
    # The examples of a node are adjacent, from its start to its end.
    spare, folds = np.empty(most, np.int64), np.empty(most, np.int64)
    deviations = np.empty(most)
    starts, ends = np.empty(2 * most + 1, np.int64), np.empty(2 * most + 1, np.int64)
    depths = np.empty(2 * most + 1, np.int64)
    starts[0], ends[0], depths[0] = 0, most, 0
    both = 2 * rules.cv
    by_fold, side = np.zeros(both), np.zeros(sizes, np.uint8)
    sums = (np.zeros((sizes, 2)), np.zeros((sizes, both)), by_fold, np.zeros(both), np.zeros(both))
    order = (np.zeros((attributes, sizes), np.int64), np.zeros(attributes, np.int64))
    work = (*sums, *order, np.zeros(sizes, np.int64), np.zeros(sizes), side)
    count, node = 1, 0
    while node < count:
        start, end, depth = starts[node], ends[node], depths[node]
        size = float(end - start)
        mean, error, total = _sum_folds(
            sample.targets, sample.folds, start, end, examples, deviations, folds, by_fold
        )
        over = compute_surplus(by_fold, size, total)
        nodes.counts[node], nodes.means[node] = end - start, mean
        nodes.errors[node], nodes.validated[node] = error, error + over
        nodes.questions[node], nodes.gains[node] = -1, 0.0
        nodes.children[node, 0], nodes.children[node, 1] = -1, -1
        nodes.sides[node, :] = UNSEEN
        # What rounding leaves of equal targets is no difference to cut at.
        equal = max(SAME * nodes.errors[0], ROUNDING * size * mean * mean)
        is_leaf = end - start < rules.min_samples_split or depth >= rules.max_depth
        question = -1
        if not is_leaf and over < np.inf and error > equal:
            totals = _Totals(size, total, error, over, SAME * error)
            rows = (examples, deviations, folds)
            gain, question = _find_cut(
                sample.levels, table, rules, start, end, node == 0, totals, rows, work
            )
        if question >= 0:
            attribute = table.attributes[question]
            nodes.questions[node], nodes.gains[node] = question, gain
            for level in range(sizes):
                nodes.sides[node, level] = side[level]
            middle = _divide(sample.levels[attribute], side, start, end, examples, spare)
            nodes.children[node, 0], nodes.children[node, 1] = count, count + 1
            starts[count], ends[count] = start, middle
            starts[count + 1], ends[count + 1] = middle, end
            depths[count], depths[count + 1] = depth + 1, depth + 1
            count += 2
        node += 1
    return count


@_inner
def _link_branches(count, children, counts, validated):
    """List each node's parent, whether it is cut, and the error and price of its branch."""
    parents = np.full(count, -1, np.int64)
    is_cut = np.zeros(count, np.bool_)
    # Of each branch: the errors of its leaves, and the variances of its cuts.
    below, price = np.empty(count), np.zeros(count)
    for node in range(count):
        below[node] = validated[node]
        if children[node, 0] >= 0:
            parents[children[node, 0]] = node
            parents[children[node, 1]] = node
            is_cut[node] = True
            below[node], price[node] = 0.0, validated[node] / counts[node]
    for node in range(count - 1, 0, -1):
        below[parents[node]] += below[node]
        price[parents[node]] += price[node]
    return parents, is_cut, below, price


@compiled
def compute_alphas(count, children, counts, validated):
    """Compute the strength of every cut by weakest-link pruning (Breiman et al. section 3.3).

    Parameters
    ----------
    count
        Number of nodes.
    children, counts, validated
        Those of a tree, ``(nodes, 2)`` and ``(nodes,)``; errors in the unit of the targets squared.

    Returns
    -------
    ndarray
        The alpha up to which each node keeps its cut, in variances of nodes, ``(count,)``; minus
        infinity in a leaf. No cut is stronger than one above it.
    """
    parents, is_cut, below, price = _link_branches(count, children, counts, validated)
    alphas = np.full(count, -np.inf)
    waiting = np.empty(count, np.int64)
    reached = -np.inf
    while is_cut[0]:
        weakest, least = -1, np.inf
        for node in range(count):
            if is_cut[node]:
                alpha = (validated[node] - below[node]) / price[node]
                if weakest < 0 or alpha < least:
                    weakest, least = node, alpha
        reached = max(reached, least)
        waiting[0], left = weakest, 1
        while left > 0:
            left -= 1
            node = waiting[left]
            if is_cut[node]:
                is_cut[node], alphas[node] = False, reached
                waiting[left], waiting[left + 1] = children[node, 0], children[node, 1]
                left += 2
        more, less, node = validated[weakest] - below[weakest], price[weakest], weakest
        while node >= 0:
            below[node] += more
            price[node] -= less
            node = parents[node]
    return alphas


@_inner
def _judge(levels, targets, out, attributes, nodes, strong, alphas, errors, squares):
    """Add the errors of some examples at each alpha, and the squares of these errors."""
    questions, sides, children, counts, means, _, _, _ = nodes
    for example in out:
        node, at = 0, len(alphas) - 1
        while at >= 0:
            off = means[node] - targets[example]
            # In all trees whose alpha is above the node's, the example ends here.
            while at >= 0 and not strong[node] >= alphas[at]:
                errors[at] += off * off
                squares[at] += off**4
                at -= 1
            if at >= 0:
                level = levels[attributes[questions[node]], example]
                side = sides[node, level]
                left, right = children[node, 0], children[node, 1]
                if side == UNSEEN:
                    side = LEFT if counts[left] >= counts[right] else RIGHT
                node = left if side == LEFT else right


@_inner
def _prune(count, nodes, strong, alpha):
    """Remove the cuts that are weaker than an alpha; returns the number of nodes that remain."""
    questions, sides, children, counts, means, errors, validated, gains = nodes
    stays, numbers = np.zeros(count, np.bool_), np.zeros(count, np.int64)
    stays[0] = True
    remaining = 0
    for node in range(count):
        if stays[node]:
            numbers[node] = remaining
            remaining += 1
            if questions[node] >= 0 and strong[node] >= alpha:
                stays[children[node, 0]] = True
                stays[children[node, 1]] = True
            else:
                questions[node], gains[node] = -1, 0.0
                children[node, 0], children[node, 1] = -1, -1
    # Children come after their parents, so that nothing is overwritten before it is moved.
    for node in range(count):
        if stays[node]:
            row = numbers[node]
            for side in range(2):
                child = children[node, side]
                children[row, side] = numbers[child] if child >= 0 else -1
            for level in range(sides.shape[1]):
                sides[row, level] = sides[node, level]
            questions[row], counts[row] = questions[node], counts[node]
            means[row], errors[row] = means[node], errors[node]
            validated[row], gains[row] = validated[node], gains[node]
    return remaining


@compiled
def grow_and_prune(sample, fold, table, rules, alpha, alphas, errors, squares, nodes):
    """Grow a tree without one fold, let that fold judge it, and prune it.

    Parameters
    ----------
    sample
        Levels, targets and folds of all examples.
    fold
        The fold that is held out; -1 for none.
    table, rules
        The questions, and how the tree is grown.
    alpha
        The strength that cuts must have to remain, in variances.
    alphas
        Strengths at which the tree is judged, ascending, in variances, ``(alphas,)``.
    errors, squares
        The squared errors of the fold at each alpha and the squares of these are added, in powers
        of the unit of the targets, ``(alphas,)``.
    nodes
        Space for two nodes an example, to be overwritten.

    Returns
    -------
    int
        Number of nodes of the pruned tree.
    """
    levels, targets, folds = sample
    count = _grow(sample, np.flatnonzero(folds != fold), table, rules, nodes)
    strong = compute_alphas(count, nodes.children, nodes.counts, nodes.validated)
    out = np.flatnonzero(folds == fold)
    _judge(levels, targets, out, table.attributes, nodes, strong, alphas, errors, squares)
    return _prune(count, nodes, strong, alpha)
