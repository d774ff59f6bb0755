"""Labels in seconds, ESPS files without a header, tables of aligners and of Praat."""

import re

import pytest

from mocap_fit.errors import DataError, FileFormatError
from mocap_fit.labels import (
    esps,
    find_label_reader,
    read_labels,
    read_phones,
    seconds,
    write_labels,
)
from mocap_fit.labels.types import Label


def entries(labels, tier=0):
    return [(e.start, e.end, e.text) for e in labels.tiers[tier].entries]


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        ("0.0 0.5 sil\n0.5 0.75 b aa\n", [(0, 0.5, "sil"), (0.5, 0.75, "b aa")]),
        ("0 1 sil\n\n1\t1.25\tb\r\n", [(0, 1, "sil"), (1, 1.25, "b")]),
        ("0.000000\t0.500000\t\n0.5\t1e0\tb\n", [(0, 0.5, ""), (0.5, 1, "b")]),
        (
            "0.5\t0.75\tsil\n\\\t100.0\t8000.0\n0.75\t1.5\tb\n",
            [(0.5, 0.75, "sil"), (0.75, 1.5, "b")],
        ),
        ("0,5\t0,75\tsil\n0,75\t1\t7\n", [(0.5, 0.75, "sil"), (0.75, 1, "7")]),
    ],
)
@pytest.mark.parametrize("name", ["a.lab", "a.txt"])
def test_labels_in_seconds(tmp_path, name, content, expected):
    path = tmp_path / name
    path.write_text(content, newline="")
    assert find_label_reader(path) == "seconds-lab"
    labels = read_labels(path)
    assert entries(labels) == expected
    assert read_phones(path).phones == tuple(text for *_, text in expected if text)
    write_labels(labels, tmp_path / "b.lab", reader="seconds-lab")
    assert read_labels(tmp_path / "b.lab").tiers == labels.tiers


def test_labels_without_duration_are_moments(tmp_path):
    path = tmp_path / "a.txt"
    path.write_text("0.5\t0.5\tclap\n1.25\t1.25\tclap\n")
    (labels,) = seconds.read(path)
    assert labels.tiers[0].kind == "point"
    with pytest.raises(DataError, match="no tier of 'a' holds phones"):
        read_phones(path)


@pytest.mark.parametrize(
    ("content", "is_one"),
    [
        ("0 1 a\n1 2 b\n", False),
        ("0.1 0.2 0.3\n0.2 0.3 0.4\n", False),
        ("0.1 0.2 0.3 0.4 0.5\n", False),
        ("0.5 0.2 0.1\n", False),
        ("0.5 0.2\n", False),
        ("0.5 0.2 7\n", False),
        ("0.2 0.5 7\n", True),
        ("0.5 0.2 a\n", True),
        ("0.5 a\n0.7 b\n", True),
        ("# comment\n; comment\n0.5 0.7 a\n", True),
        (f"0 {'9' * 400} a\n", False),
        ("0.1 0.2\n", True),
        ("", False),
        ("#\n0.1 0.2 a\n", True),
    ],
)
def test_what_is_taken_for_labels_in_seconds(tmp_path, content, is_one):
    path = tmp_path / "a.lab"
    path.write_text(content)
    assert seconds.sniff(path) == is_one


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("0.1 0.2 a\n0.3 b\n", "line 2: the line has one time.*'0.3 b'.*start and end"),
        ("0.1 0.2 a\nb 0.3 0.4\n", "line 2: this is not a label"),
        ("0.1 0.2 a\n0.2 1e9 b\n", "line 2: this is not a time.*'1e9'"),
        ("0.1 nan a\n", "line 1: the line has one time"),
    ],
)
def test_bad_lines_in_seconds(tmp_path, content, message):
    path = tmp_path / "a.lab"
    path.write_text(content)
    with pytest.raises(FileFormatError, match=rf"a\.lab, {message}"):
        seconds.read(path)


def test_esps_without_its_header(tmp_path):
    path = tmp_path / "a.lab"
    path.write_text("0.2 121 sil\n0.5 121 aa\n 0.75 121 m\n")
    assert find_label_reader(path) == "esps-lab"
    assert entries(read_labels(path)) == [(0, 0.2, "sil"), (0.2, 0.5, "aa"), (0.5, 0.75, "m")]
    for content in ("0.2 121 sil\n0.5 122 aa\n", "0.5 26 a\n0.2 26 b\n", "0.2 26 a\n", "a\nb\n"):
        path.write_text(content)
        assert not esps.sniff(path)
        with pytest.raises(FileFormatError, match="header has no end"):
            esps.read(path)


MFA = """Begin,End,Label,Type,Speaker
0.0,0.5,,words,anna
0.5,1.4,bam,words,anna
0.0,0.5,sil,phones,anna
0.5,0.7,B,phones,anna
0.7,1.4,AA1,phones,anna
"""


def test_the_table_of_the_montreal_aligner(tmp_path):
    path = tmp_path / "take_01.csv"
    path.write_text(MFA)
    labels = read_labels(path)
    assert labels.name == "take_01"
    assert [tier.name for tier in labels.tiers] == ["words", "phones"]
    phones = read_phones(path, phone_set="en-arpabet", name="take_01")
    assert [(s.phone, s.stress, s.word) for s in phones] == [
        ("sil", None, ""),
        ("B", None, "bam"),
        ("AA", 1, "bam"),
    ]


def test_several_speakers_have_tiers_of_their_own(tmp_path):
    path = tmp_path / "take.csv"
    path.write_text(MFA + "1.5,2,M,phones,ben\n1.5,2,mm,words,ben\n")
    with pytest.raises(DataError, match=r"several tiers.*'anna - phones'.*'ben - phones'.*--tier"):
        read_phones(path)
    assert [(s.phone, s.word) for s in read_phones(path, "ben - phones")] == [("M", "mm")]


@pytest.mark.parametrize("delimiter", [",", ";", "\t"])
def test_the_table_of_praat(tmp_path, delimiter):
    path = tmp_path / "take.csv"
    rows = ["tmin,tier,text,tmax", "0,words,bam,1", "0,phones,B,0.25", "0.25,phones,AA,1"]
    path.write_text("\n".join(rows).replace(",", delimiter) + "\n")
    assert [(s.start, s.phone, s.word) for s in read_phones(path)] == [
        (0, "B", "bam"),
        (0.25, "AA", "bam"),
    ]


def test_a_column_type_that_names_no_tier_is_one(tmp_path):
    path = tmp_path / "take.csv"
    path.write_text("start,end,label,type\n0,1,a,vowel\n1,2,b,consonant\n")
    labels = read_labels(path)
    assert [tier.name for tier in labels.tiers] == ["label", "type"]
    assert labels.tiers[1].entries[1] == Label(1, 2, "consonant")


@pytest.mark.parametrize(
    ("row", "message"),
    [
        ("0,1,a,phones", "line 7: .*number of columns.*found 4, expected 5"),
        ("0,inf,a,phones,anna", "line 7: this is not a time.*'inf'"),
        ("0,1e12,a,phones,anna", "line 7: this is not a time.*'1e12'"),
        (",1,a,phones,anna", "line 7: this is not a time"),
    ],
)
def test_bad_rows_of_an_aligner(tmp_path, row, message):
    path = tmp_path / "take.csv"
    path.write_text(MFA + row + "\n")
    with pytest.raises(FileFormatError, match=message):
        read_labels(path)


@pytest.mark.parametrize(
    ("name", "content", "is_transcript"),
    [
        ("a.lab", "The birch canoe slid on the smooth planks.\n", True),
        ("a.lab", "sil\nb\naa\n", True),
        ("a.txt", "Ålder är 3\r\n", True),
        ("a.lab", "word " * 5000, True),
        ("a.lab", "3 apples\n", False),
        ("a.lab", "sil 0.0 0.5\nb 0.5 0.7\n", False),
        ("a.lab", "0.0,0.5,sil\n0.5,0.7,b\n", False),
        ("a.lab", "...\n", False),
        ("a.xyz", "hello\n", False),
    ],
)
def test_a_transcript_is_named_as_such(tmp_path, name, content, is_transcript):
    path = tmp_path / name
    path.write_text(content, encoding="utf-8")
    shown = content.split("\n")[0].strip()[:60]
    message = "this is a transcript: text without times" if is_transcript else "no label reader"
    message += f".*{re.escape(shown)}" if name != "a.xyz" else ""
    with pytest.raises(FileFormatError, match=message):
        read_phones(path)
