"""Reference poses: spans of takes, laid on each other by the head, judged, and suggested."""

import warnings
from pathlib import Path

import numpy as np
import pytest

import mocap_fit as mf
from corpus_tools.simulation import Conditions, Session
from mocap_fit.edits import DropSpan, Mirror, SetReference, start_edits, write_edits
from mocap_fit.errors import DataError, MocapFitError, MocapFitWarning
from mocap_fit.fitting import (
    align_reference,
    fit_speaker,
    parse_reference,
    read_reference,
    suggest_reference,
)
from mocap_fit.fitting.reference_pose import ReferenceFile, find_reference_faults
from mocap_fit.head.alignment import align_shapes
from mocap_fit.head.reference import compute_median_pose
from mocap_fit.io import write_tracks
from mocap_fit.tracks import ParameterTracks

RATE = 60.0


@pytest.fixture(scope="module")
def moving(layout, face):
    """A session in which the head moves a little all the time, and is noisy."""
    conditions = Conditions(noise=0.3, drop_outs=0.0, head_translation=3.0, head_rotation=0.02)
    return Session(layout, face, conditions)


def play(session, *parts, seed=0):
    """A recording: a second of each part, parameters that go to and fro by name."""
    names = session.face.parameter_names
    values = np.zeros((int(RATE) * len(parts), len(names)))
    waves = 0.5 + 0.5 * np.sin(np.linspace(0, 12 * np.pi, int(RATE)))
    for number, part in enumerate(parts):
        rows = slice(number * int(RATE), (number + 1) * int(RATE))
        for name, value in part.items():
            values[rows, names.index(name)] = value * waves
    truth = ParameterTracks(names, RATE, values, name="take")
    return session.play(truth, np.random.default_rng(seed)).recording


SPEECH = {"jaw_rotation": 0.6, "lower_lip_depression": 0.5, "upper_lip_raise": 0.4}
REST: dict[str, float] = {}


def measure_blur(tracks):
    off = tracks.positions - np.nanmedian(tracks.positions, axis=0)
    return float(np.sqrt(np.nanmean((off**2).sum(axis=2))))


def measure_error(session, pose):
    """How far the median is from the markers as they are, root mean square."""
    medians = compute_median_pose(pose)
    points = np.array([medians[name] for name in session.still.names])
    fit = align_shapes(session.still.positions[0], points)
    return float(np.sqrt((fit.distances**2).mean()))


class TestMedian:
    def test_a_moving_head_does_not_blur_it(self, moving, layout):
        raw = play(moving, REST, REST, REST)
        aligned = align_reference(layout, raw)
        assert measure_blur(raw) > 1.5
        assert measure_blur(aligned) < 0.65
        assert measure_error(moving, aligned) < 0.1

    def test_a_turning_head_does_not_deform_it(self, layout, face):
        conditions = Conditions(noise=0.3, drop_outs=0.0, head_translation=10, head_rotation=0.3)
        session = Session(layout, face, conditions)
        raw = play(session, REST, REST, REST)
        assert measure_error(session, raw) > 0.5
        assert measure_error(session, align_reference(layout, raw)) < 0.1

    def test_the_speaker_has_it(self, moving, layout, face):
        raw = play(moving, REST, REST)
        speaker = fit_speaker(face, layout, raw)
        assert speaker.reference.equals(align_reference(layout, raw))
        assert measure_error(moving, speaker.reference) < 0.1

    def test_one_frame_is_as_it_is(self, session, layout):
        assert align_reference(layout, session.still) is session.still

    def test_a_head_that_is_never_seen_is_left_alone(self, session, layout):
        still = session.still.replace(
            positions=np.full((5, 35, 3), np.nan), origin=np.zeros((5, 35), np.uint8)
        )
        assert align_reference(layout, still) is still


class TestSuggestion:
    def test_the_rest_between_speech_is_suggested(self, moving, layout):
        take = play(moving, SPEECH, REST, SPEECH)
        span = suggest_reference(take, layout)
        assert span.start + 0.02 >= 1.0
        assert span.end <= 2.02
        assert span.residual < 0.6
        assert str(span) == f"{span.start:.3f}-{span.end:.3f}"

    def test_open_lips_are_not_suggested_though_they_are_stiller(self, layout, face):
        quiet = Session(layout, face, Conditions(noise=0.05, drop_outs=0.0))
        take = play(quiet, SPEECH, SPEECH, SPEECH, REST, SPEECH)
        positions = take.positions.copy()
        # A second in which the open mouth does not move at all.
        wide = take.positions[
            int(np.argmax(np.linalg.norm(take["lip_upper_mid"] - take["lip_lower_mid"], axis=1)))
        ]
        positions[60:120] = wide
        span = suggest_reference(take.replace(positions=positions, origin=None), layout)
        assert span.start + 0.02 >= 3.0
        assert span.end <= 4.02

    def test_a_recording_that_is_shorter_is_suggested_as_it_is(self, moving, layout):
        take = play(moving, REST).between(0, 0.1)
        span = suggest_reference(take, layout)
        assert (span.start, span.end) == pytest.approx((0.0, 0.1))

    def test_a_recording_without_a_head_is_refused(self, session, layout):
        empty = session.still.replace(
            positions=np.full((5, 35, 3), np.nan), origin=np.zeros((5, 35), np.uint8)
        )
        with pytest.raises(DataError, match="known in no frame"):
            suggest_reference(empty, layout)


class TestFaults:
    def list_kinds(self, layout, pose, take=None):
        faults = find_reference_faults(layout, pose, take or pose, "take.tsv")
        return [fault.kind for fault in faults]

    def test_a_good_one_has_none(self, moving, layout):
        take = play(moving, SPEECH, REST)
        assert self.list_kinds(layout, play(moving, REST)) == []
        assert self.list_kinds(layout, take.between(1.2, 1.6), take) == []

    def test_one_that_speaks(self, moving, layout):
        take = play(moving, REST, SPEECH)
        kinds = self.list_kinds(layout, take.between(1, 2), take)
        assert kinds == ["speaks", "moves", "worse"]

    def test_one_with_open_lips(self, moving, layout, face):
        take = play(moving, REST, {"lower_lip_depression": 1.0})
        gap = np.linalg.norm(take["lip_upper_mid"] - take["lip_lower_mid"], axis=1)
        frame = int(np.argmax(gap))
        pose = take.replace(positions=take.positions[[frame] * 9], origin=None)
        assert self.list_kinds(layout, pose, take)[0] == "speaks"

    def test_one_whose_brow_moves(self, moving, layout):
        take = play(moving, REST, REST)
        positions = take.positions.copy()
        brow = take.index("brow_left")
        positions[:, brow, 1] += 6 * np.sin(np.arange(take.frames) / 15)
        (fault, *_) = find_reference_faults(
            layout, *2 * [take.replace(positions=positions)], "take.tsv"
        )
        assert fault.kind == "moves"
        assert "'brow_left' moves" in fault.problem
        assert "take.tsv@" in fault.advice

    def test_it_is_said_when_a_speaker_is_prepared(self, moving, layout, face, tmp_path):
        path = tmp_path / "take.tsv"
        write_tracks(play(moving, REST, SPEECH), path)
        with pytest.warns(MocapFitWarning, match=r"the lips move .*take\.tsv@0\.") as caught:
            fit_speaker(face, layout, path)
        assert len(caught) == 1
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            speaker = fit_speaker(face, layout, f"{path}@0.2-0.7")
        assert speaker.reference.frames == 30
        assert speaker.reference.name == "take@0.2-0.7"


class TestFiles:
    @pytest.mark.parametrize(
        ("text", "path", "span"),
        [
            ("take.tsv@0.2-0.5", "take.tsv", (0.2, 0.5)),
            ("a@b/take.c3d@1-12.", "a@b/take.c3d", (1.0, 12.0)),
            ("take.tsv@-1-2", "take.tsv", (-1.0, 2.0)),
            ("take.tsv", "take.tsv", None),
            ("take@1.tsv", "take@1.tsv", None),
            ("take.tsv@soon-later", "take.tsv@soon-later", None),
        ],
    )
    def test_spans_are_parsed(self, text, path, span):
        assert parse_reference(text) == ReferenceFile(Path(path), span)

    def test_a_file_with_such_a_name_is_a_file(self, tmp_path, monkeypatch):
        monkeypatch.chdir(tmp_path)
        Path("take@1-2").touch()
        assert parse_reference("take@1-2").span is None

    @pytest.mark.parametrize(
        ("span", "words"), [("0.5-0.2", "ends before it starts"), ("7-8", "no frame lies")]
    )
    def test_wrong_spans_are_refused(self, span, words):
        path = mf.load_sample("rest")
        with pytest.raises(DataError, match=words) as caught:
            read_reference(f"{path}@{span}")
        assert str(path) in str(caught.value)

    def test_edits_are_applied_and_say_where_it_is(self, tmp_path):
        rest, take = tmp_path / "rest.tsv", tmp_path / "take.tsv"
        rest.write_bytes(Path(mf.load_sample("rest")).read_bytes())
        take.write_bytes(Path(mf.load_sample("take_01")).read_bytes())
        edits = start_edits(rest).add(Mirror(), DropSpan(markers=("nose_tip",)))
        write_edits(edits, tmp_path / "rest.tsv.edits.toml")
        pose, whole = read_reference(rest)
        assert pose is whole
        assert not pose.visible[:, pose.index("nose_tip")].any()
        write_edits(edits.add(SetReference(start=0.1, end=0.2)), tmp_path / "rest.tsv.edits.toml")
        pose, whole = read_reference(rest)
        assert (pose.frames, whole.frames) == (6, 30)
        assert not pose.visible[:, pose.index("nose_tip")].any()
        # A span that is given counts more than the one of the list.
        assert read_reference(f"{rest}@0-0.3")[0].frames == 18
        elsewhere = SetReference(start=0.1, end=0.2, recording="take.tsv")
        write_edits(edits.add(elsewhere), tmp_path / "rest.tsv.edits.toml")
        pose, whole = read_reference(rest)
        assert (pose.name, whole.name) == ("take@0.1-0.2", "take")
        assert pose.visible[:, pose.index("nose_tip")].all()
        missing = SetReference(recording="nowhere.tsv")
        write_edits(edits.add(missing), tmp_path / "rest.tsv.edits.toml")
        with pytest.raises(MocapFitError, match="nowhere"):
            read_reference(rest)
