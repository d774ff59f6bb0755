"""A block of numbers in text, read fast, with the exact line and column of what is wrong.

The block goes through pandas' compiled parser. Where that refuses, each cell is read on its own,
which accepts a little more (cells of blanks) and names the cell that is not a number.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from mocap_fit.errors import FileFormatError, MocapFitWarning
from mocap_fit.io.text import decoded
from mocap_fit.tracks import FloatArray

MISSING_WORDS = frozenset(
    (
        *("", "nan", "-nan", "+nan", "na", "n/a", "null", "none"),
        *("nan(ind)", "-nan(ind)", "1.#qnan", "-1.#qnan", "1.#ind", "-1.#ind"),
    )
)
"""What stands for a missing number, in lower case and without blanks round it."""

_SAMPLE = 100
"""Rows that show how the numbers of a column were written."""

_SPELLINGS = sorted(
    {form for word in MISSING_WORDS for form in (word, word.upper(), word.capitalize())} | {"NaN"}
)


def is_missing(cell: str) -> bool:
    """Whether a cell stands for a missing number."""
    return cell.strip().lower() in MISSING_WORDS


def number(cell: str, decimal_comma: bool = True) -> float | None:
    """The number in a cell, NaN for a missing one, None for what is no number."""
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
    """The rows of a block.

    Parameters
    ----------
    values
        `(rows, columns)`; NaN is missing.
    lines
        `(rows,)`, the line of the file that each row stands in.
    lost_line
        The last line, where it is not whole and was left out.
    sample
        The cells of the first rows, as they were written.
    """

    values: FloatArray
    lines: NDArray[np.intp]
    lost_line: int | None
    sample: tuple[tuple[str, ...], ...]

    def decimals(self, column: int) -> int:
        """Digits after the point that a column was written with, at most 9."""
        cells = [row[column].strip() for row in self.sample]
        if any("e" in cell.lower() for cell in cells if not is_missing(cell)):
            return 9
        return min(9, max((_digits(cell) for cell in cells), default=0))


@dataclass(frozen=True)
class _Lines:
    """Where the lines of a block are: what is left of it, their numbers, cells in each."""

    block: bytes
    numbers: NDArray[np.intp]
    cells: NDArray[np.intp]
    terminated: bool


def read_numbers(
    block: bytes,
    columns: Sequence[str],
    *,
    separator: Literal["\t", ",", ";"],
    first_line: int,
    path: Path,
    expected_rows: int | None = None,
) -> NumberTable:
    r"""Read the rows of numbers at the end of a file.

    Decimal commas are understood where the separator leaves them free. Blank lines are left out,
    so are blank cells after the last column. A last line that was cut off is left out and told.

    Parameters
    ----------
    block
        The lines, ended by ``\n``.
    columns
        What each column is called in messages.
    separator
        What stands between two cells.
    first_line
        Number of the block's first line in the file.
    path
        The file, for messages.
    expected_rows
        Rows that the file's header announces.

    Raises
    ------
    FileFormatError
        If there is no whole row, a row has too few or too many cells, or a cell is no number.

    Warns
    -----
    MocapFitWarning
        If the last line is not whole, or there are not as many rows as announced.
    """
    table = _table(block, columns, separator, first_line, path, expected_rows, last=True)
    _warn_of_loss(table.lost_line, len(table.values), expected_rows, path)
    return table


def read_number_blocks(
    blocks: Iterable[bytes],
    columns: Sequence[str],
    *,
    separator: Literal["\t", ",", ";"],
    first_line: int,
    path: Path,
    expected_rows: int | None = None,
) -> Iterator[NumberTable]:
    """Read the rows of numbers at the end of a file block by block, as `read_numbers` does.

    Parameters
    ----------
    blocks
        Whole lines each, from `TextFile.blocks`.
    columns, separator, first_line, path, expected_rows
        As for `read_numbers`.

    Yields
    ------
    NumberTable
        Some rows; none has none.
    """
    rows, lost = 0, None
    # Whether decimals have commas shows in some blocks alone, and holds for all.
    commas, point = False, None
    for block, last in _last_two_joined(blocks):
        commas = commas or (separator != "," and b"," in block)
        if point is None and not commas:
            point = _first_point(block, columns, separator, first_line)
        if commas and point is not None:
            raise _no_number(*point, True, path)
        if not last and not block.strip(f" \n{separator}".encode()):
            first_line += block.count(b"\n")
            continue
        only = last and rows == 0
        table = _table(
            block, columns, separator, first_line, path, expected_rows, last, only, commas
        )
        first_line += block.count(b"\n")
        rows += len(table.values)
        lost = table.lost_line
        if len(table.values):
            yield table
    _warn_of_loss(lost, rows, expected_rows, path)


def _last_two_joined(blocks: Iterable[bytes]) -> Iterator[tuple[bytes, bool]]:
    """The blocks, and whether each is the last: that one needs rows above its last row."""
    stream = iter(blocks)
    first, second = next(stream, b""), next(stream, None)
    while second is not None:
        third = next(stream, None)
        if third is None:
            first += second
            break
        yield first, False
        first, second = second, third
    yield first, True


def _table(
    block: bytes,
    columns: Sequence[str],
    separator: str,
    first_line: int,
    path: Path,
    expected_rows: int | None,
    last: bool,
    only: bool = True,
    commas: bool = False,
) -> NumberTable:
    """The rows of a block; the last of the file may end in the middle of a line."""
    lines = _lines_of(block, separator, first_line, len(columns))
    if lines.numbers.size == 0:
        if not only:
            return NumberTable(np.empty((0, len(columns))), lines.numbers, None, ())
        raise FileFormatError(
            "there is no row of numbers",
            path=path,
            line=first_line,
            expected="one line a frame" if expected_rows is None else f"{expected_rows} lines",
            advice="Export or copy the recording again.",
        )
    lost = _lost_line(lines, len(columns), separator) if last else None
    if lost is not None:
        lines = _without_last(lines)
        if lines.numbers.size == 0:
            raise FileFormatError(
                "the file is cut off before its first row is whole",
                path=path,
                line=lost,
                expected=f"{len(columns)} numbers",
                advice="Export or copy the recording again.",
            )
    _check_widths(lines, columns, separator, path)
    decimal_comma = commas or (separator != "," and b"," in lines.block)
    values = _parsed_fast(lines, len(columns), separator, decimal_comma)
    if values is None:
        values = _parsed_by_cell(lines, columns, separator, decimal_comma, path)
    if np.isinf(values).any():
        row, column = (int(index) for index in np.argwhere(np.isinf(values))[0])
        raise FileFormatError(
            f"{columns[column]} is infinite",
            path=path,
            line=int(lines.numbers[row]),
            expected="a number",
        )
    rows = lines.block.split(b"\n", _SAMPLE)[:_SAMPLE]
    sample = tuple(tuple(decoded(row).split(separator)) for row in rows if row)
    return NumberTable(values, lines.numbers, lost, sample)


def _lines_of(block: bytes, separator: str, first_line: int, width: int) -> _Lines:
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
    suspects = np.flatnonzero(cells < width)
    empty = f" {separator}".encode()
    blank = [row for row in suspects if not block[starts[row] : ends[row]].strip(empty)]
    if blank:
        if blank[-1] == len(ends) - 1:
            terminated = True
        keep = np.ones(len(ends), dtype=bool)
        keep[blank] = False
        rows = block.split(b"\n")
        block = b"".join(rows[row] + b"\n" for row in np.flatnonzero(keep))
        numbers, cells = numbers[keep], cells[keep]
    return _Lines(block, numbers, cells, terminated)


def _lost_line(lines: _Lines, width: int, separator: str) -> int | None:
    """The number of the last line, if it was cut off."""
    last = int(lines.numbers[-1])
    if lines.cells[-1] < width:
        # A short only row is a wrong row, unless the file stops in the middle of it.
        return last if len(lines.numbers) > 1 or not lines.terminated else None
    if lines.terminated or lines.cells[-1] > width:
        return None
    cell = lines.block[:-1].rsplit(b"\n", 1)[-1].decode("utf-8", errors="replace")
    cell = cell.rsplit(separator, 1)[-1]
    if number(cell) is None:
        return last
    # No line end: the last number is not whole if it has fewer digits than all those above it.
    rows = lines.block[:-1].rsplit(b"\n", 20)[:-1]
    above = [decoded(row.rsplit(b"\n", 1)[-1]).split(separator)[width - 1 : width] for row in rows]
    digits = {_digits(cells[0]) for cells in above if cells and not is_missing(cells[0])}
    if len(digits) == 1 and (is_missing(cell) or _digits(cell) < digits.pop()):
        return last
    return None


def _digits(cell: str) -> int:
    _, _, fraction = cell.strip().replace(",", ".").partition(".")
    return len(fraction)


def _without_last(lines: _Lines) -> _Lines:
    cut = lines.block.rfind(b"\n", 0, len(lines.block) - 1) + 1
    return _Lines(lines.block[:cut], lines.numbers[:-1], lines.cells[:-1], True)


def _check_widths(lines: _Lines, columns: Sequence[str], separator: str, path: Path) -> None:
    width = len(columns)
    wrong = lines.cells < width
    surplus = np.flatnonzero(lines.cells > width)
    if surplus.size:
        rows = lines.block.split(b"\n")
        for row in surplus:
            extra = rows[row].split(separator.encode(), width)[-1]
            wrong[row] = bool(extra.replace(separator.encode(), b"").strip())
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


def _parsed_fast(
    lines: _Lines, width: int, separator: str, decimal_comma: bool
) -> FloatArray | None:
    """The values, or None where pandas does not take them."""
    import pandas as pd

    if b"_" in lines.block:
        return None
    try:
        frame = pd.read_csv(
            BytesIO(lines.block),
            sep=separator,
            header=None,
            names=list(range(int(lines.cells.max()))),
            usecols=list(range(width)),
            index_col=False,
            dtype=np.float64,
            engine="c",
            decimal="," if decimal_comma else ".",
            na_values=_SPELLINGS,
            keep_default_na=False,
            skip_blank_lines=False,
            quoting=3,
            low_memory=False,
        )
    except (ValueError, OverflowError):
        return None
    return np.ascontiguousarray(frame.to_numpy(dtype=np.float64))


def _parsed_by_cell(
    lines: _Lines, columns: Sequence[str], separator: str, decimal_comma: bool, path: Path
) -> FloatArray:
    values = np.empty((len(lines.numbers), len(columns)))
    for row, raw in enumerate(lines.block.split(b"\n")[: len(values)]):
        cells = raw.decode("utf-8", errors="replace").split(separator)
        for column, name in enumerate(columns):
            cell = cells[column]
            value = number(cell, decimal_comma)
            if value is None or (decimal_comma and "." in cell and not is_missing(cell)):
                raise _no_number(name, int(lines.numbers[row]), cell, column, decimal_comma, path)
            values[row, column] = value
    return values


def _first_point(
    block: bytes, columns: Sequence[str], separator: str, first_line: int
) -> tuple[str, int, str, int] | None:
    """The first number with a decimal point: its column, line, cell and place; None for none."""
    place = block.find(b".")
    while place >= 0:
        start, end = block.rfind(b"\n", 0, place) + 1, block.find(b"\n", place)
        row = decoded(block[start : end if end >= 0 else len(block)])
        cells = row.split(separator)[: len(columns)]
        for column, cell in enumerate(cells):
            if "." in cell and not is_missing(cell):
                line = first_line + block.count(b"\n", 0, place)
                return columns[column], line, cell, column
        place = block.find(b".", end) if end >= 0 else -1
    return None


def _no_number(
    name: str, line: int, cell: str, column: int, decimal_comma: bool, path: Path
) -> FileFormatError:
    return FileFormatError(
        f"{name} is not a number",
        path=path,
        line=line,
        found=f"'{cell}' in column {column + 1}",
        expected="a number with a decimal comma, as elsewhere in the file"
        if decimal_comma
        else "a number",
        advice="Correct the cell, or export the recording again.",
    )


def _warn_of_loss(lost: int | None, rows: int, expected: int | None, path: Path) -> None:
    read = f"{rows} whole rows were read"
    if expected is not None and rows != expected:
        read = f"{rows} whole rows were read where the header announces {expected}"
    if lost is not None:
        message = f"{path}, line {lost}: the file is cut off in this line; {read}"
    elif expected is not None and rows < expected:
        message = f"{path}: the file is cut off; {read}"
    elif expected is not None and rows > expected:
        message = f"{path}: {read}; all of them are kept"
    else:
        return
    warnings.warn(message, MocapFitWarning, stacklevel=4)
