"""Frames a second of the inspection window, and of a plain pyvista window with the same mesh.

    python benchmarks/window.py [RECORDING] [--frames N]

Both are drawn off screen at 1280x800 without multisampling, in turns, in one process: ours with
the head, all markers, their residuals, the strip and the panel; the plain one with the mesh alone,
moved in the same way, lit by pyvista. Beside that, the time to open: reading, fitting and checking
(`gather`), and the window with its first picture, cold and warm.
"""

from __future__ import annotations

import argparse
import statistics
import time
from pathlib import Path

import numpy as np

from corpus_tools.inspection.gather import gather
from corpus_tools.inspection.window import SIZE, Window
from mocap_fit.io.samples import load_sample
from mocap_fit.processes import limit_threads
from mocap_fit.render.sampling import sample_parameters

_ROUNDS = 5


def measure(task) -> float:
    start = time.perf_counter()
    task()
    return time.perf_counter() - start


def create_plain(material):
    """Return a function that moves the mesh of a plain window and draws it."""
    import pyvista

    rig = material.rig
    plotter = pyvista.Plotter(off_screen=True, window_size=list(SIZE))
    plotter.render_window.SetMultiSamples(0)
    mesh = pyvista.PolyData.from_regular_faces(
        rig.mesh.vertices.astype(np.float32), rig.mesh.triangles
    )
    plotter.add_mesh(mesh, smooth_shading=True, color="tan", copy_mesh=False)
    plotter.show(auto_close=False)
    head = next(iter(material.heads.values()))
    values = sample_parameters(head, head.times, rig)

    def draw(number: int) -> None:
        mesh.points[:] = rig.deform(values[number % len(values)])
        mesh.compute_normals(cell_normals=False, split_vertices=False, inplace=True)
        mesh.GetPoints().Modified()
        plotter.render_window.Render()

    return draw


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("recording", type=Path, nargs="?", default=load_sample("take_01"))
    parser.add_argument("--frames", type=int, default=60, help="frames of each turn")
    arguments = parser.parse_args()
    limit_threads()

    print(f"gather, cold: {measure(lambda: gather(arguments.recording)):.2f} s")
    print(f"gather, warm: {measure(lambda: gather(arguments.recording)):.2f} s")
    material = gather(arguments.recording)
    opened = []
    for kind in ("cold", "warm"):
        taken = measure(lambda: opened.append(Window(material, off_screen=True)))
        print(f"window with its first picture, {kind}: {taken:.2f} s")
    opened.pop().close()
    window = opened.pop()
    if not material.heads:
        print("the recording is not fitted: there is no head to play")
        return
    plain = create_plain(material)
    every = 1 / material.rate

    def play() -> None:
        window.line.move_cursor(window.line.first)
        window.line.play(0.0)
        for number in range(arguments.frames):
            window.advance(number * every)
        window.line.stop()

    def play_plain() -> None:
        for number in range(arguments.frames):
            plain(number)

    play()
    play_plain()
    tasks = {"the window": play, "a plain pyvista window with the same mesh": play_plain}
    rates: dict[str, list[float]] = {name: [] for name in tasks}
    processor: dict[str, list[float]] = {name: [] for name in tasks}
    for _ in range(_ROUNDS):
        for name, task in tasks.items():
            before = time.process_time()
            rates[name].append(arguments.frames / measure(task))
            processor[name].append((time.process_time() - before) / arguments.frames)
    for name in tasks:
        rate = statistics.median(rates[name])
        cost = 1000 * statistics.median(processor[name])
        print(f"{name}: {rate:.1f} frames/s, {cost:.1f} ms of CPU a frame (of all threads)")
    ours, other = (statistics.median(each) for each in rates.values())
    print(f"ratio of the rates: {ours / other:.2f}")
    for name, key in {"pan": "Next", "zoom": "i"}.items():
        window.press("a", ctrl=True)
        window.press("i", ctrl=True)
        taken = measure(lambda key=key: window.press(key, ctrl=key == "i"))
        print(f"{name}: {1000 * taken:.0f} ms")
    window.close()


if __name__ == "__main__":
    main()
