"""What all kinds of tracks do, from their declared arrays."""

import copy
import json
import pickle

import numpy as np
import pytest
from scipy.interpolate import PchipInterpolator
from scipy.spatial.transform import Rotation, Slerp

from mocap_fit.errors import DataError
from mocap_fit.tracks import Event, MarkerTracks, Origin, ParameterTracks, PoseTracks, Tracks

FRAMES = 12


def markers() -> MarkerTracks:
    positions = np.random.default_rng(3).normal(size=(FRAMES, 2, 3))
    positions[4:6, 1] = np.nan
    origin = np.full((FRAMES, 2), Origin.MEASURED)
    origin[3, 0] = Origin.VIRTUAL
    origin[4:6, 1] = Origin.MISSING
    events = (Event("clap", 2.05),)
    return MarkerTracks(
        ("chin", "nose"), 50.0, positions, origin, start_time=2.0, name="take", events=events
    )


def poses() -> PoseTracks:
    rng = np.random.default_rng(4)
    turns = Rotation.from_rotvec(np.cumsum(0.1 * rng.normal(size=(FRAMES, 3)), axis=0))
    rotations = np.stack([turns.as_matrix(), np.tile(np.eye(3), (FRAMES, 1, 1))], axis=1)
    translations = rng.normal(size=(FRAMES, 2, 3))
    rotations[7, 1], translations[7, 1] = np.nan, np.nan
    residuals = rng.random((FRAMES, 2))
    return PoseTracks(("head", "jaw"), 50.0, rotations, translations, residuals, start_time=2.0)


def parameters() -> ParameterTracks:
    rng = np.random.default_rng(5)
    values = rng.random((FRAMES, 2))
    values[2:4, 1] = np.nan
    deviations = rng.random((FRAMES, 2))
    deviations[0, 0] = np.inf
    return ParameterTracks(
        ("jaw_rotation", "jaw_shift"), 50.0, values, deviations, rng.random(FRAMES), start_time=2.0
    )


every_kind = pytest.mark.parametrize("tracks", [markers(), poses(), parameters()], ids=repr)
ARRAYS = {
    "markers": ["positions", "origin"],
    "poses": ["rotations", "translations", "residuals"],
    "parameters": ["values", "standard_deviations", "residuals"],
}


@every_kind
def test_between_takes_a_part_of_every_array(tracks: Tracks):
    part = tracks.between(2.04, 2.10)
    assert type(part) is type(tracks)
    assert part.start_time == pytest.approx(2.04)
    for array in ARRAYS[tracks.kind]:
        np.testing.assert_array_equal(getattr(part, array), getattr(tracks, array)[2:5])
    assert part.provenance[-1].arguments == {"start": 2.04, "end": 2.10}
    assert tracks.between().frames == FRAMES
    assert tracks.between(end=2.02).frames == 1
    # A time within a nanosecond of a frame is that frame's.
    assert tracks.between(2.04 + 5e-10, 2.06 + 5e-10).times == pytest.approx([2.04])
    assert tracks.between(2.04 + 1.5e-9, 2.08 + 1.5e-9).times == pytest.approx([2.06, 2.08])


@every_kind
@pytest.mark.parametrize(("start", "end"), [(5, 6), (None, 2.0), (2.1, 2.1), (2.1, 2.05)])
def test_between_refuses_a_stretch_without_frames(tracks: Tracks, start, end):
    with pytest.raises(DataError, match=r"no frame.*within 2\.000 s to 2\.220 s"):
        tracks.between(start, end)


@every_kind
def test_select_and_indexing_take_the_tracks_of_a_name(tracks: Tracks):
    first, second = tracks.names
    part = tracks.select([second])
    assert part.names == (second,)
    for array in ARRAYS[tracks.kind]:
        old = getattr(tracks, array)
        np.testing.assert_array_equal(getattr(part, array), old[:, [1]] if old.ndim > 1 else old)
    np.testing.assert_array_equal(tracks[first], tracks.main_array[:, 0])
    assert (tracks.index(first), tracks.index(second)) == (0, 1)
    with pytest.raises(DataError, match=f"no {tracks.noun} 'nobody'.*some of {first}"):
        tracks["nobody"]
    with pytest.raises(DataError, match=f"no {tracks.plural} x, y"):
        tracks.select(["x", first, "y"])


@every_kind
def test_equal_tracks_have_the_same_numbers_wherever_they_come_from(tracks: Tracks):
    assert tracks.equals(tracks.add_step("look"))
    assert not tracks.equals(None)
    for change in (
        {"rate": 51.0},
        {"start_time": 0.0},
        {"name": "other"},
        {"names": ("a", "b")},
        {"events": (Event("end", 1.0),)},
    ):
        assert not tracks.equals(tracks.replace(**change))
    for array in ARRAYS[tracks.kind]:
        other = getattr(tracks, array).copy()
        other[-1] = Origin.FILLED if array == "origin" else other[-1] + 1e-12
        assert not tracks.equals(tracks.replace(**{array: other}))


def test_tracks_of_other_kinds_are_not_equal():
    assert not markers().equals(poses())


@every_kind
@pytest.mark.parametrize(
    "clone", [copy.copy, copy.deepcopy, lambda tracks: pickle.loads(pickle.dumps(tracks))]
)
def test_copies_are_equal_and_read_only(tracks: Tracks, clone):
    twin = clone(tracks.add_step("look", {"at": 1}))
    assert twin.equals(tracks)
    assert twin.provenance[-1].arguments == {"at": 1}
    for array in ARRAYS[tracks.kind]:
        assert not getattr(twin, array).flags.writeable


@every_kind
def test_tracks_print_in_a_few_lines_and_as_a_table(tracks: Tracks):
    text = repr(tracks)
    assert len(text.splitlines()) <= 6
    assert text.startswith(f"{type(tracks).__name__} '{tracks.name}'")
    assert "12 at 50 Hz, 0.240 s" in text
    assert "2.000 s to 2.220 s" in text
    assert f"{100 * (1 - tracks.visible.mean()):.2f}% of the samples" in text
    assert f"{tracks.plural}: {', '.join(tracks.names)}" in text
    html = tracks.replace(name="<b>").add_step("smooth")._repr_html_()
    assert html.startswith("<table>")
    assert "&lt;b&gt;" in html
    assert "smooth" in html


def test_many_names_are_shortened():
    names = tuple(f"m{k}" for k in range(40))
    text = repr(MarkerTracks(names, 50, np.zeros((0, 40, 3))))
    assert "m7, … (40 in all)" in text
    assert "times" not in text


@every_kind
def test_what_tracks_hold_is_described_in_plain_values(tracks: Tracks):
    about = json.loads(json.dumps(tracks.describe()))
    assert about["content"] == tracks.kind
    assert (about["frames"], about["rate"], about["duration"]) == (12, 50.0, 0.24)
    missing = (~tracks.visible).sum(axis=0) / FRAMES
    assert [row["gap_rate"] for row in about[tracks.plural]] == pytest.approx(missing)
    assert about["units"] == (
        "rest to full gesture: 0 to 1" if tracks.kind == "parameters" else "mm"
    )


def test_parameters_at_any_times_lie_on_monotone_cubics_and_hold_at_the_ends():
    tracks = parameters()
    times = np.array([-1.0, 2.0, 2.013, 2.05, 2.061, 2.22, 9.0])
    result = tracks.at(times)
    for column in range(2):
        known = np.isfinite(tracks.values[:, column])
        cubic = PchipInterpolator(tracks.times[known], tracks.values[known, column])
        np.testing.assert_allclose(
            result[:, column], cubic(np.clip(times, 2.0, 2.22)), rtol=0, atol=1e-9
        )
    once = np.full((FRAMES, 2), np.nan)
    once[5, 0] = 0.7
    result = tracks.replace(values=once).at([0.0, 2.1])
    np.testing.assert_array_equal(result, [[0.7, np.nan], [0.7, np.nan]])


def test_markers_at_any_times_lie_on_straight_lines_between_frames_that_are_there():
    tracks = markers()
    times = [1.985, 1.995, 2.0, 2.005, 2.06, 2.07, 2.1, 2.225, 2.235]
    result = tracks.at(times)
    positions = tracks.positions[:, 0]
    np.testing.assert_allclose(
        result[:, 0],
        [
            np.full(3, np.nan),
            positions[0],
            positions[0],
            0.75 * positions[0] + 0.25 * positions[1],
            positions[3],
            0.5 * (positions[3] + positions[4]),
            positions[5],
            positions[11],
            np.full(3, np.nan),
        ],
        atol=1e-9,
    )
    # Frames 4 and 5 of the second one are missing.
    assert np.isnan(result[:, 1, 0]).tolist() == [True, *[False] * 4, True, True, False, True]
    origin = tracks.at(times, "origin")[:, 0].tolist()
    assert origin == [0, 1, 1, 1, 3, 3, 1, 1, 0]


def test_poses_at_any_times_turn_evenly():
    tracks = poses()
    times = np.array([2.0, 2.031, 2.15, 2.2])
    rotations = tracks.at(times, "rotations")
    slerp = Slerp(tracks.times, Rotation.from_matrix(tracks.rotations[:, 0]))
    np.testing.assert_allclose(rotations[:, 0], slerp(times).as_matrix(), atol=1e-9)
    assert np.isnan(rotations[:, 1, 0, 0]).tolist() == [False, False, True, False]
    np.testing.assert_allclose(tracks.at([2.01])[0, 0], tracks.translations[:2, 0].mean(axis=0))


def test_arrays_and_frames_that_are_not_there_are_refused():
    with pytest.raises(DataError, match=r"no array 'speed'.*one of positions, origin"):
        markers().at([2.0], "speed")
    with pytest.raises(DataError, match="'empty' have no frames"):
        ParameterTracks(("jaw",), 50, np.zeros((0, 1)), name="empty").at([0.0])


@every_kind
def test_plots_have_a_line_each(tracks: Tracks):
    pyplot = pytest.importorskip("matplotlib.pyplot")
    axes = tracks.plot()
    assert [line.get_label() for line in axes.lines] == list(tracks.names)
    assert axes.get_xlabel() == "time (s)"
    np.testing.assert_allclose(axes.lines[0].get_xdata(), tracks.times)
    expected = tracks.main_array[:, 0]
    if expected.ndim == 2:
        expected = np.linalg.norm(expected - np.median(expected, axis=0), axis=1)
    np.testing.assert_allclose(axes.lines[0].get_ydata(), expected)
    again = tracks.plot([tracks.names[1]], ax=axes)
    assert again is axes
    assert len(axes.lines) == 3
    pyplot.close(axes.figure)


def test_an_origin_that_no_code_says_is_refused():
    for codes in (4, 1.5, np.nan):
        origin = np.full((FRAMES, 2), float(Origin.MEASURED))
        origin[4:6, 1] = 9.0  # missing samples take no other
        origin[0, 0] = codes
        with pytest.raises(DataError, match="known codes"):
            markers().replace(origin=origin)


@every_kind
def test_numbers_and_sequences_of_any_type_become_plain_ones(tracks: Tracks):
    changed = tracks.replace(
        rate=np.float32(50), start_time=np.int64(2), names=list(tracks.names), events=[]
    )
    assert (type(changed.rate), type(changed.start_time)) == (float, float)
    assert (type(changed.names), changed.events) == (tuple, ())
    assert changed.replace(provenance=[]).provenance == ()
    assert hash(changed.names) == hash(tracks.names)


def test_empty_tracks_say_that_there_is_no_stretch_and_no_gap():
    empty = ParameterTracks(("jaw",), 50, np.zeros((0, 1)))
    assert empty.describe()["parameters"] == [{"name": "jaw", "gap_rate": 0.0}]
    with pytest.raises(DataError, match="expected a recording with frames"):
        empty.between()


def test_samples_are_visible_that_have_all_their_numbers():
    assert parameters().visible[:5].tolist() == [
        [True] * 2,
        [True] * 2,
        *[[True, False]] * 2,
        [True] * 2,
    ]
    assert np.argwhere(~poses().visible).tolist() == [[7, 1]]
    translations = poses().translations.copy()
    translations[2, 0, 1] = np.nan
    assert np.argwhere(~poses().replace(translations=translations).visible).tolist() == [
        [2, 0],
        [7, 1],
    ]
    assert np.argwhere(~markers().visible).tolist() == [[4, 1], [5, 1]]
