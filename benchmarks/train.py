"""Training of every model against its peer: `coarticulation.py` and `networks.py` in one table.

    python benchmarks/train.py [--quick] [--json]

Cohen-Massaro and Öhman: seconds until the error is within 0.1 % of the same, against scipy's
L-BFGS-B. The networks: seconds an epoch at equal batches and equal loss, against plain numpy and
torch loops (null where torch is not installed), and a live frame of `ann-low-latency`.
"""

import os

# ruff: noqa: E402
for _variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[_variable] = "1"  # before numpy is imported, or it does not count

import argparse
import json
from typing import Any

import coarticulation
import networks


def network_rows(quick: bool) -> list[dict[str, Any]]:
    """Return a row for each peer of the networks."""
    training = networks.measure_training(quick)
    own = training[networks.OURS]
    assert own is not None
    return [
        {
            "model": "ann",
            "seconds": own["seconds_an_epoch"],
            "loss": own["loss"],
            "peer": name,
            "peer_seconds": None if found is None else found["seconds_an_epoch"],
            "peer_loss": None if found is None else found["loss"],
            "ratio": None if found is None else found["ours_is_faster_by"],
        }
        for name, found in training.items()
        if name != networks.OURS
    ]


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="fewer sentences and rounds")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    arguments = parser.parse_args()
    rows = coarticulation.measure(arguments.quick) + network_rows(arguments.quick)
    live = networks.measure_live(arguments.quick)
    if arguments.json:
        print(json.dumps({"models": rows, "live": live}))
        return
    print(f"{'model':15s}{'ours':>9s}  {'peer':15s}{'its time':>10s}{'ratio':>8s}")
    for row in rows:
        told = f"{row['model']:15s}{row['seconds']:7.2f} s  {row['peer']:15s}"
        if row["peer_seconds"] is None:
            print(f"{told}  not installed")
        else:
            most = "≥" if row.get("peer_arrived") is False else " "
            print(f"{told}{row['peer_seconds']:8.1f} s {most}{row['ratio']:6.1f}")
    print("≥: the peer had not the same error when it was ended.")
    print(f"A live frame of ann-low-latency: {live['median_microseconds']:.0f} µs")


if __name__ == "__main__":
    main()
