"""The commands that train and score control models; `cli` puts them on the command line."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from corpus_tools.arguments import AsJson, one_of

_Corpus = Annotated[
    Path, typer.Argument(metavar="CORPUS", help="A corpus's folder.", readable=False)
]


def train(
    corpus: _Corpus,
    model: Annotated[str, typer.Option(help="The control model, such as cohen-massaro.")],
    out: Annotated[Path, typer.Option(help="The file of the trained model.", readable=False)],
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
    as_json: AsJson = False,
) -> None:
    """Train a control model on the training part of a corpus."""
    from corpus_tools import train as command

    raise typer.Exit(
        command.run(
            corpus,
            model=model,
            out=out,
            protocol=one_of(protocol, command.PROTOCOLS, "--protocol"),  # type: ignore[arg-type]
            validation=validation,
            seed=seed,
            settings=settings or (),
            as_json=as_json,
        )
    )


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
    resamples: Annotated[int, typer.Option(min=100, help="Of the bootstrap.")] = 2000,
    seed: Annotated[int, typer.Option(min=0, help="Of the bootstrap.")] = 0,
    as_json: AsJson = False,
) -> None:
    """Score trained control models on held-out utterances; tables, figures, one page."""
    from corpus_tools import evaluate as command

    raise typer.Exit(
        command.run(
            corpus,
            models,
            out=out,
            split=split,
            face=face,
            utterance=utterance,
            parameter=parameter,
            resamples=resamples,
            seed=seed,
            as_json=as_json,
        )
    )
