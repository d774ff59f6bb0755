"""Checks of a corpus's tables: columns, kinds, and what each row must hold (with pandera)."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from corpus_tools.validation.findings import Finding, Location
from corpus_tools.validation.thresholds import Thresholds
from mocap_fit.tracks.parquet_file import read_table

if TYPE_CHECKING:
    import pandas as pd

_SHOWN = 3
_MISSING = "missing"
# What an id may not hold: it is the name of files.
_ID = re.compile(r"[^\s./\\*?\[\]][^/\\*?\[\]]*")

#: What a check asks for, by its name; shown as what was expected.
REQUIREMENTS = {
    "id": "a name of files, without / \\ * ? [ ]",
    "unique": "each once",
    "not empty": "a name",
    "above 0": "a number above 0",
    "not negative": "0 or more",
    "finite": "finite numbers",
    "numbers": "numbers (float64)",
    "origin": "0 missing, 1 measured, 2 filled or 3 virtual",
    "end after start": "an end after the start",
    "stress": "0, 1, 2 or nothing",
    "decibels": "finite, at most 20 dB",
    "rotation": "rotation matrices: rows of length 1 at right angles, right-handed",
    "texts": "a list of texts",
}


def read_frame(path: Path, kinds: Sequence[str]) -> tuple[pd.DataFrame, dict[str, Any]]:
    """Read a table of a corpus and its description.

    Parameters
    ----------
    path
        The Parquet file.
    kinds
        Kinds of content that it may have.

    Returns
    -------
    frame
        The table.
    description
        What mocap-fit noted in the file.

    Raises
    ------
    FileFormatError
        If it is not Parquet, or none of mocap-fit.
    """
    table, description = read_table(path, kinds, "a table", "Convert the recordings again.")
    return table.to_pandas(), description


@cache
def _create_schema(kind: str) -> Any:
    """Return pandera's schema of a table, or of the cells of a wide one (see `_group_columns`)."""
    import pandera.pandas as pa

    def check(name: str, test: Callable[[Any], Any], each_cell: bool = False) -> Any:
        return pa.Check(test, name=name, ignore_na=True, element_wise=each_cell)

    def is_texts(value: object) -> bool:
        is_list = isinstance(value, list | tuple | np.ndarray)
        return is_list and all(isinstance(item, str) for item in value)  # type: ignore[attr-defined]

    def check_ends(table: pd.DataFrame) -> pd.DataFrame:
        import pandas as pd

        fine = pd.DataFrame(True, index=table.index, columns=table.columns)
        fine["end"] = table["end"] > table["start"]
        return fine

    free = pa.Column(str)
    text = pa.Column(str, check("not empty", bool, each_cell=True))
    finite = check("finite", lambda s: ~np.isinf(s))
    if kind == "utterances":
        name = check("id", lambda v: bool(_ID.fullmatch(v)), each_cell=True)
        texts = check("texts", is_texts, each_cell=True)
        return pa.DataFrameSchema(
            {
                "id": pa.Column(str, name, unique=True),
                "speaker": free,
                "session": free,
                "split": text,
                "duration": pa.Column(float, check("above 0", lambda s: s > 0)),
                "text": free,
                "sources": pa.Column(object, texts),
                "checks": pa.Column(object, texts),
            }
        )
    if kind == "phones":
        levels = check("stress", lambda s: s.isin((0, 1, 2)))
        level = check("decibels", lambda s: np.isfinite(s) & (s <= 20))
        return pa.DataFrameSchema(
            {
                "utterance": free,
                "start": pa.Column(float, finite),
                "end": pa.Column(float, finite),
                "phone": text,
                "stress": pa.Column(checks=levels, nullable=True),
                "word": free,
                # pandas has a column of nothing but null as objects.
                "energy_db": pa.Column(checks=level, nullable=True, dtype=float, coerce=True),
            },
            checks=pa.Check(check_ends, name="end after start"),
        )
    there = check("there", lambda s: s != _MISSING)
    numbers = check("numbers", lambda s: s.isin((_MISSING, "float64", "uint8")))
    tests = {
        "columns": pa.Column(str, [there, numbers]),
        "finite": pa.Column(float, finite, nullable=True),
        "not negative": pa.Column(float, check("not negative", lambda s: s >= 0), nullable=True),
        "origin": pa.Column(float, check("origin", lambda s: s.isin((0, 1, 2, 3)))),
    }
    return pa.DataFrameSchema({"value": tests[kind]})


def _group_columns(kind: str, names: Sequence[str]) -> dict[str, list[str]]:
    """Columns of a table of tracks, by what their cells must be."""
    if kind == "parameters":
        lengths = [*(f"{name}_sd" for name in names), "residual_mm"]
        return {"finite": ["time", *names], "not negative": lengths}
    if kind == "markers":
        locations = [f"{name}_{axis}" for name in names for axis in "xyz"]
        return {"finite": ["time", *locations], "origin": [f"{name}_origin" for name in names]}
    parts = (*"xyz", *(f"r{row}{column}" for row in (1, 2, 3) for column in (1, 2, 3)))
    locations = [f"{name}_{part}" for name in names for part in parts]
    lengths = [f"{name}_residual_mm" for name in names]
    return {"finite": ["time", *locations], "not negative": lengths}


def check_table(
    frame: pd.DataFrame, kind: str, names: Sequence[str], location: Location
) -> Iterator[Finding]:
    """Find what is wrong with the columns and rows of a table.

    Parameters
    ----------
    frame
        As pandas reads it.
    kind
        ``utterances``, ``parameters``, ``markers``, ``poses`` or ``phones``.
    names
        Of the parameters, markers or bodies.
    location
        The file and the utterance.

    Yields
    ------
    Finding
        What is wrong.
    """
    if kind in ("utterances", "phones"):
        for (column, check), cases in _find_failures(frame, kind).items():
            yield _describe_failures(location, column, check, cases)
        return
    # Tables of tracks have hundreds of columns; pandera takes them as few long ones, in a tenth
    # of the time.
    wide = _group_columns(kind, names)
    every = [column for columns in wide.values() for column in columns]
    kinds = [str(frame[c].dtype) if c in frame else _MISSING for c in every]
    for (_, check), cases in _find_failures(_to_long(kinds), "columns").items():
        for row, value in cases:
            yield _describe_failures(location, every[row], check, [(None, value)])
    for requirement, columns in wide.items():
        usable = [c for c in columns if c in frame and frame[c].dtype.kind in "fiu"]
        cells = frame[usable].to_numpy(dtype=float)
        groups: dict[str, list[tuple[Any, Any]]] = {}
        for cases in _find_failures(_to_long(cells.ravel()), requirement).values():
            for index, value in cases:
                at, which = divmod(int(index), len(usable))
                groups.setdefault(usable[which], []).append((at, value))
        for name, cases in groups.items():
            yield _describe_failures(location, name, requirement, cases)
    if kind == "poses":
        yield from _check_rotations(frame, names, location)


def _to_long(values: Any) -> pd.DataFrame:
    import pandas as pd

    return pd.DataFrame({"value": values})


def _find_failures(frame: pd.DataFrame, kind: str) -> dict[tuple[str, str], list[tuple[Any, Any]]]:
    """Cells that fail, as row and value, by column and check."""
    from pandera.errors import SchemaErrors

    groups: dict[tuple[str, str], list[tuple[Any, Any]]] = {}
    try:
        _create_schema(kind).validate(frame, lazy=True)
    except SchemaErrors as errors:
        for row in errors.failure_cases.to_dict("records"):
            check, column, case = str(row["check"]), row["column"], row["failure_case"]
            # A check of the whole table gives its cells by their columns.
            cells = case if isinstance(case, dict) else {column: case}
            if check == "column_in_dataframe":
                cells = {case: ""}
            for name, value in cells.items():
                name = name if isinstance(name, str) else ""
                groups.setdefault((name, check), []).append((row["index"], value))
    return groups


def _describe_failures(
    location: Location, column: str, check: str, cases: Sequence[tuple[Any, Any]]
) -> Finding:
    where = location.at(column)
    if check in ("column_in_dataframe", "there"):
        return Finding("MF503", where, "there is no such column", "a column of that name")
    rows = [int(row) for row, _ in cases if isinstance(row, int | np.integer)]
    values = ", ".join(dict.fromkeys(str(value) for _, value in cases[:_SHOWN]))
    if check.startswith("dtype"):
        wanted = check.removeprefix("dtype").strip("()'")
        return Finding("MF503", where, f"values of {values}", f"values of {wanted}")
    expected = REQUIREMENTS.get(check, REQUIREMENTS["unique"] if "unique" in check else check)
    expected = "a value in every row" if check == "not_nullable" else expected
    if not rows:
        return Finding("MF503", where, values or "other values", expected)
    shown = f"row {rows[0]}" if len(rows) == 1 else f"{len(rows)} rows from row {rows[0]}"
    return Finding("MF503", where, f"{values} ({shown})", expected)


def _check_rotations(
    frame: pd.DataFrame, names: Sequence[str], location: Location
) -> Iterator[Finding]:
    for name in names:
        columns = [f"{name}_r{row}{column}" for row in (1, 2, 3) for column in (1, 2, 3)]
        if not set(columns) <= set(frame.columns):
            continue
        matrices = frame[columns].to_numpy(dtype=float).reshape(-1, 3, 3)
        there = np.isfinite(matrices).all(axis=(1, 2))
        product = np.einsum("fij,fkj->fik", matrices[there], matrices[there])
        off = np.abs(product - np.eye(3)).max(axis=(1, 2)) > 1e-6
        off |= np.linalg.det(matrices[there]) < 0
        if off.any():
            frame_number = int(np.flatnonzero(there)[int(np.argmax(off))])
            where = location.at(name, (frame_number, frame_number))
            text = f"{int(off.sum())} matrices turn nothing"
            yield Finding("MF503", where, text, REQUIREMENTS["rotation"])


def check_times(
    frame: pd.DataFrame, description: Mapping[str, Any], location: Location, limits: Thresholds
) -> Iterator[Finding]:
    """Find time stamps that contradict the file's rate and start time.

    Parameters
    ----------
    frame
        The table, as pandas reads it.
    description
        What mocap-fit noted in the file.
    location
        The file and the utterance.
    limits
        What counts as wrong.

    Yields
    ------
    Finding
        What is wrong.
    """
    if "time" not in frame or not len(frame):
        return
    times = frame["time"].to_numpy(dtype=float)
    rate, start = float(description["rate"]), float(description["start_time"])
    even = start + np.arange(len(times)) / rate
    allowed = limits.time.stamp / rate
    off = ~(np.abs(times - even) <= allowed)
    if not off.any():
        return
    first = int(np.argmax(off))
    # A rate of its own, evenly kept, is another mistake than a frame that is out of place.
    steps = np.diff(times)
    spread = float(np.ptp(steps)) if len(steps) and np.isfinite(times).all() else np.inf
    if len(steps) > 1 and spread < allowed and abs(np.median(steps) * rate - 1) > limits.time.rate:
        text = f"time stamps {1 / np.median(steps):.6g} Hz apart"
        expected = f"{rate:g} Hz, as the file's description says"
        yield Finding("MF141", location.at("time"), text, expected)
        return
    last = int(np.flatnonzero(off)[-1])
    where = location.at("time", (first, last), (float(even[first]), float(even[last])))
    text = f"{int(off.sum())} of {len(times)} stamps are off, the first by "
    text += f"{1000 * (times[first] - even[first]):.1f} ms"
    yield Finding("MF142", where, text, f"every {1000 / rate:.2f} ms from {start:g} s")


def check_utterance_name(
    frame: pd.DataFrame, utterance: str, location: Location
) -> Iterator[Finding]:
    """Find rows that name another utterance than the file does.

    Parameters
    ----------
    frame
        The table, as pandas reads it.
    utterance
        Id of the utterance.
    location
        The file and the utterance.

    Yields
    ------
    Finding
        What is wrong.
    """
    if "utterance" not in frame:
        return
    others = sorted({str(name) for name in frame["utterance"].unique()} - {utterance})
    if others:
        where = location.at("utterance")
        yield Finding("MF504", where, f"rows of {', '.join(others[:_SHOWN])}", utterance)
