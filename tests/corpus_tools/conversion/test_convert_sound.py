"""``mocap-fit convert`` on sound of other formats, and with headers that are wrong."""

import shutil

import numpy as np
import pytest
import soundfile

from corpus_tools.cli import app as cli
from mocap_fit.corpus import open_corpus
from mocap_fit.sound import is_plain_wav, read_sound


def convert(lab, out, *options):
    return cli.main(["convert", str(lab), "--out", str(out), "--json", *map(str, options)])


@pytest.fixture
def own(lab, tmp_path):
    shutil.copytree(lab, tmp_path / "lab")
    return tmp_path / "lab"


def edit(lab, *changes):
    path = lab / "manifest.toml"
    text = path.read_text()
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    path.write_text(text)


@pytest.mark.parametrize(
    ("ending", "kind"), [("flac", "FLAC"), pytest.param("sph", "NIST", marks=pytest.mark.slow)]
)
def test_any_format_becomes_wav_with_the_same_samples(own, tmp_path, capsys, ending, kind):
    before = {}
    for path in (own / "sound").iterdir():
        before[path.stem] = read_sound(path)
        target = path.with_suffix(f".{ending}")
        integers = np.rint(before[path.stem].samples * 32768).astype(np.int16)
        soundfile.write(target, integers, int(before[path.stem].rate), format=kind)
        path.unlink()
    edit(own, ("{id}.wav", "{id}." + ending))
    assert convert(own, tmp_path / "corpus") == 0
    capsys.readouterr()
    for utterance in open_corpus(tmp_path / "corpus"):
        assert utterance.sound_file.suffix == ".wav"
        assert is_plain_wav(utterance.sound_file)
        after = read_sound(utterance.sound_file)
        np.testing.assert_array_equal(after.samples, before[utterance.id].samples[:, :1])


def test_headers_that_are_wrong_and_files_cut_off_are_noted(own, tmp_path, capsys):
    edit(own, ('kind = "pulses"\nchannel = 2', 'kind = "none"'))
    contents = {path.stem: path.read_bytes() for path in (own / "sound").iterdir()}
    stream, damaged, right = sorted(contents)
    size = contents[stream].index(b"data") + 4
    (own / "sound" / f"{stream}.wav").write_bytes(
        contents[stream][:size] + bytes(4) + contents[stream][size + 4 :]
    )
    (own / "sound" / f"{damaged}.wav").write_bytes(contents[damaged][:30])
    assert convert(own, tmp_path / "corpus") == 1
    assert f"{damaged}.wav: this is not a sound file" in capsys.readouterr().err
    corpus = open_corpus(tmp_path / "corpus")
    assert [utterance.id for utterance in corpus] == [stream, right]
    assert any("announces no sample" in line for line in corpus[stream].checks)
    # What is right is copied, what is not is written anew.
    assert corpus[right].sound_file.read_bytes() == contents[right]
    assert is_plain_wav(corpus[stream].sound_file)
    (tmp_path / "right.wav").write_bytes(contents[stream])
    np.testing.assert_array_equal(
        read_sound(corpus[stream].sound_file).samples, read_sound(tmp_path / "right.wav").samples
    )


def test_the_pattern_must_be_one_of_sound(own, tmp_path, capsys):
    edit(own, ("{id}.wav", "{id}.txt"))
    assert convert(own, tmp_path / "corpus") == 1
    assert ".flac" in capsys.readouterr().err
