"""The errors and warnings of mocap-fit.

Everything that can go wrong with a user's data or files is a `MocapFitError`, whose message says
where it happened, what was found, what was expected, and what to do. Programming mistakes stay
ordinary Python exceptions.
"""

from __future__ import annotations

import errno
import os
from typing import Any, TypeVar

_AnyError = TypeVar("_AnyError", bound="MocapFitError")

DEBUG_VARIABLE = "MOCAP_FIT_DEBUG"
"""Environment variable with which the command line shows tracebacks."""


def is_debugging() -> bool:
    """Whether the user wants tracebacks.

    Returns
    -------
    bool
        True if the environment variable `DEBUG_VARIABLE` is set, but for 0.
    """
    return os.environ.get(DEBUG_VARIABLE, "") not in ("", "0")


class MocapFitError(Exception):
    """A problem with the user's data, described so that the user can correct it.

    Parameters
    ----------
    problem
        What is wrong: one sentence without a full stop.
    path
        The file that has the problem.
    line
        The line of the file, counted from 1.
    frame
        The frame of the recording, counted from 0.
    found
        What was there; of a list, the first items are shown.
    expected
        What should have been there.
    advice
        What the user can do about it.
    """

    def __init__(
        self,
        problem: str,
        *,
        path: str | os.PathLike[str] | None = None,
        line: int | None = None,
        frame: int | None = None,
        found: object = None,
        expected: object = None,
        advice: str | None = None,
    ) -> None:
        self.problem = problem
        self.path = None if path is None else os.fspath(path)
        self.line = line
        self.frame = frame
        self.found = found
        self.expected = expected
        self.advice = advice
        super().__init__(self._compose_message())

    def _compose_message(self) -> str:
        location = [self.path] if self.path is not None else []
        if self.line is not None:
            location.append(f"line {self.line}")
        if self.frame is not None:
            location.append(f"frame {self.frame}")
        text = ", ".join(location) + ": " if location else ""
        # A message is one line, whatever the file held.
        return " ".join((text + self.cause).split())

    @property
    def cause(self) -> str:
        """The message without the file, the line and the frame: what many files may share."""
        text = shorten(self.problem, 1000)
        comparison = []
        if self.found is not None:
            comparison.append(f"found {shorten(self.found)}")
        if self.expected is not None:
            comparison.append(f"expected {shorten(self.expected)}")
        if comparison:
            text += f" ({', '.join(comparison)})"
        if self.advice:
            text += f". {self.advice}"
        return " ".join(text.split())


_LONGEST_ITEM = 40
_MOST_ITEMS = 40


def shorten(value: object, limit: int = 200) -> str:
    """Return the text of a value, cut where it is long.

    Parameters
    ----------
    value
        Anything that a message shows, such as a label of a file; a list shows its first items.
    limit
        Characters at most; those of a list are limited each.

    Returns
    -------
    str
        The text; its last character is an ellipsis where it was cut.
    """
    if isinstance(value, list):
        items = [shorten(item, _LONGEST_ITEM) for item in value[:_MOST_ITEMS]]
        more = len(value) - len(items)
        return ", ".join(items) + (f" and {more} more" if more else "")
    text = str(value)
    return text if len(text) <= limit else text[: limit - 1] + "…"


class FileFormatError(MocapFitError):
    """A file that does not follow its format, or cannot be read or written."""


class MissingFileError(FileFormatError, FileNotFoundError):
    """A file that does not exist; also a `FileNotFoundError`, with its ``errno`` and ``filename``.

    Parameters
    ----------
    problem
        What is wrong: one sentence without a full stop.
    **details
        The keyword arguments of `MocapFitError`.
    """

    def __init__(self, problem: str = "there is no such file", **details: Any) -> None:
        super().__init__(problem, **details)
        self._set_system_error()

    def __str__(self) -> str:
        # OSError would print the number of the system's error instead.
        return self._compose_message()

    def __setstate__(self, state: dict[str, Any] | None) -> None:
        super().__setstate__(state)
        self._set_system_error()

    def _set_system_error(self) -> None:
        self.errno, self.strerror = errno.ENOENT, os.strerror(errno.ENOENT)
        self.filename = self.path


class MissingRateError(FileFormatError):
    """A recording that does not say its frame rate; the caller may know it."""


class FrameTimesError(FileFormatError):
    """Times or numbers of frames that are missing, uneven, or do not increase."""


class RateMismatchError(FileFormatError):
    """A header's frame rate that contradicts the times of the frames."""


class DataError(MocapFitError):
    """Arrays or tracks that cannot be used: wrong shape, no data, impossible values."""


class ConfigurationError(MocapFitError):
    """A layout, rig, manifest or setting that contradicts itself or the data."""


class RegistryError(MocapFitError):
    """A plug-in that is unknown, registered twice, cannot be loaded, or fails."""


class MissingExtraError(MocapFitError):
    """An optional extra that is needed and not installed."""


class MocapFitWarning(UserWarning):
    """A warning about data that were corrected or left out."""


class SmallCorpusWarning(MocapFitWarning):
    """A warning that a model learns from few utterances, or stops by one."""


def add_path(error: _AnyError, path: str | os.PathLike[str]) -> _AnyError:
    """Return a copy of an error that names a file, or the error itself where it names one.

    Parameters
    ----------
    error
        The error.
    path
        The file that the error is about.

    Returns
    -------
    MocapFitError
        An error of the same class.
    """
    if error.path is not None:
        return error
    # Not by copy: where dask is imported, a copy of an exception shares its attributes.
    result = type(error).__new__(type(error))
    result.__setstate__({**vars(error), "path": os.fspath(path)})
    result.args = (result._compose_message(),)
    return result


def from_os_error(
    error: OSError | ValueError,
    path: str | os.PathLike[str],
    noun: str = "file",
    advice: str | None = None,
) -> FileFormatError:
    """Return the error for a file that the system cannot open or read.

    Parameters
    ----------
    error
        The system's error; a `ValueError` is one of text that is not UTF-8, or of an impossible
        name.
    path
        The file.
    noun
        What the file is called in the message, such as ``model``.
    advice
        What the user can do about it; a general hint where left out.

    Returns
    -------
    FileFormatError
        A `MissingFileError` where the file does not exist.
    """
    if isinstance(error, FileNotFoundError):
        advice = advice or "Check the name, and the folder that the command runs in."
        return MissingFileError(f"there is no such {noun}", path=path, advice=advice)
    reason = getattr(error, "strerror", None) or error
    advice = advice or "Check that you may read it."
    return FileFormatError(f"the {noun} cannot be read", path=path, found=reason, advice=advice)


def describe_error(error: BaseException, path: str | os.PathLike[str] | None = None) -> str:
    """Return the one-line text of an error.

    Parameters
    ----------
    error
        A `MocapFitError`, an `OSError` or a `MemoryError`; any other exception is a mistake of
        ours.
    path
        The file that it is about, where the error names none.

    Returns
    -------
    str
        The message, with the file where one is known.
    """
    if isinstance(error, MocapFitError):
        return str(error if path is None else add_path(error, path))
    if isinstance(error, OSError):
        path = path if error.filename is None else error.filename
        text = error.strerror or str(error) or type(error).__name__
    elif isinstance(error, MemoryError):
        text = "there is not enough memory. Take fewer or shorter recordings at a time."
    else:
        text = (
            f"this is a bug in mocap-fit ({type(error).__name__}: {error}). "
            f"Set {DEBUG_VARIABLE}=1, run it again, and report the traceback that it shows."
        )
    return text if path is None else f"{os.fspath(path)}: {text}"
