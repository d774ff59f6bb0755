"""The ways to nlopt give the same answers: through C, through Python, with and without numba."""

import subprocess
import sys
import textwrap
import weakref
from pathlib import Path

import nlopt
import numpy as np
import pytest

from mocap_fit.errors import MocapFitWarning
from mocap_fit.fitting import Binding, fit_shape
from mocap_fit.fitting.nlopt_solver import NloptSolver
from mocap_fit.fitting.solving import ALGORITHMS
from mocap_fit.tracks import MarkerTracks

native = pytest.importorskip("mocap_fit.fitting.native", reason="needs numba")
from mocap_fit.fitting.compiled_solver import CompiledSolver  # noqa: E402
from mocap_fit.fitting.packed_binding import allocate_aligned, pack, pack_frames  # noqa: E402

ROOT = Path(__file__).parents[2]
here = pytest.mark.skipif(native.load_library() is None, reason="this nlopt shows no C functions")


@pytest.fixture
def recording(binding: Binding, make_tracks, some_values) -> MarkerTracks:
    """A few frames of slow motion with noise, and some markers hidden."""
    rng = np.random.default_rng(8)
    steps = np.linspace(0.0, 0.2, 6)[:, None]
    exact = make_tracks(binding, some_values + steps).select(binding.names)
    positions = exact.positions + rng.normal(0.0, 0.2, exact.positions.shape)
    positions[3, 4:7] = np.nan
    return MarkerTracks(exact.names, exact.rate, positions, name="slow")


def solved(solver, binding: Binding, recording: MarkerTracks):
    targets = binding.orientation.apply(recording.positions)
    head = np.zeros((len(targets), 0, 3))
    return solver.solve(targets, head, np.ones(len(targets), dtype=bool))


@here
@pytest.mark.parametrize("objective", ["distances", "squares", "huber"])
@pytest.mark.parametrize("algorithm", ["LD_SLSQP", "LD_LBFGS", "LD_VAR2", "LN_BOBYQA"])
def test_c_and_python_give_the_same(binding: Binding, recording, algorithm, objective) -> None:
    reach = np.ptp(binding.rig.bounds, axis=1)
    through_c = solved(
        CompiledSolver(binding, objective, 0.4, solver=algorithm, maximum_evaluations=3000),
        binding,
        recording,
    )
    through_python = solved(
        NloptSolver(
            binding,
            objective,
            0.4,
            algorithm=algorithm,
            refine_pose=False,
            maximum_evaluations=3000,
        ),
        binding,
        recording,
    )
    np.testing.assert_allclose(through_c.costs, through_python.costs, rtol=1e-5)
    apart = np.abs(through_c.values - through_python.values) / reach
    assert apart.max() < 2e-3
    assert (through_c.evaluations > 1).all()


@here
@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_every_algorithm_keeps_to_the_limit(binding: Binding, recording, algorithm) -> None:
    solver = CompiledSolver(binding, "distances", 1.0, solver=algorithm, maximum_evaluations=9)
    found = solved(solver, binding, recording)
    # Some of them end the step that they are in.
    assert (found.evaluations <= 2 * 9).all()
    assert np.isfinite(found.values).all()
    lower, upper = binding.rig.bounds.T
    assert ((found.values >= lower) & (found.values <= upper)).all()


@here
def test_the_best_point_is_kept(binding: Binding, recording) -> None:
    """The cost that is told is the cost of the answer that is given."""
    solver = CompiledSolver(binding, "distances", 1.0, solver="LN_PRAXIS", maximum_evaluations=40)
    found = solved(solver, binding, recording)
    targets = binding.orientation.apply(recording.positions)
    for target, values, cost in zip(targets, found.values, found.costs, strict=True):
        distances = np.linalg.norm(binding.evaluate(values)[0] - target, axis=1)
        assert binding.weights[0] * np.nansum(distances) == pytest.approx(cost, rel=1e-9)


@here
def test_solvers_leave_nothing(binding: Binding, monkeypatch) -> None:
    """Of a thousand solvers that are dropped, each frees what nlopt made for it, once."""
    library = native.load_library()
    create, destroy = library.nlopt_create, library.nlopt_destroy
    alive: set[int] = set()
    made = 0

    def counting_create(*arguments: int) -> int:
        nonlocal made
        address = create(*arguments)
        assert address not in alive
        alive.add(address)
        made += 1
        return address

    def counting_destroy(address: int) -> None:
        alive.remove(address)
        destroy(address)

    monkeypatch.setattr(library, "nlopt_create", counting_create)
    monkeypatch.setattr(library, "nlopt_destroy", counting_destroy)
    packed, bounds = pack(binding), np.ascontiguousarray(binding.rig.bounds)
    frames = pack_frames(binding.evaluate(binding.reference_parameters)[0][None], binding.weights)
    start, free = np.full((1, 10), 0.1), np.zeros((1, 10), dtype=bool)
    for _ in range(1000):
        solver = native.NativeSolver(
            packed,
            objective=0,
            threshold=1.0,
            algorithm=nlopt.LD_SLSQP,
            scale=np.ones(10),
            bounds=bounds,
            tolerances=(1e-7, 1e-11),
            maximum_evaluations=1,
        )
        _, _, evaluations, _ = solver.solve(frames, start, start[0], free)
        assert evaluations[0] >= 1
    # No more than the last, and nothing waits for the garbage collector.
    assert made == 1000
    assert len(alive) == 1
    gone = weakref.ref(solver)
    del solver
    assert gone() is None
    assert not alive


def test_without_c_functions_the_answers_are_the_same(
    binding: Binding, recording, monkeypatch
) -> None:
    """Where nlopt's wheel shows no functions, its Python classes do it."""
    fast = fit_shape(binding, recording)
    monkeypatch.setattr(native, "load_library", lambda: None)
    slow = fit_shape(binding, recording)
    reach = np.ptp(binding.rig.bounds, axis=1)
    apart = np.abs(fast.parameters.values - slow.parameters.values) / reach
    assert apart.max() < 1e-4
    np.testing.assert_allclose(slow.costs, fast.costs, rtol=1e-6)
    # Newton's method needs no nlopt.
    newton = fit_shape(binding, recording, solver="newton")
    np.testing.assert_allclose(newton.costs, fast.costs, rtol=1e-6)


@pytest.mark.parametrize("through", ["C", "Python"])
@pytest.mark.parametrize("algorithm", ["LN_PRAXIS", "LN_SBPLX", "LD_LBFGS", "newton-nlopt"])
def test_what_was_solved_before_does_not_count(
    binding: Binding, recording, monkeypatch, algorithm, through
) -> None:
    """The same bytes again: results do not depend on which process fitted what before."""
    if through == "Python":
        monkeypatch.setattr(native, "load_library", lambda: None)
    first, second = (
        fit_shape(binding, recording, solver=algorithm, maximum_evaluations=300).parameters.values
        for _ in range(2)
    )
    np.testing.assert_array_equal(first, second)


def test_newton_alone_where_it_is_not_to_be_had(binding: Binding, make_tracks, some_values):
    """With a refined pose another solver does it, and says so."""
    whole = make_tracks(binding, some_values)
    with pytest.warns(MocapFitWarning, match="'newton' is not available"):
        fit = fit_shape(binding, whole, solver="newton", objective="squares", refine_pose=True)
    np.testing.assert_allclose(fit.parameters.values[0], some_values, atol=1e-4)


_WITHOUT_NUMBA = """
    import sys

    class Blocked:
        def find_spec(self, name, path=None, target=None):
            if name.split(".")[0] in ("numba", "llvmlite"):
                raise ImportError(f"no module named {name}")

    sys.meta_path.insert(0, Blocked())
    import numpy as np
    from corpus_tools.simulation import Conditions, Session
    from mocap_fit.face import load_face
    from mocap_fit.fitting import fit_shape, load_layout
    from mocap_fit.tracks import MarkerTracks

    binding = Session(load_layout("face30-head5"), load_face(), Conditions(noise=0.0)).binding
    stored = np.load(sys.argv[1])
    recording = MarkerTracks(binding.names, 60.0, stored["positions"], name="slow")
    fits = {o: fit_shape(binding, recording, objective=o) for o in ("distances", "squares")}
    assert "numba" not in sys.modules
    np.savez(
        sys.argv[2],
        **{f"{o}_values": fit.parameters.values for o, fit in fits.items()},
        **{f"{o}_deviations": fit.parameters.standard_deviations for o, fit in fits.items()},
        **{f"{o}_costs": fit.costs for o, fit in fits.items()},
    )
"""


def test_without_numba_the_answers_are_the_same(binding: Binding, recording, tmp_path) -> None:
    given, taken = tmp_path / "given.npz", tmp_path / "taken.npz"
    np.savez(given, positions=recording.positions)
    subprocess.run(
        [sys.executable, "-c", textwrap.dedent(_WITHOUT_NUMBA), str(given), str(taken)],
        check=True,
        cwd=ROOT,
        timeout=600,
    )
    without = np.load(taken)
    reach = np.ptp(binding.rig.bounds, axis=1)
    for objective in ("distances", "squares"):
        fit = fit_shape(binding, recording, objective=objective)
        apart = np.abs(fit.parameters.values - without[f"{objective}_values"]) / reach
        assert apart.max() < 1e-4
        np.testing.assert_allclose(without[f"{objective}_costs"], fit.costs, rtol=1e-6)
        np.testing.assert_allclose(
            without[f"{objective}_deviations"],
            fit.parameters.standard_deviations,
            rtol=1e-3,
        )


@pytest.mark.parametrize("side", [0, 1])
def test_bounds_are_those_of_the_search_whichever_way_it_is_made(
    binding: Binding, make_tracks, some_values, monkeypatch, side
) -> None:
    """Beyond a bound the other parameters make the best of it, and are not only cut off."""
    beyond = some_values.copy()
    beyond[0] = binding.rig.bounds[0, side] + (0.4 if side else -0.4)
    recording = make_tracks(binding, beyond)
    fast = fit_shape(binding, recording, objective="squares")
    monkeypatch.setattr(native, "load_library", lambda: None)
    slow = fit_shape(binding, recording, objective="squares")
    assert fast.parameters.values[0, 0] == pytest.approx(binding.rig.bounds[0, side])
    np.testing.assert_allclose(slow.parameters.values, fast.parameters.values, atol=2e-4)
    np.testing.assert_allclose(slow.costs, fast.costs, rtol=1e-6)


def test_arrays_of_the_kernel_begin_on_a_line_of_the_cache() -> None:
    arrays = [allocate_aligned(*shape) for shape in [(1,), (5, 3), (7,), (96, 2)] * 8]
    assert all(array.ctypes.data % 64 == 0 for array in arrays)
    assert [array.shape for array in arrays[:4]] == [(1,), (5, 3), (7,), (96, 2)]
    assert not any(array.any() for array in arrays)
