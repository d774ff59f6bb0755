"""``mocap-fit info`` on labels, sound, phones, corpora and models."""

import json

import numpy as np
import pytest
import soundfile

from corpus_tools.cli import app as cli
from mocap_fit.control import create
from mocap_fit.corpus import Corpus, Utterance, save_corpus
from mocap_fit.phones import PhoneSegment, PhoneSequence
from mocap_fit.sound import Sound, write_sound
from mocap_fit.tracks import ParameterTracks


def info(capsys, *paths, status=0):
    assert cli.main(["info", "--json", *map(str, paths)]) == status
    return json.loads(capsys.readouterr().out)


@pytest.fixture(scope="module")
def corpus():
    def utterance(name, split):
        values = np.random.default_rng(len(name)).normal(size=(60, 2))
        phones = PhoneSequence(
            (PhoneSegment(0.0, 0.4, "sil"), PhoneSegment(0.4, 1.0, "AA", 1, "ah", -20.0)),
            phone_set="en-arpabet",
            name=name,
        )
        tracks = ParameterTracks(("jaw_rotation", "lip_rounding"), 60.0, values, name=name)
        return Utterance.from_tracks(tracks, phones, split=split, speaker="s", checks=("look",))

    given = [utterance(name, "test" if name == "c" else "train") for name in "abc"]
    return Corpus.from_utterances(given, "en-arpabet")


def test_labels(tmp_path, capsys):
    path = tmp_path / "a.lab"
    path.write_text("0 1000000 sil\n1000000 2500000 AA\n2600000 3000000 B\n")
    (told,) = info(capsys, path)
    assert (told["content"], told["format"], told["end"]) == ("labels", "htk-lab", 0.3)
    (tier,) = told["tiers"]
    assert (tier["labels"], tier["different"]) == (3, 3)
    assert "en-arpabet" in tier["phone_sets"]
    (fault,) = told["faults"]
    assert "0.25" in fault


def test_the_phone_set_that_labels_fit_best(tmp_path, capsys):
    def name_sets(*labels):
        lines = [f"{i}00000 {i + 1}00000 {label}\n" for i, label in enumerate(labels)]
        (tmp_path / "a.lab").write_text("".join(lines))
        (told,) = info(capsys, tmp_path / "a.lab")
        return told["tiers"][0]["phone_sets"]

    assert name_sets("DH", "AH0", "K", "AE1") == ["en-arpabet"]
    assert name_sets("DH", "AH0", "K", "AE1", "noise!") == ["en-arpabet (4 of 5)"]
    assert name_sets("hello", "world") == []
    pytest.importorskip("panphon")
    assert name_sets("g", "u:", "t", "@", "n", "OY") == ["x-sampa"]


def test_many_utterances_in_one_file_of_labels(tmp_path, capsys):
    path = tmp_path / "a.mlf"
    path.write_text('#!MLF!#\n"*/a.lab"\n0 1000000 AA\n.\n"*/b.lab"\n0 2000000 B\n.\n')
    (told,) = info(capsys, path)
    assert [(u["name"], u["duration"]) for u in told["utterances"]] == [("a", 0.1), ("b", 0.2)]


def test_a_table_may_be_labels_or_a_recording(tmp_path, capsys):
    labels, recording = tmp_path / "a.csv", tmp_path / "b.csv"
    labels.write_text("start,end,phone\n0,0.5,AA\n")
    recording.write_text("time,m_x,m_y,m_z\n0,1,2,3\n0.1,1,2,3\n0.2,1,2,3\n")
    told = info(capsys, labels, recording)
    assert [each["content"] for each in told] == ["labels", "markers"]


def test_sound(tmp_path, capsys):
    times = np.arange(16000) / 16000
    samples = np.stack([0.5 * np.sin(2 * np.pi * 200 * times), np.zeros(16000)], axis=1)
    samples[100, 1] = 1.0
    write_sound(Sound(samples, 16000), tmp_path / "a.wav")
    (told,) = info(capsys, tmp_path / "a.wav")
    assert (told["content"], told["rate"], told["duration"]) == ("sound", 16000, 1.0)
    speech, other = told["channels"]
    assert speech["peak"] == pytest.approx(0.5, abs=1e-3)
    assert speech["loudest_db"] == pytest.approx(-9, abs=0.2)
    assert (speech["clipped"], other["clipped"]) == (0, 1)
    assert other["quietest_db"] == -100


@pytest.mark.parametrize(("count", "rate"), [(1, 16000), (2, 48000), (100, 1), (100, 10)])
def test_sound_that_is_short_or_slow(tmp_path, capsys, count, rate):
    write_sound(Sound(np.full(count, 0.5), rate), tmp_path / "a.wav")
    (told,) = info(capsys, tmp_path / "a.wav")
    (channel,) = told["channels"]
    assert channel["loudest_db"] == pytest.approx(-6, abs=0.1)
    assert channel["quietest_db"] == pytest.approx(-6, abs=0.1)


@pytest.mark.parametrize(
    ("kind", "encoding", "ending"),
    [
        ("WAV", "PCM_U8", "wav"),
        ("FLAC", "PCM_24", "flac"),
        ("NIST", "ULAW", "sph"),
        ("OGG", "VORBIS", "oga"),
        ("MP3", "MPEG_LAYER_III", "mp3"),
    ],
)
def test_sound_of_every_format_has_its_encoding(tmp_path, capsys, kind, encoding, ending):
    path = tmp_path / f"a.{ending}"
    soundfile.write(str(path), 0.5 * np.sin(np.arange(8000)), 8000, encoding, format=kind)
    (told,) = info(capsys, path)
    assert (told["content"], told["encoding"], told["rate"]) == ("sound", encoding, 8000)


def test_a_corpus_and_its_files(tmp_path, corpus, capsys):
    folder = tmp_path / "corpus"
    save_corpus(corpus, folder)
    phones = folder / "phones" / "a.parquet"
    told = info(capsys, folder, folder / "corpus.toml", phones, folder / "tracks" / "a.parquet")
    assert [each["content"] for each in told] == ["corpus", "corpus", "phones", "parameters"]
    about = told[0]
    assert (about["utterances"], about["duration"], about["rate"]) == (3, 3.0, 60.0)
    assert [(s["split"], s["utterances"]) for s in about["splits"]] == [("test", 1), ("train", 2)]
    assert about["speakers"] == [{"speaker": "s", "session": "", "utterances": 3}]
    assert about["checks"][0] == "a: look"
    assert {each["phone"]: each["count"] for each in told[2]["phones"]} == {"AA": 1, "sil": 1}
    assert cli.main(["info", str(folder)]) == 0
    assert "en-arpabet" in capsys.readouterr().out


def test_a_model(tmp_path, corpus, capsys):
    model = create("phone-mean")
    model.fit(corpus)
    model.save(tmp_path / "model.npz")
    (told,) = info(capsys, tmp_path / "model.npz")
    assert (told["content"], told["model"]) == ("model", "phone-mean")
    assert told["parameters"] == ["jaw_rotation", "lip_rounding"]
    assert told["parameter_count"] == model.parameter_count


def test_what_is_none_of_these(tmp_path, capsys):
    (tmp_path / "folder").mkdir()
    (tmp_path / "a.wav").write_bytes(b"no sound")
    (tmp_path / "a.TextGrid").write_bytes(b"no labels")
    paths = [tmp_path / name for name in ("folder", "a.wav", "a.TextGrid", "none.wav")]
    told = info(capsys, *paths, status=1)
    assert [str(path) in each["error"] for path, each in zip(paths, told, strict=True)] == [
        True
    ] * 4


def test_folders_and_files_with_errors_last(tmp_path, corpus, capsys):
    folder = tmp_path / "lab"
    (folder / "inside").mkdir(parents=True)
    save_corpus(corpus, tmp_path / "corpus")
    write_sound(Sound(np.zeros(800), 16000), folder / "b.wav")
    write_sound(Sound(np.zeros(1600), 16000), folder / "inside" / "d.wav")
    (folder / "a.wav").write_bytes(b"no sound")
    (folder / "c.tsv").write_bytes(b"no table")
    (folder / "notes.md").write_bytes(b"no data")
    (tmp_path / "empty").mkdir()
    paths = [folder, tmp_path / "corpus", tmp_path / "empty", tmp_path / "absent.wav"]
    rows = info(capsys, *paths, status=1)
    within = [folder / name for name in ("a.wav", "b.wav", "c.tsv", "inside/d.wav")]
    assert [row["file"] for row in rows] == [str(path) for path in (folder, *within, *paths[1:])]
    bad = [within[0], within[2], *paths[2:]]
    assert [row["file"] for row in rows if "error" in row] == [str(path) for path in bad]
    assert all(row["file"] in row["error"] for row in rows if "error" in row)
    # In words too: all that can be described, and last what cannot.
    assert cli.main(["info", *map(str, paths)]) == 1
    shown = capsys.readouterr()
    assert str(within[3]) in shown.out
    lines = shown.err.splitlines()
    assert [str(path) in line for path, line in zip(bad, lines, strict=True)] == [True] * 4


def test_a_mistake_of_a_reader_or_of_ours_costs_one_file(
    tmp_path, crash_reader, capsys, monkeypatch
):
    write_sound(Sound(np.zeros(800), 16000), tmp_path / "z.wav")
    for kind in ("raise", "memory", "recursion", "leave"):
        (tmp_path / f"{kind}.crash").write_text(f"CRASH {kind}")
    rows = info(capsys, tmp_path, status=1)
    errors = {row["file"]: row["error"] for row in rows if "error" in row}
    assert len(errors) == 4
    assert all(error.startswith(file) for file, error in errors.items())
    monkeypatch.setattr("corpus_tools.inspection.contents.energy_db", lambda *_, **__: 1 / 0)
    (row,) = (row for row in info(capsys, tmp_path, status=1) if row["file"].endswith("z.wav"))
    assert "z.wav: this is a bug in mocap-fit (ZeroDivisionError" in row["error"]
