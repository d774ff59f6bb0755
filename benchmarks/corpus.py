"""A corpus of sentences fitted by one command, and how its time divides.

    python benchmarks/corpus.py [--sentences 287] [--seconds 5] [--jobs 2] [--rounds 3]

Sentences are simulated at 60 Hz, with head motion, gaps and 0.3 mm of noise, and written as
Qualisys TSV; then ``mocap-fit fit`` fits them all. Beside it the same is done in parts: the files
read and the results written, and nothing else; and Newton's method alone, from markers without
head motion to parameters. The whole is asked to take no more than three times these two together.

Times are of the processor, but for the last lines, which compare one process with several and say
what a clock says: for these nothing else may run.
"""

import os

# ruff: noqa: E402
for _variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[_variable] = "1"  # before numpy is imported, or it does not count

import argparse
import contextlib
import io
import json
import shutil
import subprocess
import sys
import tempfile
import time
import warnings
from pathlib import Path

import numpy as np

from corpus_tools.cli import app as cli
from mocap_fit import read_tracks
from mocap_fit.fitting import fit_speaker
from mocap_fit.fitting.compiled_solver import CompiledSolver
from mocap_fit.tracks import MarkerTracks, read_parquet, write_parquet

LAYOUT = "face30-head5"


def command(session: Path, out: Path, *options: str) -> list[str]:
    """Return the arguments that fit all of a session."""
    files = ["fit", str(session / "recordings"), "--reference", str(session / "reference.tsv")]
    return [*files, "--layout", LAYOUT, "--out", str(out), *options]


def quietly(arguments: list[str]) -> str:
    """Run a command here; what it prints."""
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed), contextlib.redirect_stderr(io.StringIO()):
        status = cli.main(arguments)
    if status:
        raise SystemExit(f"{arguments[0]} failed: {printed.getvalue()}")
    return printed.getvalue()


def read_and_write(session: Path, out: Path, again: Path) -> float:
    """Seconds for the input and the output alone."""
    results = {path.stem: read_parquet(path) for path in out.iterdir()}
    again.mkdir()
    start = time.process_time()
    for path in sorted((session / "recordings").iterdir()):
        read_tracks(path)
        write_parquet(results[path.stem], again / f"{path.stem}.parquet")
    return time.process_time() - start


def newton_alone(session: Path) -> float:
    """Seconds for Newton's method alone, on all sentences."""
    speaker = fit_speaker("built-in", LAYOUT, session / "reference.tsv")
    binding = speaker.binding
    warnings.simplefilter("ignore")  # of frames whose head pose is not known: the command told
    stills = [
        speaker.remove_head_motion(read_tracks(path))[0]
        for path in sorted((session / "recordings").iterdir())
    ]

    def solve(still: MarkerTracks) -> None:
        targets = binding.orientation.apply(still.positions[:, still.indices(binding.names)])
        usable = np.isfinite(targets[:, :, 0]).sum(axis=1) >= 2
        solver = CompiledSolver(
            binding, "distances", 1.0, solver="newton", maximum_evaluations=2000
        )
        solver.solve(targets, np.zeros((len(targets), 0, 3)), usable)

    solve(stills[0])
    start = time.process_time()
    for still in stills:
        solve(still)
    return time.process_time() - start


def elapsed(session: Path, out: Path, jobs: int) -> tuple[float, float]:
    """Seconds by the clock for the command in a process of its own, and from the speaker on."""
    code = "import sys; from corpus_tools.cli import app as cli; sys.exit(cli.main())"
    shutil.rmtree(out, ignore_errors=True)
    run = [sys.executable, "-c", code, *command(session, out, "--json", "--jobs", str(jobs))]
    start = time.perf_counter()
    said = json.loads(subprocess.run(run, check=True, capture_output=True).stdout)["seconds"]
    return time.perf_counter() - start, said["elapsed"] - said["speaker"]


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sentences", type=int, default=287)
    parser.add_argument("--seconds", type=float, default=5.0, help="length of each")
    parser.add_argument("--jobs", type=int, default=2, help="processes to compare with one")
    parser.add_argument("--rounds", type=int, default=3, help="of the clock; the best counts")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        session = folder / "session"
        count, length = str(arguments.sentences), str(arguments.seconds)
        quietly(["simulate", str(session), "--utterances", count, "--duration", length])
        quietly(command(session, folder / "warm", "--json"))  # compiles what is not yet compiled
        start = time.process_time()
        said = json.loads(quietly(command(session, folder / "out", "--json")))
        whole = time.process_time() - start
        frames = sum(row["frames"] for row in said["recordings"])
        both = read_and_write(session, folder / "out", folder / "again")
        newton = newton_alone(session)
        print(f"{arguments.sentences} sentences, {frames} frames, one process (processor seconds)")
        print(f"  the command           {whole:7.2f}   {frames / whole:8.0f} frames/s")
        for part, seconds in said["seconds"].items():
            print(f"    {part:19s} {seconds:7.2f}   (by the clock)")
        print(f"  input and output      {both:7.2f}")
        print(f"  Newton alone          {newton:7.2f}   {frames / newton:8.0f} frames/s")
        print(f"  the command takes     {whole / (both + newton):7.2f}   times these two together")
        rounds = [
            [elapsed(session, folder / "timed", jobs) for jobs in (1, arguments.jobs)]
            for _ in range(arguments.rounds)
        ]
        (one, own), (several, shared) = (
            map(min, zip(*runs, strict=True)) for runs in zip(*rounds, strict=True)
        )
        print(f"by the clock, with the start of Python: one process {one:.1f} s,")
        print(f"  {arguments.jobs} processes {several:.1f} s, {one / several:.2f} times as fast")
        print(
            f"  without it and the speaker: {own:.1f} s, {shared:.1f} s, {own / shared:.2f} times"
        )


if __name__ == "__main__":
    main()
