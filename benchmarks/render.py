"""The speed of drawing a talking head, against the plain ways of pyvista, in one run.

    python benchmarks/render.py [--quick] [--json]

The built-in head at 640×640 pixels, front view, jaw and lips in smooth motion. The methods:

- pyvista, a plotter a frame: what one writes first, with pyvista's own lights and anti-aliasing
- pyvista, one plotter: set up once, points moved, normals computed anew; else the same
- FaceScene, and FaceScene with jagged edges: what `render_movie` draws with, deformation and
  contact included
- render_movie, in one process and in two: a whole MP4 with sound, by the clock on the wall, without
  the start of the processes, which is told apart

Methods take turns over rounds; medians are shown. CPU times are those of all threads of this
process, those of movies of all processes: on a machine with other work they are the ones to trust.
Real time is 25 frames/s: on two cores, 80 ms of CPU a frame at most.
"""

import argparse
import json
import os
import statistics
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from mocap_fit.face import load_face
from mocap_fit.face.contact import resolve_contact
from mocap_fit.render import FaceScene, render_movie, require_off_screen
from mocap_fit.sound import Sound
from mocap_fit.tracks import ParameterTracks

SIZE = (640, 640)
REAL_TIME = 25.0


def movement(frames: int) -> ParameterTracks:
    rig = load_face(tongue=True)
    times = np.arange(frames) / REAL_TIME
    values = np.zeros((frames, len(rig.parameter_names)))
    values[:, rig.parameter_names.index("jaw_rotation")] = 0.4 - 0.4 * np.cos(11 * times)
    values[:, rig.parameter_names.index("lip_rounding")] = 0.3 - 0.3 * np.cos(5 * times)
    return ParameterTracks(rig.parameter_names, REAL_TIME, values)


def plain_plotter() -> tuple[Any, list[tuple[Any, Any]]]:
    """Draw as pyvista's documentation does: a mesh a part, its lights, its anti-aliasing."""
    import pyvista

    mesh = load_face().mesh
    plotter: Any = pyvista.Plotter(off_screen=True, window_size=list(SIZE))
    surfaces = []
    for part in mesh.parts:
        own = slice(part.vertices.start, part.vertices.stop)
        triangles = mesh.triangles[part.triangles.start : part.triangles.stop]
        surface: Any = pyvista.PolyData.from_regular_faces(
            mesh.vertices[own], triangles - part.vertices.start
        )
        assert mesh.colours is not None
        surface["colours"] = np.rint(255 * mesh.colours[own]).astype(np.uint8)
        plotter.add_mesh(surface, scalars="colours", rgb=True, smooth_shading=True)
        surfaces.append((own, surface))
    plotter.camera_position = "xy"
    plotter.enable_anti_aliasing("ssaa")
    return plotter, surfaces


def plotter_a_frame(values: np.ndarray) -> None:
    rig = load_face(tongue=True)
    for row in values:
        plotter, surfaces = plain_plotter()
        vertices = rig.deform(row)
        for own, surface in surfaces:
            surface.points = vertices[own]
        plotter.screenshot(return_img=True)
        plotter.close()


def one_plotter(values: np.ndarray) -> None:
    rig = load_face(tongue=True)
    plotter, surfaces = plain_plotter()
    plotter.show(auto_close=False)
    for row in values:
        vertices = rig.deform(row)
        for own, surface in surfaces:
            surface.points = vertices[own]
            surface.compute_normals(inplace=True, split_vertices=False)
        plotter.render()
        plotter.screenshot(return_img=True)
    plotter.close()


def face_scene(values: np.ndarray, smooth: bool = True) -> None:
    rig = load_face(tongue=True)
    with FaceScene(rig.mesh, size=SIZE, smooth_edges=smooth) as scene:
        for row in values:
            scene.draw(resolve_contact(rig.deform(row), rig.mesh))


def timed(work: Callable[[np.ndarray], None], values: np.ndarray) -> tuple[float, float]:
    """Seconds a frame, by the wall's clock and of CPU, without setting up: two runs apart."""
    results = []
    for part in (values[:1], values):
        wall, cpu = time.perf_counter(), time.process_time()
        work(part)
        results.append((time.perf_counter() - wall, time.process_time() - cpu))
    frames = len(values) - 1
    return tuple((long - short) / frames for short, long in zip(*results, strict=True))  # type: ignore[return-value]


def cpu() -> float:
    """Seconds of CPU of this process and of those that it waited for."""
    spent = os.times()
    return spent.user + spent.system + spent.children_user + spent.children_system


def movie(frames: int, jobs: int) -> tuple[float, float, float]:
    """Frames per second of a whole movie, seconds until the first, CPU milliseconds a frame.

    The last are those of all that takes part, ffmpeg and the start of processes included.
    """
    spent = cpu()
    sound = Sound(np.zeros(round(16000 * frames / REAL_TIME)), 16000)
    began = time.perf_counter()
    stamps: list[float] = []
    with tempfile.TemporaryDirectory() as folder:
        render_movie(
            movement(frames),
            Path(folder) / "a.mp4",
            sound=sound,
            size=SIZE,
            jobs=jobs,
            progress=lambda done, of: stamps.append(time.perf_counter()),
        )
    # The first frames of two processes come together: what follows the first half is steady.
    half = len(stamps) // 2
    steady = (len(stamps) - 1 - half) / (stamps[-1] - stamps[half])
    return steady, stamps[0] - began, 1000 * (cpu() - spent) / frames


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--quick", action="store_true", help="fewer frames and rounds")
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args()
    require_off_screen()
    frames, rounds, long = (6, 2, 60) if arguments.quick else (16, 3, 250)
    values = movement(200).values[:: 200 // frames][:frames]
    methods: dict[str, Callable[[np.ndarray], None]] = {
        "pyvista, a plotter a frame": plotter_a_frame,
        "pyvista, one plotter": one_plotter,
        "FaceScene": face_scene,
        "FaceScene, jagged edges": lambda some: face_scene(some, smooth=False),
    }
    found: dict[str, list[tuple[float, float]]] = {name: [] for name in methods}
    face_scene(values[:1])
    for _ in range(rounds):
        for name, work in methods.items():
            found[name].append(timed(work, values))
    rows = {}
    for name, times in found.items():
        wall, cpu = (statistics.median(column) for column in zip(*times, strict=True))
        rows[name] = {"wall_ms": 1000 * wall, "cpu_ms": 1000 * cpu, "frames_per_second": 1 / wall}
    slowest = rows["pyvista, a plotter a frame"]
    for row in rows.values():
        row["times_as_fast"] = slowest["wall_ms"] / row["wall_ms"]
        row["cpu_ratio"] = slowest["cpu_ms"] / row["cpu_ms"]
    movies = {}
    for jobs in (1, 2):
        rate, first, milliseconds = movie(long, jobs)
        movies[f"render_movie, {jobs} process{'es' if jobs > 1 else ''}"] = {
            "frames_per_second": rate,
            "seconds_to_first": first,
            "cpu_ms": milliseconds,
        }
    if arguments.json:
        print(json.dumps({"size": SIZE, "drawing": rows, "movies": movies}, indent=2))
        return
    print(f"{'':30} {'ms':>8} {'CPU ms':>8} {'frames/s':>9} {'times':>6}")
    for name, row in rows.items():
        print(
            f"{name:30} {row['wall_ms']:8.1f} {row['cpu_ms']:8.1f} "
            f"{row['frames_per_second']:9.1f} {row['times_as_fast']:6.1f}"
        )
    for name, row in movies.items():
        print(
            f"{name:30} {'':8} {row['cpu_ms']:8.1f} {row['frames_per_second']:9.1f} "
            f"  (first frame after {row['seconds_to_first']:.1f} s)"
        )


if __name__ == "__main__":
    main()
