"""The commands that train and score control models; `app` puts them on the command line."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from corpus_tools.cli import arguments, console, display
from corpus_tools.cli.arguments import Argument, AsJson, Option

if TYPE_CHECKING:
    from corpus_tools.training.evaluate import EvaluationReport
    from corpus_tools.training.train import SweepReport, TrainReport
    from mocap_fit.control import ControlModel, LogEntry

_Corpus = Annotated[Path, Argument(metavar="CORPUS", help="A corpus's folder.")]
# Seconds between two lines about a training.
_PAUSE = 5.0


def _train(
    corpus: _Corpus,
    out: Annotated[Path, Option(help="The file of the trained model; a sweep's folder.")],
    model: Annotated[str | None, Option(help="The control model, such as cohen-massaro.")] = None,
    protocol: Annotated[
        str,
        Option(
            help="What decides when to stop: clean (a part of the training sentences) or paper "
            "(the test set, as in the paper)."
        ),
    ] = "clean",
    validation: Annotated[
        float, Option(min=0.01, max=0.9, help="The share that is held out (clean).")
    ] = 0.1,
    seed: Annotated[int, Option(min=0, help="Seed of the draw of what is held out.")] = 0,
    settings: Annotated[
        list[str] | None,
        Option("--set", metavar="KEY=VALUE", help="A setting of the model; repeatable."),
    ] = None,
    sweep: Annotated[
        bool,
        Option(
            "--sweep-look-ahead",
            help="Train 16 networks that see 0 to 15 frames ahead, and compare their errors.",
        ),
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Train a control model on the training part of a corpus."""
    if sweep == (model is not None):
        raise typer.BadParameter("give --model or --sweep-look-ahead", param_hint="--model")
    from corpus_tools.training import train as trainer

    values = arguments.parse_settings(settings or [])
    options: dict[str, Any] = {
        "out": out,
        "protocol": arguments.check_choice(protocol, trainer.PROTOCOLS, "--protocol"),
        "validation": validation,
        "seed": seed,
    }
    if model is None:
        _create_model("ann-low-latency", values)
        show = _show_training("training networks")
        swept = trainer.sweep_look_ahead(corpus, settings=values, progress=show, **options)
        display.print_report(swept, _print_sweep, as_json=as_json)
        return
    untrained = _create_model(model, values)
    show = _show_training(f"training {model}")
    report = trainer.train(corpus, untrained, progress=show, **options)
    display.print_report(report, _print_training, as_json=as_json)


def _create_model(name: str, settings: dict[str, Any]) -> ControlModel:
    """Create a model that is not trained; an impossible setting is a wrong call."""
    from mocap_fit import control
    from mocap_fit.errors import ConfigurationError

    try:
        return control.create(name, **settings)
    except ConfigurationError as error:
        raise typer.BadParameter(str(error), param_hint="--set") from None


def _show_training(task: str) -> Callable[[LogEntry], None]:
    """Return a function that prints the newest errors on stderr every few seconds."""
    from corpus_tools.training.train import format_entry

    last = time.monotonic()

    def show(entry: LogEntry) -> None:
        nonlocal last
        console.stop_if_interrupted()
        if time.monotonic() - last >= _PAUSE:
            last = time.monotonic()
            console.say(format_entry(task, entry))

    return show


def _print_training(report: TrainReport) -> None:
    lines = [
        f"{report.model.title}: {report.model.parameter_count} free parameters, trained on "
        f"{report.utterances} utterances; {report.held_out_utterances} decided when to stop."
    ]
    training, held_out = report.errors["training_error"], report.errors["held_out_error"]
    if training is not None:
        beside = "" if held_out is None else f", {held_out:.4f} on what was held out"
        lines.append(
            f"Root mean square error: {training:.4f} in training{beside} (1 is the full gesture)."
        )
    display.print_lines(*lines, f"Written: {report.file}")


def _print_sweep(report: SweepReport) -> None:
    cells = [
        [
            str(row["frames"]),
            f"{1000 * row['look_ahead']:.0f}",
            f"{row['error']:.4f}",
            str(row["epoch"]),
        ]
        for row in report.look_ahead
    ]
    header = ["frames ahead", "ms", "held-out error", "epoch"]
    display.create_screen().print(display.create_table(header, cells))
    display.print_lines(f"Written: {report.files[0]}, {report.files[1].name}")


def _evaluate(
    corpus: _Corpus,
    models: Annotated[list[Path], Argument(metavar="MODEL", help="Trained models.")],
    out: Annotated[Path, Option(help="The folder for tables and figures.")],
    split: Annotated[str, Option(help="What is scored; all: every utterance.")] = "test",
    face: arguments.Face = "built-in",
    utterance: Annotated[
        str | None, Option(help="The utterance whose trajectories are drawn.")
    ] = None,
    parameter: Annotated[str | None, Option(help="The parameter that is drawn.")] = None,
    landmarks: Annotated[
        bool, Option("--landmarks", help="Compare predicted faces with the markers as well.")
    ] = False,
    resamples: Annotated[int, Option(min=100, help="Samples of the bootstrap.")] = 2000,
    seed: Annotated[int, Option(min=0, help="Seed of the bootstrap.")] = 0,
    as_json: AsJson = False,
) -> None:
    """Score trained control models on held-out utterances; write tables, figures, one page."""
    from corpus_tools.training.evaluate import evaluate as run

    with display.show_progress() as progress:
        report = run(
            corpus,
            models,
            out=out,
            split=split,
            face=face,
            utterance=utterance,
            parameter=parameter,
            landmarks=landmarks,
            resamples=resamples,
            seed=seed,
            progress=progress,
        )
    display.print_report(report, _print_evaluation, as_json=as_json)


def _print_evaluation(report: EvaluationReport) -> None:
    from corpus_tools.training.evaluate import LANDMARKS_EXPLAINED
    from mocap_fit.evaluation import GROUPS

    screen = display.create_screen()
    scores = report.scores
    screen.print(
        f"{scores.utterances} utterances, {scores.frames[0]} frames of speech; all but silence, "
        "average over the parameters, 95 % intervals over utterances:\n"
    )
    screen.print(display.create_table(*scores.to_rows(GROUPS[:1])), "")
    for note in scores.notes:
        screen.print(note, "", sep="\n", markup=False)
    if report.landmarks is not None:
        header, rows = report.landmarks.to_rows()
        table = display.create_table(header, [[scores.mark(row[0]), *row[1:]] for row in rows])
        screen.print(LANDMARKS_EXPLAINED, "", table, "", sep="\n")
    display.print_lines("Written:", *(f"  {path}" for path in report.files))


COMMANDS = {"train": _train, "evaluate": _evaluate}
"""Functions by the names of their commands."""
