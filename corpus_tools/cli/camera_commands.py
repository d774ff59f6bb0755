"""The commands of cameras; `app` puts them on the command line."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from corpus_tools.cli import display
from corpus_tools.cli.arguments import Argument, AsJson, Option

_TERMS = ("k1", "k2", "p1", "p2", "k3")


def _calibrate(
    videos: Annotated[
        list[Path],
        Argument(
            metavar="VIDEO",
            help="One a camera, of a board that is moved before them; all begin at one time.",
        ),
    ],
    board: Annotated[
        str,
        Option(
            metavar="FILE|SPEC",
            help="charuco:4x5:54mm:DICT_4X4_1000 (squares, and :inverted where black is white), "
            "aruco:…, chessboard:10x7:25mm, circles:4x11:20mm:asymmetric; or a charuco.toml.",
        ),
    ],
    out: Annotated[Path, Option(help="Where the cameras are written.")] = Path("cameras.toml"),
    terms: Annotated[
        str, Option(metavar="K1,K2,…", help="Distortion: of k1, k2, p1, p2, k3; none for none.")
    ] = "k1,k2",
    intrinsics: Annotated[
        Path | None, Option(metavar="FILE", help="Cameras whose lenses are known already.")
    ] = None,
    pictures: Annotated[int, Option(min=3, help="Looked at in each video, at most.")] = 100,
    as_json: AsJson = False,
) -> None:
    """Calibrate one camera or many from videos of a board."""
    chosen = () if terms == "none" else tuple(term.strip() for term in terms.lower().split(","))
    if not set(chosen) <= set(_TERMS):
        raise typer.BadParameter(f"choose from {', '.join(_TERMS)}", param_hint="--terms")
    from corpus_tools.cameras.calibrate import calibrate as run

    with display.show_progress() as progress:
        result = run(
            videos,
            board,
            out=out,
            distortion_terms=chosen,
            intrinsics=intrinsics,
            pictures=pictures,
            progress=progress,
        )
    display.print_report(
        result,
        lambda report: display.print_lines(*repr(report).split("\n"), f"Written: {out}"),
        as_json=as_json,
    )


COMMANDS = {"calibrate": _calibrate}
"""Functions by the names of their commands."""
