"""Reference poses that speak or move are named, with a span that would be better."""

import shutil

import pytest

import corpus_tools
from corpus_tools.validation import Context, load_thresholds
from corpus_tools.validation.references import check_reference, find_references
from mocap_fit.edits import SetReference, start_edits, write_edits


@pytest.fixture
def spoken(lab, tmp_path):
    """The lab, whose reference pose is one of its sentences."""
    folder = tmp_path / "lab"
    shutil.copytree(lab, folder)
    shutil.copy(next(iter(sorted((folder / "recordings").iterdir()))), folder / "reference.tsv")
    return folder


def find(*sources):
    context = Context(load_thresholds())
    return {f.code: f for source in sources for f in check_reference(source, context)}


def test_the_reference_of_a_folder_is_checked(lab, spoken):
    assert find(*find_references(lab)) == {}
    (reference,) = find_references(spoken)
    assert reference == str(spoken / "reference.tsv")
    found = find(reference)
    assert set(found) == {"MF128", "MF129", "MF130"}
    assert found["MF128"].location.file == reference
    # What is advised has none of it, named or in the edit list.
    _, _, rest = found["MF130"].advice.partition("reference.tsv@")
    start, end = rest.split(" ")[0].split("-")
    assert find(f"{reference}@{start}-{end}") == {}
    edits = start_edits(reference).add(SetReference(start=float(start), end=float(end)))
    write_edits(edits, f"{reference}.edits.toml")
    assert find(reference) == {}


def test_the_manifest_says_which_it_is(lab, spoken):
    manifest = spoken / "manifest.toml"
    text = manifest.read_text(encoding="utf-8")
    assert 'reference = "reference.tsv"' in text
    manifest.write_text(text.replace("reference.tsv", "reference.tsv@0.5-1"), encoding="utf-8")
    assert find_references(spoken) == [f"{spoken / 'reference.tsv'}@0.5-1"]
    manifest.write_text("= 1", encoding="utf-8")
    assert find_references(spoken) == []
    manifest.unlink()
    assert find_references(spoken) == [str(spoken / "reference.tsv")]


@pytest.mark.slow
def test_validate_and_convert_take_a_span(lab, spoken, tmp_path):
    manifest = spoken / "manifest.toml"
    text = manifest.read_text(encoding="utf-8")
    manifest.write_text(text.replace("reference.tsv", "reference.tsv@0.5-1"), encoding="utf-8")
    codes = {f.code for f in corpus_tools.validate([spoken]).findings}
    assert codes & {"MF128", "MF129", "MF130"}
    shutil.copy(lab / "reference.tsv", spoken / "reference.tsv")
    assert corpus_tools.validate([spoken]).is_clean
    report = corpus_tools.convert(spoken, out=tmp_path / "corpus")
    assert report.errors == {}
    assert report.layout == "face30-head5"


def test_one_that_cannot_be_read_is_named(tmp_path):
    (finding,) = corpus_tools.validate((), reference=[tmp_path / "no.tsv@0-1"]).findings
    assert finding.code == "MF001"
    assert finding.location.file.endswith("no.tsv@0-1")
