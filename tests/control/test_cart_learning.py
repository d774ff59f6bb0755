"""CART: from a corpus to trees, against the plain way of growing, validating and pruning."""

import itertools

import numpy as np
import pytest
from cart_cases import SWEDISH, corpus, neighbour, rounded_ahead
from cart_oracle import grow_plainly, held_out_errors, prune_plainly, weakest_links

from mocap_fit.control.cart.arrays import UNLIMITED, Rules
from mocap_fit.control.cart.examples import collect, find_resistant, make_alphabet, read_corpus
from mocap_fit.control.cart.growing import ALPHAS, grow
from mocap_fit.control.cart.learning import (
    MAX_BINS,
    MAX_JUDGED,
    MAX_POOLED,
    Grower,
    Growth,
    _spread,
    divide_into_bins,
    list_alternatives,
)
from mocap_fit.control.cart.model import Cart
from mocap_fit.control.cart.questions import list_standard_questions, order_questions
from mocap_fit.phones import load_phone_set


def grower(spoken, pruning="together", rules=None, seed=0):
    """What a model makes of a corpus before it grows trees."""
    model = Cart().fit(spoken)
    phones, targets = read_corpus(spoken)
    segments = collect(phones, targets, model._reader, True)
    growth = Growth(rules or Rules(10), pruning, False, seed)
    attributes = model._reader.attributes
    return Grower(segments, model.questions_, attributes, model.alphabet, growth)


@pytest.fixture(scope="module")
def small():
    """A grower of few trees, all folds of which are judged."""
    spoken = corpus(rounded_ahead, count=12, noise=0.1, vocabulary=["A", "O:", "P", "L"])
    return grower(spoken)


# -- folds -----------------------------------------------------------------------------------------


def test_folds_are_drawn_once_a_tree_and_are_even(small):
    prepared = small.prepare(True)
    folds = {}
    for data in prepared:
        counts = np.bincount(data.sample.folds, minlength=10)
        assert counts.max() - counts.min() <= 1
        assert counts.sum() == len(data.sample.targets)
        folds[data.key] = data.sample.folds.tolist()
    own = [each for each in folds if not each.pooled]
    assert len({tuple(folds[key]) for key in own}) == len(own)
    again = {data.key: data.sample.folds.tolist() for data in small.prepare(True)}
    assert again == folds


def test_a_seed_and_a_phone_give_the_folds_whatever_else_is_in_the_corpus(small):
    wider = grower(
        corpus(rounded_ahead, count=12, noise=0.1, vocabulary=["A", "O:", "P", "L", "S", "T"])
    )
    by_key = {data.key: data.sample for data in wider.prepare(True)}
    for data in small.prepare(True):
        if data.key.of == "sil":
            assert by_key[data.key].folds.tolist() == data.sample.folds.tolist()
    other = grower(
        corpus(rounded_ahead, count=12, noise=0.1, vocabulary=["A", "O:", "P", "L"]), seed=1
    )
    one, two = (each.prepare(True)[0].sample.folds.tolist() for each in (small, other))
    assert one != two


# -- how strongly to prune -------------------------------------------------------------------------


@pytest.mark.slow
def test_alphas_between_the_steps_of_a_tree_are_geometric_means(small):
    """Breiman et al. section 3.4.2; each is judged by all folds of the tree."""
    checked = 0
    for data in small.prepare(True)[:3]:
        tree = grow_plainly(data.sample, data.table, Rules(10))
        steps = np.unique(weakest_links(tree)[tree.questions >= 0])
        steps = steps[steps > 0]
        curve = small.judge_alone(data)
        assert curve.alphas[0] == 0
        np.testing.assert_allclose(curve.alphas[1:-1] ** 2, steps[:-1] * steps[1:], rtol=1e-9)
        assert steps[-1] < curve.alphas[-1] < steps[-1] * (1 + 1e-5)
        squares = [
            held_out_errors(data.sample, fold, data.table, Rules(10), curve.alphas)
            for fold in range(10)
        ]
        every = np.concatenate(squares, axis=1)
        np.testing.assert_allclose(curve.errors, every.sum(axis=1), rtol=1e-8)
        np.testing.assert_allclose(curve.squares, (every**2).sum(axis=1), rtol=1e-8)
        assert curve.count == len(data.sample.targets)
        checked += len(steps)
    assert checked > 10


def test_trees_that_are_pruned_alone_have_the_alpha_of_their_least_error():
    spoken = corpus(rounded_ahead, count=8, noise=0.1, vocabulary=["A", "O:", "P", "L"])
    settings = {"min_impurity_decrease": 0.0, "pruning": "each"}
    model = Cart(**settings).fit(spoken)
    each = grower(spoken, "each")
    for data in each.prepare(True)[1:14:4]:
        curve = each.judge_alone(data)
        alpha = curve.alphas[np.flatnonzero(curve.errors <= curve.errors.min() * (1 + 1e-12))[-1]]
        tree = grow_plainly(data.sample, data.table, Rules(10))
        expected = prune_plainly(tree, weakest_links(tree), alpha)
        tree = model.trees_[data.key]
        assert len(tree) == len(expected.questions)
        np.testing.assert_allclose(tree.means, expected.means, atol=1e-12)
    assert np.isnan(model.ccp_alpha_)


@pytest.mark.slow
def test_all_folds_of_a_small_corpus_judge_all_trees_together():
    small = grower(corpus(rounded_ahead, count=6, length=12, noise=0.1, vocabulary=["A", "P", "L"]))
    prepared = [data for data in small.prepare(True) if not data.key.pooled]
    curve = small.judge_together(prepared)
    variances = np.nanvar(small.examples.targets, axis=0)
    errors, squares = np.zeros(len(ALPHAS)), np.zeros(len(ALPHAS))
    for data in prepared:
        for fold in range(10):
            found = held_out_errors(data.sample, fold, data.table, Rules(10), ALPHAS)
            found = found / variances[data.key.parameter]
            errors += found.sum(axis=1)
            squares += (found**2).sum(axis=1)
    np.testing.assert_allclose(curve.errors, errors, rtol=1e-8)
    np.testing.assert_allclose(curve.squares, squares, rtol=1e-8)
    assert curve.count == sum(len(data.sample.targets) for data in prepared)


def test_enough_targets_of_a_large_corpus_judge_and_the_folds_take_turns():
    """The first fold of the first tree, the second of the second, until there are 15,000."""
    rng = np.random.default_rng(0)
    spoken = corpus(lambda phones, i: rng.normal(0, 1, 3), count=190, length=28)
    large = grower(spoken, rules=Rules(10, min_samples_leaf=10**9))
    prepared = [data for data in large.prepare(True) if not data.key.pooled]
    total = sum(len(data.sample.targets) for data in prepared)
    assert total > 1.1 * MAX_JUDGED
    assert MAX_JUDGED == 15_000
    calls = []
    judge = large._judge

    def record(data, fold, alphas):
        calls.append((data.key, fold))
        return judge(data, fold, alphas)

    large._judge = record
    curve = large.judge_together(prepared)
    largest = max(len(data.sample.targets) for data in prepared) / 10 + 1
    assert MAX_JUDGED <= curve.count < MAX_JUDGED + largest
    number = {data.key: i for i, data in enumerate(prepared)}
    for turn in range(len(calls) // len(prepared)):
        part = calls[turn * len(prepared) : (turn + 1) * len(prepared)]
        assert {key for key, _ in part} == set(number)
        assert all(fold == (number[key] + turn) % 10 for key, fold in part)
    # Trees that are all root: held-out errors are those of means, whatever the alpha.
    np.testing.assert_allclose(curve.errors / curve.count, 1.0, atol=0.05)


def test_folds_that_a_small_tree_lacks_do_not_judge(small):
    data = small.prepare(True)[0]
    few = data.sample._replace(
        levels=np.ascontiguousarray(data.sample.levels[:, :4]),
        targets=data.sample.targets[:4],
        folds=np.array([0, 1, 1, 3]),
    )
    object.__setattr__(data, "sample", few)
    judged = [small._judge(data, fold, ALPHAS) for fold in range(5)]
    assert [curve is None for curve in judged] == [False, False, True, False, True]
    object.__setattr__(data, "sample", few._replace(folds=np.zeros(4, np.int64)))
    assert small._judge(data, 0, ALPHAS) is None


# -- trees of many phones --------------------------------------------------------------------------


def test_trees_of_many_phones_are_grown_for_phones_without_examples(small):
    """A, O:, P and L are there: other vowels, stops, fricatives and consonants are not."""
    prepared = small.prepare(True)
    pooled = {data.key.of for data in prepared if data.key.pooled}
    # No group of another kind has an example, so that consonants stand in for them.
    assert pooled == {"vowel", "bilabial_stop", "consonant", "consonants"}
    alone = {data.key.of for data in prepared if not data.key.pooled}
    assert alone == {"sil", "A", "O:", "P", "L"}
    by_of = {data.key.of: data for data in prepared if data.key.parameter == 0}
    count = {of: len(data.sample.targets) for of, data in by_of.items()}
    assert count["vowel"] == count["A"] + count["O:"]
    assert count["consonants"] == count["P"] + count["L"]
    assert count["bilabial_stop"] == count["P"]
    assert count["consonant"] == count["L"]


def test_a_tree_of_many_phones_has_two_thousand_examples_at_most(small):
    rows = np.arange(len(small.examples.symbols))
    many = np.resize(rows, 2 * MAX_POOLED + 1)
    (data, *_) = small._prepare("all", many, pooled=True)
    assert len(data.sample.targets) == MAX_POOLED == 2000
    (data, *_) = small._prepare("all", many)
    assert len(data.sample.targets) == len(many)


def test_alternatives_go_from_the_phone_to_all():
    assert list_alternatives(SWEDISH, "'A:", True) == [
        ("'A:", False),
        ("A:", False),
        ("vowel", True),
        ("vowels", True),
        ("all", True),
    ]
    assert list_alternatives(SWEDISH, "M", True)[1:] == [
        ("bilabial_stop", True),
        ("consonants", True),
        ("all", True),
    ]
    assert list_alternatives(SWEDISH, "sil", True) == [("sil", False), ("no_speech", True)]
    assert list_alternatives(SWEDISH, "A:", False)[:2] == [("A:", False), ("vowel", True)]


# -- bins ------------------------------------------------------------------------------------------


def test_few_numbers_have_a_bin_each_and_bounds_half_way():
    levels, edges = divide_into_bins(np.array([0.3, 0.1, np.nan, 0.1, 0.2]))
    assert levels.tolist() == [2, 0, 3, 0, 1]
    np.testing.assert_allclose(edges, [0.15, 0.25])
    levels, edges = divide_into_bins(np.array([np.nan, np.nan]))
    assert levels.tolist() == [1, 1]
    assert len(edges) == 0


@pytest.mark.parametrize("count", [33, 100, 3200])
def test_many_numbers_have_bins_of_about_equal_counts(count):
    values = np.random.default_rng(count).permutation(np.arange(count) ** 1.5)
    levels, edges = divide_into_bins(values)
    assert MAX_BINS == 32
    counts = np.bincount(levels)
    assert len(counts) == len(edges) + 1 == MAX_BINS
    assert counts.max() - counts.min() <= 2
    assert (levels == np.searchsorted(edges, values)).all()
    ordered = np.sort(values)
    for edge in edges:
        i = np.searchsorted(ordered, edge)
        assert edge == pytest.approx(0.5 * (ordered[i - 1] + ordered[i]))


def test_exactly_as_many_numbers_as_bins_have_one_each():
    levels, edges = divide_into_bins(np.repeat(np.arange(32.0), 3))
    assert levels.tolist() == np.repeat(np.arange(32), 3).tolist()
    assert len(edges) == 31


# -- who resists -----------------------------------------------------------------------------------


def test_a_phone_resists_whose_targets_vary_with_less_than_half_of_the_variance():
    """Ten examples are needed; nine say nothing."""
    phone_set = load_phone_set("sv-sta")
    rng = np.random.default_rng(0)
    symbols = np.array(["A"] * 40 + ["S"] * 40 + ["L"] * 10 + ["T"] * 9 + ["sil"] * 40)
    size = {"A": 1.0, "S": 0.5, "L": 0.01, "T": 0.01, "sil": 0.0}
    unit = np.resize([-1.0, 1.0], len(symbols))
    targets = (np.array([size[s] for s in symbols]) * unit)[:, None] + rng.normal(0, 1e-6)
    spoken = corpus(lambda p, i: (0, 0, 0), count=1, length=len(symbols) - 2).utterances[0]
    phones = spoken.read_phones()
    segments = [
        type(s)(s.start, s.end, symbol, 0 if symbol == "A" else None)
        for s, symbol in zip(phones, symbols.tolist(), strict=True)
    ]
    phones = phones.replace(segments=tuple(segments))
    alphabet = make_alphabet([phones], phone_set)
    learned = np.zeros(1, dtype=bool)
    resists = find_resistant(alphabet, ["pc1"], learned, [phones], [targets])
    names = np.array(alphabet.list_names())
    # Of 98 targets in all the variance is about 0.55: A has 1.03, S 0.26, L and T nearly none.
    assert names[resists[:, 0]].tolist() == ["L", "S"]
    size["S"] = 0.8
    targets = (np.array([size[s] for s in symbols]) * unit)[:, None]
    resists = find_resistant(alphabet, ["pc1"], learned, [phones], [targets])
    assert names[resists[:, 0]].tolist() == ["L"]


# -- settings --------------------------------------------------------------------------------------


def test_settings_are_the_rules_that_trees_are_grown_by(monkeypatch):
    seen = []

    class Spy(Exception):
        pass

    def stop(grower, by_stress):
        seen.append((grower.growth, by_stress))
        raise Spy

    monkeypatch.setattr("mocap_fit.control.cart.model.grow_forest", stop)
    model = Cart(
        min_samples_split=7,
        min_samples_leaf=3,
        max_depth=4,
        cv=5,
        min_impurity_decrease=2,
        pruning="none",
        one_standard_error=True,
        phone_order="node",
        by_stress=False,
        random_state=9,
    )
    for each in (model, Cart()):
        with pytest.raises(Spy):
            each.fit(corpus(rounded_ahead, count=1))
    assert seen[0] == (Growth(Rules(5, 7, 3, 4, 2.0, True), "none", True, 9), False)
    assert seen[1] == (Growth(Rules(10, 6, 1, UNLIMITED, 6.0, False), "together", False, 0), True)


def test_a_depth_and_a_size_of_leaves_bound_the_trees():
    def rule(phones, i):
        return 0.1 * len(neighbour(phones, i, -1)) + phones[i].duration, 0.0, 0.0

    spoken = corpus(rule, count=20, noise=0.05)
    wild = {"min_impurity_decrease": 0.0, "pruning": "none"}
    free = Cart(**wild).fit(spoken)
    assert max(tree.depth for tree in free.trees_.values()) > 3
    shallow = Cart(**wild, max_depth=2).fit(spoken)
    assert max(tree.depth for tree in shallow.trees_.values()) == 2
    large = Cart(**wild, min_samples_leaf=9).fit(spoken)
    assert min(tree.counts[tree.questions < 0].min() for tree in large.trees_.values()) >= 9


def test_the_questions_are_tried_by_attribute_and_classes_before_groups():
    ordered = order_questions(reversed(list_standard_questions()))
    attributes = [question.attribute for question in ordered]
    assert len(set(attributes)) == 1 + sum(
        one != other for one, other in itertools.pairwise(attributes)
    )
    for attribute in set(attributes):
        is_open = [q.is_open for q in ordered if q.attribute == attribute]
        assert is_open == sorted(is_open)
    assert len(order_questions([*ordered, *ordered])) == len(ordered)


def test_a_grown_tree_is_that_of_the_plain_way(small):
    for data in small.prepare(True)[1:16:4]:
        plain = grow_plainly(data.sample, data.table, Rules(10))
        for one, other in zip(grow(data.sample, data.table, Rules(10)), plain, strict=True):
            np.testing.assert_allclose(one, other, atol=1e-9)


def test_the_first_of_a_spread_order_are_even():
    """By the golden section: of 5, 8, 13 numbers no gap is a quarter larger than it must be."""
    for count in range(1, 60):
        assert sorted(_spread(count)) == list(range(count))
    order = _spread(1000)
    for first in (5, 8, 13, 21):
        edges = np.sort([*order[:first], order[0] + 1000])
        assert np.diff(edges).max() * first < 1.25 * 1000
