"""``mocap-fit demo``: everything that it promises is there, and true."""

import ctypes
import dataclasses
import hashlib
import json
import re
import sys
import warnings

import numpy as np
import pytest

from corpus_tools.cli import app as cli
from corpus_tools.demonstration import demo
from mocap_fit import control
from mocap_fit.corpus import open_corpus
from mocap_fit.errors import MissingExtraError, MocapFitWarning
from mocap_fit.render import require_off_screen
from mocap_fit.render.movie_file import find_ffmpeg
from mocap_fit.tracks import read_parquet

FIGURES = {
    "tracks.png",
    "tracks_other_head.png",
    "residuals.png",
    "accuracy.png",
    "head_motion.png",
}
SHORT = dataclasses.replace(demo.CONDITIONS, duration=0.6)
SMALL = {"conditions": SHORT, "sentences": 6, "epochs": 2}
TOP = {
    "README.txt",
    "index.html",
    "report.json",
    "figures",
    "same_head",
    "other_head",
    "sentences",
    "corpus",
    "models",
    "evaluation",
}

pytestmark = pytest.mark.slow


def can_draw():
    try:
        require_off_screen()
    except MissingExtraError:
        return False
    return True


def can_film():
    try:
        find_ffmpeg()
    except MissingExtraError:
        return False
    return can_draw()


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """The folder of a demo with short recordings."""
    folder = tmp_path_factory.mktemp("demo") / "demo"
    with warnings.catch_warnings():
        # A frame without head pose is nothing unusual here.
        warnings.simplefilter("ignore", MocapFitWarning)
        demo.demo(folder, **SMALL)
    return folder


@pytest.fixture(scope="module")
def report(made):
    return json.loads((made / "report.json").read_text(encoding="utf-8"))


def sums(folder):
    return {
        path.relative_to(folder).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in folder.rglob("*")
        if path.is_file()
    }


def test_what_is_in_the_folder(made):
    top = {path.name for path in made.iterdir()}
    assert top == TOP | ({demo.MOVIE} if can_film() else set())
    for name in top - {"README.txt"}:
        assert name in (made / "README.txt").read_text(encoding="utf-8")
    for session, count in (("same_head", 3), ("other_head", 1)):
        fits = sorted((made / session / "fit").iterdir())
        recordings = sorted((made / session / "recordings").iterdir())
        assert [path.stem for path in fits] == [path.stem for path in recordings]
        assert len(fits) == count
    assert not list(made.rglob("*partial*"))


def test_figures_are_pictures_with_something_on_them(made):
    from matplotlib.image import imread

    expected = FIGURES | ({"faces.png"} if can_draw() else set())
    assert {path.name for path in (made / "figures").iterdir()} == expected
    for path in (made / "figures").iterdir():
        picture = imread(path)[..., :3]
        assert min(picture.shape[:2]) > 500
        # Paper is white, and a good part of it is drawn on.
        assert 0.02 < (picture.min(axis=2) < 0.9).mean() < 0.95


def test_faces_are_drawn(drawing, made):
    from matplotlib.image import imread

    picture = imread(made / "figures" / "faces.png")[..., :3]
    skin = (picture[..., 0] > picture[..., 2] + 0.1).mean()
    assert skin > 0.3


def test_the_report_holds_error_and_bound_of_every_parameter(report):
    assert report["noise_mm"] == 0.3
    for session in ("same_head", "other_head"):
        for objective in ("squares", "distances"):
            result = report["sessions"][session][objective]
            assert len(result["parameters"]) == 10
            for row in result["parameters"].values():
                assert 0.1 < row["rmse_percent"] < 30
                assert row["correlation"] > 0.8
                if session == "other_head":
                    # The bound holds for a face that is the speaker's own.
                    assert row["bound_percent"] is None
                else:
                    assert row["ratio"] == pytest.approx(row["rmse_percent"] / row["bound_percent"])
                    assert 0.5 < row["ratio"] < 1.6
            head = result["head"]
            assert head["shift_rmse_mm"] < 1.6 * head["shift_bound_mm"]
            assert head["turn_rmse_degrees"] < 1.6 * head["turn_bound_degrees"]


def test_the_report_is_about_the_files_beside_it(made, report):
    found, true = [], []
    for path in sorted((made / "same_head" / "fit").iterdir()):
        found.append(read_parquet(path)["jaw_rotation"])
        truth = read_parquet(made / "same_head" / "truth" / "tracks" / path.name)
        true.append(truth["jaw_rotation"])
    found, true = np.concatenate(found), np.concatenate(true)
    seen = np.isfinite(found)
    row = report["sessions"]["same_head"]["distances"]
    assert row["frames"] == len(found)
    assert row["fitted_frames"] == seen.sum()
    expected = 100 * np.sqrt(np.mean((found - true)[seen] ** 2))
    assert row["parameters"]["jaw_rotation"]["rmse_percent"] == pytest.approx(expected)


def test_the_report_tells_neither_place_nor_time(made):
    text = (made / "report.json").read_text(encoding="utf-8")
    assert "/" not in text
    assert not re.search(r"20\d\d-\d\d", text)


def test_models_are_scored_on_sentences_that_they_have_not_seen(made, report):
    scores = report["control_models"]
    corpus = open_corpus(made / "corpus")
    assert scores["utterances"] == {s: len(corpus.get_split(s)) for s in ("test", "train")}
    assert scores["scores"]["utterances"] == len(corpus.get_split("test"))
    trained = [control.load(path) for path in sorted((made / "models").iterdir())]
    assert {model.title for model in trained} == set(scores["scores"]["models"])
    for model in trained:
        about = model.trained_on_
        kept = about["utterances"] + about["validation_utterances"]
        assert kept == len(corpus.get_split("train"))


def test_the_page_holds_every_figure_and_the_movie(made):
    text = (made / "index.html").read_text(encoding="utf-8")
    assert 'src="http' not in text
    assert text.count("<video") == can_film()
    assert text.count("<img") == len(list((made / "figures").iterdir())) + 3
    for model in ("Cohen-Massaro", "ANN 2", "CART", "Rule-based"):
        assert model in text


class TestWhole:
    def test_all_of_it_and_the_same_again(self, tmp_path, capsys, monkeypatch):
        monkeypatch.setenv("COLUMNS", "80")
        folder = tmp_path / "demo"
        assert cli.main(["demo", "--out", str(folder)]) == 0
        shown = capsys.readouterr()
        report = json.loads((folder / "report.json").read_text(encoding="utf-8"))
        for name, row in report["sessions"]["same_head"]["squares"]["parameters"].items():
            (line,) = [line for line in shown.out.splitlines() if line.startswith(name)]
            assert f"{row['bound_percent']:.2f}" in line
            assert f"{row['rmse_percent']:.2f}" in line
            assert row["ratio"] < 1.3
        for row in report["sessions"]["same_head"]["distances"]["parameters"].values():
            assert row["ratio"] < 1.6
        assert "% of a full gesture (1.0 of the parameter)" in shown.out
        assert "…" not in shown.out
        for path in (*(folder / "figures").iterdir(), folder / "report.json"):
            assert str(path) in shown.out
        assert "fitting recordings: 8 of 8" in shown.err

        # A former demo is replaced; what a user put beside it stays.
        before = sums(folder)
        (folder / "notes.txt").write_text("mine")
        (folder / "figures" / "old.png").write_text("left from an older version")
        assert cli.main(["demo", "--out", str(folder), "--json"]) == 0
        shown = capsys.readouterr()
        assert sums(folder) == {**before, "notes.txt": sums(folder)["notes.txt"]}
        printed = json.loads(shown.out)
        assert printed["sessions"] == report["sessions"]
        assert {folder / "figures" / name for name in FIGURES} <= {
            folder / path for path in printed["figures"]
        }

    def test_another_seed_gives_other_numbers(self, made, report, tmp_path):
        demo.demo(tmp_path, seed=5, **SMALL)
        other = json.loads((tmp_path / "report.json").read_text(encoding="utf-8"))
        assert other["seed"] == 5
        assert other["sessions"] != report["sessions"]

    @pytest.mark.skipif(sys.platform != "linux", reason="only Linux needs EGL")
    def test_without_a_way_to_draw_the_rest_is_made(self, tmp_path, monkeypatch):
        def no_library(name, *arguments, **options):
            raise OSError(f"{name}: cannot open shared object file")

        monkeypatch.delenv("DISPLAY", raising=False)
        monkeypatch.delenv("VTK_DEFAULT_OPENGL_WINDOW", raising=False)
        monkeypatch.setattr(ctypes, "CDLL", no_library)
        with pytest.warns(MocapFitWarning, match="apt-get install libegl1"):
            demo.demo(tmp_path, **SMALL)
        assert {path.name for path in (tmp_path / "figures").iterdir()} == FIGURES
        assert {path.name for path in tmp_path.iterdir()} == TOP
