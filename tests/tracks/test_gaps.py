import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from mocap_fit.errors import DataError
from mocap_fit.tracks import MarkerTracks, Origin, count_gaps, fill_gaps

RATE = 100.0


def waving(frames=300, markers=2, frequency=1.5) -> MarkerTracks:
    times = np.arange(frames)[:, None, None] / RATE
    phases = np.arange(markers)[:, None] + np.arange(3)
    names = tuple(f"m{k}" for k in range(markers))
    return MarkerTracks(names, RATE, 10 * np.sin(2 * np.pi * frequency * times + phases))


def without(tracks: MarkerTracks, *holes) -> MarkerTracks:
    positions = tracks.positions.copy()
    for marker, first, last in holes:
        positions[first:last, marker] = np.nan
    return tracks.replace(positions=positions, origin=None)


def test_the_report_counts_gaps_frames_and_ends():
    report = count_gaps(without(waving(100), (0, 0, 5), (0, 20, 21), (0, 50, 60), (1, 97, 100)))
    first, second = report.markers
    assert (first.name, first.gaps, first.missing, first.longest, first.at_ends) == (
        "m0",
        3,
        16,
        10,
        5,
    )
    assert first.longest_seconds == pytest.approx(0.1)
    assert (second.gaps, second.missing, second.at_ends, second.share) == (1, 3, 3, 0.03)
    assert report.share == pytest.approx(19 / 200)
    assert report.to_frame()["missing"].tolist() == [16, 3]
    text = str(report)
    assert "100 frames at 100 Hz, 2 markers, 9.50%" in text
    assert "0.100 s" in text
    assert "m1" in text


def test_a_marker_that_is_never_seen_is_one_gap():
    marker = count_gaps(without(waving(50), (1, 0, 50))).markers[1]
    assert (marker.gaps, marker.missing, marker.share, marker.at_ends) == (1, 50, 1.0, 50)
    assert "m1" not in str(count_gaps(waving(50)))


@pytest.mark.parametrize(("method", "bound"), [("pchip", 0.12), ("linear", 0.25)])
def test_short_gaps_are_filled_near_the_truth_and_marked(method, bound):
    truth = waving(frequency=0.7)
    filled = fill_gaps(without(truth, (0, 100, 108), (1, 50, 51)), method, 0.08)
    assert np.abs(filled.positions - truth.positions).max() < bound
    assert (filled.origin == Origin.FILLED).sum() == 9
    assert (filled.origin[100:108, 0] == Origin.FILLED).all()
    step = filled.provenance[-1]
    assert (step.name, dict(step.arguments)) == (
        "fill_gaps",
        {"method": method, "maximum_gap": 0.08},
    )


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(0, 12), st.sampled_from(["pchip", "linear"]))
def test_nothing_but_short_inner_gaps_changes(seed, longest, method):
    rng = np.random.default_rng(seed)
    positions = waving(120).positions.copy()
    positions[rng.random((120, 2)) < rng.uniform(0, 0.9, size=2)] = np.nan
    tracks = MarkerTracks(("a", "b"), RATE, positions)
    filled = fill_gaps(tracks, method, longest / RATE)
    seen = tracks.visible
    np.testing.assert_array_equal(filled.positions[seen], positions[seen])
    for marker in range(2):
        there = np.flatnonzero(seen[:, marker])
        for frame in np.flatnonzero(~seen[:, marker]):
            before, after = there[there < frame], there[there > frame]
            short = len(before) and len(after) and after[0] - before[-1] - 1 <= longest
            assert filled.visible[frame, marker] == bool(short)
            if short:
                edges = positions[[before[-1], after[0]], marker]
                inside = filled.positions[frame, marker]
                # Neither method overshoots its neighbours.
                assert (inside >= edges.min(axis=0) - 1e-9).all()
                assert (inside <= edges.max(axis=0) + 1e-9).all()


def head(rng, frames=400, noise=0.0, markers=5) -> MarkerTracks:
    times = np.arange(frames)[:, None] / RATE
    turns = Rotation.from_euler("xyz", 20 * np.sin(times * [5, 7, 11]), degrees=True).as_matrix()
    shifts = 30 * np.sin(times * [3, 4, 6])
    shape = rng.normal(size=(markers, 3)) * [60, 40, 30]
    points = np.einsum("fij,pj->fpi", turns, shape) + shifts[:, None]
    points += noise * rng.normal(size=points.shape)
    return MarkerTracks(tuple(f"h{k}" for k in range(markers)), RATE, points)


def test_rigid_filling_knows_how_the_head_moved_in_a_long_gap(rng):
    truth = head(rng)
    gappy = without(truth, (2, 100, 250), (0, 120, 130))
    filled = fill_gaps(gappy, "rigid", 2.0, truth.names)
    np.testing.assert_allclose(filled.positions, truth.positions, atol=1e-8)
    assert (filled.origin == Origin.FILLED).sum() == 160
    interpolated = fill_gaps(gappy, "pchip", 2.0)
    assert np.nanmax(np.abs(interpolated.positions - truth.positions)) > 10


def test_rigid_filling_is_led_into_the_samples_at_the_edges(rng):
    truth = head(rng, noise=0.0)
    # The marker sits half a millimetre off since frame 150, as on skin.
    slipped = truth.positions.copy()
    slipped[150:, 1] += [0.5, 0, 0]
    gappy = without(truth.replace(positions=slipped), (1, 200, 220))
    filled = fill_gaps(gappy, "rigid", 1.0, truth.names)
    assert np.abs(filled.positions - slipped)[200:220].max() < 0.1


def test_rigid_filling_needs_three_others_and_stops_at_the_ends(rng):
    truth = head(rng, markers=4)
    gappy = without(truth, (0, 50, 60), (1, 55, 57), (2, 0, 5), (3, 395, 400))
    filled = fill_gaps(gappy, "rigid", 1.0, truth.names)
    assert filled.visible[50:60, 0].tolist() == [True] * 5 + [False] * 2 + [True] * 3
    assert not filled.visible[:5, 2].any()
    assert not filled.visible[395:, 3].any()
    assert (filled.origin[55:57, 1] == Origin.MISSING).all()


def test_rigid_filling_leaves_other_markers_alone(rng):
    truth = head(rng, markers=6)
    filled = fill_gaps(without(truth, (5, 10, 12), (0, 10, 12)), "rigid", 1.0, truth.names[:5])
    assert filled.visible[10:12, 0].all()
    assert not filled.visible[10:12, 5].any()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("spline",), "no method 'spline'"),
        (("pchip", -1.0), "maximum gap"),
        (("pchip", np.nan), "maximum gap"),
        (("rigid", 0.1), "needs a rigid set"),
        (("pchip", 0.1, ["m0"]), "needs a rigid set"),
        (("rigid", 0.1, ["m0", "m1", "m2"]), "three markers besides"),
        (("rigid", 0.1, ["m0", "m1", "m2", "m2"]), "three markers besides"),
        (("rigid", 0.1, ["m0", "m1", "m2", "nose"]), "no marker 'nose'"),
    ],
)
def test_calls_that_make_no_sense_are_refused(arguments, words):
    with pytest.raises(DataError, match=words):
        fill_gaps(waving(markers=4), *arguments)


def test_rigid_sets_on_a_line_or_never_whole_are_refused(rng):
    line = np.outer(np.arange(4.0), [1, 2, 3]) * 10 + np.zeros((20, 1, 1))
    tracks = MarkerTracks(tuple("abcd"), RATE, line)
    with pytest.raises(DataError, match="on a line"):
        fill_gaps(tracks, "rigid", 1.0, tracks.names)
    never = without(head(rng, frames=20, markers=4), (0, 0, 10), (1, 10, 20))
    with pytest.raises(DataError, match="no frame shows all"):
        fill_gaps(never, "rigid", 1.0, never.names)


def test_an_infinite_limit_fills_every_inner_gap():
    filled = fill_gaps(without(waving(), (0, 10, 290)), "linear", np.inf)
    assert filled.visible.all()
    assert filled.provenance[-1].arguments["maximum_gap"] is None


def test_the_report_is_a_table_as_wide_as_its_longest_name():
    gappy = without(waving(100), (0, 0, 5), (0, 20, 21), (1, 50, 62))
    table = str(count_gaps(gappy)).splitlines()
    assert table == [
        "100 frames at 100 Hz, 2 markers, 9.00% of the samples missing",
        "marker  gaps  missing           longest          at ends",
        "m0         2        6 (  6.0%)      5 (0.050 s)        5",
        "m1         1       12 ( 12.0%)     12 (0.120 s)        0",
    ]
    table = str(count_gaps(gappy.replace(names=("m0", "eyebrow")))).splitlines()
    assert [line[:13] for line in table[1:]] == ["marker   gaps", "m0          2", "eyebrow     1"]


def test_a_tenth_of_a_second_is_filled_where_nothing_else_is_said():
    filled = fill_gaps(without(waving(), (0, 50, 60), (1, 50, 61)))
    assert filled.visible.all(axis=0).tolist() == [True, False]


def test_nothing_is_missing_of_no_frame():
    empty = MarkerTracks(("a",), RATE, np.zeros((0, 1, 3)))
    assert count_gaps(empty).markers[0].share == 0.0


@pytest.mark.parametrize("between", [1, 2, 3])
def test_rigid_filling_of_two_gaps_with_few_frames_between(rng, between):
    """Each is led into its own edges: the marker is off by another amount at each of them."""
    truth = head(rng, noise=0.0)
    slipped = truth.positions.copy()
    middle = 110 + between
    slipped[:105, 2] += [0.4, 0, 0]
    slipped[110:middle, 2] += [0, 0.8, 0]
    gappy = without(truth.replace(positions=slipped), (2, 105, 110), (2, middle, middle + 6))
    filled = fill_gaps(gappy, "rigid", 1.0, truth.names)
    off = np.linalg.norm(filled.positions - truth.positions, axis=2)[:, 2]
    assert (off[105:110] < 0.81).all()
    # From 0.8 beside the second gap to nothing behind it, evenly in the coordinates of the head.
    expected = 0.8 * (1 - np.arange(1, 7) / 7)
    np.testing.assert_allclose(off[middle : middle + 6], expected, atol=1e-6)
    before, after = np.array([0.4, 0, 0]), np.array([0, 0.8, 0])
    share = np.arange(1, 6)[:, None] / 6
    inner = np.linalg.norm((1 - share) * before + share * after, axis=1)
    assert np.abs(off[105:110] - inner).max() < 0.15


def test_a_marker_that_is_always_seen_has_no_gap():
    whole, holed = count_gaps(without(waving(50), (1, 7, 9))).markers
    assert (whole.gaps, whole.missing, whole.longest, whole.longest_seconds) == (0, 0, 0, 0.0)
    assert (whole.share, whole.at_ends) == (0.0, 0)
    assert (holed.gaps, holed.missing, holed.longest, holed.at_ends) == (1, 2, 2, 0)
