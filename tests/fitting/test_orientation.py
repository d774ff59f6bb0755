"""The orientation fit: eq. 1 against truth, and against Procrustes in closed form."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from mocap_fit.errors import DataError
from mocap_fit.face import Rig
from mocap_fit.fitting import Layout, Orientation, fit_orientation
from mocap_fit.fitting.orientation import align_points
from mocap_fit.tracks import estimate_similarity_transform

POINTS = np.array(
    [[25, 0, 88], [-25, 0, 88], [0, 28, 119], [0, -30, 99], [34, 89, 89], [-34, 89, 89]], float
)


def distances(orientation: Orientation, source: np.ndarray, target: np.ndarray) -> np.ndarray:
    return np.linalg.norm(orientation.apply(source) - target, axis=1)


@settings(max_examples=25, deadline=None)
@given(
    seed=st.integers(0, 10_000),
    scale=st.floats(0.5, 2.0),
    vector=st.tuples(*[st.floats(-3.0, 3.0)] * 3),
    shift=st.tuples(*[st.floats(-2000.0, 2000.0)] * 3),
)
def test_a_known_transform_is_found(seed, scale, vector, shift) -> None:
    rotation = Rotation.from_rotvec(vector).as_matrix()
    source = (POINTS - np.array(shift)) @ rotation / scale
    found = align_points(source, POINTS)
    assert found.scale == pytest.approx(scale, rel=1e-7)
    np.testing.assert_allclose(found.rotation, rotation, atol=1e-7)
    np.testing.assert_allclose(found.apply(source), POINTS, atol=1e-5)


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 10_000))
def test_squares_are_procrustes(seed: int) -> None:
    rng = np.random.default_rng(seed)
    source = 1.1 * POINTS + rng.normal(0, 4.0, POINTS.shape)
    found = align_points(source, POINTS, objective="squares")
    scale, rotation, translation = estimate_similarity_transform(source, POINTS)
    assert found.scale == pytest.approx(scale, rel=1e-6)
    np.testing.assert_allclose(found.rotation, rotation, atol=1e-6)
    np.testing.assert_allclose(found.translation, translation, atol=1e-3)


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 10_000))
def test_distances_are_least(seed: int) -> None:
    """No small step of any of the seven parameters, nor Procrustes, has a smaller sum."""
    rng = np.random.default_rng(seed)
    source = POINTS + rng.normal(0, 3.0, POINTS.shape)
    found = align_points(source, POINTS)
    least = distances(found, source, POINTS).sum()
    closed = Orientation(*estimate_similarity_transform(source, POINTS))
    assert least <= distances(closed, source, POINTS).sum() + 1e-9
    for _ in range(50):
        near = Orientation(
            found.scale * np.exp(rng.normal(0, 1e-4)),
            Rotation.from_rotvec(rng.normal(0, 1e-4, 3)).as_matrix() @ found.rotation,
            found.translation + rng.normal(0, 1e-2, 3),
        )
        assert least <= distances(near, source, POINTS).sum() + 1e-7


def test_distances_forgive_one_bad_point() -> None:
    source = POINTS.copy()
    source[2] += [0, 0, 15]
    robust = align_points(source, POINTS)
    squares = align_points(source, POINTS, objective="squares")
    good = [0, 1, 3, 4, 5]
    assert distances(robust, source[good], POINTS[good]).max() < 1e-3
    assert distances(squares, source[good], POINTS[good]).max() > 1.0


def test_apply_and_undo_are_inverse() -> None:
    orientation = Orientation(1.3, Rotation.from_rotvec([0.3, 0.2, -1]).as_matrix(), np.arange(3.0))
    np.testing.assert_allclose(orientation.undo(orientation.apply(POINTS)), POINTS, atol=1e-10)


def test_the_speaker_comes_out_in_size(layout: Layout, face: Rig, session) -> None:
    """Markers stand above the skin; the model must not come out larger for it."""
    found = fit_orientation(face, layout, session.still)
    assert found.scale == pytest.approx(1.0, abs=1e-6)
    assert found.residuals is not None
    assert max(found.residuals.values()) < 1e-3
    bare = layout.model_copy(update={"marker_offset": 0.0})
    assert abs(fit_orientation(face, bare, session.still).scale - 1.0) > 1e-3


def test_metres_are_refused(layout: Layout, face: Rig, session) -> None:
    metres = session.still.replace(positions=session.still.positions / 1000)
    with pytest.raises(DataError, match="millimetres"):
        fit_orientation(face, layout, metres)


def test_too_few_strategic_points(layout: Layout, face: Rig, session) -> None:
    strategic = [m.name for m in layout.markers if m.orientation]
    kept = [n for n in session.still.names if n not in strategic[2:]]
    with pytest.raises(DataError, match="too few strategic points"):
        fit_orientation(face, layout, session.still.select(kept))


def test_points_on_a_line_are_refused() -> None:
    line = np.outer(np.arange(4.0), [1.0, 2.0, 3.0])
    with pytest.raises(DataError, match="line"):
        align_points(line, POINTS[:4])
