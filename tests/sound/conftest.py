"""A pulse train whose every frame is known."""

from dataclasses import dataclass

import numpy as np
import pytest


@dataclass(frozen=True)
class Train:
    """A channel with a pulse a frame, and what is true of it."""

    channel: np.ndarray
    samples: np.ndarray
    times: np.ndarray
    missing: np.ndarray
    rate: float


def made(
    rate=48000.0,
    frame_rate=60.0,
    frames=240,
    *,
    drift_ppm=0.0,
    start=0.25,
    width=24,
    height=0.5,
    noise_db=None,
    missing=0.0,
    doubled=0,
    tail=0.3,
    seed=0,
):
    """`noise_db` is the pulses' peak power over the noise's; `missing` a part of the pulses."""
    rng = np.random.default_rng(seed)
    times = start + np.arange(frames) / (frame_rate * (1 + 1e-6 * drift_ppm))
    samples = np.rint(times * rate).astype(int)
    channel = np.zeros(samples[-1] + width + int(tail * rate))
    gone = rng.random(frames) < missing
    for sample in samples[~gone]:
        channel[sample : sample + width] = height
    for sample in rng.choice(samples[~gone], doubled, replace=False):
        channel[sample + 5 * width : sample + 6 * width] = height
    if noise_db is not None:
        channel += rng.normal(0, height * 10 ** (-noise_db / 20), len(channel))
    return Train(channel, samples, times, gone, rate)


@pytest.fixture(scope="session")
def make_train():
    return made
