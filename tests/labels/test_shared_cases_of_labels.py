"""The small inputs of /work/shared/cases that are labels, each with what its README says."""

import warnings
from pathlib import Path

import pytest

from mocap_fit.errors import FileFormatError, MocapFitWarning
from mocap_fit.labels import find_label_reader, read_labels, read_phones, write_labels

pytestmark = pytest.mark.real_data


@pytest.fixture
def cases(data_folder: Path) -> Path:
    folder = data_folder.parent / "cases"
    if not folder.is_dir():
        pytest.skip(f"no cases in {folder}")
    return folder


def test_a_size_that_is_too_small(cases):
    path = cases / "size_too_small_first.TextGrid"
    with pytest.warns(MocapFitWarning, match="tier 'words' announces 4 intervals, 5 follow"):
        labels = read_labels(path)
    assert [(tier.name, len(tier.entries)) for tier in labels.tiers] == [
        ("words", 5),
        ("phones", 5),
    ]
    with pytest.warns(MocapFitWarning):
        phones = read_phones(path, phone_set="en-arpabet")
    assert phones.phones == ("sil", "B", "AA", "M", "sil")
    assert phones.starts.tolist() == [0, 0.5, 0.7, 1.2, 1.4]


def test_triphones(cases):
    phones = read_phones(cases / "triphone.lab", phone_set="en-arpabet")
    assert phones.phones == ("sil", "B", "AA", "M", "sil")
    assert phones.ends.tolist() == [0.5, 0.7, 1.2, 1.4, 2.0]


def test_the_table_of_an_aligner(cases):
    path = cases / "mfa.csv"
    assert [tier.name for tier in read_labels(path).tiers] == ["words", "phones"]
    phones = read_phones(path, phone_set="en-arpabet")
    assert [(s.phone, s.stress, s.word) for s in phones] == [
        ("sil", None, ""),
        ("B", None, "bam"),
        ("AA", 1, "bam"),
    ]


def test_the_glottal_stop_of_timit(cases):
    phones = read_phones(cases / "timit_q.phn", phone_set="en-arpabet")
    assert phones.phones == ("sil", "AA", "B", "sil")
    assert phones.starts.tolist() == [0, 0.6, 1.0, 1.125]


def test_hard_files_are_read_or_refused_in_words(cases, tmp_path):
    path = cases / "hard" / "escape.TextGrid"
    labels = read_labels(path)
    write_labels(labels, tmp_path / "escape.TextGrid")
    assert read_labels(tmp_path / "escape.TextGrid") == labels
    with pytest.raises(FileFormatError, match=r"esps_575d34a3.lab, line 5: this is not a time"):
        read_labels(cases / "hard" / "esps_575d34a3.lab")


def test_labels_of_mocha_are_in_seconds(data_folder):
    path = data_folder / "ema" / "mocha_fsew0_001.lab"
    assert find_label_reader(path) == "seconds-lab"
    rows = [line.split() for line in path.read_text().splitlines()]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        read = read_labels(path)
    assert [(e.start, e.end, e.text) for e in read.tiers[0].entries] == [
        (float(start), float(end), text) for start, end, text in rows
    ]
