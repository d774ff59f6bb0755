"""The commands that show and check data, and the demo; `app` puts them on the command line."""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer

from corpus_tools.cli import arguments, console, display
from corpus_tools.cli.arguments import Argument, AsJson, Option
from corpus_tools.cli.console import Status


class View(StrEnum):
    """From where the head is seen."""

    FRONT = "front"
    THREE_QUARTER = "three-quarter"
    SIDE = "side"
    TOP = "top"


def _demo(
    out: Annotated[
        Path, Option(help="A new folder, or that of a former demo, which is replaced.")
    ] = Path("mocap-fit-demo"),
    seed: Annotated[int, Option(min=0, help="The same seed gives the same numbers.")] = 0,
    as_json: AsJson = False,
) -> None:
    """Run the whole path on recordings that it makes itself: fit, train, score, talk."""
    from corpus_tools.cli import demo_printing
    from corpus_tools.demonstration.demo import demo as run

    with display.show_progress() as progress:
        report = run(out, seed=seed, progress=progress)
    display.print_report(report, demo_printing.print_demo, as_json=as_json)


def _info(
    files: Annotated[
        list[Path] | None,
        Argument(
            metavar="FILE",
            help="Recordings, labels, sound, models, corpora, layouts, phone sets, manifests; "
            "folders of such files; names of what is shipped. Without: all that is shipped.",
        ),
    ] = None,
    tree: Annotated[
        str | None, Option(metavar="PHONE/PARAMETER", help="Show a tree of a CART model.")
    ] = None,
    svg: Annotated[Path | None, Option(help="Draw the tree into this file (SVG).")] = None,
    explain: Annotated[
        Path | None,
        Option(
            metavar="PHONES",
            help="Labels, or phones of a corpus: what decided their targets in a CART model.",
        ),
    ] = None,
    questions: Annotated[
        bool, Option("--questions", help="How much each question of a CART model matters.")
    ] = False,
    rename: arguments.Rename = None,
    rate: arguments.Rate = None,
    unit: arguments.Unit = None,
    subject: arguments.Subject = None,
    as_json: AsJson = False,
) -> None:
    """Show what files and folders hold, what is shipped, and the trees of models."""
    reading = arguments.parse_reading(rate, unit, subject, rename)
    if tree is not None or svg is not None or explain is not None or questions:
        if files is None or len(files) != 1:
            raise typer.BadParameter("give one model", param_hint="FILE")
        from corpus_tools.cli.contents_printing import print_model

        print_model(files[0], tree=tree, svg=svg, explain=explain, as_json=as_json)
        return
    from corpus_tools.cli.contents_printing import print_contents
    from corpus_tools.cli.corpus_printing import CausePrinter
    from corpus_tools.inspection.info import info as run

    faults: dict[str, Exception] = {}

    def show(content: Mapping[str, Any], error: Exception | None) -> None:
        console.stop_if_interrupted()
        if error is not None:
            faults[content["file"]] = error
        elif not as_json:
            print_contents(content)

    report = run(files or (), **reading, progress=show)
    if as_json:
        display.print_json(report.contents)
    # Last, where they are not scrolled away.
    causes = CausePrinter()
    for file, error in faults.items():
        causes.show_error(file, error)
    causes.finish()
    raise typer.Exit(Status.BAD_DATA if report.errors else Status.DONE)


def _validate(
    paths: Annotated[
        list[Path] | None,
        Argument(
            metavar="PATH",
            help="Corpora, folders, recordings, labels, sound; files of one name belong together.",
        ),
    ] = None,
    thresholds: Annotated[
        Path | None, Option(help="A TOML file that changes what counts as wrong.")
    ] = None,
    html: Annotated[Path | None, Option(help="A page with the report and pictures.")] = None,
    layout: Annotated[
        str | None, Option(help="The marker layout: a shipped name, or a TOML file.")
    ] = None,
    phone_set: Annotated[
        str | None, Option(help="The phone set: a shipped name, or a TOML file.")
    ] = None,
    edits: arguments.Edits = None,
    reference: Annotated[
        list[str] | None,
        Option(
            metavar="FILE[@START-END]",
            help="A reference pose, or a span of a take (seconds); those of a folder are known.",
        ),
    ] = None,
    rename: arguments.Rename = None,
    rate: arguments.Rate = None,
    unit: arguments.Unit = None,
    subject: arguments.Subject = None,
    jobs: arguments.Jobs = 1,
    load_codes: Annotated[
        bool, Option("--codes", help="List all that can be found, and end.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Check recordings, labels, sound and corpora; name what is wrong, where, and what to do.

    Exit status 1 if anything is an error; warnings and notes alone leave it at 0.
    """
    from corpus_tools.cli import validation_printing

    reading = arguments.parse_reading(rate, unit, subject, rename)
    if load_codes:
        validation_printing.print_codes(as_json=as_json)
        return
    if not paths and not reference:
        raise typer.BadParameter("give a corpus, a folder or a file", param_hint="PATH")
    from corpus_tools.validation.validate import validate as run

    with display.show_progress() as progress:
        report = run(
            paths or (),
            thresholds=thresholds,
            layout=layout,
            phone_set=phone_set,
            edits=edits,
            reference=reference or (),
            page=html,
            **reading,
            jobs=jobs,
            progress=progress,
        )
    if as_json:
        display.print_json(report.to_record())
    else:
        validation_printing.print_report(report)
    raise typer.Exit(Status.DONE if report.is_clean else Status.BAD_DATA)


def _inspect(
    path: Annotated[
        str,
        Argument(
            metavar="PATH",
            help="A recording, a fit, a corpus, CORPUS#ID, a model, or a layout.",
        ),
    ],
    other: Annotated[
        str | None,
        Argument(metavar="PATH", help="What it is compared with: another, or a model."),
    ] = None,
    html: Annotated[
        Path | None, Option(help="A web page in one file, in place of the window.")
    ] = None,
    between: Annotated[
        str | None, Option(metavar="START-END", help="Seconds: the part that is on the page.")
    ] = None,
    model: Annotated[
        list[str] | None,
        Option(metavar="FILE|NAME", help="A control model, shown beside; repeatable."),
    ] = None,
    screenshot: Annotated[
        Path | None, Option(help="A PNG file of the window, in its place.")
    ] = None,
    movie: Annotated[
        Path | None, Option(help="A movie of the window (.mp4, .gif), in its place.")
    ] = None,
    at: Annotated[
        float | None, Option(metavar="SECONDS", help="Time that is shown; the middle by default.")
    ] = None,
    view: Annotated[View, Option(help="From where the head is seen.")] = View.FRONT,
    size: Annotated[str, Option(metavar="WIDTHxHEIGHT", help="Size in pixels.")] = "1280x800",
    names: Annotated[bool, Option("--names", help="Show the names of all markers.")] = False,
    tab: Annotated[
        str | None,
        Option(help="findings, utterances, parameters, markers, edits or keys."),
    ] = None,
    suggest_reference: Annotated[
        bool,
        Option("--suggest-reference", help="Find the stillest part with closed lips, and end."),
    ] = False,
    reference: Annotated[
        Path | None, Option(help="The reference pose; rest.* or reference.* beside the recording.")
    ] = None,
    layout: Annotated[
        str | None, Option(help="The marker layout; by default the one that has these names.")
    ] = None,
    face: Annotated[str | None, Option(help="The face: built-in, or a rig file.")] = None,
    recording: Annotated[Path | None, Option(help="The recording that a fit is of.")] = None,
    labels: Annotated[Path | None, Option(help="Labels; those of the same name.")] = None,
    sound: Annotated[Path | None, Option(help="Sound; that of the same name.")] = None,
    phone_set: Annotated[
        str | None, Option(help="The phone set: a shipped name, or a TOML file.")
    ] = None,
    edits: arguments.Edits = None,
    utterance: Annotated[
        str | None, Option(metavar="ID", help="An utterance of a corpus; the first by default.")
    ] = None,
    rename: arguments.Rename = None,
    rate: arguments.Rate = None,
    unit: arguments.Unit = None,
    subject: arguments.Subject = None,
) -> None:
    """Look at a recording, a fit, a corpus, a model or a layout; compare two; mend a recording."""
    reading = arguments.parse_reading(rate, unit, subject, rename)
    pixels = arguments.parse_size(size)
    from corpus_tools.inspection.inspect import inspect as run

    with display.show_progress() as progress:
        result = run(
            path,
            other,
            html=html,
            between=arguments.parse_between(between),
            models=model or (),
            screenshot=screenshot,
            movie=movie,
            at=at,
            view=view.value,
            size=pixels,
            names=names,
            tab=tab,
            suggest_reference=suggest_reference,
            reference=reference,
            layout=layout,
            face=face,
            recording=recording,
            labels=labels,
            sound=sound,
            phone_set=phone_set,
            edits=edits,
            utterance=utterance,
            **reading,
            progress=progress,
        )
    if result.suggestion is not None:
        span = result.suggestion
        display.print_lines(
            f"--reference {path}@{span.start:.3f}-{span.end:.3f}",
            f"frames lie within {span.residual:.2f} mm of each other, head motion removed",
        )
    if result.files:
        display.print_lines(*(f"written: {file}" for file in result.files))


COMMANDS = {"demo": _demo, "info": _info, "inspect": _inspect, "validate": _validate}
"""Functions by the names of their commands."""
