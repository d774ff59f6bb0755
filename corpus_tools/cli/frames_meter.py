"""How far a fit of many recordings is: frames, frames/s, time left."""

from __future__ import annotations

import contextlib
import math
import time
from collections.abc import Callable, Iterator, Sequence

from corpus_tools.cli import console

# A bar that shows frames is drawn anew after this many seconds, if there is news.
_REDRAWN = 0.1


class Meter:
    """How far a fit of many recordings is: recordings, frames, frames/s, time left.

    How many frames a recording has is known when it is read, so that what is left is judged by
    the sizes of the files.

    Parameters
    ----------
    sizes
        Size of each recording's file, above 0.
    show
        Called with the part that is done, 0 to 1, how many recordings are, and a text.
    """

    def __init__(self, sizes: Sequence[float], show: Callable[[float, int, str], object]) -> None:
        self._sizes, self._show = sizes, show
        self._began = time.monotonic()
        self._under_way: dict[int, tuple[int, int]] = {}
        self._count = self._frames = 0
        self._fitted = self._kept = 0.0

    def told(self, index: int, frames: int, of: int) -> None:
        """Take how far a recording is that is under way."""
        self._under_way[index] = (frames, of)
        self._update()

    def done(self, index: int, frames: int) -> None:
        """Take that a recording is done, and how many of its frames were fitted; 0 if kept."""
        self._under_way.pop(index, None)
        self._count += 1
        self._frames += frames
        if frames:
            self._fitted += self._sizes[index]
        else:
            self._kept += self._sizes[index]
        self._update()

    def _update(self) -> None:
        console.stop_if_asked()
        frames, fitted = self._frames, self._fitted
        for index, (some, of) in self._under_way.items():
            frames += some
            fitted += self._sizes[index] * some / max(1, of)
        total = sum(self._sizes)
        left = max(0.0, total - fitted - self._kept)
        passed = max(time.monotonic() - self._began, 1e-3)
        text = f"{self._count} of {len(self._sizes)}"
        if frames:
            text += f", {frames} frames, {frames / passed:.0f} frames/s"
            if self._count < len(self._sizes):
                minutes, seconds = divmod(math.ceil(passed * left / fitted), 60)
                text += f", {minutes}:{seconds:02d} left"
        self._show(1 - left / total, self._count, text)


@contextlib.contextmanager
def frames_progress(task: str, sizes: Sequence[float]) -> Iterator[Meter]:
    """Show how far a fit is, on stderr: a bar on a terminal, else a line each tenth.

    Parameters
    ----------
    task
        What is being done to what.
    sizes
        As for `Meter`.

    Yields
    ------
    Meter
        To be told.
    """
    if console.on_terminal():
        with _frames_bar(task) as show:
            yield Meter(sizes, show)
        return
    tenths = last = 0

    def show_line(part: float, count: int, text: str) -> None:
        nonlocal tenths, last
        whole = count == len(sizes) and last < count
        if int(part * 10) > tenths or whole:
            tenths, last = int(part * 10), count
            console.say(f"{task}: {text}")

    yield Meter(sizes, show_line)


@contextlib.contextmanager
def _frames_bar(task: str) -> Iterator[Callable[[float, int, str], object]]:
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn

    columns = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.fields[said]}"))
    # Drawn when there is news and not by a thread: processes are copied from this one.
    with Progress(*columns, console=Console(stderr=True), auto_refresh=False) as shown:
        row = shown.add_task(task, total=1.0, said="")
        drawn = -math.inf

        def show(part: float, count: int, text: str) -> None:
            nonlocal drawn
            now = time.monotonic()
            due = now - drawn >= _REDRAWN
            if due:
                drawn = now
            shown.update(row, completed=part, said=text, refresh=due)

        yield show
