"""The error of networks that see 0 to 15 frames ahead (Beskow figure 4)."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from mocap_fit.control.base import LogEntry, Progress
from mocap_fit.control.networks.examples import Example, Scale, load_example
from mocap_fit.control.networks.features import INNER_RATE
from mocap_fit.control.networks.models import TABLE_1, LowLatencyNetworks
from mocap_fit.control.networks.stack import Network
from mocap_fit.control.networks.training import Training
from mocap_fit.control.settings import check_settings, get_settings
from mocap_fit.corpus import Corpus, Utterance
from mocap_fit.errors import ConfigurationError, DataError
from mocap_fit.processes import limit_to_one_thread

#: Frames of the context, whatever part of it lies ahead.
CONTEXT = 31


class SweepPoint(NamedTuple):
    """A point of figure 4.

    Parameters
    ----------
    frames
        Look-ahead, frames of 1/60 s.
    look_ahead
        Look-ahead, seconds.
    error
        Root mean square error over the held-out utterances, in the unit of the parameters.
    epoch
        The epoch in which it was reached.
    """

    frames: int
    look_ahead: float
    error: float
    epoch: int


def sweep_look_ahead(
    corpus: Corpus,
    held_out: Corpus,
    *,
    frames: Sequence[int] = range(16),
    parameters: Sequence[str] | None = None,
    settings: LowLatencyNetworks | None = None,
    progress: Progress | None = None,
    checkpoint: str | os.PathLike[str] | None = None,
) -> tuple[SweepPoint, ...]:
    """Train a network for every look-ahead, and return their errors on held-out utterances.

    A network that sees `a` frames ahead is one that sees none and predicts what was `a` frames
    ago. So all of them see the same, and learn side by side. As in the paper, the error that
    decides when to stop is the one that is returned.

    Parameters
    ----------
    corpus
        The training part.
    held_out
        Utterances that the networks are judged by.
    frames
        The look-aheads, in frames of 1/60 s, 0 to 30; the context is 31 frames for all.
    parameters
        Names of the parameters that they predict; by default the occlusion group of Table 1, or
        all parameters of a corpus that lacks it.
    settings
        A model whose settings are used, such as ``max_iter``, ``patience``, ``hidden_units`` (one
        number) and ``random_state``; its contexts and groups do not count.
    progress
        Called with a `LogEntry` for every network and epoch; its part is ``N ahead``.
    checkpoint
        A file in which the state is stored, to resume from.

    Returns
    -------
    tuple[SweepPoint, ...]
        One for each look-ahead, in the order of ``frames``.

    Raises
    ------
    ConfigurationError
        If a look-ahead or a setting is out of range.
    DataError
        If there is nothing to learn from, or a parameter is not in the corpus.
    """
    model = settings or LowLatencyNetworks()
    steps = tuple(frames)
    if not steps or len(set(steps)) < len(steps) or not all(0 <= a < CONTEXT for a in steps):
        raise ConfigurationError(
            "the look-aheads are out of range",
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
            found=", ".join(unknown) or "none",
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
    check_settings(type(model), get_settings(model))
    count = len(columns)
    networks = [
        Network(f"{ahead} ahead", tuple(range(i * count, (i + 1) * count)), hidden)
        for i, ahead in enumerate(steps)
    ]
    data, judged = (
        tuple(_load_delayed(utterances, each, columns, steps, model.stress) for each in utterances)
        for utterances in (corpus, held_out)
    )
    for part in (data, judged):
        if not any(np.isfinite(each.targets).any() for each in part):
            raise DataError("no utterance has a parameter value while its phones are spoken")
    scale = Scale.from_examples(data)
    training = Training(networks, model.plan, model.delays, data, judged, scale)
    with limit_to_one_thread():
        path = None if checkpoint is None else Path(checkpoint)
        training.run(progress or (lambda entry: None), path)
    return tuple(
        _find_best(training.log, network.name, ahead)
        for network, ahead in zip(networks, steps, strict=True)
    )


def _load_delayed(
    corpus: Corpus, utterance: Utterance, columns: Sequence[int], steps: Sequence[int], stress: bool
) -> Example:
    """Return an utterance with the targets of some frames ago, for each look-ahead."""
    longest = max(steps)
    example = load_example(utterance, corpus, CONTEXT - 1, 0, stress, after=longest)
    targets = example.targets[:, columns]
    late = np.full((len(targets), len(steps), len(columns)), np.nan)
    for i, ahead in enumerate(steps):
        late[ahead:, i] = targets[: len(targets) - ahead]
    return Example(example.inputs, late.reshape(len(targets), -1))


def _find_best(log: Sequence[LogEntry], name: str, ahead: int) -> SweepPoint:
    errors = [
        (entry.validation_error, entry.iteration)
        for entry in log
        if entry.part == name and entry.validation_error is not None
    ]
    error, epoch = min(errors)
    return SweepPoint(ahead, ahead / INNER_RATE, error, epoch)
