"""``mocap-fit convert``: recordings, labels and sound → a corpus."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Generator, Iterator, Mapping, Sequence
from pathlib import Path

from corpus_tools.batch.cluster import over_cluster
from corpus_tools.cli import console
from corpus_tools.cli.console import Status
from corpus_tools.cli.frames_meter import frames_progress
from corpus_tools.conversion.gather import finish, former_splits, open_folder
from corpus_tools.conversion.manifest import Manifest, entries, load_manifest, recorded
from corpus_tools.conversion.plan import Job, Plan, make_plan
from corpus_tools.conversion.report import lines_of, show, tell
from corpus_tools.conversion.utterance import (
    Outcome,
    Task,
    convert_here,
    convert_sent,
    file_sums,
    kept,
    make_folders,
    write_sent,
)
from mocap_fit._version import __version__
from mocap_fit.errors import ConfigurationError, MocapFitError, describe_error
from mocap_fit.phones import list_phone_sets
from mocap_fit.processes import DeadProcess, run_locally

MANIFEST = "manifest.toml"


def run(
    manifest: Path,
    *,
    root: Path | None = None,
    out: Path,
    phone_set: str | None = None,
    layout: str | None = None,
    jobs: int = 1,
    cluster: str | None = None,
    fresh: bool = False,
    as_json: bool = False,
) -> Status:
    """Convert a folder of recordings, labels and sound to a corpus.

    A bad utterance is named on stderr and left out, and the rest goes on. What a former run has
    converted from the same bytes in the same way is kept; what is not in the manifest any more
    vanishes.

    Parameters
    ----------
    manifest
        The TOML file, or a folder: its ``manifest.toml``, or without one the folder convention.
    root
        What paths in the manifest are under; the manifest's folder where not given.
    out
        The corpus: a new folder, or a former corpus.
    phone_set, layout
        In place of the manifest's; without a manifest there must be a phone set.
    jobs
        How many processes; 0 for as many as the machine has cores.
    cluster
        Address of a dask scheduler whose workers convert instead.
    fresh
        Convert also what is converted already.
    as_json
        Print what was done as one JSON object on stdout.

    Returns
    -------
    Status
        `BAD_DATA` if any utterance was left out.

    Raises
    ------
    MocapFitError
        If the manifest, the table of sentences, the phone set, the layout or the face cannot be
        used, or a folder is in the way.
    """
    began = time.perf_counter()
    said, base = _manifest(manifest, phone_set, layout)
    base = base if root is None else root
    if not base.is_dir():
        raise ConfigurationError(
            "the folder of recordings is not there", path=base, advice="Give it as --root."
        )
    found = entries(said, base, former_splits(out, said))
    plan = make_plan(said, found, base, fresh=fresh)
    with open_folder(out):
        make_folders(out)
        outcomes = dict(_convert_all(plan, Task(plan.settings, base, out), jobs, cluster))
        told = {**{name: Outcome({}, line) for name, line in plan.refused.items()}, **outcomes}
        left = sorted(set(recorded(said, base)) - {entry.id for entry in found})
        for line in lines_of(told, left):
            console.say(line)
        removed = finish(plan, told, out)
    figures = {"out": str(out), "removed": removed, "seconds": time.perf_counter() - began}
    if as_json:
        console.print_json({**figures, **tell(plan.entries, told)})
    else:
        show(plan.entries, told, figures)
    return Status.BAD_DATA if any(o.error is not None for o in told.values()) else Status.DONE


def _manifest(path: Path, phone_set: str | None, layout: str | None) -> tuple[Manifest, Path]:
    """The manifest, and the folder that its paths are under."""
    changes = {"phone_set": phone_set, "layout": layout}
    given = {key: value for key, value in changes.items() if value is not None}
    if path.is_dir() and (path / MANIFEST).is_file():
        path = path / MANIFEST
    if not path.is_dir():
        said = load_manifest(path)
        return said.model_copy(update=given), path.parent
    if phone_set is None:
        raise ConfigurationError(
            f"there is no {MANIFEST}, and nothing says which phones the labels are written in",
            path=path,
            expected=f"--phone-set with one of {', '.join(list_phone_sets())}, or a file",
        )
    return Manifest.model_validate(given), path


def _convert_all(
    plan: Plan, task: Task, jobs: int, cluster: str | None
) -> Iterator[tuple[str, Outcome]]:
    items = plan.jobs
    sizes = [_size(task.root, job) for job in items]
    if not items:
        return
    with frames_progress("converting utterances", sizes) as meter:
        if cluster is not None:
            results = _on_cluster(task, items, cluster)
        else:
            results = run_locally(convert_here, task, items, jobs, meter.told)
        with contextlib.closing(results):
            for index, result in results:
                if isinstance(result, DeadProcess):
                    result = Outcome({}, f"it was not converted: {result.reason}")
                if result.traceback is not None:
                    console.show_traceback(result.traceback)
                figures = result.figures
                made = 0 if figures.get("kept", True) else figures["frames"]
                meter.done(index, made)
                yield items[index].entry.id, result


def _size(root: Path, job: Job) -> int:
    """How much work an utterance is, next to others."""
    with contextlib.suppress(OSError):
        return max(1, (root / job.recording).stat().st_size)
    return 1


def _on_cluster(
    task: Task, jobs: Sequence[Job], address: str
) -> Generator[tuple[int, Outcome | DeadProcess], None, None]:
    """Send the files' content to a cluster, and write what comes back."""
    here: dict[int, Outcome] = {}
    places: list[int] = []

    def to_send() -> Iterator[tuple[Job, str, Mapping[str, bytes]]]:
        for index, job in enumerate(jobs):
            try:
                inputs = task.settings.inputs(job, file_sums(task.root, job))
                known = None if task.settings.fresh else kept(task.out, job, inputs)
                if known is not None:
                    here[index] = Outcome(known)
                    continue
                contents = {path: (task.root / path).read_bytes() for path in job.files}
            except OSError as error:
                here[index] = Outcome({}, describe_error(error))
                continue
            places.append(index)
            yield job, inputs, contents

    results = over_cluster(convert_sent, task, to_send(), address, __version__)
    with contextlib.closing(results):
        for place, result in results:
            index = places[place]
            if isinstance(result, Outcome) and result.error is None and result.files:
                try:
                    write_sent(task.out, jobs[index], result.files)
                except MocapFitError as error:
                    result = Outcome({}, str(error))
            yield index, result
            yield from _taken(here)
    yield from _taken(here)


def _taken(outcomes: dict[int, Outcome]) -> Iterator[tuple[int, Outcome]]:
    while outcomes:
        yield outcomes.popitem()
