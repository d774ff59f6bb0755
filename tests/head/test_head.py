import warnings

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from mocap_fit.errors import DataError, MocapFitWarning
from mocap_fit.head import (
    HeadMotion,
    estimate_head_motion,
    find_reference_markers,
    match_size,
    remove_head_motion,
    restore_head_motion,
)
from mocap_fit.io import read_poses, read_tracks
from mocap_fit.tracks import Event, MarkerTracks, Origin
from mocap_fit.tracks.rigid import estimate_rigid_transforms

# A marker on each temple and hinge of a pair of spectacles, and one above the bridge.
SPECTACLES = {
    "temple_left": (72.0, 0.0, -70.0),
    "temple_right": (-72.0, 0.0, -70.0),
    "hinge_left": (62.0, 20.0, 15.0),
    "hinge_right": (-62.0, 20.0, 15.0),
    "bridge": (0.0, 55.0, 40.0),
}
HEAD = tuple(SPECTACLES)
SHAPE = np.array(list(SPECTACLES.values()))
RATE = 60.0


def face_at_rest(rng, markers=12):
    """Lips, cheeks and chin, roughly."""
    return rng.uniform([-40, -110, 20], [40, -20, 60], size=(markers, 3))


def moving_head(rng, frames=1200, noise=0.1, turn=20.0, shift=30.0, face=4):
    """A recording in room coordinates, the reference pose, and the truth."""
    rest = np.concatenate([SHAPE, face_at_rest(rng, face)])
    names = (*HEAD, *(f"face_{k}" for k in range(face)))
    times = np.arange(frames) / RATE
    in_head = np.broadcast_to(rest, (frames, *rest.shape)).copy()
    # The face opens and closes by several millimetres, each marker in its own time.
    speeds, directions = rng.uniform(1, 4, size=face), rng.normal(size=(face, 3)) * 4
    in_head[:, 5:] += np.sin(2 * np.pi * times[:, None] * speeds)[:, :, None] * directions[None]
    turns = Rotation.from_euler("yxz", rng.uniform(-turn, turn, (frames, 3)), degrees=True)
    shifts = rng.uniform(-shift, shift, (frames, 3)) + np.array([200.0, 1000.0, -50.0])
    points = np.einsum("fij,fpj->fpi", turns.as_matrix(), in_head) + shifts[:, None]
    points += noise * rng.normal(size=points.shape)
    recording = MarkerTracks(names, RATE, points, name="take 1", start_time=0.1)
    reference = MarkerTracks(names, RATE, rest[None])
    return recording, reference, turns, shifts


def pose_errors(motion: HeadMotion, turns, shifts):
    """Root mean square error at the centroid in mm, and of the rotation in degrees."""
    known = motion.known
    found = motion.rotations @ motion.centre + motion.translations
    truth = turns.apply(motion.centre) + shifts
    distances = np.linalg.norm(found - truth, axis=1)[known]
    angles = (turns[known].inv() * Rotation.from_matrix(motion.rotations[known])).magnitude()
    return np.sqrt(np.mean(distances**2)), np.degrees(np.sqrt(np.mean(angles**2)))


def without(tracks: MarkerTracks, gone) -> MarkerTracks:
    positions = np.where(gone[:, :, None], np.nan, tracks.positions)
    return tracks.replace(positions=positions, origin=None)


def test_the_pose_is_found_within_a_tenth_of_a_millimetre_and_of_a_degree(rng):
    recording, reference, turns, shifts = moving_head(rng)
    motion = estimate_head_motion(recording, reference, HEAD)
    distance, angle = pose_errors(motion, turns, shifts)
    assert distance <= 0.1
    assert angle <= 0.1
    assert motion.known.all()
    assert motion.noise == pytest.approx(0.1, rel=0.05)


def test_drop_outs_cost_little(rng):
    recording, reference, turns, shifts = moving_head(rng)
    gappy = without(recording, rng.random((recording.frames, len(recording.names))) < 0.05)
    motion = estimate_head_motion(gappy, reference, HEAD)
    distance, angle = pose_errors(motion, turns, shifts)
    assert distance <= 0.1
    assert angle <= 0.1
    assert motion.known.mean() > 0.995


@pytest.mark.parametrize("bad", HEAD)
def test_a_marker_ten_millimetres_off_is_found_named_and_left_out(rng, bad):
    recording, reference, turns, shifts = moving_head(rng)
    positions = recording.positions.copy()
    positions[:, recording.index(bad)] += 10 * turns.apply([0.36, 0.48, 0.8])
    recording = recording.replace(positions=positions)
    with pytest.warns(MocapFitWarning, match=rf"left out: {bad} \(1\d\d\d of 1200 frames\)"):
        motion = estimate_head_motion(recording, reference, HEAD)
    others = [name for name in HEAD if name != bad]
    best = estimate_head_motion(recording, reference, others)
    np.testing.assert_allclose(motion.rotations, best.rotations, atol=1e-6)
    np.testing.assert_allclose(motion.translations, best.translations, atol=1e-3)
    distance, angle = pose_errors(motion, turns, shifts)
    assert distance <= 0.13
    assert angle <= 0.13
    index = HEAD.index(bad)
    assert np.median(motion.marker_residuals[:, index]) == pytest.approx(10, abs=0.5)
    assert f"{bad}: " in str(motion)
    assert "left out in 1" in str(motion)
    assert (motion.weights[:, index] == 0).all()


def test_bad_marker_and_drop_outs_together(rng):
    recording, reference, turns, shifts = moving_head(rng)
    positions = recording.positions.copy()
    positions[300:800, 2] += 10 * turns.apply([0.36, 0.48, 0.8])[300:800]
    recording = without(
        recording.replace(positions=positions),
        rng.random((recording.frames, len(recording.names))) < 0.05,
    )
    motion = estimate_head_motion(recording, reference, HEAD)
    distance, angle = pose_errors(motion, turns, shifts)
    assert distance <= 0.12
    assert angle <= 0.12
    assert motion.rejected[300:800, 2].sum() >= 0.99 * recording.visible[300:800, 2].sum()


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_moving_the_room_changes_the_pose_only(seed):
    rng = np.random.default_rng(seed)
    recording, reference, _, _ = moving_head(rng, frames=30)
    turn, shift = Rotation.random(rng=rng), rng.uniform(-2000, 2000, size=3)
    moved = recording.replace(positions=recording.positions @ turn.as_matrix().T + shift)
    tracks, motion = remove_head_motion(recording, reference, HEAD)
    moved_tracks, moved_motion = remove_head_motion(moved, reference, HEAD)
    np.testing.assert_allclose(moved_tracks.positions, tracks.positions, atol=1e-7)
    np.testing.assert_allclose(
        moved_motion.rotations, turn.as_matrix() @ motion.rotations, atol=1e-9
    )
    np.testing.assert_allclose(
        moved_motion.translations, motion.translations @ turn.as_matrix().T + shift, atol=1e-6
    )
    np.testing.assert_allclose(moved_motion.residuals, motion.residuals, atol=1e-8)
    np.testing.assert_allclose(moved_motion.covariance, motion.covariance, rtol=1e-7, atol=1e-12)


@settings(max_examples=25, deadline=None)
@given(st.permutations(range(9)), st.permutations(HEAD), st.integers(0, 2**32 - 1))
def test_the_order_of_markers_does_not_matter(order, names, seed):
    rng = np.random.default_rng(seed)
    recording, reference, _, _ = moving_head(rng, frames=20)
    recording = without(recording, rng.random((20, 9)) < 0.1)
    first = estimate_head_motion(recording, reference, HEAD)
    shuffled = recording.select([recording.names[k] for k in order])
    second = estimate_head_motion(shuffled, reference, names)
    np.testing.assert_allclose(second.rotations, first.rotations, atol=1e-9)
    np.testing.assert_allclose(second.translations, first.translations, atol=1e-7)


def test_the_motion_can_be_put_back(rng):
    recording, reference, _, _ = moving_head(rng, frames=300)
    recording = without(recording, rng.random((300, 9)) < 0.05).replace(
        events=(Event("clap", 1.0),)
    )
    tracks, motion = remove_head_motion(recording, reference, HEAD)
    back = restore_head_motion(tracks, motion)
    np.testing.assert_allclose(back.positions, recording.positions, atol=1e-9)
    np.testing.assert_array_equal(back.origin, recording.origin)
    assert (back.name, back.rate, back.start_time) == ("take 1", RATE, 0.1)
    assert back.events == recording.events
    steps = [step.name for step in back.provenance]
    assert steps == ["remove_head_motion", "restore_head_motion"]
    assert tracks.provenance[-1].arguments["reference_markers"] == list(HEAD)
    assert motion.pose.provenance[-1].name == "estimate_head_motion"
    other = restore_head_motion(tracks.select(["face_1"]), motion)
    np.testing.assert_allclose(other.positions[:, 0], recording["face_1"], atol=1e-9)
    with pytest.raises(DataError, match="not of the same frames"):
        restore_head_motion(tracks.between(0.5, 1.0), motion)


def test_head_coordinates_are_those_of_the_reference_pose(rng):
    recording, reference, _, _ = moving_head(rng, noise=0.0)
    tracks, _ = remove_head_motion(recording, reference, HEAD)
    np.testing.assert_allclose(
        tracks.select(HEAD).positions, np.broadcast_to(SHAPE, (1200, 5, 3)), atol=1e-8
    )


def test_three_markers_are_enough_and_fewer_make_the_frame_missing(rng):
    recording, reference, turns, shifts = moving_head(rng, frames=100)
    gone = np.zeros((100, 9), dtype=bool)
    gone[:, :2] = True
    gone[40:43, 2] = True
    recording = without(recording, gone)
    with pytest.warns(MocapFitWarning, match="without data are left out: temple_left"):
        motion = estimate_head_motion(recording, reference, HEAD)
    assert np.flatnonzero(~motion.known).tolist() == [40, 41, 42]
    assert np.isnan(motion.covariance[40:43]).all()
    assert np.isfinite(motion.covariance[motion.known]).all()
    three = HEAD[2:]
    with pytest.warns(MocapFitWarning, match=r"not known in 3 of 100 frames \(first 40\)"):
        tracks, motion = remove_head_motion(recording, reference, three)
    assert not tracks.visible[40:43].any()
    assert (tracks.origin[40:43] == Origin.MISSING).all()
    assert tracks.visible[:40, 5:].all()
    # Three markers on the forehead: noisier, but not wrong.
    assert pose_errors(motion, turns, shifts)[0] < 0.3


@pytest.mark.parametrize("pattern", [[], [0], [1, 4]])
def test_the_covariance_is_that_of_repeated_measurements(rng, pattern):
    noise, frames = 0.1, 20_000
    recording, reference, turns, shifts = moving_head(rng, frames=frames, noise=noise, face=1)
    gone = np.zeros((frames, 6), dtype=bool)
    gone[:, pattern] = True
    gone[: frames // 10, pattern] = False
    motion = estimate_head_motion(without(recording, gone), reference, HEAD)
    part = slice(frames // 10, None)
    # The pose's error in head coordinates: a turn about the centre, then a shift.
    turn = (turns.inv() * Rotation.from_matrix(motion.rotations)).as_rotvec()[part]
    found = motion.rotations @ motion.centre + motion.translations
    shift = turns.inv().apply(found - turns.apply(motion.centre) - shifts)[part]
    errors = np.concatenate([turn, shift], axis=1)
    measured = errors.T @ errors / len(errors)
    predicted = noise**2 * motion.covariance[-1]
    root = np.sqrt(np.diag(predicted))
    np.testing.assert_allclose(
        measured / np.outer(root, root), predicted / np.outer(root, root), atol=0.04
    )
    np.testing.assert_allclose(motion.covariance[part], motion.covariance[-1:].repeat(18_000, 0))


def test_weights_follow_the_noise_of_each_marker(rng):
    recording, reference, turns, shifts = moving_head(rng, noise=0.0)
    scale = np.ones((9, 1))
    scale[4] = 8
    positions = recording.positions + 0.1 * scale * rng.normal(size=recording.positions.shape)
    recording = recording.replace(positions=positions)
    weighted = estimate_head_motion(recording, reference, HEAD, {"bridge": 1 / 64})
    plain = estimate_rigid_transforms(SHAPE, positions[:, :5])[0]
    plain_angle = (turns.inv() * Rotation.from_matrix(plain)).magnitude()
    _, angle = pose_errors(weighted, turns, shifts)
    assert angle < 0.7 * np.degrees(np.sqrt(np.mean(plain_angle**2)))
    assert weighted.pose.provenance[-1].arguments["weights"]["bridge"] == 1 / 64


def test_a_layout_may_name_a_reference_marker_that_the_recording_lacks(rng):
    recording, reference, _, _ = moving_head(rng, frames=50)
    part = recording.select(recording.names[1:])
    with pytest.warns(MocapFitWarning, match="left out: temple_left"):
        motion = estimate_head_motion(part, reference, HEAD, dict.fromkeys(HEAD, 2.0))
    assert motion.reference_names == HEAD[1:]
    assert (motion.weights == 2.0).all()


def test_the_reference_is_the_median_of_its_frames(rng):
    recording, reference, _, _ = moving_head(rng, frames=50, noise=0.0)
    repeated = np.repeat(reference.positions, 9, axis=0)
    repeated[3] += 40
    repeated[4, 0] = np.nan
    many = reference.replace(positions=repeated, origin=None)
    one = estimate_head_motion(recording, reference, HEAD)
    other = estimate_head_motion(recording, many, HEAD)
    np.testing.assert_allclose(other.rotations, one.rotations, atol=1e-12)
    as_array = estimate_head_motion(recording, SHAPE, HEAD)
    np.testing.assert_allclose(as_array.translations, one.translations, atol=1e-12)


def test_reference_markers_are_found_among_moving_ones(rng):
    recording, reference, _, _ = moving_head(rng, frames=600, face=15)
    # Two lip markers that always move together are rigid too, but no base for a pose.
    positions = recording.positions.copy()
    positions[:, 6] = positions[:, 5] + [0, 0, 4]
    gone = rng.random((600, 20)) < 0.05
    gone[:, 2:4] = False
    gone[:, 0] = False
    recording = without(recording.replace(positions=positions), gone)
    assert find_reference_markers(recording) == HEAD
    assert len(find_reference_markers(recording, 3)) == 3
    assert set(find_reference_markers(recording, 3)) < set(HEAD)
    with pytest.warns(MocapFitWarning, match="are used: temple_left, temple_right, hinge_left"):
        found, motion = remove_head_motion(recording, reference)
    assert motion.reference_names == HEAD
    named, _ = remove_head_motion(recording, reference, HEAD)
    np.testing.assert_array_equal(found.positions, named.positions)


def test_without_a_reference_the_first_whole_frame_is_the_origin(rng):
    recording, _, _, _ = moving_head(rng, frames=300, face=8)
    with pytest.warns(MocapFitWarning, match="no reference markers are named"):
        tracks, motion = remove_head_motion(recording)
    assert set(motion.reference_names) == set(HEAD)
    np.testing.assert_allclose(motion.rotations[0], np.eye(3), atol=0.02)
    np.testing.assert_allclose(tracks.positions[0], recording.positions[0], atol=0.02 * 1200)
    heads = tracks.select(HEAD).positions
    assert np.std(heads, axis=0).max() < 0.15
    np.testing.assert_allclose(heads[0], recording.select(HEAD).positions[0], atol=0.5)


def test_a_set_that_is_rigid_as_a_whole_is_taken_without_a_warning(rng):
    recording, reference, _, _ = moving_head(rng, frames=200)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        motion = estimate_head_motion(recording.select(HEAD), reference)
    assert motion.reference_names == HEAD


def collinear(recording, reference):
    line = np.outer(np.arange(9.0), [10, 1, 0])[None]
    return recording, reference.replace(positions=line)


def coincident(recording, reference):
    return recording, reference.replace(positions=np.ones((1, 9, 3)))


def in_metres(recording, reference):
    return recording.replace(positions=recording.positions / 1000), reference


def reference_in_metres(recording, reference):
    return recording, reference.replace(positions=reference.positions / 1000)


def in_centimetres(recording, reference):
    return recording.replace(positions=recording.positions / 10), reference


def of_a_giant(recording, reference):
    return recording.replace(positions=recording.positions * 3), reference


def collapsed(recording, reference):
    return recording.replace(positions=np.zeros_like(recording.positions)), reference


def never_three(recording, reference):
    gone = np.zeros((recording.frames, 9), dtype=bool)
    gone[::3, :3] = True
    gone[1::3, 2:5] = True
    gone[2::3, [0, 1, 3]] = True
    return without(recording, gone), reference


def all_missing(recording, reference):
    return without(recording, np.ones((recording.frames, 9), dtype=bool)), reference


def other_names(recording, reference):
    return recording.replace(names=tuple(f"x{k}" for k in range(9))), reference


def unseen_in_reference(recording, reference):
    return recording, without(reference, np.arange(9)[None] < 3)


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (collinear, "do not determine the head's rotation.*on a line"),
        (coincident, "in one place"),
        (in_metres, r"0\.001 times.*recording is in metres"),
        (reference_in_metres, r"1000 times.*reference pose is in metres"),
        (in_centimetres, r"0\.1 times.*recording is in centimetres"),
        (of_a_giant, r"3 times.*same speaker"),
        (collapsed, r"all in one place in the recording.*found distances of 0 mm"),
        (never_three, r"no frame shows three.*at most 2"),
        (all_missing, "too few reference markers"),
        (other_names, "too few reference markers.*found none.*Check the marker names"),
        (unseen_in_reference, "too few reference markers.*found hinge_right, bridge"),
    ],
)
def test_impossible_references_are_refused_with_the_reason(rng, spoil, words):
    recording, reference = spoil(*moving_head(rng, frames=30, noise=0.001)[:2])
    with pytest.raises(DataError, match=words) as caught:
        remove_head_motion(recording, reference, HEAD)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("names", "weights", "words"),
    [
        (("bridge", "bridge", "hinge_left"), None, "named twice"),
        (("bridge", "hinge_left"), None, "too few"),
        (HEAD, {"bridge": -1.0}, "weight is out of range"),
        (HEAD, {"bridge": np.nan}, "weight is out of range"),
        (HEAD, {"bridge": 0.0}, "weight is out of range"),
        (HEAD, {"nose": 1.0}, "unknown marker.*nose"),
    ],
)
def test_impossible_calls_are_refused(rng, names, weights, words):
    recording, reference, _, _ = moving_head(rng, frames=30)
    with pytest.raises(DataError, match=words):
        estimate_head_motion(recording, reference, names, weights)


def test_a_mirrored_recording_is_noticed(rng):
    shape = np.array([[60.0, 5, 0], [-55, 10, 8], [20, 50, 35], [-15, -30, 45], [10, 20, -60]])
    recording = MarkerTracks(HEAD, RATE, shape + 0.1 * rng.normal(size=(30, 5, 3)))
    mirrored = recording.replace(positions=recording.positions * [1, 1, -1])
    with pytest.warns(MocapFitWarning, match=r"do not keep the shape.*mirrored"):
        estimate_head_motion(mirrored, shape, HEAD)
    # Spectacles are almost flat, and the mirrored frame fits without the bridge.
    recording, reference, _, _ = moving_head(rng, frames=30)
    mirrored = recording.replace(positions=recording.positions * [1, 1, -1])
    with pytest.warns(MocapFitWarning, match="left out: bridge"):
        estimate_head_motion(mirrored, reference, HEAD)


def test_one_frame_is_enough_for_a_pose(rng):
    recording, reference, turns, shifts = moving_head(rng, frames=1)
    motion = estimate_head_motion(recording, reference, HEAD)
    assert pose_errors(motion, turns, shifts)[0] < 0.5


def test_a_reference_of_the_wrong_shape_is_refused(rng):
    recording, reference, _, _ = moving_head(rng, frames=30)
    with pytest.raises(DataError, match="wrong shape"):
        estimate_head_motion(recording, SHAPE)
    with pytest.raises(DataError, match="share too few"):
        estimate_head_motion(recording, reference.select(["bridge", "face_0"]))


def test_reference_markers_cannot_be_found_where_there_is_too_little(rng):
    recording, _, _, _ = moving_head(rng, frames=30)
    with pytest.raises(DataError, match="so short a recording"):
        find_reference_markers(recording.between(0.1, 0.2))
    with pytest.raises(DataError, match="expected 3"):
        find_reference_markers(recording, 2)
    with pytest.raises(DataError, match="seen often enough"):
        find_reference_markers(recording.select(["bridge", "face_0"]))
    with pytest.raises(DataError, match="seen often enough"):
        find_reference_markers(recording, 10)
    line = np.outer(np.arange(5.0), [10, 1, 0]) + rng.normal(size=(30, 1, 3))
    with pytest.raises(DataError, match="on a line"):
        find_reference_markers(MarkerTracks(tuple("abcde"), 60, line))


@pytest.mark.real_data
@pytest.mark.parametrize("body", ["Upper Leg IMU", "Foot IMU", "Lower Leg IMU"])
def test_the_pose_agrees_with_that_of_qtm(data_folder, body):
    """QTM's own pose of three rigid bodies is independent truth."""
    recording = read_tracks(data_folder / "qualisys" / "qtm2010_3d_no_title_row.tsv")
    poses = read_poses(data_folder / "qualisys" / "qtm2010_6d_bodies.tsv")
    index = poses.index(body)
    rotations, origins = poses.rotations[:, index], poses.translations[:, index]
    names = [f"{body} - {k}" for k in (1, 2, 3)]
    motion = estimate_head_motion(recording, recording.select(names).positions[0], names)
    assert motion.known.all()
    relative = rotations @ rotations[0].T
    angles = (
        Rotation.from_matrix(motion.rotations).inv() * Rotation.from_matrix(relative)
    ).magnitude()
    carried = motion.rotations @ origins[0] + motion.translations
    distances = np.linalg.norm(carried - origins, axis=1)
    print(f"{body}: {np.degrees(angles.max()):.4f} degrees, {distances.max():.4f} mm at most")
    assert np.degrees(angles.max()) < 0.01
    assert distances.max() < 0.005


@pytest.mark.real_data
def test_the_head_markers_of_the_body_recording_are_rigid(data_folder):
    recording = read_tracks(data_folder / "c3d" / "qtm2017_body_with_head_markers.c3d")
    names = [n for n in recording.names if n.endswith(("L_HDF", "L_HDB", "R_HDF", "R_HDB"))]
    tracks, motion = remove_head_motion(recording, names=names)
    print(motion)
    assert len(names) == 4
    assert motion.known.all()
    assert np.median(motion.residuals) < 0.7
    assert motion.residuals.max() < 1.6
    back = restore_head_motion(tracks, motion)
    np.testing.assert_allclose(back.positions, recording.positions, atol=1e-9)


@pytest.mark.real_data
def test_the_reference_points_of_grid_are_fairly_rigid(data_folder):
    folder = data_folder / "grid_s1"
    reference = read_tracks(folder / "reference.tsv")
    names = [name for name in reference.names if name.startswith("ref_")]
    assert len(names) == 6
    residuals, rejected = [], 0
    for path in sorted((folder / "tsv").glob("*.tsv"))[::20]:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", MocapFitWarning)
            motion = estimate_head_motion(read_tracks(path), reference, names)
        residuals.append(motion.residuals)
        rejected += int(motion.rejected.any(axis=1).sum())
    pooled = np.concatenate(residuals)
    print(
        f"{len(pooled)} frames: residual {np.nanmedian(pooled):.2f} mm (median), "
        f"{np.nanmax(pooled):.2f} mm (largest), {rejected} with a point left out"
    )
    assert np.nanmedian(pooled) < 1.5
    assert rejected < 0.01 * len(pooled)


@pytest.mark.parametrize("factor", [0.87, 1.0, 1.13])
def test_size_is_matched(rng, factor):
    recording, reference, *_ = moving_head(rng, frames=60, noise=0.0)
    larger = recording.replace(positions=recording.positions * factor)
    matched, found = match_size(larger, reference, HEAD)
    assert found == pytest.approx(factor, rel=1e-9)
    np.testing.assert_allclose(matched.positions, recording.positions, atol=1e-9)
    assert matched.provenance[-1].name == "match_size"


def test_size_is_matched_from_what_is_seen(rng):
    recording, reference, *_ = moving_head(rng, frames=60, noise=0.0)
    positions = 1.1 * recording.positions
    positions[rng.random(positions.shape[:2]) < 0.3] = np.nan
    _, found = match_size(recording.replace(positions=positions, origin=None), reference, HEAD)
    assert found == pytest.approx(1.1, rel=1e-9)


def test_size_is_not_matched_across_units(rng):
    recording, reference, *_ = moving_head(rng, frames=60)
    with pytest.raises(DataError, match="size"):
        match_size(recording.replace(positions=recording.positions / 1000), reference, HEAD)
