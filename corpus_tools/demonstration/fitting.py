"""The first part of the demo: fit simulated recordings, and compare them with their truth."""

from __future__ import annotations

from dataclasses import dataclass
from math import degrees
from pathlib import Path
from typing import Any

from corpus_tools.demonstration import figures
from corpus_tools.demonstration.comparison import Accuracy, FittedRecording, measure_accuracy
from corpus_tools.simulation import OTHER_SPEAKER, Conditions, simulate
from corpus_tools.tasks import TaskProgress, count_steps
from mocap_fit.drawing import save_figure
from mocap_fit.fitting import Binding
from mocap_fit.fitting.objective import Objective
from mocap_fit.fitting.speaker import Speaker, fit_speaker
from mocap_fit.io import read_tracks
from mocap_fit.tracks import ParameterTracks, PoseTracks, read_parquet, write_parquet

LAYOUT = "face30-head5"
CONDITIONS = Conditions(noise=0.3, drop_outs=0.05, rate=60.0, duration=4.0)
# Folder of a session → its number of recordings, and the proportions of its head.
SESSIONS: dict[str, tuple[int, dict[str, float] | None]] = {
    "same_head": (3, None),
    "other_head": (1, OTHER_SPEAKER),
}
# The first is the one of `mocap-fit fit`, and the one whose parameters are written and drawn.
_OBJECTIVES: tuple[Objective, ...] = ("distances", "squares")
_FACES = 6


@dataclass(frozen=True, eq=False)
class FitPart:
    """Result of the first part.

    Parameters
    ----------
    errors
        Errors by session and objective.
    pictures
        Files of the figures, in order.
    report
        All figures, for JSON.
    """

    errors: dict[str, dict[Objective, Accuracy]]
    pictures: list[Path]
    report: dict[str, Any]


def run_fits(
    out: Path,
    seed: int,
    conditions: Conditions,
    *,
    can_draw: bool,
    progress: TaskProgress | None = None,
) -> FitPart:
    """Simulate, fit, compare with the truth, and draw.

    Parameters
    ----------
    out
        An empty folder with a folder ``figures``.
    seed
        Seed of all random numbers.
    conditions
        Properties of the simulated sessions.
    can_draw
        Whether faces can be drawn here.
    progress
        Called with a task, the number of its steps done, and of all.

    Returns
    -------
    FitPart
        Errors and figures.
    """
    _simulate(out, seed, conditions, progress)
    speakers = {
        session: fit_speaker("built-in", LAYOUT, out / session / "reference.tsv")
        for session in SESSIONS
    }
    fits = _fit(out, speakers, progress)
    noise = conditions.noise
    errors: dict[str, dict[Objective, Accuracy]] = {}
    for session, by_objective in fits.items():
        binding, bounded = speakers[session].binding, SESSIONS[session][1] is None
        errors[session] = {
            objective: measure_accuracy(recordings, binding, noise, bounded=bounded)
            for objective, recordings in by_objective.items()
        }
    report = {
        "layout": LAYOUT,
        "noise_mm": noise,
        "drop_outs": conditions.drop_outs,
        "unit": "% of a full gesture, which is 1.0 of a parameter",
        "sessions": {
            session: {objective: result.to_dict() for objective, result in results.items()}
            for session, results in errors.items()
        },
    }
    # Without off-screen drawing there are no faces.
    drawn = speakers["same_head"].binding if can_draw else None
    pictures = _draw(out / "figures", fits, drawn, errors["same_head"], noise, progress)
    return FitPart(errors, pictures, report)


def _simulate(out: Path, seed: int, conditions: Conditions, progress: TaskProgress | None) -> None:
    total = sum(count for count, _ in SESSIONS.values())
    advance = count_steps(progress, "simulating recordings", total)
    for i, (session, (count, head)) in enumerate(SESSIONS.items()):
        simulate(
            out / session,
            utterances=count,
            seed=seed + i,
            layout=LAYOUT,
            conditions=conditions,
            head=head,
            spoken=None,
            progress=advance,
        )


Fits = dict[str, dict[Objective, list[FittedRecording]]]


def _fit(out: Path, speakers: dict[str, Speaker], progress: TaskProgress | None) -> Fits:
    """Fit every recording with every objective; the first objective's parameters are written."""
    files = {session: sorted((out / session / "recordings").iterdir()) for session in speakers}
    fits: Fits = {session: {objective: [] for objective in _OBJECTIVES} for session in speakers}
    total = sum(map(len, files.values())) * len(_OBJECTIVES)
    advance = count_steps(progress, "fitting recordings", total)
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
                fit = speaker.fit(recording, objective=objective)
                fitted = FittedRecording(recording, fit.shape, fit.head_motion, truth, pose)
                fits[session][objective].append(fitted)
                if objective == _OBJECTIVES[0]:
                    write_parquet(fit.parameters, folder / "fit" / f"{file.stem}.parquet")
                advance()
    return fits


def _draw(
    folder: Path,
    fits: Fits,
    binding: Binding | None,
    errors: dict[Objective, Accuracy],
    noise: float,
    progress: TaskProgress | None,
) -> list[Path]:
    """Draw all figures, and return their files."""
    shown = fits["same_head"][_OBJECTIVES[0]][0]
    other = fits["other_head"][_OBJECTIVES[0]][0]
    proportions = "a head of other size and proportions"
    labels = {"squares": "least squares", "distances": "sum of distances"}
    results = {labels[objective]: result for objective, result in errors.items()}
    pictures: dict[str, tuple[Any, ...]] = {
        "tracks.png": (figures.draw_tracks, shown, "the built-in head"),
        "tracks_other_head.png": (figures.draw_tracks, other, proportions),
        "residuals.png": (figures.draw_residuals, shown),
        "accuracy.png": (figures.draw_accuracy, results, noise),
        "head_motion.png": (figures.draw_head, shown),
    }
    if binding is not None:
        frames = figures.choose_frames(shown, _FACES)
        pictures["faces.png"] = (figures.draw_faces, shown, binding, frames)
    advance = count_steps(progress, "drawing figures", len(pictures))
    for name, call in pictures.items():
        save_figure(folder / name, *call)
        advance()
    return [folder / name for name in pictures]


EXPLAINED = (
    "Errors are root mean squares in % of a full gesture (1.0 of the parameter). Bound: the "
    "Cramér-Rao bound of one frame by itself, from the markers that are seen and the head pose "
    "they give; a fit that looks at other frames or corrects the pose may go below it. r: "
    "correlation of the fit by distances with the truth; other r: the same for the other head."
)


def to_parameter_table(
    squares: Accuracy, distances: Accuracy, other: Accuracy
) -> tuple[list[str], list[list[str]]]:
    """Return errors and bounds of every parameter.

    Parameters
    ----------
    squares
        Errors of the fit by squares.
    distances
        Errors of the fit by distances.
    other
        Errors of the fit by distances for the other head.

    Returns
    -------
    tuple
        Header and rows.
    """
    header = ["parameter", "bound", "squares", "ratio", "distances", "ratio", "r", "other r"]
    rows = []
    for i, name in enumerate(squares.names):
        bound = squares.bounds[i]
        pairs = [(100 * fit.errors[i], fit.errors[i] / bound) for fit in (squares, distances)]
        errors = [f"{value:.2f}" for pair in pairs for value in pair]
        correlations = [f"{fit.correlations[i]:.3f}" for fit in (distances, other)]
        rows.append([name, f"{100 * bound:.2f}", *errors, *correlations])
    return header, rows


def to_head_table(same: Accuracy, other: Accuracy) -> tuple[list[str], list[list[str]]]:
    """Return errors of the head's pose.

    Parameters
    ----------
    same
        Errors for the built-in head.
    other
        Errors for the other head.

    Returns
    -------
    tuple
        Header and rows.
    """
    shifts = (same.head_shift_bound, same.head_shift, other.head_shift)
    turns = map(degrees, (same.head_turn_bound, same.head_turn, other.head_turn))
    return ["pose of the head", "bound", "error", "other head"], [
        ["centre of its markers (mm)", *(f"{shift:.3f}" for shift in shifts)],
        ["turn (degrees)", *(f"{turn:.3f}" for turn in turns)],
    ]
