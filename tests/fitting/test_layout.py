"""Marker layouts: what is shipped, and what a user may get wrong."""

from pathlib import Path

import pytest

from mocap_fit.errors import ConfigurationError, MissingFileError
from mocap_fit.face import Rig, to_parameters
from mocap_fit.fitting import list_layouts, load_layout

MARKERS = """
[[markers]]
name = "a"
feature_point = "8.3"
orientation = true
[[markers]]
name = "b"
feature_point = "8.4"
orientation = true
[[markers]]
name = "c"
feature_point = "9.3"
orientation = true
"""


def write(folder: Path, text: str) -> Path:
    path = folder / "mine.toml"
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize(("name", "face", "head"), [("face30-head5", 30, 5), ("grid_s1", 32, 6)])
def test_shipped_layouts_are_what_they_say(name: str, face: int, head: int) -> None:
    layout = load_layout(name)
    assert len(layout.face_markers) == face
    assert len(layout.head_markers) == head


@pytest.mark.parametrize("name", list_layouts())
def test_shipped_layouts_fit_the_built_in_head(name: str, face: Rig) -> None:
    layout = load_layout(name)
    to_parameters(layout.reference_parameters, face.parameter_names)
    for marker in layout.face_markers:
        if marker.feature_point is not None:
            assert face.mesh.get_feature_point(marker.feature_point) >= 0
        for region in marker.region:
            assert face.mesh.get_region(region).size > 0


def test_a_layout_of_ones_own_takes_the_name_of_its_file(tmp_path: Path) -> None:
    layout = load_layout(write(tmp_path, MARKERS))
    assert layout.name == "mine"
    assert [marker.weight for marker in layout.markers] == [1.0, 1.0, 1.0]


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "wrong at markers: this is missing"),
        ("mass = 1\n" + MARKERS, "wrong at mass: there is no such setting"),
        ("markers = 3", "markers"),
        ("[[markers", "not TOML"),
        (MARKERS + '\n[[markers]]\nname = "a"\nfeature_point = "8.1"', "more than one marker"),
        (MARKERS + '\n[[markers]]\nname = "d"', "feature_point or a region"),
        (MARKERS + '\n[[markers]]\nname = ""\nfeature_point = "8.1"', "name"),
        (
            MARKERS + '\n[[markers]]\nname = "d"\nrole = "ear"',
            "markers.3 'd'.role: input should be",
        ),
        (
            MARKERS + '\n[[markers]]\nname = "d"\nregion = "nose"',
            "markers.3 'd'.region: give a list",
        ),
        (MARKERS + '\n[[markers]]\nfeature_point = "8.1"', "markers.3.name: this is missing"),
        (MARKERS + '\n[[markers]]\nname = "d"\nregion = ["nose"]\nweight = 0', "weight"),
        (MARKERS + '\n[[markers]]\nname = "d"\nregion = ["nose"]\nweight = nan', "weight"),
        (
            MARKERS + '\n[[markers]]\nname = "d"\nregion = ["nose"]\nmass = 1',
            "markers.3 'd'.mass: there is",
        ),
        (
            MARKERS + '\n[[markers]]\nname = "d"\nregion = ["nose"]\norientation = true',
            "no feature",
        ),
        (
            MARKERS + '\n[[markers]]\nname = "d"\nrole = "head"\nposition = [1, 2]',
            "'d'.position.2: this is missing",
        ),
        ("markers = " + "[" * 5000, "not TOML"),
        (MARKERS.replace("orientation = true", "", 1), "three or more"),
        ("marker_offset = -1\n" + MARKERS, "marker_offset"),
        (MARKERS.replace("[[markers]]", '[[markers]]\nrole = "head"'), "role 'face'"),
    ],
)
def test_wrong_layouts_say_where(tmp_path: Path, text: str, says: str) -> None:
    path = write(tmp_path, text)
    with pytest.raises(ConfigurationError) as caught:
        load_layout(path)
    message = str(caught.value)
    assert str(path) in message
    assert says in message
    assert "\n" not in message
    assert "Value error" not in message


def test_an_unknown_name_lists_the_shipped_ones() -> None:
    with pytest.raises(FileNotFoundError, match="face30-head5"):
        load_layout("face31")


def test_a_file_that_cannot_be_read_is_named_once(tmp_path: Path) -> None:
    with pytest.raises(MissingFileError) as caught:
        load_layout(tmp_path / "none.toml")
    message = str(caught.value)
    assert message.count("none.toml") == 1
    assert "Errno" not in message
