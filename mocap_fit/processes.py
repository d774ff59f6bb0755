"""Work on many items over processes of this machine.

The work is a function at the top of a module, ``work(shared, item, told)``; ``told(done, of)``
takes how far the item is. Results come as ``(index, result)`` when items are done, in any order,
with a bounded number of items under way, so that memory does not grow with how many there are.
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
Told = Callable[[int, int, int], object]
Results = Generator[tuple[int, Any], None, None]

# How often who waits looks how far the processes are, in seconds.
_POLL = 0.2
# Windows waits for no more than this many processes.
_MOST_PROCESSES = 60


@dataclass(frozen=True)
class Died:
    """In place of a result: the process that worked on the item is gone."""

    reason: str


def limit_threads() -> None:
    """Let libraries use one thread a process, those that are not loaded yet.

    The matrices of a frame are small, and processes would fight for the cores. Processes that
    are started later inherit it.
    """
    for library in ("OMP", "OPENBLAS", "MKL", "VECLIB_MAXIMUM"):
        os.environ[f"{library}_NUM_THREADS"] = "1"
    # pyarrow begins a thread when it is imported, for an allocator that it does not use.
    os.environ["JE_ARROW_MALLOC_CONF"] = "background_thread:false"


def available_processes() -> int:
    """How many processes can work at once on this machine."""
    usable = getattr(os, "sched_getaffinity", None)
    return len(usable(0)) if usable is not None else os.cpu_count() or 1


def on_this_machine(
    work: Work, shared: Any, items: Sequence[Any], jobs: int, told: Told
) -> Results:
    """Work over as many processes as are wanted and of use: 0 for one a core.

    The rest is as for `over_processes`.
    """
    processes = min(jobs or available_processes(), len(items))
    if processes > 1:
        return over_processes(work, shared, items, processes, told)
    # One is of no use beside this one, which then works itself.
    return ((index, work(shared, item, partial(told, index))) for index, item in enumerate(items))


def over_processes(
    work: Work,
    shared: Any,
    items: Iterable[Any],
    jobs: int,
    told: Told,
    *,
    copies: bool = True,
    in_order: bool = False,
) -> Results:
    """Work over processes of this machine.

    Parameters
    ----------
    work, shared, items
        What is done with what; what a process works with is its own, and changes nothing here.
    jobs
        How many processes.
    told
        Called now and then with an item's index, how much of it is done, and of how much.
    copies
        Whether processes may begin as copies of this one; OpenGL does not bear that.
    in_order
        Whether results come in the order of the items, for who would have to hold large ones
        that come early. A slow item then keeps the others waiting; and where a process died,
        what it was at comes late.

    Yields
    ------
    tuple
        Index and result; `Died` where the process that worked on it ended without one.

    Notes
    -----
    When a process dies it is not known on which item. Those that were under way are tried again,
    each by itself, and the one that kills its process again is the one.
    """
    waiting = deque(enumerate(items))
    jobs = min(jobs, _MOST_PROCESSES)
    suspects: deque[tuple[int, Any]] = deque()
    while waiting or suspects:
        if not suspects:
            suspects += yield from _in_a_pool(work, shared, waiting, jobs, told, copies, in_order)
            continue
        alone = deque([suspects.popleft()])
        for index, _ in (yield from _in_a_pool(work, shared, alone, 1, told, copies, in_order)):
            yield index, Died("the process that worked on it was killed, or ran out of memory")


def start_method() -> str:
    """How processes begin: as copies of this one, or from nothing, which takes a second longer.

    A copy has one thread, whatever the others were at, and waits forever for what one of them
    held. So this process is copied only while it has no other; libraries have theirs too, which
    Python does not count. On macOS the system's own libraries do not bear copying.
    """
    if sys.platform == "linux" and len(os.listdir("/proc/self/task")) == 1:
        return "fork"
    return "spawn"


def _in_a_pool(
    work: Work,
    shared: Any,
    waiting: deque[tuple[int, Any]],
    jobs: int,
    told: Told,
    copies: bool,
    in_order: bool,
) -> Generator[tuple[int, Any], None, list[tuple[int, Any]]]:
    """Work on what is waiting until all is done or a process dies; returns what it left."""
    method = start_method() if copies else "spawn"
    context = multiprocessing.get_context(method)
    jobs = min(jobs, len(waiting))
    # More items than processes, so that none waits for us.
    places = list(range(2 * jobs))
    how_far = context.RawArray("q", 2 * len(places))
    others = set(multiprocessing.active_children())
    given, outbox = (shared, None) if method == "fork" else _by_post(context)
    pool = ProcessPoolExecutor(
        jobs, mp_context=context, initializer=_begin, initargs=(work, given, how_far)
    )
    under_way: dict[Future[Any], tuple[int, int, Any]] = {}
    lost: list[tuple[int, Any]] = []
    complete = False
    try:
        while (waiting and not lost) or under_way:
            while waiting and places and not lost:
                place = places.pop()
                how_far[2 * place] = how_far[2 * place + 1] = 0
                try:
                    with _without_interrupt():
                        future = pool.submit(_work_at, place, waiting[0][1])
                except BrokenProcessPool:
                    lost.append(waiting.popleft())
                else:
                    under_way[future] = (place, *waiting.popleft())
            if outbox is not None:
                _send(shared, jobs, given, outbox)
                outbox = None
            # What is done and not yet asked for has its place still: no more are begun.
            wanted = list(under_way)[:1] if in_order else list(under_way)
            done, _ = wait(wanted, timeout=_POLL, return_when=FIRST_COMPLETED)
            for future in sorted(done, key=lambda future: under_way[future][1]):
                place, index, item = under_way.pop(future)
                places.append(place)
                try:
                    result = future.result()
                except BrokenProcessPool:
                    lost.append((index, item))
                else:
                    yield index, result
            for place, index, _ in under_way.values():
                told(index, how_far[2 * place], how_far[2 * place + 1])
        complete = True
    finally:
        if not complete:
            for process in set(multiprocessing.active_children()) - others:
                process.terminate()
        pool.shutdown(wait=True, cancel_futures=True)
        if outbox is not None:
            outbox.close()
    return sorted(lost, key=lambda pair: pair[0])


@dataclass(frozen=True)
class _Inbox:
    """Where processes that are not copies of this one get what they work with.

    Who starts a process waits until it has read what it begins with, so that this is little; and
    until 3.12 Python hangs where one dies while another is being started, so that none works
    before all are there.
    """

    pipe: Any
    one_at_a_time: Any

    def take(self) -> Any:
        with self.one_at_a_time:
            return self.pipe.recv()


def _by_post(context: Any) -> tuple[_Inbox, Any]:
    """Return where processes take, and where we put."""
    pipe, outbox = context.Pipe(duplex=False)
    return _Inbox(pipe, context.Lock()), outbox


def _send(shared: Any, processes: int, inbox: _Inbox, outbox: Any) -> None:
    """Give each process what it works with, and wait until all have it.

    Not by a queue of multiprocessing: its thread may still be tidying up when the program ends,
    and Python then says that something was left behind.
    """
    # Now they alone hold the end that reads: when they are gone, we are told and do not wait.
    inbox.pipe.close()
    with outbox, contextlib.suppress(BrokenPipeError):
        for _ in range(processes):
            outbox.send(shared)


@contextlib.contextmanager
def _without_interrupt() -> Iterator[None]:
    """Start processes that Ctrl-C does not reach: who started them ends them."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


# What a process of the pool works with; set once, when it begins.
_own: dict[str, Any] = {}


def _begin(work: Work, given: Any, how_far: Any) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    # What there is already is there to stay: nothing is looked for in it, and copies share it.
    gc.freeze()
    threading.Thread(target=_end_with_parent, daemon=True).start()
    shared = given.take() if isinstance(given, _Inbox) else given
    _own.update(work=work, shared=shared, how_far=how_far)


def _end_with_parent() -> None:
    """Leave no process behind when the one that started it is killed."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _work_at(place: int, item: Any) -> Any:
    how_far = _own["how_far"]

    def told(done: int, of: int) -> None:
        how_far[2 * place], how_far[2 * place + 1] = done, of

    return _own["work"](_own["shared"], item, told)
