"""How long `mocap-fit fit` of one sentence takes on a machine that has no kernels yet, and later.

    python benchmarks/first_run.py [--rounds 3]

Each is a process of its own, beside one that only imports the libraries that a fit needs. The
first has an empty cache, and compiles; the second finds what the first left there.
"""

import argparse
import os
import statistics
import sys
import tempfile
from pathlib import Path

from startup import PROGRAM, seconds

LIBRARIES = "import numpy, scipy.optimize, pandas, pyarrow.parquet, numba, nlopt"


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=3)
    rounds = parser.parse_args().rounds
    times: dict[str, list[float]] = {"libraries alone": [], "first run": [], "later run": []}
    with tempfile.TemporaryDirectory() as folder:
        session = Path(folder) / "session"
        seconds([str(PROGRAM), "simulate", str(session), "--utterances", "1"])
        fit = [str(PROGRAM), "fit", str(session / "recordings")]
        fit += ["--reference", str(session / "reference.tsv"), "--layout", "face30-head5"]
        for number in range(rounds):
            os.environ["NUMBA_CACHE_DIR"] = str(Path(folder) / str(number))
            times["libraries alone"].append(seconds([sys.executable, "-c", LIBRARIES]))
            for name in ("first run", "later run"):
                out = Path(folder) / f"{name} {number}"
                times[name].append(seconds([*fit, "--out", str(out)]))
    for name, values in times.items():
        print(
            f"{name:18s}{statistics.median(values):6.1f} s   ({min(values):.1f}-{max(values):.1f})"
        )
    libraries_alone, first, later = (statistics.median(values) for values in times.values())
    print(f"{'compiling':18s}{first - later:6.1f} s")
    print(f"{'later / libraries':18s}{later / libraries_alone:6.1f}")


if __name__ == "__main__":
    main()
