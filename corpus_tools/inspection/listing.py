"""What the panel lists: findings, utterances, parameters, markers, edits, keys."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from corpus_tools.inspection.bodies import HEAD_MARKER, MEASURED, colour_residuals
from corpus_tools.inspection.paint import BLUE, FAINT, INK, SHADE, Canvas, Colour, fit_text
from corpus_tools.inspection.panel import Item
from corpus_tools.inspection.strip_painting import SEVERITY_COLOURS
from corpus_tools.validation.findings import Finding
from mocap_fit.edits import Edit
from mocap_fit.tracks import Origin

if TYPE_CHECKING:
    from corpus_tools.inspection.window import Window


def list_tabs(window: Window) -> dict[str, str]:
    """List the lists that there are, with the number of their items.

    Parameters
    ----------
    window
        The window.

    Returns
    -------
    dict of str to str
        Numbers, or nothing, by name.
    """
    material = window.material
    tabs = {}
    if material.utterances:
        tabs["utterances"] = str(len(material.utterances))
    if material.tracks and (material.recording is not None or material.findings):
        tabs["findings"] = str(len(material.findings)) if material.is_checked else "?"
    if material.rig is not None:
        tabs["parameters"] = ""
    if window.stage.names:
        tabs["markers"] = str(len(window.stage.names))
    if window.mending is not None:
        tabs["edits"] = str(len(window.mending.edits.edits))
    tabs["keys"] = ""
    if not window.material.tracks and "markers" in tabs:
        # A layout is its markers.
        tabs = {"markers": tabs.pop("markers"), **tabs}
    return tabs


def choose_tab(window: Window) -> str:
    """Choose the list that says most: the first that is not empty.

    Parameters
    ----------
    window
        The window.

    Returns
    -------
    str
        Its name.
    """
    tabs = list_tabs(window)
    says = [name for name, count in tabs.items() if count not in ("0", "?")]
    return says[0]


def fill_panel(window: Window) -> None:
    """Fill the panel with what its list has now.

    Parameters
    ----------
    window
        The window.
    """
    panel = window.panel
    panel.tabs = list_tabs(window)
    if panel.tab not in panel.tabs:
        panel.tab = next(iter(panel.tabs))
    lists = {
        "findings": _list_findings,
        "utterances": _list_utterances,
        "parameters": _list_parameters,
        "markers": _list_markers,
        "edits": _list_edits,
        "keys": _list_keys,
    }
    panel.items = lists[panel.tab](window)
    panel.info = _describe_picked(window)


def pick_item(window: Window, item: Item) -> None:
    """Do what a row of the list is for.

    Parameters
    ----------
    window
        The window.
    item
        The row that was picked.
    """
    if window.panel.tab == "findings":
        show_finding(window, item.key)
    elif window.panel.tab == "utterances":
        window.open_utterance(item.key)
    elif window.panel.tab == "markers":
        window.stage.picked = item.key


def show_finding(window: Window, finding: Finding) -> None:
    """Show the time and the marker of a finding, and select its stretch of time.

    Parameters
    ----------
    window
        The window.
    finding
        The finding.
    """
    for start, end, each in window.strip.marks:
        if each is finding:
            stop = end + 1 / window.line.rate
            window.line.select(start, stop)
            wide = max(stop - start, 0.2)
            window.line.show(start - wide, end + wide)
            break
    stage = window.stage
    words = finding.location.item.replace(",", " ").split()
    window.named = tuple(word for word in words if word in stage.names)
    stage.picked = next(iter(window.named), None)
    if finding.code.startswith(("MF2", "MF309")) and window.line.selection is not None:
        window.pick_phone(_find_phone(window, window.line.selection[0]))
    window.say(f"{finding.title}: {finding.found}. {finding.advice}")


def _find_phone(window: Window, time: float) -> int | None:
    """Return the index of the phone at a time, or about there."""
    tier = window.material.tiers.get("phones")
    entries = () if tier is None else tier.entries
    inside = [k for k, label in enumerate(entries) if label.start <= time + 1e-3 < label.end]
    return next(iter(inside), None)


def _list_findings(window: Window) -> list[Item]:
    return [
        Item(
            finding.title,
            ", ".join(filter(None, (finding.location.item, _format_time(finding), finding.found))),
            finding,
            SEVERITY_COLOURS[finding.severity],
            finding.code,
        )
        for finding in window.material.findings
    ]


def _format_time(finding: Finding) -> str:
    seconds = finding.location.seconds
    if seconds is None:
        return ""
    return f"{seconds[0]:.2f} s" if seconds[0] == seconds[1] else "{:.2f}–{:.2f} s".format(*seconds)


def _list_utterances(window: Window) -> list[Item]:
    shown = window.material.title.rpartition(": ")[2]
    items = []
    for number, each in enumerate(window.material.utterances):
        if each.id == shown and window.panel.tab == "utterances":
            window.panel.chosen = number
        text = each.text or f"{each.speaker} {each.session}".strip()
        items.append(Item(each.id, text, each.id, None, f"{each.duration:.1f} s, {each.split}"))
    return items


def _list_parameters(window: Window) -> list[Item]:
    rig = window.material.rig
    values = window.stage.get_values(window.line.cursor)
    if rig is None or values is None:
        return []
    items = []
    for name, value, (low, high) in zip(rig.parameter_names, values, rig.bounds, strict=True):
        part = (float(value) - low) / (high - low)
        mark = "•" if name in window.stage.overrides else ""
        items.append(
            Item(
                name.replace("_", " "),
                key=name,
                right=f"{mark} {value:.2f}",
                value=float(np.clip(part, 0, 1)),
                rest=float(-low / (high - low)),
            )
        )
    return items


def _list_markers(window: Window) -> list[Item]:
    stage, recording = window.stage, window.material.recording
    layout = window.material.layout
    described = {} if layout is None else {marker.name: marker for marker in layout.markers}
    items = []
    for number, name in enumerate(stage.names):
        if name == stage.picked and window.panel.tab == "markers":
            window.panel.chosen = number
        known = described.get(name)
        colour: Colour = MEASURED if known is not None else FAINT
        detail = right = ""
        if known is not None and known.role == "head":
            colour = HEAD_MARKER
        if recording is not None and name in recording.names:
            share = 100 * float((~recording.visible[:, recording.index(name)]).mean())
            right = f"gaps {share:.1f} %" if share else ""
        elif known is not None and not window.material.tracks:
            parts = [known.role, known.feature_point or "", ", ".join(known.region)]
            right = known.feature_point or ""
            colour = next(
                (stage.region_colours[r] for r in known.region if r in stage.region_colours), colour
            )
            detail = ", ".join(filter(None, (parts[0], parts[2])))
            detail += "; orients the face" if known.orientation else ""
        if name in stage.bound_names and np.isfinite(stage.residuals).any():
            residual = stage.residuals[stage.bound_names.index(name)]
            if np.isfinite(residual):
                right = f"{right}   {residual:.2f} mm".strip()
                colour = tuple(int(c) for c in colour_residuals(np.array([residual]))[0])  # type: ignore[assignment]
        items.append(Item(name, detail, name, colour, right))
    return items


def format_edit(edit: Edit) -> tuple[str, str]:
    """Format an edit as two lines.

    Parameters
    ----------
    edit
        The edit.

    Returns
    -------
    tuple of str
        What it is, and its values.
    """
    values = edit.model_dump(exclude_none=True, exclude={"edit"})
    texts = []
    for name, value in values.items():
        if isinstance(value, float):
            texts.append(f"{name} {value:.3f} s")
        elif value:
            shown = " and ".join(value) if isinstance(value, tuple | list) else str(value)
            texts.append(f"{name} {shown}")
    return edit.edit.replace("_", " "), ", ".join(texts)


def _list_edits(window: Window) -> list[Item]:
    if window.mending is None:
        return []
    items = []
    for number, edit in enumerate(window.mending.edits.edits, 1):
        text, detail = format_edit(edit)
        items.append(Item(f"{number}  {text}", detail, edit))
    name = window.mending.file.name
    saved = f"saved in {name}" if window.mending.is_saved else f"Ctrl+S saves {name}"
    return [*items, Item("edits are a list beside the recording, which stays as it is", saved)]


def _list_keys(window: Window) -> list[Item]:
    from corpus_tools.inspection.editing import KEYS

    rows: dict[str, list[str]] = {}
    for key, action in KEYS.items():
        rows.setdefault(action.text, []).append(key)
    return [Item(text, right=", ".join(keys[:2])) for text, keys in rows.items()]


def _describe_picked(window: Window) -> list[tuple[str, str]]:
    """Return lines about the marker and the phone that are picked."""
    stage, material, line = window.stage, window.material, window.line
    lines: list[tuple[str, str]] = []
    name = stage.picked
    if name is not None and name in stage.names:
        recording = material.recording
        lines.append((name, ""))
        if recording is not None and name in recording.names and recording.frames:
            index = recording.index(name)
            frame = round((line.cursor - recording.start_time) * recording.rate)
            frame = min(max(frame, 0), recording.frames - 1)
            x, y, z = recording.positions[frame, index]
            origin = Origin(int(recording.origin[frame, index])).name.lower()
            lines[0] = name, f"{origin} in frame {frame}"
            if np.isfinite(x):
                lines.append(("x, y, z", f"{x:.2f}, {y:.2f}, {z:.2f} mm"))
            missing = int((~recording.visible[:, index]).sum())
            lines.append(("missing", f"{missing} of {recording.frames} frames"))
        if name in stage.bound_names:
            residual = stage.residuals[stage.bound_names.index(name)]
            if np.isfinite(residual):
                lines.append(("residual here", f"{residual:.2f} mm"))
    phones = material.tiers.get("phones")
    entries = () if phones is None else phones.entries
    if window.picked_phone is not None and window.picked_phone < len(entries):
        label = entries[window.picked_phone]
        length = 1000 * (label.end - label.start)
        span = f"{label.start:.3f} to {label.end:.3f} s, {length:.0f} ms"
        lines.append((f"phone {label.text or '(empty)'}", span))
    return lines


def paint_status(window: Window, width: int, height: int) -> NDArray[np.uint8]:
    """Paint the line at the bottom: the time, the selection, and what there is to say.

    Parameters
    ----------
    window
        The window.
    width, height
        Size of the picture, pixels.

    Returns
    -------
    ndarray
        The picture, ``(height, width, 3)``.
    """
    canvas, line = Canvas(width, height, SHADE), window.line
    moves = bool(window.material.tracks)
    text = f"{line.cursor:.3f} s   frame {line.nearest_frame}" if moves else window.material.title
    if line.selection is not None:
        start, end = line.selection
        text += f"   selected {start:.3f} to {end:.3f} s ({end - start:.3f} s)"
    text += f"   speed {line.speed:g}" if line.speed != 1 else ""
    text += "   loop" if line.loops else ""
    text += "   with head motion" if window.stage.with_motion else ""
    used = canvas.write(8, height / 2, text, INK, 11) + 32
    hint = window.message or "Space plays, K lists all keys"
    hint = fit_text(hint, width - used - 16, 11)
    colour = BLUE if window.message else FAINT
    canvas.write(width - 8, height / 2, hint, colour, 11, "right")
    return canvas.pixels
