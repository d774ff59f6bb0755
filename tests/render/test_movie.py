"""Talking heads: what moves is seen moving, at its time, side by side, with all that goes along."""

import os
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mocap_fit.errors import DataError
from mocap_fit.face import load_face
from mocap_fit.face.mesh import Mesh
from mocap_fit.phones import PhoneSegment, PhoneSequence
from mocap_fit.render import render_movie
from mocap_fit.render.liveliness import LivelyFace, draw_liveliness, follow_pose
from mocap_fit.render.running_strip import RunningStrip, draw_text, select_moving, to_curves
from mocap_fit.render.sampling import sample_parameters
from mocap_fit.sound import Sound
from mocap_fit.tracks import MarkerTracks, ParameterTracks, PoseTracks

SIZE = (120, 128)


@pytest.fixture(scope="module")
def rig():
    return load_face()


def jaw(values, rate=25.0, **more) -> ParameterTracks:
    return ParameterTracks(("jaw_rotation",), rate, np.asarray(values)[:, None], **more)


def pictures(folder) -> list[np.ndarray]:
    from matplotlib.image import imread

    return [np.rint(imread(path)[..., :3] * 255).astype(int) for path in sorted(folder.iterdir())]


def test_each_picture_in_which_the_mouth_moves_differs_from_the_one_before(rig, tmp_path):
    # Still, then opening ever slower, then still.
    values = np.concatenate([np.zeros(3), 0.8 * (1 - 0.7 ** np.arange(1, 8)), np.full(4, 0.8)])
    values[-4:] = values[-5]
    render_movie(jaw(values), tmp_path / "a", face=rig, size=SIZE)
    shown = pictures(tmp_path / "a")
    shown_values = sample_parameters(jaw(values), (np.arange(14) + 0.5) / 25, rig)[:, 0]
    for before in range(13):
        moved = abs(shown_values[before + 1] - shown_values[before]) > 1e-4
        assert (shown[before + 1] != shown[before]).any() == moved, before


@pytest.mark.slow
def test_pictures_do_not_depend_on_how_many_processes_draw(rig, tmp_path):
    tracks = jaw(0.5 - 0.5 * np.cos(np.arange(20)))
    for name, jobs in (("one", 1), ("two", 2)):
        render_movie(tracks, tmp_path / name, face=rig, size=(64, 64), jobs=jobs, blinks=True)
    for one, two in zip(pictures(tmp_path / "one"), pictures(tmp_path / "two"), strict=True):
        np.testing.assert_array_equal(one, two)


class DeadlyRig:
    """Deforming it with the jaw wide open kills the process, as often as there are lives left."""

    def __init__(self, rig, lives: Path):
        self.rig, self.lives = rig, lives
        self.mesh, self.bounds, self.parameter_names = rig.mesh, rig.bounds, rig.parameter_names

    def deform(self, parameters):
        if parameters[0] > 0.9:
            for life in self.lives.iterdir():
                life.unlink()
                os._exit(9)
        return self.rig.deform(parameters)


@pytest.mark.slow
@pytest.mark.parametrize("times", [1, 2])
def test_a_process_that_dies_is_replaced_once(rig, tmp_path, times):
    values = np.linspace(0.0, 0.5, 20)
    values[12:14] = 1.0
    lives, out = tmp_path / "lives", tmp_path / "movie"
    lives.mkdir()
    for life in range(times):
        (lives / str(life)).touch()

    def make():
        render_movie(jaw(values), out, face=DeadlyRig(rig, lives), size=(64, 64), jobs=2)

    if times == 1:
        make()
        assert len(pictures(out)) == 20
    else:
        with pytest.raises(DataError, match="a process that draws was killed"):
            make()
        assert not out.exists()
    assert not list(lives.iterdir())


def test_a_picture_shows_the_middle_of_its_time(rig, tmp_path):
    """At 25 Hz with a start at 0.02 s every picture shows one frame as it is."""
    values = np.array([0.0, 0.7, 0.0, 0.4])
    times = (np.arange(4) + 0.5) / 25
    np.testing.assert_allclose(
        sample_parameters(jaw(values, start_time=0.02), times, rig)[:, 0], values, atol=1e-12
    )


def test_movies_last_until_sound_and_tracks_have_ended(rig, tmp_path):
    told = []
    tracks = jaw(np.zeros(10))
    movie = render_movie(
        tracks,
        tmp_path / "a.mp4",
        face=rig,
        size=(64, 64),
        sound=Sound(np.zeros(8000), 16000),
        progress=lambda done, of: told.append((done, of)),
    )
    assert movie.frames == 13
    assert movie.with_sound
    assert told == [(i + 1, 13) for i in range(13)]
    late = render_movie(jaw(np.zeros(10), start_time=0.2), tmp_path / "b", face=rig, size=(64, 64))
    assert late.frames == 10
    assert not late.with_sound


def test_a_mouth_that_opens_at_a_click_is_seen_to_open_at_the_click(rig, tmp_path):
    """The whole way: tracks and sound on one clock, drawn, written, decoded again."""
    from test_movie_file import decoded_pictures_of, decoded_sound

    rate, opening = 25.0, (0.4, 1.6)
    times = np.arange(120) / 60
    opened = ((times > opening[0]) & (times < opening[0] + 0.3)) | (times > opening[1])
    samples = np.zeros(32000)
    for click in opening:
        samples[round(click * 16000) :][:60] = 0.9
    path = tmp_path / "a.mp4"
    tracks = jaw(0.9 * opened, rate=60.0)
    render_movie(tracks, path, face=rig, size=SIZE, sound=Sound(samples, 16000), rate=rate)
    shown = decoded_pictures_of(path, SIZE).astype(int)
    change = np.abs(shown - shown[0]).mean(axis=(1, 2))
    moves = np.flatnonzero((change[1:] > 1.0) & (change[:-1] <= 1.0)) + 1
    sound = np.abs(decoded_sound(path))
    loud = np.flatnonzero(sound > 0.3) / 48000
    heard = [loud[0], loud[loud > 1.0][0]]
    np.testing.assert_allclose(moves / rate, heard, atol=1 / rate)


def test_heads_views_labels_subtitles_and_curves_have_their_places(rig, tmp_path):
    tracks = {"first": jaw(np.zeros(3)), "second": jaw(np.full(3, 0.9))}
    phones = PhoneSequence((PhoneSegment(0.0, 0.06, "p"), PhoneSegment(0.06, 0.12, "a")))
    movie = render_movie(
        tracks,
        tmp_path / "a",
        face=rig,
        size=SIZE,
        view=("front", "side"),
        phones=phones,
        subtitles=True,
        curves=["jaw_rotation"],
    )
    first = pictures(tmp_path / "a")[0]
    assert movie.size == (240, first.shape[0])
    assert first.shape[0] > 2 * 128 + 34 + 44 + 58
    heads = [first[:128, :120], first[:128, 120:], first[128:256, :120], first[128:256, 120:]]
    alone = render_movie(tracks["second"], tmp_path / "b", face=rig, size=SIZE, view="side")
    np.testing.assert_array_equal(heads[3], pictures(tmp_path / "b")[0])
    assert alone.size == SIZE
    assert (heads[0] != heads[1]).any()
    # Ink of both labels, of the phone, of the curves.
    below = first[256:]
    for part in (below[:34, :120], below[:34, 120:], below[34:78], below[78:]):
        assert (part < 200).any()
    second = pictures(tmp_path / "a")[2]
    assert (second[256 + 34 : 256 + 78] != first[256 + 34 : 256 + 78]).any()


def test_markers_are_drawn_over_the_head_where_they_are(rig, tmp_path):
    nose = rig.mesh.vertices[rig.mesh.get_feature_point("9.3")] + np.array([0, 0, 3.0])
    positions = np.stack([nose[None], np.full((1, 3), np.nan)])
    markers = MarkerTracks(("nose",), 25.0, positions, start_time=0.02)
    still = jaw(np.zeros(2))
    render_movie(still, tmp_path / "a", face=rig, size=SIZE, markers=markers)
    with_marker, without = pictures(tmp_path / "a")
    changed = with_marker != without
    assert 0 < changed.any(axis=2).sum() < 200


def test_markers_between_frames_are_between_and_gaps_stay_gaps():
    positions = np.zeros((4, 1, 3))
    positions[:, 0, 0] = [0, 2, np.nan, 6]
    markers = MarkerTracks(("a",), 10.0, positions, start_time=1.0)
    found = markers.at(np.array([0.5, 1.0, 1.05, 1.12, 1.2, 1.3, 1.5]))[:, 0, 0]
    np.testing.assert_allclose(found, [np.nan, 0, 1, np.nan, np.nan, 6, np.nan])


def test_parameters_are_held_at_the_ends_bridged_bounded_and_at_rest_where_there_are_none(rig):
    tracks = jaw([0.2, np.nan, 0.4, 9.0], rate=10.0)
    found = sample_parameters(tracks, np.array([-1.0, 0.0, 0.1, 0.2, 5.0]), rig)
    np.testing.assert_allclose(found[[0, 1, 3], 0], [0.2, 0.2, 0.4])
    assert 0.2 < found[2, 0] < 0.4
    assert found[4, 0] == rig.bounds[0, 1]
    assert not found[:, 1:].any()


def test_between_frames_a_closure_is_never_overshot(rig):
    tracks = jaw([0.5, 0.0, 0.0, 0.6], rate=10.0)
    found = sample_parameters(tracks, np.linspace(0, 0.3, 100), rig)[:, 0]
    assert found.min() >= 0.0
    assert found.max() <= 0.6


class TestLiveliness:
    TIMES = np.arange(600) / 30

    def test_it_is_drawn_from_the_seed(self):
        one, same, other = (draw_liveliness(self.TIMES, seed=seed) for seed in (3, 3, 4))
        np.testing.assert_array_equal(one.blinks, same.blinks)
        np.testing.assert_array_equal(one.turns, same.turns)
        assert (one.blinks != other.blinks).any()

    def test_each_can_be_had_alone(self):
        still = draw_liveliness(self.TIMES, head_motion=False, seed=3)
        assert not still.turns.any()
        assert not still.shifts.any()
        np.testing.assert_array_equal(still.blinks, draw_liveliness(self.TIMES, seed=3).blinks)
        assert not draw_liveliness(self.TIMES, blinks=False).blinks.any()

    def test_people_blink_now_and_then_and_move_little(self):
        life = draw_liveliness(self.TIMES, seed=0)
        closed = (life.blinks > 0.9).astype(int)
        assert 2 <= (np.diff(closed) == 1).sum() <= 15
        assert life.blinks.mean() < 0.15
        assert np.degrees(np.abs(life.turns)).max() < 6
        assert np.abs(life.shifts).max() < 4

    def test_lids_meet_and_nothing_else_moves(self, rig):
        mesh = rig.mesh
        lively = LivelyFace(mesh)
        closed = lively.move(mesh.vertices, 1.0, np.zeros(3), np.zeros(3))
        for upper, lower in (("3.1", "3.3"), ("3.2", "3.4")):
            gap = (
                closed[mesh.get_feature_point(upper), 1] - closed[mesh.get_feature_point(lower), 1]
            )
            assert abs(gap) < 0.8
        allowed = np.concatenate(
            [
                mesh.get_region(f"{part}_{side}")
                for part in ("eyelids", "lashes", "eye")
                for side in ("left", "right")
            ]
        )
        moved = np.flatnonzero((closed != mesh.vertices).any(axis=1))
        assert np.isin(moved, allowed).all()
        np.testing.assert_array_equal(
            lively.move(mesh.vertices, 0.0, np.zeros(3), np.zeros(3)), mesh.vertices
        )

    def test_the_neck_does_not_turn_on_its_shoulders(self, rig):
        vertices = rig.mesh.vertices
        moved = LivelyFace(rig.mesh).carry(vertices, np.array([0.0, 0.1, 0.0]), np.ones(3))
        lowest = vertices[:, 1] < vertices[:, 1].min() + 0.5
        assert np.abs(moved - vertices - 1.0)[lowest].max() < 0.2
        head = vertices[:, 1] > 0
        apart = np.linalg.norm(vertices[head][0] - vertices[head], axis=1)
        np.testing.assert_allclose(
            np.linalg.norm(moved[head][0] - moved[head], axis=1), apart, atol=1e-9
        )

    def test_a_measured_pose_moves_the_head_about_its_mean(self, rig):
        times = np.arange(50) / 50
        nods = Rotation.from_rotvec(np.outer(0.1 * np.sin(2 * np.pi * times), [1.0, 0, 0]))
        turn = Rotation.from_euler("y", 40, degrees=True)
        rotations = (turn * nods).as_matrix()[:, None]
        places = np.array([900.0, 100.0, -50.0]) + turn.apply(np.outer(times, [0.0, 0.0, 4.0]))
        gap = np.where(np.arange(50) == 20, np.nan, 1.0)[:, None, None]
        pose = PoseTracks(("head",), 50.0, rotations * gap[..., None], places[:, None] * gap)
        still = draw_liveliness(times, blinks=False, head_motion=False)
        life = follow_pose(still, pose, times, rig.mesh)
        lively = LivelyFace(rig.mesh, blinks=False)
        # The nose moves as it did in the recording, seen from where the speaker looked on average.
        nose = rig.mesh.vertices[[rig.mesh.get_feature_point("9.3")]]
        shown = np.array([lively.carry(nose, life.turns[i], life.shifts[i])[0] for i in (5, 15)])
        said = (turn * nods).apply(nose[0]) + places
        moved = turn.inv().apply(said[15] - said[5])
        np.testing.assert_allclose(shown[1] - shown[0], moved, atol=0.02)
        assert np.abs(life.turns.mean(axis=0)).max() < 0.01
        assert np.isfinite(life.shifts).all()
        with pytest.raises(DataError, match="known in no frame"):
            follow_pose(still, pose.replace(rotations=rotations * np.nan), times, rig.mesh)

    def test_a_mesh_without_lids_cannot_blink(self):
        from mocap_fit.errors import ConfigurationError

        corners = np.array([[-50.0, -50, 0], [50, -50, 0], [0, 60, 0]])
        mesh = Mesh(corners, np.array([[0, 1, 2]]))
        with pytest.raises(ConfigurationError, match="cannot blink"):
            LivelyFace(mesh)
        assert LivelyFace(mesh, blinks=False) is not None


class TestStrip:
    def strip(self, end=50.0):
        times = np.arange(0, end, 0.02)
        tracks = {"a": jaw(np.sin(times), rate=50.0), "b": jaw(0 * times, rate=50.0)}
        phones = PhoneSequence(
            tuple(PhoneSegment(float(i), float(i + 1), "æɪ"[i % 2]) for i in range(int(end)))
        )
        return RunningStrip(240, to_curves(tracks, ["jaw_rotation"]), phones, 0.0, end)

    def test_it_runs_evenly_also_over_the_seams_of_its_pieces(self):
        strip = self.strip()
        step = 5 / 100  # 100 pixels a second
        for time in (3.0, 19.97, 20.0, 39.99):
            now, later = strip.at(time)[:58], strip.at(time + step)[:58]
            # Away from the line in the middle and the name at the left.
            np.testing.assert_array_equal(now[30:, 145:235], later[30:, 140:230])

    def test_before_the_start_and_after_the_end_it_is_empty(self):
        strip = self.strip(end=2.0)
        assert (strip.at(0.0)[64:86, :100] == 255).all()
        assert strip.at(0.0).shape == strip.at(1.9).shape == (58 + 34, 240, 3)

    def test_what_moves_most_is_found(self):
        names = ("a", "b", "c")
        values = np.outer(np.sin(np.arange(50)), [0.1, 1.0, 0.0])
        assert select_moving([ParameterTracks(names, 25, values)], 2) == ("a", "b")
        assert select_moving([ParameterTracks(names, 25, values)], 1) == ("b",)

    def test_unknown_parameters_and_too_many_are_refused(self):
        tracks = {"a": jaw(np.zeros(3))}
        with pytest.raises(DataError, match="no parameter 'nose'"):
            to_curves(tracks, ["nose"])
        with pytest.raises(DataError, match="too many"):
            to_curves(tracks, ["jaw_rotation"] * 7)

    def test_letters_of_the_ipa_are_there(self):
        boxes = {draw_text(symbol).tobytes() for symbol in "ɑɧʂɵr̝"}
        assert len(boxes) > 4
        assert draw_text("").shape[1] == 1


@pytest.mark.parametrize(
    ("tracks", "options", "message"),
    [
        ({}, {}, "no tracks"),
        (jaw(np.zeros(3)), {"subtitles": True}, "phones"),
        (jaw(np.zeros(3)), {"rate": 0}, "frame rate"),
        (jaw(np.zeros(3)), {"view": "back"}, "no view"),
        (jaw(np.zeros(3)), {"view": ()}, "a view"),
        (jaw(np.zeros((0,))), {}, "no frames"),
        (ParameterTracks(("nose",), 25, np.zeros((3, 1))), {}, "no parameter nose"),
        (jaw(np.zeros(3), start_time=9e9), {"sound": Sound(np.zeros(9), 9)}, "hour"),
    ],
)
def test_impossible_movies_are_refused_and_leave_nothing(rig, tmp_path, tracks, options, message):
    with pytest.raises(DataError, match=message):
        render_movie(tracks, tmp_path / "a.mp4", **({"face": rig, "size": (64, 64)} | options))
    assert not list(tmp_path.iterdir())
