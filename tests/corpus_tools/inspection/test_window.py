"""The window, driven as a person drives it: by keys and the mouse, on a virtual display."""

import os
import shutil
import subprocess
import sys

import numpy as np
import pytest

import corpus_tools
from corpus_tools.inspection.gather import gather
from corpus_tools.inspection.sources import Sources
from corpus_tools.inspection.window import Window
from mocap_fit.edits import MoveBoundary, Relabel, Swap, read_edits
from mocap_fit.errors import ConfigurationError, MissingExtraError

# The slow test runs all others once more, on a screen.
OFF_SCREEN = "MOCAP_FIT_ON_SCREEN" not in os.environ


@pytest.fixture(scope="module")
def open_window(material):
    window = Window(material, sources=Sources(), size=(720, 520), off_screen=OFF_SCREEN)
    yield window
    window.close()


@pytest.fixture
def window(open_window, material):
    """The window as it was opened."""
    window = open_window
    while window.mending.edits.edits:
        window.press("z", ctrl=True)
    window.stage.with_motion = False
    window.line.stop()
    for key in ("Escape", "Home", "p"):
        window.press(key)
    window.press("a", ctrl=True)
    return window


def locate(window: Window, kind: str, time: float) -> tuple[float, float]:
    """Where a time is in a row, pixels from the left and the top of the window."""
    _, bottom, width, height = window.areas["strip"]
    row = next(row for row in window.strip.rows if row.kind == kind)
    top = window.size[1] - bottom - height + 0.5 * (row.top + row.bottom)
    return window.strip.to_x(time, window.line, width), top


def click_item(window: Window, text: str) -> None:
    """Click on the row of the panel's list that has a text."""
    left, bottom, _, height = window.areas["panel"]
    choice = window.panel.choice
    names = [item.text for item in window.panel.items] if choice is None else choice.fitting
    for index, top, low in window.panel.rows:
        if names[index].endswith(text):
            window.pick(left + 60, window.size[1] - bottom - height + 0.5 * (top + low))
            return
    raise AssertionError(f"no row '{text}'")


def test_keys_move_through_time(window):
    window.press("Home")
    window.press("Right")
    window.press("Right")
    assert window.line.cursor == pytest.approx(2 / 60)
    window.press("Left")
    window.press("i", ctrl=True)
    assert window.line.span == pytest.approx(1.54)
    window.press("a", ctrl=True)
    assert window.line.span == pytest.approx(3.08)


def test_keys_of_vtk_do_nothing(window):
    before = window.capture()
    for key in ("w", "s", "q", "e", "j", "t", "u", "f3"):
        window.press(key)
    window.press("Escape")
    if window.stage.stretch != 1:
        window.press("e")
    assert np.array_equal(window.capture(), before)


def test_a_drag_over_curves_selects_and_a_click_puts_the_cursor(window):
    start, end = locate(window, "waveform", 0.5), locate(window, "waveform", 1.5)
    window.drag(*start, *end)
    assert window.line.selection == pytest.approx((0.5, 1.5), abs=0.01)
    window.press("n", ctrl=True)
    assert (window.line.start, window.line.end) == window.line.selection
    window.press("a", ctrl=True)
    window.pick(*locate(window, "waveform", 2.0))
    assert window.line.selection is None
    assert window.line.cursor == pytest.approx(2.0, abs=0.01)


def test_a_click_on_a_phone_selects_it(window):
    window.pick(*locate(window, "phones", 0.2))
    first = window.material.tiers["phones"].entries[0]
    assert window.line.selection == (first.start, first.end)
    assert any("phone sil" in name for name, _ in window.panel.info)


def test_a_marker_is_picked_with_the_mouse_and_described(window):
    window.pick(*locate(window, "waveform", 1.25))
    _, _, width, height = window.areas["stage"]
    index = window.stage.names.index("chin_mid")
    x, y = window.stage.project(window.stage.positions[index][None], (width, height))[0]
    window.pick(x, y)
    assert window.stage.picked == "chin_mid"
    known = dict(window.panel.info)
    assert known["x, y, z"].endswith("mm")
    assert "residual here" in known


def test_a_slider_moves_the_face(window):
    window.press("p")
    before = window.stage.head_vertices.copy()
    left, bottom, _, height = window.areas["panel"]
    _, top, low = window.panel.rows[0]
    y = window.size[1] - bottom - height + 0.5 * (top + low)
    window.drag(left + 180, y, left + 250, y)
    assert window.stage.overrides.keys() == {"jaw_rotation"}
    assert np.abs(window.stage.head_vertices - before).max() > 2.0
    window.press("Escape")
    np.testing.assert_allclose(window.stage.head_vertices, before)


def test_it_plays(window):
    window.press("Home")
    window.press("space")
    assert window.line.is_playing
    window.press("space")
    assert not window.line.is_playing


def test_the_head_moves_with_its_motion_where_wanted(window):
    # The middle frame stays where it is; another one does not.
    window.press("Home")
    still = window.stage.positions.copy()
    window.press("h")
    moved = window.stage.positions
    known = np.isfinite(still).all(axis=1) & np.isfinite(moved).all(axis=1)
    apart = np.linalg.norm(still - moved, axis=1)[known]
    assert apart.max() > 1.0
    # The head goes with the markers.
    assert np.nanmedian(window.stage.residuals) < 1.0


@pytest.mark.slow
def test_an_edit_is_undone_redone_and_saved(window, recording):
    window.drag(*locate(window, "waveform", 0.5), *locate(window, "waveform", 1.0))
    window.stage.picked = "lip_upper_mid"
    window.press("x")
    other = window.panel.choice.fitting[1]
    click_item(window, other)
    (edit,) = window.mending.edits.edits
    assert isinstance(edit, Swap)
    assert edit.markers == ("lip_upper_mid", other)
    assert (edit.start, edit.end) == pytest.approx((0.5, 1.0), abs=0.01)
    swapped = window.material.recording
    window.press("z", ctrl=True)
    assert window.mending.edits.edits == ()
    assert not window.material.recording.equals(swapped)
    window.press("y", ctrl=True)
    assert window.material.recording.equals(swapped)
    window.press("s", ctrl=True)
    file = recording.with_name(f"{recording.name}.edits.toml")
    assert read_edits(file) == window.mending.edits
    file.unlink()


def test_phones_are_mended(window):
    entries = window.material.tiers["phones"].entries
    boundary = entries[1].end
    x, y = locate(window, "phones", boundary)
    to = locate(window, "phones", boundary + 0.02)[0]
    window.drag(x, y, to, y)
    (edit,) = window.mending.edits.edits
    assert isinstance(edit, MoveBoundary)
    assert edit.time == pytest.approx(boundary)
    assert window.material.tiers["phones"].entries[1].end == pytest.approx(
        boundary + 0.02, abs=0.01
    )
    window.pick(*locate(window, "phones", 0.2))
    window.press("l")
    for letter in "A:":
        window.press(letter)
    window.press("Return")
    assert isinstance(window.mending.edits.edits[-1], Relabel)
    assert window.material.tiers["phones"].entries[0].text == "A:"


def test_what_cannot_be_done_is_said(window):
    window.press("x")
    assert "pick a marker first" in window.message
    window.press("d")
    assert "select" in window.message
    window.press("z", ctrl=True)
    assert "nothing to undo" in window.message


def test_a_layout_has_every_name(window):
    shown = Window(gather("face30-head5"), size=(720, 520), off_screen=OFF_SCREEN)
    assert shown.with_names
    assert set(shown.panel.tabs) == {"markers", "parameters", "keys"}
    assert len(np.unique(shown.capture().reshape(-1, 3), axis=0)) > 1000
    shown.close()


def test_two_are_compared(material, window):
    head = material.heads["fit"]
    other = material.replace(heads={"fit": head.replace(values=head.values + 0.2)}, edits=None)
    compared = Window(material, other, size=(720, 520), off_screen=OFF_SCREEN)
    difference = compared.strip.difference.values
    np.testing.assert_allclose(difference[np.isfinite(difference)], 0.2)
    assert compared.stage.compares
    compared.close()


def test_a_list_that_is_not_there_is_refused(recording, tmp_path):
    with pytest.raises(ConfigurationError, match="no list 'utterances'"):
        corpus_tools.inspect(recording, screenshot=tmp_path / "a.png", tab="utterances")
    assert not list(tmp_path.iterdir())


def test_without_a_screen_the_error_says_what_to_do(recording, monkeypatch):
    if sys.platform != "linux":
        pytest.skip("other systems always have one")
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    with pytest.raises(MissingExtraError, match=r"no screen[^\n]*--html"):
        corpus_tools.inspect(recording)


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("Xvfb") is None, reason="no Xvfb")
def test_the_same_on_a_virtual_display():
    """Once more with a window of X: the events come from its interactor."""
    display = f":{90 + os.getpid() % 100}"
    server = subprocess.Popen(["Xvfb", display, "-screen", "0", "1400x900x24"])
    environment = os.environ | {
        "DISPLAY": display,
        "VTK_DEFAULT_OPENGL_WINDOW": "vtkXOpenGLRenderWindow",
        "MOCAP_FIT_ON_SCREEN": "1",
    }
    try:
        command = [sys.executable, "-m", "pytest", "-q", "-x", "-m", "not slow", __file__]
        run = subprocess.run(
            command, env=environment, capture_output=True, text=True, timeout=600, check=False
        )
        assert run.returncode == 0, run.stdout + run.stderr
    finally:
        server.terminate()
        server.wait()
