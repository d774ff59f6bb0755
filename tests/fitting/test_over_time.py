"""The fit over time: algebra against dense matrices, limits, gaps, deviations, and what it gains.

``pytest -s -m slow`` prints errors beside their bounds, and the lips' gap at closures.
"""

import dataclasses
import tracemalloc

import numpy as np
import pytest

from corpus_tools.demonstration.comparison import FittedRecording, measure_accuracy
from corpus_tools.simulation import Conditions, Session, draw_gesture
from mocap_fit.errors import ConfigurationError, DataError
from mocap_fit.face import Rig
from mocap_fit.fitting import Binding, Layout, bind_markers, fit_orientation, fit_shape
from mocap_fit.fitting import smoothness as algebra
from mocap_fit.fitting.frame_costs import FrameCosts
from mocap_fit.fitting.objective import OBJECTIVES, Evaluator
from mocap_fit.fitting.over_time import fit_over_time
from mocap_fit.fitting.solving import BRIDGED, NOT_FITTED
from mocap_fit.head import remove_head_motion
from mocap_fit.tracks import MarkerTracks

RATE = 60.0


def smooth_values(frames: int, rate: float = RATE) -> np.ndarray:
    """Ten slow gestures."""
    times = np.arange(frames)[:, None] / rate
    return 0.25 + 0.15 * np.sin(2 * np.pi * (0.8 * times + np.arange(10) / 10))


def noisy(tracks: MarkerTracks, noise: float, seed: int = 4) -> MarkerTracks:
    rng = np.random.default_rng(seed)
    return tracks.replace(positions=tracks.positions + rng.normal(0, noise, tracks.positions.shape))


@pytest.fixture(scope="module")
def recording(binding: Binding, make_tracks) -> MarkerTracks:
    """Half a second with 0.3 mm of noise, face markers alone."""
    return noisy(make_tracks(binding, smooth_values(30)).select(binding.names), 0.3)


@pytest.fixture(scope="module")
def alone(binding: Binding, recording: MarkerTracks):
    """The recording fitted frame by frame, by squares."""
    return fit_shape(binding, recording, objective="squares")


def random_system(rng: np.random.Generator, frames: int, count: int):
    """Blocks and bands, and the same matrix in full."""
    roots = rng.normal(size=(frames, count, count))
    blocks = roots @ np.swapaxes(roots, 1, 2) + 0.1 * np.eye(count)
    strengths = rng.uniform(0.5, 2.0, (max(frames - 2, 0), count))
    bands = algebra.build_roughness_bands(frames, 2.0, strengths)
    full = np.zeros((frames, count, frames, count))
    for t in range(frames):
        full[t, :, t, :] = blocks[t]
    second = algebra.compute_curvature(np.eye(frames), 2.0)
    for p in range(count):
        full[:, p, :, p] += second.T @ (strengths[:, p, None] * second)
    return blocks, bands, strengths, full.reshape(frames * count, frames * count)


@pytest.mark.parametrize("frames", [1, 2, 3, 4, 9])
@pytest.mark.parametrize("count", [1, 3])
def test_banded_is_dense(rng, frames, count) -> None:
    blocks, bands, _, full = random_system(rng, frames, count)
    gradient = rng.normal(size=(frames, count))
    far = np.full((frames, count), 1e9)
    step = algebra.minimise_in_box(blocks, bands, gradient, -far, far)
    np.testing.assert_allclose(step.ravel(), np.linalg.solve(full, -gradient.ravel()), atol=1e-8)
    np.testing.assert_allclose(
        algebra.multiply(blocks, bands, gradient).ravel(), full @ gradient.ravel(), atol=1e-9
    )
    inverse = np.linalg.inv(full).reshape(frames, count, frames, count)
    diagonal = np.einsum("tptq->tpq", inverse)
    np.testing.assert_allclose(algebra.compute_inverse_blocks(blocks, bands), diagonal, atol=1e-8)


def test_the_least_in_a_box(rng) -> None:
    """In the box, and no free variable is pulled, and none on a bound is pulled inwards."""
    for _ in range(20):
        blocks, bands, _, full = random_system(rng, 8, 3)
        gradient = rng.normal(0, 5, size=(8, 3))
        lower, upper = -rng.uniform(0, 0.5, (8, 3)), rng.uniform(0, 0.5, (8, 3))
        step = algebra.minimise_in_box(blocks, bands, gradient, lower, upper)
        pull = -(full @ step.ravel()).reshape(8, 3) - gradient
        assert (step >= lower).all()
        assert (step <= upper).all()
        assert ((step > lower) & (step < upper) & (np.abs(pull) > 1e-8)).sum() == 0
        assert (pull[step == lower] <= 1e-8).all()
        assert (pull[step == upper] >= -1e-8).all()
        assert (step == lower).any()


def test_curvature_of_separate_tracks(rng) -> None:
    """Mean and variance are those of the dense posterior."""
    strengths = rng.uniform(0.5, 2.0, (10, 2))
    bands = algebra.build_roughness_bands(12, 3.0, strengths)
    weight = rng.uniform(1.0, 5.0, (12, 2))
    bands[0] += weight
    right = rng.normal(size=(12, 2))
    mean, variance = algebra._compute_curvature_posterior(bands, right, 3.0)
    second = algebra.compute_curvature(np.eye(12), 3.0)
    for p in range(2):
        spread = np.linalg.inv(np.diag(weight[:, p]) + second.T @ (strengths[:, p, None] * second))
        np.testing.assert_allclose(mean[:, p], second @ spread @ right[:, p], atol=1e-9)
        np.testing.assert_allclose(
            variance[:, p], np.diag(second @ spread @ second.T), rtol=1e-7, atol=1e-9
        )


@pytest.mark.parametrize("rate", [30.0, 120.0])
def test_the_likeliest_smoothing_is_the_true_one(rate) -> None:
    rng = np.random.default_rng(8)
    strength, noise, frames = 4.0, 0.02, 4000
    second = rng.normal(0, np.sqrt(strength), frames)
    track = np.cumsum(np.cumsum(second)) / rate**1.5
    seen = track + rng.normal(0, 1.5 * noise, frames)
    seen[100:130] = np.nan
    smoothing, factor = algebra.estimate_smoothing([seen], [np.full(frames, noise)], rate)
    assert factor == pytest.approx(1.5**2, rel=0.15)
    assert smoothing == pytest.approx(factor / strength, rel=0.4)


@pytest.mark.parametrize("objective", OBJECTIVES)
def test_gradient_and_curvature_of_the_costs(binding: Binding, recording, objective) -> None:
    targets = binding.orientation.apply(recording.positions[:3])
    weights = np.tile(binding.weights, (3, 1))
    weights[1, 4] = 0.0
    costs = FrameCosts(Evaluator(binding, objective, 0.4), targets, weights, objective, 0.4)
    values = smooth_values(3) + 0.02
    local = costs.at(values)
    curve = np.zeros_like(local.curvatures)
    slope = np.zeros_like(local.gradients)
    for p in range(10):
        small = 1e-5 * np.eye(10)[p]
        above, below = costs.at(values + small), costs.at(values - small)
        slope[:, p] = (above.costs - below.costs) / 2e-5
        curve[:, p] = (above.gradients - below.gradients) / 2e-5
    np.testing.assert_allclose(local.gradients, slope, rtol=1e-5, atol=1e-4)
    # The second derivative of the markers themselves is left out, as Gauss and Newton do.
    assert np.abs(local.curvatures - curve).max() < 0.15 * np.abs(curve).max()


@pytest.mark.parametrize("objective", OBJECTIVES)
def test_the_answer_is_the_least(binding: Binding, recording, objective) -> None:
    """No small step lowers the total cost, which the start was above."""
    fit = fit_shape(binding, recording, objective=objective)
    weight = 1e-5 if objective == "squares" else 2e-5
    smooth = fit_over_time(binding, recording, fit, objective=objective, weight=[weight] * 10)
    targets = binding.orientation.apply(recording.positions)
    weights = np.tile(binding.weights, (30, 1))
    costs = FrameCosts(Evaluator(binding, objective, 1.0), targets, weights, objective, 1.0)

    def total(values: np.ndarray) -> float:
        rough = algebra.compute_curvature(values, RATE)
        return float(costs.at(values).costs.sum() + weight * np.sum(rough**2))

    found = smooth.parameters.values
    least = total(found)
    assert least < 0.999 * total(fit.parameters.values)
    rng = np.random.default_rng(1)
    for size in (1e-2, 1e-3, 1e-4):
        for _ in range(5):
            assert total(found + rng.normal(0, size, found.shape)) >= least * (1 - 1e-8)


@pytest.mark.parametrize("objective", OBJECTIVES)
def test_without_weight_it_is_the_fit_of_each_frame(binding: Binding, recording, objective) -> None:
    fit = fit_shape(binding, recording, objective=objective)
    smooth = fit_over_time(binding, recording, fit, objective=objective, weight=1e-14)
    np.testing.assert_allclose(smooth.parameters.values, fit.parameters.values, atol=1e-3)
    np.testing.assert_allclose(smooth.costs, fit.costs, rtol=1e-5)


def test_with_much_weight_tracks_are_straight(binding: Binding, recording, alone) -> None:
    smooth = fit_over_time(binding, recording, alone, objective="squares", weight=1e3)
    values = smooth.parameters.values
    times = np.arange(30)
    lines = np.polynomial.Polynomial.fit
    for column, start in zip(values.T, alone.parameters.values.T, strict=True):
        assert np.abs(column - lines(times, column, 1)(times)).max() < 1e-4
        assert np.abs(column - lines(times, start, 1)(times)).max() < 0.1


def test_noise_is_taken_and_the_motion_kept(binding: Binding, recording, alone) -> None:
    truth = smooth_values(30)
    smooth = fit_over_time(binding, recording, alone, objective="squares")
    before = np.sqrt(np.mean((alone.parameters.values - truth) ** 2))
    after = np.sqrt(np.mean((smooth.parameters.values - truth) ** 2))
    assert after < 0.6 * before
    assert smooth.noise == pytest.approx(0.3, rel=0.1)
    step = smooth.parameters.provenance[-1]
    assert step.name == "fit_over_time"
    assert set(step.arguments["median_weights"]) == set(binding.parameter_names)


def test_the_prior_is_the_same_at_any_rate(binding: Binding, make_tracks) -> None:
    """Twice the frames, each worth half as much, give the same tracks."""
    weights = binding.weights
    found = []
    for rate in (60.0, 120.0):
        frames = round(rate / 2) + 1
        made = make_tracks(binding, smooth_values(frames, rate), rate).select(binding.names)
        times = np.arange(frames) / rate
        shift = (
            0.6
            * np.sin(2 * np.pi * 7 * times)[:, None, None]
            * np.sign(np.random.default_rng(3).normal(size=(1, len(weights), 3)))
        )
        shaken = made.replace(positions=made.positions + shift)
        halved = dataclasses.replace(binding, weights=weights * 60.0 / rate)
        fit = fit_shape(halved, shaken, objective="squares")
        smooth = fit_over_time(halved, shaken, fit, objective="squares", weight=[1e-2] * 10)
        found.append(smooth.parameters.values[:: round(rate / 60)])
    moved = np.abs(found[0] - smooth_values(31)).max()
    assert np.abs(found[0] - found[1])[3:-3].max() < 0.1 * moved


def test_bounds_hold(binding: Binding, make_tracks, face: Rig) -> None:
    beyond = np.tile(np.full(10, 2.5), (12, 1)) - np.arange(12)[:, None] * 0.4
    made = noisy(make_tracks(binding, beyond).select(binding.names), 0.3)
    fit = fit_shape(binding, made, objective="squares")
    smooth = fit_over_time(binding, made, fit, objective="squares", weight=1e-4)
    lower, upper = face.bounds.T
    assert (smooth.parameters.values >= lower).all()
    assert (smooth.parameters.values <= upper).all()
    assert (smooth.parameters.values == upper).any()


def test_gaps_are_bridged_or_left_open(binding: Binding, make_tracks) -> None:
    truth = smooth_values(90)
    made = noisy(make_tracks(binding, truth).select(binding.names), 0.1)
    positions = made.positions.copy()
    positions[20:26] = np.nan
    positions[50:70] = np.nan
    positions[:2] = np.nan
    gappy = made.replace(positions=positions, origin=None)
    fit = fit_shape(binding, gappy, objective="squares")
    smooth = fit_over_time(binding, gappy, fit, objective="squares", maximum_gap=0.2)
    values, deviations = smooth.parameters.values, smooth.parameters.standard_deviations
    assert (smooth.status[20:26] == BRIDGED).all()
    assert np.abs(values[20:26] - truth[20:26]).max() < 0.12
    assert (deviations[22:24] > 1.2 * deviations[35:37]).all()
    assert np.isnan(smooth.parameters.residuals[20:26]).all()
    for part in (slice(50, 70), slice(0, 2)):
        assert (smooth.status[part] == NOT_FITTED).all()
        assert np.isnan(values[part]).all()
        assert np.isnan(deviations[part]).all()
    # What is on one side of a long gap knows nothing of the other.
    later = made.between(70 / RATE)
    own = fit_over_time(
        binding,
        later,
        fit_shape(binding, later, objective="squares"),
        objective="squares",
        weight=1e-4,
    )
    cut = fit_over_time(binding, gappy, fit, objective="squares", weight=1e-4)
    np.testing.assert_allclose(cut.parameters.values[70:], own.parameters.values, atol=1e-4)


def test_an_undetermined_parameter_is_bridged_too(binding: Binding, make_tracks) -> None:
    truth = smooth_values(60)
    made = noisy(make_tracks(binding, truth).select(binding.names), 0.1)
    positions = made.positions.copy()
    still = [i for i, n in enumerate(binding.names) if "brow" in n or "nose" in n][:3]
    others = [i for i in range(len(binding.names)) if i not in still]
    positions[20:24, others[3:]] = np.nan
    positions[40:, others[3:]] = np.nan
    gappy = made.replace(positions=positions, origin=None)
    fit = fit_shape(binding, gappy, objective="squares")
    lost = fit.parameters.uncertain
    assert lost[20:24].any()
    smooth = fit_over_time(binding, gappy, fit, objective="squares")
    assert not smooth.parameters.uncertain[:40].any()
    bridged = np.abs(smooth.parameters.values - truth)[20:24][lost[20:24]]
    assert bridged.max() < 0.12
    assert smooth.parameters.uncertain[40:].any()


@pytest.mark.slow
def test_deviations_are_those_of_many_recordings(binding: Binding, make_tracks) -> None:
    truth = smooth_values(40)
    exact = make_tracks(binding, truth).select(binding.names)
    weight = np.full(10, 3e-5)
    errors, deviations = [], []
    for seed in range(60):
        made = noisy(exact, 0.3, seed)
        fit = fit_shape(binding, made, objective="squares")
        smooth = fit_over_time(binding, made, fit, objective="squares", weight=weight)
        errors.append(smooth.parameters.values - truth)
        deviations.append(smooth.parameters.standard_deviations)
    # Within the posterior lies the prior's part of the error too, which these calm tracks have
    # less of: it is an upper limit, and not far above.
    ratio = np.sqrt(
        np.mean(np.square(errors), axis=(0, 1)) / np.mean(np.square(deviations), (0, 1))
    )
    print("\nerror over posterior deviation:", ratio.round(2))
    assert (ratio < 1.1).all()
    assert (ratio > 0.5).all()


def test_deviations_for_tracks_of_the_prior() -> None:
    """Tracks drawn from the prior are as far from the posterior's mean as it says."""
    rng = np.random.default_rng(6)
    frames, count, draws, strength = 12, 2, 4000, 3.0
    roots = rng.normal(size=(frames, 4, count))
    blocks = np.einsum("tmp,tmq->tpq", roots, roots) + 0.5 * np.eye(count)
    bands = algebra.build_roughness_bands(frames, 2.0, np.full((frames - 2, count), 1 / strength))
    squares = np.zeros((frames, count))
    factor = np.linalg.cholesky(blocks)
    far = np.full((frames, count), 1e9)
    for _ in range(draws // 10):
        second = rng.normal(0, np.sqrt(strength), (frames, count)) / 2.0**1.5
        truth = np.cumsum(np.cumsum(second, axis=0), axis=0)
        seen = np.einsum("tpq,tq->tp", blocks, truth) + np.einsum(
            "tpq,tq->tp", factor, rng.normal(size=(frames, count))
        )
        squares += (algebra.minimise_in_box(blocks, bands, -seen, -far, far) - truth) ** 2
    expected = np.einsum("tpp->tp", algebra.compute_inverse_blocks(blocks, bands))
    np.testing.assert_allclose(squares.sum() / (draws // 10), expected.sum(), rtol=0.06)


@pytest.mark.parametrize("frames", [1, 2, 3])
@pytest.mark.parametrize("weight", [None, 1e-4])
def test_few_frames(binding: Binding, recording, frames, weight) -> None:
    few = recording.between(0.0, frames / RATE)
    fit = fit_shape(binding, few)
    smooth = fit_over_time(binding, few, fit, weight=weight)
    assert np.isfinite(smooth.parameters.values).all()
    assert np.isfinite(smooth.parameters.standard_deviations).all()
    if frames < 3:
        np.testing.assert_allclose(smooth.parameters.values, fit.parameters.values, atol=1e-3)


def test_without_noise_nothing_is_smoothed(binding: Binding, make_tracks) -> None:
    truth = smooth_values(40)
    made = make_tracks(binding, truth)
    smooth = fit_over_time(
        binding, made, fit_shape(binding, made, objective="squares"), objective="squares"
    )
    np.testing.assert_allclose(smooth.parameters.values, truth, atol=1e-3)


def test_pose_corrections_are_kept(binding: Binding, make_tracks) -> None:
    made = noisy(make_tracks(binding, smooth_values(15)), 0.2)
    fit = fit_shape(binding, made, objective="squares", refine_pose=True)
    smooth = fit_over_time(binding, made, fit, objective="squares", weight=1e-14)
    np.testing.assert_array_equal(smooth.pose_corrections, fit.pose_corrections)
    # The pose is held where it was best for the shape, so that the shape is best there too.
    np.testing.assert_allclose(smooth.parameters.values, fit.parameters.values, atol=2e-3)


def test_memory_grows_with_the_frames(binding: Binding, make_tracks) -> None:
    peaks = []
    for frames in (300, 600):
        values = np.resize(smooth_values(75), (frames, 10))
        made = noisy(make_tracks(binding, values).select(binding.names), 0.2)
        fit = fit_shape(binding, made, objective="squares")
        tracemalloc.start()
        fit_over_time(binding, made, fit, objective="squares", weight=1e-4)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] < 2.2 * peaks[0]


def test_progress(binding: Binding, recording, alone) -> None:
    done: list[int] = []
    fit_over_time(binding, recording, alone, objective="squares", progress=done.append)
    assert done[-1] == 30


@pytest.mark.parametrize(
    ("setting", "words"),
    [
        ({"objective": "cubes"}, "objective"),
        ({"huber_threshold": 0.0}, "Huber"),
        ({"weight": -1.0}, "weight"),
        ({"weight": np.nan}, "weight"),
        ({"weight": [1.0, 2.0]}, "weight"),
        ({"maximum_gap": -1.0}, "gap"),
        ({"maximum_rounds": 0}, "rounds"),
    ],
)
def test_impossible_settings(binding: Binding, recording, alone, setting, words) -> None:
    with pytest.raises(ConfigurationError, match=words):
        fit_over_time(binding, recording, alone, **setting)


def test_fit_and_recording_belong_together(binding: Binding, recording, alone) -> None:
    with pytest.raises(DataError, match="not of the recording"):
        fit_over_time(binding, recording.between(0.0, 0.2), alone)
    with pytest.raises(DataError, match="lacks markers of the layout"):
        fit_over_time(binding, recording.select(binding.names[1:]), alone)
    other = dataclasses.replace(alone, marker_names=alone.marker_names[::-1])
    with pytest.raises(DataError, match="another face or layout"):
        fit_over_time(binding, recording, other)


@pytest.mark.slow
@pytest.mark.parametrize("objective", ["distances", "squares"])
def test_the_error_is_below_the_bound_of_a_frame(layout: Layout, face: Rig, objective) -> None:
    session = Session(layout, face, Conditions(noise=0.3, duration=30))
    first, second = np.random.default_rng(7).spawn(2)
    reference = session.record_reference(first)
    binding = bind_markers(face, layout, reference, fit_orientation(face, layout, reference))
    made = session.record(second, "sim")
    weights = {m.name: m.weight for m in layout.head_markers}
    with pytest.warns(UserWarning, match="pose is not known"):
        still, motion = remove_head_motion(
            made.recording, reference, names=tuple(weights), weights=weights
        )
    alone = fit_shape(binding, still, objective=objective)
    smooth = fit_over_time(binding, still, alone, objective=objective)
    before, after = (
        measure_accuracy(
            [FittedRecording(made.recording, f, motion, made.parameters, made.pose)], binding, 0.3
        )
        for f in (alone, smooth)
    )
    score = (smooth.parameters.values - made.parameters.values) / (
        smooth.parameters.standard_deviations
    )
    told = np.sqrt(np.nanmean(np.where(np.isfinite(score), score, np.nan) ** 2, axis=0))
    print(f"\n{objective}, noise 0.3 mm, estimated pose: error in % of range")
    for i, name in enumerate(after.names):
        print(
            f"  {name:22s} bound of a frame {100 * after.bounds[i]:5.2f}  frame by frame "
            f"{100 * before.errors[i]:5.2f}  over time {100 * after.errors[i]:5.2f}  "
            f"error / deviation {told[i]:.2f}"
        )
    assert (after.errors < 0.9 * before.bounds).all()
    assert np.mean(after.errors / before.bounds) < 0.7
    assert (told < 1.4).all()


@pytest.mark.slow
@pytest.mark.parametrize("every", [1.0, 3.0, 10.0])
@pytest.mark.parametrize("objective", ["distances", "squares"])
def test_lip_closures_stay_closed(binding: Binding, face: Rig, make_tracks, objective, every):
    """Lips together for 60 to 120 ms, from and to an open vowel within 50 ms; often or seldom."""
    rng = np.random.default_rng(3)
    times, truth, spans = closures(face.parameter_names, rng, every)
    made = noisy(make_tracks(binding, truth).select(binding.names), 0.3)
    alone = fit_shape(binding, made, objective=objective)
    smooth = fit_over_time(binding, made, alone, objective=objective)
    upper, lower = (face.mesh.get_feature_point(name) for name in ("2.2", "2.3"))
    near = np.zeros(len(times), dtype=bool)
    for start, end in spans:
        near |= (times >= start - 0.05) & (times <= end + 0.05)
    gaps = np.full((3, len(times)), np.inf)
    for row, tracks in enumerate((truth, alone.parameters.values, smooth.parameters.values)):
        for frame in np.flatnonzero(near):
            vertices = face.deform(tracks[frame])
            gaps[row, frame] = vertices[upper, 1] - vertices[lower, 1]
    held = [(times >= start) & (times <= end) for start, end in spans]
    least = np.array([gaps[:, h].min(axis=1) for h in held])
    mean = np.array([gaps[:, h].mean(axis=1) for h in held])
    print(
        f"\n{objective}, a closure every {every:g} s: mean gap while closed, mm: true "
        f"{mean[:, 0].mean():.2f}, frame by frame {mean[:, 1].mean():.2f}, over time "
        f"{mean[:, 2].mean():.2f}; smallest gap {least.mean(axis=0).round(2)}; largest "
        f"over time - true {(least[:, 2] - least[:, 0]).max():.2f}, over time - frame by frame "
        f"{(least[:, 2] - least[:, 1]).max():.2f}"
    )
    assert np.abs(mean[:, 0]).max() < 0.3
    assert (mean[:, 2] - mean[:, 1]).mean() < 0.1
    assert (least[:, 2] - least[:, 0]).max() < 0.3
    # The smallest of several noisy gaps is below the truth by the noise, which smoothing takes.
    assert (least[:, 2] - least[:, 1]).mean() < 0.3
    errors = [np.sqrt(np.mean((f.parameters.values - truth) ** 2, axis=0)) for f in (alone, smooth)]
    assert (errors[1] < 0.7 * errors[0]).all()


def closures(names: tuple[str, ...], rng: np.random.Generator, every: float):
    """Twenty seconds of an open vowel with brief bilabial closures, and when they are."""
    times = np.arange(round(20 * RATE)) / RATE
    closed, spans = np.zeros_like(times), []
    for i, start in enumerate(np.arange(0.5, 19.5, every) + 0.05):
        end = start + (0.06, 0.08, 0.1, 0.12)[i % 4]
        into = np.clip((times - start) / 0.05 + 1, 0, 1)
        out = np.clip((end - times) / 0.05 + 1, 0, 1)
        closed = np.maximum(closed, 0.5 - 0.5 * np.cos(np.pi * np.minimum(into, out)))
        spans.append((start, end))

    def slow(lower: float, upper: float) -> np.ndarray:
        return draw_gesture(rng, len(times), RATE, 1.5, lower, upper)

    tracks = dict.fromkeys(names, np.zeros_like(times)) | {
        "lip_rounding": slow(-0.1, 0.15),
        "left_corner_stretch": slow(-0.1, 0.3),
        "right_corner_stretch": slow(-0.1, 0.3),
        "jaw_thrust": slow(-0.1, 0.2),
        "jaw_shift": slow(-0.1, 0.1),
        "jaw_rotation": (0.3 + slow(-0.04, 0.04)) * (1 - closed) + 0.15 * closed,
        "lower_lip_depression": slow(0.0, 0.15) * (1 - closed) - 0.33 * closed,
        "upper_lip_raise": slow(0.0, 0.1) * (1 - closed) - 0.165 * closed,
    }
    return times, np.stack([tracks[name] for name in names], axis=1), spans
