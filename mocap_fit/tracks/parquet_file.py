"""Parquet files with a description: plain columns, and JSON in the schema's metadata.

The same columns and the same description give the same bytes; a file is written whole or not at
all, and one that is damaged is refused in words.
"""

from __future__ import annotations

import contextlib
import json
import os
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self

from mocap_fit.atomic_file import write_atomically
from mocap_fit.errors import FileFormatError, from_os_error

if TYPE_CHECKING:
    import pyarrow as pa

FORMAT_VERSION = 1
_KEY = b"mocap_fit"

ROW_GROUP = 16384
"""Rows of a group: readers, and writers of long tables, hold one at a time."""


def write_table(
    columns: Mapping[str, Any], description: Mapping[str, Any], path: str | os.PathLike[str]
) -> None:
    """Write columns and their description as one Parquet file, whole or not at all.

    Parameters
    ----------
    columns
        pyarrow arrays of one length, by name.
    description
        What JSON can hold: its ``kind``, and what the columns do not tell; ``format_version`` is
        added.
    path
        The file; one that exists is replaced.

    Raises
    ------
    FileFormatError
        If the file cannot be written.
    """
    with TableWriter(path) as writer:
        writer.write(columns, description)


class TableWriter:
    """Writes a table piece by piece; the file is there when all is written, or not at all.

    Use it in a ``with`` statement; what was written so far goes where an error ends it.

    Parameters
    ----------
    path
        The file; one that exists is replaced.

    Raises
    ------
    FileFormatError
        If the file cannot be written.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self._path, self._open = path, contextlib.ExitStack()
        self._partial: Path | None = None
        self._writer: Any = None

    def __enter__(self) -> Self:
        self._partial = self._open.enter_context(write_atomically(self._path))
        return self

    def write(self, columns: Mapping[str, Any], description: Mapping[str, Any]) -> None:
        """Add rows; pieces of `ROW_GROUP` rows give the bytes of the table in one piece.

        The description is that of the first piece.
        """
        import pyarrow as pa
        import pyarrow.parquet as pq

        table = pa.table(dict(columns))
        if self._writer is None:
            text = json.dumps(
                {"format_version": FORMAT_VERSION, **description},
                sort_keys=True,
                ensure_ascii=False,
            )
            schema = table.schema.with_metadata({_KEY: text.encode()})
            self._writer = self._open.enter_context(
                pq.ParquetWriter(
                    self._partial, schema, compression="zstd", write_page_checksum=True
                )
            )
        self._writer.write_table(table.cast(self._writer.schema), row_group_size=ROW_GROUP)

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._open.__exit__(kind, error, traceback)


def kind_of(path: str | os.PathLike[str]) -> str | None:
    """What a Parquet file of mocap-fit holds, such as ``markers``; None for any other file."""
    description = read_description(path) or {}
    kind = description.get("kind")
    return kind if isinstance(kind, str) else None


def read_description(path: str | os.PathLike[str]) -> dict[str, Any] | None:
    """The description in a whole Parquet file of mocap-fit, without its columns; else None."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        text = (pq.read_schema(path).metadata or {}).get(_KEY)
        description = None if text is None else json.loads(text)
    except (OSError, pa.ArrowException, ValueError):
        return None
    return description if isinstance(description, dict) else None


def read_table(
    path: str | os.PathLike[str], kinds: Sequence[str], noun: str, advice: str
) -> tuple[pa.Table, dict[str, Any]]:
    """Read what `write_table` wrote.

    Parameters
    ----------
    path
        The file.
    kinds
        What it may hold: the ``kind`` of its description.
    noun
        What they are called in messages, such as ``tracks``.
    advice
        What to do where it was not written by mocap-fit.

    Returns
    -------
    table
        The columns.
    description
        As it was given.

    Raises
    ------
    FileFormatError
        If the file cannot be opened, is not Parquet, is cut short, was not written by
        mocap-fit, or by a later format than this one knows.
    """
    import pyarrow.parquet as pq

    with _in_words(path), open(path, "rb") as stream:
        table = pq.read_table(
            stream,
            page_checksum_verification=True,
            # Damaged files have ended the process from within a thread.
            use_threads=False,
        )
    return table, _described(table.schema, path, kinds, noun, advice)


def look_through(
    path: str | os.PathLike[str], kinds: Sequence[str], noun: str, advice: str
) -> dict[str, Any]:
    """The description of a file; all of it is read and let go, a group of rows at a time.

    Parameters and errors are those of `read_table`.
    """
    import pyarrow.parquet as pq

    with _in_words(path), open(path, "rb") as stream:
        file = pq.ParquetFile(stream, page_checksum_verification=True)
        schema = file.schema_arrow
        for group in range(file.num_row_groups):
            file.read_row_group(group, use_threads=False)
    return _described(schema, path, kinds, noun, advice)


@contextlib.contextmanager
def _in_words(path: str | os.PathLike[str]) -> Iterator[None]:
    """What pyarrow and the system say of a file that cannot be read, as our error."""
    import pyarrow as pa

    try:
        yield
    except pa.ArrowException as error:
        raise FileFormatError(
            "this is not a whole Parquet file",
            path=path,
            found=error,
            advice="It may be cut short, or of another format: write it again.",
        ) from None
    except OSError as error:
        if error.errno:
            raise from_os_error(error, path) from None
        # Pyarrow reports damaged content as an OSError too, but without a system error's number.
        raise FileFormatError("this is not a whole Parquet file", path=path, found=error) from None


def _described(
    schema: pa.Schema, path: str | os.PathLike[str], kinds: Sequence[str], noun: str, advice: str
) -> dict[str, Any]:
    """The description in a schema, checked."""
    text = (schema.metadata or {}).get(_KEY)
    if text is None:
        raise FileFormatError(
            f"this Parquet file does not hold {noun} of mocap-fit",
            path=path,
            found=f"columns {', '.join(schema.names)}",
            advice=advice,
        )
    try:
        description = json.loads(text)
        version, kind = description["format_version"], description["kind"]
    except (ValueError, TypeError, KeyError) as error:
        raise damaged(path, error) from None
    if not isinstance(version, int) or version > FORMAT_VERSION:
        raise FileFormatError(
            "this file is of a later format than this version of mocap-fit reads",
            path=path,
            found=f"format_version {version}",
            expected=f"at most {FORMAT_VERSION}",
            advice="Update mocap-fit.",
        )
    if kind not in kinds:
        raise FileFormatError(
            f"this file cannot be used as {noun}", path=path, found=kind, expected=", ".join(kinds)
        )
    return dict(description)


def damaged(path: str | os.PathLike[str], error: Exception) -> FileFormatError:
    """The error of a file whose description does not fit its columns."""
    return FileFormatError(
        "the description in this Parquet file is damaged",
        path=path,
        found=f"{type(error).__name__}: {error}",
    )
