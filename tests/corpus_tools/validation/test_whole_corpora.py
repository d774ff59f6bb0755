"""Whole corpora through the commands: simulate → convert → validate, and real recordings."""

import json
import re
import resource
import shutil
from pathlib import Path

import numpy as np
import pytest
from spoiling import DEFECTS, change_sound
from test_planted_defects import matches

from corpus_tools.cli import app as cli
from corpus_tools.validation.validate import validate
from mocap_fit.corpus import open_corpus
from mocap_fit.utterance import read_utterances, write_utterances

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """287 sentences, simulated and converted."""
    folder = tmp_path_factory.mktemp("whole")
    assert cli.main(["simulate", str(folder / "session"), "--seed", "3"]) == 0
    manifest = folder / "session" / "manifest.toml"
    assert cli.main(["convert", str(manifest), "--out", str(folder / "corpus"), "--jobs", "2"]) == 0
    return folder / "corpus"


def test_a_simulated_corpus_of_287_sentences_is_clean(whole):
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    report = validate([whole])
    grown = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
    assert [f"{f.code} {f.location}: {f.found}" for f in report.findings] == []
    assert len(report.summaries) == 287
    # Kilobytes; the corpus has 200 MB of numbers.
    assert grown < 150_000


def part(whole: Path, folder: Path, names: list[str]) -> Path:
    """A corpus of some of the utterances."""
    rows = [row for row in read_utterances(whole) if row.id in names]
    folder.mkdir()
    shutil.copy(whole / "corpus.toml", folder)
    for file in whole.glob("*/*"):
        if file.stem in names:
            (folder / file.parent.name).mkdir(exist_ok=True)
            shutil.copy(file, folder / file.parent.name)
    write_utterances(rows, folder)
    return folder


def test_all_defects_at_once_are_found_each_in_its_utterance(whole, tmp_path):
    # Long enough for the frames that are spoilt, with lips that close.
    names = [
        utterance.id
        for utterance in open_corpus(whole)
        if utterance.duration > 3.2 and set(utterance.read_phones().phones) & {"B", "P", "M"}
    ]
    assert len(names) >= len(DEFECTS) + 40
    corpus = part(whole, tmp_path / "corpus", names[: len(DEFECTS) + 40])
    planted = {}
    for utterance, (name, plant) in zip(names, DEFECTS.items(), strict=False):
        planted[utterance] = (name, plant(corpus, utterance))
    findings = validate([corpus]).findings
    missed = [
        (
            name,
            [f"{f.code} {f.location}: {f.found}" for f in findings if utterance in str(f.location)],
        )
        for utterance, (name, expected) in planted.items()
        if not any(matches(finding, expected, utterance) for finding in findings)
    ]
    assert missed == []
    false_alarms = []
    for finding in findings:
        concerned = re.search(r"sim\d+", finding.location.utterance or finding.location.file)[0]
        name, expected = planted.get(concerned, ("clean", None))
        if expected is None or finding.code not in {expected.code, *expected.also}:
            false_alarms.append(f"{name} {finding.code} {finding.location}: {finding.found}")
    assert false_alarms == []


def test_shifted_sound_is_found_over_a_session(whole, tmp_path):
    names = [utterance.id for utterance in open_corpus(whole)][:30]
    corpus = part(whole, tmp_path / "corpus", names)

    def later(sound):
        return sound.replace(samples=np.roll(sound.samples, round(0.15 * sound.rate), axis=0))

    for name in names:
        change_sound(corpus, name, later)
    findings = validate([corpus]).findings
    (late,) = [f for f in findings if f.code == "MF147"]
    said = re.search(r"([\d.]+) s early", late.found)
    assert said is not None
    assert float(said[1]) == pytest.approx(0.15, abs=0.05)


@pytest.mark.real_data
def test_grid_s1_has_no_error(data_folder, tmp_path, capsys):
    """The findings of the real corpus, each looked at: see what is asserted."""
    manifest = Path(__file__).parents[3] / "fixtures" / "manifests" / "grid_s1.toml"
    root = data_folder / "grid_s1"
    status = cli.main(["convert", str(manifest), "--root", str(root), "--out", str(tmp_path / "c")])
    assert status == 0
    capsys.readouterr()
    assert cli.main(["validate", str(tmp_path / "c"), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["counts"]["error"] == 0
    # Four videos begin with frames in which no face was found (45 frames), and a few stops are
    # labelled where the lips of the video are open. Nothing else.
    assert set(told["codes"]) <= {"MF109", "MF211", "MF304", "MF309"}
    assert told["codes"]["MF109"] == 4
    assert told["codes"]["MF304"] == 4
    empty = [f["frames"] for f in told["findings"] if f["code"] == "MF109"]
    assert sum(last - first + 1 for first, last in empty) == 45
    assert told["codes"].get("MF309", 0) <= 10
    assert told["codes"].get("MF211", 0) <= 3
