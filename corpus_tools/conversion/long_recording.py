"""Fit a recording that is too long to be held in memory: stretch by stretch.

It is read twice: for what the head's pose depends on of the whole, and to fit. What a frame's
standard deviations depend on is known at the end; until then the answers wait in a file beside
the result. The result has the bytes that the whole recording, fitted at once, would give.
"""

from __future__ import annotations

import contextlib
import os
import time
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from corpus_tools.conversion.speaker import Options, Speaker
from mocap_fit.errors import FileFormatError
from mocap_fit.fitting import StretchFitter
from mocap_fit.fitting.stretches import CHUNK
from mocap_fit.head import HeadInStretches
from mocap_fit.io import read_stretches, reads_in_stretches
from mocap_fit.tracks import FloatArray, MarkerTracks, ParameterTracks, TracksWriter
from mocap_fit.tracks.parquet_file import ROW_GROUP

STEP = "fit_recording"
"""The last step in the provenance of a result: what it was made from, and what came of it."""

LONG = 16 * 2**20
"""Bytes of a file that is fitted stretch by stretch; shorter ones are quicker in one piece."""

STRETCH = 8 * CHUNK
"""Frames of a stretch."""

_Item = TypeVar("_Item")


@contextlib.contextmanager
def timed(seconds: dict[str, float], part: str) -> Iterator[None]:
    """Add the time that is spent inside to a part's."""
    began = time.perf_counter()
    yield
    seconds[part] = seconds.get(part, 0.0) + time.perf_counter() - began


def is_one(speaker: Speaker, options: Options, file: Path) -> bool:
    """Whether a file is long, and can be fitted stretch by stretch.

    Smoothing over time, and layouts without head markers or with a size that varies, need the
    whole recording.
    """
    return (
        file.stat().st_size > LONG
        and not options.smooth
        and bool(speaker.head_weights)
        and not speaker.layout.size_varies
        and reads_in_stretches(file)
    )


def fit(
    speaker: Speaker,
    options: Options,
    file: Path,
    target: Path,
    made_from: str,
    told: Callable[[int, int], object],
    seconds: dict[str, float],
) -> dict[str, Any]:
    """Fit a long recording and write the result; what its last step says.

    Parameters
    ----------
    speaker, options
        Who is fitted, and how.
    file, target
        The recording, and where the result goes.
    made_from
        See `one_recording.inputs`.
    told
        Called with the number of frames done so far, and of all.
    seconds
        The time that each part takes is added here.
    """
    weights = speaker.head_weights
    head = HeadInStretches(speaker.reference, tuple(weights), weights)
    frames = 0
    for part in _timed(read_stretches(file, frames=STRETCH), seconds, "reading"):
        with timed(seconds, "head_motion"):
            head.look_at(part)
        frames += part.frames
    fitter = StretchFitter(
        speaker.binding,
        objective=options.objective,
        solver=options.solver,
        refine_pose=options.refine_pose,
    )
    spool = target.with_name(f".{target.name}.{os.getpid()}-frames.partial")
    try:
        with spool.open("w+b") as stream:
            first, came_of_it = _fit_all(speaker, file, head, fitter, stream, frames, told, seconds)
            fitter.finish(file.stem)
            said = summary(made_from, head_residual=head.tell(), **came_of_it)
            with timed(seconds, "writing"):
                _write(first, said, fitter, stream, target)
    except OSError as error:
        raise FileFormatError(
            "the result cannot be written",
            path=target,
            found=os.strerror(error.errno) if error.errno else error,
            advice="A long recording needs room for its result twice over.",
        ) from None
    finally:
        spool.unlink(missing_ok=True)
    return said


def _fit_all(
    speaker: Speaker,
    file: Path,
    head: HeadInStretches,
    fitter: StretchFitter,
    stream: Any,
    frames: int,
    told: Callable[[int, int], object],
    seconds: dict[str, float],
) -> tuple[MarkerTracks, dict[str, Any]]:
    """Fit every stretch into the stream; the first one, without frames, and what came of all."""
    before = seconds.get("reading", 0.0)
    parts = _timed(read_stretches(file, frames=STRETCH), seconds, "reading")
    first: MarkerTracks | None = None
    residuals: list[FloatArray] = []
    counts = dict.fromkeys(("uncertain_frames", "unfinished_frames", "evaluations", "fitted"), 0)
    done = 0
    for still in _timed(head.remove(parts), seconds, "head_motion"):
        first = first or still.replace(positions=still.positions[:0], origin=still.origin[:0])
        with timed(seconds, "fitting"):
            found = fitter.fit(still, lambda so_far, done=done: told(done + so_far, frames))  # type: ignore[misc]
        fitted = found.status != 0
        counts["uncertain_frames"] += int(np.isinf(found.deviations).any(axis=1).sum())
        counts["unfinished_frames"] += int((found.status == 5).sum())
        counts["evaluations"] += int(found.evaluations[fitted].sum())
        counts["fitted"] += int(fitted.sum())
        residuals.append(found.residuals)
        rows = np.concatenate(
            [found.values, found.deviations, found.residuals[:, None]], axis=1, dtype=np.float64
        )
        stream.write(np.ascontiguousarray(rows).data)
        done += still.frames
    # Reading goes on while the head is looked at.
    seconds["head_motion"] -= seconds["reading"] - before
    if first is None:
        raise FileFormatError("the recording has no frames", path=file)
    return speaker.tied(first), {"residuals": np.concatenate(residuals), **counts}


def _write(
    first: MarkerTracks,
    said: dict[str, Any],
    fitter: StretchFitter,
    stream: Any,
    target: Path,
) -> None:
    """Write the result from what the stream holds, a group of rows at a time."""
    names = fitter.parameter_names
    width = 2 * len(names) + 1
    stream.seek(0)
    with TracksWriter(target) as writer:
        while block := stream.read(ROW_GROUP * width * 8):
            rows = np.frombuffer(block).reshape(-1, width)
            tracks = ParameterTracks(
                names,
                first.rate,
                rows[:, : len(names)],
                fitter.standard_deviations(rows[:, len(names) : -1]),
                rows[:, -1],
                start_time=first.start_time,
                name=first.name,
                events=first.events,
                provenance=first.provenance,
            )
            writer.write(tracks.with_step("fit_shape", fitter.arguments).with_step(STEP, said))


def summary(
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
        See `one_recording.inputs`.
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


def _timed(items: Iterable[_Item], seconds: dict[str, float], part: str) -> Iterator[_Item]:
    """The items; the time that each takes to come is added to a part's."""
    stream = iter(items)
    while True:
        with timed(seconds, part):
            item = next(stream, None)
        if item is None:
            return
        yield item
