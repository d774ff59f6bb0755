"""``mocap-fit fit``: recordings and a reference pose → face parameters, one Parquet file each."""

from __future__ import annotations

import glob
import hashlib
import json
import os
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypedDict

import numpy as np

from corpus_tools.batch import BatchProgress, Context, Item, ItemResult, run_batch
from mocap_fit.atomic_file import check_existing, check_targets
from mocap_fit.edits import EDITS_ENDING, EditList, load_edits
from mocap_fit.errors import ConfigurationError, MocapFitError
from mocap_fit.fitting.memory import check_memory
from mocap_fit.fitting.objective import Objective
from mocap_fit.fitting.reference_pose import parse_reference
from mocap_fit.fitting.speaker import Speaker, fit_speaker
from mocap_fit.io import READERS, ReadOptions
from mocap_fit.tracks import write_parquet
from mocap_fit.tracks.parquet_file import is_foreign_table

_Path = str | os.PathLike[str]

# What the last step of a result says that the report says too.
_REPORTED = (
    "frames",
    "fitted",
    "residual_mm",
    "head_residual_mm",
    "uncertain_frames",
    "unfinished_frames",
    "evaluations_per_frame",
)


class FitSettings(TypedDict):
    """How recordings are fitted: keywords of `Speaker.fit_shape`."""

    objective: Objective
    solver: str
    refine_pose: bool
    smooth: bool


@dataclass(frozen=True, eq=False)
class FitReport:
    """What a run of `fit` has done.

    Parameters
    ----------
    out
        Folder of the results.
    layout
        Name of the marker layout.
    scale
        Size of the face over that of the speaker, no unit.
    orientation_residuals
        Distance of each marker of the reference pose from its place on the face, millimetres.
    recordings
        One record per recording, in their order: ``recording`` (its name), ``file``, and either
        ``error`` or the figures of the fit, with ``kept`` where an earlier run has fitted it.
    seconds
        Time spent on each part of the work, in seconds, summed over the processes; but
        ``elapsed`` is the time of the complete run.
    """

    out: Path
    layout: str
    scale: float
    orientation_residuals: Mapping[str, float]
    recordings: tuple[Mapping[str, Any], ...]
    seconds: Mapping[str, float]

    @property
    def errors(self) -> dict[str, str]:
        """Why recordings have not been fitted, by their names."""
        return {row["recording"]: row["error"] for row in self.recordings if "error" in row}

    def to_dict(self) -> dict[str, Any]:
        """Return everything as JSON can hold it.

        Returns
        -------
        dict[str, Any]
            The fields; residuals in millimetres.
        """
        return {
            "layout": self.layout,
            "scale": self.scale,
            "orientation_residuals_mm": dict(self.orientation_residuals),
            "recordings": list(self.recordings),
            "seconds": dict(self.seconds),
        }

    def __repr__(self) -> str:
        fitted = len(self.recordings) - len(self.errors)
        return f"FitReport({fitted} of {len(self.recordings)} recordings fitted, out={self.out})"


@dataclass(frozen=True, kw_only=True)
class _FitItem(Item):
    """A recording, and what a person mended in it, or why that cannot be used."""

    edits: EditList | MocapFitError | None


@dataclass(frozen=True, eq=False)
class _FitJob:
    """How the recordings of a speaker are fitted; ``fingerprint_of_all`` is a sum over that."""

    speaker: Speaker
    settings: FitSettings
    between: tuple[float, float] | None
    options: ReadOptions
    allow_mirrored: bool
    fingerprint_of_all: str
    step: str = "fit_recording"

    def compute_fingerprint(self, item: _FitItem, sums: Mapping[str, str]) -> str:
        (name,) = item.sources
        # The file's name is in the result too.
        read = json.dumps([self.options.to_dict(), self.allow_mirrored], sort_keys=True)
        parts = [self.fingerprint_of_all, read, name, sums[name]]
        if self.between is not None:
            parts += map(repr, self.between)
        if isinstance(item.edits, MocapFitError):
            raise item.edits
        if item.edits is not None:
            parts.append(item.edits.digest)
        return hashlib.sha256(os.fsencode("\0".join(parts))).hexdigest()

    def is_complete(self, item: _FitItem, out: Path, figures: Mapping[str, Any]) -> bool:
        return figures.keys() >= set(_REPORTED)

    def process(self, item: _FitItem, context: Context) -> Mapping[str, Any]:
        with context.time("reading"):
            path = context.folder / item.sources[0]
            recording = self.options.read_tracks(path)
            if isinstance(item.edits, EditList):
                recording = item.edits.apply(recording)
            if self.between is not None:
                recording = recording.between(*self.between)
            check_memory(
                recording.frames,
                len(recording.names),
                smooth=self.settings["smooth"],
                path=path,
                processes=context.processes,
                free=context.free_memory,
            )
        with context.time("head_motion"):
            recording = self.speaker.prepare(recording, allow_mirrored=self.allow_mirrored)
            still, motion = self.speaker.remove_head_motion(recording)
        # A long recording is not held in both coordinates.
        del recording
        with context.time("fitting"):
            result = self.speaker.fit_shape(
                still,
                **self.settings,
                progress=lambda frames: context.progress(frames, still.frames),
            )
        tracks, fitted = result.parameters, result.fitted
        finite = np.isfinite(tracks.residuals)
        figures = {
            "inputs": context.fingerprint,
            "frames": tracks.frames,
            "fitted": int(finite.sum()),
            "residual_mm": float(np.median(tracks.residuals[finite])) if finite.any() else np.nan,
            "head_residual_mm": float(np.nanmedian(motion.residuals)),
            "uncertain_frames": int(tracks.uncertain.any(axis=1).sum()),
            "unfinished_frames": int((result.status == 5).sum()),
            "evaluations_per_frame": int(result.evaluations[fitted].sum()) / int(fitted.sum()),
        }
        with context.time("writing"):
            write_parquet(tracks.add_step(self.step, figures), context.out / item.targets[0])
        return figures


def fit(
    recordings: _Path | Sequence[_Path],
    *,
    reference: _Path,
    layout: str | None = None,
    out: _Path,
    face: str = "built-in",
    between: tuple[float, float] | None = None,
    edits: _Path | None = None,
    objective: Objective = "distances",
    solver: str = "newton-nlopt",
    refine_pose: bool = False,
    smooth: bool = False,
    allow_mirrored: bool = False,
    rate: float | None = None,
    unit: str | None = None,
    subject: str | None = None,
    rename: Mapping[str, str] | None = None,
    reference_as_is: bool = False,
    jobs: int = 1,
    cluster: str | None = None,
    fresh: bool = False,
    overwrite: bool = False,
    progress: Callable[[BatchProgress], object] | None = None,
) -> FitReport:
    """Fit face parameters to recordings and write ``OUT/NAME.parquet`` for each.

    A recording that cannot be fitted does not keep the others from it. One that an earlier run has
    fitted, from the same bytes in the same way, is not fitted again.

    Parameters
    ----------
    recordings
        Files, folders or patterns.
    reference
        A recording of the reference pose, or a span of one: ``take.tsv@0.2-0.5`` (seconds); the
        median over its frames is used.
    layout
        Name or file of the marker layout; the one that fits the reference pose where left out.
    out
        Folder of the results; created where it does not exist.
    face
        ``built-in``, or a rig file.
    between
        Start and end of the part of every recording that is fitted, seconds; None for all.
    edits
        An edit list, or a folder of ``RECORDING.edits.toml``; those beside the recordings where
        left out.
    objective
        What is minimised: ``distances``, ``squares`` or ``huber``.
    solver
        ``newton-nlopt``, ``newton``, or the name of an nlopt algorithm.
    refine_pose
        Whether the pose of the head is fitted together with the shape.
    smooth
        Whether all frames are fitted together, as smooth as the data say.
    allow_mirrored
        Whether mirrored recordings and a mirrored reference pose are mended, and not refused.
    rate
        Frame rate of the recordings, hertz, in place of what the files say.
    unit
        Unit of length of the files, such as ``m``, in place of what they say.
    subject
        Subject whose markers are read, where files name several.
    rename
        New names of markers by those in the files.
    reference_as_is
        Whether the reference pose is read without these options: it is right as it is.
    jobs
        Number of processes; 0 for one per core.
    cluster
        Address of a dask scheduler whose workers fit in place of this machine.
    fresh
        Whether recordings are fitted again that an earlier run has fitted.
    overwrite
        Whether Parquet files of other programs are replaced that have the names of results.
    progress
        Called with the state after every change; it has the results as they come, in the order
        of the recordings.

    Returns
    -------
    FitReport
        Figures of every recording; its ``errors`` names those that have not been fitted.

    Raises
    ------
    MocapFitError
        If there are no recordings, or reference pose, layout, face or folder cannot be used.
    """
    began = time.perf_counter()
    listed = [recordings] if isinstance(recordings, (str, os.PathLike)) else recordings
    files = find_recordings([Path(path) for path in listed])
    targets = [Path(out) / f"{file.stem}.parquet" for file in files]
    check_targets(targets, [*files, parse_reference(reference).path, layout, face])
    foreign = filter(is_foreign_table, targets)
    check_existing(foreign, "Parquet files of another program", overwrite=overwrite)
    options = ReadOptions(rate, unit, subject, rename or {})
    speaker = fit_speaker(
        face,
        layout,
        os.fspath(reference),
        allow_mirrored=allow_mirrored,
        read=(ReadOptions() if reference_as_is else options).read_tracks,
    )
    settings = FitSettings(
        objective=objective, solver=solver, refine_pose=refine_pose, smooth=smooth
    )
    shared = speaker.compute_fingerprint(**settings)
    job = _FitJob(speaker, settings, between, options, allow_mirrored, shared)
    seconds = {"speaker": time.perf_counter() - began}
    items = [_to_item(file, edits) for file in files]
    results = run_batch(
        job, items, Path(out), jobs=jobs, cluster=cluster, fresh=fresh, progress=progress
    )
    for result in results:
        for part, length in result.seconds.items():
            seconds[part] = seconds.get(part, 0.0) + length
    orientation = speaker.binding.orientation
    return FitReport(
        Path(out),
        speaker.layout.name,
        orientation.scale,
        dict(orientation.residuals or {}),
        tuple(_to_row(file, r, Path(out)) for file, r in zip(files, results, strict=True)),
        {**seconds, "elapsed": time.perf_counter() - began},
    )


def _to_item(file: Path, edits: _Path | None) -> _FitItem:
    prefix, target = str(file)[: -len(file.name)], f"{file.stem}.parquet"
    mended: EditList | MocapFitError | None
    try:
        mended = load_edits(file, edits)
    except MocapFitError as error:
        mended = error
    return _FitItem(
        file.stem, file.parent.absolute(), (file.name,), (target,), prefix, edits=mended
    )


def _to_row(file: Path, result: ItemResult, out: Path) -> dict[str, Any]:
    row = {"recording": file.stem, "file": file}
    if result.error is not None:
        return {**row, "error": result.error}
    figures = {name: result.figures[name] for name in _REPORTED}
    return {**row, "output": out / f"{file.stem}.parquet", **figures, "kept": result.cached}


def find_recordings(paths: Sequence[Path]) -> list[Path]:
    """Return the files that a user means: files, the recordings of folders, matches of patterns.

    Parameters
    ----------
    paths
        Files, folders or patterns; shells on Windows do not expand patterns.

    Returns
    -------
    list[Path]
        The files, each once.

    Raises
    ------
    ConfigurationError
        If a folder or a pattern holds no recording, or two recordings have one name.
    """
    known = READERS.list_extensions()
    files: list[Path] = []
    for path in paths:
        matches = [path]
        if path.is_dir():
            matches = sorted(f for f in path.iterdir() if f.suffix.lower() in known and f.is_file())
        elif not path.exists() and glob.has_magic(str(path)):
            matches = sorted(Path(name) for name in glob.glob(str(path)))
        if not matches:
            raise ConfigurationError(
                "no recording is there",
                path=str(path),
                expected=f"files that end in {', '.join(sorted(known))}",
            )
        files += matches
    files = [f for f in dict.fromkeys(files) if not f.name.endswith(EDITS_ENDING)]
    by_name: dict[str, Path] = {}
    for file in files:
        twin = by_name.setdefault(file.stem, file)
        if twin != file:
            raise ConfigurationError(
                f"two recordings are called '{file.stem}' and would overwrite each other's result",
                found=f"{twin} and {file}",
                advice="Rename one, or fit them into two folders.",
            )
    return files
