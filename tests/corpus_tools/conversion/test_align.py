"""The texts of many sounds, and a TextGrid for each."""

import json
import shutil

import pytest

from corpus_tools.cli import app as cli
from corpus_tools.conversion.align import align, read_transcripts
from mocap_fit.errors import ConfigurationError, DataError, FileFormatError
from mocap_fit.labels import find_label_faults, read_labels, read_phones


def sounds(folder, *names):
    paths = [folder / f"{name}.wav" for name in names]
    for path in paths:
        path.touch()
    return paths


def test_one_text_for_one_sound(tmp_path):
    (wav,) = sounds(tmp_path, "a")
    text = tmp_path / "said.txt"
    text.write_text("Hello\nworld.\n")
    assert read_transcripts([wav], text) == {wav: "Hello\nworld.\n"}


@pytest.mark.parametrize("heading", ["", "utterance\ttext\n"])
def test_a_table_for_many(tmp_path, heading):
    a, b = sounds(tmp_path, "a", "b")
    text = tmp_path / "said.tsv"
    text.write_text(f"{heading}b.wav\tworld\na\thello\nc\tmore\n")
    assert read_transcripts([a, b], text) == {a: "hello", b: "world"}


def test_the_heading_may_name_the_column_of_the_text(tmp_path):
    (wav,) = sounds(tmp_path, "a")
    text = tmp_path / "said.tsv"
    text.write_text("utterance\tsplit\ttext\na\ttrain\thello\n")
    assert read_transcripts([wav], text) == {wav: "hello"}


def test_texts_beside_the_sounds_or_in_a_folder(tmp_path):
    a, b = sounds(tmp_path, "a", "b")
    (tmp_path / "a.txt").write_text("hello")
    with pytest.raises(ConfigurationError, match=r"1 sounds have no text.*found b"):
        read_transcripts([b], None)
    spoken = read_transcripts([a, b], None)
    assert spoken[a] == "hello"
    assert str(spoken[b]).startswith(f"{b}: the sound has no text")
    (tmp_path / "b.txt").write_bytes(b"\xff\x00\xff")
    assert isinstance(read_transcripts([a, b], None)[b], FileFormatError)
    (tmp_path / "b.txt").unlink()
    (tmp_path / "b.lab").write_text("world")
    assert read_transcripts([a, b], None) == read_transcripts([a, b], tmp_path)
    assert read_transcripts([a, b], None) == {a: "hello", b: "world"}


def test_texts_that_cannot_be_used_are_refused(tmp_path):
    a, b = sounds(tmp_path, "a", "b")
    text = tmp_path / "said.tsv"
    text.write_text("a\thello\nb world\n")
    with pytest.raises(FileFormatError, match=r"line 2.*no tab"):
        read_transcripts([a, b], text)
    text.write_text("a\thello\na\tworld\n")
    with pytest.raises(FileFormatError, match=r"line 2.*'a' comes twice"):
        read_transcripts([a, b], text)
    with pytest.raises(FileFormatError, match="no such file"):
        read_transcripts([a, b], tmp_path / "none")
    with pytest.raises(ConfigurationError, match="two sounds have one name"):
        read_transcripts([a, tmp_path / "x" / "a.wav"], None)


@pytest.mark.real_data
def test_sounds_become_textgrids_and_a_bad_one_is_left_out(data_folder, tmp_path):
    pytest.importorskip("pocketsphinx")
    wavs = [tmp_path / f"{name}.wav" for name in ("mary", "bad", "bobby")]
    for wav in wavs[::2]:
        shutil.copy(data_folder / "labels" / wav.name, wav)
    wavs[1].write_bytes(b"nothing")
    text = tmp_path / "said.tsv"
    text.write_text("mary\tMary rolled the barrel.\nbad\tHello\nbobby\tBobby ripped the ledger.\n")
    out = tmp_path / "out"
    result = align(wavs, text, out=out)
    assert [one["utterance"] for one in result.aligned] == ["mary", "bobby"]
    assert list(result.errors) == ["bad"]
    assert repr(result) == f"AlignReport(2 of 3 sounds aligned, out={out})"
    assert sorted(path.name for path in out.iterdir()) == ["bobby.TextGrid", "mary.TextGrid"]
    assert not find_label_faults(read_labels(out / "mary.TextGrid"))
    phones = read_phones(out / "mary.TextGrid", phone_set="en-arpabet")
    assert len(phones) == result.aligned[0]["phones"]
    text.write_text("mary\tqqq\nbobby\tBobby ripped the ledger.\n")
    # Labels that may have been corrected by hand are not lost.
    with pytest.raises(ConfigurationError, match="--overwrite"):
        align(wavs, text, out=out)
    result = align(wavs, text, out=out, overwrite=True)
    assert [one["utterance"] for one in result.aligned] == ["bobby"]
    assert "1 words are not in the dictionary: qqq" in result.errors["mary"]
    assert "mary.wav" in result.errors["mary"]
    assert "the sound has no text" in result.errors["bad"]
    text.write_text("mary\tqqq\nbad\tHello zzzz\nbobby\txxxx\n")
    with pytest.raises(DataError, match="3 words are not in the dictionary: qqq, zzzz, xxxx"):
        align(wavs, text, out=tmp_path / "none")
    assert not (tmp_path / "none").exists()


@pytest.mark.real_data
def test_the_command(data_folder, tmp_path, capsys):
    pytest.importorskip("pocketsphinx")
    wav = data_folder / "labels" / "mary.wav"
    text = tmp_path / "said.txt"
    text.write_text("Mary rolled the barrel.\n")
    out = tmp_path / "out"
    assert cli.main(["align", str(wav), "--text", str(text), "--out", str(out)]) == 0
    assert "1 of 1 sounds aligned" in capsys.readouterr().out
    phones = read_phones(out / "mary.TextGrid", phone_set="en-arpabet")
    assert phones[1].word == "mary"
    bad = tmp_path / "bad.wav"
    bad.write_bytes(b"nothing")
    text.write_text("mary\tMary rolled the barrel.\nbad\tHello\n")
    given = ["align", str(wav), str(bad), "--text", str(text), "--out", str(out), "--json"]
    given.append("--overwrite")
    assert cli.main(given) == 1
    shown = capsys.readouterr()
    told = json.loads(shown.out)
    assert [one["utterance"] for one in told["aligned"]] == ["mary"]
    assert [one["utterance"] for one in told["failed"]] == ["bad"]
    assert "bad.wav" in shown.err
    text.write_text("Mary zzqq\n")
    assert cli.main([*given[:2], "--text", str(text), "--out", str(out)]) == 1
    assert "zzqq" in capsys.readouterr().err
    # Without --out it is a wrong call.
    assert cli.main(["align", str(wav)]) == 2
