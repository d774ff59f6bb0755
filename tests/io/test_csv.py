"""Plain CSV in its many forms."""

import warnings
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from mocap_fit.errors import FileFormatError, MocapFitWarning
from mocap_fit.io import csv, read_tracks

NAMES = ("commas", "semicolons", "tabs", "two_rows", "quoted_milliseconds", "metres")


@pytest.mark.parametrize("name", NAMES)
def test_every_variant_gives_the_truth(name: str, recordings: Path, made: ModuleType) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        tracks = read_tracks(recordings / f"{name}.csv")
    assert tracks.names == made.MARKERS
    assert tracks.rate == made.RATE
    assert tracks.start_time == 0
    np.testing.assert_allclose(tracks.positions, made.positions(), rtol=0, atol=1e-9)


def test_without_times_the_caller_gives_the_rate(recordings: Path, made: ModuleType) -> None:
    tracks = read_tracks(recordings / "timeless.csv", rate=50)
    assert tracks.rate == 50.0
    np.testing.assert_allclose(tracks.positions, made.positions(), rtol=0, atol=1e-9)


def test_zeros_are_positions(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("time,a_x,a_y,a_z\n0.0,0,0,0\n0.1,0,0,1\n0.2,,,\n")
    tracks = read_tracks(path)
    assert tracks.visible[:, 0].tolist() == [True, True, False]


@pytest.mark.parametrize(
    "titles",
    [
        "time,a_x,a_y,a_z",
        "Time,a X,a Y,a Z",
        "t,a.x,a.y,a.z",
        "Time (s),a:x,a:y,a:z",
        "time_s,aX,aY,aZ",
        "seconds,a-x (mm),a-y (mm),a-z (mm)",
        "frame,time,a_x,a_y,a_z",
        "time,a,a,a\n,x,y,z",
        ",a,,\ntime,X,Y,Z",
        "time,a,,\n,x [mm],y [mm],z [mm]",
        "TIME,a_X,a_Y,a_Z",
    ],
)
def test_titles(titles: str, tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    lead = ("1,", "2,") if titles.startswith("frame") else ("", "")
    path.write_text(f"{titles}\n{lead[0]}1.5,1,2,3\n{lead[1]}1.75,4,5,6\n")
    tracks = read_tracks(path)
    assert tracks.names == ("a",)
    assert tracks.rate == 4.0
    assert tracks.start_time == 1.5
    assert tracks.positions[:, 0].tolist() == [[1, 2, 3], [4, 5, 6]]


def test_metres_are_suspected(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    titles = ",".join(f"{name}_{axis}" for name in "abc" for axis in "xyz")
    path.write_text(f"{titles}\n0.1,0.2,1.5,0.15,0.2,1.5,0.1,0.25,1.6\n")
    with pytest.warns(MocapFitWarning, match=r"are these metres"):
        read_tracks(path, rate=100)


def test_a_file_cut_off_in_a_row(recordings: Path, made: ModuleType, tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_bytes((recordings / "commas.csv").read_bytes()[:-30])
    with pytest.warns(MocapFitWarning, match=r"line 13.* 11 complete rows"):
        assert read_tracks(path).frames == 11


@settings(
    max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(
    rate=st.one_of(st.sampled_from([25, 29.97, 50, 59.94, 60, 120, 240]), st.floats(5, 400)),
    frames=st.integers(20, 300),
    decimals=st.integers(4, 9),
    start=st.floats(0, 100),
)
def test_the_rate_comes_from_rounded_times(
    rate: float, frames: int, decimals: int, start: float, tmp_path: Path
) -> None:
    path = tmp_path / "a.csv"
    rows = [f"{start + frame / rate:.{decimals}f},1,2,3" for frame in range(frames)]
    path.write_text("time,a_x,a_y,a_z\n" + "\n".join(rows) + "\n")
    tracks = read_tracks(path)
    # Never off by more than the rounding of the times can explain.
    assert abs(tracks.duration - frames / rate) <= 2.1 * 10.0**-decimals * frames / (frames - 1)
    assert tracks.times[-1] == pytest.approx(start + (frames - 1) / rate, abs=3 * 10.0**-decimals)


@pytest.mark.parametrize(
    "titles", ["time,a_x,a_y\r,a_z", "time,a_x,a_y," + "z" * 200_000, '"time,a_x,a_y,a_z']
)
def test_titles_that_cannot_be_split(titles: str, tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_bytes(f"{titles}\n0.0,1,2,3\n0.1,1,2,3\n".encode())
    assert not csv.sniff(path)
    with pytest.raises(FileFormatError, match=r"a\.csv"):
        read_tracks(path)


def test_sniff_leaves_other_tables_alone(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    for content in ("start,end,phone\n0,1,a\n", "x\n1\n", "1,2,3\n", "marker,index,role\na,1,b\n"):
        path.write_text(content)
        assert not csv.sniff(path)
