"""CART as a model: known rules are found again, phones are backed off, questions, little data."""

import math
import warnings

import numpy as np
import pytest
from cart_cases import NAMES, SWEDISH, corpus, neighbour, phones_of, rounded_ahead

from mocap_fit import control
from mocap_fit.control.cart import (
    Cart,
    TreeKey,
    compute_importances,
    explain_targets,
    find_tree,
    list_standard_questions,
)
from mocap_fit.control.cart.contexts import Alphabet, ContextReader, get_group, sample_targets
from mocap_fit.control.cart.learning import list_alternatives
from mocap_fit.control.cart.questions import Attribute
from mocap_fit.corpus import Corpus, Utterance
from mocap_fit.errors import ConfigurationError, DataError, SmallCorpusWarning
from mocap_fit.phones import QUESTION_CLASSES, PhoneSequence
from mocap_fit.tracks import ParameterTracks


@pytest.fixture(scope="module")
def model():
    return Cart().fit(corpus(rounded_ahead, count=40, noise=0.02))


def test_known_rules_are_found_again(model):
    rounding, lip = find_tree(model, "L/lip_rounding"), find_tree(model, "L/lower_lip_depression")
    tree = model.trees_[rounding]
    assert tree.leaves == 2
    assert model.questions_[tree.questions[0]].name == "right phone"
    names = model.alphabet.list_names()
    smaller = np.flatnonzero(tree.counts[tree.children[0]] == tree.counts[tree.children[0]].min())[
        0
    ]
    seen = tree.seen[0] & (tree.sides[0] == smaller)
    assert [names[level] for level in np.flatnonzero(seen)] == ["O:"]
    tree = model.trees_[lip]
    assert model.questions_[tree.questions[0]].name == "duration of the segment"
    assert tree.bounds[0] == pytest.approx(0.1, abs=0.005)
    new = phones_of("sil L O: L A S sil")
    expected = [rounded_ahead(new, i) for i in range(len(new))]
    np.testing.assert_allclose(
        model.select_targets(new)[:, :2], np.array(expected)[:, :2], atol=0.06
    )
    shares = compute_importances(model)
    assert next(iter(shares["lip_rounding"])) == "right phone"
    assert shares["lower_lip_depression"]["duration of the segment"] > 0.9
    for name in NAMES[1:]:
        assert sum(shares[name].values()) == pytest.approx(1.0)


def test_the_standard_questions_are_those_of_the_paper():
    names = [question.name for question in list_standard_questions()]
    assert len(names) == 18
    for side in ("left", "right"):
        assert f"{side} phone" in names
        assert sum(name.startswith(f"{side} phone is") for name in names) == len(QUESTION_CLASSES)
        assert f"nearest resistant phone to the {side}" in names
        assert f"duration of the {side} phone" in names
    assert "duration of the segment" in names
    assert "energy of the segment" in names


def test_attributes_are_what_they_are_called():
    phones = phones_of("sil P A F O: T L S")
    alphabet = Alphabet(tuple(sorted({*phones.phones})), SWEDISH)
    resists = np.zeros((alphabet.levels, 2), dtype=bool)
    resists[alphabet.get_level("P"), 0] = resists[alphabet.get_level("O:"), :] = True
    kinds = [
        Attribute("phone", -2),
        Attribute("phone", 1),
        Attribute("resistant", -1),
        Attribute("resistant", 1),
        Attribute("resistant", -2),
        Attribute("duration", 1),
        Attribute("feature", -1, "open"),
        Attribute("energy", 0),
    ]
    reader = ContextReader(kinds, alphabet, resists, ("a", "b"), np.zeros(2, bool), reach=3)
    left2, right, left, ahead, second, duration, openness, energy = reader.read_columns(phones)
    names = np.array(alphabet.list_names())
    assert names[left2].tolist() == ["sil", "sil", "sil", "P", "A", "F", "O:", "T"]
    assert names[right].tolist() == ["P", "A", "F", "O:", "T", "L", "S", "sil"]
    # P is three before O: and is reached; four before T, and is not.
    assert names[left[:, 0]].tolist() == ["none", "none", "P", "P", "P", "O:", "O:", "O:"]
    assert names[left[:, 1]].tolist() == ["none"] * 5 + ["O:"] * 3
    assert names[ahead[:, 0]].tolist() == ["P"] + ["O:"] * 3 + ["none"] * 4
    assert names[second[:, 0]].tolist() == ["none"] * 8
    np.testing.assert_array_equal(duration[:-1], phones.ends[1:] - phones.starts[1:])
    assert np.isnan(duration[-1])
    assert openness[3] == SWEDISH.get_phone("A").values["open"]
    assert np.isnan(energy).all()


def test_targets_are_taken_at_the_centres():
    phones = phones_of("P A T")
    values = np.arange(40.0)[:, None] * [1.0, -2.0]
    tracks = ParameterTracks(("a", "b"), 100.0, values, start_time=0.003)
    found = sample_targets(tracks, phones)
    centres = 0.5 * (phones.starts + phones.ends)
    np.testing.assert_allclose(found[:, 0], (centres - 0.003) * 100)
    values[int((centres[1] - 0.003) * 100), 1] = np.nan
    found = sample_targets(ParameterTracks(("a", "b"), 100.0, values, start_time=0.003), phones)
    assert np.isnan(found).tolist() == [[False, False], [False, True], [False, False]]
    short = sample_targets(ParameterTracks(("a", "b"), 100.0, values[:3], start_time=0.003), phones)
    assert np.isnan(short).all()
    assert sample_targets(ParameterTracks(("a",), 100.0, np.zeros((0, 1))), phones).shape == (3, 1)


# -- phones and contexts that were never seen ------------------------------------------------------


def test_a_phone_without_examples_takes_the_trees_of_what_is_like_it(model):
    # 'I: was never said, but I: was; then K, by the other consonants; Y:, by the vowels.
    chosen = {
        each.parameter: each.key
        for each in model.trace_targets(phones_of("sil 'I: sil"))
        if each.segment == 1
    }
    assert chosen[0] == TreeKey("I:", 0)
    by_phone = {
        phone: next(
            c.key for c in model.trace_targets(phones_of(f"sil {phone} sil")) if c.segment == 1
        )
        for phone in ("K", "Y:", "N", "V", "H")
    }
    assert by_phone["K"] == TreeKey("consonant", 0, True)
    assert by_phone["N"] == TreeKey("consonant", 0, True)
    assert by_phone["Y:"] == TreeKey("vowel", 0, True)
    assert by_phone["V"] == TreeKey("labiodental fricative", 0, True)
    assert by_phone["H"] == TreeKey("fricative", 0, True)
    values = model.select_targets(phones_of("sil K Y: sil"))
    assert values[1, 0] == pytest.approx(0.1, abs=0.03)
    assert values[2, 0] == pytest.approx(0.8, abs=0.03)


def test_the_chain_of_backing_off_goes_from_the_phone_to_all():
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


def test_a_context_that_was_never_seen_goes_with_its_group():
    """Before bilabial stops: P and B were seen, M was not."""

    def rule(phones, i):
        closed = neighbour(phones, i, 1) in ("P", "B", "M")
        return 0.0, 0.0, 0.1 if closed else 0.7

    vocabulary = ["A", "I:", "P", "B", "S", "T", "L", "F"]
    found = Cart().fit(corpus(rule, count=40, noise=0.02, vocabulary=vocabulary))
    new = phones_of("sil A M A N A V A sil")
    values = found.select_targets(new)[:, 2]
    np.testing.assert_allclose(values[[1, 3, 5]], [0.1, 0.7, 0.7], atol=0.03)
    answer = explain_targets(found, new, segment=1, parameter="lower_lip_depression")[0].answers[0]
    assert answer.value == "other bilabial stop"
    assert get_group(SWEDISH, "M") == "bilabial_stop"


def test_a_group_decides_for_its_phones_where_the_question_is_open():
    """The cut is between phones that no class divides; K and N follow T and L."""

    def rule(phones, i):
        return 0.8 if neighbour(phones, i, -1) in ("T", "L", "S") else 0.2, 0.0, 0.0

    vocabulary = ["A", "I:", "O:", "P", "S", "T", "L"]
    found = Cart().fit(corpus(rule, count=40, noise=0.02, vocabulary=vocabulary))
    tree = found.trees_[find_tree(found, "A/jaw_rotation")]
    assert found.questions_[tree.questions[0]].name == "left phone"
    values = found.select_targets(phones_of("sil K A G A Y: A B A sil"))[:, 0]
    np.testing.assert_allclose(values[[2, 4, 6, 8]], [0.8, 0.8, 0.2, 0.2], atol=0.04)


def test_silence_without_examples_is_rest():
    def rule(phones, i):
        return 0.5, 0.5, 0.5

    spoken = corpus(rule, count=3)
    without = Corpus.from_utterances(
        [
            Utterance.from_tracks(
                u.read_tracks(), u.read_phones().replace(segments=u.read_phones().segments[1:-1])
            )
            for u in spoken
        ],
        SWEDISH,
    )
    found = Cart().fit(without)
    values = found.select_targets(phones_of("sil A K sil"))
    np.testing.assert_allclose(values, [[0] * 3, [0.5] * 3, [0.5] * 3, [0] * 3], atol=1e-12)


# -- little data, and data with gaps ---------------------------------------------------------------


@pytest.mark.parametrize("pruning", ["together", "each", "none"])
def test_one_example_of_each_phone_is_its_target(pruning):
    def rule(phones, i):
        return 0.1 * i, 0.2, -0.1 * i

    small = corpus(rule, count=1, length=3, vocabulary=["A"])
    small = Corpus.from_utterances(
        [
            Utterance.from_tracks(
                u.read_tracks(), u.read_phones().replace(segments=u.read_phones().segments[:2])
            )
            for u in small
        ],
        SWEDISH,
    )
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.simplefilter("ignore", SmallCorpusWarning)
        found = Cart(pruning=pruning).fit(small)
        values = found.select_targets(small.utterances[0].read_phones())
        new = found.select_targets(phones_of("sil K Y: sil"))
    np.testing.assert_allclose(values, [[0, 0.2, 0], [0.1, 0.2, -0.1]], atol=1e-12)
    assert np.isfinite(new).all()
    np.testing.assert_allclose(new[1:3, 0], 0.1)


def test_targets_that_are_all_the_same_need_no_question():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.simplefilter("ignore", SmallCorpusWarning)
        found = Cart().fit(corpus(lambda phones, i: (0.1, 0.2, 1 / 3), count=20))
    assert all(tree.leaves == 1 for tree in found.trees_.values())
    np.testing.assert_allclose(found.select_targets(phones_of("sil A P sil"))[1], [0.1, 0.2, 1 / 3])


def test_missing_values_do_not_count_and_a_parameter_without_any_is_rest():
    whole = corpus(rounded_ahead, count=30, noise=0.02)
    rng = np.random.default_rng(0)
    holed = []
    for utterance in whole:
        values = utterance.read_tracks().values.copy()
        for start in rng.integers(0, len(values), 8):
            values[start : start + 60, 0] = np.nan
        values[:, 2] = np.nan
        holed.append(
            Utterance.from_tracks(
                utterance.read_tracks().replace(values=values), utterance.read_phones()
            )
        )
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.simplefilter("ignore", SmallCorpusWarning)
        found = Cart(closures={}).fit(Corpus.from_utterances(holed, SWEDISH))
        values = found.select_targets(phones_of("sil L A S sil"))
    np.testing.assert_allclose(values[1:4, 0], [0.1, 0.8, 0.1], atol=0.03)
    assert (values[:, 2] == 0).all()
    assert explain_targets(found, phones_of("sil A"), parameter=NAMES[2])[0].tree == ""
    entire = Cart().fit(whole)
    assert found.trees_[TreeKey("L", 0)].counts[0] < entire.trees_[TreeKey("L", 0)].counts[0]
    assert found.trees_[TreeKey("L", 1)].counts[0] == entire.trees_[TreeKey("L", 1)].counts[0]


def test_a_corpus_of_missing_values_alone_is_rest(tmp_path):
    whole = corpus(rounded_ahead, count=2)
    empty = [
        Utterance.from_tracks(
            u.read_tracks().replace(values=np.full(u.read_tracks().values.shape, np.nan)),
            u.read_phones(),
        )
        for u in whole
    ]
    found = Cart().fit(Corpus.from_utterances(empty, SWEDISH))
    assert not found.trees_
    found.save(tmp_path / "m.npz")
    again = control.load(tmp_path / "m.npz")
    assert (again.predict(phones_of("sil A P sil")).values == 0).all()


def test_one_phone_only():
    found = Cart().fit(corpus(lambda p, i: (0.3, 0.1, p[i].duration), count=5, vocabulary=["A"]))
    assert {key.of for key in found.trees_ if not key.pooled} == {"A", "sil"}
    assert np.isfinite(found.predict(phones_of("sil A A sil")).values).all()


def test_an_utterance_without_phones_is_left_out_and_a_corpus_of_such_is_refused():
    spoken = corpus(rounded_ahead, count=2)
    silent = Utterance.from_tracks(
        spoken.utterances[0].read_tracks(), PhoneSequence((), phone_set="sv-sta"), id="z"
    )
    found = Cart().fit(Corpus.from_utterances([*spoken, silent], SWEDISH))
    assert found.trees_
    with pytest.raises(DataError, match="no phones"):
        Cart().fit(Corpus.from_utterances([silent], SWEDISH))


# -- sound -----------------------------------------------------------------------------------------


def loud_opens(phones, i):
    energy = phones[i].energy_db
    return 0.9 if energy is not None and energy > -20 else 0.2, 0.0, 0.0


def drawn_energy(rng):
    return rng.choice([-35.0, -5.0]) + rng.normal(0, 1)


def test_energy_is_asked_for_where_there_is_sound_and_drops_out_where_not():
    spoken = corpus(loud_opens, count=30, noise=0.02, loud=drawn_energy)
    found = Cart().fit(spoken)
    key = find_tree(found, "A/jaw_rotation")
    assert key.with_sound
    assert found.questions_[found.trees_[key].questions[0]].name == "energy of the segment"
    loud, soft = (phones_of("sil A A sil", loud=lambda rng, e=e: e) for e in (-5.0, -35.0))
    np.testing.assert_allclose(found.select_targets(loud)[1:3, 0], 0.9, atol=0.03)
    np.testing.assert_allclose(found.select_targets(soft)[1:3, 0], 0.2, atol=0.03)
    # Without sound the answer is that of trees that were grown without it.
    deaf = Corpus.from_utterances(
        [
            Utterance.from_tracks(
                u.read_tracks(),
                u.read_phones().replace(
                    segments=[type(s)(s.start, s.end, s.phone, s.stress) for s in u.read_phones()]
                ),
            )
            for u in spoken
        ],
        SWEDISH,
    )
    other = Cart().fit(deaf)
    assert not any(key.with_sound for key in other.trees_)
    silent = phones_of("sil A A P sil")
    root = other.trees_[TreeKey("A", 0)].means[0]
    assert found.trees_[TreeKey("A", 0)].means[0] == pytest.approx(root)
    assert 0.3 < found.select_targets(silent)[1, 0] < 0.8
    # A tree without the question of sound is kept once.
    assert not any(key.with_sound and key.parameter == 1 for key in found.trees_)


def test_sound_in_less_than_half_of_the_examples_is_not_asked_for():
    def some(rng):
        return drawn_energy(rng) if rng.random() < 0.3 else None

    spoken = corpus(
        lambda phones, i: (0.5 if phones[i].energy_db is None else loud_opens(phones, i)[0], 0, 0),
        count=20,
        loud=lambda rng: np.nan,
    )
    rng = np.random.default_rng(0)
    mixed = [
        Utterance.from_tracks(
            u.read_tracks(),
            u.read_phones().replace(
                segments=[
                    type(s)(s.start, s.end, s.phone, s.stress, energy_db=some(rng))
                    for s in u.read_phones()
                ]
            ),
        )
        for u in spoken
    ]
    found = Cart().fit(Corpus.from_utterances(mixed, SWEDISH))
    assert not any(key.with_sound and not key.pooled for key in found.trees_)


@pytest.mark.parametrize(
    "setting",
    [
        {"min_samples_split": 1},
        {"cv": 1},
        {"min_impurity_decrease": -1.0},
        {"min_impurity_decrease": math.nan},
        {"pruning": "some"},
        {"phone_order": "both"},
        {"resistance": "high"},
        {"reach": 0},
        {"interpolation": "quintic"},
        {"smoothing": -0.1},
        {"hold": 1.5},
        {"closures": {"nose": "learned"}},
        {"closures": {"jaw_rotation": "tight"}},
        {"closures": {"jaw_rotation": math.nan}},
    ],
)
def test_settings_that_cannot_be_are_refused(setting):
    with pytest.raises(ConfigurationError):
        Cart(**setting).fit(corpus(rounded_ahead, count=1))


def test_who_resists_is_learned_where_it_is_asked_for():
    """S keeps its target whatever is beside it; the others vary."""

    def rule(phones, i):
        own = phones[i].phone
        free = 0.5 * ((neighbour(phones, i, -1) in ("A", "P", "L")) + 0.1 * i % 1)
        return 0.3 if own == "S" else free, 0.0, 0.0

    spoken = corpus(rule, count=30, noise=0.02)
    found = Cart(resistance="learned").fit(spoken)
    names = np.array(found.alphabet.list_names())
    assert names[found._reader.resistant[:, 0]].tolist() == ["S"]
    by_set = Cart().fit(spoken)
    assert set(names[by_set._reader.resistant[:, 0]]) == {
        name
        for name in set(spoken.utterances[0].read_phones().phones) | {"F", "M", "B", "P", "T", "L"}
        if SWEDISH.is_resistant(name, "jaw_rotation")
    }
    # Of a parameter that the phone set knows nothing of it is always learned.
    other = Cart().fit(corpus(rule, count=30, noise=0.02, names=("pc1", "pc2", "pc3")))
    assert names[other._reader.resistant[:, 0]].tolist() == ["S"]


def test_pruning_takes_away_what_noise_has_grown():
    """No question tells anything: what remains is the phone."""
    rng = np.random.default_rng(9)
    noise = corpus(lambda phones, i: rng.normal(0, 1, 3), count=60)
    wild = Cart(min_impurity_decrease=0.0, pruning="none", phone_order="node").fit(noise)
    tame = Cart().fit(noise)
    count = len(tame.trees_)
    assert wild.parameter_count > 10 * count
    assert tame.parameter_count < 1.3 * count
    strict = Cart(one_standard_error=True).fit(noise)
    assert strict.parameter_count <= tame.parameter_count
    each = Cart(pruning="each").fit(noise)
    assert each.parameter_count < 0.5 * wild.parameter_count
    assert tame.pruning_curve_.shape[1] == 2
    assert tame.ccp_alpha_ in tame.pruning_curve_[:, 0]


def test_trees_predict_what_means_of_phones_cannot():
    train, test = (corpus(rounded_ahead, count=30, seed=s, noise=0.05) for s in (1, 2))
    errors = {}
    for name, options in (("trees", {}), ("means", {"min_samples_leaf": 10**9})):
        found = Cart(**options).fit(train)
        off = [
            found.select_targets(u.read_phones()) - sample_targets(u.read_tracks(), u.read_phones())
            for u in test
        ]
        errors[name] = np.nanmean(np.concatenate(off) ** 2, axis=0)
    assert (errors["trees"][1:] < 0.35 * errors["means"][1:]).all()
    assert errors["trees"][0] < 1.05 * errors["means"][0]
