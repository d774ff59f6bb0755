"""Two clocks in a file: the rate of its header, and the times of its frames."""

import warnings
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mocap_fit.errors import FrameTimesError, MocapFitWarning, RateMismatchError
from mocap_fit.io.number_table import NumberTable
from mocap_fit.io.timing import determine_timing

FILE = Path("take.csv")


def times(values: Sequence[float], decimals: int = 3) -> NumberTable:
    rows = tuple((f"{value:.{decimals}f}",) for value in values)
    array = np.array([[float(cell) for cell in row] for row in rows])
    return NumberTable(array, np.arange(len(rows)) + 2, rows, FILE)


def timing(table: NumberTable, **options: object) -> tuple[float, float]:
    return determine_timing(table, frame=None, time=0, **options)  # type: ignore[arg-type]


@pytest.mark.parametrize(("rate", "drifts"), [(100.04, False), (99.96, False), (100.06, True)])
def test_times_win_where_they_drift_from_the_header(rate: float, drifts: bool) -> None:
    """Half a frame of a thousand and one is 0.05 per cent."""
    table = times(np.arange(1001) / 100)
    if drifts:
        with pytest.warns(MocapFitWarning, match=r"header says 100.06 Hz, .* 100 Hz, which is"):
            assert timing(table, file_rate=rate) == (100.0, 0.0)
    else:
        assert timing(table, file_rate=rate) == (rate, 0.0)
    assert timing(table, file_rate=rate, rate=25) == (25, 0.0)


@settings(max_examples=60, deadline=None)
@given(
    rate=st.floats(10, 500),
    frames=st.integers(2, 400),
    decimals=st.integers(2, 9),
    start=st.sampled_from([0.0, 0.00833, 59.94, 3600.0]),
)
def test_rounding_is_no_drift(rate: float, frames: int, decimals: int, start: float) -> None:
    values = np.round(start + np.arange(frames) / rate, decimals)
    if (np.diff(values) <= 0).any():
        return
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert timing(times(values, decimals), file_rate=rate) == (rate, pytest.approx(values[0]))


@settings(max_examples=60, deadline=None)
@given(
    rate=st.floats(20, 300),
    factor=st.sampled_from([0.5, 0.999, 1.001, 1.02, 2.0]),
    frames=st.integers(600, 2000),
    decimals=st.integers(3, 6),
)
def test_the_clock_of_the_times(rate: float, factor: float, frames: int, decimals: int) -> None:
    table = times(np.round(1 + np.arange(frames) / rate, decimals), decimals)
    first, last = table.values[[0, -1], 0]
    with pytest.warns(MocapFitWarning, match="but the times of the frames"):
        assert timing(table, file_rate=rate * factor)[0] == (frames - 1) / (last - first)


@pytest.mark.parametrize("header", [50.0, 100.0])
def test_a_frame_out_of_line_is_named(header: float) -> None:
    values = np.arange(200) / 50
    values[[70, 120]] += 0.6 / 50
    with pytest.raises(RateMismatchError, match=r"line 72, frame 70: .*Hz and 50 Hz"):
        timing(times(values, 5), file_rate=header)
    assert timing(times(values, 5), file_rate=header, rate=50)[0] == 50


def test_a_jump_is_out_of_line() -> None:
    values = np.arange(100) / 50 + 0.2 * (np.arange(100) >= 60)
    with pytest.raises(RateMismatchError, match="frame"):
        timing(times(values, 5), file_rate=50)


def test_times_that_begin_again_are_refused_unless_the_rate_is_known() -> None:
    values = np.concatenate([np.arange(50), np.arange(50)]) / 50
    with pytest.raises(FrameTimesError, match=r"line 52: .*0 after 0.98"):
        timing(times(values), file_rate=50)
    assert timing(times(values), file_rate=50, rate=50) == (50, 0.0)


@pytest.mark.parametrize("options", [{"file_rate": 100.0}, {"rate": 100.0}])
def test_times_in_milliseconds_are_known_by_the_rate(options: dict[str, float]) -> None:
    with pytest.warns(MocapFitWarning, match="taken as milliseconds, which fits 100 Hz"):
        assert timing(times(2000 + 10.0 * np.arange(100), 1), **options) == (100.0, 2.0)


def test_a_rate_that_nobody_records_at_is_said() -> None:
    with pytest.warns(MocapFitWarning, match="0.1 frames a second: are they milliseconds"):
        assert timing(times(10.0 * np.arange(100), 0))[0] == 0.1
