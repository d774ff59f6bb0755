"""Costs of frames on a linear face, whose second derivatives are exact; their parts by hand."""

import numpy as np
import pytest

from mocap_fit.fitting.frame_costs import CostScale, FrameCosts, LocalCosts, _update_duals
from mocap_fit.fitting.over_time import (
    _check_weight,
    _compute_bare_deviations,
    _compute_noise_ratio,
    _compute_ridge,
    _compute_total,
    _compute_unit_deviations,
    _compute_variances,
    _fill_gaps,
    _split_at_gaps,
    _summarise_strengths,
)

OBJECTIVES = ("distances", "squares", "huber")
THRESHOLD = 1.5


class LinearFace:
    """Markers that move in straight lines, as the model of a round has them."""

    def __init__(self, rng, markers=7, parameters=3):
        self.base = 10 * rng.normal(size=(markers, 3))
        self.jacobian = rng.normal(size=(markers, 3, parameters))

    def evaluate_frames(self, values):
        moved = np.einsum("mip,tp->tmi", self.jacobian, values)
        return self.base + moved, np.tile(self.jacobian, (len(values), 1, 1, 1))


def costs_of(rng, objective, frames=5):
    face = LinearFace(rng)
    targets = face.base + rng.normal(size=(frames, 7, 3))
    weights = rng.uniform(0.5, 2, (frames, 7))
    weights[1, 3], targets[1, 3] = 0.0, np.nan
    return FrameCosts(face, targets, weights, objective, THRESHOLD), face


def cost_of(data, values):
    """Every frame's cost, marker by marker."""
    positions, _ = data.evaluator.evaluate_frames(values)
    totals = []
    for points, targets, weights in zip(positions, data.targets, data.weights, strict=True):
        total = 0.0
        for point, target, weight in zip(points, targets, weights, strict=True):
            if weight:
                d = np.linalg.norm(point - target)
                if data.objective == "squares" or (data.objective == "huber" and d <= THRESHOLD):
                    total += weight * d**2
                elif data.objective == "distances":
                    total += weight * d
                else:
                    total += weight * (2 * THRESHOLD * d - THRESHOLD**2)
        totals.append(total)
    return np.array(totals)


@pytest.mark.parametrize("objective", OBJECTIVES)
def test_the_quadratic_form_is_that_of_second_differences(rng, objective):
    data, _ = costs_of(rng, objective)
    values = 0.3 * rng.normal(size=(5, 3))
    local = data.at(values)
    np.testing.assert_allclose(local.costs, cost_of(data, values))
    for p in range(3):
        step = 1e-5 * np.eye(3)[p]
        above, below = data.at(values + step), data.at(values - step)
        slope = (cost_of(data, values + step) - cost_of(data, values - step)) / 2e-5
        np.testing.assert_allclose(local.gradients[:, p], slope, rtol=1e-6, atol=1e-8)
        curve = (above.gradients - below.gradients) / 2e-5
        np.testing.assert_allclose(local.curvatures[:, p], curve, rtol=1e-6, atol=1e-7)
    expected = np.einsum(
        "tm,mip,miq->tpq", data.weights, data.evaluator.jacobian, data.evaluator.jacobian
    )
    np.testing.assert_allclose(local.information, expected)
    assert not local.residuals[1, 3].any()
    positions, _ = data.evaluator.evaluate_frames(values)
    np.testing.assert_allclose(local.residuals[0], positions[0] - data.targets[0])


def test_many_frames_are_those_of_each(rng):
    """They are computed 256 at a time."""
    data, _ = costs_of(rng, "distances", frames=515)
    values = 0.3 * rng.normal(size=(515, 3))
    together = data.at(values)
    for frame in (0, 255, 256, 511, 512, 514):
        one = FrameCosts(
            data.evaluator,
            data.targets[frame : frame + 1],
            data.weights[frame : frame + 1],
            "distances",
            THRESHOLD,
        ).at(values[frame : frame + 1])
        for many, single in zip(together, one, strict=True):
            np.testing.assert_allclose(many[frame], single[0], rtol=1e-12)


def test_the_dual_takes_the_place_of_one_direction(rng):
    """Chan, Golub and Mulet: I - (u zᵀ + z uᵀ) / 2, with the direction u and its dual z."""
    data, face = costs_of(rng, "distances")
    before = data.at(0.3 * rng.normal(size=(5, 3)))
    values = 0.3 * rng.normal(size=(5, 3))
    local = data.at(values, before)
    for t in range(5):
        expected = np.zeros((3, 3))
        for m in range(7):
            old, new = before.residuals[t, m], local.residuals[t, m]
            if not data.weights[t, m]:
                continue
            u_old = old / np.linalg.norm(old)
            dual = (new - (u_old @ (new - old)) * before.duals[t, m]) / np.linalg.norm(old)
            dual /= max(1.0, np.linalg.norm(dual))
            np.testing.assert_allclose(local.duals[t, m], dual)
            r = np.linalg.norm(new)
            u = new / r
            middle = np.eye(3) - 0.5 * (np.outer(u, dual) + np.outer(dual, u))
            expected += data.weights[t, m] / r * face.jacobian[m].T @ middle @ face.jacobian[m]
        np.testing.assert_allclose(local.curvatures[t], expected)
    # The first time it is the direction itself, and of a residual of nothing it is nothing.
    lengths = np.linalg.norm(before.residuals, axis=2, keepdims=True)
    shown = (lengths > 0)[..., 0]
    np.testing.assert_allclose(
        before.duals[shown], (before.residuals / np.maximum(lengths, 1e-9))[shown]
    )
    nothing = LocalCosts(*(np.zeros((1, 1, 3)) for _ in range(6)))
    np.testing.assert_allclose(
        _update_duals(nothing, slice(0, 1), np.array([[[3e-7, 0, 0]]])), [[[0.3, 0, 0]]]
    )


def test_only_frames_that_moved_change(rng):
    data, _ = costs_of(rng, "huber")
    values = 0.3 * rng.normal(size=(5, 3))
    before = data.at(values)
    moved = np.array([True, False, False, True, False])
    after = data.update(values + 0.1, before, moved)
    expected = data.at(values + 0.1, before)
    for new, old, right in zip(after, before, expected, strict=True):
        np.testing.assert_array_equal(new[~moved], old[~moved])
        np.testing.assert_allclose(new[moved], right[moved])


def test_distances_below_a_millionth_of_a_millimetre_are_one():
    for objective, slope in (("distances", 1e6), ("squares", 2.0), ("huber", 2.0)):
        data = FrameCosts(None, np.zeros((1, 1, 3)), np.ones((1, 1)), objective, THRESHOLD)
        _, slopes, straight = data._evaluate_distances(np.array([0.0, 5e-7, THRESHOLD]))
        assert slopes[:2].tolist() == pytest.approx([slope, slope])
        assert straight.tolist() == ([1, 1, 1] if objective == "distances" else [0, 0, 0])


class TestParts:
    """What the fit over time does beside the costs."""

    def test_the_total_has_the_integral_of_the_squared_curvature(self, rng):
        values, strengths = rng.normal(size=(6, 2)), rng.uniform(1, 2, (4, 2))
        local = LocalCosts(np.arange(6.0), *[np.zeros(1)] * 5)
        second = values[:-2] - 2 * values[1:-1] + values[2:]
        expected = 15 + np.sum(strengths * second**2) * 30.0**3
        assert _compute_total(local, values, strengths, 30.0) == pytest.approx(expected)

    def test_the_ridge_is_a_part_of_the_mean_information(self):
        information = np.array([np.diag([3.0, 0.0, 30.0]), np.diag([1.0, 0.0, 10.0])])
        np.testing.assert_allclose(_compute_ridge(information), [2e-10, 2e-12, 2e-9])
        np.testing.assert_allclose(_compute_ridge(np.zeros((2, 3, 3))), 1e-310, rtol=1e-3)

    def test_bare_deviations_are_those_of_the_inverse_information(self, rng):
        roots = rng.normal(size=(4, 5, 3))
        information = np.einsum("tmp,tmq->tpq", roots, roots)
        expected = [np.sqrt(np.diag(np.linalg.inv(each))) for each in information]
        np.testing.assert_allclose(_compute_bare_deviations(information), expected, rtol=1e-6)

    def test_the_noise_ratio_is_the_median_of_what_is_known(self):
        units = [np.array([[2.0, np.inf], [3.0, np.inf]]), np.array([[8.0, np.inf]])]
        bare = [np.ones((2, 2)), np.full((1, 2), 2.0)]
        np.testing.assert_allclose(_compute_noise_ratio(units, bare), [9.0, 1.0])

    def test_variances_are_those_of_the_dense_estimate(self, rng):
        roots, of_pose = rng.normal(size=(5, 4, 2)), rng.normal(size=(5, 3, 2))
        information, pose = (np.einsum("tmp,tmq->tpq", r, r) for r in (roots, of_pose))
        strengths, ratio = rng.uniform(0.01, 0.02, (3, 2)), np.array([1.2, 2.5])
        scale, rate, more = CostScale(0.04, 0.3), 4.0, np.array([1.0, 1.5])
        data, gradients, rough, prior = np.zeros((4, 5, 2, 5, 2))
        for t in range(5):
            data[t, :, t, :] = information[t] / 0.04
            gradients[t, :, t, :] = np.sqrt(np.outer(more, more)) * (information + pose)[t] / 0.04
        second = np.diff(np.eye(5), n=2, axis=0) * rate**1.5
        for p in range(2):
            rough[:, p, :, p] = second.T @ np.diag(2 * strengths[:, p] / 0.3) @ second
            prior[:, p, :, p] = ratio[p] * rough[:, p, :, p]
        data, gradients, rough, prior = (
            each.reshape(10, 10) for each in (data, gradients, rough, prior)
        )
        inverse = np.linalg.inv(data + rough)
        expected = np.diag(inverse @ (gradients + prior) @ inverse).reshape(5, 2)
        variances, taken = _compute_variances(
            information, pose, strengths, (ratio, more), scale, rate
        )
        np.testing.assert_allclose(variances, expected, rtol=1e-3)
        np.testing.assert_allclose(taken.sum(), np.trace(inverse @ data), rtol=1e-6)

    def test_strengths_are_summed_up_by_their_median(self):
        strengths = [np.array([[1.0, 5.0], [2.0, 6.0]]), np.zeros((0, 2)), np.array([[9.0, 0.0]])]
        np.testing.assert_array_equal(_summarise_strengths(strengths), [2.0, 5.0])
        np.testing.assert_array_equal(_summarise_strengths([np.zeros((0, 2))]), [0.0, 0.0])

    def test_segments_end_where_a_gap_is_too_long(self):
        fitted = np.zeros(20, dtype=bool)
        fitted[[1, 2, 6, 7, 12, 18]] = True
        assert _split_at_gaps(fitted, 3.0) == [slice(1, 8), slice(12, 13), slice(18, 19)]
        assert _split_at_gaps(fitted, 4.0) == [slice(1, 13), slice(18, 19)]
        assert _split_at_gaps(fitted, 0.0) == [
            slice(1, 3),
            slice(6, 8),
            slice(12, 13),
            slice(18, 19),
        ]

    def test_gaps_are_filled_by_lines(self):
        nan, inf = np.nan, np.inf
        values = np.array([[0.0, nan, inf], [inf, 2.0, nan], [nan, 4.0, inf], [0.6, inf, nan]])
        expected = [[0, 2, 0], [0.2, 2, 0], [0.4, 4, 0], [0.6, 4, 0]]
        np.testing.assert_allclose(_fill_gaps(values), expected)

    def test_a_weight_counts_by_the_motion_of_the_markers(self, rng):
        """A parameter that hardly moves them counts as one that moves them a thousandth."""

        class Binding:
            parameter_names = ("a", "b", "c")
            weights = np.array([1.0, 3.0, 2.0, 1.0, 1.0, 1.0, 1.0])
            reference_parameters = np.zeros(3)

        class Evaluator:
            jacobian = rng.normal(size=(7, 3, 3)) * [1.0, 2.0, 1e-5]

            def evaluate(self, values):
                return None, self.jacobian

        squares = np.sum(Evaluator.jacobian**2, axis=1)
        moved = Binding.weights @ squares / 10
        expected = 5.0 * np.array([moved[0], moved[1], 1e-6 * moved[1]])
        np.testing.assert_allclose(_check_weight(5.0, Binding, Evaluator()), expected)
        np.testing.assert_array_equal(_check_weight([1, 2, 3], Binding, Evaluator()), [1, 2, 3])


def test_unit_deviations_are_those_of_the_fit_over_its_noise():
    class Fit:
        class parameters:
            standard_deviations = np.array([[0.2, np.inf], [0.4, 0.6], [0.1, 0.1]])

        noise = 0.5
        fitted = np.array([True, True, False])

    bare = np.full((3, 2), 7.0)
    found = _compute_unit_deviations(Fit, slice(0, 3), bare, 2.0)
    np.testing.assert_allclose(found, [[0.2, np.inf], [0.4, 0.6], [np.inf, np.inf]])
    Fit.noise = 0.0
    found = _compute_unit_deviations(Fit, slice(0, 3), bare, 2.0)
    np.testing.assert_allclose(found, [[7.0, np.inf], [7.0, 7.0], [np.inf, np.inf]])
