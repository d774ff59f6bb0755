"""The one command, ``mocap-fit``.

A command only says what its arguments are and prints what comes of it; its work is the quiet
function of its name in `corpus_tools`, imported when the command is called, so that
``mocap-fit --help`` answers at once. Bad data is a `MocapFitError`, raised by the function; a call
that makes no sense is a `typer.BadParameter`, raised by the command; `console.run_guarded` turns
both into exit statuses.
"""

from __future__ import annotations

import gc
import os
import shutil
import sys
from collections.abc import Sequence
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from corpus_tools.cli import (
    camera_commands,
    console,
    corpus_commands,
    look_commands,
    model_commands,
    speak_commands,
)
from corpus_tools.cli.arguments import accept_common
from mocap_fit._version import __version__


class _Commands(TyperGroup):
    def invoke(self, ctx: Any) -> Any:
        with console.pass_interrupts():
            return super().invoke(ctx)


# Columns of a terminal below which the frames of help would cut the names of options.
_NARROW = 72

app = typer.Typer(
    name=console.PROGRAM,
    cls=_Commands,
    help="From facial motion capture to a talking head.",
    epilog="Exit status: 0 done, 1 the data is bad, 2 the call is wrong, 70 a mistake of the "
    "program, 130 stopped by Ctrl-C, 141 nobody reads the output.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich" if shutil.get_terminal_size().columns >= _NARROW else None,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit status.

    Parameters
    ----------
    arguments
        What follows the program's name; None for the arguments of the process.

    Returns
    -------
    int
        0 done, 1 the data is bad, 2 the call is wrong; 70 a mistake of ours, 130 Ctrl-C, 141
        nobody reads the output.
    """
    console.open_standard_streams()
    for stream in (sys.stdout, sys.stderr):
        # The terminal may not be able to show the name of a marker, above all on Windows.
        reconfigure = getattr(stream, "reconfigure", None)
        if reconfigure is not None:
            reconfigure(errors="backslashreplace")
    if os.environ.get("NO_COLOR"):
        from typer import rich_utils

        # Help is printed by typer, in bold and dim letters without it.
        rich_utils.COLOR_SYSTEM = None
    words = None if arguments is None else list(arguments)
    with console.restore_environment():
        status = console.run_guarded(lambda: app(args=words, prog_name=console.PROGRAM))
    if arguments is None:
        # The process ends: collecting garbage takes up to a third of a second.
        gc.freeze()
    return status


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"{console.PROGRAM} {__version__}")
        raise typer.Exit


@app.callback()
def _accept_options(
    version: Annotated[
        bool,
        typer.Option(
            "--version",
            "-V",
            callback=_print_version,
            is_eager=True,
            help="Print the version and end.",
        ),
    ] = False,
) -> None:
    # Before a command imports its libraries; not at the top, which --help reads.
    from mocap_fit.processes import limit_threads

    limit_threads()


for _module in (
    look_commands,
    camera_commands,
    corpus_commands,
    model_commands,
    speak_commands,
):
    for _name, _command in _module.COMMANDS.items():
        _reads = _name not in ("demo", "simulate")
        app.command(_name)(accept_common(_command, reads=_reads))
