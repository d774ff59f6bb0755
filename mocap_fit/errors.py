"""The errors and warnings of mocap-fit.

Everything that can go wrong with a user's data or files is a `MocapFitError`, whose message says
where it happened, what was found, what was expected, and what to do. Programming mistakes stay
ordinary Python exceptions.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import Any


class MocapFitError(Exception):
    """A problem with the user's data, stated so that the user can mend it.

    Parameters
    ----------
    problem
        One sentence without a full stop: what is wrong.
    path
        The file it was found in.
    line
        The line of the file, from 1.
    frame
        The frame of the recording, from 0.
    found, expected
        What was there, and what should have been.
    advice
        What to do about it.
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
        super().__init__(self._message())

    def _message(self) -> str:
        place = [self.path] if self.path is not None else []
        if self.line is not None:
            place.append(f"line {self.line}")
        if self.frame is not None:
            place.append(f"frame {self.frame}")
        text = ", ".join(place) + ": " if place else ""
        text += self.problem
        comparison = []
        if self.found is not None:
            comparison.append(f"found {_shortened(self.found)}")
        if self.expected is not None:
            comparison.append(f"expected {_shortened(self.expected)}")
        if comparison:
            text += f" ({', '.join(comparison)})"
        if self.advice:
            text += f". {self.advice}"
        # A message is one line, whatever the file held.
        return " ".join(text.split())


def _shortened(value: object, limit: int = 200) -> str:
    text = str(value)
    return text if len(text) <= limit else text[: limit - 1] + "…"


class FileFormatError(MocapFitError):
    """A file is not what its format asks for, or cannot be read at all."""


class DataError(MocapFitError):
    """Arrays or tracks that cannot be used: wrong shape, no data, impossible values."""


class ConfigurationError(MocapFitError):
    """A layout, rig, manifest or setting that contradicts itself or the data."""


class RegistryError(MocapFitError):
    """A plug-in that is unknown, registered twice, or cannot be loaded."""


class MissingExtraError(MocapFitError):
    """Something that needs an optional extra which is not installed."""


class MocapFitWarning(UserWarning):
    """Something was mended or left out, and the user should know."""


_PLAINER = {
    "Field required": "this is missing",
    "Extra inputs are not permitted": "there is no such setting",
    "Input should be a valid tuple": "give a list, in square brackets",
}


def first_fault(content: object, faults: Sequence[Mapping[str, Any]]) -> tuple[str, str]:
    """The first fault that was found in a file of tables: its place in the file, and what it is.

    Parameters
    ----------
    content
        What was read: tables, lists and values, as TOML or JSON gives them.
    faults
        pydantic's list of what is wrong with it (`ValidationError.errors`).

    Returns
    -------
    place
        The keys that lead to it, such as ``markers.3 'chin'.weight``; empty for the whole file.
        A list's entries count from 0; one that has a name is shown with it.
    problem
        What is wrong, without a full stop.
    """
    fault = faults[0]
    place = []
    for item in fault["loc"]:
        # What else is in the location is pydantic's own, such as the kind that it tried.
        if isinstance(content, Mapping):
            place.append(str(item))
            content = content.get(str(item))
        elif isinstance(content, list) and isinstance(item, int):
            content = content[item] if item < len(content) else None
            name = content.get("name") if isinstance(content, Mapping) else None
            place.append(f"{item} '{name}'" if name and isinstance(name, str) else str(item))
    message = str(fault["msg"]).removeprefix("Value error, ")
    problem = _PLAINER.get(message, message[:1].lower() + message[1:])
    return ".".join(place), problem
