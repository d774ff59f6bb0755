"""Parquet files with a description: plain columns, and JSON in the schema's metadata.

The same columns and the same description give the same bytes; a file is written completely or not
at all, and a damaged one is refused with a message.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, BinaryIO

from mocap_fit.atomic_file import write_atomically
from mocap_fit.errors import DataError, FileFormatError, from_os_error
from mocap_fit.parsing import parse_json
from mocap_fit.plain_text import to_unicode
from mocap_fit.size_limit import check_size, measure_file

if TYPE_CHECKING:
    import pyarrow as pa

FORMAT_VERSION = 1
_KEY = b"mocap_fit"
_ROW_GROUP = 16384


def write_table(
    columns: Mapping[str, Any], description: Mapping[str, Any], path: str | os.PathLike[str]
) -> None:
    """Write columns and their description as one Parquet file, completely or not at all.

    Parameters
    ----------
    columns
        Arrays of pyarrow with one length, by name.
    description
        Values that JSON can hold: the ``kind`` of the table, and what the columns do not say;
        ``format_version`` is added.
    path
        The file; an existing one is replaced.

    Raises
    ------
    FileFormatError
        If the file cannot be written.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    text = json.dumps(
        {"format_version": FORMAT_VERSION, **description}, sort_keys=True, ensure_ascii=False
    )
    table = pa.table(dict(columns)).replace_schema_metadata({_KEY: to_unicode(text).encode()})
    # A stream, as the name of the file may not be UTF-8.
    with write_atomically(path) as partial, open(partial, "wb") as stream:
        pq.write_table(
            table, stream, compression="zstd", write_page_checksum=True, row_group_size=_ROW_GROUP
        )


def is_foreign_table(path: str | os.PathLike[str]) -> bool:
    """Return whether a file is Parquet that another program wrote.

    Parameters
    ----------
    path
        The file.

    Returns
    -------
    bool
        False also where there is no such file, or it cannot be read.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        measure_file(path)
        with open(path, "rb") as stream:
            return _KEY not in (pq.read_schema(stream).metadata or {})
    except (OSError, FileFormatError, pa.ArrowException, ValueError):
        return False


def read_kind(path: str | os.PathLike[str]) -> str | None:
    """Return what a Parquet file of mocap-fit holds, such as ``markers``.

    Parameters
    ----------
    path
        The file.

    Returns
    -------
    str or None
        The ``kind`` of its description; None for any other file.
    """
    kind = (read_description(path) or {}).get("kind")
    return kind if isinstance(kind, str) else None


def read_description(path: str | os.PathLike[str]) -> dict[str, Any] | None:
    """Return the description in a Parquet file of mocap-fit, without reading its columns.

    Parameters
    ----------
    path
        The file.

    Returns
    -------
    dict or None
        None for any other file, and for one that cannot be read.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        measure_file(path)
        with open(path, "rb") as stream:
            text = (pq.read_schema(stream).metadata or {}).get(_KEY)
        description = None if text is None else parse_json(text)
    except (OSError, FileFormatError, pa.ArrowException, ValueError):
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
        What it may hold: values of the ``kind`` of its description.
    noun
        What these are called in messages, such as ``tracks``.
    advice
        What to do where it was not written by mocap-fit.

    Returns
    -------
    table : pyarrow.Table
        The columns.
    description : dict
        As it was written.

    Raises
    ------
    MissingFileError
        If there is no such file.
    FileFormatError
        If the file cannot be opened, is not Parquet, is cut short, was not written by
        mocap-fit, or by a later format than this one knows.
    """
    import pyarrow as pa

    measure_file(path)
    try:
        with open(path, "rb") as stream:
            table = _read_columns(stream, path)
    # Names of columns that are not UTF-8 raise a UnicodeDecodeError.
    except (pa.ArrowException, UnicodeDecodeError) as error:
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
    return table, _parse_description(table.schema, path, kinds, noun, advice)


def _read_columns(stream: BinaryIO, path: str | os.PathLike[str]) -> pa.Table:
    """Read all columns, unless they are larger than what may be read.

    Equal values have next to no bytes in the file, however many or long they are: texts are first
    read as dictionaries.
    """
    import pyarrow as pa
    import pyarrow.compute as pc
    import pyarrow.parquet as pq

    about = pq.read_metadata(stream)
    leaves = [about.schema.column(i) for i in range(about.num_columns)]
    unpacked = sum(about.row_group(i).total_byte_size for i in range(about.num_row_groups))
    check_size(max(unpacked, 8 * about.num_rows * len(leaves)), path=path, noun="table")
    texts = [leaf.path for leaf in leaves if leaf.physical_type == "BYTE_ARRAY"]
    file = pq.ParquetFile(
        stream, metadata=about, read_dictionary=texts, page_checksum_verification=True
    )
    # Damaged files have ended the process from within a thread.
    table = file.read(use_threads=False)
    size = 0
    for chunk in (chunk for column in table.columns for chunk in column.chunks):
        values = chunk.flatten() if pa.types.is_list(chunk.type) else chunk
        if pa.types.is_dictionary(values.type):
            lengths = pc.binary_length(values.dictionary)
            size += pc.sum(pc.take(lengths, values.indices)).as_py() or 0
    check_size(size, path=path, noun="table")
    return table.cast(about.schema.to_arrow_schema().with_metadata(table.schema.metadata))


def _parse_description(
    schema: pa.Schema, path: str | os.PathLike[str], kinds: Sequence[str], noun: str, advice: str
) -> dict[str, Any]:
    """Return the checked description in a schema."""
    text = (schema.metadata or {}).get(_KEY)
    if text is None:
        raise FileFormatError(
            f"this Parquet file does not hold {noun} of mocap-fit",
            path=path,
            found=f"columns {', '.join(schema.names)}",
            advice=advice,
        )
    try:
        description = parse_json(text)
        version, kind = description["format_version"], description["kind"]
    except (ValueError, TypeError, KeyError) as error:
        raise from_damaged_table(error, path, noun) from None
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


def check_types(
    table: pa.Table, types: Mapping[str, pa.DataType], may_lack: Sequence[str] = ()
) -> None:
    """Raise a TypeError if columns of a table are of other types than they were written in.

    Parameters
    ----------
    table
        What `read_table` returned.
    types
        Type of each column, by name.
    may_lack
        Columns that may lack values.

    Raises
    ------
    KeyError
        If there is no such column.
    TypeError
        If one is of another type, or lacks a value.
    """
    for name, kind in types.items():
        column = table.column(name)
        if column.type != kind:
            raise TypeError(f"the column {name} holds {column.type} and not {kind}")
        if column.null_count and name not in may_lack:
            raise TypeError(f"the column {name} lacks {column.null_count} values")


def from_damaged_table(
    error: Exception, path: str | os.PathLike[str], noun: str
) -> FileFormatError:
    """Return the error for a file whose description or content cannot be used.

    Parameters
    ----------
    error
        What went wrong; a `DataError` is about the content.
    path
        The file.
    noun
        What it holds, such as ``tracks``.

    Returns
    -------
    FileFormatError
        The error.
    """
    if isinstance(error, DataError):
        return FileFormatError(
            f"the {noun} in this file cannot be used: {error.problem}",
            path=path,
            frame=error.frame,
            found=error.found,
            expected=error.expected,
        )
    return FileFormatError(
        "the description in this Parquet file is damaged",
        path=path,
        found=f"{type(error).__name__}: {error}",
    )
