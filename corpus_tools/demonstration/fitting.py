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
    errors = {
        session: {
            objective: measure_accuracy(
                recordings,
                speakers[session].binding,
                conditions.noise,
                bounded=SESSIONS[session][1] is None,
            )
            for objective, recordings in by_objective.items()
        }
        for session, by_objective in fits.items()
    }
    report = {
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
        out / "figures",
        fits,
        speakers,
        errors["same_head"],
        conditions.noise,
        can_draw=can_draw,
        progress=progress,
    )
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
    speakers: dict[str, Speaker],
    errors: dict[Objective, Accuracy],
    noise: float,
    *,
    can_draw: bool,
    progress: TaskProgress | None,
) -> list[Path]:
    """Draw all figures, and return their files."""
    shown = fits["same_head"][_OBJECTIVES[0]][0]
    other = fits["other_head"][_OBJECTIVES[0]][0]
    labels = {"squares": "least squares", "distances": "sum of distances"}
    results = {labels[objective]: result for objective, result in errors.items()}
    pictures: dict[str, tuple[Any, ...]] = {
        "tracks.png": (figures.draw_tracks, shown, "the built-in head"),
        "tracks_other_head.png": (
            figures.draw_tracks,
            other,
            "a head of other size and proportions",
        ),
        "residuals.png": (figures.draw_residuals, shown),
        "accuracy.png": (figures.draw_accuracy, results, noise),
        "head_motion.png": (figures.draw_head, shown),
    }
    if can_draw:
        pictures["faces.png"] = (
            figures.draw_faces,
            shown,
            speakers["same_head"].binding,
            figures.choose_frames(shown, _FACES),
        )
    advance = count_steps(progress, "drawing figures", len(pictures))
    for name, call in pictures.items():
        save_figure(folder / name, *call)
        advance()
    return [folder / name for name in pictures]


EXPLAINED = (
    "Errors are root mean squares in % of a full gesture (1.0 of the parameter). Bound: the "
    "Cramér-Rao bound, from the markers that are seen and the head pose they give. r: "
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
        rows.append(
            [
                name,
                f"{100 * bound:.2f}",
                f"{100 * squares.errors[i]:.2f}",
                f"{squares.errors[i] / bound:.2f}",
                f"{100 * distances.errors[i]:.2f}",
                f"{distances.errors[i] / bound:.2f}",
                f"{distances.correlations[i]:.3f}",
                f"{other.correlations[i]:.3f}",
            ]
        )
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
    header = ["pose of the head", "bound", "error", "other head"]
    return header, [
        [
            "centre of its markers (mm)",
            f"{same.head_shift_bound:.3f}",
            f"{same.head_shift:.3f}",
            f"{other.head_shift:.3f}",
        ],
        [
            "turn (degrees)",
            f"{degrees(same.head_turn_bound):.3f}",
            f"{degrees(same.head_turn):.3f}",
            f"{degrees(other.head_turn):.3f}",
        ],
    ]
