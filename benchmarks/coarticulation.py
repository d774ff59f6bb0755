"""Training of Cohen-Massaro's and Öhman's models: ours against scipy's L-BFGS-B, in one run.

    python benchmarks/coarticulation.py [--quick] [--json]

Sentences of 300 frames at 60 Hz whose parameters a model of the same kind made, with noise that
moves as slowly as a face does. Ours is `fit`; its time holds everything but the steps beyond the
error that counts. The peer is `scipy.optimize.minimize(method="L-BFGS-B")` with the error of eq. 5
and its gradient in dense numpy, from the same start, in the same unknowns and with the same bounds.
Both run until the error is within 0.1 % of the least that ours found; times are the thread's own.

200 sentences; with --quick 20 for Cohen-Massaro and 40 for Öhman. Ours trains ten parameters (two
for Cohen-Massaro with --quick), the peer one, and its time counts as often; what the peer needs of
the sentences is made before its time begins. A peer that has not the same error after many calls
is ended, and the ratio is then what it is at least.
"""

import os

# ruff: noqa: E402
for _variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[_variable] = "1"  # before numpy is imported, or it does not count

import argparse
import json
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.optimize import minimize

from mocap_fit import control
from mocap_fit.control import dominance
from mocap_fit.control.blending import compute_blends, find_peaks
from mocap_fit.corpus import Corpus, Utterance
from mocap_fit.phones import (
    ARTICULATORY_PARAMETERS,
    PhoneSegment,
    PhoneSequence,
    PhoneSet,
    load_phone_set,
)
from mocap_fit.tracks import FloatArray, ParameterTracks

RATE, FRAMES, SEED = 60.0, 300, 1
WITHIN = 1.001
PEER = "scipy L-BFGS-B"
# How often the peer may compute the error and its gradient, and with --quick.
MOST, MOST_QUICK = 4000, 800


def sentences(phone_set: PhoneSet, count: int) -> list[PhoneSequence]:
    """Draw phones, some more frequent than others, in sentences of 300 frames."""
    rng = np.random.default_rng(SEED)
    symbols = phone_set.list_symbols()
    often = 1.0 / (3.0 + rng.permutation(len(symbols)))
    found = []
    for number in range(count):
        lengths = np.clip(rng.gamma(6.0, 1.0, FRAMES), 2.0, 20.0)
        ends = np.cumsum(lengths) / RATE
        ends = ends[: np.searchsorted(ends, FRAMES / RATE) + 1]
        chosen = rng.choice(symbols, len(ends), p=often / often.sum())
        chosen[[0, -1]] = phone_set.silence
        segments = []
        for start, end, symbol in zip([0.0, *ends[:-1]], ends, chosen, strict=True):
            phone, stress = phone_set.parse(symbol)
            segments.append(PhoneSegment(float(start), float(end), phone, stress))
        found.append(
            PhoneSequence(tuple(segments), phone_set=phone_set.name, name=f"s{number:03d}")
        )
    return found


class Problem:
    """Sentences, their frames, and what each kind of model needs of them in numpy."""

    def __init__(self, count: int, parameters: int) -> None:
        self.phone_set = load_phone_set("sv-sta")
        self.symbols = self.phone_set.list_symbols()
        self.phones = sentences(self.phone_set, count)
        self.names = ARTICULATORY_PARAMETERS[:parameters]
        self.times = np.arange(FRAMES) / RATE
        self.positions = [
            np.array([self.symbols.index(self.phone_set.get_symbol(s)) for s in each])
            for each in self.phones
        ]
        self.centres = [0.5 * (each.starts + each.ends) for each in self.phones]
        self.is_vowel = np.array([self.phone_set.is_vowel(symbol) for symbol in self.symbols])
        seen = np.ones(len(self.symbols), dtype=bool)
        hold = control.create("ohman").get_params()["hold"]
        pairs = [
            compute_blends(p, find_peaks(each, hold), self.times, self.is_vowel, seen)
            for p, each in zip(self.positions, self.phones, strict=True)
        ]
        self.track = np.concatenate([pair.track.toarray() for pair in pairs])
        self.consonants = np.concatenate([pair.consonants.toarray() for pair in pairs])
        # Tenths of a second, as `cohen-massaro` trains.
        self.frames = [
            dominance.Frames.from_segments(p, 10.0 * c, 10.0 * self.times)
            for p, c in zip(self.positions, self.centres, strict=True)
        ]

    def corpus(self, make: Callable[[np.random.Generator], FloatArray]) -> Corpus:
        """Return the sentences with parameters that a model makes, and slow noise."""
        rng = np.random.default_rng(SEED + 1)
        values = np.stack([make(rng) for _ in self.names], axis=1)
        frequencies = np.fft.rfftfreq(len(values), 1 / RATE)
        low = np.exp(-0.5 * (frequencies / 3.0) ** 2)
        noise = np.fft.irfft(
            np.fft.rfft(rng.standard_normal(values.shape), axis=0) * low[:, None],
            len(values),
            axis=0,
        )
        values = values + 0.04 * noise / noise.std() + 0.02 * rng.standard_normal(values.shape)
        parts = values.reshape(len(self.phones), FRAMES, -1)
        return Corpus.from_utterances(
            [
                Utterance.from_tracks(ParameterTracks(self.names, RATE, part, name=each.name), each)
                for part, each in zip(parts, self.phones, strict=True)
            ],
            self.phone_set,
        )


def cohen_massaro(problem: Problem, most: int) -> dict[str, Any]:
    """Measure both trainings of Cohen-Massaro's model."""
    phones = len(problem.symbols)

    def make(rng: np.random.Generator) -> FloatArray:
        spreads = np.array([0.3, 0.5, 0.4, 0.4, 0.2])
        free = rng.standard_normal((phones, 5)) * spreads + np.array([0.0, 0.0, 0.3, 0.3, 0.1])
        return np.concatenate(
            [dominance.compute_trajectory(free, frames) for frames in problem.frames]
        )

    corpus = problem.corpus(make)
    start = np.concatenate(
        [np.zeros((phones, 1)), np.tile([0.0, 0.3, 0.3, 0.2], (phones, 1))], axis=1
    )
    ours = trained("cohen-massaro", corpus)
    wanted = np.concatenate([each.read_tracks().values[:, 0] for each in corpus])
    # The peer's targets begin where ours do: at the phones' best for the start's dominances.
    shares = np.zeros((len(wanted), phones))
    prepared = []
    for number, frames in enumerate(problem.frames):
        rows = np.arange(FRAMES)[:, None]
        segments = frames.phones[frames.segments]
        part = dominance.compute_shares(start, frames)
        np.add.at(shares[number * FRAMES : (number + 1) * FRAMES], (rows, segments), part)
        before = np.arange(frames.logarithms.shape[1]) < frames.before[:, None]
        prepared.append((segments, before, frames.logarithms))
    start[:, 0] = np.linalg.lstsq(shares, wanted, rcond=None)[0]

    def value_and_slope(point: FloatArray) -> tuple[float, FloatArray]:
        """Compute equation 5 and its gradient, a sentence at a time, dense."""
        free = point.reshape(-1, 5)
        c = np.exp(free[:, 4])
        slope, total = np.zeros((5, phones)), 0.0
        for number, (segments, before, logarithms) in enumerate(prepared):
            power = np.exp(
                np.where(before, free[segments, 3], free[segments, 2]) + c[segments] * logarithms
            )
            exponent = free[segments, 1] - power
            part = np.exp(exponent - exponent.max(axis=1, keepdims=True))
            part /= part.sum(axis=1, keepdims=True)
            targets = free[segments, 0]
            found = np.sum(part * targets, axis=1)
            apart = found - wanted[number * FRAMES : (number + 1) * FRAMES]
            total += float(apart @ apart)
            by_target = 2.0 * apart[:, None] * part
            by_alpha = by_target * (targets - found[:, None])
            by_power = -by_alpha * power
            five = (
                by_target,
                by_alpha,
                np.where(before, 0.0, by_power),
                np.where(before, by_power, 0.0),
                by_power * c[segments] * logarithms,
            )
            for row, each in zip(slope, five, strict=True):
                row += np.bincount(segments.ravel(), each.ravel(), phones)
        return total, slope.T.ravel()

    free = [(None, None), (-12, 12), (-8, 6), (-8, 6), (-1.6, 1.4)]
    return against(
        "cohen-massaro", ours, value_and_slope, start.ravel(), free * phones, wanted, most
    )


def ohman(problem: Problem, most: int) -> dict[str, Any]:
    """Measure both trainings of Öhman's model."""
    phones = len(problem.symbols)
    track, consonants = problem.track, problem.consonants

    def make(rng: np.random.Generator) -> FloatArray:
        targets, factors = rng.normal(0.0, 0.3, phones), rng.uniform(0.05, 0.95, phones)
        v = track @ targets
        return v + consonants @ (factors * targets) - (consonants @ factors) * v

    corpus = problem.corpus(make)
    ours = trained("ohman", corpus)
    wanted = np.concatenate([each.read_tracks().values[:, 0] for each in corpus])
    wanted = wanted - wanted.mean()

    def value_and_slope(point: FloatArray) -> tuple[float, FloatArray]:
        """Compute equation 5 and its gradient, dense."""
        targets, factors = point[:phones], point[phones:]
        v = track @ targets
        left = 1.0 - consonants @ factors
        apart = left * v + consonants @ (factors * targets) - wanted
        pulled = consonants.T @ apart
        by_targets = track.T @ (left * apart) + factors * pulled
        by_factors = targets * pulled - consonants.T @ (v * apart)
        return float(apart @ apart), 2.0 * np.concatenate([by_targets, by_factors])

    start = np.concatenate([np.zeros(phones), np.where(problem.is_vowel, 0.0, 0.5)])
    far = 2.0 * float(np.abs(wanted).max())
    bounds = [(-far, far)] * phones + [(0.0, 0.0 if v else 1.0) for v in problem.is_vowel]
    return against("ohman", ours, value_and_slope, start, bounds, wanted, most)


def trained(name: str, corpus: Corpus) -> dict[str, Any]:
    """Measure our training until the error is within the limit."""
    # Compiled functions are compiled before, or found in their cache.
    control.create(name, max_iter=1).fit(corpus.select([corpus.utterances[0].id]))
    curves: dict[str, list[tuple[float, float]]] = {}
    begin = time.thread_time()

    def log(entry: control.LogEntry) -> None:
        curves.setdefault(entry.part, []).append((time.thread_time() - begin, entry.training_error))

    model = control.create(name, l2=0.0, tol=1e-6)
    model.fit(corpus, progress=log)
    # Of each parameter, the time until its error was within the limit; then the next one began.
    seconds, last = 0.0, 0.0
    for curve in curves.values():
        limit = WITHIN * min(error for _, error in curve) ** 2
        seconds += next(at for at, error in curve if error**2 <= limit) - last
        last = curve[-1][0]
    first = next(iter(curves.values()))
    least = min(error for _, error in first)
    iterations = next(i for i, (_, error) in enumerate(first) if error**2 <= WITHIN * least**2)
    return {"seconds": seconds, "error": least, "iterations": iterations, "parameters": len(curves)}


class Arrived(Exception):
    """The peer's error is where it must be."""


def against(
    name: str,
    ours: dict[str, Any],
    value_and_slope: Callable[[FloatArray], tuple[float, FloatArray]],
    start: FloatArray,
    bounds: list[tuple[float | None, float | None]],
    wanted: FloatArray,
    most: int,
) -> dict[str, Any]:
    """Return a row: ours, and scipy's search until it has the same error."""
    limit = WITHIN * ours["error"] ** 2 * len(wanted)
    least, calls = np.inf, 0

    def count(point: FloatArray) -> tuple[float, FloatArray]:
        nonlocal least, calls
        found = value_and_slope(point)
        least, calls = min(least, found[0]), calls + 1
        if found[0] <= limit:
            raise Arrived
        return found

    begin = time.thread_time()
    try:
        options = {"maxiter": most, "maxfun": most, "ftol": 1e-12, "gtol": 1e-10}
        minimize(count, start, jac=True, method="L-BFGS-B", bounds=bounds, options=options)
    except Arrived:
        pass
    peer = (time.thread_time() - begin) * ours["parameters"]
    return {
        "model": name,
        "parameters": ours["parameters"],
        "seconds": ours["seconds"],
        "iterations": ours["iterations"],
        "error": ours["error"],
        "peer": PEER,
        "peer_seconds": peer,
        "peer_calls": calls,
        "peer_error": float(np.sqrt(least / len(wanted))),
        "peer_arrived": bool(least <= limit),
        "ratio": peer / ours["seconds"],
    }


def measure(quick: bool) -> list[dict[str, Any]]:
    """Return a row for each model."""
    if quick:
        return [cohen_massaro(Problem(20, 2), MOST_QUICK), ohman(Problem(40, 10), MOST_QUICK)]
    problem = Problem(200, 10)
    return [cohen_massaro(problem, MOST), ohman(problem, MOST)]


def show(rows: list[dict[str, Any]]) -> None:
    """Print a table."""
    print(f"{'model':15s}{'ours':>9s}{'peer':>10s}{'ratio':>8s}  iterations, calls of the peer")
    for row in rows:
        less = "" if row["peer_arrived"] else "  (the peer ended before it was there)"
        print(
            f"{row['model']:15s}{row['seconds']:7.2f} s{row['peer_seconds']:8.1f} s"
            f"{row['ratio']:7.1f}×  {row['iterations']}, {row['peer_calls']}{less}"
        )


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="fewer sentences, one parameter")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    arguments = parser.parse_args()
    rows = measure(arguments.quick)
    if arguments.json:
        print(json.dumps({"models": rows}))
    else:
        show(rows)


if __name__ == "__main__":
    main()
