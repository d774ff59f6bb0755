"""The commands that train and score control models; `cli` puts them on the command line."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from corpus_tools.cli.arguments import AsJson, one_of

_Corpus = Annotated[
    Path, typer.Argument(metavar="CORPUS", help="A corpus's folder.", readable=False)
]


def train(
    corpus: _Corpus,
    out: Annotated[
        Path,
        typer.Option(help="The file of the trained model; a sweep's folder.", readable=False),
    ],
    model: Annotated[
        str | None, typer.Option(help="The control model, such as cohen-massaro.")
    ] = None,
    protocol: Annotated[
        str,
        typer.Option(
            help="What tells when to stop: clean (a part of the training sentences) or paper "
            "(the test set, as in the paper)."
        ),
    ] = "clean",
    validation: Annotated[
        float, typer.Option(min=0.01, max=0.9, help="The part that is held out (clean).")
    ] = 0.1,
    seed: Annotated[int, typer.Option(min=0, help="Of the draw of what is held out.")] = 0,
    settings: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="KEY=VALUE", help="A setting of the model; repeatable."),
    ] = None,
    sweep: Annotated[
        bool,
        typer.Option(
            "--sweep-look-ahead",
            help="16 networks that see 0 to 15 frames ahead, and their errors.",
        ),
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Train a control model on the training part of a corpus."""
    from corpus_tools.training import train as command

    if sweep == (model is not None):
        raise typer.BadParameter("give --model or --sweep-look-ahead", param_hint="--model")
    options: dict[str, Any] = {
        "out": out,
        "protocol": one_of(protocol, command.PROTOCOLS, "--protocol"),
        "validation": validation,
        "seed": seed,
        "settings": settings or (),
        "as_json": as_json,
    }
    if model is None:
        raise typer.Exit(command.sweep(corpus, **options))
    raise typer.Exit(command.run(corpus, model=model, **options))


def evaluate(
    corpus: _Corpus,
    models: Annotated[
        list[Path], typer.Argument(metavar="MODEL", help="Trained models.", readable=False)
    ],
    out: Annotated[Path, typer.Option(help="The folder for tables and figures.", readable=False)],
    split: Annotated[str, typer.Option(help="What is scored; all: every utterance.")] = "test",
    face: Annotated[str, typer.Option(help="For the closure of the lips.")] = "built-in",
    utterance: Annotated[
        str | None, typer.Option(help="The utterance whose trajectories are drawn.")
    ] = None,
    parameter: Annotated[str | None, typer.Option(help="The parameter that is drawn.")] = None,
    landmarks: Annotated[
        bool,
        typer.Option("--landmarks", help="Compare predicted faces with the markers as well."),
    ] = False,
    resamples: Annotated[int, typer.Option(min=100, help="Of the bootstrap.")] = 2000,
    seed: Annotated[int, typer.Option(min=0, help="Of the bootstrap.")] = 0,
    as_json: AsJson = False,
) -> None:
    """Score trained control models on held-out utterances; tables, figures, one page."""
    from corpus_tools.training import evaluate as command

    raise typer.Exit(
        command.run(
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
            as_json=as_json,
        )
    )
