"""``mocap-fit demo``: the whole path on recordings that it makes itself, up to a talking head."""

from __future__ import annotations

import os
import shutil
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from corpus_tools import html_page
from corpus_tools.demonstration.fitting import (
    CONDITIONS,
    EXPLAINED,
    SESSIONS,
    FitPart,
    run_fits,
    to_head_table,
    to_parameter_table,
)
from corpus_tools.demonstration.talking import EPOCHS, MOVIE, SENTENCES, TalkPart, run_talk
from corpus_tools.html_page import format_heading, format_paragraph, format_picture, format_table
from corpus_tools.json_file import write_json
from corpus_tools.simulation import Conditions
from corpus_tools.tasks import TaskProgress
from corpus_tools.training.evaluate import format_sections
from mocap_fit.atomic_file import make_folder, write_text
from mocap_fit.errors import ConfigurationError, MissingExtraError, MocapFitWarning
from mocap_fit.processes import limit_to_one_thread

_README, _PAGE, _REPORT = "README.txt", "index.html", "report.json"
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
{_REPORT}   all figures, for programs
"""
_FOLDERS = ("figures", *SESSIONS, "sentences", "corpus", "models", "evaluation")
_OURS = (_README, _PAGE, MOVIE, _REPORT, *_FOLDERS)


@dataclass(frozen=True, eq=False)
class DemoReport:
    """What a run of `demo` has done.

    Parameters
    ----------
    out
        The folder.
    seed
        The seed.
    conditions
        Properties of the simulated sessions.
    fits
        The first part: recordings that were fitted, and their errors.
    talk
        The second part: control models and a talking head.
    """

    out: Path
    seed: int
    conditions: Conditions
    fits: FitPart
    talk: TalkPart

    @property
    def page(self) -> Path:
        """The page that shows everything."""
        return self.out / _PAGE

    @property
    def files(self) -> list[Path]:
        """The page, the movie if there is one, figures and folders."""
        movie = [] if self.talk.movie is None else [self.talk.movie]
        folders = [self.out / name for name in _FOLDERS[1:]]
        return [self.page, *movie, *self.fits.pictures, self.out / _REPORT, *folders]

    def to_dict(self) -> dict[str, Any]:
        """Return everything as JSON can hold it.

        Returns
        -------
        dict[str, Any]
            All figures and the files.
        """
        files = {"figures": self.fits.pictures, "report": self.out / _REPORT, "page": self.page}
        return {**self.figures, **files}

    @property
    def figures(self) -> dict[str, Any]:
        """All figures, as ``report.json`` has them."""
        return {"seed": self.seed, **self.fits.report, "control_models": self.talk.report}

    def __repr__(self) -> str:
        return f"DemoReport({self.talk.result.utterances} test sentences, page={self.page})"


@limit_to_one_thread()
def demo(
    out: str | os.PathLike[str] = "mocap-fit-demo",
    *,
    seed: int = 0,
    conditions: Conditions = CONDITIONS,
    sentences: int = SENTENCES,
    epochs: int = EPOCHS,
    progress: TaskProgress | None = None,
) -> DemoReport:
    """Run the complete path: simulate, fit, convert, train, score, draw, talk.

    Parameters
    ----------
    out
        A new or empty folder, or that of an earlier demo, which is replaced.
    seed
        Seed of all random numbers.
    conditions
        Properties of the simulated sessions.
    sentences
        Number of sentences that are simulated for the control models.
    epochs
        Largest number of epochs of the networks.
    progress
        Called with a task, the number of its steps done, and of all.

    Returns
    -------
    DemoReport
        Errors, scores and files.

    Raises
    ------
    ConfigurationError
        If the folder holds something else.
    """
    folder = Path(out)
    _clear_folder(folder)
    # What is missing is reported before the long work begins.
    can_draw, can_film = _check_abilities()
    fits = run_fits(folder, seed, conditions, can_draw=can_draw, progress=progress)
    talk = run_talk(
        folder,
        seed,
        conditions,
        sentences=sentences,
        epochs=epochs,
        can_film=can_draw and can_film,
        progress=progress,
    )
    report = DemoReport(folder, seed, conditions, fits, talk)
    write_json(folder / _REPORT, report.figures)
    title = "mocap-fit: from markers to a talking head"
    write_text(report.page, html_page.format_page(title, _format_sections(report)))
    return report


def _clear_folder(out: Path) -> None:
    """Remove what an earlier demo has left, or refuse a folder of anything else."""
    make_folder(out)
    if any(out.iterdir()):
        notice = out / _README
        if not notice.is_file() or not notice.read_bytes().startswith(_FIRST_LINE.encode()):
            raise ConfigurationError(
                "the folder is not empty, and what is in it is not an earlier demo",
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
    # First, so that a demo that was stopped can be replaced too.
    write_text(out / _README, _TEXT)


def _check_abilities() -> tuple[bool, bool]:
    """Return whether faces can be drawn and movies written here; warn about what is missing."""
    from mocap_fit.render import require_off_screen
    from mocap_fit.render.movie_file import find_ffmpeg

    missing = set()
    for what, check in (("faces", require_off_screen), ("the movie", find_ffmpeg)):
        try:
            check()
        except MissingExtraError as error:
            message = f"{error} The demo goes on without the picture of {what}."
            warnings.warn(message, MocapFitWarning, stacklevel=2)
            missing.add(what)
    return "faces" not in missing, "the movie" not in missing


def _format_sections(report: DemoReport) -> list[str]:
    """Return what the page shows."""
    fits, talk, out = report.fits, report.talk, report.out
    same, other = fits.errors["same_head"], fits.errors["other_head"]
    caption = f"“{talk.text}”: {', '.join(talk.heads)}."
    movie = [] if talk.movie is None else [format_picture(talk.movie, caption)]
    counts = {split: len(talk.corpus.get_split(split)) for split in talk.corpus.splits}
    table = to_parameter_table(same["squares"], same["distances"], other["distances"])
    return [
        *movie,
        format_paragraph(
            f"A simulated speaker says {len(talk.corpus)} Swedish sentences with 35 markers on. "
            "The head's motion is taken out, the parameters of a face model are fitted frame by "
            "frame, control models learn them from the phones, and a head talks."
        ),
        format_heading("The fit and the truth"),
        format_table(*table),
        format_paragraph(EXPLAINED),
        format_table(*to_head_table(same["distances"], other["distances"])),
        *(format_picture(path) for path in fits.pictures),
        format_heading("Control models"),
        format_paragraph(
            f"Trained on {counts.get('train', 0)} sentences and scored on "
            f"{counts.get('test', 0)} others; the networks stop after at most "
            f"{talk.report['network_epochs_at_most']} epochs. So few sentences show that the path "
            "works, not which model is best: the README has that for 287."
        ),
        *format_sections(talk.result, out / "evaluation", ("scores", "parameters", "trajectories")),
    ]
