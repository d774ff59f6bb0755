"""What the networks learn from: inputs and targets of every inner frame of an utterance."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mocap_fit.control.networks.features import INNER_RATE, compute_utterance_inputs, count_lead
from mocap_fit.corpus import Corpus, Utterance
from mocap_fit.errors import DataError
from mocap_fit.tracks import FloatArray, ParameterTracks, resample

# Between the frames of a corpus targets follow a smooth curve, which is sampled at this many points
# an inner frame and linear in between.
_OVERSAMPLING = 4


class Example(NamedTuple):
    """An utterance at the inner rate, from shortly before its first phone (`count_lead`).

    Parameters
    ----------
    inputs
        Inputs of the frames and of their context, ``(frames + context - 1, 18)``.
    targets
        Parameters, ``(frames, parameters)``, in the unit of the corpus; NaN where missing.
    """

    inputs: NDArray[np.float32]
    targets: FloatArray


class Batch(NamedTuple):
    """Utterances side by side, padded to the longest.

    Parameters
    ----------
    inputs
        Inputs of the frames and of their context, ``(sentences, frames + context - 1, 18)``.
    targets
        Parameters in units of the scale, ``(sentences, frames, parameters)``; 0 where missing.
    counted
        Whether a target counts, ``(sentences, frames, parameters)``: 1 or 0.
    """

    inputs: NDArray[np.float32]
    targets: NDArray[np.float32]
    counted: NDArray[np.float32]


class Scale(NamedTuple):
    """Mean and standard deviation of every parameter.

    Targets are trained on in these units, so that a parameter that moves little counts as much as
    one that moves far.

    Parameters
    ----------
    mean
        Means, ``(parameters,)``.
    deviation
        Standard deviations, ``(parameters,)``, above 0.
    """

    mean: FloatArray
    deviation: FloatArray

    @classmethod
    def from_examples(cls, examples: Sequence[Example]) -> Scale:
        """Return the scale of the targets; 0 and 1 for a parameter without values.

        Parameters
        ----------
        examples
            The utterances.

        Returns
        -------
        Scale
            Means and deviations.
        """
        targets = np.concatenate([each.targets for each in examples])
        counts = np.maximum(np.isfinite(targets).sum(axis=0), 1)
        mean = np.nansum(targets, axis=0) / counts
        deviation = np.sqrt(np.nansum((targets - mean) ** 2, axis=0) / counts)
        return cls(mean, np.where(deviation > 1e-12, deviation, 1.0))


def sample_targets(tracks: ParameterTracks, start_time: float) -> FloatArray:
    """Return the values of tracks at the inner frames from a start on.

    Parameters
    ----------
    tracks
        Tracks at any rate; from a higher one, what the inner rate cannot carry is filtered out.
    start_time
        Time of inner frame 0, seconds.

    Returns
    -------
    FloatArray
        Parameters, ``(frames, parameters)``, to the last frame that lies within the tracks; NaN
        before the first, and where the tracks miss a value.
    """
    last = tracks.start_time + (tracks.frames - 1) / tracks.rate
    frames = int(np.floor((last - start_time) * INNER_RATE + 1e-6)) + 1
    if tracks.frames == 0 or frames <= 0:
        return np.zeros((0, len(tracks.names)))
    if tracks.rate > INNER_RATE and tracks.frames > 1:
        tracks = resample(tracks, INNER_RATE)
    if tracks.frames > 1:
        tracks = resample(tracks, _OVERSAMPLING * INNER_RATE)
    positions = (start_time + np.arange(frames) / INNER_RATE - tracks.start_time) * tracks.rate
    inside = (positions > -1e-6) & (positions < tracks.frames - 1 + 1e-6)
    positions = np.clip(positions, 0, tracks.frames - 1)
    before = np.floor(positions + 1e-6).astype(np.intp)
    after = np.minimum(before + 1, tracks.frames - 1)
    share = np.maximum(positions - before, 0.0)
    share[share < 2e-6] = 0.0
    first = tracks.values[before]
    # A missing neighbour matters only where it has a share.
    second = np.where(share[:, None] > 0, tracks.values[after], first)
    return np.where(inside[:, None], first + share[:, None] * (second - first), np.nan)


def load_example(
    utterance: Utterance,
    corpus: Corpus,
    behind: int,
    ahead: int,
    stress: bool = True,
    after: int = 0,
) -> Example:
    """Load an utterance of a corpus at the inner rate.

    Parameters
    ----------
    utterance
        The utterance.
    corpus
        The corpus that it is from.
    behind
        Frames of context before a frame.
    ahead
        Frames of context after a frame.
    stress
        Whether stress is an input.
    after
        Number of frames without targets that are added at the end.

    Returns
    -------
    Example
        Inputs and targets.

    Raises
    ------
    DataError
        If it has no phones, or one that the phone set lacks.
    """
    phones = utterance.read_phones()
    if not len(phones):
        raise DataError(f"the utterance '{utterance.id}' has no phones")
    targets = sample_targets(
        utterance.read_tracks(), phones[0].start - count_lead(ahead) / INNER_RATE
    )
    targets = np.concatenate([targets, np.full((after, targets.shape[1]), np.nan)])
    inputs = compute_utterance_inputs(phones, corpus.phone_set, len(targets), behind, ahead, stress)
    return Example(inputs.astype(np.float32), targets)


def load_examples(
    corpus: Corpus, behind: int, ahead: int, stress: bool = True
) -> tuple[Example, ...]:
    """Load all utterances of a corpus that have a value to learn.

    Parameters
    ----------
    corpus
        The utterances.
    behind
        Frames of context before a frame.
    ahead
        Frames of context after a frame.
    stress
        Whether stress is an input.

    Returns
    -------
    tuple[Example, ...]
        In the order of the corpus.

    Raises
    ------
    DataError
        If none has a value, or one has no phones.
    """
    loaded = (load_example(utterance, corpus, behind, ahead, stress) for utterance in corpus)
    examples = tuple(each for each in loaded if np.isfinite(each.targets).any())
    if not examples:
        raise DataError(
            "no utterance has a parameter value while its phones are spoken",
            advice="Check that tracks and phones are on one clock.",
        )
    return examples


def build_batch(examples: Sequence[Example], scale: Scale) -> Batch:
    """Return examples side by side.

    Parameters
    ----------
    examples
        The utterances.
    scale
        The units of the targets.

    Returns
    -------
    Batch
        The utterances, padded to the longest.
    """
    frames = max(len(each.targets) for each in examples)
    context = len(examples[0].inputs) - len(examples[0].targets)
    shape = (len(examples), frames, len(scale.mean))
    inputs = np.zeros((len(examples), frames + context, examples[0].inputs.shape[1]), np.float32)
    targets, counted = np.zeros(shape, np.float32), np.zeros(shape, np.float32)
    for i, each in enumerate(examples):
        inputs[i, : len(each.inputs)] = each.inputs
        valid = np.isfinite(each.targets)
        scaled = (each.targets - scale.mean) / scale.deviation
        targets[i, : len(valid)] = np.where(valid, scaled, 0.0)
        counted[i, : len(valid)] = valid
    return Batch(inputs, targets, counted)


def split_into_batches(
    examples: Sequence[Example], size: int, generator: np.random.Generator | None = None
) -> list[tuple[int, ...]]:
    """Return which examples form batches: of about one length, so that little is padded.

    Parameters
    ----------
    examples
        The utterances.
    size
        Number of examples in a batch.
    generator
        Shuffles them, differently each time; the order is that of length by default.

    Returns
    -------
    list[tuple[int, ...]]
        Positions of the examples of each batch.
    """
    lengths: NDArray[Any] = np.array([len(each.targets) for each in examples], dtype=np.float64)
    if generator is not None:
        lengths = lengths * generator.uniform(0.85, 1.15, len(lengths))
    order = np.argsort(lengths, kind="stable")
    groups = [tuple(order[i : i + size].tolist()) for i in range(0, len(order), size)]
    if generator is not None:
        groups = [groups[i] for i in generator.permutation(len(groups))]
    return groups
