"""Tables that were read wrong, or refused though they can be read, with the right values."""

import time
import warnings
from pathlib import Path

import numpy as np
import pytest

from mocap_fit.errors import FileFormatError
from mocap_fit.io import read_tracks, write_tracks
from mocap_fit.tracks import MarkerTracks

pytestmark = pytest.mark.real_data


@pytest.fixture
def cases(data_folder: Path) -> Path:
    folder = data_folder.parent / "cases"
    if not folder.is_dir():
        pytest.skip(f"no cases in {folder}")
    return folder


def read(path: Path, warning: str | None = None) -> MarkerTracks:
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        tracks = read_tracks(path)
    assert [warning is not None and warning in str(each.message) for each in caught] == [True] * (
        warning is not None
    )
    return tracks


def test_the_times_say_another_rate(cases: Path) -> None:
    tracks = read(cases / "header_60_times_59_94.tsv", "header says 60 Hz")
    assert tracks.rate == pytest.approx(60000 / 1001, rel=1e-6)
    assert tracks.times[-1] == pytest.approx(30.013, abs=5e-4)


@pytest.mark.parametrize(
    ("name", "warning"),
    [
        ("blank_row_of_tabs.trc", None),
        ("extra_unnamed.trc", "1 trajectory without a name"),
        ("nummarkers_double.trc", "NumMarkers is 4"),
    ],
)
def test_trc(name: str, warning: str | None, cases: Path) -> None:
    tracks = read(cases / name, warning)
    assert (tracks.names, tracks.rate, tracks.start_time) == (("chin", "lip"), 100, 0)
    chin = [[10, 20, 30], [11, 20, 30], [12, 20, 30]]
    lip = [[40, 50, 60], [41, 50, 60], [42, 50, 60]]
    np.testing.assert_array_equal(tracks.positions, np.stack([chin, lip], axis=1))


@pytest.mark.parametrize(
    ("name", "names", "warning"),
    [
        ("two_timestamps.tsv", ("chin", "lip"), None),
        ("description_space.tsv", ("chin", "lip"), None),
        ("dup_names.tsv", ("chin", "chin_2"), "'chin' (now also 'chin_2')"),
    ],
)
def test_tsv(name: str, names: tuple[str, ...], warning: str | None, cases: Path) -> None:
    tracks = read(cases / name, warning)
    assert (tracks.names, tracks.rate) == (names, 100)
    np.testing.assert_array_equal(tracks.positions, [[[10, 20, 30], [40, 50, 60]]] * 3)


def test_titles_of_blanks_are_refused_at_once(cases: Path) -> None:
    begin = time.process_time()
    with pytest.raises(FileFormatError, match=r"line 1: the columns do not come in threes"):
        read_tracks(cases / "hard" / "redos_axis.csv")
    assert time.process_time() - begin < 2


def test_a_row_that_lost_its_end_is_left_out(cases: Path, tmp_path: Path) -> None:
    tracks = read(cases / "hard" / "csv_242a2912.csv", "line 4: the file is cut off in this line")
    assert (tracks.frames, tracks.rate) == (2, 100)
    for name in ("a.tsv", "a.parquet"):
        write_tracks(tracks, tmp_path / name)
        again = read_tracks(tmp_path / name)
        np.testing.assert_allclose(again.positions, tracks.positions, rtol=0, atol=5e-4)
        assert (again.names, again.rate) == (tracks.names, 100)


@pytest.mark.parametrize(
    ("name", "marker"),
    [
        ("dollar", "a$#$"),
        ("escape", "ch\x1b[31min\x1b]0;title\x07"),
        ("html", "<script>alert(1)</script>"),
    ],
)
def test_names_are_read_as_they_are(name: str, marker: str, cases: Path) -> None:
    tracks = read(cases / "hard" / f"{name}.csv")
    assert tracks.names[-1] == marker
    assert (tracks.frames, tracks.rate) == (12, 100)


@pytest.mark.parametrize(
    ("name", "lead"), [("qtm2014_3d_frame_time.tsv", 2), ("qtm2010_3d_no_title_row.tsv", 0)]
)
def test_real_exports_against_a_literal_parser(name: str, lead: int, data_folder: Path) -> None:
    """Every number, by nothing but the tabs of the rows behind the names."""
    path = data_folder / "qualisys" / name
    lines = path.read_text(encoding="cp1252").splitlines()
    start = next(i for i, line in enumerate(lines) if line.startswith("MARKER_NAMES"))
    rows = [line for line in lines[start + 1 :] if line and not line.startswith("Frame")]
    values = np.array([[float(cell) for cell in row.split("\t") if cell] for row in rows])
    wanted = values[:, lead:].reshape(len(rows), -1, 3)
    wanted[(wanted == 0).all(axis=2)] = np.nan
    tracks = read(path)
    assert tracks.names == tuple(cell for cell in lines[start].split("\t")[1:] if cell)
    np.testing.assert_array_equal(tracks.positions, wanted)
