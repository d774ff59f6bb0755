import json
import shutil

import numpy as np
import pandas as pd
import pytest
import typer

from corpus_tools.cli import app as cli
from corpus_tools.cli.arguments import parse_settings
from corpus_tools.training.evaluate import format_scores, load_models
from corpus_tools.training.train import split_training
from mocap_fit import control
from mocap_fit.corpus import Corpus, Utterance, open_corpus, save_corpus
from mocap_fit.evaluation import GROUPS, LandmarkScores, evaluate
from mocap_fit.evaluation.landmarks import FITTED
from mocap_fit.phones import PhoneSegment, PhoneSequence
from mocap_fit.tracks import ParameterTracks

TARGETS = {"SIL": (0.0, 0.1), "B": (0.0, 0.3), "AA": (0.8, 0.2), "UW": (0.3, 0.9), "S": (0.1, 0.2)}


def utterance(i: int, split: str) -> Utterance:
    """Targets at the centres of the phones, straight lines between, a little noise."""
    rng = np.random.default_rng(i)
    symbols = ["SIL", *rng.choice(["B", "AA", "UW", "S"], 8), "SIL"]
    ends = np.cumsum(rng.uniform(0.06, 0.2, len(symbols)))
    starts = np.concatenate([[0.0], ends[:-1]])
    segments = [PhoneSegment(*row) for row in zip(starts, ends, symbols, strict=True)]
    phones = PhoneSequence(tuple(segments), phone_set="en-arpabet", name=f"u{i:02d}")
    times = np.arange(int(ends[-1] * 60)) / 60
    centres = [s.centre for s in segments]
    targets = np.array([TARGETS[s] for s in symbols])
    values = np.stack([np.interp(times, centres, column) for column in targets.T], axis=1)
    tracks = ParameterTracks(
        ("jaw_rotation", "lip_rounding"),
        60.0,
        values + rng.normal(0, 0.01, values.shape),
        name=phones.name,
    )
    return Utterance.from_tracks(tracks, phones, split=split, text=" ".join(symbols))


@pytest.fixture(scope="module")
def corpus_folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("corpora") / "small"
    made = [utterance(i, "test" if i % 4 == 0 else "train") for i in range(24)]
    save_corpus(Corpus.from_utterances(made, "en-arpabet"), folder)
    return folder


@pytest.fixture(scope="module")
def models(corpus_folder, tmp_path_factory):
    folder = tmp_path_factory.mktemp("models")
    for name in ("mean", "phone-mean"):
        call = ["train", str(corpus_folder), "--model", name, "--out", str(folder / f"{name}.npz")]
        assert cli.main(call) == 0
    return folder


def test_a_trained_model_is_there_and_beats_the_mean(corpus_folder, models, tmp_path, capsys):
    files = [str(models / f"{name}.npz") for name in ("mean", "phone-mean")]
    out = tmp_path / "scores"
    status = cli.main(["evaluate", str(corpus_folder), *files, "--out", str(out), "--json"])
    assert status == 0
    report = json.loads(capsys.readouterr().out)
    assert report["utterances"] == 6
    table = pd.read_csv(out / "scores.csv").set_index(["model", "group", "parameter", "measure"])
    mean, phone_mean = (control.load(file).title for file in files)
    errors = {
        m: table.loc[(m, "all", "average", "rmse_percent"), "value"] for m in report["models"]
    }
    assert errors[phone_mean] < 0.3 * errors[mean]
    apart = pd.read_csv(out / "differences.csv").iloc[0]
    assert apart["low"] < apart["value"] < apart["high"]
    header, ruled, best, _ = (out / "scores.md").read_text().splitlines()
    assert best.split(" | ")[0] == f"| {phone_mean}"
    assert {line.count("|") for line in (header, ruled, best)} == {5}
    page = (out / "index.html").read_text()
    assert page.count("<img") == page.count("data:image/png;base64")
    assert phone_mean in page
    for name in ("scores", "parameters", "trajectories"):
        assert (out / f"{name}.png").stat().st_size > 5000
        assert (out / f"{name}.svg").read_text().startswith("<?xml")


def test_with_markers_the_table_has_those_of_the_fitted_tracks_too(corpus_folder, models):
    loaded = load_models([models / "phone-mean.npz"])
    scores = evaluate(open_corpus(corpus_folder).get_split("test"), loaded, resamples=10)
    (name,) = loaded
    numbers = np.array([[0.9] * 4, [0.5] * 4])
    beside = LandmarkScores((FITTED, name), numbers, numbers[:, 0] - 0.1, numbers[:, 0], 6, 100)
    header, _, first, second = format_scores(scores, beside).splitlines()
    assert header.startswith("| model | lip opening | mouth width")
    assert first.startswith(
        "| fitted tracks | 0.900 | 0.900 | 0.900 | 0.900 | 0.900 [0.800, 0.900]"
    )
    error = scores.to_rows(GROUPS[:1])[1][0][2]
    assert second.endswith(f" | 0.500 [0.400, 0.500] | {error} |")
    assert {line.count("|") for line in (header, first, second)} == {8}


def test_the_same_training_gives_the_same_bytes(corpus_folder, models, tmp_path):
    out = tmp_path / "again.npz"
    call = ["train", str(corpus_folder), "--model", "phone-mean", "--out", str(out)]
    assert cli.main(call) == 0
    assert out.read_bytes() == (models / "phone-mean.npz").read_bytes()
    assert control.load(out).trained_on_["corpus"] == "small"


def test_the_report_of_a_training_is_json(corpus_folder, tmp_path, capsys):
    out = tmp_path / "m.npz"
    call = ["train", str(corpus_folder), "--model", "phone-mean", "--out", str(out), "--json"]
    assert cli.main(call) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["utterances"] + report["held_out_utterances"] == 18
    assert report["free_parameters"] > 0


def test_the_protocols_take_their_own_parts(corpus_folder):
    corpus = open_corpus(corpus_folder)
    training, held_out = split_training(corpus, "clean")
    assert {u.split for u in (*training, *held_out)} == {"train"}
    assert not {u.id for u in training} & {u.id for u in held_out}
    training, held_out = split_training(corpus, "paper")
    assert ({u.split for u in training}, {u.split for u in held_out}) == ({"train"}, {"test"})
    assert (len(training), len(held_out)) == (18, 6)


@pytest.mark.slow
def test_a_model_of_the_papers_protocol_is_marked(corpus_folder, models, tmp_path, capsys):
    paper, out = tmp_path / "paper.npz", tmp_path / "scores"
    call = ["train", str(corpus_folder), "--model", "phone-mean", "--out", str(paper)]
    assert cli.main([*call, "--protocol", "paper"]) == 0
    files = [str(paper), str(models / "phone-mean.npz")]
    call = ["evaluate", str(corpus_folder), *files, "--out", str(out)]
    capsys.readouterr()
    assert cli.main(call) == 0
    shown = capsys.readouterr().out
    title = control.load(paper).title
    assert f"{title} (paper) *" in shown
    assert f"{title} (phone-mean) *" not in shown
    assert "* Trained with the protocol paper: " in shown
    page = (out / "index.html").read_text()
    assert f"{title} (paper) *" in page
    assert "* Trained with the protocol paper: " in page
    written = json.loads((out / "evaluation.json").read_text())
    assert cli.main([*call, "--json"]) == 0
    for report in (json.loads(capsys.readouterr().out), written):
        marks = {name: each["stopped_by_test_set"] for name, each in report["models"].items()}
        assert marks == {f"{title} (paper)": True, f"{title} (phone-mean)": False}
        assert len(report["notes"]) == 1


def test_a_training_on_few_sentences_says_what_to_expect(corpus_folder, tmp_path, capsys):
    call = ["train", str(corpus_folder), "--model", "phone-mean", "--out", str(tmp_path / "m")]
    assert cli.main([*call, "--validation", "0.01"]) == 0
    (line,) = capsys.readouterr().err.splitlines()
    assert "warning: training on 17 utterances: " in line
    assert "a single utterance" in line


def test_settings_are_read_as_toml_or_text():
    found = parse_settings(["stress=false", "hidden = [3, 4]", "kind=linear", "min-count=2.5"])
    assert found == {"stress": False, "hidden": (3, 4), "kind": "linear", "min_count": 2.5}
    nested = parse_settings(["closures.lower_lip_depression=learned", "closures.jaw-rotation=0.1"])
    assert nested == {"closures": {"lower_lip_depression": "learned", "jaw_rotation": 0.1}}
    for wrong in ("stress", "a.=1", ".a=1", "a b=1"):
        with pytest.raises(typer.BadParameter, match="KEY=VALUE"):
            parse_settings([wrong])
    with pytest.raises(typer.BadParameter, match="twice"):
        parse_settings(["a=1", "a.b=2"])


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["train", "nowhere", "--model", "mean", "--out", "m.npz"], "not a corpus"),
        (["train", "{corpus}", "--model", "magic", "--out", "m.npz"], "no control model 'magic'"),
        (["train", "{corpus}", "--model", "mean", "--out", "."], "folder"),
        (["evaluate", "{corpus}", "nothing.npz", "--out", "o"], "nothing.npz"),
        (["evaluate", "{corpus}", "{corpus}/corpus.toml", "--out", "o"], "not a trained model"),
        (["evaluate", "{corpus}", "{model}", "--out", "o", "--split", "dev"], "split 'dev'"),
        (["evaluate", "{corpus}", "{model}", "--out", "o", "--utterance", "x"], "utterance 'x'"),
        (["evaluate", "{corpus}", "{model}", "--out", "o", "--parameter", "x"], "parameter 'x'"),
        (["evaluate", "{corpus}", "{model}", "{model}", "--out", "o"], "one name"),
    ],
)
def test_bad_calls_are_refused_in_words(
    corpus_folder, models, tmp_path, monkeypatch, capsys, arguments, words
):
    monkeypatch.chdir(tmp_path)
    places = {"{corpus}": str(corpus_folder), "{model}": str(models / "mean.npz")}
    for mark, place in places.items():
        arguments = [argument.replace(mark, place) for argument in arguments]
    assert cli.main(arguments) == 1
    assert words in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_a_protocol_that_is_none_is_a_wrong_call(corpus_folder, tmp_path, capsys):
    call = ["train", str(corpus_folder), "--model", "mean", "--out", str(tmp_path / "m")]
    assert cli.main([*call, "--protocol", "mine"]) == 2
    assert "is not one of clean" in capsys.readouterr().err


@pytest.mark.parametrize("setting", ["x=1", "x", "1=2"])
@pytest.mark.parametrize("kind", [["--model", "mean"], ["--sweep-look-ahead"]])
def test_a_setting_that_is_none_is_a_wrong_call(corpus_folder, tmp_path, capsys, kind, setting):
    call = ["train", str(corpus_folder), *kind, "--out", str(tmp_path / "m")]
    assert cli.main([*call, "--set", setting]) == 2
    assert "--set" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_a_setting_of_another_type_is_a_wrong_call(corpus_folder, tmp_path, capsys):
    call = ["train", str(corpus_folder), "--model", "cart", "--out", str(tmp_path / "m")]
    assert cli.main([*call, "--set", "cv=abc"]) == 2
    error = capsys.readouterr().err
    assert "'cv'" in error
    assert "'abc'" in error
    assert "bug" not in error
    assert list(tmp_path.iterdir()) == []


def test_a_sweep_tells_the_error_of_every_look_ahead(corpus_folder, tmp_path, capsys):
    out = tmp_path / "sweep"
    call = ["train", str(corpus_folder), "--sweep-look-ahead", "--out", str(out), "--json"]
    assert cli.main([*call, "--set", "max_iter=2", "--set", "hidden_units=4"]) == 0
    rows = json.loads(capsys.readouterr().out)["look_ahead"]
    assert [row["frames"] for row in rows] == list(range(16))
    table = pd.read_csv(out / "look_ahead.csv")
    assert table["error"].tolist() == pytest.approx([row["error"] for row in rows], rel=1e-5)
    assert {path.name for path in out.iterdir()} == {"look_ahead.csv", "look_ahead.png"}
    assert cli.main([*call, "--model", "mean"]) == 2
    assert cli.main(["train", str(corpus_folder), "--out", str(out)]) == 2


@pytest.mark.slow
def test_dominance_functions_are_drawn(corpus_folder, tmp_path):
    model = tmp_path / "cm.model"
    call = ["train", str(corpus_folder), "--model", "cohen-massaro", "--out", str(model)]
    assert cli.main(call) == 0
    out = tmp_path / "scores"
    assert cli.main(["evaluate", str(corpus_folder), str(model), "--out", str(out)]) == 0
    assert (out / "dominance_cohen_massaro.png").stat().st_size > 5000


@pytest.mark.parametrize("damage", ["cut", "absent", "other", "phones"])
def test_a_damaged_utterance_is_named_and_nothing_is_written(
    damage, corpus_folder, models, tmp_path, capsys
):
    corpus = tmp_path / "corpus"
    shutil.copytree(corpus_folder, corpus)
    part = "phones" if damage == "phones" else "tracks"
    for name in ("u04", "u05"):  # One to score on, and one to learn from.
        path = corpus / part / f"{name}.parquet"
        if damage == "absent":
            path.unlink()
        elif damage == "other":
            shutil.copy(corpus / "phones" / path.name, path)
        else:
            path.write_bytes(path.read_bytes()[:-60])
    calls = {
        "u05": ["train", corpus, "--model", "phone-mean", "--out", tmp_path / "a.model"],
        "u04": ["evaluate", corpus, models / "mean.npz", "--out", tmp_path / "scores"],
    }
    for name, call in calls.items():
        assert cli.main([*map(str, call)]) == 1
        shown = capsys.readouterr()
        (error,) = [line for line in shown.err.splitlines() if "error: " in line]
        assert str(corpus / part / f"{name}.parquet") in error
        assert shown.out == ""
    assert not (tmp_path / "a.model").exists()
    assert not list(tmp_path.glob("scores/*"))
