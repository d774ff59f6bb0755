"""``mocap-fit convert``: a lab's folder becomes a corpus."""

import dataclasses
import hashlib
import json
import os
import re
import shutil

import killing
import numpy as np
import pandas as pd
import pytest

from corpus_tools.cli import app as cli
from corpus_tools.conversion.entries import list_entries
from corpus_tools.conversion.manifest import load_manifest
from mocap_fit.corpus import open_corpus
from mocap_fit.io import read_tracks, write_qualisys_tsv
from mocap_fit.labels import read_labels, write_labels
from mocap_fit.sound import Sound, energy_db, read_sound, write_sound
from mocap_fit.tracks import MarkerTracks, read_parquet

FOLDERS = ("audio", "head", "markers", "phones", "tracks")


def convert(manifest, out, *options):
    return cli.main(["convert", str(manifest), "--out", str(out), *map(str, options)])


def sums(folder):
    """Of all files, hidden ones too: what is left of an unfinished file would show."""
    return {
        path.relative_to(folder).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in folder.rglob("*")
        if path.is_file()
    }


def report(capsys):
    return json.loads(capsys.readouterr().out)


@pytest.fixture(scope="module")
def corpus(lab_corpus):
    return lab_corpus


@pytest.fixture
def own(lab, corpus, tmp_path):
    """A lab and its corpus of one's own: nothing has to be converted again."""
    shutil.copytree(lab, tmp_path / "lab")
    shutil.copytree(corpus, tmp_path / "corpus")
    return tmp_path / "lab", tmp_path / "corpus"


class TestWhatIsWritten:
    def test_the_files_of_the_design(self, corpus):
        names = ["sim001", "sim002", "sim003"]
        wanted = {f"{part}/{n}.parquet" for part in FOLDERS[1:] for n in names}
        wanted |= {f"audio/{n}.wav" for n in names} | {"corpus.toml", "utterances.parquet"}
        assert set(sums(corpus)) == wanted | {".mocap-fit-corpus"}

    def test_the_table_of_utterances(self, lab, corpus):
        table = pd.read_parquet(corpus / "utterances.parquet").set_index("id")
        sentences = pd.read_csv(lab / "sentences.tsv", sep="\t").set_index("utterance")
        for column in ("split", "text", "speaker"):
            assert table[column].to_dict() == sentences[column].to_dict()
        assert list(table.loc["sim001", "sources"]) == [
            "recordings/sim001.tsv",
            "labels/sim001.TextGrid",
            "sound/sim001.wav",
        ]
        frames = read_tracks(lab / "recordings" / "sim001.tsv").frames
        assert table.loc["sim001", "duration"] == pytest.approx(frames / 30, rel=1e-3)

    def test_the_columns_of_tracks_and_phones(self, corpus):
        tracks = pd.read_parquet(corpus / "tracks" / "sim001.parquet")
        assert list(tracks.columns[:3]) == ["utterance", "time", "jaw_rotation"]
        assert {"jaw_shift_sd", "residual_mm"} <= set(tracks.columns)
        phones = pd.read_parquet(corpus / "phones" / "sim001.parquet")
        assert list(phones.columns) == [
            "utterance",
            "start",
            "end",
            "phone",
            "stress",
            "word",
            "energy_db",
        ]

    def test_one_line_of_pandas_is_one_table(self, corpus):
        tracks = pd.read_parquet(corpus / "tracks")
        sizes = {u.id: u.read_tracks().frames for u in open_corpus(corpus)}
        assert tracks.groupby("utterance").size().to_dict() == sizes

    @pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::FutureWarning")
    def test_one_line_of_dask_is_one_table(self, corpus):
        dd = pytest.importorskip("dask.dataframe")
        tracks = dd.read_parquet(corpus / "tracks")
        counts = tracks.groupby("utterance").size().compute(scheduler="sync").to_dict()
        assert counts == {u.id: u.read_tracks().frames for u in open_corpus(corpus)}

    def test_the_parameters_are_the_true_ones(self, lab, corpus):
        for utterance in open_corpus(corpus):
            truth = read_parquet(lab / "truth" / "tracks" / f"{utterance.id}.parquet")
            error = np.sqrt(np.nanmean((utterance.read_tracks().values - truth.values) ** 2))
            assert error < 0.1
            residual = np.nanmedian(utterance.read_tracks().residuals)
            assert 0.2 < residual < 1.0

    def test_frames_are_on_the_clock_of_the_sound(self, lab, corpus):
        truth = json.loads((lab / "truth" / "sync.json").read_text())
        for utterance in open_corpus(corpus):
            true = truth[utterance.id]
            for tracks in (
                utterance.read_tracks(),
                utterance.read_markers(),
                utterance.read_head(),
            ):
                assert tracks.start_time == pytest.approx(true["start_time"], abs=1e-4)
                assert tracks.rate == pytest.approx(true["frame_rate"], rel=1e-5)
            (sync,) = [s for s in utterance.read_tracks().provenance if s.name == "synchronise"]
            assert sync.arguments["kind"] == "pulses"
            assert sync.arguments["is_estimate"] is False
            assert sync.arguments["drift_ppm"] == pytest.approx(true["drift_ppm"], abs=10)

    def test_measured_values_stay_as_they_were_measured(self, lab, corpus):
        recording = read_tracks(lab / "recordings" / "sim001.tsv")
        kept = open_corpus(corpus)["sim001"].read_markers()
        np.testing.assert_array_equal(kept.positions, recording.positions)

    def test_the_sound_is_without_pulses(self, lab, corpus):
        before = read_sound(lab / "sound" / "sim001.wav")
        after = read_sound(open_corpus(corpus)["sim001"].sound_file)
        assert (before.channels, after.channels) == (2, 1)
        np.testing.assert_array_equal(after.get_channel(1), before.get_channel(1))

    def test_phones_have_stress_words_and_energy(self, lab, corpus):
        utterance = open_corpus(corpus)["sim001"]
        phones = utterance.read_phones()
        assert phones.phone_set == "sv-sta"
        centres = [segment.centre for segment in phones]
        expected = energy_db(read_sound(utterance.sound_file), centres)
        np.testing.assert_allclose([s.energy_db for s in phones], expected)
        silent = [phones[0].energy_db, phones[-1].energy_db]
        assert max(silent) < np.median(expected) - 10
        assert any(segment.stress for segment in phones)
        assert all(segment.word for segment in phones[1:-1] if segment.phone != "sil")

    def test_provenance_is_complete(self, corpus):
        opened = open_corpus(corpus)
        (step,) = opened.provenance
        assert step.arguments["layout"] == "face30-head5"
        assert step.arguments["sync"]["kind"] == "pulses"
        assert (opened.language, opened.rate, opened.face) == ("sv", 30.0, "built-in")
        utterance = opened["sim001"]
        names = [s.name for s in utterance.read_tracks().provenance]
        assert names[:3] == ["read", "synchronise", "remove_head_motion"]
        assert names[-2:] == ["fit_shape", "convert"]
        inputs = {
            part.provenance[-1].arguments["inputs"]
            for part in (
                utterance.read_tracks(),
                utterance.read_markers(),
                utterance.read_head(),
                utterance.read_phones(),
            )
        }
        assert len(inputs) == 1

    def test_nothing_in_the_files_tells_where_or_when(self, lab, corpus):
        for path in corpus.rglob("*"):
            if not path.is_file():
                continue
            content = path.read_bytes()
            for secret in (lab, corpus, os.path.expanduser("~")):
                assert str(secret).encode() not in content
        said = [s.to_dict() for u in open_corpus(corpus) for s in u.read_tracks().provenance]
        assert not re.search(r"20\d\d-|\b1[78]\d{8}\b|/tmp", json.dumps(said))


def test_missing_and_doubled_pulses_are_noted(own):
    lab, corpus = own
    path = lab / "sound" / "sim002.wav"
    whole = read_sound(path)
    samples = np.array(whole.samples)
    rises = np.flatnonzero(np.diff(samples[:, 1] > 0.5 * samples[:, 1].max()) == 1)[::2]
    samples[rises[20] - 5 : rises[20] + 100, 1] = 0
    pulse = samples[rises[30] - 2 : rises[30] + 60, 1].copy()
    samples[rises[30] + 250 : rises[30] + 250 + len(pulse), 1] = pulse
    write_sound(whole.replace(samples=samples), path)
    before = open_corpus(corpus)["sim002"].read_tracks()
    assert convert(lab, corpus) == 0
    after = open_corpus(corpus)["sim002"]
    assert any("1 of" in line and "pulses are missing" in line for line in after.checks)
    assert any(line.startswith("1 pulses besides") for line in after.checks)
    assert after.read_tracks().start_time == pytest.approx(before.start_time, abs=1e-4)


def test_clocks_that_are_far_apart_are_noted(own):
    """A rate that is rounded wrongly looks like a clock that is slow."""
    lab, corpus = own
    manifest, path = lab / "manifest.toml", lab / "recordings" / "sim002.tsv"
    manifest.write_text(manifest.read_text().replace("rate = 30.0\n", ""))
    write_qualisys_tsv(read_tracks(path).replace(rate=30.03), path)
    for name in ("sim001", "sim003"):
        (lab / "recordings" / f"{name}.tsv").unlink()
    assert convert(lab, corpus) == 1
    (utterance,) = open_corpus(corpus)
    assert any("millionths apart" in line for line in utterance.checks)
    assert utterance.read_tracks().rate == pytest.approx(30.0, rel=1e-4)


class TestAgain:
    def test_nothing_is_done_twice(self, own, capsys):
        lab, corpus = own
        before = sums(corpus)
        times = {p: p.stat().st_mtime_ns for p in (corpus / "tracks").iterdir()}
        assert convert(lab, corpus, "--json") == 0
        told = report(capsys)
        assert (told["kept"], told["converted"]) == (3, 0)
        assert sums(corpus) == before
        assert times == {p: p.stat().st_mtime_ns for p in (corpus / "tracks").iterdir()}

    @pytest.mark.slow
    def test_fresh_does_it_all_again_with_the_same_bytes(self, own, capsys):
        lab, corpus = own
        before = sums(corpus)
        assert convert(lab, corpus, "--fresh", "--json") == 0
        assert report(capsys)["converted"] == 3
        assert sums(corpus) == before

    @pytest.mark.parametrize("part", ["recordings", "labels", "sound"])
    def test_a_changed_file_is_the_only_one_converted_again(self, part, own, capsys):
        lab, corpus = own
        (path,) = (lab / part).glob("sim002.*")
        content = path.read_bytes()
        if part == "sound":  # The last sample of the speech.
            content = content[:-4] + b"\x01\x00" + content[-2:]
        elif part == "labels":
            content = content.replace(b'text = "om"', b'text = "ok"') + b"\n"
        else:
            content = content.replace(b"DESCRIPTION\t--", b"DESCRIPTION\tagain")
        assert content != path.read_bytes()
        path.write_bytes(content)
        before = sums(corpus)
        assert convert(lab, corpus, "--json") == 0
        told = report(capsys)
        assert {u["id"]: u["kept"] for u in told["utterances"]} == {
            "sim001": True,
            "sim002": False,
            "sim003": True,
        }
        changed = {name for name, value in sums(corpus).items() if before[name] != value}
        assert changed
        assert all("sim002" in name for name in changed - {"utterances.parquet"})

    @pytest.mark.slow
    def test_a_changed_setting_converts_all_again(self, own, capsys):
        lab, corpus = own
        manifest = lab / "manifest.toml"
        manifest.write_text(manifest.read_text() + '[fit]\nobjective = "squares"\n')
        assert convert(lab, corpus, "--json") == 0
        assert report(capsys)["converted"] == 3
        steps = open_corpus(corpus)["sim001"].read_tracks().provenance
        assert [s.arguments["objective"] for s in steps if s.name == "fit_shape"] == ["squares"]

    def test_split_and_text_may_change_without_a_new_fit(self, own, capsys):
        lab, corpus = own
        table = lab / "sentences.tsv"
        table.write_text(table.read_text().replace("sim001\ttrain\t", "sim001\tvalidation\tnew "))
        assert convert(lab, corpus, "--json") == 0
        assert report(capsys)["kept"] == 3
        utterance = open_corpus(corpus)["sim001"]
        assert utterance.split == "validation"
        assert utterance.text.startswith("new ")

    @pytest.mark.parametrize("lost", ["head/sim002.parquet", "audio/sim002.wav", "cut", "swapped"])
    def test_what_is_lost_or_damaged_is_made_again(self, lost, own, capsys):
        lab, corpus = own
        before = sums(corpus)
        if lost == "cut":
            path = corpus / "tracks" / "sim002.parquet"
            path.write_bytes(path.read_bytes()[:-100])
        elif lost == "swapped":
            shutil.copy(corpus / "phones" / "sim001.parquet", corpus / "phones" / "sim002.parquet")
        else:
            (corpus / lost).unlink()
        assert convert(lab, corpus, "--json") == 0
        assert report(capsys)["converted"] == 1
        assert sums(corpus) == before

    def test_what_is_removed_vanishes(self, own, capsys):
        lab, corpus = own
        table = lab / "sentences.tsv"
        lines = table.read_text().splitlines(keepends=True)
        table.write_text("".join(line for line in lines if not line.startswith("sim002")))
        (corpus / "tracks" / ".sim009.parquet.77.partial").write_bytes(b"left by a killed process")
        assert convert(lab, corpus, "--json") == 0
        assert report(capsys)["removed"] == ["sim002"]
        assert [u.id for u in open_corpus(corpus)] == ["sim001", "sim003"]
        assert not [name for name in sums(corpus) if "sim002" in name or "partial" in name]

    def test_a_corpus_that_has_lost_its_hidden_file_goes_on(self, own, capsys):
        lab, corpus = own
        before = sums(corpus)
        (corpus / ".mocap-fit-corpus").unlink()
        assert convert(lab, corpus, "--json") == 0
        assert report(capsys)["kept"] == 3
        assert sums(corpus) == before

    def test_a_recording_in_no_row_of_the_table_is_told(self, own, capsys):
        lab, corpus = own
        shutil.copy(lab / "recordings" / "sim002.tsv", lab / "recordings" / "sim099.tsv")
        assert convert(lab, corpus) == 0
        assert "1 recordings are not in the table of sentences: sim099" in capsys.readouterr().err
        assert len(open_corpus(corpus)) == 3

    @pytest.mark.skipif(os.name != "posix", reason="locks of POSIX")
    def test_two_conversions_do_not_meet_in_one_folder(self, own, capsys):
        import fcntl

        lab, corpus = own
        with open(corpus / ".mocap-fit-corpus", "rb") as stream:
            fcntl.flock(stream, fcntl.LOCK_EX)
            assert convert(lab, corpus) == 1
        assert "another conversion is at work" in capsys.readouterr().err
        assert convert(lab, corpus) == 0

    def test_recordings_of_ones_own_are_never_removed(self, lab, tmp_path, capsys):
        (tmp_path / "audio").mkdir()
        (tmp_path / "audio" / "mine.wav").write_bytes(b"precious")
        assert convert(lab, tmp_path) == 1
        assert "no corpus of an earlier conversion" in capsys.readouterr().err
        assert list(sums(tmp_path)) == ["audio/mine.wav"]


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
def test_killed_and_resumed_it_is_the_same(lab, corpus, tmp_path):
    out, pieces = tmp_path / "out", []
    for jobs, files in ((1, 2), (2, 6), (2, 8), (1, 11)):
        process = killing.start("convert", lab, "--out", out, "--jobs", jobs)
        # When it is killed, or whether it is done before, decides nothing.
        killing.wait_until(
            lambda process=process, files=files: (
                process.poll() is not None or len(list(out.glob("*/*"))) >= files
            )
        )
        process.kill()
        killing.wait_until_gone(process)
        pieces += [path for path in out.glob("*/[!.]*") if path.is_file()]
    expected = sums(corpus)
    # What has its final name is complete, and there is nothing else but what resuming removes.
    assert pieces
    assert all(
        hashlib.sha256(path.read_bytes()).hexdigest() == expected[path.relative_to(out).as_posix()]
        for path in pieces
    )
    assert convert(lab, out) == 0
    assert sums(out) == expected


class TestSplits:
    def test_287_are_200_and_87(self, tmp_path):
        assert self.drawn(tmp_path, 287).count("test") == 87

    def test_they_stay_when_utterances_are_added(self, tmp_path):
        before = dict(zip(self.names(200), self.drawn(tmp_path, 200), strict=True))
        after = dict(zip(self.names(287), self.drawn(tmp_path, 287, before), strict=True))
        assert {name: after[name] for name in before} == before
        assert list(after.values()).count("test") == 87
        other = self.drawn(tmp_path, 287, seed=5)
        assert other != list(after.values())

    def names(self, count):
        return [f"u{i:03d}" for i in range(count)]

    def drawn(self, folder, count, former=None, seed=0):
        (folder / "sentences.tsv").write_text("\n".join(["utterance", *self.names(count)]))
        manifest = folder / "manifest.toml"
        manifest.write_text(f'phone_set = "sv-sta"\n[splits]\nseed = {seed}\n')
        return [entry.split for entry in list_entries(load_manifest(manifest), folder, former)]

    def test_a_corpus_keeps_those_that_it_has(self, own):
        lab, corpus = own
        table = lab / "sentences.tsv"
        rows = [line.split("\t") for line in table.read_text().splitlines()]
        keep = [i for i, name in enumerate(rows[0]) if name != "split"]
        lines = ["\t".join(row[i] for i in keep) for row in rows]
        table.write_text("\n".join(lines[:3]) + "\n")
        assert convert(lab, corpus) == 0
        before = {u.id: u.split for u in open_corpus(corpus)}
        table.write_text("\n".join(lines) + "\n")
        assert convert(lab, corpus) == 0
        after = {u.id: u.split for u in open_corpus(corpus)}
        assert {name: after[name] for name in before} == before
        assert sorted(after.values()).count("test") == 1


class TestHow:
    @pytest.mark.slow
    def test_two_processes_give_the_same_bytes(self, lab, corpus, tmp_path):
        assert convert(lab, tmp_path / "out", "--jobs", 2) == 0
        assert sums(tmp_path / "out") == sums(corpus)

    @pytest.mark.slow
    def test_a_cluster_gives_the_same_bytes(self, lab, corpus, own, tmp_path, capsys):
        distributed = pytest.importorskip("distributed")
        with distributed.LocalCluster(
            n_workers=1, threads_per_worker=1, dashboard_address=None, processes=True
        ) as cluster:
            given = ("--json", "--dask", cluster.scheduler_address)
            assert convert(lab, tmp_path / "out", *given) == 0
            assert report(capsys)["converted"] == 3
            assert sums(tmp_path / "out") == sums(corpus)
            bad = own[0] / "labels" / "sim002.TextGrid"
            bad.write_bytes(b"no labels")
            assert convert(own[0], tmp_path / "out", *given) == 1
            told = report(capsys)
        assert (told["kept"], told["converted"], told["bad"]) == (2, 0, 1)
        (error,) = [u["error"] for u in told["utterances"] if "error" in u]
        assert error.startswith("labels/sim002.TextGrid")

    def test_jobs_and_a_cluster_are_a_wrong_call(self, lab, tmp_path):
        assert convert(lab, tmp_path, "--jobs", 2, "--dask", "tcp://127.0.0.1:1") == 2

    def test_root_and_manifest_may_be_apart(self, own, tmp_path, capsys):
        lab, corpus = own
        before = sums(corpus)
        (lab / "manifest.toml").rename(tmp_path / "ours.toml")
        assert convert(tmp_path / "ours.toml", corpus, "--root", lab, "--json") == 0
        assert report(capsys)["kept"] == 3
        assert sums(corpus) == before

    @pytest.mark.slow
    def test_the_folder_convention(self, own):
        lab, _ = own
        for name in ("manifest.toml", "sentences.tsv"):
            (lab / name).unlink()
        out = lab.parent / "out"
        assert convert(lab, out, "--phone-set", "sv-sta") == 0
        opened = open_corpus(out)
        assert [u.id for u in opened] == ["sim001", "sim002", "sim003"]
        assert [u.split for u in opened].count("test") == 1
        # Nothing says that there are pulses: sound and recording begin together.
        assert opened["sim001"].read_tracks().start_time == 0.0
        assert read_sound(opened["sim001"].sound_file).channels == 2

    def test_labels_of_all_in_one_file(self, own, capsys):
        lab, corpus = own
        before = {u.id: u.read_phones() for u in open_corpus(corpus)}
        labels = []
        for path in sorted((lab / "labels").iterdir()):
            (tier,) = [t for t in read_labels(path).tiers if t.name == "phones"]
            labels.append(dataclasses.replace(read_labels(path), tiers=(tier,)))
        write_labels(labels, lab / "labels.mlf")
        manifest = lab / "manifest.toml"
        text = manifest.read_text().replace("labels/{id}.TextGrid", "labels.mlf")
        manifest.write_text(re.sub(r'(phones|words) = "\w+"\n', "", text))
        (lab / "recordings" / "sim001.tsv").unlink()
        (lab / "recordings" / "sim003.tsv").unlink()
        # Missing recordings are bad; that of sim002 shows how its labels are found.
        assert convert(lab, corpus) == 1
        (utterance,) = open_corpus(corpus)
        assert utterance.read_phones().phones == before["sim002"].phones
        np.testing.assert_allclose(
            utterance.read_phones().starts, before["sim002"].starts, atol=1e-6
        )

    def test_an_estimate_says_that_it_is_one(self, own, rng, capsys):
        """A voice that is louder the farther the lips are apart; the first frame is at 0.1 s."""
        lab, _ = own
        manifest = lab / "manifest.toml"
        manifest.write_text(manifest.read_text().replace('"pulses"', '"estimate"'))
        for path in (lab / "recordings").iterdir():
            tracks = read_tracks(path)
            apart = tracks["lip_upper_mid"] - tracks["lip_lower_mid"]
            opening = np.linalg.norm(apart, axis=1)
            opening = np.where(np.isnan(opening), np.nanmedian(opening), opening)
            times = np.arange(int(16000 * (tracks.duration + 0.3))) / 16000
            loud = np.interp(times, 0.1 + np.arange(len(opening)) / 30, opening - opening.min())
            voice = 0.01 * loud * rng.normal(size=len(times))
            write_sound(Sound(voice, 16000), lab / "sound" / f"{path.stem}.wav")
            silence = f"utterance,phone,start,end\n{path.stem},A,0.3,0.6\n"
            (lab / "labels" / f"{path.stem}.TextGrid").unlink()
            (lab / "labels" / f"{path.stem}.csv").write_text(silence)
        text = manifest.read_text().replace("{id}.TextGrid", "{id}.*")
        manifest.write_text(re.sub(r'(phones|words) = "\w+"\n', "", text))
        out = lab.parent / "out"
        assert convert(lab, out) == 0
        shown = capsys.readouterr()
        assert "3 ESTIMATED" in shown.out
        for utterance in open_corpus(out):
            assert any("is an estimate" in line for line in utterance.checks)
            (sync,) = [s for s in utterance.read_tracks().provenance if s.name == "synchronise"]
            assert (sync.arguments["kind"], sync.arguments["is_estimate"]) == ("estimate", True)
            assert utterance.read_tracks().start_time == pytest.approx(0.1, abs=0.04)
            assert utterance.read_tracks().rate == 30.0

    @pytest.mark.slow
    def test_a_phone_set_of_ones_own_comes_along(self, own):
        from importlib import resources

        lab, _ = own
        shipped = resources.files("mocap_fit.phones").joinpath("sets", "sv-sta.toml").read_text()
        (lab / "ours.toml").write_text(shipped.replace('name = "sv-sta"', 'name = "ours"'))
        manifest = lab / "manifest.toml"
        manifest.write_text(manifest.read_text().replace('"sv-sta"', '"ours.toml"'))
        out = lab.parent / "out"
        assert convert(lab, out) == 0
        shutil.rmtree(lab)
        assert open_corpus(out).phone_set.name == "ours"


def test_speakers_and_sessions_have_reference_poses_of_their_own(own, capsys):
    """The second speaker's recordings and reference pose lie elsewhere in the laboratory."""
    lab, _ = own
    manifest, table = lab / "manifest.toml", lab / "sentences.tsv"

    def moved(path, to):
        tracks = read_tracks(path)
        turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
        positions = tracks.positions @ turn.T + [500.0, -200.0, 30.0]
        write_qualisys_tsv(MarkerTracks(tracks.names, tracks.rate, positions, name=path.stem), to)

    moved(lab / "reference.tsv", lab / "other.tsv")
    moved(lab / "recordings" / "sim002.tsv", lab / "recordings" / "sim002.tsv")
    text = manifest.read_text() + (
        '[[speakers]]\nid = "second"\nreference = "other.tsv"\n'
        '[[sessions]]\nid = "b"\nspeaker = "speaker"\nreference = "again.tsv"\n'
    )
    manifest.write_text(text)
    shutil.copy(lab / "reference.tsv", lab / "again.tsv")
    rows = table.read_text().splitlines()
    rows = [re.sub(r"^(sim002\t.*\t)speaker\t1$", r"\1second\t", row) for row in rows]
    rows = [re.sub(r"^(sim003\t.*\t)1$", r"\1b", row) for row in rows]
    table.write_text("\n".join(rows) + "\n")
    out = lab.parent / "out"
    assert convert(lab, out) == 0
    assert "2 speakers, 3 sessions" in capsys.readouterr().out
    opened = open_corpus(out)
    about = [(u.speaker, u.session) for u in opened]
    assert about == [("speaker", "1"), ("second", ""), ("speaker", "b")]
    for utterance in opened:
        truth = read_parquet(lab / "truth" / "tracks" / f"{utterance.id}.parquet")
        error = np.sqrt(np.nanmean((utterance.read_tracks().values - truth.values) ** 2))
        assert error < 0.1
    steps = {
        u.id: [s for s in u.read_tracks().provenance if s.name == "bind_markers"] for u in opened
    }
    references = {name: step[0].arguments["reference"] for name, step in steps.items()}
    assert references == {"sim001": "reference", "sim002": "other", "sim003": "again"}
