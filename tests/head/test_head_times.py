"""Motion is restored to the frames that it came from, and to no others."""

import numpy as np
import pytest

from mocap_fit.errors import DataError
from mocap_fit.head import remove_head_motion, restore_head_motion
from mocap_fit.tracks import MarkerTracks

NAMES = ("left", "right", "top", "chin")
SHAPE = np.array([[-70.0, 0, -60], [70, 0, -60], [0, 60, 5], [0, -80, 60]])


@pytest.fixture
def removed(rng):
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    turn *= np.linalg.det(turn)
    moved = SHAPE @ turn.T + rng.normal(0.0, 30.0, (20, 1, 3))
    recording = MarkerTracks(NAMES, 60.0, moved, start_time=2.5)
    still, motion = remove_head_motion(recording, SHAPE[:3], NAMES[:3])
    return recording, still, motion


def test_the_same_frames_get_their_motion_back(removed):
    recording, still, motion = removed
    np.testing.assert_allclose(still.positions, np.tile(SHAPE, (20, 1, 1)), atol=1e-9)
    back = restore_head_motion(still, motion)
    np.testing.assert_allclose(back.positions, recording.positions, atol=1e-9)
    assert back.start_time == 2.5


@pytest.mark.parametrize(
    ("change", "found"),
    [
        ({"start_time": 2.5 + 1e-3}, "20 frames, 60 Hz, from 2.501 s"),
        ({"start_time": 0.0}, "20 frames, 60 Hz, from 0 s"),
        ({"rate": 60.01}, "20 frames, 60.01 Hz, from 2.5 s"),
        ({"positions": np.zeros((19, 4, 3)), "origin": None}, "19 frames, 60 Hz, from 2.5 s"),
    ],
)
def test_other_frames_are_refused(removed, change, found):
    _, still, motion = removed
    with pytest.raises(DataError, match="not of the same frames") as caught:
        restore_head_motion(still.replace(**change), motion)
    assert caught.value.found == found
    assert caught.value.expected == "20 frames, 60 Hz, from 2.5 s"


def test_rounding_of_times_is_no_difference(removed):
    _, still, motion = removed
    restore_head_motion(still.replace(start_time=2.5 + 1e-10, rate=60.0 + 1e-9), motion)
