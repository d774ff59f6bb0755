"""``mocap-fit convert`` on what labs have: one bad utterance is named, and the rest goes on."""

import json
import re
import shutil
import subprocess
import sys

import numpy as np
import pytest

from corpus_tools.cli import app as cli
from mocap_fit.corpus import open_corpus
from mocap_fit.errors import FileFormatError
from mocap_fit.fitting import estimate_memory
from mocap_fit.io import read_tracks, write_qualisys_tsv
from mocap_fit.sound import read_sound, write_sound


def convert(manifest, out, *options):
    return cli.main(["convert", str(manifest), "--out", str(out), *map(str, options)])


@pytest.fixture(scope="module")
def corpus(lab_corpus):
    return lab_corpus


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


def label(lab, name):
    return lab / "labels" / f"{name}.TextGrid"


def sound(lab, name):
    return lab / "sound" / f"{name}.wav"


def recording(lab, name):
    return lab / "recordings" / f"{name}.tsv"


def shorter_sound(lab, name):
    whole = read_sound(sound(lab, name))
    write_sound(whole.replace(samples=whole.samples[: len(whole) // 2]), sound(lab, name))


def fewer_frames(lab, name):
    tracks = read_tracks(recording(lab, name))
    write_qualisys_tsv(
        tracks.replace(positions=tracks.positions[:-7], origin=tracks.origin[:-7]),
        recording(lab, name),
    )


def no_pulses(lab, name):
    whole = read_sound(sound(lab, name))
    samples = np.array(whole.samples)
    samples[:, 1] = 0
    write_sound(whole.replace(samples=samples), sound(lab, name))


def first_pulse_lost(lab, name):
    whole = read_sound(sound(lab, name))
    samples = np.array(whole.samples)
    first = int(np.argmax(samples[:, 1] > 0.1))
    samples[first - 20 : first + 60, 1] = 0
    write_sound(whole.replace(samples=samples), sound(lab, name))


def one_channel(lab, name):
    write_sound(read_sound(sound(lab, name)).to_mono(), sound(lab, name))


def only_silence(lab, name):
    label(lab, name).unlink()
    label(lab, name).with_suffix(".TextGrid").write_text(
        'File type = "ooTextFile"\nObject class = "TextGrid"\n\n0\n3\n<exists>\n2\n'
        '"IntervalTier"\n"words"\n0\n3\n1\n0\n3\n""\n'
        '"IntervalTier"\n"phones"\n0\n3\n1\n0\n3\n""\n'
    )


def late_labels(lab, name):
    """Two seconds later: past the end of the recording."""
    from mocap_fit.labels import read_labels, retime, write_labels

    write_labels(retime(read_labels(label(lab, name)), [(0.0, 2.0)]), label(lab, name))


def no_lips(lab, name):
    lines = recording(lab, name).read_text().splitlines()
    text = "\n".join(line.replace("lip_upper_mid", "renamed") for line in lines)
    recording(lab, name).write_text(text + "\n")


def frozen(lab, name):
    """All markers but two are gone in every frame."""
    tracks = read_tracks(recording(lab, name))
    positions = np.array(tracks.positions)
    positions[:, 2:] = np.nan
    write_qualisys_tsv(tracks.replace(positions=positions, origin=None), recording(lab, name))


BAD = {
    "no recording": (
        lambda lab, name: recording(lab, name).unlink(),
        "the recording of .* is missing",
    ),
    "no labels": (lambda lab, name: label(lab, name).unlink(), "the labels of .* are missing"),
    "no sound": (lambda lab, name: sound(lab, name).unlink(), "the sound of .* is missing"),
    "an empty recording": (lambda lab, name: recording(lab, name).write_bytes(b""), "recordings/"),
    "a damaged recording": (
        lambda lab, name: recording(lab, name).write_bytes(recording(lab, name).read_bytes()[:400]),
        "recordings/",
    ),
    "labels that are none": (lambda lab, name: label(lab, name).write_bytes(b"hello"), "labels/"),
    "sound that is none": (lambda lab, name: sound(lab, name).write_bytes(b"RIFF"), "sound/"),
    "a sound that is too short": (shorter_sound, "too short for the frames"),
    "fewer frames than pulses": (fewer_frames, "do not match the number of frames"),
    "no pulses": (no_pulses, "does not hold a pulse for every frame"),
    "the first pulse lost": (first_pulse_lost, "first or the last pulse is missing"),
    "one channel": (one_channel, "there is no channel 2"),
    "labels after the recording": (late_labels, "labels are outside the recording"),
    "only silence": (only_silence, "no phone but silence"),
    "a tier that is not there": (
        lambda lab, name: edited(label(lab, name), '"phones"', '"segments"'),
        "has no tier 'phones'",
    ),
    "no head to see": (frozen, r"recordings/no_head_to_see.tsv: too few reference markers"),
}


def name_of(kind):
    return kind.replace(" ", "_")


@pytest.fixture(scope="module")
def many(lab, tmp_path_factory):
    """A lab with an utterance of every kind of fault, and what is said of it."""
    folder = tmp_path_factory.mktemp("many") / "lab"
    shutil.copytree(lab, folder)
    rows = [line for line in (folder / "sentences.tsv").read_text().splitlines() if line]
    (base,) = [row for row in rows if row.startswith("sim002")]
    for kind, (spoil, _) in BAD.items():
        name = name_of(kind)
        for path in [label(lab, "sim002"), sound(lab, "sim002"), recording(lab, "sim002")]:
            copy = folder / path.parent.name / path.name.replace("sim002", name)
            copy.write_bytes(path.read_bytes())
        spoil(folder, name)
        rows.append(base.replace("sim002", name))
    (folder / "sentences.tsv").write_text("\n".join(rows) + "\n")
    out = folder.parent / "corpus"
    program = "import sys; from corpus_tools.cli.app import main; sys.exit(main())"
    done = subprocess.run(
        [sys.executable, "-c", program, "convert", folder, "--out", out, "--json"],
        capture_output=True,
        encoding="utf-8",
        check=False,
    )
    return folder, out, done


def test_the_good_ones_are_converted_whatever_the_others_are(many, corpus):
    _, out, done = many
    assert done.returncode == 1
    assert "Traceback" not in done.stderr
    told = json.loads(done.stdout)
    assert (told["bad"], told["converted"]) == (len(BAD), 3)
    good = ["sim001", "sim002", "sim003"]
    assert [u.id for u in open_corpus(out)] == good
    assert sorted(path.stem for path in (out / "head").iterdir()) == good
    for part in ("tracks", "phones", "markers", "head", "audio"):
        for path in (corpus / part).iterdir():
            assert (out / part / path.name).read_bytes() == path.read_bytes()


@pytest.mark.parametrize("kind", BAD)
def test_a_bad_utterance_is_named_with_why(kind, many):
    folder, _, done = many
    name = name_of(kind)
    lines = [line for line in done.stderr.splitlines() if f"error: {name}: " in line]
    assert len(lines) == 1, done.stderr
    assert re.search(BAD[kind][1], lines[0])
    assert str(folder.parent) not in lines[0].replace(str(folder), "")
    rows = {row["id"]: row for row in json.loads(done.stdout)["utterances"]}
    assert rows[name]["error"] in lines[0]


def test_an_utterance_that_has_become_bad_leaves_the_corpus(own, capsys):
    lab, out = own
    label(lab, "sim002").write_bytes(b"hello")
    assert convert(lab, out, "--json") == 1
    told = json.loads(capsys.readouterr().out)
    assert (told["bad"], told["kept"], told["converted"]) == (1, 2, 0)
    assert told["removed"] == ["sim002"]
    assert [u.id for u in open_corpus(out)] == ["sim001", "sim003"]
    assert not list(out.rglob("*sim002*"))


def test_labels_after_the_end_of_a_sound_without_pulses(own, capsys):
    lab, corpus = own
    edited(lab / "manifest.toml", '"pulses"', '"none"')
    shorter_sound(lab, "sim002")
    assert convert(lab, corpus) == 1
    (line,) = [line for line in capsys.readouterr().err.splitlines() if "error: " in line]
    assert re.search(r"sim002.* labels are outside the sound \(sound/sim002.wav\)", line)


def test_a_table_without_a_rate_has_the_manifests(own, capsys):
    lab, corpus = own
    tracks = read_tracks(recording(lab, "sim002"))
    before = open_corpus(corpus)["sim002"].read_tracks()
    header = ",".join(f"{name}_{axis}" for name in tracks.names for axis in "xyz")
    rows = tracks.positions.reshape(tracks.frames, -1)
    table = recording(lab, "sim002").with_suffix(".csv")
    np.savetxt(table, rows, delimiter=",", header=header, comments="", fmt="%.3f")
    table.write_text(table.read_text().replace("nan", ""))
    recording(lab, "sim002").unlink()
    edited(lab / "manifest.toml", "recordings/{id}.tsv", "recordings/{id}.*")
    assert convert(lab, corpus) == 0
    after = open_corpus(corpus)["sim002"].read_tracks()
    assert after.rate == pytest.approx(before.rate)
    assert np.nanmax(np.abs(after.values - before.values)) < 0.01


def test_what_is_mended_comes_back(own, corpus):
    lab, out = own
    content = label(lab, "sim002").read_bytes()
    label(lab, "sim002").write_bytes(b"nothing")
    assert convert(lab, out) == 1
    label(lab, "sim002").write_bytes(content)
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
    assert "no such manifest" in capsys.readouterr().err
    assert convert(lab / "manifest.toml", tmp_path / "out", "--root", tmp_path / "none") == 1
    assert "the folder of recordings is not there" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
    (tmp_path / "file").write_text("in the way")
    assert convert(lab, tmp_path / "file") == 1
    assert "the folder cannot be made" in capsys.readouterr().err


def test_recordings_that_need_more_memory_than_is_free(own, monkeypatch, capsys):
    lab, corpus = own
    monkeypatch.setattr("mocap_fit.fitting.memory.free_memory", lambda: 2**20)
    assert convert(lab, corpus, "--fresh", "--json") == 1
    errors = [u["error"] for u in json.loads(capsys.readouterr().out)["utterances"]]
    assert len(errors) == 3
    assert all("needs more memory than is free" in error for error in errors)


@pytest.mark.slow
def test_processes_share_the_memory_that_is_free(own, monkeypatch, capsys):
    """Enough for one, and not for two."""
    lab, corpus = own
    longest = max(read_tracks(path).frames for path in (lab / "recordings").iterdir())
    free = estimate_memory(longest, 35) + 1000
    monkeypatch.setattr("corpus_tools.batch.run.free_memory", lambda: free)
    assert convert(lab, corpus, "--fresh", "--json", "--jobs", 2) == 1
    errors = [u["error"] for u in json.loads(capsys.readouterr().out)["utterances"]]
    assert len(errors) == 3
    assert all("fewer than --jobs 2" in error for error in errors)
    assert convert(lab, corpus, "--fresh") == 0


def test_what_was_bad_is_said_though_the_table_cannot_be_written(own, capsys):
    lab, corpus = own
    recording(lab, "sim002").write_bytes(b"no recording")
    (corpus / "utterances.parquet").unlink()
    (corpus / "utterances.parquet").mkdir()
    (corpus / "utterances.parquet" / "in_the_way").touch()
    assert convert(lab, corpus) == 1
    lines = capsys.readouterr().err.splitlines()
    assert any("sim002" in line and "warning: " in line for line in lines)
    assert "utterances.parquet" in lines[-1]
    assert "error: " in lines[-1]
