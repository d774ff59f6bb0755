"""What is planted in recordings is found, and gone when an edit list has mended it."""

import shutil

import numpy as np
import pytest

import corpus_tools
from mocap_fit.edits import (
    DropSpan,
    Merge,
    Mirror,
    MoveBoundary,
    Relabel,
    SetReference,
    Swap,
    start_edits,
    write_edits,
)
from mocap_fit.io import read_tracks, write_tracks
from mocap_fit.labels import read_labels, write_labels


def find_codes(folder):
    findings = corpus_tools.validate([folder], phone_set="sv-sta").findings
    return {finding.code for finding in findings}


@pytest.fixture(scope="module")
def spoilt(lab, tmp_path_factory):
    """A lab whose recordings have a defect or two each, and the edits that mend them, by file."""
    folder = tmp_path_factory.mktemp("spoilt") / "lab"
    shutil.copytree(lab, folder, ignore=shutil.ignore_patterns("truth"))
    first, second, third = sorted((folder / "recordings").iterdir())
    takes = {path: read_tracks(path) for path in (first, second, third)}
    rate = takes[first].rate
    frame = int(rate)

    # A swap over a second, and a slipped head marker from there on.
    swap = Swap(markers=("lip_corner_left", "cheek_left"), start=0.5, end=1.5)
    take = swap.apply(takes[first])
    positions = take.positions.copy()
    positions[2 * frame :, take.index("head_rim_left")] += (0.0, 12.0, 0.0)
    write_tracks(take.replace(positions=positions), first)
    edits = {first: [swap, DropSpan(markers=("head_rim_left",), start=2.0)]}

    # A spike.
    chin = takes[second].index("chin_mid")
    seen = np.flatnonzero(takes[second].visible[:, chin])
    at = int(seen[np.argmin(np.abs(seen - frame))])
    positions = takes[second].positions.copy()
    positions[at, chin] += 40.0
    write_tracks(takes[second].replace(positions=positions), second)
    edits[second] = [DropSpan(markers=("chin_mid",), start=at / rate, end=(at + 1) / rate)]

    # A mirror image, and phones that are mislabelled.
    write_tracks(Mirror().apply(takes[third]), third)
    labels_file = next((folder / "labels").glob(f"{third.stem}.*"))
    labels = read_labels(labels_file)
    tier = labels.get_tier("phones")
    entry = tier.entries[3]
    wrong = start_edits(third).add(Relabel(time=entry.start, phone="nonsense"))
    write_labels(wrong.apply_to_labels(labels, "phones"), labels_file)
    edits[third] = [Mirror(), Relabel(time=entry.start, phone=entry.text, former="nonsense")]

    # A reference pose that speaks, and is at rest before.
    rest, spoken = read_tracks(folder / "reference.tsv"), takes[second]
    still = rest.positions[: int(0.5 * rest.rate)]
    both = np.concatenate([still, spoken.positions])
    write_tracks(rest.replace(positions=both, origin=None), folder / "reference.tsv")
    edits[folder / "reference.tsv"] = [SetReference(start=0.0, end=len(still) / rest.rate)]
    return folder, edits


def test_each_is_found_and_gone_when_it_is_mended(spoilt):
    folder, edits = spoilt
    planted = {"MF104", "MF106", "MF122", "MF125", "MF128", "MF207"}
    assert planted <= find_codes(folder)
    for path, mended in edits.items():
        list_file = path.with_name(f"{path.name}.edits.toml")
        write_edits(start_edits(path).add(*mended), list_file)
    assert find_codes(folder) & planted == set()


@pytest.mark.slow
def test_convert_takes_what_is_mended(spoilt, tmp_path):
    folder, edits = spoilt
    for path, mended in edits.items():
        write_edits(start_edits(path).add(*mended), path.with_name(f"{path.name}.edits.toml"))
    report = corpus_tools.convert(folder, out=tmp_path / "corpus")
    assert report.errors == {}
    assert max(row["residual_mm"] for row in report.to_dict()["utterances"]) < 0.8


@pytest.mark.slow
def test_boundaries_and_merged_phones_are_in_the_corpus(lab, tmp_path):
    folder = tmp_path / "lab"
    shutil.copytree(lab, folder, ignore=shutil.ignore_patterns("truth"))
    path = sorted((folder / "recordings").iterdir())[0]
    labels = read_labels(next((folder / "labels").glob(f"{path.stem}.*")))
    _, first, second, third, *_ = labels.get_tier("phones").entries
    moved = second.end + 0.25 * (third.end - third.start)
    edits = [Merge(time=first.end, phone=first.text), MoveBoundary(time=second.end, to=moved)]
    write_edits(start_edits(path).add(*edits), path.with_name(f"{path.name}.edits.toml"))
    report = corpus_tools.convert(folder, out=tmp_path / "corpus")
    assert report.errors == {}
    phones = next(u for u in report.corpus if u.id == path.stem).read_phones()
    assert phones[1].phone == first.text
    assert (phones[1].start, phones[1].end) == pytest.approx((first.start, moved))
