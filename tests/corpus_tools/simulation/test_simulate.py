"""``mocap-fit simulate``: what was asked for, the same every time, and its truth is true."""

import hashlib

import numpy as np
import pytest

from corpus_tools.cli import app as cli
from corpus_tools.simulation import Conditions, draw_gesture
from mocap_fit.errors import ConfigurationError
from mocap_fit.fitting import fit_speaker
from mocap_fit.io import read_tracks
from mocap_fit.tracks import MarkerTracks, ParameterTracks, PoseTracks, read_parquet


def hashes(folder):
    return {
        path.relative_to(folder.path).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.path.rglob("*"))
        if path.is_file()
    }


def predicted(folder, which=0):
    """Markers, by name, where truth and pose put them, `(frames, 3)` each, in the laboratory."""
    speaker = fit_speaker("built-in", folder.layout, folder.reference)
    binding = speaker.binding
    truth, pose = read_parquet(folder.truth[which]), read_parquet(folder.poses[which])
    face = np.array([binding.evaluate(values)[0] for values in truth.values])
    head = np.repeat(binding.head_positions[None], truth.frames, axis=0)
    still = binding.orientation.undo(np.concatenate([face, head], axis=1))
    moved = np.einsum("fij,fmj->fmi", pose.rotations[:, 0], still) + pose.translations
    names = (*binding.names, *binding.head_names)
    return {name: moved[:, i] for i, name in enumerate(names)}


def differences(folder):
    """Recorded less predicted coordinates of every sample that was seen."""
    recording = read_tracks(folder.recordings[0])
    places = predicted(folder)
    assert set(places) == set(recording.names)
    return np.concatenate(
        [
            (recording[name] - places[name])[recording.visible[:, i]].ravel()
            for i, name in enumerate(recording.names)
        ]
    )


def test_the_same_seed_gives_the_same_bytes(simulate, session, tmp_path):
    again = simulate(tmp_path / "again", "--utterances", 2)
    assert hashes(again) == hashes(session)


def test_another_seed_gives_other_files(simulate, session, tmp_path):
    other = hashes(simulate(tmp_path / "other", "--utterances", 2, "--seed", 1))
    first = hashes(session)
    assert other.keys() == first.keys()
    assert not set(other.values()) & set(first.values())


def test_more_recordings_leave_the_first_as_they_were(simulate, session, tmp_path):
    more = hashes(simulate(tmp_path / "more", "--utterances", 3))
    first = hashes(session)
    assert len(more) == len(first) + 3
    assert {name: more[name] for name in first} == first


def test_what_is_written(session):
    names = {path.stem for path in session.recordings}
    assert names == {"sim001", "sim002"}
    assert {path.stem for path in session.truth} == names == {path.stem for path in session.poses}
    for recording, truth, pose in zip(
        map(read_tracks, session.recordings),
        map(read_parquet, session.truth),
        map(read_parquet, session.poses),
        strict=True,
    ):
        assert isinstance(recording, MarkerTracks)
        assert isinstance(truth, ParameterTracks)
        assert isinstance(pose, PoseTracks)
        assert len(recording.names) == 35
        assert len(truth.names) == 10
        assert recording.name == truth.name == pose.name
        assert recording.rate == truth.rate == pose.rate == 60
        assert recording.frames == truth.frames == pose.frames == 30
        np.testing.assert_allclose(recording.times, truth.times)
    reference = read_tracks(session.reference)
    assert reference.visible.all()
    assert reference.frames == 120


@pytest.mark.parametrize(("rate", "duration", "frames"), [(100, 0.3, 30), (29.97, 1, 30)])
def test_rate_and_duration(simulate, rate, duration, frames, tmp_path):
    folder = simulate(tmp_path / "s", "--utterances", 1, "--rate", rate, "--duration", duration)
    recording = read_tracks(folder.recordings[0])
    assert recording.rate == pytest.approx(rate)
    assert recording.frames == frames


@pytest.mark.parametrize("share", [0.0, 0.05, 0.3])
def test_the_part_of_samples_that_is_lost(simulate, share, tmp_path):
    folder = simulate(
        tmp_path / "s", "--utterances", 1, "--drop-outs", share, "--duration", 4, "--noise", 0
    )
    recording = read_tracks(folder.recordings[0])
    lost = ~recording.visible
    assert lost.mean() == pytest.approx(share, abs=0.2 * share)
    if share:
        # Drop-outs come in stretches, as where a hand is in the way, not as single frames.
        starts = (lost[1:] & ~lost[:-1]).sum() + lost[0].sum()
        assert 2 < lost.sum() / starts < 6


def test_the_head_shifts_as_far_as_asked(simulate, tmp_path):
    folder = simulate(
        tmp_path / "s", "--utterances", 1, "--head-shift", 12, "--head-turn", 0, "--duration", 6
    )
    pose = read_parquet(folder.poses[0])
    np.testing.assert_allclose(pose.rotations[:, 0], np.eye(3)[None].repeat(pose.frames, 0))
    assert np.abs(pose.translations).max() <= 12
    assert (np.ptp(pose.translations[:, 0], axis=0) > 6).all()


def test_the_head_turns_as_far_as_asked(simulate, tmp_path):
    folder = simulate(
        tmp_path / "s", "--utterances", 1, "--head-shift", 0, "--head-turn", 15, "--duration", 6
    )
    rotations = read_parquet(folder.poses[0]).rotations[:, 0]
    np.testing.assert_allclose(
        rotations @ rotations.transpose(0, 2, 1),
        np.eye(3)[None].repeat(len(rotations), 0),
        atol=1e-12,
    )
    turn = np.degrees(np.arccos((np.trace(rotations, axis1=1, axis2=2) - 1) / 2))
    assert turn.max() <= np.sqrt(3) * 15
    assert turn.max() > 8


def test_truth_makes_the_recording_again(simulate, tmp_path):
    folder = simulate(tmp_path / "s", "--utterances", 1, "--noise", 0)
    # The recording has thousandths of a millimetre.
    assert np.abs(differences(folder)).max() < 0.01


@pytest.mark.parametrize("noise", [0.1, 0.5])
def test_noise_is_what_was_asked_for(simulate, noise, tmp_path):
    folder = simulate(tmp_path / "s", "--utterances", 1, "--noise", noise, "--duration", 1)
    found = differences(folder)
    # The reference pose that markers are tied in has noise too, though little.
    assert found.std() == pytest.approx(noise, rel=0.1)
    assert abs(found.mean()) < 0.1 * noise


def test_another_speaker_has_another_head(simulate, session, tmp_path):
    other = simulate(tmp_path / "other", "--utterances", 1, "--other-speaker")
    scales = [
        fit_speaker("built-in", folder.layout, folder.reference).binding.orientation.scale
        for folder in (session, other)
    ]
    assert scales[0] == pytest.approx(1.0, abs=0.01)
    assert 1.02 < scales[1] < 1.2
    # The gestures are the same ones, for the seed is.
    np.testing.assert_array_equal(
        read_parquet(other.truth[0]).values, read_parquet(session.truth[0]).values
    )


def test_gestures_are_smooth_and_use_their_range(rng):
    track = draw_gesture(rng, 6000, 60.0, 3.0, -0.2, 0.8)
    assert track.min() >= -0.2
    assert track.max() <= 0.8
    histogram, _ = np.histogram(track, bins=5, range=(-0.2, 0.8))
    assert histogram.min() > 0.5 * histogram.max()
    # Little is left above 12 Hz.
    spectrum = np.abs(np.fft.rfft(track - track.mean())) ** 2
    assert spectrum[np.fft.rfftfreq(6000, 1 / 60) > 12].sum() < 1e-3 * spectrum.sum()


def test_an_empty_folder_may_be_there(simulate, tmp_path):
    folder = simulate(tmp_path, "--utterances", 1)
    assert len(folder.recordings) == 1


@pytest.mark.parametrize(
    "wrong",
    [{"noise": -1.0}, {"drop_outs": 0.95}, {"rate": 0.0}, {"duration": 0.01}],
    ids=lambda wrong: next(iter(wrong)),
)
def test_impossible_conditions(wrong):
    with pytest.raises(ConfigurationError):
        Conditions(**wrong)


@pytest.mark.parametrize(
    ("option", "value"),
    [
        ("--utterances", "0"),
        ("--utterances", "-3"),
        ("--seed", "-1"),
        ("--noise", "-0.1"),
        ("--drop-outs", "1.5"),
        ("--rate", "0"),
        ("--duration", "many"),
        ("--head-turn", "120"),
    ],
)
def test_wrong_calls(option, value, tmp_path, capsys):
    assert cli.main(["simulate", str(tmp_path / "s"), option, value]) == 2
    assert option in capsys.readouterr().err
    assert not (tmp_path / "s").exists()
