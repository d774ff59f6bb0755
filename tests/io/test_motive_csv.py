"""Exports of Motive in their versions; a literal parser beside ours gives the positions."""

import csv
import warnings
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from mocap_fit.errors import FileFormatError, MocapFitWarning
from mocap_fit.io import motive_csv, read_tracks
from mocap_fit.tracks import FloatArray, MarkerTracks, Origin

MILLIMETRES = {"Meters": 1000.0, "Centimeters": 10.0, "Millimeters": 1.0}


def parse_literally(path: Path, kind: str) -> dict[str, FloatArray]:
    """Positions by name, in the file's unit, by the rows of titles and nothing else."""
    rows = [row for row in csv.reader(path.read_text().splitlines()) if row]
    titles = {row[1]: row for row in rows[1:4]}
    start = next(index for index, row in enumerate(rows) if row[0] == "Frame")
    found: dict[str, list[list[float]]] = {}
    for column, (type_, quantity) in enumerate(zip(titles["Type"], rows[start - 1], strict=False)):
        if type_ == kind and quantity == "Position":
            cells = [row[column] for row in rows[start + 1 :]]
            values = [float(cell) if cell else np.nan for cell in cells]
            found.setdefault(titles["Name"][column], []).append(values)
    return {name: np.array(columns).T for name, columns in found.items()}


def read(path: Path, warning: str | None = None, **options: object) -> MarkerTracks:
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        tracks = read_tracks(path, **options)  # type: ignore[arg-type]
    assert len(caught) == (warning is not None), [str(each.message) for each in caught]
    assert all(warning in str(each.message) for each in caught if warning)
    return tracks


@pytest.mark.parametrize("name", ["motive", "motive_subject_metres", "motive_spreadsheet"])
def test_measured_markers_are_read(name: str, recordings: Path, made: ModuleType) -> None:
    tracks = read(recordings / f"{name}.csv")
    unlabeled = ("Unlabeled 1000", "Unlabeled 1001") if name == "motive" else ()
    assert tracks.names == (*made.MARKERS, *unlabeled)
    assert (tracks.rate, tracks.start_time) == (made.RATE, 0)
    np.testing.assert_allclose(tracks.positions[:, :5], made.positions(), rtol=0, atol=1e-9)
    assert not tracks.visible[:, 5:].any()
    gaps = np.isnan(tracks.positions).any(axis=2)
    np.testing.assert_array_equal(tracks.origin == Origin.MISSING, gaps)
    np.testing.assert_array_equal(tracks.origin == Origin.MEASURED, ~gaps)


def test_expected_markers_are_not_measured(recordings: Path, made: ModuleType) -> None:
    tracks = read(recordings / "motive_expected.csv", "not measured ones")
    assert tracks.names == made.MARKERS
    assert (tracks.origin == Origin.VIRTUAL).all()
    np.testing.assert_allclose(tracks.positions[0], made.positions()[0] + 1, rtol=0, atol=1e-5)


@settings(
    max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(data=st.data())
def test_every_version_and_order_of_columns(
    data: st.DataObject, made: ModuleType, tmp_path: Path
) -> None:
    others = data.draw(st.permutations(["Rigid Body", "Bone", "Rigid Body Marker", "Marker"]))
    kinds = [kind for kind in others if kind == "Marker" or data.draw(st.booleans())]
    unit = data.draw(st.sampled_from(sorted(MILLIMETRES)))
    options = {
        "version": data.draw(st.sampled_from(["1.1", "1.2", "1.21", "1.22", "1.24", "1.25"])),
        "unit": unit,
        "scale": 1 / MILLIMETRES[unit],
        "prefix": data.draw(st.sampled_from(["", "Face:", "Rigid Body 1:"])),
        "time_code": data.draw(st.booleans()),
        "unlabeled": data.draw(st.integers(0, 3)),
    }
    ending = data.draw(st.sampled_from(["\n", "\r\n"]))
    path = tmp_path / "a.csv"
    path.write_bytes(made.text(made.motive(kinds=kinds, **options), ending))
    assert motive_csv.sniff(path)
    tracks = read(path)
    literal = parse_literally(path, "Marker")
    assert tracks.names == tuple(name.removeprefix(str(options["prefix"])) for name in literal)
    wanted = np.stack(list(literal.values()), axis=1) * MILLIMETRES[unit]
    np.testing.assert_allclose(tracks.positions, wanted, rtol=1e-12, atol=0)
    np.testing.assert_allclose(tracks.positions[:, :5], made.positions(), rtol=0, atol=1e-3)


def test_rows_without_the_words_type_and_name(made: ModuleType, tmp_path: Path) -> None:
    lines = made.motive(kinds=("Marker",))
    lines = [line.replace(",Type,", ",,").replace(",Name,", ",,") for line in lines]
    path = tmp_path / "a.csv"
    path.write_bytes(made.text([line for line in lines if ",ID," not in line]))
    tracks = read(path)
    assert tracks.names == made.MARKERS
    np.testing.assert_allclose(tracks.positions, made.positions(), rtol=0, atol=1e-9)


def test_notes_with_commas(made: ModuleType, tmp_path: Path) -> None:
    lines = made.motive(unit="Meters", scale=0.001)
    lines[0] = lines[0].replace("Take Notes,", "Take Notes,one, two,three")
    path = tmp_path / "a.csv"
    path.write_bytes(made.text(lines))
    tracks = read(path)
    assert tracks.rate == 100
    np.testing.assert_allclose(tracks.positions, made.positions(), rtol=0, atol=1e-3)


def test_every_second_frame(made: ModuleType, tmp_path: Path) -> None:
    """A trimmed take, exported at half the rate of the capture."""
    lines = made.motive()
    lines[0] = lines[0].replace("Export Frame Rate,100", "Export Frame Rate,50")
    lines[0] = lines[0].replace("Exported Frames,12", "Exported Frames,5")
    path = tmp_path / "a.csv"
    path.write_bytes(made.text([*lines[:7], *lines[9::2]]))
    tracks = read(path)
    assert (tracks.rate, tracks.start_time, tracks.frames) == (50, 0.02, 5)
    np.testing.assert_allclose(tracks.positions, made.positions()[2::2], rtol=0, atol=1e-9)


def test_the_clock_of_the_times_wins(made: ModuleType, tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_bytes(made.text([line.replace("100.000000", "120.0") for line in made.motive()]))
    assert read(path, "header says 120 Hz").rate == pytest.approx(100)
    assert read(path, "120 Hz is used", rate=120).rate == 120


def test_a_unit_of_the_caller_and_an_unknown_version(made: ModuleType, tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_bytes(made.text(made.motive(unit="", version="2.0", scale=0.1)))
    with pytest.raises(FileFormatError, match="unit of length"), pytest.warns(MocapFitWarning):
        read_tracks(path)
    tracks = read(path, "version 2.0", unit="cm")
    np.testing.assert_allclose(tracks.positions, made.positions(), rtol=0, atol=1e-4)


def test_two_assets_with_equal_names(made: ModuleType, tmp_path: Path) -> None:
    lines = made.motive(kinds=("Marker",))
    first = lines[3].replace("head left", "A:1").replace("head_right", "B:1")
    lines[3] = first.replace("HEAD TOP", "A:2").replace("näsa", "A:3").replace("chin", "B:2")
    path = tmp_path / "a.csv"
    path.write_bytes(made.text(lines))
    with pytest.raises(FileFormatError, match="line 7: two subjects have a marker of the same"):
        read(path)
    tracks = read(path, subject="A")
    assert tracks.names == ("1", "2", "3")
    np.testing.assert_allclose(tracks.positions, made.positions()[:, [0, 2, 3]], atol=1e-9)
