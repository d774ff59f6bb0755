import numpy as np
import pytest

from mocap_fit.errors import DataError
from mocap_fit.tracks import Event, MarkerTracks, Origin, ParameterTracks, PoseTracks, Step


def recording(frames: int = 10, markers: int = 3, **changes) -> MarkerTracks:
    positions = np.random.default_rng(1).normal(size=(frames, markers, 3))
    names = tuple(f"marker_{k}" for k in range(markers))
    return MarkerTracks(names, 100.0, positions, **changes)


def test_a_marker_with_one_missing_coordinate_is_missing():
    positions = np.zeros((4, 2, 3))
    positions[2, 1, 0] = np.nan
    tracks = MarkerTracks(("a", "b"), 100, positions)
    assert np.isnan(tracks.positions[2, 1]).all()
    assert tracks.origin[2, 1] == Origin.MISSING
    assert tracks.visible.sum() == 7


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"names": ("a", "a", "b")}, "unique"),
        ({"names": ()}, "no marker"),
        ({"rate": 0.0}, "rate"),
        ({"rate": -1.0}, "rate"),
        ({"rate": np.nan}, "rate"),
        ({"start_time": np.inf}, "start time"),
        ({"positions": np.zeros((4, 2, 3))}, "shape"),
        ({"positions": np.zeros((4, 3))}, "shape"),
        ({"positions": [["text"]]}, "not numbers"),
        ({"positions": np.full((4, 3, 3), np.inf)}, "infinite"),
        ({"origin": np.ones((2, 3))}, "origin"),
        ({"origin": np.zeros((10, 3))}, "marked missing"),
    ],
)
def test_impossible_tracks_are_refused(changes, words):
    with pytest.raises(DataError, match=words):
        recording().replace(**changes)


def test_arrays_cannot_be_changed_and_do_not_follow_their_source():
    source = np.zeros((3, 1, 3))
    tracks = MarkerTracks(("a",), 100, source)
    source[:] = 7
    assert not tracks.positions.any()
    with pytest.raises(ValueError, match="read-only"):
        tracks.positions[0] = 1


def test_between_takes_frames_from_start_up_to_end_and_keeps_their_times():
    tracks = recording(start_time=2.0)
    part = tracks.between(2.03, 2.07)
    assert part.frames == 4
    np.testing.assert_array_equal(part.positions, tracks.positions[3:7])
    np.testing.assert_allclose(part.times, [2.03, 2.04, 2.05, 2.06], atol=1e-12)
    with pytest.raises(DataError, match="no frame"):
        tracks.between(9.0, 10.0)


def test_select_takes_markers_in_the_order_given_and_names_the_unknown():
    tracks = recording()
    part = tracks.select(("marker_2", "marker_0"))
    np.testing.assert_array_equal(part.positions, tracks.positions[:, [2, 0]])
    assert part.provenance[-1].name == "select"
    with pytest.raises(DataError, match="nobody, noone"):
        tracks.select(("marker_0", "nobody", "noone"))


def test_parameter_tracks_tell_what_is_uncertain():
    deviations = np.full((2, 2), 0.1)
    deviations[1, 0] = np.inf
    tracks = ParameterTracks(("jaw", "lip"), 60, np.zeros((2, 2)), deviations)
    assert tracks.uncertain.tolist() == [[False, False], [True, False]]
    assert np.isnan(tracks.residuals).all()
    assert tracks["lip"].shape == (2,)
    with pytest.raises(DataError, match="residuals"):
        tracks.replace(residuals=np.zeros(3))
    with pytest.raises(DataError, match="standard deviations"):
        tracks.replace(standard_deviations=np.zeros((2, 3)))


def test_pose_tracks_must_agree_in_frames():
    with pytest.raises(DataError, match=r"rotations have the wrong shape.*expected \(3, 1, 3, 3\)"):
        PoseTracks(("head",), 60, np.zeros((2, 1, 3, 3)), np.zeros((3, 1, 3)), np.zeros((2, 1)))


def test_a_step_survives_its_dictionary():
    step = Step("smooth", {"cutoff_hz": 8.0})
    assert Step.from_dict(step.to_dict()) == step
    tracks = recording(events=(Event("clap", 0.5),)).add_step("one").add_step("two", {"n": 2})
    assert [step.name for step in tracks.provenance] == ["one", "two"]
