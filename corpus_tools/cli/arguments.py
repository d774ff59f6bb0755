"""Arguments that several commands share."""

from __future__ import annotations

import functools
import inspect
import math
import os
import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated, Any, TypeVar

import typer

from corpus_tools.cli import console
from mocap_fit.errors import DEBUG_VARIABLE, ConfigurationError
from mocap_fit.parsing import parse_toml
from mocap_fit.size_limit import VARIABLE, get_largest_size

ChoiceT = TypeVar("ChoiceT", bound=str)

# A file that may not be read is bad data, and typer would call it a wrong call.
Argument = functools.partial(typer.Argument, readable=False)
Option = functools.partial(typer.Option, readable=False)

AsJson = Annotated[bool, Option("--json", help="Print JSON, for programs.")]
Jobs = Annotated[int, Option(min=0, help="Number of processes; 0 for one per core.")]
Dask = Annotated[
    str | None, Option(metavar="ADDRESS", help="Work on a dask cluster: tcp://HOST:PORT, tls://…")
]
Overwrite = Annotated[
    bool, Option("--overwrite", help="Replace labels, and tables of other programs.")
]
Dictionary = Annotated[Path | None, Option(help="A pronouncing dictionary in CMU's format.")]
Face = Annotated[str, Option(help="The face: built-in, or a rig file.")]
Layout = Annotated[
    str | None,
    Option(help="The marker layout: a shipped name, or a TOML file; by default the one that fits."),
]

Rate = Annotated[
    float | None, Option(metavar="HZ", help="Frames per second, in place of what the file says.")
]
Unit = Annotated[
    str | None, Option(metavar="mm|cm|m", help="Unit of length, in place of what the file says.")
]
Subject = Annotated[
    str | None, Option(metavar="NAME", help="Whose markers are read, where several are recorded.")
]
Rename = Annotated[
    list[str] | None,
    Option(metavar="OLD=NEW", help="Another name of a marker; as often as needed."),
]
ReferenceAsIs = Annotated[
    bool,
    Option("--reference-as-is", help="Read the reference pose without these four options."),
]
Edits = Annotated[
    Path | None,
    Option(
        metavar="FILE|DIR",
        help="An edit list, or a folder of them; by default RECORDING.edits.toml beside each.",
    ),
]
AllowMirrored = Annotated[
    bool, Option("--allow-mirrored", help="Mend recordings that are mirror images.")
]

_BETWEEN = re.compile(r"(\d+(?:\.\d*)?)-(\d+(?:\.\d*)?)")


_MaxSize = Annotated[
    str | None,
    Option(metavar="SIZE", help="What a file may unpack to, such as 8GB; by default 2GB."),
]
_Quiet = Annotated[
    bool, Option("--quiet", "-q", help="Print results and errors only: no progress, no warnings.")
]
_Verbose = Annotated[
    bool, Option("--verbose", "-v", help="Print the tracebacks of errors, and all warnings.")
]


def accept_common(command: Callable[..., None], *, reads: bool) -> Callable[..., None]:
    """Return a command with the options that all commands have.

    Parameters
    ----------
    command
        The command.
    reads
        Whether it reads files, and may limit how large they are.

    Returns
    -------
    Callable
        The command; `console.restore_environment` undoes what it sets.
    """

    @functools.wraps(command)
    def run(*, quiet: bool, verbose: bool, max_size: str | None = None, **values: Any) -> None:
        if quiet and verbose:
            raise typer.BadParameter("goes without --verbose", param_hint="--quiet")
        # Processes inherit them; when the command ends, they are as before.
        if quiet:
            os.environ[console.QUIET_VARIABLE] = "1"
        if verbose:
            os.environ[DEBUG_VARIABLE] = "1"
            console.show_all_warnings()
        if max_size is not None:
            os.environ[VARIABLE] = max_size
        try:
            get_largest_size()
        except ConfigurationError as error:
            raise typer.BadParameter(str(error), param_hint="--max-size") from None
        command(**values)

    kinds: dict[str, tuple[Any, Any]] = {"max_size": (_MaxSize, None)} if reads else {}
    kinds |= {"quiet": (_Quiet, False), "verbose": (_Verbose, False)}
    signature = inspect.signature(command, eval_str=True)
    options = [
        inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=kind)
        for name, (kind, default) in kinds.items()
    ]
    parameters = [*signature.parameters.values(), *options]
    vars(run)["__signature__"] = signature.replace(parameters=parameters)
    run.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    return run


def check_choice(value: str, known: Sequence[ChoiceT], option: str) -> ChoiceT:
    """Return a value if it is a known one.

    Parameters
    ----------
    value
        What the user gave.
    known
        The known values.
    option
        Name of the option.

    Returns
    -------
    str
        The value.

    Raises
    ------
    typer.BadParameter
        If it is not known: the call is wrong.
    """
    for choice in known:
        if choice == value:
            return choice
    raise typer.BadParameter(f"'{value}' is not one of {', '.join(known)}", param_hint=option)


def check_workers(dask: str | None, jobs: int) -> None:
    """Refuse a cluster together with a number of processes.

    Parameters
    ----------
    dask
        Address of the cluster; None for this machine.
    jobs
        Number of processes.

    Raises
    ------
    typer.BadParameter
        If both are there: the call is wrong.
    """
    if dask is not None and jobs != 1:
        raise typer.BadParameter(
            "goes without --jobs: the cluster has its workers", param_hint="--dask"
        )


def parse_between(text: str | None) -> tuple[float, float] | None:
    """Return start and end of a part of a recording.

    Parameters
    ----------
    text
        ``START-END`` in seconds; None for the complete recording.

    Returns
    -------
    tuple[float, float] | None
        Seconds.

    Raises
    ------
    typer.BadParameter
        If the text is something else, or the end is not after the start.
    """
    if text is None:
        return None
    match = _BETWEEN.fullmatch(text.strip())
    if match is None or not float(match[1]) < float(match[2]):
        raise typer.BadParameter(
            f"'{text}' is not START-END in seconds, such as 12.5-60", param_hint="--between"
        )
    return float(match[1]), float(match[2])


def parse_reading(
    rate: float | None, unit: str | None, subject: str | None, rename: Sequence[str] | None
) -> dict[str, Any]:
    """Return how recordings are read: keywords of the commands' functions.

    Parameters
    ----------
    rate
        Frame rate, hertz.
    unit
        Unit of length.
    subject
        Subject whose markers are read.
    rename
        ``OLD=NEW`` each.

    Returns
    -------
    dict[str, Any]
        The values.

    Raises
    ------
    typer.BadParameter
        If one is not possible: the call is wrong.
    """
    if rate is not None and not 0 < rate < math.inf:
        raise typer.BadParameter(f"{rate:g} is not a number above 0", param_hint="--rate")
    if unit is not None:
        check_choice(unit, ("mm", "cm", "m"), "--unit")
    pairs: dict[str, str] = {}
    for text in rename or ():
        # Names with = in them can be renamed by a manifest.
        old, _, new = text.partition("=")
        old, new = old.strip(), new.strip()
        if not old or not new or "=" in new:
            raise typer.BadParameter(f"'{text}' is not OLD=NEW", param_hint="--rename")
        if old in pairs:
            raise typer.BadParameter(f"'{old}' is renamed twice", param_hint="--rename")
        pairs[old] = new
    return {"rate": rate, "unit": unit, "subject": subject, "rename": pairs or None}


def parse_settings(settings: Sequence[str]) -> dict[str, Any]:
    """Return the settings of a model by their names.

    Parameters
    ----------
    settings
        ``KEY=VALUE`` each, or ``TABLE.KEY=VALUE``; a value that is not TOML is text.

    Returns
    -------
    dict[str, Any]
        The values.

    Raises
    ------
    typer.BadParameter
        If one has no = or no key.
    """
    values: dict[str, Any] = {}
    for setting in settings:
        key, equals, text = setting.partition("=")
        *tables, key = key.strip().replace("-", "_").split(".")
        if not equals or not all(part.isidentifier() for part in (*tables, key)):
            raise typer.BadParameter(f"'{setting}' is not KEY=VALUE", param_hint="--set")
        try:
            value = parse_toml(f"value = {text}")["value"]
        except ValueError:
            value = text
        target = values
        for table in tables:
            target = target.setdefault(table, {})
            if not isinstance(target, dict):
                raise typer.BadParameter(f"'{table}' is set twice", param_hint="--set")
        target[key] = tuple(value) if isinstance(value, list) else value
    return values


def parse_size(text: str) -> tuple[int, int]:
    """Return the size of a window.

    Parameters
    ----------
    text
        As the user wrote it: ``1280x800``.

    Returns
    -------
    tuple of int
        Width and height, pixels.

    Raises
    ------
    typer.BadParameter
        If it is no size from 400x300 to 8192x8192.
    """
    width, _, height = text.lower().partition("x")
    if width.isdecimal() and height.isdecimal():
        size = int(width), int(height)
        if 400 <= size[0] <= 8192 and 300 <= size[1] <= 8192:
            return size
    raise typer.BadParameter(f"'{text}' is no size from 400x300 to 8192x8192", param_hint="--size")
