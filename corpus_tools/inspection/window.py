"""The window: a head and markers above, sound, labels and curves below, lists at the right."""

from __future__ import annotations

import functools
import time
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from corpus_tools.inspection import editing, listing
from corpus_tools.inspection.gather import check, gather_utterance
from corpus_tools.inspection.material import Material
from corpus_tools.inspection.mending import start_mending
from corpus_tools.inspection.mouse import Mouse
from corpus_tools.inspection.overlay import Words, put_words
from corpus_tools.inspection.panel import Choice, Panel
from corpus_tools.inspection.screen import Area, Screen
from corpus_tools.inspection.sound_player import SoundPlayer
from corpus_tools.inspection.sources import Sources
from corpus_tools.inspection.stage import Stage, StageView
from corpus_tools.inspection.strip import LEFT, Strip, combine_extent
from corpus_tools.inspection.time_line import TimeLine
from mocap_fit.corpus import open_corpus
from mocap_fit.errors import ConfigurationError, MocapFitError

SIZE = (1280, 800)
"""Width and height, pixels."""

_STATUS = 22
_PANEL = 400


class Window:
    """A window on some material, interactive or off screen.

    What a person does reaches it as events of VTK, which `press`, `pick` and `drag` send too.

    Parameters
    ----------
    material
        What is shown.
    other
        What it is compared with, drawn over it.
    sources
        What belongs to it, for mending.
    size
        Width and height, pixels.
    off_screen
        Whether it is drawn without a screen.

    Raises
    ------
    MissingExtraError
        If there is no screen, or nothing that draws without one.
    """

    line: TimeLine
    player: SoundPlayer

    def __init__(
        self,
        material: Material,
        other: Material | None = None,
        *,
        sources: Sources | None = None,
        size: tuple[int, int] = SIZE,
        off_screen: bool = False,
    ) -> None:
        self._screen = Screen(size, off_screen=off_screen)
        self.interactor = self._screen.interactor
        self.other = other
        self.sources = sources or Sources()
        self.mending = start_mending(material, self.sources)
        self.panel = Panel()
        self.view: StageView = "front"
        self.with_names = material.recording is None and not material.heads
        self.message = ""
        self.named: tuple[str, ...] = ()
        self.picked_phone: int | None = None
        self._leaves_unsaved = False
        self.material = material
        self.stage = Stage(self._screen.plotter, material, other)
        self.stage.set_view(self.view)
        self.strip = Strip(material, other)
        self._set_time()
        self._observe()
        self.panel.tab = listing.choose_tab(self)
        self.draw()

    # ---- what is shown ----------------------------------------------------------------------

    def _observe(self) -> None:
        """Take the events of keys, mouse, clock and window."""
        style = self._screen.style
        # With an observer of ours, the keys of VTK do nothing.
        style.AddObserver("CharEvent", lambda *_: None)
        style.AddObserver("KeyReleaseEvent", lambda *_: None)
        style.AddObserver("KeyPressEvent", lambda *_: self._take_key())
        self._mouse = Mouse(self, style)
        self.interactor.AddObserver("ConfigureEvent", lambda *_: self._resize())
        self.interactor.AddObserver("TimerEvent", lambda *_: self.advance(time.monotonic()))
        self.interactor.AddObserver("ExitEvent", lambda *_: self.leave())

    def _set_time(self) -> None:
        """Begin with all of the time, and the sound."""
        shown = [self.material] if self.other is None else [self.material, self.other]
        tracks = self.material.tracks
        origin = tracks[0].start_time if tracks else 0.0
        self.line = TimeLine(*combine_extent(shown), self.material.rate, origin)
        self.player = SoundPlayer(self.material.sound)

    def _set_material(self, material: Material) -> None:
        """Show something else, from the same side."""
        self.material, former = material, self.stage
        self._screen.clear()
        self.stage = Stage(self._screen.plotter, material, self.other)
        self.stage.picked = former.picked if former.picked in self.stage.names else None
        self.stage.with_motion, self.stage.stretch = former.with_motion, former.stretch
        self.strip = Strip(material, self.other)
        self.strip.picked = self.picked_phone

    @property
    def areas(self) -> dict[str, Area]:
        """Left, bottom, width and height of stage, panel, strip and status, pixels."""
        width, height = self.size
        panel = min(_PANEL, width // 3)
        tall = 0
        if self.material.tracks or self.material.sound is not None:
            tall = min(self.strip.measure(), round(0.52 * (height - _STATUS)))
        top = _STATUS + tall
        return {
            "stage": (0, top, width - panel, height - top),
            "panel": (width - panel, top, panel, height - top),
            "strip": (0, _STATUS, width, tall),
            "status": (0, 0, width, _STATUS),
        }

    def draw(self) -> None:
        """Draw everything at the time of the cursor."""
        areas, line = self.areas, self.line
        self._screen.set_stage(areas["stage"])
        self.stage.update(line.cursor)
        title = " and ".join(m.title for m in (self.material, self.other) if m is not None)
        words = Words(title, self.material.notes, tuple(self.strip.heads), self.with_names)
        put_words(self._screen, self.stage, areas["stage"], words)
        listing.fill_panel(self)
        self._screen.put("panel", areas["panel"], self.panel.key, self.panel.paint)
        self._draw_strip(areas["strip"])
        paint = functools.partial(listing.paint_status, self)
        self._screen.put("status", areas["status"], None, paint)
        self._screen.render()

    def _draw_strip(self, area: Area) -> None:
        _, bottom, width, height = area
        if not height:
            return
        line = self.line
        self.strip.trace_marker(self.stage.picked)
        shown = self.stage.picked, self.strip.picked, self.strip.first_parameter
        key = (line.start, line.end, *shown)
        self._screen.put("strip", area, key, lambda *size: self.strip.paint(line, *size))
        tall = height - (self.strip.rows[-1].bottom - self.strip.rows[-1].top)
        low = bottom + height - tall
        x = self.strip.to_x(line.cursor, line, width)
        self._screen.cursor.update(x, low, 1, tall)
        if line.selection is None:
            self._screen.selection.hide()
            return
        ends = [self.strip.to_x(each, line, width) for each in line.selection]
        first, last = max(ends[0], LEFT), min(ends[1], width)
        if last <= first:
            self._screen.selection.hide()
        else:
            self._screen.selection.update(first, low, last - first, tall)

    @property
    def size(self) -> tuple[int, int]:
        """Width and height, pixels."""
        return self._screen.size

    def set_up(
        self,
        *,
        at: float | None = None,
        view: StageView = "front",
        names: bool = False,
        tab: str | None = None,
    ) -> None:
        """Show a time, from a side, with a list.

        Parameters
        ----------
        at
            Time of the cursor, seconds; the middle by default.
        view
            From where the head is seen.
        names
            Whether every marker has its name.
        tab
            The list that is shown; the one that says most by default.

        Raises
        ------
        ConfigurationError
            If there is no such list.
        """
        tabs = listing.list_tabs(self)
        if tab is not None and tab not in tabs:
            raise ConfigurationError(
                f"there is no list '{tab}' of {self.material.title}",
                expected=f"one of {', '.join(tabs)}",
            )
        middle = 0.5 * (self.line.first + self.line.last)
        self.line.move_cursor(middle if at is None else at)
        self.view = view
        self.stage.set_view(view)
        self.with_names = self.with_names or names
        self.show_tab(tab or self.panel.tab)
        self.draw()

    def capture(self) -> NDArray[np.uint8]:
        """Return the picture of the window.

        Returns
        -------
        ndarray
            Red, green and blue, ``(height, width, 3)``.
        """
        return self._screen.capture()

    def show(self) -> None:
        """Show the window until it is closed."""
        self._screen.start()
        self.close()

    def close(self) -> None:
        """Close the window and free its memory."""
        self.player.stop()
        self._screen.close()

    def leave(self) -> None:
        """End the loop of `show`; with edits that are not saved, only when asked again."""
        if self.mending is not None and not self.mending.is_saved and not self._leaves_unsaved:
            self._leaves_unsaved = True
            self.say("edits are not saved: Ctrl+S saves them, closing again leaves them")
            return
        self.interactor.TerminateApp()

    def say(self, text: str) -> None:
        """Show a message until the next one.

        Parameters
        ----------
        text
            The message.
        """
        self.message = text
        self.draw()

    # ---- time -------------------------------------------------------------------------------

    def play(self, *, only_selection: bool = False) -> None:
        """Play or stop.

        Parameters
        ----------
        only_selection
            Whether the selection is played, or what is shown.
        """
        if self.line.is_playing:
            self.line.stop()
            self.player.stop()
            return
        start, end = self.line.play(time.monotonic(), only_selection=only_selection)
        self.player.play(start, end, self.line.speed)

    def advance(self, now: float) -> None:
        """Show what is due while it plays.

        Parameters
        ----------
        now
            Time of the clock, seconds.
        """
        if not self.line.is_playing:
            return
        if self.line.advance(now, self.player.position):
            start, end = self.line.selection or (self.line.cursor, self.line.last)
            self.player.play(start, end, self.line.speed)
        if not self.line.is_playing:
            self.player.stop()
        self.draw()

    def open_utterance(self, name: str) -> None:
        """Show another utterance of the corpus.

        Parameters
        ----------
        name
            Its id.
        """
        self.player.stop()
        self.picked_phone = None
        self._set_material(gather_utterance(open_corpus(self.material.path), name))
        self._set_time()
        self.message = ""

    def change(self, act: Callable[[], Material | None], done: str) -> None:
        """Change the edit list, and show what has become of the recording.

        Parameters
        ----------
        act
            Returns what there is to show now; None where nothing has changed.
        done
            What is said afterwards.
        """
        try:
            material = act()
        except MocapFitError as error:
            self.say(str(error))
            return
        self._leaves_unsaved = False
        if material is not None:
            cursor, shown = self.line.cursor, (self.line.start, self.line.end)
            self._set_material(material)
            self.line.first, self.line.last = combine_extent([material])
            self.line.show(*shown)
            self.line.move_cursor(cursor)
        self.say(done if material is not None else "there is nothing to undo or redo")

    def choose(self, title: str, options: list[str], act: Callable[[str], None]) -> None:
        """Let a name be chosen in the panel.

        Parameters
        ----------
        title
            What is chosen.
        options
            The names.
        act
            Called with the name.
        """
        self.panel.choice = Choice(title, options)
        self._chosen = act

    # ---- events -----------------------------------------------------------------------------

    def press(self, key: str, *, ctrl: bool = False, shift: bool = False) -> None:
        """Press a key, as a person does.

        Parameters
        ----------
        key
            Its name in X, such as ``Right``, ``space`` or ``i``.
        ctrl, shift
            Whether these are down.
        """
        code = key if len(key) == 1 else "\0"
        self.interactor.SetKeyEventInformation(int(ctrl), int(shift), code, 0, key)
        for event in ("KeyPressEvent", "CharEvent", "KeyReleaseEvent"):
            self.interactor.InvokeEvent(event)

    def pick(self, x: float, y: float) -> None:
        """Click, as a person does.

        Parameters
        ----------
        x, y
            Distances in pixels from the left and from the top of the window.
        """
        self.drag(x, y, x, y)

    def drag(self, x0: float, y0: float, x1: float, y1: float) -> None:
        """Drag from a point to another one with the left button, as a person does.

        Parameters
        ----------
        x0, y0, x1, y1
            Distances in pixels from the left and from the top of the window.
        """
        self._send(x0, y0, "MouseMoveEvent", "LeftButtonPressEvent")
        for part in (0.5, 1.0):
            if (x0, y0) != (x1, y1):
                self._send(x0 + part * (x1 - x0), y0 + part * (y1 - y0), "MouseMoveEvent")
        self._send(x1, y1, "LeftButtonReleaseEvent")

    def _send(self, x: float, y: float, *events: str) -> None:
        bottom = self.size[1] - 1 - round(y)
        self.interactor.SetEventInformation(round(x), bottom, 0, 0, "\0", 0, None)
        for event in events:
            self.interactor.InvokeEvent(event)

    def _take_key(self) -> None:
        name = str(self.interactor.GetKeySym()).removeprefix("KP_")
        ctrl, shift = self.interactor.GetControlKey(), self.interactor.GetShiftKey()
        if self.panel.choice is not None:
            self._press_in_choice(name)
        else:
            name = name.upper() if len(name) == 1 else name
            full = f"{'Ctrl+' if ctrl else ''}{'Shift+' if shift and name.isalpha() else ''}{name}"
            action = editing.KEYS.get(full)
            if action is None:
                return
            self.message = ""
            action.act(self)
        self.draw()

    def _press_in_choice(self, name: str) -> None:
        assert self.panel.choice is not None
        if name == "Escape":
            self.panel.choice = None
            return
        code = self.interactor.GetKeyCode()
        special = name in ("Return", "Enter", "Up", "Down", "BackSpace")
        key = {"Enter": "Return"}.get(name, name) if special else code
        self.finish_choice(self.panel.choice.press(key))

    def find_area(self, x: float, y: float) -> tuple[str, float, float]:
        """Find the area at a point.

        Parameters
        ----------
        x, y
            Distances in pixels from the left and from the bottom of the window.

        Returns
        -------
        tuple
            Its name, and where in it the point is, pixels from its left and from its top.
        """
        for name, (left, bottom, width, height) in self.areas.items():
            if left <= x < left + width and bottom <= y < bottom + height:
                return name, x - left, bottom + height - 1 - y
        return "status", x, 0.0

    def to_time(self, x: float) -> float:
        """Return the time at a column of the strip, seconds.

        Parameters
        ----------
        x
            Distance in pixels from the left.

        Returns
        -------
        float
            The time, seconds.
        """
        return self.strip.to_time(x, self.line, self.areas["strip"][2])

    def finish_choice(self, name: str | None) -> None:
        """Do what the choice is for.

        Parameters
        ----------
        name
            The name that was chosen; None where none is yet.
        """
        if name is not None:
            self.panel.choice = None
            self._chosen(name)

    def _resize(self) -> None:
        if self._screen.measure():
            self.draw()

    def show_tab(self, name: str) -> None:
        """Show another list in the panel.

        Parameters
        ----------
        name
            Its name.
        """
        self.panel.tab, self.panel.scroll, self.panel.chosen = name, 0, -1
        if name == "findings" and not self.material.is_checked:
            self._set_material(check(self.material, self.sources))

    def pick_phone(self, index: int | None) -> None:
        """Pick a phone.

        Parameters
        ----------
        index
            Its number in the tier; None picks none.
        """
        self.picked_phone = self.strip.picked = index
