"""The keys of the window, and what each does."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from corpus_tools.inspection.checking import guess_phone_set
from corpus_tools.inspection.listing import list_tabs, pick_item
from mocap_fit.edits import (
    DropMarker,
    DropSpan,
    Edit,
    Merge,
    Mirror,
    Relabel,
    Rename,
    SetReference,
    Split,
    Swap,
)
from mocap_fit.fitting import suggest_reference
from mocap_fit.labels import Label
from mocap_fit.phones import load_phone_set
from mocap_fit.tracks.rigid_sets import compute_median

if TYPE_CHECKING:
    from corpus_tools.inspection.stage import StageView
    from corpus_tools.inspection.window import Window


@dataclass(frozen=True)
class Action:
    """What a key does.

    Parameters
    ----------
    text
        What it does, for the list of keys.
    act
        Does it.
    """

    text: str
    act: Callable[[Window], object]


def _step(frames: int) -> Callable[[Window], None]:
    def act(window: Window) -> None:
        window.line.stop()
        window.player.stop()
        window.line.step(frames)

    return act


def _look(view: StageView) -> Callable[[Window], None]:
    def act(window: Window) -> None:
        window.view = view
        window.stage.set_view(view)

    return act


def _set_speed(speed: float) -> Callable[[Window], None]:
    def act(window: Window) -> None:
        window.line.speed = 1.0 if window.line.speed == speed else speed
        if window.line.is_playing:
            window.play()
            window.play()

    return act


def _switch_loop(window: Window) -> None:
    window.line.loops = not window.line.loops


def _switch_names(window: Window) -> None:
    window.with_names = not window.with_names


def _switch_motion(window: Window) -> None:
    window.stage.with_motion = not window.stage.with_motion


def _switch_stretch(window: Window) -> None:
    window.stage.stretch = 1.0 if window.stage.stretch != 1.0 else 10.0


def _show_next_tab(window: Window) -> None:
    tabs = list(list_tabs(window))
    window.show_tab(tabs[(tabs.index(window.panel.tab) + 1) % len(tabs)])


def _move_in_list(by: int) -> Callable[[Window], None]:
    def act(window: Window) -> None:
        panel = window.panel
        if panel.items:
            panel.chosen = min(max(panel.chosen + by, 0), len(panel.items) - 1)
            if panel.tab in ("findings", "markers"):
                pick_item(window, panel.items[panel.chosen])

    return act


def _pick_in_list(window: Window) -> None:
    if 0 <= window.panel.chosen < len(window.panel.items):
        pick_item(window, window.panel.items[window.panel.chosen])


def _reset(window: Window) -> None:
    window.stage.overrides.clear()
    window.stage.picked = None
    window.pick_phone(None)
    window.line.selection = None


# ---- mending --------------------------------------------------------------------------------


def _add(window: Window, edit: Edit, done: str) -> None:
    mending = window.mending
    if mending is None:
        window.say("only recordings are mended: open the recording itself")
        return
    window.change(lambda: mending.add(edit), f"{done}; Ctrl+Z undoes it")


def _get_ends(window: Window) -> tuple[float | None, float | None]:
    """Return the ends of the selection on the recording's clock; None where there is none."""
    span, mending = window.line.selection, window.mending
    if span is None or mending is None:
        return None, None
    return mending.to_edit_times(*span)


def _describe_span(window: Window) -> str:
    span = window.line.selection
    return "throughout" if span is None else f"from {span[0]:.3f} to {span[1]:.3f} s"


def _need_marker(window: Window) -> str | None:
    """Return the marker that is picked, or say that one must be."""
    if window.stage.picked is None or window.material.recording is None:
        window.say("pick a marker first: click on it, or in the list of markers")
        return None
    return window.stage.picked


def _rename(window: Window) -> None:
    name, recording = _need_marker(window), window.material.recording
    if name is None or recording is None:
        return
    layout = window.material.layout
    known = [] if layout is None else [marker.name for marker in layout.markers]
    free = [each for each in known if each not in recording.names]
    window.choose(
        f"another name of {name}" if free else f"{name}: every name of the layout is taken",
        free,
        lambda new: _add(window, Rename(old=name, new=new), f"{name} is called {new}"),
    )


def _swap(window: Window) -> None:
    name, recording = _need_marker(window), window.material.recording
    if name is None or recording is None:
        return
    # The nearest are exchanged most often.
    middle = compute_median(recording.positions)
    apart = np.linalg.norm(middle - middle[recording.index(name)], axis=1)
    nearest = [recording.names[k] for k in np.argsort(np.nan_to_num(apart, nan=np.inf))]
    # First, however, those that a finding names.
    others = [n for n in dict.fromkeys([*window.named, *nearest]) if n != name]
    start, end = _get_ends(window)
    window.choose(
        f"swap {name} {_describe_span(window)} with",
        others,
        lambda other: _add(
            window,
            Swap(markers=(name, other), start=start, end=end),
            f"{name} and {other} swapped {_describe_span(window)}",
        ),
    )


def _drop_span(window: Window) -> None:
    if window.line.selection is None:
        window.say("select a stretch of time first: drag over the curves")
        return
    name = window.stage.picked
    start, end = _get_ends(window)
    edit = DropSpan(markers=() if name is None else (name,), start=start, end=end)
    _add(window, edit, f"{name or 'all markers'} dropped {_describe_span(window)}")


def _drop_marker(window: Window) -> None:
    name = _need_marker(window)
    if name is not None:
        _add(window, DropMarker(marker=name), f"{name} dropped")


def _mirror(window: Window) -> None:
    window.choose(
        "mirror the recording along",
        ["x", "y", "z"],
        lambda axis: _add(window, Mirror.model_validate({"axis": axis}), f"mirrored along {axis}"),
    )


def _set_reference(window: Window) -> None:
    recording, layout = window.material.recording, window.material.layout
    if window.line.selection is None and recording is not None and layout is not None:
        # The stillest with closed lips.
        span = suggest_reference(recording, layout)
        window.line.select(span.start, span.end)
    start, end = _get_ends(window)
    _add(window, SetReference(start=start, end=end), f"reference pose {_describe_span(window)}")


def _get_phone(window: Window) -> Label | None:
    """Return the phone that is picked, or that at the cursor, or say that there is none."""
    phones = window.material.tiers.get("phones")
    entries = () if phones is None else phones.entries
    if window.picked_phone is not None and window.picked_phone < len(entries):
        return entries[window.picked_phone]
    cursor = window.line.cursor
    for label in entries:
        if label.start <= cursor < label.end:
            return label
    window.say("pick a phone first: click on it")
    return None


def _list_symbols(window: Window) -> list[str]:
    """Return symbols of phones: those of the phone set that fits best."""
    phones = window.material.tiers["phones"]
    used = dict.fromkeys(e.text.strip() for e in phones.entries if e.text.strip())
    name = window.sources.phone_set
    phone_set = guess_phone_set(phones) if name is None else load_phone_set(name)
    symbols = [] if phone_set is None else list(phone_set.list_symbols())
    return list(dict.fromkeys([*symbols, *used]))


def _relabel(window: Window) -> None:
    label = _get_phone(window)
    if label is None:
        return
    middle = round(0.5 * (label.start + label.end), 4)
    window.choose(
        f"another symbol of '{label.text}' at {label.start:.3f} s",
        _list_symbols(window),
        lambda phone: _add(
            window,
            Relabel(time=middle, phone=phone, former=label.text.strip()),
            f"{label.text} is {phone}",
        ),
    )


def _split(window: Window) -> None:
    cursor = round(window.line.cursor, 4)
    phones = window.material.tiers.get("phones")
    for label in () if phones is None else phones.entries:
        if label.start < cursor < label.end:
            text = label.text.strip() or "sil"
            edit = Split(time=cursor, phones=(text, text))
            _add(window, edit, f"{text} split at {cursor:.3f} s; L gives either half its symbol")
            return
    window.say("put the cursor into the phone that is to be split")


def _merge(window: Window) -> None:
    cursor = window.line.cursor
    phones = window.material.tiers.get("phones")
    entries = () if phones is None else phones.entries
    pairs = [(a, b) for a, b in itertools.pairwise(entries) if a.end == b.start]
    if not pairs:
        window.say("there are no two phones that meet")
        return
    one, other = min(pairs, key=lambda pair: abs(pair[0].end - cursor))
    names = [one.text.strip(), other.text.strip(), *_list_symbols(window)]
    window.choose(
        f"merge '{one.text}' and '{other.text}' into",
        list(dict.fromkeys(filter(None, names))),
        lambda phone: _add(
            window, Merge(time=one.end, phone=phone), f"{one.text} and {other.text} are {phone}"
        ),
    )


def _undo(window: Window) -> None:
    if window.mending is not None:
        window.change(window.mending.undo, "undone; Ctrl+Y brings it back")


def _redo(window: Window) -> None:
    if window.mending is not None:
        window.change(window.mending.redo, "done again")


def _save(window: Window) -> None:
    if window.mending is None:
        window.say("only recordings are mended")
        return
    path = window.mending.save()
    window.say(f"saved in {path}")


KEYS: dict[str, Action] = {
    "space": Action("play from the cursor, or stop", lambda w: w.play()),
    "Tab": Action("play the selection, or what is shown", lambda w: w.play(only_selection=True)),
    "Right": Action("next frame", _step(1)),
    "Left": Action("frame before", _step(-1)),
    "Next": Action("next page", lambda w: w.line.scroll(0.9)),
    "Prior": Action("page before", lambda w: w.line.scroll(-0.9)),
    "Home": Action("to the start", lambda w: w.line.move_cursor(w.line.first)),
    "End": Action("to the end", lambda w: w.line.move_cursor(w.line.last)),
    "Ctrl+I": Action("zoom in", lambda w: w.line.zoom_in()),
    "Ctrl+O": Action("zoom out", lambda w: w.line.zoom_out()),
    "Ctrl+N": Action("zoom to the selection", lambda w: w.line.zoom_to_selection()),
    "Ctrl+A": Action("show all", lambda w: w.line.zoom_to_all()),
    "O": Action("loop", _switch_loop),
    "comma": Action("half speed", _set_speed(0.5)),
    "period": Action("double speed", _set_speed(2.0)),
    "1": Action("from the front", _look("front")),
    "2": Action("three-quarter", _look("three-quarter")),
    "3": Action("from the side", _look("side")),
    "7": Action("from above", _look("top")),
    "N": Action("names of markers", _switch_names),
    "H": Action("with or without the head's motion", _switch_motion),
    "E": Action("residuals drawn ten times as long", _switch_stretch),
    "F": Action("findings", lambda w: w.show_tab("findings")),
    "P": Action("sliders of the parameters", lambda w: w.show_tab("parameters")),
    "K": Action("keys", lambda w: w.show_tab("keys")),
    "G": Action("next list", _show_next_tab),
    "Down": Action("next in the list", _move_in_list(1)),
    "Up": Action("one before in the list", _move_in_list(-1)),
    "Return": Action("pick in the list", _pick_in_list),
    "Escape": Action("nothing is picked, sliders rest", _reset),
    "R": Action("rename the marker", _rename),
    "X": Action("swap the marker with another, in the selection", _swap),
    "D": Action("drop the marker (or all) in the selection", _drop_span),
    "Shift+D": Action("drop the marker throughout", _drop_marker),
    "Shift+M": Action("mirror the recording", _mirror),
    "Shift+R": Action("the selection, or the stillest part, is the reference pose", _set_reference),
    "L": Action("relabel the phone", _relabel),
    "B": Action("split the phone at the cursor", _split),
    "M": Action("merge the two phones at the nearest boundary", _merge),
    "Ctrl+Z": Action("undo", _undo),
    "Ctrl+Y": Action("redo", _redo),
    "Ctrl+Shift+Z": Action("redo", _redo),
    "Ctrl+S": Action("save the edit list", _save),
    "Ctrl+Q": Action("close", lambda w: w.leave()),
    "Ctrl+W": Action("close", lambda w: w.leave()),
}
"""Keys by their names, as they are listed."""
