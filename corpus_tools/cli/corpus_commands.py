"""The commands that make recordings and corpora; `app` puts them on the command line."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

import typer

from corpus_tools.cli import arguments, console, display
from corpus_tools.cli.arguments import Argument, AsJson, Option
from corpus_tools.cli.console import Status


def _fit(
    recordings: Annotated[
        list[Path], Argument(metavar="RECORDING", help="Recordings: files, folders or patterns.")
    ],
    reference: Annotated[
        str,
        Option(
            metavar="FILE[@START-END]",
            help="A recording of the face at rest with lips closed, or a span of a take (seconds).",
        ),
    ],
    out: Annotated[Path, Option(help="The folder for OUT/NAME.parquet.")],
    layout: arguments.Layout = None,
    face: arguments.Face = "built-in",
    between: Annotated[
        str | None,
        Option(metavar="START-END", help="Fit only this part of each recording (seconds)."),
    ] = None,
    objective: Annotated[
        str, Option(help="What is minimised: distances, squares or huber.")
    ] = "distances",
    solver: Annotated[
        str,
        Option(
            help="newton-nlopt, newton, or an nlopt algorithm (LN_PRAXIS: Powell's, the paper's)."
        ),
    ] = "newton-nlopt",
    refine_pose: Annotated[
        bool, Option("--refine-pose", help="Fit the head's pose together with the shape.")
    ] = False,
    smooth: Annotated[
        bool, Option("--smooth", help="Fit all frames together, as smooth as the data say.")
    ] = False,
    edits: arguments.Edits = None,
    allow_mirrored: arguments.AllowMirrored = False,
    rename: arguments.Rename = None,
    rate: arguments.Rate = None,
    unit: arguments.Unit = None,
    subject: arguments.Subject = None,
    reference_as_is: arguments.ReferenceAsIs = False,
    jobs: arguments.Jobs = 1,
    dask: arguments.Dask = None,
    fresh: Annotated[
        bool, Option("--fresh", help="Fit again what an earlier run has fitted.")
    ] = False,
    overwrite: arguments.Overwrite = False,
    as_json: AsJson = False,
) -> None:
    """Fit face parameters to recordings, frame by frame.

    Recordings that an earlier run has fitted in the same way are skipped, so that a run that was
    stopped goes on where it was.
    """
    arguments.check_workers(dask, jobs)
    part = arguments.parse_between(between)
    reading = arguments.parse_reading(rate, unit, subject, rename)
    from corpus_tools.cli import corpus_printing
    from corpus_tools.conversion.fit import fit as run
    from mocap_fit.fitting.objective import OBJECTIVES
    from mocap_fit.fitting.solving import SOLVERS

    causes = corpus_printing.CausePrinter()
    with display.show_batch_progress("fitting recordings", causes.show_result) as progress:
        report = run(
            recordings,
            reference=reference,
            layout=layout,
            out=out,
            face=face,
            between=part,
            edits=edits,
            objective=arguments.check_choice(objective, OBJECTIVES, "--objective"),
            solver=arguments.check_choice(solver, SOLVERS, "--solver"),
            refine_pose=refine_pose,
            smooth=smooth,
            allow_mirrored=allow_mirrored,
            **reading,
            reference_as_is=reference_as_is,
            jobs=jobs,
            cluster=dask,
            fresh=fresh,
            overwrite=overwrite,
            progress=progress,
        )
    causes.finish()
    display.print_report(report, corpus_printing.print_fit, as_json=as_json)
    raise typer.Exit(Status.BAD_DATA if report.errors else Status.DONE)


def _print_example(wanted: bool) -> None:
    if wanted:
        from corpus_tools.conversion.manifest import read_example

        typer.echo(read_example(), nl=False)
        raise typer.Exit


def _convert(
    manifest: Annotated[
        Path,
        Argument(
            metavar="MANIFEST",
            help="A TOML file; or a folder with manifest.toml, or with recordings/ labels/ "
            "sound/ and reference.*.",
        ),
    ],
    out: Annotated[Path, Option(help="The corpus: a new folder, or an earlier corpus.")],
    root: Annotated[
        Path | None,
        Option(help="The folder of the manifest's paths; by default that of the manifest."),
    ] = None,
    phone_set: Annotated[
        str | None, Option(help="In place of the manifest's; needed without one.")
    ] = None,
    layout: Annotated[
        str | None, Option(help="In place of the manifest's; by default the one that fits.")
    ] = None,
    edits: Annotated[
        str | None,
        Option(
            metavar="PATTERN",
            help="Edit lists under the root, such as edits/{id}.toml, in place of the "
            "manifest's; by default RECORDING.edits.toml beside each recording.",
        ),
    ] = None,
    allow_mirrored: arguments.AllowMirrored = False,
    rename: arguments.Rename = None,
    rate: arguments.Rate = None,
    unit: arguments.Unit = None,
    subject: arguments.Subject = None,
    reference_as_is: arguments.ReferenceAsIs = False,
    jobs: arguments.Jobs = 1,
    dask: arguments.Dask = None,
    fresh: Annotated[
        bool, Option("--fresh", help="Convert again what an earlier run has converted.")
    ] = False,
    as_json: AsJson = False,
    example: Annotated[
        bool,
        Option(
            "--example",
            callback=_print_example,
            is_eager=True,
            help="Print a manifest with every key, and end.",
        ),
    ] = False,
) -> None:
    """Convert recordings, labels and sound to a corpus.

    Bad utterances are named and left out. What an earlier run has converted from the same files
    in the same way is skipped, so that a run that was stopped goes on where it was. Every key of
    a manifest is explained by `mocap-fit convert --example`.
    """
    arguments.check_workers(dask, jobs)
    reading = arguments.parse_reading(rate, unit, subject, rename)
    from corpus_tools.cli import corpus_printing
    from corpus_tools.conversion.convert import convert as run

    with display.show_batch_progress("converting utterances") as progress:
        report = run(
            manifest,
            root=root,
            out=out,
            phone_set=phone_set,
            layout=layout,
            edits=edits,
            allow_mirrored=allow_mirrored,
            **reading,
            reference_as_is=reference_as_is,
            jobs=jobs,
            cluster=dask,
            fresh=fresh,
            progress=progress,
        )
    for line in report.messages:
        console.say(line)
    display.print_report(report, corpus_printing.print_conversion, as_json=as_json)
    raise typer.Exit(Status.BAD_DATA if report.errors else Status.DONE)


def _align(
    sounds: Annotated[list[Path], Argument(metavar="SOUND", help="Sounds of speech.")],
    out: Annotated[Path, Option(help="The folder for OUT/NAME.TextGrid.")],
    text: Annotated[
        Path | None,
        Option(
            help="What is said: the text of one sound, a table NAME<tab>TEXT, or a folder with "
            "NAME.txt; by default those beside the sounds."
        ),
    ] = None,
    dictionary: arguments.Dictionary = None,
    acoustic_model: Annotated[
        Path | None, Option(help="The folder of a model of pocketsphinx.")
    ] = None,
    phone_set: Annotated[str | None, Option(help="What the model's phones are read as.")] = None,
    overwrite: arguments.Overwrite = False,
    as_json: AsJson = False,
) -> None:
    """Find when the phones of a known text are spoken: one TextGrid per sound."""
    from corpus_tools.cli import corpus_printing
    from corpus_tools.conversion.align import align as run

    causes = corpus_printing.CausePrinter()
    with display.show_progress() as show:

        def show_sound(done: int, total: int, error: Exception | None) -> None:
            show("aligning", done, total)
            if error is not None:
                causes.show_error(str(sounds[done - 1]), error)

        report = run(
            sounds,
            text,
            out=out,
            dictionary=dictionary,
            acoustic_model=acoustic_model,
            phone_set=phone_set,
            overwrite=overwrite,
            progress=show_sound,
        )
    causes.finish()
    display.print_report(report, corpus_printing.print_alignment, as_json=as_json)
    raise typer.Exit(Status.BAD_DATA if report.errors else Status.DONE)


def _select_sentences(
    text: Annotated[
        Path,
        Argument(
            metavar="TEXT", help="A sentence per line (with --dictionary), or SENTENCE<tab>PHONES."
        ),
    ],
    count: Annotated[int, Option(min=1, help="How many sentences.")] = 287,
    out: Annotated[Path, Option(help="The folder for sentences and coverage.")] = Path("sentences"),
    dictionary: arguments.Dictionary = None,
    phone_set: Annotated[
        str | None, Option(help="Symbols that it does not have are an error.")
    ] = None,
    stress: Annotated[
        bool, Option("--stress", help="Count a stressed vowel as another phone.")
    ] = False,
    shortest: Annotated[int, Option(min=1, help="Fewest words of a sentence.")] = 1,
    longest: Annotated[int, Option(min=1, help="Most words of a sentence.")] = 1000,
    as_json: AsJson = False,
) -> None:
    """Select the sentences of a text that cover the most triphones."""
    from corpus_tools.cli import corpus_printing
    from corpus_tools.conversion.select_sentences import select_sentences as run

    if shortest > longest:
        raise typer.BadParameter("is more than --longest", param_hint="--shortest")
    with display.show_progress() as progress:
        report = run(
            text,
            count=count,
            out=out,
            dictionary=dictionary,
            phone_set=phone_set,
            stress=stress,
            words=(shortest, longest),
            progress=progress,
        )
    corpus_printing.print_selection(report, as_json=as_json)


def _simulate(
    out: Annotated[Path, Argument(metavar="OUT", help="A new folder.")],
    utterances: Annotated[int, Option(min=1, help="How many sentences.")] = 287,
    seed: Annotated[int, Option(min=0, help="The same seed gives the same files.")] = 0,
    lang: Annotated[str | None, Option(help="The language: sv (the default), cs or en.")] = None,
    durations: Annotated[
        str | None,
        Option(help="Phone times and sound: model (the default), or espeak (espeak-ng)."),
    ] = None,
    layout: Annotated[
        str, Option(help="The marker layout: a shipped name, or a TOML file.")
    ] = "face30-head5",
    duration: Annotated[
        float | None,
        Option(min=0.1, help="No sentences: free gestures in recordings of this length (s)."),
    ] = None,
    rate: Annotated[float, Option(min=1, help="Frames per second (Hz).")] = 60.0,
    noise: Annotated[float, Option(min=0, help="Noise of a coordinate (mm).")] = 0.3,
    drop_outs: Annotated[
        float, Option(min=0, max=0.8, help="Share of the samples that are lost.")
    ] = 0.05,
    head_shift: Annotated[float, Option(min=0, help="Largest head shift (mm).")] = 30.0,
    head_turn: Annotated[float, Option(min=0, max=80, help="Largest head turn (degrees).")] = 20.0,
    other_speaker: Annotated[
        bool, Option("--other-speaker", help="A head of another size and other proportions.")
    ] = False,
    drift: Annotated[
        float,
        Option(
            min=-1000,
            max=1000,
            help="How much faster the frames are than the files say, on the sound's clock "
            "(parts per million).",
        ),
    ] = 20.0,
) -> None:
    """Make a corpus with known truth: recordings, labels, sound, and a manifest to convert it."""
    if duration is not None and (lang is not None or durations is not None):
        raise typer.BadParameter(
            "goes without --lang and --durations: free gestures say nothing",
            param_hint="--duration",
        )
    from corpus_tools import simulation

    spoken = simulation.Spoken(
        arguments.check_choice(lang or "sv", simulation.list_languages(), "--lang"),
        arguments.check_choice(durations or "model", simulation.DURATIONS, "--durations"),
        drift,
    )
    conditions = simulation.Conditions(
        noise=noise,
        drop_outs=drop_outs,
        head_translation=head_shift,
        head_rotation=math.radians(head_turn),
        rate=rate,
        **({} if duration is None else {"duration": duration}),
    )
    with display.show_progress() as progress:
        simulation.simulate(
            out,
            utterances=utterances,
            seed=seed,
            layout=layout,
            conditions=conditions,
            head=simulation.OTHER_SPEAKER if other_speaker else None,
            spoken=spoken if duration is None else None,
            progress=progress,
        )


COMMANDS = {
    "simulate": _simulate,
    "fit": _fit,
    "convert": _convert,
    "align": _align,
    "select-sentences": _select_sentences,
}
"""Functions by the names of their commands."""
