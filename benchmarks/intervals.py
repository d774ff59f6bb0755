"""How often the 95 % intervals of fitted parameters contain the truth, for heads of five shapes.

    python benchmarks/intervals.py [--seeds 40] [--noise 0.3] [--objective squares] [--json]

Each seed is a reference pose and a recording of free gestures with the layout face30-head5: 3 s at
60 Hz, head motion of ±30 mm and ±20°, 5 % drop-outs. It is fitted with the built-in head, frame by
frame and with ``--smooth``. The speaker has that head, or one of four others, which are not those
that `mocap_fit.fitting.precision.MISFIT_FACTOR` was set on. In per cent of the frames, for each
parameter and averaged over all.
"""

import argparse
import json
import warnings

import numpy as np

from corpus_tools.demonstration.comparison import FittedRecording, measure_coverage
from corpus_tools.simulation import Conditions, Session
from mocap_fit.errors import MocapFitWarning
from mocap_fit.face import load_face
from mocap_fit.face.builtin import load_built_in_head, reshape_head
from mocap_fit.fitting import fit_over_time, fit_speaker, load_layout

LAYOUT = "face30-head5"
HEADS: dict[str, dict[str, float]] = {
    "built-in": {},
    "small": {"size": 0.88},
    "broad": {"width": 1.07, "depth": 0.96, "mouth_width": 1.08},
    "long": {"size": 1.05, "width": 0.96, "lower_face": 1.09},
    "short": {"lower_face": 0.93, "mouth_width": 0.94, "depth": 1.05},
}


def measure(head: dict[str, float], seeds: int, noise: float, objective: str):
    """Return the coverage of every parameter, frame by frame and smooth."""
    face = load_face()
    wearer = load_face(mesh=reshape_head(load_built_in_head(), **head)) if head else face
    session = Session(load_layout(LAYOUT), wearer, Conditions(noise=noise, duration=3.0))
    fits: dict[str, list[FittedRecording]] = {"frame by frame": [], "smooth": []}
    for seed in range(seeds):
        first, second = np.random.default_rng(seed).spawn(2)
        speaker = fit_speaker(face, LAYOUT, session.record_reference(first))
        made = session.record(second)
        still, motion = speaker.remove_head_motion(speaker.prepare(made.recording))
        alone = speaker.fit_shape(still, objective=objective)
        smooth = fit_over_time(speaker.binding, still, alone, objective=objective)
        for way, fit in zip(fits, (alone, smooth), strict=True):
            fitted = FittedRecording(made.recording, fit, motion, made.parameters, made.pose)
            fits[way].append(fitted)
    return {way: measure_coverage(each, speaker.binding) for way, each in fits.items()}


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=40, help="recordings of each head")
    parser.add_argument("--noise", type=float, default=0.3, help="of a coordinate, millimetres")
    parser.add_argument("--objective", default="squares", help="squares, distances or huber")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    arguments = parser.parse_args()
    warnings.simplefilter("ignore", MocapFitWarning)
    settings = arguments.seeds, arguments.noise, arguments.objective
    results = {name: measure(head, *settings) for name, head in HEADS.items()}
    names = load_face().parameter_names
    if arguments.json:
        rows = {
            head: {way: dict(zip(names, map(float, row), strict=True)) for way, row in ways.items()}
            for head, ways in results.items()
        }
        print(json.dumps({"seeds": arguments.seeds, "noise": arguments.noise, "coverage": rows}))
        return
    columns = [(head, way) for head, ways in results.items() for way in ways]
    print(" " * 22, *(f"{head:>9s}" for head, _ in columns))
    print(" " * 22, *(f"{way.split()[0]:>9s}" for _, way in columns))
    for i, name in enumerate(names):
        print(f"{name:22s}", *(f"{100 * results[head][way][i]:9.1f}" for head, way in columns))
    averages = (100 * results[head][way].mean() for head, way in columns)
    print(f"{'average':22s}", *(f"{average:9.1f}" for average in averages))


if __name__ == "__main__":
    main()
