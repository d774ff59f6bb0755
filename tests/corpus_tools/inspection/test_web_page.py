"""Pages of what was gathered: what is on them, alone, beside a model, compared."""

import json
import re
import shutil

import numpy as np
import pytest

import mocap_fit as mf
from corpus_tools.inspection.gather import Sources, gather
from corpus_tools.inspection.web_page import predict_beside, write_material
from mocap_fit.errors import ConfigurationError


def read_record(path):
    text = path.read_text(encoding="utf-8")
    return json.loads(re.search(r'id="record">(.*?)</script>', text, re.DOTALL)[1])


@pytest.fixture(scope="module")
def material(tmp_path_factory):
    """A quarter of a second of a take, with all that belongs to it."""
    folder = tmp_path_factory.mktemp("takes")
    for name in ("rest", "take_01", "take_01.TextGrid", "take_01.wav"):
        shutil.copy(mf.load_sample(name), folder)
    gathered = gather(folder / "take_01.tsv", Sources(phone_set="sv-sta"))
    part = gathered.measured.between(1.0, 1.25)
    fit = gathered.heads["fit"].between(1.0, 1.25)
    return gathered.replace(
        measured=part, recording=None, sound=None, labels=None, heads={"fit": fit}
    )


def test_a_recording_has_its_markers_measured_and_on_the_face(material, tmp_path):
    page = write_material(predict_beside(material, ["rule-based"]), tmp_path / "take.html")
    record = read_record(page.path)
    sets = [(each["label"], each["head"]) for each in record["markers"]]
    assert sets == [("measured", None), ("virtual", 0), ("virtual", 1)]
    assert [each["label"] for each in record["tracks"]] == ["fit", "Rule-based"]
    assert any("residual" in note for note in record["notes"])
    assert record["rate"] == 60.0
    assert record["phones"][0][2] == "TJ"


def test_models_are_predicted_on_the_frames_that_were_measured(material):
    beside = predict_beside(material, ["rule-based", "rule-based"])
    assert list(beside.heads) == ["fit", "Rule-based", "Rule-based again"]
    fit, rules = beside.heads["fit"], beside.heads["Rule-based"]
    np.testing.assert_allclose(rules.times, fit.times)
    assert predict_beside(material, []) is material
    with pytest.raises(ConfigurationError, match="what is said"):
        predict_beside(material.replace(phones=None), ["rule-based"])


def test_two_of_one_name_are_compared_by_their_folders(material, tmp_path):
    mended = material.measured.replace(name="mended")
    other = material.replace(path=tmp_path / "mended" / "take_01.tsv", measured=mended)
    page = write_material(material, tmp_path / "two.html", other)
    record = read_record(page.path)
    labels = [each["label"] for each in record["tracks"]]
    assert labels == [f"{material.path.parent.name}/take_01.tsv", "mended/take_01.tsv"]
    assert [each["label"] for each in record["markers"]] == labels


def test_a_layout_is_still_and_shows_all_its_markers(tmp_path):
    material = gather("face30-head5")
    page = write_material(material, tmp_path / "layout.html")
    record = read_record(page.path)
    assert (page.duration, page.frames) == (0.0, 1)
    names = {marker.name for marker in material.layout.markers}
    assert set(record["markers"][0]["names"]) == names


def test_markers_without_a_face_are_shown_as_they_were_recorded(material, tmp_path):
    recording = mf.read_tracks(material.path).between(1.0, 1.1)
    bare = material.replace(rig=None, heads={}, measured=None, speaker=None, recording=recording)
    page = write_material(bare, tmp_path / "bare.html")
    record = read_record(page.path)
    assert record["markers"][0]["names"] == list(recording.names)
    assert "mesh" not in record


def test_an_utterance_is_named_after_its_corpus(lab_corpus):
    name = mf.open_corpus(lab_corpus).utterances[1].id
    assert gather(f"{lab_corpus}#{name}").title.endswith(name)
