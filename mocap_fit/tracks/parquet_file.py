"""Parquet files with a description: plain columns, and JSON in the schema's metadata.

The same columns and the same description give the same bytes; a file is written whole or not at
all, and one that is damaged is refused in words.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from mocap_fit.errors import FileFormatError
from mocap_fit.whole_file import whole_file

if TYPE_CHECKING:
    import pyarrow as pa

FORMAT_VERSION = 1
_KEY = b"mocap_fit"


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
    import pyarrow as pa
    import pyarrow.parquet as pq

    text = json.dumps(
        {"format_version": FORMAT_VERSION, **description}, sort_keys=True, ensure_ascii=False
    )
    table = pa.table(dict(columns)).replace_schema_metadata({_KEY: text.encode()})
    with whole_file(path) as partial:
        pq.write_table(table, partial, compression="zstd", write_page_checksum=True)


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
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        with open(path, "rb") as stream:
            table = pq.read_table(
                stream,
                page_checksum_verification=True,
                # Damaged files have ended the process from within a thread.
                use_threads=False,
            )
    except pa.ArrowException as error:
        raise FileFormatError(
            "this is not a whole Parquet file",
            path=path,
            found=error,
            advice="It may be cut short, or of another format: write it again.",
        ) from None
    except OSError as error:
        # Pyarrow says damaged content as OSError too, but without the number of a system error.
        problem = "the file cannot be read" if error.errno else "this is not a whole Parquet file"
        raise FileFormatError(problem, path=path, found=error.strerror or error) from None
    text = (table.schema.metadata or {}).get(_KEY)
    if text is None:
        raise FileFormatError(
            f"this Parquet file does not hold {noun} of mocap-fit",
            path=path,
            found=f"columns {', '.join(table.column_names)}",
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
    return table, description


def damaged(path: str | os.PathLike[str], error: Exception) -> FileFormatError:
    """The error of a file whose description does not fit its columns."""
    return FileFormatError(
        "the description in this Parquet file is damaged",
        path=path,
        found=f"{type(error).__name__}: {error}",
    )
