"""The one command, ``mocap-fit``.

A command here only says what its arguments are; its work is `run` in the module of its name,
imported when the command is called, so that ``mocap-fit --help`` answers at once. To add one::

    @app.command()
    def fit(recordings: Recordings, as_json: AsJson = False) -> None:
        \"\"\"What people read in the help.\"\"\"
        from corpus_tools import fit as command

        raise typer.Exit(command.run(recordings, as_json=as_json))

`run` returns a `Status` and raises `MocapFitError` for bad data. A call that makes no sense is
`typer.BadParameter`, raised here. `console.guarded` turns all of it into exit statuses. Paths have
``readable=False``: a file that may not be read is bad data, and typer would call it a wrong call.
"""

from __future__ import annotations

import gc
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from corpus_tools.cli import console, corpus_commands, model_commands, speak_commands
from corpus_tools.cli.arguments import AsJson, one_of
from mocap_fit._version import __version__


class _Commands(TyperGroup):
    def invoke(self, ctx: Any) -> Any:
        with console.command_boundary():
            return super().invoke(ctx)


app = typer.Typer(
    name=console.PROGRAM,
    cls=_Commands,
    help="From facial motion capture to a talking head.",
    epilog="Exit status: 0 done, 1 the data is bad, 2 the call is wrong.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


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
    status = console.guarded(lambda: app(args=given, prog_name=console.PROGRAM))
    if arguments is None:
        # The process ends: to look for what could be freed takes up to a third of a second.
        gc.freeze()
    return status


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"{console.PROGRAM} {__version__}")
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
def demo(
    out: Annotated[
        Path,
        typer.Option(
            help="A new folder, or that of a former demo, which is replaced.", readable=False
        ),
    ] = Path("mocap-fit-demo"),
    seed: Annotated[int, typer.Option(min=0, help="The same seed gives the same numbers.")] = 0,
    as_json: AsJson = False,
) -> None:
    """The whole path on recordings that it makes itself: fit, train, score, talk."""
    from corpus_tools import demo as command

    raise typer.Exit(command.run(out, seed=seed, as_json=as_json))


@app.command()
def info(
    files: Annotated[
        list[Path],
        typer.Argument(
            metavar="FILE",
            help="Recordings, labels, sound, trained models, corpora.",
            readable=False,
        ),
    ],
    tree: Annotated[
        str | None,
        typer.Option(metavar="PHONE/PARAMETER", help="Show a tree of a CART model."),
    ] = None,
    svg: Annotated[
        Path | None, typer.Option(help="Draw the tree into this file (SVG).", readable=False)
    ] = None,
    explain: Annotated[
        Path | None,
        typer.Option(
            metavar="PHONES",
            help="Labels, or phones of a corpus: what decided their targets in a CART model.",
            readable=False,
        ),
    ] = None,
    questions: Annotated[
        bool, typer.Option("--questions", help="How much each question of a CART model matters.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Say what recordings, labels, sound, models and corpora hold; look into trees."""
    if tree is not None or svg is not None or explain is not None or questions:
        if len(files) != 1:
            raise typer.BadParameter("give one model", param_hint="FILE")
        from corpus_tools.inspection import trees

        raise typer.Exit(trees.run(files[0], tree=tree, svg=svg, explain=explain, as_json=as_json))
    from corpus_tools.inspection import info as command

    raise typer.Exit(command.run(files, as_json=as_json))


@app.command()
def fit(
    recordings: Annotated[
        list[Path],
        typer.Argument(
            metavar="RECORDING", help="Recordings: files, folders or patterns.", readable=False
        ),
    ],
    reference: Annotated[
        Path,
        typer.Option(
            help="A recording of the reference pose: face at rest, lips closed.", readable=False
        ),
    ],
    layout: Annotated[str, typer.Option(help="The marker layout: a shipped name, or a TOML file.")],
    out: Annotated[Path, typer.Option(help="The folder for OUT/ID.parquet.", readable=False)],
    face: Annotated[str, typer.Option(help="The face: built-in, or a rig file.")] = "built-in",
    objective: Annotated[
        str, typer.Option(help="What is minimised: distances, squares or huber.")
    ] = "distances",
    solver: Annotated[
        str,
        typer.Option(
            help="newton-nlopt, newton, or an nlopt algorithm (LN_PRAXIS: Powell's, the paper's)."
        ),
    ] = "newton-nlopt",
    refine_pose: Annotated[
        bool, typer.Option("--refine-pose", help="Find the head's pose together with the shape.")
    ] = False,
    smooth: Annotated[
        bool,
        typer.Option("--smooth", help="Fit all frames together, as smooth as the data tell."),
    ] = False,
    jobs: Annotated[int, typer.Option(min=0, help="How many processes; 0: one a core.")] = 1,
    dask: Annotated[
        str | None,
        typer.Option(metavar="ADDRESS", help="Fit on a dask cluster: tcp://HOST:PORT."),
    ] = None,
    fresh: Annotated[
        bool, typer.Option("--fresh", help="Fit also what a former run has fitted already.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Fit face parameters to recordings, frame by frame.

    Recordings that a former run fitted in the same way are kept, so that a run that was stopped
    goes on where it was.
    """
    from mocap_fit.processes import limit_threads

    if dask is not None and jobs != 1:
        raise typer.BadParameter(
            "goes without --jobs: the cluster has its own", param_hint="--dask"
        )
    limit_threads()
    from corpus_tools.conversion import fit as command
    from corpus_tools.conversion.one_recording import FitSettings
    from mocap_fit.fitting.objective import OBJECTIVES
    from mocap_fit.fitting.solving import SOLVERS

    settings: FitSettings = {
        "objective": one_of(objective, OBJECTIVES, "--objective"),  # type: ignore[typeddict-item]
        "solver": one_of(solver, SOLVERS, "--solver"),
        "refine_pose": refine_pose,
        "smooth": smooth,
    }
    raise typer.Exit(
        command.run(
            recordings,
            reference=reference,
            layout=layout,
            out=out,
            face=face,
            settings=settings,
            jobs=jobs,
            cluster=dask,
            fresh=fresh,
            as_json=as_json,
        )
    )


@app.command()
def validate(
    paths: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="PATH",
            help="Corpora, folders, recordings, labels, sound; files of one name belong together.",
            readable=False,
        ),
    ] = None,
    thresholds: Annotated[
        Path | None,
        typer.Option(help="A TOML file that changes what counts as wrong.", readable=False),
    ] = None,
    html: Annotated[
        Path | None, typer.Option(help="A page with the report and pictures.", readable=False)
    ] = None,
    layout: Annotated[
        str | None, typer.Option(help="The marker layout: a shipped name, or a TOML file.")
    ] = None,
    phone_set: Annotated[
        str | None, typer.Option(help="The phone set: a shipped name, or a TOML file.")
    ] = None,
    codes: Annotated[
        bool, typer.Option("--codes", help="List all that can be found, and end.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Check recordings, labels, sound and corpora; name what is wrong, where, and what to do.

    Exit status 1 if anything is an error; warnings and notes alone leave it at 0.
    """
    from corpus_tools.validation import validate as command

    if codes:
        raise typer.Exit(command.codes(as_json=as_json))
    if not paths:
        raise typer.BadParameter("give a corpus, a folder or a file", param_hint="PATH")
    raise typer.Exit(
        command.run(
            paths,
            thresholds=thresholds,
            layout=layout,
            phone_set=phone_set,
            page=html,
            as_json=as_json,
        )
    )


@app.command()
def simulate(
    out: Annotated[Path, typer.Argument(metavar="OUT", help="A new folder.", readable=False)],
    utterances: Annotated[int, typer.Option(min=1, help="How many sentences.")] = 287,
    seed: Annotated[int, typer.Option(min=0, help="The same seed gives the same files.")] = 0,
    lang: Annotated[
        str | None, typer.Option(help="The language: sv (where not given), cs or en.")
    ] = None,
    durations: Annotated[
        str | None,
        typer.Option(help="Phone times and sound: model (where not given), or espeak (espeak-ng)."),
    ] = None,
    layout: Annotated[
        str, typer.Option(help="The marker layout: a shipped name, or a TOML file.")
    ] = "face30-head5",
    duration: Annotated[
        float | None,
        typer.Option(min=0.1, help="No sentences: free gestures in recordings of this length (s)."),
    ] = None,
    rate: Annotated[float, typer.Option(min=1, help="Frames a second (Hz).")] = 60.0,
    noise: Annotated[float, typer.Option(min=0, help="Noise of a coordinate (mm).")] = 0.3,
    drop_outs: Annotated[
        float, typer.Option(min=0, max=0.8, help="Part of the samples that are lost.")
    ] = 0.05,
    head_shift: Annotated[float, typer.Option(min=0, help="Largest head shift (mm).")] = 30.0,
    head_turn: Annotated[
        float, typer.Option(min=0, max=80, help="Largest head turn (degrees).")
    ] = 20.0,
    other_speaker: Annotated[
        bool,
        typer.Option("--other-speaker", help="A head of other size and proportions."),
    ] = False,
    drift: Annotated[
        float,
        typer.Option(
            min=-1000,
            max=1000,
            help="How much faster frames are than they say, on the sound's clock (millionths).",
        ),
    ] = 20.0,
) -> None:
    """Make a corpus with known truth: recordings, labels, sound, and a manifest to convert it."""
    import math

    if duration is not None and (lang is not None or durations is not None):
        raise typer.BadParameter(
            "goes without --lang and --durations: free gestures say nothing",
            param_hint="--duration",
        )
    from corpus_tools import simulation as command

    spoken = command.Spoken(
        one_of(lang or "sv", command.languages(), "--lang"),
        one_of(durations or "model", command.DURATIONS, "--durations"),  # type: ignore[arg-type]
        drift,
    )
    conditions = command.Conditions(
        noise=noise,
        drop_outs=drop_outs,
        head_translation=head_shift,
        head_rotation=math.radians(head_turn),
        rate=rate,
        **({} if duration is None else {"duration": duration}),
    )
    with console.progress("simulating recordings", utterances) as advance:
        status = command.run(
            out,
            utterances=utterances,
            seed=seed,
            layout=layout,
            conditions=conditions,
            head=command.OTHER_SPEAKER if other_speaker else None,
            spoken=spoken if duration is None else None,
            progress=lambda _: advance(),
        )
    raise typer.Exit(status)


app.command()(corpus_commands.convert)
app.command()(corpus_commands.align)
app.command()(corpus_commands.select_sentences)
app.command()(model_commands.train)
app.command()(model_commands.evaluate)
app.command()(speak_commands.speak)
app.command()(speak_commands.stream)
app.command()(speak_commands.export)
