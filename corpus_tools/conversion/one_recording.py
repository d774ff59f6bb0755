"""Fit one recording: here, or from bytes that were sent; what came of it is a small `Outcome`."""

from __future__ import annotations

import contextlib
import hashlib
import tempfile
import time
import traceback
import warnings
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, TypedDict

import numpy as np

from corpus_tools.cli import console
from mocap_fit.errors import MocapFitError, MocapFitWarning, add_path, describe_error
from mocap_fit.fitting.objective import Objective
from mocap_fit.fitting.speaker import Speaker
from mocap_fit.io import read_tracks
from mocap_fit.tracks import FloatArray, ParameterTracks, read_provenance, write_parquet

STEP = "fit_recording"
"""The last step in the provenance of a result: what it was made from, and what came of it."""

# What a result's last step says that the report says too.
_REPORTED = (
    "frames",
    "fitted",
    "residual_mm",
    "head_residual_mm",
    "uncertain_frames",
    "unfinished_frames",
    "evaluations_per_frame",
)


class FitSettings(TypedDict, total=False):
    """How recordings are fitted: keywords of `Speaker.fit_shape` and `Speaker.compute_fingerprint`."""

    objective: Objective
    solver: str
    refine_pose: bool
    smooth: bool


@dataclass(frozen=True, eq=False)
class Task:
    """What is done with every recording.

    Parameters
    ----------
    speaker
        Who is fitted.
    settings
        Keywords of `Speaker.fit_shape`.
    fingerprint
        `Speaker.compute_fingerprint` with these.
    fresh
        Fit also what is fitted already.
    """

    speaker: Speaker
    settings: FitSettings
    fingerprint: str
    fresh: bool = False


@dataclass(frozen=True, eq=False)
class Outcome:
    """What came of a recording; small, but for the tracks that a cluster sends.

    Parameters
    ----------
    figures
        What the report says of it, or an ``error`` alone.
    warnings
        What was warned about, a line each.
    seconds
        How long each part took.
    tracks
        The result, where it is not written yet.
    traceback
        Of the error, for those who debug.
    """

    figures: dict[str, Any]
    warnings: tuple[str, ...] = ()
    seconds: dict[str, float] = field(default_factory=dict)
    tracks: ParameterTracks | None = None
    traceback: str | None = None


@contextlib.contextmanager
def timed(seconds: dict[str, float], part: str) -> Iterator[None]:
    """Add the time that is spent inside to a part's."""
    began = time.perf_counter()
    yield
    seconds[part] = seconds.get(part, 0.0) + time.perf_counter() - began


def fit_here(task: Task, pair: tuple[Path, Path], told: Callable[[int, int], object]) -> Outcome:
    """Fit a recording that this process can read, and write the result.

    Parameters
    ----------
    task
        What is done.
    pair
        The recording's file, and the result's.
    told
        Called with the number of frames done so far, and of all.
    """
    file, target = pair

    def work(seconds: dict[str, float]) -> Outcome:
        with timed(seconds, "reading"):
            with open(file, "rb") as stream:
                content = hashlib.file_digest(stream, "sha256").hexdigest()
            made_from = inputs(task, file.name, content)
            figures = None if task.fresh else kept(target, made_from)
        if figures is not None:
            return Outcome(figures)
        tracks = _fitted(task, file, made_from, told, seconds)
        with timed(seconds, "writing"):
            write_parquet(tracks, target)
        return Outcome(_figures_of(tracks))

    return watched(work, file)


def fit_sent(
    task: Task, sent: tuple[str, str, bytes], told: Callable[[int, int], object]
) -> Outcome:
    """Fit a recording that was sent as bytes; the outcome holds the tracks.

    Parameters
    ----------
    task
        What is done.
    sent
        The file's name, its fingerprint with the task's, and its content.
    told
        As for `fit_here`.
    """
    name, made_from, content = sent
    # Readers take files, and nothing else on this machine is ours.
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / name
        copy.write_bytes(content)

        def work(seconds: dict[str, float]) -> Outcome:
            tracks = _fitted(task, copy, made_from, told, seconds)
            return Outcome(_figures_of(tracks), tracks=tracks)

        outcome = watched(work, copy)

    def named(line: str) -> str:
        return line.replace(str(copy), name)

    figures = outcome.figures
    if "error" in figures:
        figures = {"error": named(figures["error"])}
    return replace(outcome, figures=figures, warnings=tuple(map(named, outcome.warnings)))


def written(outcome: Outcome, file: Path, target: Path) -> Outcome:
    """Write the tracks of an outcome that came from a cluster."""
    tracks = outcome.tracks
    if tracks is None:
        # It was read under another name there.
        figures = {"error": outcome.figures["error"].replace(file.name, str(file), 1)}
        return replace(outcome, figures=figures)

    def work(seconds: dict[str, float]) -> Outcome:
        with timed(seconds, "writing"):
            write_parquet(tracks, target)
        return replace(outcome, tracks=None)

    last = watched(work, file)
    return replace(
        last,
        warnings=(*outcome.warnings, *last.warnings),
        seconds={**outcome.seconds, **last.seconds},
    )


def watched(work: Callable[[dict[str, float]], Outcome], file: Path) -> Outcome:
    """Do a recording's work; what its user can mend is in the outcome, not raised."""
    seconds: dict[str, float] = {}
    trace = None
    with warnings.catch_warnings(record=True) as heard:
        warnings.simplefilter("always", MocapFitWarning)
        warnings.simplefilter("ignore", DeprecationWarning)
        warnings.simplefilter("ignore", FutureWarning)
        try:
            outcome = work(seconds)
        except (MocapFitError, OSError) as error:
            told = add_path(error, file) if isinstance(error, MocapFitError) else error
            outcome = Outcome({"error": describe_error(told)})
            trace = traceback.format_exc() if console.debugging() else None
    lines = (
        str(one.message)
        if issubclass(one.category, MocapFitWarning)
        else f"{one.category.__name__}: {one.message}"
        for one in heard
    )
    return replace(outcome, warnings=tuple(dict.fromkeys(lines)), seconds=seconds, traceback=trace)


def inputs(task: Task, name: str, content: str) -> str:
    """A sum over all that a result depends on; the file's name is in the result too."""
    return hashlib.sha256("\0".join((task.fingerprint, name, content)).encode()).hexdigest()


def _fitted(
    task: Task,
    file: Path,
    made_from: str,
    told: Callable[[int, int], object],
    seconds: dict[str, float],
) -> ParameterTracks:
    with timed(seconds, "reading"):
        recording = read_tracks(file)
    with timed(seconds, "head_motion"):
        still, motion = task.speaker.remove_head_motion(recording)
    # A long recording is not kept in both coordinates.
    del recording
    with timed(seconds, "fitting"):
        result = task.speaker.fit_shape(
            still, **task.settings, progress=lambda frames: told(frames, still.frames)
        )
    tracks, fitted = result.parameters, result.fitted
    came_of_it = _summary(
        made_from,
        residuals=tracks.residuals,
        uncertain_frames=int(tracks.uncertain.any(axis=1).sum()),
        unfinished_frames=int((result.status == 5).sum()),
        evaluations=int(result.evaluations[fitted].sum()),
        fitted=int(fitted.sum()),
        head_residual=float(np.nanmedian(motion.residuals)),
    )
    return tracks.add_step(STEP, came_of_it)


def _summary(
    made_from: str,
    *,
    residuals: FloatArray,
    uncertain_frames: int,
    unfinished_frames: int,
    evaluations: int,
    fitted: int,
    head_residual: float,
) -> dict[str, Any]:
    """What the last step of a result says.

    Parameters
    ----------
    made_from
        See `inputs`.
    residuals
        `(frames,)`, millimetres; NaN where not fitted.
    uncertain_frames, unfinished_frames, fitted
        Numbers of frames.
    evaluations
        Of all fitted frames together.
    head_residual
        Median over the frames, millimetres.
    """
    there = np.isfinite(residuals)
    return {
        "inputs": made_from,
        "frames": len(residuals),
        "fitted": int(there.sum()),
        "residual_mm": float(np.median(residuals[there])) if there.any() else float("nan"),
        "head_residual_mm": head_residual,
        "uncertain_frames": uncertain_frames,
        "unfinished_frames": unfinished_frames,
        "evaluations_per_frame": evaluations / fitted,
    }


def kept(target: Path, made_from: str) -> dict[str, Any] | None:
    """What is reported of a result that is there already; None where it must be made anew."""
    if not target.exists():
        return None
    try:
        provenance = read_provenance(target)
    except (MocapFitError, OSError):
        return None
    if not provenance or provenance[-1].name != STEP:
        return None
    said = provenance[-1].arguments
    if said.get("inputs") != made_from or not said.keys() >= set(_REPORTED):
        return None
    return _figures(said) | {"kept": True}


def _figures_of(tracks: ParameterTracks) -> dict[str, Any]:
    return _figures(tracks.provenance[-1].arguments)


def _figures(said: Mapping[str, Any]) -> dict[str, Any]:
    """What is reported of a result, from its last step."""
    return {name: said[name] for name in _REPORTED} | {"kept": False}
