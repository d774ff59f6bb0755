"""``mocap-fit fit``: recordings and a reference pose → face parameters, a Parquet file each."""

from __future__ import annotations

import contextlib
import glob
import hashlib
import time
from collections.abc import Generator, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from corpus_tools.batch.cluster import over_cluster
from corpus_tools.cli import console
from corpus_tools.cli.console import Status
from corpus_tools.cli.frames_meter import frames_progress
from corpus_tools.conversion.one_recording import (
    FitSettings,
    Outcome,
    Task,
    fit_here,
    fit_sent,
    inputs,
    kept,
    watched,
    written,
)
from mocap_fit._version import __version__
from mocap_fit.atomic_file import make_folder
from mocap_fit.errors import ConfigurationError
from mocap_fit.fitting.speaker import fit_speaker
from mocap_fit.io import READERS
from mocap_fit.processes import DeadProcess, run_locally


def expand(paths: Sequence[Path]) -> list[Path]:
    """Files that the user means: themselves, those of a folder, or those of a pattern.

    Shells on Windows do not expand patterns, so they are expanded here.

    Raises
    ------
    ConfigurationError
        If a folder or a pattern holds no recording, or two recordings have one name.
    """
    known = {ending for name in READERS.names() for ending in READERS.get(name).extensions}
    files: list[Path] = []
    for path in paths:
        if path.is_dir():
            found = sorted(f for f in path.iterdir() if f.suffix.lower() in known and f.is_file())
        elif not path.exists() and glob.has_magic(str(path)):
            found = sorted(Path(name) for name in glob.glob(str(path)))
        else:
            found = [path]
        if not found:
            raise ConfigurationError(
                "no recording is there",
                path=str(path),
                expected=f"files that end in {', '.join(sorted(known))}",
            )
        files += found
    files = list(dict.fromkeys(files))
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


def run(
    recordings: Sequence[Path],
    *,
    reference: Path,
    layout: str,
    out: Path,
    face: str = "built-in",
    settings: FitSettings | None = None,
    jobs: int = 1,
    cluster: str | None = None,
    fresh: bool = False,
    as_json: bool = False,
) -> Status:
    """Fit recordings and write ``OUT/ID.parquet`` for each.

    A recording that cannot be fitted is named on stderr and does not keep the others from it.
    One that a former run fitted, from the same bytes in the same way, is not fitted again.

    Parameters
    ----------
    recordings
        Files, folders or patterns.
    reference
        A recording of the reference pose; the median over its frames is used.
    layout
        A layout's name or file.
    out
        The folder to write to; made where it is not there.
    face
        ``built-in``, or a rig file.
    settings
        Keywords of `Speaker.fit_shape`.
    jobs
        How many processes; 0 for as many as the machine has cores.
    cluster
        Address of a dask scheduler whose workers fit instead.
    fresh
        Fit also what is fitted already.
    as_json
        Print what was done as one JSON object on stdout.

    Returns
    -------
    Status
        `BAD_DATA` if any recording was not fitted.
    """
    began = time.perf_counter()
    files = expand(recordings)
    speaker = fit_speaker(face, layout, reference)
    make_folder(out)
    settings = settings or {}
    task = Task(speaker, settings, speaker.compute_fingerprint(**settings), fresh)
    targets = [out / f"{file.stem}.parquet" for file in files]
    _remove_partial(targets)
    seconds = {"speaker": time.perf_counter() - began}
    try:
        outcomes = _fit_all(task, files, targets, jobs, cluster)
    finally:
        # A process that is ended in the middle of writing leaves its part behind.
        _remove_partial(targets)
    rows: list[dict[str, Any]] = []
    for file, target, outcome in zip(files, targets, outcomes, strict=True):
        output = {} if "error" in outcome.figures else {"output": target}
        rows.append({"recording": file.stem, "file": file, **output, **outcome.figures})
        for part, length in outcome.seconds.items():
            seconds[part] = seconds.get(part, 0.0) + length
    orientation = speaker.binding.orientation
    if as_json:
        console.print_json(
            {
                "layout": speaker.layout.name,
                "scale": orientation.scale,
                "orientation_residuals_mm": dict(orientation.residuals or {}),
                "recordings": rows,
                # Summed over the processes, but for the last.
                "seconds": {**seconds, "elapsed": time.perf_counter() - began},
            }
        )
    else:
        _show(rows, out)
    return Status.BAD_DATA if any("error" in row for row in rows) else Status.DONE


def _remove_partial(targets: Sequence[Path]) -> None:
    """Remove what killed processes left of these files."""
    for folder in {target.parent for target in targets}:
        ours = {f".{target.name}" for target in targets if target.parent == folder}
        for path in folder.glob(".*.partial"):
            if path.name.removesuffix(".partial").rpartition(".")[0] in ours:
                path.unlink(missing_ok=True)


def _fit_all(
    task: Task, files: Sequence[Path], targets: Sequence[Path], jobs: int, cluster: str | None
) -> list[Outcome]:
    """Fit the recordings; what is told of them comes in their order."""
    outcomes: dict[int, Outcome] = {}
    told = 0
    pairs = list(zip(files, targets, strict=True))
    with frames_progress("fitting recordings", [_size(file) for file in files]) as meter:
        if cluster is not None:
            results = _on_cluster(task, pairs, cluster)
        else:
            results = run_locally(fit_here, task, pairs, jobs, meter.told)
        with contextlib.closing(results):
            for index, result in results:
                if isinstance(result, DeadProcess):
                    result = Outcome(
                        {"error": f"{files[index]}: it was not fitted: {result.reason}"}
                    )
                outcomes[index] = result
                while told in outcomes:
                    _tell(outcomes[told], files[told])
                    told += 1
                figures = result.figures
                fitted = 0 if figures.get("kept", True) else figures["frames"]
                meter.done(index, fitted)
    return [outcomes[index] for index in range(len(files))]


def _size(file: Path) -> int:
    """How much work a recording is, next to others; one that is not there is found out later."""
    with contextlib.suppress(OSError):
        return max(1, file.stat().st_size)
    return 1


def _tell(outcome: Outcome, file: Path) -> None:
    for line in outcome.warnings:
        console.say(f"warning: {file.stem}: {line}")
    if outcome.traceback is not None:
        console.show_traceback(outcome.traceback)
    if "error" in outcome.figures:
        console.say(f"error: {outcome.figures['error']}")


def _on_cluster(
    task: Task, pairs: Sequence[tuple[Path, Path]], address: str
) -> Generator[tuple[int, Outcome | DeadProcess], None, None]:
    """Send the recordings' content to a cluster, and write what comes back."""
    here: dict[int, Outcome] = {}
    places: list[int] = []

    def to_send() -> Iterator[tuple[str, str, bytes]]:
        for index, (file, target) in enumerate(pairs):
            sent: list[tuple[str, str, bytes]] = []

            def work(
                seconds: dict[str, float],
                file: Path = file,
                target: Path = target,
                sent: list[tuple[str, str, bytes]] = sent,
            ) -> Outcome:
                content = file.read_bytes()
                made_from = inputs(task, file.name, hashlib.sha256(content).hexdigest())
                figures = None if task.fresh else kept(target, made_from)
                if figures is None:
                    sent.append((file.name, made_from, content))
                return Outcome(figures or {})

            outcome = watched(work, file)
            if not sent:
                here[index] = outcome
                continue
            places.append(index)
            yield sent[0]

    results = over_cluster(fit_sent, task, to_send(), address, __version__)
    with contextlib.closing(results):
        for place, result in results:
            index = places[place]
            if isinstance(result, Outcome):
                result = written(result, *pairs[index])
            yield index, result
            yield from _taken(here)
    yield from _taken(here)


def _taken(outcomes: dict[int, Outcome]) -> Iterator[tuple[int, Outcome]]:
    while outcomes:
        yield outcomes.popitem()


_COLUMNS = {
    "frames": "frames",
    "fitted": "fitted",
    "residual_mm": "residual mm",
    "head_residual_mm": "head mm",
    "uncertain_frames": "uncertain",
    "evaluations_per_frame": "evaluations",
}
# More recordings than this are summed up, and only the worst are listed.
_LISTED = 20


def _show(rows: list[dict[str, Any]], out: Path) -> None:
    from rich import box
    from rich.table import Table

    done = [row for row in rows if "error" not in row]
    if not done:
        return
    listed, title = done, None
    if len(done) > _LISTED:
        listed = sorted(done, key=lambda row: -float(row["residual_mm"]))[:5]
        title = f"the {len(listed)} recordings with the largest residuals"
    table = Table(title=title, title_justify="left", box=box.SIMPLE_HEAD, pad_edge=False)
    table.add_column("recording", no_wrap=True)
    for label in _COLUMNS.values():
        table.add_column(label, justify="right")
    for row in listed:
        cells = [row[key] for key in _COLUMNS]
        table.add_row(
            row["recording"], *(f"{c:.2f}" if isinstance(c, float) else str(c) for c in cells)
        )
    screen = console.screen()
    screen.print(table)
    frames, fitted = (sum(row[key] for row in done) for key in ("frames", "fitted"))
    middle = float(np.median([row["residual_mm"] for row in done]))
    former = sum(row["kept"] for row in done)
    before = f" ({former} of them before)" if former else ""
    screen.print(
        f"{len(done)} of {len(rows)} recordings fitted{before}: {fitted} of {frames} frames, "
        f"median residual {middle:.2f} mm. Parameters are in {out}.",
        soft_wrap=True,
    )
