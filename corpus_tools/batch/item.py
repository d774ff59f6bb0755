"""An item of a batch: its files, the job that processes it, and the result."""

from __future__ import annotations

import contextlib
import os
import time
import traceback
import warnings
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path, PurePath
from typing import Any, Protocol, TypeVar

from mocap_fit.errors import MocapFitError, MocapFitWarning, describe_error

ItemT = TypeVar("ItemT", bound="Item", contravariant=True)


@dataclass(frozen=True)
class Item:
    """An item of a batch: the files it is read from, and the files that are written for it.

    Parameters
    ----------
    name
        Name of the item.
    folder
        Folder of the sources; absolute.
    sources
        Paths under ``folder``. The first one is named in errors that name no file, and its size
        stands for the amount of work.
    targets
        Paths under the folder of the results. The last one is written last, and the last step of
        its provenance says what it was made from.
    prefix
        What messages show in place of the folder, such as the path that the user typed.
    """

    name: str
    folder: Path
    sources: tuple[str, ...]
    targets: tuple[str, ...]
    prefix: str = ""


@dataclass(eq=False)
class Context:
    """Where an item is processed, and how that goes on.

    Parameters
    ----------
    item
        The item.
    folder
        Folder of its sources here: the item's, or on a cluster perhaps a temporary one.
    out
        Folder of the results here.
    progress
        Called with the number of frames done so far, and of all frames.
    fingerprint
        Sum over everything that the result depends on.
    processes
        Number of processes that share this machine's memory.
    free_memory
        What was free when they began, bytes; None where that is not known, or where there is one.
    seconds
        Time spent on each part of the work, in seconds.
    """

    item: Item
    folder: Path
    out: Path
    progress: Callable[[int, int], object]
    fingerprint: str = ""
    processes: int = 1
    free_memory: int | None = None
    seconds: dict[str, float] = field(default_factory=dict)

    @contextlib.contextmanager
    def time(self, part: str) -> Iterator[None]:
        """Add the time spent inside to that of a part of the work.

        Parameters
        ----------
        part
            Name of the part.

        Yields
        ------
        None
            Nothing.
        """
        began = time.perf_counter()
        yield
        self.seconds[part] = self.seconds.get(part, 0.0) + time.perf_counter() - began

    def rename_paths(self, text: str) -> str:
        """Return a message that names files as the user does, wherever they are here.

        Parameters
        ----------
        text
            A message.

        Returns
        -------
        str
            The message on one line.
        """
        return " ".join(text.replace(f"{self.folder}{os.sep}", self.item.prefix).split())

    def leave_out_item(self, text: str) -> str:
        """Return a message without the names of the item's files, to compare it with others'.

        Parameters
        ----------
        text
            A message, from `rename_paths`.

        Returns
        -------
        str
            The message with ``*`` for what the files are called.
        """
        for source in self.item.sources:
            path = PurePath(source)
            text = text.replace(source, str(path.with_name(f"*{path.suffix}")))
        return text


@dataclass(frozen=True, eq=False)
class ItemResult:
    """Result of one item.

    Parameters
    ----------
    name
        Name of the item.
    figures
        What the last step of the last target says: counts, residuals; empty after an error.
    cached
        Whether an earlier run has made the same result from the same files.
    error
        Why there is no result; None where there is one.
    details
        The attribute ``details`` of the error, if it has one.
    warnings
        What was warned about, one line each.
    causes
        By error and warning: the same without what is of this item alone.
    seconds
        Time spent on each part of the work, in seconds.
    files
        Content by target, where a cluster has sent it and it is not written yet.
    traceback
        Traceback of the error.
    """

    name: str
    figures: Mapping[str, Any] = field(default_factory=dict)
    cached: bool = False
    error: str | None = None
    details: Any = None
    warnings: tuple[str, ...] = ()
    causes: Mapping[str, str] = field(default_factory=dict)
    seconds: Mapping[str, float] = field(default_factory=dict)
    files: Mapping[str, bytes] = field(default_factory=dict)
    traceback: str | None = None

    def __repr__(self) -> str:
        state = self.error or ("cached" if self.cached else "done")
        return f"ItemResult({self.name!r}: {state})"


class Job(Protocol[ItemT]):
    """What is done with every item of a batch; can be pickled."""

    @property
    def step(self) -> str:
        """Name of the last step in the provenance of every Parquet file that is written."""

    def compute_fingerprint(self, item: ItemT, sums: Mapping[str, str]) -> str:
        """Return a sum over everything that the result of an item depends on.

        Parameters
        ----------
        item
            The item.
        sums
            SHA-256 of each source, by its path.

        Returns
        -------
        str
            The sum, as hexadecimal digits.
        """

    def is_complete(self, item: ItemT, out: Path, figures: Mapping[str, Any]) -> bool:
        """Whether an earlier result with the right fingerprint can be used as it is.

        Parameters
        ----------
        item
            The item.
        out
            Folder of the results.
        figures
            Arguments of the last step of the last target.

        Returns
        -------
        bool
            False where the item must be processed again.
        """

    def process(self, item: ItemT, context: Context) -> Mapping[str, Any]:
        """Read an item, process it and write its targets.

        Parameters
        ----------
        item
            The item.
        context
            Where it is processed.

        Returns
        -------
        Mapping[str, Any]
            Arguments of the last step of the last target.

        Raises
        ------
        MocapFitError
            If the item cannot be processed.
        """


def try_item(context: Context, work: Callable[[], Mapping[str, Any]]) -> ItemResult:
    """Do some work for an item; an error, also a mistake of ours, is in the result.

    Parameters
    ----------
    context
        Where the item is processed.
    work
        Returns the item's figures.

    Returns
    -------
    ItemResult
        Figures or an error, with all warnings.
    """
    item = context.item
    figures: Mapping[str, Any] = {}
    message = trace = details = None
    causes: dict[str, str] = {}
    with catch_warnings(context.rename_paths) as lines:
        try:
            figures = work()
        except Exception as error:
            trace = traceback.format_exc()
            details = getattr(error, "details", None)
            source = context.folder / item.sources[0]
            message = context.rename_paths(describe_error(error, source))
            cause = error.cause if isinstance(error, MocapFitError) else describe_error(error)
            causes[message] = context.leave_out_item(context.rename_paths(cause))
    causes |= {line: context.leave_out_item(line) for line in lines}
    return ItemResult(
        item.name,
        figures,
        error=message,
        details=details,
        warnings=tuple(lines),
        causes=causes,
        seconds=context.seconds,
        traceback=trace,
    )


@contextlib.contextmanager
def catch_warnings(rename_paths: Callable[[str], str] = str) -> Iterator[list[str]]:
    """Collect what is warned about, one line each; equal lines once.

    Parameters
    ----------
    rename_paths
        Returns a message that names files as the user does.

    Yields
    ------
    list[str]
        Filled at the end.
    """
    lines: list[str] = []
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", MocapFitWarning)
        warnings.simplefilter("ignore", DeprecationWarning)
        warnings.simplefilter("ignore", FutureWarning)
        yield lines
    for warning in caught:
        ours = issubclass(warning.category, MocapFitWarning)
        prefix = "" if ours else f"{warning.category.__name__}: "
        lines.append(rename_paths(f"{prefix}{warning.message}"))
    lines[:] = dict.fromkeys(lines)
