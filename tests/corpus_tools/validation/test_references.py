"""Reference poses that speak or move are named, with a span that would be better."""

import shutil

import pytest

import corpus_tools
from mocap_fit.edits import SetReference, start_edits, write_edits


@pytest.fixture
def spoken(lab, tmp_path):
    """The lab, whose reference pose is one of its sentences."""
    folder = tmp_path / "lab"
    shutil.copytree(lab, folder)
    shutil.copy(next(iter(sorted((folder / "recordings").iterdir()))), folder / "reference.tsv")
    return folder


def find_codes(*paths, **options):
    findings = corpus_tools.validate(paths, **options).findings
    return {f.code: f for f in findings if f.code in ("MF128", "MF129", "MF130")}


def test_the_reference_of_a_folder_is_checked(lab, spoken):
    assert find_codes(lab) == {}
    found = find_codes(spoken)
    assert set(found) == {"MF128", "MF129", "MF130"}
    assert found["MF128"].location.file == str(spoken / "reference.tsv")
    assert f"{spoken / 'reference.tsv'}@" in found["MF128"].advice
    # What is advised has none of it, named or in the edit list.
    _, _, rest = found["MF130"].advice.partition("reference.tsv@")
    start, end = rest.split(" ")[0].split("-")
    assert find_codes(reference=[f"{spoken / 'reference.tsv'}@{start}-{end}"]) == {}
    edits = start_edits(spoken / "reference.tsv")
    edits = edits.add(SetReference(start=float(start), end=float(end)))
    write_edits(edits, spoken / "reference.tsv.edits.toml")
    assert find_codes(spoken) == {}


def test_the_manifest_says_which_it_is(lab, spoken, tmp_path):
    manifest = spoken / "manifest.toml"
    text = manifest.read_text(encoding="utf-8")
    assert 'reference = "reference.tsv"' in text
    manifest.write_text(text.replace("reference.tsv", "reference.tsv@0.5-1"), encoding="utf-8")
    assert find_codes(spoken)
    shutil.copy(lab / "reference.tsv", spoken / "reference.tsv")
    assert find_codes(spoken) == {}
    report = corpus_tools.convert(spoken, out=tmp_path / "corpus")
    assert report.errors == {}
    assert report.layout == "face30-head5"


def test_one_that_cannot_be_read_is_named(tmp_path):
    (finding,) = corpus_tools.validate((), reference=[tmp_path / "no.tsv@0-1"]).findings
    assert finding.code == "MF001"
    assert finding.location.file.endswith("no.tsv@0-1")
