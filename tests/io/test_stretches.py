"""Recordings a stretch at a time: together what is read at once."""

import dataclasses
import re
import warnings
from pathlib import Path

import numpy as np
import pytest

from mocap_fit.errors import DataError, FileFormatError, MocapFitError, MocapFitWarning
from mocap_fit.io import c3d, number_table, read_stretches, read_tracks, reads_in_stretches
from mocap_fit.io import text as text_module
from mocap_fit.tracks import MarkerTracks

FIXTURES = Path(__file__).parents[2] / "fixtures"
SAID = {
    "qualisys_3d_no_header.tsv": {"names": ["a", "b", "c", "d", "e"], "rate": 100.0},
    "timeless.csv": {"rate": 100.0},
}
RECORDINGS = sorted(
    path
    for path in (FIXTURES / "recordings").iterdir()
    if path.suffix in (".tsv", ".csv", ".trc", ".c3d") and "6d" not in path.name
)
DEFECTS = sorted((FIXTURES / "defects").iterdir())


@pytest.fixture(params=[64, 500, 2**22], ids=["tiny", "small", "usual"])
def block_size(request, monkeypatch) -> int:
    """Bytes that are read at once: less than a row, a few rows, all of it."""
    usual = text_module.TextFile.blocks
    monkeypatch.setattr(
        text_module.TextFile, "blocks", lambda self, size=0: usual(self, request.param)
    )
    return request.param


def told(work) -> tuple[object, list[str]]:
    """What comes of it, and what is warned about."""
    with warnings.catch_warnings(record=True) as heard:
        warnings.simplefilter("always", MocapFitWarning)
        result = work()
    return result, sorted(str(one.message) for one in heard)


def assert_same(parts: list[MarkerTracks], whole: MarkerTracks, frames: int) -> None:
    assert [part.frames for part in parts[:-1]] == [frames] * (len(parts) - 1)
    np.testing.assert_array_equal(np.concatenate([p.positions for p in parts]), whole.positions)
    np.testing.assert_array_equal(np.concatenate([p.origin for p in parts]), whole.origin)
    np.testing.assert_allclose(np.concatenate([p.times for p in parts]), whole.times, atol=1e-12)
    for part in parts:
        assert (part.names, part.rate, part.name) == (whole.names, whole.rate, whole.name)
        assert (part.events, part.provenance) == (whole.events, whole.provenance)
    assert parts[0].start_time == whole.start_time


@pytest.mark.parametrize("path", RECORDINGS, ids=lambda path: path.name)
@pytest.mark.parametrize("frames", [1, 3, 1000])
def test_together_they_are_the_whole(path: Path, frames: int, block_size: int) -> None:
    said = SAID.get(path.name, {})
    whole, expected = told(lambda: read_tracks(path, **said))
    parts, heard = told(lambda: list(read_stretches(path, frames=frames, **said)))
    assert_same(parts, whole, frames)
    assert heard == expected


@pytest.mark.parametrize("name", ["points.c3d", "subject_metres.c3d", "two_subjects.c3d"])
def test_other_kinds_of_c3d_go_through_ezc3d(name: str, monkeypatch) -> None:
    """Whole numbers, and other orders of bytes: a copy of the stretch is read."""
    check = c3d.check_structure
    monkeypatch.setattr(
        c3d, "check_structure", lambda path: dataclasses.replace(check(path), plain_floats=False)
    )
    path = FIXTURES / "recordings" / name
    whole = read_tracks(path)
    for frames in (1, 5, 100):
        assert_same(list(read_stretches(path, frames=frames)), whole, frames)


@pytest.mark.real_data
def test_a_long_c3d_file_of_a_laboratory(data_folder: Path) -> None:
    path = data_folder / "c3d" / "qtm2017_body_with_head_markers.c3d"
    whole, expected = told(lambda: read_tracks(path))
    parts, heard = told(lambda: list(read_stretches(path, frames=100)))
    assert_same(parts, whole, 100)
    assert heard == expected


@pytest.mark.parametrize("path", DEFECTS, ids=lambda path: path.name)
def test_what_is_wrong_is_found(path: Path, block_size: int) -> None:
    """The same error in the same line, whichever block it is in."""
    said = SAID.get(path.name, {})
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", MocapFitWarning)
        with pytest.raises(MocapFitError) as expected:
            read_tracks(path, **said)
        with pytest.raises(MocapFitError) as found:
            list(read_stretches(path, frames=2, **said))
    assert type(found.value) is type(expected.value)
    assert found.value.problem == expected.value.problem
    assert found.value.line == expected.value.line


def long_tsv(path: Path, frames: int, cells=lambda i: ("1.5", "2.5", "3.5")) -> Path:
    rows = [f"{i + 1}\t{i / 100:.5f}\t" + "\t".join(cells(i)) for i in range(frames)]
    path.write_text(
        f"NO_OF_FRAMES\t{frames}\nNO_OF_MARKERS\t1\nFREQUENCY\t100\nDATA_INCLUDED\t3D\n"
        "MARKER_NAMES\tnose\nFrame\tTime\tnose X\tnose Y\tnose Z\n" + "\n".join(rows) + "\n"
    )
    return path


def test_faults_at_the_edges(tmp_path: Path, block_size: int) -> None:
    """A frame that is left out, or a word, wherever a block or stretch ends."""
    path = long_tsv(tmp_path / "long.tsv", 60)
    lines = path.read_text().splitlines(keepends=True)
    for row in range(8, 60, 3):
        path.write_text("".join(lines[:row] + lines[row + 1 :]))
        with pytest.raises(FileFormatError, match="frames are left out") as found:
            list(read_stretches(path, frames=7))
        assert found.value.line == row + 1
        path.write_text(
            "".join([*lines[:row], lines[row].replace("2.5", "two"), *lines[row + 1 :]])
        )
        with pytest.raises(FileFormatError, match="nose Y is not a number") as found:
            list(read_stretches(path, frames=7))
        assert found.value.line == row + 1


def test_a_marker_that_comes_late(tmp_path: Path, block_size: int) -> None:
    """A stretch may show nothing; the whole recording may not."""
    path = long_tsv(
        tmp_path / "late.tsv", 50, lambda i: ("1.0", "2.0", "3.0") if i > 40 else ("0.0",) * 3
    )
    parts = list(read_stretches(path, frames=10))
    assert [bool(part.visible.any()) for part in parts] == [False] * 4 + [True]
    long_tsv(path, 50, lambda i: ("0.000",) * 3)
    with pytest.raises(FileFormatError, match="no marker is seen in any frame"):
        list(read_stretches(path, frames=10))


def test_a_rate_that_shows_at_the_end_only(tmp_path: Path) -> None:
    path = long_tsv(tmp_path / "wrong.tsv", 60)
    path.write_text(path.read_text().replace("FREQUENCY\t100", "FREQUENCY\t90"))
    with pytest.raises(FileFormatError, match="contradict each other"):
        list(read_stretches(path, frames=10))


def test_a_row_is_never_longer_than_it_may_be(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr(text_module, "LONGEST_LINE", 200)
    path = long_tsv(tmp_path / "long.tsv", 5)
    path.write_text(path.read_text() + "6\t" + "1" * 400)
    with pytest.raises(FileFormatError, match=re.escape("the line is too long")):
        list(
            number_table.read_number_blocks(
                _rest(path), ["a"] * 5, separator="\t", first_line=7, path=path
            )
        )


def _rest(path: Path):
    with text_module.TextFile(path) as text:
        for _ in range(6):
            text.line()
        yield from text.blocks(50)


def test_other_formats_are_cut_after_reading(tmp_path: Path) -> None:
    markers = FIXTURES / "recordings" / "markers.parquet"
    if not markers.exists():
        markers = next((FIXTURES / "recordings").glob("*marker*.parquet"))
    assert not reads_in_stretches(markers)
    assert_same(list(read_stretches(markers, frames=4)), read_tracks(markers), 4)


@pytest.mark.parametrize("name", ["qualisys_6d.tsv"])
def test_bodies_are_no_markers(name: str) -> None:
    with pytest.raises(DataError, match="does not hold markers"):
        list(read_stretches(FIXTURES / "recordings" / name))
