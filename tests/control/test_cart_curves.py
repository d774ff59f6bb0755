"""CART: curves through the targets, closures, streams, and looking at trees."""

import json
import math
from xml.etree import ElementTree

import numpy as np
import pytest
from cart_cases import NAMES, SWEDISH, corpus, neighbour, phones_of, rounded_ahead, sentence
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import PchipInterpolator

from mocap_fit.control.cart import (
    Cart,
    explain_targets,
    export_svg,
    export_text,
    find_tree,
    write_tree,
)
from mocap_fit.control.cart.closures import Closure
from mocap_fit.control.cart.contexts import Alphabet
from mocap_fit.control.cart.curves import interpolate
from mocap_fit.control.cart.examples import find_resistant
from mocap_fit.errors import DataError, FileFormatError

INTERPOLATIONS = ("cubic", "linear", "cosine")


@pytest.fixture(scope="module")
def model():
    return Cart().fit(corpus(rounded_ahead, count=40, noise=0.02))


# -- curves ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("interpolation", INTERPOLATIONS)
def test_curves_go_through_the_targets_and_stay_between_them(interpolation):
    rng = np.random.default_rng(1)
    centres = np.cumsum(rng.uniform(0.05, 0.2, 12))
    values = rng.normal(0, 1, (12, 3))
    np.testing.assert_allclose(
        interpolate(centres, values, centres, interpolation=interpolation), values, atol=1e-12
    )
    times = np.linspace(centres[0] - 0.2, centres[-1] + 0.2, 2000)
    found = interpolate(centres, values, times, interpolation=interpolation)
    before = np.clip(np.searchsorted(centres, times, side="right") - 1, 0, 10)
    pair = np.stack([values[before], values[before + 1]])
    assert (found >= pair.min(axis=0) - 1e-12).all()
    assert (found <= pair.max(axis=0) + 1e-12).all()
    np.testing.assert_allclose(found[[0, -1]], values[[0, -1]], atol=1e-12)
    middle = 0.5 * (centres[:-1] + centres[1:])
    halves = interpolate(centres, values, middle, interpolation=interpolation)
    if interpolation == "cubic":
        np.testing.assert_allclose(halves, PchipInterpolator(centres, values)(middle))
    else:
        np.testing.assert_allclose(halves, 0.5 * (values[:-1] + values[1:]))


def test_one_target_is_a_constant():
    found = interpolate(np.array([0.3]), np.array([[0.5, -1.0]]), np.array([0.0, 0.3, 9.0]))
    np.testing.assert_array_equal(found, [[0.5, -1.0]] * 3)


@pytest.mark.parametrize("interpolation", INTERPOLATIONS)
def test_any_rate_samples_one_curve(model, interpolation):
    other = Cart(interpolation=interpolation).fit(corpus(rounded_ahead, count=5))
    new = phones_of("sil L O: P A S sil")
    slow, fast = other.predict(new, 25.0), other.predict(new, 200.0)
    np.testing.assert_allclose(fast.values[::8][: len(slow.values)], slow.values, atol=1e-12)
    assert slow.rate == 25.0


def test_smoothing_lowers_the_bends_and_keeps_a_constant():
    rng = np.random.default_rng(1)
    centres, values = np.cumsum(rng.uniform(0.05, 0.1, 30)), rng.normal(0, 1, (30, 1))
    times = np.arange(centres[0], centres[-1], 0.005)
    plain, smooth = (interpolate(centres, values, times, smoothing=s)[:, 0] for s in (0.0, 0.03))
    assert np.abs(np.diff(smooth, 2)).max() < 0.5 * np.abs(np.diff(plain, 2)).max()
    np.testing.assert_allclose(interpolate(centres, values * 0 + 2.0, times, smoothing=0.03), 2.0)


@settings(deadline=None, max_examples=30)
@given(
    seed=st.integers(0, 10**6),
    interpolation=st.sampled_from(INTERPOLATIONS),
    smoothing=st.sampled_from([0.0, 0.02, 0.1]),
    opening=st.sampled_from([1, -1]),
)
def test_a_closure_is_kept_at_every_time_that_is_held(seed, interpolation, smoothing, opening):
    rng = np.random.default_rng(seed)
    lengths = rng.uniform(0.03, 0.2, 10)
    ends = np.cumsum(lengths)
    centres = ends - 0.5 * lengths
    is_stop = rng.random(10) < 0.4
    half = np.where(is_stop, 0.25 * lengths, np.nan)
    held = np.stack([centres - half, centres + half], axis=1)
    values = rng.normal(0, 1, (10, 2))
    times = np.linspace(0, ends[-1], 3001)
    options = {"interpolation": interpolation, "smoothing": smoothing}
    closed = interpolate(
        centres, values, times, closures={1: Closure(0.1, opening)}, held=held, **options
    )
    free = interpolate(centres, values, times, **options)
    inside = ((times[:, None] >= held[:, 0]) & (times[:, None] <= held[:, 1])).any(axis=1)
    assert (opening * closed[inside, 1] <= opening * 0.1 + 1e-12).all()
    np.testing.assert_array_equal(closed[:, 0], free[:, 0])
    # Nothing jumps.
    assert np.abs(np.diff(closed[:, 1])).max() < 0.12


def lips(phones, i):
    """Closed in bilabial stops, but not always; open where the vowel is."""
    classes = SWEDISH.get_classes(phones[i])
    closed = "bilabial_stop" in classes
    wild = 0.3 if closed and neighbour(phones, i, 1) == "A" else 0.0
    return 0.0, 0.0, (0.05 if closed else 0.6) + wild


@pytest.mark.parametrize("bound", ["learned", 0.1])
def test_bilabial_stops_close_at_every_rate(bound):
    spoken = corpus(lips, count=40, noise=0.01)
    new = phones_of("sil A P A L M A B O: sil")
    free = Cart().fit(spoken)
    kept = Cart(closures={"lower_lip_depression": bound}, hold=0.6, smoothing=0.02).fit(spoken)
    limit = kept.closures_[2].bound
    assert kept.closures_[2].opening == 1
    assert limit == pytest.approx(0.1 if bound == 0.1 else 0.06, abs=0.3)
    assert free.select_targets(new)[2, 2] > limit + 0.1
    for rate in (25.0, 100.0, 1000.0):
        tracks = kept.predict(new, rate)
        times = tracks.start_time + np.arange(len(tracks.values)) / rate
        for segment in new:
            if "bilabial_stop" in SWEDISH.get_classes(segment):
                middle = np.abs(times - segment.centre) <= 0.3 * segment.duration
                assert (tracks.values[middle, 2] <= limit + 1e-12).all()


def test_a_closure_cannot_be_learned_without_bilabial_stops():
    with pytest.raises(DataError, match="cannot be learned"):
        Cart(closures={"jaw_rotation": "learned"}).fit(
            corpus(rounded_ahead, count=2, vocabulary=["A", "S"])
        )


# -- live, kept, looked at -------------------------------------------------------------------------


@pytest.mark.parametrize("interpolation", INTERPOLATIONS)
@pytest.mark.parametrize("smoothing", [0.0, 0.02])
def test_a_stream_gives_frames_as_soon_as_they_are_sure(interpolation, smoothing):
    settings = {"interpolation": interpolation, "smoothing": smoothing, "reach": 2}
    closures = {"lower_lip_depression": "learned"}
    found = Cart(**settings, closures=closures).fit(corpus(lips, count=20, noise=0.05))
    rng = np.random.default_rng(3)
    new = sentence(
        ["sil", *rng.choice(["A", "P", "O:", "S", "M", "L"], 40), "sil"], rng, "new", SWEDISH
    )
    whole = found.predict(new, 50.0).values
    stream, given, delays = found.stream(50.0), [], []
    for number, segment in enumerate(new):
        stream.push(segment)
        given.append(stream.pull())
        count = sum(map(len, given))
        if count:
            delays.append(number - new.at(np.array([(count - 1) / 50.0]))[0])
    assert sum(map(len, given)) > 0.7 * len(whole)
    given.append(stream.finish())
    np.testing.assert_allclose(np.concatenate(given), whole, atol=1e-12)
    assert max(delays) <= found.phones_ahead + 2
    assert found.look_ahead == math.inf


def test_reasons_say_the_way_to_every_target(model):
    new = phones_of("sil L O: K A sil")
    all_of_them = explain_targets(model, new)
    assert len(all_of_them) == len(new) * len(NAMES)
    values = model.select_targets(new)
    for each in all_of_them:
        assert each.target == values[each.segment, NAMES.index(each.parameter)]
    (why,) = explain_targets(model, new, segment=1, parameter="lip_rounding")
    assert [answer.question for answer in why.answers] == ["right phone"]
    assert why.answers[0].value == "O:"
    assert why.answers[0].branch == "O:"
    assert "right phone: O: -> O:" in str(why)
    (why,) = explain_targets(model, new, segment=3, parameter="jaw_rotation")
    assert why.backed_off
    assert why.tree == "consonant"
    for wrong in ({"segment": 99}, {"parameter": "nose"}):
        with pytest.raises(DataError):
            explain_targets(model, new, **wrong)


def test_trees_are_drawn(model, tmp_path):
    key = find_tree(model, "L/lip_rounding")
    text = export_text(model, key)
    assert text.splitlines()[0].startswith("L / lip_rounding: 2 leaves")
    assert "right phone?" in text
    path = tmp_path / "tree.svg"
    write_tree(model, key, path)
    root = ElementTree.parse(path).getroot()
    words = [element.text for element in root.iter() if element.tag.endswith("text")]
    assert "right phone?" in words
    assert "O:" in words
    assert sum(word.startswith("n ") for word in words) == 3
    assert path.read_text(encoding="utf-8") == export_svg(model, key)
    with pytest.raises(FileFormatError, match="cannot be written"):
        write_tree(model, key, tmp_path / "none" / "tree.svg")
    for name in ("L", "L/nose", "K/lip_rounding"):
        with pytest.raises(DataError):
            find_tree(model, name)
    assert find_tree(model, "consonant/lip_rounding").pooled
    # A stress that was not said, and one that has no tree of its own.
    assert find_tree(model, "ˈA:/lip_rounding").of == "'A:"
    assert find_tree(model, "A:/lip_rounding").of == "'A:"
    assert find_tree(model, "'A/lip_rounding").of == "A"


def test_boxes_of_a_drawing_do_not_overlap():
    def rule(phones, i):
        return neighbour(phones, i, -1) < neighbour(phones, i, 1), phones[i].duration * 5, 0.0

    found = Cart(min_impurity_decrease=0.0, pruning="none").fit(corpus(rule, count=30, noise=0.1))
    key = max(found.trees_, key=lambda key: found.trees_[key].leaves)
    root = ElementTree.fromstring(export_svg(found, key))
    boxes = [
        [float(element.get(name)) for name in ("x", "y", "width", "height")]
        for element in root.iter()
        if element.tag.endswith("rect") and element.get("x")
    ]
    assert len(boxes) > 20
    width, height = float(root.get("width")), float(root.get("height"))
    for i, (x, y, w, h) in enumerate(boxes):
        assert x >= 0
        assert x + w <= width
        assert y + h <= height
        for other_x, other_y, other_w, other_h in boxes[:i]:
            apart = x >= other_x + other_w or other_x >= x + w
            assert apart or y >= other_y + other_h or other_y >= y + h


def test_the_same_corpus_gives_the_same_file_whatever_is_learned_before(tmp_path):
    spoken = corpus(rounded_ahead, count=10, noise=0.05)
    for name in "ab":
        Cart().fit(spoken).save(tmp_path / name)
        Cart(random_state=1).fit(corpus(lips, count=3))
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()
    other = Cart(random_state=1).fit(spoken)
    assert json.dumps(other.get_params()) != json.dumps(Cart().get_params())


@pytest.mark.parametrize(
    ("square", "count", "resists"), [(0.43, 10, True), (0.44, 10, False), (0.1, 9, False)]
)
def test_a_phone_resists_that_varies_by_less_than_half_of_what_all_do(square, count, resists):
    """Ten S at plus and minus a, a hundred T at plus and minus 1, with n - 1 degrees of freedom.

    Ten a² / 9 is half of (10 a² + 100) / 108 where a² is 0.4348.
    """
    symbols = ["sil", *["S"] * count, *["T"] * 100, "sil"]
    phones = sentence(symbols, np.random.default_rng(0), "u", SWEDISH)
    values = np.tile([1.0, -1.0], 200)[: len(symbols)]
    values[1 : 1 + count] *= np.sqrt(square)
    if count % 2:
        values[count] = 0.0
    values[[0, -1]] = 99.0
    alphabet = Alphabet(("S", "T"), SWEDISH)
    found = find_resistant(alphabet, ("x",), np.array([False]), [phones], [values[:, None]])
    assert found[alphabet.get_level("S"), 0] == resists
    assert not found[alphabet.get_level("T"), 0]
