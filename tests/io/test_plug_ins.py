"""Readers of another distribution: found by their entry points, and named where they fail."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import mocap_fit as mf
from mocap_fit import io, labels
from mocap_fit.errors import FileFormatError, MocapFitWarning, RegistryError
from mocap_fit.registry import Registry

EXPORT = "MYLAB 50\nnose chin\n0 1 2 3 4 5\n-999 -999 -999 6 7 8\n"

Install = Callable[[Path], None]


@pytest.fixture
def install(monkeypatch: pytest.MonkeyPatch) -> Install:
    """Make the distributions of a folder known, as `pip install` does."""

    def make_known(folder: Path) -> None:
        monkeypatch.syspath_prepend(folder)
        for registry in (io.READERS, labels.LABEL_READERS):
            monkeypatch.setattr(registry, "_entries", None)
            monkeypatch.setattr(registry, "_loaded", {})

    return make_known


def write_distribution(folder: Path, group: str, name: str, code: str) -> None:
    """Write the distribution lab-tools with one reader."""
    metadata = folder / "lab_tools-1.0.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: lab-tools\nVersion: 1.0\n")
    (metadata / "entry_points.txt").write_text(f"[{group}]\n{name} = {folder.name}_reader\n")
    (folder / f"{folder.name}_reader.py").write_text(code)


@pytest.fixture
def export(tmp_path: Path) -> Path:
    path = tmp_path / "take.mylab"
    path.write_text(EXPORT)
    return path


def test_a_reader_of_another_distribution_reads(install: Install, export: Path) -> None:
    install(Path(__file__).parent / "plug_in")
    assert io.find_reader(export) == "mylab"
    tracks = mf.read_tracks(export)
    assert tracks.names == ("nose", "chin")
    assert tracks.rate == 50.0
    np.testing.assert_array_equal(
        tracks.positions, [[[0, 10, 20], [30, 40, 50]], [[np.nan] * 3, [60, 70, 80]]]
    )
    again = mf.read_tracks(export, names=["a", "b"], rate=25)
    assert (again.names, again.rate) == (("a", "b"), 25.0)
    for option in ({"unit": "m"}, {"subject": "Ann"}):
        words = rf"take.mylab: the reader 'mylab' of mylab-reader cannot take {next(iter(option))}"
        with pytest.raises(RegistryError, match=words):
            mf.read_tracks(export, **option)
    assert mf.read_tracks(export, rename={"chin": "jaw"}).names == ("nose", "jaw")
    renamed = export.rename(export.with_name("take.dat"))
    assert mf.read_tracks(renamed).frames == 2
    assert io.READERS.get_distribution("mylab") == "mylab-reader"


def test_its_own_error_about_the_data_passes(install: Install, tmp_path: Path) -> None:
    install(Path(__file__).parent / "plug_in")
    other = tmp_path / "other.mylab"
    other.write_text("hello\nworld\n1 2 3\n")
    with pytest.raises(FileFormatError, match=r"line 1: this is not an export of the My Lab"):
        mf.read_tracks(other)


FAILING = """
description, extensions = "a table", (".lab_table",)
def sniff(path):
    return path.suffix == ".lab_table"
def read(path, **arguments):
    raise IndexError("no such column")
def to_text(utterances, path, **arguments):
    raise KeyError("phones")
"""
RASH = FAILING.replace('return path.suffix == ".lab_table"', 'raise ZeroDivisionError("oh")')


@pytest.mark.parametrize(
    ("group", "read"),
    [("mocap_fit.readers", mf.read_tracks), ("mocap_fit.label_readers", mf.read_phones)],
)
@pytest.mark.parametrize(
    ("code", "words"), [(FAILING, "IndexError: no such column"), (RASH, "ZeroDivisionError: oh")]
)
def test_one_that_fails_is_named(
    group: str,
    read: Callable[[Path], object],
    code: str,
    words: str,
    install: Install,
    tmp_path: Path,
) -> None:
    write_distribution(tmp_path, group, "table", code)
    install(tmp_path)
    path = tmp_path / "a.lab_table"
    path.write_text("0\n")
    with pytest.raises(RegistryError) as caught:
        read(path)
    assert "reader 'table' of lab-tools failed" in str(caught.value)
    assert words in str(caught.value)
    assert str(path) in str(caught.value)


def test_a_writer_of_labels_that_fails_is_named(install: Install, tmp_path: Path) -> None:
    write_distribution(tmp_path, "mocap_fit.label_readers", "table", FAILING)
    install(tmp_path)
    phones = mf.read_phones(mf.load_sample("take_01.TextGrid"))
    with pytest.raises(RegistryError, match=r"'table' of lab-tools failed.*KeyError: 'phones'"):
        labels.write_labels(labels.to_labels(phones), tmp_path / "b.lab_table")
    assert not (tmp_path / "b.lab_table").exists()


@pytest.mark.parametrize(
    ("group", "registry", "sample"),
    [
        ("mocap_fit.readers", io.READERS, "rest"),
        ("mocap_fit.label_readers", labels.LABEL_READERS, "take_01.TextGrid"),
    ],
)
def test_one_that_cannot_be_loaded_is_passed_over(
    group: str, registry: Registry, sample: str, install: Install, tmp_path: Path
) -> None:
    write_distribution(tmp_path, group, "broken", "import no_such_package\n")
    install(tmp_path)
    with pytest.warns(MocapFitWarning, match=r"'broken' of lab-tools cannot be loaded"):
        assert registry.find(mf.load_sample(sample)) in ("qualisys-tsv", "textgrid")


@pytest.mark.parametrize("code", ["import sys; sys.exit(3)", "raise SystemExit"])
def test_one_that_ends_the_program_is_named(code: str, install: Install, tmp_path: Path) -> None:
    failing = FAILING.replace('raise IndexError("no such column")', code)
    write_distribution(tmp_path, "mocap_fit.readers", "table", failing)
    install(tmp_path)
    path = tmp_path / "a.lab_table"
    path.write_text("0\n")
    with pytest.raises(RegistryError, match=r"'table' of lab-tools failed.*SystemExit"):
        mf.read_tracks(path)


def test_the_files_of_the_others_are_still_listed(install: Install, tmp_path: Path) -> None:
    write_distribution(tmp_path, "mocap_fit.readers", "broken", "import no_such_package\n")
    install(tmp_path)
    with pytest.warns(MocapFitWarning, match=r"'broken' of lab-tools cannot be loaded"):
        assert {".tsv", ".c3d", ".trc"} <= io.READERS.list_extensions()
