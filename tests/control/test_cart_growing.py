"""Growing and pruning of trees: gains, the trees that come of known ones, two ways that agree."""

import itertools
import math

import numpy as np
import pytest
from cart_cases import asked, examples
from hypothesis import given, settings
from hypothesis import strategies as st

from mocap_fit.control.cart.gains import (
    cross_validated_error,
    cross_validated_gain,
    surpluses,
)
from mocap_fit.control.cart.growing import grow
from mocap_fit.control.cart.kernel import LEFT, UNSEEN, surplus
from mocap_fit.control.cart.pruning import STRENGTHS, Judged, judge, pruned, strengths_of


def refitted_error(targets, folds):
    """Eq. 9 as it reads: a predictor for each fold, trained on the others."""
    error = 0.0
    for fold in np.unique(folds):
        mean = targets[folds != fold].mean()
        error += ((targets[folds == fold] - mean) ** 2).sum()
    return error


@settings(deadline=None, max_examples=60)
@given(seed=st.integers(0, 10**6), count=st.integers(12, 200), far=st.floats(-1e3, 1e3))
def test_gains_in_closed_form_are_those_of_ten_refits(seed, count, far):
    rng = np.random.default_rng(seed)
    targets = far + rng.normal(0, 1, count)
    folds = rng.permutation(np.arange(count) % 10)
    left = rng.random(count) < 0.5
    sides = [refitted_error(targets[side], folds[side]) for side in (left, ~left) if side.any()]
    error = cross_validated_error(targets, folds)
    assert error == pytest.approx(refitted_error(targets, folds), rel=1e-10)
    gain = cross_validated_gain(targets, folds, left)
    impossible = [len(np.unique(folds[side])) < 2 for side in (left, ~left)]
    if any(impossible):
        assert gain == -math.inf
    else:
        expected = refitted_error(targets, folds) - sum(sides)
        assert gain == pytest.approx(expected, abs=1e-10 * error)


def test_the_gains_of_a_grown_tree_are_those_of_ten_refits_and_the_best_of_all_cuts():
    levels, targets, folds = examples(200, seed=3)
    targets = targets + 1.5 * (levels[0] < 5) + 0.7 * (levels[2] > 3)
    tree = grow(levels, targets, folds, asked(), fold_count=10, smallest=10, phone_order="node")
    rows = {0: np.arange(200)}
    assert (tree.questions >= 0).sum() > 3
    for node in np.flatnonzero(tree.questions >= 0):
        own = rows[node]
        attribute = asked().attributes[tree.questions[node]]
        left = tree.sides[node, levels[attribute, own]] == LEFT
        rows[tree.children[node, 0]], rows[tree.children[node, 1]] = own[left], own[~left]
        gain = refitted_error(targets[own], folds[own]) - sum(
            refitted_error(targets[side], folds[side]) for side in (own[left], own[~left])
        )
        assert tree.gains[node] == pytest.approx(gain, abs=1e-10 * len(own))
        best = max(every_gain(levels[:, own], targets[own], folds[own]))
        assert gain == pytest.approx(best, abs=1e-8 * len(own))
        assert tree.means[node] == pytest.approx(targets[own].mean())


def every_gain(levels, targets, folds):
    yield cross_validated_gain(targets, folds, levels[0] < 4)
    for attribute in range(3):
        present = np.unique(levels[attribute])
        if attribute < 2:
            means = [targets[levels[attribute] == level].mean() for level in present]
            present = present[np.argsort(means, kind="stable")]
        for cut in range(1, len(present)):
            yield cross_validated_gain(targets, folds, np.isin(levels[attribute], present[:cut]))


def test_phones_in_the_order_of_their_means_hold_the_best_of_all_groups():
    """For squared error no other of the 2^n groups is better (Breiman et al., theorem 4.5)."""
    levels, targets, _ = examples(60, seed=5, phone_levels=6)
    own, present = levels[0], np.unique(levels[0])
    order = sorted(present, key=lambda level: targets[own == level].mean())

    def error(group):
        left = np.isin(own, group)
        return sum(((targets[s] - targets[s].mean()) ** 2).sum() for s in (left, ~left))

    groups = itertools.chain.from_iterable(
        itertools.combinations(present, size) for size in range(1, len(present))
    )
    assert min(map(error, groups)) == pytest.approx(
        min(error(order[:cut]) for cut in range(1, len(order)))
    )


@settings(deadline=None, max_examples=25)
@given(
    seed=st.integers(0, 10**6),
    count=st.integers(1, 150),
    order=st.sampled_from(["tree", "node"]),
    least_gain=st.sampled_from([0.0, 2.0]),
    held_out=st.sampled_from([-1, 3]),
)
def test_the_compiled_way_and_the_numpy_way_give_one_tree(seed, count, order, least_gain, held_out):
    levels, targets, folds = examples(count, seed)
    if count < 12:
        held_out = -1
    targets = targets + (levels[0] < 4) - 0.5 * (levels[2] > 2)
    trees = [
        grow(
            levels,
            targets,
            folds,
            asked(),
            fold_count=10,
            smallest=5,
            least_gain=least_gain,
            phone_order=order,
            held_out=held_out,
            use_numba=use_numba,
        )
        for use_numba in (True, False)
    ]
    for first, second in zip(*trees, strict=True):
        np.testing.assert_allclose(first, second, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("order", ["tree", "node"])
def test_a_known_tree_is_recovered(order):
    """A class, below it a group of another phone, below that a number."""
    levels, noise, folds = examples(1500, seed=8)
    group, high = np.isin(levels[1], [1, 5, 7]), levels[2] >= 5
    truth = np.where(levels[0] < 4, 2.0, np.where(group, 0.0, np.where(high, -1.5, -0.8)))
    tree = grow(
        levels,
        truth + 0.3 * noise,
        folds,
        asked(),
        fold_count=10,
        smallest=5,
        phone_order=order,
    )
    tree = pruned(tree, 20.0)
    assert (tree.questions >= 0).sum() == 3
    # Of two questions that divide alike, the class comes first.
    assert tree.questions[0] == 0
    (rest,) = (c for c in tree.children[0] if tree.questions[c] >= 0)
    assert tree.questions[rest] == 2
    divided = tree.sides[rest, :12]
    assert {frozenset(np.flatnonzero(divided == side)) for side in (0, 1)} == {
        frozenset([1, 5, 7]),
        frozenset([0, 2, 3, 4, 6, 8, 9, 10, 11]),
    }
    (last,) = (c for c in tree.children[rest] if tree.questions[c] >= 0)
    assert tree.questions[last] == 3
    assert tree.sides[last, :8].tolist() == [0] * 5 + [1] * 3
    leaves = np.sort(tree.means[tree.questions < 0])
    np.testing.assert_allclose(leaves, [-1.5, -0.8, 0.0, 2.0], atol=0.05)


def test_a_node_of_n_min_examples_is_a_leaf_and_one_more_is_not():
    levels = np.array([[0, 0, 0, 5, 5, 5], [0] * 6, [0] * 6], dtype=np.uint8)
    targets = np.array([0.0, 0.0, 0.1, 5.0, 5.0, 5.1])
    folds = np.arange(6)
    for smallest, nodes in ((6, 1), (5, 3)):
        tree = grow(levels, targets, folds, asked(), fold_count=10, smallest=smallest)
        assert len(tree.questions) == nodes


@pytest.mark.parametrize("use_numba", [True, False])
def test_one_example_and_equal_targets_are_a_leaf(use_numba):
    for count, value in ((1, 0.3), (2, 0.1), (50, 0.1)):
        levels, _, folds = examples(count)
        targets = np.full(count, value)
        tree = grow(levels, targets, folds, asked(), fold_count=10, smallest=1, use_numba=use_numba)
        assert tree.questions.tolist() == [-1]
        assert tree.means[0] == pytest.approx(value, rel=1e-15)
        assert tree.counts[0] == count


def test_a_cut_that_leaves_one_example_alone_is_not_taken():
    """Nothing would be left to predict it from."""
    levels = np.zeros((3, 40), dtype=np.uint8)
    levels[0, 0] = 5
    targets = np.random.default_rng(0).normal(0, 0.1, 40)
    targets[0] = 100.0
    tree = grow(levels, targets, np.arange(40) % 10, asked(), fold_count=10, smallest=1)
    assert tree.questions.tolist() == [-1]


def test_levels_that_a_node_has_no_example_of_are_marked():
    levels, targets, folds = examples(300, seed=2, phone_levels=9)
    targets = targets + 3.0 * (levels[0] < 5)
    tree = grow(levels, targets, folds, asked(phone_levels=12), fold_count=10, smallest=100)
    assert tree.questions[0] >= 0
    assert (tree.sides[0, 9:12] == UNSEEN).all()
    assert (tree.sides[0, :9] != UNSEEN).all()


def test_surplus_is_never_negative_and_both_forms_agree():
    rng = np.random.default_rng(4)
    counts = rng.integers(0, 5, (50, 10)).astype(float)
    sums = rng.normal(0, 1, (50, 10)) * (counts > 0)
    many = surpluses(counts, sums)
    one = [surplus(n, s, n.sum(), s.sum()) for n, s in zip(counts, sums, strict=True)]
    np.testing.assert_allclose(many, one, rtol=1e-12)
    assert (many >= 0).all()
    assert surpluses(np.array([3.0, 0.0]), np.array([1.0, 0.0])) == np.inf


def grown(seed=1, count=400):
    levels, targets, folds = examples(count, seed)
    targets = targets + 1.5 * (levels[0] < 4) + 0.8 * (levels[2] > 4)
    options = {"fold_count": 10, "smallest": 5}
    return levels, targets, folds, grow(levels, targets, folds, asked(), **options)


def test_pruning_gives_a_sequence_of_trees_each_within_the_one_before():
    _, _, _, tree = grown()
    strong = strengths_of(tree)
    inner = np.flatnonzero(tree.questions >= 0)
    for node in inner:
        assert (strong[tree.children[node]] <= strong[node]).all()
    sizes = [len(pruned(tree, strength).questions) for strength in [*STRENGTHS, 1e6]]
    assert sizes == sorted(sizes, reverse=True)
    assert sizes[-1] == 1
    assert len(pruned(tree, -np.inf).questions) == len(tree.questions)


def test_the_strength_of_a_last_cut_is_its_gain_in_variances_of_its_node():
    _, _, _, tree = grown()
    last = [
        node
        for node in np.flatnonzero(tree.questions >= 0)
        if (tree.questions[tree.children[node]] < 0).all()
    ]
    variances = tree.validated / tree.counts
    weakest = min(last, key=lambda node: tree.gains[node] / variances[node])
    least = strengths_of(tree)[tree.questions >= 0].min()
    assert least <= tree.gains[weakest] / variances[weakest] * (1 + 1e-9)


@pytest.mark.parametrize("use_numba", [True, False])
def test_held_out_errors_are_those_of_the_pruned_trees(use_numba):
    levels, targets, folds, _ = grown()
    options = {"fold_count": 10, "smallest": 5, "least_gain": 0.0, "phone_order": "tree"}
    tree = grow(levels, targets, folds, asked(), held_out=2, **options)
    out = np.flatnonzero(folds == 2)
    strengths = np.array([0.0, 3.0, 8.0, 1e6])
    judged = judge(levels, targets, folds, 2, asked(), strengths, **options, use_numba=use_numba)
    assert judged.count == len(out)
    for place, strength in enumerate(strengths):
        smaller = pruned(tree, strength)
        off = []
        for example in out:
            node = 0
            while smaller.questions[node] >= 0:
                attribute = asked().attributes[smaller.questions[node]]
                side = smaller.sides[node, levels[attribute, example]]
                if side == UNSEEN:
                    counts = smaller.counts[smaller.children[node]]
                    side = int(counts[1] > counts[0])
                node = smaller.children[node, side]
            off.append(smaller.means[node] - targets[example])
        assert judged.errors[place] == pytest.approx(np.sum(np.square(off)))
        assert judged.squares[place] == pytest.approx(np.sum(np.power(off, 4)))


def test_one_standard_error_prunes_more():
    strengths = np.array([0.0, 1.0, 2.0, 4.0])
    judged = Judged(strengths, np.array([5.0, 4.0, 4.2, 9.0]), np.array([9.0, 9.0, 9.0, 9.0]), 10)
    assert judged.best() == 1.0
    assert judged.standard_errors[1] == pytest.approx(np.sqrt((0.9 - 0.16) / 10))
    assert judged.best(one_standard_error=True) == 2.0
    nothing = Judged(strengths, np.zeros(4), np.zeros(4), 0)
    assert nothing.best() == 4.0
