"""Progress of a batch: items, frames, frames per second, time left."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from corpus_tools.batch.item import ItemResult


@dataclass(frozen=True)
class BatchProgress:
    """State of a batch that is under way.

    Parameters
    ----------
    share
        Share of the work that is done, 0 to 1, judged by the sizes of the files.
    finished, total
        Number of items that are finished, and of all items.
    frames
        Number of frames processed; those of cached results do not count.
    frames_per_second
        Mean number of frames per second since the beginning.
    seconds_left
        Expected time until the end, in seconds; None while nothing has been processed.
    results
        Results that are new since the last call, in the order of the items.
    """

    share: float
    finished: int
    total: int
    frames: int
    frames_per_second: float
    seconds_left: float | None
    results: tuple[ItemResult, ...] = ()


class Tracker:
    """Collects the results of a batch in the order of its items, and reports the progress.

    How many frames an item has is known when it has been read, so that the time left is judged
    by the sizes of the files.

    Parameters
    ----------
    sizes
        Size of each item's first source, bytes; above 0.
    progress
        Called after every change.
    """

    def __init__(
        self, sizes: Sequence[float], progress: Callable[[BatchProgress], object] | None = None
    ) -> None:
        self._sizes, self._progress = sizes, progress
        self._began = time.monotonic()
        self._under_way: dict[int, tuple[int, int]] = {}
        self._results: dict[int, ItemResult] = {}
        self._reported = 0
        self._frames = 0
        self._processed = self._skipped = 0.0

    @property
    def results(self) -> tuple[ItemResult, ...]:
        """Results in the order of the items, as far as there are."""
        return tuple(self._results[index] for index in sorted(self._results))

    def update(self, index: int, done: int, total: int) -> None:
        """Note the progress of an item that is under way.

        Parameters
        ----------
        index
            Index of the item.
        done, total
            Number of its frames that are done, and of all its frames.
        """
        self._under_way[index] = (done, total)
        self._report()

    def finish(self, index: int, result: ItemResult) -> None:
        """Note the result of an item.

        Parameters
        ----------
        index
            Index of the item.
        result
            Its result.
        """
        self._under_way.pop(index, None)
        self._results[index] = result
        frames = 0 if result.cached else int(result.figures.get("frames", 0))
        self._frames += frames
        if frames:
            self._processed += self._sizes[index]
        else:
            self._skipped += self._sizes[index]
        self._report()

    def _report(self) -> None:
        if self._progress is None:
            return
        frames, processed = self._frames, self._processed
        for index, (done, of) in self._under_way.items():
            frames += done
            processed += self._sizes[index] * done / max(1, of)
        total = sum(self._sizes)
        left = max(0.0, total - processed - self._skipped)
        passed = max(time.monotonic() - self._began, 1e-3)
        first = self._reported
        while self._reported in self._results:
            self._reported += 1
        self._progress(
            BatchProgress(
                1 - left / total,
                len(self._results),
                len(self._sizes),
                frames,
                frames / passed,
                passed * left / processed if processed else None,
                tuple(self._results[index] for index in range(first, self._reported)),
            )
        )
