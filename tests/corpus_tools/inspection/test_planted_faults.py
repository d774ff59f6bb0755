"""Faults planted in recordings: found in the window's list, mended, and gone from `validate`."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import corpus_tools
import mocap_fit as mf
from corpus_tools.inspection.gather import gather
from corpus_tools.inspection.sources import Sources
from corpus_tools.inspection.window import Window
from mocap_fit.io import write_tracks
from mocap_fit.labels import read_labels, write_labels
from mocap_fit.tracks import read_parquet

pytestmark = pytest.mark.slow


def plant_swap(positions, tracks, one, other, start, end):
    pair = tracks.indices([one, other])
    frames = (tracks.times >= start) & (tracks.times < end)
    positions[np.ix_(frames, pair)] = positions[np.ix_(frames, pair[::-1])]


def plant_spike(positions, tracks, name, frame):
    positions[frame, tracks.index(name)] += (12.0, 9.0, -14.0)


def plant_slip(positions, tracks, name, start):
    positions[tracks.times >= start, tracks.index(name)] += (5.0, -6.0, 4.0)


def plant_mirror(positions, tracks, axis):
    positions[:, :, axis] *= -1


# What is planted, its code, and the keys that mend it after the finding was picked.
PLANTED = {
    "swap": (plant_swap, ("lip_corner_left", "cheek_left", 1.0, 2.0), "MF106", ["x", "Return"]),
    "swap_lips": (plant_swap, ("lip_upper_mid", "chin_mid", 0.5, 1.5), "MF106", ["x", "Return"]),
    "spike": (plant_spike, ("chin_mid", 70), "MF104", ["d"]),
    "spike_of_a_brow": (plant_spike, ("brow_left", 140), "MF104", ["d"]),
    "slip": (plant_slip, ("head_temple_left", 1.5), "MF125", ["d"]),
    "slip_of_the_rim": (plant_slip, ("head_rim_right", 1.0), "MF125", ["d"]),
    "mirrored": (plant_mirror, (0,), "MF122", ["M", "Return"]),
    "mirrored_along_y": (plant_mirror, (1,), "MF122", ["M", "Down", "Return"]),
}


def copy_session(folder: Path) -> Path:
    for name in ("rest", "take_01", "take_01.TextGrid", "take_01.wav"):
        shutil.copy(mf.load_sample(name), folder)
    return folder / "take_01.tsv"


def mend(path: Path, code: str, keys: list[str]) -> Window:
    """Pick the finding in the list, press keys, save."""
    window = Window(gather(path), sources=Sources(), off_screen=True)
    window.press("f")
    (index,) = [k for k, f in enumerate(window.material.findings) if f.code == code][:1]
    left, bottom, _, height = window.areas["panel"]
    _, top, low = next(row for row in window.panel.rows if row[0] == index)
    window.pick(left + 60, window.size[1] - bottom - height + 0.5 * (top + low))
    for key in keys:
        window.press(key, shift=len(key) == 1 and key.isupper())
    assert window.mending.edits.edits, window.message
    assert code not in {finding.code for finding in window.material.findings}
    window.press("s", ctrl=True)
    window.close()
    return window


def validate(path: Path) -> set[str]:
    files = [path, *(each for each in path.parent.glob(f"{path.stem}.*") if each != path)]
    files = [each for each in files if each.suffix != ".toml"]
    report = corpus_tools.validate(files, phone_set="sv-sta", layout="face30-head5")
    return {finding.code for finding in report.findings}


@pytest.mark.parametrize("fault", PLANTED)
def test_a_fault_of_markers_is_mended_in_the_window(fault, tmp_path):
    plant, arguments, code, keys = PLANTED[fault]
    path = copy_session(tmp_path)
    tracks = mf.read_tracks(path)
    positions = tracks.positions.copy()
    plant(positions, tracks, *arguments)
    write_tracks(tracks.replace(positions=positions, origin=None), path)
    spoilt = path.read_bytes()
    assert code in validate(path)
    mend(path, code, keys)
    assert code not in validate(path)
    assert path.read_bytes() == spoilt


def test_a_wrong_phone_is_mended_in_the_window(tmp_path):
    path = copy_session(tmp_path)
    file = path.with_suffix(".TextGrid")
    labels = read_labels(file)
    tiers = []
    for tier in labels.tiers:
        entries = tuple(
            replace(e, text="P") if tier.name == "phones" and e.text == "A:" else e
            for e in tier.entries
        )
        tiers.append(replace(tier, entries=entries))
    write_labels(replace(labels, tiers=tuple(tiers)), file)
    window = mend(path, "MF309", ["l", "A", ":", "Return"])
    assert "A:" in {label.text for label in window.material.tiers["phones"].entries}


def test_a_reference_pose_that_speaks_is_mended_in_the_window(tmp_path):
    """Of a take that is called the reference, a still part takes its place."""
    take = copy_session(tmp_path)
    path = take.with_name("reference.tsv")
    take.rename(path)
    (tmp_path / "rest.tsv").unlink()
    codes = {finding.code for finding in gather(path).findings}
    assert "MF128" in codes
    mend(path, "MF128", ["R"])


def test_convert_and_fit_take_the_edits(tmp_path):
    path = copy_session(tmp_path)
    tracks = mf.read_tracks(path)
    positions = tracks.positions.copy()
    plant_swap(positions, tracks, "lip_corner_left", "cheek_left", 1.0, 2.0)
    write_tracks(tracks.replace(positions=positions, origin=None), path)
    options = {"reference": tmp_path / "rest.tsv", "layout": "face30-head5"}
    corpus_tools.fit(path, out=tmp_path / "before", **options)
    window = mend(path, "MF106", ["x", "Return"])
    corpus_tools.fit(path, out=tmp_path / "after", **options)
    before, after = (
        read_parquet(tmp_path / name / "take_01.parquet") for name in ("before", "after")
    )
    wrong = (before.times >= 1.0) & (before.times < 2.0)
    assert np.nanmedian(before.residuals[wrong]) > 4.0
    assert np.nanmedian(after.residuals[wrong]) < 0.6
    assert any(step.name == "edit" for step in after.provenance)
    # A phone as well, and the recording as one of a session.
    window = Window(gather(path), sources=Sources(), off_screen=True)
    window.line.move_cursor(0.9)
    for key in ("l", "O", "Return"):
        window.press(key)
    window.press("s", ctrl=True)
    window.close()
    session = tmp_path / "session"
    for name, file in {
        "recordings/take_01.tsv": path,
        "recordings/take_01.tsv.edits.toml": path.with_name("take_01.tsv.edits.toml"),
        "labels/take_01.TextGrid": path.with_suffix(".TextGrid"),
        "sound/take_01.wav": path.with_suffix(".wav"),
        "reference.tsv": tmp_path / "rest.tsv",
    }.items():
        (session / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(file, session / name)
    report = corpus_tools.convert(
        session, out=tmp_path / "corpus", phone_set="sv-sta", layout="face30-head5"
    )
    assert not report.errors
    (utterance,) = mf.open_corpus(tmp_path / "corpus")
    assert np.nanmedian(utterance.read_tracks().residuals) < 0.6
    phones = utterance.read_phones()
    assert phones[int(phones.at(np.array([0.9]))[0])].phone == "O"
