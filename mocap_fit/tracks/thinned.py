"""Every so many rows of something that comes in parts, so that memory does not grow with it."""

from __future__ import annotations

import numpy as np

from mocap_fit.tracks.types import FloatArray


class Thinned:
    """Every 2ᵏ-th row, with the smallest k that leaves no more than a limit.

    Which rows are kept does not depend on how they were cut into parts.

    Parameters
    ----------
    limit
        How many rows may be kept; half of it at least are, where there are as many.
    """

    def __init__(self, limit: int) -> None:
        self._limit = limit
        self._stride = 1
        self._kept: list[FloatArray] = []
        self.count = 0
        """Rows so far."""

    def add(self, rows: FloatArray) -> None:
        """Take the next rows, `(rows, ...)`."""
        total = self.count + len(rows)
        while -(-total // self._stride) > self._limit:
            self._stride *= 2
            self._kept = [self.rows[::2].copy()] if self._kept else []
        self._kept.append(rows[-self.count % self._stride :: self._stride].copy())
        self.count = total

    @property
    def rows(self) -> FloatArray:
        """What is kept, `(kept, ...)`."""
        return np.concatenate(self._kept)
