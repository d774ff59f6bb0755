"""Sentences that cover the most triphones."""

import csv
import json

import pytest

from corpus_tools.cli import app as cli
from corpus_tools.cli import corpus_printing
from corpus_tools.conversion.select_sentences import select_sentences
from mocap_fit.errors import ConfigurationError, DataError, FileFormatError, MissingFileError


@pytest.fixture
def given_phones(tmp_path):
    path = tmp_path / "text.txt"
    path.write_text(
        "ja\tJ A:\nja ja\tJ A: J A:\n\nnej då\tsil N E J D Å: sil\nja ja\tJ A: J A:\n",
        encoding="utf-8",
    )
    return path


def test_sentences_with_phones_given(tmp_path, given_phones, capsys):
    out = tmp_path / "out"
    report = select_sentences(given_phones, count=5, out=out)
    assert (out / "sentences.txt").read_text(encoding="utf-8") == "nej då\nja ja\n"
    rows = list(csv.DictReader((out / "coverage.csv").open(encoding="utf-8")))
    assert [row["line"] for row in rows] == ["4", "2"]
    # sil-N-E N-E-J E-J-D J-D-Å: D-Å:-sil, then sil-J-A: J-A:-J A:-J-A: J-A:-sil; "ja" is in it.
    assert [row["covered_triphones"] for row in rows] == ["5", "9"]
    assert float(rows[-1]["share_of_occurrences"]) == 1
    assert (out / "coverage.png").read_bytes().startswith(b"\x89PNG")
    assert not list(out.glob(".*"))
    assert capsys.readouterr() == ("", "")
    corpus_printing.print_selection(report, as_json=False)
    assert "9 of 9 triphones" in " ".join(capsys.readouterr().out.split())


def test_the_same_text_gives_the_same_bytes(tmp_path, given_phones):
    for name in ("a", "b"):
        select_sentences(given_phones, out=tmp_path / name)
    for file in (tmp_path / "a").iterdir():
        assert file.read_bytes() == (tmp_path / "b" / file.name).read_bytes()


@pytest.fixture
def dictionary(tmp_path):
    path = tmp_path / "cmudict.txt"
    path.write_text(
        ";;; a comment\nTHE  DH AH0\nTHE(2)  DH IY1\ncat K AE1 T # a note\nDON'T D OW1 N T\n"
        "well W EH1 L\nknown N OW1 N\n",
        encoding="utf-8",
    )
    return path


def test_phones_from_a_dictionary_and_missing_words_are_listed(tmp_path, dictionary, capsys):
    text = tmp_path / "text.txt"
    text.write_text(
        "“The cat!”\nDon't, the dog.\nThe well-known cat.\nDog 7 dog\n", encoding="utf-8"
    )
    out = tmp_path / "out"
    result = select_sentences(text, dictionary=dictionary, phone_set="en-arpabet", out=out)
    corpus_printing.print_selection(result, as_json=True)
    told = capsys.readouterr()
    report = json.loads(told.out)
    assert (report["sentences"], report["left_out"]) == (4, 2)
    assert report["missing_words"] == [{"word": "dog", "count": 3}, {"word": "7", "count": 1}]
    assert "2 words are not in the dictionary: dog (3), 7 (1)" in told.err
    assert (out / "missing_words.csv").read_text() == "word,count\ndog,3\n7,1\n"
    assert "well-known" in (out / "sentences.txt").read_text(encoding="utf-8")


def test_stress_makes_more_triphones(tmp_path):
    text = tmp_path / "text.txt"
    text.write_text("a\tT AH0 T AH1 T\n", encoding="utf-8")
    kinds = {}
    for stress in (False, True):
        out = tmp_path / str(stress)
        select_sentences(text, phone_set="en-arpabet", stress=stress, out=out)
        rows = list(csv.DictReader((out / "coverage.csv").open(encoding="utf-8")))
        kinds[stress] = int(rows[-1]["covered_triphones"])
    assert kinds == {False: 4, True: 5}


def test_lengths_of_sentences(tmp_path, given_phones):
    select_sentences(given_phones, out=tmp_path / "out", words=(1, 1))
    assert (tmp_path / "out" / "sentences.txt").read_text(encoding="utf-8") == "ja\n"


def test_bad_input_is_refused_in_words(tmp_path, given_phones, dictionary):
    out = tmp_path / "out"

    def refused(error, message, text=given_phones, **options):
        with pytest.raises(error, match=message):
            select_sentences(text, out=out, **options)
        assert not out.exists()

    no_phones = tmp_path / "no_phones.txt"
    no_phones.write_text("ja\tJ A:\nnej\n", encoding="utf-8")
    latin = tmp_path / "latin.txt"
    latin.write_bytes("på\tP Å:\n".encode("latin-1"))
    empty = tmp_path / "empty.txt"
    empty.write_text("")
    bad_dictionary = tmp_path / "bad.dict"
    bad_dictionary.write_text("cat K AE1 T\ndog\n")
    refused(FileFormatError, "line 2: a sentence has no phones", no_phones)
    refused(FileFormatError, "line 1: the text is not UTF-8", latin)
    refused(MissingFileError, "no such file", tmp_path / "none.txt")
    refused(FileFormatError, "cannot be read", tmp_path)
    refused(DataError, "no sentence is left", empty)
    refused(DataError, "no sentence is left", dictionary=dictionary)
    refused(FileFormatError, "line 2: a word has no phones", dictionary=bad_dictionary)
    refused(DataError, "4 symbols are not in.*: J A: E Å:", phone_set="en-arpabet")
    refused(ConfigurationError, "cannot be", count=0)
    refused(ConfigurationError, "cannot be", words=(5, 3))


def test_the_command(tmp_path, capsys):
    text = tmp_path / "text.tsv"
    text.write_text("one\ta b c d\ntwo\ta b\nthree\td c b a e\n")
    out = tmp_path / "out"
    given = ["select-sentences", str(text), "--count", "2", "--out", str(out)]
    assert cli.main([*given, "--json"]) == 0
    json.loads(capsys.readouterr().out)
    assert (out / "sentences.txt").read_text().split() == ["three", "one"]
    assert cli.main(["select-sentences", str(tmp_path / "none.txt")]) == 1
    assert "no such file" in capsys.readouterr().err
    assert cli.main([*given, "--shortest", "3", "--longest", "2"]) == 2
    assert cli.main(["select-sentences", str(text), "--count", "0"]) == 2
