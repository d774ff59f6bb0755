"""Growing and pruning of trees: against ten refits, brute force and scikit-learn."""

import itertools
import sys
from importlib.util import module_from_spec, spec_from_file_location

import numpy as np
import pytest
from cart_cases import examples, question_table
from cart_oracle import (
    grow_plainly,
    held_out_errors,
    prune_plainly,
    refitted_error,
    refitted_gain,
    surpluses,
    weakest_links,
)
from hypothesis import given, settings
from hypothesis import strategies as st

from mocap_fit.control.cart import kernel
from mocap_fit.control.cart.arrays import QuestionTable, Rules, Sample
from mocap_fit.control.cart.growing import ALPHAS, PruningCurve, grow, judge
from mocap_fit.control.cart.kernel import LEFT, ORDERED, UNSEEN, compute_alphas, compute_surplus

TABLE = question_table()


def strengths(tree):
    return compute_alphas(len(tree.questions), tree.children, tree.counts, tree.validated)


def assert_same(first, second, tolerance=1e-9):
    for name, one, other in zip(first._fields, first, second, strict=True):
        np.testing.assert_allclose(one, other, rtol=tolerance, atol=tolerance, err_msg=name)


def structured(count=400, seed=1):
    """Two questions that matter, and noise."""
    sample = examples(count, seed)
    rise = 1.5 * (sample.levels[0] < 4) + 0.8 * (sample.levels[2] > 4)
    return sample._replace(targets=sample.targets + rise)


# -- gains -----------------------------------------------------------------------------------------


@settings(deadline=None, max_examples=60)
@given(seed=st.integers(0, 10**6), count=st.integers(12, 200), far=st.floats(-1e3, 1e3))
def test_errors_in_closed_form_are_those_of_ten_refits(seed, count, far):
    rng = np.random.default_rng(seed)
    targets = far + rng.normal(0, 1, count)
    folds = rng.permutation(np.arange(count) % 10)
    tree = grow(Sample(np.zeros((3, count), np.uint8), targets, folds), TABLE, Rules(10))
    assert tree.validated[0] == pytest.approx(refitted_error(targets, folds), rel=1e-10)
    assert tree.errors[0] == pytest.approx(((targets - targets.mean()) ** 2).sum(), rel=1e-9)


def test_the_surplus_is_never_negative_and_infinite_for_one_fold():
    rng = np.random.default_rng(4)
    counts = rng.integers(0, 5, (50, 10)).astype(float)
    sums = rng.normal(0, 1, (50, 10)) * (counts > 0)
    many = surpluses(counts, sums)
    one = [
        compute_surplus(np.concatenate([n, s]), n.sum(), s.sum())
        for n, s in zip(counts, sums, strict=True)
    ]
    np.testing.assert_allclose(many, one, rtol=1e-12)
    assert (many >= 0).all()
    assert compute_surplus(np.array([3.0, 0.0, 1.0, 0.0]), 3.0, 1.0) == np.inf
    # Two examples in two folds, each predicted from the other: 2 * 2² instead of 2 * 1².
    assert compute_surplus(np.array([1.0, 1.0, -1.0, 1.0]), 2.0, 0.0) == 6.0


def every_gain(sample):
    """The gain of every cut that the questions allow, phones in the order of their means."""
    levels, targets, folds = sample
    yield refitted_gain(targets, folds, levels[0] < 4)
    for attribute in range(3):
        present = np.unique(levels[attribute])
        if attribute < 2:
            means = [targets[levels[attribute] == level].mean() for level in present]
            present = present[np.argsort(means, kind="stable")]
        for cut in range(1, len(present)):
            yield refitted_gain(targets, folds, np.isin(levels[attribute], present[:cut]))


def test_the_gains_of_a_grown_tree_are_those_of_ten_refits_and_the_best_of_all_cuts():
    sample = examples(200, seed=3)
    levels, folds = sample.levels, sample.folds
    targets = sample.targets + 1.5 * (levels[0] < 5) + 0.7 * (levels[2] > 3)
    tree = grow(sample._replace(targets=targets), TABLE, Rules(10, 11, by_node=True))
    rows = {0: np.arange(200)}
    assert (tree.questions >= 0).sum() > 3
    for node in np.flatnonzero(tree.questions >= 0):
        own = rows[node]
        attribute = TABLE.attributes[tree.questions[node]]
        left = tree.sides[node, levels[attribute, own]] == LEFT
        rows[tree.children[node, 0]], rows[tree.children[node, 1]] = own[left], own[~left]
        gain = refitted_gain(targets[own], folds[own], left)
        assert tree.gains[node] == pytest.approx(gain, abs=1e-10 * len(own))
        best = max(every_gain(Sample(levels[:, own], targets[own], folds[own])))
        assert gain == pytest.approx(best, abs=1e-8 * len(own))
        assert tree.means[node] == pytest.approx(targets[own].mean())
        assert tree.counts[node] == len(own)


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


# -- trees -----------------------------------------------------------------------------------------


@settings(deadline=None, max_examples=40)
@given(
    seed=st.integers(0, 10**6),
    count=st.integers(1, 150),
    rules=st.builds(
        Rules,
        st.sampled_from([4, 10]),
        st.sampled_from([2, 6]),
        st.sampled_from([1, 8]),
        st.sampled_from([2, 100]),
        st.sampled_from([0.0, 2.0]),
        st.booleans(),
    ),
)
def test_the_kernel_grows_the_trees_of_the_plain_way(seed, count, rules):
    sample = examples(count, seed, folds=rules.cv)
    targets = sample.targets + (sample.levels[0] < 4) - 0.5 * (sample.levels[2] > 2)
    sample = sample._replace(targets=targets)
    assert_same(grow(sample, TABLE, rules), grow_plainly(sample, TABLE, rules))


def test_without_numba_the_same_functions_run_as_python(monkeypatch):
    monkeypatch.setitem(sys.modules, "numba", None)
    spec = spec_from_file_location("plain_kernel", kernel.__file__)
    plain = module_from_spec(spec)
    spec.loader.exec_module(plain)
    assert not hasattr(plain.grow_and_prune, "py_func")
    sample, rules = structured(90), Rules(10)
    monkeypatch.setattr("mocap_fit.control.cart.growing.grow_and_prune", plain.grow_and_prune)
    slow = grow(sample, TABLE, rules, 2.0), judge(sample, 1, TABLE, rules, ALPHAS)
    monkeypatch.undo()
    fast = grow(sample, TABLE, rules, 2.0), judge(sample, 1, TABLE, rules, ALPHAS)
    assert_same(slow[0], fast[0], 0)
    np.testing.assert_array_equal(slow[1].errors, fast[1].errors)


@pytest.mark.parametrize("by_node", [False, True])
def test_a_known_tree_is_recovered(by_node):
    """A class, below it a group of another phone, below that a number."""
    sample = examples(1500, seed=8)
    levels = sample.levels
    group, high = np.isin(levels[1], [1, 5, 7]), levels[2] >= 5
    truth = np.where(levels[0] < 4, 2.0, np.where(group, 0.0, np.where(high, -1.5, -0.8)))
    sample = sample._replace(targets=truth + 0.3 * sample.targets)
    tree = grow(sample, TABLE, Rules(10, by_node=by_node), 20.0)
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


@pytest.mark.parametrize("depth", [1, 2])
def test_numbers_are_cut_as_scikit_learn_cuts_them(depth):
    """Targets in steps: the cut that lowers the plain error most lowers the validated one most."""
    from sklearn.tree import DecisionTreeRegressor

    rng = np.random.default_rng(depth)
    levels = rng.integers(0, 8, (2, 2000)).astype(np.uint8)
    targets = 3.0 * (levels[0] > 2) + 1.0 * (levels[1] > 4) + 0.4 * (levels[0] > 5)
    targets += rng.normal(0, 0.01, 2000)
    ordered = np.full(2, ORDERED)
    table = QuestionTable(np.arange(2), ordered, np.zeros((2, 10), np.uint8), np.full(2, 10))
    sample = Sample(levels, targets, rng.permutation(np.arange(2000) % 10))
    ours = grow(sample, table, Rules(10, min_samples_leaf=20, max_depth=depth))
    theirs = DecisionTreeRegressor(max_depth=depth, min_samples_leaf=20).fit(levels.T, targets)
    assert len(ours.questions) == theirs.tree_.node_count == 2 ** (depth + 1) - 1
    ours_at, theirs_at = [0], [0]
    for node, other in zip(ours_at, theirs_at, strict=True):
        assert ours.counts[node] == theirs.tree_.n_node_samples[other]
        assert ours.means[node] == pytest.approx(theirs.tree_.value[other, 0, 0])
        if ours.questions[node] >= 0:
            assert ours.questions[node] == theirs.tree_.feature[other]
            bound = np.flatnonzero(ours.sides[node, :8] == LEFT).max()
            assert bound == int(theirs.tree_.threshold[other])
            ours_at += ours.children[node].tolist()
            theirs_at += [theirs.tree_.children_left[other], theirs.tree_.children_right[other]]
        else:
            assert theirs.tree_.children_left[other] == -1


def test_a_node_with_fewer_examples_than_a_split_needs_is_a_leaf():
    levels = np.array([[0, 0, 0, 5, 5, 5], [0] * 6, [0] * 6], dtype=np.uint8)
    sample = Sample(levels, np.array([0.0, 0.0, 0.1, 5.0, 5.0, 5.1]), np.arange(6))
    for min_samples_split, nodes in ((7, 1), (6, 3)):
        assert len(grow(sample, TABLE, Rules(10, min_samples_split)).questions) == nodes
    for min_samples_leaf, nodes in ((4, 1), (3, 3)):
        assert len(grow(sample, TABLE, Rules(10, 2, min_samples_leaf)).questions) == nodes
    for max_depth, nodes in ((0, 1), (1, 3)):
        assert len(grow(sample, TABLE, Rules(10, 2, 1, max_depth)).questions) == nodes


def test_a_cut_gains_more_than_the_least_decrease():
    levels = np.array([[0, 0, 0, 5, 5, 5], [0] * 6, [0] * 6], dtype=np.uint8)
    sample = Sample(levels, np.array([0.0, 0.0, 0.1, 5.0, 5.0, 5.1]), np.arange(6))
    tree = grow(sample, TABLE, Rules(10))
    decrease = tree.gains[0] / (tree.validated[0] / 6)
    for factor, nodes in ((0.999, 3), (1.001, 1)):
        rules = Rules(10, min_impurity_decrease=factor * decrease)
        assert len(grow(sample, TABLE, rules).questions) == nodes


@pytest.mark.parametrize(("count", "value"), [(1, 0.3), (2, 0.1), (50, 0.1), (50, 1 / 3e5)])
def test_one_example_and_equal_targets_are_a_leaf(count, value):
    sample = examples(count)._replace(targets=np.full(count, value))
    tree = grow(sample, TABLE, Rules(10, 2))
    assert tree.questions.tolist() == [-1]
    assert tree.means[0] == pytest.approx(value, rel=1e-15)
    assert tree.counts[0] == count


def test_a_cut_that_leaves_one_example_alone_is_not_made():
    """Nothing would be left to predict it from."""
    levels = np.zeros((3, 40), dtype=np.uint8)
    levels[0, 0] = 5
    targets = np.random.default_rng(0).normal(0, 0.1, 40)
    targets[0] = 100.0
    tree = grow(Sample(levels, targets, np.arange(40) % 10), TABLE, Rules(10, 2))
    assert tree.questions.tolist() == [-1]


def test_levels_that_a_node_has_no_example_of_are_marked():
    sample = examples(300, seed=2, phone_levels=9)
    targets = sample.targets + 3.0 * (sample.levels[0] < 5)
    tree = grow(sample._replace(targets=targets), TABLE, Rules(10, 101))
    assert tree.questions[0] >= 0
    assert (tree.sides[0, 9:12] == UNSEEN).all()
    assert (tree.sides[0, :9] != UNSEEN).all()


def test_rare_phones_are_ordered_nearer_to_the_mean_of_all():
    """Two examples of 2 come before thirty of 1: the order is by sum / (count + 3).

    That is 4 / 5 and 30 / 33; in the order of the node it is 2 and 1.
    """
    levels = np.zeros((3, 62), dtype=np.uint8)
    levels[1] = [0] * 30 + [1] * 2 + [2] * 30
    noise = 1e-6 * np.random.default_rng(0).normal(0, 1, 62)
    targets = np.array([-34 / 30] * 30 + [2.0] * 2 + [1.0] * 30) + noise
    sample = Sample(levels, targets, np.arange(62) % 10)
    for by_node, sides in ((False, [0, 1]), (True, [1, 0])):
        tree = grow(sample, TABLE, Rules(10, 2, by_node=by_node))
        assert tree.sides[0, :3].tolist() == [0, 1, 1]
        assert tree.sides[tree.children[0, 1], 1:3].tolist() == sides


# -- pruning ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(6))
def test_the_strengths_of_cuts_are_those_of_weakest_link_pruning(seed):
    tree = grow(structured(250, seed), TABLE, Rules(10))
    assert (tree.questions >= 0).sum() > 8
    np.testing.assert_allclose(strengths(tree), weakest_links(tree), rtol=1e-9)


def test_pruning_gives_a_sequence_of_trees_each_within_the_one_before():
    sample = structured()
    tree = grow(sample, TABLE, Rules(10))
    strong = strengths(tree)
    for node in np.flatnonzero(tree.questions >= 0):
        assert (strong[tree.children[node]] <= strong[node]).all()
    sizes = []
    for alpha in [-np.inf, *ALPHAS, *strong[tree.questions >= 0], 1e6]:
        smaller = grow(sample, TABLE, Rules(10), alpha)
        assert_same(smaller, prune_plainly(tree, strong, alpha), 0)
        sizes.append(len(smaller.questions))
    assert sizes[0] == len(tree.questions)
    assert sizes[1 : 1 + len(ALPHAS)] == sorted(sizes[1 : 1 + len(ALPHAS)], reverse=True)
    assert sizes[-1] == 1


def test_a_cut_is_as_strong_as_what_it_gains_in_variances_of_its_node():
    """Of a tree with one cut, by hand."""
    tree = grow(structured(), TABLE, Rules(10, max_depth=1))
    assert len(tree.questions) == 3
    variance = tree.validated[0] / tree.counts[0]
    assert strengths(tree)[0] == pytest.approx(tree.gains[0] / variance)


def test_the_alphas_that_are_tried_are_none_and_one_to_a_hundred():
    assert ALPHAS[0] == 0
    assert ALPHAS[1] == 1
    assert ALPHAS[-1] == pytest.approx(100)
    np.testing.assert_allclose(ALPHAS[2:] / ALPHAS[1:-1], 100 ** (1 / 26))


@pytest.mark.parametrize("seed", range(4))
def test_held_out_errors_are_those_of_the_pruned_trees(seed):
    sample = structured(200, seed)
    # Levels that the tree has never seen.
    sample.levels[0, sample.folds == 2] = (sample.levels[0, sample.folds == 2] + 5) % 12
    sample.levels[0, (sample.folds != 2) & (sample.levels[0] == 7)] = 6
    alphas = np.array([0.0, 3.0, 8.0, 1e6])
    squares = held_out_errors(sample, 2, TABLE, Rules(10), alphas)
    judged = judge(sample, 2, TABLE, Rules(10), alphas)
    assert judged.count == 20
    np.testing.assert_allclose(judged.errors, squares.sum(axis=1), rtol=1e-9)
    np.testing.assert_allclose(judged.squares, (squares**2).sum(axis=1), rtol=1e-9)


def test_the_alpha_of_the_least_error_is_selected_the_greatest_of_several():
    alphas = np.array([0.0, 1.0, 2.0, 4.0])
    curve = PruningCurve(alphas, np.array([5.0, 4.0, 4.2, 9.0]), np.full(4, 9.0), 10)
    assert curve.select_alpha() == 1.0
    assert curve.standard_errors[1] == pytest.approx(np.sqrt((0.9 - 0.16) / 10))
    assert curve.select_alpha(one_standard_error=True) == 2.0
    flat = PruningCurve(alphas, np.array([5.0, 4.0, 4.0, 9.0]), np.full(4, 9.0), 10)
    assert flat.select_alpha() == 2.0
    # 0.4 + 0.272 is the limit.
    for error, expected in ((6.71, 4.0), (6.73, 2.0)):
        curve = PruningCurve(alphas, np.array([5.0, 4.0, 4.2, error]), np.full(4, 9.0), 10)
        assert curve.select_alpha(one_standard_error=True) == expected
    nothing = PruningCurve(alphas, np.zeros(4), np.zeros(4), 0)
    assert nothing.select_alpha() == 4.0
    assert (nothing.standard_errors == 0).all()


def test_standard_errors_are_those_of_a_mean():
    rng = np.random.default_rng(0)
    squares = rng.normal(0, 1, (3, 200)) ** 2
    curve = PruningCurve(np.arange(3.0), squares.sum(1), (squares**2).sum(1), 200)
    np.testing.assert_allclose(curve.standard_errors, squares.std(axis=1) / np.sqrt(200))


@pytest.mark.parametrize("scale", [1e-6, 1e6])
def test_the_unit_of_the_targets_does_not_matter(scale):
    """Least errors are shares of the tree's own, and of the rounding of its mean."""
    sample = structured()
    one = grow(sample, TABLE, Rules(10))
    other = grow(sample._replace(targets=scale * sample.targets), TABLE, Rules(10))
    for name in ("questions", "children", "counts", "sides"):
        np.testing.assert_array_equal(getattr(other, name), getattr(one, name), err_msg=name)
    np.testing.assert_allclose(other.means, scale * one.means, rtol=1e-9)
    np.testing.assert_allclose(other.errors, scale**2 * one.errors, rtol=1e-6)
    np.testing.assert_allclose(other.gains, scale**2 * one.gains, rtol=1e-6)
    np.testing.assert_allclose(strengths(other), strengths(one), rtol=1e-6)
