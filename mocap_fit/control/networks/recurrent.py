"""Recurrent three-layer networks of one size, side by side: outputs, error and gradient.

A hidden unit of a frame sees the input layer and all hidden units one to several frames earlier
(Beskow section 4.4); outputs are linear. Networks of one size are stacked, so that one product
serves all of them, and the input layer, which does not depend on the past, is one product for all
frames. The past is kept as `(networks, sentences, delays + frames, hidden)`: the hidden
units of the last frames then lie side by side, and all delays are one product too.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]


class Weights(NamedTuple):
    """The connections of stacked networks, or the gradient by them.

    Parameters
    ----------
    inputs
        `(networks, context · inputs, hidden)`.
    delayed
        `(networks, delays · hidden, hidden)`, the longest delay first.
    hidden_bias
        `(networks, 1, hidden)`.
    outputs
        `(networks, hidden, outputs)`.
    output_bias
        `(networks, 1, outputs)`.
    """

    inputs: Array
    delayed: Array
    hidden_bias: Array
    outputs: Array
    output_bias: Array

    @property
    def delays(self) -> int:
        """The longest delay, frames."""
        return int(self.delayed.shape[1] // self.delayed.shape[2])

    def map(self, change: Callable[[Array], Array]) -> Weights:
        """The same change made to each array."""
        return Weights(*map(change, self))


def connections(inputs: int, hidden: int, outputs: int, delays: int) -> int:
    """Connections of one network, biases included, as Table 1 counts them."""
    return inputs * hidden + delays * hidden * hidden + hidden * outputs + hidden + outputs


def drawn_weights(
    networks: int,
    inputs: int,
    hidden: int,
    outputs: int,
    delays: int,
    generator: np.random.Generator,
) -> Weights:
    """Weights to start from: small random connections, biases 0.

    Parameters
    ----------
    networks
        How many are stacked.
    inputs, hidden, outputs
        Units of the layers; the inputs of the whole context.
    delays
        The longest delay, frames.
    generator
        What they are drawn from.
    """

    def drawn(*shape: int, scale: float = 1.0) -> Array:
        return generator.normal(0.0, scale * shape[1] ** -0.5, shape)

    return Weights(
        drawn(networks, inputs, hidden),
        # Below 1 together, or the past would not fade.
        drawn(networks, delays * hidden, hidden, scale=0.7),
        np.zeros((networks, 1, hidden)),
        drawn(networks, hidden, outputs),
        np.zeros((networks, 1, outputs)),
    )


def _sliding(past: Array, frames: int, delays: int, first: int) -> Array:
    """Of every frame the ``delays`` rows from ``first + frame`` on, `(frames, N, B, delays · H)`.

    A view: the rows of one network and sentence lie side by side.
    """
    networks, sentences, _, hidden = past.shape
    by_network, by_sentence, by_frame, by_unit = past.strides
    return np.lib.stride_tricks.as_strided(
        past[:, :, first:],
        (frames, networks, sentences, delays * hidden),
        (by_frame, by_network, by_sentence, by_unit),
    )


def hidden_units(weights: Weights, seen: Array, past: Array | None = None) -> Array:
    """Run the networks.

    Parameters
    ----------
    weights
        Of the networks.
    seen
        `(sentences, frames, context · inputs)`: what the input layer sees.
    past
        `(networks, sentences, delays, hidden)`: the hidden units before the first frame; 0 where
        not given.

    Returns
    -------
    Array
        `(networks, sentences, delays + frames, hidden)`, the past first.
    """
    sentences, frames, inputs = seen.shape
    networks, _, hidden = weights.inputs.shape
    delays = weights.delays
    # One product for all networks, frames and sentences.
    side_by_side = np.ascontiguousarray(weights.inputs.transpose(1, 0, 2)).reshape(inputs, -1)
    driven = seen.reshape(-1, inputs) @ side_by_side
    driven += weights.hidden_bias.reshape(-1)
    driven = driven.reshape(sentences, frames, networks, hidden).transpose(1, 2, 0, 3)
    driven = np.ascontiguousarray(driven)
    units = np.zeros((networks, sentences, delays + frames, hidden), driven.dtype)
    if past is not None:
        units[:, :, :delays] = past
    earlier = _sliding(units, frames, delays, 0)
    room = np.empty((networks, sentences, hidden), driven.dtype)
    of_frame = units.transpose(2, 0, 1, 3)[delays:]
    for before, drive, now in zip(earlier, driven, of_frame, strict=True):
        np.matmul(before, weights.delayed, out=room)
        np.add(room, drive, out=room)
        np.tanh(room, out=now)
    return units


def network_outputs(weights: Weights, units: Array) -> Array:
    """The output layer, `(networks, sentences, frames, outputs)`, of hidden units without past."""
    networks, sentences, frames, hidden = units.shape
    flat = np.ascontiguousarray(units).reshape(networks, sentences * frames, hidden)
    found = flat @ weights.outputs + weights.output_bias
    return np.asarray(found).reshape(networks, sentences, frames, -1)


def without_offsets(difference: Array, counted: Array, forgiven: float) -> Array:
    """Errors, less a share of every sentence's mean error.

    Parameters
    ----------
    difference
        `(networks, sentences, frames, outputs)`, 0 where a value does not count.
    counted
        The same shape: 1 where a value counts, else 0.
    forgiven
        The share, 0 to 1. The products with `difference` add up to its squares, less that share
        of the squares of a sentence's mean.
    """
    if not forgiven:
        return difference
    means = difference.sum(axis=2, keepdims=True)
    means /= np.maximum(counted.sum(axis=2, keepdims=True), 1)
    return np.asarray(difference - difference.dtype.type(forgiven) * means * counted)


def errors_and_gradient(
    weights: Weights, seen: Array, targets: Array, counted: Array, forgiven: float = 0.0
) -> tuple[Array, Weights]:
    """Squared errors, and their gradient by back-propagation through time.

    Parameters
    ----------
    weights
        Of the networks.
    seen
        `(sentences, frames, context · inputs)`.
    targets
        `(networks, sentences, frames, outputs)`; any number where a value does not count.
    counted
        The same shape: 1 where a value counts, else 0.
    forgiven
        Share of every sentence's mean error that does not count (`without_offsets`).

    Returns
    -------
    squares
        `(networks, outputs)`: sums of the squared errors that count (eq. 5 of Beskow).
    gradient
        Of each network's squared error over its number of counted values.
    """
    sentences, frames, inputs = seen.shape
    networks, _, hidden = weights.inputs.shape
    delays = weights.delays
    units = hidden_units(weights, seen)
    flat_units = np.ascontiguousarray(units[:, :, delays:]).reshape(networks, -1, hidden)
    difference = flat_units @ weights.outputs + weights.output_bias
    difference = (difference.reshape(targets.shape) - targets) * counted
    kept = without_offsets(difference, counted, forgiven)
    squares = np.einsum("nbfo,nbfo->no", difference, kept)
    difference = kept.reshape(networks, sentences * frames, -1)
    count = counted.sum(axis=(1, 2, 3)).reshape(-1, 1, 1)
    difference = difference * (2.0 / np.maximum(count, 1)).astype(difference.dtype)

    of_outputs = flat_units.transpose(0, 2, 1) @ difference
    of_output_bias = difference.sum(axis=1, keepdims=True)
    shape = (networks, sentences, frames, hidden)
    arriving = (difference @ weights.outputs.transpose(0, 2, 1)).reshape(shape)
    slopes = (1.0 - flat_units * flat_units).reshape(shape)

    # Backwards, a unit hears of the errors one to `delays` frames later.
    blocks = weights.delayed.reshape(networks, delays, hidden, hidden)
    backwards = np.ascontiguousarray(blocks[:, ::-1].transpose(0, 1, 3, 2))
    backwards = backwards.reshape(networks, delays * hidden, hidden)
    sent = np.zeros((networks, sentences, frames + delays, hidden), units.dtype)
    later = _sliding(sent, frames, delays, 1)
    room = np.empty((networks, sentences, hidden), units.dtype)
    arriving, slopes = (np.ascontiguousarray(a.transpose(2, 0, 1, 3)) for a in (arriving, slopes))
    of_frame = sent.transpose(2, 0, 1, 3)[:frames]
    for frame in range(frames - 1, -1, -1):
        np.matmul(later[frame], backwards, out=room)
        np.add(room, arriving[frame], out=room)
        np.multiply(room, slopes[frame], out=of_frame[frame])

    sent = np.ascontiguousarray(sent[:, :, :frames]).reshape(networks, -1, hidden)
    side_by_side = np.ascontiguousarray(sent.transpose(1, 0, 2)).reshape(-1, networks * hidden)
    of_inputs = (seen.reshape(-1, inputs).T @ side_by_side).reshape(inputs, networks, hidden)
    of_delayed = np.empty_like(weights.delayed)
    for delay in range(delays):
        before = np.ascontiguousarray(units[:, :, delay : delay + frames])
        before = before.reshape(networks, -1, hidden).transpose(0, 2, 1)
        of_delayed[:, delay * hidden : (delay + 1) * hidden] = before @ sent
    gradient = Weights(
        np.ascontiguousarray(of_inputs.transpose(1, 0, 2)),
        of_delayed,
        sent.sum(axis=1, keepdims=True),
        of_outputs,
        of_output_bias,
    )
    return squares, gradient
