"""Work on many items over a dask cluster, as `mocap_fit.processes` does on this machine."""

from __future__ import annotations

import contextlib
import logging
import threading
import time
import warnings
from collections import deque
from collections.abc import Iterable
from concurrent.futures import CancelledError
from dataclasses import dataclass, field
from typing import Any

from mocap_fit.errors import ConfigurationError, MissingExtraError
from mocap_fit.processes import DeadProcess, Results, Work

_Errors = tuple[type[Exception], ...]

# Seconds within which a scheduler and its workers must answer.
_PATIENCE = 8
# Seconds between two looks at which workers there are.
_POLL = 0.5
# Seconds within which a scheduler that was lost must be back, and one of the workers if all were:
# on a busy machine Python starts slowly.
_SCHEDULER_BACK, _WORKERS_BACK = 30.0, 300.0
# Items that a worker has at a time, so that it never waits for one.
_AHEAD = 2


@dataclass(frozen=True, eq=False)
class Done:
    """In place of an item: its result, which needs no worker.

    Parameters
    ----------
    result
        The result.
    """

    result: Any


@dataclass(frozen=True)
class ContentNeeded:
    """In place of a result: the worker cannot open the files of the item, which must be sent."""


def run_on_cluster(
    work: Work, shared: Any, items: Iterable[Any], address: str, version: str
) -> Results:
    """Work over the workers of a dask cluster, which share neither memory nor disk with us.

    Parameters
    ----------
    work
        A function at the top of a module: ``work(shared, item, progress)``. Where it returns
        `ContentNeeded`, it is called again with ``item.load()``, which may be `Done`.
    shared
        What it needs for every item; sent to each worker once.
    items
        Taken one by one as workers become free, so they may be created lazily; `Done` in place of
        an item is passed through.
    address
        Where the scheduler listens, such as ``tcp://192.168.0.7:8786`` or ``tls://…``.
    version
        The version of mocap-fit that the workers must have.

    Yields
    ------
    tuple
        Index and result; `DeadProcess` where the worker ended that worked on it.

    Raises
    ------
    MissingExtraError
        If dask.distributed is not installed.
    ConfigurationError
        If the scheduler does not answer, or has no workers that can do the work, at the beginning
        or later.

    Notes
    -----
    The shared data are sent to each worker by itself, and an item goes to one worker: dask cancels
    what a worker had when it dies, and does not try it on the others until they are dead too.
    What it had is then tried again, each item alone on a worker, and the one that kills its worker
    again is the one. A worker that is started in place of a dead one is used as any other.
    """
    try:
        import distributed
    except ImportError:
        raise MissingExtraError(
            "working on a dask cluster needs dask.distributed",
            advice="Install it with pip install 'mocap-fit[dask]'.",
        ) from None
    # Its log says in many lines what our messages say in one.
    for name in ("distributed", "distributed.client"):
        logging.getLogger(name).setLevel(logging.CRITICAL)
    client = _connect(distributed, address)
    lost = (distributed.KilledWorker, CancelledError, TimeoutError, OSError)
    run = _Run(client, work, shared, address, version, lost)
    try:
        yield from run.process(items)
    finally:
        with contextlib.suppress(Exception):
            client.cancel([future for worker in run.workers.values() for future in worker.items])
        client.close(timeout=2)


def _connect(distributed: Any, address: str) -> Any:
    try:
        return distributed.Client(address, timeout=_PATIENCE, set_as_default=False)
    # A TypeError where an address needs certificates or a library that are not there.
    except (OSError, TimeoutError, ValueError, ImportError, TypeError) as error:
        advice = "Start one with `dask scheduler`, and workers with `dask worker ADDRESS`."
        if address.startswith(("tls://", "wss://")):
            advice += " The certificates are those of dask's configuration, distributed.comm.tls."
        raise ConfigurationError(
            f"the dask scheduler at {address} does not answer",
            found=next(iter(str(error).splitlines()), type(error).__name__),
            expected="an address such as tcp://192.168.0.7:8786",
            advice=advice,
        ) from None


@dataclass(eq=False)
class _Worker:
    """A worker: the shared data that it has, and the items that it is at."""

    shared: Any
    items: dict[Any, tuple[int, Any]] = field(default_factory=dict)
    opens_files: bool = True
    has_suspect: bool = False
    is_gone: bool = False


class _Run:
    """The work on the items: which worker has which, and what is tried again."""

    def __init__(
        self, client: Any, work: Work, shared: Any, address: str, version: str, lost: _Errors
    ) -> None:
        # What the client raises in place of a result that has gone with its worker.
        self.lost = lost
        self.client, self.work, self.shared = client, work, shared
        self.address, self.version = address, version
        self.workers: dict[str, _Worker] = {}
        self.suspects: deque[tuple[int, Any]] = deque()
        self.news = threading.Event()
        self.last_seen = time.monotonic()

    def process(self, items: Iterable[Any]) -> Results:
        """Yield the results of all items."""
        try:
            self.client.wait_for_workers(1, timeout=_PATIENCE)
        except TimeoutError:
            raise ConfigurationError(
                f"the dask scheduler at {self.address} has no workers",
                advice=f"Start some with `dask worker {self.address}`.",
            ) from None
        waiting = enumerate(items)
        more = True
        while more or self.suspects or any(worker.items for worker in self.workers.values()):
            self._update_workers()
            for name, worker in self.workers.items():
                while not worker.is_gone and self._is_free(worker):
                    suspect = self.suspects.popleft() if self.suspects else None
                    index, item = suspect or next(waiting, (-1, None))
                    if index < 0:
                        more = False
                        break
                    worker.has_suspect = suspect is not None
                    yield from self._submit(name, worker, index, item)
            self.news.wait(_POLL)
            self.news.clear()
            for name, worker in self.workers.items():
                yield from self._collect(name, worker)

    def _update_workers(self) -> None:
        """Note which workers have gone, and send the shared data to new ones."""
        patience = _WORKERS_BACK
        try:
            present = {name for name, threads in self.client.nthreads().items() if threads}
        except (OSError, TimeoutError):
            present, patience = set(), _SCHEDULER_BACK
        for name, worker in list(self.workers.items()):
            if worker.is_gone and not worker.items:
                del self.workers[name]
        for name in self.workers.keys() - present:
            self.workers[name].is_gone = True
        new = list(present - self.workers.keys())
        answers = self.client.run(_get_version, workers=new, on_error="return") if new else {}
        # One that does not answer has died again.
        answers = {name: a for name, a in answers.items() if not isinstance(a, OSError)}
        self._check_versions(answers.values())
        for name in answers:
            # A worker that has died since is unknown.
            with contextlib.suppress(KeyError, OSError, TimeoutError):
                scattered = self.client.scatter(self.shared, workers=[name], hash=False)
                self.workers[name] = _Worker(scattered)
        if self.workers:
            self.last_seen = time.monotonic()
        elif time.monotonic() - self.last_seen > patience:
            raise ConfigurationError(
                f"the dask scheduler at {self.address} has ended, or has no workers any more",
                advice="Start them again, and run this again: what is done is not done twice.",
            )

    def _check_versions(self, answers: Iterable[Any]) -> None:
        """Refuse workers that cannot do what we would do here."""
        texts = {a if isinstance(a, str) else f"{type(a).__name__}: {a}" for a in answers}
        if texts - {self.version}:
            raise ConfigurationError(
                "the workers of the cluster do not have this version of mocap-fit",
                found=", ".join(sorted(texts)),
                expected=self.version,
                advice="Install the same version on every machine.",
            )

    def _is_free(self, worker: _Worker) -> bool:
        """Whether a worker takes an item: a suspect if there is one, and that one alone."""
        if self.suspects or worker.has_suspect:
            return not worker.items
        return len(worker.items) < _AHEAD

    def _submit(self, name: str, worker: _Worker, index: int, item: Any) -> Results:
        """Send an item to a worker; yield its result where it needs none."""
        sent = item if isinstance(item, Done) or worker.opens_files else item.load()
        if isinstance(sent, Done):
            yield index, sent.result
            return
        with warnings.catch_warnings():
            # A recording is large, and dask warns that it should be on a disk.
            warnings.simplefilter("ignore", UserWarning)
            future = self.client.submit(
                _run_item, self.work, worker.shared, sent, workers=[name], pure=False
            )
        worker.items[future] = index, item
        future.add_done_callback(lambda _: self.news.set())

    def _collect(self, name: str, worker: _Worker) -> Results:
        """Yield the results that a worker has, and note what was lost with it."""
        ended = [f for f in worker.items if worker.is_gone or f.status != "pending"]
        for future in sorted(ended, key=lambda future: worker.items[future][0]):
            index, item = worker.items.pop(future)
            try:
                result = future.result(timeout=_PATIENCE)
            except self.lost:
                if worker.has_suspect:
                    reason = "the worker of the cluster was killed, or ran out of memory"
                    yield index, DeadProcess(reason)
                else:
                    self.suspects.append((index, item))
                continue
            if isinstance(result, ContentNeeded):
                worker.opens_files = False
                yield from self._submit(name, worker, index, item)
            else:
                yield index, result


def _get_version() -> str:
    from mocap_fit._version import __version__

    return __version__


# A worker may have several threads, but warnings are caught for the complete process.
_one_at_a_time = threading.Lock()


def _run_item(work: Work, shared: Any, item: Any) -> Any:
    with _one_at_a_time:
        return work(shared, item, lambda done, of: None)
