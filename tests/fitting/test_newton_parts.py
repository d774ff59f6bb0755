"""The parts of Newton's method, uncompiled, against numpy."""

import numpy as np
import pytest

from mocap_fit.fitting import newton
from mocap_fit.fitting.kernel import DISTANCES, HUBER, SQUARES
from mocap_fit.fitting.packed_binding import SLOT, WIDTH, Y, Z

THRESHOLD = 1.2
update_dual, compute_hessians, solve, accept = (
    getattr(newton, name).py_func
    for name in ("_update_dual", "_compute_hessians", "_solve", "_accept")
)


def to_points(row):
    """The markers of a row, ``(markers, 3)``: blocks of all x, all y and all z."""
    return row.reshape(-1, 3, WIDTH).transpose(0, 2, 1).reshape(-1, 3)


@pytest.fixture
def rows(rng):
    """Residuals of two blocks, some of them near 0; duals within their balls."""
    rows = rng.normal(size=(5, 2 * SLOT))
    rows[newton._HERE, ::7] *= 1e-3
    rows[newton._DUAL] *= 0.4
    return rows


@pytest.mark.parametrize("portion", [1.0, 0.16])
def test_duals_are_updated_as_published(rows, portion):
    """Chan, Golub and Mulet: u + v - (u v) z, with the step v over the length of the residual."""
    here, trial, dual = (to_points(rows[k]) for k in (newton._HERE, newton._TRIAL, newton._DUAL))
    length = np.sqrt(np.sum(here**2, axis=1, keepdims=True) + 1e-12)
    u, v = here / length, (trial - here) / length / portion
    expected = u + v - np.sum(u * v, axis=1, keepdims=True) * dual
    expected /= np.maximum(1.0, np.linalg.norm(expected, axis=1, keepdims=True))
    before = rows.copy()
    update_dual(rows, portion)
    np.testing.assert_allclose(to_points(rows[newton._DUAL]), expected)
    np.testing.assert_array_equal(
        np.delete(rows, newton._DUAL, 0), np.delete(before, newton._DUAL, 0)
    )
    assert (np.linalg.norm(to_points(rows[newton._DUAL]), axis=1) <= 1 + 1e-12).all()


@pytest.mark.parametrize("objective", [DISTANCES, SQUARES, HUBER])
def test_hessians_are_those_of_the_distance_with_its_dual(rows, rng, objective):
    hessians = np.zeros((7, 2 * WIDTH))
    frame = rng.normal(size=2 * 4 * WIDTH)
    weights = np.abs(frame.reshape(2, 4, WIDTH)[:, 3]).ravel()
    frame.reshape(2, 4, WIDTH)[:, 3] = weights.reshape(2, WIDTH)
    compute_hessians(rows, hessians, frame, objective, THRESHOLD)
    here, dual = to_points(rows[newton._HERE]), to_points(rows[newton._DUAL])
    far = 0
    for m in range(2 * WIDTH):
        length = np.sqrt(here[m] @ here[m] + 1e-12)
        u, z = here[m] / length, dual[m]
        if objective == DISTANCES or (objective == HUBER and length > THRESHOLD):
            slope = (1.0 if objective == DISTANCES else 2 * THRESHOLD) / length
            expected = slope * (np.eye(3) - 0.5 * (np.outer(u, z) + np.outer(z, u)))
            far += 1
        else:
            slope, expected = 2.0, 2.0 * np.eye(3)
        c, xx, yy, zz, xy, xz, yz = hessians[:, m]
        found = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        assert c == pytest.approx(weights[m] * slope)
        np.testing.assert_allclose(found, weights[m] * expected, rtol=1e-9, atol=1e-12)
    assert (0 < far < 2 * WIDTH) == (objective == HUBER)


@pytest.mark.parametrize("fixed", [(), (0,), (2, 3), (5,), tuple(range(6))])
def test_newtons_step_is_the_solution_for_the_free_parameters(rng, fixed):
    root = rng.normal(size=(9, 6))
    hessian, gradient = root.T @ root, rng.normal(size=6)
    free = np.array([float(k not in fixed) for k in range(6)])
    out, factor = np.full(6, 9.0), np.full((6, 6), 9.0)
    solve(np.tril(hessian), factor, gradient, free, out)
    chosen = np.flatnonzero(free)
    expected = np.zeros(6)
    part = hessian[np.ix_(chosen, chosen)]
    expected[chosen] = np.linalg.solve(part + 1e-9 * np.eye(len(chosen)), -gradient[chosen])
    np.testing.assert_allclose(out, expected, rtol=1e-6, atol=1e-9)
    # What nothing shows has a small factor, and its step is no NaN.
    empty = np.zeros((2, 2))
    solve(empty, empty.copy(), np.array([0.0, 1.0]), np.ones(2), out)
    assert np.isfinite(out[:2]).all()
    assert out[0] == 0


def test_the_trial_point_is_taken(rows, rng):
    frame = rng.normal(size=2 * 4 * WIDTH)
    start, following = np.zeros(4), np.arange(4.0)
    trial = rows[newton._TRIAL].copy()
    accept(rows, frame, start, following)
    np.testing.assert_array_equal(start, following)
    np.testing.assert_array_equal(rows[newton._START], trial)
    measured = frame.reshape(2, 4, WIDTH)[:, :3].reshape(2 * SLOT)
    np.testing.assert_allclose(rows[newton._VIRTUAL], trial + measured)
    assert (Y, Z, SLOT) == (WIDTH, 2 * WIDTH, 3 * WIDTH)
