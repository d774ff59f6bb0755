"""``mocap-fit info`` on what people write, on folders, and on what is shipped."""

import json
import shutil

import pytest

import corpus_tools
from corpus_tools.cli import app as cli
from corpus_tools.inspection.descriptions import describe_folder
from mocap_fit.edits import Mirror, start_edits, write_edits
from mocap_fit.io import load_sample, read_tracks, write_tracks


def describe(path):
    (content, *_) = corpus_tools.info(path).contents
    assert json.loads(json.dumps(content)) == content
    return content


def test_what_is_shipped_is_listed_without_a_file(capsys):
    content = describe(())
    assert "face30-head5" in [row["name"] for row in content["layouts"]]
    assert "sv-sta" in [row["name"] for row in content["phone_sets"]]
    live = {row["name"]: row["live"] for row in content["models"]}
    assert live["ann-low-latency"]
    assert not live["rule-based"]
    assert "upper_lip" in content["regions"]
    assert content["feature_points"][0].startswith("2.1 2.2")
    assert cli.main(["info"]) == 0
    assert "face30-head5" in capsys.readouterr().out


def test_a_layout_by_name_and_by_file(tmp_path):
    content = describe("face30-head5")
    assert (content["content"], content["face_markers"], content["head_markers"]) == (
        "layout",
        30,
        5,
    )
    row = next(row for row in content["markers"] if row["name"] == "lip_corner_left")
    assert (row["feature_point"], row["orientation"]) == ("8.3", True)
    (tmp_path / "mine.toml").write_text('[[markers]]\nname = "a"\nregion = ["chin"]\n')
    report = corpus_tools.info(tmp_path / "mine.toml")
    assert "orientation" in next(iter(report.errors.values()))


def test_a_phone_set_by_class():
    content = describe("en-arpabet")
    classes = {row["class"]: row["symbols"].split() for row in content["phones"]}
    assert {"P", "B", "M"} <= set(classes["bilabial"])
    assert classes["silence"] == ["sil"]
    assert len(classes["vowel"]) == content["vowels"]


def test_a_manifest_says_what_it_would_convert(lab, tmp_path):
    content = describe(lab / "manifest.toml")
    assert (content["utterances"], content["convertible"], content["lacking"]) == (3, 3, [])
    folder = tmp_path / "lab"
    shutil.copytree(lab, folder)
    next((folder / "labels").iterdir()).unlink()
    (folder / "reference.tsv").unlink()
    content = describe(folder / "manifest.toml")
    assert (content["utterances"], content["convertible"]) == (3, 2)
    assert content["lacking"][0] == "reference pose reference.tsv"
    assert "the labels of" in content["lacking"][1]
    shutil.copy(folder / "manifest.toml", tmp_path / "manifest.toml")
    content = describe(tmp_path / "manifest.toml")
    assert content["utterances"] == 0
    assert "--root" in content["lacking"][-1]


def test_a_folder_says_what_it_holds_and_what_it_is_for(lab, tmp_path):
    content = describe_folder(lab)
    assert content["content"] == "folder"
    assert (content["labels"], content["sound"], content["of_one_name"]) == (3, 3, 3)
    assert content["manifest"] == "manifest.toml"
    assert "mocap-fit convert" in content["used_as"]
    shutil.copy(load_sample("take_01"), tmp_path / "take.tsv")
    assert "mocap-fit fit" in describe(tmp_path)["used_as"]


def test_an_edit_list_and_a_file_of_no_kind(tmp_path):
    path = tmp_path / "x.toml"
    write_edits(start_edits(load_sample("take_01")).add(Mirror()), path)
    assert describe(path)["edits"] == [{"edit": "mirror", "axis": "x"}]
    path.write_text("colour = 1")
    assert "nothing says what this file is" in describe(path)["error"]


def test_a_face_file(tmp_path):
    from pathlib import Path

    face = Path(__file__).parents[3] / "fixtures" / "faces" / "mask.toml"
    content = describe(face)
    assert content["content"] == "face"
    assert "jaw_rotation" in content["parameters"]


class TestRecordings:
    def test_its_layout_and_its_stillest_span_are_named(self, tmp_path):
        path = tmp_path / "take.tsv"
        shutil.copy(load_sample("take_01"), path)
        content = describe(path)
        assert content["layout"] == "face30-head5"
        assert content["stillest_span"].startswith(f"{path}@0.")
        assert content["stillest_residual"] < 0.7

    @pytest.mark.parametrize(("dropped", "layout"), [(3, "face30-head5"), (30, None)])
    def test_a_near_miss_says_what_lacks(self, tmp_path, dropped, layout):
        take = read_tracks(load_sample("take_01"))
        write_tracks(take.select(take.names[dropped:]), tmp_path / "take.tsv")
        content = describe(tmp_path / "take.tsv")
        assert content["layout"] == layout
        if layout is not None:
            assert content["lacking_markers"] == list(take.names[:dropped])
