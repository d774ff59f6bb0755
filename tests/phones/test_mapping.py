"""Labels read as phones of a set, and phones mapped from one set to another."""

import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mocap_fit.errors import DataError
from mocap_fit.phones import (
    Phone,
    PhoneSegment,
    PhoneSequence,
    PhoneSet,
    find_unknown_phones,
    load_phone_set,
    map_phones,
    normalise_phones,
)

TABLES = ("cs-ipa", "cs-sampa", "en-arpabet", "sv-sta")
SETS = {name: load_phone_set(name) for name in TABLES}


def sequence(*labels, phone_set="", name="u1", stress=None) -> PhoneSequence:
    segments = tuple(
        PhoneSegment(0.1 * i, 0.1 * (i + 1), label, stress) for i, label in enumerate(labels)
    )
    return PhoneSequence(segments, phone_set=phone_set, name=name)


def shared(source: str, target: str) -> list[str]:
    """Phones of a set whose own sound is also a phone's own sound in another."""
    main = {p.ipa[0] for p in SETS[target].phones if p.ipa}
    return [p.symbol for p in SETS[source].phones if p.ipa and p.ipa[0] in main]


@pytest.mark.parametrize("source", TABLES)
@pytest.mark.parametrize("target", TABLES)
def test_there_and_back_is_the_same_where_both_have_the_sound(source, target):
    phones = ["sil", *shared(source, target)]
    assert len(phones) > 12
    before = sequence(*phones, phone_set=source)
    there = map_phones(before, target)
    back = map_phones(there, source)
    assert back.phones == before.phones
    assert there.phone_set == target
    assert back.starts.tolist() == before.starts.tolist()
    assert [step.name for step in back.provenance] == ["map_phones", "map_phones"]


@given(st.lists(st.sampled_from([p.symbol for p in SETS["cs-sampa"].phones]), min_size=1))
def test_czech_goes_from_sampa_to_ipa_and_back(phones):
    before = sequence(*phones, phone_set="cs-sampa")
    assert map_phones(map_phones(before, "cs-ipa"), "cs-sampa").phones == tuple(phones)


def test_stress_goes_along_with_vowels():
    before = sequence("HH", "AA1", "T", "ER0", phone_set="en-arpabet")
    after = map_phones(before, "ipa", table={"ER": "ɚ"})
    assert after.phones == ("h", "ɑ", "t", "ɚ")
    assert [segment.stress for segment in after] == [None, 1, None, 0]


def test_a_sound_that_the_other_set_lacks_is_an_error_unless_the_nearest_is_asked_for():
    before = sequence("TH", "IH1", "S", "DH", "TH", phone_set="en-arpabet")
    with pytest.raises(DataError) as refusal:
        map_phones(before, "sv-sta")
    message = str(refusal.value)
    assert "2 symbols of 'en-arpabet' have no sound in the phone set 'sv-sta'" in message
    assert "'TH' 2× (u1 at 0.000 s, u1 at 0.400 s)" in message
    assert "'DH' 1× (u1 at 0.300 s)" in message
    near = map_phones(before, "sv-sta", nearest=True)
    assert near.phones == ("S", "I", "S", "S", "S")
    chosen = map_phones(before, "sv-sta", table={"TH": "T", "DH": "D"})
    assert chosen.phones == ("T", "I", "S", "D", "T")


@pytest.mark.parametrize("source", TABLES)
@pytest.mark.parametrize("target", TABLES)
def test_the_nearest_is_of_the_same_class(source, target):
    phones = [p.symbol for p in SETS[source].phones if not p.values["release"]]
    before = sequence(*phones, phone_set=source)
    after = map_phones(before, target, nearest=True)
    for phone, found in zip(before, after, strict=True):
        assert SETS[source].get_phone(phone).kind == SETS[target].get_phone(found).kind
        if source == target:
            assert phone.phone == found.phone


@pytest.mark.parametrize(
    ("source", "phone", "target", "nearest"),
    [
        ("en-arpabet", "Z", "sv-sta", "S"),
        ("sv-sta", "2T", "en-arpabet", "T"),
        ("sv-sta", "Y:", "en-arpabet", "UW"),
        ("en-arpabet", "TH", "cs-sampa", "s"),
        ("cs-sampa", "F", "en-arpabet", "V"),
        # Lips that are open do not close, whatever the tongue does.
        ("cs-ipa", "ʔ", "en-arpabet", "K"),
        ("cs-ipa", "x", "en-arpabet", "HH"),
        ("cs-ipa", "ɲ", "sv-sta", "NG"),
        # A voice decides between sounds that are alike in all else, and no more.
        ("cs-ipa", "ɟ", "sv-sta", "G"),
        ("cs-ipa", "d͡ʒ", "sv-sta", "2S"),
        ("cs-ipa", "z", "sv-sta", "S"),
        # The tip of the tongue at one place is like that at another, and unlike none.
        ("cs-ipa", "t͡s", "sv-sta", "S"),
        ("cs-ipa", "d͡z", "sv-sta", "D"),
        ("cs-ipa", "ʒ", "sv-sta", "2S"),
        ("sv-sta", "2L", "en-arpabet", "L"),
        # Vowels: front or back, long or short, one sound or two.
        ("en-arpabet", "AE", "cs-ipa", "ɛː"),
        ("sv-sta", "Ä4", "cs-ipa", "ɛ"),
        ("sv-sta", "Y:", "cs-ipa", "u"),
        ("sv-sta", "Ö4", "cs-ipa", "a"),
        ("en-arpabet", "AY", "sv-sta", "AU"),
        ("cs-ipa", "ou̯", "sv-sta", "AU"),
        ("cs-ipa", "r̝", "en-arpabet", "ZH"),
    ],
)
def test_the_nearest_looks_alike(source, phone, target, nearest):
    before = sequence(phone, phone_set=source)
    assert map_phones(before, target, nearest=True).phones == (nearest,)


@pytest.mark.parametrize("source", TABLES)
@pytest.mark.parametrize("target", TABLES)
def test_the_nearest_shows_the_same_closure_of_the_lips(source, target):
    consonants = [p for p in SETS[source].phones if p.kind == "consonant" and p.ipa]
    before = sequence(*(p.symbol for p in consonants), phone_set=source)
    after = map_phones(before, target, nearest=True)
    for phone, found in zip(consonants, after, strict=True):
        nearest = SETS[target].get_phone(found)
        lips = [max(p.values["bilabial"], p.values["labiodental"]) for p in (phone, nearest)]
        assert lips[0] == lips[1], (phone.symbol, nearest.symbol)


def test_a_release_joins_its_stop_where_there_are_none():
    before = sequence("P", "p", "'A:", "T", "t", "t", "sil", phone_set="sv-sta")
    after = map_phones(before.replace(segments=before.segments[:5]), "ipa")
    assert after.phones == ("p", "ɑː", "t")
    assert after.ends[0] == before.ends[1]
    alone = sequence("t", "A", phone_set="sv-sta")
    with pytest.raises(DataError, match="'t' 1×"):
        map_phones(alone, "ipa", nearest=True)


def test_the_set_that_phones_are_from_must_be_known():
    with pytest.raises(DataError, match="the phone set of 'u1' is not known"):
        map_phones(sequence("a"), "cs-ipa")
    assert map_phones(sequence("a"), "cs-ipa", source="cs-sampa").phones == ("a",)


def test_a_sound_of_its_own_wins_over_one_that_a_symbol_also_stands_for():
    silence = Phone("sil", "silence")
    wide = Phone("A", "vowel", {"open": 1}, ipa=("a", "e", "i"))
    target = PhoneSet("target", (silence, wide, Phone("E", "vowel", ipa=("e",))))
    source = PhoneSet("source", (silence, *(Phone(s, "vowel", ipa=(s,)) for s in "aeiou")))
    before = sequence("a", "e", "i", phone_set="source")
    assert map_phones(before, target, source=source).phones == ("A", "E", "A")
    # "o" is like neither; its features are those of E.
    near = map_phones(sequence("o"), target, source=source, nearest=True)
    assert near.phones == ("E",)
    assert near.phone_set == "target"


def test_segments_that_are_joined_keep_the_first_stress_and_no_energy():
    labels = (
        PhoneSegment(0.0, 0.1, "bcl", energy_db=-30.0, word="bee"),
        PhoneSegment(0.1, 0.2, "b", 2, energy_db=-20.0, word="bee"),
        PhoneSegment(0.3, 0.4, "bcl", energy_db=-10.0),
    )
    read = normalise_phones(PhoneSequence(labels), "en-arpabet")
    assert read.segments == (
        PhoneSegment(0.0, 0.2, "B", 2, "bee"),
        PhoneSegment(0.3, 0.4, "B", energy_db=-10.0),
    )


def test_all_unknown_symbols_are_listed_at_once_with_their_places():
    many = [
        sequence("AA1", "QQ", "T", "QQ", "zz", name="first"),
        sequence("QQ", "QQ", "sil", "XX9", name="second"),
    ]
    found = find_unknown_phones(many, "en-arpabet")
    assert [(unknown.symbol, unknown.count) for unknown in found] == [
        ("QQ", 4),
        ("zz", 1),
        ("XX9", 1),
    ]
    assert [utterance for utterance, _ in found[0].occurrences] == ["first", "first", "second"]
    assert find_unknown_phones(sequence("AA1", "sp"), "en-arpabet") == ()
    labels = [f"X{i}" for i in range(60)]
    with pytest.raises(DataError, match="60 symbols are not in") as refusal:
        normalise_phones(sequence(*labels), "en-arpabet")
    assert all(f"'{label}' 1×" in str(refusal.value) for label in labels[:20])
    assert "; and 40 more" in str(refusal.value)
    assert "X20" not in str(refusal.value)


def test_labels_become_the_sets_own_symbols():
    read = normalise_phones(sequence("h#", "hh", "aa1", "t", "iy0", "m", "ax"), "en-arpabet")
    assert read.phones == ("sil", "HH", "AA", "T", "IY", "M", "AH")
    assert [s.stress for s in read] == [None, None, 1, None, 0, None, 0]
    assert read.phone_set == "en-arpabet"
    assert normalise_phones(read, "en-arpabet") is read
    table = normalise_phones(read, "en-arpabet", {"M": "N"})
    assert table.phones == ("sil", "HH", "AA", "T", "IY", "N", "AH")


def test_where_no_stress_is_marked_none_is_made_up():
    read = normalise_phones(sequence("aa", "t"), "en-arpabet")
    assert [s.stress for s in read] == [None, None]


def test_a_closure_and_its_stop_are_one_phone_and_two_like_labels_are_two():
    read = normalise_phones(sequence("bcl", "b", "iy", "tcl", "t", "t"), "en-arpabet")
    assert read.phones == ("B", "IY", "T", "T")
    assert read.ends[0] == pytest.approx(0.2)


def test_a_table_tells_how_to_read_what_the_set_lacks():
    read = normalise_phones(sequence("B", "IH1", "PT"), "en-arpabet", {"PT": "T"})
    assert read.phones == ("B", "IH", "T")
    with pytest.raises(DataError, match="'PT'"):
        normalise_phones(sequence("B", "PT"), "en-arpabet")


@pytest.mark.real_data
def test_every_phone_of_the_real_labels_is_known(data_folder):
    """A crude look into the TextGrids: texts of the tier of phones."""
    counts = 0
    for path in sorted((data_folder / "grid_s1" / "labels").glob("*.TextGrid")):
        tier = path.read_text(encoding="utf-8").partition('name = "phones"')[2]
        labels = [label or "sil" for label in re.findall(r'text = "(.*)"', tier)]
        assert find_unknown_phones(sequence(*labels, name=path.stem), "en-arpabet") == ()
        counts += len(labels)
    assert counts > 287 * 10
    mary = ["m", "ə", "r", "i", "r", "o", "l", "d", "θ", "ə", "b", "œ", "r", "l"]
    assert find_unknown_phones(sequence(*mary), "ipa") == ()
    assert find_unknown_phones(sequence("#", "e", "s", "e", "t"), "cs-sampa") == ()
