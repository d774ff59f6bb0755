"""What every command shares: exit statuses, the error boundary, warnings, JSON, progress.

Results go to stdout, everything else to stderr. Nothing here imports a heavy package, so that
``mocap-fit --help`` stays quick.
"""

from __future__ import annotations

import contextlib
import json
import math
import os
import signal
import sys
import threading
import traceback
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from enum import IntEnum
from typing import TYPE_CHECKING, Any, Literal

from mocap_fit.errors import MocapFitError, MocapFitWarning, describe_error

if TYPE_CHECKING:
    from types import FrameType

    from rich.console import Console
    from rich.table import Table

PROGRAM = "mocap-fit"
DEBUG_VARIABLE = "MOCAP_FIT_DEBUG"


class Status(IntEnum):
    """What the program ends with."""

    DONE = 0
    BAD_DATA = 1
    WRONG_CALL = 2
    BUG = 70
    STOPPED = 130
    READER_GONE = 141


class StoppedError(Exception):
    """The user pressed Ctrl-C."""


class ReaderGoneError(Exception):
    """Whoever read our output has closed it, as ``head`` does."""


@contextlib.contextmanager
def command_boundary() -> Iterator[None]:
    """Take Ctrl-C and a closed pipe out of typer's hands.

    Typer's own answers to these two change from version to version; ours go up to `guarded`.
    """
    try:
        yield
    except KeyboardInterrupt:
        raise StoppedError from None
    except BrokenPipeError:
        raise ReaderGoneError from None


def guarded(action: Callable[[], object]) -> int:
    """Run a command and return the exit status; no error gets past.

    Bad data and a failing disk are one line on stderr. Anything unexpected is one line too, which
    says that the fault is ours and how to see the traceback.
    """
    try:
        with _noted(), warnings_in_one_line():
            try:
                action()
            except SystemExit as stop:
                status = _exit_status(stop.code)
            else:
                status = Status.DONE
            sys.stdout.flush()
    except (ReaderGoneError, BrokenPipeError):
        _close_stdout_quietly()
        status = Status.READER_GONE
    except (Exception, KeyboardInterrupt) as error:
        status = _told(error)
    finally:
        _interrupts.clear()
    return int(status)


def _told(error: BaseException) -> Status:
    """Tell the user why a command ended; returns what it ends with."""
    if _interrupts or isinstance(error, (StoppedError, KeyboardInterrupt)):
        say("stopped")
        return Status.STOPPED
    if isinstance(error, (MocapFitError, OSError, MemoryError)):
        report(error)
        return Status.BAD_DATA
    if debugging():
        traceback.print_exc()
    say(
        f"error: this is a bug in mocap-fit ({type(error).__name__}: {error}). "
        f"Set {DEBUG_VARIABLE}=1, run it again, and report the traceback that it shows."
    )
    return Status.BUG


# How often Ctrl-C came since the command began.
_interrupts: list[int] = []


@contextlib.contextmanager
def _noted() -> Iterator[None]:
    """Let Ctrl-C do what it does, and note that it came.

    Python and libraries make errors of their own of it: numpy's ``unique`` over rows a TypeError,
    when it comes while two of them are compared, and ``int`` of a text a ValueError, by which
    pandas tells numbers from words.
    """

    def interrupt(number: int, frame: FrameType | None) -> None:
        _interrupts.append(number)
        signal.default_int_handler(number, frame)

    ours = (
        threading.current_thread() is threading.main_thread()
        and signal.getsignal(signal.SIGINT) is signal.default_int_handler
    )
    if ours:
        signal.signal(signal.SIGINT, interrupt)
    try:
        yield
    finally:
        if ours:
            signal.signal(signal.SIGINT, signal.default_int_handler)


def stop_if_asked() -> None:
    """Stop where Ctrl-C came and did not get through; long work asks this now and then."""
    if _interrupts:
        raise KeyboardInterrupt


def debugging() -> bool:
    """Whether the user asked for tracebacks."""
    return os.environ.get(DEBUG_VARIABLE, "") not in ("", "0")


def report(error: MocapFitError | OSError | MemoryError) -> None:
    """Print an error that the user can mend, as one line on stderr."""
    if debugging():
        traceback.print_exception(error)
    say(f"error: {describe_error(error)}")


def show_traceback(text: str) -> None:
    """Print the traceback of another process, as it is, for those who debug."""
    print(text, file=sys.stderr, flush=True)


def say(text: str) -> None:
    """Print one line on stderr, after the program's name."""
    line = f"{PROGRAM}: {printable(text)}"
    try:
        print(line, file=sys.stderr, flush=True)
    except UnicodeEncodeError:
        encoding = sys.stderr.encoding
        print(line.encode(encoding, "backslashreplace").decode(encoding), file=sys.stderr)


def printable(text: str) -> str:
    """The text on one line; control characters of a strange file are shown, not obeyed."""
    line = " ".join(text.split())
    return "".join(
        character if character.isprintable() else character.encode("unicode_escape").decode()
        for character in line
    )


@contextlib.contextmanager
def warnings_in_one_line() -> Iterator[None]:
    """Show each warning as one line on stderr, and the same line only once."""
    seen: set[str] = set()

    def show(
        message: Warning | str,
        category: type[Warning],
        filename: str,
        lineno: int,
        file: object = None,
        line: str | None = None,
    ) -> None:
        text = f"warning: {message}"
        if not issubclass(category, MocapFitWarning):
            text = f"warning: {category.__name__}: {message}"
        if text not in seen:
            seen.add(text)
            say(text)

    with warnings.catch_warnings():
        if not debugging():
            # What a library says to its programmers is nothing that a user can mend.
            warnings.simplefilter("ignore", DeprecationWarning)
            warnings.simplefilter("ignore", FutureWarning)
        # Python shows a warning once a place; two files with the same fault deserve one each.
        warnings.simplefilter("always", MocapFitWarning)
        warnings.showwarning = show
        yield


def print_json(value: object) -> None:
    """Print a value as JSON on stdout; see `json_text`."""
    print(json_text(value))


def json_text(value: object) -> str:
    """A value as JSON text: ASCII, and null where a number is not finite."""
    return json.dumps(_plain(value), indent=2, allow_nan=False)


def screen() -> Console:
    """Where tables for people go: stdout, through rich."""
    from rich.console import Console

    class Screen(Console):
        def print(self, *objects: Any, **options: Any) -> None:
            # A table that is too wide runs over the edge; rich would cut it off.
            super().print(*objects, **{"crop": False, **options})

        def on_broken_pipe(self) -> None:  # rich would end with the status of bad data
            raise ReaderGoneError

    # Names of files and markers are shown as they are, whatever brackets and colons they hold.
    return Screen(markup=False, emoji=False)


def table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> Table:
    """A table for a terminal: the first column to the left, numbers to the right.

    Parameters
    ----------
    header
        Names of the columns.
    rows
        A text each cell.
    """
    from rich import box
    from rich.table import Table

    made = Table(box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0), show_edge=False)
    for i, name in enumerate(header):
        # Where the terminal is narrow the names of columns are broken, and no number is cut.
        widest = max((len(row[i]) for row in rows), default=0)
        justify: Literal["left", "right"] = "right" if i else "left"
        made.add_column(name, justify=justify, min_width=widest, overflow="fold")
    for row in rows:
        made.add_row(*row)
    return made


@contextlib.contextmanager
def progress(task: str, total: int) -> Iterator[Callable[[], None]]:
    """Show how far a long task is, on stderr: a bar on a terminal, else a line each tenth.

    Parameters
    ----------
    task
        What is being done to what, such as ``fitting recordings``.
    total
        How many there are.

    Yields
    ------
    Callable
        To be called after each one.
    """
    with (_bar if on_terminal() else _lines)(task, total) as show:

        def advance() -> None:
            stop_if_asked()
            show()

        yield advance


@contextlib.contextmanager
def _lines(task: str, total: int) -> Iterator[Callable[[], None]]:
    done = tenths = 0

    def show() -> None:
        nonlocal done, tenths
        done += 1
        if done * 10 // total > tenths:
            tenths = done * 10 // total
            say(f"{task}: {done} of {total}")

    yield show


@contextlib.contextmanager
def _bar(task: str, total: int) -> Iterator[Callable[[], None]]:
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeRemainingColumn,
    )

    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=Console(stderr=True)) as shown:
        row = shown.add_task(task, total=total)
        yield lambda: shown.advance(row)


def on_terminal() -> bool:
    """Whether stderr is a terminal that can draw a bar."""
    return sys.stderr.isatty() and os.environ.get("TERM") != "dumb"


def _exit_status(code: str | int | None) -> int:
    if code is None:
        return Status.DONE
    if isinstance(code, int):
        return code
    say(code)
    return Status.BAD_DATA


def _plain(value: Any) -> Any:
    """The value in what JSON knows."""
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple, set, frozenset)):
        return [_plain(item) for item in value]
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    if hasattr(value, "tolist"):  # a numpy array or number
        return _plain(value.tolist())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def _close_stdout_quietly() -> None:
    """Let the interpreter's last flush go nowhere, or it would complain after all."""
    with contextlib.suppress(OSError, ValueError, AttributeError):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, sys.stdout.fileno())
        os.close(nowhere)
