"""The rule-based model: what is specified is reached, what is not comes from the context."""

import dataclasses

import numpy as np
import pytest
from control_cases import spoken

from mocap_fit import control
from mocap_fit.control.rule_based import RuleBased, _HeldTarget, _to_line
from mocap_fit.control.rule_table import list_rule_languages, load_rules
from mocap_fit.errors import ConfigurationError
from mocap_fit.face import load_face
from mocap_fit.face.lips import compute_lip_gap
from mocap_fit.phones import (
    ARTICULATORY_PARAMETERS,
    PhoneSegment,
    PhoneSequence,
    list_phone_sets,
    load_phone_set,
)

# Sets that list their phones; the others compute them from their names.
LISTED = [name for name in list_phone_sets() if name not in ("ipa", "x-sampa")]
RATE = 100.0


@pytest.fixture(scope="module")
def gap():
    """A function: parameters `(frames, 10)` to the distance of the inner lips, mm, `(frames,)`."""
    face = load_face()
    assert face.parameter_names == ARTICULATORY_PARAMETERS
    return lambda values: compute_lip_gap(face, values)


def said(labels, phone_set, length=0.08) -> PhoneSequence:
    chosen = load_phone_set(phone_set)
    segments = []
    for position, label in enumerate(labels):
        phone, stress = chosen.parse(label)
        segments.append(PhoneSegment(position * length, (position + 1) * length, phone, stress))
    return PhoneSequence(tuple(segments), phone_set=chosen.name, name="said")


def frames_of(model, phones, position):
    segment = phones[position]
    times = np.arange(segment.start, segment.end, 1 / RATE)
    return model.predict_at(phones, times)


@pytest.mark.parametrize("name", LISTED)
def test_bilabials_close_the_lips_on_every_one(name, gap):
    phone_set = load_phone_set(name)
    model = RuleBased().prepare(name)
    vowels = [p.symbol for p in phone_set.phones if p.kind == "vowel"]
    long = [said([phone_set.silence, v, phone_set.silence], name, 0.2) for v in vowels]
    centres = [model.predict_at(phones, np.array([0.3]))[0] for phones in long]
    widest = gap(np.array(centres)).max()
    assert widest > 8.0
    closed = [p.symbol for p in phone_set.phones if "bilabial_stop" in p.get_classes()]
    assert len(closed) >= 3
    for symbol in closed:
        for vowel in vowels[::4]:
            for length in (0.03, 0.08):
                phones = said([vowel, symbol, vowel], name, length)
                gaps = gap(frames_of(model, phones, 1))
                assert gaps.min() < 0.1 * widest, (vowel, symbol, length)
                assert gaps.min() < 0.9, (vowel, symbol, length)


@pytest.mark.parametrize("name", LISTED)
def test_labiodentals_bring_the_lower_lip_to_the_teeth(name, gap):
    phone_set = load_phone_set(name)
    model = RuleBased().prepare(name)
    at = {n: k for k, n in enumerate(ARTICULATORY_PARAMETERS)}
    open_vowel = max(
        (p for p in phone_set.phones if p.kind == "vowel"), key=lambda p: p.values["open"]
    )
    for phone in phone_set.phones:
        if "labiodental" not in phone.get_classes():
            continue
        phones = said([open_vowel.symbol, phone.symbol, open_vowel.symbol], name)
        centre = model.predict_at(phones, np.array([phones[1].centre]))[0]
        # Drawn in and up, under an upper lip that is lifted, with the jaw nearly closed; not shut.
        assert centre[at["lower_lip_retraction"]] > 0.4
        assert centre[at["lower_lip_depression"]] < 0
        assert centre[at["upper_lip_raise"]] > 0.1
        assert centre[at["jaw_rotation"]] < 0.2
        assert 0.5 < gap(centre[None])[0] < 4.0


@pytest.mark.parametrize("name", LISTED)
def test_open_vowels_open_and_rounded_ones_round(name):
    phone_set = load_phone_set(name)
    model = RuleBased().prepare(name)
    single = [
        p for p in phone_set.phones if p.kind == "vowel" and len(model.table_.get_parts(p)) == 1
    ]
    jaw, rounding = [], []
    for phone in single:
        phones = said([phone_set.silence, phone.symbol, phone_set.silence], name, 0.2)
        row = model.predict_at(phones, np.array([phones[1].centre]))[0]
        jaw.append(row[0])
        rounding.append(row[1])
    opens = [phone.values["open"] for phone in single]
    assert np.corrcoef(opens, jaw)[0, 1] > 0.9
    rounded = np.array([phone.values["rounded"] for phone in single])
    assert np.array(rounding)[rounded > 0.5].min() > np.array(rounding)[rounded <= 0].max() + 0.2


def test_what_is_not_specified_goes_from_context_to_context():
    """V1 CCC V2 with V1 spread and V2 rounded, the paper's example (section 1.2)."""
    model = RuleBased().prepare("sv-sta")
    phones = said(["I:", "S", "T", "K", "O:"], "sv-sta", 0.1)
    rounding = ARTICULATORY_PARAMETERS.index("lip_rounding")
    times = np.linspace(0.05, 0.45, 41)
    track = model.predict_at(phones, times)[:, rounding]
    assert track[0] < 0 < 0.8 < track[-1]
    assert (np.diff(track) >= -1e-12).all()
    # A straight line over the consonants, where the smoothing changes nothing.
    inside = (times > 0.12) & (times < 0.38)
    assert np.abs(np.diff(track[inside], 2)).max() < 1e-9


def test_parameters_that_nothing_specifies_rest(trained):
    model = trained("rule-based")
    shift = ARTICULATORY_PARAMETERS.index("jaw_shift")
    assert not model.predict(said(["A:", "P"], "sv-sta")).values[:, shift].any()
    other = RuleBased().prepare("sv-sta", ("brow", "jaw_rotation"))
    tracks = other.predict(said(["A:", "P"], "sv-sta"))
    assert tracks.names == ("brow", "jaw_rotation")
    assert not tracks.values[:, 0].any()
    assert tracks.values[:, 1].any()


def test_movements_are_smooth():
    phones = spoken("sil S T R 'Å: P A F 'A N sil", 4)
    values = RuleBased().prepare("sv-sta").predict(phones, 1000.0).values
    speed = np.abs(np.diff(values, axis=0)) * 1000
    assert speed.max() < 20.0
    assert np.abs(np.diff(values, 2, axis=0)).max() < 0.2 * np.abs(np.diff(values, axis=0)).max()


def test_vowels_without_stress_move_less():
    model = RuleBased().prepare("sv-sta")
    stressed, unstressed, unmarked = (
        said(["sil", label, "sil"], "sv-sta", 0.2) for label in ("'A:", "A:", "A:")
    )
    flat = tuple(dataclasses.replace(s, stress=0) for s in unstressed)
    jaws = [
        model.predict_at(phones, np.array([0.3]))[0, 0]
        for phones in (stressed, unstressed.replace(segments=flat), unmarked)
    ]
    assert jaws[0] == jaws[2]
    assert 0.5 * jaws[0] < jaws[1] < 0.95 * jaws[0]
    deaf = RuleBased(stress=False).prepare("sv-sta")
    assert deaf.predict_at(unstressed.replace(segments=flat), np.array([0.3]))[0, 0] == jaws[0]


def test_a_diphthong_moves_from_one_target_to_the_other():
    model = RuleBased().prepare("en-arpabet")
    phones = said(["sil", "AW1", "sil"], "en-arpabet", 0.3)
    rounding = model.predict_at(phones, np.array([0.375, 0.525]))[:, 1]
    jaw = model.predict_at(phones, np.array([0.375, 0.525]))[:, 0]
    assert rounding[1] > rounding[0] + 0.5
    assert jaw[0] > jaw[1] + 0.15


def test_every_sound_of_the_languages_tables_is_one_that_the_sets_have():
    assert list_rule_languages() == ("cs", "en", "sv")
    for name in LISTED:
        phone_set = load_phone_set(name)
        table = load_rules(phone_set)
        for phone in phone_set.phones:
            if phone.ipa:
                assert table.get_parts(phone) in table.phones.values(), phone.symbol


def test_other_languages_are_looked_up_by_features():
    own = dataclasses.replace(load_phone_set("sv-sta"), language="fi")
    model = RuleBased().prepare(own)
    assert not model.table_.phones
    phones = said(["A", "P", "A"], "sv-sta")
    jaw, depression = (
        ARTICULATORY_PARAMETERS.index(n) for n in ("jaw_rotation", "lower_lip_depression")
    )
    row = model.predict_at(phones, np.array([phones[1].centre]))[0]
    assert row[jaw] == pytest.approx(0.12)
    assert row[depression] == pytest.approx(-0.38)


def test_ready_needs_no_corpus_and_keeps_what_it_is_told(tmp_path):
    model = control.create("rule-based").prepare("cs-sampa", rate=25.0)
    assert model.is_fitted
    assert model.parameter_count == 0
    tracks = model.predict(said(["a", "p", "a"], "cs-sampa"))
    assert tracks.rate == 25.0
    model.save(tmp_path / "model.npz")
    loaded = control.load(tmp_path / "model.npz")
    again = loaded.predict(said(["a", "p", "a"], "cs-sampa"))
    np.testing.assert_array_equal(again.values, tracks.values)


def test_a_table_of_ones_own(tmp_path):
    file = tmp_path / "own.toml"
    file.write_text(
        'columns = ["jaw_rotation", "brow"]\nwindow = 0.01\n[phones]\n'
        '"a" = [0.9, "-"]\n"p" = ["!0.1", 1.0]\n"aʊ" = [[0.9, 0.0], [0.2, 1.0]]\n',
        encoding="utf-8",
    )
    model = RuleBased(rules=str(file)).prepare("sv-sta", ("jaw_rotation", "brow"))
    row = model.predict_at(said(["A", "P", "A"], "sv-sta"), np.array([0.04, 0.12]))
    np.testing.assert_allclose(row, [[0.9, 1.0], [0.1, 1.0]], atol=1e-9)
    moving = model.predict_at(said(["AU"], "sv-sta", 0.4), np.array([0.1, 0.3]))
    np.testing.assert_allclose(moving, [[0.9, 0.0], [0.2, 1.0]], atol=1e-9)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("columns = [", "not TOML"),
        ('columns = ["x"]\n[phones]\n"a" = [1.0, 2.0]\n', "2 targets for 1 columns"),
        ('columns = ["x"]\n[phones]\n"a" = ["open"]\n', "no number"),
        ('columns = ["x"]\n[phones]\n"a" = [nan]\n', "a"),
        ("window = -1.0\n", "window"),
        ("colour = 1\n", "colour"),
        ('[phones]\n"a" = 1.0\n', "a"),
        ('columns = ["x"]\n[phones]\n"a" = [[1.0], 2.0]\n', "a"),
        ('columns = ["x"]\n[phones]\n"a" = ["!inf"]\n', "a"),
    ],
)
def test_a_wrong_table_is_refused_with_its_place(tmp_path, text, told):
    file = tmp_path / "own.toml"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(ConfigurationError, match=rf"own\.toml[\s\S]*{told}|{told}[\s\S]*own\.toml"):
        RuleBased(rules=str(file)).prepare("sv-sta")


def test_a_table_that_is_not_there_is_refused(tmp_path):
    with pytest.raises(FileNotFoundError, match="no such table"):
        RuleBased(rules=str(tmp_path / "none.toml")).prepare("sv-sta")


def test_smoothing_is_a_raised_cosine_as_wide_as_the_window(tmp_path):
    # A step of two targets that are reached: the integral of (1 + cos(pi x)) / 2.
    file = tmp_path / "own.toml"
    file.write_text(
        'columns = ["x"]\nwindow = 0.05\nhold = 1.0\n[phones]\n"a" = [0.0]\n"s" = [1.0]\n',
        encoding="utf-8",
    )
    model = RuleBased(rules=str(file)).prepare("sv-sta", ("x",))
    phones = said(["A", "S"], "sv-sta", 0.4)
    border = phones[1].start
    x = np.linspace(-1.3, 1.3, 27)
    inside = np.clip(x, -1.0, 1.0)
    wanted = 0.5 * (inside + 1.0) + np.sin(np.pi * inside) / (2 * np.pi)
    values = model.predict_at(phones, border + 0.05 * x)[:, 0]
    np.testing.assert_allclose(values, wanted, atol=0.065)
    assert values[0] == pytest.approx(0.0, abs=1e-12)
    assert values[-1] == pytest.approx(1.0)
    # Its points are 1/8 apart, and its shares those of the cosine there.
    points = np.arange(-7, 8) / 8
    shares = (1 + np.cos(np.pi * points)) / 16
    for at in (-0.5, 0.3):
        share = shares[at + points > 0].sum()
        found = model.predict_at(phones, np.array([border + 0.05 * at]))[0, 0]
        assert found == pytest.approx(share, abs=1e-9)


def test_a_target_is_held_for_its_share_of_the_phone_with_lines_between(tmp_path):
    file = tmp_path / "own.toml"
    file.write_text(
        'columns = ["x"]\nwindow = 0.001\nhold = 0.5\n[phones]\n"a" = [0.0]\n"s" = [1.0]\n',
        encoding="utf-8",
    )
    model = RuleBased(rules=str(file)).prepare("sv-sta", ("x",))
    phones = said(["A", "S", "A"], "sv-sta", 0.4)
    start = phones[1].start
    # Held from 0.1 to 0.3 s of a phone; straight from 0.3 s of the one before.
    times = start + np.array([-0.15, -0.1, 0.0, 0.05, 0.1, 0.2, 0.3, 0.35, 0.4, 0.5])
    wanted = [0, 0, 0.5, 0.75, 1, 1, 1, 0.75, 0.5, 0]
    np.testing.assert_allclose(model.predict_at(phones, times)[:, 0], wanted, atol=3e-3)


def test_vowels_without_stress_move_less_by_the_share_of_the_table(tmp_path):
    file = tmp_path / "own.toml"
    file.write_text(
        'columns = ["x"]\nwindow = 0.001\nhold = 1.0\nunstressed = 0.6\n[phones]\n"a" = [2.0]\n',
        encoding="utf-8",
    )
    for stress, level, wanted in (
        (True, 0, 1.2),
        (True, 1, 2.0),
        (True, None, 2.0),
        (False, 0, 2.0),
    ):
        model = RuleBased(rules=str(file), stress=stress).prepare("sv-sta", ("x",))
        phones = PhoneSequence((PhoneSegment(0.0, 0.4, "A", level),), phone_set="sv-sta", name="u")
        assert model.predict_at(phones, np.array([0.2]))[0, 0] == pytest.approx(wanted)


def held(start, end, value, reach, centre=None):
    return _HeldTarget(start, end, 0.5 * (start + end) if centre is None else centre, value, reach)


@pytest.mark.parametrize(
    ("targets", "knots", "values"),
    [
        # What does not overlap stays; what touches changes in an instant.
        ([held(0, 1, 5, False), held(2, 3, 6, True)], [0, 1, 2, 3], [5, 5, 6, 6]),
        ([held(0, 1, 5, False), held(1, 3, 6, False)], [0, 1, 1, 3], [5, 5, 6, 6]),
        # One that is to be reached cuts what another one holds,
        ([held(0, 2, 5, False), held(1.5, 3.5, 6, True)], [0, 1.5, 1.5, 3.5], [5, 5, 6, 6]),
        ([held(0, 2, 5, True), held(1.5, 3.5, 6, False)], [0, 2, 2, 3.5], [5, 5, 6, 6]),
        # and takes its place where it covers its centre.
        ([held(0, 2, 5, False), held(1, 3, 6, True)], [1, 3], [6, 6]),
        ([held(0, 2, 5, False), held(1.01, 3, 6, True)], [0, 1.01, 1.01, 3], [5, 5, 6, 6]),
        ([held(0, 2.5, 5, True), held(1.5, 3.5, 6, False)], [0, 2.5], [5, 5]),
        ([held(0, 2.4, 5, True), held(1.5, 3.5, 6, False)], [0, 2.4, 2.4, 3.5], [5, 5, 6, 6]),
        # Two of a kind share the time that both want,
        ([held(0, 2.4, 5, True, 1), held(1.6, 4, 6, True, 3)], [0, 2, 2, 4], [5, 5, 6, 6]),
        ([held(0, 2.4, 5, False, 1), held(1.6, 4, 6, False, 3)], [0, 2, 2, 4], [5, 5, 6, 6]),
        # but not beyond their centres.
        ([held(0, 10, 5, True, 1), held(0.5, 4, 6, True, 2)], [0, 2, 2, 4], [5, 5, 6, 6]),
        ([held(0, 4, 5, True, 3), held(0.5, 9, 6, True, 5)], [0, 3, 3, 9], [5, 5, 6, 6]),
        # One may cover several.
        (
            [held(0, 1, 4, False), held(1, 2, 5, False), held(0.6, 5, 6, True)],
            [0, 0.6, 0.6, 5],
            [4, 4, 6, 6],
        ),
    ],
)
def test_targets_that_overlap_share_their_time(targets, knots, values):
    found, heights = _to_line(targets)
    np.testing.assert_allclose(found, knots, atol=2e-9)
    np.testing.assert_array_equal(heights, values)
    assert (np.diff(found) > 0).all()
