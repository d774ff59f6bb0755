"""Tables and JSON on stdout, progress on stderr."""

from __future__ import annotations

import contextlib
import math
import os
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Literal, Protocol, TypeVar

from corpus_tools.cli import console
from corpus_tools.json_file import format_json
from corpus_tools.tasks import TaskProgress
from mocap_fit.plain_text import escape_controls

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

    from corpus_tools.batch import BatchProgress, ItemResult

ReportT = TypeVar("ReportT", bound="Report")

# Seconds between two drawings of a bar, and between two lines of a task without known length.
_REDRAWN, _LINE = 0.1, 5.0


def print_json(value: object) -> None:
    """Print a value as JSON on stdout.

    Parameters
    ----------
    value
        As `format_json` takes it: nested mappings, sequences, arrays, numbers.
    """
    print(format_json(value))


class Report(Protocol):
    """What a command returns."""

    def to_dict(self) -> Mapping[str, Any]:
        """Return everything as JSON can hold it.

        Returns
        -------
        Mapping[str, Any]
            Nested mappings, sequences, arrays, numbers.
        """


def print_report(
    report: ReportT, print_text: Callable[[ReportT], object], *, as_json: bool
) -> None:
    """Print a report on stdout: as JSON for programs, or as text for people.

    Parameters
    ----------
    report
        What a command has done.
    print_text
        Prints it as text.
    as_json
        Whether JSON is printed.
    """
    if as_json:
        print_json(report.to_dict())
    else:
        print_text(report)


def create_screen() -> Console:
    """Return where tables for people go: stdout, through rich.

    Returns
    -------
    Console
        Prints names of files and markers as they are, whatever brackets and colons they hold.
    """
    from rich.console import Console

    class Screen(Console):
        def print(self, *objects: Any, **options: Any) -> None:
            # Names of files and markers may hold what a terminal obeys.
            shown = [escape_controls(each) if isinstance(each, str) else each for each in objects]
            # A table that is too wide runs over the edge; rich would cut it off.
            super().print(*shown, **{"crop": False, **options})

        def _raise_reader_gone(self) -> None:
            raise console.ReaderGoneError

        # The method of rich would end the program with the status of bad data.
        on_broken_pipe = _raise_reader_gone

    return Screen(markup=False, emoji=False, color_system=choose_colours())


def choose_colours() -> Literal["auto"] | None:
    """Return rich's name of the colours that are printed.

    Returns
    -------
    str or None
        None, for neither colours nor bold text, where ``NO_COLOR`` is set (no-color.org).
    """
    return None if os.environ.get("NO_COLOR") else "auto"


def print_lines(*lines: str) -> None:
    """Print lines on stdout that are not broken where the terminal ends.

    Parameters
    ----------
    *lines
        The lines.
    """
    screen = create_screen()
    for line in lines:
        screen.print(line, soft_wrap=True)


def create_table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> Table:
    """Return a table for a terminal: the first column to the left, numbers to the right.

    Parameters
    ----------
    header
        Names of the columns.
    rows
        A text per cell.

    Returns
    -------
    Table
        To be printed on the screen.
    """
    from rich import box
    from rich.table import Table

    table = Table(box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0), show_edge=False)
    for i, name in enumerate(header):
        # Where the terminal is narrow the names of columns are broken, and no number is cut.
        widest = max((len(row[i]) for row in rows), default=0)
        justify: Literal["left", "right"] = "right" if i else "left"
        table.add_column(name, justify=justify, min_width=widest, overflow="fold")
    for row in rows:
        table.add_row(*map(console.to_printable, row))
    return table


def is_terminal() -> bool:
    """Whether stderr is a terminal that can draw a bar.

    Returns
    -------
    bool
        False for files, pipes and dumb terminals.
    """
    return sys.stderr.isatty() and os.environ.get("TERM") != "dumb"


@contextlib.contextmanager
def show_progress() -> Iterator[TaskProgress]:
    """Show how far tasks are, on stderr: bars on a terminal, else one line each tenth.

    Yields
    ------
    TaskProgress
        To be called with a task, the number of its steps done, and of all. A task without a known
        number is shown as a line, at once and then every few seconds.
    """
    began: dict[str, float] = {}
    said = -math.inf
    with _draw() as draw:

        def show(task: str, done: int, total: int | None) -> None:
            nonlocal said
            console.stop_if_interrupted()
            now = time.monotonic()
            if total is None:
                if done == 0 or now - said > _LINE:
                    said = now
                    console.note(task)
                return
            share = done / max(total, 1)
            passed = now - began.setdefault(task, now)
            text = f"{done} of {total}"
            left = passed / share * (1 - share) if share else 0.0
            more = f", {_format_seconds(left)} left" if left else ""
            draw(task, share, text, more, done == total)

        yield show


@contextlib.contextmanager
def show_batch_progress(
    task: str, print_result: Callable[[ItemResult], object] | None = None
) -> Iterator[Callable[[BatchProgress], None]]:
    """Show how far a batch is, on stderr: items, frames, frames per second, time left.

    While debugging, the tracebacks of its errors are shown too.

    Parameters
    ----------
    task
        What is being done to what, such as ``fitting recordings``.
    print_result
        Called with each result, in the order of the items; None to print nothing of them.

    Yields
    ------
    Callable
        To be called with the state of the batch.
    """
    with _draw() as draw:

        def show(state: BatchProgress) -> None:
            # Ctrl-C may have become the error of a result.
            console.stop_if_interrupted()
            for result in state.results:
                console.print_traceback(result.traceback)
                if print_result is not None:
                    print_result(result)
            complete = state.finished == state.total
            draw(task, state.share, format_batch_progress(state), "", complete)

        yield show


def format_batch_progress(state: BatchProgress) -> str:
    """Return the state of a batch in words.

    Parameters
    ----------
    state
        The state.

    Returns
    -------
    str
        Such as ``1 of 3, 500 frames, 50 frames/s, 1:10 left``.
    """
    text = f"{state.finished} of {state.total}"
    if state.frames:
        text += f", {state.frames} frames, {state.frames_per_second:.0f} frames/s"
        if state.finished < state.total and state.seconds_left is not None:
            text += f", {_format_seconds(state.seconds_left)} left"
    return text


def _format_seconds(seconds: float) -> str:
    minutes, rest = divmod(math.ceil(seconds), 60)
    return f"{minutes}:{rest:02d}"


_Draw = Callable[..., None]


@contextlib.contextmanager
def _draw() -> Iterator[_Draw]:
    """Yield a function that shows a task, the share that is done, and a text for it."""
    if not is_terminal() or console.is_quiet():
        yield _create_lines()
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn

    columns = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.fields[said]}"))
    # Drawn when there is news and not by a thread: processes are copied from this one.
    with Progress(
        *columns, console=Console(stderr=True, color_system=choose_colours()), auto_refresh=False
    ) as bars:
        rows: dict[str, Any] = {}
        drawn = -math.inf

        def draw(task: str, share: float, text: str, more: str, complete: bool) -> None:
            nonlocal drawn
            if task not in rows:
                rows[task] = bars.add_task(task, total=1.0, said="")
            now = time.monotonic()
            due = complete or now - drawn >= _REDRAWN
            if due:
                drawn = now
            bars.update(rows[task], completed=share, said=text + more, refresh=due)

        yield draw


def _create_lines() -> _Draw:
    shown: dict[str, tuple[int, bool]] = {}

    def draw(task: str, share: float, text: str, more: str, complete: bool) -> None:
        tenths, was_complete = shown.get(task, (0, False))
        # All of the work may be done before the last item is finished.
        if int(share * 10) > tenths or (complete and not was_complete):
            shown[task] = max(int(share * 10), tenths), complete
            console.note(f"{task}: {text}")

    return draw
