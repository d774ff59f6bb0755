"""``mocap-fit fit``: recordings in, a Parquet file of parameters each out."""

import hashlib
import json
import os
import re
import subprocess
import sys
from importlib import resources

import numpy as np
import pandas as pd
import pytest

from corpus_tools.cli import app as cli
from mocap_fit.tracks import read_parquet

PARAMETER_NAMES = (
    "jaw_rotation",
    "lip_rounding",
    "upper_lip_retraction",
    "upper_lip_raise",
    "lower_lip_retraction",
    "lower_lip_depression",
    "left_corner_stretch",
    "right_corner_stretch",
    "jaw_thrust",
    "jaw_shift",
)


def fit(session, out, *recordings, layout=None, reference=None, options=()):
    """Run the command; returns its exit status."""
    return cli.main(
        [
            "fit",
            *map(str, recordings),
            "--reference",
            str(reference or session.reference),
            "--layout",
            str(layout or session.layout),
            "--out",
            str(out),
            *map(str, options),
        ]
    )


@pytest.fixture(scope="module")
def fitted(session, tmp_path_factory):
    """The folder with the two recordings of the session, fitted with the default settings."""
    out = tmp_path_factory.mktemp("fitted") / "new" / "folder"
    assert fit(session, out, *session.recordings) == 0
    return out


@pytest.mark.slow
def test_the_first_run_on_a_machine_compiles_each_kernel_once(session, fitted, tmp_path):
    """The bytes are those of a run that finds them in the cache."""
    cache, out = tmp_path / "cache", tmp_path / "out"
    recording = session.recordings[0]
    subprocess.run(
        [
            *(sys.executable, "-c", "from corpus_tools.cli.app import main; main()"),
            *("fit", recording),
            *("--reference", session.reference, "--layout", session.layout, "--out", out),
        ],
        check=True,
        env={**os.environ, "NUMBA_CACHE_DIR": str(cache)},
    )
    kernels = sorted(path.name.partition("-")[0] for path in cache.rglob("*.nbc"))
    assert kernels == ["kernel.evaluate", "native._cost", "newton.solve_frames"]
    name = f"{recording.stem}.parquet"
    assert (out / name).read_bytes() == (fitted / name).read_bytes()


def files(folder):
    return sorted(path.name for path in folder.iterdir())


def sums(folder):
    return {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in folder.iterdir()}


class TestWhatIsWritten:
    def test_one_file_a_recording_and_nothing_else(self, fitted):
        assert files(fitted) == ["sim001.parquet", "sim002.parquet"]

    def test_pandas_reads_the_columns_of_the_design(self, fitted):
        table = pd.read_parquet(fitted / "sim001.parquet")
        deviations = [f"{name}_sd" for name in PARAMETER_NAMES]
        assert list(table.columns) == [
            "utterance",
            "time",
            *PARAMETER_NAMES,
            *deviations,
            "residual_mm",
        ]
        assert set(table["utterance"]) == {"sim001"}
        np.testing.assert_allclose(table["time"], np.arange(30) / 60)
        assert (table.dtypes.drop("utterance") == "float64").all()
        seen = table["residual_mm"].notna()
        assert seen.sum() >= 28
        assert (table.loc[seen, deviations] > 0).all(axis=None)
        assert table.loc[seen, "residual_mm"].between(0.2, 1.0).all()

    def test_the_parameters_are_the_true_ones(self, session, fitted):
        for truth, file in zip(session.truth, sorted(fitted.iterdir()), strict=True):
            error = read_parquet(file).values - read_parquet(truth).values
            root = np.sqrt(np.nanmean(error**2, axis=0))
            # With 0.3 mm of noise the worst Cramér-Rao bound is below 0.08.
            assert root.max() < 0.16
            assert np.median(root) < 0.08

    def test_errors_are_as_large_as_the_file_says(self, session, fitted):
        ratios = []
        for truth, file in zip(session.truth, sorted(fitted.iterdir()), strict=True):
            found = read_parquet(file)
            ratios.append((found.values - read_parquet(truth).values) / found.standard_deviations)
        ratios = np.concatenate(ratios)
        ratios = ratios[np.isfinite(ratios)]
        # The deviations are those of least squares; the sum of distances is a little above.
        assert 0.8 < ratios.std() < 1.5
        assert (np.abs(ratios) < 2).mean() > 0.85

    def test_provenance_is_complete(self, fitted):
        steps = read_parquet(fitted / "sim001.parquet").provenance
        assert [step.name for step in steps] == [
            "read",
            "remove_head_motion",
            "bind_markers",
            "fit_shape",
            "fit_recording",
        ]
        read, head, bind, shape, result = (step.arguments for step in steps)
        assert read["file"] == "sim001.tsv"
        assert len(head["reference_markers"]) == 5
        assert (bind["layout"], bind["face"]) == ("face30-head5", "built-in")
        assert bind["reference"] == "reference"
        assert (shape["objective"], shape["solver"]) == ("distances", "newton-nlopt")
        assert len(result["inputs"]) == 64
        assert 0.2 < result["head_residual_mm"] < 0.6
        assert (result["unfinished_frames"], result["evaluations_per_frame"] > 1) == (0, True)
        assert all(step.version for step in steps)

    def test_nothing_in_the_file_tells_where_or_when_it_was_made(self, session, fitted):
        for path in fitted.iterdir():
            content = path.read_bytes()
            for secret in (session.path, fitted, os.path.expanduser("~")):
                assert str(secret).encode() not in content
            text = json.dumps([s.to_dict() for s in read_parquet(path).provenance])
            assert "/" not in text
            assert not re.search(r"20\d\d-|\b1[78]\d{8}\b", text)

    def test_a_second_run_gives_the_same_bytes(self, session, fitted, tmp_path):
        assert fit(session, tmp_path, *session.recordings) == 0
        assert sums(tmp_path) == sums(fitted)
        # And so does one over files that are there already.
        assert fit(session, tmp_path, session.recordings[0]) == 0
        assert sums(tmp_path) == sums(fitted)

    def test_the_folder_that_it_runs_in_does_not_matter(
        self, session, fitted, tmp_path, monkeypatch
    ):
        monkeypatch.chdir(session.path)
        assert fit(session, tmp_path, "recordings/sim001.tsv", reference="reference.tsv") == 0
        assert sums(tmp_path)["sim001.parquet"] == sums(fitted)["sim001.parquet"]


class TestWhichRecordings:
    def test_a_folder(self, session, fitted, tmp_path):
        assert fit(session, tmp_path, session.path / "recordings") == 0
        assert sums(tmp_path) == sums(fitted)

    def test_a_pattern(self, session, fitted, tmp_path):
        assert fit(session, tmp_path, session.path / "recordings" / "sim*.tsv") == 0
        assert sums(tmp_path) == sums(fitted)

    def test_a_file_named_twice_is_fitted_once(self, session, tmp_path, capsys):
        recording = session.recordings[0]
        assert fit(session, tmp_path, recording, recording, options=["--json"]) == 0
        assert len(json.loads(capsys.readouterr().out)["recordings"]) == 1

    def test_a_name_with_spaces_and_letters_of_any_kind(self, session, tmp_path):
        recording = tmp_path / "zunge ü [1] 舌.tsv"
        recording.write_bytes(session.recordings[0].read_bytes())
        assert fit(session, tmp_path / "out", recording) == 0
        assert files(tmp_path / "out") == ["zunge ü [1] 舌.parquet"]
        assert read_parquet(tmp_path / "out" / "zunge ü [1] 舌.parquet").name == "zunge ü [1] 舌"

    def test_two_of_one_name_are_refused_before_anything_is_done(self, session, tmp_path, capsys):
        twin = tmp_path / "sim001.tsv"
        twin.write_bytes(session.recordings[1].read_bytes())
        assert fit(session, tmp_path / "out", session.recordings[0], twin) == 1
        shown = capsys.readouterr().err
        assert "two recordings are called 'sim001'" in shown
        assert str(twin) in shown
        assert not (tmp_path / "out").exists()

    def test_a_bad_one_does_not_keep_the_others_from_it(self, session, fitted, tmp_path, capsys):
        bad = tmp_path / "bad.tsv"
        bad.write_bytes(session.recordings[0].read_bytes()[:300])
        out = tmp_path / "out"
        first, second = session.recordings
        assert fit(session, out, first, bad, second, options=["--json"]) == 1
        assert sums(out) == sums(fitted)
        shown = capsys.readouterr()
        (line,) = [line for line in shown.err.splitlines() if "error: " in line]
        assert str(bad) in line
        rows = json.loads(shown.out)["recordings"]
        assert ["error" in row for row in rows] == [False, True, False]
        assert rows[1]["file"] == str(bad)
        assert rows[1]["error"] in line


class TestWhatIsShown:
    def test_a_table_for_people(self, session, tmp_path, capsys, monkeypatch):
        monkeypatch.setenv("COLUMNS", "80")
        assert fit(session, tmp_path, *session.recordings) == 0
        shown = capsys.readouterr()
        for word in ("sim001", "sim002", "evaluations", "residual mm"):
            assert word in shown.out
        assert "2 of 2 recordings fitted" in shown.out
        assert str(tmp_path) in shown.out
        assert "fitting recordings: 2 of 2" in shown.err

    def test_a_name_is_shown_as_it_is(self, session, tmp_path, capsys, monkeypatch):
        monkeypatch.setenv("COLUMNS", "100")
        recording = tmp_path / "[bold]a [red]b.tsv"
        recording.write_bytes(session.recordings[0].read_bytes())
        out = tmp_path / "[link] out"
        assert fit(session, out, recording) == 0
        shown = capsys.readouterr().out
        assert "[bold]a [red]b" in shown
        assert str(out) in shown

    def test_many_recordings_are_summed_up(self, session, tmp_path, capsys):
        folder = tmp_path / "many"
        folder.mkdir()
        lines = session.recordings[0].read_bytes().split(b"\r\n")
        short = b"\r\n".join(lines[:16]).replace(b"NO_OF_FRAMES\t30", b"NO_OF_FRAMES\t4")
        for i in range(22):
            (folder / f"r{i:02d}.tsv").write_bytes(short)
        assert fit(session, tmp_path / "out", folder) == 0
        shown = capsys.readouterr().out
        assert "22 of 22 recordings fitted" in shown
        assert "5 recordings with the largest residuals" in shown
        assert shown.count("r0") + shown.count("r1") + shown.count("r2") == 5

    def test_json_agrees_with_the_files(self, session, tmp_path, capsys):
        assert fit(session, tmp_path, *session.recordings, options=["--json"]) == 0
        content = json.loads(capsys.readouterr().out)
        assert content["layout"] == session.layout
        assert content["scale"] == pytest.approx(1.0, abs=0.01)
        assert len(content["orientation_residuals_mm"]) >= 3
        for row, recording in zip(content["recordings"], session.recordings, strict=True):
            assert row["file"] == str(recording)
            assert row["output"] == str(tmp_path / f"{recording.stem}.parquet")
            found = read_parquet(row["output"])
            assert row["frames"] == found.frames
            assert row["fitted"] == np.isfinite(found.residuals).sum()
            assert row["residual_mm"] == pytest.approx(np.nanmedian(found.residuals))
            assert row["uncertain_frames"] == found.uncertain.any(axis=1).sum()
            assert row["unfinished_frames"] == 0
            assert row["evaluations_per_frame"] > 1


def root_errors(session, out):
    error = read_parquet(out / "sim001.parquet").values - read_parquet(session.truth[0]).values
    return np.sqrt(np.nanmean(error**2, axis=0))


class TestHow:
    @pytest.mark.parametrize("objective", ["squares", "huber"])
    def test_objectives(self, objective, session, fitted, tmp_path):
        recording = session.recordings[0]
        assert fit(session, tmp_path, recording, options=["--objective", objective]) == 0
        assert sums(tmp_path)["sim001.parquet"] != sums(fitted)["sim001.parquet"]
        step = read_parquet(tmp_path / "sim001.parquet").provenance[-2]
        assert step.arguments["objective"] == objective
        assert root_errors(session, tmp_path).max() < 0.16

    @pytest.mark.parametrize(
        "solver", ["LD_LBFGS", pytest.param("LN_PRAXIS", marks=pytest.mark.slow)]
    )
    def test_solvers(self, solver, session, fitted, tmp_path):
        """Another way to the same answer."""
        recording = session.recordings[0]
        assert fit(session, tmp_path, recording, options=["--solver", solver]) == 0
        found = read_parquet(tmp_path / "sim001.parquet")
        assert found.provenance[-2].arguments["solver"] == solver
        expected = read_parquet(fitted / "sim001.parquet").values
        assert np.nanpercentile(np.abs(found.values - expected), 95) < 0.02

    def test_the_pose_may_be_refined(self, session, tmp_path):
        options = ["--refine-pose", "--objective", "squares"]
        assert fit(session, tmp_path, session.recordings[0], options=options) == 0
        step = read_parquet(tmp_path / "sim001.parquet").provenance[-2]
        assert step.arguments["refine_pose"] is True
        assert root_errors(session, tmp_path).max() < 0.16

    def test_a_layout_file_of_ones_own(self, session, fitted, tmp_path):
        shipped = resources.files("mocap_fit.fitting").joinpath("layouts", "face30-head5.toml")
        text = shipped.read_text("utf-8").replace('name = "face30-head5"', 'name = "ours"')
        # Without the brows, which no parameter moves.
        blocks = [b for b in text.split("[[markers]]") if 'name = "brow_' not in b]
        layout = tmp_path / "ours.toml"
        layout.write_text("[[markers]]".join(blocks), encoding="utf-8")
        assert fit(session, tmp_path / "out", *session.recordings, layout=layout) == 0
        found = read_parquet(tmp_path / "out" / "sim001.parquet")
        assert found.provenance[-3].arguments["layout"] == "ours"
        expected = read_parquet(fitted / "sim001.parquet").values
        # A sum of distances has flat minima: a tenth of what is known of the value.
        assert np.nanquantile(np.abs(found.values - expected), 0.99) < 0.02
        assert np.nanmax(np.abs(found.values - expected)) < 0.06
        assert not np.array_equal(found.values, expected, equal_nan=True)

    def test_a_rig_file_of_ones_own(self, session, fitted, tmp_path):
        """The built-in head with a jaw that hardly goes to the side."""
        rig = tmp_path / "narrow.toml"
        shipped = resources.files("mocap_fit.face").joinpath("parke.toml").read_text("utf-8")
        (line,) = [line for line in shipped.splitlines() if line.startswith("jaw_shift = ")]
        rig.write_text(shipped.replace(line, "jaw_shift = [-0.05, 0.05]"), encoding="utf-8")
        assert fit(session, tmp_path / "out", session.recordings[0], options=["--face", rig]) == 0
        found = read_parquet(tmp_path / "out" / "sim001.parquet")
        assert found.provenance[-3].arguments["face"] == "narrow.toml"
        assert np.nanmax(np.abs(found["jaw_shift"])) <= 0.05 + 1e-12
        free = read_parquet(fitted / "sim001.parquet")["jaw_shift"]
        assert np.nanmax(np.abs(free)) > 0.05


def test_as_a_process(session, fitted, tmp_path):
    """The program as a user starts it, in a folder of one's own."""
    program = "import sys; from corpus_tools.cli.app import main; sys.exit(main())"
    done = subprocess.run(
        [
            *(sys.executable, "-c", program, "fit", "recordings/*2.tsv"),
            *("--reference", "reference.tsv", "--layout", session.layout),
            *("--out", str(tmp_path / "out")),
        ],
        cwd=session.path,
        capture_output=True,
        encoding="utf-8",
        timeout=600,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert sums(tmp_path / "out") == {"sim002.parquet": sums(fitted)["sim002.parquet"]}


def test_smooth_lowers_the_error(session, fitted, tmp_path):
    out = tmp_path / "smooth"
    assert fit(session, out, *session.recordings, options=["--smooth"]) == 0
    errors = {}
    for folder in (fitted, out):
        differences = [
            read_parquet(folder / f"{path.stem}.parquet").values
            - read_parquet(path.parents[1] / "truth" / "tracks" / f"{path.stem}.parquet").values
            for path in session.recordings
        ]
        errors[folder] = np.sqrt(np.nanmean(np.concatenate(differences) ** 2, axis=0))
    assert errors[out].mean() < 0.9 * errors[fitted].mean()
    step = read_parquet(out / f"{session.recordings[0].stem}.parquet").provenance
    assert "fit_over_time" in [s.name for s in step]
