"""The spelling of stress in phone sets."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal


@dataclass(frozen=True)
class StressMarks:
    """The spelling of stress in a phone set.

    Parameters
    ----------
    levels
        Levels that have symbols of their own: 0 unstressed, 1 primary, 2 secondary. A secondary
        stress that is not among them counts as primary.
    marks
        Marks of each level: the one that is written, then others that are accepted. The mark of
        level 0 may be empty; then a symbol without a mark says nothing about stress.
    position
        Whether the mark is ``before`` or ``after`` the phone.
    """

    levels: tuple[int, ...] = (0,)
    marks: Mapping[int, tuple[str, ...]] = field(default_factory=lambda: {0: ("",)})
    position: Literal["before", "after"] = "after"

    def get_level(self, stress: int | None) -> int:
        """Return the level that a stress counts as.

        Parameters
        ----------
        stress
            0, 1, 2, or None where stress is not marked, which counts as unstressed.

        Returns
        -------
        int
            One of `levels`.
        """
        if not stress:
            return 0
        return stress if stress in self.levels else max(self.levels)

    def write(self, phone: str, level: int) -> str:
        """Return the symbol of a phone at a level of stress.

        Parameters
        ----------
        phone
            Symbol without stress.
        level
            One of `levels`.

        Returns
        -------
        str
            The symbol with the mark of the level.
        """
        mark = self.marks[level][0]
        return mark + phone if self.position == "before" else phone + mark

    def split(self, symbol: str) -> tuple[str, int] | None:
        """Split a symbol into its phone and its level of stress.

        Parameters
        ----------
        symbol
            A symbol, with or without a mark.

        Returns
        -------
        tuple or None
            The symbol without its mark, and the level; None where there is no mark.
        """
        for level, marks in self.marks.items():
            for mark in filter(None, marks):
                if self.position == "before" and symbol.startswith(mark):
                    return symbol[len(mark) :], level
                if self.position == "after" and symbol.endswith(mark):
                    return symbol[: -len(mark)], level
        return None
