"""The one command, ``mocap-fit``.

A command here only says what its arguments are; its work is `run` in the module of its name,
imported when the command is called, so that ``mocap-fit --help`` answers at once. To add one::

    @app.command()
    def fit(recordings: Recordings, as_json: AsJson = False) -> None:
        \"\"\"What people read in the help.\"\"\"
        from corpus_tools import fit as command

        raise typer.Exit(command.run(recordings, as_json=as_json))

`run` returns a `Status` and raises `MocapFitError` for bad data. A call that makes no sense is
`typer.BadParameter`, raised here. `console.guarded` turns all of it into exit statuses.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

import mocap_fit
from corpus_tools import console


class _Commands(TyperGroup):
    def invoke(self, ctx: Any) -> Any:
        with console.command_boundary():
            return super().invoke(ctx)


app = typer.Typer(
    name=console.PROGRAM,
    cls=_Commands,
    help="From facial motion capture to the parameters of a face model.",
    epilog="Exit status: 0 done, 1 the data is bad, 2 the call is wrong.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)

AsJson = Annotated[bool, typer.Option("--json", help="Print JSON, for programs.")]


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit status.

    Parameters
    ----------
    arguments
        What follows the program's name; those of the process where not given.
    """
    for stream in (sys.stdout, sys.stderr):
        # A marker may be called what the terminal cannot show, above all on Windows.
        reconfigure = getattr(stream, "reconfigure", None)
        if reconfigure is not None:
            reconfigure(errors="backslashreplace")
    given = None if arguments is None else list(arguments)
    return console.guarded(lambda: app(args=given, prog_name=console.PROGRAM))


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"{console.PROGRAM} {mocap_fit.__version__}")
        raise typer.Exit


@app.callback()
def _program(
    version: Annotated[
        bool,
        typer.Option(
            "--version", callback=_print_version, is_eager=True, help="Print the version and end."
        ),
    ] = False,
) -> None:
    pass


@app.command()
def info(
    files: Annotated[
        list[Path], typer.Argument(metavar="FILE", help="Recordings in any known format.")
    ],
    as_json: AsJson = False,
) -> None:
    """Say what files hold: markers, rate, duration, gaps, events."""
    from corpus_tools import info as command

    raise typer.Exit(command.run(files, as_json=as_json))
