"""The panel at the right of the window: rows that are picked, sliders, and choices by typing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from corpus_tools.inspection.paint import (
    BLUE,
    CHOSEN,
    FAINT,
    INK,
    PAPER,
    RULE,
    SHADE,
    Canvas,
    Colour,
    fit_text,
)

_TAB_HEIGHT = 26
_LINE = 17
_INFO_LINE = 18
_KNOB = 5


@dataclass(frozen=True)
class Item:
    """A row of a list.

    Parameters
    ----------
    text
        What it says first.
    detail
        What it says in a second line; empty for none.
    key
        What is picked with it.
    colour
        Colour of its mark; None for none.
    right
        What it says at the right.
    value
        Position of its slider, 0 to 1; None without.
    rest
        Position of the slider's rest, 0 to 1.
    """

    text: str
    detail: str = ""
    key: Any = None
    colour: Colour | None = None
    right: str = ""
    value: float | None = None
    rest: float = 0.0

    @property
    def height(self) -> int:
        """Height of the row, pixels."""
        return 8 + _LINE * (2 if self.detail else 1)


@dataclass
class Choice:
    """A choice among names, which can be typed.

    Parameters
    ----------
    title
        What is chosen.
    options
        The names.
    chosen
        Index among those that fit what was typed.
    typed
        What was typed.
    """

    title: str
    options: Sequence[str]
    chosen: int = 0
    typed: str = ""

    @property
    def fitting(self) -> list[str]:
        """What was typed, the names that begin with it, then those that contain it."""
        text = self.typed.casefold()
        fitting = [name for name in self.options if text in name.casefold()]
        # False comes before true.
        return sorted(fitting, key=lambda n: (n != self.typed, not n.startswith(self.typed)))

    def press(self, key: str) -> str | None:
        """Take a key.

        Parameters
        ----------
        key
            A letter, or ``Up``, ``Down``, ``BackSpace`` or ``Return``.

        Returns
        -------
        str or None
            The name that is chosen; None while none is.
        """
        if key == "Return":
            return self.fitting[self.chosen] if self.fitting else None
        if key in ("Up", "Down"):
            self.chosen += 1 if key == "Down" else -1
        elif key == "BackSpace":
            self.typed = self.typed[:-1]
        elif len(key) == 1:
            self.typed, self.chosen = self.typed + key, 0
        self.chosen = min(max(self.chosen, 0), max(len(self.fitting) - 1, 0))
        return None


@dataclass
class Panel:
    """What the panel shows.

    Parameters
    ----------
    tab
        Which of its lists.
    tabs
        Those that there are, and how many items each has, or nothing.
    items
        The rows of the list.
    info
        Lines about what is picked: pairs of a name and a value.
    chosen
        Index of the row that is picked; -1 for none.
    scroll
        Number of rows above the first that is visible.
    choice
        A choice that is open; None for none.
    """

    tab: str = "findings"
    tabs: dict[str, str] = field(default_factory=dict)
    items: list[Item] = field(default_factory=list)
    info: list[tuple[str, str]] = field(default_factory=list)
    chosen: int = -1
    scroll: int = 0
    choice: Choice | None = None

    def __post_init__(self) -> None:
        #: Index of every row that is visible, its first pixel from the top, and the one after it.
        self.rows: list[tuple[int, int, int]] = []
        self._tab_areas: list[tuple[str, float, float]] = []
        self._slider = (0.0, 1.0)

    @property
    def key(self) -> tuple[object, ...]:
        """What it shows: the same looks the same."""
        choice = self.choice
        typed = None if choice is None else (choice.title, choice.typed, choice.chosen)
        shown = tuple(self.items), tuple(self.info), tuple(self.tabs.items())
        return *shown, self.tab, self.chosen, self.scroll, typed

    def locate(self, x: float, y: float) -> tuple[str, Any]:
        """Return what is at a point.

        Parameters
        ----------
        x, y
            Distances in pixels from the left and from the top of the panel.

        Returns
        -------
        tuple
            ``tab`` and its name, ``item`` and its index, or ``nothing`` and None.
        """
        if y < _TAB_HEIGHT and self.choice is None:
            for name, left, right in self._tab_areas:
                if left <= x < right:
                    return "tab", name
        for index, top, bottom in self.rows:
            if top <= y < bottom:
                return "item", index
        return "nothing", None

    def to_value(self, x: float) -> float:
        """Return the position of a slider at a column, 0 to 1.

        Parameters
        ----------
        x
            Distance in pixels from the left of the panel.

        Returns
        -------
        float
            The position.
        """
        left, right = self._slider
        return min(max((x - left) / (right - left), 0.0), 1.0)

    def paint(self, width: int, height: int) -> NDArray[np.uint8]:
        """Paint the panel.

        Parameters
        ----------
        width, height
            Its size, pixels.

        Returns
        -------
        ndarray
            The picture, ``(height, width, 3)``.
        """
        canvas = Canvas(width, height)
        self.rows, self._tab_areas = [], []
        self._slider = (0.42 * width, width - 64.0)
        if self.choice is not None:
            self._paint_choice(canvas, self.choice)
        else:
            self._paint_tabs(canvas)
            top = self._paint_info(canvas, _TAB_HEIGHT)
            self._paint_items(canvas, self.items, top)
        canvas.fill(0, 0, 1, height, RULE)
        return canvas.pixels

    def _paint_tabs(self, canvas: Canvas) -> None:
        canvas.fill(0, 0, canvas.width, _TAB_HEIGHT, SHADE)
        x = 4.0
        for name, count in self.tabs.items():
            text = f"{name.capitalize()} {count}".strip()
            chosen = name == self.tab
            left, x = x, x + 8
            if chosen:
                # Painted again over its paper.
                wide = canvas.write(x, -40, text, size=11)
                canvas.fill(left, 2, x + wide + 8, _TAB_HEIGHT, PAPER)
            x += canvas.write(x, 14, text, INK if chosen else FAINT, 11) + 8
            self._tab_areas.append((name, left, x))
        canvas.fill(0, _TAB_HEIGHT - 1, canvas.width, _TAB_HEIGHT, RULE)
        for name, left, right in self._tab_areas:
            if name == self.tab:
                canvas.fill(left, _TAB_HEIGHT - 2, right, _TAB_HEIGHT, BLUE)

    def _paint_info(self, canvas: Canvas, top: int) -> int:
        if not self.info:
            return top + 4
        bottom = top + 8 + _INFO_LINE * len(self.info)
        canvas.fill(0, top, canvas.width, bottom, SHADE)
        for number, (name, value) in enumerate(self.info):
            y = top + 4 + _INFO_LINE * (number + 0.5)
            wide = canvas.write(12, y, name, INK if not number else FAINT, 11, bold=not number)
            rest = canvas.width - wide - 36
            canvas.write(canvas.width - 12, y, fit_text(value, rest, 11), INK, 11, "right")
        canvas.fill(0, bottom - 1, canvas.width, bottom, RULE)
        return bottom + 4

    def _paint_items(self, canvas: Canvas, items: Sequence[Item], top: int) -> None:
        space = canvas.height - top
        # The row that is picked is always visible.
        if 0 <= self.chosen < len(items):
            self.scroll = min(self.scroll, self.chosen)
            while sum(i.height for i in items[self.scroll : self.chosen + 1]) > space - 8:
                self.scroll += 1
        self.scroll = min(max(self.scroll, 0), max(len(items) - 1, 0))
        y = top
        for index in range(self.scroll, len(items)):
            item = items[index]
            if y + item.height > canvas.height:
                break
            self._paint_item(canvas, item, y, chosen=index == self.chosen)
            self.rows.append((index, y, y + item.height))
            y += item.height
        shown = len(self.rows)
        if shown < len(items):
            tall = max(space * shown / len(items), 12.0)
            first = top + (space - tall) * self.scroll / max(len(items) - shown, 1)
            first = min(first, canvas.height - tall)
            canvas.fill(canvas.width - 5, first, canvas.width - 2, first + tall, (190, 196, 206))
        if not items:
            canvas.write(12, top + 14, "none", FAINT, 11)

    def _paint_item(self, canvas: Canvas, item: Item, top: int, *, chosen: bool) -> None:
        width = canvas.width
        if chosen:
            canvas.fill(1, top, width - 6, top + item.height, CHOSEN)
        left = 12.0
        if item.colour is not None:
            canvas.fill(10, top + 6, 14, top + item.height - 6, item.colour)
            left = 22.0
        y = top + 4 + _LINE / 2
        taken: float = (
            canvas.write(width - 12, y, item.right, FAINT, 10, "right") if item.right else 0
        )
        rest = width - left - taken - 22.0
        if item.value is not None:
            low, high = self._slider
            rest = low - left - 8
            canvas.fill(low, y - 2, high, y + 1, RULE)
            x = low + item.value * (high - low)
            zero = low + item.rest * (high - low)
            canvas.fill(min(x, zero), y - 2, max(x, zero), y + 1, BLUE)
            canvas.fill(x - _KNOB, y - 7, x + _KNOB, y + 6, BLUE)
        canvas.write(left, y, fit_text(item.text, rest, 11), INK, 11)
        if item.detail:
            canvas.write(left, y + _LINE, fit_text(item.detail, width - left - 14, 10), FAINT, 10)

    def _paint_choice(self, canvas: Canvas, choice: Choice) -> None:
        canvas.fill(0, 0, canvas.width, 50, CHOSEN)
        canvas.write(
            12, 14, fit_text(choice.title, canvas.width - 24, 12, True), INK, 12, bold=True
        )
        typed = f"{choice.typed}│   (type, ↑ ↓, Enter; Esc leaves)"
        canvas.write(12, 36, fit_text(typed, canvas.width - 24, 11), INK, 11)
        former = self.chosen, self.scroll
        self.chosen, self.scroll = choice.chosen, 0
        self._paint_items(canvas, [Item(name, key=name) for name in choice.fitting], 56)
        self.chosen, self.scroll = former
