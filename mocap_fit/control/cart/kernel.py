"""The compiled kernel of CART: growing, judging and pruning a tree in one call.

`growing.py` and `pruning.py` say the same in numpy, and the tests hold the two together. All that
is compiled is in this one file: what numba keeps of a function does not notice when another file
changes.
"""

from __future__ import annotations

from typing import Any

import numpy as np

try:
    import numba

    # No "fast math": the same bytes whether a function was compiled or found in the cache.
    compiled: Any = numba.njit(cache=True, error_model="numpy", nogil=True)
    HAS_NUMBA = True
except ImportError:  # pragma: no cover - numba is a dependency; without it the numpy path works

    def compiled(function: Any) -> Any:
        """Leave a function as it is."""
        return function

    HAS_NUMBA = False


#: What a question is: of a class or a list, of a number, open over phones.
FIXED, ORDERED, SUBSET = 0, 1, 2
LEFT, RIGHT, UNSEEN = 0, 1, 2
#: Gains that differ by less than this part of a node's error are the same gain.
SAME = 1e-9


@compiled
def surplus(counts, sums, count, total):  # type: ignore[no-untyped-def]  # numba infers the types
    """What the cross-validated error of a node is above its plain squared error.

    Parameters
    ----------
    counts, sums
        `(folds,)`: examples of each fold, and their targets added up.
    count, total
        The same of all.

    Returns
    -------
    float
        Infinite where all examples are in one fold: then nothing is left to train on.
    """
    mean = total / count
    added = 0.0
    for fold in range(len(counts)):
        rest = count - counts[fold]
        if rest < 0.5:
            return np.inf
        off = sums[fold] - counts[fold] * mean
        added += off * off * (count + rest) / (rest * rest)
    return added


@compiled
def _grow_into(  # type: ignore[no-untyped-def]  # numba infers the types
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
    """Grow a tree into arrays that have room for it; gives how many nodes it has."""
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
        same = SAME * error
        best, best_question = least_gain * (error + over) / count, -1
        last, kept = -1, 0
        is_leaf = end - start <= smallest or not over < np.inf or error <= SAME * errors[0]
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


@compiled
def weakest_first(nodes, children, counts, errors):  # type: ignore[no-untyped-def]
    """The strength of every cut, as `strengths_of` gives it: the weakest branch goes first."""
    parents = np.full(nodes, -1, np.int64)
    standing = np.zeros(nodes, np.bool_)
    # Of each branch: the errors of its leaves, and the variances of its cuts.
    below, price = np.empty(nodes), np.zeros(nodes)
    for node in range(nodes):
        below[node] = errors[node]
        if children[node, 0] >= 0:
            parents[children[node, 0]] = node
            parents[children[node, 1]] = node
            standing[node] = True
            below[node], price[node] = 0.0, errors[node] / counts[node]
    for node in range(nodes - 1, 0, -1):
        below[parents[node]] += below[node]
        price[parents[node]] += price[node]
    strengths = np.full(nodes, -np.inf)
    waiting = np.empty(nodes, np.int64)
    reached = -np.inf
    while standing[0]:
        weakest, least = -1, np.inf
        for node in range(nodes):
            if standing[node]:
                strength = (errors[node] - below[node]) / price[node]
                if weakest < 0 or strength < least:
                    weakest, least = node, strength
        reached = max(reached, least)
        waiting[0], left = weakest, 1
        while left > 0:
            left -= 1
            node = waiting[left]
            if standing[node]:
                standing[node], strengths[node] = False, reached
                waiting[left], waiting[left + 1] = children[node, 0], children[node, 1]
                left += 2
        more, less, node = errors[weakest] - below[weakest], price[weakest], weakest
        while node >= 0:
            below[node] += more
            price[node] -= less
            node = parents[node]
    return strengths


@compiled
def _judge(  # type: ignore[no-untyped-def]  # numba infers the types
    levels,
    targets,
    examples,
    of_attribute,
    questions,
    sides,
    children,
    counts,
    means,
    strong,
    strengths,
    errors,
    squares,
):
    """Add to the errors at each strength, and to their squares, those of some examples."""
    for example in examples:
        node, place = 0, len(strengths) - 1
        while place >= 0:
            off = means[node] - targets[example]
            # Of all trees whose strength is above the node's, the example ends here.
            while place >= 0 and not strong[node] >= strengths[place]:
                errors[place] += off * off
                squares[place] += off**4
                place -= 1
            if place >= 0:
                side = sides[node, levels[of_attribute[questions[node]], example]]
                if side == UNSEEN:
                    side = 0 if counts[children[node, 0]] >= counts[children[node, 1]] else 1
                node = int(children[node, side])


@compiled
def grow_and_prune(  # type: ignore[no-untyped-def]
    levels,
    targets,
    folds,
    chosen,
    out,
    of_attribute,
    kinds,
    members,
    sizes,
    fold_count,
    smallest,
    least_gain,
    by_node,
    strength,
    strengths,
    errors,
    squares,
    questions,
    sides,
    children,
    counts,
    means,
    plain,
    validated,
    gains,
):
    """Grow a tree of some examples, let others judge it, and prune it.

    Parameters
    ----------
    levels, targets, folds
        The examples, as `grow` takes them; their targets are about 0.
    chosen, out
        Which the tree is grown from, and which were held out and judge it.
    of_attribute, kinds, members, sizes
        `Asked`.
    fold_count, smallest, least_gain, by_node
        As `grow` takes them.
    strength
        What cuts must have to stay.
    strengths, errors, squares
        `(strengths,)` each: what ``out`` says of each strength is added to the last two.
    questions, sides, children, counts, means, plain, validated, gains
        The arrays of `Grown`, with room for two nodes an example.

    Returns
    -------
    int
        How many nodes the pruned tree has.
    """
    nodes = _grow_into(
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
        plain,
        validated,
        gains,
    )
    strong = weakest_first(nodes, children, counts, validated)
    if len(out) > 0:
        _judge(
            levels,
            targets,
            out,
            of_attribute,
            questions,
            sides,
            children,
            counts,
            means,
            strong,
            strengths,
            errors,
            squares,
        )
    kept, numbers = np.zeros(nodes, np.bool_), np.zeros(nodes, np.int64)
    kept[0] = True
    count = 0
    for node in range(nodes):
        if kept[node]:
            numbers[node] = count
            count += 1
            if questions[node] >= 0 and strong[node] >= strength:
                kept[children[node, 0]] = True
                kept[children[node, 1]] = True
            else:
                questions[node], gains[node] = -1, 0.0
                children[node, 0], children[node, 1] = -1, -1
    # Children come after their parents, so that nothing is written over before it is moved.
    for node in range(nodes):
        if kept[node]:
            row = numbers[node]
            for side in range(2):
                child = children[node, side]
                children[row, side] = numbers[child] if child >= 0 else -1
            for level in range(sides.shape[1]):
                sides[row, level] = sides[node, level]
            questions[row], counts[row], means[row] = questions[node], counts[node], means[node]
            plain[row], validated[row], gains[row] = plain[node], validated[node], gains[node]
    return count
