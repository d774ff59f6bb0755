"""Exit statuses, errors, warnings and Ctrl-C on the command line.

Results go to stdout, everything else to stderr. Nothing here imports a heavy package, so that
``mocap-fit --help`` stays quick.
"""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import threading
import traceback
import warnings
from collections.abc import Callable, Iterator
from enum import IntEnum
from typing import TYPE_CHECKING, TextIO

from mocap_fit.errors import (
    DEBUG_VARIABLE,
    MocapFitError,
    MocapFitWarning,
    describe_error,
    is_debugging,
)
from mocap_fit.plain_text import escape_controls
from mocap_fit.size_limit import VARIABLE

if TYPE_CHECKING:
    from types import FrameType

PROGRAM = "mocap-fit"

QUIET_VARIABLE = "MOCAP_FIT_QUIET"
"""Environment variable with which results and errors alone are printed."""


class Status(IntEnum):
    """Exit status of the program."""

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
def pass_interrupts() -> Iterator[None]:
    """Let Ctrl-C and a closed pipe pass through typer as exceptions that it does not know.

    Its answers to these two change from version to version.

    Yields
    ------
    None
        Nothing.
    """
    try:
        yield
    except KeyboardInterrupt:
        raise StoppedError from None
    except BrokenPipeError:
        raise ReaderGoneError from None


def run_guarded(action: Callable[[], object]) -> int:
    """Run a command and return the exit status; every error is caught.

    Bad data and a failing disk are one line on stderr. Anything unexpected is one line too, which
    says that it is a bug and how to see the traceback.

    Parameters
    ----------
    action
        The command.

    Returns
    -------
    int
        The exit status.
    """
    try:
        with _count_interrupts(), show_warnings():
            try:
                action()
            except SystemExit as stop:
                status = _to_exit_status(stop.code)
            else:
                status = Status.DONE
            sys.stdout.flush()
    except (ReaderGoneError, BrokenPipeError):
        _close_quietly(sys.stdout)
        status = Status.READER_GONE
    except (Exception, KeyboardInterrupt) as error:
        status = _report_end(error)
    finally:
        _interrupts.clear()
        # What cannot be written now would be tried again when the process ends.
        for stream in (sys.stdout, sys.stderr):
            try:
                stream.flush()
            except (OSError, ValueError, AttributeError):
                _close_quietly(stream)
    return int(status)


def _report_end(error: BaseException) -> Status:
    """Print why a command ended, and return its exit status."""
    if _interrupts or isinstance(error, (StoppedError, KeyboardInterrupt)):
        say("stopped")
        return Status.STOPPED
    print_error(error)
    is_of_data = isinstance(error, (MocapFitError, OSError, MemoryError))
    return Status.BAD_DATA if is_of_data else Status.BUG


# One entry for each Ctrl-C since the command began.
_interrupts: list[int] = []


@contextlib.contextmanager
def _count_interrupts() -> Iterator[None]:
    """Count Ctrl-C besides raising KeyboardInterrupt.

    Python and libraries turn the exception into other ones: numpy's ``unique`` over rows into a
    TypeError, when it comes while two of them are compared, and ``int`` of a text into a
    ValueError, by which pandas distinguishes numbers from words.
    """

    def interrupt(number: int, frame: FrameType | None) -> None:
        _interrupts.append(number)
        signal.default_int_handler(number, frame)

    is_default = (
        threading.current_thread() is threading.main_thread()
        and signal.getsignal(signal.SIGINT) is signal.default_int_handler
    )
    if is_default:
        signal.signal(signal.SIGINT, interrupt)
    try:
        yield
    finally:
        if is_default:
            signal.signal(signal.SIGINT, signal.default_int_handler)


def stop_if_interrupted() -> None:
    """Raise KeyboardInterrupt if Ctrl-C came and its exception was lost.

    Long work calls this now and then.

    Raises
    ------
    KeyboardInterrupt
        If Ctrl-C came.
    """
    if _interrupts:
        raise KeyboardInterrupt


def print_error(error: BaseException, path: str | os.PathLike[str] | None = None) -> None:
    """Print an error as one line on stderr.

    Parameters
    ----------
    error
        The error.
    path
        The file that it is about, where the error names none.
    """
    if is_debugging():
        traceback.print_exception(error)
    say(f"error: {describe_error(error, path)}")


def print_traceback(text: str | None) -> None:
    """Print the traceback of another process while debugging.

    Parameters
    ----------
    text
        The traceback; None where there is none.
    """
    if text is not None and is_debugging():
        print(text, file=sys.stderr, flush=True)


@contextlib.contextmanager
def restore_environment() -> Iterator[None]:
    """Undo at the end what options have set in the environment.

    Yields
    ------
    None
        Nothing.
    """
    names = (VARIABLE, DEBUG_VARIABLE, QUIET_VARIABLE)
    former = {name: os.environ.get(name) for name in names}
    try:
        yield
    finally:
        for name, value in former.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value


def is_quiet() -> bool:
    """Whether the user wants neither progress nor warnings.

    Returns
    -------
    bool
        True if the environment variable `QUIET_VARIABLE` is set, but for 0.
    """
    return os.environ.get(QUIET_VARIABLE, "") not in ("", "0")


def note(text: str) -> None:
    """Print one line on stderr that is neither result nor error, unless the user wants quiet.

    Parameters
    ----------
    text
        The line.
    """
    if not is_quiet():
        say(text)


def say(text: str) -> None:
    """Print one line on stderr, after the program's name.

    Parameters
    ----------
    text
        The line.
    """
    line = f"{PROGRAM}: {to_printable(text)}"
    # Where nothing can be said, that cannot be said either.
    with contextlib.suppress(OSError):
        try:
            print(line, file=sys.stderr, flush=True)
        except UnicodeEncodeError:
            encoding = sys.stderr.encoding
            print(line.encode(encoding, "backslashreplace").decode(encoding), file=sys.stderr)


def to_printable(text: str) -> str:
    """Return a text on one line, with control characters escaped.

    Parameters
    ----------
    text
        Any text, such as the name of a marker in a damaged file.

    Returns
    -------
    str
        The line.
    """
    return escape_controls(" ".join(text.split()))


@contextlib.contextmanager
def show_warnings() -> Iterator[None]:
    """Show each warning as one line on stderr, and the same line only once.

    Yields
    ------
    None
        Nothing.
    """
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
            note(text)

    with warnings.catch_warnings():
        if not is_debugging():
            # Those of libraries are for programmers.
            warnings.simplefilter("ignore")
        # Python shows a warning once per line of code; two files may have the same fault.
        warnings.simplefilter("always", MocapFitWarning)
        warnings.showwarning = show
        yield


def show_all_warnings() -> None:
    """Show the warnings of libraries as well, until the command ends."""
    warnings.simplefilter("default")
    warnings.simplefilter("always", MocapFitWarning)


def _to_exit_status(code: str | int | None) -> int:
    if code is None:
        return Status.DONE
    if isinstance(code, int):
        return code
    say(code)
    return Status.BAD_DATA


def open_standard_streams() -> None:
    """Open those of the three standard streams that whoever started the process has closed.

    A file that is opened later would take the place of a closed one, with what is printed in it.
    """
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)
    sys.stdin = sys.stdin or open(os.devnull)  # noqa: SIM115
    sys.stdout = sys.stdout or open(os.devnull, "w")  # noqa: SIM115
    sys.stderr = sys.stderr or open(os.devnull, "w")  # noqa: SIM115


def _close_quietly(stream: TextIO) -> None:
    """Let the interpreter's last flush go nowhere, or it would print an error."""
    with contextlib.suppress(OSError, ValueError, AttributeError):
        null = os.open(os.devnull, os.O_WRONLY)
        os.dup2(null, stream.fileno())
        os.close(null)
