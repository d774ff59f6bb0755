"""The block of numbers: the compiled parser and the cell-by-cell one agree; both are exact."""

import time
import warnings
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mocap_fit.errors import FileFormatError, MocapFitWarning
from mocap_fit.io import number_table
from mocap_fit.io.number_table import NumberTable, parse_number, read_numbers

CELLS = st.one_of(
    st.floats(-1e6, 1e6).map(repr),
    st.floats(-1e4, 1e4).map(lambda value: f"{value:.3f}"),
    st.integers(-9999, 9999).map(str),
    st.sampled_from(["", "NaN", "nan", "NULL", "0.000", "-0.000", "1e3", "+5", "1.#QNAN"]),
)


def table(block: bytes, columns: int = 3, separator: str = "\t") -> NumberTable:
    names = [f"column {index}" for index in range(columns)]
    return read_numbers(
        block,
        names,
        separator=separator,  # type: ignore[arg-type]
        first_line=5,
        path=Path("file"),
    )


@settings(max_examples=150, deadline=None)
@given(rows=st.lists(st.lists(CELLS, min_size=3, max_size=3), min_size=1, max_size=8))
def test_both_parsers_agree(rows: list[list[str]]) -> None:
    block = "".join("\t".join(row) + "\n" for row in rows).encode()
    read = table(block)
    expected = [[parse_number(cell) for cell in row] for row in rows]
    np.testing.assert_array_equal(read.values, np.array(expected, dtype=np.float64))
    assert read.lines.tolist() == list(range(5, 5 + len(rows)))


def test_what_the_fast_parser_refuses_is_read_by_cell() -> None:
    block = b"1\t  \t3\n 4 \t5\t6\n"
    lines = number_table._split_lines(block, "\t", 1, 3)
    assert number_table._parse_fast(lines, range(3), "\t", False) is None
    np.testing.assert_array_equal(table(block).values, [[1, np.nan, 3], [4, 5, 6]])


@pytest.mark.parametrize(
    "cell", ["1_000", "0x10", "1.2.3", "--1", "1e", "١", "one", "1 2", "True", "$3"]
)
def test_what_is_no_number(cell: str) -> None:
    block = f"1\t2\t3\n4\t{cell}\t6\n7\t8\t9\n".encode()
    with pytest.raises(FileFormatError, match=r"line 6: column 1 is not a number") as caught:
        table(block)
    assert f"'{cell}' in column 2" in str(caught.value)


def test_decimal_commas_and_points_do_not_mix() -> None:
    np.testing.assert_array_equal(table(b"1,5\t2\t3\n").values, [[1.5, 2, 3]])
    with pytest.raises(FileFormatError, match=r"line 6: column 1 .* decimal comma"):
        table(b"1,5\t2\t3\n1,5\t2.5\t3\n")
    with pytest.raises(FileFormatError, match=r"line 5: column 0"):
        table(b"1,000.5\t2\t3\n")


def test_blank_lines_and_cells_do_not_count() -> None:
    read = table(b"\n1\t2\t3\t\t\n\n   \n4\t5\t6\n\n\n")
    np.testing.assert_array_equal(read.values, [[1, 2, 3], [4, 5, 6]])
    assert read.lines.tolist() == [6, 9]


def test_without_a_last_line_end_digits_tell_whether_the_row_is_whole() -> None:
    even = b"1\t2\t3.25\n1\t2\t3.50\n1\t2\t"
    with pytest.warns(MocapFitWarning, match=r"line 7: the file is cut off"):
        assert len(table(even + b"4.7").values) == 2
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert len(table(even + b"4.75").values) == 3
        # Where the numbers above differ in their digits, nothing can be said.
        assert len(table(b"1\t2\t3.125\n1\t2\t3.5\n1\t2\t4").values) == 3


def test_decimals_are_those_of_the_text() -> None:
    read = table(b"1\t0.10\t1e-3\n2\t0.2\t5\n")
    assert [read.count_decimals(column) for column in range(3)] == [0, 2, 9]


def test_a_long_recording_is_read_fast() -> None:
    """30 s of 60 markers at 200 Hz: over a million numbers."""
    values = np.random.default_rng(0).normal(0, 500, (6000, 180))
    block = b"".join(b"\t".join(b"%.3f" % value for value in row) + b"\n" for row in values)
    begin = time.process_time()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        read = table(block, 180)
    assert time.process_time() - begin < 4
    np.testing.assert_allclose(read.values, values, rtol=0, atol=0.000501)
