"""Run a job over many items: skip what an earlier run has done, and keep each error to its item."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Mapping, Sequence, Set
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from corpus_tools.batch.cluster import Done, run_on_cluster
from corpus_tools.batch.item import Context, Item, ItemResult, Job, try_item
from corpus_tools.batch.parcel import Parcel, process_parcel
from corpus_tools.batch.progress import BatchProgress, Tracker
from mocap_fit._version import __version__
from mocap_fit.atomic_file import check_targets, make_folder, write_atomically
from mocap_fit.fitting.memory import free_memory
from mocap_fit.processes import DeadProcess, count_cores, run_locally
from mocap_fit.size_limit import get_largest_size, sum_file
from mocap_fit.tracks.parquet_file import read_description


@dataclass(frozen=True, eq=False)
class _Batch:
    """What the processes share."""

    job: Job[Any]
    out: Path
    fresh: bool
    processes: int
    free_memory: int | None


def run_batch(
    job: Job[Any],
    items: Sequence[Item],
    out: Path,
    *,
    jobs: int = 1,
    cluster: str | None = None,
    fresh: bool = False,
    progress: Callable[[BatchProgress], object] | None = None,
) -> tuple[ItemResult, ...]:
    """Process items, and write what comes of each as soon as it is there.

    An item that an earlier run has processed in the same way from the same files is skipped: the
    last step of its results holds a fingerprint of both. An item that cannot be processed does not
    keep the others from it.

    Parameters
    ----------
    job
        What is done with every item.
    items
        The items.
    out
        Folder of the results; created where it does not exist.
    jobs
        Number of processes; 0 for one per core.
    cluster
        Address of a dask scheduler whose workers do the work in place of this machine.
    fresh
        Whether items are processed again that an earlier run has processed.
    progress
        Called with the state of the batch after every change.

    Returns
    -------
    tuple[ItemResult, ...]
        One result per item, in their order.

    Raises
    ------
    ConfigurationError
        If a folder cannot be made, a target is a source, or the cluster does not answer.
    MissingExtraError
        If a cluster is wanted and dask.distributed is not installed.
    """
    targets = {out / target for item in items for target in item.targets}
    check_targets(targets, (item.folder / path for item in items for path in item.sources))
    for folder in sorted({out, *(target.parent for target in targets)}):
        make_folder(folder)
    processes = 1 if cluster is not None else max(1, min(jobs or count_cores(), len(items)))
    batch = _Batch(job, out, fresh, processes, free_memory() if processes > 1 else None)
    tracker = Tracker([_measure(item) for item in items], progress)
    _remove_partial(targets)
    try:
        if cluster is not None:
            stream = run_on_cluster(process_parcel, job, _pack(batch, items), cluster, __version__)
        else:
            stream = run_locally(_process_here, batch, items, processes, tracker.update)
        with contextlib.closing(stream):
            for index, result in stream:
                tracker.finish(index, _receive(items[index], result, out))
    finally:
        # A process that is ended while it writes leaves an unfinished file behind.
        _remove_partial(targets)
    return tracker.results


def _measure(item: Item) -> int:
    """Return the size of an item's first source; a missing one is reported later."""
    with contextlib.suppress(OSError):
        return max(1, (item.folder / item.sources[0]).stat().st_size)
    return 1


def _remove_partial(targets: Set[Path]) -> None:
    """Remove the unfinished files that killed processes have left of the targets."""
    for folder in {target.parent for target in targets}:
        for path in folder.glob(".*.partial"):
            name = path.name.removeprefix(".").removesuffix(".partial").rpartition(".")[0]
            if folder / name in targets:
                path.unlink(missing_ok=True)


def _process_here(batch: _Batch, item: Item, progress: Callable[[int, int], object]) -> ItemResult:
    """Process an item whose files this process can read and write."""
    context = Context(
        item,
        item.folder,
        batch.out,
        progress,
        processes=batch.processes,
        free_memory=batch.free_memory,
    )
    cached = None

    def process_item() -> Mapping[str, Any]:
        nonlocal cached
        with context.time("reading"):
            sums = {path: sum_file(item.folder / path) for path in item.sources}
            context.fingerprint = batch.job.compute_fingerprint(item, sums)
            cached = _read_cached(batch, item, context.fingerprint)
        return batch.job.process(item, context) if cached is None else cached

    result = try_item(context, process_item)
    return replace(result, cached=cached is not None)


def _read_cached(batch: _Batch, item: Item, fingerprint: str) -> Mapping[str, Any] | None:
    """Return the figures of an item that an earlier run has processed; None where none has."""
    figures: Mapping[str, Any] = {}
    for target in item.targets:
        if batch.fresh or not target.endswith(".parquet"):
            continue
        steps = (read_description(batch.out / target) or {}).get("provenance")
        step = steps[-1] if isinstance(steps, list) and steps else {}
        figures = step.get("arguments", {})
        if step.get("step") != batch.job.step or figures.get("inputs") != fingerprint:
            return None
    if batch.fresh or not batch.job.is_complete(item, batch.out, figures):
        return None
    return figures


def _pack(batch: _Batch, items: Sequence[Item]) -> Iterator[Parcel | Done]:
    """Pack the items for a cluster, but for those that are done or cannot be read."""
    for item in items:
        context = Context(item, item.folder, batch.out, lambda done, of: None)
        parcel: Parcel | None = None

        def sum_item(item: Item = item) -> Mapping[str, Any]:
            nonlocal parcel
            sums = {path: sum_file(item.folder / path) for path in item.sources}
            fingerprint = batch.job.compute_fingerprint(item, sums)
            cached = _read_cached(batch, item, fingerprint)
            if cached is None:
                parcel = Parcel(item, fingerprint, sums, get_largest_size())
            return cached or {}

        result = try_item(context, sum_item)
        yield parcel or Done(replace(result, cached=result.error is None))


def _receive(item: Item, result: ItemResult | DeadProcess, out: Path) -> ItemResult:
    """Write the files that a cluster has sent, and name the item whose process died."""
    if isinstance(result, DeadProcess):
        source = f"{item.prefix}{item.sources[0]}"
        return ItemResult(item.name, error=f"{source}: it was not processed: {result.reason}")
    if not result.files:
        return result
    context = Context(item, item.folder, out, lambda done, of: None, seconds=dict(result.seconds))

    def write_files() -> Mapping[str, Any]:
        with context.time("writing"):
            for target in item.targets:
                if target in result.files:
                    with write_atomically(out / target) as partial:
                        partial.write_bytes(result.files[target])
        return result.figures

    written = try_item(context, write_files)
    return replace(written, warnings=(*result.warnings, *written.warnings))
