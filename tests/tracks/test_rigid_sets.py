import numpy as np
import pytest
from scipy import stats
from scipy.spatial.distance import pdist, squareform
from scipy.spatial.transform import Rotation

from mocap_fit.errors import DataError
from mocap_fit.tracks import MarkerTracks
from mocap_fit.tracks.rigid import apply_transforms, compute_spread, estimate_rigid_transforms
from mocap_fit.tracks.rigid_sets import (
    _average_shape,
    _Candidates,
    _measure_distance_changes,
    compute_mean_shape,
    compute_median,
    compute_typical_shape,
    find_reference_markers,
)

SHAPE = np.array([[-70.0, 0, -60], [70, 0, -60], [-60, 25, 5], [60, 25, 5], [0, -20, 25]])


def moving(rng, frames=200, noise=0.0, shape=SHAPE):
    turns = Rotation.from_rotvec(0.3 * rng.normal(size=(frames, 3))).as_matrix()
    points = np.einsum("fij,pj->fpi", turns, shape) + 20 * rng.normal(size=(frames, 1, 3))
    return points + noise * rng.normal(size=points.shape)


def test_the_median_leaves_out_what_is_missing(rng):
    values = rng.normal(size=(9, 2, 3))
    values[4:, 0] = np.nan
    values[:, 1, 2] = np.nan
    result = compute_median(values)
    np.testing.assert_allclose(result[0], np.median(values[:4, 0], axis=0))
    np.testing.assert_allclose(result[1, :2], np.median(values[:, 1, :2], axis=0))
    assert np.isnan(result[1, 2])


def test_the_mean_shape_is_where_the_first_complete_frame_has_it(rng):
    positions = moving(rng)
    positions[0, 2] = np.nan
    np.testing.assert_allclose(compute_mean_shape(positions), positions[1], atol=1e-9)


def test_the_mean_shape_is_better_than_a_frame_and_is_not_drawn_by_a_wild_one(rng):
    positions = moving(rng, noise=0.5)
    positions[5, 0] += 400
    shape = compute_mean_shape(positions)
    one = np.abs(pdist(positions[0]) - pdist(SHAPE)).max()
    assert np.abs(pdist(shape) - pdist(SHAPE)).max() < 0.15 < one
    np.testing.assert_allclose(shape.mean(axis=0), positions[0].mean(axis=0), atol=1.0)


def test_the_mean_shape_needs_a_complete_frame_and_takes_a_line_as_it_is(rng):
    positions = moving(rng, frames=4)
    positions[:, 0] = np.nan
    with pytest.raises(DataError, match="no frame shows all markers"):
        compute_mean_shape(positions)
    line = np.outer(np.arange(4.0), [1, 2, 3]) + np.zeros((3, 1, 1))
    np.testing.assert_array_equal(compute_mean_shape(line), line[0])


def test_the_typical_shape_needs_no_complete_frame(rng):
    positions = moving(rng, noise=0.3)
    hidden = np.arange(len(positions)) % 5
    positions[np.arange(len(positions)), hidden] = np.nan
    positions[:, [4]] = np.where(hidden[:, None, None] == 3, np.nan, positions[:, [4]])
    shape = compute_typical_shape(positions)
    assert np.abs(pdist(shape) - pdist(SHAPE)).max() < 0.15
    positions[:, 1] = np.nan
    shape = compute_typical_shape(positions)
    assert np.isnan(shape[1]).all()
    assert np.abs(pdist(np.delete(shape, 1, 0)) - pdist(np.delete(SHAPE, 1, 0))).max() < 0.15


def recording(rng, frames=300, loose=8, noise=0.1, still=SHAPE):
    """A rigid set, and markers on a face that moves on it, millimetres."""
    face = rng.uniform(-40, 40, size=(loose, 3))
    shape = np.concatenate([still, face])
    points = moving(rng, frames, noise, shape)
    points[:, len(still) :] += 2 * rng.normal(size=(frames, loose, 3))
    names = tuple(f"h{k}" for k in range(len(still))) + tuple(f"f{k}" for k in range(loose))
    order = rng.permutation(len(names))
    return MarkerTracks(tuple(names[k] for k in order), 60, points[:, order])


@pytest.mark.parametrize("loose", [8, 60])
def test_reference_markers_are_those_that_keep_their_distances(rng, loose):
    tracks = recording(rng, loose=loose)
    rigid = tuple(name for name in tracks.names if name.startswith("h"))
    assert find_reference_markers(tracks) == rigid
    assert find_reference_markers(tracks, 5) == rigid
    three = find_reference_markers(tracks, 3)
    assert len(three) == 3
    assert set(three) < set(rigid)


def test_wide_sets_come_before_narrow_ones_that_are_as_rigid(rng):
    """Three neighbours keep their distances too, and determine no turn."""
    narrow = np.array([[0.0, 0, 80], [4, 0, 80], [0, 4, 80]])
    tracks = recording(rng, still=np.concatenate([SHAPE[:3], narrow]))
    assert set(find_reference_markers(tracks, 3)) == {"h0", "h1", "h2"}


def test_a_triple_that_is_more_rigid_than_the_head_is_not_grown_from(rng):
    """Three markers on a jaw keep their distances best, but no fourth does with them."""
    tracks = recording(rng, noise=0.3)
    positions = tracks.positions.copy()
    jaw = [tracks.index(f"f{k}") for k in range(3)]
    chin = np.array([[-20.0, -60, 50], [20, -60, 50], [0, -60, 20]])
    turns, shifts = estimate_rigid_transforms(
        SHAPE, tracks.select([f"h{k}" for k in range(5)]).positions
    )[:2]
    opening = 5 * rng.normal(size=(tracks.frames, 1, 3))
    positions[:, jaw] = apply_transforms(chin + opening, turns, shifts)
    tracks = tracks.replace(positions=positions)
    assert set(find_reference_markers(tracks, 3)) == {"f0", "f1", "f2"}
    assert set(find_reference_markers(tracks, 4)) < {f"h{k}" for k in range(5)}


def test_changes_of_distances_are_between_their_quantiles(rng):
    positions = recording(rng, frames=100).positions
    distances = np.array([pdist(frame) for frame in positions])
    low, high = np.quantile(distances, (0.05, 0.95), axis=0)
    # Gaussian noise has 90 % within 3.29 standard deviations.
    expected = squareform((high - low) / (2 * stats.norm.ppf(0.95)))
    np.testing.assert_allclose(_measure_distance_changes(positions), expected, rtol=1e-3)


@pytest.mark.parametrize(("noise", "joins"), [(0.15, True), (0.25, False)])
def test_markers_join_that_keep_their_distances_half_as_well_again(rng, noise, joins):
    """Distances of the four change by 0.14 mm, those to the fifth by 0.18 or 0.27 mm."""
    tracks = recording(rng, frames=1000)
    positions = tracks.positions.copy()
    fifth = positions[:, tracks.index("h4")]
    fifth += np.sqrt(noise**2 - 0.1**2) * rng.normal(size=fifth.shape)
    chosen = find_reference_markers(tracks.replace(positions=positions))
    assert set(chosen) == {"h0", "h1", "h2", "h3"} | ({"h4"} if joins else set())


def test_markers_that_are_seldom_seen_are_not_considered(rng):
    tracks = recording(rng)
    positions = tracks.positions.copy()
    positions[: tracks.frames // 2 + 1, tracks.index("h0")] = np.nan
    positions[: tracks.frames // 2, tracks.index("h1")] = np.nan
    chosen = find_reference_markers(tracks.replace(positions=positions, origin=None))
    assert set(chosen) == {"h1", "h2", "h3", "h4"}


def test_too_little_to_choose_from_is_refused(rng):
    tracks = recording(rng, frames=30)
    first = tracks.between(0, 10 / 60)
    assert first.frames == 10
    assert len(find_reference_markers(first)) >= 4
    with pytest.raises(DataError, match="9 frames, expected 10 or more"):
        find_reference_markers(tracks.between(0, 9 / 60))
    with pytest.raises(DataError, match=r"too few reference markers are asked for \(found 2"):
        find_reference_markers(tracks, 2)
    with pytest.raises(DataError, match="expected 14 that are seen"):
        find_reference_markers(tracks, 14)
    three = tracks.select(tracks.names[:3])
    assert find_reference_markers(three) == three.names
    with pytest.raises(DataError, match="expected 4 that are seen"):
        find_reference_markers(tracks.select(tracks.names[:2]))


def test_every_frame_of_a_short_recording_counts(rng):
    wild = moving(rng, frames=3)
    wild[0] += 3 * rng.normal(size=(5, 3))
    np.testing.assert_allclose(pdist(compute_mean_shape(wild)), pdist(SHAPE), atol=1e-6)
    two = moving(rng, frames=2)
    two[0, 1] = np.nan
    np.testing.assert_allclose(pdist(compute_typical_shape(two)), pdist(SHAPE), atol=1e-6)


def test_the_cost_of_a_set_is_its_change_times_how_narrow_it_is(rng):
    """Root mean square of the changes; sets of less than half the width of all cost more."""
    positions = recording(rng).positions
    candidates = _Candidates(positions)
    spreads = [compute_spread(candidates.shape[list(chosen)])[1] for chosen in (range(3), range(5))]
    reach = compute_spread(candidates.shape)[1]
    for chosen, width in zip(([0, 1, 2], [0, 1, 2, 3, 4]), spreads, strict=True):
        changes = candidates.changes[np.ix_(chosen, chosen)][np.triu_indices(len(chosen), 1)]
        expected = np.sqrt(np.mean(changes**2)) * max(1.0, 0.5 * reach / width)
        assert candidates.cost(np.array([chosen]))[0] == pytest.approx(expected)
    # A tenth of a millimetre is narrow too, and a line is no set.
    tiny = np.array([[0.0, 0, 0], [0.3, 0, 0], [0, 0.1, 0], [0.6, 0, 0], [40, 80, 9]])
    candidates = _Candidates(tiny + 0.01 * rng.normal(size=(200, 5, 3)))
    candidates.shape = tiny
    width = compute_spread(tiny[:3])[1]
    changes = candidates.changes[[0, 0, 1], [1, 2, 2]]
    expected = np.sqrt(np.mean(changes**2)) * 0.5 * candidates.reach / width
    costs = candidates.cost(np.array([[0, 1, 2], [0, 1, 3]]))
    assert costs.tolist() == [pytest.approx(expected), np.inf]


def test_a_marker_that_the_fullest_frame_lacks_stands_at_its_mean_offset():
    """Of two that are never seen together, each pulls the centre by its part of the rest."""
    shape = np.concatenate([SHAPE, [[0.0, 60, 0]]])
    positions = np.arange(6.0)[:, None, None] * [5, 0, -3] + shape
    positions[:3, 1], positions[3:, 5] = np.nan, np.nan
    expected = shape.copy()
    expected[1] += (shape[5] - shape[1]) / 5
    np.testing.assert_allclose(_average_shape(positions), expected, atol=1e-9)


def test_a_distance_that_is_measured_four_times_is_unknown(rng):
    positions = recording(rng, frames=60).positions.copy()
    positions[4:, 0], positions[5:, 1] = np.nan, np.nan
    changes = _measure_distance_changes(positions)
    assert np.isinf(changes[0, 1:]).all()
    assert np.isfinite(np.delete(changes[1], 0)).all()


def test_markers_that_are_never_seen_together_are_no_reference():
    """The first is seen in the first half, the others in the second one."""
    positions = np.tile(SHAPE[:4], (20, 1, 1))
    positions[10:, 0], positions[:10, 1:] = np.nan, np.nan
    tracks = MarkerTracks(("a", "b", "c", "d"), 60, positions)
    assert find_reference_markers(tracks, 3) == ("b", "c", "d")
    with pytest.raises(DataError, match="seen together lie on a line"):
        find_reference_markers(tracks.select(["a", "b", "c"]))


@pytest.mark.parametrize(
    ("compute", "frames"), [(compute_mean_shape, 2000), (compute_typical_shape, 800)]
)
def test_of_long_recordings_every_second_frame_has_a_say(rng, compute, frames):
    """A shape has a thousand frames, or four hundred where some markers are missing."""
    positions = moving(rng, frames=frames)
    positions[1::2] += 30 * rng.normal(size=(frames // 2, 5, 3))
    np.testing.assert_allclose(pdist(compute(positions)), pdist(SHAPE), atol=1e-6)


def test_reference_markers_are_sought_in_a_thousand_frames(rng):
    tracks = recording(rng, frames=2000)
    positions = tracks.positions.copy()
    positions[1::2] += 30 * rng.normal(size=(1000, len(tracks.names), 3))
    chosen = find_reference_markers(tracks.replace(positions=positions), 5)
    assert chosen == tuple(name for name in tracks.names if name.startswith("h"))


@pytest.mark.parametrize(
    ("compute", "rounds"), [(compute_mean_shape, 5), (compute_typical_shape, 4)]
)
def test_shapes_are_medians_of_frames_laid_on_them_a_few_times(rng, compute, rounds):
    """By scipy's rotations: each round lays the frames on the median of the round before."""
    positions = moving(rng, frames=60, noise=0.5)
    if compute is compute_typical_shape:
        positions[np.arange(1, 60), rng.integers(5, size=59)] = np.nan
    shape = positions[0]
    for _ in range(rounds):
        laid = np.full(positions.shape, np.nan)
        for frame, points in enumerate(positions):
            seen = ~np.isnan(points[:, 0])
            middle, goal = points[seen].mean(axis=0), shape[seen].mean(axis=0)
            turn = Rotation.align_vectors(shape[seen] - goal, points[seen] - middle)[0]
            laid[frame, seen] = turn.apply(points[seen] - middle) + goal
        shape = np.nanmedian(laid, axis=0)
    np.testing.assert_allclose(pdist(compute(positions)), pdist(shape), rtol=0, atol=1e-9)


def test_every_frame_of_a_short_recording_tells_which_markers_move(rng):
    """Two of the head's markers move in every second frame alone, and so are none of its set."""
    tracks = recording(rng, frames=30)
    positions = tracks.positions.copy()
    for name in ("h0", "h1"):
        positions[1::2, tracks.index(name)] += 5 * rng.normal(size=(15, 3))
    chosen = find_reference_markers(tracks.replace(positions=positions), 3)
    assert set(chosen) == {"h2", "h3", "h4"}
