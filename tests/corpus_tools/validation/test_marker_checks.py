"""Checks of markers on made-up movements: what is planted is found, whatever the coordinates."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from corpus_tools.validation import Context, Location, load_thresholds
from corpus_tools.validation.exchanges import find_exchanges
from corpus_tools.validation.slips import find_slips
from corpus_tools.validation.subject import check_recording
from mocap_fit.tracks import MarkerTracks

LIMITS = load_thresholds()
RATE, FRAMES, MARKERS = 100.0, 200, 8


def movement(rng: np.random.Generator, noise: float = 0.2) -> np.ndarray:
    """Markers 15 mm apart and more, each on a smooth way of its own."""
    places = 15.0 * np.stack(np.meshgrid(range(2), range(2), range(2)), axis=-1).reshape(-1, 3)
    times = np.arange(FRAMES)[:, None, None] / RATE
    phases, size = rng.uniform(0, 6.28, (1, MARKERS, 3)), rng.uniform(0.5, 2.5, (1, MARKERS, 3))
    moves = size * np.sin(2 * np.pi * 2.0 * times + phases)
    return places + moves + rng.normal(0.0, noise, (FRAMES, MARKERS, 3))


class TestExchanges:
    @settings(deadline=None, max_examples=40)
    @given(
        seed=st.integers(0, 10_000),
        first=st.integers(2, 90),
        length=st.integers(1, 90),
        ring=st.permutations(range(MARKERS)).flatmap(
            lambda order: st.sampled_from([2, 3]).map(lambda n: tuple(order[:n]))
        ),
        lost=st.floats(0.0, 0.1),
    )
    def test_exchanged_names_are_found_and_mended(self, seed, first, length, ring, lost):
        rng = np.random.default_rng(seed)
        truth = movement(rng)
        truth[rng.random((FRAMES, MARKERS)) < lost] = np.nan
        # What tells is seen: the frames before and after each exchange.
        for frame in (first, first + length):
            truth[frame - 1 : frame + 1] = movement(np.random.default_rng(seed))[
                frame - 1 : frame + 1
            ]
        given_names = truth.copy()
        part = slice(first, first + length)
        given_names[part, list(ring)] = truth[part, list(np.roll(ring, 1))]
        exchanges, mended = find_exchanges(given_names, RATE, LIMITS.markers)
        assert [(e.first, e.last, set(e.markers)) for e in exchanges] == [
            (first, first + length - 1, set(ring))
        ]
        assert np.array_equal(mended, truth, equal_nan=True)

    @settings(deadline=None, max_examples=30)
    @given(seed=st.integers(0, 10_000), lost=st.floats(0.0, 0.2))
    def test_nothing_is_exchanged_in_clean_movements(self, seed, lost):
        rng = np.random.default_rng(seed)
        truth = movement(rng)
        truth[rng.random((FRAMES, MARKERS)) < lost] = np.nan
        exchanges, mended = find_exchanges(truth, RATE, LIMITS.markers)
        assert exchanges == []
        assert mended is truth


class TestCoordinates:
    @settings(deadline=None, max_examples=5)
    @given(turn=st.tuples(*[st.floats(-3, 3)] * 3), shift=st.tuples(*[st.floats(-2000, 2000)] * 3))
    def test_findings_do_not_depend_on_the_place_of_the_cameras(self, turn, shift):
        rng = np.random.default_rng(3)
        positions = movement(rng, 0.05)
        positions[50, 3] += 25.0
        positions[100:130, [0, 5]] = positions[100:130, [5, 0]]
        positions[60:140, 6] = np.nan
        names = tuple("abcdefgh")

        def found(array):
            tracks = MarkerTracks(names, RATE, array)
            findings, _ = check_recording(tracks, Context(LIMITS), Location("x"))
            return [(f.code, f.location.item, f.location.frames) for f in findings]

        moved = Rotation.from_rotvec(turn).apply(positions.reshape(-1, 3)).reshape(positions.shape)
        assert found(moved + np.array(shift)) == found(positions)
        assert {code for code, *_ in found(positions)} == {"MF102", "MF101", "MF104", "MF106"}

    @pytest.mark.parametrize("frames", [0, 1, 2, 3])
    def test_very_short_recordings(self, frames):
        tracks = MarkerTracks(tuple("abcdefgh"), RATE, movement(np.random.default_rng(0))[:frames])
        findings, _ = check_recording(tracks, Context(LIMITS), Location("x"))
        assert [f.code for f in findings] == ([] if frames else ["MF103"])

    def test_one_marker_alone(self):
        tracks = MarkerTracks(("a",), RATE, movement(np.random.default_rng(0))[:, :1])
        findings, shape = check_recording(tracks, Context(LIMITS), Location("x"))
        assert shape is None
        assert {f.code for f in findings} == {"MF126"}

    def test_a_still_object_is_not_stuck(self):
        still = np.repeat(movement(np.random.default_rng(0))[:1], 100, axis=0)
        findings, _ = check_recording(
            MarkerTracks(tuple("abcdefgh"), RATE, still), Context(LIMITS), Location("x")
        )
        assert findings == []


class TestSlips:
    @settings(deadline=None, max_examples=15)
    @given(
        seed=st.integers(0, 10_000),
        marker=st.integers(0, 4),
        start=st.integers(40, 150),
        direction=st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda d: np.linalg.norm(d) > 0.3),
    )
    def test_a_marker_that_slips_is_found_whatever_the_head_does(
        self, seed, marker, start, direction
    ):
        rng = np.random.default_rng(seed)
        head = np.array(
            [[0, 72, 116], [58, 98, 102], [-58, 98, 102], [90, 78, -10], [-90, 78, -10]]
        )
        shapes_of_frames = head + rng.normal(0, 0.3, (FRAMES, 5, 3))
        shapes_of_frames[start:, marker] += 7.0 * np.array(direction) / np.linalg.norm(direction)
        turns = np.cumsum(rng.normal(0, 0.02, (FRAMES, 3)), axis=0)
        positions = np.stack(
            [Rotation.from_rotvec(t).apply(s) for t, s in zip(turns, shapes_of_frames, strict=True)]
        )
        positions[rng.random((FRAMES, 5)) < 0.05] = np.nan
        found = find_slips(positions, RATE, LIMITS.shape)
        assert [k for k, *_ in found] == [marker]
        _, run, off = found[0]
        assert run.stop == FRAMES
        assert abs(run.start - start) <= 9
        assert off == pytest.approx(7.0, abs=1.5)

    @settings(deadline=None, max_examples=25)
    @given(seed=st.integers(0, 10_000), noise=st.floats(0.0, 1.5))
    def test_nothing_slips_in_noise(self, seed, noise):
        rng = np.random.default_rng(seed)
        head = rng.normal(0.0, 70.0, (5, 3))
        positions = head + rng.normal(0, noise, (FRAMES, 5, 3))
        assert find_slips(positions, RATE, LIMITS.shape) == []

    def test_three_markers_tell_nothing(self):
        assert find_slips(np.zeros((FRAMES, 3, 3)), RATE, LIMITS.shape) == []
