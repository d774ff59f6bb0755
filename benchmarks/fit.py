"""The shape fit's speed: our solvers, each of nlopt's algorithms, and scipy's, in one run.

    python benchmarks/fit.py [--quick] [--json] [--figure OUT.png]

Thirty markers of the layout face30-head5 on the built-in head, ten parameters in smooth motion at
60 Hz, 0.3 mm of noise on every coordinate, and the sum of distances to minimise. Every method
gets the same frames from the first on, starts there from the reference pose and then from its own
answer to the frame before, and keeps to the same bounds; slow methods get fewer frames.

Of every method the minimisation is timed, from measured markers to parameters. What a user of
`fit_shape` waits for is more, as it also gives residuals, standard deviations and provenance: for
our two methods that is ``fit_shape_frames_per_s``, printed below the table. Powell's method of
scipy minimises a numpy objective over the same restricted vertices, at scipy's own tolerances
(xtol = ftol = 1e-4).
Least squares of scipy take the roots of the distances as residuals, whose squares add up to the
same objective, with residuals and Jacobian from our compiled kernel.

Times are the thread's own (one core), medians over rounds in which the methods take turns (two
rounds for the slow ones). The excess is the cost over the least that any method found for the
frame, less one.
"""

import os

# ruff: noqa: E402
for _variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[_variable] = "1"  # before numpy is imported, or it does not count

import argparse
import dataclasses
import json
import statistics
import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares, minimize

from corpus_tools.simulation import Conditions, Session, draw_gesture
from mocap_fit.face import Mesh, Part, load_face
from mocap_fit.face.builtin import load_built_in_head
from mocap_fit.face.rig import CompiledRig, Kind
from mocap_fit.fitting import Binding, Orientation, bind_markers, fit_shape, load_layout
from mocap_fit.fitting.compiled_solver import CompiledSolver
from mocap_fit.fitting.objective import Evaluator
from mocap_fit.fitting.solving import ALGORITHMS, NEWTON, NEWTON_NLOPT
from mocap_fit.tracks import FloatArray, MarkerTracks

RATE, NOISE, SEED = 60.0, 0.3, 1
POWELL, LEAST_SQUARES = "scipy Powell", "scipy least_squares"
# Frames that a method gets, and with --quick; the first two get all.
FRAMES = 3000
OF_GRADIENT, OF_VALUES, OF_POWELL, OF_LEAST_SQUARES = (1000, 100), (100, 12), (50, 20), (30, 4)


class Problem(NamedTuple):
    """What is fitted, and the truth."""

    binding: Binding
    recording: MarkerTracks
    truth: FloatArray


class Answer(NamedTuple):
    """What a method found, `(frames, parameters)`, and its evaluations, `(frames,)`."""

    values: FloatArray
    evaluations: FloatArray


class NumpyMarkers:
    """Virtual markers in numpy, without derivatives, as fast as numpy gets.

    Coordinates come first; linear operations that follow each other are one product, a rotation
    is two more and touches the vertices that it moves alone, and the triangles round all markers
    are added up by one product.
    """

    def __init__(self, binding: Binding) -> None:
        compiled = binding.compiled
        assert compiled is not None
        self._rest = np.ascontiguousarray(compiled.rest.T)
        self._stages: list[tuple[Callable[..., None], tuple]] = []
        linear: list[tuple[int, FloatArray]] = []
        turned = False
        for i, kind in enumerate(compiled.kinds):
            parameter = int(compiled.parameters[i])
            weights, vector, centre = compiled.weights[i], compiled.vectors[i], compiled.centres[i]
            effect = weights[:, None] * vector
            untouched = not turned and not any((field * effect.T).any() for _, field in linear)
            if kind == Kind.FIELD:
                linear.append((parameter, compiled.fields[i].T))
            elif kind == Kind.TRANSLATION:
                linear.append((parameter, effect.T))
            elif kind == Kind.SCALING and untouched:
                linear.append((parameter, (effect * (compiled.rest - centre)).T))
            else:
                self._add_linear(linear)
                linear, turned = [], True
                touched = np.flatnonzero(weights)
                place = centre[:, None]
                if kind == Kind.SCALING:
                    part = np.ascontiguousarray(effect[touched].T)
                    self._stages.append((_scale, (parameter, touched, part, place)))
                elif touched.size and vector.any():
                    angle = np.sqrt(vector @ vector)
                    x, y, z = vector / angle
                    across = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
                    turns = np.concatenate([across, across @ across])
                    angles = angle * weights[touched]
                    self._stages.append((_turn, (parameter, touched, angles, turns, place)))
        self._add_linear(linear)
        count = len(binding.names)
        self._corners = np.ascontiguousarray(binding.corners.T).ravel()
        s, t, self._u = np.ascontiguousarray(binding.coordinates.T)
        self._shares = np.stack([1.0 - s - t, s, t])
        owner = np.repeat(np.arange(count), np.diff(binding.ring_starts))
        self._edges = np.concatenate([binding.rings[:, 0], binding.rings[:, 1]])
        self._centres = np.tile(binding.corners[owner, 0], 2)
        self._sums = (owner[:, None] == np.arange(count)).astype(float)

    def _add_linear(self, linear: list[tuple[int, FloatArray]]) -> None:
        if linear:
            parameters = np.array([parameter for parameter, _ in linear])
            fields = np.array([field.ravel() for _, field in linear])
            self._stages.append((_move, (parameters, fields)))

    def __call__(self, values: FloatArray) -> FloatArray:
        """Virtual markers `(3, markers)` at `(parameters,)` values."""
        x = self._rest.copy()
        for stage, arguments in self._stages:
            stage(x, values, *arguments)
        edges = x.take(self._edges, axis=1)
        edges -= x.take(self._centres, axis=1)
        half = edges.shape[1] // 2
        (a0, a1, a2), (b0, b1, b2) = edges[:, :half], edges[:, half:]
        across = np.empty((3, half))
        np.subtract(a1 * b2, a2 * b1, out=across[0])
        np.subtract(a2 * b0, a0 * b2, out=across[1])
        np.subtract(a0 * b1, a1 * b0, out=across[2])
        normals = across @ self._sums
        normals *= self._u / np.sqrt(np.einsum("im,im->m", normals, normals))
        corners = x.take(self._corners, axis=1).reshape(3, 3, -1)
        return np.einsum("icm,cm->im", corners, self._shares) + normals


def _move(x: FloatArray, values: FloatArray, parameters: FloatArray, fields: FloatArray) -> None:
    x += (values[parameters] @ fields).reshape(x.shape)


def _scale(  # scalings that follow a rotation
    x: FloatArray, values: FloatArray, parameter: int, touched, effect, centre
) -> None:
    part = x.take(touched, axis=1)
    x[:, touched] = part + values[parameter] * effect * (part - centre)


def _turn(
    x: FloatArray, values: FloatArray, parameter: int, touched, angles, turns, centre
) -> None:
    amounts = values[parameter] * angles
    part = x.take(touched, axis=1)
    both = turns @ (part - centre)
    both[:3] *= np.sin(amounts)
    both[3:] *= 1.0 - np.cos(amounts)
    part += both[:3]
    part += both[3:]
    x[:, touched] = part


def make_problem(frames: int, binding: Binding | None = None) -> Problem:
    """Smooth gestures, seen through the markers with noise."""
    if binding is None:
        layout = load_layout("face30-head5")
        binding = Session(layout, load_face(), Conditions(noise=0.0, drop_outs=0.0)).binding
    rng = np.random.default_rng(SEED)
    count = len(binding.parameter_names)
    truth = np.stack(
        [draw_gesture(rng, frames, RATE, 3.0, -0.2, 0.9) for _ in range(count)], axis=1
    )
    markers = NumpyMarkers(binding)
    for values in truth[:3]:
        np.testing.assert_allclose(markers(values).T, binding.evaluate(values)[0], atol=1e-9)
    positions = np.array([markers(values).T for values in truth])
    positions += rng.normal(0.0, NOISE, positions.shape)
    positions = binding.orientation.undo(positions)
    return Problem(binding, MarkerTracks(binding.names, RATE, positions, name="made"), truth)


def ours(problem: Problem, frames: int, solver: str) -> Answer:
    """One of our own methods, as `fit_shape` calls it: 512 frames at a time."""
    positions = problem.binding.orientation.apply(problem.recording.positions[:frames])
    minimiser = CompiledSolver(
        problem.binding, "distances", 1.0, solver=solver, maximum_evaluations=2000
    )
    usable, head = np.ones(frames, dtype=bool), np.zeros((frames, 0, 3))
    parts = [
        minimiser.solve(positions[at], head[at], usable[at])
        for at in (slice(start, start + 512) for start in range(0, frames, 512))
    ]
    return Answer(
        np.concatenate([part.values for part in parts]),
        np.concatenate([part.evaluations for part in parts]),
    )


def whole(problem: Problem, frames: int, solver: str) -> float:
    """Seconds that `fit_shape` takes."""
    recording = problem.recording.between(0.0, (frames - 0.5) / RATE)
    start = time.thread_time()
    fit_shape(problem.binding, recording, solver=solver)
    return time.thread_time() - start


def scipy_powell(problem: Problem, frames: int) -> Answer:
    """Powell's method on a numpy objective, as the paper did it."""
    markers, weights = NumpyMarkers(problem.binding), problem.binding.weights
    targets = problem.recording.positions
    x, values, evaluations = problem.binding.reference_parameters, [], []

    def cost(values: FloatArray, target: FloatArray) -> float:
        difference = markers(values) - target
        return float(weights @ np.sqrt(np.einsum("im,im->m", difference, difference)))

    for target in targets[:frames].transpose(0, 2, 1).copy():
        found = minimize(
            cost,
            x,
            args=(target,),
            method="Powell",
            bounds=problem.binding.rig.bounds,
            options={"xtol": 1e-4, "ftol": 1e-4},
        )
        x = found.x
        values.append(x)
        evaluations.append(found.nfev)
    return Answer(np.array(values), np.array(evaluations))


def scipy_least_squares(problem: Problem, frames: int) -> Answer:
    """Minimise with a trust region on the roots of the distances."""
    binding = problem.binding
    roots = np.sqrt(binding.weights)
    evaluator = Evaluator(binding, "distances", 1.0)
    targets = problem.recording.positions
    lower, upper = binding.rig.bounds.T
    x, values, evaluations = binding.reference_parameters, [], []

    def residuals(values: FloatArray, target: FloatArray) -> FloatArray:
        return roots * np.sqrt(np.linalg.norm(evaluator.evaluate(values)[0] - target, axis=1))

    def slopes(values: FloatArray, target: FloatArray) -> FloatArray:
        positions, jacobian = evaluator.evaluate(values)
        difference = positions - target
        distances = np.maximum(np.linalg.norm(difference, axis=1), 1e-9)
        slope = np.einsum("mi,mip->mp", difference, jacobian)
        return (roots / (2.0 * distances**1.5))[:, None] * slope

    for target in targets[:frames]:
        # The trust region starts strictly inside.
        start = np.clip(x, lower + 1e-9, upper - 1e-9)
        found = least_squares(residuals, start, slopes, bounds=(lower, upper), args=(target,))
        x = found.x
        values.append(x)
        evaluations.append(found.nfev)
    return Answer(np.array(values), np.array(evaluations))


def methods(quick: bool) -> dict[str, tuple[Callable[[Problem, int], Answer], int]]:
    """Every method, and how many frames it gets."""
    at = int(quick)
    table: dict[str, tuple[Callable[[Problem, int], Answer], int]] = {}
    for solver in (NEWTON_NLOPT, NEWTON, *ALGORITHMS):
        counts = OF_GRADIENT if solver.startswith("LD") else OF_VALUES
        frames = FRAMES if solver in (NEWTON, NEWTON_NLOPT) else counts[at]

        def method(problem: Problem, frames: int, solver: str = solver) -> Answer:
            return ours(problem, frames, solver)

        table[solver] = method, frames
    table[POWELL] = scipy_powell, OF_POWELL[at]
    table[LEAST_SQUARES] = scipy_least_squares, OF_LEAST_SQUARES[at]
    return table


def measure(problem: Problem, quick: bool) -> dict[str, dict[str, float]]:
    """Every method in turn, some rounds over."""
    table = methods(quick)
    for method, _ in table.values():
        method(problem, 2)  # compiles what is not yet compiled
    seconds: dict[str, list[float]] = {name: [] for name in table}
    answers: dict[str, Answer] = {}
    for turn in range(3 if quick else 5):
        for name, (method, frames) in table.items():
            if turn > 1 and name not in (NEWTON_NLOPT, NEWTON) and (quick or frames < 1000):
                continue
            start = time.thread_time()
            answers[name] = method(problem, frames)
            seconds[name].append(time.thread_time() - start)
    costs = {name: true_costs(problem, answer.values) for name, answer in answers.items()}
    best = np.full(FRAMES, np.inf)
    for found in costs.values():
        best[: len(found)] = np.minimum(best[: len(found)], found)
    speeds = {n: table[n][1] / statistics.median(s) for n, s in seconds.items()}
    results = {}
    for name, found in costs.items():
        excess = found / best[: len(found)] - 1.0
        error = answers[name].values - problem.truth[: len(found)]
        results[name] = {
            "frames_per_s": speeds[name],
            "times_powell": speeds[name] / speeds[POWELL],
            "excess": float(excess.mean()),
            "excess_max": float(excess.max()),
            "evaluations_per_frame": float(answers[name].evaluations.mean()),
            "rmse": float(np.sqrt(np.mean(error**2))),
        }
        if name in (NEWTON_NLOPT, NEWTON):
            seconds_whole = statistics.median(whole(problem, FRAMES, name) for _ in range(3))
            results[name]["fit_shape_frames_per_s"] = FRAMES / seconds_whole
    return results


def true_costs(problem: Problem, values: FloatArray) -> FloatArray:
    """Compute the objective at the answers, `(frames,)`, in plain numpy for all methods."""
    markers, weights = NumpyMarkers(problem.binding), problem.binding.weights
    return np.array(
        [
            weights @ np.linalg.norm(markers(v).T - target, axis=1)
            for v, target in zip(values, problem.recording.positions, strict=False)
        ]
    )


def show(results: dict[str, dict[str, float]], quick: bool) -> None:
    """Print the table, and what of `fit_shape` is the solver."""
    from rich.console import Console
    from rich.table import Table

    table = Table(title="The shape fit, 30 markers, 10 parameters, one core")
    for heading in (
        "method",
        "frames",
        "frames/s",
        "× Powell",
        "evaluations",
        "excess",
        "largest",
        "rmse",
    ):
        table.add_column(heading, justify="left" if heading == "method" else "right")
    frames = methods(quick)
    for name, row in sorted(results.items(), key=lambda item: -item[1]["frames_per_s"]):
        table.add_row(
            name,
            str(frames[name][1]),
            f"{row['frames_per_s']:,.0f}"
            if row["frames_per_s"] > 99
            else f"{row['frames_per_s']:.1f}",
            f"{row['times_powell']:,.1f}",
            f"{row['evaluations_per_frame']:.1f}",
            f"{row['excess']:.1e}",
            f"{row['excess_max']:.1e}",
            f"{row['rmse']:.4f}",
        )
    console = Console(width=110)
    console.print(table)
    for solver in (NEWTON_NLOPT, NEWTON):
        console.print(
            f"fit_shape with {solver}: {results[solver]['fit_shape_frames_per_s']:,.0f} frames/s; "
            "what it takes beside the minimisation is residuals, standard deviations, provenance"
        )


def with_markers(binding: Binding, count: int) -> Binding:
    """Return the binding with its first markers, or with all of them more than once."""
    order = np.arange(count) % len(binding.names)
    rings = np.split(binding.rings, binding.ring_starts[1:-1])
    chosen = [rings[m] for m in order]
    return dataclasses.replace(
        binding,
        names=tuple(f"{binding.names[m]}_{i}" for i, m in enumerate(order)),
        weights=binding.weights[order],
        corners=binding.corners[order],
        coordinates=binding.coordinates[order],
        ring_starts=np.cumsum([0, *(len(ring) for ring in chosen)]),
        rings=np.concatenate(chosen),
    )


class FewerParameters:
    """The first parameters of a rig."""

    def __init__(self, rig, count: int) -> None:  # type: ignore[no-untyped-def]
        self._rig, self._count = rig, count
        self.mesh = rig.mesh
        self.parameter_names = rig.parameter_names[:count]
        self.bounds = rig.bounds[:count]

    def deform(self, parameters: FloatArray) -> FloatArray:
        whole = np.zeros(len(self._rig.parameter_names))
        whole[: self._count] = parameters
        return self._rig.deform(whole)

    def jacobian(self, parameters: FloatArray) -> FloatArray:
        whole = np.zeros(len(self._rig.parameter_names))
        whole[: self._count] = parameters
        return self._rig.jacobian(whole)[:, :, : self._count]

    def compile(self, vertex_ids: FloatArray) -> CompiledRig:
        compiled = self._rig.compile(vertex_ids)
        kept = np.flatnonzero(compiled.parameters < self._count)
        fields = compiled.fields[kept] if len(compiled.fields) else compiled.fields
        return dataclasses.replace(
            compiled,
            kinds=compiled.kinds[kept],
            parameters=compiled.parameters[kept],
            weights=compiled.weights[kept],
            vectors=compiled.vectors[kept],
            centres=compiled.centres[kept],
            fields=fields,
            parameter_count=self._count,
        )


def with_parameters(binding: Binding, count: int) -> Binding:
    """Return the binding with its first parameters."""
    rig = FewerParameters(binding.rig, count)
    return dataclasses.replace(
        binding,
        rig=rig,
        reference_parameters=binding.reference_parameters[:count],
        compiled=rig.compile(binding.vertex_ids),
    )


def subdivided(mesh: Mesh) -> Mesh:
    """Four triangles for each, part by part; what the fit reads of the mesh goes along."""
    vertices, triangles, parts, regions = [], [], [], {name: [] for name in mesh.regions}
    feature_points: dict[str, int] = {}
    for part in mesh.parts:
        first, faces = (
            part.vertices.start,
            mesh.triangles[slice(part.triangles.start, part.triangles.stop)],
        )
        start, first_face = sum(map(len, vertices)), sum(map(len, triangles))
        old = mesh.vertices[first : part.vertices.stop]
        edges = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2) - first, axis=1)
        pairs, middle = np.unique(edges, axis=0, return_inverse=True)
        a, b, c = (faces - first + start).T
        ab, bc, ca = (middle.reshape(-1, 3) + len(old) + start).T
        new = np.concatenate([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]], axis=1).T
        vertices.append(np.concatenate([old, old[pairs].mean(axis=1)]))
        triangles.append(new)
        parts.append(
            Part(
                part.name,
                range(start, start + len(vertices[-1])),
                range(first_face, first_face + len(new)),
                part.material,
            )
        )
        for name, members in mesh.regions.items():
            inside = np.isin(np.arange(first, part.vertices.stop), members)
            both = np.concatenate([inside, inside[pairs].all(axis=1)])
            regions[name] += (np.flatnonzero(both) + start).tolist()
        for name, vertex in mesh.feature_points.items():
            if first <= vertex < part.vertices.stop:
                feature_points[name] = vertex - first + start
    return Mesh(
        np.concatenate(vertices),
        np.concatenate(triangles),
        tuple(parts),
        {name: np.array(members, dtype=np.int64) for name, members in regions.items()},
        feature_points,
    )


def with_mesh(mesh: Mesh) -> Binding:
    """Bind the layout's markers, where the built-in head wears them, to the rig of a mesh."""
    layout = load_layout("face30-head5")
    worn = Session(layout, load_face(), Conditions(noise=0.0)).still
    return bind_markers(load_face(mesh=mesh), layout, worn, Orientation())


def draw(path: Path, frames: int) -> None:
    """Cost a frame against frames, markers, parameters and mesh size, for three methods."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot

    problem = make_problem(frames)
    binding, head = problem.binding, load_built_in_head()
    sizes = [head, subdivided(head)]
    panels: dict[str, list[tuple[int, Problem]]] = {
        "frames": [(n, make_problem(n, binding)) for n in (10, 30, 100, 300, 1000, 3000)],
        "markers": [
            (n, make_problem(frames, with_markers(binding, n))) for n in (10, 20, 30, 32, 60, 90)
        ],
        "parameters": [
            (n, make_problem(frames, with_parameters(binding, n))) for n in (1, 2, 4, 6, 8, 10)
        ],
        "vertices of the mesh": [
            (len(mesh.vertices), make_problem(frames, with_mesh(mesh))) for mesh in sizes
        ],
    }
    figure, axes = pyplot.subplots(1, len(panels), figsize=(13, 3.4), sharey=True)
    for axis, (label, cases) in zip(axes, panels.items(), strict=True):
        for solver in (NEWTON, NEWTON_NLOPT, "LD_SLSQP"):
            costs = []
            for _, case in cases:
                count = case.recording.frames
                whole(case, count, solver)
                times = [whole(case, count, solver) for _ in range(3)]
                costs.append(1e6 * statistics.median(times) / count)
            axis.loglog([size for size, _ in cases], costs, "o-", label=solver, markersize=3)
        axis.set_xlabel(label)
    axes[0].set_ylabel("µs a frame, fit_shape, one core")
    axes[0].legend(frameon=False)
    figure.tight_layout()
    figure.savefig(path, dpi=150)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="fewer frames for slow methods")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.add_argument("--figure", type=Path, help="draw what the cost depends on")
    arguments = parser.parse_args()
    problem = make_problem(FRAMES)
    results = measure(problem, arguments.quick)
    if arguments.json:
        print(json.dumps({"methods": results}))
    else:
        show(results, arguments.quick)
    if arguments.figure:
        draw(arguments.figure, 300 if arguments.quick else 1000)


if __name__ == "__main__":
    main()
