"""How long `mocap-fit --help` takes, against a bare `import numpy`, each as a process of its own.

    python benchmarks/startup.py [--rounds 15]

The two take turns, so that a busy machine slows both. The medians' ratio should stay under 4.
"""

import argparse
import statistics
import subprocess
import sys
import sysconfig
import time
from pathlib import Path

PROGRAM = Path(sysconfig.get_path("scripts")) / "mocap-fit"


def seconds(command: list[str]) -> float:
    """Measure the wall-clock time of one process."""
    start = time.perf_counter()
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    return time.perf_counter() - start


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=15)
    rounds = parser.parse_args().rounds
    commands = {
        "python -c 'import numpy'": [sys.executable, "-c", "import numpy"],
        "mocap-fit --help": [str(PROGRAM), "--help"],
    }
    for command in commands.values():
        seconds(command)  # once for the disk and the compiled bytecode
    times: dict[str, list[float]] = {name: [] for name in commands}
    for _ in range(rounds):
        for name, command in commands.items():
            times[name].append(seconds(command))
    medians = {name: statistics.median(values) for name, values in times.items()}
    for name, median in medians.items():
        print(f"{name:28s}{median * 1000:7.0f} ms")
    bare, ours = medians.values()
    print(f"{'ratio':28s}{ours / bare:7.2f}")


if __name__ == "__main__":
    main()
