"""Head motion stretch by stretch: the same bytes as in one piece."""

import warnings

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mocap_fit.errors import DataError, MocapFitWarning
from mocap_fit.head import HeadInStretches, remove_head_motion
from mocap_fit.tracks import MarkerTracks
from mocap_fit.tracks.thinned import Thinned

HEAD = ("left", "right", "top", "front", "back")
SHAPE = np.array([[-70.0, 0, -60], [70, 0, -60], [-60, 25, 5], [60, 25, 5], [0, -20, 25]])
NAMES = (*HEAD, "chin", "never")


def recording(rng: np.random.Generator, frames: int) -> MarkerTracks:
    """A head that turns, a chin, gaps, a marker that slips for a while, one that is never seen."""
    angle = np.cumsum(rng.normal(0.0, 0.01, frames))
    turn = np.zeros((frames, 3, 3))
    turn[:, 0, 0] = turn[:, 2, 2] = np.cos(angle)
    turn[:, 0, 2], turn[:, 2, 0], turn[:, 1, 1] = np.sin(angle), -np.sin(angle), 1.0
    still = np.concatenate([SHAPE, [[0.0, -80.0, 60.0], [0.0, 0.0, 0.0]]])
    positions = np.einsum("fij,pj->fpi", turn, still) + 5.0
    positions += rng.normal(0.0, 0.1, positions.shape)
    positions[rng.random(positions.shape[:2]) < 0.05] = np.nan
    if frames > 60:
        positions[frames // 3 : frames // 2, 3] += 8.0
        positions[frames // 4 : frames // 4 + 9, :3] = np.nan
    positions[:, -1] = np.nan
    return MarkerTracks(NAMES, 100.0, positions, name="long")


def cut(whole: MarkerTracks, lengths: list[int]) -> list[MarkerTracks]:
    parts, start = [], 0
    for length in [*lengths, whole.frames]:
        end = min(start + length, whole.frames)
        if end > start:
            parts.append(
                whole.replace(
                    positions=whole.positions[start:end],
                    origin=whole.origin[start:end],
                    start_time=start / whole.rate,
                )
            )
        start = end
    return parts


REFERENCE = MarkerTracks(HEAD, 100.0, SHAPE[None], name="reference")


@pytest.mark.filterwarnings("ignore::mocap_fit.errors.MocapFitWarning")
@settings(max_examples=15, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    frames=st.integers(30, 2500),
    lengths=st.lists(st.integers(1, 900), max_size=6),
)
def test_stretches_give_the_bytes_of_the_whole(seed: int, frames: int, lengths: list[int]) -> None:
    whole = recording(np.random.default_rng(seed), frames)
    weights = {"top": 2.0, "never": 1.0}
    expected, motion = remove_head_motion(whole, REFERENCE, (*HEAD, "never"), weights)
    parts = cut(whole, lengths)
    head = HeadInStretches(REFERENCE, (*HEAD, "never"), weights)
    for part in parts:
        head.look_at(part)
    found = list(head.remove(parts))
    np.testing.assert_array_equal(np.concatenate([p.positions for p in found]), expected.positions)
    np.testing.assert_array_equal(np.concatenate([p.origin for p in found]), expected.origin)
    assert found[-1].provenance == expected.provenance
    assert head.tell() == np.nanmedian(motion.residuals)


def test_the_same_is_told(rng: np.random.Generator) -> None:
    """Warnings are those of the whole recording, each once."""
    whole = recording(rng, 1200)
    positions = whole.positions.copy()
    positions[:, 1] += 30.0
    whole = whole.replace(positions=positions)

    def told(work) -> list[str]:
        with warnings.catch_warnings(record=True) as heard:
            warnings.simplefilter("always", MocapFitWarning)
            work()
        return [str(one.message) for one in heard]

    def in_stretches() -> None:
        head = HeadInStretches(REFERENCE, HEAD)
        parts = cut(whole, [500, 500])
        for part in parts:
            head.look_at(part)
        list(head.remove(parts))
        head.tell()

    expected = told(lambda: remove_head_motion(whole, REFERENCE, HEAD))
    assert len(expected) == 2
    assert told(in_stretches) == expected


def two_at_a_time(positions: np.ndarray) -> np.ndarray:
    """Each head marker is seen now and then, and never three of them."""
    frame, marker = np.indices(positions.shape[:2])
    shown = (marker == frame % 5) | (marker == (frame + 1) % 5) | (marker >= 5)
    return np.where(shown[:, :, None], positions, np.nan)


@pytest.mark.parametrize(
    ("change", "problem"),
    [(two_at_a_time, "no frame shows three"), (lambda p: p / 1000.0, "differ in size")],
)
def test_what_cannot_be_is_refused(rng: np.random.Generator, change, problem: str) -> None:
    whole = recording(rng, 100)
    head = HeadInStretches(REFERENCE, HEAD)
    parts = cut(MarkerTracks(NAMES, 100.0, change(whole.positions)), [40])
    for part in parts:
        head.look_at(part)
    with pytest.raises(DataError, match=problem):
        list(head.remove(parts))


@given(count=st.integers(1, 3000), limit=st.integers(1, 50), lengths=st.lists(st.integers(1, 400)))
def test_thinned_rows_do_not_depend_on_the_parts(count: int, limit: int, lengths) -> None:
    rows = np.arange(count, dtype=float)
    whole, parts = Thinned(limit), Thinned(limit)
    whole.add(rows)
    start = 0
    for length in [*lengths, count]:
        parts.add(rows[start : start + length])
        start += length
    np.testing.assert_array_equal(whole.rows, parts.rows)
    assert len(whole.rows) <= limit
    assert 2 * len(whole.rows) >= min(limit, count)
    steps = np.unique(np.diff(whole.rows))
    assert whole.rows[0] == 0
    assert len(steps) <= 1
