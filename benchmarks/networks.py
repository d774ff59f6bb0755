"""The recurrent networks' speed: an epoch of training against plain loops, and a live frame.

    python benchmarks/networks.py [--quick] [--json]

The four networks of Table 1 (123,870 connections) learn from sentences of 300 frames, in batches of
two, as `ann` does; an epoch is 200 sentences. The peers do the same arithmetic as it is written
down, from the same weights on the same batches:

- plain numpy: network by network, sentence by sentence and frame by frame, forwards and backwards;
- torch eager: network by network and frame by frame on the whole batch, with autograd (null where
  torch is not installed; in single precision on one thread, as ours is).

Every method's loss of the first batch is printed, and its gradient is checked against ours, so that
an epoch of each leads to the same loss. Steps of the optimiser are the same for all and are left
out. Times are the thread's own (one core), medians over rounds in which the methods take turns,
counted up to an epoch. A live frame is one of `ann-low-latency` at 60 frames/s, phones pushed and
frames pulled as they come.
"""

import os

# ruff: noqa: E402
for _variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[_variable] = "1"  # before numpy is imported, or it does not count

import argparse
import json
import statistics
import time
from collections.abc import Callable

import numpy as np

from mocap_fit import control
from mocap_fit.control.networks.recurrent import Weights, compute_errors_and_gradient, draw_weights
from mocap_fit.corpus import Corpus, Utterance
from mocap_fit.phones import ARTICULATORY_PARAMETERS, PhoneSegment, PhoneSequence, load_phone_set
from mocap_fit.tracks import ParameterTracks

SENTENCES, FRAMES, BATCH, CONTEXT, INPUTS, DELAYS, SEED = 200, 300, 2, 31, 18, 5, 1
# Hidden units and outputs of two stacks of two networks each.
SIZES = ((50, 3), (30, 2))
OURS, PLAIN, TORCH = "mocap-fit", "plain numpy", "torch eager"


def make_batch(rng: np.random.Generator) -> tuple[np.ndarray, list[np.ndarray]]:
    """Draw what the input layer sees, and the targets of each stack."""
    phones = (rng.random((40, INPUTS)) < 0.4).astype(np.float32)
    frames = FRAMES + CONTEXT - 1
    inputs = np.empty((BATCH, frames, INPUTS), np.float32)
    for sentence in range(BATCH):
        lengths = rng.integers(3, 9, frames)
        inputs[sentence] = np.repeat(phones[rng.integers(40, size=frames)], lengths, axis=0)[
            :frames
        ]
    seen = np.lib.stride_tricks.sliding_window_view(inputs, CONTEXT, axis=1)
    seen = np.ascontiguousarray(np.moveaxis(seen, -1, -2)).reshape(BATCH, FRAMES, -1)
    targets = [
        rng.normal(size=(2, BATCH, FRAMES, outputs)).astype(np.float32) for _, outputs in SIZES
    ]
    return seen, targets


def ours(stacks: list[Weights], seen: np.ndarray, targets: list[np.ndarray]):
    """Compute loss and gradients as `mocap_fit` does."""
    loss, gradients = 0.0, []
    for weights, wanted in zip(stacks, targets, strict=True):
        squares, gradient = compute_errors_and_gradient(weights, seen, wanted, np.ones_like(wanted))
        loss += float(squares.sum()) / wanted[0].size
        gradients.append(gradient)
    return loss, gradients


def plain(stacks: list[Weights], seen: np.ndarray, targets: list[np.ndarray]):
    """Compute the same network by network, sentence by sentence and frame by frame."""
    loss, gradients = 0.0, []
    for weights, wanted in zip(stacks, targets, strict=True):
        gradient = weights.map(np.zeros_like)
        hidden = weights.inputs.shape[2]
        for network in range(len(weights.inputs)):
            own = Weights(*(array[network] for array in weights))
            slope = Weights(*(array[network] for array in gradient))
            blocks = own.delayed.reshape(DELAYS, hidden, hidden)[::-1]
            slopes = slope.delayed.reshape(DELAYS, hidden, hidden)[::-1]
            for sentence in range(BATCH):
                units, errors = [], []
                for frame in range(FRAMES):
                    net = seen[sentence, frame] @ own.inputs + own.hidden_bias[0]
                    for delay in range(1, min(DELAYS, frame) + 1):
                        net = net + units[frame - delay] @ blocks[delay - 1]
                    units.append(np.tanh(net))
                    found = units[-1] @ own.outputs + own.output_bias[0]
                    errors.append(found - wanted[network, sentence, frame])
                    loss += float(errors[-1] @ errors[-1]) / wanted[0].size
                sent = [None] * FRAMES
                for frame in range(FRAMES - 1, -1, -1):
                    difference = errors[frame] * (2.0 / wanted[0].size)
                    slope.outputs[:] += np.outer(units[frame], difference)
                    slope.output_bias[0] += difference
                    arriving = own.outputs @ difference
                    for delay in range(1, min(DELAYS, FRAMES - 1 - frame) + 1):
                        arriving = arriving + blocks[delay - 1] @ sent[frame + delay]
                    sent[frame] = arriving * (1 - units[frame] ** 2)
                    slope.inputs[:] += np.outer(seen[sentence, frame], sent[frame])
                    slope.hidden_bias[0] += sent[frame]
                    for delay in range(1, min(DELAYS, frame) + 1):
                        slopes[delay - 1] += np.outer(units[frame - delay], sent[frame])
        gradients.append(gradient)
    return loss, gradients


def torch_eager() -> Callable | None:
    """Return the same in torch, or None where it is not installed."""
    try:
        import torch
    except ImportError:
        return None
    torch.set_num_threads(1)

    def method(stacks: list[Weights], seen: np.ndarray, targets: list[np.ndarray]):
        loss, gradients = 0.0, []
        heard = torch.from_numpy(seen)
        for weights, wanted in zip(stacks, targets, strict=True):
            hidden = weights.inputs.shape[2]
            gradient = weights.map(np.zeros_like)
            for network in range(len(weights.inputs)):
                own = [torch.tensor(array[network], requires_grad=True) for array in weights]
                inputs, delayed, hidden_bias, outputs, output_bias = own
                units = [torch.zeros(BATCH, hidden) for _ in range(DELAYS)]
                found = []
                for frame in range(FRAMES):
                    net = heard[:, frame] @ inputs + hidden_bias
                    for delay in range(1, DELAYS + 1):
                        first = (DELAYS - delay) * hidden
                        net = net + units[-delay] @ delayed[first : first + hidden]
                    units.append(torch.tanh(net))
                    found.append(units[-1] @ outputs + output_bias)
                error = ((torch.stack(found, 1) - torch.from_numpy(wanted[network])) ** 2).mean()
                error.backward()
                loss += float(error)
                for array, tensor in zip(gradient, own, strict=True):
                    array[network] = tensor.grad.numpy()
            gradients.append(gradient)
        return loss, gradients

    return method


def measure_training(quick: bool) -> dict[str, dict[str, float] | None]:
    """Measure seconds an epoch, loss and ratio of every method."""
    rng = np.random.default_rng(SEED)
    stacks = [
        draw_weights(CONTEXT * INPUTS, hidden, outputs, DELAYS, rng, 2).map(
            lambda array: array.astype(np.float32)
        )
        for hidden, outputs in SIZES
    ]
    seen, targets = make_batch(rng)
    methods = {OURS: ours, PLAIN: plain, TORCH: torch_eager()}
    present = {name: method for name, method in methods.items() if method is not None}
    answers = {name: method(stacks, seen, targets) for name, method in present.items()}
    for name, (_, gradients) in answers.items():
        for found, wanted in zip(gradients, answers[OURS][1], strict=True):
            for one, other in zip(found, wanted, strict=True):
                apart = np.abs(one - other).max() / np.abs(other).max()
                assert apart < 1e-3, f"{name} computes another gradient"
    times: dict[str, list[float]] = {name: [] for name in present}
    for _ in range(3 if quick else 9):
        for name, method in present.items():
            times_of_ours = 5 if name == OURS else 1
            begun = time.thread_time()
            for _ in range(times_of_ours):
                method(stacks, seen, targets)
            times[name].append((time.thread_time() - begun) / times_of_ours)
    epoch = {name: statistics.median(each) * SENTENCES / BATCH for name, each in times.items()}
    return {
        name: None
        if name not in present
        else {
            "seconds_an_epoch": epoch[name],
            "loss": answers[name][0],
            "ours_is_faster_by": epoch[name] / epoch[OURS],
        }
        for name in methods
    }


def measure_live(quick: bool) -> dict[str, float]:
    """Measure microseconds a live frame of `ann-low-latency`."""
    chosen = load_phone_set("sv-sta")
    rng = np.random.default_rng(SEED)
    symbols = [phone.symbol for phone in chosen.phones]
    segments, at = [], 0.0
    while at < (20.0 if quick else 120.0):
        length = float(rng.uniform(0.05, 0.15))
        segments.append(PhoneSegment(at, at + length, symbols[rng.integers(len(symbols))]))
        at += length
    phones = PhoneSequence(tuple(segments), phone_set="sv-sta", name="live")
    tracks = ParameterTracks(ARTICULATORY_PARAMETERS, 60.0, rng.normal(size=(120, 10)), name="a")
    model = control.create("ann-low-latency", max_iter=0)
    model.fit(Corpus.from_utterances([Utterance.from_tracks(tracks, phones)], chosen))
    stream = model.stream(60.0)
    frames, times = 0, []
    for segment in phones:
        begun = time.thread_time()
        stream.push(segment)
        given = len(stream.pull())
        if given:
            times.append((time.thread_time() - begun) / given)
            frames += given
    # The first phones meet cold caches, and phones that were not heard yet.
    return {
        "frames": frames,
        "median_microseconds": 1e6 * statistics.median(times),
        "99_percent_below_microseconds": 1e6 * float(np.quantile(times, 0.99)),
    }


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="fewer rounds")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    arguments = parser.parse_args()
    training = measure_training(arguments.quick)
    live = measure_live(arguments.quick)
    if arguments.json:
        print(json.dumps({"training": training, "live": live}))
        return
    print(f"An epoch of {SENTENCES} sentences of {FRAMES} frames, batches of {BATCH}, one core:")
    for name, found in training.items():
        if found is None:
            print(f"  {name:12} not installed")
        else:
            print(
                f"  {name:12} {found['seconds_an_epoch']:8.2f} s   loss {found['loss']:.5f}"
                f"   ours is {found['ours_is_faster_by']:.1f} times as fast"
            )
    print(
        f"A live frame of ann-low-latency: {live['median_microseconds']:.0f} µs "
        f"(99 % below {live['99_percent_below_microseconds']:.0f} µs), {live['frames']} frames"
    )


if __name__ == "__main__":
    main()
