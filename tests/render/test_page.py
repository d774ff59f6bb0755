"""The web page: what is written, without a browser."""

import json
import re

import numpy as np
import pytest

from mocap_fit.errors import DataError, FileFormatError
from mocap_fit.face import load_face
from mocap_fit.phones import PhoneSegment, PhoneSequence
from mocap_fit.render import Mark, write_page
from mocap_fit.render.main_shapes import MainShapesBuilder, quantise
from mocap_fit.sound import Sound
from mocap_fit.tracks import MarkerTracks, ParameterTracks


def moving(frames=6, rate=30.0, **fields):
    values = np.linspace(0, 0.6, frames)[:, None] * [1.0, 0.5]
    return ParameterTracks(("jaw_rotation", "lip_rounding"), rate, values, **fields)


def read_record(path):
    text = path.read_text(encoding="utf-8")
    return json.loads(re.search(r'id="record">(.*?)</script>', text, re.DOTALL)[1])


@pytest.mark.parametrize("frames", [1, 40, 70])
def test_main_shapes_come_as_near_as_wanted(rng, frames):
    parts = rng.normal(size=(5, 30, 3))
    weights = rng.normal(size=(frames, 5)) * [30, 10, 3, 1, 0.2]
    # The sample does not have what comes later.
    weights[:20, 3] = 0.0
    movement = np.tensordot(weights, parts, 1) + 100.0
    builder = MainShapesBuilder(movement[:20], 0.05)
    for first in range(0, frames, 16):
        builder.add(movement[first : first + 16])
    shapes = builder.build()
    blended = shapes.middle.values + np.tensordot(shapes.weights, shapes.shapes.values, 1)
    error = np.linalg.norm(blended - movement, axis=2).max()
    assert error <= shapes.largest_error + 1e-4
    assert shapes.largest_error < 0.06
    assert len(shapes.shapes.steps) <= 6


def test_a_face_at_rest_needs_no_shape():
    rest = np.arange(30.0).reshape(1, 10, 3)
    builder = MainShapesBuilder(rest, 0.05)
    builder.add(np.repeat(rest, 3, axis=0))
    shapes = builder.build()
    assert shapes.weights.shape == (3, 0)
    np.testing.assert_allclose(shapes.middle.values, rest[0], atol=0.001)


def test_rounding_is_to_the_nearest_step(rng):
    values = rng.normal(size=100)
    rounded = quantise(values)
    assert np.abs(rounded.values - values).max() <= 0.51 * rounded.scale
    assert quantise(np.zeros(3)).values.tolist() == [0, 0, 0]


def test_a_page_is_one_file_without_the_network(tmp_path):
    path = tmp_path / "page.html"
    phones = PhoneSequence((PhoneSegment(0.0, 0.1, "</script>", word="<b>"),))
    sound = Sound(np.sin(np.arange(3200)), 16000.0)
    marks = [Mark("a spike", 0.1, 0.15, "error")]
    steps = []
    page = write_page(
        path,
        load_face(),
        {"measured": moving(), "model": moving(4, 20.0)},
        title="<take & one>",
        sound=sound,
        phones=phones,
        marks=marks,
        progress=lambda *step: steps.append(step),
    )
    text = path.read_text(encoding="utf-8")
    assert "&lt;take &amp; one&gt;" in text
    assert not re.search(r"https?://|src=|<link|@import", text)
    record = read_record(path)
    assert record["phones"] == [[0.0, 0.1, "</script>", "<b>"]]
    assert record["marks"][0]["text"] == "a spike"
    assert [track["label"] for track in record["tracks"]] == ["measured", "model"]
    assert record["sound"]["type"] == "audio/flac"
    assert page.frames == record["frames"] == 6
    assert steps[-1] == (12, 12)
    assert page.with_sound
    assert page.size == path.stat().st_size
    assert page.largest_error < 0.1
    before = path.read_bytes()
    write_page(
        path,
        load_face(),
        {"measured": moving(), "model": moving(4, 20.0)},
        title="<take & one>",
        sound=sound,
        phones=phones,
        marks=marks,
    )
    assert path.read_bytes() == before


def test_markers_alone_make_a_page_with_their_gaps(tmp_path):
    positions = np.full((4, 2, 3), 10.0)
    positions[1, 0] = np.nan
    page = write_page(
        tmp_path / "m.html", None, {}, markers={"take": MarkerTracks(("a", "b"), 50.0, positions)}
    )
    assert (page.shapes, page.frames, page.with_sound) == (0, 4, False)
    record = read_record(tmp_path / "m.html")
    assert record["markers"][0]["names"] == ["a", "b"]
    assert "mesh" not in record


def test_a_face_at_rest_makes_a_page(tmp_path):
    page = write_page(tmp_path / "rest.html", load_face(), {})
    assert (page.frames, page.duration, page.shapes) == (1, 0.0, 0)


def test_a_part_of_a_long_recording_makes_a_page(tmp_path):
    phones = PhoneSequence(tuple(PhoneSegment(k, k + 1, str(k)) for k in range(600)))
    marks = [Mark("early", 1.0, 2.0), Mark("there", 100.05, 100.05)]
    tracks = moving(6000, 10.0)
    page = write_page(
        tmp_path / "part.html",
        load_face(),
        {"a": tracks},
        phones=phones,
        marks=marks,
        extent=(100.0, 100.2),
    )
    record = read_record(page.path)
    assert [phone[2] for phone in record["phones"]] == ["100"]
    assert [mark["text"] for mark in record["marks"]] == ["there"]
    assert (page.frames, record["first"]) == (2, pytest.approx(100.0))
    assert record["tracks"][0]["start"] == pytest.approx(99.9)
    assert record["tracks"][0]["values"]["shape"] == [4, 2]


@pytest.mark.parametrize("name", ["page.htm", "page"])
def test_names_of_other_files_are_refused(tmp_path, name):
    with pytest.raises(FileFormatError, match=r"a name in \.html"):
        write_page(tmp_path / name, load_face(), {})


def test_pages_of_nothing_or_of_many_minutes_are_refused(tmp_path):
    with pytest.raises(DataError, match="neither a face nor a marker"):
        write_page(tmp_path / "a.html", None, {})
    with pytest.raises(DataError, match="at most 300 s"):
        write_page(tmp_path / "a.html", load_face(), {"a": moving(2, 1e-4)})
    strange = ParameterTracks(("brow_raise",), 30.0, np.zeros((2, 1)))
    with pytest.raises(DataError, match="no parameter brow_raise"):
        write_page(tmp_path / "a.html", load_face(), {"a": strange})
    assert not list(tmp_path.iterdir())
