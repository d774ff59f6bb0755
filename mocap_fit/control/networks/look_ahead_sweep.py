"""How much look-ahead is worth: networks that see 0 to 15 frames ahead (Beskow figure 4)."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from mocap_fit.control.base import LogEntry, Progress
from mocap_fit.control.networks.examples import Example, example, scale_of
from mocap_fit.control.networks.features import INNER_RATE
from mocap_fit.control.networks.models import TABLE_1, LowLatencyNetworks
from mocap_fit.control.networks.stack import Network
from mocap_fit.control.networks.training import Training
from mocap_fit.corpus import Corpus, Utterance
from mocap_fit.errors import ConfigurationError, DataError

#: Frames of the context, whatever part of it lies ahead.
CONTEXT = 31


class SweepPoint(NamedTuple):
    """A point of figure 4.

    Parameters
    ----------
    frames
        Look-ahead, frames of 1/60 s.
    look_ahead
        The same, seconds.
    error
        Root mean square error over the held-out utterances, in the unit of the parameters.
    epoch
        When it was reached.
    """

    frames: int
    look_ahead: float
    error: float
    epoch: int


def look_ahead_sweep(
    corpus: Corpus,
    held_out: Corpus,
    *,
    frames: Sequence[int] = range(16),
    parameters: Sequence[str] | None = None,
    settings: LowLatencyNetworks | None = None,
    progress: Progress | None = None,
    checkpoint: str | os.PathLike[str] | None = None,
) -> tuple[SweepPoint, ...]:
    """Train a network for every look-ahead, and tell their errors on held-out utterances.

    A network that sees `a` frames ahead is one that sees none and says what was `a` frames ago.
    So all of them see the same, and learn side by side. As in the paper, the error that tells
    when to stop is the one that is told.

    Parameters
    ----------
    corpus
        What they learn.
    held_out
        What they are judged by.
    frames
        The look-aheads, in frames of 1/60 s, 0 to 30; the context is 31 frames for all.
    parameters
        What they predict; the occlusion group of Table 1 where not given, or all parameters of a
        corpus that lacks it.
    settings
        Whose settings are taken, such as ``epochs``, ``patience``, ``hidden_units`` (one number)
        and ``seed``; its own contexts and groups do not count.
    progress
        Called with a `LogEntry` for every network and epoch; its part is ``N ahead``.
    checkpoint
        Where the state is kept, to go on from.

    Returns
    -------
    tuple[SweepPoint, ...]
        One for each look-ahead, in the order given.

    Raises
    ------
    ConfigurationError
        If a look-ahead or a setting is not possible.
    DataError
        If there is nothing to learn from, or a parameter is not in the corpus.
    """
    model = settings or LowLatencyNetworks()
    steps = tuple(frames)
    if not steps or len(set(steps)) < len(steps) or not all(0 <= a < CONTEXT for a in steps):
        raise ConfigurationError(
            "these look-aheads are not possible",
            found=", ".join(map(str, steps)) or "none",
            expected=f"different whole numbers of frames, 0 to {CONTEXT - 1}",
        )
    names = corpus.parameter_names
    if parameters is None:
        occlusion = TABLE_1["occlusion"]
        parameters = occlusion if set(occlusion) <= set(names) else names
    unknown = [name for name in parameters if name not in names]
    if unknown or not parameters:
        raise DataError(
            "the corpus lacks a parameter",
            found=", ".join(unknown) or "none asked for",
            expected=f"some of {', '.join(names)}",
        )
    columns = [names.index(name) for name in parameters]
    hidden = 50 if model.hidden_units is None else model.hidden_units
    if not isinstance(hidden, int):
        raise ConfigurationError(
            "the networks of a sweep are all of one size",
            found=", ".join(map(str, hidden)),
            expected="one number of hidden units",
        )
    model.check()
    count = len(columns)
    networks = [
        Network(f"{ahead} ahead", tuple(range(i * count, (i + 1) * count)), hidden)
        for i, ahead in enumerate(steps)
    ]
    data, judged = (
        tuple(_delayed(utterances, each, columns, steps, model.stress) for each in utterances)
        for utterances in (corpus, held_out)
    )
    for part in (data, judged):
        if not any(np.isfinite(each.targets).any() for each in part):
            raise DataError("no utterance has a parameter value while its phones are spoken")
    training = Training(networks, model.plan, model.delays, data, judged, scale_of(data))
    training.run(progress or _ignored, None if checkpoint is None else Path(checkpoint))
    return tuple(
        _best(training.log, network.name, ahead)
        for network, ahead in zip(networks, steps, strict=True)
    )


def _delayed(
    corpus: Corpus, utterance: Utterance, columns: Sequence[int], steps: Sequence[int], stress: bool
) -> Example:
    """An utterance whose targets are those of so many frames ago, for each look-ahead."""
    longest = max(steps)
    own = example(utterance, corpus, CONTEXT - 1, 0, stress, after=longest)
    targets = own.targets[:, columns]
    late = np.full((len(targets), len(steps), len(columns)), np.nan)
    for i, ahead in enumerate(steps):
        late[ahead:, i] = targets[: len(targets) - ahead]
    return Example(own.inputs, late.reshape(len(targets), -1))


def _best(log: Sequence[LogEntry], name: str, ahead: int) -> SweepPoint:
    errors = [
        (entry.validation_error, entry.iteration)
        for entry in log
        if entry.part == name and entry.validation_error is not None
    ]
    error, epoch = min(errors)
    return SweepPoint(ahead, ahead / INNER_RATE, error, epoch)


def _ignored(entry: LogEntry) -> None:
    pass
