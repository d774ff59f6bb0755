"""Newton's method: its answers are minima, and the same as nlopt's.

``pytest -s -m slow`` prints the frames in which the two differ, and why.
"""

from collections.abc import Sequence

import numpy as np
import pytest

from corpus_tools.simulation import Conditions, Session, draw_gesture
from mocap_fit.fitting import Binding, ShapeFit, bind_markers, fit_orientation, fit_shape
from mocap_fit.fitting.objective import OBJECTIVES, Evaluator
from mocap_fit.fitting.solving import NEWTON, NEWTON_NLOPT
from mocap_fit.head import remove_head_motion
from mocap_fit.tracks import FloatArray, MarkerTracks

compiled_solver = pytest.importorskip("mocap_fit.fitting.compiled_solver", reason="needs numba")

BOTH = pytest.mark.parametrize("solver", [NEWTON, NEWTON_NLOPT])
# Below the residuals that 0.3 mm of noise leaves in most markers.
KNEE = 0.4
EVERY = pytest.mark.parametrize("objective", OBJECTIVES)


def speech(rng: np.random.Generator, frames: int) -> FloatArray:
    """Smooth parameter tracks, `(frames, 10)`."""
    return np.stack([draw_gesture(rng, frames, 60.0, 3.0, -0.2, 0.9) for _ in range(10)], axis=1)


def seen(binding: Binding, values: FloatArray, noise: float, rng) -> MarkerTracks:
    """The face markers of parameters over time, with noise."""
    positions, _ = Evaluator(binding, "squares", 1.0).evaluate_frames(np.atleast_2d(values))
    return MarkerTracks(binding.names, 60.0, positions + rng.normal(0.0, noise, positions.shape))


class Frames:
    """Costs and gradients of frames."""

    def __init__(self, binding: Binding, objective: str, threshold: float = KNEE) -> None:
        self._evaluator = Evaluator(binding, objective, threshold)
        self.bounds = binding.rig.bounds

    def take(self, target: FloatArray) -> None:
        self._target, self._seen = target, np.isfinite(target[:, 0])
        self._evaluator.set_frame(target, self._seen)

    def cost(self, values: FloatArray) -> float:
        return self._evaluator.cost(values, np.zeros(len(values)))

    def nearest(self, values: FloatArray) -> float:
        """The least distance of a marker: where it is nil, distances have no slope."""
        positions, _ = self._evaluator.evaluate(values)
        return float(np.linalg.norm((positions - self._target)[self._seen], axis=1).min())

    def push(self, values: FloatArray) -> float:
        """How much the cost would fall along the whole range of a parameter, at its slope here.

        What a bound holds back does not count: it is nil at a minimum within the bounds.
        """
        slope = np.zeros(len(values))
        self._evaluator.cost(values, slope)
        lower, upper = self.bounds.T
        free = ((values > lower) | (slope < 0)) & ((values < upper) | (slope > 0))
        return float((np.abs(slope) * free * (upper - lower)).max())


def converged(
    binding: Binding, recording: MarkerTracks, solver: str, monkeypatch: pytest.MonkeyPatch, **more
) -> ShapeFit:
    """The fit at a tolerance of 1e-12."""
    with monkeypatch.context() as patch:
        for name in ("_NEWTON_TOLERANCE", "VALUE_TOLERANCE", "COST_TOLERANCE"):
            patch.setattr(compiled_solver, name, 1e-12)
        return fit_shape(binding, recording, solver=solver, maximum_evaluations=5000, **more)


@EVERY
@BOTH
def test_the_answer_is_a_minimum(binding: Binding, rng, objective, solver) -> None:
    """No gradient is left within the bounds, and no small step that the bounds allow falls."""
    frames = Frames(binding, objective)
    lower, upper = frames.bounds.T
    # Some frames are beyond what the bounds allow.
    recording = seen(binding, 2.0 * speech(rng, 60), 0.3, rng)
    fit = fit_shape(binding, recording, objective=objective, huber_threshold=KNEE, solver=solver)
    smooth, held = 0, 0
    for target, values, cost in zip(
        recording.positions, fit.parameters.values, fit.costs, strict=True
    ):
        assert ((values >= lower) & (values <= upper)).all()
        frames.take(target)
        assert frames.cost(values) == pytest.approx(cost, rel=1e-12)
        if objective != "distances" or frames.nearest(values) > 1e-2:
            smooth += 1
            assert frames.push(values) < 1e-2 * cost
        for size in (1e-2, 1e-3, 1e-4):
            for step in rng.normal(0.0, size, (20, len(values))):
                assert frames.cost(np.clip(values + step, lower, upper)) >= cost * (1 - 1e-7)
        held += int(((values == lower) | (values == upper)).any())
    assert smooth >= 30
    assert held >= 3


@EVERY
def test_newton_and_nlopt_agree(binding: Binding, rng, objective, monkeypatch) -> None:
    recording = seen(binding, speech(rng, 300), 0.3, rng)
    newton, nlopt = (
        converged(
            binding, recording, solver, monkeypatch, objective=objective, huber_threshold=KNEE
        )
        for solver in (NEWTON, "LD_SLSQP")
    )
    reach = np.ptp(binding.rig.bounds, axis=1)
    apart = np.abs(newton.parameters.values - nlopt.parameters.values) / reach
    assert apart.max() < 1e-3
    # To Newton a distance is a nanometre at least, and nlopt stops short where one is nil.
    np.testing.assert_allclose(newton.costs, nlopt.costs, rtol=1e-5)
    assert np.median(np.abs(newton.costs / nlopt.costs - 1.0)) < 1e-9


def test_the_default_is_as_low_as_newton_alone(binding: Binding, rng) -> None:
    recording = seen(binding, speech(rng, 300), 0.3, rng)
    alone = fit_shape(binding, recording, solver=NEWTON)
    certified = fit_shape(binding, recording)
    excess = certified.costs / alone.costs - 1.0
    assert excess.mean() < 1e-7
    assert excess.max() < 1e-5
    assert certified.evaluations.mean() < 15


@BOTH
def test_bounds_are_reached_and_kept(binding: Binding, rng, solver) -> None:
    """Markers from far beyond the bounds: those parameters end at their bounds, to the bit."""
    bounds = binding.rig.bounds
    beyond = np.array([bounds[:, 1] + 0.5, bounds[:, 0] - 0.5])
    fit = fit_shape(binding, seen(binding, beyond, 0.0, rng), solver=solver)
    lower, upper = bounds.T
    assert ((fit.parameters.values >= lower) & (fit.parameters.values <= upper)).all()
    assert (fit.parameters.values[0] == upper).sum() >= 3
    assert (fit.parameters.values[1] == lower).sum() >= 3


@EVERY
@BOTH
def test_hidden_markers_are_left_out(binding: Binding, rng, objective, solver) -> None:
    """A hidden marker has no say: the fit is that of a layout without it."""
    values = speech(rng, 40)
    recording = seen(binding, values, 0.2, rng)
    positions = recording.positions.copy()
    positions[rng.random(positions.shape[:2]) < 0.15] = np.nan
    fit = fit_shape(
        binding,
        MarkerTracks(binding.names, 60.0, positions),
        objective=objective,
        huber_threshold=KNEE,
        solver=solver,
    )
    assert np.isfinite(fit.parameters.standard_deviations).all()
    np.testing.assert_allclose(fit.parameters.values, values, atol=0.6)
    frames = Frames(binding, objective)
    smooth = 0
    for target, found, cost in zip(positions, fit.parameters.values, fit.costs, strict=True):
        frames.take(target)
        if objective != "distances" or frames.nearest(found) > 1e-2:
            smooth += 1
            assert frames.push(found) < 1e-2 * cost
    assert smooth >= 20


@BOTH
def test_what_no_marker_shows_keeps_its_value(binding: Binding, rng, solver) -> None:
    values = np.repeat(speech(rng, 200)[[20, 120]], [1, 3], axis=0)
    recording = seen(binding, values, 0.1, rng)
    _, jacobian = binding.evaluate(values[0])
    moved = np.abs(jacobian[:, :, 2]).max(axis=1) > 1e-9  # upper lip retraction
    positions = recording.positions.copy()
    positions[1:3, moved] = np.nan
    fit = fit_shape(binding, MarkerTracks(binding.names, 60.0, positions), solver=solver)
    found = fit.parameters.values
    # nlopt's last touch on the frame before does not count: Newton has gone ahead by then.
    slack = 0.0 if solver == NEWTON else 1e-5
    np.testing.assert_allclose(found[1:3, 2], found[0, 2], atol=slack, rtol=0.0)
    assert np.isinf(fit.parameters.standard_deviations[1:3, 2]).all()
    # Seen again, it goes where the markers are.
    assert abs(found[3, 2] - values[3, 2]) < 0.2
    others = np.isfinite(fit.parameters.standard_deviations[1])
    assert others.sum() >= 3
    np.testing.assert_allclose(found[1, others], values[1, others], atol=0.3)


@EVERY
@BOTH
def test_without_noise_the_truth_is_found(binding: Binding, rng, objective, solver) -> None:
    """Residuals of nil, where a distance has no slope, are no trouble. (A warning is an error.)"""
    values = speech(rng, 80)
    fit = fit_shape(
        binding,
        seen(binding, values, 0.0, rng),
        objective=objective,
        huber_threshold=KNEE,
        solver=solver,
    )
    assert np.isfinite(fit.costs).all()
    assert (fit.costs < 1e-3).all()
    np.testing.assert_allclose(fit.parameters.values, values, atol=1e-4)
    again = fit_shape(
        binding,
        seen(binding, np.zeros((3, 10)), 0.0, rng),
        objective=objective,
        huber_threshold=KNEE,
        solver=solver,
    )
    np.testing.assert_allclose(again.parameters.values, 0.0, atol=1e-6)


@EVERY
@BOTH
def test_a_start_from_far_away(binding: Binding, rng, objective, solver) -> None:
    """Frames that have nothing to do with the one before are as good as from anywhere else."""
    lower, upper = binding.rig.bounds.T
    values = np.where(rng.random((60, 10)) < 0.5, 0.7 * lower, 0.7 * upper)
    recording = seen(binding, values, 0.3, rng)
    far = fit_shape(binding, recording, objective=objective, huber_threshold=KNEE, solver=solver)
    for frame in range(0, 60, 6):
        alone = seen(binding, values[frame], 0.0, rng).replace(
            positions=recording.positions[frame : frame + 1]
        )
        # A frame before that is nearly the same: the truth.
        near = MarkerTracks(
            binding.names,
            60.0,
            np.concatenate([seen(binding, values[frame], 0.0, rng).positions, alone.positions]),
        )
        best = fit_shape(binding, near, objective=objective, huber_threshold=KNEE, solver=solver)
        assert far.costs[frame] == pytest.approx(best.costs[1], rel=1e-5)


@BOTH
def test_a_rough_mixture_never_gives_nan(binding: Binding, rng, solver) -> None:
    """Markers that no face could have are fitted as well as can be, and are no trouble later."""
    values = speech(rng, 30)
    positions = seen(binding, values, 0.2, rng).positions.copy()
    positions[10] *= -3.0
    positions[12] = positions[12, 0]
    positions[14] += 1e4
    fit = fit_shape(binding, MarkerTracks(binding.names, 60.0, positions), solver=solver)
    assert np.isfinite(fit.parameters.values).all()
    assert np.isfinite(fit.costs).all()
    clean = fit_shape(binding, MarkerTracks(binding.names, 60.0, positions[16:]), solver=solver)
    np.testing.assert_allclose(fit.costs[16:], clean.costs, rtol=1e-5)


class Tally:
    """Frames in which Newton and nlopt agree, and what is known of those in which they do not."""

    def __init__(self) -> None:
        self.frames, self.differ = 0, []

    def add(self, binding: Binding, still: MarkerTracks, fits: Sequence[ShapeFit]) -> None:
        newton, nlopt = fits
        fitted = newton.fitted
        self.frames += int(fitted.sum())
        reach = np.ptp(binding.rig.bounds, axis=1)
        apart = np.abs(newton.parameters.values - nlopt.parameters.values) / reach
        targets = binding.orientation.apply(still.positions[:, still.indices(binding.names)])
        for frame in np.flatnonzero(fitted & (np.nan_to_num(apart).max(axis=1) > 1e-3)):
            self.differ.append(self._why(binding, still.name, frame, targets[frame], fits, apart))

    def _why(self, binding, name, frame, target, fits, apart) -> str:
        newton, nlopt = (fit.parameters.values[frame] for fit in fits)
        costs = [fit.costs[frame] for fit in fits]
        worst = int(np.argmax(apart[frame]))
        ahead = costs[0] / costs[1] - 1.0
        # The cost along the line from one answer to the other: a hill is between two minima.
        frames = Frames(binding, "distances")
        frames.take(target)
        line = [frames.cost(newton + t * (nlopt - newton)) for t in np.linspace(0.0, 1.0, 21)]
        hill = max(line) / max(costs) - 1.0
        if hill > 1e-9:
            why = f"two minima, a hill of {hill:.1e} between"
        elif abs(ahead) < 1e-9:
            why = "a flat valley: the costs are the same"
        else:
            why = f"{'nlopt' if ahead < 0 else 'Newton'} stopped short"
        return (
            f"{name} frame {frame}: {binding.parameter_names[worst]} differs by "
            f"{100 * apart[frame, worst]:.2f} % of range, Newton's cost {ahead:+.1e}: {why}"
        )

    def show(self, title: str) -> None:
        print(
            f"\n{title}: {len(self.differ)} of {self.frames} frames differ by over 0.1 % of range"
        )
        for line in self.differ:
            print(f"  {line}")


@pytest.mark.slow
def test_newton_and_nlopt_agree_on_many_simulated_frames(face, layout, monkeypatch) -> None:
    tally = Tally()
    names = [marker.name for marker in layout.head_markers]
    for seed, generator in enumerate(np.random.default_rng(2026).spawn(16)):
        noise = (0.1, 0.3, 0.3, 0.5)[seed % 4]
        session = Session(layout, face, Conditions(noise=noise, duration=5.0))
        reference = session.record_reference(generator)
        binding = bind_markers(face, layout, reference, fit_orientation(face, layout, reference))
        recording = session.record(generator, f"simulated {seed} ({noise} mm)").recording
        still, _ = remove_head_motion(recording, reference, names=names)
        tally.add(
            binding,
            still,
            [converged(binding, still, s, monkeypatch) for s in (NEWTON, "LD_SLSQP")],
        )
    tally.show("simulated")
    assert tally.frames > 4500
    assert len(tally.differ) <= 1e-3 * tally.frames


@pytest.mark.slow
@pytest.mark.real_data
def test_newton_and_nlopt_agree_on_real_recordings(data_folder, monkeypatch) -> None:
    from mocap_fit import read_tracks
    from mocap_fit.fitting import fit_speaker
    from mocap_fit.head import match_size

    folder = data_folder / "grid_s1"
    speaker = fit_speaker("built-in", "grid_s1", folder / "reference.tsv")
    weights = {m.name: m.weight for m in speaker.layout.head_markers}
    tally = Tally()
    for path in sorted((folder / "tsv").glob("*.tsv")):
        recording, _ = match_size(read_tracks(path), speaker.reference, tuple(weights))
        still, _ = remove_head_motion(
            recording, speaker.reference, names=tuple(weights), weights=weights
        )
        tally.add(
            speaker.binding,
            still,
            [converged(speaker.binding, still, s, monkeypatch) for s in (NEWTON, "LD_SLSQP")],
        )
    tally.show("grid_s1")
    assert tally.frames > 20_000
    assert len(tally.differ) <= 1e-3 * tally.frames
