"""``mocap-fit demo``: simulated recordings, fitted as any recording is, and beside their truth."""

from __future__ import annotations

import shutil
import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Any

from corpus_tools import console, figures, simulate
from corpus_tools.comparison import Accuracy, FittedRecording, accuracy
from corpus_tools.console import Status
from corpus_tools.fit import Options, Speaker
from mocap_fit.drawing import save_figure
from mocap_fit.errors import ConfigurationError, MissingExtraError, MocapFitWarning
from mocap_fit.fitting.objective import Objective
from mocap_fit.io import read_tracks
from mocap_fit.tracks import ParameterTracks, PoseTracks, read_parquet, write_parquet

if TYPE_CHECKING:
    from rich.table import Table

LAYOUT = "face30-head5"
CONDITIONS = simulate.Conditions(noise=0.3, drop_outs=0.05, rate=60.0, duration=4.0)
# Folder of a session → how many recordings it has, and whose head.
_SESSIONS: dict[str, tuple[int, dict[str, float] | None]] = {
    "same_head": (3, None),
    "other_head": (1, simulate.OTHER_SPEAKER),
}
# The first is the one of `mocap-fit fit`, and the one whose parameters are written and drawn.
_OBJECTIVES: tuple[Objective, ...] = ("distances", "squares")
_FACES = 6

_README = "README.txt"
_FIRST_LINE = "Made by `mocap-fit demo`, and replaced when it runs again into this folder."
_TEXT = f"""{_FIRST_LINE}

same_head/    recordings of the built-in head itself: recordings/ and reference.tsv as a Qualisys
              system would export them, truth/ what made them, fit/ what was found
other_head/   the same for a speaker whose head has another size and other proportions
figures/      pictures of both
report.json   the errors, for programs
"""
_OURS = (_README, "report.json", "figures", *_SESSIONS)


def run(
    out: Path,
    *,
    seed: int = 0,
    conditions: simulate.Conditions = CONDITIONS,
    as_json: bool = False,
) -> Status:
    """Simulate, fit, compare with the truth, and draw.

    Parameters
    ----------
    out
        A new or empty folder, or that of a former demo, which is replaced.
    seed
        The same seed gives the same numbers.
    conditions
        What the simulated sessions are like.
    as_json
        Print the report as JSON on stdout.

    Raises
    ------
    ConfigurationError
        If the folder holds something else.
    """
    _make_room(out)
    # Without a way to draw, we say so before the long work begins.
    can_draw = _can_draw()
    _simulate(out, seed, conditions)
    speakers = {
        session: Speaker.load(out / session / "reference.tsv", LAYOUT, "built-in")
        for session in _SESSIONS
    }
    fits = _fit(out, speakers)
    errors = {
        session: {
            objective: accuracy(
                recordings,
                speakers[session].binding,
                conditions.noise,
                bounded=_SESSIONS[session][1] is None,
            )
            for objective, recordings in by_objective.items()
        }
        for session, by_objective in fits.items()
    }
    report = {
        "seed": seed,
        "layout": LAYOUT,
        "noise_mm": conditions.noise,
        "drop_outs": conditions.drop_outs,
        "unit": "% of a full gesture, which is 1.0 of a parameter",
        "sessions": {
            session: {objective: result.to_dict() for objective, result in results.items()}
            for session, results in errors.items()
        },
    }
    pictures = _draw(
        out / "figures", fits, speakers, errors["same_head"], conditions.noise, can_draw=can_draw
    )
    console.write_text(out / "report.json", console.json_text(report) + "\n")
    if as_json:
        console.print_json({**report, "figures": pictures, "report": out / "report.json"})
    else:
        _show(errors, pictures, out, conditions)
    return Status.DONE


def _make_room(out: Path) -> None:
    """Take away what a former demo left; a folder of anything else is refused."""
    console.make_folder(out)
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
    console.make_folder(out / "figures")
    # First of all, so that a demo that was stopped can be replaced too.
    console.write_text(out / _README, _TEXT)


def _can_draw() -> bool:
    from mocap_fit.render import require_off_screen

    try:
        require_off_screen()
    except MissingExtraError as error:
        warnings.warn(
            f"{error} The demo goes on without the picture of the faces.",
            MocapFitWarning,
            stacklevel=2,
        )
        return False
    return True


def _simulate(out: Path, seed: int, conditions: simulate.Conditions) -> None:
    total = sum(count for count, _ in _SESSIONS.values())
    with console.progress("simulating recordings", total) as advance:
        for i, (session, (count, head)) in enumerate(_SESSIONS.items()):
            simulate.run(
                out / session,
                utterances=count,
                seed=seed + i,
                layout=LAYOUT,
                conditions=conditions,
                head=head,
                progress=lambda _: advance(),
            )


Fits = dict[str, dict[Objective, list[FittedRecording]]]


def _fit(out: Path, speakers: dict[str, Speaker]) -> Fits:
    """Fit every recording with every objective; the first objective's parameters are written."""
    files = {session: sorted((out / session / "recordings").iterdir()) for session in speakers}
    fits: Fits = {session: {objective: [] for objective in _OBJECTIVES} for session in speakers}
    total = sum(map(len, files.values())) * len(_OBJECTIVES)
    with console.progress("fitting recordings", total) as advance:
        for session, speaker in speakers.items():
            folder = out / session
            (folder / "fit").mkdir(exist_ok=True)
            for file in files[session]:
                truth = read_parquet(folder / "truth" / "tracks" / f"{file.stem}.parquet")
                pose = read_parquet(folder / "truth" / "head" / f"{file.stem}.parquet")
                recording = read_tracks(file)
                assert isinstance(truth, ParameterTracks)
                assert isinstance(pose, PoseTracks)
                for objective in _OBJECTIVES:
                    result, motion = speaker.fit(recording, Options(objective))
                    fitted = FittedRecording(recording, result, motion, truth, pose)
                    fits[session][objective].append(fitted)
                    if objective == _OBJECTIVES[0]:
                        write_parquet(result.parameters, folder / "fit" / f"{file.stem}.parquet")
                    advance()
    return fits


def _draw(
    folder: Path,
    fits: Fits,
    speakers: dict[str, Speaker],
    errors: dict[Objective, Accuracy],
    noise: float,
    *,
    can_draw: bool,
) -> list[Path]:
    """Draw all figures; returns their files."""
    shown = fits["same_head"][_OBJECTIVES[0]][0]
    other = fits["other_head"][_OBJECTIVES[0]][0]
    labels = {"squares": "least squares", "distances": "sum of distances"}
    results = {labels[objective]: result for objective, result in errors.items()}
    pictures: dict[str, tuple[Any, ...]] = {
        "tracks.png": (figures.track_figure, shown, "the built-in head"),
        "tracks_other_head.png": (
            figures.track_figure,
            other,
            "a head of other size and proportions",
        ),
        "residuals.png": (figures.residual_figure, shown),
        "accuracy.png": (figures.accuracy_figure, results, noise),
        "head_motion.png": (figures.head_figure, shown),
    }
    if can_draw:
        pictures["faces.png"] = (
            figures.face_figure,
            shown,
            speakers["same_head"].binding,
            figures.varied_frames(shown, _FACES),
        )
    with console.progress("drawing figures", len(pictures)) as advance:
        for name, call in pictures.items():
            save_figure(folder / name, *call)
            advance()
    return [folder / name for name in pictures]


def _show(
    errors: dict[str, dict[Objective, Accuracy]],
    pictures: list[Path],
    out: Path,
    conditions: simulate.Conditions,
) -> None:
    screen = console.screen()
    own, other = errors["same_head"], errors["other_head"]
    squares, distances = own["squares"], own["distances"]
    screen.print(
        f"Simulated: {distances.frames} frames of the built-in head and {other['squares'].frames} "
        f"of another head; 30 face and 5 head markers, noise {conditions.noise:g} mm, "
        f"{conditions.drop_outs:.0%} drop-outs, the head moving."
    )
    screen.print("", _parameter_table(squares, distances, other["distances"]), "", sep="\n")
    screen.print(
        "Errors are root mean squares in % of a full gesture (1.0 of the parameter). Bound: the "
        "Cramér-Rao bound, from the markers that are seen and the head pose they give. r: "
        "correlation of the fit by distances with the truth; other r: the same for the other head."
    )
    screen.print("", _head_table(distances, other["distances"]), "", sep="\n")
    screen.print(
        f"{distances.fitted} of {distances.frames} and {other['distances'].fitted} of "
        f"{other['distances'].frames} frames fitted; the rest show too few head markers.\n"
    )
    screen.print("Written:")
    for path in (*pictures, out / "report.json"):
        screen.print(f"  {path}", soft_wrap=True)
    for session in _SESSIONS:
        screen.print(f"  {out / session}: recordings, truth, fit", soft_wrap=True)


def _parameter_table(squares: Accuracy, distances: Accuracy, other: Accuracy) -> Table:
    from rich import box
    from rich.table import Table

    table = Table(box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0), show_edge=False)
    table.add_column("parameter", no_wrap=True)
    for label in ("bound", "squares", "ratio", "distances", "ratio", "r", "other r"):
        table.add_column(label, justify="right", no_wrap=True)
    for i, name in enumerate(squares.names):
        bound = squares.bounds[i]
        table.add_row(
            name,
            f"{100 * bound:.2f}",
            f"{100 * squares.errors[i]:.2f}",
            f"{squares.errors[i] / bound:.2f}",
            f"{100 * distances.errors[i]:.2f}",
            f"{distances.errors[i] / bound:.2f}",
            f"{distances.correlations[i]:.3f}",
            f"{other.correlations[i]:.3f}",
        )
    return table


def _head_table(own: Accuracy, other: Accuracy) -> Table:
    from math import degrees

    from rich import box
    from rich.table import Table

    table = Table(box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0), show_edge=False)
    table.add_column("pose of the head", no_wrap=True)
    for label in ("bound", "error", "other head"):
        table.add_column(label, justify="right")
    table.add_row(
        "centre of its markers (mm)",
        f"{own.head_shift_bound:.3f}",
        f"{own.head_shift:.3f}",
        f"{other.head_shift:.3f}",
    )
    table.add_row(
        "turn (degrees)",
        f"{degrees(own.head_turn_bound):.3f}",
        f"{degrees(own.head_turn):.3f}",
        f"{degrees(other.head_turn):.3f}",
    )
    return table
