"""``mocap-fit demo``: the whole path on recordings that it makes itself, up to a talking head."""

from __future__ import annotations

import shutil
import warnings
from pathlib import Path
from typing import Any

from corpus_tools import simulation as simulate
from corpus_tools.cli import console
from corpus_tools.cli.console import Status
from corpus_tools.demo.fitting import (
    CONDITIONS,
    EXPLAINED,
    SESSIONS,
    FitPart,
    fit_part,
    head_table,
    parameter_table,
    show,
)
from corpus_tools.demo.talking import EPOCHS, MOVIE, SENTENCES, TalkPart, talk_part
from corpus_tools.training import evaluate as scoring
from corpus_tools.training import page
from mocap_fit.atomic_file import make_folder, write_text
from mocap_fit.errors import ConfigurationError, MissingExtraError, MocapFitWarning

__all__ = ["CONDITIONS", "MOVIE", "run"]

_README, _PAGE = "README.txt", "index.html"
_FIRST_LINE = "Made by `mocap-fit demo`, and replaced when it runs again into this folder."
_TEXT = f"""{_FIRST_LINE}

{_PAGE}    everything on one page: open it first
{MOVIE}    a sentence, by the measured tracks, the best model and the rules
same_head/    recordings of the built-in head itself: recordings/ and reference.tsv as a Qualisys
              system would export them, truth/ what made them, fit/ what was found
other_head/   the same for a speaker whose head has another size and other proportions
figures/      pictures of both
sentences/    simulated sentences: recordings, labels, sound with sync pulses, truth, manifest.toml
corpus/       what `mocap-fit convert` made of them
models/       control models trained on the corpus
evaluation/   how good the models are on sentences that they have not seen
report.json   all figures, for programs
"""
_FOLDERS = ("figures", *SESSIONS, "sentences", "corpus", "models", "evaluation")
_OURS = (_README, _PAGE, MOVIE, "report.json", *_FOLDERS)


def run(
    out: Path,
    *,
    seed: int = 0,
    conditions: simulate.Conditions = CONDITIONS,
    sentences: int = SENTENCES,
    epochs: int = EPOCHS,
    as_json: bool = False,
) -> Status:
    """Run the whole path: simulate, fit, convert, train, score, draw, talk.

    Parameters
    ----------
    out
        A new or empty folder, or that of a former demo, which is replaced.
    seed
        The same seed gives the same numbers.
    conditions
        What the simulated sessions are like.
    sentences
        How many are simulated for the control models.
    epochs
        How long the networks learn, at most.
    as_json
        Print the report as JSON on stdout.

    Raises
    ------
    ConfigurationError
        If the folder holds something else.
    """
    _make_room(out)
    # What is missing is said before the long work begins.
    can_draw, can_film = _abilities()
    fits = fit_part(out, seed, conditions, can_draw=can_draw)
    if not as_json:
        show(fits, conditions)
    talk = talk_part(
        out,
        seed,
        conditions,
        sentences=sentences,
        epochs=epochs,
        can_film=can_draw and can_film,
        as_json=as_json,
    )
    report = {"seed": seed, **fits.report, "control_models": talk.report}
    write_text(out / "report.json", console.json_text(report) + "\n")
    title = "mocap-fit: from markers to a talking head"
    write_text(out / _PAGE, page.page(title, _sections(fits, talk, out)))
    if as_json:
        files = {"figures": fits.pictures, "report": out / "report.json", "page": out / _PAGE}
        console.print_json({**report, **files})
    else:
        _show(fits, talk, out)
    return Status.DONE


def _make_room(out: Path) -> None:
    """Take away what a former demo left; a folder of anything else is refused."""
    make_folder(out)
    if any(out.iterdir()):
        notice = out / _README
        if not notice.is_file() or not notice.read_bytes().startswith(_FIRST_LINE.encode()):
            raise ConfigurationError(
                "the folder is not empty, and what is in it is not a former demo",
                path=str(out),
                advice="Give a new folder with --out.",
            )
        for name in _OURS:
            old = out / name
            if old.is_dir() and not old.is_symlink():
                shutil.rmtree(old)
            elif name != _README:
                old.unlink(missing_ok=True)
    make_folder(out / "figures")
    # First of all, so that a demo that was stopped can be replaced too.
    write_text(out / _README, _TEXT)


def _abilities() -> tuple[bool, bool]:
    """Whether faces can be drawn and movies written here; a warning says what is missing."""
    from mocap_fit.render import require_off_screen
    from mocap_fit.render.movie_file import find_ffmpeg

    able = []
    for what, check in (("faces", require_off_screen), ("the movie", find_ffmpeg)):
        try:
            check()
        except MissingExtraError as error:
            warnings.warn(
                f"{error} The demo goes on without the picture of {what}.",
                MocapFitWarning,
                stacklevel=2,
            )
            able.append(False)
        else:
            able.append(True)
    return able[0], able[1]


def _sections(fits: FitPart, talk: TalkPart, out: Path) -> list[str]:
    """What the page shows."""
    own, other = fits.errors["same_head"], fits.errors["other_head"]
    parts = []
    if talk.movie is not None:
        parts.append(page.picture(talk.movie, f"“{talk.text}”: {', '.join(talk.heads)}."))
    counts = {split: len(talk.corpus.get_split(split)) for split in talk.corpus.splits}
    parts += [
        page.paragraph(
            f"A simulated speaker says {len(talk.corpus)} Swedish sentences with 35 markers on. "
            "The head's motion is taken out, the parameters of a face model are fitted frame by "
            "frame, control models learn them from the phones, and a head talks."
        ),
        page.heading("The fit, beside its truth"),
        page.table(*parameter_table(own["squares"], own["distances"], other["distances"])),
        page.paragraph(EXPLAINED),
        page.table(*head_table(own["distances"], other["distances"])),
        *(page.picture(path) for path in fits.pictures),
        page.heading("Control models"),
        page.paragraph(
            f"Trained on {counts.get('train', 0)} sentences and scored on "
            f"{counts.get('test', 0)} others; the networks stop after at most "
            f"{talk.report['network_epochs_at_most']} epochs. So few sentences show that the path "
            "works, not which model is best: the README has that for 287."
        ),
        *scoring.sections(
            talk.result, out / "evaluation", ("scores", "parameters", "trajectories")
        ),
    ]
    return parts


def _show(fits: FitPart, talk: TalkPart, out: Path) -> None:
    screen = console.screen()
    screen.print(
        f"\nControl models on {talk.result.utterances} sentences that they have not seen (the "
        f"networks stop after at most {talk.report['network_epochs_at_most']} epochs):\n"
    )
    screen.print(console.table(*scoring.short_table(talk.result)), "")
    written: list[Any] = [out / _PAGE]
    if talk.movie is not None:
        written.append(talk.movie)
    screen.print("Written:")
    for path in (*written, *fits.pictures, out / "report.json"):
        screen.print(f"  {path}", soft_wrap=True)
    for folder in _FOLDERS[1:]:
        screen.print(f"  {out / folder}", soft_wrap=True)
