import numpy as np
import pytest
from scipy import optimize, stats
from scipy.spatial.transform import Rotation

from mocap_fit.errors import DataError
from mocap_fit.tracks.rigid import estimate_rigid_transforms
from mocap_fit.tracks.robust import (
    _estimate_noise,
    _measure_noise,
    compute_pose_information,
    estimate_robust_transforms,
    sample_evenly,
)

# Spectacles with a marker on each temple, hinge and on the bridge.
SHAPE = np.array(
    [[-70.0, 0, -60], [70, 0, -60], [-60, 25, 5], [60, 25, 5], [0, -20, 25]],
)


def moving(rng, frames=1500, noise=0.1, shape=SHAPE):
    turns = Rotation.from_euler("xyz", rng.uniform(-20, 20, (frames, 3)), degrees=True)
    shifts = rng.uniform(-30, 30, (frames, 3))
    points = np.einsum("fij,pj->fpi", turns.as_matrix(), shape) + shifts[:, None]
    return turns, shifts, points + noise * rng.normal(size=points.shape)


def errors(fit, turns, shifts, shape=SHAPE):
    known = ~np.isnan(fit.residuals)
    centre = shape.mean(axis=0)
    there = np.einsum("fij,j->fi", fit.rotations, centre) + fit.translations
    truth = turns.apply(centre) + shifts
    angles = (turns[known].inv() * Rotation.from_matrix(fit.rotations[known])).magnitude()
    distance = np.sqrt(np.mean(np.sum((there - truth)[known] ** 2, axis=1)))
    return distance, np.degrees(np.sqrt(np.mean(angles**2)))


@pytest.mark.parametrize("noise", [0.0, 0.1, 0.5])
def test_on_clean_data_the_answer_is_plain_least_squares(rng, noise):
    _, _, target = moving(rng, noise=noise)
    target[rng.random(target.shape[:2]) < 0.05] = np.nan
    fit = estimate_robust_transforms(SHAPE, target)
    rotations, translations, _ = estimate_rigid_transforms(SHAPE, target)
    assert fit.rejected.any(axis=1).sum() <= 2
    same = ~fit.rejected.any(axis=1)
    np.testing.assert_array_equal(fit.rotations[same], rotations[same])
    np.testing.assert_array_equal(fit.translations[same], translations[same])
    assert fit.noise == pytest.approx(noise, rel=0.05, abs=1e-9)


@pytest.mark.parametrize("bad", range(5))
def test_a_marker_that_slipped_for_good_is_left_out_everywhere(rng, bad):
    turns, _, target = moving(rng)
    direction = rng.normal(size=3)
    target[:, bad] += 10 * turns.apply(direction / np.linalg.norm(direction))
    fit = estimate_robust_transforms(SHAPE, target)
    assert fit.rejected[:, bad].mean() > 0.999
    assert np.delete(fit.rejected, bad, axis=1).sum() <= 2
    others = np.delete(np.arange(5), bad)
    best = estimate_rigid_transforms(SHAPE[others], target[:, others])
    np.testing.assert_allclose(fit.rotations, best[0], atol=1e-6)
    assert fit.noise == pytest.approx(0.1, rel=0.05)


def test_a_marker_that_is_bad_for_a_while_is_left_out_then(rng):
    turns, shifts, target = moving(rng)
    plain = errors(estimate_robust_transforms(SHAPE, target), turns, shifts)
    target[400:700, 3] += [4, 7, -6]
    target[rng.random(target.shape[:2]) < 0.05] = np.nan
    fit = estimate_robust_transforms(SHAPE, target)
    wrong = np.zeros(fit.rejected.shape, dtype=bool)
    wrong[400:700, 3] = ~np.isnan(target[400:700, 3, 0])
    assert (fit.rejected != wrong).sum() <= 3
    found = errors(fit, turns, shifts)
    assert found[0] < 1.3 * plain[0]
    assert found[1] < 1.3 * plain[1]


def test_two_markers_that_exchanged_their_names_are_left_out(rng):
    turns, shifts, target = moving(rng)
    target[200:400, [1, 4]] = target[200:400, [4, 1]]
    fit = estimate_robust_transforms(SHAPE, target)
    assert fit.rejected[200:400][:, [1, 4]].all()
    assert fit.rejected.sum() <= 402
    assert errors(fit, turns, shifts)[1] < 0.15


def test_single_wild_frames_are_found_in_a_short_recording(rng):
    _, _, target = moving(rng, frames=5)
    target[2, 0] += [0, 0, 10]
    fit = estimate_robust_transforms(SHAPE, target)
    assert np.argwhere(fit.rejected).tolist() == [[2, 0]]


def test_four_markers_suffice_to_leave_one_out(rng):
    shape = np.array([[-70.0, 0, -60], [70, 0, -60], [-60, 25, 5], [60, 55, 5]])
    turns, _, target = moving(rng, shape=shape)
    target[100:300, 1] += 10 * turns.apply([0.6, 0.0, 0.8])[100:300]
    fit = estimate_robust_transforms(shape, target)
    assert fit.rejected[100:300, 1].mean() > 0.99
    assert fit.rejected.sum() <= 203


def test_weights_are_reciprocal_variances(rng):
    scales = np.array([1.0, 1, 1, 1, 5])
    turns, shifts, target = moving(rng, noise=0.0)
    target = target + 0.1 * scales[:, None] * rng.normal(size=target.shape)
    weighted = estimate_robust_transforms(SHAPE, target, 1 / scales**2)
    assert weighted.rejected.any(axis=1).sum() <= 2
    assert weighted.noise == pytest.approx(0.1, rel=0.05)
    plain = estimate_rigid_transforms(SHAPE, target)[0]
    angles = (turns.inv() * Rotation.from_matrix(plain)).magnitude()
    assert errors(weighted, turns, shifts)[1] < 0.9 * np.degrees(np.sqrt(np.mean(angles**2)))


def test_weights_of_the_wrong_number_are_refused():
    with pytest.raises(DataError, match="weights"):
        estimate_robust_transforms(SHAPE, SHAPE[None], [1, 1])


def gain(point, size):
    """By how much squares fall without a point that is off in a direction, by two plain fits."""
    target = SHAPE.copy()
    target[point] += size * SLIP
    others = np.delete(np.arange(len(SHAPE)), point)
    complete = estimate_rigid_transforms(SHAPE, target[None])[2][0]
    without = estimate_rigid_transforms(SHAPE[others], target[None, others])[2][0]
    return complete**2 * len(SHAPE) - without**2 * len(others)


SLIP = np.array([0.6, 0.0, 0.8])
# Squares, per variance of the noise, that the gain of the worst of five points exceeds in one
# frame of ten thousand.
CHANCE = 3 * stats.f.ppf(1 - 1e-4 / 5, 3, 1e4)


@pytest.mark.parametrize(
    ("factor", "frames"),
    [(2.0, slice(300, 900)), (8.0, slice(20, None, 40))],
    ids=["for a while", "single frames"],
)
@pytest.mark.parametrize("part", [0.6, 1.8])
def test_a_slip_counts_from_twice_what_chance_explains_and_alone_from_eight_times(
    rng, factor, frames, part
):
    turns, _, target = moving(rng)
    size = optimize.brentq(lambda s: gain(3, s) - part * factor * CHANCE * 0.1**2, 0, 50)
    target[frames, 3] += size * turns.apply(SLIP)[frames]
    rejected = estimate_robust_transforms(SHAPE, target).rejected
    assert rejected[frames, 3].mean() == pytest.approx(1.0 if part > 1 else 0.0, abs=0.02)
    rejected[frames, 3] = False
    assert rejected.sum() <= 2


def test_where_any_point_may_be_the_bad_one_no_good_one_is_left_out(rng):
    """A point of four in a plane that is off the plane may as well be any of the others."""
    shape = np.array([[-60.0, -30, 0], [60, -30, 0], [60, 30, 0], [-60, 30, 0]])
    turns, _, target = moving(rng, shape=shape)
    target[300:900, 1] += 5 * turns.apply([0, 0, 1.0])[300:900]
    rejected = estimate_robust_transforms(shape, target).rejected
    assert not rejected[:, [0, 2, 3]].any()


def test_two_bad_points_in_every_seventh_frame_do_not_pass_for_noise(rng):
    """They raise the ninth decile, which counts for twice the noise of the median at most."""
    turns, _, target = moving(rng)
    target[300:520, 1] += 3 * turns.apply([0, 0.6, 0.8])[300:520]
    target[300:520, 2] += 3 * turns.apply([0.8, 0, -0.6])[300:520]
    rejected = estimate_robust_transforms(SHAPE, target).rejected
    assert rejected[300:520][:, [1, 2]].all()
    assert rejected.sum() <= 442


def test_noise_that_comes_in_stretches_is_noise(rng):
    """The ninth decile counts: a fifth of the frames is noisier, and no point of it is bad."""
    _, _, target = moving(rng)
    target[300:600] += 0.15 * rng.normal(size=(300, 5, 3))
    fit = estimate_robust_transforms(SHAPE, target)
    assert fit.rejected.sum() <= 3


def test_pose_information_is_that_of_small_motions(rng):
    centre = SHAPE.mean(axis=0)
    motion = 1e-6 * rng.normal(size=6)
    moved = Rotation.from_rotvec(motion[:3]).apply(SHAPE - centre) + centre + motion[3:]
    squares = ((moved - SHAPE) ** 2).sum(axis=1)
    information = compute_pose_information(SHAPE, centre)
    np.testing.assert_allclose(motion @ information @ motion, squares, rtol=1e-4)


@pytest.mark.parametrize(("count", "limit", "stride"), [(10, 10, 1), (11, 10, 2), (41, 10, 8)])
def test_rows_are_sampled_at_powers_of_two(count, limit, stride):
    rows = np.arange(count)
    np.testing.assert_array_equal(sample_evenly(rows, limit), rows[::stride])


def slipped(rng, frames, total=600, part=3.0):
    """Without noise the limit is that of noise of a thousandth of a millimetre."""
    turns, _, target = moving(rng, frames=total, noise=0.0)
    size = optimize.brentq(lambda s: gain(3, s) - part * CHANCE * 1e-3**2, 0, 50)
    target[frames, 3] += size * turns.apply(SLIP)[frames]
    return target


@pytest.mark.parametrize("part", [1.98, 2.02])
def test_noise_is_never_taken_to_be_less_than_what_files_hold(rng, part):
    # Six degrees of freedom in each of 600 frames, which are left without the worst point.
    part *= 3 * stats.f.ppf(1 - 1e-4 / 5, 3, 3600) / CHANCE
    fit = estimate_robust_transforms(SHAPE, slipped(rng, slice(200, 500), part=part))
    assert fit.rejected[200:500, 3].all() == (part > 2.0)
    assert fit.rejected.sum() == (300 if part > 2.0 else 0)


def test_a_point_is_bad_that_is_so_in_most_of_twelve_frames_on_either_side(rng):
    fit = estimate_robust_transforms(SHAPE, slipped(rng, slice(200, 212)))
    assert not fit.rejected.any()
    fit = estimate_robust_transforms(SHAPE, slipped(rng, slice(200, 213)))
    assert np.argwhere(fit.rejected).tolist() == [[frame, 3] for frame in range(200, 213)]
    # Nor is the point good in a few frames in which it seems to be.
    target = slipped(rng, slice(None))
    target[300:305] = moving(np.random.default_rng(1), frames=5, noise=0.0)[2]
    assert estimate_robust_transforms(SHAPE, target).rejected[:, 3].all()


def test_a_bad_point_stays_bad_for_a_while_where_nothing_can_be_known(rng):
    """With three points in view none can be judged; frames farther away than 256 do not count."""
    target = slipped(rng, slice(None))
    target[100:, [2, 4]] = np.nan
    rejected = estimate_robust_transforms(SHAPE, target).rejected[:, 3]
    assert rejected[:356].all()
    assert not rejected[356:].any()
    target[450:] = slipped(rng, slice(None))[450:]
    rejected = estimate_robust_transforms(SHAPE, target).rejected[:, 3]
    assert rejected.all()


def test_one_point_of_a_frame_that_is_noisy_all_over_is_left_out_if_it_makes_most_of_it(rng):
    _, _, target = moving(rng)
    target[500:540] += 1.0 * rng.normal(size=(40, 5, 3))
    calm = estimate_robust_transforms(SHAPE, target)
    assert calm.rejected[500:540].mean() < 0.1
    target[500:540, 0] += 15 * SLIP
    fit = estimate_robust_transforms(SHAPE, target)
    assert fit.rejected[500:540, 0].mean() > 0.9
    assert fit.rejected[500:540, 1:].mean() < 0.05


def test_frames_that_are_noisy_all_over_are_judged_by_those_nearby(rng):
    """No point explains them; they do not say that the point that slipped is good again."""
    turns, _, target = moving(rng)
    target[:, 3] += 5 * turns.apply(SLIP)
    target[500:540] += 2.0 * rng.normal(size=(40, 5, 3))
    rejected = estimate_robust_transforms(SHAPE, target).rejected
    assert rejected[500:540, 3].mean() > 0.95


def test_frames_that_any_point_may_explain_are_judged_by_those_nearby(rng):
    """While the point off the plane is hidden, any of the four in it may be the bad one."""
    shape = np.array([[-60.0, -30, 0], [60, -30, 0], [60, 30, 0], [-60, 30, 0], [0, 0, 50]])
    turns, _, target = moving(rng, shape=shape)
    target[:, 1] += 5 * turns.apply([0, 0, 1.0])
    target[500:540, 4] = np.nan
    rejected = estimate_robust_transforms(shape, target).rejected
    assert rejected[:, 1].mean() > 0.99
    assert rejected[500:540, 1].all()


def test_no_more_than_two_points_of_a_frame_are_left_out(rng):
    shape = 60 * rng.normal(size=(9, 3))
    turns, _, target = moving(rng, frames=300, shape=shape)
    for bad in (2, 3):
        slips = target.copy()
        for point in range(bad):
            slips[100:120, point] += 5 * turns.apply(np.eye(3)[point])[100:120]
        rejected = estimate_robust_transforms(shape, slips).rejected[100:120]
        assert rejected[:, :bad].all() == (bad == 2)
        assert not rejected[:, bad:].any()


def test_the_noise_is_that_of_the_median_of_chi_squared():
    """Squares of five points have nine degrees of freedom beside the pose."""
    residuals = np.full(7, np.sqrt(stats.chi2.median(9) / 5))
    assert _measure_noise(residuals, np.ones((7, 5))) == pytest.approx(1.0, rel=2e-3)
    assert np.isnan(_measure_noise(residuals, np.ones((7, 2))))


def test_noise_in_stretches_counts_for_twice_that_of_the_median(rng):
    """However wild a sixth of the frames is; a tenth of noise by half raises the ninth decile."""
    _, _, target = moving(rng)
    wild = target.copy()
    wild[300:550] += 5 * rng.normal(size=(250, 5, 3))
    points = np.ones(5)
    variance, freedom = _estimate_noise(SHAPE, wild, points)
    # Frames that are wild make the median a little larger: it is their 60th percentile.
    median = _estimate_noise(SHAPE, wild[np.r_[0:300, 550:1500]], points)[0]
    assert variance == pytest.approx(4 * median, rel=0.3)
    assert 4.0 < variance / median < 4.9
    assert median == pytest.approx(0.1**2, rel=0.06)
    # Every frame without one of its points leaves three times four coordinates beside a pose.
    assert freedom == 1500 * (3 * 4 - 6)


def test_noise_is_estimated_from_every_second_of_more_than_two_thousand_frames(rng):
    _, _, target = moving(rng, frames=2001)
    target[1::2] += 5 * rng.normal(size=(1000, 5, 3))
    variance, freedom = _estimate_noise(SHAPE, target, np.ones(5))
    assert variance == pytest.approx(0.1**2, rel=0.06)
    assert freedom == 1001 * 6


def test_noise_is_that_of_the_commonest_set_of_four_or_more(rng):
    _, _, target = moving(rng, frames=900)
    target[:500, 4] = np.nan
    target[:, 4] += 40 * rng.normal(size=(900, 3))
    target[500:600, 3] = np.nan
    assert _estimate_noise(SHAPE, target, np.ones(5))[1] == 500 * (3 * 3 - 6)
    target[:, :2] = np.nan
    assert np.isnan(_estimate_noise(SHAPE, target, np.ones(5))[0])


def explain(angle, slip):
    """Squares without each point of a square, of which the second slipped out of the plane."""
    target = SQUARE.copy()
    target[1] += slip * np.array([np.sin(angle) * np.sqrt(0.5), np.sin(angle) / 2, np.cos(angle)])
    rest = [np.delete(np.arange(4), k) for k in range(4)]
    return target, sorted(
        3 * estimate_rigid_transforms(SQUARE[k], target[None, k])[2][0] ** 2 for k in rest
    )


SQUARE = np.array([[-60.0, -30, 0], [60, -30, 0], [60, 30, 0], [-60, 30, 0]])


@pytest.mark.parametrize("part", [0.99, 1.01])
def test_the_better_explanation_is_a_hundred_times_more_likely(rng, part):
    """Minus twice the logarithm of the likelihoods are the squares per variance of the noise."""
    difference = part * 2 * np.log(100) * 1e-3**2
    angle = optimize.brentq(lambda a: np.subtract(*explain(a, 0.5)[1][1::-1]) - difference, 0, 1.5)
    turns, shifts, target = moving(rng, frames=600, noise=0.0, shape=SQUARE)
    frames = slice(0, 600, 30)
    slipped_square = np.stack([turn.apply(explain(angle, 0.5)[0]) for turn in turns[frames]])
    target[frames] = slipped_square + shifts[frames][:, None]
    rejected = estimate_robust_transforms(SQUARE, target).rejected
    assert rejected[frames, 1].all() == rejected.any() == (part > 1)


def test_three_points_tell_the_noise_too():
    residuals = np.full(4, np.sqrt(stats.chi2.median(3) / 3))
    assert _measure_noise(residuals, np.ones((4, 3))) == pytest.approx(1.0, rel=5e-3)
    # Weighted squares of a point of weight 4 are those of four points.
    residuals = np.full(4, np.sqrt(stats.chi2.median(3) / 6))
    assert _measure_noise(residuals, np.tile([4.0, 1, 1], (4, 1))) == pytest.approx(1.0, rel=5e-3)
