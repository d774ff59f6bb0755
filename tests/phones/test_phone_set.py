"""The phone sets: what they hold, and what is refused."""

import copy
import dataclasses
import itertools
import json
import pickle
import re
import sys
import unicodedata

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mocap_fit.errors import ConfigurationError, DataError, FileFormatError, MissingExtraError
from mocap_fit.phones import (
    ARTICULATORY_PARAMETERS,
    FEATURE_NAMES,
    QUESTION_CLASSES,
    Phone,
    PhoneSegment,
    list_phone_sets,
    load_phone_set,
)
from mocap_fit.phones.computed import _load_feature_table, _split_sounds

TABLES = ("cs-ipa", "cs-sampa", "en-arpabet", "sv-sta")
SETS = {name: load_phone_set(name) for name in TABLES}
every_table = pytest.mark.parametrize("name", TABLES)
FEATURE = {name: i for i, name in enumerate(FEATURE_NAMES)}


def segment(phone: str, stress: int | None = None) -> PhoneSegment:
    return PhoneSegment(0.0, 0.1, phone, stress)


def test_the_shipped_sets_are_these():
    assert list_phone_sets() == ("cs-ipa", "cs-sampa", "en-arpabet", "ipa", "sv-sta", "x-sampa")


def test_swedish_has_the_76_symbols_of_the_paper():
    swedish = SETS["sv-sta"]
    symbols = swedish.list_symbols(stress=True)
    assert len(symbols) == 76
    assert sum(swedish.is_vowel(symbol) for symbol in symbols) == 48
    assert sum(swedish.is_consonant(symbol) for symbol in symbols) == 27
    assert [symbol for symbol in symbols if swedish.is_silence(symbol)] == ["sil"]
    assert len(swedish.list_symbols(stress=False)) == 24 + 27 + 1


@pytest.mark.parametrize(
    ("name", "with_stress", "without"),
    [("en-arpabet", 15 * 3 + 24 + 1, 40), ("cs-sampa", 13 * 2 + 33, 46), ("cs-ipa", 59, 46)],
)
def test_numbers_of_symbols(name, with_stress, without):
    assert len(SETS[name].list_symbols(True)) == with_stress
    assert len(SETS[name].list_symbols(False)) == without


@every_table
@pytest.mark.parametrize("stress", [True, False])
def test_every_symbol_has_features_of_its_own_in_range(name, stress):
    phone_set = SETS[name]
    symbols = phone_set.list_symbols(stress)
    assert len(set(symbols)) == len(symbols)
    rows = np.array([phone_set.get_features(symbol) for symbol in symbols])
    assert rows.shape == (len(symbols), len(FEATURE_NAMES)) == (len(symbols), 17)
    vowel_features = [FEATURE[n] for n in ("open", "front", "rounded", "protruded")]
    others = [i for i in range(17) if i not in vowel_features]
    assert np.all(np.abs(rows[:, vowel_features]) <= 1)
    assert np.all((rows[:, others] >= 0) & (rows[:, others] <= 1))
    # Beskow section 4.4: the features describe the phone uniquely.
    assert len({tuple(row) for row in rows}) == len(symbols)
    assert not rows[symbols.index(phone_set.silence)].any()


@every_table
def test_phones_are_of_one_class_and_say_what_they_sound_like(name):
    phone_set = SETS[name]
    for phone in phone_set.phones:
        kinds = (phone_set.is_vowel, phone_set.is_consonant, phone_set.is_silence)
        assert sum(is_kind(phone.symbol) for is_kind in kinds) == 1
        assert phone_set.get_classes(phone.symbol) <= set(QUESTION_CLASSES)
        has_ipa = phone.kind != "silence" and not phone.values["release"]
        assert bool(phone.ipa) == has_ipa
        assert bool(phone.example) == has_ipa


@every_table
@given(data=st.data())
def test_a_stress_comes_back_from_its_symbol(name, data):
    phone_set = SETS[name]
    phone = data.draw(st.sampled_from([p.symbol for p in phone_set.phones]))
    stress = data.draw(st.sampled_from([None, 0, 1, 2]))
    symbol = phone_set.get_symbol(segment(phone, stress))
    assert symbol in phone_set.list_symbols(True)
    again, level = phone_set.parse(symbol)
    assert again == phone
    assert phone_set.get_symbol(segment(again, level)) == symbol
    assert phone_set.get_symbol(segment(phone, stress), stress=False) == phone
    np.testing.assert_array_equal(
        phone_set.get_features(symbol), phone_set.get_features(segment(phone, stress))
    )


def test_stress_is_read_as_each_set_writes_it():
    assert SETS["en-arpabet"].parse("AA1") == ("AA", 1)
    assert SETS["en-arpabet"].parse("aa0") == ("AA", 0)
    assert SETS["en-arpabet"].parse("AA") == ("AA", None)
    assert SETS["en-arpabet"].parse("T1") is None
    assert SETS["sv-sta"].parse("'A:") == ("A:", 1)
    assert SETS["sv-sta"].parse('"A:') == ("A:", 1)
    assert SETS["sv-sta"].parse("`A:") == ("A:", 2)
    assert SETS["sv-sta"].parse("A:") == ("A:", None)
    assert SETS["sv-sta"].parse("'") is None
    assert SETS["sv-sta"].get_symbol(segment("A:", 2)) == "'A:"
    assert SETS["en-arpabet"].get_features("AA2")[-1] == 0.5
    assert SETS["en-arpabet"].get_features("AA1")[-1] == 1


@every_table
@pytest.mark.parametrize("label", ["", "sil", "sp", "pau", "#", "_", " "])
def test_silence_has_many_spellings(name, label):
    assert SETS[name].parse(label) == (SETS[name].silence, None)
    assert SETS[name].get_classes(label) == {"no_speech"}


def test_a_letter_with_a_ring_is_one_letter_however_it_is_coded():
    apart = unicodedata.normalize("NFD", "Å:")
    assert apart != "Å:"
    assert SETS["sv-sta"].parse(apart) == ("Å:", None)


def test_the_classes_are_those_of_phonetics():
    english, swedish = SETS["en-arpabet"], SETS["sv-sta"]
    stops = [p.symbol for p in english.phones if "bilabial_stop" in p.get_classes()]
    assert stops == ["P", "B", "M"]
    assert [p.symbol for p in english.phones if "labiodental" in p.get_classes()] == ["F", "V"]
    fricatives = {p.symbol for p in english.phones if "fricative" in p.get_classes()}
    assert fricatives == {"CH", "JH", "F", "V", "TH", "DH", "S", "Z", "SH", "ZH", "HH"}
    assert "bilabial_stop" not in swedish.get_classes("p"), "a release opens the lips"


def test_who_resists_what():
    swedish = SETS["sv-sta"]
    for phone in "PBM":
        assert swedish.is_resistant(phone, "upper_lip_raise")
        assert swedish.is_resistant(phone, "lower_lip_depression")
        assert not swedish.is_resistant(phone, "lip_rounding")
    assert swedish.is_resistant("O:", "lip_rounding")
    assert swedish.is_resistant("Y:", "upper_lip_retraction")
    assert not swedish.is_resistant("I:", "lip_rounding")
    assert swedish.is_resistant("I:", "left_corner_stretch")
    assert swedish.is_resistant("S", "jaw_rotation")
    assert not swedish.is_resistant("K", "jaw_rotation")
    assert SETS["en-arpabet"].is_resistant("SH", "lower_lip_retraction")
    assert not any(swedish.is_resistant("sil", name) for name in ARTICULATORY_PARAMETERS)
    with pytest.raises(DataError, match="no articulatory parameter 'smile'"):
        swedish.is_resistant("P", "smile")


@pytest.mark.parametrize(
    ("values", "resists"),
    [
        ({"rounded": 0.6}, {"lip_rounding"}),
        ({"rounded": 0.59}, set()),
        ({"rounded": -0.6}, {"left_corner_stretch", "right_corner_stretch"}),
        ({"rounded": -0.59}, set()),
        ({"protruded": 0.6}, {"upper_lip_retraction", "lower_lip_retraction"}),
        ({"protruded": 0.59}, set()),
        ({"open": 0.7}, {"jaw_rotation"}),
        ({"open": 0.69}, set()),
        ({"bilabial": 1, "nasal": 1}, {"upper_lip_raise", "lower_lip_depression"}),
        ({"bilabial": 1}, set()),
        ({"stop": 1, "velar": 1}, set()),
        ({"labiodental": 1}, {"lower_lip_retraction", "lower_lip_depression"}),
        ({"fricative": 1, "retroflex": 1}, {"jaw_rotation", "jaw_thrust"}),
        ({"fricative": 1, "dental": 1}, set()),
        ({"alveolar": 1}, set()),
    ],
)
def test_resistance_follows_from_the_features(values, resists):
    assert Phone("x", "consonant", values).resists == resists


@pytest.mark.parametrize("name", [*TABLES, "ipa"])
def test_sets_are_copied_pickled_and_compared(name):
    phone_set = load_phone_set(name)
    for other in (
        load_phone_set(name),
        copy.deepcopy(phone_set),
        pickle.loads(pickle.dumps(phone_set)),
        type(phone_set).from_dict(json.loads(json.dumps(phone_set.to_dict()))),
    ):
        assert other == phone_set
        assert other.parse("") == (phone_set.silence, None)
    assert phone_set != dataclasses.replace(phone_set, language="xx")
    phone = phone_set.phones[1]
    assert phone != dataclasses.replace(phone, values={"voiced": 0.5})
    with pytest.raises(TypeError):
        phone.values["voiced"] = 1.0


def test_sets_print_shortly(ipa):
    assert repr(SETS["sv-sta"]) == "<PhoneSet sv-sta (sv): 52 phones>"
    assert repr(ipa).endswith("and any sound in IPA>")


def test_czech_sampa_and_ipa_are_the_same_phones():
    for ipa, sampa in zip(SETS["cs-ipa"].phones, SETS["cs-sampa"].phones, strict=True):
        assert (ipa.values, ipa.ipa, ipa.resists) == (sampa.values, sampa.ipa, sampa.resists)


def test_a_phone_that_is_not_there_is_named():
    with pytest.raises(DataError, match="'sv-sta' has no phone 'QX'"):
        SETS["sv-sta"].get_features("QX")


def test_a_set_of_some_phones():
    few = SETS["sv-sta"].select(["A:", "P", "'A:"])
    assert few.list_symbols(True) == ("sil", "A:", "'A:", "P")


# --- computed from panphon


@pytest.fixture(scope="module")
def ipa():
    pytest.importorskip("panphon")
    return load_phone_set("ipa")


def test_any_sound_has_features_in_range(ipa):
    for symbol in ["a", "yː", "ˈø", "t͡s", "tʃ", "b̥", "ɓ", "ŋ", "ʂ", "ɕ", "ǃ", "kʷ", "aɪ", "q", "ɦ"]:
        row = ipa.get_features(symbol)
        assert row.shape == (17,)
        assert np.all(np.abs(row) <= 1)
        assert row.any()


@pytest.mark.parametrize("name", TABLES)
def test_what_is_computed_agrees_with_the_tables(ipa, name):
    """Of each sound of the tables: the class, and which places and manners are there."""
    place = slice(FEATURE["bilabial"], FEATURE["velar"] + 1)
    differ = []
    for phone in SETS[name].phones:
        if not phone.ipa:
            continue
        table, computed = phone.get_features(), ipa.get_phone(phone.ipa[0]).get_features()
        assert table[0] == computed[0], phone.symbol
        classes = ipa.get_phone(phone.ipa[0]).get_classes()
        # Swedish J is said with friction, which IPA j has not.
        if (name, phone.symbol) != ("sv-sta", "J"):
            assert classes == phone.get_classes(), phone.symbol
        assert np.abs(table - computed)[FEATURE["open"] : FEATURE["stress"]].max() <= 0.6
        if np.abs(table - computed)[place].max() > 0.5:
            differ.append(phone.symbol)
    # IPA writes dentals and alveolars alike; TJ is a sibilant without being alveolar.
    assert differ == {"sv-sta": ["T", "D", "N", "S", "TJ", "L"]}.get(name, [])


@pytest.mark.parametrize("label", ["!", "abc", "tt", "nd", "pt", "ˈ", "a˥", "˥", "ʲ", "1"])
def test_what_is_not_one_sound_is_not_a_phone(ipa, label):
    assert ipa.parse(label) is None


@pytest.mark.parametrize("label", ["k͡p", "ɡ͡b", "ŋ͡m", "kp", "gb", "ɡ͡bʷ"])
def test_two_closures_at_once_close_the_lips(ipa, label):
    assert "bilabial_stop" in ipa.get_classes(label)
    assert ipa.get_phone(label).values["velar"] == 1
    assert ipa.is_resistant(label, "lower_lip_depression")


@pytest.mark.parametrize("label", ["s", "z", "ʃ", "ʒ", "ʂ", "ʐ", "ɕ", "ʑ", "s̻", "tɕ", "d͡ʑ", "sʲ"])
def test_sibilants_keep_the_teeth_together(ipa, label):
    assert "fricative" in ipa.get_classes(label)
    assert ipa.is_resistant(label, "jaw_rotation")
    assert not ipa.is_resistant("ç", "jaw_rotation")


@pytest.mark.parametrize("label", ["ʂ", "ʐ", "ʈ͡ʂ", "ɖʐ"])
def test_retroflex_sibilants_are_rounded_as_in_swedish(ipa, label):
    swedish, computed = SETS["sv-sta"].get_phone("2S").values, ipa.get_phone(label).values
    for name in ("rounded", "protruded", "retroflex", "alveolar"):
        assert computed[name] == swedish[name]


@pytest.mark.slow
def test_the_table_is_that_of_panphon():
    import panphon

    table, peer = _load_feature_table(), panphon.FeatureTable()
    assert table == {letters: dict(sound.data) for letters, sound in peer.segments}
    letters = [chr(c) for c in range(0x250, 0x2B0)] + list("abkptsʰʲː\u0303")
    words = ["".join(chosen) for chosen in itertools.product(letters, repeat=2)]
    for word in words:
        parts = peer.ipa_segs(word)
        assert _split_sounds(word, table) == (parts if "".join(parts) == word else [])


def test_sounds_that_panphon_has_elsewhere(ipa):
    values = {label: ipa.get_phone(label).values for label in ("ɐ", "ə", "a", "ɮ", "ɬ", "ʃʲ", "ʃ")}
    assert values["ə"]["open"] < values["ɐ"]["open"] < values["a"]["open"]
    assert (values["ɮ"]["alveolar"], values["ɮ"]["retroflex"]) == (1, 0)
    assert {**values["ɮ"], "voiced": 0} == dict(values["ɬ"])
    assert values["ʃʲ"]["protruded"] == values["ʃ"]["protruded"]


@pytest.mark.parametrize(
    ("label", "ipa_letter"),
    [
        ("ε", "ɛ"),
        ("Φ", "ɸ"),
        ("φ", "ɸ"),
        ("γ", "ɣ"),
        ("δ", "ð"),
        ("ꞵ", "β"),
        ("ꭓ", "χ"),
        ("α", "ɑ"),
    ],
)
def test_greek_letters_stand_for_ipa(ipa, label, ipa_letter):
    assert ipa.get_phone(label).symbol == ipa.get_phone(ipa_letter).symbol
    assert ipa.parse(label + "ː") == ipa.parse(ipa_letter + "ː")


def test_pressed_lips_are_a_little_rounded(ipa):
    values = ipa.get_phone("ɯᵝ").values
    assert ipa.get_phone("ɯ").values["rounded"] < values["rounded"] < 0.6


def test_two_ways_to_code_a_sound_are_one_symbol(ipa):
    assert ipa.parse("g") == ipa.parse("ɡ") == ("ɡ", None)
    assert ipa.get_phone("e:").symbol == "eː"


def test_the_symbols_of_all_languages_have_no_end(ipa):
    with pytest.raises(DataError, match="cannot be listed"):
        ipa.list_symbols()
    few = ipa.select(["b", "a", "ˈa", "t͡s"])
    assert few.list_symbols(False) == ("sil", "a", "b", "t͡s")
    assert few.list_symbols(True) == ("sil", "a", "ˈa", "ˌa", "b", "t͡s")
    assert few.parse("d") is None


def test_without_panphon_the_extra_is_named(monkeypatch):
    _load_feature_table.cache_clear()
    monkeypatch.setitem(sys.modules, "panphon", None)
    ipa = load_phone_set("ipa")
    assert ipa.parse("ɝ") == ("ɝ", None), "what is listed needs no panphon"
    with pytest.raises(MissingExtraError, match=re.escape("pip install 'mocap-fit[speech]'")):
        ipa.parse("a")


# --- a user's own file

OWN = """
language = "xx"
[silence]
symbol = "sil"
[stress]
position = "before"
levels = [0, 1]
primary = ["'"]
[vowels]
a = { open = 1, front = 0, rounded = 0, protruded = 0, ipa = "a", also = ["A"] }
[consonants]
m = { kind = "bilabial nasal voiced", ipa = "m", resists = ["jaw_shift"] }
"""


def test_a_file_of_ones_own(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text(OWN, encoding="utf-8")
    mine = load_phone_set(path)
    assert mine.name == "mine"
    assert mine.list_symbols() == ("sil", "a", "'a", "m")
    assert mine.parse("'A") == ("a", 1)
    assert mine.get_phone("m").resists == {"jaw_shift"}


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("[vowels]", "[vowels", "not TOML"),
        (OWN, "a = " + "[" * 5000, "not TOML"),
        (OWN, "", "silence: this is missing"),
        (OWN, '[silence]\nsymbol = "sil"', "there are no phones"),
        ("open = 1,", "", "vowels.a.open: this is missing"),
        ("open = 1", "open = 1.5", "vowels.a.open"),
        ("open = 1", "open = nan", "vowels.a.open"),
        ("open = 1", 'open = "wide"', "vowels.a.open"),
        ("bilabial nasal", "bilabail nasal", "consonants.m.kind: there is no feature 'bilabail'"),
        ("jaw_shift", "jaw", "consonants.m.resists: there is no parameter 'jaw'"),
        ("kind =", "sort =", "consonants.m.sort: there is no such setting"),
        ("[consonants]", "[consonant]", "consonant: there is no such setting"),
        ('symbol = "sil"', 'symbol = ""', "silence.symbol"),
        ('symbol = "sil"', 'symbol = "a"', "'a' of the phone set 'mine' stands for two phones"),
        ('"A"', '"m"', "'m' of the phone set 'mine' stands for two phones"),
        ("m = {", '"\'a" = {', "'a"),
        ('ipa = "m"', 'ipa = "a"', "have the same ipa 'a'"),
        ("levels = [0, 1]", "levels = [1]", "levels are"),
        ("levels = [0, 1]", "levels = [0, 1, 2]", "level 2 has no mark"),
        ('primary = ["\'"]', 'primary = [""]', "two levels of stress"),
        ('primary = ["\'"]', 'primary = ["\'"]\nsecondary = ["\'"]', "two levels of stress"),
        ('"before"', '"above"', "stress.position"),
    ],
)
def test_a_bad_file_is_refused_in_words(tmp_path, old, new, message):
    assert old in OWN
    path = tmp_path / "mine.toml"
    path.write_text(OWN.replace(old, new), encoding="utf-8")
    with pytest.raises(ConfigurationError, match=re.escape(message)) as refusal:
        load_phone_set(path)
    assert "mine.toml" in str(refusal.value)


def test_files_that_cannot_be_read(tmp_path):
    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe\x00")
    for path in (tmp_path, tmp_path / "none.toml", tmp_path / "binary.toml", "sv-sat", "a\0b"):
        with pytest.raises(FileFormatError, match=r"(cannot be read|no such).*sv-sta"):
            load_phone_set(path)


def test_the_files_say_how_to_extend_them():
    from importlib import resources

    for name in list_phone_sets():
        text = (
            resources.files("mocap_fit.phones").joinpath("sets", f"{name}.toml").read_text("utf-8")
        )
        head = text[: text.index("\nname =")]
        assert "To extend" in head
        assert all(line.startswith("#") or not line for line in head.splitlines())
