"""What is gathered for the eyes: of a recording, a fit, a layout, an utterance."""

import numpy as np
import pytest

from corpus_tools.inspection.gather import gather
from corpus_tools.inspection.sources import Sources
from mocap_fit.edits import DropMarker, Relabel, start_edits, write_edits
from mocap_fit.errors import MocapFitError
from mocap_fit.tracks import write_parquet


def test_a_recording_comes_with_all_that_is_beside_it(material):
    assert list(material.heads) == ["fit"]
    assert list(material.tiers) == ["words", "phones"]
    assert material.layout.name == "face30-head5"
    assert material.sound.duration == pytest.approx(material.extent[1])
    assert material.edits.edits == ()


def test_measured_markers_are_near_those_on_the_face(material):
    frames = [20, 90, 150]
    virtual = material.compute_virtual("fit", material.heads["fit"].times[frames])
    chosen = material.measured.indices(material.speaker.binding.names)
    distances = np.linalg.norm(material.measured.positions[frames][:, chosen] - virtual, axis=2)
    assert np.nanmedian(distances) < 0.6


def test_a_fit_finds_its_recording_beside_it(recording, material):
    path = recording.with_suffix(".parquet")
    write_parquet(material.heads["fit"], path)
    again = gather(path)
    assert again.heads["fit"].equals(material.heads["fit"])
    assert again.measured.equals(material.measured)


def test_an_edit_list_beside_the_recording_is_applied(recording):
    edits = start_edits(recording).add(
        DropMarker(marker="fold_left"), Relabel(time=0.9, phone="O", former="A")
    )
    list_file = recording.with_name(f"{recording.name}.edits.toml")
    write_edits(edits, list_file)
    mended = gather(recording)
    list_file.unlink()
    assert "fold_left" not in mended.recording.names
    assert "O" in {label.text for label in mended.tiers["phones"].entries}
    assert mended.edits == edits


def test_a_layout_is_shown_on_the_face():
    shown = gather("face30-head5")
    assert shown.layout.name == "face30-head5"
    assert shown.rig is not None
    assert not shown.tracks


def test_what_is_no_recording_is_refused_in_words(tmp_path):
    path = tmp_path / "take.tsv"
    path.write_text("nothing\n", "utf-8")
    with pytest.raises(MocapFitError, match="take"):
        gather(path)
    with pytest.raises(MocapFitError, match="none"):
        gather(tmp_path / "none.tsv", Sources())
