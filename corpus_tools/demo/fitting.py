"""The first part of the demo: recordings fitted as any recording is, and beside their truth."""

from __future__ import annotations

from dataclasses import dataclass
from math import degrees
from pathlib import Path
from typing import Any

from corpus_tools import simulation as simulate
from corpus_tools.cli import console
from corpus_tools.demo import figures
from corpus_tools.demo.comparison import Accuracy, FittedRecording, accuracy
from mocap_fit.drawing import save_figure
from mocap_fit.fitting.objective import Objective
from mocap_fit.fitting.speaker import Speaker, fit_speaker
from mocap_fit.io import read_tracks
from mocap_fit.tracks import ParameterTracks, PoseTracks, read_parquet, write_parquet

LAYOUT = "face30-head5"
CONDITIONS = simulate.Conditions(noise=0.3, drop_outs=0.05, rate=60.0, duration=4.0)
# Folder of a session → how many recordings it has, and whose head.
SESSIONS: dict[str, tuple[int, dict[str, float] | None]] = {
    "same_head": (3, None),
    "other_head": (1, simulate.OTHER_SPEAKER),
}
# The first is the one of `mocap-fit fit`, and the one whose parameters are written and drawn.
_OBJECTIVES: tuple[Objective, ...] = ("distances", "squares")
_FACES = 6


@dataclass(frozen=True, eq=False)
class FitPart:
    """What the first part found.

    Parameters
    ----------
    errors
        By session and objective.
    pictures
        Files of the figures, in order.
    report
        For programs.
    """

    errors: dict[str, dict[Objective, Accuracy]]
    pictures: list[Path]
    report: dict[str, Any]


def fit_part(out: Path, seed: int, conditions: simulate.Conditions, *, can_draw: bool) -> FitPart:
    """Simulate, fit, compare with the truth, and draw.

    Parameters
    ----------
    out
        An empty folder with a folder ``figures``.
    seed
        The same seed gives the same numbers.
    conditions
        What the simulated sessions are like.
    can_draw
        Whether faces can be drawn here.
    """
    _simulate(out, seed, conditions)
    speakers = {
        session: fit_speaker("built-in", LAYOUT, out / session / "reference.tsv")
        for session in SESSIONS
    }
    fits = _fit(out, speakers)
    errors = {
        session: {
            objective: accuracy(
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
        out / "figures", fits, speakers, errors["same_head"], conditions.noise, can_draw=can_draw
    )
    return FitPart(errors, pictures, report)


def _simulate(out: Path, seed: int, conditions: simulate.Conditions) -> None:
    total = sum(count for count, _ in SESSIONS.values())
    with console.progress("simulating recordings", total) as advance:
        for i, (session, (count, head)) in enumerate(SESSIONS.items()):
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


def show(part: FitPart, conditions: simulate.Conditions) -> None:
    """Print the table of errors beside their bounds."""
    screen = console.screen()
    own, other = part.errors["same_head"], part.errors["other_head"]
    squares, distances = own["squares"], own["distances"]
    screen.print(
        f"Simulated: {distances.frames} frames of the built-in head and {other['squares'].frames} "
        f"of another head; 30 face and 5 head markers, noise {conditions.noise:g} mm, "
        f"{conditions.drop_outs:.0%} drop-outs, the head moving."
    )
    header, rows = parameter_table(squares, distances, other["distances"])
    screen.print("", console.table(header, rows), "", sep="\n")
    screen.print(EXPLAINED)
    header, rows = head_table(distances, other["distances"])
    screen.print("", console.table(header, rows), "", sep="\n")
    screen.print(
        f"{distances.fitted} of {distances.frames} and {other['distances'].fitted} of "
        f"{other['distances'].frames} frames fitted; the rest show too few head markers.\n"
    )


EXPLAINED = (
    "Errors are root mean squares in % of a full gesture (1.0 of the parameter). Bound: the "
    "Cramér-Rao bound, from the markers that are seen and the head pose they give. r: "
    "correlation of the fit by distances with the truth; other r: the same for the other head."
)


def parameter_table(
    squares: Accuracy, distances: Accuracy, other: Accuracy
) -> tuple[list[str], list[list[str]]]:
    """Errors and bounds of every parameter: header and rows."""
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


def head_table(own: Accuracy, other: Accuracy) -> tuple[list[str], list[list[str]]]:
    """Errors of the head's pose: header and rows."""
    header = ["pose of the head", "bound", "error", "other head"]
    return header, [
        [
            "centre of its markers (mm)",
            f"{own.head_shift_bound:.3f}",
            f"{own.head_shift:.3f}",
            f"{other.head_shift:.3f}",
        ],
        [
            "turn (degrees)",
            f"{degrees(own.head_turn_bound):.3f}",
            f"{degrees(own.head_turn):.3f}",
            f"{degrees(other.head_turn):.3f}",
        ],
    ]
