"""Work on many items in processes of this machine.

The work is a function at the top of a module, ``work(shared, item, progress)``; it may call
``progress(done, total)``. Results come as ``(index, result)`` when items are done, in any order,
with a bounded number of items in progress, so that memory does not grow with their number.
"""

from __future__ import annotations

import contextlib
import gc
import multiprocessing
import os
import signal
import sys
import threading
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from functools import partial
from typing import Any

Work = Callable[[Any, Any, Callable[[int, int], object]], Any]
Progress = Callable[[int, int, int], object]
Results = Generator[tuple[int, Any], None, None]

# Seconds between two looks at the progress of the processes.
_POLL = 0.2
# Windows cannot wait for more processes than this.
_MOST_PROCESSES = 60


@dataclass(frozen=True)
class DeadProcess:
    """The result of an item whose process ended without one.

    Parameters
    ----------
    reason
        What probably happened, for a message.
    """

    reason: str


def limit_threads() -> None:
    """Make libraries that are not loaded yet use one thread a process.

    The matrices of a frame are small, and processes would compete for the cores. Processes that
    are started later inherit the setting.
    """
    for library in ("OMP", "OPENBLAS", "MKL", "VECLIB_MAXIMUM"):
        os.environ[f"{library}_NUM_THREADS"] = "1"
    # pyarrow begins a thread when it is imported, for an allocator that it does not use.
    os.environ["JE_ARROW_MALLOC_CONF"] = "background_thread:false"


_blas_lock = threading.Lock()
# Libraries, and the numbers of threads to restore when the last context is left.
_former_threads: list[tuple[Any, int]] = []
_blas_contexts = 0


@contextlib.contextmanager
def limit_to_one_thread() -> Iterator[None]:
    """Limit BLAS to one thread, so that its sums do not depend on the number of cores.

    It holds while any thread of the program is in such a context; it also decorates functions.

    Yields
    ------
    None
        The former numbers of threads return when the last context is left.
    """
    import scipy.linalg  # noqa: F401  # Its BLAS is limited only once it is loaded.
    from threadpoolctl import ThreadpoolController

    global _blas_contexts
    libraries = ThreadpoolController().select(user_api="blas").lib_controllers
    with _blas_lock:
        if not _blas_contexts:
            _former_threads[:] = [(library, library.num_threads) for library in libraries]
        _blas_contexts += 1
        for library in libraries:
            _set_threads(library, 1)
    try:
        yield
    finally:
        with _blas_lock:
            _blas_contexts -= 1
            if not _blas_contexts:
                for library, count in _former_threads:
                    _set_threads(library, count)


def _set_threads(library: Any, count: int) -> None:
    # `set_num_threads` of threadpoolctl 3.7 and later obeys only the first thread that called it.
    getattr(library, "_real_set_num_threads", library.set_num_threads)(count)


def count_cores() -> int:
    """Return how many processes can work at once on this machine.

    Returns
    -------
    int
        Number of cores that this process may use.
    """
    usable = getattr(os, "sched_getaffinity", None)
    return len(usable(0)) if usable is not None else os.cpu_count() or 1


def run_locally(
    work: Work, shared: Any, items: Sequence[Any], jobs: int, progress: Progress
) -> Results:
    """Work on items in as many processes as are wanted and useful, or in this one.

    Parameters
    ----------
    work
        A function at the top of a module, ``work(shared, item, progress)``.
    shared
        What the work on all items needs.
    items
        What is worked on.
    jobs
        Number of processes; 0 for one a core, 1 for this process.
    progress
        Called now and then with an item's index, how much of it is done, and of how much.

    Returns
    -------
    generator
        Of index and result; `DeadProcess` where the process that worked on it ended without one.
    """
    processes = min(jobs or count_cores(), len(items))
    if processes > 1:
        return run_in_processes(work, shared, items, processes, progress)
    return (
        (index, work(shared, item, partial(progress, index))) for index, item in enumerate(items)
    )


def run_in_processes(
    work: Work,
    shared: Any,
    items: Iterable[Any],
    jobs: int,
    progress: Progress,
    *,
    copies: bool = True,
    in_order: bool = False,
) -> Results:
    """Work on items in other processes of this machine.

    Parameters
    ----------
    work
        A function at the top of a module, ``work(shared, item, progress)``.
    shared
        What the work on all items needs; every process has a copy, whose changes stay there.
    items
        What is worked on.
    jobs
        Number of processes.
    progress
        Called now and then with an item's index, how much of it is done, and of how much.
    copies
        Whether processes may begin as copies of this one, which OpenGL does not support.
    in_order
        Whether results come in the order of the items, so that large ones need not be stored. A
        slow item then delays the others, and after the death of a process the item that it
        worked on comes late.

    Yields
    ------
    tuple
        Index and result; `DeadProcess` where the process that worked on it ended without one.

    Notes
    -----
    When a process dies it is not known on which item. Those that were in progress are tried again,
    each by itself, and the one that kills its process again is the one.
    """
    waiting = deque(enumerate(items))
    jobs = min(jobs, _MOST_PROCESSES)
    suspects: deque[tuple[int, Any]] = deque()
    while waiting or suspects:
        if not suspects:
            suspects += yield from _run_pool(
                work, shared, waiting, jobs, progress, copies, in_order
            )
            continue
        alone = deque([suspects.popleft()])
        left = yield from _run_pool(work, shared, alone, 1, progress, copies, in_order)
        for index, _ in left:
            yield (
                index,
                DeadProcess("the process that worked on it was killed, or ran out of memory"),
            )


def choose_start_method() -> str:
    """Choose how processes begin: as copies of this one, or anew, which takes a second longer.

    A copy has one thread only, and waits forever for a lock that another one held. So this
    process is copied only while it has no other thread; those of libraries, which Python does not
    count, are included. On macOS the libraries of the system do not support copying.

    Returns
    -------
    str
        ``fork`` or ``spawn``.
    """
    if sys.platform == "linux" and len(os.listdir("/proc/self/task")) == 1:
        return "fork"
    return "spawn"


def _run_pool(
    work: Work,
    shared: Any,
    waiting: deque[tuple[int, Any]],
    jobs: int,
    progress: Progress,
    copies: bool,
    in_order: bool,
) -> Generator[tuple[int, Any], None, list[tuple[int, Any]]]:
    """Work on waiting items until all are done or a process dies; return the unfinished ones."""
    method = choose_start_method() if copies else "spawn"
    context = multiprocessing.get_context(method)
    jobs = min(jobs, len(waiting))
    # More items than processes, so that no process waits. Each item in progress has a slot.
    slots = list(range(2 * jobs))
    counts = context.RawArray("q", 2 * len(slots))
    others = set(multiprocessing.active_children())
    source, sender = (shared, None) if method == "fork" else _open_pipe(context)
    pool = ProcessPoolExecutor(
        jobs, mp_context=context, initializer=_begin, initargs=(work, source, counts)
    )
    in_progress: dict[Future[Any], tuple[int, int, Any]] = {}
    lost: list[tuple[int, Any]] = []
    complete = False
    try:
        while (waiting and not lost) or in_progress:
            while waiting and slots and not lost:
                slot = slots.pop()
                counts[2 * slot] = counts[2 * slot + 1] = 0
                try:
                    with _disable_interrupt():
                        future = pool.submit(_run_item, slot, waiting[0][1])
                except BrokenProcessPool:
                    lost.append(waiting.popleft())
                else:
                    in_progress[future] = (slot, *waiting.popleft())
            if sender is not None:
                _send(shared, jobs, source, sender)
                sender = None
            # A result that was not fetched yet still has its slot: no more items are begun.
            wanted = list(in_progress)[:1] if in_order else list(in_progress)
            done, _ = wait(wanted, timeout=_POLL, return_when=FIRST_COMPLETED)
            for future in sorted(done, key=lambda future: in_progress[future][1]):
                slot, index, item = in_progress.pop(future)
                slots.append(slot)
                try:
                    result = future.result()
                except BrokenProcessPool:
                    lost.append((index, item))
                else:
                    yield index, result
            for slot, index, _ in in_progress.values():
                progress(index, counts[2 * slot], counts[2 * slot + 1])
        complete = True
    finally:
        if not complete:
            for process in set(multiprocessing.active_children()) - others:
                process.terminate()
        pool.shutdown(wait=True, cancel_futures=True)
        if sender is not None:
            sender.close()
    return sorted(lost, key=lambda pair: pair[0])


@dataclass(frozen=True)
class _Receiver:
    """The end of a pipe at which processes that are not copies of this one receive shared data.

    A process that is started is sent little, because whoever starts it waits until it has read
    that; and until 3.12 Python hangs where one dies while another is being started, so that no
    process works before all have started.
    """

    pipe: Any
    lock: Any

    def receive(self) -> Any:
        with self.lock:
            return self.pipe.recv()


def _open_pipe(context: Any) -> tuple[_Receiver, Any]:
    """Return the ends of a pipe at which processes receive, and this one sends."""
    pipe, sender = context.Pipe(duplex=False)
    return _Receiver(pipe, context.Lock()), sender


def _send(shared: Any, processes: int, receiver: _Receiver, sender: Any) -> None:
    """Send shared data to every process, and wait until all have it.

    A queue of multiprocessing would not do: its thread may still be running when the program
    ends, and Python then warns of leaked resources.
    """
    # From now on the processes alone hold the reading end: sending fails when all have ended.
    receiver.pipe.close()
    with sender, contextlib.suppress(BrokenPipeError):
        for _ in range(processes):
            sender.send(shared)


@contextlib.contextmanager
def _disable_interrupt() -> Iterator[None]:
    """Start processes that Ctrl-C does not reach; this process ends them."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


# Work, shared data and counts of a process of the pool; set once, when it begins.
_state: dict[str, Any] = {}


def _begin(work: Work, source: Any, counts: Any) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    # Existing objects are never collected, so that copies go on sharing their memory.
    gc.freeze()
    threading.Thread(target=_end_with_parent, daemon=True).start()
    shared = source.receive() if isinstance(source, _Receiver) else source
    _state.update(work=work, shared=shared, counts=counts)


def _end_with_parent() -> None:
    """End this process when the one that started it is killed."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _run_item(slot: int, item: Any) -> Any:
    counts = _state["counts"]

    def report_progress(done: int, total: int) -> None:
        counts[2 * slot], counts[2 * slot + 1] = done, total

    return _state["work"](_state["shared"], item, report_progress)
