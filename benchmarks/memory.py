"""The memory that fitting a recording takes, against its length.

    python benchmarks/memory.py [--frames 1000 10000 100000 900000] [--format tsv] [--markers 65]

A recording of the layout face30-head5 and further markers, 250 Hz, is made in a temporary folder
and fitted by ``mocap-fit fit`` in a process of its own; its largest memory is what the system
says of that process. The recording is a simulated one of four seconds, to and fro, so that every
length is as hard.
"""

import argparse
import json
import os
import struct
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from corpus_tools.simulation import Conditions, Session
from mocap_fit.face import load_face
from mocap_fit.fitting import load_layout
from mocap_fit.io import write_qualisys_tsv
from mocap_fit.tracks import FloatArray, MarkerTracks

RATE, LAYOUT = 250.0, "face30-head5"

_CHILD = """
import resource, sys
from corpus_tools import cli
status = cli.main(sys.argv[1:])
usage = resource.getrusage(resource.RUSAGE_SELF)
print("\\n" + str(usage.ru_maxrss) + " " + str(usage.ru_utime + usage.ru_stime))
sys.exit(status)
"""


def recorded(markers: int, folder: Path) -> MarkerTracks:
    """Four seconds, with as many further markers as are asked for; the reference is written."""
    session = Session(load_layout(LAYOUT), load_face(), Conditions(rate=RATE))
    rng = np.random.default_rng(1)
    write_qualisys_tsv(session.reference(rng), folder / "reference.tsv")
    recording = session.record(rng).recording
    more = markers - len(recording.names)
    if more <= 0:
        return recording
    others = recording.positions[:, :more] + [0.0, -300.0, 0.0]
    return recording.replace(
        names=(*recording.names, *(f"other_{i}" for i in range(others.shape[1]))),
        positions=np.concatenate([recording.positions, others], axis=1),
        origin=None,
    )


def to_and_fro(recording: MarkerTracks, frames: int) -> Iterator[tuple[int, FloatArray]]:
    """Stretches of the recording forwards and backwards; the number of the first frame of each."""
    start, part = 0, recording.positions
    while start < frames:
        yield start, part[: frames - start]
        start, part = start + len(part), part[::-1]


def write_text(recording: MarkerTracks, frames: int, path: Path) -> None:
    """A Qualisys TSV or CSV file."""
    separator, titles = ("\t", "Frame\tTime") if path.suffix == ".tsv" else (",", "frame,time")
    axes = "XYZ" if path.suffix == ".tsv" else "xyz"
    rows = [
        separator.join("" if np.isnan(v) else f"{v:.3f}" for v in row)
        for row in recording.positions.reshape(recording.frames, -1)
    ]
    with path.open("w") as stream:
        if path.suffix == ".tsv":
            names = "\t".join(recording.names)
            stream.write(
                f"NO_OF_FRAMES\t{frames}\nNO_OF_MARKERS\t{len(recording.names)}\n"
                f"FREQUENCY\t{RATE:g}\nDATA_INCLUDED\t3D\nMARKER_NAMES\t{names}\n"
            )
        columns = (f"{name} {axis}" for name in recording.names for axis in axes)
        stream.write(separator.join([titles, *columns]) + "\n")
        forwards = True
        for start, part in to_and_fro(recording, frames):
            lines = rows if forwards else rows[::-1]
            forwards = not forwards
            for i in range(len(part)):
                number = start + i
                stream.write(f"{number + 1}{separator}{number / RATE:.5f}{separator}{lines[i]}\n")


def write_c3d(recording: MarkerTracks, frames: int, path: Path) -> None:
    """A C3D file of floats; ezc3d writes the head of it, with one frame."""
    import ezc3d

    content = ezc3d.c3d()
    point = content["parameters"]["POINT"]
    point["RATE"]["value"], point["UNITS"]["value"] = [RATE], ["mm"]
    point["LABELS"]["value"] = list(recording.names)
    content.add_parameter("POINT", "LONG_FRAMES", [float(frames)])
    content["data"]["points"] = np.ones((4, len(recording.names), 1))
    content.write(str(path))
    head = bytearray(path.read_bytes())
    head = head[: (struct.unpack_from("<H", head, 16)[0] - 1) * 512]
    struct.pack_into("<HH", head, 6, 1, min(frames, 65535))
    with path.open("wb") as stream:
        stream.write(head)
        for _, part in to_and_fro(recording, frames):
            numbers = np.zeros((*part.shape[:2], 4), "<f4")
            gone = np.isnan(part).any(axis=2)
            numbers[:, :, :3] = np.where(gone[:, :, None], 0.0, part)
            numbers[:, :, 3] = np.where(gone, -1.0, 0.0)
            stream.write(numbers.tobytes())


def measure(folder: Path, recording: Path) -> dict[str, float]:
    """Fit it: the largest memory in MB, and what the command says of the time."""
    out = folder / "out"
    command = ["fit", str(recording), "--reference", str(folder / "reference.tsv")]
    command += ["--layout", LAYOUT, "--out", str(out), "--json"]
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    run = subprocess.run(
        [sys.executable, "-c", _CHILD, *command],
        capture_output=True,
        text=True,
        check=False,
        env=environment,
    )
    if run.returncode:
        raise SystemExit(run.stderr)
    said, _, last = run.stdout.strip().rpartition("\n")
    seconds = json.loads(said)["seconds"]
    memory, used = last.split()
    return {"memory_mb": int(memory) / 1024, "cpu_s": float(used), **seconds}


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--frames", type=int, nargs="+", default=[1000, 10_000, 100_000, 900_000])
    parser.add_argument("--format", choices=["tsv", "csv", "c3d"], default="tsv")
    parser.add_argument("--markers", type=int, default=65, help="35 of them are the layout's")
    arguments = parser.parse_args()
    print(f"{arguments.format}, {arguments.markers} markers, {RATE:g} Hz")
    print("  frames  file MB  memory MB  CPU s  reading  head  fitting  writing (s)")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        made = recorded(arguments.markers, folder)
        for frames in arguments.frames:
            path = folder / f"long_{frames}.{arguments.format}"
            write = write_c3d if arguments.format == "c3d" else write_text
            write(made, frames, path)
            found = measure(folder, path)
            print(
                f"{frames:8d} {path.stat().st_size / 2**20:8.0f} {found['memory_mb']:10.0f} "
                f"{found['cpu_s']:6.1f} {found['reading']:8.1f} {found['head_motion']:5.1f} "
                f"{found['fitting']:8.1f} {found['writing']:8.1f}",
                flush=True,
            )
            path.unlink()


if __name__ == "__main__":
    main()
