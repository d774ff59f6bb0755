"""The mouse in the window: clicks and drags on the stage, the panel and the strip."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from corpus_tools.inspection import listing
from corpus_tools.inspection.strip import LEFT, Row
from mocap_fit.edits import MoveBoundary

if TYPE_CHECKING:
    from corpus_tools.inspection.window import Window

# Pixels: a press that moves less is a click.
_STILL = 4
Drag = Callable[[float, float], None]


class Mouse:
    """What the mouse does.

    Parameters
    ----------
    window
        The window.
    style
        The style of VTK that turns what is seen in space.
    """

    def __init__(self, window: Window, style: Any) -> None:
        self._window, self._style = window, style
        self._drag: Drag | None = None
        self._finish: Callable[[], None] | None = None
        self._pressed = (0, 0)
        for event, method in {
            "LeftButtonPressEvent": lambda *_: self._press(),
            "LeftButtonReleaseEvent": lambda *_: self._release(),
            "MouseMoveEvent": lambda *_: self._move(),
            "MouseWheelForwardEvent": lambda *_: self._turn_wheel(1),
            "MouseWheelBackwardEvent": lambda *_: self._turn_wheel(-1),
        }.items():
            style.AddObserver(event, method)

    def _locate(self) -> tuple[str, float, float]:
        """Return the area of the mouse, and where in it it is, pixels from its left and top."""
        x, y = self._window.interactor.GetEventPosition()
        return self._window.find_area(x, y)

    def _press(self) -> None:
        window = self._window
        self._pressed = window.interactor.GetEventPosition()
        self._drag = self._finish = None
        area, x, y = self._locate()
        if area != "status":
            window.message = ""
        if area == "stage":
            self._style.OnLeftButtonDown()
        elif area == "panel":
            self._press_panel(x, y)
        elif area == "strip":
            self._press_strip(x, y)
        window.draw()

    def _move(self) -> None:
        if self._drag is not None:
            x, y = self._window.interactor.GetEventPosition()
            self._drag(x, y)
            self._window.draw()
        elif self._style.GetState():
            self._style.OnMouseMove()
            self._window.draw()

    def _release(self) -> None:
        window = self._window
        x, y = window.interactor.GetEventPosition()
        is_click = max(abs(x - self._pressed[0]), abs(y - self._pressed[1])) < _STILL
        self._style.OnLeftButtonUp()
        area, left, top = self._locate()
        if is_click and area == "stage":
            _, _, width, height = window.areas["stage"]
            window.stage.picked = window.stage.pick(left, top, (width, height))
        finish, self._drag, self._finish = self._finish, None, None
        if finish is not None and not is_click:
            finish()
        window.draw()

    def _turn_wheel(self, by: int) -> None:
        window, line = self._window, self._window.line
        area, x, _ = self._locate()
        if area == "stage":
            window.stage.zoom_in(1.1**by)
        elif area == "panel":
            window.panel.scroll = max(window.panel.scroll - 2 * by, 0)
            window.panel.chosen = -1
        elif area == "strip" and x < LEFT:
            last = max(len(window.strip.parameters) - 1, 0)
            window.strip.first_parameter = min(max(window.strip.first_parameter - by, 0), last)
        elif area == "strip" and window.interactor.GetControlKey():
            line.zoom(1.5**by, window.to_time(x))
        elif area == "strip":
            line.scroll(-0.15 * by)
        window.draw()

    # ---- the panel --------------------------------------------------------------------------

    def _press_panel(self, x: float, y: float) -> None:
        window = self._window
        kind, what = window.panel.locate(x, y)
        if kind == "tab":
            window.show_tab(what)
        elif kind == "item" and window.panel.choice is not None:
            window.finish_choice(window.panel.choice.fitting[what])
        elif kind == "item":
            window.panel.chosen = what
            item = window.panel.items[what]
            if item.value is None:
                listing.pick_item(window, item)
            else:
                left = window.areas["panel"][0]
                self._drag = lambda x, _: self._slide(item.key, x - left)
                self._slide(item.key, x)

    def _slide(self, parameter: str, x: float) -> None:
        window = self._window
        rig = window.material.rig
        assert rig is not None
        low, high = rig.bounds[rig.parameter_names.index(parameter)]
        value = float(low + window.panel.to_value(x) * (high - low))
        window.stage.overrides[parameter] = value

    # ---- the strip --------------------------------------------------------------------------

    def _press_strip(self, x: float, y: float) -> None:
        window, line = self._window, self._window.line
        row = window.strip.locate_row(y)
        width = window.areas["strip"][2]
        if row is None or x < LEFT:
            return
        time = window.to_time(x)
        if row.kind == "overview":
            self._drag = lambda x, _: self._scroll_to(x)
            self._scroll_to(x)
            return
        finding = window.strip.locate_mark(x, line, width) if row.kind == "findings" else None
        if finding is not None:
            window.show_tab("findings")
            window.panel.chosen = list(window.material.findings).index(finding)
            listing.show_finding(window, finding)
            return
        if row.kind in ("phones", "words"):
            boundary = window.strip.locate_boundary(x, row, line, width)
            if boundary is not None and row.kind == "phones" and window.mending is not None:
                self._drag_boundary(boundary)
                return
            self._pick_label(row, time)
        else:
            line.selection = None
            line.move_cursor(time)
        self._drag = lambda x, _: line.select(time, window.to_time(x))

    def _scroll_to(self, x: float) -> None:
        window, line = self._window, self._window.line
        part = (x - LEFT) / (window.areas["strip"][2] - LEFT)
        middle = line.first + part * (line.last - line.first)
        line.show(middle - line.span / 2, middle + line.span / 2)

    def _pick_label(self, row: Row, time: float) -> None:
        """Pick a phone or a word, and select its stretch of time."""
        window = self._window
        for index, label in enumerate(window.material.tiers[row.name].entries):
            if label.start <= time < label.end:
                window.line.select(label.start, label.end)
                if row.kind == "phones":
                    window.pick_phone(index)
                return

    def _drag_boundary(self, boundary: float) -> None:
        """Let a boundary between phones be dragged; the selection shows where it goes."""
        window, line = self._window, self._window.line
        mending = window.mending
        assert mending is not None
        line.selection = None
        line.move_cursor(boundary)
        self._drag = lambda x, _: line.select(boundary, window.to_time(x))

        def finish() -> None:
            ends = line.selection
            line.selection = None
            if ends is None:
                return
            to = ends[0] if abs(ends[1] - boundary) < abs(ends[0] - boundary) else ends[1]
            edit = MoveBoundary(time=round(boundary, 6), to=round(to, 4))
            window.change(lambda: mending.add(edit), f"boundary moved to {to:.3f} s")

        self._finish = finish
