"""CART as the papers have it, in numpy and without haste: what the compiled kernel is held to."""

import math

import numpy as np

from mocap_fit.control.cart.arrays import Nodes, Sample, allocate_nodes
from mocap_fit.control.cart.kernel import (
    FIXED,
    LEFT,
    RIGHT,
    ROUNDING,
    SAME,
    SHRINKAGE,
    SUBSET,
    UNSEEN,
)


def refitted_error(targets, folds):
    """Eq. 9 as it reads: a predictor for each fold, trained on the others."""
    error = 0.0
    for fold in np.unique(folds):
        if (folds == fold).all():
            return math.inf
        mean = targets[folds != fold].mean()
        error += ((targets[folds == fold] - mean) ** 2).sum()
    return error


def refitted_gain(targets, folds, is_left):
    """Eq. 10; minus infinity where a side cannot be cross-validated."""
    sides = [refitted_error(targets[side], folds[side]) for side in (is_left, ~is_left)]
    return -math.inf if math.inf in sides else refitted_error(targets, folds) - sum(sides)


def surpluses(counts, sums):
    """The closed form over the last axis, the folds."""
    count = counts.sum(axis=-1, keepdims=True)
    mean = sums.sum(axis=-1, keepdims=True) / np.maximum(count, 1.0)
    rest = count - counts
    off = sums - counts * mean
    added = (off * off * (count + rest) / np.maximum(rest, 1.0) ** 2).sum(axis=-1)
    return np.where((rest < 0.5).any(axis=-1), np.inf, added)


def without(sample, fold):
    """The examples that are not in a fold."""
    rest = sample.folds != fold
    return Sample(
        np.ascontiguousarray(sample.levels[:, rest]), sample.targets[rest], sample.folds[rest]
    )


def grow_plainly(sample, table, rules):
    """A node at a time, all cuts of an attribute at once."""
    levels, targets, folds = sample
    tree = allocate_nodes(len(targets), int(table.sizes.max()))
    waiting, depths = [np.arange(len(targets))], [0]
    order = {}
    for node, examples in enumerate(waiting):
        count = float(len(examples))
        mean = float(targets[examples].sum() / count)
        values = targets[examples] - mean
        fold = folds[examples]
        of_n = np.bincount(fold, minlength=rules.cv).astype(np.float64)
        of_s = np.bincount(fold, values, rules.cv).astype(np.float64)
        error, over = float(values @ values), float(surpluses(of_n, of_s))
        tree.counts[node], tree.means[node] = len(examples), mean
        tree.errors[node], tree.validated[node] = error, error + over
        tree.questions[node], tree.children[node], tree.gains[node] = -1, -1, 0.0
        tree.sides[node] = UNSEEN
        equal = max(SAME * tree.errors[0], ROUNDING * count * mean * mean)
        if len(examples) < rules.min_samples_split or depths[node] >= rules.max_depth:
            continue
        if not over < np.inf or error <= equal:
            continue
        same = SAME * error
        best, best_question = rules.min_impurity_decrease * (error + over) / count, -1
        side = np.full(0, UNSEEN, dtype=np.uint8)
        for question, attribute in enumerate(table.attributes):
            size, kind = int(table.sizes[attribute]), table.kinds[question]
            cell = levels[attribute, examples].astype(np.int64) * rules.cv + fold
            shape = (size, rules.cv)
            n = np.bincount(cell, minlength=size * rules.cv).reshape(shape).astype(np.float64)
            s = np.bincount(cell, values, size * rules.cv).reshape(shape)
            has = n.sum(axis=1) > 0
            places = np.flatnonzero(has)
            if kind == FIXED:
                yes = has & (table.members[question, :size] > 0)
                if not yes.any() or yes.sum() == has.sum():
                    continue
                cuts = np.stack([n[yes].sum(axis=0), s[yes].sum(axis=0)])[:, None]
            else:
                if kind == SUBSET and (rules.by_node or node == 0):
                    drawn = 0.0 if rules.by_node else SHRINKAGE
                    keys = s[places].sum(axis=1) / (n[places].sum(axis=1) + drawn)
                    places = places[np.argsort(keys, kind="stable")]
                    if node == 0:
                        order[int(attribute)] = places
                elif kind == SUBSET:
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
            small = np.minimum(cuts[0].sum(axis=1), rest_n.sum(axis=1)) < rules.min_samples_leaf
            gain = np.where(small, -np.inf, gain)
            # The first of those that are the same.
            cut = int(np.argmax(gain >= gain.max() - same))
            if gain[cut] > best + same:
                best, best_question = float(gain[cut]), question
                side = np.full(size, UNSEEN, dtype=np.uint8)
                if kind == FIXED:
                    side[places] = np.where(table.members[question, places] > 0, LEFT, RIGHT)
                else:
                    side[places] = np.where(np.arange(len(places)) <= cut, LEFT, RIGHT)
        if best_question >= 0:
            tree.questions[node], tree.gains[node] = best_question, best
            tree.sides[node, : len(side)] = side
            is_left = side[levels[table.attributes[best_question], examples]] == LEFT
            tree.children[node] = len(waiting), len(waiting) + 1
            waiting += [examples[is_left], examples[~is_left]]
            depths += [depths[node] + 1] * 2
    return Nodes(*(array[: len(waiting)] for array in tree))


def standing_branch(tree, node, standing):
    """A node and all that is below it, down to the cuts that are gone."""
    found = [node]
    for each in found:
        if each in standing:
            found += tree.children[each].tolist()
    return found


def weakest_links(tree):
    """Breiman et al. section 3.3 as it reads: the weakest branch is cut off, again and again.

    A branch is worth what it lowers the cross-validated error by, for each variance of its cuts.
    """

    def strength(node, standing):
        branch = standing_branch(tree, node, standing)
        price = sum(tree.validated[each] / tree.counts[each] for each in branch if each in standing)
        leaves = sum(tree.validated[each] for each in branch if each not in standing)
        return (tree.validated[node] - leaves) / price

    standing = set(np.flatnonzero(tree.questions >= 0).tolist())
    alphas, reached = np.full(len(tree.questions), -np.inf), -np.inf
    while standing:
        worth = {node: strength(node, standing) for node in sorted(standing)}
        weakest = min(worth, key=worth.get)
        reached = max(reached, worth[weakest])
        gone = standing.intersection(standing_branch(tree, weakest, standing))
        alphas[list(gone)] = reached
        standing -= gone
    return alphas


def prune_plainly(tree, alphas, alpha):
    """The tree whose cuts are as strong as alpha at least."""
    stays = (tree.questions >= 0) & (alphas >= alpha)
    left = np.zeros(len(stays), dtype=np.bool_)
    left[0] = True
    # No cut is stronger than one above it: what stays hangs together.
    left[tree.children[stays]] = True
    numbers = np.cumsum(left) - 1
    changed = tree._replace(
        questions=np.where(stays, tree.questions, -1),
        children=np.where(stays[:, None], numbers[tree.children], -1),
        gains=np.where(stays, tree.gains, 0.0),
    )
    return Nodes(*(array[left] for array in changed))


def predict_plainly(tree, sample, table):
    """What a tree says of examples; who has a level that a node never saw goes with the most."""
    result = []
    for example in range(len(sample.targets)):
        node = 0
        while tree.questions[node] >= 0:
            attribute = table.attributes[tree.questions[node]]
            side = tree.sides[node, sample.levels[attribute, example]]
            if side == UNSEEN:
                counts = tree.counts[tree.children[node]]
                side = int(counts[1] > counts[0])
            node = tree.children[node, side]
        result.append(tree.means[node])
    return np.array(result)


def held_out_errors(sample, fold, table, rules, alphas):
    """Squared errors of a fold's examples, `(alphas, examples)`, by trees grown without them."""
    tree = grow_plainly(without(sample, fold), table, rules)
    strong = weakest_links(tree)
    is_out = sample.folds == fold
    out = Sample(sample.levels[:, is_out], sample.targets[is_out], sample.folds[is_out])
    return np.array(
        [
            (predict_plainly(prune_plainly(tree, strong, alpha), out, table) - out.targets) ** 2
            for alpha in alphas
        ]
    )
