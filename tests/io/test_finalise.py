"""Units, names, limits and rates on both sides of where they decide; tracks that are written."""

import warnings
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

import mocap_fit as mf
from mocap_fit.errors import DataError, FileFormatError, MissingRateError
from mocap_fit.io import finalise
from mocap_fit.io.names import name_tracks
from mocap_fit.io.number_table import NumberTable
from mocap_fit.io.timing import determine_timing
from mocap_fit.tracks import MarkerTracks, ParameterTracks

FILE = Path("take.csv")


@pytest.mark.parametrize(
    ("unit", "millimetres"),
    [
        *[("mm", 1), ("Millimeters", 1), ("cm", 10), ("dm", 100), (" m ", 1000), ("metres", 1000)],
        # The international inch of 1959.
        *[("in", 25.4), ("inches", 25.4), ("FT", 12 * 25.4), ("um", 0.001)],
    ],
)
def test_units_of_length(unit: str, millimetres: float) -> None:
    assert finalise.get_millimetres(unit, path=FILE) == pytest.approx(millimetres)


def test_an_unknown_unit_is_refused() -> None:
    with pytest.raises(FileFormatError, match=r"line 3: the unit of length is not known.*'ell'"):
        finalise.get_millimetres("ell", path=FILE, line=3)


def create(positions: Sequence[object], unit_is_known: bool = False) -> MarkerTracks:
    array = np.array(positions, dtype=float)
    names = [f"m{i}" for i in range(array.shape[1])]
    used = name_tracks(names, path=FILE)
    return finalise.create_tracks(
        MarkerTracks, FILE, "csv", used, 50, {"positions": array}, unit_is_known=unit_is_known
    )


@pytest.mark.parametrize(
    ("positions", "warned"),
    [
        ([[[0, 0, 0], [1, 0, 0], [0, 1.99, 0]]], True),
        ([[[0, 0, 0], [1, 0, 0], [0, 2.01, 0]]], False),
        # The largest spread of all frames counts, and two markers say nothing.
        ([[[0, 0, 0]] * 3, [[0, 0, 0], [1, 0, 0], [0, 2.01, 0]]], False),
        ([[[0, 0, 0], [0, 1.5, 0]]], False),
        ([[[0, 0, 0], [1, 0, 0], [np.nan] * 3]], True),
    ],
)
def test_markers_within_two_millimetres_are_suspected(
    positions: list[object], warned: bool
) -> None:
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        create(positions)
    assert [str(w.message).count("metres?") for w in caught] == ([1] if warned else [])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        create(positions, unit_is_known=True)


def test_no_marker_is_ten_kilometres_away() -> None:
    create([[[1e7, 0, 0]], [[0, -1e7, 0]]])
    with pytest.raises(FileFormatError, match=r"take.csv, frame 1: .* -1.00001e\+07 mm"):
        create([[[0, 0, 0]], [[0, -1.00001e7, 0]]])


def test_gaps_alone_are_refused() -> None:
    with pytest.raises(FileFormatError, match=r"no marker is seen .*2 frames with gaps only"):
        create([[[np.nan, 0, 0]], [[0, np.nan, 0]]])
    with pytest.raises(FileFormatError, match="has no frames"):
        create(np.zeros((0, 1, 3)))


def test_the_step_says_what_the_caller_said() -> None:
    arguments = finalise.list_arguments(name_tracks(["b"], ["a"], path=FILE), 50, "m")
    assert arguments == {"names": ["a"], "rate": 50.0, "unit": "m"}
    assert finalise.list_arguments(name_tracks(["a"], path=FILE)) == {}


def times(values: Sequence[float], decimals: int = 3) -> NumberTable:
    rows = tuple((f"{value:.{decimals}f}",) for value in values)
    array = np.array([[float(cell) for cell in row] for row in rows])
    return NumberTable(array, np.arange(len(rows)) + 2, rows, FILE)


def timing(table: NumberTable, **options: object) -> tuple[float, float]:
    return determine_timing(table, frame=None, time=0, **options)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "rate", [25, 50.5, 24000 / 1001, 30000 / 1001, 60000 / 1001, 120000 / 1001]
)
def test_usual_rates_are_exact(rate: float) -> None:
    assert timing(times(2 + np.arange(3000) / rate)) == (rate, 2.0)


def test_any_other_even_rate_is_the_mean() -> None:
    rate, start = timing(times(np.arange(1001) / 77.77, decimals=5))
    assert rate == pytest.approx(77.77, rel=1e-6)
    assert start == 0.0


@pytest.mark.parametrize(("late", "ok"), [(0.24, True), (0.26, False)])
def test_a_frame_may_be_a_quarter_of_a_frame_late(late: float, ok: bool) -> None:
    values = np.arange(101) / 77.77
    values[50] += late / 77.77
    if ok:
        assert timing(times(values, decimals=6))[0] == pytest.approx(77.77, rel=1e-4)
    else:
        with pytest.raises(FileFormatError, match=r"line 52: the times are not evenly spaced"):
            timing(times(values, decimals=6))


def test_milliseconds_have_three_decimals_more() -> None:
    rate, start = timing(times([1000, 1017, 1033, 1050, 1067], decimals=0), time_unit=0.001)
    assert (rate, start) == (60, 1.0)


def test_one_frame_tells_no_rate() -> None:
    with pytest.raises(FileFormatError, match="one frame does not tell the rate"):
        timing(times([0.0]))
    assert timing(times([1.5]), file_rate=60) == (60, 1.5)
    with pytest.raises(MissingRateError, match="line 7"):
        determine_timing(times([0.0]), frame=None, time=None, line=7)


def test_tracks_are_written_by_their_extension(tmp_path: Path) -> None:
    take = mf.read_tracks(mf.load_sample("take_01"))
    for name in ("a.parquet", "a.tsv", "B.TSV"):
        mf.write_tracks(take, tmp_path / name)
        again = mf.read_tracks(tmp_path / name)
        np.testing.assert_allclose(again.positions, take.positions, rtol=0, atol=5e-4)
        assert again.names == take.names
    assert mf.read_tracks(tmp_path / "a.parquet").equals(take)
    parameters = ParameterTracks(("jaw_rotation",), 60, np.zeros((2, 1)))
    mf.write_tracks(parameters, tmp_path / "p.parquet")
    for tracks, name in ((parameters, "p.tsv"), (take, "a.c3d"), (take, "a")):
        with pytest.raises(DataError, match=r"\.parquet, or \.tsv for markers"):
            mf.write_tracks(tracks, tmp_path / name)
        assert not (tmp_path / name).exists()
    with pytest.raises(FileFormatError, match="cannot be written"):
        mf.write_tracks(take, tmp_path / "none" / "a.tsv")
