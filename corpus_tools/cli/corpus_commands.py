"""The commands that make a corpus of recordings; `cli` puts them on the command line."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from corpus_tools.cli.arguments import AsJson


def convert(
    manifest: Annotated[
        Path,
        typer.Argument(
            metavar="MANIFEST",
            help="A TOML file; or a folder with manifest.toml, or with recordings/ labels/ "
            "sound/ and reference.*.",
            readable=False,
        ),
    ],
    out: Annotated[
        Path, typer.Option(help="The corpus: a new folder, or a former corpus.", readable=False)
    ],
    root: Annotated[
        Path | None,
        typer.Option(
            help="What the manifest's paths are under, where it is not the manifest's folder.",
            readable=False,
        ),
    ] = None,
    phone_set: Annotated[
        str | None, typer.Option(help="In place of the manifest's; needed without one.")
    ] = None,
    layout: Annotated[str | None, typer.Option(help="In place of the manifest's.")] = None,
    jobs: Annotated[int, typer.Option(min=0, help="How many processes; 0: one a core.")] = 1,
    dask: Annotated[
        str | None,
        typer.Option(metavar="ADDRESS", help="Convert on a dask cluster: tcp://HOST:PORT."),
    ] = None,
    fresh: Annotated[
        bool, typer.Option("--fresh", help="Convert also what a former run has converted.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Convert recordings, labels and sound to a corpus.

    Bad utterances are named and left out. What a former run converted from the same files in the
    same way is kept, so that a run that was stopped goes on where it was.
    """
    from mocap_fit.processes import limit_threads

    if dask is not None and jobs != 1:
        raise typer.BadParameter(
            "goes without --jobs: the cluster has its own", param_hint="--dask"
        )
    limit_threads()
    from corpus_tools.conversion import convert as command

    raise typer.Exit(
        command.run(
            manifest,
            root=root,
            out=out,
            phone_set=phone_set,
            layout=layout,
            jobs=jobs,
            cluster=dask,
            fresh=fresh,
            as_json=as_json,
        )
    )


def align(
    wavs: Annotated[
        list[Path], typer.Argument(metavar="WAV", help="Sounds of speech.", readable=False)
    ],
    out: Annotated[Path, typer.Option(help="The folder for OUT/NAME.TextGrid.", readable=False)],
    text: Annotated[
        Path | None,
        typer.Option(
            help="What is said: the text of one sound, a table NAME<tab>TEXT, or a folder with "
            "NAME.txt; those beside the sounds where not given.",
            readable=False,
        ),
    ] = None,
    dictionary: Annotated[
        Path | None,
        typer.Option(help="A pronouncing dictionary in CMU's format.", readable=False),
    ] = None,
    acoustic_model: Annotated[
        Path | None,
        typer.Option(help="The folder of a model of pocketsphinx.", readable=False),
    ] = None,
    phone_set: Annotated[
        str | None, typer.Option(help="What the model's phones are read as.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Find when the phones of a known text are heard: a TextGrid for each sound."""
    from corpus_tools.conversion import align as command

    raise typer.Exit(
        command.report(
            command.run(
                wavs,
                text,
                out,
                dictionary=dictionary,
                acoustic_model=acoustic_model,
                phone_set=phone_set,
            ),
            out,
            as_json=as_json,
        )
    )


def select_sentences(
    text: Annotated[
        Path,
        typer.Argument(
            metavar="TEXT",
            help="A sentence a line (with --dictionary), or SENTENCE<tab>PHONES.",
            readable=False,
        ),
    ],
    count: Annotated[int, typer.Option(min=1, help="How many sentences.")] = 287,
    out: Annotated[
        Path, typer.Option(help="The folder for sentences and coverage.", readable=False)
    ] = Path("sentences"),
    dictionary: Annotated[
        Path | None,
        typer.Option(help="A pronouncing dictionary in CMU's format.", readable=False),
    ] = None,
    phone_set: Annotated[
        str | None, typer.Option(help="Symbols that it does not have are an error.")
    ] = None,
    stress: Annotated[
        bool, typer.Option("--stress", help="A stressed vowel is another phone.")
    ] = False,
    shortest: Annotated[int, typer.Option(min=1, help="Fewest words of a sentence.")] = 1,
    longest: Annotated[int, typer.Option(min=1, help="Most words of a sentence.")] = 1000,
    as_json: AsJson = False,
) -> None:
    """Select the sentences of a text that cover the most triphones."""
    from corpus_tools.conversion import select_sentences as command

    if shortest > longest:
        raise typer.BadParameter("is more than --longest", param_hint="--shortest")
    raise typer.Exit(
        command.run(
            text,
            count=count,
            out=out,
            dictionary=dictionary,
            phone_set=phone_set,
            stress=stress,
            words=(shortest, longest),
            as_json=as_json,
        )
    )
