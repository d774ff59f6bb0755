"""Progress of long work: which task is under way, and how much of it is done."""

from __future__ import annotations

from collections.abc import Callable

TaskProgress = Callable[[str, int, int | None], object]
"""Called with a task, the number of its steps that are done, and of all; None if not known."""


def count_steps(progress: TaskProgress | None, task: str, total: int) -> Callable[..., None]:
    """Return a function to be called after every step of a task.

    Parameters
    ----------
    progress
        Called with the task, the number of steps done, and of all.
    task
        What is being done to what, such as ``scoring utterances``.
    total
        Number of steps.

    Returns
    -------
    Callable
        Takes any arguments and ignores them.
    """
    done = 0

    def advance(*_: object) -> None:
        nonlocal done
        done += 1
        if progress is not None:
            progress(task, done, total)

    return advance


def name_steps(progress: TaskProgress | None, task: str) -> Callable[[int, int], object] | None:
    """Return a function to be called with the number of steps of a task that are done, and of all.

    Parameters
    ----------
    progress
        Called with the task, the number of steps done, and of all.
    task
        What is being done to what, such as ``drawing frames``.

    Returns
    -------
    Callable or None
        None where nobody watches.
    """
    if progress is None:
        return None
    return lambda done, total: progress(task, done, total)
