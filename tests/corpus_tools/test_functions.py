"""One quiet function for each command: objects that print shortly, and nothing on the streams."""

import ast
import pickle
import subprocess
import sys
from importlib import resources
from pathlib import Path

import numpy as np
import pytest
from threadpoolctl import threadpool_info

import corpus_tools
from corpus_tools.cli import app
from corpus_tools.conversion.manifest import Manifest, load_manifest, read_example
from mocap_fit.errors import DataError
from mocap_fit.processes import limit_to_one_thread
from mocap_fit.tracks import read_parquet

ROOT = Path(corpus_tools.__file__).parent


def test_every_command_is_a_function_of_its_name():
    commands = {command.name.replace("-", "_") for command in app.app.registered_commands}
    assert commands <= set(corpus_tools.__all__)
    assert dir(corpus_tools) == sorted(corpus_tools.__all__)
    for name in corpus_tools.__all__:
        assert getattr(corpus_tools, name).__name__ == name
    with pytest.raises(AttributeError, match="no attribute 'convertt'"):
        corpus_tools.convertt  # noqa: B018


def test_no_room_has_the_name_of_a_command():
    """Importing a module of the room would put the room in the function's place."""
    modules = {path.stem for path in ROOT.iterdir() if path.suffix in ("", ".py")}
    assert not modules & set(corpus_tools.__all__)


def test_importing_it_imports_nothing_else():
    code = "import sys, corpus_tools; print([n for n in sys.modules if n.startswith('numpy')])"
    assert subprocess.check_output([sys.executable, "-c", code], text=True).strip() == "[]"


@pytest.mark.parametrize("room", sorted({p.parent.name for p in ROOT.glob("*/*.py")} - {"cli"}))
def test_only_the_command_line_prints(room):
    for path in (ROOT / room).glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call):
                assert ast.unparse(node.func) != "print", f"{path.name}:{node.lineno}"
            if isinstance(node, (ast.Import, ast.ImportFrom)):
                text = ast.unparse(node)
                assert not any(name in text for name in ("typer", "rich.", ".cli")), path.name


class TestFit:
    def fit(self, session, out, **options):
        return corpus_tools.fit(
            session.path / "recordings",
            reference=session.reference,
            layout=session.layout,
            out=out,
            **options,
        )

    def test_quiet_with_results_in_the_order_of_the_items(self, session, tmp_path, capsys):
        states = []
        report = self.fit(session, tmp_path, progress=states.append)
        assert capsys.readouterr() == ("", "")
        names = [result.name for state in states for result in state.results]
        assert names == [row["recording"] for row in report.recordings] == ["sim001", "sim002"]
        assert (states[-1].share, states[-1].finished, states[-1].total) == (1.0, 2, 2)
        assert states[-1].frames == sum(row["frames"] for row in report.recordings)
        assert repr(report) == f"FitReport(2 of 2 recordings fitted, out={tmp_path})"
        assert report.errors == {}
        again = self.fit(session, tmp_path)
        assert [row["kept"] for row in again.recordings] == [True, True]

    def test_a_bad_recording_is_in_the_report(self, session, tmp_path):
        bad = tmp_path / "bad.tsv"
        bad.write_bytes(b"nothing")
        report = corpus_tools.fit(
            [bad, session.recordings[0]],
            reference=session.reference,
            layout=session.layout,
            out=tmp_path / "out",
        )
        assert list(report.errors) == ["bad"]
        assert report.errors["bad"].startswith(f"{bad}, line 1: ")
        assert "1 of 2 recordings" in repr(report)
        assert pickle.loads(pickle.dumps(report)).errors == report.errors

    def test_a_part_of_a_recording(self, session, tmp_path):
        everything = self.fit(session, tmp_path / "all")
        part = self.fit(session, tmp_path / "part", between=(0.1, 0.3))
        for row, full in zip(part.recordings, everything.recordings, strict=True):
            assert row["frames"] == 12
            tracks, reference = read_parquet(row["output"]), read_parquet(full["output"])
            assert tracks.start_time == pytest.approx(0.1)
            both = reference.between(0.1, 0.3)
            # The pose of the head depends on the other frames a little.
            assert np.nanmax(np.abs(tracks.values - both.values)) < 0.05
        # It is not taken for the complete one, nor for another part.
        for between in (None, (0.1, 0.2)):
            again = self.fit(session, tmp_path / "part", between=between)
            assert not any(row["kept"] for row in again.recordings)
        nowhere = self.fit(session, tmp_path / "none", between=(50.0, 60.0))
        assert list(nowhere.errors) == ["sim001", "sim002"]

    def test_more_than_the_free_memory_is_refused(self, session, tmp_path, monkeypatch):
        monkeypatch.setattr("mocap_fit.fitting.memory.free_memory", lambda: 2**20)
        report = self.fit(session, tmp_path)
        assert all("--between START-END" in error for error in report.errors.values())
        with pytest.warns(UserWarning, match="--between START-END"):
            content = corpus_tools.info(session.recordings[0]).contents[0]
        assert content["memory_to_fit"] > 0


@pytest.mark.parametrize("between", ["1", "2-1", "1-1", "a-b", "-1-2", "1-2-3"])
def test_a_part_that_is_none_is_a_wrong_call(between, session, tmp_path, capsys):
    call = ["fit", str(session.recordings[0]), "--reference", str(session.reference)]
    call += ["--layout", session.layout, "--out", str(tmp_path / "out"), "--between", between]
    assert app.main(call) == 2
    assert "START-END" in capsys.readouterr().err


def test_convert_returns_the_corpus(lab, tmp_path, capsys):
    states = []
    report = corpus_tools.convert(lab, out=tmp_path / "corpus", progress=states.append)
    assert capsys.readouterr() == ("", "")
    assert len(report.corpus) == 3
    assert report.messages == []
    assert repr(report) == f"ConversionReport(3 of 3 utterances, out={tmp_path / 'corpus'})"
    assert states[-1].finished == 3
    (lab_copy := tmp_path / "lab").mkdir()
    for path in lab.rglob("*"):
        if path.is_file():
            target = lab_copy / path.relative_to(lab)
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_bytes(path.read_bytes())
    (lab_copy / "labels" / "sim002.TextGrid").unlink()
    report = corpus_tools.convert(lab_copy, out=tmp_path / "corpus")
    assert list(report.errors) == ["sim002"]
    assert report.removed == ["sim002"]
    assert len(report.corpus) == 2


def test_train_evaluate_and_info(lab_corpus, tmp_path, capsys):
    trained = corpus_tools.train(lab_corpus, "phone-mean", out=tmp_path / "m.model", validation=0.4)
    assert trained.model.is_fitted
    assert "phone-mean" not in repr(trained)
    assert str(trained.file) in repr(trained)
    assert trained.errors["held_out_error"] is not None
    scored = corpus_tools.evaluate(
        lab_corpus, [trained.file], out=tmp_path / "e", split="all", resamples=100
    )
    assert len(repr(scored).splitlines()) == 3
    assert scored.files[0] == tmp_path / "e" / "index.html"
    described = corpus_tools.info([trained.file, tmp_path / "none.tsv", lab_corpus])
    assert [each.get("content") for each in described.contents] == ["model", None, "corpus"]
    assert list(described.errors) == [str(tmp_path / "none.tsv")]
    assert capsys.readouterr() == ("", "")


def test_validate_and_simulate_are_quiet(tmp_path, capsys):
    seen = []
    out = corpus_tools.simulate(
        tmp_path / "s", utterances=1, progress=lambda *state: seen.append(state)
    )
    assert seen == [("simulating recordings", 1, 1)]
    report = corpus_tools.validate([out.folder / "recordings"], progress=lambda *s: seen.append(s))
    assert seen[-1] == ("checking files", 1, 1)
    assert report.summaries
    assert capsys.readouterr() == ("", "")


class TestManifest:
    def test_the_example_has_every_key_with_its_default(self, tmp_path):
        path = tmp_path / "manifest.toml"
        path.write_text(read_example(), encoding="utf-8")
        assert load_manifest(path) == Manifest(phone_set="en-arpabet")
        text = read_example()

        def keys(model):
            for name, field in model.model_fields.items():
                yield name
                for kind in (field.annotation, *getattr(field.annotation, "__args__", ())):
                    if hasattr(kind, "model_fields"):
                        yield from keys(kind)

        missing = [key for key in keys(Manifest) if key not in text]
        assert missing == []

    def test_what_is_left_out_can_be_put_in(self, tmp_path):
        lines = []
        for line in read_example().splitlines():
            # Keys without a default, and the session.
            bare = line.removeprefix("# ")
            is_key = bare != line and ("[[" in bare or bare.split(" =")[0].isidentifier())
            lines.append(bare if is_key and " = " in bare + " = " else line)
        path = tmp_path / "manifest.toml"
        path.write_text("\n".join(lines), encoding="utf-8")
        manifest = load_manifest(path)
        assert manifest.rate == 60.0
        assert manifest.sessions[0].start_time == 0.1

    def test_the_command_prints_it(self, capsys):
        assert app.main(["convert", "--example"]) == 0
        shown = resources.files("corpus_tools.conversion").joinpath("manifest_example.toml")
        assert capsys.readouterr().out == shown.read_text("utf-8")


def test_one_thread_of_linear_algebra_while_it_lasts():
    def count():
        return {pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"}

    np.linalg.svd(np.eye(3))
    before = count()
    assert limit_to_one_thread()(count)() == {1}
    assert count() == before


def test_a_reference_without_its_markers_is_an_error(session, tmp_path):
    with pytest.raises(DataError, match="the reference pose lacks"):
        corpus_tools.fit(
            session.recordings[0],
            reference=session.reference,
            layout="grid_s1",
            out=tmp_path,
        )
