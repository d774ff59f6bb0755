"""Convert one utterance: here, or from bytes that were sent; what came of it is an `Outcome`."""

from __future__ import annotations

import contextlib
import dataclasses
import hashlib
import os
import tempfile
import time
import traceback
import warnings
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from corpus_tools.cli import console
from corpus_tools.conversion.material import (
    UnknownPhonesError,
    check_times,
    notes_on_clock,
    on_one_clock,
    read_labels,
    read_recording,
    speech_of,
    with_energy,
)
from corpus_tools.conversion.plan import Job, Settings
from mocap_fit.atomic_file import make_folder, write_atomically
from mocap_fit.errors import DataError, MocapFitError, MocapFitWarning, add_path, describe_error
from mocap_fit.phones import UnknownPhone, write_phones
from mocap_fit.sound import Sound, read_sound, write_sound
from mocap_fit.tracks import write_parquet
from mocap_fit.tracks.parquet_file import read_description

PARTS = ("markers", "head", "phones", "tracks")
"""Folders of Parquet files; the tracks are written last, when all else is there."""

AUDIO = "audio"
# The last step in the provenance of each file: what it was made from.
_STEP = "convert"

Told = Callable[[int, int], object]


@dataclass(frozen=True, eq=False)
class Task:
    """What is done with every utterance.

    Parameters
    ----------
    settings
        What they share.
    root, out
        Folders of the sources and of the corpus.
    """

    settings: Settings
    root: Path
    out: Path


@dataclass(frozen=True, eq=False)
class Outcome:
    """What came of an utterance.

    Parameters
    ----------
    figures
        What the report and the corpus's table say of it; empty if it is bad.
    error
        Why it is bad.
    unknown
        Phones that are not in the set.
    warnings
        What was warned about, a line each.
    seconds
        How long each part took.
    files
        Content by path under the corpus, where it is not written yet.
    traceback
        Of the error, for those who debug.
    """

    figures: Mapping[str, Any]
    error: str | None = None
    unknown: tuple[UnknownPhone, ...] = ()
    warnings: tuple[str, ...] = ()
    seconds: Mapping[str, float] = field(default_factory=dict)
    files: Mapping[str, bytes] | None = None
    traceback: str | None = None


def convert_here(task: Task, job: Job, told: Told) -> Outcome:
    """Convert an utterance whose files this process can read, and write its part of the corpus.

    Parameters
    ----------
    task, job
        What is done with what.
    told
        Called with the number of frames done so far, and of all.
    """
    seconds: dict[str, float] = {}

    def work() -> Mapping[str, Any]:
        with _timed(seconds, "reading"):
            inputs = task.settings.inputs(job, file_sums(task.root, job))
            known = None if task.settings.fresh else kept(task.out, job, inputs)
        return known or _converted(task, job, inputs, told, seconds)

    return _watched(work, task.root, seconds)


def convert_sent(task: Task, sent: tuple[Job, str, Mapping[str, bytes]], told: Told) -> Outcome:
    """Convert an utterance whose files were sent as bytes; the outcome holds the new files.

    Parameters
    ----------
    task
        What is done; its folders count for nothing here.
    sent
        The utterance, the sum over what it depends on, and the content of its files by path.
    told
        As for `convert_here`.
    """
    job, inputs, contents = sent
    # Readers take files, and nothing else on this machine is ours.
    with tempfile.TemporaryDirectory() as folder:
        root, out = Path(folder) / "root", Path(folder) / "out"
        for path, content in contents.items():
            (root / path).parent.mkdir(parents=True, exist_ok=True)
            (root / path).write_bytes(content)
        make_folders(out)
        here = Task(task.settings, root, out)
        seconds: dict[str, float] = {}
        outcome = _watched(lambda: _converted(here, job, inputs, told, seconds), root, seconds)
        made = {
            path: (out / path).read_bytes()
            for path in paths_of(job)
            if outcome.error is None and (out / path).is_file()
        }
    return dataclasses.replace(outcome, files=made)


def write_sent(out: Path, job: Job, files: Mapping[str, bytes]) -> None:
    """Write the files of an utterance that came from a cluster, the tracks last.

    Raises
    ------
    FileFormatError
        If a file cannot be written.
    """
    for path in paths_of(job):
        if path in files:
            with write_atomically(out / path) as partial:
                partial.write_bytes(files[path])


def make_folders(out: Path) -> None:
    """Make the folders of a corpus where they are not there."""
    for part in (*PARTS, AUDIO):
        make_folder(out / part)


def paths_of(job: Job) -> tuple[str, ...]:
    """Files of the corpus that an utterance has, the tracks last."""
    name = job.entry.id
    audio = () if job.sound is None else (f"{AUDIO}/{name}.wav",)
    return (*audio, *(f"{part}/{name}.parquet" for part in PARTS))


def file_sums(root: Path, job: Job) -> dict[str, str]:
    """A sum over the content of each file of an utterance, by path."""
    sums = {}
    for path in job.files:
        with open(root / path, "rb") as stream:
            sums[path] = hashlib.file_digest(stream, "sha256").hexdigest()
    return sums


def kept(out: Path, job: Job, inputs: str) -> dict[str, Any] | None:
    """What is known of an utterance that is in the corpus already; None where it must be made."""
    name = job.entry.id
    step: Mapping[str, Any] = {}
    for part in PARTS:
        described = read_description(out / part / f"{name}.parquet") or {}
        steps = described.get("provenance")
        step = steps[-1] if isinstance(steps, list) and steps else {}
        if step.get("step") != _STEP or step.get("arguments", {}).get("inputs") != inputs:
            return None
    figures = dict(step["arguments"])
    if "audio" in figures:
        try:
            with open(out / AUDIO / f"{name}.wav", "rb") as stream:
                content = hashlib.file_digest(stream, "sha256").hexdigest()
        except OSError:
            return None
        if content != figures["audio"]:
            return None
    return {**figures, "kept": True}


def _watched(
    work: Callable[[], Mapping[str, Any]], root: Path, seconds: Mapping[str, float]
) -> Outcome:
    """Do an utterance's work; what its user can mend is in the outcome, not raised."""
    figures: Mapping[str, Any] = {}
    error_line, trace = None, None
    unknown: tuple[UnknownPhone, ...] = ()
    with _heard(root) as lines:
        try:
            figures = work()
        except (MocapFitError, OSError) as error:
            error_line = _under(root, describe_error(error))
            trace = traceback.format_exc() if console.debugging() else None
            if isinstance(error, UnknownPhonesError):
                unknown = error.unknown
    return Outcome(figures, error_line, unknown, tuple(lines), seconds, None, trace)


@contextlib.contextmanager
def _heard(root: Path) -> Iterator[list[str]]:
    """Collect what is warned about; each line once."""
    lines: list[str] = []
    with warnings.catch_warnings(record=True) as heard:
        warnings.simplefilter("always", MocapFitWarning)
        warnings.simplefilter("ignore", DeprecationWarning)
        warnings.simplefilter("ignore", FutureWarning)
        yield lines
    for one in heard:
        line = str(one.message)
        if not issubclass(one.category, MocapFitWarning):
            line = f"{one.category.__name__}: {line}"
        lines.append(" ".join(_under(root, line).split()))
    lines[:] = dict.fromkeys(lines)


def _under(root: Path, line: str) -> str:
    """A line that names files by their paths under the root, wherever that is."""
    return line.replace(f"{root}{os.sep}", "")


@contextlib.contextmanager
def _timed(seconds: dict[str, float], part: str) -> Iterator[None]:
    began = time.perf_counter()
    yield
    seconds[part] = seconds.get(part, 0.0) + time.perf_counter() - began


def _converted(
    task: Task, job: Job, inputs: str, told: Told, seconds: dict[str, float]
) -> dict[str, Any]:
    """Convert an utterance and write its files."""
    settings, name = task.settings, job.entry.id
    speaker = settings.speakers[job.entry.reference]
    made_from = {"inputs": inputs}
    with _heard(task.root) as checks:
        with _timed(seconds, "reading"):
            recording = read_recording(settings, task.root, job)
            sound = None if job.sound is None else read_sound(task.root / job.sound)
            phones = read_labels(settings, task.root, job, None if sound is None else sound.rate)
        recorded_rate = recording.rate
        with _timed(seconds, "synchronising"):
            recording, sync = on_one_clock(settings, job, recording, sound)
            speech = speech_of(settings, sound)
        check_times(settings, job, phones, recording, speech)
        if speech is not None:
            phones = with_energy(phones, speech)
        try:
            with _timed(seconds, "head_motion"):
                still, motion = speaker.remove_head_motion(recording)
            with _timed(seconds, "fitting"):
                result = speaker.fit_shape(
                    still, **settings.options, progress=lambda frames: told(frames, still.frames)
                )
        except DataError as error:
            raise add_path(error, job.recording) from None
    fitted = np.isfinite(result.parameters.residuals)
    if not fitted.any():
        raise DataError("no frame could be fitted", path=job.recording)
    with _timed(seconds, "writing"):
        audio = _write_audio(task, job, sound, speech)
        write_parquet(
            recording.replace(name=name).add_step(_STEP, made_from),
            task.out / "markers" / f"{name}.parquet",
        )
        write_parquet(
            motion.pose.replace(name=name).add_step(_STEP, made_from),
            task.out / "head" / f"{name}.parquet",
        )
        write_phones(
            phones.replace(name=name).add_step(_STEP, made_from),
            task.out / "phones" / f"{name}.parquet",
        )
        figures: dict[str, Any] = {
            **made_from,
            "frames": recording.frames,
            "fitted": int(fitted.sum()),
            "duration": result.parameters.duration,
            "recorded_rate": recorded_rate,
            "phones": len(phones),
            "residual_mm": float(np.median(result.parameters.residuals[fitted])),
            "head_residual_mm": float(np.nanmedian(motion.residuals)),
            "sync": sync,
            "sources": list(job.files),
            "checks": [*notes_on_clock(sync, recording.frames), *checks],
        }
        if audio is not None:
            figures["audio"] = audio
        write_parquet(
            result.parameters.replace(name=name).add_step(_STEP, figures),
            task.out / "tracks" / f"{name}.parquet",
        )
    # Here for the report; in the file they are told already.
    for line in checks:
        warnings.warn(line, MocapFitWarning, stacklevel=1)
    return {**figures, "kept": False}


def _write_audio(task: Task, job: Job, sound: Sound | None, speech: Sound | None) -> str | None:
    """Write what is heard, and give the sum over its file; None where there is nothing."""
    if job.sound is None or speech is None:
        return None
    target = task.out / AUDIO / f"{job.entry.id}.wav"
    if speech is sound:
        with write_atomically(target) as partial:
            partial.write_bytes((task.root / job.sound).read_bytes())
    else:
        write_sound(speech, target)
    return hashlib.sha256(target.read_bytes()).hexdigest()
