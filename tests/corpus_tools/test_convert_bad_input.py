"""``mocap-fit convert`` on what labs have: one bad utterance is named, and the rest goes on."""

import json
import re
import shutil

import numpy as np
import pytest

from corpus_tools import cli
from mocap_fit.corpus import open_corpus
from mocap_fit.errors import FileFormatError
from mocap_fit.io import read_tracks, write_qualisys_tsv
from mocap_fit.sound import read_sound, write_sound


def convert(manifest, out, *options):
    return cli.main(["convert", str(manifest), "--out", str(out), *map(str, options)])


@pytest.fixture(scope="module")
def corpus(lab, tmp_path_factory):
    out = tmp_path_factory.mktemp("good") / "corpus"
    assert convert(lab, out) == 0
    return out


@pytest.fixture
def own(lab, corpus, tmp_path):
    """A lab and its corpus of one's own; only what is changed is converted again."""
    shutil.copytree(lab, tmp_path / "lab")
    shutil.copytree(corpus, tmp_path / "corpus")
    return tmp_path / "lab", tmp_path / "corpus"


def edited(path, pattern, replacement):
    text = path.read_text()
    changed = re.sub(pattern, replacement, text, flags=re.MULTILINE)
    assert changed != text
    path.write_text(changed)


def label(lab):
    return lab / "labels" / "sim002.TextGrid"


def sound(lab):
    return lab / "sound" / "sim002.wav"


def recording(lab):
    return lab / "recordings" / "sim002.tsv"


def shorter_sound(lab):
    whole = read_sound(sound(lab))
    write_sound(whole.replace(samples=whole.samples[: len(whole) // 2]), sound(lab))


def fewer_frames(lab):
    tracks = read_tracks(recording(lab))
    write_qualisys_tsv(
        tracks.replace(positions=tracks.positions[:-7], origin=tracks.origin[:-7]), recording(lab)
    )


def no_pulses(lab):
    whole = read_sound(sound(lab))
    samples = np.array(whole.samples)
    samples[:, 1] = 0
    write_sound(whole.replace(samples=samples), sound(lab))


def first_pulse_lost(lab):
    whole = read_sound(sound(lab))
    samples = np.array(whole.samples)
    first = int(np.argmax(samples[:, 1] > 0.1))
    samples[first - 20 : first + 60, 1] = 0
    write_sound(whole.replace(samples=samples), sound(lab))


def one_channel(lab):
    write_sound(read_sound(sound(lab)).mono(), sound(lab))


def only_silence(lab):
    label(lab).unlink()
    label(lab).with_suffix(".TextGrid").write_text(
        'File type = "ooTextFile"\nObject class = "TextGrid"\n\n0\n3\n<exists>\n2\n'
        '"IntervalTier"\n"words"\n0\n3\n1\n0\n3\n""\n'
        '"IntervalTier"\n"phones"\n0\n3\n1\n0\n3\n""\n'
    )


def late_labels(lab):
    """Two seconds later: past the end of the recording."""
    from mocap_fit.io import read_labels, retime, write_labels

    write_labels(retime(read_labels(label(lab)), [(0.0, 2.0)]), label(lab))


def no_lips(lab):
    lines = recording(lab).read_text().splitlines()
    text = "\n".join(line.replace("lip_upper_mid", "renamed") for line in lines)
    recording(lab).write_text(text + "\n")


def frozen(lab):
    """All markers but two are gone in every frame."""
    tracks = read_tracks(recording(lab))
    positions = np.array(tracks.positions)
    positions[:, 2:] = np.nan
    write_qualisys_tsv(tracks.replace(positions=positions, origin=None), recording(lab))


BAD = {
    "no recording": (lambda lab: recording(lab).unlink(), "the recording of 'sim002' is missing"),
    "no labels": (lambda lab: label(lab).unlink(), "the labels of 'sim002' are missing"),
    "no sound": (lambda lab: sound(lab).unlink(), "the sound of 'sim002' is missing"),
    "an empty recording": (lambda lab: recording(lab).write_bytes(b""), "recordings/sim002.tsv"),
    "a damaged recording": (
        lambda lab: recording(lab).write_bytes(recording(lab).read_bytes()[:400]),
        "recordings/sim002.tsv",
    ),
    "labels that are none": (lambda lab: label(lab).write_bytes(b"hello"), "labels/sim002"),
    "sound that is none": (lambda lab: sound(lab).write_bytes(b"RIFF"), "sound/sim002.wav"),
    "a sound that is too short": (shorter_sound, "too short for the frames"),
    "fewer frames than pulses": (fewer_frames, "do not match the number of frames"),
    "no pulses": (no_pulses, "does not hold a pulse for every frame"),
    "the first pulse lost": (first_pulse_lost, "first or the last pulse is missing"),
    "one channel": (one_channel, "there is no channel 2"),
    "another frame rate": (
        lambda lab: write_qualisys_tsv(read_tracks(recording(lab), rate=60.0), recording(lab)),
        r"the frame rate is not that of the manifest \(found 60 Hz, expected 30 Hz\)",
    ),
    "labels after the recording": (late_labels, "labels are outside the recording"),
    "only silence": (only_silence, "no phone but silence"),
    "a tier that is not there": (
        lambda lab: edited(label(lab), '"phones"', '"segments"'),
        "has no tier 'phones'",
    ),
    "no head to see": (frozen, "sim002"),
}


@pytest.mark.parametrize("kind", BAD)
def test_a_bad_utterance_is_named_and_left_out(kind, own, capsys):
    spoil, message = BAD[kind]
    lab, corpus = own
    spoil(lab)
    assert convert(lab, corpus, "--json") == 1
    shown = capsys.readouterr()
    (line,) = [line for line in shown.err.splitlines() if "error: " in line]
    assert "sim002" in line
    assert re.search(message, line)
    assert "Traceback" not in shown.err
    assert str(lab.parent) not in line.replace(str(lab), "")
    told = json.loads(shown.out)
    assert (told["bad"], told["kept"], told["converted"]) == (1, 2, 0)
    assert told["removed"] == ["sim002"]
    errors = {u["id"]: u.get("error") for u in told["utterances"]}
    assert errors["sim002"] in line
    assert [u.id for u in open_corpus(corpus)] == ["sim001", "sim003"]
    assert not list(corpus.rglob("*sim002*"))


def test_labels_after_the_end_of_a_sound_without_pulses(own, capsys):
    lab, corpus = own
    edited(lab / "manifest.toml", '"pulses"', '"none"')
    shorter_sound(lab)
    assert convert(lab, corpus) == 1
    (line,) = [line for line in capsys.readouterr().err.splitlines() if "error: " in line]
    assert re.search(r"sim002.* labels are outside the sound \(sound/sim002.wav\)", line)


def test_a_table_without_a_rate_has_the_manifests(own, capsys):
    lab, corpus = own
    tracks = read_tracks(recording(lab))
    before = open_corpus(corpus)["sim002"].tracks
    header = ",".join(f"{name}_{axis}" for name in tracks.names for axis in "xyz")
    rows = tracks.positions.reshape(tracks.frames, -1)
    table = recording(lab).with_suffix(".csv")
    np.savetxt(table, rows, delimiter=",", header=header, comments="", fmt="%.3f")
    table.write_text(table.read_text().replace("nan", ""))
    recording(lab).unlink()
    edited(lab / "manifest.toml", "recordings/{id}.tsv", "recordings/{id}.*")
    assert convert(lab, corpus) == 0
    after = open_corpus(corpus)["sim002"].tracks
    assert after.rate == pytest.approx(before.rate)
    assert np.nanmax(np.abs(after.values - before.values)) < 0.01


def test_what_is_mended_comes_back(own, corpus):
    lab, out = own
    content = label(lab).read_bytes()
    label(lab).write_bytes(b"nothing")
    assert convert(lab, out) == 1
    label(lab).write_bytes(content)
    assert convert(lab, out) == 0
    for path in corpus.rglob("*"):
        if path.is_file():
            assert (out / path.relative_to(corpus)).read_bytes() == path.read_bytes()


def test_unknown_phones_are_one_list_with_places(own, capsys):
    lab, corpus = own
    for name in ("sim001", "sim003"):
        path = lab / "labels" / f"{name}.TextGrid"
        text = path.read_text()
        phones = text.index('name = "phones"')
        first = re.search(r'text = "([^"]+)"', text[phones:])
        changed = text[phones:].replace(f'text = "{first[1]}"', 'text = "Q9"')
        path.write_text(text[:phones] + changed.replace('text = "T"', 'text = "Tx"'))
    assert convert(lab, corpus) == 1
    (line,) = [line for line in capsys.readouterr().err.splitlines() if "error: " in line]
    assert "error: sim001, sim003: " in line
    assert "symbols are not in the phone set" in line
    assert re.search(r"'Q9' \d+× \(sim001 at \d\.\d+ s.*sim003 at", line)
    assert "[labels] table" in line
    manifest = lab / "manifest.toml"
    table = '[labels]\ntable = { "Q9" = "sil", "Tx" = "T" }\n'
    manifest.write_text(manifest.read_text().replace("[labels]\n", table))
    assert convert(lab, corpus) == 0
    assert len(open_corpus(corpus)) == 3


def test_a_missing_reference_is_said_once_for_all_its_utterances(own, capsys):
    lab, corpus = own
    (lab / "reference.tsv").unlink()
    assert convert(lab, corpus) == 1
    (line,) = [line for line in capsys.readouterr().err.splitlines() if "error: " in line]
    assert "sim001, sim002, sim003" in line
    assert "the reference pose is missing" in line
    with pytest.raises(FileFormatError, match="this is not a corpus"):
        open_corpus(corpus)
    assert not list((corpus / "tracks").iterdir())


def test_a_reference_pose_of_another_layout(own, capsys):
    lab, corpus = own
    edited(lab / "reference.tsv", "lip_upper_mid", "renamed")
    assert convert(lab, corpus) == 1
    assert "the reference pose lacks 1 of the 35 markers" in capsys.readouterr().err


WRONG = {
    "no manifest": (lambda lab: (lab / "manifest.toml").unlink(), "--phone-set"),
    "no TOML": (lambda lab: (lab / "manifest.toml").write_text("= ="), "not TOML"),
    "an unknown key": (
        lambda lab: edited(lab / "manifest.toml", "^channel", "chanel"),
        "sync.chanel: there is no such setting",
    ),
    "an impossible channel": (
        lambda lab: edited(lab / "manifest.toml", "^channel = 2", "channel = 0"),
        "sync.channel",
    ),
    "an unknown kind of sync": (
        lambda lab: edited(lab / "manifest.toml", '"pulses"', '"clapper"'),
        "sync.kind",
    ),
    "an unknown phone set": (
        lambda lab: edited(lab / "manifest.toml", '"sv-sta"', '"klingon"'),
        "klingon",
    ),
    "an unknown layout": (
        lambda lab: edited(lab / "manifest.toml", '"face30-head5"', '"face99"'),
        "face99",
    ),
    "a table with a wrong column": (
        lambda lab: edited(lab / "sentences.tsv", "^utterance\tsplit", "utterance\tpart"),
        "sentences.tsv, line 1",
    ),
    "an utterance twice": (
        lambda lab: edited(lab / "sentences.tsv", "^sim002", "sim001"),
        "'sim001' is there twice",
    ),
    "an unknown speaker": (
        lambda lab: edited(lab / "sentences.tsv", "\tspeaker\t1$", "\tsomebody\t1"),
        "somebody",
    ),
    "a name that leads out of the folder": (
        lambda lab: edited(lab / "sentences.tsv", "^sim002", "../sim002"),
        "cannot be a file's name",
    ),
    "an unknown solver": (
        lambda lab: edited(lab / "manifest.toml", r"\Z", '[fit]\nsolver = "guess"\n'),
        "the solver is none of",
    ),
}


@pytest.mark.parametrize("kind", WRONG)
def test_what_concerns_all_stops_before_anything_is_changed(kind, own, capsys):
    spoil, message = WRONG[kind]
    lab, corpus = own
    spoil(lab)
    before = {path: path.stat().st_mtime_ns for path in corpus.rglob("*") if path.is_file()}
    assert convert(lab, corpus) == 1
    shown = capsys.readouterr()
    (line,) = [line for line in shown.err.splitlines() if "error: " in line]
    assert message in line
    assert before == {p: p.stat().st_mtime_ns for p in corpus.rglob("*") if p.is_file()}


def test_folders_that_are_not_there(tmp_path, lab, capsys):
    assert convert(tmp_path / "none.toml", tmp_path / "out") == 1
    assert "cannot be read" in capsys.readouterr().err
    assert convert(lab / "manifest.toml", tmp_path / "out", "--root", tmp_path / "none") == 1
    assert "the folder of recordings is not there" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
    (tmp_path / "file").write_text("in the way")
    assert convert(lab, tmp_path / "file") == 1
    assert "the folder cannot be made" in capsys.readouterr().err
