"""Text files with any line ending, in any of the usual encodings.

A line longer than `LONGEST_LINE` is refused before it is in memory, so that a file that is not
what it seems costs neither time nor space.
"""

from __future__ import annotations

import csv
import os
from io import BytesIO
from pathlib import Path
from types import TracebackType
from typing import BinaryIO, Self

from mocap_fit.errors import FileFormatError, from_os_error
from mocap_fit.size_limit import measure_file

LONGEST_LINE = 4 * 2**20
"""Bytes. 10,000 markers with long names fill about a quarter of it."""

_UTF16_MARKS = (b"\xff\xfe", b"\xfe\xff")
_UTF8_MARK = b"\xef\xbb\xbf"


def check_file(path: str | os.PathLike[str]) -> Path:
    """Return the path of a file that exists and is not empty.

    Parameters
    ----------
    path
        File to read.

    Returns
    -------
    Path
        The same path.

    Raises
    ------
    MissingFileError
        If there is no such file.
    FileFormatError
        If it is a folder, a device, or empty.
    """
    if measure_file(path) == 0:
        raise FileFormatError(
            "the file is empty", path=path, advice="Export or copy the recording again."
        )
    return Path(path)


def read_head(path: str | os.PathLike[str], size: int) -> bytes:
    """Return the first bytes of a file.

    Parameters
    ----------
    path
        The file.
    size
        Number of bytes.

    Returns
    -------
    bytes
        At most `size` bytes; none where the file cannot be read.
    """
    try:
        with Path(path).open("rb") as file:
            return file.read(size)
    except (OSError, ValueError):
        return b""


def decode_line(line: bytes) -> str:
    """Decode a line: UTF-8, or else Windows-1252, which older recording software writes.

    Parameters
    ----------
    line
        Bytes of the line.

    Returns
    -------
    str
        The line.
    """
    try:
        return line.decode("utf-8")
    except UnicodeDecodeError:
        return line.decode("cp1252", errors="replace")


def split_cells(line: str, separator: str) -> list[str]:
    """Split a line into its cells, which may be in quotation marks.

    Parameters
    ----------
    line
        The line.
    separator
        Separator of the cells.

    Returns
    -------
    list of str
        The cells, without blanks around them and blank ones at the end.

    Raises
    ------
    FileFormatError
        Without a path, if a cell is over 100,000 characters long, or a line end is inside one.
    """
    try:
        cells = next(csv.reader([line], delimiter=separator), [])
    except csv.Error as error:
        raise FileFormatError("the line cannot be split into cells", found=str(error)) from None
    cells = [cell.strip() for cell in cells]
    while cells and not cells[-1]:
        cells.pop()
    return cells


def read_first_lines(
    path: str | os.PathLike[str], count: int, size: int = LONGEST_LINE
) -> list[str]:
    """Return the first lines of a text file, for readers that sniff it.

    Parameters
    ----------
    path
        The file.
    count
        Number of lines.
    size
        Number of bytes to read at most; the last line may be cut short.

    Returns
    -------
    list of str
        The lines without their endings; none for a file that is not text or cannot be read.
    """
    head = read_head(path, size)
    if head.startswith(_UTF16_MARKS):
        head = head[: len(head) // 2 * 2].decode("utf-16", errors="replace").encode()
    if b"\0" in head[:65536]:
        return []
    head = head.removeprefix(_UTF8_MARK)
    if b"\n" not in head:
        head = head.replace(b"\r", b"\n")
    return [decode_line(line).rstrip("\r") for line in head.split(b"\n", count)[:count]]


class TextFile:
    """A text file that is read line by line, then all the rest at once.

    Parameters
    ----------
    path
        File to read.

    Raises
    ------
    FileFormatError
        If the file is missing, empty, unreadable, or not text.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = check_file(path)
        self.number = 0
        """Number of the line that `read_line` returned last, from 1."""
        self._pushed_back: bytes | None = None
        self._last = b""
        try:
            self._file: BinaryIO = self.path.open("rb")
            head = self._file.read(65536)
            self._file.seek(0)
            if head.startswith(_UTF16_MARKS):
                self._reopen(self._file.read().decode("utf-16").encode())
            elif b"\0" in head:
                self._file.close()
                raise self._create_binary_error()
            elif b"\n" not in head and b"\r" in head:
                # Line ends of old Macintosh programs.
                self._reopen(self._file.read().replace(b"\r\n", b"\n").replace(b"\r", b"\n"))
        except OSError as error:
            raise from_os_error(error, path) from None
        except UnicodeDecodeError:
            self._file.close()
            raise self._create_binary_error() from None
        if head.startswith(_UTF8_MARK):
            self._file.seek(len(_UTF8_MARK))

    def _reopen(self, content: bytes) -> None:
        self._file.close()
        self._file = BytesIO(content.removeprefix(_UTF8_MARK))

    def _create_binary_error(self) -> FileFormatError:
        advice = "Check that it is the file you mean; its name may have the wrong ending."
        return FileFormatError(
            "the file holds binary data", path=self.path, expected="text", advice=advice
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._file.close()

    def read_line(self) -> str | None:
        """Return the next line.

        Returns
        -------
        str or None
            The line without its ending; None after the last.

        Raises
        ------
        FileFormatError
            If it is longer than `LONGEST_LINE`, or holds a zero byte.
        """
        raw = self._read_raw()
        if raw is None:
            return None
        self.number += 1
        self._last = raw
        if len(raw) > LONGEST_LINE:
            raise FileFormatError(
                "the line is too long",
                path=self.path,
                line=self.number,
                found=f"more than {LONGEST_LINE // 2**20} MB",
                advice="This is not a header. Check that it is the file you mean.",
            )
        if b"\0" in raw:
            raise self._create_zero_error(self.number)
        return decode_line(raw).rstrip("\r\n")

    def push_back(self) -> None:
        """Push the last line back, to be read again."""
        self._pushed_back = self._last
        self.number -= 1

    def read_rest(self) -> bytes:
        """Return all that follows, with line feeds as line endings.

        Returns
        -------
        bytes
            The lines; the last one may have no line feed.

        Raises
        ------
        FileFormatError
            If there is a zero byte, as in files whose disk was full.
        """
        try:
            block = (self._pushed_back or b"") + self._file.read()
        except OSError as error:
            raise from_os_error(error, self.path) from None
        self._pushed_back = None
        if b"\r" in block:
            block = block.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
        zero = block.find(b"\0")
        if zero >= 0:
            raise self._create_zero_error(self.number + 1 + block.count(b"\n", 0, zero))
        return block

    def _read_raw(self) -> bytes | None:
        if self._pushed_back is not None:
            raw, self._pushed_back = self._pushed_back, None
            return raw
        try:
            return self._file.readline(LONGEST_LINE + 1) or None
        except OSError as error:
            raise from_os_error(error, self.path) from None

    def _create_zero_error(self, line: int) -> FileFormatError:
        advice = "The file is damaged; export or copy it again."
        return FileFormatError(
            "the line holds a zero byte", path=self.path, line=line, expected="text", advice=advice
        )
