"""Material of every kind, opened and handled: nothing warns, nothing ends in a traceback."""

import numpy as np
import pytest

import mocap_fit as mf
from corpus_tools.inspection.gather import gather
from corpus_tools.inspection.window import Window
from mocap_fit.errors import FileFormatError
from mocap_fit.tracks import ParameterTracks, write_parquet

pytestmark = pytest.mark.slow

# fmt: off
KEYS = (
    "Right", "n", "h", "e", "7", "3", "1", "f", "space", "space", "k", "x", "Escape", "d", "End",
    "Right", "Home", "Left", "Down", "Return", "g", "r", "Escape", "l", "Escape", "b", "m",
    "Escape", "comma", "period", "o", "Tab", "Tab",
)
# fmt: on


def create(kind: str):
    take = mf.read_tracks(mf.load_sample("take_01"))
    names = mf.load_face().parameter_names
    positions = take.positions.copy()
    if kind == "never_seen":
        positions[:, 3] = np.nan
    if kind == "one_frame":
        positions = positions[:1]
    recordings = {
        "one_marker": lambda: take.select(["chin_mid"]),
        "unknown_names": lambda: take.replace(names=tuple(f"m{k}" for k in range(35))),
        "late": lambda: take.replace(start_time=100.0),
        "parameters_missing": lambda: ParameterTracks(names, 60.0, np.full((50, 10), np.nan)),
        "parameters_of_one_frame": lambda: ParameterTracks(names, 60.0, np.zeros((1, 10))),
        "one_parameter": lambda: ParameterTracks(
            ("jaw_rotation",), 60.0, np.linspace(0, 1, 80)[:, None]
        ),
    }
    return recordings.get(kind, lambda: take.replace(positions=positions, origin=None))()


@pytest.mark.parametrize(
    "kind",
    [
        "never_seen",
        "one_frame",
        "one_marker",
        "unknown_names",
        "late",
        "parameters_missing",
        "parameters_of_one_frame",
        "one_parameter",
    ],
)
@pytest.mark.filterwarnings("error")
def test_every_material_can_be_handled(kind, tmp_path):
    path = tmp_path / "take.parquet"
    write_parquet(create(kind), path)
    window = Window(gather(path), size=(700, 500), off_screen=True)
    for key in KEYS:
        window.press(key)
    for key in "ianzy":
        window.press(key, ctrl=True)
    window.drag(300, 420, 500, 420)
    for name in window.stage.names[:2]:
        window.stage.picked = name
        window.draw()
    window.pick(200, 100)
    assert window.capture().std() > 5
    window.close()


def test_a_recording_of_nothing_is_refused(tmp_path):
    take = mf.read_tracks(mf.load_sample("take_01"))
    path = tmp_path / "take.parquet"
    write_parquet(take.replace(positions=np.full_like(take.positions, np.nan), origin=None), path)
    with pytest.raises(FileFormatError, match="no marker is seen"):
        gather(path)
