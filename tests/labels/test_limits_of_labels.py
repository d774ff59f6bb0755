"""The limits that labels are held to, each from both sides."""

import struct
import warnings

import pytest

from mocap_fit.errors import DataError, FileFormatError, MocapFitWarning
from mocap_fit.labels import Label, Labels, Tier, read_all_labels, read_labels, seconds, to_phones
from mocap_fit.labels.text import LABEL_SIZE

GRID = 'File type = "ooTextFile"\n"TextGrid"\n0 1 <exists> 1\n"IntervalTier" "p" 0 1 1\n'


def binary(time):
    numbers = struct.pack(">dd?i", 0, 1, True, 1)
    tier = b"\x0cIntervalTier\0\1p" + struct.pack(">ddi", 0, 1, 1)
    return b"ooBinaryFile\x08TextGrid" + numbers + tier + struct.pack(">ddH", 0, time, 0)


@pytest.mark.parametrize(
    ("name", "create"),
    [
        ("a.csv", lambda t: f"start,end,phone\n0,{t},a\n"),
        ("a.txt", lambda t: f"0.5 {t} a\n"),
        ("a.esps", lambda t: f"#\n{t} 26 a\n"),
        ("a.lab", lambda t: f"0 {t * 10_000_000} a\n"),
        ("a.phn", lambda t: f"0 {t * 16_000} a\n"),
        ("a.TextGrid", lambda t: f'{GRID} 0 {t} "a"\n'),
        ("b.TextGrid", binary),
    ],
)
def test_no_label_is_twelve_days_long(tmp_path, name, create):
    path = tmp_path / name
    for time in (10**6, 10**6 + 1):
        content = create(time)
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        if time == 10**6:
            assert read_labels(path).tiers[0].entries[0].end == time
        else:
            with pytest.raises(FileFormatError, match="this is not a time"):
                read_labels(path)


def test_how_many_labels_a_file_may_hold(tmp_path, monkeypatch):
    monkeypatch.setenv("MOCAP_FIT_MAX_SIZE", f"{1000 * LABEL_SIZE}")
    path = tmp_path / "a.phn"
    # The last line is empty.
    path.write_text("0 1 a\n" * 999)
    assert len(read_labels(path).tiers[0].entries) == 999
    path.write_text("0 1 a\n" * 1000)
    with pytest.raises(FileFormatError, match="larger than what may be read"):
        read_labels(path)


def test_how_short_an_utterance_of_htk_may_be(tmp_path):
    path = tmp_path / "a.mlf"
    rows = '#!MLF!#\n"*/a.lab"\n0 {} a\n.\n"*/b.lab"\n0 10 b\n.\n'
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        path.write_text(rows.format(100_000))
        assert len(read_all_labels(path)) == 2
    path.write_text(rows.format(99_999))
    with pytest.warns(MocapFitWarning, match="9.9999 ms") as caught:
        read_all_labels(path)
    assert len(caught) == 1


def test_how_many_names_a_line_of_htk_may_hold(tmp_path):
    path = tmp_path / "a.lab"
    path.write_text("0 100000" + " a" * 8 + "\n")
    names = [tier.name for tier in read_labels(path).tiers]
    assert names == ["phone", "word", *(f"level {number}" for number in range(3, 9))]
    path.write_text("0 100000" + " a" * 9 + "\n")
    with pytest.raises(FileFormatError, match=r"too many names.*found 9"):
        read_labels(path)


def test_how_many_lines_are_sniffed(tmp_path):
    path = tmp_path / "a.lab"
    for count, is_one in ((19, False), (20, True)):
        path.write_text("0.25 0.5 a\n" * count + "x\n")
        assert seconds.sniff(path) == is_one


@pytest.mark.parametrize(
    ("gap", "joined", "warned"),
    [
        (9e-7, True, False),
        (-9e-7, True, False),
        (2e-6, True, True),
        (-2e-6, True, True),
        (4.9e-4, True, True),
        (-4.9e-4, True, True),
        (5.1e-4, False, False),
    ],
)
def test_which_gaps_and_overlaps_are_rounding(gap, joined, warned):
    tier = Tier("phones", (Label(0, 0.5, "a"), Label(0.5 + gap, 1, "b")))
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        phones = to_phones(Labels((tier,), 0, 1))
    assert (phones.ends[0] == phones.starts[1]) == joined
    assert phones.starts[1] == 0.5 + gap
    assert [str(entry.message).split()[0] for entry in caught] == (["1"] if warned else [])


def test_five_faults_are_shown():
    tier = Tier("phones", tuple(Label(i, i, f"x{i}") for i in range(7)))
    with pytest.raises(DataError, match=r"^7 labels .*'x4', entry 5.*'phones'\); and 2 more \("):
        to_phones(Labels((tier,), 0, 7))
