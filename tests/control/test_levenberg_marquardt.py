"""Levenberg-Marquardt against a plain form of Marquardt's method, and scipy."""

import math
from itertools import pairwise

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from mocap_fit.control.levenberg_marquardt import NormalEquations, minimise

# Marquardt's damping as this project uses it.
FIRST, INCREASE, DECREASE = 0.01, 5.0, 0.2
FREE = (np.full(2, -np.inf), np.full(2, np.inf))


def rosenbrock(point):
    x, y = point
    residuals = np.array([1.0 - x, 10.0 * (y - x * x)])
    jacobian = np.array([[-1.0, 0.0], [-20.0 * x, 10.0]])
    return residuals, jacobian


def linear(matrix, target):
    return lambda point: (matrix @ point - target, matrix)


def equations_of(function):
    def equations(point):
        residuals, jacobian = function(point)
        return NormalEquations(
            jacobian.T @ jacobian, jacobian.T @ residuals, float(residuals @ residuals)
        )

    return equations


def cost_of(function):
    return lambda point: float(np.sum(function(point)[0] ** 2))


def run(function, start, bounds=FREE, max_iter=50, tol=0.0, stop=None):
    """The points that the search comes through, and its costs."""
    path = []

    def log(iteration, point, cost):
        assert iteration == len(path)
        path.append((point.copy(), cost))
        return stop is not None and iteration == stop

    last = minimise(
        equations_of(function), cost_of(function), np.asarray(start, dtype=float), bounds,
        max_iter=max_iter, tol=tol, callback=log,
    )  # fmt: skip
    np.testing.assert_array_equal(last, path[-1][0])
    return path


def test_every_step_is_marquardts():
    path = run(rosenbrock, [-1.2, 1.0], max_iter=25)
    point, damping, failed = np.array([-1.2, 1.0]), FIRST, 0
    for reached, cost in path[1:]:
        residuals, jacobian = rosenbrock(point)
        hessian, gradient = jacobian.T @ jacobian, jacobian.T @ residuals
        before = float(residuals @ residuals)
        while True:
            step = np.linalg.solve(hessian + damping * np.diag(np.diag(hessian)), -gradient)
            if float(np.sum(rosenbrock(point + step)[0] ** 2)) < before:
                break
            damping *= INCREASE
            failed += 1
        damping *= DECREASE
        np.testing.assert_allclose(reached, point + step, rtol=1e-6, atol=1e-9)
        assert cost == pytest.approx(float(np.sum(rosenbrock(reached)[0] ** 2)), abs=1e-15)
        point = reached
        if cost < 1e-15:
            break
    assert failed > 2
    np.testing.assert_allclose(path[-1][0], [1.0, 1.0], atol=1e-6)


def test_a_linear_problem_between_bounds_is_solved_as_scipy_does(rng):
    matrix, target = rng.normal(size=(12, 4)), rng.normal(size=12) * 3
    bounds = np.array([-0.1, -9.0, 0.1, -9.0]), np.array([0.1, 9.0, 0.2, 9.0])
    truth = lsq_linear(matrix, target, bounds, method="bvls", tol=1e-14).x
    path = run(linear(matrix, target), np.zeros(4), bounds, max_iter=200)
    # The start is moved between the bounds.
    np.testing.assert_array_equal(path[0][0], [0.0, 0.0, 0.1, 0.0])
    assert path[0][1] == pytest.approx(float(np.sum((matrix @ path[0][0] - target) ** 2)))
    np.testing.assert_allclose(path[-1][0], truth, atol=1e-7)
    on_bound = (truth == bounds[0]) | (truth == bounds[1])
    assert on_bound.any()
    assert not on_bound.all()
    for point, _ in path:
        assert ((point >= bounds[0]) & (point <= bounds[1])).all()


def test_a_value_at_a_bound_comes_back_when_the_descent_leads_inside():
    path = run(
        linear(np.eye(2), np.array([0.5, 2.0])), [0.0, 1.0],
        (np.array([0.0, 0.0]), np.array([1.0, 1.0])),
    )  # fmt: skip
    np.testing.assert_allclose(path[-1][0], [0.5, 1.0], atol=1e-6)


@pytest.mark.parametrize("share", [0.9, 0.5])
def test_it_ends_when_a_step_gains_less_than_the_tolerance(share):
    path = run(rosenbrock, [-1.2, 1.0], tol=share)
    gains = [1 - after[1] / before[1] for before, after in pairwise(path)]
    assert gains[-1] < share
    assert all(gain >= share for gain in gains[:-1])


def test_it_ends_after_so_many_steps_or_when_it_is_told_to():
    assert len(run(rosenbrock, [-1.2, 1.0], max_iter=3)) == 4
    assert len(run(rosenbrock, [-1.2, 1.0], stop=0)) == 1
    assert len(run(rosenbrock, [-1.2, 1.0], stop=2)) == 3


def test_it_ends_at_no_error_and_where_no_step_gains():
    exact = run(linear(np.eye(2), np.array([1.0, 2.0])), [1.0, 2.0])
    assert len(exact) == 1
    calls = []

    def cost(point):
        calls.append(point)
        return 5.0

    equations = equations_of(linear(np.eye(1), np.array([2.0])))
    bounds = np.array([-9.0]), np.array([9.0])
    last = minimise(equations, cost, np.zeros(1), bounds, max_iter=9, tol=0.0)
    assert last == 0.0
    # The damping grows from 0.01 to 10^12.
    assert len(calls) == math.ceil(math.log(1e14) / math.log(INCREASE))
    np.testing.assert_allclose(
        np.concatenate(calls), [2 / (1 + FIRST * INCREASE**k) for k in range(len(calls))], rtol=1e-9
    )


def test_what_nothing_depends_on_does_not_move():
    path = run(linear(np.array([[1.0, 0.0]]), np.array([3.0])), [1.0, 7.0])
    np.testing.assert_allclose(path[-1][0], [3.0, 7.0], atol=1e-9)


def test_equations_that_are_not_definite_end_the_search():
    equations = lambda point: NormalEquations(-np.eye(2), np.ones(2), 1.0)  # noqa: E731
    start = np.array([3.0, 4.0])
    last = minimise(
        equations, lambda point: 1.0 if (point == start).all() else 0.0, start, FREE,
        max_iter=5, tol=0.0,
    )  # fmt: skip
    np.testing.assert_array_equal(last, start)


@pytest.mark.parametrize("scale", [0.03, 1.0, 30.0])
def test_values_at_bounds_leave_the_steps_of_the_others_alone(scale, rng):
    matrix, target = scale * rng.normal(size=(8, 3)), scale * rng.normal(size=8) * 3
    lower, upper = np.array([-0.1, -9.0, -0.2]), np.array([0.1, 9.0, 0.2])
    start = np.array([0.1, 0.0, -0.2])
    path = run(linear(matrix, target), start, (lower, upper), max_iter=30)
    point, damping, held = start, FIRST, 0
    for reached, _ in path[1:6]:
        residuals = matrix @ point - target
        gradient = matrix.T @ residuals
        outward = ((point == lower) & (gradient > 0)) | ((point == upper) & (gradient < 0))
        held += np.count_nonzero(outward)
        free = np.flatnonzero(~outward)
        hessian = matrix[:, free].T @ matrix[:, free]
        while True:
            candidate = point.copy()
            candidate[free] -= np.linalg.solve(
                hessian + damping * np.diag(np.diag(hessian)), gradient[free]
            )
            candidate = np.clip(candidate, lower, upper)
            if np.sum((matrix @ candidate - target) ** 2) < residuals @ residuals:
                break
            damping *= INCREASE
        damping *= DECREASE
        np.testing.assert_allclose(reached, candidate, atol=1e-9)
        point = reached
    assert held > 2


@pytest.mark.parametrize("scale", [0.1, 10.0])
def test_a_value_at_either_bound_comes_back(scale):
    bounds = np.array([0.0, 0.0]), np.array([1.0, 1.0])
    path = run(linear(scale * np.eye(2), scale * np.array([0.25, 0.75])), [1.0, 0.0], bounds)
    np.testing.assert_allclose(path[-1][0], [0.25, 0.75], atol=1e-6)
