"""The fit over processes and over a dask cluster: who does it does not show."""

import hashlib
import json
import os
import random
import signal
import sys
import time
from importlib import resources

import killing
import numpy as np
import pytest

import mocap_fit
from corpus_tools.batch.cluster import run_on_cluster
from corpus_tools.cli import app as cli
from corpus_tools.cli import console
from mocap_fit.errors import ConfigurationError, MissingExtraError
from mocap_fit.fitting import fit_speaker
from mocap_fit.tracks import read_parquet

posix = pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")


def arguments(folder, out, *options, recordings=None, reference=None, layout=None):
    return [
        "fit",
        *map(str, recordings or [folder.path / "recordings"]),
        *("--reference", str(reference or folder.reference)),
        *("--layout", str(layout or folder.layout), "--out", str(out)),
        *map(str, options),
    ]


def fit(folder, out, *options, **given):
    return cli.main(arguments(folder, out, *options, **given))


def sums(folder):
    """Of all files, hidden ones too: what is left of an unfinished file would show."""
    return {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in folder.iterdir()}


def report(capsys):
    return json.loads(capsys.readouterr().out)


@pytest.fixture(scope="module")
def folder(simulate, tmp_path_factory):
    return simulate(tmp_path_factory.mktemp("jobs") / "session", "--utterances", 5)


@pytest.fixture(scope="module")
def undisturbed(folder, tmp_path_factory):
    out = tmp_path_factory.mktemp("undisturbed")
    assert fit(folder, out) == 0
    assert len(sums(out)) == 5
    return sums(out)


# At the top of the module, where workers find it.
def square(shared, item, told):
    return shared + item * item, os.getpid()


class TestTheSameWhoeverDoesIt:
    @pytest.mark.slow
    def test_bytes_report_and_messages(self, folder, undisturbed, tmp_path, capsys):
        bad = tmp_path / "sim000.tsv"
        bad.write_bytes(folder.recordings[0].read_bytes()[:300])
        absent = tmp_path / "sim999.tsv"
        recordings = [absent, *folder.recordings, bad]
        seen = []
        for jobs in (1, 2):
            out = tmp_path / "out"
            status = fit(folder, out, "--json", "--fresh", "--jobs", jobs, recordings=recordings)
            shown = capsys.readouterr()
            content = json.loads(shown.out)
            assert content.pop("seconds")["elapsed"] > 0
            said = [line for line in shown.err.splitlines() if "fitting recordings" not in line]
            seen.append((status, sums(out), content, said))
        assert seen[0] == seen[1]
        status, found, content, said = seen[0]
        assert status == 1
        assert found == undisturbed
        assert [row["recording"] for row in content["recordings"]] == [
            path.stem for path in recordings
        ]
        assert str(absent) in said[0]
        assert str(bad) in said[-1]

    @pytest.mark.slow
    def test_a_warning_names_its_recording(self, folder, tmp_path, capsys):
        recording = tmp_path / "few.tsv"
        text = folder.recordings[0].read_text("utf-8").splitlines()
        # Without its last rows the header promises more than there is.
        recording.write_text("\r\n".join(text[:-3]) + "\r\n", encoding="utf-8")
        lines = []
        for jobs in (1, 2):
            given = [recording, folder.recordings[1]]
            fit(folder, tmp_path / "out", "--fresh", "--jobs", jobs, recordings=given)
            shown = capsys.readouterr().err.splitlines()
            lines.append([line for line in shown if "few" in line])
        assert lines[0] == lines[1]
        assert lines[0]

    def test_seconds_say_how_the_time_divides(self, folder, tmp_path, capsys):
        assert fit(folder, tmp_path, "--json") == 0
        seconds = report(capsys)["seconds"]
        parts = ("speaker", "reading", "head_motion", "fitting", "writing")
        assert set(seconds) == {*parts, "elapsed"}
        assert all(seconds[part] > 0 for part in parts)
        assert sum(seconds[part] for part in parts) <= seconds["elapsed"]


class TestResume:
    @pytest.fixture
    def done(self, folder, tmp_path, capsys):
        out = tmp_path / "out"
        assert fit(folder, out) == 0
        capsys.readouterr()
        return out

    def kept(self, capsys):
        return [row["recording"] for row in report(capsys)["recordings"] if row["kept"]]

    def test_what_is_done_is_kept_and_reported_alike(self, folder, done, capsys):
        before = {path: path.stat().st_mtime_ns for path in done.iterdir()}
        assert fit(folder, done, "--json") == 0
        rows = report(capsys)["recordings"]
        assert all(row.pop("kept") for row in rows)
        assert {path: path.stat().st_mtime_ns for path in done.iterdir()} == before
        assert fit(folder, done, "--json", "--fresh") == 0
        fresh = report(capsys)["recordings"]
        assert not any(row.pop("kept") for row in fresh)
        assert rows == fresh
        assert {path: path.stat().st_mtime_ns for path in done.iterdir()} != before

    def test_people_are_told(self, folder, done, capsys):
        (done / "sim001.parquet").unlink()
        assert fit(folder, done) == 0
        assert "5 of 5 recordings fitted (4 of them before)" in capsys.readouterr().out

    def test_a_changed_recording_alone_is_fitted_again(self, folder, done, tmp_path, capsys):
        changed = tmp_path / "sim002.tsv"
        changed.write_bytes(folder.recordings[2].read_bytes())
        given = [folder.recordings[0], changed, folder.recordings[2]]
        assert fit(folder, done, "--json", recordings=given) == 0
        assert self.kept(capsys) == ["sim001", "sim003"]
        two, three = (read_parquet(done / f"sim00{i}.parquet") for i in (2, 3))
        np.testing.assert_array_equal(two.values, three.values)

    def test_a_damaged_a_foreign_and_an_absent_result_are_made_again(
        self, folder, done, undisturbed, capsys
    ):
        (done / "sim001.parquet").write_bytes((done / "sim001.parquet").read_bytes()[:-900])
        (done / "sim002.parquet").write_bytes(b"something else")
        (done / "sim003.parquet").write_bytes(folder.truth[2].read_bytes())
        (done / "sim004.parquet").unlink()
        assert fit(folder, done, "--json") == 0
        assert self.kept(capsys) == ["sim005"]
        assert sums(done) == undisturbed

    @pytest.mark.parametrize("what", ["solver", "layout", "reference", "face"])
    def test_another_way_to_fit_does_all_again(self, what, folder, done, tmp_path, capsys):
        given, options = {}, ["--json"]
        if what == "solver":
            options += ["--solver", "newton"]
        elif what == "layout":
            shipped = resources.files("mocap_fit.fitting").joinpath("layouts/face30-head5.toml")
            given["layout"] = tmp_path / "face30-head5.toml"
            text = shipped.read_text("utf-8").replace("[[markers]]", "[[markers]]\nweight = 2.0", 1)
            given["layout"].write_text(text, encoding="utf-8")
        elif what == "reference":
            given["reference"] = tmp_path / "reference.tsv"
            given["reference"].write_bytes(folder.recordings[0].read_bytes())
        else:
            shipped = resources.files("mocap_fit.face").joinpath("parke.toml").read_text("utf-8")
            (line,) = [line for line in shipped.splitlines() if line.startswith("jaw_shift = ")]
            rig = tmp_path / "built-in.toml"
            rig.write_text(shipped.replace(line, "jaw_shift = [-0.5, 0.5]"), encoding="utf-8")
            options += ["--face", rig]
        recordings = folder.recordings[:2]
        assert fit(folder, done, *options, recordings=recordings, **given) == 0
        assert self.kept(capsys) == []
        assert fit(folder, done, *options, recordings=recordings, **given) == 0
        assert self.kept(capsys) == ["sim001", "sim002"]

    def test_what_a_killed_run_left_is_removed_and_nothing_else(self, folder, done, undisturbed):
        left = done / ".sim001.parquet.4711.partial"
        others = [done / name for name in (".other.parquet.4711.partial", ".sim001.txt", "notes")]
        for path in (left, *others):
            path.write_bytes(b"PAR1")
        assert fit(folder, done) == 0
        assert not left.exists()
        assert all(path.exists() for path in others)
        for path in others:
            path.unlink()
        assert sums(done) == undisturbed


@pytest.fixture(scope="module")
def speaker(folder):
    return fit_speaker("built-in", folder.layout, folder.reference)


class TestFingerprint:
    def test_it_is_the_same_when_made_again(self, folder, speaker):
        again = fit_speaker("built-in", folder.layout, folder.reference)
        assert again.compute_fingerprint() == speaker.compute_fingerprint()

    def test_options_and_version_count(self, speaker, monkeypatch):
        found = {
            speaker.compute_fingerprint(**settings)
            for settings in ({}, {"objective": "squares"}, {"refine_pose": True})
        }
        monkeypatch.setattr("mocap_fit.fitting.speaker.__version__", "99.0")
        assert len(found | {speaker.compute_fingerprint()}) == 4


# Many times slower than what is fitted with by default: enough to be caught in the middle.
SLOWLY = ("--solver", "LN_PRAXIS")


@pytest.fixture(scope="module")
def longer(simulate, tmp_path_factory):
    path = tmp_path_factory.mktemp("longer") / "session"
    return simulate(path, "--utterances", 12, "--duration", 2)


@pytest.fixture(scope="module")
def longer_undisturbed(longer, tmp_path_factory):
    out = tmp_path_factory.mktemp("longer_undisturbed")
    assert fit(longer, out, *SLOWLY) == 0
    return sums(out)


@posix
@pytest.mark.slow
class TestStopped:
    @pytest.fixture
    def endless(self, longer, tmp_path):
        """The recordings, and one that is never read to its end: nothing is over too early."""
        path = tmp_path / "waiting.crash"
        path.write_text(f"CRASH wait {tmp_path / 'flag'}")
        return [longer.path / "recordings", path]

    @pytest.mark.parametrize("jobs", [1, 2])
    def test_killed_at_any_moment_and_taken_up_again(
        self, jobs, longer, longer_undisturbed, endless, tmp_path
    ):
        out, moments = tmp_path / "out", random.Random(jobs)
        for _ in range(3):
            done = len(list(out.glob("*.parquet")))
            given = arguments(longer, out, *SLOWLY, "--jobs", jobs, recordings=endless)
            process = killing.start(*given)
            killing.wait_until(
                lambda done=done, process=process: (
                    process.poll() is not None or len(list(out.glob("*.parquet"))) > min(done, 11)
                )
            )
            time.sleep(moments.uniform(0, 0.1))
            process.kill()
            # Those that it started end too, and do not write on.
            killing.wait_until_gone(process)
            assert process.returncode == -signal.SIGKILL
        before = {path.name: path.stat().st_mtime_ns for path in out.glob("*.parquet")}
        assert len(before) >= 3
        assert fit(longer, out, *SLOWLY, "--jobs", jobs) == 0
        assert sums(out) == longer_undisturbed
        assert {name: (out / name).stat().st_mtime_ns for name in before} == before

    @pytest.mark.parametrize("jobs", [1, 2])
    def test_ctrl_c(self, jobs, longer, endless, tmp_path):
        out = tmp_path / "out"
        given = arguments(longer, out, *SLOWLY, "--jobs", jobs, recordings=endless)
        process = killing.start(*given)
        killing.wait_until(lambda: out.exists() and any(out.glob("*.parquet")))
        # A terminal sends it to all processes of the group.
        os.killpg(process.pid, signal.SIGINT)
        shown, said = process.communicate(timeout=killing.PATIENCE)
        assert process.returncode == console.Status.STOPPED
        assert shown == ""
        assert said.splitlines()[-1] == "mocap-fit: stopped"
        assert "Traceback" not in said
        killing.wait_until_gone(process)
        assert not list(out.glob(".*"))

    def test_a_process_that_is_killed_costs_nothing(self, folder, crash_reader, tmp_path):
        """What it was at is taken up by another."""
        mortal, flag = tmp_path / "mortal.crash", tmp_path / "flag"
        mortal.write_text(f"CRASH once {flag} {folder.recordings[0]}")
        given = [*folder.recordings[:2], mortal, *folder.recordings[2:]]
        assert fit(folder, tmp_path / "two", "--jobs", 2, recordings=given) == 0
        assert flag.exists()
        assert fit(folder, tmp_path / "one", recordings=given) == 0
        assert sums(tmp_path / "two") == sums(tmp_path / "one")


class TestCluster:
    def test_without_dask_the_extra_is_named(self, folder, tmp_path, capsys, monkeypatch):
        monkeypatch.setitem(sys.modules, "distributed", None)
        with pytest.raises(MissingExtraError, match=r"mocap-fit\[dask\]"):
            next(run_on_cluster(square, 0, [1], "tcp://127.0.0.1:1", "1"))
        assert fit(folder, tmp_path / "out", "--dask", "tcp://127.0.0.1:1") == 1
        assert "pip install 'mocap-fit[dask]'" in capsys.readouterr().err
        assert sums(tmp_path / "out") == {}

    def test_jobs_and_a_cluster_are_a_wrong_call(self, folder, tmp_path):
        assert fit(folder, tmp_path, "--dask", "tcp://127.0.0.1:1", "--jobs", 2) == 2

    @pytest.mark.slow
    @pytest.mark.parametrize("address", ["tcp://127.0.0.1:1", "nonsense://x", "tcp://[::"])
    def test_a_scheduler_that_does_not_answer_is_one_line(self, address, folder, tmp_path, capsys):
        pytest.importorskip("distributed")
        assert fit(folder, tmp_path, "--dask", address) == 1
        (line,) = capsys.readouterr().err.splitlines()
        assert line.startswith(f"mocap-fit: error: the dask scheduler at {address} does not")

    @pytest.mark.slow
    def test_the_same_bytes_and_messages(self, folder, undisturbed, tmp_path, capsys):
        distributed = pytest.importorskip("distributed")
        bad = tmp_path / "sim000.tsv"
        bad.write_bytes(folder.recordings[0].read_bytes()[:300])
        recordings = [bad, tmp_path / "sim999.tsv", *folder.recordings]
        here, there = tmp_path / "here", tmp_path / "there"
        assert fit(folder, here, "--json", recordings=recordings) == 1
        expected = capsys.readouterr()
        with distributed.LocalCluster(
            n_workers=2,
            threads_per_worker=1,
            processes=True,
            host="127.0.0.1",
            dashboard_address=None,
        ) as cluster:
            given = ["--json", "--dask", cluster.scheduler_address]
            assert fit(folder, there, *given, recordings=recordings) == 1
            found = capsys.readouterr()
            assert sums(there) == sums(here) == undisturbed
            rows, same = (json.loads(o.out)["recordings"] for o in (found, expected))
            for row, other in zip(rows, same, strict=True):
                row.pop("output", None)
                other.pop("output", None)
                assert row == other
            errors, others = (
                [line for line in o.err.splitlines() if "error: " in line]
                for o in (found, expected)
            )
            assert errors == others
            # A second run finds all done, and does what is not.
            (there / "sim003.parquet").unlink()
            assert fit(folder, there, *given) == 0
            rows = report(capsys)["recordings"]
            assert [row["recording"] for row in rows if not row["kept"]] == ["sim003"]
            assert sums(there) == undisturbed
            version = "99.0"
            with pytest.raises(ConfigurationError, match="do not have this version"):
                next(run_on_cluster(square, 0, [1], cluster.scheduler_address, version))
            results = dict(
                run_on_cluster(
                    square, 10, range(20), cluster.scheduler_address, mocap_fit.__version__
                )
            )
            assert {i: value for i, (value, _) in results.items()} == {
                i: 10 + i * i for i in range(20)
            }
