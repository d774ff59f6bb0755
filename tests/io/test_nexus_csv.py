"""Exports of Nexus with their sections; a literal parser beside ours gives the positions."""

import itertools
import warnings
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from mocap_fit.errors import FileFormatError, MocapFitWarning
from mocap_fit.io import nexus_csv, read_tracks
from mocap_fit.tracks import Event, FloatArray, MarkerTracks

OTHERS = {
    "Devices": ["1000", ",,Amp - EMG", "Frame,Sub Frame,V", ",,V", "1,0,0.5", "1,1,0.25"],
    "Model Outputs": [
        "100",
        ",,Ann:LAnkleAngles,,",
        "Frame,Sub Frame,X,Y,Z",
        ",,deg,deg,deg",
        "1,0,1,2,3",
        "2,0,4,,6",
    ],
    "Joints": ["100", ",,Ann:Root_Head", "Frame,Sub Frame,RX", ",,deg", "1,0,1.5"],
}


def parse_literally(path: Path) -> FloatArray:
    """The numbers between the five lines of titles and the next blank line."""
    lines = path.read_text().splitlines()
    start = lines.index("Trajectories") + 5
    rows = itertools.takewhile(lambda line: line.strip(","), lines[start:])
    cells = [[float(cell) if cell else np.nan for cell in row.split(",")[2:]] for row in rows]
    return np.array(cells).reshape(len(cells), -1, 3)


def read(path: Path, **options: object) -> MarkerTracks:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return read_tracks(path, **options)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "name",
    [
        "nexus.csv",
        "nexus_subject_sections.csv",
        "nexus_ascii.txt",
        "nexus_old.csv",
        "nexus_spreadsheet.csv",
    ],
)
def test_every_variant_gives_the_truth(name: str, recordings: Path, made: ModuleType) -> None:
    tracks = read(recordings / name)
    assert tracks.names == made.MARKERS
    assert (tracks.rate, tracks.start_time) == (made.RATE, 0)
    np.testing.assert_allclose(tracks.positions, made.positions(), rtol=0, atol=1e-9)
    events = tuple(Event(name, time) for name, _, time in made.EVENTS)
    assert tracks.events == (events if "sections" in name else ())


@settings(
    max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(data=st.data())
def test_sections_around_the_trajectories(
    data: st.DataObject, made: ModuleType, tmp_path: Path
) -> None:
    order = data.draw(st.permutations([*OTHERS, "Trajectories"]))
    sections = [name for name in order if name == "Trajectories" or data.draw(st.booleans())]
    first = data.draw(st.sampled_from([1, 101, 70001]))
    trajectories = made.nexus(prefix="Ann:", first=first)
    lines = [""] * data.draw(st.integers(0, 2))
    for name in sections:
        lines += trajectories if name == "Trajectories" else [name, *OTHERS[name]]
        lines += [data.draw(st.sampled_from(["", ",,"]))] * data.draw(st.integers(1, 2))
    path = tmp_path / data.draw(st.sampled_from(["a.csv", "a.txt"]))
    path.write_bytes(made.text(lines, data.draw(st.sampled_from(["\n", "\r\n"]))))
    assert nexus_csv.sniff(path)
    tracks = read(path)
    assert tracks.names == made.MARKERS
    assert tracks.start_time == pytest.approx((first - 1) / 100)
    np.testing.assert_array_equal(tracks.positions, parse_literally(path))
    np.testing.assert_allclose(tracks.positions, made.positions(), rtol=0, atol=1e-9)


def test_velocities_are_left_out(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text(
        "Trajectories\n100\n,,A:b,,,A:b,,,A:c,,\nFrame,Sub Frame,X,Y,Z,X',Y',Z',X,Y,Z\n"
        ",,mm,mm,mm,mm/s,mm/s,mm/s,mm,mm,mm\n5,0,1,2,3,-1,-2,-3,4,5,6\n6,0,1,2,4,-1,-2,-3,4,5,7\n"
    )
    tracks = read(path)
    assert tracks.names == ("b", "c")
    assert tracks.positions[1].tolist() == [[1, 2, 4], [4, 5, 7]]


def test_two_subjects_and_unlabelled_trajectories(made: ModuleType, tmp_path: Path) -> None:
    lines = made.nexus()
    lines[2] = ",,Ann:chin,,,Ann:lip,,,Bo:chin,,,,,,*110,,"
    path = tmp_path / "a.csv"
    path.write_bytes(made.text(lines))
    with pytest.raises(FileFormatError, match=r"line 3: two subjects .*'chin' of Ann and of Bo"):
        read(path)
    tracks = read(path, subject="Bo")
    assert tracks.names == ("chin",)
    np.testing.assert_allclose(tracks.positions[:, 0], made.positions()[:, 2], atol=1e-9)
    lines[2] = ",,Ann:chin,,,Ann:lip,,,Ann:nose,,,,,,*110,,"
    path.write_bytes(made.text(lines))
    assert read(path).names == ("chin", "lip", "nose", "unlabelled 4", "*110")


def test_names_that_are_not_above_their_columns(made: ModuleType, tmp_path: Path) -> None:
    lines = made.nexus()
    lines[2] = ",".join(made.MARKERS)
    path = tmp_path / "a.csv"
    path.write_bytes(made.text(lines))
    assert read(path).names == made.MARKERS


def test_a_unit_and_a_rate_of_the_caller(made: ModuleType, tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_bytes(made.text(made.nexus(rate="")))
    with pytest.raises(FileFormatError, match="line 2: the rate of the trajectories"):
        read(path)
    tracks = read(path, rate=50, unit="cm")
    assert tracks.rate == 50
    np.testing.assert_allclose(tracks.positions, 10 * made.positions(), atol=1e-9)


def test_a_file_cut_off_in_a_row(made: ModuleType, tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_bytes(made.text(made.nexus())[:-30])
    with pytest.warns(MocapFitWarning, match=r"line 17.* 11 complete rows"):
        assert read_tracks(path).frames == 11
