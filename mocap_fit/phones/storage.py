"""Read and write phones as Parquet files.

One row a segment, with plain columns that pandas, polars and dask read: `utterance`, `start` and
`end` in seconds, `phone`, `stress` (0, 1, 2, or null where not marked), `word` and `energy_db`
(null where not known). The phone set and the provenance are JSON in the metadata of the schema.
The same phones give the same bytes.
"""

from __future__ import annotations

import os
from typing import Any

from mocap_fit.errors import DataError
from mocap_fit.phones.types import PhoneSegment, PhoneSequence
from mocap_fit.tracks import Step
from mocap_fit.tracks.parquet_file import (
    check_types,
    from_damaged_table,
    read_table,
    write_table,
)

_COLUMNS = ("start", "end", "phone", "stress", "word", "energy_db")


def write_phones(phones: PhoneSequence, path: str | os.PathLike[str]) -> None:
    """Write phones as a Parquet file, atomically.

    Parameters
    ----------
    phones
        Phones of an utterance.
    path
        File to write; an existing one is replaced.

    Raises
    ------
    FileFormatError
        If the file cannot be written.
    """
    import pyarrow as pa

    columns = {"utterance": pa.array([phones.name] * len(phones), type=pa.string())}
    for name, kind in _get_types().items():
        columns[name] = pa.array([getattr(segment, name) for segment in phones], type=kind)
    description = {
        "kind": "phones",
        "name": phones.name,
        "phone_set": phones.phone_set,
        "provenance": [step.to_dict() for step in phones.provenance],
    }
    write_table(columns, description, path)


def _get_types() -> dict[str, Any]:
    """Return the types of the columns, as pyarrow has them."""
    import pyarrow as pa

    types = (pa.float64(), pa.float64(), pa.string(), pa.int8(), pa.string(), pa.float64())
    return dict(zip(_COLUMNS, types, strict=True))


def read_stored_phones(path: str | os.PathLike[str]) -> PhoneSequence:
    """Read a Parquet file that `write_phones` wrote.

    Parameters
    ----------
    path
        File to read.

    Returns
    -------
    PhoneSequence
        The phones with their phone set, name and provenance.

    Raises
    ------
    FileFormatError
        If the file cannot be read, is damaged, or does not hold phones.
    """
    table, description = read_table(
        path, ("phones",), "phones", "Read labels of another program with read_phones."
    )
    try:
        check_types(table, _get_types(), may_lack=("stress", "word", "energy_db"))
        rows = zip(*(table.column(name).to_pylist() for name in _COLUMNS), strict=True)
        return PhoneSequence(
            tuple(PhoneSegment(*row) for row in rows),
            phone_set=description["phone_set"],
            name=description["name"],
            provenance=tuple(Step.from_dict(step) for step in description["provenance"]),
        )
    except (DataError, KeyError, TypeError, ValueError, AttributeError) as error:
        raise from_damaged_table(error, path, "phones") from None
