"""Tiers, faults, phones and clocks."""

import warnings

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import mocap_fit
from mocap_fit.errors import DataError, MocapFitWarning
from mocap_fit.labels import (
    Label,
    Labels,
    Tier,
    find_label_faults,
    find_phone_tier,
    find_word_tier,
    read_labels,
    read_phones,
    retime,
    to_labels,
    to_phones,
    write_labels,
)
from mocap_fit.phones import PhoneSegment, PhoneSequence, load_phone_set


def tier(name, *entries, kind="interval"):
    return Tier(name, tuple(Label(*entry) for entry in entries), kind)


def labels(*tiers, end=1.0):
    return Labels(tiers, 0.0, end, name="take")


WORDS = tier("words", (0, 0.2, ""), (0.2, 0.6, "ab"), (0.6, 1, "c"))
PHONES = tier("x", (0, 0.2, ""), (0.2, 0.4, "AA1"), (0.4, 0.6, "B"), (0.6, 1, "K"))


@pytest.mark.parametrize("name", ["phones", "Phone", "SEGMENTS", "speaker 1 - phones", "MAU"])
def test_tiers_are_found_by_name(name):
    other = tier("notes", (0, 0.5, "a"), (0.5, 1, "b"))
    phones = Tier(name, PHONES.entries)
    assert find_phone_tier(labels(other, WORDS, phones)) is phones
    assert find_word_tier(labels(other, WORDS, phones)) is WORDS


def test_the_tier_of_phones_is_found_by_content():
    notes = tier("notes", (0, 1, "a long remark"))
    assert find_phone_tier(labels(notes, PHONES, WORDS)) is PHONES
    short = tier("glosses", *[(i / 10, (i + 1) / 10, "qq") for i in range(8)])
    english = load_phone_set("en-arpabet")
    assert find_phone_tier(labels(short, PHONES)) is short
    assert find_phone_tier(labels(short, PHONES), english) is PHONES
    with pytest.raises(DataError, match=r"no tier of 'take' holds phones.*'notes'"):
        find_phone_tier(labels(notes, WORDS))
    with pytest.raises(DataError, match=r"no tier 'phon'.*words, x"):
        to_phones(labels(WORDS, PHONES), "phon")


@pytest.mark.parametrize(("symbols", "ok"), [("aaaa b c d", True), ("aaaaa b c d", False)])
def test_without_a_set_four_letters_are_a_phone(symbols, ok):
    texts = symbols.split()
    short = tier("x", *[(i, i + 1, text) for i, text in enumerate(texts)])
    notes = tier("y", (0, 1, "a long remark"))
    if ok:
        assert find_phone_tier(labels(notes, short, end=4)) is short
    else:
        # One of four is more than one in five.
        with pytest.raises(DataError, match="holds phones"):
            find_phone_tier(labels(notes, short, end=4))


def test_four_of_five_labels_make_a_tier_of_phones():
    texts = ["a", "b", "c", "d", "no phone"]
    mostly = tier("x", *[(i, i + 1, text) for i, text in enumerate(texts)], (5, 6, " "))
    words = tier("words", (0, 6, "w"))
    assert find_phone_tier(labels(words, mostly, end=6)) is mostly
    longer = tier("z", *[(i, i + 1, "q") for i in range(7)])
    assert find_phone_tier(labels(words, mostly, longer, end=7)) is longer


def test_the_word_is_that_at_the_centre_of_the_phone():
    late = tier("words", (0, 0.29, "early"), (0.29, 0.61, "ab"), (0.61, 1, "c"))
    assert [s.word for s in to_phones(labels(late, PHONES))] == ["ab", "ab", "c"]
    gap = tier("words", (0.2, 0.3, "a"), (0.3, 0.4, "b"), (0.9, 1, "c"))
    assert [s.word for s in to_phones(labels(gap, PHONES))] == ["b", "", ""]


def test_phones_have_their_words_stress_and_silence():
    plain = to_phones(labels(WORDS, PHONES))
    assert [(s.phone, s.word) for s in plain] == [("AA1", "ab"), ("B", "ab"), ("K", "c")]
    read = to_phones(labels(WORDS, PHONES), phone_set="en-arpabet")
    assert [(s.phone, s.stress, s.word) for s in read] == [
        ("sil", None, ""),
        ("AA", 1, "ab"),
        ("B", None, "ab"),
        ("K", None, "c"),
    ]
    assert read.phone_set == "en-arpabet"
    odd = labels(tier("phones", (0, 1, "QQ")))
    with pytest.raises(DataError, match="'QQ'"):
        to_phones(odd, phone_set="en-arpabet")
    assert to_phones(odd, phone_set="en-arpabet", table={"QQ": "K"}).phones == ("K",)


def test_a_table_gives_stress_and_words(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("start,end,phone,stress,word\n0,0.5,AA,1,ah\n0.5,1,B,,\n")
    read = mocap_fit.read_phones(path)
    assert [(s.phone, s.stress, s.word) for s in read] == [("AA", 1, "ah"), ("B", None, "")]
    path.write_text("start,end,phone,stress\n0,0.5,AA,7\n")
    with pytest.raises(DataError, match=r"a\.csv.*stress of 'AA'"):
        read_phones(path)


def test_all_faults_are_listed():
    bad = tier(
        "phones",
        (0.1, 0.2, "a"),
        (0.3, 0.5, "b"),
        (0.4, 0.6, "c"),
        (0.6, 0.6, "d"),
        (0.7, 0.65, "e"),
        (0.1, 0.15, "f"),
        (0.8, 1.2, "g"),
    )
    found = [(fault.kind, fault.text) for fault in find_label_faults(labels(bad))]
    assert found == [
        ("gap", "a"),
        ("gap", "b"),
        ("overlap", "c"),
        ("no duration", "d"),
        ("negative duration", "e"),
        ("gap", "e"),
        ("order", "f"),
        ("gap", "g"),
        ("outside", "g"),
    ]
    assert not find_label_faults(labels(WORDS, PHONES))
    points = tier("tones", (0.5, 0.5, "H"), (0.2, 0.2, "L"), (3, 3, "x"), kind="point")
    assert [f.kind for f in find_label_faults(labels(points))] == ["order", "outside"]
    with pytest.raises(DataError, match=r"4 labels of 'take' have .* times: overlap at 0\.4"):
        to_phones(labels(bad))


def test_tiny_overlaps_are_mended_and_larger_ones_refused():
    tiny = labels(tier("phones", (0, 0.50049, "a"), (0.5, 1, "b")))
    with pytest.warns(MocapFitWarning, match="overlap by less than 0.5 ms"):
        mended = to_phones(tiny)
    assert mended.ends.tolist() == [0.5, 1.0]
    with pytest.raises(DataError, match=r"overlap at 0\.5000 to 0\.5005 s \('b'"):
        to_phones(labels(tier("phones", (0, 0.50051, "a"), (0.5, 1, "b"))))
    # An earlier label that would vanish is not shortened.
    with pytest.raises(DataError, match="overlap"):
        to_phones(labels(tier("phones", (0, 0.5, "a"), (0.5, 0.5004, "b"), (0.5, 1, "c"))))


def test_a_microsecond_is_no_gap():
    for missing, kinds in ((9e-7, []), (2e-6, ["gap"])):
        near = labels(tier("phones", (0, 0.5, "a"), (0.5 + missing, 1, "b")))
        assert [fault.kind for fault in find_label_faults(near)] == kinds
        end = labels(tier("phones", (0, 1 - missing, "a")))
        assert [fault.kind for fault in find_label_faults(end)] == kinds
        beyond = labels(tier("phones", (0, 1 + missing, "a")))
        assert len(find_label_faults(beyond)) == len(kinds)


def test_stress_and_marks_of_a_set_are_written():
    phones = PhoneSequence((PhoneSegment(0.5, 1.0, "A:", 1, "a"), PhoneSegment(1.0, 1.5, "P")))
    written = to_labels(phones)
    assert [e.text for e in written.get_tier("phones").entries] == ["", "A:1", "P"]
    assert [(e.start, e.end, e.text) for e in written.get_tier("words").entries] == [
        (0.0, 0.5, ""),
        (0.5, 1.0, "a"),
        (1.0, 1.5, ""),
    ]
    named = to_labels(phones.replace(phone_set="sv-sta"))
    assert [e.text for e in named.get_tier("phones").entries] == ["", "'A:", "P"]
    swedish = to_labels(phones, 2.0, load_phone_set("sv-sta"))
    assert [e.text for e in swedish.get_tier("phones").entries] == ["", "'A:", "P", ""]
    assert swedish.end == 2.0
    assert to_labels(phones, 1.0).end == 1.5
    assert repr(swedish) == "<Labels : 0 to 2 s, tiers words (3 intervals), phones (4 intervals)>"


def sequence():
    segments = (
        PhoneSegment(0.25, 0.5, "AA", 1, "ah"),
        PhoneSegment(0.5, 0.75, "B", None, "bee"),
        PhoneSegment(0.75, 1.0, "IY", 0, "bee"),
    )
    return PhoneSequence(segments, name="take")


@pytest.mark.parametrize("name", ["take.TextGrid", "take.lab", "take.csv"])
def test_phones_are_written_and_read_again(tmp_path, name):
    write_labels(to_labels(sequence(), end=1.5), tmp_path / name)
    again = read_phones(tmp_path / name, phone_set="en-arpabet")
    spoken = [s for s in again if s.phone != "sil"]
    assert spoken == list(sequence())
    assert not find_label_faults(read_labels(tmp_path / name))
    assert again[0] == PhoneSegment(0.0, 0.25, "sil")


def test_one_anchor_shifts_and_more_stretch():
    moved = retime(sequence(), [(0.0, 2.0)])
    assert moved.starts.tolist() == [2.25, 2.5, 2.75]
    stretched = retime(sequence(), [(0.5, 1.0), (0.75, 1.5), (2.0, 2.75)])
    assert stretched.starts.tolist() == [0.5, 1.0, 1.5]
    assert stretched.ends.tolist() == [1.0, 1.5, 1.75]
    assert stretched.provenance[-1].name == "retime"
    whole = retime(labels(WORDS, PHONES), [(0.0, 0.0), (1.0, 2.0)])
    assert whole.end == 2.0
    assert whole.tiers[0].entries[1] == Label(0.4, 1.2, "ab")


@settings(max_examples=50)
@given(steps=st.lists(st.tuples(st.floats(0.1, 2), st.floats(0.1, 2)), min_size=1, max_size=5))
def test_there_and_back_is_where_one_was(steps):
    pairs = [tuple(pair) for pair in np.cumsum(steps, axis=0)]
    there = retime(sequence(), pairs)
    back = retime(there, [(b, a) for a, b in pairs])
    np.testing.assert_allclose(back.starts, sequence().starts, atol=1e-9)
    np.testing.assert_allclose(back.ends, sequence().ends, atol=1e-9)


@pytest.mark.parametrize("anchors", [[], [(0, 1), (1, 0)], [(0, 0), (0, 1)], [(0, float("nan"))]])
def test_anchors_that_contradict_each_other_are_refused(anchors):
    with pytest.raises(DataError, match="anchor times"):
        retime(sequence(), anchors)


@pytest.mark.real_data
def test_the_real_labels_read_and_come_back(data_folder, tmp_path):
    paths = [p for p in (data_folder / "labels").iterdir() if p.suffix != ".wav"]
    assert len(paths) == 4
    for path in paths:
        read = read_labels(path)
        again = tmp_path / path.name
        reader = "esps-lab" if path.suffix == ".lab" else None
        write_labels(read, again, reader=reader)
        assert read_labels(again) == read
        assert len(read_phones(path))
    mary = read_phones(data_folder / "labels" / "mary.TextGrid", phone_set=None)
    assert {s.word for s in mary} == {"mary", "rolled", "the", "barrel"}
    xray = read_phones(data_folder / "labels" / "xrmb_JW11_tp011.TextGrid", phone_set="en-arpabet")
    assert len(xray) == 253
    assert all(s.word == "" for s in xray if s.phone == "sil")


@pytest.mark.real_data
def test_the_287_labels_of_grid_read(data_folder, tmp_path):
    paths = sorted((data_folder / "grid_s1" / "labels").glob("*.TextGrid"))
    assert len(paths) == 287
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for path in paths:
            read = read_phones(path, phone_set="en-arpabet")
            assert all((s.phone == "sil") == (s.word == "") for s in read)
            assert not find_label_faults(read_labels(path))


@pytest.mark.real_data
def test_praatio_reads_the_same_from_the_real_files(data_folder):
    textgrid = pytest.importorskip("praatio.textgrid")
    for path in (data_folder / "labels").glob("*.TextGrid"):
        theirs = textgrid.openTextgrid(str(path), includeEmptyIntervals=True)
        ours = read_labels(path)
        assert [t.name for t in ours.tiers] == list(theirs.tierNames)
        for one in ours.tiers:
            entries = theirs.getTier(one.name).entries
            assert [(e.start, e.text) for e in one.entries] == [(e[0], e[-1]) for e in entries]
