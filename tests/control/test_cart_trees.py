"""CART: finished trees, closures, targets and words of trees, by hand."""

import dataclasses
import math
from types import SimpleNamespace
from xml.etree import ElementTree

import numpy as np
import pytest
from cart_cases import NAMES, SWEDISH, corpus, neighbour, phones_of, rounded_ahead

from mocap_fit.control.cart import (
    Cart,
    Tree,
    TreeKey,
    compute_importances,
    explain_targets,
    export_svg,
    export_text,
    find_tree,
)
from mocap_fit.control.cart.arrays import Nodes
from mocap_fit.control.cart.closures import Closure, learn_closure, learn_closures
from mocap_fit.control.cart.contexts import GROUPS, Alphabet, get_group, sample_targets
from mocap_fit.control.cart.curves import get_smoothing_reach, interpolate
from mocap_fit.control.cart.examples import read_corpus
from mocap_fit.control.cart.inspecting import _join, describe_branches, name_pool
from mocap_fit.control.cart.kernel import LEFT, RIGHT, UNSEEN
from mocap_fit.control.cart.questions import Attribute, Question
from mocap_fit.control.cart.tree import (
    Forest,
    GrownTree,
    finish_trees,
    pack_trees,
    unpack_trees,
)
from mocap_fit.tracks import ParameterTracks

PHONE, NUMBER = Question(Attribute("phone", -1)), Question(Attribute("duration", 0))


def stump(sides, counts, question=0, levels=12):
    """One cut of three nodes, as it was grown."""
    row = np.full((3, levels), UNSEEN, dtype=np.uint8)
    row[0, : len(sides)] = sides
    children = np.array([[1, 2], [-1, -1], [-1, -1]])
    count = np.array([sum(counts), *counts])
    zeros = np.zeros(3)
    questions = np.array([question, -1, -1])
    return Nodes(questions, row, children, count, np.array([0.0, 1, 2]), zeros, zeros, zeros)


def finish(nodes, edges=(), groups=None):
    """The tree with one question about a phone and one about a number."""
    groups = np.zeros(12, np.int64) if groups is None else groups
    grown = GrownTree(nodes, np.array([0, 1]), {1: np.array(edges)})
    (tree,) = finish_trees([grown], [PHONE, NUMBER], [0, 1], np.zeros((2, 12), np.uint8), groups)
    return tree


# -- bounds and sides ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("sides", "bound", "unknown"),
    [
        # Bins 0 to 3, then the unknown, which is to the right of all.
        ([LEFT, LEFT, RIGHT, RIGHT, RIGHT], 2.0, RIGHT),
        # The bin between was empty: half way between its bounds.
        ([LEFT, UNSEEN, RIGHT, RIGHT, UNSEEN], 1.5, RIGHT),
        ([UNSEEN, LEFT, UNSEEN, RIGHT, UNSEEN], 3.0, RIGHT),
        # All that is known goes to the left.
        ([LEFT, LEFT, UNSEEN, LEFT, RIGHT], np.inf, RIGHT),
    ],
)
def test_a_bound_lies_between_the_last_bin_to_the_left_and_the_first_to_the_right(
    sides, bound, unknown
):
    tree = finish(stump(sides, (10, 30), question=1), edges=[1.0, 2.0, 4.0])
    assert tree.bounds.tolist() == [bound, 0, 0]
    assert tree.unknown[0] == unknown


def test_an_unknown_number_goes_with_most_examples_where_none_was_seen():
    for counts, side in (((30, 10), LEFT), ((10, 30), RIGHT), ((20, 20), LEFT)):
        sides = [LEFT, RIGHT, UNSEEN, UNSEEN, UNSEEN]
        assert finish(stump(sides, counts, question=1), edges=[1, 2, 3]).unknown[0] == side


def test_phones_that_were_not_seen_go_with_their_group_then_kind_then_the_most():
    number = {name: 1 + i for i, name in enumerate(GROUPS)}
    vowel, stop, other = (number[g] for g in ("vowel", "bilabial_stop", "consonant"))
    fricative, silence = number["fricative"], number["no_speech"]
    groups = np.array([0, vowel, vowel, vowel, vowel, stop, stop, other, other, other, fricative])
    groups = np.concatenate([groups, [silence]])
    #        none vowels           stops   other consonants    fricative, silence
    sides = [UNSEEN, 0, 0, 1, UNSEEN, 1, UNSEEN, 0, 0, 0, UNSEEN, UNSEEN]
    tree = finish(stump(sides, (10, 30)), groups=groups)
    # Two of three vowels go left; the stop right; of four consonants three go left.
    # No phone, and silence, of whose kind there is none, go with the most: to the right.
    assert tree.sides[0].tolist() == [1, 0, 0, 1, 0, 1, 1, 0, 0, 0, 0, 1]
    assert tree.seen[0].tolist() == [side != UNSEEN for side in sides]
    even = [UNSEEN, 0, 1, UNSEEN, UNSEEN, *[UNSEEN] * 7]
    for counts, side in (((30, 10), 0), ((10, 30), 1)):
        tree = finish(stump(even, counts), groups=groups)
        assert tree.sides[0, [0, 3, 5]].tolist() == [side] * 3


def test_trees_answer_as_they_are_packed():
    rng = np.random.default_rng(0)
    phone = finish(stump(rng.integers(0, 2, 12), (5, 6)))
    number = finish(stump([LEFT, RIGHT, RIGHT, UNSEEN, UNSEEN], (30, 10), 1), edges=[1, 2, 4])
    number = dataclasses.replace(number, means=np.array([0.0, -5.0, 7.0]))
    arrays = pack_trees([phone, number], 12)
    assert arrays["tree_starts"].tolist() == [0, 3, 6]
    for tree, again in zip((phone, number), unpack_trees(arrays, 12), strict=True):
        for field in dataclasses.fields(Tree):
            one, other = getattr(tree, field.name), getattr(again, field.name)
            np.testing.assert_array_equal(one, other)
    forest = Forest([phone, number], [0, 1], [True, False], 12)
    levels, values = rng.integers(0, 12, 40), np.append(rng.uniform(0, 2, 39), np.nan)
    values[0] = 1.0
    rows = np.stack([levels, values], axis=1)
    which = np.stack([np.zeros(40), np.ones(40), np.full(40, -1)], axis=1).astype(np.int64)
    found = forest.predict(which, np.repeat(rows[:, :, None], 3, axis=2))
    assert found[:, 0].tolist() == [1.0 + phone.sides[0, level] for level in levels]
    # Up to the bound, and unknown, to the left.
    assert found[:, 1].tolist() == [-5.0 if not value > 1.0 else 7.0 for value in values]
    assert (found[:, 2] == 0).all()
    for row, answer in zip(rows, found, strict=True):
        path = number.find_path([0, 1], [True, False], row)
        assert path[0] == 0
        assert number.means[path[-1]] == answer[1]
    assert repr(number) == "Tree(2 leaves, depth 1, 40 examples)"


def test_arrays_of_trees_that_do_not_belong_together_are_refused():
    arrays = pack_trees([finish(stump([0, 1], (5, 6)))], 12)
    assert len(unpack_trees(arrays, 12)) == 1
    for name, changed in (
        ("node_children", np.array([[1, 0], [-1, -1], [-1, -1]])),
        ("node_children", np.array([[1, 3], [-1, -1], [-1, -1]])),
        ("node_means", np.array([0.0, 1.0])),
        ("node_bounds", np.array([0.0, np.nan, 0.0])),
        ("tree_starts", np.zeros((0,), np.int64)),
    ):
        with pytest.raises(ValueError, match=r"incomplete|follow"):
            unpack_trees(arrays | {name: changed}, 12)


# -- alphabets and targets -------------------------------------------------------------------------


def test_of_very_many_phones_the_commonest_have_a_level():
    counts = {f"p{i:03d}": 300 - i for i in range(300)}
    alphabet = Alphabet.from_counts(counts, SWEDISH)
    assert alphabet.levels == 256
    assert alphabet.symbols == tuple(f"p{i:03d}" for i in range(248))
    assert alphabet.get_level("p247") == 248
    assert len(alphabet.list_names()) == 256


def test_a_phone_without_a_level_has_that_of_its_group():
    alphabet = Alphabet(("A", "S"), SWEDISH)
    assert alphabet.get_level("S") == 2
    names = alphabet.list_names()
    for phone, name in (("I:", "other vowel"), ("P", "other bilabial stop"), ("T", "consonant")):
        assert names[alphabet.get_level(phone)].endswith(name)
    assert alphabet.mark_members("vowel", ()).tolist() == [0, 1, 0, 0, 1, 0, 0, 0, 0, 0]
    assert alphabet.mark_members("", ("S",)).tolist() == [0, 0, 1, 0, 0, 0, 0, 0, 0, 0]
    assert get_group(SWEDISH, "F") == "labiodental fricative"
    assert get_group(SWEDISH, "sil") == "no_speech"


def test_targets_reach_half_a_frame_beyond_the_tracks():
    phones = phones_of("P A T")
    centre = 0.5 * (phones.starts + phones.ends)[1]
    values = np.arange(1.0, 6.0)[:, None]

    def target(start):
        tracks = ParameterTracks(("a",), 100.0, values, start_time=start)
        return sample_targets(tracks, phones)[1, 0]

    assert target(centre + 0.0049) == 1.0
    assert math.isnan(target(centre + 0.0051))
    assert target(centre - 0.0449) == 5.0
    assert math.isnan(target(centre - 0.0451))
    assert target(centre - 0.0225) == pytest.approx(3.25)
    # On a frame, the next may be missing.
    values[3] = np.nan
    assert target(centre - 0.02) == pytest.approx(3.0)
    assert math.isnan(target(centre - 0.021))


# -- closures and curves ---------------------------------------------------------------------------


def test_closures_are_learned_from_medians():
    stops, vowels = np.array([0.1, 0.2, 0.6, np.nan]), np.array([0.9, 0.1, np.nan, 0.8])
    assert learn_closure(stops, vowels) == Closure(0.2, 1)
    assert learn_closure(stops, -vowels) == Closure(0.2, -1)
    assert learn_closure(stops, np.array([np.nan])) == Closure(0.2, 1)
    assert learn_closure(np.array([np.nan]), vowels) is None
    assert Closure(0.2, 1).clip(np.array([0.1, 0.3])).tolist() == [0.1, 0.2]
    assert Closure(0.2, -1).clip(np.array([0.1, 0.3])).tolist() == [0.2, 0.3]


def test_a_closure_that_is_stated_opens_as_the_corpus_does():
    symbols = np.array(["P", "A", "S"])
    targets = np.array([[0.5, 0.1], [0.2, 0.9], [9.0, 9.0]])
    closures = learn_closures({"b": 0.3, "a": 0.3}, ["a", "b"], symbols, targets, SWEDISH)
    assert closures == {1: Closure(0.3, 1), 0: Closure(0.3, -1)}
    closures = learn_closures({"b": "learned"}, ["a", "b"], symbols, targets, SWEDISH)
    assert closures == {1: Closure(0.1, 1)}
    only = learn_closures({"b": 0.3}, ["a", "b"], symbols[1:], targets[1:], SWEDISH)
    assert only == {1: Closure(0.3, 1)}
    assert learn_closures({}, ["a"], symbols, targets, SWEDISH) == {}


def test_smoothing_is_a_gaussian_cut_off_at_two_point_four():
    """At the kink of |x| it is the mean of |x|, 17 values of which stand for the Gaussian."""
    knots, heights = np.array([-1.0, 0.0, 1.0]), np.array([[1.0], [0.0], [1.0]])
    times = np.array([0.0, 0.5])
    options = {"interpolation": "linear", "smoothing": 0.1}
    found = interpolate(knots, heights, times, **options)[:, 0]
    nodes = np.linspace(-2.4, 2.4, 17)
    weights = np.exp(-(nodes**2) / 2)
    expected = 0.1 * (weights * np.abs(nodes)).sum() / weights.sum()
    np.testing.assert_allclose(found, [expected, 0.5], rtol=1e-12)
    # The half-normal distribution's mean is 0.0798; that of the part within 2.4 is 0.0763.
    assert expected == pytest.approx(0.0763, rel=0.01)
    assert get_smoothing_reach(0.1) == pytest.approx(0.24)


def lips(phones, i):
    """Open but where the lips meet, and there not always closed."""
    is_stop = "bilabial_stop" in SWEDISH.get_classes(phones[i])
    return 0.0, 0.0, (0.3 if neighbour(phones, i, 1) == "A" else 0.05) if is_stop else 0.6


@pytest.mark.parametrize("hold", [0.0, 0.4, 1.0])
def test_the_guarantee_holds_for_its_part_of_a_stop_and_no_longer(hold):
    spoken = corpus(lips, count=20, noise=0.01)
    model = Cart(closures={"lower_lip_depression": 0.1}, hold=hold).fit(spoken)
    phones = phones_of("sil L P A S B M A sil")
    stop = phones[2]
    half = min(max(0.5 * hold, 1e-3), 0.499) * stop.duration
    assert model.select_targets(phones)[2, 2] > 0.2
    times = stop.centre + half * np.array([-1.0, 0.0, 1.0])
    values = model.predict_at(phones, times)[:, 2]
    np.testing.assert_allclose(values, 0.1, atol=1e-9)
    off = 0.02 * stop.duration * np.array([-1.0, 1.0])
    outside = model.predict_at(phones, times[[0, 2]] + off)[:, 2]
    assert (outside > 0.1 + 1e-5).all()
    assert np.isfinite(model.predict(phones).values).all()


# -- what a model says of itself -------------------------------------------------------------------


@pytest.fixture(scope="module")
def model():
    return Cart().fit(corpus(rounded_ahead, count=30, noise=0.02))


def test_the_log_holds_the_errors_of_means_and_of_trees():
    spoken, held_out = (corpus(rounded_ahead, count=20, seed=s, noise=0.1) for s in (0, 1))
    model = Cart().fit(spoken, held_out)
    first, last = model.log_
    means, off = {}, {"train": [], "test": []}
    for part, each in (("train", spoken), ("test", held_out)):
        for phones, targets in zip(*read_corpus(each), strict=True):
            selected = model.select_targets(phones)
            symbols = [SWEDISH.get_symbol(s) for s in phones]
            off[part].append(np.stack([targets, selected], axis=2))
            for symbol, row in zip(symbols, targets, strict=True):
                if part == "train":
                    means.setdefault(symbol, []).append(row)
            off[part][-1] = (symbols, off[part][-1])
    by_mean = {symbol: np.mean(rows, axis=0) for symbol, rows in means.items()}
    for part, of_means, of_trees in (
        ("train", first.training_error, last.training_error),
        ("test", first.validation_error, last.validation_error),
    ):
        both = np.concatenate([rows for _, rows in off[part]])
        expected = np.concatenate([[by_mean[s] for s in symbols] for symbols, _ in off[part]])
        trees = np.sqrt(np.mean((both[:, :, 1] - both[:, :, 0]) ** 2))
        assert of_means == pytest.approx(np.sqrt(np.mean((expected - both[:, :, 0]) ** 2)))
        assert of_trees == pytest.approx(trees)
    assert [entry.iteration for entry in model.log_] == [0, 1]


def test_the_pruning_curve_is_of_targets_in_variances(model):
    assert model.pruning_curve_.shape == (28, 2)
    alphas, errors = model.pruning_curve_.T
    assert model.ccp_alpha_ == alphas[errors <= errors.min() * (1 + 1e-12)].max()
    assert 0 < errors.min() < 1


@pytest.mark.parametrize(
    ("settings", "ahead", "behind"),
    [
        ({}, 5, 5),
        ({"interpolation": "linear"}, 4, 5),
        ({"reach": 2}, 3, 3),
        ({"questions": '[[question]]\nask = "phone"\nat = 7\n'}, 8, 5),
        ({"questions": '[[question]]\nask = "phone"\nat = -7\n'}, 5, 8),
        ({"questions": '[[question]]\nask = "resistant"\nat = 2\n'}, 5, 5),
    ],
)
def test_the_curve_depends_on_so_many_phones(settings, ahead, behind):
    found = Cart(**settings).fit(corpus(rounded_ahead, count=1))
    assert found.phones_ahead == ahead
    assert found._count_neighbours(-1) + 1 == behind


def test_importances_are_shares_of_the_gains():
    model = Cart(min_impurity_decrease=0.0, pruning="none").fit(
        corpus(rounded_ahead, count=15, noise=0.3)
    )
    found = compute_importances(model)
    for p, name in enumerate(NAMES):
        gains = {}
        for key, tree in model.trees_.items():
            if key.parameter == p and not key.pooled:
                for question, gain in zip(tree.questions, tree.gains, strict=True):
                    if question >= 0:
                        label = model.questions_[question].name
                        gains[label] = gains.get(label, 0) + gain
        total = sum(gains.values())
        assert {q: s for q, s in found[name].items() if s} == pytest.approx(
            {q: g / total for q, g in gains.items()}
        )
        assert list(found[name].values()) == sorted(found[name].values(), reverse=True)


def test_a_tree_as_text_has_a_line_a_node(model):
    key = find_tree(model, "L/lower_lip_depression")
    tree = model.trees_[key]
    lines = export_text(model, key).splitlines()
    assert lines[0] == f"L / lower_lip_depression: {tree.leaves} leaves, {tree.counts[0]} examples"
    assert len(lines) == 1 + len(tree)
    root = np.sqrt(tree.validated[0] / tree.counts[0])
    assert lines[1] == (
        f"n {tree.counts[0]}, mean {tree.means[0]:.3f}, error {root:.3f}; duration of the segment?"
    )
    left, right = describe_branches(model, key, 0)
    assert left == f"up to {tree.bounds[0]:.3g} s"
    assert right == f"above {tree.bounds[0]:.3g} s"
    assert lines[2].startswith(f"  {left}: n {tree.counts[tree.children[0, 0]]}, mean ")


def test_a_drawing_puts_every_question_over_the_middle_of_its_answers(model):
    key = max(model.trees_, key=lambda each: model.trees_[each].leaves)
    tree = model.trees_[key]
    assert tree.leaves >= 2
    root = ElementTree.fromstring(export_svg(model, key))
    boxes = [each for each in root.iter() if each.tag.endswith("rect") and each.get("x")]
    middles = [float(box.get("x")) + float(box.get("width")) / 2 for box in boxes]
    tops = [float(box.get("y")) for box in boxes]
    assert len(boxes) == len(tree)
    for node in np.flatnonzero(tree.questions >= 0):
        children = tree.children[node]
        assert middles[node] == pytest.approx(np.mean([middles[c] for c in children]), abs=1e-3)
        assert middles[children[0]] < middles[children[1]]
        assert all(tops[child] > tops[node] for child in children)
    fills = [box.get("fill") for box in boxes]
    assert fills[0] == "#ffffff"
    far = np.abs(tree.means - tree.means[0]).argmax()
    assert fills[far] == ("#f4a582" if tree.means[far] > tree.means[0] else "#92c5de")


def test_long_lists_of_phones_are_cut():
    assert _join([str(i) for i in range(13)]) == " ".join(map(str, range(13)))
    assert _join([str(i) for i in range(14)]) == " ".join(map(str, range(12))) + " and 2 more"
    assert name_pool("all") == "all"
    assert name_pool("bilabial_stop") == "bilabial stops"
    assert name_pool("no_speech") == "no speech"


def test_reasons_count_and_average_the_branch_that_was_taken(model):
    new = phones_of("sil L O: K sil")
    (why,) = explain_targets(model, new, segment=1, parameter="lip_rounding")
    tree = model.trees_[TreeKey("L", 1)]
    (answer,) = why.answers
    after = tree.children[0, tree.sides[0, model.alphabet.get_level("O:")]]
    assert (answer.count, answer.mean) == (tree.counts[after], tree.means[after])
    assert answer.seen
    assert (why.start, why.target) == (tree.means[0], tree.means[after])
    assert why.centre == new[1].centre
    assert not why.backed_off
    first = str(why).splitlines()[0]
    assert first.startswith(f"L at {why.centre:.3f} s, lip_rounding: {why.target:.3f}")
    (why,) = explain_targets(model, new, segment=3, parameter="lip_rounding")
    assert "no tree of its own: that of consonant" in str(why)
    # A phone that no L was beside: T follows, but is not the one that rounds.
    unseen = [s for s in SWEDISH.list_symbols(stress=False) if s not in model.alphabet.symbols]
    vowel = next(s for s in unseen if SWEDISH.is_vowel(s))
    (why,) = explain_targets(
        model, phones_of(f"sil L {vowel} sil"), segment=1, parameter="lip_rounding"
    )
    assert not why.answers[0].seen
    assert "never seen here" in str(why)


def test_the_tree_with_sound_is_the_one_that_is_meant():
    keys = {TreeKey("A", 0): None, TreeKey("A", 0, False, True): None}
    stub = SimpleNamespace(
        parameter_names_=("jaw",), phone_set_=SWEDISH, by_stress=True, trees_=keys
    )
    assert find_tree(stub, "A/jaw").with_sound
    assert not find_tree(stub, "A/jaw", with_sound=False).with_sound
