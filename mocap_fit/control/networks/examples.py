"""What the networks learn from: inputs and targets of every inner frame of an utterance."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mocap_fit.control.networks.features import INNER_RATE, lead, utterance_inputs
from mocap_fit.corpus import Corpus, Utterance
from mocap_fit.errors import DataError
from mocap_fit.tracks import FloatArray, ParameterTracks, resample

# Between the frames of a corpus targets follow a smooth curve, which is read at this many points
# an inner frame and straight in between.
_FINER = 4


class Example(NamedTuple):
    """An utterance at the inner rate, from shortly before its first phone (`lead`).

    Parameters
    ----------
    inputs
        `(frames + context - 1, 18)`: of the frames and of the context round them.
    targets
        `(frames, parameters)`, in the unit of the corpus; NaN where one is missing.
    """

    inputs: NDArray[np.float32]
    targets: FloatArray


class Batch(NamedTuple):
    """Utterances side by side, padded to the longest.

    Parameters
    ----------
    inputs
        `(sentences, frames + context - 1, 18)`.
    targets
        `(sentences, frames, parameters)`, in units of the scale; 0 where one does not count.
    counted
        The same shape: 1 where a target counts, else 0.
    """

    inputs: NDArray[np.float32]
    targets: NDArray[np.float32]
    counted: NDArray[np.float32]


class Scale(NamedTuple):
    """Mean and standard deviation of every parameter, `(parameters,)` each.

    Targets are trained on in these units, so that a parameter that moves little counts as much as
    one that moves far.
    """

    mean: FloatArray
    deviation: FloatArray


def inner_targets(tracks: ParameterTracks, start_time: float) -> FloatArray:
    """Values of tracks at the inner frames from a start on, `(frames, parameters)`.

    Parameters
    ----------
    tracks
        At any rate; from a higher one, what the inner rate cannot carry is filtered out.
    start_time
        Of inner frame 0, seconds.

    Returns
    -------
    FloatArray
        To the last frame that lies within the tracks; NaN before the first, and where the tracks
        miss a value.
    """
    last = tracks.start_time + (tracks.frames - 1) / tracks.rate
    frames = int(np.floor((last - start_time) * INNER_RATE + 1e-6)) + 1
    if tracks.frames == 0 or frames <= 0:
        return np.zeros((0, len(tracks.names)))
    if tracks.rate > INNER_RATE and tracks.frames > 1:
        tracks = resample(tracks, INNER_RATE)
    if tracks.frames > 1:
        tracks = resample(tracks, _FINER * INNER_RATE)
    places = (start_time + np.arange(frames) / INNER_RATE - tracks.start_time) * tracks.rate
    inside = (places > -1e-6) & (places < tracks.frames - 1 + 1e-6)
    places = np.clip(places, 0, tracks.frames - 1)
    before = np.floor(places + 1e-6).astype(np.intp)
    after = np.minimum(before + 1, tracks.frames - 1)
    share = np.maximum(places - before, 0.0)
    share[share < 2e-6] = 0.0
    there = tracks.values[before]
    # A missing neighbour matters only where it has a share.
    towards = np.where(share[:, None] > 0, tracks.values[after], there)
    found = there + share[:, None] * (towards - there)
    return np.where(inside[:, None], found, np.nan)


def example(
    utterance: Utterance,
    corpus: Corpus,
    behind: int,
    ahead: int,
    stress: bool = True,
    after: int = 0,
) -> Example:
    """An utterance of a corpus at the inner rate.

    Parameters
    ----------
    utterance
        One of the corpus.
    corpus
        What it is of.
    behind, ahead
        Frames of context.
    stress
        Whether stress is told.
    after
        Frames without targets that follow it.

    Raises
    ------
    DataError
        If it has no phones, or one that the phone set does not know.
    """
    phones = utterance.read_phones()
    if not len(phones):
        raise DataError(f"the utterance '{utterance.id}' has no phones")
    targets = inner_targets(utterance.read_tracks(), phones[0].start - lead(ahead) / INNER_RATE)
    targets = np.concatenate([targets, np.full((after, targets.shape[1]), np.nan)])
    inputs = utterance_inputs(phones, corpus.phone_set, len(targets), behind, ahead, stress)
    return Example(inputs.astype(np.float32), targets)


def examples(corpus: Corpus, behind: int, ahead: int, stress: bool = True) -> tuple[Example, ...]:
    """All utterances of a corpus that have a value to learn.

    Raises
    ------
    DataError
        If none has, or one has no phones.
    """
    found = (example(utterance, corpus, behind, ahead, stress) for utterance in corpus)
    kept = tuple(each for each in found if np.isfinite(each.targets).any())
    if not kept:
        raise DataError(
            "no utterance has a parameter value while its phones are spoken",
            advice="Check that tracks and phones are on one clock.",
        )
    return kept


def scale_of(those: Sequence[Example]) -> Scale:
    """Mean and standard deviation of the targets; 0 and 1 where there is none to tell."""
    targets = np.concatenate([each.targets for each in those])
    counts = np.maximum(np.isfinite(targets).sum(axis=0), 1)
    mean = np.nansum(targets, axis=0) / counts
    deviation = np.sqrt(np.nansum((targets - mean) ** 2, axis=0) / counts)
    return Scale(mean, np.where(deviation > 1e-12, deviation, 1.0))


def batch(those: Sequence[Example], scale: Scale) -> Batch:
    """Several examples side by side."""
    frames = max(len(each.targets) for each in those)
    context = len(those[0].inputs) - len(those[0].targets)
    shape = (len(those), frames, len(scale.mean))
    inputs = np.zeros((len(those), frames + context, those[0].inputs.shape[1]), np.float32)
    targets, counted = np.zeros(shape, np.float32), np.zeros(shape, np.float32)
    for i, each in enumerate(those):
        inputs[i, : len(each.inputs)] = each.inputs
        there = np.isfinite(each.targets)
        scaled = (each.targets - scale.mean) / scale.deviation
        targets[i, : len(there)] = np.where(there, scaled, 0.0)
        counted[i, : len(there)] = there
    return Batch(inputs, targets, counted)


def in_batches(
    those: Sequence[Example], size: int, generator: np.random.Generator | None = None
) -> list[tuple[int, ...]]:
    """Which examples go together: of about one length, so that little is padded.

    Parameters
    ----------
    those
        The examples.
    size
        Of a batch.
    generator
        What mixes them, another way each time; the order is that of length where not given.
    """
    lengths: NDArray[Any] = np.array([len(each.targets) for each in those], dtype=np.float64)
    if generator is not None:
        lengths = lengths * generator.uniform(0.85, 1.15, len(lengths))
    order = np.argsort(lengths, kind="stable")
    groups = [tuple(order[i : i + size].tolist()) for i in range(0, len(order), size)]
    if generator is not None:
        groups = [groups[i] for i in generator.permutation(len(groups))]
    return groups
