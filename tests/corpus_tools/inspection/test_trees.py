"""``mocap-fit info`` looks into a CART model."""

import json
import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest

from corpus_tools.cli.app import main
from mocap_fit import control
from mocap_fit.phones import write_phones

sys.path.insert(0, str(Path(__file__).parents[2] / "control"))
from cart_cases import corpus, phones_of, rounded_ahead


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("models")
    spoken = corpus(rounded_ahead, count=30, noise=0.02)
    control.create("cart").fit(spoken).save(folder / "cart.npz")
    control.create("phone-mean").fit(spoken).save(folder / "mean.npz")
    write_phones(phones_of("sil L O: K sil"), folder / "new.parquet")
    return folder


def ran(arguments, capsys):
    status = main([str(each) for each in ("info", *arguments)])
    return status, *capsys.readouterr()


def test_a_tree_is_shown_and_drawn(folder, capsys):
    svg = folder / "tree.svg"
    model = folder / "cart.npz"
    status, out, _ = ran([model, "--tree", "L/lip_rounding", "--svg", svg], capsys)
    assert status == 0
    assert out.startswith("L / lip_rounding: 2 leaves")
    assert ElementTree.parse(svg).getroot().tag.endswith("svg")
    status, out, _ = ran([model, "--tree", "L/lip_rounding", "--json"], capsys)
    assert json.loads(out)["tree"] == "L/lip_rounding"


def test_targets_are_explained(folder, capsys):
    model, phones = folder / "cart.npz", folder / "new.parquet"
    status, out, _ = ran([model, "--explain", phones], capsys)
    assert status == 0
    assert "right phone: O: -> O:" in out
    assert "no tree of its own" in out
    status, out, _ = ran([model, "--explain", phones, "--tree", "L/lip_rounding", "--json"], capsys)
    (reason,) = json.loads(out)
    assert reason["phone"] == "L"
    assert reason["answers"][0]["question"] == "right phone"


def test_the_importance_of_questions_is_shown(folder, capsys):
    status, out, _ = ran([folder / "cart.npz", "--questions", "--json"], capsys)
    assert status == 0
    shares = json.loads(out)["importance"]["lip_rounding"]
    assert shares["right phone"] > 0.9
    status, out, _ = ran([folder / "cart.npz", "--questions"], capsys)
    assert status == 0
    assert "right phone" in out


@pytest.mark.parametrize(
    ("arguments", "status", "words"),
    [
        (["mean.npz", "--questions"], 1, "has no trees"),
        (["cart.npz", "--tree", "L/nose"], 1, "names no tree"),
        (["cart.npz", "--tree", "K/lip_rounding"], 1, "no tree of 'K'"),
        (["cart.npz", "--svg", "x.svg"], 1, "no tree to draw"),
        (["cart.npz", "--tree", "L/lip_rounding", "--svg", "none/x.svg"], 1, "cannot be written"),
        (["cart.npz", "--explain", "none.parquet"], 1, "none.parquet"),
        (["cart.npz", "mean.npz", "--tree", "L/lip_rounding"], 2, "one model"),
        (["none.npz", "--questions"], 1, "none.npz"),
    ],
)
def test_what_cannot_be_shown_is_said_in_a_line(
    folder, capsys, monkeypatch, arguments, status, words
):
    monkeypatch.chdir(folder)
    found, out, err = ran(arguments, capsys)
    assert found == status
    assert words in err
    assert "Traceback" not in err
    assert not out
