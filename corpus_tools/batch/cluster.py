"""Work on many items over a dask cluster, as `mocap_fit.processes` does on this machine."""

from __future__ import annotations

import contextlib
import logging
import threading
import warnings
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from mocap_fit.errors import ConfigurationError, MissingExtraError
from mocap_fit.processes import DeadProcess, Results, Work

# Seconds within which a scheduler and its workers must answer.
_PATIENCE = 8


@dataclass(frozen=True, eq=False)
class Done:
    """In place of an item: its result, which needs no worker.

    Parameters
    ----------
    result
        The result.
    """

    result: Any


def run_on_cluster(
    work: Work, shared: Any, items: Iterable[Any], address: str, version: str
) -> Results:
    """Work over the workers of a dask cluster, which share neither memory nor disk with us.

    Parameters
    ----------
    work
        A function at the top of a module: ``work(shared, item, progress)``.
    shared
        What it needs for every item; sent to each worker once.
    items
        Taken one by one as workers become free, so they may be created lazily; `Done` in place of
        an item is passed through.
    address
        Where the scheduler listens, such as ``tcp://192.168.0.7:8786``.
    version
        The version of mocap-fit that the workers must have.

    Yields
    ------
    tuple
        Index and result; `DeadProcess` where the cluster lost it.

    Raises
    ------
    MissingExtraError
        If dask.distributed is not installed.
    ConfigurationError
        If the scheduler does not answer, or has no workers that can do the work.
    """
    try:
        import distributed
    except ImportError:
        raise MissingExtraError(
            "working on a dask cluster needs dask.distributed",
            advice="Install it with pip install 'mocap-fit[dask]'.",
        ) from None
    # Its log says in many lines what our messages say in one.
    logging.getLogger("distributed").setLevel(logging.CRITICAL)
    client = _connect(distributed, address)
    under_way: dict[Any, int] = {}
    news = threading.Event()
    try:
        _check_workers(client, address, version)
        scattered = client.scatter(shared, broadcast=True, hash=False)
        waiting = enumerate(items)
        more = True
        while more or under_way:
            while more and len(under_way) < 2 * max(1, len(client.nthreads())):
                index, item = next(waiting, (-1, None))
                if isinstance(item, Done):
                    yield index, item.result
                elif index >= 0:
                    future = _submit(client, work, scattered, item)
                    under_way[future] = index
                    future.add_done_callback(lambda _: news.set())
                else:
                    more = False
            # The timeout is for a connection that was lost.
            if under_way:
                news.wait(_PATIENCE)
            news.clear()
            ended = [future for future in under_way if future.status != "pending"]
            for future in sorted(ended, key=under_way.__getitem__):
                yield under_way.pop(future), _fetch_result(distributed, future)
    finally:
        with contextlib.suppress(Exception):
            client.cancel(list(under_way))
        client.close(timeout=2)


def _submit(client: Any, work: Work, scattered: Any, item: Any) -> Any:
    with warnings.catch_warnings():
        # A recording is large, and dask warns that it should be on a disk.
        warnings.simplefilter("ignore", UserWarning)
        return client.submit(_run_item, work, scattered, item, pure=False)


def _connect(distributed: Any, address: str) -> Any:
    try:
        return distributed.Client(address, timeout=_PATIENCE, set_as_default=False)
    except (OSError, TimeoutError, ValueError, ImportError) as error:
        raise ConfigurationError(
            f"the dask scheduler at {address} does not answer",
            found=next(iter(str(error).splitlines()), type(error).__name__),
            expected="an address such as tcp://192.168.0.7:8786",
            advice="Start one with `dask scheduler`, and workers with `dask worker ADDRESS`.",
        ) from None


def _check_workers(client: Any, address: str, version: str) -> None:
    """Refuse a cluster whose workers cannot do what we would do here."""
    try:
        client.wait_for_workers(1, timeout=_PATIENCE)
    except TimeoutError:
        raise ConfigurationError(
            f"the dask scheduler at {address} has no workers",
            advice=f"Start some with `dask worker {address}`.",
        ) from None
    try:
        versions = set(client.run(_get_version).values())
    except Exception as error:
        versions = {f"{type(error).__name__}: {error}"}
    if versions != {version}:
        raise ConfigurationError(
            "the workers of the cluster do not have this version of mocap-fit",
            found=", ".join(sorted(versions)),
            expected=version,
            advice="Install the same version on every machine.",
        )


def _get_version() -> str:
    from mocap_fit._version import __version__

    return __version__


# A worker may have several threads, but warnings are caught for the complete process.
_one_at_a_time = threading.Lock()


def _run_item(work: Work, shared: Any, item: Any) -> Any:
    with _one_at_a_time:
        return work(shared, item, lambda done, of: None)


def _fetch_result(distributed: Any, future: Any) -> Any:
    if future.status == "finished":
        return future.result()
    if future.status == "error":
        error = future.exception()
        if not isinstance(error, distributed.scheduler.KilledWorker):
            raise error
    return DeadProcess("the cluster lost the worker that worked on it")
