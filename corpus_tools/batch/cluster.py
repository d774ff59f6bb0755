"""Work on many items over a dask cluster, as `processes` does over those of this machine."""

from __future__ import annotations

import contextlib
import logging
import threading
import warnings
from collections.abc import Iterable
from typing import Any

from mocap_fit.errors import ConfigurationError, MissingExtraError
from mocap_fit.processes import DeadProcess, Results, Work

# Seconds within which a scheduler and its workers must answer.
_PATIENCE = 8


def over_cluster(
    work: Work, shared: Any, items: Iterable[Any], address: str, version: str
) -> Results:
    """Work over the workers of a dask cluster, which share neither memory nor disk with us.

    Parameters
    ----------
    work, shared
        As for `run_in_processes`; ``shared`` is sent to each worker once.
    items
        Taken one by one as there is room, so they may be made when they are asked for.
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
    # Its log tells in many lines what we tell in one.
    logging.getLogger("distributed").setLevel(logging.CRITICAL)
    client = _connected(distributed, address)
    under_way: dict[Any, int] = {}
    news = threading.Event()
    try:
        _check_workers(client, address, version)
        there = client.scatter(shared, broadcast=True, hash=False)
        waiting = enumerate(items)
        left = True
        while left or under_way:
            room = 2 * max(1, len(client.nthreads())) if left else 0
            while left and len(under_way) < room:
                pair = next(waiting, None)
                if pair is None:
                    left = False
                    break
                with warnings.catch_warnings():
                    # A long recording is large, and dask would rather have it on a disk.
                    warnings.simplefilter("ignore", UserWarning)
                    future = client.submit(_on_cluster, work, there, pair[1], pure=False)
                under_way[future] = pair[0]
                future.add_done_callback(lambda _: news.set())
            # Looked at now and then also unasked, should the connection be lost.
            news.wait(_PATIENCE)
            news.clear()
            ended = [future for future in under_way if future.status != "pending"]
            for future in sorted(ended, key=under_way.__getitem__):
                index = under_way.pop(future)
                yield index, _result(distributed, future)
                del future
    finally:
        with contextlib.suppress(Exception):
            client.cancel(list(under_way))
        client.close(timeout=2)


def _connected(distributed: Any, address: str) -> Any:
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
        found = set(client.run(_version).values())
    except Exception as error:
        found = {f"{type(error).__name__}: {error}"}
    if found != {version}:
        raise ConfigurationError(
            "the workers of the cluster do not have this version of mocap-fit",
            found=", ".join(sorted(found)),
            expected=version,
            advice="Install the same version on every machine.",
        )


def _version() -> str:
    from mocap_fit._version import __version__

    return __version__


# A worker may have several threads, but what is warned about is kept for the whole process.
_one_at_a_time = threading.Lock()


def _on_cluster(work: Work, shared: Any, item: Any) -> Any:
    with _one_at_a_time:
        return work(shared, item, lambda done, of: None)


def _result(distributed: Any, future: Any) -> Any:
    if future.status == "finished":
        return future.result()
    if future.status == "error":
        error = future.exception()
        if not isinstance(error, distributed.scheduler.KilledWorker):
            raise error
    return DeadProcess("the cluster lost the worker that worked on it")
