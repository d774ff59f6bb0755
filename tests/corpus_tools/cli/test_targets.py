"""What is read is not written over, by whatever name; what a person corrected only when wanted."""

import os

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from corpus_tools.cli import app as cli
from mocap_fit.atomic_file import check_existing, check_targets
from mocap_fit.errors import ConfigurationError
from mocap_fit.io import read_tracks
from mocap_fit.io.samples import load_sample
from mocap_fit.tracks import write_parquet
from mocap_fit.tracks.parquet_file import is_foreign_table

LINKS = {
    "itself": lambda source, target: source,
    "another way to it": lambda source, target: (
        source.parent / ".." / source.parent.name / source.name
    ),
    "a symbolic link": lambda source, target: (target.symlink_to(source), target)[1],
    "a hard link": lambda source, target: (os.link(source, target), target)[1],
}


@pytest.mark.parametrize("link", LINKS)
def test_a_target_that_is_an_input(link, tmp_path):
    source = tmp_path / "a.tsv"
    source.write_text("precious")
    target = LINKS[link](source, tmp_path / "b.tsv")
    with pytest.raises(ConfigurationError, match=r"read, and would be written over.*a\.tsv"):
        check_targets([tmp_path / "new.tsv", target], [None, "built-in", source])


def test_other_targets(tmp_path):
    (tmp_path / "a").write_text("")
    (tmp_path / "b").write_text("")
    check_targets([tmp_path / "b", tmp_path / "c", "\0", "x" * 5000], [tmp_path / "a", None, "c"])
    check_existing([tmp_path / "c"], "labels", overwrite=False)
    check_existing([tmp_path / "b"], "labels", overwrite=True)
    with pytest.raises(ConfigurationError, match=r"labels of that name already.*--overwrite"):
        check_existing([tmp_path / "c", tmp_path / "b"], "labels", overwrite=False)


def refuse(capsys, path, *arguments):
    before = path.read_bytes()
    assert cli.main([str(argument) for argument in arguments]) == 1
    line = capsys.readouterr().err.splitlines()[-1]
    assert line.startswith("mocap-fit: error: ")
    assert path.read_bytes() == before
    return line


FIT = ["--reference", load_sample("rest"), "--layout", "face30-head5", "--between", "0.5-0.6"]


def test_fit_does_not_write_over_its_recording(tmp_path, capsys):
    take = tmp_path / "take.parquet"
    write_parquet(read_tracks(load_sample("take_01")), take)
    for out in (tmp_path, tmp_path / ".." / tmp_path.name):
        assert "read" in refuse(capsys, take, "fit", take, *FIT, "--out", out)
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "take.parquet").symlink_to(take)
    assert "read" in refuse(capsys, take, "fit", take, *FIT, "--out", tmp_path / "out")


def test_fit_replaces_tables_of_other_programs_only_when_wanted(tmp_path, capsys):
    out = tmp_path / "out"
    out.mkdir()
    table = out / "take_01.parquet"
    pq.write_table(pa.table({"a": [1.0]}), table)
    assert is_foreign_table(table)
    call = ["fit", load_sample("take_01"), *FIT, "--out", out]
    assert "--overwrite" in refuse(capsys, table, *call)
    call = [str(argument) for argument in call]
    assert cli.main([*call, "--overwrite"]) == 0
    assert not is_foreign_table(table)
    # What we wrote is ours: it is used again, and replaced when asked.
    before = table.read_bytes()
    assert cli.main(call) == 0
    assert cli.main([*call, "--fresh"]) == 0
    assert table.read_bytes() == before


def test_export_and_validate_do_not_write_over_what_they_read(tmp_path, capsys):
    take = tmp_path / "take.csv"
    take.symlink_to(tmp_path / "tracks.parquet")
    pq.write_table(pa.table({"a": [1.0]}), tmp_path / "tracks.parquet")
    line = refuse(capsys, take, "export", tmp_path / "tracks.parquet", "--to", "csv", "--out", take)
    assert "written over" in line
    sound = tmp_path / "a.wav"
    sound.write_bytes(load_sample("take_01.wav").read_bytes())
    assert "written over" in refuse(capsys, sound, "validate", sound, "--html", sound)


def test_sentences_are_not_selected_into_their_text(tmp_path, capsys):
    text = tmp_path / "sentences.txt"
    text.write_text("this is\n")
    (tmp_path / "d.txt").write_text("THIS DH IH S\nIS IH Z\n")
    call = ["select-sentences", text, "--dictionary", tmp_path / "d.txt", "--out", tmp_path]
    assert "written over" in refuse(capsys, text, *call)


def test_align_replaces_labels_only_when_wanted(tmp_path, capsys):
    pytest.importorskip("pocketsphinx")
    (tmp_path / "a.wav").write_bytes(load_sample("take_01.wav").read_bytes())
    (tmp_path / "a.txt").write_text("hello")
    labels = tmp_path / "a.TextGrid"
    labels.write_text("corrected by hand")
    call = ["align", tmp_path / "a.wav", "--out", tmp_path]
    assert "--overwrite" in refuse(capsys, labels, *call)


def test_speak_keeps_labels_that_are_there(tmp_path, capsys):
    labels = tmp_path / "phones.TextGrid"
    labels.write_bytes(load_sample("take_01.TextGrid").read_bytes())
    call = ["speak", "--labels", labels, "--phone-set", "sv-sta", "--lang", "sv", "--size", "64"]
    call += ["--model", "rule-based", "--out", tmp_path / "a.gif", "--keep", tmp_path]
    assert "written over" in refuse(capsys, labels, *call)
    other = tmp_path / "other"
    other.mkdir()
    (other / "phones.TextGrid").write_text("corrected by hand")
    call[-1] = other
    assert "--overwrite" in refuse(capsys, other / "phones.TextGrid", *call)
