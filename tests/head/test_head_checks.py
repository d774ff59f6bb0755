"""What the checks of the reference markers say, at their limits, and where warnings point."""

import warnings

import numpy as np
import pytest

from mocap_fit.errors import DataError, MocapFitWarning
from mocap_fit.head import (
    estimate_head_motion,
    match_size,
    remove_head_motion,
    restore_head_motion,
)
from mocap_fit.head.reference import check_reference_markers, check_sizes
from mocap_fit.tracks import MarkerTracks, Origin

NAMES = ("left", "right", "top", "front", "chin")
SHAPE = np.array([[-70.0, 0, -60], [70, 0, -60], [0, 60, 5], [10, -20, 55], [0, -90, 40]])
HEAD = NAMES[:4]


def take(positions=None, frames=12, names=NAMES, **changes) -> MarkerTracks:
    if positions is None:
        positions = np.repeat(SHAPE[None], frames, axis=0)
    return MarkerTracks(names, 60.0, positions, **changes)


@pytest.mark.parametrize(
    ("factor", "says"),
    [
        (0.49, "same speaker and in millimetres"),
        (1 / 3, "same speaker and in millimetres"),
        (0.1, "the recording is in centimetres"),
        (0.01, "the recording is in decimetres"),
        (0.001, "the recording is in metres"),
        (1e-4, "same speaker and in millimetres"),
        (2.01, "same speaker and in millimetres"),
        (10.0, "the reference pose is in centimetres"),
        (100.0, "the reference pose is in decimetres"),
        (1000.0, "the reference pose is in metres"),
    ],
)
def test_another_unit_is_named(factor, says):
    with pytest.raises(DataError, match="differ in size") as caught:
        estimate_head_motion(take(factor * np.repeat(SHAPE[None], 3, axis=0)), SHAPE[:4], HEAD)
    assert says in caught.value.advice
    assert caught.value.found.startswith(f"distances in the recording are {factor:.4g} times")


@pytest.mark.filterwarnings("ignore::mocap_fit.errors.MocapFitWarning")
@pytest.mark.parametrize("factor", [0.5, 0.51, 1.99, 2.0])
def test_half_and_double_the_size_are_taken(factor):
    recording = take(factor * np.repeat(SHAPE[None], 3, axis=0))
    estimate_head_motion(recording, SHAPE[:4], HEAD)


@pytest.mark.parametrize(("error", "warns"), [(0.095, False), (0.105, True)])
def test_a_tenth_of_the_length_is_another_shape(error, warns):
    """Of a set that is nearly a line, which is larger than the reference pose by the error."""
    shape = np.array([[-100.0, 0, 0], [100, 0, 0], [0, 20, 0]])
    recording = take((1 + error) * np.repeat(shape[None], 4, axis=0), names=NAMES[:3])
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        motion = estimate_head_motion(recording, shape, NAMES[:3])
    assert bool(caught) is warns
    size = np.sqrt(np.mean(np.sum((shape - shape.mean(axis=0)) ** 2, axis=1)))
    np.testing.assert_allclose(motion.residuals, error * size, rtol=1e-6)


@pytest.mark.parametrize(("frames_off", "warns"), [(30, False), (31, True)])
def test_a_marker_that_is_off_in_most_frames_is_named(rng, frames_off, warns):
    positions = np.repeat(SHAPE[None], 60, axis=0) + rng.normal(0.0, 0.05, (60, 5, 3))
    positions[:frames_off, 1] += [0.0, 60.0, 0.0]
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        motion = estimate_head_motion(take(positions), np.delete(SHAPE, 4, 0), HEAD)
    assert motion.rejected[:, 1].sum() == frames_off
    assert [str(w.message) for w in caught] == (
        [
            "reference markers are not where the reference pose has them and are left out: right "
            "(31 of 60 frames)"
        ]
        if warns
        else []
    )


@pytest.mark.parametrize(
    "change", ["chosen", "left out", "moved", "shape", "pose unknown", "restored"]
)
def test_warnings_point_to_the_line_that_called(rng, change):
    positions = np.repeat(SHAPE[None], 60, axis=0) + rng.normal(0.0, 0.05, (60, 5, 3))
    reference, names = take(), HEAD
    if change == "chosen":
        positions[:, 4] += rng.normal(0.0, 10.0, (60, 3))
        names = None
    if change == "left out":
        names = (*HEAD, "unseen")
    if change == "moved":
        positions[:, 1] += [0.0, 60.0, 0.0]
    if change == "shape":
        positions *= 1.3
    if change in ("pose unknown", "restored"):
        positions[5, :3] = np.nan
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        still, motion = remove_head_motion(take(positions), reference, names)
    if change == "restored":
        still = still.replace(positions=SHAPE + np.zeros((60, 1, 1)), origin=None)
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            restore_head_motion(still, motion)
    assert caught
    for warning in caught:
        assert issubclass(warning.category, MocapFitWarning)
        assert warning.filename == __file__


def test_frames_without_a_pose_are_counted_and_missing(rng):
    positions = np.repeat(SHAPE[None], 10, axis=0) + rng.normal(0.0, 0.05, (10, 5, 3))
    positions[[3, 7], :2] = np.nan
    positions[8] = np.nan  # nothing is lost there
    recording = take(positions)
    with pytest.warns(MocapFitWarning, match=r"not known in 2 of 10 frames \(first 3\)"):
        still, motion = remove_head_motion(recording, take(), HEAD)
    known = np.array([f not in (3, 7, 8) for f in range(10)])
    np.testing.assert_array_equal(motion.known, known)
    np.testing.assert_array_equal(still.visible, known[:, None] & recording.visible)
    assert (still.origin[~known] == Origin.MISSING).all()
    assert np.isnan(motion.covariance[~known]).all()
    assert np.isfinite(motion.covariance[known]).all()


def test_what_was_removed_is_in_the_provenance():
    weights = {"top": 2.0, "chin": 3.0}
    still, motion = remove_head_motion(take(), take(), HEAD, weights)
    expected = {
        "reference_markers": list(HEAD),
        "weights": {"left": 1.0, "right": 1.0, "top": 2.0, "front": 1.0},
    }
    assert still.provenance[-1].name == "remove_head_motion"
    assert still.provenance[-1].arguments == expected
    assert motion.pose.provenance[-1].arguments == expected
    np.testing.assert_array_equal(motion.weights, np.tile([1.0, 1, 2, 1], (12, 1)))
    back = restore_head_motion(still, motion)
    assert back.provenance[-1].arguments == {"reference_markers": list(HEAD)}


def test_two_markers_are_enough_to_match_a_size():
    matched, factor = match_size(take(1.2 * np.repeat(SHAPE[None], 2, axis=0)), take(), NAMES[:3])
    assert factor == pytest.approx(1.2)
    gone = 1.2 * np.repeat(SHAPE[None], 3, axis=0)
    gone[0, 1:3] = np.nan  # one marker tells no size
    gone[1, 0] = gone[2, 2] = np.nan
    matched, factor = match_size(take(gone), take(), NAMES[:3])
    assert factor == pytest.approx(1.2)
    np.testing.assert_allclose(matched.positions[2, 0], SHAPE[0])


def test_a_size_needs_two_markers_together():
    apart = np.full((3, 5, 3), np.nan)
    apart[range(3), range(3)] = SHAPE[:3]
    with pytest.raises(DataError, match="no frame shows two") as caught:
        match_size(take(apart), take(), NAMES[:3])
    assert caught.value.expected == "two or more of left, right, top"


def test_the_repr_tells_what_happened(rng):
    positions = np.repeat(SHAPE[None], 60, axis=0) + rng.normal(0.0, 0.05, (60, 5, 3))
    positions[10:31, 1] += [0.0, 60.0, 0.0]
    positions[50, :2] = np.nan
    motion = estimate_head_motion(take(positions), take(), (*HEAD, "chin"))
    frames = np.flatnonzero(motion.rejected[:, 1])
    assert set(range(10, 31)) <= set(frames.tolist())
    lines = repr(motion).splitlines()
    middle, worst = np.nanmedian(motion.residuals), np.nanmax(motion.residuals)
    assert lines[0] == (
        f"HeadMotion: pose known in 60 of 60 frames, residual {middle:.3g} mm (median), "
        f"{worst:.3g} mm (largest)"
    )
    of_right = np.nanmedian(motion.marker_residuals[:, 1])
    assert lines[2] == (
        f"  right: {of_right:.3g} mm (median); left out in {len(frames)} frames, "
        f"first {frames[0]}, last {frames[-1]}"
    )
    assert len(lines) == 6


def test_names_that_the_recording_lacks_make_no_reference():
    with pytest.raises(DataError, match="too few reference markers") as caught:
        estimate_head_motion(take(), names=("one", "other", "third"))
    assert "one" in str(caught.value)


def test_one_pair_of_markers_tells_another_unit():
    """Wherever the two stand among the names."""
    for pair in ((0, 1), (1, 2), (0, 2)):
        positions = np.full((2, 3, 3), np.nan)
        positions[:, pair] = SHAPE[list(pair)] / 10
        with pytest.raises(DataError, match="differ in size") as caught:
            check_sizes(NAMES[:3], SHAPE[:3], positions)
        assert "the recording is in centimetres" in caught.value.advice
    check_sizes(NAMES[:3], SHAPE[:3], np.full((2, 3, 3), np.nan))


def test_markers_in_one_place_are_no_question_of_units():
    with pytest.raises(DataError, match="all in one place") as caught:
        check_sizes(NAMES[:3], SHAPE[:3], np.zeros((2, 3, 3)))
    apart = np.median([np.linalg.norm(SHAPE[i] - SHAPE[j]) for i, j in ((0, 1), (0, 2), (1, 2))])
    assert caught.value.expected == f"about {apart:.3g} mm, as in the reference pose"


def test_three_markers_that_both_have_are_enough():
    reference = take(names=("left", "right", "top", "brow", "jaw"))
    motion = estimate_head_motion(take(), reference)
    assert motion.reference_names == NAMES[:3]
    with pytest.raises(DataError, match="share too few markers") as caught:
        estimate_head_motion(take(), take(names=("left", "right", "crown", "brow", "jaw")))
    assert caught.value.found == "left, right"


def test_no_frame_shows_no_marker():
    with pytest.raises(DataError, match="no frame shows three reference markers") as caught:
        check_reference_markers(NAMES[:3], SHAPE[:3], np.zeros((0, 3, 3)))
    assert caught.value.found == "at most 0"
    two = np.full((4, 3, 3), np.nan)
    two[:, :2] = SHAPE[:2]
    with pytest.raises(DataError, match="no frame shows three reference markers") as caught:
        check_reference_markers(NAMES[:3], SHAPE[:3], two)
    assert caught.value.found == "at most 2"
