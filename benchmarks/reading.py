"""The speed of reading recordings, each format against a named peer in the same run.

    python benchmarks/reading.py [--quick] [--json]

Recordings of 100 markers, 100 MB each (5 MB with --quick), in files that are written first:

- C3D of floats, with analog data between the frames, and of integers: against ezc3d
- Qualisys TSV and CSV: against pandas.read_csv with its fast parser, the header passed over

Ours is `read_tracks`: it finds the reader, and gives checked tracks in millimetres with gaps and
provenance; the peers give their own arrays of numbers. They take turns; the least time of CPU
counts, because a machine with other work disturbs all others. What both read is compared.
"""

import argparse
import json
import struct
import tempfile
import time
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import ezc3d
import numpy as np
import pandas as pd

from mocap_fit.io import read_tracks, write_qualisys_tsv
from mocap_fit.tracks import MarkerTracks

MARKERS = 100
RATE = 100.0
SCALE = 0.1
CHANNELS, PER_FRAME = 8, 10


def movement(frames: int) -> np.ndarray:
    rng = np.random.default_rng(0)
    steps = rng.normal(0, 0.5, (frames, MARKERS, 3)).cumsum(axis=0)
    return np.round(rng.uniform(-300, 300, (MARKERS, 3)) + 300 * np.tanh(steps / 300), 3)


def write_c3d(path: Path, positions: np.ndarray, *, floats: bool, analog: bool) -> None:
    """Write a file as the C3D user guide has it, for Intel."""
    frames = len(positions)
    channels = CHANNELS * analog
    scale = -SCALE if floats else SCALE
    parameters = [
        ("POINT", "USED", "h", [MARKERS]),
        ("POINT", "SCALE", "f", [scale]),
        ("POINT", "RATE", "f", [RATE]),
        ("POINT", "DATA_START", "h", [4]),
        ("POINT", "FRAMES", "H", [frames]),
        ("POINT", "LABELS", "", [f"m{index:03}" for index in range(MARKERS)]),
        ("POINT", "UNITS", "", ["mm"]),
        ("ANALOG", "USED", "h", [channels]),
        ("ANALOG", "RATE", "f", [RATE * PER_FRAME]),
        ("ANALOG", "GEN_SCALE", "f", [1.0]),
        ("ANALOG", "SCALE", "f", [1.0] * channels),
        ("ANALOG", "OFFSET", "h", [0] * channels),
        ("ANALOG", "LABELS", "", [f"a{index}" for index in range(channels)] or [""]),
    ]
    chain = b"\5\xffPOINT\3\0\0" + b"\6\xfeANALOG\3\0\0"
    for index, (group, name, code, values) in enumerate(parameters):
        if code:
            count = [] if len(values) == 1 else [len(values)]
            data = struct.pack(f"<{len(values)}{code}", *values)
            body = bytes([4 if code == "f" else 2, len(count), *count]) + data
        else:
            length = max(map(len, values))
            body = bytes([255, 2, length, len(values)])
            body += b"".join(value.ljust(length).encode() for value in values)
        offset = len(body) + 3 if index < len(parameters) - 1 else 0
        chain += bytes([len(name), 1 if group == "POINT" else 2]) + name.encode()
        chain += struct.pack("<H", offset) + body + b"\0"
    samples = channels * PER_FRAME
    words = (2, 80, MARKERS, samples, 1, frames, 10, scale, 4, PER_FRAME * analog, RATE)
    header = struct.pack("<BB5Hf2Hf", *words)
    rows = np.ones((frames, MARKERS, 4))
    rows[:, :, :3] = positions if floats else np.rint(positions / SCALE)
    rows = np.hstack([rows.reshape(frames, -1), np.ones((frames, samples))])
    data = rows.astype("<f4" if floats else "<i2").tobytes()
    section = b"\1\x50\2\x54" + chain
    assert len(section) <= 1024
    path.write_bytes(header.ljust(512, b"\0") + section.ljust(1024, b"\0") + data)


def read_by_ezc3d(path: Path) -> np.ndarray:
    return np.asarray(ezc3d.c3d(str(path))["data"]["points"][:3].transpose(2, 1, 0))


def read_by_pandas(path: Path) -> np.ndarray:
    if path.suffix == ".csv":
        return pd.read_csv(path).to_numpy()[:, 1:]
    with path.open() as file:
        lines = next(number for number, line in enumerate(file) if line[:1].isdigit())
    table = pd.read_csv(path, sep="\t", skiprows=lines, header=None)
    return table.to_numpy()[:, -3 * MARKERS :]


def recordings(folder: Path, size: float) -> dict[str, tuple[Path, Callable[[Path], np.ndarray]]]:
    """Write the files, and return them with what the peer reads them by."""
    files: dict[str, tuple[Path, Any]] = {}
    for name, width, floats, analog in (
        ("C3D, floats", 4, True, False),
        ("C3D, floats with analog data", 4, True, True),
        ("C3D, integers", 2, False, False),
    ):
        frame = width * (4 * MARKERS + CHANNELS * PER_FRAME * analog)
        path = folder / f"{name.replace(', ', '_').replace(' ', '_')}.c3d"
        # More frames than 16 bits count are a matter of their own.
        write_c3d(path, movement(min(int(size / frame), 65535)), floats=floats, analog=analog)
        files[name] = path, read_by_ezc3d
    frames = int(size / (MARKERS * 26))
    names = [f"m{index:03}" for index in range(MARKERS)]
    tracks = MarkerTracks(tuple(names), RATE, movement(frames))
    write_qualisys_tsv(tracks, folder / "a.tsv")
    files["Qualisys TSV"] = folder / "a.tsv", read_by_pandas
    columns = ["time", *(f"{name}_{axis}" for name in names for axis in "xyz")]
    table = np.column_stack([np.arange(frames) / RATE, tracks.positions.reshape(frames, -1)])
    pd.DataFrame(table, columns=columns).to_csv(folder / "a.csv", index=False)
    files["CSV"] = folder / "a.csv", read_by_pandas
    return files


def timed(work: Callable[[Path], Any], path: Path) -> tuple[float, Any]:
    """Seconds of CPU, and what comes back."""
    start = time.process_time()
    result = work(path)
    return time.process_time() - start, result


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="files of 5 MB")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    arguments = parser.parse_args()
    warnings.simplefilter("ignore")
    rows = {}
    with tempfile.TemporaryDirectory() as folder:
        files = recordings(Path(folder), 5e6 if arguments.quick else 100e6)
        for name, (path, peer) in files.items():
            times: dict[str, list[float]] = {"ours": [], "peer": []}
            for _ in range(3):
                seconds, tracks = timed(read_tracks, path)
                times["ours"].append(seconds)
                seconds, numbers = timed(peer, path)
                times["peer"].append(seconds)
            numbers = numbers.reshape(tracks.positions.shape)
            ours, theirs = min(times["ours"]), min(times["peer"])
            megabytes = path.stat().st_size / 1e6
            rows[name] = {
                "megabytes": megabytes,
                "frames": tracks.frames,
                "peer": "ezc3d" if peer is read_by_ezc3d else "pandas",
                "seconds": ours,
                "peer_seconds": theirs,
                "megabytes_per_second": megabytes / ours,
                "times_as_fast": theirs / ours,
                "largest_difference_mm": float(np.nanmax(np.abs(numbers - tracks.positions))),
            }
    if arguments.json:
        print(json.dumps(rows, indent=2))
        return
    print(f"{'':30} {'MB':>6} {'frames':>7} {'s':>7} {'peer s':>7} {'times':>6}  peer")
    for name, row in rows.items():
        print(
            f"{name:30} {row['megabytes']:6.0f} {row['frames']:7d} {row['seconds']:7.2f} "
            f"{row['peer_seconds']:7.2f} {row['times_as_fast']:6.1f}  {row['peer']}"
        )


if __name__ == "__main__":
    main()
