"""Read a table of numbers in text fast, with the exact line and column of an error.

The table is parsed by pandas' compiled parser. Where that fails, each cell is parsed on its own,
which accepts a little more (cells of blanks) and names the cell that is not a number.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from mocap_fit.errors import FileFormatError, MocapFitWarning
from mocap_fit.io.text import decode_line
from mocap_fit.tracks import FloatArray

MISSING_WORDS = frozenset(
    (
        *("", "nan", "-nan", "+nan", "na", "n/a", "null", "none"),
        *("nan(ind)", "-nan(ind)", "1.#qnan", "-1.#qnan", "1.#ind", "-1.#ind"),
    )
)
"""Spellings of a missing number, in lower case and without blanks around them."""

_SAMPLE = 100
"""Number of rows that tell how the numbers of a column were written."""

_SPELLINGS = sorted(
    {form for word in MISSING_WORDS for form in (word, word.upper(), word.capitalize())} | {"NaN"}
)


def is_missing(cell: str) -> bool:
    """Return whether a cell stands for a missing number.

    Parameters
    ----------
    cell
        Text of the cell.

    Returns
    -------
    bool
        Whether it is one of `MISSING_WORDS`.
    """
    return cell.strip().lower() in MISSING_WORDS


def parse_number(cell: str, decimal_comma: bool = True) -> float | None:
    """Parse the number in a cell.

    Parameters
    ----------
    cell
        Text of the cell.
    decimal_comma
        Whether a comma is a decimal point.

    Returns
    -------
    float or None
        The number; NaN for a missing one, None for other text.
    """
    text = cell.strip()
    if text.lower() in MISSING_WORDS:
        return float("nan")
    if "_" in text or not text.isascii():
        return None
    if decimal_comma and "," in text:
        if "." in text:
            return None
        text = text.replace(",", ".")
    try:
        return float(text)
    except ValueError:
        return None


@dataclass(frozen=True)
class NumberTable:
    """A table of numbers.

    Parameters
    ----------
    values
        Numbers, ``(rows, columns)``, in the units of the file; NaN where missing.
    lines
        Lines of the rows in the file, ``(rows,)``.
    sample
        Cells of the first rows, as they were written.
    path
        File for messages.
    surplus
        Largest number of filled cells behind the columns, which were not read.
    """

    values: FloatArray
    lines: NDArray[np.intp]
    sample: tuple[tuple[str, ...], ...]
    path: Path
    surplus: int = 0

    def count_decimals(self, column: int) -> int:
        """Return the number of digits after the point that a column was written with.

        Parameters
        ----------
        column
            Index of the column.

        Returns
        -------
        int
            Number of digits, at most 9.
        """
        cells = [row[column].strip() for row in self.sample]
        if any("e" in cell.lower() for cell in cells if not is_missing(cell)):
            return 9
        return min(9, max((_count_digits(cell) for cell in cells), default=0))

    def to_positions(self, first: int, scale: float = 1.0) -> FloatArray:
        """Return the columns from one on as positions.

        Parameters
        ----------
        first
            Index of the column of the first coordinate.
        scale
            Millimetres in the unit of the file.

        Returns
        -------
        ndarray
            Positions, ``(frames, markers, 3)``, millimetres.
        """
        positions = self.values[:, first:].reshape(len(self.values), -1, 3)
        # Infinite where it is too large, which `create_tracks` refuses.
        with np.errstate(over="ignore"):
            return positions if scale == 1 else positions * scale


@dataclass(frozen=True)
class _Lines:
    """The lines of a block: its text, the number and the number of cells of each line."""

    block: bytes
    numbers: NDArray[np.intp]
    cells: NDArray[np.intp]
    terminated: bool


def read_numbers(
    block: bytes,
    columns: Sequence[str],
    separator: Literal["\t", ",", ";"],
    first_line: int,
    path: Path,
    expected_rows: int | None = None,
    *,
    used: Sequence[int] | None = None,
    numbered: bool = False,
    unnamed: bool = False,
) -> NumberTable:
    r"""Read the rows of numbers at the end of a file.

    Decimal commas are accepted where the separator is not a comma. Quotation marks and blank lines
    are left out, and so are blank cells after the last column and a last line that was cut off.

    Parameters
    ----------
    block
        Lines that end with ``\n``; the last one may not.
    columns
        Names of the columns for messages; a row needs as many cells.
    separator
        Separator of the cells.
    first_line
        Number of the first line of the block in the file.
    path
        File for messages.
    expected_rows
        Number of rows in the header of the file.
    used
        Indices of the columns to read, in ascending order; the others may hold any text. All where
        not given.
    numbered
        Whether every row has the number or the time of its frame, so that a row of blank cells is
        a blank line and not a frame of gaps.
    unnamed
        Whether further columns may follow, three a trajectory, which are not read.

    Returns
    -------
    NumberTable
        The rows, with the used columns.

    Raises
    ------
    FileFormatError
        If there is no complete row, a row has too few or too many cells, or a cell is not a
        number.

    Warns
    -----
    MocapFitWarning
        If the last line is incomplete, or there are not as many rows as expected.
    """
    if b'"' in block:
        block = block.replace(b'"', b"")
    lines = _split_lines(block, separator, first_line, len(columns), numbered)
    if lines.numbers.size == 0:
        raise FileFormatError(
            "there is no row of numbers",
            path=path,
            line=first_line,
            expected="one line a frame" if expected_rows is None else f"{expected_rows} lines",
            advice="Export or copy the recording again.",
        )
    lost = _find_lost_line(lines, len(columns), separator)
    if lost is not None:
        lines = _drop_last(lines)
        if lines.numbers.size == 0:
            raise FileFormatError(
                "the file is cut off before its first row is complete",
                path=path,
                line=lost,
                expected=f"{len(columns)} numbers",
                advice="Export or copy the recording again.",
            )
    surplus = _check_widths(lines, len(columns), separator, path, unnamed)
    used = range(len(columns)) if used is None else used
    decimal_comma = separator != "," and b"," in lines.block
    values = _parse_fast(lines, used, separator, decimal_comma)
    if values is None:
        values = _parse_by_cell(lines, columns, used, separator, decimal_comma, path)
    if np.isinf(values).any():
        row, column = (int(index) for index in np.argwhere(np.isinf(values))[0])
        line = int(lines.numbers[row])
        raise FileFormatError(
            f"{columns[used[column]]} is infinite", path=path, line=line, expected="a number"
        )
    _warn_of_loss(lost, len(values), expected_rows, path)
    rows = lines.block.split(b"\n", _SAMPLE)[:_SAMPLE]
    cells = [decode_line(row).split(separator) for row in rows if row]
    sample = tuple(tuple(row[column] for column in used) for row in cells)
    return NumberTable(values, lines.numbers, sample, path, surplus)


def _split_lines(
    block: bytes, separator: str, first_line: int, width: int, numbered: bool = False
) -> _Lines:
    terminated = block.endswith(b"\n")
    if not terminated:
        block += b"\n"
    characters = np.frombuffer(block, dtype=np.uint8)
    ends = np.flatnonzero(characters == ord("\n"))
    starts = np.concatenate(([0], ends[:-1] + 1))
    between = np.flatnonzero(characters == ord(separator))
    cells = np.searchsorted(between, ends) - np.searchsorted(between, starts) + 1
    numbers = np.arange(first_line, first_line + len(ends))
    # A line of separators alone is a row of gaps if it has all its cells, and else a blank one.
    # With the number of its frame it is never a row, and has a blank or nothing in a cell.
    suspects = np.flatnonzero((cells < width) | (numbered & (ends - starts < 2 * cells)))
    empty = f" {separator}".encode()
    blank = [row for row in suspects if not block[starts[row] : ends[row]].strip(empty)]
    if blank:
        terminated |= blank[-1] == len(ends) - 1
        keep = np.ones(len(ends), dtype=bool)
        keep[blank] = False
        rows = block.split(b"\n")
        block = b"".join(rows[row] + b"\n" for row in np.flatnonzero(keep))
        numbers, cells = numbers[keep], cells[keep]
    return _Lines(block, numbers, cells, terminated)


def _find_lost_line(lines: _Lines, width: int, separator: str) -> int | None:
    """Return the number of the last line if it was cut off."""
    last = int(lines.numbers[-1])
    if lines.cells[-1] < width:
        # A short only row is a wrong row, unless the file stops in the middle of it.
        return last if len(lines.numbers) > 1 or not lines.terminated else None
    if lines.terminated or lines.cells[-1] > width:
        return None
    cell = lines.block[:-1].rsplit(b"\n", 1)[-1].decode("utf-8", errors="replace")
    cell = cell.rsplit(separator, 1)[-1]
    if parse_number(cell) is None:
        return last
    # No line end: the last number is incomplete if it has fewer digits than those above it.
    rows = lines.block[:-1].rsplit(b"\n", 20)[:-1]
    above = [
        decode_line(row.rsplit(b"\n", 1)[-1]).split(separator)[width - 1 : width] for row in rows
    ]
    digits = {_count_digits(cells[0]) for cells in above if cells and not is_missing(cells[0])}
    if len(digits) == 1 and (is_missing(cell) or _count_digits(cell) < digits.pop()):
        return last
    return None


def _count_digits(cell: str) -> int:
    _, _, fraction = cell.strip().replace(",", ".").partition(".")
    return len(fraction)


def _drop_last(lines: _Lines) -> _Lines:
    cut = lines.block.rfind(b"\n", 0, len(lines.block) - 1) + 1
    return _Lines(lines.block[:cut], lines.numbers[:-1], lines.cells[:-1], True)


def _check_widths(lines: _Lines, width: int, separator: str, path: Path, unnamed: bool) -> int:
    """Check the number of cells of each row, and return the most that follow the last column."""
    wrong, most, mark = lines.cells < width, 0, separator.encode()
    surplus = np.flatnonzero(lines.cells > width)
    if surplus.size:
        rows = lines.block.split(b"\n")
        for row in surplus:
            extra = rows[row].split(mark, width)[-1].rstrip(b" " + mark)
            count = extra.count(mark) + 1 if extra else 0
            wrong[row] = count % 3 if unnamed else count
            most = max(most, count)
    if wrong.any():
        first = int(np.flatnonzero(wrong)[0])
        raise FileFormatError(
            "the row has the wrong number of cells",
            path=path,
            line=int(lines.numbers[first]),
            found=int(lines.cells[first]),
            expected=width,
            advice="Export or copy the recording again.",
        )
    return most


def _parse_fast(
    lines: _Lines, used: Sequence[int], separator: str, decimal_comma: bool
) -> FloatArray | None:
    """Return the values, or None where pandas cannot parse them."""
    import pandas as pd

    if b"_" in lines.block:
        return None
    try:
        frame = pd.read_csv(
            BytesIO(lines.block),
            sep=separator,
            header=None,
            names=list(range(int(lines.cells.max()))),
            usecols=list(used),
            index_col=False,
            dtype=np.float64,
            engine="c",
            decimal="," if decimal_comma else ".",
            na_values=_SPELLINGS,
            keep_default_na=False,
            skip_blank_lines=False,
            quoting=3,
        )
    except (ValueError, OverflowError):
        return None
    return np.ascontiguousarray(frame.to_numpy(dtype=np.float64))


def _parse_by_cell(
    lines: _Lines,
    columns: Sequence[str],
    used: Sequence[int],
    separator: str,
    decimal_comma: bool,
    path: Path,
) -> FloatArray:
    values = np.empty((len(lines.numbers), len(used)))
    for row, raw in enumerate(lines.block.split(b"\n")[: len(values)]):
        cells = raw.decode("utf-8", errors="replace").split(separator)
        for index, column in enumerate(used):
            cell = cells[column]
            value = parse_number(cell, decimal_comma)
            if value is None or (decimal_comma and "." in cell and not is_missing(cell)):
                raise FileFormatError(
                    f"{columns[column]} is not a number",
                    path=path,
                    line=int(lines.numbers[row]),
                    found=f"'{cell}' in column {column + 1}",
                    expected="a number with a decimal comma, as elsewhere in the file"
                    if decimal_comma
                    else "a number",
                    advice="Correct the cell, or export the recording again.",
                )
            values[row, index] = value
    return values


def _warn_of_loss(lost: int | None, rows: int, expected: int | None, path: Path) -> None:
    read = f"{rows} complete rows were read"
    if expected is not None and rows != expected:
        read += f" where the header announces {expected}"
    if lost is not None:
        message = f"{path}, line {lost}: the file is cut off in this line; {read}"
    elif expected is not None and rows < expected:
        message = f"{path}: the file is cut off; {read}"
    elif expected is not None and rows > expected:
        message = f"{path}: {read}; all of them are kept"
    else:
        return
    warnings.warn(message, MocapFitWarning, stacklevel=4)
