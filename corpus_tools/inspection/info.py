"""``mocap-fit info``: what a file holds, as tables for people or JSON for programs."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import Any

from corpus_tools.cli import console
from corpus_tools.cli.console import Status
from mocap_fit.errors import MocapFitError, describe_error

# Units of what a file's description holds; a share is shown in per cent.
_UNITS = {
    "rate": "Hz",
    "duration": "s",
    "start_time": "s",
    "start": "s",
    "end": "s",
    "time": "s",
    "look_ahead": "s",
    "loudest_db": "dB",
    "quietest_db": "dB",
}
_SHARES = {"gap_rate"}


def run(files: Sequence[str | os.PathLike[str]], *, as_json: bool = False) -> Status:
    """Describe files on stdout; those that cannot be read are named on stderr.

    A bad file does not keep the others from being described.

    Parameters
    ----------
    files
        Recordings, labels, sound, trained models, folders of corpora.
    as_json
        Print one JSON list, an object a file, in the order given; an object of a bad file has
        `file` and `error`.

    Returns
    -------
    Status
        `BAD_DATA` if any file could not be read.
    """
    from corpus_tools.inspection.contents import contents

    status = Status.DONE
    described: list[Mapping[str, Any]] = []
    for file in files:
        try:
            content: Mapping[str, Any] = contents(file)
        except (MocapFitError, OSError) as error:
            console.report(error)
            status = Status.BAD_DATA
            content = {"file": os.fspath(file), "error": describe_error(error)}
        else:
            if not as_json:
                _show(content)
        described.append(content)
    if as_json:
        console.print_json(described)
    return status


def _show(content: Mapping[str, Any]) -> None:
    """Print one file's content: plain values first, then a table for each list of records."""
    from rich import box
    from rich.table import Table
    from rich.text import Text

    screen = console.screen()
    summary = Table(show_header=False, box=box.SIMPLE)
    summary.add_column(style="bold", no_wrap=True)
    summary.add_column(overflow="fold")
    tables = [summary]
    for key, value in content.items():
        if key == "file":
            continue
        if _is_records(value):
            tables.append(_record_table(key, value))
        else:
            summary.add_row(Text(_label(key)), Text(_with_unit(key, value)))
    # A path is never broken over lines, or nobody could copy it.
    path = console.printable(str(content["file"]))
    screen.print(Text(path, style="bold"), soft_wrap=True)
    for table in tables:
        screen.print(table)


def _record_table(key: str, records: Sequence[Mapping[str, Any]]) -> Any:
    from rich import box
    from rich.table import Table
    from rich.text import Text

    table = Table(title=Text(_label(key)), title_justify="left", box=box.SIMPLE_HEAD)
    columns = list(dict.fromkeys(column for record in records for column in record))
    for column in columns:
        is_number = all(isinstance(record.get(column), (int, float)) for record in records)
        justify: Any = "right" if is_number else "left"
        table.add_column(Text(_label(column)), justify=justify, overflow="fold")
    for record in records:
        table.add_row(*(Text(_with_unit(column, record.get(column))) for column in columns))
    return table


def _is_records(value: object) -> bool:
    return (
        isinstance(value, (list, tuple))
        and len(value) > 0
        and all(isinstance(item, Mapping) for item in value)
    )


def _label(key: object) -> str:
    return console.printable(str(key).replace("_", " "))


def _with_unit(key: str, value: Any) -> str:
    if isinstance(value, (int, float)) and key in _SHARES:
        return f"{100 * value:.1f} %"
    if isinstance(value, (int, float)) and key in _UNITS:
        return f"{_text(value)} {_UNITS[key]}"
    return _text(value)


def _text(value: Any) -> str:
    """A value as people write it."""
    if value is None:
        return "–"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, Mapping):
        return ", ".join(f"{_label(key)} {_text(item)}" for key, item in value.items()) or "–"
    if isinstance(value, (list, tuple)):
        return ", ".join(_text(item) for item in value) or "–"
    return console.printable(str(value))
