"""Text files as a laboratory has them: any line ending, any of the usual encodings, any length.

A line longer than `LONGEST_LINE` is refused before it is in memory, so that a file that is not
what it seems costs neither time nor space.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
from types import TracebackType
from typing import BinaryIO, Self

from mocap_fit.errors import FileFormatError, from_os_error

LONGEST_LINE = 4 * 2**20
"""Bytes. 10,000 markers with long names fill about a quarter of it."""

_UTF16_MARKS = (b"\xff\xfe", b"\xfe\xff")
_UTF8_MARK = b"\xef\xbb\xbf"


def checked_file(path: str | os.PathLike[str]) -> Path:
    """The path of a file that is there, is a file, and holds something.

    Raises
    ------
    MissingFileError
        If there is no such file.
    FileFormatError
        If it is a folder, a device, or empty.
    """
    try:
        file = Path(path)
        if not file.exists():
            raise FileNotFoundError
        if file.is_dir():
            raise FileFormatError(
                "this is a folder", path=path, expected="a file", advice="Name a file in it."
            )
        if not file.is_file():
            raise FileFormatError("this is not an ordinary file", path=path)
        if file.stat().st_size == 0:
            raise FileFormatError(
                "the file is empty", path=path, advice="Export or copy the recording again."
            )
    except (OSError, ValueError) as error:
        raise from_os_error(error, path) from None
    return file


def read_head(path: str | os.PathLike[str], size: int) -> bytes:
    """The first bytes of a file; nothing where it cannot be read."""
    try:
        with Path(path).open("rb") as file:
            return file.read(size)
    except (OSError, ValueError):
        return b""


def decoded(line: bytes) -> str:
    """A line as text: UTF-8, or Windows-1252, which older recording software writes."""
    try:
        return line.decode("utf-8")
    except UnicodeDecodeError:
        return line.decode("cp1252", errors="replace")


def first_lines(path: str | os.PathLike[str], count: int, size: int = LONGEST_LINE) -> list[str]:
    """The first lines of a text file, for a reader that asks whether the file is its own.

    Nothing for a file that is not text or cannot be read. The last line may be cut short.
    """
    head = read_head(path, size)
    if head.startswith(_UTF16_MARKS):
        head = head[: len(head) // 2 * 2].decode("utf-16", errors="replace").encode()
    if b"\0" in head[:65536]:
        return []
    head = head.removeprefix(_UTF8_MARK)
    if b"\n" not in head:
        head = head.replace(b"\r", b"\n")
    return [decoded(line).rstrip("\r") for line in head.split(b"\n", count)[:count]]


class TextFile:
    """The lines of a text file, one after another, then all that is left at once.

    Parameters
    ----------
    path
        The file.

    Raises
    ------
    FileFormatError
        If the file is missing, empty, unreadable, or not text.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = checked_file(path)
        self.number = 0
        """Number of the line that `line` gave last, from 1."""
        self._waiting: bytes | None = None
        self._last = b""
        try:
            self._file: BinaryIO = self.path.open("rb")
            head = self._file.read(65536)
            self._file.seek(0)
            if head.startswith(_UTF16_MARKS):
                self._reopen(self._file.read().decode("utf-16").encode())
            elif b"\0" in head:
                self._file.close()
                raise self._not_text()
            elif b"\n" not in head and b"\r" in head:
                # Line ends of old Macintosh programs.
                self._reopen(self._file.read().replace(b"\r\n", b"\n").replace(b"\r", b"\n"))
        except OSError as error:
            raise from_os_error(error, path) from None
        except UnicodeDecodeError:
            self._file.close()
            raise self._not_text() from None
        if head.startswith(_UTF8_MARK):
            self._file.seek(len(_UTF8_MARK))

    def _reopen(self, content: bytes) -> None:
        self._file.close()
        self._file = BytesIO(content.removeprefix(_UTF8_MARK))

    def _not_text(self) -> FileFormatError:
        return FileFormatError(
            "the file holds binary data",
            path=self.path,
            expected="text",
            advice="Check that it is the file you mean; its name may have the wrong ending.",
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

    def line(self) -> str | None:
        """The next line without its ending, or None after the last.

        Raises
        ------
        FileFormatError
            If it is longer than `LONGEST_LINE`, or holds a zero byte.
        """
        raw = self._raw()
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
            raise self._damaged(self.number)
        return decoded(raw).rstrip("\r\n")

    def push_back(self) -> None:
        """Give the line that was read last back, to be read again."""
        self._waiting = self._last
        self.number -= 1

    def rest(self) -> bytes:
        """All that follows, every line ended by a line feed except perhaps the last.

        Raises
        ------
        FileFormatError
            If it holds a zero byte, as files do whose disk was full.
        """
        try:
            block = (self._waiting or b"") + self._file.read()
        except OSError as error:
            raise from_os_error(error, self.path) from None
        self._waiting = None
        if b"\r" in block:
            block = block.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
        zero = block.find(b"\0")
        if zero >= 0:
            raise self._damaged(self.number + 1 + block.count(b"\n", 0, zero))
        return block

    def blocks(self, size: int = 2**22) -> Iterator[bytes]:
        """All that follows, as `rest` gives it, in blocks of whole lines.

        Parameters
        ----------
        size
            Bytes that are read at once.

        Raises
        ------
        FileFormatError
            As `rest`; also if a line is longer than `LONGEST_LINE`.
        """
        left, self._waiting = self._waiting or b"", None
        ended = False
        while not ended:
            try:
                read = self._file.read(size)
            except OSError as error:
                raise from_os_error(error, self.path) from None
            ended = not read
            block = left + read
            cut = len(block) if ended else block.rfind(b"\n") + 1
            block, left = block[:cut], block[cut:]
            if len(left) > LONGEST_LINE:
                raise FileFormatError(
                    "the line is too long",
                    path=self.path,
                    line=self.number + block.count(b"\n") + 1,
                    found=f"more than {LONGEST_LINE // 2**20} MB",
                    advice="Check that it is the file you mean.",
                )
            if b"\r" in block:
                block = block.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
            zero = block.find(b"\0")
            if zero >= 0:
                raise self._damaged(self.number + 1 + block.count(b"\n", 0, zero))
            if block:
                yield block
                self.number += block.count(b"\n")

    def _raw(self) -> bytes | None:
        if self._waiting is not None:
            raw, self._waiting = self._waiting, None
            return raw
        try:
            return self._file.readline(LONGEST_LINE + 1) or None
        except OSError as error:
            raise from_os_error(error, self.path) from None

    def _damaged(self, line: int) -> FileFormatError:
        return FileFormatError(
            "the line holds a zero byte",
            path=self.path,
            line=line,
            expected="text",
            advice="The file is damaged; export or copy it again.",
        )
