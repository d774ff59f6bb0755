"""Phone segments, sequences, and their Parquet files."""

import copy
import pickle

import numpy as np
import pytest

from mocap_fit.errors import DataError, FileFormatError
from mocap_fit.phones import PhoneSegment, PhoneSequence, read_stored_phones, write_phones

PHONES = PhoneSequence(
    (
        PhoneSegment(0.5, 0.6, "T", word="tea"),
        PhoneSegment(0.6, 0.8, "IY", 1, "tea", -12.5),
        PhoneSegment(1.0, 1.25, "sil"),
    ),
    phone_set="en-arpabet",
    name="u1",
).add_step("read", {"file": "u1.lab"})


def test_times_of_a_sequence():
    np.testing.assert_array_equal(PHONES.starts, [0.5, 0.6, 1.0])
    np.testing.assert_array_equal(PHONES.ends, [0.6, 0.8, 1.25])
    assert PHONES.duration == 0.75
    assert PhoneSequence(()).duration == 0.0
    assert PHONES[1].duration == pytest.approx(0.2)
    assert PHONES[1].centre == pytest.approx(0.7)


def test_a_segment_has_its_start_and_not_its_end():
    times = [0.49, 0.5, 0.5999, 0.6, 0.8, 0.9, 1.0, 1.24, 1.25, 2.0]
    assert PHONES.at(times).tolist() == [-1, 0, 0, 1, -1, -1, 2, 2, -1, -1]
    assert PhoneSequence(()).at(np.array([0.0, 1.0])).tolist() == [-1, -1]


@pytest.mark.parametrize(
    ("start", "end", "phone", "stress"),
    [(1, 1, "A", None), (1, 0, "A", None), (0, np.inf, "A", 0), (0, 1, "", 0), (0, 1, "A", 3)],
)
def test_impossible_segments_are_refused(start, end, phone, stress):
    with pytest.raises(DataError):
        PhoneSegment(start, end, phone, stress)


def test_segments_that_overlap_are_refused():
    with pytest.raises(DataError, match=r"'T' to 0.6 s and 'IY' from 0.59 s"):
        PHONES.replace(segments=(PHONES[0], PhoneSegment(0.59, 0.8, "IY")))


def test_copies_are_equal_and_print_shortly():
    for other in (pickle.loads(pickle.dumps(PHONES)), copy.deepcopy(PHONES)):
        assert other == PHONES
    assert repr(PHONES) == "<PhoneSequence u1: 3 phones of en-arpabet, 0.750 s: T IY sil>"
    many = PhoneSequence(tuple(PhoneSegment(i, i + 1, "A") for i in range(13)))
    assert repr(many).endswith("13 phones, 13.000 s: A A A A A A A A A A A A …>")


def test_a_parquet_file_holds_all_and_is_the_same_bytes(tmp_path):
    write_phones(PHONES, tmp_path / "a.parquet")
    write_phones(PHONES, tmp_path / "b.parquet")
    assert (tmp_path / "a.parquet").read_bytes() == (tmp_path / "b.parquet").read_bytes()
    assert read_stored_phones(tmp_path / "a.parquet") == PHONES
    pandas = pytest.importorskip("pandas")
    frame = pandas.read_parquet(tmp_path / "a.parquet")
    assert frame["utterance"].tolist() == ["u1"] * 3
    assert frame["end"].tolist() == [0.6, 0.8, 1.25]
    assert frame["stress"].isna().tolist() == [True, False, True]
    assert frame["energy_db"].tolist()[1] == -12.5


def test_a_file_of_something_else_is_refused(tmp_path):
    import mocap_fit as mf

    path = tmp_path / "rest.parquet"
    mf.write_tracks(mf.read_tracks(mf.load_sample("rest")), path)
    with pytest.raises(FileFormatError, match="cannot be used as phones"):
        read_stored_phones(path)
